"""Slices: the disks that a rank of MPI keeps of a whole state, by their ids; how rows go from rank to rank.

Rank r of P has the ids from r N // P up to, but not including, (r + 1) N // P, in ascending order. Starts, frames and
checkpoints are told so, whoever moves the disks at that time. Without ranks (`comm` None) the only slice is everything.

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
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, InputError
from ..tools.checked import Comm, Integer, validated
from . import communicator

Result = TypeVar("Result")

BLOCK = 1 << 18
"""Ids whose random numbers are drawn, and whose rows are added up, together."""
GATHERED = 1_000_000
"""Disks up to which a run on ranks gathers frames and checkpoints on the first one."""


def bounds(n: int, size: int) -> NDArray[np.int64]:
    """First ids of the slices of so many ranks, and the number of disks at the end, shape (size + 1,)."""
    return np.array([rank * n // size for rank in range(size + 1)], dtype=np.int64)


@validated
def slice_of(n: Annotated[int, Integer(0, 2**63 - 1)], comm: Comm = None) -> range:
    """Ids of this rank's slice of n disks; all of them without ranks.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.slice_of(10)
    range(0, 10)
    """
    if comm is None:
        return range(n)
    return range(comm.rank * n // comm.size, (comm.rank + 1) * n // comm.size)


def blocks(ids: range) -> Iterator[range]:
    """Ids from `ids`, block by block."""
    for first in range(ids.start // BLOCK * BLOCK, ids.stop, BLOCK):
        yield range(max(first, ids.start), min(first + BLOCK, ids.stop))


def exchange(comm: Any, to: NDArray[np.integer], arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """Rows that ranks send here: those of lower ranks first, each rank's in its order.

    Row i of each array goes to rank `to[i]`. All ranks call this with as many arrays of the same kinds.
    """
    order = np.argsort(to, kind="stable")
    return _swapped(comm, np.bincount(to, minlength=comm.size), (each[order] for each in arrays))


def _swapped(comm: Any, counts: NDArray[np.integer], arrays: Iterable[NDArray[Any]]) -> list[NDArray[Any]]:
    """As `exchange`, of arrays that hold `counts[q]` rows for each rank q, one rank after another."""
    sent = np.asarray(counts, dtype=np.int64)
    taken = np.empty_like(sent)
    comm.Alltoall(sent, taken)
    found = []
    for each in arrays:
        rows = np.empty((int(taken.sum()), *each.shape[1:]), each.dtype)
        with _rows(each) as kind:
            comm.Alltoallv(
                [np.ascontiguousarray(each), (sent, _starts(sent)), kind],
                [rows, (taken, _starts(taken)), kind],
            )
        found.append(rows)
    return found


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


def by_id(comm: Any, n: int, ids: NDArray[np.integer], arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """Rows of the own slice of n disks, in order of ids, of rows that are anywhere; `ids` are those of the rows here.

    EngineError, on all ranks, if a disk is nowhere or there twice.
    """
    first = slice_of(n, comm)
    if comm is None:
        told, rows = ids, list(arrays)
    else:
        to = np.searchsorted(bounds(n, comm.size), ids, side="right") - 1
        whole = bool(np.all((ids >= 0) & (ids < n)))
        told, *rows = exchange(comm, to if whole else np.zeros_like(to), [np.asarray(ids, np.int64), *arrays])
    place = np.asarray(told, np.int64) - first.start
    inside = (place >= 0) & (place < len(first))
    good = len(place) == len(first) and bool(inside.all())
    good = good and bool((np.bincount(place, minlength=len(first)) == 1).all())
    if not (good if comm is None else comm.allreduce(int(not good)) == 0):
        raise EngineError("a disk is on no rank, or on two: please report this")
    found = []
    for each in rows:
        ordered = np.empty_like(each)
        ordered[place] = each
        found.append(ordered)
    return found


def gather(comm: Any, n: int, arrays: Sequence[NDArray[Any]]) -> list[NDArray[Any]] | None:
    """Rows of all n disks, of which each rank gives its slice: on the first one; None on the others.

    Equal rows in the memory of one (stride 0) stay so, if they are equal on all ranks.
    """
    if comm is None:
        return list(arrays)
    counts, found = np.diff(bounds(n, comm.size)), []
    for each in arrays:
        told = comm.allgather(each[:1].tobytes() if each.strides[0] == 0 else None)
        if told[0] is not None and len(set(told)) == 1:
            found.append(np.broadcast_to(each[:1].copy(), (n, *each.shape[1:])))
            continue
        rows = np.empty((n if comm.rank == 0 else 0, *each.shape[1:]), each.dtype)
        with _rows(each) as kind:
            comm.Gatherv(
                [np.ascontiguousarray(each), len(each), kind], [rows, (counts, _starts(counts)), kind]
            )
        found.append(rows)
    return found if comm.rank == 0 else None


def scatter(comm: Any, n: int, arrays: Sequence[NDArray[Any]] | None) -> list[NDArray[Any]]:
    """Rows of the own slice of n disks, all of which the first rank gives; the others give None.

    Equal rows in the memory of one (stride 0) stay so.
    """
    if comm is None:
        return list(arrays or ())
    given = None if arrays is None else [
        (each.dtype, each.shape[1:], each[:1].copy() if each.strides[0] == 0 else None) for each in arrays
    ]  # fmt: skip
    counts, found = np.diff(bounds(n, comm.size)), []
    for i, (dtype, shape, same) in enumerate(comm.bcast(given)):
        length = int(counts[comm.rank])
        if same is not None:
            found.append(np.broadcast_to(same, (length, *shape)))
            continue
        rows = np.empty((length, *shape), dtype)
        with _rows(rows) as kind:
            sent = None
            if arrays is not None:
                sent = [np.ascontiguousarray(arrays[i]), (counts, _starts(counts)), kind]
            comm.Scatterv(sent, [rows, length, kind])
        found.append(rows)
    return found


def numbered(count: int, comm: Any = None) -> tuple[range, int]:
    """Ids of `count` disks of this rank, where those of lower ranks come first, and the number of all."""
    counts = [count] if comm is None else comm.allgather(count)
    first = sum(counts[: 0 if comm is None else comm.rank])
    return range(first, first + count), sum(counts)


def _of_blocks(comm: Any, rows: NDArray[Any], work: Callable[[NDArray[Any]], Any]) -> list[Any]:
    """Results of `work` on the rows of each block, in order; on all ranks.

    Each gives the rows of some ids in order, those of lower ranks come first. A block is made by the rank that has its
    first id.
    """
    whole = rows
    if comm is not None:
        ids, n = numbered(len(rows), comm)
        firsts = np.array([*comm.allgather(ids.start), n])
        limits = np.minimum(-(-firsts // BLOCK) * BLOCK, n)  # of the blocks of each rank
        whole = _swapped(comm, np.diff(np.clip(limits, ids.start, ids.stop)), [rows])[0]
    found = [work(whole[at : at + BLOCK]) for at in range(0, len(whole), BLOCK)]
    return found if comm is None else [each for those in comm.allgather(found) for each in those]


def total(rows: NDArray[Any], comm: Any = None) -> Any:
    """The sum of the rows of all disks, with the same bits on any number of ranks: each gives those of its slice."""
    sums = _of_blocks(comm, rows, lambda block: np.sum(block, axis=0))
    return functools.reduce(operator.add, sums) if sums else np.sum(rows, axis=0)


def digest(rows: NDArray[Any], comm: Any = None) -> bytes:
    """A hash of the rows of all disks, on all ranks, of which each gives those of its slice."""
    parts = _of_blocks(comm, rows, lambda block: hashlib.sha256(np.ascontiguousarray(block).data).digest())
    return hashlib.sha256(f"{rows.dtype.str} {rows.shape[1:]}".encode() + b"".join(parts)).digest()


def run_on_slices(comm: Any, work: Callable[[], Result]) -> Result:
    """Have each rank look at its slice. An InputError of one is raised on all, and tells whose disks it numbers."""

    def told() -> Result:
        try:
            return work()
        except InputError as error:
            raise InputError(f"{error} (rank {comm.rank} numbers the disks of its slice from 0 on)") from None

    return communicator.run_on_all(comm, told)
