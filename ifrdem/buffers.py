"""Arrays that are used again once nobody holds them: fresh memory costs several times what filling it again does."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

MOST = (
    8  # of a kind that are kept: two frames wait, one is being written, one is being filled; two arrays each
)
# References to an array that only `Buffers` holds: its list, the loop's name, and the question itself.
_UNUSED = 3


class Buffers:
    """Hands out arrays whose content is undefined; views of them keep them out of use."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[tuple[int, ...], str], list[NDArray[Any]]] = {}

    def take(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """An array that nobody else holds, or any view of it."""
        kind = (shape, np.dtype(dtype).str)
        kept = self._arrays.setdefault(kind, [])
        for array in kept:
            if sys.getrefcount(array) == _UNUSED:
                return array[...]
        fresh: NDArray[Any] = np.empty(shape, dtype)
        if len(kept) < MOST:
            kept.append(fresh)
            return fresh[...]
        return fresh
