"""Columns of the tally that belong to walls, behind those of `columns.TALLY`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels.columns import PISTON_STATE, TALLY, WALL_SUM, Named, named
from ..kernels.walls.kinds import FREE


@dataclass(frozen=True)
class WallTally:
    """Heat of each thermal wall, sums of each wall if they are recorded, and states of pistons, in this order.

    Attributes
    ----------
    thermal : array of int
        Numbers of the thermal walls.
    n_summed : int
        Walls whose sums are recorded.
    pistons : array of int
        Rows of `walls` that are pistons.
    """

    thermal: NDArray[np.int64]
    n_summed: int
    pistons: NDArray[np.int64]

    @classmethod
    def of(cls, rows: NDArray[np.float64], *, summed: bool) -> WallTally:
        """The columns for rows of `walls`, whose sums are recorded if `summed`; their numbers are written in them."""
        wall = named(rows, "walls")
        owner = wall.owner.astype(np.int64)
        thermal, pistons = np.unique(owner[wall.temperature > 0.0]), np.flatnonzero(wall.motion.kind == FREE)
        found = cls(thermal, int(owner.max()) + 1 if summed else 0, pistons)
        if len(rows):
            wall.heat = np.where(np.isin(owner, thermal), np.searchsorted(thermal, owner), -1)
            wall.sums = len(thermal) + WALL_SUM.width * owner
            wall.piston.sums[pistons] = found._first_piston + PISTON_STATE.width * np.arange(len(pistons))
            wall.piston.next[pistons] = np.append(pistons[1:], -1)[: len(pistons)]
        return found

    @property
    def _first_piston(self) -> int:
        return len(self.thermal) + WALL_SUM.width * self.n_summed

    @property
    def width(self) -> int:
        """Number of all columns of the tally."""
        return TALLY.width + self._first_piston + PISTON_STATE.width * len(self.pistons)

    def heats(self, tally: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heat that each thermal wall gave [energy], shape (thermal walls,), of a tally."""
        return tally[TALLY.width : TALLY.width + len(self.thermal)]

    def sums(self, tally: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums of walls in a tally, shape (walls, 6): columns `model.walls.SUMS`."""
        first = TALLY.width + len(self.thermal)
        return tally[first : TALLY.width + self._first_piston].reshape(-1, WALL_SUM.width)

    def piston_states(self, tally: NDArray[np.float64]) -> Named:
        """Displacement and speed of each piston in a tally, with the names of `columns.PISTON_STATE`."""
        return Named(tally[TALLY.width + self._first_piston :].reshape(-1, PISTON_STATE.width), PISTON_STATE)
