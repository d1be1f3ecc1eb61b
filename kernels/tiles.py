"""The collisions inside one tile, in their order, by one thread; then what tiles must settle with each other.

A tile runs like a serial event-driven code: the earliest event of its disks is next. Bins over the window's time
take the place of a heap. What involves a disk of another tile is left alone: a disk whose earliest event is with one
is *held*, and so is every disk whose earliest event is with a held one. Meetings with disks of other tiles that came
up only in this run are not looked for; `join_tiles` does that afterwards, undoes what happened too early, and
opens the rounds, which do the rest.
"""

from .events import collide_at
from .extend import LATER, extend, raise_level
from .flights import id_of, meeting_time, precedes, shift_by, sooner
from .language import ti
from .layout import (
    AFFECTED,
    BEGIN,
    CELLS_X,
    CELLS_Y,
    END,
    FAR,
    FIRST_WALL,
    HEAD,
    HORIZON,
    ID,
    LENGTH,
    LOG_CAPACITY,
    LOG_FULL,
    MOST_NEIGHBOURS,
    N_LOG,
    N_STANDING,
    NEXT,
    PARTNER,
    PREVIOUS_IN_BIN,
    RADIUS,
    RESTING,
    ROLLED_BACK,
    ROW,
    SAME_FRAME,
    SPREAD,
    STANDS,
    TAU,
    TE,
    TILES_X,
    TILES_Y,
    VX,
    VY,
    WINDOW,
    Cube,
    GasArrays,
    N,
    Rows,
    X,
    Y,
    n_others,
    n_own,
)
from .levels import too_fast
from .walls import first_wall, hit_wall

CHUNK = 32  # log records that a tile takes at a time
# In place of the disk before in a bin: nobody knows of this disk; it is held; it is the first of bin FIRST - b.
OUT, HELD, FIRST = -1, -2, -3
# What the earliest event is: a collision with a disk or a wall; one that must wait; none any more.
WITH_DISK, WITH_WALL, WITH_HELD, NOT_DUE = range(4)
UNSURE = -2  # in place of a stamp: this disk predicted without looking at other tiles


@ti.func
def enqueue(i, low, bins, begin, rate, window, gas: ti.template()):
    """Put disk i into the bin of its event, if that lies in the window."""
    t = gas.flight[i][TE]
    gas.link[i][PREVIOUS_IN_BIN] = OUT
    if t < window:
        b = low + ti.min(ti.cast((t - begin) * rate, ti.i32), bins - 1)
        first = gas.order[b]
        gas.link[i][NEXT] = first
        gas.link[i][PREVIOUS_IN_BIN] = FIRST - b
        if first >= 0:
            gas.link[first][PREVIOUS_IN_BIN] = i
        gas.order[b] = i


@ti.func
def dequeue(i, gas: ti.template()):
    """Take disk i out of its bin, if it is in one."""
    before = gas.link[i][PREVIOUS_IN_BIN]
    if before >= 0 or before <= FIRST:
        after = gas.link[i][NEXT]
        if before >= 0:
            gas.link[before][NEXT] = after
        else:
            gas.order[FIRST - before] = after
        if after >= 0:
            gas.link[after][PREVIOUS_IN_BIN] = before
        gas.link[i][PREVIOUS_IN_BIN] = OUT


@ti.func
def earliest_of_bin(b, gas: ti.template()):
    """The disk with the earliest event of a bin; -1 if that is empty. Ties fall to the smaller pair of ids."""
    best = gas.order[b]
    if best >= 0:
        t = gas.flight[best][TE]
        j = gas.link[best][NEXT]
        while j >= 0:
            t_j = gas.flight[j][TE]
            if t_j < t:
                best = j
                t = t_j
            elif t_j == t:
                p, q = id_of(gas.link[best][PARTNER], gas), id_of(gas.link[j][PARTNER], gas)
                if precedes(gas.meta[j][ID], q, gas.meta[best][ID], p):
                    best = j
            j = gas.link[j][NEXT]
    return best


@ti.func
def predict_in_order(i, now, low, high, begin, rate, gas: ti.template()):
    """Disk i's earliest event with a disk of its tile; whoever it meets earlier than his own event takes that one."""
    x, y, vx, vy = gas.flight[i][X], gas.flight[i][Y], gas.flight[i][VX], gas.flight[i][VY]
    tau, radius = gas.flight[i][TAU], gas.flight[i][RADIUS]
    head = gas.link[i][HEAD]
    horizon = gas.scale[HORIZON]
    row = gas.grid[ROW]
    lengths = gas.link[i][LENGTH]
    own = n_own(lengths)
    if n_others(lengths) > 0:
        gas.link[i][AFFECTED] = UNSURE
    earliest = FAR
    partner = -1
    for q in range(own + n_others(lengths)):
        j = 0
        shift = SAME_FRAME
        shift_x = 0.0
        shift_y = 0.0
        drift = 0.0
        if q < own:
            j = gas.neighbour[row * i + q]
        else:
            code = gas.neighbour[row * i + row - 1 - (q - own)]
            j = code // 9
            shift = code - 9 * j
            shift_x, shift_y, drift = shift_by(shift, gas)
        if j >= low and j < high:
            before = ti.min(horizon, ti.max(earliest, gas.flight[j][TE]))
            t = meeting_time(
                x, y, vx, vy, tau,
                gas.flight[j][X], gas.flight[j][Y], gas.flight[j][VX], gas.flight[j][VY], gas.flight[j][TAU],
                shift_x, shift_y, drift, radius + gas.flight[j][RADIUS], before, gas,
            )  # fmt: skip
            if t <= before:
                # A pair whose latest collision was with each other separates: it cannot meet again.
                if head < 0 or head != gas.link[j][HEAD]:
                    if sooner(t, j, earliest, partner, horizon, gas):
                        earliest = t
                        partner = 9 * j + shift
                    if t <= gas.flight[j][TE]:
                        if gas.link[j][PREVIOUS_IN_BIN] != HELD and sooner(
                            t, i, gas.flight[j][TE], gas.link[j][PARTNER], horizon, gas
                        ):
                            dequeue(j, gas)
                            gas.flight[j][TE] = t
                            gas.link[j][PARTNER] = 9 * i + 8 - shift
                            enqueue(j, low, high - low, begin, rate, gas.scale[WINDOW], gas)
    if ti.static(gas.uses.walled):
        t, code = first_wall(i, gas)
        if t < earliest:
            earliest = t
            partner = code
    gas.flight[i][TE] = earliest
    gas.link[i][PARTNER] = partner
    if earliest < now:
        # Only a held disk, which does not tell anybody where it flies, can have been met already.
        gas.link[i][PREVIOUS_IN_BIN] = HELD
    else:
        enqueue(i, low, high - low, begin, rate, gas.scale[WINDOW], gas)


@ti.func
def run_tile(low, high, alone: ti.template(), most, gas: ti.template()):
    """All collisions of slots [low, high) in the window, in order.

    `alone`: this tile is the whole gas. It then stops by itself at the end of the epoch (or when a disk becomes too
    fast), when the log is full, or after `most` collisions, and sets the epoch's end to where it stopped.
    """
    bins = high - low
    begin = gas.scale[BEGIN]
    window = gas.scale[WINDOW]
    rate = bins / (window - begin)
    for b in range(low, high):
        gas.order[b] = -1
    for i in range(low, high):
        enqueue(i, low, bins, begin, rate, window, gas)
    done = 0
    free = 0
    chunk_end = 0
    b = low
    while b < high:
        i = earliest_of_bin(b, gas)
        if i < 0:
            b += 1
        else:
            t = gas.flight[i][TE]
            code = gas.link[i][PARTNER]
            j = code // 9
            shift = code - 9 * j
            if ti.static(alone):
                if t >= gas.limit[END]:
                    b = high
            if b < high:
                due = NOT_DUE
                if code <= FIRST_WALL:
                    due = WITH_WALL
                elif j >= low and j < high:
                    if gas.link[j][PARTNER] == 9 * i + 8 - shift and gas.flight[j][TE] == t:
                        due = WITH_DISK
                    elif gas.link[j][PREVIOUS_IN_BIN] == HELD:
                        due = WITH_HELD
                else:
                    due = WITH_HELD
                members = 0  # disks that predict: i, and then j
                if due == WITH_HELD:
                    dequeue(i, gas)
                    gas.link[i][PREVIOUS_IN_BIN] = HELD
                elif due == NOT_DUE:
                    # The partner has changed meanwhile.
                    dequeue(i, gas)
                    members = 1
                else:
                    if free == chunk_end:
                        free = ti.atomic_add(gas.counter[N_LOG], CHUNK)
                        chunk_end = free + CHUNK
                        if chunk_end > gas.grid[LOG_CAPACITY]:
                            ti.atomic_sub(gas.counter[N_LOG], CHUNK)
                            gas.counter[LOG_FULL] = 2
                            chunk_end = free
                            b = high
                            if ti.static(alone):
                                gas.limit[END] = t
                    if b < high:
                        dequeue(i, gas)
                        members = 1
                        if ti.static(gas.uses.walled):
                            if due == WITH_WALL:
                                hit_wall(free, t, i, gas)
                        if due == WITH_DISK:
                            dequeue(j, gas)
                            if i > j:
                                shift = 8 - shift
                            collide_at(free, t, ti.min(i, j), ti.max(i, j), shift, gas)
                            done += 1
                            members = 2
                        free += 1
                for member in range(members):
                    m = i + member * (j - i)
                    level = too_fast(m, gas)
                    if ti.static(alone):
                        if level > 0:
                            raise_level(m, level, LATER, gas)
                            extend(m, LATER, gas)
                            if gas.counter[MOST_NEIGHBOURS] > 0:
                                b = high
                            level = 0
                    if level > 0:
                        # Its list may need disks of other tiles: the rounds see to it.
                        gas.flight[m][TE] = FAR
                        gas.link[m][PARTNER] = ROLLED_BACK
                        gas.link[m][AFFECTED] = UNSURE
                        gas.link[m][PREVIOUS_IN_BIN] = HELD
                    else:
                        predict_in_order(m, t, low, high, begin, rate, gas)
                if ti.static(alone):
                    # Collisions asked for are those of two disks: a wall does not stop the count from being reached.
                    if members == 2:
                        if done == most:
                            gas.limit[END] = t
                            b = high
                    if gas.counter[RESTING] > 0:
                        gas.limit[END] = t
                        b = high
    for entry in range(free, chunk_end):
        gas.log_int[entry][STANDS] = 0
    ti.atomic_add(gas.counter[N_STANDING], done)
    # Whom the tiles' meeting must look at: those at a border, and those that still wait.
    last = low
    if ti.static(not alone):
        for i in range(low, high):
            gas.link[i][NEXT] = -1  # these columns now serve the rounds again
            gas.link[i][PREVIOUS_IN_BIN] = -1
            if (
                n_others(gas.link[i][LENGTH]) > 0
                or gas.flight[i][TE] < window
                or gas.link[i][PARTNER] == ROLLED_BACK
            ):
                gas.order[last] = i
                last += 1
    return last - low


@ti.kernel
def run_tiles(
    uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, link: Rows, meta: Rows, cell: Rows,
    start: Rows, fill: Rows, order: Rows, neighbour: Rows, counter: Rows, limit: Rows, log_real: Rows,
    log_int: Rows, log_loss: Rows, law: Cube, walls: Rows, near_walls: Rows, latest: Rows,
):  # fmt: skip
    """All tiles at once, one thread each, up to the end of the window.

    `order` and `fill` get, from each tile's first slot on, the disks that `join_tiles` must look at, and their number.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, link=link, meta=meta, cell=cell, start=start,
        fill=fill, order=order, neighbour=neighbour, counter=counter, limit=limit, log_real=log_real,
        log_int=log_int, log_loss=log_loss, law=law, walls=walls, near_walls=near_walls, latest=latest, uses=uses,
    ))  # fmt: skip
    for item in range(SPREAD * gas.grid[TILES_X] * gas.grid[TILES_Y]):
        if item % SPREAD == 0:
            cells = gas.grid[CELLS_X] * gas.grid[CELLS_Y]
            low = gas.start[item // SPREAD * cells]
            high = gas.start[(item // SPREAD + 1) * cells]
            if high > low:
                gas.fill[item // SPREAD] = run_tile(low, high, False, 0, gas)
            else:
                gas.fill[item // SPREAD] = 0


@ti.kernel
def run_in_order(
    most: ti.i32, uses: ti.template(), grid: Rows, scale: Rows, flight: Rows, kinds: Rows, link: Rows,
    meta: Rows, cell: Rows, start: Rows, order: Rows, neighbour: Rows, counter: Rows, limit: Rows,
    log_real: Rows, log_int: Rows, log_loss: Rows, law: Cube, walls: Rows, near_walls: Rows, latest: Rows,
):  # fmt: skip
    """All tiles as one, by one thread, up to the end of the epoch or to `most` collisions.

    Nothing is ever undone: where tiles that run ahead of each other have to undo too much, this is faster.
    """
    gas = ti.static(GasArrays(
        grid=grid, scale=scale, flight=flight, kinds=kinds, link=link, meta=meta, cell=cell, start=start,
        order=order, neighbour=neighbour, counter=counter, limit=limit, log_real=log_real, log_int=log_int,
        log_loss=log_loss, law=law, walls=walls, near_walls=near_walls, latest=latest, uses=uses,
    ))  # fmt: skip
    for _ in range(1):
        run_tile(0, gas.grid[N], True, most, gas)
