"""Boundaries of a free area: parts of lines and circles, with the area and length that they bound."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...tools.checked import Array

_QUARTER = 0.5 * math.pi


@dataclass(frozen=True)
class LineBoundary:
    """A straight boundary through `origin`; `normal` is its unit normal into the free area."""

    origin: tuple[float, float]
    normal: tuple[float, float]

    def inward(self, points: Array) -> Array:
        """Distances from points, shape (n, 2), to the boundary, positive inside."""
        return (points - self.origin) @ np.array(self.normal)

    def at(self, s: Array) -> Array:
        """Points at the lengths s from `origin`, walking with the free area on the left."""
        direction = np.array((self.normal[1], -self.normal[0]))
        return np.array(self.origin) + s[:, None] * direction

    def ends(self, far: float) -> tuple[float, float]:
        """Largest and smallest s."""
        return -far, far

    def green(self, s: float, s_1: float) -> float:
        """Half the integral of x dy - y dx from s to s_1."""
        (x, y), (x_1, y_1) = self.at(np.array((s, s_1)))
        return 0.5 * float(x * y_1 - x_1 * y)

    def length(self, s: float, s_1: float) -> float:
        """Length of the piece from s to s_1."""
        return s_1 - s

    def extremes(self, s: float, s_1: float) -> list[float]:
        """Places along the piece where x or y can be largest or smallest."""
        return [s, s_1]


@dataclass(frozen=True)
class CircleBoundary:
    """A round boundary: the free area is inside of it (a container), or outside (a post)."""

    origin: tuple[float, float]
    radius: float
    inside: bool

    def inward(self, points: Array) -> Array:
        """See `LineBoundary`."""
        r = np.hypot(*(points - self.origin).T)
        return self.radius - r if self.inside else r - self.radius

    def at(self, s: Array) -> Array:
        """Points at the angles s."""
        return np.array(self.origin) + self.radius * np.column_stack((np.cos(s), np.sin(s)))

    def ends(self, far: float) -> tuple[float, float]:
        """Range of s: all angles, from where no other boundary has a special point."""
        return 0.1, 0.1 + 2.0 * math.pi

    def green(self, s: float, s_1: float) -> float:
        """As for a line; around a post the free area is on the left clockwise."""
        (x, y), r = self.origin, self.radius
        turn = x * (math.sin(s_1) - math.sin(s)) - y * (math.cos(s_1) - math.cos(s))
        return (0.5 if self.inside else -0.5) * r * (r * (s_1 - s) + turn)

    def length(self, s: float, s_1: float) -> float:
        """See `LineBoundary`."""
        return self.radius * (s_1 - s)

    def extremes(self, s: float, s_1: float) -> list[float]:
        """See `LineBoundary`."""
        quarters = np.arange(math.ceil(s / _QUARTER), math.floor(s_1 / _QUARTER) + 1) * _QUARTER
        return [s, s_1, *quarters]


Boundary = LineBoundary | CircleBoundary


def meetings(one: Boundary, other: Boundary) -> list[float]:
    """Lengths or angles along `one` at which it meets `other`."""
    if isinstance(one, LineBoundary):
        x, y = (float(value) for value in np.subtract(one.origin, other.origin))
        ux, uy = one.normal[1], -one.normal[0]
        if isinstance(other, LineBoundary):
            across = ux * other.normal[0] + uy * other.normal[1]
            return [-(x * other.normal[0] + y * other.normal[1]) / across] if abs(across) > 1e-12 else []
        middle = -(x * ux + y * uy)
        square = other.radius**2 - (x * one.normal[0] + y * one.normal[1]) ** 2
        return [middle - math.sqrt(square), middle + math.sqrt(square)] if square > 0.0 else []
    if isinstance(other, LineBoundary):
        points = other.at(np.array(meetings(other, one)))
    else:
        dx, dy = (float(value) for value in np.subtract(other.origin, one.origin))
        d = math.hypot(dx, dy)
        if d == 0.0 or not abs(one.radius - other.radius) < d < one.radius + other.radius:
            return []
        along = (d * d + one.radius**2 - other.radius**2) / (2.0 * d)
        across = math.sqrt(max(0.0, one.radius**2 - along**2))
        foot = np.array(one.origin) + along / d * np.array((dx, dy))
        step = across / d * np.array((-dy, dx))
        points = np.array((foot - step, foot + step))
    low, _ = one.ends(0.0)
    angles = (math.atan2(y - one.origin[1], x - one.origin[0]) for x, y in points)
    return [float((angle - low) % (2.0 * math.pi) + low) for angle in angles]
