"""Processes that are started anew: keeping Ctrl-C from them, and saying how they ended."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator


@contextlib.contextmanager
def deaf() -> Iterator[None]:
    """Keep Ctrl-C, which a terminal sends to all, and SIGTERM from processes that are started here.

    They begin with both blocked; here, both come a little later.
    """
    if not hasattr(signal, "pthread_sigmask"):  # not on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
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
