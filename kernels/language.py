"""Taichi as the kernels import it: `from .language import ti`.

Taichi 1.7 spends half a second of each start on two things that kernels do not need; both are replaced here, before the
first kernel is declared. They change no kernel.

- For each declared function it asks `inspect` for the module of the calling frame, which goes through all of
  `sys.modules`; the line of source that it wants is in `linecache`.
- For each node of the syntax tree it lays out an excerpt of the source, in case of an error there; file, line and the
  line's text say as much. The source of a function is read once instead of at each call of it.
"""

import functools
import linecache
import sys
from typing import Any

import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang.ast import ast_transformer_utils

__all__ = ["ti"]


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Tell if the statement of this frame begins a class: the decorated function is then a method."""
    frame = sys._getframe(level_of_class_stackframe)
    statement = linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()
    return any(pattern.match(statement) for pattern in kernel_impl._KERNEL_CLASS_STACKFRAME_STMT_RES)


def _position(context: Any, node: Any) -> str:
    """File, line, function and source line of a node, for Taichi's error messages."""
    number, name = node.lineno + context.lineno_offset, context.func.func.__name__
    return f'File "{context.file}", line {number}, in {name}:\n{context.src[node.lineno - 1].strip()}\n'


kernel_impl._inside_class = _inside_class
kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
ast_transformer_utils.ASTTransformerContext.get_pos_info = _position
