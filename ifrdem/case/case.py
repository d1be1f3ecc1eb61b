"""A case: what one case file may hold, as pydantic models with the unit in every description.

The models check types, ranges, keys and alternatives of one section, all at once; what needs several of them is
judged by `ifrdem.case.rules`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, model_validator

from ..errors import InputError, nearest
from ..initial import radii
from ..kernels.columns import MOST_IDS
from ..kernels.compiler import runtime
from ..model.box import Box, PackingFraction
from ..model.collapse import Collapse, ContactTime, Rest, VelocityCutoff
from ..model.device import Device
from ..model.gravity import DEFAULT_STEP, EARTH, Gravity, RotatingGravity, Step
from ..simulation.steps.schedule import Trigger
from ..tools.checked import (
    POSITIVE,
    Count,
    Each,
    Integer,
    Natural,
    NonNegative,
    Number,
    Part,
    Positive,
    Ratio,
    Real,
    Whole,
)
from ..tools.tables import TableFormat
from .laws_section import CoinName, FileKeys, Material, PairOfMaterials
from .output_section import OutputSection
from .section import Name, Pair, Section, exclusive_with, field, refusal
from .walls_section import SineMotion, SineTurn, Wall

if TYPE_CHECKING:
    from ..model.forces import Force as ModelForce

_SI = {
    "length": "m", "mass": "kg", "time": "s", "velocity": "m s-1", "angular_velocity": "rad s-1", "energy": "J",
    "momentum": "kg m s-1", "force": "N", "angle": "rad",
}  # fmt: skip
UNITS: Mapping[str, Mapping[str, str]] = {"SI": _SI, "reduced": dict.fromkeys(_SI, "reduced")}
"""Unit of each quantity by the name in run.units, in the notation of H5MD."""

IMPACT_SCAN = "impact_scan"
GROWN = "grown"
PLACED = ("random", GROWN, "hexagonal")
PLACEMENTS = (*PLACED, IMPACT_SCAN)
REMEDIES: Mapping[str, tuple[str, type[Collapse]]] = {
    "velocity_cutoff": ("velocity_cutoff", VelocityCutoff),
    "contact_time": ("contact_time", ContactTime),
    "rest": ("resting_speed", Rest),
}
"""Remedies for collapse by their names in run.collapse: the key of the number, and the class."""


def class_of(kind: str) -> str:
    """Name of the class of a kind of force in `model.forces`.

    Examples
    --------
    >>> class_of("table_friction")
    'TableFriction'
    """
    return kind.title().replace("_", "")


Sides = Annotated[list[float], Each(POSITIVE, length=2)]
_RIGHT = math.nextafter(90.0, 0.0)
Angles = Annotated[list[float], Each(Number(-_RIGHT, _RIGHT, "an angle above -90 and below 90"), length=2)]
NumberOfDisks = Annotated[int, Integer(1, MOST_IDS)]


class RunSection(Section):
    """The run as a whole."""

    one_of: ClassVar[tuple[tuple[str, ...], ...]] = (("t_end", "collisions_per_disk"),)

    name: str = field("cooling", "run", pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.+-]*$", max_length=100)
    """Name [text: letters, digits, _ . + -]; the outputs are NAME.h5 and NAME.png."""
    seed: Natural = field(1, 0)
    """Seed of every random number [whole number]; one seed, one result."""
    t_end: Positive | None = field(2.0, None)
    """Simulated time at which the run ends [s]: a time of the run's clock, which begins at start.time."""
    collisions_per_disk: Ratio | None = field(50.0, None)
    """Collisions per disk, mean over all disks, at which the run ends [1]; if the clock of a frame continues, those
    before the frame count too."""
    device: Literal["cpu", "cuda"] = field("cpu", "cpu")
    """Device: "cpu", or "cuda" (an NVIDIA GPU)."""
    threads: Count | None = field(2, None)
    """CPU threads [whole number]; all cores without it. The result does not depend on it."""
    runtime: Literal["taichi", "quadrants"] | None = field("taichi", None)
    """Runtime that compiles the kernels: "taichi" or "quadrants"; without it, that of the variable IFRDEM_RUNTIME of
    the environment, or the first of the two that is installed."""
    precision: Literal["f64", "f32"] = field("f64", "f64")
    """Numbers that the run computes with: "f64" (double precision), or "f32" (single: less memory, less exact)."""
    low_memory: bool = field(False, False)
    """Do not store the state at a time within a window: 30 % less memory, bitwise identical results. Each frame and
    row of the series then costs up to one window more. Cannot be combined with walls, forces, shear, or
    collapse = "contact_time" or "rest"."""
    units: Literal["SI", "reduced"] = field("SI", "SI")
    """ "SI": numbers are in the units in brackets; "reduced": in any consistent system, and the brackets only give the
    dimension. Nothing is converted."""
    collapse: Literal["none", "velocity_cutoff", "contact_time", "rest"] = field("velocity_cutoff", "none")
    """Remedy for inelastic collapse and for disks that come to rest: "none", "velocity_cutoff" (collisions slower than
    velocity_cutoff are elastic), "contact_time" (collisions of a disk within contact_time after its previous one are
    elastic) or "rest" (contacts slower than resting_speed last, and disks at rest sleep)."""
    velocity_cutoff: Positive | None = field(1.0e-3, None)
    """Normal speed of approach below which collisions are elastic [m/s], with collapse = "velocity_cutoff"."""
    contact_time: Positive | None = field(1.0e-4, None)
    """Time after a collision of a disk in which its further ones are elastic [s], with collapse = "contact_time"; a
    hundredth of the mean free time changes the gas little."""
    resting_speed: Positive | None = field(1.0e-3, None)
    """Speed below which contacts last and disks fall asleep under gravity [m/s], with collapse = "rest"."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, those in the numbers of each remedy for collapse included."""
        chosen, problems = data.get("collapse", "none"), []
        for kind, (number, _) in REMEDIES.items():
            if number in data and kind != chosen and chosen in ("none", *REMEDIES):
                text = f'{number} cannot be combined with collapse = "{chosen}": it is of collapse = "{kind}"'
                problems.append(text)
            if number not in data and kind == chosen:
                problems.append(f'collapse = "{chosen}": {number} missing')
        return problems + super().problems(data)

    def choose_runtime(self) -> None:
        """Have kernels compiled by this runtime. InputError if it is not there."""
        runtime.choose(self.runtime, "run.runtime")

    def made_device(self) -> Device:
        """The device."""
        return Device(self.device, threads=self.threads, precision=self.precision, low_memory=self.low_memory)

    def made_collapse(self) -> Collapse | None:
        """The remedy for inelastic collapse; None without."""
        if self.collapse not in REMEDIES:
            return None
        key, kind = REMEDIES[self.collapse]
        return kind(getattr(self, key))


def _without_aspect(data: Mapping[str, Any]) -> list[str]:
    return ["aspect requires packing_fraction"] * ("aspect" in data and "packing_fraction" not in data)


class BoxSection(Section):
    """The rectangle in which the disks move, with a corner at the origin and periodic sides or walls; or open space."""

    one_of: ClassVar[tuple[tuple[str, ...], ...]] = (("packing_fraction", "lengths"),)

    packing_fraction: PackingFraction | None = field(0.25, None)
    """Fraction of the area that disks cover [1], up to 0.9069, the densest packing of equal disks; start.positions
    says how dense a start can be."""
    aspect: Ratio = field(1.0, 1.0)
    """Ratio of the sides Lx/Ly [1]."""
    lengths: Sides | None = field([8.0, 8.0], None)
    """Sides [Lx, Ly] [m]."""
    shear_rate: Real = field(0.5, 0.0)
    """Rate du_x/dy of a steady shear flow along x [1/s]; starts and temperatures are relative to it."""
    open: bool = field(True, False)
    """No box: disks may fly apart for ever [true or false]. packing_fraction or lengths are then those of the
    rectangle in which they start, and not needed with a start file."""
    periodic: list[bool] = field([True, False], [True, True], min_length=2, max_length=2)
    """Periodic along x and along y: disks that leave enter at the opposite side [true or false]; sides that are not
    periodic are straight walls."""
    material: Name | None = field("steel", None)
    """Name of the material of walls at the sides [text]; needed where a side is not periodic. That of a species, or
    another one with a [[pair]] for each material of the disks."""
    gravity: Pair = field([0.0, -EARTH], [0.0, 0.0])
    """Acceleration [gx, gy] of all disks [m/s^2]; only along directions that are not periodic."""
    gravity_rotation_rate: Real = field(0.02, 0.0)
    """Rate at which gravity rotates [rad/s], positive counter-clockwise: a slow drum in its own frame, which rotates
    the other way in the lab. gravity is its value at time 0; no side may be periodic."""
    gravity_rotation_step: Step = field(DEFAULT_STEP, DEFAULT_STEP)
    """Angle of the steps in which gravity rotates [rad]."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Also whether sides that are walls have a material, and there is gravity to turn. Open space needs no size."""
        is_open, sized = data.get("open") is True, {"packing_fraction", "lengths"} & set(data)
        problems = super().problems(data) if sized or not is_open else []
        problems += _without_aspect(data)
        periodic, gravity = data.get("periodic", [True, True]), data.get("gravity", [0.0, 0.0])
        if turns := data.get("gravity_rotation_rate"):
            if not isinstance(gravity, list) or not any(gravity):
                problems.append(
                    f"gravity_rotation_rate = {turns}: there is no gravity to turn; gravity is missing"
                )
        elif "gravity_rotation_step" in data:
            problems.append("gravity_rotation_step requires gravity_rotation_rate")
        if is_open:
            return problems + exclusive_with(data, "open", "periodic", "material")
        if not isinstance(periodic, list) or [*map(type, periodic)] != [bool, bool]:
            return problems
        if not all(periodic) and "material" not in data:
            problems.append(
                "material is missing: the name of the material of those sides that are not periodic"
            )
        if all(periodic) and "material" in data:
            problems.append("material: both directions are periodic, so there are no walls at the sides")
        return problems

    def made_gravity(self) -> Gravity:
        """Gravity, constant or rotating."""
        gravity = (self.gravity[0], self.gravity[1])
        if not self.gravity_rotation_rate:
            return gravity
        return RotatingGravity(gravity, rate=self.gravity_rotation_rate, step=self.gravity_rotation_step)

    def start_region(self, covered: float) -> Box | None:
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


class RadiiSection(Section):
    """Radii that are not all equal: a distribution, sampled with the run's seed."""

    kind_key: ClassVar[str] = "distribution"

    distribution: str = field("lognormal")
    """ "uniform" (low, high), "gaussian" (mean, deviation), "lognormal" (mean, deviation) or "bidisperse" (low, high,
    large_fraction)."""

    @model_validator(mode="after")
    def _describes_radii(self) -> RadiiSection:
        try:
            radii.check(self.distribution, **self.parameters)
        except InputError as error:
            raise refusal(str(error)) from None
        return self

    @property
    def parameters(self) -> dict[str, float]:
        """The numbers that are given, by name."""
        return self.model_dump(exclude={"distribution"}, exclude_none=True)


class UniformRadii(RadiiSection):
    """Radii that are equally frequent between two ends."""

    distribution: Literal["uniform"]
    low: Positive = field(5.0e-3)
    """Smallest radius [m]."""
    high: Positive = field(20.0e-3)
    """Largest radius [m]."""


class GaussianRadii(RadiiSection):
    """Radii around a mean, cut off at two ends."""

    distribution: Literal["gaussian"]
    mean: Positive = field(10.0e-3)
    """Mean radius of the whole distribution [m]."""
    deviation: Positive = field(2.0e-3)
    """Standard deviation of the radius, not of its logarithm [m]."""
    low: Positive | None = field(5.0e-3, None)
    """Smallest radius [m]; of a Gaussian, 3 deviations below the mean without it."""
    high: Positive | None = field(20.0e-3, None)
    """Largest radius [m]; of a Gaussian, 3 deviations above the mean without it."""


class LognormalRadii(GaussianRadii):
    """Radii whose logarithms are Gaussian, cut off where ends are given."""

    distribution: Literal["lognormal"]  # type: ignore[assignment]


class BidisperseRadii(RadiiSection):
    """Radii of two sizes."""

    distribution: Literal["bidisperse"]
    low: Positive = field(5.0e-3)
    """The smaller radius [m]."""
    high: Positive = field(20.0e-3)
    """The larger radius [m]."""
    large_fraction: Part = field(0.5)
    """Part of the disks that have radius high [1]."""


Radii = Annotated[
    UniformRadii | GaussianRadii | LognormalRadii | BidisperseRadii, Field(discriminator="distribution")
]


class SpeciesSection(Section):
    """Disks of one kind, of equal radii or not."""

    choices: ClassVar[tuple[str, ...]] = (
        "Either coin, or one of mass, areal_density and one of radius, diameter, radii",
    )

    name: Name = field("coins")
    """Name [text]."""
    number: NumberOfDisks = field(50000)
    """Number of disks [whole number]."""
    material: Name | None = field("aluminium", None)
    """Name of the material [text]; not needed with a coin, which brings its own."""
    coin: CoinName | None = field("1 pta", None)
    """Coin of the paper's Sec. III [text; SI units only] whose mass and diameter are taken."""
    mass: Positive | None = field(1.19e-3, None)
    """Mass of one disk [kg]."""
    radius: Positive | None = field(10.5e-3, None)
    """Radius [m]."""
    diameter: Positive | None = field(21.0e-3, None)
    """Diameter [m]."""
    radii: Radii | None = field({"distribution": "gaussian", "mean": 10.5e-3, "deviation": 1.0e-3}, None)
    """Distribution of the radii instead of one radius [table; m]: "uniform" (low, high), "gaussian" or "lognormal"
    (mean, deviation; cut off at low, high), "bidisperse" (low, high, large_fraction by number)."""
    areal_density: Positive | None = field(3.4, None)
    """Mass per area [kg/m^2] instead of one mass: each disk has areal_density pi R^2. It is the density of the
    material times the thickness of the disks."""
    k: Ratio = field(2.0, 2.0)
    """Shape number in the moment of inertia m R^2 / k [1]: 2 homogeneous disk, 1 hoop."""
    speed_rms: NonNegative = field(1.0, 0.0)
    """Root mean square speed at the start [m/s], Maxwellian, the whole gas without momentum."""
    temperature: NonNegative | None = field(0.6e-3, None)
    """Temperature at the start, the mean of m v^2 / 2 [J], instead of speed_rms."""
    spin_rms: NonNegative = field(0.0, 0.0)
    """Root mean square spin at the start [rad/s], Gaussian."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """A mass and a size that are missing, or given twice; with a coin, given at all."""
        masses, sizes = ("mass", "areal_density"), ("radius", "diameter", "radii")
        problems = exclusive_with(data, "temperature", "speed_rms")
        if "coin" in data:
            return problems + exclusive_with(data, "coin", *masses, *sizes, "k")
        for group in (masses, sizes):
            given = [key for key in group if key in data]
            if len(given) != 1:
                text = f"must have exactly one of {', '.join(group)}, or coin; given: {', '.join(given) or 'none'}"
                problems.append(text)
        return problems

    @property
    def moves(self) -> bool:
        """True if its disks move at the start."""
        return bool(self.speed_rms or self.temperature)


class ForceSection(Section):
    """A force on all disks between collisions: driving or drag."""

    kind: str = field("random_kicks")
    """ "random_kicks" (step; power or diffusion), "poisson_kicks" (the same at random times: rate), "spin_kicks" and
    "poisson_spin_kicks" (the same for spins), "langevin" (a heat bath; temperature, rate, spin_temperature, spin_rate),
    "drag" (rate, quadratic, spin_rate), "rescale" (a thermostat; temperature or energy) or "table_friction" (disks
    that lie on a table; mu, gravity)."""

    some: ClassVar[tuple[str, ...]] = ()
    """Rates of which at least one is to be above 0."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, a missing rate included."""
        problems = super().problems(data)
        if cls.some and not any(data.get(key) for key in cls.some):
            problems.append(f"at least one of {', '.join(cls.some)} must be above 0")
        return problems

    def made(self) -> ModelForce:
        """The force. Imports the runtime."""
        from ..model import forces

        kind: type[ModelForce] = getattr(forces, class_of(self.kind))
        return kind(**self.model_dump(exclude={"kind"}, exclude_none=True))

    @property
    @abstractmethod
    def interval(self) -> float:
        """Time between two applications [time]; of a force at random times, its mean for one disk."""

    @property
    def moves_disks_at_rest(self) -> bool:
        """True if the force sets disks in motion that are at rest."""
        return False

    @property
    def is_random(self) -> bool:
        """True if the force draws random numbers."""
        return False

    @property
    def has_medium(self) -> bool:
        """True if the force slows velocities down to those of a medium at rest."""
        return False


class SteppedForce(ForceSection):
    """A force on all disks between collisions, at the middle of each step: driving or drag."""

    step: Positive = field(2e-3)
    """Time between two applications [s]; a part of the mean free time. Errors go with its square."""

    @property
    def interval(self) -> float:
        """The step [time]."""
        return self.step


class Kicks(ForceSection):
    """Random kicks."""

    one_of: ClassVar[tuple[tuple[str, ...], ...]] = (("power", "diffusion"),)

    power: Positive | None = field(1e-3, None)
    """Energy that each disk gets per time [W]."""
    diffusion: Positive | None = field(0.5, None)
    """Instead of power: D in <dv_x^2> = 2 D dt [m^2/s^3], or <d omega^2> = 2 D dt [rad^2/s^3]."""

    @property
    def moves_disks_at_rest(self) -> bool:
        """True but for kicks of spins, which alone bring no disks together."""
        return "spin" not in self.kind

    @property
    def is_random(self) -> bool:
        """True."""
        return True


class KicksAtRandomTimes(Kicks):
    """Random kicks of each disk by itself, at random times."""

    rate: Positive = field(500.0)
    """Mean number of kicks of a disk per time, at random times (a Poisson process) [1/s]."""

    @property
    def interval(self) -> float:
        """The mean time between two kicks of a disk [time]."""
        return 1.0 / self.rate


class RandomKicksForce(Kicks, SteppedForce):
    """Random kicks, which conserve the total momentum."""

    kind: Literal["random_kicks"]


class PoissonKicksForce(KicksAtRandomTimes):
    """Random kicks of each disk by itself, at random times."""

    kind: Literal["poisson_kicks"]


class SpinKicksForce(Kicks, SteppedForce):
    """Random changes of spins."""

    kind: Literal["spin_kicks"]


class PoissonSpinKicksForce(KicksAtRandomTimes):
    """Random changes of each spin by itself, at random times."""

    kind: Literal["poisson_spin_kicks"]


class LangevinForce(SteppedForce):
    """A heat bath: friction, and random forces of its temperature."""

    some: ClassVar[tuple[str, ...]] = ("rate", "spin_rate")

    kind: Literal["langevin"]
    temperature: NonNegative = field(5e-4)
    """Of the heat bath, mean of m v^2 / 2 [J]."""
    rate: NonNegative | None = field(0.5, None)
    """Friction rate of velocities [1/s]."""
    spin_rate: NonNegative | None = field(0.5, None)
    """Friction rate of spins [1/s]."""
    spin_temperature: NonNegative | None = field(5e-4, None)
    """Of the heat bath for spins, mean of I omega^2 [J]; temperature without it."""

    @property
    def moves_disks_at_rest(self) -> bool:
        """True of a warm bath that acts on velocities."""
        return self.temperature != 0.0 and self.rate != 0.0

    @property
    def is_random(self) -> bool:
        """True of a warm bath."""
        return bool(self.temperature or self.spin_temperature)

    @property
    def has_medium(self) -> bool:
        """True if it acts on velocities."""
        return bool(self.rate)


class DragForce(SteppedForce):
    """Drag of a medium at rest."""

    some: ClassVar[tuple[str, ...]] = ("rate", "quadratic", "spin_rate")

    kind: Literal["drag"]
    rate: NonNegative | None = field(0.5, None)
    """Friction rate of velocities [1/s]."""
    quadratic: NonNegative | None = field(0.1, None)
    """Quadratic drag over mass, c in dv/dt = -c |v| v [1/m]."""
    spin_rate: NonNegative | None = field(0.5, None)
    """Friction rate of spins [1/s]."""

    @property
    def has_medium(self) -> bool:
        """True if it acts on velocities."""
        return any((self.rate, self.quadratic))


class RescaleForce(SteppedForce):
    """A thermostat: multiplies velocities to keep the temperature or the energy constant."""

    one_of: ClassVar[tuple[tuple[str, ...], ...]] = (("temperature", "energy"),)

    kind: Literal["rescale"]
    temperature: Positive | None = field(5e-4, None)
    """To rescale to: mean of m v^2 / 2 [J]."""
    energy: Positive | None = field(1e-3, None)
    """To rescale to: kinetic energy of a disk, spins included, mean over all [J]."""


class TableFrictionForce(SteppedForce):
    """Friction of disks that lie on a table."""

    kind: Literal["table_friction"]
    mu: Ratio = field(0.2)
    """Sliding friction on the table [1]."""
    gravity: Positive | None = field(
        EARTH,
        None,
        description=f"acceleration that presses disks on the table [m/s^2]; without it {EARTH} in SI units, "
        "required in reduced units",
    )

    @property
    def has_medium(self) -> bool:
        """True: the table."""
        return True


Force = Annotated[
    RandomKicksForce
    | PoissonKicksForce
    | SpinKicksForce
    | PoissonSpinKicksForce
    | LangevinForce
    | DragForce
    | RescaleForce
    | TableFrictionForce,
    Field(discriminator="kind"),
]


def is_trajectory(positions: str) -> bool:
    """True if start.positions is the name of a trajectory file."""
    return positions.endswith(".h5")


def _known_positions(positions: str) -> str:
    if positions in PLACEMENTS or is_trajectory(positions):
        return positions
    text = (
        f"must be {', '.join(repr(kind) for kind in PLACEMENTS)} or the name of a trajectory that ends in .h5"
    )
    if positions.endswith(".csv"):
        text += f'; a CSV file is named by file = "{positions}"'
    raise refusal(text + nearest(positions, PLACEMENTS), "unknown_name")


class StartSection(Section):
    """Positions of the disks at the start."""

    choices: ClassVar[tuple[str, ...]] = ("At most one of: positions, file",)

    positions: Annotated[str, AfterValidator(_known_positions)] = field("random", "random")
    """ "random" (one by one, to 0.5 of the area), "grown" (random too, to 0.84), "hexagonal" (a
    lattice), "impact_scan" (pairs, one disk of each at rest, hit at angles psi), or the name of a trajectory, such as
    "run.h5" (path from the case file), whose box must be the same."""
    frame: Whole | None = field(-1, None)
    """Frame of the trajectory, dump or extended XYZ [whole number]: 0 the first, -1 the last, which it is without this
    key."""
    motion: bool = field(True, False)
    """Take velocities and spins from the frame as well [true or false], instead of speed_rms and spin_rms."""
    time: NonNegative | None = field(0.0, None)
    """Time of the run's clock at the start [s], by which walls move and open, gravity turns and forces act. With a
    frame it begins a new clock; by default the clock of the frame continues, with its numbers of collisions. The
    default for a file is 0."""
    psi: Angles | None = field([0.0, 89.0], None)
    """Of an impact scan: first and last angle of impact from the line of centres [degrees]; 0 and 89 without it."""
    speed: Positive | None = field(1.0, None)
    """Of an impact scan: speed of the disk that hits [m/s]."""
    file: Name | None = field("start.csv", None)
    """CSV file [text; path from the case file]: a line for each disk, in the order of the species, with the columns
    x, y [m] and, to set velocities too, vx, vy [m/s] and spin [rad/s]. Or a dump of LAMMPS, or extended XYZ, whose rows
    are put into that order by type and id."""
    columns: dict[str, str] | None = field({"x": "pos x"}, None)
    """Names of columns in the file, if they differ [table]."""
    units: dict[str, str] | None = field({"x": "mm"}, None)
    """Units of columns in the file, if not SI [table], such as mm, cm/s, deg/s, or a factor."""
    delimiter: str | None = field(";", None)
    """Character that separates the CSV file's columns [text]."""
    decimal: Literal[".", ","] | None = field(",", None)
    """Decimal point of the CSV file [text]: "." or ","."""
    relax: Positive | None = field(1.0e-4, None)
    """Largest overlap of disks in the file that is an error of measurement [m]: these disks are separated."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, keys for trajectories or impact scans only included."""
        positions, file = data.get("positions", "random"), data.get("file")
        if isinstance(file, str) and is_trajectory(file):
            return [
                f'file = "{file}": a trajectory is named by positions = "{file}"; file is for CSV, dumps of LAMMPS and extended XYZ'
            ]
        given = [key for key in ("frame", "motion", "time") if key in data]
        if given and "file" not in data and isinstance(positions, str) and not is_trajectory(positions):
            also = "" if "motion" in given else ", or file, a dump of LAMMPS or extended XYZ"
            also += ', or "time" with a CSV file' if given == ["time"] else ""
            return [f'{", ".join(given)}: requires positions = "NAME.h5", the frame of a trajectory{also}']
        scan = [key for key in ("psi", "speed") if key in data]
        if positions == IMPACT_SCAN and "speed" not in data:
            return [f'positions = "{IMPACT_SCAN}": speed is missing, that of the disks that hit']
        if scan and positions != IMPACT_SCAN:
            return [f'{", ".join(scan)}: requires positions = "{IMPACT_SCAN}"']
        if "file" in data:
            if "motion" in data:
                return ["motion: leave it out with file; velocities and spins of the file are always taken"]
            return exclusive_with(data, "file", "positions")
        of_file = [key for key in ("columns", "units", "delimiter", "decimal", "relax") if key in data]
        return [f"{', '.join(of_file)}: requires file"] * bool(of_file and file is None)

    @property
    def placed(self) -> bool:
        """True if positions are generated, neither read from a file nor those of an impact scan."""
        return self.file is None and self.positions in PLACED

    @property
    def trajectory(self) -> str | None:
        """The trajectory that a frame is taken from, if one is."""
        return self.positions if is_trajectory(self.positions) else None

    @property
    def form(self) -> TableFormat | None:
        """Form of the CSV file, where it differs."""
        if (self.columns, self.units, self.delimiter, self.decimal) == (None,) * 4:
            return None
        return TableFormat(
            self.columns or {}, self.units or {}, {}, self.delimiter or ",", self.decimal or "."
        )

    @property
    def psi_range(self) -> tuple[float, float]:
        """First and last angle of an impact scan [degrees]."""
        return (0.0, 89.0) if self.psi is None else (self.psi[0], self.psi[1])


class CaseSections(Section):
    """Sections of a case file."""

    run: RunSection
    box: BoxSection
    material: list[Material] = Field(default_factory=list)
    pair: list[PairOfMaterials] = Field(default_factory=list)
    species: list[SpeciesSection] = Field(min_length=1)
    wall: list[Wall] = Field(default_factory=list)
    force: list[Force] = Field(default_factory=list)
    start: StartSection = Field(default_factory=StartSection)
    output: OutputSection = Field(default_factory=OutputSection)

    @property
    def walled(self) -> bool:
        """True if there are walls, at sides of the box or elsewhere."""
        return bool(self.wall) or not all(self.box.periodic)

    @property
    def frequencies(self) -> set[float]:
        """Frequencies of the walls that move or turn to and fro [1/time]."""
        moving = [each for wall in self.wall for each in (wall.motion, wall.turn)]
        return {each.frequency for each in moving if isinstance(each, SineMotion | SineTurn)}

    @property
    def frame_cadence(self) -> Trigger:
        """Times or collisions at which frames are due."""
        return self.output.frame_cadence(self.period)

    @property
    def series_cadence(self) -> Trigger:
        """Times or collisions at which rows of the time series are due."""
        return self.output.series_cadence(self.period)

    @property
    def period(self) -> float | None:
        """Period of the walls that move to and fro [time]; None unless they have one frequency."""
        return 1.0 / next(iter(self.frequencies)) if len(self.frequencies) == 1 else None

    @property
    def homogeneous(self) -> bool:
        """True if kinetic theory of a homogeneous gas may hold: without walls, gravity and elastic exceptions."""
        return not self.walled and not any(self.box.gravity) and self.run.collapse == "none"

    @property
    def sets_in_motion(self) -> bool:
        """True if a flow, a force, a wall or gravity moves disks that are at rest, or may."""
        kicked = (each.moves_disks_at_rest for each in self.force)
        moving = any(
            each.motion is not None or each.turn is not None or each.piston is not None for each in self.wall
        )
        return self.box.shear_rate != 0.0 or any(kicked) or moving or any(self.box.gravity)

    @property
    def law_files(self) -> tuple[str, ...]:
        """Paths of the files of custom laws, as the case has them."""
        sections = [each for each in (*self.material, *self.pair) if isinstance(each, FileKeys)]
        return tuple(dict.fromkeys(each.law.rpartition(":")[0] for each in sections))

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of all files that the case reads, as it has them."""
        sections = (*self.wall, *self.material, *self.pair)
        given = (self.start.file, self.start.trajectory, *(getattr(each, "file", None) for each in sections))
        return tuple(dict.fromkeys((*filter(None, given), *self.law_files)))

    @property
    def materials_of_walls(self) -> tuple[str, ...]:
        """The materials of walls, that of the sides of the box first."""
        named = (self.box.material, *(each.material for each in self.wall))
        return tuple(dict.fromkeys(each for each in named if each is not None))

    def unit(self, quantity: str) -> str:
        """Unit as printed after a number: " m" for "length" in SI, nothing in reduced units."""
        return f" {UNITS[self.run.units][quantity]}" if self.run.units == "SI" else ""
