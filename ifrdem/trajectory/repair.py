"""Repair of a damaged trajectory: a valid copy of the parts that can be read.

HDF5 notices damage of its own bookkeeping, of compressed chunks (deflate has a checksum), and a missing end of the
file. Numbers that were changed in uncompressed data look like other numbers: nothing here finds them.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import DamageError, InputError, ReadError, option_name
from ..model.state import Disks
from ..tools import files
from ..tools.files import check_apart, checkpoint_of, not_a_file
from . import damage, history, layout
from . import parts as part_files
from .file import ON_PAGES, NewFile, new_file
from .parts import Parts
from .reader import Trajectory, check_file
from .reader import _box as box_of

BLOCK = 1 << 22  # numbers that are copied at once


def repair(path: Path, output: Path, *, log: Callable[[str], object] = print) -> bool:
    """Write what can be read of a trajectory to a new file; False if nothing is wrong, and nothing was written.

    Frames that can be read are kept, also after damaged ones, with the numbers (`step`) that they had. Series and
    histories end before their first damaged part. The new file is of the present layout; what others added to the old
    one is not in it. Either answer is given only after the file, or its copy, was opened
    and read to its end.

    Raises InputError if nothing can be kept: the message says why and what can be done; or if either is a folder or a
    device.

    Parameters
    ----------
    path : Path
        The file; it is not changed unless it is `output`.
    output : Path
        Where to write: whole or not at all. `path` itself replaces it; a link or another name of it is refused.
    log : callable
        Called with lines of text on the damage.
    """
    check_file(path)
    if output != path:
        check_apart(output, path)
    if special := not_a_file(output):
        raise InputError(special)
    with _openable(path, output, log) as (source, whole), h5py.File(source, "r") as file:
        if output == path and part_files.GROUP in file:
            how = option_name("--in-place cannot merge them; use -o to", "output must be another file, to")
            raise InputError(f"{path} is in parts: {how} write one file")
        try:
            with damage.as_damage_error(path, "its bookkeeping"):
                kept = _Salvage(file, path, whole, log)
        except DamageError as error:  # no ReadError: the drive may read it again
            raise _unrepairable(path, error) from error
        if not kept.damaged and whole is None:
            try:
                _read_through(path)
                return False
            except ReadError:
                raise
            except InputError as error:
                log(f"  {error}")
        try:
            with files.replacing(output) as new:
                with new_file(new, **ON_PAGES) as copy:
                    kept.write(copy)
                _read_through(new)
        except ReadError:
            raise
        except InputError as error:
            raise _unrepairable(path, error, new) from error
        except OSError as error:
            raise InputError(f"output {output}: cannot be written: {files.cause(error)}") from error
    log(f"  {len(kept.frames)} of {kept.committed} frames are kept")
    return True


def write_whole(trajectory: Trajectory, output: Path, frames: Iterable[int]) -> None:
    """Copy frames, series and histories of a trajectory, which may be in parts, to one file.

    Raises InputError if something cannot be read.
    """
    kept = _Salvage(trajectory.file, trajectory.path, None, lambda _: None)
    kept.frames = kept.frames[np.isin(kept.frames, list(frames))]
    with new_file(output, **ON_PAGES) as new:
        kept.write(new, part=False)


def _unrepairable(path: Path, error: InputError, copy: Path | None = None) -> DamageError:
    reason = str(error).removesuffix(damage.HINT)
    if copy is not None:
        reason = reason.replace(str(copy), "its copy")
    return DamageError(f"{path}: nothing can be kept ({reason}){_alternatives(path)}")


def _read_through(path: Path) -> None:
    """Open a trajectory and read all of it; raise InputError if something cannot be read."""
    with Trajectory(path) as trajectory:
        for frame in trajectory:
            for name in trajectory.fields:
                frame[name]
        for series in (trajectory.observables, trajectory.series):
            for name in series:
                series[name]
        for disk in trajectory.tracked[:1]:
            trajectory.history(int(disk))


class _Salvage:
    """The readable part of a trajectory; `write` makes a trajectory of it.

    Attributes
    ----------
    wrong : bool
        Whether anything cannot be read, or is not committed.
    committed : int
        Number of frames that the file says it has.
    frames : array
        Numbers of those that can be read.
    """

    def __init__(self, file: h5py.File, path: Path, whole: int | None, log: Callable[[str], object]) -> None:
        self._parts = part_files.of(file, path)
        damage.check_links(file, str(path), layout.views_of(self._parts))
        self.damaged = False
        self._file, self._path, self._whole, self._log = file, path, whole, log
        clock = layout.clock(file)
        times = [f"{clock}/{name}" for name in ("step", "time")]
        static = [f"{layout.PARTICLES}/{name}" for name in layout.STATIC]
        missing = [one for one in (*times, *static, "h5md/modules/ifrdem", "parameters") if one not in file]
        if missing:
            raise InputError(f"{path} cannot be made a trajectory of ifrdem: {', '.join(missing)} is missing")
        steps, self.committed = (len(file[name]) for name in times)
        if steps <= self.committed:
            self.committed = steps  # times may lie ahead of the step that commits them
        else:  # a damaged length may be any number
            self._note(f"{times[0]}: {steps} frames, of which {self.committed} have a time")
        self._fields = layout.stored_fields(file)
        self._n = len(file[static[0]]) if self._parts is None else self._parts.n
        good = np.ones(self.committed, dtype=bool)
        self._scan(file, times, good)
        if self._parts is not None:
            self._scan_parts(self._parts)
        columns: dict[str, list[NDArray[Any]]] = {name: [] for name in layout.STATIC}
        for own, held in part_files.data_files(file, self._parts, path, self._n):
            layout.load_compression(held, str(path))
            fields = [layout.field_dataset(held, name) for name in self._fields]
            self._dtypes = [field.dtype for field in fields]
            self._compression = next((damage.compression(field) for field in fields), None) or "none"
            self._scan(held, [field.name for field in fields], good, own)
            good[len(held[times[0]]) :] = False  # of a part that is too short
            for name, found in columns.items():
                found.append(self._all_of(held[f"{layout.PARTICLES}/{name}"]))
        if part_files.PART in file:  # whose frames have the places that they have in the others
            good[np.argmin(good) if not good.all() else len(good) :] = False
        self.frames = np.flatnonzero(good)
        if len(self.frames) == 0:
            none = f"no frame of {self.committed} is whole: nothing can be kept"
            raise InputError(f"{path}: {none}{_alternatives(path)}")
        every: dict[str, Any] = {name: np.concatenate(found) for name, found in columns.items()}
        self._disks = Disks(self._n, **every)
        self._box = box_of(file[f"{layout.PARTICLES}/box"].attrs)
        self._parameters: dict[str, str | int | float] = {}
        names: list[bytes | str] = []
        file["parameters"].visit(names.append)
        for each in names:
            with self._noting_loss(f"parameters/{damage.text_of(each)}"):
                if isinstance(item := file["parameters"][each], h5py.Dataset):
                    self._parameters[damage.text_of(each)] = damage.parameter(item)
        self._observables: dict[str, h5py.Dataset] = {}
        if "observables" not in file:
            self._note("observables: missing; the copy has none")
        for name in file.get("observables", ()):
            with self._noting_loss(f"observables/{damage.text_of(name)}"):
                dataset = file["observables"][name]["value"]
                if not self._readable_rows(dataset, self.committed)[self.frames].all():
                    raise DamageError(f"{path} is damaged: {dataset.name}")
                self._observables[damage.text_of(name)] = dataset
        self._cut: dict[str, dict[str, int]] = {}  # groups that are copied, and the rows of their datasets
        if layout.TIMESERIES in file:
            with self._noting_loss(layout.TIMESERIES):
                group = file[layout.TIMESERIES]
                series = [name for name in group if name not in ("step", "time")]
                for name in series:
                    "".join(map(damage.text_of, group[name].attrs.get("columns", ()))).encode()
                rows = ["step", "time", *(f"{name}/value" for name in series)]
                self._cut[layout.TIMESERIES] = self._readable_rows_of_all(
                    group, rows, len(group["step"]), "row"
                )
        if history.GROUP in file:
            with self._noting_loss(history.GROUP):
                group = file[history.GROUP]
                for one in (group["tracked"], *group["start"].values()):
                    self._all_of(one)
                events = [f"events/{name}" for name in group["events"]]
                cut = self._readable_rows_of_all(
                    group, events, history.committed(file, str(path))[0], "event"
                )
                commits = int(np.count_nonzero(damage.read(group["committed/events"]) <= min(cut.values())))
                if not commits:
                    raise DamageError(f"{path} is damaged: no commit of its histories is whole")
                cut |= {"committed/events": commits, "committed/time": commits}
                self._cut[history.GROUP] = cut

    def write(self, new: NewFile, *, part: bool = True) -> None:
        """Write a new trajectory with what is kept; of a part another such `part`, if not a plain file."""
        old = self._file
        within = part_files.Part.of(old) if part and part_files.PART in old else None
        double = next((dtype for dtype in self._dtypes if dtype.kind == "f"), None) == np.float64
        parameters = dict(self._parameters)
        units = {
            name: str(parameters.pop(name)) for name in self._parameters if name.partition("/")[0] == "units"
        }
        layout.create(
            new, disks=self._disks, box=self._box, fields=self._fields, precision="f64" if double else "f32",
            compression=self._compression, within=within, parameters=parameters,
            units={name.removeprefix("units/"): unit for name, unit in units.items()},
        )  # fmt: skip
        clock = new[layout.clock(new)]
        for name in ("step", "time"):
            _append(new, clock[name], old[f"{layout.clock(old)}/{name}"], self.frames)
        if "value" in clock:  # older layouts had other edges
            clock["value"].resize(len(self.frames), axis=0)
            clock["value"][:] = np.stack([self._box.cell(time) for time in clock["time"][()].tolist()])
        for own, one in part_files.data_files(old, self._parts, self._path, self._n):
            for name in self._fields:
                field = layout.field_dataset(one, name)
                _append(new, layout.field_dataset(new, name), field, self.frames, (own,))
        for name, dataset in self._observables.items():
            sample = np.empty(dataset.shape[1:], dataset.dtype)
            _append(new, layout.add_observable(new, name, sample), dataset, self.frames)
        for name, cut in self._cut.items():
            with damage.as_damage_error(self._path, name):
                old.copy(name, new)
            new.check()
            for dataset, rows in cut.items():
                held = new[name][dataset]
                if held.chunks is not None:
                    held.resize(rows, axis=0)
                elif len(held) != rows:  # of another program: it cannot be resized
                    values = held[:rows]
                    del new[name][dataset]
                    new[name].create_dataset(dataset, data=values)

    def _scan(
        self, file: h5py.File, names: Sequence[str], good: NDArray[np.bool_], own: slice | None = None
    ) -> None:
        """Note frames that cannot be read in some datasets; with disks (`own`), of another number of these."""
        part = "" if file is self._file else f"{self._path.parent.joinpath(file.filename).name}: "
        for dataset in (file[name] for name in names):
            name = part + dataset.name[1:]
            if own is not None and dataset.shape[1] != own.stop - own.start:
                raise DamageError(
                    f"{self._path} is damaged: {name} has {dataset.shape[1]} disks instead of {own.stop - own.start}"
                )
            here = self._readable_rows(dataset, self.committed, 1)
            if not here.all():
                self._note(f"{name}: {_numbers(np.flatnonzero(~here))} cannot be read")
            self._past_end(name, dataset, self.committed, "frame")
            good &= here

    def _scan_parts(self, parts: Parts) -> None:
        """Note each part that is missing or wrong; InputError if one cannot be used at all."""
        unusable = 0
        for number in range(len(parts)):
            try:
                parts.open(self._path, number).close()
                layout.check_part(self._file, str(self._path), parts, number)
            except DamageError as error:
                self._note(str(error).removeprefix(f"{self._path}: its ").removesuffix(part_files.SEE))
                unusable += not isinstance(error, part_files.ShortPart)
        if unusable:
            raise InputError(
                f"{self._path}: {unusable} of its {len(parts)} parts cannot be used: no frame is whole. Put them back "
                "to their places; each of them is a trajectory of its own disks, which `ifrdem repair` can mend"
            )

    def _note(self, text: str) -> None:
        self.damaged = True
        self._log(f"  {text}")

    def _past_end(self, name: str, dataset: h5py.Dataset, rows: int, unit: str) -> None:
        if len(dataset) > rows:
            self._note(f"{name}: {len(dataset) - rows} uncommitted after the last {unit}")

    @contextmanager
    def _noting_loss(self, name: str) -> Iterator[None]:
        """Note that a part is lost if it cannot be read."""
        try:
            with damage.as_damage_error(self._path, name):
                yield
        except DamageError:
            self._note(f"{name}: cannot be read; the copy lacks it")

    def _all_of(self, dataset: h5py.Dataset) -> NDArray[Any]:
        """All numbers of a dataset; DamageError if some are past the end of the file."""
        if dataset.shape and self._rows_past_end(dataset, len(dataset)).any():
            raise DamageError(f"{self._path} is damaged: {dataset.name} is past its end")
        return damage.read(dataset)

    def _readable_rows(self, dataset: h5py.Dataset, rows: int, step: int = 0) -> NDArray[np.bool_]:
        """Mask of the readable rows, checked in steps of whole chunks; of frames and times, finite ones."""
        finite = step == 1 or str(dataset.name).endswith("/time")
        good = np.zeros(rows, dtype=bool)
        step = step or (dataset.chunks[0] if dataset.chunks else max(rows, 1))
        held = min(rows, len(dataset))
        for first in range(0, held, step):
            part = slice(first, min(first + step, held))
            with suppress(DamageError):
                value = damage.read(dataset, part)
                good[part] = not (finite and value.dtype.kind == "f") or np.isfinite(value).all()
        good[:held] &= ~self._rows_past_end(dataset, held)
        return good

    def _rows_past_end(self, dataset: h5py.Dataset, rows: int) -> NDArray[np.bool_]:
        """Mask of the first rows with data past the end of a truncated file."""
        lost = np.zeros(rows, dtype=bool)
        whole = self._whole
        if whole is None:
            return lost
        if dataset.chunks is None:
            offset = dataset.id.get_offset()
            lost[:] = offset is not None and offset + dataset.id.get_storage_size() > whole
            return lost

        def visit(chunk: h5py.h5d.StoreInfo) -> None:
            if chunk.byte_offset + chunk.size > whole:
                lost[chunk.chunk_offset[0] : chunk.chunk_offset[0] + dataset.chunks[0]] = True

        dataset.id.chunk_iter(visit)
        return lost

    def _readable_rows_of_all(
        self, group: h5py.Group, names: list[str], rows: int, unit: str
    ) -> dict[str, int]:
        """Rows of each of these datasets: those before the first that cannot be read in one of them."""
        kept, what = rows, str(group.name)[1:]
        for name in names:
            if group[name].chunks is None and rows:
                raise DamageError(f"{self._path} is damaged: {group[name].name} cannot grow")
            good = self._readable_rows(group[name], rows)
            kept = min(kept, rows if good.all() else int(np.argmin(good)))
            self._past_end(f"{what}/{name}", group[name], rows, unit)
        if kept < rows:
            self._note(f"{what}: only the first {kept} of {rows} {unit}s can be read")
        return dict.fromkeys(names, kept)


def _append(
    file: NewFile,
    new: h5py.Dataset,
    old: h5py.Dataset,
    rows: NDArray[np.intp],
    columns: tuple[slice, ...] = (),
) -> None:
    """Copy rows to a dataset of a file that has none, or none in these columns, some megabytes at a time."""
    new.resize(len(rows), axis=0)
    block, first = max(1, BLOCK // max(1, int(np.prod(old.shape[1:])))), 0
    for run in np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1):
        for some in np.split(run, range(block, len(run), block)):
            with damage.as_damage_error(old.file.filename, str(old.name)):
                values = old[int(some[0]) : int(some[-1]) + 1]
            new[(slice(first, first + len(some)), *columns)] = values
            del values  # before the next ones are there
            first += len(some)
            file.check()


@contextmanager
def _openable(path: Path, output: Path, log: Callable[[str], object]) -> Iterator[tuple[Path, int | None]]:
    """A file that HDF5 opens, and how much of it is real: the given one, or a copy whose missing end is filled up.

    The copy is next to the output, and is removed in the end.
    """
    try:
        with h5py.File(path, "r"):
            sizes = None
    except BlockingIOError:
        use = files.being_written(path) or "a run is writing it"
        raise InputError(f"{path}: {use}; its committed frames can be read meanwhile") from None
    except OSError as error:
        if error.errno:
            raise InputError(f"{path} cannot be read: {os.strerror(error.errno)}") from error
        if not h5py.is_hdf5(path):
            raise InputError(
                f"{path} is not an HDF5 file, or its beginning is lost: nothing can be kept{_alternatives(path)}"
            ) from error
        sizes = re.search(r"truncated file: eof = (\d+).*stored_eof = (\d+)", str(error))
        if sizes is None:
            raise InputError(
                f"{path}: HDF5 cannot open it ({error}): nothing can be kept by this program; `h5clear -s` of the HDF5 "
                f"tools helps if only a flag was left set{_alternatives(path)}"
            ) from error
    if sizes is None:
        yield path, None
        return
    present, meant = int(sizes[1]), int(sizes[2])
    log(f"  its end is missing: {present} of {meant} bytes are there")
    filled = None
    try:
        try:
            filled = files.create(output)
            shutil.copyfile(path, filled)
            os.truncate(filled, meant)
        except OSError as error:
            raise InputError(
                f"output {output}: a copy of {path} with its {meant} bytes, which has to be there for a while, "
                f"cannot be written: {files.cause(error)}"
            ) from error
        try:
            h5py.File(filled, "r", locking=False).close()
        except OSError as error:
            damage.check_system(error, filled)
            raise InputError(
                f"{path}: HDF5 cannot open it, even with its end filled up ({error}): nothing can be kept"
                f"{_alternatives(path)}"
            ) from error
        yield filled, present
    finally:
        if filled is not None:
            filled.unlink(missing_ok=True)


def _numbers(frames: NDArray[np.intp]) -> str:
    if len(frames) == 1:
        return f"frame {frames[0]}"
    some = ", ".join(map(str, frames[:8])) + (", ..." if len(frames) > 8 else "")
    return f"{len(frames)} frames ({some})"


def _alternatives(path: Path) -> str:
    """Other files from which the run may be resumed, as text."""
    checkpoint = checkpoint_of(path)
    if checkpoint.exists():
        return f"; {checkpoint.name} holds a state from which the run can be resumed"
    return "; there is no checkpoint in its folder: run the case again"
