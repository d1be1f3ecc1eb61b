"""Kernels that take arrays of a gas, each named once: in the annotation of the parameter that stands for all of them.

    @kernel
    def survey(limit: ti.f64, gas: Arrays("uses grid disk")):

Taichi passes an array only as a parameter of its own. `kernel` therefore declares a kernel with the parameters
`limit, uses, grid, disk`, whose first statement bundles the arrays in `gas` (`records.gas_of`).
"""

import ast
import functools
import inspect
import linecache
import textwrap
import types
from collections.abc import Callable, Mapping
from typing import Any

from ..columns import AXES, TABLES, Columns
from .frontends import look_up, source_files
from .language import Cube, Rows, Table, ti
from .records import gas_of

_TYPES = {1: Rows, 2: Table, 3: Cube}


def _keep_sources() -> None:
    """Keep the sources of kernels as they are now, for the runtime reads them when it compiles.

    Otherwise an edit meanwhile would compile a mixture of two texts, or end in errors about lines of others.
    """
    for path in source_files():
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        # Without a time of change, which `linecache` would check.
        linecache.cache[str(path)] = (0, None, lines, str(path))


_keep_sources()


class Arrays:
    """Annotation of a parameter that bundles arrays: their names in order, separated by blanks.

    `uses` is the template argument of features. `tables` gives the columns of arrays by the arrays' names; others have
    numbers.
    """

    def __init__(self, names: str, tables: Mapping[str, Columns] = TABLES) -> None:
        self.names: tuple[str, ...] = tuple(names.split())
        self.tables = tables

    def annotations(self) -> dict[str, Any]:
        """Parameters of a Taichi kernel."""
        return {name: ti.template() if name == "uses" else _TYPES[AXES.get(name, 1)] for name in self.names}


def parameters_of(kernel: Callable[..., Any]) -> list[str]:
    """Names of the parameters of a kernel, in order."""
    return list(inspect.signature(kernel).parameters)


def _code_in(code: types.CodeType) -> types.CodeType:
    """The code of the one function that another code defines."""
    return next(each for each in code.co_consts if isinstance(each, types.CodeType))


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a kernel with a parameter for each array of the `Arrays` of one parameter.

    It needs a docstring, and none of its variables may have the name of an array.

    Taichi reads the source of a kernel. That of the function is therefore written out with all parameters, each line
    with its number, so that error messages name it, and kept for `inspect` in `linecache`.
    """
    lines, first = inspect.getsourcelines(function)
    source = textwrap.dedent("".join(lines))
    node: Any = ast.parse(source).body[0]
    begin = node.body[1].lineno  # of the body, behind the docstring
    parameters: dict[str, Any] = {}
    for name, parameter in inspect.signature(function).parameters.items():
        if isinstance(parameter.annotation, Arrays):
            arrays, gas = parameter.annotation, name
            parameters |= arrays.annotations()
        else:
            parameters[name] = parameter.annotation
    free = function.__code__.co_freevars
    text = "".join([
        "\n" * (first - 1),
        f"def make({', '.join((*free, 'static', 'bundle'))}):\n",
        f" def {function.__name__}({', '.join(parameters)}):\n",
        f"    {gas} = static(bundle({', '.join(arrays.names)}))\n",
        "\n" * (begin - 4),
        *source.splitlines(keepends=True)[begin - 1 :],
        f" return {function.__name__}\n",
    ])  # fmt: skip
    file = f"{inspect.getsourcefile(function)} (kernel {function.__qualname__})"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    cells = dict(zip(free, function.__closure__ or (), strict=True))
    cells["static"] = types.CellType(ti.static)
    cells["bundle"] = types.CellType(
        functools.partial(gas_of, function.__qualname__, arrays.tables, arrays.names)
    )
    code = _code_in(_code_in(compile(text, file, "exec")))
    closure = tuple(cells[name] for name in code.co_freevars)
    declared = types.FunctionType(code, function.__globals__, function.__name__, None, closure)
    declared.__annotations__ = parameters
    for name in ("__doc__", "__module__", "__qualname__"):
        setattr(declared, name, getattr(function, name))
    found = ti.kernel(declared)
    if not free:
        look_up(found)
    return found
