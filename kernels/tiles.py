"""The collisions inside one tile, in their order, by one thread; then what tiles must settle with each other.

A tile runs like a serial event-driven code: the earliest event of its disks is next. Bins over the window's time
take the place of a heap. What involves a disk of another tile is left alone: a disk whose earliest event is with one
is *held*, and so is every disk whose earliest event is with a held one. Meetings with disks of other tiles that came
up only in this run are not looked for; `join_tiles` does that afterwards, undoes what happened too early, and
opens the rounds, which do the rest.
"""

import taichi as ti

from .events import collide_at, predict, propagate, restore
from .extend import AT_START, LATER, extend, push, raise_level, too_fast
from .layout import (
    ACTIVE,
    AFFECTED,
    AFFECTED_ROW,
    BEFORE,
    BEGIN,
    CELLS_X,
    CELLS_Y,
    CHANGED_ROW,
    END,
    EXTEND_ROW,
    FAR,
    HEAD,
    HORIZON,
    ID,
    LENGTH,
    LEVEL,
    LOG_CAPACITY,
    LOG_FULL,
    MOST_NEIGHBOURS,
    N_LOG,
    N_STANDING,
    N_VIOLATIONS,
    NEVER,
    NEXT,
    NUMBER,
    PARTNER,
    PREVIOUS,
    PREVIOUS_IN_BIN,
    RADIUS,
    ROLL_BACK,
    ROLLED_BACK,
    ROUND,
    ROW,
    SAME_FRAME,
    SLOT,
    SPREAD,
    STANDS,
    TAU,
    TE,
    TILE_X,
    TILE_Y,
    TILES_X,
    TILES_Y,
    TIME,
    TOP_LEVEL,
    UNDO,
    UNDO_ROW,
    VX,
    VY,
    WINDOW,
    N,
    X,
    Y,
    meeting_time,
    n_others,
    n_own,
    precedes,
    sooner,
)
from .lists import offer
from .rounds import next_round

CHUNK = 32  # log records that a tile takes at a time
# In place of the disk before in a bin: nobody knows of this disk; it is held; it is the first of bin FIRST - b.
OUT, HELD, FIRST = -1, -2, -3
UNSURE = -2  # in place of a stamp: this disk predicted without looking at other tiles


@ti.func
def enqueue(
    i, low, bins, begin, rate, flight: ti.template(), link: ti.template(), order: ti.template(), window
):
    """Put disk i into the bin of its event, if that lies in the window."""
    t = flight[i][TE]
    link[i][PREVIOUS_IN_BIN] = OUT
    if t < window:
        b = low + ti.min(ti.cast((t - begin) * rate, ti.i32), bins - 1)
        first = order[b]
        link[i][NEXT] = first
        link[i][PREVIOUS_IN_BIN] = FIRST - b
        if first >= 0:
            link[first][PREVIOUS_IN_BIN] = i
        order[b] = i


@ti.func
def dequeue(i, link: ti.template(), order: ti.template()):
    """Take disk i out of its bin, if it is in one."""
    before = link[i][PREVIOUS_IN_BIN]
    if before >= 0 or before <= FIRST:
        after = link[i][NEXT]
        if before >= 0:
            link[before][NEXT] = after
        else:
            order[FIRST - before] = after
        if after >= 0:
            link[after][PREVIOUS_IN_BIN] = before
        link[i][PREVIOUS_IN_BIN] = OUT


@ti.func
def earliest_of_bin(b, flight: ti.template(), link: ti.template(), order: ti.template(), meta: ti.template()):
    """The disk with the earliest event of a bin; -1 if that is empty. Ties fall to the smaller pair of ids."""
    best = order[b]
    if best >= 0:
        t = flight[best][TE]
        j = link[best][NEXT]
        while j >= 0:
            t_j = flight[j][TE]
            if t_j < t:
                best = j
                t = t_j
            elif t_j == t:
                p, q = link[best][PARTNER] // 9, link[j][PARTNER] // 9
                if precedes(meta[j][ID], meta[q][ID], meta[best][ID], meta[p][ID]):
                    best = j
            j = link[j][NEXT]
    return best


@ti.func
def predict_in_order(
    i,
    now,
    low,
    high,
    begin,
    rate,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    order: ti.template(),
    neighbour: ti.template(),
):
    """Disk i's earliest event with a disk of its tile; whoever it meets earlier than his own event takes that one."""
    x, y, vx, vy = flight[i][X], flight[i][Y], flight[i][VX], flight[i][VY]
    tau, radius = flight[i][TAU], flight[i][RADIUS]
    head = link[i][HEAD]
    horizon = scale[HORIZON]
    row = grid[ROW]
    lengths = link[i][LENGTH]
    own = n_own(lengths)
    if n_others(lengths) > 0:
        link[i][AFFECTED] = UNSURE
    earliest = FAR
    partner = -1
    for q in range(own + n_others(lengths)):
        j = 0
        shift = SAME_FRAME
        shift_x = 0.0
        shift_y = 0.0
        if q < own:
            j = neighbour[row * i + q]
        else:
            code = neighbour[row * i + row - 1 - (q - own)]
            j = code // 9
            shift = code - 9 * j
            shift_x = (shift // 3 - 1) * scale[TILE_X]
            shift_y = (shift % 3 - 1) * scale[TILE_Y]
        if j >= low and j < high:
            before = ti.min(horizon, ti.max(earliest, flight[j][TE]))
            t = meeting_time(
                x, y, vx, vy, tau,
                flight[j][X], flight[j][Y], flight[j][VX], flight[j][VY], flight[j][TAU],
                shift_x, shift_y, radius + flight[j][RADIUS], before,
            )  # fmt: skip
            if t <= before:
                # A pair whose latest collision was with each other separates: it cannot meet again.
                if head < 0 or head != link[j][HEAD]:
                    if sooner(t, j, earliest, partner, horizon, meta):
                        earliest = t
                        partner = 9 * j + shift
                    if t <= flight[j][TE]:
                        if link[j][PREVIOUS_IN_BIN] != HELD and sooner(
                            t, i, flight[j][TE], link[j][PARTNER], horizon, meta
                        ):
                            dequeue(j, link, order)
                            flight[j][TE] = t
                            link[j][PARTNER] = 9 * i + 8 - shift
                            enqueue(j, low, high - low, begin, rate, flight, link, order, scale[WINDOW])
    flight[i][TE] = earliest
    link[i][PARTNER] = partner
    if earliest < now:
        # Only a held disk, which does not tell anybody where it flies, can have been met already.
        link[i][PREVIOUS_IN_BIN] = HELD
    else:
        enqueue(i, low, high - low, begin, rate, flight, link, order, scale[WINDOW])


@ti.func
def run_tile(
    low,
    high,
    alone: ti.template(),
    most,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    kinds: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    cell: ti.template(),
    start: ti.template(),
    order: ti.template(),
    neighbour: ti.template(),
    counter: ti.template(),
    limit: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
    law: ti.template(),
):
    """All collisions of slots [low, high) in the window, in order.

    `alone`: this tile is the whole gas. It then stops by itself at the end of the epoch (or when a disk becomes too
    fast), when the log is full, or after `most` collisions, and sets the epoch's end to where it stopped.
    """
    bins = high - low
    begin = scale[BEGIN]
    window = scale[WINDOW]
    rate = bins / (window - begin)
    for b in range(low, high):
        order[b] = -1
    for i in range(low, high):
        enqueue(i, low, bins, begin, rate, flight, link, order, window)
    done = 0
    free = 0
    chunk_end = 0
    b = low
    while b < high:
        i = earliest_of_bin(b, flight, link, order, meta)
        if i < 0:
            b += 1
        else:
            t = flight[i][TE]
            code = link[i][PARTNER]
            j = code // 9
            shift = code - 9 * j
            if ti.static(alone):
                if t >= limit[END]:
                    b = high
            if b < high:
                if j < low or j >= high:
                    dequeue(i, link, order)
                    link[i][PREVIOUS_IN_BIN] = HELD
                elif link[j][PARTNER] == 9 * i + 8 - shift and flight[j][TE] == t:
                    if free == chunk_end:
                        free = ti.atomic_add(counter[N_LOG], CHUNK)
                        chunk_end = free + CHUNK
                        if chunk_end > grid[LOG_CAPACITY]:
                            ti.atomic_sub(counter[N_LOG], CHUNK)
                            counter[LOG_FULL] = 2
                            chunk_end = free
                            b = high
                            if ti.static(alone):
                                limit[END] = t
                    if b < high:
                        dequeue(i, link, order)
                        dequeue(j, link, order)
                        if i > j:
                            shift = 8 - shift
                        collide_at(
                            free, t, ti.min(i, j), ti.max(i, j), shift,
                            grid, scale, flight, kinds, link, meta, limit, log_real, log_int, law,
                        )  # fmt: skip
                        free += 1
                        done += 1
                        for member in range(2):
                            m = i + member * (j - i)
                            level = too_fast(m, grid, scale, flight, link)
                            if ti.static(alone):
                                if level > 0:
                                    raise_level(m, level, link, counter)
                                    extend(
                                        m, LATER, grid, scale, flight, link, meta, cell, start, neighbour,
                                        link, counter, log_real, log_int,
                                    )  # fmt: skip
                                    if counter[MOST_NEIGHBOURS] > 0:
                                        b = high
                                    level = 0
                            if level > 0:
                                # Its list may need disks of other tiles: the rounds see to it.
                                flight[m][TE] = FAR
                                link[m][PARTNER] = ROLLED_BACK
                                link[m][AFFECTED] = UNSURE
                                link[m][PREVIOUS_IN_BIN] = HELD
                            else:
                                predict_in_order(
                                    m,
                                    t,
                                    low,
                                    high,
                                    begin,
                                    rate,
                                    grid,
                                    scale,
                                    flight,
                                    link,
                                    meta,
                                    order,
                                    neighbour,
                                )
                        if ti.static(alone):
                            if done == most:
                                limit[END] = t
                                b = high
                elif link[j][PREVIOUS_IN_BIN] == HELD:
                    dequeue(i, link, order)
                    link[i][PREVIOUS_IN_BIN] = HELD
                else:
                    # The partner has changed meanwhile.
                    dequeue(i, link, order)
                    predict_in_order(
                        i, t, low, high, begin, rate, grid, scale, flight, link, meta, order, neighbour
                    )
    for entry in range(free, chunk_end):
        log_int[entry][STANDS] = 0
    ti.atomic_add(counter[N_STANDING], done)
    # Whom the tiles' meeting must look at: those at a border, and those that still wait.
    last = low
    if ti.static(not alone):
        for i in range(low, high):
            link[i][NEXT] = -1  # these columns now serve the rounds again
            link[i][PREVIOUS_IN_BIN] = -1
            if n_others(link[i][LENGTH]) > 0 or flight[i][TE] < window or link[i][PARTNER] == ROLLED_BACK:
                order[last] = i
                last += 1
    return last - low


@ti.kernel
def run_tiles(
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    kinds: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
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
    """All tiles at once, one thread each, up to the end of the window.

    `order` and `fill` get, from each tile's first slot on, the disks that `join_tiles` must look at, and their number.
    """
    for item in range(SPREAD * grid[TILES_X] * grid[TILES_Y]):
        if item % SPREAD == 0:
            cells = grid[CELLS_X] * grid[CELLS_Y]
            low = start[item // SPREAD * cells]
            high = start[(item // SPREAD + 1) * cells]
            if high > low:
                fill[item // SPREAD] = run_tile(
                    low, high, False, 0,
                    grid, scale, flight, kinds, link, meta, cell, start, order, neighbour, counter, limit,
                    log_real, log_int, law,
                )  # fmt: skip
            else:
                fill[item // SPREAD] = 0


@ti.func
def side_of(entry, i, log_int: ti.template()):
    """Which side of a log record disk i is."""
    side = 0
    if log_int[entry][SLOT] != i:
        side = 1
    return side


@ti.func
def mark(i, number, link: ti.template(), lists: ti.template(), counter: ti.template()):
    """Undo disk i's collisions from that number on."""
    if ti.atomic_min(link[i][UNDO], number) == NEVER:
        push(UNDO_ROW, i, lists, counter)


@ti.func
def check_history(
    i,
    j,
    shift,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    lists: ti.template(),
    counter: ti.template(),
    log_real: ti.template(),
    log_int: ti.template(),
):
    """Test every flight of disk i against every flight of disk j that it overlaps in time.

    The earliest meeting that neither disk's collisions prevented undoes those that followed it.
    """
    sigma = flight[i][RADIUS] + flight[j][RADIUS]
    shift_x = (shift // 3 - 1) * scale[TILE_X]
    shift_y = (shift % 3 - 1) * scale[TILE_Y]
    horizon = scale[HORIZON]
    found = horizon
    undo_i = NEVER
    undo_j = NEVER
    # A flight ends with record `end_` (-1: not yet), and begins with record `begin_` (-1: with the epoch).
    end_i = -1
    begin_i = link[i][HEAD]
    more_i = 1
    while more_i == 1:
        stop_i = horizon
        start_i = 0.0 * horizon
        xi, yi, vxi, vyi = flight[i][X], flight[i][Y], flight[i][VX], flight[i][VY]
        number_i = NEVER
        other_i = -1
        if end_i >= 0:
            side = side_of(end_i, i, log_int)
            stop_i = log_real[end_i][TIME]
            number_i = log_int[end_i][NUMBER + side]
            other_i = log_int[end_i][SLOT + 1 - side]
            first = BEFORE + 5 * side
            xi, yi = log_real[end_i][first], log_real[end_i][first + 1]
            vxi, vyi = log_real[end_i][first + 2], log_real[end_i][first + 3]
        if begin_i >= 0:
            start_i = log_real[begin_i][TIME]
        end_j = -1
        begin_j = link[j][HEAD]
        more_j = 1
        while more_j == 1:
            stop_j = horizon
            start_j = 0.0 * horizon
            xj, yj, vxj, vyj = flight[j][X], flight[j][Y], flight[j][VX], flight[j][VY]
            number_j = NEVER
            other_j = -1
            if end_j >= 0:
                side = side_of(end_j, j, log_int)
                stop_j = log_real[end_j][TIME]
                number_j = log_int[end_j][NUMBER + side]
                other_j = log_int[end_j][SLOT + 1 - side]
                first = BEFORE + 5 * side
                xj, yj = log_real[end_j][first], log_real[end_j][first + 1]
                vxj, vyj = log_real[end_j][first + 2], log_real[end_j][first + 3]
            if begin_j >= 0:
                start_j = log_real[begin_j][TIME]
            if start_j < stop_i and start_i < stop_j and start_i < stop_i and start_j < stop_j:
                # Two flights that began with one collision separate; two that have not ended are for predictions.
                if (end_i >= 0 or end_j >= 0) and (begin_i < 0 or begin_i != begin_j):
                    before = ti.min(found, ti.min(stop_i, stop_j))
                    t = meeting_time(
                        xi, yi, vxi, vyi, start_i, xj, yj, vxj, vyj, start_j, shift_x, shift_y, sigma, before
                    )
                    real = t < found and t <= before
                    # An exact tie falls to the smaller pair of ids.
                    if t == stop_i and end_i >= 0:
                        real = real and precedes(meta[i][ID], meta[j][ID], meta[i][ID], meta[other_i][ID])
                    if t == stop_j and end_j >= 0:
                        real = real and precedes(meta[i][ID], meta[j][ID], meta[j][ID], meta[other_j][ID])
                    if real:
                        found = t
                        undo_i = number_i
                        undo_j = number_j
            # Older flights of j matter while they end after this flight of i begins.
            if begin_j < 0 or start_j <= start_i:
                more_j = 0
            else:
                end_j = begin_j
                begin_j = log_int[end_j][PREVIOUS + side_of(end_j, j, log_int)]
        if begin_i < 0:
            more_i = 0
        else:
            end_i = begin_i
            begin_i = log_int[end_i][PREVIOUS + side_of(end_i, i, log_int)]
    if found < horizon and grid[ROLL_BACK] == 1:
        ti.atomic_add(counter[N_VIOLATIONS], 1)
        if undo_i < NEVER:
            mark(i, undo_i, link, lists, counter)
        if undo_j < NEVER:
            mark(j, undo_j, link, lists, counter)


@ti.func
def look_across(
    i,
    grid: ti.template(),
    scale: ti.template(),
    flight: ti.template(),
    link: ti.template(),
    meta: ti.template(),
    neighbour: ti.template(),
):
    """Predict disk i's meetings with disks of other tiles, where either of the two has changed or forgotten the other.

    Writes only what is disk i's own: the other disk looks for itself.
    """
    row = grid[ROW]
    horizon = scale[HORIZON]
    for q in range(n_others(link[i][LENGTH])):
        code = neighbour[row * i + row - 1 - q]
        j = code // 9
        if link[i][AFFECTED] == UNSURE or link[j][AFFECTED] == UNSURE:
            shift = code - 9 * j
            if link[i][HEAD] < 0 or link[i][HEAD] != link[j][HEAD]:
                t = meeting_time(
                    flight[i][X], flight[i][Y], flight[i][VX], flight[i][VY], flight[i][TAU],
                    flight[j][X], flight[j][Y], flight[j][VX], flight[j][VY], flight[j][TAU],
                    (shift // 3 - 1) * scale[TILE_X], (shift % 3 - 1) * scale[TILE_Y],
                    flight[i][RADIUS] + flight[j][RADIUS], ti.min(horizon, flight[i][TE]),
                )  # fmt: skip
                offer(i, t, code, horizon, flight, link, meta)


@ti.func
def still_true(i, scale: ti.template(), flight: ti.template(), link: ti.template()):
    """Whether disk i's event is one of its present flight and its partner's; if that was rolled back, it will tell."""
    code = link[i][PARTNER]
    j = code // 9
    shift = code - 9 * j
    true = 1
    if link[j][PARTNER] != ROLLED_BACK and link[j][PARTNER] != 9 * i + 8 - shift:
        t = meeting_time(
            flight[i][X], flight[i][Y], flight[i][VX], flight[i][VY], flight[i][TAU],
            flight[j][X], flight[j][Y], flight[j][VX], flight[j][VY], flight[j][TAU],
            (shift // 3 - 1) * scale[TILE_X], (shift % 3 - 1) * scale[TILE_Y],
            flight[i][RADIUS] + flight[j][RADIUS], scale[HORIZON],
        )  # fmt: skip
        if t != flight[i][TE] or (link[i][HEAD] >= 0 and link[i][HEAD] == link[j][HEAD]):
            true = 0
    elif link[j][PARTNER] != ROLLED_BACK and flight[j][TE] != flight[i][TE]:
        true = 0
    return true


@ti.kernel
def join_tiles(
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    fill: ti.types.ndarray(ndim=1),
    order: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    lists: ti.types.ndarray(ndim=2),
    counter: ti.types.ndarray(ndim=1),
    log_real: ti.types.ndarray(ndim=1),
    log_int: ti.types.ndarray(ndim=1),
):
    """After the tiles ran: undo what a disk of another tile should have prevented, and open the rounds.

    Active in the first round are all disks with an event in the window. Disks that may not know their earliest event
    predict anew in it: those that were rolled back or became too fast, and those whose partner has changed since.
    """
    for item in range(SPREAD * grid[TILES_X] * grid[TILES_Y]):
        if item % SPREAD == 0:
            tile = item // SPREAD
            low = start[tile * grid[CELLS_X] * grid[CELLS_Y]]
            for place in range(low, low + fill[tile]):
                i = order[place]
                for q in range(n_others(link[i][LENGTH])):
                    code = neighbour[grid[ROW] * i + grid[ROW] - 1 - q]
                    j = code // 9
                    if i < j and (link[i][HEAD] >= 0 or link[j][HEAD] >= 0):
                        if cell[j] // (grid[CELLS_X] * grid[CELLS_Y]) != tile:
                            check_history(
                                i,
                                j,
                                code - 9 * j,
                                grid,
                                scale,
                                flight,
                                link,
                                meta,
                                lists,
                                counter,
                                log_real,
                                log_int,
                            )
    for _ in range(1):
        propagate(link, lists, counter, log_int)
    for q in range(counter[UNDO_ROW]):
        restore(lists[UNDO_ROW, q], flight, link, counter, log_real, log_int)
        link[lists[UNDO_ROW, q]][AFFECTED] = -1
    for item in range(SPREAD * grid[TILES_X] * grid[TILES_Y]):
        if item % SPREAD == 0:
            low = start[item // SPREAD * grid[CELLS_X] * grid[CELLS_Y]]
            for place in range(low, low + fill[item // SPREAD]):
                if link[order[place]][PARTNER] != ROLLED_BACK:
                    look_across(order[place], grid, scale, flight, link, meta, neighbour)
    for item in range(SPREAD * grid[TILES_X] * grid[TILES_Y]):
        if item % SPREAD == 0:
            low = start[item // SPREAD * grid[CELLS_X] * grid[CELLS_Y]]
            now = counter[ROUND] % 2
            for place in range(low, low + fill[item // SPREAD]):
                i = order[place]
                if link[i][PARTNER] == ROLLED_BACK:
                    if link[i][AFFECTED] == UNSURE:  # not among those to be rolled back: it became too fast
                        push(CHANGED_ROW + now, i, lists, counter)
                elif flight[i][TE] < scale[WINDOW]:
                    if still_true(i, scale, flight, link) == 1:
                        push(AFFECTED_ROW + now, i, lists, counter)
                        link[i][ACTIVE] = counter[ROUND] + 1
                    else:
                        push(CHANGED_ROW + now, i, lists, counter)
    for q in range(counter[CHANGED_ROW + counter[ROUND] % 2]):
        # From here on the same as a disk that was rolled back.
        i = lists[CHANGED_ROW + counter[ROUND] % 2, q]
        link[i][PARTNER] = ROLLED_BACK
        flight[i][TE] = FAR
    for _ in range(1):
        now = counter[ROUND] % 2
        q = 0
        while q < counter[CHANGED_ROW + now]:
            push(UNDO_ROW, lists[CHANGED_ROW + now, q], lists, counter)
            q += 1
        counter[CHANGED_ROW + now] = 0
        next_round(grid, lists, counter, link)


@ti.kernel
def extend_fast(
    grid: ti.types.ndarray(ndim=1),
    scale: ti.types.ndarray(ndim=1),
    flight: ti.types.ndarray(ndim=1),
    link: ti.types.ndarray(ndim=1),
    meta: ti.types.ndarray(ndim=1),
    cell: ti.types.ndarray(ndim=1),
    start: ti.types.ndarray(ndim=1),
    neighbour: ti.types.ndarray(ndim=1),
    lists: ti.types.ndarray(ndim=2),
    counter: ti.types.ndarray(ndim=1),
    log_real: ti.types.ndarray(ndim=1),
    log_int: ti.types.ndarray(ndim=1),
):
    """Longer lists for the disks that are too fast at the beginning of the epoch."""
    for i in range(grid[N]):
        level = too_fast(i, grid, scale, flight, link)
        if level > 0:
            push(EXTEND_ROW, i, lists, counter)
            link[i][LENGTH] += level * LEVEL
            ti.atomic_max(counter[TOP_LEVEL], level)
    for q in range(counter[EXTEND_ROW]):
        extend(
            lists[EXTEND_ROW, q], AT_START,
            grid, scale, flight, link, meta, cell, start, neighbour, lists, counter, log_real, log_int,
        )  # fmt: skip
    for q in range(counter[AFFECTED_ROW]):
        i = lists[AFFECTED_ROW, q]
        predict(i, False, grid, scale, flight, link, meta, neighbour, lists, counter, log_real, log_int)
        link[i][AFFECTED] = -1
    for _ in range(1):
        counter[EXTEND_ROW] = 0
        counter[AFFECTED_ROW] = 0
