"""Rows of disks among ranks: which ids a rank has of a whole state, and how rows go from rank to rank.

Rank r of P has the ids from r N // P up to, but not including, (r + 1) N // P, in ascending order: its *slice*. Starts,
frames and checkpoints are stored so, whichever rank moves the disks at that time. Without ranks the only slice is
everything.

Arrays have a row for each disk. They are sent row by row (a derived datatype each), so that counts stay below 2^31
however long a message is in bytes. Sums over all disks are those of blocks of BLOCK ids, added up in order of ids: they
have the same bits for any number of ranks, and of one block those of `numpy.sum`.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError

BLOCK = 1 << 18
"""Ids whose random numbers are drawn, and whose rows are added up, together."""
GATHERED = 1_000_000
"""Disks up to which a run on ranks gathers frames and checkpoints on the root."""


def bounds(n: int, size: int) -> NDArray[np.int64]:
    """First ids of the slices of so many ranks, and the number of disks at the end, shape (size + 1,)."""
    return np.array([rank * n // size for rank in range(size + 1)], dtype=np.int64)


def blocks(ids: range) -> Iterator[range]:
    """Ids from `ids`, block by block."""
    for first in range(ids.start // BLOCK * BLOCK, ids.stop, BLOCK):
        yield range(max(first, ids.start), min(first + BLOCK, ids.stop))


def broadcast_constant_rows(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, in the memory of one row where all are equal to the bit."""
    if len(array) < 2 or array.strides[0] == 0 or array[-1:].tobytes() != array[:1].tobytes():
        return array
    bits = np.ascontiguousarray(array).reshape(len(array), -1).view(np.uint8)
    return np.broadcast_to(array[:1].copy(), array.shape) if bool(np.all(bits == bits[0])) else array


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    starts: NDArray[np.int64] = np.cumsum(counts) - counts
    return starts


@contextlib.contextmanager
def _rows(array: NDArray[Any]) -> Iterator[Any]:
    """A datatype of MPI that is a row of an array."""
    from mpi4py import MPI

    size = array.dtype.itemsize * int(np.prod(array.shape[1:], dtype=np.int64))
    kind = MPI.BYTE.Create_contiguous(size).Commit()
    try:
        yield kind
    finally:
        kind.Free()


@dataclass(frozen=True)
class RowsByBlock:
    """Rows of n disks that `work` computes for a slice of them, a block at a time: they are never all in memory.

    Of a row `dtype` and shape (`tail`); `step` rows are computed at a time where all are, by default BLOCK.
    """

    n: int
    work: Callable[[slice], NDArray[Any]]
    dtype: np.dtype[Any] = np.dtype(np.float64)  # noqa: RUF009 a constant
    tail: tuple[int, ...] = ()
    step: int = 0

    def __len__(self) -> int:
        return self.n

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        return self.work(rows)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of all rows."""
        return (self.n, *self.tail)


Table = NDArray[Any] | RowsByBlock
"""Rows of disks, in memory or not."""


def pieces(rows: Table) -> Iterator[tuple[int, NDArray[Any]]]:
    """Rows in pieces, each contiguous in memory, with the number of its first row; an array of no axis as one row."""
    if isinstance(rows, np.ndarray | np.generic) and rows.ndim == 0:
        rows = np.reshape(rows, 1)
    step = (rows.step if isinstance(rows, RowsByBlock) else 0) or BLOCK
    for first in range(0, len(rows), step):
        yield first, np.ascontiguousarray(rows[first : min(first + step, len(rows))])


class Distribution:
    """The methods of a `Communicator` on rows of disks."""

    mpi: Any
    rank: int
    size: int
    if TYPE_CHECKING:
        bcast: Callable[[Any], Any]
        allgather: Callable[[Any], list[Any]]
        allreduce: Callable[[Any], Any]

    def slice_of(self, n: int) -> range:
        """Ids of this rank's slice of n disks."""
        return range(self.rank * n // self.size, (self.rank + 1) * n // self.size)

    def number(self, count: int) -> tuple[range, int]:
        """Ids of `count` disks of this rank, where those of lower ranks come first, and the number of all."""
        counts = self.allgather(count)
        first = sum(counts[: self.rank])
        return range(first, first + count), sum(counts)

    def exchange(self, to: NDArray[np.integer], arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
        """Rows that ranks send here: those of lower ranks first, each rank's in its order.

        Row i of each array goes to rank `to[i]`. All ranks call this with as many arrays of the same kinds.
        """
        if self.size == 1:
            return list(arrays)
        order = np.argsort(to, kind="stable")
        return self._alltoall(np.bincount(to, minlength=self.size), (each[order] for each in arrays))

    def _alltoall(self, counts: NDArray[np.integer], arrays: Iterable[NDArray[Any]]) -> list[NDArray[Any]]:
        """As `exchange`, of arrays that hold `counts[q]` rows for each rank q, one rank after another."""
        sent = np.asarray(counts, dtype=np.int64)
        taken = np.empty_like(sent)
        self.mpi.Alltoall(sent, taken)
        found = []
        for each in arrays:
            rows = np.empty((int(taken.sum()), *each.shape[1:]), each.dtype)
            with _rows(each) as kind:
                self.mpi.Alltoallv(
                    [np.ascontiguousarray(each), (sent, _starts(sent)), kind],
                    [rows, (taken, _starts(taken)), kind],
                )
            found.append(rows)
        return found

    def by_id(self, n: int, ids: NDArray[np.integer], arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
        """Rows of the own slice of n disks, in order of ids, of rows that are anywhere; `ids` are those of rows here.

        EngineError, on all ranks, if a disk is nowhere or there twice.
        """
        own = self.slice_of(n)
        slot, rows = ids, list(arrays)
        if self.size > 1:
            to = np.searchsorted(bounds(n, self.size), ids, side="right") - 1
            whole = bool(np.all((ids >= 0) & (ids < n)))
            received_ids, *rows = self.exchange(
                to if whole else np.zeros_like(to), [np.asarray(ids, np.int64), *arrays]
            )
            slot = np.asarray(received_ids, np.int64) - own.start
        good = len(slot) == len(own)
        if good and len(own):
            there = np.zeros(len(own), dtype=bool)
            good = int(slot.min()) >= 0 and int(slot.max()) < len(own)
            there[slot if good else 0] = True
            good = good and bool(there.all())
        if self.allreduce(int(not good)):
            raise EngineError("a disk is on no rank, or on two: please report this")
        found = []
        for each in rows:
            ordered = np.empty_like(each)
            ordered[slot] = each
            found.append(ordered)
        return found

    def rows_of(self, n: int, ids: NDArray[np.integer], arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
        """Rows of these ids, which differ by rank, of n disks of which each rank gives those of its slice."""
        if self.size == 1:
            return [each[ids] for each in arrays]
        owner = np.searchsorted(bounds(n, self.size), ids, side="right") - 1
        return self.rows_of_owners(owner, ids, self.slice_of(n).start, arrays)

    def rows_of_owners(
        self,
        owner: NDArray[np.integer],
        number: NDArray[np.integer],
        first: int,
        arrays: Sequence[NDArray[Any]],
    ) -> list[NDArray[Any]]:
        """Rows with these numbers that the ranks `owner` have; those here are numbered from `first` on."""
        requester, numbers = self.exchange(
            owner, [np.full(len(number), self.rank), np.asarray(number, np.int64)]
        )
        # Answers come in the order of the ranks that give them.
        answers = self.exchange(requester, [each[numbers - first] for each in arrays])
        order, found = np.argsort(owner, kind="stable"), []
        for each in answers:
            rows = np.empty_like(each)
            rows[order] = each
            found.append(rows)
        return found

    def gather_rows(self, n: int, arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]] | None:
        """Rows of all n disks, of which each rank gives its slice: on the root; None on the others.

        Equal rows in the memory of one (stride 0) stay so, if they are equal on all ranks.
        """
        if self.size == 1:
            return list(arrays)
        counts, found = np.diff(bounds(n, self.size)), []
        for each in arrays:
            constant = self.allgather(each[:1].tobytes() if each.strides[0] == 0 else None)
            if constant[0] is not None and len(set(constant)) == 1:
                found.append(np.broadcast_to(each[:1].copy(), (n, *each.shape[1:])))
                continue
            rows = np.empty((n if self.rank == 0 else 0, *each.shape[1:]), each.dtype)
            with _rows(each) as kind:
                self.mpi.Gatherv(
                    [np.ascontiguousarray(each), len(each), kind], [rows, (counts, _starts(counts)), kind]
                )
            found.append(rows)
        return found if self.rank == 0 else None

    def scatter_rows(self, n: int, arrays: Sequence[NDArray[Any]] | None) -> list[NDArray[Any]]:
        """Rows of the own slice of n disks, all of which the root gives; the others give None.

        Equal rows in the memory of one (stride 0) stay so.
        """
        if self.size == 1:
            return list(arrays or ())
        given = None if arrays is None else [
            (each.dtype, each.shape[1:], each[:1].copy() if each.strides[0] == 0 else None) for each in arrays
        ]  # fmt: skip
        counts, found = np.diff(bounds(n, self.size)), []
        for i, (dtype, shape, same) in enumerate(self.bcast(given)):
            length = int(counts[self.rank])
            if same is not None:
                found.append(np.broadcast_to(same, (length, *shape)))
                continue
            rows = np.empty((length, *shape), dtype)
            with _rows(rows) as kind:
                sent = None
                if arrays is not None:
                    sent = [np.ascontiguousarray(arrays[i]), (counts, _starts(counts)), kind]
                self.mpi.Scatterv(sent, [rows, length, kind])
            found.append(rows)
        return found

    def _of_blocks(self, rows: NDArray[Any] | RowsByBlock, work: Callable[[NDArray[Any]], Any]) -> list[Any]:
        """Results of `work` on the rows of each block, in order; on all ranks.

        Each gives the rows of some ids in order, those of lower ranks come first. A block is made by the rank that has
        its first id.
        """
        whole = rows
        if self.size > 1:
            rows = rows[:]
            ids, n = self.number(len(rows))
            firsts = np.array([*self.allgather(ids.start), n])
            limits = np.minimum(-(-firsts // BLOCK) * BLOCK, n)  # of the blocks of each rank
            whole = self._alltoall(np.diff(np.clip(limits, ids.start, ids.stop)), [rows])[0]
        found = [work(whole[at : at + BLOCK]) for at in range(0, len(whole), BLOCK)]
        return [each for those in self.allgather(found) for each in those]

    def total(self, rows: NDArray[Any] | RowsByBlock) -> Any:
        """The sum of the rows of all disks, of which each rank gives its slice: the same bits on any number."""
        sums = self._of_blocks(rows, lambda block: np.sum(block, axis=0))
        return functools.reduce(operator.add, sums) if sums else np.sum(rows[:], axis=0)

    def digest(self, rows: NDArray[Any]) -> bytes:
        """A hash of the rows of all disks, on all ranks, of which each gives those of its slice."""
        parts = self._of_blocks(rows, lambda block: hashlib.sha256(np.ascontiguousarray(block).data).digest())
        return hashlib.sha256(f"{rows.dtype.str} {rows.shape[1:]}".encode() + b"".join(parts)).digest()
