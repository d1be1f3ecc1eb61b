"""The species of a case: numbers, masses and radii of its disks, sampled by the run's seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..initial import radii
from ..model.coin_table import coins
from ..tools import seeds
from .case import Case, SpeciesSection

CLASSES = 16
"""Groups of like radii that stand for a species with many, where a sum over all pairs would be long."""


@dataclass(frozen=True, eq=False)
class Species:
    """Disks of one kind."""

    name: str
    material: str
    number: int
    mass: NDArray[np.float64]  # (number,) [mass]; a single number is taken for all of them
    radius: NDArray[np.float64]  # (number,) [length]; likewise
    k: float  # shape number
    speed_rms: float  # root mean square at the start [length/time]
    spin_rms: float  # the same of spins [rad/time]

    def __post_init__(self) -> None:
        for name in ("mass", "radius"):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, np.broadcast_to(value, (self.number,)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Class and arguments that rebuild it elsewhere: one mass and radius where they are the memory of all."""
        mass, radius = (each[0] if each.strides == (0,) else each for each in (self.mass, self.radius))
        return Species, (
            self.name, self.material, self.number, mass, radius, self.k, self.speed_rms, self.spin_rms,
        )  # fmt: skip

    @property
    def equal(self) -> bool:
        """True if all of them have one mass and radius."""
        return all(column.strides == (0,) or np.ptp(column) == 0.0 for column in (self.mass, self.radius))

    def values(self, name: str) -> NDArray[np.float64]:
        """Masses or radii, one number for all where it is the memory of all: for what does not depend on how many."""
        column: NDArray[np.float64] = getattr(self, name)
        return column[:1] if column.strides == (0,) else column

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


def species_of(case: Case) -> tuple[Species, ...]:
    """The species of a case, with the radii that the run's seed gives them."""
    return tuple(_species(each, seeds.of_species(case.run.seed, i)) for i, each in enumerate(case.species))


def _species(section: SpeciesSection, seed: int) -> Species:
    if section.coin is not None:
        coin = coins[section.coin]
        mass, radius, k = np.array(coin.mass), np.array(coin.radius), coin.k
    else:
        radius, k = _radius(section, seed), section.k
        # Exactly one of the two is given: the section's alternatives see to it.
        per_area = section.areal_density or 0.0
        mass = np.array(section.mass) if section.mass is not None else np.pi * np.square(radius) * per_area
    material = section.material or section.coin or ""
    return Species(
        section.name, material, section.number, mass, radius, k, section.speed_rms, section.spin_rms
    )


def _radius(section: SpeciesSection, seed: int) -> NDArray[np.float64]:
    """The radii of a species [length], shape (number,), or () if they are equal."""
    if section.radii is not None:
        return radii.sample(section.radii.distribution, section.number, seed=seed, **section.radii.parameters)
    return np.array(section.radius if section.radius is not None else 0.5 * (section.diameter or 0.0))
