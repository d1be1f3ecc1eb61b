"""The engine's arrays: what each holds, and the names of their columns.

A *slot* is a place in the list of a tile's disks. All that lasts from window to window is kept by slot, by *part*: the
window's beginning and its end (0 and 1, which change places), and moments in it that were asked for (2 and more, as
many as there is room for). Slots of part p begin at p * room, *notes* behind all parts.

A moment is a time, or that of a collision with a number, known only when all tiles have run. Of that the part is
written somewhat before, with disks where their latest collisions left them (at `told_at`), and until somewhat later
each disk that collides leaves a note of the same kind. The latest note of a disk up to the moment, or else the part,
has the flight on which it is then (`readout.settle`).

Real numbers are f64, or f32 where a run asks for that; sums and times of the run are f64 always.

===========  ===================  =====================================================================================
array        shape                content
===========  ===================  =====================================================================================
disk         (rows,) of 5          X, Y, VX, VY, SPIN; places from the lower left corner of the tile that lists the disk
meta         (rows,) of 4          ID, EVENTS (collisions with disks and walls), IMAGE_X, IMAGE_Y
past         (rows,) of 2          LATEST, ANGLE, f64: time of the latest collision, and angle turned, of gases that ask
hits         (rows,) of 2          WALL_HITS, LAST_PARTNER, of gases that ask
spent        (rows,) of 7          energy that collisions took, by mechanism, f64: half of a pair's; of gases that ask
slept        (rows,)               AWAKE, ASLEEP, WOKEN or SAID_ASLEEP, of gases that rest (`rest.py`)
told_at      (parts room,)        time of the collision up to which a disk of parts from TOLD on was flown, in a window
note         (notes,) of 3        slot of a disk that collided, its tile, 1 for one of each pair
note_at      (notes,)             when it was, since the beginning of the window
note_tally   (notes, columns)     the tally of its tile after that, f64
kind         (n,)                 kind of each disk, by id; of a gas on several ranks by row of `disk`, (rows,)
kinds        (kinds,) of 6        what disks of a kind share
trail        (room,) of 2            hash of the history of the disk at a slot of the window's beginning, by its tile
way          (room,)              bound on how far it came, in largest diameters, f32
back         (room,)              slot at the window's beginning of the one at its end
tile         (tiles, 10)          where its lists begin and how long they are, by part; claims; state; owner; notes
reach        (tiles, 5)           halo; bound on how far its own disks came beyond its sides; the largest way; how
                                  far they are beyond its sides at the end; halo against the one that all begin with
edge_x/y     (tiles + 1,)         sides of the columns and rows of tiles, on the grid of places
tally        (tiles, 1 + moments, TALLY + ...)  sums over the window to its end, and to moments asked for, f64;
                                  from TALLY on those of walls: heat of thermal ones, sums of each, how pistons moved
claim        (claims,) of 3       slot of a copy at the window's beginning; hash of its history here
claim_at     (claims,) of 3       its place then, from the corner of the tile that made it; bound on how far it came
event        (events,) of 17      what happened to watched disks (columns below)
event_int    (events,) of 8       who was it
found        (blocks, ...)        sums over BLOCK_OF_TILES tiles, f64 (columns below)
total        (...)                the same over all
watched      (n,)                 1 for disks whose collisions are written down, by id
work, ...    (lanes * places,)    the scratch space of a lane, which runs one tile after another
touch        (...) of 21          contacts of disks that may rest, and the forces there, f64 (`rest.py`)
held, grip   (rows,), (places,) of 20  forces that the last judgement found at contacts of a disk, f64 (`rest.py`)
===========  ===================  =====================================================================================
"""

from collections import namedtuple
from typing import Any, NamedTuple

from .limits import MECHANISMS

X, Y, VX, VY, SPIN = range(5)
ID, EVENTS, IMAGE_X, IMAGE_Y = range(4)
LATEST, ANGLE = range(2)
WALL_HITS, LAST_PARTNER = range(2)
INVERSE_MASS, K, KIND_RADIUS, MATERIAL, KIND_MASS, KIND_INERTIA = range(6)
TOLD = 2  # the part that holds the first moment asked for
MOST_MOMENTS = 8
# tile: first slot (within its part) and number of disks at the window's beginning and end (column + part); claims;
# disks gathered; 1 for those of this rank, where a gas is on several (`ifrdem/simulation/ranks.py`); the first note
# that may be of its latest run
START, COUNT, CLAIMS, N_CLAIMS, BAD, GATHERED, OWNED, NOTED = 0, 2, 4, 5, 6, 7, 8, 9
# reach
HALO, BEYOND, FURTHEST, PROTRUDES, WIDER = range(5)
# found, and `total` of all: largest of the square of a speed, and of `reach`; then sums of the tally to the end, and
# to each moment
MOST_SPEED, MOST_BEYOND, MOST_FURTHEST, MOST_PROTRUDES, FIRST_SUM = range(5)
BLOCK_OF_TILES = 128
# tally: whole numbers are exact up to 2^53
COLLISIONS, WALL_COLLISIONS, ELASTICS, REGIMES, LOSSES = 0, 1, 2, 3, 8
WALL_WORK, FLOW_WORK, FASTEST, SQUARES, SLEEPERS = 15, 16, 17, 18, 19
TALLY = 20
# columns of losses and regimes in the tally
NORMAL, RESTITUTION, SLIDING_LOSS, STICKING_LOSS, ROLLING_LOSS, BY_WALLS, BY_REST = range(MECHANISMS)
ELASTICALLY = 4
AT_END, AT_MOMENT = range(2)  # the first of the moments
# scratch of a disk. work: flight from TAU on; times of its next collision and of leaving its cell
TAU, T_HIT, T_LEAVE, TURN = 4, 5, 6, 7
W_SPIN = 7
# link: whom it hits next (another place, a wall, nobody); cell; collisions so far; those of the partner when that was
# predicted; neighbours in the list of its bin; next in the list of its cell; whom it hit last in this window; id; its
# rank among own disks, from 1 on, or minus that among copies; hash of its history; upper half of the largest square of
# its speed; kind; row of tiles against the own one; over which side it leaves its cell. A line of the cache.
(
    PARTNER, CELL, NUMBER, PARTNER_NUMBER, PREVIOUS, NEXT, NEXT_IN_CELL, LAST, WHO, OWN, HASH_1, HASH_2, TOP, KIND, ROW,
    DIRECTION,
) = range(16)  # fmt: skip
# rest: AWAKE, ASLEEP or WOKEN since the window's beginning; 1 where the disk may fall asleep in it; quick
# hits of something at rest, one after the other
ASLEEP_NOW, MAY_REST, HITS_NOW = range(3)
AWAKE, ASLEEP, WOKEN, SAID_ASLEEP = range(4)  # by a state that nobody has judged yet
TOUCHES_OF_DISK = 8  # for which there is room, on average
# held: contacts of a disk whose forces are kept; of each the other's id, FIRST_WALL - wall or NOBODY, and four forces
HELD, OF_HELD = 4, 5
# mark: slot at the window's beginning; boxes travelled in this window; collisions before it, and with walls in it; tile
# that lists it
SLOT, LAP_X, LAP_Y, BEFORE, AT_WALLS, LISTED = range(6)
# counter: next tile to be run; claims used; why a launch ended early; slots used; what was needed; 1: a disk came to
# rest on a wall, events without progress; bad tiles; events; windows; rows of
# events; 1 where only the listed tiles are run; of a gas in one tile: 1 where it pauses at the moment that is told; 1
# where it goes on from there; 1 where it has paused for the time, BY_COUNT for the number of collisions; bad tiles
# with the widest halo; 1 where no window of a launch may follow; windows in which it was not found out who may rest,
# and disks that fell asleep at speed; notes
(
    NEXT_TILE, N_CLAIMED, FULL, N_SLOTS, NEEDED, RESTING, STALLED, N_BAD, N_EVENTS, N_WINDOWS, N_WATCHED, AGAIN,
    PAUSING, RESUMING, PAUSED, STUCK, HALTED, UNJUDGED, JAMMED, N_NOTED,
) = range(20)  # fmt: skip
BY_COUNT = 2
FULL_PLACES, FULL_CELLS, FULL_CLAIMS, FULL_WALLS, FULL_WATCHED = 1, 2, 4, 8, 16
# clock, f64: begin and end of the window; where to stop (time, collisions in all), to pause, when a force
# acts; what sets the length of windows: a path, the side of a tile, the speed of walls; unit of squares of
# speeds; path in a gas that fills the box, collisions in a window of that; root mean square of speeds at the beginning;
# the longest window that may be; when gravity last turned
(
    BEGIN, END, STOP, WANTED, PAUSE, PAUSE_AFTER, KICK, PATH, TILE_SIDE, WALL_SPEED, SQUARE_UNIT, FREE_PATH,
    IN_WINDOW, SPEED, LONGEST, TURNED,
) = range(16)  # fmt: skip
# grid: disks; tiles; lanes; places, cells, bins and walls of a lane; part of the window's beginning; periodic sides;
# walls; seed; 1 where one tile is the whole box; rows of cells of all; verification on; small cells along
# a large one; a 0 that no compiler knows; threads of a GPU for each tile's events, of which one works; room for moments
# and for notes; the first piston among the rows of walls, or -1
(
    N, TILES_X, TILES_Y, LANES, PLACES, CELLS, BINS, ITEMS, PART, PERIODIC_X, PERIODIC_Y, WALLS, SEED_LOW, SEED_HIGH,
    ALONE, MOST_CLAIMS, TILES_ASIDE, BOXES_ASIDE, ROOM, WATCHING, MOST_EVENTS, COARSE, NOTHING, STRIDE,
    MOMENTS, NOTES, FIRST_PISTON,
) = range(27)  # fmt: skip
# scale: box; least side of a cell; window; largest diameter; what rounds places; gravity; cut-off;
# contact time; shear rate; speed of a row of tiles against the one below, and how far it is beside whole tiles; the
# largest radius of disks in small cells; the halo that tiles begin with, and the widest; the part of it for
# those who hit one another in chains; the least side of a tile; for each moment in the window, in order, when its part
# is written, and until when notes are taken for it, which is later only for that of a collision; FAR behind the last
(
    LENGTH_X, LENGTH_Y, CELL_SIDE, WINDOW, WIDEST, ROUNDER, GX, GY, CUTOFF, CONTACT_TIME, SHEAR, DRIFT,
    ASIDE, SPLIT, USUAL_HALO, MOST_HALO, CHAIN, LEAST_SIDE, MOMENT_IN,
) = range(19)  # fmt: skip
# event: time, place, normal, velocity before and after, spin before and after; the same of the partner
AT, PLACE, NORMAL_X, V_BEFORE, V_AFTER, W_BEFORE, W_AFTER, U_BEFORE, U_AFTER, S_BEFORE, S_AFTER = (
    0, 1, 3, 5, 7, 9, 10, 11, 13, 15, 16,
)  # fmt: skip
REALS = 17
# event_int: tile; the disk's id; the partner's, or -2 - wall; boxes travelled; how it was; the disk's number of
# collisions
EVENT_TILE, EVENT_ID, EVENT_PARTNER, EVENT_BOX, EVENT_HOW, EVENT_NUMBER = 0, 1, 2, 3, 5, 6
INTEGERS = 8
BY_LAW, BY_REMEDY, BY_HEAT = range(3)
PAIRS, TRACKED = 1, 2  # what is watched: times of all pairs, or all that happens to some disks
TEAM = 32  # threads of a GPU that share a tile
NARROWER = 0.97  # a halo that had to be wider is so in the next windows too, less from window to window
BLOCK = 1024
FAR = 1.0e30  # a time later than any event
FIRST_WALL = -10  # as a partner: wall 0; wall w is FIRST_WALL - w
NOBODY = -1
# sums over all disks that `readout.read_out` gives; a column of its `hits_out`
TRANSLATIONAL, ROTATIONAL, MOMENTUM_X, MOMENTUM_Y, SHEAR_PRESSURE, FALL, ALL_EVENTS, EXCESS = range(8)
TOTALS = 8
SLEEPING = 2


def plain(f: Any) -> Any:
    """A copy of a Python function without type annotations, of which `ti.func` takes none but its own."""
    copy = type(f)(f.__code__, f.__globals__, f.__name__, f.__defaults__, f.__closure__)
    copy.__qualname__, copy.__module__ = f.__qualname__, f.__module__
    return copy


class CompiledLaw(NamedTuple):
    """The compiled part of the law: its function of a pair, and the length of its rows of coefficients, 1 or more."""

    impulses: Any
    n_coefficients: int
    is_bare: bool = False  # it has no coefficients: there is one in its rows, which it does not see
    parts: Any = None  # what `impulses` gives, and P_et, sticking, rolling: of laws that tell them apart


class Uses(NamedTuple):
    """Features of a gas: code of others is not compiled. One template argument, `uses`, of every kernel that asks."""

    walled: bool = False
    thermal: bool = False  # some walls are
    pieced: bool = False  # some consist of several rows of `walls`
    arched: bool = False  # some are arcs
    turning: bool = False  # some turn
    timed: bool = False  # some open, or move for a time only
    summed: bool = False  # what each gives is added up
    pistons: bool = False  # some have a mass and move freely
    remembers: bool = False  # a contact time: disks know when their latest collision was
    sheared: bool = False  # a mean flow
    tallied: bool = False  # a ledger of what dissipates energy
    partnered: bool = False  # disks know whom they hit last
    turned: bool = False  # disks know how far they have turned
    itemised: bool = False  # disks know what their collisions took; only with a ledger
    mixed: bool = False  # more than one kind of disk
    watched: bool = False  # collisions of some disks are written down
    layered: bool = False  # large disks lie in large cells, small ones in small cells
    rests: bool = False  # disks fall asleep
    shared: bool = False  # several ranks have a part of the tiles each
    collision_law: Any = None  # a `CompiledLaw`


def gas_of(**arrays: Any) -> Any:
    """The arrays that a kernel was given, and `uses`: bundled under their names while it is compiled."""
    return namedtuple("Gas", arrays)(**arrays)
