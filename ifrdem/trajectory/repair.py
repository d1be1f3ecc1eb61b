"""Making a trajectory that opens out of one that was damaged, by a copy of what can be read.

HDF5 notices damage of its own bookkeeping, of compressed chunks (deflate has a checksum), and a missing end of the
file. Numbers that were changed in uncompressed data look like other numbers: nothing here finds them.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import DamageError, InputError
from ..tools import files
from ..tools.files import check_apart, checkpoint_of, not_a_file
from . import damage, history, layout
from .reader import Trajectory, check_file
from .views import paths as view_paths

BLOCK = 1 << 22  # numbers that are copied at once


def repair(path: Path, place: Path, *, say: Callable[[str], object] = print) -> bool:
    """Write what can be read of a trajectory to a new file; False if nothing is wrong, and nothing was written.

    Frames that can be read are kept, also behind damaged ones, with the numbers (`step`) that they had. Series and
    histories end before their first damaged part. Either answer is given only after the file, or its copy, was opened
    and read to its end.

    Parameters
    ----------
    path : Path
        The file; it is not changed unless it is `place`.
    place : Path
        Where to write: whole or not at all. `path` itself replaces it; a link or another name of it is refused.
    say : callable
        Takes lines that say what is wrong.

    Raises
    ------
    InputError
        If nothing can be kept: the message says why and what can be done; or if either is a folder or a device.
    """
    check_file(path)
    if place != path:
        check_apart(place, path)
    if special := not_a_file(place):
        raise InputError(special)
    with _openable(path, say) as (source, whole), h5py.File(source, "r") as file:
        try:
            with damage.reading(path, "its bookkeeping"):
                copy = _Copy(file, path, whole, say)
        except DamageError as error:
            raise _in_vain(path, error) from error
        if not copy.wrong and whole is None:
            try:
                _read_through(path)
                return False
            except InputError as error:
                say(f"  {error}")
        try:
            with files.replacing(place) as new:
                copy.write(new)
                try:
                    _read_through(new)
                except InputError as error:
                    raise _in_vain(path, error, new) from error
        except OSError as error:
            raise InputError(f"output {place}: cannot be written: {error.strerror or error}") from error
    say(f"  {len(copy.frames)} of {copy.committed} frames are kept")
    return True


def _in_vain(path: Path, error: InputError, copy: Path | None = None) -> DamageError:
    reason = str(error).removesuffix(damage.HINT)
    if copy is not None:
        reason = reason.replace(str(copy), "its copy")
    return DamageError(f"{path}: nothing can be kept ({reason}){_otherwise(path)}")


def _read_through(path: Path) -> None:
    """Open a trajectory and read all that is in it; InputError says what cannot be read."""
    with Trajectory(path) as trajectory:
        for frame in trajectory:
            for name in trajectory.fields:
                frame[name]
        for series in (trajectory.observables, trajectory.series):
            for name in series:
                series[name]
        for disk in trajectory.tracked[:1]:
            trajectory.history(int(disk))


class _Copy:
    """What of a trajectory can be read, and its copy.

    Attributes
    ----------
    wrong : bool
        Whether anything cannot be read, or is not committed.
    committed : int
        Number of frames that the file says it has.
    frames : array
        Numbers of those that can be read.
    """

    def __init__(self, file: h5py.File, path: Path, whole: int | None, say: Callable[[str], object]) -> None:
        damage.check_links(file, str(path), layout.VIEWS)
        layout.load_compression(file, str(path))
        self.wrong = False
        self._file, self._path, self._whole, self._say = file, path, whole, say
        self._rows: dict[
            str, NDArray[np.intp]
        ] = {}  # that are kept, of what grows; by the beginning of the name
        self._lost: set[str] = set()
        edges = [f"{layout.EDGES}/{name}" for name in ("step", "time", "value")]
        static = [f"{layout.PARTICLES}/{name}" for name in layout.STATIC]
        missing = [one for one in (*edges, *static, "h5md/modules/ifrdem", "parameters") if one not in file]
        if missing:
            raise InputError(f"{path} cannot be made a trajectory of ifrdem: {', '.join(missing)} is missing")
        self.committed = len(file[edges[0]])
        fields = [layout.field_dataset(file, name).name.lstrip("/") for name in layout.stored_fields(file)]
        good = np.ones(self.committed, dtype=bool)
        for name in (*edges, *fields):
            here = self._good(file[name], self.committed, 1, finite=True)
            if not here.all():
                self._note(f"{name}: {_numbers(np.flatnonzero(~here))} cannot be read")
            self._beyond(name, file[name], self.committed, "frame")
            good &= here
        self._looked_at = {*edges, *fields}
        self.frames = self._rows[layout.PARTICLES] = self._rows["observables"] = np.flatnonzero(good)
        if len(self.frames) == 0:
            raise InputError(
                f"{path}: no frame of {self.committed} is whole: nothing can be kept{_otherwise(path)}"
            )
        self._look_at_series()
        self._look_at_histories()
        self._made: dict[int, h5py.Group | h5py.Dataset] = {}
        self._copy(file, None)
        if "observables" not in file:
            self._note("observables: missing; the copy has none")

    def write(self, place: Path) -> None:
        """Write the copy."""
        self._made = {}
        with h5py.File(place, "w") as new:
            self._copy(self._file, new)
            if "observables" not in new:
                new.create_group("observables")

    def _note(self, text: str) -> None:
        self.wrong = True
        self._say(f"  {text}")

    def _beyond(self, name: str, dataset: h5py.Dataset, rows: int, what: str) -> None:
        if len(dataset) > rows:
            self._note(f"{name}: {len(dataset) - rows} uncommitted behind the last {what}")

    @contextmanager
    def _or_lost(self, name: str) -> Iterator[None]:
        """Note that a part is lost if it cannot be read."""
        try:
            with damage.reading(self._path, name):
                yield
        except DamageError:
            self._note(f"{name}: cannot be read; the copy lacks it")
            self._lost.add(name)

    def _good(
        self, dataset: h5py.Dataset, rows: int, step: int = 0, *, finite: bool = False
    ) -> NDArray[np.bool_]:
        """The first rows that can be read, looked at in steps of whole chunks."""
        good = np.zeros(rows, dtype=bool)
        step = step or (dataset.chunks[0] if dataset.chunks else max(rows, 1))
        held = min(rows, len(dataset))
        for first in range(0, held, step):
            part = slice(first, min(first + step, held))
            with suppress(DamageError):
                value = damage.read(dataset, part)
                good[part] = not (finite and value.dtype.kind == "f") or np.isfinite(value).all()
        good[:held] &= ~self._behind_end(dataset)[:held]
        return good

    def _behind_end(self, dataset: h5py.Dataset) -> NDArray[np.bool_]:
        """The rows of which something was stored behind the end of a file that is too short."""
        lost = np.zeros(len(dataset), dtype=bool)
        whole = self._whole
        if whole is None:
            return lost
        if dataset.chunks is None:
            offset = dataset.id.get_offset()
            lost[:] = offset is not None and offset + dataset.id.get_storage_size() > whole
            return lost

        def look(chunk: h5py.h5d.StoreInfo) -> None:
            if chunk.byte_offset + chunk.size > whole:
                lost[chunk.chunk_offset[0] : chunk.chunk_offset[0] + dataset.chunks[0]] = True

        dataset.id.chunk_iter(look)
        return lost

    def _leading(self, group: h5py.Group, names: list[str], rows: int, what: str, unit: str) -> None:
        """Keep the rows before the first that cannot be read in one of these datasets."""
        kept = rows
        for name in names:
            good = self._good(group[name], rows, finite=name == "time")
            kept = min(kept, rows if good.all() else int(np.argmin(good)))
            self._beyond(f"{what}/{name}", group[name], rows, unit)
        if kept < rows:
            self._note(f"{what.partition('/')[0]}: only the first {kept} of {rows} {unit}s can be read")
        self._rows[what] = np.arange(kept)

    def _look_at_series(self) -> None:
        if layout.TIMESERIES in self._file:
            with self._or_lost(layout.TIMESERIES):
                group = self._file[layout.TIMESERIES]
                several = [f"{name}/value" for name in group if isinstance(group[name], h5py.Group)]
                rows = len(group["step"])
                self._leading(group, ["step", "time", *several], rows, layout.TIMESERIES, "row")

    def _look_at_histories(self) -> None:
        if history.GROUP not in self._file:
            return
        with self._or_lost(history.GROUP):
            count = history.committed(self._file, str(self._path))[0]
            events, group = self._file[f"{history.GROUP}/events"], self._file[history.GROUP]
            for name in ("tracked", *(f"start/{one}" for one in group["start"])):
                self._check(group[name])
            self._leading(events, list(events), count, f"{history.GROUP}/events", "event")
            commits = damage.read(group["committed/events"])
            kept = np.flatnonzero(commits <= len(self._rows[f"{history.GROUP}/events"]))
            if len(kept) == 0:
                raise DamageError(f"{self._path} is damaged: no commit of its histories is whole")
            self._rows[f"{history.GROUP}/committed"] = kept

    def _check(self, item: h5py.Dataset) -> None:
        """Raise DamageError if the kept rows of a dataset, or all of one that does not grow, cannot be read."""
        name = str(item.name).lstrip("/")
        if item.is_virtual or name in self._looked_at:
            return
        if name.startswith("parameters/") or item.dtype.kind not in "biuf":
            damage.parameter(item)
        elif item.shape == ():
            damage.read(item)
        else:
            rows = self._kept(item)
            rows = np.arange(len(item)) if rows is None else rows
            count = int(rows.max(initial=-1)) + 1
            if not self._good(item, count)[rows].all():
                raise DamageError(f"{self._path} is damaged: {name}")

    def _kept(self, item: h5py.Dataset) -> NDArray[np.intp] | None:
        """Rows of a dataset that are kept; None if it has none that grow, or is a view."""
        if item.is_virtual or not item.maxshape or item.maxshape[0] is not None:
            return None
        name = str(item.name).lstrip("/")
        return next((rows for begin, rows in self._rows.items() if name.startswith(f"{begin}/")), None)

    def _copy(self, old: h5py.Group | h5py.Dataset, new: h5py.Group | h5py.Dataset | None) -> None:
        """Copy what is not lost; without `new`, find out what is."""
        for key in old.attrs:
            name = f"{old.name}, attribute {key}"
            if new is not None and name not in self._lost:
                new.attrs[key] = old.attrs[key]
            elif new is None:
                with self._or_lost(name):
                    "".join(one for one in np.ravel(old.attrs[key]) if isinstance(one, str)).encode()
        for key in old if isinstance(old, h5py.Group) else ():
            name = f"{old.name}/{damage.text_of(key)}".lstrip("/")
            part = "/".join(name.split("/")[:2]) if name.startswith("observables/") else name
            if part not in self._lost:
                if new is None:
                    with self._or_lost(part):
                        self._copy_link(old, key, None)
                else:
                    self._copy_link(old, key, new)

    def _copy_link(self, old: h5py.Group, key: str, new: h5py.Group | None) -> None:
        link = old.get(key, getlink=True)
        if isinstance(link, h5py.SoftLink):
            if new is not None:
                new[key] = link
            return
        item = old[key]
        address = h5py.h5o.get_info(item.id).addr
        if address in self._made:  # a hard link: step and time of every element
            if new is not None:
                new[key] = self._made[address]
            return
        made = item
        if isinstance(item, h5py.Dataset):
            if new is None:
                self._check(item)
            else:
                made = _like(item, new, key, self._kept(item))
        elif new is not None:
            made = new.create_group(key)
        self._made[address] = made
        self._copy(item, None if new is None else made)


def _like(item: h5py.Dataset, new: h5py.Group, name: str, rows: NDArray[np.intp] | None) -> h5py.Dataset:
    """An equal dataset (type, chunks, filters, sources of a view) with the kept rows."""
    shape = item.shape if rows is None else (len(rows), *item.shape[1:])
    limits = tuple(h5py.h5s.UNLIMITED if one is None else one for one in item.maxshape)
    space = h5py.h5s.create_simple(shape, limits) if shape else item.id.get_space()
    made = h5py.Dataset(
        h5py.h5d.create(new.id, name.encode(), item.id.get_type(), space, item.id.get_create_plist())
    )
    if item.is_virtual:
        return made
    if rows is None:
        made[()] = item[()]
        return made
    block = max(1, BLOCK // max(1, int(np.prod(shape[1:]))))
    first = 0
    for run in np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1):
        for some in np.split(run, range(block, len(run), block)):
            if len(some):
                made[first : first + len(some)] = item[int(some[0]) : int(some[-1]) + 1]
                first += len(some)
    return made


@contextmanager
def _openable(path: Path, say: Callable[[str], object]) -> Iterator[tuple[Path, int | None]]:
    """A file that HDF5 opens: the given one, or a copy whose missing end is filled up; and how much of it is real."""
    try:
        with h5py.File(path, "r"):
            told = None
    except BlockingIOError:
        raise InputError(f"{path}: a run is writing it; what it has committed can be read as it is") from None
    except OSError as error:
        if error.errno:
            raise InputError(f"{path} cannot be read: {os.strerror(error.errno)}") from error
        if not h5py.is_hdf5(path):
            raise InputError(
                f"{path} is not an HDF5 file, or its very beginning is lost: nothing can be kept{_otherwise(path)}"
            ) from error
        told = re.search(r"truncated file: eof = (\d+).*stored_eof = (\d+)", str(error))
        if told is None:
            raise InputError(
                f"{path}: HDF5 cannot open it ({error}): nothing can be kept by this program; `h5clear -s` of the HDF5 "
                f"tools helps if only a flag was left set{_otherwise(path)}"
            ) from error
    if told is None:
        yield path, None
        return
    present, meant = int(told[1]), int(told[2])
    say(f"  its end is missing: {present} of {meant} bytes are there")
    filled = files.create(path)
    try:
        try:
            shutil.copyfile(path, filled)
            os.truncate(filled, meant)
            h5py.File(filled, "r", locking=False).close()
        except OSError as error:
            raise InputError(
                f"{path}: HDF5 cannot open it, even with its end filled up ({error}): nothing can be kept"
                f"{_otherwise(path)}"
            ) from error
        yield filled, present
    finally:
        filled.unlink(missing_ok=True)


def _numbers(frames: NDArray[np.intp]) -> str:
    if len(frames) == 1:
        return f"frame {frames[0]}"
    some = ", ".join(map(str, frames[:8])) + (", ..." if len(frames) > 8 else "")
    return f"{len(frames)} frames ({some})"


def _otherwise(path: Path) -> str:
    """Where else the run may be continued from."""
    checkpoint = checkpoint_of(path)
    if checkpoint.exists():
        return f"; {checkpoint.name} holds a state from which the run can go on"
    return "; there is no checkpoint beside it: the run must be made again"


def stale_views(place: Path) -> tuple[Path, ...]:
    """Views beside a file that are not there, or older than it."""
    return tuple(
        each
        for each in view_paths(place)
        if not each.exists() or each.stat().st_mtime_ns < place.stat().st_mtime_ns
    )
