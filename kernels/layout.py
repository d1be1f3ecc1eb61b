"""Contents of the engine's arrays; `columns.py` names their columns.

A *slot* is an index in the list of a tile's disks. All that lasts from window to window is kept by slot, by *part*: the
window's beginning and its end (0 and 1, which alternate), and requested moments in it (2 and more, as
many as there is room for). Slots of part p begin at p * room.

A moment is a time. That of a collision with a number follows from the times of all collisions in the window. Tiles of a
CPU then repeat the events of the window, which they have written down (their *trail*), to write the moment; without
trails the window is run again.

Real numbers are f64, or f32 if a run requests it; sums and times of the run are f64 always (`columns.TYPES`).

=====================  =============  =================================================================================
array                  shape          content
=====================  =============  =================================================================================
disk                   (rows,)        positions from the lower left corner of the tile that lists the disk, velocities
meta                   (rows,)        id, collisions with disks and walls, boxes travelled
past                   (rows,)        time of the latest collision, and angle turned, of gases that ask
hits                   (rows,)        hits of walls and the latest partner, of gases that ask
dissipated             (rows,)        energy that collisions took, by mechanism: half of a pair's; of gases that ask
asleep                 (rows,)        AWAKE, ASLEEP, WOKEN or ASLEEP_UNVERIFIED, of gases that rest (`events/rest.py`)
kind                   (n,)           kind of each disk, by id; of a gas on several ranks by row of `disk`, (rows,)
kinds                  (kinds,)       what disks of a kind share
history_hash           (room,)        hash of the history of the disk at a slot of the window's beginning, by its tile
displacement           (room,)        bound on its displacement, in largest diameters
slot_before            (room,)        slot at the window's beginning of the one at its end
tile                   (tiles, ...)   where its lists begin and how long they are, by part; ghosts; state; owner
reach                  (tiles, ...)   halo, and what decides if it was wide enough
edge_x/y               (tiles + 1,)   sides of the columns and rows of tiles, on the grid of positions
tally                  (tiles,        sums over the window to its end, and to requested moments; behind them the
                       1 + moments,   virial, and those of walls: heat of thermal ones, sums of each, how pistons
                       ...)           moved
ghost                  (ghosts,)      of copies of other tiles' disks: where they were listed, hash of the history here
event, event_int       (events,)      collisions of tracked disks, and their ids
pair_time, pair        (pairs,)       times of collisions of two disks, and their ids
trail_time, trail      (events,)      events of a window in each tile, of copies too, linked in their order
found                  (blocks, ...)  sums over BLOCK_OF_TILES tiles
total                  (...)          the same over all
watched                (n,)           1 for tracked disks, by id
line, line_slot        (lanes         lines of flight in cells, of thin gases, and slots of their disks: bunch by bunch
                       bunches        (`tiles/lines.py`)
                       PLACES ...,)
bunch, spare           (lanes         of bunches: lines, and the next one of the cell; of a lane: the first of those
                       bunches,), ... that no cell has
motion, ...            (lanes         the scratch space of a lane, which runs one tile after another; `action` of
                       slots,)        gases in which forces act on single disks
dense                  (tiles,)       tiles that need blocks with more room
block_integers, ...    (blocks        the scratch space of a block: column after column
                       slots,)
near                   (blocks slots  slots of the disks near each, four in a word
                       NEAR_WORDS,)
kicks                  (steps, ...)   steps of forces that act within windows, in order; the last one never comes
shares                 (...)          shares of disks in totals of these steps, step by step in order of ids
force_values           (...)          directions along which the gas can drift, and parameters of these forces
image_list, near_image (blocks        images of walls near the tile of a block; those near each disk, three in a word
                       slots,)
contact                (...)          contacts of disks that may rest, and the forces there (`events/rest.py`)
held, cached_force     (rows,), ...   forces at contacts of a disk, as last solved for (`events/rest.py`)
=====================  =============  =================================================================================
"""

from typing import Any, NamedTuple

from .columns import LEVELS

SNAPSHOT = 2  # the part that holds the first requested moment
BLOCK_OF_TILES = 128
ELASTICALLY = 4  # of the regimes in the tally
# Of a word that points to a disk: its slot. Added to it: in a list of a cell, if another disk follows in the list; in a
# trail, if the tile counts the collision.
SLOT, MORE, OWN = 2**30 - 1, 2**30, 2**30
AT_END, AT_MOMENT = range(2)  # times of the tally: end of the window, first of the moments
AWAKE, ASLEEP, WOKEN, ASLEEP_UNVERIFIED = range(4)  # ASLEEP_UNVERIFIED: given by a state
# Why a gas in one tile has paused, besides at a time: for the number of collisions; for the length of the launch.
BY_COUNT, BY_WORK = 2, 3
FULL_SLOTS, FULL_CELLS, FULL_GHOSTS, FULL_WALLS, FULL_WATCHED, FULL_PAIRS, FULL_TRAIL = 1, 2, 4, 8, 16, 32, 64
KICKED = -1  # in place of a partner, in rows of tracked disks: a force changed the motion
BY_LAW, BY_REMEDY, BY_HEAT = range(3)  # kind of a collision
# What is written down: the collisions of all pairs; all that happens to some disks; what `replay` repeats.
PAIRS, TRACKED, TRAIL = 1, 2, 4
TEAM = 32  # threads of a GPU that share a tile
BLOCK_SLOTS = 864  # disks of a tile and its halo that a block of a GPU has room for (`windows/blocks.py`)
TOO_MANY = 8  # as `tile.mark`: the tile needs a block that runs dense tiles
TOO_LONG = 1 << 10  # as `tile.mark`: it has so many events that one thread has to run the whole box
DENSE_SLOTS = 4096  # the same of blocks that run what does not fit
MOST_BLOCK_WALLS = 3600  # of a gas that blocks run: nine images of each, as partners in 16 bits
NEAR_WORDS = 16  # of four entries each of the list of a disk: how many disks are near it, and which
BLOCK_HALO_DECAY = 0.9  # as HALO_DECAY, where blocks run tiles: wide halos need dense ones
HALO_DECAY = 0.97  # a halo that had to be wider is so in the next windows too, less from window to window
BINS_PER_DISK = 8  # of the queue of a gas in one tile, whose windows are long; on a CPU
MAX_TRAVEL = 0.4  # of the side of a tile, that the fastest disk may come in a window
BLOCK = 1024
FAR = 1.0e30  # a time later than any event
FIRST_WALL = -10  # as a partner: wall 0; wall w is FIRST_WALL - w
NO_PARTNER = -1
# The latest partner where a force has acted since: VOID_WALL plus a wall, or VOID_DISK minus a slot.
VOID_WALL, VOID_DISK = -1_000_000, -2_000_000
OWN_ACTION = -2  # as a partner: a force acts on the disk alone
# As `counter.stalled`: a force made a velocity that is not finite. Plus the row of `kicks`, or of a force that acts on
# single disks its number.
NOT_FINITE, NOT_FINITE_ALONE = 3, 1 << 30


class CompiledLaw(NamedTuple):
    """The compiled part of the law: its functions of a pair, and the names of its coefficients."""

    impulses: Any
    names: tuple[str, ...]  # one or more
    parts: Any = None  # what `impulses` gives, and P_et, sticking, rolling: of laws that divide P_t
    has_table: bool = False  # numbers of a table follow the coefficients in a row, which `parts` gets too


class CompiledForce:
    """The compiled part of a force that acts within windows. It is constant, and equal to one with the same values.

    `act` is its function, with `n_totals` totals and numbers of these `names`; `number` is its own among these forces,
    `first` that of its first number in `force_values`. If `alone`, it acts on single disks at random times
    (`disks/force_times.py`). `measure` is the function of one with totals. If it `draws_pair`, it takes the first pair
    of normal random numbers of a step. `n_bounds` first ids of species, of all but the first, follow its parameters.

    Neither a dataclass nor a tuple: quadrants passes the members of those to a function one by one.
    """

    def __init__(
        self,
        act: Any,
        n_totals: int,
        names: tuple[str, ...],
        number: int,
        first: int,
        *,
        alone: bool = False,
        measure: Any = None,
        draws_pair: bool = False,
        n_bounds: int = 0,
    ) -> None:
        self.act, self.n_totals, self.names = act, n_totals, names
        self.number, self.first, self.alone = number, first, alone
        self.measure, self.draws_pair, self.n_bounds = measure, draws_pair, n_bounds

    def values(self) -> tuple[Any, ...]:
        """The attributes, by which two forces are compared."""
        return tuple(vars(self).values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CompiledForce) and self.values() == other.values()

    def __hash__(self) -> int:
        return hash(self.values())

    @property
    def first_parameter(self) -> int:
        """Number of its first parameter, in `force_values`."""
        return self.first + (2 if self.alone else 0)


class Uses:
    """Features of a gas: code of others is not compiled. One template argument, `uses`, of every kernel that asks.

    It is constant, and equal to one with the same features.
    """

    walls: bool = False
    thermal_walls: bool = False  # some walls are
    wall_pieces: bool = False  # some consist of several rows of `walls`
    arcs: bool = False  # some are arcs
    turning_walls: bool = False  # some turn
    timed_walls: bool = False  # some open, or move for a time only
    wall_sums: bool = False  # what each gives is added up
    pistons: bool = False  # some have a mass and move freely
    contact_time: bool = False  # a contact time
    latest_collision: bool = False  # disks know when their latest collision was
    shear: bool = False  # a mean flow
    ledger: bool = False  # a ledger of what dissipates energy
    stress: bool = False  # momentum that collisions transfer is added up
    heat_flux: bool = False  # energy too; with stress
    histograms: int = 0  # species, for whose pairs collisions are counted in histograms; with a ledger
    free_times: bool = (
        False  # also by the time since the latest collision of either disk; with latest_collision
    )
    last_partner: bool = False  # disks know their latest partner
    angle: bool = False  # disks know how far they have turned
    dissipated: bool = False  # disks know what their collisions took; only with a ledger
    several_kinds: bool = False  # more than one kind of disk
    histories: bool = False  # collisions of some disks are written down
    layers: bool = False  # large disks lie in large cells, small ones in small cells
    thin: bool = False  # few disks for their size: neighbours are found by lines of flight (`tiles/lines.py`)
    rest: bool = False  # disks fall asleep
    ranks: bool = False  # several ranks have a part of the tiles each
    low_memory: bool = False  # a window may be run to a moment in it only, for want of room (low_memory)
    collision_law: Any = None  # a `CompiledLaw`
    forces: tuple[CompiledForce, ...] = ()  # that act within windows

    def __init__(self, **given: Any) -> None:
        if unknown := given.keys() - Uses.__annotations__.keys():
            raise TypeError(f"there are no features {', '.join(sorted(unknown))}")
        vars(self).update(given)

    @property
    def blockwise(self) -> bool:
        """True if blocks of threads of a GPU run the tiles of a gas with these features (`windows/blocks.py`)."""
        return not (self.pistons or self.rest or self.layers)

    @property
    def forced(self) -> bool:
        """True if forces act within windows."""
        return bool(self.forces)

    @property
    def actions(self) -> bool:
        """True if forces act on single disks at random times."""
        return any(force.alone for force in self.forces)

    @property
    def gains(self) -> int:
        """Columns of the tally, the last ones, for energies that forces within windows give."""
        return LEVELS * len(self.forces)

    def replace(self, **given: Any) -> "Uses":
        """A copy with other values of the given features."""
        return Uses(**(vars(self) | given))

    def values(self) -> tuple[Any, ...]:
        """Values of all features, in order."""
        return tuple(getattr(self, name) for name in Uses.__annotations__)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Uses) and self.values() == other.values()

    def __hash__(self) -> int:
        return hash(self.values())
