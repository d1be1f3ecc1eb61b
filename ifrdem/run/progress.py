"""How far a run is: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

WITH_BAR, BARE = "{percentage:5.1f} %|{bar:10}| {desc}", "{percentage:5.1f} % {desc}"
FRAME = {WITH_BAR: 20, BARE: 8}
"""Columns that each kind of bar line needs beside its text."""

NARROWEST = 36
"""Columns of a terminal below which there is no room for the shortest bar line: plain lines are shown."""


class Progress:
    """Shows collisions/s, simulated time, collisions per disk and the time that is left.

    Called as ``progress(time, collisions)``, as often as one likes: it prints every `interval` seconds
    at most (a bar on a terminal is redrawn at its own pace). A context manager: it ends with a last line.
    On a narrow terminal the bar line leaves out what matters least; time left and rate are always there.

    Parameters
    ----------
    n : int
        Number of disks.
    t_end : float, optional
        Simulated time at which the run ends [time].
    collisions_per_disk : float, optional
        Collisions per disk at which the run ends. Exactly one of the two is given; the time left (ETA)
        is estimated by it, not counting what passed before the first call, which compiles the kernels.
    unit : str
        Unit of time, for display.
    stream : text file, optional
        Where to show it; the standard error stream by default.
    interval : float
        Seconds between plain lines.
    clock : callable
        Seconds of real time; another one in tests.

    Raises
    ------
    ValueError
        If not exactly one of `t_end` and `collisions_per_disk` is given.
    """

    def __init__(
        self,
        n: int,
        *,
        t_end: float | None = None,
        collisions_per_disk: float | None = None,
        unit: str = "s",
        stream: TextIO | None = None,
        interval: float = 5.0,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        if (t_end is None) == (collisions_per_disk is None):
            raise ValueError("exactly one of t_end and collisions_per_disk is needed")
        self._n = n
        self._t_end = t_end
        # A disk's collision is shared with its partner: n disks with c collisions each make n c / 2 of them.
        self._collisions_end = None if collisions_per_disk is None else 0.5 * n * collisions_per_disk
        self._unit = unit
        self._stream = sys.stderr if stream is None else stream
        self._interval = interval
        self._clock = clock
        self._first: tuple[float, float, int] | None = None
        self._latest: tuple[float, float, int] | None = None
        self._printed: tuple[float, float, int] | None = None
        self._quiet = quiet()
        self._columns = _columns(self._stream) if self._stream.isatty() and not self._quiet else 0
        self._bar: Any = self._open_bar() if self._columns >= NARROWEST else None

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, time: float, collisions: int) -> None:
        """Take note of the simulated time [time] and the number of collisions so far."""
        now = (self._clock(), time, collisions)
        self._latest = now
        if self._first is None:
            self._first = self._printed = now
            return
        if self._bar is not None:
            self._bar.bar_format, text = self._fitting(time)
            self._bar.set_description_str(text, refresh=False)
            self._bar.update(100.0 * self.fraction - self._bar.n)
        elif self._printed is not None and now[0] - self._printed[0] >= self._interval:
            self._line()

    @property
    def fraction(self) -> float:
        """How much of the run is done, 0 to 1, by what ends it."""
        return self._done(self._latest) if self._latest is not None else 0.0

    @property
    def seconds_left(self) -> float:
        """Estimated seconds of real time until the end; infinite before there is anything to go by."""
        if self._first is None or self._latest is None:
            return float("inf")
        done = self.fraction - self._done(self._first)
        seconds = self._latest[0] - self._first[0]
        return seconds * (1.0 - self.fraction) / done if done > 0.0 else float("inf")

    @property
    def collisions_per_second(self) -> float:
        """Collisions a second of real time since the first call."""
        return self._rate_since(self._first)

    def close(self) -> None:
        """Show the last state and let go of the terminal."""
        if self._bar is not None:
            self._bar.refresh()
            self._bar.close()
            self._bar = None
        elif self._latest is not None and self._latest is not self._printed:
            self._line()

    @property
    def _per_disk(self) -> float:
        return 2.0 * self._latest[2] / self._n if self._latest is not None and self._n else 0.0

    def _fitting(self, time: float) -> tuple[str, str]:
        """Format of the bar line and its text: as much as the terminal has room for."""
        left, rate = f"ETA {clock_face(self.seconds_left)}", f"{self.collisions_per_second:.3g}"
        main, per_disk = f"{left}, {rate} collisions/s", f"{self._per_disk:.2f} per disk"
        whole = f"{main}, {per_disk}, t = {time:.4g} {self._unit}".rstrip()
        choices = [(WITH_BAR, whole), (WITH_BAR, f"{main}, {per_disk}"), (WITH_BAR, main), (BARE, main)]
        for form, text in choices:
            # The last column stays free: writing there moves some terminals to the next line.
            if FRAME[form] + len(text) < self._columns:
                return form, text
        return BARE, f"{left}, {rate}/s"

    def _line(self) -> None:
        assert self._latest is not None
        if self._quiet:
            return
        # Between two lines the recent rate says more than the mean; the ETA goes by the mean.
        time = f"t = {self._latest[1]:.4g} {self._unit}".rstrip()
        rate = f"{self._rate_since(self._printed):.3g} collisions/s"
        print(
            f"{100.0 * self.fraction:5.1f} %  {time}, {self._per_disk:.2f} collisions per disk, {rate}, "
            f"ETA {clock_face(self.seconds_left)}",
            file=self._stream,
            flush=True,
        )
        self._printed = self._latest

    def _rate_since(self, since: tuple[float, float, int] | None) -> float:
        if since is None or self._latest is None or self._latest[0] <= since[0]:
            return 0.0
        return (self._latest[2] - since[2]) / (self._latest[0] - since[0])

    def _done(self, at: tuple[float, float, int] | None) -> float:
        if at is None:
            return 0.0
        end, reached = (self._t_end, at[1]) if self._t_end is not None else (self._collisions_end, at[2])
        return min(1.0, reached / end) if end else 1.0

    def _open_bar(self) -> Any:
        from tqdm import tqdm

        # tqdm's own {remaining} would count the compilation; ours is in the text. It shows nothing on a
        # terminal that reports no rows, so it is told of some.
        bar = tqdm(total=100.0, file=self._stream, bar_format=WITH_BAR, ncols=self._columns - 1, nrows=24)
        bar.set_description_str("compiling")
        return bar


def _columns(stream: TextIO) -> int:
    """Columns of a terminal: what the environment says, or else the terminal; 0 if neither knows."""
    told = os.environ.get("COLUMNS", "")
    if told.isdecimal() and int(told) > 0:
        return int(told)
    try:
        return os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):  # no file, or not that of a terminal
        return 0


def quiet() -> bool:
    """Whether the logger `ifrdem` is set to warnings and errors only, as by `--quiet`."""
    return logging.getLogger("ifrdem").level > logging.INFO


def clock_face(seconds: float) -> str:
    """1:02:03, 2:03, or a dash if unknown."""
    if seconds == float("inf"):
        return "-"
    whole = round(seconds)
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"
