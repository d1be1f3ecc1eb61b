"""Measured impacts: tables of angles, or whole collisions with velocities and spins before and after."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, Problem, nearest, option_name, refuse, there_are
from ..tools import checked, tables
from ..tools.checked import (
    LEAST,
    MOST,
    Fraction,
    Lines,
    Measurements,
    Number,
    Numbers,
    PositivePerDisk,
    Seed,
    validated,
)
from ..tools.tables import TableFormat
from .laws import LAWS
from .model import DIRECTION, MEASURED, MOTION, AngleProblem, CollisionProblem, FitProblem, Pair, RowError

Array = NDArray[np.float64]

ANGLES = ("psi", *(name for name, each in MEASURED.items() if each.unit == "deg"))
COLUMNS = ("psi", *MEASURED)

# Other spellings of the columns, without signs, blanks and units; see `tables.plain`.
_SPELLINGS: Mapping[str, str] = {
    **{tables.plain(name): name for name in COLUMNS},
    **dict.fromkeys(("ψ", "impactangle", "angleofimpact"), "psi"),
    **dict.fromkeys(("δ1", "deltaone"), "delta_1"),
    **dict.fromkeys(("δ2", "deltatwo"), "delta_2"),
    **dict.fromkeys((f"{rim}{v}" for rim in ("rw2", "r2w2", "r2omega2") for v in ("", "v0", "vo")), "Rw_2"),
    "romega2": "Rw_2",
    **dict.fromkeys(("d2d112", "sqrtd2d", "d2d105", "d2d1sqrt", "sqrtd2overd1"), "sqrt_d2_d1"),
    **dict.fromkeys(("et*", "etstar", "etapp", "apparentet"), "e_t_apparent"),
}

AFTER = tuple(f"{name}_after" for name in MOTION)
CENTRES = ("x_1", "y_1", "x_2", "y_2")
NORMAL = ("nx", "ny")
BEFORE = "before"
"""All of the motion before, which may be exact."""
_DISKS = ("mass_1", "radius_1", "k_1", "mass_2", "radius_2", "k_2")
_KINDS: Mapping[str, str] = {
    **dict.fromkeys(CENTRES, "length"),
    **dict.fromkeys(NORMAL, "number"),
    **{name: "spin" if name.startswith("spin") else "velocity" for name in (*MOTION, *AFTER)},
    **{name: {"m": "mass", "r": "length", "k": "number"}[name[0]] for name in _DISKS},
}
COLLISION_COLUMNS = (*CENTRES, *NORMAL, *MOTION, *AFTER)
"""Columns of whole collisions; mass_1, radius_1, k_1 and those of disk 2 may be added."""

_COLLISION_SPELLINGS: Mapping[str, str] = {
    **{tables.plain(name): name for name in _KINDS},
    **{f"{new}{i}{end}": f"spin_{i}{'_after' * bool(end)}" for new in ("w", "omega", "ω") for i in "12" for end in ("", "after", "'")},
    **{f"v{axis}{i}'": f"v{axis}_{i}_after" for axis in "xy" for i in "12"},
}  # fmt: skip
GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "angles": ANGLES,
        "positions": CENTRES,
        "velocities": tuple(name for name in (*MOTION, *AFTER) if name[0] == "v"),
        "spins": tuple(name for name in (*MOTION, *AFTER) if name[0] == "s"),
    }
)
"""Columns that one error may stand for, and that share one error where it is estimated."""

UNUSED = "columns not used"
UNUSED_OF_COLLISIONS = (
    "t",
    "clip",
    "id_1",
    "id_2",
    "quality_angles",
)  # which `ifrdem collisions` writes for people
LEAST_ERROR = 1e-6  # below it, chi2 is so steep that rounding hides its minimum
_PSI = Number(0.0, math.nextafter(90.0, 0.0), "an impact angle from 0 to below 90 degrees")
_MEASURED = replace(checked.FINITE, gaps=True)
_ERROR = Number(LEAST_ERROR, MOST, f"a finite number of at least {LEAST_ERROR:g}", gaps=True)
_ERROR_OR_ZERO = replace(checked.NON_NEGATIVE, gaps=True)
_MASS = Number(LEAST, math.inf, f"a positive number from {LEAST:g}, or inf")
EXAMPLE_LAW = {"e_n": 0.87, "e_t": -0.88, "mu": 0.21}
EXAMPLE_ERROR = 0.7  # [deg]


@validated
@dataclass(frozen=True, eq=False, kw_only=True)
class Data:
    """Impacts of disk 1 on disk 2 or on a wall: nothing spins before, and disk 2 is at rest.

    Raises InputError with a line for each value that is wrong, error that is missing, or array that has another
    length.
    """

    psi: Measurements
    """Impact angles from the line of centres [deg], from 0 to below 90; shape (n,)."""
    measured: Mapping[str, Measurements]
    """Values after the impact, by the names of `model.MEASURED`; angles in degrees; NaN where one is missing; shape
    (n,)."""
    errors: Mapping[str, Measurements]
    """Standard errors (one sigma, Gaussian), positive, of "psi" and of each measured quantity, in its unit. A single
    number stands for all impacts; NaN for an error to be estimated from the residuals; shape (n,)."""
    source: str = "data"
    """Their source, for messages and titles."""
    line: Lines | None = field(default=None)
    """Lines of the file they come from; without it messages count the impacts from 1; shape (n,)."""
    notes: tuple[str, ...] = ()
    """Values that are missing and columns that are not used."""

    def __post_init__(self) -> None:
        problems = _unknown(self.measured, MEASURED)
        if not self.measured:
            problems.append(Problem("measured", None, f"must have at least one of {', '.join(MEASURED)}"))
        values = {"psi": self.psi, **self.measured}
        refuse(problems + _name_problems(values, self.errors), self.source)
        n = np.size(self.psi)
        arrays = {name: _column(self.source, name, value, n) for name, value in values.items()}
        errors = {name: _column(self.source, name, value, n) for name, value in self.errors.items()}
        found: list[RowProblem] = []
        for name in values:
            found += _rows(name, _PSI if name == "psi" else MEASURED[name].check, arrays[name])
            found += _rows(f"error of {name}", _ERROR, errors[name], where=~np.isnan(arrays[name]))
        empty = np.all([np.isnan(arrays[name]) for name in self.measured], axis=0)
        found += _at(empty, "nothing was measured after the impact")
        _refuse_rows(self.source, found, self.line)
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

    def where(self, i: int) -> str:
        """Line of an impact in its file, for messages."""
        return f"impact {i + 1}" if self.line is None else f"line {self.line[i]}"

    def problem(self, pair: Pair) -> FitProblem:
        """The impacts of a pair as a fit sees them."""
        names = ("psi", *self.names)
        y = np.stack([self.psi, *(self.measured[name] for name in self.names)], axis=-1)
        s = np.stack([self.errors[name] for name in names], axis=-1)
        return AngleProblem(names, y, s, [_group(name) for name in names], pair)


Size = Annotated[float, Number(-math.inf, math.inf, "a number; nan for one to be estimated", gaps=True)]

_Mass = Annotated[
    ArrayLike, Numbers(("n",), LEAST, math.inf, f"positive, from {LEAST:g}, or inf", scalar=True)
]


@validated
@dataclass(frozen=True, kw_only=True)
class Disk:
    """A disk of whole collisions, or disks that differ from collision to collision.

    Examples
    --------
    >>> from ifrdem import fit
    >>> fit.Disk(mass=[1.0, 2.0], radius=0.5).k
    2.0
    """

    mass: _Mass
    """Mass [mass]; infinite for a wall or a fixed disk; shape (n,)."""
    radius: PositivePerDisk
    """Radius [length]; shape (n,)."""
    k: PositivePerDisk = 2.0
    """Shape number in I = m R^2 / k; shape (n,)."""


def _of_columns(columns: Mapping[str, Any]) -> Disk:
    """Disks of columns that are checked line by line."""
    found = object.__new__(Disk)
    vars(found).update({"k": 2.0, **columns})
    return found


WALL = Disk(mass=math.inf, radius=1.0)
"""A wall or a fixed disk as disk 2."""


@validated
@dataclass(frozen=True, eq=False, kw_only=True)
class Collisions:
    """Whole collisions of two disks, or of a disk with a wall, in any frame of reference.

    Raises InputError with a line for each thing that is wrong; also for pairs that separate before the impact.

    Examples
    --------
    >>> from ifrdem import fit
    >>> motion = {"vx_1": [1.0, 0.7], "vy_1": [0.2, 0.7], "vx_1_after": [-0.9, -0.63]}
    >>> normal = {"nx": [1.0, 1.0], "ny": [0.0, 0.0]}
    >>> errors = {"vx_1": 0.01, "vy_1": 0.01, "vx_1_after": 0.01, "normal": 0.01}
    >>> coin = fit.Disk(mass=1.0, radius=0.5)
    >>> hits = fit.Collisions(disk_1=coin, disk_2=fit.WALL, measured={**motion, **normal}, errors=errors)
    >>> hits.measured["vx_1_after"]
    array([-0.9 , -0.63])
    """

    disk_1: Disk
    disk_2: Disk
    """disk_1, disk_2: the disks; `WALL` as disk 2."""
    measured: Mapping[str, Measurements]
    """Values by the names of `COLLISION_COLUMNS`: places of the centres x_1 ... y_2 [length], or the normal nx, ny
    from disk 1 to disk 2 [any length]; velocities vx_1 ... [length/time] and spins, counter-clockwise [rad/time],
    before and, with _after, after. Any subset; NaN where a value is missing. Of a wall, velocities are 0 unless
    given, and exact; shape (n,)."""
    errors: Mapping[str, Measurements]
    """Standard errors, positive; a single number stands for all. NaN for one to be estimated from the residuals, 0
    for a
    value that is known exactly. Those of nx, ny may be of `normal` [rad] instead; shape (n,)."""
    covariance: Mapping[tuple[str, str], Measurements] = field(default_factory=dict)
    """Covariances of two quantities of the motion, or of one and "normal" [rad]; shape (n,)."""
    source: str = "data"
    line: Lines | None = field(default=None)
    notes: tuple[str, ...] = ()
    """source, line, notes: as in `Data`."""
    materials: tuple[str, ...] = ()
    """The two materials of each collision, as one text such as "glass, steel"; (n,), or empty if they are not known."""
    si: bool = False
    """True if all values are in SI units, which texts and pictures then name."""

    def __post_init__(self) -> None:
        problems = _unknown(self.measured, COLLISION_COLUMNS)
        normal, positions = (all(name in self.measured for name in names) for names in (NORMAL, CENTRES))
        if not normal and not positions:
            text = "missing: give columns nx, ny or x_1, y_1, x_2, y_2"
            problems.append(Problem(DIRECTION, None, text))
        if not any(name in self.measured for name in AFTER):
            text = f"must have a quantity after the impact, one of {', '.join(AFTER)}"
            problems.append(Problem("measured", None, text))
        given = {name: value for name, value in self.errors.items() if name != DIRECTION}
        turned = [name for name in NORMAL if DIRECTION in self.errors and name in {*self.measured} - {*given}]
        if problems and (unused := [each for each in self.notes if each.startswith(UNUSED)]):
            how = option_name(f"--column {MOTION[0]}='HEADER'", f"columns = {{'{MOTION[0]}': 'HEADER'}}")
            problems.append(
                Problem(UNUSED, None, f"{unused[0].removeprefix(f'{UNUSED}: ')}; map one with {how}")
            )
        problems += _name_problems(self.measured, (*given, *turned))
        problems += [
            Problem(
                "covariance",
                None,
                f"{a} and {b} must both be velocities or spins that were measured, or one the normal",
            )
            for a, b in _pairs(self.covariance)
            if not {a, b} <= {DIRECTION, *({*MOTION, *AFTER} & set(self.measured))} or a == b
        ]
        refuse(problems, self.source)
        n = max(np.size(value) for value in self.measured.values())
        if self.materials and len(self.materials) != n:
            raise InputError(
                f"{self.source}: materials has {len(self.materials)} values: must be {n}, or none"
            )
        arrays = {name: _column(self.source, name, value, n) for name, value in self.measured.items()}
        errors = {name: _column(self.source, f"error of {name}", value, n) for name, value in given.items()}
        if turned:  # an error [rad] of the direction, whatever the length of the normal
            angle = _column(self.source, f"error of {DIRECTION}", self.errors[DIRECTION], n)
            x, y = (arrays.get(name, np.zeros(n)) for name in NORMAL)
            errors |= dict.fromkeys(turned, angle * np.hypot(x, y))
        found: list[RowProblem] = []
        for name, e in errors.items():
            found += _rows(f"error of {name}", _ERROR_OR_ZERO, e, where=~np.isnan(arrays[name]))
            found += _rows(name, _MEASURED, arrays[name])
        disks = []
        for number, disk in ((1, self.disk_1), (2, self.disk_2)):
            numbers = _per_collision(disk, n)
            for key, v in numbers.items():
                check = _MASS if (number, key) == (2, "mass") else checked.POSITIVE
                found += _rows(f"{key}_{number}", check, v)
            disks.append(_of_columns(numbers))
        walls = np.isinf(np.asarray(disks[1].mass))
        if walls.any() and not walls.all():
            text = "walls and disks cannot be combined in one table"
            found.append((int(np.argmax(walls)), Problem("mass_2", "inf", text)))
        x, y = (arrays[NORMAL[i]] if normal else arrays[CENTRES[i + 2]] - arrays[CENTRES[i]] for i in (0, 1))
        found += _at((x == 0.0) & (y == 0.0), "the normal has no length")
        _refuse_rows(self.source, found, self.line)
        object.__setattr__(self, "measured", arrays)
        object.__setattr__(self, "errors", {name: errors[name] for name in self.measured})
        object.__setattr__(self, "disk_1", disks[0])
        object.__setattr__(self, "disk_2", disks[1])
        try:
            apart = self.problem().separating
        except RowError as error:
            raise InputError(f"{self.source}: {self.where(error.row)}: {error.text}") from None
        text = (
            "the disks separate before the impact, or rest: the normal must point from disk 1 to disk 2, and spins be "
            "counter-clockwise"
        )
        _refuse_rows(self.source, _at(apart, text), self.line)

    def __len__(self) -> int:
        """The number of collisions."""
        return len(next(iter(self.measured.values())))

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities measured."""
        return tuple(name for name in COLLISION_COLUMNS if name in self.measured)

    @property
    def wall(self) -> bool:
        """True if disk 2 is a wall or a fixed disk."""
        return bool(np.isinf(np.asarray(self.disk_2.mass)).all())

    def unit(self, name: str) -> str:
        """SI unit of a column, or of a group of `GROUPS`; empty of a pure number, and if units are not known."""
        kind = _KINDS.get(GROUPS.get(name, (name,))[0], "number")
        return tables.standard_unit(kind) if self.si and kind != "number" else ""

    def where(self, i: int) -> str:
        """Line of a collision in its file, for messages."""
        return f"collision {i + 1}" if self.line is None else f"line {self.line[i]}"

    def normal(self) -> tuple[Array, Array]:
        """Direction of the normal and its standard error [rad], (n,): by nx, ny if given, else by the places."""
        if all(name in self.measured for name in NORMAL):
            x, y = (self.measured[name] for name in NORMAL)
            variance = [self.errors[name] ** 2 for name in NORMAL]
        else:
            (x_1, y_1, x_2, y_2), e = (self.measured[name] for name in CENTRES), self.errors
            x, y = x_2 - x_1, y_2 - y_1
            variance = [e["x_1"] ** 2 + e["x_2"] ** 2, e["y_1"] ** 2 + e["y_2"] ** 2]
        length = np.hypot(x, y)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.arctan2(y, x), np.sqrt(y**2 * variance[0] + x**2 * variance[1]) / length**2

    def kinds(self) -> list[Collisions]:
        """The collisions of each pair of kinds of disks (mass, radius, k, material), the most frequent pair first."""
        n = len(self)
        one, two = (
            np.stack([*_per_collision(disk, n).values()], axis=-1) for disk in (self.disk_1, self.disk_2)
        )
        rows: dict[tuple[str, tuple[tuple[float, ...], ...]], list[int]] = {}
        for i in range(n):
            pair = tuple(sorted((tuple(one[i].tolist()), tuple(two[i].tolist()))))
            rows.setdefault((self.materials[i] if self.materials else "", pair), []).append(i)
        if len(rows) == 1:
            return [self]
        return [self._part(each) for each in sorted(rows.values(), key=lambda each: -len(each))]

    def _part(self, rows: Sequence[int]) -> Collisions:
        """The collisions of these rows."""
        n = len(self)
        disks = [
            _of_columns({key: value[rows] for key, value in _per_collision(disk, n).items()})
            for disk in (self.disk_1, self.disk_2)
        ]
        return Collisions(
            disk_1=disks[0],
            disk_2=disks[1],
            measured={name: np.asarray(value)[rows] for name, value in self.measured.items()},
            errors={name: np.asarray(value)[rows] for name, value in self.errors.items()},
            covariance={name: np.broadcast_to(value, (n,))[rows] for name, value in self.covariance.items()},
            source=self.source,
            line=np.arange(1, n + 1)[rows] if self.line is None else self.line[rows],
            notes=self.notes,
            materials=tuple(self.materials[i] for i in rows) if self.materials else (),
            si=self.si,
        )

    def problem(self, pair: Pair | None = None) -> CollisionProblem:
        """The collisions as a fit sees them."""
        phi, s_phi = self.normal()
        moving = MOTION[:3] if self.wall else MOTION
        names = (DIRECTION, *moving, *(f"{name}_after" for name in moving))
        none = np.full(len(self), math.nan)
        y = np.stack([phi, *(self.measured.get(name, none) for name in names[1:])], axis=-1)
        s = np.stack([s_phi, *(self.errors.get(name, none) for name in names[1:])], axis=-1)
        n = len(self)
        covariance = {
            (names.index(a), names.index(b)): np.broadcast_to(np.asarray(value, dtype=np.float64), (n,))
            for (a, b), value in self.covariance.items()
            if a in names and b in names
        }
        walls = [np.nan_to_num(self.measured.get(name, none)) for name in MOTION[3:]] if self.wall else []
        disks = [each for disk in (self.disk_1, self.disk_2) for each in _per_collision(disk, n).values()]
        return CollisionProblem(names, y, s, [_group(name) for name in names], disks, walls, covariance)


@validated
def read(
    path: str | os.PathLike[str],
    errors: Mapping[str, Size] | None = None,
    *,
    disk_1: Disk | None = None,
    disk_2: Disk | None = None,
    form: TableFormat = TableFormat(),  # noqa: B008  (frozen)
    min_quality: Fraction = 0.01,
) -> Data | Collisions:
    """Read a table of measured impacts.

    The first line that is not a comment names the columns. With psi it is a table of angles, see `Data`; with
    velocities a table of whole collisions, see `Collisions`. NAME_error holds standard errors where they
    differ from line to line, cov:NAME:NAME covariances. Units in brackets, such as (deg) or [cm/s], are
    converted: angles of a table of angles to degrees, all else to SI units. An error without a unit of its own has
    that of its column, a covariance the product of the units of its two columns. Missing values are left empty or
    are written nan, NA or -.

    Raises InputError with a line for each thing that is wrong.

    Parameters
    ----------
    path : path
        The file.
    errors : mapping of str to float, optional
        Errors of whole columns, by their names or those of `GROUPS`; "normal" [rad] for that of nx, ny. NaN
        for one to be estimated from the residuals, 0 for values that are exact (of collisions), "before" for the whole
        motion before, "rest" for all columns that have none. A column of errors comes first, then the error by name,
        then that of the group.
    disk_1, disk_2 : Disk, optional
        Of whole collisions, unless columns mass_1, radius_1, k_1, ... give them.
    form : TableFormat, optional
        Names, units and signs of the file.
    min_quality : float
        Whole collisions whose column quality is below it are left out, see `impacts.FoundCollisions`.

    Examples
    --------
    >>> from ifrdem import fit
    >>> data = fit.read("data.csv", {"angles": 0.7})  # of `ifrdem fit --example > data.csv`
    >>> sorted(data.measured)
    ['delta_1', 'delta_2']
    """
    kinds = {**{name: "angle" if name in ANGLES else "number" for name in COLUMNS}, **_KINDS}
    spellings = {**_SPELLINGS, **_COLLISION_SPELLINGS}
    kinds["quality"], spellings["quality"] = "number", "quality"
    for i in "12":
        kinds[f"material_{i}"] = "text"
        spellings |= dict.fromkeys((f"material{i}", f"species{i}"), f"material_{i}")
    moving = (DIRECTION, *MOTION, *AFTER)
    kinds[DIRECTION], spellings[DIRECTION] = "direction", DIRECTION
    covariances = {f"{tables.COVARIANCE}{a}:{b}": (a, b) for a in moving for b in moving if a != b}
    kinds |= dict.fromkeys(covariances, "number")
    spellings |= {tables.plain(name): name for name in covariances}
    found = tables.read(path, kinds, spellings, form)
    columns, notes, lines = dict(found.columns), [], found.line
    if (quality := columns.pop("quality", None)) is not None:
        good = ~(quality < min_quality)
        if not good.any():
            raise InputError(f"{found.source}: no line has a quality of {min_quality:g} or more")
        if not good.all():
            notes.append(f"{np.sum(~good)} of {len(good)} lines are left out: quality below {min_quality:g}")
        columns, lines = {name: value[good] for name, value in columns.items()}, lines[good]
    if found.missing:
        notes.append(f"{found.missing} value{'s are' if found.missing > 1 else ' is'} missing and left out")
    if unused := [name for name in found.unused if name not in UNUSED_OF_COLLISIONS]:
        notes.append(f"{UNUSED}: {', '.join(unused)}")
    named = [columns.pop(f"material_{i}", None) for i in "12"]
    present = [name for name in columns if not name.endswith("_error")]
    whole = [name for name in present if name in _KINDS]
    angles = [name for name in present if name in COLUMNS]
    source = found.source
    if whole and angles:
        both = f"a table of angles ({', '.join(angles)}) and of whole collisions ({', '.join(whole)})"
        raise InputError(f"{source}: columns of {both} are both given: must be one of the two")
    if not whole and "psi" not in angles:
        raise InputError(
            f"{source}: missing column psi; there are {', '.join(angles) or 'none that is known'}"
        )
    if not whole and len(angles) == 1:
        raise InputError(
            f"{source}: missing column delta_2, or another that was measured: {', '.join(MEASURED)}; there is psi only"
        )
    quantities = [name for name in (angles or whole) if name not in _DISKS]
    given, problems = _given_errors(quantities, columns, dict(errors or {}), form, len(lines))
    refuse(problems, source, most=20)
    measured = {name: columns[name] for name in quantities}
    if whole:
        disks = [_disk(source, i, columns, disk) for i, disk in ((1, disk_1), (2, disk_2))]
        refuse([each for each in disks if isinstance(each, str)])
        first, second = (each for each in disks if isinstance(each, Disk))
        return Collisions(
            disk_1=first,
            disk_2=second,
            measured=measured,
            errors=given,
            covariance={pair: columns[name] for name, pair in covariances.items() if name in columns},
            source=source,
            line=lines,
            notes=tuple(notes),
            materials=_materials(
                source, named, found.texts, wall=bool(np.isinf(np.asarray(second.mass)).all())
            ),
            si=found.si,
        )
    after = [~np.isnan(measured[name]) for name in quantities if name != "psi"]
    keep = ~np.isnan(columns["psi"]) & np.any(after, axis=0)
    if not keep.all():
        lost = ", ".join(str(line) for line in lines[~keep][:10]) + ", ..." * bool(np.sum(~keep) > 10)
        text = "lines without psi or without a value after the impact are left out"
        notes.append(f"{np.sum(~keep)} {text}: {lost}")
    psi = measured.pop("psi")[keep]
    return Data(
        psi=psi,
        measured={name: value[keep] for name, value in measured.items()},
        errors={name: value[keep] for name, value in given.items()},
        source=source,
        line=lines[keep],
        notes=tuple(notes),
    )


def _materials(
    source: str, named: Sequence[Array | None], texts: Sequence[str], *, wall: bool
) -> tuple[str, ...]:
    """The pair of materials of each collision, from columns of indices of texts; of a wall it may be left out."""
    first, second = named
    if first is None and second is None:
        return ()
    if first is None or (second is None and not wall):
        raise InputError(f"{source}: material_1 and material_2: must both be given")
    pairs = [first] if second is None else [first, second]
    return tuple(", ".join(sorted(texts[int(one)] for one in each)) for each in np.stack(pairs, axis=-1))


def _given_errors(
    quantities: Sequence[str],
    columns: Mapping[str, Array],
    errors: dict[str, float],
    form: TableFormat,
    n: int,
) -> tuple[dict[str, Array], list[Problem]]:
    """The error of each quantity, and mistakes in them."""
    rest = errors.pop("rest", None)
    given: dict[str, Array] = {}
    problems: list[Problem] = []
    for name in quantities:
        groups = [group for group, names in GROUPS.items() if name in names]
        wider = [DIRECTION] * (name in NORMAL) + [BEFORE] * (name in MOTION)
        by = [each for each in (name, *wider, *groups) if each in errors]
        if f"{name}_error" in columns:
            given[name] = columns[f"{name}_error"]
            gaps = np.isnan(given[name]) & ~np.isnan(columns[name])
            if gaps.any():
                problems.append(
                    Problem(f"{name}_error", None, f"missing for {int(gaps.sum())} values of {name}")
                )
        elif name in NORMAL and f"{DIRECTION}_error" in columns:
            given[DIRECTION] = columns[f"{DIRECTION}_error"]
        elif name in form.known:
            given[name] = np.zeros(n)
        elif by:
            given[DIRECTION if by[0] == DIRECTION else name] = np.full(n, errors[by[0]])
        elif rest is not None:
            given[name] = np.full(n, rest)
        else:
            problems.append(_missing(name))
    problems += [
        Problem("errors", None, f"the file has no column {name}{there_are(name, quantities)}")
        for name in errors
        if name not in quantities
        and not set(quantities) & set({**GROUPS, DIRECTION: NORMAL, BEFORE: MOTION}.get(name, ()))
    ]
    return given, problems


def _disk(source: str, i: int, columns: Mapping[str, Array], disk: Disk | None) -> Disk | str:
    values = {key: columns[f"{key}_{i}"] for key in ("mass", "radius", "k") if f"{key}_{i}" in columns}
    if disk is not None:
        return _of_columns({**vars(disk), **values})
    if not {"mass", "radius"} <= set(values):
        how = option_name(f"--disk-{i} MASS,RADIUS,K{' or wall' * (i == 2)}", f"disk_{i}")
        return f"{source}: disk {i} is not known: give {how}, or columns mass_{i} and radius_{i}"
    return _of_columns(values)


@validated
def example(seed: Seed = 1) -> str:
    """A small CSV file of synthetic impacts; its comment gives their coefficients.

    Examples
    --------
    >>> from ifrdem import fit
    >>> fit.example(seed=1).splitlines()[0][:1]
    '#'
    """
    rng = np.random.default_rng(seed)
    psi = np.linspace(4.0, 72.0, 18)
    none = np.zeros((len(psi), 3))
    problem = AngleProblem(("psi", "delta_1", "delta_2"), none, none + 1.0, ["angles"] * 3, Pair(M=1.0))
    exact = problem.predict(
        LAWS["ifr-percussion"], np.array([*EXAMPLE_LAW.values()]), np.radians(psi)[:, None]
    )
    shown = exact + rng.normal(0.0, EXAMPLE_ERROR, (len(psi), 3))
    shown = np.abs(shown)  # a measured angle next to the line of centres is counted from it to either side
    law = ", ".join(f"{name} = {value}" for name, value in EXAMPLE_LAW.items())
    header = (
        f"# SYNTHETIC, not measured: two equal homogeneous disks with {law}, percussion centre, and Gaussian\n"
        f"# errors of {EXAMPLE_ERROR} degrees in every angle. Angles are in degrees from the line of centres.\n"
        f"# Fit it: ifrdem fit THIS_FILE --M 1 --error {EXAMPLE_ERROR}\n"
        "psi,delta_1,delta_2\n"
    )
    return header + "".join(f"{a:.2f},{b:.2f},{c:.2f}\n" for a, b, c in shown)


def _group(name: str) -> str:
    """The columns that share an estimated error."""
    return next((group for group, names in GROUPS.items() if name in names), name)


def _pairs(covariance: Iterable[Any]) -> list[tuple[str, str]]:
    """Keys of covariances; InputError for one that does not name two quantities."""
    for each in covariance:
        if not (isinstance(each, tuple) and len(each) == 2):
            raise InputError(f"covariance: key {each!r} must be a pair of names")
    return list(covariance)


def _per_collision(disk: Disk, n: int) -> dict[str, Array]:
    """Mass, radius and k of a disk for each of n collisions, (n,)."""
    of = {key: np.asarray(getattr(disk, key), dtype=np.float64) for key in ("mass", "radius", "k")}
    return {key: np.broadcast_to(value, (n,)) for key, value in of.items()}


def _unknown(names: Iterable[str], known: Collection[str]) -> list[Problem]:
    return [
        Problem(name, None, f"no such quantity{there_are(name, known)}")
        for name in names
        if name not in known
    ]


def _name_problems(values: Collection[str], errors: Collection[str]) -> list[Problem]:
    missing = [_missing(name) for name in values if name not in errors]
    others = [name for name in errors if name not in values]
    return missing + [
        Problem("errors", None, f"{name} was not measured{nearest(name, values)}") for name in others
    ]


def _missing(name: str) -> Problem:
    return Problem(name, None, f"missing from errors: {_how_to_give(name)}")


def _how_to_give(name: str) -> str:
    group = DIRECTION if name in NORMAL else _group(name)
    of_groups = {"angles": "DEGREES for all angles", DIRECTION: f"{DIRECTION}=RADIANS"}
    all_of = f" (or --error {of_groups.get(group, f'{group}=VALUE')})" if group != name else ""
    here = f"errors[{name!r}]{f' (or errors[{group!r}])' if group != name else ''}"
    return f"give a column {name}_error, {option_name(f'--error {name}=VALUE{all_of}, or --error estimate', here)}"


def _column(source: str, name: str, value: ArrayLike, n: int) -> Array:
    """Values of n impacts, (n,); a number stands for all."""
    array = np.array(np.broadcast_to(value, n) if np.ndim(value) == 0 else value, dtype=np.float64)
    if array.shape != (n,):
        raise InputError(f"{source}: {name} has shape {array.shape}: must be ({n},), as psi has")
    return array


RowProblem = tuple[int, Problem | str]
"""A mistake with the index of its row."""


def _rows(
    name: str, check: Number, values: Array, where: NDArray[np.bool_] | Literal[True] = True
) -> list[RowProblem]:
    """A problem for each value that a check refuses; only those that are looked at, shape (n,)."""
    text = f"must be {check.needed}"
    wrong = np.flatnonzero(checked.refused(check, values) & where)
    return [(int(i), Problem(name, f"{values[i]:g}", text)) for i in wrong]


def _at(rows: NDArray[np.bool_], text: str) -> list[RowProblem]:
    """Rows that are marked, shape (n,), each with this problem."""
    return [(int(i), text) for i in np.flatnonzero(rows)]


def _refuse_rows(source: str, found: list[RowProblem], line: NDArray[np.int64] | None) -> None:
    """Raise InputError with every mistake, in the order of the lines."""
    place = (lambda i: f"impact {i + 1}") if line is None else (lambda i: f"line {line[i]}")
    refuse([f"{place(i)}: {text}" for i, text in sorted(found, key=lambda each: each[0])], source)
