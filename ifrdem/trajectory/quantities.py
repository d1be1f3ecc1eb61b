"""Quantities of the whole gas by name, checked before they are written."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError


def checked(
    what: str,
    row: str,
    given: Mapping[str, ArrayLike],
    first: Mapping[str, h5py.Dataset] | Mapping[str, NDArray[Any]] | None,
) -> dict[str, NDArray[Any]]:
    """Numbers as they are stored: float64 or int64.

    Parameters
    ----------
    what, row : str
        What they are ("observable") and what they stand in ("frame"), for messages.
    given : mapping
        Name -> number or array.
    first : mapping or None
        The datasets or arrays that the first row made, shape (rows, ...); None if there is no row yet.

    Raises
    ------
    InputError
        If one is not a number or numbers, or they do not fit the first row.
    """
    found = {}
    for name, value in given.items():
        numbers = np.asarray(value)
        if numbers.dtype.kind not in "iuf" or numbers.size == 0:
            raise InputError(f"{what} {name} = {value!r}: a number or numbers are needed")
        found[name] = numbers.astype(np.float64 if numbers.dtype.kind == "f" else np.int64)
    if first is None:
        for name in found:
            check_name(what, name, separator=False)
        return found
    if found.keys() != first.keys():
        several = what if what.endswith("s") else f"{what}s"
        raise InputError(f"{several} {sorted(found)}: the first {row} has {sorted(first)}")
    for name, numbers in found.items():
        dataset = first[name]
        if numbers.shape != dataset.shape[1:]:
            raise InputError(f"{what} {name} has shape {numbers.shape}: {dataset.shape[1:]} is needed")
        if numbers.dtype.kind == "f" and dataset.dtype.kind != "f":
            raise InputError(f"{what} {name} = {numbers}: it was an integer in the first {row}")
        found[name] = numbers.astype(dataset.dtype)
    return found


def is_number(value: object) -> bool:
    """Whether a value is a real number, of Python's or NumPy's; truth values are none."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def check_name(what: str, name: object, *, separator: bool = True) -> None:
    """Raise InputError unless a name can be one in HDF5; with `separator`, "/" makes groups."""
    parts = str(name).split("/") if separator else [str(name)]
    if not isinstance(name, str) or any(part in ("", ".", "..") or "/" in part for part in parts):
        raise InputError(f"name of {what} = {name!r}: a text is needed that HDF5 takes as a name")
