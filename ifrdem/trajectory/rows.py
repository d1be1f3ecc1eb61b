"""Rows of frames, time series and histories that a trajectory file grows by, and that count once they are committed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, nearest
from ..model.state import State
from . import layout
from .file import OutputFile, TrajectoryError, drop_staged
from .layout import EVENT_COLUMNS, HISTORIES, START_COLUMNS, as_column


class Rows:
    """Datasets with the same number of rows (first axis), and a marker that grows last: the commit.

    Rows beyond the marker do not count. A resumed run gives rows again that are committed: they are compared
    with the file bit for bit.

    Parameters
    ----------
    what : str
        What one row is, e.g. "frame".
    marker : h5py.Dataset or None
        One number a row; None where something else counts the rows.
    datasets : mapping
        Name -> dataset.
    committed : int
        Rows that count.
    at : int, optional
        Number of the row that comes next; by default the one after the committed ones.

    Attributes
    ----------
    committed, at : int
        As above, at present.
    datasets : dict
        Name -> dataset; may be added to before the first row.
    """

    def __init__(
        self,
        what: str,
        marker: h5py.Dataset | None,
        datasets: Mapping[str, h5py.Dataset],
        committed: int = 0,
        at: int | None = None,
    ) -> None:
        self.what = what
        self.marker = marker
        self.datasets: dict[str, h5py.Dataset] = dict(datasets)
        self.committed: int = committed
        self.at: int = committed if at is None else at

    def known(self, count: int) -> int:
        """How many of the next `count` rows the file has."""
        return min(count, self.committed - self.at)

    def add(self, rows: Mapping[str, NDArray[Any]]) -> None:
        """Compare the rows that the file has, and append the others without committing them.

        Parameters
        ----------
        rows : mapping
            Name of each dataset -> values, shape (count, ...), in the dataset's type.

        Raises
        ------
        TrajectoryError
            If a row differs from what is committed.
        """
        known = self.known(len(next(iter(rows.values()))))
        if known:
            for name, values in rows.items():
                self._compare(name, values[:known])
        new = {name: values[known:] for name, values in rows.items()}
        if len(next(iter(new.values()))):
            self._put(new)

    def mark(self, marks: NDArray[np.int64]) -> None:
        """Append to the marker: what was added is committed once this is flushed."""
        assert self.marker is not None
        self._append(self.marker, marks)

    def confirm(self, count: int) -> None:
        """Take note that the last `count` rows are committed."""
        self.committed += count - self.known(count)
        self.at += count

    def drop_uncommitted(self) -> None:
        """Remove what an interrupted commit left behind the last one."""
        for dataset in self._all():
            if len(dataset) > self.committed:
                dataset.resize(self.committed, axis=0)

    def _all(self) -> list[h5py.Dataset]:
        return [*([] if self.marker is None else [self.marker]), *self.datasets.values()]

    def _put(self, new: Mapping[str, NDArray[Any]]) -> None:
        for name, values in new.items():
            self._append(self.datasets[name], values)

    def _append(self, dataset: h5py.Dataset, values: NDArray[Any]) -> None:
        dataset.resize(self.committed + len(values), axis=0)
        dataset[self.committed :] = values

    def _compare(self, name: str, values: NDArray[Any]) -> None:
        dataset = self.datasets[name]
        stored = dataset[self.at : self.at + len(values)]
        values = np.ascontiguousarray(values, dtype=stored.dtype)
        different = values.reshape(-1).view(np.uint8) != stored.reshape(-1).view(np.uint8)
        if not different.any():
            return
        where = np.unravel_index(int(np.argmax(different)) // stored.dtype.itemsize, stored.shape)
        row, *place = (int(index) for index in where)
        raise TrajectoryError(
            f"{self.what} {self.at + row}, computed again, differs from the file: "
            f"{self._place(name, place)} is {values[where]}, the file holds {stored[where]}. "
            "This is not the same run: the file is kept as it is"
        )

    def _place(self, name: str, place: list[int]) -> str:
        """Names an element of a row."""
        if self.what == "frame" and name in layout.FIELDS:
            component = f", component {'xy'[place[1]]}," if len(place) > 1 else ""
            return f"{name} of disk {place[0]}{component}"
        return f"{name}[{', '.join(map(str, place))}]" if place else name


class SeriesWriter:
    """The group `timeseries` of a file that is being written; it appears with the first row.

    Parameters
    ----------
    output : OutputFile
        The file.
    at : int
        Rows that the run has written; there may be more in the file, which are compared then.

    Raises
    ------
    InputError
        If the file holds fewer rows.
    """

    def __init__(self, output: OutputFile, at: int = 0) -> None:
        self._output = output
        self._rows: Rows | None = None
        self._columns: dict[str, tuple[str, ...]] = {}
        self._last_time = -np.inf
        file = output.file
        rows = len(file[f"{layout.TIMESERIES}/step"]) if layout.TIMESERIES in file else 0
        if at > rows:
            raise InputError(
                f"{output.path} holds {rows} rows of series, the checkpoint had seen {at}: it is another file's"
            )
        if rows == 0:
            return
        group = file[layout.TIMESERIES]
        names = [name for name in group if name not in ("step", "time")]
        datasets = {name: group[f"{name}/value"] for name in names}
        self._rows = Rows("row of the series", group["step"], {"time": group["time"], **datasets}, rows, at)
        self._columns = {
            name: tuple(str(one) for one in group[name].attrs["columns"])
            for name in names
            if "columns" in group[name].attrs
        }
        self._last_time = float(group["time"][at - 1]) if at else -np.inf

    def __len__(self) -> int:
        """Number of committed rows."""
        return 0 if self._rows is None else self._rows.committed

    @property
    def at(self) -> int:
        """Rows that the run has written: less than the committed ones while it repeats them."""
        return 0 if self._rows is None else self._rows.at

    def write(
        self,
        given: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Append rows and commit them together; see `TrajectoryWriter.write_series_rows`."""
        checked_rows: list[dict[str, NDArray[Any]]] = []
        before = self._last_time
        for time, values in given:
            checked_rows.append(self._checked(time, values, columns, before, checked_rows))
            before = float(time)
        if not checked_rows:
            return
        if self._rows is None:
            self._rows = self._create(checked_rows[0])
        rows, count = self._rows, len(checked_rows)
        new = count - rows.known(count)
        stacked = {name: np.stack([row[name] for row in checked_rows]) for name in checked_rows[0]}
        rows.add({"time": np.array([float(time) for time, _ in given]), **stacked})
        if new:
            self._output.flush()
            rows.mark(np.arange(rows.committed, rows.committed + new))
            self._output.flush()
        rows.confirm(count)
        self._last_time = before

    def drop_uncommitted(self) -> None:
        """Remove what an interrupted write left behind the last commit."""
        file = self._output.file
        drop_staged(file, layout.TIMESERIES)
        if self._rows is not None and self._rows.committed:
            self._rows.drop_uncommitted()
        elif layout.TIMESERIES in file:
            del file[layout.TIMESERIES]
            self._rows = None

    def _create(self, row: Mapping[str, NDArray[Any]]) -> Rows:
        file = self._output.file
        if layout.TIMESERIES in file:  # an interrupt ended the first attempt
            del file[layout.TIMESERIES]
        layout.create_timeseries(file, row, self._columns)
        group = file[layout.TIMESERIES]
        datasets = {name: group[f"{name}/value"] for name in row}
        return Rows("row of the series", group["step"], {"time": group["time"], **datasets})

    def _checked(
        self,
        time: float,
        values: Mapping[str, ArrayLike],
        columns: Mapping[str, Sequence[str]] | None,
        before: float,
        rows: Sequence[Mapping[str, NDArray[Any]]],
    ) -> dict[str, NDArray[Any]]:
        """A row that comes after time `before`, and after `rows` that are not in the file yet."""
        first: dict[str, Any] | None = (
            {name: value[None] for name, value in rows[0].items()} if rows else None
        )
        if self._rows is not None:
            first = {name: dataset for name, dataset in self._rows.datasets.items() if name != "time"}
        if not isinstance(values, Mapping):
            raise InputError(f"series: numbers by name are needed, not {values!r}")
        for name in ("step", "time"):
            if name in values:
                raise InputError(f"name of series = {name!r}: the file has it already for all of them")
        row = checked("series", "row", values, first)
        if not row:
            raise InputError("series: a row without any quantity cannot be written")
        if not (is_number(time) and np.isfinite(time) and time >= before):
            raise InputError(f"time = {time}: a finite time not before {before} is needed")
        named = {name: tuple(names) for name, names in (columns or {}).items()}
        for name, names in named.items():
            if name not in row or row[name].shape != (len(names),):
                shape = row[name].shape if name in row else "no value"
                raise InputError(f"columns of series {name} = {list(names)}: the series has {shape}")
        if first is None:
            self._columns = named
        elif columns is not None and named != self._columns:
            raise InputError(f"columns = {named}: the first row has {self._columns}")
        return row


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
        columns = {name: group[f"events/{name}"] for name in EVENT_COLUMNS}
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
        tracked = as_column("tracked", ids, EVENT_COLUMNS["id"])
        if not len(tracked) or not 0 <= tracked.min() <= tracked.max() < self._n:
            raise InputError(f"tracked = {ids!r}: numbers of disks from 0 to {self._n - 1} are needed")
        tracked = np.sort(tracked)
        if (tracked[1:] == tracked[:-1]).any():
            twice = tracked[1:][tracked[1:] == tracked[:-1]][0]
            raise InputError(f"tracked: disk {twice} is there twice")
        start = {
            name: as_column(name, getattr(state, name)[tracked], column)
            for name, column in START_COLUMNS.items()
        }
        if self._events is not None:
            self._compare_start(tracked, float(state.time), start)
            return
        layout.create_histories(self._output.file, tracked, float(state.time), start)
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
        drop_staged(self._output.file, HISTORIES)
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
        missing = [name for name in EVENT_COLUMNS if name not in events]
        if missing:
            raise InputError(f"histories: the events lack {', '.join(missing)}")
        unknown = [name for name in events if name not in EVENT_COLUMNS]
        if unknown:
            raise InputError(
                f"histories: there is no column {unknown[0]!r}{nearest(unknown[0], EVENT_COLUMNS)}"
            )
        length = len(np.atleast_1d(np.asarray(events["time"])))
        columns = {
            name: as_column(f"histories: {name}", events[name], column, length)
            for name, column in EVENT_COLUMNS.items()
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


def checked(
    what: str,
    row: str,
    given: Mapping[str, ArrayLike],
    first: Mapping[str, h5py.Dataset] | Mapping[str, NDArray[Any]] | None,
) -> dict[str, NDArray[Any]]:
    """Numbers as they are stored: float64 or int64.

    Parameters
    ----------
    what, row : str
        What they are ("observable") and what they stand in ("frame"), for messages.
    given : mapping
        Name -> number or array.
    first : mapping or None
        The datasets or arrays that the first row made, shape (rows, ...); None if there is no row yet.

    Raises
    ------
    InputError
        If one is not a number or numbers, or they do not fit the first row.
    """
    found = {}
    for name, value in given.items():
        numbers = np.asarray(value)
        if numbers.dtype.kind not in "iuf" or numbers.size == 0:
            raise InputError(f"{what} {name} = {value!r}: a number or numbers are needed")
        found[name] = numbers.astype(np.float64 if numbers.dtype.kind == "f" else np.int64)
    if first is None:
        for name in found:
            check_name(what, name, separator=False)
        return found
    if found.keys() != first.keys():
        several = what if what.endswith("s") else f"{what}s"
        raise InputError(f"{several} {sorted(found)}: the first {row} has {sorted(first)}")
    for name, numbers in found.items():
        dataset = first[name]
        if numbers.shape != dataset.shape[1:]:
            raise InputError(f"{what} {name} has shape {numbers.shape}: {dataset.shape[1:]} is needed")
        if numbers.dtype.kind == "f" and dataset.dtype.kind != "f":
            raise InputError(f"{what} {name} = {numbers}: it was an integer in the first {row}")
        found[name] = numbers.astype(dataset.dtype)
    return found


def is_number(value: object) -> bool:
    """Whether a value is a real number, of Python's or NumPy's; truth values are none."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def check_name(what: str, name: object, *, separator: bool = True) -> None:
    """Raise InputError unless a name can be one in HDF5; with `separator`, "/" makes groups."""
    parts = str(name).split("/") if separator else [str(name)]
    if not isinstance(name, str) or any(part in ("", ".", "..") or "/" in part for part in parts):
        raise InputError(f"name of {what} = {name!r}: a text is needed that HDF5 takes as a name")
