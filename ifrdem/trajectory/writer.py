"""Writer of frames, time series and histories; however a run ends, the file is valid.

The layout is described in `layout`.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, counted, shortened
from ..model.box import Box, below
from ..model.state import Disks, FrameRows, State
from ..model.walls.wall import Wall, to_json
from ..quantities import FIELDS, PRECISIONS
from ..tools import checked
from ..tools.checked import is_integer, validated
from ..tools.files import cause
from ..tools.read_only import NotCopied, ReadOnlyAttributes
from . import damage, layout
from . import parts as part_files
from .file import OutputFile, signals_postponed
from .parts import Part, Parts
from .rows import CommitLog, HistoryWriter, SeriesWriter, check_name, samples, stored
from .rows import checked as checked_row
from .species import with_species

DEFAULT_FIELDS = ("position", "velocity", "angular_velocity", "collisions", "image")


class TrajectoryWriter(NotCopied, ReadOnlyAttributes):
    """Writes frames, time series and histories of a run into a new H5MD file.

    Each frame is committed in two phases: everything but its step is written and flushed, then the step. A
    process killed at any moment leaves a file in which each frame that has a step is whole; likewise the rows
    of series and the events of histories. Every write to the disk leaves such a file (`OrderedFile`), so that a
    full disk does, too. Committed frames survive the death of the process; after a power failure they are as
    safe as the file system makes them.

    Use it as a context manager. A writer that is closed before its first frame leaves no file, and with
    `force` the old file stays in place until the first frame of the new one is committed. `resume` continues
    with a file that a run has left.

    Parameters
    ----------
    path : str or path
        The file to write. Its folder must exist.
    disks : Disks
        The constant properties of the n disks [mass, length]; their species are the parameter "species", as JSON.
    box : Box
        The box [length]; its boundary is "none" where it is not periodic.
    fields : sequence of str
        What is stored per disk and frame: "position" [length], "velocity" [length/time], "angle"
        [rad], "angular_velocity" [rad/time], "collisions", "image", "last_partner", "dissipated"
        [energy], by mechanism.
    parameters : mapping
        What belongs into the file's record, by name: case text, seed, device, ... A name may be grouped by
        "/". The versions of Python and of the packages are added as versions/<package> where not given.
    units : mapping
        Unit of each quantity, e.g. {"length": "m", "mass": "kg", "time": "s", "momentum": "kg m s-1"};
        "reduced" for each of them, or for none. Without them the file says that they are not stated.
    precision : str
        "f32" (default) or "f64": floats of the per-disk fields. f32 resolves 6e-8 of the box, enough for
        analysis and not for a restart, and holds sizes from 1e-38 to 3e38. Times, observables, series and histories
        are always f8, counts are integers.
    compression : str
        "none" (default), "gzip" (shuffle and deflate, level 1) or "zstd" (shuffle and Zstandard) of the per-disk
        fields. gzip is read by every HDF5 program; zstd is faster, and requires the package `hdf5plugin` (extra
        `zstd`) here and in every program that reads the file: others say that a filter is missing.
    force : bool
        Replace a file that exists.
    walls : sequence of Wall
        Walls in addition to the sides of the box: the parameter "walls", as JSON.
    within : Parts or Part, optional
        For a trajectory in parts (`PartsWriter`): all parts, if this is NAME.h5, which gets no fields of its own; or
        which of them this is.

    Raises
    ------
    InputError
        If a choice or name is unknown, `hdf5plugin` is missing for zstd, the path exists and `force` is not given,
        it is not a regular file, or the file cannot be created there. Nothing remains then.

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

    _instead = (
        "A file has one writer: give each process a file of its own, or its frames to the process that writes"
    )

    path: Path

    @validated
    def __init__(
        self,
        path: str | os.PathLike[str],
        disks: Disks,
        box: Box,
        *,
        fields: Sequence[str] = DEFAULT_FIELDS,
        parameters: Mapping[str, str | int | float] | None = None,
        units: Mapping[str, str] | None = None,
        precision: str = "f32",
        compression: str = "none",
        force: bool = False,
        walls: Sequence[Wall] = (),
        within: Parts | Part | None = None,
    ) -> None:
        checked.path("path", path)
        checked.instance("disks", disks, Disks)
        checked.instance("box", box, Box)
        for name, given in (("parameters", parameters), ("units", units)):
            if not isinstance(given, Mapping | None):
                raise InputError(f"{name} = {shortened(given)}: must be a mapping by name")
        parameters = with_species(parameters, {} if isinstance(within, Part) else disks.species)
        parameters |= {"walls": to_json(walls)} if walls else {}
        units = units or {}
        fields = [fields] if isinstance(fields, str) else list(fields)
        for name in fields:
            checked.choice("field", name, FIELDS)
        if len(set(fields)) != len(fields):
            raise InputError(f"fields = {fields}: each may be given once")
        checked.choice("precision", precision, PRECISIONS)
        checked.choice("compression", compression, layout.COMPRESSIONS)
        if compression == "zstd":
            layout.need_zstd('compression "zstd"')
        _check_record(parameters, units)
        fill = functools.partial(
            layout.create, disks=disks, box=box, fields=fields, precision=precision, compression=compression,
            parameters=parameters, units=units, within=within,
        )  # fmt: skip
        output = None
        try:
            with signals_postponed():
                output = OutputFile.create(path, fill, force=force)
                self._begin(output, disks.n, box)
        except BaseException:
            if output is not None:
                output.close(lambda: None, keep=False)
            raise

    @classmethod
    def resume(
        cls,
        path: str | os.PathLike[str],
        disks: Disks,
        box: Box,
        *,
        fields: Sequence[str] = DEFAULT_FIELDS,
        precision: str = "f32",
        compression: str = "none",
        walls: Sequence[Wall] = (),
        frames: int,
        series_rows: int = 0,
        events: int = 0,
    ) -> TrajectoryWriter:
        """Continue the file of a run that is resumed from a checkpoint; no other process may write it.

        What a kill left uncommitted is dropped. What was committed after the checkpoint stays: the run computes it
        again, and gives it again; it is compared with the file bit for bit. The run had written so many `frames`,
        `series_rows` and `events` of histories at the checkpoint; all other arguments are those of the
        file's creation.

        Raises InputError if there is no such file, it is open elsewhere, it was created with other arguments, or it
        holds less than the checkpoint had seen. The file is as it was then.
        """
        expected = {"frames": frames, "series_rows": series_rows, "events": events}
        for name, value in expected.items():
            if not is_integer(value) or value < 0:
                raise InputError(f"{name} = {shortened(value)}: must be an integer, 0 or more")
        output, file_name = OutputFile.reopen(path), os.fspath(path)
        try:
            with signals_postponed():
                layout.check_layout(output.file, file_name)
                fields = [fields] if isinstance(fields, str) else fields
                text = to_json(walls) if walls else None
                _check_resumable(output.file, file_name, disks, box, fields, precision, compression, text)
                writer = cls.__new__(cls)
                writer._begin(output, disks.n, box, **expected)
                writer._drop_uncommitted()
                layout.record_runtime(output.file)
                output.flush()
        except BaseException as error:
            output.close(lambda: None, keep=True)
            if isinstance(error, OSError | RuntimeError):
                raise InputError(f"{file_name} cannot be resumed: {cause(error)}") from error
            raise
        return writer

    def _begin(
        self, output: OutputFile, n: int, box: Box, frames: int = 0, series_rows: int = 0, events: int = 0
    ) -> None:
        """Open the file's datasets, of which the run has written these numbers of rows."""
        self._output = output
        self._set(path=output.path)
        self._n = n
        self._box = box
        file = output.file
        clock = file[layout.clock(file)]
        step = clock["step"]
        committed = len(step)
        self._histories = HistoryWriter(output, n, events)
        for what, held, expected in (
            ("frames", committed, frames),
            ("rows of series", layout.committed_rows(file), series_rows),
            ("events", self.events, events),
        ):
            if expected > held:
                raise InputError(
                    f"{self.path} holds {held} {what}, the checkpoint had seen {expected}: it is another file's"
                )
        self._parts = part_files.of(file, self.path)
        names = layout.stored_fields(file) if self._parts is None else ()  # parts have their own
        fields = {name: layout.field_dataset(file, name) for name in names}
        self._fields = samples(fields)
        observables = (
            {name: group["value"] for name, group in file["observables"].items()} if committed else {}
        )
        self._observables = samples(observables)
        edges = {"edges": clock["value"]} if "value" in clock else {}
        rows = {"time": clock["time"], **edges, **fields, **_prefixed(observables)}
        self._rows = CommitLog("frame", step, rows, committed, frames, part_files.first_of(file))
        # Views of no disks do not grow by themselves.
        views = [name for name in fields if n == 0 and FIELDS[name].along == "axis"]
        self._rows.blank = [
            *file.get(part_files.ZEROS, {}).values(),
            *(file[f"{layout.PARTICLES}/{name}/value"] for name in views),
        ]
        self._series = SeriesWriter(output, series_rows)

    def __len__(self) -> int:
        """Number of committed frames."""
        return self._rows.committed

    @property
    def parts(self) -> Parts | None:
        """The parts, if this is NAME.h5 of a trajectory that has some."""
        return self._parts

    @property
    def replaced_or_removed(self) -> str | None:
        """Reason why the file is no longer at its path; None if it is."""
        return self._output.replaced_or_removed

    @property
    def series_rows(self) -> int:
        """Number of committed rows of the series."""
        return self._series.rows.committed if self._series.rows else 0

    @property
    def events(self) -> int:
        """Number of committed events of the histories."""
        return self._histories.events.committed if self._histories.events else 0

    @property
    def written_counts(self) -> dict[str, int]:
        """Numbers of frames, series_rows and events written so far, which a checkpoint keeps for `resume`."""
        rows = {"frames": self._rows, "series_rows": self._series.rows, "events": self._histories.events}
        return {name: each.at if each else 0 for name, each in rows.items()}

    def __enter__(self) -> TrajectoryWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, state: State, observables: Mapping[str, ArrayLike] | None = None) -> None:
        """Append a frame and commit it.

        The `state` has positions [length], velocities [length/time], spins [rad/time] and counts of the n disks, at a
        time not before that of the last frame; `observables` are quantities of the whole gas by name: numbers or
        arrays, floats or integers, as in the first frame.

        Raises InputError if they do not fit the file, which is unchanged then; TrajectoryError if the frame cannot be
        written, e.g. to a full disk, or a resumed run gives another frame than the file holds, which keeps the frames
        before it.
        """
        self.write_frames([(state, observables)])

    def write_frames(
        self, frames: Sequence[tuple[State | FrameRows, Mapping[str, ArrayLike] | None]]
    ) -> None:
        """Append frames, the arguments of `write` for each, and commit them together: faster than each.

        Raises InputError and TrajectoryError as `write`; then none of them is written.
        """
        with self._output.committing("a frame", self._kept):
            first = self._observables if len(self) else None
            before, found = self._rows.last_time, []
            for state, observables in frames:
                if not hasattr(state, "time"):
                    raise InputError(f"state = {shortened(state)}: must be a State")
                if not isinstance(observables, Mapping | None):
                    raise InputError(
                        f"observables = {type(observables).__name__}: must be numbers by name, such as "
                        '{"temperature": measure.temperature}'
                    )
                values = checked_row("observable", "frame", observables or {}, first)
                first = values if first is None else first
                frame: dict[str, Any] = {"time": np.float64(state.time)}
                if any(self._box.periodic):
                    frame["edges"] = self._box.cell(float(state.time))
                found.append(frame | self._checked_fields(state, before) | _prefixed(values))
                before = state.time
            if not found:
                return
            if len(self) == 0 and first is not None:
                file, made = self._output.file, {}
                for name, value in first.items():  # some are there if an interrupt ended the first attempt
                    there = f"observables/{name}/value" in file
                    made[name] = (
                        file[f"observables/{name}/value"]
                        if there
                        else layout.add_observable(file, name, value)
                    )
                self._rows.datasets.update(_prefixed(made))
                self._observables = first
            join = np.stack if len(found) > 1 else lambda one: one[0][None]  # a large frame is not copied
            self._rows.commit(
                self._output, {name: join([frame[name] for frame in found]) for name in found[0]}
            )
            self._output.publish()

    def write_series(
        self, time: float, values: Mapping[str, ArrayLike], columns: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        """Append a row to the time series and commit it.

        Its `time` [time] is not before that of the last row. `values` are numbers or arrays by the name of each series;
        `columns` are the names of the numbers in the rows of those that have them. Names and shapes are as in the first
        row.

        Raises InputError and TrajectoryError as `write`.
        """
        self.write_series_rows([(time, values)], columns)

    def write_series_rows(
        self,
        rows: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Append rows, pairs of the first two arguments of `write_series`, and commit them together: faster than each.

        Raises InputError and TrajectoryError as `write`; then none of them is written.
        """
        with self._output.committing("rows of the series", self._kept):
            self._series.write(rows, columns)

    def begin_histories(self, ids: ArrayLike, state: State) -> None:
        """Start tracking disks from a state on; the state has all disks, or these in ascending order of ids.

        In a file that has histories, the ids must be the same.

        Raises InputError if there is no such disk, or one is named twice; TrajectoryError as `write`, and if the file
        has histories of other disks or from another time.
        """
        with self._output.committing("histories", self._kept):
            self._histories.begin(ids, state)

    def write_histories(self, events: Mapping[str, ArrayLike], time: float) -> None:
        """Append events of the tracked disks and commit them.

        `events` has every column of `quantities.EVENT`, an array with a row an event, in the order of time and id;
        arrays of no rows say that nothing happened. Up to `time` the histories are complete [time].

        Raises InputError if a column is missing, unknown or of another shape or type; if the order is wrong, a disk is
        not tracked, or `begin_histories` has not been called: the file is unchanged then. TrajectoryError as `write`.
        """
        self.write_history_parts([(events, time)])

    def write_history_parts(self, parts: Sequence[tuple[Mapping[str, ArrayLike], float]]) -> None:
        """Append events of several spans of time, the arguments of `write_histories` for each: faster than each.

        Raises InputError and TrajectoryError as `write_histories`.
        """
        with self._output.committing("events of histories", self._kept):
            self._histories.write(parts)

    def close(self) -> None:
        """Close the file; one without frames is removed. May be called twice.

        Raises TrajectoryError if closing fails, e.g. because the disk has gone. Committed frames are kept.
        """
        self._output.close(self._drop_uncommitted, keep=len(self) > 0)

    def _kept(self) -> str:
        if len(self) == 0:
            return "there is no frame before it: nothing is kept"
        rows = f" and {counted(self.series_rows, 'row')} of the series" if self.series_rows else ""
        events = f" and {counted(self.events, 'event')}" if self.events else ""
        return f"the {counted(len(self), 'frame')}{rows}{events} before it are kept"

    def _drop_uncommitted(self) -> None:
        """Remove rows after the last commit, left by an interrupted `write`."""
        self._rows.drop_uncommitted()
        if len(self) == 0:
            for name in list(self._output.file["observables"]):
                del self._output.file[f"observables/{name}"]
        self._series.drop_uncommitted()
        self._histories.drop_uncommitted()

    def _checked_fields(self, state: State | FrameRows, before: float) -> dict[str, NDArray[Any]]:
        """Fields of a frame that comes after time `before`, as they are stored."""
        if state.n != self._n:
            raise InputError(f"the state has {state.n} disks: must be {self._n}")
        if not (np.isfinite(state.time) and state.time >= before):
            raise InputError(f"time = {state.time}: must be a finite time not before {before}")
        found = {}
        for name, like in self._fields.items():
            vanish = np.isfinite(before) and name != "dissipated"  # which only grows
            value = getattr(state, FIELDS[name].name)
            found[name] = stored(name, value, like.shape, like.dtype, vanish=vanish)
        if "position" in found and found["position"].dtype != state.position.dtype:
            # Rounding to fewer digits may carry a disk out of the box through its upper side.
            for axis, length in enumerate(self._box.lengths):
                out = (found["position"][:, axis] >= length) & (state.position[:, axis] < length)
                found["position"][out, axis] = below(length, found["position"].dtype)
        return found


def _prefixed(observables: Mapping[str, object]) -> dict[str, Any]:
    """Observables under names that no field has (there is an observable "collisions")."""
    return {f"observable {name}": value for name, value in observables.items()}


def _check_record(parameters: Mapping[str, object], units: Mapping[str, object]) -> None:
    for name, value in parameters.items():
        check_name("parameter", name)
        if not isinstance(value, (str, int, float)):
            raise InputError(f"parameter {name} = {shortened(value)}: must be a string or a number")
    for quantity, unit in units.items():
        check_name("unit", quantity)
        if not isinstance(unit, str):
            raise InputError(f"unit of {quantity} = {shortened(unit)}: must be a string")
        if (unit == layout.REDUCED) != (layout.REDUCED in units.values()):
            raise InputError(
                f"unit of {quantity} = {shortened(unit)}: must be 'reduced' for all units or none"
            )


def _check_resumable(
    file: h5py.File, path: str, disks: Disks, box: Box, fields: Sequence[str], precision: str, compression: str,
    walls: str | None,
) -> None:  # fmt: skip
    """Raise InputError that says in what the file differs from what the run has; `walls` as JSON."""
    version = tuple(int(part) for part in file["h5md/modules/ifrdem"].attrs["version"])
    if version != layout.LAYOUT_VERSION:
        raise InputError(
            f"{path} has layout {version[0]}.{version[1]}: a run can be resumed only with files of layout "
            f"{layout.LAYOUT_VERSION[0]}.{layout.LAYOUT_VERSION[1]}; write to a new file"
        )
    particles = file[layout.PARTICLES]
    parts = part_files.of(file, path)
    if (n := len(particles["radius"]) if parts is None else parts.n) != disks.n:
        raise InputError(f"{path} has {n} disks, the run has {disks.n}")
    for name in layout.STATIC if parts is None else ():  # else the parts are checked themselves
        given, stored = getattr(disks, name), particles[name][()]
        if (different := given != stored).any():
            i = int(np.argmax(different))
            raise InputError(
                f"{path} has other disks: {name} of disk {part_files.first_of(file) + i} is {stored[i]}, "
                f"the run's is {given[i]}"
            )
    stored_box, expected = particles["box"].attrs, layout.box_attributes(box)
    for name in dict.fromkeys((*expected, *stored_box)):
        given, stored = expected.get(name), stored_box.get(name)
        if given is None or stored is None or not np.array_equal(given, stored):
            raise InputError(f"{path} has another box: its {name} is {stored}, the run's is {given}")
    held = file["parameters/walls"].asstr()[()] if "parameters/walls" in file else None
    if held != walls:
        raise InputError(f"{path} has other walls: {held or 'none'}, the run has {walls or 'none'}")
    there = layout.stored_fields(file)
    if set(there) != set(fields):
        raise InputError(f"{path} holds the fields {', '.join(there)}, the run has {', '.join(fields)}")
    for name in there if parts is None else ():
        dataset = layout.field_dataset(file, name)
        expected_dtype = np.dtype(PRECISIONS[precision])
        if not FIELDS[name].whole and dataset.dtype != expected_dtype:
            raise InputError(
                f"{path} holds {name} as {dataset.dtype}, the run has precision {precision!r}: {expected_dtype}"
            )
        packed = damage.compression(dataset) or "none"
        if packed != compression:
            raise InputError(f"{path} has compression {packed!r}, the run has {compression!r}")
