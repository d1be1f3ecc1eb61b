"""The free area that walls leave to disks: its area, its boundary, and how far disks are from it.

The free area is the part of the box on the disks' side of every wall: in front of lines, inside of containers, outside
of posts, and on the side of a polygon that holds the disks. Segments, arcs and polylines take none of it. Moving walls
stand where they are at one time. A packing fraction between walls is the area of the disks over the free area.

The area is exact, by Green's theorem: half the integral of x dy - y dx along the boundary, whose pieces are those parts
of lines and circles that are on the right side of all others. With polygons, which may have thousands of sides, it is
the sum of the exact widths along lines across the box, between corners and SCANS of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...tools.checked import Array
from ..box import Box
from ..density import disk_area, packing_fraction
from .boundaries import Boundary, CircleBoundary, LineBoundary, meetings
from .wall import Wall, sides

ROUNDING = 1e-9
"""Distance of two boundaries, as a part of the box, at which they are one and the same."""

SCANS = 1000
"""Lines along x that measure a free area with polygons: exactly without circles, else to some 1e-5."""

# Where a piece is tested; its middle may be where another boundary touches it.
_ALONG = np.array([0.37, 0.61])
_Piece = tuple[Boundary, float, float]


@dataclass(frozen=True)
class FreeArea:
    """Area that disks can be in, in a box between walls, at one time."""

    box: Box  # sides that are not periodic are walls too
    walls: tuple[Wall, ...] = ()  # others
    time: float = 0.0  # at which moving walls stand there [time]
    gates_open: bool = False  # there are gates too, which count as open

    @property
    def all_walls(self) -> tuple[Wall, ...]:
        """Every wall, the sides of the box included."""
        return (*self.walls, *sides(self.box))

    @property
    def name(self) -> str:
        """Words for the area, after "packing fraction" in messages: none for a box without walls."""
        if not self.all_walls:
            return ""
        gates = "open" if self.gates_open else "closed" if any(wall.gated for wall in self.walls) else ""
        return " of the free area" + (f" with gates {gates}" if gates else "")

    def gap(self, position: Array, radius: Array) -> Array:
        """Distance of each disk to the nearest wall [length], (n,); negative if they overlap, inf without walls."""
        gaps = [wall.gap(position, radius, self.time) for wall in self.all_walls]
        return np.min(gaps, axis=0) if gaps else np.full(len(position), np.inf)

    def area(self, inset: float = 0.0) -> float:
        """Free area [length^2], or that of what is at least `inset` [length] from every wall: 0 if nothing is.

        An inset leaves segments aside. An open box has an infinite one.
        """
        if self.box.is_open:
            return math.inf
        return self._area(self._boundaries(inset))

    def strips(self, axis: int, edges: Array, inset: float = 0.0) -> Array:
        """Free areas [length^2] between lines across `axis` at `edges` [length], shape (edges - 1,).

        With an `inset` [length], of what is so far from every wall; as in `area`.
        """
        boundaries = self._boundaries(inset)
        return np.array(
            [self._area([*boundaries, *_between(axis, *each)]) for each in itertools.pairwise(edges)]
        )

    def cells(self, x: Array, y: Array) -> Array:
        """Free areas [length^2] of the cells between lines at x and at y [length], shape (x - 1, y - 1)."""
        found = np.outer(np.diff(x), np.diff(y))
        middle = np.stack(np.meshgrid(0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1]), indexing="ij"), axis=-1)
        half = 0.5 * math.hypot(np.diff(x).max(), np.diff(y).max())
        points = middle.reshape(-1, 2)
        # Only cells that a wall may cross, or that are beyond one; sides of the box are no such walls.
        gaps = [wall.gap(points, np.full(len(points), half), self.time) for wall in self.walls]
        near = np.min(gaps, axis=0) < 0.0 if gaps else np.zeros(len(points), dtype=bool)
        boundaries = self._boundaries(0.0)
        for i, j in np.argwhere(near.reshape(found.shape)):
            cut = (*_between(0, x[i], x[i + 1]), *_between(1, y[j], y[j + 1]))
            found[i, j] = self._area([*boundaries, *cut])
        return found

    def rings(self, center: tuple[float, float], edges: Array) -> Array:
        """Free areas [length^2] between circles of the radii `edges` [length] around a point, shape (edges - 1,)."""
        boundaries = self._boundaries(0.0)
        within = [self._area([*boundaries, CircleBoundary(center, float(r), inside=True)]) for r in edges]
        return np.diff(within)

    def packing_fraction(self, radius: Array) -> float:
        """Fraction of the free area that disks of these radii [length], shape (n,), cover."""
        return self.covered_part(disk_area(radius))

    def covered_part(self, covered: float) -> float:
        """Fraction of the free area that disks of this total area [length^2] cover."""
        area = self.area() if self.all_walls else self.box.area
        return packing_fraction(covered, area)

    def wall_length(self, inset: float = 0.0) -> float:
        """Length of what is `inset` [length] from walls: along it move the centres of disks that touch them.

        Both sides of a segment count, and the half circles around its ends, wherever it stands.
        """
        boundaries = self._boundaries(inset)
        fixed = {self._side(axis, end) for axis in (0, 1) if self.box.periodic[axis] for end in (0, 1)}
        walls = sum(piece.length(s, s_1) for piece, s, s_1 in self._pieces(boundaries) if piece not in fixed)
        for wall in self.walls:
            shape = wall.geometry
            if shape.faces:
                walls += shape.faces * float(np.hypot(*np.diff(wall.outline(self.time), axis=0).T).sum())
                walls += 2.0 * math.pi * inset if shape.has_ends else 0.0
        return walls

    def bounds(self) -> tuple[Array, Array]:
        """Lower left and upper right corner of a rectangle around the free area [length]; the box if there is none."""
        lengths = np.array(self.box.lengths)
        pieces = self._pieces(self._boundaries(0.0)) if self.walls else ()
        points = [piece.at(np.array(piece.extremes(s, s_1))) for piece, s, s_1 in pieces]
        low, high = np.zeros(2), lengths
        if points:
            found = np.clip(np.concatenate(points), 0.0, lengths)
            low, high = found.min(axis=0), found.max(axis=0)
        for corners, inside in self._polygons:
            if inside:
                low, high = np.maximum(low, corners.min(axis=0)), np.minimum(high, corners.max(axis=0))
        # Across a periodic side the free area continues, where it reaches it.
        open_ = (low <= ROUNDING * lengths) | (high >= (1.0 - ROUNDING) * lengths)
        open_ &= np.array(self.box.periodic)
        return np.where(open_, 0.0, low), np.where(open_, lengths, high)

    def spans(self, radius: Array) -> tuple[Array, Array]:
        """Lowest and highest x and y [length] that the centre of each disk can have, shape (n, 2)."""
        low, high = self.bounds()
        whole = np.array(self.box.periodic) & (low == 0.0) & (high == self.box.lengths)
        margin = np.where(whole, 0.0, radius[:, None])
        return low + margin, high - margin

    def _side(self, axis: int, end: int) -> LineBoundary:
        normal = np.eye(2)[axis] * (1.0 - 2.0 * end)
        return _line(np.array(self.box.lengths) * end * np.eye(2)[axis], normal)

    def _boundaries(self, inset: float) -> list[Boundary]:
        """The boundary of the free area is made of parts of these; walls first."""
        found: list[Boundary] = []
        for wall in self.all_walls:
            origin = wall.transform(np.array([wall.origin]), self.time)[0]
            if (boundary := wall.geometry.boundary(origin, inset)) is not None:
                found.append(boundary)
        return found + [self._side(axis, end) for axis in (0, 1) if self.box.periodic[axis] for end in (0, 1)]

    def _area(self, boundaries: Sequence[Boundary]) -> float:
        if any(
            isinstance(each, CircleBoundary) and each.inside and each.radius <= 0.0 for each in boundaries
        ):
            return 0.0
        if self._polygons:
            return self._scanned(boundaries)
        return max(0.0, sum(piece.green(s, s_1) for piece, s, s_1 in self._pieces(boundaries)))

    @property
    def _polygons(self) -> list[tuple[Array, bool]]:
        """Corners of closed outlines of which one side holds the disks, and if that is the inside."""
        held = ((wall, wall.geometry.enclosed) for wall in self.walls)
        return [(wall.outline(self.time), side == "inside") for wall, side in held if side is not None]

    def _scanned(self, boundaries: Sequence[Boundary]) -> float:
        """Area by its width along lines: between the places where boundaries cross one, all of it is free or none."""
        width, height = self.box.lengths
        area = 0.0
        polygons = self._polygons
        corners_y = np.clip(np.concatenate([corners[:, 1] for corners, _ in polygons]), 0.0, height)
        # Widths are linear between these.
        edges = np.unique(np.concatenate([np.linspace(0.0, height, SCANS + 1), corners_y]))
        for y, step in zip(0.5 * (edges[1:] + edges[:-1]), np.diff(edges), strict=True):
            across = _line(np.array((0.0, y)), np.array((0.0, 1.0)))
            met = [across.at(np.array([s]))[0, 0] for other in boundaries for s in meetings(across, other)]
            cuts = []
            for corners, _ in polygons:
                y_0, y_1 = corners[:-1, 1], corners[1:, 1]
                sides = (y_0 > y) != (y_1 > y)
                part = (y - y_0[sides]) / (y_1 - y_0)[sides]
                cuts.append(np.sort(corners[:-1, 0][sides] + part * np.diff(corners[:, 0])[sides]))
            x = np.unique(np.clip(np.concatenate([[0.0, width], met, *cuts]), 0.0, width))
            middle = 0.5 * (x[1:] + x[:-1])
            points = np.column_stack((middle, np.full(len(middle), y)))
            inside = np.ones(len(middle), dtype=bool)
            for other in boundaries:
                inside &= other.inward(points) > 0.0
            for cut, (_, within) in zip(cuts, polygons, strict=True):
                inside &= (np.searchsorted(cut, middle) % 2 == 1) == within
            area += step * float(np.diff(x)[inside].sum())
        return area

    def _pieces(self, boundaries: Sequence[Boundary]) -> Iterator[_Piece]:
        """Those parts of the boundaries that bound the free area, each with where it begins and ends."""
        size = max(self.box.lengths)
        same = ROUNDING * size
        for i, one in enumerate(boundaries):
            if isinstance(one, CircleBoundary) and one.radius <= 0.0:
                continue
            far = 4.0 * size + 2.0 * float(np.max(np.abs(one.origin)))
            low, high = one.ends(far)
            met = [s for j, other in enumerate(boundaries) if j != i for s in meetings(one, other)]
            ends = sorted({low, high, *(s for s in met if low < s < high)})
            for s, s_1 in itertools.pairwise(ends):
                tested = one.at(s + _ALONG * (s_1 - s))
                inward = [(j, other.inward(tested)) for j, other in enumerate(boundaries) if j != i]
                inside = all(np.all(d > -same) for _, d in inward)
                if inside and not any(j < i and np.all(np.abs(d) <= same) for j, d in inward):
                    yield one, s, s_1


def _between(axis: int, low: float, high: float) -> tuple[LineBoundary, LineBoundary]:
    """Lines across an axis that have the area between them on their inner sides."""
    across = np.eye(2)[axis]
    return _line(low * across, across), _line(high * across, -across)


def _line(point: Array, normal: Array) -> LineBoundary:
    return LineBoundary((float(point[0]), float(point[1])), (float(normal[0]), float(normal[1])))
