"""A case before it is known to be right: its sections one by one, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from ..errors import InputError
from ..initial import radii
from ..model.box import Box
from ..model.coin_table import coins
from ..model.walls import Motion, Wall
from ..tools import seeds
from .case import BoxSection, Case, MaterialSection, PairSection, RunSection, SpeciesSection, StartSection
from .forces_section import ForceSection
from .output_section import OutputSection
from .section import Section
from .walls_section import WallSection

S = TypeVar("S", bound=Section)


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where, what stands there (as text; None where nothing does), why."""

    key: str
    value: str | None
    text: str

    def __str__(self) -> str:
        place = self.key if self.value is None else f"{self.key} = {self.value}"
        return f"{place}: {self.text}"


CLASSES = 16
"""Groups of like radii that stand for a species with many, where a sum over all pairs would be long."""


@dataclass(frozen=True, eq=False)
class Species:
    """Disks of one kind.

    Attributes
    ----------
    name, material : str
        What they are called, and what they are made of.
    number : int
        How many there are.
    mass, radius : array (number,)
        Masses [mass] and radii [length]; a single number is taken for all of them.
    k : float
        Shape number.
    speed_rms, spin_rms : float
        Root mean square speed [length/time] and spin [rad/time] at the start.
    """

    name: str
    material: str
    number: int
    mass: NDArray[np.float64]
    radius: NDArray[np.float64]
    k: float
    speed_rms: float
    spin_rms: float

    def __post_init__(self) -> None:
        for name in ("mass", "radius"):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, np.broadcast_to(value, (self.number,)))

    @property
    def equal(self) -> bool:
        """Whether all of them have one mass and radius."""
        return all(column.strides == (0,) or np.ptp(column) == 0.0 for column in (self.mass, self.radius))

    def classes(self) -> list[Species]:
        """Species of equal disks that stand for these: one for each radius, or `CLASSES` groups of like radii.

        Speeds are those of a Maxwellian of the whole: components have a variance that goes as 1/m.
        """
        if self.equal:
            return [self]
        values, group = np.unique(self.radius, return_inverse=True)
        if len(values) > CLASSES:
            order = np.argsort(self.radius, kind="stable")
            group = np.empty(self.number, dtype=np.intp)
            group[order] = np.arange(self.number) * CLASSES // self.number
        per_mass = 1.0 / self.mass
        found = []
        for one in range(min(len(values), CLASSES)):
            own = group == one
            speed = self.speed_rms * np.sqrt(per_mass[own].mean() / per_mass.mean())
            size = int(np.count_nonzero(own))
            mass, radius = (np.array(column[own].mean()) for column in (self.mass, self.radius))
            found.append(replace(self, number=size, mass=mass, radius=radius, speed_rms=float(speed)))
        return found


@dataclass(frozen=True)
class Draft:
    """The sections of a case, with None for each that is not valid by itself."""

    run: RunSection | None
    box: BoxSection | None
    material: tuple[MaterialSection | None, ...]
    pair: tuple[PairSection | None, ...]
    species: tuple[SpeciesSection | None, ...]
    start: StartSection | None
    material_names: tuple[str, ...]  # those of sections with mistakes too
    force: tuple[ForceSection | None, ...] = ()
    wall: tuple[WallSection | None, ...] = ()
    output: OutputSection | None = None

    @classmethod
    def from_sections(cls, raw: Mapping[str, Any]) -> Draft:
        """From the parsed text of a case file."""

        def one(model: type[S], value: Any) -> S | None:
            try:
                return model.model_validate(value)
            except ValidationError:
                return None

        def several(model: type[S], value: Any) -> tuple[S | None, ...]:
            return tuple(one(model, each) for each in value) if isinstance(value, list) else (None,)

        materials = raw.get("material")
        return cls(
            run=one(RunSection, raw.get("run")),
            box=one(BoxSection, raw.get("box")),
            material=several(MaterialSection, raw.get("material", [])),
            pair=several(PairSection, raw.get("pair", [])),
            species=several(SpeciesSection, raw.get("species")),
            start=one(StartSection, raw.get("start", {})),
            material_names=tuple(
                each["name"]
                for each in (materials if isinstance(materials, list) else ())
                if isinstance(each, Mapping) and isinstance(each.get("name"), str)
            ),
            force=several(ForceSection, raw.get("force", [])),
            wall=several(WallSection, raw.get("wall", [])),
            output=one(OutputSection, raw.get("output", {})),
        )

    @classmethod
    def from_case(cls, case: Case) -> Draft:
        """From a case whose sections are all valid."""
        return cls(
            case.run,
            case.box,
            tuple(case.material),
            tuple(case.pair),
            tuple(case.species),
            case.start,
            tuple(each.name for each in case.material),
            tuple(case.force),
            tuple(case.wall),
            case.output,
        )

    @property
    def sets_in_motion(self) -> bool:
        """Whether a flow, a force, a wall or gravity moves disks that are at rest, or may: one with mistakes counts."""
        if self.box is not None and self.box.shear_rate != 0.0:
            return True
        moving = ("kicks", "langevin")
        forces = any(
            each is None or (each.kind in moving and each.temperature != 0.0 and each.rate != 0.0)
            for each in self.force
        )
        walls = any(each is None or each.motion is not None for each in self.wall)
        return forces or walls or (self.box is not None and any(self.box.gravity))

    def materials_of_walls(self) -> dict[str, str]:
        """The materials of walls, each with the key that names it first; that of the sides of the box comes first."""
        found: dict[str, str] = {}
        if self.box is not None and self.box.material is not None:
            found[self.box.material] = "box.material"
        for i, each in enumerate(self.wall):
            if each is not None and each.material is not None:
                found.setdefault(each.material, f"wall[{i}].material")
        return found

    def known_species(self) -> list[Species]:
        """The species that are in order, with the radii that the run's seed gives them."""
        seed = self.run.seed if self.run is not None else 0
        found = []
        for i, each in enumerate(self.species):
            if each is None or (each.coin is not None and each.coin not in coins):
                continue
            if each.coin is not None:
                coin = coins[each.coin]
                mass, radius, k = np.array(coin.mass), np.array(coin.radius), coin.k
            else:
                try:
                    radius = _radius(each, seeds.of_species(seed, i))
                except InputError:
                    continue
                k = each.k
                # Exactly one of the two is given: the section's alternatives see to it.
                mass = (
                    np.array(each.mass)
                    if each.mass is not None
                    else _area(radius) * (each.areal_density or 0.0)
                )
            material = each.material if each.material is not None else (each.coin or "")
            found.append(
                Species(each.name, material, each.number, mass, radius, k, each.speed_rms, each.spin_rms)
            )
        return found


def _radius(section: SpeciesSection, seed: int) -> NDArray[np.float64]:
    """The radii of a species [length], shape (number,), or () if they are equal."""
    if section.radii is not None:
        return radii.sample(section.radii.distribution, section.number, seed=seed, **section.radii.parameters)
    return np.array(section.radius if section.radius is not None else 0.5 * (section.diameter or 0.0))


def _area(radius: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.pi * np.square(radius)


def box_around(section: BoxSection, radius: NDArray[np.float64]) -> Box:
    """The box that a section describes, for disks of these radii [length], shape (n,).

    Raises
    ------
    InputError
        If they can never cover that fraction of it.
    """
    if section.open:
        return Box.open()
    patch = patch_of(section, radius)
    assert patch is not None  # the section's alternatives see to it
    return patch


def patch_of(section: BoxSection, radius: NDArray[np.float64]) -> Box | None:
    """The rectangle that a section gives a size: the box, or where disks of an open one start; None if it gives none.

    Raises
    ------
    InputError
        As `box_around`.
    """
    periodic = (section.periodic[0], section.periodic[1])
    if section.lengths is not None:
        return Box((section.lengths[0], section.lengths[1]), periodic, section.shear_rate)
    if section.packing_fraction is None:
        return None
    found = Box.from_packing_fraction(radius, section.packing_fraction, section.aspect)
    return Box(found.lengths, periodic, section.shear_rate)


def walls_of(sections: Sequence[WallSection | None], materials: Sequence[str] | None = None) -> list[Wall]:
    """The walls that sections describe; those with mistakes are left out.

    `materials` are the names of the rows of the law's table; without them all walls get row 0.
    """
    return [
        wall_of(each, 0 if materials is None or each.material is None else materials.index(each.material))
        for each in sections
        if each is not None
    ]


def wall_of(section: WallSection, material: int = 0) -> Wall:
    """The wall that a section describes, of the material in this row of the law's table."""
    options: dict[str, Any] = {"material": material, "surface_speed": section.surface_speed}
    if section.motion is not None:
        options["motion"] = Motion(**section.motion.model_dump(exclude_none=True))
    if section.temperature is not None:
        options["temperature"] = section.temperature

    def point(value: list[float] | None) -> tuple[float, float]:
        assert value is not None  # the section's own check sees to it
        return value[0], value[1]

    match section.shape:
        case "line":
            return Wall.line(point(section.point), point(section.normal), **options)
        case "segment":
            return Wall.segment(point(section.start), point(section.end), **options)
        case "container":
            return Wall.container(point(section.center), section.radius or 0.0, **options)
        case "post":
            return Wall.post(point(section.center), section.radius or 0.0, **options)
