"""A case: what one case file may hold, as pydantic models with the unit in every description.

The models check types, ranges, keys and alternatives, and nothing that needs two sections at once: that
is the task of `ifrdem.gas`. `ifrdem.case_file` reads a file and reports all errors of both kinds together.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from . import radii
from .case_forces import ForceSection
from .engine_limits import MOST_DISKS
from .errors import nearest
from .section import Choice, Section

UNITS: Mapping[str, Mapping[str, str]] = {
    "SI": {"length": "m", "mass": "kg", "time": "s", "energy": "J", "momentum": "kg m s-1", "angle": "rad"},
    "reduced": dict.fromkeys(("length", "mass", "time", "energy", "momentum", "angle"), "reduced"),
}
"""Unit of each quantity by the name in run.units, in the notation of H5MD."""

WAYS_TO_PLACE = ("random", "growth", "hexagonal")

Name = Annotated[str, Field(min_length=1, max_length=100)]


class RunSection(Section):
    """The run as a whole."""

    choices = (Choice(("t_end",)), Choice(("collisions_per_disk",)))

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


class BoxSection(Section):
    """The periodic rectangle that the disks move in."""

    choices = (Choice(("packing_fraction",), also=("aspect",)), Choice(("lengths",)))

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


# The ranges sit inside the Annotated types, so that `X | None` still checks them; `Section.about` finds them.
NormalRestitution = Annotated[
    float, Field(ge=0.0, le=1.0, description="normal restitution e_n [1], 0 to 1 (elastic)", examples=[0.87])
]
TangentialRestitution = Annotated[
    float,
    Field(
        ge=-1.0,
        le=1.0,
        description="tangential restitution e_t [1], -1 (smooth but for friction) to 1; with "
        "percussion-centre sticking, homogeneous disks never gain energy up to -0.5",
        examples=[-0.88],
    ),
]
Friction = Annotated[float, Field(ge=0.0, description="sliding friction mu [1], 0 or more", examples=[0.21])]
Sticking = Annotated[
    Literal["percussion_center", "contact_point"],
    Field(
        description='what stops slipping in a sticking collision: "percussion_center" (Eq. 15, the paper\'s '
        'choice) or "contact_point" (Eq. 12)',
        examples=["percussion_center"],
    ),
]
RollingFriction = Annotated[
    float, Field(ge=0.0, description="rolling friction rho [m], 0 or more", examples=[0.0])
]


class MaterialSection(Section):
    """How two disks of one material collide: coefficients of the IFR law, or the name of one of its coins."""

    choices = (Choice(("e_n", "e_t", "mu")), Choice(("coin",)))

    name: Name = Field(description="name that species and pairs use [text]", examples=["aluminium"])
    coin: Name | None = Field(
        default=None,
        description="take e_n, e_t, mu of this coin of the paper's Table II [text], for instance",
        examples=["1 pta"],
    )
    e_n: NormalRestitution | None = None
    e_t: TangentialRestitution | None = None
    mu: Friction | None = None
    sticking: Sticking = "percussion_center"
    rho: RollingFriction = 0.0


class PairSection(Section):
    """How disks of two different materials collide. No coefficient is ever guessed from two materials."""

    materials: list[Name] = Field(
        min_length=2,
        max_length=2,
        description="names of the two materials [text]",
        examples=[["bronze-aluminium", "aluminium"]],
    )
    e_n: NormalRestitution
    e_t: TangentialRestitution
    mu: Friction
    sticking: Sticking = "percussion_center"
    rho: RollingFriction = 0.0


class RadiiSection(Section):
    """Radii that are not all equal: a distribution, sampled with the run's seed."""

    distribution: Literal["uniform", "gaussian", "lognormal", "bidisperse"] = Field(
        description='"uniform" (low, high), "gaussian" (mean, deviation), "lognormal" (mean, deviation) or '
        '"bidisperse" (low, high, large_fraction)',
        examples=["lognormal"],
    )
    mean: float | None = Field(
        default=None, gt=0.0, description="mean radius of the whole distribution [m]", examples=[10.0e-3]
    )
    deviation: float | None = Field(
        default=None,
        gt=0.0,
        description="standard deviation of the radius, not of its logarithm [m]",
        examples=[2.0e-3],
    )
    low: float | None = Field(
        default=None,
        gt=0.0,
        description="smallest radius [m]: cuts off a Gaussian (else at 3 deviations) or lognormal distribution",
        examples=[5.0e-3],
    )
    high: float | None = Field(
        default=None, gt=0.0, description="largest radius [m]: cuts off likewise", examples=[20.0e-3]
    )
    large_fraction: float | None = Field(
        default=None,
        gt=0.0,
        lt=1.0,
        description="part of the disks that have radius high [1]",
        examples=[0.5],
    )

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """Which keys the distribution lacks, or cannot have."""
        name = data.get("distribution")
        if not isinstance(name, str) or name not in radii.PARAMETERS:
            return None  # which the key itself reports
        known = [key for key in data if key in cls.model_fields and key != "distribution"]
        return radii.wrong_parameters(name, dict.fromkeys(known))

    @property
    def parameters(self) -> dict[str, float]:
        """The numbers that are given, by name."""
        return {
            key: value
            for key, value in self.model_dump(exclude={"distribution"}).items()
            if value is not None
        }


class SpeciesSection(Section):
    """Disks of one kind, of equal radii or not."""

    choices = (
        Choice(("mass", "radius"), also=("k",)),
        Choice(("mass", "diameter"), also=("k",)),
        Choice(("coin",)),
        Choice(("mass", "radii"), also=("k",)),
        Choice(("areal_density", "radius"), also=("k",)),
        Choice(("areal_density", "diameter"), also=("k",)),
        Choice(("areal_density", "radii"), also=("k",)),
    )

    name: Name = Field(description="name [text]", examples=["coins"])
    number: int = Field(ge=1, le=MOST_DISKS, description="number of disks [whole number]", examples=[50000])
    material: Name | None = Field(
        default=None,
        description="name of the material [text]; not needed with a coin, which brings its own",
        examples=["aluminium"],
    )
    coin: Name | None = Field(
        default=None,
        description="mass and diameter of this coin of the paper's Sec. III [text; SI units only]",
        examples=["1 pta"],
    )
    mass: float | None = Field(default=None, gt=0.0, description="mass of one disk [kg]", examples=[1.19e-3])
    radius: float | None = Field(default=None, gt=0.0, description="radius [m]", examples=[10.5e-3])
    diameter: float | None = Field(default=None, gt=0.0, description="diameter [m]", examples=[21.0e-3])
    radii: RadiiSection | None = Field(
        default=None,
        description='distribution of the radii instead of one radius [table; m]: "uniform" (low, high), "gaussian" or '
        '"lognormal" (mean, deviation; cut off at low, high), "bidisperse" (low, high, large_fraction by number)',
        examples=[{"distribution": "gaussian", "mean": 10.5e-3, "deviation": 1.0e-3}],
    )
    areal_density: float | None = Field(
        default=None,
        gt=0.0,
        description="mass per area [kg/m^2] instead of one mass: each disk has areal_density pi R^2. It is the "
        "density of the material times the thickness of the disks",
        examples=[3.4],
    )
    k: float = Field(
        default=2.0,
        gt=0.0,
        description="shape number in the moment of inertia m R^2 / k [1]: 2 homogeneous disk, 1 hoop",
        examples=[2.0],
    )
    speed_rms: float = Field(
        default=0.0,
        ge=0.0,
        description="root mean square speed at the start [m/s], Maxwellian, without total momentum",
        examples=[1.0],
    )
    spin_rms: float = Field(
        default=0.0,
        ge=0.0,
        description="root mean square spin at the start [rad/s], Gaussian",
        examples=[0.0],
    )


def is_trajectory(positions: str) -> bool:
    """Whether start.positions is the name of a trajectory file."""
    return positions.endswith(".h5")


def _known_positions(positions: str) -> str:
    if positions in WAYS_TO_PLACE or is_trajectory(positions):
        return positions
    text = f"must be {', '.join(repr(way) for way in WAYS_TO_PLACE)} or the name of a trajectory that ends in .h5"
    raise PydanticCustomError("positions", "{text}", {"text": text + nearest(positions, WAYS_TO_PLACE)})


class StartSection(Section):
    """Where the disks are at the start."""

    choices = (Choice(("positions",), also=("frame", "motion")), Choice(("file",)))
    choice_optional = True

    positions: Annotated[str, AfterValidator(_known_positions)] = Field(
        default="random",
        description='"random" (one by one, to 0.5 of the area), "growth" (random too, to 0.84), "hexagonal" (a '
        'lattice), or the name of a trajectory, such as "run.h5" (path from the case file), whose box must be the same',
        examples=["random"],
    )
    frame: int | None = Field(
        default=None,
        description="frame of the trajectory [whole number]: 0 the first, -1 the last, which it is without this key",
        examples=[-1],
    )
    motion: bool = Field(
        default=False,
        description="take velocities and spins from the frame as well [true or false], instead of speed_rms "
        "and spin_rms",
        examples=[True],
    )
    file: Name | None = Field(
        default=None,
        description="CSV file [text; path from the case file]: a line a disk, in the order of the species, "
        "with the columns x, y [m] and, to set velocities too, vx, vy [m/s] and spin [rad/s]",
        examples=["start.csv"],
    )

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """Also what belongs to a trajectory alone."""
        positions = data.get("positions", "random")
        given = [key for key in ("frame", "motion") if key in data]
        if given and "file" not in data and isinstance(positions, str) and not is_trajectory(positions):
            return f'{", ".join(given)}: only with positions = "NAME.h5", the frame of a trajectory'
        if isinstance(file := data.get("file"), str) and is_trajectory(file):
            return f'file = "{file}": a trajectory is named by positions = "{file}"; file is for CSV'
        return super().wrong_choice(data)


class OutputSection(Section):
    """What is kept."""

    frames: int = Field(
        default=100,
        ge=1,
        le=10_000_000,
        description="frames after the initial one [whole number], evenly spaced in what ends the run",
        examples=[100],
    )
    fields: list[Literal["position", "velocity", "angular_velocity", "collisions", "image"]] = Field(
        default=["position", "velocity", "angular_velocity", "collisions"],
        description="what every frame holds of every disk [list of names]; image: box lengths travelled",
        examples=[["position", "velocity", "angular_velocity", "collisions"]],
    )
    compression: Literal["none", "gzip"] = Field(
        default="none",
        description='"none" (fast) or "gzip" (about three quarters of the size, slower to write and to read)',
        examples=["none"],
    )
    precision: Literal["f4", "f8"] = Field(
        default="f4",
        description='"f4" or "f8": bytes of each number in the file, whatever run.precision is',
        examples=["f4"],
    )
    picture: bool = Field(
        default=True, description="draw NAME.png at the end [true or false]", examples=[True]
    )


class Case(Section):
    """Everything a case file says."""

    run: RunSection
    box: BoxSection
    material: list[MaterialSection] = Field(default_factory=list)
    pair: list[PairSection] = Field(default_factory=list)
    species: list[SpeciesSection] = Field(min_length=1)
    force: list[ForceSection] = Field(default_factory=list)
    start: StartSection = Field(default_factory=StartSection)
    output: OutputSection = Field(default_factory=OutputSection)

    def unit(self, quantity: str) -> str:
        """What to print after a number: " m" for "length" in SI, nothing in reduced units."""
        return f" {UNITS[self.run.units][quantity]}" if self.run.units == "SI" else ""
