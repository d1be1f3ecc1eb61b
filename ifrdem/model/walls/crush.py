"""Walls that approach each other to less than a disk's diameter, found before a run.

- Gaps are those from points along one wall, a quarter of a diameter apart, to the other wall, at sampled times.
- Steps of time: while the gap is g and the walls approach each other with at most the speed v, it stays above a
  diameter d for a time (g - d) / v. The next step is that long, or d / 8v where the walls are near.
- Only positions that face each other count: ends, corners, and points whose wall runs across the gap.
- Walls that meet in a corner, such as a floor and a side, do not crush disks. Neither do walls with a constant gap.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...tools.checked import Array
from ..box import Box
from .wall import FULL_TURN, Wall, wall_names

FACING = 0.5
"""Largest cosine between a wall and a gap across it."""
SHARP = 0.5
"""Smallest angle [rad] between two sides of a corner."""
ATTACHED = 1e-6
"""Gap in diameters of walls that touch."""
MOST_TIMES = 2000
"""Largest number of sampled times of a pair of walls."""


class WallWarning(UserWarning):
    """Warning of two walls that crush a disk between them.

    Examples
    --------
    >>> import ifrdem
    >>> issubclass(ifrdem.WallWarning, UserWarning)
    True
    """


@dataclass(frozen=True)
class Crush:
    """Numbers of two walls, the time [time] at which they are nearest or first too near, and the gap then [length]."""

    one: int
    other: int
    time: float
    gap: float


def crushes(walls: Sequence[Wall], box: Box, diameter: float, begin: float, end: float) -> Iterator[Crush]:
    """Pairs of walls that come nearer to each other than a diameter [length] between two times; the first such time."""
    if not any(wall.most_speed > abs(wall.surface_speed) for wall in walls):
        return
    samples = [_Samples.of(wall, box, diameter) for wall in walls]
    for i, j in itertools.combinations(range(len(walls)), 2):
        speed = _relative_speed(walls[i], walls[j])
        if speed > 0.0 and not _always_apart(walls[i], walls[j], diameter):
            found = _nearest(
                samples[i], samples[j], diameter, speed, *_times(walls[i], walls[j], box, begin, end)
            )
            if found is not None:
                yield Crush(i, j, *found)


def wall_pinch_warnings(
    walls: Sequence[Wall], box: Box, radius: Array, begin: float, end: float
) -> list[str]:
    """Warnings of walls that approach each other to less than the largest diameter, between two times [time].

    InputError names both walls and the time if they are lines that face each other, their gap falls below the smallest
    diameter, and the end of the run is known: no disk can leave the area between them. Other walls have ends, or a side
    behind them, where disks may escape.
    """
    names, smallest, diameter = wall_names(walls, box), 2.0 * float(radius.min()), 2.0 * float(radius.max())
    texts = []
    for found in crushes(walls, box, diameter, begin, end):
        one, other = walls[found.one], walls[found.other]
        both, when = (
            f"{names[found.one]} and {names[found.other]}",
            f"t = {found.time:.4g}, less than the diameter",
        )
        endless = one.geometry.is_endless and other.geometry.is_endless
        facing = endless and float(np.dot(one.towards, other.towards)) < -1.0 + 1e-9
        gated = one.opens_after is not None or other.opens_after is not None
        if facing and not gated and math.isfinite(end) and found.gap < smallest:
            raise InputError(
                f"{both} approach each other to {found.gap:.3g} at {when} {smallest:.3g} of the smallest disk, and all "
                "disks are between them: end the run before, or let a wall stop (moves_until) or open"
            )
        texts.append(
            f"{both} approach each other to {found.gap:.3g} at {when} {diameter:.3g}: a disk between them is crushed; "
            "end the run before, or let a wall stop (moves_until) or open"
        )
    return texts


def _relative_speed(one: Wall, other: Wall) -> float:
    same = (one.motion, one.turn, one.moving_times) == (other.motion, other.turn, other.moving_times)
    return 0.0 if same else sum(each.most_speed - abs(each.surface_speed) for each in (one, other))


def _always_apart(one: Wall, other: Wall, diameter: float) -> bool:
    """True if the rectangles that they sweep, or a line and the other's, are further apart than a diameter."""
    reach = one.motion.extent + other.motion.extent + diameter
    endless = [wall.geometry.is_endless for wall in (one, other)]
    if not math.isfinite(reach) or all(endless):
        return False
    if any(endless):
        line, thing = (one, other) if endless[0] else (other, one)
        corners = np.array(list(itertools.product(*np.transpose(thing.bounds()))))
        return bool(np.all(line.normal(corners)[1] > reach + line.motion.extent))
    (low, high), (low_1, high_1) = one.bounds(), other.bounds()
    return bool(np.any((low - high_1 > reach) | (low_1 - high > reach)))


def _times(one: Wall, other: Wall, box: Box, begin: float, end: float) -> tuple[float, float]:
    """Sampled times: two periods of the slower wall, or the time of a steady motion through the box."""
    last = 0.0
    for wall in (one, other):
        motion, turn = wall.motion, wall.turn
        if motion.kind == "steady" and motion.speed != 0.0:
            last = max(last, 2.0 * math.hypot(*box.lengths) / abs(motion.speed))
        elif motion.kind in ("sine", "sawtooth"):
            last = max(last, 2.0 / motion.frequency)
        if turn.kind == "sine":
            last = max(last, 2.0 / turn.frequency)
        elif turn.kind == "steady" and turn.rate != 0.0:
            last = max(last, 2.0 * FULL_TURN / abs(turn.rate))
    begin = max(begin, min(wall.moving_times[0] for wall in (one, other)))
    opened = min(math.inf if wall.opens_at is None else wall.opens_at for wall in (one, other))
    return begin, min(end, begin + last, opened)


@dataclass(frozen=True)
class _Samples:
    """Points along a wall as it is given, unit vectors along it there, and which of them are ends or corners."""

    wall: Wall
    points: Array
    along: Array
    sharp: Array
    side: float = 0.0  # of the disks: to the left (1) or right of the vectors along it; 0 for both

    @classmethod
    def of(cls, wall: Wall, box: Box, diameter: float) -> _Samples:
        shape = wall.geometry
        corners = shape.path(box.lengths)
        step = np.diff(corners, axis=0)
        length = np.hypot(*step.T)
        kept = length > 0.0
        if not kept.any():  # a post of radius 0
            return cls(wall, corners[:1], np.zeros((1, 2)), np.ones(1, dtype=bool))
        corners, step, length = np.concatenate((corners[:-1][kept], corners[-1:])), step[kept], length[kept]
        along = step / length[:, None]
        parts = np.maximum(1, np.ceil(length / (0.25 * diameter)).astype(np.int64))
        side = np.repeat(np.arange(len(parts)), parts)
        within = (np.arange(len(side)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[side]
        points = np.concatenate((corners[:-1][side] + within[:, None] * step[side], corners[-1:]))
        turn = np.arccos(np.clip(np.sum(along[1:] * along[:-1], axis=1), -1.0, 1.0))
        bent = np.concatenate(([True], turn > SHARP, [True]))
        if shape.is_circle or shape.is_endless:
            bent[[0, -1]] = False
        sharp = np.concatenate(((within == 0.0) & bent[:-1][side], bent[-1:]))
        along = along[np.concatenate((side, side[-1:]))]
        if shape.is_endless:
            inside = np.all((points >= 0.0) & (points <= box.lengths), axis=1)
            points, along, sharp = points[inside], along[inside], sharp[inside]
        return cls(wall, points, along, sharp, shape.side)

    def gap(self, other: Wall, t: float, diameter: float) -> float:
        """The smallest gap to another wall at a time [length], between places that face each other."""
        points, origin = self.wall.transform(self.points, t), self.wall.transform(np.zeros((1, 2)), t)
        along = self.wall.transform(self.along, t) - origin
        normal, distance = other.normal(points, t)
        facing = self.sharp | (np.abs(np.sum(along * normal, axis=1)) < FACING)
        # The gap must be where the disks are, not behind the wall: to the left of `along` is (-y, x) of it.
        facing &= self.side * (along[:, 0] * normal[:, 1] - along[:, 1] * normal[:, 0]) <= 0.0
        apart = distance[facing & (distance > ATTACHED * diameter)]
        return float(apart.min(initial=math.inf))


def _nearest(
    one: _Samples, other: _Samples, diameter: float, speed: float, begin: float, end: float
) -> tuple[float, float] | None:
    """Time and gap where two walls are nearest, if that is below a diameter and they were further apart before."""
    t, least, widest, at = begin, math.inf, 0.0, begin
    for _ in range(MOST_TIMES):
        if t > end:
            break
        gap = min(one.gap(other.wall, t, diameter), other.gap(one.wall, t, diameter))
        if gap < least:
            least, at = gap, t
        if math.isfinite(gap):
            widest = max(widest, gap)
        t += max((gap - diameter) / speed if math.isfinite(gap) else math.inf, 0.125 * diameter / speed)
    return (at, least) if least < diameter and widest > least + 0.25 * diameter else None
