"""Short texts of objects that hold arrays: shapes and ranges instead of numbers."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Brief:
    """A dataclass (with repr=False) whose repr gives each array by its shape and range, and omits empty dicts."""

    def __repr__(self) -> str:
        """On one line, in the order of the fields."""
        values = {one.name: getattr(self, one.name) for one in dataclasses.fields(self)}  # type: ignore[arg-type]
        texts = [
            f"{name} {brief(value)}" for name, value in values.items() if not isinstance(value, dict) or value
        ]
        return f"<{type(self).__name__}: {', '.join(texts)}>"


def brief(value: Any) -> str:
    """An array as "(300,) from 0.1 to 2"; containers of arrays by their items; anything else by its repr."""
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key!r}: {brief(one)}' for key, one in value.items())}}}"
    if isinstance(value, list) and value and not isinstance(value[0], str):
        return f"{len(value)} of {type(value[0]).__name__}"
    if isinstance(value, tuple):
        return f"({', '.join(map(brief, value))})"
    return f"{value:.6g}" if isinstance(value, float) else repr(value)


def _array(value: NDArray[Any]) -> str:
    shape = str(value.shape)
    if value.dtype.kind == "b":
        return f"{shape} with {np.count_nonzero(value)} true"
    if value.dtype.kind not in "iufc":
        return f"{shape} of {value.dtype}"
    size = np.abs(value) if value.dtype.kind == "c" else value
    known = size[~np.isnan(size)]
    if not known.size:
        return f"{shape} of nan" if value.size else shape
    low, high = known.min(), known.max()
    what = "sizes " if value.dtype.kind == "c" else ""
    span = f"{what}all {low:.6g}" if low == high else f"{what}from {low:.6g} to {high:.6g}"
    return f"{shape} {span}{'' if known.size == value.size else ', some nan'}"
