"""Lines of flight in cells of thin gases: none that may meet is left out, and none is lost when disks change cells."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.scene import Scene

from ifrdem.kernels.layout import Uses
from ifrdem.simulation import backend

NAMES = "grid scale uses kinds motion event_info line line_slot bunch spare"
ONE, TWO = Uses(thin=True), Uses(thin=True, several_kinds=True)


@pytest.fixture(scope="module", autouse=True)
def runtime() -> None:
    backend.start("cpu")


def scene(n: int, cells: int, widest: float = 1.0) -> Scene:
    """n disks of two radii, in lane 1 of two."""
    from ifrdem.kernels.tiles.lines import NUMBERS, PLACES

    bunches = cells + n // PLACES + 1
    places = 2 * bunches * PLACES
    made = Scene(2 * n, kinds=2, bunch=2 * bunches, line=places * NUMBERS, line_slot=places, spare=2)
    made.grid.lane_slots, made.grid.bunches = n, bunches
    made.scale.widest, made.scale.per_widest, made.scale.window = widest, 1.0 / widest, 2.0
    made.kinds.radius[:] = 0.5 * widest, 0.2 * widest
    made.event_info.kind[n:] = np.arange(n) % 2
    return made


def passed(given: Scene, n: int, nx: int, ny: int, moves: NDArray[np.float64]) -> NDArray[np.float64]:
    from support.kernels.lines import pass_by

    found = np.zeros((n, n))
    given.call(pass_by, TWO, NAMES, n, nx, ny, moves, found)
    return found


@pytest.mark.parametrize("widest", [1.0, 3e-9])
def test_lines_that_touch_pass_the_test_however_far_and_fast(widest: float) -> None:
    """Each pair of slots 2 m, 2 m + 1 comes as close as the sum of its radii, within 1e-9, from up to 1e6 diameters.

    Positions and ways are of all magnitudes. Without ERROR a third of the far ones would be left out. What passes by
    more than four times the margin must not pass the test, else it would be of no use.
    """
    from ifrdem.kernels.tiles.lines import PLACES

    n, rng = 800, np.random.default_rng(1)
    given, unit = scene(n, 1, widest), widest

    def any_size(least: float, most: float) -> NDArray[np.float64]:
        size = 10.0 ** rng.uniform(np.log10(least), np.log10(most), (n // 2, 1))
        return size * rng.normal(size=(n // 2, 2)) * unit

    radius = np.where(np.arange(n) % 2, 0.2, 0.5) * unit
    velocity, clock = np.empty((n, 2)), rng.uniform(0.0, 2.0, (n, 1))
    velocity[::2], velocity[1::2] = any_size(1e-12, 1e6), any_size(1e-12, 1e6)
    place, when = np.empty((n, 2)), rng.uniform(0.0, 2.0, (n // 2, 1))
    u = velocity[1::2] - velocity[::2]
    normal = np.stack([-u[:, 1], u[:, 0]], axis=1) / np.hypot(*u.T)[:, None]
    at = any_size(1e-3, 1e6)  # where the first one is when they touch
    place[::2] = at + velocity[::2] * (clock[::2] - when)
    touch = at + normal * ((1.0 - 1e-9) * (radius[::2] + radius[1::2]))[:, None]
    place[1::2] = touch + velocity[1::2] * (clock[1::2] - when)
    # A bunch has the error of its farthest line: pairs in order of theirs.
    span = np.abs(place - velocity * clock).sum(axis=1) + 2.0 * np.abs(velocity).sum(axis=1)
    order = np.argsort(np.maximum(span[::2], span[1::2]))
    order = np.column_stack([2 * order, 2 * order + 1]).ravel()
    place, velocity, clock = place[order], velocity[order], clock[order]
    motion = given.motion
    for name, values in zip(("x", "y", "vx", "vy"), (*place.T, *velocity.T), strict=True):
        getattr(motion, name)[n:] = values
    motion.tau[n:] = clock[:, 0]
    bits = passed(given, n, 1, 1, np.zeros((0, 3))) == 2.0
    pair = np.arange(0, n, 2)
    assert bits[pair, pair + 1].all()
    assert bits[pair + 1, pair].all()

    exact = (place.astype(np.longdouble) - velocity * clock.astype(np.longdouble)) / unit
    way = velocity * np.longdouble(2.0) / unit
    r, u = exact[None] - exact[:, None], way[None] - way[:, None]
    with np.errstate(invalid="ignore"):
        miss = np.abs(r[..., 0] * u[..., 1] - r[..., 1] * u[..., 0]) / np.hypot(u[..., 0], u[..., 1])
    reach = np.abs(exact).sum(axis=1) + np.abs(way).sum(axis=1)
    reach = np.repeat(reach.reshape(-1, PLACES).max(axis=1), PLACES)
    sigma = (radius[None] + radius[:, None]) / unit
    far = miss > 1.0 + 64.0 * 2.0**-24 * (reach[None] + reach[:, None])
    assert np.count_nonzero(far) > 0.4 * n * n
    assert not bits[far].any()
    assert bits[miss <= sigma].all()


@pytest.mark.parametrize("speed", [0.0, 1e-25, 1e13, 1e160])
def test_lines_of_no_way_and_of_one_too_long_pass_all_tests(speed: float) -> None:
    """Squares of such ways underflow, or overflow, where nothing can be told: all disks must be compared."""
    n = 40
    given = scene(n, 1)
    angle = np.arange(n) / n * 2.0 * np.pi
    given.motion.x[n:], given.motion.y[n:] = np.cos(angle), np.sin(angle)
    given.motion.vx[n:], given.motion.vy[n:] = -speed * np.cos(angle), -speed * np.sin(angle)
    assert np.all(passed(given, n, 1, 1, np.zeros((0, 3))) == 2.0)


def test_disks_that_change_cells_have_one_place_each() -> None:
    """300 disks in 2 x 3 cells, which need several bunches each, change cells 3,000 times, sometimes all into one.

    Each is found once by each, in the cell where it is; a bunch that no cell needs any more is used again, else there
    would be no room.
    """
    from ifrdem.kernels.tiles.lines import PLACES

    n, rng = 300, np.random.default_rng(2)
    given = scene(n, 6)
    given.motion.x[n:], given.motion.vx[n:] = rng.normal(size=n), rng.normal(size=n)
    moves = np.column_stack([rng.integers(0, n, 3000), rng.integers(0, 2, 3000), rng.integers(0, 3, 3000)])
    for begin in range(0, 3000, 1000):
        moves[begin : begin + n] = np.column_stack(
            [np.arange(n), np.full(n, begin // 1000 % 2), np.full(n, begin // 1000)]
        )
    found = passed(given, n, 2, 3, moves.astype(np.float64))
    assert np.all((found == 1.0) | (found == 2.0))
    cell = (given.event_info.cell[n:] >> 16) * 3 + (given.event_info.cell[n:] & 0xFFFF)
    last = {int(slot): 3 * x + y for slot, x, y in moves}
    np.testing.assert_array_equal(cell, [last[i] for i in range(n)])
    first, count = given.grid.bunches, []
    for start in range(6):
        b, sizes = first + start, []
        while b >= 0:
            sizes.append(int(given.bunch.count[b]))
            slots = given.line_slot[PLACES * b : PLACES * b + sizes[-1]]
            np.testing.assert_array_equal(cell[slots - n], start)
            b = int(given.bunch.next[b])
        assert sizes[:-1] == [PLACES] * (len(sizes) - 1)
        count.append(sum(sizes))
    assert count == np.bincount(cell, minlength=6).tolist()
