"""Windows from the host: how long they are, tiles that have to be run again, and where a run stops within one.

Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, InelasticCollapse
from ..kernels import layout as k
from ..kernels.columns import EVENT, EVENT_INT, TALLY, TOTAL, named
from ..kernels.events import TOO_FAR
from ..kernels.readout import interpolate_snapshot
from ..kernels.walls.pistons import piston_speed
from ..kernels.windows import (
    LEAST_HALO,
    MAX_TRAVEL,
    least_square,
    path_from,
    run_windows,
    survey,
    usual_halo,
    verify,
    window_length,
)
from .arrays import SLACK, DeviceArrays
from .tracking import Statistics

MOST_HALVINGS = 40  # of the window of a sheared gas
# The time of a collision with a number n of a window is looked for within so many collisions of where it is expected:
# five times the scatter of independent ones, and what the rate of a gas that cools or gathers may do besides.
SCATTER, DRIFT = 5.0, 0.005


def leeway(count: float) -> float:
    """Collisions by which those of a window up to a time may differ from what is expected, if that is so many."""
    return SCATTER * math.sqrt(count) + DRIFT * count + 10.0


@dataclass
class Moment:
    """A moment of a window, all times since its beginning: known (`at`), or within an interval, and then not (NaN).

    `sums` are those over the tiles up to `at`, or `begin`.
    """

    begin: float
    until: float
    at: float
    sums: NDArray[np.float64]


def known(time: float) -> Moment:
    """One whose time is known."""
    return Moment(time, time, time, np.zeros(0))


class Windows:
    """The windows of one engine, one after another.

    Attributes
    ----------
    begin, end, now : float
        Of the present window, and the present time in it [time].
    """

    def __init__(self, arrays: DeviceArrays, statistics: Statistics, time: float) -> None:
        self.arrays: DeviceArrays = arrays
        self.domain: Any = arrays.domain
        self.statistics: Statistics = statistics
        self.begin: float = time
        self.end: float = time
        self.now: float = time
        self._completed = False  # the window has been run to its end
        self._surveyed = False
        self._ready = False  # the present window has an end, and has not been run
        # It has been run to the moment that was told; the scratch space holds the rest of it.
        self._paused = False
        self._watching = 0  # what was written down when it was run
        self._moments: list[Moment] = []  # that have been told
        self._moment_now = 0.0
        size = len(arrays.sums)
        self._done, self._at_end = np.zeros(size), np.zeros(size)
        for row, column in self._piston_columns():
            piston = named(arrays.wall_rows[row], "walls").piston
            self._done[[column, column + 1]] = piston.displacement, piston.speed
        # Times and numbers of collisions at which a run will stop.
        self._asked: list[tuple[float, float]] = []
        self._noted = 0  # notes
        self._before: tuple[float, float, float] | None = None  # collisions, length, speed of the last window
        # How far disks are beyond the sides of the tiles that list them, at the beginning.
        self.overhang: float = 0.0
        # Of all collisions in the window that begins at a time: several frames at numbers of collisions may lie in it.
        self._times: tuple[float, NDArray[np.float64]] | None = None
        self._burst = 1  # windows of a GPU that went well one after another
        self._n_ghosts = 0  # ghost records of the tiles that ran last
        self._bad = 0  # tiles that did not pass then
        self._counted = math.nan  # beginning of the window that the statistics have counted
        self._watched: list[tuple[NDArray[Any], NDArray[Any]]] = []
        self.fastest: float = 0.0
        self.rests: bool = False
        # The present window has just been run, and what was written down in it is new.
        self.fresh: bool = False

    # ------------------------------------------------------------------ what it knows

    @property
    def inside(self) -> bool:
        """The present time lies within a window, which has to be kept."""
        return self._completed and (self._paused or self.begin < self.now < self.end)

    @property
    def sleepers(self) -> int:
        """Disks that fell asleep less those that woke."""
        return int(self.sums[TALLY.sleepers])

    @property
    def elastic(self) -> int:
        """Collisions that were elastic for a remedy for collapse."""
        return int(self.sums[TALLY.elastics])

    def switch(self, uses: k.Uses) -> None:
        """Go on with what else is added up, or less: the motion stays the same."""
        inside, sums = self.inside, self.sums
        self.arrays.uses = uses
        if inside:
            self._compute([known(self._moment_now)], 1, 0)
            self._done += sums - self.sums

    def add_flow_work(self, work: float) -> None:
        """Enter what a force did to energies in the frames of rows of tiles."""
        self._done[TALLY.flow_work] += work

    @property
    def sums(self) -> NDArray[np.float64]:
        """Sums over all windows so far, to the present time; columns of `tally`."""
        if self._completed and self.now == self.end:
            return self._done + self._at_end
        if self.now == self.begin and not self._paused:
            return self._done.copy()
        return self._done + self._sums_to(self._moment_now)

    @property
    def part(self) -> int:
        """Part of the arrays that holds the present state."""
        part = int(self.arrays.grid.part)
        if self._completed and self.now == self.end:
            return 1 - part
        if self.now == self.begin and not self._paused:
            return part
        return k.SNAPSHOT + self.snapshot_at(self._moment_now)

    @property
    def time_origin(self) -> float:
        """From when on times that the present state holds count [time]."""
        return self.end if self._completed and self.now == self.end else self.begin

    def commit(self) -> None:
        """Have a window begin at the present time, which is no moment within one."""
        part = self.part
        self._done = self.sums
        if self._completed and self.now == self.end:
            self.overhang = self._most(TOTAL.overhang)
        self.arrays.grid.part = part
        self.begin = self.end = self.now
        self._forget()

    def commit_at(self, time: float) -> None:
        """Have a window begin at a time at which a state is laid into the arrays anew."""
        self._done = self.sums
        self.overhang = 0.0
        self.begin = self.end = self.now = time
        self._forget()

    def _forget(self) -> None:
        self._times = None
        self._completed = self._surveyed = self._ready = self._paused = False
        self._moments, self._before = [], None
        self._moment_now = 0.0

    def snapshot(self) -> dict[str, NDArray[np.float64]]:
        """All that it knows, between windows or within one."""
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

    def put_back(self, found: dict[str, NDArray[np.float64]], watching: int = 0) -> None:
        """Go on from what `snapshot` gave."""
        a = self.arrays
        self._forget()
        (
            self.begin, self.end, self.now, self._moment_now, ready, self.fastest, a.clock.square_unit,
        ) = found["window"].tolist()  # fmt: skip
        self._ready = bool(ready)
        self._done = found["sums"].copy()
        if self._ready and self.now > self.begin:
            self._counted = self.begin
            if self.now < self.end:
                a.make_moments()
            self._compute([known(self._moment_now)] if self.now < self.end else [], 1, watching)

    # ------------------------------------------------------------------ length

    def plan(self, kick: float) -> None:
        """Set the end of the window that begins now: at `kick` [time] at the latest, when a force acts."""
        a = self.arrays
        if not self._surveyed:
            a.clock.square_unit = 1.0
            self._survey()
            a.clock.square_unit = square_unit(self._most(TOTAL.max_speed_sq))
            self._survey()
            self._surveyed = True
        fastest2 = self._most(TOTAL.max_speed_sq)
        mean_square = self._tally(k.AT_END)[TALLY.squares] * float(a.clock.square_unit) / max(a.n, 1)
        gx, gy = float(a.scale.gx), float(a.scale.gy)
        pull = math.sqrt(gx * gx + gy * gy)  # as kernels plan it, to the last bit
        wall_speed = a.clock.wall_speed + self._fastest_piston()
        length = window_length(mean_square, fastest2, a.clock.path, a.clock.tile_side, pull, wall_speed)
        length = min(length, float(a.clock.longest))
        a.clock.square_unit = square_unit(max(fastest2, least_square(pull, length, wall_speed)))
        a.clock.speed = math.sqrt(mean_square)
        if a.uses.sheared:  # rows of tiles move against each other
            most = math.sqrt(fastest2) + 2.0 * abs(float(a.scale.drift))
            length = min(length, MAX_TRAVEL * float(a.clock.tile_side) / most)
        self.begin = self.now
        self.end = min(self.begin + length, kick)
        self.fastest = math.sqrt(fastest2)
        if not self.end > self.begin:
            raise InelasticCollapse(
                f"t = {self.now:.9g}: windows have become too short for the clock, as disks are too fast or collide "
                "too often. Look for walls that crush disks (`ifrdem check` warns of them) or give energy without end, "
                "and for a time that is too large for the speeds"
            )

    def _piston_columns(self) -> Iterator[tuple[int, int]]:
        """Row of each piston among the pieces of walls, and the column of `sums` with its displacement."""
        a = self.arrays
        columns = named(a.wall_rows, "walls").piston.sums[a.pistons].astype(np.int64)
        return zip(a.pistons, TALLY.width + columns, strict=True)

    def _fastest_piston(self) -> float:
        """The largest `piston_speed` where a window begins, as kernels have it, to the last bit; 0 without pistons."""
        a, found = self.arrays, 0.0
        gx, gy = float(a.scale.gx), float(a.scale.gy)
        for row, column in self._piston_columns():
            wall = named(a.wall_rows[row], "walls")
            push = wall.piston.push + (gx * wall.motion.x + gy * wall.motion.y)
            state = self._done[column : column + 2].tolist()
            found = max(found, piston_speed(*state, push, float(wall.piston.rate), float(a.clock.path)))
        return found

    def _survey(self) -> None:
        """Look for the fastest disk, and add up squares of speeds."""
        self.arrays.launch(survey)

    def go_on(self, kick: float) -> None:
        """At the end of a window, begin the next one."""
        if self._completed and self.now == self.end:
            self._done += self._at_end
            self.arrays.grid.part = 1 - self.arrays.grid.part
            self._completed, self._surveyed, self._moments, self._moment_now = False, True, [], 0.0
            self._times = None
            a = self.arrays
            self._before = self._at_end[TALLY.collisions], self.end - self.begin, float(a.clock.speed)
            self.overhang = self._most(TOTAL.overhang)
            a.clock.path = path_from(
                a.clock.path, a.clock.free_path, a.clock.in_window,
                a.clock.speed * (self.end - self.begin), self._at_end[TALLY.collisions],
            )  # fmt: skip
        if not self._completed and not self._ready:
            if not self.arrays.box.is_open and not self.overhang <= TOO_FAR * self._least_side():
                raise _unbounded(self.now)
            self._list_anew()
            self.plan(kick)
            self._ready = True

    def _list_anew(self) -> None:
        """List disks anew where some are so far beyond their tiles that halos would be too narrow."""
        a = self.arrays
        if not a.single_tile and not a.uses.sheared and self._widest_halo() < LEAST_HALO * self._least_side():
            a.list_anew()
            self.overhang = 0.0

    # ------------------------------------------------------------------ running

    def run(
        self,
        until: tuple[float, float],
        kick: float,
        pause: tuple[float, float],
        *,
        most: int,
        watching: int,
        ahead: Callable[[], Iterable[tuple[float, float]]],
    ) -> None:
        """Go on `until` a time or so many collisions in all, whatever is first, or to the end of a window.

        The first one that ends at or after a `pause`, of the same kind, or the last of `most` windows. `ahead` gives
        those to which later calls will go; what lies in the same window is told with it.
        """
        a, (stop, wanted) = self.arrays, until
        self.go_on(kick)
        if self._completed and watching and self._watching != watching:
            # From its beginning, to see what happened in it.
            self._compute([known(self._moment_now)], 1, watching)
        if self._paused or not self._completed:
            pausing = a.single_tile and not a.on_gpu and watching != k.TRACKED
            if pausing or (a.on_gpu and math.isfinite(stop)):
                a.make_moments()
                moments = [known(stop - self.begin)] if stop < self.end else []
            else:
                self._asked = [until, *ahead()]
                moments = self.plan_snapshots(self.now)
            (a.clock.stop, a.clock.wanted), (a.clock.pause, a.clock.pause_after) = until, pause
            a.clock.kick = kick
            self._compute(
                moments, min(most, a.burst, self._burst if a.on_gpu else most), watching, pausing=pausing
            )
        if self._paused:
            self._moment_now = self._moments[0].at
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

    def plan_snapshots(self, begin: float, first: float | None = None) -> list[Moment]:
        """Moments of the present window, after `begin` [time], that have been asked for, and the `first` one of all.

        In order, the first ones for which there is room. Of a collision the time is known, or is expected after the
        last window's rate and the change of the mean speed since: what falls out of that is found by another run.
        """
        a, length = self.arrays, self.end - self.begin
        found = [
            known(time - self.begin) for time in {time for time, _ in self._asked} if begin < time < self.end
        ]
        notes = 0.0
        wanted = sorted(
            {count - self._done[TALLY.collisions] for _, count in self._asked if math.isfinite(count)}
        )
        if self._times is not None and self._times[0] == self.begin:
            times = [self._nth(self._times[1], int(count)) for count in wanted if count >= 1]
            found += [known(time) for time in times if begin - self.begin < time < length]
        elif (
            self._before is not None
            and min(self._before[0], self._before[2], float(a.clock.speed)) > 0.0
            and not (a.on_gpu or a.uses.rests or a.uses.pistons)
        ):
            collisions, lasted, speed = self._before
            now = float(a.clock.speed)
            growth = math.log(now / speed) / lasted
            rate = 2.0 * now / (now + speed) * collisions / lasted

            def expected(count: float) -> float:
                time = max(count, 0.0) / rate
                for _ in range(3):
                    time = max(count, 0.0) / rate / max(1.0 + 0.5 * growth * time, 0.1)
                return time

            for count in wanted:
                since = expected(count - leeway(count)) if count >= 1 else length
                if since < length:
                    since = float(a.real(since))
                    found.append(Moment(since, expected(count + leeway(count)), math.nan, np.zeros(0)))
                    notes = 4.0 * leeway(1.2 * collisions)  # of two disks of each collision
        found.sort(key=lambda each: each.begin)
        if first is not None:  # it comes first where there is no room for all
            found = [known(first), *(each for each in found if each.begin > first)]
        return found[: a.make_moments(len(found), math.ceil(notes))] if found else []

    def snapshot_at(self, moment: float) -> int:
        """See to it that the state at a moment of the window is told: as which."""
        for m, each in enumerate(self._moments):
            if each.at == moment:
                return m
        for m, each in enumerate(self._moments):
            if math.isnan(each.at) and each.begin <= moment <= each.until:
                a = self.arrays
                a.launch(interpolate_snapshot, m, moment, self._noted, a.domain.n_here(k.SNAPSHOT))
                a.domain.share()
                each.at, each.sums = moment, self._tally(k.AT_MOMENT + m)
                return m
        kept = self._watched, self.fresh, self._watching
        self._compute(self.plan_snapshots(self.begin + moment, moment), 1, 0)
        self._watched, self.fresh, self._watching = kept
        return 0

    def _sums_to(self, moment: float) -> NDArray[np.float64]:
        """Sums over the tiles from the window's beginning to a moment of it."""
        m = self.snapshot_at(moment)
        return self._moments[m].sums

    def _time_of(self, count: int) -> float:
        """Time of collision `count` = 1, 2, ... of the window, since its beginning."""
        if count <= 0:
            return 0.0
        for each in self._moments:
            if math.isnan(each.at) and count > each.sums[TALLY.collisions]:
                times = self._times_of_notes()
                time = self._nth(times[times > each.begin], count - int(each.sums[TALLY.collisions]))
                if time <= each.until:
                    return time
        if self._times is None or self._times[0] != self.begin:
            kept = self._watched, self.fresh, self._watching
            self._compute([], 1, k.PAIRS)
            self._times = (
                self.begin,
                named(self.watched()[0], "event").time.copy(),
            )  # those of this rank
            self._watched, self.fresh, self._watching = kept
            self.arrays.events(0)
        return self._nth(self._times[1], count)

    def _nth(self, times: NDArray[np.float64], count: int) -> float:
        """The time with number `count` = 1, 2, ...; infinity beyond the last."""
        return float(np.partition(times, count - 1)[count - 1]) if count <= len(times) else math.inf

    def _times_of_notes(self) -> NDArray[np.float64]:
        """Times of collisions that were noted."""
        a, n = self.arrays, min(self._noted, int(self.arrays.grid.notes))
        note = named(a.note[:n], "note")
        latest = np.arange(n) >= named(a.tile.to_numpy(), "tile").noted[note.tile]
        return a.note_at[:n][latest & (note.counts == 1)]

    def watched(self, none: bool = False) -> tuple[NDArray[Any], NDArray[Any]]:
        """Collisions written down here in the present window, or `none`: rows of `event` and `event_int`, unordered."""
        if none or not self._watched:
            return np.zeros((0, EVENT.width)), np.zeros((0, EVENT_INT.width), dtype=np.int32)
        real, whole = zip(*self._watched, strict=True)
        return np.concatenate(real), np.concatenate(whole)

    def _compute(self, moments: list[Moment], most: int, watching: int, *, pausing: bool = False) -> None:
        """Run the window to its end, telling moments in it; up to `most` of them.

        When `pausing`, which only a gas in one tile can, to the moment or to so many collisions, and on from there.
        """
        a = self.arrays
        resuming = self._paused and pausing
        self._paused = False
        if watching or self.begin != self._counted:
            self._watching = watching
        begin, end = self.begin, self.end
        a.clock.begin, a.clock.end = begin, end
        a.scale.window = end - begin
        times = a.scale.moment
        times.begin = times.until = k.FAR
        for m, each in enumerate(moments):
            times.begin[m], times.until[m] = each.begin, each.until
        a.grid.watching = watching
        if watching:
            self._watched = []
            self.fresh = True
        alone = a.grid.single_tile = int(a.single_tile)
        if a.uses.sheared:
            a.displace_rows(begin)
        if not alone:
            self._set_halos()
        self.rests = self.rests and resuming
        self._launch(1 if alone else a.tiles, most, pausing=pausing, resuming=resuming)
        again = bool(begin == self._counted)
        self.statistics.windows -= again
        self._paused = bool(a.counter.paused)
        done = int(a.counter.n_windows)
        self._burst = max(2 * most, self._burst) if done >= most else max(done, 1)
        self.statistics.windows += done
        if not again:
            self.statistics.unjudged += int(a.counter.unjudged)
            self.statistics.jammed += int(a.counter.jammed)
        self._collect(watching)
        self._done = a.sums.copy()
        self.begin, self.end = float(a.clock.begin), float(a.clock.end)
        if not alone:
            if self.begin != begin:
                self.overhang = self._least_side() - float(a.scale.most_halo)
            kept = replace(self.statistics)
            halvings = 0
            while True:
                try:
                    self._verify(watching)
                    break
                except _TooLong:
                    halvings += 1
                    if halvings > MOST_HALVINGS:
                        raise EngineError(
                            f"t = {begin:.9g}: tiles of a sheared gas are too small for what happens in it; please "
                            "report this with the case file and seed"
                        ) from None
                    self._shorten(watching)
            if again:
                vars(self.statistics).update(vars(kept))
        self._counted = self.begin
        self._at_end = self._tally(k.AT_END)
        told = float(a.scale.moment.begin[0])
        if begin != self.begin or a.counter.paused == k.BY_COUNT:  # the kernel chose
            if begin != self.begin and a.counter.paused != k.BY_COUNT:
                told = float(a.clock.stop) - self.begin if told < k.FAR else k.FAR
            moments = [known(told)] if told < k.FAR else []
        noting = any(math.isnan(each.at) for each in moments)
        if noting and not self._agreed(self._noted <= a.grid.notes):  # notes for which there was no room
            moments = [replace(each, until=-math.inf) for each in moments]
        for m, each in enumerate(moments):
            each.sums = self._tally(k.AT_MOMENT + m)
        self._moments = moments
        self._completed, self._ready = True, False

    def _agreed(self, well: bool) -> bool:
        """True if this holds: on all ranks, if there are several."""
        return well

    def _shorten(self, watching: int) -> None:
        """Run half of the window: what a sheared gas does whose tiles are too small for all of it."""
        a = self.arrays
        self.end = self.begin + 0.5 * (self.end - self.begin)
        a.clock.end = self.end
        a.scale.window = self.end - self.begin
        if watching:
            self._watched = []
        self.statistics.in_order += 1
        self._set_halos()
        self._launch(a.tiles, 1)
        self._collect(watching)

    def _tally(self, when: int) -> NDArray[np.float64]:
        """Sums over the tiles, one after another: the same for any number of threads."""
        first = TOTAL.width + when * self.arrays.columns
        return self.arrays.total[first : first + self.arrays.columns].copy()

    def _most(self, column: int) -> float:
        """The largest of all tiles."""
        return float(self.arrays.total[column])

    def _launch(
        self, tiles: int, most: int, again: int = 0, *, pausing: bool = False, resuming: bool = False
    ) -> None:
        """Run the windows of all tiles, or `again` of the listed ones; with more room where that was not enough."""
        a = self.arrays
        part, clock, told = int(a.grid.part), a.clock.copy(), a.scale.moment.copy()
        while True:
            a.counter.array[:] = 0
            a.counter.again, a.counter.pausing, a.counter.resuming = again, pausing, resuming
            a.counter.resting = int(resuming and self.rests)
            if again:
                a.counter.n_ghosts, a.counter.n_noted = self._n_ghosts, self._noted
            a.sums[:] = self._done  # one window after another, so that sums do not depend on launches
            alone = bool(a.grid.single_tile)
            with a.sent() as launch:
                for _ in range(1 if alone else most):
                    for first in range(0, tiles, a.batch):
                        launch(run_windows, first, min(first + a.batch, tiles), most)
                    if not alone:
                        self._check(launch)
            self._n_ghosts = int(a.counter.n_ghosts)
            noted = int(a.counter.n_noted)
            full, needed = int(a.counter.full), int(a.counter.needed)
            if a.counter.stalled == 2:
                raise _unbounded(float(a.clock.begin))
            if a.counter.stalled:
                raise InelasticCollapse(
                    f"t = {float(a.clock.begin):.9g} to {float(a.clock.end):.9g}: collisions pile up without end in a "
                    "window (inelastic collapse)"
                )
            self._bad = int(a.counter.n_bad)
            if not full:
                self._noted = noted
                self.rests |= bool(a.counter.resting)
                return
            if a.counter.n_windows > 1:
                # Windows before this one are good: go on from here.
                self._done = a.sums.copy()
                self.statistics.windows += int(a.counter.n_windows) - 1
                clock = a.clock.copy()
                part = int(a.grid.part)
                told.begin = told.until = k.FAR
                if clock.stop < clock.end:
                    told.begin[0] = told.until[0] = clock.stop - clock.begin
            resuming = False  # from the beginning of the window
            a.clock.array[:], a.grid.part, a.scale.moment.array[:] = clock.array, part, told.array
            lane_slots, cells, bins, items = self._room()
            if full & k.FULL_GHOSTS:
                # Threads of a CPU have stopped before the other tiles, which will have as many.
                ran = tiles if a.on_gpu else max(int(a.counter.next_tile - a.grid.lanes), 1)
                a.make_ghosts(int(SLACK * self._n_ghosts * max(tiles / ran, 1.0)) + 64)
                if again:
                    raise _Again
            if full & k.FULL_WATCHED:
                a.events(2 * int(a.counter.n_watched) + 64)
            if full & (k.FULL_SLOTS | k.FULL_CELLS | k.FULL_WALLS):
                grown = int(SLACK * needed) + 16
                if full & k.FULL_SLOTS:
                    lane_slots = max(lane_slots, min(grown, a.n if a.grid.single_tile else 9 * a.n))
                    bins = 1 << max(lane_slots - 1, 1).bit_length()
                if full & k.FULL_CELLS:
                    cells = max(cells, grown)
                if full & k.FULL_WALLS:
                    items = max(items, grown)
                a.scratch(lane_slots, cells, bins, items)

    def _room(self) -> tuple[int, int, int, int]:
        """Slots for disks, cells, bins and walls of a lane."""
        grid = self.arrays.grid
        return int(grid.lane_slots), int(grid.cells), int(grid.bins), int(grid.items)

    def _check(self, launch: Callable[..., Any]) -> None:
        """Verify the tiles that have just run."""
        launch(verify)

    def _collect(self, watching: int) -> None:
        a = self.arrays
        if watching and (count := int(a.counter.n_watched)):
            self._watched.append((a.event.to_numpy()[:count], a.event_int.to_numpy()[:count]))

    # ------------------------------------------------------------------ tiles

    def _set_halos(self) -> None:
        """Halos as wide as the fastest disk may make necessary, and for who hits whom in chains."""
        a = self.arrays
        window = self.end - self.begin
        pull = float(np.hypot(a.scale.gx, a.scale.gy))
        drift = abs(float(a.scale.drift)) * window
        halo = usual_halo(float(a.scale.chain), self.fastest, pull, float(a.clock.wall_speed), window)
        a.scale.least_side = self._least_side()
        a.scale.usual_halo, a.scale.most_halo = halo + drift, self._widest_halo()

    def _least_side(self) -> float:
        """Beyond it around a tile, the tiles around it would not have all disks."""
        sides = [float(np.diff(edge).min()) for edge in self.arrays.edges]
        if self.arrays.uses.sheared:
            sides[0] /= 2.0  # rows above and below lie askew by up to half a tile
        return min(sides)

    def _widest_halo(self) -> float:
        """The same, of disks that have left the tiles that list them."""
        return self._least_side() - self.overhang

    def _verify(self, watching: int) -> None:
        """Run tiles again, with wider halos, until all are good; at last the whole box by one thread."""
        a = self.arrays
        most = float(a.scale.most_halo)
        bad = 0
        while True:
            count = int(a.counter.n_bad)
            reach = a.widest + self._most(TOTAL.excursion) + self._most(TOTAL.max_displacement)
            if a.uses.sheared:
                reach += abs(float(a.scale.drift)) * (self.end - self.begin)
            if count == 0 and reach <= most:
                break
            bad += count
            if reach > most or a.counter.stuck:
                self._whole_box(watching)
                break
            if watching:
                self._drop_watched(a.listed.to_numpy()[: self._bad])
            self._run_again(count)
            self._collect(watching)
        self.statistics.run_again += bad

    def _run_again(self, count: int) -> None:
        """Run the listed tiles again; all of them, with the halos that they have, where ghost records did not fit."""
        a = self.arrays
        while True:
            try:
                return self._launch(count, 1, again=1)
            except _Again:
                self._watched, self._n_ghosts, count = [], 0, a.tiles
                a.listed.from_numpy(np.arange(a.tiles, dtype=np.int32))

    def _drop_watched(self, tiles: NDArray[np.int32]) -> None:
        self._watched = [
            (real[keep], whole[keep])
            for real, whole in self._watched
            for keep in [~np.isin(named(whole, "event_int").tile, tiles)]
        ]

    def _whole_box(self, watching: int) -> None:
        """The window by one thread, in order: what no halo is wide enough for."""
        a = self.arrays
        if a.uses.sheared:
            raise _TooLong
        self.statistics.in_order += 1
        a.grid.single_tile = 1
        room = self._room()
        lanes = int(a.grid.lanes)
        a.grid.lanes = 1
        if watching:
            self._watched = []
        self._launch(1, 1)
        self._collect(watching)
        a.grid.lanes = lanes
        a.scratch(*room)
        a.grid.single_tile = 0


class _TooLong(Exception):
    """No halo is wide enough for the window of a sheared gas, whose box is none that one thread could run in order."""


class _Again(Exception):
    """Ghost records did not fit: all tiles have to be run again."""


def _unbounded(time: float) -> EngineError:
    return EngineError(
        f"t = {time:.9g}: a collision gave a disk an energy beyond all bounds: "
        "it would cross the box a million times before anything else happens. The law adds energy"
    )


def square_unit(fastest2: float) -> float:
    """As `kernels.windows.square_unit`."""
    exponent = max(int(np.float64(fastest2).view(np.int64)) >> 52, 21) - 20
    return float(np.int64(int(exponent) << 52).view(np.float64))
