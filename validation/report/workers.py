"""Calls in processes of their own, some at a time: what they return comes back, and one that dies is told of.

Processes are started anew (`spawn`), so that none inherits a Taichi or threads that run. A worker makes one call at
a time, the next with kernels that it has loaded already; one that dies is replaced. Ctrl-C is left to the caller.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from typing import Any

from ...run.signals import SIGNALS
from ...simulation import device

PATIENCE = 20.0  # seconds in which a worker that is told to end, or has closed its line, does so


@dataclass(frozen=True)
class Died:
    """A worker ended before it had a result; `reason` says how."""

    reason: str


def run(
    work: Callable[[str], Any],
    names: Sequence[str],
    jobs: int,
    *,
    begun: Callable[[str], None],
    ended: Callable[[str, Any], None],
    waiting: Callable[[Sequence[str]], None],
    every: float = 60.0,
) -> None:
    """Call `work(name)` of all names, in their order, `jobs` at a time.

    Parameters
    ----------
    work : callable
        As for `pickle`: of the top level of a module. It shares the cores with the others: of threads of kernels, each
        worker has its part.
    begun, ended : callable
        Called here with the name when its call begins; with name and result, or `Died`, when it ends.
    waiting : callable
        Called with the names in work after `every` seconds [s] without an end.

    Whatever ends it, Ctrl-C included, no worker stays.
    """
    todo, threads = list(reversed(names)), max(1, device.cores() // jobs)
    idle: list[_Worker] = []
    busy: dict[Any, _Worker] = {}
    try:
        while todo or busy:
            while todo and len(busy) < jobs:
                worker = idle.pop() if idle else _Worker(work, threads)
                busy[worker.line] = worker
                begun(todo[-1])
                worker.give(todo.pop())
            while idle:  # nothing is left for them
                idle.pop().dismiss()
            ready = connection.wait(list(busy), timeout=every)
            if not ready:
                waiting([worker.name for worker in busy.values()])
            for line in ready:
                worker = busy[line]
                found = worker.take()
                del busy[line]
                if not isinstance(found, Died):
                    idle.append(worker)
                ended(worker.name, found)
        while idle:
            idle.pop().dismiss()
    finally:
        for worker in (*busy.values(), *idle):
            worker.end()


class _Worker:
    """A process, and the line to it."""

    def __init__(self, work: Callable[[str], Any], threads: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.line, theirs = context.Pipe()
        self.name = ""
        self._process = context.Process(target=_serve, args=(theirs, work, threads), daemon=True)
        resource_tracker.ensure_running()  # which starting a process does otherwise, and lets signals in again
        with block_signals():
            self._process.start()
        theirs.close()  # so that the line breaks when the worker ends

    def give(self, name: str) -> None:
        self.name = name
        with contextlib.suppress(BrokenPipeError):  # died already: `take` says so
            self.line.send(name)

    def take(self) -> Any:
        """The result, or `Died`."""
        try:
            return self.line.recv()
        except (EOFError, OSError):
            self._process.join(PATIENCE)
            status = self._process.exitcode
            self.end()
        return Died(f"its process {how_it_ended(status)}")

    def dismiss(self) -> None:
        """Let it end by itself, which keeps the kernels that it compiled."""
        with contextlib.suppress(BrokenPipeError):
            self.line.send(None)
        self._process.join(PATIENCE)
        self.end()

    def end(self) -> None:
        self._process.kill()
        self._process.join()
        self.line.close()


def _serve(line: Any, work: Callable[[str], Any], threads: int) -> None:
    """The worker: calls of names from the line until there is a None."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's matter
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(
            signal.SIG_UNBLOCK, {signal.SIGTERM}
        )  # by which Python ends workers that are left over
    threading.Thread(target=_end_with_parent, daemon=True).start()
    device.limit_threads(threads)
    while (name := line.recv()) is not None:
        line.send(work(name))
    device.stop()  # which keeps kernels


def _end_with_parent() -> None:
    """So that no worker goes on computing when its parent was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextlib.contextmanager
def block_signals() -> Iterator[None]:
    """Keep `SIGNALS` from processes that are started here.

    They begin with all of them blocked; here, they come a little later.
    """
    if not hasattr(signal, "pthread_sigmask"):  # not on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def how_it_ended(status: int | None) -> str:
    """What became of a process that broke its line off; its exit status is None if it had to be killed for it."""
    if status is None:
        return "closed its line and had to be killed"
    if status < 0:
        hint = ": the system does that when memory runs out" if status == -signal.SIGKILL else ""
        return f"was killed by {signal.Signals(-status).name}{hint}"
    return f"ended with status {status} and without a result"
