"""Windows: all events for a short time, by tiles (`tiles.py`) or, in one tile that is the whole box, in order.

The length of a window depends on the state of the gas at its beginning only, never on how it is computed: windows are
where places and velocities are rounded.
"""

from .events import run_events
from .language import ti
from .layout import (
    AGAIN, ALONE, AT_END, BAD, BEGIN, BINS, CELLS, COLLISIONS, COUNT, END, FAR, FASTEST, FREE_PATH, FULL,
    FULL_CELLS, FULL_PLACES, GX, GY, IN_WINDOW, KICK, LANES, MOMENT_IN, NEEDED, NEXT_TILE, N_BAD, N_EVENTS,
    N_SLOTS, N_WINDOWS, PART, PATH, PAUSE, PAUSED, PAUSE_AFTER, PLACES, RESTING, RESUMING, ROOM, SPEED,
    SPREAD, SQUARES, SQUARE_UNIT, STALLED, START, STOP, TALLY, TILES_X, TILES_Y, TILE_SIDE, VX, VY,
    WALL_SPEED, WANTED, WINDOW, Cube, GasArrays, Rows, Table, N,
)  # fmt: skip
from .tiles import cells_of, choose, gather, is_bad, region_of
from .walls import place_walls, wall_phases

MOST_EVENTS_OF_A_LAUNCH = (
    1_000_000  # of a gas in one tile: a second's work at most, between two looks at the clock
)
LEAST_PATH = 0.01  # of that of a gas that fills the box
LARGEST_WAY = 0.4  # of the side of a tile, that the fastest disk may come in a window


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
        length = ti.min(path / speed, LARGEST_WAY * tile_side / fastest)
    return length


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


@ti.func
def run_tile(tile, lane, gas: ti.template()):
    """The window of one tile, or the rest of it; nothing if there is no room for it, which `counter` tells."""
    region = region_of(tile, lane, gas)
    n = gas.grid[N]
    resuming = gas.counter[RESUMING]
    if resuming == 1:
        gas.counter[RESUMING] = 0
    else:
        n = prepare(tile, lane, region, gas)
    if gas.counter[FULL] == 0:
        n_bins = 1
        while n_bins < n and 2 * n_bins <= gas.grid[BINS]:
            n_bins *= 2
        run_events(n, lane, n_bins, tile, gas.tile[tile, START + 1 - gas.grid[PART]], resuming, region, gas)


@ti.func
def prepare(tile, lane, region: ti.template(), gas: ti.template()):
    """Lay out the disks of a tile and its halo for a window; how many there are."""
    for column in range(TALLY):
        gas.tally[tile, AT_END, column] = 0.0
    if ti.static(gas.uses.thermal):
        for column in range(gas.heat.shape[2]):
            gas.heat[tile, AT_END, column] = 0.0
    found = 0
    if cells_of(region, gas) > gas.grid[CELLS]:
        ti.atomic_or(gas.counter[FULL], FULL_CELLS)
        ti.atomic_max(gas.counter[NEEDED], cells_of(region, gas))
    else:
        n, own = choose(tile, lane, region, gas)
        found = n
        if n > gas.grid[PLACES]:
            ti.atomic_or(gas.counter[FULL], FULL_PLACES)
            ti.atomic_max(gas.counter[NEEDED], n)
        else:
            part = 1 - gas.grid[PART]
            if gas.counter[AGAIN] == 0:  # the first try
                gas.tile[tile, START + part] = ti.atomic_add(gas.counter[N_SLOTS], own)
                gas.tile[tile, COUNT + part] = own
                if gas.grid[ALONE] == 1:
                    for other in range(gas.grid[TILES_X] * gas.grid[TILES_Y]):
                        gas.tile[other, START + part] = gas.tile[other, START + gas.grid[PART]]
                        gas.tile[other, COUNT + part] = gas.tile[other, COUNT + gas.grid[PART]]
            gather(n, tile, lane, region, gas)
            if ti.static(gas.uses.walled):
                place_walls(region, gas)
    return found


@ti.func
def plan(gas: ti.template()):
    """Set the next window of a gas in one tile, from the tally of the last one, which is added up. A force ends it."""
    for column in range(TALLY):
        gas.sums[column] = gas.sums[column] + gas.tally[0, AT_END, column]
    if ti.static(gas.uses.thermal):
        for column in range(gas.heat.shape[2]):
            gas.sums[TALLY + column] = gas.sums[TALLY + column] + gas.heat[0, AT_END, column]
    way = gas.clock[SPEED] * (gas.clock[END] - gas.clock[BEGIN])
    gas.clock[PATH] = path_from(
        gas.clock[PATH], gas.clock[FREE_PATH], gas.clock[IN_WINDOW], way, gas.tally[0, AT_END, COLLISIONS]
    )
    mean_square = gas.tally[0, AT_END, SQUARES] * gas.clock[SQUARE_UNIT] / ti.max(gas.grid[N], 1)
    gas.clock[SPEED] = ti.sqrt(mean_square)
    pull = ti.sqrt(ti.cast(gas.scale[GX], ti.f64) ** 2 + ti.cast(gas.scale[GY], ti.f64) ** 2)
    length = window_length(
        mean_square,
        gas.tally[0, AT_END, FASTEST],
        gas.clock[PATH],
        gas.clock[TILE_SIDE],
        pull,
        gas.clock[WALL_SPEED],
    )
    gas.clock[BEGIN] = gas.clock[END]
    gas.clock[END] = ti.min(gas.clock[BEGIN] + length, gas.clock[KICK])
    gas.scale[WINDOW] = ti.cast(gas.clock[END] - gas.clock[BEGIN], float)
    gas.grid[PART] = 1 - gas.grid[PART]
    gas.counter[N_SLOTS] = 0
    gas.clock[SQUARE_UNIT] = square_unit(gas.tally[0, AT_END, FASTEST])
    gas.scale[MOMENT_IN] = FAR
    if gas.clock[STOP] < gas.clock[END]:
        gas.scale[MOMENT_IN] = ti.cast(gas.clock[STOP] - gas.clock[BEGIN], float)


@ti.func
def may_go_on(gas: ti.template()):
    """1 if another window of a gas in one tile may follow at once, else 0.

    None does where the run stops or pauses, a force acts, something is amiss, or the launch has lasted long enough.
    """
    end, collisions = gas.clock[END], gas.sums[COLLISIONS] + gas.tally[0, AT_END, COLLISIONS]
    amiss = gas.counter[FULL] + gas.counter[STALLED] + gas.counter[RESTING] + gas.counter[PAUSED] > 0
    done = end >= gas.clock[STOP] or end >= gas.clock[KICK] or collisions >= gas.clock[WANTED]
    paused = end >= gas.clock[PAUSE] or collisions >= gas.clock[PAUSE_AFTER]
    still = gas.tally[0, AT_END, FASTEST] == 0.0
    long = gas.counter[N_EVENTS] > MOST_EVENTS_OF_A_LAUNCH
    return not (amiss or done or paused or still or long)


@ti.kernel
def run_windows(
    n_listed: ti.i32, most_windows: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, sums: Rows,
    counter: Rows,
    disk: Rows, meta: Rows, past: Rows, hits: Rows, kind: Rows, kinds: Rows, trail: Rows, way: Rows, back: Rows,
    tile: Table, listed: Rows, reach: Table, edge_x: Rows, edge_y: Rows, tally: Cube, heat: Cube,
    claim: Rows, claim_at: Rows, work: Rows, link: Rows, mark: Rows,
    begun: Rows, chosen: Rows,
    since: Rows, turn: Rows, head: Rows, bin: Rows, wall_start: Rows, wall_item: Rows, walls: Rows, law: Cube,
    watched: Rows, event: Rows, event_int: Rows,
):  # fmt: skip
    """The window of `n_listed` tiles, each by one thread; or up to `most_windows` windows of a gas in one tile."""
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, clock=clock, sums=sums, counter=counter, disk=disk, meta=meta, past=past, hits=hits,
        kind=kind, kinds=kinds, trail=trail, way=way, back=back, tile=tile, listed=listed, reach=reach, edge_x=edge_x,
        edge_y=edge_y, tally=tally, heat=heat, claim=claim, claim_at=claim_at, work=work,
        link=link, mark=mark, begun=begun, chosen=chosen, since=since, turn=turn, head=head, bin=bin,
        wall_start=wall_start, wall_item=wall_item, walls=walls, law=law, watched=watched, event=event,
        event_int=event_int, uses=uses,
    ))  # fmt: skip
    if ti.static(gas.uses.walled):
        for _ in range(1):
            wall_phases(gas)
    for item in range(SPREAD * gas.grid[LANES]):
        if item % SPREAD == 0:
            lane = item // SPREAD
            k = ti.atomic_add(gas.counter[NEXT_TILE], 1)
            while k < n_listed and gas.counter[FULL] == 0:
                going = 1
                while going == 1:
                    tile_now = k
                    if gas.counter[AGAIN] == 1:
                        tile_now = gas.listed[k]
                    run_tile(tile_now, lane, gas)
                    going = 0
                    if gas.grid[ALONE] == 1:
                        gas.counter[N_WINDOWS] = gas.counter[N_WINDOWS] + 1
                        if may_go_on(gas) and gas.counter[N_WINDOWS] < most_windows:
                            going = 1
                            plan(gas)
                            if ti.static(gas.uses.walled):
                                wall_phases(gas)
                k = ti.atomic_add(gas.counter[NEXT_TILE], 1)


@ti.kernel
def verify(
    uses: ti.template(), grid: Rows, scale: Rows, counter: Rows, disk: Rows, trail: Rows, way: Rows, back: Rows,
    tile: Table, listed: Rows, reach: Table, edge_x: Rows, edge_y: Rows, claim: Rows, claim_at: Rows,
):  # fmt: skip
    """Find the tiles whose windows may not be exact: into `listed`, `counter[N_BAD]` of them."""
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, counter=counter, disk=disk, trail=trail, way=way, back=back, tile=tile, listed=listed,
        reach=reach, edge_x=edge_x, edge_y=edge_y, claim=claim, claim_at=claim_at, uses=uses,
    ))  # fmt: skip
    for item in range(SPREAD * gas.grid[LANES]):
        if item % SPREAD == 0:
            k = ti.atomic_add(gas.counter[NEXT_TILE], 1)
            while k < gas.grid[TILES_X] * gas.grid[TILES_Y]:
                gas.tile[k, BAD] = is_bad(k, gas)
                if gas.tile[k, BAD] == 1:
                    gas.listed[ti.atomic_add(gas.counter[N_BAD], 1)] = k
                k = ti.atomic_add(gas.counter[NEXT_TILE], 1)


@ti.kernel
def survey(
    uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, disk: Rows, tile: Table, tally: Cube,
):  # fmt: skip
    """The largest square of a speed and the sum of all, as a window's end tells, of disks moved by something else."""
    gas = ti.static(
        GasArrays(grid=grid, scale=scale, clock=clock, disk=disk, tile=tile, tally=tally, uses=uses)
    )
    for item in range(SPREAD * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        if item % SPREAD == 0:
            k = item // SPREAD
            first = gas.grid[PART] * gas.grid[ROOM] + gas.tile[k, START + gas.grid[PART]]
            fastest, squares = 0.0 * gas.scale[WINDOW], ti.cast(0.0, ti.f64)
            for s in range(first, first + gas.tile[k, COUNT + gas.grid[PART]]):
                speed2 = gas.disk[s][VX] * gas.disk[s][VX] + gas.disk[s][VY] * gas.disk[s][VY]
                fastest = ti.max(fastest, speed2)
                squares += ti.floor(ti.cast(speed2, ti.f64) / gas.clock[SQUARE_UNIT])
            gas.tally[k, AT_END, FASTEST] = ti.cast(fastest, ti.f64)
            gas.tally[k, AT_END, SQUARES] = squares
