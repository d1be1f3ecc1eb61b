"""The free area between walls: exact areas, and starts that keep off walls."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.initial import packing, placement
from ifrdem.initial import placement as lattice
from ifrdem.model.box import Box
from ifrdem.model.walls.checks import check
from ifrdem.model.walls.free_area import FreeArea
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall

WALLED, MIXED = (False, False), (True, False)


def counted(free_area: FreeArea, inset: float = 0.0, points: int = 400_000) -> float:
    """The area by counting random points; its standard error is below area / 600."""
    at = np.random.default_rng(7).random((points, 2)) * free_area.box.lengths
    return float(np.mean(free_area.gap(at, np.full(points, inset)) >= 0.0)) * free_area.box.area


def test_free_areas_agree_with_plane_geometry() -> None:
    box = Box((4.0, 3.0), WALLED)
    assert FreeArea(box).area() == pytest.approx(12.0, rel=1e-14)
    assert FreeArea(box).area(0.5) == pytest.approx(3.0 * 2.0, rel=1e-14)
    assert FreeArea(Box((4.0, 3.0), MIXED)).area(0.5) == pytest.approx(4.0 * 2.0, rel=1e-14)
    # A triangle under a line from (4, 0) to (0, 3).
    line = Wall.line((4.0, 0.0), (-3.0, -4.0))
    assert FreeArea(box, (line,)).area() == pytest.approx(6.0, rel=1e-13)
    circle = Wall.container((2.0, 1.5), 1.2)
    assert FreeArea(box, (circle,)).area(0.2) == pytest.approx(math.pi, rel=1e-13)
    assert FreeArea(box, (Wall.post((2.0, 1.5), 0.5),)).area() == pytest.approx(
        12.0 - 0.25 * math.pi, rel=1e-13
    )
    # Half of a container, above a floor through its middle.
    floor = Wall.line((0.0, 1.5), (0.0, 1.0))
    assert FreeArea(box, (circle, floor)).area() == pytest.approx(0.5 * math.pi * 1.44, rel=1e-13)
    # A lens of two circles of radius 1 whose centres are 1 apart: 2 pi / 3 - sqrt(3) / 2.
    lens = (Wall.container((1.5, 1.5), 1.0), Wall.container((2.5, 1.5), 1.0))
    assert FreeArea(box, lens).area() == pytest.approx(2.0 * math.pi / 3.0 - math.sqrt(3.0) / 2.0, rel=1e-13)
    # Walls that stand at one place, a container that touches the sides, and one that lies all beyond a line.
    twice = (Wall.line((0.0, 0.0), (0.0, 1.0)), Wall.line((1.0, 0.0), (0.0, 2.0)))
    assert FreeArea(box, twice).area() == pytest.approx(12.0, rel=1e-13)
    assert FreeArea(box, (Wall.container((1.5, 1.5), 1.5),)).area() == pytest.approx(2.25 * math.pi, rel=1e-9)
    assert FreeArea(box, (circle, Wall.line((0.0, 2.9), (0.0, 1.0)))).area() == 0.0
    # A floor stands where it is at t = 0: 0.3 sin(pi / 2) up.
    moved = Wall.line(
        (0.0, 0.0), (0.0, 1.0), motion=Motion("sine", amplitude=0.3, frequency=1.0, phase=math.pi / 2)
    )
    assert FreeArea(box, (moved,)).area() == pytest.approx(4.0 * 2.7, rel=1e-13)


CROWDED = FreeArea(
    Box((10.0, 8.0), WALLED),
    (
        Wall.container((5.0, 4.0), 4.5),
        Wall.post((3.0, 3.0), 1.0),
        Wall.post((4.2, 3.3), 0.8),  # overlaps the other post
        Wall.post((9.0, 4.5), 1.0),  # half outside of the container
        Wall.line((0.0, 1.0), (0.3, 1.0)),
        Wall.segment((6.0, 2.0), (7.0, 6.0)),
    ),
)


@pytest.mark.parametrize("inset", [0.0, 0.3])
def test_free_area_among_many_walls_agrees_with_random_points(inset: float) -> None:
    free_area = FreeArea(CROWDED.box, tuple(wall for wall in CROWDED.walls if wall.shape != "segment"))
    assert free_area.area(inset) == pytest.approx(
        counted(free_area, inset), rel=5e-3
    )  # three standard errors


def test_strips_add_up_to_the_room() -> None:
    edges = np.linspace(0.0, 8.0, 14)
    for axis, last in ((1, 8.0), (0, 10.0)):
        strips = CROWDED.strips(axis, edges * last / 8.0)
        assert np.all(strips >= 0.0)
        assert np.sum(strips) == pytest.approx(CROWDED.area(), rel=1e-12)


def test_lengths_of_walls_agree_with_plane_geometry() -> None:
    box = Box((4.0, 3.0), MIXED)
    assert FreeArea(box).wall_length() == pytest.approx(
        8.0, rel=1e-13
    )  # floor and ceiling; not the periodic sides
    posts = (Wall.post((1.0, 1.5), 0.2), Wall.segment((2.0, 1.0), (3.0, 1.0)))
    expected = 8.0 + 2.0 * math.pi * 0.3 + 2.0 + 2.0 * math.pi * 0.1
    assert FreeArea(box, posts).wall_length(0.1) == pytest.approx(expected, rel=1e-13)


def test_bounds_are_those_of_what_disks_can_reach() -> None:
    low, high = FreeArea(Box((4.0, 3.0), WALLED), (Wall.container((2.0, 1.5), 1.2),)).bounds()
    np.testing.assert_allclose([*low, *high], [0.8, 0.3, 3.2, 2.7], rtol=1e-12)
    # In a periodic direction the free area continues, so centres may be at its sides too.
    low, high = FreeArea(Box((4.0, 3.0), MIXED), (Wall.line((0.0, 0.5), (0.0, 1.0)),)).spans(np.array([0.1]))
    np.testing.assert_allclose([*low[0], *high[0]], [0.0, 0.6, 4.0, 2.9], rtol=1e-12)


ROOMS = {
    "sides": FreeArea(Box((12.0, 9.0), WALLED)),
    "channel": FreeArea(Box((12.0, 9.0), MIXED), (Wall.post((6.0, 4.0), 1.0),)),
    "drum": FreeArea(
        Box((10.0, 10.0), WALLED), (Wall.container((5.0, 5.0), 4.9), Wall.post((5.0, 4.0), 0.8))
    ),
    "ramp": FreeArea(
        Box((12.0, 9.0), WALLED),
        (
            Wall.line((0.0, 0.0), (-0.4, 1.0), motion=Motion("steady", speed=0.1)),
            Wall.segment((3.0, 7.0), (8.0, 6.0)),
        ),
    ),
}


def place(way: str, free_area: FreeArea, radius: np.ndarray) -> np.ndarray:
    if way == "random":
        return placement.random_positions(free_area.box, radius, seed=3, walls=free_area.walls)
    if way == "growth":
        return packing.grown_positions(free_area.box, radius, seed=3, walls=free_area.walls)
    return placement.hexagonal_positions(free_area.box, radius, seed=3, walls=free_area.walls)


@pytest.mark.full(keep=3)
@pytest.mark.parametrize(("way", "phi"), [("random", 0.35), ("growth", 0.7), ("hexagonal", 0.5)])
@pytest.mark.parametrize("name", ROOMS)
def test_starts_keep_disks_off_walls(way: str, phi: float, name: str) -> None:
    free_area = ROOMS[name]
    radius = np.full(int(phi * free_area.area() / (math.pi * 0.3**2)), 0.3)
    position = place(way, free_area, radius)
    assert free_area.packing_fraction(radius) == pytest.approx(phi, rel=0.02)
    assert np.all(free_area.gap(position, radius) >= 0.0)
    check(free_area.all_walls, free_area.box, position, radius)  # the engine's own
    placement.check_no_overlap(free_area.box, radius, position)
    if way == "random":  # disks come as near to walls as they may
        assert np.min(free_area.gap(position, radius)) < 0.1


def test_small_disks_get_nearer_to_walls_than_large_ones() -> None:
    free_area = ROOMS["drum"]
    radius = np.random.default_rng(1).uniform(0.1, 0.4, 120)
    for way in ("random", "growth"):
        gap = free_area.gap(place(way, free_area, radius), radius)
        assert np.all(gap >= 0.0)
        assert np.any(gap[radius < 0.15] < 0.1)


def test_a_gas_between_sides_begins_as_dense_at_them_as_inside() -> None:
    """Sequential addition at a low density is uniform over what centres can reach."""
    box = Box((10.0, 10.0), WALLED)
    x = np.concatenate(
        [placement.random_positions(box, np.full(40, 0.5), seed=seed)[:, 0] for seed in range(50)]
    )
    assert x.min() >= 0.5
    outer = np.count_nonzero(np.abs(x - 5.0) > 3.0) / len(x)
    # A third of 9 x 9 would be 1/3; at phi = 0.3 disks gain room at walls: 2000 of them, standard error 0.011.
    assert 0.32 < outer < 0.42


def test_too_many_disks_are_refused_with_what_was_reached() -> None:
    free_area = ROOMS["drum"]
    radius = np.full(300, 0.3)
    assert free_area.packing_fraction(radius) > 1.0
    with pytest.raises(InputError, match=r"random positions of equal disks end at 0\.547"):
        place("random", free_area, radius)
    with pytest.raises(InputError, match="the disks cover more than the free area between walls has"):
        place("growth", free_area, radius)
    with pytest.raises(InputError, match=r"between the walls: at most (\d+) do") as found:
        place("hexagonal", free_area, radius)
    most = int(str(found.value).split("at most ")[1].split(" ")[0])
    assert len(lattice.sites(free_area, most, 0.3)) == most
    with pytest.raises(InputError, match="no room for disk 0"):
        placement.random_positions(
            free_area.box, np.array([0.3]), seed=1, walls=(Wall.container((5.0, 5.0), 0.2),)
        )


def test_growth_that_fails_between_walls_reports_the_density_reached() -> None:
    free_area = FreeArea(Box((6.0, 6.0), WALLED))
    radius = np.full(41, 0.5)  # of 36 on a square lattice and some 39 at best
    with pytest.raises(InputError, match=r"packing fraction = 0\.894.: growth ended at 0\.[67]\d"):
        place("growth", free_area, radius)


def test_rounded_positions_are_moved_off_walls() -> None:
    free_area = ROOMS["drum"]
    radius = np.full(2, 0.3)
    position = np.array([[5.0, 0.4 - 1e-7], [9.6 + 1e-7, 5.0]])  # both 1e-7 inside of the container's wall
    assert np.all(free_area.gap(position, radius) < 0.0)
    moved = packing.separate(free_area.box, radius, position, walls=free_area.walls)
    assert np.all(free_area.gap(moved, radius) >= 0.0)
    np.testing.assert_allclose(moved, position, atol=3e-7)


def test_messages_name_the_area_of_a_packing_fraction() -> None:
    box, gate = Box((4.0, 3.0), MIXED), Wall.segment((0.0, 1.0), (4.0, 1.0), opens_at=2.0)
    assert FreeArea(Box((4.0, 3.0))).name == ""
    assert FreeArea(box).name == " of the free area"
    assert FreeArea(box, (gate,)).name == " of the free area with gates closed"
    assert FreeArea(box, gates_open=True).name == " of the free area with gates open"
