"""Between epochs: fly on, and sort the disks into cells; export them."""

import taichi as ti

from .layout import (
    ACTIVE,
    AFFECTED,
    CELL_X,
    CELL_Y,
    CELLS_X,
    CELLS_Y,
    COLLISIONS,
    DIRTY,
    DURATION,
    EARLIEST,
    FAR,
    FASTEST,
    HEAD,
    ID,
    KIND,
    KIND_RADIUS,
    LENGTH,
    MEAN_SQUARE,
    NEVER,
    PARTNER,
    RADIUS,
    SEQ,
    SPIN,
    SPREAD,
    TAU,
    TE,
    TILE_X,
    TILE_Y,
    TILES_X,
    TILES_Y,
    UNDO,
    VX,
    VY,
    N,
    X,
    Y,
)

BLOCK = 1024  # items that one thread handles at a time in scans and reductions


@ti.func
def n_cells(grid: ti.template()):
    """Cells of the whole box."""
    return grid[TILES_X] * grid[TILES_Y] * grid[CELLS_X] * grid[CELLS_Y]


@ti.func
def n_blocks(items):
    """Blocks that hold so many items."""
    return (items + BLOCK - 1) // BLOCK


@ti.func
def split(index, count):
    """An index anywhere, as a place inside `count` and the number of spans that it is away."""
    # Taichi's integer division truncates.
    span = ti.floor(ti.cast(index, ti.f64) / ti.cast(count, ti.f64), ti.i32)
    return index - span * count, span


@ti.func
def fly(
    i,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    meta: ti.template(),
    image: ti.template(),
    link: ti.template(),
    cell: ti.template(),
    fill: ti.template(),
    limit: ti.template(),
):
    """Move disk i on to the end of the epoch, into its new tile and cell; count it there."""
    dt = scale[DURATION] - flight[i][TAU]
    x = flight[i][X] + flight[i][VX] * dt
    y = flight[i][Y] + flight[i][VY] * dt
    in_x = ti.floor(x / scale[CELL_X], ti.i32)
    in_y = ti.floor(y / scale[CELL_Y], ti.i32)
    cells = grid[CELLS_X] * grid[CELLS_Y]
    tile = cell[i] // cells
    if in_x < 0 or in_x >= grid[CELLS_X] or in_y < 0 or in_y >= grid[CELLS_Y]:
        in_x, step_x = split(in_x, grid[CELLS_X])
        in_y, step_y = split(in_y, grid[CELLS_Y])
        x -= step_x * scale[TILE_X]
        y -= step_y * scale[TILE_Y]
        tile_x, box_x = split(tile // grid[TILES_Y] + step_x, grid[TILES_X])
        tile_y, box_y = split(tile % grid[TILES_Y] + step_y, grid[TILES_Y])
        tile = tile_x * grid[TILES_Y] + tile_y
        image[meta[i][ID]][0] += box_x
        image[meta[i][ID]][1] += box_y
    flight[i][X] = x
    flight[i][Y] = y
    meta[i][COLLISIONS] += link[i][SEQ]
    c = tile * cells + in_x * grid[CELLS_Y] + in_y
    cell[i] = c
    ti.atomic_add(fill[c], 1)
    if flight[i][TE] < scale[DURATION]:
        # Watchdog: an event before the end of the epoch was not processed.
        ti.atomic_min(limit[EARLIEST], flight[i][TE])


@ti.func
def sum_block(b, cells, fill: ti.template(), block: ti.template()):
    """First step of the exclusive scan of the cells' counts: the sum of a block."""
    total = 0
    for c in range(b * BLOCK, ti.min(cells, (b + 1) * BLOCK)):
        total += fill[c]
    block[b] = total


@ti.func
def scan_blocks(blocks, block: ti.template()):
    """Second step, by one thread: what comes before each block."""
    before = 0
    for b in range(blocks):
        here = block[b]
        block[b] = before
        before += here


@ti.func
def scan_block(b, cells, fill: ti.template(), block: ti.template(), start: ti.template()):
    """Third step: the first slot of each cell of a block, also as the place to fill next."""
    before = block[b]
    for c in range(b * BLOCK, ti.min(cells, (b + 1) * BLOCK)):
        start[c] = before
        before += fill[c]
        fill[c] = start[c]


@ti.func
def order_cell(c, start: ti.template(), order: ti.template(), meta: ti.template()):
    """Sort a cell's disks by id: atomics put them there in any order."""
    for q in range(start[c] + 1, start[c + 1]):
        moving = order[q]
        place = q
        sorting = 1
        while sorting == 1:
            sorting = 0
            if place > start[c]:
                if meta[order[place - 1]][ID] > meta[moving][ID]:
                    order[place] = order[place - 1]
                    place -= 1
                    sorting = 1
        order[place] = moving


@ti.func
def lay_aside(
    s,
    i,
    flight: ti.template(),
    meta: ti.template(),
    cell: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
):
    """Copy the disk at slot i to place s of the log, where two disks share a record: nobody needs the log any more."""
    entry = s // 2
    first = 5 * (s % 2)
    log_real[entry][first] = flight[i][X]
    log_real[entry][first + 1] = flight[i][Y]
    log_real[entry][first + 2] = flight[i][VX]
    log_real[entry][first + 3] = flight[i][VY]
    log_real[entry][first + 4] = flight[i][SPIN]
    first = 4 * (s % 2)
    for column in ti.static(range(3)):
        log_int[entry][first + column] = meta[i][column]
    log_int[entry][first + 3] = cell[i]


@ti.func
def put_back(
    s,
    flight: ti.template(),
    kinds: ti.template(),
    meta: ti.template(),
    cell: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
):
    """Copy place s of the log to slot s."""
    entry = s // 2
    first = 5 * (s % 2)
    flight[s][X] = log_real[entry][first]
    flight[s][Y] = log_real[entry][first + 1]
    flight[s][VX] = log_real[entry][first + 2]
    flight[s][VY] = log_real[entry][first + 3]
    flight[s][SPIN] = log_real[entry][first + 4]
    first = 4 * (s % 2)
    for column in ti.static(range(3)):
        meta[s][column] = log_int[entry][first + column]
    cell[s] = log_int[entry][first + 3]
    flight[s][RADIUS] = kinds[meta[s][KIND]][KIND_RADIUS]


@ti.func
def clear(s, flight: ti.template(), link: ti.template()):
    """Make a disk ready for a new epoch: no collisions, no neighbours, no event."""
    flight[s][TAU] = 0.0
    flight[s][TE] = FAR
    link[s][PARTNER] = -1
    link[s][HEAD] = -1
    link[s][SEQ] = 0
    link[s][ACTIVE] = -1
    link[s][DIRTY] = -1
    link[s][AFFECTED] = -1
    link[s][UNDO] = NEVER
    link[s][LENGTH] = 0


@ti.kernel
def settle(
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    kinds: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    image: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    log_real: ti.types.ndarray(ndim=1),
    log_int: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    fill: ti.types.ndarray(ndim=1),
    block: ti.types.ndarray(ndim=1),
    order: ti.types.ndarray(ndim=1),
    squares: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
):
    """Fly every disk on by `scale[DURATION]`, count its collisions, and sort by cell, within a cell by id.

    Counting sort: `start` (cells + 1,) gets the first slot of each cell, `order` (n,) the old slot of each new one.
    Slots within a cell come from atomics in any order; sorting them by id makes the result independent of threads.
    `limit` gets the largest and the mean square speed. `link` is cleared.
    The disks move by way of the log, whose records are lost.
    """
    for c in range(n_cells(grid)):
        fill[c] = 0
    for _ in range(1):
        limit[EARLIEST] = FAR
    for i in range(grid[N]):
        fly(i, grid, scale, flight, meta, image, link, cell, fill, limit)
    for item in range(SPREAD * n_blocks(n_cells(grid))):
        if item % SPREAD == 0:
            sum_block(item // SPREAD, n_cells(grid), fill, block)
    for _ in range(1):
        scan_blocks(n_blocks(n_cells(grid)), block)
        start[n_cells(grid)] = grid[N]
        limit[FASTEST] = 0.0
    for item in range(SPREAD * n_blocks(n_cells(grid))):
        if item % SPREAD == 0:
            scan_block(item // SPREAD, n_cells(grid), fill, block, start)
    for i in range(grid[N]):
        order[ti.atomic_add(fill[cell[i]], 1)] = i
    for c in range(n_cells(grid)):
        order_cell(c, start, order, meta)
    for s in range(grid[N]):
        lay_aside(s, order[s], flight, meta, cell, log_real, log_int)
    for s in range(grid[N]):
        put_back(s, flight, kinds, meta, cell, log_real, log_int)
        clear(s, flight, link)
    for item in range(SPREAD * n_blocks(grid[N])):
        if item % SPREAD == 0:
            b = item // SPREAD
            fastest2 = limit[FASTEST] * 0.0
            sum2 = limit[FASTEST] * 0.0
            for s in range(b * BLOCK, ti.min(grid[N], (b + 1) * BLOCK)):
                vx, vy = flight[s][VX], flight[s][VY]
                fastest2 = ti.max(fastest2, vx * vx + vy * vy)
                sum2 += vx * vx + vy * vy
            ti.atomic_max(limit[FASTEST], ti.sqrt(fastest2))
            squares[b] = sum2
    for _ in range(1):
        # Block by block: the order of a sum of rounded numbers matters.
        total = limit[FASTEST] * 0.0
        for b in range(n_blocks(grid[N])):
            total += squares[b]
        limit[MEAN_SQUARE] = total / ti.max(grid[N], 1)


@ti.kernel
def export(
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    image: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    real_out: ti.types.ndarray(ndim=2),
    int_out: ti.types.ndarray(ndim=2),
):
    """Settled disks in id order: x, y, vx, vy, spin into `real_out` (n, 5); collisions, crossings into `int_out`."""
    for s in range(grid[N]):
        i = meta[s][ID]
        tile = cell[s] // (grid[CELLS_X] * grid[CELLS_Y])
        real_out[i, 0] = (tile // grid[TILES_Y]) * scale[TILE_X] + flight[s][X]
        real_out[i, 1] = (tile % grid[TILES_Y]) * scale[TILE_Y] + flight[s][Y]
        real_out[i, 2] = flight[s][VX]
        real_out[i, 3] = flight[s][VY]
        real_out[i, 4] = flight[s][SPIN]
        int_out[i, 0] = meta[s][COLLISIONS]
        int_out[i, 1] = image[i][0]
        int_out[i, 2] = image[i][1]
