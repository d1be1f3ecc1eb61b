"""Straight flights: when two of them meet, which of two events comes first, and flights that are over.

Everything that decides about a meeting is here once, so that both disks of a pair, and all ways of running an epoch,
find the same bits.
"""

import taichi as ti

from .layout import (
    BEFORE,
    FAR,
    HEAD,
    ID,
    NEVER,
    NUMBER,
    PARTNER,
    PREVIOUS,
    RADIUS,
    SLOT,
    TAU,
    TE,
    TILE_X,
    TILE_Y,
    TIME,
    VX,
    VY,
    X,
    Y,
)


def rounding():
    """Relative error that a velocity may carry: some 50 units in its last place."""
    return 6.0e-6 if ti.lang.impl.get_runtime().default_fp == ti.f32 else 1.0e-14


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
def sooner(t, j, earliest, partner, horizon, gas: ti.template()):
    """Whether an event at t with disk j comes before the one at `earliest` with `partner` (a code), and in time.

    Exact ties fall to the smaller id.
    """
    before = t < earliest and t < horizon
    if t == earliest and t < horizon:
        before = gas.meta[j][ID] < gas.meta[partner // 9][ID]
    return before


@ti.func
def precedes(a, b, c, d):
    """Whether the pair of ids {a, b} comes before {c, d} in the order (smaller id, larger id)."""
    low_1, high_1 = ti.min(a, b), ti.max(a, b)
    low_2, high_2 = ti.min(c, d), ti.max(c, d)
    return low_1 < low_2 or (low_1 == low_2 and high_1 < high_2)


@ti.func
def shift_by(shift, gas: ti.template()):
    """How far a tile one `shift` away lies, along x and y."""
    return (shift // 3 - 1) * gas.scale[TILE_X], (shift % 3 - 1) * gas.scale[TILE_Y]


@ti.func
def meeting(i, j, shift, before, gas: ti.template()):
    """Time of contact of the present flights of disks i and j, j one `shift` away; FAR if they do not touch `before`.

    A pair whose latest collision was with each other separates: it cannot meet again in straight flight.
    """
    t = FAR
    if gas.link[i][HEAD] < 0 or gas.link[i][HEAD] != gas.link[j][HEAD]:
        shift_x, shift_y = shift_by(shift, gas)
        t = meeting_time(
            gas.flight[i][X], gas.flight[i][Y], gas.flight[i][VX], gas.flight[i][VY], gas.flight[i][TAU],
            gas.flight[j][X], gas.flight[j][Y], gas.flight[j][VX], gas.flight[j][VY], gas.flight[j][TAU],
            shift_x, shift_y, gas.flight[i][RADIUS] + gas.flight[j][RADIUS], before,
        )  # fmt: skip
    return t


@ti.func
def first_meeting(i, j, rx, ry, within, gas: ti.template()):
    """The same for disks that have not collided in this epoch, so that all clocks stand at 0, at separation r."""
    return contact_delay(
        rx, ry, gas.flight[i][VX], gas.flight[i][VY], gas.flight[j][VX], gas.flight[j][VY],
        gas.flight[i][RADIUS] + gas.flight[j][RADIUS], within,
    )  # fmt: skip


@ti.func
def offer(i, t, code, horizon, gas: ti.template()):
    """Make the event at t with `code` disk i's, if it comes before the one it has."""
    if t <= gas.flight[i][TE]:
        if sooner(t, code // 9, gas.flight[i][TE], gas.link[i][PARTNER], horizon, gas):
            gas.flight[i][TE] = t
            gas.link[i][PARTNER] = code


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
def start_position(i, gas: ti.template()):
    """Where disk i was at the beginning of the epoch."""
    x, y = gas.flight[i][X], gas.flight[i][Y]
    entry = gas.link[i][HEAD]
    while entry >= 0:
        side = side_of(entry, i, gas)
        x, y = gas.log_real[entry][BEFORE + 5 * side], gas.log_real[entry][BEFORE + 5 * side + 1]
        entry = gas.log_int[entry][PREVIOUS + side]
    return x, y
