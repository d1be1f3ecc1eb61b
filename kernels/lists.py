"""Beginning of an epoch: list the neighbours, predict first events."""

import taichi as ti

from .layout import (
    CELLS_X,
    CELLS_Y,
    END,
    HORIZON,
    LENGTH,
    LOG_FULL,
    MOST_NEIGHBOURS,
    N_LOG,
    N_ROUNDS,
    N_STANDING,
    N_UNDONE,
    N_VIOLATIONS,
    OTHER,
    PARTNER,
    RADIUS,
    ROW,
    SAME_FRAME,
    SKIN,
    SPREAD,
    TE,
    TILE_X,
    TILE_Y,
    TILES_X,
    TILES_Y,
    TOP_LEVEL,
    VX,
    VY,
    N,
    X,
    Y,
    contact_delay,
    n_others,
    n_own,
    sooner,
    tile_beside,
)
from .sort import clear


@ti.func
def open_epoch(scale: ti.template(), counter: ti.template(), limit: ti.template()):
    """Counters and end of a new epoch."""
    for item in ti.static(
        (
            0,
            1,
            2,
            3,
            4,
            N_LOG,
            N_STANDING,
            N_VIOLATIONS,
            N_ROUNDS,
            MOST_NEIGHBOURS,
            LOG_FULL,
            N_UNDONE,
            TOP_LEVEL,
        )
    ):
        counter[item] = 0
    limit[END] = scale[HORIZON]


@ti.func
def offer(i, t, code, horizon, flight: ti.template(), link: ti.template(), meta: ti.template()):
    """Make the event at t with `code` disk i's, if it comes before the one it has."""
    if t <= flight[i][TE]:
        if sooner(t, code // 9, flight[i][TE], link[i][PARTNER], horizon, meta):
            flight[i][TE] = t
            link[i][PARTNER] = code


@ti.func
def list_others(
    i,
    tile,
    in_x,
    in_y,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    start: ti.template(),
    neighbour: ti.template(),
):
    """List disk i's neighbours in other tiles, or across the box in its own, and predict its meetings with them."""
    row = grid[ROW]
    length = 0
    for beside in range(9):
        cx = in_x + beside // 3 - 1
        cy = in_y + beside % 3 - 1
        shift = SAME_FRAME
        if cx < 0:
            cx += grid[CELLS_X]
            shift -= 3
        elif cx >= grid[CELLS_X]:
            cx -= grid[CELLS_X]
            shift += 3
        if cy < 0:
            cy += grid[CELLS_Y]
            shift -= 1
        elif cy >= grid[CELLS_Y]:
            cy -= grid[CELLS_Y]
            shift += 1
        if shift != SAME_FRAME:
            other = tile_beside(tile, shift, grid)
            c = (other * grid[CELLS_X] + cx) * grid[CELLS_Y] + cy
            for j in range(start[c], start[c + 1]):
                rx = flight[j][X] - flight[i][X] + (shift // 3 - 1) * scale[TILE_X]
                ry = flight[j][Y] - flight[i][Y] + (shift % 3 - 1) * scale[TILE_Y]
                sigma = flight[i][RADIUS] + flight[j][RADIUS]
                near = sigma + scale[SKIN]
                if rx * rx + ry * ry < near * near:
                    neighbour[row * i + row - 1 - ti.min(length, row - 1)] = 9 * j + shift
                    length += 1
                    # All clocks stand at 0: the same bits as `meeting_time`.
                    t = contact_delay(
                        rx,
                        ry,
                        flight[i][VX],
                        flight[i][VY],
                        flight[j][VX],
                        flight[j][VY],
                        sigma,
                        scale[HORIZON],
                    )
                    offer(i, t, 9 * j + shift, scale[HORIZON], flight, link, meta)
    link[i][LENGTH] += OTHER * length


@ti.func
def list_tile(
    tile,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    start: ti.template(),
    neighbour: ti.template(),
    counter: ti.template(),
):
    """List the neighbours of a tile's disks and predict first events; each pair of the tile is looked at once.

    Entries that a row has no room for are not written, but `counter[MOST_NEIGHBOURS]` tells the length needed.
    """
    row = grid[ROW]
    cells_x = grid[CELLS_X]
    cells_y = grid[CELLS_Y]
    skin = scale[SKIN]
    horizon = scale[HORIZON]
    first = tile * cells_x * cells_y
    most = 0
    for in_x in range(cells_x):
        for in_y in range(cells_y):
            c = first + in_x * cells_y + in_y
            # The cells of a column follow one another in memory: above this one, and to its right.
            above = ti.min(in_y + 1, cells_y - 1) - in_y
            below = in_y - ti.max(in_y - 1, 0)
            own_end = start[c + above + 1]
            right = 0
            right_end = 0
            if in_x + 1 < cells_x:
                right = start[c + cells_y - below]
                right_end = start[c + cells_y + above + 1]
            at_border = in_x == 0 or in_x == cells_x - 1 or in_y == 0 or in_y == cells_y - 1
            for i in range(start[c], start[c + 1]):
                x, y, vx, vy = flight[i][X], flight[i][Y], flight[i][VX], flight[i][VY]
                radius = flight[i][RADIUS]
                old = link[i][LENGTH]
                length = old
                # Every candidate is written to the next free place; only a neighbour moves that place on. Cheaper
                # than a branch that nobody can predict.
                for j in range(i + 1, own_end):
                    rx, ry = flight[j][X] - x, flight[j][Y] - y
                    near = radius + flight[j][RADIUS] + skin
                    neighbour[row * i + ti.min(length, row - 1)] = j
                    length += ti.cast(rx * rx + ry * ry < near * near, ti.i32)
                for j in range(right, right_end):
                    rx, ry = flight[j][X] - x, flight[j][Y] - y
                    near = radius + flight[j][RADIUS] + skin
                    neighbour[row * i + ti.min(length, row - 1)] = j
                    length += ti.cast(rx * rx + ry * ry < near * near, ti.i32)
                link[i][LENGTH] = length
                earliest = flight[i][TE]
                for q in range(old, ti.min(length, row)):
                    j = neighbour[row * i + q]
                    length_j = link[j][LENGTH]
                    neighbour[row * j + ti.min(length_j, row - 1)] = i
                    link[j][LENGTH] = length_j + 1
                    before = ti.min(horizon, ti.max(earliest, flight[j][TE]))
                    t = contact_delay(
                        flight[j][X] - x,
                        flight[j][Y] - y,
                        vx,
                        vy,
                        flight[j][VX],
                        flight[j][VY],
                        radius + flight[j][RADIUS],
                        before,
                    )
                    if t <= before:
                        offer(i, t, 9 * j + SAME_FRAME, horizon, flight, link, meta)
                        offer(j, t, 9 * i + SAME_FRAME, horizon, flight, link, meta)
                        earliest = flight[i][TE]
                if at_border:
                    list_others(i, tile, in_x, in_y, grid, scale, flight, link, meta, start, neighbour)
                lengths = link[i][LENGTH]
                most = ti.max(most, n_own(lengths) + n_others(lengths))
    # A row that later disks made too long shows when it is looked at again.
    for i in range(start[first], start[first + cells_x * cells_y]):
        most = ti.max(most, n_own(link[i][LENGTH]) + n_others(link[i][LENGTH]))
    # In a row that is just full, a candidate may have been written over the last neighbour.
    if most >= row:
        ti.atomic_max(counter[MOST_NEIGHBOURS], most + 1)


@ti.kernel
def list_tiles(
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    counter: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
):
    """Open an epoch: list every pair closer than contact + skin, predict first events. One thread a tile."""
    for _ in range(1):
        open_epoch(scale, counter, limit)
    for item in range(SPREAD * grid[TILES_X] * grid[TILES_Y]):
        if item % SPREAD == 0:
            list_tile(item // SPREAD, grid, scale, flight, link, meta, start, neighbour, counter)


@ti.kernel
def list_disks(
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    counter: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
):
    """The same as `list_tiles`, one thread a disk: every pair is looked at twice, but thousands of threads help."""
    for _ in range(1):
        open_epoch(scale, counter, limit)
    for i in range(grid[N]):
        tile = cell[i] // (grid[CELLS_X] * grid[CELLS_Y])
        in_tile = cell[i] - tile * grid[CELLS_X] * grid[CELLS_Y]
        in_x = in_tile // grid[CELLS_Y]
        in_y = in_tile - in_x * grid[CELLS_Y]
        length = 0
        first_y = ti.max(in_y - 1, 0)
        last_y = ti.min(in_y + 1, grid[CELLS_Y] - 1)
        for column in range(ti.max(in_x - 1, 0), ti.min(in_x + 2, grid[CELLS_X])):
            base = (tile * grid[CELLS_X] + column) * grid[CELLS_Y]
            for j in range(start[base + first_y], start[base + last_y + 1]):
                rx = flight[j][X] - flight[i][X]
                ry = flight[j][Y] - flight[i][Y]
                sigma = flight[i][RADIUS] + flight[j][RADIUS]
                near = sigma + scale[SKIN]
                if rx * rx + ry * ry < near * near and j != i:
                    if length < grid[ROW]:
                        neighbour[grid[ROW] * i + length] = j
                    length += 1
                    t = contact_delay(
                        rx,
                        ry,
                        flight[i][VX],
                        flight[i][VY],
                        flight[j][VX],
                        flight[j][VY],
                        sigma,
                        scale[HORIZON],
                    )
                    offer(i, t, 9 * j + SAME_FRAME, scale[HORIZON], flight, link, meta)
        link[i][LENGTH] = length
        if in_x == 0 or in_x == grid[CELLS_X] - 1 or in_y == 0 or in_y == grid[CELLS_Y] - 1:
            list_others(i, tile, in_x, in_y, grid, scale, flight, link, meta, start, neighbour)
        lengths = link[i][LENGTH]
        if n_own(lengths) + n_others(lengths) > grid[ROW]:
            ti.atomic_max(counter[MOST_NEIGHBOURS], n_own(lengths) + n_others(lengths))


@ti.kernel
def clear_all(
    grid: ti.types.ndarray(ndim=1), flight: ti.types.ndarray(ndim=1), link: ti.types.ndarray(ndim=1)
):
    """Forget the epoch's lists and events, to list again."""
    for s in range(grid[N]):
        clear(s, flight, link)
