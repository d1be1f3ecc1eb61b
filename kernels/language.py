"""Taichi as the kernels import it: `from .language import ti`. Types of arrays, and what is compiled for."""

import ctypes
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError
from . import taichi_patches

try:
    with taichi_patches.short_import():
        import taichi as ti
except ImportError as error:
    reason = f"Taichi cannot be loaded ({error})"
    if "X11" in str(error):
        reason += (
            ": it needs libX11, which small images of Linux lack: apt install libx11-6, or dnf install libX11"
        )
    raise EngineError(reason) from error

from .taichi_fixes import round_products_by

__all__ = [
    "Cube", "Rows", "Table", "has_numbers", "is_single_precision", "on_gpu", "round_products_by", "spread_of_loops",
    "ti", "view", "width",
]  # fmt: skip

Rows: Any = ti.types.ndarray(ndim=1)
Table: Any = ti.types.ndarray(ndim=2)
Cube: Any = ti.types.ndarray(ndim=3)


def on_gpu() -> bool:
    """True if kernels are compiled for a GPU."""
    return bool(ti.lang.impl.current_cfg().arch == ti.cuda)


def is_single_precision() -> bool:
    """True if the real numbers of kernels are f32."""
    return bool(ti.lang.impl.get_runtime().default_fp == ti.f32)


def spread_of_loops() -> int:
    """Items of a loop over few, long ones that one of them takes: Taichi hands a thread of a CPU at least so many."""
    return 1 if on_gpu() else 512


def has_numbers(array: Any, of: Any) -> bool:
    """True if an array that a kernel was given has numbers of this type."""
    return bool(array.get_type().element_type == of)


def width(array: Any) -> int:
    """Number of columns of an array of vectors that a kernel was given; 0 of one of numbers."""
    shape = array.element_shape()
    return int(shape[0]) if len(shape) else 0


def view(array: Any) -> NDArray[Any]:
    """The memory of a Taichi array on the CPU as an array of NumPy, without a copy; as long as the array lives."""
    shape, kind = array.arr.total_shape(), np.dtype(ti.lang.util.to_numpy_type(array.dtype))
    address = ti.lang.impl.get_runtime().prog.get_ndarray_data_ptr_as_int(array.arr)
    memory: Any = (ctypes.c_char * (kind.itemsize * math.prod(shape))).from_address(address)
    return np.ndarray(shape, kind, buffer=memory)


taichi_patches.apply(lambda array: None if on_gpu() else view(array))
