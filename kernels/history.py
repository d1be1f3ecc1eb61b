"""What is over: the log's records of a disk, and the flights between them."""

from .language import ti
from .layout import BEFORE, HEAD, NEVER, NUMBER, PREVIOUS, SEQ, SLOT, SPIN, TAU, TIME, VX, VY, X, Y


@ti.func
def record(entry, side, slot, gas: ti.template()):
    """Log a disk's state before its collision number `entry`, and make that its latest."""
    first = BEFORE + 5 * side
    gas.log_real[entry][first] = gas.flight[slot][X]
    gas.log_real[entry][first + 1] = gas.flight[slot][Y]
    gas.log_real[entry][first + 2] = gas.flight[slot][VX]
    gas.log_real[entry][first + 3] = gas.flight[slot][VY]
    gas.log_real[entry][first + 4] = gas.flight[slot][SPIN]
    gas.log_int[entry][SLOT + side] = slot
    gas.log_int[entry][PREVIOUS + side] = gas.link[slot][HEAD]
    gas.log_int[entry][NUMBER + side] = gas.link[slot][SEQ]
    gas.link[slot][HEAD] = entry
    gas.link[slot][SEQ] = gas.link[slot][SEQ] + 1


@ti.func
def side_of(entry, i, gas: ti.template()):
    """Which side of a log record disk i is."""
    side = 0
    if gas.log_int[entry][SLOT] != i:
        side = 1
    return side


@ti.func
def previous(entry, i, gas: ti.template()):
    """Disk i's record before this one; -1 if there is none."""
    return gas.log_int[entry][PREVIOUS + side_of(entry, i, gas)]


@ti.func
def flight_between(i, begin, end, horizon, gas: ti.template()):
    """Disk i's flight from its record `begin` (-1: from the beginning of the epoch) to `end` (-1: it goes on).

    Returns position and velocity at its start, the times of its start and end, the number of the collision that
    ended it (NEVER if none did) and the other disk of that (-1).
    """
    x, y, vx, vy = gas.flight[i][X], gas.flight[i][Y], gas.flight[i][VX], gas.flight[i][VY]
    started = 0.0 * horizon
    ended = horizon
    number = NEVER
    other = -1
    if begin >= 0:
        started = gas.log_real[begin][TIME]
    if end >= 0:
        side = side_of(end, i, gas)
        first = BEFORE + 5 * side
        x, y = gas.log_real[end][first], gas.log_real[end][first + 1]
        vx, vy = gas.log_real[end][first + 2], gas.log_real[end][first + 3]
        ended = gas.log_real[end][TIME]
        number = gas.log_int[end][NUMBER + side]
        other = gas.log_int[end][SLOT + 1 - side]
    return x, y, vx, vy, started, ended, number, other


@ti.func
def flight_at(i, t, gas: ti.template()):
    """Disk i's flight at time t of the epoch that is over; a collision at t is over, too.

    Returns position and velocity at its start, spin, the time of its start, the record that began it (-1: none in this
    epoch), and how many of its collisions came later.
    """
    x, y, vx, vy = gas.flight[i][X], gas.flight[i][Y], gas.flight[i][VX], gas.flight[i][VY]
    spin = gas.flight[i][SPIN]
    started = gas.flight[i][TAU]
    later = 0
    entry = gas.link[i][HEAD]
    # A flight begins at the time of its record: the log, far away in memory, is read only where it must be.
    while entry >= 0 and started > t:
        side = side_of(entry, i, gas)
        first = BEFORE + 5 * side
        x, y = gas.log_real[entry][first], gas.log_real[entry][first + 1]
        vx, vy = gas.log_real[entry][first + 2], gas.log_real[entry][first + 3]
        spin = gas.log_real[entry][first + 4]
        entry = gas.log_int[entry][PREVIOUS + side]
        started = 0.0 * started
        if entry >= 0:
            started = gas.log_real[entry][TIME]
        later += 1
    return x, y, vx, vy, spin, started, entry, later


@ti.func
def start_position(i, gas: ti.template()):
    """Where disk i was at the beginning of the epoch."""
    x, y = gas.flight[i][X], gas.flight[i][Y]
    entry = gas.link[i][HEAD]
    while entry >= 0:
        side = side_of(entry, i, gas)
        x, y = gas.log_real[entry][BEFORE + 5 * side], gas.log_real[entry][BEFORE + 5 * side + 1]
        entry = gas.log_int[entry][PREVIOUS + side]
    return x, y
