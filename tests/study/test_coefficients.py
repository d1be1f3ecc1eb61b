"""Coefficients drawn from the errors of a case: their distribution, and the parts of the spread that they give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from test_study import CASE

import ifrdem
from ifrdem.case import file as case_file
from ifrdem.case.case import CaseSections
from ifrdem.errors import InputError
from ifrdem.study import draws, pooled
from ifrdem.study.contents import describe
from ifrdem.study.figure import draw
from ifrdem.study.results import Results, Variable, means_over_seeds, window_starts

ERRORS = """
errors = { e_n = 0.01, e_t = 0.02, mu = 0.005 }
correlations = { e_t = { mu = -0.6 } }
"""
DRAWN = CASE.replace("[[material]]", f"[[material]]{ERRORS}", 1)


def sections(text: str) -> CaseSections:
    """The case of a text."""
    return case_file.of_text(text, Path("gas.toml")).case


def test_draws_have_the_errors_and_correlations_of_the_case() -> None:
    """Of n draws the variance is known to sqrt(2/n), the correlation r to (1 - r^2)/sqrt(n); four of these errors."""
    case, n = sections(DRAWN), 4000
    found = draws.drawn(case, n, lambda _: True)
    assert found.keys == ("material[0].e_n", "material[0].e_t", "material[0].mu")
    values, material = np.array(found.values), case.material[0]
    means = np.array([getattr(material, name) for name in ("e_n", "e_t", "mu")])
    sigma = np.array([0.01, 0.02, 0.005])
    assert np.all(np.abs(values.mean(axis=0) - means) < 4.0 * sigma / np.sqrt(n))
    assert np.all(np.abs(values.var(axis=0) / sigma**2 - 1.0) < 4.0 * np.sqrt(2.0 / n))
    correlation = np.corrcoef(values.T)
    assert correlation[1, 2] == pytest.approx(-0.6, abs=4.0 * 0.64 / np.sqrt(n))
    assert abs(correlation[0, 1]) < 4.0 / np.sqrt(n)
    assert draws.drawn(case, 3, lambda _: True).values == found.values[:3]  # a longer study keeps its runs


def test_draws_that_the_laws_do_not_allow_are_repeated_and_counted() -> None:
    """About half of the draws around e_t = -1 lie beyond it; e_n = 1 +- 0.01 the same."""
    text = DRAWN.replace("e_t = 0.02", "e_t = 0.2")
    tried: list[str] = []

    def allowed(changes) -> bool:
        tried.append(changes[1])
        return float(changes[1].partition("=")[2]) >= -0.88

    found = draws.drawn(sections(text), 50, allowed)
    assert min(row[1] for row in found.values) >= -0.88
    assert found.refused == len(tried) - 50 > 10
    assert f"truncated: {found.refused} of {len(tried)} draws" in found.text
    with pytest.raises(InputError, match="of 1000 draws the laws allow none"):
        draws.drawn(sections(text), 2, lambda _: False)
    with pytest.raises(InputError, match="coefficients = 5: no coefficient has an error: give errors"):
        draws.drawn(sections(CASE), 5, lambda _: True)


def layout(rng: np.random.Generator, C: int, S: int, a: float, b: float, e: float, gases: int) -> Results:
    """Gases whose temperature is 1 with a spread `a` by draws, `b` by seeds, and `e` of each run."""
    x = 1.0 + a * rng.standard_normal((gases, C, 1)) + b * rng.standard_normal((gases, 1, S))
    x = x + e * rng.standard_normal((gases, C, S))
    found = {
        "gas": Variable(("gas",), np.arange(gases)),
        draws.COEFFICIENTS: Variable((draws.COEFFICIENTS,), np.arange(C)),
        "seed": Variable(("seed",), np.arange(S)),
        "time": Variable(("time",), np.arange(1.0)),
    }
    T = Variable(("gas", draws.COEFFICIENTS, "seed", "time"), x[..., None])
    axes = f'{{"gas": ["gas"], "{draws.COEFFICIENTS}": ["{draws.COEFFICIENTS}"]}}'
    keys = f'{{"gas": "gas", "{draws.COEFFICIENTS}": "{draws.COEFFICIENTS}"}}'
    return Results(found | means_over_seeds({"temperature": T}, 2), {"axes": axes, "keys": keys})


def test_the_two_parts_of_the_spread_are_told_apart() -> None:
    """Means over 400 gases against the truth: var(a) = 0.04 of 10 draws is known to 0.04 sqrt(2/9/400) and the rest.

    The mean over S seeds has the variance b^2/S + e^2/(C S), whatever the coefficients.
    """
    a, b, e, C, S, gases = 0.2, 0.3, 0.5, 10, 4, 400
    found = pooled.pooled(layout(np.random.default_rng(1), C, S, a, b, e, gases))
    assert list(found.axes) == ["gas"]
    variance = found.values("temperature_by_coefficients")[:, 0] ** 2
    # By the mean squares (a^2 + e^2/S)^2 2/(C - 1) + ..., and what is cut off at 0, which is rare here.
    scatter = (a**2 + e**2 / S) * np.sqrt(2.0 / (C - 1) / gases)
    assert np.mean(variance) == pytest.approx(a**2, abs=4.0 * scatter + 0.004)
    expected = b**2 / S + e**2 / (C * S)
    squares = found.values("temperature_error")[:, 0] ** 2
    assert np.mean(squares) == pytest.approx(expected, rel=4.0 * np.sqrt(2.0 / (S - 1) / gases))
    no_spread = pooled.pooled(layout(np.random.default_rng(2), C, S, 0.0, b, e, gases))
    assert (
        np.mean(no_spread.values("temperature_by_coefficients")[:, 0] ** 2) < 0.05
    )  # e^2/S = 0.06 is not taken for it


@pytest.mark.parametrize(("C", "S", "b"), [(6, 3, 0.02), (20, 5, 0.3)])
def test_the_wide_interval_holds_the_gas_of_the_true_coefficients(C: int, S: int, b: float) -> None:
    """Fitted coefficients are off by one error a, and draws lie around these: 95 % of 2000 intervals hold the truth.

    The binomial error is 0.005. Two independent parts of an interval that add up by squares hold at least as much as
    each alone, and at most 0.98 here.
    """
    rng, a, gases = np.random.default_rng(C), 0.2, 2000
    found = pooled.pooled(layout(rng, C, S, a, b, 0.05, gases))
    half = pooled.half_of_both(found, "temperature")
    assert half is not None
    truth = 1.0 + a * rng.standard_normal(gases)  # draws are around the fit, and so is the truth
    inside = np.abs(found.values("temperature_mean")[:, 0] - truth) < half[:, 0]
    assert 0.935 < np.mean(inside) < 0.985


def test_pooled_gases_have_the_windows_of_their_draws() -> None:
    """They had none, and lines of theory took the second half of a driven gas."""
    found = layout(np.random.default_rng(3), 5, 3, 0.2, 0.3, 0.1, 2)
    dims = ("gas", draws.COEFFICIENTS, "seed")
    n_eff = np.array([[[20.0]], [[np.nan]]]) * np.ones((1, 5, 3))  # the second gas cools
    found.variables["temperature_n_eff"] = Variable(dims, n_eff)
    n_eff[0, 2] = np.nan  # runs that are missing
    found.variables["analyses_from"] = Variable(dims[:2], np.array([[4.0, 4.0, np.nan, 4.0, 4.0], [0.0] * 5]))
    np.testing.assert_array_equal(window_starts(pooled.pooled(found)), [4.0, np.nan])


def test_a_draw_with_a_missing_run_is_left_out() -> None:
    found = layout(np.random.default_rng(3), 5, 3, 0.2, 0.3, 0.1, 2)
    whole = found.values("temperature")
    whole[0, 4, 1] = np.nan
    less = pooled.pooled(found)
    assert less.values("temperature_mean")[0, 0] == pytest.approx(whole[0, :4].mean())
    assert less.values("temperature_mean")[1, 0] == pytest.approx(whole[1].mean())


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> ifrdem.Study:
    """Four sets of coefficients and two seeds."""
    folder = tmp_path_factory.mktemp("coefficients")
    (folder / "gas.toml").write_text(DRAWN)
    found = ifrdem.Study(folder / "gas.toml", coefficients=4, seeds=2, output=folder / "s")
    assert found.run(workers=0) == {}
    return found


def test_a_study_runs_each_set_with_each_seed(study: ifrdem.Study) -> None:
    results = study.results()
    assert study.plan.shape == (4, 2)
    assert results.values("e_t").tolist() == [row[1] for row in study.plan.draws.values]
    T = results.values("temperature")
    assert np.array_equal(T[0, :, 0], T[3, :, 0])  # the same start of a seed
    assert len({*T[:, 0, -1].tolist()}) == 4
    single = study.tasks[0].file().case.material[0]
    assert [single.e_n, single.e_t, single.mu] == [*study.plan.draws.values[0]]
    assert any(
        "4 sets of coefficients, Gaussian with the errors of the case" in line for line in study.summary()
    )


@pytest.mark.full
def test_prediction_table_and_figure_have_both_parts(study: ifrdem.Study) -> None:
    found = study.prediction()
    assert "coefficients" not in found.dims
    by_draw = study.results().values("temperature").mean(axis=1)[:, -1]
    assert float(found.temperature_mean[-1]) == pytest.approx(by_draw.mean())
    assert found.temperature_theory.values[-1] == pytest.approx(
        study.dataset().temperature_theory.values[:, -1].mean()
    )
    text = describe(study.output)
    assert (
        "4 sets of coefficients, Gaussian with the errors of the case; by coefficients: standard deviation"
        in text
    )
    row = next(line for line in text.splitlines() if line.split()[:1] == ["temperature"])
    assert f"{float(found.temperature_by_coefficients[-1]):.6g}" in row
    head, *rows = describe(study.output, csv=True).splitlines()
    assert head.split(",")[-2:] == ["by_coefficients", "unit"]
    assert len(rows[0].split(",")) == len(head.split(","))
    (axes,) = draw(study.results(), "T", "tau").axes
    bands = [each.get_paths() for each in axes.collections if isinstance(each, PolyCollection)]
    wide, narrow = (paths[0].vertices for paths in bands if paths)  # others are of the legend
    last = narrow[:, 0].max()
    high, low = (np.ptp(each[each[:, 0] == last, 1]) for each in (wide, narrow))
    half = float(found.temperature_half_interval[-1])
    assert high == pytest.approx(2.0 * half)
    # Student's t of 2 seeds and of 4 draws, whose mean is off by a further quarter of their variance.
    parts = 12.706 * found.temperature_error[-1], 3.1824 * 1.25**0.5 * found.temperature_by_coefficients[-1]
    assert half == pytest.approx(np.hypot(*map(float, parts)), rel=1e-4)
    assert found.temperature_half_interval.long_name.endswith(
        ": half the 95 % interval, by seeds and errors of coefficients"
    )
    assert low == pytest.approx(
        2.0 * 12.706 * float(found.temperature_error[-1]), rel=1e-4
    )  # t of one degree of freedom
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert any("2 seeds, and errors of coefficients (4 draws)" in each for each in labels)
    each_draw = draw(study.results(), "T", "tau", "coefficients").axes[0]
    assert len([line for line in each_draw.lines if not str(line.get_label()).startswith("_")]) >= 4


def test_what_does_not_go_with_coefficients_is_refused(toml: Path) -> None:
    toml.write_text(DRAWN)
    with pytest.raises(InputError, match=r"material\[0\]\.e_n: two axes of this name"):
        ifrdem.Study(toml, vary=["material[0].e_n=0.7,0.9"], coefficients=3)
    with pytest.raises(InputError, match="coefficients = 1: must be an integer"):
        ifrdem.Study(toml, coefficients=1)
    (toml.parent / "s.toml").write_text(
        f'case = "{toml.name}"\n[[variants]]\nname = "a"\n[ensemble]\ncoefficients = 2'
    )
    with pytest.raises(InputError, match="coefficients: cannot be combined with variants"):
        ifrdem.Study(toml.parent / "s.toml")
