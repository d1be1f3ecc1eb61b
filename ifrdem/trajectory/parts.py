"""Parts of a trajectory: NAME.h5, and files NAME.parts/0000.h5, 0001.h5, ..., with the fields of some disks each.

A gas on several ranks of MPI is written by all of them. Each part is a trajectory of its own, of the disks with
consecutive numbers that one rank had when the file was created. NAME.h5 has what belongs to all disks (box, record,
series, observables, times and steps of frames); its datasets with a row for each disk are virtual ones of HDF5, which
show the rows of the parts, by relative names: NAME.h5 and the folder are moved together. Where a part is missing, HDF5
gives nan for floats and -2147483648 for counts.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..errors import DamageError, InputError
from ..tools import files
from . import damage

FOLDER = ".parts"
"""Ending of the folder with the parts, NAME.parts for NAME.h5."""
GROUP, PART = "parts", "part"
"""Groups that describe the parts in NAME.h5, and in a part its number."""
ZEROS = f"{GROUP}/zeros"
"""Group with the z of vectors: numbers that are never written read as 0 and take no room."""
SEE = "; `ifrdem repair` lists all parts"


class MissingPart(DamageError):
    """A part that is not there, cannot be opened, or is another one."""


class ShortPart(DamageError):
    """A part that holds fewer frames than NAME.h5 counts."""


def folder_of(path: str | os.PathLike[str]) -> Path:
    """Folder with the parts of a trajectory."""
    whole = Path(path)
    return whole.with_name(whole.name.removesuffix(".h5") + FOLDER)


def nothing(dtype: DTypeLike) -> float | int:
    """Fill value of a type of numbers where data are missing: nan, or the lowest whole number."""
    kind: np.dtype[Any] = np.dtype(dtype)
    return float("nan") if kind.kind == "f" else int(np.iinfo(kind).min)


def as_source(name: str) -> str:
    """The name of a file as a virtual dataset takes it: HDF5 reads "%%" there as "%", and "%b" as a number."""
    return name.replace("%", "%%")


@dataclass(frozen=True)
class Parts:
    """All parts of a trajectory.

    Attributes
    ----------
    folder : str
        Name of their folder, next to NAME.h5.
    run : str
        Mark of the run, which all parts bear.
    first : tuple of int
        Number of the first disk of each part; the number of all disks comes last.
    """

    folder: str
    run: str
    first: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.first) < 2 or self.first[0] != 0 or any(np.diff(self.first) <= 0):
            raise InputError(f"parts begin with the disks {self.first}: must increase, from 0 on")

    def __len__(self) -> int:
        """Number of parts."""
        return len(self.first) - 1

    @property
    def n(self) -> int:
        """Number of all disks."""
        return self.first[-1]

    def disks(self, number: int) -> slice:
        """Numbers of a part's disks."""
        return slice(self.first[number], self.first[number + 1])

    def name(self, number: int) -> str:
        """Path of a part, from the folder that NAME.h5 is in."""
        return f"{self.folder}/{number:04d}.h5"

    def part(self, number: int) -> Part:
        """Mark of a part."""
        return Part(self.run, number, self.first[number])

    def described(self, number: int) -> str:
        """A part and its disks, for messages."""
        return f"part {self.name(number)} (disks {self.first[number]} to {self.first[number + 1] - 1})"

    def write(self, file: h5py.File) -> None:
        """Write the description of the parts into NAME.h5."""
        group = file.create_group(GROUP)
        # Texts of fixed length: HDF5 may loop for ever in a damaged heap, which holds the others.
        group.attrs["folder"], group.attrs["run"] = np.bytes_(self.folder.encode()), np.bytes_(self.run)
        group["first"] = np.array(self.first, dtype=np.int64)

    def show(
        self,
        group: h5py.Group,
        name: str,
        source: str,
        tail: tuple[int, ...],
        dtype: DTypeLike,
        *,
        frames: bool,
    ) -> None:
        """Make a virtual dataset `name` of the rows that the parts have in theirs at `source`.

        `tail` is the shape of a disk's values; `frames` comes before the disks, without end. A vector's view, named
        `value`, has z = 0 in addition to the two stored numbers.
        """
        flat = frames and tail == (2,) and name == "value"
        before, ends = ((1,), (None,)) if frames else ((), ())
        row_shape = (3,) if flat else tail
        whole = h5py.VirtualLayout((*before, self.n, *row_shape), dtype, maxshape=(*ends, self.n, *row_shape))
        every = (slice(0, h5py.h5s.UNLIMITED),) if frames else ()
        for number in range(len(self)):
            rows = self.disks(number)
            count = rows.stop - rows.start
            one = h5py.VirtualSource(
                as_source(self.name(number)), source, shape=(*before, count, *tail), dtype=dtype,
                maxshape=(*ends, count, *tail),
            )  # fmt: skip
            columns = (slice(0, 2),) if flat else ()
            whole[(*every, rows, *columns)] = one[(*every, slice(None))] if frames else one
        if flat:
            zeros = self._zeros(group.file, dtype)
            one = h5py.VirtualSource(".", zeros, shape=(1, self.n), dtype=dtype, maxshape=(None, self.n))
            whole[(*every, slice(None), 2)] = one[(*every, slice(None))]
        group.create_virtual_dataset(name, whole, fillvalue=nothing(dtype))

    def _zeros(self, file: h5py.File, dtype: DTypeLike) -> str:
        kind: np.dtype[Any] = np.dtype(dtype)
        name = f"/{ZEROS}/{kind.str[1:]}"
        if name not in file:
            chunks = (1, min(self.n, 16384))
            file.create_dataset(name, shape=(0, self.n), maxshape=(None, self.n), chunks=chunks, dtype=kind)
        return name

    def path_of(self, path: str | os.PathLike[str], number: int) -> Path:
        """Path of a part of the trajectory at `path`."""
        return Path(os.path.realpath(path)).parent / self.name(number)

    def open(self, path: str | os.PathLike[str], number: int) -> h5py.File:
        """A part of the trajectory at `path`, to be read, also while its rank adds frames.

        Raises MissingPart that names it if it is missing, cannot be read, or is not this part of this run.
        """
        part_path, what = self.path_of(path, number), f"{os.fspath(path)}: its {self.described(number)}"
        if not os.path.exists(part_path):
            raise MissingPart(f"{what} is missing{SEE}")
        if not os.path.isfile(part_path):
            raise MissingPart(f"{what} is not a file{SEE}")
        try:
            try:
                file = h5py.File(part_path, "r")
            except OSError:  # its rank writes it, or HDF5 has opened it so for a virtual dataset
                file = h5py.File(part_path, "r", locking=False)
        except OSError as error:
            damage.check_system(error, part_path)
            raise MissingPart(f"{what} cannot be opened: {error}{SEE}") from error
        try:
            found = Part.of(file)
        except (InputError, *damage.FAULTS) as error:
            file.close()
            damage.check_system(error, part_path)
            raise MissingPart(f"{what} does not say which part it is: {error}{SEE}") from error
        if found != self.part(number):
            file.close()
            other = f"it is part {found.number}" if found.run == self.run else "it belongs to another run"
            raise MissingPart(f"{what} is not that part of this run: {other}{SEE}")
        return file

    def check(self, path: str | os.PathLike[str]) -> None:
        """Raise MissingPart as `open` unless all parts of the trajectory at `path` are there."""
        for number in range(len(self)):
            self.open(path, number).close()

    def read(
        self, path: str | os.PathLike[str], name: str, selection: Any = (), *, axis: int = 1
    ) -> NDArray[Any]:
        """Numbers of a dataset of all disks, which are along `axis` (0 or 1), as `damage.read` has them.

        Slices go forwards.

        Raises DamageError if a part is missing or wrong, or they cannot be read there; the message names it.
        """
        chosen = selection if isinstance(selection, tuple) else (selection,)
        chosen = (*chosen, *[slice(None)] * (axis + 1 - len(chosen)))
        before, disks, after = chosen[:axis], chosen[axis], chosen[axis + 1 :]
        one = not isinstance(disks, slice)
        selected, pieces = range(self.n)[slice(disks, disks + 1 or None) if one else disks], []
        for number in range(len(self)):
            own = self.disks(number)
            low, high = (
                min(max(-(-(end - selected.start) // selected.step), 0), len(selected))
                for end in (own.start, own.stop)
            )
            if low < high or not (selected or number):  # of no disks, the first part has their shape and type
                here = selected[low:high]
                rows = slice(here.start - own.start, here.stop - own.start, here.step)
                with self.open(path, number) as file:
                    pieces.append(damage.read(file[name], (*before, rows, *after)))
        along = sum(isinstance(each, slice) for each in before)
        found = np.concatenate(pieces, axis=along)
        return found.take(0, axis=along) if one else found


def first_of(file: h5py.File) -> int:
    """Number of the first disk of a file, which may be a part of a trajectory."""
    return int(file[PART].attrs["first"]) if PART in file else 0


@dataclass(frozen=True)
class Part:
    """Mark of one part: of which run, its number, its first disk, and numbers of disks of named species of the run."""

    run: str
    number: int
    first: int
    species: tuple[int, ...] = field(default=(), compare=False)

    def write(self, file: h5py.File) -> None:
        """Write the mark into the part."""
        group = file.create_group(PART)
        group.attrs["run"] = np.bytes_(self.run)
        group.attrs["number"], group.attrs["first"] = np.int64(self.number), np.int64(self.first)
        if self.species:
            group.attrs["species"] = np.array(self.species, dtype=np.int64)

    @classmethod
    def of(cls, file: h5py.File) -> Part:
        """That of an open file; one of those of `damage.FAULTS` if it has none."""
        if GROUP in file:
            raise ValueError("it is in parts itself")
        given = file[PART].attrs
        species = tuple(int(one) for one in np.ravel(given.get("species", ())))
        return cls(given["run"].decode(), int(given["number"]), int(given["first"]), species)


def of(file: h5py.File, path: str | os.PathLike[str] = "") -> Parts | None:
    """The parts that a file is in; None if it holds its own data.

    Raises DamageError if what it says of them cannot be.
    """
    if GROUP not in file:
        return None
    with damage.as_damage_error(path or file.filename, GROUP):
        group = file[GROUP]
        folder, run = group.attrs["folder"].decode(), group.attrs["run"].decode()
        if not re.fullmatch(r"[^/\\]*" + re.escape(FOLDER), folder):
            raise ValueError(f"{folder!r} is no folder next to it")
        first = damage.read(group["first"])
        damage.require_shape(group["first"], (None,), "i")
        return Parts(folder, run, tuple(int(one) for one in first))


def data_files(
    file: h5py.File, parts: Parts | None, path: str | os.PathLike[str], n: int
) -> Iterator[tuple[slice, h5py.File]]:
    """The files that hold the fields of n disks, open one after another, with numbers of the disks of each."""
    if parts is None:
        yield slice(0, n), file
        return
    for number in range(len(parts)):
        with parts.open(path, number) as part:
            yield parts.disks(number), part


def are_in(path: str | os.PathLike[str]) -> bool:
    """True if a file can be opened and its data are in parts."""
    try:
        with h5py.File(path, "r") as file:
            return GROUP in file
    except OSError:
        return False


def existing(path: str | os.PathLike[str]) -> list[Path]:
    """Existing parts in the folder of a trajectory's parts."""
    folder = folder_of(path)
    return sorted(each for each in folder.glob("*.h5") if re.fullmatch(r"\d{4,}\.h5", each.name))


def check_unused(path: str | os.PathLike[str]) -> None:
    """Refuse a trajectory that a process is writing, or a part of it: an InputError names the process."""
    for each in (Path(path), *existing(path)):
        if use := files.being_written(each):
            raise InputError(f"output {each}: {use}: wait for it or stop it first")


def remove(path: str | os.PathLike[str]) -> None:
    """Remove a trajectory that has parts, with them; one that has none stays.

    Raises InputError if a process is writing it.
    """
    found, folder = existing(path), folder_of(path)
    if not found:
        return
    check_unused(path)
    Path(path).unlink(missing_ok=True)
    for each in found:
        each.unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()
