"""Windows: all events for a short time, by tiles (`tiles/tiles.py`) or, in one tile that is the whole box, in order."""

from ..columns import TALLY
from ..events.events import MOST_EVENTS_OF_A_LAUNCH, begin_trail, predict, repeat_events, run_events
from ..compiler.language import on_gpu, spread_of_loops, ti
from ..forces.force_events import first_horizon
from ..layout import AT_END, BINS_PER_DISK, FULL_CELLS, FULL_SLOTS, TOO_LONG, TOO_MANY
from ..disks.particle import round_products
from .planner import commit, plan
from ..events.rest import update_resting
from ..compiler.signature import Arrays, kernel
from ..tiles.lines import begin_lines
from ..tiles.sums import is_owned, max_speed_sq, sum_tiles, total_of
from ..tiles.tiles import (
    begin, cells_of, count_chunk, gather, is_too_narrow, is_wrong, link_cells, link_cells_of_layers, load,
    note_extremes, order, region_of, slot_of, team_of, write,
)  # fmt: skip
from ..walls.cells import place_walls
from ..walls.motion import wall_phases

HALO_GROWTH = 1.6  # halo of a tile that has to be run again
LEAST_HALO = 0.7  # of the least side of a tile, that the widest halo may have before disks are listed again


@ti.func
def tile_of(k, gas: ti.template()):
    """Tile number k of those that are run."""
    found = k
    if ti.static(gas.uses.ranks or not on_gpu()):
        found = gas.listed[k]
    elif gas.counter.again == 1:
        found = gas.listed[k]
    return found


@ti.func
def has_room(tile, region: ti.template(), gas: ti.template()):
    """1 if the scratch space suffices for the disks and cells of a tile; else 0: `counter` has what is too small."""
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
    n_bins, wanted = 1, n
    if ti.static(not on_gpu()):
        wanted = ti.select(gas.grid.single_tile == 1, BINS_PER_DISK * n, n)
    while n_bins < wanted and 2 * n_bins <= gas.grid.bins:
        n_bins *= 2
    return n_bins


@ti.func
def run_tile(tile, lane, gas: ti.template()):
    """Run the window of one tile, or the rest of it; without room for it, only count what is missing (`has_room`)."""
    resuming = gas.counter.resuming
    gas.counter.resuming = 0
    if resuming == 0:
        begin(tile, 0, 1, gas)
        begin_trail(tile, gas)
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
            load(m, slot_of(m, region, gas), tile, region, gas)
        if ti.static(gas.uses.layers):
            link_cells_of_layers(n, region, gas)
        elif ti.static(gas.uses.thin):
            begin_lines(n, region, gas)
        else:
            for i in range(region.lane * gas.grid.lane_slots, region.lane * gas.grid.lane_slots + n):
                link_cells(i, n, region, gas)
        if ti.static(gas.uses.walls):
            place_walls(region, gas)
        if ti.static(gas.uses.rest):
            update_resting(n, tile, region, gas)


@ti.func
def may_go_on(gas: ti.template()):
    """1 if another window may follow at once, else 0.

    None does where the run stops or pauses, a force acts, something is amiss, or the launch has lasted long enough.
    """
    end, collisions = gas.clock.end, gas.sums.collisions + total_of(TALLY.collisions, gas)
    stopped = gas.counter.full + gas.counter.stalled + gas.counter.resting + gas.counter.paused > 0
    done = end >= gas.clock.stop or end >= gas.clock.kick or collisions >= gas.clock.wanted
    paused = end >= gas.clock.pause or collisions >= gas.clock.pause_after
    still = max_speed_sq(gas) == 0.0
    long = gas.grid.single_tile == 1 and gas.counter.n_events > MOST_EVENTS_OF_A_LAUNCH
    if gas.grid.single_tile == 0:
        reach = ti.cast(gas.scale.widest, ti.f64) + gas.total.excursion + gas.total.max_displacement
        stopped = stopped or gas.counter.n_bad > 0 or reach > gas.scale.most_halo
        stopped = stopped or gas.scale.least_side - gas.total.overhang < LEAST_HALO * gas.scale.least_side
    return not (stopped or done or paused or still or long)


@ti.func
def begin_window(gas: ti.template()):
    """Begin a window of all tiles: the one that the host has set, or the next one, if there may be one."""
    if gas.counter.again == 0:
        if gas.counter.n_windows > 0:
            if may_go_on(gas):
                commit(gas)
                plan(gas)
            else:
                gas.counter.halted = 1
        if gas.counter.halted == 0:
            gas.counter.n_windows = gas.counter.n_windows + 1
            gas.counter.n_ghosts = 0


@ti.func
def is_active(gas: ti.template()):
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
    n = ti.select(is_active(gas), gas.tile[k].gathered, 0)
    return k, region_of(k, lane, gas), item - lane * ti.static(team_of(gas.uses)), n


@ti.func
def run_lane(lane: ti.template(), n_listed: ti.template(), most_windows: ti.template(), gas: ti.template()):
    """The windows of tile after tile, as long as there are some and there is room for them."""
    k = ti.atomic_add(gas.counter.next_tile, 1)
    while k < n_listed and gas.counter.full == 0:
        active = 1
        while active == 1:
            run_tile(tile_of(k, gas), lane, gas)
            active = 0
            if gas.grid.single_tile == 1:
                gas.counter.n_windows = gas.counter.n_windows + 1
                if may_go_on(gas) and gas.counter.n_windows < most_windows:
                    active = 1
                    commit(gas)
                    plan(gas)
                    if ti.static(gas.uses.walls):
                        wall_phases(gas)
        k = ti.atomic_add(gas.counter.next_tile, 1)


@ti.func
def gather_tiles(first: ti.template(), n_listed: ti.template(), gas: ti.template()):
    """Gather the disks of all tiles and their halos, and sort them by cell: loops of a kernel over teams."""
    team = ti.static(team_of(gas.uses))
    for lane in range(n_listed - first):
        round_products(gas)
        if is_active(gas):
            begin(tile_of(first + lane, gas), 0, 1, gas)
    for c in range((n_listed - first) * gas.grid.cells):
        gas.head[c] = 0
    for item in range((n_listed - first) * team):
        k, region, thread, _n = share_of(item, first, gas)
        if is_active(gas) and cells_of(region, gas) <= gas.grid.cells:
            gather(k, thread, region, gas)
    for item in range((n_listed - first) * team):
        k, region, thread, _n = share_of(item, first, gas)
        if is_active(gas) and has_room(k, region, gas):
            count_chunk(thread, region, gas)
    for item in range((n_listed - first) * team):
        k, region, thread, _n = share_of(item, first, gas)
        if is_active(gas):
            order(k, thread, region, gas)
            if ti.static(gas.uses.walls):
                if thread == 0:
                    place_walls(region, gas)


@ti.func
def load_tiles(first: ti.template(), n_listed: ti.template(), gas: ti.template()):
    """Load all disks, link their cells, and predict their first events: loops of a kernel over teams."""
    team = ti.static(team_of(gas.uses))
    for item in range((n_listed - first) * team):
        k, region, m, n = share_of(item, first, gas)
        while m < n:
            load(m, slot_of(m, region, gas), k, region, gas)
            m += team
    for item in range((n_listed - first) * team):
        _k, region, m, n = share_of(item, first, gas)
        if ti.static(gas.uses.layers):
            if n > 0:
                link_cells_of_layers(n, region, gas)
        else:
            while m < n:
                link_cells(region.lane * gas.grid.lane_slots + m, n, region, gas)
                m += team
    for item in range((n_listed - first) * team):
        _k, region, m, n = share_of(item, first, gas)
        while m < n:
            predict(region.lane * gas.grid.lane_slots + m, 0, 1, -1, 1, 1, 0, first_horizon(gas), region, gas)
            m += team


WINDOW = Arrays(
    "uses grid scale clock sums counter disk meta past hits dissipated asleep held kind kinds history_hash "
    "displacement slot_before tile listed reach edge_x edge_y tally ghost motion event_info image_info "
    "action rest residual_acceleration contact cached_force candidates since turn loss head bin line line_slot bunch spare "
    "wall_start wall_item walls law watched event event_int pair_time pair trail_time trail found total kicks shares "
    "force_values first_of_species"
)


@kernel
def run_windows(first: ti.i32, n_listed: ti.i32, most_windows: ti.i32, gas: WINDOW):
    """The window of tiles `first` to `n_listed`, and sums over all; or `most_windows` windows of a gas in one tile.

    The host has set the first window. Each thread of the CPU takes tile after tile.
    """
    ti.loop_config(serialize=True)  # a loop in threads wakes them, which takes longer than what it does
    for _ in range(1):
        round_products(gas)
        if gas.grid.single_tile == 0 and first == 0:
            begin_window(gas)
        if ti.static(gas.uses.walls):
            wall_phases(gas)
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid.lanes):
        if item % spread == 0:
            run_lane(item // spread, n_listed, most_windows, gas)
    sum_tiles(gas)


@ti.func
def repeat_tile(tile, lane, gas: ti.template()):
    """Repeat the window of one tile, up to the last requested moment, with the halo that it had.

    Rows of its trail name slots: with other disks than it had, it notes that it has no room.
    """
    n = gas.tile[tile].gathered
    begin(tile, 0, 1, gas)
    prepare(tile, lane, gas)
    if gas.tile[tile].gathered == n:
        repeat_events(n, tile, region_of(tile, lane, gas), gas)
    else:
        ti.atomic_or(gas.counter.full, FULL_SLOTS)


@kernel
def replay(n_listed: ti.i32, gas: WINDOW):
    """States at moments of a window that `run_windows` has run with trails, and sums over tiles up to them."""
    spread = ti.static(spread_of_loops())
    for item in range(spread * gas.grid.lanes):
        round_products(gas)
        if item % spread == 0:
            k = ti.atomic_add(gas.counter.next_tile, 1)
            while k < n_listed:
                repeat_tile(tile_of(k, gas), item // spread, gas)
                k = ti.atomic_add(gas.counter.next_tile, 1)
    sum_tiles(gas)


@kernel
def run_windows_on_gpu(first: ti.i32, n_listed: ti.i32, most_windows: ti.i32, gas: WINDOW):
    """As `run_windows`, on a GPU: the first launch runs the window that is planned, each further one the next.

    There is a lane for each tile. Teams of threads share all the work but the events.
    """
    for _ in range(1):
        round_products(gas)
        if first == 0:
            begin_window(gas)
        if ti.static(gas.uses.walls):
            wall_phases(gas)
    team = ti.static(team_of(gas.uses))
    gather_tiles(first, n_listed, gas)
    load_tiles(first, n_listed, gas)
    ti.loop_config(block_dim=32)
    for item in range((n_listed - first) * gas.grid.stride):
        k, region, _m, n = share_of(item // gas.grid.stride * team, first, gas)
        if item % gas.grid.stride == 0 and is_active(gas):
            run_events(n, bins_of(n, gas), k, 0, region, gas)
    for item in range((n_listed - first) * team):
        k, region, thread, n = share_of(item, first, gas)
        if n > 0:
            share = write(n, k, AT_END, thread, team, region, gas)
            note_extremes(k, share, gas)
    sum_tiles(gas)


@ti.func
def verify_tile(tile, thread, gas: ti.template()):
    """List a tile as bad if this thread of its team finds that its window may not be exact, and widen its halo."""
    bad = gas.tile[tile].mark > 0
    if not bad:
        bad = is_too_narrow(tile, gas) == 1 or is_wrong(tile, thread, gas) == 1
    if bad:
        if ti.atomic_or(gas.tile[tile].bad, 1) == 0:
            gas.listed[ti.atomic_add(gas.counter.n_bad, 1)] = tile
            if gas.tile[tile].mark == TOO_LONG:
                ti.atomic_add(gas.counter.stuck, 1)
            elif gas.tile[tile].mark > 0:
                if gas.tile[tile].mark != TOO_MANY:
                    ti.atomic_add(gas.counter.n_marked, 1)
            else:
                if gas.reach[tile].halo >= gas.scale.most_halo:
                    ti.atomic_add(gas.counter.stuck, 1)
                gas.reach[tile].halo_factor = HALO_GROWTH * gas.reach[tile].halo_factor


@ti.func
def verify_tiles(asked: ti.template(), gas: ti.template()):
    """Find the tiles whose windows may not be exact, into `listed`, if `asked`: a loop of a kernel."""
    team = ti.static(team_of(gas.uses))
    spread = ti.static(spread_of_loops())
    for item in range(spread * team * gas.grid.tiles_x * gas.grid.tiles_y):
        round_products(gas)
        if item % spread == 0:
            k = item // (spread * team)
            if asked == 1 and is_active(gas) and is_owned(k, gas) == 1:
                verify_tile(k, item // spread - k * team, gas)


@kernel
def verify(
    gas: Arrays(
        "uses grid scale counter disk history_hash displacement slot_before tile listed reach edge_x edge_y ghost"
    ),
):
    """Find the tiles whose windows may not be exact, into `listed`, `counter.n_bad` of them; widen their halos."""
    verify_tiles(1, gas)
