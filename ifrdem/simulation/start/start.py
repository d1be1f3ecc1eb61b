"""The gas at the start of an engine, on one process or several ranks: counts of all disks, slices of ranks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InputError
from ...model.state import DiskKinds, Disks, State, scatter_state
from ...mpi import current
from ...mpi.distribution import broadcast_constant_rows
from .checks import fastest


@dataclass(frozen=True)
class StartCounts:
    """Counts of all disks of all ranks at the start.

    Attributes
    ----------
    n : int
        Disks.
    speed : float
        The largest velocity component or R |omega| [length/time].
    collisions, wall_collisions, asleep : int
        Collisions of two disks and with walls so far, and disks that sleep.
    immovable : bool
        True if a disk has an infinite mass.
    """

    n: int
    speed: float
    collisions: int
    wall_collisions: int
    asleep: int
    immovable: bool

    @classmethod
    def of(cls, disks: Disks, state: State) -> StartCounts:
        """The counts of disks that the root has, or each rank a slice of; InputError if the state has others."""
        comm = current()

        def here() -> tuple[int, float, int, int, int, bool]:
            if state.n != disks.n:
                raise InputError(f"the state has {state.n} disks: must be {disks.n}")
            met, hits = (int(each.sum(dtype=np.int64)) for each in (state.collisions, state.wall_collisions))
            speed = fastest(disks, state.velocity, state.spin)
            return disks.n, speed, met, hits, int(np.count_nonzero(state.asleep)), not disks.movable.all()

        found = [each for each in comm.allgather(comm.run_on_holders(here)) if each]
        n, speed, met, hits, asleep, immovable = zip(*found, strict=True)
        return cls(sum(n), max(speed), sum(met) // 2, sum(hits), sum(asleep), any(immovable))


@dataclass(frozen=True)
class StartSlice:
    """Disks and state of a rank's slice at the start, and what all ranks know of the disks.

    Attributes
    ----------
    here, state : Disks, State
        Disks of the slice; without ranks, all of them.
    kinds : Disks
        The kinds of all disks (`DiskKinds`); without ranks, the disks.
    disks : Disks
        All disks on a rank that has them, else their kinds.
    """

    here: Disks
    state: State
    kinds: Disks
    disks: Disks

    @classmethod
    def of(cls, disks: Disks, state: State) -> StartSlice:
        """The slice of disks that the root has, or each rank has its slice of."""
        comm, here, begin = current(), disks, state
        if comm.is_distributed:
            comm.require_equal(repr(state.time), "times of the start")
        else:
            here, begin = scatter_state(disks, state)
        kinds = disks if comm.size == 1 else DiskKinds.of(here)
        return cls(here, begin, kinds, disks if comm.has_all else kinds)

    def history(self) -> dict[str, Any]:
        """Fields of the state on the history of disks: those that the gas does not update stay."""
        state = self.state
        found: dict[str, Any] = {
            "wall_collisions": state.wall_collisions, "latest_collision": state.latest_collision,
            "last_partner": state.last_partner, "angle": state.angle, "dissipated": state.dissipated,
            "asleep": state.asleep,
        }  # fmt: skip
        if current().size > 1:
            found = {name: broadcast_constant_rows(value) for name, value in found.items()}
        return found
