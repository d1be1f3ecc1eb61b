"""Whole epochs, one after another, by one thread: for systems so small that starting threads would cost more."""

import taichi as ti

from .extend import AT_START_ALONE, extend, speed_cap, too_fast
from .layout import (
    BEGIN,
    CELLS_X,
    CELLS_Y,
    COLLISIONS_LEFT,
    DURATION,
    EARLIEST,
    END,
    FAR,
    FASTEST,
    HORIZON,
    LENGTH,
    LEVEL,
    LOG_FULL,
    MEAN_SQUARE,
    MOST_LEVEL,
    MOST_NEIGHBOURS,
    N_EPOCHS,
    N_STANDING,
    N_TOTAL,
    NOW,
    PLANNED,
    REACH,
    TIME_END,
    TOP_LEVEL,
    VX,
    VY,
    WINDOW,
    N,
)
from .lists import list_tile, open_epoch
from .sort import clear, fly, lay_aside, order_cell, put_back
from .tiles import run_tile


@ti.kernel
def epochs_by_one_thread(
    most_epochs: ti.i32,
    clock: ti.types.ndarray(ndim=1),
    total: ti.types.ndarray(ndim=1),
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    kinds: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    image: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    fill: ti.types.ndarray(ndim=1),
    order: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    counter: ti.types.ndarray(ndim=1),
    limit: ti.types.ndarray(ndim=1),
    log_real: ti.types.ndarray(ndim=1),
    log_int: ti.types.ndarray(ndim=1),
    law: ti.types.ndarray(ndim=3),
):
    """Up to `most_epochs` epochs of a gas of one tile.

    Ends before that at `clock[TIME_END]`, after `total[COLLISIONS_LEFT]` collisions, when nothing moves, and when an
    epoch ended earlier than `clock[PLANNED]`, for the host to see to it. `clock[NOW]` advances; what the last epoch
    left to fly is in `scale[DURATION]`.
    """
    for _ in range(1):
        n = grid[N]
        cells = grid[CELLS_X] * grid[CELLS_Y]
        going = 1
        while going == 1:
            limit[EARLIEST] = FAR
            for c in range(cells):
                fill[c] = 0
            for i in range(n):
                fly(i, grid, scale, flight, meta, image, link, cell, fill, limit)
            before = 0
            for c in range(cells):
                start[c] = before
                before += fill[c]
                fill[c] = start[c]
            start[cells] = n
            for i in range(n):
                c = cell[i]
                order[fill[c]] = i
                fill[c] += 1
            for c in range(cells):
                order_cell(c, start, order, meta)
            fastest2 = scale[DURATION] * 0.0
            sum2 = scale[DURATION] * 0.0
            for s in range(n):
                lay_aside(s, order[s], flight, meta, cell, log_real, log_int)
            for s in range(n):
                put_back(s, flight, kinds, meta, cell, log_real, log_int)
                clear(s, flight, link)
                square = flight[s][VX] * flight[s][VX] + flight[s][VY] * flight[s][VY]
                fastest2 = ti.max(fastest2, square)
                sum2 += square
            scale[DURATION] = 0.0
            limit[FASTEST] = ti.sqrt(fastest2)
            limit[MEAN_SQUARE] = sum2 / n
            counter[MOST_NEIGHBOURS] = 0
            counter[LOG_FULL] = 0
            if fastest2 == 0.0 or limit[EARLIEST] < FAR:
                going = 0
            else:
                whole = scale[REACH] / speed_cap(limit[FASTEST], limit[MEAN_SQUARE], grid[MOST_LEVEL])
                left = clock[TIME_END] - clock[NOW]
                last = 0
                if left <= whole:
                    whole = left
                    last = 1
                scale[HORIZON] = whole
                scale[BEGIN] = 0.0
                scale[WINDOW] = scale[HORIZON]
                clock[PLANNED] = scale[HORIZON]
                open_epoch(scale, counter, limit)
                list_tile(0, grid, scale, flight, link, meta, start, neighbour, counter)
                fast = 0
                for i in range(n):
                    level = too_fast(i, grid, scale, flight, link)
                    if level > 0 and counter[MOST_NEIGHBOURS] == 0:
                        link[i][LENGTH] += level * LEVEL
                        counter[TOP_LEVEL] = ti.max(counter[TOP_LEVEL], level)
                        order[fast] = i
                        fast += 1
                for q in range(fast):
                    extend(
                        order[q], AT_START_ALONE,
                        grid, scale, flight, link, meta, cell, start, neighbour, link, counter, log_real, log_int,
                    )  # fmt: skip
                if counter[MOST_NEIGHBOURS] > 0:
                    going = 0
                else:
                    most = ti.cast(ti.min(total[COLLISIONS_LEFT], 1 << 30), ti.i32)
                    run_tile(
                        0, n, True, most,
                        grid, scale, flight, kinds, link, meta, cell, start, order, neighbour, counter,
                        limit, log_real, log_int, law,
                    )  # fmt: skip
                    if counter[MOST_NEIGHBOURS] > 0:
                        going = 0
                if going == 1:
                    scale[DURATION] = limit[END]
                    total[N_EPOCHS] += 1
                    total[N_TOTAL] += counter[N_STANDING]
                    total[COLLISIONS_LEFT] -= counter[N_STANDING]
                    most_epochs_left = most_epochs - ti.cast(total[N_EPOCHS], ti.i32)
                    if limit[END] < scale[HORIZON]:
                        going = 0
                        last = 0
                    if last == 1:
                        clock[NOW] = clock[TIME_END]
                        going = 0
                    else:
                        clock[NOW] += limit[END]
                    if total[COLLISIONS_LEFT] <= 0 or most_epochs_left <= 0:
                        going = 0
