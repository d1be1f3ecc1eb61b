"""The plan of a window: how long it is, and how wide the halos of tiles are.

Its length depends on the state of the gas at its beginning only, never on how it is computed: windows are where
positions and velocities are rounded. The host says where a run stops or pauses and when a force acts; the device plans.
"""

from ..columns import MOST_MOMENTS, TALLY
from ..forces.force_events import kick_time
from ..compiler.language import spread_of_loops, ti
from ..layout import AT_END, FAR, MAX_TRAVEL
from ..disks.particle import round_products
from ..compiler.signature import Arrays, kernel
from ..tiles.sums import is_owned, max_speed_sq, sum_tiles, total_of
from ..walls.pistons import fastest_piston

LEAST_PATH = 0.01  # of that of a gas that fills the box


@ti.func
def window_length(mean_square, fastest2, path, tile_side, pull, wall_speed):
    """Length of a window [time]: disks travel a `path` in it, and none gets far into the next tile.

    Gravity and walls set disks at rest in motion.
    """
    push = ti.sqrt(pull * path) + wall_speed
    speed = ti.sqrt(mean_square) + push
    fastest = ti.sqrt(fastest2) + push
    length = FAR + 0.0 * path  # f64, in single precision too
    if speed > 0.0:
        length = ti.min(path / speed, ti.f64(MAX_TRAVEL) * tile_side / fastest)
    return length


@ti.func
def usual_halo(chain_halo, fastest, pull, wall_speed, window):
    """Halo [length] of disks that may arrive in a window, the fastest included, and of chains of collisions."""
    return chain_halo + 2.0 * ((fastest + wall_speed) * window + 0.5 * pull * window * window)


@ti.func
def path_from(path, free_path, in_window, most, distance, collisions, events, squares):
    """Path for the next window, after one in which disks moved a `distance` at `path`, with so many collisions.

    That of a gas that fills the box (`free_path`), or a shorter one where disks are in clusters and collide more often,
    so that as many as that gas has `in_window` happen; and so that those that collide do not collide more than `most`
    times on average. `events` is the sum of the numbers of events of all disks, `squares` that of their squares: if
    numbers have Poisson's distribution about a mean that differs from place to place, the mean at the place of an event
    is squares / events - 1.
    """
    found, least = free_path, ti.f64(LEAST_PATH) * free_path
    if collisions > in_window:
        found = ti.max(distance * in_window / collisions, least)
    local = squares - events
    if 2.0 * local > most * events:
        found = ti.min(found, ti.max(distance * most * events / local, least))
    return ti.min(ti.min(found, free_path), 2.0 * path)


@ti.func
def square_unit(fastest2):
    """Unit in which squares of speeds are added up: a power of two, so that sums of units are exact in any order."""
    exponent = ti.max(ti.bit_cast(fastest2, ti.i64) >> ti.i64(52), ti.i64(21)) - ti.i64(20)
    return ti.bit_cast(exponent << ti.i64(52), ti.f64)


@ti.func
def least_square(pull, length, wall_speed):
    """Square of a speed that counts, of gases that gravity or walls set in motion from rest in a window."""
    speed = ti.f64(1e-3) * (pull * length + wall_speed)
    return speed * speed


@ti.func
def pull_of(gas: ti.template()):
    """Acceleration by gravity."""
    gx, gy = ti.cast(gas.scale.gx, ti.f64), ti.cast(gas.scale.gy, ti.f64)
    return ti.sqrt(gx * gx + gy * gy)


@ti.func
def commit(gas: ti.template()):
    """Add the sums of the last window, and begin one where it ended, with the path that follows from it."""
    for column in range(gas.tally.shape[2]):
        gas.sums[column] = gas.sums[column] + total_of(column, gas)
    distance = gas.clock.speed * (gas.clock.end - gas.clock.begin)
    collisions = total_of(TALLY.collisions, gas)
    events = 2.0 * collisions + total_of(TALLY.wall_collisions, gas)
    gas.clock.path = path_from(
        gas.clock.path, gas.clock.free_path, gas.clock.in_window, gas.clock.local_collisions, distance, collisions,
        events, total_of(TALLY.event_squares, gas),
    )  # fmt: skip
    if ti.static(gas.uses.forced):
        gas.clock.recent = ti.max(gas.clock.end - gas.clock.begin, 0.5 * gas.clock.recent)
        row = ti.cast(gas.clock.acted, ti.i32)
        while kick_time(row, gas) <= gas.scale.window:
            row += 1
        gas.clock.acted = ti.cast(row, ti.f64)
    gas.clock.begin = gas.clock.end
    gas.clock.overhang = gas.total.overhang
    gas.grid.part = 1 - gas.grid.part
    gas.counter.n_slots = 0


@ti.func
def plan(gas: ti.template()):
    """Set the end of the window that begins now, from the speeds of the disks. A force ends it."""
    fastest2 = max_speed_sq(gas)
    mean_square = total_of(TALLY.squares, gas) * gas.clock.square_unit / ti.max(gas.clock.n, 1.0)
    if ti.static(gas.uses.actions):
        mean_square = ti.min(mean_square, fastest2)  # infinite where the unit was that of a gas at rest
    gas.clock.speed, gas.clock.fastest = ti.sqrt(mean_square), ti.sqrt(fastest2)
    pull, wall_speed = pull_of(gas), gas.clock.wall_speed
    if ti.static(gas.uses.pistons):
        wall_speed += fastest_piston(gas)
    length = window_length(mean_square, fastest2, gas.clock.path, gas.clock.tile_side, pull, wall_speed)
    length = ti.min(length, gas.clock.longest)
    if ti.static(
        gas.uses.forced
    ):  # which may make disks faster: a window lasts not much longer than the last one
        length = ti.min(length, 2.0 * gas.clock.recent + gas.clock.shortest_step)
    least = least_square(pull, length, wall_speed)
    if ti.static(gas.uses.actions):
        least = ti.max(least, gas.clock.action_square)
    gas.clock.square_unit = square_unit(ti.max(fastest2, least))
    if ti.static(gas.uses.shear):  # rows of tiles move against each other
        most = gas.clock.fastest + 2.0 * ti.abs(ti.cast(gas.scale.drift, ti.f64))
        length = ti.min(length, ti.f64(MAX_TRAVEL) * gas.clock.tile_side / most)
    gas.clock.end = ti.min(gas.clock.begin + length, gas.clock.kick)
    for m in range(MOST_MOMENTS):
        gas.scale.moment[m] = FAR
    if gas.clock.stop < gas.clock.end and gas.grid.moments > 0:
        gas.scale.moment[0] = ti.cast(gas.clock.stop - gas.clock.begin, float)
    set_window(gas)


@ti.func
def set_window(gas: ti.template()):
    """Set the length of a window whose end is known, and the halos for it."""
    window = gas.clock.end - gas.clock.begin
    gas.scale.window = ti.cast(window, float)
    gas.scale.stored_at = gas.scale.window
    if gas.grid.single_tile == 0:
        halo = usual_halo(gas.scale.chain, gas.clock.fastest, pull_of(gas), gas.clock.wall_speed, window)
        if ti.static(gas.uses.shear):
            halo += ti.abs(ti.cast(gas.scale.drift, ti.f64)) * window
        gas.scale.usual_halo = ti.cast(halo, float)
        gas.scale.most_halo = ti.cast(gas.scale.least_side - gas.clock.overhang, float)


@kernel
def plan_window(
    commits: ti.i32, plans: ti.i32, gas: Arrays("uses grid scale clock sums counter walls tally total kicks")
):
    """Plan a window without running it; if it `commits`, the last one is over. Without a plan, its end is known."""
    for _ in range(1):
        round_products(gas)
        if commits == 1:
            commit(gas)
        if plans == 1:
            plan(gas)
        else:
            set_window(gas)


@kernel
def survey(rough: ti.i32, gas: Arrays("uses grid scale clock disk tile tally reach found total")):
    """The largest square of a speed and the sum of all, as at a window's end, of disks that something else has moved.

    The unit of squares follows from the largest one, which another call, a `rough` one, has to find first.
    """
    for _ in range(1):
        gas.clock.square_unit = ti.select(rough == 1, 1.0, square_unit(gas.total.max_speed_sq))
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if item % spread == 0 and is_owned(item // spread, gas) == 1:
            k = item // spread
            first = gas.grid.part * gas.grid.room + gas.tile[k].start[gas.grid.part]
            fastest, squares = 0.0 * gas.scale.window, ti.cast(0.0, ti.f64)
            for s in range(first, first + gas.tile[k].count[gas.grid.part]):
                listed_disk = gas.disk[s]
                speed2 = listed_disk.vx * listed_disk.vx + listed_disk.vy * listed_disk.vy
                fastest = ti.max(fastest, speed2)
                squares += ti.floor(ti.cast(speed2, ti.f64) / gas.clock.square_unit)
            gas.tally[k, AT_END].fastest = ti.cast(fastest, ti.f64)
            gas.tally[k, AT_END].squares = squares
    sum_tiles(gas)
