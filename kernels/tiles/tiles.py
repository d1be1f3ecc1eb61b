"""Tiles with halos: gathering disks for a window, writing them at its end, and the test that it is exact.

*Gather.* A tile takes all disks that lie in it (its own) or within its halo, from its list and those of the eight tiles
around it. Disks may have left their tile since they were listed. A tile owns a disk for a window if the disk lies in
the tile at the window's beginning.

*Write.* Own disks go into the tile's new list. For each, the hash of its history (times and partners) and a bound on
its displacement are stored; for each copy of another tile's disk a *ghost record*: the hash of the history that the
copy had here.

*Verify.* A tile is good if

1. its halo is as wide as the largest diameter, as its own disks left its sides, and as any disk around moved at
   all, so that no disk that was not gathered can touch an own disk;
2. of each copy with another history than the disk had in its own tile, neither the disk nor the copy can have touched
   an own disk: circles around their first positions with their displacements as radii do not meet.

Proof. Suppose all tiles are good, and let t be the first time at which the histories that tiles found for their own
disks leave the true motion. Then an own disk i meets, or misses, some k wrongly at t. Until t, i and k moved truly, so
by 1 there is a copy of k in the tile of i, and it or k touched i, so by 2 the copy has the history that k
has in its own tile, which is true before t. The tile of i then computed the meeting from true motions: a contradiction.

Bad tiles are run again, from the same beginning, with wider halos. Nothing is ever undone.
"""

from ..columns import GHOST_STEP, HELD, MECHANISM, TALLY
from ..disks.flights import on_grid
from ..disks.force_times import begin_actions
from ..compiler.language import on_gpu, ti
from .grid import place_of
from ..layout import (
    ASLEEP,
    AT_END,
    AT_MOMENT,
    BLOCK_HALO_DECAY,
    FIRST_WALL,
    FULL_GHOSTS,
    HALO_DECAY,
    MORE,
    NO_PARTNER,
    TEAM,
    SNAPSHOT,
    Uses,
)
from ..disks.particle import (
    add,
    collisions_in_window,
    largest_speed,
    latest_partner,
    listed_kind,
    radius_of,
    speed_square,
    square_of,
)
from ..walls.pistons import write_pistons

ENDLESS = 1.0e30  # a side of a tile at an end of the box that is no periodic side


@ti.func
def wrap_index(index, count, periodic):
    """A column or row of tiles as one of the box, how many boxes away; -1 beyond an end."""
    found, boxes = index, 0
    if periodic == 1:
        boxes = ti.floor(ti.cast(index, ti.f64) / ti.cast(count, ti.f64), ti.i32)
        found = index - boxes * count
    elif index < 0 or index >= count:
        found = -1
    return found, boxes


@ti.func
def sides_of(tile, gas: ti.template()):
    """Width and height of a tile."""
    tx, ty = place_of(tile, gas)
    return (
        ti.cast(gas.edge_x[tx + 1] - gas.edge_x[tx], float),
        ti.cast(gas.edge_y[ty + 1] - gas.edge_y[ty], float),
    )


@ti.func
def bounds_of(margin, tile, gas: ti.template()):
    """Lowest and highest x, then y (from the tile's corner), of a tile and a margin around it; ends have no end."""
    tx, ty = place_of(tile, gas)
    width, height = sides_of(tile, gas)
    x_low, x_high, y_low, y_high = -margin, width + margin, -margin, height + margin
    if gas.grid.periodic_x == 0:
        x_low = ti.select(tx == 0, -ENDLESS, x_low)
        x_high = ti.select(tx == gas.grid.tiles_x - 1, ENDLESS, x_high)
    if gas.grid.periodic_y == 0:
        y_low = ti.select(ty == 0, -ENDLESS, y_low)
        y_high = ti.select(ty == gas.grid.tiles_y - 1, ENDLESS, y_high)
    return x_low, x_high, y_low, y_high


@ti.func
def lies_in(x, y, x_low, x_high, y_low, y_high):
    """1 if a position lies within bounds, else 0: without branches, for of the nine tiles around most disks do not."""
    return (x >= x_low) & (x < x_high) & (y >= y_low) & (y < y_high)


@ti.func
def cell_at(x, y, region: ti.template()):
    """Cell of a position; those at the ends of the region have no end."""
    cx = ti.cast(ti.floor((x - region.x) / region.side_x), ti.i32)
    cy = ti.cast(ti.floor((y - region.y) / region.side_y), ti.i32)
    cx = ti.min(ti.max(cx, 0), region.nx - 1)
    cy = ti.min(ti.max(cy, 0), region.ny - 1)
    return cx * region.ny + cy


@ti.func
def cells_of(region: ti.template(), gas: ti.template()):
    """Number of cells of a region; small ones first, then large ones, where there are two layers."""
    cells = region.nx * region.ny
    if ti.static(gas.uses.layers):
        cells += (region.nx // region.coarse) * (region.ny // region.coarse)
    return cells


@ti.func
def layer_of(i, gas: ti.template()):
    """1 if the disk in slot i lies in a large cell, else 0."""
    layer = 0
    if ti.static(gas.uses.layers):
        layer = ti.cast(radius_of(i, gas) > gas.scale.split, ti.i32)
    return layer


@ti.func
def scale_of(layer, region: ti.template(), gas: ti.template()):
    """Cells of a layer along the region in x and y; small cells along one of them."""
    factor = 1
    nx, ny = region.nx, region.ny
    if ti.static(gas.uses.layers):
        if layer == 1:
            factor = region.coarse
            nx, ny = nx // factor, ny // factor
    return nx, ny, factor


@ti.func
def head_at(cx, cy, layer, region: ti.template(), gas: ti.template()):
    """Index in `head` of the first disk in a cell of a layer."""
    cell = region.cells + cx * region.ny + cy
    if ti.static(gas.uses.layers):
        if layer == 1:
            cell = region.cells + region.nx * region.ny + cx * (region.ny // region.coarse) + cy
    return cell


@ti.func
def region_of(tile, lane, gas: ti.template()):
    """Cells of the tile and its halo, or of the whole box: corner (from the tile's), number, sides."""
    width, height = sides_of(tile, gas)
    halo = gas.reach[tile].halo
    wrap_x, wrap_y = 0, 0
    if gas.grid.single_tile == 1:
        halo = 0.0 * halo
        wrap_x, wrap_y = gas.grid.periodic_x, gas.grid.periodic_y
        width, height = gas.scale.length_x, gas.scale.length_y
    width += 2.0 * halo
    height += 2.0 * halo
    coarse = 1
    if ti.static(gas.uses.layers):
        coarse = gas.grid.coarse
    nx = coarse * ti.max(ti.cast(width / (coarse * gas.scale.cell_side), ti.i32), 1)
    ny = coarse * ti.max(ti.cast(height / (coarse * gas.scale.cell_side), ti.i32), 1)
    tx, ty = place_of(tile, gas)
    return ti.Struct(
        x=-halo, y=-halo, nx=nx, ny=ny, side_x=width / nx, side_y=height / ny, wrap_x=wrap_x, wrap_y=wrap_y,
        cells=lane * gas.grid.cells, lane=lane, coarse=coarse,
        corner_x=ti.cast(gas.edge_x[tx], float), corner_y=ti.cast(gas.edge_y[ty], float),
    )  # fmt: skip


@ti.func
def neighbor_tile(tile, step_x, step_y, gas: ti.template()):
    """The `tile` so many columns and rows away, or -1; how far its corner is (`shift`); how many `boxes` it is away.

    Exact: corners and lengths are on the grid. In a sheared gas all tiles are alike, and rows above have moved on by
    `tiles_aside` tiles (and by `aside`, which is not in this).
    """
    tx, ty = place_of(tile, gas)
    ax = tx + step_x
    if ti.static(gas.uses.shear):
        ax -= step_y * gas.grid.tiles_aside
    bx, boxes_x = wrap_index(ax, gas.grid.tiles_x, gas.grid.periodic_x)
    by, boxes_y = wrap_index(ty + step_y, gas.grid.tiles_y, gas.grid.periodic_y)
    other = -1
    shift_x, shift_y = 0.0 * gas.scale.window, 0.0 * gas.scale.window
    if bx >= 0 and by >= 0:
        other = bx * gas.grid.tiles_y + by
        far_x = gas.edge_x[bx] - gas.edge_x[tx] + boxes_x * gas.edge_x[gas.grid.tiles_x]
        far_y = gas.edge_y[by] - gas.edge_y[ty] + boxes_y * gas.edge_y[gas.grid.tiles_y]
        if ti.static(gas.uses.shear):
            far_x += step_y * gas.grid.tiles_aside * gas.edge_x[1]
        shift_x, shift_y = ti.cast(far_x, float), ti.cast(far_y, float)
    if ti.static(gas.uses.shear):
        boxes_x -= step_y * gas.grid.boxes_aside
    return ti.Struct(
        tile=other, step_y=step_y, shift_x=shift_x, shift_y=shift_y, boxes_x=boxes_x, boxes_y=boxes_y
    )


@ti.func
def gather_tile(tile, step, gas: ti.template()):
    """One of the tiles that a tile gathers from, as `neighbor_tile` describes it.

    The nine around it, or all where one region is the whole box.
    """
    origin = 0.0 * gas.scale.window
    near = ti.Struct(tile=step, step_y=0, shift_x=origin, shift_y=origin, boxes_x=0, boxes_y=0)
    if gas.grid.single_tile == 1:  # the first edge is 0 but in open space
        near.shift_x = ti.cast(gas.edge_x[step // gas.grid.tiles_y] - gas.edge_x[0], float)
        near.shift_y = ti.cast(gas.edge_y[step % gas.grid.tiles_y] - gas.edge_y[0], float)
    else:
        near = neighbor_tile(tile, step // 3 - 1, step % 3 - 1, gas)
    return near


@ti.func
def position_from(s, near, gas: ti.template()):
    """Position of a disk that a tile `near` lists, from the corner of the tile that gathers, and its row of tiles."""
    disk = gas.disk[s]
    x, y = disk.x + near.shift_x, disk.y + near.shift_y
    row = 0
    if ti.static(gas.uses.shear):
        x += near.step_y * gas.scale.aside
        height = ti.cast(gas.edge_y[1], float)
        row = near.step_y + ti.cast(ti.floor((disk.y) / height), ti.i32)
    return x, y, row


@ti.func
def position_in_tile(s, near, region: ti.template(), gas: ti.template()):
    """Position of a listed disk as by `position_from`, wrapped into the box if one region is the box; and box lengths
    by which it was wrapped."""
    x, y, row = position_from(s, near, gas)
    lap_x, lap_y = 0, 0
    if region.wrap_x == 1:
        if x < 0.0:
            x += gas.scale.length_x
            lap_x = -1
        elif x >= gas.scale.length_x:
            x -= gas.scale.length_x
            lap_x = 1
    if region.wrap_y == 1:
        if y < 0.0:
            y += gas.scale.length_y
            lap_y = -1
        elif y >= gas.scale.length_y:
            y -= gas.scale.length_y
            lap_y = 1
    return ti.Struct(x=x, y=y, lap_x=lap_x, lap_y=lap_y, row=row)


def team_of(uses: Uses) -> int:
    """Threads that share the work on a tile on a GPU; its events are run in order by one of them."""
    return TEAM if on_gpu() and not (uses.shear or uses.layers) else 1


@ti.func
def begin(tile, thread, team, gas: ti.template()):
    """Set the halo of a tile, and its sums over a window to 0; if one tile is the whole box, the sums of all tiles.

    A `team` of threads shares the work.
    """
    last = tile
    if gas.grid.single_tile == 1:
        last = gas.grid.tiles_x * gas.grid.tiles_y - 1
    for k in range(tile, last + 1):
        clear(k, thread, team, gas)
    if thread == 0:
        part = 1 - gas.grid.part
        if gas.counter.again == 0:
            decay = ti.static(BLOCK_HALO_DECAY if on_gpu() and gas.uses.blockwise else HALO_DECAY)
            gas.reach[tile].halo_factor = ti.max(decay * gas.reach[tile].halo_factor, 1.0)
        gas.reach[tile].halo = ti.min(gas.scale.usual_halo * gas.reach[tile].halo_factor, gas.scale.most_halo)
        gas.tile[tile].count[part], gas.tile[tile].gathered, gas.tile[tile].n_ghosts = 0, 0, 0
        gas.tile[tile].mark, gas.tile[tile].bad = 0, 0


@ti.func
def clear(tile, thread, team, gas: ti.template()):
    """Set the sums of a tile over a window to 0; a `team` of threads shares the work."""
    for when in range(AT_MOMENT + gas.grid.moments):
        column = thread
        while column < gas.tally.shape[2]:
            gas.tally[tile, when][column] = 0.0
            column += team
    if thread == 0:
        gas.reach[tile].excursion, gas.reach[tile].max_displacement = -ENDLESS, 0.0
        gas.reach[tile].overhang = 0.0


@ti.func
def gather(tile, thread, region: ti.template(), gas: ti.template()):
    """List slots, cells and neighbouring tiles of the disks in a tile and its halo, and count them, also by cell."""
    team = ti.static(team_of(gas.uses))
    part = gas.grid.part
    room = gas.grid.lane_slots
    offset = region.lane * room
    n, own_disks = 0, 0
    halo = gas.reach[tile].halo
    alone = gas.grid.single_tile == 1
    x_low, x_high, y_low, y_high = bounds_of(halo, tile, gas)
    own_x_low, own_x_high, own_y_low, own_y_high = bounds_of(0.0 * halo, tile, gas)
    steps = 9
    if alone:
        steps = gas.grid.tiles_x * gas.grid.tiles_y
    for step in range(steps):
        near = gather_tile(tile, step, gas)
        if near.tile >= 0:
            first = part * gas.grid.room + gas.tile[near.tile].start[part]
            s, end = first + thread, first + gas.tile[near.tile].count[part]
            while s < end:
                x, y, _row = position_from(s, near, gas)
                if alone or lies_in(x, y, x_low, x_high, y_low, y_high):
                    own = alone or lies_in(x, y, own_x_low, own_x_high, own_y_low, own_y_high)
                    if ti.static(team > 1):
                        n = ti.atomic_add(gas.tile[tile].gathered, 1)
                        if own:
                            own_disks = ti.atomic_add(gas.tile[tile].count.other[part], 1)
                        else:
                            own_disks = n - ti.atomic_add(gas.tile[tile].n_ghosts, 1)
                    if n < room:
                        here = position_in_tile(s, near, region, gas)
                        c = cell_at(here.x, here.y, region)
                        gas.candidates[offset + n].slot = s
                        gas.candidates[offset + n].cell = c
                        gas.candidates[offset + n].own_rank = ti.select(own, own_disks + 1, own_disks - n - 1)
                        gas.candidates[offset + n].step = step
                        if ti.static(team > 1):
                            ti.atomic_add(gas.head[region.cells + c], 1)
                        else:
                            gas.head[region.cells + c] = gas.head[region.cells + c] + 1
                    if ti.static(team == 1):
                        n += 1
                        own_disks += ti.cast(own, ti.i32)
                s += team
    if ti.static(team == 1):
        gas.tile[tile].gathered, gas.tile[tile].count.other[part] = n, own_disks
        gas.tile[tile].n_ghosts = n - own_disks


@ti.func
def count_chunk(thread, region: ti.template(), gas: ti.template()):
    """Count the disks in a thread's share of the cells, for `order`: into the bins, which are free until the events."""
    cells = region.nx * region.ny
    chunk = (cells + ti.static(team_of(gas.uses)) - 1) // ti.static(team_of(gas.uses))
    found = 0
    for c in range(thread * chunk, ti.min((thread + 1) * chunk, cells)):
        found += gas.head[region.cells + c]
    gas.bin[region.lane * gas.grid.bins + thread] = found


@ti.func
def order(tile, thread, region: ti.template(), gas: ti.template()):
    """Store where the disks of each cell begin, and where the tile's list and its ghost records do."""
    cells = region.nx * region.ny
    chunk = (cells + ti.static(team_of(gas.uses)) - 1) // ti.static(team_of(gas.uses))
    before = 0
    for other in range(thread):
        before += gas.bin[region.lane * gas.grid.bins + other]
    for c in range(thread * chunk, ti.min((thread + 1) * chunk, cells)):
        here = gas.head[region.cells + c]
        gas.head[region.cells + c] = ti.select(here > 0, before, -1)
        before += here
    if thread == 0:
        reserve(tile, gas)


@ti.func
def reserve(tile, gas: ti.template()):
    """Choose where the tile's list and its ghost records begin: their lengths are known."""
    reserve_list(tile, gas)
    reserve_ghosts(tile, gas)


@ti.func
def reserve_list(tile, gas: ti.template()):
    """Choose where the tile's list begins, unless that was done before, when the window was run first."""
    part = 1 - gas.grid.part
    if gas.counter.again == 0:
        if gas.grid.single_tile == 1:
            for other in range(gas.grid.tiles_x * gas.grid.tiles_y):
                gas.tile[other].start[part] = gas.tile[other].start.other[part]
                gas.tile[other].count[part] = gas.tile[other].count.other[part]
        else:
            gas.tile[tile].start[part] = ti.atomic_add(gas.counter.n_slots, gas.tile[tile].count[part])


@ti.func
def reserve_ghosts(tile, gas: ti.template()):
    """Choose where the ghost records of a tile begin."""
    ghosts = gas.tile[tile].n_ghosts
    if ghosts > 0:
        g = ti.atomic_add(gas.counter.n_ghosts, ghosts)
        gas.tile[tile].ghosts = g
        if g + ghosts > gas.grid.most_ghosts:
            ti.atomic_or(gas.counter.full, FULL_GHOSTS)


@ti.func
def slot_of(m, region: ti.template(), gas: ti.template()):
    """The slot of candidate m among those that are sorted by cell: the next one of its cell."""
    cell = region.cells + gas.candidates[region.lane * gas.grid.lane_slots + m].cell
    i = region.lane * gas.grid.lane_slots
    if ti.static(on_gpu()):
        i += ti.atomic_add(gas.head[cell], 1)
    else:
        i += gas.head[cell]
        gas.head[cell] = gas.head[cell] + 1
    return i


@ti.func
def load(m, i, tile, region: ti.template(), gas: ti.template()):
    """Load candidate m into slot i."""
    step = gas.candidates[region.lane * gas.grid.lane_slots + m].step
    load_from(gather_tile(tile, step, gas), m, i, tile, region, gas)


@ti.func
def load_from(near, m, i, tile, region: ti.template(), gas: ti.template()):
    """Load candidate m into slot i, from the tile that `gather_tile` describes so.

    Everything is read before the first number is written, as in `events.collide`.
    """
    part = gas.grid.part
    chosen = gas.candidates[region.lane * gas.grid.lane_slots + m]
    s, c, rank, step = chosen.slot, chosen.cell, chosen.own_rank, chosen.step
    here = position_in_tile(s, near, region, gas)
    x, y, row = here.x, here.y, here.row
    vx, vy, spin = gas.disk[s].vx, gas.disk[s].vy, gas.disk[s].spin
    disk_id, events, kind = gas.meta[s].id, gas.meta[s].events, listed_kind(s, gas)
    slot, cx = s - part * gas.grid.room, c // region.ny
    info, motion, image = gas.event_info[i], gas.motion[i], gas.image_info[i]
    image.step, image.slot = step, slot
    info.id, info.own_rank, info.shear_row = disk_id, rank, row
    image.lap_x, image.lap_y = here.lap_x - near.boxes_x, here.lap_y - near.boxes_y
    image.wall_collisions, image.events_before = 0, events
    if ti.static(gas.uses.several_kinds):
        info.kind = kind
    if ti.static(gas.uses.latest_collision):
        gas.since[i] = ti.cast(gas.past[s].latest, float)
    if ti.static(gas.uses.angle):
        gas.turn[i] = 0.0
    if ti.static(gas.uses.dissipated):
        for column in ti.static(range(MECHANISM.width)):
            gas.loss[i][column] = 0.0
    if ti.static(gas.uses.rest):
        gas.rest[i].asleep, gas.rest[i].may_rest, gas.rest[i].hits = gas.asleep[s], 0, 0
        for column in ti.static(range(HELD.width)):
            gas.cached_force[i][column] = gas.held[s][column]
    if ti.static(gas.uses.shear):
        # Into the frame of the row that it is in now.
        crossed = row - near.step_y
        if crossed != 0:
            faster = crossed * gas.scale.drift
            if rank > 0:
                work = ti.cast(faster * (0.5 * faster - vx), ti.f64)
                add(tile, TALLY.flow_work, work / gas.kinds[kind].inverse_mass, gas)
            vx -= faster
        x -= row * gas.scale.aside
    motion.x, motion.y, motion.vx, motion.vy, motion.tau, motion.spin = x, y, vx, vy, 0.0, spin
    info.hash_1, info.hash_2, info.max_speed_sq = 0, 0, speed_square(vx, vy)
    info.last, info.number, info.previous = NO_PARTNER, 0, -1
    info.cell = (cx << 16) + c - cx * region.ny
    if ti.static(gas.uses.actions):
        begin_actions(i, gas)


@ti.func
def word_of(i, following):
    """The word by which a list of a cell points to the disk in slot i, with the word that follows it or -1: `MORE`."""
    return i + ti.select(following < 0, 0, MORE)


@ti.func
def link_cells(i, n, region: ti.template(), gas: ti.template()):
    """Link the disk in slot i, of n that are loaded, with the next one in its cell, or its cell with it."""
    offset = region.lane * gas.grid.lane_slots
    cell = gas.event_info[i].cell
    following = -1
    if i + 1 < offset + n:
        if gas.event_info[i + 1].cell == cell:
            following = i + 1
            if i + 2 < offset + n:
                if gas.event_info[i + 2].cell == cell:
                    following += MORE
    gas.event_info[i].next_in_cell = following
    is_first = i == offset
    if not is_first:
        is_first = gas.event_info[i - 1].cell != cell
    if is_first:
        gas.head[region.cells + (cell >> 16) * region.ny + (cell & 0xFFFF)] = word_of(i, following)


@ti.func
def link_cells_of_layers(n, region: ti.template(), gas: ti.template()):
    """Link all of n disks with the next one in their cells, where there are two layers of cells."""
    for c in range(cells_of(region, gas)):
        gas.head[region.cells + c] = -1
    offset = region.lane * gas.grid.lane_slots
    for i in range(offset, offset + n):
        info = gas.event_info[i]
        layer = layer_of(i, gas)
        _nx, _ny, factor = scale_of(layer, region, gas)
        cx, cy = (info.cell >> 16) // factor, (info.cell & 0xFFFF) // factor
        info.cell = (cx << 16) + cy
        at = head_at(cx, cy, layer, region, gas)
        info.next_in_cell = gas.head[at]
        gas.head[at] = word_of(i, info.next_in_cell)


@ti.func
def inside(x, y, tile, gas: ti.template()):
    """Distance of a position from the sides of its tile; negative outside. Open ends of the box are no sides."""
    tx, ty = place_of(tile, gas)
    width, height = sides_of(tile, gas)
    left, right, below, above = x, width - x, y, height - y
    if gas.grid.periodic_x == 0:
        left = ti.select(tx == 0, ENDLESS, left)
        right = ti.select(tx == gas.grid.tiles_x - 1, ENDLESS, right)
    if gas.grid.periodic_y == 0:
        below = ti.select(ty == 0, ENDLESS, below)
        above = ti.select(ty == gas.grid.tiles_y - 1, ENDLESS, above)
    return ti.min(ti.min(left, right), ti.min(below, above))


@ti.func
def last_hit(i, gas: ti.template()):
    """Slot, position and boxes travelled of the own disk in lane slot i at its latest collision.

    The slot is counted from the tile's first, the position is from the corner of the tile that will list it.
    """
    image = gas.image_info[i]
    x, y = gas.motion[i].x, gas.motion[i].y
    slot, lap_x, lap_y = gas.event_info[i].own_rank - 1, image.lap_x, image.lap_y
    if gas.grid.single_tile == 1 and gas.grid.tiles_x * gas.grid.tiles_y > 1:  # the lists stay as they are
        slot = image.slot
        listed = image.step
        x += lap_x * gas.scale.length_x
        y += lap_y * gas.scale.length_y
        x -= ti.cast(gas.edge_x[listed // gas.grid.tiles_y] - gas.edge_x[0], float)
        y -= ti.cast(gas.edge_y[listed % gas.grid.tiles_y] - gas.edge_y[0], float)
        lap_x, lap_y = 0, 0
    return ti.Struct(slot=slot, x=x, y=y, lap_x=lap_x, lap_y=lap_y)


@ti.func
def store(i, row, dt, x, y, vx, vy, lap_x, lap_y, gas: ti.template()):
    """Write the disk in slot i into a row of the state, with this position and velocity, dt after its latest event."""
    info, disk_row, meta_row = gas.event_info[i], gas.disk[row], gas.meta[row]
    s = gas.grid.part * gas.grid.room + gas.image_info[i].slot
    spin, disk_id, events = gas.motion[i].spin, info.id, gas.meta[s].events + collisions_in_window(i, gas)
    image_x, image_y = gas.meta[s].image_x + lap_x, gas.meta[s].image_y + lap_y
    disk_row.x, disk_row.y, disk_row.vx, disk_row.vy, disk_row.spin = x, y, vx, vy, spin
    meta_row.id, meta_row.events, meta_row.image_x, meta_row.image_y = disk_id, events, image_x, image_y
    if ti.static(gas.uses.several_kinds and gas.uses.ranks):
        gas.kind[row] = info.kind
    if ti.static(gas.uses.latest_collision):
        gas.past[row].latest = ti.cast(gas.since[i], ti.f64)
    if ti.static(gas.uses.rest):
        gas.asleep[row] = gas.rest[i].asleep
        for column in ti.static(range(HELD.width)):
            gas.held[row][column] = gas.cached_force[i][column]
    if ti.static(gas.uses.angle):
        angle = gas.past[s].angle + gas.turn[i]
        gas.past[row].angle = angle + ti.cast(spin, ti.f64) * ti.cast(dt, ti.f64)
    if ti.static(gas.uses.dissipated):
        for column in ti.static(range(MECHANISM.width)):
            gas.dissipated[row][column] = gas.dissipated[s][column] + gas.loss[i][column]
    if ti.static(gas.uses.walls):
        gas.hits[row].wall_collisions = gas.hits[s].wall_collisions + gas.image_info[i].wall_collisions
    if ti.static(gas.uses.last_partner):
        partner = gas.hits[s].last_partner
        last = latest_partner(i, gas)
        if last >= 0:
            partner = gas.event_info[last].id
        elif last <= FIRST_WALL:
            partner = -2 - (FIRST_WALL - last)
        gas.hits[row].last_partner = partner


@ti.func
def fly(x, y, vx, vy, dt, time, fall_x, fall_y, gas: ti.template()):
    """Position, on the grid, and velocity after a flight for dt to a time since the window's beginning."""
    new_x = x + on_grid(vx * dt + 0.5 * fall_x * time, gas)
    new_y = y + on_grid(vy * dt + 0.5 * fall_y * time, gas)
    return new_x, new_y, vx + fall_x, vy + fall_y


@ti.func
def write(n, tile, when, thread, team, region: ti.template(), gas: ti.template()):
    """Write own disks to their slots, as they are at the window's end, or at a requested moment.

    At the end, where a window begins next, histories and ghost records are written. A `team` of threads shares the n
    disks. Returns what `note_extremes` takes, of the thread's share: the greatest square of a speed, sums of squares of
    speeds [`clock.square_unit`] and of numbers of events, the greatest excursion, displacement and overhang [length].
    """
    offset = region.lane * gas.grid.lane_slots
    base = gas.tile[tile].start.other[gas.grid.part]
    part = 1 - gas.grid.part
    time = gas.scale.stored_at
    if when >= AT_MOMENT:
        m = when - AT_MOMENT
        part = SNAPSHOT + m
        time = gas.scale.moment[m]
        if thread == 0:
            for column in range(gas.tally.shape[2]):
                gas.tally[tile, when][column] = gas.tally[tile, AT_END][column]
    if ti.static(gas.uses.pistons):
        write_pistons(tile, when, time, gas)
    fall_x, fall_y = gas.scale.gx * time, gas.scale.gy * time
    excursion, max_displacement = -ENDLESS + 0.0 * time, 0.0 * time
    fastest, squares, event_squares = 0.0 * time, ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
    in_place = gas.grid.single_tile == 1 and gas.grid.tiles_x * gas.grid.tiles_y > 1
    overhang = 0.0 * time
    i = offset + thread
    while i < offset + n:
        info, image, motion = gas.event_info[i], gas.image_info[i], gas.motion[i]
        displacement = largest_speed(i, gas) * time
        # Read before the first number is written, as in `events.collide` and `store`.
        rank, hash_1, hash_2, upper = info.own_rank, info.hash_1, info.hash_2, info.max_speed_sq
        slot_before, step = image.slot, image.step
        if rank > 0:
            hit = last_hit(i, gas)
            slot = hit.slot
            if not in_place:
                slot += base
            if ti.static(gas.uses.rest):
                fall_x, fall_y = gas.scale.gx * time, gas.scale.gy * time
                if gas.rest[i].asleep == ASLEEP:
                    fall_x, fall_y = 0.0 * time, 0.0 * time
            dt = time - motion.tau
            x, y, vx, vy = fly(hit.x, hit.y, motion.vx, motion.vy, dt, time, fall_x, fall_y, gas)
            row = part * gas.grid.room + slot
            store(i, row, dt, x, y, vx, vy, hit.lap_x, hit.lap_y, gas)
            if when == AT_END:
                gas.history_hash[slot_before].hash_1, gas.history_hash[slot_before].hash_2 = hash_1, hash_2
                gas.displacement[slot_before] = ti.cast(1.000001 * displacement / gas.scale.widest, ti.f32)
                gas.slot_before[slot] = slot_before
                max_displacement = ti.max(max_displacement, displacement)
                listed = tile
                if in_place:
                    listed = step
                excursion = ti.max(
                    excursion,
                    displacement - inside(x - 0.5 * fall_x * time, y - 0.5 * fall_y * time, listed, gas),
                )
                overhang = ti.max(overhang, -inside(x, y, listed, gas))
                speed2 = vx * vx + vy * vy
                fastest = ti.max(fastest, speed2)
                squares += ti.floor(ti.cast(speed2, ti.f64) / gas.clock.square_unit)
                events = ti.cast(collisions_in_window(i, gas), ti.f64)
                event_squares += events * events
                if ti.static(gas.uses.latest_collision):
                    gas.past[row].latest = ti.cast(gas.since[i], ti.f64) - ti.cast(time, ti.f64)
        elif when == AT_END:
            g = gas.tile[tile].ghosts - rank - 1
            gas.ghost[g].place = slot_before | (step << GHOST_STEP)
            gas.ghost[g].hash_1, gas.ghost[g].hash_2, gas.ghost[g].max_speed_sq = hash_1, hash_2, upper
        i += team
    return ti.Struct(
        fastest=fastest, squares=squares, event_squares=event_squares, excursion=excursion,
        max_displacement=max_displacement, overhang=overhang,
    )  # fmt: skip


@ti.func
def note_extremes(tile, share: ti.template(), gas: ti.template()):
    """Enter what `write` returns at a window's end into the sums of a tile and its bounds."""
    ti.atomic_max(gas.tally[tile, AT_END].fastest, ti.cast(share.fastest, ti.f64))
    # Whole numbers: exact in any order.
    ti.atomic_add(gas.tally[tile, AT_END].squares, share.squares)
    ti.atomic_add(gas.tally[tile, AT_END].event_squares, share.event_squares)
    ti.atomic_max(gas.reach[tile].excursion, share.excursion)
    ti.atomic_max(gas.reach[tile].max_displacement, share.max_displacement)
    ti.atomic_max(gas.reach[tile].overhang, share.overhang)


@ti.func
def displacement_bound(slot, gas: ti.template()):
    """Bound on the displacement of the disk at a slot in the window [length]."""
    return ti.cast(gas.displacement[slot], float) * gas.scale.widest


@ti.func
def slot_of_ghost(g, gas: ti.template()):
    """Slot, at the window's beginning, of the disk of a ghost record."""
    return gas.ghost[g].place & ti.static((1 << GHOST_STEP) - 1)


@ti.func
def may_touch(g, tile, gas: ti.template()):
    """1 if the disk of a ghost record, or its copy, may have touched an own disk of the tile that made it, else 0.

    The path of either lies in a circle around its first position, that of an own disk in one around its last position,
    with its displacement as the radius.
    """
    slot, step = slot_of_ghost(g, gas), gas.ghost[g].place >> GHOST_STEP
    x, y, row = position_from(gas.grid.part * gas.grid.room + slot, gather_tile(tile, step, gas), gas)
    speed = ti.cast(ti.sqrt(square_of(gas.ghost[g].max_speed_sq)), float)
    if ti.static(gas.uses.shear):
        speed += ti.abs(row * gas.scale.drift)
    displacement = ti.max(speed * gas.scale.window, displacement_bound(slot, gas)) + gas.scale.widest
    if ti.static(gas.uses.shear):
        displacement += ti.abs(gas.scale.drift) * gas.scale.window
    found = 0
    if -inside(x, y, tile, gas) <= displacement + gas.reach[tile].excursion:
        part = 1 - gas.grid.part
        fall_x = 0.5 * gas.scale.gx * gas.scale.window * gas.scale.window
        fall_y = 0.5 * gas.scale.gy * gas.scale.window * gas.scale.window
        k, end = gas.tile[tile].start[part], gas.tile[tile].start[part] + gas.tile[tile].count[part]
        while k < end:
            s = part * gas.grid.room + k
            dx, dy = gas.disk[s].x - fall_x - x, gas.disk[s].y - fall_y - y
            both = displacement + displacement_bound(gas.slot_before[k], gas)
            k += 1
            if dx * dx + dy * dy <= both * both:
                found, k = 1, end
    return found


@ti.func
def is_too_narrow(tile, gas: ti.template()):
    """1 if the halo of a tile may lack disks that touched its own disks (1 above), else 0."""
    max_displacement = 0.0 * gas.scale.window
    for step_x in range(-1, 2):
        for step_y in range(-1, 2):
            other = neighbor_tile(tile, step_x, step_y, gas).tile
            if other >= 0 and (step_x != 0 or step_y != 0):
                max_displacement = ti.max(max_displacement, gas.reach[other].max_displacement)
    if ti.static(gas.uses.shear):
        max_displacement += ti.abs(gas.scale.drift) * gas.scale.window
    needed = gas.scale.widest + ti.max(gas.reach[tile].excursion, 0.0) + max_displacement
    return ti.cast(gas.reach[tile].halo < needed, ti.i32)


@ti.func
def is_wrong(tile, thread, gas: ti.template()):
    """1 if a ghost record of a tile that this thread of its team tests may make its window inexact (2 above)."""
    invalid = 0
    g, end = gas.tile[tile].ghosts + thread, gas.tile[tile].ghosts + gas.tile[tile].n_ghosts
    while g < end and invalid == 0:
        s = slot_of_ghost(g, gas)
        if (
            gas.ghost[g].hash_1 != gas.history_hash[s].hash_1
            or gas.ghost[g].hash_2 != gas.history_hash[s].hash_2
        ):
            invalid = may_touch(g, tile, gas)
        g += ti.static(team_of(gas.uses))
    return invalid
