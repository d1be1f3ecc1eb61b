"""Overlaps of disks at a start: whether any overlap, and disks that are moved apart.

Of ranks of MPI, each gives the disks of its slice. Of many disks, kernels find the pairs (`cells.py`); of few, NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError
from ...model.box import Box
from ...model.device import Device
from ...model.near import Finder, near_pairs, near_pairs_by_trees
from ...model.overlaps import TOLERANCE, checked_radii, close_pairs, refuse_wider_than_box
from ...mpi import current
from ...tools.checked import Array
from .. import backend
from . import cells


def _close_pairs_at(
    box: Box, radius: Array, position: Array, time: float, margin: float = 0.0, near: Finder = near_pairs
) -> NDArray[np.intp]:
    """`close_pairs` at a `time` [time], in a sheared box too, where `near` knows the images to the sides only."""
    if box.shear_rate == 0.0 or not len(radius) or box.image_above(time) == 0.0:
        return close_pairs(box, radius, position, margin, near)
    low = np.flatnonzero(position[:, 1] < 2.0 * radius.max() * (1.0 + TOLERANCE) + margin)
    above = (position[low] + (box.image_above(time), box.lengths[1])) % (box.lengths[0], math.inf)
    owner = np.concatenate([np.arange(len(radius)), low])
    window = Box(box.lengths, (True, False))
    pairs = close_pairs(window, radius[owner], np.concatenate([position, above]), margin, near)
    return owner[pairs[(pairs < len(radius)).any(axis=1)]]


def check_no_overlap(
    box: Box, radius: ArrayLike, position: ArrayLike, *, tolerance: float = TOLERANCE, time: float = 0.0,
    ids: Sequence[int] | NDArray[np.integer] | None = None, device: Device | None = None,
) -> None:  # fmt: skip
    """Refuse positions at which disks overlap, across the periodic sides too.

    Of ranks of MPI, each gives the disks of its slice (`Communicator`), and all raise the same.

    Distances are computed pair by pair and exactly; cells only find which pairs are near. InputError names the pair
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
    device : Device
        Whose threads look for the pairs (`cells.kernels_for`).
    """

    def wrapped() -> tuple[Array, Array]:
        radii, centres = checked_radii(radius), np.asarray(position, dtype=np.float64)
        if centres.shape != (len(radii), 2):
            raise InputError(f"position has shape {centres.shape}: must be {(len(radii), 2)}")
        return radii, centres

    comm, device = current(), backend.of_rank(device or Device())
    radii, centres = comm.run_on_all(wrapped)
    first = comm.number(len(radii))[0].start

    def refuse_single_ones() -> None:
        finite = np.isfinite(centres)
        if not finite.all():
            i = int(np.argmin(finite)) // 2
            raise InputError(f"position[{first + i}] = {centres[i]}: every value must be finite")
        refuse_wider_than_box(box, radii, first)

    comm.run_on_all(refuse_single_ones)
    own, numbers, radii, centres = _with_neighbors(box, radii, centres, 0.0, time)
    rows, measures = comm.run_on_all(lambda: _overlapping(box, radii, centres, tolerance, time, device))
    pairs, count = np.sort((numbers if ids is None else np.asarray(ids))[rows]), len(rows)
    if comm.size > 1:
        pairs, measures, count = _worst_of_ranks(pairs, measures, own[rows].sum(axis=1))
    if count:
        worst = _worst(pairs, measures)[0]
        (one, other), (overlap, distance, contact) = pairs[worst], measures[worst]
        # Kernels stop where there are too many.
        number = f"{count} pairs" if count < MOST_PAIRS else f"at least {MOST_PAIRS} pairs"
        others = "" if count == 1 else f"; {number} overlap, this one the most"
        raise InputError(
            f"disks {one} and {other} overlap by {overlap:.6g} "
            f"(distance {distance:.6g}, sum of radii {contact:.6g}){others}"
        )


MOST_PAIRS = 1 << 23
"""Overlapping pairs that are counted at most: all disks at one place make n^2 / 2."""
SLACK = 1e-10
"""Part of the contact distance by which kernels look further: far more than the rounding of places in a large box."""


def _near(
    box: Box, radius: Array, position: Array, time: float, part: float, gap: float, device: Device, most: int
) -> NDArray[np.intp]:  # fmt: skip
    """All pairs, the lower index first, that are closer than `part` of contact + `gap` [length], and some others.

    Kernels stop looking where there are more than `most`.
    """
    with cells.kernels_for(len(radius), device) as by_kernels:
        if by_kernels:
            return cells.pairs_within(box, radius, position, part * (1.0 + SLACK), gap, time, most=most)
    return np.sort(_close_pairs_at(box, radius, box.wrap(position, time), time, gap))


def _overlapping(
    box: Box, radius: Array, position: Array, tolerance: float, time: float, device: Device
) -> tuple[NDArray[np.intp], Array]:
    """Pairs that overlap, the lower index first, and overlap, distance, sum of radii of each; (p, 2), (p, 3)."""
    pairs = _near(box, radius, position, time, 1.0 - tolerance, 0.0, device, MOST_PAIRS)
    i, j = pairs.T
    apart = box.wrap(position[j], time) - box.wrap(position[i], time)
    distance = np.linalg.norm(box.minimum_image(apart, time), axis=-1)
    contact = radius[i] + radius[j]
    overlap = contact - distance
    invalid = overlap > tolerance * contact
    return pairs[invalid], np.column_stack((overlap, distance, contact))[invalid]


def _worst(pairs: NDArray[np.integer], measures: Array) -> NDArray[np.intp]:
    """Place of the pair that overlaps most, of the lowest numbers in a tie, shape (1,); (0,) without pairs."""
    return np.lexsort((pairs[:, 1], pairs[:, 0], -measures[:, 0]))[:1]


def _worst_of_ranks(
    pairs: NDArray[np.integer], measures: Array, here: NDArray[np.integer]
) -> tuple[NDArray[np.integer], Array, int]:
    """Pairs that overlap, of all ranks: the worst ones, their data, and the number of all.

    `here` is how many of a pair's disks stand in the own part of the box: a pair of two ranks may be seen by both.
    """
    inner, between = here == 2, here == 1
    worst = np.flatnonzero(inner)[_worst(pairs[inner], measures[inner])]
    gathered = current().allgather(
        (int(inner.sum()), pairs[worst], measures[worst], pairs[between], measures[between])
    )
    counts, best, values, at, more = zip(*gathered, strict=True)
    border, rows = np.unique(np.concatenate(at), axis=0, return_index=True)
    measures = np.concatenate((*values, np.concatenate(more)[rows]))
    return np.concatenate((*best, border)), measures, sum(counts) + len(border)


_BANDS = 64
"""Bands of the box along y for each rank, of which those that it checks are put together."""


def _with_neighbors(
    box: Box, radius: Array, position: Array, gap: float, time: float = 0.0
) -> tuple[NDArray[np.bool_], NDArray[np.int64], Array, Array]:
    """Disks of a part of the box along y, about as many on each rank, and those that reach into it from above.

    So each pair that is closer than contact + `gap` [length] is seen by the rank of its lower disk. Returned are, of
    disks of which each rank gives a slice: whether they stand in the own part, their ids, radii and places. Without
    ranks they are all.
    """
    comm = current()
    if comm.size == 1:
        return np.ones(len(radius), dtype=bool), np.arange(len(radius)), radius, position
    ids, _ = comm.number(len(radius))
    width = 2.0 * comm.largest(float(radius.max(initial=0.0))) * (1.0 + 2.0 * TOLERANCE) + gap
    height = box.lengths[1]
    y = box.wrap(position, time)[:, 1]
    bands = _BANDS * comm.size
    band = np.clip((y / height * bands).astype(np.int64), 0, bands - 1)
    count = comm.allreduce(np.bincount(band, minlength=bands))
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
    target = np.concatenate(to) if to else rows
    numbers = np.arange(ids.start, ids.stop)
    own = rank[band][rows] == target
    received = comm.exchange(target, [own, *(each[rows] for each in (numbers, radius, position))])
    return received[0], received[1], received[2], received[3]


def close_ones(
    box: Box, radius: Array, position: Array, gap: float, also: NDArray[np.bool_] | None = None, time: float = 0.0,
) -> tuple[NDArray[np.int64], Array, Array] | None:  # fmt: skip
    """Disks closer than contact + `gap` [length] to another one, and `also` some others, in order of their ids.

    Their ids, radii and centres; of ranks, which give the disks of their slices, on the first one, and None on others.
    The `time` [time] says where the images above and below are in a sheared box.
    """
    _, ids, radii, positions = _with_neighbors(box, radius, position, gap, time)
    i, j = _near(box, radii, positions, time, 1.0, gap, backend.of_rank(Device()), len(radii) * len(radii)).T
    apart = box.wrap(positions[j], time) - box.wrap(positions[i], time)
    near = np.linalg.norm(box.minimum_image(apart, time), axis=-1) < radii[i] + radii[j] + gap
    rows = np.union1d(i[near], j[near])
    found = ids[rows], radii[rows], positions[rows]
    if also is not None:
        own, _ = current().number(len(radius))
        more = own.start + np.flatnonzero(also), radius[also], position[also]
        found = tuple(map(np.concatenate, zip(found, more, strict=True)))  # type: ignore[assignment]
    gathered = current().gather(found)
    if gathered is None:
        return None
    numbers, radii, positions = (np.concatenate(each) for each in zip(*gathered, strict=True))
    numbers, first = np.unique(numbers, return_index=True)
    return numbers, radii[first], positions[first]


def replace_rows(position: Array, ids: NDArray[np.int64], moved: Array) -> Array:
    """Positions with those of some ids replaced; of ranks, in their slices, the first one's `moved`."""
    own, _ = current().number(len(position))
    found = position.copy()
    here = (ids >= own.start) & (ids < own.stop)
    found[ids[here] - own.start] = moved[here]
    return found


_APART = 1e-7  # of the contact distance: left between disks that were moved apart, so that none overlaps by rounding
_MOST_PASSES = 10_000
_MOST_NAMED = 20


def relax(
    box: Box, radius: ArrayLike, position: ArrayLike, tolerance: float, *, time: float = 0.0
) -> NDArray[np.float64]:
    """Move disks apart that overlap by a little, as measured positions do.

    Of each overlapping pair both disks move by half of the overlap, along the line of centres, until none overlaps.
    Of ranks of MPI, each gives the disks of its slice (`Communicator`); the root moves those that can be in question.

    Raises InputError that names every pair that overlaps by more, or the disk that would have to move further.

    Parameters
    ----------
    radius : array_like (n,)
        Radii [length].
    position : array_like (n, 2)
        Centres [length].
    tolerance : float
        Largest overlap that is taken as an error of measurement [length], and largest way of a disk.
    time : float
        The time [time], which says where the images above and below are in a sheared box.

    Returns
    -------
    array (n, 2)
        Centres without overlaps.
    """
    comm = current()
    radii, start = checked_radii(radius), np.asarray(position, dtype=np.float64)
    largest = comm.largest(float(radii.max(initial=0.0)))
    most = tolerance * (1.0 + 1e-6) + _APART * largest
    # No other disk can be met within these displacements.
    near = close_ones(box, radii, start, 2.0 * most, time=time)

    def moved() -> tuple[NDArray[np.int64], Array]:
        assert near is not None  # on the first rank
        return near[0], _relaxed(box, *near, tolerance, most, time)

    return replace_rows(start, *comm.root_result(moved))


def _relaxed(
    box: Box, ids: NDArray[np.int64], radii: Array, start: Array, tolerance: float, most: float, time: float
) -> Array:
    """Centres of some disks at which none overlaps; errors as `relax`, or if one moves further than `most`."""
    centres = start.copy()
    for attempt in range(_MOST_PASSES):
        i, j = _close_pairs_at(box, radii, box.wrap(centres, time), time, near=near_pairs_by_trees).T
        apart = box.minimum_image(centres[j] - centres[i], time)
        distance = np.linalg.norm(apart, axis=-1)
        contact = radii[i] + radii[j]
        overlap = contact - distance
        if attempt == 0 and np.any(overlap > tolerance):
            order = [k for k in np.argsort(-overlap) if overlap[k] > tolerance]
            named = [
                f"disks {ids[min(i[k], j[k])]} and {ids[max(i[k], j[k])]} overlap by {overlap[k]:.6g}, more than "
                f"relax = {tolerance:g}"
                for k in order[:_MOST_NAMED]
            ]
            more = [f"and {len(order) - len(named)} more pairs"] if len(order) > len(named) else []
            raise InputError("\n".join((*named, *more)))
        invalid = overlap > 0.0
        if not invalid.any():
            return centres
        i, j, overlap = i[invalid], j[invalid], overlap[invalid] + _APART * contact[invalid]
        line = np.where(
            distance[invalid, None] > 0.0,
            apart[invalid] / np.maximum(distance[invalid, None], 1e-300),
            [1.0, 0.0],
        )
        np.add.at(centres, i, -0.5 * overlap[:, None] * line)
        np.add.at(centres, j, 0.5 * overlap[:, None] * line)
        displacement = np.linalg.norm(centres - start, axis=-1)
        if np.any(displacement > most):
            worst = int(np.argmax(displacement))
            moved = f"disk {ids[worst]} would have to move by {displacement[worst]:.6g}"
            raise InputError(f"{moved}, more than relax = {tolerance:g}, to overlap with none")
    raise InputError(f"disks still overlap after {_MOST_PASSES} passes of relax = {tolerance:g}")
