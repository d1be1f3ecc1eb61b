"""Errors of a pressure from impulses: those of an ensemble of independent series."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem import analysis
from ifrdem.analysis.pressure import BLOCKS
from ifrdem.tools.intervals import student_t


def series(rng: np.random.Generator, T: np.ndarray) -> analysis.Pressure:
    """A gas of N T / A = T / 2 with some 1000 collisions a block, at a rate and with impulses that go as sqrt(T)."""
    count = rng.poisson(1000.0 * np.sqrt(T))
    of_block = np.repeat(np.arange(BLOCKS), count)
    time, sizes = of_block + rng.random(count.sum()), 0.02 * np.sqrt(T[of_block])
    normal = np.stack((np.cos(time), np.sin(time)), axis=1)
    impulse = np.stack((sizes, np.zeros_like(sizes)), axis=1)
    return analysis.pressure_from_impulses(
        time, normal, impulse, np.ones(len(time)), span=(0.0, float(BLOCKS)), area=10.0, disks=5, tracked=5,
        temperature=T,
    )  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("steps", [0.0, 0.4])
def test_errors_are_those_of_many_independent_series(steps: float) -> None:
    """T scatters by 0.03 from block to block, freely or with a memory of one block."""
    rng = np.random.default_rng(7)
    found = []
    for _ in range(400):
        noise = rng.normal(size=BLOCKS + 1)
        found.append(series(rng, 1.0 + 0.03 * (noise[1:] + steps * noise[:-1]) / np.hypot(1.0, steps)))
    pairs = {
        "total": "error", "kinetic": "kinetic_error", "collisional": "collisional_error", "Z": "Z_error"
    }  # fmt: skip
    scatter = {name: np.std([getattr(one, name) for one in found]) for name in pairs}
    # Not the root mean square: noise of one block's memory is not rho^|lag|, and some of 20 blocks look as if they
    # remembered more, with a larger error and a smaller n_eff. What has to hold are intervals.
    error = {name: np.median([getattr(one, each) for one in found]) for name, each in pairs.items()}
    truth = {name: np.mean([getattr(one, name) for one in found]) for name in pairs}
    for name, each in pairs.items():
        assert error[name] == pytest.approx(scatter[name], rel=0.2), name
        n_eff = [getattr(one, each.replace("error", "n_eff")) for one in found]
        off = np.abs([getattr(one, name) - truth[name] for one in found])
        share = np.mean(off < student_t(n_eff) * [getattr(one, each) for one in found])
        assert 0.91 < share < 0.99, (name, share)
    assert error["total"] > 1.2 * max(error["kinetic"], error["collisional"])


def test_the_kinetic_part_of_a_gas_that_cools_has_no_error() -> None:
    """Its change is no scatter; the error of the sum is that at the given T, of 18000 collisions some 0.75 %."""
    found = series(np.random.default_rng(2), np.linspace(1.0, 0.7, BLOCKS))
    assert np.isnan(found.kinetic_error)
    assert found.error == found.collisional_error
    assert found.error == pytest.approx(0.0075 * found.collisional, rel=0.6)


def test_rounding_of_a_constant_temperature_is_no_error() -> None:
    found = series(np.random.default_rng(2), 0.7 + 1e-15 * np.arange(BLOCKS))
    assert found.kinetic_error == 0.0
