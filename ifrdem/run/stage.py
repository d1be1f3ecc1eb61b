"""How far a single step of the preparation is, where it takes long."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO


class Stage:
    """Prints how much of a step is done, every `interval` seconds at most: nothing for a short one.

    Parameters
    ----------
    name : str
        What is being done.
    stream : text file, optional
        Where to print; the standard error stream by default.
    interval : float
        Seconds between lines.
    clock : callable
        Seconds of real time; another one in tests.
    """

    def __init__(
        self,
        name: str,
        *,
        stream: TextIO | None = None,
        interval: float = 5.0,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._name = name
        self._stream = sys.stderr if stream is None else stream
        self._interval = interval
        self._clock = clock
        self._printed = clock()

    def __call__(self, part: float) -> None:
        """Take note that this part is done, 0 to 1."""
        now = self._clock()
        if part < 1.0 and now - self._printed >= self._interval:
            self._printed = now
            print(f"{self._name}: {100.0 * part:.0f} % done", file=self._stream, flush=True)
