"""Measured impacts: a CSV file of angles, or arrays, checked line by line."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, listed, nearest
from ..tools import csv as csv_rows
from .model import MEASURED

Array = NDArray[np.float64]

ANGLES = ("psi", *(name for name, each in MEASURED.items() if each.unit == "deg"))
COLUMNS = ("psi", *MEASURED)

# Other spellings of the columns, without signs, blanks and units; see `_plain`.
_SPELLINGS: Mapping[str, str] = {
    **{name.replace("_", "").lower(): name for name in COLUMNS},
    **dict.fromkeys(("ψ", "impactangle", "angleofimpact"), "psi"),
    **dict.fromkeys(("δ1", "deltaone"), "delta_1"),
    **dict.fromkeys(("δ2", "deltatwo"), "delta_2"),
    **dict.fromkeys(
        ("rw2v0", "rw2vo", "r2w2", "r2w2v0", "r2w2vo", "r2omega2", "r2omega2v0", "r2omega2vo", "romega2"),
        "Rw_2",
    ),
    **dict.fromkeys(("d2d112", "sqrtd2d", "d2d105", "d2d1sqrt", "sqrtd2overd1"), "sqrt_d2_d1"),
    **dict.fromkeys(("et*", "etstar", "etapp", "apparentet"), "e_t_apparent"),
}
MOST_BYTES = 10_000_000  # some 100,000 impacts
LEAST_ERROR = 1e-6  # below it, chi2 is so steep that rounding hides its minimum
_ERROR = ("error", "err", "sigma", "uncertainty", "std")
_DEGREES = ("deg", "degree", "degrees", "°")
_RADIANS = ("rad", "radian", "radians", "mrad")

EXAMPLE_LAW = {"e_n": 0.87, "e_t": -0.88, "mu": 0.21}
EXAMPLE_ERROR = 0.7  # [deg]


@dataclass(frozen=True, eq=False, kw_only=True)
class Data:
    """Impacts of disk 1 on disk 2, both without spin before and disk 2 at rest.

    Attributes
    ----------
    psi : array (n,)
        Impact angles from the line of centres [deg], from 0 to below 90.
    measured : mapping of str to array (n,)
        What was measured after the impact, by the names of `model.MEASURED`; angles in degrees.
    errors : mapping of str to array (n,)
        Standard errors (one sigma, Gaussian), positive, of "psi" and of each measured quantity, in its unit. A
        single number stands for all impacts.
    source : str
        Where they come from, for messages and titles.
    line : array (n,) of int, optional
        Lines of the file they come from; without it messages count the impacts from 1.

    Raises
    ------
    InputError
        With a line for each value that is wrong, error that is missing, or array that has another length.
    """

    psi: Array
    measured: Mapping[str, Array]
    errors: Mapping[str, Array]
    source: str = "data"
    line: NDArray[np.int64] | None = field(default=None)

    def __post_init__(self) -> None:
        wrong = [
            f"{name}: no such quantity{nearest(name, MEASURED)}; there are {', '.join(MEASURED)}"
            for name in self.measured
            if name not in MEASURED
        ]
        if not self.measured:
            wrong.append(f"nothing was measured: at least one is needed of {', '.join(MEASURED)}")
        values = {"psi": self.psi, **self.measured}
        wrong += [
            f"{name}: no error is given; {_how_to_give(name)}" for name in values if name not in self.errors
        ]
        wrong += [
            f"error of {name}: {name} was not measured{nearest(name, values)}"
            for name in self.errors
            if name not in values
        ]
        if wrong:
            raise InputError("\n".join(f"{self.source}: {each}" for each in wrong))
        n = np.size(self.psi)
        arrays = {name: _column(self.source, name, value, n) for name, value in values.items()}
        errors = {
            name: _column(
                self.source,
                f"error of {name}",
                np.broadcast_to(value, n) if np.ndim(value) == 0 else value,
                n,
            )
            for name, value in self.errors.items()
        }
        where = (
            [f"impact {i + 1}" for i in range(n)] if self.line is None else [f"line {i}" for i in self.line]
        )
        found: list[tuple[int, str]] = []
        for name in values:
            found += _wrong_values(name, arrays[name]) + _wrong_errors(name, errors[name])
        if found:
            found.sort(key=lambda each: each[0])
            raise InputError(listed([f"{self.source}: {where[i]}: {text}" for i, text in found]))
        object.__setattr__(self, "psi", arrays.pop("psi"))
        object.__setattr__(self, "measured", arrays)
        object.__setattr__(self, "errors", {name: errors[name] for name in values})

    def __len__(self) -> int:
        """The number of impacts."""
        return len(self.psi)

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities measured, in the order of `model.MEASURED`."""
        return tuple(name for name in MEASURED if name in self.measured)


def read(path: Path | str, errors: Mapping[str, float] | None = None) -> Data:
    """Read a CSV file of measured impacts.

    The first line that is not a comment names the columns, separated by commas: psi and at least one of
    delta_1, delta_2, Rw_2, sqrt_d2_d1, e_t_apparent, each with a column such as delta_2_error if its errors
    differ from impact to impact. Angles and their errors are in degrees. Empty lines and lines that begin with #
    are skipped.

    Parameters
    ----------
    path : path
        The file.
    errors : mapping of str to float, optional
        Errors of whole columns, by their names; "angles" stands for all angles. A column of errors in the file
        comes first, then the error by name, then that of all angles.

    Raises
    ------
    InputError
        With a line for each thing that is wrong: columns first, then values by line and column, then errors that
        are missing.

    Examples
    --------
    >>> from ifrdem import fit
    >>> from pathlib import Path
    >>> _ = Path("data.csv").write_text(fit.example())
    >>> data = fit.read("data.csv", {"angles": 0.7})
    >>> sorted(data.measured)
    ['delta_1', 'delta_2']
    """
    path = Path(path)
    try:
        rows, lines = csv_rows.read(path, most=MOST_BYTES)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if not rows:
        raise InputError(
            f"{path}: is empty: a first line with the names of the columns is needed, such as psi,delta_2"
        )
    header, body, at = rows[0], rows[1:], lines[1:]
    columns = _columns(path, lines[0], header)
    if not body:
        raise InputError(f"{path}: no impact follows the names of the columns")
    wrong: list[str] = []
    values: dict[str, Array] = {name: np.full(len(body), math.nan) for name in columns}
    for i, (row, line) in enumerate(zip(body, at, strict=True)):
        if len(row) != len(columns):
            count = f"{len(row)} value{'s' * (len(row) != 1)}"
            wrong.append(
                f"{path}: line {line}: {count}, and {len(columns)} are needed ({', '.join(columns)})"
            )
            continue
        texts = dict(zip(columns, row, strict=True))
        for name, text in texts.items():
            if csv_rows.is_number(text):
                values[name][i] = float(text)
        numbers = {name: values[name][i : i + 1] for name in columns}
        found = [
            f"{name} = {text.strip() or 'nothing'}: a number is needed"
            for name, text in texts.items()
            if not csv_rows.is_number(text)
        ]
        for name in columns:
            if csv_rows.is_number(texts[name]):
                of, is_error = (name.removesuffix("_error"), name not in COLUMNS)
                found += [
                    text for _, text in (_wrong_errors if is_error else _wrong_values)(of, numbers[name])
                ]
        wrong += [f"{path}: line {line}: {text}" for text in found]
    whole = dict(errors or {})
    all_angles = whole.pop("angles", None)
    given: dict[str, Array] = {}
    for name in (each for each in columns if each in COLUMNS):
        if f"{name}_error" in columns:
            given[name] = values[f"{name}_error"]
        elif name in whole:
            given[name] = np.full(len(body), whole[name])
        elif all_angles is not None and name in ANGLES:
            given[name] = np.full(len(body), all_angles)
        else:
            wrong.append(f"{path}: {name}: no error is given; {_how_to_give(name)}")
    present = [each for each in columns if each in COLUMNS]
    wrong += [
        f"{path}: an error of {name} is given, and the file has no column {name}{nearest(name, present)}; "
        f"it has {', '.join(present)}"
        for name in whole
        if name not in present
    ]
    if wrong:
        raise InputError(listed(wrong))
    return Data(
        psi=values["psi"],
        measured={name: values[name] for name in columns if name in MEASURED},
        errors=given,
        source=str(path),
        line=np.array(at, dtype=np.int64),
    )


def example(seed: int = 1) -> str:
    """A small CSV file of synthetic impacts, which says so and with which coefficients.

    Examples
    --------
    >>> from ifrdem import fit
    >>> fit.example(seed=1).splitlines()[0][:1]
    '#'
    """
    from .model import Model, Pair

    rng = np.random.default_rng(seed)
    psi = np.linspace(4.0, 72.0, 18)
    coefficients = np.array([*EXAMPLE_LAW.values(), 0.0])
    model = Model(Pair(M=1.0), "percussion_center")
    exact = model.predict(coefficients, np.radians(psi), ("delta_1", "delta_2"))
    shown = np.column_stack([psi, exact]) + rng.normal(0.0, EXAMPLE_ERROR, (len(psi), 3))
    shown = np.abs(shown)  # a measured angle next to the line of centres is counted from it to either side
    law = ", ".join(f"{name} = {value}" for name, value in EXAMPLE_LAW.items())
    head = (
        f"# SYNTHETIC, not measured: two equal homogeneous disks with {law}, percussion centre, and Gaussian\n"
        f"# errors of {EXAMPLE_ERROR} degrees in every angle. Angles are in degrees from the line of centres.\n"
        f"# Fit it: ifrdem fit THIS_FILE --M 1 --error {EXAMPLE_ERROR}\n"
        "psi,delta_1,delta_2\n"
    )
    return head + "".join(f"{a:.2f},{b:.2f},{c:.2f}\n" for a, b, c in shown)


def _columns(path: Path, line: int, header: Sequence[str]) -> list[str]:
    """The standard names of the columns of a file."""
    if all(csv_rows.is_number(text) for text in header):
        raise InputError(
            f"{path}: line {line}: there is no header: the first line must name the columns, such as psi,delta_2, "
            "and here it holds numbers"
        )
    if len(header) == 1 and (found := re.search(r"[;\t]", header[0])):
        kind = "semicolons" if found[0] == ";" else "tabs"
        raise InputError(
            f"{path}: line {line}: columns must be separated by commas, and decimals by points; here are {kind}"
        )
    names, wrong = [], []
    for text in header:
        name, problem = _standard(text)
        names.append(name)
        if problem:
            wrong.append(f"line {line}: {problem}")
    wrong += [
        f"line {line}: column '{name}' stands twice"
        for name in dict.fromkeys(names)
        if name and names.count(name) > 1
    ]
    if not wrong:
        if "psi" not in names:
            wrong.append(f"line {line}: missing column psi; there are {', '.join(names)}")
        if not any(name in MEASURED for name in names):
            wrong.append(
                f"line {line}: missing column delta_2, or another that was measured: {', '.join(MEASURED)}; "
                f"there are {', '.join(names)}"
            )
        wrong += [
            f"line {line}: column '{name}' needs a column '{name.removesuffix('_error')}' beside it"
            for name in names
            if name not in COLUMNS and name.removesuffix("_error") not in names
        ]
    if wrong:
        raise InputError("\n".join(f"{path}: {each}" for each in wrong))
    return names


def _standard(text: str) -> tuple[str, str]:
    """The standard name of a column, and what is wrong with it if something is."""
    words = [word for word in re.split(r"[^\w*°]+|_", text.strip().lower()) if word]
    unit = next((word for word in words if word in (*_DEGREES, *_RADIANS)), None)
    is_error = any(word in _ERROR for word in words)
    rest = "".join(word for word in words if word not in (*_DEGREES, *_RADIANS, *_ERROR))
    if rest not in _SPELLINGS and not is_error:  # such as delta2err or sigmapsi
        for ending in _ERROR:
            for other in (rest.removesuffix(ending), rest.removeprefix(ending)):
                if other != rest and other in _SPELLINGS:
                    rest, is_error = other, True
    if rest not in _SPELLINGS:
        allowed = [*COLUMNS, *(f"{name}_error" for name in COLUMNS)]
        hint = nearest(text.strip(), allowed) or nearest(rest, _SPELLINGS)
        return (
            "",
            f"unknown column '{text.strip()}'{hint}; allowed are {', '.join(COLUMNS)}, each with _error",
        )
    name = _SPELLINGS[rest]
    if unit in _RADIANS:
        return name, f"column '{text.strip()}': angles must be in degrees, not in {unit}"
    if unit in _DEGREES and name not in ANGLES:
        return name, f"column '{text.strip()}': {name} is a pure number, not an angle"
    return (f"{name}_error" if is_error else name), ""


def _how_to_give(name: str) -> str:
    angle = " (or --error DEGREES for all angles)" if name in ANGLES else ""
    return f"a column {name}_error or --error {name}=VALUE{angle} is needed"


def _column(source: str, name: str, value: ArrayLike, n: int) -> Array:
    array = np.array(value, dtype=np.float64)
    if array.shape != (n,):
        raise InputError(f"{source}: {name} has shape {array.shape}: ({n},) is needed, as psi has")
    return array


def _wrong_values(name: str, values: Array) -> list[tuple[int, str]]:
    """Index and complaint of each value that cannot be."""
    if name == "psi":
        right = (values >= 0.0) & (values < 90.0)
        need = "an impact angle from 0 to below 90 degrees is needed"
    else:
        low, high = MEASURED[name].low, MEASURED[name].high
        right = (
            np.isfinite(values) & (values > low if name == "sqrt_d2_d1" else values >= low) & (values <= high)
        )
        need = "a finite number is needed"
        if name in ANGLES:
            need = f"an angle from {low:g} to {high:g} degrees is needed"
        elif low == 0.0:
            need = "a positive finite number is needed"
    return [(int(i), f"{name} = {values[i]:g}: {need}") for i in np.flatnonzero(~right)]


def _wrong_errors(name: str, values: Array) -> list[tuple[int, str]]:
    right = np.isfinite(values) & (values >= LEAST_ERROR)
    need = f"a finite number, {LEAST_ERROR:g} or more, is needed; every measured value has an error"
    return [(int(i), f"error of {name} = {values[i]:g}: {need}") for i in np.flatnonzero(~right)]
