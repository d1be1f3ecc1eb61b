"""Transport coefficients by Green-Kubo and Helfand: known series, hard disks against Enskog, what is refused."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ifrdem
from ifrdem import analysis, theory
from ifrdem.analysis import transport
from ifrdem.analysis.catalogue import FUNCTIONS
from ifrdem.analysis.displacement import Correlation
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.plots import pictures
from ifrdem.tools.intervals import student_t

CASE = """
run = { name = "gas", t_end = 205.0, units = "reduced", seed = 4 }
box = { packing_fraction = 0.2 }
material = [{ name = "m", e_n = 1.0, e_t = -1.0, mu = 0.0 }]
species = [{ name = "d", material = "m", mass = 1.0, diameter = 1.0, number = 60, speed_rms = 1.4142 }]
output = { frames_interval = 0.25, series_interval = 0.25, heat_flux = true, picture = false, views = false }
"""


def test_an_integral_is_that_of_an_exponential_and_white_noise_and_ends_at_5_decay_times() -> None:
    """C_0 = 1 + 3, C_k = rho^k: h (C_0 / 2 + sum) up to k; sum_k>=1 C_k / C_1 = 1 / (1 - rho) = 10 steps."""
    rho, k = 0.9, np.arange(101)
    value = rho**k + 3.0 * (k == 0)
    found = Correlation(0.5 * k, 2.0 * value, 0.0 * value, np.zeros((101, 101)), 2, 10, "all")
    lags, integral, error = transport.integrals(found, 3.0)
    assert lags[4] == pytest.approx(2.25)
    expected = 3.0 * 0.5 * (2.0 + rho * (1.0 - rho**k) / (1.0 - rho))
    np.testing.assert_allclose(integral, expected, rtol=1e-12)
    assert not error.any()
    # At step s the sum has come to 10 (1 - rho^s): 5 times that is reached at s = 50, where rho^s is 0.005.
    assert transport.decay_lag(value) == 50


def test_errors_of_integrals_include_the_covariance_of_lags() -> None:
    """Two lags with covariance c: var(h (C_0 / 2 + C_1)) = h^2 (c_00 / 4 + c_01 + c_11)."""
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    found = Correlation(np.array([0.0, 0.5]), np.ones(2), np.ones(2), covariance, 1, 10, "all")
    _, _, error = transport.integrals(found)
    assert error == pytest.approx([0.5 * np.sqrt(1.0), 0.5 * np.sqrt(1.0 + 1.0 + 2.0)])


def test_both_formulas_agree_at_any_spacing_of_rows_and_scale_with_the_factor() -> None:
    """Rows at uneven times are interpolated in their integral; the slope of the mean square is the integral."""
    rng = np.random.default_rng(2)
    steps = 0.1 * rng.uniform(0.999, 1.001, 8000)
    noise = (
        rng.normal(size=(8000, 2)) / np.sqrt(steps)[:, None]
    )  # white: the integral is 1 / 2 from the first row on
    time = np.concatenate(([0.0], np.cumsum(steps)))
    found = analysis.transport_coefficient(time, noise, lag=1.0)
    for one in (found.green_kubo, found.helfand):
        assert abs(one.mean - 0.5) < student_t(one.n_eff, 0.999) * one.error < 0.15
    other = analysis.transport_coefficient(time, noise, lag=1.0, factor=7.0)
    assert other.green_kubo.mean == pytest.approx(7.0 * found.green_kubo.mean, rel=1e-12)
    assert other.helfand.error == pytest.approx(7.0 * found.helfand.error, rel=1e-12)


def test_intervals_hold_the_integral() -> None:
    """AR(1), rho = 0.7, and white noise of variance 1: 1 / 2 + 1 / 2 + 0.7 / 0.3. Of 100 at 95 % fewer than 87: 1e-3."""
    from scipy.signal import lfilter

    rng, held, n = np.random.default_rng(6), [], 2000
    for _ in range(100):
        new = np.sqrt(1.0 - 0.7**2) * rng.normal(size=(n + 50, 2))
        flux = lfilter([1.0], [1.0, -0.7], new, axis=0)[50:] + rng.normal(size=(n, 2))
        found = analysis.transport_coefficient(np.arange(n + 1.0), flux)
        both = (found.green_kubo, found.helfand)
        held.append([abs(one.mean - 1.0 - 0.7 / 0.3) <= student_t(one.n_eff) * one.error for one in both])
    assert np.mean(held, axis=0).min() >= 0.87


@pytest.mark.parametrize(
    ("rows", "lag", "message"),
    [
        (400, None, "too short for a correlation"),
        (1000, 50.0, "lag = 50: 1000 rows"),
        (1000, 2.0, "lag = 2: must be 3"),
    ],
)
def test_short_runs_and_lags_are_refused(rows: int, lag: float | None, message: str) -> None:
    slow = np.cumsum(np.random.default_rng(3).normal(size=(rows, 2)), axis=0)
    with pytest.raises(InputError, match=message):
        analysis.transport_coefficient(np.arange(rows + 1.0), slow - slow.mean(axis=0), lag=lag)


@pytest.fixture(scope="module")
def gas(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A gas of 60 hard disks, 260 collisions each."""
    folder = tmp_path_factory.mktemp("transport")
    (folder / "gas.toml").write_text(CASE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["run", "gas.toml"]) == 0
    return folder / "gas.h5"


@pytest.mark.full
def test_hard_disks_have_the_coefficients_of_enskog(gas: Path) -> None:
    """eta and kappa within their intervals; D is some tenth larger, by the vortices that disks make about themselves.

    B. J. Alder and T. E. Wainwright, Phys. Rev. A 1, 18 (1970), doi:10.1103/PhysRevA.1.18: a tail in 1 / t.
    """
    with ifrdem.Trajectory(gas) as file:
        found = FUNCTIONS["transport"](file, None, lag=4.0)
        pictures.figure(file, "transport", lag=4.0).draw_without_rendering()
        T = float(file.series["temperature"][0])
    row = {each.key: each for each in found.rows}
    assert row["eta_enskog"].value == pytest.approx(theory.shear_viscosity(0.2, T, 1.0, 0.5))
    assert row["kappa_enskog"].value == pytest.approx(theory.thermal_conductivity(0.2, T, 1.0, 0.5))
    nu = theory.collision_rate(0.2, T, 1.0, 0.5)
    assert row["D_enskog"].value == pytest.approx(T / nu)
    for key in ("eta", "eta_helfand", "kappa", "kappa_helfand"):
        one, expected = row[key], row[f"{key.partition('_')[0]}_enskog"].value
        assert abs(one.value - expected) < student_t(one.n_eff, 0.999) * one.error, key
    for key in ("D", "D_helfand"):
        assert 0.95 < row[key].value / row["D_enskog"].value < 1.25
    assert row["eta"].error < 0.4 * row["eta"].value
    assert not found.warnings
    assert [row[f"{name}_lag"].value for name in ("eta", "kappa", "D")] == pytest.approx([4.0] * 3)


@pytest.mark.full
def test_gases_that_cool_flow_or_have_walls_are_refused(gas: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sheared: Any = SimpleNamespace(box=ifrdem.Box((9.0, 9.0), shear_rate=0.1))
    with pytest.raises(InputError, match="without a flow; in a sheared box `analyse stress`"):
        transport._check_gas(sheared)
    walled: Any = SimpleNamespace(box=ifrdem.Box((9.0, 9.0)), free_area=SimpleNamespace(all_walls=[1]))
    with pytest.raises(InputError, match="this one has walls"):
        transport._check_gas(walled)
    monkeypatch.setattr(transport, "is_stationary", lambda _T: False)
    with ifrdem.Trajectory(gas) as file, pytest.raises(InputError, match="not stationary: T goes from"):
        FUNCTIONS["transport"](file, None)
