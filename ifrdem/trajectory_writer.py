"""Writes a run's frames so that every death of the run leaves a good file.

The layout is described in `ifrdem.h5md`.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import h5md
from .box import Box
from .errors import InputError, nearest
from .state import Disks, State
from .walls import Wall, to_json

DEFAULT_FIELDS = ("position", "velocity", "angular_velocity", "collisions")

# Room on the disk that HDF5 may need for a dataset's next frame beside the chunks: a node of the chunk index.
_INDEX_ROOM = 8192


class TrajectoryError(RuntimeError):
    """A trajectory cannot be written further (a full disk, a closed file). Its committed frames are kept."""


class TrajectoryWriter:
    """Writes a run's frames into a new H5MD file.

    Each frame is committed in two phases: everything but its step is written and flushed, then the step. A
    process killed at any moment leaves a file in which each frame that has a step is whole. Room on the disk
    is reserved before a frame touches the file, so that a full disk leaves the same. Committed frames survive
    the death of the process; after a power failure they are as safe as the file system makes them.

    Use it as a context manager. A writer that is closed before its first frame leaves no file, and with
    `force` the old file stays in place until the first frame of the new one is committed.

    Parameters
    ----------
    path : str or path
        The file to write. Its folder must exist.
    disks : Disks
        The constant properties of the n disks [mass, length].
    box : Box
        The box [length]; its boundary is "none" where it is not periodic.
    fields : sequence of str
        What is stored per disk and frame: "position" [length], "velocity" [length/time], "angular_velocity"
        [rad/time], "collisions", "image".
    parameters : mapping
        What belongs into the file's record, by name: case text, seed, device, ... A name may be grouped by
        "/". The versions of Python and of the packages are added as versions/<package> where not given.
    units : mapping
        Unit of each quantity, e.g. {"length": "m", "mass": "kg", "time": "s", "momentum": "kg m s-1"};
        "reduced" for each of them, or for none.
    precision : str
        "f4" (default) or "f8": floats of the per-disk fields. f4 resolves 6e-8 of the box, enough for
        analysis and not for a restart. Times and observables are always f8, counts are integers.
    compression : str
        "none" (default) or "gzip" (shuffle and deflate, level 1).
    force : bool
        Replace a file that exists.
    walls : sequence of Wall
        Walls beside those at the sides of the box: the parameter "walls", as JSON.

    Raises
    ------
    InputError
        If a choice or name is unknown, the path exists and `force` is not given, it is not a regular file, or
        the file cannot be created there. Nothing is left behind then.
    """

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
        _check_choices("field", fields, list(h5md.FIELDS))
        if len(set(fields)) != len(fields):
            raise InputError(f"fields = {fields}: each may be given once")
        _check_choices("precision", [precision], list(h5md.PRECISIONS))
        _check_choices("compression", [compression], list(h5md.COMPRESSIONS))
        for name, value in parameters.items():
            _check_name("parameter", name)
            if not isinstance(value, (str, int, float)):
                raise InputError(f"parameter {name} = {value!r}: a text or a number is needed")
        for quantity, unit in units.items():
            _check_name("unit", quantity)
            if not isinstance(unit, str):
                raise InputError(f"unit of {quantity} = {unit!r}: a text is needed")
            if (unit == h5md.REDUCED) != (h5md.REDUCED in units.values()):
                raise InputError(f"unit of {quantity} = {unit!r}: either all units are 'reduced' or none is")

        # Links are followed: what they point to is replaced, not they.
        self.path = Path(os.path.realpath(path))
        self._n = disks.n
        self._lengths = box.lengths
        self._frames = 0
        self._last_time = -np.inf
        self._failed = False
        self._replaces = _check_output(self.path, path, force=force)
        # The file grows up beside its place, so that its place never holds half a file.
        self._present_path = _create_empty(self.path, path)
        try:
            # The default libver: files written with "latest" do not open after a kill.
            self._file = h5py.File(self._present_path, "w")
            h5md.create(
                self._file,
                disks=disks,
                box=box,
                fields=fields,
                precision=precision,
                compression=compression,
                parameters=parameters,
                units=units,
            )
            self._file.flush()
            if not self._replaces:  # else the old file keeps the place until the first frame is committed
                self._publish()
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            if hasattr(self, "_file"):
                with contextlib.suppress(OSError, RuntimeError):
                    self._file.close()
            self._present_path.unlink(missing_ok=True)
            raise InputError(f"output {path} cannot be written: {error}") from error
        # A second descriptor of the file, to reserve room and to give back what was not used.
        can_reserve = hasattr(os, "posix_fallocate")
        self._descriptor = os.dup(self._file.id.get_vfd_handle()) if can_reserve else None
        self._step = self._file[f"{h5md.EDGES}/step"]
        self._time = self._file[f"{h5md.EDGES}/time"]
        self._edges = self._file[f"{h5md.EDGES}/value"]
        self._fields = {name: h5md.field_dataset(self._file, name) for name in fields}
        self._empty_views = h5md.plain_views(self._file)
        self._observables: dict[str, h5py.Dataset] = {}

    def __len__(self) -> int:
        """Number of committed frames."""
        return self._frames

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
            If the frame cannot be written, e.g. to a full disk. The file keeps the frames before it.
        """
        if self._failed or not self._file:
            raise TrajectoryError(f"{self.path} is closed: no frame can be added")
        series = self._checked_observables({} if observables is None else observables)
        fields = self._checked_fields(state)
        try:
            if self._frames == 0:
                for name, value in series.items():
                    if name not in self._observables:  # it is there if an interrupt ended the first attempt
                        self._observables[name] = h5md.add_observable(self._file, name, value)
            self._reserve()
            self._append(self._time, state.time)
            self._append(self._edges, (*self._lengths, 1.0))
            for name, value in fields.items():
                self._append(self._fields[name], value)
            for name, value in series.items():
                self._append(self._observables[name], value)
            for view in self._empty_views:
                view.resize(self._frames + 1, axis=0)
            self._file.flush()
            self._append(self._step, self._frames)  # the commit marker
            self._file.flush()
            self._frames += 1
            self._last_time = state.time
            self._publish()
        except (OSError, RuntimeError) as error:
            self._failed = True
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise TrajectoryError(
                f"{self.path}: a frame could not be written ({reason}); "
                f"the {self._frames} frames before it are kept"
            ) from error

    def close(self) -> None:
        """Close the file; one without frames is removed. May be called twice.

        Raises
        ------
        TrajectoryError
            If closing fails, e.g. because the disk has gone. Committed frames are kept.
        """
        if not self._file:
            return
        try:
            if not self._failed:
                self._drop_uncommitted()
                self._file.flush()
            size = self._file.id.get_filesize()
            self._file.close()
            if self._descriptor is not None and os.fstat(self._descriptor).st_size > size:
                os.ftruncate(self._descriptor, size)
            if self._frames > 0:
                self._publish()
        except (OSError, RuntimeError) as error:
            if not self._failed:  # otherwise `write` has said it
                self._failed = True
                raise TrajectoryError(f"{self.path} could not be closed: {error}") from error
        finally:
            if self._descriptor is not None:
                os.close(self._descriptor)
                self._descriptor = None
            if self._frames == 0:
                self._present_path.unlink(missing_ok=True)

    def _append(self, dataset: h5py.Dataset, value: ArrayLike) -> None:
        dataset.resize(self._frames + 1, axis=0)
        dataset[self._frames] = value

    def _drop_uncommitted(self) -> None:
        """Remove what a `write` that was interrupted left behind the last commit."""
        for dataset in (self._step, *self._payload()):
            if len(dataset) > self._frames:
                dataset.resize(self._frames, axis=0)

    def _payload(self) -> list[h5py.Dataset]:
        fields, observables = self._fields.values(), self._observables.values()
        return [self._time, self._edges, *fields, *self._empty_views, *observables]

    def _publish(self) -> None:
        """Put the file at its place."""
        if self._present_path == self.path:
            return
        if self._replaces:
            os.replace(self._present_path, self.path)
        else:
            try:
                os.link(self._present_path, self.path)  # unlike a renaming, this never overwrites
            except FileExistsError:  # somebody was quicker
                raise
            except OSError:  # a file system without hard links
                os.rename(self._present_path, self.path)
            else:
                self._present_path.unlink()
        self._present_path = self.path

    def _reserve(self) -> None:
        """Reserve the room for a frame on the disk before HDF5 begins it: HDF5 cannot undo half a write."""
        room = 0
        for dataset in (self._step, *self._payload()):
            cells = [
                -(-length // chunk) * chunk
                for length, chunk in zip(dataset.shape[1:], dataset.chunks[1:], strict=True)
            ]
            room += dataset.chunks[0] * int(np.prod(cells)) * dataset.dtype.itemsize + _INDEX_ROOM
        if self._descriptor is None:
            if shutil.disk_usage(self._present_path.parent).free < room:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return
        try:
            os.posix_fallocate(self._descriptor, self._file.id.get_filesize(), room)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # some file systems cannot reserve
                raise

    def _checked_observables(self, observables: Mapping[str, ArrayLike]) -> dict[str, NDArray]:
        series = {}
        for name, given in observables.items():
            value = np.asarray(given)
            if value.dtype.kind not in "iuf" or value.size == 0:
                raise InputError(f"observable {name} = {given!r}: a number or numbers are needed")
            series[name] = value.astype(np.float64 if value.dtype.kind == "f" else np.int64)
        if self._frames == 0:
            for name in series:
                _check_name("observable", name, separator=False)
            return series
        first = self._observables
        if series.keys() != first.keys():
            raise InputError(f"observables {sorted(series)}: the first frame has {sorted(first)}")
        for name, value in series.items():
            if value.shape != first[name].shape[1:]:
                raise InputError(
                    f"observable {name} has shape {value.shape}: {first[name].shape[1:]} is needed"
                )
            if value.dtype.kind == "f" and first[name].dtype.kind != "f":
                raise InputError(f"observable {name} = {value}: it was an integer in the first frame")
        return series

    def _checked_fields(self, state: State) -> dict[str, NDArray]:
        if state.n != self._n:
            raise InputError(f"the state has {state.n} disks: {self._n} are needed")
        if not (np.isfinite(state.time) and state.time >= self._last_time):
            raise InputError(f"time = {state.time}: a finite time not before {self._last_time} is needed")
        checked = {}
        for name, dataset in self._fields.items():
            value = np.asarray(getattr(state, h5md.FIELDS[name].attribute))
            if value.shape != dataset.shape[1:]:
                raise InputError(f"{name} has shape {value.shape}: {dataset.shape[1:]} is needed")
            if h5md.FIELDS[name].count:
                checked[name] = _as_count(name, value, dataset.dtype)
            else:
                checked[name] = _as_float(name, value, dataset.dtype)
        if "position" in checked:
            _keep_inside(checked["position"], state.position, self._lengths)
        return checked


def _as_count(name: str, value: NDArray, dtype: np.dtype) -> NDArray:
    limits = np.iinfo(dtype)
    if value.size and not limits.min <= value.min() <= value.max() <= limits.max:
        raise InputError(f"{name}: counts beyond {limits.max} cannot be stored")
    return value.astype(dtype)


def _as_float(name: str, value: NDArray, dtype: np.dtype) -> NDArray:
    with np.errstate(over="ignore"):
        rounded = value.astype(dtype)
    wrong = ~np.isfinite(rounded)
    if wrong.any():
        raise InputError(f"{name}: {value[wrong][0]} cannot be stored as {dtype}")
    return rounded


def _keep_inside(rounded: NDArray, position: NDArray, lengths: tuple[float, float]) -> None:
    """Undo in place where rounding to fewer digits carried a disk out of the box through its upper side."""
    for axis, length in enumerate(lengths):
        out = (rounded[:, axis] >= length) & (position[:, axis] < length)
        below = rounded.dtype.type(length)
        if below >= length:
            below = np.nextafter(below, rounded.dtype.type(0.0))
        rounded[out, axis] = below


def _check_choices(what: str, names: Sequence[str], allowed: Sequence[str]) -> None:
    for name in names:
        if name not in allowed:
            raise InputError(
                f"{what} = {name!r}: allowed are {', '.join(allowed)}{nearest(str(name), allowed)}"
            )


def _check_name(what: str, name: object, *, separator: bool = True) -> None:
    parts = str(name).split("/") if separator else [str(name)]
    if not isinstance(name, str) or any(part in ("", ".", "..") or "/" in part for part in parts):
        raise InputError(f"name of {what} = {name!r}: a text is needed that HDF5 takes as a name")


def _check_output(path: Path, given: str | os.PathLike[str], *, force: bool) -> bool:
    """Whether there is a file to replace at `path`; raises InputError if that must not be."""
    if os.path.isdir(path):  # unlike Path.is_dir, os.path takes an impossible name for an absent file
        raise InputError(f"output {os.fspath(given)} is a folder: the name of a file is needed")
    if not os.path.isdir(path.parent):
        raise InputError(f"output {os.fspath(given)}: there is no folder {path.parent}")
    if not os.path.exists(path):
        return False
    if not os.path.isfile(path):
        raise InputError(f"output {os.fspath(given)} is not a regular file")
    if not force:
        raise InputError(f"output {os.fspath(given)} exists: choose another name, or replace it (--force)")
    return True


def _create_empty(path: Path, given: str | os.PathLike[str]) -> Path:
    """Create an empty file beside `path` and return its path."""
    beside = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}.part")
    try:
        os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666))
    except OSError as error:
        raise InputError(f"output {os.fspath(given)} cannot be created: {error.strerror}") from error
    return beside
