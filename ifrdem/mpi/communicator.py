"""Ranks of MPI: who is there, work that one of them does for all, and errors that all raise alike.

Nothing here imports mpi4py before it is asked for, and a plain run never asks.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from ..errors import EngineError, InputError, Stopped, TrajectoryError

Result = TypeVar("Result")

SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE", "PALS_NRANKS")
"""Variables by which launchers tell the number of ranks: MPICH, Intel MPI and `srun --mpi`, Open MPI, MVAPICH, PALS."""
PATIENCE = 20.0
"""Seconds that a rank which ends by an error waits for the others to do so; then it ends them all."""

_world: Any = None


def started() -> bool:
    """Tell if a launcher has started this process as one of several ranks."""
    found = next((os.environ[name] for name in SIZES if name in os.environ), "1")
    return found.isdecimal() and int(found) > 1


def world() -> Any:
    """The communicator of all ranks that a launcher has started; None where this process is alone.

    Raises InputError if mpi4py is not installed.
    """
    global _world
    if _world is None and started():
        try:
            from mpi4py import MPI
        except (ImportError, RuntimeError) as error:  # no mpi4py, or no MPI that it finds
            raise InputError(
                f"started on several ranks, which needs the extra mpi: pip install 'ifrdem[mpi]' ({error})"
            ) from None
        if MPI.COMM_WORLD.size == 1:  # mpi4py speaks another MPI than the launcher: each rank would do all
            raise InputError(
                "started on several ranks by a launcher that belongs to another MPI than mpi4py: every rank would "
                "compute the whole gas. `python -m mpi4py --mpi-lib-version` says which one mpi4py uses"
            )
        _world = MPI.COMM_WORLD
    return _world


def is_alone() -> bool:
    """Tell if this process shares nothing with other ranks so far."""
    return _world is None


def is_root(comm: Any) -> bool:
    """Tell if this rank speaks and writes for all."""
    return comm is None or comm.rank == 0


def _here(comm: Any) -> tuple[int, int]:
    """Number of this rank among those of its machine, and how many these are; called by all."""
    from mpi4py import MPI

    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    found = int(here.rank), int(here.size)
    here.Free()
    return found


def cores_here(comm: Any, cores: int) -> int:
    """Cores for each rank of a machine that has so many; called by all."""
    return max(cores // _here(comm)[1], 1)


def number_here(comm: Any) -> int:
    """Number of this rank among those of its machine; called by all."""
    return _here(comm)[0]


def share_here(comm: Any) -> float:
    """Part of the ranks that this machine has; called by all."""
    return 1.0 if comm is None else _here(comm)[1] / comm.size


def raise_collectively(comm: Any, error: BaseException | None) -> None:
    """Return if no rank has an error; else all ranks raise that of the lowest one."""
    if comm is None:
        if error is not None:
            raise error
        return
    if not comm.allreduce(error is not None):
        return
    told = next(each for each in comm.allgather(_told(error)) if each is not None)
    if error is not None and _told(error) == told:
        raise error
    raise _made(*told)


def run_on_all(comm: Any, work: Callable[[], Result]) -> Result:
    """Have each rank do something, and give its own result. An error of one is raised on all."""
    if comm is None:
        return work()
    result, error = None, None
    try:
        result = work()
    except BaseException as raised:
        error = raised
    raise_collectively(comm, error)
    return result  # type: ignore[return-value]  # there was no error


def run_on_root(comm: Any, work: Callable[[], Result]) -> Result | None:
    """Have the first rank do something, and give its result; None on the others. An error is raised on all."""
    if comm is None:
        return work()
    result, error = None, None
    if comm.rank == 0:
        try:
            result = work()
        except BaseException as raised:
            error = raised
    told = comm.bcast(_told(error))
    if error is not None:
        raise error
    if told is not None:
        raise _made(*told)
    return result


def bcast(comm: Any, value: Result) -> Result:
    """Value that the first rank gives."""
    return value if comm is None else comm.bcast(value)


def root_result(comm: Any, work: Callable[[], Result]) -> Result:
    """Have the first rank do something, and give all its result. An error is raised on all."""
    return bcast(comm, run_on_root(comm, work))  # type: ignore[return-value]  # it is the first one's that all get


def first_of_all(comm: Any, texts: Sequence[str], count: int, most: int) -> tuple[list[str], int]:
    """The first texts of those of all ranks, of lower ranks first, and the number of all; here are `count`."""
    told = [(list(texts[:most]), count)] if comm is None else comm.allgather((list(texts[:most]), count))
    return [text for some, _ in told for text in some][:most], sum(here for _, here in told)


def largest(comm: Any, value: float) -> float:
    """The largest of the values of all ranks."""
    return value if comm is None else max(comm.allgather(value))


def check_alike(comm: Any, text: str, what: str) -> None:
    """Refuse what differs from rank to rank: InputError on all."""
    if comm is not None and len(set(comm.allgather(text))) > 1:
        raise InputError(f"{what} differ from rank to rank: all have to run the same lines")


def end(status: int, message: str, complain: Callable[[str], None]) -> int:
    """End this rank with an exit status; a message of an error is told once.

    Where the other ranks do not come to an end as well, this one ends them: they would wait for it for ever.
    """
    comm = _world
    if comm is None or status == 0:
        if message:
            complain(message)
        return status
    if comm.rank == 0 and message:
        complain(message)
    together, began = comm.Ibarrier(), time.monotonic()
    while not together.Test():
        if time.monotonic() - began > PATIENCE:
            if comm.rank:
                complain(f"rank {comm.rank}: {message}")
            sys.stdout.flush()
            sys.stderr.flush()
            comm.Abort(status)
        time.sleep(0.01)
    return status


def _kinds() -> dict[str, type[BaseException]]:
    """Errors that ranks tell each other, by name; those that are EngineErrors before that class."""
    of_engine = EngineError.__subclasses__()
    told = (Stopped, InputError, TrajectoryError, *of_engine, EngineError, KeyboardInterrupt)
    return {each.__name__: each for each in told}


def _told(error: BaseException | None) -> tuple[str, str, int] | None:
    """Parts of an error that are sent: its kind, its text, an exit status."""
    if error is None:
        return None
    for name, kind in _kinds().items():
        if isinstance(error, kind):
            return name, str(error), getattr(error, "status", 0)
    return "EngineError", f"{type(error).__name__}: {error}", 0


def _made(name: str, text: str, status: int) -> BaseException:
    return Stopped(text, status) if name == "Stopped" else _kinds()[name](text)
