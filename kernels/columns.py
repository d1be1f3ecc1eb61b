"""Columns of the engine's arrays by name: one table for kernels, the host, checkpoints and estimates of memory.

A table gives each name the number of its column. Some names stand for several: *several* columns that are counted, or
those of another table. `layout.py` describes the arrays, this module their columns. It does not import Taichi:
kernels reach columns by name through `compiler/records.py`, the host through `named`.
"""

import functools
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..quantities import FRAME, Quantity

REAL, F64, F32, I32, U64 = "real", "f64", "f32", "i32", "u64"
"""Types of numbers: REAL is that of the run, f64 or f32."""
BYTES = {REAL: 8, F64: 8, F32: 4, I32: 4, U64: 8}  # of a run in double precision


class Several:
    """Some columns one after another, or some times those of a table: `table.name[m]` is the number of the first.

    Numbers may be those of NumPy, or expressions of Taichi.
    """

    def __init__(self, first: int, count: int, of: "Columns | None" = None) -> None:
        self.first, self.count, self.of = first, count, of
        self.step: int = 1 if of is None else of.width

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.count * self.step

    def __getitem__(self, m: Any) -> Any:
        return self.first + (m if self.of is None else self.step * m)


class Columns:
    """Names of the columns of an array, in order, each with a text that says what it is.

    A name has its text, `begin="begin of the window"`, or for several columns the text with their number
    (`count=("...", 2)`), their table (`losses=("...", MECHANISM)`) or both (`contact=("...", 4, HELD_CONTACT)`).

    Attributes
    ----------
    at : dict
        Number of each column by its name; `Several` or a table for a name that stands for several.
    texts : dict
        The text of each name.
    width : int
        Number of columns.
    first : int
        Number of the first one in the table that this one stands in.

    ValueError if a text is missing, has several lines, or ends with a point.
    """

    of: "Columns | None" = None  # as of `Several`

    def __init__(self, *, first: int = 0, **names: Any) -> None:
        self.first, self._names = first, names
        self.at: dict[str, Any] = {}
        self.texts: dict[str, str] = {}
        at = first
        for name, given in names.items():
            text, *of = given if isinstance(given, tuple) else (given,)
            if not isinstance(text, str) or not text or text.endswith(".") or "\n" in text:
                raise ValueError(f"{name}: must have a text of one line that does not end with a point")
            self.texts[name] = text
            if not of:
                self.at[name] = at
                at += 1
                continue
            if isinstance(of[0], Columns):
                self.at[name] = of[0].moved(at)
            else:
                self.at[name] = Several(at, *of)
            at += self.at[name].width
        self.width: int = at - first
        vars(self).update(self.at)  # read thousands of times a second

    def moved(self, first: int) -> "Columns":
        """This table with its first column at another number."""
        return Columns(first=first, **self._names)

    def __getitem__(self, m: Any) -> Any:
        return self.first + m

    def __getattr__(self, name: str) -> Any:
        return self.column(name)

    def column(self, name: str) -> Any:
        """Number of the column of this name, or `Several` or a table; AttributeError without one."""
        try:
            return self.__dict__["at"][name]
        except KeyError:
            texts = "\n".join(f"  {each}: {text}" for each, text in self.__dict__["texts"].items())
            raise AttributeError(f"no column {name!r}; columns are\n{texts}") from None


class Named:
    """An array of NumPy whose last axis has named columns, which are read and written as attributes.

    Several columns under one name are an array too; those of another table are `Named`. Each table has a subclass.

    Attributes
    ----------
    array : array (..., columns)
        The array itself, not a copy.
    """

    __slots__ = ("array",)

    array: NDArray[Any]
    _columns: Columns

    def __new__(cls, array: NDArray[Any], columns: Columns) -> "Named":
        named: Named = object.__new__(_class_of(columns))
        named.array = array
        return named

    def copy(self) -> "Named":
        """This with a copy of the array."""
        return Named(self.array.copy(), self._columns)

    def __getattr__(self, name: str) -> Any:  # called for names without a property only
        return self._columns.column(name)

    if TYPE_CHECKING:

        def __setattr__(self, name: str, value: Any) -> None: ...


@functools.cache
def _class_of(columns: Columns) -> type[Named]:
    """Class of arrays with these columns, each of which is a property."""
    properties = {name: _property_of(column) for name, column in columns.at.items()}
    return type("Named", (Named,), {"__slots__": (), "_columns": columns, **properties})


def _property_of(column: Any) -> property:
    """The property of `Named` for a column, several, or a table."""
    at: Any = column if isinstance(column, int) else slice(column.first, column.first + column.width)
    table = column.moved(0) if isinstance(column, Columns) else None

    def read(rows: Named) -> Any:
        array = rows.array
        return array[at] if array.ndim == 1 else array[..., at]

    def read_several(rows: Named) -> Any:
        part = rows.array[..., at]
        return Named(part.reshape(*part.shape[:-1], column.count, column.step), column.of)

    def read_table(rows: Named) -> Any:
        return Named(rows.array[..., at], table)

    def write(rows: Named, value: Any) -> None:
        rows.array[..., at] = value

    if table is not None:
        return property(read_table, write)
    return property(read_several if isinstance(column, Several) and column.of else read, write)


# ---------------------------------------------------------------------- state of the disks

DISK = Columns(
    x="position from the left side of the tile that lists the disk", y="position from its lower side",
    vx="velocity along x", vy="velocity along y", spin="angular velocity",
)  # fmt: skip
META = Columns(
    id="number of the disk", events="collisions with disks and walls", image_x="boxes travelled along x",
    image_y="boxes travelled along y",
)  # fmt: skip
PAST = Columns(latest="time of the latest collision", angle="angle turned")
HITS = Columns(wall_collisions="collisions with walls", last_partner="partner of the latest collision")
# What collisions take.
MECHANISM = Columns(
    normal="by normal restitution", tangential_restitution="by tangential restitution",
    sliding="by friction while it slides", sticking="by friction while it sticks", rolling="by rolling friction",
    walls="in collisions with walls", rest="by disks that fall asleep",
)  # fmt: skip
# What one collision of two disks takes (`laws/contact.py`).
LOSS = Columns(
    normal="by normal restitution", tangential_restitution="by tangential restitution",
    friction="by sliding or sticking", rolling="by rolling friction",
)  # fmt: skip
KIND = Columns(
    inverse_mass="1 / m, 0 for immovable disks", k="shape number", radius="radius", material="number of the material",
    mass="mass", inertia="moment of inertia",
)  # fmt: skip
FORCES = 4
# Forces at contacts of a disk that may rest, as last solved for.
HELD_CONTACT = Columns(
    other="id of the other disk, FIRST_WALL - wall for a wall, or NO_PARTNER", force=("four forces", FORCES)
)
HELD = Columns(contact=("contacts of the disk", 4, HELD_CONTACT))
HISTORY_HASH = Columns(hash_1="first word", hash_2="second word")

# ---------------------------------------------------------------------- tiles

TILE = Columns(
    start=("first slot within its part, at the window's beginning and end", 2),
    count=("disks, at the window's beginning and end", 2),
    ghosts="first ghost record", n_ghosts="number of ghost records", bad="1 if it has to be run again",
    gathered="disks gathered",
    owned="1 for a tile of this rank, if there are several (`ifrdem/simulation/windows/ranks.py`)",
    mark="why a block of a GPU could not run it (`windows/blocks.py`), or 0",
    first_row="first row of its trail, or -1", last_row="last row of it, or -1",
)  # fmt: skip
REACH = Columns(
    halo="width of its halo", excursion="bound on how far its own disks left its sides",
    max_displacement="their largest displacement", overhang="how far they are beyond its sides at the end",
    halo_factor="halo over the initial one of all tiles",
)  # fmt: skip
# Sums over a window; whole numbers are exact up to 2^53. They are followed by those that only some gases have: the
# transfer of momentum and energy, histograms of collisions, heat of thermal walls, sums of each wall, states of pistons.
TALLY = Columns(
    collisions="collisions of two disks", wall_collisions="collisions with walls",
    elastics="collisions that a remedy for collapse made elastic", regimes=("collisions by regime", 5),
    losses=("energy dissipated by mechanism", MECHANISM), wall_work="work of moving walls",
    flow_work="work of the mean flow", fastest="largest square of a speed", squares="sum of squares of speeds",
    sleepers="disks that fell asleep", event_squares="sum of squares of speeds at events",
)  # fmt: skip
# Bins of histograms over many powers of 2: from 2^FIRST_OCTAVE on, PER_OCTAVE of equal width in each power.
FIRST_OCTAVE, OCTAVES, PER_OCTAVE = -28, 40, 8
# Collisional part of the pressure tensor times area and time (`disks/stress.py`): momentum, then direction.
VIRIAL = Columns(xx="xx", xy="xy", yx="yx", yy="yy")
# What collisions transfer: that, and behind it the same of energy, if it is recorded.
TRANSFER = Columns(
    momentum=("the virial", VIRIAL), energy_x="energy along x, in the lab", energy_y="energy along y",
)  # fmt: skip


def transfer_columns(stress: bool, heat_flux: bool) -> int:
    """Columns of the tally for what collisions transfer; a heat flux has those of the stress before it."""
    return TRANSFER.width if heat_flux else VIRIAL.width * stress


# Counts of collisions of two disks of a pair of species, for which it is repeated (`disks/histograms.py`): the pair of
# species i >= j is number i (i + 1) / 2 + j. The last ones are there if they are recorded.
HISTOGRAM = Columns(
    impact_angle=("by the angle of impact psi: bin k has g_t / (g_n + g_t) from k / 64 on, g of the centres", 64),
    normal_speed=("by the normal speed g_n, in bins of `octave_bin`", OCTAVES * PER_OCTAVE),
    regime=("by regime", 5),
    free_time=("of both disks, by the time since their latest collision, in bins of `octave_bin`", OCTAVES * PER_OCTAVE),
)  # fmt: skip


def histogram_columns(species: int, free_times: bool) -> int:
    """Columns of the tally for a pair of species; 0 without histograms, of so many species."""
    if species == 0:
        return 0
    return HISTOGRAM.width if free_times else HISTOGRAM.free_time.first


WALL_SUM = Columns(
    momentum_x="momentum along x given to disks", momentum_y="momentum along y given to disks",
    torque="angular momentum given to disks", work="work on disks", heat="heat given to disks", hits="collisions",
)  # fmt: skip
PISTON_STATE = Columns(displacement="displacement along its line", speed="velocity along its line")
# Parts of which each is a sum that does not depend on the order of its terms (`forces/forces.py`).
LEVELS = 3
# Of all tiles, or of BLOCK_OF_TILES; then sums of the tally to the end of the window, and to each moment.
TOTAL = Columns(
    max_speed_sq="largest square of a speed", excursion="largest `reach.excursion`",
    max_displacement="largest displacement", overhang="largest `reach.overhang`",
)  # fmt: skip
GHOST = Columns(
    place="slot of a copy at the window's beginning, and from bit GHOST_STEP on the step of `tiles.gather_tile` to it",
    hash_1="first word of the hash of its history here", hash_2="second word of it",
    max_speed_sq="upper half of the largest square of its speed",
)  # fmt: skip
GHOST_STEP = 27

# ---------------------------------------------------------------------- scratch space of a lane

# Flight of a disk.
MOTION = Columns(
    x="position along x at tau", y="position along y at tau", vx="velocity along x", vy="velocity along y",
    tau="time of the window at which the flight began", t_hit="time of its next collision",
    t_leave="time at which it leaves its cell", spin="angular velocity",
)  # fmt: skip
# A line of the cache.
EVENT_INFO = Columns(
    partner="next partner: another slot, a wall, or none", cell="cell", number="collisions so far",
    partner_number="those of the partner when the next one was predicted",
    previous="previous disk in the list of its bin", next="next disk in the list of its bin",
    next_in_cell="word of the next disk in the list of its cell (`layout.MORE`), or -1; in thin gases the place of its line",
    last="latest partner in this window", id="number of the disk",
    own_rank="its rank among own disks, from 1 on, or minus that among copies",
    hash_1="first word of the hash of its history", hash_2="second word of it",
    max_speed_sq="upper half of the largest square of its speed", kind="number of its kind",
    shear_row="row of tiles relative to the own one", direction="side by which it leaves its cell",
)  # fmt: skip
IMAGE_INFO = Columns(
    slot="slot at the window's beginning", lap_x="boxes travelled along x in this window",
    lap_y="boxes travelled along y in this window", events_before="collisions before this window",
    wall_collisions="collisions with walls in it", step="tile that lists it, as the step of `tiles.gather_tile`",
)  # fmt: skip
# The next action of a force on the disk alone (`disks/force_times.py`).
ACTION = Columns(
    time="time of the run", slice="number of the slice of time", draw="number in the slice",
    force="number of the force among those within windows", count="actions so far in the window",
)  # fmt: skip
CANDIDATE = Columns(
    slot="slot", cell="cell", own_rank="as in `event_info`", step="step of `tiles.gather_tile`"
)
BUNCH = Columns(
    count="lines in it", next="next bunch of the cell, or -1", radius="bits (f32) of the largest radius of its lines"
)  # fmt: skip
# The scratch space of a block of a GPU (`windows/blocks.py`), by types of numbers.
BLOCK_INTEGERS = Columns(
    event_info=("of disks", EVENT_INFO),
    image_info=("of disks", IMAGE_INFO),
    candidates=("of disks", CANDIDATE),
)
BLOCK_REALS = Columns(motion=("of disks", MOTION), since="time since the latest collision")
BLOCK_SUMS = Columns(
    loss=("energy dissipated by mechanism", MECHANISM), turn="angle turned", action=("next action", ACTION)
)
REST = Columns(
    asleep="AWAKE, ASLEEP or WOKEN since the window's beginning", may_rest="1 where the disk may fall asleep in it",
    hits="quick hits of something at rest, one after the other",
)  # fmt: skip
# Contact that may bear. A unit of one of its four forces (normal, along the contact, torques on both disks) is scaled
# so that each changes sqrt(m) a by 1 in all.
CONTACT = Columns(
    i="slot of the first disk", j="slot of the second one, -1 for a wall", normal_x="normal along x",
    normal_y="normal along y", push=("what a unit of the normal force does to either disk", 2),
    drag=("what a unit of the force along the contact does to either", 2),
    spin_up=("what a unit of the torque on either does to it", 2),
    bound=("bounds of the last three forces over the first", 3), force=("the forces", FORCES),
    trial=("trial forces, or the last change (`add_contact`)", FORCES),
)  # fmt: skip
RESIDUAL_ACCELERATION = Columns(x="sqrt(m) a along x", y="sqrt(m) a along y", turn="sqrt(I) alpha")

# ---------------------------------------------------------------------- events that are written down

EVENT = Columns(
    time="time of the window", position=("of the disk's centre", 2), normal=("towards the partner", 2),
    velocity_before=("of the disk", 2), velocity_after=("of the disk", 2), spin_before="of the disk",
    spin_after="of the disk", partner_velocity_before=("of the partner", 2),
    partner_velocity_after=("of the partner", 2), partner_spin_before="of the partner",
    partner_spin_after="of the partner",
)  # fmt: skip
EVENT_INT = Columns(
    tile="tile", id="number of the disk", partner="number of the partner, or -2 - wall", image=("boxes travelled", 2),
    regime="kind of the event: BY_LAW and others", number="the disk's number of collisions", unused="unused",
)  # fmt: skip
# A collision of two disks.
PAIR = Columns(tile="tile", id="smaller number of a disk", partner="larger number of a disk")
# An event that changed a motion in a tile, also of copies. Slots are counted from the first one of the lane.
TRAIL = Columns(
    one="word of a disk, with OWN for a collision of two disks that the tile counts",
    other="slot of its partner, or as `event_info.partner`", next="the tile's next row, or -1",
)  # fmt: skip

# ---------------------------------------------------------------------- of the whole gas

COUNTER = Columns(
    next_tile="the next tile to be run", n_ghosts="ghost records used", full="why a launch ended early",
    n_slots="slots used", needed="what was needed of what was full", resting="1: a disk came to rest on a wall",
    stalled="events without progress", n_bad="bad tiles", n_events="events", n_windows="windows",
    n_watched="rows of events of tracked disks", again="1 where only the listed tiles are run",
    pausing="of a gas in one tile: 1 where it pauses at the moment of a snapshot",
    resuming="of a gas in one tile: 1 where it resumes there",
    paused="1 where it has paused at a time, BY_COUNT at a number of collisions, BY_WORK after a long launch",
    stuck="bad tiles with the widest halo, and those with too many events",
    halted="1 where no window of a launch may follow",
    unverified="windows in which resting disks were not determined", jammed="disks that fell asleep at speed",
    n_pairs="rows of pairs", n_dense="tiles that need blocks with more room (`windows/blocks.py`)",
    n_marked="bad tiles that no block can run", written="moments that a gas which paused BY_WORK has written",
    n_trail="rows of trails",
)  # fmt: skip
CLOCK = Columns(
    begin="begin of the window", end="end of the window", stop="time at which to stop",
    wanted="collisions in all at which to stop", pause="time at which to pause",
    pause_after="collisions in all after which to pause", kick="time at which a force acts",
    path="a path sets the length of windows", tile_side="the side of a tile sets it",
    wall_speed="the speed of walls sets it", square_unit="unit of squares of speeds",
    free_path="path in a gas that fills the box", in_window="collisions in a window of that path",
    speed="root mean square of speeds at the beginning", longest="the longest window that may be",
    rotated="when gravity last rotated", n="number of disks",
    fastest="the largest speed at the window's beginning",
    overhang="how far disks are then beyond the sides of the tiles that list them",
    local_collisions="collisions that a disk may have in a window where most happen (`planner.path_from`)",
    acted="rows of `kicks` that acted before the window", next_kick="the next row of a gas in one tile that has paused",
    recent="length of the latest windows", shortest_step="the shortest step of a force within windows",
    gain_unit="what rounds energies that such forces give to a first part, over the unit of squares of speeds",
    gain_step="the same for the next part, over that for the first",
    action_square="square of a speed that a disk at rest may get at a random time",
    reached="time of the window that a gas in one tile has reached where it paused BY_WORK",
)  # fmt: skip
GRID = Columns(
    n="disks", tiles_x="tiles along x", tiles_y="tiles along y", lanes="lanes", lane_slots="slots of a lane",
    cells="cells of a lane", bins="bins of a lane", items="walls of a lane", part="part of the window's beginning",
    periodic_x="1 where the sides along x are periodic", periodic_y="1 where those along y are", walls="rows of walls",
    seed_low="low word of the seed", seed_high="high word of the seed",
    single_tile="1 where one tile is the whole box", most_ghosts="room for ghost records",
    tiles_aside="whole tiles by which a row has moved on against the one below, in a sheared gas",
    boxes_aside="whole boxes by which it has", room="slots of a part",
    watching="what is written down: TRACKED, PAIRS and TRAIL", most_events="room for rows of events",
    coarse="small cells along a large one", opaque_zero="a 0 that no compiler knows",
    stride="threads of a GPU for each tile's events, of which one works", moments="room for moments",
    most_pairs="room for rows of pairs",
    first_piston="the first piston among the rows of walls, or -1", blocks="blocks of a GPU that run tiles",
    most_trail="room for rows of trails", bunches="bunches of lines of a lane",
)  # fmt: skip
MOST_MOMENTS = 8
SCALE = Columns(
    length_x="length of the box along x", length_y="length along y", cell_side="least side of a cell",
    window="length of the window", widest="largest diameter", rounding_constant="what rounds positions",
    gx="gravity along x", gy="gravity along y", velocity_cutoff="cut-off of velocity, or 0",
    resting_speed="of `Rest`, or 0",
    contact_time="contact time", shear="shear rate", drift="speed of a row of tiles relative to the one below",
    aside="its shift beyond whole tiles", split="the largest radius of disks in small cells",
    usual_halo="halo that tiles begin with", most_halo="the widest halo",
    chain="the part of it for disks that hit one another in chains", least_side="the least side of a tile",
    stored_at="time, since the beginning of the window, of the state that is stored as its end",
    per_widest="1 over the largest diameter",
    moment=("moments in the window, in order, FAR behind the last", MOST_MOMENTS + 1),
)  # fmt: skip

# ---------------------------------------------------------------------- walls

WALL_MOTION = Columns(
    kind="displacement along (x, y): `kinds.MOTIONS`", x="unit vector along x", y="unit vector along y",
    amplitude="amplitude, of a steady motion its speed",
    rate="angular frequency of a sine, frequency of a sawtooth",
    phase="phase at t = 0 of the run, or at `moving.begin`, in radians (sine) or periods (sawtooth)",
    rise="part of its period in which a sawtooth rises, from minus its amplitude to it",
    now="at the beginning of the window: displacement of a steady motion, else the phase",
)  # fmt: skip
WALL_TURN = Columns(
    kind="rotation about (x, y), which the displacement carries along: `kinds.TURNS`", x="centre along x",
    y="centre along y", amplitude="amplitude, of a steady turn its angular velocity",
    rate="angular frequency of a sine", phase="phase", now="angle or phase as the window begins",
    lever="distance of the farthest point of the piece from (x, y)",
)  # fmt: skip
WALL_MOVING = Columns(
    begin="time of the run from which on it moves", end="time until when it moves",
    now="1 if it moves in the window, which neither lies in, else 0",
)  # fmt: skip
PISTON = Columns(
    displacement="displacement at its latest event", speed="speed then", since="time of the window of that event",
    stop_at="time of the window at which it meets a stop", push="acceleration by its force",
    rate="angular frequency on its spring", inverse_mass="1 / m", low="least displacement", high="largest displacement",
    sums="first of the changes of its displacement and velocity, among the sums of walls",
    next="row of the next piston, or -1",
)  # fmt: skip
# A piece of a wall.
WALL = Columns(
    kind="`kinds.PIECES`, or GONE", x="point of a line, beginning of a segment, or centre of a circle, along x",
    y="the same along y",
    towards_x="along x: normal of a line towards the disks, end minus beginning of a segment, or the unit vector to "
    "the middle of an arc",
    towards_y="the same along y", radius="radius of a circle", half="half the angle of an arc",
    owner="number of the wall that this is a piece of", material="row of the law's table",
    surface_speed="speed of the surface along its tangent, (-n_y, n_x) of the normal towards the disk",
    temperature="temperature of a thermal wall [energy], else 0",
    heat="which of the sums of walls is the heat of a thermal wall, else -1",
    sums="the first of the sums of its wall (WALL_SUM)", motion=("displacement", WALL_MOTION),
    turn=("rotation", WALL_TURN), moving=("when it moves", WALL_MOVING), piston=("of a piston", PISTON),
)  # fmt: skip

# ---------------------------------------------------------------------- what is read out

# Sums over all disks.
READOUT = Columns(
    translational="energy of translation", rotational="energy of rotation", momentum_x="momentum along x",
    momentum_y="momentum along y", momentum_flux_xy="m v_x v_y", fall="minus the potential energy in gravity",
    all_events="collisions of each disk", excess="energy beyond that of the peculiar motion, in a mean flow",
    mass="mass", momentum_flux_xx="m v_x v_x", energy_flux_x="(m v^2 + I w^2) v_x / 2", energy_flux_y="the same of v_y",
    mass_x="m x, x inside the box", mass_y="m y",
)  # fmt: skip
# Sums over the disks whose centres are in a rectangle, but those of infinite mass.
RECTANGLE = Columns(x_low="left side", y_low="lower side", x_high="right side", y_high="upper side")
REGION = Columns(disks="number of disks", mass="mass", energy="energy of translation and rotation")
# Sums over the disks of a species; those of infinite mass only in its collisions.
SPECIES = Columns(
    translational="energy of translation", rotational="energy of rotation", momentum_x="momentum along x",
    momentum_y="momentum along y", mass="mass", movable="number of movable disks", collisions="collisions",
)  # fmt: skip


def rows_dtype(quantities: Iterable[Quantity], real: str) -> np.dtype[Any]:
    """Type of a row of a structured array of these quantities, real ones in this precision."""
    return np.dtype([(each.name, each.dtype(real), each.tail) for each in quantities])


@functools.cache
def frame_dtype(uses: Any, single: bool) -> np.dtype[Any]:
    """Type of a disk in what `read_out` gives: all that a gas with these `uses` keeps; if `single`, what files hold."""
    kept = [each for each in FRAME.values() if not each.feature or getattr(uses, each.feature)]
    return rows_dtype((each for each in kept if each.stored or not single), "f4" if single else "f8")


def first_word(name: str, uses: Any, single: bool) -> int:
    """Number of the first word of 32 bits of a quantity in it."""
    return int((frame_dtype(uses, single).fields or {})[name][1]) // 4


BISECTIONS = 7
POINTS = 2**BISECTIONS
"""Points of each of the two tables of a tabulated law (`laws/table.py`); unused ones lie beyond every slip and speed."""
LAW = Columns(
    e_n="normal restitution", e_t="tangential restitution", mu="friction",
    contact_point="1 where e_t is of the contact point, 0 of the percussion centre", rho="rolling friction [length]",
)  # fmt: skip
TRIAL_TABLES: dict[str, Columns] = {
    "law": LAW,
    # Of disk i, which approaches disk j or a wall (inverse mass 0) along x.
    "pairs": Columns(
        material_i="material of i", material_j="material of j", inverse_mass_i="1 / m of i", radius_i="radius of i",
        k_i="shape number of i", inverse_mass_j="1 / m of j", radius_j="radius of j", k_j="shape number of j",
        vx_i="velocity of i along x", vy_i="velocity of i along y", spin_i="spin of i", spin_j="spin of j",
        reduced_radius="radius of Hertz's contact",
    ),
    "found": Columns(
        P_n="impulse along n", least_P_n="that below which the disks would overlap",
        vx_i="velocity of i after, along x",
        vy_i="along y", spin_i="spin of i after", vx_j="velocity of j after, along x", vy_j="along y",
        spin_j="spin of j after",
    ),
}  # fmt: skip
"""Tables of the arrays of collisions by which a law is tried (`contact.sample_law`)."""

# ---------------------------------------------------------------------- steps of forces

WHEN = Columns(
    time="time of the step", dt="length of the step",
    free_x="1 where the whole gas can drift along x (`model.walls.wall.free_directions`), else 0", free_y="along y",
)  # fmt: skip
# A step of a force within a window.
KICK = Columns(
    time="when it acts", force="number of the force among those that act so", index="its number among all",
    number="number of the step", dt="length of the step",
    shares="where shares of the disks in its totals begin in `shares`, or -1", totals=("totals, at least one", 1),
)  # fmt: skip
# Behind them the parameters of the forces. Of one that acts on single disks, two numbers come before them: the mean
# time between two actions on a disk, its number among all forces.
FORCE_VALUES = Columns(free_x="1 where the whole gas can drift along x, else 0", free_y="along y")
COUNTER_WORDS = Columns(
    step_low="number of the step, low word", step_high="high word", index="index of the force",
    seed_low="seed, low word", seed_high="high word",
)  # fmt: skip

# ---------------------------------------------------------------------- direct simulation Monte Carlo (`dsmc.py`)

BODY = Columns(
    vx="velocity along x", vy="velocity along y", spin="angular velocity", inverse_mass="1 / m", radius="radius",
    k="shape number", material="number of the material",
)  # fmt: skip
DSMC_TABLES: dict[str, Columns] = {
    "disk": BODY,
    "counter": Columns(
        open=("candidates to resolve, in two lists that alternate", 2), collisions="collisions",
        cut="the first candidate that made a disk too fast",
    ),
    # Of random numbers.
    "key": Columns(
        number_low="number of the batch or of the kick, low word", number_high="high word", seed_low="seed, low word",
        seed_high="high word",
    ),
    "contact_value": Columns(
        one="first coefficient of contact values (`contact.contact_value_coefficients`)", two="second one",
        majorant="the largest g_ij sigma_ij |v_i - v_j| that may occur",
        cap="square of the highest speed for which that holds", shear_rate="du_x/dy of a mean flow",
    ),
    "factors": Columns(
        velocity="factor of a velocity by friction", spin="factor of a spin",
        energy="energy that noise gives to the motion", spin_energy="energy that it gives to the spin",
        strain="by which a mean flow turns velocities",
    ),
    "scale": SCALE,
    "law": LAW,
}  # fmt: skip
"""Tables of the arrays of a gas without places."""

TABLES: dict[str, Columns] = {
    "disk": DISK, "meta": META, "past": PAST, "hits": HITS, "dissipated": MECHANISM, "held": HELD, "kinds": KIND,
    "history_hash": HISTORY_HASH,
    "tile": TILE, "reach": REACH, "tally": TALLY, "found": TOTAL, "ghost": GHOST,
    "motion": MOTION, "action": ACTION, "event_info": EVENT_INFO, "image_info": IMAGE_INFO,
    "candidates": CANDIDATE, "bunch": BUNCH, "loss": MECHANISM, "rest": REST, "contact": CONTACT,
    "cached_force": HELD,
    "residual_acceleration": RESIDUAL_ACCELERATION, "event": EVENT, "event_int": EVENT_INT, "pair": PAIR,
    "trail": TRAIL,
    "counter": COUNTER, "clock": CLOCK, "grid": GRID, "scale": SCALE, "sums": TALLY, "total": TOTAL,
    "walls": WALL, "law": LAW,
    "totals": READOUT, "species_totals": SPECIES, "regions": RECTANGLE, "region_totals": REGION,
    "when": WHEN, "counter_words": COUNTER_WORDS, "kicks": KICK, "force_values": FORCE_VALUES,
}  # fmt: skip
"""Tables of the columns of arrays, by the names that kernels give them; others have numbers."""
TYPES: dict[str, str] = {
    "disk": REAL, "meta": I32, "past": F64, "hits": I32, "dissipated": F64, "held": F64, "asleep": I32, "kind": I32,
    "kinds": REAL, "history_hash": I32, "displacement": F32, "slot_before": I32,
    "first_of_species": I32, "tile": I32, "listed": I32, "blocks": I32, "reach": REAL, "edge_x": F64, "edge_y": F64, "ghost": I32,
    "motion": REAL, "action": F64, "event_info": I32, "image_info": I32,
    "candidates": I32, "since": REAL, "turn": F64, "loss": F64, "rest": I32, "contact": F64, "cached_force": F64,
    "residual_acceleration": F64, "head": I32, "bin": I32, "line": F32, "line_slot": I32, "bunch": I32, "spare": I32, "wall_start": I32, "wall_item": I32, "walls": REAL,
    "near": U64, "near_image": U64, "image_list": I32, "dense": I32, "block_integers": I32, "block_reals": REAL,
    "block_sums": F64,
    "watched": I32, "event": REAL, "event_int": I32, "pair_time": REAL, "pair": I32, "trail_time": REAL,
    "trail": I32, "kicks": F64, "force_values": F64,
    "shares": REAL,
}  # fmt: skip
"""Types of the numbers of arrays on the device."""
AXES = {
    "tile": 2, "reach": 2, "found": 2, "tally": 3, "law": 3, "frame_out": 2, "totals": 2,
    "species_totals": 3, "region_totals": 3, "todo": 2, "pairs": 2, "kicks": 2,
}  # fmt: skip
"""Axes of arrays that have more than one, by the names that kernels give them; a vector of columns is none."""
SINGLE = (
    "grid",
    "scale",
    "clock",
    "sums",
    "counter",
    "total",
    "when",
    "counter_words",
    "force_values",
    "key",
    "contact_value",
    "factors",
)
"""Arrays of one row."""
SMALL = ("grid", "scale", "clock", "sums", "counter", "total")
"""Arrays that the host reads after every launch; a GPU gets them on one board (`readout.exchange`)."""


def named(array: NDArray[Any], name: str) -> Named:
    """The array of this name, with its columns as attributes."""
    return Named(array, TABLES[name])


def blank(name: str, kind: Any = np.float64) -> Named:
    """A row of zeros for an array of one row."""
    return Named(np.zeros(TABLES[name].width, dtype=kind), TABLES[name])


def bytes_of(*names: str) -> int:
    """Bytes of a row of these arrays, in double precision."""
    return sum(BYTES[TYPES[name]] * (TABLES[name].width if name in TABLES else 1) for name in names)


# ---------------------------------------------------------------------- sizes and bounds, for estimates too

MOST_WALLS = 100_000
ADDRESSABLE = 2**31 - 1  # numbers of one array that 32-bit indices reach
# Disks of a gas on several ranks. Its ids have 32 bits: those of more than 2^31 - 1 disks begin below 0 there.
MOST_IDS = 2**32 - 1
_PARTS = 3  # of the state: at the beginning and end of a window, and at a moment in it, but with `low_memory`
GHOST_BYTES = 8  # of ghost records of disks in halos, for each disk
SNAPSHOT_DISKS = 500_000  # bound on disks times moments of a window (28 MB), but for a single moment
CONTACTS_PER_DISK = 8  # for which there is room, on average
RESTING_BYTES = (  # more, of disks that may rest: room for contacts of each, and the forces at four
    _PARTS * bytes_of("asleep", "held")
    + CONTACTS_PER_DISK * bytes_of("contact")
    + bytes_of("rest", "residual_acceleration", "cached_force")
)

SINGLE_TILE = 20_000  # up to so many disks, one thread runs the whole box as one tile


def bytes_per_disk(low_memory: bool = False) -> int:
    """Bytes that an engine of many disks holds for each, in double precision; with `low_memory` no state at a moment.

    The manual, estimates and benchmarks take this number. There is more that does not grow with the number of disks:
    scratch space of the threads, and room for states at more moments (SNAPSHOT_DISKS); and what a window writes down
    where a run ends at a number of collisions (`ifrdem/case/estimate.py`).
    """
    constant = bytes_of("history_hash", "displacement", "slot_before") + GHOST_BYTES
    return (_PARTS - low_memory) * bytes_of("disk", "meta") + constant


def most_disks(low_memory: bool = False) -> int:
    """Largest number of disks of a process: in each part of the longest array a disk has at most eight numbers."""
    return ADDRESSABLE // (8 * (_PARTS - low_memory))
