"""Straight flights: when two disks meet, and places on a grid.

Everything that decides about a meeting is here once, and depends on differences of places only, which are exact: places
are multiples of a grid q, and so are the corners that they are measured from. So each tile that computes a meeting,
from either disk, finds the same bits.
"""

from .language import Rows, Table, is_single_precision, ti
from .layout import FAR


def rounding() -> float:
    """Relative error that a velocity may carry: some 50 units in its last place."""
    return 6.0e-6 if is_single_precision() else 1.0e-14


@ti.func
def on_grid(way, gas: ti.template()):
    """A displacement rounded to the grid of places: (z + C) - C, where C is 1.5 q times the largest mantissa."""
    return (way + gas.scale.rounding_constant) - gas.scale.rounding_constant


@ti.func
def contact_delay(rx, ry, vx, vy, noise, sigma, within, gas: ti.template()):
    """Time until the separation r + v t has length sigma; FAR if never `within` that; 0 for a touching pair.

    v = v_j - v_i; `noise` is the rounding error that the velocities carry.

    The smaller root of (r + v t)^2 = sigma^2 in the form that does not cancel, c / (sqrt(b^2 - v^2 c) - b) with
    b = r.v and c = r^2 - sigma^2. Every term is even under (r, v) -> (-r, -v): both disks of a pair compute bitwise
    the same time.

    Contact takes c = -2 b t - v^2 t^2 <= -2 b t. Most pairs cannot make that `within` the time of interest, and are
    told apart without root and division; they also count as never.

    A touching pair that approaches more slowly than the rounding errors of its velocities counts as at rest: disks
    pressed together by others would otherwise push each other for ever, in no time and to no effect.
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
