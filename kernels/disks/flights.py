"""Straight flights: contact times of two disks, and positions on a grid.

Contact times depend on differences of positions only. These are exact, because positions, and the corners that they
are measured from, are multiples of a grid spacing q. So every tile that computes a contact, from either disk, finds the
same bits.
"""

from ..compiler.language import Rows, Table, is_single_precision, ti
from ..layout import FAR


def rounding() -> float:
    """Relative error that a velocity may carry: some 50 units in its last place."""
    return 6.0e-6 if is_single_precision() else 1.0e-14


@ti.func
def on_grid(distance, gas: ti.template()):
    """A displacement rounded to the grid of positions: (z + C) - C, where C is 1.5 q times the largest mantissa."""
    return (distance + gas.scale.rounding_constant) - gas.scale.rounding_constant


@ti.func
def contact_delay(rx, ry, vx, vy, noise, sigma, within, gas: ti.template()):
    """Time until the separation r + v t has length sigma; FAR if never `within` that; 0 for a touching pair.

    v = v_j - v_i; `noise` is the rounding error that the velocities carry.

    The smaller root of (r + v t)^2 = sigma^2 in the form that does not cancel, c / (sqrt(b^2 - v^2 c) - b) with
    b = r.v and c = r^2 - sigma^2. Every term is even under (r, v) -> (-r, -v): both disks of a pair compute bitwise
    the same time.

    Contact takes c = -2 b t - v^2 t^2 <= -2 b t. Most pairs cannot make that `within` the time of interest; this test
    excludes them without root and division.

    A touching pair that approaches more slowly than the rounding errors of its velocities counts as at rest. Otherwise
    disks that others press together would collide without end at one time.
    """
    delay = FAR
    b = rx * vx + ry * vy
    c = rx * rx + ry * ry - sigma * sigma
    if c <= -2.0 * b * within and b < 0.0:
        if c <= 0.0:
            if b < -sigma * noise:
                delay = 0.0
        else:
            v2 = vx * vx + vy * vy
            d = b * b - v2 * c
            if d > 0.0:
                delay = c / (ti.sqrt(d) - b)
    return delay


@ti.func
def bits_of(value):
    """Bits of a real number as an integer of the same width, which is negative where the number or -0 is."""
    if ti.static(is_single_precision()):
        return ti.bit_cast(value, ti.i32)
    else:
        return ti.bit_cast(value, ti.i64)


@ti.func
def real_of(bits):
    """The real number that has these bits: the inverse of `bits_of`."""
    return ti.bit_cast(bits, float)


@ti.func
def contact_signs(rx, ry, vx, vy, sigma, within):
    """An integer that is negative unless `contact_delay` gives FAR: all its conditions in one.

    Most pairs fail one of them, which no processor foresees: so its sign is that of b < 0, -2 b within - c >= 0 and
    b^2 - v^2 c >= 0. Equality passes.
    """
    b = rx * vx + ry * vy
    c = rx * rx + ry * ry - sigma * sigma
    late = -2.0 * b * within - c
    d = b * b - (vx * vx + vy * vy) * c
    return bits_of(b) & ~(bits_of(late) | bits_of(d))


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
