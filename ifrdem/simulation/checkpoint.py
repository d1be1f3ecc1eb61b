"""Checkpoint files: arrays and a record, in double precision, written whole or not at all.

All that decides an engine's future, to the last bit; and how it is put back.

A state in the order of disks (`State`) tells a gas to rounding: the engine measures positions from the corners of its
tiles, and knows when windows got short and the log long. A snapshot copies the device's arrays as they are.
Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

import glob
import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..kernels.layout import CELLS_X, CELLS_Y, LOG_CAPACITY, SPIN, TILES_X, TILES_Y, VX, VY, X, Y
from ..kernels.layout import ROW as ROW_LENGTH
from ..model.box import Box
from ..model.state import State
from ..tools import files
from ..tools.versions import package_versions
from ..trajectory import damage
from ..trajectory.damage import DamageError
from .epochs import Statistics

if TYPE_CHECKING:
    from .engine import Engine

Snapshot = dict[str, NDArray[Any]]

_FLIGHT = [X, Y, VX, VY, SPIN]
# Device arrays that outlive an epoch, beside flights.
_LASTING = (
    "meta", "image", "cell", "wall_hits", "wall_work", "wall_heat", "latest", "flow_work", "last_partner",
    "angle",
)  # fmt: skip


def fingerprint(engine: Engine) -> str:
    """A hash of what must be the same for a snapshot to fit: disks, box, laws, walls, forces, seed, precision."""
    engine.check_whole()
    a, disks, box = engine.arrays, engine.disks, engine.box
    digest = hashlib.sha256()
    parts: list[Any] = [
        disks.mass, disks.radius, disks.k, disks.material, np.array(box.lengths), np.array(box.periodic),
        np.array([box.shear_rate, *engine.gravity]), a.law.to_numpy(), np.array(a.uses[:4]),
        np.array([wall.row(np.zeros(2)) for wall in engine.walls]), str(np.dtype(a.real)), engine.order == "alone",
        a.uses.tallied, a.uses.partnered, a.uses.turned, engine.seed, a.uses.collision_law.impulses.__qualname__,
    ]  # fmt: skip
    for force in engine.splitting.forces:
        parts += [type(force).__name__, np.array(force.parameters), force.step]
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(str(part.shape).encode() + np.ascontiguousarray(part).tobytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()


def take(engine: Engine) -> Snapshot:
    """Copy everything; the disks settle, which changes nothing."""
    with engine.changing():
        engine.epochs.settle(engine.time)
    a, epochs, splitting = engine.arrays, engine.epochs, engine.splitting
    found: Snapshot = {"flight": np.ascontiguousarray(a.flight.to_numpy()[:, _FLIGHT])}
    for name in _LASTING:
        found[name] = getattr(a, name).to_numpy()
    found["losses"], found["regimes"] = a.losses.copy(), a.regimes.copy()
    for name, value in a.before.items():
        found[f"before_{name}"] = value
    found["division"] = a.grid[[TILES_X, TILES_Y, CELLS_X, CELLS_Y]].astype(np.int64)
    found["room"] = a.grid[[ROW_LENGTH, LOG_CAPACITY]].astype(np.int64)
    found["clock"] = np.array([engine.time, engine._collided_at, engine._flow_excess, engine.flow_work])
    found["counts"] = np.array(
        [engine.collisions, engine.wall_hits, engine._stalled, engine._resting, epochs._in_order, epochs._burst,
         epochs.log_growth, epochs._log_growths], dtype=np.int64,
    )  # fmt: skip
    found["window"] = np.array([epochs._window])
    found["statistics"] = np.array(list(asdict(engine.statistics).values()), dtype=np.int64)
    found["next_steps"] = np.array(splitting.next_steps, dtype=np.int64)
    found["energy_inputs"] = splitting.energy_inputs.copy()
    found["lost_before"], found["regimes_before"] = engine._lost_before.copy(), engine._regimes_before.copy()
    if engine._space is not None:
        found["open"] = np.array(
            [*engine._inner.lengths, *engine._offset, engine.skin, *engine._space.numbers()]
        )
    return found


def put_back(engine: Engine, found: Snapshot) -> None:
    """Make an engine of the same gas what the snapshot's was.

    Raises
    ------
    InputError
        If the snapshot is that of another division into tiles, or incomplete.
    """
    try:
        with engine.changing():
            _put_back(engine, found)
    except KeyError as error:
        raise InputError(f"checkpoint: {error.args[0]} is missing") from None


def _put_back(engine: Engine, found: Snapshot) -> None:
    engine.epochs.settle(engine.time)
    if engine._space is not None:
        length_x, length_y, offset_x, offset_y, engine.skin, *numbers = found["open"].tolist()
        engine.lay(dummy_state(engine.n), Box((length_x, length_y)), np.array([offset_x, offset_y]))
        engine._space.set_numbers(engine._inner, numbers)
    a, epochs = engine.arrays, engine.epochs
    division = a.grid[[TILES_X, TILES_Y, CELLS_X, CELLS_Y]]
    if not np.array_equal(division, found["division"]) or len(found["flight"]) != max(engine.n, 1):
        raise InputError("checkpoint: the box is divided otherwise here; was the skin another one?")
    row, records = (int(each) for each in found["room"])
    if row > a.grid[ROW_LENGTH]:
        a.make_rows(row)
    a.make_log(records)
    flight = a.flight.to_numpy()
    flight[:, _FLIGHT] = found["flight"]
    a.flight.from_numpy(flight)
    for name in _LASTING:
        getattr(a, name).from_numpy(found[name])
    a.losses[:], a.regimes[:] = found["losses"], found["regimes"]
    a.before = {name: found[f"before_{name}"] for name in a.before}
    engine.time, engine._collided_at, engine._flow_excess, engine.flow_work = found["clock"].tolist()
    (
        engine.collisions, engine.wall_hits, engine._stalled, engine._resting, epochs._in_order, epochs._burst,
        epochs.log_growth, epochs._log_growths,
    ) = found["counts"].tolist()  # fmt: skip
    epochs.unsettle()
    epochs._window = float(found["window"][0])
    counted = Statistics(*found["statistics"].tolist())
    engine.statistics.__dict__.update(asdict(counted))
    engine.splitting.next_steps = found["next_steps"].tolist()
    engine.splitting.energy_inputs = found["energy_inputs"].copy()
    engine._lost_before, engine._regimes_before = found["lost_before"], found["regimes_before"]


def dummy_state(n: int) -> State:
    """A state whose numbers nobody reads."""
    return State(position=np.zeros((n, 2)), velocity=np.zeros((n, 2)), spin=np.zeros(n))


FORMAT = 6
BEGIN_ANEW = '; begin a new run from a stored frame: start.positions = "NAME.h5"'
_KIND = "ifrdem checkpoint"


def write(
    path: str | os.PathLike[str], arrays: Mapping[str, NDArray[Any]], record: Mapping[str, Any]
) -> None:
    """Write a checkpoint: beside its place, synced to the disk, then renamed into place.

    Parameters
    ----------
    path : path
        The file; an existing one is replaced.
    arrays : mapping
        Arrays by name.
    record : mapping
        What JSON knows. Versions of the packages are added.

    Raises
    ------
    InputError
        If it cannot be written; the old file is kept then.
    """
    place = Path(path)
    for left in place.parent.glob(
        f".{glob.escape(place.name)}.*.part"
    ):  # by a run that was killed while it wrote
        left.unlink(missing_ok=True)
    text = json.dumps({**record, "versions": package_versions()})
    try:
        with files.replacing(place) as new:
            with h5py.File(new, "w") as file:
                # Texts of fixed length: HDF5 may loop for ever in a damaged heap, which holds the others.
                file.attrs["kind"] = np.bytes_(_KIND)
                file.attrs["format"] = FORMAT
                file.attrs["digest"] = np.bytes_(_digest(arrays, text))
                file["record"] = np.frombuffer(text.encode(), dtype=np.uint8)
                file.create_group("arrays")
                for name, array in arrays.items():
                    file[f"arrays/{name}"] = array
            descriptor = os.open(new, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
    except (OSError, RuntimeError) as error:
        reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
        raise InputError(f"checkpoint {path} cannot be written: {reason}") from error


def _digest(arrays: Mapping[str, NDArray[Any]], record: str) -> str:
    """A hash of all that a checkpoint holds: a single bit that changes makes another run of it."""
    digest = hashlib.blake2b(record.encode(), digest_size=16)
    for name, array in sorted(arrays.items()):
        values = np.ascontiguousarray(array)
        digest.update(f"{name} {values.dtype.str} {np.shape(array)}".encode())
        digest.update(values.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def check_extra(path: object, extra: object, arrays: object) -> None:
    """Refuse what cannot go into a checkpoint, before anything is copied from the device.

    Raises
    ------
    InputError
        If the path is none, `extra` is no mapping or holds what JSON does not know, or `arrays` is no mapping of arrays
        of numbers.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"path = {path!r}: the path of a file is needed, a text or a Path")
    for name, given in (("extra", extra), ("arrays", arrays)):
        if given is not None and not isinstance(given, Mapping):
            raise InputError(f"{name} = {given!r}: a mapping by name is needed")
    for key, value in extra.items() if isinstance(extra, Mapping) else ():
        try:
            json.dumps({key: value})
        except (TypeError, ValueError) as error:
            raise InputError(f"extra[{key!r}] = {value!r}: JSON cannot hold it: {error}") from None
    for key, value in arrays.items() if isinstance(arrays, Mapping) else ():
        if not isinstance(key, str) or np.asarray(value).dtype.kind not in "biuf":
            raise InputError(f"arrays[{key!r}] = {value!r}: an array of numbers by its name is needed")


def read(path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays and the record of a checkpoint.

    Raises
    ------
    InputError
        If there is no such file, or it is none of ours, or damaged.
    """
    if not os.path.isfile(path):
        raise InputError(f"{path}: there is no such file")
    if not h5py.is_hdf5(path):
        raise InputError(f"{path} is damaged, or no checkpoint of ifrdem: it is not an HDF5 file")
    with reading(path), h5py.File(path, "r") as file:
        damage.check_links(file, os.fspath(path))
        if not np.array_equal(file.attrs.get("kind"), np.bytes_(_KIND)):
            raise InputError(f"{path} is no checkpoint of ifrdem")
        if int(file.attrs["format"]) != FORMAT:
            raise InputError(
                f"{path} is a checkpoint of format {file.attrs['format']}; this ifrdem reads {FORMAT}"
            )
        text = damage.read(file["record"]).tobytes().decode()
        arrays = {str(name): damage.read(item) for name, item in file["arrays"].items()}
        if not np.array_equal(file.attrs["digest"], np.bytes_(_digest(arrays, text))):
            raise DamageError(
                f"{path} is damaged: what it holds has changed since it was written{BEGIN_ANEW}"
            )
        record: dict[str, Any] = json.loads(text)
    return arrays, record


def reading(path: str | os.PathLike[str], part: str = "it") -> AbstractContextManager[None]:
    """As `damage.reading`, of a checkpoint."""
    return damage.reading(path, part, BEGIN_ANEW)


def state_of(arrays: Mapping[str, NDArray[Any]]) -> State:
    """Where the disks were, to rounding: for a simulation that `Simulation.load_checkpoint` then puts right."""
    return State(
        position=arrays["state_position"],
        velocity=arrays["state_velocity"],
        spin=arrays["state_spin"],
        time=float(arrays["clock"][0]),
    )


def check_versions(record: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Refuse a checkpoint of another version: its bits could not go on.

    Raises
    ------
    InputError
        With both versions.
    """
    present = package_versions()
    for package in ("ifrdem", "taichi"):
        if record["versions"].get(package) != present[package]:
            raise InputError(
                f"{path} was written by {package} {record['versions'].get(package)}, this is {present[package]}: a run "
                "goes on to the bit with the same version only. Begin a new run from a stored frame: start.positions = "
                '"NAME.h5"'
            )
