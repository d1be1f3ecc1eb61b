"""Disks of very different sizes: the engine finds the collisions of the serial code."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from support.gases import COIN, partners
from support.serial_reference import simulate
from test_engine_serial_order import run

from ifrdem.initial import packing, placement, radii
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.validation.rows import engine_of

N = 1000
SIZES = {
    # Two sizes with about the same area each, and all sizes between 1 and 10.
    "bidisperse": lambda: radii.bidisperse(N, low=0.5, high=5.0, large_fraction=0.01, seed=1),
    "uniform": lambda: radii.uniform(N, low=0.5, high=5.0, seed=1),
    # Cells are as wide as the largest disk: here all are in nine of them.
    "two giants": lambda: radii.bidisperse(400, low=0.5, high=25.0, large_fraction=0.005, seed=1),
    "a tenth large": lambda: radii.bidisperse(400, low=0.5, high=5.0, large_fraction=0.1, seed=1),
}


# Light disks between heavy ones that approach each other collide without end if they lose energy along the normal. This
# is inelastic collapse, in which no two codes agree. Where all sizes meet closely, friction alone dissipates.
ROUGH = (1.0, -0.9, 0.21, 0.0, 0.0)
GASES = {
    "dilute": ("bidisperse", 0.3, COIN),
    "dense": ("bidisperse", 0.7, COIN),
    "all sizes": ("uniform", 0.6, ROUGH),
    "a ratio of 50": ("two giants", 0.16, COIN),
    # Cells of thin gases are wide: small ones are as large as large ones.
    "thin": ("a tenth large", 0.04, COIN),
}


@cache
def expected(name: str) -> tuple[Disks, Box, State, np.ndarray, np.ndarray]:
    """A gas of one mass per area and one temperature, and pairs and times of as many collisions as it has disks."""
    sizes, packing_fraction, law = GASES[name]
    radius = SIZES[sizes]()
    n = len(radius)
    assert radius.max() / radius.min() > 9.9
    disks = Disks(n, mass=math.pi * radius**2, radius=radius)
    box = Box.from_packing_fraction(radius, packing_fraction)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=1)
    spin = placement.gaussian_spins(n, spin_rms=1.0, seed=1)
    state = State(packing.grown_positions(box, radius, seed=1), velocity, spin)
    # Long free paths multiply errors more at each collision.
    count = n if packing_fraction > 0.1 else n // 2
    _, found = simulate(disks, box, law, state, max_collisions=count)
    return (
        disks,
        box,
        state,
        np.array([sorted(each[1:]) for each in found]),
        np.array([each[0] for each in found]),
    )


@pytest.mark.full(keep=2)
@pytest.mark.parametrize("order", ["serial", "tiled"])
@pytest.mark.parametrize("name", GASES)
def test_collisions_of_very_unequal_disks_are_those_of_the_serial_code(name: str, order: str) -> None:
    disks, box, state, pairs, times = expected(name)
    engine = engine_of(disks, box, state, np.array([[GASES[name][2]]]), order=order, tile_disks=100)
    assert engine.arrays.uses.layers == (name != "all sizes")
    assert (engine.arrays.grid.coarse == 1) == (name in ("all sizes", "thin"))
    found = run(engine, len(times))  # two collisions per disk on average: many more of the large ones
    np.testing.assert_array_equal(partners(found.pair), partners(pairs))
    # Rounding of 1e-16 of a box of 100 diameters, times some 10 for each collision of a disk.
    np.testing.assert_allclose(found.time, times, rtol=0.0, atol=1e-6)
    placement.check_no_overlap(box, disks.radius, engine.state().position, tolerance=1e-11)


@pytest.mark.full
@pytest.mark.parametrize("along", [(1.0, 0.1), (-1.0, -0.1), (0.1, -1.0), (0.1, 1.0)])
def test_small_disks_that_come_far_without_collisions_meet_a_large_one(along: tuple[float, float]) -> None:
    """All disks move in one stream; a single one of them flies towards the large disk and gets near it.

    Large cells are 12 wide, and the large disk's centre lies at the near side of one: from where the small disk enters
    the cells around it to the contact there are 6.5 to fly, less than the way in a window.
    """
    corner = [24.0 + 0.05 * np.sign(each) if abs(each) == 1.0 else 30.0 for each in along]
    places = np.stack(np.meshgrid(np.arange(1.0, 47.0, 3.0), np.arange(1.0, 47.0, 3.0)), axis=-1).reshape(
        -1, 2
    )
    along_x = abs(along[0]) == 1.0
    apart = np.abs(places - corner)[:, 1 if along_x else 0] > 10.0
    first = np.array(corner) - 12.5 * np.sign(along) * ([1.0, 0.0] if along_x else [0.0, 1.0])
    position = np.concatenate([[corner, first], places[apart]])
    n = len(position)
    radius = np.r_[5.0, np.full(n - 1, 0.5)]
    velocity = np.tile(along, (n, 1))
    velocity[0] = 0.0
    disks, box = Disks(n, mass=radius**2, radius=radius), Box((48.0, 48.0))
    state = State(position, velocity, np.zeros(n))
    _, found = simulate(disks, box, COIN, state, max_collisions=3)
    engine = engine_of(disks, box, state, np.array([[COIN]]), order="serial")
    assert int(48.0 / (engine.arrays.grid.coarse * engine.arrays.scale.cell_side)) == 4
    met = run(engine, 3)
    assert [tuple(sorted(pair)) for pair in met.pair] == [tuple(sorted(one[1:])) for one in found]
    np.testing.assert_allclose(met.time, [one[0] for one in found], rtol=1e-9)
