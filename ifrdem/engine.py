"""The event-exact parallel engine, seen from the host: arrays, epochs, and what ends an epoch.

Time advances in *epochs*. At the beginning of one, disks are sorted into cells and tiles, and every pair is listed
that could touch before its end (`kernels/lists.py`, `kernels/extend.py`). Then the collisions are processed, in one
of three ways (`ORDERS`):

- *alone*: one thread, in their order, whole epochs in one launch (`kernels/epochs.py`): gases of up to ALONE disks;
- *tiles*: each tile by one thread, in order, as far as disks of other tiles do not matter (`kernels/tiles.py`);
  what remains between the tiles in rounds. Tiles run ahead of each other by one *window*, a part of the epoch that
  gets shorter where much must be undone: in clusters;
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

An epoch ends early, and everything at or after its new end is undone, when

- a collision makes a disk so fast that even the longest list would not be complete to the planned end;
- the log could overflow, or a dense cluster takes too many rounds: it then ends at the earliest unprocessed event,
  before which everything is final;
- the caller wants to stop at a number of collisions.

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
=====================================  ===========================================  =========================
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import backend
from .box import Box
from .errors import EngineError, InputError
from .state import Disks, State

# Bytes that the arrays take for each disk, with a log of one record for two disks.
_LOG_REAL, _LOG_INT = 11, 8
_FLIGHT, _KIND, _LINK, _META, _IMAGE, _LISTS = 8, 4, 8, 3, 2, 5
ADDRESSABLE = 2**31 - 1  # entries of one array that 32-bit indices reach
ROW = 16  # entries of a neighbour row to begin with; rows grow where more are needed
CROWD = 8000  # neighbours of one disk, at most: its row's lengths share an integer
MOST_DISKS = ADDRESSABLE // 24  # with rows as long as a dense gas may need
# With cells for half as many as there are disks, and in double precision.
BYTES_PER_DISK = (
    8 * _FLIGHT
    + 4 * (_LINK + _META + _IMAGE + _LISTS + ROW + 1 + 1 + 1)
    + (8 * _LOG_REAL + 4 * _LOG_INT) // 2
)

ALONE = 20_000  # up to so many disks, one thread runs whole epochs by itself
TILE_DISKS = 4000  # disks of a tile: what fits the cache next to a core
LAUNCH_SECONDS = 0.2  # how long one launch of whole epochs should take, to see to progress and interrupts
HIGHEST_LEVEL = 12  # a disk may come so many quarters further than others of its list, and once as far
# Of the collisions in a window, how many undone ones make windows shorter or longer, and how short they get at most.
MOST_UNDONE, LEAST_UNDONE, SHORTEST_WINDOW = 0.04, 0.01, 1.0 / 1024.0
FEW = 4096  # up to so many active disks, one thread is faster than several
MOST_ROUNDS = 2000  # rounds of a window after which the epoch is cut at its earliest unprocessed event
MOST_LOG = 4  # records for each disk up to which the log grows; beyond, epochs get shorter
PATIENCE = 1000  # usual times between collisions without one, after which a run by collisions gives up
STALLED_EPOCHS = 50  # epochs in a row that together gain no time: the gas has collapsed


# Who processes an epoch's collisions: one thread alone, tiles of disks in parallel, or rounds over all disks.
ORDERS = ("alone", "tiles", "rounds")


@dataclass
class Statistics:
    """What the engine has done since it was made."""

    epochs: int = 0
    rounds: int = 0
    undone: int = 0
    violations: int = 0
    cut_for_speed: int = 0
    cut_for_log: int = 0
    cut_for_rounds: int = 0


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


def default_skin(packing_fraction: float, diameter: float) -> float:
    """Extra listing distance [length] that costs least time, from the mean free path.

    A fit, 2.26 (l / sigma)^(2/3) sigma, to the flat optima that were measured at phi = 0.1, 0.3 and 0.6.
    """
    chi = (1.0 - 7.0 * packing_fraction / 16.0) / (1.0 - packing_fraction) ** 2
    free_path = math.pi / (8.0 * math.sqrt(2.0) * packing_fraction * chi)  # in diameters
    return diameter * min(max(2.26 * free_path ** (2.0 / 3.0), 0.2), 8.0)


def _free(array: Any) -> None:
    """Give a Taichi array's memory back: arrays of vectors do not do so by themselves."""
    import taichi as ti

    runtime = ti.lang.impl.get_runtime()
    if runtime.prog is not None and not hasattr(array, "__del__"):
        runtime.prog.delete_ndarray(array.arr)
        array.arr = None


def _kinds(disks: Disks) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """What kinds of disks there are, shape (kinds, 4): inverse mass, k, radius, material; and each disk's kind."""
    columns = (1.0 / disks.mass, disks.k, disks.radius, disks.material.astype(np.float64))
    code: NDArray[np.int64] = np.zeros(disks.n, dtype=np.int64)
    for column in columns:
        if disks.n and column.min() != column.max():
            values, index = np.unique(column, return_inverse=True)
            _, code = np.unique(code * len(values) + index, return_inverse=True)
    _, first = (
        np.unique(code, return_index=True)
        if code.any()
        else (None, np.zeros(min(disks.n, 1), dtype=np.int64))
    )
    return np.stack([column[first] for column in columns], axis=1), code


class Engine:
    """Disks in a periodic box, moved from collision to collision.

    Parameters
    ----------
    disks, box, state : Disks, Box, State
        What moves, where, and its start. Positions must not overlap (`placement.check_no_overlap`).
    law_table : array (M, M, 5)
        e_n, e_t, mu, contact_point, rho of each pair of materials (`IFRLaw.table_row`).
    arch, threads
        See `backend.start`.
    skin : float, optional
        Extra listing distance [length]; by default `default_skin`. Results do not depend on it beyond rounding.

    Raises
    ------
    InputError
        If a disk is larger than a third of a side of the box, one of infinite mass moves, or the device is not
        there.
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
    ) -> None:
        self.disks, self.box = disks, box
        n = self.n = disks.n
        if n > MOST_DISKS:
            raise InputError(f"{n} disks: the engine's 32-bit indices allow {MOST_DISKS} at most")
        if state.n != n:
            raise InputError(f"the state has {state.n} disks: {n} are needed")
        moving = ~disks.movable & (np.any(state.velocity != 0.0, axis=1) | (state.spin != 0.0))
        if np.any(moving):
            i = int(np.argmax(moving))
            raise InputError(
                f"disk {i} has an infinite mass and moves (velocity {state.velocity[i]}, spin {state.spin[i]}): "
                "an immovable disk must be at rest"
            )
        law_table = np.ascontiguousarray(law_table, dtype=np.float64)
        if n and int(disks.material.max()) >= len(law_table):
            raise InputError(
                f"material index {disks.material.max()}: the law table has {len(law_table)} materials"
            )
        diameter = 2.0 * float(disks.radius.max()) if n else 0.0
        shortest = min(box.lengths)
        if diameter > shortest / 3.0:
            i = int(np.argmax(disks.radius))
            raise InputError(
                f"disk {i} has diameter {diameter:.6g}, more than a third of the box side {shortest:.6g}: "
                "it could meet its own periodic image; use a larger box"
            )
        # Beyond half a side, a pair could be near through two images at once.
        widest = shortest / 2.0 - diameter
        # As many of the smallest disks as can stand around the largest one, within the reach of a fast one's list.
        smallest = 2.0 * float(disks.radius.min()) if n else 1.0
        crowded = 0.5 * (math.sqrt(CROWD) * smallest - diameter - smallest) / 2.5
        if crowded <= 0.05 * smallest:
            raise InputError(
                f"the largest disk is {diameter / smallest:.4g} times as wide as the smallest: at most some "
                f"{math.sqrt(CROWD) - 1.0:.0f} times is supported"
            )
        widest = min(widest, crowded)
        if skin is None:
            # A handful of disks may as well list everybody, and rarely do so.
            skin = (
                min(
                    default_skin(box.packing_fraction(disks.radius), 2.0 * float(disks.radius.mean())), widest
                )
                if n > 16
                else widest
            )
        elif not 0.0 < skin <= widest:
            raise InputError(f"skin = {skin}: must lie above 0 and not above {widest:.6g} in this box")
        self._released = False
        self.skin = skin
        self.time = float(state.time)
        self.collisions = int(state.collisions.sum()) // 2
        self.statistics = Statistics()
        self.last_collisions: Collisions | None = None
        self.keep_collisions = False
        # Tiles run ahead of each other by one window, this part of an epoch; in clusters a small one.
        self._window = 1.0 / (windows or 1)
        self.adapt_windows = windows is None
        self.tile_disks = tile_disks
        self._log_real: Any = None
        self._log_int: Any = None
        self._burst = 1  # epochs of the next launch, where one thread runs them
        self._real = np.float32 if precision == "f32" else np.float64
        self._stalled = 0
        self._whole = True  # False while an epoch is under way: an interrupt would leave it half done
        self.log_growth = 2  # a log that was too short gets longer by this factor
        self._log_growths = 0
        self._collided_at = self.time
        backend.start(arch, threads=threads, precision=precision)
        import taichi as ti

        self._dtype = getattr(ti, precision)
        if order is None:
            order = "rounds" if arch != "cpu" else "alone" if n <= ALONE else "tiles"
        self.order = order
        backend.register(self)
        self._allocate(state, law_table, diameter + skin)

    # ------------------------------------------------------------------ arrays

    def _allocate(self, state: State, law_table: NDArray[np.float64], reach: float) -> None:
        import taichi as ti

        n = self.n
        # Wider by a trifle: a disk on the border of two cells may count to either.
        most = [
            max(1, int(side / (reach * (1.0 + 100.0 * float(np.finfo(self._real).eps)))))
            for side in self.box.lengths
        ]
        # More cells than disks would only cost time: a dilute gas gets larger ones.
        thin = math.sqrt(max(1.0, most[0] * most[1] / max(n, 1)))
        most = [max(1, int(count / thin)) for count in most]
        tiles = [1, 1]
        if self.order != "alone":
            wanted = math.sqrt(self.tile_disks * most[0] * most[1] / max(n, 1))
            tiles = [min(count, max(1, round(count / wanted))) for count in most]
        cells = [count // by for count, by in zip(most, tiles, strict=True)]
        total = tiles[0] * tiles[1] * cells[0] * cells[1]

        real, integer, room = self._dtype, ti.i32, max(n, 1)
        # Kinds of disks: the radius stands with the flight too, where predictions need it.
        kinds, kind = _kinds(self.disks)
        self._flight = ti.Vector.ndarray(_FLIGHT, real, room)
        self._kinds = ti.Vector.ndarray(_KIND, real, max(len(kinds), 1))
        self._meta = ti.Vector.ndarray(_META, integer, room)
        self._image = ti.Vector.ndarray(_IMAGE, integer, room)
        self._cell = ti.ndarray(integer, (room,))
        self._link = ti.Vector.ndarray(_LINK, integer, room)
        self._order = ti.ndarray(integer, (room,))
        self._lists = ti.ndarray(integer, (_LISTS, room))
        self._total_cells = total
        self._start = ti.ndarray(integer, (total + 1,))
        self._fill = ti.ndarray(integer, (total,))
        self._squares = ti.ndarray(real, (room // 1024 + 1,))
        self._block = ti.ndarray(integer, (total // 1024 + 1,))
        # Small arrays that the host reads after every launch: kernels take NumPy arrays as they are on a CPU.
        self._counter = np.zeros(16, dtype=np.int32)
        self._limit = np.zeros(5, dtype=self._real)
        self._grid = np.array([n, *tiles, *cells, ROW, 0, 0, 1], dtype=np.int32)
        self._scale = np.zeros(11, dtype=self._real)
        tile_sides = [length / count for length, count in zip(self.box.lengths, tiles, strict=True)]
        cell_sides = [side / count for side, count in zip(tile_sides, cells, strict=True)]
        self._scale[0:5] = (*cell_sides, *tile_sides, self.skin)
        widest = reach - self.skin
        self._scale[8] = self.skin / 2.0
        self._scale[10] = widest
        # Two disks of the highest level must still find each other in tiles side by side, and through one image only.
        room_for = min(*tile_sides, min(self.box.lengths) / 2.0) - widest
        self._grid[7] = min(max(int((room_for / self.skin - 1.0) * 4), 0), HIGHEST_LEVEL)
        self._clock = np.zeros(3)
        self._total = np.zeros(3, dtype=np.int64)
        self._law = ti.ndarray(real, law_table.shape)
        self._row = ROW
        self._neighbour = ti.ndarray(integer, (room * ROW,))
        self.allocate_log(n // 2 + 1024)

        position = self.box.wrap(state.position)
        tile = np.minimum((position / tile_sides).astype(np.int64), np.array(tiles) - 1)
        local = position - tile * tile_sides
        index = np.clip((local / cell_sides).astype(np.int64), 0, np.array(cells) - 1)
        flight = np.zeros((room, _FLIGHT), dtype=self._real)
        flight[:n, 0:2] = local
        flight[:n, 2:4] = state.velocity
        flight[:n, 5] = state.spin
        flight[:n, 6] = self.disks.radius
        meta = np.zeros((room, _META), dtype=np.int32)
        meta[:n, 0] = np.arange(n)
        meta[:n, 1] = kind
        meta[:n, 2] = state.collisions
        image = np.zeros((room, _IMAGE), dtype=np.int32)
        image[:n] = state.image + np.floor(state.position / self.box.lengths).astype(np.int32)
        cell = np.zeros(room, dtype=np.int32)
        cell[:n] = ((tile[:, 0] * tiles[1] + tile[:, 1]) * cells[0] + index[:, 0]) * cells[1] + index[:, 1]
        self._flight.from_numpy(flight)
        if n:
            self._kinds.from_numpy(kinds.astype(self._real))
        self._image.from_numpy(image)
        self._meta.from_numpy(meta)
        self._cell.from_numpy(cell)
        self._law.from_numpy(law_table.astype(self._real))
        self._link.fill(0)

    def allocate_log(self, records: int) -> None:
        """Make room for so many collisions an epoch; the epoch at hand loses its log. Half the disks at least."""
        import taichi as ti

        for old in (self._log_real, self._log_int):
            if old is not None:
                _free(old)
        # Sorting needs half the disks; every tile takes records by the chunk.
        tiles = int(self._grid[1] * self._grid[2])
        records = max(records, (self.n + 1) // 2, 64 * (tiles + 1))
        self._grid[6] = records
        self._log_real = ti.Vector.ndarray(_LOG_REAL, self._dtype, records)
        self._log_int = ti.Vector.ndarray(_LOG_INT, ti.i32, records)

    def switch_off_rollback(self) -> None:
        """Let collisions that came too early stand: to see that tests notice. Never do so for results."""
        self._grid[8] = 0

    @property
    def most_level(self) -> int:
        """Highest level that the box allows a fast disk (`kernels/extend.py`)."""
        return int(self._grid[7])

    @property
    def bytes_allocated(self) -> int:
        """Bytes of all device arrays."""
        total = 0
        for value in vars(self).values():
            if hasattr(value, "element_shape"):
                scalar = 8 if str(value.dtype) == "f64" else 4
                total += scalar * math.prod(value.shape) * math.prod(value.element_shape)
        return total

    # ------------------------------------------------------------------ running

    def advance(self, *, t_end: float = math.inf, collisions: int | None = None) -> None:
        """Run one epoch, or some of a small gas: to `t_end` [time] or the total number of `collisions` at the latest.

        Raises
        ------
        EngineError
            If no collision can ever happen but some are asked for, if collisions pile up without end (inelastic
            collapse), or if a guarantee of the engine is violated.
        """
        self._check_whole()
        self._whole = False
        self.last_collisions = None
        if self.n < 2:
            self._settle()
            self._fly_freely(t_end)
        elif self.order == "alone":
            self._epochs_by_one_thread(t_end, collisions)
        else:
            self._epoch(t_end, collisions)
        self._whole = True

    def release(self) -> None:
        """Give all device memory back; the engine cannot be used any more."""
        self._released = True
        for name, value in list(vars(self).items()):
            if hasattr(value, "element_shape"):
                _free(value)
                setattr(self, name, None)

    def __del__(self) -> None:
        # Taichi's arrays of vectors do not free themselves.
        if not getattr(self, "_released", True) and not sys.is_finalizing():
            self.release()

    def _check_whole(self) -> None:
        if self._released:
            raise EngineError(
                "this simulation has ended: another one was started with another device, precision or number of "
                "threads, of which a process has one at a time"
            )
        if not self._whole:
            raise EngineError(
                "an epoch was interrupted half-way, so the state is lost: begin a new simulation from a stored state"
            )

    def _fly_freely(self, t_end: float) -> None:
        if not math.isfinite(t_end):
            raise EngineError(
                f"t = {self.time:.6g}: no disk can meet another one, but collisions are asked for"
            )
        self._scale[9], self.time = t_end - self.time, t_end

    def _epochs_by_one_thread(self, t_end: float, collisions: int | None) -> None:
        from .kernels.epochs import epochs_by_one_thread
        from .kernels.layout import EARLIEST, END, FAR, FASTEST, LOG_FULL, MOST_NEIGHBOURS, PLANNED

        self._clock[:] = self.time, t_end, 0.0
        self._total[:] = 2**62 if collisions is None else collisions - self.collisions, 0, 0
        began = time.perf_counter()
        before = self.time
        needed = 1
        while needed:
            epochs_by_one_thread(
                1 if self.keep_collisions else self._burst, self._clock, self._total, self._grid, self._scale,
                self._flight, self._kinds, self._meta, self._image, self._link, self._cell,
                self._start, self._fill, self._order, self._neighbour, self._counter, self._limit,
                self._log_real, self._log_int, self._law,
            )  # fmt: skip
            needed = int(self._counter[MOST_NEIGHBOURS])
            if needed:
                self._cut(0.0)
                self._lengthen_rows(needed)
        epochs, done = int(self._total[1]), int(self._total[2])
        if self._limit[FASTEST] == 0.0:
            self.statistics.epochs += epochs
            self.collisions += done
            self.time = float(self._clock[0])
            self._fly_freely(t_end)
            return
        elapsed = time.perf_counter() - began
        if epochs == self._burst:
            self._burst = int(min(max(self._burst * LAUNCH_SECONDS / elapsed, 1), 4 * self._burst, 1 << 20))
        end, planned = float(self._limit[END]), float(self._clock[PLANNED])
        if self._limit[EARLIEST] < FAR:
            raise self._lost(float(self._limit[EARLIEST]))
        if self.keep_collisions:
            self.last_collisions = self._read_log()
        self.statistics.epochs += epochs
        if self._counter[LOG_FULL]:
            self.statistics.cut_for_log += 1
            self._lengthen_log()
        elif end < planned and not (collisions is not None and self.collisions + done >= collisions):
            self.statistics.cut_for_speed += 1
        self.time = float(self._clock[0])
        self.collisions += done
        self._watch(self.time - before, end < 1e-9 * planned, done, t_end, float(self._limit[FASTEST]))

    def _lost(self, earliest: float) -> EngineError:
        return EngineError(
            f"t = {self.time + earliest:.9g}: an event before the end of the epoch was left unprocessed "
            "although no disk was active; please report this with the case file and seed"
        )

    def _epoch(self, t_end: float, collisions: int | None) -> None:
        from .kernels.extend import speed_cap
        from .kernels.layout import LOG_FULL, MEAN_SQUARE, MOST_LEVEL, MOST_NEIGHBOURS, REACH

        fastest = self._settle()
        if fastest == 0.0:
            self._fly_freely(t_end)
            return
        cap = speed_cap(fastest, float(self._limit[MEAN_SQUARE]), int(self._grid[MOST_LEVEL]))
        horizon = min(float(self._scale[REACH]) / cap, t_end - self.time)
        planned, by_tiles = horizon, self.order == "tiles"
        while True:
            self._list(horizon)
            end = self._rounds(horizon, by_tiles)
            needed = int(self._counter[MOST_NEIGHBOURS])
            if self._counter[LOG_FULL] != 2 and not needed:
                break
            # A fast disk's list became too long for its row, or the tiles had no room to log their collisions: again,
            # with longer rows, a longer log or a shorter epoch.
            self._cut(0.0)
            self._clear()
            if needed:
                self._lengthen_rows(needed)
                continue
            self.statistics.cut_for_log += 1
            self._log_growths += 1
            if not self._lengthen_log():
                horizon /= 2.0
                if horizon < planned / 256.0:
                    # A collapse, which has no end within a tile. Rounds can stop at any time.
                    horizon, by_tiles = planned, False
        if end < horizon:
            self._cut(end)
        done = self._standing()
        if collisions is not None and self.collisions + done >= collisions:
            end = self._end_after(collisions - self.collisions)
            self._cut(end)
            done = self._standing()
        if self.keep_collisions:
            self.last_collisions = self._read_log()
        self._finish(end, horizon, t_end, done, fastest)

    def _settle(self) -> float:
        from .kernels.layout import EARLIEST, FAR
        from .kernels.sort import settle

        settle(
            self._grid, self._scale,
            self._flight, self._kinds, self._meta, self._image, self._link, self._cell,
            self._log_real, self._log_int,
            self._start, self._fill, self._block, self._order, self._squares, self._limit,
        )  # fmt: skip
        self._scale[9] = 0.0
        if self._limit[EARLIEST] < FAR:
            raise self._lost(float(self._limit[EARLIEST]))
        return float(self._limit[2])

    def _clear(self) -> None:
        from .kernels.lists import clear_all

        clear_all(self._grid, self._flight, self._link)

    def _list(self, horizon: float) -> None:
        from .kernels.layout import MOST_NEIGHBOURS
        from .kernels.lists import list_disks, list_tiles
        from .kernels.tiles import extend_fast

        self._scale[5] = horizon
        while True:
            if self.order == "tiles":
                list_tiles(
                    self._grid, self._scale, self._flight, self._link, self._meta, self._start,
                    self._neighbour, self._counter, self._limit,
                )  # fmt: skip
            else:
                list_disks(
                    self._grid, self._scale, self._flight, self._link, self._meta, self._cell, self._start,
                    self._neighbour, self._counter, self._limit,
                )  # fmt: skip
            if not self._counter[MOST_NEIGHBOURS]:
                extend_fast(
                    self._grid, self._scale, self._flight, self._link, self._meta, self._cell, self._start,
                    self._neighbour, self._lists, self._counter, self._log_real, self._log_int,
                )  # fmt: skip
            needed = int(self._counter[MOST_NEIGHBOURS])
            if needed == 0:
                return
            self._lengthen_rows(needed)
            self._clear()

    def _lengthen_rows(self, needed: int) -> None:
        import taichi as ti

        row = min(needed + needed // 4, ADDRESSABLE // self.n)
        if row < needed:
            raise EngineError(
                f"a disk has {needed} neighbours: for {self.n} disks, 32-bit indices allow {row}; "
                "use a smaller skin"
            )
        self._grid[5] = row
        _free(self._neighbour)
        self._neighbour = ti.ndarray(ti.i32, (max(self.n, 1) * row,))

    def _lengthen_log(self) -> bool:
        """Double the log, if that is still reasonable."""
        records = int(self._grid[6])
        if self.log_growth == 1 or records > MOST_LOG * self.n + 4096:
            return False
        self.allocate_log(self.log_growth * records)
        return True

    def _rounds(self, horizon: float, by_tiles: bool) -> float:
        """Windows of tiles and rounds until no event before the end is left; returns the end."""
        from .kernels.layout import (
            BEGIN,
            END,
            LOG_FULL,
            MOST_NEIGHBOURS,
            N_ROUNDS,
            N_STANDING,
            N_UNDONE,
            N_VIOLATIONS,
            WINDOW,
        )
        from .kernels.rounds import one_round, rounds_by_one_thread
        from .kernels.tiles import join_tiles, run_tiles

        counter = self._counter
        state = (
            self._grid, self._scale, self._flight, self._kinds, self._link, self._meta, self._cell, self._start,
            self._neighbour, self._lists, counter, self._limit, self._log_real, self._log_int, self._law,
        )  # fmt: skip
        full = False
        active = 0
        begin = 0.0
        while begin < horizon:
            stop = begin + self._window * horizon
            if self._window == 1.0 or stop > horizon * (1.0 - 1e-6):
                stop = horizon
            self._scale[BEGIN], self._scale[WINDOW] = begin, stop
            done, undone = int(counter[N_STANDING]), int(counter[N_UNDONE])
            most_rounds = int(counter[N_ROUNDS]) + MOST_ROUNDS
            everybody = self.n
            active = self.n
            if by_tiles:
                run_tiles(
                    self._grid, self._scale, self._flight, self._kinds, self._link, self._meta, self._cell,
                    self._start, self._fill, self._order, self._neighbour, counter, self._limit,
                    self._log_real, self._log_int, self._law,
                )  # fmt: skip
                if counter[LOG_FULL]:
                    return horizon  # to be done again
                join_tiles(
                    self._grid, self._scale, self._flight, self._link, self._meta, self._cell,
                    self._start, self._fill, self._order, self._neighbour, self._lists, counter,
                    self._log_real, self._log_int,
                )  # fmt: skip
                everybody = 0
                active = self._active()
                full = bool(counter[LOG_FULL])
            while active and not full and counter[N_ROUNDS] < most_rounds:
                if active <= FEW:
                    rounds_by_one_thread(everybody, FEW, most_rounds, *state)
                else:
                    one_round(everybody, *state)
                everybody = 0
                active = self._active()
                full = bool(counter[LOG_FULL])
                if counter[MOST_NEIGHBOURS]:
                    return horizon  # to be done again
            if active:
                break
            begin = stop
            if self.adapt_windows:
                self._adapt_window(int(counter[N_UNDONE]) - undone, int(counter[N_STANDING]) - done)
        self.statistics.rounds += int(counter[N_ROUNDS])
        self.statistics.undone += int(counter[N_UNDONE])
        self.statistics.violations += int(counter[N_VIOLATIONS])
        end = float(self._limit[END])
        if active == 0:
            if end < horizon:
                self.statistics.cut_for_speed += 1
            return end
        if full:
            self.statistics.cut_for_log += 1
        else:
            self.statistics.cut_for_rounds += 1
            if self.adapt_windows:
                self._window = max(self._window / 4.0, SHORTEST_WINDOW)
        return min(end, self._earliest())

    def _adapt_window(self, undone: int, done: int) -> None:
        """Bound the optimism: shorter windows where much had to be undone, longer ones where little."""
        if undone > MOST_UNDONE * done:
            self._window = max(self._window / 2.0, SHORTEST_WINDOW)
        elif undone < LEAST_UNDONE * done:
            self._window = min(self._window * 2.0, 1.0)

    def _active(self) -> int:
        """Disks active in the next round: those that just predicted, and those rolled back, which will."""
        from .kernels.layout import AFFECTED_ROW, CHANGED_ROW, ROUND

        counter = self._counter
        last = 1 - counter[ROUND] % 2
        return int(counter[CHANGED_ROW : CHANGED_ROW + 2].sum() + counter[AFFECTED_ROW + last])

    def _earliest(self) -> float:
        from .kernels.layout import EARLIEST
        from .kernels.rounds import earliest_event

        earliest_event(self._grid, self._flight, self._limit)
        return float(self._limit[EARLIEST])

    def _cut(self, end: float) -> None:
        from .kernels.rounds import cut

        cut(end, self._flight, self._link, self._lists, self._counter, self._log_real, self._log_int)

    def _standing(self) -> int:
        from .kernels.layout import N_STANDING

        return int(self._counter[N_STANDING])

    def _standing_records(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Times, shape (c,), and slots, shape (c, 2), of the collisions that stand, in any order."""
        from .kernels.layout import N_LOG, SLOT, STANDS, TIME

        records = int(self._counter[N_LOG])
        log_int = self._log_int.to_numpy()[:records]
        stands = log_int[:, STANDS] == 1
        return self._log_real.to_numpy()[:records][stands, TIME], log_int[stands, SLOT : SLOT + 2]

    def _end_after(self, count: int) -> float:
        """The end at which exactly the first `count` collisions of the epoch stand (more only in an exact tie)."""
        if count <= 0:
            return 0.0
        times, _ = self._standing_records()
        return float(np.nextafter(np.partition(times, count - 1)[count - 1], math.inf))

    def _read_log(self) -> Collisions:
        times, slots = self._standing_records()
        ids = self._meta.to_numpy()[:, 0]
        pair = np.sort(ids[slots], axis=1)
        order = np.lexsort((pair[:, 1], pair[:, 0], times))
        return Collisions(self.time + times[order], pair[order])

    def _finish(self, end: float, horizon: float, t_end: float, done: int, fastest: float) -> None:
        self._scale[9] = end
        reached = end == horizon and horizon == t_end - self.time
        self.time = t_end if reached else self.time + end
        self.collisions += done
        self.statistics.epochs += 1
        if self.statistics.cut_for_log > self._log_growths:
            self._log_growths = self.statistics.cut_for_log
            self._lengthen_log()
        self._watch(end, end < 1e-9 * horizon, done, t_end, fastest)

    def _watch(self, gained: float, stalled: bool, done: int, t_end: float, fastest: float) -> None:
        """Stop a run that cannot come to its end."""
        if done:
            self._collided_at = self.time
        elif not math.isfinite(t_end):
            # Disks of a lattice that all begin to move at once may take a disk's own free time to meet.
            patience = max(PATIENCE, self.n * PATIENCE // 10)
            if self.time - self._collided_at > patience * self._free_time(fastest):
                raise EngineError(
                    f"t = {self.time:.6g}: no collision since t = {self._collided_at:.6g}, {patience} times what is "
                    "usual at this density: these disks seem never to meet"
                )
        # In an inelastic collapse, collisions without end gain no time.
        self._stalled = self._stalled + 1 if stalled else 0
        if self._stalled >= STALLED_EPOCHS:
            raise EngineError(
                f"t = {self.time:.9g}: {STALLED_EPOCHS} epochs in a row gained no time: collisions pile up without "
                "end (inelastic collapse). Use a larger e_n, a lower packing fraction, or end the run earlier"
            )

    def _free_time(self, speed: float) -> float:
        """Usual time between two collisions anywhere, if all disks moved at this speed: area / (n^2 sigma v)."""
        return self.box.area / (self.n**2 * 2.0 * float(self.disks.radius.mean()) * speed)

    # ------------------------------------------------------------------ reading

    def state(self) -> State:
        """The present state, in id order."""
        from .kernels.sort import export

        self._check_whole()
        self._whole = False
        self._settle()
        self._whole = True
        n, room = self.n, max(self.n, 1)
        real, integer = np.zeros((room, 5), dtype=self._real), np.zeros((room, 3), dtype=np.int32)
        export(self._grid, self._scale, self._flight, self._meta, self._image, self._cell, real, integer)
        return State(
            # Rounding can put a disk onto the far side, which is the next box already.
            position=np.minimum(real[:n, 0:2], np.nextafter(self.box.lengths, 0.0)),
            velocity=real[:n, 2:4],
            spin=real[:n, 4],
            time=self.time,
            collisions=integer[:n, 0].copy(),
            image=integer[:n, 1:3].copy(),
        )
