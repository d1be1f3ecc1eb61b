"""Running a case: from its file to the trajectory, the picture and a summary."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import notices, starts
from ..case import summary as check
from ..case.case import IMPACT_SCAN, UNITS, CaseSections
from ..case.estimate import RunEstimate
from ..case.file import CaseFile
from ..case.gas import CaseGas
from ..errors import EngineError, InputError, Stopped, TrajectoryError, counted, refuse
from ..model.laws.records import to_record
from ..model.observables import TANGENTIAL, Measure, drift_text
from ..model.state import FrameRows, State
from ..model.walls.wall import wall_names
from ..mpi import SERIAL, Communicator, current
from ..quantities import MECHANISMS
from ..simulation import backend
from ..simulation.checkpoints import checkpoint
from ..simulation.measuring.tracking import Events
from ..simulation.simulation import Simulation
from ..simulation.steps.schedule import RunPlan, RunPoint, end_at
from ..tools.checked import Array
from ..tools.progress import DELAY, Progress, Stage, drawing, shown_stages
from ..trajectory import layout, parts
from ..trajectory.background import AsyncWriter
from ..trajectory.parts_writer import PartsWriter
from ..trajectory.views import write_views
from ..trajectory.writer import TrajectoryWriter
from .outputs import Outputs
from .recorder import Ledger, Recorder
from .signals import Stops
from .status import Status


@dataclass
class Run:
    """A run that is under way, from its beginning or from a checkpoint."""

    file: CaseFile
    outputs: Outputs
    simulation: Simulation
    plan: RunPlan
    ledger: Ledger
    writer: AsyncWriter | PartsWriter
    pending: Events | None = None
    output_share: float = 0.0
    """Processor time of writing over that of all, when the run is done."""


def run(
    file: CaseFile,
    outputs: Outputs,
    *,
    force: bool = False,
    max_hours: float | None = None,
    log: Callable[[str], None] = print,
    warn: Callable[[str], None] = print,
    comm: Communicator = SERIAL,
) -> None:
    """Run a case, and write its trajectory and picture.

    Whatever can be refused is refused before a file is touched.

    `force` replaces files that exist; after `max_hours` of real time it stops with a checkpoint; `log` and `warn` take
    the lines to show. `comm` are ranks of MPI that share the gas (`read_on_ranks`): all call this, and the root writes.
    It alone builds the start where that is not made in slices. Ranks that cannot share the gas
    (`CaseGas.usable_ranks`) wait.

    Raises InputError if the case, the device or the outputs cannot be used. Else the trajectory keeps the frames so
    far: Stopped, with a checkpoint, by a signal or the limit of time; KeyboardInterrupt after a second Ctrl-C
    or one before it has started; EngineError or TrajectoryError if the engine or the disk fails.
    """
    gas, case = file.gas, file.case
    options: dict[str, Any] = {"force": force, "max_hours": max_hours, "log": log, "warn": warn}
    if on_usable_ranks(gas, comm, log, lambda part: run(file, outputs, **options, comm=part)):
        return
    comm = gas.communicator(comm)
    in_slices = comm.any(gas.given is not None and len(gas.given.position) < gas.n)
    cores, share = comm.share_of_cores(backend.cores()), comm.local_share
    started = time.perf_counter()
    drawn = comm.is_distributed and starts.is_made_in_slices(gas)

    def prepared() -> State | None:
        outputs.check(force=force)
        case.run.choose_runtime()  # before the check of a GPU, which imports a runtime
        estimate = RunEstimate.of(gas)
        folder = outputs.trajectory.parent
        refuse(check.refused_here(gas, estimate, folder, share=share, ranks=comm.size, sliced=drawn))
        check.refuse_cadences(gas, estimate)
        crushes = notices.wall_pinch_warnings(gas)
        log(check.summary(gas, estimate, how(case, cores, comm.size)))
        for text in (*notices.warnings(gas), *crushes, *notices.notices(gas)):
            warn(text)
        return None if drawn else starts.start(gas, Stage("growth"))

    def made() -> tuple[Simulation, NDArray[np.int32], State | None]:
        state: Any = comm.run_on_root(prepared)
        if in_slices or drawn:
            with comm:
                state = starts.start(gas)
        whole = comm.bcast(state is not None and state.n == gas.n)
        holders = Communicator(comm) if whole else comm
        tracked = holders.result_of_holders(lambda: starts.tracked(gas, state))
        with holders:
            start = start_of_histories(gas.n, tracked, state) if len(tracked) else None
        return gas.simulation(state, tracked=tracked, comm=comm), tracked, start

    try:
        with shown_stages() if comm.is_root else contextlib.nullcontext():
            simulation, tracked, start = made()
    except KeyboardInterrupt:
        raise KeyboardInterrupt("interrupted before the first frame: nothing was written") from None
    now, run_keys = RunPoint(simulation.time, simulation.collisions), case.run
    end = end_at(gas.n, now, t_end=run_keys.t_end, collisions_per_disk=run_keys.collisions_per_disk)
    plan = RunPlan(gas.n, now, end, case.frame_cadence, case.series_cadence)
    in_parts = case.output.in_parts(gas.n, comm.size)
    options = {"units": UNITS[case.run.units], "force": force, **stored(gas)}

    def begin() -> TrajectoryWriter | None:
        if force:  # the checkpoint of the trajectory that is replaced is of no use
            outputs.check(force=True)  # again: another run may have started while the start was made
            checkpoint.remove(outputs.checkpoint)
            parts.remove(outputs.trajectory)
        options["parameters"] = _record(file, cores, comm.size)
        return None if in_parts else TrajectoryWriter(outputs.trajectory, gas.disks, gas.box, **options)

    writer = comm.run_on_root(begin)
    queue: Any = None
    if in_parts:
        queue = PartsWriter.create(
            outputs.trajectory, simulation.disks, simulation.disks_here, gas.box, comm=comm, **options
        )
    elif writer is not None:
        queue = AsyncWriter(writer)
    if not comm.is_root:
        run_worker(case, simulation, plan, queue)
        return
    with queue:
        if start is not None:
            queue.begin_histories(tracked, start)
        running = Run(file, outputs, simulation, plan, Ledger(area=gas.stress_area), queue)
        before = simulation.collisions
        rate = run_root(running, started, max_hours=max_hours, log=log, warn=warn)
    finish(running, started, before, rate, log)


def start_of_histories(n: int, ids: NDArray[np.int32], state: State) -> State | None:
    """State of some disks, by ascending ids, on the root; of ranks that have slices, each gives its own."""
    comm = current()
    if comm.has_all:
        return state
    if not comm.is_distributed:
        return None
    names = ("position", "velocity", "spin", "image")
    rows = comm.rows_of(n, ids if comm.is_root else ids[:0], [getattr(state, name) for name in names])
    return State(time=state.time, **dict(zip(names, rows, strict=True))) if comm.is_root else None


def stored(gas: CaseGas) -> dict[str, Any]:
    """Arguments of the writer of a case's trajectory."""
    output = gas.case.output
    return {
        "fields": output.fields, "precision": output.precision, "compression": output.compression, "walls": gas.walls,
    }  # fmt: skip


def on_usable_ranks(
    gas: CaseGas, comm: Communicator, log: Callable[[str], None], work: Callable[[Communicator], None]
) -> bool:
    """Do work on the ranks that can share a gas, while the others wait; False, and nothing, if all can."""
    count, reason = comm.root_result(lambda: gas.usable_ranks(comm.size))
    if count == comm.size:
        return False
    log(f"{idle_ranks(count, comm.size)}: {reason}")
    # Signals are the working ranks': they come to all.
    with contextlib.nullcontext() if comm.rank < count else Stops(warn=lambda _text: None):
        comm.run_on_first(count, work)
    return True


def idle_ranks(count: int, ranks: int) -> str:
    """Text on how many ranks work and wait."""
    return f"{count} of {ranks} ranks compute{'s' if count == 1 else ''}, the others wait"


def how(case: CaseSections, cores: int, ranks: int = 1) -> str:
    """Device of a case and its threads, for the summary of a run."""
    used = case.run.threads or cores
    text = device_of(case) + (f", {used} used" if case.run.device == "cpu" else "")
    text += f" by each of {ranks} ranks" if ranks > 1 else ""
    return text + (f", computing in {case.run.precision}" if case.run.precision != "f64" else "")


def device_of(case: CaseSections) -> str:
    """The device of a case."""
    device = backend.describe(case.run.device)
    return f"{device.name}: {device.description}"


class RootOutput:
    """Output of the root during a run: frames, rows of the series, status, progress, checkpoints."""

    def __init__(self, running: Run, stops: Stops) -> None:
        gas, plan = running.file.gas, running.plan
        case, run = gas.case, gas.case.run
        named = wall_names(gas.free_area.all_walls, gas.box)
        walls = zip(named, gas.free_area.all_walls, strict=True)
        self.running, self.stops = running, stops
        self.recorder = Recorder(
            running.writer, running.ledger, running.simulation.take_events if case.output.tracks else None,
            running.pending, walls=named, pistons=[name for name, wall in walls if wall.piston is not None],
            species=[each.name for each in gas.species], regions=list(gas.case.output.regions),
        )  # fmt: skip
        self.status = Status(
            running.outputs.trajectory, name=run.name, t_end=run.t_end,
            collisions_per_disk_end=run.collisions_per_disk, device=device_of(case),
        )  # fmt: skip
        self.progress = Progress(
            gas.n, t_end=run.t_end, collisions_per_disk=run.collisions_per_disk,
            begin=(plan.begin.time, int(plan.begin.collisions)),
            unit=UNITS[run.units]["time"] if run.units == "SI" else "", kernels=running.simulation.n_kernels,
        )  # fmt: skip

    def follow(self) -> None:
        """Run to the end, and write all that is given to the trajectory."""
        running = self.running
        with self.recorder:
            running.simulation.follow(
                running.plan, frame_callbacks=[self.frame], series_callbacks=[self.row], progress=self.report,
                between=self.between, stored=_stored(running.file.case),
            )  # fmt: skip
        # A signal that comes while the latest frames are written is that of a run that is about to end anyway.
        running.writer.flush()

    def frame(self, rows: FrameRows, measure: Measure) -> None:
        """Give a frame to the trajectory; with `low_memory` it is written before the run goes on."""
        running = self.running
        self.recorder.frame(_as_written(running.simulation, running.writer, rows), measure)
        if running.file.case.run.low_memory and isinstance(running.writer, AsyncWriter):
            running.writer.flush()

    def row(self, measure: Measure) -> None:
        """Give a row to the series, and its values to the status."""
        self.recorder.row(measure)
        ledger = self.running.ledger
        self.status.update(
            temperature=measure.temperature, rotational_temperature=measure.rotational_temperature,
            energy=measure.energy, dissipated_energy=ledger.dissipated(measure),
            ledger_residual=ledger.relative_residual(measure),
        )  # fmt: skip

    def report(self, time: float, collisions: int) -> None:
        """Show the progress, also in the status."""
        progress, writer = self.progress, self.running.writer
        progress(time, collisions)
        self.status.update(
            time=time, collisions=collisions,
            collisions_per_disk=2.0 * collisions / max(self.running.file.gas.n, 1), fraction=progress.fraction,
            collisions_per_second=progress.collisions_per_second, eta_seconds=progress.seconds_left,
            frames=len(writer), series_rows=writer.series_rows,
        )  # fmt: skip

    def between(self) -> None:
        """Commit what is written, end the run if it has to, and write a checkpoint that is due."""
        running, simulation = self.running, self.running.simulation
        _check_stop_on_all(simulation, self.stops, lambda: self.recorder.between(simulation.time))
        running.writer.commit()
        if simulation.comm.bcast(self.stops.checkpoint_due):
            save(running, self.recorder)
            self.stops.stored()

    def count(self) -> None:
        """Write the numbers of stored frames and rows to the status."""
        writer = self.running.writer
        self.status.update(frames=len(writer), series_rows=writer.series_rows)

    def stop(self, reason: str) -> str:
        """Write a checkpoint and the status of a run that is stopped; the text says what remains."""
        save(self.running, self.recorder)
        text = _remains(self.running, reason)
        self.finish("interrupted", text)
        return text

    def interrupt(self) -> str:
        """Write the status of a run that is interrupted, or remove its files if nothing is stored; the text says so."""
        running = self.running
        if (
            isinstance(running.writer, AsyncWriter) or running.simulation.comm.size == 1
        ):  # else it takes all ranks
            with contextlib.suppress(InputError, TrajectoryError):  # the interrupt is what is reported
                running.writer.flush()
        text = _remains(running, "interrupted")
        if len(running.writer):
            self.finish("interrupted", text)
        else:
            self.status.path.unlink(missing_ok=True)
            checkpoint.remove(running.outputs.checkpoint)
        return text

    def finish(self, state: str, text: str = "") -> None:
        """Write the last status."""
        self.count()
        self.status.finish(state, _one_line(text))


def run_root(
    running: Run,
    started: float,
    *,
    max_hours: float | None,
    log: Callable[[str], None],
    warn: Callable[[str], None],
) -> float:
    """Run to the end with all output of the case; return collisions per second of real time.

    `max_hours` count from when the job `started` (`perf_counter`), with the making of its start.

    Raises Stopped or KeyboardInterrupt or EngineError or TrajectoryError as `run`.
    """
    stops = Stops(
        max_hours=max_hours, every_minutes=running.file.case.output.checkpoint_minutes,
        elapsed=time.perf_counter() - started, warn=warn,
    )  # fmt: skip
    log(f"compiling kernels: {check.COMPILING}")  # before a bar is there
    output = RootOutput(running, stops)
    worked = time.process_time()
    try:
        asked = backend.stops_asked_by(lambda: stops.reason is not None)
        with stops, asked, output.progress, backend.announced(output.progress.compiling):
            output.follow()
    except Stopped as stop:
        raise Stopped(output.stop(str(stop)), stop.status) from None
    except KeyboardInterrupt:
        raise KeyboardInterrupt(output.interrupt()) from None
    except Exception as error:  # raised again below; without this the status file says that the run continues
        known = isinstance(error, EngineError | TrajectoryError | InputError)
        output.finish("failed", str(error) if known else repr(error))
        raise
    checkpoint.remove(running.outputs.checkpoint)
    output.finish("done")
    running.output_share = (output.recorder.seconds + running.writer.seconds) / (time.process_time() - worked)
    return output.progress.collisions_per_second


def run_worker(
    case: CaseSections, simulation: Simulation, plan: RunPlan, writer: PartsWriter | None = None
) -> None:
    """Run to the end, on a rank that writes nothing, or only its part; the root controls the run."""
    stops = Stops(warn=lambda _text: None)
    comm = simulation.comm

    def save_too() -> None:
        comm.run_on_root(lambda: None)  # whether what comes before a checkpoint could be written
        if writer is not None:
            writer.flush()
        try:
            simulation.save_checkpoint("")  # where the first one says
        except InputError as error:  # as in `save`
            raise TrajectoryError(str(error)) from error

    def frame(rows: FrameRows, _measure: Measure) -> None:
        shares = _as_written(simulation, writer, rows)
        if writer is not None:
            writer.write_frames([(shares, None)])

    def between() -> None:
        _check_stop_on_all(simulation, stops, writer.raise_error if writer is not None else lambda: None)
        if writer is not None:
            writer.commit()
        if comm.bcast(False):
            save_too()

    with contextlib.nullcontext() if writer is None else writer:
        try:
            with stops:
                simulation.follow(plan, frame_callbacks=[frame], between=between, stored=_stored(case))
            if writer is not None:
                writer.flush()
        except Stopped:
            save_too()
            raise
    simulation.measure()  # after which the first one reads what was written


def _as_written(simulation: Simulation, writer: AsyncWriter | PartsWriter | None, frame: FrameRows) -> Any:
    """A frame as the writer takes it: rows of the parts of this rank, or all disks, on the first one (else None)."""
    if isinstance(writer, PartsWriter):
        return writer.shares(frame)
    if not simulation.comm.is_distributed:
        return frame
    rows = simulation.comm.gather_rows(simulation.disks.n, [frame.rows])
    return None if rows is None else FrameRows(frame.time, rows[0])


def _stored(case: CaseSections) -> np.dtype[Any]:
    """Type of a disk in the frames of the trajectory."""
    return layout.frame_dtype(case.output.fields, case.output.precision)


def _check_stop_on_all(
    simulation: Simulation, stops: Stops, work: Callable[[], object] = lambda: None
) -> None:
    """Raise what a rank has to end for on all of them."""
    error: Exception | None = None
    try:
        work()
        stops.check()
    except (Stopped, TrajectoryError, InputError) as raised:
        error = raised
    simulation.comm.raise_collectively(error)


def save(running: Run, recorder: Recorder) -> None:
    """Write a checkpoint, after all that was given to the trajectory is committed."""

    def commit() -> None:
        recorder.write()
        if isinstance(running.writer, AsyncWriter):
            running.writer.flush()

    running.simulation.comm.run_on_root(commit)
    if isinstance(running.writer, PartsWriter):  # which all ranks have
        running.writer.flush()
    pending = recorder.pending
    arrays = {} if pending is None else {f"extra_{name}": each for name, each in pending.columns().items()}
    extra = {
        "name": running.file.case.run.name,
        "case": running.file.text,
        "case_path": str(running.file.path.resolve()),
        "overrides": list(running.file.overrides),
        # Without defaults: keys that exclude each other must not stand side by side.
        "case_as_set": running.file.case.model_dump_json(exclude_unset=True),
        "trajectory": running.outputs.trajectory.name,
        "plan": running.plan.to_record(),
        "ledger": running.ledger.to_record(),
        "seen": running.writer.written_counts,
    }
    try:
        running.simulation.save_checkpoint(running.outputs.checkpoint, extra, arrays)
    except InputError as error:  # a full disk is no bad input
        raise TrajectoryError(_remains(running, str(error))) from error


def finish(running: Run, started: float, before: int, rate: float, log: Callable[[str], None]) -> None:
    """Draw the picture, and say what the run did since it `started` (`perf_counter`), after so many collisions."""
    ran = time.perf_counter() - started
    last, statistics, n = running.simulation.measure(), running.simulation.statistics, running.file.gas.n
    if running.outputs.views:
        write_views(running.outputs.trajectory)
    if running.outputs.picture is not None:
        if ran >= DELAY:  # the progress was shown
            drawing(running.outputs.picture.name)
        _draw(running.file.case)(running.outputs.trajectory, running.outputs.picture)
    overall = (last.collisions - before) / ran
    first, done = running.ledger.first, f"done in {time.perf_counter() - started:.1f} s: "
    assert first is not None
    if before > first.collisions:
        done += f"{last.collisions - before} collisions since it was resumed, in all "
    collisions = last.collisions - first.collisions
    done += f"{collisions} collisions ({2.0 * collisions / n:.4g} per disk) to t = {last.time:.5g}"
    log(
        f"{done}{running.file.case.unit('time')}; {rate:.3g} collisions/s once compiled, {overall:.3g} in all"
    )
    for line in _balance(running, last):
        log(f"  {line}")
    resting_speed = running.file.case.run.resting_speed
    if elastic := statistics.elastic:
        what = (
            "were made elastic by the remedy for inelastic collapse"
            if resting_speed is None
            else f"were slower than the resting speed, {resting_speed:g}: of contacts that last"
        )
        log(f"  {elastic} collisions {what}")
    if resting_speed is not None:
        log(f"  {running.simulation.asleep} of {n} disks sleep")
        if unverified := statistics.unverified:
            part = 100.0 * unverified / statistics.windows
            text = f"  in {unverified} windows, {part:.2g} % of all, the forces in the heap were not found"
            log(
                f"{text}: it is uncertain which disks rest there; if they are many, compare with a heap of another "
                "resting_speed"
            )
        if jammed := statistics.jammed:
            log(
                f"  {jammed} times a disk jammed between others fell asleep while it moved; if this happens in many of "
                "its collisions, the start may be too dense, or walls may close on disks"
            )
    rows, frames = running.writer.series_rows, len(running.writer)
    log(
        f"  output, {frames} frames and {rows} rows of series, took {100.0 * running.output_share:.2g} % of the "
        "run time"
    )
    for path, bytes_there in running.outputs.sizes().items():
        log(f"  {path} ({check.size(bytes_there)})")


def _draw(case: CaseSections) -> Callable[[Path, Path], object]:
    """Function that draws the picture of a case."""
    from .. import plots  # Matplotlib takes a second, which no run need wait for at its beginning

    if case.start.file is None and case.start.positions == IMPACT_SCAN:
        return plots.impact_scan
    if any(each.kind == "table_friction" for each in case.force):
        return plots.table
    if case.walled:
        return plots.walled
    if case.box.shear_rate:
        return plots.sheared
    return plots.driven if case.force else plots.cooling


def _one_line(text: str) -> str:
    """Message of an interruption for the status, whose state names the interruption already."""
    return "; ".join(text.removeprefix("interrupted: ").splitlines())


def _remains(running: Run, reason: str) -> str:
    latest, trajectory = running.ledger.latest, running.outputs.trajectory
    if len(running.writer) == 0 or latest is None:
        return f"{reason} before the first frame: nothing was written"
    if cause := running.writer.replaced_or_removed:
        return f"{reason}: {trajectory} is lost: {cause}"
    text = f"{reason}: {trajectory} holds the {counted(len(running.writer), 'frame')} so far, "
    text += f"to t = {latest.time:.6g} and {latest.collisions} collisions"
    if running.outputs.checkpoint.exists():
        path = str(trajectory)  # relative to where the user is, as it was given
        path = os.path.join(os.curdir, path) if path.startswith("-") else path
        text += f"\nto resume: ifrdem resume {shlex.quote(path)}"
    return text


ROUNDING = 1e-12
"""Part of an energy that rounding may be: sums of n terms walk by 2^-53 n^(1/2) of themselves, 1e-12 at 1e8."""


def _mechanisms(dissipated: Array, turned: float, energy: str) -> Iterator[str]:
    """Lines on the energy that each mechanism took, with its unit, and why one of them may be below 0.

    What is rounding of all that was taken, or of all energy that was there, is left out.
    """
    rounding = ROUNDING * max(abs(dissipated).sum(), turned)
    took = dict(zip(MECHANISMS, dissipated.tolist(), strict=True))
    if parts := [
        f"{name.replace('_', ' ')} {part:.4g}" for name, part in took.items() if abs(part) > rounding
    ]:
        yield f"by mechanism: {', '.join(parts)}{energy}"
    if below := [name.replace("_", " ") for name in TANGENTIAL if took[name] < -rounding]:
        yield (
            f"  {' and '.join(below)} below 0: by convention tangential restitution acts first, and friction may give "
            f"back a part of what it took; together they took {sum(took[name] for name in TANGENTIAL):.4g}{energy}"
        )


def _balance(running: Run, last: Measure) -> Iterator[str]:
    """Lines on temperatures, energy and momentum at the end of a run, against its beginning."""
    gas, case, ledger, first = running.file.gas, running.file.case, running.ledger, running.ledger.first
    energy = case.unit("energy")
    assert first is not None
    temperatures = []
    if first.temperature > 0.0:
        temperatures.append(f"T/T0 = {last.temperature / first.temperature:.5g}")
    if last.temperature > 0.0:
        temperatures.append(f"theta = T_rot/T = {last.rotational_temperature / last.temperature:.4g}")
    if temperatures:
        yield ", ".join(temperatures)
    mass = sum(each.number * each.summary.mass.mean for each in gas.species)
    if (
        gas.n > 1
        and not gas.box.is_open
        and last.drift_energy > notices.REPORTED_DRIFT * last.translational_energy
    ):
        where = drift_text(last.momentum / mass * gas.free)
        share = 100.0 * last.drift_energy / last.translational_energy
        yield (
            f"the whole gas drifts at {where}, {share:.4g} % of the kinetic energy of its motion; "
            "temperatures are about its mean velocity"
        )
    lost, turned = ledger.dissipated(last), ledger.turned(last)
    is_nothing = abs(lost) <= ROUNDING * turned
    loss = "nothing (to rounding)" if is_nothing else f"{lost:.6g}{energy}"
    if case.walled:
        heat = f" and {last.wall_heat:.6g}{energy} as heat" if last.wall_heat != 0.0 else ""
        yield f"{last.wall_collisions} collisions with walls, which gave {last.wall_work:.6g}{energy} as work{heat}"
    sources = [
        name for name, present in (("forces", case.force), ("the flow", gas.box.shear_rate)) if present
    ]
    if sources or case.walled:
        inputs = f"{' and '.join(sources)} put in {last.energy_input:.6g}{energy}, " if sources else ""
        yield f"{inputs}collisions dissipated {loss}"
    elif first.energy > 0.0:
        part = "" if is_nothing else f", {100.0 * lost / first.energy:.4g} % of the initial energy"
        yield f"dissipated {loss}{part}"
    residual = ledger.relative_residual(last)
    if residual is not None and last.dissipated is not None:
        yield from _mechanisms(last.dissipated, turned, energy)
        yield f"energy balance: relative error {abs(residual):.1e}"
    # Against the momentum that the disks' typical speed would add up to, all one way.
    scale = float(np.sqrt(2.0 * first.translational_energy * mass))
    if first.energy > 0.0 and scale > 0.0:
        change = float(np.linalg.norm(last.momentum - first.momentum))
        # Heat baths, drag, walls, gravity, and a flow at the sides that disks cross change it.
        changed = case.force or case.walled or any(case.box.gravity) or gas.box.shear_rate
        yield (
            f"momentum {'change' if changed else 'drift'} {change:.2g}{case.unit('momentum')} "
            f"({change / scale:.2g} of sum m|v| at the start)"
        )


def _record(file: CaseFile, cores: int, ranks: int = 1) -> dict[str, str | int | float]:
    """Record of a trajectory's origin, its parameters."""
    case, gas = file.case, file.gas
    species = [{"name": each.name, "number": each.number, "material": each.material} for each in gas.species]
    laws = [[law and to_record(law) for law in row] for row in gas.laws]
    return {
        "name": case.run.name,
        "seed": case.run.seed,
        "case": file.text,
        "overrides": "\n".join(file.overrides),
        "case_in_full": case.model_dump_json(),
        "species": json.dumps(species),
        "materials": json.dumps(gas.materials),
        "laws": json.dumps(laws),
        "forces": json.dumps([each.model_dump(exclude_none=True) for each in case.force]),
        "gravity": json.dumps(case.box.gravity),
        **(
            {"gravity_rotation_rate": case.box.gravity_rotation_rate}
            if case.box.gravity_rotation_rate
            else {}
        ),
        "collapse": case.run.collapse,
        "device": device_of(case) if ranks == 1 else how(case, cores, ranks),
        "threads": case.run.threads or cores,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        **({} if ranks == 1 else {"ranks": ranks}),
    }
