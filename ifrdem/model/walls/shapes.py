"""Shapes of walls: all geometry that depends on the shape, of a wall as it is given, before it moves.

`SHAPES` has a class for each. To add one, write a class, give it a constructor in `wall.Wall`, keys in
`case/walls_section.py`, and its pieces a shape in `kernels/walls/shapes.py`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...tools.checked import Array
from . import outlines
from .boundaries import Boundary, CircleBoundary, LineBoundary

if TYPE_CHECKING:
    from .wall import Wall

FULL_TURN = 2.0 * math.pi
AT_ONCE = 2_000_000
"""Largest number of pairs of a point and a side of a wall in one array."""
_QUARTER = 0.5 * math.pi


class Pieces(NamedTuple):
    """Pieces of a wall, of one kind of `kinds.PIECES`, with what rows of `columns.WALL` hold of them."""

    kind: str
    origin: Array  # (pieces, 2)
    towards: Array = np.zeros(2)  # (pieces, 2) or (2,)
    radius: float = 0.0
    half: float = 0.0


class Shape:
    """Geometry of a wall; base of all shapes, and a thin wall with disks on both sides where they do not say else.

    Attributes
    ----------
    can_be_piston, can_turn, is_endless, is_circle : bool
    faces : int
        Sides of a thin wall that disks touch; 0 of one that bounds the free area.
    has_ends : bool
        If a thin wall has two ends, which disks can go around.
    side : float
        Of the outline, on which disks are: 1 to the left, -1 to the right, 0 for both.
    encloses : bool
        If all disks are in front of it, so that where it is out of the box there may be no free area.
    presses : bool
        If it is curved about the disks.
    """

    can_be_piston = is_endless = is_circle = encloses = presses = False
    can_turn = has_ends = True
    faces, side = 2, 0.0

    def __init__(self, wall: Wall) -> None:
        self.origin, self.towards, self.radius = wall.origin, np.array(wall.towards), wall.radius
        self.angles, self.points, self.holds = wall.angles, wall.points, wall.holds
        self.start = np.array((wall.origin,), dtype=np.float64)

    @classmethod
    def checked(cls, name: str, wall: Wall) -> dict[str, Any]:
        """Fields of a wall that are to be replaced; InputError if it has wrong ones for this shape."""
        if wall.points:
            raise InputError(f"{name}, points: only a polyline or polygon has them")
        return {}

    def pieces(self) -> list[Pieces]:
        """The pieces that kernels collide disks with."""
        # Abstract: a wall has one of the classes of `SHAPES`, never this one.
        raise NotImplementedError

    def nearest(self, position: Array) -> tuple[Array, Array]:
        """Unit vectors from the wall to points, shape (n, 2), and distances, as of `Wall.normal`."""
        # Abstract, as `pieces`: each class of `SHAPES` has its own.
        raise NotImplementedError

    def outline(self, step: float = 0.05) -> Array:
        """Points along the wall, shape (points, 2), in steps of this angle [rad] along a circle or arc."""
        # Abstract, as `pieces`: each class of `SHAPES` has its own.
        raise NotImplementedError

    def path(self, lengths: tuple[float, float]) -> Array:
        """Outline, also for an endless wall: until beyond a box of these sides [length]."""
        return self.outline()

    def extremes(self) -> Array:
        """Points between which it lies, along x and y."""
        return self.outline()

    def lever(self, center: Any) -> float:
        """Distance of its farthest point from a centre [length]."""
        return float(np.hypot(*(self.outline() - center).T).max())

    def boundary(self, origin: Any, inset: float) -> Boundary | None:
        """The boundary `inset` [length] inside a wall that bounds the free area; `origin` is its reference point."""
        return None

    @property
    def enclosed(self) -> str | None:
        """The side, "inside" or "outside", of its closed outline that the disks are on; None without one."""
        return None


class Line(Shape):
    """An endless straight wall."""

    can_be_piston = is_endless = encloses = True
    can_turn = has_ends = False
    faces, side = 0, 1.0

    @classmethod
    def checked(cls, name: str, wall: Wall) -> dict[str, Any]:
        length = math.hypot(*wall.towards)
        if length == 0.0:
            raise InputError(f"{name}, towards = (0, 0): must not be 0")
        return super().checked(name, wall) | {"towards": (wall.towards[0] / length, wall.towards[1] / length)}

    def pieces(self) -> list[Pieces]:
        return [Pieces("line", self.start, self.towards)]

    def nearest(self, position: Array) -> tuple[Array, Array]:
        d = position - self.origin
        return np.broadcast_to(self.towards, d.shape), d @ self.towards

    def outline(self, step: float = 0.05) -> Array:
        return np.empty((0, 2))

    def path(self, lengths: tuple[float, float]) -> Array:
        size = 2.0 * math.hypot(*lengths)
        along = np.array((self.towards[1], -self.towards[0]))
        foot = np.array(self.origin) + ((0.5 * np.array(lengths) - self.origin) @ along) * along
        return np.array((foot - size * along, foot + size * along))

    def extremes(self) -> Array:
        return np.array((self.origin,))

    def lever(self, center: Any) -> float:
        return 0.0

    def boundary(self, origin: Any, inset: float) -> Boundary:
        x, y = origin + inset * self.towards
        return LineBoundary((float(x), float(y)), (float(self.towards[0]), float(self.towards[1])))


class Segment(Shape):
    """A straight wall with two ends."""

    can_be_piston = True

    @classmethod
    def checked(cls, name: str, wall: Wall) -> dict[str, Any]:
        if math.hypot(*wall.towards) == 0.0:
            raise InputError(f"{name}, start and end must differ")
        return super().checked(name, wall)

    def pieces(self) -> list[Pieces]:
        return [Pieces("segment", self.start, self.towards)]

    def nearest(self, position: Array) -> tuple[Array, Array]:
        d = position - self.origin
        along = np.clip(d @ self.towards / (self.towards @ self.towards), 0.0, 1.0)
        d = d - along[:, None] * self.towards
        r = np.hypot(d[:, 0], d[:, 1])
        return unit(d, r), r

    def outline(self, step: float = 0.05) -> Array:
        return np.array((self.origin, np.add(self.origin, self.towards)))


class Circle(Shape):
    """A whole circle."""

    is_circle = True
    has_ends = False
    faces = 0

    def on_circle(self, angle: Any) -> Array:
        """Points at angles [rad], shape (angles, 2)."""
        return np.array(self.origin) + self.radius * np.column_stack((np.cos(angle), np.sin(angle)))

    def outline(self, step: float = 0.05) -> Array:
        begin, end = self.range
        return self.on_circle(np.linspace(begin, end, 2 + int((end - begin) / step)))

    @property
    def range(self) -> tuple[float, float]:
        """Angles where it begins and ends."""
        return 0.0, FULL_TURN

    def extremes(self) -> Array:
        return np.array((np.subtract(self.origin, self.radius), np.add(self.origin, self.radius)))

    def lever(self, center: Any) -> float:
        return self.radius + math.hypot(*np.subtract(self.origin, center))

    def outwards(self, position: Array) -> tuple[Array, Array]:
        """Unit vectors from the centre to points, and distances from it."""
        d = position - self.origin
        r = np.hypot(d[:, 0], d[:, 1])
        return unit(d, r), r

    def boundary(self, origin: Any, inset: float) -> Boundary | None:
        inside = self.side > 0.0
        radius = self.radius - inset if inside else self.radius + inset
        return CircleBoundary((float(origin[0]), float(origin[1])), radius, inside)


class Container(Circle):
    """A circle around the disks."""

    encloses = presses = True
    side = 1.0

    @classmethod
    def checked(cls, name: str, wall: Wall) -> dict[str, Any]:
        if wall.radius == 0.0:
            raise InputError(f"{name}, radius = 0: must be above 0")
        return super().checked(name, wall)

    def pieces(self) -> list[Pieces]:
        return [Pieces("container", self.start, radius=self.radius)]

    def nearest(self, position: Array) -> tuple[Array, Array]:
        away, r = self.outwards(position)
        return -away, self.radius - r


class Post(Circle):
    """A circle among the disks."""

    side = -1.0

    def pieces(self) -> list[Pieces]:
        return [Pieces("post", self.start, radius=self.radius)]

    def nearest(self, position: Array) -> tuple[Array, Array]:
        away, r = self.outwards(position)
        return away, r - self.radius


class Arc(Circle):
    """A part of a circle, without thickness."""

    is_circle = False
    has_ends = presses = True
    faces = 2

    @classmethod
    def checked(cls, name: str, wall: Wall) -> dict[str, Any]:
        begin, end = wall.angles
        if wall.radius == 0.0:
            raise InputError(f"{name}, radius = 0: must be above 0")
        if not 0.0 < end - begin <= FULL_TURN * (1.0 + 1e-15):
            raise InputError(
                f"{name}, angles = ({begin:.6g}, {end:.6g}): the second must be above the first, by a full turn (2 pi) "
                "at most; an arc without length is a post of radius 0"
            )
        return super().checked(name, wall)

    @property
    def range(self) -> tuple[float, float]:
        return self.angles

    @property
    def ends(self) -> Array:
        """Ends [length], shape (2, 2); none of a whole circle."""
        begin, end = self.angles
        if end - begin >= FULL_TURN * (1.0 - 1e-15):
            return np.empty((0, 2))
        return self.on_circle(np.array(self.angles))

    def pieces(self) -> list[Pieces]:
        begin, end = self.angles
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        out = np.array((math.cos(middle), math.sin(middle)))
        faces = [Pieces(kind, self.start, out, self.radius, half) for kind in ("arc inside", "arc outside")]
        return [*faces, Pieces("post", self.ends)]

    def nearest(self, position: Array) -> tuple[Array, Array]:
        d = position - self.origin
        away, r = self.outwards(position)
        distance = r - self.radius
        away, distance = away * np.where(distance < 0.0, -1.0, 1.0)[:, None], np.abs(distance)
        middle, half = 0.5 * (self.angles[0] + self.angles[1]), 0.5 * (self.angles[1] - self.angles[0])
        outside_arc = np.abs((np.arctan2(d[:, 1], d[:, 0]) - middle + math.pi) % FULL_TURN - math.pi) > half
        ends = self.ends
        if outside_arc.any() and len(ends):
            to_ends = position[outside_arc, None] - ends
            far = np.hypot(to_ends[..., 0], to_ends[..., 1])
            which = np.argmin(far, axis=1)
            rows = np.arange(len(which))
            distance[outside_arc] = far[rows, which]
            away[outside_arc] = unit(to_ends[rows, which], distance[outside_arc])
        return away, distance

    def extremes(self) -> Array:
        first, last = (each / _QUARTER for each in self.angles)
        quarters = np.arange(math.ceil(first), math.floor(last) + 1) * _QUARTER
        return np.concatenate((self.ends, self.on_circle(quarters)))

    def lever(self, center: Any) -> float:
        return Shape.lever(self, center)

    def boundary(self, origin: Any, inset: float) -> None:
        return None


class Polyline(Shape):
    """Straight sides from point to point."""

    closed = False

    @classmethod
    def checked(cls, name: str, wall: Wall) -> dict[str, Any]:
        points = outlines.checked_points(name, wall.points, closed=cls.closed)
        return {"points": tuple(points), "origin": points[0]}

    def pieces(self) -> list[Pieces]:
        corners = self.outline()
        return [Pieces("segment", corners[:-1], np.diff(corners, axis=0))]

    def outline(self, step: float = 0.05) -> Array:
        closed = self.points[:1] if self.closed else ()
        return np.array((*self.points, *closed), dtype=np.float64).reshape(-1, 2)

    def nearest(self, position: Array) -> tuple[Array, Array]:
        away, distance, crossed = self._nearest_side(position)
        if (held := self.enclosed) is not None:
            misplaced = (crossed % 2 == 1) != (held == "inside")
            sign = np.where(misplaced, -1.0, 1.0)
            return away * sign[:, None], distance * sign
        return away, distance

    def _nearest_side(self, position: Array) -> tuple[Array, Array, NDArray[np.int64]]:
        """Unit vectors and distances from the nearest side, and how many sides a ray along +x crosses."""
        corners = self.outline()
        a, q = corners[:-1], np.diff(corners, axis=0)
        n, square = len(position), np.sum(q * q, axis=1)
        away, distance, crossed = np.zeros((n, 2)), np.full(n, np.inf), np.zeros(n, dtype=np.int64)
        part = max(1, AT_ONCE // max(n, 1))
        for first in range(0, len(q), part):
            some = slice(first, first + part)
            d = position[:, None] - a[some]
            along = np.clip(np.einsum("nkx,kx->nk", d, q[some]) / square[some], 0.0, 1.0)
            left = d - along[..., None] * q[some]
            r = np.hypot(left[..., 0], left[..., 1])
            nearest_one = np.argmin(r, axis=1)
            rows = np.arange(n)
            least = r[rows, nearest_one]
            better = least < distance
            distance[better] = least[better]
            away[better] = left[rows, nearest_one][better]
            if self.enclosed is not None:  # each side with its lower end
                y_0, y_1 = d[..., 1], d[..., 1] - q[some][:, 1]
                straddles = (y_0 >= 0.0) != (y_1 >= 0.0)
                with np.errstate(divide="ignore", invalid="ignore"):
                    beyond = d[..., 0] < q[some][:, 0] * y_0 / q[some][:, 1]
                crossed += np.count_nonzero(straddles & beyond, axis=1)
        return unit(away, distance), distance, crossed


class Polygon(Polyline):
    """The closed outline through some points."""

    closed = True
    has_ends = False

    def __init__(self, wall: Wall) -> None:
        super().__init__(wall)
        self.faces = 2 if self.holds == "both" else 1

    @property
    def enclosed(self) -> str | None:
        return None if self.holds == "both" else self.holds


SHAPES: dict[str, type[Shape]] = {
    "line": Line, "segment": Segment, "container": Container, "post": Post, "arc": Arc, "polyline": Polyline,
    "polygon": Polygon,
}  # fmt: skip


def unit(vectors: Array, length: Array) -> Array:
    """Unit vectors along vectors, shape (n, 2), of these lengths, shape (n,); along x where the length is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(length[:, None] > 0.0, vectors / length[:, None], (1.0, 0.0))
