"""Kinetic theory of a driven gas of equal disks: evolution and steady state of its temperatures.

What collisions take (`theory.cooling_rates`, with its assumptions and symbols) against what linear forces give and
take. A disk's translational energy is T, that of its spin T_rot / 2, so that with a power per disk and friction rates

    dT/dt     = power      - 2 rate T            + cooling,
    dT_rot/dt = 2 spin_power - 2 spin_rate T_rot + cooling of T_rot.

A heat bath of temperature T_b is friction with power = 2 rate T_b; for spins, spin_power = spin_rate T_b.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.laws.law import CollisionLaw
from ..tools.checked import Array, NonNegative, NonNegativeColumn, Positive, validated
from .collisions import KineticLaw, collision_rate
from .contact import PackingFraction
from .cooling_gas import checked_times, cooling_rates, integrated

LINEAR = ("random_kicks", "poisson_kicks", "spin_kicks", "poisson_spin_kicks", "drag", "langevin")
"""Kinds of forces that are linear; drag only without a quadratic part."""


@validated
@dataclass(frozen=True)
class Driving:
    """The total heating and friction of all forces on a disk.

    Examples
    --------
    >>> from ifrdem import theory
    >>> bath = theory.Driving(power=2.0 * 0.5 * 3.0, rate=0.5)  # of the temperature 3: power = 2 rate T
    """

    power: NonNegative = 0.0
    spin_power: NonNegative = 0.0
    """power, spin_power: energy that a disk's motion and its spin get per time [energy/time]."""
    rate: NonNegative = 0.0
    spin_rate: NonNegative = 0.0
    """rate, spin_rate: friction rates of velocities and spins [1/time]."""

    @classmethod
    def of(cls, forces: Iterable[Mapping[str, Any]], mass: float, inertia: float) -> Driving | None:
        """The driving of the forces of a case (`ForceSection`) on equal disks; None where a force is not linear.

        Each force is a mapping of its keys, None for a key that is not given; mass and inertia are those of a disk.
        """
        found = {"power": 0.0, "spin_power": 0.0, "rate": 0.0, "spin_rate": 0.0}
        for force in forces:
            given = {key: value for key, value in force.items() if value is not None}
            match given["kind"]:
                case "random_kicks" | "poisson_kicks":
                    found["power"] += given.get("power", 2.0 * mass * given.get("diffusion", 0.0))
                case "spin_kicks" | "poisson_spin_kicks":
                    found["spin_power"] += given.get("power", inertia * given.get("diffusion", 0.0))
                case "drag" if not given.get("quadratic"):
                    found["rate"] += given.get("rate", 0.0)
                    found["spin_rate"] += given.get("spin_rate", 0.0)
                case "langevin":
                    T = given["temperature"]
                    rate, spin_rate = given.get("rate", 0.0), given.get("spin_rate", 0.0)
                    found["rate"] += rate
                    found["power"] += 2.0 * rate * T
                    found["spin_rate"] += spin_rate
                    found["spin_power"] += spin_rate * given.get("spin_temperature", T)
                case _:
                    return None
        return cls(**found)


@dataclass(frozen=True)
class _Balance:
    """The heating minus the losses of a gas."""

    law: CollisionLaw
    mass: float
    radius: float
    k: float
    packing_fraction: float
    driving: Driving

    def __call__(self, T: float, T_rot: float) -> tuple[float, float]:
        """(dT/dt, dT_rot/dt) [energy/time], T > 0."""
        density, d = self.packing_fraction / (math.pi * self.radius**2), self.driving
        one: Any = {"law": self.law, "mass": self.mass, "radius": self.radius, "k": self.k}
        cooling = cooling_rates(T, T_rot, number_density=density, **one)
        translation, rotation = (float(rate) for rate in cooling)
        turning = 2.0 * (d.spin_power - d.spin_rate * T_rot) + rotation
        return d.power - 2.0 * d.rate * T + translation, turning

    def steady_spins(self, T: float) -> float:
        """T_rot at which spins gain what they lose, at a given T; nan without both, inf if the gain is larger."""
        from scipy.optimize import brentq

        if self(T, 0.0)[1] <= 0.0:
            return math.nan if self(T, T)[1] == 0.0 else 0.0
        high = T
        while self(T, high)[1] > 0.0:
            high *= 2.0
            if high > 1e12 * T:
                return math.inf
        return float(brentq(lambda T_rot: self(T, T_rot)[1], 0.0, high, rtol=1e-13))


@validated
def steady_state(
    law: KineticLaw,
    mass: Positive,
    radius: Positive,
    k: Positive,
    packing_fraction: PackingFraction,
    driving: Driving,
) -> tuple[float, float] | None:
    """Temperatures (T, T_rot) [energy] of the steady state; None if there is none with T > 0.

    T_rot is nan where nothing acts on the spins (smooth disks): they keep what they have. Arguments as for
    `theory.cooling`; errors as `theory.cooling_rates`.
    """
    from scipy.optimize import brentq

    balance = _Balance(law, mass, radius, k, packing_fraction, driving)

    def heating(log_T: float) -> float:
        T = math.exp(log_T)
        T_rot = balance.steady_spins(T)
        if math.isinf(T_rot):
            return math.inf
        return balance(T, 0.0 if math.isnan(T_rot) else T_rot)[0] / T

    # From a temperature of the order of magnitude that the driving sets, look for a change of sign on both sides.
    rate = collision_rate(packing_fraction, 1.0, mass, radius)
    most = max(driving.power, driving.spin_power)
    if most <= 0.0 or rate <= 0.0:
        return None
    middle = math.log(most / rate) / 1.5
    low = high = middle
    while heating(low) < 0.0:
        low -= 1.0
        if low < middle - 40.0:
            return None
    while heating(high) > 0.0:
        high += 1.0
        if high > middle + 40.0:
            return None
    T = math.exp(brentq(heating, low, high, xtol=1e-13)) if low < high else math.exp(low)
    return T, balance.steady_spins(T)


@validated
def driven(
    law: KineticLaw,
    mass: Positive,
    radius: Positive,
    k: Positive,
    packing_fraction: PackingFraction,
    driving: Driving,
    T0: NonNegative,
    T_rot0: NonNegative,
    times: NonNegativeColumn,
) -> tuple[Array, Array, Array]:
    """Temperatures of a homogeneous gas of equal disks that is driven.

    Arguments and what is returned as for `theory.cooling`, but T0 may be 0. InputError as there, or if nothing moves
    (T0 = 0) and only spins, if any, are driven: without motion there are no collisions.
    """
    when = checked_times(times)
    balance = _Balance(law, mass, radius, k, packing_fraction, driving)
    if len(when) == 0:
        return np.empty(0), np.empty(0), np.empty(0)
    if T0 == 0.0 and driving.power == 0.0:
        raise InputError("T0 = 0 and no power: nothing moves")
    if when[-1] == 0.0:  # all are the start, which an integrator may not leave from rest
        return np.full(len(when), T0), np.full(len(when), T_rot0), np.zeros(len(when))
    # No hotter than at the start, than all power makes it, or than it stays.
    gained = (driving.power + driving.spin_power) * float(when[-1])
    steady = steady_state(law, mass, radius, k, packing_fraction, driving)
    scale = max(T0, min(gained, steady[0] if steady else math.inf)) or 1.0
    # What has a steady state is in it by far after a million times that in which its energy was given to it.
    most = 1e6 * scale / (driving.power + driving.spin_power) if steady else math.inf
    until = np.minimum(when, most)

    def slope(_: float, y: Array) -> tuple[float, float, float]:
        # From rest, a gas passes temperatures at which nothing collides yet.
        T, T_rot = max(float(y[0]), 1e-9), max(float(y[1]), 0.0)
        dT, dT_rot = balance(scale * T, scale * T_rot)
        collisions = collision_rate(packing_fraction, scale * T, mass, radius)
        return dT / scale, dT_rot / scale, collisions

    T, T_rot, collisions = integrated(slope, (T0 / scale, T_rot0 / scale, 0.0), until, "driven gas")
    collisions += collision_rate(packing_fraction, scale * float(T[-1]), mass, radius) * (when - until)
    return scale * T, scale * T_rot, collisions
