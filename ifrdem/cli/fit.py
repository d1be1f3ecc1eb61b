"""Commands between an experiment and a law or run: `collisions`, `fit`, `compare`."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from .. import errors
from ..errors import InputError, nearest, refuse, there_are
from ..tools.files import check_files, write_text
from ..tools.values import Fraction, Integer, Natural, NonNegative, Number, Positive, Ratio, RatioOrZero, Real
from .console import FAILED, complain, echo, note
from .options import (
    File,
    Force,
    OptionProblems,
    Output,
    counted,
    flag,
    of_text,
    option,
)  # fmt: skip

if TYPE_CHECKING:
    from ..fit.data import Disk

FORMAT = """\
DATA is a CSV file: a line with the names of the columns, then a line for each impact. Lines that begin with # are comments.

A table of angles, of disk 1 on disk 2 at rest or on a wall (--M 0), nothing spinning; degrees from the line of centres:

  psi              impact angle, from 0 to below 90 (needed)
  delta_1          direction of disk 1 after the impact, above 90 where it bounces back
  delta_2          direction of disk 2 after the impact
  Rw_2             R_2 omega_2 / v_o, clockwise positive
  sqrt_d2_d1       sqrt(d_2 / d_1) of the stopping distances
  rebound          180 - delta_1
  rebound_contact  direction of the contact point of disk 1 relative to disk 2 after the impact
  v_t_ratio        tangential velocity of disk 1 after over before
  Rw_1             R_1 omega_1 / v_o, clockwise positive
  e_t_apparent     e_t*, slip after the impact over slip before, times -1

A table of whole collisions, in any frame; any of the last two rows, and the normal:

  x_1 y_1 x_2 y_2  centres at the impact, or nx ny: from disk 1 to disk 2 or to the wall
  vx_1 vy_1 spin_1 vx_2 vy_2 spin_2   before; spins counter-clockwise, rad per time
  vx_1_after ... spin_2_after         after

NAME_error holds standard errors that differ from line to line. Missing values are empty, nan, NA or -. Units stand in
brackets, as in psi (rad) or vx_1 [cm/s]. For instance:

  # numbers made up
  psi,delta_1,delta_2,delta_2_error
  15.0,75.1,12.0,0.5
  50.0,83.9,13.1,0.8

  ifrdem fit data.csv --pair "1 pta" "1 pta" --error 0.7
  ifrdem fit data.csv --M 1.3 --error 0.5 --error psi=1 --picture fit --write-material coins.toml
  ifrdem fit hits.csv --disk-1 1.19e-3,10.5e-3,2 --disk-2 wall --set nx=0 --set ny=-1 --robust
  ifrdem fit data.csv --M 1 --error estimate --model all --design 10
  ifrdem fit hits.csv hits_walls.csv --write-case gas.toml     a gas with these coefficients and their errors
  ifrdem fit --example > data.csv     writes synthetic data to try it on
"""

DISKS = Group("The disks; --M or --pair for angles, --disk-1 and --disk-2 for collisions", sort_key=1)
TABLE = Group("The table", sort_key=2)
C = Parameter(metavar="C")
K, R = option(Ratio, "K", ""), option(Positive, "R", "")
MASS_RATIO = option(RatioOrZero, "M", "", "--M")
LEVEL = option(Annotated[float, Number(1e-4, 100.0 - 1e-4, "a percentage between 0 and 100")], "PERCENT", "")
QUALITY = option(Fraction, "P", "")
FILE, PAIRS = Parameter(metavar="FILE"), Parameter(metavar="NAME=VALUE")


def counting(low: int, high: int = 1_000_000) -> Parameter:
    """An option that takes a number of things."""
    return option(Annotated[int, Integer(low, high)], "N", "")


@Parameter(name="*", group=DISKS, help="the two disks")
@dataclass(frozen=True, kw_only=True)
class DiskOptions:
    """Options that name the two disks."""

    M: Annotated[float | None, MASS_RATIO] = None
    """mass ratio m_1 / m_2; disk 1 is the one that moves; 0 for a wall"""
    k_1: Annotated[float | None, K] = None
    """k in I = m R^2 / k of disk 1: 2 homogeneous disk (default), 1 hoop"""
    k_2: Annotated[float | None, K] = None
    """the same of disk 2"""
    R_1: Annotated[float | None, R, Parameter(name="--R-1")] = None
    """radius of disk 1 [length]; only --rolling needs radii"""
    R_2: Annotated[float | None, R, Parameter(name="--R-2")] = None
    """radius of disk 2 [the same length]"""
    pair: Annotated[tuple[str, str] | None, Parameter(metavar="COIN COIN")] = None
    """two coins of the paper instead, in SI units"""
    disk_1: Annotated[str | None, Parameter(metavar="MASS,RADIUS,K")] = None
    """disk 1 of whole collisions; default of K: 2"""
    disk_2: Annotated[str | None, Parameter(metavar="MASS,RADIUS,K")] = None
    """disk 2, or wall"""


@Parameter(name="*", group=TABLE, help="the writing of the table")
@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """Options on the format of a table."""

    column: Annotated[list[str] | None, Parameter(metavar="NAME=TEXT")] = None
    """the column that NAME stands for, such as psi="impact angle"; repeatable"""
    unit: Annotated[
        list[str] | None,
        option(
            str,
            "NAME=UNIT",
            "unit of a column, such as psi=rad or x=mm, or a factor; repeatable. Angles of a table of angles become "
            "degrees, all else SI units",
        ),
    ] = None
    delimiter: Annotated[str | None, C] = None
    """separates columns: a character, or tab (default: ,)"""
    decimal: Annotated[str | None, C] = None
    """separates decimals: . or , (default: .)"""


@Parameter(name="*", group=Group("The fit", sort_key=3), help="the fit")
@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Options on the fit."""

    known: Annotated[list[str] | None, PAIRS, Parameter(name="--set", group=TABLE)] = None
    """a value that every line has exactly, such as spin_1=0; repeatable"""
    error: Annotated[
        list[str] | None,
        option(
            str,
            "E",
            "standard error of all angles [degrees], or NAME=E of a column or of positions, velocities, spins, normal "
            "[rad], before; 0: exact, of collisions; estimate (default): missing ones from the residuals; repeatable. "
            "Columns such as delta_2_error take precedence",
        ),
    ] = None
    model: Annotated[list[str] | None, Parameter(metavar="LAW")] = None
    """ifr-percussion, ifr-contact, ifr-viscoelastic, walton, walton-viscoelastic, brach, smooth, all; repeatable (default: the first two)"""
    law: Annotated[str | None, Parameter(metavar="FILE.py:CLASS")] = None
    """a custom law in addition, see own-law in the manual"""
    range: Annotated[list[str] | None, Parameter(metavar="NAME=LOW:HIGH")] = None
    """range of a coefficient of that law; repeatable"""
    fix: Annotated[list[str] | None, PAIRS] = None
    """a coefficient that is not fitted, such as e_t=-1; repeatable"""
    robust: bool = False
    """Student-t likelihood: outliers have little weight"""
    level: Annotated[float, LEVEL] = 95.0
    """confidence of the intervals (default: 95)"""
    cross_validate: bool = False
    """predict impacts from the others: each one, or of more than 30 each tenth"""
    design: Annotated[int, counting(1)] = 0
    """expected gain of N further impacts by angle: the next experiment"""
    rolling: bool = False
    """fit rolling friction rho too, from Rw_2 or e_t_apparent"""
    bootstrap: Annotated[int, counting(40)] = 0
    """additional intervals from N synthetic data sets"""
    kind: Annotated[int | None, counting(0)] = None
    """fit only the N-th pair of kinds of disks (mass, radius, k), from 1; 0 fits all together (default: one by one)"""
    min_quality: Annotated[float, QUALITY] = 0.01
    """least quality (a column that `ifrdem collisions` writes) of lines that are used (default: 0.01)"""
    seed: Annotated[int | None, option(Natural, "N", "")] = None
    """seed of the bootstrap and of --draw (default: 1)"""


@Parameter(name="*", group=Group("Files to write", sort_key=4), help="files")
@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """Options that name files."""

    json: Annotated[Path | None, FILE] = None
    """everything that was found"""
    picture: Annotated[str | None, Parameter(metavar="NAME")] = None
    """NAME.png and NAME.pdf: data, laws, residuals; NAME_corner: coefficients in pairs; NAME_speeds: speed trends"""
    draw: Annotated[int, counting(1)] = 0
    """N sets of coefficients drawn with their covariance, into --draws"""
    draws: Annotated[Path | None, FILE] = None
    """CSV file for --draw (default: draws.csv)"""
    write_material: Annotated[Path | None, FILE] = None
    """a [[material]] table for case files (TOML)"""
    write_case: Annotated[Path | None, FILE] = None
    """a case (TOML): species, materials, pairs, walls, with errors of coefficients for `ifrdem study --coefficients`"""
    material_name: Annotated[str | None, Parameter(metavar="NAME")] = None
    """its name, or that of unnamed disks of a case (default: that of the data file)"""


def fit(
    *data: Annotated[
        str,
        Parameter(
            name="DATA",
            help="a CSV file of measured impacts (`ifrdem docs fit`); several: of disks and of walls",
        ),
    ],
    example: Annotated[bool, flag("print a synthetic CSV file and do nothing else")] = False,
    disks: DiskOptions = DiskOptions(),
    table: TableOptions = TableOptions(),
    options: FitOptions = FitOptions(),
    files: FileOptions = FileOptions(),
    force: Force = False,
) -> int:
    """Fit the coefficients of collision laws to measured impacts.

    Takes tables of angles, or whole collisions with velocities and spins before and after: maximum likelihood
    with errors in every value, intervals by profile likelihood, laws compared. Prints a table.
    """
    if example:
        if data:
            raise InputError(
                f"--example prints its data and reads none: `ifrdem fit --example > {data[0]}` writes them"
            )
        from ..fit.data import example as synthetic

        echo(synthetic().rstrip("\n"))
        return 0
    problems = OptionProblems()
    if not data:
        problems.append("DATA is missing: give a CSV file; `ifrdem fit --example` prints one")
    pair = _disks(disks, options.rolling, problems)
    both = _collision_disks(disks, problems)
    form = form_of(table, problems, options.known)
    errors = _errors(options.error or ["estimate"], problems)
    fixed = _pairs("--fix", options.fix, problems)
    ranges = _ranges(options.range, problems)
    if options.range and options.law is None:
        problems.append("--range requires --law")
    further, drawn, sets = options.design, files.draw, options.bootstrap
    seed = 1 if options.seed is None else options.seed
    if options.seed is not None and not sets and not drawn:
        problems.append("--seed requires --bootstrap or --draw")
    if files.draws is not None and not drawn:
        problems.append("--draws requires --draw")
    if files.material_name is not None and files.write_material is None and files.write_case is None:
        problems.append("--material-name requires --write-material or --write-case")
    sources = [Path(each) for each in data]
    name = (sources or [Path("data.csv")])[0].stem if files.material_name is None else files.material_name
    if (files.write_material or files.write_case) is not None and not 1 <= len(name) <= 100:
        problems.append(f"--material-name {name!r}: must have 1 to 100 characters")
    stem = problems.parse("", _picture_stem, "--picture", files.picture)
    parts_of_picture = ("", "_corner", "_speeds")
    endings = [f"{part}{end}" for part in parts_of_picture for end in (".png", ".pdf")] if stem else []
    pictures = [Path(f"{stem}{end}") for end in endings]
    record, material = files.json, files.write_material
    sample = (files.draws or Path("draws.csv")) if drawn else None
    written = [each for each in (record, *pictures, material, sample) if each is not None]
    of_all = [] if files.write_case is None else [files.write_case]
    _check_files([*written, *of_all], sources, force, problems)
    problems.end()

    from ..fit import laws as of_laws
    from ..fit.data import Data, read

    kinds = list(options.model or (of_laws.IFR if options.law is None else ()))
    own = [] if options.law is None else [of_laws.own_from_file(options.law, ranges)]
    of_laws.chosen(kinds, fixed, own)  # refuses names before the file is read
    tables = [read(each, errors, form=form, min_quality=options.min_quality, **both) for each in sources]
    for measured in tables:
        if not isinstance(measured, Data) and pair:
            raise InputError(
                f"{', '.join(map(_dashed, pair))}: of tables of angles; collisions need --disk-1 and --disk-2"
            )
        if isinstance(measured, Data) and "M" not in pair:
            raise InputError(
                "--M is missing: give the mass ratio m_1 / m_2, 0 for a wall, or --pair with two coins of the paper"
            )
    from ..fit import maximum, report  # import SciPy, which is slow

    parts = _parts(tables, options.kind, written)
    progress = _progress(len(parts))
    every = [maximum.fit(
        part, **dict[str, Any](pair), model=kinds, own=own, fix=fixed, rolling=options.rolling,
        robust=options.robust, level=0.01 * options.level, cross_validate=options.cross_validate,
        bootstrap=sets, seed=seed, progress=progress(i),
    ) for i, part in enumerate(parts)]  # fmt: skip
    for i, found in enumerate(every, start=1):
        if len(every) > 1:
            echo("\n" * (i > 1) + f"pair of kinds of disks {i} of {len(every)} (--kind {i}):")
        echo(report.table(found))
        if further:
            from ..fit.next_experiment import design

            echo("\n" + design(found, further).table())
    if len(every) > 1:
        echo("\n" + report.overview(every))
    if sample is not None:
        write_text(sample, report.draws(found, drawn, seed))
    if record is not None:
        write_text(record, report.as_json(found))
    if pictures:
        from ..fit import figure

        figure.draw(found, pictures[:2])
        figure.corner(found, pictures[2:4])
        if found.laws[found.best].trends is not None:
            figure.speeds(found, pictures[4:])
        else:
            written = [each for each in written if each not in pictures[4:]]
    status = 0
    if material is not None:
        try:
            write_text(material, report.material(found, name))
        except InputError as error:  # a law that no case would take
            complain(str(error))
            status = FAILED
            written.remove(material)
    for path in of_all:
        from ..case import fitted

        try:
            write_text(path, fitted.text_of(every, name, path.stem))
            written.append(path)
        except InputError as error:
            complain(str(error))
            status = FAILED
    if written:
        note(f"\nwrote {', '.join(map(str, written))}")
    return status


def _parts(tables: Sequence[Any], kind: int | None, written: Sequence[Path]) -> list[Any]:
    """The tables to fit: one for each pair of kinds of disks, or by `kind` one of them, or all of a file together."""
    from ..fit.data import Data

    if kind is not None and any(isinstance(each, Data) for each in tables):
        raise InputError("--kind: cannot be combined with a table of angles")
    parts: list[Any] = [
        part for each in tables for part in ([each] if kind == 0 or isinstance(each, Data) else each.kinds())
    ]
    if kind:
        if kind > len(parts):
            raise InputError(f"--kind {kind}: must be an integer from 0 to {len(parts)}")
        return [parts[kind - 1]]
    if len(parts) > 1 and written:
        raise InputError(
            f"{written[0]}: there are {len(parts)} pairs of kinds of disks; choose one by --kind 1 to {len(parts)}, or "
            "fit all of a file together by --kind 0"
        )
    return parts


def _progress(fits: int) -> Callable[[int], Callable[[float], None]]:
    """Progress of each of several fits, shown from two seconds on."""
    from ..tools.progress import Stage, quiet

    stage = None if quiet() else Stage("fit", interval=2.0)

    def of(i: int) -> Callable[[float], None]:
        return lambda part: stage((i + part) / fits) if stage is not None else None

    return of


def _check_files(paths: Sequence[Path], data: Sequence[Path], force: bool, problems: OptionProblems) -> None:
    """Note reasons why files cannot be written."""
    problems += [f"output {path}: is the data file" for path in paths if path in data]
    problems += [f"output {path}: is given twice" for path in dict.fromkeys(paths) if paths.count(path) > 1]
    try:
        check_files(paths, force=force, elsewhere="another name keeps it")
    except InputError as error:
        problems += str(error).splitlines()


def _picture_stem(option: str, given: str) -> str:
    """The path of pictures without the ending; InputError if no name is in it."""
    stem = given.removesuffix(".png").removesuffix(".pdf")
    if os.path.basename(stem) in ("", os.curdir, os.pardir):
        raise InputError(f"{option} {given}: must be the path of a file, with or without .png")
    return stem


def _dashed(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _disks(given: DiskOptions, rolling: bool, problems: OptionProblems) -> dict[str, float]:
    """Mass ratio, moments of inertia and radii of a table of angles."""
    numbers = {
        name: value
        for name in ("M", "k_1", "k_2", "R_1", "R_2")
        if (value := getattr(given, name)) is not None
    }
    if given.disk_1 is not None or given.disk_2 is not None:
        names = [*numbers, *(["pair"] if given.pair else [])]
        problems += [f"{_dashed(name)}: cannot be combined with --disk-1 and --disk-2" for name in names]
        return {}
    if given.pair is not None:
        from ..model.laws.coin_table import coins

        problems += [f"{_dashed(name)}: cannot be combined with --pair, which gives it" for name in numbers]
        if unknown := [coin for coin in given.pair if coin not in coins]:
            problems += [f"--pair '{coin}': no such coin{there_are(coin, coins)}" for coin in unknown]
            return {"M": 1.0}
        a, b = (coins[coin] for coin in given.pair)
        return {"M": a.mass / b.mass, "k_1": a.k, "k_2": b.k, "R_1": a.radius, "R_2": b.radius}
    if rolling:
        missing = [name for name in ("R_1", "R_2") if name not in numbers]
        problems += [f"{_dashed(name)} is missing: --rolling requires it" for name in missing]
    elif ("R_1" in numbers) != ("R_2" in numbers):
        problems.append("--R-1, --R-2: must be given together")
    return numbers


def disk_of(option: str, text: str, problems: OptionProblems, also: str = "") -> Any:
    """The disk of MASS,RADIUS,K; None if the text is invalid."""
    from ..fit.data import Disk

    parts = text.split(",")
    if len(parts) not in (2, 3):
        problems.append(f"{option}: must be MASS,RADIUS or MASS,RADIUS,K{also}")
        return None
    values = [problems.parse(1.0, of_text, f"{option}:", part, Positive) for part in parts]
    return Disk(mass=values[0], radius=values[1], k=values[2] if len(values) == 3 else 2.0)


def _collision_disks(given: DiskOptions, problems: OptionProblems) -> dict[str, Any]:
    """The disks of whole collisions."""
    found: dict[str, Any] = {}
    if given.disk_1 is not None:
        found["disk_1"] = disk_of(f"--disk-1 {given.disk_1}", given.disk_1, problems)
    if given.disk_2 is not None and given.disk_2.strip() == "wall":
        from ..fit.data import WALL

        found["disk_2"] = WALL
    elif given.disk_2 is not None:
        found["disk_2"] = disk_of(f"--disk-2 {given.disk_2}", given.disk_2, problems, " or wall")
    return found


def _split(option: str, texts: list[str] | None, problems: OptionProblems) -> dict[str, str]:
    """Name and text of NAME=TEXT."""
    found: dict[str, str] = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        name = name.strip()
        if not equals or not name or not value.strip():
            problems.append(f"{option} {text}: must be NAME=VALUE")
        elif name in found:
            problems.append(f"{option} {text}: {name} is given twice")
        else:
            found[name] = value.strip().strip("\"'")
    return found


def _pairs(option: str, texts: list[str] | None, problems: OptionProblems) -> dict[str, float]:
    """Numbers by name, of NAME=NUMBER."""
    return {
        name: problems.parse(0.0, of_text, f"{option} {name} =", value, Real)
        for name, value in _split(option, texts, problems).items()
    }


def _ranges(texts: list[str] | None, problems: OptionProblems) -> dict[str, tuple[float, float]]:
    """Ranges by name, of NAME=LOW:HIGH."""
    found = {}
    for name, value in _split("--range", texts, problems).items():
        low, colon, high = value.partition(":")
        if not colon:
            problems.append(f"--range {name}={value}: must be NAME=LOW:HIGH")
            continue
        ends = [problems.parse(0.0, of_text, f"--range {name} =", each, Real) for each in (low, high)]
        found[name] = (ends[0], ends[1])
    return found


def form_of(table: TableOptions, problems: OptionProblems, known: list[str] | None = None) -> Any:
    """The format of the table; all its lines have the `known` values."""
    from ..tools.tables import TableFormat

    given = table.delimiter or ","
    separator = {"tab": "\t", "\\t": "\t"}.get(given, given)
    columns, units = _split("--column", table.column, problems), _split("--unit", table.unit, problems)
    values = _pairs("--set", known, problems)
    try:
        return TableFormat(columns, units, values, separator, table.decimal or ".")
    except InputError as error:
        problems += [f"--{line}" for line in str(error).splitlines()]
        return TableFormat()


def _errors(texts: list[str], problems: OptionProblems) -> dict[str, float]:
    """Standard errors by column, by group, of all angles, or to be estimated."""
    from ..fit.data import BEFORE, COLLISION_COLUMNS, COLUMNS, DIRECTION, GROUPS

    names = (*COLUMNS, *COLLISION_COLUMNS, *GROUPS, DIRECTION, BEFORE)
    exact = {*names} - {*COLUMNS, "angles"}
    found: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.rpartition("=")
        name = name.strip() if equals else "angles"
        if value.strip() == "estimate":
            found[name if equals else "rest"] = math.nan
            continue
        if name not in names:
            problems.append(f"--error {text}: no column is called '{name}'{there_are(name, names)}")
            continue
        if name in found:
            problems.append(f"--error {text}: given twice")
        found[name] = problems.parse(
            1.0,
            of_text,
            f"--error {name} =" if equals else "--error",
            value,
            NonNegative if name in exact else Positive,
        )
    return found


TRACKS = """\
TRACKS is a CSV file with a line for each disk in each frame: id (or particle, ...), x, y, and t or
frame (with --fps); angle if rotation is visible. Units stand in brackets, as in x (mm) or
angle (rad); angles are in degrees by default, counter-clockwise, with y upwards. A column clip numbers
the clips of a film. Files of tracking programs are read too (`ifrdem docs fit`).

  ifrdem collisions tracks.csv --fps 120 --disk 1.19e-3,10.5e-3,2 -o hits.csv
  ifrdem collisions tracks.csv --fps 240 --disk 0.03,0.025 --disk 7=0.02,0.02 --walls tray.toml
  ifrdem fit hits.csv
"""


def collisions(
    tracks: Annotated[
        str, Parameter(name="TRACKS", help="a CSV file of positions per frame (`ifrdem docs fit`)")
    ],
    /,
    *,
    disk: Annotated[
        list[str] | None,
        option(
            str, "[ID=]MASS,RADIUS,K", "all disks, or the one with this id; K is 2 by default; repeatable"
        ),
    ] = None,
    fps: Annotated[float | None, option(Ratio, "N", "frames per second, with a column frame")] = None,
    disks: Annotated[
        Path | None,
        option(
            str,
            "FILE",
            "a CSV file of disks: id, mass, radius, and optionally k, material; others are --disk",
        ),
    ] = None,
    walls: Annotated[
        str | None,
        option(
            str,
            "CASE",
            "a case file (TOML) with the walls of the tray, its box included; estimate: straight or round ones from "
            "the tracks",
        ),
    ] = None,
    wall: Annotated[
        list[str] | None,
        option(
            str,
            "X1,Y1,X2,Y2",
            "a straight wall through two points; X,Y,R, a round one; three corners or more, a polygon; repeatable. "
            "Walls end flights, and impacts with them go to NAME_walls.csv",
        ),
    ] = None,
    window: Annotated[
        int | None,
        option(
            Annotated[int, Integer(3, 10_000)],
            "N",
            "frames of a flight that are used at most (default: 6 to 30, by the errors of the law of flight; 12 where that is not estimated)",
        ),
    ] = None,
    friction: Annotated[
        str,
        option(
            str,
            "LAW",
            "how the tray slows disks down: estimate, from all flights; plain, coin or ring, under this law only; none; "
            "coin=MU or ring=MU, known; or A0[,A1[,B0[,B1]]], decelerations A0 + A1 v of centres and B0 + B1 w of spins",
        ),
    ] = "estimate",
    noise: Annotated[
        float | None,
        option(
            Positive,
            "S",
            "standard error of a coordinate [m] (default: from the scatter of third differences)",
        ),
    ] = None,
    flip: Annotated[
        list[str] | None,
        option(str, "AXIS", "reverse y (if it points down) or angle (if clockwise); repeatable"),
    ] = None,
    repair_swaps: Annotated[bool, flag("undo exchanges of ids between two tracks")] = False,
    table: TableOptions = TableOptions(),
    output: Output = None,
    force: Force = False,
) -> int:
    """Find collisions in particle tracks.

    Finds the impacts, fits the flights before and after each, and writes the table of whole collisions that
    `ifrdem fit` takes, with errors and their correlations. What was left out or cut is listed in NAME_report.csv.
    """
    problems = OptionProblems()
    form = form_of(table, problems)
    given_disks = _tracked_disks(disk, problems, needed=disks is None)
    drawn = [each for text in wall or () if (each := _wall_numbers(text, problems))]
    problems += [
        f"--flip {each}: must be y or angle{nearest(each, ('y', 'angle'))}"
        for each in flip or ()
        if each not in ("y", "angle")
    ]
    tray = _tray(friction, problems)
    source = Path(tracks)
    if not Path(output or source).name:  # the root, or "."
        raise InputError(
            f"{'TRACKS' if output is None else '-o'} {output or tracks}: is a folder, must be a file"
        )
    path = Path(output) if output is not None else source.with_name(f"{source.stem}_collisions.csv")
    of_walls, report = (path.with_name(f"{path.stem}_{end}.csv") for end in ("walls", "report"))
    _check_files([path, report, *([of_walls] if wall or walls else [])], [source], force, problems)
    problems.end()

    from ..fit import impacts
    from ..fit import tracks as of_tracks
    from ..tools.tables import SI_UNITS

    around = [] if walls in (None, "estimate") else _walls_of(Path(str(walls)))
    table_of_disks: dict[int, Disk] = {}
    materials: dict[int, str] = {}
    if disks is not None:
        table_of_disks, materials = of_tracks.read_disks(disks)
    loaded = of_tracks.read(source, fps=fps, form=form, flip=flip or ())
    around += [of_tracks.wall_of_numbers(each, loaded) for each in drawn]
    every = given_disks.pop(None, None)
    given = {
        one: made
        for one in loaded.time
        if (made := given_disks.get(one, table_of_disks.get(one, every))) is not None
    }
    if walls == "estimate":
        around += _estimated_walls(loaded, given)
    found = impacts.find(
        loaded, given, walls=around, window=window, error=noise, repair_swaps=repair_swaps, friction=tray
    )
    shown = [
        *_summary(found),
        "",
        f"{source}: {len(loaded.time)} disks, {sum(map(len, loaded.time.values()))} positions"
        + f", {len(loaded.clips)} clips" * (len(loaded.clips) > 1),
        *[loaded.note] * bool(loaded.note),
        *(_text_of_wall(each) for each in around if walls == "estimate"),
        f"standard error of a coordinate {found.noise.typical:.3g} m"
        + (f", of an angle {found.noise.angle:.3g} rad" if math.isfinite(found.noise.angle) else ""),
        *found.tray_text(),
    ]
    if loaded.missing:
        shown.append(f"{loaded.missing} lines without a position are left out")
    written = []
    for file, what, columns in ((path, "of two disks", found.pairs), (of_walls, "with walls", found.walls)):
        if columns:
            text = f"collisions {what} in {source.name}, by `ifrdem collisions`; {SI_UNITS}, angles in rad"
            text = "; ".join((text, *found.tray_text()))
            write_text(file, impacts.csv(columns, text, materials))
            written.append(file)
    for exchange in found.exchanges:
        done = (
            "exchanged back"
            if found.repaired
            else "later impacts of the clip have quality 0; --repair-swaps undoes it"
        )
        shown.append(
            f"disks {exchange.ids[0]} and {exchange.ids[1]} exchange their ids at {found.tracks.text(exchange.time)}: {done}"
        )
    if found.left_out or found.cut or found.tray is not None:
        write_text(report, found.report())
        written.append(report)
    shown += [f"warning: {each}" for each in found.warnings]
    echo("\n".join(shown))
    note(f"\nwrote {', '.join(map(str, written))}: `ifrdem fit {written[0]}` fits them")
    return 0


def _summary(found: Any) -> list[str]:
    """Lines on the collisions that were found and that a fit leaves out, the largest part first."""
    tables = {"of two disks": found.pairs, "with walls": found.walls}
    parts = [f"{len(columns['t'])} {what}" for what, columns in tables.items() if columns]
    shown = [f"found {errors.counted(len(found), 'collision')}: {', '.join(parts)}"]
    lost = [(n, f"{n} {reason}") for reason, n in found.reasons.items()]
    lost += [(n, f"{errors.counted(n, 'collision')} {text}") for text, n in found.poor.items() if n]
    return shown + [" " * (8 - len(str(n))) + line for n, line in sorted(lost, reverse=True)]


def _tray(text: str, problems: OptionProblems) -> Any:
    """A law of flight by its name, or one whose constants are known."""
    from ..fit.flight import FRICTION, Tray
    from ..fit.impacts import FRICTIONS
    from ..model.gravity import EARTH

    if text in FRICTIONS:
        return text
    law, equals, mu = text.partition("=")
    try:
        values = [float(each) for each in (mu if equals else text).split(",")]
    except ValueError:
        values = []
    if all(math.isfinite(each) and each >= 0.0 for each in values):
        if equals and law in FRICTION and len(values) == 1 and values[0] > 0.0:
            return Tray(law=law, a0=EARTH * values[0])
        if not equals and 1 <= len(values) <= 4:
            return Tray().changed(dict(zip(("a0", "a1", "b0", "b1"), values, strict=False)))
    given = ", ".join(f"{name}=MU" for name in FRICTION)
    problems.append(f"--friction {text}: must be {', '.join(FRICTIONS)}, {given} or A0[,A1[,B0[,B1]]]")
    return "estimate"


def _estimated_walls(tracks: Any, disks: Mapping[int, Any]) -> list[Any]:
    """Walls from tracks; InputError if a disk is unknown."""
    from ..fit.estimated_walls import estimated
    from ..fit.tracks import of_unknown_size

    refuse(of_unknown_size(tracks, disks))
    return estimated(tracks, {one: float(disk.radius) for one, disk in disks.items()})


def _text_of_wall(wall: Any) -> str:
    """An estimated wall, as --wall takes it."""
    x, y = wall.origin
    if wall.shape != "line":
        return f"estimated wall: --wall {x:.6g},{y:.6g},{wall.radius:.6g}"
    (ends,) = [wall.geometry.path((1.0, 1.0))]
    (x_1, y_1), (x_2, y_2) = ends[0], ends[-1]
    return f"estimated wall: --wall {x_1:.6g},{y_1:.6g},{x_2:.6g},{y_2:.6g}"


def _wall_numbers(text: str, problems: OptionProblems) -> tuple[float, ...] | None:
    """Numbers of a line or of a circle."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    polygon = len(found) >= 6 and len(found) % 2 == 0
    right = all(map(math.isfinite, found)) and (len(found) in (3, 4) or polygon)
    if not right or (len(found) == 3 and found[2] <= 0.0) or (len(found) == 4 and found[:2] == found[2:]):
        problems.append(
            f"--wall {text}: must be X1,Y1,X2,Y2 (two different points), X,Y,R (a circle) or "
            "X1,Y1,X2,Y2,X3,Y3 and so on (a polygon)"
        )
        return None
    return found


def _walls_of(path: Path) -> list[Any]:
    """The walls of a case, the sides of its box included."""
    from ..case import file
    from ..model.walls.wall import sides

    gas = file.read(path).gas
    found = [*gas.walls, *sides(gas.box)]
    if not found:
        raise InputError(f"{path}: has no walls: add [[wall]] tables, or a box that is not periodic")
    return found


def _tracked_disks(
    texts: list[str] | None, problems: OptionProblems, *, needed: bool
) -> dict[int | None, Disk]:
    """Disks by id; None stands for all others."""
    found: dict[int | None, Disk] = {}
    for text in texts or ():
        name, equals, rest = text.rpartition("=")
        made = disk_of(f"--disk {text}", rest, problems, ", with ID= before it for one disk,")
        key = problems.parse(0, of_text, f"--disk {text}: id", name.strip(), Natural) if equals else None
        if key in found:
            problems.append(f"--disk {text}: {f'disk {key} is' if equals else 'all disks are'} given twice")
        found[key] = made
    if needed and not found and not problems:
        problems.append(
            "--disk is missing: give mass, radius and k of the disks, such as --disk 1.19e-3,10.5e-3,2, or --disks FILE"
        )
    return found


MEASURED = """\
MEASURED is a CSV file with a line for each position: id (the disk's number in the run, from 0, as in
its start file), x, y; t for a time other than the end; angle for how far a disk has turned; x_error
and so on.

  ifrdem compare table.h5 rest.csv --error positions=2e-4 --picture table_compared
  ifrdem compare table.h5 rest.csv --draws draws.csv --members 50 --start-error positions=2e-4
"""


def compare(
    file: File,
    measured: Annotated[
        str, Parameter(name="MEASURED", help="a CSV file of measured positions (`ifrdem docs fit`)")
    ],
    /,
    *,
    error: Annotated[
        list[str] | None,
        option(
            str,
            "NAME=E",
            "standard error of measured positions [m] or angles [degrees] without a column; repeatable",
        ),
    ] = None,
    case: Annotated[
        str | None,
        option(
            str,
            "CASE",
            "case file of the run, whose start file has columns of errors (default: the case that FILE holds)",
        ),
    ] = None,
    members: Annotated[
        int,
        option(
            Annotated[int, Integer(4, 100_000)], "N", "runs with drawn start and law, 4 or more (default: 0)"
        ),
    ] = 0,
    draws: Annotated[str | None, option(str, "FILE", "coefficients that `ifrdem fit --draw` wrote")] = None,
    start_error: Annotated[
        list[str] | None,
        option(
            str,
            "NAME=E",
            "standard error of the start's positions [m], velocities [m/s], spins [rad/s], where its "
            "file has no columns "
            "such as x_error; repeatable",
        ),
    ] = None,
    seed: Annotated[int | None, option(Natural, "N", "seed of the drawn starts (default: 1)")] = None,
    table: TableOptions = TableOptions(),
    picture: Annotated[
        str | None, option(str, "NAME", "NAME.png and NAME.pdf: the run, measured positions on top")
    ] = None,
    output: Output = None,
    force: Force = False,
) -> int:
    """Compare a run with measured positions.

    Gives positions, angles and rest positions of a run and the measured ones, with the spread that the errors
    of the start
    and of the fitted law give.
    """
    problems = OptionProblems()
    form = form_of(table, problems)
    given = _named(error, "--error", ("positions", "angles"), problems)
    starts = _named(start_error, "--start-error", ("positions", "velocities", "spins"), problems)
    for name, value in (
        ("--draws", draws),
        ("--start-error", start_error),
        ("--seed", seed),
        ("--case", case),
    ):
        if value is not None and not members:
            problems.append(f"{name} requires --members")
    stem = problems.parse("", _picture_stem, "--picture", picture)
    pictures = [Path(f"{stem}.png"), Path(f"{stem}.pdf")] if stem else []
    paths = [] if output is None else [Path(output)]
    _check_files([*pictures, *paths], [Path(measured)], force, problems)
    problems.end()

    from ..case import shipped
    from ..runs import compare as of_runs

    loaded = of_runs.read(measured, given, form)
    laws = [] if draws is None else of_runs.read_draws(draws)
    found = of_runs.compare(
        file,
        loaded,
        laws=laws,
        errors=starts,
        members=members,
        seed=1 if seed is None else seed,
        case=None if case is None else shipped.find(case),
        progress=counted("compare", "run"),
    )
    echo(found.table())
    if pictures:
        found.draw(pictures)
    for path in paths:
        write_text(path, found.csv())
    if written := [*paths, *pictures]:
        note(f"\nwrote {', '.join(map(str, written))}")
    return 0


def _named(
    texts: list[str] | None, option: str, names: tuple[str, ...], problems: OptionProblems
) -> dict[str, float]:
    """Standard errors by name."""
    found = {}
    for name, value in _split(option, texts, problems).items():
        if name not in names:
            problems.append(f"{option} {name}: must be one of {', '.join(names)}{nearest(name, names)}")
        else:
            found[name] = problems.parse(0.0, of_text, f"{option} {name} =", value, NonNegative)
    return found
