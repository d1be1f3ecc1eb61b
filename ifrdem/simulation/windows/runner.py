"""Tiles that run a window: with room for what they need, and again with wider halos until all are good.

Imports the runtime: import this module only after `backend.start`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import EngineError, InelasticCollapse
from ...kernels import layout as k
from ...kernels.columns import TOTAL, named
from ...kernels.compiler.language import to_numpy
from ...kernels.events.events import LEAST_ADVANCE, LONG, LONG_OF_A_DISK, NO_ROW
from ...kernels.windows.blocks import run_dense_tiles, run_windows_by_blocks
from ...kernels.windows.windows import replay, run_windows, run_windows_on_gpu, verify
from .. import backend
from ..measuring.tracking import Statistics
from ..measuring.window_log import WindowLog
from .arrays import SLACK, DeviceArrays

if TYPE_CHECKING:
    from ..steps.force_steps import ForceSteps


class WindowTooLong(Exception):
    """No halo is wide enough for the window of a sheared gas, whose box one thread cannot run in order."""


class _DidNotFit(Exception):
    """Ghost records or trails of tiles that were run again did not fit: all tiles have to be run again."""


class TileRunner:
    """The tiles of a process, which run the window that `arrays.clock` sets.

    `arrays.sums` are those up to its beginning. `Domain` (`arrays.domain`) says which tiles run, and what other ranks
    have to know before and after.

    Attributes
    ----------
    events, pairs : WindowLog
        Collisions of tracked disks, and of all pairs, that tiles have written down in the window.
    n_bad : int
        Tiles of this process, the first ones of `arrays.listed`, that did not pass the last verification.
    n_marked : int
        Those among them that no block of a GPU can run.
    rests : bool
        True if a disk came to rest on a wall.
    stopped_early : bool
        True if a gas in one tile has paused before the requested moment, as a stop was asked for.
    has_trail : bool
        True if tiles know the events of the window that was run last (`replay`).
    """

    def __init__(self, arrays: DeviceArrays, statistics: Statistics) -> None:
        self.arrays: DeviceArrays = arrays
        self.statistics: Statistics = statistics
        self.events, self.pairs = WindowLog("event", "event_int"), WindowLog("pair_time", "pair")
        self.n_bad = 0
        self.forces: ForceSteps | None = None
        self.rests: bool = False
        self.stopped_early: bool = False
        self.has_trail = False
        self._n_ghosts = self._n_trail = 0  # ghost records, and rows of trails, of the tiles that ran last
        self.n_marked = 0
        self._dense = False  # some tiles have more disks than most blocks have room for

    # ------------------------------------------------------------------ which tiles run

    def select(self, tiles: NDArray[np.integer]) -> None:
        """Set the tiles that run next."""
        with self.arrays.written("listed") as (listed,):
            listed[: len(tiles)] = tiles

    def run_all(
        self, most: int = 1, *, again: bool = False, pausing: bool = False, resuming: bool = False
    ) -> None:
        """Run all tiles of this process: up to `most` windows, or this one `again` with the halos that tiles have."""
        a = self.arrays
        while True:
            if again:
                self.clear()
                self._n_ghosts = 0
                with a.written("tile") as (tile,):
                    named(tile, "tile").first_row = NO_ROW
            if again or a.uses.ranks or not (a.on_gpu or a.single_tile):
                self.select(a.costliest_first)
            try:
                return self.launch(len(a.own), most, again=again, pausing=pausing, resuming=resuming)
            except _DidNotFit:
                continue

    def replay(self) -> None:
        """Repeat the window by the trails of its tiles, up to the last requested moment, and write all of these."""
        a = self.arrays
        self.select(a.costliest_first)
        a.counter.array[:] = 0
        a.counter.again = 1  # with the lists and halos that tiles have
        a.launch(replay, len(a.own))
        if a.counter.full:
            raise EngineError(
                f"t = {float(a.clock.begin):.9g}: a window has other disks when it is repeated; please report this"
            )

    def run_bad(self) -> None:
        """Run the bad tiles again with wider halos; all tiles where ghost records or trails did not fit."""
        if not self.n_bad:
            self.arrays.counter.array[:] = 0
            return
        try:
            self.launch(self.n_bad, again=True)
        except _DidNotFit:
            self.run_all(again=True)

    def run_until_good(self) -> None:
        """Run bad tiles again until none is bad, or the whole box where no halo is wide enough.

        WindowTooLong if that is needed for a sheared gas.
        """
        a = self.arrays
        most = float(a.scale.most_halo)
        bad = 0
        while True:
            count = int(a.counter.n_bad)
            reach = a.widest + float(a.total[TOTAL.excursion]) + float(a.total[TOTAL.max_displacement])
            if a.uses.shear:
                reach += abs(float(a.scale.drift)) * (float(a.clock.end) - float(a.clock.begin))
            if count == 0 and reach <= most:
                break
            bad += count
            if reach > most or a.counter.stuck:
                self._run_whole_box()
                break
            self._drop(to_numpy(a.listed)[: self.n_bad])
            a.domain.run_bad(self)
            self.collect()
        self.statistics.run_again += bad

    def _run_whole_box(self) -> None:
        """Run the window by one thread, in order: what no halo is wide enough for."""
        a = self.arrays
        if a.uses.shear:
            raise WindowTooLong
        self.statistics.in_order += 1
        a.grid.single_tile = 1
        room, lanes = self._room(), int(a.grid.lanes)
        a.grid.lanes = 1
        self.clear()
        a.domain.run_whole_box(self)
        self.collect()
        if not a.domain.comm.is_root:  # each rank has run all of it
            self.clear()
        a.grid.lanes, a.grid.single_tile = lanes, 0
        a.scratch(*room)

    # ------------------------------------------------------------------ what tiles write down

    def collect(self) -> None:
        """Collect the rows that the latest tiles have recorded."""
        a = self.arrays
        watching = a.grid.watching
        if watching & k.TRACKED:
            self.events.take(a, int(a.counter.n_watched))
        if watching & k.PAIRS:
            self.pairs.take(a, int(a.counter.n_pairs))

    def times(self) -> NDArray[np.floating[Any]]:
        """Times of the collisions of two disks that tiles have written down in the window [time], in any order."""
        a = self.arrays
        if not a.grid.watching & k.TRAIL:
            return self.pairs.rows()[0]
        words = named(a.values("trail"), "trail").one[: self._n_trail]
        found: NDArray[np.floating[Any]] = a.values("trail_time")[: self._n_trail][words >= k.OWN]
        return found

    def clear(self) -> None:
        """Drop all recorded rows, before all tiles run again."""
        watching = self.arrays.grid.watching
        if watching & k.TRACKED:
            self.events.clear()
        if watching & k.PAIRS:
            self.pairs.clear()
        if watching & k.TRAIL:
            self._n_trail = 0

    def _drop(self, tiles: NDArray[np.int32]) -> None:
        """Drop the recorded rows of these tiles."""
        if self.arrays.grid.watching & k.TRACKED:
            self.events.drop(tiles)
        if self.arrays.grid.watching & k.PAIRS:
            self.pairs.drop(tiles)

    # ------------------------------------------------------------------ launches

    def launch(
        self,
        tiles: int,
        most: int = 1,
        *,
        again: bool = False,
        pausing: bool = False,
        resuming: bool = False,
    ) -> None:
        """Run up to `most` windows of so many tiles, or of the listed ones `again`, with room for what they need.

        Tiles are then verified, unless other ranks have to be asked first.
        """
        a = self.arrays
        part, clock, moments, sums = (
            int(a.grid.part),
            a.clock.copy(),
            a.scale.moment.copy(),
            a.sums.copy(),
        )
        while True:
            self.stopped_early = False
            a.counter.array[:] = 0
            a.counter.again, a.counter.pausing, a.counter.resuming = again, pausing, resuming
            a.counter.resting = int(resuming and self.rests)
            if again:
                a.counter.n_ghosts, a.counter.n_trail = self._n_ghosts, self._n_trail
            a.sums[:] = sums  # one window after another, so that sums do not depend on launches
            self._call_kernels(tiles, most)
            if a.counter.paused == k.BY_WORK:
                self._work_on(tiles, most)
            self._n_ghosts, self._n_trail = int(a.counter.n_ghosts), int(a.counter.n_trail)
            self.has_trail = bool(a.grid.watching & k.TRAIL) and not a.grid.single_tile
            self._check_progress()
            self.n_bad, self.n_marked = int(a.counter.n_bad), int(a.counter.n_marked)
            if not a.counter.full:
                self.rests |= bool(a.counter.resting)
                return
            if a.counter.n_windows > 1:
                # Windows before this one are good: continue from here.
                sums = a.sums.copy()
                self.statistics.windows += int(a.counter.n_windows) - 1
                clock = a.clock.copy()
                part = int(a.grid.part)
                moments[:] = k.FAR
                if clock.stop < clock.end and a.keeps_moments:
                    moments[0] = clock.stop - clock.begin
            resuming = False  # from the beginning of the window
            a.clock.array[:], a.grid.part, a.scale.moment = clock.array, part, moments
            self._make_room(tiles, again=again)

    def _call_kernels(self, tiles: int, most: int) -> None:
        """Launch the kernels of up to `most` windows."""
        a = self.arrays
        alone = bool(a.grid.single_tile)
        kernel: Callable[..., Any] = run_windows_on_gpu if a.on_gpu else run_windows
        self._dense |= bool(a.counter.again)
        by_blocks = a.blockwise and not (alone or (a.counter.again and self.n_marked))
        with a.sent() as launch:
            for _ in range(1 if alone else most):
                if by_blocks:
                    launch(run_windows_by_blocks, tiles, int(not self._dense))
                    if self._dense:
                        launch(run_dense_tiles)
                    continue
                for first in range(0, tiles, a.batch):
                    launch(kernel, first, min(first + a.batch, tiles), most)
                if not (alone or a.uses.ranks):
                    launch(verify)
        if by_blocks and not a.counter.again:
            self._dense = a.counter.n_dense > 0

    def _work_on(self, tiles: int, most: int) -> None:
        """Go on with a window of a gas in one tile that has paused for the length of the launch, until it ends.

        Here Python notices Ctrl-C: where a stop is asked for, and the window may pause, it does so after the next
        event. InelasticCollapse if the window does not come near its end.
        """
        a = self.arrays
        window, begin = None, 0.0
        events, since = 0, 0.0
        while a.counter.paused == k.BY_WORK and not (a.counter.full or a.counter.stalled):
            if window is None or float(a.clock.begin) != begin:  # another one
                begin, window = float(a.clock.begin), float(a.scale.window)
                events, since = 0, 0.0
            events += int(a.counter.n_events)
            reached = float(a.clock.reached)
            if reached - since >= LEAST_ADVANCE * window:
                events, since = 0, reached
            elif events > LONG + LONG_OF_A_DISK * a.n:
                raise self._collapse()
            a.counter.n_windows -= 1
            a.counter.next_tile = a.counter.n_events = a.counter.paused = 0
            a.counter.resuming = 1
            if a.counter.pausing and backend.stop_is_asked():
                self.stopped_early = True
                a.scale.moment[0], a.counter.written = reached, 0
            self._call_kernels(tiles, most)

    def _collapse(self) -> InelasticCollapse:
        """The error of a window in which collisions pile up."""
        a = self.arrays
        return InelasticCollapse(
            f"t = {float(a.clock.begin):.9g} to {float(a.clock.end):.9g}: collisions pile up without end in a "
            "window (inelastic collapse)"
        )

    def _check_progress(self) -> None:
        """Raise the error of a window in which a disk is too fast, or collisions pile up."""
        a = self.arrays
        stalled = int(a.counter.stalled)
        if stalled >= k.NOT_FINITE and self.forces is not None:
            when, name = self.forces.name_of(stalled)
            raise EngineError(f"t = {when}: {name}, made a velocity or spin that is not finite")
        if stalled == 2:
            raise unbounded(float(a.clock.begin))
        if stalled:
            raise self._collapse()

    def _make_room(self, tiles: int, *, again: bool) -> None:
        """Make more room of each kind that did not suffice for so many tiles."""
        a = self.arrays
        full, grown = int(a.counter.full), int(SLACK * int(a.counter.needed)) + 16
        lane_slots, cells, items = self._room()
        # Threads of a CPU have stopped before the other tiles, which will have as many.
        ran = tiles if a.on_gpu else max(int(a.counter.next_tile - a.grid.lanes), 1)
        more = SLACK * max(tiles / ran, 1.0)
        if full & k.FULL_PAIRS:
            a.make_pairs(int(more * a.counter.n_pairs) + 64)
        if full & k.FULL_GHOSTS:
            a.make_ghosts(int(more * self._n_ghosts) + 64)
        if full & k.FULL_TRAIL:
            a.make_trail(int(more * self._n_trail) + 64)
        if again and full & (k.FULL_GHOSTS | k.FULL_TRAIL):
            raise _DidNotFit
        if full & k.FULL_WATCHED:
            a.events(2 * int(a.counter.n_watched) + 64)
        if full & (k.FULL_SLOTS | k.FULL_CELLS | k.FULL_WALLS):
            if full & k.FULL_SLOTS:
                lane_slots = max(lane_slots, min(grown, a.n if a.grid.single_tile else 9 * a.n))
            if full & k.FULL_CELLS:
                cells = max(cells, grown)
            if full & k.FULL_WALLS:
                items = max(items, grown)
            a.scratch(lane_slots, cells, items)

    def _room(self) -> tuple[int, int, int]:
        """Slots for disks, cells and walls of a lane."""
        grid = self.arrays.grid
        return int(grid.lane_slots), int(grid.cells), int(grid.items)


def unbounded(time: float) -> EngineError:
    """The error of a disk that is too fast to compute with."""
    return EngineError(
        f"t = {time:.9g}: a collision gave a disk an energy beyond all bounds: "
        "it would cross the box a million times before anything else happens. The law adds energy"
    )
