"""The forces of a case file: which keys each kind has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from .section import Keys, Section, key


class ForceSection(Section):
    """A force on all disks between collisions, at the middle of each of its steps: a drive, or drag."""

    kind: Literal["kicks", "spin_kicks", "langevin", "drag", "rescale", "table_friction"] = key("kicks")
    """ "kicks" (random, without total momentum; power or diffusion), "spin_kicks" (likewise of spins), "langevin" (a
    heat bath; temperature, rate, spin_temperature, spin_rate), "drag" (rate, quadratic, spin_rate), "rescale" (a
    thermostat; temperature or energy) or "table_friction" (disks that lie on a table; mu, gravity)."""
    step: float = key(2e-3, gt=0.0)
    """Time between two applications [s]; a part of the mean free time. Errors go with its square."""
    power: float | None = key(1e-3, None, gt=0.0)
    """Energy that each disk gets per time [W]."""
    diffusion: float | None = key(0.5, None, gt=0.0)
    """Instead of power: D in <dv_x^2> = 2 D dt [m^2/s^3], or <d omega^2> = 2 D dt [rad^2/s^3]."""
    temperature: float | None = key(5e-4, None, ge=0.0)
    """Of the heat bath, or to rescale to: mean of m v^2 / 2 [J]."""
    spin_temperature: float | None = key(5e-4, None, ge=0.0)
    """Of the heat bath for spins, mean of I omega^2 [J]; temperature without it."""
    energy: float | None = key(1e-3, None, gt=0.0)
    """To rescale to: kinetic energy of a disk, spins included, mean over all [J]."""
    rate: float | None = key(0.5, None, ge=0.0)
    """Friction rate of velocities [1/s]."""
    spin_rate: float | None = key(0.5, None, ge=0.0)
    """Friction rate of spins [1/s]."""
    quadratic: float | None = key(0.1, None, ge=0.0)
    """Quadratic drag over mass, c in dv/dt = -c |v| v [1/m]."""

    mu: float | None = key(0.2, None, gt=0.0)
    """Sliding friction on the table [1]."""
    gravity: float | None = key(9.81, None, gt=0.0)
    """Acceleration that presses disks on the table [m/s^2]; 9.81 without it."""

    kinds: ClassVar[Mapping[str, Keys]] = {
        "kicks": Keys(one=("power", "diffusion")),
        "spin_kicks": Keys(one=("power", "diffusion")),
        "langevin": Keys(("temperature",), some=("rate", "spin_rate"), also=("spin_temperature",)),
        "drag": Keys(some=("rate", "quadratic", "spin_rate")),
        "rescale": Keys(one=("temperature", "energy")),
        "table_friction": Keys(("mu",), also=("gravity",)),
    }

    @classmethod
    def mistakes(cls, data: dict[str, Any]) -> list[str]:
        """Also what a thermostat cannot hold."""
        cold = data.get("kind") == "rescale" and data.get("temperature") == 0.0
        return super().mistakes(data) + ["temperature = 0: a number above 0 is needed"] * cold
