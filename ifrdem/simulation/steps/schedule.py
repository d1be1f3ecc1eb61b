"""Times of output of a run: at even or logarithmic intervals of time or of collisions.

And those of the steps of forces and of gravity that turns.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any, NamedTuple

from ...errors import InputError, RunWarning, shortened
from ...model.observables import Measure
from ...tools import checked

FrameCallback = Callable[[Any, Measure], None]
"""Called with a `State`, or `FrameRows` for a file."""
SeriesCallback = Callable[[Measure], None]
Progress = Callable[[float, int], None]


class RunPoint(NamedTuple):
    """A point of a run: reached at this time [time], or at this total number of collisions, whichever comes first.

    The engine stops at points; `RunPlan` has two, its beginning and its end, and a `Trigger` means others only in one.
    """

    time: float = math.inf
    collisions: float = math.inf

    def reached(self, time: float, collisions: float) -> bool:
        """True if a run at this time, after so many collisions, has reached the point."""
        return time >= self.time or collisions >= self.collisions

    def earlier(self, other: RunPoint) -> RunPoint:
        """The point that is reached when either of two is."""
        return RunPoint(min(self.time, other.time), min(self.collisions, other.collisions))


def _collisions_of(per_disk: float, n: int) -> int:
    """The least number of collisions by which n disks have so many on average."""
    # As a decimal fraction: 1.1 means 11 / 10, not the binary number that is a hair above.
    numerator, denominator = Decimal(str(per_disk)).as_integer_ratio()
    return -(-numerator * n // (2 * denominator))


def end_at(
    n: int, begin: RunPoint, *, t_end: float | None = None, collisions_per_disk: float | None = None
) -> RunPoint:
    """End of a run of n disks at a time [time], or after so many collisions per disk, 2 * collisions / n.

    InputError if not exactly one end is given, or it lies before the beginning.
    """
    if (t_end is None) == (collisions_per_disk is None):
        raise InputError("exactly one of t_end and collisions_per_disk must be given")
    if t_end is not None:
        needed = f"a finite time not before the present one, {begin.time}"
        return RunPoint(time=checked.Number(begin.time, checked.MOST, needed)("t_end", t_end))
    assert collisions_per_disk is not None
    had = f"a number up to {checked.MOST:g}, not below those already had, {2 * begin.collisions / max(n, 1):.6g}"
    collisions_per_disk = replace(checked.MU, needed=had)("collisions_per_disk", collisions_per_disk)
    end = _collisions_of(collisions_per_disk, n)
    if end < begin.collisions:
        raise checked.must_be("collisions_per_disk", collisions_per_disk, had)
    return RunPoint(collisions=end)


def end_after(
    n: int, begin: RunPoint, *, time: float | None = None, collisions_per_disk: float | None = None
) -> RunPoint:
    """End of a run after a further time [time], or so many further collisions per disk: at least one collision.

    InputError if not exactly one is given, or it is not positive.
    """
    if (time is None) == (collisions_per_disk is None):
        raise InputError("exactly one of time and collisions_per_disk must be given")
    if time is None:
        more = checked.POSITIVE("collisions_per_disk", collisions_per_disk)
        return RunPoint(collisions=begin.collisions + _collisions_of(more, n))
    end = begin.time + checked.POSITIVE("time", time)
    if end == begin.time:
        raise InputError(
            f"time = {time:g}: must be above {math.ulp(begin.time):.3g}, the rounding of {begin.time:g}"
        )
    return RunPoint(time=end)


FEW = 9
SPACINGS = ("even", "log")
MOST = 10_000_000
OUTPUTS = checked.Integer(1, MOST)
"""Check of the number of frames, or of rows of series, in a run."""


@dataclass(frozen=True)
class Trigger:
    """Interval of frames or rows. Exactly one of `number`, `interval` and `collisions` is given.

    Users give one for any run; when it is due in a run, `RunPlan` says.

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
            checked.Integer(1)("number", self.number)
        for name in ("interval", "collisions"):
            value = getattr(self, name)
            if value is not None:
                checked.POSITIVE(name, value)
        if self.spacing not in SPACINGS:
            raise InputError(f"spacing = {shortened(self.spacing)}: must be one of {', '.join(SPACINGS)}")
        if self.spacing == "log" and self.number is None:
            raise InputError('spacing = "log" needs a number')
        checked.PART("log_from", self.log_from)

    def count(self, *, duration: float, collisions_per_disk: float) -> int:
        """Approximate number of outputs in a run of this length, after its beginning."""
        if self.number is not None:
            return self.number
        whole = duration / self.interval if self.interval else collisions_per_disk / (self.collisions or 1.0)
        return math.ceil(whole) if math.isfinite(whole) else 1


AT_END = Trigger(number=1)


@dataclass
class RunPlan:
    """Plan of a run: its beginning and end, frames and series, and what of it is done.

    Points are computed from their number and the run's beginning alone: a resumed run has the same.

    Attributes
    ----------
    n : int
        Number of disks.
    begin, end : RunPoint
        Its beginning, time and number of collisions; its end, by one of them.
    frames : Trigger
        When frame callbacks are called after the beginning: exactly then.
    series : Trigger or None
        When series callbacks are called, in addition to the beginning and the end.
    next_frame, next_row : int
        What is due next, counted from 1; 0 is the beginning.

    Raises
    ------
    InputError
        If an interval is lost in the rounding of the time, or comes more than `MOST` times in the run.
    """

    n: int
    begin: RunPoint
    end: RunPoint
    frames: Trigger = AT_END
    series: Trigger | None = None
    next_frame: int = 0
    next_row: int = 0

    def __post_init__(self) -> None:
        for trigger in (self.frames, self.rows):
            self._check(trigger)

    def _check(self, trigger: Trigger) -> None:
        begin, end, interval = self.begin, self.end, trigger.interval
        if interval is not None and begin.time < end.time < math.inf:
            resolved = math.ulp(max(abs(end.time), abs(begin.time)))
            if interval < resolved:
                raise InputError(
                    f"interval = {interval}: lost in the rounding of a time of {end.time:g}: must be {resolved:.3g} or "
                    "more"
                )
        remaining = int(end.collisions - begin.collisions) if math.isfinite(end.collisions) else 0
        per_disk = 2 * remaining / max(self.n, 1)
        many = trigger.count(duration=end.time - begin.time, collisions_per_disk=per_disk)
        if many > MOST:
            raise InputError(f"{trigger}: {many:.4g} times in this run; at most {MOST} are possible")

    def to_record(self) -> dict[str, Any]:
        """The plan in the form of JSON, for a checkpoint; triggers are those of the case."""
        return {name: getattr(self, name) for name in ("n", "begin", "end", "next_frame", "next_row")}

    @classmethod
    def from_record(cls, record: Mapping[str, Any], frames: Trigger, series: Trigger | None) -> RunPlan:
        """The plan of a record that `to_record` gave."""
        begin, end = (RunPoint(*record[name]) for name in ("begin", "end"))
        return cls(record["n"], begin, end, frames, series, record["next_frame"], record["next_row"])

    @property
    def rows(self) -> Trigger:
        """When rows of series are due; only at the end if there are none."""
        return self.series or AT_END

    def next_points(self, rows: bool) -> list[RunPoint]:
        """The next few points at which frames, or `rows` of series, are due."""
        found = [self.point(self.frames, self.next_frame + i) for i in range(FEW)]
        return found + [self.point(self.rows, self.next_row + i) for i in range(FEW) if rows]

    def point(self, trigger: Trigger, k: int) -> RunPoint:
        """The k-th point at which something is due, k >= 1; the run's end for every k beyond the last."""
        begin, end = self.begin, self.end
        if trigger.interval is not None:
            return RunPoint(min(begin.time + k * trigger.interval, end.time), end.collisions)
        if trigger.collisions is not None:
            return self._after(_collisions_of(float(trigger.collisions), k * self.n))
        assert trigger.number is not None
        if k >= trigger.number:
            return end
        # As a fraction: rounding must not make a collision more of it.
        part, whole = k, trigger.number
        if trigger.spacing == "log":
            factor = trigger.log_from ** ((trigger.number - k) / (trigger.number - 1))
            part, whole = factor.as_integer_ratio()
        if math.isinf(end.collisions):
            return RunPoint(time=begin.time + (end.time - begin.time) * (part / whole))
        return self._after(-(-part * int(end.collisions - begin.collisions) // whole))

    def _after(self, collisions: int) -> RunPoint:
        """The point after so many collisions from the beginning, or the run's end."""
        return RunPoint(self.end.time, min(self.begin.collisions + collisions, self.end.collisions))

    def first_not_reached(self, trigger: Trigger, k: int, time: float, collisions: int) -> int:
        """The first point from k on that a run at this time, after so many collisions, has not reached."""

        def passed(number: int) -> bool:
            return self.point(trigger, number).reached(time, collisions)

        if self.end.reached(time, collisions) or not passed(k):
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


def warn_of_end(**end: float | None) -> None:
    """Warn (RunWarning) that the end of a run, given by its name, is reached already."""
    ((name, limit),) = ((name, value) for name, value in end.items() if value is not None)
    warnings.warn(
        f"{name} = {limit:g} is reached already: this run does nothing. Ends count from the start of the gas, not from "
        f"this call: for as much again, {name} = {2 * limit:g}, or run_for",
        RunWarning,
        stacklevel=4,
    )


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
