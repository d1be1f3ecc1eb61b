"""Columns of the arrays that the engine's kernels share, and the time of contact of two straight flights.

All arrays are `ti.ndarray`s, so that a kernel is compiled once for every number of disks. A disk's *slot* is its
place in the sorted order of the current epoch; its id never changes. *Cells* are small enough that only disks of
neighbouring cells can be neighbours; *tiles* are rectangles of cells, whose disks stand together in memory.

===========  ============  ==================================================================================
array        shape, type   a row holds
===========  ============  ==================================================================================
flight       (n, 8) real   what flights and events need (64 bytes in double precision)
kinds        (m, 4) real   inverse mass, k, radius, material of each kind of disk
link         (n, 8) int    partner, log chain and stamps of the current epoch
meta         (n, 3) int    id, kind, collisions
image        (n, 2) int    box crossings, by id
cell         (n,) int      cell number, by tile, in a tile by column
neighbour    (n, K) int    slots of neighbours in the same frame from the front; codes 9 * slot + shift of
                           others from the back
log_real     (c, 11) real  one collision: its time, and both disks' states before it
log_int      (c, 8) int    its slots, links and flags
lists        (5, n) int    work lists of the rounds
counter      (16,) int     their lengths, and totals
limit        (5,) real     times at which the epoch and the window end
grid         (9,) int      numbers of disks, tiles and cells
scale        (11,) real    lengths and times of the grid and the epoch
clock        (3,) double   times in epochs run by one thread
total        (3,) int64    collisions and epochs of one launch
law          (M, M, 5)     e_n, e_t, mu, contact_point, rho of each pair of materials
===========  ============  ==================================================================================

Positions are relative to the lower left corner of the disk's tile, so that they lose no precision far from the
origin; times are relative to the beginning of the epoch. A *shift* s = 3 (dx + 1) + (dy + 1) says that the
neighbour's tile lies dx, dy in {-1, 0, 1} tiles away, across a periodic side or not; seen from the other disk it is
8 - s. A *code* is 9 * slot + shift.
"""

import taichi as ti

# flight: position at time TAU, velocity, spin, radius, time of the earliest predicted event
X, Y, VX, VY, TAU, SPIN, RADIUS, TE = range(8)
# kinds
INVERSE_MASS, K, KIND_RADIUS, MATERIAL = range(4)
# link: code of the earliest event's partner; latest log record; collisions in this epoch; stamps with the number of
# a round; the collision from which on to undo; lengths of the neighbour row's two parts
PARTNER, HEAD, SEQ, ACTIVE, DIRTY, AFFECTED, UNDO, LENGTH = range(8)
# While a tile runs, its disks with events due stand in bins; these two columns then hold the bin's list.
NEXT, PREVIOUS_IN_BIN = ACTIVE, DIRTY
# meta
ID, KIND, COLLISIONS = range(3)
# log_real: time, then x, y, vx, vy, spin of either disk from column BEFORE + 5 * side on
TIME, BEFORE = 0, 1
# log_int: slot, previous record and number in its epoch of either disk (column + side), regime flags, standing
SLOT, PREVIOUS, NUMBER, REGIME, STANDS = 0, 2, 4, 6, 7
# lists: disks that predicted again because they changed (two rows, for even and odd rounds), because a
# neighbour changed (likewise), and disks to be rolled back
CHANGED_ROW, AFFECTED_ROW, UNDO_ROW = 0, 2, 4
EXTEND_ROW = UNDO_ROW  # lists are extended while nothing is to be undone
# counter: the lengths of those five lists, and
N_LOG = 5  # records written in this epoch, undone ones and gaps included
N_STANDING = 6  # collisions that stand
N_VIOLATIONS = 7  # causality violations found
N_ROUNDS = 8  # rounds in this epoch
ROUND = 9  # number of the current round, counted through the whole run
MOST_NEIGHBOURS = 10  # longest neighbour row that was needed
LOG_FULL = 11  # 1: the log may have no room for another round; 2: it had too little for the tiles
N_UNDONE = 12  # collisions undone
TOP_LEVEL = 13  # highest level of any disk in this epoch
# limit: end of the epoch, the same as read by the current round, largest speed, earliest unprocessed event, mean
# square of the speeds
END, LATCHED, FASTEST, EARLIEST, MEAN_SQUARE = range(5)
# grid: disks; tiles along each side; cells along each side of a tile; entries of a neighbour row; log records;
# highest level that the box allows; 1, or 0 to see what happens when nothing is ever rolled back
N, TILES_X, TILES_Y, CELLS_X, CELLS_Y, ROW, LOG_CAPACITY, MOST_LEVEL, ROLL_BACK = range(9)
# scale: sides of a cell and of a tile, listing distance beyond contact, end of predictions, beginning and end of the
# window, what a disk of level 0 may move in an epoch, time that disks fly on when they settle, largest diameter
CELL_X, CELL_Y, TILE_X, TILE_Y, SKIN, HORIZON, BEGIN, WINDOW, REACH, DURATION, WIDEST = range(11)
# clock, in double precision: present time, where to stop, planned length of the latest epoch
NOW, TIME_END, PLANNED = range(3)
# total, 64-bit: collisions still wanted; epochs and collisions of this launch
COLLISIONS_LEFT, N_EPOCHS, N_TOTAL = range(3)

SPEED_MARGIN = 1.15  # how much faster than the fastest disk a disk may become before the epoch is cut short
# Taichi hands a thread at least so many items of a loop. Loops over few, long items run over SPREAD times as many,
# and do something in one of them.
SPREAD = 512
ROLLED_BACK = -2  # as a partner: this disk was rolled back and has not predicted again
FAR = 1.0e30  # a time later than any event
NEVER = 1 << 30  # "undo from collision number NEVER on": nothing to undo
SAME_FRAME = 4  # the shift of two disks of one tile
# LENGTH = neighbours in the same frame + OTHER * those in others + LEVEL * level
OTHER, LEVEL = 1 << 14, 1 << 27
LEVELS = 4.0  # levels by which a disk's range grows by one reach


def rounding():
    """Relative error that a velocity may carry: some 50 units in its last place."""
    return 6.0e-6 if ti.lang.impl.get_runtime().default_fp == ti.f32 else 1.0e-14


@ti.func
def n_own(lengths):
    """Neighbours of a disk in its own frame."""
    return lengths % OTHER


@ti.func
def n_others(lengths):
    """Neighbours of a disk in other frames."""
    return lengths // OTHER % (LEVEL // OTHER)


@ti.func
def level_of(lengths):
    """Level of a disk: it may move (1 + level / LEVELS) reaches in this epoch."""
    return lengths // LEVEL


@ti.func
def contact_delay(rx, ry, vxi, vyi, vxj, vyj, sigma, within):
    """Time until the separation r + v t, v = v_j - v_i, has length sigma; FAR if never; 0 for a touching pair.

    The smaller root of (r + v t)^2 = sigma^2 in the form that does not cancel, c / (sqrt(b^2 - v^2 c) - b) with
    b = r.v and c = r^2 - sigma^2. Every term is even under (r, v) -> (-r, -v): both disks of a pair compute bitwise
    the same time.

    Contact takes c = -2 b t - v^2 t^2 <= -2 b t. Most pairs cannot make that `within` the time of interest, and are
    told apart without root and division; they also count as never.

    A touching pair that approaches more slowly than the rounding errors of its velocities counts as at rest: disks
    pressed together by others would otherwise push each other for ever, in no time and to no effect.
    """
    delay = FAR
    vx = vxj - vxi
    vy = vyj - vyi
    b = rx * vx + ry * vy
    c = rx * rx + ry * ry - sigma * sigma
    if c <= -2.0 * b * within:
        if b < 0.0:
            v2 = vx * vx + vy * vy
            d = b * b - v2 * c
            if c <= 0.0:
                noise = ti.static(rounding()) * ((ti.abs(vxi) + ti.abs(vxj)) + (ti.abs(vyi) + ti.abs(vyj)))
                if b < -sigma * noise:
                    delay = 0.0
            elif d > 0.0:
                delay = c / (ti.sqrt(d) - b)
    return delay


@ti.func
def meeting_time(xi, yi, vxi, vyi, tau_i, xj, yj, vxj, vyj, tau_j, shift_x, shift_y, sigma, before):
    """Time of contact of two flights, each known from its own clock tau on; FAR if they do not touch `before`."""
    start = ti.max(tau_i, tau_j)
    rx = (xj + vxj * (start - tau_j)) - (xi + vxi * (start - tau_i)) + shift_x
    ry = (yj + vyj * (start - tau_j)) - (yi + vyi * (start - tau_i)) + shift_y
    return start + contact_delay(rx, ry, vxi, vyi, vxj, vyj, sigma, before - start)


@ti.func
def sooner(t, j, earliest, partner, horizon, meta: ti.template()):
    """Whether an event at t with disk j comes before the one at `earliest` with `partner` (a code), and in time.

    Exact ties fall to the smaller id.
    """
    before = t < earliest and t < horizon
    if t == earliest and t < horizon:
        before = meta[j][ID] < meta[partner // 9][ID]
    return before


@ti.func
def precedes(a, b, c, d):
    """Whether the pair of ids {a, b} comes before {c, d} in the order (smaller id, larger id)."""
    low_1, high_1 = ti.min(a, b), ti.max(a, b)
    low_2, high_2 = ti.min(c, d), ti.max(c, d)
    return low_1 < low_2 or (low_1 == low_2 and high_1 < high_2)


@ti.func
def tile_beside(tile, shift, grid: ti.template()):
    """The tile that lies one `shift` from `tile`, across the box's sides if need be."""
    tx = tile // grid[TILES_Y]
    ty = tile - tx * grid[TILES_Y]
    tx += shift // 3 - 1
    ty += shift % 3 - 1
    if tx < 0:
        tx += grid[TILES_X]
    elif tx >= grid[TILES_X]:
        tx -= grid[TILES_X]
    if ty < 0:
        ty += grid[TILES_Y]
    elif ty >= grid[TILES_Y]:
        ty -= grid[TILES_Y]
    return tx * grid[TILES_Y] + ty
