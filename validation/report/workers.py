"""Calls in processes of their own, some at a time; a process that dies is reported as the result of its call.

Processes are started anew (`spawn`), so that none inherits a Taichi or threads that run.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnProcess
from typing import Any

from ...simulation import device

PATIENCE = 20.0  # seconds in which a process that has sent its result, or closed its line, ends


@dataclass(frozen=True)
class Died:
    """A process ended before it had a result, for this `reason`."""

    reason: str


def run(
    work: Callable[[str], Any], names: Sequence[str], jobs: int, *, begun: Callable[[str], None],
    ended: Callable[[str, Any], None], waiting: Callable[[Sequence[str]], None], every: float = 60.0,
) -> None:  # fmt: skip
    """Call `work(name)` of all names, in their order, `jobs` at a time.

    `work` is of the top level of a module, as for `pickle`; each process has its part of the cores, as threads of
    kernels. `begun` is called here with the name when its call begins, `ended` with name and result, or `Died`, when it
    ends, and `waiting` with the names in work after `every` seconds without an end. At its end, by Ctrl-C included, no
    process stays.
    """
    todo, threads = list(names), max(1, device.cores() // jobs)
    busy: dict[Any, tuple[str, SpawnProcess]] = {}
    try:
        while todo or busy:
            while todo and len(busy) < jobs:
                line, process = _start(work, todo[0], threads)
                busy[line] = todo[0], process
                begun(todo.pop(0))
            ready = connection.wait(list(busy), timeout=every)
            if not ready:
                waiting([name for name, _ in busy.values()])
            for line in ready:
                found = _result(line, busy[line][1])
                name, _ = busy.pop(line)
                ended(name, found)
    finally:
        for line, (_, process) in busy.items():
            _end(line, process)


def _start(work: Callable[[str], Any], name: str, threads: int) -> tuple[Any, SpawnProcess]:
    """A process that makes the call, and the line on which it sends the result."""
    context = multiprocessing.get_context("spawn")
    line, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, work, name, threads), daemon=True)
    resource_tracker.ensure_running()  # which starting a process does otherwise, and lets signals in again
    with _without_interrupts():
        process.start()
    theirs.close()  # so that the line breaks when the process ends
    return line, process


@contextlib.contextmanager
def _without_interrupts() -> Any:
    """Keep Ctrl-C, which a terminal sends to all processes of the command, from processes that start here."""
    if not hasattr(signal, "pthread_sigmask"):  # not on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _result(line: Any, process: SpawnProcess) -> Any:
    """The result, or `Died`."""
    try:
        found = line.recv()
        process.join(PATIENCE)  # it keeps the kernels that it compiled
    except (EOFError, OSError):
        process.join(PATIENCE)
        found = Died(f"its process {how_it_ended(process.exitcode)}")
    _end(line, process)
    return found


def _end(line: Any, process: SpawnProcess) -> None:
    process.kill()
    process.join()
    line.close()


def _serve(line: Any, work: Callable[[str], Any], name: str, threads: int) -> None:
    """The process: one call."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's matter
    threading.Thread(target=_end_with_parent, daemon=True).start()
    device.limit_threads(threads)
    line.send(work(name))
    device.stop()  # which keeps kernels


def _end_with_parent() -> None:
    """End this process when its parent was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def how_it_ended(status: int | None) -> str:
    """End of a process that broke its line off; its exit status is None if it had to be killed for it."""
    if status is None:
        return "closed its line and had to be killed"
    if status < 0:
        hint = ": the system does that when memory runs out" if status == -signal.SIGKILL else ""
        return f"was killed by {signal.Signals(-status).name}{hint}"
    return f"ended with status {status} and without a result"
