"""The whole history of a tracked disk: its collisions, and its position at any time between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, NameMissing, nearest, there_are
from ..model.box import Box
from ..quantities import EVENT, START
from ..tools.checked import Numbers, validated
from . import damage
from .layout import HISTORIES as GROUP

Times = Annotated[ArrayLike, Numbers(None, -np.inf, np.inf, gaps=True)]

KICK = -1
"""Partner of an event that is no collision: a force changed the disk's velocity or spin."""

_BLOCK = 16384 * 16  # rows that are looked through at once: whole chunks


@dataclass(frozen=True, eq=False)
class History:
    """Every event of one disk in the order of time, and its exact path.

    Columns are there by their names, as `history["psi"]` and as `history.psi`; but `history.position(t)` is where the
    disk was at any time t, and `history["position"]` where it was at its events. `len` counts events.

    Attributes
    ----------
    disk : int
        Id of the disk.
    start, end : float
        Times between which its path is known [time]: when tracking began, and up to when all is committed.
    columns : dict
        The columns by name, read-only:
    time : array (E,)
        Times of its events [time].
    partner : array (E,)
        Id of the other disk; -2 - w for wall w (`Trajectory.walls`, then the sides of the box); -1 no collision: a
        force changed the disk's velocity or spin (a kick).
    position : array (E, 2)
        Centre of the disk then [length], inside the box.
    image : array (E, 2)
        Box lengths travelled, as in a frame.
    normal : array (E, 2)
        Unit vector from the disk's centre to the partner's, or to the wall; 0 for a kick.
    contact_point : array (E, 2)
        position + radius * normal [length].
    velocity_before, velocity_after : array (E, 2)
        Of the disk [length/time].
    spin_before, spin_after : array (E,)
        Of the disk [rad/time].
    partner_velocity_before, partner_velocity_after : array (E, 2)
    partner_spin_before, partner_spin_after : array (E,)
        Velocity and spin of the partner; of a wall its velocity at the contact, and no spin.
    impulse : array (E, 2)
        Impulses that the disk gives along normal n and t = (-n_y, n_x): (P_n, P_t) [mass length/time].
    psi : array (E,)
        Angle of impact between the relative velocity of the centres and the line of centres [rad], 0 to pi/2.
    regime : array (E,)
        As `Regime`; -1 not known, 0 a kick or separating, 9 elastic by a remedy for collapse.
    """

    disk: int
    start: float
    end: float
    columns: dict[str, NDArray[Any]] = field(repr=False)
    _box: Box = field(repr=False)
    _gravity: NDArray[np.float64] = field(repr=False)
    # Where flights begin, at the start of tracking and after each event: time, position, velocity, spin, image, angle.
    _flights: dict[str, NDArray[Any]] = field(repr=False)

    @validated
    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self.columns:
            raise NameMissing(f"a history has no column {name!r}{there_are(str(name), self.columns)}")
        return self.columns[name]

    def __getattr__(self, name: str) -> NDArray[Any]:
        columns = self.__dict__.get("columns", {})
        if name in columns:
            return columns[name]
        raise AttributeError(f"a history has no {name!r}{nearest(name, [*columns, *type(self).__dict__])}")

    def __len__(self) -> int:
        """Number of events, kicks included."""
        return len(self.columns["time"])

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.columns})

    def __repr__(self) -> str:
        """Id, number of events and time range."""
        return f"<History of disk {self.disk}: {self.collisions} collisions, t = {self.start:.6g} to {self.end:.6g}>"

    @property
    def collisions(self) -> int:
        """Number of collisions, with disks and walls."""
        return int(np.count_nonzero(self["partner"] != KICK))

    @property
    def free_times(self) -> NDArray[np.float64]:
        """Times between successive collisions [time], shape (collisions - 1,)."""
        return np.diff(self["time"][self["partner"] != KICK])

    @property
    def mean_free_time(self) -> float:
        """Mean time between successive collisions [time]; nan with less than two."""
        times = self.free_times
        return float(times.mean()) if len(times) else float("nan")

    @validated
    def position(self, t: Times) -> NDArray[np.float64]:
        """Centre at times t [time] of any shape (...): inside the box [length], shape (..., 2). Exact.

        Raises InputError if a time is not between `start` and `end`.
        """
        at, _, unwrapped = self._flight(t)
        return self._box.wrap(unwrapped, at)

    @validated
    def unwrapped(self, t: Times) -> NDArray[np.float64]:
        """Centre at times t on a path without jumps: `Box.unwrap` of position and image."""
        at, flight, unwrapped = self._flight(t)
        return self._box.unwrap(unwrapped, flight["image"], at)

    @validated
    def velocity(self, t: Times) -> NDArray[np.float64]:
        """Velocity in the lab at times t [length/time], shape (..., 2); after the event at the time of one."""
        at, flight, unwrapped = self._flight(t)
        velocity = flight["velocity"] + (at - flight["time"])[..., None] * self._gravity
        if self._box.shear_rate:  # a disk that leaves a sheared box above enters below, so much slower
            height = self._box.lengths[1]
            velocity[..., 0] -= np.floor(unwrapped[..., 1] / height) * self._box.shear_rate * height
        return velocity

    @validated
    def spin(self, t: Times) -> NDArray[np.float64]:
        """Spin at times t [rad/time], shape (...); after the event at the time of one."""
        return self._flight_start(t)[1]["spin"]

    @validated
    def angle(self, t: Times) -> NDArray[np.float64]:
        """Angle by which the disk has turned since tracking began, at times t [rad], shape (...)."""
        at, flight = self._flight_start(t)
        return flight["angle"] + flight["spin"] * (at - flight["time"])

    def _flight_start(self, t: ArrayLike) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]]]:
        """Times, and the beginnings of the flights at these times."""
        at = np.asarray(t, dtype=np.float64)
        invalid = ~((at >= self.start) & (at <= self.end))
        if invalid.any():
            outside = at[invalid].flat[0] if at.ndim else float(at)
            known = f"is known from {self.start:.17g} to {self.end:.17g}"
            raise InputError(f"t = {outside:.17g}: the history of disk {self.disk} {known}")
        event = np.searchsorted(self._flights["time"], at, side="right") - 1
        return at, {name: value[event] for name, value in self._flights.items()}

    def _flight(
        self, t: ArrayLike
    ) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]], NDArray[np.float64]]:
        """Times, beginnings of flights, and positions unwrapped from the box of the latest event."""
        at, flight = self._flight_start(t)
        since = (at - flight["time"])[..., None]
        return at, flight, flight["position"] + since * (flight["velocity"] + 0.5 * since * self._gravity)


def tracked(file: h5py.File) -> NDArray[np.int32]:
    """Ids of the disks whose histories a file holds, ascending."""
    if GROUP not in file:
        return np.zeros(0, dtype=np.int32)
    return damage.read(file[f"{GROUP}/tracked"])


def committed(file: h5py.File, path: str) -> tuple[int, float, float]:
    """Number of committed events of all disks, and the times between which histories are complete [time].

    Raises InputError if the file has no histories, or a part of them cannot be read.
    """
    if GROUP not in file:
        raise InputError(
            f"{path} holds no histories: `histories` under [output] of the case (output.histories) names the disks "
            "to track, and the run must be made again"
        )
    group = file[f"{GROUP}/committed"]
    last = len(group["events"]) - 1  # grows last; the first row is that of the start
    count, end = int(damage.read(group["events"], last)), float(damage.read(group["time"], last))
    return count, float(damage.read(file[f"{GROUP}/start/time"])), end


def read(
    file: h5py.File, path: str, disk: int, *, box: Box, radius: NDArray[np.float64], gravity: ArrayLike
) -> History:
    """The history of a disk. Memory holds its own events, and a block of those of all.

    Raises InputError if the file has no histories, or not of this disk; the message says of which, or how to ask for
    them.
    """
    count, _, end = committed(file, path)
    ids = tracked(file)
    row = int(np.searchsorted(ids, disk))
    if row == len(ids) or ids[row] != disk:
        near = int(ids[np.argmin(np.abs(ids.astype(np.int64) - disk))]) if len(ids) else None
        some = ", ".join(map(str, ids[:5])) + (", ..." if len(ids) > 5 else "")
        raise InputError(
            f"disk {disk} of {path} is not tracked: {len(ids)} of {len(radius)} disks are ({some})"
            + ("" if near is None else f"; the nearest is {near}")
        )
    columns, group = _events(file, disk, count), file[GROUP]
    flights = {"time": np.concatenate([[float(damage.read(group["start/time"]))], columns["time"]])}
    for name in START:
        after = columns[f"{name}_after" if name in ("velocity", "spin") else name]
        flights[name] = np.concatenate([damage.read(group[f"start/{name}"], row)[None], after])
    flights["angle"] = np.concatenate([[0.0], np.cumsum(flights["spin"][:-1] * np.diff(flights["time"]))])
    columns["contact_point"] = columns["position"] + radius[disk] * columns["normal"]
    for column in columns.values():
        column.flags.writeable = False
    start = float(flights["time"][0])
    return History(disk, start, end, columns, box, np.asarray(gravity, dtype=np.float64), flights)


def _events(file: h5py.File, disk: int, count: int) -> dict[str, NDArray[Any]]:
    """The columns of a disk's events among the first `count` of all."""
    events = file[f"{GROUP}/events"]
    found: dict[str, list[NDArray[Any]]] = {
        name: [np.zeros((0, *column.tail), dtype=events[name].dtype)]
        for name, column in EVENT.items()
        if name != "id"
    }
    for first in range(0, count, _BLOCK):
        last = min(first + _BLOCK, count)
        mine = np.flatnonzero(damage.read(events["id"], slice(first, last)) == disk)
        if len(mine):
            rows = slice(first + int(mine[0]), first + int(mine[-1]) + 1)
            for name, parts in found.items():
                parts.append(damage.read(events[name], rows)[mine - mine[0]])
    return {name: np.concatenate(parts) for name, parts in found.items()}
