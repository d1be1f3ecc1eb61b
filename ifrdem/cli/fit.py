"""The command `fit`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from ..errors import InputError, nearest, there_are
from .console import FAILED, complain, note, say
from .options import Force, Wrong, flag, number, option, whole

if TYPE_CHECKING:
    from ..fit.result import Fit

FORMAT = """\
DATA is a CSV file: a line with the names of the columns, then a line an impact. Angles are in degrees and counted from
the line of centres. Lines that begin with # are comments.

  psi           impact angle, from 0 to below 90 (needed)
  delta_2       direction of disk 2 after the impact
  delta_1       direction of disk 1 after the impact, above 90 where it bounces back
  Rw_2          R_2 omega_2 / v_o, clockwise positive
  sqrt_d2_d1    sqrt(d_2 / d_1) of the stopping distances
  e_t_apparent  e_t*, slip after the impact over slip before, times -1

psi and at least one other are needed; psi_error, delta_2_error and so on hold standard errors where they differ
from impact to impact. For instance:

  # numbers made up
  psi,delta_1,delta_2,delta_2_error
  15.0,75.1,12.0,0.5
  50.0,83.9,13.1,0.8

  ifrdem fit data.csv --pair "1 pta" "1 pta" --error 0.7
  ifrdem fit data.csv --M 1.3 --error 0.5 --error psi=1 --picture fit --write-material coins.toml
  ifrdem fit --example > data.csv     writes synthetic data to try it on
"""

NAMES = ("psi", "delta_1", "delta_2", "Rw_2", "sqrt_d2_d1", "e_t_apparent")

DISKS = Group("The disks; --M or --pair is needed", sort_key=1)
HOW = Group("The fit", sort_key=2)
FILES = Group("Files to write", sort_key=3)
POSITIVE = "a positive finite number"


def fit(
    data: Annotated[
        str | None, Parameter(name="DATA", help="a CSV file of measured impacts, see above")
    ] = None,
    /,
    *,
    example: Annotated[bool, flag("print a synthetic CSV file and do nothing else")] = False,
    M: Annotated[
        str | None, option("M", "mass ratio m_1 / m_2; disk 1 is the one that moves", "--M", group=DISKS)
    ] = None,
    k_1: Annotated[
        str | None,
        option("K", "k in I = m R^2 / k of disk 1: 2 homogeneous disk (default), 1 hoop", group=DISKS),
    ] = None,
    k_2: Annotated[str | None, option("K", "the same of disk 2", group=DISKS)] = None,
    R_1: Annotated[
        str | None,
        option("R", "radius of disk 1 [length]; only --rolling needs radii", "--R-1", group=DISKS),
    ] = None,
    R_2: Annotated[
        str | None, option("R", "radius of disk 2 [the same length]", "--R-2", group=DISKS)
    ] = None,
    pair: Annotated[
        tuple[str, str] | None,
        option("COIN COIN", "two coins of the paper instead, in SI units", group=DISKS),
    ] = None,
    error: Annotated[
        list[str] | None,
        option(
            "E",
            "standard error of all angles [degrees], or NAME=E of one column; repeatable. Columns such as "
            "delta_2_error come first, then NAME=E",
            group=HOW,
        ),
    ] = None,
    rolling: Annotated[
        bool, flag("fit rolling friction rho too, from Rw_2 or e_t_apparent", group=HOW)
    ] = False,
    sticking: Annotated[
        str | None, option("KIND", "percussion_center or contact_point only (default: both)", group=HOW)
    ] = None,
    bootstrap: Annotated[
        str | None, option("N", "intervals by N synthetic data sets beside the others", group=HOW)
    ] = None,
    seed: Annotated[str | None, option("N", "seed of the bootstrap (default: 1)", group=HOW)] = None,
    json: Annotated[str | None, option("FILE", "everything that was found", group=FILES)] = None,
    picture: Annotated[
        str | None, option("NAME", "NAME.png and NAME.pdf: data, curves, residuals", group=FILES)
    ] = None,
    write_material: Annotated[
        str | None, option("FILE", "a [[material]] table for case files (TOML)", group=FILES)
    ] = None,
    material_name: Annotated[
        str | None, option("NAME", "its name (default: that of the data file)", group=FILES)
    ] = None,
    force: Force = False,
) -> int:
    """Fit the law's coefficients to measured impacts.

    Fits e_n, e_t, mu (and rho) to measured impacts of one disk on another at rest, neither of which spins before:
    maximum likelihood with errors in every angle, for both kinds of sticking, with 95 % intervals by profile
    likelihood. Prints a table.
    """
    if example:
        if data is not None:
            raise InputError(
                f"--example prints its data and reads none: `ifrdem fit --example > {data}` writes them"
            )
        from ..fit.data import example as synthetic

        say(synthetic().rstrip("\n"))
        return 0
    wrong = Wrong()
    if data is None:
        wrong.append("DATA is missing: a CSV file is needed; `ifrdem fit --example` prints one")
    given = {"M": M, "k_1": k_1, "k_2": k_2, "R_1": R_1, "R_2": R_2}
    disks = _disks({name: text for name, text in given.items() if text is not None}, pair, rolling, wrong)
    errors = _errors(error or [], wrong)
    kinds = _sticking(sticking, wrong)
    sets = wrong.take(0, whole, "--bootstrap", bootstrap, 40, 1_000_000)
    start = wrong.take(1, whole, "--seed", seed, 0, 2**63 - 1)
    if seed is not None and bootstrap is None:
        wrong.append("--seed: only beside --bootstrap")
    if material_name is not None and write_material is None:
        wrong.append("--material-name: only beside --write-material")
    source = Path(data or "data.csv")
    name = source.stem if material_name is None else material_name
    if write_material is not None and not 1 <= len(name) <= 100:
        wrong.append(f"--material-name {name!r}: 1 to 100 characters are needed")
    stem = None if picture is None else picture.removesuffix(".png").removesuffix(".pdf")
    record = [] if json is None else [Path(json)]
    pictures = [] if stem is None else [Path(f"{stem}.png"), Path(f"{stem}.pdf")]
    material = [] if write_material is None else [Path(write_material)]
    _check_files([*record, *pictures, *material], source, force, wrong)
    wrong.end()

    from ..fit import maximum

    measured = maximum.read(source, errors)
    with _progress(sets * len(kinds)) as bar:
        found = maximum.fit(
            measured,
            **disks,
            rolling=rolling,
            sticking=kinds,
            bootstrap=sets,
            seed=start,
            progress=None if bar is None else bar.update,
        )
    say(maximum.table(found))
    return _write(found, record, pictures, material, name)


def _write(
    found: Fit, record: Sequence[Path], pictures: Sequence[Path], material: Sequence[Path], name: str
) -> int:
    """Write the files that are asked for; FAILED if the material is one that no case would take."""
    from ..fit import report
    from ..tools.files import write_text

    status = 0
    for path in record:
        write_text(path, report.as_json(found))
    if pictures:
        from ..fit.figure import draw

        draw(found, pictures)
    try:
        for path in material:
            write_text(path, report.material(found, name))
    except InputError as error:
        complain(str(error))
        status, material = FAILED, ()
    if written := [*record, *pictures, *material]:
        note(f"\nwrote {', '.join(map(str, written))}")
    return status


def _progress(fits: int) -> AbstractContextManager[Any]:
    from ..run.progress import quiet

    if fits == 0 or quiet():
        return nullcontext()
    from tqdm import tqdm

    return tqdm(total=fits, desc="bootstrap", unit="fit", leave=False, disable=None)


def _check_files(paths: Sequence[Path], data: Path, force: bool, wrong: Wrong) -> None:
    """Take note of what keeps files from being written."""
    from ..tools.files import check_files

    wrong += [f"output {path}: is the data file" for path in paths if path == data]
    wrong += [f"output {path}: is asked for twice" for path in dict.fromkeys(paths) if paths.count(path) > 1]
    try:
        check_files(paths, force=force, elsewhere="another name keeps it")
    except InputError as error:
        wrong += str(error).splitlines()


def _positive(option: str, text: str) -> float:
    return number(option, text, POSITIVE, lambda value: 0.0 < value < math.inf)


def _disks(
    texts: dict[str, str], pair: tuple[str, str] | None, rolling: bool, wrong: Wrong
) -> dict[str, float]:
    """Mass ratio, moments of inertia and radii."""
    option: Callable[[str], str] = lambda name: f"--{name.replace('_', '-')}"  # noqa: E731
    if pair is not None:
        from ..model.coin_table import coins

        wrong += [f"{option(name)}: not beside --pair, which says it" for name in texts]
        unknown = [
            f"--pair '{coin}': no such coin{there_are(coin, coins)}" for coin in pair if coin not in coins
        ]
        if unknown:
            wrong += unknown
            return {"M": 1.0}
        a, b = (coins[coin] for coin in pair)
        return {"M": a.mass / b.mass, "k_1": a.k, "k_2": b.k, "R_1": a.radius, "R_2": b.radius}
    if "M" not in texts:
        wrong.append(
            "--M is missing: the mass ratio m_1 / m_2 is needed, or --pair with two coins of the paper"
        )
    if rolling:
        missing = [name for name in ("R_1", "R_2") if name not in texts]
        wrong += [f"{option(name)} is missing: --rolling needs it" for name in missing]
    elif ("R_1" in texts) != ("R_2" in texts):
        wrong.append("--R-1, --R-2: both radii are needed, or none")
    return {name: wrong.take(1.0, _positive, option(name), text) for name, text in texts.items()}


def _errors(texts: list[str], wrong: Wrong) -> dict[str, float]:
    """Standard errors by column, or of all angles."""
    found: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.rpartition("=")
        name = name.strip() if equals else "angles"
        if name not in (*NAMES, "angles"):
            wrong.append(f"--error {text}: no column is called '{name}'{there_are(name, NAMES)}")
            continue
        if name in found:
            wrong.append(f"--error {text}: given twice")
        found[name] = wrong.take(1.0, _positive, f"--error {name} =" if equals else "--error", value)
    return found


def _sticking(text: str | None, wrong: Wrong) -> tuple[str, ...]:
    from ..model.ifr import STICKING

    if text is None:
        return STICKING
    if text not in STICKING:
        wrong.append(f"--sticking {text}: must be one of {', '.join(STICKING)}{nearest(text, STICKING)}")
    return (text,)
