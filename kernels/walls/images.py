"""Periodic images of walls by number, and walls as partners of a disk.

A wall has nine images: in the box before, the own one and the next, along x and y. A partner of a disk is the slot of
another one if it is not below 0, `NO_PARTNER`, or the image of a wall: FIRST_WALL minus its number. The latest partner
that a disk had (`EVENT_INFO.last`) and those in lists of contacts (`HELD`) are FIRST_WALL minus the number of the wall.

Arguments are templates: in kernels these functions are the expressions themselves.
"""

from ..compiler.language import ti
from ..layout import FIRST_WALL


@ti.pyfunc
def image_of(w: ti.template(), box_x: ti.template(), box_y: ti.template()):
    """Number of the image of wall w that is -1, 0 or 1 boxes away along x and y."""
    return 9 * w + 3 * (box_x + 1) + box_y + 1


@ti.pyfunc
def wall_of(image: ti.template()):
    """Wall that this is an image of."""
    return image // 9


@ti.pyfunc
def boxes_of(image: ti.template()):
    """Boxes along x and y by which an image is away: -1, 0 or 1."""
    return (image // 3) % 3 - 1, image % 3 - 1


@ti.pyfunc
def as_partner(number: ti.template()):
    """Image (or wall) of this number as a partner."""
    return FIRST_WALL - number


@ti.pyfunc
def from_partner(partner: ti.template()):
    """Number of the image (or wall) that is this partner."""
    return FIRST_WALL - partner


@ti.func
def position_at(i, image, region: ti.template(), gas: ti.template()):
    """Position of the disk in slot i relative to the wall of this image, in the falling frame."""
    box_x, box_y = boxes_of(image)
    x = region.corner_x + gas.motion[i].x - box_x * gas.scale.length_x
    y = region.corner_y + gas.motion[i].y - box_y * gas.scale.length_y
    return x, y
