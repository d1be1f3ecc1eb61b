"""Windows from the host: their lengths and sums, and stops of a run within one.

Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import EngineError, InelasticCollapse
from ...kernels import layout as k
from ...kernels.columns import CLOCK, TALLY, TOTAL, named
from ...kernels.events.events import TOO_FAR
from ...kernels.windows.planner import plan_window
from ...kernels.windows.windows import LEAST_HALO
from ..measuring.tracking import Statistics
from .arrays import DeviceArrays
from .domain import Domain
from .runner import TileRunner, WindowTooLong, unbounded

if TYPE_CHECKING:
    from ..steps.force_steps import ForceSteps

MOST_HALVINGS = 40  # of the window of a sheared gas
NOTHING_TOLD = -1.0  # before the beginning of any window
ROUNDING = 8  # last digits by which a window is longer than the moment that it is cut at, for collisions at that time


class WindowState(enum.Enum):
    """State of the present window: how far it is planned and has been run."""

    BETWEEN = "at the beginning of a window that has no end yet"
    PLANNED = "at the beginning of a window that has an end, and has not been run"
    AT_END = "at the end of a window that has been run"
    INSIDE = "at a moment of a window that has been run to its end"
    PAUSED = "at the moment to which a gas in one tile has been run: the scratch space holds the rest of the window"
    CUT = "at a moment whose state has taken the place of that at the window's end (`low_memory`)"


BETWEEN, PLANNED, AT_END, INSIDE, PAUSED, CUT = WindowState
NEXT: dict[WindowState, set[WindowState]] = {
    BETWEEN: {BETWEEN, PLANNED},
    PLANNED: {BETWEEN, AT_END, PAUSED},
    AT_END: {BETWEEN, PLANNED, INSIDE, CUT},
    INSIDE: {BETWEEN, AT_END, CUT},
    PAUSED: {BETWEEN, INSIDE, PAUSED},
    CUT: {BETWEEN, INSIDE},
}
"""The states that may follow each; any other is an error of the program."""


@dataclass
class Moment:
    """A moment of a window: its time since the window's beginning, and the sums over the tiles up to it."""

    time: float
    sums: NDArray[np.float64]


@dataclass
class Sums:
    """Sums over the tiles: columns of `tally`.

    Attributes
    ----------
    before : array
        Over all windows before the present one.
    at_end : array
        Over the present window, to its end.
    last_collisions : float
        Collisions in the window before it.
    """

    before: NDArray[np.float64]
    at_end: NDArray[np.float64]
    last_collisions: float = 0.0


@dataclass
class Watched:
    """Records of collisions in the present window.

    Attributes
    ----------
    kinds : int
        Of which collisions: TRACKED, PAIRS, TRAIL (`kernels.layout`), or several of them.
    fresh : bool
        True if it has just been run, and what was written down of tracked disks is new.
    reached, told : float
        Moments [time] to which a gas that has paused has been run, as kernels have it, and its events were given away.
    times : array or None
        Times of all collisions in the window [time], in order, where they are known.
    """

    kinds: int = 0
    fresh: bool = False
    reached: float = NOTHING_TOLD
    told: float = NOTHING_TOLD
    times: NDArray[np.float64] | None = None


class StoredWindow(NamedTuple):
    """Numbers of the present window in a checkpoint, in this order.

    Its `moment` is the present time since its beginning; 0 there. `planned` is 1 if it has an end.
    """

    begin: float
    end: float
    now: float
    moment: float
    planned: float
    fastest: float
    square_unit: float


class Windows:
    """The windows of one engine, one after another.

    Attributes
    ----------
    now : float
        The present time, in the present window [time].
    """

    def __init__(self, arrays: DeviceArrays, statistics: Statistics, time: float) -> None:
        self.arrays: DeviceArrays = arrays
        self.domain: Domain = arrays.domain
        self.runner: TileRunner = TileRunner(arrays, statistics)
        self.statistics: Statistics = statistics
        self.forces: ForceSteps | None = None
        self.now: float = time
        self._clock = arrays.clock.array
        arrays.clock.begin = arrays.clock.end = time
        self.state: WindowState = BETWEEN
        self._moment = 0.0  # the present time since the window's beginning
        self._moments: list[Moment] = []  # that have been written
        self.watched: Watched = Watched()
        size = len(arrays.sums)
        self._sums = Sums(np.zeros(size), np.zeros(size))
        tally, pistons = arrays.extra_tally, named(arrays.wall_rows, "walls").piston
        states = tally.piston_states(self._sums.before)
        states.displacement, states.speed = pistons.displacement[tally.pistons], pistons.speed[tally.pistons]
        # Times and numbers of collisions at which a run will stop.
        self._requested: list[tuple[float, float]] = []
        self._burst = 1  # windows of a GPU that went well one after another
        self._keeps_pairs = False  # collisions that are written down are wanted, not only their times

    def _to(self, state: WindowState) -> None:
        """Go on to another state: EngineError if it may not follow the present one."""
        if state not in NEXT[self.state]:
            raise EngineError(
                f"t = {self.now:.9g}: a window went from {self.state.name} to {state.name}; please report this"
            )
        self.state = state

    # ------------------------------------------------------------------ what it knows

    @property
    def begin(self) -> float:
        """Beginning of the present window [time]."""
        return self._clock.item(CLOCK.begin)

    @property
    def end(self) -> float:
        """End of the present window [time]; its beginning until the window is planned."""
        return self._clock.item(CLOCK.end)

    @property
    def fastest(self) -> float:
        """The largest speed of a disk at the window's beginning."""
        return float(self.arrays.clock.fastest)

    @property
    def inside(self) -> bool:
        """True if the present time lies within a window, which has to be kept."""
        return self.state in (INSIDE, PAUSED, CUT)

    @property
    def stopped_early(self) -> bool:
        """True at a moment that only a stop that was asked for has chosen (`backend.stop_is_asked`)."""
        return self.state is PAUSED and self.runner.stopped_early

    @property
    def moment(self) -> float | None:
        """The present time since the window's beginning [time], as kernels have it; None at the beginning."""
        if self.state is AT_END:
            return float(self.arrays.scale.window)
        return self._moment if self.inside else None

    @property
    def rests(self) -> bool:
        """True if a disk came to rest on a wall."""
        return self.runner.rests

    @property
    def only_walls_hit(self) -> bool:
        """True if disks hit walls in the window that was run last, and no other disks."""
        sums = self._tally(k.AT_END)
        return bool(sums[TALLY.wall_collisions] > 0.0 and sums[TALLY.collisions] == 0.0)

    @property
    def sleepers(self) -> int:
        """Disks that fell asleep less those that woke."""
        return int(self.sum(TALLY.sleepers))

    @property
    def elastic(self) -> int:
        """Collisions that were elastic for a remedy for collapse."""
        return int(self.sum(TALLY.elastics))

    def switch(self, uses: k.Uses) -> None:
        """Add up more or fewer quantities from now on: the motion stays the same."""
        inside, sums = self.inside, self.sums
        self.arrays.uses = uses
        self.runner.has_trail = False  # sums to the window's end change, too
        if inside:
            self._compute_moments([self._moment])
            self._sums.before += sums - self.sums

    def set_forces(self, forces: ForceSteps, within: tuple[k.CompiledForce, ...]) -> None:
        """Set other forces, and what is compiled of those that act within windows, at a window's beginning."""
        self.forces = self.runner.forces = forces
        if within or self.arrays.uses.forces:
            kept = self._sums.before[: self.arrays.extra_tally.first_force]
            self.arrays.set_forces(within)
            self._sums.before = np.append(kept, np.zeros(self.arrays.columns - len(kept)))

    @property
    def gains(self) -> NDArray[np.float64]:
        """Energy that each of the forces within windows gave, in parts [energy], shape (forces, LEVELS)."""
        return self.arrays.extra_tally.gains(self.sums)

    def add_flow_work(self, work: float) -> None:
        """Enter what a force did to energies in the frames of rows of tiles."""
        self._sums.before[TALLY.flow_work] += work

    @property
    def sums(self) -> NDArray[np.float64]:
        """Sums over all windows so far, to the present time; columns of `tally`."""
        before, in_window = self._sums.before, self._sums_in_window()
        return before.copy() if in_window is None else before + in_window

    def sum(self, column: int) -> float:
        """One of `sums`, by its column."""
        in_window = self._sums_in_window()
        before: float = self._sums.before.item(column)
        return before if in_window is None else before + in_window.item(column)

    def _sums_in_window(self) -> NDArray[np.float64] | None:
        """Sums from the beginning of the present window to the present time; None where that is its beginning."""
        if self.state is AT_END:
            return self._sums.at_end
        return self._sums_to(self._moment) if self.inside else None

    @property
    def part(self) -> int:
        """Part of the arrays that holds the present state."""
        part = int(self.arrays.grid.part)
        if self.state is AT_END:
            return 1 - part
        if not self.inside:
            return part
        m = self.snapshot_at(self._moment)
        return 1 - part if self.state is CUT else k.SNAPSHOT + m

    @property
    def time_origin(self) -> float:
        """Origin of the times in the present state [time]."""
        return self.end if self.state is AT_END else self.begin

    def commit(self) -> None:
        """Begin a window at the present time, which is no moment within one."""
        part = self.part
        self._sums.before = self.sums
        if self.state is AT_END:
            self.arrays.clock.overhang = self._most(TOTAL.overhang)
        self.arrays.grid.part = part
        self._begin_at(self.now)

    def commit_at(self, time: float) -> None:
        """Begin a window at the time of a state that is loaded into the arrays."""
        self._sums.before = self.sums
        self.arrays.clock.overhang = 0.0
        self._begin_at(time)

    def _begin_at(self, time: float) -> None:
        """Begin a window at a time [time]; its end is not planned yet."""
        if self.forces is not None:
            self.forces.begin_window(self.moment)
        self.now = self.arrays.clock.begin = self.arrays.clock.end = time
        self._to(BETWEEN)
        self._forget()

    def _forget(self) -> None:
        """Forget the moments of a window, and what was written down, as another one begins."""
        self.watched, self._moments, self._moment = Watched(), [], 0.0
        self.runner.has_trail = False

    def snapshot(self) -> dict[str, NDArray[np.float64]]:
        """State of the windows, between two of them or within one."""
        stored = StoredWindow(
            self.begin, self.end, self.now, self._moment, float(self.state is not BETWEEN), self.fastest,
            float(self.arrays.clock.square_unit),
        )  # fmt: skip
        return {"window": np.array(stored), "sums": self._sums.before.copy()}

    def restore(self, found: dict[str, NDArray[np.float64]], watching: int = 0) -> None:
        """Restore what `snapshot` gave."""
        a, stored = self.arrays, StoredWindow(*found["window"].tolist())
        a.clock.fastest, a.clock.square_unit = stored.fastest, stored.square_unit
        self._begin_at(stored.begin)
        if self.forces is not None:
            self.forces.restore(found)
        self._sums.before = found["sums"].copy()
        a.clock.end, self.now, self._moment = stored.end, stored.now, stored.moment
        if not stored.planned:
            return
        self._to(PLANNED)
        self._plan(plans=False)
        inside = stored.now < stored.end
        if stored.moment > 0.0:
            if inside:
                a.make_moments()
            a.clock.stop, a.clock.wanted = stored.now, math.inf
            moments = self._present_moment() if inside else []
            self._compute(moments, 1, watching, pausing=inside and self._can_pause)
            if self.state is PAUSED:
                self._note_pause(stored.now)
            elif inside:
                self._to(INSIDE)

    # ------------------------------------------------------------------ length

    def go_on(self, kick: float) -> None:
        """At the end of a window, plan the next one: it ends at `kick` [time] at the latest, when a force acts."""
        a, ended = self.arrays, self.state is AT_END
        if self.state not in (BETWEEN, AT_END):
            return
        if self.forces is not None:
            self.forces.plan(kick)
        overhang = self._most(TOTAL.overhang) if ended else float(a.clock.overhang)
        if not a.box.is_open and not overhang <= TOO_FAR * a.least_side:
            raise unbounded(self.now)
        if ended:
            self._sums.last_collisions = float(self._sums.at_end[TALLY.collisions])
            self._forget()
        narrow = a.least_side - overhang < LEAST_HALO * a.least_side and not (a.single_tile or a.uses.shear)
        if narrow:  # halos would be
            self._plan(commits=ended, plans=False)
            a.relist()
            a.clock.overhang = 0.0
        if not ended:
            self.domain.survey(rough=True)
            self.domain.survey(rough=False)
        a.clock.kick = kick
        self._plan(commits=ended and not narrow)
        self._to(PLANNED)
        if not self.end > self.begin:
            raise InelasticCollapse(
                f"t = {self.now:.9g}: windows have become too short for the clock, as disks are too fast or collide "
                "too often. Look for walls that crush disks (`ifrdem check` warns of them) or give energy without end, "
                "and for a time that is too large for the speeds"
            )

    def _plan(self, *, commits: bool = False, plans: bool = True) -> None:
        """Have the device plan the window (`plan_window`)."""
        a = self.arrays
        a.sums[:] = self._sums.before
        a.launch(plan_window, int(commits), int(plans))
        self._sums.before = a.sums.copy()

    # ------------------------------------------------------------------ running

    def run(
        self,
        until: tuple[float, float],
        kick: float,
        pause: tuple[float, float],
        *,
        most: int,
        watching: int,
        next_points: Callable[[], Iterable[tuple[float, float]]],
    ) -> None:
        """Advance `until` a time or so many collisions in all, whichever is first, or to the end of a window.

        The first one that ends at or after a `pause`, of the same kind, or the last of `most` windows. `next_points`
        gives those of later calls; what lies in the same window is computed with it.
        """
        self.go_on(kick)
        self._keeps_pairs = bool(watching & k.PAIRS)
        if self.state is not PLANNED and watching & ~self.watched.kinds:
            # From its beginning, to see what happened in it.
            self._compute(self._present_moment(), 1, watching)
        if self.state in (PLANNED, PAUSED, CUT):
            self.arrays.clock.pause, self.arrays.clock.pause_after = pause
            self._run_to(until, most, watching, next_points)
        if self.state is PAUSED:
            self._note_pause(until[0])
        else:
            self._stop_at(*until)

    @property
    def _can_pause(self) -> bool:
        """True if the gas can pause within a window, and go on from there."""
        return self.arrays.single_tile and not self.arrays.on_gpu

    def _note_pause(self, stop: float) -> None:
        """Take the moment at which the gas has paused for the present time, which is `stop` [time] if it got there."""
        self._moment = self._moments[0].time
        self.now = self.begin + self._moment if self._paused_elsewhere else stop

    def _run_to(
        self,
        until: tuple[float, float],
        most: int,
        watching: int,
        next_points: Callable[[], Iterable[tuple[float, float]]],
    ) -> None:
        """Run the window, or the rest of one that has paused, as far as `run` says, and up to `most` windows."""
        a, (stop, wanted) = self.arrays, until
        pausing = self._can_pause
        self._requested = [until] if pausing else [until, *next_points()]
        if pausing or (a.on_gpu and math.isfinite(stop)):
            room = a.make_moments()
            moments = [stop - self.begin][:room] if stop < self.end else []
        else:
            moments = self.plan_snapshots(self.now)
        a.clock.stop, a.clock.wanted = until
        if not (pausing or a.on_gpu) and self._nears_count():
            watching, most = watching | self._timing, 1
        if self.state is CUT:  # what has been written down stays
            watching &= ~self.watched.kinds
        if a.keeps_moments or a.on_gpu or watching or math.isfinite(wanted) or stop >= self.end:
            most = min(most, a.burst, self._burst if a.on_gpu else most)
            self._compute(moments, most, watching, pausing=pausing)
        else:
            self._compute_moments([stop - self.begin])

    def _stop_at(self, stop: float, wanted: float) -> None:
        """Stop in a window that has been run, or at its end: at a time, or after so many collisions in all."""
        count = self._sums.before[TALLY.collisions]
        moment = stop - self.begin if self.begin < stop < self.end else None
        reached = self._sums.at_end
        if count + reached[TALLY.collisions] >= wanted:
            if moment is not None:
                reached = self._sums_to(moment)
            if count + reached[TALLY.collisions] >= wanted:
                moment = self._time_of(int(wanted - count))
                stop = self.begin + moment
                self.snapshot_at(moment)
        if moment is None:
            self._moment, self.now = self.end - self.begin, self.end
            if self.state is INSIDE:
                self._to(AT_END)
        else:
            self._moment, self.now = moment, stop
            if self.state is AT_END:
                self._to(INSIDE)

    @property
    def _timing(self) -> int:
        """Records that give the times of all collisions in a window: a trail, or pairs."""
        return k.TRAIL if self.arrays.keeps_trail else k.PAIRS

    def _nears_count(self) -> bool:
        """True if the present window may have a collision of a requested number; makes room for them all."""
        a, done = self.arrays, self._sums.before[TALLY.collisions]
        most = 1.5 * max(float(a.clock.in_window), self._sums.last_collisions) + 100.0
        if not any(done < count <= done + most for _, count in self._requested):
            return False
        room = int(most * a.domain.n_here(int(a.grid.part)) / a.n)
        if a.keeps_trail and a.grid.most_trail < room:  # copies write rows too, some 0.3 for each collision
            a.make_trail(room)
        elif not a.keeps_trail and a.grid.most_pairs < room:
            a.make_pairs(room)
        return True

    def plan_snapshots(self, begin: float, first: float | None = None) -> list[float]:
        """Requested moments of the present window, after `begin` [time], and the `first` one of all.

        In order, the first ones for which there is room. Of collisions only where their times are known.
        """
        a, length = self.arrays, self.end - self.begin
        found = {time - self.begin for time, _ in self._requested if begin < time < self.end}
        if self.watched.times is not None:
            before = self._sums.before[TALLY.collisions]
            counts = {count - before for _, count in self._requested if math.isfinite(count)}
            times = self._times_of([int(count) for count in sorted(counts) if count >= 1])
            found |= {time for time in times if begin - self.begin < time < length}
        moments = sorted(found)
        if first is not None:  # it comes first where there is no room for all
            moments = [first, *(each for each in moments if each > first)]
        return moments[: a.make_moments(len(moments))] if moments else []

    def snapshot_at(self, moment: float) -> int:
        """Provide the state at a moment of the window; return its part."""
        for m, each in enumerate(self._moments):
            if each.time == moment:
                return m
        self._compute_moments(self.plan_snapshots(self.begin + moment, moment) or [moment])
        return 0

    def _present_moment(self) -> list[float]:
        """The present time as the only moment of the window; none with `low_memory`."""
        return [self._moment] if self.arrays.keeps_moments else []

    def _compute_moments(self, moments: list[float]) -> None:
        """Compute the states at moments of the window; with `low_memory` only that at the first moment.

        The latter overwrites the state at the end of the window: a shorter window is run, which ends at the moment. The
        bits are the same, because they depend on the length of a window only with walls, forces within windows, shear
        and contact times, which `model.rules` refuses.
        """
        a = self.arrays
        if self.runner.has_trail:
            self._replay(moments)
            return
        if a.keeps_moments:
            self._compute(moments, 1, 0)
            return
        moment, end, at_end = moments[0], self.end, self._sums.at_end
        a.clock.end = self.begin + moment
        self._plan(plans=False)
        a.scale.stored_at = moment
        a.scale.window = a.scale.stored_at + ROUNDING * np.spacing(a.scale.stored_at)
        self._compute([], 1, 0)
        self._moments, self._sums.at_end = [Moment(moment, self._sums.at_end)], at_end
        self._to(CUT)
        a.clock.end = end
        self._plan(plans=False)

    def _sums_to(self, moment: float) -> NDArray[np.float64]:
        """Sums over the tiles from the window's beginning to a moment of it."""
        m = self.snapshot_at(moment)
        return self._moments[m].sums

    def _time_of(self, count: int) -> float:
        """Time of collision `count` = 1, 2, ... of the window, since its beginning."""
        if count <= 0:
            return 0.0
        if self.watched.times is None:
            self._compute([], 1, self._timing)
        return self._times_of([count])[0]

    def _times_of(self, counts: Sequence[int]) -> list[float]:
        """Times of these collisions, where those of all are known; infinity beyond the last."""
        assert self.watched.times is not None
        return self.domain.comm.nth_smallest(self.watched.times, counts)

    def take_events(self, none: bool = False) -> tuple[NDArray[Any], NDArray[Any]]:
        """Events of tracked disks on this rank in the present window, or `none`: rows of `event` and `event_int`.

        Of a window that has paused, those that were not given before.
        """
        real, whole = self.runner.events.rows(none)
        if self.watched.told >= 0.0:
            new = named(real, "event").time > self.watched.told
            real, whole = real[new], whole[new]
        if self.state is PAUSED:
            self.watched.told = self.watched.reached
        self.watched.fresh = False
        return real, whole

    def pairs(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Collisions of two disks here in the present window: rows of `pair_time` and `pair`."""
        return self.runner.pairs.rows()

    def _compute(self, moments: list[float], most: int, watching: int, *, pausing: bool = False) -> None:
        """Run the window to its end, writing moments in it; up to `most` of them.

        When `pausing`, which only a gas in one tile can, to the moment or to so many collisions, and on from there.
        """
        a, runner = self.arrays, self.runner
        resuming = self.state is PAUSED and pausing
        if self.state is PAUSED and not pausing:  # the rest of the window, too, which will not be run again
            watching |= self.watched.kinds & k.TRACKED
        begin, again = self.begin, self.state is not PLANNED
        self.watched.kinds = watching | (self.watched.kinds if again else 0)
        self._request(moments, watching)
        runner.clear()
        self.watched.fresh |= bool(watching & k.TRACKED)
        alone = a.grid.single_tile = int(a.single_tile)
        runner.rests = runner.rests and resuming
        a.sums[:] = self._sums.before
        self.domain.run(runner, most, pausing=pausing, resuming=resuming)
        self.statistics.windows -= again
        done = int(a.counter.n_windows)
        self._burst = max(2 * most, self._burst) if done >= most else max(done, 1)
        self.statistics.windows += done
        if not again:
            self.statistics.unverified += int(a.counter.unverified)
            self.statistics.jammed += int(a.counter.jammed)
        runner.collect()
        self._sums.before = a.sums.copy()
        if not alone:
            kept = replace(self.statistics)
            halvings = 0
            while True:
                try:
                    runner.run_until_good()
                    break
                except WindowTooLong:
                    halvings += 1
                    if halvings > MOST_HALVINGS:
                        raise EngineError(
                            f"t = {begin:.9g}: tiles of a sheared gas are too small for what happens in it; please "
                            "report this with the case file and seed"
                        ) from None
                    self._shorten()
            if again:
                vars(self.statistics).update(vars(kept))
        if begin != self.begin:  # the kernel ran further windows
            self.watched.times = None
        self._sums.at_end = self._tally(k.AT_END)
        moment_time = self.watched.reached = float(a.scale.moment[0])
        if begin != self.begin or self._paused_elsewhere:
            if not self._paused_elsewhere:
                moment_time = float(a.clock.stop) - self.begin if moment_time < k.FAR else k.FAR
            moments = [moment_time] if moment_time < k.FAR else []
        self._take_moments(moments)
        if watching & (k.PAIRS | k.TRAIL):
            self.watched.times = None if pausing else np.sort(runner.times().astype(np.float64))
            if not (self._keeps_pairs or a.keeps_moments):  # of a large gas as much as a frame
                runner.pairs.clear()
                a.make_pairs(0)
        if a.counter.paused:
            self._to(PAUSED)
        elif self.state is PLANNED:
            self._to(AT_END)
        elif self.state in (PAUSED, CUT):
            self._to(INSIDE)

    def _replay(self, moments: list[float]) -> None:
        """Write moments of the window by its trail; what was added up to its end stays."""
        a, to_end = self.arrays, slice(TOTAL.width + self.arrays.columns)
        tally, total = a.values("tally")[:, k.AT_END].copy(), a.total[to_end].copy()
        self._request(moments, 0)
        self.domain.replay(self.runner)
        a.values("tally")[:, k.AT_END], a.total[to_end] = tally, total
        self._take_moments(moments)

    def _request(self, moments: list[float], watching: int) -> None:
        """Have kernels write moments of the present window, and what is watched."""
        a = self.arrays
        a.scale.moment = k.FAR
        a.scale.moment[: len(moments)] = moments
        a.grid.watching = watching
        if a.uses.shear:
            a.displace_rows(self.begin)

    def _take_moments(self, moments: list[float]) -> None:
        """Take the sums up to moments that kernels have written."""
        self._moments = [Moment(each, self._tally(k.AT_MOMENT + m)) for m, each in enumerate(moments)]

    @property
    def _paused_elsewhere(self) -> bool:
        """True if the latest run has paused at another moment than that requested: after a collision, or early."""
        return self.arrays.counter.paused == k.BY_COUNT or self.runner.stopped_early

    def _shorten(self) -> None:
        """Run half of the window: what a sheared gas does whose tiles are too small for all of it."""
        a, runner = self.arrays, self.runner
        a.clock.end = self.begin + 0.5 * (self.end - self.begin)
        self._plan(plans=False)
        runner.clear()
        self.statistics.in_order += 1
        self.domain.run(runner)
        runner.collect()

    def _tally(self, when: int) -> NDArray[np.float64]:
        """Sums over the tiles, one after another: the same for any number of threads."""
        first = TOTAL.width + when * self.arrays.columns
        return self.arrays.total[first : first + self.arrays.columns].copy()

    def _most(self, column: int) -> float:
        """The largest values of all tiles."""
        return float(self.arrays.total[column])
