"""The theory and the estimators of `gas_shaken`, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem import theory
from ifrdem.validation.gas import shaken


def test_the_swing_of_an_oscillator_that_noise_drives_is_found() -> None:
    """x'' = -0.2 x' - x / 4 + noise: omega_0 = 1/2. Exact steps, by the matrix exponential."""
    own, damping, step, n = 0.5, 0.2, 0.5, 8000
    free = math.sqrt(own**2 - 0.25 * damping**2)
    c, s, fade = math.cos(free * step), math.sin(free * step) / free, math.exp(-0.5 * damping * step)
    move = fade * np.array([[c + 0.5 * damping * s, s], [-(own**2) * s, c - 0.5 * damping * s]])
    kick = np.random.default_rng(1).normal(0.0, 1.0, n)
    x, path = np.zeros(2), np.empty(n)
    for i in range(n):
        x = move @ x + np.array((0.0, kick[i]))
        path[i] = x[0]
    # 4000 time units are 320 periods of relative width damping / own: an error of 0.4 / 320^(1/2) = 2 %
    assert shaken.swing(step * np.arange(n), path, 0.4) == pytest.approx(own, rel=0.04)


def test_chemical_potentials_belong_to_the_pressure_of_the_mixture() -> None:
    """Gibbs and Duhem: dP/T = sum n_i dmu_i, with ln n_i the ideal part, when all densities grow alike."""
    diameter, n, step = np.array([[1.0], [2.0]]), np.array([[0.2], [0.07]]), 1e-4
    up, down = ((1.0 + sign * step) * n for sign in (1.0, -1.0))
    mu = shaken.chemical_potential(up, diameter) - shaken.chemical_potential(down, diameter)
    found = float((n * (mu + np.log(up / down))).sum())

    def pressure(density: np.ndarray) -> float:
        phi = 0.25 * math.pi * float((density * diameter**2).sum())
        parts = (density / density.sum())[:, 0]
        return float(density.sum()) * theory.compressibility(phi, [0.5, 1.0], parts)

    assert found == pytest.approx(
        pressure(up) - pressure(down), rel=1e-3
    )  # Z of another source: 1e-4 at phi = 0.4


def test_two_disks_alone_obey_the_barometric_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mean height of a point of mass m: the height at which it touches the floor, and T / (m g)."""
    monkeypatch.setattr(shaken, "COUNTS", (1e-4, 1e-4))
    y, n = shaken.densities(3.0)
    small, large = (n * y).sum(axis=1) / n.sum(axis=1)
    assert small == pytest.approx(0.5 + shaken.WARM, rel=0.02)  # strips of 0.25
    assert large == pytest.approx(1.0 + shaken.WARM / 3.0, rel=0.05)
