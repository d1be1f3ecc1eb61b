"""The run and the box of a case file."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from ..model.box import Box
from ..simulation.turning import MOST_STEP, USUAL_STEP
from .section import Keys, Section, key
from .walls_section import Pair

Name = Annotated[str, Field(min_length=1, max_length=100)]


class RunSection(Section):
    """The run as a whole."""

    choices: ClassVar[tuple[Keys, ...]] = (Keys(("t_end",)), Keys(("collisions_per_disk",)))

    name: str = key("cooling", "run", pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.+-]*$", max_length=100)
    """Name [text: letters, digits, _ . + -]; the outputs are NAME.h5 and NAME.png."""
    seed: int = key(1, 0, ge=0, lt=2**63)
    """Seed of every random number [whole number]; one seed, one result."""
    t_end: float | None = key(2.0, None, gt=0.0)
    """Simulated time at which the run ends [s]."""
    collisions_per_disk: float | None = key(50.0, None, gt=0.0)
    """Collisions per disk, mean over all disks, at which the run ends [1]."""
    arch: Literal["cpu", "cuda"] = key("cpu", "cpu")
    """Device: "cpu", or "cuda" (an NVIDIA GPU)."""
    threads: int | None = key(2, None, ge=1)
    """CPU threads [whole number]; all cores without it. The result does not depend on it."""
    precision: Literal["f64", "f32"] = key("f64", "f64")
    """Numbers that the run computes with: "f64" (double precision), or "f32" (single: less memory, less exact)."""
    units: Literal["SI", "reduced"] = key("SI", "SI")
    """ "SI": numbers are in the units in brackets; "reduced": in any consistent system, and the brackets only tell the
    dimension. Nothing is converted."""
    collapse: Literal["none", "velocity_cutoff", "tc", "rest"] = key("velocity_cutoff", "none")
    """Against collisions without end (inelastic collapse, disks that come to rest): "none", "velocity_cutoff"
    (collisions slower than velocity_cutoff are elastic), "tc" (those of a disk that collided less than
    contact_time ago are) or "rest" (contacts slower than resting_speed last, and disks that lie still sleep)."""
    velocity_cutoff: float | None = key(1.0e-3, None, gt=0.0)
    """Normal speed of approach below which collisions are elastic [m/s], with collapse = "velocity_cutoff"."""
    contact_time: float | None = key(1.0e-4, None, gt=0.0)
    """Time after a collision in which further ones are elastic [s], with collapse = "tc"; a hundredth of the mean free
    time changes little."""
    resting_speed: float | None = key(1.0e-3, None, gt=0.0)
    """Speed below which contacts last and disks fall asleep under gravity [m/s], with collapse = "rest"."""

    @classmethod
    def mistakes(cls, data: dict[str, Any]) -> list[str]:
        """Also which numbers the remedy for collapse needs."""
        chosen, wrong = data.get("collapse", "none"), []
        for kind, number in (
            ("velocity_cutoff", "velocity_cutoff"), ("tc", "contact_time"), ("rest", "resting_speed"),
        ):  # fmt: skip
            if number in data and kind != chosen:
                text = f'{number} cannot stand beside collapse = "{chosen}": collapse = "{kind}" needs it'
                wrong.append(text)
            if number not in data and kind == chosen:
                wrong.append(f'collapse = "{chosen}": {number} missing')
        return wrong + super().mistakes(data)


class BoxSection(Section):
    """The rectangle that the disks move in, from the origin on, its sides periodic or walls; or none: an open one."""

    choices: ClassVar[tuple[Keys, ...]] = (Keys(("packing_fraction",), also=("aspect",)), Keys(("lengths",)))

    packing_fraction: float | None = key(0.25, None, gt=0.0, le=0.9069)
    """Fraction of the area that disks cover [1], up to 0.9069, the densest packing of equal disks; start.positions
    says how dense a start can be."""
    aspect: float = key(1.0, 1.0, gt=0.0)
    """Ratio of the sides Lx/Ly [1]."""
    lengths: list[Annotated[float, Field(gt=0.0)]] | None = key([8.0, 8.0], None, min_length=2, max_length=2)
    """Sides [Lx, Ly] [m]."""
    shear_rate: float = key(0.5, 0.0)
    """Rate du_x/dy of a steady shear flow along x [1/s]; starts and temperatures are relative to it."""
    open: bool = key(True, False)
    """No box: disks may fly apart for ever [true or false]. packing_fraction or lengths are then those of the
    rectangle in which they start, and not needed with a start file."""
    periodic: list[bool] = key([True, False], [True, True], min_length=2, max_length=2)
    """Periodic sides, along x and along y: disks that leave come in on the other side [true or false]; straight walls
    stand at the others."""
    material: Name | None = key("steel", None)
    """Name of the material of walls at the sides [text]; needed where a side is not periodic. That of a species, or
    another one with a [[pair]] for each material of the disks."""
    gravity: Pair = key([0.0, -9.81], [0.0, 0.0])
    """Acceleration [gx, gy] of all disks [m/s^2]; only along directions that are not periodic."""
    gravity_turns: float = key(0.02, 0.0)
    """Rate at which gravity turns [rad/s], positive counter-clockwise, as in the frame of a slow drum that turns the
    other way; it begins with gravity, and no side may be periodic."""
    gravity_step: float = key(USUAL_STEP, USUAL_STEP, gt=0.0, le=MOST_STEP)
    """Angle of the steps in which gravity turns [rad]."""

    @classmethod
    def mistakes(cls, data: dict[str, Any]) -> list[str]:
        """Also whether sides that are walls have a material, and gravity has a floor. An open box needs no size."""
        if data.get("open") is True:
            walled = ("periodic", "material", "gravity", "gravity_turns", "shear_rate")
            wrong = [f"{key}: not in an open box" for key in walled if key in data]
            if {"packing_fraction", "lengths"} & set(data):
                return wrong + super().mistakes(data)
            return wrong + ["aspect: only with packing_fraction"] * ("aspect" in data)
        wrong = super().mistakes(data)
        periodic, gravity = data.get("periodic", [True, True]), data.get("gravity", [0.0, 0.0])
        if not isinstance(periodic, list) or [*map(type, periodic)] != [bool, bool]:
            return wrong
        if not all(periodic) and "material" not in data:
            wrong.append("material is missing: the name of the material of those sides that are not periodic")
        if all(periodic) and "material" in data:
            wrong.append("material: both directions are periodic, so there are no walls at the sides")
        if not all(periodic) and data.get("shear_rate", 0.0) != 0.0:
            wrong.append(
                f"shear_rate = {data['shear_rate']}: the box must be periodic along x and y; shear between walls by "
                "walls that move or have a surface_speed"
            )
        if turns := data.get("gravity_turns"):
            if not isinstance(gravity, list) or not any(gravity):
                wrong.append(f"gravity_turns = {turns}: there is no gravity to turn; gravity is missing")
            if any(periodic):
                wrong.append(
                    f"gravity_turns = {turns}: disks would fall for ever where a side is periodic; periodic = [false, "
                    "false] is needed"
                )
        elif "gravity_step" in data:
            wrong.append("gravity_step: only where gravity_turns")
        if isinstance(gravity, list) and len(gravity) == 2:
            wrong += [
                f"gravity = {gravity}: disks would fall for ever along {axis}, which is periodic; periodic = "
                f"{str([p and axis != each for p, each in zip(periodic, 'xy', strict=True)]).lower()} gives it a floor"
                for axis, along, pull in zip("xy", periodic, gravity, strict=True)
                if along and isinstance(pull, int | float) and pull != 0.0
            ]
        return wrong

    def patch(self, covered: float) -> Box | None:
        """The rectangle that is given a size, for disks that cover so much area [length^2]; None if none is.

        It is the box, or where disks of an open one start.

        Raises InputError if they can never cover that fraction of it.
        """
        periodic = (self.periodic[0], self.periodic[1])
        if self.packing_fraction is not None:
            lengths = Box.around(covered, self.packing_fraction, self.aspect).lengths
        elif self.lengths is not None:
            lengths = (self.lengths[0], self.lengths[1])
        else:
            return None
        return Box(lengths, periodic, self.shear_rate)
