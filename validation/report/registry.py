"""What a validation case is, and which there are.

A case is a module of `ifrdem.validation.paper`, `.engines` or `.gas` with three things:

- `QUESTION`, one line: what it asks;
- `REFERENCE`, one line: where the expected values come from;
- `run(quick)`, which returns a `Result`, or raises `Skip` where it cannot run; of a gas, `run(quick, seed)`.

To add one, write the module and put its name into `PAPER`, `BULLET` or `GAS`.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, nearest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER = ("angles", "velocities", "restitution", "stopping", "rolling", "reductions", "misprints", "energy")
"""Cases that hold the kernels against the paper."""

BULLET = ("bullet_pair", "bullet_anomaly", "bullet_flight", "bullet_box", "bullet_ifr", "bullet_defaults")
"""Cases that hold them against code that nobody here wrote; they need PyBullet."""

GAS = (
    "gas_state", "gas_equilibrium", "gas_elastic", "gas_haff", "gas_rough", "gas_cooling", "gas_driven",
    "gas_collapse", "gas_clusters",
)  # fmt: skip
"""Cases that hold many disks against the literature and kinetic theory; they take minutes, and a seed."""

CASES = PAPER + BULLET + GAS
"""Names of all cases, in the order in which they run."""

GROUPS = {"paper": PAPER, "bullet": BULLET, "gas": GAS}
"""Names that stand for several cases."""

ROOMS = {"paper": "paper", "bullet": "engines", "gas": "gas"}
"""Folder of each group: case `gas_haff` is the module `ifrdem.validation.gas.haff`."""


SECONDS = {
    "gas_state": (260.0, 9.0), "gas_elastic": (100.0, 26.0), "gas_haff": (220.0, 26.0), "gas_cooling": (330.0, 58.0),
    "gas_equilibrium": (260.0, 20.0), "gas_rough": (100.0, 21.0),
    "gas_driven": (150.0, 56.0), "gas_collapse": (5.0, 5.0), "gas_clusters": (180.0, 13.0),
}  # fmt: skip
"""Processor time of cases, in full and quick, with compiled kernels [s]; of others a second or so."""


class Skip(Exception):
    """A case cannot run here (a package is missing, say); the message says why. It never counts as passed."""


@dataclass(frozen=True)
class Sampling:
    """Where the tolerance of a row of random gases comes from: z * error + systematic.

    Attributes
    ----------
    disks, replicas : int
        Disks in a gas, and how many gases there were.
    seeds : tuple of two ints
        Their first and last.
    error : float
        Standard error of measured - expected, from the scatter of replicas.
    z : float
        How many of it pass.
    systematic : float
        How far the expected value may be off.
    widest : float
        The largest tolerance with which the row still says something: with a wider one it fails, for want of replicas.
    freedom : float
        Degrees of freedom of `error`: those of Student's t.
    """

    disks: int
    seeds: tuple[int, int]
    replicas: int
    error: float
    z: float
    systematic: float
    widest: float
    freedom: float


@dataclass(frozen=True)
class Row:
    """One comparison.

    Attributes
    ----------
    quantity : str
        What was measured, with its unit.
    measured, expected : float
        What the simulation gave, and what the reference says.
    tolerance : float
        The largest |measured - expected| that passes.
    reason : str
        Why the tolerance is what it is.
    source : str
        Where the expected value comes from.
    printed : float or None
        What the paper prints, where that is a misprint: the simulation must also be far from it, by more than
        ten times the tolerance.
    sampling : Sampling or None
        Of what is random.
    least : bool
        `expected` is a lower bound: whatever is not below it passes, and there is no tolerance.
    """

    quantity: str
    measured: float
    expected: float
    tolerance: float
    reason: str
    source: str
    printed: float | None = None
    sampling: Sampling | None = None
    least: bool = False

    @property
    def blunt(self) -> bool:
        """Whether its tolerance is too wide for the row to say anything."""
        return self.sampling is not None and not self.tolerance <= self.sampling.widest

    @property
    def passed(self) -> bool:
        """Whether the measured value is within the tolerance, and that not too wide; never so for a NaN."""
        if self.least:
            return self.measured >= self.expected
        if self.blunt or not abs(self.measured - self.expected) <= self.tolerance:
            return False
        return self.printed is None or abs(self.measured - self.printed) > 10.0 * self.tolerance


@dataclass(frozen=True)
class Picture:
    """A figure of the report: the name of its files, a caption, and the matplotlib figure itself."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Table:
    """A table of the report; cells are texts or numbers."""

    title: str
    header: tuple[str, ...]
    rows: list[tuple[str | float, ...]]
    note: str = ""


@dataclass
class Result:
    """What a case found."""

    rows: list[Row] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)

    def near(
        self,
        quantity: str,
        measured: Any,
        expected: Any,
        tolerance: float,
        reason: str,
        source: str,
        *,
        printed: float | None = None,
    ) -> None:
        """Add a row of one number against one number."""
        row = Row(quantity, float(measured), float(expected), tolerance, reason, source)
        self.rows.append(row if printed is None else _with_printed(row, float(printed)))

    def at_least(self, quantity: str, measured: Any, bound: float, reason: str, source: str) -> None:
        """Add a row of one number that must not be below a bound."""
        self.rows.append(Row(quantity, float(measured), bound, 0.0, reason, source, least=True))

    def all_near(
        self,
        quantity: str,
        measured: ArrayLike,
        expected: ArrayLike,
        tolerance: float,
        reason: str,
        source: str,
    ) -> None:
        """Add a row of arrays against arrays: its `measured` is the largest deviation.

        It is NaN, and the row fails, if one of the values is NaN or there is nothing to compare.
        """
        deviation = np.abs(np.asarray(measured, dtype=float) - np.asarray(expected, dtype=float))
        largest = float(np.max(deviation)) if deviation.size else float("nan")
        text = f"largest deviation of {quantity}, {deviation.size} values"
        self.rows.append(Row(text, largest, 0.0, tolerance, reason, source))


def _with_printed(row: Row, printed: float) -> Row:
    return Row(row.quantity, row.measured, row.expected, row.tolerance, row.reason, row.source, printed)


class Case(Protocol):
    """The module of a case."""

    QUESTION: str
    REFERENCE: str

    def run(self, quick: bool, /, *seed: int) -> Result:
        """Measure and compare; `quick` takes fewer samples. Those of `GAS` take a seed."""
        ...


def load(name: str) -> Case:
    """The case of this name.

    Raises
    ------
    InputError
        If there is none.
    """
    check_names([name])
    room, module = next(
        (ROOMS[group], name.removeprefix(f"{group}_")) for group, has in GROUPS.items() if name in has
    )
    return cast(Case, importlib.import_module(f"...validation.{room}.{module}", __package__))


def check_names(names: list[str]) -> None:
    """Raise InputError, with the nearest spelling, unless each is the name of a case or of a group."""
    known = (*CASES, *GROUPS)
    for name in names:
        if name not in known:
            raise InputError(
                f"case = '{name}': there is no such case{nearest(name, known)}; there are: {', '.join(CASES)}; "
                f"groups of them: {', '.join(GROUPS)}"
            )


def seconds(name: str, quick: bool) -> float:
    """What a case takes, roughly: see `SECONDS`."""
    return SECONDS.get(name, (1.0, 1.0))[quick]


def chosen(names: list[str]) -> list[str]:
    """The cases that names of cases and groups stand for, each once; of none those of the paper."""
    if not names:
        return [name for name in CASES if name not in BULLET + GAS]
    return list(dict.fromkeys(case for name in names for case in GROUPS.get(name, (name,))))
