"""The forces of a case file: which keys each kind has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field

from .section import Section


@dataclass(frozen=True)
class ForceKeys:
    """Keys of one kind of force beside kind and step: `needed` ones, exactly or at least one of some, others."""

    needed: tuple[str, ...] = ()
    exactly_one: tuple[str, ...] = ()
    at_least_one: tuple[str, ...] = ()
    also: tuple[str, ...] = ()

    @property
    def all(self) -> tuple[str, ...]:
        """Every key of the kind."""
        return self.needed + self.exactly_one + self.at_least_one + self.also


FORCES: Mapping[str, ForceKeys] = {
    "kicks": ForceKeys(exactly_one=("power", "diffusion")),
    "spin_kicks": ForceKeys(exactly_one=("power", "diffusion")),
    "langevin": ForceKeys(("temperature",), at_least_one=("rate", "spin_rate"), also=("spin_temperature",)),
    "drag": ForceKeys(at_least_one=("rate", "quadratic", "spin_rate")),
    "rescale": ForceKeys(exactly_one=("temperature", "energy")),
    "table_friction": ForceKeys(("mu",), also=("gravity",)),
}
"""Keys of each kind of force; `ifrdem.forces` says what they do."""


class ForceSection(Section):
    """What acts on all disks between collisions, at the middle of each of its steps: a drive, or drag."""

    kind: Literal["kicks", "spin_kicks", "langevin", "drag", "rescale", "table_friction"] = Field(
        description='"kicks" (random, without total momentum; power or diffusion), "spin_kicks" (likewise of spins), '
        '"langevin" (a heat bath; temperature, rate, spin_temperature, spin_rate), "drag" (rate, quadratic, '
        'spin_rate), "rescale" (a thermostat; temperature or energy) or "table_friction" (disks that lie on a table; '
        "mu, gravity)",
        examples=["kicks"],
    )
    step: float = Field(
        gt=0.0,
        description="time between two applications [s]; a part of the mean free time. Errors go with its square",
        examples=[2e-3],
    )
    power: float | None = Field(
        default=None, gt=0.0, description="energy that each disk gets per time [W]", examples=[1e-3]
    )
    diffusion: float | None = Field(
        default=None,
        gt=0.0,
        description="instead of power: D in <dv_x^2> = 2 D dt [m^2/s^3], or <d omega^2> = 2 D dt [rad^2/s^3]",
        examples=[0.5],
    )
    temperature: float | None = Field(
        default=None,
        ge=0.0,
        description="of the heat bath, or to rescale to: mean of m v^2 / 2 [J]",
        examples=[5e-4],
    )
    spin_temperature: float | None = Field(
        default=None,
        ge=0.0,
        description="of the heat bath for spins, mean of I omega^2 [J]; temperature without it",
        examples=[5e-4],
    )
    energy: float | None = Field(
        default=None,
        gt=0.0,
        description="to rescale to: kinetic energy of a disk, spins included, mean over all [J]",
        examples=[1e-3],
    )
    rate: float | None = Field(
        default=None, ge=0.0, description="friction rate of velocities [1/s]", examples=[0.5]
    )
    spin_rate: float | None = Field(
        default=None, ge=0.0, description="friction rate of spins [1/s]", examples=[0.5]
    )
    quadratic: float | None = Field(
        default=None,
        ge=0.0,
        description="quadratic drag over mass, c in dv/dt = -c |v| v [1/m]",
        examples=[0.1],
    )

    mu: float | None = Field(
        default=None, gt=0.0, description="sliding friction on the table [1]", examples=[0.2]
    )
    gravity: float | None = Field(
        default=None,
        gt=0.0,
        description="acceleration that presses disks on the table [m/s^2]; 9.81 without it",
        examples=[9.81],
    )

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """What is wrong with the keys for this kind of force, or None."""
        kind = data.get("kind")
        if not isinstance(kind, str) or kind not in FORCES:
            return None  # said of the kind itself
        keys = FORCES[kind]
        wrong = []
        foreign = [key for key in data if key in cls.model_fields and key not in ("kind", "step", *keys.all)]
        if foreign:
            wrong.append(f"{', '.join(foreign)} cannot stand here; known for it: {', '.join(keys.all)}")
        missing = [key for key in keys.needed if key not in data]
        if missing:
            wrong.append(f"{', '.join(missing)} missing")
        given = [key for key in keys.exactly_one if key in data]
        if keys.exactly_one and len(given) != 1:
            one_of = " or ".join(keys.exactly_one)
            wrong.append(f"exactly one of {one_of} is needed; given: {', '.join(given) or 'none'}")
        if keys.at_least_one and not any(data.get(key) for key in keys.at_least_one):
            wrong.append(f"at least one of {', '.join(keys.at_least_one)} above 0 is needed")
        if kind == "rescale" and data.get("temperature") == 0.0:
            wrong.append("temperature = 0: a number above 0 is needed")
        return f'kind = "{kind}": {"; ".join(wrong)}' if wrong else None
