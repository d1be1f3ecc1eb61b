"""Run of `ifrdem validate`: the cases, a table of each as it goes; results, figures and report."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from multiprocessing import connection
from pathlib import Path
from typing import Any

from ... import bullet
from ...errors import InputError
from ...kernels.compiler import runtime
from ...simulation import backend
from ...tools.files import write_text
from ...tools.processes import ProcessDied, Worker
from ...tools.progress import Compilation, quiet
from ...tools.versions import __version__, revision
from ..lammps import library
from . import page, registry, style
from .registry import Row, Skip, Verdict
from .terminal import Log, Pace, closing

MOST_SEED = 1_000_000


def listing() -> str:
    """The cases and their questions, as text."""
    return "\n".join(f"{name:<15} {registry.load(name).QUESTION}" for name in registry.CASES)


def validate(
    names: Sequence[str],
    folder: str,
    *,
    quick: bool = False,
    force: bool = False,
    seed: int | None = None,
    jobs: int | None = None,
    log: Log = print,
) -> int:
    """Run cases and write their report into a folder.

    Parameters
    ----------
    names : sequence of str
        Cases and groups of cases (`registry.GROUPS`); if none are given, those of the paper.
    folder : str
        Where results.json, report.html and the figures go; it is made.
    quick : bool
        Fewer samples; groups are without `registry.LONG`.
    force : bool
        Replace a report that is there; figures of cases that do not run again stay.
    seed : int, optional
        Of the random gases of the group `gas`, 0 to a million; 1 without it. Another one shares no random number.
    jobs : int, optional
        Cases at a time, each in a process of its own; results do not depend on it. By default as many as there are
        cores, but no more than cases of the groups `gas` and `lammps`; others take seconds, and run in this process.
        Those of `lammps` never do, because LAMMPS ends its process on some errors.

    Returns 0 if every row passed, 1 otherwise: a case that cannot run here counts as failed if it was named itself
    or group, and is left out in a run without names. InputError if a name is wrong, no case takes the seed, the folder
    cannot be written, or it holds a report and `force` is not given.
    """
    names = list(names)
    registry.check_names(names)
    chosen = registry.chosen(names, quick)
    gases = [name for name in chosen if name in registry.GAS]
    if seed is not None and not gases:
        takers = ", ".join(registry.GAS)
        raise InputError(f"--seed {seed}: only the cases of the group gas take a seed: {takers}")
    jobs = _jobs(jobs, chosen)
    if chosen and {*chosen} <= {*registry.DEVICE} and (absence := backend.cuda_absence()) is not None:
        raise InputError(f"{' '.join(names)}: there is no GPU to validate: {absence}")
    seed = 1 if seed is None else seed
    place = _folder(folder, force)
    began = time.perf_counter()
    if left := [name for name in registry.chosen(names) if name not in chosen]:
        log(f"left out by --quick: {', '.join(left)}")
    outcomes = _run_all(chosen, quick, seed, jobs, log)
    record = environment(quick=quick, seconds=time.perf_counter() - began)
    if gases:
        record["seed"] = str(seed)
    if jobs > 1:
        record["cases at a time"] = str(jobs)
    results = json.dumps(rows_as_json(outcomes), indent=1, allow_nan=False)
    write_text(place / "results.json", f"{results}\n")
    log("writing the report")
    page.write(place, outcomes, record)
    status = exit_status(outcomes, named=bool(names))
    log(closing(outcomes, place, time.perf_counter() - began, status))
    if not names:
        outside = (
            f"the cases against code from outside; `ifrdem validate bullet` does ({bullet.describe()}), and "
            f"`ifrdem validate lammps` ({library.describe()})"
        )
        log(f"not run: {outside}; and gases against the literature: `ifrdem validate gas`")
    return status


def _folder(folder: str, force: bool) -> Path:
    place = Path(folder)
    try:
        place.mkdir(exist_ok=True)
        if not os.access(place, os.W_OK):
            raise InputError(f"-o {folder}: this folder cannot be written")
        if not force and any((place / name).exists() for name in ("results.json", "report.html")):
            text = "holds a report already; --force replaces it, another folder keeps it"
            raise InputError(f"-o {folder}: {text}")
    except FileNotFoundError:
        raise InputError(f"output folder {place.parent}: does not exist") from None
    except OSError as error:
        raise InputError(f"-o {folder}: a folder cannot be created there: {error.strerror}") from error
    return place


def _jobs(jobs: int | None, chosen: Sequence[str]) -> int:
    """Number of cases that run at a time."""
    if jobs is None:
        jobs = min(backend.cores(), sum(name in registry.GAS + registry.LAMMPS for name in chosen))
    return max(1, min(jobs, len(chosen)))


def _run_all(chosen: Sequence[str], quick: bool, seed: int, jobs: int, log: Log) -> list[Verdict]:
    """All cases, in this process one after another, or in workers, the longest first."""
    order = list(chosen)
    if jobs > 1:
        order.sort(key=lambda name: -registry.seconds(name, quick))
    found: dict[str, Verdict] = {}
    pace = Pace(order, quick=quick, jobs=jobs, log=log)

    def ended(name: str, outcome: Verdict | ProcessDied) -> None:
        if isinstance(outcome, ProcessDied):
            case, died = registry.load(name), f"no result: {outcome.reason}"
            outcome = Verdict(name, case.QUESTION, case.REFERENCE, error=died, seconds=pace.seconds(name))
        found[name] = outcome
        pace.ended(outcome)

    work = partial(run_case, quick=quick, seed=seed, is_quiet=quiet())
    if jobs > 1 or {*order} & {*registry.LAMMPS}:
        in_workers(work, order, jobs, begun=pace.begun, ended=ended, waiting=lambda _: pace.waiting())
    else:
        for name in order:
            pace.begun(name)
            ended(name, work(name))
    return [found[name] for name in chosen]


def in_workers(
    work: Callable[[str], Any], names: Sequence[str], jobs: int, *, begun: Callable[[str], None],
    ended: Callable[[str, Any], None], waiting: Callable[[Sequence[str]], None], every: float = 60.0,
) -> None:  # fmt: skip
    """Call `work(name)` of all names, in their order, `jobs` at a time.

    `work` is of the top level of a module, as for `pickle`; each process has its part of the cores, as threads of
    kernels. `begun` is called here with the name when its call begins, `ended` with name and result, or
    `ProcessDied`, when it ends, and `waiting` with the names in work after `every` seconds without an end. At its end,
    by Ctrl-C included, no process stays.
    """
    todo, threads = list(names), max(1, backend.cores() // jobs)
    busy: dict[Any, tuple[str, Worker]] = {}
    try:
        while todo or busy:
            while todo and len(busy) < jobs:
                worker = Worker()
                busy[worker.line] = todo[0], worker
                worker.call(_alone, work, todo[0], threads)
                begun(todo.pop(0))
            ready = connection.wait(list(busy), timeout=every)
            if not ready:
                waiting([name for name, _ in busy.values()])
            for line in ready:
                name, worker = busy.pop(line)
                found = worker.result()
                worker.end()
                ended(name, found)
    finally:
        for _, worker in busy.values():
            worker.end()


def _alone(work: Callable[[str], Any], name: str, threads: int) -> Any:
    """One call in a process of its own."""
    backend.limit_threads(threads)
    try:
        return work(name)
    finally:
        backend.stop()  # which keeps the kernels that it compiled


def run_case(name: str, *, quick: bool, seed: int, is_quiet: bool = False) -> Verdict:
    """Run one case and render its pictures, in this process; an exception becomes part of the outcome.

    Kernels that are compiled are printed, unless it `is_quiet`.
    """
    import matplotlib as mpl

    case = registry.load(name)
    outcome = Verdict(name, case.QUESTION, case.REFERENCE)
    began, compilation, stream = time.perf_counter(), Compilation(), sys.stderr

    def compiling(kernel: str) -> None:
        text, is_slow = compilation.next(kernel)
        if is_slow and not is_quiet:
            print(f"  {name}: {text}", file=stream, flush=True)

    try:
        with mpl.rc_context(style.RC), backend.announced(compiling):
            result = case.run(quick, seed) if name in registry.GAS else case.run(quick)
            outcome.result = replace(result, pictures=[])
            outcome.drawings = [page.draw(picture) for picture in result.pictures]
        if not outcome.result.rows:
            outcome.error = "the case compared nothing"
    except Skip as reason:
        outcome.skipped = str(reason)
    except Exception as error:
        # Not swallowed: the others still run; this one fails in terminal, results and report, with its traceback,
        # and the exit status is 1.
        outcome.error = f"{type(error).__name__}: {error}"
        outcome.details = traceback.format_exc()
    outcome.seconds = time.perf_counter() - began
    return outcome


def exit_status(outcomes: Sequence[Verdict], *, named: bool) -> int:
    """0 if all passed; a skipped case is accepted only if it was not named and others ran."""
    ran = [each for each in outcomes if not each.skipped]
    forgiven = not named or len(ran) == len(outcomes)
    return 0 if ran and forgiven and all(each.passed for each in ran) else 1


def rows_as_json(outcomes: Sequence[Verdict]) -> list[dict[str, object]]:
    """A list of rows; numbers that are not finite become null, and a row with one has not passed."""
    rows: list[dict[str, object]] = []
    for each in outcomes:
        found, nan = each.result.rows, math.nan
        if each.error or each.skipped:
            found = [
                *found,
                Row("the case as a whole", nan, nan, nan, each.error or each.skipped, each.reference),
            ]
        for row in found:
            names = ("measured", "expected", "tolerance", "printed")
            numbers = {name: _finite(getattr(row, name)) for name in names}
            if row.least:
                numbers["tolerance"] = None
            status = "passed" if row.passed else "skipped" if each.skipped else "failed"
            rows.append(
                {
                    "case": each.name, "quantity": row.quantity, **numbers, "reason": row.reason, "source": row.source,
                    "passed": row.passed, "status": status, **_sampling(row),
                }
            )  # fmt: skip
    return rows


def _sampling(row: Row) -> dict[str, object]:
    """Sampling of a random row; nothing of one that is not."""
    if row.sampling is None:
        return {}
    s = row.sampling
    return {
        "disks": s.disks, "replicas": s.replicas, "seeds": list(s.seeds), "statistical_error": _finite(s.error),
        "errors_allowed": s.z, "degrees_of_freedom": _finite(s.freedom), "systematic_tolerance": _finite(s.systematic),
        "widest_tolerance": _finite(s.widest),
    }  # fmt: skip


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def environment(*, quick: bool, seconds: float) -> dict[str, str]:
    """Versions, machine and date, for the report."""
    packages = ("numpy", "scipy", runtime.chosen(), "h5py", "matplotlib")
    outside = {name: _version(name) for name in ("pybullet", "pymunk", "lammps")}
    return {
        "ifrdem": f"{__version__} ({revision()})",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "samples": "quick" if quick else "full",
        "seconds for the cases": f"{seconds:.1f}",
        "processor": f"{backend.cpu_name()}, {backend.cores()} cores",
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in packages},
        **outside,
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
