"""Windows: all events of all disks for a short time, by tiles (`tiles.py`) or, in one tile that is the whole box, in order.

The length of a window depends on the state of the gas at its beginning only, never on how it is computed: windows are
where places and velocities are rounded.
"""

from .events import run_events
from .language import ti
from .layout import (
    ALONE, AT_END, BAD, BEGIN, BINS, CELLS, COLLISIONS, COUNT, END, FAR, FASTEST, FULL, FULL_CELLS,
    FULL_PLACES, GX, GY, KICK, LANES, NEEDED, NEXT_TILE, N_BAD, N_SLOTS, N_WINDOWS, PART, PATH, PAUSE,
    PAUSE_AFTER, PLACES, RESTING, SPREAD, SQUARES, SQUARE_UNIT, STALLED, START, STOP, TALLY, TILES_X,
    TILES_Y, TILE_SIDE, WALL_SPEED, WANTED, WINDOW, Cube, GasArrays, Rows, N,
)  # fmt: skip
from .tiles import choose, gather, is_bad, region_of
from .walls import place_walls, wall_phases

LARGEST_WAY = 0.4  # of the side of a tile, that the fastest disk may come in a window


@ti.pyfunc
def window_length(mean_square, fastest2, path, tile_side, pull, wall_speed):
    """How long a window is [time]: as long as disks take for a `path`, and none comes far into the next tile.

    Gravity and walls set disks at rest in motion.
    """
    push = ti.sqrt(pull * path) + wall_speed
    speed = ti.sqrt(mean_square) + push
    fastest = ti.sqrt(fastest2) + push
    length = FAR
    if speed > 0.0:
        length = ti.min(path / speed, LARGEST_WAY * tile_side / fastest)
    return length


@ti.pyfunc
def square_unit(fastest2):
    """Unit in which squares of speeds are added up: whole numbers, whose sum is exact in any order. A power of two."""
    unit = 1.0
    if fastest2 > 0.0:
        unit = 2.0 ** (ti.floor(ti.log(fastest2) * 1.4426950408889634) - 20.0)
    return unit


@ti.func
def run_tile(tile, lane, gas: ti.template()):
    """The window of one tile; nothing if there is no room for it, which `counter` tells."""
    region = region_of(tile, lane, gas)
    for column in range(TALLY):
        gas.tally[tile, AT_END, column] = 0.0
    if ti.static(gas.uses.thermal):
        for column in range(gas.heat.shape[2]):
            gas.heat[tile, AT_END, column] = 0.0
    if region.nx * region.ny > gas.grid[CELLS]:
        ti.atomic_or(gas.counter[FULL], FULL_CELLS)
        ti.atomic_max(gas.counter[NEEDED], region.nx * region.ny)
    else:
        n, own = choose(tile, lane, region, gas)
        if n > gas.grid[PLACES]:
            ti.atomic_or(gas.counter[FULL], FULL_PLACES)
            ti.atomic_max(gas.counter[NEEDED], n)
        else:
            part = 1 - gas.grid[PART]
            if gas.tile[tile][BAD] == 0:  # the first try
                gas.tile[tile][START + part] = ti.atomic_add(gas.counter[N_SLOTS], own)
                gas.tile[tile][COUNT + part] = own
            gather(n, tile, lane, region, gas)
            if ti.static(gas.uses.walled):
                place_walls(lane, region, gas)
            n_bins = 1
            while n_bins < n and 2 * n_bins <= gas.grid[BINS]:
                n_bins *= 2
            run_events(n, lane, n_bins, tile, gas.tile[tile][START + part], region, gas)


@ti.func
def plan(gas: ti.template()):
    """Set the next window of a gas in one tile, from the sums of the last one. A force ends it."""
    mean_square = gas.tally[0, AT_END, SQUARES] * ti.cast(gas.scale[SQUARE_UNIT], ti.f64) / ti.max(gas.grid[N], 1)
    pull = ti.sqrt(ti.cast(gas.scale[GX], ti.f64) ** 2 + ti.cast(gas.scale[GY], ti.f64) ** 2)
    length = window_length(
        mean_square, gas.tally[0, AT_END, FASTEST], gas.clock[PATH], gas.clock[TILE_SIDE], pull, gas.clock[WALL_SPEED]
    )
    gas.clock[BEGIN] = gas.clock[END]
    gas.clock[END] = ti.min(gas.clock[BEGIN] + length, gas.clock[KICK])
    gas.scale[WINDOW] = ti.cast(gas.clock[END] - gas.clock[BEGIN], float)
    gas.grid[PART] = 1 - gas.grid[PART]
    gas.counter[N_SLOTS] = 0
    gas.scale[SQUARE_UNIT] = ti.cast(square_unit(gas.tally[0, AT_END, FASTEST]), float)


@ti.func
def close_window(gas: ti.template()):
    """Add the window of a gas in one tile to the sums of the launch; 1 if another one may follow at once, else 0.

    None does where the run stops or pauses, a force acts, or something is amiss.
    """
    for column in range(TALLY):
        gas.sums[column] = gas.sums[column] + gas.tally[0, AT_END, column]
    if ti.static(gas.uses.thermal):
        for column in range(gas.heat.shape[2]):
            gas.sums[TALLY + column] = gas.sums[TALLY + column] + gas.heat[0, AT_END, column]
    end, collisions = gas.clock[END], gas.sums[COLLISIONS]
    amiss = gas.counter[FULL] + gas.counter[STALLED] + gas.counter[RESTING] > 0
    done = end >= gas.clock[STOP] or end >= gas.clock[KICK] or collisions >= gas.clock[WANTED]
    paused = end >= gas.clock[PAUSE] or collisions >= gas.clock[PAUSE_AFTER]
    still = gas.tally[0, AT_END, FASTEST] == 0.0
    return not (amiss or done or paused or still)


@ti.kernel
def run_windows(
    n_listed: ti.i32, most_windows: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, sums: Rows, counter: Rows,
    disk: Rows, meta: Rows, past: Rows, hits: Rows, kind: Rows, kinds: Rows, trail: Rows, way: Rows, back: Rows,
    tile: Rows, listed: Rows, reach: Rows, edge_x: Rows, edge_y: Rows, tally: Cube, heat: Cube, claim: Rows, claim_at: Rows, work: Rows, link: Rows, mark: Rows, begun: Rows, chosen: Rows, 
    since: Rows, turn: Rows, head: Rows, bin: Rows, wall_start: Rows, wall_item: Rows, walls: Rows, law: Cube,
):  # fmt: skip
    """The window of `n_listed` tiles, each by one thread; or up to `most_windows` windows of a gas in one tile."""
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, clock=clock, sums=sums, counter=counter, disk=disk, meta=meta, past=past, hits=hits,
        kind=kind, kinds=kinds, trail=trail, way=way, back=back, tile=tile, listed=listed, reach=reach, edge_x=edge_x,
        edge_y=edge_y, tally=tally, heat=heat, claim=claim, claim_at=claim_at, work=work,
        link=link, mark=mark, begun=begun, chosen=chosen, since=since, turn=turn, head=head, bin=bin,
        wall_start=wall_start, wall_item=wall_item, walls=walls, law=law, uses=uses,
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
                    run_tile(gas.listed[k], lane, gas)
                    going = 0
                    if gas.grid[ALONE] == 1:
                        gas.counter[N_WINDOWS] = gas.counter[N_WINDOWS] + 1
                        if close_window(gas) and gas.counter[N_WINDOWS] < most_windows:
                            going = 1
                            plan(gas)
                            if ti.static(gas.uses.walled):
                                wall_phases(gas)
                k = ti.atomic_add(gas.counter[NEXT_TILE], 1)


@ti.kernel
def verify(
    uses: ti.template(), grid: Rows, scale: Rows, counter: Rows, disk: Rows, trail: Rows, way: Rows, back: Rows,
    tile: Rows, listed: Rows, reach: Rows, edge_x: Rows, edge_y: Rows, claim: Rows, claim_at: Rows,
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
                gas.tile[k][BAD] = is_bad(k, gas)
                if gas.tile[k][BAD] == 1:
                    gas.listed[ti.atomic_add(gas.counter[N_BAD], 1)] = k
                k = ti.atomic_add(gas.counter[NEXT_TILE], 1)
