"""Checkpoint files: arrays and a record, in double precision, written whole or not at all, by one rank or by all."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import itertools
import json
import logging
import os
import re
import secrets
from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ...errors import DamageError, InputError, option_name, shortened
from ...kernels.columns import named
from ...kernels.compiler import runtime
from ...model.state import COLUMNS, Disks, State
from ...mpi import current
from ...mpi.distribution import RowsByBlock, Table, pieces
from ...tools import checked, files
from ...tools.old_words import present_record
from ...tools.versions import package_versions, revision
from ...trajectory import damage
from ...trajectory.file import new_file

FORMAT = 11
OF_DISKS = (
    "disk", "meta", "past", "hits", "dissipated", "asleep", "held", "listed",
    "state_position", "state_velocity", "state_spin", *(f"disks_{name}" for name in COLUMNS),
)  # fmt: skip
"""Arrays with a row for each disk, in order of ids; and those of `before_...`, what disks had before the start."""
READ_LATER = OF_DISKS[: OF_DISKS.index("state_position")]
"""Those of them that are read while an engine is restored, not before it is made."""
NEW_RUN_HINT = '; begin a new run from a stored frame: start.positions = "NAME.h5"'
MANY = 1000
"""Equal numbers, such as radii of equal disks, more of which are compressed."""
LOG = logging.getLogger("ifrdem")
_KIND = "ifrdem checkpoint"


def write(path: str | os.PathLike[str], arrays: Mapping[str, Table], record: Mapping[str, Any]) -> None:
    """Write a checkpoint, arrays by name and a `record` for JSON, to a temporary file that is synced, then renamed.

    An existing file is replaced, with its parts. InputError if it cannot be written, or if another process is writing
    its trajectory; the old file is then kept.
    """
    _check_unused(Path(path))
    _write(Path(path), arrays, record)
    _remove_parts(Path(path))


def write_parts(
    path: str | os.PathLike[str],
    arrays: Mapping[str, NDArray[Any]],
    small: Mapping[str, NDArray[Any]],
    record: Mapping[str, Any],
) -> None:
    """Write a checkpoint in parts, one for each rank; all ranks call this.

    NAME.checkpoint.h5 holds what is the same on all ranks; the folder NAME.checkpoint.parts has a file of each rank
    with the rows of its slice of the disks. The files of one checkpoint bear a mark of their own, and those of the one
    before are there until NAME.checkpoint.h5 names the new ones: whenever a rank is killed, one of both is whole.

    `arrays` have a row for each disk of this rank's slice; the path, `small` ones and the record are those of the first
    rank. InputError on all, if a file cannot be written; the old checkpoint is kept then.
    """
    comm = current()
    counts = comm.allgather(len(next(iter(arrays.values()))))

    def begin() -> tuple[Path, str]:
        target = Path(path)
        _check_unused(target)
        try:
            parts_of(target).mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"checkpoint {parts_of(target)} cannot be made: {files.cause(error)}") from error
        return target, secrets.token_hex(8)

    target, mark = comm.root_result(begin)
    own, error = _part(target, mark, comm.rank), None
    try:
        _write(own, arrays, {"mark": mark, "part": comm.rank})
    except InputError as raised:
        error = raised
    try:
        comm.raise_collectively(error)
        first = [0, *np.cumsum(counts).tolist()]
        comm.run_on_root(lambda: _write(target, small, {**record, "parts": {"mark": mark, "first": first}}))
    except InputError:
        own.unlink(missing_ok=True)
        raise
    comm.run_on_root(lambda: _remove_parts(target, but=mark))


def _check_unused(target: Path) -> None:
    """Refuse the checkpoint of a trajectory that another process is writing."""
    if not target.name.endswith(files.CHECKPOINT):
        return
    trajectory = target.with_name(target.name.removesuffix(files.CHECKPOINT) + ".h5")
    if not files.is_locked_here(trajectory) and (use := files.being_written(trajectory)):
        raise InputError(f"checkpoint {target} cannot be written: it belongs to {trajectory.name}, and {use}")


def _write(target: Path, arrays: Mapping[str, Table], record: Mapping[str, Any]) -> None:
    for left in target.parent.glob(
        f".{glob.escape(target.name)}.*.part"
    ):  # by a run that was killed while it wrote
        left.unlink(missing_ok=True)
    text = json.dumps({**record, "versions": package_versions(), "git": revision()})
    try:
        with files.replacing(target) as new, new_file(new) as file:
            # Texts of fixed length: HDF5 may loop for ever in a damaged heap, which holds the others.
            file.attrs["kind"] = np.bytes_(_KIND)
            file.attrs["format"] = FORMAT
            file["record"] = np.frombuffer(text.encode(), dtype=np.uint8)
            file.create_group("arrays")
            digest = _Digest(text)
            for name, array in sorted(arrays.items()):
                compression = "gzip" if _is_constant(array) else None
                dataset = file.create_dataset(
                    f"arrays/{name}", array.shape, array.dtype, compression=compression
                )
                digest.begin(name, array)
                for first, piece in pieces(array):
                    digest.update(piece)
                    if array.shape:
                        dataset[first : first + len(piece)] = piece
                    else:
                        dataset[()] = piece[0]
            file.attrs["digest"] = np.bytes_(digest.text)
    except (OSError, RuntimeError) as error:
        raise InputError(f"checkpoint {target} cannot be written: {files.cause(error)}") from error


def parts_of(path: str | os.PathLike[str]) -> Path:
    """Folder with the parts of a checkpoint, NAME.checkpoint.parts for NAME.checkpoint.h5."""
    target = Path(path)
    return target.with_name(target.name.removesuffix(".h5") + ".parts")


def _part(target: Path, mark: str, number: int) -> Path:
    return parts_of(target) / f"{mark}-{number:04d}.h5"


def _remove_parts(target: Path, but: str = "") -> None:
    """Remove the parts of other checkpoints than that of a mark, and the folder if it is empty then."""
    folder = parts_of(target)
    for each in folder.iterdir() if folder.is_dir() else ():
        if re.fullmatch(r"\.?[0-9a-f]{16}-\d{4,}\.h5(\..*\.part)?", each.name) and not (
            but and each.name.startswith(but)
        ):
            each.unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        folder.rmdir()


def remove(path: str | os.PathLike[str]) -> None:
    """Remove a checkpoint, if it is there, with its parts."""
    Path(path).unlink(missing_ok=True)
    _remove_parts(Path(path))


def _is_constant(array: Table) -> bool:
    """True for many equal rows, which are compressed."""
    if isinstance(array, RowsByBlock) or array.ndim == 0 or len(array) <= MANY:
        return False
    return array.strides[0] == 0 or (array.ndim == 1 and bool(np.all(array == array[0])))


class _Digest:
    """A hash of all that a checkpoint holds: a single bit that changes makes another run of it.

    Arrays come one after another in the order of their names, each in pieces.
    """

    def __init__(self, record: str) -> None:
        self._hash = hashlib.blake2b(record.encode(), digest_size=16)

    def begin(self, name: str, array: Any) -> None:
        """Take the name, type and shape of an array, whose pieces follow."""
        self._hash.update(f"{name} {np.dtype(array.dtype).str} {tuple(array.shape)}".encode())

    def update(self, piece: NDArray[Any]) -> None:
        """Take the next rows of it."""
        self._hash.update(piece.reshape(-1).view(np.uint8).data)

    @property
    def text(self) -> str:
        """The hash of what it has got so far."""
        return self._hash.hexdigest()


def check_extra(path: object, extra: object, arrays: object) -> None:
    """Refuse an `extra` that cannot be stored, before anything is copied from the device.

    InputError unless the path is one, `extra` a mapping of what JSON knows, and `arrays` one of arrays of numbers.
    """
    if not checked.path("path", path).name:
        raise InputError(f"path = {shortened(path)}: must be the path of a file, a text or a Path")
    for name, given in (("extra", extra), ("arrays", arrays)):
        if given is not None and not isinstance(given, Mapping):
            raise InputError(f"{name} = {shortened(given)}: must be a mapping by name")
    for key, value in extra.items() if isinstance(extra, Mapping) else ():
        try:
            json.dumps({key: value})
        except (TypeError, ValueError) as error:
            raise InputError(
                f"extra[{shortened(key)}] = {shortened(value)}: JSON cannot hold it: {error}"
            ) from None
    for key, value in arrays.items() if isinstance(arrays, Mapping) else ():
        if not isinstance(key, str) or np.asarray(value).dtype.kind not in "biuf":
            raise InputError(
                f"arrays[{shortened(key)}] = {shortened(value)}: must be an array of numbers by its name"
            )


def read(
    path: str | os.PathLike[str], *, rows: bool = True
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays and the record of a checkpoint, whole also where it is in parts; without `rows`, none of its parts.

    InputError if there is no such file, or it is none of ours, or damaged, or a part is missing.
    """
    arrays, record = _read(path)
    return (arrays | _rows(path, record) if rows else arrays), record


def divided(arrays: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays with a row for each disk, and all others."""
    of_disks = {name: each for name, each in arrays.items() if name in OF_DISKS or name.startswith("before_")}
    return of_disks, {name: each for name, each in arrays.items() if name not in of_disks}


def read_slice(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The arrays and the record of a checkpoint, on each rank with the rows of its own slice of the disks.

    Without ranks, lists of disks (`READ_LATER`) are read from the file when they are used. All ranks call it, any number of them; the path is the root's. InputError on all, as `read`.
    """

    comm = current()

    def first() -> tuple[Path, dict[str, Any], dict[str, Any]]:
        return Path(path), *_read(path, READ_LATER if comm.size == 1 else ())

    found = comm.run_on_root(first)
    own, small = divided({} if found is None else found[1])
    sent = None if found is None else (found[0], list(own), small, found[2])
    target, names, arrays, record = comm.bcast(sent)  # type: ignore[misc]  # the root's
    if "parts" not in record:  # the root has all rows
        n = comm.bcast(len(next(iter(own.values()), ())))
        rows = comm.scatter_rows(n, list(own.values()) if comm.is_root else None)
        return arrays | dict(zip(names, rows, strict=True)), record
    of_parts, error = {}, None
    try:
        of_parts = _rows(target, record)
    except InputError as raised:
        error = raised
    comm.raise_collectively(error)
    return arrays | of_parts, record


def _rows(path: str | os.PathLike[str], record: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Rows of this rank's slice of the disks, from the parts of a checkpoint; none if it has no parts."""
    if "parts" not in record:
        return {}
    with as_damage_error(path, "its parts"):
        mark, first = str(record["parts"]["mark"]), [int(each) for each in record["parts"]["first"]]
    own, found = current().slice_of(first[-1]), []
    for number, (start, end) in enumerate(itertools.pairwise(first)):
        low, high = max(start, own.start), min(end, own.stop)
        if low < high:
            target = _part(Path(path), mark, number)
            if not target.exists():
                raise InputError(
                    f"checkpoint {path}: its part {target.parent.name}/{target.name} (disks {start} to {end - 1}) is "
                    f"missing{NEW_RUN_HINT}"
                )
            arrays, marked = _read(target)
            if (marked.get("mark"), marked.get("part")) != (mark, number):
                raise InputError(f"checkpoint {path}: {target} is part of another one{NEW_RUN_HINT}")
            found.append({name: each[low - start : high - start] for name, each in arrays.items()})
    return {name: np.concatenate([each[name] for each in found]) for name in found[0]}


def _read(path: str | os.PathLike[str], later: Collection[str] = ()) -> tuple[dict[str, Any], dict[str, Any]]:
    """The arrays and the record of a file; the arrays that are read `later`, block by block, as `RowsByBlock`."""
    if not os.path.isfile(path):
        raise InputError(f"{path}: there is no such file")
    damage.check_readable(path)
    if not h5py.is_hdf5(path):
        raise InputError(f"{path} is damaged, or no checkpoint of ifrdem: it is not an HDF5 file")
    with as_damage_error(path), h5py.File(path, "r") as file:
        if "particles" in file:
            raise InputError(f"{path} is a trajectory: must be its checkpoint, NAME.checkpoint.h5")
        damage.check_links(file, os.fspath(path))
        if not np.array_equal(file.attrs.get("kind"), np.bytes_(_KIND)):
            raise InputError(f"{path} is no checkpoint of ifrdem")
        if int(file.attrs["format"]) != FORMAT:
            raise InputError(
                f"{path} is a checkpoint of format {file.attrs['format']}; this ifrdem reads {FORMAT}"
            )
        text = damage.read(file["record"]).tobytes().decode()
        arrays, digest = {}, _Digest(text)
        for name in sorted(map(str, file["arrays"])):
            arrays[name] = _taken(file["arrays"][name], digest, path if name in later else None)
        if not np.array_equal(file.attrs["digest"], np.bytes_(digest.text)):
            raise DamageError(
                f"{path} is damaged: what it holds has changed since it was written{NEW_RUN_HINT}"
            )
        record: dict[str, Any] = json.loads(text)
    return arrays, record


def _taken(item: h5py.Dataset, digest: _Digest, source: str | os.PathLike[str] | None) -> Table:
    """The rows of a dataset, which the digest gets: of equal ones, one in memory; with a `source`, to be read from it."""
    digest.begin(str(item.name).rsplit("/", 1)[-1], item)
    constant = item.ndim > 0 and damage.compression(item) is not None
    if not (constant or source is not None):
        rows = damage.read(item)
        for _, piece in pieces(rows):
            digest.update(piece)
        return rows
    stored, n = item.name, len(item)

    def read(of: slice) -> NDArray[Any]:
        with h5py.File(source, "r") as file:
            return damage.read(file[stored], of)

    first = damage.read(item, slice(0, 1))
    for _, piece in pieces(RowsByBlock(n, lambda of: damage.read(item, of))):
        digest.update(piece)
        constant = constant and bool(np.all(piece == first))
    if constant:
        return np.broadcast_to(first, item.shape)
    return damage.read(item) if source is None else RowsByBlock(n, read, item.dtype, item.shape[1:])


def as_damage_error(path: str | os.PathLike[str], part: str = "it") -> AbstractContextManager[None]:
    """As `damage.as_damage_error`, of a checkpoint."""
    return damage.as_damage_error(path, part, NEW_RUN_HINT)


def state_of(arrays: Mapping[str, Any]) -> State:
    """State with positions to rounding, from which a simulation is made before all is restored to the bit.

    Collisions are those until the window began, which determine the gates that are open.
    """
    collisions = np.concatenate([named(each, "meta").events for _, each in pieces(arrays["meta"])])
    if "hits" in arrays:
        hits = [named(each, "hits").wall_collisions for _, each in pieces(arrays["hits"])]
        collisions -= np.concatenate(hits)
    return State(
        position=arrays["state_position"],
        velocity=arrays["state_velocity"],
        spin=arrays["state_spin"],
        time=float(arrays["clock"][0]),
        collisions=collisions,
    )


def disks_of(arrays: Mapping[str, NDArray[Any]], species: Mapping[str, int]) -> Disks:
    """The disks, of these species: of ranks, those of the slice."""
    columns = [arrays[f"disks_{name}"] for name in COLUMNS]
    return Disks(len(columns[0]), *columns, species=species)


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Names of what differs between the records of two gases, but for what changes no bit.

    That is threads, and where pistons are.
    """
    a, b = _compared(one), _compared(other)
    return [name for name in a if a[name] != b.get(name)]


def _compared(record: dict[str, Any]) -> dict[str, Any]:
    free = ("threads", "low_memory")
    device = {key: value for key, value in record["device"].items() if key not in free}
    left_out = ("k", "path")
    law = [[{key: one[key] for key in one if key not in left_out} for one in row] for row in record["law"]]
    given = [dict(wall) for wall in record["walls"]]
    for wall in given:
        if piston := wall.get("piston"):  # where a piston starts, as where disks do
            wall["piston"] = {key: piston[key] for key in piston if key not in ("displacement", "velocity")}
    words = present_record(record["record"])
    return {**record, "device": device, "law": law, "walls": given, "record": words}


def check_versions(record: Mapping[str, Any], path: str | os.PathLike[str], device: str = "cpu") -> None:
    """Refuse a checkpoint of another version, which could change bits: InputError with both versions.

    One of another runtime is accepted where both are known to give the same bits on the device.
    """
    present = package_versions()
    here, written = runtime.of_versions(present), runtime.of_versions(record["versions"])
    own = ("ifrdem", record["versions"].get("ifrdem")), ("ifrdem", present["ifrdem"])
    for before, now, same in (
        (*own, own[0] == own[1]),
        (written, here, runtime.have_same_bits(written, here, device)),
    ):
        if not same:
            resume = _remedy(*written) if now is here else ""
            raise InputError(
                f"{path} was written by {' '.join(map(str, before))}, this is {' '.join(now)}: a run resumes to the "
                f"bit with the same version only. {f'{resume}, or begin' if resume else 'Begin'} a new run from a "
                'stored frame: start.positions = "NAME.h5"'
            )


def report_runtime(record: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Log that a gas resumes with another runtime, which gives the same bits (`check_versions`)."""
    written, here = map(runtime.of_versions, (record["versions"], package_versions()))
    if written != here:
        LOG.info("%s was written by %s %s; %s %s gives the same bits on a CPU", path, *written, *here)


def _remedy(name: str, version: str) -> str:
    """Sentence that tells how to resume with this version of a runtime; an empty text for an unknown runtime."""
    if name not in runtime.NAMES:
        return ""
    chosen = option_name(f"--runtime {name}", f"{runtime.VARIABLE}={name}")
    if runtime.version(name) == version:
        return f"Resume with `{chosen}`"
    return f"Resume with it: `pip install {name}=={version}`, `{chosen}`"
