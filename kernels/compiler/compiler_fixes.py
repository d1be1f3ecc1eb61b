"""Two corrections of what the runtime compiles: products on a GPU, and indices that do not exist.

On a GPU, the compiler fuses products and sums, whatever `fast_math` says: a * b + c is rounded once there,
twice on a CPU. It takes a / r and b / r as products with an approximate 1 / r, too. So products, and what is divided
by, are made opaque to it: their bits are XORed with a 0 that no compiler can know (`round_products_by`). Then +, -, *,
/ and roots give the bits of the CPU, in double precision; sines, cosines and logarithms are those of another library
and do not.

A constant index beyond a vector aborts the process in the compiler. It is refused as an error here.
"""

import ast
import itertools
import math
from typing import Any

from . import runtime
from .language import ti

_IndexError = getattr(ti.lang.exception, f"{runtime.chosen().capitalize()}IndexError")
impl, Expr = ti.lang.impl, ti.lang.expr.Expr
# By the kernel that is compiled: a variable of it, and numbers from 1 on.
_ZERO: dict[Any, tuple[Any, Any]] = {}
_WORDS = {ti.f64: ti.u64, ti.f32: ti.u32}


def round_products_by(zero: Any) -> None:
    """Round products by themselves from here to the end of the loop, with a variable (u64) that is 0; on a GPU."""
    _ZERO.clear()
    _ZERO[impl.get_runtime().compiling_callable] = zero, itertools.count(1)


def _is_exact(factor: Any) -> bool:
    """True if a product with this factor is exact: a constant that is 0 or a power of two."""
    return isinstance(factor, (int, float)) and abs(math.frexp(factor)[0]) in (0.0, 0.5)


def _opaque(value: Any, kind: Any, zero: Any) -> Any:
    """A real number, which the compiler takes for another."""
    return ti.bit_cast(ti.bit_cast(value, _WORDS[kind]) ^ ti.cast(zero, _WORDS[kind]), kind)


def _build_product(context: Any, node: Any) -> Any:
    """Build a binary operation as usual, but round a product or quotient of real numbers by itself on a GPU."""
    found = _build_operation(context, node)
    zero, numbers = _ZERO.get(impl.get_runtime().compiling_callable, (None, None))
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


def _check_index(value: Any, index: Any) -> None:
    """Refuse constant indices beyond a vector or matrix."""
    _validate_index(value, index)
    if not (isinstance(value, Expr) and isinstance(index, tuple) and value.is_tensor()):
        return
    for one, length in zip(index, value.get_shape(), strict=False):
        if isinstance(one, int) and one >= length:
            allowed = "0" if length == 1 else f"from 0 to {length - 1}"
            raise _IndexError(f"index {one} does not exist: must be {allowed}")


_validate_index, impl.validate_subscript_index = impl.validate_subscript_index, _check_index
_transformer = ti.lang.ast.ast_transformer.ASTTransformer
_build_operation, _transformer.build_BinOp = _transformer.build_BinOp, staticmethod(_build_product)
