"""Disks that are close: what counts as an overlap, and which pairs may."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..mpi import current
from ..tools import checked
from ..tools.checked import Array
from .box import Box
from .near import Finder, near_pairs_by_trees
from .walls.free_area import FreeArea

TOLERANCE = 1e-9
"""Overlap, as a part of the contact distance, that counts as rounding.

Positions in a box of side L carry errors of about L eps: 1e-12 of a diameter for 1e8 disks. A contact that
the engine found is left with a few of those.
"""

STORED = 2.0**-22
"""Overlap, as a part of the box's longer side, of positions stored in single precision: twice sqrt(2) times 2^-24,
and some."""

COMPUTED = 2.0**-20
"""Overlap, as a part of the same side, of positions computed in single precision.

They lie on a grid of 2^-22 of the side at most, to which those of both disks are rounded at a collision and again where
the state is read: 2 sqrt(2) 2^-22. A time within a window, in which disks come less than a side far, adds some 2^-23.
Measured were 0.34 2^-20 at most.
"""


def tolerances(box: Box, radius: Array, position: Array, rounding: float) -> tuple[float, float]:
    """Overlaps that count as rounding: of two disks, as a part of R_i + R_j, and of disks with walls [length].

    `rounding` is 0 of positions in double precision, or `STORED` or `COMPUTED` or their sum; in an open box the
    farthest disk stands for the side. Of ranks of MPI, each gives the disks of its slice.
    """
    comm = current()
    if not rounding:
        return TOLERANCE, TOLERANCE * comm.largest(float(radius.max(initial=0.0)))
    side = comm.largest(float(np.abs(position).max(initial=0.0))) if box.is_open else max(box.lengths)
    smallest = -comm.largest(-float(radius.min(initial=math.inf)))
    return max(TOLERANCE, rounding * side / (2.0 * smallest)), rounding * side


def checked_radii(radius: ArrayLike) -> Array:
    """The radii [length] as an array of shape (n,); InputError if one is not positive and finite."""
    column = checked.array("radius", radius)
    if column.ndim != 1:
        raise InputError(f"radius has shape {column.shape}: must be one radius per disk, shape (n,)")
    invalid = ~(np.isfinite(column) & (column > 0.0))
    if invalid.any():
        i = int(np.argmax(invalid))
        raise InputError(f"radius[{i}] = {column[i]}: must be a positive finite number")
    return column


def refuse_wider_than_box(box: Box, radius: Array, first: int = 0) -> None:
    """A disk wider than a periodic side overlaps its own image; disks are numbered from `first` on."""
    i, side = int(np.argmax(radius)) if len(radius) else 0, box.shortest_period
    if len(radius) and 2.0 * radius[i] > side * (1.0 + TOLERANCE):
        raise InputError(
            f"disk {first + i} has diameter {2.0 * radius[i]:.6g}, more than the periodic side {side:.6g}: "
            "it overlaps its own periodic image"
        )


def refuse_no_free_area(free_area: FreeArea, radius: Array, first: int = 0) -> None:
    """Raise InputError if walls leave no room for some disk, wherever it stands; numbers as above."""
    i = int(np.argmax(radius)) if len(radius) else 0
    if len(radius) and free_area.all_walls and free_area.area(float(radius[i])) <= 0.0:
        raise InputError(f"the walls leave no room for disk {first + i}, of diameter {2.0 * radius[i]:.6g}")


def size_classes(radius: Array, ratio: float) -> Iterator[NDArray[np.intp]]:
    """Indices of the disks, largest first, in groups whose radii differ by less than `ratio`."""
    order = np.argsort(-radius, kind="stable")
    begin = 0
    while begin < len(order):
        smallest = radius[order[begin]] / ratio
        end = begin + int(np.searchsorted(-radius[order[begin:]], -smallest, side="left"))
        end = max(end, begin + 1)
        yield order[begin:end]
        begin = end


def close_pairs(
    box: Box, radius: Array, position: Array, margin: float = 0.0, near: Finder = near_pairs_by_trees
) -> NDArray[np.intp]:
    """Every pair (i, j), i != j, that may be closer than contact + `margin` [length]; shape (pairs, 2).

    `near` finds a superset, by size class, so that the search around small disks is short.
    """
    # A size class spans a factor 2: with more classes there are more searches, with fewer more pairs.
    classes = list(size_classes(radius, 2.0))
    found = [np.empty((0, 2), dtype=np.intp)]
    for a, members in enumerate(classes):
        reach = 2.0 * radius[members[0]] * (1.0 + TOLERANCE) + margin
        found.append(members[np.column_stack(near(box, reach, position[members]))])
        for other in classes[:a]:
            reach = (radius[members[0]] + radius[other[0]]) * (1.0 + TOLERANCE) + margin
            i, j = near(box, reach, position[members], position[other])
            found.append(np.column_stack((members[i], other[j])))
    return np.concatenate(found)
