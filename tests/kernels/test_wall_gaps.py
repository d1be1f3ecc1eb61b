"""Every shape of a wall in kernels: its gap, slope and bound of the curvature, and the first root; images by number.

Distances come from `support/serial_walls.py`, which shares no formula with the package, roots from Brent's method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from support import serial_walls

from ifrdem.kernels import columns
from ifrdem.kernels.columns import named
from ifrdem.kernels.layout import FIRST_WALL, NO_PARTNER, Uses
from ifrdem.kernels.walls.kinds import PIECES
from ifrdem.model.walls.motion import Motion, Turn
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation import backend

Array = NDArray[np.float64]
RADIUS, WINDOW, GRAVITY = 0.3, 1.0, (0.2, -0.7)
TIMES = np.linspace(0.0, WINDOW, 41)
STEP = 1e-5  # of finite differences: errors of f''' STEP^2 / 6 and 1e-14 / STEP are below 1e-8
WALLS: dict[str, Callable[..., Wall]] = {
    "line": lambda **o: Wall.line((5.0, 5.0), (0.6, 0.8), **o),
    "segment": lambda **o: Wall.segment((3.0, 4.2), (7.0, 5.6), **o),
    "container": lambda **o: Wall.container((5.0, 5.0), 2.5, **o),
    "post": lambda **o: Wall.post((5.0, 5.0), 1.2, **o),
    "arc inside": lambda **o: Wall.arc((5.0, 5.0), 2.5, (0.3, 2.8), **o),
    "arc outside": lambda **o: Wall.arc((5.0, 5.0), 1.0, (0.3, 4.8), **o),
}
ROUND_ABOUT = ("container", "arc inside")  # whose gap is a difference of squares
SHAKEN = Motion("sine", direction=(1.0, 2.0), amplitude=0.2, frequency=0.6, phase=0.4)
MOTIONS = {
    "still": {},
    "steady": {"motion": Motion("steady", direction=(1.0, -1.0), speed=0.4)},
    "sine": {"motion": SHAKEN},
    "turn": {
        "motion": SHAKEN,
        "turn": Turn("sine", center=(4.6, 5.3), amplitude=0.4, frequency=0.5, phase=1.0),
    },
}


def distance(name: str, wall: Wall, x: Array, t: Array) -> tuple[Array, Array]:
    """Distances of points x (n, 2) at times t (n,) from a piece of a wall, and where there is a face to be touched.

    From an arc on one side: along the radius, negative behind.
    """
    if not name.startswith("arc"):
        return serial_walls.nearest(wall, x, t)[1], np.ones(len(t), dtype=bool)
    s, angle = serial_walls.displaced(wall, t)[0], serial_walls.turned(wall, t)[0]
    x = x - s[:, None] * np.array(wall.motion.direction)
    z = (x[:, 0] + 1j * x[:, 1] - complex(*wall.turn.center)) * np.exp(-1j * angle)
    z = z + complex(*wall.turn.center) - complex(*wall.origin)
    middle, half = 0.5 * sum(wall.angles), 0.5 * (wall.angles[1] - wall.angles[0])
    outside = np.abs(np.angle(z * np.exp(-1j * middle))) > half
    sign = -1.0 if name == "arc inside" else 1.0
    return sign * (np.abs(z) - wall.radius), ~outside


def flight(disk: Array, t: Array) -> Array:
    """Positions of a disk at times t, shape (n, 2)."""
    return disk[:2] + t[:, None] * disk[2:4] + 0.5 * t[:, None] ** 2 * np.array(GRAVITY)


def flying(name: str, wall: Wall, n: int = 60) -> Array:
    """Disks (x, y, vx, vy, radius) on the side of a piece that it is touched from, apart from it at time 0."""
    rng = np.random.default_rng(3)
    place = 5.0 + rng.uniform(-3.5, 3.5, (40 * n, 2))
    d, faces = distance(name, wall, place, np.zeros(len(place)))
    place = place[(d - RADIUS > 0.05) & (d < 2.4) & faces][:n]
    assert len(place) == n
    return np.column_stack((place, 3.0 * rng.normal(size=(n, 2)), np.full(n, RADIUS)))


def of_kernel(name: str, wall: Wall, disks: Array, times: Array) -> tuple[Array, Array]:
    """Gaps of a wall by `support.kernels.gaps.gaps`, shape (disks, times, 6), and times of its first contacts."""
    backend.start("cpu")
    from support.kernels.gaps import gaps

    from ifrdem.kernels.compiler.language import ti

    rows = wall.rows()
    rows = rows[named(rows, "walls").kind == PIECES.index(name)][:1]
    walls = ti.Vector.ndarray(columns.WALL.width, ti.f64, 1)
    walls.from_numpy(rows)
    grid, scale, clock, counter = (columns.blank(each) for each in ("grid", "scale", "clock", "counter"))
    grid.walls, scale.window, scale.gx, scale.gy = 1, WINDOW, *GRAVITY
    out, root = np.zeros((len(disks), len(times), 6)), np.zeros(len(disks))
    uses = Uses(walls=True, arcs=True, turning_walls=True)
    gaps(
        disks, times, out, root, uses, grid.array.astype(np.int32), scale.array, clock.array,
        counter.array.astype(np.int32), walls,
    )  # fmt: skip
    return out, root


def first_contact(name: str, wall: Wall, disk: Array) -> float:
    """Time at which a disk first touches a piece, by Brent's method; inf if it does not in the window."""

    def gap(t: float) -> float:
        at = np.array([t])
        return float(distance(name, wall, flight(disk, at), at)[0][0]) - RADIUS

    times = np.linspace(0.0, WINDOW, 4001)
    gaps = distance(name, wall, flight(disk, times), times)[0] - RADIUS
    for i in np.flatnonzero((gaps[:-1] > 0.0) & (gaps[1:] <= 0.0)):
        root = brentq(gap, times[i], times[i + 1], xtol=1e-14)
        if distance(name, wall, flight(disk, np.array([root])), np.array([root]))[1][0]:
            return root
    return math.inf


@pytest.mark.full(keep=6)
@pytest.mark.parametrize(
    ("name", "motion"),
    [(name, motion) for name in PIECES for motion in MOTIONS if (name, motion) != ("line", "turn")],
)
def test_gap_slope_bound_and_root_of_every_shape(name: str, motion: str) -> None:
    """The gap is the distance less the radius, or, inside of a circle of centres rho, (rho - gap)^2 short of rho^2.

    Its slope is that of finite differences; the parabola with the bound of its curvature stays below it; and its first
    root is where Brent's method finds it.
    """
    wall = WALLS[name](**MOTIONS[motion])
    disks = flying(name, wall)
    times = np.sort(np.concatenate((TIMES, TIMES[1:-1] - STEP, TIMES[1:-1] + STEP)))
    out, root = of_kernel(name, wall, disks, times)
    f, slope, curve, tolerance, here, behind = np.moveaxis(out, 2, 0)
    touched = 0
    for i, disk in enumerate(disks):
        d, faces = distance(name, wall, flight(disk, times), times)
        gap, rho = d - RADIUS, wall.radius - RADIUS
        front = np.abs(gap) > 1e-9
        if name.startswith("arc"):  # of a point behind it the kernel follows the other side
            front &= gap > 0.0
        expected = gap * (2.0 * rho - gap) if name in ROUND_ABOUT else gap
        np.testing.assert_allclose(f[i][front], expected[front], atol=1e-11)
        assert np.all(tolerance[i] > 0.0)
        if name.startswith("arc"):
            np.testing.assert_array_equal(here[i][front], faces[front])
            np.testing.assert_array_equal(behind[i] == 1, gap < 0.0)
        for m in range(1, len(TIMES) - 1):
            three = slice(3 * m - 2, 3 * m + 1)
            if np.all(front[three]) and np.ptp(np.sign(gap[three])) == 0.0:
                numeric = (f[i][three][2] - f[i][three][0]) / (2.0 * STEP)
                assert slope[i][three][1] == pytest.approx(numeric, abs=2e-6)
        left = times - times[0]
        while_front = np.cumprod(front & (gap > 0.0)).astype(bool)
        below = f[i][0] + slope[i][0] * left + 0.5 * curve[i][0] * left**2
        assert np.all(below[while_front] <= f[i][while_front] + 1e-10)
        expected_root = first_contact(name, wall, disk)
        if math.isfinite(expected_root):
            touched += 1
            assert root[i] == pytest.approx(expected_root, abs=1e-9)
        else:
            assert root[i] > WINDOW
    assert touched > 5


def test_the_inside_of_an_arc_narrower_than_a_disk_is_never_touched() -> None:
    """Its ends, which are other pieces, are in the way."""
    wall = Wall.arc((5.0, 5.0), 0.8 * RADIUS, (0.3, 2.8))
    disks = np.array([[5.0, 4.0, 0.0, 3.0, RADIUS], [5.0, 5.0, 0.3, 1.0, RADIUS]])
    out, root = of_kernel("arc inside", wall, disks, TIMES)
    assert np.all(out[:, :, 0] > WINDOW)
    assert not out[:, :, 4].any()
    assert np.all(root > WINDOW)


def test_at_the_very_end_of_a_stroke_a_sawtooth_has_the_speed_of_the_next_one() -> None:
    """From -0.2 to 0.2 in 0.3, and back in 0.7; a disk at rest falls towards the line by (0.6, 0.8) . g t."""
    wall = Wall.line(
        (5.0, 5.0), (0.6, 0.8), motion=Motion("sawtooth", (0.6, 0.8), amplitude=0.2, frequency=1.0, rise=0.3)
    )
    times = np.array([0.1, np.nextafter(0.3, 0.0), 0.5, np.nextafter(1.0, 0.0)])
    out, _ = of_kernel("line", wall, np.array([[6.0, 7.0, 0.0, 0.0, RADIUS]]), times)
    fall = 0.6 * GRAVITY[0] + 0.8 * GRAVITY[1]
    rising, falling = 0.4 / 0.3, -0.4 / 0.7
    np.testing.assert_allclose(fall * times - out[0, :, 1], [rising, falling, falling, rising], rtol=1e-12)


def test_an_image_of_a_wall_follows_from_its_number() -> None:
    backend.start("cpu")
    from ifrdem.kernels.walls.images import as_partner, boxes_of, from_partner, image_of, wall_of

    images = [(w, x, y) for w in (0, 1, 2, 99_999) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    numbers = [image_of(*each) for each in images]
    assert len(set(numbers)) == len(images)
    assert [(wall_of(number), *boxes_of(number)) for number in numbers] == images
    assert [from_partner(as_partner(number)) for number in numbers] == numbers
    assert max(as_partner(number) for number in numbers) == FIRST_WALL < NO_PARTNER


def test_the_serial_code_refuses_walls_that_it_does_not_know() -> None:
    """A shape, a motion or a turn that the program learns is not taken for one of the old ones."""
    still = SimpleNamespace(kind="still")
    of = {"points": (), "origin": (0.0, 0.0), "moving_times": (0.0, 9.0), "moves_from": None}
    wall = SimpleNamespace(shape="ellipse", motion=still, turn=still, radius=1.0, **of)
    at = np.array([[2.0, 0.0]])
    with pytest.raises(NotImplementedError, match="'ellipse'"):
        serial_walls.nearest_at_rest(wall, at)
    odd = SimpleNamespace(motion=SimpleNamespace(kind="jerk"), turn=SimpleNamespace(kind="jerk"), **of)
    for looked_up in (serial_walls.displaced, serial_walls.turned):
        with pytest.raises(NotImplementedError, match="'jerk'"):
            looked_up(odd, np.zeros(1))
