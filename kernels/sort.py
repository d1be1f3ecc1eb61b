"""Between epochs: fly on, and sort the disks into cells; export them."""

from .language import ti
from .layout import (
    ACTIVE,
    AFFECTED,
    ASIDE,
    BLOCK,
    BOXES_ASIDE,
    CELL_X,
    CELL_Y,
    CELLS_X,
    CELLS_Y,
    DIRTY,
    DRIFT,
    DURATION,
    EARLIEST,
    EVENTS,
    FAR,
    FASTEST,
    GX,
    GY,
    HEAD,
    ID,
    INVERSE_MASS,
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
    TILE_SIDE,
    TILE_X,
    TILE_Y,
    TILES_ASIDE,
    TILES_X,
    TILES_Y,
    UNDO,
    VX,
    VY,
    Cube,
    GasArrays,
    N,
    Rows,
    Table,
    X,
    Y,
    n_blocks,
)
from .ledger import close_tally, n_record_blocks, tally, weigh
from .shear import flow_at, frame_speed, lab_x, speed2_in_flow, work_between_rows, work_of_crossing
from .tally import note_latest, note_partner, note_turn, tally_walls
from .totals import TOTALS, count_in


@ti.func
def n_cells(gas: ti.template()):
    """Cells of the whole box."""
    return gas.grid[TILES_X] * gas.grid[TILES_Y] * gas.grid[CELLS_X] * gas.grid[CELLS_Y]


@ti.func
def split(index, count):
    """An index anywhere, as a place inside `count` and the number of spans that it is away."""
    # Taichi's integer division truncates.
    span = ti.floor(ti.cast(index, ti.f64) / ti.cast(count, ti.f64), ti.i32)
    return index - span * count, span


@ti.func
def enter_row(i, in_y, gas: ti.template()):
    """Change to the frame of the row of tiles in which disk i now is: how far x is from there, but for whole tiles."""
    step_y = 0
    if in_y < 0 or in_y >= gas.grid[CELLS_Y]:
        _place, step_y = split(in_y, gas.grid[CELLS_Y])
    work = work_between_rows(i, gas) + work_of_crossing(i, step_y, gas)
    gas.flow_work[gas.meta[i][ID]] = gas.flow_work[gas.meta[i][ID]] + work
    gas.flight[i][VX] = gas.flight[i][VX] - step_y * gas.scale[DRIFT]
    return -step_y * (gas.scale[ASIDE] + gas.scale[DRIFT] * gas.scale[DURATION])


@ti.func
def fly(i, gas: ti.template()):
    """Move disk i on to the end of the epoch, into its new tile and cell; count it there."""
    dt = gas.scale[DURATION] - gas.flight[i][TAU]
    x = gas.flight[i][X] + gas.flight[i][VX] * dt
    y = gas.flight[i][Y] + gas.flight[i][VY] * dt
    if ti.static(gas.uses.remembers):
        note_latest(i, gas)
    if ti.static(gas.uses.partnered):
        note_partner(i, gas)
    if ti.static(gas.uses.turned):
        note_turn(i, gas)
    if ti.static(gas.uses.walled):
        tally_walls(i, gas)
        # From the frame that fell since the beginning of the epoch back to the lab.
        fall = gas.scale[DURATION]
        x += 0.5 * gas.scale[GX] * fall * fall
        y += 0.5 * gas.scale[GY] * fall * fall
        gas.flight[i][VX] = gas.flight[i][VX] + gas.scale[GX] * fall
        gas.flight[i][VY] = gas.flight[i][VY] + gas.scale[GY] * fall
    in_y = ti.floor(y / gas.scale[CELL_Y], ti.i32)
    if ti.static(gas.uses.sheared):
        x += enter_row(i, in_y, gas)
    in_x = ti.floor(x / gas.scale[CELL_X], ti.i32)
    cells = gas.grid[CELLS_X] * gas.grid[CELLS_Y]
    tile = gas.cell[i] // cells
    if in_x < 0 or in_x >= gas.grid[CELLS_X] or in_y < 0 or in_y >= gas.grid[CELLS_Y]:
        in_x, step_x = split(in_x, gas.grid[CELLS_X])
        in_y, step_y = split(in_y, gas.grid[CELLS_Y])
        x -= step_x * gas.scale[TILE_X]
        y -= step_y * gas.scale[TILE_Y]
        if ti.static(gas.uses.sheared):
            step_x -= step_y * gas.grid[TILES_ASIDE]
            gas.image[gas.meta[i][ID]][0] = gas.image[gas.meta[i][ID]][0] - step_y * gas.grid[BOXES_ASIDE]
        tile_x, box_x = split(tile // gas.grid[TILES_Y] + step_x, gas.grid[TILES_X])
        tile_y, box_y = split(tile % gas.grid[TILES_Y] + step_y, gas.grid[TILES_Y])
        tile = tile_x * gas.grid[TILES_Y] + tile_y
        gas.image[gas.meta[i][ID]][0] = gas.image[gas.meta[i][ID]][0] + box_x
        gas.image[gas.meta[i][ID]][1] = gas.image[gas.meta[i][ID]][1] + box_y
    gas.flight[i][X] = x
    gas.flight[i][Y] = y
    gas.meta[i][EVENTS] = gas.meta[i][EVENTS] + gas.link[i][SEQ]
    c = tile * cells + in_x * gas.grid[CELLS_Y] + in_y
    gas.cell[i] = c
    ti.atomic_add(gas.fill[c], 1)
    if gas.flight[i][TE] < gas.scale[DURATION]:
        # Watchdog: an event before the end of the epoch was not processed.
        ti.atomic_min(gas.limit[EARLIEST], gas.flight[i][TE])


@ti.func
def sum_block(b, cells, gas: ti.template()):
    """First step of the exclusive scan of the cells' counts: the sum of a block."""
    total = 0
    for c in range(b * BLOCK, ti.min(cells, (b + 1) * BLOCK)):
        total += gas.fill[c]
    gas.block[b] = total


@ti.func
def scan_blocks(blocks, gas: ti.template()):
    """Second step, by one thread: what comes before each block."""
    before = 0
    for b in range(blocks):
        here = gas.block[b]
        gas.block[b] = before
        before += here


@ti.func
def scan_block(b, cells, gas: ti.template()):
    """Third step: the first slot of each cell of a block, also as the place to fill next."""
    before = gas.block[b]
    for c in range(b * BLOCK, ti.min(cells, (b + 1) * BLOCK)):
        gas.start[c] = before
        before += gas.fill[c]
        gas.fill[c] = gas.start[c]


@ti.func
def order_cell(c, gas: ti.template()):
    """Sort a cell's disks by id: atomics put them there in any order."""
    for q in range(gas.start[c] + 1, gas.start[c + 1]):
        moving = gas.order[q]
        place = q
        sorting = 1
        while sorting == 1:
            sorting = 0
            if place > gas.start[c]:
                if gas.meta[gas.order[place - 1]][ID] > gas.meta[moving][ID]:
                    gas.order[place] = gas.order[place - 1]
                    place -= 1
                    sorting = 1
        gas.order[place] = moving


@ti.func
def lay_aside(s, i, gas: ti.template()):
    """Copy the disk at slot i to place s of the log, where two disks share a record: nobody needs the log any more."""
    entry = s // 2
    first = 5 * (s % 2)
    gas.log_real[entry][first] = gas.flight[i][X]
    gas.log_real[entry][first + 1] = gas.flight[i][Y]
    gas.log_real[entry][first + 2] = gas.flight[i][VX]
    gas.log_real[entry][first + 3] = gas.flight[i][VY]
    gas.log_real[entry][first + 4] = gas.flight[i][SPIN]
    first = 4 * (s % 2)
    for column in ti.static(range(3)):
        gas.log_int[entry][first + column] = gas.meta[i][column]
    gas.log_int[entry][first + 3] = gas.cell[i]


@ti.func
def put_back(s, gas: ti.template()):
    """Copy place s of the log to slot s."""
    entry = s // 2
    first = 5 * (s % 2)
    gas.flight[s][X] = gas.log_real[entry][first]
    gas.flight[s][Y] = gas.log_real[entry][first + 1]
    gas.flight[s][VX] = gas.log_real[entry][first + 2]
    gas.flight[s][VY] = gas.log_real[entry][first + 3]
    gas.flight[s][SPIN] = gas.log_real[entry][first + 4]
    first = 4 * (s % 2)
    for column in ti.static(range(3)):
        gas.meta[s][column] = gas.log_int[entry][first + column]
    gas.cell[s] = gas.log_int[entry][first + 3]
    gas.flight[s][RADIUS] = gas.kinds[gas.meta[s][KIND]][KIND_RADIUS]


@ti.func
def clear(s, gas: ti.template()):
    """Make a disk ready for a new epoch: no collisions, no neighbours, no event."""
    gas.flight[s][TAU] = 0.0
    gas.flight[s][TE] = FAR
    gas.link[s][PARTNER] = -1
    gas.link[s][HEAD] = -1
    gas.link[s][SEQ] = 0
    gas.link[s][ACTIVE] = -1
    gas.link[s][DIRTY] = -1
    gas.link[s][AFFECTED] = -1
    gas.link[s][UNDO] = NEVER
    gas.link[s][LENGTH] = 0


@ti.kernel
def settle(
    telling: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, meta: Rows, image: Rows,
    link: Rows, cell: Rows, log_real: Rows, log_int: Rows, log_loss: Rows, start: Rows, fill: Rows, block: Rows,
    order: Rows, squares: Rows, limit: Rows, law: Cube, walls: Rows, wall_hits: Rows, wall_work: Rows, wall_heat: Table,
    latest: Rows, flow_work: Rows, losses: Table, losses_whole: Table, regimes: Rows, last_partner: Rows, angle: Rows,
    counter: Rows, sums: Table,
):  # fmt: skip
    """Fly every disk on by `gas.scale[DURATION]`, count its collisions, and sort by cell, within a cell by id.

    Counting sort: `start` (cells + 1,) gets the first slot of each cell, `order` (n,) the old slot of each new one.
    Slots within a cell come from atomics in any order; sorting them by id makes the result independent of threads.
    `limit` gets the largest and the mean square speed; `sums`, if `telling` is 1, what `totals` gives, at next to no
    cost. `link` is cleared.
    The disks move by way of the log, whose records are lost.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, meta=meta, image=image, link=link, cell=cell,
        log_real=log_real, log_int=log_int, log_loss=log_loss, start=start, fill=fill, block=block,
        order=order, squares=squares, limit=limit, law=law, walls=walls, wall_hits=wall_hits, wall_work=wall_work,
        wall_heat=wall_heat, latest=latest, flow_work=flow_work, losses=losses, losses_whole=losses_whole,
        regimes=regimes, last_partner=last_partner, angle=angle, counter=counter, uses=uses,
    ))  # fmt: skip
    for c in range(n_cells(gas)):
        gas.fill[c] = 0
    for _ in range(1):
        gas.limit[EARLIEST] = FAR
    if ti.static(gas.uses.tallied):
        for item in range(SPREAD * n_record_blocks(gas)):
            if item % SPREAD == 0:
                weigh(item // SPREAD, gas)
        for item in range(SPREAD * n_record_blocks(gas)):
            if item % SPREAD == 0:
                tally(item // SPREAD, gas)
        for _ in range(1):
            close_tally(gas)
    for i in range(gas.grid[N]):
        fly(i, gas)
    for item in range(SPREAD * n_blocks(n_cells(gas))):
        if item % SPREAD == 0:
            sum_block(item // SPREAD, n_cells(gas), gas)
    for _ in range(1):
        scan_blocks(n_blocks(n_cells(gas)), gas)
        gas.start[n_cells(gas)] = gas.grid[N]
        gas.limit[FASTEST] = 0.0
    for item in range(SPREAD * n_blocks(n_cells(gas))):
        if item % SPREAD == 0:
            scan_block(item // SPREAD, n_cells(gas), gas)
    for i in range(gas.grid[N]):
        gas.order[ti.atomic_add(gas.fill[gas.cell[i]], 1)] = i
    for c in range(n_cells(gas)):
        order_cell(c, gas)
    for s in range(gas.grid[N]):
        lay_aside(s, gas.order[s], gas)
    for s in range(gas.grid[N]):
        put_back(s, gas)
        clear(s, gas)
    for item in range(SPREAD * n_blocks(gas.grid[N])):
        if item % SPREAD == 0:
            b = item // SPREAD
            fastest2 = gas.limit[FASTEST] * 0.0
            sum2 = gas.limit[FASTEST] * 0.0
            total = ti.Vector([0.0] * TOTALS, ti.f64)
            for s in range(b * BLOCK, ti.min(gas.grid[N], (b + 1) * BLOCK)):
                speed2 = speed2_in_flow(s, gas)
                fastest2 = ti.max(fastest2, speed2)
                sum2 += speed2
                if telling == 1:
                    count_in(s, total, gas)
            if telling == 1:
                for column in ti.static(range(TOTALS)):
                    sums[b, column] = total[column]
            ti.atomic_max(gas.limit[FASTEST], ti.sqrt(fastest2))
            gas.squares[b] = sum2
    for _ in range(1):
        # Block by block: the order of a sum of rounded numbers matters.
        total = gas.limit[FASTEST] * 0.0
        for b in range(n_blocks(gas.grid[N])):
            total += gas.squares[b]
        gas.limit[MEAN_SQUARE] = total / ti.max(gas.grid[N], 1)


@ti.kernel
def export(
    now: ti.f64, uses: ti.template(), grid: Rows, scale: Rows, clock: Rows, flight: Rows, kinds: Rows,
    meta: Rows, image: Rows, cell: Rows, real_out: Table, int_out: Table,
):  # fmt: skip
    """Settled disks in id order: x, y, vx, vy, spin into `real_out` (n, 6); collisions, crossings into `int_out`.

    These collisions are with disks and walls. In a sheared gas, `now` is the time, and the last column of `real_out`
    gets by how much the kinetic energy in the frame of the disk's row of tiles is more than that in the mean flow.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, clock=clock, flight=flight, kinds=kinds, meta=meta, image=image, cell=cell,
        uses=uses,
    ))  # fmt: skip
    for s in range(gas.grid[N]):
        i = gas.meta[s][ID]
        tile = gas.cell[s] // (gas.grid[CELLS_X] * gas.grid[CELLS_Y])
        real_out[i, 0] = (tile // gas.grid[TILES_Y]) * gas.scale[TILE_X] + gas.flight[s][X]
        real_out[i, 1] = (tile % gas.grid[TILES_Y]) * gas.scale[TILE_Y] + gas.flight[s][Y]
        real_out[i, 2] = gas.flight[s][VX]
        real_out[i, 3] = gas.flight[s][VY]
        real_out[i, 4] = gas.flight[s][SPIN]
        int_out[i, 0] = gas.meta[s][EVENTS]
        int_out[i, 1] = gas.image[i][0]
        int_out[i, 2] = gas.image[i][1]
        if ti.static(gas.uses.sheared):
            row = tile % gas.grid[TILES_Y]
            corner = (tile // gas.grid[TILES_Y]) * gas.clock[TILE_SIDE]
            x, boxes = lab_x(corner, gas.flight[s][X], row, now, gas)
            real_out[i, 0] = x
            int_out[i, 1] += boxes
            real_out[i, 2] += frame_speed(row, gas)
            flow = ti.cast(flow_at(gas.flight[s][Y], gas), ti.f64)
            mass = 1.0 / gas.kinds[gas.meta[s][KIND]][INVERSE_MASS]
            real_out[i, 5] = mass * flow * (gas.flight[s][VX] - 0.5 * flow)
