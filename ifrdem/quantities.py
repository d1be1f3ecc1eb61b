"""The quantities that are recorded: of each disk in a frame, of each collision of a tracked disk, of the whole gas.

One row says all that any part of the program knows of a quantity: kernels make the rows of their frames from it, files
their datasets and texts, cases the names that they take, `check` its bytes, studies and tables their axes.
"""

from __future__ import annotations

from typing import NamedTuple

MECHANISMS = ("normal", "tangential_restitution", "sliding", "sticking", "rolling", "walls", "rest")
"""Mechanisms by which collisions take energy: normal and tangential restitution, friction while it slides or sticks,
rolling friction, all of these in collisions with walls, and what disks lose that fall asleep."""
REGIMES = ("sliding", "sticking", "rolling_sliding", "rolling_sticking", "elastic")
"""Of collisions of two disks: whether friction slides or sticks, with the rolling torque rho P_n or without, or whether
a remedy for collapse made them elastic."""
COMPONENTS = ("xx", "xy", "yx", "yy")
"""Of the pressure tensor: first of the momentum, then of the normal of the line that it crosses."""
AXES = {"axis": ("x", "y"), "mechanism": MECHANISMS, "regime": REGIMES, "component": COMPONENTS}
"""Names of the numbers along an axis that is the same in all gases."""

PRECISIONS = {"f32": "f4", "f64": "f8"}
"""Types of NumPy by names of precisions."""
NUMBER = "1"
"""Dimension, and unit, of pure numbers and counts."""


class Quantity(NamedTuple):
    """A quantity that is recorded.

    Attributes
    ----------
    name : str
        Name in Python; in files, too, but where `file` has another one.
    text : str
        Description.
    dimension : str
        Names and powers, such as "energy length-2", "1" or "radian".
    along : str
        Axis of one row: "" for a number, a name in `AXES`, or "species", "pair" of species, "region", "piston"
        or "wall".
    type : str
        "real": the precision of the frame; "f8", "i4" or "i1": this type of NumPy.
    file : str or None
        Name in files where it is another one; None for what files do not hold.
    feature : str
        Feature of `kernels/layout.Uses`, or key of `[output]`, without which there is none.
    adds_up : bool
        True for what is counted from the start of the run: a mean over rows says nothing of it.
    """

    name: str
    text: str
    dimension: str = NUMBER
    along: str = ""
    type: str = "real"
    file: str | None = ""
    feature: str = ""
    adds_up: bool = False

    @property
    def stored(self) -> str | None:
        """Name in files; None for what they do not hold."""
        return self.name if self.file == "" else self.file

    @property
    def tail(self) -> tuple[int, ...]:
        """Shape of one row, of a quantity whose axis is the same in all gases."""
        return (len(AXES[self.along]),) if self.along else ()

    @property
    def components(self) -> int:
        """Numbers of one row."""
        return self.tail[0] if self.along else 1

    @property
    def whole(self) -> bool:
        """True for whole numbers."""
        return self.type.startswith("i")

    @property
    def dataset(self) -> str:
        """Name of the dataset with the data inside the group of a field, where vectors have a view in 3D too."""
        return "value_2d" if self.along == "axis" else "value"

    def dtype(self, real: str = "f8") -> str:
        """Type of NumPy, where that of the frame is `real`."""
        return real if self.type == "real" else self.type


def _by_name(*quantities: Quantity) -> dict[str, Quantity]:
    return {each.name: each for each in quantities}


Q = Quantity
IMAGE = Q("image", "box lengths travelled through periodic sides", along="axis", type="i4")

FRAME = _by_name(
    Q("position", "positions of the centres, inside the box", "length", "axis"),
    Q("velocity", "velocities of the centres", "velocity", "axis"),
    Q("angle", "angles turned since the start, full turns included, counter-clockwise", "angle", feature="angle"),
    Q("spin", "angular velocities, counter-clockwise", "angular_velocity", file="angular_velocity"),
    Q("dissipated", "energy dissipated by the collisions of each disk so far, half of each collision, by mechanism: "
      "normal restitution, tangential restitution, sliding, sticking, rolling friction, walls, falling asleep",
      "energy", "mechanism", feature="dissipated"),
    Q("latest_collision", "times of the latest collision", "time", file=None, feature="latest_collision"),
    Q("collisions", "collisions of each disk so far", type="i4"),
    IMAGE,
    Q("last_partner", "partner of the latest collision; -1 none yet, -2 - w wall w", type="i4", feature="last_partner"),
    Q("asleep", "1 for disks that sleep", type="i4", feature="rest"),
    Q("wall_collisions", "collisions with walls", type="i4", file=None, feature="walls"),
)  # fmt: skip
"""Quantities of each disk, in the order of its row in memory."""
FIELDS = {each.stored: each for each in FRAME.values() if each.stored}
"""Those that files hold, by their names there."""

EVENT = _by_name(
    Q("time", "time of the collision", "time", type="f8"),
    Q("id", "number of the tracked disk", type="i4"),
    Q("partner", "partner of the collision: a disk, a wall, or none", type="i4"),
    Q("position", "position of the disk's centre, inside the box", "length", "axis", "f8"),
    IMAGE,
    Q(
        "normal",
        "unit vector from the disk's centre to the partner; 0 without a collision",
        NUMBER,
        "axis",
        "f8",
    ),
    Q("velocity_before", "velocity of the disk before the collision", "velocity", "axis", "f8"),
    Q("velocity_after", "velocity of the disk after the collision", "velocity", "axis", "f8"),
    Q("spin_before", "angular velocity of the disk before the collision", "angular_velocity", type="f8"),
    Q("spin_after", "angular velocity of the disk after the collision", "angular_velocity", type="f8"),
    Q(
        "partner_velocity_before",
        "velocity of the partner before; of a wall, at the contact",
        "velocity",
        "axis",
        "f8",
    ),
    Q(
        "partner_velocity_after",
        "velocity of the partner after; of a wall, at the contact",
        "velocity",
        "axis",
        "f8",
    ),
    Q(
        "partner_spin_before",
        "angular velocity of the partner before; 0 of a wall",
        "angular_velocity",
        type="f8",
    ),
    Q(
        "partner_spin_after",
        "angular velocity of the partner after; 0 of a wall",
        "angular_velocity",
        type="f8",
    ),
    # P_n, P_t along n and t = (-n_y, n_x).
    Q("impulse", "normal and tangential impulse of the disk on its partner", "momentum", "axis", "f8"),
    Q("psi", "impact angle, between relative velocity and line of centres, 0 to pi/2", "radian", type="f8"),
    Q("regime", "regime of the collision", type="i1"),
)
"""Quantities of each collision of a tracked disk, in the order of a row of `Events`; `trajectory.layout.MEANINGS` says
what the numbers of partners and regimes mean."""

START = _by_name(
    Q("position", "positions of the tracked disks at that time, inside the box", "length", "axis", "f8"),
    Q("velocity", "velocities of the tracked disks at that time", "velocity", "axis", "f8"),
    Q("spin", "angular velocities of the tracked disks at that time", "angular_velocity", type="f8"),
    IMAGE,
)
"""Quantities of each tracked disk at the time at which tracking began."""

SERIES = _by_name(
    Q("translational_energy", "kinetic energy of translation", "energy"),
    Q("rotational_energy", "kinetic energy of rotation", "energy"),
    Q("energy", "kinetic energy, translational and rotational", "energy"),
    Q("temperature", "translational temperature T = <m v^2> / 2, v relative to the mean velocity where the whole gas "
      "can drift freely, otherwise in the lab", "energy"),
    Q("rotational_temperature", "rotational temperature T_rot = <I w^2>", "energy"),
    Q("momentum", "total momentum", "momentum", "axis"),
    Q("potential_energy", "potential energy in gravity, 0 at the lower left corner of the box", "energy"),
    Q("energy_input", "energy that forces and the mean flow have put in since the start", "energy", adds_up=True),
    Q("wall_work", "work of moving walls on the disks since the start", "energy", adds_up=True),
    Q("wall_heat", "heat from thermal walls since the start", "energy", adds_up=True),
    Q("dissipated_energy", "energy dissipated since the start", "energy", adds_up=True),
    Q("collisions", "collisions of two disks since the start, each counted once", adds_up=True),
    Q("wall_collisions", "collisions with walls since the start", adds_up=True),
    Q("dissipated_by_mechanism", "energy dissipated since the start, by mechanism", "energy", "mechanism",
      feature="ledger", adds_up=True),
    Q("collisions_by_regime", "collisions of two disks since the start, by regime", NUMBER, "regime",
      feature="ledger", adds_up=True),
    Q("ledger_residual", "initial energy + input - dissipated - present energy: rounding", "energy",
      feature="ledger", adds_up=True),
    Q("stress", "pressure tensor, mean since the row before", "energy length-2", "component", feature="stress"),
    Q("stress_kinetic", "kinetic part of stress, mean of this row and the row before", "energy length-2", "component",
      feature="stress"),
    Q("heat_flux", "heat flux, mean since the row before", "energy length-1 time-1", "axis", feature="heat_flux"),
    Q("heat_flux_kinetic", "kinetic part of heat_flux, mean of this row and the row before", "energy length-1 time-1",
      "axis", feature="heat_flux"),
    Q("species_temperature", "translational temperature of each species, v as in temperature", "energy", "species"),
    Q("species_rotational_temperature", "rotational temperature of each species", "energy", "species"),
    Q("species_collisions", "collisions since the start, counted at each disk of a species", NUMBER, "species",
      adds_up=True),
    Q("piston_displacement", "displacement of each piston along its line of motion", "length", "piston"),
    Q("piston_velocity", "velocity of each piston along its line of motion", "velocity", "piston"),
    Q("piston_energy", "kinetic and potential energy of each piston", "energy", "piston"),
    Q("piston_force", "force of its drive on each piston", "force", "piston"),
    Q("center_of_mass", "centre of mass of the movable disks, by their places inside the box", "length", "axis",
      feature="walls"),
    Q("region_disks", "movable disks whose centres are in each region", NUMBER, "region"),
    Q("region_mass", "mass of the disks in each region", "mass", "region"),
    Q("region_energy", "kinetic energy of the disks in each region", "energy", "region"),
    Q("histogram_impact_angle", "collisions of two disks since the start by angle of impact, of each pair of species",
      NUMBER, "pair", "i8", feature="histograms", adds_up=True),
    Q("histogram_normal_speed", "collisions of two disks since the start by normal speed, of each pair of species",
      NUMBER, "pair", "i8", feature="histograms", adds_up=True),
    Q("histogram_regime", "collisions of two disks since the start by regime, of each pair of species", NUMBER, "pair",
      "i8", feature="histograms", adds_up=True),
    Q("histogram_free_time", "times since the latest collision of both disks, in collisions of two disks since the "
      "start, of each pair of species", NUMBER, "pair", "i8", feature="free_times", adds_up=True),
    Q("walls_momentum_x", "momentum along x that each wall has given to the disks", "momentum", "wall", adds_up=True),
    Q("walls_momentum_y", "momentum along y that each wall has given to the disks", "momentum", "wall", adds_up=True),
    Q("walls_torque", "angular momentum that each wall has given to the disks", "energy time", "wall", adds_up=True),
    Q("walls_work", "work of each wall on the disks since the start", "energy", "wall", adds_up=True),
    Q("walls_heat", "heat from each wall since the start", "energy", "wall", adds_up=True),
    Q("walls_hits", "collisions with each wall since the start", NUMBER, "wall", adds_up=True),
)  # fmt: skip
"""Quantities of the whole gas, of its species, pistons and walls, in rows of the time series."""


def _without(*, along: tuple[str, ...], feature: str) -> tuple[str, ...]:
    return tuple(name for name, each in SERIES.items() if each.along in along and each.feature == feature)


OBSERVABLES = _without(along=("", "axis"), feature="")
"""Those of the whole gas in each frame and row."""
LEDGER = _without(along=("", "mechanism", "regime"), feature="ledger")
"""Those that rows have with output.ledger."""
STRESS_SERIES = _without(along=("component",), feature="stress")
"""The pressure tensor and its kinetic part."""
HEAT_SERIES = _without(along=("axis",), feature="heat_flux")
"""The heat flux and its kinetic part."""
CENTER_SERIES = _without(along=("axis",), feature="walls")
"""The centre of mass."""
REGION_SERIES = _without(along=("region",), feature="")
"""Those with a column for each region, in the order of `columns.REGION`."""
SPECIES_SERIES = _without(along=("species",), feature="")
"""Those with a column for each species."""
HISTOGRAMS = tuple(name for name, each in SERIES.items() if each.along == "pair")
"""Those with a row for each pair of species, in the order of `kernels.columns.HISTOGRAM`, in frames."""
PISTON_SERIES = _without(along=("piston",), feature="")
"""Those with a column for each piston, in the order of `Simulation.pistons`."""
WALL_SERIES = _without(along=("wall",), feature="")
"""Those with a column for each wall, in the order of `Simulation.wall_sums`."""


def numbers_of(names: tuple[str, ...]) -> int:
    """Numbers in a row of these quantities of the whole gas, one for each species, piston or wall."""
    return sum(len(AXES.get(SERIES[name].along, ("",))) for name in names)
