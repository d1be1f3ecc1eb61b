"""The gas that a case describes: disks, box and laws, and how they start."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import growth, placement, seeds, start_file, start_frame
from .box import Box
from .case import Case, is_trajectory
from .draft import Draft, Problem, Species, box_around
from .errors import InputError
from .law import EnergyWarning, IFRLaw
from .pairing import PairVerdict, verdicts
from .problems import problems
from .simulation import Simulation
from .stage import Stage
from .start_file import Given
from .state import Disks, State

if TYPE_CHECKING:
    from .forces import Force


@dataclass(frozen=True)
class Gas:
    """What moves, where, and how it collides.

    Attributes
    ----------
    species : tuple of Species
        In the order of the disks' ids.
    materials : tuple of str
        Names of the materials that occur, in the order of `laws`.
    laws : list of lists of IFRLaw
        The law of each pair of materials.
    verdicts : tuple of PairVerdict
        Admissibility of each pair of species.
    disks : Disks
        The disks, species by species.
    box : Box
        The box.
    given : Given or None
        The start, if the case names a file or a trajectory with it.
    """

    species: tuple[Species, ...]
    materials: tuple[str, ...]
    laws: list[list[IFRLaw]]
    verdicts: tuple[PairVerdict, ...]
    disks: Disks
    box: Box
    given: Given | None = None

    @classmethod
    def from_case(cls, case: Case, folder: Path | str = ".") -> Gas:
        """The gas of a case; a start file's path begins at `folder`.

        Raises
        ------
        InputError
            With a line for each thing that is wrong.
        """
        draft = Draft.from_case(case)
        found = problems(draft, Path(folder))
        if found:
            raise InputError("\n".join(str(problem) for problem in found))
        species = tuple(draft.known_species())
        materials = tuple(dict.fromkeys(each.material for each in species))
        judged = tuple(verdicts(draft, list(species)))
        laws = [[_law_between(judged, species, a, b) for b in materials] for a in materials]
        disks = _disks(species, materials)
        box = box_around(case.box, disks.radius)
        given = None
        if case.start.file is not None:
            given = start_file.read(Path(folder) / case.start.file, disks.n, box)
        elif is_trajectory(case.start.positions):
            path = Path(folder) / case.start.positions
            given = start_frame.read(path, case.start.frame, disks.radius, box, motion=case.start.motion)
            if given.velocity is not None:  # there was no flow
                given = replace(given, velocity=given.velocity + box.flow(given.position))
        if given is not None:
            species = _as_moving(species, given, box)
        return cls(species, materials, laws, judged, disks, box, given)

    @property
    def warnings(self) -> list[str]:
        """One text for each law that only the loss along the line of centres keeps from adding energy."""
        texts = dict.fromkeys(each.message for each in self.verdicts if each.admissible and not each.strict)
        return list(texts)

    def start(self, case: Case) -> State:
        """The state at time 0, without overlaps.

        Raises
        ------
        InputError
            If the disks do not fit into the box in the way the case wants: a line with the key.
        """
        seed = case.run.seed
        if self.given is not None:
            position = self.given.position
            if self.given.velocity is not None and self.given.spin is not None:
                return State(position=position, velocity=self.given.velocity, spin=self.given.spin)
        else:
            position = self._placed(case.start.positions, seed)
        velocity, spin = [], []
        for i, each in enumerate(self.species):
            own = seeds.of_species(seed, i)
            velocity.append(placement.maxwellian(each.mass, speed_rms=each.speed_rms, seed=own))
            spin.append(placement.gaussian_spins(each.number, spin_rms=each.spin_rms, seed=own))
        flow = self.box.flow(position)
        return State(position=position, velocity=np.concatenate(velocity) + flow, spin=np.concatenate(spin))

    def simulation(self, case: Case, state: State | None = None, *, skin: float | None = None) -> Simulation:
        """The simulation of this gas on the case's device, from its start or from another `state`.

        What `warnings` says is not said again. A `skin` [length] overrides the engine's own choice.
        """
        options: dict[str, Any] = {"arch": case.run.arch, "threads": case.run.threads, "skin": skin}
        if case.run.precision != "f64":
            options["precision"] = case.run.precision
        if case.force:
            options |= {"forces": forces_of(case), "seed": case.run.seed}
        begin = self.start(case) if state is None else state
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyWarning)
            return Simulation(self.disks, self.box, self.laws, begin, **options)

    def _placed(self, way: str, seed: int) -> NDArray[np.float64]:
        try:
            if way == "hexagonal":
                # Several species would lie in layers else.
                dealt = seed if len(self.species) > 1 or not self.species[0].equal else None
                return placement.hexagonal_positions(self.box, self.disks.radius, seed=dealt)
            if way == "growth":
                return growth.grow(self.box, self.disks.radius, seed=seed, progress=Stage("growth"))
            return placement.random_positions(self.box, self.disks.radius, seed=seed)
        except InputError as error:
            raise InputError(str(Problem("start.positions", f'"{way}"', str(error)))) from None


def forces_of(case: Case) -> list[Force]:
    """The forces of a case, in its order. Imports Taichi."""
    from .forces import Drag, Langevin, RandomKicks, Rescale, SpinKicks

    kinds: dict[str, Callable[..., Force]] = {
        "kicks": RandomKicks,
        "spin_kicks": SpinKicks,
        "langevin": Langevin,
        "drag": Drag,
        "rescale": Rescale,
    }
    return [kinds[each.kind](**each.model_dump(exclude={"kind"}, exclude_none=True)) for each in case.force]


def _as_moving(species: tuple[Species, ...], given: Given, box: Box) -> tuple[Species, ...]:
    """The species with the speeds, relative to the flow, and spins of a start file, if it has them."""
    if given.velocity is None or given.spin is None:
        return species
    peculiar = given.velocity - box.flow(given.position)
    moving, first = [], 0
    for each in species:
        own = slice(first, first + each.number)
        first += each.number
        speed_rms = float(np.sqrt(np.mean(np.sum(peculiar[own] ** 2, axis=1))))
        spin_rms = float(np.sqrt(np.mean(given.spin[own] ** 2)))
        moving.append(replace(each, speed_rms=speed_rms, spin_rms=spin_rms))
    return tuple(moving)


def _disks(species: tuple[Species, ...], materials: tuple[str, ...]) -> Disks:
    def column(values: list[float]) -> NDArray[np.float64]:
        return np.repeat(np.array(values), [each.number for each in species])

    return Disks(
        n=sum(each.number for each in species),
        mass=np.concatenate([each.mass for each in species]),
        radius=np.concatenate([each.radius for each in species]),
        k=column([each.k for each in species]),
        material=column([materials.index(each.material) for each in species]).astype(np.int32),
    )


def _law_between(judged: tuple[PairVerdict, ...], species: tuple[Species, ...], a: str, b: str) -> IFRLaw:
    """The law of two materials, made for the largest mean k of the species that have them."""
    material = {each.name: each.material for each in species}
    laws = [
        each.law
        for each in judged
        if each.law is not None and {material[each.first], material[each.second]} == {a, b}
    ]
    return max(laws, key=lambda law: law.k)
