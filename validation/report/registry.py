"""Validation cases: their list, what one returns, and its end.

A case is a module of `ifrdem.validation.paper`, `.engines`, `.lammps`, `.gas` or `.devices` with three things:

- `QUESTION`, one line: what it asks;
- `REFERENCE`, one line: where the expected values come from;
- `run(quick)`, which returns a `Result`, or raises `Skip` where it cannot run; of a gas, `run(quick, seed)`.

To add one, write the module and put its name into `PAPER`, `BULLET`, `LAMMPS`, `GAS` or `DEVICE`.
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
"""Cases that compare the kernels with the paper."""

BULLET = ("bullet_pair", "bullet_anomaly", "bullet_flight", "bullet_box", "bullet_ifr", "bullet_defaults")
"""Cases that compare them with independent code; they need PyBullet."""

LAMMPS = ("lammps_law", "lammps_impacts", "lammps_cooling", "lammps_driven")
"""Cases that compare them with LAMMPS, which can end its process: each runs in one of its own."""

LONG = ("lammps_cooling", "lammps_driven")
"""Cases without a shorter form: `--quick` leaves them out of their group."""

GAS = (
    "gas_state", "gas_stress", "gas_profiles", "gas_equilibrium", "gas_elastic", "gas_haff", "gas_rough",
    "gas_cooling", "gas_species", "gas_driven", "gas_piston", "gas_collapse", "gas_clusters", "gas_shaken",
    "gas_hopper", "gas_laws", "gas_studies", "gas_cases",
)  # fmt: skip
"""Cases that compare many disks with the literature and kinetic theory; they take minutes, and a seed."""

DEVICE = ("device_bits", "device_races", "device_speed")
"""Cases for a GPU that is new: against the CPU, races of threads, and its speed; ten minutes."""

CASES = PAPER + BULLET + LAMMPS + GAS + DEVICE  # in the order in which they run
GROUPS: dict[str, tuple[str, ...]] = {
    "paper": PAPER, "bullet": BULLET, "lammps": LAMMPS, "gas": GAS, "device": DEVICE,
}  # fmt: skip
ROOMS = {"paper": "paper", "bullet": "engines", "lammps": "lammps", "gas": "gas", "device": "devices"}
"""Folder of each group: case `gas_haff` is the module `ifrdem.validation.gas.haff`."""

EXACT = 1e-10
ROUND_OFF = (
    "f64 round-off: contact points 1e-16 of a box some hundred diameters wide, angles up to 85 degrees enlarge "
    "it by 1e2"
)
"""Tolerance of collisions of pairs against closed forms, and its reason."""

SECONDS = {
    "gas_state": (260.0, 9.0), "gas_elastic": (100.0, 26.0), "gas_haff": (220.0, 26.0), "gas_cooling": (330.0, 58.0),
    "gas_stress": (450.0, 60.0), "gas_profiles": (200.0, 45.0), "gas_equilibrium": (260.0, 20.0),
    "gas_rough": (124.0, 21.0),
    "gas_driven": (150.0, 56.0), "gas_piston": (180.0, 26.0), "gas_collapse": (5.0, 5.0), "gas_clusters": (180.0, 13.0),
    "gas_shaken": (250.0, 45.0), "gas_hopper": (300.0, 90.0), "gas_laws": (115.0, 40.0),
    "lammps_law": (10.0, 5.0), "lammps_impacts": (5.0, 5.0), "lammps_cooling": (60.0, 60.0), "lammps_driven": (100.0, 100.0),
    "gas_species": (60.0, 15.0), "gas_studies": (200.0, 60.0), "gas_cases": (500.0, 20.0),
}  # fmt: skip
"""Processor time of cases, in full and quick, with compiled kernels [s]; of others a second or so."""


class Skip(Exception):
    """A case cannot run here (a package is missing, say); the message says why. It never counts as passed."""


@dataclass(frozen=True)
class Sampling:
    """Origin of the tolerance of a row of random gases: z * error + systematic."""

    disks: int  # in a gas
    seeds: tuple[int, int]  # first and last
    replicas: int  # gases
    error: float  # standard error of measured - expected, from the scatter of replicas
    z: float  # how many of it pass
    systematic: float  # how far the expected value may be off
    widest: float  # the largest tolerance that still says something: with a wider one the row fails
    freedom: float  # degrees of freedom of `error`: those of Student's t


@dataclass(frozen=True)
class Row:
    """One comparison."""

    quantity: str  # with its unit
    measured: float
    expected: float
    tolerance: float  # the largest |measured - expected| that passes
    reason: str  # of the tolerance
    source: str  # of the expected value
    printed: float | None = None  # the paper's misprint, from which it must be more than ten tolerances away
    sampling: Sampling | None = None  # of what is random
    least: bool = False  # `expected` is a lower bound, and there is no tolerance

    @property
    def blunt(self) -> bool:
        """True for a tolerance too wide for the row to say anything."""
        return self.sampling is not None and not self.tolerance <= self.sampling.widest

    @property
    def passed(self) -> bool:
        """True for a measured value within the tolerance, and that not too wide; never for a NaN."""
        if self.least:
            return self.measured >= self.expected
        if self.blunt or not abs(self.measured - self.expected) <= self.tolerance:
            return False
        return self.printed is None or abs(self.measured - self.printed) > 10.0 * self.tolerance


@dataclass(frozen=True)
class Picture:
    """A figure of the report."""

    name: str  # of its files
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
    """Rows, pictures and tables of a case."""

    rows: list[Row] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)

    def near(
        self, quantity: str, measured: Any, expected: Any, tolerance: float, reason: str, source: str,
        *, printed: float | None = None,
    ) -> None:  # fmt: skip
        """Add a row of one number against one number."""
        misprint = None if printed is None else float(printed)
        self.rows.append(Row(quantity, float(measured), float(expected), tolerance, reason, source, misprint))

    def exact(
        self, quantity: str, measured: Any, expected: Any, source: str, *, printed: float | None = None
    ) -> None:
        """Add a row of collisions against closed forms, to `EXACT`: of one number (`near`), or of all (`all_near`)."""
        if np.ndim(measured) == 0:
            self.near(quantity, measured, expected, EXACT, ROUND_OFF, source, printed=printed)
        else:
            self.all_near(quantity, measured, expected, EXACT, ROUND_OFF, source)

    def table(
        self, title: str, header: tuple[str, ...], rows: list[tuple[str | float, ...]], note: str = ""
    ) -> None:
        """Add a table; cells are texts or numbers."""
        self.tables.append(Table(title, header, rows, note))

    def at_least(self, quantity: str, measured: Any, bound: float, reason: str, source: str) -> None:
        """Add a row of one number that must not be below a bound."""
        self.rows.append(Row(quantity, float(measured), bound, 0.0, reason, source, least=True))

    def all_near(
        self, quantity: str, measured: ArrayLike, expected: ArrayLike, tolerance: float, reason: str, source: str,
    ) -> None:  # fmt: skip
        """Add a row of arrays against arrays that broadcast: its `measured` is the largest deviation.

        It is NaN, and the row fails, if one of the values is NaN or there is nothing to compare.
        """
        deviation = np.abs(np.asarray(measured, dtype=float) - np.asarray(expected, dtype=float))
        largest = float(np.max(deviation)) if deviation.size else float("nan")
        text = f"largest deviation of {quantity}, {deviation.size} values"
        self.rows.append(Row(text, largest, 0.0, tolerance, reason, source))


@dataclass(frozen=True)
class Drawing:
    """A rendered picture: its files by their endings, and its width and height in pixels on the page."""

    name: str
    caption: str
    size: tuple[int, int]
    files: dict[str, bytes]


@dataclass
class Verdict:
    """The end of a case."""

    name: str
    question: str
    reference: str
    # Empty if it was skipped or raised; its pictures are in `drawings`.
    result: Result = field(default_factory=Result)
    drawings: list[Drawing] = field(default_factory=list)  # rendered where it ran
    skipped: str = ""  # why it was skipped, or what it raised, with the traceback; empty otherwise
    error: str = ""
    details: str = ""
    seconds: float = 0.0

    @property
    def failures(self) -> list[Row]:
        """Rows that did not pass."""
        return [row for row in self.result.rows if not row.passed]

    @property
    def passed(self) -> bool:
        """True if the case ran, compared something, and every row passed."""
        return bool(self.result.rows) and not (self.error or self.skipped or self.failures)

    @property
    def status(self) -> str:
        """passed, failed or skipped."""
        return "skipped" if self.skipped else "passed" if self.passed else "failed"


class CaseModule(Protocol):
    """The module of a case."""

    QUESTION: str
    REFERENCE: str

    def run(self, quick: bool, /, *seed: int) -> Result:
        """Measure and compare; `quick` takes fewer samples. Those of `GAS` take a seed."""
        ...


def load(name: str) -> CaseModule:
    """The case of this name; InputError if there is none."""
    check_names([name])
    group = group_of(name)
    module = f"..{ROOMS[group]}.{name.removeprefix(f'{group}_')}"
    return cast(CaseModule, importlib.import_module(module, __package__))


def group_of(name: str) -> str:
    """The group of a case; "paper" for one that is in none."""
    return next((group for group, has in GROUPS.items() if name in has), "paper")


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
    """Time of a case, roughly [s]: see `SECONDS`."""
    return SECONDS.get(name, (1.0, 1.0))[quick]


def chosen(names: list[str], quick: bool = False) -> list[str]:
    """The cases that names of cases and groups stand for, each once; of none those of the paper.

    A group has none of `LONG` if it is to be `quick`.
    """
    if not names:
        return [name for name in CASES if name not in BULLET + LAMMPS + GAS + DEVICE]
    groups = {
        name: tuple(case for case in has if not (quick and case in LONG)) for name, has in GROUPS.items()
    }
    return list(dict.fromkeys(case for name in names for case in groups.get(name, (name,))))
