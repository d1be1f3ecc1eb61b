"""The species of a case: numbers, masses and radii of its disks, sampled by the run's seed."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..initial import radii
from ..model.laws.coin_table import coins
from ..model.state import Kinds, extremes, kinds_among, merge_kinds
from ..mpi import distribution
from ..tools import seeds
from .case import CaseSections, RadiiSection, SpeciesSection

CLASSES = 16
"""Groups of like radii that stand for a species with many, where a sum over all pairs would be long."""


class Spread(NamedTuple):
    """Smallest, largest and mean one of some numbers."""

    low: float
    high: float
    mean: float


class Overview(NamedTuple):
    """Kinds, spreads and sums of all disks of a species, of which no array is kept."""

    kinds: Kinds  # of material 0
    mass: Spread  # [mass]
    radius: Spread  # [length]
    sums: dict[range, tuple[float, float]]  # of R^2 and of R, for some ids


@dataclass(frozen=True, eq=False)
class Species:
    """Disks of one kind, or of radii that are drawn. They may be many, and so nothing here is an array of all."""

    name: str
    material: str
    number: int
    mass: float | None  # [mass]; None if each has its own, areal_density pi R^2
    radius: float | RadiiSection  # [length]; a distribution, from which they are drawn
    k: float  # shape number
    speed_rms: float  # root mean square at the start [length/time]
    spin_rms: float  # the same of spins [rad/time]
    areal_density: float = 0.0  # [mass/length^2]
    seed: int = 0  # of the radii that are drawn
    temperature: float | None = None  # at the start, if that is given [energy]; speed_rms follows from it

    def columns(self, ids: range) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Masses [mass] and radii [length] of some of them, numbered from 0 on; shape (len(ids),) each."""
        if isinstance(self.radius, RadiiSection):
            of, given = self.radius.distribution, self.radius.parameters
            radius = radii.of_ids(of, self.number, ids, seed=self.seed, **given)
        else:
            radius = np.full(len(ids), self.radius)
        if self.mass is None:
            return np.pi * np.square(radius) * self.areal_density, radius
        return np.full(len(ids), self.mass), radius

    @functools.cached_property
    def summary(self) -> Overview:
        """Kinds, spreads and sums of all of them, from a look at one block after another."""
        kinds: Kinds | None = None
        sums, totals = {}, np.zeros(2)
        numbers = range(self.number if isinstance(self.radius, RadiiSection) else 1)
        for ids in distribution.blocks(numbers):
            mass, radius = self.columns(ids)
            rows = [mass, radius, np.full(len(ids), self.k), np.zeros(len(ids), dtype=np.int32)]
            if kinds is None:
                kinds = kinds_among(rows)
            else:  # many kinds are not distinguished any more
                kinds = merge_kinds([kinds, kinds_among(rows) if kinds[1] else (extremes(rows), False)])
            sums[ids] = _sums(radius)
            totals += np.sum(mass), np.sum(radius)
        assert kinds is not None  # each has a disk
        of_mass, of_radius = (
            Spread(float(column.min()), float(column.max()), float(total / len(numbers)))
            for column, total in zip(kinds[0][:2], totals, strict=True)
        )
        return Overview(kinds, of_mass, of_radius, sums)

    @property
    def equal(self) -> bool:
        """True if all of them have one mass and radius."""
        return all(each.low == each.high for each in (self.summary.mass, self.summary.radius))

    def at_temperature(self, temperature: float) -> Species:
        """This species with the rms speed that belongs to a temperature [energy]: <v^2> = 2 T <1/m>."""
        return replace(self, speed_rms=float(np.sqrt(2.0 * temperature * self._per_mass)))

    @property
    def mean_energy(self) -> float:
        """Mean of m v^2 / 2 at the start [energy], of Maxwellian velocities: the temperature."""
        return 0.5 * self.speed_rms**2 / self._per_mass if self.temperature is None else self.temperature

    @functools.cached_property
    def _per_mass(self) -> float:
        """<1/m> of its disks [1/mass]."""
        numbers = range(self.number if self.mass is None else 1)
        whole = sum(float(np.sum(1.0 / self.columns(ids)[0])) for ids in distribution.blocks(numbers))
        return whole / len(numbers)

    def sums(self, ids: range) -> tuple[float, float]:
        """Sums of R^2 [length^2] and of R [length] over some of them, as NumPy adds them up."""
        ids = ids if isinstance(self.radius, RadiiSection) else range(len(ids))
        if ids not in self.summary.sums:
            self.summary.sums[ids] = _sums(self.columns(ids)[1])
        return self.summary.sums[ids]

    def classes(self) -> list[Species]:
        """Species of equal disks that stand for these: one for each radius, or `CLASSES` groups of like radii.

        Speeds are those of a Maxwellian of the whole: components have a variance that goes as 1/m. The first block of
        disks (`distribution.BLOCK`) stands for all.
        """
        if self.equal:
            return [self]
        mass, radius = self.columns(range(min(self.number, distribution.BLOCK)))
        values, group = np.unique(radius, return_inverse=True)
        if len(values) > CLASSES:
            order = np.argsort(radius, kind="stable")
            group = np.empty(len(radius), dtype=np.intp)
            group[order] = np.arange(len(radius)) * CLASSES // len(radius)
        per_mass = 1.0 / mass
        found = []
        for one in range(min(len(values), CLASSES)):
            own = group == one
            speed = self.speed_rms * np.sqrt(per_mass[own].mean() / per_mass.mean())
            size = round(int(np.count_nonzero(own)) * self.number / len(radius))
            m, R = (float(column[own].mean()) for column in (mass, radius))
            found.append(replace(self, number=size, mass=m, radius=R, speed_rms=float(speed)))
        return found


def _sums(radius: NDArray[np.float64]) -> tuple[float, float]:
    return float(np.sum(np.square(radius))), float(np.sum(radius))


def species_of(case: CaseSections) -> tuple[Species, ...]:
    """The species of a case, with the radii that the run's seed gives them."""
    return tuple(_species(each, seeds.of_species(case.run.seed, i)) for i, each in enumerate(case.species))


def _species(section: SpeciesSection, seed: int) -> Species:
    mass, k, per_area = section.mass, section.k, section.areal_density or 0.0
    radius = section.radii or section.radius or 0.5 * (section.diameter or 0.0)
    if section.coin is not None:
        coin = coins[section.coin]
        mass, radius, k = coin.mass, coin.radius, coin.k
    # Exactly one of mass and areal_density is given: the section's alternatives see to it.
    elif mass is None and not isinstance(radius, RadiiSection):
        mass = float(np.pi * np.square(radius) * per_area)
    material = section.material or section.coin or ""
    found = Species(
        section.name, material, section.number, mass, radius, k, section.speed_rms, section.spin_rms, per_area, seed,
        section.temperature,
    )  # fmt: skip
    return found if found.temperature is None else found.at_temperature(found.temperature)
