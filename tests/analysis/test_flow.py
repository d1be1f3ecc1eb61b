"""Velocity correlations and spectra of fields whose answers are known, and sixth-order Sonine coefficients."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.special import j0, j1, jn

import ifrdem
from ifrdem import analysis
from ifrdem.analysis import vortices

BOX = (60.0, 60.0)


def shear_wave(n: int, seed: int, waves: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Points, each at random in a cell of a square grid, with velocities (sin k y, 0) of a number of waves along y."""
    side, k = round(n**0.5), 2.0 * np.pi * waves / 60.0
    cell = np.argwhere(np.ones((side, side)))
    x = (cell + np.random.default_rng(seed).random((n, 2))) * (60.0 / side)
    return x, np.stack((np.sin(k * x[:, 1]), np.zeros(n)), axis=1), k


def test_correlation_of_a_shear_wave_is_that_of_bessel_functions() -> None:
    """<sin k y sin k (y + r sin a)> = cos(k r sin a) / 2; times cos^2 a along r, sin^2 a across it, over all angles a.

    With <cos(z sin a)> = J_0, <cos(z sin a) cos 2a> = J_2, and <v^2> / 2 = 1/4: J_0 + J_2 = 2 J_1(z) / z along r, and
    J_0 - J_2 = 2 J_1'(z) across it, which is 0 first at z = 1.8412.
    """
    x, v, k = shear_wave(4096, 1, 3)
    found = analysis.velocity_correlation(x, v, BOX, r_max=24.0, bins=48)
    z = k * found.r
    far = found.r > 1.0
    assert found.along[far] == pytest.approx((2.0 * j1(z) / z)[far], abs=0.06)
    assert found.across[far] == pytest.approx((j0(z) - jn(2, z))[far], abs=0.06)
    assert found.length == pytest.approx(1.8412 / k, rel=0.05)


def test_spectrum_of_a_shear_wave_has_one_line() -> None:
    """|v_k|^2 = n^2 / 4 at +-k e_y, over n / 4: n. All of it is across k; on a lattice all other modes are 0."""
    side = (np.arange(40) + 0.5) * 1.5
    x = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    k = 2.0 * np.pi * 5 / 60.0
    v = np.stack((np.sin(k * x[:, 1]), np.zeros(1600)), axis=1)
    found = analysis.velocity_spectrum(x, v, BOX, k_max=2.0 * np.pi * 10.5 / 60.0, rings=10)
    ring = int(np.argmax(found.across))
    assert found.k[ring] == pytest.approx(k, rel=0.1)
    assert found.across[ring] * found.modes[ring] == pytest.approx(1600.0, rel=1e-6)
    rest = np.delete(found.across, ring)
    assert np.all(rest < 1e-6)
    assert np.all(found.along < 1e-6)
    assert found.vorticity[ring] == pytest.approx(found.k[ring] ** 2 * found.across[ring])


def test_longitudinal_wave_is_along_k() -> None:
    side = (np.arange(40) + 0.5) * 1.5
    x = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    v = np.stack((np.sin(2.0 * np.pi * 5 / 60.0 * x[:, 0]), np.zeros(1600)), axis=1)
    found = analysis.velocity_spectrum(x, v, BOX, k_max=2.0 * np.pi * 10.5 / 60.0, rings=10)
    assert np.all(found.across < 1e-6)
    assert found.along.max() * found.modes[np.argmax(found.along)] == pytest.approx(1600.0, rel=1e-6)


@pytest.mark.full
def test_ideal_gas_has_neither_correlation_nor_line() -> None:
    """0 at all r within the errors, which are those that 36 bins show, and 1 at all k."""
    rng = np.random.default_rng(3)
    frames = [
        (60.0 * rng.random((3000, 2)), rng.normal(size=(3000, 2)) + np.array([5.0, 0.0])) for _ in range(3)
    ]
    x, v = ([frame[i] for frame in frames] for i in (0, 1))
    found = analysis.velocity_correlation(x, v, BOX, r_max=30.0, bins=36)
    for value, error in ((found.along, found.along_error), (found.across, found.across_error)):
        assert np.all(np.abs(value[3:]) < 5.0 * error[3:])
        assert np.all(error[3:] < 0.05)
    assert np.isnan(found.length)
    spectrum = analysis.velocity_spectrum(x, v, BOX, k_max=2.0, rings=18)
    for value, error in (
        (spectrum.across, spectrum.across_error),
        (spectrum.along, spectrum.along_error),
    ):
        assert np.all(np.abs(value - 1.0) < 5.0 * error)
        assert error[-1] < 0.15


def test_correlations_through_periodic_sides_and_of_equal_velocities() -> None:
    """Two halves with velocities +1 and -1 along x: C = 1 of near disks of one half; a pair through a side counts."""
    x = np.array([[0.5, 5.0], [9.5, 5.0], [5.0, 2.0], [5.0, 8.0]])
    v = np.array([[1.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [-1.0, 0.0]])
    found = analysis.velocity_correlation(x, v, (10.0, 10.0), r_max=2.0, bins=2)
    assert found.pairs.tolist() == [0.0, 2.0]  # from both ends
    assert found.along[1] == pytest.approx(2.0)  # v^2 over <v^2> / 2
    assert found.across[1] == pytest.approx(0.0)


@pytest.mark.parametrize(("r_max", "message"), [(40.0, "r_max = 40: must be at most half")])
def test_refusals(r_max: float, message: str) -> None:
    x, v, _ = shear_wave(9, 1, 1)
    with pytest.raises(ifrdem.InputError, match=message):
        analysis.velocity_correlation(x, v, BOX, r_max=r_max)
    with pytest.raises(ifrdem.InputError, match="must differ between disks"):
        analysis.velocity_correlation(x, np.ones_like(v), BOX, r_max=5.0)


def test_files_have_lengths_against_collisions_per_disk(tmp_path: Path) -> None:
    """Waves whose number falls from 6 to 2: sizes of vortices and wavelengths grow as theirs."""
    disks, box = ifrdem.Disks(2916, mass=1.0, radius=0.1), ifrdem.Box(BOX)
    with ifrdem.TrajectoryWriter(tmp_path / "w.h5", disks, box, precision="f64") as file:
        for i, waves in enumerate((6, 3, 2)):
            x, v, _ = shear_wave(2916, i, waves)
            file.write(ifrdem.State(x, v, np.zeros(2916), time=float(i)), {"collisions": 1458 * i})
    with ifrdem.Trajectory(tmp_path / "w.h5") as run:
        spectrum = vortices.of_spectrum(run, [0, 1, 2]).tables["frames"]
        correlation = vortices.of_correlation(run, [0, 1, 2]).tables["frames"]
    # The mean k of a ring, 2 pi / 60 wide, of which the wave is one mode.
    np.testing.assert_allclose(spectrum["wavelength"], [10.0, 20.0, 30.0], rtol=0.2)
    np.testing.assert_array_equal(spectrum["collisions_per_disk"], [0.0, 1.0, 2.0])
    np.testing.assert_allclose(
        correlation["length"], 1.8412 * np.array([10.0, 20.0, 30.0]) / (2.0 * np.pi), rtol=0.1
    )


def test_sixth_order_coefficients_of_a_mixture_of_two_temperatures_are_exact() -> None:
    """Half of the disks with T = 1 + d, half with 1 - d, and T_rot alike: moments of x, y' (mean 1) follow.

    <x^3> = 6 <s^3>, s = 1 +- d, so a30 = 1 + 3 d^2 - (1 + 3 d^2) = 0; <y'^3> = 15 <s^3>, <x^2 y'> = 2 <s^3> and
    <x y'^2> = 3 <s^3> give 0 too.
    """
    rng, n, d = np.random.default_rng(5), 400_000, 0.4
    scale = np.sqrt(np.where(np.arange(n) % 2 == 0, 1.0 + d, 1.0 - d))
    v, omega = rng.normal(size=(n, 2)) * scale[:, None], rng.normal(size=n) * scale
    found = analysis.velocity_distribution(v, omega).sonine
    for name in ("a30", "a03", "a21", "a12"):
        assert abs(getattr(found, name)) < 4.0 * getattr(found, f"{name}_error")
        assert getattr(found, f"{name}_error") < 0.03


def test_sixth_order_coefficient_of_a_sampled_expansion() -> None:
    """x = c^2 drawn from exp(-x) [1 + a3 L_3(x)], L_3 = 1 - 3x + 3x^2/2 - x^3/6, by rejection: a30 = a3, a20 = 0."""
    rng, a3 = np.random.default_rng(6), -0.05
    x = rng.exponential(size=4_000_000)
    weight = 1.0 + a3 * (1.0 - 3.0 * x + 1.5 * x**2 - x**3 / 6.0)
    kept = x[(rng.random(len(x)) * 12.0 < weight) & (x < 14.0)]  # beyond, 1e-6 of all
    angle = 2.0 * np.pi * rng.random(len(kept))
    v = np.sqrt(kept)[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    found = analysis.velocity_distribution(v, rng.normal(size=len(v))).sonine
    assert found.a30 == pytest.approx(a3, abs=4.0 * found.a30_error)
    assert found.a30_error < 0.01
    assert abs(found.a20) < 4.0 * found.a20_error


def test_errors_of_sixth_order_and_the_tail_are_those_of_a_gaussian_gas() -> None:
    """Over 60 gases of 2000 disks the scatter is what the error says; disks beyond |c| = 2 are exp(-4) of all."""
    rng = np.random.default_rng(9)
    found = [
        analysis.velocity_distribution(rng.normal(size=(2000, 2)), rng.normal(size=2000)) for _ in range(60)
    ]
    for name in ("a30", "a03", "a21", "a12"):
        values = np.array([getattr(one.sonine, name) for one in found])
        errors = np.array([getattr(one.sonine, f"{name}_error") for one in found])
        assert np.std(values) == pytest.approx(np.mean(errors), rel=0.5)
    ratio, error = np.array([one.tail[2.0][:2] for one in found]).T
    assert ratio.mean() == pytest.approx(1.0, abs=4.0 * error.mean() / 60**0.5)
    assert np.std(ratio) == pytest.approx(error.mean(), rel=0.35)
