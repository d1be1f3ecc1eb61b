"""Open boundaries: the periodic box inside of which disks fly that nothing holds together.

The engine's boxes are periodic. Disks in open space get one that is larger than what they fill by ROOM times their
extent, and none of them ever comes so near to its sides that it could touch another one across them: how far a disk
moves in an epoch is bounded by the reach of its list (`kernels/levels.py`), so that it can be told how many epochs
are safe. After those the box is looked at, and laid anew around the disks where they have come near a side. It
then has cells and lists for the distances that are left between neighbours. So epochs get longer as the disks fly
apart, and the cost of a run grows like the logarithm of its time; once no two of them approach each other, nothing more
can happen, and the rest of the run is one flight.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.box import Box
from ..model.state import Disks, State

ROOM = 1.0
"""Free space on either side of the disks in a new box, in extents of what they fill."""
MARGIN = 4.0  # and in diameters beside that
ENOUGH = 0.25  # of the free space of a new box: with less, it is time for the next one
CELLS_PER_DISK = 16
"""Cells of a new box, at most. Most are empty, but the middle of the gas, where it is densest, needs small ones."""


def around(state: State, disks: Disks) -> tuple[Box, NDArray[np.float64]]:
    """A new box, and what is added to plain positions to get places in it [length], shape (2,)."""
    if not state.n:
        return Box((1.0, 1.0)), np.zeros(2)
    low, high = state.position.min(axis=0), state.position.max(axis=0)
    side = (1.0 + 2.0 * ROOM) * float((high - low).max()) + 2.0 * MARGIN * 2.0 * float(disks.radius.max())
    if not math.isfinite(side) or side > 1e100:
        raise InputError(f"positions spread over {(high - low).max():.3g}: too far apart to compute with")
    return Box((side, side)), side / 2.0 - (low + high) / 2.0


class OpenSpace:
    """How much room the disks of an open gas have in the present box, and whether anything can still happen to them.

    Attributes
    ----------
    epochs_left : int
        Epochs that are safe before the box must be looked at.
    parted : bool
        Whether no disk can meet another one any more, unless a force acts.
    """

    def __init__(self, disks: Disks) -> None:
        self._disks = disks
        self._largest = float(disks.radius.max()) if disks.n else 0.0
        self.epochs_left, self.parted = 1, False

    def enter(
        self, box: Box, state: State, offset: NDArray[np.float64], furthest: float, *, parted: bool = False
    ) -> None:
        """Begin in a new box, in which no disk moves further than `furthest` [length] in an epoch."""
        self._box, self._furthest = box, furthest
        self._room = self._free(state.position + offset)
        self.epochs_left = int(self._room / furthest) if state.n else 1
        self.parted = parted or nobody_meets(state, self._disks)

    def numbers(self) -> tuple[float, float, float, float]:
        """All that it knows of the present box, for a checkpoint."""
        return self.epochs_left, self.parted, self._room, self._furthest

    def set_numbers(self, box: Box, numbers: list[float]) -> None:
        """Go on in a box as `numbers` told."""
        self._box, self.epochs_left, self.parted = box, int(numbers[0]), bool(numbers[1])
        self._room, self._furthest = numbers[2], numbers[3]

    def too_small(self, place: NDArray[np.float64]) -> bool:
        """Whether it is time for a new box, the disks being at these places, shape (n, 2); if not, for how long not."""
        room = self._free(place)
        self.epochs_left = int(room / self._furthest)
        return self.epochs_left < 1 or room < ENOUGH * self._room

    def _free(self, place: NDArray[np.float64]) -> float:
        """How far the disks are from the sides [length]."""
        sides = np.array(self._box.lengths)
        return float(np.minimum(place, sides - place).min(initial=sides.min())) - self._largest


def nobody_meets(state: State, disks: Disks) -> bool:
    """Whether no two disks approach each other in a way that they could touch: nothing will happen without forces.

    Every pair is looked at, until one is found; up to MOST_COMPARED disks. Imports the kernels.
    """
    from ..kernels.flights import approaching

    if state.n < 2:
        return True
    if state.n > MOST_COMPARED:
        return False
    begin, rows = 0, 64
    while begin < state.n:
        end = min(begin + rows, state.n)
        if approaching(begin, end, state.position, state.velocity, np.ascontiguousarray(disks.radius)):
            return False
        begin, rows = end, 4 * rows
    return True


MOST_COMPARED = 200_000
"""Disks of which all pairs are compared at most: some ten seconds. More fly on in epochs, which get longer."""
