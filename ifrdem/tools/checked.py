"""Numbers and arrays from users: refused with their name unless they are what is needed, never changed to fit."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, nearest

Array = NDArray[np.float64]
"""An array of float64."""


def real(name: str, value: object, needed: str = "a number is needed") -> float:
    """A real number as a float; infinities and NaN pass."""
    if isinstance(value, np.ndarray) and value.shape == () and not np.ma.isMaskedArray(value):
        value = value.item()
    if isinstance(value, str | bytes):
        raise InputError(f"{name} = {value!r}: {needed}, not text")
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        raise InputError(f"{name} = {value!r}: {needed}")
    try:
        return float(value)
    except OverflowError:
        raise InputError(f"{name}: {needed}, below {np.finfo(np.float64).max:.3g}") from None


def finite(
    name: str, value: object, needed: str = "a finite number is needed", low: float = -math.inf,
    high: float = math.inf, *, open_: bool = False,
) -> float:  # fmt: skip
    """A finite number from `low` to `high`, or between them (`open_`), as a float."""
    number = real(name, value, needed)
    inside = low < number < high if open_ else low <= number <= high
    if not (inside and math.isfinite(number)):
        raise InputError(f"{name} = {value}: {needed}")
    return number


def whole(name: str, value: object, least: int, most: float = math.inf) -> int:
    """A whole number from `least` to `most` as an int; 3.0 is one."""
    allowed = f"{least} or more" if math.isinf(most) else f"{least} to {most:.0f}"
    needed = f"a whole number, {allowed}, is needed"
    index = getattr(value, "__index__", None)
    if index is not None and not isinstance(value, bool | np.bool_ | np.ndarray):
        number = int(index())
    elif real(name, value, needed).is_integer():
        number = int(real(name, value))
    else:
        raise InputError(f"{name} = {value}: {needed}")
    if not least <= number <= most:
        raise InputError(f"{name} = {value}: {needed}")
    return number


def one_of(name: str, value: object, allowed: Iterable[str]) -> str:
    """A text that is one of those allowed."""
    known = list(allowed)
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} = {value!r}: allowed are {', '.join(known)}{nearest(str(value), known)}")
    return value


def instance(name: str, value: object, kind: type) -> None:
    """Refuse an object of another class."""
    if not isinstance(value, kind):
        raise InputError(f"{name} = {value!r}: a {kind.__name__} is needed")


def path(name: str, value: object) -> Path:
    """The path of a file."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"{name} = {value!r}: the path of a file is needed")
    return Path(value)


def finite_pair(name: str, value: Any) -> tuple[float, float]:
    """Two finite numbers."""
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes) and len(value) == 2:
        x, y = (real(name, one, "two finite numbers are needed") for one in value)
        if math.isfinite(x) and math.isfinite(y):
            return x, y
    raise InputError(f"{name} = {value!r}: two finite numbers are needed")


def array(name: str, value: Any, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """A contiguous array of real numbers in double precision, of the given shape if one is given."""
    found = np.asarray(_numbers(name, value), dtype=np.float64, order="C")
    if shape is not None and found.shape != shape:
        raise InputError(f"{name} has shape {found.shape}: {shape} is needed")
    return found


def column(name: str, value: Any, n: int) -> NDArray[np.float64]:
    """An array (n,) of real numbers in double precision, its own; a number stands for all."""
    found = _numbers(name, value)
    if found.shape not in ((), (1,), (n,)):
        raise InputError(f"{name} has shape {found.shape}: a number or shape {(n,)} is needed")
    return np.array(np.broadcast_to(found, (n,)), dtype=np.float64)


def counts(
    name: str, value: Any, shape: tuple[int, ...], *, least: int = 0, broadcast: bool = False
) -> NDArray[np.int32]:
    """An array of whole numbers of 32 bits, none below `least`, its own only if they were of another type."""
    found = _numbers(name, value)
    if found.shape != shape and not (broadcast and found.shape in ((), (1,))):
        raise InputError(f"{name} has shape {found.shape}: {shape} is needed")
    if found.dtype != np.int32 or (found.size and least > np.iinfo(np.int32).min):
        most = np.iinfo(np.int32).max
        with np.errstate(invalid="ignore"):
            wrong = ~((found >= least) & (found <= most) & (found == np.floor(found)))
        if np.any(wrong):
            where = tuple(int(axis) for axis in np.argwhere(wrong)[0])
            place = f"[{', '.join(map(str, where))}]" if where else ""
            raise InputError(
                f"{name}{place} = {found[where]}: whole numbers from {least} to {most} are needed"
            )
    return np.ascontiguousarray(np.broadcast_to(found, shape), dtype=np.int32)


def _numbers(name: str, value: Any) -> NDArray[Any]:
    """Real numbers as an array of their own type."""
    if np.ma.isMaskedArray(value):
        raise InputError(f"{name} is a masked array: leave its masked values out, or fill them")
    try:
        found = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise InputError(f"{name}: an array of numbers is needed") from None
    if found.dtype.kind not in "iuf":
        what = "complex numbers" if found.dtype.kind == "c" else f"values of type {found.dtype}"
        raise InputError(f"{name}: real numbers are needed, not {what}")
    return found
