"""One run of a study, in any process: it writes its result to a file named by a hash of its inputs."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import stat
import struct
import time
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib.format import read_array
from numpy.typing import NDArray

from ..analysis.names import OVER_TIME
from ..case import file as case_file
from ..case.case import CaseSections
from ..case.file import CaseFile
from ..case.gas import CaseGas
from ..errors import DamageError, EngineError, InputError, ReadError
from ..quantities import SERIES
from ..runs.recorder import Ledger
from ..simulation.steps.schedule import RunPlan, RunPoint, end_at
from ..tools.files import write_saved
from ..trajectory.damage import FAULTS, system_errors
from ..trajectory.file import TrajectoryError

if TYPE_CHECKING:
    from ..analysis.result import Evaluation
    from ..trajectory.reader import Trajectory

AT = "at"
"""Dimension of the places at which frames are analysed."""
WINDOW = "window"
"""Dimension of results of a run, not of a study: starts at which the steady window may begin."""
WARNINGS, NOTES = "warnings", "notes"
"""Variables with the texts of the analyses of a run, a line each."""
LOG = logging.getLogger("ifrdem")


class Variable(NamedTuple):
    """A quantity: the names of its dimensions, its values, its unit ("" for none), its name as it is printed."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    unit: str = ""
    text: str = ""  # of a number of an analysis; others are described by their names


@dataclass(frozen=True)
class Task:
    """A run, as it goes to a worker."""

    key: str  # hash of all that decides its result: the name of its file
    index: tuple[int, ...]  # its place on the axes of the study, and among the seeds
    text: str  # of its case
    path: str  # of its case; relative paths in the case start from its folder
    overrides: tuple[str, ...]  # changes of its case
    folder: str  # where results stand
    analyses: tuple[str, ...]  # names as in `ifrdem analyse`
    at: tuple[float, ...]  # where frames are analysed, in what ends the run
    start: float | None  # where averages over the run begin, in the same; None: in the steady window
    trajectory: bool  # keep the trajectory
    weight: float  # its part of the work: disks times collisions per disk
    options: Mapping[str, Mapping[str, Any]] = field(
        default_factory=dict, hash=False
    )  # of analyses, by their names
    after: str = ""  # key of the run with whose last frame it begins

    @property
    def result(self) -> Path:
        """The file of its result."""
        return Path(self.folder) / f"{self.key}.npz"

    @property
    def done(self) -> bool:
        """True if its result exists and is complete."""
        try:
            load(self.result)
        except DamageError:
            return False
        return True

    def file(self, threads: int = 1) -> CaseFile:
        """Its case, run on so many threads."""
        changes = (*self.overrides, f"run.name={json.dumps(self.key)}", f"run.threads={threads}")
        return case_file.of_text(self.text, Path(self.path), changes)

    def perform(self, threads: int = 1) -> str | None:
        """Run it unless its result is complete; return the message of a failure, or None."""
        level = LOG.level
        LOG.setLevel(logging.WARNING)  # no lines of progress
        try:
            # Warnings of the case, such as of energy that collisions may add: the study has given them once.
            with warnings.catch_warnings(action="ignore"):
                if not self.done:
                    started, long = time.perf_counter(), self.analyses or self.trajectory
                    found = self._long(threads) if long else _series_alone(self.file(threads))
                    save(self.result, found, seconds=time.perf_counter() - started)
        except (EngineError, InputError, TrajectoryError) as error:
            return str(error)
        finally:
            LOG.setLevel(level)
        return None

    def warm(self, threads: int = 1) -> None:
        """Compile the kernels of the run, by a hidden run of one collision."""
        # The run itself reports errors.
        with contextlib.suppress(EngineError, InputError), warnings.catch_warnings(action="ignore"):
            _advance(self.file(threads).gas, [], short=True)

    def _long(self, threads: int) -> dict[str, Variable]:
        """The run with its trajectory, from its checkpoint if a worker was killed in it, and the analyses."""
        from ..runs import resume, run
        from ..runs.outputs import Outputs
        from ..trajectory.reader import Trajectory

        def silent(_text: str) -> None:
            """Silence the output of a run of a study."""

        file = self.file(threads)
        outputs = Outputs.plan(file.case, f"{self.folder}/{self.key}", picture=False)
        try:
            if not outputs.checkpoint.exists():
                raise InputError("a run that begins")
            threaded: dict[str, Any] = {"ignore_case_changes": True, "threads": threads}
            resume.resume(outputs.trajectory, **threaded, log=silent, warn=silent)
        except InputError:  # of no checkpoint, or of one that does not fit: the run starts again
            run.run(file, outputs, force=True, log=silent, warn=silent)
        with Trajectory(outputs.trajectory) as trajectory:
            series = trajectory.series
            rows = {"time": series.time, **{name: series[name] for name in series}}
            found = _at_rows(file.case, trajectory.n, rows)
            found |= self._analysed(trajectory)
        if not self.trajectory:
            for ending in (".h5", ".status.json"):
                outputs.trajectory.with_name(f"{self.key}{ending}").unlink(missing_ok=True)
        return found

    def _analysed(self, trajectory: Trajectory) -> dict[str, Variable]:
        """Numbers, tables and texts of all analyses.

        The steady window of a study is that of all seeds of a point, which a run does not know. So a run is analysed in
        each window that it may have, and `collect` takes that one (`WINDOW`).
        """
        from ..analysis.window import frames_from, has_window, steady_starts

        starts: list[Sequence[int] | None] = [None]
        if self.start is not None:
            starts = [frames_from(trajectory, self.start, "analyses_from =")]
        elif any(name in OVER_TIME for name in self.analyses) and has_window(trajectory):
            starts = [*steady_starts(trajectory)]
        found: dict[str, Variable] = {}
        texts: dict[str, list[list[str]]] = {WARNINGS: [[] for _ in starts], NOTES: [[] for _ in starts]}
        for name in self.analyses:
            try:
                options = self._options(trajectory, name)
                used: list[Sequence[int] | None] = starts
                if (frames := options.pop("frames", None)) is not None:
                    used = [frames] * len(starts)
                if name in OVER_TIME:
                    outcomes = _of_windows(trajectory, name, used, options)
                    dims = (WINDOW,) * (len(starts) > 1)
                    remarks = [(i, "", one) for i, one in enumerate(outcomes)]
                else:
                    outcomes = _of_frames(trajectory, name, self.at, frames, options)
                    dims = (AT,) * bool(self.at)
                    places = [f" at {place:g}" for place in self.at] or [""]
                    both = list(zip(places, outcomes, strict=True))
                    remarks = [(i, place, one) for i in range(len(starts)) for place, one in both]
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
            for i, place, one in remarks:
                # Without the path: the file is removed after the run, and the text is the same for all runs.
                reason = str(one).removeprefix(f"{trajectory.path}: ")
                impossible = [f"not possible: {reason}"] if isinstance(one, InputError) else []
                for kind, lines in texts.items():
                    own = (
                        impossible * (kind == WARNINGS) if isinstance(one, InputError) else getattr(one, kind)
                    )
                    lines[i] += [f"{name}{place}: {line}" for line in own]
            found |= _outcome(name, outcomes, dims)
        for kind, lines in texts.items() if self.analyses else ():
            joined = np.array(["\n".join(each) for each in lines])
            found[kind] = Variable((WINDOW,), joined) if len(starts) > 1 else Variable((), joined[0])
        return found

    def _options(self, trajectory: Trajectory, name: str) -> dict[str, Any]:
        """Options of an analysis as its function takes them."""
        from ..analysis.options import frames_of

        found = dict(self.options.get(name, {}))
        if "cells" in found:
            found["cells"] = tuple(found["cells"])
        if "frames" in found:
            found["frames"] = [*frames_of(found["frames"], len(trajectory))]
        return found


def _series_alone(file: CaseFile) -> dict[str, Variable]:
    """The series of a run that writes no trajectory."""
    rows, ledger = [], Ledger(area=file.gas.stress_area)

    def row(measure: Any) -> None:
        rows.append({"time": measure.time, **ledger.row(measure)})

    _advance(file.gas, [row])
    return _at_rows(file.case, file.gas.n, {name: np.array([one[name] for one in rows]) for name in rows[0]})


def _advance(gas: CaseGas, series_callbacks: list[Any], *, short: bool = False) -> None:
    t_end, per_disk = gas.case.run.t_end, gas.case.run.collisions_per_disk
    gas.simulation().run(
        t_end=1e-3 * t_end if short and t_end is not None else t_end,
        collisions_per_disk=2.0 / gas.n if short and per_disk is not None else per_disk,
        series=1 if short else gas.case.series_cadence,
        series_callbacks=series_callbacks or [lambda measure: None],
    )


def along(case: CaseSections) -> tuple[str, NDArray[np.float64]]:
    """The axis that rows of series stand on, what ends the run, and the places of the rows."""
    cadence = case.series_cadence
    assert cadence.number is not None
    if case.run.t_end is not None:
        end, name = case.run.t_end, "time"
    else:
        end, name = case.run.collisions_per_disk or 0.0, "collisions_per_disk"
    plan = RunPlan(2, RunPoint(0.0, 0), RunPoint(time=end))
    return name, np.array([0.0, *(plan.point(cadence, k + 1).time for k in range(cadence.number))])


def _at_rows(case: CaseSections, n: int, found: dict[str, NDArray[Any]]) -> dict[str, Variable]:
    """Series at the places where the study has them: where two fall on one collision, one row is both."""
    name, positions = along(case)
    begin, run = RunPoint(0.0, 0), case.run
    end = end_at(n, begin, t_end=run.t_end, collisions_per_disk=run.collisions_per_disk)
    plan, cadence = RunPlan(n, begin, end), case.series_cadence
    points = [plan.point(cadence, k + 1) for k in range(len(positions) - 1)]
    rows_at = np.array([0.0, *(each.time if name == "time" else each.collisions for each in points)])
    rows = np.searchsorted(found["time"] if name == "time" else found["collisions"], rows_at)
    with np.errstate(divide="ignore", invalid="ignore"):
        found["theta"] = found["rotational_temperature"] / found["temperature"]
    found["collisions_per_disk"] = 2.0 * found["collisions"] / n
    del found[name]
    units = _units(case)
    result = {}
    for each, values in found.items():
        padded = np.concatenate([values.astype(float), np.full((1, *values.shape[1:]), np.nan)])
        inner = () if values.ndim == 1 else (SERIES[each].along,)
        result[each] = Variable((name, *inner), padded[np.minimum(rows, len(values))], units.get(each, ""))
    return result


def _units(case: CaseSections) -> dict[str, str]:
    from ..case.case import UNITS
    from ..trajectory.descriptions import unit_of_whole_gas

    units = UNITS[case.run.units]
    return {name: unit_of_whole_gas(name, units) or "" for name in ("time", *SERIES)}


def _of_windows(
    trajectory: Trajectory, name: str, starts: Sequence[Sequence[int] | None], options: Mapping[str, Any]
) -> list[Evaluation | InputError]:
    """An analysis of a whole run from each start on, or why it cannot be done there.

    Raises InputError if it cannot be done from any of them.
    """
    from ..analysis.catalogue import FUNCTIONS

    found: list[Evaluation | InputError] = []
    for start in starts:
        try:
            found.append(FUNCTIONS[name](trajectory, start, **options))
        except InputError as error:
            found.append(error)
    if all(isinstance(one, InputError) for one in found):
        raise InputError(str(found[0]))
    return found


def _of_frames(
    trajectory: Trajectory,
    name: str,
    at: tuple[float, ...],
    frames: list[int] | None,
    options: Mapping[str, Any],
) -> list[Evaluation | InputError]:
    """An analysis of the frames at each place; without places, of those given, or those that it takes."""
    from ..analysis.catalogue import FUNCTIONS
    from ..analysis.window import ends_at_collisions

    if not at:
        return [FUNCTIONS[name](trajectory, frames, **options)]
    by_collisions = ends_at_collisions(trajectory)
    reached = trajectory.observables["collisions_per_disk"] if by_collisions else trajectory.times
    places = np.searchsorted(reached, np.array(at) * (1.0 - 1e-12)).clip(max=len(trajectory) - 1)
    return [FUNCTIONS[name](trajectory, [int(each)], **options) for each in places]


def _outcome(
    name: str, outcomes: Sequence[Evaluation | InputError], dims: tuple[str, ...]
) -> dict[str, Variable]:
    """Numbers and tables of the outcomes of an analysis; nan of those that were not possible."""
    from ..analysis.result import identifier

    found: dict[str, Variable] = {}
    for i, outcome in enumerate(outcomes):
        if isinstance(outcome, InputError):
            continue
        parts = [
            (
                identifier(name, row.key or row.name),
                Variable((), np.array(float(row.value)), row.unit, row.name),
            )
            for row in outcome.rows
        ]
        for table, columns in outcome.tables.items():
            row = identifier(name, table, "row")
            for one, values in columns.items():
                if values.dtype.kind not in "biuf":  # names of quantities
                    continue
                parts.append((identifier(name, table, one), Variable((row,), np.asarray(values, float))))
        for key, part in parts:
            shape = (len(outcomes), *part.values.shape)
            stored = grown(found[key].values if key in found else np.full(shape, np.nan), shape)
            corner: Any = (i, *(slice(size) for size in part.values.shape))
            stored[corner] = part.values
            found[key] = part._replace(dims=(*dims, *part.dims), values=stored)
    return found if dims else {key: one._replace(values=one.values[0]) for key, one in found.items()}


def grown(values: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """The array padded with nan to a shape."""
    more = [(0, max(0, new - old)) for old, new in zip(values.shape, shape, strict=True)]
    return np.pad(values, more, constant_values=np.nan) if any(each for _, each in more) else values


def save(path: Path, found: dict[str, Variable], *, seconds: float) -> None:
    """Write a result; it appears whole or not at all."""
    head = {
        "seconds": seconds,
        "variables": {name: [one.dims, one.unit, one.text] for name, one in found.items()},
    }
    arrays = {name: one.values for name, one in found.items()}
    write_saved(path, lambda file: np.savez(file, head=np.array(json.dumps(head)), **arrays))  # type: ignore[arg-type]


def load(path: Path) -> tuple[dict[str, Variable], float]:
    """A result, and the seconds that the run took.

    Raises DamageError if it is missing, or damaged in any bit; ReadError if the system does not read it.
    """
    try:
        with system_errors(path):
            regular = stat.S_ISREG(path.stat().st_mode)
        if not regular:  # a pipe would be waited for
            raise ValueError("it is no file")
        with system_errors(path), zipfile.ZipFile(path) as stored:
            # `save` compresses nothing: a part that is larger than the file could fill the memory.
            if large := next((one for one in stored.infolist() if one.file_size > path.stat().st_size), None):
                raise ValueError(f"{large.filename} has {large.file_size} bytes, more than the file")

            def read(name: str) -> NDArray[Any]:
                # All bytes at once: a checksum is verified only if the part is read to its end.
                found: NDArray[Any] = read_array(io.BytesIO(stored.read(f"{name}.npy")), allow_pickle=False)
                return found

            head = json.loads(str(read("head")))
            found = {}
            for name, (dims, unit, text) in head["variables"].items():
                found[str(name)] = Variable(tuple(map(str, dims)), read(name), str(unit), str(text))
                if len(found[name].dims) != found[name].values.ndim:
                    raise ValueError(f"{name} has {found[name].values.ndim} axes, and {len(dims)} have names")
        return found, float(head["seconds"])
    except ReadError:
        raise
    except (*FAULTS, EOFError, zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError) as error:
        raise DamageError(
            f"{path} is not a complete result of a study ({str(error) or type(error).__name__})"
        ) from None
