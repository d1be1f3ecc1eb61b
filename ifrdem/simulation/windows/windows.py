"""Windows from the host: their lengths and sums, and stops of a run within one.

Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

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


@dataclass
class Moment:
    """A moment of a window: its time since the window's beginning, and the sums over the tiles up to it."""

    time: float
    sums: NDArray[np.float64]


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
        self._completed = False  # the window has been run to its end
        self._ready = False  # the present window has an end, and has not been run
        # It has been run to the requested moment; the scratch space holds the rest of it.
        self._paused = False
        self._recorded = 0  # what has been written down of the present window
        # Moment to which events of tracked disks have been handed on, where it has paused.
        self._told = NOTHING_TOLD
        self._paused_at = NOTHING_TOLD  # as kernels have it
        self._moments: list[Moment] = []  # that have been written
        self._end_overwritten = False  # by the state at the first moment: `low_memory`
        self._moment_now = 0.0
        size = len(arrays.sums)
        self._done, self._at_end = np.zeros(size), np.zeros(size)
        tally, pistons = arrays.extra_tally, named(arrays.wall_rows, "walls").piston
        states = tally.piston_states(self._done)
        states.displacement, states.speed = pistons.displacement[tally.pistons], pistons.speed[tally.pistons]
        # Times and numbers of collisions at which a run will stop.
        self._requested: list[tuple[float, float]] = []
        self._last_collisions = 0.0  # of the last window
        self._times: NDArray[np.float64] | None = None  # of all collisions in the present window, in order
        self._burst = 1  # windows of a GPU that went well one after another
        self._counted = math.nan  # beginning of the window that the statistics have counted
        # The present window has just been run, and what was written down in it is new.
        self.fresh: bool = False

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
        return self._completed and (self._paused or self.begin < self.now < self.end)

    @property
    def moment(self) -> float | None:
        """The present time since the window's beginning [time], as kernels have it; None at the beginning."""
        if self._completed and self.now == self.end:
            return float(self.arrays.scale.window)
        return self._moment_now if self.inside else None

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
        if inside:
            self._compute_moments([self._moment_now])
            self._done += sums - self.sums

    def set_forces(self, forces: ForceSteps, within: tuple[k.CompiledForce, ...]) -> None:
        """Set other forces, and what is compiled of those that act within windows, at a window's beginning."""
        self.forces = self.runner.forces = forces
        if within or self.arrays.uses.forces:
            kept = self._done[: self.arrays.extra_tally.first_force]
            self.arrays.set_forces(within)
            self._done = np.append(kept, np.zeros(self.arrays.columns - len(kept)))

    @property
    def gains(self) -> NDArray[np.float64]:
        """Energy that each of the forces within windows gave, in parts [energy], shape (forces, LEVELS)."""
        return self.arrays.extra_tally.gains(self.sums)

    def add_flow_work(self, work: float) -> None:
        """Enter what a force did to energies in the frames of rows of tiles."""
        self._done[TALLY.flow_work] += work

    @property
    def sums(self) -> NDArray[np.float64]:
        """Sums over all windows so far, to the present time; columns of `tally`."""
        in_window = self._sums_in_window()
        return self._done.copy() if in_window is None else self._done + in_window

    def sum(self, column: int) -> float:
        """One of `sums`, by its column."""
        in_window = self._sums_in_window()
        before: float = self._done.item(column)
        return before if in_window is None else before + in_window.item(column)

    def _sums_in_window(self) -> NDArray[np.float64] | None:
        """Sums from the beginning of the present window to the present time; None where that is its beginning."""
        if self._completed and self.now == self.end:
            return self._at_end
        if self.now == self.begin and not self._paused:
            return None
        return self._sums_to(self._moment_now)

    @property
    def part(self) -> int:
        """Part of the arrays that holds the present state."""
        part = int(self.arrays.grid.part)
        if self._completed and self.now == self.end:
            return 1 - part
        if self.now == self.begin and not self._paused:
            return part
        m = self.snapshot_at(self._moment_now)
        return 1 - part if self._end_overwritten else k.SNAPSHOT + m

    @property
    def time_origin(self) -> float:
        """Origin of the times in the present state [time]."""
        return self.end if self._completed and self.now == self.end else self.begin

    def commit(self) -> None:
        """Begin a window at the present time, which is no moment within one."""
        part = self.part
        self._done = self.sums
        if self._completed and self.now == self.end:
            self.arrays.clock.overhang = self._most(TOTAL.overhang)
        self.arrays.grid.part = part
        self._begin_at(self.now)

    def commit_at(self, time: float) -> None:
        """Begin a window at the time of a state that is loaded into the arrays."""
        self._done = self.sums
        self.arrays.clock.overhang = 0.0
        self._begin_at(time)

    def _begin_at(self, time: float) -> None:
        """Begin a window at a time [time]; its end is not planned yet."""
        if self.forces is not None:
            self.forces.begin_window(self.moment)
        self.now = self.arrays.clock.begin = self.arrays.clock.end = time
        self._times, self._told = None, NOTHING_TOLD
        self._completed = self._ready = self._paused = self._end_overwritten = self.fresh = False
        self._moments, self._moment_now = [], 0.0

    def snapshot(self) -> dict[str, NDArray[np.float64]]:
        """State of the windows, between two of them or within one."""
        a = self.arrays
        length = [
            self.begin,
            self.end,
            self.now,
            self._moment_now,
            float(self._ready or self._completed),
            self.fastest,
        ]
        return {"window": np.array([*length, a.clock.square_unit]), "sums": self._done.copy()}

    def restore(self, found: dict[str, NDArray[np.float64]], watching: int = 0) -> None:
        """Restore what `snapshot` gave."""
        a = self.arrays
        begin, end, now, moment, ready, a.clock.fastest, a.clock.square_unit = found["window"].tolist()
        self._begin_at(begin)
        if self.forces is not None:
            self.forces.restore(found)
        self._done = found["sums"].copy()
        a.clock.end, self.now, self._moment_now, self._ready = end, now, moment, bool(ready)
        if self._ready:
            self._plan(plans=False)
        if self._ready and self.now > self.begin:
            self._counted = self.begin
            if self.now < self.end:
                a.make_moments()
            self._compute(self._present_moment() if self.now < self.end else [], 1, watching)

    # ------------------------------------------------------------------ length

    def go_on(self, kick: float) -> None:
        """At the end of a window, plan the next one: it ends at `kick` [time] at the latest, when a force acts."""
        a, ended = self.arrays, self._completed and self.now == self.end
        if not ended and (self._completed or self._ready):
            return
        if self.forces is not None:
            self.forces.plan(kick)
        overhang = self._most(TOTAL.overhang) if ended else float(a.clock.overhang)
        if not a.box.is_open and not overhang <= TOO_FAR * a.least_side:
            raise unbounded(self.now)
        if ended:
            self._last_collisions = float(self._at_end[TALLY.collisions])
            self._completed, self._moments, self._moment_now, self._times = False, [], 0.0, None
            self._told = NOTHING_TOLD
        narrow = a.least_side - overhang < LEAST_HALO * a.least_side and not (a.single_tile or a.uses.sheared)
        if narrow:  # halos would be
            self._plan(commits=ended, plans=False)
            a.relist()
            a.clock.overhang = 0.0
        if not ended:
            self.domain.survey(rough=True)
            self.domain.survey(rough=False)
        a.clock.kick = kick
        self._plan(commits=ended and not narrow)
        self._ready = True
        if not self.end > self.begin:
            raise InelasticCollapse(
                f"t = {self.now:.9g}: windows have become too short for the clock, as disks are too fast or collide "
                "too often. Look for walls that crush disks (`ifrdem check` warns of them) or give energy without end, "
                "and for a time that is too large for the speeds"
            )

    def _plan(self, *, commits: bool = False, plans: bool = True) -> None:
        """Have the device plan the window (`plan_window`)."""
        a = self.arrays
        a.sums[:] = self._done
        a.launch(plan_window, int(commits), int(plans))
        self._done = a.sums.copy()

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
        a, (stop, wanted) = self.arrays, until
        self.go_on(kick)
        if self._completed and watching & ~self._recorded:
            # From its beginning, to see what happened in it.
            self._compute(self._present_moment(), 1, watching)
        if self._paused or self._end_overwritten or not self._completed:
            pausing = a.single_tile and not a.on_gpu
            self._requested = [until] if pausing else [until, *next_points()]
            if pausing or (a.on_gpu and math.isfinite(stop)):
                room = a.make_moments()
                moments = [stop - self.begin][:room] if stop < self.end else []
            else:
                moments = self.plan_snapshots(self.now)
            (a.clock.stop, a.clock.wanted), (a.clock.pause, a.clock.pause_after) = until, pause
            if not (pausing or a.on_gpu) and self._nears_count():
                watching, most = watching | k.PAIRS, 1
            if self._end_overwritten:  # what has been written down stays
                watching &= ~self._recorded
            if a.keeps_moments or a.on_gpu or watching or math.isfinite(wanted) or stop >= self.end:
                most = min(most, a.burst, self._burst if a.on_gpu else most)
                self._compute(moments, most, watching, pausing=pausing)
            else:
                self._compute_moments([stop - self.begin])
        if self._paused:
            self._moment_now = self._moments[0].time
            by_count = a.counter.paused == k.BY_COUNT
            self.now = self.begin + self._moment_now if by_count else stop
            return
        count = self._done[TALLY.collisions]
        stopping = self.begin < stop < self.end
        self.now = stop if stopping else self.end
        self._moment_now = stop - self.begin if stopping else self.end - self.begin
        if count + self._at_end[TALLY.collisions] >= wanted:
            reached = self._at_end
            if stopping:
                reached = self._sums_to(self._moment_now)
            if count + reached[TALLY.collisions] >= wanted:
                self._moment_now = self._time_of(int(wanted - count))
                self.now = self.begin + self._moment_now
                self.snapshot_at(self._moment_now)

    def _nears_count(self) -> bool:
        """True if the present window may have a collision of a requested number; makes room for them all."""
        a, done = self.arrays, self._done[TALLY.collisions]
        most = 1.5 * max(float(a.clock.in_window), self._last_collisions) + 100.0
        if not any(done < count <= done + most for _, count in self._requested):
            return False
        room = int(most * a.domain.n_here(int(a.grid.part)) / a.n)
        if a.grid.most_pairs < room:
            a.make_pairs(room)
        return True

    def plan_snapshots(self, begin: float, first: float | None = None) -> list[float]:
        """Requested moments of the present window, after `begin` [time], and the `first` one of all.

        In order, the first ones for which there is room. Of collisions only where their times are known.
        """
        a, length = self.arrays, self.end - self.begin
        found = {time - self.begin for time, _ in self._requested if begin < time < self.end}
        if self._times is not None:
            counts = {
                count - self._done[TALLY.collisions] for _, count in self._requested if math.isfinite(count)
            }
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
        return [self._moment_now] if self.arrays.keeps_moments else []

    def _compute_moments(self, moments: list[float]) -> None:
        """Compute the states at moments of the window; with `low_memory` only that at the first moment.

        The latter overwrites the state at the end of the window: a shorter window is run, which ends at the moment. The
        bits are the same, because they depend on the length of a window only with walls, forces within windows, shear
        and contact times, which `model.rules` refuses.
        """
        a = self.arrays
        if a.keeps_moments:
            self._compute(moments, 1, 0)
            return
        moment, end, at_end = moments[0], self.end, self._at_end
        a.clock.end = self.begin + moment
        self._plan(plans=False)
        a.scale.stored_at = moment
        a.scale.window = a.scale.stored_at + ROUNDING * np.spacing(a.scale.stored_at)
        self._compute([], 1, 0)
        self._moments, self._at_end, self._end_overwritten = [Moment(moment, self._at_end)], at_end, True
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
        if self._times is None:
            self._compute([], 1, k.PAIRS)
        return self._times_of([count])[0]

    def _times_of(self, counts: Sequence[int]) -> list[float]:
        """Times of these collisions, where those of all are known; infinity beyond the last."""
        assert self._times is not None
        return self.domain.comm.nth_smallest(self._times, counts)

    def watched(self, none: bool = False) -> tuple[NDArray[Any], NDArray[Any]]:
        """Events of tracked disks on this rank in the present window, or `none`: rows of `event` and `event_int`.

        Of a window that has paused, those that were not given before.
        """
        real, whole = self.runner.events.rows(none)
        if self._told >= 0.0:
            new = named(real, "event").time > self._told
            real, whole = real[new], whole[new]
        if self._paused:
            self._told = self._paused_at
        return real, whole

    def pairs(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Collisions of two disks here in the present window: rows of `pair_time` and `pair`."""
        return self.runner.pairs.rows()

    def _compute(self, moments: list[float], most: int, watching: int, *, pausing: bool = False) -> None:
        """Run the window to its end, writing moments in it; up to `most` of them.

        When `pausing`, which only a gas in one tile can, to the moment or to so many collisions, and on from there.
        """
        a, runner = self.arrays, self.runner
        resuming = self._paused and pausing
        if self._paused and not pausing:  # the rest of the window, too, which will not be run again
            watching |= self._recorded & k.TRACKED
        self._paused = self._end_overwritten = False
        begin = self.begin
        again = begin == self._counted
        self._recorded = watching | (self._recorded if again else 0)
        a.scale.moment = k.FAR
        a.scale.moment[: len(moments)] = moments
        a.grid.watching = watching
        runner.clear()
        self.fresh |= bool(watching & k.TRACKED)
        alone = a.grid.single_tile = int(a.single_tile)
        if a.uses.sheared:
            a.displace_rows(begin)
        runner.rests = runner.rests and resuming
        a.sums[:] = self._done
        self.domain.run(runner, most, pausing=pausing, resuming=resuming)
        self.statistics.windows -= again
        self._paused = bool(a.counter.paused)
        done = int(a.counter.n_windows)
        self._burst = max(2 * most, self._burst) if done >= most else max(done, 1)
        self.statistics.windows += done
        if not again:
            self.statistics.unverified += int(a.counter.unverified)
            self.statistics.jammed += int(a.counter.jammed)
        runner.collect()
        self._done = a.sums.copy()
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
        self._counted = self.begin
        if begin != self.begin:  # the kernel ran further windows
            self._times = None
        self._at_end = self._tally(k.AT_END)
        moment_time = self._paused_at = float(a.scale.moment[0])
        if begin != self.begin or a.counter.paused == k.BY_COUNT:  # the kernel chose
            if begin != self.begin and a.counter.paused != k.BY_COUNT:
                moment_time = float(a.clock.stop) - self.begin if moment_time < k.FAR else k.FAR
            moments = [moment_time] if moment_time < k.FAR else []
        self._moments = [Moment(each, self._tally(k.AT_MOMENT + m)) for m, each in enumerate(moments)]
        if watching & k.PAIRS:
            self._times = None if pausing else np.sort(runner.pairs.rows()[0].astype(np.float64))
        self._completed, self._ready = True, False

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
