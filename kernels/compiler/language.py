"""The runtime as the kernels import it: `from .language import ti`. Types of arrays, and what is compiled for.

`ti` is the module `taichi` or `quadrants` (`runtime.py`).
"""

import ctypes
import math
import types
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from . import runtime

ti = runtime.load()

from .compiler_fixes import round_products_by  # noqa: E402  (imports `ti` from here)

__all__ = [
    "CompilationError", "Cube", "Rows", "Table", "declared", "from_numpy", "has_numbers", "is_single_precision",
    "on_gpu", "program", "round_products_by", "shared", "spread_of_loops", "ti", "to_numpy", "view", "width",
]  # fmt: skip

Rows: Any = ti.types.ndarray(ndim=1)
Table: Any = ti.types.ndarray(ndim=2)
Cube: Any = ti.types.ndarray(ndim=3)
CompilationError: Any = getattr(ti, f"{runtime.chosen().capitalize()}CompilationError")


def declared(function: Any) -> Any:
    """A function of kernels: the given one if it is declared by `ti.func`, else a declared copy of it.

    The copy has no type annotations, of which `ti.func` takes none but its own. InputError if it uses the other
    runtime.
    """
    if hasattr(function, "_is_taichi_function") or hasattr(function, "_is_quadrants_function"):
        return function
    for name in function.__code__.co_names:
        used = function.__globals__.get(name)
        if isinstance(used, types.ModuleType) and used.__name__ in runtime.NAMES and used is not ti:
            raise InputError(
                f"{function.__qualname__}: `{name}` must be {ti.__name__}, the runtime of this process, not "
                f"{used.__name__}: import it by `from ifrdem import ti`"
            )
    parts = ("__code__", "__globals__", "__name__", "__defaults__", "__closure__")
    copy = type(function)(*(getattr(function, part) for part in parts))
    copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
    return ti.func(copy)


def program() -> Any:
    """The program object of the runtime, which owns arrays and compiled kernels; None before it has started."""
    return vars(ti.lang.impl.get_runtime())["prog" if runtime.chosen() == "taichi" else "_prog"]


def on_gpu() -> bool:
    """True if kernels are compiled for a GPU."""
    return bool(ti.lang.impl.current_cfg().arch == ti.cuda)


def is_single_precision() -> bool:
    """True if the real numbers of kernels are f32."""
    return bool(ti.lang.impl.get_runtime().default_fp == ti.f32)


_SHARED: dict[Any, int] = {}  # bytes that arrays of the kernel take which is compiled
MOST_SHARED = 49_152  # bytes of the threads of a block


def shared(n: int, of: Any = None) -> Any:
    """An array of n numbers that the threads of a block of a GPU share: of a type, or real ones.

    ValueError if those of a kernel do not fit: Taichi would give the array no room at all, without a message.
    """
    of = of or ti.lang.impl.get_runtime().default_fp
    kernel = ti.lang.impl.get_runtime().compiling_callable
    taken = _SHARED.get(kernel, 0) + n * np.dtype(ti.lang.util.to_numpy_type(of)).itemsize
    if taken > MOST_SHARED:
        raise ValueError(f"shared arrays of {taken} bytes: a block of threads has {MOST_SHARED}")
    _SHARED.clear()
    _SHARED[kernel] = taken
    return ti.simt.block.SharedArray((n,), of)


def spread_of_loops() -> int:
    """Items of a loop over few, long ones that one of them takes: a thread of a CPU is handed at least so many."""
    return 1 if on_gpu() else 512


def has_numbers(array: Any, of: Any) -> bool:
    """True if an array that a kernel was given has numbers of this type."""
    return bool(array.get_type().element_type == of)


def width(array: Any) -> int:
    """Number of columns of an array of vectors that a kernel was given; 0 of one of numbers."""
    shape = array.element_shape()
    return int(shape[0]) if len(shape) else 0


def view(array: Any) -> NDArray[Any]:
    """The memory of an array on the CPU as an array of NumPy, without a copy; as long as the array lives."""
    shape = (*array.shape, *array.element_shape)
    kind = np.dtype(ti.lang.util.to_numpy_type(array.dtype))
    address = program().get_ndarray_data_ptr_as_int(array.arr)
    memory: Any = (ctypes.c_char * (kind.itemsize * math.prod(shape))).from_address(address)
    return np.ndarray(shape, kind, buffer=memory)


def from_numpy(array: Any, values: NDArray[Any]) -> None:
    """Copy numbers of NumPy into an array of the same shape.

    Taichi's own copy is a kernel for each type and shape, which it compiles at every start. On a CPU both lie in the
    memory of the process.
    """
    if on_gpu():
        array.from_numpy(values)
        return
    memory = view(array)
    if memory.shape != values.shape:
        raise ValueError(f"an array of shape {values.shape} for one of shape {memory.shape}")
    memory[...] = values


def to_numpy(array: Any) -> NDArray[Any]:
    """The numbers of an array as a new one of NumPy."""
    found: NDArray[Any] = array.to_numpy() if on_gpu() else view(array).copy()
    return found
