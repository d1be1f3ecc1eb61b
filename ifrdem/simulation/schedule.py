"""Times at which a run writes something: evenly, at intervals of time or of collisions, or ever more rarely.

And those of the steps of forces and of gravity that turns.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from typing import Any

from ..errors import InputError, RunWarning
from ..model.observables import Measure
from ..model.state import State
from ..tools import checked
from ..tools.progress import size_of_time

FrameCallback = Callable[[State, Measure], None]
SeriesCallback = Callable[[Measure], None]
Progress = Callable[[float, int], None]


@dataclass
class RunPlan:
    """Plan of a run: its end, frames and series, and what of it is done.

    Attributes
    ----------
    span : Span
        Its beginning and end.
    frames : Trigger
        When frame callbacks are called after the beginning: exactly then.
    series : Trigger or None
        When series callbacks are called, in addition to the beginning and the end.
    next_frame, next_row : int
        What is due next, counted from 1; 0 is the beginning.
    """

    span: Span
    frames: Trigger
    series: Trigger | None = None
    next_frame: int = 0
    next_row: int = 0

    def to_record(self) -> dict[str, Any]:
        """As JSON knows it, for a checkpoint; cadences are those of the case."""
        return {"span": asdict(self.span), "next_frame": self.next_frame, "next_row": self.next_row}

    @classmethod
    def from_record(cls, record: Mapping[str, Any], frames: Trigger, series: Trigger | None) -> RunPlan:
        """Go on from what `to_record` gave."""
        span = dict(record["span"])
        end = RunPoint(**span.pop("end"))
        return cls(Span(**span, end=end), frames, series, record["next_frame"], record["next_row"])

    @property
    def frame_schedule(self) -> Schedule:
        """Times at which frames are due."""
        return Schedule(self.frames, self.span)

    @property
    def row_schedule(self) -> Schedule:
        """Times at which rows of series are due; only at the end if there are none."""
        return Schedule(self.series or Trigger(number=1), self.span)

    def next_points(self, rows: bool) -> list[RunPoint]:
        """The next few points at which frames, or `rows` of series, are due."""
        frames, of_rows = self.frame_schedule, self.row_schedule
        found = [frames.point(self.next_frame + i) for i in range(FEW)]
        return found + [of_rows.point(self.next_row + i) for i in range(FEW) if rows]


FEW = 9
SPACINGS = ("even", "log")
INTERVAL = checked.Number(1e-200, sys.float_info.max, "a finite number of 1e-200 or more")
"""Of intervals, in whatever unit: below, there are more of them than floating-point numbers count."""


MOST = 10_000_000
"""Of frames or of rows of series in a run."""


@dataclass(frozen=True)
class Trigger:
    """Interval of frames or rows. Exactly one of `number`, `interval` and `collisions` is given.

    Attributes
    ----------
    number : int
        So often in the whole run, after its beginning.
    interval : float
        At intervals of time [time].
    collisions : float
        At intervals of collisions per disk.
    spacing : {"even", "log"}
        Of a `number`: evenly in what ends the run (time or collisions), or at a constant ratio.
    log_from : float
        With "log": where the first one stands, as a part of the run.
    exact : bool
        Exactly then. If not, where the engine next ends a window by itself: that changes nothing and costs little, but
        windows of a small or thin gas may be long, and then there are fewer.

    Raises
    ------
    InputError
        If not exactly one is given, or a value is out of range.
    """

    number: int | None = None
    interval: float | None = None
    collisions: float | None = None
    spacing: str = "even"
    log_from: float = 1e-3
    exact: bool = True

    def __post_init__(self) -> None:
        given = [name for name in ("number", "interval", "collisions") if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                f"cadence: exactly one of number, interval and collisions must be given; given: {given}"
            )
        if self.number is not None:
            checked.integer("number", self.number, 1)
        for name in ("interval", "collisions"):
            value = getattr(self, name)
            if value is not None:
                INTERVAL(name, value)
        if self.spacing not in SPACINGS:
            raise InputError(f"spacing = {self.spacing!r}: must be one of {', '.join(SPACINGS)}")
        if self.spacing == "log" and self.number is None:
            raise InputError('spacing = "log" needs a number')
        if not 0.0 < self.log_from < 1.0:
            raise InputError(f"log_from = {self.log_from}: must be a part of the run, above 0 and below 1")

    def count(self, *, duration: float, collisions_per_disk: float) -> int:
        """About how many times in a run of such a length, after its beginning."""
        if self.number is not None:
            return self.number
        whole = duration / self.interval if self.interval else collisions_per_disk / (self.collisions or 1.0)
        return math.ceil(whole) if math.isfinite(whole) else 1


@dataclass(frozen=True)
class RunPoint:
    """A point of a run: reached at this time [time], or at this total number of collisions, whichever comes first."""

    time: float = math.inf
    collisions: int | None = None

    def reached(self, time: float, collisions: int) -> bool:
        """True if a run that is at this time, after so many collisions, has come to it."""
        return time >= self.time or (self.collisions is not None and collisions >= self.collisions)


def earlier(one: RunPoint, other: RunPoint) -> RunPoint:
    """The point that is reached when either is."""
    counts = [each.collisions for each in (one, other) if each.collisions is not None]
    return RunPoint(min(one.time, other.time), min(counts) if counts else None)


@dataclass(frozen=True)
class Span:
    """Begin and end of a run.

    Attributes
    ----------
    n : int
        Disks.
    time, collisions : float, int
        At its beginning [time]; total.
    end : RunPoint
        Its end, by time or by collisions.
    """

    n: int
    time: float
    collisions: int
    end: RunPoint

    @classmethod
    def to(
        cls,
        n: int,
        time: float,
        collisions: int,
        *,
        t_end: float | None = None,
        collisions_per_disk: float | None = None,
    ) -> Span:
        """To a time [time], or to so many collisions per disk, 2 * collisions / n.

        InputError if not exactly one end is given, or it lies in the past.
        """
        if (t_end is None) == (collisions_per_disk is None):
            raise InputError("exactly one of t_end and collisions_per_disk must be given")
        if t_end is not None:
            needed = f"a finite time not before the present one, {time}"
            return cls(
                n,
                time,
                collisions,
                RunPoint(time=checked.Number(time, sys.float_info.max, needed)("t_end", t_end)),
            )
        assert collisions_per_disk is not None
        had = f"a finite number, not below those already had, {2 * collisions / max(n, 1):.6g}"
        collisions_per_disk = replace(checked.FINITE, needed=had)("collisions_per_disk", collisions_per_disk)
        # As a decimal fraction: 1.1 means 11 / 10, not the binary number that is a hair above.
        end = math.ceil(Fraction(str(collisions_per_disk)) * n / 2)
        if end < collisions:
            raise checked.must_be("collisions_per_disk", collisions_per_disk, had)
        return cls(n, time, collisions, RunPoint(collisions=end))

    @classmethod
    def for_more(
        cls,
        n: int,
        time: float,
        collisions: int,
        *,
        more_time: float | None = None,
        collisions_per_disk: float | None = None,
    ) -> Span:
        """For a further time [time], or for so many further collisions per disk: at least one collision.

        InputError if not exactly one is given, or it is not positive.
        """
        if (more_time is None) == (collisions_per_disk is None):
            raise InputError("exactly one of time and collisions_per_disk must be given")
        if more_time is not None:
            more = checked.POSITIVE("time", more_time)
            if time + more == time:
                raise InputError(
                    f"time = {more:g}: must be above {math.ulp(time):.3g}, the rounding of {time:g}"
                )
            return cls(n, time, collisions, RunPoint(time=time + more))
        more = checked.POSITIVE("collisions_per_disk", collisions_per_disk)
        return cls(
            n, time, collisions, RunPoint(collisions=collisions + math.ceil(Fraction(str(more)) * n / 2))
        )

    @property
    def is_over(self) -> bool:
        """True if its end was reached before, by a gas that has moved."""
        at_end = self.end.time == self.time or self.end.collisions == self.collisions
        return at_end and (self.time > 0.0 or self.collisions > 0)


def warn_of_end(**end: float | None) -> None:
    """Warn (RunWarning) that the end of a run, given by its name, is reached already."""
    ((name, limit),) = ((name, value) for name, value in end.items() if value is not None)
    warnings.warn(
        f"{name} = {limit:g} is reached already: this run does nothing. Ends count from the start of the gas, not from "
        f"this call: for as much again, {name} = {2 * limit:g}, or run_for",
        RunWarning,
        stacklevel=4,
    )


def refuse_endless(cadence: Trigger, span: Span) -> None:
    """Raise InputError for more than `MOST` points in a run whose length is known."""
    remaining = (span.end.collisions or span.collisions) - span.collisions
    many = cadence.count(
        duration=span.end.time - span.time, collisions_per_disk=float(Fraction(2 * remaining, max(span.n, 1)))
    )
    if many > MOST:
        raise InputError(f"{cadence}: {many:.4g} times in this run; at most {MOST} are possible")


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
        if self._end.collisions is not None and collisions == before:
            wait = free_time()
            text = f"{progress} without a collision; the mean time between two at this density and speed is {wait:.3g}"
            if wait > LONGEST * rate > 0.0:
                text += f", {size_of_time(wait / rate)} at this pace"
        elif self._end.collisions is None and self._end.time - now > LONGEST * rate:
            left = size_of_time((self._end.time - now) / rate) if rate > 0.0 else "an unknown time"
            text = f"{progress}, and reaches t_end = {self._end.time:.6g} in {left} at this pace"
        else:
            return None
        self._warned = True
        return f"{text}. A denser gas, slower walls or disks, or an earlier end of the run take less time"


class Schedule:
    """The points of a run at which something is due: the k-th one, k = 1, 2, ...; the last is the run's end.

    A point is computed from its number and the run's beginning alone: a run that goes on later finds the same.
    InputError if at the end of the run an interval is lost in the rounding of the time.
    """

    def __init__(self, cadence: Trigger, span: Span) -> None:
        self._cadence, self._span = cadence, span
        end = span.end.time
        if cadence.interval is not None and math.isfinite(end) and end > span.time:
            resolved = math.ulp(max(abs(end), abs(span.time)))
            if cadence.interval < resolved:
                raise InputError(
                    f"interval = {cadence.interval}: lost in the rounding of a time of {end:g}: must be "
                    f"{resolved:.3g} or more"
                )

    def point(self, k: int) -> RunPoint:
        """The k-th point, k >= 1; the run's end for every k beyond the last."""
        cadence, span, end = self._cadence, self._span, self._span.end
        if cadence.interval is not None:
            return RunPoint(min(span.time + k * cadence.interval, end.time), end.collisions)
        if cadence.collisions is not None:
            return self._after(Fraction(str(float(cadence.collisions))) * k * span.n / 2)
        assert cadence.number is not None
        if k >= cadence.number:
            return end
        # As a fraction: rounding must not make a collision more of it.
        part = Fraction(k, cadence.number)
        if cadence.spacing == "log":
            part = Fraction(cadence.log_from ** ((cadence.number - k) / (cadence.number - 1)))
        if end.collisions is None:
            return RunPoint(time=span.time + (end.time - span.time) * float(part))
        return self._after(part * (end.collisions - span.collisions))

    def _after(self, collisions: Fraction) -> RunPoint:
        """After so many collisions from the beginning, or at the run's end."""
        span, end = self._span, self._span.end
        total = span.collisions + math.ceil(collisions)
        return RunPoint(end.time, total if end.collisions is None else min(total, end.collisions))

    def after(self, k: int, time: float, collisions: int) -> int:
        """The first point from k on that a run at this time, after so many collisions, has not reached."""

        def passed(number: int) -> bool:
            return self.point(number).reached(time, collisions)

        if self._span.end.reached(time, collisions) or not passed(k):
            return k
        step = 1  # ever longer steps find a point that has not been reached, halving them the first
        while passed(k + step):
            k += step
            step *= 2
        while step > 1:
            step //= 2
            if passed(k + step):
                k += step
        return k + 1


# Times that differ by rounding only are one time: (1 + 1/2) * 0.1 and (0 + 1/2) * 0.3.
SAME_TIME = 8.0 * sys.float_info.epsilon


def time_of(k: int, step: float) -> float:
    """Time of step k = 0, 1, ... [time]: a product, because a sum of steps would gather rounding errors."""
    return (k + 0.5) * step


def reached(time: float, now: float) -> bool:
    """True if a time has come, but for rounding."""
    return time <= now + SAME_TIME * abs(now)


def first_after(now: float, step: float) -> int:
    """Number of the first step whose middle comes after `now`."""
    k = math.floor(now / step - 0.5) - 1  # rounding may have put it one too late
    while reached(time_of(k, step), now):
        k += 1
    return k
