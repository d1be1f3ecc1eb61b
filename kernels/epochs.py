"""Whole epochs, one after another, by one thread: for systems so small that starting threads would cost more."""

from .extend import AT_START_ALONE, extend, raise_level
from .language import ti
from .layout import (
    BEGAN,
    BEGIN,
    CELL_Y,
    CELLS_X,
    CELLS_Y,
    COLLISIONS_LEFT,
    DURATION,
    EARLIEST,
    END,
    FAR,
    FASTEST,
    GX,
    GY,
    HORIZON,
    LOG_FULL,
    MEAN_SQUARE,
    MOST_LEVEL,
    MOST_NEIGHBOURS,
    N_ELASTIC,
    N_ELASTIC_TOTAL,
    N_EPOCHS,
    N_STANDING,
    N_TOTAL,
    N_WALL_HITS,
    N_WALLS_TOTAL,
    NOW,
    PAUSE_AFTER,
    PAUSE_AT,
    PLANNED,
    REACH,
    RESTING,
    SHEAR,
    TIME_END,
    WALL_SPEED,
    WINDOW,
    Cube,
    GasArrays,
    N,
    Rows,
    Table,
)
from .ledger import close_tally, n_record_blocks, tally, weigh
from .levels import epoch_length, speed_cap, too_fast
from .lists import list_tile, open_epoch
from .shear import displace_rows, rows_apart, speed2_in_flow
from .sort import clear, fly, lay_aside, order_cell, put_back
from .tiles import run_tile
from .walls import offer_wall


@ti.kernel
def epochs_by_one_thread(
    most_epochs: ti.i32, uses: ti.template(), clock: Rows, total: Rows, grid: Rows, scale: Rows, flight: Rows,
    kinds: Rows, meta: Rows, image: Rows, link: Rows, cell: Rows, start: Rows, fill: Rows, order: Rows,
    neighbour: Rows, counter: Rows, limit: Rows, log_real: Rows, log_int: Rows, log_loss: Rows, law: Cube, walls: Rows,
    near_walls: Rows, wall_hits: Rows, wall_work: Rows, wall_heat: Table, latest: Rows, flow_work: Rows,
    losses: Table, losses_whole: Table, regimes: Rows, last_partner: Rows, angle: Rows,
):  # fmt: skip
    """Up to `most_epochs` epochs of a gas of one tile.

    Ends before that at `clock[TIME_END]`, after `total[COLLISIONS_LEFT]` collisions, when nothing moves, and when an
    epoch ended earlier than `clock[PLANNED]`, for the host to see to it; and with the first epoch that ends at or after
    `clock[PAUSE_AT]` or `total[PAUSE_AFTER]` collisions. `clock[NOW]` advances; what the last epoch
    left to fly is in `gas.scale[DURATION]`.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, meta=meta, image=image, link=link, cell=cell,
        start=start, fill=fill, order=order, neighbour=neighbour, counter=counter, limit=limit,
        log_real=log_real, log_int=log_int, log_loss=log_loss, law=law, walls=walls, near_walls=near_walls,
        wall_hits=wall_hits, wall_work=wall_work, wall_heat=wall_heat, latest=latest, flow_work=flow_work,
        losses=losses, losses_whole=losses_whole, regimes=regimes, last_partner=last_partner, angle=angle,
        clock=clock, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        n = gas.grid[N]
        cells = gas.grid[CELLS_X] * gas.grid[CELLS_Y]
        going = 1
        while going == 1:
            gas.limit[EARLIEST] = FAR
            for c in range(cells):
                gas.fill[c] = 0
            if ti.static(gas.uses.tallied):
                for b in range(n_record_blocks(gas)):
                    weigh(b, gas)
                for b in range(n_record_blocks(gas)):
                    tally(b, gas)
                close_tally(gas)
            for i in range(n):
                fly(i, gas)
            before = 0
            for c in range(cells):
                gas.start[c] = before
                before += gas.fill[c]
                gas.fill[c] = gas.start[c]
            gas.start[cells] = n
            for i in range(n):
                c = gas.cell[i]
                gas.order[gas.fill[c]] = i
                gas.fill[c] = gas.fill[c] + 1
            for c in range(cells):
                order_cell(c, gas)
            fastest2 = gas.scale[DURATION] * 0.0
            sum2 = gas.scale[DURATION] * 0.0
            for s in range(n):
                lay_aside(s, gas.order[s], gas)
            for s in range(n):
                put_back(s, gas)
                clear(s, gas)
                square = speed2_in_flow(s, gas)
                fastest2 = ti.max(fastest2, square)
                sum2 += square
            gas.scale[DURATION] = 0.0
            gas.limit[FASTEST] = ti.sqrt(fastest2)
            gas.limit[MEAN_SQUARE] = sum2 / n
            gas.counter[MOST_NEIGHBOURS] = 0
            gas.counter[LOG_FULL] = 0
            pull = ti.sqrt(gas.scale[GX] * gas.scale[GX] + gas.scale[GY] * gas.scale[GY])
            still = fastest2 + pull + gas.scale[WALL_SPEED] == 0.0
            if ti.static(gas.uses.sheared):
                still = False  # the flow moves
                displace_rows(gas)
            if still or gas.limit[EARLIEST] < FAR:
                going = 0
            else:
                cap = speed_cap(gas.limit[FASTEST], gas.limit[MEAN_SQUARE], gas.grid[MOST_LEVEL])
                if ti.static(gas.uses.sheared):
                    cap += rows_apart(gas.scale[SHEAR], gas.scale[CELL_Y])
                whole = epoch_length(gas.scale[REACH], cap, gas.scale[WALL_SPEED], pull)
                left = clock[TIME_END] - clock[NOW]
                last = 0
                if left <= whole:
                    whole = ti.cast(left, float)
                    last = 1
                gas.scale[HORIZON] = whole
                gas.scale[BEGIN] = 0.0
                gas.scale[WINDOW] = gas.scale[HORIZON]
                clock[PLANNED] = gas.scale[HORIZON]
                open_epoch(gas)
                list_tile(0, gas)
                fast = 0
                for i in range(n):
                    level = too_fast(i, gas)
                    if level > 0 and gas.counter[MOST_NEIGHBOURS] == 0:
                        raise_level(i, level, AT_START_ALONE, gas)
                        gas.order[fast] = i
                        fast += 1
                for q in range(fast):
                    extend(gas.order[q], AT_START_ALONE, gas)
                if ti.static(gas.uses.walled):
                    for i in range(n):
                        offer_wall(i, gas)
                if gas.counter[MOST_NEIGHBOURS] > 0:
                    going = 0
                else:
                    most = ti.cast(ti.min(total[COLLISIONS_LEFT], 1 << 30), ti.i32)
                    run_tile(0, n, True, most, gas)
                    if gas.counter[MOST_NEIGHBOURS] > 0:
                        going = 0
                if going == 1:
                    gas.scale[DURATION] = gas.limit[END]
                    total[N_EPOCHS] += 1
                    total[N_TOTAL] += gas.counter[N_STANDING]
                    total[N_WALLS_TOTAL] += gas.counter[N_WALL_HITS]
                    total[N_ELASTIC_TOTAL] += gas.counter[N_ELASTIC]
                    total[COLLISIONS_LEFT] -= gas.counter[N_STANDING]
                    most_epochs_left = most_epochs - ti.cast(total[N_EPOCHS], ti.i32)
                    if gas.limit[END] < gas.scale[HORIZON] or gas.counter[RESTING] > 0:
                        going = 0
                        last = 0
                    clock[BEGAN] = clock[NOW]
                    if last == 1:
                        clock[NOW] = clock[TIME_END]
                        going = 0
                    else:
                        clock[NOW] += gas.limit[END]
                    if total[COLLISIONS_LEFT] <= 0 or most_epochs_left <= 0:
                        going = 0
                    if clock[NOW] >= clock[PAUSE_AT] or total[N_TOTAL] >= total[PAUSE_AFTER]:
                        going = 0
