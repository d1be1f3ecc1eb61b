"""The engine's guarantee at length: a million collisions compared with the serial code, and the errors without it."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from support.gases import COIN, ELASTIC, equal_disks, equilibrated, mixture, partners, run, run_to
from support.serial_reference import simulate

from ifrdem import Device
from ifrdem.initial import placement
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.simulation import backend
from ifrdem.validation.rows import engine_of

pytestmark = [pytest.mark.full, pytest.mark.optimised]

N = 4000
LAWS = {"elastic": ELASTIC, "coin": COIN}
MAKERS = {"equal": equal_disks, "mixture": mixture}
# Rounding grows with each collision of a disk, most in dilute gases and mixtures: after so many, sequences still agree.
GASES = [
    (phi, disks, law)
    for disks, densities in (
        ("equal", (0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.7, 0.72)),
        ("mixture", (0.05, 0.3, 0.5)),
    )
    for phi in densities
    for law in LAWS
]
WAYS = {
    "serial": {"order": "serial"},
    "tiled": {"order": "tiled", "tile_disks": 250},
    "larger tiles": {"order": "tiled", "tile_disks": 1000},
}
# Gases are prepared on all cores: the same number first, because changing it restarts Taichi.
THREADS = [t for t in (2, 1) if t <= backend.cores()]


def n_compared(phi: float, kind: str) -> int:
    return int((2.0 if kind == "mixture" else 3.0 if phi < 0.08 else 4.0 if phi < 0.15 else 4.8) * N / 2)


@cache
def expected(phi: float, kind: str, law: str) -> tuple[Disks, Box, State, np.ndarray, np.ndarray]:
    """A gas, and the pairs and times of its first collisions by the serial code."""
    disks = MAKERS[kind](N)
    box, state = equilibrated(disks, phi)
    _, found = simulate(disks, box, LAWS[law], state, max_collisions=n_compared(phi, kind))
    assert len(found) == n_compared(phi, kind)
    return disks, box, state, np.array([sorted(c[1:]) for c in found]), np.array([c[0] for c in found])


@pytest.mark.parametrize(("phi", "kind", "law"), GASES)
@pytest.mark.parametrize("threads", THREADS)
def test_every_way_of_running_gives_the_serial_sequence(
    phi: float, kind: str, law: str, threads: int
) -> None:
    disks, box, state, pairs, times = expected(phi, kind, law)
    for way, options in WAYS.items():
        engine = engine_of(
            disks, box, state, np.array([[LAWS[law]]]), device=Device(threads=threads), **options
        )  # type: ignore[arg-type]
        found = run(engine, len(pairs))
        np.testing.assert_array_equal(partners(found.pair), partners(pairs), err_msg=way)
        np.testing.assert_allclose(found.time, times, rtol=0.0, atol=3e-6, err_msg=way)


def test_more_than_a_million_collisions_are_compared() -> None:
    """By the test above, which compares all of a gas's collisions, in every way, on two threads and on one."""
    assert sum(n_compared(phi, kind) for phi, kind, _ in GASES) * len(WAYS) * 2 > 1_000_000


@pytest.mark.parametrize(("phi", "law", "order"), [(0.6, "elastic", "serial"), (0.7, "elastic", "tiled")])
def test_no_disks_overlap_in_ten_million_collisions(phi: float, law: str, order: str) -> None:
    """Two runs of five million; contact may be short of the contact distance by the rounding of two positions."""
    disks = equal_disks(10_000)
    box, state = equilibrated(disks, phi)
    engine = engine_of(disks, box, state, np.array([[LAWS[law]]]), order=order)
    for frame in range(1, 11):
        state = run_to(engine, collisions=frame * 500_000)
        placement.check_no_overlap(box, disks.radius, state.position, tolerance=1e-11)
    assert engine.collisions == 5_000_000


@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_a_run_repeats_to_the_last_bit(order: str) -> None:
    disks = mixture(3000)
    box, state = equilibrated(disks, 0.4)
    ends = []
    for _ in range(2):
        engine = engine_of(disks, box, state, np.array([[COIN]]), order=order, tile_disks=300)
        ends.append(run_to(engine, collisions=30_000))
    for name in ("position", "velocity", "spin", "collisions", "image", "time"):
        np.testing.assert_array_equal(getattr(ends[0], name), getattr(ends[1], name))


def test_single_precision_keeps_energy_and_contacts_to_its_rounding() -> None:
    """A hundred elastic collisions a disk: each changes v^2 by some 1e-7 of itself, at random; 1e-7 * 10 for each disk.

    Positions are multiples of q = 2^-16: 24 bits hold twice the side of the box, 102 diameters, or four times that of
    one of 2 x 2 tiles. Either disk is placed up to q/2 off along x and y at a contact, and at the end of a window once
    more: overlaps of up to 2 sqrt(2) q; and delays of a few diameters are rounded by 1e-7 of themselves.
    """
    disks = equal_disks(4000)
    box, state = equilibrated(disks, 0.3)
    options: dict[str, dict[str, Any]] = {
        order: {"order": order, "tile_disks": 1000} for order in ("serial", "tiled")
    }
    double = {
        order: engine_of(disks, box, state, np.array([[ELASTIC]]), **given).bytes_allocated
        for order, given in options.items()
    }
    for order, given in options.items():
        engine = engine_of(disks, box, state, np.array([[ELASTIC]]), device=Device(precision="f32"), **given)
        assert (
            engine.bytes_allocated < 0.9 * double[order]
        )  # the scratch space of so few disks is half of all
        end = run_to(engine, collisions=200_000)
        before, after = (float(np.sum(s.velocity.astype(np.float64) ** 2)) for s in (state, end))
        assert after == pytest.approx(before, rel=2e-5)
        assert after != before  # it was single precision
        tolerance = 2.0 * math.sqrt(2.0) * 2.0**-16 + 1e-6
        assert engine.arrays.spacing == 2.0**-16
        placement.check_no_overlap(box, disks.radius, end.position, tolerance=tolerance)
