"""Functions of tiles and cells, each by itself, against the plain arithmetic of boxes and their images."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from support.scene import Scene

from ifrdem.kernels import columns
from ifrdem.kernels.columns import GHOST_STEP
from ifrdem.kernels.layout import MORE, NO_PARTNER, Uses
from ifrdem.simulation import backend

Array = NDArray[np.float64]
PLAIN, SHEARED = Uses(), Uses(shear=True)


@pytest.fixture(scope="module", autouse=True)
def runtime() -> None:
    backend.start("cpu")


def boxes(periodic: tuple[int, int], rows: int = 12, **shapes: int) -> Scene:
    """3 x 4 tiles of different sides, numbered column by column."""
    scene = Scene(rows, **shapes)
    grid, scale = scene.grid, scene.scale
    grid.tiles_x, grid.tiles_y, (grid.periodic_x, grid.periodic_y) = 3, 4, periodic
    scene.arrays["edge_x"] = np.array([0.0, 2.0, 3.0, 7.0])
    scene.arrays["edge_y"] = np.array([0.0, 1.0, 3.0, 3.5, 8.0])
    scale.length_x, scale.length_y, scale.window = 7.0, 8.0, 1.0
    return scene


def test_the_bound_of_a_speed_is_that_of_the_fastest_one_so_far() -> None:
    """Squares 25, 169, 1, 2: a window's bound stays at the largest, rounded up by 1e-6 and to half a double."""
    from support.kernels.tiles import note

    scene, out = Scene(), np.zeros(4)
    scene.call(
        note, PLAIN, "motion event_info", np.array([[3.0, 4.0], [5.0, -12.0], [1.0, 0.0], [1.0, 1.0]]), out
    )
    largest = np.array([25.0, 169.0, 169.0, 169.0])
    assert np.all(out >= largest)
    assert np.all(out <= largest * (1.0 + 4e-6))


@pytest.mark.parametrize("periodic", [(1, 1), (1, 0), (0, 1)])
def test_neighbouring_tiles_lie_where_images_of_the_box_do(periodic: tuple[int, int]) -> None:
    """Tile (i, j) of an image of the box n, m boxes away has its corner at (x_i + n L_x, y_j + m L_y)."""
    from support.kernels.tiles import neighbors

    scene, out = boxes(periodic), np.zeros((12 * 49, 5))
    scene.call(neighbors, PLAIN, "uses grid scale edge_x edge_y", out)
    x, y = scene.edge_x, scene.edge_y
    for row, (i, j, a, b) in zip(
        out, itertools.product(range(3), range(4), range(-3, 4), range(-3, 4)), strict=True
    ):
        (n, k), (m, h) = divmod(i + a, 3), divmod(j + b, 4)
        if (n and not periodic[0]) or (m and not periodic[1]):
            assert row[0] == -1.0
        else:
            assert row.tolist() == [4 * k + h, x[k] + 7.0 * n - x[i], y[h] + 8.0 * m - y[j], n, m]


def test_rows_of_a_sheared_box_have_moved_on_by_whole_tiles() -> None:
    """Equal tiles of side 2: a row above is `tiles_aside` tiles and `boxes_aside` boxes further, for each step up."""
    from support.kernels.tiles import neighbors

    scene, out = boxes((1, 1)), np.zeros((12 * 49, 5))
    scene.arrays["edge_x"], scene.arrays["edge_y"] = np.arange(4) * 2.0, np.arange(5) * 2.0
    scene.grid.tiles_aside, scene.grid.boxes_aside = 2, 5
    scene.call(neighbors, SHEARED, "uses grid scale edge_x edge_y", out)
    for row, (i, j, a, b) in zip(
        out, itertools.product(range(3), range(4), range(-3, 4), range(-3, 4)), strict=True
    ):
        (n, k), (m, h) = divmod(i + a - 2 * b, 3), divmod(j + b, 4)
        # Corners of the tiles that are asked for: a and b tiles away, in the frame of the row above.
        assert row.tolist() == [4 * k + h, 2.0 * a, 2.0 * b, n - 5 * b, m]


def test_places_are_in_the_box_and_count_the_boxes_that_they_left() -> None:
    """0 <= x < L: a disk at a side of the box is at 0 of the next box; also one that a rounding error put there."""
    from support.kernels.tiles import place

    at = np.array([[7.0, 8.0], [0.0, 0.0], [-0.5, 3.0], [7.5, 8.5], [-7.0, -8.0], [6.5, -0.25]])
    scene, out = boxes((1, 1), disk=len(at)), np.zeros((len(at), 5))
    tile = 4 * 1 + 2  # whose corner is (2, 3)
    scene.disk.x, scene.disk.y = at[:, 0] - 2.0, at[:, 1] - 3.0
    scene.call(place, PLAIN, "uses grid scale edge_x edge_y disk", tile, 0.0, out)
    count = np.floor(at / [7.0, 8.0])
    np.testing.assert_array_equal(out[:, :2], at - count * [7.0, 8.0])
    np.testing.assert_array_equal(out[:, 2:4], count)
    scene.grid.periodic_x = scene.grid.periodic_y = 0
    scene.call(place, PLAIN, "uses grid scale edge_x edge_y disk", tile, 0.0, out)
    np.testing.assert_array_equal(out[:, :4], np.column_stack((at, np.zeros_like(at))))


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (30.0, -70.0)])
@pytest.mark.parametrize("differing", [None, 0, 1])
def test_either_word_of_a_history_tells_that_a_copy_went_another_way(
    differing: int | None, gravity: tuple[float, float]
) -> None:
    """Two tiles side by side, a copy in the halo of the first that came close to its disk: both words are compared.

    Bits of a whole gas hardly show it: histories that differ have one word in common in one of 2^32 cases. Gravity
    makes no difference: all disks fall alike.
    """
    from support.kernels.tiles import verify

    scene, out = boxes((1, 1), rows=12, disk=8), np.zeros(1)
    scene.grid.room = 4
    scene.scale.widest, scene.scale.most_halo = 1.0, 1.0
    # At the beginning, part 0: slot 1 at (2.1, .5) in tile 4, to the right. At the end, part 1: slot 0 in tile 0.
    scene.disk.x[[1, 4]], scene.disk.y[[1, 4]] = (0.1, 1.6), (0.5, 0.5)
    scene.scale.gx, scene.scale.gy = gravity
    scene.disk.x[4] += 0.5 * gravity[0]
    scene.disk.y[4] += 0.5 * gravity[1]
    scene.tile.start[0], scene.tile.count[0] = (0, 0), (1, 1)
    scene.tile.start[4], scene.tile.count[4] = (1, 1), (1, 1)
    scene.tile.ghosts[0], scene.tile.n_ghosts[0] = 3, 1
    scene.ghost.place[3] = 1 | (2 * 3 + 1) << GHOST_STEP  # slot 1, one tile to the right
    scene.history_hash.hash_1[1], scene.history_hash.hash_2[1] = 17, -4
    scene.ghost.hash_1[3], scene.ghost.hash_2[3] = 17, -4
    if differing is not None:
        scene.ghost.array[3, columns.GHOST.hash_1 + differing] += 1
    names = "uses grid scale reach tile edge_x edge_y disk history_hash displacement slot_before ghost"
    scene.call(verify, PLAIN, names, out)
    assert out[0] == float(differing is not None)


def first_meetings(
    place: Array, velocity: Array, cells: NDArray[np.int64], side: float, count: int, *, half: bool
) -> tuple[Array, Array]:
    """Times and partners of first contacts (diameter 1) with disks of the 3 x 3 cells around, and their images.

    With `half`, of the cells to the right, of that above, and of disks of the own cell that were put there before.
    """
    boxes = np.array(list(itertools.product((-1, 0, 1), repeat=2)))[:, None, None]
    steps = cells + count * boxes - cells[:, None]  # (images, disks, others, 2)
    near = np.abs(steps).max(axis=-1) <= 1
    if half:
        x, y = np.moveaxis(steps, -1, 0)
        before = np.tri(len(place), k=-1, dtype=bool)  # others with a lower number
        near &= (x > 0) | (x == 0) & ((y > 0) | (y == 0) & before)
    r, v = place + side * boxes - place[:, None], velocity - velocity[:, None]
    b, vv = np.sum(r * v, axis=-1), np.sum(v * v, axis=-1) + np.eye(len(place))
    root = b**2 - vv * (np.sum(r * r, axis=-1) - 1.0)
    meets = near & (b < 0.0) & (root > 0.0)
    time = np.where(meets, -(b + np.sqrt(np.maximum(root, 0.0))) / vv, np.inf).min(axis=0)
    return time.min(axis=1), np.where(np.isinf(time.min(axis=1)), NO_PARTNER, time.argmin(axis=1))


def test_disks_find_their_first_partners_across_all_sides_of_a_box() -> None:
    """40 disks in 6 x 6 cells, each by all pairs and images in NumPy. `search_cells` else runs on GPUs only."""
    from support.kernels.tiles import search

    n, count, side = 40, 6, 9.0
    scene = Scene(n, head=3 * count * count, reach=1, kinds=1)  # lanes of others around are empty
    scene.grid.cells = count * count
    scene.grid.tiles_x = scene.grid.tiles_y = scene.grid.single_tile = 1
    scene.grid.periodic_x = scene.grid.periodic_y = 1
    scene.arrays["edge_x"] = scene.arrays["edge_y"] = np.array([0.0, side])
    scale = scene.scale
    scale.length_x = scale.length_y = side
    scale.cell_side, scale.widest, scale.window = side / count, 1.0, 1.0
    info = scene.event_info
    info.id, info.last = np.arange(n), NO_PARTNER
    for seed in range(20):
        rng = np.random.default_rng(seed)
        grid = np.stack(np.meshgrid(np.arange(7), np.arange(7)), -1).reshape(-1, 2)[rng.permutation(49)[:n]]
        place = (grid + 0.5) * side / 7 + rng.uniform(-0.14, 0.14, (n, 2))
        velocity = rng.normal(size=(n, 2))
        cells = np.floor(place / (side / count)).astype(np.int64)
        scene.motion.x, scene.motion.y, scene.motion.vx, scene.motion.vy = *place.T, *velocity.T
        info.cell = (cells[:, 0] << 16) + cells[:, 1]
        scene.head[:] = -1
        for i, at in enumerate(cells @ [count, 1]):
            following = scene.head[count**2 + at]
            info.next_in_cell[i], scene.head[count**2 + at] = following, i + MORE * (following >= 0)
        times, partners = np.zeros((n, 4)), np.zeros((n, 4))
        names = "uses grid scale reach edge_x edge_y kinds motion event_info head"
        scene.call(search, PLAIN, names, times, partners)
        for half in (False, True):
            expected, partner = first_meetings(place, velocity, cells, side, count, half=half)
            met, lanes = partner >= 0, slice(2 * half, 2 * half + 2)
            assert np.count_nonzero(met) > 15 - 5 * half
            np.testing.assert_array_equal(partners[:, lanes], np.column_stack((partner, partner)))
            np.testing.assert_allclose(
                times[met, lanes], np.column_stack((expected, expected))[met], rtol=1e-9
            )


def test_all_that_a_disk_is_goes_from_window_to_window() -> None:
    """Each quantity of a state, also of disks that may rest, is loaded from one row and stored in another.

    Forces at contacts are where the solver begins in the next window: without them a heap has other bits, not others
    that a test of weights would see.
    """
    from support.kernels.tiles import carry

    names = (
        "uses grid scale reach edge_x edge_y tile kinds disk meta past hits held asleep dissipated kind motion "
        "event_info image_info candidates rest cached_force since turn loss"
    )
    uses = Uses(
        walls=True,
        latest_collision=True,
        angle=True,
        last_partner=True,
        ledger=True,
        dissipated=True,
        several_kinds=True,
        rest=True,
    )
    scene = Scene(3)
    scene.grid.tiles_x = scene.grid.tiles_y = scene.grid.single_tile = 1
    scene.grid.lane_slots, scene.grid.room = 3, 3
    scene.scale.cell_side = scene.scale.length_x = scene.scale.length_y = scene.scale.widest = 9.0
    rng, state = np.random.default_rng(1), ("disk", "meta", "past", "hits", "held", "dissipated")
    for name in state:
        array = getattr(scene, name).array
        array[0] = rng.integers(1, 9, array.shape[1])
    scene.meta.id[0], scene.asleep[0], scene.event_info.last[1] = 0, 1, NO_PARTNER
    scene.call(carry, uses, names)
    for name in state:
        array = getattr(scene, name).array
        assert array[2].tolist() == array[0].tolist(), name
    assert scene.asleep[2] == 1
