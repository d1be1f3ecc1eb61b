"""The verb `ifrdem analyse`: a table of what analyses find in a trajectory, and CSV and JSON files."""

from __future__ import annotations

import argparse
import csv
import json
import math
import numbers
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, nearest
from ..tools.files import check_apart, check_files, write_aside
from . import frame_numbers

if TYPE_CHECKING:
    from ..analysis.result import Columns, Outcome, Row
    from ..trajectory.reader import Trajectory

NAMES = ("velocity", "g", "S", "msd", "vacf", "fields", "clusters", "psi6", "pressure", "cooling", "impact")
"""As in `analysis.catalogue.ANALYSES`, whose import takes a second."""
RUN = ("name", "seed", "started")
"""Parameters of a trajectory by which a run is told from others."""

DESCRIPTION = """\
Analyse a trajectory: prints a table with standard errors, and writes a CSV file for each analysis and one JSON file.

  velocity  velocities and spins: Sonine coefficients        clusters  sizes, the largest, radius of gyration
  g         pair correlation g(r), its value at contact      psi6      hexatic order
  S         structure factor S(k)                            pressure  from impulses and from the rate of collisions
  msd       mean-square displacement, diffusion              cooling   fits of Haff's law and of T_rot / T
  vacf      velocity autocorrelation                         impact    angles of impact and regimes
  fields    density, flow and thermal temperature

Without names, all that the file allows. Analyses of single frames take up to 20 of the second half unless --frames
says which, and fewer of large gases. A folder that is there gets the analyses that it lacks; --force replaces those
that it has.
"""


def add_to(verbs: Any) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser(
        "analyse",
        help="analyse a trajectory: distributions, g(r), S(k), diffusion, clusters, ...",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", help="a trajectory (.h5)")
    parser.add_argument("what", metavar="WHAT", nargs="*", help="names from the list above (default: all)")
    parser.add_argument("--frames", metavar="A:B:C", help="frames as in Python: -1, 10:, ::10")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for the files (default: FILE-analysis)")
    parser.add_argument("--json", action="store_true", help="print the JSON instead of the table")
    parser.add_argument("--force", action="store_true", help="replace files that exist")
    parser.set_defaults(act=_act)


def _act(options: argparse.Namespace) -> int:
    return run(options, say=lambda text: print(text, flush=True))


def run(options: argparse.Namespace, *, say: Callable[[str], None]) -> int:
    """Do what the options say, and return the exit status.

    A folder that holds analyses of the trajectory gets those that it lacks; others are replaced by --force only.

    Raises
    ------
    InputError
        For unknown names, frames that are not there, analyses and files that exist, and what the file cannot tell.
    """
    unknown = [name for name in options.what if name not in NAMES]
    if unknown:
        raise InputError(
            f"no analysis is called '{unknown[0]}'{nearest(unknown[0], NAMES)}; there are: {', '.join(NAMES)}"
        )
    from ..trajectory.reader import Trajectory

    with Trajectory(options.file) as trajectory:
        chosen = (
            None if options.frames is None else list(frame_numbers.chosen(options.frames, len(trajectory)))
        )
        stem = trajectory.path.stem
        folder = Path(options.output) if options.output else Path(f"{stem}-analysis")
        summary = folder / f"{stem}.json"
        _check_folder(folder, summary, trajectory.path)
        record = _begun(trajectory, summary, force=options.force)
        names, kept = _wanted(options, record, summary)

        from ..analysis.catalogue import ANALYSES
        from ..analysis.result import span_text

        skipped = {}
        written: dict[Path, Columns] = {}
        for name in names:
            try:
                outcome = ANALYSES[name].of(trajectory, chosen)
            except InputError as error:
                if options.what:
                    raise InputError(f"{name}: {error}") from None
                skipped[name] = str(error)
                continue
            files = {folder / _file(stem, name, part): table for part, table in outcome.tables.items()}
            written |= files
            record["analyses"][name] = _record(outcome, [path.name for path in files])
            if not options.json:
                say(report(name, ANALYSES[name].title, outcome, span_text(trajectory, outcome)))
        found = set(record["analyses"])
        record["analyses"] = {name: record["analyses"][name] for name in NAMES if name in found}
        record["not_possible"] = {
            name: reason
            for name, reason in {**record["not_possible"], **skipped}.items()
            if name not in found
        }
        if folder.exists():
            for path in written:
                check_apart(path, trajectory.path)
            check_files(list(written), force=options.force, elsewhere="-o DIR writes elsewhere")
    _write(folder, summary, record, written)
    if options.json:
        say(json.dumps(record, indent=2))
        return 0
    for name, reason in skipped.items():
        say(f"{name}: not possible: {reason}")
    for name in kept:
        say(f"{name}: is there already, and stays as it is; --force replaces it")
    for path in (*written, summary):
        say(f"wrote {path}")
    return 0


def _check_folder(folder: Path, summary: Path, trajectory: Path) -> None:
    """Refuse a folder that cannot be made, or in which the summary cannot be written."""
    if not folder.parent.is_dir():
        raise InputError(f"output folder {folder}: {folder.parent} does not exist")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"output {folder}: is no folder")
    if folder.exists():
        check_apart(summary, trajectory)
        check_files([summary], force=True)  # which others may be added to


def _begun(trajectory: Trajectory, summary: Path, *, force: bool) -> dict[str, Any]:
    """The record of what the folder holds of this trajectory; an empty one if it holds nothing, or by force.

    Raises
    ------
    InputError
        If the summary that is there is of another trajectory, or none of ours.
    """
    run = {key: trajectory.parameters[key] for key in RUN if key in trajectory.parameters}
    new: dict[str, Any] = {
        "file": str(trajectory.path),
        "disks": trajectory.disks.n,
        "run": {key: value if isinstance(value, str) else _plain(value) for key, value in run.items()},
        "analyses": {},
        "not_possible": {},
    }
    if not summary.exists():
        return new
    try:
        old = json.loads(summary.read_text(encoding="utf-8"))
        same = all(old[key] == new[key] for key in ("disks", "run"))
        held = {key: dict(old[key]) for key in ("analyses", "not_possible")}
    except (OSError, ValueError, KeyError, TypeError):
        if force:
            return new
        raise InputError(
            f"output {summary}: is no summary of `ifrdem analyse` to add to; --force replaces it, -o DIR writes "
            "elsewhere"
        ) from None
    if not same and not force:
        raise InputError(
            f"output {summary}: holds analyses of another run ({old['file']}); --force replaces it, -o DIR writes "
            "elsewhere"
        )
    return {**new, **held} if same else new


def _wanted(
    options: argparse.Namespace, record: dict[str, Any], summary: Path
) -> tuple[list[str], list[str]]:
    """Which analyses to do, and which are there already and stay."""
    asked = list(dict.fromkeys(options.what)) or list(NAMES)
    there = [name for name in asked if name in record["analyses"]]
    if options.force or not there:
        return asked, []
    if options.what:
        raise InputError(
            f"output {summary}: holds {', '.join(there)} already; --force replaces it, -o DIR writes elsewhere"
        )
    missing = [name for name in asked if name not in there]
    if not set(missing) - set(record["not_possible"]):
        raise InputError(
            f"output {summary}: holds all that the file allows already; --force replaces it, -o DIR writes elsewhere"
        )
    return missing, there


def _file(stem: str, name: str, part: str) -> str:
    return f"{stem}-{name}{f'-{part}' if part else ''}.csv"


def report(name: str, title: str, outcome: Outcome, span: str) -> str:
    """The table of an analysis, as text for people; `span`: of which frames and times."""
    lines = [f"{name}: {title}, {span}", *(f"  ! {doubt}" for doubt in outcome.doubts)]
    width = max((len(row.name) for row in outcome.rows), default=0)
    lines += [f"  {row.name:<{width}}  {number(row)}" for row in outcome.rows]
    lines += [f"  ({note})" for note in outcome.notes]
    return "\n".join(lines)


def number(row: Row) -> str:
    """A value with its error to two digits and its unit."""
    unit = f" {row.unit}" if row.unit else ""
    if isinstance(row.value, numbers.Integral):
        return f"{row.value}{unit}"
    if not math.isfinite(row.value):
        return "none"
    if not math.isfinite(row.error) or row.error <= 0.0:
        return f"{row.value:.5g}{unit}"
    digits = 1 - math.floor(math.log10(row.error))
    if digits <= 6 and abs(row.value) < 1e5:
        return f"{row.value:.{max(digits, 0)}f} +- {row.error:.{max(digits, 0)}f}{unit}"
    more = max(1, math.floor(math.log10(max(abs(row.value), row.error) / row.error)) + 1)
    return f"{row.value:.{more}e} +- {row.error:.1e}{unit}"


def _plain(value: float) -> float | None:
    """A number as JSON has it: counts and seeds are whole, and there is no nan."""
    if isinstance(value, numbers.Integral):
        return int(value)
    return float(value) if math.isfinite(value) else None


def _record(outcome: Outcome, files: list[str]) -> dict[str, Any]:
    return {
        "frames": outcome.frames,
        "times": list(outcome.times),
        "values": {
            row.name: {"value": _plain(row.value), "error": _plain(row.error), "unit": row.unit}
            for row in outcome.rows
        },
        "doubts": outcome.doubts,
        "notes": outcome.notes,
        "files": files,
    }


def _write(folder: Path, summary: Path, record: dict[str, Any], tables: dict[Path, Columns]) -> None:
    """Write the tables, then the summary that names them, each whole or not at all."""

    def write_table(path: Path, table: Columns) -> None:
        with path.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(table)
            rows.writerows(zip(*(column.tolist() for column in table.values()), strict=True))

    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"output {folder}: cannot be made: {error.strerror}") from error
    for path, table in tables.items():
        write_aside(path, partial(write_table, table=table))
    text = json.dumps(record, indent=2) + "\n"
    write_aside(summary, lambda aside: aside.write_text(text, encoding="utf-8"))
