"""Writes a run's frames, time series and histories so that every death of the run leaves a good file.

The layout is described in `ifrdem.h5md`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, nearest
from ..model.box import Box, below
from ..model.state import Disks, State, StoredState
from ..model.walls import Wall, to_json
from ..tools.sealed import Sealed
from . import damage, layout
from .file import OutputFile, TrajectoryError
from .rows import HistoryWriter, Rows, SeriesWriter, check_name, checked, like

__all__ = ["DEFAULT_FIELDS", "TrajectoryError", "TrajectoryWriter"]

DEFAULT_FIELDS = ("position", "velocity", "angular_velocity", "collisions")


class TrajectoryWriter(Sealed):
    """Writes a run's frames into a new H5MD file, and beside them time series and histories.

    Each frame is committed in two phases: everything but its step is written and flushed, then the step. A
    process killed at any moment leaves a file in which each frame that has a step is whole; likewise the rows
    of series and the events of histories. Every write to the disk leaves such a file (`OrderedFile`), so that a
    full disk does, too. Committed frames survive the death of the process; after a power failure they are as
    safe as the file system makes them.

    Use it as a context manager. A writer that is closed before its first frame leaves no file, and with
    `force` the old file stays in place until the first frame of the new one is committed. `resume` goes on
    with a file that a run has left.

    Parameters
    ----------
    path : str or path
        The file to write. Its folder must exist.
    disks : Disks
        The constant properties of the n disks [mass, length].
    box : Box
        The box [length]; its boundary is "none" where it is not periodic.
    fields : sequence of str
        What is stored per disk and frame: "position" [length], "velocity" [length/time], "angle"
        [rad], "angular_velocity" [rad/time], "collisions", "image", "last_partner".
    parameters : mapping
        What belongs into the file's record, by name: case text, seed, device, ... A name may be grouped by
        "/". The versions of Python and of the packages are added as versions/<package> where not given.
    units : mapping
        Unit of each quantity, e.g. {"length": "m", "mass": "kg", "time": "s", "momentum": "kg m s-1"};
        "reduced" for each of them, or for none.
    precision : str
        "f4" (default) or "f8": floats of the per-disk fields. f4 resolves 6e-8 of the box, enough for
        analysis and not for a restart. Times, observables, series and histories are always f8, counts are
        integers.
    compression : str
        "none" (default), "gzip" (shuffle and deflate, level 1) or "zstd" (shuffle and Zstandard) of the per-disk
        fields. gzip is read by every HDF5 program; zstd is faster, and needs the package `hdf5plugin` (extra
        `zstd`) here and in every program that reads the file: others say that a filter is missing.
    force : bool
        Replace a file that exists.
    walls : sequence of Wall
        Walls beside those at the sides of the box: the parameter "walls", as JSON.

    Raises
    ------
    InputError
        If a choice or name is unknown, `hdf5plugin` is missing for zstd, the path exists and `force` is not given,
        it is not a regular file, or the file cannot be created there. Nothing is left behind then.

    Examples
    --------
    >>> import ifrdem
    >>> import numpy as np
    >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    >>> box = ifrdem.Box((10.0, 10.0))
    >>> state = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], np.zeros(2))
    >>> with ifrdem.TrajectoryWriter("two.h5", disks, box) as file:
    ...     file.write(state, {"temperature": 0.25})
    ...
    >>> len(ifrdem.Trajectory("two.h5"))
    1
    """

    path: Path

    def __init__(
        self,
        path: str | os.PathLike[str],
        disks: Disks,
        box: Box,
        *,
        fields: Sequence[str] = DEFAULT_FIELDS,
        parameters: Mapping[str, str | int | float] | None = None,
        units: Mapping[str, str] | None = None,
        precision: str = "f4",
        compression: str = "none",
        force: bool = False,
        walls: Sequence[Wall] = (),
    ) -> None:
        parameters = {} if parameters is None else parameters
        if walls:
            parameters = {**parameters, "walls": to_json(walls)}
        units = {} if units is None else units
        fields = [fields] if isinstance(fields, str) else list(fields)
        _check_choices("field", fields, list(layout.FIELDS))
        if len(set(fields)) != len(fields):
            raise InputError(f"fields = {fields}: each may be given once")
        _check_choices("precision", [precision], list(layout.PRECISIONS))
        _check_choices("compression", [compression], list(layout.COMPRESSIONS))
        if compression == "zstd":
            layout.need_zstd('compression "zstd"')
        _check_record(parameters, units)

        def fill(file: h5py.File) -> None:
            layout.create(
                file,
                disks=disks,
                box=box,
                fields=fields,
                precision=precision,
                compression=compression,
                parameters=parameters,
                units=units,
            )

        self._begin(OutputFile.create(path, fill, force=force), disks, box)

    @classmethod
    def resume(
        cls,
        path: str | os.PathLike[str],
        disks: Disks,
        box: Box,
        *,
        fields: Sequence[str] = DEFAULT_FIELDS,
        precision: str = "f4",
        compression: str = "none",
        walls: Sequence[Wall] = (),
        frames: int,
        series_rows: int = 0,
        events: int = 0,
    ) -> TrajectoryWriter:
        """Go on with the file of a run that goes on from a checkpoint.

        What a kill left uncommitted is dropped. What was committed after the checkpoint stays: the run
        computes it again, and gives it again; it is compared with the file bit for bit.

        Parameters
        ----------
        path : str or path
            The file. No other process may write it meanwhile.
        disks, box, fields, precision, compression, walls
            As the file was begun with.
        frames, series_rows, events : int
            How many frames, rows of series and events of histories the run had written at the checkpoint.

        Raises
        ------
        InputError
            If there is no such file, it is open elsewhere, it was begun otherwise, or it holds less than the
            checkpoint had seen. The file is as it was then.
        """
        for name, value in (("frames", frames), ("series_rows", series_rows), ("events", events)):
            if not isinstance(value, int | np.integer) or value < 0:
                raise InputError(f"{name} = {value!r}: a whole number, 0 or more, is needed")
        output = OutputFile.reopen(path)
        try:
            layout.check_layout(output.file, os.fspath(path))
            _check_resumable(
                output.file,
                os.fspath(path),
                disks=disks,
                box=box,
                fields=[fields] if isinstance(fields, str) else fields,
                precision=precision,
                compression=compression,
                walls=to_json(walls) if walls else None,
            )
            writer = cls.__new__(cls)
            writer._begin(output, disks, box, frames, series_rows, events)
            writer._drop_uncommitted()
            output.flush()
        except BaseException as error:
            output.close(lambda: None, keep=True)
            if isinstance(error, OSError | RuntimeError):
                raise InputError(f"{os.fspath(path)} cannot be gone on with: {error}") from error
            raise
        return writer

    def _begin(
        self,
        output: OutputFile,
        disks: Disks,
        box: Box,
        frames: int = 0,
        series_rows: int = 0,
        events: int = 0,
    ) -> None:
        """Take the file's datasets in hand; so much of each the run has written."""
        self._output = output
        self._set(path=output.path)
        self._n = disks.n
        self._lengths = box.lengths
        file = output.file
        step, time, edges = (file[f"{layout.EDGES}/{name}"] for name in ("step", "time", "value"))
        committed = len(step)
        if frames > committed:
            raise InputError(
                f"{self.path} holds {committed} frames, the checkpoint had seen {frames}: it is another file's"
            )
        fields = {name: layout.field_dataset(file, name) for name in layout.stored_fields(file)}
        self._fields = like(fields)
        self._rows = Rows("frame", step, {"time": time, "edges": edges, **fields}, committed, frames)
        self._empty_views = layout.plain_views(file)
        self._observables: dict[str, NDArray[Any]] = {}
        if committed:
            observables = {name: group["value"] for name, group in file["observables"].items()}
            self._rows.datasets.update(_prefixed(observables))
            self._observables = like(observables)
        self._last_time = float(time[frames - 1]) if frames else -np.inf
        self._series = SeriesWriter(output, series_rows)
        self._histories = HistoryWriter(output, disks.n, events)

    def __len__(self) -> int:
        """Number of committed frames."""
        return self._rows.committed

    @property
    def gone(self) -> str | None:
        """Reason why the file is not at its place any more; None if it is."""
        return self._output.gone

    @property
    def series_rows(self) -> int:
        """Number of committed rows of the series."""
        return len(self._series)

    @property
    def events(self) -> int:
        """Number of committed events of the histories."""
        return len(self._histories)

    @property
    def seen(self) -> dict[str, int]:
        """What a checkpoint has to keep for `resume`: frames, series_rows and events that the run has written."""
        return {"frames": self._rows.at, "series_rows": self._series.at, "events": self._histories.at}

    def __enter__(self) -> TrajectoryWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write(self, state: State, observables: Mapping[str, ArrayLike] | None = None) -> None:
        """Append a frame and commit it.

        Parameters
        ----------
        state : State
            Positions [length], velocities [length/time], spins [rad/time] and counts of the n disks, at a
            time not before that of the last frame.
        observables : mapping
            Quantities of the whole gas by name: numbers or arrays, floats or integers. Names and shapes are
            those of the first frame.

        Raises
        ------
        InputError
            If the state or the observables do not fit the file; it is unchanged then.
        TrajectoryError
            If the frame cannot be written, e.g. to a full disk, or a resumed run gives another frame than the
            file holds. The file keeps the frames before it.
        """
        self.write_frames([(state, observables)])

    def write_frames(self, frames: Sequence[tuple[State, Mapping[str, ArrayLike] | None]]) -> None:
        """Append frames, the arguments of `write` for each, and commit them together: faster than each.

        Raises
        ------
        InputError, TrajectoryError
            As `write`; then none of them is written.
        """
        with self._output.committing("a frame", self._kept):
            rows, count = self._rows, len(frames)
            first = None if rows.committed == 0 else self._observables
            before, found = self._last_time, []
            for state, observables in frames:
                values = checked("observable", "frame", {} if observables is None else observables, first)
                first = {name: value[None] for name, value in values.items()} if first is None else first
                found.append({
                    "time": np.float64(state.time),
                    "edges": np.array((*self._lengths, 1.0)),
                    **self._checked_fields(state, before),
                    **_prefixed(values),
                })  # fmt: skip
                before = state.time
            if not found:
                return
            if rows.committed == 0 and first is not None:
                made = self._output.file[
                    "observables"
                ]  # some are there if an interrupt ended the first attempt
                rows.datasets.update(_prefixed({
                    name: made[f"{name}/value"] if name in made
                    else layout.add_observable(self._output.file, name, value[0])
                    for name, value in first.items()
                }))  # fmt: skip
                self._observables = first
            new = count - rows.known(count)
            rows.add({
                name: np.asarray(value)[None] if count == 1 else np.stack([frame[name] for frame in found])
                for name, value in found[0].items()
            })  # fmt: skip
            if new:
                for view in self._empty_views:
                    view.resize(rows.committed + new, axis=0)
                self._output.flush()
                rows.mark(np.arange(rows.committed, rows.committed + new))
                self._output.flush()
            rows.confirm(count)
            self._last_time = before
            self._output.publish()

    def write_series(
        self,
        time: float,
        values: Mapping[str, ArrayLike],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Append a row to the time series and commit it.

        Parameters
        ----------
        time : float
            Its time [time], not before that of the last row.
        values : mapping
            Name of each series -> number or array. Names and shapes are those of the first row.
        columns : mapping, optional
            Names of the numbers in a series' rows, for those that have them; as in the first row.

        Raises
        ------
        InputError
            If the row does not fit the file; it is unchanged then.
        TrajectoryError
            As `write`.
        """
        self.write_series_rows([(time, values)], columns)

    def write_series_rows(
        self,
        rows: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Append rows, pairs of the first two arguments of `write_series`, and commit them together: faster than each.

        Raises
        ------
        InputError, TrajectoryError
            As `write_series`; then none of them is written.
        """
        with self._output.committing("rows of the series", self._kept):
            self._series.write(rows, columns)

    def begin_histories(self, ids: ArrayLike, state: State) -> None:
        """Begin to track disks, from a state on. In a file that tracks already, they must be the same.

        Parameters
        ----------
        ids : array_like of int
            Numbers of the disks.
        state : State
            Where they are.

        Raises
        ------
        InputError
            If there is no such disk, or one is named twice.
        TrajectoryError
            As `write`; and if the file has histories of other disks or from another time.
        """
        with self._output.committing("histories", self._kept):
            self._histories.begin(ids, state)

    def write_histories(self, events: Mapping[str, ArrayLike], time: float) -> None:
        """Append what happened to the tracked disks and commit it.

        Parameters
        ----------
        events : mapping
            Every column of `layout.EVENT_COLUMNS` -> array with a row an event, in the order of time and
            id. Arrays of no rows say that nothing happened.
        time : float
            Up to here the histories are complete [time].

        Raises
        ------
        InputError
            If a column is missing, unknown or of another shape or type; if the order is wrong, a disk is not
            tracked, or `begin_histories` has not been called. The file is unchanged then.
        TrajectoryError
            As `write`.
        """
        self.write_history_parts([(events, time)])

    def write_history_parts(self, parts: Sequence[tuple[Mapping[str, ArrayLike], float]]) -> None:
        """Append events of several spans of time, the arguments of `write_histories` for each: faster than each.

        Raises
        ------
        InputError, TrajectoryError
            As `write_histories`.
        """
        with self._output.committing("events of histories", self._kept):
            self._histories.write(parts)

    def close(self) -> None:
        """Close the file; one without frames is removed. May be called twice.

        Raises
        ------
        TrajectoryError
            If closing fails, e.g. because the disk has gone. Committed frames are kept.
        """
        self._output.close(self._drop_uncommitted, keep=len(self) > 0)

    def _kept(self) -> str:
        rows = f" and {len(self._series)} rows of the series" if len(self._series) else ""
        events = f" and {len(self._histories)} events" if len(self._histories) else ""
        return f"the {len(self)} frames{rows}{events} before it are kept"

    def _drop_uncommitted(self) -> None:
        """Remove what a `write` that was interrupted left behind the last commit."""
        self._rows.drop_uncommitted()
        for view in self._empty_views:
            if len(view) > len(self):
                view.resize(len(self), axis=0)
        if len(self) == 0:
            for name in list(self._output.file["observables"]):
                del self._output.file[f"observables/{name}"]
        self._series.drop_uncommitted()
        self._histories.drop_uncommitted()

    def _checked_fields(self, state: State, before: float) -> dict[str, NDArray[Any]]:
        """Fields of a frame that comes after time `before`, as they are stored."""
        if state.n != self._n:
            raise InputError(f"the state has {state.n} disks: {self._n} are needed")
        if not (np.isfinite(state.time) and state.time >= before):
            raise InputError(f"time = {state.time}: a finite time not before {before} is needed")
        found = {}
        for name, dataset in self._fields.items():
            value = np.ascontiguousarray(getattr(state, layout.FIELDS[name].attribute))
            if value.shape != dataset.shape[1:]:
                raise InputError(f"{name} has shape {value.shape}: {dataset.shape[1:]} is needed")
            if layout.FIELDS[name].count:
                found[name] = _as_count(name, value, dataset.dtype)
            elif isinstance(state, StoredState) and value.dtype == dataset.dtype:
                found[name] = value  # the engine has seen that all is finite
            else:
                found[name] = _as_float(name, value, dataset.dtype)
        if "position" in found:
            _keep_inside(found["position"], state.position, self._lengths)
        return found


def _prefixed(observables: Mapping[str, object]) -> dict[str, Any]:
    """Observables under names that no field has (there is an observable "collisions")."""
    return {f"observable {name}": value for name, value in observables.items()}


def _check_record(parameters: Mapping[str, object], units: Mapping[str, object]) -> None:
    for name, value in parameters.items():
        check_name("parameter", name)
        if not isinstance(value, (str, int, float)):
            raise InputError(f"parameter {name} = {value!r}: a text or a number is needed")
    for quantity, unit in units.items():
        check_name("unit", quantity)
        if not isinstance(unit, str):
            raise InputError(f"unit of {quantity} = {unit!r}: a text is needed")
        if (unit == layout.REDUCED) != (layout.REDUCED in units.values()):
            raise InputError(f"unit of {quantity} = {unit!r}: either all units are 'reduced' or none is")


def _as_count(name: str, value: NDArray[Any], dtype: np.dtype) -> NDArray[Any]:
    limits = np.iinfo(dtype)
    if value.dtype != dtype and value.size and not limits.min <= value.min() <= value.max() <= limits.max:
        raise InputError(f"{name}: counts beyond {limits.max} cannot be stored")
    return value.astype(dtype, copy=False)


def _as_float(name: str, value: NDArray[Any], dtype: np.dtype) -> NDArray[Any]:
    with np.errstate(over="ignore"):
        rounded = value.astype(dtype, copy=False)
    wrong = ~np.isfinite(rounded)
    if wrong.any():
        raise InputError(f"{name}: {value[wrong][0]} cannot be stored as {dtype}")
    return rounded


def _keep_inside(rounded: NDArray[Any], position: NDArray[Any], lengths: tuple[float, float]) -> None:
    """Undo in place where rounding to fewer digits carried a disk out of the box through its upper side."""
    if position.dtype == rounded.dtype:
        return
    for axis, length in enumerate(lengths):
        out = (rounded[:, axis] >= length) & (position[:, axis] < length)
        rounded[out, axis] = below(length, rounded.dtype)


def _check_choices(what: str, names: Sequence[str], allowed: Sequence[str]) -> None:
    for name in names:
        if name not in allowed:
            raise InputError(
                f"{what} = {name!r}: allowed are {', '.join(allowed)}{nearest(str(name), allowed)}"
            )


def _check_resumable(
    file: h5py.File,
    path: str,
    *,
    disks: Disks,
    box: Box,
    fields: Sequence[str],
    precision: str,
    compression: str,
    walls: str | None,
) -> None:
    """Raise InputError that says in what the file differs from what the run has; `walls` as JSON."""
    version = tuple(int(part) for part in file["h5md/modules/ifrdem"].attrs["version"])
    if version != layout.LAYOUT_VERSION:
        raise InputError(
            f"{path} has layout {version[0]}.{version[1]}: a run can go on only with files of layout "
            f"{layout.LAYOUT_VERSION[0]}.{layout.LAYOUT_VERSION[1]}; begin a new file"
        )
    _check_disks(file, path, disks)
    stored_box = file[f"{layout.PARTICLES}/box"].attrs
    expected = layout.box_attributes(box)
    for name in dict.fromkeys((*expected, *stored_box)):
        given, stored = expected.get(name), stored_box.get(name)
        if given is None or stored is None or not np.array_equal(given, stored):
            raise InputError(f"{path} has another box: its {name} is {stored}, the run's is {given}")
    held = file["parameters/walls"].asstr()[()] if "parameters/walls" in file else None
    if held != walls:
        raise InputError(f"{path} has other walls: {held or 'none'}, the run has {walls or 'none'}")
    _check_fields(file, path, fields, precision, compression)


def _check_disks(file: h5py.File, path: str, disks: Disks) -> None:
    n = len(file[f"{layout.PARTICLES}/radius"])
    if n != disks.n:
        raise InputError(f"{path} has {n} disks, the run has {disks.n}")
    for name in layout.STATIC:
        given, stored = getattr(disks, name), file[f"{layout.PARTICLES}/{name}"][()]
        different = given != stored
        if different.any():
            i = int(np.argmax(different))
            raise InputError(
                f"{path} has other disks: {name} of disk {i} is {stored[i]}, the run's is {given[i]}"
            )


def _check_fields(
    file: h5py.File, path: str, fields: Sequence[str], precision: str, compression: str
) -> None:
    stored = layout.stored_fields(file)
    if set(stored) != set(fields):
        raise InputError(f"{path} holds the fields {', '.join(stored)}, the run has {', '.join(fields)}")
    for name in stored:
        dataset = layout.field_dataset(file, name)
        if not layout.FIELDS[name].count and dataset.dtype != layout.PRECISIONS[precision]:
            raise InputError(
                f"{path} holds {name} as {dataset.dtype}, the run has precision {precision!r}: "
                f"{np.dtype(layout.PRECISIONS[precision])}"
            )
        held = damage.compression(dataset) or "none"
        if held != compression:
            raise InputError(f"{path} has compression {held!r}, the run has {compression!r}")
