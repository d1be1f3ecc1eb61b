"""Warning of a run that takes far too long."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from ...tools.progress import size_of_time
from .schedule import RunPoint

WAIT = 30.0
"""Real time [s] after which a run says what it waits for."""
LONGEST = 0.2 * 31557600.0
"""Real time [s] that a run may still need without a warning: a fifth of a year."""


class SlowRunCheck:
    """The pace of a run to its `end`; `clock` gives seconds of real time."""

    def __init__(self, end: RunPoint, clock: Callable[[], float] = time.perf_counter) -> None:
        self._end, self._clock = end, clock
        self._since: tuple[float, float, int] | None = None  # real time, simulated time, collisions
        self._warned = False

    def trouble(self, now: float, collisions: int, free_time: Callable[[], float]) -> str | None:
        """Text on a run at a time [time] whose end is far away at its present pace, once; else None.

        Called after every window; `free_time` gives the mean time between two collisions of any disks [time].
        """
        if self._warned:
            return None
        clock = self._clock()
        if self._since is None:  # after the first window, which compiled the kernels
            self._since = clock, now, collisions
        seconds, begin, before = clock - self._since[0], self._since[1], self._since[2]
        if seconds < WAIT:
            return None
        self._since = clock, now, collisions
        rate = (now - begin) / seconds  # of simulated in real time
        progress = f"t = {now:.6g}: the run advanced from {begin:.6g} to there in {seconds:.0f} s"
        if math.isfinite(self._end.collisions) and collisions == before:
            wait = free_time()
            text = f"{progress} without a collision; the mean time between two at this density and speed is {wait:.3g}"
            if wait > LONGEST * rate > 0.0:
                text += f", {size_of_time(wait / rate)} at this pace"
        elif math.isinf(self._end.collisions) and self._end.time - now > LONGEST * rate:
            left = size_of_time((self._end.time - now) / rate) if rate > 0.0 else "an unknown time"
            text = f"{progress}, and reaches t_end = {self._end.time:.6g} in {left} at this pace"
        else:
            return None
        self._warned = True
        return f"{text}. A denser gas, slower walls or disks, or an earlier end of the run take less time"
