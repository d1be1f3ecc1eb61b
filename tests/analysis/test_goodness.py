"""Fits to a cooling gas say whether their law holds: systematic residuals differ from noise and scatter."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem import IFRLaw, analysis, theory
from ifrdem.analysis import cooling


def noise(seed: int, n: int, memory: float) -> np.ndarray:
    """Gaussian noise of variance 1 with correlation memory^|lag|."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=n)
    for i in range(1, n):
        x[i] = memory * x[i - 1] + np.sqrt(1.0 - memory**2) * x[i]
    return x


def haff(t: np.ndarray, t_H: float = 5.0) -> np.ndarray:
    return 3.0 / (1.0 + t / t_H) ** 2


@pytest.mark.full(keep=("60-0.4",))
@pytest.mark.parametrize(("points", "memory"), [(400, 0.0), (400, 0.8), (60, 0.0), (60, 0.4)])
def test_noise_about_a_law_is_no_misfit(points: int, memory: float) -> None:
    """Of 120 series 0.1 have a probability below 1e-3 by chance; the test is about: some have it up to 1e-2."""
    t = np.linspace(0.0, 40.0, points)
    found = [
        analysis.haff_fit(t, haff(t) * np.exp(0.02 * noise(seed, points, memory))) for seed in range(120)
    ]
    assert sum(not one.describes for one in found) <= 3
    assert all(np.isfinite(one.t_H_error) for one in found if one.describes)


def test_sums_over_correlated_noise_are_those_of_its_matrix() -> None:
    """R_ij = rho^|i - j|, and M = (1 - B B') R (1 - B B') for noise off which the modes B are taken, written out."""
    n, rho, rng = 40, 0.6, np.random.default_rng(1)
    modes = np.linalg.qr(rng.normal(size=(n, 4)))[0]
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    np.testing.assert_allclose(cooling.correlated(modes, rho), rho**lag @ modes, rtol=1e-12, atol=1e-14)
    project = np.eye(n) - modes @ modes.T
    rest = project @ noise(3, n, rho)
    found, kept = cooling._autoregression(rest, modes)
    M = project @ found**lag @ project
    assert kept == pytest.approx(np.trace(M), rel=1e-12)
    # rho is found to 1e-6, and the ratio changes by about as much.
    assert np.trace(M, 1) / np.trace(M) == pytest.approx(rest[:-1] @ rest[1:] / (rest @ rest), abs=2e-6)


def test_a_gas_that_leaves_haffs_law_is_reported_and_gets_no_errors() -> None:
    """T ~ t^-2 that becomes t^-1 late, as in clusters, with noise of a tenth of the difference."""
    t = np.linspace(0.0, 400.0, 300)
    T = haff(t) * (1.0 + t / 80.0)
    found = analysis.haff_fit(t, T * np.exp(0.02 * noise(1, 300, 0.5)))
    assert not found.describes
    assert found.p_value < 1e-6
    assert np.isnan([found.T0_error, found.t_H_error]).all()
    assert 0.1 < found.misfit <= found.rms
    # Its misfit is what is left of exact numbers, to the noise.
    assert found.misfit == pytest.approx(analysis.haff_fit(t, T).rms, rel=0.05)
    early = analysis.haff_fit(t, T * np.exp(0.02 * noise(1, 300, 0.5)), last=8.0)
    assert early.describes


def test_rough_disks_without_initial_spins_have_no_haff_law_before_theta_is_steady() -> None:
    """By kinetic theory: while spins are excited, T falls by more than its t_H at constant theta says."""
    law = IFRLaw(e_n=0.9, e_t=-0.5, mu=0.5)
    t = np.linspace(0.0, 200.0, 400)
    T, T_rot, count = theory.cooling(law, 1.0, 0.5, 2.0, 0.2, 1.0, 0.0, t)
    whole = analysis.haff_fit(t, T * np.exp(0.001 * noise(2, 400, 0.3)), disks=100_000)
    assert not whole.describes
    late = t[np.searchsorted(count, 40.0)]
    assert analysis.haff_fit(t, T * np.exp(0.001 * noise(2, 400, 0.3)), first=late, disks=100_000).describes
    # The same gas of few disks scatters by more than its theory leaves the law.
    assert analysis.haff_fit(t, T * np.exp(0.001 * noise(2, 400, 0.3)), disks=20).describes
    assert np.all(T_rot[1:] > 0.0)


def collisions_of_a_gas(seed: int, n: int, e_n: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and temperatures of smooth disks that meet at random (direct simulation Monte Carlo of Boltzmann's gas).

    In a step each disk has one random partner and normal, and collides with a probability that goes as the normal
    velocity, some 0.05 in the mean: the time of a step shrinks as speeds do.
    """
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(n, 2))
    v -= v.mean(axis=0)
    v /= np.sqrt(np.mean(v**2))
    time, T, now = [0.0], [1.0], 0.0
    for _ in range(steps):
        pairs = rng.permutation(n).reshape(2, n // 2)
        angle = rng.random(n // 2) * 2.0 * np.pi
        normal = np.stack((np.cos(angle), np.sin(angle)), axis=1)
        g = np.sum((v[pairs[0]] - v[pairs[1]]) * normal, axis=1)
        dt = 0.1 / np.sqrt(T[-1])
        hit = rng.random(n // 2) < dt * np.maximum(g, 0.0)
        kick = np.where(hit, 0.5 * (1.0 + e_n) * g, 0.0)[:, None] * normal
        v[pairs[0]] -= kick
        v[pairs[1]] += kick
        now += dt
        time.append(now)
        T.append(float(np.mean(v**2)))
    return np.array(time)[::10], np.array(T)[::10]


@pytest.mark.full
def test_the_slow_scatter_of_few_disks_that_cool_by_haffs_law_is_no_misfit() -> None:
    """300 disks by Monte Carlo: T scatters slowly by 1 / sqrt(n), which noise of short memory does not explain."""
    found = [analysis.haff_fit(*collisions_of_a_gas(seed, 300, 0.8, 2000), disks=300) for seed in range(12)]
    assert all(one.describes for one in found)
    misfits = np.array([one.misfit for one in found])
    assert np.sqrt(np.mean(misfits**2)) < 1.0 / np.sqrt(300.0)


def test_two_lags_of_the_ratio_of_temperatures_are_distinguished_from_one() -> None:
    x = np.linspace(0.0, 40.0, 200)
    one = 0.9 - 0.8 * np.exp(-x / 3.0)
    two = 0.9 - 0.4 * np.exp(-x / 1.5) - 0.4 * np.exp(-x / 12.0)
    scattered = [analysis.ratio_fit(x, exact + 0.005 * noise(3, 200, 0.5)) for exact in (one, two)]
    assert scattered[0].describes
    assert np.isfinite(scattered[0].lag_error)
    assert not scattered[1].describes
    assert np.isnan([scattered[1].theta_0_error, scattered[1].theta_end_error, scattered[1].lag_error]).all()
    # Of 100 disks theta scatters by 0.9 sqrt(3 / 100) = 0.16, more than the two differ.
    assert analysis.ratio_fit(x, two + 0.005 * noise(3, 200, 0.5), disks=100).describes


def test_too_few_points_show_no_misfit() -> None:
    t = np.linspace(0.0, 20.0, 4)
    found = analysis.haff_fit(t, haff(t) * (1.0 + 0.3 * np.sin(t)))
    assert found.describes
    assert np.isnan(found.p_value)
    # but for those of very many disks, which scatter by a fifth of a thousandth
    assert not analysis.haff_fit(t, haff(t) * (1.0 + 0.3 * np.sin(t)), disks=20_000_000).describes
