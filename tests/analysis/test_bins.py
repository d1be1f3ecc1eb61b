"""Bins of space: areas of disks, pieces of lines, free areas, against closed forms and samples of points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem import Box, Wall
from ifrdem.analysis.bins import Bins, Grid, Overlaps, Rings, Strips, area_within
from ifrdem.model.walls.free_area import FreeArea

BOX = Box((10.0, 8.0))
SHEARED = Box((10.0, 8.0), shear_rate=0.3)
CLOSED = Box((10.0, 8.0), (False, False))
TIME = 3.7  # the image above has moved by 8.88
PLACES = pytest.mark.parametrize(
    ("kind", "box"), [*((kind, BOX) for kind in ("x", "y", "xy", "r")), ("y", SHEARED), ("xy", SHEARED)]
)


def bins_of(kind: str, box: Box = BOX) -> Bins:
    if kind == "r":
        return Rings(box, ("r",), (np.linspace(0.0, 3.5, 8),), (5.0, 4.0))
    if kind == "xy":
        return Grid(box, ("x", "y"), (np.linspace(0.0, 10.0, 8), np.linspace(0.0, 8.0, 12)))
    edges = np.linspace(0.0, box.lengths["xy".index(kind)], 10)
    return Strips(box, (kind,), (edges,))


def of_each(found: Overlaps, bins: Bins, disk: int) -> np.ndarray:
    mine = found.disk == disk
    return np.bincount(found.bin[mine], found.area[mine], minlength=bins.count)


@pytest.mark.full(keep=2)
@PLACES
def test_areas_of_disks_are_those_of_points_in_them(kind: str, box: Box) -> None:
    """Points on a fine lattice in each disk, wrapped by the box itself: to one of its 400 lines, 1e-2 R^2."""
    bins, rng = bins_of(kind, box), np.random.default_rng(1)
    position = rng.random((40, 2)) * box.lengths
    position[:4] = [[0.1, 0.1], [9.9, 7.9], [0.05, 7.95], [5.0, 4.0]]
    radius = rng.uniform(0.2, 1.6, 40)
    found = bins.overlaps(position, radius, TIME)
    grid = (np.arange(400) + 0.5) / 200.0 - 1.0
    unit = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    unit = unit[np.sum(unit**2, axis=1) < 1.0]
    for i in range(40):
        points = box.wrap(position[i] + radius[i] * unit, TIME)
        place = bins.of(points)
        expected = np.bincount(place[place >= 0], minlength=bins.count) * radius[i] ** 2 * (1.0 / 200.0) ** 2
        np.testing.assert_allclose(of_each(found, bins, i), expected, atol=1.2e-2 * radius[i] ** 2)
    if kind != "r":
        assert found.area.sum() == pytest.approx(np.pi * np.sum(radius**2), rel=1e-12)


def test_a_disk_on_a_corner_of_cells_is_shared_in_quarters() -> None:
    bins = Grid(CLOSED, ("x", "y"), (np.linspace(0.0, 10.0, 6), np.linspace(0.0, 8.0, 5)))
    found = bins.overlaps(np.array([[4.0, 4.0]]), np.array([1.5]), 0.0)
    np.testing.assert_allclose(found.area, 0.25 * np.pi * 2.25, rtol=1e-14)
    assert sorted(found.bin) == [5, 6, 9, 10]


@pytest.mark.parametrize("kind", ["x", "xy"])
def test_bins_far_narrower_than_a_disk_and_a_line_take_their_parts_of_them(kind: str) -> None:
    """Of a disk and a line through its centre: a chord of 2 R times the width, and the width over the length."""
    edges = 5.0 + np.linspace(0.0, 1e-9, 4)
    across = (4.0 + np.linspace(0.0, 1e-9, 3),) if kind == "xy" else ()
    bins: Bins = Grid(BOX, ("x", "y"), (edges, *across)) if across else Strips(BOX, ("x",), (edges,))
    area = np.diff(edges)[0] * (np.diff(across[0])[0] if across else 2.0)
    found = bins.overlaps(np.array([[5.0, 4.0]]), np.array([1.0]), 0.0)
    np.testing.assert_allclose(of_each(found, bins, 0), area, rtol=1e-5, atol=1e-15)
    pieces = bins.pieces(np.array([[4.5, 4.0]]), np.array([[1.0, 0.0]]))
    assert pieces.bin.tolist() == ([0, 2, 4] if across else [0, 1, 2])
    np.testing.assert_allclose(pieces.share, np.diff(edges), rtol=1e-5)


def test_two_circles_have_a_lens_in_common() -> None:
    """Equal circles at the distance d: 2 R^2 acos(d / 2R) - (d / 2) sqrt(4 R^2 - d^2)."""
    d, R = 0.7, 0.6
    expected = 2.0 * R * R * math.acos(d / (2.0 * R)) - 0.5 * d * math.sqrt(4.0 * R * R - d * d)
    assert float(area_within(np.array(d), np.array(R), np.array(R))) == pytest.approx(expected, rel=1e-13)


@PLACES
def test_shares_of_lines_are_those_of_points_on_them(kind: str, box: Box) -> None:
    bins, rng = bins_of(kind, box), np.random.default_rng(2)
    start = rng.random((60, 2)) * box.lengths
    vector = rng.normal(size=(60, 2))
    vector[0], vector[1] = (1.5, 0.0), (0.0, -1.5)
    found = bins.pieces(start, vector, TIME)
    at = (np.arange(20_000) + 0.5) / 20_000
    for i in range(60):
        place = bins.of(box.wrap(start[i] + at[:, None] * vector[i], TIME))
        expected = np.bincount(place[place >= 0], minlength=bins.count) / len(at)
        mine = found.line == i
        shares = np.bincount(found.bin[mine], found.share[mine], minlength=bins.count)
        np.testing.assert_allclose(shares, expected, atol=3e-4)
    if kind != "r":
        np.testing.assert_allclose(np.bincount(found.line, found.share), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(bins.of(found.middle), found.bin)


def test_components_in_rings_are_radial_and_counter_clockwise() -> None:
    bins = bins_of("r")
    found = bins.components(np.array([[5.0, 6.0], [7.0, 4.0]]), np.array([[0.5, 2.0], [0.5, 2.0]]))
    np.testing.assert_allclose(found, [[2.0, -0.5], [0.5, 2.0]])


@pytest.mark.full
@pytest.mark.parametrize("kind", ["xy", "y", "r"])
def test_free_areas_of_bins_are_those_of_points(kind: str) -> None:
    """Behind an oblique line, in a container and around a post, on a lattice of points: to half of one of its lines."""
    walls = (
        Wall.line((0.0, 1.0), (-0.6, 0.8)),
        Wall.container((5.0, 4.0), 3.8),
        Wall.post((5.0, 4.0), 1.1),
    )
    free, bins = FreeArea(CLOSED, walls), bins_of(kind, CLOSED)
    side = 0.005
    points = np.stack(
        np.meshgrid(np.arange(0.5 * side, 10.0, side), np.arange(0.5 * side, 8.0, side)), axis=-1
    )
    points = points.reshape(-1, 2)
    place = bins.of(points)
    inside = (free.gap(points, np.zeros(len(points))) > 0.0) & (place >= 0)
    expected = np.bincount(place[inside], minlength=bins.count) * side**2
    np.testing.assert_allclose(bins.areas(free), expected, atol=2.5e-2)
