"""The steady window of runs: series of known truth, of the noise rho^|lag| and a transient A exp(-t / lag)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t as student

from ifrdem.analysis.window import (
    LEVEL,
    SHARES,
    changes_between_seeds,
    mser_row,
    steady_share,
    window_rows,
)

SEEDS = 6


def noise(rng: np.random.Generator, shape: tuple[int, ...], rho: float) -> np.ndarray:
    """Stationary series of mean 0, variance 1 and correlation rho^|lag| along the last axis."""
    steps = rng.normal(size=shape) * np.sqrt(1.0 - rho**2)
    steps[..., 0] /= np.sqrt(1.0 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], steps, axis=-1))


def runs(rng: np.random.Generator, rows: int, height: float, lag: float, rho: float) -> np.ndarray:
    """A series of each seed with a transient of a height, in standard deviations of the noise, and lag of the run."""
    return noise(rng, (SEEDS, rows), rho) + height * np.exp(-np.arange(rows) / (lag * rows))


@pytest.mark.parametrize(
    ("rows", "height", "lag", "rho"),
    [
        (600, 4, 0.1, 0.5),
        (600, 40, 0.03, 0.95),
        (600, 40, 0.1, 0.95),
        (51, 40, 0.03, 0.5),
        (600, 0, 0.1, 0.97),
    ],
)
def test_intervals_over_seeds_hold_the_mean_of_the_steady_gas(rows, height, lag, rho):
    """95 % intervals of Student's t over 6 seeds; over all rows they hold in 0 to 7 % where there is a transient."""
    rng, held, trials = np.random.default_rng(1), 0, 100
    for _ in range(trials):
        series = runs(rng, rows, height, lag, rho)
        begin = round(steady_share(np.arange(rows), series.mean(axis=0)) * (rows - 1))
        means = series[:, begin:].mean(axis=1)
        error = means.std(ddof=1) / SEEDS**0.5
        held += abs(means.mean()) < student.ppf(0.975, SEEDS - 1) * error
    assert held >= 88  # of 100; 3 standard deviations below 95


def test_a_steady_run_loses_little_and_none_more_than_half():
    rng = np.random.default_rng(2)
    found = [steady_share(np.arange(600), runs(rng, 600, 0.0, 1.0, 0.5).mean(axis=0)) for _ in range(50)]
    assert {*found} <= {*SHARES}
    assert np.mean(found) < 0.1
    assert steady_share(np.arange(600), runs(rng, 600, 1e3, 1.0, 0.5).mean(axis=0)) == 0.5


def test_the_start_is_twice_that_of_mser_5():
    # Batches of 5 rows with the means 9, 9, 1, 0, 1, 0, ...: var / (k - d) is least for d = 2.
    rows = np.repeat([9.0, 9.0, *([1.0, 0.0] * 9)], 5)
    assert mser_row(rows) == 20
    assert mser_row(1e-9 * rows) == mser_row(np.stack((rows, np.zeros_like(rows)), axis=1)) == 20
    assert mser_row(rows[:19]) == 9  # too few batches: half
    assert mser_row(np.ones(100)) == 0
    # The first of the eighths of the run that is not before: 20 of 99 intervals.
    assert steady_share(np.linspace(3.0, 8.0, 100), rows) == 0.25


def test_rows_at_logarithmic_places_count_by_their_places():
    place = np.geomspace(1.0, 1001.0, 400) - 1.0
    transient = np.where(place < 40.0, 1.0, 0.0)
    # 4 % of the run, but more than half of the rows; 16 of 400 even ones, within the 4th batch of 5, so that d = 4.
    assert np.mean(place < 40.0) > 0.5
    assert steady_share(place, transient) == 0.125


def test_each_quantity_that_relaxes_moves_the_start():
    """A ratio of temperatures may relax while T is steady; so may one number of the pressure tensor."""
    rng, rows = np.random.default_rng(4), 200
    steady = {"temperature": 9.0 + noise(rng, (rows,), 0.5), "rotational_temperature": np.zeros(rows)}
    slow = 40.0 * np.exp(-np.arange(rows) / 20.0) + noise(rng, (rows,), 0.5)
    species = np.stack((steady["temperature"], slow), axis=-1)
    stress = np.stack([noise(rng, (rows,), 0.5) for _ in range(4)], axis=-1)
    stress[0] = np.nan  # before the first row nothing is

    def share(**more: np.ndarray) -> tuple[list[str], float]:
        found = window_rows(steady | more, ["heavy", "light"])
        return [*found], steady_share(np.arange(rows), np.stack([*found.values()], axis=1))

    assert share(stress=stress) == (["T", "P_xx", "P_xy", "P_yy"], pytest.approx(0.0, abs=0.25))
    names, late = share(species_temperature=species)
    assert names == ["T", "T of heavy", "T of light"]
    assert late == 0.5
    for i in (0, 1, 3):
        moved = stress.copy()
        moved[:, i] += slow
        assert share(stress=moved)[1] == 0.5


def test_seeds_show_a_run_that_is_too_short_and_spare_steady_ones():
    """At 1 %: marks of steady runs, however correlated, and of a transient as long as the run."""

    def marked(height: float, lag: float, rho: float, trials: int) -> int:
        rng, count = np.random.default_rng(3), 0
        for _ in range(trials):
            (change,) = changes_between_seeds({"T": runs(rng, 100, height, lag, rho)})
            count += abs(change.t) > student.isf(0.5 * LEVEL, change.degrees)
        return count

    steady = [marked(0.0, 1.0, rho, 500) for rho in (0.0, 0.9, 0.97)]
    assert max(steady) <= 12  # of 500; the mean is 5, and 12 is 3 standard deviations above
    assert sum(steady) >= 4  # of 1500; the mean is 15: an error that is too long would mark none
    assert marked(4.0, 0.5, 0.5, 100) == 100
