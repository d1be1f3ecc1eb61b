"""Columns of the engine's arrays by name: one table for kernels, the host, checkpoints and estimates of memory.

A table gives each name the number of its column. Some names stand for several: *several* columns that are counted, or
those of another table. `layout.py` describes the arrays, this module their columns. It does not import Taichi:
kernels reach columns by name through `compiler/records.py`, the host through `named`.
"""

import functools
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    """Names of the columns of an array, in order.

    A name is followed by nothing, by a number of columns (`count=2`), by a table (`losses=MECHANISM`), or by both
    (`contact=(4, HELD_CONTACT)`).

    Attributes
    ----------
    at : dict
        Number of each column by its name; `Several` or a table for a name that stands for several.
    width : int
        Number of columns.
    first : int
        Number of the first one in the table that this one stands in.
    """

    of: "Columns | None" = None  # as of `Several`

    def __init__(self, *, first: int = 0, **names: "int | Columns | tuple[int, Columns] | None") -> None:
        self.first, self._names = first, names
        self.at: dict[str, Any] = {}
        at = first
        for name, given in names.items():
            if given is None:
                self.at[name] = at
                at += 1
                continue
            count, of = given if isinstance(given, tuple) else (given, None)
            if isinstance(count, Columns):
                self.at[name] = count.moved(at)
            else:
                self.at[name] = Several(at, count, of)
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
            raise AttributeError(
                f"no column {name!r}; columns are {', '.join(self.__dict__['at'])}"
            ) from None


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


def columns(*names: str) -> dict[str, None]:
    """Names of one column each, to be given to `Columns`."""
    return dict.fromkeys(names)


# ---------------------------------------------------------------------- state of the disks

# Positions from the lower left corner of the tile that lists the disk.
DISK = Columns(**columns("x", "y", "vx", "vy", "spin"))
# `events`: collisions with disks and walls; boxes travelled.
META = Columns(**columns("id", "events", "image_x", "image_y"))
# Time of the latest collision, and angle turned.
PAST = Columns(**columns("latest", "angle"))
HITS = Columns(**columns("wall_collisions", "last_partner"))
# What collisions take, by mechanism.
MECHANISM = Columns(**columns("normal", "restitution", "sliding", "sticking", "rolling", "walls", "rest"))
# What one collision of two disks takes (`laws/contact.py`); friction is sliding or sticking.
LOSS = Columns(**columns("normal", "restitution", "friction", "rolling"))
KIND = Columns(**columns("inverse_mass", "k", "radius", "material", "mass", "inertia"))
# Forces at contacts of a disk that may rest, as last solved for: of each the other's id (FIRST_WALL - wall for a wall,
# or NO_PARTNER) and four forces.
FORCES = 4
HELD_CONTACT = Columns(other=None, force=FORCES)
HELD = Columns(contact=(4, HELD_CONTACT))
HISTORY_HASH = Columns(**columns("hash_1", "hash_2"))

# ---------------------------------------------------------------------- tiles

# First slot (within its part) and number of disks at the window's beginning and end, by part; ghost records; 1 if it
# has to be run again; disks gathered; 1 for a tile of this rank, if there are several ranks of MPI
# (`ifrdem/simulation/windows/ranks.py`); why a block of a GPU could not run it (`windows/blocks.py`), or 0.
TILE = Columns(start=2, count=2, **columns("ghosts", "n_ghosts", "bad", "gathered", "owned", "mark"))
# Halo; bound on how far its own disks left its sides; their largest displacement; how far they are beyond its
# sides at the end; halo over the initial one of all tiles.
REACH = Columns(**columns("halo", "excursion", "max_displacement", "overhang", "halo_factor"))
# Sums over a window; whole numbers are exact up to 2^53. `fastest` is the largest square of a speed. They are
# followed by those that only some gases have: the virial, heat of thermal walls, sums of each wall, states of pistons.
TALLY = Columns(
    collisions=None, wall_collisions=None, elastics=None, regimes=5, losses=MECHANISM,
    **columns("wall_work", "flow_work", "fastest", "squares", "sleepers", "event_squares"),
)  # fmt: skip
# Collisional part of the pressure tensor times area and time (`disks/stress.py`): momentum, then direction.
VIRIAL = Columns(**columns("xx", "xy", "yx", "yy"))
WALL_SUM = Columns(**columns("momentum_x", "momentum_y", "torque", "work", "heat", "hits"))
PISTON_STATE = Columns(**columns("displacement", "speed"))
# Parts of which each is a sum that does not depend on the order of its terms (`forces/forces.py`).
LEVELS = 3
# Of all tiles, or of BLOCK_OF_TILES: the largest square of a speed, and maxima of `reach`; then sums of the tally to
# the end of the window, and to each moment.
TOTAL = Columns(**columns("max_speed_sq", "excursion", "max_displacement", "overhang"))
# Slot of a copy at the window's beginning and, in the bits from GHOST_STEP on, the step of `tiles.gather_tile` to it;
# hash of its history here; upper half of the largest square of its speed.
GHOST = Columns(**columns("place", "hash_1", "hash_2", "max_speed_sq"))
GHOST_STEP = 27

# ---------------------------------------------------------------------- scratch space of a lane

# Flight from `tau` on; times of its next collision and of leaving its cell.
MOTION = Columns(**columns("x", "y", "vx", "vy", "tau", "t_hit", "t_leave", "spin"))
# Next partner (another slot, a wall, or none); cell; collisions so far; those of the partner when that was
# predicted; neighbours in the list of its bin; next in the list of its cell; latest partner in this window; id; its
# rank among own disks, from 1 on, or minus that among copies; hash of its history; upper half of the largest square of
# its speed; kind; row of tiles relative to the own one; side by which it leaves its cell. A line of the cache.
EVENT_INFO = Columns(**columns(
    "partner", "cell", "number", "partner_number", "previous", "next", "next_in_cell", "last", "id", "own_rank",
    "hash_1", "hash_2", "max_speed_sq", "kind", "shear_row", "direction",
))  # fmt: skip
# Slot at the window's beginning; boxes travelled in this window; collisions before it, and with walls in it; tile that
# lists it, as the step of `tiles.gather_tile` to that.
IMAGE_INFO = Columns(**columns("slot", "lap_x", "lap_y", "events_before", "wall_collisions", "step"))
# The next action of a force on the disk alone (`disks/force_times.py`): time of the run, number of the slice of time,
# number in it, number of the force among those within windows; actions so far in the window.
ACTION = Columns(**columns("time", "slice", "draw", "force", "count"))
CANDIDATE = Columns(**columns("slot", "cell", "own_rank", "step"))
# The scratch space of a block of a GPU (`windows/blocks.py`), by types of numbers.
BLOCK_INTEGERS = Columns(event_info=EVENT_INFO, image_info=IMAGE_INFO, candidates=CANDIDATE)
BLOCK_REALS = Columns(motion=MOTION, since=None)
BLOCK_SUMS = Columns(loss=MECHANISM, turn=None, action=ACTION)
# AWAKE, ASLEEP or WOKEN since the window's beginning; 1 where the disk may fall asleep in it; quick hits of something
# at rest, one after the other.
REST = Columns(**columns("asleep", "may_rest", "hits"))
# Contact that may bear: slots of both disks, the second -1 for a wall; the normal; what a unit of its four forces
# (normal, along the contact, torques on both disks) does to either, scaled so that each changes sqrt(m) a by 1 in all;
# bounds of the last three over the first; the forces, and trial forces, or the last change (`add_contact`).
CONTACT = Columns(
    **columns("i", "j", "normal_x", "normal_y"), push=2, drag=2, spin_up=2, bound=3, force=FORCES, trial=FORCES
)  # fmt: skip
# sqrt(m) a and sqrt(I) alpha.
RESIDUAL_ACCELERATION = Columns(**columns("x", "y", "turn"))

# ---------------------------------------------------------------------- events that are written down

# Time, position, normal, velocity and spin before and after; the same of the partner.
EVENT = Columns(
    time=None, position=2, normal=2, velocity_before=2, velocity_after=2, **columns("spin_before", "spin_after"),
    partner_velocity_before=2, partner_velocity_after=2, partner_spin_before=None, partner_spin_after=None,
)  # fmt: skip
# Tile; the disk's id; the partner's, or -2 - wall; boxes travelled; kind (BY_LAW ...); the disk's number of collisions.
EVENT_INT = Columns(
    **columns("tile", "id", "partner"), image=2, **columns("regime", "number", "unused"),
)  # fmt: skip
# A collision of two disks: tile; ids of both, the smaller first.
PAIR = Columns(**columns("tile", "id", "partner"))

# ---------------------------------------------------------------------- of the whole gas

# Next tile to be run; ghost records used; why a launch ended early; slots used; what was needed; 1: a disk came to rest
# on a wall, events without progress; bad tiles; events; windows; rows of events; 1 where only the listed tiles are run;
# of a gas in one tile: 1 where it pauses at the moment of a snapshot; 1 where it resumes there; 1 where it has
# paused at a time, BY_COUNT at a number of collisions, BY_WORK after a long launch; bad tiles with the widest halo, and
# those with too many events; 1 where no window of a launch may follow; windows in which resting disks were not
# determined, and disks that fell asleep at speed; rows of pairs; tiles that need blocks with more room, and bad ones
# that no block can run (`windows/blocks.py`); moments that a gas which paused BY_WORK has written.
COUNTER = Columns(**columns(
    "next_tile", "n_ghosts", "full", "n_slots", "needed", "resting", "stalled", "n_bad", "n_events", "n_windows",
    "n_watched", "again", "pausing", "resuming", "paused", "stuck", "halted", "unverified", "jammed", "n_pairs",
    "n_dense", "n_marked", "written",
))  # fmt: skip
# Begin and end of the window; where to stop (time, collisions in all), to pause, when a force acts; what sets the
# length of windows: a path, the side of a tile, the speed of walls; unit of squares of speeds; path in a gas that fills
# the box, collisions in a window of that; root mean square of speeds at the beginning; the longest window that may be;
# when gravity last turned; number of disks; at the window's beginning the largest speed, and how far disks are beyond
# the sides of the tiles that list them; collisions that a disk may
# have in a window where most happen (`planner.path_from`). Of forces that act within windows: rows of `kicks` that
# acted before the window; the next row of a gas in one tile that has paused; length of the latest windows; the
# shortest step; what rounds energies that they give to a first part, over the unit of squares of speeds, and for the
# next part over that; square of a speed that a disk at rest may get at a random time. The time of the window that a gas
# in one tile has reached where it paused BY_WORK.
CLOCK = Columns(**columns(
    "begin", "end", "stop", "wanted", "pause", "pause_after", "kick", "path", "tile_side", "wall_speed",
    "square_unit", "free_path", "in_window", "speed", "longest", "turned", "n", "fastest", "overhang",
    "local_collisions",
    "acted", "next_kick", "recent", "shortest_step", "gain_unit", "gain_step", "action_square", "reached",
))  # fmt: skip
# Disks; tiles; lanes; slots, cells, bins and walls of a lane; part of the window's beginning; periodic sides; walls;
# seed; 1 where one tile is the whole box; ghost records; rows of cells of all; slots of a part; verification on; small
# cells along a large one; a 0 that no compiler knows; threads of a GPU for each tile's events, of which one works; room
# for moments; rows of pairs; the first piston among the rows of walls, or -1; blocks of a GPU that run tiles.
GRID = Columns(**columns(
    "n", "tiles_x", "tiles_y", "lanes", "lane_slots", "cells", "bins", "items", "part", "periodic_x", "periodic_y",
    "walls", "seed_low", "seed_high", "single_tile", "most_ghosts", "tiles_aside", "boxes_aside", "room", "watching",
    "most_events", "coarse", "opaque_zero", "stride", "moments", "most_pairs", "first_piston", "blocks",
))  # fmt: skip
MOST_MOMENTS = 8
# Box; least side of a cell; window; largest diameter; what rounds positions; gravity; cut-off; contact time; shear
# rate; speed of a row of tiles relative to the one below, and its shift beyond whole tiles; the largest radius of disks
# in small cells; the halo that tiles begin with, and the widest; the part of it for disks that hit one another in
# chains; the least side of a tile; the time, since the beginning of the window, of the state that is stored as
# its end; moments in the window, in order, FAR behind the last.
SCALE = Columns(
    **columns(
        "length_x", "length_y", "cell_side", "window", "widest", "rounding_constant", "gx", "gy", "cutoff",
        "contact_time", "shear", "drift", "aside", "split", "usual_halo", "most_halo", "chain", "least_side",
        "stored_at",
    ),
    moment=MOST_MOMENTS + 1,
)  # fmt: skip

# ---------------------------------------------------------------------- walls

# Displacement along (x, y), a unit vector: `kinds.MOTIONS`. Amplitude, of a steady motion its speed; angular frequency
# of a sine, frequency of a sawtooth; phase at t = 0 of the run, or at `moving.begin`, in radians (sine) or periods
# (sawtooth); part of its period in which a sawtooth rises, from minus its amplitude to it; what is needed of the
# beginning of the window: displacement of a steady motion, else the phase.
WALL_MOTION = Columns(**columns("kind", "x", "y", "amplitude", "rate", "phase", "rise", "now"))
# Rotation about (x, y), which the displacement carries along: `kinds.TURNS`. Amplitude, of a steady turn its angular
# velocity; angular frequency of a sine; phase; angle or phase as the window begins; distance of the farthest point of
# the piece from (x, y).
WALL_TURN = Columns(**columns("kind", "x", "y", "amplitude", "rate", "phase", "now", "lever"))
# Time of the run from which on it moves, and until when; 1 if it moves in the window, which neither lies in, else 0.
WALL_MOVING = Columns(**columns("begin", "end", "now"))
# Displacement and speed at the latest event of a piston, and the time of the window of that; time of the window at
# which it meets a stop; acceleration by its force; angular frequency on its spring; inverse mass; least and largest
# displacement; first of the changes of its displacement and velocity, among the sums of walls; row of the next piston,
# or -1.
PISTON = Columns(**columns(
    "displacement", "speed", "since", "stop_at", "push", "rate", "inverse_mass", "low", "high", "sums", "next",
))  # fmt: skip
# A piece of a wall: `kinds.PIECES` or GONE. A point of a line, the beginning of a segment, the centre of a circle; a
# line's unit normal, towards the disks, the end of a segment minus its beginning, the unit vector to the middle of an
# arc; radius of a circle; half the angle of an arc; number of the wall that this is a piece of; row of the law's table;
# speed of the surface along its tangent, (-n_y, n_x) of the normal towards the disk; temperature of a thermal wall
# [energy], else 0; which of the sums of walls is the heat of a thermal wall, else -1; the first of the sums of its
# wall (WALL_SUM).
WALL = Columns(
    **columns("kind", "x", "y", "towards_x", "towards_y", "radius", "half", "owner", "material", "surface_speed"),
    **columns("temperature", "heat", "sums"),
    motion=WALL_MOTION, turn=WALL_TURN, moving=WALL_MOVING, piston=PISTON,
)  # fmt: skip

# ---------------------------------------------------------------------- what is read out

# Sums over all disks.
READOUT = Columns(**columns(
    "translational", "rotational", "momentum_x", "momentum_y", "momentum_flux_xy", "fall", "all_events", "excess",
    "mass", "momentum_flux_xx",
))  # fmt: skip
# Sums over the disks of a species; those of infinite mass only in its collisions.
SPECIES = Columns(
    **columns("translational", "rotational", "momentum_x", "momentum_y", "mass", "movable", "collisions")
)


class FrameField(NamedTuple):
    """A quantity of each disk in a frame: its name in `State`, how many numbers, its name in files (vectors have a view
    in 3D there), the feature that it needs, and whether it is int32 or in the precision of the frame."""

    attribute: str
    components: int
    file: str = ""
    feature: str = ""
    count: bool = False

    @property
    def dataset(self) -> str:
        """Name of the dataset with the stored data inside the field's group."""
        return "value_2d" if self.components == 2 else "value"

    @property
    def tail(self) -> tuple[int, ...]:
        """Shape of one disk's values."""
        return () if self.components == 1 else (self.components,)


FRAME = {each.attribute: each for each in (
    FrameField("position", 2, "position"),
    FrameField("velocity", 2, "velocity"),
    FrameField("angle", 1, "angle", "turned"),
    FrameField("spin", 1, "angular_velocity"),
    FrameField("dissipated", MECHANISM.width, "dissipated", "itemised"),
    FrameField("latest_collision", 1, feature="remembers"),
    FrameField("collisions", 1, "collisions", count=True),
    FrameField("image", 2, "image", count=True),
    FrameField("last_partner", 1, "last_partner", "partnered", count=True),
    FrameField("asleep", 1, "asleep", "rests", count=True),
    FrameField("wall_collisions", 1, feature="walled", count=True),
)}  # fmt: skip


def rows_dtype(quantities: Iterable[FrameField], real: Any) -> np.dtype[Any]:
    """Type of a disk in a structured array of these quantities, real ones in this precision."""
    return np.dtype([(each.attribute, np.int32 if each.count else real, each.tail) for each in quantities])


@functools.cache
def frame_dtype(uses: Any, single: bool) -> np.dtype[Any]:
    """Type of a disk in what `read_out` gives: all that a gas with these `uses` keeps; if `single`, what files hold."""
    kept = [each for each in FRAME.values() if not each.feature or getattr(uses, each.feature)]
    return rows_dtype(
        (each for each in kept if each.file or not single), np.float32 if single else np.float64
    )


def first_word(name: str, uses: Any, single: bool) -> int:
    """Number of the first word of 32 bits of a quantity in it."""
    return int((frame_dtype(uses, single).fields or {})[name][1]) // 4


# Coefficients of the IFR law (`IFRLaw.table_row`).
LAW = Columns(**columns("e_n", "e_t", "mu", "contact_point", "rho"))
TRIAL_TABLES: dict[str, Columns] = {
    "law": LAW,
    # Of disk i, which approaches disk j or a wall (inverse mass 0) along x.
    "pairs": Columns(**columns(
        "material_i", "material_j", "inverse_mass_i", "radius_i", "k_i", "inverse_mass_j", "radius_j", "k_j",
        "vx_i", "vy_i", "spin_i", "spin_j",
    )),
    # Impulse along n, that below which the disks would overlap; velocities and spins after the collision.
    "found": Columns(**columns("P_n", "least_P_n", "vx_i", "vy_i", "spin_i", "vx_j", "vy_j", "spin_j")),
}  # fmt: skip
"""Tables of the arrays of collisions by which a law is tried (`contact.sample_law`)."""

# ---------------------------------------------------------------------- steps of forces

# Time and length of the step; 1 for x and y where the whole gas can drift (`model.walls.wall.free_directions`), else 0.
WHEN = Columns(**columns("time", "dt", "free_x", "free_y"))
# A step of a force within a window: when it acts; number of the force among those that act so, and among all; number
# and length of the step; where shares of the disks in its totals begin in `shares`, or -1; totals, at least one.
KICK = Columns(**columns("time", "force", "index", "number", "dt", "shares"), totals=1)
# 1 for x and y where the whole gas can drift, else 0; behind them the parameters of the forces. Of one that acts on
# single disks, two numbers come before them: the mean time between two actions on a disk, its number among all forces.
FORCE_VALUES = Columns(**columns("free_x", "free_y"))
# Number of the step (low, high word), index of the force, seed (low, high word).
COUNTER_WORDS = Columns(**columns("step_low", "step_high", "index", "seed_low", "seed_high"))

# ---------------------------------------------------------------------- direct simulation Monte Carlo (`dsmc.py`)

BODY = Columns(**columns("vx", "vy", "spin", "inverse_mass", "radius", "k", "material"))
DSMC_TABLES: dict[str, Columns] = {
    "disk": BODY,
    # Candidates to resolve, in two lists that alternate; collisions; the first candidate that made a disk too fast.
    "counter": Columns(open=2, **columns("collisions", "cut")),
    # Of random numbers: number of the batch or of the kick (low, high word), seed (low, high word).
    "key": Columns(**columns("number_low", "number_high", "seed_low", "seed_high")),
    # Coefficients of contact values (`contact.contact_value_coefficients`); the largest g_ij sigma_ij |v_i - v_j| that
    # may occur; the square of the highest speed for which that holds.
    "contact_value": Columns(**columns("one", "two", "majorant", "cap")),
    # Factors of a velocity and of a spin by friction; energy that noise gives to the motion and to the spin.
    "factors": Columns(**columns("velocity", "spin", "energy", "spin_energy")),
    "scale": SCALE,
    "law": LAW,
}
"""Tables of the arrays of a gas without places."""

TABLES: dict[str, Columns] = {
    "disk": DISK, "meta": META, "past": PAST, "hits": HITS, "dissipated": MECHANISM, "held": HELD, "kinds": KIND,
    "history_hash": HISTORY_HASH,
    "tile": TILE, "reach": REACH, "tally": TALLY, "found": TOTAL, "ghost": GHOST,
    "motion": MOTION, "action": ACTION, "event_info": EVENT_INFO, "image_info": IMAGE_INFO,
    "candidates": CANDIDATE, "loss": MECHANISM, "rest": REST, "contact": CONTACT,
    "cached_force": HELD,
    "residual_acceleration": RESIDUAL_ACCELERATION, "event": EVENT, "event_int": EVENT_INT, "pair": PAIR,
    "counter": COUNTER, "clock": CLOCK, "grid": GRID, "scale": SCALE, "sums": TALLY, "total": TOTAL,
    "walls": WALL, "law": LAW,
    "totals": READOUT, "species_totals": SPECIES,
    "when": WHEN, "counter_words": COUNTER_WORDS, "kicks": KICK, "force_values": FORCE_VALUES,
}  # fmt: skip
"""Tables of the columns of arrays, by the names that kernels give them; others have numbers."""
TYPES: dict[str, str] = {
    "disk": REAL, "meta": I32, "past": F64, "hits": I32, "dissipated": F64, "held": F64, "asleep": I32, "kind": I32,
    "kinds": REAL, "history_hash": I32, "displacement": F32, "slot_before": I32,
    "tile": I32, "listed": I32, "blocks": I32, "reach": REAL, "edge_x": F64, "edge_y": F64, "ghost": I32,
    "motion": REAL, "action": F64, "event_info": I32, "image_info": I32,
    "candidates": I32, "since": REAL, "turn": F64, "loss": F64, "rest": I32, "contact": F64, "cached_force": F64,
    "residual_acceleration": F64, "head": I32, "bin": I32, "wall_start": I32, "wall_item": I32, "walls": REAL,
    "near": U64, "near_image": U64, "image_list": I32, "dense": I32, "block_integers": I32, "block_reals": REAL,
    "block_sums": F64,
    "watched": I32, "event": REAL, "event_int": I32, "pair_time": REAL, "pair": I32, "kicks": F64, "force_values": F64,
    "shares": REAL,
}  # fmt: skip
"""Types of the numbers of arrays on the device."""
AXES = {
    "tile": 2, "reach": 2, "found": 2, "tally": 3, "law": 3, "frame_out": 2, "totals": 2,
    "species_totals": 3, "todo": 2, "pairs": 2, "kicks": 2,
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
GHOST_BYTES = 7  # of ghost records of disks in halos, for each disk
# Frames at numbers of collisions in tiles take these bytes for each collision in a window.
PAIR_BYTES = bytes_of("pair_time", "pair")
SNAPSHOT_DISKS = 500_000  # bound on disks times moments of a window (28 MB), but for a single moment
CONTACTS_PER_DISK = 8  # for which there is room, on average
RESTING_BYTES = (  # more, of disks that may rest: room for contacts of each, and the forces at four
    _PARTS * bytes_of("asleep", "held")
    + CONTACTS_PER_DISK * bytes_of("contact")
    + bytes_of("rest", "residual_acceleration", "cached_force")
)

SINGLE_TILE = 20_000  # up to so many disks, one thread runs the whole box as one tile


def bytes_per_disk(low_memory: bool = False) -> int:
    """Bytes of the arrays per disk, in double precision; with `low_memory` without the state at a moment."""
    constant = bytes_of("history_hash", "displacement", "slot_before") + GHOST_BYTES
    return (_PARTS - low_memory) * bytes_of("disk", "meta") + constant


def most_disks(low_memory: bool = False) -> int:
    """Largest number of disks of a process: in each part of the longest array a disk has at most eight numbers."""
    return ADDRESSABLE // (8 * (_PARTS - low_memory))
