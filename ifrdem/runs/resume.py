"""Resume a run that was stopped, with the bits of an uninterrupted run."""

from __future__ import annotations

import contextlib
import difflib
import json
import operator
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..case import file as case_file
from ..case import summary
from ..case.case import CaseSections
from ..case.file import CaseFile
from ..case.gas import CaseGas
from ..errors import InputError, option_name
from ..kernels.compiler import runtime as of_kernels
from ..model.laws.records import is_custom, of_table, source_of_record
from ..mpi import SERIAL, Communicator
from ..simulation import backend
from ..simulation.checkpoints import checkpoint
from ..simulation.measuring.tracking import Events
from ..simulation.simulation import Simulation
from ..simulation.steps.schedule import RunPlan
from ..tools import text_file
from ..tools.files import CHECKPOINT, checkpoint_of
from ..tools.old_words import present_case
from ..trajectory import parts
from ..trajectory.background import AsyncWriter
from ..trajectory.parts_writer import PartsWriter
from ..trajectory.writer import TrajectoryWriter
from . import status
from .outputs import Outputs, only
from .recorder import Ledger
from .run import Run, finish, how, on_usable_ranks, run_root, run_worker, stored

NO_RUN = "a checkpoint of `Simulation.save_checkpoint`: Simulation.from_checkpoint resumes from it"
"""Description of a checkpoint without a run."""


def find(source: str | os.PathLike[str]) -> Path:
    """The checkpoint of a path: itself, that of a trajectory, or the only one in a folder.

    Raises InputError if there is none, or several.
    """
    path = Path(source)
    if path.is_dir():
        checkpoints = list(path.glob(f"*{CHECKPOINT}"))
        if not checkpoints:
            raise InputError(
                f"{path}: no run to resume here: there is no *{CHECKPOINT}; a run that is done has none"
            )
        return only(checkpoints, f"{path}: several runs to resume here")
    if path.name.endswith(CHECKPOINT):
        return path
    if not path.exists():
        raise InputError(f"{source}: there is no such file or folder")
    found = checkpoint_of(path)
    if not found.exists():
        reason = f"there is no {found.name} next to it: the run is done, or was killed in its very beginning"
        with contextlib.suppress(InputError):  # no status file, or not one of ours
            if status.read(path)["state"] == status.DONE:
                reason = "the run is done"
        raise InputError(
            f'{source}: {reason}. A new run can begin with a stored frame: start.positions = "{path.name}"'
        )
    return found


def resume(
    source: str | os.PathLike[str],
    *,
    ignore_case_changes: bool = False,
    threads: int | None = None,
    runtime: str | None = None,
    max_hours: float | None = None,
    picture: bool = True,
    log: Callable[[str], None] = print,
    warn: Callable[[str], None] = print,
    comm: Communicator = SERIAL,
) -> None:
    """Resume a run from its checkpoint: its trajectory gets the same frames as if it had not been stopped.

    Frames that were committed after the checkpoint are computed again and compared, bit for bit.

    `source` is the trajectory, its checkpoint, or the folder that holds the only one. `ignore_case_changes` resumes as
    the run began though its case file has changed since. `threads` may be another number of CPU threads than before:
    the result does not depend on it. `runtime` compiles the kernels, by default that of the process or the environment
    or else, if it is installed, that of the checkpoint. A picture is drawn at the end, if the case wants it. Others as
    for `run.run`; the number of ranks may be another one, too.

    Raises InputError if there is no checkpoint, it belongs to another version, case or trajectory, or the device is not
    there; Stopped or KeyboardInterrupt or EngineError or TrajectoryError as `run.run`.
    """
    options: dict[str, Any] = {
        "ignore_case_changes": ignore_case_changes, "threads": threads, "runtime": runtime, "max_hours": max_hours,
        "picture": picture, "log": log, "warn": warn,
    }  # fmt: skip
    gas = comm.root_result(lambda: None if comm.size == 1 else _gas_of(find(source), runtime))
    if gas is not None and on_usable_ranks(gas, comm, log, lambda part: resume(source, **options, comm=part)):
        return
    cores, share = comm.share_of_cores(backend.cores()), comm.local_share
    started = time.perf_counter()

    def prepared() -> tuple[Any, ...]:
        path = find(source)
        arrays, record = checkpoint.read(path, rows=False)
        with checkpoint.as_damage_error(path, "its record"):
            extra: Mapping[str, Any] = record["extra"]
            if "plan" not in extra:
                raise InputError(f"{path}: {NO_RUN}")
            if not ignore_case_changes:
                _refuse_changed(path, extra)
            case = _case_of(record, path, runtime)
            trajectory = path.with_name(extra["trajectory"])
            if checkpoint_of(trajectory) != path:
                raise InputError(f"{path} belongs to {extra['trajectory']}: rename it back")
            _refuse_changed_laws(record, path)
            original = Path(extra["case_path"]), str(extra["case"]), tuple(map(str, extra["overrides"]))
            ledger = Ledger.from_record(extra["ledger"])
            plan = RunPlan.from_record(extra["plan"], case.frame_cadence, case.series_cadence)
            names = ("frames", "series_rows", "events")
            written: dict[str, Any] = {name: operator.index(extra["seen"][name]) for name in names}
        if threads is not None:
            case = _with(case, threads=threads)
        backend.check(case.run.made_device())
        n = sum(each.number for each in case.species)
        low = case.run.low_memory
        summary.refuse_beyond_memory(n, case.run.device, share=share, ranks=comm.size, low_memory=low)
        try:
            gas = CaseGas.from_case(case, original[0].parent, start=False)
        except InputError as error:
            raise InputError(f"{original[0]}: {error}") from None
        file = CaseFile(*original, gas)
        outputs = Outputs.plan(case, str(trajectory), picture=picture)
        disks = gas.kinds if parts.are_in(trajectory) else gas.disks  # parts look at theirs themselves
        writer = TrajectoryWriter.resume(trajectory, disks, gas.box, **stored(gas), **written)
        return (path, file, outputs, plan, written, writer.parts is not None), writer, ledger, _events(arrays)

    sent, writer, ledger, pending = comm.run_on_root(prepared) or (None, None, Ledger(), None)
    path, file, outputs, plan, written, in_parts = comm.bcast(sent)
    gas, case = file.gas, file.case
    case.run.choose_runtime()  # on all ranks: so far the root has
    comm = gas.communicator(comm)
    with contextlib.ExitStack() as stack:
        if writer is not None:
            stack.enter_context(writer)
        simulation = Simulation.from_checkpoint(path, device=case.run.made_device(), comm=comm)
        queue: Any = None
        if in_parts:
            options = {**stored(gas), "frames": written["frames"]}
            queue = PartsWriter.resume(writer, simulation.disks_here, gas.box, comm=comm, **options)
        elif writer is not None:
            queue = AsyncWriter(writer)
        if not comm.is_root:
            run_worker(case, simulation, plan, queue)
            return
        stack.enter_context(queue)
        later = len(queue) - ledger.frames
        more = f"; {later} later frames of the file are computed again and compared" if later > 0 else ""
        moment = f"t = {simulation.time:.6g}{case.unit('time')}, after {simulation.collisions} collisions"
        frames = f"{ledger.frames} frames, on {how(case, cores, comm.size)}{more}"
        log(f"{case.run.name}: {gas.n} disks resume at {moment} and {frames}")
        running = Run(file, outputs, simulation, plan, ledger, queue, pending)
        before = simulation.collisions
        rate = run_root(running, started, max_hours=max_hours, log=log, warn=warn)
    finish(running, started, before, rate, log)


def _with(case: CaseSections, **run: Any) -> CaseSections:
    """A case with other values of its run."""
    return case.model_copy(update={"run": case.run.model_copy(update=run)})


def _case_of(record: Mapping[str, Any], path: Path, name: str | None) -> CaseSections:
    """The case of a checkpoint on the runtime that is chosen for it; InputError if the bits could change."""
    written = of_kernels.of_versions(record["versions"])[0]
    free = not of_kernels.is_loaded() and not os.environ.get(of_kernels.VARIABLE)
    if name is None and free and of_kernels.version(written) is not None:
        name = written
    of_kernels.choose(name, "--runtime")
    case = CaseSections.model_validate(present_case(json.loads(record["extra"]["case_as_set"])))
    checkpoint.check_versions(record, path, case.run.device)
    return _with(case, runtime=of_kernels.chosen())


def _refuse_changed_laws(record: Mapping[str, Any], path: Path) -> None:
    """Raise InputError if the file of a custom law is not there, or has changed: the checkpoint holds no code."""
    for each in filter(is_custom, of_table(record["gas"]["law"])):
        try:
            source_of_record(each, Path(each["path"]).parent)
        except InputError as error:
            trajectory = record["extra"]["trajectory"]
            raise InputError(
                f"{path}: {error}; for another law, begin a new run from a stored frame: start.positions = "
                f'"{trajectory}"'
            ) from None


def _gas_of(path: Path, runtime: str | None) -> CaseGas:
    """The gas of a checkpoint, as far as ranks are divided for it."""
    record = checkpoint.read(path, rows=False)[1]
    with checkpoint.as_damage_error(path, "its record"):
        if "case_as_set" not in record["extra"]:
            raise InputError(f"{path}: {NO_RUN}")
        case = _case_of(record, path, runtime)
        _refuse_changed_laws(record, path)
        folder = Path(record["extra"]["case_path"]).parent
    return CaseGas.from_case(case, folder, start=False)


def _events(arrays: Mapping[str, NDArray[Any]]) -> Events | None:
    """Events that had not been written at the checkpoint; None if no disk is tracked."""
    found = {name.removeprefix("extra_"): each for name, each in arrays.items() if name.startswith("extra_")}
    return Events.of(len(found["id"]), **found) if found else None


def _refuse_changed(path: Path, extra: Mapping[str, Any]) -> None:
    """Raise InputError if the case file still exists and has changed."""
    case = Path(extra["case_path"])
    try:
        if not case.is_file():  # a pipe would be waited for
            return
        present = text_file.read(case, most=case_file.MOST_BYTES)
    except InputError:  # it is gone, or elsewhere: the checkpoint holds the case
        return
    if present == extra["case"]:
        return
    old, new = extra["case"].splitlines(), present.splitlines()
    diff = difflib.unified_diff(old, new, lineterm="", n=0)
    lines = [line for line in diff if not line.startswith(("---", "+++", "@@"))]
    more = f" (and {len(lines) - 6} lines more)" if len(lines) > 6 else ""
    raise InputError(
        f"{path}: the case file {case} has changed since the run began: {'; '.join(lines[:6])}{more}. A run resumes "
        f"only as it began: put the file back, or {option_name('--ignore-case-changes', 'ignore_case_changes=True')} "
        "resumes the case as it was; for a new "
        f'case, begin a new run from a stored frame: start.positions = "{extra["trajectory"]}"'
    )
