"""One epoch from its opening to its end, in each of the three ways; `engine.py` tells what for.

Imports the kernels, and Taichi with them: import this module only after `backend.start`.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, InelasticCollapse
from ..kernels.epochs import epochs_by_one_thread
from ..kernels.joining import join_tiles
from ..kernels.layout import (
    AFFECTED_ROW,
    BEGAN,
    BEGIN,
    CELL_Y,
    CHANGED_ROW,
    COLLISIONS_LEFT,
    DURATION,
    EARLIEST,
    END,
    FAR,
    FASTEST,
    GX,
    HORIZON,
    LOG_FULL,
    MEAN_SQUARE,
    MOST_NEIGHBOURS,
    N_ELASTIC,
    N_ELASTIC_TOTAL,
    N_EPOCHS,
    N_LOG,
    N_ROUNDS,
    N_STANDING,
    N_TOTAL,
    N_UNDONE,
    N_VIOLATIONS,
    N_WALL_HITS,
    N_WALLS_TOTAL,
    NOW,
    PAUSE_AFTER,
    PAUSE_AT,
    PLANNED,
    REACH,
    RESTING,
    ROUND,
    SHEAR,
    TIME_END,
    WALL_SPEED,
    WINDOW,
)
from ..kernels.levels import epoch_length, speed_cap
from ..kernels.opening import clear_all, extend_fast, list_disks, list_tiles
from ..kernels.passing import times_of_collisions
from ..kernels.rounds import cut, earliest_event, one_round, rounds_by_one_thread
from ..kernels.shear import rows_apart
from ..kernels.sort import settle
from ..kernels.tiles import run_in_order, run_tiles
from ..kernels.totals import totals
from .arrays import DeviceArrays
from .tracking import Statistics

LAUNCH_SECONDS = 0.2  # how long one launch of whole epochs should take, to see to progress and interrupts
# Of the collisions in a window, how many undone ones make windows shorter or longer, and how short they get at most.
MOST_UNDONE, LEAST_UNDONE, SHORTEST_WINDOW = 0.04, 0.01, 1.0 / 1024.0
# Windows this short cost tiles more than they gain by running at once: so many epochs are then left to one thread.
NARROW_WINDOW, EPOCHS_IN_ORDER = 1.0 / 8.0, 16
FEW = 4096  # up to so many active disks, one thread of a CPU is faster than several
MOST_ROUNDS = 2000  # rounds of a window after which the epoch is cut at its earliest unprocessed event
MOST_LOG = 4  # records for each disk up to which the log grows; beyond, epochs get shorter
LEAST_GAIN = 1e-9  # an epoch that covers no more than this part of its planned length gains no time


@dataclass(frozen=True)
class Outcome:
    """What one launch or epoch did.

    Attributes
    ----------
    time : time at its end [time]
    began : when its last epoch began [time]
    gained : time that the last epoch covers [time]
    planned : time that it was to cover [time]
    collisions : collisions of all its epochs
    fastest : largest speed at the beginning of the last epoch [length/time]
    wall_hits : collisions with walls
    still : whether nothing moves, and nothing will
    """

    time: float
    began: float
    gained: float
    planned: float
    collisions: int
    fastest: float
    wall_hits: int = 0
    still: bool = False

    @property
    def stalled(self) -> bool:
        """Whether it gained no time."""
        return self.gained < LEAST_GAIN * self.planned


class Epochs:
    """Processes the epochs of one engine.

    Parameters
    ----------
    arrays : DeviceArrays
    statistics : Statistics
        Counts what happens.
    order : {"alone", "tiles", "rounds"}
    windows : int, optional
        Windows of an epoch; by default as many as the collisions that must be undone ask for.
    arch : {"cpu", "cuda"}
        One thread of a GPU is slow: there all rounds run in parallel.
    """

    def __init__(
        self,
        arrays: DeviceArrays,
        statistics: Statistics,
        order: str,
        windows: int | None = None,
        arch: str = "cpu",
    ) -> None:
        self.arrays, self.statistics, self.order = arrays, statistics, order
        # Tiles run ahead of each other by one window, this part of an epoch; in clusters a small one.
        self._window = 1.0 / (windows or 1)
        self._adapt = windows is None
        self._few = FEW if arch == "cpu" else 0
        self._settled = False
        self._in_order = 0  # so many epochs more are left to one thread
        self._burst = 1  # epochs of the next launch, where one thread runs them
        self.log_growth = 2  # a log that was too short gets longer by this factor
        self._log_growths = 0

    def settle(self, now: float, *, telling: bool = False) -> float:
        """Fly and sort the disks to the end of the epoch before, at time `now`; returns the largest speed.

        If `telling`, `arrays.sums` get what `kernels/totals.py` gives, unless all had settled before.
        """
        if not self._settled:
            self.arrays.launch(settle, int(telling))
            self.arrays.scale[DURATION] = 0.0
            self._settled = True
        if self.arrays.uses.sheared:
            self.arrays.displace_rows(now)
        self._watchdog(now)
        return float(self.arrays.limit[FASTEST])

    def totals(self, now: float) -> NDArray[np.float64]:
        """Sums over all disks at time `now`, shape (TOTALS,); see `kernels/totals.py`. They settle."""
        if self._settled:
            self.settle(now)
            self.arrays.launch(totals)
        else:
            self.settle(now, telling=True)
        # Block by block along each column: one order for any number of threads.
        found: NDArray[np.float64] = np.ascontiguousarray(self.arrays.sums.T).sum(axis=1)
        return found

    def unsettle(self) -> None:
        """Take note that something has moved, or moves otherwise: the next settling has work to do."""
        self._settled = False

    def fly(self, duration: float) -> None:
        """Let the disks fly on, all by the same time, when they settle."""
        self.arrays.scale[DURATION] = duration
        self._settled = False

    def _watchdog(self, now: float) -> None:
        earliest = float(self.arrays.limit[EARLIEST])
        if earliest < FAR:
            raise EngineError(
                f"t = {now + earliest:.9g}: an event before the end of the epoch was left unprocessed "
                "although no disk was active; please report this with the case file and seed"
            )

    # ------------------------------------------------------------------ by one thread

    def run_alone(
        self,
        now: float,
        t_end: float,
        wanted: int | None,
        *,
        most: int | None = None,
        pause_at: float = math.inf,
        pause_after: int | None = None,
    ) -> Outcome:
        """Some epochs (`most` at most) in one launch, to `t_end` or `wanted` more collisions at the latest.

        It pauses where an epoch ends at or after `pause_at` or `pause_after` more collisions.
        """
        a = self.arrays
        self._settled = False
        a.clock[[NOW, TIME_END, PLANNED, PAUSE_AT]] = now, t_end, 0.0, pause_at
        a.total[:] = 0
        a.total[PAUSE_AFTER] = 2**62 if pause_after is None else pause_after
        a.total[COLLISIONS_LEFT] = 2**62 if wanted is None else wanted
        began = time.perf_counter()
        burst = self._burst if most is None else min(self._burst, most)
        while True:
            a.launch(epochs_by_one_thread, burst)
            needed = int(a.counter[MOST_NEIGHBOURS])
            if not needed:
                break
            self.cut(0.0)
            a.lengthen_rows(needed)
        epochs, done, end = int(a.total[N_EPOCHS]), int(a.total[N_TOTAL]), float(a.limit[END])
        elapsed = time.perf_counter() - began
        if epochs == self._burst:
            self._burst = int(min(max(self._burst * LAUNCH_SECONDS / elapsed, 1), 4 * self._burst, 1 << 20))
        self.statistics.epochs += epochs
        planned, fastest = float(a.clock[PLANNED]), float(a.limit[FASTEST])
        still = self._still(fastest)
        fastest += self._rows_apart()
        if not still:
            self._watchdog(now)
            self._check_rest(now)
            if a.counter[LOG_FULL]:
                self.statistics.cut_for_log += 1
            elif end < planned and not (wanted is not None and done >= wanted):
                self.statistics.cut_for_speed += 1
        hits = int(a.total[N_WALLS_TOTAL])
        self.statistics.elastic += int(a.total[N_ELASTIC_TOTAL])
        at_end, began = float(a.clock[NOW]), float(a.clock[BEGAN])
        return Outcome(at_end, began, end, planned, done, fastest, hits, still)

    # ------------------------------------------------------------------ in tiles or rounds

    def run(self, now: float, t_end: float, wanted: int | None) -> Outcome:
        """One epoch, to `t_end` or `wanted` more collisions at the latest."""
        a = self.arrays
        fastest = self.settle(now)
        if self._still(fastest):
            return Outcome(now, now, 0.0, 0.0, 0, 0.0, still=True)
        self._settled = False
        a.clock[NOW] = now
        cap = speed_cap(fastest, float(a.limit[MEAN_SQUARE]), a.most_level) + self._rows_apart()
        left = t_end - now
        horizon = min(
            epoch_length(float(a.scale[REACH]), cap, float(a.scale[WALL_SPEED]), self._pull()), left
        )
        while True:
            in_order = self._in_order > 0
            self._list(horizon)
            end = self._one_by_one(horizon, wanted) if in_order else self._windows(horizon)
            needed = int(a.counter[MOST_NEIGHBOURS])
            if not needed and (a.counter[LOG_FULL] != 2 or in_order):
                break
            # A fast disk's list became too long for its row, or the tiles had no room to log their collisions: again,
            # with longer rows or a longer log.
            self.cut(0.0)
            a.launch(clear_all)
            if needed:
                a.lengthen_rows(needed)
                continue
            self.statistics.cut_for_log += 1
            self._log_growths += 1
            if not self._lengthen_log():
                self._in_order = (
                    EPOCHS_IN_ORDER  # a collapse has no end within a tile; one thread can stop at any time
                )
        if not in_order:  # one thread has stopped where it should
            if end < horizon:
                self.cut(end)
            if wanted is not None and self.standing() >= wanted:
                end = self._end_after(wanted)
                self.cut(end)
        self._check_rest(now)
        self.fly(end)
        self.statistics.epochs += 1
        self._in_order -= in_order
        reached = end == horizon and horizon == left
        time_at_end = t_end if reached else now + end
        self.statistics.elastic += int(a.counter[N_ELASTIC])
        fastest += self._rows_apart()
        return Outcome(time_at_end, now, end, horizon, self.standing(), fastest, int(a.counter[N_WALL_HITS]))

    def _pull(self) -> float:
        """Magnitude of gravity."""
        return float(np.hypot(*self.arrays.scale[GX : GX + 2]))

    def _rows_apart(self) -> float:
        """Half of the speed at which a mean flow moves adjacent rows of cells against each other."""
        return rows_apart(float(self.arrays.scale[SHEAR]), float(self.arrays.scale[CELL_Y]))

    def _still(self, fastest: float) -> bool:
        forced = self._pull() != 0.0 or self.arrays.scale[WALL_SPEED] != 0.0 or self.arrays.uses.sheared
        return fastest == 0.0 and not forced

    def _check_rest(self, now: float) -> None:
        if self.arrays.counter[RESTING]:
            raise InelasticCollapse(
                f"t = {now:.9g}: a disk came to rest on a wall, after ever smaller bounces (inelastic collapse); "
                'there is no next collision. With collapse = "tc" and a contact_time, or collapse = "velocity_cutoff" '
                "and a velocity_cutoff, such collisions are elastic, and the run goes on"
            )

    def after_epoch(self, now: float) -> None:
        """Make the log longer if it was too short: only when nobody wants to read it any more."""
        if self.statistics.cut_for_log > self._log_growths:
            if self.arrays.uses.reads_log:
                self.settle(now)  # what walls or the flow did, and when disks collided, is read from the log
            self._log_growths = self.statistics.cut_for_log
            self._lengthen_log()

    def _list(self, horizon: float) -> None:
        a = self.arrays
        a.scale[HORIZON] = horizon
        while True:
            a.launch(list_tiles if self.order == "tiles" else list_disks)
            if not a.counter[MOST_NEIGHBOURS]:
                a.launch(extend_fast)
            needed = int(a.counter[MOST_NEIGHBOURS])
            if needed == 0:
                return
            a.lengthen_rows(needed)
            a.launch(clear_all)

    def _lengthen_log(self) -> bool:
        """Double the log, if that is still reasonable and 32-bit indices reach its end."""
        a = self.arrays
        longer = self.log_growth * a.records
        if self.log_growth == 1 or a.records > MOST_LOG * a.n + 4096 or longer > a.most_records:
            return False
        a.make_log(longer)
        return True

    def _one_by_one(self, horizon: float, wanted: int | None) -> float:
        """The epoch by one thread, to its end, to `wanted` collisions or to the end of the log; returns the end."""
        a, most = self.arrays, 1 << 30 if wanted is None else min(wanted, 1 << 30)
        a.scale[BEGIN], a.scale[WINDOW] = 0.0, horizon
        a.launch(run_in_order, most)
        end = float(a.limit[END])
        self.statistics.in_order += 1
        if a.counter[LOG_FULL]:
            self.statistics.cut_for_log += 1
        elif end < horizon and self.standing() < most:
            self.statistics.cut_for_speed += 1
        return end

    def _windows(self, horizon: float) -> float:
        """Windows of tiles and rounds until no event before the end is left; returns the end."""
        a, counter = self.arrays, self.arrays.counter
        begin, active = 0.0, 0
        while begin < horizon:
            stop = begin + self._window * horizon
            if self._window == 1.0 or stop > horizon * (1.0 - 1e-6):
                stop = horizon
            a.scale[BEGIN], a.scale[WINDOW] = begin, stop
            done, undone = int(counter[N_STANDING]), int(counter[N_UNDONE])
            most_rounds = int(counter[N_ROUNDS]) + MOST_ROUNDS
            everybody = active = a.n
            if self.order == "tiles":
                a.launch(run_tiles)
                if counter[LOG_FULL]:
                    return horizon  # to be done again
                a.launch(join_tiles)
                everybody, active = 0, self._active()
            else:
                self._make_room_for_everybody()
            while active and not counter[LOG_FULL] and counter[N_ROUNDS] < most_rounds:
                if active <= self._few:
                    a.launch(rounds_by_one_thread, everybody, self._few, most_rounds)
                else:
                    a.launch(one_round, everybody)
                everybody, active = 0, self._active()
                if counter[MOST_NEIGHBOURS]:
                    return horizon  # to be done again
            if active:
                break
            begin = stop
            if self._adapt:
                self._adapt_window(int(counter[N_UNDONE]) - undone, int(counter[N_STANDING]) - done)
        self.statistics.rounds += int(counter[N_ROUNDS])
        self.statistics.undone += int(counter[N_UNDONE])
        self.statistics.violations += int(counter[N_VIOLATIONS])
        end = float(a.limit[END])
        if active == 0:
            if end < horizon:
                self.statistics.cut_for_speed += 1
            return end
        if counter[LOG_FULL]:
            self.statistics.cut_for_log += 1
        else:
            self.statistics.cut_for_rounds += 1
            if self._adapt:
                self._window = max(self._window / 4.0, SHORTEST_WINDOW)
        a.launch(earliest_event)
        end = min(end, float(a.limit[EARLIEST]))
        if end < LEAST_GAIN * horizon:
            # All of it is undone, and another such epoch would not come further: collisions without number at one
            # place, which one thread, who undoes none, takes in as many epochs as they need.
            self._in_order = EPOCHS_IN_ORDER
        return end

    def _make_room_for_everybody(self) -> None:
        """See to it that the log has room for a round in which all disks are active: a window's first.

        All may hit a wall in it, with a record each; a collision of two takes one. An empty log gets longer; another
        one counts as full, so that the epoch ends here.
        """
        a = self.arrays
        most = a.n if a.uses.walled else a.n // 2
        if a.counter[N_LOG] + most > a.records:
            if a.counter[N_LOG] == 0:
                a.make_log(most)
            else:
                a.counter[LOG_FULL] = 1

    def _adapt_window(self, undone: int, done: int) -> None:
        """Bound the optimism: shorter windows where much had to be undone, longer ones where little."""
        if undone > MOST_UNDONE * done:
            self._window = max(self._window / 2.0, SHORTEST_WINDOW)
            if self.order == "tiles" and self._window < NARROW_WINDOW:
                self._window, self._in_order = NARROW_WINDOW, EPOCHS_IN_ORDER
        elif undone < LEAST_UNDONE * done:
            self._window = min(self._window * 2.0, 1.0)

    def _active(self) -> int:
        """Disks active in the next round: those that just predicted, and those rolled back, which will."""
        counter = self.arrays.counter
        last = 1 - counter[ROUND] % 2
        return int(counter[CHANGED_ROW : CHANGED_ROW + 2].sum() + counter[AFFECTED_ROW + last])

    # ------------------------------------------------------------------ the log

    def cut(self, end: float) -> None:
        """Undo every collision of the epoch at `end` or later."""
        self.arrays.launch(cut, end)

    def end_after(self, moment: float) -> None:
        """End the epoch that is over, and has not settled, right after a moment of it [time since it began]."""
        elastic = int(self.arrays.counter[N_ELASTIC])
        self.cut(float(np.nextafter(moment, math.inf)))
        self.statistics.elastic -= elastic - int(self.arrays.counter[N_ELASTIC])
        self.fly(moment)

    def standing(self) -> int:
        """Collisions of the epoch that stand."""
        return int(self.arrays.counter[N_STANDING])

    def _end_after(self, count: int) -> float:
        """The end at which exactly the first `count` collisions of the epoch stand (more only in an exact tie)."""
        return (
            0.0
            if count <= 0
            else float(np.nextafter(self.arrays.real(self.time_of_collision(count)), math.inf))
        )

    def time_of_collision(self, count: int) -> float:
        """When collision `count` = 1, 2, ... of the epoch was, of those of two disks that stand, in their order."""
        a = self.arrays
        written = int(a.counter[N_LOG])
        times: NDArray[np.floating] = np.empty(written, dtype=a.real)
        a.launch(times_of_collisions, written, times=times)
        return float(np.partition(times, count - 1)[count - 1])
