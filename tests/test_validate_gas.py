"""`ifrdem validate gas`: that it is there, that its rows say how they were sampled, and that it can fail."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem import cli
from ifrdem.law import IFRLaw
from ifrdem.validation import gas_collapse, gas_sample, gas_state, page, registry, runner
from ifrdem.validation.registry import GAS, Result

pytestmark = pytest.mark.unoptimised


def test_gases_are_a_group_of_their_own_and_no_part_of_a_run_without_names() -> None:
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
    assert "--seed -1: a whole number from 0" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_seeds_of_two_runs_have_nothing_in_common() -> None:
    assert not set(gas_sample.seeds_of(1, gas_sample.STRIDE)) & set(gas_sample.seeds_of(2, gas_sample.STRIDE))


def compared(shift: float, *, replicas: int = 12, systematic: float = 0.0) -> registry.Row:
    values = np.random.default_rng(1).normal(shift, 1.0, replicas)
    result = Result()
    gas_sample.compare(
        result, "x", values - values.mean() + shift, 0.0, disks=7, seeds=range(replicas), systematic=systematic,
        why="nothing", source="a book",
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


def test_the_report_says_how_a_row_was_sampled() -> None:
    row = compared(0.0)
    outcome = runner.Outcome("gas_state", "?", "a book", Result([row]))
    (found,) = runner.rows_as_json([outcome])
    assert (found["disks"], found["replicas"], found["seeds"]) == (7, 12, [0, 11])
    assert found["statistical_error"] == pytest.approx(row.sampling.error if row.sampling else math.nan)
    assert "12 x 7" in page._case(None, outcome)  # type: ignore[arg-type]  # no picture


def test_the_equation_of_state_has_the_virial_coefficients_and_an_independent_monte_carlo() -> None:
    """Z = 1 + 2 phi + 3.128 phi^2 + ...: B_3 / B_2^2 = 0.782004, doi:10.1007/s10955-005-8080-0; B_2 = 2 in phi.

    Li et al. (2022), 1024^2 disks at phi = 0.698, P sigma^2 / T = 9.16938(11): Z = 10.3174.
    """
    phi = 1e-3
    assert (float(gas_state.compressibility(phi)) - 1.0 - 2.0 * phi) / phi**2 == pytest.approx(
        4.0 * 0.782004, rel=2e-3
    )
    assert float(gas_state.compressibility(0.698)) == pytest.approx(9.16938 * math.pi / 4.0 / 0.698, rel=3e-3)


def test_three_disks_pass_and_a_law_that_is_a_little_off_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    assert all(row.passed and row.source for row in gas_collapse.run(True, 1).rows)
    real = gas_collapse.IFRLaw

    def off(**coefficients: float) -> IFRLaw:
        return real(**{**coefficients, "e_n": 0.97 * coefficients["e_n"]})  # type: ignore[arg-type]

    monkeypatch.setattr(gas_collapse, "IFRLaw", off)
    failed = [row.quantity for row in gas_collapse.run(True, 1).rows if not row.passed]
    assert "collisions at e_n = 0.09" in failed or "collisions at e_n = 0.08" in failed
    assert any(text.startswith("largest deviation of velocities at the end") for text in failed)
