"""What the log of an epoch that is over tells: collisions put together again, and where disks were in between."""

from .contact import ELASTIC
from .flights import shift_by
from .language import ti
from .layout import (
    BEFORE,
    GX,
    GY,
    HEAD,
    HOW,
    PREVIOUS,
    SHIFT_BITS,
    SLOT,
    SPIN,
    TILE_X,
    TILE_Y,
    TILES_X,
    TILES_Y,
    TIME,
    VX,
    VY,
)
from .walls import corner_of, wall_met


@ti.func
def folded(at, length):
    """A coordinate inside the box, and how many lengths beyond it was."""
    boxes = 0
    if at < 0.0 or at >= length:
        beyond = ti.floor(at / length)
        at -= beyond * length
        boxes = ti.cast(beyond, ti.i32)
    return at, boxes


@ti.func
def in_box(i, x, y, gas: ti.template()):
    """From disk i's tile into the box: place, and box lengths beyond the box it was in when the epoch began."""
    corner_x, corner_y = corner_of(i, gas)
    at_x, boxes_x = folded(corner_x + x, gas.grid[TILES_X] * gas.scale[TILE_X])
    at_y, boxes_y = folded(corner_y + y, gas.grid[TILES_Y] * gas.scale[TILE_Y])
    return at_x, at_y, boxes_x, boxes_y


@ti.func
def where(entry, side, gas: ti.template()):
    """Where the disk on this side of a record was at the collision, in its tile's falling frame; and when [epoch]."""
    first = BEFORE + 5 * side
    t = gas.log_real[entry][TIME]
    since = t
    begin = gas.log_int[entry][PREVIOUS + side]
    if begin >= 0:
        since = t - gas.log_real[begin][TIME]
    x = gas.log_real[entry][first] + gas.log_real[entry][first + 2] * since
    return x, gas.log_real[entry][first + 1] + gas.log_real[entry][first + 3] * since, t


@ti.func
def before(entry, side, gas: ti.template()):
    """Velocity in the falling frame, and spin, of the disk on this side of a record, before the collision."""
    first = BEFORE + 5 * side
    return gas.log_real[entry][first + 2], gas.log_real[entry][first + 3], gas.log_real[entry][first + 4]


@ti.func
def after(entry, side, gas: ti.template()):
    """Velocity in the falling frame, and spin, of the disk on this side of a record, after the collision."""
    i = gas.log_int[entry][SLOT + side]
    vx, vy, spin = gas.flight[i][VX], gas.flight[i][VY], gas.flight[i][SPIN]
    later = gas.link[i][HEAD]
    while later != entry:
        its = 0
        if gas.log_int[later][SLOT] != i:
            its = 1
        vx, vy, spin = before(later, its, gas)
        later = gas.log_int[later][PREVIOUS + its]
    return vx, vy, spin


@ti.func
def was_elastic(entry, gas: ti.template()):
    """Whether a remedy for collapse made the collision elastic."""
    return gas.log_int[entry][HOW] % SHIFT_BITS >= ELASTIC


@ti.func
def disks_seen(entry, gas: ti.template()):
    """A collision of two disks: time, place of the first, unit vector to the second, how much faster its frame is."""
    x_a, y_a, t = where(entry, 0, gas)
    x_b, y_b, _ = where(entry, 1, gas)
    shift_x, shift_y, drift = shift_by(gas.log_int[entry][HOW] // SHIFT_BITS, gas)
    # As `events.collide_at` has it.
    if ti.static(gas.uses.sheared):
        shift_x += drift * t
    rx = x_b - x_a + shift_x
    ry = y_b - y_a + shift_y
    r = ti.sqrt(rx * rx + ry * ry)
    return t, x_a, y_a, rx / r, ry / r, drift


@ti.func
def wall_seen(entry, gas: ti.template()):
    """A collision with a wall: time, place of the disk, unit vector to the wall, and the wall's velocity there.

    The place and the velocity are those of the lab, not of the falling frame.
    """
    i = gas.log_int[entry][SLOT]
    x, y, t = where(entry, 0, gas)
    nx, ny, ux, uy = wall_met(i, -1 - gas.log_int[entry][SLOT + 1], x, y, t, gas)
    x += 0.5 * gas.scale[GX] * t * t
    y += 0.5 * gas.scale[GY] * t * t
    return t, x, y, -nx, -ny, ux, uy
