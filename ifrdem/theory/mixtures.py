"""Kinetic theory of a homogeneous gas of several species of disks: their temperatures as it cools, or is driven.

The picture of `cooling_gas`, with a translational and a rotational temperature for every species: nothing makes
them agree where collisions dissipate. `collisions` gives the change in a collision and how often
species meet; every disk of species i then has

    dT_i/dt = sum_j w_ij <dE_i>_j,    dT_rot,i/dt = 2 sum_j w_ij <dE_rot,i>_j.

A. Santos, arXiv:1803.04290, has the same for disks of constant roughness.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..model.laws.law import CollisionLaw
from ..model.laws.pairs import check_symmetric
from ..model.state import Disks, kinds_of, unlike
from ..tools.checked import (
    Array,
    NonNegative,
    NonNegativeColumn,
    NonNegativePerDisk,
    PositivePerDisk,
    must_be,
    validated,
)
from .collisions import Collider, checked_law, energy_changes, mixture_collision_rates
from .contact import Contact, PackingFraction, mixture_contact_values
from .cooling_gas import checked_times, cooled, integrated
from .driven_gas import Driving

SETTLED, LONGEST = 1e-8, 1e6
"""Change of temperature ratios per collision that counts as none; most collisions per disk until then."""
MOST_SPECIES = 64  # every pair of them is summed at every step


def _laws(name: str, law: Any) -> CollisionLaw | tuple[tuple[CollisionLaw | None, ...], ...]:
    """One law, or a table; None in it stands for materials that never meet, as in `Trajectory.laws`."""
    if not isinstance(law, Sequence) or isinstance(law, str):
        return checked_law(name, law)
    if not law or not all(isinstance(row, Sequence) and not isinstance(row, str) for row in law):
        raise must_be(name, law, "a law, or a table of laws, [material][material]")
    return tuple(
        tuple(None if one is None else checked_law(f"{name}[{a}][{b}]", one) for b, one in enumerate(row))
        for a, row in enumerate(law)
    )


LawTable = Annotated[CollisionLaw | Sequence[Sequence[CollisionLaw | None]], _laws]
"""One law for all pairs, or a table of laws."""


@dataclass(frozen=True)
class Mixture:
    """Species of a homogeneous gas, s of them.

    InputError if a property is not positive, shapes do not fit, a law could add energy for a pair, has no known
    averages, has rolling friction, or differs between `[i][j]` and `[j][i]`; or the packing fraction or `contact` is
    impossible.

    Parameters
    ----------
    mass, radius, k : array_like (s,)
        Of one disk of each species [mass], [length], shape numbers in I = m R^2 / k.
    law : law that has averages, or sequence of sequences of them
        One for all pairs, or a symmetric table `[species][species]`. Without rolling friction.
    packing_fraction : float
        Part of the area that all disks together cover.
    fraction : array_like (s,), optional
        What part of all disks each species is, in any unit (numbers of disks do); equal parts without it.
    contact : {"virial", "henderson", "dilute"}
        Contact values: see `contact.contact_value_coefficients`.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> law = IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    >>> mixture = theory.Mixture([1.0, 4.0], [0.5, 1.0], law, 0.2, fraction=[0.8, 0.2])
    >>> mixture.fraction
    array([0.8, 0.2])
    """

    mass: Array
    radius: Array
    law: tuple[tuple[CollisionLaw, ...], ...]
    packing_fraction: float
    k: Array
    fraction: Array
    contact: Contact

    @validated
    def __init__(
        self, mass: PositivePerDisk, radius: PositivePerDisk, law: LawTable, packing_fraction: PackingFraction, *,
        k: PositivePerDisk = 2.0, fraction: PositivePerDisk | None = None, contact: Contact = "virial",
    ) -> None:  # fmt: skip
        columns = {"mass": mass, "radius": radius, "k": k, "fraction": 1.0 if fraction is None else fraction}
        found = {name: np.atleast_1d(np.asarray(value, dtype=np.float64)) for name, value in columns.items()}
        try:
            s = np.broadcast_shapes(*(column.shape for column in found.values()))[0]
        except ValueError:
            shapes = ", ".join(f"{name} {len(column)}" for name, column in found.items())
            raise InputError(f"mixture: {shapes}: must be one number per species") from None
        if s == 0:
            raise InputError("mass has shape (0,): must be a number for each of one species or more")
        if s > MOST_SPECIES:
            raise InputError(f"mixture: {s} species; {MOST_SPECIES} at most (ifrdem.DSMC has no such limit)")
        set_ = object.__setattr__
        for name, column in found.items():
            set_(self, name, np.array(np.broadcast_to(column, s)))
        set_(self, "fraction", self.fraction / self.fraction.sum())
        set_(self, "packing_fraction", packing_fraction)
        set_(self, "contact", contact)
        set_(self, "law", self._table(law))

    @classmethod
    @validated
    def of(
        cls, disks: Disks, law: LawTable, packing_fraction: PackingFraction, *,
        contact: Contact = "virial",
    ) -> tuple[Mixture, NDArray[np.int64]]:  # fmt: skip
        """The mixture of these disks, whose `law` is a table of materials, and each disk's species, shape (n,).

        Disks are of one species if mass, radius, k and material agree. InputError as the class, or if a disk is
        immovable, or there are none.
        """
        if disks.n == 0 or not disks.movable.all():
            raise InputError("mixture: must have one disk of finite mass or more")
        columns: list[NDArray[Any]] = [disks.mass, disks.radius, disks.k, disks.material]
        which = kinds_of(disks)
        number = np.bincount(which)
        mass, radius, k, material = unlike(columns)
        table = law
        if isinstance(law, Sequence):
            if material.max() >= min(len(law), *map(len, law)):
                most = material.max() + 1
                raise InputError(f"law table: must be a square table of at least {most} materials")
            table = [[law[a][b] for b in material] for a in material]
        mixture = cls(mass, radius, table, packing_fraction, k=k, fraction=number, contact=contact)
        return mixture, which

    def _table(self, law: Any) -> tuple[tuple[CollisionLaw, ...], ...]:
        s = self.species
        rows = [[law] * s for _ in range(s)] if not isinstance(law, Sequence) else [list(row) for row in law]
        if len(rows) != s or any(len(row) != s for row in rows):
            raise InputError(f"law table: must be {s} rows of {s} laws, one for each pair of species")
        for i in range(s):
            for j in range(i + 1):
                if rows[i][j] is None or rows[j][i] is None:
                    raise InputError(f"law[{i}][{j}] = None: must be the law of a pair that meets")
                rows[i][j].check(self.k[i], self.k[j], self.mass[i], self.mass[j])
        check_symmetric(rows)
        return tuple(tuple(row) for row in rows)

    @property
    def species(self) -> int:
        """Number of species."""
        return len(self.mass)

    @property
    def number_density(self) -> Array:
        """Disks of each species per area [1/length^2], shape (s,)."""
        return self.fraction * self.packing_fraction / (math.pi * float(self.fraction @ self.radius**2))

    def contact_values(self) -> Array:
        """g_ij, shape (s, s)."""
        return mixture_contact_values(self.packing_fraction, self.radius, self.fraction, self.contact)

    def collision_rates(self, T: ArrayLike) -> Array:
        """Collisions of a disk of species i with species j per time [1/time], shape (s, s), at T (s,) [energy]."""
        return mixture_collision_rates(T, self.mass, self.radius, self.number_density, self.contact_values())


class MixtureTemperatures(NamedTuple):
    """Temperatures of the s species of a mixture over time; arrays (steps, s)."""

    temperature: Array  # [energy]
    rotational_temperature: Array  # [energy]
    collisions_per_disk: Array  # that a disk of each species has had on average

    def mean(self, mixture: Mixture) -> tuple[Array, Array, Array]:
        """T, T_rot and collisions of all disks together, shape (steps,) each, as `observables.measure` has them."""
        x = mixture.fraction
        return self.temperature @ x, self.rotational_temperature @ x, self.collisions_per_disk @ x


@validated
def mixture_cooling_rates(
    mixture: Mixture, T: NonNegativePerDisk, T_rot: NonNegativePerDisk
) -> tuple[Array, Array]:
    """Rates (dT_i/dt, dT_rot,i/dt) [energy/time], shape (s,) each, at which species of a mixture change by collisions.

    InputError if shapes do not fit or a temperature is negative.

    Parameters
    ----------
    mixture : Mixture
    T, T_rot : array_like (s,)
        Temperatures m <v^2> / 2 and I <w^2> of each species [energy], 0 or more.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> mixture = theory.Mixture([1.0, 1.0], [0.5, 0.5], IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), 0.2)
    >>> dT, dT_rot = theory.mixture_cooling_rates(mixture, [1.0, 1.0], [0.0, 0.0])
    >>> bool(abs(dT).max() < 1e-12)  # elastic
    True
    """
    T, T_rot = _temperatures(mixture, T=T, T_rot=T_rot)
    return _rates(mixture, T, T_rot, mixture.collision_rates(T))


def _temperatures(mixture: Mixture, **given: ArrayLike) -> tuple[Array, Array]:
    found = []
    for name, value in given.items():
        try:
            column = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), mixture.species))
        except ValueError:
            needed = f"a number for each of {mixture.species} species"
            raise InputError(f"{name} has shape {np.shape(value)}: must be {needed}") from None
        found.append(column)
    return found[0], found[1]


def _rates(mixture: Mixture, T: Array, T_rot: Array, often: Array, unit: float = 1.0) -> tuple[Array, Array]:
    """Gains of T and T_rot (s,) per time; `unit` as for `energy_changes`, `often` (s, s) collisions per time."""
    s = mixture.species
    translation, rotation = np.zeros(s), np.zeros(s)
    rows = zip(mixture.mass, mixture.k, T, T_rot, mixture.radius, strict=True)
    disks = [Collider(*each) for each in rows]
    for i in range(s):
        for j in range(s):
            if often[i, j] > 0.0:  # not where both are at rest: they never meet
                gains = energy_changes(mixture.law[i][j], disks[i], disks[j], unit)
                translation[i] += often[i, j] * gains[0]
                rotation[i] += often[i, j] * 2.0 * gains[1]
    return translation, rotation


@validated
def mixture_cooling(
    mixture: Mixture, T0: NonNegativePerDisk, T_rot0: NonNegativePerDisk, times: NonNegativeColumn
) -> MixtureTemperatures:
    """Temperatures of the species of a mixture as it cools: `mixture_cooling_rates` integrated.

    InputError as `mixture_cooling_rates`, if nothing moves, or if the times decrease or are negative.

    Parameters
    ----------
    mixture : Mixture
    T0, T_rot0 : array_like (s,)
        Temperatures at time 0 [energy], 0 or more; one species at least moves.
    times : array_like (steps,)
        Times since the start [time], 0 or more and not decreasing.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> law = IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    >>> mixture = theory.Mixture([1.0, 4.0], [0.5, 1.0], law, 0.2)
    >>> found = theory.mixture_cooling(mixture, 1.0, 0.0, [0.0, 10.0])
    >>> found.temperature.shape, bool(found.temperature[1, 1] > found.temperature[1, 0])
    ((2, 2), True)
    """
    when = checked_times(times)
    T0, T_rot0 = _temperatures(mixture, T0=T0, T_rot0=T_rot0)
    s, x = mixture.species, mixture.fraction
    mean0 = float(x @ T0)
    if mean0 == 0.0:
        raise InputError("T0 = 0 for all species: nothing moves")
    rate0 = float(x @ mixture.collision_rates(T0).sum(axis=1))
    start = np.concatenate([[0.0], T0 / mean0, T_rot0 / mean0, np.zeros(s)])
    if len(when) == 0 or when[-1] == 0.0 or rate0 == 0.0:
        return _unpacked(np.tile(start, (len(when), 1)).T, mean0, s)

    def slope(y: Array) -> Array:
        """Derivatives, by rate0 t, of ln(T/T0) of all disks, T_i/T, T_rot,i/T and collisions."""
        part, part_rot = np.maximum(y[1 : 1 + s], 0.0), np.maximum(y[1 + s : 1 + 2 * s], 0.0)
        speed = math.exp(0.5 * y[0])
        often = mixture.collision_rates(part * mean0) / rate0  # at T = T0; rates go with sqrt(T)
        translation, rotation = _rates(mixture, part, part_rot, often, math.sqrt(mean0) * speed)
        change = float(x @ translation)
        rates = ([change], translation - part * change, rotation - part_rot * change, often.sum(axis=1))
        return speed * np.concatenate(rates)

    return _unpacked(cooled(slope, start, rate0 * when), mean0, s)


@validated
def mixture_cooling_ratios(mixture: Mixture, theta0: NonNegative = 1.0) -> tuple[Array, Array]:
    """Ratios T_i / T and T_rot,i / T of species in the state to which a cooling mixture tends, shape (s,) each.

    T is the mean over all disks. In this state all temperatures cool at equal rates. For smooth disks, whose rotational
    temperatures do not change (0 here), the rates are those of V. Garzo and J. Dufty, Phys. Rev. E 60, 5706 (1999),
    doi:10.1103/PhysRevE.60.5706, with Maxwellian velocities; for rough disks those of A. Santos, Phys. Rev. E 98,
    012904 (2018), doi:10.1103/PhysRevE.98.012904.

    InputError if a law depends on the speed, or ratios do not become constant.

    Parameters
    ----------
    mixture : Mixture
    theta0 : float
        T_rot / T of all species at the start, 0 or more: there may be several states. Unused for smooth disks.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> mixture = theory.Mixture([1.0, 4.0], [0.5, 0.5], IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0), 0.1)
    >>> T, T_rot = theory.mixture_cooling_ratios(mixture)
    >>> round(float(T[1] / T[0]), 3)
    1.341
    """
    s, x = mixture.species, mixture.fraction
    if any(law.depends_on_speed for row in mixture.law for law in row):
        raise InputError(
            "law: must not depend on the speed; else ratios of temperatures do not become constant"
        )
    smooth = not np.any(_rates(mixture, np.ones(s), np.ones(s), np.ones((s, s)))[1])
    start = np.concatenate([np.ones(s), np.full(s, 0.0 if smooth else theta0)])
    rate = float(x @ mixture.collision_rates(np.ones(s)).sum(axis=1))

    def slope(y: Array) -> Array:
        """Derivatives of T_i / T and T_rot,i / T by collisions per disk."""
        T, T_rot = np.maximum(y[:s], 0.0), np.maximum(y[s:], 0.0)
        translation, rotation = _rates(mixture, T, T_rot, mixture.collision_rates(T) / rate)
        change = float(x @ translation) / float(x @ T)
        return np.concatenate([translation - T * change, rotation - T_rot * change])

    y, step = start, 16.0
    while np.abs(slope(y)).max() > SETTLED * np.abs(y).max():
        if step > LONGEST:
            raise InputError(
                f"mixture: ratios of temperatures do not become constant within {LONGEST:g} collisions per disk"
            )
        y = integrated(lambda _, at: slope(at), y, np.array([step]), "mixture").ravel()
        step *= 2.0
    return y[:s], y[s:]


def _unpacked(y: Array, mean0: float, s: int) -> MixtureTemperatures:
    mean = mean0 * np.exp(y[0])
    return MixtureTemperatures((mean * y[1 : 1 + s]).T, (mean * y[1 + s : 1 + 2 * s]).T, y[1 + 2 * s :].T)


@validated
def mixture_driven(
    mixture: Mixture,
    driving: Sequence[Driving],
    T0: NonNegativePerDisk,
    T_rot0: NonNegativePerDisk,
    times: NonNegativeColumn,
) -> MixtureTemperatures:
    """Temperatures of the species of a driven mixture: as `mixture_cooling`, with a `Driving` for each species.

    InputError as `mixture_cooling`; without a `Driving` for each species; or if nothing moves or is set in motion.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> from ifrdem.theory.driven_gas import Driving
    >>> mixture = theory.Mixture([1.0, 1.0], [0.5, 0.5], IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), 0.1)
    >>> driving = [Driving(power=0.1), Driving(power=0.1)]
    >>> found = theory.mixture_driven(mixture, driving, 1.0, 0.0, [0.0, 10.0])
    >>> found.temperature.round(6)  # elastic: T = T0 + power t
    array([[1., 1.],
           [2., 2.]])
    """
    when = checked_times(times)
    T0, T_rot0 = _temperatures(mixture, T0=T0, T_rot0=T_rot0)
    s = mixture.species
    if len(driving) != s:
        raise InputError(f"driving has {len(driving)}: must be one for each of {s} species")
    power, spin_power, rate, spin_rate = np.array([astuple(each) for each in driving]).T
    if not T0.any() and not power.any():
        raise InputError("T0 = 0 and no power: nothing moves")
    if len(when) == 0:
        return MixtureTemperatures(np.empty((0, s)), np.empty((0, s)), np.empty((0, s)))
    scale = max(float(T0.max()), float((power + spin_power).max() * when[-1]))

    def slope(_: float, y: Array) -> Array:
        # From rest, a gas passes temperatures at which nothing collides yet.
        T, T_rot = scale * np.maximum(y[:s], 1e-9), scale * np.maximum(y[s : 2 * s], 0.0)
        often = mixture.collision_rates(T)
        translation, rotation = _rates(mixture, T, T_rot, often)
        dT = power - 2.0 * rate * T + translation
        dT_rot = 2.0 * (spin_power - spin_rate * T_rot) + rotation
        return np.concatenate([dT / scale, dT_rot / scale, often.sum(axis=1)])

    start = np.concatenate([T0 / scale, T_rot0 / scale, np.zeros(s)])
    y = integrated(slope, start, when, "driven mixture")
    return MixtureTemperatures(scale * y[:s].T, scale * y[s : 2 * s].T, y[2 * s :].T)
