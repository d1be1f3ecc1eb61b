"""The verb `ifrdem analyse`: a table of what analyses find in a trajectory, and CSV and JSON files."""

from __future__ import annotations

import argparse
import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import frame_numbers
from .errors import InputError, nearest
from .outputs import check_files

if TYPE_CHECKING:
    from .analysis.outcome import Columns, Outcome, Row

NAMES = ("velocity", "g", "S", "msd", "vacf", "fields", "clusters", "psi6", "pressure", "cooling", "impact")
"""As in `analysis.catalogue.ANALYSES`, whose import takes a second."""

DESCRIPTION = """\
Analyse a trajectory: prints a table with standard errors, and writes a CSV file for each analysis and one JSON file.

  velocity  velocities and spins: Sonine coefficients        clusters  sizes, the largest, radius of gyration
  g         pair correlation g(r), its value at contact      psi6      hexatic order
  S         structure factor S(k)                            pressure  from impulses and from the rate of collisions
  msd       mean-square displacement, diffusion              cooling   fits of Haff's law and of T_rot / T
  vacf      velocity autocorrelation                         impact    angles of impact and regimes
  fields    density, flow and thermal temperature

Without names, all that the file allows. Analyses of single frames take up to 20 of the second half unless --frames
says which, and fewer of large gases.
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

    Raises
    ------
    InputError
        For unknown names, frames that are not there, files that exist, and what the file cannot tell.
    """
    unknown = [name for name in options.what if name not in NAMES]
    if unknown:
        raise InputError(
            f"no analysis is called '{unknown[0]}'{nearest(unknown[0], NAMES)}; there are: {', '.join(NAMES)}"
        )
    from .trajectory import Trajectory

    with Trajectory(options.file) as trajectory:
        chosen = (
            None if options.frames is None else list(frame_numbers.chosen(options.frames, len(trajectory)))
        )
        stem = trajectory.path.stem
        folder = Path(options.output) if options.output else Path(f"{stem}-analysis")
        if not folder.parent.is_dir():
            raise InputError(f"output folder {folder}: {folder.parent} does not exist")
        if folder.exists() and not folder.is_dir():
            raise InputError(f"output {folder}: is a file, not a folder")
        summary = folder / f"{stem}.json"
        if folder.exists():
            check_files([summary], force=options.force)

        from .analysis.catalogue import ANALYSES

        names = list(dict.fromkeys(options.what)) or list(NAMES)
        record: dict[str, Any] = {"file": str(trajectory.path), "disks": trajectory.disks.n, "analyses": {}}
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
                say(report(name, ANALYSES[name].title, outcome, trajectory.with_unit("", "time").strip()))
        record["not_possible"] = skipped
    if folder.exists():
        check_files(list(written), force=options.force, elsewhere="-o DIR writes elsewhere")
    _write(folder, summary, record, written)
    if options.json:
        say(json.dumps(record, indent=2))
        return 0
    for name, reason in skipped.items():
        say(f"{name}: not possible: {reason}")
    say(f"wrote {summary} and {len(written)} CSV files beside it")
    return 0


def _file(stem: str, name: str, part: str) -> str:
    return f"{stem}-{name}{f'-{part}' if part else ''}.csv"


def report(name: str, title: str, outcome: Outcome, time_unit: str) -> str:
    """The table of an analysis, as text for people."""
    first, last = outcome.times
    unit = f" {time_unit}" if time_unit else ""
    span = f"t = {first:.4g}{unit}" if first == last else f"t = {first:.4g} to {last:.4g}{unit}"
    lines = [f"{name}: {title}, {span}"]
    width = max((len(row.name) for row in outcome.rows), default=0)
    lines += [f"  {row.name:<{width}}  {number(row)}" for row in outcome.rows]
    lines += [f"  ({note})" for note in outcome.notes]
    return "\n".join(lines)


def number(row: Row) -> str:
    """A value with its error to two digits and its unit."""
    unit = f" {row.unit}" if row.unit else ""
    if not math.isfinite(row.value):
        return "none"
    if not math.isfinite(row.error) or row.error <= 0.0:
        return f"{row.value:.5g}{unit}"
    digits = 1 - math.floor(math.log10(row.error))
    if digits <= 6 and abs(row.value) < 1e5:
        return f"{row.value:.{max(digits, 0)}f} +- {row.error:.{max(digits, 0)}f}{unit}"
    more = max(1, math.floor(math.log10(max(abs(row.value), row.error) / row.error)) + 1)
    return f"{row.value:.{more}e} +- {row.error:.1e}{unit}"


def _record(outcome: Outcome, files: list[str]) -> dict[str, Any]:
    def plain(value: float) -> float | None:
        return float(value) if math.isfinite(value) else None

    return {
        "times": list(outcome.times),
        "values": {
            row.name: {"value": plain(row.value), "error": plain(row.error), "unit": row.unit}
            for row in outcome.rows
        },
        "notes": outcome.notes,
        "files": files,
    }


def _write(folder: Path, summary: Path, record: dict[str, Any], tables: dict[Path, Columns]) -> None:
    try:
        folder.mkdir(exist_ok=True)
        for path, table in tables.items():
            with path.open("w", newline="", encoding="utf-8") as file:
                rows = csv.writer(file)
                rows.writerow(table)
                rows.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
        summary.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"output {error.filename or folder}: cannot be written: {error.strerror}") from error
