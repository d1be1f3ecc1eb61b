"""Reading results of a study (NAME.nc) in another process, because HDF5 can crash on damaged files."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import DamageError, InputError
from ..tools.files import NO_VALUES
from ..trajectory import damage
from ..trajectory.descriptions import NUMBER

TIMEOUT = 120.0
"""Seconds that the process may take: HDF5 may never finish with a damaged file."""
_REFUSED, _DAMAGED = 2, 3  # exit statuses, with the message on the standard error stream
_ROOT = Path(__file__).resolve().parents[2]
_PROGRAM = (
    "import sys; sys.path.append(sys.argv[2]); from ifrdem.study import reading; reading.answer(sys.argv[1])"
)

Content = tuple[dict[str, str], dict[str, tuple[tuple[str, ...], NDArray[Any], str]]]
"""Attributes by name; dimensions, values and unit of each variable."""


def read(path: str | os.PathLike[str]) -> Content:
    """Attributes and variables of a NetCDF-4 file that `Results.write` made.

    Raises InputError if it is no such file, or damaged (`DamageError`).
    """
    file_name = os.fspath(path)
    if not os.path.exists(file_name):
        raise InputError(f"{file_name}: there is no such file")
    if not os.path.isfile(file_name):  # a pipe would be waited for
        raise InputError(f"{file_name}: is not a file: must be the results of a study (NAME.nc)")
    words = [sys.executable, "-P", "-X", "utf8", "-c", _PROGRAM, os.path.abspath(file_name), str(_ROOT)]
    try:
        done = subprocess.run(
            words, stdin=subprocess.DEVNULL, capture_output=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        raise DamageError(f"{file_name} is damaged: HDF5 does not finish within {TIMEOUT:g} s") from None
    if done.returncode < 0:
        raise DamageError(
            f"{file_name} is damaged: reading it crashes HDF5 ({signal.Signals(-done.returncode).name})"
        )
    if done.returncode:
        text = done.stderr.decode(errors="replace").strip()
        if done.returncode == _DAMAGED:
            raise DamageError(f"{file_name} is damaged: {text}")
        reason = text if done.returncode == _REFUSED else f"cannot be read: {(text.splitlines() or [''])[-1]}"
        raise InputError(f"{file_name}: {reason}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as stored:
        head = json.loads(str(stored["head"]))
        variables = {}
        for number, (name, dims, unit) in enumerate(head["variables"]):
            values = stored[str(number)]
            variables[name] = tuple(dims), values.astype(object) if values.dtype.kind == "U" else values, unit
    return head["attributes"], variables


def answer(path: str) -> None:
    """Write the content of a file to standard output, or the reason for a failure to standard error and exit."""
    try:
        damage.check_readable(path)
        if not h5py.is_hdf5(path):
            raise InputError("is not an HDF5 file: must be the results of a study (NAME.nc)")
        with damage.system_errors(path):
            attributes, variables = _content(path)
    except (InputError, *damage.FAULTS) as error:
        sys.stderr.write(str(error) or type(error).__name__)
        sys.exit(
            _DAMAGED if isinstance(error, DamageError) or not isinstance(error, InputError) else _REFUSED
        )
    head = {
        "attributes": attributes,
        "variables": [[name, *others] for name, (_, *others) in variables.items()],
    }
    arrays = {str(number): values for number, (values, *_) in enumerate(variables.values())}
    held = io.BytesIO()
    np.savez(held, head=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]
    sys.stdout.buffer.write(held.getvalue())


def _content(path: str) -> tuple[dict[str, str], dict[str, tuple[NDArray[Any], list[str], str]]]:
    """Attributes; values, dimensions and unit of each variable."""
    with h5py.File(path, "r") as file:
        damage.check_links(file, path)
        if "axes" not in file.attrs:
            raise InputError("holds no results of a study (`ifrdem study` writes them)")
        attributes = {str(name): str(text) for name, text in file.attrs.items()}
        variables = {}
        for name, stored in file.items():
            if stored.attrs.get("NAME", b"").startswith(NO_VALUES.encode()):
                continue
            dims = [name] if stored.is_scale else [str(axis[0].name).lstrip("/") for axis in stored.dims]
            values = _texts(stored) if h5py.check_string_dtype(stored.dtype) else damage.read(stored)
            if len(dims) != values.ndim:
                raise ValueError(f"{name} has {values.ndim} axes, and {len(dims)} of them have names")
            unit = str(stored.attrs.get("units", NUMBER))
            variables[name] = values, dims, "" if unit == NUMBER else unit
    _check(attributes, variables)
    return attributes, variables


def _check(
    attributes: Mapping[str, str], variables: Mapping[str, tuple[NDArray[Any], list[str], str]]
) -> None:
    """Raise ValueError unless the parts of the content fit each other."""
    sizes: dict[str, int] = {}
    for name, (values, dims, _) in variables.items():
        for dim, size in zip(dims, values.shape, strict=True):
            if sizes.setdefault(dim, size) != size:
                raise ValueError(f"{name} has {size} values along {dim}, others have {sizes[dim]}")
    axes, keys = json.loads(attributes["axes"]), json.loads(attributes["keys"])
    texts = json.loads(attributes.get("texts", "{}"))
    if not isinstance(texts, dict) or not all(isinstance(text, str) for text in texts.values()):
        raise ValueError("texts are no names of quantities")
    for axis, names in axes.items():
        if axis not in names:
            raise ValueError(f"axis {axis} has the keys {names}")
        for name in names:
            if name not in keys or name not in variables or variables[name][1] != [axis]:
                raise ValueError(f"key {name} of axis {axis} has no values along it")


def _texts(stored: h5py.Dataset) -> NDArray[np.str_]:
    size = stored.size * stored.dtype.itemsize
    if size > (most := stored.file.id.get_filesize()):
        raise ValueError(
            f"{stored.name} has {size} bytes of texts: must be at most {most}, the size of the file"
        )
    return np.array(stored.asstr()[()], dtype=np.str_)
