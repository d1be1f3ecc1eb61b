"""Checkpoint files: arrays and a record, in double precision, written whole or not at all."""

from __future__ import annotations

import glob
import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import DamageError, InputError
from ..model.state import State
from ..tools import files
from ..tools.versions import package_versions
from ..trajectory import damage

FORMAT = 9
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
    """Places of the disks, to rounding: for a simulation that `Simulation.load_checkpoint` then puts right."""
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
