"""Intervals of analyses hold the truth as often as they say, and marks are as rare: synthetic data of known truth.

Every standard error and every "!" that `ifrdem analyse` prints has a line here. A 95 % interval is value +- Student's t
times the error, with n_eff - 1 degrees of freedom, or has ends of its own. Of 300 trials at 95 % fewer than 91 % hold
once in 1000 times; an error that is halved gives 68 %. The manual has the shares of more trials (errors.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ifrdem import Box, Disks, State, Trajectory, TrajectoryWriter, analysis
from ifrdem.analysis import catalogue, common, steadiness
from ifrdem.analysis.result import Evaluation, Reading
from ifrdem.tools.intervals import of_count, of_intensity, of_share, student_t

Array = NDArray[Any]


def correlated(rng: np.random.Generator, n: int, rho: float, *shape: int) -> Array:
    """Gaussian noise (n, ...) of variance 1 and correlation rho^|lag| along the first axis."""
    new = rng.normal(size=(n, *shape))
    new[1:] *= np.sqrt(1.0 - rho**2)
    from scipy.signal import lfilter  # a second to import, and only this file does

    return np.asarray(lfilter([1.0], [1.0, -rho], new, axis=0))


def holds(value: Any, error: Any, n_eff: Any, truth: float) -> Array:
    """For each interval by Student's t, whether it contains the truth."""
    return np.asarray(np.abs(np.asarray(value) - truth) <= student_t(n_eff) * np.asarray(error))


def within(ends: tuple[Any, Any], truth: float) -> Array:
    return np.asarray((np.asarray(ends[0]) <= truth) & (truth <= np.asarray(ends[1])))


# -- means of series ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rho", "n"),
    [
        (0.0, 20),
        (0.5, 20),
        (0.8, 50),
        (0.9, 100),
        (0.95, 400),
        (0.0, 40),
        (0.0, 400),
        (0.5, 400),
        (0.99, 2000),
    ],
)
def test_means_of_correlated_series(rho: float, n: int) -> None:
    """By the autocorrelation about the sample's own mean alone, 1.96 errors hold in 79, 60, 32 % of 20 rows."""
    x = correlated(np.random.default_rng(1), n, rho, 1000)
    error, n_eff = common.mean_errors(x)
    share = holds(x.mean(axis=0), error, n_eff, 0.0).mean()
    assert 0.91 <= share <= 0.985
    # Tight too: the error is that of the series, 1 / sqrt(n) times the root of (1 + rho) / (1 - rho), in the middle.
    exact = x.mean(axis=0).std()
    assert 0.85 < np.median(error) / exact < 1.25


def test_a_slow_part_below_fast_noise_is_found_in_blocks() -> None:
    """A quarter of the variance lives for a twentieth of the series: by successive rows alone 66 % hold."""
    rng, n = np.random.default_rng(2), 400
    x = correlated(rng, n, 0.0, 1000) + 0.5 * correlated(rng, n, 1.0 - 10.0 / n, 1000)
    assert holds(x.mean(axis=0), *common.mean_errors(x), 0.0).mean() > 0.88


def test_errors_of_means_scale_shift_and_reverse_with_the_series() -> None:
    x = correlated(np.random.default_rng(3), 73, 0.7, 5)
    error, n_eff = common.mean_errors(x)
    for other, factor in ((-3.0 * x + 7.0, 3.0), (x[::-1], 1.0)):
        changed = common.mean_errors(other)
        np.testing.assert_allclose(changed.error, factor * error, rtol=1e-9)
        np.testing.assert_allclose(changed.effective, n_eff, rtol=1e-9)
    constant = common.mean_errors(np.full((50, 2), 0.1))
    np.testing.assert_array_equal(constant.error, 0.0)
    np.testing.assert_allclose(constant.effective, 50.0)
    assert np.isnan(common.mean_errors(np.ones((1, 2)))).all()
    assert np.isnan(common.mean_errors(np.full(30, np.nan)).error)


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_mean_stress(rho: float) -> None:
    """Rows of uneven length, as at the ends of windows."""
    rng = np.random.default_rng(4)
    t = np.concatenate(([0.0], np.cumsum(rng.uniform(0.8, 1.2, size=200))))
    held = []
    for _ in range(150):
        rows = np.array([4.0, -1.0, -1.0, 2.0]) + 0.3 * correlated(rng, 200, rho, 4)
        found = analysis.mean_stress(t, rows, rows - 1.0)
        mean = found.stress
        held.append(
            [
                holds(mean.total[0, 1], found.error[0, 1], found.n_eff[0, 1], -1.0),
                holds(mean.kinetic[1, 1], found.kinetic_error[1, 1], found.kinetic_n_eff[1, 1], 1.0),
                holds(mean.pressure, found.pressure_error, found.pressure_n_eff, 3.0),
                holds(mean.friction, found.friction_error, found.friction_n_eff, 0.5),
                holds(
                    mean.normal_difference,
                    found.normal_difference_error,
                    found.normal_difference_n_eff,
                    2 / 3,
                ),
            ]
        )
    share = np.mean(held, axis=0)
    assert np.all((share > 0.9) & (share < 0.995)), share


def test_profiles(tmp_path: Path) -> None:
    """300 strips of 8 disks that stay where they are; velocities and spins with the memory 0.6 of a frame.

    The mean of T is 1 in N disks over F frames only with the factor N / (N - 1) of all N F of them, of which few are
    independent: the truth is 1 less the variance of u.
    """
    rng, strips, each, frames = np.random.default_rng(5), 300, 8, 60
    n, box = strips * each, Box((float(each), float(strips)))
    position = np.stack(np.meshgrid(np.arange(each) + 0.5, np.arange(strips) + 0.5), axis=-1).reshape(-1, 2)
    v, spin = correlated(rng, frames, 0.6, n, 2), correlated(rng, frames, 0.6, n) * np.sqrt(8.0)
    with TrajectoryWriter(tmp_path / "a.h5", Disks(n, mass=1.0, radius=0.5), box) as file:
        for i in range(frames):
            file.write(State(position, v[i], spin[i], time=float(i)))
    with Trajectory(tmp_path / "a.h5") as run:
        found = analysis.profiles(run, "y", strips, frames=range(frames), span=(0.0, float(strips)))
    of_u = (1.0 + 0.6) / (1.0 - 0.6) / (frames * each)
    mean, error, n_eff = found.mean, found.error, found.n_eff
    share = {
        "u": holds(mean.velocity, error.velocity, n_eff.velocity, 0.0).mean(),
        "T": holds(mean.temperature, error.temperature, n_eff.temperature, 1.0 - of_u).mean(),
        "T_rot": holds(
            mean.rotational_temperature, error.rotational_temperature, n_eff.rotational_temperature, 1.0
        ).mean(),
        "P": holds(mean.stress_kinetic, error.stress_kinetic, n_eff.stress_kinetic, 0.0)[
            :, [0, 1], [1, 0]
        ].mean(),
        "q": holds(mean.heat_flux_kinetic, error.heat_flux_kinetic, n_eff.heat_flux_kinetic, 0.0).mean(),
    }
    assert all(0.9 < one < 0.985 for one in share.values()), share


# -- means over disks --------------------------------------------------------------------------------------


def sonine(n: int, rho: float, trials: int) -> Iterator[tuple[str, bool]]:
    """Gaussian gases of n disks in 5 frames: which intervals of coefficients and tails hold."""
    rng = np.random.default_rng(6)
    for _ in range(trials):
        frames = correlated(rng, 5, rho, n, 3)
        found = analysis.velocity_distribution(list(frames[..., :2]), list(frames[..., 2]), bins=9)
        for name in ("a20", "a02", "a11", "a30"):
            value, error = (getattr(found.sonine, f"{name}{end}") for end in ("", "_error"))
            yield name, bool(holds(value, error, found.sonine.disks, 0.0))
        for c, tail in found.tail.items():
            assert tail.error > 0.0
            yield f"tail {c:g}", bool(within(tail.ends, 1.0))


@pytest.mark.parametrize(("n", "rho"), [(200, 0.0), (200, 0.99)])
def test_coefficients_and_tails(n: int, rho: float) -> None:
    """To first order: higher moments of few disks are skewed, and hold less often. Tails of 0 have an error."""
    held: dict[str, list[bool]] = {}
    for name, one in sonine(n, rho, 150):
        held.setdefault(name, []).append(one)
    share = {name: np.mean(one) for name, one in held.items()}
    least = {"a20": 0.83, "a02": 0.8, "a11": 0.87, "a30": 0.85, "tail 2": 0.9, "tail 3": 0.9}
    assert all(share[name] >= low for name, low in least.items()), share


def test_a_density_of_speeds_counts_disks_and_not_frames() -> None:
    """Ten frames of the same gas say no more than one; ten of independent gases as much as ten times the disks."""
    rng, edges = np.random.default_rng(7), np.linspace(-5.0, 5.0, 10)
    from scipy.special import erf

    exact = np.diff(0.5 * erf(edges)) / np.diff(edges)
    errors = []
    for rho in (1.0 - 1e-12, 0.0):
        square, error = [], []
        for _ in range(60):
            frames = correlated(rng, 10, rho, 300, 3)
            found = analysis.velocity_distribution(list(frames[..., :2]), list(frames[..., 2]), bins=9)
            square.append(((found.density - exact) / found.density_error) ** 2)
            error.append(found.density_error[4])
            assert found.density_error.min() > 0.0
        # Speeds over their own root mean square scatter less than independent ones.
        assert np.all(np.mean(square, axis=0) < 1.4)
        assert np.mean(square, axis=0)[3:6].min() > 0.25
        errors.append(np.mean(error))
    assert errors[0] / errors[1] == pytest.approx(10.0**0.5, rel=0.1)


@pytest.mark.parametrize("disks", [3, 10, 100])
def test_diffusion(disks: int) -> None:
    """Random walks, D = 1/2. With 1.96 errors of 3 disks 80 % hold."""
    rng, times, held, marks = np.random.default_rng(8), np.arange(40.0), [], 0
    for _ in range(300):
        msd = analysis.mean_square_displacement(times, np.cumsum(rng.normal(size=(40, disks, 2)), axis=0))
        fit = analysis.diffusion_coefficient(msd)
        held.append(
            [
                holds(fit.D, fit.error, fit.disks, 0.5),
                holds(msd.value[5], msd.error[5], msd.disks, 10.0),
                holds(fit.exponent, fit.exponent_error, fit.disks, 1.0),
            ]
        )
        marks += fit.no_diffusion
    share = np.mean(held, axis=0)
    assert np.all(share[:2] > 0.88), share
    assert share[2] > 0.85
    assert (
        marks <= 4
    )  # 0.27 % for Gaussian noise of ln msd; the exponent is off by more than 0.2 in 36, 15, 0 %


def test_autocorrelation_of_velocities() -> None:
    rng, held = np.random.default_rng(9), []
    for _ in range(300):
        found = analysis.velocity_autocorrelation(np.arange(20.0), correlated(rng, 20, 0.8, 20, 2))
        held.append([holds(found.value[i], found.error[i], found.disks, 2.0 * 0.8**i) for i in (0, 3)])
    assert np.all(np.mean(held, axis=0) > 0.9)


# -- counts, shares, intensities ---------------------------------------------------------------------------


def test_counts_shares_and_intensities() -> None:
    """Averaged over probabilities from 0.01 to 0.5, and numbers from 1 to 30; 1 to 20 modes."""
    rng = np.random.default_rng(10)
    p = 10.0 ** rng.uniform(-2.0, np.log10(0.5), 4000)
    low, high = of_share(rng.binomial(50, p), 50)
    assert 0.93 < np.mean((low <= p) & (p <= high)) < 0.97
    expected = rng.uniform(1.0, 30.0, 4000)
    low, high = of_count(rng.poisson(expected))
    assert 0.93 < np.mean((low <= expected) & (expected <= high)) < 0.97
    for modes in (1, 2, 20):
        mean = rng.exponential(size=(modes, 4000)).mean(axis=0)
        low, high = of_intensity(mean, mean / np.sqrt(modes))
        assert 0.94 < np.mean((low <= 1.0) & (high >= 1.0)) < 0.96


def test_regimes_and_angles() -> None:
    rng, held = np.random.default_rng(11), []
    for _ in range(200):
        b, sliding = rng.random(60), rng.random(60) < 0.03
        found = analysis.impacts(np.arcsin(b), np.where(sliding, 1, 2), bins=9)
        assert all(error > 0.0 for _, error in found.regimes.values())
        low, high = found.density_ends
        exact = (1.0 - np.sin(0.5 * np.pi * 8.0 / 9.0)) / (0.5 * np.pi / 9.0)
        held.append(
            [
                holds(found.mean_b, found.mean_b_error, found.collisions, 0.5),
                within(found.regime_ends("sticking"), 0.97),
                within((low[-1], high[-1]), exact),
            ]
        )
    share = np.mean(held, axis=0)
    assert np.all(share > 0.9), share


def gases(trials: int, n: int, frames: int, *, same: bool) -> Iterator[tuple[list[Array], list[Array]]]:
    """Ideal gases in the unit square: positions and velocities of frames that are all the same, or independent."""
    rng = np.random.default_rng(12)
    for _ in range(trials):
        number = 1 if same else frames
        x, v = list(rng.random((number, n, 2))), list(rng.normal(size=(number, n, 2)))
        yield (x * frames, v * frames) if same else (x, v)


@pytest.mark.parametrize("same", [True, False])
def test_structure_factor(same: bool) -> None:
    """S = 1 of an ideal gas at every k. The first ring has 2 modes: S +- 1.96 errors hold in 78 % there."""
    held = []
    for x, _ in gases(200, 100, 4, same=same):
        found = analysis.structure_factor(x, (1.0, 1.0), k_max=20.0)
        held.append(within(found.ends, 1.0))
        assert found.modes[0] == 2
    share = np.mean(held, axis=0)
    assert np.all(share > 0.9), share
    assert np.all(share < 0.99), share


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("same", [True, False])
def test_spectrum_of_velocities(same: bool) -> None:
    """1 of independent velocities; frames count as one, so that independent ones have intervals that are too wide."""
    held = []
    for x, v in gases(200, 100, 4, same=same):
        found = analysis.velocity_spectrum(x, v, (1.0, 1.0), k_max=20.0)
        held.append([within(found.across_ends, 1.0), within(found.along_ends, 1.0)])
    share = np.mean(held, axis=0)
    assert np.all(share > 0.88), share
    if same:
        assert share.mean() < 0.975


@pytest.mark.parametrize("same", [True, False])
def test_correlation_of_velocities(same: bool) -> None:
    """-1 / (n - 1) of independent velocities, relative to their mean. Errors come from 25 cells of the box.

    Beyond a cell's side of 0.2 every pair is counted in two cells: without that, 84 % hold.
    """
    n, held = 120, []
    for x, v in gases(100, n, 2, same=same):
        found = analysis.velocity_correlation(x, v, (1.0, 1.0), r_max=0.3, bins=6)
        for value, error in ((found.along, found.along_error), (found.across, found.across_error)):
            held.append(holds(value, error, found.n_eff, -1.0 / (n - 1.0)))
    share = np.mean(held, axis=0)
    assert np.all(share > 0.88), share
    if same:
        assert share.mean() < 0.985


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("same", [True, False])
def test_pair_correlation_and_contact_value(same: bool) -> None:
    """g = 1 of an ideal gas, in bins with 0.3 to 40 pairs; at contact the parabola is exact. Two ways of chance."""
    held, at_contact, poor = [], [], 0
    for x, _ in gases(50, 300, 2, same=same):
        found = analysis.pair_correlation(x, (1.0, 1.0), r_max=0.1, bins=12)
        assert found.g_error.min() > 0.0
        held.append(within(found.ends, 1.0))
        contact = analysis.contact_value(x, (1.0, 1.0), radius=0.05)
        at_contact.append(within(contact.ends, 1.0))
        poor += not contact.describes
    share = np.mean(held, axis=0)
    assert np.all(share > 0.82), share
    assert share.mean() > 0.92
    assert np.mean(at_contact) > 0.85
    assert poor <= 1


# -- fits to a cooling gas ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "rho"), [(60, 0.0), (60, 0.8)])
def test_haffs_law(n: int, rho: float) -> None:
    t, held = np.linspace(0.0, 20.0, n), []
    for noise in correlated(np.random.default_rng(13), n, rho, 60).T:
        found = analysis.haff_fit(t, 3.0 * (1.0 + t / 5.0) ** -2 * np.exp(0.02 * noise))
        if found.describes:
            held.append(
                [
                    holds(found.t_H, found.t_H_error, found.n_eff, 5.0),
                    holds(found.T0, found.T0_error, found.n_eff, 3.0),
                ]
            )
    assert len(held) >= 58  # a mark by chance has a probability below 1e-3; rho of 60 points is known poorly
    assert np.all(np.mean(held, axis=0) > 0.86)


@pytest.mark.parametrize(("lag", "rho"), [(3.0, 0.5), (15.0, 0.5)])
def test_ratio_of_temperatures(lag: float, rho: float) -> None:
    x, held = np.linspace(0.0, 40.0, 60), []
    for noise in correlated(np.random.default_rng(14), 60, rho, 50).T:
        found = analysis.ratio_fit(x, 0.6 - 0.6 * np.exp(-x / lag) + 0.01 * noise)
        if found.describes:
            held.append(
                [
                    holds(found.theta_end, found.theta_end_error, found.n_eff, 0.6),
                    holds(found.lag, found.lag_error, found.n_eff, lag),
                ]
            )
    assert len(held) >= 48
    assert np.all(np.mean(held, axis=0) > 0.86)


@pytest.mark.full
@pytest.mark.parametrize(("slope", "rho"), [(0.0, 0.0), (5e-5, 0.9), (0.002, 0.0), (0.002, 0.9)])
def test_data_that_show_no_end_have_none(slope: float, rho: float) -> None:
    """Flat data at 0.57, tau = 20 to 60, noise 0.01: no value off by 0.3 with a finite error.

    With an unbounded lag and its degenerate directions dropped, 13 of 70 were off by more than half, one at
    81.588 +- 0.0056. Where theta changes by 0.08 in the data, they show a change and not its end.
    """
    x, finite, held = np.linspace(20.0, 60.0, 60), 0, []
    for noise in correlated(np.random.default_rng(15), 60, rho, 30).T:
        found = analysis.ratio_fit(x, 0.57 + slope * (x - 40.0) + 0.01 * noise)
        if np.isfinite(found.theta_end_error):
            assert abs(found.theta_end - 0.57) < 0.1
            held.append(holds(found.theta_end, found.theta_end_error, found.n_eff, 0.57))
            finite += 1
        assert not found.lag_error > 0.5 * found.lag  # nan, or determined
        assert np.isfinite(found.theta_end) == np.isfinite(found.theta_end_error) or not found.describes
    if slope < 0.001:
        assert finite >= 20
        assert np.mean(held) > 0.8
    else:
        assert finite <= 5


# -- marks -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "rho", "most"), [(100, 0.0, 0.02), (100, 0.9, 0.12), (400, 0.9, 0.05)])
def test_marks_of_steady_temperatures(n: int, rho: float, most: float) -> None:
    """Taken for independent rows, 41 % were marked at rho = 0.9."""
    x = 1.0 + 0.1 * correlated(np.random.default_rng(16), n, rho, 150)
    assert np.mean([not steadiness.is_stationary(one) for one in x.T]) <= most


@pytest.mark.parametrize(("rho", "size", "least"), [(0.0, 1.0, 0.98), (0.5, 1.0, 0.9), (0.9, 4.0, 0.5)])
def test_marks_of_temperatures_that_relax(rho: float, size: float, least: float) -> None:
    """A relaxation by 10 and 40 standard deviations of the noise, with a lag of a tenth of the rows.

    At rho = 0.9 there are 2.6 independent values in the quieter half, which now and then look like a random walk.
    """
    x = 1.0 + 0.1 * correlated(np.random.default_rng(17), 100, rho, 100)
    x += size * np.exp(-np.linspace(0.0, 10.0, 100))[:, None]
    assert np.mean([not steadiness.is_stationary(one) for one in x.T]) >= least


@pytest.mark.parametrize(("n", "rho"), [(20, 0.0), (50, 0.9), (200, 0.97)])
def test_marks_of_ratios_of_species(n: int, rho: float) -> None:
    """Student's t of the number of rows marked 19 to 30 %. What is expected of 600 at 0.27 % are 1.6."""
    x, marks = correlated(np.random.default_rng(18), n, rho, 600), 0
    halves = []
    for part in np.array_split(x, 2):
        error, n_eff = common.mean_errors(part)
        halves.append([common.MeanValue(*each) for each in zip(part.mean(axis=0), error, n_eff, strict=True)])
    for pair in zip(*halves, strict=True):
        marks += len(steadiness.warnings([steadiness.between("x", *pair)]))
    assert marks <= 10


@pytest.mark.parametrize(("n", "rho"), [(50, 0.0), (300, 0.9)])
def test_marks_of_coefficients_of_velocities(n: int, rho: float) -> None:
    """Halves of 10 frames of a Gaussian gas, compared in seven coefficients as `analyse velocity` does."""
    rng, marks = np.random.default_rng(19), 0
    for _ in range(60):
        frames = correlated(rng, 10, rho, n, 3)
        changes = []
        parts = [
            analysis.velocity_distribution(list(each[..., :2]), list(each[..., 2]), bins=1).sonine
            for each in np.array_split(frames, 2)
        ]
        for name in catalogue.SONINE:
            pair = [common.MeanValue(getattr(one, name), getattr(one, f"{name}_error"), n) for one in parts]
            changes.append(steadiness.between(name, *pair))
        marks += len(steadiness.warnings(changes))
    assert marks <= 3


def test_n_eff_of_a_fit_lies_between_one_and_the_number_of_rows() -> None:
    """A random walk about Haff's law: rho is nearly 1, and n (1 - rho) / (1 + rho) - 1 was below 0."""
    t, found = np.linspace(0.0, 20.0, 30), []
    for walk in np.cumsum(np.random.default_rng(19).normal(size=(10, 30)), axis=1):
        noise = 0.01 * walk
        found.append(analysis.haff_fit(t, 3.0 * (1.0 + t / 5.0) ** -2 * np.exp(noise), disks=30).n_eff)
        found.append(analysis.ratio_fit(t, 0.6 - 0.6 * np.exp(-t / 3.0) + noise, disks=30).n_eff)
    assert 1.0 == min(found) <= max(found) <= 30.0


# -- what is printed ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("row", "text"),
    [
        (Reading("x", 1.234, 0.012, "J", n_eff=14.2), "1.234 +- 0.012 J (n_eff 14)"),
        (Reading("x", 1.234, 0.012, n_eff=2.04), "1.234 +- 0.012 (n_eff 2.0)"),
        (Reading("x", 1.0, 0.7, ends=(0.36, 8.256)), "1.00 +- 0.70 (95 %: 0.36 to 8.26)"),
        (Reading("x", 1.234, 0.012), "1.234 +- 0.012"),
        (Reading("x", 1e9, np.inf), "not determined"),
    ],
)
def test_numbers_say_how_many_values_they_are_worth(row: Reading, text: str) -> None:
    assert catalogue.number(row) == text


def test_errors_from_fewer_than_two_values_are_marked() -> None:
    """Those of 20 rows of white noise never are."""
    slow, sure = Reading("slow", 1.0, 0.1, n_eff=1.9), Reading("sure", 1.0, 0.1, n_eff=2.0)
    constant = Reading("constant", 1.0, 0.0, n_eff=1.0)
    own = Reading("with ends", 1.0, 0.1, n_eff=1.0, ends=(0.5, 3.0))
    without = Reading("without", 1.0)
    found = Evaluation(None, [slow, sure, constant, own, without], {}, [], (0.0, 1.0), ["another"])
    text = "too short: fewer than two independent values; the error is a guess (slow)"
    assert found.warnings == ["another", text]
    assert not Evaluation(None, [sure, constant, own, without], {}, [], (0.0, 1.0)).warnings
    assert np.all(common.mean_errors(np.random.default_rng(20).normal(size=(20, 2000))).effective > 2.0)


def test_an_interval_is_by_student_s_t_of_n_eff() -> None:
    """Two values: one degree of freedom, t = tan(0.475 pi) = 12.706 (Cauchy's distribution)."""
    low, high = Reading("x", 1.0, 0.1, n_eff=2.0).interval
    assert (low, high) == pytest.approx((1.0 - 1.2706, 1.0 + 1.2706), abs=1e-4)
    assert np.isnan(Reading("x", 1.0, 0.1).interval).all()
