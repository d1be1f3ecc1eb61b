"""The event-exact parallel engine, seen from the host: arrays, epochs, and what ends an epoch.

Time advances in *epochs*. At the beginning of one, disks are sorted into cells and tiles, and every pair is listed
that could touch before its end (`kernels/lists.py`, `kernels/extend.py`). Then the collisions are processed, in one
of three ways (`ORDERS`):

- *alone*: one thread, in their order, whole epochs in one launch (`kernels/epochs.py`): gases of up to ALONE disks;
- *tiles*: each tile by one thread, in order, as far as disks of other tiles do not matter (`kernels/tiles.py`);
  what remains between the tiles in rounds. Tiles run ahead of each other by one *window*, a part of the epoch that
  gets shorter where much must be undone: in clusters. Where that does not help (a cluster that collapses across a
  tile's border), one thread does the next epochs in the order of all collisions;
- *rounds*: all disks at once, optimistically; what came too early is undone (`kernels/rounds.py`): for GPUs.

Guarantee. Invariants at the end of a window:

1. Complete lists: at any time every pair is listed that is closer, at the beginning of the epoch, than contact + what
   both disks may move until its end; no disk moves further.
2. Tested flights: every listed pair has been tested on all flights of both that overlap in time since either last
   changed, and no contact is left before the window's end that is not a collision.
3. Agreement: a collision stands in the histories of both its disks, at one time, computed by a formula that gives the
   same bits from either side.

A history with these three is a consistent motion of hard disks from the given start, and that is unique: it is what
a serial event-driven code produces, up to rounding. Exact ties in time fall to the smaller pair of ids. How the
work was shared does not enter: any number of threads, and any window, gives the same bits. (Skin and tiles set the
points that positions are measured from, and so enter the rounding; they depend on the gas only, not on the machine.)

In a sheared box, rows of tiles move with the mean flow, and how far a disk moves is counted in it (`kernels/shear.py`).

An epoch ends early, and everything at or after its new end is undone, when

- a collision makes a disk so fast that even the longest list would not be complete to the planned end;
- the log could overflow, or a dense cluster takes too many rounds: it then ends at the earliest unprocessed event,
  before which everything is final;
- the caller wants to stop at a number of collisions, or a force is to act (`splitting.py`).

It is done again from its beginning, with more room, when the tiles' collisions do not fit into the log, or the list
of a disk that became fast does not fit into its row.

What made it fast (N = 1e5, phi = 0.3, one thread, ns a disk and epoch, collisions a disk and epoch; noisy machine):

=====================================  ===========================================  =========================
version                                expected                                     outcome
=====================================  ===========================================  =========================
rounds over all disks, full lists      -                                            565, 0.16
tiles in order, half lists             events 300 ns each instead of 1300, list     294, 0.155: events 345 ns,
                                       half as long                                 list 97 instead of 300
longer lists for fast disks only       epochs 1.7 times as long for 10 ns a disk    + 30 ns, 0.275
loops over few items spread out        Taichi ran them on one thread: twice as fast 2 threads: list 112 to 70
parallel rounds for 500 active disks   launches cost less than work                 wrong: 1 ms a round; 4096 stays
sorting by way of the log              64 bytes a disk less, same time              so seen
one thread where windows get short     a collapsing cluster costs no more than a    3e3 to 4e5 collisions/s
                                       serial code                                  (clustered coins, N = 2e5)
=====================================  ===========================================  =========================
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, InelasticCollapse, NoMoreCollisions
from ..kernels.limits import ALONE, MECHANISMS, REGIMES, TILE_DISKS
from ..model.box import Box, below
from ..model.ifr import IFRLaw
from ..model.law import CollisionLaw, compiled
from ..model.state import Disks, State
from ..model.walls import Wall, sides
from ..model.walls import check as check_walls
from ..tools import checked, seeds
from . import checks, device
from . import checks as engine_checks
from . import checks as magnitudes
from . import device as backend
from . import skin as skins
from .interrupts import Deferred
from .tracking import Statistics
from .unbounded import CELLS_PER_DISK, OpenSpace, around

if TYPE_CHECKING:
    from ..model.forces import Force
    from .arrays import DeviceArrays
    from .epochs import Outcome
    from .readout import Passing
    from .tracking import Tracking

PATIENCE = 1000  # usual times between collisions without one, after which a run by collisions gives up
STALLED_EPOCHS = 50  # epochs in a row that together gain no time: the gas has collapsed


@dataclass(frozen=True)
class Collisions:
    """The collisions of one epoch, in order.

    Attributes
    ----------
    time : array (c,)
        Times [time].
    pair : array (c, 2) of int32
        Ids of the two disks, the smaller one first.
    """

    time: NDArray[np.float64]
    pair: NDArray[np.int32]


class Engine:
    """Disks in a box, moved from collision to collision.

    Parameters
    ----------
    disks, box, state : Disks, Box, State
        What moves, where, and its start. Positions must not overlap (`placement.check_no_overlap`).
    law_table : array (M, M, c)
        Coefficients of the law for each pair of materials (`table_row`): e_n, e_t, mu, contact_point, rho of `IFRLaw`.
    arch, threads
        See `backend.start`.
    skin : float, optional
        Extra listing distance [length]; by default `default_skin`. Results do not depend on it beyond rounding.
    walls : sequence of Wall
        Beside the straight ones of material 0 at sides of the box that are not periodic, which come after them.
    gravity : two floats
        Acceleration of all disks [length/time^2]; only in directions that are not periodic.
    velocity_cutoff : float
        Collisions whose normal speed of approach is below this [length/time] are elastic, and without friction.
    contact_time : float
        So are those of a disk whose latest collision was less than this ago [time]; 0 does without.
    forces : sequence of Force
        What acts between collisions (`splitting.py` says when).
    seed : int
        Of the random numbers of forces and thermal walls, 0 to 2^64 - 1.
    law : class of laws
        Whose coefficients the table holds.
    ledger : bool
        Add up what dissipates energy (`dissipated`).
    partners : bool
        Keep whom each disk hit last (`State.last_partner`).
    angles : bool
        Keep how far each disk has turned (`State.angle`).
    tracking : Tracking, optional
        Follows some disks, collision by collision.

    Raises
    ------
    InputError
        If a disk is larger than a third of a side of the box, one of infinite mass moves, the device is not there, or a
        force cannot act.
    """

    def __init__(
        self,
        disks: Disks,
        box: Box,
        state: State,
        law_table: NDArray[np.float64],
        *,
        arch: str = "cpu",
        threads: int | None = None,
        skin: float | None = None,
        precision: str = "f64",
        order: str | None = None,
        tile_disks: int = TILE_DISKS,
        windows: int | None = None,
        walls: Sequence[Wall] = (),
        gravity: tuple[float, float] = (0.0, 0.0),
        velocity_cutoff: float = 0.0,
        contact_time: float = 0.0,
        forces: Sequence[Force] = (),
        seed: int = 0,
        law: type[CollisionLaw] = IFRLaw,
        ledger: bool = False,
        partners: bool = False,
        angles: bool = False,
        tracking: Tracking | None = None,
    ) -> None:
        self.disks, self.box = disks, box
        n = self.n = disks.n
        law_table = np.ascontiguousarray(law_table, dtype=np.float64)
        self.gravity = checked.finite_pair("gravity", gravity)
        self.seed = seed = seeds.of_device(seed)
        self.precision = precision
        checks.check(
            disks, box, state, len(law_table), walls, self.gravity, precision, forces,
            velocity_cutoff=velocity_cutoff, contact_time=contact_time,
        )  # fmt: skip
        diameter = 2.0 * float(disks.radius.max()) if n else 0.0
        self.walls, self.given_walls = (*walls, *sides(box)), len(walls)
        check_walls(self.walls, box, state.position, disks.radius, len(law_table), float(state.time))
        # Behind a side that is a wall the box goes on for a diameter: pairs never meet through it. No wall moves
        # further than that; a steady one must not come there (the state is checked).
        if box.is_open:
            inner, self._offset = around(state, disks)
        else:
            room = [0.0 if periodic else 2.0 * diameter + self._wall_extent() for periodic in box.periodic]
            self._offset = np.array(room) / 2.0
            inner = Box((box.lengths[0] + room[0], box.lengths[1] + room[1]), shear_rate=box.shear_rate)
        self._inner = inner
        self._skin_given = skin
        skin = skins.choose(skin, inner, box, disks, state)
        self._released = True  # until there is anything to release
        self._whole = True  # False while an epoch is under way: an interrupt would leave it half done
        # While observers are told of frames within an epoch, of which nothing has settled.
        self._told: Passing | None = None
        self.skin = skin
        self.time = float(state.time)
        self.collisions = int(state.collisions.sum()) // 2
        self.wall_hits = int(state.wall_hits.sum())
        self.statistics = Statistics()
        self.last_collisions: Collisions | None = None
        self.keep_collisions = False
        self._stalled = 0
        self._collided_at = self.time
        self._space = OpenSpace(disks) if box.is_open else None
        self.order = order or ("rounds" if arch != "cpu" else "alone" if n <= ALONE else "tiles")
        device.start(arch, threads=threads, precision=precision)
        from .arrays import DeviceArrays
        from .epochs import Epochs
        from .force_steps import Splitting

        self._law_table, self._law = law_table, law

        def arrays_for(state: State, inner: Box, skin: float, offset: NDArray[np.float64]) -> DeviceArrays:
            moved = State(
                position=state.position + offset, velocity=state.velocity, spin=state.spin, time=state.time,
                collisions=state.collisions, image=state.image, wall_hits=state.wall_hits,
                latest_collision=state.latest_collision, last_partner=state.last_partner, angle=state.angle,
            )  # fmt: skip
            kind: Any = self._law  # mypy does not take a class for hashable
            return DeviceArrays(
                disks, inner, moved, self._law_table,
                skin=skin, tile_disks=None if self.order == "alone" else tile_disks, precision=precision,
                walls=np.array([wall.row(offset) for wall in self.walls]) if self.walls else None,
                wall_speed=max((wall.most_speed for wall in self.walls), default=0.0), gravity=self.gravity,
                velocity_cutoff=velocity_cutoff, contact_time=contact_time, seed=seed,
                origin=(float(offset[0]), float(offset[1])), collision_law=compiled(kind),
                cells_per_disk=CELLS_PER_DISK if box.is_open else 1, tallied=ledger, partnered=partners,
                turned=angles,
            )  # fmt: skip

        self._arrays_for = arrays_for
        self.arrays: DeviceArrays = arrays_for(state, inner, skin, self._offset)
        self._released = False
        device.register(self)
        self.epochs = Epochs(self.arrays, self.statistics, self.order, windows, arch)
        self.splitting = Splitting(forces, self.arrays, disks, seed, self.time)
        self._resting = 0
        self.tracking = tracking
        # What the ledger held in the boxes of an open gas before the present one.
        self._lost_before = np.zeros(MECHANISMS)
        self._regimes_before: NDArray[np.int64] = np.zeros(REGIMES, dtype=np.int64)
        if self._space is not None:
            self._space.enter(inner, state, self._offset, self.arrays.furthest)
        # Kinetic energy in the frames of rows of tiles beyond that in the flow, at the start.
        self._flow_excess = math.nan
        self.flow_work = 0.0
        if box.shear_rate:
            self.state()

    def _wall_extent(self) -> float:
        return 2.0 * max((w.motion.extent for w in self.walls if math.isfinite(w.motion.extent)), default=0.0)

    @property
    def wall_work(self) -> float:
        """Energy that moving walls gave to the disks so far [energy], up to the latest settling (`state` settles)."""
        return self.arrays.work_of_walls()

    @property
    def wall_heats(self) -> NDArray[np.float64]:
        """Heat that each wall, those at sides of the box last, gave so far [energy], up to the latest settling."""
        return self.arrays.heat_of_walls()

    @property
    def most_level(self) -> int:
        """Highest level that the box allows a fast disk (`kernels/extend.py`)."""
        return self.arrays.most_level

    @property
    def bytes_allocated(self) -> int:
        """Bytes of all device arrays."""
        return self.arrays.bytes_allocated

    @property
    def looks_back(self) -> bool:
        """Whether it can tell the state at any time of an epoch that is over.

        Not with walls, shear or a contact time: their tallies are those of whole epochs.
        """
        uses = self.arrays.uses
        return not (uses.walled or uses.sheared or uses.remembers)

    def switch_off_rollback(self) -> None:
        """Let collisions that came too early stand: to see that tests notice. Never do so for results."""
        self.arrays.switch_off_rollback()

    def switch_ledger(self, on: bool) -> None:
        """Go on without adding up what takes energy, or with it again: to time what the ledger costs."""
        with self.changing():
            self.epochs.settle(self.time)
            self.arrays.switch_ledger(on)

    # ------------------------------------------------------------------ changes between runs

    def set_law(self, law_table: NDArray[np.float64], law: type[CollisionLaw]) -> None:
        """Collide by another law from now on; arguments as for the engine."""
        with self.changing():
            self.epochs.settle(self.time)
            self._law_table, self._law = np.ascontiguousarray(law_table, dtype=np.float64), law
            kind: Any = law  # mypy does not take a class for hashable
            self.arrays.set_law(self._law_table, compiled(kind))
            self._begin_anew()

    def set_forces(self, forces: Sequence[Force]) -> None:
        """Have other forces act from now on.

        Raises
        ------
        InputError
            If one is none, or cannot act here.
        """
        from .force_steps import Splitting

        self.check_whole()
        splitting = Splitting(forces, self.arrays, self.disks, self.seed, self.time)
        engine_checks.check_between_collisions(self.disks, self.box, self.gravity, splitting.forces)
        with self.changing():
            self.splitting = splitting
            self._begin_anew()

    def set_gravity(self, gravity: tuple[float, float]) -> None:
        """Let disks fall otherwise from now on.

        Raises
        ------
        InputError
            If it is not two finite numbers, or acts along a periodic direction.
        """
        gravity = checked.finite_pair("gravity", gravity)
        engine_checks.check_between_collisions(self.disks, self.box, gravity, self.splitting.forces)
        with self.changing():
            self.epochs.settle(self.time)
            self.gravity = gravity
            self.arrays.set_gravity(gravity)
            self._begin_anew()

    def set_velocities(self, state: State) -> None:
        """Go on with the velocities and spins of another state, from the present places.

        Raises
        ------
        InputError
            If an immovable disk would move, or they are too large or small to compute with.
        """
        checks.check_motion(self.disks, state)
        hottest = max((wall.temperature or 0.0 for wall in self.walls), default=0.0)
        speed = magnitudes.fastest(self.disks, state.velocity, state.spin)
        magnitudes.check_magnitudes(self.disks, self.box, speed, self.precision, hottest)
        with self.changing():
            present = self._state()
            followed = self.tracking
            before = followed.snapshot(self.arrays, self._placed) if followed is not None else None
            if self._space is not None:
                present.velocity, present.spin = state.velocity, state.spin
                self._move_to(self._space, present)
            else:
                from ..kernels.totals import EXCESS

                excess = float(self.epochs.totals(self.time)[EXCESS])
                flow = (
                    present.velocity - self.arrays.velocities()
                    if self.box.shear_rate
                    else np.zeros((self.n, 2))
                )
                self.arrays.set_velocities(flow, state.velocity, state.spin)
                self._begin_anew()
                # What was done to energies in the frames of rows was not done by the flow.
                self._flow_excess += float(self.epochs.totals(self.time)[EXCESS]) - excess
            if followed is not None and before is not None:
                followed.kick(self.time, before, followed.snapshot(self.arrays, self._placed))

    def _begin_anew(self) -> None:
        """Take note that a gas has been changed: what is known of its collisions and rest does not hold any more."""
        self.epochs.unsettle()
        self._stalled = self._resting = 0
        self._collided_at = self.time
        if self._space is not None:
            self._space.parted = self.n < 2

    # ------------------------------------------------------------------ running

    def advance(
        self,
        *,
        t_end: float = math.inf,
        collisions: int | None = None,
        pause_at: float = math.inf,
        pause_after: int | None = None,
        passing: Callable[[Passing], None] | None = None,
        rest_at: float = math.inf,
    ) -> None:
        """Run one epoch, or some of a small gas: to `t_end` [time] or the total number of `collisions` at the latest.

        It ends at the latest where a force acts, after that; and where an epoch ends at or after `pause_at` [time] or
        the total number of collisions `pause_after`. Before an epoch is closed, `passing` may look back at it, if
        the engine `looks_back`; where there are no epochs, because nobody can meet anybody, it ends at `rest_at`
        [time], too.

        Raises
        ------
        NoMoreCollisions
            If no collision can ever happen but some are asked for.
        InelasticCollapse
            If collisions pile up without end, or a disk comes to rest on a wall.
        EngineError
            If a force makes a velocity that is not finite, or a guarantee of the engine is violated.
        """
        with self.changing() as deferred:
            space = self._space
            if space is not None and space.epochs_left < 1:
                self._make_room(space)
            self.last_collisions = None
            stop = min(t_end, self.splitting.next_time)
            if space is not None and space.parted:
                self._fly_apart(space, stop, rest_at)
            elif self.n == 0 or (self.n == 1 and not self.walls and not self.box.shear_rate):
                self.epochs.settle(self.time)
                self._fly_freely(stop, t_end, rest_at)
            else:
                wanted = None if collisions is None else collisions - self.collisions
                before = self.statistics.epochs
                if self.order == "alone":
                    watched = self.keep_collisions or self.tracking is not None
                    most = 1 if watched else None if space is None else space.epochs_left
                    pause = None if pause_after is None else pause_after - self.collisions
                    outcome = self.epochs.run_alone(
                        self.time, stop, wanted, most=most, pause_at=pause_at, pause_after=pause
                    )
                else:
                    outcome = self.epochs.run(self.time, stop, wanted)
                if space is not None:
                    space.epochs_left -= self.statistics.epochs - before
                self.collisions += outcome.collisions
                self.wall_hits += outcome.wall_hits
                if outcome.still:
                    self.time = outcome.time
                    self._fly_freely(stop, t_end, rest_at)
                else:
                    self._close_epoch(outcome, t_end, passing, deferred)
            self._apply_forces()

    def _close_epoch(
        self, outcome: Outcome, t_end: float, passing: Callable[[Passing], None] | None, deferred: Deferred
    ) -> None:
        from .readout import Passing

        self._resting = 0
        if self.keep_collisions:
            self.last_collisions = self._read_log()
        if self.tracking is not None:
            self.tracking.gather(self.arrays, self.time, self._placed)
        self.time = outcome.time
        if passing is not None:
            epoch = self._told = Passing(self, outcome.began)
            try:
                with deferred.lifted():
                    passing(epoch)
            except BaseException:
                # Whatever went wrong there, the run can go on, from the frame that was being told.
                if epoch.told is None:
                    self.epochs.after_epoch(self.time)
                    self._apply_forces()
                else:
                    self._end_epoch_at(*epoch.told, epoch.before)
                self._whole = True
                raise
            finally:
                self._told = None
        self.epochs.after_epoch(self.time)
        self._whole = True  # a run that has to stop here leaves a state
        self._watch(outcome, t_end)
        self._whole = False

    def _end_epoch_at(self, time: float, moment: float, before: int) -> None:
        """End the epoch that is over at a time in it, after so long [time]; there were `before` collisions before."""
        self.epochs.end_after(moment)
        self.time, self.collisions = time, before + self.epochs.standing()
        self._collided_at = min(self._collided_at, time)
        if self.tracking is not None:
            self.tracking.drop_after(time)

    def release(self) -> None:
        """Give all device memory back; the engine cannot be used any more."""
        self._released = True
        self.arrays.release()

    def __del__(self, is_finalizing: Callable[[], bool] = sys.is_finalizing) -> None:
        # Taichi's arrays of vectors do not free themselves. At the end, `sys` itself may have gone already.
        if not getattr(self, "_released", True) and not is_finalizing():
            self.release()

    def check_whole(self) -> None:
        """Refuse to go on with an engine that has ended, or was interrupted half-way through an epoch."""
        if self._released:
            raise EngineError(
                "this simulation has ended: another one was started with another device, precision or number of "
                "threads, of which a process has one at a time"
            )
        if self._told is not None:
            raise EngineError(
                "an observer is being told of a frame within an epoch, and the simulation is further by then: use the "
                "state and the measure that the observer is given, or a sampler"
            )
        if not self._whole:
            raise EngineError(
                "an epoch was interrupted half-way, so the state is lost: begin a new simulation from a stored state"
            )

    @contextmanager
    def changing(self) -> Iterator[Deferred]:
        """Refuse to begin unless the engine is whole, and delay Ctrl-C until it is whole again."""
        self.check_whole()
        with backend.sole_use(), Deferred() as deferred:
            self._whole = False
            yield deferred
            self._whole = True

    @property
    def told_time(self) -> float:
        """Time of the frame that observers are told of within an epoch [time]; infinite at any other moment."""
        return math.inf if self._told is None or self._told.told is None else self._told.told[0]

    def _apply_forces(self) -> None:
        due = self.splitting.due(self.time)
        if due and (self.walls or self.box.shear_rate):
            # Forces see the lab, not the frame that falls; and what walls or the flow did is told by velocities as they
            # left them.
            self.epochs.settle(self.time)
        followed = self.tracking if due else None
        before = followed.snapshot(self.arrays, self._placed) if followed is not None else None
        for index in due:
            self.splitting.apply(index, self.time)
        if due:
            self.epochs.unsettle()
        if followed is not None and before is not None:
            followed.kick(self.time, before, followed.snapshot(self.arrays, self._placed))
        if due and self._space is not None:
            self._space.parted = self.n < 2

    # ------------------------------------------------------------------ open boundaries

    def _make_room(self, space: OpenSpace) -> None:
        """Before disks of an open gas can touch each other across the sides of the box that is computed in."""
        state = self._state()
        if space.too_small(state.position + self._offset):
            self._move_to(space, state)

    def _move_to(self, space: OpenSpace, state: State, *, parted: bool = False) -> None:
        """Go on from a state of an open gas in a box that suits it; `parted`: it is known that nobody meets anybody."""
        inner, offset = around(state, self.disks)
        self.skin = skins.choose(self._skin_given, inner, self.box, self.disks, state)
        lost, regimes = self.arrays.dissipated()
        self._lost_before += lost
        self._regimes_before += regimes
        self.lay(state, inner, offset)
        space.enter(inner, state, offset, self.arrays.furthest, parted=parted)

    def lay(self, state: State, inner: Box, offset: NDArray[np.float64]) -> None:
        """New arrays, for another box that an open gas is computed in."""
        old, new = self.arrays, self._arrays_for(state, inner, self.skin, offset)
        self.arrays = self.epochs.arrays = self.splitting.arrays = new
        self._inner, self._offset = inner, offset
        self.epochs.unsettle()
        old.release()

    def _fly_apart(self, space: OpenSpace, stop: float, rest_at: float) -> None:
        """To `stop` or `rest_at` [time] in one flight: no disk can meet another one before a force acts."""
        if not math.isfinite(stop):
            raise NoMoreCollisions(
                f"t = {self.time:.6g}: the disks have flown apart, and none can meet another one any more, but "
                "collisions are asked for"
            )
        stop = min(stop, rest_at)
        state = self._state()
        state.position = state.position + state.velocity * (stop - self.time)
        if self.arrays.uses.turned:
            state.angle = state.angle + state.spin * (stop - self.time)
        state.time = stop
        self._move_to(space, state, parted=True)
        self.time = stop

    # ------------------------------------------------------------------ rest

    def _fly_freely(self, stop: float, t_end: float, rest_at: float) -> None:
        """To `stop` [time], where a force may set disks in motion; to `t_end` if none acts, or none can.

        Not beyond `rest_at` [time]: only a rest on the way, which says nothing of whether there is a way.
        """
        resting = self.splitting.keeps_rest and self.arrays.at_rest()
        if resting:
            stop = t_end
        self._resting += 1
        if not math.isfinite(stop) or (not math.isfinite(t_end) and self._resting > PATIENCE):
            raise NoMoreCollisions(
                f"t = {self.time:.6g}: no disk can meet another one, but collisions are asked for"
            )
        stop = min(stop, rest_at)
        if resting:
            self.splitting.skip_to(stop)
        self.epochs.fly(stop - self.time)
        self.time = stop

    def _read_log(self) -> Collisions:
        """The latest epoch's collisions; the epoch began at `time`."""
        times, slots = self.arrays.standing_records()
        pair = np.sort(self.arrays.ids()[slots], axis=1)
        order = np.lexsort((pair[:, 1], pair[:, 0], times))
        return Collisions(self.time + times[order], pair[order])

    def _watch(self, outcome: Outcome, t_end: float) -> None:
        """Stop a run that cannot come to its end."""
        if outcome.collisions:
            self._collided_at = self.time
        elif not math.isfinite(t_end):
            # Disks of a lattice that all begin to move at once may take a disk's own free time to meet.
            patience = max(PATIENCE, self.n * PATIENCE // 10)
            if self.time - self._collided_at > patience * self._free_time(outcome.fastest):
                raise NoMoreCollisions(
                    f"t = {self.time:.6g}: no collision since t = {self._collided_at:.6g}, {patience} times what is "
                    "usual at this density: these disks seem never to meet"
                )
        # In an inelastic collapse, collisions without end gain no time.
        self._stalled = self._stalled + 1 if outcome.stalled else 0
        if self._stalled >= STALLED_EPOCHS:
            raise InelasticCollapse(
                f"t = {self.time:.9g}: {STALLED_EPOCHS} epochs in a row gained no time: collisions pile up without "
                'end (inelastic collapse). Use collapse = "tc" with a contact_time or "velocity_cutoff" with a '
                "velocity_cutoff, a larger e_n, or a lower packing fraction, or end the run earlier"
            )

    def _free_time(self, speed: float) -> float:
        """Usual time between two collisions anywhere, if all disks moved at this speed: area / (n^2 sigma v)."""
        return self.box.area / (self.n**2 * 2.0 * float(self.disks.radius.mean()) * speed)

    # ------------------------------------------------------------------ reading

    def state(self) -> State:
        """The present state, in id order."""
        with self.changing():
            return self._state()

    def _state(self) -> State:
        self.epochs.settle(self.time)
        if self.looks_back and self.n:
            from .readout import state_at

            state, _ = state_at(self, 0.0, self.time)
            for name, value in self.arrays.history().items():  # copies of its own
                setattr(state, name, value)
        else:
            state = self._exported()
        shut = [axis for axis, periodic in enumerate(self.box.periodic) if not periodic]
        escaped = np.flatnonzero(np.any(state.image[:, shut] != 0, axis=1))
        if len(escaped):
            where = "through its open sides" if self.box.is_open else "where a wall should be"
            raise EngineError(
                f"t = {self.time:.9g}: disk {escaped[0]} left the box {where}; please report this"
            )
        return state

    def _exported(self) -> State:
        """The state of settled disks, in any gas."""
        from ..kernels.sort import export

        n = self.n
        real, integer = self.arrays.zeros(6, real=True), self.arrays.zeros(3, real=False)
        self.arrays.launch(export, self.time, real_out=real, int_out=integer)
        position = self._placed(real[:n, 0:2])
        past = self.arrays.history()
        flow = None
        if self.box.shear_rate:
            flow = self.box.flow(position)
            self._tally_flow(float(np.sum(real[:n, 5], dtype=np.float64)))
        return State(
            position=position,
            velocity=real[:n, 2:4],
            spin=real[:n, 4],
            time=self.time,
            collisions=integer[:n, 0] - past["wall_hits"],
            image=integer[:n, 1:3].copy(),
            wall_hits=past["wall_hits"],
            latest_collision=np.minimum(past["latest_collision"], self.time),
            last_partner=past["last_partner"],
            angle=past["angle"],
            flow=flow,
        )

    @property
    def origin(self) -> tuple[float, float]:
        """Where the user's box begins in the coordinates of the device [length]."""
        return float(self._offset[0]), float(self._offset[1])

    def highest(self, dtype: np.dtype[Any]) -> tuple[float, float]:
        """The largest coordinates of a type inside the user's box [length]; infinite where it is not periodic.

        Rounding can put a disk onto the far side, which is the next box already.
        """
        x, y = (
            below(length, dtype) if periodic else math.inf
            for periodic, length in zip(self.box.periodic, self.box.lengths, strict=True)
        )
        return x, y

    def _placed(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions in the user's box [length] of those on the device."""
        return np.minimum(place - self._offset, self.highest(place.dtype))

    def dissipated(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Energy that collisions took, by mechanism, and collisions by regime (`kernels/ledger.py`), so far.

        Up to the latest settling; zeros without a ledger.
        """
        lost, regimes = self.arrays.dissipated()
        return self._lost_before + lost, self._regimes_before + regimes

    def observed(self, stored: Collection[str] | None = None) -> tuple[State, NDArray[np.float64]]:
        """The present state and its sums (`kernels/totals.py`); `stored` as for `Passing.at`."""
        if stored is None or not (self.looks_back and self.n and all(self.box.periodic)):
            return self.state(), self.totals()  # and who left the box is looked for
        from .readout import state_at

        with self.changing():
            self.epochs.settle(self.time)
            return state_at(self, 0.0, self.time, stored=stored)

    def totals(self) -> NDArray[np.float64]:
        """Sums over all disks (`kernels/totals.py`), which settle. Less costly than a copy of the state."""
        from ..kernels.totals import EXCESS, FALL

        with self.changing():
            found = self.epochs.totals(self.time)
        if self.box.shear_rate:
            self._tally_flow(float(found[EXCESS]))
        if any(self.gravity):
            # From the corner of the user's box.
            mass = float(np.sum(self.disks.mass[self.disks.movable]))
            found[FALL] -= mass * float(np.dot(self._offset, self.gravity))
        return found

    def _tally_flow(self, excess: float) -> None:
        """Energy that the flow has put in: what it did in the frames of the rows, less what only these frames see."""
        if math.isnan(self._flow_excess):
            self._flow_excess = excess
        done = float(self.arrays.flow_work.to_numpy()[: self.n].sum())
        self.flow_work = done - (excess - self._flow_excess)
