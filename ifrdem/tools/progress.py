"""Progress of a run and of its preparation: a bar on a terminal or in a notebook, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TextIO

BAR = "{percentage:5.1f} %|{bar}| {desc}"
FRAME = 14
"""Columns that the bar line needs in addition to its text, at least."""

DELAY = 0.5
"""Seconds after which the bar of a short run appears, and between lines on kernels that are compiled."""

NARROWEST = 36
"""Columns of a terminal below which there is no room for the shortest bar line: plain lines are shown."""


class Mark(NamedTuple):
    """Seconds of real time, simulated time and collisions at a call of `Progress`."""

    clock: float
    time: float
    collisions: int


class Progress:
    """Shows collisions/s, simulated time, collisions per disk and the time that is left.

    Called as ``progress(time, collisions)``, as often as one likes: it prints every `interval` seconds at most (a bar
    on a terminal is redrawn at its own pace). A context manager: it ends with a last line. On a narrow terminal the bar
    line leaves out what matters least; time left and rate are always there.

    The run of n disks ends at the simulated time `t_end` [time] or at `collisions_per_disk`; exactly one is given
    (ValueError). `begin` is the time [time] and the number of collisions at its start. The time left (ETA) follows from
    the pace during at least the latest half of the real time, because a gas that comes to rest slows down. The time
    before the first call, which compiles the kernels, does not count: `compiling` shows that. `interval` is the
    time between plain lines [s], `clock` gives the real time [s]. `kernels` is the approximate number of kernels.
    With `brief` the bar appears after half a second, and goes at the end unless a notebook shows it.
    """

    def __init__(
        self,
        n: int,
        *,
        t_end: float | None = None,
        collisions_per_disk: float | None = None,
        begin: tuple[float, int] = (0.0, 0),
        unit: str = "s",
        stream: TextIO | None = None,
        interval: float = 5.0,
        clock: Callable[[], float] = time.perf_counter,
        kernels: int = 0,
        brief: bool = False,
    ) -> None:
        if (t_end is None) == (collisions_per_disk is None):
            raise ValueError("exactly one of t_end and collisions_per_disk must be given")
        self._n, self._begin = n, begin
        self._t_end = t_end
        # A disk's collision is shared with its partner: n disks with c collisions each make n c / 2 of them.
        self._collisions_end = None if collisions_per_disk is None else 0.5 * n * collisions_per_disk
        self._unit = unit
        self._stream = sys.stderr if stream is None else stream
        self._interval = interval
        self._clock = clock
        self._first: Mark | None = None
        self._early = self._later = Mark(0.0, 0.0, 0)  # the pace of the run is that since the early one
        self._latest = self._printed = Mark(0.0, 0.0, 0)
        self._quiet = quiet()
        notebook = in_notebook() and not self._quiet
        self._columns = _columns(self._stream) if self._stream.isatty() and not self._quiet else 0
        self._bar: Any = None
        self._started, self._brief, self._stays = clock(), brief, notebook or not brief
        self._kernels = Compilation(kernels, clock=clock)
        if notebook or self._columns >= NARROWEST:
            from tqdm.auto import tqdm

            # tqdm's own {remaining} would count the compilation; ours is in the text. It shows nothing on a terminal
            # that reports no rows. The last column stays free: writing there moves some terminals to the next line.
            bar_options = {} if notebook else {"file": self._stream, "ncols": self._columns - 1, "nrows": 24}
            self._bar = tqdm(
                total=100.0, bar_format=BAR, leave=self._stays, delay=DELAY if brief else 0.0, **bar_options
            )
            self._bar.set_description_str("compiling", refresh=not brief)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, time: float, collisions: int) -> None:
        """Set the simulated time [time] and the number of collisions so far."""
        self._latest = Mark(self._clock(), time, collisions)
        if self._first is None:
            self._first = self._printed = self._early = self._later = self._latest
            return
        if self._latest.clock - self._first.clock >= 2.0 * (self._later.clock - self._first.clock):
            self._early, self._later = self._later, self._latest
        if self._bar is not None:
            self._bar.set_description_str(self._fitting(), refresh=False)
            self._bar.update(100.0 * self.fraction - self._bar.n)
        elif self._latest.clock - self._printed.clock >= self._interval:
            self._line()

    def compiling(self, kernel: str) -> None:
        """Show that the kernel of this name is compiled next, before the first call; of a brief run if it is slow."""
        text, is_slow = self._kernels.next(kernel)
        if self._first is not None:
            return
        if self._bar is not None:
            self._bar.set_description_str(text, refresh=is_slow or not self._brief)
        elif is_slow and not self._quiet:
            print(text, file=self._stream, flush=True)

    @property
    def fraction(self) -> float:
        """Part of the run that is done, 0 to 1, by its end."""
        return self._done(self._latest)

    @property
    def seconds_left(self) -> float:
        """Estimated seconds of real time until the end; infinite before there is anything to go by."""
        done = self.fraction - self._done(self._early) if self._first is not None else 0.0
        if done <= 0.0:
            return math.inf
        return (self._latest.clock - self._early.clock) * (1.0 - self.fraction) / done

    @property
    def collisions_per_second(self) -> float:
        """Collisions a second of real time since the first call."""
        return self._rate_since(self._first) if self._first is not None else 0.0

    def close(self) -> None:
        """Show the last state and release the terminal."""
        if self._bar is not None:
            if self._stays and not (self._brief and self._clock() - self._started < DELAY):
                self._bar.refresh()
            self._bar.close()
            self._bar = None
        elif self._latest is not self._printed and self._first is not None:
            self._line()

    def _texts(self, rate: float) -> tuple[str, str, str, str]:
        """Time left, rate, collisions per disk and simulated time."""
        per_disk = 2.0 * self._latest.collisions / self._n if self._n else 0.0
        time = f"t = {self._latest.time:.4g} {self._unit}".rstrip()
        return f"ETA {clock_face(self.seconds_left)}", f"{rate:.3g}", f"{per_disk:.2f}", time

    def _fitting(self) -> str:
        """The text, shortened to the width of the terminal; whole in a notebook."""
        left, rate, per_disk, time = self._texts(self.collisions_per_second)
        parts = [left, f"{rate} collisions/s", f"{per_disk} per disk", time]
        while self._columns and len(parts) > 1 and len(", ".join(parts)) + FRAME > self._columns:
            parts.pop()
        return ", ".join(parts) if len(parts) > 1 else f"{left}, {rate}/s"

    def _line(self) -> None:
        if self._quiet:
            return
        # Between two lines the recent rate says more than the mean; the ETA goes by that of a longer time.
        left, rate, per_disk, time = self._texts(self._rate_since(self._printed))
        text = f"{time}, {per_disk} collisions per disk, {rate} collisions/s, {left}"
        print(f"{100.0 * self.fraction:5.1f} %  {text}", file=self._stream, flush=True)
        self._printed = self._latest

    def _rate_since(self, since: Mark) -> float:
        seconds = self._latest.clock - since.clock
        return (self._latest.collisions - since.collisions) / seconds if seconds > 0.0 else 0.0

    def _done(self, at: Mark) -> float:
        by_time = self._t_end is not None
        end, reached = (self._t_end, at.time) if by_time else (self._collisions_end, at.collisions)
        begin = self._begin[0] if by_time else self._begin[1]
        assert end is not None
        return min(1.0, max(0.0, reached - begin) / (end - begin)) if end > begin else 1.0


class Compilation:
    """Texts on the compilation of about `expected` kernels (0 if unknown); `clock` gives the real time [s]."""

    def __init__(self, expected: int = 0, *, clock: Callable[[], float] = time.perf_counter) -> None:
        self._expected, self._clock, self._count = expected, clock, 0
        self._shown = clock()

    def next(self, kernel: str) -> tuple[str, bool]:
        """The text on the next kernel; True if half a second passed since the latest such text or the beginning.

        Kernels in the cache are loaded faster than that, except the largest, which is the last.
        """
        self._count += 1
        now = self._clock()
        if is_slow := now - self._shown >= DELAY:
            self._shown = now
        if not self._expected:
            return f"compiling kernel {self._count} ({kernel})", is_slow
        of = max(self._count, self._expected)
        return f"compiling kernels: {self._count} of about {of} ({kernel})", is_slow


def drawing(name: str) -> None:
    """Say that a picture is drawn, which takes seconds, where progress is shown."""
    if not quiet():
        print(f"drawing {name}", file=sys.stderr, flush=True)


class Stage:
    """Prints the part of a long step of the preparation that is done, every `interval` seconds at most.

    With the time that is left (ETA), at the pace so far, as `time_left`.
    """

    def __init__(
        self, name: str, *, interval: float = 5.0, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self._name, self._interval, self._clock, self._begun = name, interval, clock, clock()
        self._printed = self._begun

    def __call__(self, part: float) -> None:
        """Set the part that is done, 0 to 1."""
        now = self._clock()
        if part < 1.0 and now - self._printed >= self._interval and not quiet():
            self._printed = now
            text = f"{self._name}: {100.0 * part:.0f} % done{time_left(now - self._begun, part)}"
            print(text, file=sys.stderr, flush=True)


_stages_are_shown = False


@contextlib.contextmanager
def shown_stages() -> Iterator[None]:
    """Show the long steps of a start (`stage`) in the block."""
    global _stages_are_shown
    before, _stages_are_shown = _stages_are_shown, True
    try:
        yield
    finally:
        _stages_are_shown = before


def stage(name: str) -> Callable[[float], None]:
    """A function that takes the part of a step that is done, 0 to 1, and shows it in a block of `shown_stages`."""
    return Stage(name) if _stages_are_shown else lambda _part: None


def _columns(stream: TextIO) -> int:
    """Columns of a terminal, from the environment or else the terminal; 0 if unknown."""
    columns = os.environ.get("COLUMNS", "")
    if columns.isdecimal() and int(columns) > 0:
        return int(columns)
    try:
        return os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):  # no file, or not that of a terminal
        return 0


def in_notebook() -> bool:
    """True in a notebook, or whatever else runs cells in a kernel of Jupyter."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def output_is_interactive(stream: TextIO | None = None) -> bool:
    """True if the output is a terminal or a notebook."""
    return in_notebook() or (sys.stderr if stream is None else stream).isatty()


def quiet() -> bool:
    """True if the logger `ifrdem` is set to warnings and errors only, as by `--quiet`."""
    return logging.getLogger("ifrdem").level > logging.INFO


def size_of_time(seconds: float) -> str:
    """Text of a duration in seconds, minutes, hours, days or years, with two digits."""
    for unit, length in (("years", 31557600.0), ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.2g} {unit}"
    return f"{max(seconds, 0.1):.2g} s"


EARLIEST = 2.0, 0.05
"""Seconds, and the part that is done, before which the pace so far says nothing about the time left."""


def time_left(seconds: float, part: float) -> str:
    """Text of the time left, after `seconds` for a part of a step, 0 to 1, at that pace; empty before `EARLIEST`."""
    is_known = seconds >= EARLIEST[0] and part >= EARLIEST[1]
    return f", ETA {clock_face(seconds * (1.0 - part) / part)}" if is_known else ""


def clock_face(seconds: float) -> str:
    """1:02:03, 2:03, or a dash if unknown."""
    if math.isinf(seconds):
        return "-"
    whole = round(seconds)
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"
