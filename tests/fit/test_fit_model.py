"""The forward model of a fit against the paper's closed forms, and its likelihood against plain searches."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.fit import missing
from ifrdem.fit.data import Data
from ifrdem.fit.laws import LAWS, Law
from ifrdem.fit.likelihood import Likelihood, covariance_of
from ifrdem.fit.maximum import _rolling, _Scoring
from ifrdem.fit.model import MEASURED as QUANTITIES
from ifrdem.fit.model import AngleProblem, Pair
from ifrdem.model.laws.ifr import Regime
from ifrdem.validation.paper import equations
from ifrdem.validation.paper.equations import Impact

BOTH = pytest.mark.parametrize("sticking", ["percussion_center", "contact_point"])
STICKS = {
    "percussion_center": (
        equations.PERCUSSION_CENTER.tan_delta_1,
        equations.PERCUSSION_CENTER.tan_delta_2,
        equations.PERCUSSION_CENTER.e_t_apparent,
        equations.PERCUSSION_CENTER.Rw_2_rolling,
        equations.PERCUSSION_CENTER.tan_psi_transit,
    ),
    "contact_point": (
        equations.CONTACT_POINT.tan_delta_1,
        equations.CONTACT_POINT.tan_delta_2,
        equations.CONTACT_POINT.e_t_apparent,
        equations.CONTACT_POINT.Rw_2_rolling,
        equations.CONTACT_POINT.tan_psi_transit,
    ),
}
SLIDES = (
    equations.SLIDING.tan_delta_1,
    equations.SLIDING.tan_delta_2,
    equations.SLIDING.e_t_apparent,
    equations.SLIDING.Rw_2_rolling,
)
NAME = {"percussion_center": "ifr-percussion", "contact_point": "ifr-contact"}
MEASURED = ("delta_1", "delta_2", "Rw_2", "sqrt_d2_d1", "e_t_apparent")
LAW = {"e_n": 0.87, "e_t": -0.88, "mu": 0.21}
COEFFICIENTS = np.array([*LAW.values()])


def law_of(sticking: str, *, rolling: bool = False) -> Law:
    return _rolling(LAWS[NAME[sticking]], 10.0) if rolling else LAWS[NAME[sticking]]


def blank(names: tuple[str, ...], pair: Pair, n: int) -> AngleProblem:
    return AngleProblem(
        ("psi", *names),
        np.zeros((n, 1 + len(names))),
        np.ones((n, 1 + len(names))),
        ["angles"] * (1 + len(names)),
        pair,
    )


def predict(
    sticking: str, pair: Pair, coefficients: np.ndarray, psi: np.ndarray, names: tuple[str, ...]
) -> np.ndarray:
    """Predictions (..., len(names)) at impact angles [rad]."""
    law = law_of(sticking, rolling=len(coefficients) > 3)
    return blank(names, pair, len(psi)).predict(law, coefficients, psi[:, None])[..., 1:]


def impact(psi: np.ndarray, M: float, rho: float = 0.0) -> Impact:
    return Impact(psi, **LAW, M=M, R_1=1.4, R_2=1.2, rho=rho)


@BOTH
@pytest.mark.parametrize("M", [0.6, 1.3])  # M < e_n: disk 1 bounces back
def test_predictions_follow_eqs_18_to_28_in_both_regimes(sticking: str, M: float) -> None:
    psi = np.radians(np.linspace(1.0, 85.0, 60))
    c = impact(psi, M)
    got = dict(zip(MEASURED, predict(sticking, Pair(M=M), COEFFICIENTS, psi, MEASURED).T, strict=True))
    tan_1, tan_2, e_t_apparent, _, transit = STICKS[sticking]
    sticks = np.tan(psi) < transit(c)
    assert 10 < np.sum(sticks) < 50
    v_1n = equations.v_1n(c)
    for mine, slide, stick in (
        (np.tan(np.radians(got["delta_1"])), SLIDES[0], tan_1),
        (np.tan(np.radians(got["delta_2"])), SLIDES[1], tan_2),
        (got["e_t_apparent"], SLIDES[2], e_t_apparent),
    ):
        np.testing.assert_allclose(mine, np.where(sticks, stick(c), slide(c)), rtol=1e-10)
    # Eq. 29 with the speeds of Eqs. 6, 7 and of the tangents above.
    tan_1_here = np.where(sticks, tan_1(c), SLIDES[0](c))
    tan_2_here = np.where(sticks, tan_2(c), SLIDES[1](c))
    ratio = equations.v_2n(c) * np.hypot(1.0, tan_2_here) / np.abs(v_1n * np.hypot(1.0, tan_1_here))
    np.testing.assert_allclose(got["sqrt_d2_d1"], ratio, rtol=1e-10)
    assert np.all((got["delta_1"] > 90.0) == (v_1n < 0.0))


@BOTH
def test_spin_with_rolling_friction_follows_eqs_34_37_40_beyond_the_nonrolling_angle(sticking: str) -> None:
    rho, M = 0.03, 1.3
    psi = np.radians(np.linspace(1.0, 85.0, 200))
    c = impact(psi, M, rho)
    pair = Pair(M=M, R_1=1.4, R_2=1.2)
    law = law_of(sticking, rolling=True)
    coefficients = np.array([*LAW.values(), rho])
    rolls = equations.T_rolling(c) < equations.T_nonrolling(c)
    sticks = np.tan(psi) < STICKS[sticking][4](c)
    expected = np.where(sticks, STICKS[sticking][3](c), SLIDES[3](c))
    problem = blank(("Rw_2",), pair, len(psi))
    got = problem.predict(law, coefficients, psi[:, None])[:, 1]
    np.testing.assert_allclose(got[rolls], expected[rolls], rtol=1e-10)
    # The angles between which the curve is smooth are those where the regime changes.
    edges = problem.edges(law, coefficients)[0]
    inner = np.array([e + d for e in edges[1:-1] for d in (-1e-9, 1e-9)])
    sides = blank(("Rw_2",), pair, len(inner)).regimes(law, coefficients, inner[:, None])
    assert np.all(np.diff(sides)[::2] != 0)
    regimes = problem.regimes(law, coefficients, psi[:, None])
    changes = 0.5 * (psi[1:] + psi[:-1])[np.diff(regimes) != 0]
    np.testing.assert_allclose(changes, edges[1:-1], atol=psi[1] - psi[0])
    assert set(regimes[rolls]) == {Regime.SLIDING_ROLLING, Regime.STICKING_ROLLING}


def test_transition_holds_for_any_k() -> None:
    """Eq. 12 gives m_n/m_t mu (1 + e_n), with m_n/m_t = (1 + k_1 + M (1 + k_2)) / (1 + M); Eq. 15 gives Eq. 25."""
    pair = Pair(M=1.7, k_1=1.0, k_2=2.5)
    mean = (2.0 + 1.7 * 3.5) / 2.7
    for sticking, factor in (("contact_point", mean), ("percussion_center", 2.0)):
        problem = blank(("delta_2",), pair, 1)
        (transition,) = law_of(sticking).transitions(COEFFICIENTS, problem.probe())
        np.testing.assert_allclose(np.tan(transition), factor * 0.21 * 1.87, rtol=1e-12)


def test_impossible_pairs_are_refused() -> None:
    for wrong, message in (
        ({"M": -1}, "M = -1: must be 0 or more"),
        ({"M": 1.0, "k_2": float("nan")}, "k_2 = nan: must be"),
        ({"M": 1.0, "R_1": 0.1}, "R_1 = 0.1, R_2 = None: must be both radii"),
    ):
        with pytest.raises(InputError, match=message):
            Pair(**wrong)


def synthetic(names: tuple[str, ...], error: float, *, n: int, seed: int, M: float = 1.0) -> Data:
    """Impacts of aluminium coins, psi 4 to 75 degrees, with this error [deg] in every angle."""
    rng = np.random.default_rng(seed)
    psi = np.linspace(4.0, 75.0, n)
    exact = predict("percussion_center", Pair(M=M, R_1=1.0, R_2=1.0), COEFFICIENTS, np.radians(psi), names)
    return Data(
        psi=psi + error * rng.standard_normal(n),
        measured={name: exact[:, i] + error * rng.standard_normal(n) for i, name in enumerate(names)},
        errors=dict.fromkeys(("psi", *names), error),
    )


NAMES = ("delta_1", "delta_2")
PLACED_BY_CHECK = np.array([[0.85, -0.9, 0.2], [0.7, -0.95, 0.3], [0.95, -0.6, 0.1], [0.87, -0.88, 0.21]])


@pytest.mark.full(keep=1)
@BOTH
def test_distances_are_the_least_over_all_true_angles(sticking: str) -> None:
    """Against a fine grid of true angles; delta_1 at M = 1 climbs 14 degrees a degree at the smallest angles."""
    data, law = synthetic(NAMES, 1.0, n=20, seed=1), law_of(sticking)
    grid = np.radians(np.linspace(1e-3, 89.9, 200_001))
    likelihood = Likelihood(data.problem(Pair(M=1.0)), law)
    for coefficients in PLACED_BY_CHECK:
        mine = likelihood.at(coefficients).loss
        curve = predict(sticking, Pair(M=1.0), coefficients, grid, NAMES)
        least = 0.0
        for i in range(len(data)):
            distance = (data.psi[i] - np.degrees(grid)) ** 2 + np.sum(
                (np.array([data.measured[name][i] for name in NAMES]) - curve) ** 2, axis=-1
            )
            least += np.min(distance)
        assert mine <= least + 1e-9
        assert mine == pytest.approx(least, rel=1e-5)  # the grid's step: 5e-4 of an error


def test_distance_from_a_straight_line_is_the_effective_variance() -> None:
    """For one quantity and small errors chi2 = sum (y - f)^2 / (s_y^2 + f'^2 s_psi^2), up to the curve's bend."""
    data = synthetic(("delta_2",), 0.01, n=40, seed=2)
    away = np.abs(np.tan(np.radians(data.psi)) - 2.0 * 0.21 * 1.87) > 0.02  # not next to the corner
    data = Data(
        psi=data.psi[away],
        measured={"delta_2": data.measured["delta_2"][away]},
        errors={"psi": 0.01, "delta_2": 0.02},
    )
    psi, h = np.radians(data.psi), 1e-5
    f, up, down = (
        predict("percussion_center", Pair(M=1.0), COEFFICIENTS, psi + d, ("delta_2",))[:, 0]
        for d in (0.0, h, -h)
    )
    variance = 0.02**2 + ((up - down) / np.degrees(2.0 * h)) ** 2 * 0.01**2
    expected = np.sum((data.measured["delta_2"] - f) ** 2 / variance)
    got = Likelihood(data.problem(Pair(M=1.0)), law_of("percussion_center")).at(COEFFICIENTS).loss
    assert got == pytest.approx(expected, rel=1e-3)  # bend times error, 1e-4 rad


@BOTH
@pytest.mark.parametrize("names", [("delta_2",), NAMES, ("delta_2", "Rw_2")])
def test_derivatives_of_chi2_are_those_of_its_differences(sticking: str, names: tuple[str, ...]) -> None:
    rolling = "Rw_2" in names
    problem = synthetic(names, 0.7, n=20, seed=3, M=1.3).problem(Pair(M=1.3, R_1=1.0, R_2=1.2))
    likelihood = Likelihood(problem, law_of(sticking, rolling=rolling))
    for start in PLACED_BY_CHECK:
        free = np.append(start, 0.03) if rolling else start
        h = 1e-5 * np.eye(len(free))
        expected = (
            np.array([likelihood.at(free + one).loss - likelihood.at(free - one).loss for one in h]) / 2e-5
        )
        residual, jacobian = likelihood.at(free).as_least_squares()
        got = 2.0 * residual @ jacobian
        # One-sided steps of 1e-6 in the code; a point that changes sides within 1e-5 would show as 1e-5 of chi2''.
        np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


def test_information_is_half_the_curvature_of_chi2_where_the_fit_is_exact() -> None:
    """Without residuals chi2'' = 2 J^T J, with the true angles following: what standard errors are made of."""
    psi = np.linspace(4.0, 75.0, 20)
    exact = predict("contact_point", Pair(M=1.3), COEFFICIENTS, np.radians(psi), NAMES)
    data = Data(
        psi=psi,
        measured=dict(zip(NAMES, exact.T, strict=True)),
        errors={"psi": 1.0, "delta_1": 0.5, "delta_2": 0.7},
    )
    likelihood = Likelihood(data.problem(Pair(M=1.3)), law_of("contact_point"))
    best, h = COEFFICIENTS, 1e-4
    pairs = [(i, j) for i in range(3) for j in range(3)]
    e = h * np.eye(3)
    corners = np.array(
        [best + a * e[i] + b * e[j] for i, j in pairs for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    )
    chi2 = np.array([likelihood.at(corner).loss for corner in corners]).reshape(3, 3, 4)
    curvature = (chi2[..., 0] - chi2[..., 1] - chi2[..., 2] + chi2[..., 3]) / (4.0 * h**2)
    information = likelihood.at(best).information
    scale = np.sqrt(np.outer(np.diag(information), np.diag(information)))
    np.testing.assert_allclose(
        0.5 * curvature / scale, information / scale, atol=2e-3
    )  # h over the widths, 1e-2


def test_advice_names_what_would_determine_every_one_of_the_coefficients() -> None:
    """Errors by finite differences: psi is measured too, so an error of psi moves all other values of an impact.

    With psi and delta_2, delta_1 would make the error of e_n 20 times smaller, but not that of e_t: no help for both.
    """
    names, pair, error = ("delta_2",), Pair(M=1.0), 0.5
    psi = np.radians(np.linspace(5.0, 80.0, 16))
    others = [name for name in QUANTITIES if name not in names]
    sizes = np.array(
        [error if QUANTITIES[name].unit == "deg" else np.radians(error) for name in (*names, *others)]
    )

    def values(psi: np.ndarray, coefficients: np.ndarray = COEFFICIENTS) -> np.ndarray:
        return predict("contact_point", pair, coefficients, psi, (*names, *others)) / sizes

    step = 1e-6
    by_psi = np.radians(error) * (values(psi + step) - values(psi - step)) / (2.0 * step)
    ends = [[values(psi, COEFFICIENTS + sign * step * one) for sign in (1, -1)] for one in np.eye(3)]
    by = np.stack(
        [(high - low) / (2.0 * step) for high, low in ends], axis=-1
    )  # (impacts, values, coefficients)

    def errors(which: list[int]) -> np.ndarray:
        information = np.zeros((3, 3))
        for d, J in zip(by_psi[:, which], by[:, which], strict=True):
            information += J.T @ np.linalg.solve(np.eye(len(which)) + np.outer(d, d), J)
        return np.sqrt(np.diag(np.linalg.inv(information)))[:2]

    less = {name: errors([0, 1 + i]) / errors([0]) for i, name in enumerate(others)}
    assert less["delta_1"][0] < 0.1
    assert less["delta_1"][1] > 0.6
    expected = [(name,) for name, each in less.items() if each.max() < 0.5]
    assert expected
    columns = ("psi", *names)
    s = np.full((16, 2), error)
    y = blank(names, pair, 16).predict(law_of("contact_point"), COEFFICIENTS, psi[:, None])
    measured = AngleProblem(columns, y, s, ["angles"] * 2, pair)
    assert missing.helpful(measured, law_of("contact_point"), COEFFICIENTS, ["e_n", "e_t"]) == expected


@pytest.mark.parametrize("nu", [4.0, None])
def test_errors_of_errors_are_those_of_the_scale_of_a_student_distribution(nu: float | None) -> None:
    """Values a of an impact have the share d_a / (nu + d) of a Student-t of nu degrees of freedom, d_a their squares.

    It is a beta variable of a/2 and (nu + m - a)/2, so that the score by the logarithm of their variance, (nu + m)/2
    times that share less a/2, has the variance a (nu + m - a) / (2 (nu + m + 2)), and two scores the covariance
    -a b / (2 (nu + m + 2)); of a Gaussian a/2 and 0.
    """
    n, of = 50, {"positions": 2, "spins": 3}
    m, rng = sum(of.values()), np.random.default_rng(1)
    problem: Any = SimpleNamespace(
        groups=[name for name, size in of.items() for _ in range(size)],
        estimated=(*of,),
        unknown=np.ones((n, m), bool),
    )
    points: Any = SimpleNamespace(
        slope=np.zeros((n, m, 1)), jacobian=np.zeros((n, m, 1)), weight=np.ones(n), residual=rng.normal(size=(n, m)),
        information=np.eye(1), robust=nu, redundancy=np.full(n, m),
    )  # fmt: skip
    a = np.array([*of.values()])
    by_variance = (
        np.diag(a / 2.0) if nu is None else (np.diag(a * (nu + m)) - np.outer(a, a)) / (2.0 * (nu + m + 2.0))
    )
    # The logarithm of an error is half that of its variance.
    expected = 0.5 * np.sqrt(np.diag(np.linalg.inv(n * by_variance)))
    np.testing.assert_allclose(_Scoring(problem, points).errors, expected, rtol=1e-12)


def test_walton_viscoelastic_is_walton_at_the_e_n_of_each_speed() -> None:
    """e_n = 1 - A g_n^(1/5) of disks of mass 1 at rest that one hits along x with g_n and the slip g_t."""
    g_n, g_t, zero, one = np.array([0.1, 1.0, 3.0]), np.array([0.02, 2.0, -1.0]), np.zeros(3), np.ones(3)
    motion = [
        one,
        zero,
        one,
        0.5 * one,
        2.0 * one,
        g_n,
        g_t,
        zero,
        one,
        0.5 * one,
        2.0 * one,
        zero,
        zero,
        zero,
    ]
    law = LAWS["walton-viscoelastic"]
    assert law.free == ("A", "beta_0", "mu")
    found = law.collide(np.array([0.12, 0.3, 0.2]), motion)
    for i, speed in enumerate(g_n):
        values = np.array([1.0 - 0.12 * speed**0.2, 0.3, 0.2])
        expected = LAWS["walton"].collide(values, [each[i : i + 1] for each in motion])
        np.testing.assert_allclose([each[i] for each in found[:8]], np.ravel(expected[:8]), rtol=1e-14)


@pytest.mark.parametrize(("mu", "psi_transit"), [(0.21, np.pi / 2.0), (0.0, 0.0)])
@pytest.mark.filterwarnings("error")
def test_a_slip_that_is_kept_sticks_at_all_angles_or_at_none(mu: float, psi_transit: float) -> None:
    """The impulse of sticking is 0 for beta_0 = -1, below mu P_n at all angles; NumPy warned of a division by it."""
    (transition,) = LAWS["walton"].transitions(
        np.array([0.87, -1.0, mu]), blank(("delta_1",), Pair(M=1.0), 1).probe()
    )
    assert transition == pytest.approx(psi_transit, abs=1e-12)


def test_what_no_value_determines_takes_no_error_from_the_rest() -> None:
    """The second and third coefficient are known as a sum only, of the fourth nothing: the first has 1/sqrt(4)."""
    information = np.zeros((4, 4))
    information[0, 0], information[1:3, 1:3] = 4.0, 1.0
    covariance = covariance_of(information)
    assert covariance[0, 0] == pytest.approx(0.25)
    assert np.isinf(covariance[1:]).all()
    assert np.isinf(covariance[0, 1:]).all()
    regular = np.array([[4.0, 1.0], [1.0, 1e6]])
    np.testing.assert_allclose(covariance_of(regular), np.linalg.inv(regular))
