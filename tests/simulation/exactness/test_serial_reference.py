"""The serial reference itself, compared with results by hand, or with all pairs at every step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.serial_reference import contact_delay, simulate

from ifrdem.initial.placement import hexagonal_positions
from ifrdem.kernels.laws.law import collide_pair
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State

ELASTIC_SMOOTH = (1.0, -1.0, 0.0, 0.0, 0.0)
FRICTIONAL = (0.9, -0.8, 0.2, 0.0, 0.0)


def smallest_gap(disks: Disks, box: Box, position: NDArray[np.float64]) -> float:
    """Least distance minus sum of radii over all pairs, by brute force."""
    i, j = np.triu_indices(disks.n, k=1)
    distance = np.linalg.norm(box.minimum_image(position[j] - position[i]), axis=1)
    return float(np.min(distance - disks.radius[i] - disks.radius[j]))


def placed_one_by_one(disks: Disks, box: Box, rng: np.random.Generator) -> NDArray[np.float64]:
    """Positions without overlap: each disk is tried again until it fits."""
    position = np.empty((disks.n, 2))
    for i in range(disks.n):
        while True:
            position[i] = rng.random(2) * box.lengths
            gap = np.linalg.norm(box.minimum_image(position[:i] - position[i]), axis=1)
            if np.all(gap > disks.radius[:i] + disks.radius[i]):
                break
    return position


def all_pairs(
    disks: Disks, box: Box, law: NDArray[np.float64], state: State, collisions: int
) -> tuple[list[tuple[float, int, int]], NDArray[np.float64]]:
    """Move all disks to the earliest contact among all pairs and images, again and again.

    No cells, no heap, no local clocks, and the textbook root (-b - sqrt(b^2 - v^2 c)) / v^2.
    """
    x, v, w, time = state.position.copy(), state.velocity.copy(), state.spin.copy(), state.time
    i, j = np.triu_indices(disks.n, k=1)
    reach = np.arange(-4, 5)
    images = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 1, 2) * box.lengths
    sigma = disks.radius[i] + disks.radius[j]
    history = []
    for _ in range(collisions):
        r = x[j] - x[i] + images
        u = v[j] - v[i]
        b = np.sum(r * u, axis=-1)
        vv = np.sum(u * u, axis=-1)
        discriminant = b**2 - vv * (np.sum(r * r, axis=-1) - sigma**2)
        hits = (b < 0.0) & (discriminant >= 0.0)
        delay = np.where(hits, -b - np.sqrt(np.where(hits, discriminant, 0.0)), np.inf) / vv
        image, pair = np.unravel_index(np.argmin(delay), delay.shape)
        step = delay[image, pair]
        # The images kept must be all that could be hit: no disk may move further in this step.
        assert step * math.sqrt(vv.max()) < 3.0 * min(box.lengths)
        x, time = x + v * step, time + step
        p, q = int(i[pair]), int(j[pair])
        n = (x[q] - x[p] + images[image, 0]) / sigma[pair]
        one, two = (
            (1.0 / disks.mass[d], disks.radius[d], disks.k[d], v[d, 0], v[d, 1], w[d]) for d in (p, q)
        )
        after = collide_pair(*law[disks.material[p], disks.material[q]], n[0], n[1], *one, *two)
        v[p], w[p], v[q], w[q] = after[0:2], after[2], after[3:5], after[5]
        x = box.wrap(x)
        history.append((time, p, q))
    return history, x


def test_two_disks_meet_head_on_and_again_around_the_box() -> None:
    # Gap 3 - 1 = 2 closes at speed 2: contact at t = 1, with e_n = 1/2 they part at speed 1. Around the box
    # the gap is then 12 - 1 - 1 = 10: next contact at t = 11, after which each has speed 1/4.
    disks, box = Disks(2, 1.0, 0.5), Box((12.0, 6.0))
    state = State([[2.0, 3.0], [5.0, 3.0]], [[1.0, 0.0], [-1.0, 0.0]], [0.0, 0.0])
    end, collisions = simulate(disks, box, (0.5, -1.0, 0.0, 0.0, 0.0), state, t_end=13.0)
    assert collisions == [(1.0, 0, 1), (11.0, 0, 1)]
    np.testing.assert_array_equal(end.velocity, [[0.25, 0.0], [-0.25, 0.0]])
    # Disk 0 goes from 3 back to -2, then to -1.5: 10.5, one box to the left. Disk 1 from 4 to 9 to 8.5.
    np.testing.assert_array_equal(end.position, [[10.5, 3.0], [8.5, 3.0]])
    np.testing.assert_array_equal(end.image, [[-1, 0], [0, 0]])
    np.testing.assert_array_equal(end.collisions, [2, 2])


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0, 4.4])
def test_an_impulse_runs_along_a_row_of_three(angle: float) -> None:
    # Equal elastic disks pass the speed 2 on: 2 hits 0 after a gap of 1, 0 hits 1 after a gap of 1.5.
    along = np.array([math.cos(angle), math.sin(angle)])
    box = Box((10.0, 10.0))
    corner = np.array([9.8, 0.1])  # so that the row lies across the sides
    position = box.wrap(corner + np.outer([2.0, 4.5, 0.0], along))
    velocity = np.outer([0.0, 0.0, 2.0], along)
    end, collisions = simulate(
        Disks(3, 1.0, 0.5), box, ELASTIC_SMOOTH, State(position, velocity, np.zeros(3)), t_end=1.5
    )
    assert [pair[1:] for pair in collisions] == [(0, 2), (0, 1)]
    np.testing.assert_allclose([pair[0] for pair in collisions], [0.5, 1.25], rtol=1e-14)  # f64 round-off
    np.testing.assert_allclose(end.velocity, np.outer([0.0, 2.0, 0.0], along), atol=1e-14)


def test_a_heavy_disk_keeps_its_direction_and_a_light_one_takes_the_rest() -> None:
    # Elastic, head-on, masses 3 and 1, speeds 1 and 0: 1/2 and 3/2 (momentum 3, energy 3/2).
    state = State([[2.0, 5.0], [7.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0], time=4.0)
    disks = Disks(2, [3.0, 1.0], [1.0, 0.5])
    end, collisions = simulate(disks, Box((10.0, 10.0)), ELASTIC_SMOOTH, state, max_collisions=1)
    assert collisions == [(7.5, 0, 1)]  # start 4.0, gap 5 - 1.5 at speed 1
    assert end.time == 7.5
    np.testing.assert_allclose(end.velocity[:, 0], [0.5, 1.5], rtol=1e-15)


def test_a_free_disk_flies_straight_through_the_sides() -> None:
    state = State([[1.0, 2.0]], [[3.0, -2.0]], [0.5], image=np.array([[5, 0]], dtype=np.int32))
    end, collisions = simulate(Disks(1, 1.0, 0.5), Box((4.0, 8.0)), ELASTIC_SMOOTH, state, t_end=10.0)
    assert collisions == []
    # x = 1 + 30 = 31 = 3 + 7 * 4, y = 2 - 20 = -18 = 6 - 3 * 8
    np.testing.assert_allclose(end.position, [[3.0, 6.0]], rtol=1e-14)
    np.testing.assert_array_equal(end.image, [[12, -3]])


def test_contact_delay_of_a_touching_pair() -> None:
    assert contact_delay(1.0 - 1e-15, 0.0, -1.0, 0.0, 1.0) == 0.0  # rounded into an overlap, approaching
    assert contact_delay(1.0 - 1e-15, 0.0, 1.0, 0.0, 1.0) == math.inf  # the same, separating
    assert contact_delay(3.0, 1.0, -1.0, 0.0, 1.0 - 1e-12) == math.inf  # passes by
    # Grazing: 3 - sqrt(1 - 0.6^2) = 2.2
    assert contact_delay(3.0, 0.6, -1.0, 0.0, 1.0) == pytest.approx(2.2, rel=1e-15)
    # Slow approach: 1e-9 v, gap 1; the textbook root would keep 7 digits only.
    assert contact_delay(2.0, 0.0, -1e-9, 0.0, 1.0) == pytest.approx(1e9, rel=1e-15)


GASES = {
    "dilute": (20, 0.1, 1.0, [FRICTIONAL]),
    "dense": (24, 0.4, 1.0, [FRICTIONAL]),
    "elastic smooth": (16, 0.3, 1.0, [ELASTIC_SMOOTH]),
    "two sizes, two materials": (20, 0.25, 1.5, [FRICTIONAL, (0.7, -0.9, 0.4, 1.0, 0.01)]),
    "as small a box as allowed": (4, 0.28, 1.0, [FRICTIONAL]),
}


@pytest.mark.full(keep=5)
@pytest.mark.parametrize("gas", GASES)
@pytest.mark.parametrize("seed", range(5))
def test_all_pairs_at_every_step_give_the_same_collisions(gas: str, seed: int) -> None:
    n, packing_fraction, ratio, rows = GASES[gas]
    rng = np.random.default_rng(seed)
    small = np.arange(n) % 3 == 0
    radius = np.where(small, 0.5 / ratio, 0.5)
    disks = Disks(n, radius**2, radius, k=np.where(small, 1.0, 2.0), material=small * (len(rows) - 1))
    law = np.array([[rows[max(a, b)] for b in range(len(rows))] for a in range(len(rows))])
    box = Box.from_packing_fraction(radius, packing_fraction, aspect=1.2)
    state = State(placed_one_by_one(disks, box, rng), rng.normal(size=(n, 2)), rng.normal(size=n), time=1.0)
    expected, position = all_pairs(disks, box, law, state, 3 * n)
    end, collisions = simulate(disks, box, law, state, max_collisions=3 * n)
    assert [pair[1:] for pair in collisions] == [pair[1:] for pair in expected]
    # 6 collisions a disk (some have 9), each multiplying an error by about 1 + 2 flight / radius, 10 in the
    # dilute gas: 10^9 eps. A contact missed or misplaced changes everything after it by order 1.
    np.testing.assert_allclose([p[0] for p in collisions], [p[0] for p in expected], rtol=1e-6)
    assert np.abs(box.minimum_image(end.position - position)).max() < 1e-5


@pytest.mark.parametrize(("packing_fraction", "ratio"), [(0.1, 1.0), (0.6, 1.0), (0.4, 2.0)])
def test_a_gas_never_overlaps_and_keeps_energy_and_momentum(packing_fraction: float, ratio: float) -> None:
    n = 400
    radius = np.where(np.arange(n) % 2 == 0, 0.5, 0.5 / ratio)
    disks = Disks(n, radius**2, radius)
    box = Box.from_packing_fraction(radius, packing_fraction)
    rng = np.random.default_rng(3)
    state = State(hexagonal_positions(box, radius), rng.normal(size=(n, 2)), rng.normal(size=n))
    end = state
    total = 0
    for _ in range(8):
        end, collisions = simulate(disks, box, ELASTIC_SMOOTH, end, max_collisions=500)
        total += len(collisions)
        times = [pair[0] for pair in collisions]
        assert times == sorted(times)
        # One rounding of a position: box length times eps, some 1e-14; a missed contact is 1e-1.
        assert smallest_gap(disks, box, end.position) > -1e-12
    assert total == 4000
    assert end.collisions.sum() == 2 * total
    np.testing.assert_array_equal(end.spin, state.spin)  # smooth disks do not turn each other
    mass = disks.mass[:, None]
    # 4,000 collisions, each rounding twice: 4000 eps = 1e-12 even if the roundings all add up.
    assert np.sum(mass * end.velocity**2) == pytest.approx(np.sum(mass * state.velocity**2), rel=1e-12)
    np.testing.assert_allclose(
        np.sum(mass * end.velocity, axis=0), np.sum(mass * state.velocity, axis=0), atol=1e-11
    )


def test_elastic_smooth_disks_retrace_their_way_when_reversed() -> None:
    n = 60
    disks = Disks(n, 1.0, 0.5)
    box = Box.from_packing_fraction(disks.radius, 0.3)
    rng = np.random.default_rng(8)
    start = State(placed_one_by_one(disks, box, rng), rng.normal(size=(n, 2)), np.zeros(n))
    there, forward = simulate(disks, box, ELASTIC_SMOOTH, start, t_end=1.5)
    turned = State(there.position, -there.velocity, there.spin)
    back, backward = simulate(disks, box, ELASTIC_SMOOTH, turned, t_end=1.5)
    assert len(forward) > n  # more than two collisions a disk, else this shows nothing
    assert [pair[1:] for pair in backward] == [pair[1:] for pair in reversed(forward)]
    # Some 10 collisions for the busiest disks there and back, each multiplying an error by about 5: 10^7 eps.
    assert np.abs(box.minimum_image(back.position - start.position)).max() < 1e-7


def test_a_box_too_small_for_the_cells_is_refused() -> None:
    state = State([[1.0, 1.0]], [[1.0, 0.0]], [0.0])
    with pytest.raises(ValueError, match="three largest diameters"):
        simulate(Disks(1, 1.0, 0.5), Box((2.9, 5.0)), ELASTIC_SMOOTH, state, t_end=1.0)
