"""Code and numbers of custom laws and forces: declared names, signatures, constants, compilers' errors."""

from __future__ import annotations

import dis
import functools
import importlib
import inspect
import re
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import CodeType, FunctionType, MappingProxyType, ModuleType
from typing import Any

import numpy as np

from ..errors import InputError, nearest
from ..tools import checked


def named_numbers(
    owner: str,
    what: str,
    names: Sequence[str],
    given: Mapping[str, Any],
    ranges: Mapping[str, checked.Number] = MappingProxyType({}),
) -> dict[str, float]:
    """A finite number for each of the names, in their order, in its range if it has one.

    InputError, which calls them `what` of the `owner`, if one is missing, unknown or out of range.
    """
    there = f"the {what}s of {owner} are {', '.join(names)}" if names else f"{owner} has no {what}s"
    for name in given:
        if name not in names:
            raise InputError(f"{owner}: unknown {what} '{name}'{nearest(name, names)}; {there}")
    for name in names:
        if name not in given:
            raise InputError(f"{owner}: {what} '{name}' is missing: must be a finite number; {there}")
    return {name: ranges.get(name, checked.FINITE)(f"{owner}: {name}", given[name]) for name in names}


_PACKAGE = Path(__file__).parents[1]


class FromKernels:
    """A function of a module of `kernels`, imported at its first use: Taichi is slow to import."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    def __get__(self, law: Any, kind: type) -> Callable[..., Any]:
        """The function."""
        found: Callable[..., Any] = getattr(
            importlib.import_module(f"ifrdem.kernels.{self._module}"), self._name
        )
        return found


def declared_names(kind: type, base: type) -> frozenset[str]:
    """Names of the data of classes, from `kind` up to `base`: those in class bodies, and those set in `__init__`."""
    found: set[str] = set()
    for one in kind.__mro__[: kind.__mro__.index(base)]:
        found |= inspect.get_annotations(one).keys()
        found |= {
            name
            for name, value in vars(one).items()
            if not isinstance(value, FromKernels) and not callable(getattr(one, name, value))
        }
        made = inspect.unwrap(vars(one).get("__init__", lambda: None))
        found |= {each.argval for each in dis.get_instructions(made) if each.opname == "STORE_ATTR"}
    return frozenset(name for name in found if not name.startswith("_") and not hasattr(base, name))


def check_signature(owner: str, function: Any, arguments: Sequence[str]) -> None:
    """Raise InputError unless a function that is to be compiled takes so many arguments."""
    given = list(inspect.signature(function).parameters.values())
    if len(given) != len(arguments) or any(each.kind != each.POSITIONAL_OR_KEYWORD for each in given):
        name, wanted = function.__name__, ", ".join(arguments)
        raise InputError(
            f"{owner}: {name}({', '.join(map(str, given))}): must be a static method {name}({wanted}), below a line "
            "@staticmethod"
        )


def why_not_compiled(
    error: Exception,
    functions: Sequence[Callable[..., Any]],
    owners: Mapping[str, Sequence[str]],
    returns: str,
) -> str:
    """Reason of a compilation error, with the line; for an unknown name or an index, the names that there are.

    Parameters
    ----------
    error : Exception
        What the compiler raised.
    functions : sequence of functions
        Those that were compiled; `owners` are their arguments in order, whatever the user calls them.
    owners : mapping of str to sequence of str
        The names that each argument has.
    returns : str
        What the functions must return.
    """
    text = str(error).strip()
    reason = text.splitlines()[-1].strip().rstrip(".").removeprefix("AssertionError").strip(": ")
    places = re.findall(r'File "(.*)", line (\d+), in (\w+):\n(.*)\n', text)
    names = {function.__name__ for function in functions}
    if not places or (places[-1][2] not in names and Path(places[-1][0]).is_relative_to(_PACKAGE)):
        return f"{returns}{f' ({reason})' if reason else ''}"
    file, number, function, source = places[-1]
    where = f"{Path(file).name}, line {number}, in {function}: {source.strip()}: "
    called = {
        name: owner
        for each in functions
        for name, owner in zip(inspect.signature(each).parameters, owners, strict=False)
    }
    if missing := re.search(r"(?:'Struct\d*' object has no attribute|no number) '(\w+)'", reason):
        name = missing[1]
        found = re.search(rf"\b({'|'.join(called)})\.{name}\b", source)
        of = {found[1]: owners[called[found[1]]]} if found else owners
        there = "; ".join(f"{owner} has {', '.join(has) or 'no names'}" for owner, has in of.items())
        spelling = nearest(name, [each for has in of.values() for each in has])
        return f"{where}there is no '{name}'{spelling}; {there}"
    if missing := re.fullmatch(r"KeyError: (.*)", reason):
        there = "; ".join(f"{owner} has {', '.join(has) or 'no names'}" for owner, has in owners.items())
        return f"{where}[{missing[1]}]: must be a name after a dot; {there}"
    return f"{where}{reason}"


_used: weakref.WeakKeyDictionary[type, dict[str, Any]] = weakref.WeakKeyDictionary()


def is_custom(kind: type) -> bool:
    """True if a class is not one of this package."""
    return kind.__module__.split(".")[0] != "ifrdem"


def check_constants(owner: str, kind: type, *methods: str) -> None:
    """Raise InputError if a variable from outside that methods of a custom class use has changed since their first use.

    The compiler takes numbers from outside as constants, so that a new value would have no effect.
    """
    if not is_custom(kind):
        return
    present = {name: value for method in methods for name, value in _constants(getattr(kind, method), set())}
    before = _used.setdefault(kind, present)
    for name, value in present.items():
        if repr(before.get(name)) != repr(value):
            raise InputError(
                f"{owner}: {name} = {value!r}: must stay {before.get(name)!r}: its value is compiled in at first use; "
                "make it a parameter of the class, which can change"
            )


@functools.cache
def _globals_in(code: CodeType) -> frozenset[str]:
    """Names of the global variables that a function reads; names of attributes are not among them."""
    return frozenset(each.argval for each in dis.get_instructions(code) if each.opname == "LOAD_GLOBAL")


def _constants(function: Any, visited: set[int]) -> Iterator[tuple[str, Any]]:
    """Names and values of the numbers from outside that a function uses, and those that it calls."""
    function = inspect.unwrap(function)
    if not isinstance(function, FunctionType) or id(function) in visited:
        return
    visited.add(id(function))
    code, outside = function.__code__, dict(function.__globals__)
    outside |= {
        name: cell.cell_contents
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True)
    }
    for name in (_globals_in(code) | {*code.co_freevars}) & outside.keys():
        value = outside[name]
        if isinstance(value, bool | int | float | tuple | np.generic | np.ndarray):
            yield name, value
        elif not isinstance(value, ModuleType | type) and str(getattr(value, "__module__", "")).split(".")[0] not in (
            "taichi", "quadrants", "ifrdem", "builtins",
        ):  # fmt: skip
            yield from _constants(value, visited)
