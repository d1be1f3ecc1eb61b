"""Whether disks that fly straight on can ever meet again."""

from .language import ti
from .layout import Rows, Table


@ti.kernel
def approaching(first: ti.i32, last: ti.i32, position: Table, velocity: Table, radius: Rows) -> ti.i32:
    """1 if one of the disks [first, last) and one after it may touch in straight flight, else 0.

    The condition is that of `flights.contact_delay`. A pair that misses by less than rounding counts as one that may.
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
