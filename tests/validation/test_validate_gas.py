"""`ifrdem validate gas`: the command, the sampling in its rows, and its sensitivity to errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem import theory
from ifrdem.cli import main as cli
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.validation.gas import collapse, elastic, sample, state, waves
from ifrdem.validation.report import page, registry, runner, terminal
from ifrdem.validation.report.registry import GAS, Result


def test_gases_are_a_separate_group_left_out_of_a_run_without_names() -> None:
    assert registry.chosen(["gas"]) == list(GAS)
    assert not set(registry.chosen([])) & set(GAS)
    for name in GAS:
        case = registry.load(name)
        assert case.QUESTION.endswith("?")
        assert case.REFERENCE


def test_a_seed_where_nothing_is_random_is_refused(tmp_path, capsys) -> None:
    assert cli.main(["validate", "angles", "--seed", "2", "-o", str(tmp_path / "a")]) == 2
    assert "--seed 2: only the cases of the group gas" in capsys.readouterr().err
    assert cli.main(["validate", "gas", "--seed", "-1", "-o", str(tmp_path / "a")]) == 2
    assert "--seed -1: must be" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_seeds_of_two_runs_have_nothing_in_common() -> None:
    assert not set(sample.seeds_of(1, sample.STRIDE)) & set(sample.seeds_of(2, sample.STRIDE))


def compared(
    shift: float,
    *,
    replicas: int = 12,
    systematic: float = 0.0,
    widest: float = 1.0,
    expected: float | sample.Mean = 10.0,
) -> registry.Row:
    values = np.random.default_rng(1).normal(shift, 1.0, replicas)
    result = Result()
    sample.compare(
        result, "x", values - values.mean() + 10.0 + shift, expected, disks=7, seeds=range(replicas),
        systematic=systematic, why="nothing", source="a book", widest=widest,
    )  # fmt: skip
    return result.rows[0]


def test_the_tolerance_is_student_s_and_the_systematic_one_and_no_more() -> None:
    """The chance of 4 sigma of a Gaussian, erfc(4 / sqrt 2) = 6.33e-5, is left by t of 12 values."""
    one = compared(0.0)
    assert one.sampling is not None
    assert one.sampling.error > 0.0
    limit = one.tolerance
    assert limit == pytest.approx(one.sampling.z * one.sampling.error)
    assert compared(0.99 * limit).passed
    assert not compared(1.01 * limit).passed
    assert compared(limit + 0.09, systematic=0.1).passed
    # By integrating Student's density with 11 degrees of freedom beyond z.
    z = one.sampling.z
    x = np.linspace(z, 400.0, 2_000_001)
    constant = math.gamma(6.0) / (math.sqrt(11.0 * math.pi) * math.gamma(5.5))
    density = constant * (1.0 + x**2 / 11.0) ** -6.0
    assert 2.0 * np.trapezoid(density, x) == pytest.approx(math.erfc(4.0 / math.sqrt(2.0)), rel=1e-3)


def test_a_row_with_a_tolerance_too_wide_for_a_test_fails(capsys) -> None:
    tolerance = compared(0.0).tolerance
    assert compared(0.0, widest=1.01 * tolerance / 10.0).passed
    blunt = compared(0.0, widest=0.99 * tolerance / 10.0)
    assert blunt.blunt
    assert not blunt.passed
    table = terminal.table(runner.Verdict("gas_state", "?", "a book", Result([blunt])))
    assert "it says nothing" in table


def test_errors_of_two_means_have_welch_s_degrees_of_freedom() -> None:
    """(a + b)^2 / (a^2/(n - 1) + b^2/(m - 1)) for squared errors a, b: of equal ones and n = m = 12 it is 22.

    Of a mean that is known much better than the other, that other's n - 1 = 11 stay.
    """
    alone = compared(0.0).sampling
    assert alone is not None
    for error, freedom in ((alone.error, 22.0), (1e-6 * alone.error, 11.0)):
        found = compared(0.0, expected=sample.Mean(10.0, error, 12)).sampling
        assert found is not None
        assert found.freedom == pytest.approx(freedom)
        assert found.error == pytest.approx(math.hypot(alone.error, error))


def test_chi_square_of_rows_finds_a_bias_that_each_row_alone_passes() -> None:
    """Six values 2.2 Gaussian errors off: chi-square is 29.0, which one of 6 degrees of freedom exceeds by 6.0e-5.

    Q(chi^2, 6) = exp(-x)(1 + x + x^2/2) with x = chi^2 / 2; below it, 6.334e-5 of chance are left at x = 14.46.
    """
    x = 14.46
    assert math.exp(-x) * (1.0 + x + 0.5 * x * x) == pytest.approx(sample.CHANCE, rel=0.02)
    for off, passes in ((2.15, True), (2.25, False)):
        result = Result()
        for _ in range(6):
            sample.compare(
                result, "x", sample.Mean(10.0 + off * 0.1 + 0.05, 0.1, 1), 10.0, disks=7, seeds=[1],
                systematic=0.05, why="nothing", source="a book", widest=1.0,
            )  # fmt: skip
        assert all(row.passed for row in result.rows)
        sample.add_chi_square(result, "six", result.rows[:6], "a book")
        assert result.rows[-1].measured == pytest.approx(6.0 * off**2, rel=1e-6)
        assert result.rows[-1].passed is passes


def test_ratio_of_means_is_not_the_mean_of_ratios() -> None:
    a, b = np.array([1.0, 3.0]), np.array([1.0, 2.0])
    values = sample.ratio(a, b)
    assert values.mean() == pytest.approx(4.0 / 3.0)
    assert values == pytest.approx([4.0 / 3.0 + (1.0 - 4.0 / 3.0) / 1.5, 4.0 / 3.0 + (3.0 - 8.0 / 3.0) / 1.5])


def smooth(e_n: float) -> IFRLaw:
    return IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)


def test_energy_of_waves_and_of_thermal_velocities_obeys_its_balance() -> None:
    """d ln T / dtau = -z / (1 + s): with dS/dtau of every wave and T itself by small steps, one by one."""
    phi, n, z, steps, end = 0.1, 3000, 0.5 * 0.19, 4000, 20.0
    side = math.sqrt(math.pi * n / (4.0 * phi))
    xi = theory.shear_length(smooth(0.9), 0.5, phi) / (2.0 * math.pi)
    most = 0.5 / theory.mean_free_path(phi, 0.5)
    i = np.arange(-40, 41) * 2.0 * math.pi / side
    k = np.hypot(i[:, None], i)
    q = (k[(k > 0.0) & (k < most)] * xi) ** 2
    transverse, sound, log_T, step = np.ones(len(q)), np.ones(len(q)), 0.0, end / steps
    for _ in range(steps):
        s = (np.sum(transverse - 1.0) + np.sum(sound - 1.0)) / (2.0 * n)
        log_T -= step * z / (1.0 + s)
        transverse += step * z * (transverse - q * (transverse - 1.0))
        sound += step * z * (0.5 * sound - 1.5 * q * (sound - 1.0))
    found = waves.streams([10.0, end], smooth(0.9), phi, n)
    assert len(q) > 20
    assert found.factor[-1] == pytest.approx(
        math.exp(log_T + z * end), rel=1e-4
    )  # of first order in the step
    assert found.share[-1] == pytest.approx(s, rel=2e-3)
    for end in (1.0 / (1.0 + found.share[-1]), 1.0 / found.factor[-1]):
        assert found.theta[-1] - found.theta_error[-1] < end < 1.0
    assert found.theta[-1] + found.theta_error[-1] > 1.0


def test_what_is_uncertain_of_waves_goes_with_the_density_and_not_with_the_box() -> None:
    """Waves that have settled, from 1/(2 l) to 1/l: sums over many as integrals, (1/2N) sum -> (1 / 4 pi n) int k dk.

    S - 1 = 1/(q - 1) of transverse ones and 1/(3 q - 1) of sound, q = k^2 xi^2:
    [ln(q - 1) + ln(3 q - 1) / 3] / (8 pi n xi^2) between the ends.
    """
    found = {}
    for phi, n in ((0.02, 300_000), (0.02, 100_000), (0.01, 300_000)):
        found[phi, n] = waves.streams(50.0, smooth(0.9), phi, n).share_error.item()
        xi = theory.shear_length(smooth(0.9), 0.5, phi) / (2.0 * math.pi)
        low = (0.5 * xi / theory.mean_free_path(phi, 0.5)) ** 2
        high = 4.0 * low
        between = (
            math.log((high - 1.0) / (low - 1.0)) + math.log((3.0 * high - 1.0) / (3.0 * low - 1.0)) / 3.0
        )
        exact = between / (8.0 * math.pi * 4.0 * phi / math.pi * xi**2)
        assert found[phi, n] == pytest.approx(exact, rel=0.05)
    assert found[0.02, 300_000] == pytest.approx(found[0.02, 100_000], rel=0.05)
    assert found[0.02, 300_000] == pytest.approx(2.0 * found[0.01, 300_000], rel=0.07)


def test_waves_of_a_kicked_gas_are_those_that_its_equation_leaves_at_rest() -> None:
    """dS/dtau = z - z q (S - 1) = 0 and z - (3/2) z q (S - 1) = 0, wave by wave."""
    phi, n = 0.1, 400
    side = math.sqrt(math.pi * n / (4.0 * phi))
    xi = theory.shear_length(smooth(0.9), 0.5, phi) / (2.0 * math.pi)
    total, most = 0.0, 0.5 / theory.mean_free_path(phi, 0.5)
    for i in range(-9, 10):
        for j in range(-9, 10):
            k = math.hypot(i, j) * 2.0 * math.pi / side
            if 0.0 < k < most:
                total += (1.0 + 2.0 / 3.0) / (k * xi) ** 2
    share, off = waves.driven_streams(smooth(0.9), phi, n, 0.0)
    assert share == pytest.approx(total / (2.0 * n))
    assert off > 0.0


def test_the_report_says_how_a_row_was_sampled() -> None:
    row = compared(0.0)
    outcome = runner.Verdict("gas_state", "?", "a book", Result([row]))
    (found,) = runner.rows_as_json([outcome])
    assert (found["disks"], found["replicas"], found["seeds"]) == (7, 12, [0, 11])
    assert found["statistical_error"] == pytest.approx(row.sampling.error if row.sampling else math.nan)
    assert "12 x 7" in page.page([outcome], {})


def test_the_equation_of_state_has_the_virial_coefficients_and_an_independent_monte_carlo() -> None:
    """Z = 1 + 2 phi + 3.128 phi^2 + ...: B_3 / B_2^2 = 0.782004, doi:10.1007/s10955-005-8080-0; B_2 = 2 in phi.

    Li et al. (2022), 1024^2 disks at phi = 0.698, P sigma^2 / T = 9.16938(11): Z = 10.3174.
    """
    phi = 1e-3
    assert (float(state.compressibility(phi)) - 1.0 - 2.0 * phi) / phi**2 == pytest.approx(
        4.0 * 0.782004, rel=2e-3
    )
    assert float(state.compressibility(0.698)) == pytest.approx(9.16938 * math.pi / 4.0 / 0.698, rel=3e-3)


@pytest.mark.full
def test_three_disks_pass_and_a_law_that_is_a_little_off_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    assert all(row.passed and row.source for row in collapse.run(True, 1).rows)
    real = collapse.IFRLaw

    def off(**coefficients: float) -> IFRLaw:
        return real(**{**coefficients, "e_n": 0.97 * coefficients["e_n"]})  # type: ignore[arg-type]

    monkeypatch.setattr(collapse, "IFRLaw", off)
    failed = [row.quantity for row in collapse.run(True, 1).rows if not row.passed]
    assert "collisions at e_n = 0.09" in failed or "collisions at e_n = 0.08" in failed
    assert any(text.startswith("largest deviation of velocities at the end") for text in failed)


def test_free_flights_of_a_dilute_gas_are_those_of_visco_and_others() -> None:
    """By sampling instead of integrals: flights at the rate |v - v_1| averaged over partners.

    Flights begin at the rate nu(v), so that a mean over flights is E[nu ...] / E[nu] over disks.
    """
    from ifrdem.validation.gas import equilibrium

    rng = np.random.default_rng(1)
    v, partner = rng.normal(size=(2000, 2)), rng.normal(size=(4000, 2))
    rate = np.array([np.mean(np.hypot(*(one - partner).T)) for one in v])
    speed = np.hypot(*v.T)
    mean = np.mean(rate)
    paths = 2.0 * np.mean(speed**2 / rate) * mean / np.mean(speed) ** 2
    times = 2.0 * np.mean(1.0 / rate) * mean
    found = equilibrium.flights()
    assert found[0] == pytest.approx(paths, rel=0.01)  # 2000 disks
    assert found[1] == pytest.approx(times, rel=0.01)
    assert min(found) > 2.05  # not exponential


def test_diffusion_of_second_order_has_the_brackets_of_its_text() -> None:
    """b_01 = -1/4 and b_11 = 43/16 over b_00 = 1, by a million sampled collisions: 43/42."""
    from ifrdem.validation.gas import equilibrium

    rng = np.random.default_rng(2)
    n = 1_000_000
    g = np.sqrt(-2.0 * np.log(rng.random(n)))
    mean, across = 0.5 * rng.normal(size=n), math.sqrt(0.5) * rng.normal(size=n)
    before, after = np.array([mean + 0.5 * g, across]), np.array([mean - 0.5 * g, across])
    phi = [[one, (2.0 - np.sum(one**2, axis=0)) * one] for one in (before, after)]
    b = [[np.mean(np.sum(phi[0][p] * (phi[0][q] - phi[1][q]), axis=0)) for q in (0, 1)] for p in (0, 1)]
    assert 1.0 / (1.0 - b[0][1] * b[1][0] / (b[0][0] * b[1][1])) == pytest.approx(
        equilibrium.SONINE, abs=0.002
    )
    # Without crowding, D = sqrt(T / (pi m)) / (2 n sigma).
    assert equilibrium.enskog(1e-6) * 4e-6 / math.pi * 2.0 * math.sqrt(math.pi) == pytest.approx(
        43.0 / 42.0, rel=1e-5
    )


def test_the_layer_at_walls_is_that_of_the_exact_profile_in_a_dilute_gas() -> None:
    """Gamma / n^2 is the integral over z of the part of a circle of radius 1 beyond a wall at the distance z."""
    from ifrdem.validation.gas import equilibrium

    z = np.linspace(0.0, 1.0, 20_001)
    beyond = np.arccos(z) - z * np.sqrt(1.0 - z**2)
    exact = float(np.trapezoid(beyond, z))
    assert exact == pytest.approx(2.0 / 3.0, rel=1e-5)
    n, side = 4000, 1000.0
    density = equilibrium.bulk_density(n, side, 8.0 / (3.0 * math.pi))
    layer = (n - density * side * (side - 1.0)) / (2.0 * side)
    assert layer / density**2 == pytest.approx(exact, rel=0.005)  # 1 + phi
    assert equilibrium.wall_pressure(n, side, 1.0) < equilibrium.wall_pressure(n, side, 0.0)


def test_cumulants_change_the_relaxation_of_perfectly_rough_disks_only_once_there_are_some() -> None:
    """At the start all is Gaussian and the rate 3 k / (1 + k)^2 = 2/3 exact; cumulants change tau^2 and beyond."""
    tau = np.array([0.0, 1e-3, 1e-2, 1.0])
    late = elastic.relaxed(tau) / np.exp(-2.0 * tau / 3.0) - 1.0
    assert np.all(np.abs(late[:3]) <= 0.01 * tau[:3] ** 2 + 1e-9)
    assert 0.003 < late[3] < 0.01  # DSMC: 0.003(4); two runs of the engine: 0.007(3) and 0.009(3)
