"""Committed rows: frames, time series and histories that are appended to a trajectory file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..errors import InputError, TrajectoryError, shortened, there_are
from ..model.state import State
from ..quantities import EVENT, FIELDS, START
from ..tools.checked import is_number
from . import layout
from .file import OutputFile, drop_staged
from .layout import HISTORIES, TIMESERIES

MOST_AT_ONCE = 1 << 20
"""Disks of a frame, or numbers of another row, that are written together at most."""


class CommitLog:
    """Datasets with the same number of rows (first axis), and a marker that grows last: the commit.

    Rows beyond the marker do not count. A resumed run gives rows again that are committed: they are compared with the
    file bit for bit. One of the datasets is "time"; `last_time` is that of the row before the next one.

    `what` is the noun for one row ("frame"); the `marker` has a number for each, and is None where something else
    counts the rows; `datasets` by name may be added to before the first row; `committed` rows count, and `at` is the
    number of the row that comes next, by default the one after these. The disks of a part have numbers from
    `first_disk` on, for messages.
    """

    def __init__(
        self,
        what: str,
        marker: h5py.Dataset | None,
        datasets: Mapping[str, h5py.Dataset],
        committed: int = 0,
        at: int | None = None,
        first_disk: int = 0,
    ) -> None:
        self.what = what
        self.first_disk = first_disk
        self.marker = marker
        self.datasets: dict[str, h5py.Dataset] = dict(datasets)
        self.blank: list[h5py.Dataset] = []  # as long as the others, but nothing is ever written into them
        self.committed: int = committed
        self.at: int = committed if at is None else at
        self.last_time: float = float(datasets["time"][self.at - 1]) if 0 < self.at <= committed else -np.inf

    def add(self, rows: Mapping[str, NDArray[Any]]) -> int:
        """Compare the rows that the file has, append the others without committing them; returns the number of these.

        `rows` are values by the name of each dataset, shape (count, ...), in the dataset's type.

        Raises TrajectoryError if a row differs from what is committed.
        """
        count = len(rows["time"])
        known = min(count, self.committed - self.at)
        for name, values in rows.items():
            if known:
                self._compare(name, values[:known])
        for name, values in rows.items():
            if known < count:
                self._append(self.datasets[name], values[known:])
        for blank in self.blank if known < count else ():
            blank.resize(self.committed + count - known, axis=0)
        return count - known

    def commit(
        self, output: OutputFile, rows: Mapping[str, NDArray[Any]], marks: NDArray[Any] | None = None
    ) -> None:
        """Add rows, and commit the new ones in two phases: they reach the disk before their marks (their numbers)."""
        if new := self.add(rows):
            output.flush()
            assert self.marker is not None
            numbers = np.arange(self.committed, self.committed + new)
            self._append(self.marker, numbers if marks is None else marks)
            output.flush()
        self.confirm(len(rows["time"]))
        self.last_time = float(rows["time"][-1])

    def confirm(self, count: int) -> None:
        """Record that the last `count` rows are committed."""
        self.at += count
        self.committed = max(self.committed, self.at)

    def drop_uncommitted(self) -> None:
        """Remove rows after the last commit, left by an interrupted one."""
        for dataset in ([] if self.marker is None else [self.marker], self.datasets.values(), self.blank):
            for each in dataset:
                if len(each) > self.committed:
                    each.resize(self.committed, axis=0)

    def _append(self, dataset: h5py.Dataset, values: NDArray[Any]) -> None:
        # As `dataset.resize(...)` and `dataset[committed:] = values` do, without looking at how it is indexed: a
        # commit appends to some twenty datasets, most of which get a number.
        end = (self.committed + len(values), *values.shape[1:])
        dataset.id.set_extent(end)
        space = dataset.id.get_space()
        # Chunks of few disks in one piece; a copy of all disks of a large frame would be as large as that.
        wide = values.shape[1] if values.ndim > 1 else 0
        step = dataset.chunks[1] if wide > MOST_AT_ONCE else wide
        for first in range(0, wide, step) if wide else (0,):
            part = values[:, first : first + step] if wide else values
            space.select_hyperslab(
                (self.committed, first, 0)[: values.ndim] + (0,) * (values.ndim - 3), part.shape
            )
            dataset.id.write(h5py.h5s.create_simple(part.shape), space, np.ascontiguousarray(part))

    def _compare(self, name: str, values: NDArray[Any]) -> None:
        stored = self.datasets[name][self.at : self.at + len(values)]
        values = np.ascontiguousarray(values, dtype=stored.dtype)
        different = values.reshape(-1).view(np.uint8) != stored.reshape(-1).view(np.uint8)
        if not different.any():
            return
        where = np.unravel_index(int(np.argmax(different)) // stored.dtype.itemsize, stored.shape)
        row, *position = (int(index) for index in where)
        element = f"{name}[{', '.join(map(str, position))}]" if position else name
        if self.what == "frame" and name in FIELDS:
            component = f", component {'xy'[position[1]]}," if len(position) > 1 else ""
            element = f"{name} of disk {self.first_disk + position[0]}{component}"
        raise TrajectoryError(
            f"{self.what} {self.at + row}, computed again, differs from the file: {element} is {values[where]}, the "
            f"file holds {stored[where]}. This is not the same run: the file is not changed"
        )


class SeriesWriter:
    """The group `timeseries` of a file that is being written; it appears with the first row.

    `at` is the number of rows that the run has written; there may be more in the file, which are compared then.
    """

    def __init__(self, output: OutputFile, at: int = 0) -> None:
        self._output = output
        self.rows: CommitLog | None = None
        self._like: dict[str, NDArray[Any]] = {}
        self._columns: dict[str, tuple[str, ...]] = {}
        if layout.committed_rows(output.file) == 0:
            return
        group = output.file[TIMESERIES]
        self._open([name for name in group if name not in ("step", "time")], len(group["step"]), at)
        self._columns = {
            name: tuple(str(one) for one in each.attrs["columns"])
            for name, each in group.items()
            if "columns" in each.attrs
        }

    def _open(self, names: Sequence[str], committed: int = 0, at: int | None = None) -> CommitLog:
        group = self._output.file[TIMESERIES]
        datasets = {"time": group["time"], **{name: group[f"{name}/value"] for name in names}}
        self.rows = CommitLog("row of the series", group["step"], datasets, committed, at)
        self._like = samples({name: datasets[name] for name in names})
        return self.rows

    def write(
        self,
        given: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Append rows and commit them together; see `TrajectoryWriter.write_series_rows`."""
        first = None if self.rows is None else self._like
        named = {name: tuple(names) for name, names in (columns or {}).items()}
        found: list[dict[str, NDArray[Any]]] = []
        before = self.rows.last_time if self.rows else -np.inf
        for time, values in given:
            row = _row(values, first)
            first = first or row
            if not (is_number(time) and np.isfinite(time) and time >= before):
                raise InputError(f"time = {time}: must be a finite time not before {before}")
            before = float(time)
            found.append({"time": np.array(before), **row})
        if not found:
            return
        for name, names in named.items():
            shape = found[0][name].shape if name in found[0] else "no value"
            if shape != (len(names),):
                raise InputError(f"columns of series {name} = {list(names)}: the series has {shape}")
        if (rows := self.rows) is None:
            self._columns = named
            file = self._output.file
            if TIMESERIES in file:  # an interrupt ended the first attempt
                del file[TIMESERIES]
            assert first is not None
            layout.create_timeseries(file, first, named)
            rows = self._open(list(first))
        elif columns is not None and named != self._columns:
            raise InputError(f"columns = {named}: the first row has {self._columns}")
        rows.commit(self._output, {name: np.stack([row[name] for row in found]) for name in found[0]})

    def drop_uncommitted(self) -> None:
        """Remove rows after the last commit, left by an interrupted write."""
        file = self._output.file
        drop_staged(file, TIMESERIES)
        if self.rows is not None and self.rows.committed:
            self.rows.drop_uncommitted()
        elif TIMESERIES in file:
            del file[TIMESERIES]
            self.rows = None


class HistoryWriter:
    """The group `histories` of a file that is being written, of a gas of n disks.

    `at` is the number of events that the run has written; there may be more in the file, which are compared then.
    """

    def __init__(self, output: OutputFile, n: int, at: int = 0) -> None:
        self._output = output
        self._n = n
        self.events: CommitLog | None = None
        if HISTORIES in output.file:
            self._open(at)

    def _open(self, at: int = 0) -> None:
        group = self._output.file[HISTORIES]
        marks, times = group["committed/events"], group["committed/time"]
        self._tracked: NDArray[np.int32] = group["tracked"][()]
        self._commits = CommitLog("commit of histories", marks, {"time": times}, len(marks))
        columns = {name: group[f"events/{name}"] for name in EVENT}
        # The events have no marker of their own: the commits count them.
        self.events = CommitLog("event of the histories", None, columns, int(marks[len(marks) - 1]), at)

    def begin(self, ids: ArrayLike, state: State) -> None:
        """Begin to track disks; see `TrajectoryWriter.begin_histories`."""
        tracked = np.sort(stored("tracked", ids, np.atleast_1d(np.asarray(ids)).shape[:1], np.int32))
        if not len(tracked) or not 0 <= tracked[0] <= tracked[-1] < self._n:
            raise InputError(f"tracked = {shortened(ids)}: must be ids of disks from 0 to {self._n - 1}")
        if len(twice := tracked[1:][tracked[1:] == tracked[:-1]]):
            raise InputError(f"tracked: disk {twice[0]} is given twice")
        start: dict[str, Any] = {"time": np.float64(state.time)}
        for name, column in START.items():
            rows = getattr(state, name)
            rows = rows if len(rows) == len(tracked) else rows[tracked]
            start[name] = stored(name, rows, (len(tracked), *column.tail), column.dtype())
        if self.events is None:
            layout.create_histories(self._output.file, tracked, start)
            self._output.flush()
            self._open()
            return
        group = self._output.file[HISTORIES]
        if not np.array_equal(group["tracked"][()], tracked):
            raise TrajectoryError(f"it has histories of other disks than these {len(tracked)}")
        for name, values in start.items():
            if group[f"start/{name}"][()].tobytes() != values.tobytes():
                raise TrajectoryError(f"it has histories that began with another {name}")

    def write(self, parts: Sequence[tuple[Mapping[str, ArrayLike], float]]) -> None:
        """Append events and commit them together; see `TrajectoryWriter.write_history_parts`."""
        if self.events is None:
            raise InputError("histories: begin_histories comes before write_histories")
        rows, end, complete_to = self.events, self.events.at, self._commits.last_time
        found, ends, commits = [], [], []
        for events, given in parts:
            columns, time = self._checked(events, given), float(given)
            times = columns["time"]
            known = min(len(times), max(0, rows.committed - end))
            if known < len(times) and times[known] < complete_to:
                raise TrajectoryError(
                    f"the event of disk {columns['id'][known]} at t = {times[known]} is not in the file, whose "
                    f"histories are complete up to t = {complete_to}"
                )
            end += len(times)
            if end > rows.committed or time > complete_to:
                commits.append((time, end))
                complete_to = time
            found.append(columns)
            ends.append((time, end))
        if not found:
            return
        rows.add({name: np.concatenate([each[name] for each in found]) for name in EVENT})
        for time, end in ends:
            if end < rows.committed and float(rows.datasets["time"][end]) < time:
                raise TrajectoryError(
                    f"event {end} of its histories, at t = {rows.datasets['time'][end]}, is missing among those up to "
                    f"t = {time}"
                )
        if commits:
            at, marks = (np.array(each) for each in zip(*commits, strict=True))
            self._commits.commit(self._output, {"time": at}, marks)
        rows.confirm(end - rows.at)

    def drop_uncommitted(self) -> None:
        """Remove rows after the last commit, left by an interrupted write."""
        drop_staged(self._output.file, HISTORIES)
        if self.events is not None:
            self.events.drop_uncommitted()
            self._commits.drop_uncommitted()

    def _checked(self, events: Mapping[str, ArrayLike], time: float) -> dict[str, NDArray[Any]]:
        if missing := [name for name in EVENT if name not in events]:
            raise InputError(f"histories: the events lack {', '.join(missing)}")
        for name in events:
            if name not in EVENT:
                raise InputError(f"histories: there is no column {shortened(name)}{there_are(name, EVENT)}")
        length = len(np.atleast_1d(np.asarray(events["time"])))
        columns = {
            name: stored(f"histories: {name}", events[name], (length, *column.tail), column.dtype())
            for name, column in EVENT.items()
        }
        times, ids = columns["time"], columns["id"]
        falling = (times[1:] < times[:-1]) | ((times[1:] == times[:-1]) & (ids[1:] < ids[:-1]))
        if falling.any():
            row = int(np.argmax(falling)) + 1
            raise InputError(f"histories: event {row} at t = {times[row]} is not in the order of time and id")
        if not (is_number(time) and np.isfinite(time)) or (length and times[-1] > time):
            raise InputError(f"histories: time = {time}: must be a finite time not before the last event")
        foreign = ~np.isin(ids, self._tracked)
        if foreign.any():
            raise InputError(f"histories: disk {ids[foreign][0]} is not tracked")
        return columns


def _row(values: Mapping[str, ArrayLike], first: Mapping[str, Any] | None) -> dict[str, NDArray[Any]]:
    """Quantities of a row of the series, as `first` has them."""
    if not isinstance(values, Mapping):
        raise InputError(f"series: must be numbers by name, not {shortened(values)}")
    for name in ("step", "time"):
        if name in values:
            raise InputError(f"name of series = {shortened(name)}: the file has it already for all of them")
    row = checked("series", "row", values, first)
    if not row:
        raise InputError("series: a row must have one quantity or more")
    return row


def samples(datasets: Mapping[str, h5py.Dataset]) -> dict[str, NDArray[Any]]:
    """An array of the shape and type of a row of each dataset: HDF5 takes 0.05 ms to return them."""
    return {
        name: np.broadcast_to(np.zeros((), each.dtype), each.shape[1:]) for name, each in datasets.items()
    }


def checked(
    what: str, row: str, given: Mapping[str, ArrayLike], first: Mapping[str, NDArray[Any]] | None
) -> dict[str, NDArray[Any]]:
    """Numbers as they are stored, float64 or int64, by name.

    `what` they are ("observable") and what `row` they stand in ("frame") is for messages; `first` is the first row,
    None if there is none yet.

    Raises InputError if one is not a number or numbers, or they do not fit the first row.
    """
    found = {}
    for name, value in given.items():
        numbers = np.asarray(value)
        if numbers.dtype.kind not in "iuf" or numbers.size == 0:
            raise InputError(f"{what} {name} = {shortened(value)}: must be a number or numbers")
        found[name] = numbers.astype(np.float64 if numbers.dtype.kind == "f" else np.int64)
    if first is None:
        for name in found:
            check_name(what, name, separator=False)
        return found
    if found.keys() != first.keys():
        several = what if what.endswith("s") else f"{what}s"
        raise InputError(f"{several} {sorted(found)}: the first {row} has {sorted(first)}")
    for name, numbers in found.items():
        before = first[name]
        if numbers.shape != before.shape:
            raise InputError(f"{what} {name} has shape {numbers.shape}: must be {before.shape}")
        if numbers.dtype.kind == "f" and before.dtype.kind != "f":
            raise InputError(f"{what} {name} = {numbers}: it was an integer in the first {row}")
        found[name] = numbers.astype(before.dtype)
    return found


def stored(
    what: str, value: ArrayLike, shape: tuple[int, ...], dtype: DTypeLike, *, vanish: bool = False
) -> NDArray[Any]:
    """Values in the type that the file has for them, the same array if it has; InputError if they do not fit.

    `vanish` as for `converted`.
    """
    given, target = np.asarray(value), np.dtype(dtype)
    if given.shape != shape:
        raise InputError(f"{what} has shape {given.shape}: must be {shape}")
    if given.dtype.kind not in ("iu" if target.kind == "i" else "iuf") and given.size:
        raise InputError(f"{what} has type {given.dtype}: must be {target}")
    if target.kind == "i" and given.size and given.dtype != target:
        limits = np.iinfo(target)
        if not limits.min <= given.min() <= given.max() <= limits.max:
            raise InputError(f"{what}: numbers beyond {limits.max} cannot be stored")
    found = given if given.dtype == target else converted(what, given, target, IN_FILE, vanish=vanish)
    if target.kind == "f" and not np.isfinite(found).all():
        position = tuple(int(axis) for axis in np.argwhere(~np.isfinite(found))[0])
        where = ", ".join(map(str, position))
        # Rows that an engine gives in single precision have been rounded there.
        more = f"; if it is larger in double precision, {IN_FILE}" if given.dtype == np.float32 else ""
        raise InputError(f"{what}[{where}] = {given[position]}: must be a finite number{more}")
    return found


IN_FILE = (
    'store it in precision "f64" (output.precision of a case), or choose units in which it is nearer to 1'
)
"""Remedy for numbers that the precision of a trajectory cannot hold."""


def converted(
    what: str, given: NDArray[Any], dtype: DTypeLike, remedy: str, *, vanish: bool = False
) -> NDArray[Any]:
    """Numbers in another type, C-contiguous.

    Raises InputError with the `remedy` where a finite number would become infinite, or all would become 0 unless they
    may `vanish`, as velocities do under drag.
    """
    with np.errstate(over="ignore", under="ignore"):
        found = np.asarray(given, dtype=dtype, order="C")
    if found.dtype.kind != "f" or given.dtype.kind != "f" or found.itemsize >= given.itemsize:
        return found
    lost = np.isinf(found) & np.isfinite(given)
    if not lost.any():
        if vanish or found.any() or not given.any():
            return found
        lost = given == np.abs(given).max()
    position = tuple(int(axis) for axis in np.argwhere(lost)[0])
    where, limits = f"[{', '.join(map(str, position))}]" if position else "", np.finfo(found.dtype)
    raise InputError(
        f"{what}{where} = {given[position]:.6g}: {'single' if found.itemsize == 4 else 'this'} precision holds numbers "
        f"from {limits.tiny:.3g} to {limits.max:.3g} in size; {remedy}"
    )


def check_name(what: str, name: object, *, separator: bool = True) -> None:
    """Raise InputError unless a name can be one in HDF5; with `separator`, "/" makes groups."""
    parts = str(name).split("/") if separator else [str(name)]
    if not isinstance(name, str) or any(part in ("", ".", "..") or "/" in part for part in parts):
        raise InputError(f"name of {what} = {shortened(name)}: must be a string valid as a name in HDF5")
