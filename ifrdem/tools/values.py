"""Checks of one value, a number or a word: the types of arguments, of keys of cases and of options alike.

An argument has one as its annotation (`tools.checked.validated`), a key of a case (`ifrdem.case`) as its type, where
pydantic calls it (`Keyed`), and an option of a command in `ifrdem.cli.options.option`: a value out of range gets the
same sentence from all three. NumPy is imported only for values of its own, so that commands start without it.
"""

from __future__ import annotations

import math
import sys
import typing
from dataclasses import dataclass, replace
from numbers import Integral
from numbers import Real as RealNumber
from typing import Annotated, Any, Literal, Protocol

from ..errors import InputError, Problem, nearest, shortened

LEAST, MOST = 1e-50, 1e50
"""Smallest and largest size of a number, other than 0: products of six such numbers can be computed with."""


def _is(value: object, kind: str) -> bool:
    """True if a value is of this class of NumPy, which is not imported for that."""
    numpy = sys.modules.get("numpy")
    return numpy is not None and isinstance(value, getattr(numpy, kind))


def must_be(name: str, value: object, needed: str) -> InputError:
    """The error of an argument that is not what is needed."""
    is_array = _is(value, "ndarray") and value.ndim > 0  # type: ignore[attr-defined]
    shown = f"array of shape {value.shape}" if is_array else shortened(value)  # type: ignore[attr-defined]
    return InputError(Problem(name, shown, f"must be {needed}"))


def number_of(text: str) -> float | None:
    """The number that a text is, NaN and infinity included; None if it is none. Not 1_000, which Python allows."""
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def whole_of(text: str) -> int | None:
    """The whole number that a text is, 1e5 as well as 100000; None if it is none."""
    number = number_of(text)
    if number is None or math.isnan(number):
        return None
    try:
        return int(text)  # not by way of a float, which would change long ones
    except ValueError:
        return int(number) if number.is_integer() else None


def is_number(value: object) -> bool:
    """True if a value is a real number, of Python's or NumPy's; truth values and spans of time are none."""
    # NumPy counts spans of time among its integers.
    return isinstance(value, RealNumber) and not (isinstance(value, bool) or _is(value, "timedelta64"))


def is_integer(value: object) -> bool:
    """True if a value is an integer by its type, of Python's or NumPy's."""
    return isinstance(value, Integral) and is_number(value)


def is_masked(value: Any) -> bool:
    """True if a value is a masked array. `numpy.ma` is not imported for lists and plain arrays."""
    derived = _is(value, "ndarray") and type(value) is not sys.modules["numpy"].ndarray
    return derived and sys.modules["numpy"].ma.isMaskedArray(value)


class Check(Protocol):
    """A check of one argument."""

    @property
    def needed(self) -> str:
        """Needed type and range, in words behind "must be"."""

    def __call__(self, name: str, value: Any) -> Any:
        """The value as the function needs it; InputError if it is something else."""


def _number_in(value: Any) -> Any:
    """The number in an array without axes or of a type of NumPy, as one of Python; anything else unchanged.

    NumPy rounds bounds to the type of its own numbers: 1e50 is infinite as a float32.
    """
    if _is(value, "ndarray") and value.shape == () and not is_masked(value):
        value = value[()]
    if _is(value, "floating"):
        return float(value)
    return int(value) if _is(value, "integer") and is_number(value) else value


class Keyed:
    """A check that a key of a case has as its type, too: pydantic calls it, and its message is that of the check."""

    def __call__(self, name: str, value: Any) -> Any:
        """As `Check`."""
        raise NotImplementedError

    def read(self, text: str) -> Any:
        """What a text stands for; the text itself if that is nothing, which the check refuses."""
        return text

    def of_text(self, name: str, text: str) -> Any:
        """The checked value of a text; InputError quotes the text."""
        try:
            return self(name, self.read(text))
        except InputError as error:
            raise InputError(Problem(name, text, error.reason)) from None

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> Any:
        from pydantic_core import PydanticCustomError, core_schema

        def checks(value: Any) -> Any:
            try:
                return self("", value)
            except InputError as error:
                raise PydanticCustomError("needed", "{text}", {"text": error.reason}) from None

        return core_schema.no_info_plain_validator_function(checks)


@dataclass(frozen=True)
class Number(Keyed):
    """Check of a real number from `low` to `high`, or 0 where `zero`, or NaN where `gaps`; it passes as a float.

    With `units` it is the number of something with a unit: of one that is too large or too small the message says that
    other units help.
    """

    low: float
    high: float
    needed: str
    zero: bool = False
    gaps: bool = False
    units: bool = False

    def read(self, text: str) -> Any:
        """The number of a text."""
        found = number_of(text)
        return text if found is None else found

    def __call__(self, name: str, value: Any) -> float:
        if type(value) is float and self.low <= value <= self.high:
            return value
        number = _number_in(value)
        if not (
            is_number(number)
            and (
                self.low <= number <= self.high
                or (self.zero and number == 0)
                or (self.gaps and number != number)
            )
        ):
            # Where nothing but the sign is wrong, the limits of sizes are of no use.
            is_negative = self.zero and is_number(number) and self.low <= -number <= self.high
            needed = "0 or more" if is_negative else f"{self.needed}{self._remedy(number)}"
            raise must_be(name, value, needed)
        try:
            return float(number)
        except OverflowError:  # a whole number below infinity
            raise must_be(name, value, self.needed) from None

    def _remedy(self, number: Any) -> str:
        """What helps if nothing but its size is wrong with a number that has a unit."""
        sized = self.units and is_number(number) and 0 < abs(number) < math.inf
        return ": choose other units" if sized and self.low <= (1.0 if number > 0 else -1.0) else ""


@dataclass(frozen=True)
class Integer(Keyed):
    """Check of a whole number from `low` to `high`, which passes as an int; 3.0 is one."""

    low: int
    high: int = 2**31 - 1

    def read(self, text: str) -> Any:
        """The whole number of a text."""
        found = whole_of(text)
        return text if found is None else found

    @property
    def needed(self) -> str:
        return "an integer" if self.low <= -(2**63) else f"an integer from {self.low} to {self.high}"

    def __call__(self, name: str, value: Any) -> int:
        number = _number_in(value)
        if not (is_number(number) and self.low <= number <= self.high and number == int(number)):
            raise must_be(name, value, self.needed)
        return int(number)


@dataclass(frozen=True)
class Choice(Keyed):
    """Check of a text that is one of those allowed."""

    allowed: tuple[Any, ...]

    @property
    def needed(self) -> str:
        return f"one of {', '.join(map(repr, self.allowed))}"

    def __call__(self, name: str, value: Any) -> Any:
        if not isinstance(value, str) or value not in self.allowed:
            raise must_be(name, value, self.instead_of(value))
        return value

    def instead_of(self, value: object) -> str:
        """What is needed in place of a value: those allowed, and the nearest one."""
        return f"{self.needed}{nearest(value, self.allowed) if isinstance(value, str) else ''}"


FINITE = Number(-MOST, MOST, f"a finite number, at most {MOST:g} in size", units=True)
POSITIVE = Number(LEAST, MOST, f"a positive number from {LEAST:g} to {MOST:g}", units=True)
NON_NEGATIVE = replace(POSITIVE, needed=f"0, or a number from {LEAST:g} to {MOST:g}", zero=True)
RATIO = replace(POSITIVE, units=False)
FRACTION = Number(0.0, 1.0, "a number from 0 to 1")
PART = Number(1e-15, 1.0 - 1e-15, "a number above 0 and below 1, by 1e-15 or more")
E_N = replace(FRACTION, needed="a number from 0 to 1; above 1, collisions would add energy")
E_T = Number(-1.0, 1.0, "a number from -1 to 1; beyond, collisions would add energy")
RATIO_OR_ZERO = MU = replace(NON_NEGATIVE, units=False)
"""Checks of the types below. E_N, E_T and MU are of the coefficients of laws: normal and tangential restitution, and
friction."""


def check_in(kind: Any) -> Check | None:
    """The check that an annotation names: of `Annotated`, or of the words of a `Literal`; None of others."""
    if typing.get_origin(kind) is Literal:
        return Choice(typing.get_args(kind))
    if typing.get_origin(kind) is Annotated:
        found: Check = next(one for one in kind.__metadata__ if callable(one))
        return found
    return None


Real = Annotated[float, FINITE]
Positive = Annotated[float, POSITIVE]
NonNegative = Annotated[float, NON_NEGATIVE]
Ratio = Annotated[float, RATIO]
RatioOrZero = Annotated[float, RATIO_OR_ZERO]
Fraction = Annotated[float, FRACTION]
Part = Annotated[float, PART]
Packed = Annotated[float, Number(1e-12, 0.9, "a number above 0 (from 1e-12) to 0.9")]
NormalRestitution = Annotated[float, E_N]
TangentialRestitution = Annotated[float, E_T]
Friction = Annotated[float, MU]
Whole = Annotated[int, Integer(-(2**63), 2**63 - 1)]
Natural = Annotated[int, Integer(0, 2**63 - 1)]
Count = Annotated[int, Integer(1)]
Seed = Annotated[int, Integer(0, 2**64 - 1)]
Several = Annotated[int, Integer(2, 10_000)]
"""Numbers as public functions, keys of cases and options need them. `Ratio` is a positive pure number, `Part` a part of
something, `Packed` a packing fraction of theory, `Natural` a whole number of 0 or more, `Several` enough for a spread."""
