"""The layout of the histories in a trajectory file: every collision of the disks that are tracked.

With m tracked disks, E events and K commits::

    histories
      tracked                           (m,) int32 ids, ascending
      start/{time, position, velocity, spin, image}   where each tracked disk was when tracking began
      committed/{events, time}          (K,): so many events are committed, complete up to this time;
                                        `events` grows last: rows beyond its last number do not count
      events/<column>                   (E, ...): see COLUMNS; by time, then id

A collision of two tracked disks stands there twice, once for each. Between events a disk's path is
x(t) = x_e + v_after (t - t_e) + g (t - t_e)^2 / 2 with the parameter `gravity`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..errors import InputError
from . import damage
from .staged_group import staged

HISTORIES = "histories"
CHUNK_EVENTS, FEW_EVENTS, MANY = 16384, 512, 1000
"""Events per chunk of many tracked disks; of fewer than MANY; never compressed: the last chunk is written again by each
commit, and must stay in its place."""


@dataclass(frozen=True)
class Column:
    """A column of the events: components of a row, and the type in the file."""

    components: int
    dtype: DTypeLike

    @property
    def tail(self) -> tuple[int, ...]:
        """Shape of one row."""
        return () if self.components == 1 else (self.components,)


COLUMNS = {
    "time": Column(1, np.float64),
    "id": Column(1, np.int32),
    # 0 or more: a disk; -2 - w: wall w; -1: no collision, a force changed the disk's velocity or spin ("kick").
    "partner": Column(1, np.int32),
    # The disk's centre, inside the box, and box lengths travelled.
    "position": Column(2, np.float64),
    "image": Column(2, np.int32),
    # From the disk's centre to the partner's, or to the wall; 0, 0 for a kick.
    "normal": Column(2, np.float64),
    "velocity_before": Column(2, np.float64),
    "velocity_after": Column(2, np.float64),
    "spin_before": Column(1, np.float64),
    "spin_after": Column(1, np.float64),
    # Of a wall: its velocity at the contact, and spin 0.
    "partner_velocity_before": Column(2, np.float64),
    "partner_velocity_after": Column(2, np.float64),
    "partner_spin_before": Column(1, np.float64),
    "partner_spin_after": Column(1, np.float64),
    # P_n, P_t that the disk gives to its partner along n and t = (-n_y, n_x).
    "impulse": Column(2, np.float64),
    # Angle between the relative velocity of the centres and the line of centres, 0 to pi/2.
    "psi": Column(1, np.float64),
    # `law.Regime`; -1 not known, 9 elastic by the remedy for collapse.
    "regime": Column(1, np.int8),
}

MEANINGS = {
    "partner": "0 or more: a disk; -1: none, a force changed the motion; -2 - w: wall w",
    "regime": "0 none; 1 sliding, 2 sticking; with rolling friction 3 sliding rolling, 4 sticking rolling, 5 sliding "
    "non-rolling, 6 sticking non-rolling; 9 elastic by a remedy for collapse; -1 not known",
}
"""What numbers stand for; in the file an attribute of the column."""

START = {
    "position": Column(2, np.float64),
    "velocity": Column(2, np.float64),
    "spin": Column(1, np.float64),
    "image": Column(2, np.int32),
}


def create(file: h5py.File, tracked: NDArray[np.int32], time: float, start: dict[str, NDArray[Any]]) -> None:
    """Write the group with no event yet."""
    with staged(file, HISTORIES) as group:
        group["tracked"] = tracked
        group["start/time"] = time
        for name, values in start.items():
            group[f"start/{name}"] = values
        for name, column in COLUMNS.items():
            group.create_dataset(
                f"events/{name}",
                shape=(0, *column.tail),
                maxshape=(None, *column.tail),
                chunks=(
                    CHUNK_EVENTS if len(tracked) >= MANY else min(CHUNK_EVENTS, FEW_EVENTS),
                    *column.tail,
                ),
                dtype=column.dtype,
            )
        for name, text in MEANINGS.items():
            group[f"events/{name}"].attrs["meaning"] = text
        for name, first in (("events", np.int64(0)), ("time", np.float64(time))):
            group.create_dataset(f"committed/{name}", data=[first], maxshape=(None,), chunks=(64,))


def as_column(what: str, value: ArrayLike, column: Column, length: int | None = None) -> NDArray[Any]:
    """Values in the type of a column.

    Raises
    ------
    InputError
        If they do not fit its shape or type.
    """
    given = np.asarray(value)
    target = np.dtype(column.dtype)
    shape = (len(given) if given.ndim else 0, *column.tail) if length is None else (length, *column.tail)
    if given.shape != shape:
        raise InputError(f"{what} has shape {given.shape}: {shape} is needed")
    if given.dtype.kind not in ("iu" if target.kind == "i" else "iuf") and given.size:
        raise InputError(f"{what} has type {given.dtype}: {target} is needed")
    if target.kind == "i" and given.size and given.dtype != target:
        limits = np.iinfo(target)
        if not limits.min <= given.min() <= given.max() <= limits.max:
            raise InputError(f"{what}: numbers beyond {limits.max} cannot be stored")
    if target.kind == "f" and not np.isfinite(given).all():
        row = int(np.argmin(np.isfinite(given).reshape(len(given), -1).all(axis=1)))
        raise InputError(f"{what}[{row}] = {given[row]}: every value must be finite")
    return np.ascontiguousarray(given, dtype=target)


def check_layout(file: h5py.File, path: str) -> None:
    """Raise InputError if there are histories and something is missing in them."""
    if HISTORIES not in file:
        return
    group = file[HISTORIES]
    needed = ["tracked", "start/time", "committed/events", "committed/time"]
    needed += [f"start/{name}" for name in START] + [f"events/{name}" for name in COLUMNS]
    missing = [name for name in needed if name not in group]
    if missing:
        raise InputError(f"{path} is damaged: its histories lack {', '.join(missing)}")
    damage.expect(group["tracked"], (None,), "i")
    tracked = len(group["tracked"])
    damage.expect(group["start/time"], ())
    for name, column in START.items():
        damage.expect(group[f"start/{name}"], (tracked, *column.tail))
    for name, column in COLUMNS.items():
        damage.expect(group[f"events/{name}"], (None, *column.tail), "i" if _counts(column) else "f")
    damage.expect(group["committed/events"], (None,), "iu")
    damage.expect(group["committed/time"], (None,), "f")
    commits = len(group["committed/events"])
    if not 0 < commits <= len(group["committed/time"]):
        raise InputError(f"{path} is damaged: its histories have no commit")
    events = int(damage.read(group["committed/events"], commits - 1))
    if events < 0:
        raise InputError(f"{path} is damaged: its histories have {events} events")
    for name in COLUMNS:
        held = len(group[f"events/{name}"])
        if held < events:
            raise InputError(f"{path} is damaged: its histories hold {held} of {events} events ({name})")


def _counts(column: Column) -> bool:
    return np.dtype(column.dtype).kind == "i"
