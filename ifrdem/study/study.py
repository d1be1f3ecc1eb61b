"""A study: its plan, its runs, and their results."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..case import summary
from ..case.estimate import RunEstimate
from ..case.gas import CaseGas
from ..errors import DamageError, DamageWarning, InputError, counted, listed, option_name
from ..runs.signals import Stopped, Stops
from ..runs.status import Status
from ..simulation import backend
from ..tools import files
from ..tools.checked import validated
from ..tools.files import check_files
from ..tools.progress import clock_face, quiet
from ..tools.values import Several
from . import workers
from .plan import ClusterSection, Plan, read, weight
from .pooled import pooled, with_half_intervals
from .results import ENDING, RUNS, Results, averaged, collect, warnings_of
from .task import Task, load
from .workers import check_jobs

if TYPE_CHECKING:
    import xarray

RATE, ROW_SECONDS, RUN_SECONDS, FILE_SECONDS, ANALYSIS_SECONDS, START_SECONDS = 2e5, 2e-3, 0.04, 0.2, 0.3, 8.0
"""Collisions a second and core, where theory gives no estimate of a run; seconds of a row of series, of a further gas
beside its run, of one with a trajectory, of an analysis of it, and of processes that start and load kernels: before any run is done."""
MOST_ESTIMATED = 20
"""Points whose runs are estimated, evenly among all; the others take as long for their work."""
RUN_BYTES, RESULTS_BYTES = 10_000, 60_000
"""Bytes of the files of a run and of a study beside their rows."""
MOST_OF_DISK, MOST_WARNINGS = 0.9, 5
LOCK = "study.lock"
"""File in the folder of runs that a running study has locked."""


class Study:
    """One case run for many values of its keys and many seeds.

    Finished runs are kept in a folder next to the results: `run` resumes an interrupted study, and computes only
    what a changed study adds.

    Raises InputError with a line for each thing that is wrong.

    Parameters
    ----------
    path : str or path
        A study file (`ifrdem new study` writes one), a case file, or the name of a shipped study or case.
    vary : sequence of str
        Keys to vary: "material[0].e_n=0.7,0.8,0.9", "material[0].mu=0.1:0.5:5" (linear),
        "material[0].mu=0.01:1:5:log"; with ";" between keys that vary together.
    set : sequence of str
        Overrides of the case: "species[0].number=2000".
    seeds : int or str, optional
        A number of seeds, or a list "1,2,5".
    coefficients : int, optional
        A number of sets of coefficients to draw from the errors that materials and pairs of the case have: the
        dimension `coefficients` of the results.
    output : str or path, optional
        The file of results, NAME.nc; runs are kept in NAME.runs in the same folder. By default the name of the study
        file, or CASE-study.

    Attributes
    ----------
    plan : Plan
        What there is to do.
    output, folder : Path
        The results; where runs are kept.

    Examples
    --------
    >>> import ifrdem
    >>> study = ifrdem.Study("cooling", vary=["material[0].e_n=0.7,0.8,0.9"], set=["species[0].number=500"], seeds=4)
    >>> study.plan.shape, study.runs
    ((3, 4), 12)

    In a script, put everything that starts processes under ``if __name__ == "__main__":``, as Python wants it of
    programs that spawn:

    >>> study.run()  # doctest: +SKIP
    >>> study.dataset().temperature_mean  # doctest: +SKIP
    """

    @validated
    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        vary: Sequence[str] = (),
        set: Sequence[str] = (),
        seeds: int | str | None = None,
        coefficients: Several | None = None,
        output: str | os.PathLike[str] | None = None,
    ) -> None:
        self.plan: Plan = read(Path(path), vary=vary, set=set, seeds=seeds, coefficients=coefficients)
        given = os.fspath(output) if output is not None else self.plan.name + ENDING
        if os.path.isdir(given) or given.endswith(("/", os.sep)):
            given = os.path.join(given, self.plan.name + ENDING)
        self.output: Path = Path(given if given.endswith(ENDING) else given + ENDING)
        self.folder: Path = self.output.with_name(self.output.name.removesuffix(ENDING) + RUNS)

    @cached_property
    def _checked_cases(self) -> tuple[dict[tuple[int, ...], Any], list[str], list[str]]:
        return self.plan.checked_cases()

    @cached_property
    def tasks(self) -> list[Task]:
        """The runs of the points that `check` does not refuse."""
        return list(self.plan.tasks(self._checked_cases[0], self.folder))

    @cached_property
    def equilibrations(self) -> list[Task]:
        """First runs, with whose last frames the others begin, each once."""
        plan, found = self.plan, dict[str, Task]()
        for task in self.tasks:
            if task.after and task.after not in found:
                made = plan.equilibration(task.index[:-1], plan.seeds[task.index[-1]], self.folder)
                assert made is not None
                found[task.after] = made
        return [*found.values()]

    @property
    def runs(self) -> int:
        """Number of runs."""
        return math.prod(self.plan.shape)

    def check(
        self, *, keep_going: bool = False, workers: int | None = None, scheduler: str | None = None
    ) -> list[str]:
        """Check all points before anything starts. Returns warnings.

        Warnings name points that are left out and points with long steps of forces, each text once.

        Raises InputError if a point is refused (unless `keep_going`), memory or disk space is too small, or the
        results cannot be written.
        """
        good, problems, warned = self._checked_cases
        if problems and not (keep_going and good):
            more = f"\n{option_name('--keep-going', 'keep_going=True')} runs the other points" if good else ""
            raise InputError(listed([f"{self.plan.path}: {line}" for line in problems]) + more)
        check_files([self.output], force=True)
        if self.output.exists():
            try:
                Results.read(self.output)  # which refuses other files
            except DamageError as error:
                more = f"delete it, and it is made again from the runs in {self.folder}"
                raise InputError(f"{error}; {more}") from error
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(
                f"{self.folder}: is not a folder; runs are kept there: choose another {option_name('-o', 'output')}"
            )
        cluster = self._cluster(workers, scheduler)
        check_jobs(cluster, self._processes(cluster)[1])
        if cluster.scheduler is None and cluster.kind is None:
            for case in {each.run.device: each for each in good.values()}.values():
                case.run.choose_runtime()  # before the check of a GPU, which imports a runtime
                backend.check(case.run.made_device())
            processes, _ = self._processes(cluster)
            largest = max(sum(each.number for each in case.species) for case in good.values())
            case = next(iter(good.values()))
            run, n = case.run, largest * max(processes, 1)
            summary.refuse_beyond_memory(n, run.device, case.start.positions, low_memory=run.low_memory)
        needed, free = self._bytes(missing=True), shutil.disk_usage(self.output.parent).free
        if needed > MOST_OF_DISK * free:
            raise InputError(
                f"{self.output}: the study needs some {summary.size(needed)} more, and may take "
                f"{summary.size(MOST_OF_DISK * free)}, {100 * MOST_OF_DISK:.0f} % of what is free in "
                f"{self.output.parent.resolve()}: use fewer rows, seeds or points, or another disk "
                f"({option_name('-o', 'output')})"
            )
        lines = [*(f"left out: {line}" for line in problems), *warned[:MOST_WARNINGS]]
        if (others := len(warned) - MOST_WARNINGS) > 0:
            lines.append(f"and {others} more warnings of long steps")
        return lines

    @property
    def bytes(self) -> int:
        """Estimated disk space of the study."""
        return self._bytes(missing=False)

    def _bytes(self, *, missing: bool) -> int:
        """Estimated disk space of all runs, or of those without a result, and of the results of the study."""
        columns, of_rows, of_runs = 40, {}, {}
        for point, case in self._checked_cases[0].items():
            of_rows[point] = 8 * columns * ((case.series_cadence.number or 0) + 1)
            of_runs[point] = RUN_BYTES + of_rows[point]
            if self.plan.output.trajectories:
                of_runs[point] += RunEstimate.of(
                    CaseGas.from_case(case, self.plan.base(point).path.parent)
                ).file_bytes
        runs = [task.index[:-1] for task in self.tasks if not (missing and task.result.exists())]
        rows = sum(of_rows[task.index[:-1]] for task in self.tasks)
        return RESULTS_BYTES + rows + sum(of_runs[point] for point in runs)

    @property
    def seconds(self) -> float:
        """Estimated time of the missing runs on one core, from finished runs or else as `ifrdem check` of their cases.

        To that of each run (`RunEstimate.seconds`) comes what a study does for it: case, start, and analyses.
        """
        done, missing, _ = self._state([*self.equilibrations, *self.tasks])
        if done:
            elapsed, work = sum(seconds for _, seconds in done), sum(task.weight for task, _ in done)
            return elapsed / work * sum(task.weight for task in missing)
        points = [*dict.fromkeys(task.index[:-1] for task in missing)]
        kept = bool(self.plan.output.analyses) or self.plan.output.trajectories
        pace = {
            each: self._pace(each, frames=kept)
            for each in points[:: math.ceil(len(points) / MOST_ESTIMATED) or 1]
        }
        mean = sum(pace.values()) / max(len(pace), 1)
        each = FILE_SECONDS if kept else RUN_SECONDS
        each += ANALYSIS_SECONDS * len(self.plan.output.analyses)
        return sum(pace.get(task.index[:-1], mean) * task.weight + each for task in missing)

    def _pace(self, point: tuple[int, ...], *, frames: bool) -> float:
        """Estimated time of a run of a point by itself on one thread, over its work [s]; a typical one without theory.

        Runs whose trajectory nothing needs have no `frames`.
        """
        case = self._checked_cases[0][point]
        gas = CaseGas.from_case(case, self.plan.base(point).path.parent)
        estimate = RunEstimate.of(gas)
        if not frames:
            estimate = dataclasses.replace(estimate, frames=0, file_bytes=0)
        seconds = estimate.seconds(gas, 1) + estimate.rows * ROW_SECONDS
        return seconds / weight(case) if math.isfinite(seconds) else 0.5 / RATE

    def _state(self, tasks: Sequence[Task]) -> tuple[list[tuple[Task, float]], list[Task], list[str]]:
        """Finished runs with the seconds that they took, missing runs, and messages on damaged results.

        A damaged result counts as missing.
        """
        done: list[tuple[Task, float]] = []
        missing: list[Task] = []
        damaged: list[str] = []
        for task in tasks:
            try:
                done.append((task, load(task.result)[1]))
            except DamageError as error:
                missing.append(task)
                if os.path.lexists(task.result):
                    damaged.append(f"{self._name(task)}: {error}")
        return done, missing, damaged

    def summary(self, workers: int | None = None, scheduler: str | None = None) -> list[str]:
        """Lines of text on the runs to be done."""
        plan, (finished, _, damaged) = self.plan, self._state(self.tasks)
        done = len(finished)
        processes, _ = self._processes(self._cluster(workers, scheduler))
        points = f"{counted(math.prod(plan.shape[:-1]), 'point')} x {counted(len(plan.seeds), 'seed')}"
        lines = [f"{plan.name}: {points} = {counted(self.runs, 'run')} of {plan.path}"]
        for axis in plan.axes:
            for name, key, values in zip(axis.names, axis.keys, zip(*axis.values, strict=True), strict=True):
                shown = [str(each) for each in values]
                shown = shown if len(shown) <= 8 else [*shown[:4], "...", *shown[-2:]]
                lines.append(f"  {name:<22} {', '.join(shown)} ({key})")
        expected = "none: all runs are done"
        if len(self.tasks) > done:
            n = max(processes, 1)
            face = clock_face(START_SECONDS + self.seconds / n)
            expected = f"some {face} on {n} process{'es' if n > 1 else ''}"
            expected += ", up to a minute more where kernels must be compiled"
        if plan.draws is not None:
            lines.append(f"  {'':<22} {plan.draws.text}")
        if self.equilibrations:
            lines.append(f"  equilibrations         {len(self.equilibrations)}, before the runs")
        return [
            *lines,
            f"  done already           {done} of {len(self.tasks)}, in {self.folder}",
            *(f"  to be run again        {text}" for text in damaged),
            f"  disk space             some {summary.size(self.bytes)}",
            f"  expected time          {expected}",
        ]

    def run(
        self,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        keep_going: bool = False,
        part: tuple[int, int] | None = None,
        log: Callable[[str], None] = lambda _: None,
        warn: Callable[[str], None] = lambda _: None,
    ) -> dict[str, str]:
        """Do the missing runs and write the results.

        Parameters
        ----------
        workers : int, optional
            Processes of this machine; by default one for each core. 0 runs one after another in this process.
        scheduler : str, optional
            Address of a scheduler of Dask, "tcp://host:8786".
        keep_going : bool
            Leave out points that `check` refuses.
        part : tuple of two int, optional
            (k, m): only every m-th run, from the k-th on (counted from 1), and no results: for array jobs.
        log, warn : callable
            Take the lines to show.

        Returns messages of the runs that failed, by what they are; they are tried again next time.

        Raises InputError if something can be refused before anything starts, Stopped if it was stopped by a signal;
        what is done is kept, and the results of it are written.
        """
        for line in self.check(keep_going=keep_going, workers=workers, scheduler=scheduler):
            warn(line)
        if workers != 0 and (trouble := backend.kernel_cache_trouble()):  # workers do not report it
            warn(trouble)
        if part is not None and self.plan.first is not None:
            option = option_name("--part", "part")
            raise InputError(
                f"{option}: cannot be combined with [equilibrate], whose runs end before others begin"
            )
        tasks = self.tasks if part is None else self.tasks[part[0] - 1 :: part[1]]
        self.folder.mkdir(exist_ok=True)
        with self._locked(shared=part is not None):
            return self._run(tasks, workers, scheduler, part, log, warn)

    def _run(
        self,
        tasks: list[Task],
        workers: int | None,
        scheduler: str | None,
        part: tuple[int, int] | None,
        log: Callable[[str], None],
        warn: Callable[[str], None],
    ) -> dict[str, str]:
        _, missing, damaged = self._state(tasks)
        for text in damaged:
            warn(f"run again: {text}")
        firsts = self._missing_equilibrations(missing)
        failed: dict[str, str] = {}
        of_run, of_study = "the run stops after this window, with a checkpoint", "the study stops"
        stops = Stops(warn=lambda text: warn(text.replace(of_run, of_study)))
        path = self.folder.with_suffix("") if part is None else self.folder / f"part{part[0]}"
        status = Status(path, name=self.plan.name)
        progress = StudyProgress(
            len(tasks) + len(firsts), [task.weight for task in (*firsts, *missing)], status
        )
        work: Any = None
        try:
            with stops:
                for stage in filter(None, (firsts, missing)):
                    stage = [task for task in stage if task.after not in failed]
                    work = self._work(stage, self._cluster(workers, scheduler), log)
                    for ended in work if stage else ():
                        if ended is not None and (message := ended[1]) is not None:
                            failed[ended[0].key] = message
                            what = "equilibration of " * (ended[0] in firsts)
                            warn(f"failed: {what}{self._name(ended[0])}: {message}")
                            self._stop_on_full_disk()
                        progress(ended[0].weight if ended else None, len(failed))
                        stops.check()
                lost = {task.key: task.after for task in missing if task.after in failed}
                failed |= {key: f"equilibration: {failed[after]}" for key, after in lost.items()}
        except Stopped as stop:
            status.finish("interrupted", str(stop))
            raise Stopped(f"{stop}: {_progress_of(tasks)}", stop.status) from None
        except InputError:  # nothing has started
            status.path.unlink()
            if part is None:  # not in use elsewhere
                (self.folder / LOCK).unlink()
            with contextlib.suppress(OSError):  # of a folder that holds runs already
                self.folder.rmdir()
            raise
        except BaseException as error:
            status.finish("failed", str(error))
            raise
        finally:
            if hasattr(work, "close"):
                work.close()  # ends the processes
            progress.close()
            if part is None and any(task.result.exists() for task in tasks):
                found = collect(self.plan, self._checked_cases[0], self.tasks, failed)
                try:
                    found.write(self.output)
                except InputError as error:
                    raise InputError(f"{error}: {_progress_of(tasks)}") from error
                for line in warnings_of(found):
                    warn(line)
        status.finish("done", f"{len(failed)} runs failed" if failed else "")
        return {self._name(task): failed[task.key] for task in tasks if task.key in failed}

    def _missing_equilibrations(self, missing: Sequence[Task]) -> list[Task]:
        """First runs that the missing runs need and whose last frame is not there."""
        needed, found = {task.after for task in missing}, []
        for task in self.equilibrations if needed != {""} else ():
            if task.key not in needed:
                continue
            if not task.result.with_suffix(".h5").exists():  # it is made again with its trajectory
                task.result.unlink(missing_ok=True)
            if not task.done:
                found.append(task)
        return found

    def _stop_on_full_disk(self) -> None:
        """Raise Stopped if a result could not be written: the runs that are left would be lost."""
        try:
            with tempfile.TemporaryFile(dir=self.folder) as file:
                file.write(bytes(RUN_BYTES))
                file.flush()
        except OSError as error:
            text = f"the study stops: {self.folder} cannot be written to: {files.cause(error)}"
            raise Stopped(text, status=1) from error

    @contextlib.contextmanager
    def _locked(self, *, shared: bool) -> Iterator[None]:
        """Lock the study against other processes; parts of it (`shared`) may run at the same time."""
        path = self.folder / LOCK
        try:
            file = path.open("ab")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        with file:
            try:
                files.lock(file.fileno(), path, shared=shared)
            except BlockingIOError as error:
                raise InputError(
                    f"{self.output}: another process is running this study: {error.strerror}"
                ) from None
            except OSError:  # a file system without locks
                pass
            try:
                yield
            finally:
                files.unlock(file.fileno())

    def results(self) -> Results:
        """The results of all runs that are done by now.

        Raises InputError if none is.

        Warns
        -----
        DamageWarning
            If a result is damaged: nan stands for it, and `run` creates it again.
        """
        done, _, damaged = self._state(self.tasks)
        if not done:
            raise InputError(
                "\n".join(
                    (f"{self.folder}: no run is done yet: call Study.run() or `ifrdem study`", *damaged)
                )
            )
        for text in damaged:
            warnings.warn(
                f"{text}; Study.run() or `ifrdem study` creates it again", DamageWarning, stacklevel=2
            )
        return collect(self.plan, self._checked_cases[0], self.tasks, {})

    def dataset(self) -> xarray.Dataset:
        """The results as an xarray data set (extra `analysis`), with means and standard errors over seeds.

        Raises InputError if no run is done, or xarray is not installed.
        """
        return self.results().to_xarray()

    def means(self, start: float | None = None) -> xarray.Dataset:
        """The results with means over the steady window of each point in place of series, as `dataset`.

        `start` is another place to begin at, in what ends the runs. Points without a window have the last row. NAME is
        the mean of each run, NAME_run_error its standard error and NAME_n_eff the number of independent values behind
        it; NAME_mean and NAME_error are over seeds (of a single seed the error within the run).

        Raises InputError as `dataset`, or if no row is as late.
        """
        return averaged(self.results(), start).to_xarray()

    def prediction(self) -> xarray.Dataset:
        """The results with means over drawn coefficients and seeds, as `dataset`.

        NAME_error is the standard error of NAME_mean over seeds, NAME_by_coefficients the standard deviation that the
        errors of the coefficients give to it, NAME_half_interval half the 95 % interval by both, as in figures.

        Raises InputError as `dataset`, or if the study draws no coefficients.
        """
        return with_half_intervals(pooled(self.results())).to_xarray()

    def _repr_html_(self) -> str:
        """The plan as a table, and the first of the results if there are some, for a notebook."""
        from ..plots.objects import page

        rows: dict[str, Any] = {"case": self.plan.path, "runs": self.runs, "seeds": len(self.plan.seeds)}
        for axis in self.plan.axes:
            for key, values in zip(axis.keys, zip(*axis.values, strict=True), strict=True):
                rows[key] = ", ".join(map(str, values))
        figure = None
        if self.output.exists():
            from .figure import draw

            figure = draw(Results.read(self.output), "T")
            figure.set_size_inches(4.2, 3.2)
        return page(
            f"Study {self.plan.name}", rows | {"results": self.output if figure else "none yet"}, figure
        )

    def _name(self, task: Task) -> str:
        return f"{self.plan.label(task.index[:-1])}, seed {self.plan.seeds[task.index[-1]]}"

    def _cluster(self, workers: int | None, scheduler: str | None) -> ClusterSection:
        """Workers or scheduler of the study: those of the arguments, else of the study file."""
        if workers is not None and scheduler is not None:
            names = option_name("--workers", "workers"), option_name("--scheduler", "scheduler")
            raise InputError(f"{names[0]}: cannot be combined with {names[1]}, which has its own workers")
        if workers is None and scheduler is None:
            return self.plan.cluster
        return ClusterSection(workers=workers, scheduler=scheduler)

    def _processes(self, cluster: ClusterSection) -> tuple[int, int]:
        """Processes here, and threads of each: one, unless there are more cores than runs."""
        good = self._checked_cases[0]
        if any(case.run.device != "cpu" for case in good.values()):
            return (cluster.workers if cluster.workers is not None else 1), 1
        cores = backend.cores()
        if cluster.kind is not None or cluster.scheduler is not None:
            return cluster.jobs, 1
        count = min(cores, self.runs) if cluster.workers is None else cluster.workers
        if count == 0:
            return 0, backend.usual_threads()
        return count, max(1, cores // count) if count <= self.runs < cores else 1

    def _work(self, missing: list[Task], cluster: ClusterSection, log: Callable[[str], None]) -> workers.Done:
        processes, threads = self._processes(cluster)
        if cluster.workers == 0:
            return workers.in_process(missing, threads)
        processes = max(1, min(processes, len(missing)))
        if cluster.scheduler is None and cluster.kind is None and not workers.has_dask():
            return workers.pool(missing, processes, threads)
        return workers.dask(missing, cluster, processes, threads, log)


def _progress_of(tasks: Sequence[Task]) -> str:
    """Clause on the runs that are done, behind the reason why the others are not."""
    left = sum(not task.result.exists() for task in tasks)
    return f"{len(tasks) - left} of {len(tasks)} runs are done; the same command continues"


class StudyProgress:
    """Runs that are done and the time that is left: a line that stays in its place on a terminal, else a
    line every 5 seconds, if more runs are done."""

    def __init__(self, runs: int, weights: list[float], status: Status) -> None:
        self._runs, self._all, self._status = runs, sum(weights) or 1.0, status
        self._done, self._weight = runs - len(weights), 0.0
        self._first: tuple[float, float] | None = None
        self._printed, self._bar = time.perf_counter(), sys.stderr.isatty()
        self._runs_printed = ""

    def __call__(self, weight: float | None, failed: int) -> None:
        """Update after a finished run with this part of the work; None only updates the clock."""
        now = time.perf_counter()
        if weight is not None:
            self._done += 1
            self._weight += weight
            if self._first is None:  # what passed before it compiled the kernels
                self._first = now, weight
        started, first = self._first or (now, 0.0)
        done = self._weight - first
        left = (now - started) * (self._all - self._weight) / done if done > 0.0 else math.inf
        fraction = self._done / self._runs if self._runs else 1.0
        counts = {"runs": self._runs, "runs_done": self._done, "runs_failed": failed}
        self._status.update(fraction=fraction, eta_seconds=left, **counts)
        due = now - self._printed >= (0.2 if self._bar else 5.0)
        runs = f"{self._done} of {self._runs} runs" + (f", {failed} failed" if failed else "")
        if not quiet() and (due or self._done == self._runs) and (self._bar or runs != self._runs_printed):
            text = f"{100.0 * fraction:5.1f} %  {runs}, ETA {clock_face(left)}"
            shown, end = (f"\r{text:<60}", "") if self._bar else (text, "\n")
            print(shown, end=end, file=sys.stderr, flush=True)
            self._printed, self._runs_printed = now, runs

    def close(self) -> None:
        """Release the terminal."""
        if self._bar and not quiet():
            print(file=sys.stderr, flush=True)
