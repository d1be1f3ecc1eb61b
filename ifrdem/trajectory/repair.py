"""Making a trajectory that opens out of one that was damaged, by a copy of what is whole.

HDF5 notices damage of its own bookkeeping, of compressed chunks (deflate has a checksum), and a missing end of the
file. Numbers that were changed in uncompressed data look like other numbers: nothing here finds them.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..run.outputs import check_apart, not_a_file
from . import damage, history, layout
from .damage import DamageError
from .reader import Trajectory
from .views import paths as view_paths

_TROUBLE = (OSError, RuntimeError, KeyError, ValueError)  # what h5py raises for damaged parts


@dataclass
class Finding:
    """What is wrong with a file, and what of it is whole.

    Attributes
    ----------
    wrong : list of str
        A line for each thing; empty if nothing is.
    frames : array
        Numbers of the frames that are whole.
    committed : int
        Frames that the file says it has.
    rows : int
        Rows of the series that are whole: those before the first damaged one.
    events : int
        Events of histories that are whole, likewise.
    lost : set of str
        Names of datasets that cannot be kept.
    """

    wrong: list[str] = field(default_factory=list)
    frames: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    committed: int = 0
    rows: int = 0
    events: int = 0
    lost: set[str] = field(default_factory=set)


def examine(path: Path, *, whole: int | None = None) -> Finding:
    """Look at every frame, row and event of a file that HDF5 can open.

    Parameters
    ----------
    path : Path
    whole : int, optional
        Bytes of the file that are its own; what lies behind was filled up with zeros.

    Raises
    ------
    InputError
        If it is no trajectory of ours, or so damaged that nothing can be kept.
    """
    found = Finding()
    try:
        with h5py.File(path, "r", locking=False) as file:
            _examine_frames(file, path, found, whole)
            _examine_series(file, found, whole)
            _examine_histories(file, found, whole)
    except _TROUBLE as error:
        if isinstance(error, InputError):
            raise
        raise DamageError(f"{path}: its bookkeeping is damaged ({error}): nothing can be kept") from error
    return found


def _examine_frames(file: h5py.File, path: Path, found: Finding, whole: int | None) -> None:
    needed = [f"{layout.EDGES}/{name}" for name in ("step", "time", "value")]
    needed += [f"{layout.PARTICLES}/{name}" for name in layout.STATIC] + ["h5md/modules/ifrdem", "parameters"]
    missing = [name for name in needed if name not in file]
    if missing:
        raise InputError(f"{path} cannot be made a trajectory of ifrdem: {', '.join(missing)} is missing")
    for name in layout.STATIC:
        if not _readable(file[f"{layout.PARTICLES}/{name}"], (), whole):
            raise DamageError(
                f"{path}: {layout.PARTICLES}/{name} cannot be read: nothing can be kept without it"
            )
    found.committed = len(file[f"{layout.EDGES}/step"])
    good = np.ones(found.committed, dtype=bool)
    names = [f"{layout.EDGES}/{name}" for name in ("step", "time", "value")]
    names += [layout.field_dataset(file, name).name.lstrip("/") for name in layout.stored_fields(file)]
    for name in names:
        dataset = file[name]
        readable = np.array(
            [_readable(dataset, i, whole) for i in range(min(len(dataset), found.committed))], bool
        )
        readable = np.append(readable, np.zeros(found.committed - len(readable), dtype=bool))
        if not readable.all():
            some = np.flatnonzero(~readable)
            found.wrong.append(f"{name}: {_frames(some)} cannot be read")
        good &= readable
        if len(dataset) > found.committed:
            found.wrong.append(f"{name}: {len(dataset) - found.committed} uncommitted behind the last frame")
    found.frames = np.flatnonzero(good)
    if "observables" not in file:
        found.wrong.append("observables: missing; the copy has none")
        return
    for name in file["observables"]:
        dataset = file[f"observables/{name}/value"]
        if len(dataset) < found.committed or not _readable(dataset, slice(0, found.committed), whole):
            found.wrong.append(f"observables/{name}: cannot be read; the copy lacks it")
            found.lost.add(f"observables/{name}")


def _examine_series(file: h5py.File, found: Finding, whole: int | None) -> None:
    if "timeseries" not in file:
        return
    group = file["timeseries"]
    rows = found.rows = len(group["step"])
    for name in ["step", "time", *(f"{one}/value" for one in group if isinstance(group[one], h5py.Group))]:
        dataset = group[name]
        found.rows = min(found.rows, _leading(dataset, rows, whole))
        if len(dataset) > rows:
            found.wrong.append(f"timeseries/{name}: {len(dataset) - rows} uncommitted behind the last row")
    if found.rows < rows:
        found.wrong.append(f"timeseries: only the first {found.rows} of {rows} rows can be read")


def _examine_histories(file: h5py.File, found: Finding, whole: int | None) -> None:
    if history.GROUP not in file:
        return
    group = file[history.GROUP]
    for name in ("tracked", *(f"start/{name}" for name in ("time", "position", "velocity", "spin", "image"))):
        if not _readable(group[name], (), whole):
            found.wrong.append(f"{history.GROUP}/{name}: cannot be read; the copy has no histories")
            found.lost.add(history.GROUP)
            return
    count, _ = history.committed(file)
    found.events = count
    for name in group["events"]:
        dataset = group[f"events/{name}"]
        found.events = min(found.events, _leading(dataset, count, whole))
        if len(dataset) > count:
            found.wrong.append(
                f"{history.GROUP}/events/{name}: {len(dataset) - count} uncommitted behind the last event"
            )
    if found.events < count:
        found.wrong.append(f"{history.GROUP}: only the first {found.events} of {count} events can be read")


def _leading(dataset: h5py.Dataset, rows: int, whole: int | None) -> int:
    """How many of the first rows can be read, in whole chunks."""
    step = dataset.chunks[0] if dataset.chunks else max(rows, 1)
    rows = min(rows, len(dataset))
    for first in range(0, rows, step):
        if not _readable(dataset, slice(first, min(first + step, rows)), whole):
            return first
    return rows


def _readable(dataset: h5py.Dataset, selection: object, whole: int | None) -> bool:
    try:
        damage.read(dataset, selection)
        return whole is None or _inside(dataset, selection, whole)
    except DamageError:
        return False


def _inside(dataset: h5py.Dataset, selection: object, whole: int) -> bool:
    """Whether what is stored of the selected rows lies within so many bytes of the file."""
    if dataset.chunks is None:
        offset = dataset.id.get_offset()
        return offset is None or offset + dataset.id.get_storage_size() <= whole
    if isinstance(selection, slice):
        first, last = selection.start, selection.stop
    else:
        first, last = (selection, selection + 1) if isinstance(selection, int) else (0, len(dataset))
    for i in range(dataset.id.get_num_chunks()):
        chunk = dataset.id.get_chunk_info(i)
        wanted = chunk.chunk_offset[0] < last and chunk.chunk_offset[0] + dataset.chunks[0] > first
        if wanted and chunk.byte_offset + chunk.size > whole:
            return False
    return True


def _frames(numbers: NDArray[np.intp]) -> str:
    if len(numbers) == 1:
        return f"frame {numbers[0]}"
    some = ", ".join(map(str, numbers[:8])) + (", ..." if len(numbers) > 8 else "")
    return f"{len(numbers)} frames ({some})"


def repair(path: Path, place: Path, *, say: Callable[[str], object] = print) -> bool:
    """Write what is whole of a trajectory to a new file; False if nothing is wrong, and nothing was written.

    Frames that can be read are kept, also behind damaged ones, with the numbers (`step`) that they had. Series and
    histories end before their first damaged part.

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
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    if path.is_dir():
        raise InputError(f"{path} is a folder: a trajectory file is needed")
    if not path.is_file():  # HDF5 would wait for a pipe for ever
        raise InputError(f"{path} is a device or pipe: a trajectory file is needed")
    if place != path:
        check_apart(place, path)
    if special := not_a_file(place):
        raise InputError(special)
    source, whole = _openable(path, say)
    aside = place.with_name(f".{place.name[:100]}.{os.getpid()}.part")
    try:
        found = examine(source, whole=whole)
        for line in found.wrong:
            say(f"  {line}")
        if not found.wrong and whole is None:
            return False
        if len(found.frames) == 0:
            raise InputError(
                f"{path}: no frame of {found.committed} is whole: nothing can be kept{_beside(path)}"
            )
        _copy(source, aside, found)
        with Trajectory(aside) as copy:  # it must open, and give every frame
            for frame in copy:
                for name in copy.fields:
                    frame[name]
        os.replace(aside, place)
    except OSError as error:
        raise InputError(f"output {place}: cannot be written: {error.strerror or error}") from error
    finally:
        aside.unlink(missing_ok=True)
        if source != path:
            source.unlink(missing_ok=True)
    say(f"  {len(found.frames)} of {found.committed} frames are kept")
    return True


def _openable(path: Path, say: Callable[[str], object]) -> tuple[Path, int | None]:
    """A file that HDF5 opens: the given one, or a copy whose missing end is filled up; and how much of it is real."""
    try:
        with h5py.File(path, "r"):
            return path, None
    except BlockingIOError:
        raise InputError(f"{path}: a run is writing it; what it has committed can be read as it is") from None
    except OSError as error:
        if error.errno:
            raise InputError(f"{path} cannot be read: {os.strerror(error.errno)}") from error
        if not h5py.is_hdf5(path):
            raise InputError(
                f"{path} is not an HDF5 file, or its very beginning is lost: nothing can be kept{_beside(path)}"
            ) from error
        told = re.search(r"truncated file: eof = (\d+).*stored_eof = (\d+)", str(error))
        if told is None:
            raise InputError(
                f"{path}: HDF5 cannot open it ({error}): nothing can be kept by this program; `h5clear -s` of the HDF5 "
                f"tools helps if only a flag was left set{_beside(path)}"
            ) from error
    present, meant = int(told[1]), int(told[2])
    say(f"  its end is missing: {present} of {meant} bytes are there")
    filled = path.with_name(f".{path.name[:100]}.{os.getpid()}.filled")
    try:
        shutil.copyfile(path, filled)
        os.truncate(filled, meant)
        with h5py.File(filled, "r", locking=False):
            return filled, present
    except OSError as error:
        filled.unlink(missing_ok=True)
        raise InputError(
            f"{path}: HDF5 cannot open it, even with its end filled up ({error}): nothing can be kept{_beside(path)}"
        ) from error


def _beside(path: Path) -> str:
    """Where else the run may be continued from."""
    checkpoint = path.with_name(f"{path.name.removesuffix('.h5')}.checkpoint.h5")
    if checkpoint.exists():
        return f"; {checkpoint.name} holds a state from which the run can go on"
    return "; there is no checkpoint beside it: the run must be made again"


def _copy(source: Path, target: Path, found: Finding) -> None:
    """Copy what is whole, dataset by dataset."""
    with h5py.File(source, "r", locking=False) as old, h5py.File(target, "w") as new:
        _copy_group(old, new, found, {})


def _copy_group(old: h5py.Group, new: h5py.Group, found: Finding, made: dict[int, h5py.Dataset]) -> None:
    for key, value in old.attrs.items():
        new.attrs[key] = value
    for name, item in old.items():
        if item.name.lstrip("/") in found.lost:
            continue
        if isinstance(item, h5py.Group):
            _copy_group(item, new.create_group(name), found, made)
            continue
        address = h5py.h5o.get_info(item.id).addr
        if address in made:  # a hard link: step and time of every element
            new[name] = made[address]
        else:
            made[address] = _copy_dataset(item, new, name, _rows(item, found))


def _rows(item: h5py.Dataset, found: Finding) -> NDArray[np.intp] | None:
    """Which rows of a dataset are kept; None if it has no axis that grows, or is a view."""
    parts = item.name.strip("/").split("/")
    if item.is_virtual or item.maxshape is None or not item.maxshape or item.maxshape[0] is not None:
        return None
    if parts[0] == "timeseries":
        return np.arange(found.rows)
    if parts[:2] == [history.GROUP, "events"]:
        return np.arange(found.events)
    if parts[:2] == [history.GROUP, "committed"]:
        events = item.parent["events"][()]
        return np.flatnonzero(events <= found.events)
    return found.frames


def _copy_dataset(
    item: h5py.Dataset, new: h5py.Group, name: str, rows: NDArray[np.intp] | None
) -> h5py.Dataset:
    """An equal dataset (type, chunks, filters, sources of a view) with the kept rows."""
    settings = item.id.get_create_plist()
    shape = item.shape if rows is None else (len(rows), *item.shape[1:])
    space = item.id.get_space() if item.shape == () else h5py.h5s.create_simple(shape, _limits(item))
    made = h5py.Dataset(h5py.h5d.create(new.id, name.encode(), item.id.get_type(), space, settings))
    for key, value in item.attrs.items():
        made.attrs[key] = value
    if item.is_virtual:
        return made
    if rows is None:
        made[()] = item[()]
        return made
    block = max(1, min(len(rows), (1 << 22) // max(1, int(np.prod(shape[1:])))))
    for first in range(0, len(rows), block):
        some = rows[first : first + block]
        if len(some) and some[-1] - some[0] == len(some) - 1:
            made[first : first + len(some)] = item[int(some[0]) : int(some[-1]) + 1]
        else:
            for i, row in enumerate(some):
                made[first + i] = item[int(row)]
    return made


def _limits(item: h5py.Dataset) -> tuple[int, ...]:
    return tuple(h5py.h5s.UNLIMITED if one is None else one for one in item.maxshape)


def stale_views(place: Path) -> tuple[Path, ...]:
    """Views beside a file that are not there, or older than it."""
    return tuple(
        each
        for each in view_paths(place)
        if not each.exists() or each.stat().st_mtime_ns < place.stat().st_mtime_ns
    )
