"""The case `gas_laws`: the fitted law, what single impacts see, and what is counted in cells."""

from __future__ import annotations

import numpy as np
import pytest

import ifrdem
from ifrdem.model.laws.walton import Walton
from ifrdem.validation.gas import laws
from ifrdem.validation.report.registry import Result


def test_angles_are_those_of_the_paper() -> None:
    """tan(delta_2) = (1 + e_t) tan(psi) / (3 (1 + e_n)) + mu, sliding (Eq. 19), or + tan(psi) / (2 (1 + e_n))."""
    law, psi = ifrdem.coins["1 pta"].law, np.array([20.0, 60.0])
    tangent = np.tan(np.radians(psi))
    slope = (1.0 + law.e_t) / (3.0 * (1.0 + law.e_n))
    expected = slope * tangent + np.array([tangent[0] / (2.0 * (1.0 + law.e_n)), law.mu])
    np.testing.assert_allclose(np.tan(np.radians(laws.angles(law, psi)[1])), expected, rtol=1e-12)


def test_walton_s_law_is_fitted_to_the_impacts() -> None:
    """Where impacts stick, P_t / (m_t |g_t|) is 1 + beta_0, and (1 + e_t) + m_n / (2 m_t) = e_t + 5/2 of IFR."""
    found = laws.fitted(ifrdem.coins["50 cts"].law)
    law, walton = found.laws
    assert isinstance(walton, Walton)
    assert walton.beta_0 == pytest.approx(law.e_t + 1.5, abs=0.01)
    assert walton.e_n == pytest.approx(law.e_n, abs=0.001)
    assert walton.mu == pytest.approx(law.mu, abs=0.01)
    assert 0.0 < found.chi_square < 1.0
    assert np.abs(found.difference[:, laws.FINE < 72.0]).max() < laws.ERROR


@pytest.mark.parametrize(("swapped", "passes"), [(False, True), (True, False)])
def test_a_gas_of_the_wrong_law_fails_the_row_of_its_spins(swapped: bool, passes: bool) -> None:
    """Ratios of a gas of the IFR law with itself are 1; the theories of both laws differ by 3 % in theta."""
    rng = np.random.default_rng(1)

    def gas(theta: float) -> laws.CoolingSeries:
        noise = 1.0 + 0.004 * rng.normal(size=(2, 10, 11))
        return laws.CoolingSeries(np.arange(11.0), noise[0], theta * noise[1], noise[0], noise[0])

    def dsmc(theta: float) -> np.ndarray:
        noise = 1.0 + 0.004 * rng.normal(size=(2, 20, len(laws.AT)))
        return np.array([noise[0], theta * noise[0] * noise[1]])

    result = Result()
    pair = [gas(0.3), gas(0.3 if swapped else 0.309)]
    laws._compare_cooling(result, range(10), pair, [dsmc(0.3), dsmc(0.309)])
    of_theta = [row for row in result.rows if row.quantity.startswith("theta")]
    assert [row.passed for row in of_theta] == [passes]
    assert all(row.passed for row in result.rows if row not in of_theta)


def test_density_and_streams_in_cells() -> None:
    """Of disks placed at random the numbers are Poisson's, and streams hold what chance gives: 0 on average."""
    rng, n = np.random.default_rng(1), 40_000
    position = rng.uniform(0.0, 60.0, (n, 2))
    still = ifrdem.State(position, rng.normal(size=(n, 2)), np.zeros(n))
    clumping, streaming = laws._in_cells(still, 60.0)
    assert clumping == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / laws.CELLS**2))
    assert streaming == pytest.approx(0.0, abs=4.0 * np.sqrt(laws.CELLS**2) / n)
    stream = np.column_stack((np.where(position[:, 1] < 30.0, 1.0, -1.0), np.zeros(n)))
    assert laws._in_cells(ifrdem.State(position, stream, np.zeros(n)), 60.0)[1] == pytest.approx(1.0)
    assert laws._in_cells(ifrdem.State(position, stream + still.velocity / np.sqrt(2.0), np.zeros(n)), 60.0)[
        1
    ] == pytest.approx(0.5, abs=0.01)
