"""Overlaps of disks: which pairs are close, and whether any overlap."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..tools import checked, slices, world
from ..tools.checked import Array
from .box import Box
from .free_area import Room

TOLERANCE = 1e-9
"""Overlap, as a part of the contact distance, that counts as rounding.

Positions in a box of side L carry errors of about L eps: 1e-12 of a diameter for 1e8 disks. A contact that
the engine found is left with a few of those.
"""


def checked_radii(radius: ArrayLike) -> Array:
    """The radii [length] as an array of shape (n,); InputError if one is not positive and finite."""
    column = checked.array("radius", radius)
    if column.ndim != 1:
        raise InputError(f"radius has shape {column.shape}: one radius per disk, shape (n,), is needed")
    wrong = ~(np.isfinite(column) & (column > 0.0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(f"radius[{i}] = {column[i]}: a positive finite number is needed")
    return column


def refuse_wider_than_box(box: Box, radius: Array) -> None:
    """A disk wider than the box overlaps its own periodic image."""
    i = int(np.argmax(radius))
    if 2.0 * radius[i] > min(box.lengths) * (1.0 + TOLERANCE):
        raise InputError(
            f"disk {i} has diameter {2.0 * radius[i]:.6g}, more than the box side {min(box.lengths):.6g}: "
            "it overlaps its own periodic image"
        )


def refuse_no_room(room: Room, radius: Array) -> None:
    """Raise InputError if walls leave no room for some disk, wherever it stands."""
    i = int(np.argmax(radius))
    if room.all_walls and room.area(float(radius[i])) <= 0.0:
        raise InputError(f"the walls leave no room for disk {i}, of diameter {2.0 * radius[i]:.6g}")


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


def close_pairs(box: Box, radius: Array, position: Array, margin: float = 0.0) -> NDArray[np.intp]:
    """Every pair (i, j), i != j, that may be closer than contact + `margin` [length]; shape (pairs, 2).

    The trees find a superset; by size class, so that small disks need not look as far as the largest reach.
    """
    from scipy.spatial import cKDTree

    # A size class spans a factor 2: with more classes there are more trees, with fewer more pairs.
    classes = list(size_classes(radius, 2.0))
    trees = [cKDTree(position[members], boxsize=box.periods) for members in classes]
    found = [np.empty((0, 2), dtype=np.intp)]
    for a, members in enumerate(classes):
        reach = 2.0 * radius[members[0]] * (1.0 + TOLERANCE) + margin
        found.append(members[trees[a].query_pairs(reach, output_type="ndarray")])
        for b in range(a):
            reach = (radius[members[0]] + radius[classes[b][0]]) * (1.0 + TOLERANCE) + margin
            close = trees[a].sparse_distance_matrix(trees[b], reach, output_type="ndarray")
            found.append(np.column_stack((members[close["i"]], classes[b][close["j"]])))
    return np.concatenate(found)


def _close_pairs_at(box: Box, radius: Array, position: Array, time: float) -> NDArray[np.intp]:
    """`close_pairs` at a `time` [time], in a sheared box too, where a tree knows the images to the sides only."""
    if box.shear_rate == 0.0:
        return close_pairs(box, radius, position)
    low = np.flatnonzero(position[:, 1] < 2.0 * radius.max() * (1.0 + TOLERANCE))
    above = (position[low] + (box.image_above(time), box.lengths[1])) % (box.lengths[0], math.inf)
    owner = np.concatenate([np.arange(len(radius)), low])
    window = Box(box.lengths, (True, False))
    pairs = close_pairs(window, radius[owner], np.concatenate([position, above]))
    return owner[pairs[(pairs < len(radius)).any(axis=1)]]


def check_no_overlap(
    box: Box, radius: ArrayLike, position: ArrayLike, *, tolerance: float = TOLERANCE, time: float = 0.0,
    ids: Sequence[int] | NDArray[np.integer] | None = None,
) -> None:  # fmt: skip
    """Refuse positions at which disks overlap, across the periodic sides too.

    Distances are computed pair by pair and exactly; a tree only finds which pairs are near. InputError names the pair
    that overlaps most, by how much, and how many pairs overlap; or the disk that is wider than the box, or whose
    position is not finite.

    Parameters
    ----------
    radius : array_like (n,)
        Radii [length].
    position : array_like (n, 2)
        Centres [length], inside the box or not.
    tolerance : float
        Overlap that is taken as rounding, as a part of the contact distance R_i + R_j.
    time : float
        The time [time], which says where the images above and below are in a sheared box.
    ids : sequence of int (n,)
        Numbers of the disks, for the message; 0 to n - 1 by default.
    """
    radii = checked_radii(radius)
    centres = np.asarray(position, dtype=np.float64)
    if centres.shape != (len(radii), 2):
        raise InputError(f"position has shape {centres.shape}: {(len(radii), 2)} is needed")
    if len(radii) == 0:
        return
    finite = np.isfinite(centres).all(axis=1)
    if not finite.all():
        i = int(np.argmin(finite))
        raise InputError(f"position[{i}] = {centres[i]}: every value must be finite")
    refuse_wider_than_box(box, radii)
    centres = box.wrap(centres, time)
    i, j = _close_pairs_at(box, radii, centres, time).T
    distance = np.linalg.norm(box.minimum_image(centres[j] - centres[i], time), axis=-1)
    contact = radii[i] + radii[j]
    overlap = contact - distance
    wrong = overlap > tolerance * contact
    if wrong.any():
        worst = int(np.argmax(np.where(wrong, overlap, -np.inf)))
        first, second = sorted(int(each if ids is None else ids[each]) for each in (i[worst], j[worst]))
        count = int(np.count_nonzero(wrong))
        others = "" if count == 1 else f"; {count} pairs overlap, this one the most"
        raise InputError(
            f"disks {first} and {second} overlap by {overlap[worst]:.6g} "
            f"(distance {distance[worst]:.6g}, sum of radii {contact[worst]:.6g}){others}"
        )


_BANDS = 64
"""Bands of the box along y for each rank, of which those that it checks are put together."""


def check_no_overlap_of_slices(
    box: Box, radius: Array, position: Array, comm: Any, *, time: float = 0.0
) -> None:
    """As `check_no_overlap`, of disks of which each rank has a slice; all raise the error of one.

    Each rank gets the disks of a part of the box along y, with about as many as the others, and those that reach into
    it from above: it sees every pair whose lower disk is its own.
    """
    ids, _ = slices.numbered(len(radius), comm)
    world.together(comm, lambda: checked_radii(radius))
    width = 2.0 * max(comm.allgather(float(radius.max(initial=0.0)))) * (1.0 + 2.0 * TOLERANCE)
    height = box.lengths[1]
    y = box.wrap(position, time)[:, 1]
    bands = _BANDS * comm.size
    band = np.clip((y / height * bands).astype(np.int64), 0, bands - 1)
    count = np.bincount(band, minlength=bands)
    comm.Allreduce(count.copy(), count)
    # Of each band, the rank that checks its disks: about as many for each.
    rank = np.minimum((np.cumsum(count) - count) * comm.size // max(int(count.sum()), 1), comm.size - 1)
    low = np.array([np.searchsorted(rank, q) for q in range(comm.size + 1)]) * (height / bands)
    to, row = [], []
    for q in range(comm.size):
        above = (y - low[q]) % height if box.periodic[1] else y - low[q]
        near = (rank[band] == q) | ((above >= 0.0) & (above <= low[q + 1] - low[q] + width))
        if low[q + 1] > low[q]:
            row.append(np.flatnonzero(near))
            to.append(np.full(len(row[-1]), q))
    rows = np.concatenate(row) if row else np.zeros(0, np.intp)
    numbers = np.arange(ids.start, ids.stop)
    ids_there, radii, places = slices.exchange(
        comm, np.concatenate(to) if to else rows, [each[rows] for each in (numbers, radius, position)]
    )
    world.together(comm, lambda: check_no_overlap(box, radii, places, time=time, ids=ids_there))


_APART = 1e-7  # of the contact distance: left between disks that were moved apart, so that none overlaps by rounding
_MOST_PASSES = 10_000
_MOST_NAMED = 20


def relax(box: Box, radius: ArrayLike, position: ArrayLike, tolerance: float) -> NDArray[np.float64]:
    """Move disks apart that overlap by a little, as measured places do.

    Of each overlapping pair both disks move by half of the overlap, along the line of centres, until none overlaps.

    Raises InputError that names every pair that overlaps by more, or the disk that would have to move further.

    Parameters
    ----------
    radius : array_like (n,)
        Radii [length].
    position : array_like (n, 2)
        Centres [length].
    tolerance : float
        Largest overlap that is taken as an error of measurement [length], and largest way of a disk.

    Returns
    -------
    array (n, 2)
        Centres without overlaps.
    """
    radii, centres = checked_radii(radius), np.array(position, dtype=np.float64)
    begun = centres.copy()
    for attempt in range(_MOST_PASSES):
        i, j = close_pairs(box, radii, box.wrap(centres)).T
        apart = box.minimum_image(centres[j] - centres[i])
        distance = np.linalg.norm(apart, axis=-1)
        contact = radii[i] + radii[j]
        overlap = contact - distance
        if attempt == 0 and np.any(overlap > tolerance):
            order = [k for k in np.argsort(-overlap) if overlap[k] > tolerance]
            named = [
                f"disks {min(i[k], j[k])} and {max(i[k], j[k])} overlap by {overlap[k]:.6g}, more than "
                f"relax = {tolerance:g}"
                for k in order[:_MOST_NAMED]
            ]
            more = [f"and {len(order) - len(named)} more pairs"] if len(order) > len(named) else []
            raise InputError("\n".join((*named, *more)))
        wrong = overlap > 0.0
        if not wrong.any():
            return centres
        i, j, overlap = i[wrong], j[wrong], overlap[wrong] + _APART * contact[wrong]
        line = np.where(
            distance[wrong, None] > 0.0, apart[wrong] / np.maximum(distance[wrong, None], 1e-300), [1.0, 0.0]
        )
        np.add.at(centres, i, -0.5 * overlap[:, None] * line)
        np.add.at(centres, j, 0.5 * overlap[:, None] * line)
        way = np.linalg.norm(centres - begun, axis=-1)
        if np.any(way > tolerance * (1.0 + 1e-6) + _APART * float(radii.max())):
            worst = int(np.argmax(way))
            moved = f"disk {worst} would have to move by {way[worst]:.6g}"
            raise InputError(f"{moved}, more than relax = {tolerance:g}, to overlap with none")
    raise InputError(f"disks still overlap after {_MOST_PASSES} passes of relax = {tolerance:g}")
