"""The run and the box of a case file."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..model.box import Box
from .section import Choice, Section
from .walls_section import Pair

Name = Annotated[str, Field(min_length=1, max_length=100)]


class RunSection(Section):
    """The run as a whole."""

    choices: ClassVar[tuple[Choice, ...]] = (Choice(("t_end",)), Choice(("collisions_per_disk",)))

    name: str = Field(
        default="run",
        pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.+-]*$",
        max_length=100,
        description="name [text: letters, digits, _ . + -]; the outputs are NAME.h5 and NAME.png",
        examples=["cooling"],
    )
    seed: int = Field(
        default=0,
        ge=0,
        lt=2**63,
        description="seed of every random number [whole number]; one seed, one result",
        examples=[1],
    )
    t_end: float | None = Field(
        default=None, gt=0.0, description="simulated time at which the run ends [s]", examples=[2.0]
    )
    collisions_per_disk: float | None = Field(
        default=None,
        gt=0.0,
        description="collisions per disk, mean over all disks, at which the run ends [1]",
        examples=[50.0],
    )
    arch: Literal["cpu", "cuda"] = Field(
        default="cpu", description='what computes: "cpu", or "cuda" (an NVIDIA GPU)', examples=["cpu"]
    )
    threads: int | None = Field(
        default=None,
        ge=1,
        description="CPU threads [whole number]; all cores without it. The result does not depend on it",
        examples=[2],
    )
    precision: Literal["f64", "f32"] = Field(
        default="f64",
        description='numbers that the run computes with: "f64" (double precision), or "f32" (single: less '
        "memory, less exact)",
        examples=["f64"],
    )
    units: Literal["SI", "reduced"] = Field(
        default="SI",
        description='"SI": numbers are in the units in brackets; "reduced": in any consistent system, '
        "and the brackets only tell the dimension. Nothing is converted",
        examples=["SI"],
    )
    collapse: Literal["none", "velocity_cutoff", "tc"] = Field(
        default="none",
        description='against collisions without end (inelastic collapse, disks that come to rest): "none", '
        '"velocity_cutoff" (collisions slower than velocity_cutoff are elastic) or "tc" (those of a disk that collided '
        "less than contact_time ago are)",
        examples=["velocity_cutoff"],
    )
    velocity_cutoff: float | None = Field(
        default=None,
        gt=0.0,
        description="normal speed of approach below which collisions are elastic [m/s], with "
        'collapse = "velocity_cutoff"',
        examples=[1.0e-3],
    )
    contact_time: float | None = Field(
        default=None,
        gt=0.0,
        description='time after a collision in which further ones are elastic [s], with collapse = "tc"; a '
        "hundredth of the mean free time changes little",
        examples=[1.0e-4],
    )

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """Also which numbers the remedy for collapse needs."""
        needs = {"velocity_cutoff": "velocity_cutoff", "tc": "contact_time"}
        chosen = data.get("collapse", "none")
        wrong = [
            f'{key} cannot stand beside collapse = "{chosen}": collapse = "{kind}" needs it'
            for kind, key in needs.items()
            if key in data and kind != chosen
        ]
        if isinstance(chosen, str) and chosen in needs and needs[chosen] not in data:
            wrong.append(f'collapse = "{chosen}": {needs[chosen]} missing')
        wrong += [found] if (found := super().wrong_choice(data)) else []
        return "; ".join(wrong) or None


class BoxSection(Section):
    """The rectangle that the disks move in, from the origin on, its sides periodic or walls; or none: an open one."""

    choices: ClassVar[tuple[Choice, ...]] = (
        Choice(("packing_fraction",), also=("aspect",)),
        Choice(("lengths",)),
    )

    packing_fraction: float | None = Field(
        default=None,
        gt=0.0,
        le=0.9069,
        description="fraction of the area that disks cover [1], up to 0.9069, the densest packing of equal "
        "disks; start.positions says how dense a start can be",
        examples=[0.25],
    )
    aspect: float = Field(default=1.0, gt=0.0, description="ratio of the sides Lx/Ly [1]", examples=[1.0])
    lengths: list[Annotated[float, Field(gt=0.0)]] | None = Field(
        default=None, min_length=2, max_length=2, description="sides [Lx, Ly] [m]", examples=[[8.0, 8.0]]
    )
    shear_rate: float = Field(
        default=0.0,
        description="rate du_x/dy of a steady shear flow along x [1/s]; starts and temperatures are relative to it",
        examples=[0.5],
    )
    open: bool = Field(
        default=False,
        description="no box: disks may fly apart for ever [true or false]. packing_fraction or lengths are then those "
        "of the rectangle in which they start, and not needed with a start file",
        examples=[True],
    )
    periodic: list[bool] = Field(
        default=[True, True],
        min_length=2,
        max_length=2,
        description="whether disks that leave come in on the other side, along x and along y [true or false]; straight "
        "walls stand at the others",
        examples=[[True, False]],
    )
    material: Name | None = Field(
        default=None,
        description="name of the material of walls at the sides [text]; needed where a side is not periodic. That of a "
        "species, or another one with a [[pair]] for each material of the disks",
        examples=["steel"],
    )
    gravity: Pair = Field(
        default=[0.0, 0.0],
        description="acceleration [gx, gy] of all disks [m/s^2]; only along directions that are not periodic",
        examples=[[0.0, -9.81]],
    )

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """Also whether sides that are walls have a material, and gravity has a floor. An open box needs no size."""
        if data.get("open") is True:
            walled = [
                f"{key}: not in an open box"
                for key in ("periodic", "material", "gravity", "shear_rate")
                if key in data
            ]
            if {"packing_fraction", "lengths"} & set(data):
                walled += [found] if (found := super().wrong_choice(data)) else []
            elif "aspect" in data:
                walled.append("aspect: only with packing_fraction")
            return "; ".join(walled) or None
        wrong = [found] if (found := super().wrong_choice(data)) else []
        periodic, gravity = data.get("periodic", [True, True]), data.get("gravity", [0.0, 0.0])
        readable = isinstance(periodic, list) and [*map(type, periodic)] == [bool, bool]
        if readable and not all(periodic) and "material" not in data:
            wrong.append("material is missing: the name of the material of those sides that are not periodic")
        if readable and all(periodic) and "material" in data:
            wrong.append("material: both directions are periodic, so there are no walls at the sides")
        if readable and not all(periodic) and data.get("shear_rate", 0.0) != 0.0:
            wrong.append(
                f"shear_rate = {data['shear_rate']}: the box must be periodic along x and y; shear between walls by "
                "walls that move or have a surface_speed"
            )
        if readable and isinstance(gravity, list) and len(gravity) == 2:
            wrong += [
                f"gravity = {gravity}: disks would fall for ever along {axis}, which is periodic; periodic = "
                f"{str([p and axis != each for p, each in zip(periodic, 'xy', strict=True)]).lower()} gives it a floor"
                for axis, along, pull in zip("xy", periodic, gravity, strict=True)
                if along and isinstance(pull, int | float) and pull != 0.0
            ]
        return "; ".join(wrong) or None

    def around(self, radius: NDArray[np.float64]) -> Box:
        """The box for disks of these radii [length], shape (n,).

        Raises
        ------
        InputError
            If they can never cover that fraction of it.
        """
        patch = None if self.open else self.patch(radius)
        return Box.open() if patch is None else patch

    def patch(self, radius: NDArray[np.float64]) -> Box | None:
        """The rectangle that is given a size: the box, or where disks of an open one start; None if it has none.

        Raises
        ------
        InputError
            As `around`.
        """
        periodic = (self.periodic[0], self.periodic[1])
        if self.lengths is not None:
            return Box((self.lengths[0], self.lengths[1]), periodic, self.shear_rate)
        if self.packing_fraction is None:
            return None
        found = Box.from_packing_fraction(radius, self.packing_fraction, self.aspect)
        return Box(found.lengths, periodic, self.shear_rate)
