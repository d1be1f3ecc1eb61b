"""Tails of distributions of speeds: fits of known densities, with intervals that hold, and counts to the end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from ifrdem import analysis
from ifrdem.analysis import tails
from ifrdem.errors import InputError
from ifrdem.tools.intervals import student_t


def stretched(rng: np.random.Generator, nu: float, *shape: int) -> np.ndarray:
    """Velocities with the density exp(-r^nu) in the plane: r^nu has a gamma distribution with 2 / nu."""
    r = rng.gamma(2.0 / nu, size=shape) ** (1.0 / nu)
    angle = rng.uniform(0.0, 2.0 * np.pi, shape)
    return np.stack((r * np.cos(angle), r * np.sin(angle)), axis=-1)


@pytest.mark.parametrize(("A", "nu", "first"), [(1.0, 2.0, 2.0), (2.5, 1.0, 1.5), (1.8, 1.5, 3.0)])
def test_the_integral_of_the_density(A: float, nu: float, first: float) -> None:
    expected = quad(lambda c: c * np.exp(-A * c**nu), first, np.inf, epsabs=0.0)[0]
    assert np.exp(tails._log_integral(A, nu, first)) == pytest.approx(expected, rel=1e-6)
    # Where the incomplete gamma function is 0 in double precision: its first term, x^(a - 1) exp(-x).
    assert tails._log_integral(400.0, 2.0, 2.0) == pytest.approx(-1600.0 - np.log(800.0), rel=1e-6)


@pytest.mark.full(keep=("2.0",))
@pytest.mark.parametrize("nu", [1.0, 1.5, 2.0])
def test_intervals_of_the_fit_hold_the_exponent(nu: float) -> None:
    """c = r / <r^2>^(1/2), so A = <r^2>^(nu / 2) with <r^2> = Gamma(4 / nu) / Gamma(2 / nu); 6 tries at 99.9 %."""
    from scipy.special import gamma

    rng = np.random.default_rng(7)
    for _ in range(2):
        found = analysis.speed_tail(stretched(rng, nu, 20_000))
        beyond = student_t(found.nu.n_eff, 0.999)
        assert abs(found.nu.mean - nu) < beyond * found.nu.error < 4.0
        A = (gamma(4.0 / nu) / gamma(2.0 / nu)) ** (0.5 * nu)
        assert abs(found.A.mean - A) < beyond * found.A.error


@pytest.mark.full
def test_frames_of_the_same_disks_do_not_make_errors_smaller() -> None:
    """Speeds that do not change from frame to frame are known as well from one frame as from four."""
    v = np.random.default_rng(8).normal(size=(20_000, 2))
    one, four = analysis.speed_tail([v]), analysis.speed_tail([v] * 4)
    assert four.beyond == 4 * one.beyond
    assert four.nu == pytest.approx(one.nu, rel=1e-3)
    np.testing.assert_allclose(four.density_error, one.density_error, rtol=0.1)
    other = [np.random.default_rng(k).normal(size=(20_000, 2)) for k in range(4)]
    for found, expected in (
        (four, 2.0),
        (analysis.speed_tail(other), 1.0),
    ):  # of independent counts c: 1 / c^(1/2)
        relative = found.density_error[:30] / found.density[:30] * np.sqrt(found.counts[:30])
        assert np.median(relative) == pytest.approx(expected, rel=0.15)


def test_all_speeds_are_counted_and_the_density_is_normalised() -> None:
    v = np.random.default_rng(9).normal(size=(5_000, 2)) * [1.0, 1.0] + [3.0, -1.0]
    found = analysis.speed_tail(v, first=1.5, bins=30)
    assert found.counts.sum() == 5_000
    assert found.counts[-1] >= 1
    assert np.sum(found.density * np.pi * np.diff(found.edges**2)) == pytest.approx(1.0)
    assert np.all(found.density_error > 0.0)
    # The fit has as many speeds beyond c_1 as were counted.
    share = quad(lambda c: 2.0 * np.pi * c * float(found.fitted(np.array(c))), 1.5, 20.0)[0]
    assert share == pytest.approx(found.beyond / 5_000, rel=1e-4)
    with pytest.raises(InputError, match="speeds are beyond first = 2: must be 200 or more"):
        analysis.speed_tail(v[:100])
