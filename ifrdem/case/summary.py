"""Report of a case that is in order, for `ifrdem check` and for the beginning of `ifrdem run`."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError, refuse
from ..kernels.columns import BYTES_PER_DISK
from ..model.box import describe_sides
from ..model.walls import Wall
from ..mpi.distribution import GATHERED
from ..simulation import backend, checks
from ..tools.progress import size_of_time
from .case import GROWN, Case
from .estimate import (
    GROWTH_BYTES_PER_DISK,
    HOST_BYTES_PER_DISK,
    OBSERVABLES,
    RankPlan,
    RunEstimate,
    disk_bytes,
    run_seconds,
    strip_bytes,
)
from .gas import CaseGas
from .objects import device_of
from .output_section import MOST_FRAMES
from .rules import NOT_GROWN_ON_RANKS
from .species import Spread

WRITER_BYTES_PER_DISK = 200
"""Frames that are being told, wait or are written.

A run of 2e6 disks took 750 bytes for each more than one of 2e5, engine and all."""
GPU_BYTES_PER_DISK, GPU_SCRATCH, GPU_BYTES_OF_FEW = 330, 9_000_000_000, 2500
"""State and claims of a disk on a GPU; scratch space of the tiles that run at the same time; all of it, if few do."""

THIN = 1e-3
"""Packing fraction below which crossings of cells cost more than ten times what they do at 0.1."""

COST_OF_RATIO: Mapping[float, float] = {
    1.0: 1.0, 2.0: 1.4, 5.0: 2.1, 10.0: 2.4, 20.0: 3.4, 50.0: 5.4,
}  # fmt: skip
"""Processor time of a collision, relative to equal disks, by the ratio of the largest to the smallest radius.

Measured 2026-11-23: 10,000 elastic disks of two sizes with equal areas, phi = 0.5, one thread
(`results/size_ratio.md`). Among walls there is one layer of cells only, and the cost is higher from a ratio of 5 on."""


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
            yield f"{what}_interval", interval, f"{text}: {length / MOST_FRAMES:.3g} or more is needed"
    collisions = getattr(case.output, f"{what}_collisions")
    if collisions is not None:
        one, per_disk = 2.0 / gas.n, 2.0 * estimate.collisions / gas.n
        least = one if math.isnan(per_disk) else max(one, per_disk / MOST_FRAMES)
        if collisions < least * (1.0 - 1e-9):
            text = f"more than {many} in {per_disk:.4g} collisions per disk"
            if least == one:
                text = f"more often than one collision of {gas.n} disks"
            yield f"{what}_collisions", collisions, f"{text}: {least:.3g} or more is needed"


def _length(gas: CaseGas, estimate: RunEstimate) -> tuple[float, str]:
    """A time [time] that the run lasts at least, and what it is; nan where the case names none."""
    case = gas.case
    if case.run.t_end is not None:
        return case.run.t_end - gas.begin[0], "the length of the run"
    if not math.isnan(estimate.end_time):
        return estimate.end_time - gas.begin[0], "the length of the run by kinetic theory"
    times = [1.0 / rate for rate in estimate.collision_rate if rate > 0.0]
    times += [each.summary.radius.low / each.speed_rms for each in gas.species if each.speed_rms > 0.0]
    times += [each.step for each in case.force]
    return (min(times), "the shortest time that the case names") if times else (math.nan, "")


def refuse_beyond_disk(needed: int, folder: Path) -> None:
    """Raise InputError if a trajectory of `needed` bytes does not fit on the disk of its folder."""
    free = shutil.disk_usage(folder).free
    if needed > free:
        place = f"{size(free)} are free in {folder.resolve()}"
        fewer = "fewer output.frames or output.fields, or another place (-o)"
        raise InputError(f"output: the trajectory needs some {size(needed)}, and {place}: {fewer}")


REFUSED_HERE = "`ifrdem run` would refuse it here"
"""End of warnings about this machine; another one may be able to run the case."""


@dataclass(frozen=True)
class Report:
    """What can be said of a case before it runs; `print` shows it."""

    text: str
    """Quantities with their units, a line each."""
    warnings: tuple[str, ...] = ()
    """What may go wrong."""

    def __str__(self) -> str:
        return "\n".join((self.text, *(f"warning: {each}" for each in self.warnings)))

    __repr__ = __str__


def check(gas: CaseGas, folder: Path, *, share: float = 1.0, ranks: int = 1, sliced: bool = False) -> Report:
    """The report on a case, with warnings of what may go wrong; a small start is made, as a run does.

    `folder` is that of the output; other arguments are as for `refused_here`. InputError if no run could begin.
    """
    estimate = RunEstimate.of(gas)
    refuse_cadences(gas, estimate)
    crushes = gas.wall_pinch_warnings()
    if ranks == 1:
        gas.try_start()
    here = refused_here(gas, estimate, folder, share=share, ranks=ranks, sliced=sliced)
    warned = (*crushes, *gas.cautions, *(f"{each}: {REFUSED_HERE}" for each in here))
    return Report(report(gas, estimate), warned)


def refused_here(
    gas: CaseGas,
    estimate: RunEstimate,
    folder: Path,
    *,
    share: float = 1.0,
    ranks: int = 1,
    sliced: bool = False,
) -> list[str]:
    """Texts on what a run lacks on this machine: the device, threads, memory, space in the output's folder.

    Other machines may have it. `share`, `ranks` and `sliced` are as for `refuse_beyond_memory`.
    """
    start = strip_bytes(gas, ranks) * min(share * ranks, gas.strips) if ranks > 1 else 0.0
    run, found = gas.case.run, []
    needs: list[Callable[[], None]] = [
        lambda: backend.check(device_of(run)),
        lambda: checks.check_number(gas.n, ranks),
        lambda: refuse_beyond_memory(
            gas.n, run.device, gas.case.start.positions, share, ranks=ranks, sliced=sliced, start=start
        ),
        lambda: refuse_beyond_disk(estimate.file_bytes, folder),
    ]
    if run.device != "cpu" and backend.cuda_absence() is not None:
        del needs[2]
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
) -> None:
    """Raise InputError if n disks need more memory than is free, or than a GPU has.

    `positions` is start.positions: growth needs more. Of several `ranks`, with a GPU each, a `share` is on this
    machine, with the first one, which has all disks, unless each makes its own ones (`sliced`); where they place them
    at random, in so much memory (`start`, [bytes]) here.
    """
    if arch != "cpu":
        memory = backend.gpu_memory()
        most = int(max((memory - GPU_SCRATCH) / GPU_BYTES_PER_DISK, memory / GPU_BYTES_OF_FEW))
        if n > ranks * most:
            have = f"{ranks} GPUs have {size(memory)} of memory each" if ranks > 1 else ""
            have = have or f"the GPU has {size(memory)} of memory"
            raise InputError(f"{n} disks: {have}, in which {ranks * most} fit")
    host = GROWTH_BYTES_PER_DISK if positions == GROWN else HOST_BYTES_PER_DISK
    engine = BYTES_PER_DISK if arch == "cpu" else 0
    here = share * n if sliced else n
    placing = start if sliced and start else here * host
    needed = int(placing + here * WRITER_BYTES_PER_DISK + share * n * engine)
    free = backend.memory_available()
    if free is not None and needed > free:
        both = f"some {size(needed)} of memory, and {size(free)} are free"
        raise InputError(f"{n} disks need {both}: {n * free // needed} would fit")


def summary(gas: CaseGas, estimate: RunEstimate, device: str) -> str:
    """The lines that stand above a run: what will run, on what, and how many collisions are expected."""
    case = gas.case
    if gas.box.is_open:
        where = " in an open box"
    else:
        paths = [path for path in estimate.free_path if not math.isnan(path)]
        ends = " to ".join(f"{path:.4g}" for path in dict.fromkeys((min(paths), max(paths)))) if paths else ""
        path = f"mean free path {ends}{case.unit('length')}" if paths else _no_path(gas)
        where = f", packing fraction {estimate.packing_fraction:.4g}, {path}"
    return f"{case.run.name}: {gas.n} disks{where}\n{_clock(gas, estimate)}\non {device}"


def report(gas: CaseGas, estimate: RunEstimate) -> str:
    """Everything that can be said of a case before it runs."""
    case = gas.case
    length, mass, time = (case.unit(quantity) for quantity in ("length", "mass", "time"))
    lines = _density(gas, estimate)
    radius = Spread(
        float(gas.kinds.radius.min()), float(gas.kinds.radius.max()), float(gas.kinds.mean_radius)
    )
    if radius.low < radius.high:
        ratio = radius.high / radius.low
        lines.append(_row("radii", f"{_span(radius)}{length}, largest/smallest {ratio:.4g}: {_cost(ratio)}"))
    for each, rate, path in zip(gas.species, estimate.collision_rate, estimate.free_path, strict=True):
        text = f"{each.number} of {each.material}: mass {_span(each.summary.mass)}{mass}, "
        text += f"radius {_span(each.summary.radius)}{length}, "
        text += f"k = {each.k:g}, speed {each.speed_rms:.4g}{_per(length, time)} rms"
        lines.append(_row(f"species {each.name}", text))
        if rate > 0.0:
            diameters = path / (2.0 * each.summary.radius.mean)
            text = f"{path:.4g}{length} ({diameters:.3g} diameters), mean free time {1.0 / rate:.4g}{time}"
            lines.append(_row("  mean free path", f"{text}, at the start"))
        elif not gas.box.is_open:
            lines.append(_row("  mean free path", f"none: {_no_path(gas)}"))
    for verdict in gas.verdicts:
        law = verdict.law
        assert law is not None  # a gas has no refused pairs
        text = "strictly admissible" if verdict.strict else "admissible by the total energy budget only"
        text += f" (e_n = {law.e_n:g}, e_t = {law.e_t:g}, mu = {law.mu:g}, {law.sticking}, rho = {law.rho:g})"
        lines.append(_row(f"pair {verdict.first}, {verdict.second}", text))
        if not verdict.strict:
            lines.append(_row("", verdict.message))
    lines += [_row(*each) for each in _walls(gas, estimate)]
    lines += _forces(case, estimate)
    lines.append(_row("run", _clock(gas, estimate)))
    stored = f"{size(estimate.file_bytes)}: {_stored(gas, estimate)}"
    lines.append(_row("file", f"{case.run.name}.h5, {stored}"))
    if case.output.in_parts(gas.n, ranks=2):
        on_ranks = "" if case.output.parts is True else "on several ranks of MPI, "
        lines.append(_row("", f"{on_ranks}its fields in {case.run.name}.parts, a file for each rank"))
    per_disk = estimate.array_bytes // max(gas.n, 1)
    engine = f"{size(estimate.array_bytes)} for the engine ({gas.n} disks x {per_disk} bytes)"
    lines.append(_row("memory", f"{engine}, beside Python, Taichi and their libraries"))
    if case.run.device == "cpu" and estimate.collisions > 0.0 and estimate.packing_fraction > 0.0:
        lines.append(_row("time", _time(gas, estimate)))
    if case.run.device == "cpu" and gas.n > GATHERED and estimate.packing_fraction > 0.0:
        plans = [RankPlan.of(gas, estimate, ranks) for ranks in planned_ranks(gas.n)]
        lines += [_row("on ranks of MPI" if i == 0 else "", _planned(each)) for i, each in enumerate(plans)]
        if case.start.positions == GROWN and case.start.file is None:
            lines.append(_row("", f'start.positions = "{GROWN}" {NOT_GROWN_ON_RANKS}'))
    return "\n".join(lines)


COMPILING = (
    "a second or two if this machine has compiled them before, else about ten seconds, and more with forces or "
    'collapse = "rest", which have kernels of their own'
)


def planned_ranks(n: int) -> list[int]:
    """Numbers of ranks to plan for: some sixteen, four and one million disks on each."""
    return sorted({max(math.ceil(n / each), 2) for each in (16e6, 4e6, 1e6)})


def _planned(plan: RankPlan) -> str:
    time = "" if math.isnan(plan.seconds) else f", some {size_of_time(plan.seconds)}"
    text = f"{plan.ranks}: each {plan.disks:.3g} disks, {size(plan.memory)} of memory, {size(plan.file)} of files{time}"
    return f"{text}, with one thread each"


def _time(gas: CaseGas, estimate: RunEstimate) -> str:
    """Time that a run takes, about, and why it is long."""
    n, phi, threads = gas.n, estimate.packing_fraction, gas.case.run.threads or backend.cores()
    seconds = run_seconds(estimate.computed(n), n, phi, threads)
    rate = 1e6 / run_seconds(1e6, n, phi, threads)
    text = f"some {size_of_time(seconds)} of collisions and frames, at {rate:.2g} collisions/s (`ifrdem bench --n {n} "
    text += f"--phi {phi:.2g}` says what this machine does); before that, kernels are compiled: {COMPILING}"
    if phi < THIN:
        text += (
            ". In a gas so thin disks pass from cell to cell most of the time: a collision costs phi^(-1/2)"
        )
    return text


def _stored(gas: CaseGas, estimate: RunEstimate) -> str:
    """Content of the trajectory file."""
    output = gas.case.output
    text = (
        f"{estimate.frames} frames x ({gas.n} disks x {disk_bytes(output)} bytes + {len(OBSERVABLES)} totals)"
    )
    text += f", {'' if output.series_cadence.exact else 'up to '}{estimate.rows} rows of series"
    if estimate.tracked:
        text += f", histories of {estimate.tracked} disks"
    if output.compression != "none":
        text += f", at most: {output.compression} makes it smaller"
    if output.compression == "zstd":
        text += "; what reads it needs the package hdf5plugin (ParaView, VMD and others: a plugin of HDF5)"
    return text


def _density(gas: CaseGas, estimate: RunEstimate) -> list[str]:
    """Heading of a report on a gas, and how dense it is."""
    case = gas.case
    length, time = case.unit("length"), case.unit("time").strip()
    sides = (
        ""
        if gas.start_region is None
        else f"{gas.start_region.lengths[0]:.5g} x {gas.start_region.lengths[1]:.5g}{length}"
    )
    if gas.box.is_open:
        box = "an open box"
    elif all(gas.box.periodic):
        rate = f", sheared at the rate {gas.box.shear_rate:g}{f' 1/{time}' if time else ''}"
        box = f"a periodic box of {sides}{rate if gas.box.shear_rate else ''}"
    else:
        box = f"a box of {sides}, {describe_sides(gas.box)}"
    lines = [f"{case.run.name}: {gas.n} disks in {box}, {case.run.units} units"]
    if not gas.box.is_open:
        lines.append(_row("packing fraction", f"{estimate.packing_fraction:.5g}"))
        per = f" per{length}^2" if length else ""
        lines.append(_row("number density", f"{estimate.number_density:.5g}{per}"))
    elif gas.start_region is not None:
        start = gas.kinds.covered / gas.start_region.area
        lines.append(_row("start", f"in {sides}, packing fraction {start:.5g} there"))
    return lines


def _forces(case: Case, estimate: RunEstimate) -> list[str]:
    """A line for each force, and the steady state that theory expects."""
    lines = []
    free_times = [1.0 / rate for rate in estimate.collision_rate if rate > 0.0]
    for i, force in enumerate(case.force, start=1):
        given = force.model_dump(exclude={"kind", "step"}, exclude_none=True)
        text = f"{force.kind}: {', '.join(f'{key} = {value:g}' for key, value in given.items())}"
        text += f", every {force.step:g}{case.unit('time')}"
        if free_times:
            text += f" ({force.step / min(free_times):.3g} of the shortest mean free time at the start)"
        lines.append(_row(f"force {i}", text))
    if estimate.steady_state is not None:
        T, T_rot = estimate.steady_state
        spins = "" if math.isnan(T_rot) else f", T_rot = {T_rot:.4g}{case.unit('energy')}"
        lines.append(_row("steady state", f"T = {T:.4g}{case.unit('energy')}{spins}, by kinetic theory"))
    return lines


def _walls(gas: CaseGas, estimate: RunEstimate) -> list[tuple[str, str]]:
    """Name and text of each line; none for a periodic gas without gravity."""
    case = gas.case
    length, time, energy = (case.unit(quantity) for quantity in ("length", "time", "energy"))
    speed, lines = _per(length, time), []
    mass = sum(each.number * each.summary.mass.mean for each in gas.species) / gas.n
    diameter = 2.0 * gas.kinds.mean_radius
    g = math.hypot(*case.box.gravity)
    if g > 0.0:
        x, y = case.box.gravity
        lifted = f"{mass * g * diameter:.4g}{energy} lift the mean disk by its diameter"
        lines.append(("gravity", f"({x:g}, {y:g}){speed}{'^2' if speed else ''}: {lifted}"))
    if case.box.gravity_rotation_rate:
        rate = f"{case.box.gravity_rotation_rate:g}{f' rad/{time.strip()}' if time else ''}"
        text = f"turns at {rate} in steps of {case.box.gravity_rotation_step:g} rad; Froude number of such a drum "
        text += f"{gas.drum:.3g}"
        lines.append(("", text))
    if gas.free_area.all_walls:
        area = f"{gas.free_area.area():.5g}{f'{length}^2' if length else ''}"
        part = gas.free_area.area() / gas.box.area
        lines.append(("free area", f"{area} ({100.0 * part:.4g} % of the box); densities refer to it"))
    if case.box.material is not None:
        walled = [axis for axis, periodic in zip("xy", case.box.periodic, strict=True) if not periodic]
        lines.append(("sides", f"walls of {case.box.material} across {' and '.join(walled)}"))
    for i, (section, wall) in enumerate(zip(case.wall, gas.walls, strict=True)):
        hot = section.temperature
        made = f"of {section.material}" if hot is None else f"thermal, T = {hot:.4g}{energy}"
        surface = f", surface at {wall.surface_speed:g}{speed}" if wall.surface_speed else ""
        motion = "" if section.motion is None else f"; {_motion(case, wall, g, mass)}"
        if section.turn is not None:
            motion += (
                f"; turns ({wall.turn.kind}), up to {wall.turn.most_rate * wall.lever:.4g}{speed} at its end"
            )
        if wall.piston is not None:
            motion += f"; piston, {wall.piston.mass / mass:.4g} times the mass of the mean disk"
        if wall.opens_at is not None:
            motion += f"; opens at t = {wall.opens_at:g}{time}"
        if wall.opens_after is not None:
            motion += f"; opens after {wall.opens_after} collisions"
        sides = f" of {len(wall.geometry.outline()) - 1} sides" if wall.points else ""
        lines.append((f"wall {i}", f"{wall.shape}{sides}, {made}{surface}{motion}"))
    if estimate.wall_hits > 0.0:
        per = f" per{time}" if time else " per unit of time"
        text = f"some {estimate.wall_hits:.3g}{per} at the start, if spread out and Maxwellian"
        lines.append(("wall hits", text))
    slow, brief = case.run.velocity_cutoff, case.run.contact_time
    if case.run.collapse != "none":
        rest = case.run.resting_speed
        what = f"contact time {brief or 0.0:g}{time}" if slow is None else f"velocity cut-off {slow:g}{speed}"
        text = f"{what}: collisions below it are elastic"
        if rest is not None:
            text = f"resting speed {rest:g}{speed}: contacts below it last, and disks fall asleep"
        lines.append(("collapse", text))
    elif (
        g > 0.0
        and gas.free_area.all_walls
        and not all(each.law and each.law.e_n == 1.0 for each in gas.verdicts)
    ):
        ways = '"velocity_cutoff" or "tc"' if any(wall.piston for wall in gas.walls) else '"rest"'
        text = f"no remedy: disks that come to rest on others end the run (run.collapse = {ways} helps)"
        lines.append(("collapse", text))
    return lines


def _per(length: str, time: str) -> str:
    """The unit of speeds."""
    return f"{length}/{time.strip()}" if length else ""


def _motion(case: Case, wall: Wall, g: float, mass: float) -> str:
    """Motion of a wall, and the energy that it can give."""
    motion, fastest = wall.motion, wall.motion.most_speed
    length, time = case.unit("length"), case.unit("time")
    text = f"{motion.kind}, "
    if motion.kind != "steady":
        per = f"/{time.strip()}" if time else ""
        text += f"amplitude {motion.amplitude:g}{length}, frequency {motion.frequency:g}{per}, "
    text += f"up to {fastest:.4g}{_per(length, time)}"
    text += f" (m v^2 / 2 = {0.5 * mass * fastest**2:.4g}{case.unit('energy')} of the mean disk)"
    if motion.kind == "sine" and g > 0.0:
        peak = motion.amplitude * (2.0 * np.pi * motion.frequency) ** 2
        text += f", acceleration up to {peak / g:.4g} g"
    return text


def _span(values: Spread) -> str:
    """One number for equal values, else their ends and mean."""
    low, high, mean = values
    return f"{low:.5g}" if low == high else f"{low:.5g} to {high:.5g} (mean {mean:.5g})"


def _cost(ratio: float) -> str:
    """Cost of a size ratio, by `COST_OF_RATIO`."""
    factor = float(np.interp(math.log(ratio), np.log(list(COST_OF_RATIO)), list(COST_OF_RATIO.values())))
    more = " or more" if ratio > max(COST_OF_RATIO) else ""
    return f"a collision takes some {factor:.2g} times{more} as long as among equal disks"


def size(count: float) -> str:
    """A number of bytes, to three digits: 1.23 MB."""
    value = float(count)
    for unit in ("bytes", "kB", "MB", "GB"):
        if value < 999.5:
            return f"{value:.3g} {unit}"
        value /= 1000.0
    return f"{value:.3g} TB"


def _row(name: str, text: str) -> str:
    return f"  {name:<22} {text}"


def _no_path(gas: CaseGas) -> str:
    """Reason why disks have no mean free path."""
    return "nothing moves at the start" if gas.n > 1 else "one disk alone never collides"


def _clock(gas: CaseGas, estimate: RunEstimate) -> str:
    """Begin and end of a run on its clock, and the collisions that are expected between."""
    case, (begin, before) = gas.case, gas.begin
    already = f", after {2.0 * before / gas.n:.4g} collisions per disk" if before else ""
    text = f"from t = {begin:g}{case.unit('time')}{already}, " if begin or before else ""
    return f"{text}to {_end(case, estimate)}"


def _end(case: Case, estimate: RunEstimate) -> str:
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
