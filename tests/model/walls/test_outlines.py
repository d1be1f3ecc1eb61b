"""Outlines of walls: paths of SVG drawings against points of their curves, files, areas of rooms with polygons."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.walls import outlines
from ifrdem.model.walls.free_area import FreeArea
from ifrdem.model.walls.motion import Turn
from ifrdem.model.walls.wall import Wall, from_json, to_json


def distance_to(points: list[tuple[float, float]], curve: np.ndarray) -> float:
    """The largest distance of points of a curve from the straight pieces between some points."""
    return float(Wall.polyline(points).normal(curve)[1].max())


def test_straight_commands_and_their_relative_forms() -> None:
    expected = [(1.0, 2.0), (3.0, 2.0), (3.0, 5.0), (2.0, 4.5), (0.5, 4.0)]
    assert outlines.of_path("M1 2 H3 V5 L2,4.5 .5 4") == (expected, False)
    assert outlines.of_path("m1,2h2v3l-1-.5-1.5-.5z") == (expected, True)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_curves_are_within_the_tolerance(tolerance: float) -> None:
    """Points of the curves by their definitions: Bernstein polynomials, and x = r cos u, y = r sin u."""
    u = np.linspace(0.0, 1.0, 5000)[:, None]
    p = [np.array(each) for each in ((0.0, 0.0), (1.0, 3.0), (4.0, -2.0), (3.0, 1.0))]
    cubic = (1 - u) ** 3 * p[0] + 3 * u * (1 - u) ** 2 * p[1] + 3 * u**2 * (1 - u) * p[2] + u**3 * p[3]
    found, _ = outlines.of_path("M 0 0 C 1 3 4 -2 3 1", tolerance)
    assert distance_to(found, cubic) <= tolerance
    quadratic = (1 - u) ** 2 * p[0] + 2 * u * (1 - u) * p[1] + u**2 * p[3]
    found, _ = outlines.of_path("m 0 0 q 1 3 3 1", tolerance)
    assert distance_to(found, quadratic) <= tolerance
    # Three quarters of a circle about (0, 0) from (2, 0): large, against the turn of the clock with y upwards (sweep
    # 1).
    angle = 1.5 * np.pi * u[:, 0]
    found, _ = outlines.of_path("M 2 0 A 2 2 0 1 1 0 -2", tolerance)
    assert distance_to(found, 2.0 * np.column_stack((np.cos(angle), np.sin(angle)))) <= tolerance
    assert (
        len(found) > 1.5 * np.pi / math.acos(1.0 - tolerance / 2.0) / 2.0 - 1
    )  # no fewer than the bound needs
    # Half an ellipse of half axes 2 and 1, tilted by 30 degrees, flags without blanks.
    tilt, half = np.pi / 6.0, np.pi * u[:, 0]
    x, y = 2.0 * np.cos(half), np.sin(half)
    ellipse = np.column_stack((np.cos(tilt) * x - np.sin(tilt) * y, np.sin(tilt) * x + np.cos(tilt) * y))
    (a, b), (c, d) = ellipse[0], ellipse[-1]
    found, _ = outlines.of_path(f"M {a} {b} A 2 1 30 01{c} {d}", tolerance)
    assert distance_to(found, ellipse) <= tolerance


def test_a_drawing_is_upright_on_the_lower_edge_of_its_view_box(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="1 2 10 20"><path d="M 1 22 h 4 v -3 z"/></svg>'
    )
    assert outlines.of_svg(path) == ([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)], True)
    for text, says in (
        ("<svg/>", "0 paths"), ("no", "no SVG drawing"), ('<svg><path d="M 1 1"/></svg>', "viewBox"),
        ('<svg viewBox="0 0 1 1"><g transform="scale(2)"><path d="M 1 1"/></g></svg>', "transform of <g>"),
    ):  # fmt: skip
        path.write_text(text)
        with pytest.raises(InputError, match=says):
            outlines.of_svg(path)


def test_points_come_from_text_files(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x, y\n1, 2  # a corner\n\n3;4\n5 6\n")
    assert outlines.of_csv(path) == [(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)]


@pytest.mark.full
def test_crossing_sides_are_found_also_where_a_corner_touches_a_side() -> None:
    square = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]
    Wall.polygon([*square, square[0]])  # the first point again closes it
    for points in ([(0, 0), (4, 4), (4, 0), (0, 4)], [(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)]):
        with pytest.raises(InputError, match="cross"):
            Wall.polygon(points)
    angle = 2.0 * np.pi * np.arange(3000) / 3000
    Wall.polygon(np.column_stack((np.cos(angle), np.sin(angle))))


def test_smooth_curves_continue_with_the_mirrored_previous_handle() -> None:
    """SVG 2, 9.3.6 and 9.3.7: S and T after C and Q, and after other commands from where they stand."""
    for short, long in (
        ("M 0 0 C 1 3 4 -2 3 1 S 5 5 6 0", "M 0 0 C 1 3 4 -2 3 1 C 2 4 5 5 6 0"),
        ("M 0 0 c 1 3 4 -2 3 1 s 2 4 3 -1", "M 0 0 C 1 3 4 -2 3 1 C 2 4 5 5 6 0"),
        ("M 0 0 Q 1 3 3 1 T 6 0", "M 0 0 Q 1 3 3 1 Q 5 -1 6 0"),
        ("M 0 0 Q 1 3 3 1 t 3 -1 T 9 1", "M 0 0 Q 1 3 3 1 Q 5 -1 6 0 Q 7 1 9 1"),
        ("M 0 0 L 3 1 S 5 5 6 0", "M 0 0 L 3 1 C 3 1 5 5 6 0"),
        ("M 0 0 C 1 3 4 -2 3 1 T 6 0", "M 0 0 C 1 3 4 -2 3 1 Q 3 1 6 0"),
    ):
        found, expected = (outlines.of_path(each, 1e-3)[0] for each in (short, long))
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_walls_come_from_files_with_the_length_of_their_unit(tmp_path: Path) -> None:
    drawing, text = tmp_path / "a.svg", tmp_path / "a.csv"
    drawing.write_text('<svg viewBox="0 0 10 20"><path d="M 0 20 h 4 v -3 z"/></svg>')
    text.write_text("1 1\n3 1\n3 2\n")
    assert Wall.polygon(drawing, "inside", scale=0.5).points == ((0.0, 0.0), (2.0, 0.0), (2.0, 1.5))
    assert Wall.polyline(str(text), scale=2.0).points == ((2.0, 2.0), (6.0, 2.0), (6.0, 4.0))
    drawing.write_text('<svg viewBox="0 0 10 20"><path d="M 0 20 h 4 v -3 q 0 -1 4 -4"/></svg>')
    near = outlines.given(
        "wall", drawing, 0.01, 1e-5, closed=False
    )  # the tolerance is a length, not a part of the file
    u = np.linspace(0.0, 1.0, 1000)[:, None]
    curve = 0.01 * ((1 - u) ** 2 * (4.0, 3.0) + 2 * u * (1 - u) * (4.0, 4.0) + u**2 * (8.0, 7.0))
    assert 1e-6 < distance_to(list(near), curve) <= 1e-5
    for points, scale, says in (
        (text, 1.0, "a.csv: it begins at .1, 1. and ends at .3, 2.: a polygon must come back"),
        (tmp_path / "none.csv", 1.0, "none.csv: there is no such file"),
        (text, 0.0, "scale = 0.0: must be a positive number"),
        ([(0, 0), (1, 0), (0, 1)], 2.0, "scale = 2.0: only a file has it"),
    ):
        with pytest.raises(InputError, match=says):
            Wall.polygon(points, scale=scale)


def test_polygons_without_area_are_refused_with_their_place() -> None:
    for points, says in (
        ([(0, 0), (1, 1), (3, 3)], r"points\[2\] = .3, 3.: the outline doubles back"),
        ([(0, 0), (4, 0), (4, 4), (4, 1)], r"points\[2\] = .4, 4.: the outline doubles back"),
        ([(0, 0), (1, 1e-16), (2, 0)], "they enclose no area"),
        (
            [(0, 0), (1e300, 0), (0, 1e300)],
            r"points\[1\]\[0\] = 1e\+300: must be a finite number, at most 1e\+50",
        ),
    ):
        with pytest.raises(InputError, match=says):
            Wall.polygon(points)
    Wall.polygon([(0, 0), (1, 1e-6), (2, 0)])


def test_rooms_with_polygons_have_their_area() -> None:
    """A hexagon of side 1 has the area 3 sqrt(3) / 2; a post in it, and a triangle that is an obstacle, take theirs."""
    angle = np.pi / 3.0 * np.arange(6)
    hexagon = Wall.polygon(np.column_stack((2 + np.cos(angle), 2 + np.sin(angle))), "inside")
    area = 1.5 * math.sqrt(3.0)
    box = Box((4.0, 4.0), (False, False))
    assert FreeArea(box, (hexagon,)).area() == pytest.approx(area, rel=1e-12)
    inside = (
        hexagon,
        Wall.post((2.0, 2.0), 0.3),
        Wall.polygon([(1.5, 2.2), (1.7, 2.2), (1.5, 2.6)], "outside"),
    )
    assert FreeArea(box, inside).area() == pytest.approx(area - math.pi * 0.09 - 0.04, rel=1e-4)
    np.testing.assert_allclose(
        FreeArea(box, (hexagon,)).bounds(), [[1.0, 2 - math.sqrt(0.75)], [3.0, 2 + math.sqrt(0.75)]]
    )
    turned = Wall.polygon(
        hexagon.points, "inside", turn=Turn("sine", (0.0, 0.0), amplitude=0.1, frequency=1.0, phase=0.5)
    )
    assert FreeArea(box, (turned,)).area() == pytest.approx(area, rel=1e-12)


def test_sides_of_polygons_that_hold_disks_have_signs() -> None:
    square = [(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0)]
    places = np.array([[2.0, 1.5], [2.0, 0.5], [4.0, 4.0]])
    far = [0.5, 0.5, math.sqrt(2.0)]
    np.testing.assert_allclose(Wall.polygon(square).gap(places, np.zeros(3)), far)
    np.testing.assert_allclose(
        Wall.polygon(square, "inside").gap(places, np.zeros(3)), np.multiply(far, [1, -1, -1])
    )
    np.testing.assert_allclose(
        Wall.polygon(square, "outside").gap(places, np.zeros(3)), np.multiply(far, [-1, 1, 1])
    )
    np.testing.assert_allclose(Wall.polygon(square, "inside").normal(places[:2])[0], [[0.0, 1.0], [0.0, 1.0]])


def test_distances_from_an_arc_are_those_of_many_points_on_it() -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(-3.0, 3.0, (500, 2))
    arc = Wall.arc((0.3, -0.2), 1.5, (2.0, 5.5), turn=Turn("steady", (1.0, 0.0), rate=0.7))
    points = arc.outline(2.0, step=1e-4)
    expected = [float(np.hypot(*(points - place).T).min()) for place in places]
    away, distance = arc.normal(places, 2.0)
    np.testing.assert_allclose(distance, expected, atol=2e-6)  # (1.5e-4 / 2)^2 / (2 * 0.003)
    np.testing.assert_allclose(
        arc.gap(places - distance[:, None] * away, np.zeros(500), 2.0), 0.0, atol=1e-12
    )


def test_walls_are_read_back_from_the_record_of_a_file() -> None:
    polygon = Wall.polygon([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)], "inside", opens_at=2.0, group="a")
    assert from_json(to_json([polygon])) == (polygon,)


@pytest.mark.parametrize(
    ("data", "tolerance", "reason"),
    [
        ("M 0.1 0.1 A 1e13 1e13 0 0 1 0.9 0.1", None, "radii 1e.13"),
        ("M 0.1 0.1 A 1e-200 1 0 0 1 0.9 0.1", None, "radii 1e-200"),
        ("M 0.1 0.1 A 1e200 1e200 0 0 1 0.9 0.1", None, "radii 1e.200"),
        ("M 0 0 C 1e200 0 1 1 2 0", None, "pieces; at most 100000"),
        ("M 0 0 C 1 0 1 1 2 0", 1e-30, "pieces; at most 100000"),
        ("M 0 0 A 1 1 0 0 1 2 0", 1e-16, "pieces; at most 100000"),
        ("M 0 0 A 1 1 0 0 1 2 0", -1.0, "must be a positive number from 1e-50 to"),
        ("M 0 0 A 1 1 0 0 1 2 0", math.nan, "must be a positive number from 1e-50 to"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_curves_beyond_all_bounds_are_refused(data: str, tolerance: float | None, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        outlines.of_path(data, tolerance)


def test_a_nearly_straight_arc_has_its_sagitta() -> None:
    """Chord 0.8 of a circle of radius 1e4: the middle is 0.8^2 / (8e4) = 8e-6 off; pieces are 1e-9 off at most."""
    points, _ = outlines.of_path("M 0.1 0.1 A 1e4 1e4 0 0 1 0.9 0.1", 1e-9)
    assert abs(min(y for _, y in points) - (0.1 - 8e-6)) < 1e-8
