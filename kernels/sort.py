"""Beginning of an epoch: fly on, sort into cells, list the neighbours, predict first events."""

import taichi as ti

from .layout import (
    ACTIVE,
    AFFECTED,
    COLLISIONS,
    DIRTY,
    END,
    FAR,
    FASTEST,
    HEAD,
    ID,
    IMAGE_X,
    IMAGE_Y,
    LENGTH,
    LOG_FULL,
    MOST_NEIGHBOURS,
    NEVER,
    PARTNER,
    RADIUS,
    ROUND,
    SEQ,
    SPIN,
    TAU,
    TE,
    UNDO,
    VX,
    VY,
    X,
    Y,
    contact_delay,
    sooner,
)

BLOCK = 1024  # items that one thread handles at a time in scans and reductions


@ti.func
def wrapped(cell, cells):
    """A cell index anywhere, brought inside, and the number of the box it was in."""
    # Taichi's integer division truncates.
    box = ti.floor(ti.cast(cell, ti.f64) / ti.cast(cells, ti.f64), ti.i32)
    return cell - box * cells, box


@ti.kernel
def settle(
    n: ti.i32,
    duration: ti.f64,
    cells_x: ti.i32,
    cells_y: ti.i32,
    side_x: ti.f64,
    side_y: ti.f64,
    flight: ti.types.ndarray(ndim=1),
    body: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    flight_to: ti.types.ndarray(ndim=1),
    body_to: ti.types.ndarray(ndim=1),
    meta_to: ti.types.ndarray(ndim=1),
    cell_to: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    fill: ti.types.ndarray(ndim=1),
    block: ti.types.ndarray(ndim=1),
    order: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
):
    """Fly every disk on to `duration` [time], count its collisions, and sort by cell, within a cell by id.

    Counting sort: `start` (cells + 1,) gets the first slot of each cell, `order` (n,) the old slot of each new one.
    Slots within a cell come from atomics in any order; sorting them by id makes the result independent of threads.
    `limit[FASTEST]` gets the largest speed. The `_to` arrays receive the sorted disks, `link` is cleared.
    """
    cells = cells_x * cells_y
    for c in range(cells):
        fill[c] = 0
    for _ in range(1):
        limit[FASTEST] = 0.0
    for i in range(n):
        dt = duration - flight[i][TAU]
        x = flight[i][X] + flight[i][VX] * dt
        y = flight[i][Y] + flight[i][VY] * dt
        step_x = ti.floor(x / side_x, ti.i32)
        step_y = ti.floor(y / side_y, ti.i32)
        flight[i][X] = x - step_x * side_x
        flight[i][Y] = y - step_y * side_y
        flight[i][TAU] = 0.0
        cx, box_x = wrapped(cell[i] // cells_y + step_x, cells_x)
        cy, box_y = wrapped(cell[i] % cells_y + step_y, cells_y)
        meta[i][IMAGE_X] += box_x
        meta[i][IMAGE_Y] += box_y
        meta[i][COLLISIONS] += link[i][SEQ]
        cell[i] = cx * cells_y + cy
        ti.atomic_add(fill[cell[i]], 1)
    # Two-level exclusive scan of the counts: blocks, then the block sums by one thread, then within blocks.
    blocks = (cells + BLOCK - 1) // BLOCK
    for b in range(blocks):
        total = 0
        for c in range(b * BLOCK, ti.min(cells, (b + 1) * BLOCK)):
            total += fill[c]
        block[b] = total
    for _ in range(1):
        before = 0
        for b in range(blocks):
            here = block[b]
            block[b] = before
            before += here
        start[cells] = n
    for b in range(blocks):
        before = block[b]
        for c in range(b * BLOCK, ti.min(cells, (b + 1) * BLOCK)):
            start[c] = before
            before += fill[c]
            fill[c] = start[c]
    for i in range(n):
        order[ti.atomic_add(fill[cell[i]], 1)] = i
    for c in range(cells):
        for q in range(start[c] + 1, start[c + 1]):
            moving = order[q]
            place = q
            while place > start[c] and meta[order[place - 1]][ID] > meta[moving][ID]:
                order[place] = order[place - 1]
                place -= 1
            order[place] = moving
    for s in range(n):
        i = order[s]
        for column in ti.static(range(8)):
            flight_to[s][column] = flight[i][column]
        for column in ti.static(range(2)):
            body_to[s][column] = body[i][column]
        for column in ti.static(range(5)):
            meta_to[s][column] = meta[i][column]
        cell_to[s] = cell[i]
        link[s][PARTNER] = -1
        link[s][HEAD] = -1
        link[s][SEQ] = 0
        link[s][ACTIVE] = -1
        link[s][DIRTY] = -1
        link[s][AFFECTED] = -1
        link[s][UNDO] = NEVER
        link[s][LENGTH] = 0
    blocks_n = (n + BLOCK - 1) // BLOCK
    for b in range(blocks_n):
        fastest2 = 0.0
        for s in range(b * BLOCK, ti.min(n, (b + 1) * BLOCK)):
            vx, vy = flight_to[s][VX], flight_to[s][VY]
            fastest2 = ti.max(fastest2, vx * vx + vy * vy)
        ti.atomic_max(limit[FASTEST], ti.sqrt(fastest2))


@ti.kernel
def list_neighbours(
    n: ti.i32,
    capacity: ti.i32,
    skin: ti.f64,
    horizon: ti.f64,
    cells_x: ti.i32,
    cells_y: ti.i32,
    side_x: ti.f64,
    side_y: ti.f64,
    flight: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    counter: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
):
    """Open an epoch: list every pair closer than contact + `skin` [length], predict events before `horizon`.

    A row that would need more than `capacity` entries is not written further, but `counter[MOST_NEIGHBOURS]` tells
    the length that is needed: the caller makes room and calls again.
    """
    for _ in range(1):
        for item in ti.static(range(LOG_FULL + 1)):
            if ti.static(item != ROUND):
                counter[item] = 0
        limit[END] = horizon
    for i in range(n):
        x, y, vx, vy, radius = flight[i][X], flight[i][Y], flight[i][VX], flight[i][VY], flight[i][RADIUS]
        cx = cell[i] // cells_y
        cy = cell[i] - cells_y * cx
        length = 0
        earliest = FAR
        partner = -1
        # The three cells of a column follow one another in memory: one run, or three where a side cuts it.
        runs = 1
        if cy == 0 or cy == cells_y - 1:
            runs = 3
        for column in range(3):
            shift_x = (column - 1) * side_x
            other_x = cx + column - 1
            if other_x < 0:
                other_x += cells_x
            elif other_x >= cells_x:
                other_x -= cells_x
            for run in range(runs):
                first = other_x * cells_y + cy - 1
                last = first + 2
                middle = first + 1  # the cell in which the run would lie at the height of this disk's cell
                if runs == 3:
                    other_y = cy + run - 1
                    if other_y < 0:
                        other_y += cells_y
                    elif other_y >= cells_y:
                        other_y -= cells_y
                    first = other_x * cells_y + other_y
                    last = first
                    middle = first + 1 - run
                for j in range(start[first], start[last + 1]):
                    row = cell[j] - middle  # -1, 0, 1
                    sigma = radius + flight[j][RADIUS]
                    rx = flight[j][X] - x + shift_x
                    ry = flight[j][Y] - y + row * side_y
                    near = sigma + skin  # squared by hand: Taichi's ** is slow
                    if rx * rx + ry * ry < near * near and j != i:
                        code = 9 * j + 3 * column + row + 1
                        if length < capacity:
                            neighbour[capacity * i + length] = code
                        length += 1
                        # All clocks stand at 0: the same bits as `meeting_time`.
                        t = contact_delay(rx, ry, vx, vy, flight[j][VX], flight[j][VY], sigma, horizon)
                        if sooner(t, j, earliest, partner, horizon, meta):
                            earliest = t
                            partner = code
        if length > capacity:
            ti.atomic_max(counter[MOST_NEIGHBOURS], length)
        link[i][LENGTH] = length
        link[i][PARTNER] = partner
        flight[i][TE] = earliest


@ti.kernel
def export(
    n: ti.i32,
    cells_y: ti.i32,
    side_x: ti.f64,
    side_y: ti.f64,
    flight: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    real_out: ti.types.ndarray(ndim=2),
    int_out: ti.types.ndarray(ndim=2),
):
    """Settled disks in id order: x, y, vx, vy, spin into `real_out` (n, 5); collisions, crossings into `int_out`."""
    for s in range(n):
        i = meta[s][ID]
        real_out[i, 0] = (cell[s] // cells_y) * side_x + flight[s][X]
        real_out[i, 1] = (cell[s] % cells_y) * side_y + flight[s][Y]
        real_out[i, 2] = flight[s][VX]
        real_out[i, 3] = flight[s][VY]
        real_out[i, 4] = flight[s][SPIN]
        int_out[i, 0] = meta[s][COLLISIONS]
        int_out[i, 1] = meta[s][IMAGE_X]
        int_out[i, 2] = meta[s][IMAGE_Y]
