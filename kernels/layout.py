"""Columns of the arrays that the engine's kernels share, and how they are passed on.

All arrays are `ti.ndarray`s, so that a kernel is compiled once for every number of disks. A disk's *slot* is its
place in the sorted order of the current epoch; its id never changes. *Cells* are small enough that only disks of
neighbouring cells can be neighbours; *tiles* are rectangles of cells, whose disks stand together in memory.

===========  ============  ==================================================================================
array        shape, type   a row holds
===========  ============  ==================================================================================
flight       (n, 8) real   what flights and events need (64 bytes in double precision)
kinds        (m, 6) real   inverse mass, k, radius, material, mass, moment of inertia of each kind of disk
link         (n, 8) int    partner, log chain and stamps of the current epoch
meta         (n, 3) int    id, kind, collisions with disks and walls
image        (n, 2) int    box crossings, by id
cell         (n,) int      cell number, by tile, in a tile by column
neighbour    (n, K) int    slots of neighbours in the same frame from the front; codes 9 * slot + shift of
                           others from the back
log_real     (c, 11) real  one collision: its time, and both disks' states before it
log_int      (c, 8) int    its slots, links and flags
log_loss     (c, 4) double with a ledger, the energy that it took (`losses.py`)
lists        (5, n) int    work lists of the rounds
counter      (17,) int     their lengths, and totals
limit        (5,) real     times at which the epoch and the window end
grid         (14,) int     numbers of disks, tiles, cells and walls; the seed; displacement of rows of tiles
scale        (22,) real    lengths and times of the grid and the epoch, gravity, shear
clock        (7,) double   times in epochs run by one thread, and what displaces rows of tiles
total        (6,) int64    collisions and epochs of one launch
walls        (W, 18) real  geometry, motion, material and temperature of each wall (`walls.py`)
near_walls   (n,) int      bits of the walls that a disk can touch in this epoch
wall_hits    (n,) int      collisions with walls, by id
wall_work    (n,) real     energy that moving walls gave, by id
wall_heat    (n, H) double energy that each thermal wall gave, by id
flow_work    (n,) double   energy that the mean flow gave, by id (`flow.py`)
losses       (2, 6) double energy that collisions took, by mechanism (`ledger.py`)
losses_whole (2, 6) int64  the same of an epoch in whole numbers
regimes      (5,) int64    collisions of two disks by regime
last_partner (n,) int      whom each disk hit last, by id: an id, -1 nobody, -2 - w wall w
angle        (n,) double   how far each disk has turned, by id [rad]
sums         (B, 8) double sums over all disks (`totals.py`), of B blocks of slots
latest       (n + 1,)      double: time of each disk's latest collision, by id, and of the epoch's beginning
law          (M, M, c)     coefficients of the law for each pair of materials (IFR: e_n, e_t, mu, contact_point, rho)
===========  ============  ==================================================================================

Positions are relative to the lower left corner of the disk's tile, so that they lose no precision far from the
origin; times are relative to the beginning of the epoch. A *shift* s = 3 (dx + 1) + (dy + 1) says that the
neighbour's tile lies dx, dy in {-1, 0, 1} tiles away, across a periodic side or not; seen from the other disk it is
8 - s. A *code* is 9 * slot + shift. In a sheared gas each row of tiles moves with the mean flow (`flow.py`): velocities
are relative to it, and a neighbour dy rows up moves dy DRIFT faster than its velocity says.

Taichi makes an atomic operation of `a[i] += b`, which costs as much as a division: what only one thread changes is
written `a[i] = a[i] + b`.

A kernel takes the arrays that it needs, and bundles them into `GasArrays` for the functions that it calls.
"""

from typing import Any, NamedTuple

from .language import ti

# flight: position at time TAU, velocity, spin, radius, time of the earliest predicted event
X, Y, VX, VY, TAU, SPIN, RADIUS, TE = range(8)
# kinds; mass and moment of inertia are 0 where they are infinite: sums over disks leave these out
INVERSE_MASS, K, KIND_RADIUS, MATERIAL, KIND_MASS, KIND_INERTIA = range(6)
# link: code of the earliest event's partner; latest log record; collisions in this epoch; stamps with the number of
# a round; the collision from which on to undo; lengths of the neighbour row's two parts
PARTNER, HEAD, SEQ, ACTIVE, DIRTY, AFFECTED, UNDO, LENGTH = range(8)
# While a tile runs, its disks with events due stand in bins; these two columns then hold the bin's list.
NEXT, PREVIOUS_IN_BIN = ACTIVE, DIRTY
# While lists are extended, this column holds the LENGTH that a disk's list had before, if it is one of those.
LENGTH_BEFORE = ACTIVE
# meta
ID, KIND, EVENTS = range(3)
# log_real: time, then x, y, vx, vy, spin of either disk from column BEFORE + 5 * side on
TIME, BEFORE = 0, 1
# log_int: slot, previous record and number in its epoch of either disk (column + side); how it was (bits in
# `contact.py`), plus SHIFT_BITS times the shift from the first disk to the second; whether it stands
SLOT, PREVIOUS, NUMBER, HOW, STANDS = 0, 2, 4, 6, 7
SHIFT_BITS = 8
# lists: disks that predicted again because they changed (two rows, for even and odd rounds), because a
# neighbour changed (likewise), and disks to be rolled back
CHANGED_ROW, AFFECTED_ROW, UNDO_ROW = 0, 2, 4
EXTEND_ROW = UNDO_ROW  # lists are extended while nothing is to be undone
# counter: the lengths of those five lists, and
N_LOG = 5  # records written in this epoch, undone ones and gaps included
N_STANDING = 6  # collisions that stand
N_VIOLATIONS = 7  # causality violations found
N_ROUNDS = 8  # rounds in this epoch
ROUND = 9  # number of the current round, counted through the whole run
MOST_NEIGHBOURS = 10  # longest neighbour row that was needed
LOG_FULL = 11  # 1: the log may have no room for another round; 2: it had too little for the tiles
N_UNDONE = 12  # collisions undone
TOP_LEVEL = 13  # highest level of any disk in this epoch
N_WALL_HITS = 14  # collisions with walls that stand
N_ELASTIC = 16  # collisions that stand and were elastic for a remedy for collapse (`contact.py`)
RESTING = 15  # 1: a disk came to rest on a wall, or its next meeting with it cannot be found
# limit: end of the epoch, the same as read by the current round, largest speed, earliest unprocessed event, mean
# square of the speeds
END, LATCHED, FASTEST, EARLIEST, MEAN_SQUARE = range(5)
# grid: disks; tiles along each side; cells along each side of a tile; entries of a neighbour row; log records;
# highest level that the box allows; 1, or 0 to see what happens when nothing is ever rolled back; walls; the seed of
# random numbers, low and high 32 bits; how many tiles, and before that boxes, a row of tiles was displaced against
# the one below when the epoch began
N, TILES_X, TILES_Y, CELLS_X, CELLS_Y, ROW, LOG_CAPACITY, MOST_LEVEL, ROLL_BACK, WALLS = range(10)
SEED_LOW, SEED_HIGH, TILES_ASIDE, BOXES_ASIDE = range(10, 14)
# scale: sides of a cell and of a tile, listing distance beyond contact, end of predictions, beginning and end of the
# window, what a disk of level 0 may move in an epoch, time that disks fly on when they settle, largest diameter,
# gravity, a speed that walls may give to disks, approach below which collisions are elastic,
# where the box begins in the coordinates of the tiles, time since the latest collision below which one is elastic;
# shear rate, velocity of a row of tiles against the one below, rest of its displacement when the epoch began; 0, which
# no compiler knows (`flights.py`)
CELL_X, CELL_Y, TILE_X, TILE_Y, SKIN, HORIZON, BEGIN, WINDOW = range(8)
REACH, DURATION, WIDEST, GX, GY, WALL_SPEED, CUTOFF, ORIGIN_X, ORIGIN_Y, CONTACT_TIME = range(8, 18)
SHEAR, DRIFT, ASIDE, NOTHING = range(18, 22)
# clock, in double precision: present time, where to stop, planned length of the latest epoch, DRIFT and TILE_X, when to
# pause at the next end of an epoch, and when the latest one began
NOW, TIME_END, PLANNED, ROW_SPEED, TILE_SIDE, PAUSE_AT, BEGAN = range(7)
# total, 64-bit: collisions still wanted; epochs, collisions, collisions with walls and elastic ones of this launch;
# after how many collisions to pause at the next end of an epoch
COLLISIONS_LEFT, N_EPOCHS, N_TOTAL, N_WALLS_TOTAL, N_ELASTIC_TOTAL, PAUSE_AFTER = range(6)

SPEED_MARGIN = 1.15  # how much faster than the fastest disk a disk may become before the epoch is cut short
# Taichi hands a thread at least so many items of a loop. Loops over few, long items run over SPREAD times as many,
# and do something in one of them.
SPREAD = 512
BLOCK = 1024  # items that one thread handles at a time in scans and reductions
ROLLED_BACK = -2  # as a partner: this disk was rolled back and has not predicted again
FAR = 1.0e30  # a time later than any event
NEVER = 1 << 30  # "undo from collision number NEVER on": nothing to undo
FIRST_WALL = -10  # as a partner: wall 0; wall w is FIRST_WALL - w
WALL_ID = 1 << 30  # walls come after all disks in the order of events
SAME_FRAME = 4  # the shift of two disks of one tile
# LENGTH = neighbours in the same frame + OTHER * those in others + LEVEL * level
OTHER, LEVEL = 1 << 14, 1 << 27
LEVELS = 4.0  # levels by which a disk's range grows by one reach
HIGHEST_LEVEL = (
    12  # a disk may come so many quarters of a reach further than others of its list, and once as far
)


@ti.func
def n_blocks(items):
    """Blocks that hold so many items."""
    return (items + BLOCK - 1) // BLOCK


@ti.func
def n_own(lengths):
    """Neighbours of a disk in its own frame."""
    return lengths % OTHER


@ti.func
def n_others(lengths):
    """Neighbours of a disk in other frames."""
    return lengths // OTHER % (LEVEL // OTHER)


@ti.func
def level_of(lengths):
    """Level of a disk: it may move (1 + level / LEVELS) reaches in this epoch."""
    return lengths // LEVEL


@ti.func
def kind_of(i, gas: ti.template()):
    """Kind of disk i; where there is but one, without a look at the disk, which may be far away in memory."""
    kind = 0
    if gas.kinds.shape[0] > 1:
        kind = gas.meta[i][KIND]
    return kind


@ti.func
def push(row, item, gas: ti.template()):
    """Append to a work list."""
    gas.lists[row, ti.atomic_add(gas.counter[row], 1)] = item


# Arguments of kernels: arrays of one, two and three dimensions (a dimension of vectors' components not counted).
Rows, Table, Cube = (ti.types.ndarray(ndim=dimensions) for dimensions in (1, 2, 3))


def plain(function):
    """A copy of a Python function without type annotations, of which `ti.func` takes none but its own."""
    copy = type(function)(
        function.__code__,
        function.__globals__,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
    return copy


class Law(NamedTuple):
    """What is compiled in of a law: its function of a pair, and the length of its rows of coefficients, 1 or more."""

    impulses: Any
    n_coefficients: int
    parts: Any = None  # what `impulses` gives, and P_et, sticking, rolling: of laws that tell them apart


class Uses(NamedTuple):
    """What a gas has: code for the rest is not compiled. One template argument, `uses`, of every kernel that asks."""

    walled: bool = False
    thermal: bool = False  # some walls are
    remembers: bool = False  # a contact time: disks know when their latest collision was
    sheared: bool = False  # a mean flow
    tallied: bool = False  # a ledger of what dissipates energy (`ledger.py`)
    partnered: bool = False  # disks know whom they hit last
    turned: bool = False  # disks know how far they have turned
    collision_law: Any = None  # a `Law`

    @property
    def reads_log(self) -> bool:
        """Whether settling reads the log of the epoch that ends."""
        return any((self.walled, self.remembers, self.sheared, self.tallied, self.partnered, self.turned))


class GasArrays(NamedTuple):
    """The arrays that a kernel was given, under their names in the table above; bundled while it is compiled."""

    grid: Any = None
    scale: Any = None
    flight: Any = None
    kinds: Any = None
    meta: Any = None
    image: Any = None
    link: Any = None
    cell: Any = None
    start: Any = None
    fill: Any = None
    block: Any = None
    order: Any = None
    squares: Any = None
    neighbour: Any = None
    lists: Any = None
    counter: Any = None
    limit: Any = None
    log_real: Any = None
    log_int: Any = None
    log_loss: Any = None
    law: Any = None
    clock: Any = None
    walls: Any = None
    near_walls: Any = None
    wall_hits: Any = None
    wall_work: Any = None
    wall_heat: Any = None
    latest: Any = None
    flow_work: Any = None
    losses: Any = None
    losses_whole: Any = None
    regimes: Any = None
    last_partner: Any = None
    angle: Any = None
    uses: Uses = Uses()
