"""Motions of walls: given ones along a direction and about a centre, and those of pistons."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ...errors import InputError
from ...tools.checked import NonNegative, Pair, Part, Positive, Real, validated
from .shapes import FULL_TURN


@validated
@dataclass(frozen=True)
class Motion:
    """Motion of a wall as a whole: a displacement s(t) along a direction; t is the time of the run.

    InputError if a number is not finite or out of its range.

    Parameters
    ----------
    kind : {"still", "steady", "sine", "sawtooth"}
        steady: s = speed t. sine: s = amplitude sin(2 pi frequency t + phase). sawtooth: at constant speed from
        -amplitude to +amplitude in the part `rise`, between 0 and 1, of a period, and back in the rest of it.
    direction : two floats
        Any length but 0; only the direction counts.
    speed, amplitude, frequency : float
        [length/time], [length], [1/time].
    phase : float
        At t = 0 [rad]; 2 pi is a whole period.

    Examples
    --------
    >>> import ifrdem
    >>> floor = ifrdem.Motion("sine", amplitude=0.01, frequency=20.0)
    >>> floor.kind, floor.direction
    ('sine', (0.0, 1.0))
    """

    kind: Literal["still", "steady", "sine", "sawtooth"] = "still"
    direction: Pair = (0.0, 1.0)
    speed: Real = 0.0
    amplitude: NonNegative = 0.0
    frequency: NonNegative = 0.0
    phase: Real = 0.0
    rise: Part = 0.5

    def __post_init__(self) -> None:
        x, y = self.direction
        length = math.hypot(x, y)
        if length == 0.0:
            raise InputError("direction = (0, 0): must not be 0")
        object.__setattr__(self, "direction", (x / length, y / length))
        if self.kind in ("sine", "sawtooth") and self.frequency == 0.0:
            raise InputError(f"frequency = 0: must be above 0 for a motion of kind '{self.kind}'")

    @property
    def most_speed(self) -> float:
        """The largest speed [length/time]."""
        if self.kind == "steady":
            return abs(self.speed)
        if self.kind == "sine":
            return 2.0 * math.pi * self.frequency * self.amplitude
        if self.kind == "sawtooth":
            return 2.0 * self.amplitude * self.frequency / min(self.rise, 1.0 - self.rise)
        return 0.0

    @property
    def extent(self) -> float:
        """Largest displacement from its middle position [length]; infinite for a steady motion."""
        return math.inf if self.kind == "steady" and self.speed != 0.0 else self.amplitude

    @validated
    def displacement(self, t: Real) -> float:
        """s(t) [length]."""
        if self.kind == "steady":
            return self.speed * t
        if self.kind == "sine":
            return self.amplitude * math.sin(2.0 * math.pi * self.frequency * t + self.phase)
        if self.kind == "sawtooth":
            part = (self.frequency * t + self.phase / (2.0 * math.pi)) % 1.0
            if part < self.rise:
                return self.amplitude * (2.0 * part / self.rise - 1.0)
            return self.amplitude * (1.0 - 2.0 * (part - self.rise) / (1.0 - self.rise))
        return 0.0


@validated
@dataclass(frozen=True)
class Turn:
    """Rotation of a wall as a whole about a centre, counter-clockwise; t is the time of the run.

    InputError if a number is not finite or out of its range.

    Parameters
    ----------
    kind : {"still", "steady", "sine"}
        steady: the angle is rate t. sine: it is amplitude sin(2 pi frequency t + phase).
    center : two floats
        Of the rotation [length]; where the wall has a motion too, this carries it along.
    rate : float
        Angular velocity [rad/time].
    amplitude, frequency, phase : float
        Largest angle [rad], [1/time], [rad].

    Examples
    --------
    >>> import ifrdem
    >>> mixer = ifrdem.Turn("steady", center=(0.5, 0.5), rate=2.0)
    >>> mixer.angle(0.25)
    0.5
    """

    kind: Literal["still", "steady", "sine"] = "still"
    center: Pair = (0.0, 0.0)
    rate: Real = 0.0
    amplitude: NonNegative = 0.0
    frequency: NonNegative = 0.0
    phase: Real = 0.0

    def __post_init__(self) -> None:
        if self.kind == "sine" and self.frequency == 0.0:
            raise InputError("frequency = 0: must be above 0 for a turn of kind 'sine'")

    @property
    def most_rate(self) -> float:
        """The largest angular velocity [rad/time]."""
        if self.kind == "sine":
            return FULL_TURN * self.frequency * self.amplitude
        return abs(self.rate) if self.kind == "steady" else 0.0

    @validated
    def angle(self, t: Real) -> float:
        """Angle at a time [rad]."""
        if self.kind == "sine":
            return self.amplitude * math.sin(FULL_TURN * self.frequency * t + self.phase)
        return self.rate * t if self.kind == "steady" else 0.0


@validated
@dataclass(frozen=True)
class Piston:
    """A mass by which a wall moves freely along its normal, driven by the disks that hit it.

    Its displacement s, from where the wall is given, follows M s'' = force + M g.n - spring s between hits; n is the
    normal of a line, towards the disks, or to the left of a segment on the way from its start to its end. A collision
    with a disk is one by the law, with the normal effective mass m M/(m + M) and the tangential one of a fixed wall.

    InputError if a number is not finite or out of its range.

    Parameters
    ----------
    mass : float
        M, above 0 [mass].
    force : float
        Constant force along n [mass length/time^2]; of a line, a positive one presses on the disks.
    spring : float
        Stiffness of a spring that is relaxed at s = 0, not below 0 [mass/time^2].
    displacement, velocity : float
        s and s' at the start [length], [length/time].
    low, high : float, optional
        Stops, which reflect it elastically: the least and the largest s [length]; none by default.

    Examples
    --------
    >>> import ifrdem
    >>> piston = ifrdem.Piston(mass=50.0, force=3.0, spring=2.0)
    >>> piston.energy(1.0, velocity=0.5)  # 50 0.5^2 / 2 - 3 + 2 / 2
    4.25
    """

    mass: Positive
    force: Real = 0.0
    spring: NonNegative = 0.0
    displacement: Real = 0.0
    velocity: Real = 0.0
    low: Real | None = None
    high: Real | None = None

    def __post_init__(self) -> None:
        low, high = self.stops
        if not low < high:
            raise InputError(f"piston low = {low:g}, high = {high:g}: low must be below high")
        if not low <= self.displacement <= high:
            raise InputError(
                f"piston displacement = {self.displacement:g}: it must not be below low, {low:g}, or above high, "
                f"{high:g}"
            )

    @property
    def stops(self) -> Pair:
        """The least and the largest displacement [length], infinite where there is no stop."""
        return -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high

    @validated
    def energy(self, displacement: Real, velocity: Real, pull: Real = 0.0) -> float:
        """Kinetic and potential energy, 0 at rest at s = 0; `pull` is M g.n, the component of its weight [energy]."""
        s = displacement
        return 0.5 * self.mass * velocity**2 - (self.force + pull) * s + 0.5 * self.spring * s * s
