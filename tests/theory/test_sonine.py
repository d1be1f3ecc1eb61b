"""Sonine coefficients against printed closed forms, and a Monte Carlo of the effect of a_2 on rates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.theory.sonine import (
    collision_factor,
    cooling_factor,
    cooling_sonine,
    heated_sonine,
    sonine_coefficient,
)
from ifrdem.validation.gas.sonine_series import brackets, coefficients
from ifrdem.validation.gas.sonine_series import cooling_sonine as series_sonine


@pytest.mark.parametrize("e", [0.0, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_coefficients_are_the_published_ones_in_two_dimensions(e: float) -> None:
    """van Noije and Ernst (1998), doi:10.1007/s100350050009, at d = 2."""
    published = 16.0 * (1.0 - e) * (1.0 - 2.0 * e**2)
    assert cooling_sonine(e) == pytest.approx(published / (57 - 25 * e + 30 * e**2 * (1 - e)), rel=1e-12)
    # 73 + 56 d - 24 e d - 105 e + 30 (1 - e) e^2
    assert heated_sonine(e) == pytest.approx(
        published / (73 + 112 - 48 * e - 105 * e + 30 * (1 - e) * e**2), rel=1e-12
    )


def test_elastic_disks_are_gaussian() -> None:
    assert cooling_sonine(1.0) == 0.0
    assert heated_sonine(1.0) == 0.0
    assert cooling_sonine(math.sqrt(0.5)) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(("e", "kick_energy"), [(0.9, 0.5), (0.6, 0.2)])
def test_kicks_at_random_times_add_their_fourth_moment(e: float, kick_energy: float) -> None:
    """a_2 from the fourth moment of a kick, averaged over random velocities; T_1 and T_2 as published."""
    rng = np.random.default_rng(5)
    n, squares = 4_000_000, 2.0  # T = m = 1
    v, w = (
        rng.normal(size=(2, n)),
        math.sqrt(kick_energy) * rng.normal(size=(2, n)),
    )  # m w^2 / 2 = kick_energy T
    # Terms that are odd in w are 0 on average.
    fourth = np.mean(
        2.0 * np.sum(v**2, 0) * np.sum(w**2, 0) + 4.0 * np.sum(v * w, 0) ** 2 + np.sum(w**2, 0) ** 2
    )
    gained = float(fourth) / (2.0 * kick_energy * squares)
    T_1, T_2 = 3.5 + e**2, 3.0 / 32.0 * (59.0 + 10.0 * e**2) + 1.0 / (1.0 - e)
    a_2 = (gained - T_1) / (T_2 - 3.0 / 16.0 * gained)
    assert heated_sonine(e, kick_energy) == pytest.approx(a_2, abs=0.0015)  # random numbers: 0.3 % of gained
    assert heated_sonine(e, 1e-9) == pytest.approx(heated_sonine(e), abs=1e-8)


def test_a_gaussian_sample_has_the_coefficient_that_its_size_allows() -> None:
    rng = np.random.default_rng(2)
    # 1 + a_2 = n / (n + 1) on average: for n = 4, 0.8.
    small = [sonine_coefficient(rng.normal(size=(4, 2))) for _ in range(20_000)]
    assert np.mean(small) == pytest.approx(-0.2, abs=5.0 * np.std(small) / math.sqrt(20_000))
    large = [sonine_coefficient(rng.normal(3.0, 2.0, size=(2000, 2)) - 3.0) for _ in range(300)]
    assert np.std(large) == pytest.approx(1.0 / math.sqrt(2000), rel=0.15)  # 300 samples: 4 %
    assert sonine_coefficient([[1.0, 0.0], [0.0, -1.0]]) == -0.5  # all of one speed
    assert math.isnan(sonine_coefficient(np.zeros((3, 2))))


def test_rates_of_disks_with_a_sonine_tail_are_those_of_a_monte_carlo() -> None:
    """Disks with f = Gaussian times 1 + a_2 S_2, by weights; first order in a_2 is exact but for a_2^2 terms."""
    rng = np.random.default_rng(3)
    a_2, n = 0.1, 1_000_000
    c_1, c_2 = rng.normal(0.0, math.sqrt(0.5), (2, n, 2))

    def weight(c: np.ndarray) -> np.ndarray:
        x = np.sum(c**2, axis=1)
        return 1.0 + a_2 * (0.5 * x**2 - 2.0 * x + 1.0)

    w = weight(c_1) * weight(c_2)
    speed = np.hypot(*(c_1 - c_2).T)
    for power, factor in ((1, collision_factor(a_2)), (3, cooling_factor(a_2))):
        ratio = speed**power * (w - factor)
        # The weights' noise, and what is of second order in a_2: below a_2^2 / 100.
        assert (
            abs(np.mean(ratio)) / np.mean(speed**power)
            < 3.0 * np.std(ratio) / np.mean(speed**power) / math.sqrt(n) + 0.01 * a_2**2
        )


@pytest.mark.parametrize("e_n", [-1e-9, 1.0 + 1e-9, math.nan])
def test_impossible_restitution_is_refused(e_n: float) -> None:
    with pytest.raises(InputError, match="e_n = "):
        cooling_sonine(e_n)


def test_one_polynomial_by_quadrature_is_the_first_order_of_nearly_elastic_disks() -> None:
    """With S_2 alone the series of `validate gas` solves what van Noije and Ernst do, but for a_2^2."""
    mu, moments = brackets(0.99)
    assert coefficients(mu, moments, 2)[0] == pytest.approx(cooling_sonine(0.99), rel=1e-3)
    np.testing.assert_allclose(moments[:3, 0], [1.0, 2.0, 6.0], rtol=1e-12)  # <c^2p> = p! of a Gaussian


def test_higher_order_polynomials_change_a_2_as_in_a_simulation_of_a_million_disks() -> None:
    """-0.0305(5) at e_n = 0.9 (`sonine`); to first order it would be -0.0269."""
    a_2, off = series_sonine(0.9)
    assert a_2 == pytest.approx(-0.0305, abs=0.001)
    assert off < 1e-4
