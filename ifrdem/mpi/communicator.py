"""Ranks of MPI behind one object, `Communicator`: messages, work that one rank does for all, errors that all raise.

A process by itself has one too, `SERIAL`, of size 1, on which every method is defined: no code asks whether there are
ranks. Nothing here imports mpi4py before a launcher has started several ranks, or a user gives a communicator of it.
"""

from __future__ import annotations

import contextvars
import operator
import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError, InputError, Stopped, TrajectoryError, install_extra, shortened
from .distribution import Distribution

Result = TypeVar("Result")
Function = TypeVar("Function", bound=Callable[..., Any])

SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE", "PALS_NRANKS")
"""Variables in which launchers give the number of ranks: MPICH, Intel MPI and `srun --mpi`, Open MPI, MVAPICH, PALS."""
TIMEOUT = 20.0
"""Seconds that a rank which ends by an error waits for the others to do so; then it ends them all."""
POLL_INTERVAL = 0.02
"""Seconds between two looks of a rank that waits asleep."""


class _SingleProcess:
    """The communicator of mpi4py that a process by itself would have: each message comes back at once."""

    rank, size = 0, 1

    def bcast(self, value: Any) -> Any:
        """The value."""
        return value

    def allgather(self, value: Any) -> list[Any]:
        """The value in a list."""
        return [value]

    gather = allgather

    def allreduce(self, value: Any, op: Any = None) -> Any:
        """The value."""
        return value


class Communicator(Distribution):
    """The ranks of MPI that share a gas; by default, this process by itself.

    All ranks call the same methods in the same order. Within `with communicator:`, the arrays of functions such as
    `ifrdem.initial.maxwellian` have the rows of this rank's slice of the disks (`slice_of`), and sums are those of all
    ranks.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm, Communicator or None
        The ranks; None for this process by itself.
    distributed : bool
        True: each rank gives and gets the disks of its slice, and none has all of them. False: the first rank (the
        root) gives and gets all disks.

    Raises
    ------
    InputError
        If `comm` is no communicator of mpi4py.

    Examples
    --------
    >>> import ifrdem
    >>> comm = ifrdem.mpi.Communicator()
    >>> comm.size, comm.is_root, comm.allgather("a")
    (1, True, ['a'])
    """

    def __init__(self, comm: Any = None, *, distributed: bool = False) -> None:
        given = comm.mpi if isinstance(comm, Communicator) else comm
        if given is not None and not (hasattr(given, "allgather") and hasattr(given, "rank")):
            raise InputError(
                f"comm = {shortened(comm)}: must be a communicator of mpi4py, such as MPI.COMM_WORLD, or None"
            )
        self.mpi: Any = given if given is not None and given.size > 1 else _SingleProcess()
        self.rank: int = self.mpi.rank
        self.size: int = self.mpi.size
        self.is_distributed: bool = distributed and self.size > 1

    @classmethod
    def of(cls, comm: Any) -> Communicator:
        """The communicator of an argument `comm`."""
        return comm if isinstance(comm, Communicator) else cls(comm)

    def __enter__(self) -> Communicator:
        _outer.set((*_outer.get(), _current.get()))
        _current.set(self)
        return self

    def __exit__(self, kind: type[BaseException] | None = None, *_: object) -> None:
        *outer, before = _outer.get()
        _outer.set(tuple(outer))
        _current.set(before)
        if kind is None and self.size > 1 and self not in (*outer, before):
            self.require_same_call("leaves the block")

    def __repr__(self) -> str:
        return f"Communicator(rank {self.rank} of {self.size}{', distributed' * self.is_distributed})"

    @property
    def has_all(self) -> bool:
        """True on a rank that has been given all disks: the root, unless they are distributed."""
        return self.is_root and not self.is_distributed

    @property
    def is_root(self) -> bool:
        """True on the rank that speaks and writes for all, the first one."""
        return self.rank == 0

    # ------------------------------------------------------------------ messages

    def bcast(self, value: Result) -> Result:
        """The value that the root gives."""
        found: Result = self.mpi.bcast(value)
        return found

    def allgather(self, value: Result) -> list[Result]:
        """The values of all ranks, in order, on all."""
        found: list[Result] = self.mpi.allgather(value)
        return found

    def gather(self, value: Result) -> list[Result] | None:
        """The values of all ranks, in order, on the root; None on the others."""
        found: list[Result] | None = self.mpi.gather(value)
        return found

    def allreduce(self, value: Result) -> Result:
        """The sum of numbers, or of arrays of whole numbers, of all ranks."""
        found: Result = self.mpi.allreduce(value)
        return found

    def largest(self, value: float) -> float:
        """The largest of the values of all ranks."""
        return max(self.allgather(value))

    def any(self, flag: object) -> bool:
        """True on all ranks if it is true on one."""
        return bool(self.allreduce(int(bool(flag))))

    def nth_smallest(self, ordered: NDArray[np.float64], numbers: Sequence[int]) -> list[float]:
        """The n-th smallest value of all ranks, for each n = 1, 2, ... of `numbers`; infinity beyond the last.

        `ordered` has the values of this rank, 0 or more, in order. The same `numbers` are given on all ranks. Found by
        halving of the values' bits as integers, which have the same order.
        """
        bits, wanted = ordered.view(np.int64), np.asarray(numbers, dtype=np.int64)
        low = np.zeros(len(wanted), dtype=np.int64)
        high = np.full(len(wanted), np.float64(np.inf).view(np.int64))
        while np.any(low < high):
            middle = low + (high - low) // 2
            reached = self.allreduce(np.searchsorted(bits, middle, side="right")) >= wanted
            reached |= low >= high
            low, high = np.where(reached, low, middle + 1), np.where(reached, middle, high)
        found: list[float] = low.view(np.float64).tolist()
        return found

    def first_texts(self, texts: Sequence[str], count: int, most: int) -> tuple[list[str], int]:
        """At most so many texts of all ranks, of lower ranks first, and the sum of their counts."""
        found = self.allgather((list(texts[:most]), count))
        return [text for some, _ in found for text in some][:most], sum(here for _, here in found)

    def require_equal(self, text: str, what: str) -> None:
        """Raise InputError on all ranks if the text differs from rank to rank."""
        if len(set(self.allgather(text))) > 1:
            raise InputError(f"{what} differ from rank to rank: all have to run the same lines")

    def require_same_call(self, call: str) -> None:
        """Raise InputError on all ranks unless all of them are in this call.

        MPI matches messages by their order: a rank that leaves out a call would keep the others waiting for ever.
        """
        calls = self.allgather(call)
        if len({*calls}) > 1:
            ranks = ", ".join(f"rank {rank} {each}" for rank, each in enumerate(calls[:4]))
            raise InputError(
                f"ranks are in different calls in a block `with Communicator(...)`: {ranks}"
                f"{', ...' if len(calls) > 4 else ''}: all of them have to run the same lines"
            )

    # ------------------------------------------------------------------ work and errors

    def raise_collectively(self, error: BaseException | None) -> None:
        """Return if no rank has an error; else all ranks raise that of the lowest one."""
        if not self.any(error is not None):
            return
        parts = next(each for each in self.allgather(_parts_of(error)) if each is not None)
        if error is not None and _parts_of(error) == parts:
            raise error
        raise _error_of(*parts)

    def run_on_all(self, work: Callable[[], Result]) -> Result:
        """Do work on each rank, as a process by itself, and return its own result; all raise the error of one."""
        result, error = None, None
        try:
            with SERIAL:
                result = work()
        # Not swallowed: raised on all ranks, which else would wait for this one.
        except BaseException as raised:
            error = raised
        self.raise_collectively(error)
        return result  # type: ignore[return-value]  # there was no error

    def run_on_root(self, work: Callable[[], Result]) -> Result | None:
        """Do work on the root, as a process by itself, and return its result; None on others. All raise its error."""
        result, error = None, None
        if self.is_root:
            try:
                with SERIAL:
                    result = work()
            # Not swallowed: raised on all ranks, which else would wait for this one.
            except BaseException as raised:
                error = raised
        parts = self.bcast(_parts_of(error))
        if error is not None:
            raise error
        if parts is not None:
            raise _error_of(*parts)
        return result

    def root_result(self, work: Callable[[], Result]) -> Result:
        """Do work on the root, and return its result on all ranks; all raise its error."""
        return self.bcast(self.run_on_root(work))  # type: ignore[return-value]  # it is the root's that all get

    def run_on_slices(self, work: Callable[[], Result]) -> Result:
        """As `run_on_all`; an InputError says which rank numbers the disks in it."""

        def numbered() -> Result:
            try:
                return work()
            except InputError as error:
                if self.size == 1:
                    raise
                text = f"{error} (rank {self.rank} numbers the disks of its slice from 0 on)"
                raise InputError(text) from None

        return self.run_on_all(numbered)

    def run_on_holders(self, work: Callable[[], Result]) -> Result | None:
        """Do work on the ranks that have been given disks: all where they are distributed, else the root."""
        return self.run_on_slices(work) if self.is_distributed else self.run_on_root(work)

    def result_of_holders(self, work: Callable[[], Result]) -> Result:
        """Result of a collective function of the ranks that have been given disks, on all ranks."""
        if not self.is_distributed:
            return self.root_result(work)
        with self:
            return work()

    def run_on_first(self, count: int, work: Callable[[Communicator], Result]) -> Result | None:
        """Do work on the first ranks, with a communicator of these; the others sleep. All raise an error of one."""
        result, error = None, None
        mine = self.rank < count
        part = self.mpi.Split(0 if mine else _undefined()) if self.size > 1 else self.mpi
        if mine:
            try:
                with SERIAL:
                    result = work(Communicator(part))
            # Not swallowed: raised on all ranks, which else would wait for this one.
            except BaseException as raised:
                error = raised
        if self.size > 1:
            done = self.mpi.Ibarrier()
            while not done.Test():
                time.sleep(POLL_INTERVAL)
        self.raise_collectively(error)
        return result

    # ------------------------------------------------------------------ machines

    def _local(self) -> tuple[int, int]:
        """Number of this rank among those of its machine, and how many these are."""
        if self.size == 1:
            return 0, 1
        from mpi4py import MPI

        here = self.mpi.Split_type(MPI.COMM_TYPE_SHARED)
        found = int(here.rank), int(here.size)
        here.Free()
        return found

    @property
    def local_rank(self) -> int:
        """Number of this rank among those of its machine; asked by all."""
        return self._local()[0]

    @property
    def local_share(self) -> float:
        """Fraction of the ranks that this machine has; asked by all."""
        return self._local()[1] / self.size

    def share_of_cores(self, cores: int) -> int:
        """Cores for each rank of a machine that has so many; asked by all."""
        return max(cores // self._local()[1], 1)


SERIAL = Communicator()
"""The communicator of a process by itself."""
_current: contextvars.ContextVar[Communicator] = contextvars.ContextVar("communicator", default=SERIAL)
_outer: contextvars.ContextVar[tuple[Communicator, ...]] = contextvars.ContextVar("outer", default=())
"""Those of the `with` blocks around the present one, of each thread."""


def current() -> Communicator:
    """The communicator of the `with` block that this is called in; `SERIAL` outside."""
    return _current.get()


def collective(function: Function) -> Function:
    """Mark a function that all ranks of the present communicator call together, and say so in its docstring.

    `validated` checks that they do, and raises an error of one on all.
    """
    vars(function)["collective"] = True
    if function.__doc__:  # Python drops them with -OO
        summary, _, rest = function.__doc__.partition("\n\n")
        margin = rest[: len(rest) - len(rest.lstrip(" "))] or "    "
        function.__doc__ = f"{summary.rstrip()}\n\n{margin}{COLLECTIVE}\n\n{rest}"
    return function


COLLECTIVE = "Collective in a block `with` ranks (`ifrdem.mpi.Communicator`): all of them call it together."


def started() -> bool:
    """True if a launcher has started this process as one of several ranks."""
    found = next((os.environ[name] for name in SIZES if name in os.environ), "1")
    return found.isdecimal() and int(found) > 1


_world: Communicator = SERIAL


def world() -> Communicator:
    """All ranks that a launcher has started; `SERIAL` if it has not.

    Raises InputError if mpi4py is not installed, or belongs to another MPI.
    """
    global _world
    if _world.size == 1 and started():
        try:
            from mpi4py import MPI
        except (ImportError, RuntimeError) as error:  # no mpi4py, or no MPI that it finds
            raise InputError(
                f"started on several ranks, which requires the extra mpi: {install_extra('mpi')} ({error})"
            ) from None
        if MPI.COMM_WORLD.size == 1:  # mpi4py speaks another MPI than the launcher: each rank would do all
            raise InputError(
                "started on several ranks by a launcher that belongs to another MPI than mpi4py: every rank would "
                "compute the whole gas. `python -m mpi4py --mpi-lib-version` says which one mpi4py uses"
            )
        _world = Communicator(MPI.COMM_WORLD)
    return _world


def is_single_process() -> bool:
    """True if no other rank shares the present gas."""
    return _world.size == 1


def end(status: int, message: str, complain: Callable[[str], None]) -> int:
    """End this rank with an exit status; the root shows the message of an error.

    Where the other ranks do not come to an end as well, this one ends them: they would wait for it for ever.
    """
    comm = _world
    if comm.size == 1 or status == 0:
        if message:
            complain(message)
        return status
    if comm.is_root and message:
        complain(message)
    all_end, started = comm.mpi.Ibarrier(), time.monotonic()
    while not all_end.Test():
        if time.monotonic() - started > TIMEOUT:
            if not comm.is_root:
                complain(f"rank {comm.rank}: {message}")
            sys.stdout.flush()
            sys.stderr.flush()
            comm.mpi.Abort(status)
        time.sleep(POLL_INTERVAL)
    return status


def _undefined() -> int:
    from mpi4py import MPI

    return int(MPI.UNDEFINED)


def _kinds() -> dict[str, type[BaseException]]:
    """Errors that ranks send each other, by name; those that are EngineErrors before that class."""
    kinds = (
        Stopped,
        InputError,
        TrajectoryError,
        *EngineError.__subclasses__(),
        EngineError,
        KeyboardInterrupt,
    )
    return {each.__name__: each for each in kinds}


def _parts_of(error: BaseException | None) -> tuple[str, str, int] | None:
    """Parts of an error that are sent: its kind, its text, an exit status."""
    if error is None:
        return None
    for name, kind in _kinds().items():
        if isinstance(error, kind):
            return name, str(error), getattr(error, "status", 0)
    return "EngineError", f"{type(error).__name__}: {error}", 0


def _error_of(name: str, text: str, status: int) -> BaseException:
    return Stopped(text, status) if name == "Stopped" else _kinds()[name](text)


def slice_of(n: int, comm: Any = None) -> range:
    """Ids of this rank's slice of n disks; all of them without ranks.

    Parameters
    ----------
    n : int
        Number of all disks.
    comm : mpi4py.MPI.Comm or Communicator, optional
        The ranks; by default those of the `with` block (`Communicator`), or this process by itself.

    Raises
    ------
    InputError
        If n is no integer from 0 on, or `comm` no communicator.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.slice_of(10)
    range(0, 10)
    """
    try:
        number = -1 if isinstance(n, bool) else operator.index(n)
    except TypeError:
        number = -1
    if not 0 <= number < 2**63:
        raise InputError(f"n = {shortened(n)}: must be an integer from 0 to {2**63 - 1}")
    return (current() if comm is None else Communicator.of(comm)).slice_of(number)
