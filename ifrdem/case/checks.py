"""Checks of the gas of a case: what is wrong with it, in words of its keys.

The functions are of a `CaseGas`.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem, outside_level, refuse
from ..initial import impact_scan
from ..model.box import Box
from ..model.laws.ifr import EnergyWarning
from ..model.laws.pairs import MEAN_APPROACH, PairLaws
from ..model.laws.sampling import is_sampled
from ..model.walls.free_area import FreeArea
from ..model.walls.wall import Wall, wall_names
from ..mpi import current, distribution
from ..simulation import backend
from ..simulation.start import checks
from . import exclusions, pair_rules, rules, starts
from .case import IMPACT_SCAN, CaseSections
from .gas import CaseGas
from .pair_rules import PairVerdict
from .species import species_of

T = TypeVar("T")


def validate_case(
    case: CaseSections, folder: Path, *, start: bool = True, ranks: int = 1
) -> tuple[CaseGas, list[Problem]]:
    """Apply every rule to a case: its gas, and all that is wrong; the gas holds as far as nothing is.

    A start file's path begins at `folder`; without `start`, in a run that has started, it is not read. If so
    many `ranks` of MPI read it in slices, they do so later (`with_start`).
    """
    species = species_of(case)
    laws, law_problems = rules.laws_from_files(case, folder)
    verdicts = (*pair_rules.verdicts(case, species, laws), *pair_rules.wall_verdicts(case, species, laws))
    # The engine makes the sides of the first one.
    sides = () if case.box.material is None else (case.box.material,)
    materials = tuple(dict.fromkeys((*sides, *(each.material for each in species), *case.materials_of_walls)))
    rows = [0 if each.material is None else materials.index(each.material) for each in case.wall]
    walls, shape_problems = rules.made_walls(case, rows, folder)
    found = [
        *rules.check_names(case),
        *law_problems,
        *rules.check_pairs(verdicts),
        *rules.check_one_law(verdicts),
        *rules.check_motion(case),
        *rules.check_count(case),
    ]
    found += rules.check_forces(case)
    excluded = exclusions.problems(exclusions.parsed(case))
    found += excluded
    box, start_region, given = Box.open(), None, None
    gas = CaseGas(case, species, materials, verdicts, box, walls)
    kinds = gas.kinds
    try:
        start_region = case.box.start_region(kinds.covered)
    except InputError as error:
        if not any(each.key == "box.shear_rate" for each in excluded):  # said already
            found.append(Problem("box", None, str(error)))
    else:
        box = box if case.box.open or start_region is None else start_region
        wall_problems = shape_problems or [*rules.check_walls(case, walls, box, kinds.radius)]
        found += wall_problems
        if start:
            standing = () if wall_problems else walls
            found += rules.check_room(
                case, species, kinds, None if start_region is None else FreeArea(start_region, standing)
            )
            found += [*rules.check_open(case, start_region), *rules.check_scan(case)]
            if case.start.file is None and case.start.trajectory is None:
                found += rules.check_clock(case)
            elif not starts.is_read_in_slices(replace(gas, box=box), ranks):
                given = rules.given_start(case, gas.disks.radius, FreeArea(box, standing), folder, found)
    found += rules.check_output(case, kinds.n, box)
    return replace(gas, box=box, start_region=start_region, given=given), found


def ready(gas: CaseGas) -> CaseGas:
    """The gas as it starts: its motion known, its magnitudes such that the engine and the trajectory take them.

    Raises InputError if they do not. Ranks that have read slices of the start call this together
    (`Communicator`).
    """
    case, given = gas.case, gas.given
    if case.start.positions == IMPACT_SCAN:
        speed = case.start.speed or 0.0
        given = impact_scan.start(gas.disks, case.start.psi_range, speed, seed=case.run.seed)
    gas = replace(gas, given=given)
    if given is not None and given.velocity is not None and given.spin is not None:
        gas = starts.as_moving(gas, given.velocity - gas.box.flow(given.position), given.spin)
    elif gas.n <= distribution.GATHERED and starts.n_moving(gas) == 1:  # alone it keeps its speed
        drift, share = starts.drift_of(gas, starts.drawn_motion(gas)[0])
        gas = replace(gas, drift=drift, drift_share=share)
    check_magnitudes(gas)
    return gas


def check_magnitudes(gas: CaseGas) -> None:
    """Refuse what the engine or the trajectory's precision would refuse when the run begins."""
    case = gas.case
    flow = 0.5 * abs(gas.box.shear_rate) * gas.box.lengths[1] if gas.box.shear_rate else 0.0
    if gas.given is not None and gas.given.velocity is not None and gas.given.spin is not None:
        velocity, spin, flow = gas.given.velocity, gas.given.spin, 0.0
    elif gas.n > distribution.GATHERED:
        fast, turning = starts.fastest_drawn(gas)
        velocity, spin = np.full((len(gas.kinds.mass), 2), fast), np.full(len(gas.kinds.mass), turning)
    else:
        velocity, spin = starts.drawn_motion(gas)
    comm = current()
    own = comm.slice_of(gas.n)
    disks = gas.rows(own) if len(spin) == len(own) else gas.kinds
    speed = comm.largest(checks.fastest(disks, velocity, spin))
    thermostats = ("temperature", "spin_temperature", "energy")
    set_to = [getattr(each, key, None) or 0.0 for each in case.force for key in thermostats]
    hottest = max([checks.hottest(gas.walls, ()), *set_to])
    checks.check_magnitudes(gas.kinds, gas.box, speed + flow, case.run.precision, hottest)
    largest = {
        "a velocity": comm.largest(float(np.abs(velocity).max(initial=0.0))) + flow,
        "a spin": comm.largest(float(np.abs(spin).max(initial=0.0))),
        "a side of the box": 0.0 if gas.box.is_open else max(gas.box.lengths),
    }
    energy = 0.0
    if "dissipated" in case.output.fields:
        mass = disks.mass[np.isfinite(disks.mass)].max(initial=0.0)
        fall = 0.0 if gas.box.is_open else float(mass) * math.hypot(*case.box.gravity) * max(gas.box.lengths)
        kinetic = checks.kinetic_energy(disks, np.abs(velocity) + flow, spin)
        energy = max(hottest, comm.largest(max(kinetic, fall)))
    checks.check_stored(largest, case.output.precision, energy)
    given = gas.given is not None and gas.given.velocity is not None
    check_engine(gas, velocity, given or gas.n <= distribution.GATHERED)


def check_engine(gas: CaseGas, velocity: NDArray[np.float64], known: bool) -> None:
    """Refuse what the engine would refuse, with the keys of the case.

    `velocity` (n, 2) is relative to the flow; unless `known`, those of many disks are not.
    """
    case, run, smallest = gas.case, gas.case.run, float(gas.kinds.radius.min())
    walls, size = gas.free_area.all_walls, "lengths" if gas.case.box.lengths else "packing_fraction"
    gravity = (case.box.gravity[0], case.box.gravity[1])
    meets_none = known and not walls and not gas.box.is_open and gas.box.shear_rate == 0.0
    alone = 0.0
    if meets_none and (gas.n == 1 or checks.fly_alike(velocity)):
        alone = current().largest(float(np.hypot(*velocity.T).max(initial=0.0)))
    refused = {
        ("box", size): lambda: checks.check_resolved(gas.n, smallest, gas.box, run.precision),
        ("run", "t_end"): lambda: checks.check_duration(
            gas.begin[0], run.t_end or 0.0, smallest, gas.box, alone
        ),
        ("run", "collapse"): lambda: checks.check_collapse(
            run.made_collapse(),
            gas.kinds,
            gas.box,
            walls,
            gravity,
            gas.coefficient("e_n"),
            run.made_device(),
        ),
    }
    found = lying(gas, velocity, walls, gravity) if known else []
    for verdict, *pair in approach_speeds(gas):
        try:
            if verdict.law is not None:
                verdict.law.check_speed(*pair)
        except InputError as error:
            found.append(str(Problem(verdict.key, None, f"{verdict.first}, {verdict.second}: {error}")))
    for (section, key), check in refused.items():
        try:
            check()
        except InputError as error:
            value = getattr(getattr(case, section), key)
            shown = f"{value:g}" if isinstance(value, float) else json.dumps(value)
            found.append(str(Problem(f"{section}.{key}", shown, str(error))))
    refuse(found)


def lying(
    gas: CaseGas,
    velocity: NDArray[np.float64],
    walls: Sequence[Wall],
    gravity: tuple[float, float],
) -> list[str]:
    """Problem about disks that a start file places at rest on walls, where only resting contacts hold them."""
    if gas.given is None or gas.case.run.collapse == "rest":
        return []
    comm, start = current(), gas.case.start
    ids = comm.slice_of(gas.n)
    rests = checks.at_rest_on_walls(gas.given.position, velocity, gas.rows(ids).radius, walls, gravity)
    here = None if rests is None else (ids.start + rests[0], rests[1])
    of_ranks = comm.allgather(here)
    if not any(of_ranks):
        return []
    rests = min(each for each in of_ranks if each)
    key, value = ("positions", start.positions) if start.file is None else ("file", start.file)
    wall = wall_names(walls, gas.box)[rests[1]]
    text = f"disk {rests[0]} lies on {wall} without speed, and has no next collision"
    text += ': set run.collapse = "rest", or give it a gap or a speed'
    return [str(Problem(f"start.{key}", json.dumps(value), text))]


def approach_speeds(gas: CaseGas) -> Iterator[tuple[PairVerdict, float, float, float]]:
    """Of each pair that can collide: mean g_n in collisions at the start, effective mass and radius.

    Of Maxwellian velocities, and disks of the mean masses and radii of their species, and flat walls.
    """
    by_name = {each.name: each for each in gas.species}
    for verdict in gas.verdicts:
        one, other = by_name[verdict.first], by_name.get(verdict.second)  # None for a wall
        both = [one] if other is None else [one, other]
        V = 0.5 * sum(each.speed_rms**2 for each in both)
        m_n = 1.0 / sum(1.0 / each.summary.mass.mean for each in both)
        R = 1.0 / sum(1.0 / each.summary.radius.mean for each in both)
        yield verdict, MEAN_APPROACH * math.sqrt(V), m_n, R


def verify_laws(gas: CaseGas) -> list[str]:
    """Try custom laws on random pairs of disks, as a simulation does: a text if collisions add energy.

    Imports the runtime, and starts it if it does not run. Raises InputError if disks would pass through each other,
    or the law cannot be compiled.
    """
    if not is_sampled(type(gas.law())):
        return []
    gas.case.run.choose_runtime()
    laws = PairLaws.of(gas.law_table, gas.kinds.rows, gas.materials_of_walls)
    speeds = (max(each.speed_rms, each.spin_rms * each.summary.radius.mean) for each in gas.species)
    with backend.sole_use(), warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", EnergyWarning)
        backend.start_unless_running(replace(gas.case.run.made_device(), name="cpu"))
        naming_law(
            gas, lambda: laws.check_by_sampling(gas.kinds.rows, gas.materials_of_walls, max(speeds) or 1.0)
        )
    return [str(each.message) for each in found if issubclass(each.category, EnergyWarning)]


def naming_law(gas: CaseGas, work: Callable[[], T]) -> T:
    """Do work whose errors and energy warnings about the custom law then begin with its place in the case."""
    key, start = (
        next(each.key for each in gas.verdicts if each.law),
        f"law {type(gas.law()).__name__}: ",
    )

    def named(text: str) -> str:
        return f"{f'{gas.path}: ' if gas.path else ''}{rules.problem_at(gas.case, f'{key}.law', text)}"

    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", EnergyWarning)
        try:
            result = work()
        except InputError as error:
            if not str(error).startswith(start):
                raise
            raise InputError(named(str(error))) from error
    for each in found:
        if issubclass(each.category, EnergyWarning):
            warnings.warn(named(str(each.message)), EnergyWarning, stacklevel=outside_level())
        else:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    return result
