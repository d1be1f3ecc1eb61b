"""The gas that a case describes: disks, box, walls and laws; the setup and the simulation of it."""

from __future__ import annotations

import functools
import math
import operator
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, listed
from ..initial.from_csv import StartData
from ..model.box import Box
from ..model.laws.ifr import EnergyWarning
from ..model.laws.law import CollisionLaw
from ..model.laws.sampling import is_sampled
from ..model.setup import Setup
from ..model.state import DiskKinds, Disks, State, merge_kinds, scatter_state
from ..model.walls.free_area import FreeArea
from ..model.walls.wall import Wall, free_directions, smooth_materials
from ..mpi import SERIAL, Communicator, distribution
from ..simulation.simulation import Simulation
from . import rules, starts
from .case import IMPACT_SCAN, CaseSections
from .pair_rules import PairVerdict
from .species import Species


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
        from . import checks  # which makes a gas

        gas, problems = checks.validate_case(case, Path(folder), start=start)
        if problems:
            raise InputError(listed([str(problem) for problem in problems]))
        return checks.ready(gas) if start else gas

    def __getstate__(self) -> dict[str, Any]:
        """Its fields: what is computed from them, such as all disks, is not sent to other ranks and processes."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @functools.cached_property
    def disks(self) -> Disks:
        """The disks, species by species."""
        return self.rows(range(self.n))

    @property
    def n(self) -> int:
        """Number of disks."""
        return sum(each.number for each in self.species)

    def rows(self, ids: range) -> Disks:
        """The disks of some ids."""
        own = self.of_species(ids)
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

    def of_species(self, ids: range) -> list[range]:
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
            own = self.of_species(block)
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
        """Free area at the start, which stresses refer to [length^2]; None if none is stored."""
        output = self.case.output
        if not (output.stress or output.heat_flux):
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
    def materials_of_walls(self) -> list[int]:
        return [wall.material for wall in self.free_area.all_walls]

    @property
    def law_table(self) -> list[list[CollisionLaw]]:
        """The laws, with any where two walls would meet, which never happens."""
        return [[self.law() if one is None else one for one in row] for row in self.laws]

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

    def coefficient(self, name: str) -> NDArray[np.float64]:
        """A coefficient of the law of each pair of materials, shape (M, M); nan without one of this meaning."""
        known = (
            [law if law is not None and law.has_ifr_symbols else None for law in row] for row in self.laws
        )
        return np.array([[getattr(law, name, math.nan) for law in row] for row in known])

    @functools.cached_property
    def free(self) -> tuple[bool, bool]:
        """True along x and y where the whole gas can drift (`model.walls.wall.free_directions`)."""
        of_disks = {self.materials.index(each.material) for each in self.species}
        e_t, mu = self.coefficient("e_t"), self.coefficient("mu")
        return free_directions(self.free_area.all_walls, smooth=smooth_materials(e_t, mu, of_disks))

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
        from . import checks

        self.case.run.choose_runtime()
        comm = self.communicator(comm)
        distributed = comm.is_distributed

        def read_start() -> State | None:
            drawn = distributed and self.given is None and starts.is_made_in_slices(self)
            return starts.start(self) if state is None and not drawn else state

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
                    begin = starts.start(self) if mode == "drawn" else state
        if tracked is None:
            tracked = comm.result_of_holders(lambda: starts.tracked(self, begin))
        given = {**self.setup.arguments, "disks": disks, "state": begin, "histories": tracked, "comm": comm}
        if is_sampled(type(self.law())):  # the simulation checks it
            return checks.naming_law(self, lambda: Simulation(**given))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyWarning)
            return Simulation(**given)

    @property
    def setup(self) -> Setup:
        """The setup of this gas. Imports the runtime if there are forces."""
        case = self.case
        regions: Any = case.output.regions
        return Setup(
            box=self.box, law=tuple(map(tuple, self.law_table)), walls=self._walls_at_start,
            gravity=case.box.made_gravity(), forces=tuple(each.made() for each in case.force),
            collapse=case.run.made_collapse(), device=case.run.made_device(),
            record=frozenset(case.output.record()), regions=regions, seed=case.run.seed,
        )  # fmt: skip

    @property
    def _walls_at_start(self) -> tuple[Wall, ...]:
        return self.walls if self.given is None else self.given.with_pistons(self.walls)
