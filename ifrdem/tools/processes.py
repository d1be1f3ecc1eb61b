"""Processes that are started anew: keeping the signals of a run from them, and saying how they ended."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator

WARNINGS = [getattr(signal, name) for name in ("SIGUSR1", "SIGUSR2") if hasattr(signal, name)]
"""Signals by which batch systems tell that a job is about to run out of time (Windows has none)."""
SIGNALS = [signal.SIGINT, signal.SIGTERM, *WARNINGS]
"""All that a run ends in good order for. Terminals and batch systems send them to every process of a job."""


@contextlib.contextmanager
def deaf() -> Iterator[None]:
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
