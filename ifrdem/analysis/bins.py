"""Bins of space (strips, cells of a grid, rings): the bin of a point, and the parts of disks and lines in bins.

The area of a disk is divided exactly among bins. A line is cut where it leaves a bin. Copies continue both through
periodic sides; parts beyond the outermost edges belong to no bin.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..model.box import Box
from ..model.walls.free_area import FreeArea
from ..tools.checked import Array
from ..tools.reprs import Brief

Indices = NDArray[np.intp]


class Overlaps(NamedTuple):
    """Parts of disks in bins: number of the disk, of the bin, and area [length^2]; each of shape (p,)."""

    disk: Indices
    bin: Indices
    area: Array


class LinePieces(NamedTuple):
    """Parts of lines in bins: number of the line, of the bin, share of its length (p,), and middle [length], (p, 2)."""

    line: Indices
    bin: Indices
    share: Array
    middle: Array


@dataclass(frozen=True, eq=False, repr=False)
class Bins(Brief, ABC):
    """Bins of equal width in a box, numbered as the elements of an array of `shape`; -1 is outside of all bins."""

    box: Box
    axes: tuple[str, ...]
    edges: tuple[Array, ...]
    """Edges between the bins along each axis [length], (bins + 1,)."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of bins along each axis."""
        return tuple(len(one) - 1 for one in self.edges)

    @property
    def count(self) -> int:
        """Number of all bins."""
        return int(np.prod(self.shape))

    @property
    def directions(self) -> tuple[str, str]:
        """Names of the components of vectors."""
        return ("x", "y")

    @property
    def continued(self) -> tuple[int, ...]:
        """Axes across whose periodic sides disks and lines are copied; not along strips, which span the box."""
        return (1, 0)

    def components(self, position: Array, vector: Array) -> Array:
        """Components along `directions` of vectors at positions, both (n, 2)."""
        return vector

    @abstractmethod
    def of(self, position: Array) -> Indices:
        """Number of the bin of each point [length], (n,)."""

    @abstractmethod
    def areas(self, free_area: FreeArea) -> Array:
        """Free area [length^2] of each bin, (count,)."""

    @abstractmethod
    def shared(self, position: Array, radius: Array) -> Overlaps:
        """Areas of disks in bins, without copies."""

    @abstractmethod
    def cuts(self, start: Array, vector: Array) -> Iterator[Array]:
        """Fractions of lines, 0 to 1, at which they cross an edge, each (n,); other numbers where they do not."""

    def overlaps(self, position: Array, radius: Array, time: float) -> Overlaps:
        """Areas of disks in bins."""
        reach = np.repeat(radius[:, None], 2, axis=1)
        which, moved = self._copies(position, -reach, reach, time)
        found = self.shared(moved, radius[which])
        return found._replace(disk=which[found.disk])

    def pieces(self, start: Array, vector: Array, time: float = 0.0) -> LinePieces:
        """Pieces in bins of the lines from `start` to `start + vector` [length], (n, 2); no vector may be zero."""
        low, high = np.minimum(vector, 0.0), np.maximum(vector, 0.0)
        which, moved = self._copies(start, low, high, time)
        step = vector[which]
        at = [np.zeros(len(which)), *self.cuts(moved, step), np.ones(len(which))]
        cut = np.sort(np.nan_to_num(np.clip(np.stack(at, axis=1), 0.0, 1.0)), axis=1)
        share, between = np.diff(cut, axis=1), 0.5 * (cut[:, 1:] + cut[:, :-1])
        line, column = np.nonzero(share > 0.0)
        middle = moved[line] + between[line, column, None] * step[line]
        bins = self.of(middle)
        inside = bins >= 0
        return LinePieces(which[line][inside], bins[inside], share[line, column][inside], middle[inside])

    def _copies(self, position: Array, low: Array, high: Array, time: float) -> tuple[Indices, Array]:
        """Numbers and positions of bodies from position + low to position + high, (n, 2), and of their copies.

        A copy stands for the part beyond a periodic side.
        """
        which, moved = np.arange(len(position)), np.array(position, dtype=np.float64)
        for axis in self.continued:
            if not self.box.periodic[axis]:
                continue
            step = np.eye(2)[axis] * self.box.lengths[axis]
            if axis == 1 and self.box.shear_rate:
                step[0] = self.box.image_above(time)
            below = moved[:, axis] + low[which, axis] < 0.0
            above = moved[:, axis] + high[which, axis] > self.box.lengths[axis]
            moved = np.concatenate((moved, moved[below] + step, moved[above] - step))
            which = np.concatenate((which, which[below], which[above]))
            if step[0] and axis == 1:
                moved[:, 0] %= self.box.lengths[0]
        return which, moved


def _index(edges: Array, coordinate: Array) -> Indices:
    """Number of the interval between edges of equal distance; -1 below and the number of intervals above them."""
    n = len(edges) - 1
    return np.clip(np.floor((coordinate - edges[0]) * (n / (edges[-1] - edges[0]))), -1, n).astype(np.intp)


def _inside(index: Indices, edges: Array) -> NDArray[np.bool_]:
    return (index >= 0) & (index < len(edges) - 1)


def _crossed(edges: Array, low: Array, high: Array) -> Iterator[Array]:
    """Edges between two coordinates of each line, (n,), as many as the longest has; a line may have fewer."""
    first = _index(edges, low) + 1
    width = (edges[-1] - edges[0]) / (len(edges) - 1)
    for i in range(int(np.max(_index(edges, high) - first, initial=-1)) + 1):
        yield edges[0] + width * (first + i)


def area_beyond(a: Array, b: Array) -> Array:
    """Area of the part x > a, y > b of the unit disk."""
    a, b = np.clip(a, -1.0, 1.0), np.clip(b, -1.0, 1.0)
    cap_a, cap_b = _cap(a), _cap(b)
    # `corner` if the point (a, b) is in the disk; else one of the caps, or the disk without both.
    corner = a * b + 0.5 * (cap_a + cap_b) - 0.25 * np.pi
    outside = np.where(
        a >= 0.0, np.where(b >= 0.0, 0.0, cap_a), np.where(b >= 0.0, cap_b, cap_a + cap_b - np.pi)
    )
    return np.where(a * a + b * b < 1.0, corner, outside)


def _cap(u: Array) -> Array:
    """Area of the part x > u of the unit disk."""
    return np.asarray(np.arccos(u) - u * np.sqrt(1.0 - u * u))


def area_within(distance: Array, radius: Array, circle: Array) -> Array:
    """Area common to a circle and to disks at a distance from its centre [length^2]."""
    d, R, c = np.broadcast_arrays(distance, radius, np.maximum(circle, 0.0))
    smaller = np.minimum(R, c)
    with np.errstate(divide="ignore", invalid="ignore"):
        # From the centre of each, the line through the points where both circles meet.
        of_disk, of_circle = (d * d + R * R - c * c) / (2.0 * d), (d * d + c * c - R * R) / (2.0 * d)
        lens = R * R * _cap(np.clip(of_disk / R, -1.0, 1.0)) + c * c * _cap(np.clip(of_circle / c, -1.0, 1.0))
    apart, within = d >= R + c, d <= np.abs(R - c)
    return np.where(apart, 0.0, np.where(within, np.pi * smaller**2, lens))


class _Along(Bins):
    """Bins along one coordinate."""

    @abstractmethod
    def coordinate(self, position: Array) -> Array:
        """The coordinate of points, (n,)."""

    @abstractmethod
    def area_below(self, edge: Array, coordinate: Array, radius: Array) -> Array:
        """Area of each disk below its edge [length^2], (n,)."""

    def of(self, position: Array) -> Indices:
        found = _index(self.edges[0], self.coordinate(position))
        return np.where(_inside(found, self.edges[0]), found, -1)

    def shared(self, position: Array, radius: Array) -> Overlaps:
        edges, at = self.edges[0], self.coordinate(position)
        first, last = _index(edges, at - radius), _index(edges, at + radius)
        disk, bins, area = [], [], []
        for i in range(int(np.max(last - first, initial=-1)) + 1):
            used = np.flatnonzero((first + i <= last) & _inside(first + i, edges))
            own = first[used] + i
            low, high = (self.area_below(edges[own + k], at[used], radius[used]) for k in (0, 1))
            disk.append(used)
            bins.append(own)
            area.append(high - low)
        return _joined(disk, bins, area)


def _joined(disk: list[Indices], bins: list[Indices], area: list[Array]) -> Overlaps:
    none = np.zeros(0, dtype=np.intp)
    return Overlaps(np.concatenate([none, *disk]), np.concatenate([none, *bins]), np.concatenate([[], *area]))


class Strips(_Along):
    """Strips across x or y. In a sheared box a disk that crosses the upper or lower side counts at its own x."""

    @property
    def axis(self) -> int:
        """0 for x, 1 for y."""
        return "xy".index(self.axes[0])

    @property
    def continued(self) -> tuple[int, ...]:
        return (self.axis,)

    def coordinate(self, position: Array) -> Array:
        return position[:, self.axis]

    def area_below(self, edge: Array, coordinate: Array, radius: Array) -> Array:
        return radius**2 * _cap(np.clip((coordinate - edge) / radius, -1.0, 1.0))

    def areas(self, free_area: FreeArea) -> Array:
        if not free_area.walls:  # in an open box infinite
            return np.asarray(np.diff(self.edges[0]) * self.box.lengths[1 - self.axis])
        return free_area.strips(self.axis, self.edges[0])

    def cuts(self, start: Array, vector: Array) -> Iterator[Array]:
        return _line_cuts(self.edges[0], start[:, self.axis], vector[:, self.axis])


def _line_cuts(edges: Array, start: Array, step: Array) -> Iterator[Array]:
    with np.errstate(divide="ignore", invalid="ignore"):
        for edge in _crossed(edges, np.minimum(start, start + step), np.maximum(start, start + step)):
            yield (edge - start) / step


class Grid(Bins):
    """Cells along x and y."""

    def of(self, position: Array) -> Indices:
        x, y = (_index(edges, at) for edges, at in zip(self.edges, position.T, strict=True))
        inside = _inside(x, self.edges[0]) & _inside(y, self.edges[1])
        return np.where(inside, x * self.shape[1] + y, -1)

    def areas(self, free_area: FreeArea) -> Array:
        return free_area.cells(*self.edges).ravel()

    def shared(self, position: Array, radius: Array) -> Overlaps:
        low, high = (
            np.stack([_index(edges, at) for edges, at in zip(self.edges, end.T, strict=True)])
            for end in (position - radius[:, None], position + radius[:, None])
        )
        disk, bins, area = [], [], []
        for offset in np.ndindex(*(np.max(high - low, axis=1, initial=-1) + 1)):
            own = low + np.array(offset)[:, None]
            inside = _inside(own[0], self.edges[0]) & _inside(own[1], self.edges[1])
            used = np.flatnonzero(np.all(own <= high, axis=0) & inside)
            cell, R = own[:, used], radius[used]
            (x, x_1), (y, y_1) = (
                [(edges[cell[k] + end] - position[used, k]) / R for end in (0, 1)]
                for k, edges in enumerate(self.edges)
            )
            part = area_beyond(x, y) - area_beyond(x_1, y) - area_beyond(x, y_1) + area_beyond(x_1, y_1)
            disk.append(used)
            bins.append(cell[0] * self.shape[1] + cell[1])
            area.append(R * R * part)
        return _joined(disk, bins, area)

    def cuts(self, start: Array, vector: Array) -> Iterator[Array]:
        for k, edges in enumerate(self.edges):
            yield from _line_cuts(edges, start[:, k], vector[:, k])


@dataclass(frozen=True, eq=False, repr=False)
class Rings(_Along):
    """Rings around a centre [length]; components of vectors are radial and tangential (counter-clockwise)."""

    center: tuple[float, float] = (0.0, 0.0)

    @property
    def directions(self) -> tuple[str, str]:
        return ("r", "t")

    def components(self, position: Array, vector: Array) -> Array:
        away = position - self.center
        r = np.hypot(*away.T)
        with np.errstate(invalid="ignore"):
            outward = np.where(r[:, None] > 0.0, away / r[:, None], (1.0, 0.0))
        along = np.sum(outward * vector, axis=1)
        across = outward[:, 0] * vector[:, 1] - outward[:, 1] * vector[:, 0]
        return np.stack((along, across), axis=1)

    def coordinate(self, position: Array) -> Array:
        return np.asarray(np.hypot(*(position - self.center).T))

    def area_below(self, edge: Array, coordinate: Array, radius: Array) -> Array:
        return area_within(coordinate, radius, edge)

    def areas(self, free_area: FreeArea) -> Array:
        if self.box.is_open:
            return np.asarray(np.pi * np.diff(self.edges[0] ** 2))
        return free_area.rings(self.center, self.edges[0])

    def cuts(self, start: Array, vector: Array) -> Iterator[Array]:
        away = start - self.center
        square = np.sum(vector**2, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            nearest = np.nan_to_num(np.clip(-np.sum(away * vector, axis=1) / square, 0.0, 1.0))
            low = np.hypot(*(away + nearest[:, None] * vector).T)
            high = np.maximum(np.hypot(*away.T), np.hypot(*(away + vector).T))
            middle = -np.sum(away * vector, axis=1) / square
            for edge in _crossed(self.edges[0], low, high):
                half = np.sqrt(middle**2 - (np.sum(away**2, axis=1) - edge**2) / square)
                yield middle - half
                yield middle + half
