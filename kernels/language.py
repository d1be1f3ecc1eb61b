"""Taichi as the kernels import it: `from .language import ti`.

On a GPU, Taichi has the compiler fuse products and sums, whatever `fast_math` says: a * b + c is rounded once there,
twice on a CPU. It takes a / r and b / r as products with an approximate 1 / r, too. So products, and what is divided
by, are made opaque to it: their bits are XORed with a 0 that no compiler can know (`round_products_by`). Then +, -, *,
/ and roots give the bits of the CPU, in double precision; sines, cosines and logarithms are those of another library
and do not.

Taichi 1.7 spends half a second of each start on things that kernels do not need; they are replaced here, before the
first kernel is declared. They change no kernel.

- For each declared function, and for its own as it is imported, it asks `inspect` for the module of the calling frame,
  which goes through all of `sys.modules`; the line of source that it wants is in `linecache`.
- For each node of the syntax tree it lays out an excerpt of the source, in case of an error there; file, line and the
  line's text say as much. The source of a function is read and parsed once instead of at each call of it.
- With each array it notes all calls that led to where it was made, half a millisecond each.
- It copies arrays from and to NumPy by a kernel for each type and shape, which it compiles at every start. On a CPU
  both lie in the memory of the process.
"""

import ast
import ctypes
import functools
import inspect
import itertools
import linecache
import math
import sys
import textwrap
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError


def _frame(frame: FrameType, context: int = 1) -> inspect.Traceback:
    """File, line and function of a frame, and the one line of source there."""
    code, line = frame.f_code, frame.f_lineno
    return inspect.Traceback(
        code.co_filename, line, code.co_name, [linecache.getline(code.co_filename, line)], 0
    )


_whole, inspect.getframeinfo = inspect.getframeinfo, _frame  # type: ignore[assignment]
try:
    import taichi as ti
    from taichi.lang import _ndarray, impl, kernel_impl, matrix
    from taichi.lang.ast import ast_transformer, ast_transformer_utils
    from taichi.lang.exception import TaichiIndexError
    from taichi.lang.expr import Expr
except ImportError as error:
    why = f"Taichi cannot be loaded ({error})"
    if "X11" in str(error):
        why += (
            ": it needs libX11, which small images of Linux lack: apt install libx11-6, or dnf install libX11"
        )
    raise EngineError(why) from error
finally:
    inspect.getframeinfo = _whole

__all__ = [
    "Cube", "Rows", "Table", "has_numbers", "on_gpu", "round_products_by", "spread_of_loops", "ti", "view",
    "width",
]  # fmt: skip

Rows: Any = ti.types.ndarray(ndim=1)
Table: Any = ti.types.ndarray(ndim=2)
Cube: Any = ti.types.ndarray(ndim=3)
# By the kernel that is compiled: a variable of it, and numbers from 1 on.
_ZERO: dict[Any, tuple[Any, Any]] = {}
_WORDS = {ti.f64: ti.u64, ti.f32: ti.u32}


def on_gpu() -> bool:
    """Tell if kernels are compiled for a GPU."""
    return bool(ti.lang.impl.current_cfg().arch == ti.cuda)


def spread_of_loops() -> int:
    """Items of a loop over few, long ones that one of them takes: Taichi hands a thread of a CPU at least so many."""
    return 1 if on_gpu() else 512


def has_numbers(array: Any, of: Any) -> bool:
    """Tell if an array that a kernel was given has numbers of this type."""
    return bool(array.get_type().element_type == of)


def width(array: Any) -> int:
    """Number of columns of an array of vectors that a kernel was given; 0 of one of numbers."""
    shape = array.element_shape()
    return int(shape[0]) if len(shape) else 0


def round_products_by(zero: Any) -> None:
    """Round products by themselves from here to the end of the loop, with a variable (u64) that is 0; on a GPU."""
    _ZERO.clear()
    _ZERO[ti.lang.impl.get_runtime().compiling_callable] = zero, itertools.count(1)


def _is_exact(factor: Any) -> bool:
    """Tell if a product with this factor is exact: it is no variable but a power of two, or 0."""
    return isinstance(factor, (int, float)) and abs(math.frexp(factor)[0]) in (0.0, 0.5)


def _opaque(value: Any, kind: Any, zero: Any) -> Any:
    """A real number, which the compiler takes for another."""
    return ti.bit_cast(ti.bit_cast(value, _WORDS[kind]) ^ ti.cast(zero, _WORDS[kind]), kind)


def _build_product(context: Any, node: Any) -> Any:
    """As Taichi builds a binary operation; a product or quotient of real numbers for a GPU is rounded by itself."""
    found = _build_operation(context, node)
    zero, numbers = _ZERO.get(ti.lang.impl.get_runtime().compiling_callable, (None, None))
    if zero is None or not isinstance(found, Expr):
        return found
    kind = next((kind for kind in _WORDS if found.ptr.get_rvalue_type() == kind), None)
    left, right = node.left.ptr, node.right.ptr
    if kind is not None and isinstance(node.op, ast.Mult) and not (_is_exact(left) or _is_exact(right)):
        node.ptr = _opaque(found, kind, zero)
    elif kind is not None and isinstance(node.op, ast.Div):
        # Each divisor is another number to the compiler, also where it is the same.
        node.ptr = left / _opaque(ti.cast(right, kind), kind, zero * ti.cast(next(numbers), ti.u64))
    return node.ptr


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Tell if the statement of this frame begins a class: the decorated function is then a method."""
    frame = sys._getframe(level_of_class_stackframe)
    statement = linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()
    return any(pattern.match(statement) for pattern in kernel_impl._KERNEL_CLASS_STACKFRAME_STMT_RES)


def _position(context: Any, node: Any) -> str:
    """File, line, function and source line of a node, for Taichi's error messages."""
    number, name = node.lineno + context.lineno_offset, context.func.func.__name__
    return f'File "{context.file}", line {number}, in {name}:\n{context.src[node.lineno - 1].strip()}\n'


@functools.cache
def _source(function: Any) -> tuple[ast.Module, list[str], int, str | None]:
    """Syntax tree of a function without its decorators, its source, the line where it begins, and its file."""
    lines, first = inspect.getsourcelines(function)
    tree = ast.parse(textwrap.dedent("".join(lines)))
    tree.body[0].decorator_list = []  # type: ignore[attr-defined]
    return tree, lines, first, inspect.getsourcefile(function)


def _tree_and_context(
    function: Any, is_kernel: bool = True, is_real_function: bool = False, **given: Any
) -> Any:
    """As Taichi makes them for a call; the tree of an inlined function serves every call of it.

    Taichi goes through one tree several times anyway, in static loops, and no function calls itself.
    """
    if is_kernel or is_real_function:
        return _build_tree(function, is_kernel=is_kernel, is_real_function=is_real_function, **given)
    tree, lines, first, file = _source(function.func)
    return tree, ast_transformer_utils.ASTTransformerContext(
        is_kernel=False,
        func=function,
        global_vars=kernel_impl._get_global_vars(function.func),
        argument_data=given["args"],
        src=lines,
        start_lineno=first,
        file=file,
        ast_builder=given["ast_builder"],
    )


def _check_index(value: Any, index: Any) -> None:
    """Refuse constant indices beyond a vector or matrix, at which Taichi's compiler would abort the process."""
    _validate_index(value, index)
    if not (isinstance(value, Expr) and isinstance(index, tuple) and value.is_tensor()):
        return
    for one, length in zip(index, value.get_shape(), strict=False):
        if isinstance(one, int) and one >= length:
            raise TaichiIndexError(f"index {one} does not exist: must be {_below(length)}")


def _below(length: int) -> str:
    return "0" if length == 1 else f"from 0 to {length - 1}"


def view(array: Any) -> NDArray[Any]:
    """The memory of a Taichi array on the CPU as an array of NumPy, without a copy; as long as the array lives."""
    shape, kind = array.arr.total_shape(), np.dtype(ti.lang.util.to_numpy_type(array.dtype))
    address = ti.lang.impl.get_runtime().prog.get_ndarray_data_ptr_as_int(array.arr)
    memory: Any = (ctypes.c_char * (kind.itemsize * math.prod(shape))).from_address(address)
    return np.ndarray(shape, kind, buffer=memory)


def _from_numpy(by_kernel: Callable[..., None]) -> Callable[..., None]:
    """Copy an array of NumPy into one of Taichi."""

    def copy(array: Any, values: NDArray[Any], **layout: int) -> None:
        if on_gpu():
            by_kernel(array, values, **layout)
            return
        held = view(array)
        if held.shape != values.shape:
            raise ValueError(f"an array of shape {values.shape} for one of shape {held.shape}")
        held[...] = values

    return copy


def _to_numpy(by_kernel: Callable[..., NDArray[Any]]) -> Callable[..., NDArray[Any]]:
    """Copy an array of Taichi into a new one of NumPy."""

    def copy(array: Any, **layout: int) -> NDArray[Any]:
        return by_kernel(array, **layout) if on_gpu() else view(array).copy()

    return copy


for _name in (
    "_ndarray_from_numpy",
    "_ndarray_matrix_from_numpy",
    "_ndarray_to_numpy",
    "_ndarray_matrix_to_numpy",
):
    _wrap = _from_numpy if "from" in _name else _to_numpy
    setattr(ti.Ndarray, _name, _wrap(getattr(ti.Ndarray, _name)))
_validate_index, impl.validate_subscript_index = impl.validate_subscript_index, _check_index
_build_operation = ast_transformer.ASTTransformer.build_BinOp
ast_transformer.ASTTransformer.build_BinOp = staticmethod(_build_product)
kernel_impl._inside_class = _inside_class
_ndarray.get_traceback = matrix.get_traceback = lambda *_: ""
_build_tree, kernel_impl._get_tree_and_ctx = kernel_impl._get_tree_and_ctx, _tree_and_context
kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
ast_transformer_utils.ASTTransformerContext.get_pos_info = _position
