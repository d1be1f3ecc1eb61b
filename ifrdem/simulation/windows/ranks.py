"""One gas on several ranks of MPI, bitwise the trajectory of one.

The box has the tiles that it has on one rank; each rank owns a block of them. It keeps the lists of disks of its own
tiles, and in each window copies of those of the *ring*, the neighbouring tiles of others. A window is

1. *fetch*: the lists of the ring come from their owners, as far as halos reach that are wider than usual once; where a
   tile has to run with a still wider one, whole lists come, and all tiles begin again;
2. each rank runs its own tiles (`kernels/tiles/tiles.py`), which gather from neighbouring tiles, all of them there;
3. *hashes*: the hash of a disk's history and its displacement are known to the rank that ran the tile of the disk, and
   a disk may have left the tile that lists it. So ranks first send those of disks of the ring that they ran to the
   owners, which then send them to all ranks with a copy of their lists, with `reach` of the tiles;
4. *share*: what tiles have added up (`tally`, `reach`) is added up by the owner of the first tile in each block
   of 128 numbers of tiles, tile by tile; the sums of blocks go to all, and are added up block by block;
5. each rank verifies its own tiles; bad ones run again, and steps 3 to 5 are repeated, until no rank has a bad tile.
   Where no halo is wide enough, every rank gets the whole box for this window, and runs it in order.

Why it is exact. A tile reads disks of the nine tiles around it, and to be verified hashes and ways of the disks that it
copied, its own disks, and `reach` of the tiles around it. After steps 1, 3 and 4 all of these are, bit for bit, what
they are in a process that has all tiles. Lists are copied in their order; what is left out of them lies beyond the halo
of each tile that gathers from them (`bands`, which its owner sends), which are not searched. A hash
is computed once, by the one rank that owns the tile in which the disk begins. So each tile finds the same, is good or
bad as it is there, and the proof in `kernels/tiles/tiles.py` holds: it is about tiles, not about ranks. The length of
the next window follows from the sums of step 4, which are added up in the order of one process: so all
plan the same window. By induction over windows each disk moves as on one rank.

Checked as it runs: each listed disk has been run by exactly one rank in each window (3), and no disk is lost or there
twice whenever a state is put together.

On GPUs, of which each rank has one, rows for others go to the host and back (`kernels/tiles/readout.py`), and what
tiles have added up (360 bytes a tile) does in each round.

What each rank holds: its disks and those of its ring (198 bytes each), with their kinds where there are several: a
table of all kinds, or, if these are more than 1000, of those of the disks that are here; 450
bytes for each tile of the whole box; in a window that is left to the whole box, all disks. Whenever a state is put
together, at the start, for frames and for checkpoints, each has its slice (`mpi/distribution.py`): rows go there from
the owners of tiles, and back, in one exchange of all with all.

Blocks move (`rebalance`) between windows: whole lists of tiles go to other ranks, in their order. No bit depends on
who owns a tile, so none changes.

Imports Taichi: import this module only after `backend.start`. Needs mpi4py.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import EngineError, InputError
from ...kernels import layout as k
from ...kernels.columns import ADDRESSABLE, named
from ...kernels.compiler.language import ti, view
from ...kernels.tiles.readout import read_rows, write_rows
from ...kernels.tiles.sums import sum_shared
from ...kernels.windows.windows import HALO_GROWTH, verify
from ...model.state import COLUMNS, DiskKinds, Disks, State
from ...mpi import Communicator
from ...mpi.decomposition import owners
from .arrays import concatenated_ranges, kind_rows, kinds_of
from .domain import Domain, sums_of_blocks
from .runner import TileRunner

# Windows between checks of the balance of work among ranks, and the imbalance that is too large.
BETWEEN, UNEVEN = 16, 1.1
MOST_EVENTS = 10.0  # of a disk in a window, that count there
SLACK = 1.2  # of slots for disks, beyond those in use
STEPS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


@dataclass
class CommunicationStats:
    """Bytes and messages that a rank has sent so far.

    Attributes
    ----------
    messages : int
        To neighbours.
    ghosts, hashes, sums : int
        Bytes of lists of disks, of hashes and ways, and of sums of tiles.
    windows, rounds : int
        Windows, and times that hashes were exchanged in them.
    seconds : float
        Real time of all this, waiting for others included [s].
    whole : int
        Windows that began again with whole lists of the ring, because halos had to be wider than planned.
    moved : int
        Tiles that went to another owner (`rebalance`).
    """

    messages: int = 0
    ghosts: int = 0
    hashes: int = 0
    sums: int = 0
    windows: int = 0
    rounds: int = 0
    whole: int = 0
    moved: int = 0
    seconds: float = 0.0


def first_id(n: int) -> int:
    """Id that kernels, whose ids have 32 bits, know the first of n disks by: those of many begin below 0.

    Only the order of ids matters to the motion, and that no two are equal to random numbers.
    """
    return 0 if n <= ADDRESSABLE else -(2**31)


def numbers_of(at: slice | NDArray[np.integer]) -> NDArray[np.int32]:
    """Row numbers for a kernel."""
    return np.arange(at.start, at.stop, dtype=np.int32) if isinstance(at, slice) else at.astype(np.int32)


class RankDomain(Domain):
    """Tiles of one rank: own tiles, and the ring around them.

    `disks` are those of the own slice, `kinds` those of all.

    Where there are too many kinds for each rank to know all (`kinds.every` is False), the table `kinds` has rows for
    the disks that are here, and their `kind` is a row of this table. Its columns, not that number, go with a disk to
    another rank, which adds them to its own table.
    """

    def __init__(self, comm: Communicator, disks: Disks, kinds: DiskKinds) -> None:
        self.comm = comm
        self.communication: CommunicationStats = CommunicationStats()
        self.unassigned: int = 0  # listed disks that no rank has run
        self.first_id = first_id(kinds.n)
        self._graph: Any = None
        self._adding: Any = None
        self._partners: list[int] = []
        self._disks = disks
        self._of_here = not kinds.every  # whether `kinds` has rows for the disks here
        self._in_table = 0  # rows of it that are in use
        self._short = False  # tiles have to run again whose halos are wider than what was fetched
        self._since_look = 0  # windows since `rebalance`
        if kinds.every:  # of the disks of the slice: codes are the same with a disk of each kind before them
            both = (np.concatenate([getattr(each, name) for each in (kinds, disks)]) for name in COLUMNS)
            code = kinds_of(Disks(len(kinds.mass) + disks.n, *both))[1]
            self._kind = code[len(kinds.mass) :].astype(np.int32)

    # ------------------------------------------------------------- owners of tiles

    def first_slots(self, n: int) -> int:
        """One slot: later calls make as many as lists need."""
        return 1

    def assign(self, count: NDArray[np.number]) -> None:
        """Divide the tiles, with so much work each, among the ranks."""
        tiles = int(self.arrays.grid.tiles_x), int(self.arrays.grid.tiles_y)
        self.owner: NDArray[np.int32] = owners(count, tiles, self.comm.size)
        self.arrays.own = np.flatnonzero(self.owner == self.comm.rank)
        with self.arrays.written("tile") as (tile,):
            lists = named(tile, "tile")
            lists.owned = self.owner == self.comm.rank
            lists.bad = 0  # nothing else resets it for tiles that another rank now owns
        self._around_for = -1
        self._plan_sums()

    def rebalance(self) -> None:
        """Divide the tiles again where some ranks have more work: their lists go to new owners as they are.

        The cost of a tile is estimated from its disks and their events in the last window; MOST_EVENTS a disk
        at most, for after a window of the whole box one tile has them all.
        """
        part = int(self.arrays.grid.part)
        count = named(self.arrays.values("tile"), "tile").count[self.arrays.own, part]
        events = 2.0 * named(self.arrays.values("tally"), "tally").collisions[self.arrays.own, k.AT_END]
        work = count + np.minimum(events, MOST_EVENTS * count)
        shares = np.array(self.comm.allgather(float(work.sum())))
        if shares.max() <= UNEVEN * shares.mean():
            return
        table = np.zeros((self.arrays.tiles, 3))
        table[self.arrays.own] = np.stack([work, count, self._halo_factor[self.arrays.own]], axis=1)
        self.comm.mpi.Allreduce(table.copy(), table)
        tiles = int(self.arrays.grid.tiles_x), int(self.arrays.grid.tiles_y)
        try:
            after = owners(table[:, 0], tiles, self.comm.size)
        except InputError:  # no straight cuts divide these few tiles: the blocks stay
            return
        if UNEVEN * np.bincount(after, weights=table[:, 0]).max() > shares.max():
            return
        held, listed = self.arrays.rows_held(part)
        self.communication.moved += int(np.count_nonzero(after != self.owner))
        with self.arrays.written("reach") as (reach,):
            named(reach, "reach").halo_factor = table[:, 2]
        self.assign(table[:, 0])
        self.list_rows(held, listed, np.zeros_like(listed))

    def _neighbor_tiles(self) -> NDArray[np.int64]:
        """The eight tiles around each, shape (8, tiles); -1 beyond an end of the box."""
        wide, high = int(self.arrays.grid.tiles_x), int(self.arrays.grid.tiles_y)
        x, y = np.divmod(np.arange(self.arrays.tiles), high)
        aside = int(self.arrays.grid.tiles_aside) if self.arrays.uses.shear else 0
        found = []
        for step_x, step_y in STEPS:
            to_x, to_y = x + step_x - step_y * aside, y + step_y
            there = np.ones(self.arrays.tiles, dtype=bool)
            if not self.arrays.grid.periodic_x:
                there &= (to_x >= 0) & (to_x < wide)
            if not self.arrays.grid.periodic_y:
                there &= (to_y >= 0) & (to_y < high)
            found.append(np.where(there, to_x % wide * high + to_y % high, -1))
        return np.array(found)

    def build_neighbors(self) -> None:
        """Find the neighbours, whose tiles are in this rank's ring, and in whose rings its tiles are."""
        aside = int(self.arrays.grid.tiles_aside)
        if self._around_for == aside:
            return
        self._around_for = aside
        self._neighbors_all = self._neighbor_tiles()
        neighbors = self._neighbors_all[:, self.arrays.own]
        others = np.where(neighbors >= 0, self.owner[neighbors], self.comm.rank)
        self._partners = [int(q) for q in np.unique(others) if q != self.comm.rank]
        self._sent_tiles = [self.arrays.own[np.any(others == q, axis=0)] for q in self._partners]
        self._ghost_tiles = [np.unique(neighbors[others == q]) for q in self._partners]
        if self._graph is not None:
            self._graph.Free()
        self._graph = self.comm.mpi.Create_dist_graph_adjacent(self._partners, self._partners)

    def exchange(self, messages: list[tuple[NDArray[Any], ...]]) -> list[tuple[NDArray[Any], ...]]:
        """Send a message to each neighbour, and get one from each."""
        self.communication.messages += len(messages)
        found: list[tuple[NDArray[Any], ...]] = self._graph.neighbor_alltoall(messages)
        return found

    # ------------------------------------------------------------------ what lies on the device

    def _rows(self, name: str, at: slice | NDArray[np.integer]) -> NDArray[Any]:
        """Some rows of an array, to be read: of a GPU's, only these leave it."""
        if not self.arrays.on_gpu:
            return self.arrays.values(name)[at]
        array, at = getattr(self.arrays, name), numbers_of(at)
        found: NDArray[Any] = np.empty(
            (len(at), *(array.element_shape or (1,))), ti.lang.util.to_numpy_type(array.dtype)
        )
        if len(at):
            read_rows(array, at, found)
        return found if array.element_shape else found[:, 0]

    def _write_rows(self, name: str, at: slice | NDArray[np.integer], rows: NDArray[Any]) -> None:
        """Write some rows of an array."""
        array = getattr(self.arrays, name)
        if not self.arrays.on_gpu:
            view(array)[at] = rows
        elif len(rows):
            write_rows(array, numbers_of(at), np.ascontiguousarray(rows.reshape(len(rows), -1)))

    def state_rows(self, name: str, at: slice | NDArray[np.integer]) -> NDArray[Any]:
        """Some rows of the state for another rank; of `kind` the columns, where each has a table of its own."""
        rows = self._rows(name, at)
        return self._rows("kinds", rows) if name == "kind" and self._of_here else rows

    def _receive_rows(self, name: str, at: slice | NDArray[np.integer], rows: NDArray[Any]) -> None:
        """Write rows of the state that `state_rows` gave; columns of kinds are added to the local table."""
        if name == "kind" and self._of_here:
            new = slice(self._in_table, self._in_table + len(rows))
            self._write_rows("kinds", new, rows)
            self._in_table, rows = new.stop, numbers_of(new)
        self._write_rows(name, at, rows)

    def _empty_table(self, own: int, more: int) -> None:
        """Restart the rank's table of kinds, with room for its own disks and several times as many more."""
        room, wanted = self.arrays.kinds.shape[0], own + more + min(3 * more, own // 2) + 64
        self._in_table = 0
        if not own + more <= room <= 2 * wanted:
            self.arrays.replace("kinds", None)
            self.arrays.make("kinds", wanted)

    def _make_room_in_table(self, more: int) -> None:
        """Make room for more rows in the local table of kinds, if needed by removing those of disks that left."""
        own = self.n_here(part := int(self.arrays.grid.part))
        if self._in_table + more > min(self.arrays.kinds.shape[0], own + more + own // 2 + 64):
            slots = self.arrays.rows_of(part)[0]
            rows = self.state_rows("kind", slots)
            self._empty_table(own, more)
            self._receive_rows("kind", slots, rows)

    # ------------------------------------------------------------------ room

    @property
    def used(self) -> int:
        """Slots that lists of own tiles take at the beginning of the window: the first ones."""
        tile, part = named(self.arrays.values("tile"), "tile"), int(self.arrays.grid.part)
        return int((tile.start[self.arrays.own, part] + tile.count[self.arrays.own, part]).max(initial=0))

    @property
    def _halo_factor(self) -> NDArray[np.floating[Any]]:
        """Halo of each tile over the initial one, which is the same for all."""
        found: NDArray[np.floating[Any]] = named(self.arrays.values("reach"), "reach").halo_factor
        return found

    def make_room(self, slots: int) -> None:
        """Resize the arrays to so many slots, and not many more."""
        if self.arrays.room < slots or self.arrays.room > 4 * slots + 1024:
            self.arrays.make_parts(self.arrays.parts, int(SLACK * slots) + 64)

    # ------------------------------------------------------------------ a window

    def bands(self) -> NDArray[np.float64]:
        """Halo that each own tile begins with, and what it may grow to when it runs again for the first time."""
        wider = np.maximum(k.HALO_DECAY * self._halo_factor[self.arrays.own], 1.0)
        halo = HALO_GROWTH * wider * float(self.arrays.scale.usual_halo)
        return np.minimum(halo, float(self.arrays.scale.most_halo))

    def _near(
        self, q: int, tiles: NDArray[np.intp], slots: NDArray[np.intp], count: NDArray[Any]
    ) -> NDArray[Any]:
        """Mask of the disks of own tiles that are in the halo of a tile of rank q."""
        part = int(self.arrays.grid.part)
        x, y = self._rows("disk", part * self.arrays.room + slots)[:, :2].T
        listed = np.repeat(np.arange(len(tiles)), count)
        sides = [
            np.diff(edge)[index]
            for edge, index in zip(self.arrays.edges, np.divmod(tiles, self.arrays.grid.tiles_y), strict=True)
        ]
        width, height = (side[listed] for side in sides)
        near = np.zeros(len(slots), dtype=bool)
        for (step_x, step_y), neighbors in zip(STEPS, self._neighbors_all[:, tiles], strict=True):
            theirs = (neighbors >= 0) & (self.owner[neighbors] == q)
            if not theirs.any():
                continue
            halo = np.where(theirs, 1.001 * self.band[neighbors], -np.inf)[listed]
            found = theirs[listed]
            for slot, side, step in ((x, width, step_x), (y, height, step_y)):
                if step <= 0:
                    found &= slot <= (halo if step < 0 else side + halo)
                if step >= 0:
                    found &= slot >= (side - halo if step > 0 else -halo)
            near |= found
        return near

    def fetch(self, whole: bool = False) -> None:
        """Get the lists of the ring, or the parts of them within halos."""
        self.build_neighbors()
        part, names = int(self.arrays.grid.part), self.arrays.state_names()
        lists = named(self.arrays.values("tile"), "tile")
        first, count = lists.start[:, part], lists.count[:, part]
        whole = whole or self.arrays.uses.shear
        self.band: NDArray[np.float64] = np.full(self.arrays.tiles, np.inf)
        if not whole:  # owners say how wide the halos of their tiles are
            self.band[self.arrays.own] = self.bands()
            received = self.exchange([(self.band[tiles],) for tiles in self._sent_tiles])
            for tiles, (band,) in zip(self._ghost_tiles, received, strict=True):
                self.band[tiles] = band
        self._sent_slots = []
        messages: list[tuple[NDArray[Any], ...]] = []
        for q, tiles in zip(self._partners, self._sent_tiles, strict=True):
            counts = count[tiles]
            slots = concatenated_ranges(first[tiles], counts)
            if not whole:
                near = self._near(q, tiles, slots, counts)
                slots, listed = slots[near], np.repeat(np.arange(len(tiles)), counts)[near]
                counts = np.bincount(listed, minlength=len(tiles))
            self._sent_slots.append(slots)
            rows = (self.state_rows(name, part * self.arrays.room + slots) for name in names)
            messages.append((counts.astype(np.int32), *rows))
        self.communication.windows += 1
        self.communication.ghosts += sum(each.nbytes for message in messages for each in message)
        self._append_lists(list(zip(self._ghost_tiles, self.exchange(messages), strict=True)))
        self._sent_hashes: list[tuple[NDArray[Any], NDArray[Any]] | None] = [None] * len(self._partners)

    def fetch_all(self) -> None:
        """Get the lists of all other tiles."""
        part, names = int(self.arrays.grid.part), self.arrays.state_names()
        count = named(self.arrays.values("tile"), "tile").count[self.arrays.own, part]
        rows, _listed = self.arrays.rows_of(part)
        lists = (count, *(self.state_rows(name, rows) for name in names))
        found = self.comm.allgather(lists)
        self._append_lists([
            (np.flatnonzero(self.owner == q), found[q]) for q in range(self.comm.size) if q != self.comm.rank
        ])  # fmt: skip

    def _append_lists(self, lists: Sequence[tuple[NDArray[np.intp], tuple[NDArray[Any], ...]]]) -> None:
        """Append lists of other ranks to the own ones: tiles, the lengths of their lists, and rows of the state."""
        part, at, names = int(self.arrays.grid.part), self.used, self.arrays.state_names()
        more = sum(len(rows) for _tiles, (_count, rows, *_more) in lists)
        self.make_room(at + more)
        if self._of_here:
            self._make_room_in_table(more)
        self._ghost_slots: list[slice] = []
        with self.arrays.written("tile") as (tile,):
            for tiles, (count, *arrays) in lists:
                slots = slice(at, at + len(arrays[0]))
                listed = named(tile, "tile")
                listed.count[tiles, part] = count
                listed.start[tiles, part] = at + np.cumsum(count) - count
                for name, rows in zip(names, arrays, strict=True):
                    self._receive_rows(
                        name, slice(part * self.arrays.room + at, part * self.arrays.room + slots.stop), rows
                    )
                self._ghost_slots.append(slots)
                at = slots.stop
        self.arrays.displacement.fill(-1.0)

    def exchange_hashes(self, again: bool) -> None:
        """Get hashes and displacements of all disks in own lists and in those of the ring; in later rounds changes."""
        if not again:
            self._ran = [
                np.flatnonzero(self._rows("displacement", slots) >= 0.0) for slots in self._ghost_slots
            ]
        messages: list[tuple[NDArray[Any], ...]] = [
            (
                ran.astype(np.int32),
                self._rows("history_hash", slots.start + ran),
                self._rows("displacement", slots.start + ran),
            )
            for slots, ran in zip(self._ghost_slots, self._ran, strict=True)
        ]
        size = sum(each.nbytes for message in messages for each in message)
        for given, (ran, hashes, displacements) in zip(
            self._sent_slots, self.exchange(messages), strict=True
        ):
            self._write_rows("history_hash", given[ran], hashes)
            self._write_rows("displacement", given[ran], displacements)
        self.unassigned = int(np.count_nonzero(self.arrays.values("displacement")[: self.used] < 0.0))
        messages = []
        reach = self.arrays.values("reach")
        for q, (given, tiles) in enumerate(zip(self._sent_slots, self._sent_tiles, strict=True)):
            hashes, displacements = self._rows("history_hash", given), self._rows("displacement", given)
            changed = np.arange(len(given), dtype=np.int32)
            if (sent := self._sent_hashes[q]) is not None:
                changed = changed[np.any(hashes != sent[0], axis=1) | (displacements != sent[1])]
            self._sent_hashes[q] = hashes, displacements
            messages.append((changed, hashes[changed], displacements[changed], reach[tiles]))
        size += sum(each.nbytes for message in messages for each in message)
        received = self.exchange(messages)
        with self.arrays.written("reach") as (reach,):
            for slots, tiles, (changed, hashes, displacements, reached) in zip(
                self._ghost_slots, self._ghost_tiles, received, strict=True
            ):
                self._write_rows("history_hash", slots.start + changed, hashes)
                self._write_rows("displacement", slots.start + changed, displacements)
                reach[tiles] = reached
        self.communication.hashes += size
        self.communication.rounds += 1

    def n_short(self, bad: int) -> int:
        """Number of the tiles that have to run again whose halo will be wider than what was fetched."""
        tiles = self.arrays.values("listed")[:bad]
        halo = self._halo_factor[tiles] * float(self.arrays.scale.usual_halo)
        return int(np.count_nonzero(np.minimum(halo, float(self.arrays.scale.most_halo)) > self.band[tiles]))

    def _plan_sums(self) -> None:
        """Find out whose tiles lie in blocks of tiles that other ranks add up: a block is its first tile's owner's."""
        of_block = self.owner[:: k.BLOCK_OF_TILES]
        rank, number = self.comm.rank, np.arange(self.arrays.tiles)
        adder = of_block[number // k.BLOCK_OF_TILES]
        self._adders, self._added_for = (
            [int(q) for q in np.unique(ranks[mine]) if q != rank]
            for ranks, mine in ((adder, self.owner == rank), (self.owner, adder == rank))
        )
        self._tiles_sent = [np.flatnonzero((self.owner == rank) & (adder == q)) for q in self._adders]
        self._tiles_received = [np.flatnonzero((self.owner == q) & (adder == rank)) for q in self._added_for]
        if self._adding is not None:
            self._adding.Free()
        self._adding = self.comm.mpi.Create_dist_graph_adjacent(self._added_for, self._adders)
        own = np.flatnonzero(of_block == rank).astype(np.int32)
        self._own_blocks = own
        self.arrays.replace("blocks", self.arrays.new_array(ti.i32, len(own)))
        with self.arrays.written("blocks") as (blocks,):
            blocks[: len(own)] = own
        self._blocks_by_rank = np.argsort(of_block, kind="stable")
        self._n_blocks = np.bincount(of_block, minlength=self.comm.size)

    def _send_to_adders(self, rows: Sequence[NDArray[Any]]) -> None:
        """Give each block's adder the rows of its tiles, of several arrays by tile: they are written there."""
        wide = sum(each.shape[1] for each in rows)

        def sizes(tiles: list[NDArray[np.intp]]) -> list[int]:
            return [wide * len(each) for each in tiles]

        tiles_sent = np.concatenate([np.zeros(0, np.intp), *self._tiles_sent])
        tiles_received = np.concatenate([np.zeros(0, np.intp), *self._tiles_received])
        sent = np.concatenate([each[tiles_sent].astype(np.float64) for each in rows], axis=1)
        got = np.empty((len(tiles_received), wide))
        self._adding.Neighbor_alltoallv([sent, sizes(self._tiles_sent)], [got, sizes(self._tiles_received)])
        at = 0
        for each in rows:
            each[tiles_received] = got[:, at : at + each.shape[1]]
            at += each.shape[1]
        self.communication.sums += sent.nbytes
        self.communication.messages += len(self._adders)

    def _all_blocks(self, blocks: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums of all blocks, of which this rank knows its own ones."""
        own = np.ascontiguousarray(blocks[self._own_blocks])
        gathered, found = np.empty_like(blocks), np.empty_like(blocks)
        self.comm.mpi.Allgatherv(own, [gathered, self._n_blocks * blocks.shape[1]])
        found[self._blocks_by_rank] = gathered
        self.communication.sums += own.nbytes
        return found

    def sums(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """As on one rank, of rows of which this rank knows its own ones."""
        self._send_to_adders([rows])
        return np.add.accumulate(self._all_blocks(sums_of_blocks(rows)), axis=0)[-1]

    def largest(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """As on one rank, of rows of which this rank knows its own ones."""
        from mpi4py import MPI

        found = super().largest(rows)
        self.comm.mpi.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        return found

    def share(self) -> None:
        """Send the sums over tiles to all ranks."""
        with self.arrays.written("tally", "reach") as rows:
            self._send_to_adders([each.reshape(self.arrays.tiles, -1) for each in rows])
        self.arrays.launch(sum_shared, len(self._own_blocks), 0)
        with self.arrays.written("found") as (found,):
            found[:] = self._all_blocks(found)
        self.arrays.launch(sum_shared, 0, 1)

    def survey(self, *, rough: bool) -> None:
        """As on one rank."""
        super().survey(rough=rough)
        self.share()

    # ------------------------------------------------------------------ running it

    def run(
        self, runner: TileRunner, most: int = 1, *, pausing: bool = False, resuming: bool = False
    ) -> None:
        """As on one rank, of own tiles."""
        with self._timed():
            self._since_look += 1
            if self._since_look >= BETWEEN:
                self._since_look = 0
                self.rebalance()
            self.fetch()
            self._run_on_all(lambda: runner.run_all(most, pausing=pausing, resuming=resuming))
            self.exchange_hashes(again=False)
            self._verify(runner)

    def replay(self, runner: TileRunner) -> None:
        """As on one rank, of own tiles: what was fetched for the window is still there."""
        with self._timed():
            self._run_on_all(runner.replay)
            self.share()

    def run_bad(self, runner: TileRunner) -> None:
        """As on one rank; all tiles begin again where bad ones need more of the ring than was fetched."""
        with self._timed():
            if short := self._short:
                self.fetch(whole=True)
                self.communication.whole += 1
                self._run_on_all(lambda: runner.run_all(again=True))
            else:
                self._run_on_all(runner.run_bad)
            self.exchange_hashes(again=not short)
            self._verify(runner)

    def run_whole_box(self, runner: TileRunner) -> None:
        """Run the window by one thread on each rank, as on one rank."""
        with self._timed():
            self.fetch_all()
            runner.select(np.zeros(1, dtype=np.int32))
            self._run_on_all(lambda: runner.launch(1))
            self._short = False
            runner.rests = self.comm.any(runner.rests)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        """Measure the time of communication: all but the runs of tiles (`_run_on_all`)."""
        began = time.perf_counter()
        yield
        self.communication.seconds += time.perf_counter() - began

    def _run_on_all(self, run: Callable[[], None]) -> None:
        """Run tiles on each rank; all raise the error of one."""

        def run_here() -> None:
            began = time.perf_counter()
            run()
            self.communication.seconds -= time.perf_counter() - began

        self.comm.run_on_all(run_here)

    def _verify(self, runner: TileRunner) -> None:
        """Verify own tiles, by hashes and sums of all ranks; all then know how many tiles are bad."""
        counter = self.arrays.counter
        self.share()
        counter.n_bad = counter.stuck = counter.n_marked = 0
        self.arrays.launch(verify)
        runner.n_bad, runner.n_marked = int(counter.n_bad), int(counter.n_marked)
        found = [runner.n_bad, counter.stuck, runner.rests, self.unassigned, self.n_short(runner.n_bad)]
        n_bad, stuck, rests, unassigned, n_short = self.comm.allreduce(np.array(found, dtype=np.int64))
        if unassigned:
            raise EngineError(
                f"t = {float(self.arrays.clock.begin):.9g}: {unassigned} disks were run by no rank in a window; "
                "please report this"
            )
        counter.n_bad, counter.stuck = n_bad, stuck
        runner.rests, self._short = bool(rests), bool(n_short)

    # ------------------------------------------------------------------ the state

    def load_state(self, state: State) -> None:
        """List the slices of a state in the tiles."""
        self.load(*self.arrays.rows_from(state, self.comm.slice_of(self.arrays.n).start))

    def load(
        self,
        rows: dict[str, NDArray[Any]],
        tile: NDArray[np.integer],
        slot: NDArray[np.integer] | None = None,
    ) -> None:
        """List rows of slices, which are in order of ids, in their tiles, which are divided among the ranks.

        By `slot` in the lists, or by ids without it.
        """
        self.arrays.grid.part = 0
        count = np.bincount(tile, minlength=self.arrays.tiles)
        self.comm.mpi.Allreduce(count.copy(), count)
        self.assign(count)
        if self.arrays.uses.several_kinds:
            of = self._disks
            rows = rows | {
                "kind": kind_rows(of.mass, of.radius, of.k, of.material) if self._of_here else self._kind
            }
        self.list_rows(rows, tile, named(rows["meta"], "meta").id if slot is None else slot)

    def load_lists(self, rows: Mapping[str, Any], listed: Any) -> None:
        """As on one rank, of the rows of slices."""
        self.load(dict(rows), *listed.T)

    def relist(self) -> None:
        """As on one rank; disks go to the ranks that have their tiles."""
        held, listed = self.arrays.rows_held(int(self.arrays.grid.part))
        self.list_rows(held, self.arrays.take_to_tiles(held, listed), listed)

    def list_rows(
        self, rows: dict[str, NDArray[Any]], tile: NDArray[np.integer], slot: NDArray[np.integer]
    ) -> None:
        """List rows in their tiles, by `slot`, on the ranks that own these: at the beginning of a window."""
        tile, slot, *values = self.comm.exchange(self.owner[tile], [tile, slot, *rows.values()])
        self.communication.messages += self.comm.size - 1
        order, part = np.lexsort((slot, tile)), int(self.arrays.grid.part)
        self.make_room(len(order))
        if self._of_here:
            self._empty_table(len(order), 0)
        for name, each in zip(rows, values, strict=True):
            self._receive_rows(
                name, slice(part * self.arrays.room, part * self.arrays.room + len(order)), each[order]
            )
        self.arrays.set_lists(part, np.bincount(tile, minlength=self.arrays.tiles))

    def n_here(self, part: int) -> int:
        """Number of disks that this rank has at the beginning or end of a window, or at a moment in it."""
        lists = 1 - int(self.arrays.grid.part) if part >= k.SNAPSHOT else part
        return int(named(self.arrays.values("tile"), "tile").count[self.arrays.own, lists].sum())

    def by_id(self, part: int, arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
        """Rows of disks here, in the order of slots, as rows of the own slice in order of ids."""
        here = slice(part * self.arrays.room, part * self.arrays.room + self.n_here(part))
        ids = named(self._rows("meta", here), "meta").id.astype(np.int64) - self.first_id
        return self.comm.by_id(self.arrays.n, ids, arrays)
