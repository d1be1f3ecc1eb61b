"""Arrays that are used again once nobody holds them: fresh memory costs several times what filling it again does."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

MOST = (
    8  # of a kind that are kept: two frames wait, one is being written, one is being filled; two arrays each
)
LINE = 64  # bytes that memory hands out at once: arrays begin where such a line does
# References to an array that only `Buffers` holds: its list, the loop's name, and the question itself.
_UNUSED = 3


class Buffers:
    """Hands out arrays whose content is undefined; views of them keep them out of use."""

    def __init__(self) -> None:
        self._kept: dict[tuple[tuple[int, ...], str], list[NDArray[np.uint8]]] = {}

    def take(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """An array that nobody else holds, or any view of it."""
        kind = np.dtype(dtype)
        size = math.prod(shape) * kind.itemsize
        kept = self._kept.setdefault((shape, kind.str), [])
        for memory in kept:
            if sys.getrefcount(memory) == _UNUSED:
                break
        else:
            memory = np.empty(size + LINE, np.uint8)
            if len(kept) < MOST:
                kept.append(memory)
        first = -memory.__array_interface__["data"][0] % LINE
        return memory[first : first + size].view(kind).reshape(shape)


def copy_into(target: NDArray[Any], source: NDArray[Any]) -> None:
    """Copy an array into one of its shape and type.

    Rows of two numbers are copied as one item each where both arrays let that be: NumPy copies such rows one by one.
    """
    if _in_pairs(target) and _in_pairs(source):
        pair = np.complex64 if source.itemsize == 4 else np.complex128
        target, source = target.view(pair)[:, 0], source.view(pair)[:, 0]
    np.copyto(target, source)


def _in_pairs(array: NDArray[Any]) -> bool:
    plain = array.dtype.isnative and array.dtype.kind in "iuf"
    return (
        plain
        and array.ndim == 2
        and array.shape[1] == 2
        and array.strides[1] == array.itemsize
        and array.itemsize in (4, 8)
    )


def compact(array: NDArray[Any]) -> NDArray[Any]:
    """The array, or a copy of it where its items do not stand one after another."""
    if array.flags.c_contiguous:
        return array
    found = np.empty(array.shape, array.dtype)
    copy_into(found, array)
    return found
