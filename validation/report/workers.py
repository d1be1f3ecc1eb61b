"""Validation cases in processes of their own, some at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from multiprocessing import connection
from typing import Any

from ...simulation import device
from ...tools.processes import Died as Died
from ...tools.processes import Worker


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
    busy: dict[Any, tuple[str, Worker]] = {}
    try:
        while todo or busy:
            while todo and len(busy) < jobs:
                worker = Worker()
                busy[worker.line] = todo[0], worker
                worker.call(_alone, work, todo[0], threads)
                begun(todo.pop(0))
            ready = connection.wait(list(busy), timeout=every)
            if not ready:
                waiting([name for name, _ in busy.values()])
            for line in ready:
                name, worker = busy.pop(line)
                found = worker.result()
                worker.end()
                ended(name, found)
    finally:
        for _, worker in busy.values():
            worker.end()


def _alone(work: Callable[[str], Any], name: str, threads: int) -> Any:
    """One call in a process of its own."""
    device.limit_threads(threads)
    try:
        return work(name)
    finally:
        device.stop()  # which keeps the kernels that it compiled
