"""Rows that the tiles of a window have recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...kernels.columns import TABLES, named

if TYPE_CHECKING:
    from ..windows.arrays import DeviceArrays


class WindowLog:
    """Rows of two arrays of the device, in any order: real numbers, and whole ones with a column `tile`.

    Tiles that are run again write theirs again.
    """

    def __init__(self, real: str, whole: str) -> None:
        self._real, self._whole = real, whole
        self._parts: list[tuple[NDArray[Any], NDArray[Any]]] = []

    def clear(self) -> None:
        """Drop all rows."""
        self._parts = []

    def take(self, arrays: DeviceArrays, count: int) -> None:
        """Add the first `count` rows of the arrays."""
        if count:
            real, whole = (arrays.values(name)[:count].copy() for name in (self._real, self._whole))
            self._parts.append((real, whole))

    def drop(self, tiles: NDArray[np.int32]) -> None:
        """Drop the rows of these tiles."""
        self._parts = [
            (real[keep], whole[keep])
            for real, whole in self._parts
            for keep in [~np.isin(named(whole, self._whole).tile, tiles)]
        ]

    def rows(self, none: bool = False) -> tuple[NDArray[Any], NDArray[Any]]:
        """All rows, or `none`."""
        if none or not self._parts:
            width = (TABLES[self._real].width,) if self._real in TABLES else ()
            return np.zeros((0, *width)), np.zeros((0, TABLES[self._whole].width), dtype=np.int32)
        if len(self._parts) == 1:  # of a large gas as large as its state
            return self._parts[0]
        real, whole = zip(*self._parts, strict=True)
        return np.concatenate(real), np.concatenate(whole)
