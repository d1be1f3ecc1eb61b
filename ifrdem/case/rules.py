"""The rules on a valid case that need several of its sections, or what it names: everything that is wrong, at once."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem, there_are
from ..initial import from_csv, from_trajectory, placement
from ..initial.from_csv import StartData
from ..initial.packing import separate
from ..kernels.columns import MOST_IDS, MOST_WALLS
from ..model.box import Box
from ..model.gravity import EARTH
from ..model.laws import files as law_files
from ..model.laws.law import CollisionLaw
from ..model.overlaps import COMPUTED, STORED, tolerances
from ..model.setup import RECTANGLE
from ..model.state import DiskKinds
from ..model.walls.checks import check as check_free_of_walls
from ..model.walls.checks import check_place
from ..model.walls.free_area import FreeArea
from ..model.walls.wall import Wall, pieces
from ..mpi import current, distribution
from ..mpi.decomposition import counted_tiles, most_ranks
from ..simulation.start.overlaps import check_no_overlap, relax
from ..simulation.steps.schedule import first_after, time_of
from ..simulation.windows.tiling import tiles_on_ranks
from . import exclusions
from .case import GROWN, IMPACT_SCAN, CaseSections, SteppedForce
from .laws_section import FileKeys, TableKeys
from .pair_rules import PairVerdict
from .species import Species

MOST_SUMMED = 1000
"""Walls whose sums a file can hold: their names are an attribute, of 64 KiB at most."""
LARGEST_DISK = 1.0 / 3.0
"""Largest diameter over the shorter periodic side: the engine's limit, so that no disk meets its own image."""


def problem_at(case: CaseSections, key: str, text: str) -> Problem:
    """A problem with the value that a key of the case has."""
    value: Any = case
    for step in re.findall(r"\w+", key):
        value = value[int(step)] if step.isdecimal() else getattr(value, step)
    shown = f"{value:g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
    return Problem(key, None if value is None else shown, text)


def check_names(case: CaseSections) -> Iterator[Problem]:
    """Problems: names of materials and species that are used twice, or are invalid."""
    names = [each.name for each in case.material]
    for kind, own in (("material", names), ("species", [each.name for each in case.species])):
        for i, name in enumerate(own):
            if (first := own.index(name)) != i:
                yield problem_at(
                    case, f"{kind}[{i}].name", f"the name of {kind}[{first}] too; each needs its own"
                )
    for i, section in enumerate(case.species):
        key, coin = f"species[{i}].material", section.coin
        if coin is not None and case.run.units != "SI":
            text = 'requires run.units = "SI": its mass and diameter are in SI'
            yield problem_at(case, f"species[{i}].coin", text)
        if section.material is None and coin is None:
            yield problem_at(case, key, f"missing: give the name of a material{there_are('', names)}")
        elif section.material is None and coin in names:
            text = f"missing: a [[material]] is called '{coin}' like the coin, so say which is meant"
            yield problem_at(case, key, text)
        elif section.material is not None and section.material not in names:
            yield problem_at(case, key, f"no such material{there_are(section.material, names)}")
    used = [each.coin for each in case.species if each.coin is not None]
    known = list(dict.fromkeys((*names, *used, *case.materials_of_walls)))
    pairs: dict[frozenset[str], int] = {}
    for i, pair in enumerate(case.pair):
        key, (a, b) = f"pair[{i}].materials", pair.materials
        for name in pair.materials:
            if name not in known:
                yield problem_at(case, key, f"no material is called '{name}'{there_are(name, known)}")
        if a == b:
            yield problem_at(case, key, "must be two different names; [[material]] is for one")
        if (first := pairs.setdefault(frozenset((a, b)), i)) != i:
            yield problem_at(case, key, f"the materials of pair[{first}] too")


def check_pairs(verdicts: Iterable[PairVerdict]) -> Iterator[Problem]:
    """Inadmissible pairs; each message appears once, also for several species."""
    for key, message in dict.fromkeys((each.key, each.message) for each in verdicts if not each.admissible):
        yield Problem(key, None, message)


def check_one_law(verdicts: Iterable[PairVerdict]) -> Iterator[Problem]:
    """Laws of several classes, of which a gas has one."""
    keys: dict[type, str] = {}
    for each in verdicts:
        if each.law is not None:
            keys.setdefault(type(each.law), each.key)
    if len(keys) > 1:
        named = ", ".join(f"{kind.__name__} ({key})" for kind, key in keys.items())
        text = f"laws of {len(keys)} classes, {named}: all materials and pairs of a case must have one"
        yield Problem([*keys.values()][1], None, text)


def laws_from_files(case: CaseSections, folder: Path) -> tuple[dict[str, CollisionLaw], list[Problem]]:
    """The laws of a case that are in files, by their sections, "material[0]"; and all that is wrong.

    The code of custom ones is executed.
    """
    laws: dict[str, CollisionLaw] = {}
    problems: list[Problem] = []
    # Of a table, which is examined here; pairs of disks are by `pair_rules`.
    k = min((each.k for each in case.species), default=2.0)
    for name in ("material", "pair"):
        for i, section in enumerate(getattr(case, name)):
            key = f"{name}[{i}]"
            if isinstance(section, TableKeys):
                try:
                    laws[key] = section.read(folder, k)
                except InputError as error:
                    problems.append(problem_at(case, f"{key}.file", str(error)))
                continue
            if not isinstance(section, FileKeys):
                continue
            try:
                kind = law_files.find(section.law, folder).kind
            except InputError as error:
                problems.append(problem_at(case, f"{key}.law", str(error)))
                continue
            keys = [each for each in kind.coefficients if each in type(section).model_fields]
            if keys:
                text = f"{keys[0]} cannot be a coefficient: it is a key of [[{name}]]; rename it in the file"
                problems.append(problem_at(case, f"{key}.law", text))
                continue
            law, wrong = law_files.made(kind, section.values)
            for one, text in wrong:
                given = json.dumps(section.values[one], default=str) if one in section.values else None
                problems.append(Problem(f"{key}.{one}" if one else key, given, text))
            if law is not None:
                laws[key] = law
    return laws, problems


def check_motion(case: CaseSections) -> Iterator[Problem]:
    """Problems: an end or output at a number of collisions that is never reached."""
    key, start = "run.collisions_per_disk", case.start
    if case.run.collisions_per_disk is None:
        return
    if _disks(case) < 2:
        yield problem_at(case, key, "one disk alone never collides; give t_end instead")
    elif start.placed and not case.sets_in_motion and not any(each.moves for each in case.species):
        text = "nothing moves at the start, so nothing ever collides: give a species speed_rms above 0"
        yield problem_at(case, key, text)


def check_count(case: CaseSections) -> Iterator[Problem]:
    """Problems: more disks of all species together than there are ids."""
    if (n := _disks(case)) > MOST_IDS:
        each = ", ".join(f"{one.number} of '{one.name}'" for one in case.species)
        yield problem_at(
            case, "species[0].number", f"{n} disks in all ({each}): {MOST_IDS} at most are numbered"
        )


def _disks(case: CaseSections) -> int:
    return sum(each.number for each in case.species)


def check_clock(case: CaseSections, time: float = 0.0, collisions: int = 0) -> Iterator[Problem]:
    """Ends of the run that are over when it starts at a time [time] after so many collisions, or before a force acts.

    The number of collisions is that of all disks, each of two.
    """
    t_end, per_disk = case.run.t_end, case.run.collisions_per_disk
    continues = "" if case.start.trajectory is None else "; start.time = 0 begins a new clock"
    if t_end is not None and t_end <= time:
        yield problem_at(
            case,
            "run.t_end",
            f"must be after {time:.9g}, the time of the run's clock at the start{continues}",
        )
        return
    if per_disk is not None and collisions and 0.5 * per_disk * _disks(case) <= collisions:
        already = f"{2.0 * collisions / _disks(case):.6g}, the collisions per disk until the frame"
        yield problem_at(case, "run.collisions_per_disk", f"must be above {already}{continues}")
    for i, force in enumerate(case.force):
        if t_end is None or not isinstance(force, SteppedForce):
            continue
        if time_of(first_after(time, force.step), force.step) > t_end:
            text = f"must have its middle, when the force acts, before run.t_end = {t_end:g}"
            yield problem_at(case, f"force[{i}].step", text)


def check_forces(case: CaseSections) -> Iterator[Problem]:
    """Problems: forces that lack a number."""
    for i, force in enumerate(case.force):
        key = f"force[{i}]"
        if force.kind == "table_friction" and force.gravity is None and case.run.units != "SI":
            yield problem_at(case, f"{key}.gravity", f"missing: {EARTH} m/s^2 is meant in SI units only")


def made_walls(
    case: CaseSections, materials: Sequence[int], folder: Path
) -> tuple[tuple[Wall, ...], list[Problem]]:
    """The walls of a case, and those that cannot be made: files that cannot be read, polygons that cross themselves."""
    made, problems = [], []
    for i, (each, material) in enumerate(zip(case.wall, materials, strict=True)):
        try:
            made.append(each.wall(material, folder))
        except InputError as error:
            problems.append(Problem(f"wall[{i}]", None, str(error)))
    return tuple(made), problems


def check_walls(
    case: CaseSections, walls: Sequence[Wall], box: Box, radius: NDArray[np.float64]
) -> Iterator[Problem]:
    """Problems: walls that do not fit the box, or leave no room."""
    if box.is_open:
        return
    if case.box.lengths is None and walls:
        text = "cannot be combined with walls: give box.lengths, and `ifrdem check` prints the fraction"
        yield problem_at(case, "box.packing_fraction", text)
        return
    placed = []
    for i, wall in enumerate(walls):
        key = f"wall[{i}]"
        try:
            check_place(wall, box)
        except InputError as error:
            yield Problem(key, None, f"{wall.shape}: {error}")
            continue
        if _outside(wall, box):
            reaches = f"which reaches from [0, 0] to [{box.lengths[0]:.6g}, {box.lengths[1]:.6g}]"
            yield Problem(key, None, f"the {wall.shape} lies outside of the box, {reaches}")
            continue
        placed.append(wall)
    free_area, largest = FreeArea(box, tuple(placed)), float(radius.max())
    if (number := pieces(free_area.all_walls)) > MOST_WALLS:
        count = f"{number} walls: {MOST_WALLS} at most are supported"
        yield Problem("wall", None, f"{count}, the sides of the box included")
    elif len(placed) == len(walls) and free_area.all_walls and free_area.area(largest) <= 0.0:
        text = f"the walls leave no room for a disk of diameter {2.0 * largest:.6g}"
        yield Problem("wall" if walls else "box.lengths", None, text)


def _outside(wall: Wall, box: Box) -> bool:
    """True if a wall among the disks is out of reach of the box; a line or container so placed leaves no room."""
    if wall.geometry.encloses or wall.motion.kind == "steady":
        return False
    low, high = wall.bounds()
    beyond = (high + wall.motion.extent <= 0.0) | (low - wall.motion.extent >= box.lengths)
    return bool(np.any(beyond))


def check_output(case: CaseSections, n: int, box: Box) -> Iterator[Problem]:
    """Problems: output that the gas or the box does not allow."""
    output, region = case.output, case.output.histories_region
    if output.wall_sums and len(case.wall) > MOST_SUMMED:
        text = (
            f"{len(case.wall)} walls: of {MOST_SUMMED} at most; make polylines of those that belong together"
        )
        yield Problem("output.wall_sums", "true", text)
    for key, named in (("fields", output.fields), ("histories", output.histories or ())):
        if twice := [name for name, times in Counter(named).items() if times > 1]:
            text = "given twice: each may be given once"
            yield Problem(f"output.{key}", json.dumps(twice[0]), text)
    if beyond := [each for each in output.histories or () if each >= n]:
        yield Problem("output.histories", str(beyond[0]), f"there are disks 0 to {n - 1}")
    if (output.histories_sample or 0) > n:
        yield problem_at(case, "output.histories_sample", f"there are {n} disks")
    for key in ("frames_phases", "series_phases"):
        if (phases := getattr(output, key)) is not None and len(case.frequencies) != 1:
            several = ", ".join(f"{each:g}" for each in sorted(case.frequencies))
            text = f"the walls have the frequencies {several}" if several else "no wall moves to and fro"
            more = "must have walls that move or turn to and fro with one frequency"
            yield Problem(f"output.{key}", str(phases), f"{more}; {text}")
    regions = {f"output.regions.{name}": each for name, each in output.regions.items()}
    for key, sides in (regions | ({} if region is None else {"output.histories_region": region})).items():
        x_low, y_low, x_high, y_high = sides
        if not (x_low < x_high and y_low < y_high):
            yield Problem(key, json.dumps(sides), RECTANGLE)
        elif not box.is_open:
            length_x, length_y = box.lengths
            if x_low >= length_x or y_low >= length_y or x_high <= 0.0 or y_high <= 0.0:
                text = f"lies outside of the box, {length_x:.5g} x {length_y:.5g}"
                yield Problem(key, json.dumps(sides), text)


NOT_GROWN_ON_RANKS = (
    "grows all disks in one process, of more than 1,000,000 disks not on several ranks: run the case without mpiexec "
    'for a moment (--max-hours 0.001, output.precision = "f64"), and begin on ranks from its trajectory'
)


def usable_ranks(case: CaseSections, kinds: DiskKinds, box: Box, ranks: int) -> tuple[int, str]:
    """Largest number of ranks of MPI, up to `ranks`, that can share a gas, and the reason if it is smaller, else ""."""
    keys = exclusions.undivided(case)
    grown = case.start.positions == GROWN and case.start.file is None
    if grown and kinds.n > distribution.GATHERED:
        keys.append(f'start.positions = "{GROWN}" of more than {distribution.GATHERED} disks')
    if keys:
        return 1, f"{' and '.join(keys)} cannot be divided among ranks"
    if case.run.device != "cpu":  # the engine of a GPU has other, smaller tiles
        return ranks, ""
    tiles = tiles_on_ranks(kinds, box)
    found = most_ranks(tiles, ranks)
    return found, "" if found == ranks else f"{kinds.n} disks make {counted_tiles(tiles)}"


def check_room(
    case: CaseSections, species: Sequence[Species], kinds: DiskKinds, free_area: FreeArea | None
) -> Iterator[Problem]:
    """`room` is where disks start: that of the box, or of a part of an open one, if any."""
    period = free_area.box.shortest_period if free_area is not None else math.inf
    fits = True
    for each in species if not case.box.open else ():
        largest = 2.0 * each.summary.radius.high
        if free_area is not None and largest > LARGEST_DISK * period:
            fits, sides = False, free_area.box.lengths
            text = f"a disk of species '{each.name}' has diameter {largest:.6g}, more than a third of a periodic side"
            more = "enlarge the box, or take more disks at this packing fraction"
            yield Problem("box", f"{sides[0]:.6g} x {sides[1]:.6g}", f"{text}: {more}")
    if not fits or free_area is None:
        return
    covered, dense = free_area.covered_part(kinds.covered), _size_key(case)
    if covered >= 1.0:
        place = "free area between walls" if free_area.all_walls else "box"
        text = f"the disks cover more than the {place} has" + _attainable(kinds, covered)
        yield Problem(dense, f"{covered:.4g} of the area", text)
    elif case.start.placed and case.start.positions == "hexagonal":
        try:
            if free_area.all_walls:
                placement.check_sites(free_area, kinds.n, float(kinds.radius.max()))
            else:
                placement.lattice(free_area.box, kinds.n, 2.0 * float(kinds.radius.max()))
        except InputError as error:
            yield problem_at(case, "start.positions", str(error))
    elif case.start.placed and case.start.positions == "random":
        # Few disks can be denser: the limit holds for many (see placement.random_positions).
        limit = placement.SATURATION + 0.5 / np.sqrt(kinds.n)
        if np.ptp(kinds.radius) == 0.0 and covered > limit:
            text = f"too dense for a random start: packing fraction must be at most {placement.SATURATION}"
            yield Problem(
                dense,
                f"{covered:.4g}",
                f'{text}, or start.positions = "{GROWN}" or "hexagonal"',
            )


def _attainable(kinds: DiskKinds, covered: float) -> str:
    """Number of disks of one size that would find room, by area, where all of them cover this part."""
    if np.ptp(kinds.radius) > 0.0:
        return ""
    most = int(placement.SATURATION * kinds.n / covered)
    return f": some {most} of them find room at random"


def _size_key(case: CaseSections) -> str:
    return "box.packing_fraction" if case.box.lengths is None else "box.lengths"


def check_open(case: CaseSections, start_region: Box | None) -> Iterator[Problem]:
    """Check the rectangle of the start: whether it is required or cannot be given."""
    if not case.box.open:
        return
    if case.start.placed and start_region is None:
        text = f'disks that start at "{case.start.positions}" places need a rectangle to start in'
        yield problem_at(case, "box.open", f"{text}: give packing_fraction or lengths too")
    if not case.start.placed and start_region is not None:
        text = "cannot be combined with box.open = true where the start says where the disks are"
        yield Problem(_size_key(case), None, text)


def check_scan(case: CaseSections) -> Iterator[Problem]:
    """Problems: an impact scan of an unsuitable gas."""
    if case.start.positions != IMPACT_SCAN:
        return
    key = "start.positions"
    if not case.box.open:
        yield problem_at(case, key, "pairs that fly apart need box.open = true")
    numbers = [each.number for each in case.species]
    if len(numbers) != 2 or numbers[0] != numbers[1]:
        found = ", ".join(f"{each.number} of '{each.name}'" for each in case.species)
        text = f"requires two species with equal numbers, those that hit and those that are hit; there are {found}"
        yield problem_at(case, key, text)
    if case.force:
        text = "no [[force]] can act in a scan: impacts are found from velocities before and after"
        yield problem_at(case, key, text)
    yield from _check_speeds(case, f'{key} = "{IMPACT_SCAN}": start.speed is the speed of those that hit')


def _check_speeds(case: CaseSections, given_by: str) -> Iterator[Problem]:
    """Speeds of species that are given although the start has velocities."""
    for i, each in enumerate(case.species):
        for speed in ("speed_rms", "temperature", "spin_rms"):
            if speed in each.model_fields_set:
                yield problem_at(case, f"species[{i}].{speed}", f"cannot be combined with {given_by}")


def _check_pistons(case: CaseSections, given: StartData) -> Iterator[Problem]:
    """Displacements and velocities of pistons that are given although a frame has them."""
    pistons = [(i, each.piston) for i, each in enumerate(case.wall) if each.piston is not None]
    if given.pistons is None or len(given.pistons) != len(pistons):
        return
    for i, piston in pistons:
        for key in ("displacement", "velocity"):
            if getattr(piston, key) is not None:
                text = "cannot be combined with a start from a frame, which has those of its pistons: leave it out"
                yield problem_at(case, f"wall[{i}].piston.{key}", text)


def _apart(
    free_area: FreeArea, radius: NDArray[np.float64], position: NDArray[np.float64], time: float
) -> NDArray[np.float64]:
    """The positions of a table at a `time` [time], moved apart where they overlap by the rounding of an export.

    InputError if disks, or disks and walls, overlap by more.
    """
    box = free_area.box

    def check(rounding: float) -> None:
        near, into = tolerances(box, radius, position, rounding)
        check_no_overlap(box, radius, position, tolerance=near, time=time)
        check_free_of_walls(free_area.all_walls, box, position, radius, time=time, tolerance=into)

    try:
        check(0.0)
    except InputError:
        check(STORED + COMPUTED)
        standing = [wall for wall in free_area.walls if wall.is_present(time, 0)]
        return separate(box, radius, position, walls=standing, time=time)
    return position


def given_start(
    case: CaseSections,
    radius: NDArray[np.float64],
    free_area: FreeArea,
    folder: Path,
    found: list[Problem],
) -> StartData | None:
    """The start that a file or a trajectory gives; what is wrong with it is added to `found`.

    Of ranks of MPI (`Communicator`), each gives the radii of its slice and gets its rows; all find the same wrong.
    """
    comm, start, box = current(), case.start, free_area.box
    key, name = "start.positions", start.trajectory
    if name is None:
        key, name = "start.file", start.file
    if name is None:
        return None
    value = f'"{name}"'
    try:
        if start.trajectory is not None:
            options: Any = {
                "motion": start.motion,
                "time": start.time,
                "walls": free_area.walls,
            }
            given = from_trajectory.read(folder / name, start.frame, radius, box, **options)
        else:
            given = from_csv.read(
                folder / name, comm.number(len(radius))[1], box, start.form, frame=start.frame,
                species=[(each.name, each.number) for each in case.species], units=case.run.units,
            )  # fmt: skip
            given = replace(given, time=start.time or 0.0)
            at: Any = {"time": given.time}
            if start.relax is not None:
                given = replace(given, position=relax(box, radius, given.position, start.relax, **at))
            given = replace(given, position=_apart(free_area, radius, given.position, given.time))
    except InputError as error:
        found += [Problem(key, value, line) for line in str(error).splitlines()]
        return None
    found += [*check_clock(case, given.time, given.collisions), *_check_pistons(case, given)]
    if start.trajectory is not None and start.time is None and "collisions" not in given.past:
        counted = [i for i, wall in enumerate(free_area.walls) if wall.opens_after is not None]
        found += [
            problem_at(case, f"wall[{i}].opens_after", f"requires the field collisions (output.fields) in {key} = "
                f"{value}, to count from; start.time = 0 begins a new clock")
            for i in counted
        ]  # fmt: skip
    drawn = any(each.moves for each in case.species)
    fastest = 0.0 if given.velocity is None else float(np.abs(given.velocity).max(initial=0.0))
    moving = drawn if given.velocity is None else comm.largest(fastest) > 0.0
    target = case.run.collisions_per_disk
    if target is not None and _disks(case) > 1 and not moving and not case.sets_in_motion:
        if given.velocity is None:
            more = "the columns vx, vy, spin" if start.trajectory is None else "start.motion = true"
            rest = f"has no velocities: give {more} or a species speed_rms above 0"
        else:
            rest = "has only velocities vx = vy = 0: give others"
        text = f"nothing moves at the start, so nothing ever collides; {key} = {value} {rest}"
        found.append(problem_at(case, "run.collisions_per_disk", text))
    if given.velocity is not None:
        file = f"velocities in the start file '{name}'"
        found += _check_speeds(case, file if start.trajectory is None else f"start.motion = true ({value})")
    return given
