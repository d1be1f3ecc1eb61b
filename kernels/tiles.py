"""Tiles with halos: who is gathered for a window, what is written at its end, and the test that it is exact.

*Gather.* A tile takes all disks that lie in it (its own) or within its halo, from its list and those of the eight tiles
around it. Disks have flown since they were listed, at most over the sides of their tile. A tile owns a disk for a
window because that begins there.

*Write.* Own disks go into the tile's new list. For each, the hash of its history (times and partners) and a bound on
its way are noted; for each copy of another tile's disk a *claim*: the hash of the history that the copy had here.

*Verify.* A tile is good if

1. its halo is as wide as the largest diameter, as its own disks came beyond its sides, and as any disk around came at
   all: whoever was not gathered did not matter;
2. of each copy with another history than the disk had in its own tile, neither the disk nor the copy can have come into
   touch with an own disk: circles around their first places with their ways as radii do not meet.

Proof. Suppose all tiles are good, and let t be the first time at which the histories that tiles found for their own
disks leave the true motion. Then an own disk i meets, or misses, some k wrongly at t. Until t, i and k moved truly, so
by 1 there is a copy of k in the tile of i, and it or k came into touch with i, so by 2 the copy has the history that k
has in its own tile, which is true before t. The tile of i then computed the meeting from true motions: a contradiction.

Bad tiles are run again, from the same beginning, with wider halos. Nothing is ever undone.
"""

from .flights import on_grid
from .language import on_gpu, ti
from .layout import (
    AGAIN, ALONE, ANGLE, ASIDE, ASLEEP, ASLEEP_NOW, AT_END, AT_MOMENT, AT_WALLS, BEFORE, BEYOND, BINS,
    BOXES_ASIDE, CELL, CELLS, CELL_SIDE, CLAIMS, COARSE, COUNT, DRIFT, EVENTS, FASTEST, FIRST_WALL, FLOW_WORK, FULL,
    FULL_CLAIMS, FURTHEST, GATHERED, GX, GY, HALO, HASH_1, HASH_2, HELD, ID, IMAGE_X, IMAGE_Y, INVERSE_MASS,
    KIND, LAP_X, LAP_Y, LAST, LAST_PARTNER, LATEST, LENGTH_X, LENGTH_Y, LISTED, MOMENTS, MOMENT_IN, MECHANISMS,
    MOST_CLAIMS, HITS_NOW, MAY_REST, MOST_HALO, NARROWER, NEXT_IN_CELL, NOBODY, NOTED, NOTES, NUMBER,
    N_CLAIMED, N_CLAIMS, N_NOTED, N_SLOTS, OF_HELD, OWN, PART, PARTNER, PERIODIC_X, PERIODIC_Y, PLACES, PREVIOUS,
    PROTRUDES, ROOM, ROW, SLOT, SPIN, SPLIT, SQUARES, SQUARE_UNIT, START, TAU, TEAM, TILES_ASIDE, TILES_X,
    TILES_Y, TOLD, TOP, USUAL_HALO, VX, VY, WALL_HITS, WHO, WIDER, WIDEST, WINDOW, W_SPIN, Uses, X, Y,
)  # fmt: skip
from .places import add, kind_of, largest_speed, listed_kind, note_speed, radius_of
from .walls import write_pistons

ENDLESS = 1.0e30  # a side of a tile at an end of the box that is no periodic side


@ti.func
def beside(index, count, periodic):
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
    tx = tile // gas.grid[TILES_Y]
    ty = tile - tx * gas.grid[TILES_Y]
    return (
        ti.cast(gas.edge_x[tx + 1] - gas.edge_x[tx], float),
        ti.cast(gas.edge_y[ty + 1] - gas.edge_y[ty], float),
    )


@ti.func
def lies_in(x, y, margin, tile, gas: ti.template()):
    """1 if a place (from the tile's corner) is in the tile or within a margin of it, where ends have no end; else 0."""
    tx = tile // gas.grid[TILES_Y]
    ty = tile - tx * gas.grid[TILES_Y]
    width, height = sides_of(tile, gas)
    low_x = gas.grid[PERIODIC_X] == 0 and tx == 0
    high_x = gas.grid[PERIODIC_X] == 0 and tx == gas.grid[TILES_X] - 1
    low_y = gas.grid[PERIODIC_Y] == 0 and ty == 0
    high_y = gas.grid[PERIODIC_Y] == 0 and ty == gas.grid[TILES_Y] - 1
    inside_x = (low_x or x >= -margin) and (high_x or x < width + margin)
    inside_y = (low_y or y >= -margin) and (high_y or y < height + margin)
    return inside_x and inside_y


@ti.func
def cell_at(x, y, region: ti.template()):
    """Cell of a place; those at the ends of the region have no end."""
    cx = ti.cast(ti.floor((x - region.x) / region.side_x), ti.i32)
    cy = ti.cast(ti.floor((y - region.y) / region.side_y), ti.i32)
    cx = ti.min(ti.max(cx, 0), region.nx - 1)
    cy = ti.min(ti.max(cy, 0), region.ny - 1)
    return cx * region.ny + cy


@ti.func
def cells_of(region: ti.template(), gas: ti.template()):
    """Number of cells of a region; small ones first, then large ones, where there are two layers."""
    cells = region.nx * region.ny
    if ti.static(gas.uses.layered):
        cells += (region.nx // region.coarse) * (region.ny // region.coarse)
    return cells


@ti.func
def layer_of(i, gas: ti.template()):
    """1 if the disk at place i lies in a large cell, else 0."""
    layer = 0
    if ti.static(gas.uses.layered):
        layer = ti.cast(radius_of(i, gas) > gas.scale[SPLIT], ti.i32)
    return layer


@ti.func
def scale_of(layer, region: ti.template(), gas: ti.template()):
    """Cells of a layer along the region in x and y; small cells along one of them."""
    factor = 1
    nx, ny = region.nx, region.ny
    if ti.static(gas.uses.layered):
        if layer == 1:
            factor = region.coarse
            nx, ny = nx // factor, ny // factor
    return nx, ny, factor


@ti.func
def head_at(cx, cy, layer, region: ti.template(), gas: ti.template()):
    """Place in `head` of the first disk in a cell of a layer."""
    cell = region.cells + cx * region.ny + cy
    if ti.static(gas.uses.layered):
        if layer == 1:
            cell = region.cells + region.nx * region.ny + cx * (region.ny // region.coarse) + cy
    return cell


@ti.func
def region_of(tile, lane, gas: ti.template()):
    """Cells of the tile and its halo, or of the whole box: corner, number, sides; places are from the tile's corner."""
    width, height = sides_of(tile, gas)
    halo = gas.reach[tile, HALO]
    wrap_x, wrap_y = 0, 0
    if gas.grid[ALONE] == 1:
        halo = 0.0 * halo
        wrap_x, wrap_y = gas.grid[PERIODIC_X], gas.grid[PERIODIC_Y]
        width, height = gas.scale[LENGTH_X], gas.scale[LENGTH_Y]
    width += 2.0 * halo
    height += 2.0 * halo
    coarse = 1
    if ti.static(gas.uses.layered):
        coarse = gas.grid[COARSE]
    nx = coarse * ti.max(ti.cast(width / (coarse * gas.scale[CELL_SIDE]), ti.i32), 1)
    ny = coarse * ti.max(ti.cast(height / (coarse * gas.scale[CELL_SIDE]), ti.i32), 1)
    tx = tile // gas.grid[TILES_Y]
    ty = tile - tx * gas.grid[TILES_Y]
    return ti.Struct(
        x=-halo, y=-halo, nx=nx, ny=ny, side_x=width / nx, side_y=height / ny, wrap_x=wrap_x, wrap_y=wrap_y,
        cells=lane * gas.grid[CELLS], lane=lane, coarse=coarse,
        corner_x=ti.cast(gas.edge_x[tx], float), corner_y=ti.cast(gas.edge_y[ty], float),
    )  # fmt: skip


@ti.func
def neighbour(tile, step_x, step_y, gas: ti.template()):
    """The tile so many columns and rows away, or -1; how far its corner is; how many boxes it is away.

    Exact: corners and lengths are on the grid. In a sheared gas all tiles are alike, and rows above have moved on by
    TILES_ASIDE tiles (and by ASIDE, which is not in this).
    """
    tx = tile // gas.grid[TILES_Y]
    ty = tile - tx * gas.grid[TILES_Y]
    ax = tx + step_x
    if ti.static(gas.uses.sheared):
        ax -= step_y * gas.grid[TILES_ASIDE]
    bx, boxes_x = beside(ax, gas.grid[TILES_X], gas.grid[PERIODIC_X])
    by, boxes_y = beside(ty + step_y, gas.grid[TILES_Y], gas.grid[PERIODIC_Y])
    other = -1
    shift_x, shift_y = 0.0 * gas.scale[WINDOW], 0.0 * gas.scale[WINDOW]
    if bx >= 0 and by >= 0:
        other = bx * gas.grid[TILES_Y] + by
        far_x = gas.edge_x[bx] - gas.edge_x[tx] + boxes_x * gas.edge_x[gas.grid[TILES_X]]
        far_y = gas.edge_y[by] - gas.edge_y[ty] + boxes_y * gas.edge_y[gas.grid[TILES_Y]]
        if ti.static(gas.uses.sheared):
            far_x += step_y * gas.grid[TILES_ASIDE] * gas.edge_x[1]
        shift_x, shift_y = ti.cast(far_x, float), ti.cast(far_y, float)
    if ti.static(gas.uses.sheared):
        boxes_x -= step_y * gas.grid[BOXES_ASIDE]
    return other, shift_x, shift_y, boxes_x, boxes_y


@ti.func
def source(tile, step, gas: ti.template()):
    """One of the tiles that a tile gathers from, as `neighbour` tells it, and how many rows up it is.

    The nine around it, or all where one region is the whole box.
    """
    other, step_y, boxes_x, boxes_y = step, 0, 0, 0
    shift_x, shift_y = 0.0 * gas.scale[WINDOW], 0.0 * gas.scale[WINDOW]
    if gas.grid[ALONE] == 1:
        shift_x = ti.cast(gas.edge_x[step // gas.grid[TILES_Y]] - gas.edge_x[0], float)
        shift_y = ti.cast(gas.edge_y[step % gas.grid[TILES_Y]] - gas.edge_y[0], float)
    else:
        step_y = step % 3 - 1
        other, shift_x, shift_y, boxes_x, boxes_y = neighbour(tile, step // 3 - 1, step_y, gas)
    return other, step_y, shift_x, shift_y, boxes_x, boxes_y


@ti.func
def seen(s, step_y, shift_x, shift_y, region: ti.template(), gas: ti.template()):
    """Place of a listed disk from the corner of the tile that gathers, boxes that it went round, its row of tiles."""
    x, y = gas.disk[s][X] + shift_x, gas.disk[s][Y] + shift_y
    lap_x, lap_y, row = 0, 0, 0
    if ti.static(gas.uses.sheared):
        x += step_y * gas.scale[ASIDE]
        height = ti.cast(gas.edge_y[1], float)
        row = step_y + ti.cast(ti.floor((gas.disk[s][Y]) / height), ti.i32)
    if region.wrap_x == 1:
        if x < 0.0:
            x += gas.scale[LENGTH_X]
            lap_x = -1
        elif x >= gas.scale[LENGTH_X]:
            x -= gas.scale[LENGTH_X]
            lap_x = 1
    if region.wrap_y == 1:
        if y < 0.0:
            y += gas.scale[LENGTH_Y]
            lap_y = -1
        elif y >= gas.scale[LENGTH_Y]:
            y -= gas.scale[LENGTH_Y]
            lap_y = 1
    return x, y, lap_x, lap_y, row


def team_of(uses: Uses) -> int:
    """Threads that share the work on a tile, but for its events, which one of them runs in order: on a GPU."""
    return TEAM if on_gpu() and not (uses.sheared or uses.layered) else 1


@ti.func
def begin(tile, gas: ti.template()):
    """Set the halo of a tile, and all that is counted in a window to nothing; of all, where one is the whole box."""
    part = 1 - gas.grid[PART]
    last = tile
    if gas.grid[ALONE] == 1:
        last = gas.grid[TILES_X] * gas.grid[TILES_Y] - 1
    for k in range(tile, last + 1):
        gas.tile[k, NOTED] = gas.counter[N_NOTED]
        for when in range(AT_MOMENT + gas.grid[MOMENTS]):
            for column in range(gas.tally.shape[2]):
                gas.tally[k, when, column] = 0.0
        gas.reach[k, BEYOND], gas.reach[k, FURTHEST], gas.reach[k, PROTRUDES] = -ENDLESS, 0.0, 0.0
    if gas.counter[AGAIN] == 0:
        gas.reach[tile, WIDER] = ti.max(NARROWER * gas.reach[tile, WIDER], 1.0)
    gas.reach[tile, HALO] = ti.min(gas.scale[USUAL_HALO] * gas.reach[tile, WIDER], gas.scale[MOST_HALO])
    gas.tile[tile, COUNT + part], gas.tile[tile, GATHERED], gas.tile[tile, N_CLAIMS] = 0, 0, 0


@ti.func
def choose(tile, thread, region: ti.template(), gas: ti.template()):
    """Note slots, cells and neighbouring tiles of the disks in a tile and its halo, and count them, by cell too."""
    team = ti.static(team_of(gas.uses))
    part = gas.grid[PART]
    room = gas.grid[PLACES]
    places = region.lane * room
    n, own_disks = 0, 0
    halo = gas.reach[tile, HALO]
    alone = gas.grid[ALONE] == 1
    steps = 9
    if alone:
        steps = gas.grid[TILES_X] * gas.grid[TILES_Y]
    for step in range(steps):
        other, step_y, shift_x, shift_y, _boxes_x, _boxes_y = source(tile, step, gas)
        if other >= 0:
            first = part * gas.grid[ROOM] + gas.tile[other, START + part]
            s, end = first + thread, first + gas.tile[other, COUNT + part]
            while s < end:
                x, y, _lap_x, _lap_y, _row = seen(s, step_y, shift_x, shift_y, region, gas)
                near = alone or lies_in(x, y, halo, tile, gas)
                if near:
                    own = alone or lies_in(x, y, 0.0 * x, tile, gas)
                    if ti.static(team > 1):
                        n = ti.atomic_add(gas.tile[tile, GATHERED], 1)
                        if own:
                            own_disks = ti.atomic_add(gas.tile[tile, COUNT + 1 - part], 1)
                        else:
                            own_disks = n - ti.atomic_add(gas.tile[tile, N_CLAIMS], 1)
                    if n < room:
                        c = cell_at(x, y, region)
                        gas.chosen[places + n][0] = s
                        gas.chosen[places + n][1] = c
                        gas.chosen[places + n][2] = ti.select(own, own_disks + 1, own_disks - n - 1)
                        gas.chosen[places + n][3] = step
                        if ti.static(team > 1):
                            ti.atomic_add(gas.head[region.cells + c], 1)
                        else:
                            gas.head[region.cells + c] = gas.head[region.cells + c] + 1
                    if ti.static(team == 1):
                        n += 1
                        own_disks += ti.cast(own, ti.i32)
                s += team
    if ti.static(team == 1):
        gas.tile[tile, GATHERED], gas.tile[tile, COUNT + 1 - part] = n, own_disks
        gas.tile[tile, N_CLAIMS] = n - own_disks


@ti.func
def count_chunk(thread, region: ti.template(), gas: ti.template()):
    """Count the disks in a thread's share of the cells, for `order`: into the bins, which are free until the events."""
    cells = region.nx * region.ny
    chunk = (cells + ti.static(team_of(gas.uses)) - 1) // ti.static(team_of(gas.uses))
    found = 0
    for c in range(thread * chunk, ti.min((thread + 1) * chunk, cells)):
        found += gas.head[region.cells + c]
    gas.bin[region.lane * gas.grid[BINS] + thread] = found


@ti.func
def order(tile, thread, region: ti.template(), gas: ti.template()):
    """Say where the disks of each cell begin, and where the tile's list and its claims do."""
    part = 1 - gas.grid[PART]
    cells = region.nx * region.ny
    chunk = (cells + ti.static(team_of(gas.uses)) - 1) // ti.static(team_of(gas.uses))
    before = 0
    for other in range(thread):
        before += gas.bin[region.lane * gas.grid[BINS] + other]
    for c in range(thread * chunk, ti.min((thread + 1) * chunk, cells)):
        here = gas.head[region.cells + c]
        gas.head[region.cells + c] = ti.select(here > 0, before, -1)
        before += here
    if thread == 0:
        if gas.counter[AGAIN] == 0:
            if gas.grid[ALONE] == 1:
                for other in range(gas.grid[TILES_X] * gas.grid[TILES_Y]):
                    gas.tile[other, START + part] = gas.tile[other, START + 1 - part]
                    gas.tile[other, COUNT + part] = gas.tile[other, COUNT + 1 - part]
            else:
                gas.tile[tile, START + part] = ti.atomic_add(
                    gas.counter[N_SLOTS], gas.tile[tile, COUNT + part]
                )
        claims = gas.tile[tile, N_CLAIMS]
        if claims > 0:
            claim = ti.atomic_add(gas.counter[N_CLAIMED], claims)
            gas.tile[tile, CLAIMS] = claim
            if claim + claims > gas.grid[MOST_CLAIMS]:
                ti.atomic_or(gas.counter[FULL], FULL_CLAIMS)


@ti.func
def lay(m, tile, region: ti.template(), gas: ti.template()):
    """Lay out the disk that was chosen as number m in the lane's places, which are sorted by cell."""
    part = gas.grid[PART]
    places = region.lane * gas.grid[PLACES]
    s, c, rank, step = (
        gas.chosen[places + m][0], gas.chosen[places + m][1], gas.chosen[places + m][2], gas.chosen[places + m][3],
    )  # fmt: skip
    i = places
    if ti.static(team_of(gas.uses) > 1):
        i += ti.atomic_add(gas.head[region.cells + c], 1)
    else:
        i += gas.head[region.cells + c]
        gas.head[region.cells + c] = gas.head[region.cells + c] + 1
    other, step_y, shift_x, shift_y, boxes_x, boxes_y = source(tile, step, gas)
    x, y, lap_x, lap_y, row = seen(s, step_y, shift_x, shift_y, region, gas)
    vx, vy = gas.disk[s][VX], gas.disk[s][VY]
    gas.mark[i][LISTED] = other
    gas.mark[i][SLOT] = s - part * gas.grid[ROOM]
    gas.link[i][WHO] = gas.meta[s][ID]
    gas.link[i][OWN] = rank
    gas.mark[i][LAP_X], gas.mark[i][LAP_Y] = lap_x - boxes_x, lap_y - boxes_y
    gas.link[i][ROW] = row
    gas.mark[i][AT_WALLS] = 0
    gas.mark[i][BEFORE] = gas.meta[s][EVENTS]
    if ti.static(gas.uses.mixed):
        gas.link[i][KIND] = listed_kind(s, gas)
    if ti.static(gas.uses.remembers):
        gas.since[i] = ti.cast(gas.past[s][LATEST], float)
    if ti.static(gas.uses.turned):
        gas.turn[i] = 0.0
    if ti.static(gas.uses.itemised):
        for column in ti.static(range(MECHANISMS)):
            gas.loss[i][column] = 0.0
    if ti.static(gas.uses.rests):
        gas.rest[i][ASLEEP_NOW], gas.rest[i][MAY_REST], gas.rest[i][HITS_NOW] = gas.slept[s], 0, 0
        for column in ti.static(range(HELD * OF_HELD)):
            gas.grip[i][column] = gas.held[s][column]
    if ti.static(gas.uses.sheared):
        # Into the frame of the row that it is in now.
        crossed = row - step_y
        if crossed != 0:
            faster = crossed * gas.scale[DRIFT]
            if rank > 0:
                work = ti.cast(faster * (0.5 * faster - vx), ti.f64)
                kind = kind_of(i, gas)
                add(tile, FLOW_WORK, work / gas.kinds[kind][INVERSE_MASS], gas)
            vx -= faster
        x -= row * gas.scale[ASIDE]
    gas.work[i][X], gas.work[i][Y], gas.work[i][VX], gas.work[i][VY] = x, y, vx, vy
    gas.work[i][TAU] = 0.0
    gas.work[i][W_SPIN] = gas.disk[s][SPIN]
    gas.link[i][HASH_1], gas.link[i][HASH_2], gas.link[i][TOP] = 0, 0, 0
    note_speed(i, gas)
    gas.begun[i][0], gas.begun[i][1] = x + row * gas.scale[ASIDE], y
    gas.link[i][PARTNER], gas.link[i][LAST] = NOBODY, NOBODY
    gas.link[i][NUMBER], gas.link[i][PREVIOUS] = 0, -1
    cx = c // region.ny
    gas.link[i][CELL] = (cx << 16) + c - cx * region.ny


@ti.func
def chain(i, n, region: ti.template(), gas: ti.template()):
    """Link the disk at place i, of n that are laid out, with the next one in its cell, or its cell with it."""
    places = region.lane * gas.grid[PLACES]
    cell = gas.link[i][CELL]
    following = -1
    if i + 1 < places + n:
        if gas.link[i + 1][CELL] == cell:
            following = i + 1
    gas.link[i][NEXT_IN_CELL] = following
    is_first = i == places
    if not is_first:
        is_first = gas.link[i - 1][CELL] != cell
    if is_first:
        gas.head[region.cells + (cell >> 16) * region.ny + (cell & 0xFFFF)] = i


@ti.func
def chain_layers(n, region: ti.template(), gas: ti.template()):
    """The same for all disks, where there are two layers of cells."""
    for c in range(cells_of(region, gas)):
        gas.head[region.cells + c] = -1
    places = region.lane * gas.grid[PLACES]
    for i in range(places, places + n):
        layer = layer_of(i, gas)
        _nx, _ny, factor = scale_of(layer, region, gas)
        cx, cy = (gas.link[i][CELL] >> 16) // factor, (gas.link[i][CELL] & 0xFFFF) // factor
        gas.link[i][CELL] = (cx << 16) + cy
        at = head_at(cx, cy, layer, region, gas)
        gas.link[i][NEXT_IN_CELL] = gas.head[at]
        gas.head[at] = i


@ti.func
def inside(x, y, tile, gas: ti.template()):
    """Distance of a place from the sides of its tile; negative outside. Ends of the box that are open are no sides."""
    tx = tile // gas.grid[TILES_Y]
    ty = tile - tx * gas.grid[TILES_Y]
    width, height = sides_of(tile, gas)
    left, right, below, above = x, width - x, y, height - y
    if gas.grid[PERIODIC_X] == 0:
        left = ti.select(tx == 0, ENDLESS, left)
        right = ti.select(tx == gas.grid[TILES_X] - 1, ENDLESS, right)
    if gas.grid[PERIODIC_Y] == 0:
        below = ti.select(ty == 0, ENDLESS, below)
        above = ti.select(ty == gas.grid[TILES_Y] - 1, ENDLESS, above)
    return ti.min(ti.min(left, right), ti.min(below, above))


@ti.func
def last_hit(i, gas: ti.template()):
    """Slot of the own disk at place i, counted from that of the first of its tile, its place, and boxes travelled.

    Of its latest collision, from the corner of the tile that will list it.
    """
    x, y = gas.work[i][X], gas.work[i][Y]
    slot, lap_x, lap_y = gas.link[i][OWN] - 1, gas.mark[i][LAP_X], gas.mark[i][LAP_Y]
    if gas.grid[ALONE] == 1 and gas.grid[TILES_X] * gas.grid[TILES_Y] > 1:  # the lists stay as they are
        slot = gas.mark[i][SLOT]
        listed = gas.mark[i][LISTED]
        x += lap_x * gas.scale[LENGTH_X]
        y += lap_y * gas.scale[LENGTH_Y]
        x -= ti.cast(gas.edge_x[listed // gas.grid[TILES_Y]] - gas.edge_x[0], float)
        y -= ti.cast(gas.edge_y[listed % gas.grid[TILES_Y]] - gas.edge_y[0], float)
        lap_x, lap_y = 0, 0
    return slot, x, y, lap_x, lap_y


@ti.func
def put_down(i, row, x, y, vx, vy, lap_x, lap_y, gas: ti.template()):
    """Write the disk at place i into a row of the state, with this place and velocity."""
    s = gas.grid[PART] * gas.grid[ROOM] + gas.mark[i][SLOT]
    gas.disk[row][X], gas.disk[row][Y] = x, y
    gas.disk[row][VX], gas.disk[row][VY] = vx, vy
    gas.disk[row][SPIN] = gas.work[i][W_SPIN]
    gas.meta[row][ID] = gas.link[i][WHO]
    gas.meta[row][EVENTS] = gas.meta[s][EVENTS] + gas.link[i][NUMBER]
    gas.meta[row][IMAGE_X] = gas.meta[s][IMAGE_X] + lap_x
    gas.meta[row][IMAGE_Y] = gas.meta[s][IMAGE_Y] + lap_y
    if ti.static(gas.uses.mixed and gas.uses.shared):
        gas.kind[row] = gas.link[i][KIND]
    if ti.static(gas.uses.remembers):
        gas.past[row][LATEST] = ti.cast(gas.since[i], ti.f64)
    if ti.static(gas.uses.rests):
        gas.slept[row] = gas.rest[i][ASLEEP_NOW]
        for column in ti.static(range(HELD * OF_HELD)):
            gas.held[row][column] = gas.grip[i][column]
    if ti.static(gas.uses.turned):
        gas.past[row][ANGLE] = gas.past[s][ANGLE] + gas.turn[i]
    if ti.static(gas.uses.itemised):
        for column in ti.static(range(MECHANISMS)):
            gas.spent[row][column] = gas.spent[s][column] + gas.loss[i][column]
    if ti.static(gas.uses.walled):
        gas.hits[row][WALL_HITS] = gas.hits[s][WALL_HITS] + gas.mark[i][AT_WALLS]
    if ti.static(gas.uses.partnered):
        partner = gas.hits[s][LAST_PARTNER]
        last = gas.link[i][LAST]
        if last >= 0:
            partner = gas.link[last][WHO]
        elif last <= FIRST_WALL:
            partner = -2 - (FIRST_WALL - last)
        gas.hits[row][LAST_PARTNER] = partner


@ti.func
def fly(row, dt, time, fall_x, fall_y, gas: ti.template()):
    """Fly the disk in a row of the state for dt to a time since the window's beginning; places are on the grid."""
    vx, vy = gas.disk[row][VX], gas.disk[row][VY]
    gas.disk[row][X] = gas.disk[row][X] + on_grid(vx * dt + 0.5 * fall_x * time, gas)
    gas.disk[row][Y] = gas.disk[row][Y] + on_grid(vy * dt + 0.5 * fall_y * time, gas)
    gas.disk[row][VX], gas.disk[row][VY] = vx + fall_x, vy + fall_y
    if ti.static(gas.uses.turned):
        gas.past[row][ANGLE] = gas.past[row][ANGLE] + ti.cast(gas.disk[row][SPIN], ti.f64) * ti.cast(
            dt, ti.f64
        )


@ti.func
def take_note(i, t, tile, gas: ti.template()):
    """Note the disk at place i, if it is the tile's own, after its collision at t, and what the tile has added up."""
    if gas.link[i][OWN] > 0:
        n = ti.atomic_add(gas.counter[N_NOTED], 1)
        if n < gas.grid[NOTES]:
            slot, x, y, lap_x, lap_y = last_hit(i, gas)
            if gas.grid[ALONE] == 0:
                slot += gas.tile[tile, START + 1 - gas.grid[PART]]
            row = (TOLD + gas.grid[MOMENTS]) * gas.grid[ROOM] + n
            put_down(i, row, x, y, gas.work[i][VX], gas.work[i][VY], lap_x, lap_y, gas)
            partner, counts = gas.link[i][LAST], 0
            if partner >= 0:
                counts = ti.cast(gas.link[i][WHO] < gas.link[partner][WHO], ti.i32)
            gas.note[n, 0], gas.note[n, 1], gas.note[n, 2] = slot, tile, counts
            gas.note_at[n] = ti.cast(t, ti.f64)
            for column in range(gas.tally.shape[2]):
                gas.note_tally[n, column] = gas.tally[tile, AT_END, column]


@ti.func
def write(n, tile, when, thread, team, region: ti.template(), gas: ti.template()):
    """Write own disks to their slots, as they are at the window's end, or at a moment asked for.

    At the end, where a window begins next, histories and claims are written. A moment whose time is not known yet has
    disks where their latest collisions left them. A `team` of threads shares the n disks.
    """
    places = region.lane * gas.grid[PLACES]
    base = gas.tile[tile, START + 1 - gas.grid[PART]]
    part = 1 - gas.grid[PART]
    time = gas.scale[WINDOW]
    known = 1
    if when >= AT_MOMENT:
        m = when - AT_MOMENT
        part = TOLD + m
        time = gas.scale[MOMENT_IN + 2 * m]
        known = ti.cast(gas.scale[MOMENT_IN + 2 * m + 1] <= time, ti.i32)
        for column in range(gas.tally.shape[2]):
            gas.tally[tile, when, column] = gas.tally[tile, AT_END, column]
    if ti.static(gas.uses.pistons):
        write_pistons(tile, when, time, gas)
    fall_x, fall_y = gas.scale[GX] * time, gas.scale[GY] * time
    beyond, furthest = -ENDLESS + 0.0 * time, 0.0 * time
    fastest, squares = 0.0 * time, ti.cast(0.0, ti.f64)
    in_place = gas.grid[ALONE] == 1 and gas.grid[TILES_X] * gas.grid[TILES_Y] > 1
    protrudes = 0.0 * time
    i = places + thread
    while i < places + n:
        way = largest_speed(i, gas) * time
        rank = gas.link[i][OWN]
        if rank > 0:
            slot, x, y, lap_x, lap_y = last_hit(i, gas)
            if not in_place:
                slot += base
            row = part * gas.grid[ROOM] + slot
            put_down(i, row, x, y, gas.work[i][VX], gas.work[i][VY], lap_x, lap_y, gas)
            if ti.static(gas.uses.rests):
                fall_x, fall_y = gas.scale[GX] * time, gas.scale[GY] * time
                if gas.rest[i][ASLEEP_NOW] == ASLEEP:
                    fall_x, fall_y = 0.0 * time, 0.0 * time
            if known == 1:
                fly(row, time - gas.work[i][TAU], time, fall_x, fall_y, gas)
            else:
                gas.told_at[row - TOLD * gas.grid[ROOM]] = gas.work[i][TAU]
            if when == AT_END:
                x, y = gas.disk[row][X], gas.disk[row][Y]
                gas.trail[gas.mark[i][SLOT]][0] = gas.link[i][HASH_1]
                gas.trail[gas.mark[i][SLOT]][1] = gas.link[i][HASH_2]
                gas.way[gas.mark[i][SLOT]] = ti.cast(1.000001 * way / gas.scale[WIDEST], ti.f32)
                gas.back[slot] = gas.mark[i][SLOT]
                furthest = ti.max(furthest, way)
                listed = tile
                if in_place:
                    listed = gas.mark[i][LISTED]
                beyond = ti.max(
                    beyond, way - inside(x - 0.5 * fall_x * time, y - 0.5 * fall_y * time, listed, gas)
                )
                protrudes = ti.max(protrudes, -inside(x, y, listed, gas))
                vx, vy = gas.disk[row][VX], gas.disk[row][VY]
                speed2 = vx * vx + vy * vy
                fastest = ti.max(fastest, speed2)
                squares += ti.floor(ti.cast(speed2, ti.f64) / gas.clock[SQUARE_UNIT])
                if ti.static(gas.uses.remembers):
                    gas.past[row][LATEST] = ti.cast(gas.since[i], ti.f64) - ti.cast(time, ti.f64)
        elif when == AT_END:
            claim = gas.tile[tile, CLAIMS] - rank - 1
            gas.claim[claim][0] = gas.mark[i][SLOT]
            gas.claim[claim][1], gas.claim[claim][2] = gas.link[i][HASH_1], gas.link[i][HASH_2]
            faster = 0.0 * time
            if ti.static(gas.uses.sheared):
                faster = ti.abs(gas.link[i][ROW] * gas.scale[DRIFT])
            gas.claim_at[claim][0], gas.claim_at[claim][1] = gas.begun[i][0], gas.begun[i][1]
            gas.claim_at[claim][2] = (largest_speed(i, gas) + faster) * time
        i += team
    if when == AT_END:
        ti.atomic_max(gas.tally[tile, AT_END, FASTEST], ti.cast(fastest, ti.f64))
        ti.atomic_add(gas.tally[tile, AT_END, SQUARES], squares)  # whole numbers: exact in any order
        ti.atomic_max(gas.reach[tile, BEYOND], beyond)
        ti.atomic_max(gas.reach[tile, FURTHEST], furthest)
        ti.atomic_max(gas.reach[tile, PROTRUDES], protrudes)


@ti.func
def came(slot, gas: ti.template()):
    """Bound on how far the disk at a slot came in the window [length]."""
    return ti.cast(gas.way[slot], float) * gas.scale[WIDEST]


@ti.func
def touches(claim, tile, gas: ti.template()):
    """1 if the disk of a claim, or its copy, may have touched an own disk of the tile that made it, else 0.

    All that either passed lies in a circle around its first place. All that an own disk passed lies in one around its
    last place, with its way as the radius.
    """
    x, y = gas.claim_at[claim][0], gas.claim_at[claim][1]
    way = ti.max(gas.claim_at[claim][2], came(gas.claim[claim][0], gas)) + gas.scale[WIDEST]
    if ti.static(gas.uses.sheared):
        way += ti.abs(gas.scale[DRIFT]) * gas.scale[WINDOW]
    found = 0
    if -inside(x, y, tile, gas) <= way + gas.reach[tile, BEYOND]:
        part = 1 - gas.grid[PART]
        fall_x = 0.5 * gas.scale[GX] * gas.scale[WINDOW] * gas.scale[WINDOW]
        fall_y = 0.5 * gas.scale[GY] * gas.scale[WINDOW] * gas.scale[WINDOW]
        k, end = gas.tile[tile, START + part], gas.tile[tile, START + part] + gas.tile[tile, COUNT + part]
        while k < end:
            s = part * gas.grid[ROOM] + k
            dx, dy = gas.disk[s][X] - fall_x - x, gas.disk[s][Y] - fall_y - y
            both = way + came(gas.back[k], gas)
            k += 1
            if dx * dx + dy * dy <= both * both:
                found, k = 1, end
    return found


@ti.func
def is_too_narrow(tile, gas: ti.template()):
    """1 if the halo of a tile may not have had all that came into touch with its own disks (1 above), else 0."""
    furthest = 0.0 * gas.scale[WINDOW]
    for step_x in range(-1, 2):
        for step_y in range(-1, 2):
            other, _x, _y, _bx, _by = neighbour(tile, step_x, step_y, gas)
            if other >= 0 and (step_x != 0 or step_y != 0):
                furthest = ti.max(furthest, gas.reach[other, FURTHEST])
    if ti.static(gas.uses.sheared):
        furthest += ti.abs(gas.scale[DRIFT]) * gas.scale[WINDOW]
    needed = gas.scale[WIDEST] + ti.max(gas.reach[tile, BEYOND], 0.0) + furthest
    return ti.cast(gas.reach[tile, HALO] < needed, ti.i32)


@ti.func
def is_wrong(tile, thread, gas: ti.template()):
    """1 if a claim of a tile may make its window inexact (2 above), of those that this thread of its team tests."""
    wrong = 0
    claim, end = gas.tile[tile, CLAIMS] + thread, gas.tile[tile, CLAIMS] + gas.tile[tile, N_CLAIMS]
    while claim < end and wrong == 0:
        s = gas.claim[claim][0]
        if gas.claim[claim][1] != gas.trail[s][0] or gas.claim[claim][2] != gas.trail[s][1]:
            wrong = touches(claim, tile, gas)
        claim += ti.static(team_of(gas.uses))
    return wrong
