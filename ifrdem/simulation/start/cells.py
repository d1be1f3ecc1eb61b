"""Cells in which kernels find disks before there is an engine (`kernels/starts.py`): their frames, levels and numbers.

Up to FEW disks NumPy is faster than the start of a runtime.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...model.box import Box
from ...model.device import Device
from ...tools import progress
from ...tools.checked import Array
from .. import backend

FEW = 100_000
"""Disks up to which NumPy places and compares them in less time than it takes to start the runtime and its kernels."""


@contextlib.contextmanager
def kernels_for(n: int, device: Device) -> Iterator[bool]:
    """Yield whether kernels are to find disks among n, and keep the runtime to this thread if so.

    Not if they are few; or if the runtime runs on a GPU, or in another thread, or in a process of which this is a copy.
    The runtime is started if none runs: on the CPU, with the threads of `device`.
    """
    if n <= FEW or not backend.can_be_used():
        yield False
        return
    with backend.sole_use():
        yield backend.start_unless_running(replace(device, name="cpu")).device == "cpu"


def frame_of(
    box: Box, low: Array, high: Array, around: tuple[bool, bool] = (False, False), above: float = 0.0
) -> Array:
    """A row of `frame`: a region from `low` to `high` [length] that has cells, which go `around` the box along an axis.

    In a sheared box, the image `above` is so far along x [length].
    """
    periodic = np.array(box.periodic, dtype=np.float64)
    side = np.maximum(high - low, np.finfo(np.float64).tiny)
    length = np.where(box.periodic, box.lengths, side)  # of the others it is not used, but finite
    found: Array = np.concatenate([low, side, np.array(around, dtype=np.float64), length, periodic, [above]])
    return found


def tops_of(largest: float, smallest: float) -> Array:
    """The largest radius of each level, from that of all disks on, each half of the one before [length]."""
    count = max(math.ceil(math.log2(largest / smallest)), 1)
    found: Array = np.array([largest * 0.5**level for level in range(count)])
    return found


def numbers_in(tops: Array, radius: Array) -> NDArray[np.int64]:
    """Number of the disks of each level, of radii (n,), or of one for all of them as an array without strides."""
    if len(tops) == 1:
        return np.array([len(radius)])
    level = np.searchsorted(-tops, -radius, side="right") - 1
    return np.bincount(level, minlength=len(tops))


def levels_in(
    frame: Array, tops: Array, numbers: NDArray[np.int64], gap: float = 0.0
) -> tuple[Array, NDArray[np.int32]]:
    """Rows of `level` and `cells` for a frame whose levels have so many disks: about as many cells as disks.

    No side is shorter than the diameter of the level's largest disk plus `gap` [length].
    """
    sides, first = frame[2:4], 0
    level, cells = np.empty((len(tops), 3)), np.empty((len(tops), 3), dtype=np.int32)
    for m, (top, number) in enumerate(zip(tops.tolist(), numbers.tolist(), strict=True)):
        least = max(2.0 * top + gap, math.sqrt(float(np.prod(sides)) / max(number, 1)))
        # A narrow region has one row of them, no more than disks.
        count = np.clip(sides / least, 1, max(number, 1)).astype(np.int64)
        level[m], cells[m] = (*(sides / count), top), (*count, first)
        first += int(np.prod(count))
    return level, cells


def cells_of(cells: NDArray[np.int32]) -> int:
    """Number of all cells of some levels."""
    return int(cells[-1, 2]) + int(cells[-1, 0]) * int(cells[-1, 1])


def pairs_within(
    box: Box, radius: Array, position: Array, within: float, gap: float, time: float, *, most: int
) -> NDArray[np.intp]:
    """Pairs of disks (i, j), i < j, closer than `within` times the sum of radii plus `gap` [length]; shape (pairs, 2).

    Kernels must be there (`kernels_for`). Positions (n, 2) [length], in the box or not, must be finite; `time` [time]
    says where the images above and below are in a sheared box. Of more than `most`, at least so many are returned.
    """
    from ...kernels.starts import count_in_cells, find_close, list_in_cells

    low, high = np.zeros(2), np.asarray(box.lengths, dtype=np.float64)
    for axis in (0, 1):
        if not box.periodic[axis]:
            low[axis], high[axis] = position[:, axis].min(), position[:, axis].max()
    above = box.image_above(time) if box.shear_rate else 0.0
    frame = frame_of(box, low, high, box.periodic, above)
    largest, smallest = float(radius.max()), float(radius.min())
    tops = tops_of(largest, smallest)
    level, cells = levels_in(frame, tops, numbers_in(tops, radius), gap)
    given: tuple[Any, ...] = (
        np.ascontiguousarray(position), radius[:1].copy() if largest == smallest else np.ascontiguousarray(radius),
        frame[None], level, cells,
    )  # fmt: skip
    begin, listed = np.zeros(cells_of(cells) + 1, dtype=np.int32), np.empty(len(position), dtype=np.int32)
    place, size = np.empty((len(position), 2)), np.full(1 if largest == smallest else len(position), largest)
    done = progress.stage("comparing disks")
    count_in_cells(*given, begin)
    done(0.2)
    np.cumsum(begin, out=begin)
    list_in_cells(*given, begin, listed, place, size)
    done(0.7)
    room, found = 1024, np.full(1, np.iinfo(np.int32).max, dtype=np.int32)
    while found[0] > room:
        # A pair may be found twice, near two sides.
        room, found[0] = 64 * room, 0
        pairs = np.empty((room, 2), dtype=np.int32)
        find_close(within, gap, *given[2:], begin, listed, place, size, pairs, found)
        if room > 2 * most:
            break
    done(1.0)
    return np.unique(np.sort(pairs[: found[0]], axis=1), axis=0).astype(np.intp)
