"""Writes the histories of tracked disks into a trajectory file: every collision, with what it changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, nearest
from ..model.state import State
from . import staged_group
from .file import OutputFile, TrajectoryError
from .history_columns import COLUMNS, HISTORIES, START, as_column, create
from .quantities import is_number
from .rows import Rows


class HistoryWriter:
    """The group `histories` of a file that is being written.

    Parameters
    ----------
    output : OutputFile
        The file.
    n : int
        Number of disks.
    at : int
        Events that the run has written; there may be more in the file, which are compared then.

    Raises
    ------
    InputError
        If the file holds fewer events.
    """

    def __init__(self, output: OutputFile, n: int, at: int = 0) -> None:
        self._output = output
        self._n = n
        self._events: Rows | None = None
        if HISTORIES in output.file:
            self._open(at)
        if at > len(self):
            raise InputError(
                f"{output.path} holds {len(self)} events, the checkpoint had seen {at}: it is another file's"
            )

    def _open(self, at: int = 0) -> None:
        group = self._output.file[HISTORIES]
        marks = group["committed/events"]
        commits = len(marks)
        committed = int(marks[commits - 1])
        self._tracked: NDArray[np.int32] = group["tracked"][()]
        self._complete_to = float(group["committed/time"][commits - 1])
        self._commits = Rows("commit of histories", marks, {"time": group["committed/time"]}, commits)
        columns = {name: group[f"events/{name}"] for name in COLUMNS}
        # The events have no marker of their own: the commits count them.
        self._events = Rows("event of the histories", None, columns, committed, at)

    def __len__(self) -> int:
        """Number of committed events."""
        return 0 if self._events is None else self._events.committed

    @property
    def at(self) -> int:
        """Events that the run has written: less than the committed ones while it repeats them."""
        return 0 if self._events is None else self._events.at

    def begin(self, ids: ArrayLike, state: State) -> None:
        """Begin to track disks; see `TrajectoryWriter.begin_histories`."""
        tracked = as_column("tracked", ids, COLUMNS["id"])
        if not len(tracked) or not 0 <= tracked.min() <= tracked.max() < self._n:
            raise InputError(f"tracked = {ids!r}: numbers of disks from 0 to {self._n - 1} are needed")
        tracked = np.sort(tracked)
        if (tracked[1:] == tracked[:-1]).any():
            twice = tracked[1:][tracked[1:] == tracked[:-1]][0]
            raise InputError(f"tracked: disk {twice} is there twice")
        start = {
            name: as_column(name, getattr(state, name)[tracked], column) for name, column in START.items()
        }
        if self._events is not None:
            self._compare_start(tracked, float(state.time), start)
            return
        size = sum(column.components * np.dtype(column.dtype).itemsize for column in START.values())
        self._output.reserve(len(tracked) * size + (len(COLUMNS) + 8) * 8192)
        create(self._output.file, tracked, float(state.time), start)
        self._output.flush()
        self._open()

    def write(self, events: Mapping[str, ArrayLike], time: float) -> None:
        """Append events and commit them; see `TrajectoryWriter.write_histories`."""
        if self._events is None:
            raise InputError("histories: begin_histories comes before write_histories")
        columns = self._checked(events, time)
        rows, count, time = self._events, len(columns["time"]), float(time)
        known = rows.known(count)
        if known < count and columns["time"][known] < self._complete_to:
            raise TrajectoryError(
                f"the event of disk {columns['id'][known]} at t = {columns['time'][known]} is not "
                f"in the file, whose histories are complete up to t = {self._complete_to}"
            )
        self._output.reserve(rows.room(count) + self._commits.room(1))
        rows.add(columns)
        end = rows.at + count
        if end < rows.committed and float(rows.datasets["time"][end]) < time:
            raise TrajectoryError(
                f"event {end} of its histories, at t = {rows.datasets['time'][end]}, is missing "
                f"among those up to t = {time}"
            )
        if end > rows.committed or time > self._complete_to:
            self._commits.add({"time": np.array([time])})
            self._output.flush()
            self._commits.mark(np.array([end]))
            self._output.flush()
            self._commits.confirm(1)
            self._complete_to = time
        rows.confirm(count)

    def drop_uncommitted(self) -> None:
        """Remove what an interrupted write left behind the last commit."""
        staged_group.drop(self._output.file, HISTORIES)
        if self._events is not None:
            self._events.drop_uncommitted()
            self._commits.drop_uncommitted()

    def _compare_start(self, tracked: NDArray[Any], time: float, start: Mapping[str, NDArray[Any]]) -> None:
        group = self._output.file[HISTORIES]
        if not np.array_equal(group["tracked"][()], tracked):
            raise TrajectoryError(f"it has histories of other disks than these {len(tracked)}")
        for name, values in (("time", np.float64(time)), *start.items()):
            if group[f"start/{name}"][()].tobytes() != values.tobytes():
                raise TrajectoryError(f"it has histories that began with another {name}")

    def _checked(self, events: Mapping[str, ArrayLike], time: float) -> dict[str, NDArray[Any]]:
        missing = [name for name in COLUMNS if name not in events]
        if missing:
            raise InputError(f"histories: the events lack {', '.join(missing)}")
        unknown = [name for name in events if name not in COLUMNS]
        if unknown:
            raise InputError(f"histories: there is no column {unknown[0]!r}{nearest(unknown[0], COLUMNS)}")
        length = len(np.atleast_1d(np.asarray(events["time"])))
        columns = {
            name: as_column(f"histories: {name}", events[name], column, length)
            for name, column in COLUMNS.items()
        }
        times, ids = columns["time"], columns["id"]
        falling = (times[1:] < times[:-1]) | ((times[1:] == times[:-1]) & (ids[1:] < ids[:-1]))
        if falling.any():
            row = int(np.argmax(falling)) + 1
            raise InputError(f"histories: event {row} at t = {times[row]} is not in the order of time and id")
        if not (is_number(time) and np.isfinite(time)) or (length and times[-1] > time):
            raise InputError(f"histories: time = {time}: a finite time not before the last event is needed")
        foreign = ~np.isin(ids, self._tracked)
        if foreign.any():
            raise InputError(f"histories: disk {ids[foreign][0]} is not tracked")
        return columns
