"""What a trajectory file holds for analyses: fields, series, collisions of tracked disks; or which key stores it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.observables import Measure
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory

COLUMNS = ("time", "id", "partner", "normal", "impulse", "psi", "regime")


@dataclass(frozen=True, eq=False, repr=False)
class Collisions(Brief):
    """Collisions of tracked disks with disks, in a window of time; one of two tracked disks is there twice.

    Attributes
    ----------
    time, id, partner, normal, impulse, psi, regime : arrays (c, ...)
        As in the file.
    tracked : array (m,) of int
        The disks that are tracked.
    span : tuple of two floats
        The time that is known [time].
    """

    time: NDArray[np.float64]
    id: NDArray[np.int32]
    partner: NDArray[np.int32]
    normal: NDArray[np.float64]
    impulse: NDArray[np.float64]
    psi: NDArray[np.float64]
    regime: NDArray[np.int8]
    tracked: NDArray[np.int32]
    span: tuple[float, float]

    @property
    def once(self) -> NDArray[np.bool_]:
        """Which of them to take so that each collision is there once, shape (c,)."""
        return (self.id < self.partner) | ~np.isin(self.partner, self.tracked)


def need(trajectory: Trajectory, *fields: str) -> None:
    """Raise InputError that says which keys of the case would have stored these fields, unless they are there."""
    missing = [name for name in fields if name not in trajectory.fields]
    if missing:
        names = " and ".join(f'"{name}"' for name in missing)
        raise InputError(
            f"{trajectory.path} holds no {' and no '.join(missing)} of the disks: put {names} into output.fields of "
            "the case and run it again"
        )


def series(trajectory: Trajectory, *names: str) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """Times, and whole-gas quantities by name: from `timeseries`, or at the frames if there are more of these.

    Raises
    ------
    InputError
        If the file has not got one of them.
    """
    at_frames = all(name in trajectory.observables for name in names)
    rows = len(trajectory.series.time)
    if (
        all(name in trajectory.series for name in names)
        and rows
        and not (at_frames and rows < len(trajectory))
    ):
        return trajectory.series.time, [trajectory.series[name].astype(float) for name in names]
    missing = [name for name in names if name not in trajectory.observables]
    if missing:
        fields = [name for name in missing if name in trajectory.fields]
        of_disks = f" ({' and '.join(fields)} of each disk it holds, as a field)" if fields else ""
        wanted = ", ".join(f'"{name}": {_measured(name)}' for name in missing)
        raise InputError(
            f"{trajectory.path} holds no observable {' and no observable '.join(missing)}{of_disks}: `ifrdem run` "
            f"writes these into every file; from Python, file.write(state, {{{wanted}}}) does, with measure = "
            "ifrdem.model.observables.measure(disks, state)"
        )
    return trajectory.times, [trajectory.observables[name].astype(float) for name in names]


def _measured(name: str) -> str:
    """Where Python has a whole-gas quantity."""
    known = name in Measure.__dataclass_fields__ or hasattr(Measure, name)
    return f"measure.{name}" if known else "..."


def collisions(trajectory: Trajectory) -> Collisions:
    """Collisions of tracked disks with other disks; those with walls and kicks are left out.

    Raises
    ------
    InputError
        If the file has no histories, or no time of them is known.
    """
    tracked = trajectory.tracked
    if not len(tracked):
        raise InputError(
            f"{trajectory.path} holds no histories of collisions: name the disks to track in output.histories of "
            "the case and run it again"
        )
    rows, *span = trajectory.tracked_events
    found = {name: trajectory.read_events(name, rows) for name in COLUMNS}
    pair = found["partner"] >= 0
    return Collisions(
        **{name: column[pair] for name, column in found.items()}, tracked=tracked, span=(span[0], span[1])
    )
