"""Columns of the tally that only some gases have, behind those of `columns.TALLY`.

The transfer of momentum and energy by collisions, histograms of them, sums of walls, and energies that forces give
within windows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...kernels.columns import (
    LEVELS,
    PISTON_STATE,
    TALLY,
    TRANSFER,
    WALL_SUM,
    Named,
    histogram_columns,
    named,
    transfer_columns,
)
from ...kernels.layout import Uses
from ...kernels.walls.kinds import FREE


@dataclass(frozen=True)
class ExtraTally:
    """Transfer, histograms, heat and sums of walls, states of pistons, energies that forces give, in this order.

    The transfer, the histograms and the sums of walls are there if they are recorded.

    Attributes
    ----------
    n_transfer : int
        Columns of what collisions transfer (`columns.TRANSFER`): none, the virial, or all.
    n_pairs, n_counts : int
        Pairs of species that have histograms, and columns of each.
    thermal : array of int
        Numbers of the thermal walls.
    n_summed : int
        Walls whose sums are recorded.
    pistons : array of int
        Rows of `walls` that are pistons.
    n_forces : int
        Forces that act within windows.
    """

    n_transfer: int
    n_pairs: int
    n_counts: int
    thermal: NDArray[np.int64]
    n_summed: int
    pistons: NDArray[np.int64]
    n_forces: int = 0

    @classmethod
    def of(cls, rows: NDArray[np.float64], uses: Uses) -> ExtraTally:
        """The columns for rows of `walls` in a gas with these features; their numbers are written in these rows."""
        wall = named(rows, "walls")
        owner = wall.owner.astype(np.int64)
        thermal, pistons = np.unique(owner[wall.temperature > 0.0]), np.flatnonzero(wall.motion.kind == FREE)
        found = cls(
            transfer_columns(uses.stress, uses.heat_flux), uses.histograms * (uses.histograms + 1) // 2, histogram_columns(uses.histograms, uses.free_times), thermal,
            int(owner.max()) + 1 if uses.wall_sums else 0, pistons,
        )  # fmt: skip
        if len(rows):
            heat = found._first_heat + np.searchsorted(thermal, owner)
            wall.heat = np.where(np.isin(owner, thermal), heat, -1)
            wall.sums = found._first_sum + WALL_SUM.width * owner
            wall.piston.sums[pistons] = found._first_piston + PISTON_STATE.width * np.arange(len(pistons))
            wall.piston.next[pistons] = np.append(pistons[1:], -1)[: len(pistons)]
        return found

    @property
    def _first_heat(self) -> int:
        return self.n_transfer + self.n_counts * self.n_pairs

    @property
    def _first_sum(self) -> int:
        return self._first_heat + len(self.thermal)

    @property
    def _first_piston(self) -> int:
        return self._first_sum + WALL_SUM.width * self.n_summed

    @property
    def first_force(self) -> int:
        """Number of the first column of energies that forces give."""
        return TALLY.width + self._first_piston + PISTON_STATE.width * len(self.pistons)

    @property
    def width(self) -> int:
        """Number of all columns of the tally."""
        return self.first_force + LEVELS * self.n_forces

    def transfer(self, tally: NDArray[np.float64]) -> Named:
        """Sums of the transfer of momentum and energy by collisions, in a tally, by the names of `columns.TRANSFER`."""
        return Named(tally[TALLY.width : TALLY.width + self.n_transfer], TRANSFER)

    def histograms(self, tally: NDArray[np.float64]) -> NDArray[np.float64]:
        """Counts of collisions in a tally, shape (pairs of species, columns of `columns.HISTOGRAM` that there are)."""
        counts = tally[TALLY.width + self.n_transfer : TALLY.width + self._first_heat]
        return counts.reshape(self.n_pairs, self.n_counts)

    def heats(self, tally: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heat that each thermal wall gave [energy], shape (thermal walls,), of a tally."""
        return tally[TALLY.width + self._first_heat : TALLY.width + self._first_sum]

    def sums(self, tally: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums of walls in a tally, shape (walls, 6): columns `model.walls.wall.SUMS`."""
        return tally[TALLY.width + self._first_sum : TALLY.width + self._first_piston].reshape(
            -1, WALL_SUM.width
        )

    def piston_states(self, tally: NDArray[np.float64]) -> Named:
        """Displacement and speed of each piston in a tally, with the names of `columns.PISTON_STATE`."""
        states = tally[TALLY.width + self._first_piston : self.first_force]
        return Named(states.reshape(-1, PISTON_STATE.width), PISTON_STATE)

    def gains(self, tally: NDArray[np.float64]) -> NDArray[np.float64]:
        """Energy that each force gave within windows, in parts [energy], shape (forces, LEVELS)."""
        return tally[self.first_force :].reshape(-1, LEVELS)
