"""Patches of the runtimes that shorten each start of a process by half a second or more. They change no kernel.

They are applied only to versions that they were tested with; for others `apply` and `short_import` do nothing.
"""

import ast
import functools
import importlib
import inspect
import linecache
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, ModuleType
from typing import Any


@contextmanager
def short_import() -> Iterator[None]:
    """Import the runtime without its search for the module of each frame that declares a function.

    The runtime needs a line of source; to find it, `inspect` searches all of `sys.modules` each time. quadrants also
    imports `dill`, which it uses only for functions that are typed at a prompt.
    """
    whole = inspect.getframeinfo
    inspect.getframeinfo = _frame_info  # type: ignore[assignment]
    try:
        with _postponed("dill"):
            yield
    finally:
        inspect.getframeinfo = whole


@contextmanager
def _postponed(name: str) -> Iterator[None]:
    """Let modules import a module that is loaded when one of them uses it."""
    if name in sys.modules:
        yield
        return
    sys.modules[name] = stand_in = ModuleType(name)
    stand_in.__getattr__ = lambda attribute: getattr(importlib.import_module(name), attribute)  # type: ignore[method-assign]
    try:
        yield
    finally:
        del sys.modules[name]


def _frame_info(frame: FrameType, context: int = 1) -> inspect.Traceback:
    """File, line and function of a frame, and the one line of source there."""
    code, line = frame.f_code, frame.f_lineno
    return inspect.Traceback(
        code.co_filename, line, code.co_name, [linecache.getline(code.co_filename, line)], 0
    )


def apply(runtime: Any) -> None:
    """Patch the module of a runtime, of a version that the patches are for."""
    # For each declared function a runtime searches the calling frames, with `inspect`, for a class around it.
    # The line of source that it needs is in `linecache`.
    kernel_impl = runtime.lang.kernel_impl
    patterns = kernel_impl._KERNEL_CLASS_STACKFRAME_STMT_RES
    kernel_impl._inside_class = functools.partial(_inside_class, patterns)
    # With each array a runtime notes all calls that led to where it was made, half a millisecond each.
    # Only its own report of leaks reads them.
    runtime.lang._ndarray.get_traceback = runtime.lang.matrix.get_traceback = lambda *_: ""
    if runtime.__name__ == "taichi":
        _patch_taichi(kernel_impl)
    else:
        _patch_quadrants()


def _patch_quadrants() -> None:
    from quadrants.lang import _func_base

    # quadrants reads the signature of each declared function by `inspect` and checks all annotations.
    base = _func_base.FuncBase
    base.check_parameter_annotations = functools.partialmethod(
        _note_parameters, base.check_parameter_annotations, _func_base.ArgMetadata, _func_base.template
    )


def _note_parameters(declared: Any, whole: Callable[[Any], None], parameter: Any, template: type) -> None:
    """Note the parameters of a declared function: quickly, if they are plain ones or templates, as nearly all are."""
    function, code = declared.func, declared.func.__code__
    given = function.__annotations__
    special = declared.is_kernel or declared.is_real_function or declared.is_classfunc
    variadic = code.co_kwonlyargcount or code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS)
    others = function.__defaults__ or function.__dict__ or {*map(type, given.values())} - {template}
    if special or variadic or others or "return" in given:
        whole(declared)
        return
    names = code.co_varnames[: code.co_argcount]
    for parameters in (declared.arg_metas, declared.orig_arguments):
        parameters += [parameter(given.get(name, inspect.Parameter.empty), name) for name in names]
    declared.template_slot_locations = [i for i, name in enumerate(names) if name in given]


def _patch_taichi(kernel_impl: Any) -> None:
    from taichi.lang.ast import ast_transformer_utils

    # The source of a function is read and parsed once instead of at each call of it.
    # Taichi goes through one tree several times anyway, in static loops, and no function calls itself.
    kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
    kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
    kernel_impl._get_tree_and_ctx = _tree_and_context(kernel_impl, ast_transformer_utils)
    # For each node of the syntax tree Taichi lays out an excerpt of the source, in case of an error there.
    # File, line and the line's text say as much.
    ast_transformer_utils.ASTTransformerContext.get_pos_info = _position


def _inside_class(patterns: Any, level_of_class_stackframe: int) -> bool:
    """True if the statement of this frame begins a class: the decorated function is then a method."""
    frame = sys._getframe(level_of_class_stackframe)
    statement = linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()
    return any(pattern.match(statement) for pattern in patterns)


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


def _tree_and_context(kernel_impl: Any, utils: Any) -> Callable[..., Any]:
    """Taichi's function that parses a kernel or function; the tree of an inlined function serves every call of it."""
    build = kernel_impl._get_tree_and_ctx

    def tree_and_context(
        function: Any, is_kernel: bool = True, is_real_function: bool = False, **given: Any
    ) -> Any:
        if is_kernel or is_real_function:
            return build(function, is_kernel=is_kernel, is_real_function=is_real_function, **given)
        tree, lines, first, file = _source(function.func)
        return tree, utils.ASTTransformerContext(
            is_kernel=False,
            func=function,
            global_vars=kernel_impl._get_global_vars(function.func),
            argument_data=given["args"],
            src=lines,
            start_lineno=first,
            file=file,
            ast_builder=given["ast_builder"],
        )

    return tree_and_context
