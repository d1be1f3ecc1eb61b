"""The verb `ifrdem fit`: its options, checked before anything is read, and what it does."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, nearest

if TYPE_CHECKING:
    from ..fit.result import Fit

DESCRIPTION = """\
Fit the law's coefficients e_n, e_t, mu (and rho) to measured impacts of one disk on another at rest, neither
of which spins before: maximum likelihood with errors in every angle, for both kinds of sticking, with
95 % intervals by profile likelihood. Prints a table.
"""

FORMAT = """\
DATA is a CSV file: a line with the names of the columns, then a line an impact. Angles are in degrees and
counted from the line of centres. Lines that begin with # are comments.

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


def add_to(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ifrdem fit`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = DESCRIPTION, FORMAT
    parser.add_argument("data", metavar="DATA", nargs="?", help="a CSV file of measured impacts, see below")
    parser.add_argument(
        "--example", action="store_true", help="print a synthetic CSV file and do nothing else"
    )
    pair = parser.add_argument_group("the disks; --M or --pair is needed")
    pair.add_argument("--M", metavar="M", help="mass ratio m_1 / m_2; disk 1 is the one that moves")
    pair.add_argument(
        "--k-1", metavar="K", help="k in I = m R^2 / k of disk 1: 2 homogeneous disk (default), 1 hoop"
    )
    pair.add_argument("--k-2", metavar="K", help="the same of disk 2")
    pair.add_argument("--R-1", metavar="R", help="radius of disk 1 [length]; only --rolling needs radii")
    pair.add_argument("--R-2", metavar="R", help="radius of disk 2 [the same length]")
    pair.add_argument(
        "--pair", nargs=2, metavar=("COIN", "COIN"), help="two coins of the paper instead, in SI units"
    )
    how = parser.add_argument_group("the fit")
    how.add_argument(
        "--error", metavar="E", action="append", default=[], dest="errors",
        help="standard error of all angles [degrees], or NAME=E of one column; repeatable. Columns such as "
        "delta_2_error come first, then NAME=E",
    )  # fmt: skip
    how.add_argument(
        "--rolling", action="store_true", help="fit rolling friction rho too, from Rw_2 or e_t_apparent"
    )
    how.add_argument(
        "--sticking", metavar="KIND", help="percussion_center or contact_point only (default: both)"
    )
    how.add_argument("--bootstrap", metavar="N", help="intervals by N synthetic data sets beside the others")
    how.add_argument("--seed", metavar="N", help="seed of the bootstrap (default: 1)")
    out = parser.add_argument_group("files to write")
    out.add_argument("--json", metavar="FILE", help="everything that was found")
    out.add_argument("--picture", metavar="NAME", help="NAME.png and NAME.pdf: data, curves, residuals")
    out.add_argument("--write-material", metavar="FILE", help="a [[material]] table for case files (TOML)")
    out.add_argument("--material-name", metavar="NAME", help="its name (default: that of the data file)")
    out.add_argument("--force", action="store_true", help="replace files that exist")


@dataclass(frozen=True)
class FitOptions:
    """The options, read and checked."""

    data: Path
    pair: dict[str, float]
    errors: dict[str, float]
    rolling: bool
    sticking: tuple[str, ...]
    bootstrap: int
    seed: int
    json: Path | None
    pictures: tuple[Path, ...]
    material: Path | None
    material_name: str
    force: bool = field(default=False)

    @classmethod
    def parse(cls, given: argparse.Namespace) -> FitOptions:
        """From the texts of the command line.

        Raises
        ------
        InputError
            With a line for each option that is wrong, files that exist included.
        """
        wrong: list[str] = []
        if given.data is None:
            wrong.append("DATA is missing: a CSV file is needed; `ifrdem fit --example` prints one")
        pair = _pair(given, wrong)
        errors = _errors(given.errors, wrong)
        sticking = _sticking(given.sticking, wrong)
        bootstrap = _whole("bootstrap", given.bootstrap, 40, 1_000_000, 0, wrong)
        seed = _whole("seed", given.seed, 0, 2**63 - 1, 1, wrong)
        if given.seed is not None and given.bootstrap is None:
            wrong.append("--seed: only beside --bootstrap")
        if given.material_name is not None and given.write_material is None:
            wrong.append("--material-name: only beside --write-material")
        data = Path(given.data or "data.csv")
        name = data.stem if given.material_name is None else given.material_name
        if given.write_material is not None and not 1 <= len(name) <= 100:
            wrong.append(f"--material-name {name!r}: 1 to 100 characters are needed")
        picture = None if given.picture is None else given.picture.removesuffix(".png").removesuffix(".pdf")
        options = cls(
            data=data,
            pair=pair,
            errors=errors,
            rolling=given.rolling,
            sticking=sticking,
            bootstrap=bootstrap,
            seed=seed,
            json=None if given.json is None else Path(given.json),
            pictures=() if picture is None else (Path(f"{picture}.png"), Path(f"{picture}.pdf")),
            material=None if given.write_material is None else Path(given.write_material),
            material_name=name,
            force=given.force,
        )
        wrong += options.wrong_files()
        if wrong:
            raise InputError("\n".join(wrong))
        return options

    def wrong_files(self) -> list[str]:
        """What keeps the files from being written."""
        from ..tools.files import check_files

        paths = [path for path in (self.json, *self.pictures, self.material) if path is not None]
        found = [f"output {path}: is the data file" for path in paths if path == self.data]
        found += [
            f"output {path}: is asked for twice" for path in dict.fromkeys(paths) if paths.count(path) > 1
        ]
        try:
            check_files(paths, force=self.force, elsewhere="another name keeps it")
        except InputError as error:
            found += str(error).splitlines()
        return found


def run(
    given: argparse.Namespace, *, say: Callable[[str], object], complain: Callable[[str], object]
) -> bool:
    """Do what `ifrdem fit` was asked for; False if a file that was asked for could not be written.

    Raises
    ------
    InputError
        If options or data are wrong: before any work.
    """
    if given.example:
        if given.data is not None:
            raise InputError(
                f"--example prints its data and reads none: `ifrdem fit --example > {given.data}` writes them"
            )
        from ..fit.data import example

        say(example().rstrip("\n"))
        return True
    options = FitOptions.parse(given)
    from ..fit import maximum

    data = maximum.read(options.data, options.errors)
    with _progress(options) as bar:
        found = maximum.fit(
            data,
            **options.pair,
            rolling=options.rolling,
            sticking=options.sticking,
            bootstrap=options.bootstrap,
            seed=options.seed,
            progress=None if bar is None else bar.update,
        )
    say(maximum.table(found))
    return _write(options, found, say, complain)


def _write(
    options: FitOptions, found: Fit, say: Callable[[str], object], complain: Callable[[str], object]
) -> bool:
    """Write the files; False if the material is one that no case would take."""
    from ..fit import report as report

    written, whole = [], True
    if options.json is not None:
        _text(options.json, report.as_json(found))
        written.append(options.json)
    if options.pictures:
        from ..fit.figure import draw

        draw(found, options.pictures)
        written += options.pictures
    if options.material is not None:
        try:
            _text(options.material, report.material(found, options.material_name))
            written.append(options.material)
        except InputError as error:
            complain(str(error))
            whole = False
    if written:
        say(f"\nwrote {', '.join(map(str, written))}")
    return whole


def _text(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"output {path}: cannot be written: {error.strerror}") from None


def _progress(options: FitOptions) -> AbstractContextManager[Any]:
    if options.bootstrap == 0:
        return nullcontext()
    from tqdm import tqdm

    return tqdm(
        total=options.bootstrap * len(options.sticking),
        desc="bootstrap",
        unit="fit",
        leave=False,
        disable=None,
    )


def _number(name: str, text: str, wrong: list[str]) -> float:
    """A positive finite number; a complaint and 1 if it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if 0.0 < value < math.inf:
        return value
    wrong.append(f"{name}{text}: a positive finite number is needed")
    return 1.0


def _whole(name: str, text: str | None, least: int, most: int, default: int, wrong: list[str]) -> int:
    if text is None:
        return default
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if least <= value <= most:
        return value
    wrong.append(f"--{name} {text}: a whole number from {least} to {most} is needed")
    return default


def _pair(given: argparse.Namespace, wrong: list[str]) -> dict[str, float]:
    named = {"M": given.M, "k_1": given.k_1, "k_2": given.k_2, "R_1": given.R_1, "R_2": given.R_2}
    texts = {name: text for name, text in named.items() if text is not None}
    if given.pair is not None:
        from ..model.coin_table import coins

        wrong += [f"--{name.replace('_', '-')}: not beside --pair, which says it" for name in texts]
        unknown = [
            f"--pair '{coin}': no such coin{nearest(coin, coins)}; there are {', '.join(coins)}"
            for coin in given.pair
            if coin not in coins
        ]
        if unknown:
            wrong += unknown
            return {"M": 1.0}
        a, b = (coins[coin] for coin in given.pair)
        return {"M": a.mass / b.mass, "k_1": a.k, "k_2": b.k, "R_1": a.radius, "R_2": b.radius}
    if "M" not in texts:
        wrong.append(
            "--M is missing: the mass ratio m_1 / m_2 is needed, or --pair with two coins of the paper"
        )
    if given.rolling:
        wrong += [
            f"--{name.replace('_', '-')} is missing: --rolling needs it"
            for name in ("R_1", "R_2")
            if name not in texts
        ]
    elif ("R_1" in texts) != ("R_2" in texts):
        wrong.append("--R-1, --R-2: both radii are needed, or none")
    return {name: _number(f"--{name.replace('_', '-')} ", text, wrong) for name, text in texts.items()}


def _errors(texts: list[str], wrong: list[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.rpartition("=")
        name = name.strip() if equals else "angles"
        if name not in (*NAMES, "angles"):
            wrong.append(
                f"--error {text}: no column is called '{name}'{nearest(name, NAMES)}; there are {', '.join(NAMES)}"
            )
            continue
        if name in found:
            wrong.append(f"--error {text}: given twice")
        found[name] = _number(f"--error {name}=" if equals else "--error ", value, wrong)
    return found


def _sticking(text: str | None, wrong: list[str]) -> tuple[str, ...]:
    from ..model.ifr import STICKING

    if text is None:
        return STICKING
    if text not in STICKING:
        wrong.append(f"--sticking {text}: must be one of {', '.join(STICKING)}{nearest(text, STICKING)}")
    return (text,)
