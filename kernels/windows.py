"""Windows: all events for a short time, by tiles (`tiles.py`) or, in one tile that is the whole box, in order.

The length of a window depends on the state of the gas at its beginning only, never on how it is computed: windows are
where places and velocities are rounded.
"""

from .events import predict, run_events
from .language import Cube, Rows, Table, on_gpu, spread_of_loops, ti
from .layout import (
    AGAIN, ALONE, AT_END, BAD, BEGIN, BEYOND, BINS, BLOCK_OF_TILES, CELLS, CHAIN, COLLISIONS, COUNT,
    END, FAR, FASTEST, FIRST_SUM, FREE_PATH, FULL, FULL_CELLS, FULL_PLACES, GATHERED, GX, GY, HALO,
    HALTED, IN_WINDOW, KICK, LANES, LEAST_SIDE, LONGEST, MOMENT_IN, MOST_BEYOND, MOST_FURTHEST, MOST_HALO,
    MOST_MOMENTS, MOST_PROTRUDES, MOST_SPEED, NEEDED, NEXT_TILE, N_BAD, N_CLAIMED, N_EVENTS, N_SLOTS, N_WINDOWS,
    OWNED, PART, PATH, PAUSE, PAUSED, PAUSE_AFTER, PLACES, RESTING, RESUMING, ROOM, SPEED, SQUARES, SQUARE_UNIT,
    STALLED, START, STOP, STRIDE, STUCK, TILES_X, TILES_Y, TILE_SIDE, USUAL_HALO, VX, VY,
    WALL_SPEED, WANTED, WIDER, WIDEST, WINDOW, N, gas_of,
)  # fmt: skip
from .places import round_products
from .rest import judge
from .tiles import (
    begin, cells_of, chain, chain_layers, choose, count_chunk, is_too_narrow, is_wrong, lay, order, region_of,
    team_of, write,
)  # fmt: skip
from .walls import fastest_piston, place_walls, wall_phases

# Of a gas in one tile: a second's work at most, between two looks at the clock.
MOST_EVENTS_OF_A_LAUNCH = 1_000_000
LEAST_PATH = 0.01  # of that of a gas that fills the box
WIDEN = 1.6  # halo of a tile that has to be run again
LEAST_HALO = 0.7  # of the least side of a tile, that the widest halo may have before disks are listed anew
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
def usual_halo(chain, fastest, pull, wall_speed, window):
    """Halo [length] for who may come in a window, the fastest disk included, and for who hits whom in chains."""
    return chain + 2.0 * ((fastest + wall_speed) * window + 0.5 * pull * window * window)


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
    elif gas.counter[AGAIN] == 1:
        found = gas.listed[k]
    return found


@ti.func
def is_owned(tile, gas: ti.template()):
    """1 if a tile is one of this rank's; all are where there is but one."""
    found = 1
    if ti.static(gas.uses.shared):
        found = gas.tile[tile, OWNED]
    return found


@ti.func
def has_room(tile, region: ti.template(), gas: ti.template()):
    """1 if the scratch space suffices for the disks and cells of a tile; else 0, and `counter` tells what does."""
    n, cells = gas.tile[tile, GATHERED], cells_of(region, gas)
    if cells > gas.grid[CELLS]:
        ti.atomic_or(gas.counter[FULL], FULL_CELLS)
        ti.atomic_max(gas.counter[NEEDED], cells)
    elif n > gas.grid[PLACES]:
        ti.atomic_or(gas.counter[FULL], FULL_PLACES)
        ti.atomic_max(gas.counter[NEEDED], n)
    return cells <= gas.grid[CELLS] and n <= gas.grid[PLACES]


@ti.func
def bins_of(n, gas: ti.template()):
    """Number of bins for n disks: a power of two."""
    n_bins = 1
    while n_bins < n and 2 * n_bins <= gas.grid[BINS]:
        n_bins *= 2
    return n_bins


@ti.func
def run_tile(tile, lane, gas: ti.template()):
    """The window of one tile, or the rest of it; nothing if there is no room for it, which `counter` tells."""
    resuming = gas.counter[RESUMING]
    gas.counter[RESUMING] = 0
    if resuming == 0:
        begin(tile, gas)
        prepare(tile, lane, gas)
    if gas.counter[FULL] == 0:
        region = region_of(tile, lane, gas)
        n = gas.tile[tile, GATHERED]
        run_events(n, bins_of(n, gas), tile, resuming, region, gas)


@ti.func
def prepare(tile, lane, gas: ti.template()):
    """Lay out the disks of a tile and its halo for a window."""
    region = region_of(tile, lane, gas)
    if cells_of(region, gas) <= gas.grid[CELLS]:
        for c in range(region.nx * region.ny):
            gas.head[region.cells + c] = 0
        choose(tile, 0, region, gas)
    if has_room(tile, region, gas):
        order(tile, 0, region, gas)
        n = gas.tile[tile, GATHERED]
        for m in range(n):
            lay(m, tile, region, gas)
        if ti.static(gas.uses.layered):
            chain_layers(n, region, gas)
        else:
            for i in range(region.lane * gas.grid[PLACES], region.lane * gas.grid[PLACES] + n):
                chain(i, n, region, gas)
        if ti.static(gas.uses.walled):
            place_walls(region, gas)
        if ti.static(gas.uses.rests):
            judge(n, tile, region, gas)


@ti.func
def total_of(column, gas: ti.template()):
    """One of the sums over all tiles to the end of the window; the largest square of a speed."""
    total = gas.tally[0, AT_END, column]
    if gas.grid[ALONE] == 0:
        total = gas.total[FIRST_SUM + column]
        if column == FASTEST:
            total = gas.total[MOST_SPEED]
    return total


@ti.func
def plan(gas: ti.template()):
    """Set the next window, from the sums of the last one, which are added up. A force ends it."""
    for column in range(gas.tally.shape[2]):
        gas.sums[column] = gas.sums[column] + total_of(column, gas)
    way = gas.clock[SPEED] * (gas.clock[END] - gas.clock[BEGIN])
    gas.clock[PATH] = path_from(
        gas.clock[PATH], gas.clock[FREE_PATH], gas.clock[IN_WINDOW], way, total_of(COLLISIONS, gas)
    )
    fastest2 = total_of(FASTEST, gas)
    mean_square = total_of(SQUARES, gas) * gas.clock[SQUARE_UNIT] / ti.max(gas.grid[N], 1)
    gas.clock[SPEED] = ti.sqrt(mean_square)
    gx, gy = ti.cast(gas.scale[GX], ti.f64), ti.cast(gas.scale[GY], ti.f64)
    pull = ti.sqrt(gx * gx + gy * gy)
    wall_speed = gas.clock[WALL_SPEED]
    if ti.static(gas.uses.pistons):
        wall_speed += fastest_piston(gas)
    length = window_length(mean_square, fastest2, gas.clock[PATH], gas.clock[TILE_SIDE], pull, wall_speed)
    length = ti.min(length, gas.clock[LONGEST])
    gas.clock[BEGIN] = gas.clock[END]
    gas.clock[END] = ti.min(gas.clock[BEGIN] + length, gas.clock[KICK])
    window = gas.clock[END] - gas.clock[BEGIN]
    gas.scale[WINDOW] = ti.cast(window, float)
    gas.grid[PART] = 1 - gas.grid[PART]
    gas.counter[N_SLOTS] = 0
    gas.clock[SQUARE_UNIT] = square_unit(ti.max(fastest2, least_square(pull, length, wall_speed)))
    for m in range(2 * MOST_MOMENTS):
        gas.scale[MOMENT_IN + m] = FAR
    if gas.clock[STOP] < gas.clock[END]:
        moment = ti.cast(gas.clock[STOP] - gas.clock[BEGIN], float)
        gas.scale[MOMENT_IN], gas.scale[MOMENT_IN + 1] = moment, moment
    if gas.grid[ALONE] == 0:
        halo = usual_halo(gas.scale[CHAIN], ti.sqrt(fastest2), pull, gas.clock[WALL_SPEED], window)
        gas.scale[USUAL_HALO] = ti.cast(halo, float)
        gas.scale[MOST_HALO] = ti.cast(gas.scale[LEAST_SIDE] - gas.total[MOST_PROTRUDES], float)


@ti.func
def may_go_on(gas: ti.template()):
    """1 if another window may follow at once, else 0.

    None does where the run stops or pauses, a force acts, something is amiss, or the launch has lasted long enough.
    """
    end, collisions = gas.clock[END], gas.sums[COLLISIONS] + total_of(COLLISIONS, gas)
    amiss = gas.counter[FULL] + gas.counter[STALLED] + gas.counter[RESTING] + gas.counter[PAUSED] > 0
    done = end >= gas.clock[STOP] or end >= gas.clock[KICK] or collisions >= gas.clock[WANTED]
    paused = end >= gas.clock[PAUSE] or collisions >= gas.clock[PAUSE_AFTER]
    still = total_of(FASTEST, gas) == 0.0
    long = gas.grid[ALONE] == 1 and gas.counter[N_EVENTS] > MOST_EVENTS_OF_A_LAUNCH
    if gas.grid[ALONE] == 0:
        reach = ti.cast(gas.scale[WIDEST], ti.f64) + gas.total[MOST_BEYOND] + gas.total[MOST_FURTHEST]
        amiss = amiss or gas.counter[N_BAD] > 0 or reach > gas.scale[MOST_HALO]
        amiss = (
            amiss or gas.scale[LEAST_SIDE] - gas.total[MOST_PROTRUDES] < LEAST_HALO * gas.scale[LEAST_SIDE]
        )
    return not (amiss or done or paused or still or long)


@ti.func
def begin_window(gas: ti.template()):
    """Begin a window of all tiles: the one that the host has set, or the next one, if there may be one."""
    if gas.counter[AGAIN] == 0:
        if gas.counter[N_WINDOWS] > 0:
            if may_go_on(gas):
                plan(gas)
            else:
                gas.counter[HALTED] = 1
        if gas.counter[HALTED] == 0:
            gas.counter[N_WINDOWS] = gas.counter[N_WINDOWS] + 1
            gas.counter[N_CLAIMED] = 0


@ti.func
def is_going(gas: ti.template()):
    """1 as long as there is room for all and the window may be run, else 0."""
    return gas.counter[FULL] == 0 and gas.counter[HALTED] == 0


@ti.func
def share_of(item, first, gas: ti.template()):
    """Work of an item of a loop over teams of threads: tile, its region, number in the team, number of disks.

    No disks where nothing is to be done.
    """
    round_products(gas)
    lane = item // ti.static(team_of(gas.uses))
    k = tile_of(first + lane, gas)
    n = ti.select(is_going(gas), gas.tile[k, GATHERED], 0)
    return k, region_of(k, lane, gas), item - lane * ti.static(team_of(gas.uses)), n


@ti.func
def is_summed_here(gas: ti.template()):
    """1 if a launch adds up what tiles did; ranks tell one another first (`sum_shared`)."""
    found = 1
    if ti.static(gas.uses.shared):
        found = gas.grid[ALONE]
    return found


@ti.func
def sum_up(b, column, gas: ti.template()):
    """One column of `found` for block b of tiles."""
    first = b * BLOCK_OF_TILES
    last = ti.min(first + BLOCK_OF_TILES, gas.grid[TILES_X] * gas.grid[TILES_Y])
    total = ti.cast(0.0, ti.f64)
    columns = gas.tally.shape[2]
    if column == MOST_SPEED:
        for k in range(first, last):
            total = ti.max(total, gas.tally[k, AT_END, FASTEST])
    elif column < FIRST_SUM:
        for k in range(first, last):
            total = ti.max(total, ti.cast(gas.reach[k, BEYOND + column - MOST_BEYOND], ti.f64))
    else:
        when = (column - FIRST_SUM) // columns
        of = column - FIRST_SUM - when * columns
        for k in range(first, last):
            total += gas.tally[k, when, of]
    gas.found[b, column] = total


@ti.func
def sum_blocks(column, gas: ti.template()):
    """One column of `total`: block after block, in one order whatever computes it."""
    total = gas.found[0, column]
    for b in range(1, gas.found.shape[0]):
        if column < FIRST_SUM:
            total = ti.max(total, gas.found[b, column])
        else:
            total += gas.found[b, column]
    gas.total[column] = total


@ti.kernel
def run_windows(
    first: ti.i32, n_listed: ti.i32, most_windows: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, clock: Rows,
    sums: Rows, counter: Rows,
    disk: Rows, meta: Rows, past: Rows, hits: Rows, spent: Rows, slept: Rows, held: Rows, told_at: Rows, note: Table,
    note_at: Rows, note_tally: Table, kind: Rows, kinds: Rows, trail: Rows,
    way: Rows, back: Rows, tile: Table, listed: Rows, reach: Table, edge_x: Rows, edge_y: Rows, tally: Cube,
    claim: Rows, claim_at: Rows, work: Rows, link: Rows, mark: Rows,
    begun: Rows, rest: Rows, balance: Rows, touch: Rows, grip: Rows, chosen: Rows,
    since: Rows, turn: Rows, loss: Rows, head: Rows, bin: Rows, wall_start: Rows, wall_item: Rows,
    walls: Rows, law: Cube, watched: Rows, event: Rows, event_int: Rows, found: Table, total: Rows,
):  # fmt: skip
    """The window of tiles `first` to `n_listed`, and sums over all; or `most_windows` windows of a gas in one tile.

    The first launch runs the window that the host has set, each further one the next, if there may be one. On a CPU
    each thread takes tile after tile. On a GPU, where there is a lane for each tile, teams of threads share all the
    work but the events.
    """
    gas = ti.static(gas_of(
        grid=grid, scale=scale, clock=clock, sums=sums, counter=counter, disk=disk, meta=meta, past=past, hits=hits,
        spent=spent, slept=slept, held=held, told_at=told_at, note=note, note_at=note_at, note_tally=note_tally,
        rest=rest, balance=balance, touch=touch, grip=grip, kind=kind, kinds=kinds, trail=trail, way=way, back=back,
        tile=tile, listed=listed, reach=reach, edge_x=edge_x, edge_y=edge_y, tally=tally, claim=claim,
        claim_at=claim_at, work=work, link=link, mark=mark, begun=begun, chosen=chosen, since=since, turn=turn,
        loss=loss, head=head, bin=bin, wall_start=wall_start, wall_item=wall_item, walls=walls, law=law,
        watched=watched, event=event, event_int=event_int, found=found, total=total, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        round_products(gas)
        if (gas.grid[ALONE] == 0 or ti.static(on_gpu())) and first == 0:
            begin_window(gas)
        if ti.static(gas.uses.walled):
            wall_phases(gas)
    if ti.static(on_gpu()):
        team = ti.static(team_of(gas.uses))
        for lane in range(n_listed - first):
            round_products(gas)
            if is_going(gas):
                begin(tile_of(first + lane, gas), gas)
        for c in range((n_listed - first) * gas.grid[CELLS]):
            gas.head[c] = 0
        for item in range((n_listed - first) * team):
            k, region, thread, _n = share_of(item, first, gas)
            if is_going(gas) and cells_of(region, gas) <= gas.grid[CELLS]:
                choose(k, thread, region, gas)
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
                lay(m, k, region, gas)
                m += team
        for item in range((n_listed - first) * team):
            _k, region, m, n = share_of(item, first, gas)
            if ti.static(gas.uses.layered):
                if n > 0:
                    chain_layers(n, region, gas)
            else:
                while m < n:
                    chain(region.lane * gas.grid[PLACES] + m, n, region, gas)
                    m += team
        for item in range((n_listed - first) * team):
            _k, region, m, n = share_of(item, first, gas)
            while m < n:
                predict(region.lane * gas.grid[PLACES] + m, 0, 1, -1, 1, 1, 0, region, gas)
                m += team
        ti.loop_config(block_dim=32)
        for item in range((n_listed - first) * gas.grid[STRIDE]):
            k, region, _m, n = share_of(item // gas.grid[STRIDE] * team, first, gas)
            if item % gas.grid[STRIDE] == 0 and is_going(gas):
                run_events(n, bins_of(n, gas), k, 0, region, gas)
        for item in range((n_listed - first) * team):
            k, region, thread, n = share_of(item, first, gas)
            if n > 0:
                write(n, k, AT_END, thread, team, region, gas)
    else:
        spread = ti.static(spread_of_loops())
        for item in range(spread * gas.grid[LANES]):
            if item % spread == 0:
                k = ti.atomic_add(gas.counter[NEXT_TILE], 1)
                while k < n_listed and gas.counter[FULL] == 0:
                    going = 1
                    while going == 1:
                        run_tile(tile_of(k, gas), item // spread, gas)
                        going = 0
                        if gas.grid[ALONE] == 1:
                            gas.counter[N_WINDOWS] = gas.counter[N_WINDOWS] + 1
                            if may_go_on(gas) and gas.counter[N_WINDOWS] < most_windows:
                                going = 1
                                plan(gas)
                                if ti.static(gas.uses.walled):
                                    wall_phases(gas)
                    k = ti.atomic_add(gas.counter[NEXT_TILE], 1)
    for item in range(gas.found.shape[0] * gas.found.shape[1]):
        round_products(gas)
        if is_summed_here(gas):
            sum_up(item // gas.found.shape[1], item % gas.found.shape[1], gas)
    for column in range(gas.total.shape[0]):
        if is_summed_here(gas):
            sum_blocks(column, gas)


@ti.kernel
def verify(
    uses: ti.template(), grid: Rows, scale: Rows, counter: Rows, disk: Rows, trail: Rows, way: Rows, back: Rows,
    tile: Table, listed: Rows, reach: Table, edge_x: Rows, edge_y: Rows, claim: Rows, claim_at: Rows,
):  # fmt: skip
    """Find the tiles whose windows may not be exact: into `listed`, `counter[N_BAD]` of them; widen their halos."""
    gas = ti.static(gas_of(
        grid=grid, scale=scale, counter=counter, disk=disk, trail=trail, way=way, back=back, tile=tile, listed=listed,
        reach=reach, edge_x=edge_x, edge_y=edge_y, claim=claim, claim_at=claim_at, uses=uses,
    ))  # fmt: skip
    team = ti.static(team_of(gas.uses))
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        round_products(gas)
        if item % spread == 0 and is_going(gas) and is_owned(item // spread, gas) == 1:
            gas.tile[item // spread, BAD] = is_too_narrow(item // spread, gas)
    for item in range(spread * team * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        round_products(gas)
        if item % spread == 0:
            k = item // (spread * team)
            if is_going(gas) and is_owned(k, gas) == 1 and gas.tile[k, BAD] == 0:
                if is_wrong(k, item // spread - k * team, gas) == 1:
                    gas.tile[k, BAD] = 1
    for k in range(gas.grid[TILES_X] * gas.grid[TILES_Y]):
        round_products(gas)
        if is_going(gas) and gas.tile[k, BAD] == 1:
            gas.listed[ti.atomic_add(gas.counter[N_BAD], 1)] = k
            if gas.reach[k, HALO] >= gas.scale[MOST_HALO]:
                ti.atomic_add(gas.counter[STUCK], 1)
            gas.reach[k, WIDER] = WIDEN * gas.reach[k, WIDER]


@ti.kernel
def survey(
    uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, disk: Rows, tile: Table, tally: Cube,
    reach: Table, found: Table, total: Rows,
):  # fmt: skip
    """The largest square of a speed and the sum of all, as a window's end tells, of disks moved by something else."""
    gas = ti.static(gas_of(
        grid=grid, scale=scale, clock=clock, disk=disk, tile=tile, tally=tally, reach=reach, found=found,
        total=total, uses=uses,
    ))  # fmt: skip
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        round_products(gas)
        if item % spread == 0 and is_owned(item // spread, gas) == 1:
            k = item // spread
            first = gas.grid[PART] * gas.grid[ROOM] + gas.tile[k, START + gas.grid[PART]]
            fastest, squares = 0.0 * gas.scale[WINDOW], ti.cast(0.0, ti.f64)
            for s in range(first, first + gas.tile[k, COUNT + gas.grid[PART]]):
                speed2 = gas.disk[s][VX] * gas.disk[s][VX] + gas.disk[s][VY] * gas.disk[s][VY]
                fastest = ti.max(fastest, speed2)
                squares += ti.floor(ti.cast(speed2, ti.f64) / gas.clock[SQUARE_UNIT])
            gas.tally[k, AT_END, FASTEST] = ti.cast(fastest, ti.f64)
            gas.tally[k, AT_END, SQUARES] = squares
    for item in range(gas.found.shape[0] * gas.found.shape[1]):
        round_products(gas)
        if is_summed_here(gas):
            sum_up(item // gas.found.shape[1], item % gas.found.shape[1], gas)
    for column in range(gas.total.shape[0]):
        if is_summed_here(gas):
            sum_blocks(column, gas)


@ti.kernel
def sum_shared(
    n_blocks: ti.i32, last: ti.i32, uses: ti.template(), grid: Rows, tally: Cube, reach: Table,
    found: Table, total: Rows, blocks: Rows,
):  # fmt: skip
    """The last step of `run_windows` and `survey` on ranks: sums of `n_blocks` blocks of tiles; of all, if `last`."""
    gas = ti.static(gas_of(
        grid=grid, tally=tally, reach=reach, found=found, total=total, uses=uses,
    ))  # fmt: skip
    for item in range(n_blocks * gas.found.shape[1]):
        sum_up(blocks[item // gas.found.shape[1]], item % gas.found.shape[1], gas)
    for column in range(last * gas.total.shape[0]):
        sum_blocks(column, gas)
