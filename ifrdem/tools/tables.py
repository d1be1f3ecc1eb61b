"""Tables of measured values with arbitrary names, units, decimal commas, gaps and comments."""

from __future__ import annotations

import difflib
import itertools
import math
import os
import re
from array import array
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, counted, cut, nearest, option_name, printable, refuse
from ..mpi import current
from . import csv as csv_rows
from . import text_file
from .checked import number_of, validated

Array = NDArray[np.float64]

MOST_BYTES = 100_000_000
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "angle": {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "rad": math.degrees(1.0), "radian": math.degrees(1.0), "radians": math.degrees(1.0), "mrad": math.degrees(1e-3)},
        "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "micron": 1e-6},
        "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6},
        "spin": {"rad/s": 1.0, "1/s": 1.0, "deg/s": math.radians(1.0), "rpm": math.pi / 30.0, "rev/s": 2.0 * math.pi},
        "time": {"s": 1.0, "sec": 1.0, "ms": 1e-3},
        "mass": {"kg": 1.0, "g": 1e-3},
        "direction": {"rad": 1.0, "deg": math.radians(1.0), "mrad": 1e-3},
        "number": {"1": 1.0},
        "text": {"1": 1.0},
    }
)  # fmt: skip
"""Factor of each unit by the kind of a column: angles become degrees, everything else SI units. A "direction" may have an
error alone, because other columns give it."""
SI_UNITS = "SI units"
"""Words of a comment above the names of columns, by which the columns of a table have SI units without naming them."""
_DIMENSIONAL = ("length", "velocity", "spin", "mass")

ERROR_WORDS = ("error", "err", "sigma", "uncertainty", "std")
COVARIANCE = "cov:"
"""Start of the name cov:A:B of the covariance of two columns."""
_MISSING = ("", "nan", "na", "n/a", "-", "none", "null")
_DELIMITERS = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
_EVERY_UNIT = {unit for units in UNITS.values() for unit in units}
_WITH_UNITS = UNITS.keys() - {"number", "text"}
_MICRO = str.maketrans("\u00b5\u03bc", "uu")  # the micro sign and the Greek letter
_BRACKETS = re.compile(r"[\[(]([^\[(]*)[\])]\s*$")
_VALUE = re.compile(r" = .*?(?=: must)")
_REPEATED = 5  # mistakes of one kind that are listed
_NEARLY_ALIKE = 0.8  # of a column that is rather misspelt than another


@dataclass(frozen=True, eq=False)
class ReadTable:
    """Columns of a file."""

    # (n,): values in standard units by standard names, NaN where one is missing; errors as NAME_error
    columns: Mapping[str, Array]
    line: NDArray[np.int64]  # (n,): lines of the file
    rows: int  # number of all rows of the file, of which a rank has those of its slice
    missing: int  # number of values that are missing
    unused: tuple[str, ...]  # columns of the file that no name stands for
    source: str  # the file
    # texts of columns of the kind "text", whose values are indices of them; the same for all such columns
    texts: tuple[str, ...] = ()
    si: bool = False  # True if units are stated of all columns of lengths, velocities, spins and masses, or by a comment

    def __len__(self) -> int:
        return len(self.line)


@validated
@dataclass(frozen=True)
class TableFormat:
    """The format of a table file, where it differs from commas, points and the standard names.

    Examples
    --------
    >>> from ifrdem import fit
    >>> from pathlib import Path
    >>> _ = Path("winkel.csv").write_text("Winkel;delta_1\\n12,5;40,1\\n60;70,5\\n")
    >>> form = fit.TableFormat(columns={"psi": "Winkel"}, delimiter=";", decimal=",")
    >>> fit.read("winkel.csv", {"angles": 0.5}, form=form).psi
    array([12.5, 60. ])
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    """Header of the file for a standard name."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of a column by its standard name, or a factor; um may be written with the micro sign."""
    known: Mapping[str, float] = field(default_factory=dict)
    """Values that every line has, exactly, in standard units."""
    delimiter: str = ","
    decimal: str = "."
    """delimiter, decimal: one character that separates columns, and one that separates decimals."""

    def __post_init__(self) -> None:
        problems = []
        if len(self.delimiter) != 1:
            problems.append(f"delimiter = {self.delimiter!r}: must be one character")
        if self.decimal not in (".", ","):
            problems.append(f"decimal = {self.decimal!r}: must be one character, . or ,")
        if not problems and self.delimiter == self.decimal:
            problems.append(f"delimiter and decimal are both {self.delimiter!r}: they must differ")
        refuse(problems)
        units = {name: unit.translate(_MICRO) for name, unit in self.units.items()}
        object.__setattr__(self, "units", units)


Setting = Callable[[str, str, str], str]


def no_setting(_key: str, _value: str, _name: str) -> str:
    """For files whose form nothing sets."""
    return ""


def _setting(key: str, value: str, name: str) -> str:
    """Text that sets a key of the format to a value, of `columns` for a name: an option of `fit`, or an argument."""
    if name:
        return option_name(f"--column {name}='{value}'", f"columns = {{{name!r}: {value!r}}}")
    return option_name(f"--{key} {'tab' if value == chr(9) else value!r}", f"{key} = {value!r}")


def read(
    path: str | os.PathLike[str],
    kinds: Mapping[str, str],
    spellings: Mapping[str, str],
    form: TableFormat = TableFormat(),
    *,
    most: int = MOST_BYTES,
    most_problems: int = 100,
    gaps: bool = True,
    n: int = 0,
    setting: Setting = _setting,
) -> ReadTable:
    """Read a table.

    Raises InputError with a line for each column or value that is wrong.

    Parameters
    ----------
    path : path
        A CSV file; its first line that is no comment names the columns.
    kinds : mapping of str to str
        Kind of unit, a key of `UNITS`, of each standard name.
    spellings : mapping of str to str
        Standard name of other spellings, in small letters and without signs and blanks.
    form : TableFormat, optional
        The writing of the file.
    most : int
        Largest size of the file [bytes].
    most_problems : int
        Wrong lines that are listed one by one.
    gaps : bool
        Values may be missing (empty, nan, NA, ...); else such a one is wrong.
    n : int
        Of ranks of MPI: the number of rows that are needed. Each gets those of its slice (`Communicator`), and the last
        one also what is there beyond; all raise the same.
    setting : callable
        Text that sets a key of the format to a value, of `columns` for a name, where a message advises it.
    """
    path = Path(path)
    source = str(path)
    form = _standard_names(path, kinds, spellings, form, most)
    _check_format(source, form, kinds)
    comm = current()
    own, last = comm.slice_of(n), comm.rank == comm.size - 1

    def parsed() -> tuple[ReadTable, list[str], int]:
        commented = _says_si(path, most)
        rows = csv_rows.each(path, most=most, delimiter=form.delimiter)
        header, at = next(rows, ([], 0))
        if not header:
            raise InputError("is empty: must have a first line with the names of the columns")
        names, factors, unused, stated = _header(at, header, kinds, spellings, form, setting)
        values = {name: array("d") for name in names if name}
        lines, problems = array("q"), list[str]()
        texts: dict[str, int] = {}
        is_text = [kinds.get(name) == "text" for name in names]
        count = missing = total = 0
        repeated = Counter[str]()
        for row, line in rows:
            total += 1
            if total <= own.start or not (total <= own.stop or last):
                continue
            lines.append(line)
            if len(row) == len(names):
                row = [
                    str(texts.setdefault(text.strip(), len(texts))) if coded else text
                    for text, coded in zip(row, is_text, strict=True)
                ]
            row_problems, lacking = _add(row, header, names, factors, values, form, setting, gaps=gaps)
            missing += lacking
            for each in row_problems:
                alike = _VALUE.sub("", each)
                repeated[alike] += 1
                if n or repeated[alike] <= _REPEATED:  # slices of ranks do not know each other's
                    count += 1
                    problems += [f"line {line}: {each}"] * (len(problems) < most_problems)
        if not n:
            more = [f"{i - _REPEATED} more lines: {text}" for text, i in repeated.items() if i > _REPEATED]
            problems, count = problems + more, count + len(more)
        if not total:
            raise InputError("no line of values follows the names of the columns")
        columns = {name: np.array(each) for name, each in values.items()}
        columns |= {name: np.full(len(lines), value) for name, value in form.known.items()}
        numbers = np.array(lines, dtype=np.int64)
        return (
            ReadTable(
                columns, numbers, total, missing, tuple(unused), source, tuple(texts), si=stated or commented
            ),
            problems,
            count,
        )

    try:
        table, problems, count = comm.run_on_all(parsed)
    except InputError as error:
        raise InputError("\n".join(f"{source}: {line}" for line in str(error).splitlines())) from None
    problems, count = comm.first_texts(problems, count, most_problems)
    refuse(problems, source, most_problems, count)
    return table


def _add(
    row: Sequence[str], header: Sequence[str], names: Sequence[str], factors: Sequence[float],
    values: Mapping[str, array[float]], form: TableFormat, setting: Setting, *, gaps: bool,
) -> tuple[list[str], int]:  # fmt: skip
    """Add a row to the values; return its errors, and the number of missing values."""
    if len(row) != len(names):
        count = f"{counted(len(row), 'value')}: must be {len(names)}"
        return [f"{count} ({cut(', '.join(header), 300)})"], 0
    problems, missing = [], 0
    used = [text.strip() for name, text in zip(names, row, strict=True) if name]
    words = [text for text in used if text.lower() not in _MISSING]
    if len(words) > 1 and all(number_of(text.replace(",", ".")) is None for text in words):
        shown = printable(cut(", ".join(used)))
        problems = [
            f"{shown}: must be numbers; delete lines of names or units below the header, as of TrackMate"
        ]
        for name in names:
            if name:
                values[name].append(math.nan)
        return problems, 0
    for name, factor, text in zip(names, factors, row, strict=True):
        if not name:
            continue
        text, value = text.strip(), math.nan
        number = text.replace(",", ".") if form.decimal == "," else text
        if text.lower() in _MISSING:
            missing += 1
            if not gaps:
                problems.append(f"{name} = {text or 'nothing'}: must be a finite number")
        elif number_of(number) is None or (form.decimal == "," and "." in text):
            commas = form.decimal == "." and number_of(text.replace(",", ".")) is not None
            how = setting("decimal", ",", "") if commas else ""
            hint = f"; {how} reads a comma" if how else ""
            problems.append(f"{name} = {printable(cut(text))}: must be a number{hint}")
        elif not math.isfinite(float(number)) and not name.startswith("mass_"):
            problems.append(f"{name} = {cut(text)}: must be a finite number")
        else:
            value = factor * float(number)
        values[name].append(value)
    return problems, missing


def _standard_names(
    path: Path, kinds: Mapping[str, str], spellings: Mapping[str, str], form: TableFormat, most: int
) -> TableFormat:
    """The format by standard names, where units are given by the file's own names, or columns the other way round."""
    known = {each.removesuffix("_error") for each in kinds} | {f"{each}_error" for each in kinds}
    columns = {
        **{name: text for name, text in form.columns.items() if name in known},
        **{text: name for name, text in form.columns.items() if name not in known and text in known},
    }
    if len(columns) < len(form.columns):
        columns = dict(form.columns)  # with its mistakes
    units = dict(form.units)
    if {*units} - known:
        header, _ = next(csv_rows.each(path, most=most, delimiter=form.delimiter), ([], 0))
        own = {text.strip(): name for name, text in columns.items()}
        for text in map(str.strip, header):
            name = own.get(text) or _standard(text, spellings)[0]
            for given in (text, _BRACKETS.sub("", text).strip()):
                if name and given in units and given not in known:
                    units[name] = units.pop(given)
    return replace(form, columns=columns, units=units)


def _check_format(source: str, form: TableFormat, kinds: Mapping[str, str]) -> None:
    names = [each for each in kinds if ":" not in each]
    problems = [
        f"{what} {name}: no such quantity{nearest(name, kinds)}; there are {', '.join(names)}"
        for what, given in (("column", form.columns), ("unit", form.units), ("known value", form.known))
        for name in given
        if name.removesuffix("_error") not in kinds
    ]
    for name, unit in form.units.items():
        kind = kinds.get(name.removesuffix("_error"))
        if kind and unit not in UNITS[kind] and not _factor(unit):
            needed = f"must be {', '.join(UNITS[kind])} or a positive factor{nearest(unit, UNITS[kind])}"
            problems.append(f"unit {name}={unit}: {needed}")
    for name, value in form.known.items():
        if not math.isfinite(value):
            problems.append(f"known value {name} = {value}: must be a finite number")
    problems += [
        f"{name}: is named as a column and as a known value" for name in form.known if name in form.columns
    ]
    refuse(problems, source)


def _says_si(path: Path, most: int) -> bool:
    """True if a comment above the names of the columns says that values are in SI units."""
    comments = itertools.takewhile(lambda line: line.startswith("#"), text_file.lines(path, most=most))
    return any(SI_UNITS in line for line in comments)


def standard_unit(kind: str) -> str:
    """The unit to which columns of a kind are converted, such as m/s.

    Examples
    --------
    >>> standard_unit("velocity")
    'm/s'
    """
    return next(unit for unit, factor in UNITS[kind].items() if factor == 1.0)


def _factor(text: str) -> float | None:
    found = number_of(text)
    return found if found is not None and 0.0 < found < math.inf else None


def _header(
    line: int,
    header: Sequence[str],
    kinds: Mapping[str, str],
    spellings: Mapping[str, str],
    form: TableFormat,
    setting: Setting,
) -> tuple[list[str], list[float], list[str], bool]:
    """Standard names ("" for an unused one) and factors of columns, those not used, and whether units are stated."""
    if all(number_of(text) is not None for text in header):
        standard = ", ".join(name for name in kinds if ":" not in name)
        raise InputError(
            f"line {line}: there is no header: the first line must name the columns ({standard}), and here "
            "it holds numbers"
        )
    for sign, kind in _DELIMITERS.items():
        parts = header[0].strip().split(sign)
        # A name may have blanks.
        if len(header) == 1 < len(parts) and (
            sign != " " or all(_standard(one, spellings)[0] for one in parts)
        ):
            how = setting("delimiter", sign, "")
            hint = f"; {how} reads them" if how else ""
            raise InputError(
                f"line {line}: columns must be separated by '{form.delimiter}', and here are {kind}{hint}"
            )
    assigned = {text.strip(): name for name, text in form.columns.items()}
    present = [text.strip() for text in header]
    problems = [
        f"column {name}='{text}': the file has no such column{nearest(text, present)}; it has "
        f"{cut(', '.join(present), 300)}"
        for text, name in assigned.items()
        if text not in present
    ]
    names, in_headers, unused = [], [], []
    for text in present:
        name, unit = _standard(text, spellings)
        if text in assigned:
            name = assigned[text]
            kind, found = kinds.get(name.removesuffix("_error"), ""), _BRACKETS.search(text)
            if found and unit is None and kind in _WITH_UNITS and name not in form.units:
                shown, allowed = printable(cut(found[1])), ", ".join(UNITS[kind])
                problems.append(
                    f"line {line}: column '{cut(text)}': {name} must be in {allowed}, not in {shown}"
                )
        elif name in form.columns:
            name = ""  # another column stands for it
        if not name:
            known = [*kinds, *(f"{each}_error" for each in kinds)]
            close = difflib.get_close_matches(text, known, 1, _NEARLY_ALIKE)
            if close and text not in assigned and not _standard(text, spellings)[0]:
                shown = printable(cut(text))
                how = setting("columns", shown, close[0])
                hint = f"(did you mean '{close[0]}'?){f'; {how} says that it is' if how else ''}"
                problems.append(f"line {line}: unknown column '{shown}' {hint}")
            unused.append(text)
            unit = None
        names.append(name)
        in_headers.append(unit)
    factors, stated = [], list[bool]()
    own = {name: unit for name, unit in zip(names, in_headers, strict=True) if name}
    for text, name in zip(present, names, strict=True):
        kind, unit, factor = kinds.get(name.removesuffix("_error"), ""), *_conversion(name, own, kinds, form)
        if factor is None:
            what = "a pure number" if kind == "number" else f"a{'n' * (kind[0] in 'a')} {kind}"
            problems.append(f"line {line}: column '{cut(text)}': {name} is {what}, not in {unit}")
        factors.append(factor or 1.0)
        if kind in _DIMENSIONAL:
            stated.append(unit is not None)
    for name in dict.fromkeys(names):
        texts = [printable(text) for text, other in zip(present, names, strict=True) if other == name != ""]
        if len(texts) > 1:
            alike = len(set(texts)) == 1
            which = (
                ""
                if alike
                else f", by {' and '.join(map(repr, texts))}; {setting('columns', texts[-1], name)} chooses one"
            )
            problems.append(f"line {line}: column '{name}' is given twice{which}")
    problems += [
        f"line {line}: column '{name}' requires a column '{name.removesuffix('_error')}'"
        for name in names
        if name.endswith("_error")
        and (column := name.removesuffix("_error")) not in names
        and kinds.get(column) != "direction"
    ]
    problems += [f"{name}: is a column and a known value" for name in form.known if name in names]
    refuse(problems)
    return names, factors, [each for each in unused if each], bool(stated) and all(stated)


def _conversion(
    name: str, own: Mapping[str, str | None], kinds: Mapping[str, str], form: TableFormat
) -> tuple[str | None, float | None]:
    """The unit of a column and its factor, None if the unit is of another kind; `own` are the units in headers.

    An error without a unit of its own has that of its column, a covariance the product of those of its two columns.
    """
    column = name.removesuffix("_error")
    unit = form.units.get(name) or form.units.get(column) or own.get(name) or own.get(column)
    if unit is None and column.startswith(COVARIANCE):
        # What is wrong with the unit of one of the two is said of that column.
        pair = (_conversion(each, own, kinds, form)[1] for each in column.split(":")[1:])
        return None, math.prod(factor or 1.0 for factor in pair)
    kind = kinds.get(column, "")
    return unit, UNITS.get(kind, {}).get(unit or "") or (_factor(unit) if unit and kind else 1.0)


def _standard(text: str, spellings: Mapping[str, str]) -> tuple[str, str | None]:
    """The standard name of a column ("" if it has none) and the unit in its header."""
    unit = None
    if (found := _BRACKETS.search(text)) and (inside := found[1].strip().translate(_MICRO)) in _EVERY_UNIT:
        unit, text = inside, text[: found.start()]
    words = [word for word in re.split(r"[^\w*°']+|_", text.strip().lower()) if word]
    angular = [word for word in words if word in UNITS["angle"]]
    is_error = any(word in ERROR_WORDS for word in words)
    rest = "".join(word for word in words if word not in (*ERROR_WORDS, *angular))
    if rest not in spellings and not is_error:  # such as delta2err or sigmapsi
        for ending in ERROR_WORDS:
            for other in (rest.removesuffix(ending), rest.removeprefix(ending)):
                if other != rest and other in spellings:
                    rest, is_error = other, True
    if rest not in spellings:
        return "", unit
    name = spellings[rest]
    return (f"{name}_error" if is_error else name), unit or (angular[0] if angular else None)


def plain(name: str) -> str:
    """A name in small letters without signs, as spellings are looked up."""
    return re.sub(r"[^\w*°']|_", "", name.lower())
