"""Requests to stop a run, which then ends in good order: Ctrl-C, SIGTERM, SIGUSR1, SIGUSR2, a limit of real time."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

from ..errors import Stopped, option_name

WARNINGS: list[signal.Signals] = [
    getattr(signal, name) for name in ("SIGUSR1", "SIGUSR2") if hasattr(signal, name)
]
"""Signals by which batch systems announce that a job is about to run out of time (Windows has none)."""
SIGNALS: list[signal.Signals] = [signal.SIGINT, signal.SIGTERM, *WARNINGS]
"""All that a run ends in good order for. Terminals and batch systems send them to every process of a job."""

INTERRUPTED = 130  # what shells use for SIGINT
TERMINATED = 143
TIME_IS_UP = 3  # --max-hours, or the warning of a batch system; as `cli.UNFINISHED`


class Stops:
    """Watch for reasons to stop and for the next checkpoint; a context manager.

    The first of `SIGNALS` is taken note of, and `check` raises when the run can stop; a second Ctrl-C stops
    at once (KeyboardInterrupt). In a thread other than the main one, signals are left alone.

    A run stops after `max_hours` of real time, of which `elapsed` seconds are gone already. A checkpoint is due
    every `every_minutes`, the first one at once.
    `warn` takes a line to show when a signal comes.
    """

    def __init__(
        self,
        *,
        max_hours: float | None = None,
        every_minutes: float = 10.0,
        elapsed: float = 0.0,
        warn: Callable[[str], None] = print,
    ) -> None:
        self._warn = warn
        self._reason: Stopped | None = None
        self._started = time.monotonic() - elapsed
        self._stored = -math.inf  # a run that is killed soon can be resumed too
        self._limit = None if max_hours is None else 3600.0 * max_hours
        self._max_hours = max_hours
        self._every = 60.0 * every_minutes
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Stops:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    @property
    def reason(self) -> Stopped | None:
        """Why the run has to stop; None if it need not."""
        if (
            self._limit is not None
            and time.monotonic() - self._started >= self._limit
            and self._reason is None
        ):
            self._reason = Stopped(
                f"{self._max_hours:g} hours are up ({option_name('--max-hours', 'max_hours')})", TIME_IS_UP
            )
        return self._reason

    def check(self) -> None:
        """Raise `Stopped` if there is a reason to."""
        if (reason := self.reason) is not None:
            raise reason

    @property
    def checkpoint_due(self) -> bool:
        """True if it is time for a checkpoint."""
        return time.monotonic() - self._stored >= self._every

    def stored(self) -> None:
        """Note that a checkpoint was written."""
        self._stored = time.monotonic()

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT:
            if self._reason is not None:
                raise KeyboardInterrupt
            self._reason = Stopped("interrupted", INTERRUPTED)
            self._warn(
                "interrupted: the run stops after this window, with a checkpoint; Ctrl-C again stops it at once"
            )
        elif self._reason is None:
            name, warned = signal.Signals(number).name, number in WARNINGS
            outcome = ("warned", TIME_IS_UP) if warned else ("terminated", TERMINATED)
            self._reason = Stopped(f"{outcome[0]} ({name})", outcome[1])
            self._warn(f"{self._reason}: the run stops after this window, with a checkpoint")
