"""Processes that make calls, one after another; a process that dies is reported as the result of its call.

Processes are started by `spawn`, so that none inherits a Taichi or threads that run. They leave Ctrl-C, which a
terminal sends to all processes of a command, to the one that started them, and end when that does.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any

TIMEOUT = 20.0
"""Seconds in which a process that has closed its line ends."""


@dataclass(frozen=True)
class ProcessDied:
    """A process ended before it had a result, for this `reason`."""

    reason: str


class Worker:
    """A process that makes calls; `line` is ready (`multiprocessing.connection.wait`) when one has ended."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.line: Any
        self.line, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        resource_tracker.ensure_running()  # which starting a process does otherwise, and lets signals in again
        with _without_interrupts():
            self._process.start()
        theirs.close()  # so that the line breaks when the process ends

    def call(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Begin a call; the function is of the top level of a module, as for `pickle`."""
        with contextlib.suppress(OSError):  # of a process that has died: `result` raises
            self.line.send((function, arguments))

    def result(self) -> Any:
        """The result of the call, or `ProcessDied`."""
        try:
            return self.line.recv()
        except (EOFError, OSError):
            self._process.join(TIMEOUT)
            return ProcessDied(f"its process {how_it_ended(self._process.exitcode)}")

    def end(self) -> None:
        """End the process, also during a call."""
        self._process.kill()
        self._process.join()
        self.line.close()


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Keep Ctrl-C from processes that start here."""
    if not hasattr(signal, "pthread_sigmask"):  # not on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(line: Any) -> None:
    """Run a process: make calls and send results until the connection ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):  # of a parent that has gone
        while True:
            function, arguments = line.recv()
            line.send(function(*arguments))


def _end_with_parent() -> None:
    """End this process when its parent was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def how_it_ended(status: int | None) -> str:
    """End of a process whose connection broke; its exit status is None if it had to be killed."""
    if status is None:
        return "closed its line and had to be killed"
    if status < 0:
        hint = ": the system does that when memory runs out" if status == -signal.SIGKILL else ""
        return f"was killed by {signal.Signals(-status).name}{hint}"
    return f"ended with status {status} and without a result"
