"""Comparison of laws whose errors are estimated: units, order of rows, few values, robust fits, the next experiment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize
from test_collisions import observed
from test_fit import ALUMINIUM, impacts

import ifrdem
from ifrdem import fit
from ifrdem.fit import model
from ifrdem.fit.laws import LAWS
from ifrdem.fit.likelihood import Likelihood
from ifrdem.fit.maximum import _LawFit

A, E_T, MU = 0.12, -0.8, 0.2
R, NOISE = 0.01, (0.005, 0.5)  # m, m/s, rad/s
CONSTANT, VISCOELASTIC = "ifr-percussion", "ifr-viscoelastic"


def hits(
    seed: int,
    *,
    n: int = 25,
    unit: float = 1.0,
    shuffled: bool = False,
    gaussian: bool = False,
    part: float = 1.0,
) -> fit.Collisions:
    """Impacts on a wall with e_n = 1 - A g_n^(1/5) and Student-t(3) noise, of unknown size; `unit` units in a metre."""
    rng = np.random.default_rng(seed)
    psi, spin, speed = (
        np.radians(rng.uniform(-75.0, 75.0, n)),
        rng.normal(0.0, 10.0, n),
        np.geomspace(0.3, 3.0, n),
    )
    rows = []
    for g, angle, w in zip(speed, psi, spin, strict=True):
        v, e_n = g * np.array([np.sin(angle), -np.cos(angle)]), 1.0 - A * (g * np.cos(angle)) ** 0.2
        out = ifrdem.collide(
            ifrdem.IFRLaw(e_n=e_n, e_t=E_T, mu=MU), np.array([[0.0, -1.0]]), (1.0, np.inf), (R, np.inf), [2, 2],
            np.array([[v, [0.0, 0.0]]]), np.array([[w, 0.0]]),
        )  # fmt: skip
        rows.append([*v, w, *out.velocity[0, 0], out.spin[0, 0]])
    noise = rng.standard_normal((n, 6)) if gaussian else rng.standard_t(3, (n, 6))
    table = np.array(rows) + part * noise * np.array([NOISE[0], NOISE[0], NOISE[1]] * 2)
    if shuffled:
        table = table[rng.permutation(n)]
    names = ("vx_1", "vy_1", "spin_1", "vx_1_after", "vy_1_after", "spin_1_after")
    measured = {
        name: each * (unit if name[0] == "v" else 1.0) for name, each in zip(names, table.T, strict=True)
    }
    return fit.Collisions(
        disk_1=fit.Disk(mass=1.0, radius=R * unit),
        disk_2=fit.WALL,
        measured={"nx": np.zeros(n), "ny": -np.ones(n), **measured},
        errors={"nx": 0.0, "ny": 0.0, **dict.fromkeys(names, np.nan)},
    )


def compared(data: fit.Collisions, *, robust: bool = False, crossed: bool = False) -> fit.Fit:
    return fit.fit(data, model=[CONSTANT, VISCOELASTIC], profile=False, robust=robust, cross_validate=crossed)


@pytest.mark.full
@pytest.mark.parametrize(("unit", "robust"), [(1e6, False), (1e-3, False), (1e3, True), (1e-3, True)])
def test_units_and_the_order_of_rows_change_no_comparison(unit: float, robust: bool) -> None:
    """AIC, BIC and cross-validation by differences, ranks, and the expected gains of a further experiment."""
    found = [compared(hits(3, n=16), robust=robust, crossed=True)]
    found.append(compared(hits(3, n=16, unit=unit, shuffled=True), robust=robust, crossed=True))
    for name in ("log_likelihood", "AIC", "BIC", "cross_validation"):
        one, two = (getattr(f.laws[CONSTANT], name) - getattr(f.laws[VISCOELASTIC], name) for f in found)
        assert one == pytest.approx(two, abs=1e-2)
    assert [each.best for each in found] == [VISCOELASTIC] * 2
    assert found[0].laws[VISCOELASTIC].cross_validation < found[0].laws[CONSTANT].cross_validation - 0.1
    one, two = (fit.design(each, 10, np.array([20.0, 60.0])) for each in found)
    np.testing.assert_allclose(one.against[CONSTANT], two.against[CONSTANT], rtol=1e-2, atol=1e-2)
    np.testing.assert_allclose(one.errors["A"], two.errors["A"] * unit**0.2, rtol=1e-2)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(1, 21))
def test_the_right_law_is_preferred_whatever_the_noise(seed: int) -> None:
    """e_n falls from 0.90 to 0.85 between 0.3 and 3 m/s, which is ten errors of 25 impacts: no table may mislead."""
    for robust in (False, True)[: 1 if seed == 1 else 2]:
        found = compared(hits(seed), robust=robust)
        assert found.best == VISCOELASTIC
        assert found.decided


def test_exact_impacts_that_slow_with_speed_give_the_law_back() -> None:
    """1 - A 32^(1/5) = 1 - 2 A; and the engine's law with this e_n."""
    law = LAWS[VISCOELASTIC]
    assert law.e_n({"A": np.array([0.1])}, 32.0)[0] == pytest.approx(0.8, abs=1e-15)
    data = hits(1, n=12, part=0.0)
    errors = {name: 0.0 if name[0] == "n" else 0.01 if name[0] == "v" else 1.0 for name in data.errors}
    found = fit.fit(replace(data, errors=errors), model=[VISCOELASTIC], profile=False).laws[VISCOELASTIC]
    np.testing.assert_allclose(found.values, [A, E_T, MU], atol=1e-6)


# -- The likelihood of errors --------------------------------------------------------------------------------


def _density(psi: float, i: int, each: fit.Fitted, robust: bool) -> float:
    """Of the three angles of an impact over their errors; the Student-t one without its constant."""
    h = each.problem.predict(each.law, each.values, np.array([[psi]]), np.array([i]))[0]
    c = float(np.sum(((each.problem.y[i] - h) / each.problem.s[i]) ** 2))
    return (1.0 + c / 4.0) ** -3.5 if robust else float(np.exp(-0.5 * c)) / (2.0 * np.pi) ** 1.5


def test_the_likelihood_of_errors_is_the_integral_over_the_true_motion() -> None:
    """By quadrature over psi, of the density of all three angles; of the Student-t one up to a common constant."""
    data = impacts(noise=3, n=5, psi=(12.0, 70.0), error=0.05)
    data = replace(data, errors=dict.fromkeys(data.errors, np.nan))
    for robust in (False, True):
        found = fit.fit(
            data, M=1.0, model=["ifr-percussion"], robust=robust, profile=False, fix={"e_t": -0.88}
        )
        each = found.laws["ifr-percussion"]
        problem, s = each.problem, each.problem.s

        points = Likelihood(problem, each.law, 4.0 if robust else None).at(each.values)
        sizes = np.sum(np.log(2.0 * np.pi * s**2), axis=1)
        mine = points.losses + sizes + points.log_volumes
        span = np.radians((30.0 if robust else 6.0) * float(np.max(s)))
        true = [
            -2.0
            * np.log(
                quad(_density, x - span, x + span, args=(i, each, robust), limit=400, points=[x])[0]
                / np.prod(s[i])
            )
            for i, x in enumerate(points.x[:, 0])
        ]
        if robust:
            np.testing.assert_allclose(np.diff(mine), np.diff(true), atol=0.03)
        else:
            np.testing.assert_allclose(mine, true, atol=0.01)
            assert each.log_likelihood == pytest.approx(-0.5 * float(np.sum(mine)), abs=1e-9)


def test_values_that_are_known_do_not_enter_the_likelihood_of_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their error is a part of that of their kind, which differs from law to law: its size must cancel."""
    data, law, found = hits(2, n=14, gaussian=True), LAWS[VISCOELASTIC], []
    exact = replace(data, errors={**data.errors, "vx_1": 0.0})
    for part in (1e-3, 3e-3):
        monkeypatch.setattr(model, "_EXACT", part)
        problem = exact.problem()
        points = Likelihood(problem, law).at(np.array([A, E_T, MU]))
        climb = _LawFit(exact, problem, law, None, 0.95, False, lambda done: None)
        found.append(points.loss + float(np.sum(climb._normalisation(problem, points))))
    assert found[0] == pytest.approx(found[1], abs=0.1)  # 14 ln 9 = 31 if it did not


def test_an_error_that_may_be_none_is_said_to_be_poorly_known() -> None:
    """Of the wrong law the residuals of velocities are so large that spins seem exact."""
    each = fit.fit(hits(1, gaussian=True), model=[CONSTANT], profile=False).laws[CONSTANT]
    assert np.isinf(each.errors_of_errors["spins"])
    assert each.errors_of_errors["velocities"] < 0.2
    assert each.errors["spins"] == pytest.approx(1e-3 * each.errors["velocities"] / R, rel=1e-6)
    assert any("the error of spins is poorly known" in text for text in each.warnings)
    assert not any("the error of velocities is poorly" in text for text in each.warnings)


def test_errors_given_within_a_group_stay_as_they_are() -> None:
    data = hits(4, gaussian=True)
    found = fit.fit(replace(data, errors={**data.errors, "vx_1": 0.02}), model=[VISCOELASTIC], profile=False)
    each = found.laws[VISCOELASTIC]
    np.testing.assert_allclose(each.problem.s[:, each.problem.names.index("vx_1")], 0.02)
    assert each.errors["velocities"] == pytest.approx(NOISE[0], rel=0.4)


# -- What is added for the coefficients ----------------------------------------------------------------------


def test_few_values_are_corrected_for_or_refused() -> None:
    """AICc: q = 2 coefficients and an error; of 3 impacts with two angles R = 6, of 2 R = 4 = q + 1."""
    unknown = {"errors": dict.fromkeys(("psi", "delta_1", "delta_2"), np.nan)}
    options = {"M": 1.0, "model": ["ifr-percussion", "ifr-contact"], "fix": {"e_t": -0.88}, "profile": False}
    for n, correction in ((3, 2.0 * 3 * 4 / (6 - 4)), (2, np.inf)):
        found = fit.fit(replace(impacts(noise=2, n=n, psi=(15.0, 65.0)), **unknown), **options)
        each = found.laws["ifr-percussion"]
        assert pytest.approx(-2.0 * each.log_likelihood + 6.0 + correction) == each.AIC
        assert pytest.approx(-2.0 * each.log_likelihood + 3.0 * np.log(n)) == each.BIC
        if n == 2:
            assert not found.decided
            assert any(text.startswith("too few values to compare") for text in found.warnings)
            assert "AICc" in fit.table(found)


def test_the_penalty_of_a_robust_fit_is_the_scatter_over_the_curvature() -> None:
    """2 tr(V H^-1), with V and H that other tests compare with differences of the loss."""
    each = fit.fit(observed(20), model=["ifr-percussion"], robust=True, profile=False).laws["ifr-percussion"]
    points = Likelihood(each.problem, each.law, 4.0).at(each.values)
    expected = 2.0 * np.trace(points.scatter @ np.linalg.inv(points.curvature))
    problem = each.problem
    constant = float(np.sum(np.log(2.0 * np.pi * problem.s**2)))
    assert pytest.approx(points.loss + constant + expected, abs=1e-6) == each.AIC
    assert 2.0 < expected < 7.0  # 2 p for data of nu = 4; lighter tails gain less, and 20 impacts scatter


def test_curvature_has_that_of_the_student_t_weights() -> None:
    """By second differences; errors are so small that the law is straight over them, and three impacts are far out."""
    data = observed(20, 1e-4, seed=3)
    measured = {name: value.copy() for name, value in data.measured.items()}
    measured["vx_1_after"][[2, 9, 15]] += [8e-4, -6e-4, 7e-4]
    likelihood = Likelihood(replace(data, measured=measured).problem(), LAWS["ifr-percussion"], robust=4.0)
    at, h = np.array([0.87, -0.88, 0.21]), 1e-5 * np.eye(3)
    points = likelihood.at(at)
    second = [
        [likelihood.at(at + a + b).loss - likelihood.at(at + a - b).loss - likelihood.at(at - a + b).loss
         + likelihood.at(at - a - b).loss for b in h] for a in h
    ]  # fmt: skip
    scale = np.sqrt(np.outer(np.diag(points.information), np.diag(points.information)))
    np.testing.assert_allclose(np.array(second) / 8e-10 / scale, points.curvature / scale, atol=0.01)
    assert np.max(np.abs(points.curvature - points.information) / scale) > 0.05


# -- The next experiment -------------------------------------------------------------------------------------


@pytest.mark.full
def test_further_impacts_never_raise_an_error_of_a_robust_fit() -> None:
    found = fit.fit(hits(5, n=14), model=[VISCOELASTIC], robust=True, profile=False)
    planned = fit.design(found, 10, np.array([5.0, 45.0, 80.0]))
    for name, errors in planned.errors.items():
        assert np.all(errors <= planned.now[name])
    one = found.laws[VISCOELASTIC]
    further = one.problem.at(one.law, one.values, np.full(10, np.radians(45.0)))
    information = np.linalg.inv(one.covariance) + Likelihood(further, one.law).at(one.values).information
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    np.testing.assert_allclose([each[1] for each in planned.errors.values()], expected, rtol=1e-6)


@pytest.mark.full(keep=("True",))
@pytest.mark.parametrize("robust", [False, True])
def test_expected_gain_is_that_of_a_law_fitted_again(robust: bool) -> None:
    """The other law fitted to what is known and to an exact impact more, with the errors of the best law.

    The rest of its distance, which a new fit cannot take away, is large; what it can is compared. Half of the impacts
    are far out, so that their weights matter.
    """
    data = impacts(noise=7, error=1.0)
    moved = data.measured["delta_1"] + np.where(np.arange(20) % 2, 5.0, 0.0) * robust
    laws = ["ifr-percussion", "ifr-contact"]
    found = fit.fit(
        replace(data, measured={**data.measured, "delta_1": moved}),
        M=1.0,
        model=laws,
        robust=robust,
        profile=False,
    )
    best, other = (found.laws[name] for name in (found.best, *(name for name in laws if name != found.best)))
    angles = np.array([30.0, 50.0])
    planned = fit.design(found, 1, angles).against[other.law.name]
    known = Likelihood(best.problem, other.law, found.robust)
    for angle, gain in zip(np.radians(angles), planned, strict=True):
        new = Likelihood(best.problem.at(best.law, best.values, np.array([angle])), other.law, found.robust)
        again = minimize(
            lambda x, new=new: known.at(x).loss + new.at(x).loss, other.values, method="Nelder-Mead",
            options={"xatol": 1e-6, "fatol": 1e-6},
        ).fun  # fmt: skip
        most = new.at(other.values).loss
        assert most - gain == pytest.approx(most - again + known.at(other.values).loss, rel=0.35)


# -- Marks and errors on data of known truth -----------------------------------------------------------------


@pytest.mark.full
def test_marks_are_as_rare_as_promised_and_errors_cover() -> None:
    """Of smooth disks: suspects in 1 % of tables, doubts about chi2 in 2 %.

    Errors of e_n, and of the error where it is estimated, are those of the scatter: of 100 the standard deviation is
    known to 7 %.
    """
    tables, suspects, doubts, pulls, sizes = 100, 0, 0, [], []
    for seed in range(tables):
        data = impacts((0.8, -1.0, 0.0), ("delta_1", "delta_2"), noise=seed, n=6, psi=(20.0, 70.0))
        (each,) = fit.fit(data, M=1.0, model=["smooth"], profile=False).laws.values()
        suspects += bool(each.suspects)
        doubts += any(text.startswith("chi2") for text in each.warnings)
        unknown = replace(data, errors=dict.fromkeys(data.errors, np.nan))
        (each,) = fit.fit(unknown, M=1.0, model=["smooth"], profile=False).laws.values()
        pulls.append((each.values[0] - 0.8) / each.estimates["e_n"].standard_error)
        sizes.append(np.log(each.errors["angles"] / 0.7) / each.errors_of_errors["angles"])
        assert not any("poorly known" in text for text in each.warnings)
    dof = each.dof  # 18 angles less 6 true ones and a coefficient
    assert dof == 11
    assert each.errors_of_errors["angles"] == pytest.approx(np.sqrt(0.5 / dof), rel=0.1)
    half = 0.5 * (each.estimates["e_n"].interval.high - each.estimates["e_n"].interval.low)
    assert half == pytest.approx(2.201 * each.estimates["e_n"].standard_error, rel=1e-3)  # t of 11, 97.5 %
    assert suspects <= 0.04 * tables + 1  # exceeded by chance in one of 1,000 cases
    assert doubts <= 0.06 * tables + 2
    # Student's t with 11 degrees of freedom has the standard deviation sqrt(11/9) = 1.11
    assert 0.65 < np.std(pulls) < 1.6
    assert abs(np.mean(pulls)) < 0.8
    assert 0.6 < np.std(sizes) < 1.45
    assert abs(np.mean(sizes)) < 0.9  # the logarithm is too low by 1 / (2 R), a fifth of its error


def test_an_impact_is_suspicious_below_one_percent_among_all() -> None:
    """Of 20 impacts below a probability of 0.01 / 20, by chi-square with 2 degrees of freedom: exp(-distance / 2)."""
    classes = set()
    for shift in (1.5, 2.7, 4.5):
        data = impacts((0.8, -1.0, 0.0), psi=(30.0, 70.0))
        moved = data.measured["delta_1"] + np.where(np.arange(20) == 12, shift, 0.0)
        data = replace(data, measured={**data.measured, "delta_1": moved})
        (each,) = fit.fit(data, M=1.0, model=["smooth"], profile=False).laws.values()
        probability = np.exp(-0.5 * each.distance)
        assert [one.index for one in each.suspects] == np.flatnonzero(probability < 5e-4).tolist()
        classes.add(int(np.searchsorted([5e-4, 0.01], np.min(probability))))
    assert classes == {0, 1, 2}


def test_intervals_and_scoring_of_a_robust_fit_follow_from_the_scatter() -> None:
    """The profile rises as far as the scatter says: half an interval is Student's t times the standard error.

    Of errors nu = 4 and m = 2 degrees of freedom, the information on ln s^2 is nu m / (nu + m + 2) = 1 an impact.
    """
    data = impacts(noise=3, n=30)
    robust = fit.fit(data, M=1.0, model=["smooth"], robust=True).laws["smooth"]
    e_n = robust.estimates["e_n"]
    half = 0.5 * (e_n.interval.high - e_n.interval.low)
    assert half == pytest.approx(2.045 * e_n.standard_error, rel=0.1)  # t of 29, 97.5 %
    points = Likelihood(robust.problem, robust.law, 4.0).at(robust.values)
    plain = float(np.sqrt(1.0 / points.curvature[0, 0]))
    assert abs(plain / e_n.standard_error - 1.0) > 0.15
    unknown = replace(impacts((0.8, -1.0, 0.0), noise=3, n=30), errors=dict.fromkeys(data.errors, np.nan))
    scored = fit.fit(unknown, M=1.0, model=["smooth"], robust=True, profile=False).laws["smooth"]
    assert scored.errors_of_errors["angles"] == pytest.approx(np.sqrt(0.5 / 30.0), rel=0.1)


def test_folds_of_many_impacts_do_not_depend_on_the_order() -> None:
    data = impacts((0.8, -1.0, 0.0), noise=5, n=35)
    order = np.random.default_rng(2).permutation(35)
    turned = fit.Data(
        psi=data.psi[order],
        measured={name: each[order] for name, each in data.measured.items()},
        errors=data.errors,
    )
    one, two = (
        fit.fit(each, M=1.0, model=["smooth"], profile=False, cross_validate=True).laws["smooth"]
        for each in (data, turned)
    )
    assert one.cross_validation == pytest.approx(two.cross_validation, abs=1e-6)


def test_copied_lines_are_named() -> None:
    data = impacts(noise=4, n=6)
    twice = {name: np.append(value, value[2]) for name, value in data.measured.items()}
    again = fit.Data(
        psi=np.append(data.psi, data.psi[2]), measured=twice, errors=dict.fromkeys(("psi", *twice), 0.7),
        line=np.arange(2, 9),
    )  # fmt: skip
    found = fit.fit(again, M=1.0, model=["smooth"], profile=False)
    assert (
        "line 4 and line 8: equal in every value: if they are copies, all standard errors are too small"
        in (found.warnings)
    )
    assert not any(
        "copies" in text for text in fit.fit(data, M=1.0, model=["smooth"], profile=False).warnings
    )


@pytest.mark.full
def test_one_impact_far_off_costs_no_more_than_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A typing error, 90 errors off: its loss has many minima, whose profile took some 3,000 evaluations."""
    data = impacts(ALUMINIUM, noise=1, n=18)
    measured = {**data.measured, "delta_1": data.measured["delta_1"].copy()}
    measured["delta_1"][14] = 3.0
    calls = []
    at = Likelihood.at
    monkeypatch.setattr(Likelihood, "at", lambda self, values: calls.append(1) or at(self, values))
    found = fit.fit(replace(data, measured=measured), M=1.0, model=["ifr-percussion"]).laws["ifr-percussion"]
    assert any("of chi2 is that of one impact" in text for text in found.warnings)
    assert {each.index for each in found.suspects} >= {14}
    assert len(calls) < 900
    clean = dict(zip(("e_n", "e_t", "mu"), ALUMINIUM, strict=True))
    for name, value in found.without.items():
        assert value == pytest.approx(clean[name], abs=0.1)
