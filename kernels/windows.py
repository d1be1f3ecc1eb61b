"""Windows: all events for a short time, by tiles (`tiles.py`) or, in one tile that is the whole box, in order.

The length of a window depends on the state of the gas at its beginning only, never on how it is computed: windows are
where places and velocities are rounded.
"""

from .columns import MOST_MOMENTS, REACH, SCALE, TALLY, TOTAL
from .events import predict, run_events
from .language import on_gpu, spread_of_loops, ti
from .layout import AT_END, BLOCK_OF_TILES, FAR, FULL_CELLS, FULL_SLOTS
from .particle import round_products
from .rest import update_resting
from .signature import Arrays, kernel
from .tiles import (
    begin, cells_of, count_chunk, gather, is_too_narrow, is_wrong, link_cells, link_cells_of_layers, load, order,
    region_of, team_of, write,
)  # fmt: skip
from .walls.cells import place_walls
from .walls.motion import wall_phases
from .walls.pistons import fastest_piston

# Of a gas in one tile: a second's work at most, between two looks at the clock.
MOST_EVENTS_OF_A_LAUNCH = 1_000_000
LEAST_PATH = 0.01  # of that of a gas that fills the box
HALO_GROWTH = 1.6  # halo of a tile that has to be run again
LEAST_HALO = 0.7  # of the least side of a tile, that the widest halo may have before disks are listed anew
MAX_TRAVEL = 0.4  # of the side of a tile, that the fastest disk may come in a window


@ti.pyfunc
def window_length(mean_square, fastest2, path, tile_side, pull, wall_speed):
    """Length of a window [time]: as long as disks take for a `path`, and none comes far into the next tile.

    Gravity and walls set disks at rest in motion.
    """
    push = ti.sqrt(pull * path) + wall_speed
    speed = ti.sqrt(mean_square) + push
    fastest = ti.sqrt(fastest2) + push
    length = FAR + 0.0 * path  # f64, in single precision too
    if speed > 0.0:
        length = ti.min(path / speed, MAX_TRAVEL * tile_side / fastest)
    return length


@ti.pyfunc
def usual_halo(chain_halo, fastest, pull, wall_speed, window):
    """Halo [length] for who may come in a window, the fastest disk included, and for who hits whom in chains."""
    return chain_halo + 2.0 * ((fastest + wall_speed) * window + 0.5 * pull * window * window)


@ti.pyfunc
def path_from(path, free_path, in_window, way, collisions):
    """The path that sets the next window, after one in which disks came a `way` at `path`, with so many collisions.

    That of a gas that fills the box (`free_path`), or a shorter one where disks are in clusters and collide more often,
    so that as many as that gas has `in_window` happen.
    """
    found = free_path
    if collisions > in_window:
        found = ti.max(way * in_window / collisions, LEAST_PATH * free_path)
    return ti.min(ti.min(found, free_path), 2.0 * path)


@ti.func
def square_unit(fastest2):
    """Unit in which squares of speeds are added up: a power of two, so that sums of units are exact in any order."""
    exponent = ti.max(ti.bit_cast(fastest2, ti.i64) >> ti.i64(52), ti.i64(21)) - ti.i64(20)
    return ti.bit_cast(exponent << ti.i64(52), ti.f64)


@ti.pyfunc
def least_square(pull, length, wall_speed):
    """Square of a speed that counts, of gases that gravity or walls set in motion from rest in a window."""
    speed = 1e-3 * (pull * length + wall_speed)
    return speed * speed


@ti.func
def tile_of(k, gas: ti.template()):
    """Tile number k of those that are run."""
    found = k
    if ti.static(gas.uses.shared):
        found = gas.listed[k]
    elif gas.counter.again == 1:
        found = gas.listed[k]
    return found


@ti.func
def is_owned(tile, gas: ti.template()):
    """1 if a tile is one of this rank's; all are where there is but one."""
    found = 1
    if ti.static(gas.uses.shared):
        found = gas.tile[tile].owned
    return found


@ti.func
def has_room(tile, region: ti.template(), gas: ti.template()):
    """1 if the scratch space suffices for the disks and cells of a tile; else 0, and `counter` tells what does."""
    n, cells = gas.tile[tile].gathered, cells_of(region, gas)
    if cells > gas.grid.cells:
        ti.atomic_or(gas.counter.full, FULL_CELLS)
        ti.atomic_max(gas.counter.needed, cells)
    elif n > gas.grid.lane_slots:
        ti.atomic_or(gas.counter.full, FULL_SLOTS)
        ti.atomic_max(gas.counter.needed, n)
    return cells <= gas.grid.cells and n <= gas.grid.lane_slots


@ti.func
def bins_of(n, gas: ti.template()):
    """Number of bins for n disks: a power of two."""
    n_bins = 1
    while n_bins < n and 2 * n_bins <= gas.grid.bins:
        n_bins *= 2
    return n_bins


@ti.func
def run_tile(tile, lane, gas: ti.template()):
    """The window of one tile, or the rest of it; nothing if there is no room for it, which `counter` tells."""
    resuming = gas.counter.resuming
    gas.counter.resuming = 0
    if resuming == 0:
        begin(tile, gas)
        prepare(tile, lane, gas)
    if gas.counter.full == 0:
        region = region_of(tile, lane, gas)
        n = gas.tile[tile].gathered
        run_events(n, bins_of(n, gas), tile, resuming, region, gas)


@ti.func
def prepare(tile, lane, gas: ti.template()):
    """Lay out the disks of a tile and its halo for a window."""
    region = region_of(tile, lane, gas)
    if cells_of(region, gas) <= gas.grid.cells:
        for c in range(region.nx * region.ny):
            gas.head[region.cells + c] = 0
        gather(tile, 0, region, gas)
    if has_room(tile, region, gas):
        order(tile, 0, region, gas)
        n = gas.tile[tile].gathered
        for m in range(n):
            load(m, tile, region, gas)
        if ti.static(gas.uses.layered):
            link_cells_of_layers(n, region, gas)
        else:
            for i in range(region.lane * gas.grid.lane_slots, region.lane * gas.grid.lane_slots + n):
                link_cells(i, n, region, gas)
        if ti.static(gas.uses.walled):
            place_walls(region, gas)
        if ti.static(gas.uses.rests):
            update_resting(n, tile, region, gas)


@ti.func
def total_of(column, gas: ti.template()):
    """One of the sums over all tiles to the end of the window; the largest square of a speed."""
    total = gas.tally[0, AT_END][column]
    if gas.grid.single_tile == 0:
        total = gas.total[TOTAL.width + column]
        if column == TALLY.fastest:
            total = gas.total.max_speed_sq
    return total


@ti.func
def plan(gas: ti.template()):
    """Set the next window, from the sums of the last one, which are added up. A force ends it."""
    for column in range(gas.tally.shape[2]):
        gas.sums[column] = gas.sums[column] + total_of(column, gas)
    way = gas.clock.speed * (gas.clock.end - gas.clock.begin)
    gas.clock.path = path_from(
        gas.clock.path, gas.clock.free_path, gas.clock.in_window, way, total_of(TALLY.collisions, gas)
    )
    fastest2 = total_of(TALLY.fastest, gas)
    mean_square = total_of(TALLY.squares, gas) * gas.clock.square_unit / ti.max(gas.grid.n, 1)
    gas.clock.speed = ti.sqrt(mean_square)
    gx, gy = ti.cast(gas.scale.gx, ti.f64), ti.cast(gas.scale.gy, ti.f64)
    pull = ti.sqrt(gx * gx + gy * gy)
    wall_speed = gas.clock.wall_speed
    if ti.static(gas.uses.pistons):
        wall_speed += fastest_piston(gas)
    length = window_length(mean_square, fastest2, gas.clock.path, gas.clock.tile_side, pull, wall_speed)
    length = ti.min(length, gas.clock.longest)
    gas.clock.begin = gas.clock.end
    gas.clock.end = ti.min(gas.clock.begin + length, gas.clock.kick)
    window = gas.clock.end - gas.clock.begin
    gas.scale.window = ti.cast(window, float)
    gas.grid.part = 1 - gas.grid.part
    gas.counter.n_slots = 0
    gas.clock.square_unit = square_unit(ti.max(fastest2, least_square(pull, length, wall_speed)))
    for m in range(2 * MOST_MOMENTS):
        gas.scale[SCALE.moment.first + m] = FAR
    if gas.clock.stop < gas.clock.end:
        moment = ti.cast(gas.clock.stop - gas.clock.begin, float)
        gas.scale.moment[0].begin, gas.scale.moment[0].until = moment, moment
    if gas.grid.single_tile == 0:
        halo = usual_halo(gas.scale.chain, ti.sqrt(fastest2), pull, gas.clock.wall_speed, window)
        gas.scale.usual_halo = ti.cast(halo, float)
        gas.scale.most_halo = ti.cast(gas.scale.least_side - gas.total.overhang, float)


@ti.func
def may_go_on(gas: ti.template()):
    """1 if another window may follow at once, else 0.

    None does where the run stops or pauses, a force acts, something is amiss, or the launch has lasted long enough.
    """
    end, collisions = gas.clock.end, gas.sums.collisions + total_of(TALLY.collisions, gas)
    amiss = gas.counter.full + gas.counter.stalled + gas.counter.resting + gas.counter.paused > 0
    done = end >= gas.clock.stop or end >= gas.clock.kick or collisions >= gas.clock.wanted
    paused = end >= gas.clock.pause or collisions >= gas.clock.pause_after
    still = total_of(TALLY.fastest, gas) == 0.0
    long = gas.grid.single_tile == 1 and gas.counter.n_events > MOST_EVENTS_OF_A_LAUNCH
    if gas.grid.single_tile == 0:
        reach = ti.cast(gas.scale.widest, ti.f64) + gas.total.excursion + gas.total.max_displacement
        amiss = amiss or gas.counter.n_bad > 0 or reach > gas.scale.most_halo
        amiss = amiss or gas.scale.least_side - gas.total.overhang < LEAST_HALO * gas.scale.least_side
    return not (amiss or done or paused or still or long)


@ti.func
def begin_window(gas: ti.template()):
    """Begin a window of all tiles: the one that the host has set, or the next one, if there may be one."""
    if gas.counter.again == 0:
        if gas.counter.n_windows > 0:
            if may_go_on(gas):
                plan(gas)
            else:
                gas.counter.halted = 1
        if gas.counter.halted == 0:
            gas.counter.n_windows = gas.counter.n_windows + 1
            gas.counter.n_ghosts = 0


@ti.func
def is_going(gas: ti.template()):
    """1 as long as there is room for all and the window may be run, else 0."""
    return gas.counter.full == 0 and gas.counter.halted == 0


@ti.func
def share_of(item, first, gas: ti.template()):
    """Work of an item of a loop over teams of threads: tile, its region, number in the team, number of disks.

    No disks where nothing is to be done.
    """
    round_products(gas)
    lane = item // ti.static(team_of(gas.uses))
    k = tile_of(first + lane, gas)
    n = ti.select(is_going(gas), gas.tile[k].gathered, 0)
    return k, region_of(k, lane, gas), item - lane * ti.static(team_of(gas.uses)), n


@ti.func
def is_summed_here(gas: ti.template()):
    """1 if a launch adds up what tiles did; ranks tell one another first (`sum_shared`)."""
    found = 1
    if ti.static(gas.uses.shared):
        found = gas.grid.single_tile
    return found


@ti.func
def sum_up(b, column, gas: ti.template()):
    """One column of `found` for block b of tiles."""
    first = b * BLOCK_OF_TILES
    last = ti.min(first + BLOCK_OF_TILES, gas.grid.tiles_x * gas.grid.tiles_y)
    total = ti.cast(0.0, ti.f64)
    columns = gas.tally.shape[2]
    if column == TOTAL.max_speed_sq:
        for k in range(first, last):
            total = ti.max(total, gas.tally[k, AT_END].fastest)
    elif column < TOTAL.width:
        for k in range(first, last):
            total = ti.max(total, ti.cast(gas.reach[k][REACH.excursion + column - TOTAL.excursion], ti.f64))
    else:
        when = (column - TOTAL.width) // columns
        of = column - TOTAL.width - when * columns
        for k in range(first, last):
            total += gas.tally[k, when][of]
    gas.found[b][column] = total


@ti.func
def sum_blocks(column, gas: ti.template()):
    """One column of `total`: block after block, in one order whatever computes it."""
    total = gas.found[0][column]
    for b in range(1, gas.found.shape[0]):
        if column < TOTAL.width:
            total = ti.max(total, gas.found[b][column])
        else:
            total += gas.found[b][column]
    gas.total[column] = total


@kernel
def run_windows(
    first: ti.i32,
    n_listed: ti.i32,
    most_windows: ti.i32,
    gas: Arrays(
        "uses grid scale clock sums counter disk meta past hits spent slept held snapshot_time note note_at "
        "note_tally kind kinds history_hash displacement slot_before tile listed reach edge_x edge_y tally "
        "ghost ghost_position motion event_info image_info start_position rest residual_acceleration contact "
        "cached_force candidates since turn loss head bin wall_start wall_item walls law watched event "
        "event_int found total"
    ),
):
    """The window of tiles `first` to `n_listed`, and sums over all; or `most_windows` windows of a gas in one tile.

    The first launch runs the window that the host has set, each further one the next, if there may be one. On a CPU
    each thread takes tile after tile. On a GPU, where there is a lane for each tile, teams of threads share all the
    work but the events.
    """
    for _ in range(1):
        round_products(gas)
        if (gas.grid.single_tile == 0 or ti.static(on_gpu())) and first == 0:
            begin_window(gas)
        if ti.static(gas.uses.walled):
            wall_phases(gas)
    if ti.static(on_gpu()):
        team = ti.static(team_of(gas.uses))
        for lane in range(n_listed - first):
            round_products(gas)
            if is_going(gas):
                begin(tile_of(first + lane, gas), gas)
        for c in range((n_listed - first) * gas.grid.cells):
            gas.head[c] = 0
        for item in range((n_listed - first) * team):
            k, region, thread, _n = share_of(item, first, gas)
            if is_going(gas) and cells_of(region, gas) <= gas.grid.cells:
                gather(k, thread, region, gas)
        for item in range((n_listed - first) * team):
            k, region, thread, _n = share_of(item, first, gas)
            if is_going(gas) and has_room(k, region, gas):
                count_chunk(thread, region, gas)
        for item in range((n_listed - first) * team):
            k, region, thread, _n = share_of(item, first, gas)
            if is_going(gas):
                order(k, thread, region, gas)
                if ti.static(gas.uses.walled):
                    if thread == 0:
                        place_walls(region, gas)
        for item in range((n_listed - first) * team):
            k, region, m, n = share_of(item, first, gas)
            while m < n:
                load(m, k, region, gas)
                m += team
        for item in range((n_listed - first) * team):
            _k, region, m, n = share_of(item, first, gas)
            if ti.static(gas.uses.layered):
                if n > 0:
                    link_cells_of_layers(n, region, gas)
            else:
                while m < n:
                    link_cells(region.lane * gas.grid.lane_slots + m, n, region, gas)
                    m += team
        for item in range((n_listed - first) * team):
            _k, region, m, n = share_of(item, first, gas)
            while m < n:
                predict(region.lane * gas.grid.lane_slots + m, 0, 1, -1, 1, 1, 0, region, gas)
                m += team
        ti.loop_config(block_dim=32)
        for item in range((n_listed - first) * gas.grid.stride):
            k, region, _m, n = share_of(item // gas.grid.stride * team, first, gas)
            if item % gas.grid.stride == 0 and is_going(gas):
                run_events(n, bins_of(n, gas), k, 0, region, gas)
        for item in range((n_listed - first) * team):
            k, region, thread, n = share_of(item, first, gas)
            if n > 0:
                write(n, k, AT_END, thread, team, region, gas)
    else:
        spread = ti.static(spread_of_loops())
        for item in range(spread * gas.grid.lanes):
            if item % spread == 0:
                k = ti.atomic_add(gas.counter.next_tile, 1)
                while k < n_listed and gas.counter.full == 0:
                    going = 1
                    while going == 1:
                        run_tile(tile_of(k, gas), item // spread, gas)
                        going = 0
                        if gas.grid.single_tile == 1:
                            gas.counter.n_windows = gas.counter.n_windows + 1
                            if may_go_on(gas) and gas.counter.n_windows < most_windows:
                                going = 1
                                plan(gas)
                                if ti.static(gas.uses.walled):
                                    wall_phases(gas)
                    k = ti.atomic_add(gas.counter.next_tile, 1)
    for item in range(gas.found.shape[0] * gas.found.shape[1]):
        round_products(gas)
        if is_summed_here(gas):
            sum_up(item // gas.found.shape[1], item % gas.found.shape[1], gas)
    for column in range(gas.total.shape[0]):
        if is_summed_here(gas):
            sum_blocks(column, gas)


@kernel
def verify(
    gas: Arrays(
        "uses grid scale counter disk history_hash displacement slot_before tile listed reach edge_x edge_y "
        "ghost ghost_position"
    ),
):
    """Find the tiles whose windows may not be exact: into `listed`, `counter.n_bad` of them; widen their halos."""
    team = ti.static(team_of(gas.uses))
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if item % spread == 0 and is_going(gas) and is_owned(item // spread, gas) == 1:
            gas.tile[item // spread].bad = is_too_narrow(item // spread, gas)
    for item in range(spread * team * gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if item % spread == 0:
            k = item // (spread * team)
            if is_going(gas) and is_owned(k, gas) == 1 and gas.tile[k].bad == 0:
                if is_wrong(k, item // spread - k * team, gas) == 1:
                    gas.tile[k].bad = 1
    for k in range(gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if is_going(gas) and gas.tile[k].bad == 1:
            gas.listed[ti.atomic_add(gas.counter.n_bad, 1)] = k
            if gas.reach[k].halo >= gas.scale.most_halo:
                ti.atomic_add(gas.counter.stuck, 1)
            gas.reach[k].halo_factor = HALO_GROWTH * gas.reach[k].halo_factor


@kernel
def survey(gas: Arrays("uses grid scale clock disk tile tally reach found total")):
    """The largest square of a speed and the sum of all, as a window's end tells, of disks moved by something else."""
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
    for item in range(gas.found.shape[0] * gas.found.shape[1]):
        round_products(gas)
        if is_summed_here(gas):
            sum_up(item // gas.found.shape[1], item % gas.found.shape[1], gas)
    for column in range(gas.total.shape[0]):
        if is_summed_here(gas):
            sum_blocks(column, gas)


@kernel
def sum_shared(n_blocks: ti.i32, last: ti.i32, gas: Arrays("uses grid tally reach found total blocks")):
    """The last step of `run_windows` and `survey` on ranks: sums of `n_blocks` blocks of tiles; of all, if `last`."""
    for item in range(n_blocks * gas.found.shape[1]):
        sum_up(gas.blocks[item // gas.found.shape[1]], item % gas.found.shape[1], gas)
    for column in range(last * gas.total.shape[0]):
        sum_blocks(column, gas)
