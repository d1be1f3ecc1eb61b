"""Mean pressure tensor of series: weights by time, blocks, errors of ratios."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem import analysis
from ifrdem.errors import InputError


def test_rows_count_by_the_time_that_they_are_means_of() -> None:
    """Rows of 1, 3 and 2 units of time: (1 * 6 + 3 * 2 + 2 * 3) / 6 = 3; within (0.5, 3): (0.5 * 6 + 2 * 2) / 2.5."""
    rows = np.array([6.0, 2.0, 3.0])[:, None] * [1.0, -0.5, -0.25, 0.5]
    found = analysis.mean_stress([0.0, 1.0, 4.0, 6.0], rows, 0.25 * rows)
    np.testing.assert_allclose(found.stress.total, [[3.0, -1.5], [-0.75, 1.5]], rtol=1e-14)
    np.testing.assert_allclose(found.stress.kinetic, 0.25 * found.stress.total, rtol=1e-14)
    assert (found.stress.pressure, found.stress.friction) == pytest.approx((2.25, 1.0))
    part = analysis.mean_stress([0.0, 1.0, 4.0, 6.0], rows, rows, span=(0.5, 3.0))
    assert part.stress.total[0, 0] == pytest.approx(2.8, rel=1e-14)
    assert len(part.time) == 1
    assert np.isnan(part.error).all()


def test_blocks_are_equal_parts_of_the_span() -> None:
    t = np.linspace(0.0, 10.0, 1001)
    rows = np.repeat((0.5 * (t[1:] + t[:-1]))[:, None], 4, axis=1)  # grows like t
    found = analysis.mean_stress(t, rows, rows)
    np.testing.assert_allclose(found.time, 0.25 + 0.5 * np.arange(20), rtol=1e-13)
    np.testing.assert_allclose(found.blocks[:, 0, 1], found.time, rtol=1e-12)


def test_errors_are_those_of_many_independent_series() -> None:
    """White noise in rows: the scatter of the results over 300 series is the median of their errors, to 20 %.

    Not their root mean square: an error is the larger of two, and a few series look correlated. How often intervals
    hold is in test_coverage.py.
    """
    rng = np.random.default_rng(3)
    t = np.arange(401.0)
    results, errors = [], []
    for _ in range(300):
        rows = np.array([4.0, -1.0, -1.0, 2.0]) + rng.normal(size=(400, 4))
        kinetic = rows - 1.0 + 0.5 * rng.normal(size=(400, 4))
        found = analysis.mean_stress(t, rows, kinetic)
        mean = found.stress
        results.append((mean.total[0, 1], mean.friction, mean.normal_difference, mean.kinetic[1, 1]))
        errors.append(
            (
                found.error[0, 1],
                found.friction_error,
                found.normal_difference_error,
                found.kinetic_error[1, 1],
            )
        )
    scatter, error = np.std(results, axis=0), np.median(errors, axis=0)
    assert scatter[0] == pytest.approx(0.05, rel=0.15)  # 1 / sqrt(400)
    assert scatter[3] == pytest.approx(0.05 * np.sqrt(1.25), rel=0.15)
    np.testing.assert_allclose(error, scatter, rtol=0.2)


def test_a_gas_at_rest_has_no_stress_and_no_ratios() -> None:
    found = analysis.mean_stress(np.arange(11.0), np.zeros((10, 4)), np.zeros((10, 4)))
    assert found.stress.pressure == found.pressure_error == 0.0
    assert np.isnan([found.friction_error, found.normal_difference_error]).all()


@pytest.mark.parametrize(
    ("time", "rows", "span", "message"),
    [
        ([0.0, 1.0, 1.0], 2, None, "time: must be two or more times, each later"),
        ([0.0], 0, None, "time: must be two or more times"),
        ([0.0, 1.0, 2.0], 3, None, "stress has 3 rows: must have 2"),
        ([0.0, 1.0, 2.0], 2, (1.0, 3.0), r"span = \(1, 3\): must lie within time, 0 to 2"),
        ([0.0, 1.0, 2.0], 2, (1.0, 1.0), r"span = \(1, 1\): must lie within time"),
    ],
)
def test_rows_that_make_no_mean_are_refused(
    time: list[float], rows: int, span: tuple[float, float] | None, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        analysis.mean_stress(time, np.ones((rows, 4)), np.ones((rows, 4)), span=span)
