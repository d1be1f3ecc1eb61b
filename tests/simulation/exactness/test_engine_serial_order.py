"""The parallel engine finds the same collisions, in the same order, as a plain serial event-driven code.

Both start from the same state. Rounding differences grow by a factor of a few with each collision of a disk, so
after some ten collisions per disk the two must part; five are compared, four in thin gases.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree
from support.gases import (
    COIN,
    ELASTIC,
    ROLLING,
    equal_disks,
    equilibrated,
    mixture,
    partners,
    run,
    run_to,
    start,
)
from support.serial_reference import simulate

from ifrdem.initial import placement
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.simulation.engine import Engine
from ifrdem.validation.rows import engine_of

PER_DISK = 5


Serial = tuple[State, list[tuple[float, int, int]]]


@pytest.fixture(autouse=True)
def windows_of_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows as short as those of gases that are divided: few disks have longer ones, which would need wide halos."""
    monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 100)


def assert_same_as_serial(
    disks: Disks,
    box: Box,
    state: State,
    law: tuple[float, ...],
    engine: Engine,
    per_disk: float = PER_DISK,
    by_serial: Serial | None = None,
) -> None:
    count = int(per_disk * disks.n / 2)
    found = run(engine, count)
    end, expected = by_serial or simulate(disks, box, law, state, max_collisions=count)
    assert len(expected) == count
    assert len(found.time) == count
    pairs = np.array([sorted(collision[1:]) for collision in expected])
    np.testing.assert_array_equal(partners(found.pair), partners(pairs))
    # Places are rounded to 3e-14 or 6e-14 here. Errors grow by some 10 with each collision of a disk, of which the
    # busiest have twice the mean, and most where the gas is thin: 2e-7 after four at phi = 0.1, 1e-10 in denser ones.
    np.testing.assert_allclose(found.time, [collision[0] for collision in expected], atol=1e-6)
    np.testing.assert_allclose(box.minimum_image(engine.state().position - end.position), 0.0, atol=1e-5)


@cache
def equal_gas(packing_fraction: float, law: tuple[float, ...]) -> tuple[Disks, Box, State, float, Serial]:
    """A gas, how many collisions of each disk are compared, and what the serial code makes of it."""
    disks = equal_disks(1000)
    box, state = equilibrated(disks, packing_fraction)
    per_disk = 4.0 if packing_fraction < 0.2 else PER_DISK
    return disks, box, state, per_disk, simulate(disks, box, law, state, max_collisions=int(per_disk * 500))


@pytest.mark.full(keep=("cpu-0.1-elastic-serial", "cpu-0.7-rolling-tiled"))
@pytest.mark.parametrize("order", ["serial", "tiled"])
@pytest.mark.parametrize("law", [ELASTIC, COIN, ROLLING], ids=["elastic", "coin", "rolling"])
@pytest.mark.parametrize("packing_fraction", [0.1, 0.3, 0.6, 0.7])
def test_collisions_are_those_of_the_serial_code(
    packing_fraction: float, law: tuple[float, ...], order: str, device: str
) -> None:
    disks, box, state, per_disk, by_serial = equal_gas(packing_fraction, law)
    engine = engine_of(disks, box, state, np.array([[law]]), device=device, order=order, tile_disks=60)
    assert_same_as_serial(disks, box, state, law, engine, per_disk, by_serial)
    assert engine.statistics.in_order < engine.statistics.windows


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(("order", "n"), [("serial", 20_000), ("tiled", 50_000)])
def test_none_of_many_disks_ever_overlap(order: str, n: int) -> None:
    """A pair that was missed meets without a collision: looked for among all pairs, several times per flight.

    Tiles of some 5000 disks, as usual: ten.
    """
    disks = equal_disks(n)
    box, state = start(disks, 0.6)
    engine = engine_of(disks, box, state, np.array([[ELASTIC]]), order=order)
    lengths = np.array(box.lengths)
    for _ in range(30):
        position = run_to(engine, collisions=engine.collisions + disks.n // 8).position % lengths
        inside = cKDTree(position, boxsize=lengths).query_pairs(1.0 - 1e-9, output_type="ndarray")
        assert not len(inside), (engine.time, inside)


@pytest.mark.full(keep=("cpu-0.1", "cpu-0.55"))
@pytest.mark.parametrize("packing_fraction", [0.1, 0.3, 0.55])
def test_collisions_of_a_mixture_are_those_of_the_serial_code(packing_fraction: float, device: str) -> None:
    disks = mixture(1000)
    box, state = equilibrated(disks, packing_fraction)
    engine = engine_of(disks, box, state, np.array([[COIN]]), device=device)
    assert_same_as_serial(disks, box, state, COIN, engine, per_disk=4 if packing_fraction < 0.2 else PER_DISK)


def driven_by_heavy_disks(n: int) -> tuple[Disks, Box, State]:
    """Heavy disks drive light ones, at rest before, to almost twice their own speed."""
    heavy = np.arange(n) % 20 == 0
    disks = Disks(n, mass=np.where(heavy, 100.0, 0.01), radius=0.5)
    box, state = start(disks, 0.3)
    return disks, box, State(state.position, np.where(heavy[:, None], state.velocity, 0.0), np.zeros(n))


@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_disks_that_become_fast_lose_no_collision(order: str) -> None:
    """Faster than any at the beginning of a window, after which its length and the halos were chosen."""
    disks, box, state = driven_by_heavy_disks(900)
    engine = engine_of(disks, box, state, np.array([[ELASTIC]]), order=order, tile_disks=100)
    assert_same_as_serial(disks, box, state, ELASTIC, engine, per_disk=3)


def small_box() -> tuple[Disks, Box, State]:
    """Nine disks in a box of four diameters: two cells a side, most pairs meet through both."""
    disks = equal_disks(9)
    box = Box((4.0, 3.6))
    state = State(
        np.array([[x, y] for x in (0.0, 1.3, 2.6) for y in (0.0, 1.2, 2.4)]),
        np.random.default_rng(3).normal(size=(9, 2)),
        np.zeros(9),
    )
    return disks, box, state


def two_in_a_long_box() -> tuple[Disks, Box, State]:
    disks = equal_disks(2)
    return (
        disks,
        Box((30.0, 3.1)),
        State(np.array([[1.0, 1.0], [29.0, 1.3]]), np.array([[-1.0, 0.0], [1.0, 0.0]]), np.zeros(2)),
    )


@pytest.mark.parametrize("order", ["serial", "tiled"])
@pytest.mark.parametrize("make", [small_box, two_in_a_long_box])
def test_small_boxes_give_the_serial_collisions(
    make: Callable[[], tuple[Disks, Box, State]], order: str
) -> None:
    disks, box, state = make()
    engine = engine_of(disks, box, state, np.array([[ELASTIC]]), order=order, tile_disks=3)
    assert_same_as_serial(disks, box, state, ELASTIC, engine, per_disk=3)


def sequence(engine: Engine, t_end: float) -> list[tuple[int, int]]:
    """The pairs that collide until `t_end`, in order."""
    engine.keep_collisions = True
    pairs: list[tuple[int, int]] = []
    while engine.time < t_end:
        engine.advance(t_end=t_end)
        if engine.last_collisions is not None:
            pairs += [(int(i), int(j)) for i, j in engine.last_collisions.pair]
    return pairs


@pytest.mark.full
@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_a_light_disk_flies_on_from_a_heavy_one_at_twice_its_speed(order: str) -> None:
    """And takes all of the box in the rest of the window."""
    disks = Disks(2, mass=np.array([1.0, 0.01]), radius=0.5)
    state = State(np.array([[1.0, 5.0], [5.8, 5.0]]), np.array([[1.0, 0.0], [0.0, 0.0]]), np.zeros(2))
    engine = engine_of(disks, Box((20.0, 20.0)), state, np.array([[ELASTIC]]), order=order)
    assert sequence(engine, 6.0) == [(0, 1)]
    # Elastic: the heavy one keeps (M - m) / (M + m), the light one gets 2 M / (M + m).
    np.testing.assert_allclose(engine.state().velocity[:, 0], [0.99 / 1.01, 2.0 / 1.01], rtol=1e-14)


@pytest.mark.full
def test_a_disk_among_thousands_of_small_ones_loses_none() -> None:
    n = 3000
    radius = np.full(n + 1, 0.5)
    radius[0] = 8.0
    disks = Disks(n + 1, mass=(2.0 * radius) ** 2, radius=radius)
    box = Box((240.0, 240.0))
    grid = np.stack(np.meshgrid(np.arange(60) * 4.0 + 2.0, np.arange(60) * 4.0 + 2.0), axis=-1).reshape(-1, 2)
    far = grid[np.hypot(*(grid - 120.0).T) > 12.0][:n]
    velocity = np.random.default_rng(4).normal(size=(n + 1, 2))
    velocity[0] = 0.0
    state = State(np.vstack(([[120.0, 120.0]], far)), velocity, np.zeros(n + 1))
    engine = engine_of(disks, box, state, np.array([[ELASTIC]]))
    assert_same_as_serial(disks, box, state, ELASTIC, engine, per_disk=1)


@pytest.mark.parametrize("n", [300, 25_000])
def test_disks_in_a_strip_of_three_diameters_meet_by_every_image(n: int) -> None:
    """Two disks that have just separated meet again across the periodic box, without any other collision between."""
    box = Box((3.0, 2.4 * n))
    position = np.stack([np.full(n, 1.5), 2.4 * np.arange(n) + 0.3], axis=1)
    velocity = placement.maxwellian(np.ones(n), temperature=1.0, seed=1)
    engine = engine_of(equal_disks(n), box, State(position, velocity, np.zeros(n)), np.array([[ELASTIC]]))
    position = run_to(engine, 2.0).position % np.array(box.lengths)
    assert not cKDTree(position, boxsize=box.lengths).query_pairs(1.0 - 1e-9)
