"""Run of `ifrdem validate`: the cases, a table of each as it goes; results, figures and report."""

from __future__ import annotations

import json
import math
import os
import platform
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from ... import bullet
from ...errors import InputError
from ...simulation import device
from ...tools.files import write_text
from ...tools.versions import __version__
from . import registry, workers
from .registry import Result, Row, Skip
from .terminal import Pace, Say, closing

if TYPE_CHECKING:
    from .page import Drawing


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
    say: Say = print,
) -> int:
    """Run cases and write their report into a folder.

    Parameters
    ----------
    names : sequence of str
        Cases and groups of cases (`registry.GROUPS`); if none are given, those of the paper.
    folder : str
        Where results.json, report.html and the figures go; it is made.
    quick : bool
        Fewer samples.
    force : bool
        Replace a report that is there; figures of cases that do not run again stay.
    seed : int, optional
        Of the random gases of the group `gas`, 0 to a million; 1 without it. Another one shares no random number.
    jobs : int, optional
        Cases at a time, each in a process of its own; results do not depend on it. By default as many as there are
        cores, but no more than cases of the group `gas`; other cases take seconds, and run in this process.

    Returns 0 if every row passed, 1 otherwise: a case that cannot run here counts as failed if it was asked for by name
    or group, and is left out in a run without names. InputError if a name, the seed or `jobs` is wrong, the folder
    cannot be written, or it holds a report and `force` is not given.
    """
    names = list(names)
    registry.check_names(names)
    chosen = registry.chosen(names)
    _check_seed(seed, chosen)
    jobs = _jobs(jobs, chosen)
    if chosen and {*chosen} <= {*registry.DEVICE} and (absence := device.cuda_absence()) is not None:
        raise InputError(f"{' '.join(names)}: there is no GPU to validate: {absence}")
    seed = 1 if seed is None else seed
    place = _folder(folder, force)
    from . import page

    began = time.perf_counter()
    outcomes = _run_all(chosen, quick, seed, jobs, say)
    record = environment(quick=quick, seconds=time.perf_counter() - began)
    if any(name in registry.GAS for name in chosen):
        record["seed"] = str(seed)
    if jobs > 1:
        record["cases at a time"] = str(jobs)
    results = json.dumps(rows_as_json(outcomes), indent=1, allow_nan=False)
    write_text(place / "results.json", f"{results}\n")
    say("writing the report")
    page.write(place, outcomes, record)
    status = exit_status(outcomes, named=bool(names))
    say(closing(outcomes, place, time.perf_counter() - began, status))
    if not names:
        outside = f"the cases against code from outside; `ifrdem validate bullet` does ({bullet.describe()})"
        say(f"not run: {outside}; and gases against the literature: `ifrdem validate gas`")
    return status


MOST_SEED = 1_000_000


def _check_seed(seed: int | None, chosen: Sequence[str]) -> None:
    if seed is None:
        return
    if not 0 <= seed <= MOST_SEED:
        raise InputError(f"--seed {seed}: a whole number from 0 to {MOST_SEED} is needed")
    if not any(name in registry.GAS for name in chosen):
        takers = ", ".join(registry.GAS)
        raise InputError(f"--seed {seed}: only the cases of the group gas take a seed: {takers}")


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
        raise InputError(f"-o {folder}: a folder cannot be made there: {error.strerror}") from error
    return place


def _jobs(jobs: int | None, chosen: Sequence[str]) -> int:
    """Number of cases that run at a time."""
    if jobs is None:
        jobs = min(device.cores(), sum(name in registry.GAS for name in chosen))
    elif jobs < 1:
        raise InputError(f"--jobs {jobs}: a whole number, 1 or more, is needed")
    return max(1, min(jobs, len(chosen)))


def _run_all(chosen: Sequence[str], quick: bool, seed: int, jobs: int, say: Say) -> list[Verdict]:
    """All cases, in this process one after another, or in workers, the longest first."""
    order = list(chosen)
    if jobs > 1:
        order.sort(key=lambda name: -registry.seconds(name, quick))
    found: dict[str, Verdict] = {}
    pace = Pace(order, quick=quick, jobs=jobs, say=say)

    def ended(name: str, outcome: Verdict | workers.Died) -> None:
        if isinstance(outcome, workers.Died):
            case, died = registry.load(name), f"no result: {outcome.reason}"
            outcome = Verdict(name, case.QUESTION, case.REFERENCE, error=died, seconds=pace.seconds(name))
        found[name] = outcome
        pace.ended(outcome)

    work = partial(run_case, quick=quick, seed=seed)
    if jobs > 1:
        workers.run(work, order, jobs, begun=pace.begun, ended=ended, waiting=lambda _: pace.waiting())
    else:
        for name in order:
            pace.begun(name)
            ended(name, work(name))
    return [found[name] for name in chosen]


def run_case(name: str, *, quick: bool, seed: int) -> Verdict:
    """Run one case and render its pictures, here and now; whatever it raises is told of in the outcome."""
    import matplotlib as mpl

    from . import page, style

    case = registry.load(name)
    outcome = Verdict(name, case.QUESTION, case.REFERENCE)
    began = time.perf_counter()
    try:
        with mpl.rc_context(style.RC):
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
    """0 if all passed; a skipped case is forgiven only if it was not asked for by name and others ran."""
    ran = [each for each in outcomes if not each.skipped]
    forgiven = not named or len(ran) == len(outcomes)
    return 0 if ran and forgiven and all(each.passed for each in ran) else 1


def rows_as_json(outcomes: Sequence[Verdict]) -> list[dict[str, object]]:
    """A list of rows; numbers that are not finite become null, and a row with one has not passed."""
    rows: list[dict[str, object]] = []
    for each in outcomes:
        for row in each.result.rows:
            names = ("measured", "expected", "tolerance", "printed")
            numbers = {name: _finite(getattr(row, name)) for name in names}
            if row.least:
                numbers["tolerance"] = None
            rows.append(
                {
                    "case": each.name, "quantity": row.quantity, **numbers, "reason": row.reason, "source": row.source,
                    "passed": row.passed, "status": "passed" if row.passed else "failed", **_sampling(row),
                }
            )  # fmt: skip
        if each.error or each.skipped:
            rows.append(
                {
                    "case": each.name, "quantity": "the case as a whole", "measured": None, "expected": None,
                    "tolerance": None, "printed": None, "reason": each.error or each.skipped,
                    "source": each.reference, "passed": False, "status": each.status,
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
    from ...tools.versions import revision

    packages = ("numpy", "scipy", "taichi", "h5py", "matplotlib")
    outside = {name: _version(name) for name in ("pybullet", "pymunk")}
    return {
        "ifrdem": f"{__version__} ({revision()})",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "samples": "quick" if quick else "full",
        "seconds for the cases": f"{seconds:.1f}",
        "processor": f"{device.cpu_name()}, {device.cores()} cores",
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
