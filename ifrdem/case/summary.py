"""Limits of this machine for a run, and the lines printed before it."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from ..errors import InputError, option_name, refuse
from ..kernels.columns import bytes_per_disk
from ..kernels.compiler import runtime
from ..simulation import backend
from ..simulation.start import checks
from ..simulation.steps.schedule import MOST as MOST_FRAMES
from ..simulation.windows.tiling import split_of
from . import starts
from .case import GROWN, CaseSections
from .estimate import (
    GROWTH_BYTES_PER_DISK,
    KEPT_BYTES,
    PROCESS_BYTES,
    START_BYTES_PER_DISK,
    WRITER_BYTES_PER_DISK,
    RunEstimate,
    strip_bytes,
)
from .gas import CaseGas

GPU_BYTES_PER_DISK, GPU_SCRATCH = 120, 200_000_000
"""Memory of a GPU beyond `bytes_per_disk`: bytes per disk, for arrays of tiles and 1.2 ghost records instead of 0.4
(tiles are small); bytes of scratch space of the blocks that run at the same time."""
LAYERED_SCRATCH, LAYERED_BYTES_OF_FEW = 9_000_000_000, 2500
"""For two layers of cells, whose tiles are run by one thread each: bytes of scratch space; all bytes per disk, if
there are few tiles."""

COMPILING = "a second or two if this machine has compiled them before, else about ten seconds"


def refuse_cadences(gas: CaseGas, estimate: RunEstimate) -> None:
    """Raise InputError for frames or rows of series at intervals that make no sense, with a line for each.

    At most `MOST_FRAMES` of either, as where a number is given. The length of the run is its own, or the one that
    theory expects; where neither is known, so many must not fall into the shortest time that the case names: a mean
    free time, the flight over a radius, a step of a force. And nothing is written more often than the gas collides.
    """
    refuse(
        [
            f"output.{key} = {value:g}: {text}"
            for what in ("frames", "series")
            for key, value, text in _check_cadence(gas, estimate, what)
        ]
    )


def _check_cadence(gas: CaseGas, estimate: RunEstimate, what: str) -> Iterator[tuple[str, float, str]]:
    case = gas.case
    many = f"{MOST_FRAMES} {'frames' if what == 'frames' else 'rows'}"
    interval = getattr(case.output, f"{what}_interval")
    if interval is not None:
        length, which = _length(gas, estimate)
        if not math.isnan(length) and interval * MOST_FRAMES < length:
            text = f"more than {many} in {length:.4g}{case.unit('time')}, {which}"
            yield (
                f"{what}_interval",
                interval,
                f"must be {length / MOST_FRAMES:.3g} or more: otherwise {text}",
            )
    collisions = getattr(case.output, f"{what}_collisions")
    if collisions is not None:
        one, per_disk = 2.0 / gas.n, 2.0 * estimate.collisions / gas.n
        least = one if math.isnan(per_disk) else max(one, per_disk / MOST_FRAMES)
        if collisions < least * (1.0 - 1e-9):
            text = f"more than {many} in {per_disk:.4g} collisions per disk"
            if least == one:
                text = f"more often than one collision of {gas.n} disks"
            yield f"{what}_collisions", collisions, f"must be {least:.3g} or more: otherwise {text}"


def _length(gas: CaseGas, estimate: RunEstimate) -> tuple[float, str]:
    """A time [time] that the run lasts at least, and what it is; nan where the case names none."""
    case = gas.case
    if case.run.t_end is not None:
        return case.run.t_end - gas.begin[0], "the length of the run"
    if not math.isnan(estimate.end_time):
        return estimate.end_time - gas.begin[0], "the length of the run by kinetic theory"
    times = [1.0 / rate for rate in estimate.collision_rate if rate > 0.0]
    times += [each.summary.radius.low / each.speed_rms for each in gas.species if each.speed_rms > 0.0]
    times += [each.interval for each in case.force]
    return (min(times), "the shortest time that the case names") if times else (math.nan, "")


def refuse_beyond_disk(needed: int, folder: Path) -> None:
    """Raise InputError if a trajectory of `needed` bytes does not fit on the disk of its folder."""
    free = shutil.disk_usage(folder).free
    if needed > free:
        place = f"{size(free)} are free in {folder.resolve()}"
        fewer = f"fewer output.frames or output.fields, or another place ({option_name('-o', 'output')})"
        raise InputError(f"output: the trajectory requires about {size(needed)}, and {place}: {fewer}")


REFUSED_HERE = "`ifrdem run` would refuse it here"
"""End of warnings about this machine; another one may be able to run the case."""


def refused_here(
    gas: CaseGas,
    estimate: RunEstimate,
    folder: Path,
    *,
    share: float = 1.0,
    ranks: int = 1,
    sliced: bool = False,
) -> list[str]:
    """Texts on missing resources of this machine: the device, threads, memory, space in the output's folder.

    Other machines may have it. `share`, `ranks` and `sliced` are as for `refuse_beyond_memory`.
    """
    start = strip_bytes(gas, ranks) * min(share * ranks, starts.strips(gas)) if ranks > 1 else 0.0
    run, found, walled = gas.case.run, [], bool(gas.free_area.all_walls)
    needs: list[Callable[[], None]] = [
        lambda: runtime.check(run.runtime, "run.runtime"),
        lambda: backend.check(run.made_device()),
        lambda: checks.check_number(gas.n, ranks, low_memory=run.low_memory),
        lambda: refuse_beyond_memory(
            gas.n,
            run.device,
            gas.case.start.positions,
            share,
            ranks=ranks,
            sliced=sliced,
            start=start,
            low_memory=run.low_memory,
            layered=not walled and split_of(gas.kinds.radius) is not None,
            writer=estimate.writer_bytes_per_disk(gas.case),
            process=(PROCESS_BYTES + KEPT_BYTES) * max(round(share * ranks), 1),
        ),
        lambda: refuse_beyond_disk(estimate.file_bytes, folder),
    ]
    if run.device != "cpu" and backend.cuda_absence() is not None:
        del needs[3]
    for need in needs:
        try:
            need()
        except InputError as error:
            found.append(str(error))
    return found


def refuse_beyond_memory(
    n: int,
    arch: str,
    positions: str = "random",
    share: float = 1.0,
    *,
    ranks: int = 1,
    sliced: bool = False,
    start: float = 0.0,
    low_memory: bool = False,
    layered: bool = False,
    writer: int = WRITER_BYTES_PER_DISK,
    process: int = 0,
) -> None:
    """Raise InputError if n disks need more memory than is free, or than a GPU has.

    `positions` is start.positions: growth needs more. Of several `ranks`, with a GPU each, a `share` is on this
    machine, with the first one, which has all disks, unless each makes its own ones (`sliced`); where they place them
    at random, in so much memory (`start`, [bytes]) here. `layered` gases have two layers of cells. Frames take so much
    memory of the `writer` for each disk [bytes], once the start is made; processes here take as much without disks.
    """
    per_disk = bytes_per_disk(low_memory)
    if arch != "cpu":
        memory = backend.gpu_memory()
        scratch = LAYERED_SCRATCH if layered else GPU_SCRATCH
        most = int((memory - scratch) / (per_disk + GPU_BYTES_PER_DISK))
        if layered:
            most = max(most, int(memory / LAYERED_BYTES_OF_FEW))
        if n > ranks * most:
            have = f"{ranks} GPUs have {size(memory)} of memory each" if ranks > 1 else ""
            have = have or f"the GPU has {size(memory)} of memory"
            raise InputError(f"{n} disks: {have}, in which {ranks * most} fit")
    host = GROWTH_BYTES_PER_DISK if positions == GROWN else START_BYTES_PER_DISK
    engine = per_disk if arch == "cpu" else 0
    here = share * n if sliced else n
    placing = start if sliced and start else here * host
    of_disks = int(max(placing, here * writer) + share * n * engine)
    free = backend.memory_available()
    if free is not None and process + of_disks > free:
        both = f"some {size(process + of_disks)} of memory, and {size(free)} are free"
        raise InputError(f"{n} disks need {both}: {n * max(free - process, 0) // of_disks} would fit")


def summary(gas: CaseGas, estimate: RunEstimate, device: str) -> str:
    """The lines that stand above a run: what will run, on what, and how many collisions are expected."""
    case = gas.case
    if gas.box.is_open:
        where = " in an open box"
    else:
        paths = [path for path in estimate.free_path if not math.isnan(path)]
        ends = " to ".join(f"{path:.4g}" for path in dict.fromkeys((min(paths), max(paths)))) if paths else ""
        path = f"mean free path {ends}{case.unit('length')}" if paths else no_path(gas)
        where = f", packing fraction{gas.free_area.name} {estimate.packing_fraction:.4g}, {path}"
    return f"{case.run.name}: {gas.n} disks{where}\n{clock(gas, estimate)}\non {device}"


def size(count: float) -> str:
    """A number of bytes, to three digits: 1.23 MB."""
    value = float(count)
    for unit in ("bytes", "kB", "MB", "GB"):
        if value < 999.5:
            return f"{value:.3g} {unit}"
        value /= 1000.0
    return f"{value:.3g} TB"


def no_path(gas: CaseGas) -> str:
    """Reason why disks have no mean free path."""
    return "nothing moves at the start" if gas.n > 1 else "one disk alone never collides"


def clock(gas: CaseGas, estimate: RunEstimate) -> str:
    """Begin and end of a run on its clock, and the collisions that are expected between."""
    case, (begin, before) = gas.case, gas.begin
    already = f", after {2.0 * before / gas.n:.4g} collisions per disk" if before else ""
    text = f"from t = {begin:g}{case.unit('time')}{already}, " if begin or before else ""
    return f"{text}to {_end(case, estimate)}"


def _end(case: CaseSections, estimate: RunEstimate) -> str:
    """End of a run, and the collisions that are expected until then."""
    known = f"{estimate.collisions_are} {estimate.collisions:.4g}".lstrip()
    known = "an unknown number of" if math.isnan(estimate.collisions) else known
    time = case.unit("time")
    if case.run.t_end is not None:
        by_rate = ", by the rate at the start" if estimate.collisions_are == "about" else ""
        return f"t = {case.run.t_end:g}{time}: {known} collisions{by_rate}"
    end = f", t = {estimate.end_time:.4g}{time} if it stayed homogeneous (kinetic theory)"
    per_disk = f"{case.run.collisions_per_disk:g} collisions per disk: {known} collisions"
    return per_disk + ("" if math.isnan(estimate.end_time) else end)
