"""Analyses of a frame of many disks, which are computed in blocks of these: the same numbers, in little memory."""

from __future__ import annotations

import dataclasses
import tracemalloc
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ifrdem import analysis
from ifrdem.analysis import averages, bins, common, velocities
from ifrdem.model.box import Box
from ifrdem.plots import disks

N = 1000
PLAIN, SHEARED, WALLED = (
    Box((30.0, 20.0)), Box((30.0, 20.0), shear_rate=0.4), Box((30.0, 20.0), periodic=(True, False))
)  # fmt: skip
RANDOM = np.random.default_rng(3)
PLACES = RANDOM.random((N, 2)) * (30.0, 20.0)
LUMP = np.where(np.arange(N)[:, None] < 995, 0.1 * PLACES, PLACES)  # the six nearest of some are far away
MOTION, SPINS, MASS = RANDOM.standard_t(9, (N, 2)), RANDOM.normal(size=N), RANDOM.uniform(1.0, 2.0, N)


GAS: Any = SimpleNamespace(disks=SimpleNamespace(radius=0.1 * MASS))


def sums_in_strips() -> Any:
    """Sums of `averages` over a frame, which is as those of a file."""
    strips = bins.Strips(PLAIN, ("y",), (np.linspace(0.0, 20.0, 9),))
    these = type("", (), {"n": N, "mass": MASS, "inertia": MASS, "radius": np.full(N, 0.4)})()
    these.movable = np.arange(N) % 7 > 0
    trajectory = type("", (), {"disks": these, "box": PLAIN, "fields": ("angular_velocity",)})()
    frame: Any = type("", (), {"trajectory": trajectory, "time": 0.0, "position": PLACES, "spin": SPINS})()
    frame.peculiar_velocity = MOTION
    return averages._sums_of_frame(frame, strips, np.arange(N) % 2, 2, averages._mean_velocity(frame))


@pytest.mark.parametrize(
    "found",
    [
        lambda: analysis.velocity_distribution(MOTION, SPINS, mass=MASS).sonine,
        lambda: analysis.velocity_distribution([MOTION, 1.1 * MOTION], [SPINS, SPINS], mass=MASS).density_error,
        lambda: analysis.coarse_grain(PLACES, MOTION, SPINS, box=PLAIN, cells=(5, 4), mass=MASS).temperature,
        lambda: analysis.coarse_grain(PLACES, MOTION, box=PLAIN, cells=(9, 6), mass=MASS, width=3.0).velocity,
        lambda: analysis.structure_factor(PLACES, SHEARED, k_max=3.0, rings=5, time=1.3).S,
        lambda: analysis.pair_correlation(PLACES, WALLED, r_max=2.0, bins=7).pairs,
        lambda: analysis.pair_correlation(PLACES, SHEARED, r_max=9.0, bins=7, time=2.1).pairs,
        lambda: analysis.clusters(PLACES, PLAIN, radius=0.1 + 0.2 * MASS, gap=0.1).radius_of_gyration,
        lambda: analysis.clusters(PLACES, SHEARED, radius=0.1, gap=0.1, time=2.1).label,
        lambda: analysis.clusters(PLACES, WALLED, radius=0.3, gap=0.1).sizes,
        lambda: abs(analysis.hexatic(PLACES, SHEARED, time=2.1).psi6),
        lambda: abs(analysis.hexatic(PLACES, WALLED).psi6),
        lambda: abs(analysis.hexatic(LUMP, PLAIN).psi6),
        lambda: disks.area_fraction(GAS, PLACES, np.array([[0.0, 30.0], [1.0, 19.0]])),
        sums_in_strips,
    ],
)  # fmt: skip
def test_results_do_not_depend_on_the_blocks(
    found: Callable[[], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for rounding; S(k) is computed to 1e-9. A block that is left out or counted twice changes all of them."""

    def numbers() -> np.ndarray:
        value = found()
        return np.array(dataclasses.astuple(value) if dataclasses.is_dataclass(value) else value, dtype=float)

    whole = numbers()
    monkeypatch.setattr(common, "AT_ONCE", 170)
    monkeypatch.setattr(velocities, "AT_ONCE", 170)
    np.testing.assert_allclose(numbers(), whole, rtol=1e-7, atol=1e-9)


@pytest.mark.full(keep=3)
@pytest.mark.parametrize("r_max", [1.0, 4.0, 9.5])
@pytest.mark.parametrize("box", [PLAIN, SHEARED, WALLED])
def test_pairs_are_found_from_row_to_row_of_cells(box: Box, r_max: float) -> None:
    """Those of all disks at once (`common.neighbours`), each once; also across rows that reach around the box.

    Of the farthest one may differ, which are found in single precision.
    """
    found = analysis.pair_correlation(PLACES, box, r_max=r_max, bins=1, time=2.1)
    i, j, _ = common.neighbours(PLACES, box, r_max, 2.1)
    counts = np.full(N, box.periodic[1]) | (np.abs(PLACES[:, 1] - 10.0) < 10.0 - r_max)
    pairs = 0.5 * (np.count_nonzero(counts[i]) + np.count_nonzero(counts[j]))
    assert found.pairs.sum() == pytest.approx(pairs, abs=2.0)


def test_a_distribution_of_one_frame_keeps_nothing_of_each_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Less than 10 bytes of each; eleven sums of each were 88. Bins of some disks are kept, fewer here."""
    n = 400_000
    v, w, one = RANDOM.normal(size=(n, 2)), RANDOM.normal(size=n), np.broadcast_to(1.0, n)
    monkeypatch.setattr(velocities, "MOST_COUNTS", 10_000)
    monkeypatch.setattr(velocities, "AT_ONCE", 2000)
    analysis.velocity_distribution(v[:4000], w[:4000])  # imports what it needs
    tracemalloc.start()
    try:
        analysis.velocity_distribution(v, w, mass=one, inertia=one)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 10.0 * n
