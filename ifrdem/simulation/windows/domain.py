"""The part of a gas that a process has: rows of the state in the lists of tiles, and sums of what tiles found.

Imports the runtime: import this module only after `backend.start`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...kernels import layout as k
from ...kernels.tiles.sums import sum_shared
from ...kernels.windows.planner import survey
from ...model.state import DiskKinds, Disks, State
from ...mpi import SERIAL, Communicator
from ...mpi.distribution import Table, blocks, pieces
from ...tools import progress

if TYPE_CHECKING:
    from .arrays import DeviceArrays
    from .runner import TileRunner


def sums_of_blocks(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums over blocks of BLOCK_OF_TILES rows, row after row, shape (blocks, columns)."""
    padded = np.zeros((-(-len(rows) // k.BLOCK_OF_TILES), k.BLOCK_OF_TILES, rows.shape[1]))
    padded.reshape(-1, rows.shape[1])[: len(rows)] = rows
    found = padded[:, 0].copy()
    for i in range(1, min(k.BLOCK_OF_TILES, len(rows))):
        found += padded[:, i]
    return found


class Domain:
    """All tiles and all disks, of a process by itself. `ranks.RankDomain` is what one of several ranks has.

    `DeviceArrays` has one, whose `arrays` it is.
    """

    comm: Communicator = SERIAL
    first_id: int = 0
    """Number by which kernels know disk 0."""

    def attach(self, arrays: DeviceArrays) -> None:
        """Set the arrays of the engine."""
        self.arrays = arrays

    def first_slots(self, n: int) -> int:
        """Slots for disks to begin with, of n disks."""
        return max(n, 1)

    def state_rows(self, name: str, at: slice | NDArray[np.integer]) -> NDArray[Any]:
        """Some rows of the state."""
        found: NDArray[Any] = self.arrays.values(name)[at]
        return found

    def load_state(self, state: State) -> None:
        """List a state in the tiles, block by block of ids: one needs less memory than rows of all disks at once."""
        a = self.arrays
        part, tiles = int(a.grid.part), np.zeros(a.n, dtype=np.int32)
        count = np.zeros(a.tiles, dtype=np.int64)
        done = progress.stage("laying out disks")
        for ids in blocks(range(a.n)):
            tiles[ids.start : ids.stop] = a.places_of(state.part(ids))[-1]
            count += np.bincount(tiles[ids.start : ids.stop], minlength=a.tiles)
            done(0.3 * ids.stop / a.n)
        following = part * a.room + np.cumsum(count) - count
        with a.written(*a.kept_names) as arrays:
            for ids in blocks(range(a.n)):
                rows, tile = a.rows_from(state.part(ids), ids.start, tiles[ids.start : ids.stop])
                self._append(arrays, rows.values(), tile, following)
                done(0.3 + 0.7 * ids.stop / a.n)
        a.set_lists(part, count)

    def _append(
        self,
        arrays: Iterable[NDArray[Any]],
        rows: Iterable[NDArray[Any]],
        tile: NDArray[np.integer],
        following: NDArray[np.int64],
    ) -> None:
        """Append rows to the lists of their tiles, in their order; `following` are the slots behind the lists."""
        order = np.argsort(tile, kind="stable")
        here = np.bincount(tile, minlength=len(following))
        slot = (following - (np.cumsum(here) - here))[tile[order]] + np.arange(len(order))
        following += here
        for array, values in zip(arrays, rows, strict=True):
            array[slot] = values[order]

    def load_lists(self, rows: Mapping[str, Table], listed: Table) -> None:
        """List rows of the state, which are in order of ids, in their tiles at their places (`DeviceArrays.lists`)."""
        a = self.arrays
        part, count = int(a.grid.part), np.zeros(a.tiles, dtype=np.int64)
        for _, here in pieces(listed):
            count += np.bincount(here[:, 0], minlength=a.tiles)
        start = part * a.room + np.cumsum(count) - count
        with a.written(*rows) as arrays:
            for first, here in pieces(listed):
                slot = start[here[:, 0]] + here[:, 1]
                for array, values in zip(arrays, rows.values(), strict=True):
                    array[slot] = values[first : first + len(here)]
        a.set_lists(part, count)

    def relist(self) -> None:
        """List the disks by the tiles they are in, at a window's beginning: in the part of its end, which is free."""
        a = self.arrays
        part, count = int(a.grid.part), np.zeros(a.tiles, dtype=np.int64)
        names = a.kept_names
        with a.written(*names) as arrays:
            state = dict(zip(names, arrays, strict=True))
            for rows, listed in a.row_blocks(part):
                moved = {name: state[name][rows] for name in ("disk", "meta")}
                count += np.bincount(a.take_to_tiles(moved, listed), minlength=a.tiles)
            following = (1 - part) * a.room + np.cumsum(count) - count
            for rows, listed in a.row_blocks(part):
                held = {name: each[rows] for name, each in state.items()}
                self._append(arrays, held.values(), a.take_to_tiles(held, listed), following)
        a.set_lists(1 - part, count)
        a.grid.part = 1 - part

    def n_here(self, part: int) -> int:
        """Number of disks that a part holds here."""
        return self.arrays.n

    def by_id(self, part: int, rows: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
        """Rows that `read_out` filled for this part, in order of ids; of ranks, those of the own slice."""
        return list(rows)

    def sums(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums over all tiles of what each has, shape (tiles, columns): block by block, always in one order."""
        return rows[0] if len(rows) == 1 else np.add.accumulate(sums_of_blocks(rows), axis=0)[-1]

    def largest(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """The largest of each column of what tiles have, shape (tiles, columns), 0 or more."""
        found: NDArray[np.float64] = rows.max(axis=0)
        return found

    def share(self) -> None:
        """Sum the results of all tiles again."""
        self.arrays.launch(sum_shared, self.arrays.found.shape[0], 1)

    # ------------------------------------------------------------------ a window

    def survey(self, *, rough: bool) -> None:
        """Look for the fastest disk, and add up squares of speeds, in units that `rough` surveys find."""
        self.arrays.launch(survey, int(rough))

    def run(
        self, runner: TileRunner, most: int = 1, *, pausing: bool = False, resuming: bool = False
    ) -> None:
        """Run the present window in all tiles, or up to `most` windows, and verify the tiles.

        `pausing` stops a gas in one tile at the requested moment; `resuming` continues from there.
        """
        runner.run_all(most, pausing=pausing, resuming=resuming)

    def replay(self, runner: TileRunner) -> None:
        """Repeat the present window by the trails of all tiles, and write its requested moments."""
        runner.replay()

    def run_bad(self, runner: TileRunner) -> None:
        """Run the bad tiles of the window again with wider halos, and verify all."""
        runner.run_bad()

    def run_whole_box(self, runner: TileRunner) -> None:
        """Run the window by one thread, which has all disks."""
        runner.select(np.zeros(1, dtype=np.int32))
        runner.launch(1)


def domain_of(comm: Communicator, disks: Disks, kinds: Disks) -> Domain:
    """The domain of this process: `disks` are those of the own slice, `kinds` those of all."""
    if comm.size == 1:
        return Domain()
    from .ranks import RankDomain

    assert isinstance(kinds, DiskKinds)
    return RankDomain(comm, disks, kinds)
