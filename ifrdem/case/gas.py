"""The gas that a case describes: disks, box and laws, and how they start."""

from __future__ import annotations

import functools
import json
import math
import operator
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem, listed, outside_level, refuse
from ..initial import impact_scan, packing, placement
from ..initial.from_csv import StartData
from ..model.box import Box
from ..model.laws.ifr import EnergyWarning
from ..model.laws.law import CollisionLaw
from ..model.laws.pairs import MEAN_APPROACH, PairLaws
from ..model.laws.sampling import is_sampled
from ..model.observables import drift_text
from ..model.setup import Setup
from ..model.state import DiskKinds, Disks, State, merge_kinds, scatter_state
from ..model.walls import crush
from ..model.walls.free_area import FreeArea
from ..model.walls.wall import Wall, free_directions, smooth_materials, wall_names
from ..mpi import SERIAL, Communicator, current, distribution
from ..simulation import backend
from ..simulation.simulation import Simulation
from ..simulation.start import checks
from ..simulation.steps.turning import FASTEST_DRUM
from ..tools import seeds
from . import exclusions, pair_rules, rules
from .case import GROWN, IMPACT_SCAN, CaseSections
from .pair_rules import PairVerdict
from .species import Species, species_of

T = TypeVar("T")
PLACED_BY_CHECK = {"random": 10_000, GROWN: 2_000}
"""Numbers of disks that are placed in about a second, by `start.positions`; others are faster than random."""


REPORTED_DRIFT = 1e-3
"""Part of the kinetic energy of the disks' motion above which a drift of the whole gas is reported."""


@dataclass(frozen=True)
class CaseGas:
    """The gas of a case: its disks, box, walls and laws, and its start."""

    case: CaseSections
    species: tuple[Species, ...]  # in the order of the disks' ids
    materials: tuple[str, ...]  # names of those that occur; that of the sides of the box is the first
    verdicts: tuple[PairVerdict, ...]  # of each pair of species, and of each species and material of walls
    box: Box
    walls: tuple[Wall, ...] = ()  # without those at the sides of the box
    start_region: Box | None = None  # where disks are placed: the box, or the rectangle of an open one
    # The start, if the case names a file or a trajectory with it; on ranks that read it in slices, that of the slice.
    given: StartData | None = None
    # Mean velocity, weighted by mass, with which the whole gas starts and keeps moving [length/time], and its part of
    # the kinetic energy of velocities; 0 along directions in which walls stop it.
    drift: tuple[float, float] = (0.0, 0.0)
    drift_share: float = 0.0
    path: Path | None = None
    """The case file, for messages."""

    @classmethod
    def from_case(cls, case: CaseSections, folder: Path | str = ".", *, start: bool = True) -> CaseGas:
        """The gas of a case; a start file's path begins at `folder`. Without `start`, that file is not read.

        Raises InputError with a line for each thing that is wrong, what is too large or too small for the engine
        included.
        """
        gas, problems = validate_case(case, Path(folder), start=start)
        if problems:
            raise InputError(listed([str(problem) for problem in problems]))
        return gas.ready() if start else gas

    def with_start(self, folder: Path) -> tuple[CaseGas, list[Problem]]:
        """The gas with the slice of a start that each rank reads (`is_read_in_slices`), and all that is wrong with it.

        All ranks call this, in a `with` block of their communicator, and find the same wrong.
        """
        found: list[Problem] = []
        radius = self.rows(current().slice_of(self.n)).radius
        given = rules.given_start(self.case, radius, self.free_area, folder, found)
        return replace(self, given=given), found

    def __getstate__(self) -> dict[str, Any]:
        """Its fields: what is computed from them, such as all disks, is not sent to other ranks and processes."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def ready(self) -> CaseGas:
        """The gas as it starts: its motion known, its magnitudes such that the engine and the trajectory take them.

        Raises InputError if they do not. Ranks that have read slices of the start call this together
        (`Communicator`).
        """
        case, given = self.case, self.given
        if case.start.positions == IMPACT_SCAN:
            speed = case.start.speed or 0.0
            given = impact_scan.start(self.disks, case.start.psi_range, speed, seed=case.run.seed)
        gas = replace(self, given=given)
        if given is not None and given.velocity is not None and given.spin is not None:
            gas = gas._as_moving(given.velocity - self.box.flow(given.position), given.spin)
        elif self.n <= distribution.GATHERED and self._moving == 1:  # alone it keeps its speed
            drift, share = self._drift(self._drawn_motion()[0])
            gas = replace(gas, drift=drift, drift_share=share)
        gas._check_magnitudes()
        return gas

    @functools.cached_property
    def disks(self) -> Disks:
        """The disks, species by species."""
        return self.rows(range(self.n))

    @property
    def n(self) -> int:
        """Number of disks."""
        return sum(each.number for each in self.species)

    @property
    def _moving(self) -> int:
        """Number of disks that move at the start."""
        return sum(each.number for each in self.species if each.speed_rms > 0.0)

    def rows(self, ids: range) -> Disks:
        """The disks of some ids."""
        own = self._of_species(ids)
        numbers = [len(each) for each in own]
        both = zip(*(one.columns(each) for one, each in zip(self.species, own, strict=True)), strict=True)
        mass, radius = map(np.concatenate, both)
        return Disks(
            len(ids), mass, radius,
            k=np.repeat([each.k for each in self.species], numbers),
            material=np.repeat([self.materials.index(each.material) for each in self.species], numbers),
            species=self._named(numbers),
        )  # fmt: skip

    def _named(self, numbers: Sequence[int]) -> dict[str, int]:
        """Species as `Disks` takes them, of so many disks each; none of one species, or of names that are the same."""
        found = dict(zip((each.name for each in self.species), numbers, strict=True))
        return found if 1 < len(found) == len(self.species) else {}

    def _of_species(self, ids: range) -> list[range]:
        """Of some ids, those of each species, counted from its first disk."""
        found, first = [], 0
        for each in self.species:
            start, stop = (min(max(end - first, 0), each.number) for end in (ids.start, ids.stop))
            found.append(range(start, stop))
            first += each.number
        return found

    @functools.cached_property
    def kinds(self) -> DiskKinds:
        """The kinds of disks, without an array of all disks."""
        kinds, sums = [], []
        for each in self.species:
            (*rows, material), every = each.summary.kinds
            kinds.append(([*rows, np.full_like(material, self.materials.index(each.material))], every))
        for block in distribution.blocks(range(self.n)):
            own = self._of_species(block)
            i = int(np.argmax([len(each) for each in own]))
            if len(own[i]) == len(block):
                sums.append(self.species[i].sums(own[i]))
            else:
                radius = self.rows(block).radius
                sums.append((float(np.sum(np.square(radius))), float(np.sum(radius))))
        squares, radii = (functools.reduce(operator.add, each) for each in zip(*sums, strict=True))
        return DiskKinds.made(
            merge_kinds(kinds),
            self.n,
            self.n,
            squares,
            radii,
            self._named([each.number for each in self.species]),
        )

    @functools.cached_property
    def laws(self) -> list[list[CollisionLaw | None]]:
        """The law of each pair of `materials`; None for two that only walls are made of, which never meet.

        It is made for the largest mean k of what meets with them.
        """
        found: dict[frozenset[str], CollisionLaw] = {}
        for each in self.verdicts:
            pair, law = each.materials, each.law
            if law is not None and (
                pair not in found or getattr(law, "k", 0.0) > getattr(found[pair], "k", 0.0)
            ):
                found[pair] = law
        return [[found.get(frozenset((a, b))) for b in self.materials] for a in self.materials]

    @property
    def free_area(self) -> FreeArea:
        """The area that walls leave to the disks at the start."""
        return FreeArea(self.box, self._walls_at_start, self.begin[0])

    @property
    def stress_area(self) -> float | None:
        """Free area at the start, which stresses refer to [length^2]; None without output.stress."""
        if not self.case.output.stress:
            return None
        return self.free_area.area() if self.free_area.all_walls else self.box.area

    @property
    def begin(self) -> tuple[float, int]:
        """Time of the run's clock at the start [time], and number of collisions of all disks until then."""
        return (0.0, 0) if self.given is None else (self.given.time, self.given.collisions)

    @property
    def is_drawn(self) -> bool:
        """True if run.seed changes the run: it draws the start or radii, or forces or thermal walls act at random."""
        case, given = self.case, self.given
        moves = any(each.moves or each.spin_rms for each in case.species)
        if given is None or case.start.positions == IMPACT_SCAN:
            drawn = moves or case.start.positions != "hexagonal" or len(self.species) > 1
        else:
            drawn = moves and (given.velocity is None or given.spin is None)
        random = any(each.is_random for each in case.force) or any(
            wall.temperature for wall in self.free_area.all_walls
        )
        return drawn or random or not all(each.equal for each in self.species)

    def law(self, i: int = 0, j: int = 0) -> CollisionLaw:
        """The law of two species, by their numbers."""
        a, b = (self.materials.index(self.species[one].material) for one in (i, j))
        found = self.laws[a][b]
        assert found is not None  # they have disks
        return found

    @property
    def approach_speeds(self) -> Iterator[tuple[PairVerdict, float, float, float]]:
        """Of each pair that can collide: mean g_n in collisions at the start, effective mass and radius.

        Of Maxwellian velocities, disks of the mean masses and radii of their species, and flat walls.
        """
        by_name = {each.name: each for each in self.species}
        for verdict in self.verdicts:
            one, other = by_name[verdict.first], by_name.get(verdict.second)  # None for a wall
            both = [one] if other is None else [one, other]
            V = 0.5 * sum(each.speed_rms**2 for each in both)
            m_n = 1.0 / sum(1.0 / each.summary.mass.mean for each in both)
            R = 1.0 / sum(1.0 / each.summary.radius.mean for each in both)
            yield verdict, MEAN_APPROACH * math.sqrt(V), m_n, R

    @property
    def warnings(self) -> list[str]:
        """One text for each law that only the loss along the line of centres keeps from adding energy."""
        texts = dict.fromkeys(each.message for each in self.verdicts if each.admissible and not each.strict)
        return list(texts)

    def wall_pinch_warnings(self) -> list[str]:
        """One text for each two walls that may crush a disk between them in the run; InputError if they must."""
        if not self.n:
            return []
        end = math.inf if self.case.run.t_end is None else self.case.run.t_end
        return crush.wall_pinch_warnings(
            self.free_area.all_walls, self.box, self.kinds.radius, self.begin[0], end
        )

    @property
    def drum(self) -> float:
        """Froude number of the drum in whose frame gravity turns: Omega^2 R / g, R of the widest container.

        Half of the box's longer side where there is none; 0 if gravity does not turn.
        """
        section = self.case.box
        radii = [wall.radius for wall in self.walls if wall.shape == "container"]
        radius = max(radii) if radii else 0.5 * max(self.box.lengths)
        return section.gravity_rotation_rate**2 * radius / (math.hypot(*section.gravity) or 1.0)

    @property
    def notices(self) -> list[str]:
        """Texts about a drift, long steps of forces, effects that are left out, and walls on which no disk can rest."""
        from .estimate import long_steps

        texts, froude = [*self._drifting(), *long_steps(self)], self.drum
        if froude > FASTEST_DRUM:
            texts.append(
                f"box.gravity_rotation_rate = {self.case.box.gravity_rotation_rate:g}: the Froude number of such a "
                f"drum, {froude:.3g}, is above {FASTEST_DRUM}: its frame has centrifugal and Coriolis accelerations, "
                "too, which are left out"
            )
        texts += self._forgotten()
        if self.case.run.resting_speed is None:
            return texts
        for i, wall in enumerate(self.walls):
            if wall.motion.kind == wall.turn.kind == "still" and not (wall.surface_speed or wall.temperature):
                continue
            reason = "has a temperature" if wall.temperature else "moves"
            instead = (
                ""
                if wall.temperature
                else "; "
                + (
                    "in the frame of a slow drum gravity turns: let the wall stand, and give box.gravity_rotation_rate"
                    if wall.turn.kind == "steady" or (wall.shape == "container" and wall.surface_speed)
                    else "in the frame of a steady motion the wall stands: let it, and move all others the other way"
                    if wall.motion.kind == "steady" or wall.surface_speed
                    else "a floor that shakes has no frame in which gravity is constant: its disks stay awake"
                )
            )
            texts.append(f'wall[{i}] {reason}, and supports no disks with run.collapse = "rest"{instead}')
        return texts

    def _drifting(self) -> list[str]:
        """Text about a drift that has more than `REPORTED_DRIFT` of the energy of the disks' motion."""
        if not self.drift_share > REPORTED_DRIFT:
            return []
        case = self.case
        per = f"{case.unit('length')}/{case.unit('time').strip()}" if case.unit("length") else ""
        media = [each.kind for each in case.force if each.has_medium]
        about = "Speeds, collision rates and temperatures are about its mean velocity"
        if media:
            about = (
                "Speeds and collision rates here are about its mean velocity; temperatures of the run are not, for "
                f"the medium of {' and '.join(dict.fromkeys(media))} is at rest"
            )
        return [
            f"the whole gas drifts at {drift_text(self.drift)}{per}, {100.0 * self.drift_share:.4g} % of the kinetic "
            f"energy of its motion. {about}. The run takes longer than that of the same gas without the drift: windows "
            "end where the fastest disk has come too far"
        ]

    def _forgotten(self) -> list[str]:
        """Texts about quantities of the disks that the frame of the start does not store."""
        run, name = self.case.run, "start.motion = true: the frame does not store"
        texts: list[str] = []
        if self.given is None or not self.case.start.motion:
            return texts
        if run.contact_time is not None:
            until = self.given.time + run.contact_time
            texts.append(
                f"{name} when disks collided last: until t = {until:.6g}, run.contact_time counts collisions since the "
                "start only"
            )
        if any(wall.temperature for wall in self.walls):
            texts.append(
                f"{name} how often disks hit thermal walls: with the seed of its run they draw the same random "
                f"velocities again, with another run.seed than {run.seed} others"
            )
        if run.resting_speed is not None and "asleep" not in self.given.past:
            texts.append(f"{name} which disks sleep (output.fields, asleep): all are awake at first")
        return texts

    def start(self, progress: Callable[[float], None] = lambda _: None) -> State:
        """The state at the start, without overlaps; `progress` gets the part of growing that is done.

        Of ranks (`Communicator`), each gets its slice of a start that is made so (`is_made_in_slices`).

        Raises InputError if the disks do not fit into the box in the way the case wants: a line with the key.
        """
        self.case.run.choose_runtime()
        given = self.given
        position = self._placed(progress) if given is None else given.position
        past: dict[str, Any] = {} if given is None else {"time": given.time, **given.past}
        if given is not None and given.velocity is not None and given.spin is not None:
            return State(position=position, velocity=given.velocity, spin=given.spin, **past)
        velocity, spin = self._drawn_motion()
        return State(position=position, velocity=velocity + self.box.flow(position), spin=spin, **past)

    def verify_laws(self) -> list[str]:
        """Try custom laws on random pairs of disks, as a simulation does: a text if collisions add energy.

        Imports the runtime, and starts it if it does not run. Raises InputError if disks would pass through each other,
        or the law cannot be compiled.
        """
        if not is_sampled(type(self.law())):
            return []
        self.case.run.choose_runtime()
        laws = PairLaws.of(self.law_table, self.kinds.rows, self._materials_of_walls)
        speeds = (max(each.speed_rms, each.spin_rms * each.summary.radius.mean) for each in self.species)
        with backend.sole_use(), warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always", EnergyWarning)
            backend.start_unless_running(replace(self.case.run.made_device(), name="cpu"))
            self._naming_law(
                lambda: laws.check_by_sampling(self.kinds.rows, self._materials_of_walls, max(speeds) or 1.0)
            )
        return [str(each.message) for each in found if issubclass(each.category, EnergyWarning)]

    def _naming_law(self, work: Callable[[], T]) -> T:
        """Do work whose errors and energy warnings about the custom law then begin with its place in the case."""
        key, start = (
            next(each.key for each in self.verdicts if each.law),
            f"law {type(self.law()).__name__}: ",
        )

        def named(text: str) -> str:
            return f"{f'{self.path}: ' if self.path else ''}{rules.problem_at(self.case, f'{key}.law', text)}"

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

    @property
    def _materials_of_walls(self) -> list[int]:
        return [wall.material for wall in self.free_area.all_walls]

    @property
    def law_table(self) -> list[list[CollisionLaw]]:
        """The laws, with any where two walls would meet, which never happens."""
        return [[self.law() if one is None else one for one in row] for row in self.laws]

    def verify_start(self) -> None:
        """Make the start as a run does, if that takes about a second at most; InputError if it is impossible."""
        positions = self.case.start.positions if self.case.start.placed else ""
        if self.n <= PLACED_BY_CHECK.get(positions, PLACED_BY_CHECK["random"]):
            self.tracked(self.start())

    @property
    def strips(self) -> int:
        """Number of strips of the box in which disks are placed at random, each by one rank; 0 of other starts."""
        start = self.case.start
        if self.start_region is None or not start.placed or start.positions != "random":
            return 0
        return placement.strips(
            FreeArea(self.start_region, self.walls), self.n, float(self.kinds.radius.max())
        )[1]

    @property
    def is_made_in_slices(self) -> bool:
        """True if ranks make the start in slices: drawn on a lattice or at random, or read from a file.

        Other starts need all disks at once, and are made by one process.
        """
        return self.case.start.file is not None or self.case.start.positions not in (GROWN, IMPACT_SCAN)

    def is_read_in_slices(self, ranks: int) -> bool:
        """True if each of so many ranks reads its rows of the file that gives the start."""
        start = self.case.start
        return (start.file or start.trajectory) is not None and self.is_distributed(ranks)

    def is_distributed(self, ranks: int) -> bool:
        """True if each of so many ranks has the states of its slice only: of many disks, or for a file in parts."""
        many = self.n > distribution.GATHERED or self.case.output.in_parts(self.n, ranks)
        return ranks > 1 and many and self.usable_ranks(ranks)[0] == ranks

    def usable_ranks(self, ranks: int) -> tuple[int, str]:
        """Largest number of ranks, up to `ranks`, that can share this gas, and the reason if it is smaller, else ""."""
        return (1, "") if ranks == 1 else rules.usable_ranks(self.case, self.kinds, self.box, ranks)

    def communicator(self, given: Communicator) -> Communicator:
        """The ranks that share this gas: distributed if `is_distributed` is true."""
        if given.is_distributed or not self.is_distributed(given.size):
            return given
        return Communicator(given, distributed=True)

    def _drawn_motion(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Velocities relative to the flow, shape (n, 2), and spins, (n,), that are drawn; of ranks, of the slice."""
        own, seed = self._of_species(current().slice_of(self.n)), self.case.run.seed
        numbers, first = [len(ids) for ids in own], self.species[0]
        mass = np.concatenate([each.columns(ids)[0] for each, ids in zip(self.species, own, strict=True)])
        if len(self.species) == 1 and first.temperature is None:  # exact
            velocity = placement.maxwellian(mass, speed_rms=first.speed_rms, seed=seed)
        else:
            energy = np.repeat([each.mean_energy for each in self.species], numbers)
            velocity = placement.thermal(mass, energy, seed)
        spin_rms = np.repeat([each.spin_rms for each in self.species], numbers)
        return velocity, placement.gaussian_spins(len(mass), spin_rms=spin_rms, seed=seed)

    def _coefficient(self, name: str) -> NDArray[np.float64]:
        """A coefficient of the law of each pair of materials, shape (M, M); nan without one of this meaning."""
        known = (
            [law if law is not None and law.has_ifr_symbols else None for law in row] for row in self.laws
        )
        return np.array([[getattr(law, name, math.nan) for law in row] for row in known])

    @functools.cached_property
    def free(self) -> tuple[bool, bool]:
        """True along x and y where the whole gas can drift (`model.walls.wall.free_directions`)."""
        of_disks = {self.materials.index(each.material) for each in self.species}
        e_t, mu = self._coefficient("e_t"), self._coefficient("mu")
        return free_directions(self.free_area.all_walls, smooth=smooth_materials(e_t, mu, of_disks))

    def _as_moving(self, velocity: NDArray[np.float64], spin: NDArray[np.float64]) -> CaseGas:
        """The gas with its drift, and its species with their speeds relative to it and their spins.

        Velocities (n, 2) are relative to the flow; of ranks, each gives those of its slice. One disk alone is no gas
        that drifts, and in an open box, where nothing is estimated from speeds, they are those in the lab.
        """
        comm = current()
        ids = comm.slice_of(self.n)
        drift, share = self._drift(velocity)
        squares = np.column_stack((np.sum((velocity - drift) ** 2, axis=1), spin**2))
        moving, first = [], 0
        for each, own in zip(self.species, self._of_species(ids), strict=True):
            mean = comm.total(squares[first : first + len(own)]) / each.number
            first += len(own)
            moving.append(replace(each, speed_rms=float(np.sqrt(mean[0])), spin_rms=float(np.sqrt(mean[1]))))
        return replace(self, species=tuple(moving), drift=drift, drift_share=share)

    def _drift(self, velocity: NDArray[np.float64]) -> tuple[tuple[float, float], float]:
        """Mean velocity, weighted by mass, of velocities as in `_as_moving`, and its part of their energy."""
        if self.n == 1 or self.box.is_open:
            return (0.0, 0.0), 0.0
        comm = current()
        mass = self.rows(comm.slice_of(self.n)).mass
        whole = float(comm.total(mass))
        drift = comm.total(mass[:, None] * velocity) / whole * self.free
        energy = float(comm.total(mass * np.sum(velocity**2, axis=1)))
        share = whole * float(drift @ drift) / energy if energy > 0.0 else 0.0
        return (float(drift[0]), float(drift[1])), min(share, 1.0)

    def _fastest_drawn(self) -> tuple[float, float]:
        """More than the largest speed [length/time] and spin [rad/time] that are drawn: 12 deviations."""
        speeds = [
            each.speed_rms * math.sqrt(each.summary.mass.high / each.summary.mass.low)
            for each in self.species
        ]
        return 12.0 * max(speeds), 12.0 * max(each.spin_rms for each in self.species)

    def _check_magnitudes(self) -> None:
        """Refuse what the engine or the trajectory's precision would refuse when the run begins."""
        case = self.case
        flow = 0.5 * abs(self.box.shear_rate) * self.box.lengths[1] if self.box.shear_rate else 0.0
        if self.given is not None and self.given.velocity is not None and self.given.spin is not None:
            velocity, spin, flow = self.given.velocity, self.given.spin, 0.0
        elif self.n > distribution.GATHERED:
            fast, turning = self._fastest_drawn()
            velocity, spin = np.full((len(self.kinds.mass), 2), fast), np.full(len(self.kinds.mass), turning)
        else:
            velocity, spin = self._drawn_motion()
        comm = current()
        own = comm.slice_of(self.n)
        disks = self.rows(own) if len(spin) == len(own) else self.kinds
        speed = comm.largest(checks.fastest(disks, velocity, spin))
        thermostats = ("temperature", "spin_temperature", "energy")
        set_to = [getattr(each, key, None) or 0.0 for each in case.force for key in thermostats]
        hottest = max([checks.hottest(self.walls, ()), *set_to])
        checks.check_magnitudes(self.kinds, self.box, speed + flow, case.run.precision, hottest)
        largest = {
            "a velocity": comm.largest(float(np.abs(velocity).max(initial=0.0))) + flow,
            "a spin": comm.largest(float(np.abs(spin).max(initial=0.0))),
            "a side of the box": 0.0 if self.box.is_open else max(self.box.lengths),
        }
        energy = 0.0
        if "dissipated" in case.output.fields:
            mass = disks.mass[np.isfinite(disks.mass)].max(initial=0.0)
            fall = (
                0.0
                if self.box.is_open
                else float(mass) * math.hypot(*case.box.gravity) * max(self.box.lengths)
            )
            kinetic = checks.kinetic_energy(disks, np.abs(velocity) + flow, spin)
            energy = max(hottest, comm.largest(max(kinetic, fall)))
        checks.check_stored(largest, case.output.precision, energy)
        given = self.given is not None and self.given.velocity is not None
        self._check_engine(velocity, given or self.n <= distribution.GATHERED)

    def _check_engine(self, velocity: NDArray[np.float64], known: bool) -> None:
        """Refuse what the engine would refuse, with the keys of the case.

        `velocity` (n, 2) is relative to the flow; unless `known`, those of many disks are not.
        """
        case, run, smallest = self.case, self.case.run, float(self.kinds.radius.min())
        walls, size = self.free_area.all_walls, "lengths" if self.case.box.lengths else "packing_fraction"
        gravity = (case.box.gravity[0], case.box.gravity[1])
        meets_none = known and not walls and not self.box.is_open and self.box.shear_rate == 0.0
        alone = 0.0
        if meets_none and (self.n == 1 or checks.fly_alike(velocity)):
            alone = current().largest(float(np.hypot(*velocity.T).max(initial=0.0)))
        refused = {
            ("box", size): lambda: checks.check_resolved(self.n, smallest, self.box, run.precision),
            ("run", "t_end"): lambda: checks.check_duration(
                self.begin[0], run.t_end or 0.0, smallest, self.box, alone
            ),
            ("run", "collapse"): lambda: checks.check_collapse(
                run.made_collapse(),
                self.kinds,
                self.box,
                walls,
                gravity,
                self._coefficient("e_n"),
                run.made_device(),
            ),
        }
        found = self._lying(velocity, walls, gravity) if known else []
        for verdict, *pair in self.approach_speeds:
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

    def _lying(
        self,
        velocity: NDArray[np.float64],
        walls: Sequence[Wall],
        gravity: tuple[float, float],
    ) -> list[str]:
        """Problem about disks that a start file places at rest on walls, where only resting contacts hold them."""
        if self.given is None or self.case.run.collapse == "rest":
            return []
        comm, start = current(), self.case.start
        ids = comm.slice_of(self.n)
        rests = checks.at_rest_on_walls(self.given.position, velocity, self.rows(ids).radius, walls, gravity)
        here = None if rests is None else (ids.start + rests[0], rests[1])
        of_ranks = comm.allgather(here)
        if not any(of_ranks):
            return []
        rests = min(each for each in of_ranks if each)
        key, value = ("positions", start.positions) if start.file is None else ("file", start.file)
        wall = wall_names(walls, self.box)[rests[1]]
        text = f"disk {rests[0]} lies on {wall} without speed, and has no next collision"
        text += ': set run.collapse = "rest", or give it a gap or a speed'
        return [str(Problem(f"start.{key}", json.dumps(value), text))]

    def simulation(
        self,
        state: State | None = None,
        *,
        tracked: NDArray[np.int32] | None = None,
        comm: Communicator = SERIAL,
    ) -> Simulation:
        """The simulation of this gas on the case's device, from its start or from another `state`.

        What `warnings` says is not said again. `tracked` disks, which have histories, else come from the case and the
        start. All ranks of MPI (`comm`) that share it call this. A `state` of ranks is that of all disks, on the root;
        or that of the slice, on each rank, where they are distributed.
        """
        self.case.run.choose_runtime()
        comm = self.communicator(comm)
        distributed = comm.is_distributed

        def read_start() -> State | None:
            drawn = distributed and self.given is None and self.is_made_in_slices
            return self.start() if state is None and not drawn else state

        begin: Any = comm.run_on_root(read_start)
        disks = self.disks if comm.is_root and not distributed else None
        if distributed:
            mode = comm.bcast("drawn" if begin is None else "whole" if begin.n == self.n else "slices")
            if mode == "whole":
                with comm:
                    disks, begin = scatter_state(None if begin is None else self.disks, begin)
            else:
                disks = self.rows(comm.slice_of(self.n))
                with comm:
                    begin = self.start() if mode == "drawn" else state
        if tracked is None:
            tracked = comm.result_of_holders(lambda: self.tracked(begin))
        given = {**self.setup.arguments, "disks": disks, "state": begin, "tracked": tracked, "comm": comm}
        if is_sampled(type(self.law())):  # the simulation checks it
            return self._naming_law(lambda: Simulation(**given))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyWarning)
            return Simulation(**given)

    @property
    def setup(self) -> Setup:
        """The setup of this gas. Imports the runtime if there are forces."""
        case = self.case
        return Setup(
            box=self.box, law=tuple(map(tuple, self.law_table)), walls=self._walls_at_start,
            gravity=case.box.made_gravity(), forces=tuple(each.made() for each in case.force),
            collapse=case.run.made_collapse(), device=case.run.made_device(),
            record=frozenset(case.output.record()), seed=case.run.seed,
        )  # fmt: skip

    @property
    def _walls_at_start(self) -> tuple[Wall, ...]:
        return self.walls if self.given is None else self.given.with_pistons(self.walls)

    def tracked(self, start: State) -> NDArray[np.int32]:
        """Disks that have histories, ascending; of ranks (`Communicator`), each gives the start of its slice.

        Raises InputError if no disk starts in the region of the histories.
        """
        comm, output, rng = current(), self.case.output, seeds.stream(self.case.run.seed, seeds.HISTORIES)
        own = output.tracked(self.n, rng, start.position, comm.slice_of(self.n).start)
        found = np.unique(np.concatenate(comm.allgather(own)))
        if output.tracks and not len(found):
            region = str(output.histories_region)
            raise InputError(str(Problem("output.histories_region", region, "no disk starts there")))
        return found

    def _placed(self, progress: Callable[[float], None]) -> NDArray[np.float64]:
        mode, seed = self.case.start.positions, self.case.run.seed
        assert self.start_region is not None  # the rules have seen to it
        comm = current()
        disks = self.disks if comm.size == 1 else self.rows(comm.slice_of(self.n))
        radius, options = disks.radius, dict[str, Any](seed=seed, walls=self.walls)
        try:
            if mode == "hexagonal":
                # Several species would lie in layers else.
                options["seed"] = seed if len(self.species) > 1 or not self.species[0].equal else None
                return placement.hexagonal_positions(self.start_region, radius, **options)
            if mode == GROWN:
                return packing.grow(self.start_region, radius, progress=progress, **options)
            return placement.random_positions(self.start_region, radius, **options)
        except InputError as error:
            raise InputError(str(Problem("start.positions", f'"{mode}"', str(error)))) from None


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
            elif not replace(gas, box=box).is_read_in_slices(ranks):
                given = rules.given_start(case, gas.disks.radius, FreeArea(box, standing), folder, found)
    found += rules.check_output(case, kinds.n, box)
    return replace(gas, box=box, start_region=start_region, given=given), found
