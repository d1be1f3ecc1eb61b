"""Disks that are added to strips of a box one after the other, each where it overlaps none before it.

Attempts come in bulk, and succeed as if they were made one by one. Kernels (`kernels/starts.py`) make them so, each strip
by one thread; NumPy compares all of them at once, and gives the same places to the bit.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model.box import Box
from ..model.near import near_pairs
from ..model.overlaps import TOLERANCE, size_classes
from ..simulation.start import cells
from ..tools.checked import Array

Attempts = tuple[NDArray[np.intp], Array]
"""Disks and the places that are tried for them, in order; shape (attempts,) and (attempts, 2)."""
Trials = Generator[Attempts, NDArray[np.intp], None]
"""Attempts on a strip, which are sent the numbers of those that succeeded."""


@dataclass(frozen=True)
class Strip:
    """A strip of a box, from `begin` to `end` [length] across an axis, infinite where it is the whole box.

    `radii` are those of its disks (n,) [length]; disks of its neighbours are in their way, of `other_radii` at
    `others` (m, 2).
    """

    radii: Array
    others: Array
    other_radii: Array
    begin: float
    end: float


def _overlaps_none(
    box: Box, candidate: Array, radius: Array, placed: Array, placed_radius: Array
) -> NDArray[np.bool_]:
    """Mask of candidates, of these radii, that overlap none of the placed disks; shape (candidates,)."""
    clear = np.ones(len(candidate), dtype=bool)
    # By size class, as in `close_pairs`: candidates need not look for small disks as far as for large ones.
    for members in size_classes(placed_radius, 2.0):
        reach = float(radius.max() + placed_radius[members[0]]) * (1.0 + 2.0 * TOLERANCE)
        left = np.flatnonzero(clear)
        i, j = near_pairs(box, reach, candidate[left], placed[members])
        distance = np.linalg.norm(box.minimum_image(candidate[left[i]] - placed[members[j]]), axis=1)
        contact = radius[left[i]] + placed_radius[members[j]]
        clear[left[i[distance <= contact * (1.0 + TOLERANCE)]]] = False
    return clear


def _accepted(box: Box, candidate: Array, radius: Array, owner: NDArray[np.intp]) -> NDArray[np.intp]:
    """Attempts that succeed when they are made one after the other, in order; shape (successes,).

    Attempt c puts disk `owner[c]`, of radius `radius[c]`, at `candidate[c]`. It fails if an earlier success
    is in its way or has placed the same disk.
    """
    reach = 2.0 * float(radius.max(initial=0.0)) * (1.0 + 2.0 * TOLERANCE)
    pairs = np.column_stack(near_pairs(box, reach, candidate))
    distance = np.linalg.norm(box.minimum_image(candidate[pairs[:, 0]] - candidate[pairs[:, 1]]), axis=1)
    contact = radius[pairs[:, 0]] + radius[pairs[:, 1]]
    pairs = np.sort(pairs[distance <= contact * (1.0 + TOLERANCE)], axis=1)
    pairs = pairs[np.argsort(pairs[:, 1], kind="stable")]
    begins = np.searchsorted(pairs[:, 1], np.arange(len(candidate) + 1)).tolist()
    earlier = pairs[:, 0].tolist()
    success = [False] * len(candidate)
    placed: set[int] = set()
    for c, disk in enumerate(owner.tolist()):
        if disk not in placed and not any(success[e] for e in earlier[begins[c] : begins[c + 1]]):
            success[c] = True
            placed.add(disk)
    return np.flatnonzero(success)


def add_by_numpy(box: Box, _axis: int, strips: Sequence[Strip], trials: Sequence[Trials]) -> list[Array]:
    """Places of the disks of each strip, after all attempts on it."""
    found = []
    for strip, attempts in zip(strips, trials, strict=True):
        position, placed = np.empty((len(strip.radii), 2)), np.empty(0, dtype=np.intp)
        for owner, candidate in (answered := _Answered(attempts)):
            kept = np.arange(len(owner))
            if len(placed) + len(strip.other_radii):
                there = np.concatenate((strip.others, position[placed]))
                radii = np.concatenate((strip.other_radii, strip.radii[placed]))
                kept = np.flatnonzero(_overlaps_none(box, candidate, strip.radii[owner], there, radii))
            success = kept[_accepted(box, candidate[kept], strip.radii[owner[kept]], owner[kept])]
            position[owner[success]] = candidate[success]
            placed = np.concatenate((placed, owner[success]))
            answered.answer = success
        found.append(position)
    return found


class _Answered:
    """Iterates over attempts, and sends back the `answer` that the loop has set."""

    def __init__(self, trials: Trials) -> None:
        self._trials = trials
        self.answer: NDArray[np.intp] | None = None

    def __iter__(self) -> Iterator[Attempts]:
        return self

    def __next__(self) -> Attempts:
        return next(self._trials) if self.answer is None else self._trials.send(self.answer)


def add_by_kernels(box: Box, axis: int, strips: Sequence[Strip], trials: Sequence[Trials]) -> list[Array]:
    """As `add_by_numpy`, of all strips at the same time, by kernels, which must be there (`cells.kernels_for`)."""
    from ..kernels.starts import add_in_order

    own = np.array([len(strip.radii) for strip in strips])
    there = np.array([len(strip.other_radii) for strip in strips])
    starts = np.concatenate([[0], np.cumsum(own + there)])
    radius = np.concatenate([each for strip in strips for each in (strip.radii, strip.other_radii)])
    position = np.concatenate(
        [each for s, strip in enumerate(strips) for each in (np.empty((own[s], 2)), strip.others)]
    )
    frame, level, cell = _strips_in_cells(box, axis, strips, radius)
    head, next_in_cell = (
        np.full(cells.cells_of(cell), -1, dtype=np.int32),
        np.empty(len(radius), dtype=np.int32),
    )
    placed = np.zeros(len(radius), dtype=np.int32)
    answered = [_Answered(each) for each in trials]
    stood = [(int(start + n), int(end)) for start, n, end in zip(starts, own, starts[1:], strict=False)]
    while True:
        batches = [next(each, None) for each in answered]
        if not any(each is not None for each in batches):
            break
        none = np.empty(0, dtype=np.intp), np.empty((0, 2))
        given = [none if each is None else each for each in batches]
        first = np.concatenate([[0], np.cumsum([len(owner) for owner, _ in given])]).astype(np.int32)
        owner = np.concatenate([owner + start for (owner, _), start in zip(given, starts, strict=False)])
        success = np.zeros(len(owner) + 1, dtype=np.int32)
        add_in_order(
            1.0 + TOLERANCE, np.array(stood, dtype=np.int32), first, np.append(owner, 0).astype(np.int32),
            np.concatenate([*(candidate for _, candidate in given), np.zeros((1, 2))]), success,
            position, radius, placed, frame, level, cell, head, next_in_cell,
        )  # fmt: skip
        stood = [(0, 0)] * len(strips)  # they are inserted once
        for s, each in enumerate(answered):
            each.answer = np.flatnonzero(success[first[s] : first[s + 1]])
    return [position[start : start + n] for start, n in zip(starts, own, strict=False)]


def _strips_in_cells(
    box: Box, axis: int, strips: Sequence[Strip], radius: Array
) -> tuple[Array, Array, NDArray[np.int32]]:
    """Rows of `frame` for strips, and of `level` and `cell` for as many levels of each (`kernels/starts.py`)."""
    tops = cells.tops_of(float(radius.max()), float(radius.min()))
    frames, levels, numbers, first = [], [], [], 0
    for strip in strips:
        low, high, around = np.zeros(2), np.array(box.lengths), list(box.periodic)
        if np.isfinite(strip.begin):  # with room for disks that reach into it
            reach = 2.0 * float(tops[0]) * (1.0 + 4.0 * TOLERANCE)
            low[axis], high[axis], around[axis] = strip.begin - reach, strip.end + reach, False
        frames.append(cells.frame_of(box, low, high, (around[0], around[1])))
        number = cells.numbers_in(tops, strip.radii) + cells.numbers_in(tops, strip.other_radii)
        level, cell = cells.levels_in(frames[-1], tops, number)
        cell[:, 2] += first
        first = cells.cells_of(cell)
        levels.append(level)
        numbers.append(cell)
    return np.stack(frames), np.concatenate(levels), np.concatenate(numbers)
