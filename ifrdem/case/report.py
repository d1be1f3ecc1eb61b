"""The report on a case before it runs, as a table of quantities: `ifrdem check`, and `Case.check` in Python."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..kernels.columns import most_disks
from ..model.box import describe_sides
from ..model.density import packing_fraction
from ..model.laws.law import CollisionLaw
from ..model.laws.records import LAWS, to_record
from ..model.laws.sampling import PAIRS, is_sampled
from ..model.walls.wall import Wall
from ..mpi.distribution import GATHERED
from ..quantities import OBSERVABLES
from ..simulation import backend
from ..tools.progress import size_of_time
from . import checks, notices, starts
from .case import GROWN, CaseSections, ForceSection, KicksAtRandomTimes, SteppedForce
from .estimate import (
    COST_OF_RATIO,
    ENDS_WINDOW,
    RESTING,
    RankPlan,
    RunEstimate,
    cost_of_ratio,
    disk_bytes,
    run_seconds,
    shortest_free_time,
    step_seconds,
)
from .exclusions import may_rest
from .gas import CaseGas
from .laws_section import LawSection, MaterialSection, PairSection
from .rules import NOT_GROWN_ON_RANKS
from .species import Spread
from .summary import COMPILING, REFUSED_HERE, clock, no_path, refuse_cadences, refused_here, size

DILUTE = 1e-3
"""Packing fraction below which crossings of cells cost more than ten times what they do at 0.1."""


class ReportRow(NamedTuple):
    """A row of the table: a quantity, its value, and its unit ("" for a pure number or a text)."""

    quantity: str
    value: str
    unit: str = ""


@dataclass(frozen=True)
class Report:
    """Report on a case before it runs: quantities with values and units; `print` shows it as a table."""

    title: str
    rows: tuple[ReportRow, ...]
    warnings: tuple[str, ...] = ()
    """Warnings: possible problems of the run."""

    @property
    def text(self) -> str:
        """The title and the table."""
        rows = (ReportRow("quantity", "value", "unit"), *self.rows)
        names = max(len(each.quantity) for each in rows)
        values = max(len(each.value) for each in rows if each.unit)
        return "\n".join((self.title, *(f"  {a:<{names}}  {b:<{values}}  {c}".rstrip() for a, b, c in rows)))

    def __str__(self) -> str:
        return "\n".join((self.text, *(f"warning: {each}" for each in self.warnings)))

    __repr__ = __str__


def check(gas: CaseGas, folder: Path, *, share: float = 1.0, ranks: int = 1, sliced: bool = False) -> Report:
    """The report on a case, with warnings of what may go wrong; a small start is made, as a run does.

    `folder` is that of the output; other arguments are as for `refused_here`. InputError if no run could begin.
    """
    estimate = RunEstimate.of(gas)
    refuse_cadences(gas, estimate)
    pinches = notices.wall_pinch_warnings(gas)
    of_laws = checks.verify_laws(gas)
    if ranks == 1:
        starts.verify_start(gas)
    here = refused_here(gas, estimate, folder, share=share, ranks=ranks, sliced=sliced)
    return report(
        gas,
        estimate,
        (*of_laws, *pinches, *notices.notices(gas), *(f"{each}: {REFUSED_HERE}" for each in here)),
    )


def report(gas: CaseGas, estimate: RunEstimate, warnings: tuple[str, ...] = ()) -> Report:
    """Report on a case before it runs, and its warnings."""
    units = Units(gas.case)
    rows = [
        *_density(gas, estimate, units), *_species(gas, estimate, units), *_laws(gas, units), *_gravity(gas, units),
        *_walls(gas, estimate, units), *_collapse(gas, units), *_forces(gas.case, estimate, units),
        *_needs(gas, estimate), *_time(gas, estimate),
    ]  # fmt: skip
    return Report(_title(gas, units), tuple(rows), warnings)


class Units:
    """Units of a case as they stand in the table; "" in reduced units."""

    def __init__(self, case: CaseSections) -> None:
        length, mass, time, energy = (
            case.unit(each).strip() for each in ("length", "mass", "time", "energy")
        )
        self.length, self.mass, self.time, self.energy = length, mass, time, energy
        self.speed = f"{length}/{time}" if length else ""
        self.rate = f"1/{time}" if time else ""
        self.acceleration = f"{length}/{time}^2" if length else ""
        self.angular = f"rad/{time}" if time else ""
        self.density = f"1/{length}^2" if length else ""
        self.area = f"{length}^2" if length else ""


def _title(gas: CaseGas, units: Units) -> str:
    case, region = gas.case, gas.start_region
    sides = (
        "" if region is None else f"{region.lengths[0]:.5g} x {region.lengths[1]:.5g} {units.length}".rstrip()
    )
    if gas.box.is_open:
        box = "an open box"
    elif all(gas.box.periodic):
        rate = (
            f", sheared at the rate {gas.box.shear_rate:g} {units.rate}".rstrip()
            if gas.box.shear_rate
            else ""
        )
        box = f"a periodic box of {sides}{rate}"
    else:
        box = f"a box of {sides}, {describe_sides(gas.box)}"
    return f"{case.run.name}: {gas.n} disks in {box}, {case.run.units} units"


def _density(gas: CaseGas, estimate: RunEstimate, units: Units) -> Iterator[ReportRow]:
    region = gas.start_region
    if not gas.box.is_open:
        yield ReportRow(f"packing fraction{gas.free_area.name}", f"{estimate.packing_fraction:.5g}")
        yield ReportRow("number density", f"{estimate.number_density:.5g}", units.density)
    elif region is not None:
        sides = f"{region.lengths[0]:.5g} x {region.lengths[1]:.5g}"
        yield ReportRow("rectangle of the start", sides, units.length)
        yield ReportRow("packing fraction there", f"{packing_fraction(gas.kinds.covered, region.area):.5g}")
    radius = Spread(
        float(gas.kinds.radius.min()), float(gas.kinds.radius.max()), float(gas.kinds.mean_radius)
    )
    if radius.low < radius.high:
        ratio = radius.high / radius.low
        yield ReportRow("radii", _span(radius), units.length)
        yield ReportRow("largest / smallest radius", f"{ratio:.4g}")
        yield ReportRow("time of a collision, relative to equal disks", f"about {_cost(ratio)}")


def _species(gas: CaseGas, estimate: RunEstimate, units: Units) -> Iterator[ReportRow]:
    for each, rate, path in zip(gas.species, estimate.collision_rate, estimate.free_path, strict=True):
        name = each.name
        yield ReportRow(f"{name}: disks", f"{each.number} of {each.material}")
        yield ReportRow(f"{name}: mass", _span(each.summary.mass), units.mass)
        yield ReportRow(f"{name}: radius", _span(each.summary.radius), units.length)
        yield ReportRow(f"{name}: k in m R^2 / k", f"{each.k:g}")
        yield ReportRow(f"{name}: rms speed at the start", f"{each.speed_rms:.4g}", units.speed)
        if rate > 0.0:
            diameters = path / (2.0 * each.summary.radius.mean)
            yield ReportRow(f"{name}: mean free path at the start", f"{path:.4g}", units.length)
            yield ReportRow(f"{name}: mean free path in diameters", f"{diameters:.3g}")
            yield ReportRow(f"{name}: mean free time at the start", f"{1.0 / rate:.4g}", units.time)
        elif not gas.box.is_open:
            yield ReportRow(f"{name}: mean free path at the start", f"none: {no_path(gas)}")


def _laws(gas: CaseGas, units: Units) -> Iterator[ReportRow]:
    for verdict in gas.verdicts:
        law = verdict.law
        assert law is not None  # a gas has no refused pairs
        text = "strictly admissible" if verdict.strict else "admissible by the total energy budget only"
        if is_sampled(type(law)):
            text = f"custom, tried on {PAIRS} random pairs"
        section = _section(gas.case, verdict.key)
        errors = {} if section is None else section.errors or {}
        values = (
            f"{key} = {value if isinstance(value, str) else f'{value:g}'}"
            + (f" +- {errors[key]:g}" if key in errors else "")
            for key, value in _values(section, law).items()
        )
        text += f" ({', '.join(values)})"
        yield ReportRow(f"law of {verdict.first}, {verdict.second}", text)
        if not verdict.strict:
            yield ReportRow("", verdict.message)
    for verdict, g_n, m_n, R in checks.approach_speeds(gas):
        if verdict.law is not None and verdict.law.depends_on_speed and g_n > 0.0:
            e_n = float(verdict.law.restitutions(g_n, m_n, R))
            name = f"e_n of {verdict.first}, {verdict.second} at the mean approach speed at the start"
            yield ReportRow(name, f"{e_n:.4g} at {g_n:.4g}", units.speed)


def _section(case: CaseSections, key: str) -> LawSection | None:
    """The section that gives a law, "material[0]"; None of one by the names of coins."""
    found = re.fullmatch(r"(material|pair)\[(\d+)\]", key)
    return getattr(case, found[1])[int(found[2])] if found else None


def _values(section: LawSection | None, law: CollisionLaw) -> dict[str, Any]:
    """Name and arguments of a law, as the section that gives it has them."""
    named = None if section is None else LAWS.get(section.law)
    if section is not None and (named is None or named.make is not named.kind):
        # From a file, or another name for a law.
        others = {*MaterialSection.model_fields, *PairSection.model_fields, "law"}
        return {"law": section.law} | section.model_dump(exclude=others, exclude_none=True)
    return to_record(law)


def _gravity(gas: CaseGas, units: Units) -> Iterator[ReportRow]:
    box, g = gas.case.box, math.hypot(*gas.case.box.gravity)
    if g > 0.0:
        lifting = _mean_mass(gas) * g * 2.0 * gas.kinds.mean_radius
        yield ReportRow("gravity", f"({box.gravity[0]:g}, {box.gravity[1]:g})", units.acceleration)
        yield ReportRow("energy to lift a mean disk by one diameter", f"{lifting:.4g}", units.energy)
    if box.gravity_rotation_rate:
        yield ReportRow("rotation of gravity", f"{box.gravity_rotation_rate:g}", units.angular)
        yield ReportRow("step of the rotation", f"{box.gravity_rotation_step:g}", "rad")
        yield ReportRow("Froude number of such a drum", f"{notices.drum(gas):.3g}")


def _walls(gas: CaseGas, estimate: RunEstimate, units: Units) -> Iterator[ReportRow]:
    case, g, mass = gas.case, math.hypot(*gas.case.box.gravity), _mean_mass(gas)
    if gas.free_area.all_walls:
        yield ReportRow("free area, to which densities refer", f"{gas.free_area.area():.5g}", units.area)
        yield ReportRow("part of the box", f"{100.0 * gas.free_area.area() / gas.box.area:.4g}", "%")
    if case.box.material is not None:
        walled = [axis for axis, periodic in zip("xy", case.box.periodic, strict=True) if not periodic]
        yield ReportRow("sides", f"walls of {case.box.material} across {' and '.join(walled)}")
    for i, (section, wall) in enumerate(zip(case.wall, gas.walls, strict=True)):
        name = f"wall {i}"
        sides = f" of {len(wall.geometry.outline()) - 1} sides" if wall.points else ""
        made = f"of {section.material}" if section.temperature is None else "thermal"
        yield ReportRow(name, f"{wall.shape}{sides}, {made}")
        if section.temperature is not None:
            yield ReportRow(f"{name}: temperature", f"{section.temperature:.4g}", units.energy)
        if wall.surface_speed:
            yield ReportRow(f"{name}: speed of the surface", f"{wall.surface_speed:g}", units.speed)
        yield from _motion(name, wall, g, mass, units)
        if wall.piston is not None:
            yield ReportRow(
                f"{name}: mass of the piston / mean mass of disks", f"{wall.piston.mass / mass:.4g}"
            )
        if wall.opens_at is not None:
            yield ReportRow(f"{name}: opens at t", f"{wall.opens_at:g}", units.time)
        if wall.opens_after is not None:
            yield ReportRow(f"{name}: opens after", f"{wall.opens_after}", "collisions")
    if estimate.wall_collisions > 0.0:
        quantity = "estimated wall collision rate (homogeneous, Maxwellian)"
        yield ReportRow(quantity, f"{estimate.wall_collisions:.3g}", units.rate or "per unit time")


def _motion(name: str, wall: Wall, g: float, mass: float, units: Units) -> Iterator[ReportRow]:
    """The motion of a wall, and the energy that it can give."""
    motion, turn = wall.motion, wall.turn
    if motion.kind != "still":
        yield ReportRow(f"{name}: motion", motion.kind)
        if motion.kind != "steady":
            yield ReportRow(f"{name}: amplitude", f"{motion.amplitude:g}", units.length)
            yield ReportRow(f"{name}: frequency", f"{motion.frequency:g}", units.rate)
        yield ReportRow(f"{name}: largest speed", f"{motion.most_speed:.4g}", units.speed)
        energy = 0.5 * mass * motion.most_speed**2
        yield ReportRow(f"{name}: energy of a mean disk at that speed", f"{energy:.4g}", units.energy)
        if motion.kind == "sine" and g > 0.0:
            peak = motion.amplitude * (2.0 * np.pi * motion.frequency) ** 2
            yield ReportRow(f"{name}: largest acceleration", f"{peak / g:.4g}", "g")
    if turn.kind != "still":
        yield ReportRow(f"{name}: rotation", turn.kind)
        yield ReportRow(
            f"{name}: largest speed of its end", f"{turn.most_rate * wall.lever:.4g}", units.speed
        )


def _collapse(gas: CaseGas, units: Units) -> Iterator[ReportRow]:
    run = gas.case.run
    if run.velocity_cutoff is not None:
        yield ReportRow("collisions slower than this are elastic", f"{run.velocity_cutoff:g}", units.speed)
    elif run.contact_time is not None:
        yield ReportRow("collisions sooner after another are elastic", f"{run.contact_time:g}", units.time)
    elif run.resting_speed is not None:
        yield ReportRow("contacts slower than this last", f"{run.resting_speed:g}", units.speed)
    elif (
        any(gas.case.box.gravity)
        and gas.free_area.all_walls
        and any(each.law and each.law.is_dissipative for each in gas.verdicts)
    ):
        remedies = '"velocity_cutoff" or "contact_time"'
        if may_rest(gas.case):
            stand = all(wall.supports_rest for wall in gas.walls)
            remedies = '"rest"' if stand else f'{remedies}, or "rest" on walls that stand'
        text = f"no remedy: disks that come to rest on others end the run; set run.collapse = {remedies}"
        yield ReportRow("collapse", text)


def _when(case: CaseSections, force: ForceSection) -> str:
    """Text that says whether a force acts within windows, and why not (`simulation/steps/force_steps.py`)."""
    if isinstance(force, KicksAtRandomTimes):
        return "within windows, on each disk at random times"
    if force.kind == ENDS_WINDOW:
        return "between windows, because it needs sums over all disks"
    if any(each.kind == ENDS_WINDOW and each.interval == force.interval for each in case.force):
        return f"between windows, at the times of {ENDS_WINDOW}"
    return "within windows"


def _forces(case: CaseSections, estimate: RunEstimate, units: Units) -> Iterator[ReportRow]:
    """Rows on each force, and the steady state that theory expects."""
    free_time = shortest_free_time(estimate.collision_rate)
    for i, force in enumerate(case.force):
        stepped = isinstance(force, SteppedForce)
        given = force.model_dump(exclude={"kind", "step" if stepped else "rate"}, exclude_none=True)
        values = ", ".join(f"{key} = {value:g}" for key, value in given.items())
        yield ReportRow(f"force {i}", f"{force.kind} ({values})")
        name = "step" if stepped else "mean time between two kicks of a disk"
        yield ReportRow(f"force {i}: {name}", f"{force.interval:g}", units.time)
        yield ReportRow(f"force {i}: acts", _when(case, force))
        if part := force.interval / free_time:
            short = "step" if stepped else "mean time"
            yield ReportRow(f"force {i}: {short} / shortest mean free time at the start", f"{part:.3g}")
    if estimate.steady_state is not None:
        T, T_rot = estimate.steady_state
        yield ReportRow("steady state by kinetic theory: T", f"{T:.4g}", units.energy)
        if not math.isnan(T_rot):
            yield ReportRow("steady state by kinetic theory: T_rot", f"{T_rot:.4g}", units.energy)


def _needs(gas: CaseGas, estimate: RunEstimate) -> Iterator[ReportRow]:
    case = gas.case
    yield ReportRow("run", clock(gas, estimate))
    yield ReportRow(
        "trajectory file (all frames and series)",
        f"{size(estimate.file_bytes)}{_without_histories(estimate)}, {case.run.name}.h5",
    )
    yield ReportRow("content of the trajectory file", _stored(gas, estimate))
    if case.output.in_parts(gas.n, ranks=2):
        on_ranks = "" if case.output.parts is True else "on several ranks of MPI, "
        yield ReportRow("", f"{on_ranks}its fields in {case.run.name}.parts, a file for each rank")
    per_disk = estimate.array_bytes // max(gas.n, 1)
    engine = f"{size(estimate.array_bytes)} ({gas.n} disks x {per_disk} bytes)"
    yield ReportRow("memory (engine only, without Python and libraries)", engine)
    if case.run.device == "cpu":
        yield ReportRow(
            "largest memory of the process, with its start", f"about {size(estimate.peak_bytes(gas))}"
        )


def _time(gas: CaseGas, estimate: RunEstimate) -> Iterator[ReportRow]:
    """Rows on the time that a run takes on a CPU, and why it is long."""
    n, phi, run = gas.n, estimate.packing_fraction, gas.case.run
    if run.device == "cpu":
        yield from _cpu_time(gas, estimate, run.threads or backend.cores())
    if run.device != "cpu" or not phi > 0.0:
        return
    if estimate.collisions > 0.0 and phi < DILUTE:
        text = "disks of so thin a gas mostly pass from cell to cell: a collision costs phi^(-1/2)"
        yield ReportRow("", text)
    if n > GATHERED:
        for ranks in planned_ranks(n, most_disks(run.low_memory)):
            yield ReportRow(
                f"on {ranks} ranks of MPI, each (estimate)", _planned(RankPlan.of(gas, estimate, ranks))
            )
        if gas.case.start.positions == GROWN and gas.case.start.file is None:
            yield ReportRow("", f'start.positions = "{GROWN}" {NOT_GROWN_ON_RANKS}')


def _cpu_time(gas: CaseGas, estimate: RunEstimate, threads: int) -> Iterator[ReportRow]:
    """Rows on the time of the run, and what it includes, and on the speed."""
    n, phi, forces = gas.n, estimate.packing_fraction, bool(gas.case.force)
    seconds = estimate.seconds(gas, threads)
    unknown_number = math.isnan(estimate.collisions)
    if not forces and (unknown_number or math.isnan(seconds)):
        unknown = "number of collisions" if unknown_number else "time at the end"
        yield ReportRow("run time", f"not estimated: the {unknown} is not known")
    if estimate.collisions > 0.0 or forces:
        known = not math.isnan(seconds)
        collisions = not math.isnan(estimate.collisions)
        includes = ["start"] + ["collisions"] * collisions + ["force steps"] * forces
        includes += ["windows", "frames", "output"]
        name = f"run time ({', '.join(includes[:-1])} and {includes[-1]})"
        most = "at most " if forces and all(each.kind == RESTING for each in gas.case.force) else ""
        if known and (collisions or forces):
            yield ReportRow(name, f"{most or 'about '}{size_of_time(seconds)}")
            yield ReportRow("compilation of kernels, before the run", COMPILING)
        elif forces:
            steps = {kind: dict.fromkeys(given, 1.0) for kind, given in estimate.force_steps.items()}
            seconds = 1e3 * step_seconds(steps, n, threads)
            yield ReportRow(
                "run time of a force step",
                f"about {seconds:.2g} for each step until the end",
                "ms",
            )
    if phi > 0.0:
        rate = 1e6 / run_seconds(1e6, n, phi, threads)
        yield ReportRow(
            "collisions per second of the engine alone",
            f"about {rate:.2g}; `ifrdem bench --n {n} --phi {phi:.2g}` measures it here",
        )


def planned_ranks(n: int, most: int) -> list[int]:
    """Numbers of ranks to plan for: as few as hold n disks, `most` on each, then 16, 4 and 1 million on each."""
    return sorted({max(math.ceil(n / each), 2) for each in (most, 16e6, 4e6, 1e6)})


def _planned(plan: RankPlan) -> str:
    time = "" if math.isnan(plan.seconds) else f", about {size_of_time(plan.seconds)}"
    text = f"{plan.disks:.3g} disks, {size(plan.memory)} of memory, {size(plan.file)} of files{time}"
    return f"{text}, with one thread"


def _without_histories(estimate: RunEstimate) -> str:
    """Words behind a size that counts no events of tracked disks, because nobody knows how many there will be."""
    return " without histories" * (estimate.tracked > 0 and math.isnan(estimate.collisions))


def _stored(gas: CaseGas, estimate: RunEstimate) -> str:
    """Content of the trajectory file."""
    output = gas.case.output
    text = (
        f"{estimate.frames} frames x ({gas.n} disks x {disk_bytes(output)} bytes + {len(OBSERVABLES)} totals)"
    )
    text += f", {'' if gas.case.series_cadence.exact else 'up to '}{estimate.rows} rows of series"
    if estimate.tracked:
        text += f", histories of {estimate.tracked} disk{'s' * (estimate.tracked != 1)}"
    if output.compression != "none":
        text += f"; {output.compression} makes it smaller"
    if output.compression == "zstd":
        text += "; what reads it requires the package hdf5plugin (ParaView, VMD and others: a plugin of HDF5)"
    return text


def _mean_mass(gas: CaseGas) -> float:
    return sum(each.number * each.summary.mass.mean for each in gas.species) / gas.n


def _span(values: Spread) -> str:
    """One number for equal values, else their ends and mean."""
    low, high, mean = values
    return f"{low:.5g}" if low == high else f"{low:.5g} to {high:.5g} (mean {mean:.5g})"


def _cost(ratio: float) -> str:
    """Cost of a size ratio, by `COST_OF_RATIO`."""
    return f"{cost_of_ratio(ratio):.2g}{' or more' if ratio > max(COST_OF_RATIO) else ''}"
