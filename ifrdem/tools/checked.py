"""Checks of users' numbers and other values by type and range, with errors that name the argument, key or option.

`validated` checks the arguments of a public function or class by its annotations, once for all of them: `Positive`,
`Fraction`, `Vectors` and others below, classes, `Literal`, `bool`, `X | None`. Functions get float, int or float64
arrays; float64 arrays are not copied. The same types are those of keys of cases (`ifrdem.case`), where pydantic calls
their checks (`Keyed`), and of options of commands (`ifrdem.cli.options.option`): a value out of range gets the same
sentence from all three.

Three numbers cost 1.6 us a call of a function that is `validated`, 1.4 us by pydantic's `validate_call` with these
checks, and 0.5 us with pydantic's own strict types. Those refuse "0.5" and True too, but they refuse whole numbers that
users have (`np.int32(3)`, `np.int64(3)`, 3.0, an array without axes), take `np.True_`, `Decimal` and masked arrays for
numbers, know no arrays of numbers with a shape, and their messages do not say the whole range.
"""

from __future__ import annotations

import ast
import builtins
import collections
import functools
import inspect
import itertools
import math
import os
import re
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, there_are
from ..mpi import Communicator, current
from .values import (  # noqa: F401  (the types of numbers have one place for all who check arguments)
    E_N,
    E_T,
    FINITE,
    FRACTION,
    LEAST,
    MOST,
    MU,
    NON_NEGATIVE,
    PART,
    POSITIVE,
    RATIO,
    Check,
    Choice,
    Count,
    Fraction,
    Friction,
    Integer,
    Keyed,
    Natural,
    NonNegative,
    NormalRestitution,
    Number,
    Packed,
    Part,
    Positive,
    Ratio,
    Real,
    Seed,
    TangentialRestitution,
    Whole,
    check_in,
    is_integer,
    is_masked,
    is_number,
    must_be,
    number_of,
    whole_of,
)  # fmt: skip

Array = NDArray[np.float64]
"""An array of float64."""


MOST_OF_PATH, MOST_OF_NAME = 4095, 255
"""Bytes of a path, and of the name of a file or folder, at most: on Linux, in nearly all file systems."""


@dataclass(frozen=True)
class Numbers:
    """Check of an array of real numbers from `low` to `high`, or 0 where `zero`; it passes as one of float64.

    `shape` has a number or a letter for each axis, "..." first for any number of them; None allows any shape, `scalar`
    a number as well. There are `least` values or more; with `gaps`, NaN marks one that is missing.
    """

    shape: tuple[int | str, ...] | None = None
    low: float = -MOST
    high: float = MOST
    each: str = f"finite, at most {MOST:g} in size"
    scalar: bool = False
    least: int = 0
    zero: bool = False
    gaps: bool = False

    @property
    def needed(self) -> str:
        if self.shape is None:
            return "an array of real numbers"
        axes = ", ".join(map(str, self.shape)) + ("," if len(self.shape) == 1 else "")
        some = f", {self.least} or more," if self.least else ""
        return f"{'a real number or ' if self.scalar else ''}an array of real numbers{some} of shape ({axes})"

    def typed(self, name: str, value: Any) -> NDArray[Any]:
        """The value as an array of real numbers of its own type, of any shape."""
        found = value if type(value) is np.ndarray else self._as_array(name, value)
        if found.dtype.kind not in "iuf" and found.size:
            what = "complex numbers" if found.dtype.kind == "c" else f"values of type {found.dtype}"
            raise must_be(name, value, f"{self.needed}, not {what}")
        return found

    def __call__(self, name: str, value: Any) -> Array:
        found = self.typed(name, value)
        if not self._fits(found.shape) or found.size < self.least:
            raise InputError(f"{name} has shape {found.shape}: must be {self.needed}")
        one_for_all = self.scalar and found.ndim == 1 and found.strides == (0,) and found.dtype == np.float64
        if not one_for_all:  # which is as good as a number
            with np.errstate(over="ignore"):  # of longer types: infinite, and refused below
                found = np.asarray(found, dtype=np.float64, order="C")
        within = not found.size or (found.min() >= self.low and found.max() <= self.high)
        if not within and (invalid := refused(self, found)).any():
            where = tuple(int(i) for i in np.argwhere(invalid)[0])
            index = f"[{', '.join(map(str, where))}]" if where else ""
            raise InputError(f"{name}{index} = {found[where]}: must be {self.each}")
        return found

    def _as_array(self, name: str, value: Any) -> NDArray[Any]:
        if is_masked(value):
            raise InputError(f"{name} is a masked array: must be without mask (fill it, or leave values out)")
        if isinstance(value, str | bytes | Mapping | type(None)):
            raise must_be(name, value, self.needed)
        try:
            return np.asarray(value)
        except ValueError:  # rows of different lengths
            raise must_be(name, value, self.needed) from None

    def _fits(self, shape: tuple[int, ...]) -> bool:
        if self.shape is None or (self.scalar and shape == ()):
            return True
        if self.shape[0] == "...":
            return shape[1 - len(self.shape) :] == self.shape[1:]
        pairs = zip(self.shape, shape, strict=False)
        return len(shape) == len(self.shape) and all(isinstance(one, str) or one == n for one, n in pairs)


def refused(check: Number | Numbers, values: Array) -> NDArray[np.bool_]:
    """True for each value of an array that is out of the range of a check; of the shape of `values`."""
    right = (values >= check.low) & (values <= check.high)
    return ~(right | (check.zero & (values == 0.0)) | (check.gaps & np.isnan(values)))


@dataclass(frozen=True)
class Integers(Numbers):
    """Check of an array of whole numbers; it passes as one of int64."""

    low: float = -(2.0**31)
    high: float = 2.0**31 - 1.0

    @property
    def needed(self) -> str:
        return super().needed.replace("real numbers", "integers").replace("real number", "integer")

    def __call__(self, name: str, value: Any) -> Any:
        found = super().__call__(name, value)
        invalid = found != np.floor(found)
        if invalid.any():
            raise InputError(f"{name} has {found[invalid][0]}: must be {self.needed}")
        return found.astype(np.int64)


@dataclass(frozen=True)
class Instance:
    """Check of an object of one of some classes."""

    kinds: tuple[type, ...]

    @property
    def needed(self) -> str:
        if bool in self.kinds:
            return "True or False"
        names = list(dict.fromkeys(_NAMES.get(kind, kind.__name__) for kind in self.kinds))
        return " or ".join(f"a{'n' * (name[0] in 'AEIOaeio')} {name}" for name in names)

    def __call__(self, name: str, value: Any) -> Any:
        if not isinstance(value, self.kinds):
            raise must_be(name, value, self.needed)
        return value


@dataclass(frozen=True)
class PathOfFile:
    """Check of a path: a text or an `os.PathLike`, not empty, without NUL, and no longer than file systems take."""

    needed: str = "a text or a path, not empty and without NUL characters"

    def __call__(self, name: str, value: Any) -> Any:
        if not isinstance(value, str | os.PathLike) or not (text := os.fspath(value)) or "\0" in str(text):
            raise must_be(name, value, self.needed)
        try:
            whole = os.fsencode(text)
        except UnicodeEncodeError:
            raise must_be(name, str(text), "a path that the file system can write") from None
        if len(whole) > MOST_OF_PATH or max(map(len, re.split(rb"[/\\]", whole))) > MOST_OF_NAME:
            needed = f"a path of {MOST_OF_PATH} bytes at most, each name of {MOST_OF_NAME}"
            raise must_be(name, str(text), needed)
        return value


_NAMES: dict[type, str] = {str: "text", os.PathLike: "path", Callable: "function"}  # type: ignore[dict-item]


@dataclass(frozen=True)
class Each:
    """Check of a sequence (of `length` if given), or of any iterable if `what` is another name; gives a tuple.

    A key of a case that has it as its type is a list of values that `one` checks.
    """

    one: Check | None
    what: str = "sequence"
    length: int | None = None

    @property
    def needed(self) -> str:
        size = f" of {self.length}" if self.length is not None else ""
        return f"a {self.what}{size}{f', each {self.one.needed}' if self.one else ''}"

    def __call__(self, name: str, value: Any) -> tuple[Any, ...]:
        if is_masked(value):
            raise InputError(f"{name} is a masked array: must be without mask (fill it, or leave values out)")
        plain = isinstance(value, Sequence | np.ndarray if self.what == "sequence" else Iterable)
        if (
            not plain
            or isinstance(value, str | bytes | Mapping | type)
            or (isinstance(value, np.ndarray) and value.ndim == 0)
        ):
            raise must_be(name, value, self.needed)
        found = tuple(value)
        if self.length is not None and len(found) != self.length:
            raise must_be(name, value, self.needed)
        return tuple(self.one(f"{name}[{i}]", each) for i, each in enumerate(found)) if self.one else found

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        assert isinstance(self.one, Keyed)
        one = self.one.__get_pydantic_core_schema__(source, handler)
        return core_schema.list_schema(one, min_length=self.length, max_length=self.length, strict=True)


@dataclass(frozen=True)
class Entries:
    """Check of a mapping from texts to values; gives a dict."""

    one: Check | None
    named: bool = True  # keys must be texts

    @property
    def needed(self) -> str:
        return f"a mapping of names{f', each value {self.one.needed}' if self.one else ''}"

    def __call__(self, name: str, value: Any) -> dict[Any, Any]:
        if not isinstance(value, Mapping):
            raise must_be(name, value, self.needed)
        if self.named and (wrong := [key for key in value if not isinstance(key, str)]):
            raise must_be(f"key of {name}", wrong[0], "a name (a text)")
        return {key: self.one(f"{name}[{key!r}]", each) if self.one else each for key, each in value.items()}


@dataclass(frozen=True)
class AnyOf:
    """Check of a value that one of several checks allows; for a list, the error of a sequence's check is raised."""

    checks: tuple[Check, ...]

    @property
    def needed(self) -> str:
        return " or ".join(one.needed for one in self.checks)

    def __call__(self, name: str, value: Any) -> Any:
        invalid = must_be(name, value, self.needed)
        for one in self.checks:
            try:
                return one(name, value)
            except InputError as error:
                if isinstance(one, Each) and isinstance(value, list | tuple):
                    invalid = error
        raise invalid


@dataclass(frozen=True)
class Optional:
    """Check of None, or of what another check allows."""

    one: Check

    @property
    def needed(self) -> str:
        return f"{self.one.needed}, or None"

    def __call__(self, name: str, value: Any) -> Any:
        return None if value is None else self.one(name, value)


PAIR = Each(FINITE, "sequence", 2)
NUMBERS = Numbers(low=-math.inf, high=math.inf, each="a number", gaps=True)
"""Checks that functions call by themselves, and those of the types below; of NUMBERS infinities and NaN pass.

E_N, E_T and MU are of the coefficients of laws: normal and tangential restitution, and friction.
"""


def integer(name: str, value: Any, low: int, high: int = 2**63 - 1) -> int:
    """A whole number from `low` to `high` as an int; 3.0 is one."""
    return Integer(low, high)(name, value)


def choice(name: str, value: Any, allowed: Iterable[str]) -> str:
    """A text that is one of those allowed."""
    found: str = Choice(tuple(allowed))(name, value)
    return found


def instance(name: str, value: Any, kind: type) -> None:
    """Refuse an object of another class."""
    Instance((kind,))(name, value)


def path(name: str, value: Any) -> Path:
    """The path of a file."""
    return Path(PathOfFile()(name, value))


def array(name: str, value: Any, shape: tuple[int, ...] | None = None) -> Array:
    """A contiguous array of real numbers in double precision, of the given shape if one is given."""
    return (NUMBERS if shape is None else replace(NUMBERS, shape=shape))(name, value)


def column(name: str, value: Any, n: int) -> Array:
    """An array (n,) of real numbers in double precision, its own; a number stands for all."""
    return np.array(rows(name, value, n), dtype=np.float64)


def rows(name: str, value: Any, n: int) -> Array:
    """An array (n,) of real numbers in double precision, to be read; a number stands for all, in the memory of one."""
    found = NUMBERS.typed(name, value)
    if found.shape not in ((), (1,), (n,)):
        raise InputError(f"{name} has shape {found.shape}: must be a number or an array of shape {(n,)}")
    return np.broadcast_to(np.asarray(found, dtype=np.float64), (n,))


def integers(
    name: str, value: Any, shape: tuple[int, ...], *, least: int = 0, broadcast: bool = False
) -> NDArray[np.int32]:
    """An array of whole numbers of 32 bits, none below `least`, its own only if they were of another type."""
    found = NUMBERS.typed(name, value)
    if found.dtype.kind == "f" and found.dtype != np.float64:
        found = NUMBERS(name, value)  # NumPy rounds bounds to the type of its own numbers
    if found.shape != shape and not (broadcast and found.shape in ((), (1,))):
        raise InputError(f"{name} has shape {found.shape}: must be an array of integers of shape {shape}")
    if found.dtype != np.int32 or (found.size and least > np.iinfo(np.int32).min):
        most = np.iinfo(np.int32).max
        with np.errstate(invalid="ignore"):
            invalid = ~((found >= least) & (found <= most) & (found == np.floor(found)))
        if np.any(invalid):
            where = tuple(int(axis) for axis in np.argwhere(invalid)[0])
            index = f"[{', '.join(map(str, where))}]" if where else ""
            raise InputError(f"{name}{index} = {found[where]}: must be an integer from {least} to {most}")
    return np.ascontiguousarray(np.broadcast_to(found, shape), dtype=np.int32)


Pair = Annotated[tuple[float, float], PAIR]
"""A vector."""
Comm = Annotated[Any, lambda _name, value: Communicator.of(value)]
"""Ranks of MPI, or None."""

_POSITIVE: Any = {"low": LEAST, "each": f"positive, from {LEAST:g} to {MOST:g}"}
_NOT_NEGATIVE: Any = {"low": LEAST, "each": f"0, or from {LEAST:g} to {MOST:g}", "zero": True}
FiniteArray = Annotated[ArrayLike, Numbers()]
NonNegativeArray = Annotated[ArrayLike, Numbers(**_NOT_NEGATIVE)]
PositiveArray = Annotated[ArrayLike, Numbers(**_POSITIVE)]
Moments = Annotated[float | NDArray[np.float64], Numbers()]
Column = Annotated[ArrayLike, Numbers(("n",))]
PositiveColumn = Annotated[ArrayLike, Numbers(("n",), **_POSITIVE)]
NonNegativeColumn = Annotated[ArrayLike, Numbers(("n",), **_NOT_NEGATIVE)]
Places = Annotated[NDArray[np.float64], Numbers(("...", 2))]
Images = Annotated[NDArray[np.int32], Numbers(("...", 2))]
Vectors = Annotated[ArrayLike, Numbers(("n", 2))]
Measurements = Annotated[
    NDArray[np.float64], Numbers(("n",), -math.inf, math.inf, "a number", scalar=True, gaps=True)
]
Lines = Annotated[NDArray[np.int64], Integers(("n",), 0)]
PositivePerDisk = Annotated[ArrayLike, Numbers(("n",), scalar=True, **_POSITIVE)]
NonNegativePerDisk = Annotated[ArrayLike, Numbers(("n",), scalar=True, **_NOT_NEGATIVE)]
"""Arrays as public functions need them; "per disk" is an array (n,), or a number for all."""

_SIMPLE: dict[Any, Check] = {
    float: FINITE,
    int: Integer(-(2**63), 2**63 - 1),
    bool: Instance((bool, np.bool_)),
    ArrayLike: Numbers(),
    Array: Numbers(),
}


def _later(_name: str, value: Any) -> Any:
    return value


LATER = _later
"""No check: the function checks the argument itself, such as one that only the first rank gives."""


def check_of(annotation: Any) -> Check | None:
    """The check for an annotation; None if any value is allowed."""
    if annotation is Any or isinstance(annotation, TypeVar):
        return None
    if (named := check_in(annotation)) is not None:
        return named
    for simple, check in _SIMPLE.items():
        if annotation == simple:
            return check
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if hasattr(
        alias := origin or annotation, "__value__"
    ):  # `type NDArray = ...` of NumPy 2.5, with Python 3.12
        return check_of(alias.__value__[parts] if parts else alias.__value__)
    if origin in (Union, types.UnionType):
        some = [check_of(part) for part in parts if part is not type(None)]
        if None in some:
            return None
        checks = tuple(one for one in some if one is not None)
        kinds = [one.kinds for one in checks if isinstance(one, Instance)]
        if len(kinds) == len(checks):
            together = tuple(itertools.chain(*kinds))
            checks = (Instance(together),)
            if {str, os.PathLike} <= {*together}:
                others = tuple(kind for kind in together if kind not in (str, os.PathLike))
                checks = (PathOfFile(), *[Instance(others)] * bool(others))
        found = checks[0] if len(checks) == 1 else AnyOf(checks)
        return Optional(found) if type(None) in parts else found
    if origin in (Sequence, tuple, list, Iterable):
        if origin is tuple and parts[-1] is not Ellipsis:
            return Each(check_of(parts[0]), length=len(parts))  # of one kind each here
        return Each(check_of(parts[0]), "sequence" if origin is not Iterable else "list")
    if origin is Mapping:
        return Entries(check_of(parts[1]), named=parts[0] is str)
    if origin is np.ndarray:  # of whole numbers: the function makes it one
        return None
    if origin is type:
        return Instance((type,))
    return Instance((origin or annotation,))


F = TypeVar("F", bound=Callable[..., Any])


VALIDATED: list[Callable[..., Any]] = []
"""Functions whose arguments are checked."""


def validated(function: F) -> F:
    """Check the arguments of a function, or of a class when it is made, by their annotations.

    InputError names the argument, its value, and what it must be. Arguments without an annotation, or annotated by
    `Any`, are not checked. Each rank of MPI (`comm`, or those of a `collective` function) checks its own;
    an error on one is raised on all.
    """
    if isinstance(function, type):
        function.__init__ = validated(function.__init__)  # type: ignore[misc]
        return function
    VALIDATED.append(function)
    by_name: dict[str, Check] = {}
    in_order: list[tuple[int, str, Check]] = []

    others: list[Check] = []  # of **options
    made: dict[str, tuple[int, Any]] = {}  # defaults that a check converts, and their positions
    known: set[str] = set()
    is_read = takes_others = False
    collective = hasattr(function, "collective")

    def read() -> None:
        """Read the annotations, at the first call: the module may define their names further below."""
        # Classes that only type checkers import are not checked here, but by the function itself. That all other names
        # are there is a test.
        only_types = collections.defaultdict(lambda: Any)  # type: ignore[var-annotated]
        nonlocal is_read, takes_others
        is_read = True
        names = collections.ChainMap(function.__globals__, vars(builtins), only_types)
        parameters = inspect.signature(function).parameters
        known.update(name for name, one in parameters.items() if one.kind is not one.VAR_KEYWORD)
        for i, one in enumerate(parameters.values()):
            hint = eval(one.annotation, {}, names) if isinstance(one.annotation, str) else one.annotation
            if typing.get_origin(hint) is typing.Unpack:  # of names that what takes them checks
                (listed,) = typing.get_args(hint)
                known.update(listed.__optional_keys__ | listed.__required_keys__)
                continue
            takes_others = takes_others or one.kind is one.VAR_KEYWORD
            if hint is one.empty or one.kind is one.VAR_POSITIONAL:
                continue
            check = check_of(hint)
            if check is None:
                continue
            if one.kind is one.VAR_KEYWORD:
                others.append(check)
                continue
            by_name[one.name] = Optional(check) if one.default is None else check
            if one.kind is not one.KEYWORD_ONLY:
                in_order.append((i, one.name, by_name[one.name]))
            if inspect.isfunction(check) and one.default not in (None, one.empty):
                made[one.name] = i, check(one.name, one.default)

    def check_all(values: list[Any], options: dict[str, Any]) -> None:
        for i, name, check in in_order:
            if i >= len(values):
                break
            values[i] = check(name, values[i])
        for name in options:
            if name not in known and not takes_others:
                of, names = function.__qualname__.removesuffix(".__init__"), known - {"self", "cls"}
                raise InputError(f"{of}: unknown argument {name!r}{there_are(name, sorted(names))}")
            for check in [by_name[name]] if name in by_name else others if name not in known else []:
                options[name] = check(name, options[name])

    @functools.wraps(function)
    def checking(*arguments: Any, **options: Any) -> Any:
        if not is_read:
            read()
        values = list(arguments)
        given = options.get("comm")
        comm = current() if collective and given is None else Communicator.of(given)
        if comm.size == 1:
            check_all(values, options)
        else:  # an error on one rank is one on all
            if collective:
                comm.require_same_call(f"calls {function.__qualname__}")
            comm.run_on_all(lambda: check_all(values, options))
        for name, (i, value) in made.items():
            if i >= len(values) and name not in options:
                options[name] = value
        try:
            return function(*values, **options)
        except MemoryError as error:
            of = function.__qualname__.removesuffix(".__init__")
            raise InputError(
                f"{of}: not enough memory for what was asked: {str(error) or 'no more is free'}"
            ) from error

    if any(isinstance(one, str) and "Annotated[" in one for one in function.__annotations__.values()):
        checking.__signature__ = _without_checks(function)  # type: ignore[attr-defined]
    return checking  # type: ignore[return-value]


class _WithoutChecks(ast.NodeTransformer):
    """Types in place of `Annotated[type, check]`."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """The first part of an `Annotated`."""
        self.generic_visit(node)
        is_checked = isinstance(node.value, ast.Name) and node.value.id == "Annotated"
        return node.slice.elts[0] if is_checked and isinstance(node.slice, ast.Tuple) else node


def _without_checks(function: Callable[..., Any]) -> inspect.Signature:
    """The signature of a function as `help` shows it: types without their checks."""
    found = inspect.signature(function)
    parameters = []
    for one in found.parameters.values():
        hint = one.annotation
        if isinstance(hint, str):
            hint = ast.unparse(_WithoutChecks().visit(ast.parse(hint, mode="eval")))
        parameters.append(one.replace(annotation=hint))
    return found.replace(parameters=parameters)
