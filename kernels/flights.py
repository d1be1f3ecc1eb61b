"""Straight flights: when two of them meet, which of two events comes first, and flights that are over.

Everything that decides about a meeting is here once, so that both disks of a pair, and all ways of running an epoch,
find the same bits on one device. A CPU and a GPU do not: for CUDA, Taichi fuses products and sums whatever `fast_math`
says, and divides approximately in single precision, so that the last bits differ, and after some ten collisions a disk
the motion. In what decides about a meeting, `rounded` keeps products from being fused at one site and not at another,
where they are needed for something else, too.
"""

from .language import ti
from .layout import (
    ASIDE,
    DRIFT,
    FAR,
    FIRST_WALL,
    HEAD,
    ID,
    NOTHING,
    PARTNER,
    RADIUS,
    TAU,
    TE,
    TILE_X,
    TILE_Y,
    VX,
    VY,
    WALL_ID,
    Rows,
    Table,
    X,
    Y,
)


def rounding():
    """Relative error that a velocity may carry: some 50 units in its last place."""
    return 6.0e-6 if ti.lang.impl.get_runtime().default_fp == ti.f32 else 1.0e-14


def fuses():
    """Whether the device that kernels are compiled for fuses products and sums."""
    return ti.lang.impl.current_cfg().arch == ti.cuda


@ti.func
def rounded(product, gas: ti.template()):
    """A product rounded by itself, not within a sum: where products are fused, with a 0 that no compiler can know."""
    value = product
    if ti.static(fuses()):
        value = product + gas.scale[NOTHING]
    return value


@ti.func
def contact_delay(rx, ry, vxi, vyi, vxj, vyj, drift, sigma, within, gas: ti.template()):
    """Time until the separation r + v t has length sigma; FAR if never; 0 for a touching pair.

    v = v_j - v_i, and in a sheared gas the `drift` along x of j's frame against i's.

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
    if ti.static(gas.uses.sheared):
        vx += drift  # last: seen from j, every term only changes its sign
    vy = vyj - vyi
    b = rounded(rx * vx, gas) + rounded(ry * vy, gas)
    c = rounded(rx * rx, gas) + rounded(ry * ry, gas) - rounded(sigma * sigma, gas)
    if c <= -2.0 * b * within:
        if b < 0.0:
            v2 = rounded(vx * vx, gas) + rounded(vy * vy, gas)
            d = rounded(b * b, gas) - rounded(v2 * c, gas)
            if c <= 0.0:
                noise = ti.static(rounding()) * ((ti.abs(vxi) + ti.abs(vxj)) + (ti.abs(vyi) + ti.abs(vyj)))
                if b < -sigma * noise:
                    delay = 0.0
            elif d > 0.0:
                delay = c / (ti.sqrt(d) - b)
    return delay


@ti.func
def meeting_time(
    xi, yi, vxi, vyi, tau_i, xj, yj, vxj, vyj, tau_j, shift_x, shift_y, drift, sigma, before,
    gas: ti.template(),
):  # fmt: skip
    """Time of contact of two flights, each known from its own clock tau on; FAR if they do not touch `before`."""
    start = ti.max(tau_i, tau_j)
    if ti.static(gas.uses.sheared):
        shift_x += drift * start
    since_i, since_j = start - tau_i, start - tau_j
    rx = (xj + rounded(vxj * since_j, gas)) - (xi + rounded(vxi * since_i, gas)) + shift_x
    ry = (yj + rounded(vyj * since_j, gas)) - (yi + rounded(vyi * since_i, gas)) + shift_y
    return start + contact_delay(rx, ry, vxi, vyi, vxj, vyj, drift, sigma, before - start, gas)


@ti.func
def id_of(code, gas: ti.template()):
    """Id of the disk or wall of a code. Walls come after all disks."""
    found = WALL_ID + FIRST_WALL - code
    if code > FIRST_WALL:
        found = gas.meta[code // 9][ID]
    return found


@ti.func
def id_at(slot, gas: ti.template()):
    """Id of the disk at a slot, or of the wall -1 - slot."""
    found = WALL_ID - 1 - slot
    if slot >= 0:
        found = gas.meta[slot][ID]
    return found


@ti.func
def sooner(t, j, earliest, partner, horizon, gas: ti.template()):
    """Whether an event at t with disk j comes before the one at `earliest` with `partner` (a code), and in time.

    Exact ties fall to the smaller id.
    """
    before = t < earliest and t < horizon
    if t == earliest and t < horizon:
        before = gas.meta[j][ID] < id_of(partner, gas)
    return before


@ti.func
def precedes(a, b, c, d):
    """Whether the pair of ids {a, b} comes before {c, d} in the order (smaller id, larger id)."""
    low_1, high_1 = ti.min(a, b), ti.max(a, b)
    low_2, high_2 = ti.min(c, d), ti.max(c, d)
    return low_1 < low_2 or (low_1 == low_2 and high_1 < high_2)


@ti.func
def shift_by(shift, gas: ti.template()):
    """How far a tile one `shift` away lies when the epoch begins, along x and y; and how fast it drifts along x."""
    x = (shift // 3 - 1) * gas.scale[TILE_X]
    drift = 0.0 * x
    if ti.static(gas.uses.sheared):
        dy = shift % 3 - 1
        x += dy * gas.scale[ASIDE]
        drift = dy * gas.scale[DRIFT]
    return x, (shift % 3 - 1) * gas.scale[TILE_Y], drift


@ti.func
def meeting(i, j, shift, before, gas: ti.template()):
    """Time of contact of the present flights of disks i and j, j one `shift` away; FAR if they do not touch `before`.

    A pair whose latest collision was with each other separates: it cannot meet again in straight flight.
    """
    t = FAR
    if gas.link[i][HEAD] < 0 or gas.link[i][HEAD] != gas.link[j][HEAD]:
        shift_x, shift_y, drift = shift_by(shift, gas)
        t = meeting_time(
            gas.flight[i][X], gas.flight[i][Y], gas.flight[i][VX], gas.flight[i][VY], gas.flight[i][TAU],
            gas.flight[j][X], gas.flight[j][Y], gas.flight[j][VX], gas.flight[j][VY], gas.flight[j][TAU],
            shift_x, shift_y, drift, gas.flight[i][RADIUS] + gas.flight[j][RADIUS], before, gas,
        )  # fmt: skip
    return t


@ti.func
def first_meeting(i, j, rx, ry, drift, within, gas: ti.template()):
    """The same for disks that have not collided in this epoch, so that all clocks stand at 0, at separation r."""
    return contact_delay(
        rx, ry, gas.flight[i][VX], gas.flight[i][VY], gas.flight[j][VX], gas.flight[j][VY], drift,
        gas.flight[i][RADIUS] + gas.flight[j][RADIUS], within, gas,
    )  # fmt: skip


@ti.func
def offer(i, t, code, horizon, gas: ti.template()):
    """Make the event at t with `code` disk i's, if it comes before the one it has."""
    if t <= gas.flight[i][TE]:
        if sooner(t, code // 9, gas.flight[i][TE], gas.link[i][PARTNER], horizon, gas):
            gas.flight[i][TE] = t
            gas.link[i][PARTNER] = code


@ti.kernel
def approaching(first: ti.i32, last: ti.i32, position: Table, velocity: Table, radius: Rows) -> ti.i32:
    """1 if one of the disks [first, last) and one after it may touch in straight flight, else 0.

    The condition is that of `contact_delay`. A pair that misses by less than rounding counts as one that may.
    """
    found = 0
    for i in range(first, last):
        for j in range(i + 1, position.shape[0]):
            rx, ry = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1]
            vx, vy = velocity[j, 0] - velocity[i, 0], velocity[j, 1] - velocity[i, 1]
            sigma = radius[i] + radius[j]
            b = rx * vx + ry * vy
            c = rx * rx + ry * ry - sigma * sigma
            v2 = vx * vx + vy * vy
            if b < 0.0 and b * b - v2 * c > -1.0e-12 * (b * b + v2 * sigma * sigma):
                ti.atomic_max(found, 1)
    return found
