"""Distributions of collisions that were counted, on data of known truth, and from the file of a run."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import case_text

from ifrdem import analysis
from ifrdem.analysis.catalogue import FUNCTIONS
from ifrdem.errors import InputError
from ifrdem.model.histograms import Histogram, histogram_edges
from ifrdem.plots import pictures

CASE = case_text(
    {
        "output.histograms": True,
        "output.free_times": True,
        "output.frames": 4,
        "run.collisions_per_disk": 20.0,
        "run.t_end": None,
    }
)


def drawn(name, values):
    """The histogram of some values."""
    edges = histogram_edges(name)
    return Histogram(name, edges, np.histogram(values, edges)[0][None])


def equilibrium(rng, n):
    """n collisions in equilibrium: their angles [rad], normal speeds of variance 4, free times of mean 3."""
    return {
        "impact_angle": np.arcsin(rng.uniform(size=n)), "normal_speed": 2.0 * rng.rayleigh(size=n),
        "free_time": rng.exponential(3.0, size=n),
    }  # fmt: skip


TRUE = {"impact_angle": np.pi / 2 - 1.0, "normal_speed": 2.0 * np.sqrt(np.pi / 2), "free_time": 3.0}


@pytest.mark.parametrize("name", TRUE)
def test_collisions_in_equilibrium_have_its_density_and_mean(name):
    """Of 300 samples of 1000 collisions, 95 % have an interval that holds the mean, and 5 % a p-value below 0.05.

    Shares scatter by 1.3 %; means are of the middles of bins, which shift them by less than a tenth of an error.
    """
    rng = np.random.default_rng(4)
    held, low = 0, 0
    for _ in range(300):
        found = analysis.collision_distribution(drawn(name, equilibrium(rng, 1000)[name]))
        held += abs(found.mean - TRUE[name]) < 1.96 * found.mean_error
        low += found.p_value < 0.05
    assert 0.91 < held / 300 < 0.985
    assert 0.015 < low / 300 < 0.095


def test_other_distributions_are_told_apart():
    """A gas in which grazing hits are rarer, one of two temperatures, and times of at least a second."""
    rng = np.random.default_rng(1)
    n = 5000
    others = {
        "impact_angle": np.arcsin(rng.uniform(size=n) ** 1.2),
        "normal_speed": np.where(rng.uniform(size=n) < 0.5, 1.0, 2.0) * rng.rayleigh(size=n),
        "free_time": 1.0 + rng.exponential(3.0, size=n),
    }
    for name, values in others.items():
        assert analysis.collision_distribution(drawn(name, values)).p_value < 1e-6


def test_densities_are_per_unit_of_the_edges():
    found = analysis.collision_distribution(drawn("normal_speed", [1.01, 1.02, 5.0]))
    assert found.density @ np.diff(found.edges) == pytest.approx(1.0)
    assert found.density[224] == pytest.approx(2.0 / 3.0 / 0.125)
    assert found.equilibrium @ np.diff(found.edges) == pytest.approx(1.0)


def test_regimes_and_pairs_that_did_not_collide_are_refused():
    with pytest.raises(InputError, match="regimes have shares"):
        analysis.collision_distribution(Histogram("regime", histogram_edges("regime"), np.ones((1, 5), int)))
    with pytest.raises(InputError, match="no collision of pair 0"):
        analysis.collision_distribution(drawn("free_time", []))
    with pytest.raises(InputError, match="pair = 1: must be from 0 to 0"):
        analysis.collision_distribution(drawn("free_time", [1.0]), 1)


@pytest.mark.full
def test_a_run_stores_counts_of_which_the_analysis_takes_those_between_frames(written):
    """All collisions of the run, or those from frame 2 on; a run without the key is refused, with the key named."""
    with written() as file:
        total = file.observables["collisions"]
        assert total[-1] > 20
        found = FUNCTIONS["histograms"](file, None)
        assert {row.name: row.value for row in found.rows}["collisions"] == total[-1]
        later = FUNCTIONS["histograms"](file, range(2, len(file)))
        assert {row.name: row.value for row in later.rows}["collisions"] == total[-1] - total[2]
        assert file.observables["histogram_free_time"][-1].sum() > total[-1]
        figure = pictures.figure(file, "histograms")
        assert [axes.get_title() for axes in figure.axes] == ["angle of impact", "normal speed", "free time"]
        lines = [line for axes in figure.axes for line in axes.lines if line.get_label() == "equilibrium"]
        assert len(lines) == 3
    with written({"output.histograms": None, "output.free_times": None}) as file:
        assert "histogram_regime" not in file.observables
        with pytest.raises(InputError, match=r"output\.histograms = true"):
            FUNCTIONS["histograms"](file, None)
