"""The law against the paper's closed-form equations 4 to 41, Table I and Table II, and the paper's misprints.

`validation/paper/equations.py` states the equations by themselves; here `collide` has to give the same numbers, at mass
ratios other than 1, unequal radii, any direction of the line of centres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from ifrdem.model.laws.coin_table import coins
from ifrdem.model.laws.collision import collide
from ifrdem.model.laws.ifr import IFRLaw, Regime
from ifrdem.validation.paper import equations
from ifrdem.validation.paper.equations import TABLE_II, Impact

# f64 round-off of some twenty operations on numbers of order 1, with room for cancellation (M near e_n).
ROUND_OFF = {"rtol": 1e-12, "atol": 1e-12}

# e_n, e_t, mu: aluminium coins, polyester disks, and two that no coin has. All are admissible up to k = 2.5.
COEFFICIENTS = [(0.87, -0.88, 0.21), (0.67, -0.95, 0.14), (0.30, -1.00, 0.60), (0.95, -0.80, 0.05)]
BOTH = pytest.mark.parametrize("sticking", ["percussion_center", "contact_point"])
ALL_COEFFICIENTS = pytest.mark.parametrize("coefficients", COEFFICIENTS)


@dataclass
class Measured:
    """What `collide` says of an `Impact`, in the paper's components and signs."""

    v_1n: np.ndarray
    v_1t: np.ndarray
    v_2n: np.ndarray
    v_2t: np.ndarray
    Rw_1: np.ndarray  # counter-clockwise
    Rw_2: np.ndarray  # clockwise
    P_n: np.ndarray
    P_t: np.ndarray
    regime: np.ndarray

    @property
    def slip(self) -> np.ndarray:
        """Tangential velocity of contact 1 over contact 2."""
        return self.v_1t + self.Rw_1 - (self.v_2t + self.Rw_2)

    def e_t_apparent(self, c: Impact) -> np.ndarray:
        return -self.slip / c.V_ot


def strike(c: Impact, sticking: str, direction: float = 0.7) -> Measured:
    """Collide as the paper does: disk 2 at rest, disk 1 at the angle psi to the line of centres.

    `direction` [rad] of the line of centres must not matter.
    """
    n = np.array([np.cos(direction), np.sin(direction)])
    t = np.array([-n[1], n[0]])
    psi, M, m_1, v_o, w_o = np.broadcast_arrays(c.psi, c.M, c.m_1, c.v_o, c.w_o)
    v_1 = v_o[..., None] * (np.cos(psi)[..., None] * n + np.sin(psi)[..., None] * t)
    k = max(2.0, float(np.max(c.k_1)), float(np.max(c.k_2)))
    law = IFRLaw(e_n=c.e_n, e_t=c.e_t, mu=c.mu, sticking=sticking, rho=c.rho, k=k)
    radius = np.stack(np.broadcast_arrays(c.R_1, c.R_2), -1)
    after = collide(
        law,
        n,
        mass=np.stack([m_1, m_1 / M], -1),
        radius=radius,
        k=np.stack(np.broadcast_arrays(c.k_1, c.k_2), -1),
        velocity=np.stack([v_1, np.zeros_like(v_1)], -2),
        spin=np.stack([w_o, np.zeros_like(w_o)], -1),
    )
    v, Rw = after.velocity, radius * after.spin
    return Measured(
        *(v[..., 0, :] @ n, v[..., 0, :] @ t, v[..., 1, :] @ n, v[..., 1, :] @ t),
        *(Rw[..., 0], -Rw[..., 1], after.P_n, after.P_t, after.regime),
    )


def random_impacts(coefficients: tuple[float, float, float], *, seed: int, n: int = 2000) -> Impact:
    """Impacts with any mass ratio, radii, k and spin before, V_ot > 0 as in the paper."""
    rng = np.random.default_rng(seed)
    psi, R_1, v_o = rng.uniform(0.01, 1.5, n), rng.uniform(0.1, 3.0, n), rng.uniform(0.1, 3.0, n)
    return Impact(
        psi,
        *coefficients,
        M=10.0 ** rng.uniform(-1.0, 1.0, n),
        m_1=rng.uniform(0.1, 3.0, n),
        R_1=R_1,
        R_2=rng.uniform(0.1, 3.0, n),
        k_1=rng.uniform(1.0, 2.5, n),
        k_2=rng.uniform(1.0, 2.5, n),
        v_o=v_o,
        w_o=v_o * np.sin(psi) / R_1 * rng.uniform(-0.9, 2.0, n),
    )


def homogeneous(c: Impact) -> Impact:
    return replace(c, k_1=2.0, k_2=2.0, w_o=0.0)


def friction_limit(c: Impact, sticking: str) -> np.ndarray:
    return {
        "contact_point": equations.CONTACT_POINT.P_f,
        "percussion_center": equations.PERCUSSION_CENTER.P_f,
    }[sticking](c)


# -- Equations 4 to 17: any masses, radii, k, and spin of disk 1 -------------------------------------------


@ALL_COEFFICIENTS
@BOTH
def test_normal_motion_follows_eqs_4_to_7(coefficients, sticking):
    c = random_impacts(coefficients, seed=1)
    got = strike(c, sticking)
    np.testing.assert_allclose(got.v_2n - got.v_1n, equations.separation(c), **ROUND_OFF)
    np.testing.assert_allclose(got.P_n, equations.P_n(c), **ROUND_OFF)
    np.testing.assert_allclose(got.v_1n, equations.v_1n(c), **ROUND_OFF)
    np.testing.assert_allclose(got.v_2n, equations.v_2n(c), **ROUND_OFF)


@ALL_COEFFICIENTS
@BOTH
def test_tangential_impulse_is_restitution_plus_the_smaller_friction(coefficients, sticking):
    """Eqs. 8, 9, 12, 15: which of the frictions acts is what the regime says."""
    c = random_impacts(coefficients, seed=2)
    got = strike(c, sticking)
    sliding = equations.SLIDING.P_f(c) < friction_limit(c, sticking)
    assert 200 < np.sum(sliding) < 1800  # the sample has both regimes
    np.testing.assert_array_equal(got.regime, np.where(sliding, Regime.SLIDING, Regime.STICKING))
    friction = np.where(sliding, equations.SLIDING.P_f(c), friction_limit(c, sticking))
    np.testing.assert_allclose(got.P_t, equations.P_et(c) + friction, **ROUND_OFF)


@ALL_COEFFICIENTS
@pytest.mark.parametrize(
    ("sticking", "regime", "v_1t", "v_2t"),
    [
        ("percussion_center", Regime.SLIDING, equations.SLIDING.v_1t, equations.SLIDING.v_2t),
        ("contact_point", Regime.SLIDING, equations.SLIDING.v_1t, equations.SLIDING.v_2t),
        ("contact_point", Regime.STICKING, equations.CONTACT_POINT.v_1t, equations.CONTACT_POINT.v_2t),
        (
            "percussion_center",
            Regime.STICKING,
            equations.PERCUSSION_CENTER.v_1t,
            equations.PERCUSSION_CENTER.v_2t,
        ),
    ],
    ids=["eqs 10, 11", "eqs 10, 11 contact point", "eqs 13, 14", "eqs 16, 17"],
)
def test_tangential_velocities_follow_eqs_10_to_17(coefficients, sticking, regime, v_1t, v_2t):
    c = random_impacts(coefficients, seed=3)
    got = strike(c, sticking)
    here = got.regime == regime
    assert np.sum(here) > 200
    np.testing.assert_allclose(got.v_1t[here], v_1t(c)[here], **ROUND_OFF)
    np.testing.assert_allclose(got.v_2t[here], v_2t(c)[here], **ROUND_OFF)


@ALL_COEFFICIENTS
@BOTH
def test_impulses_move_and_turn_both_disks_by_eqs_1_to_3(coefficients, sticking):
    c = random_impacts(coefficients, seed=4)
    got = strike(c, sticking)
    m_2 = c.m_1 / c.M
    np.testing.assert_allclose(m_2 * got.v_2n, got.P_n, **ROUND_OFF)  # Eq. 1
    np.testing.assert_allclose(m_2 * got.v_2t, got.P_t, **ROUND_OFF)  # Eq. 2
    # Eq. 3 times k: P_t = I_2 omega_2 / R_2 = -I_1 (omega_1 - omega_o) / R_1
    np.testing.assert_allclose(m_2 * got.Rw_2, c.k_2 * got.P_t, rtol=1e-12, atol=1e-11)  # m_2 up to 30
    np.testing.assert_allclose(c.m_1 * (got.Rw_1 - c.R_1 * c.w_o), -c.k_1 * got.P_t, **ROUND_OFF)


# -- Equations 18 to 25: angles ----------------------------------------------------------------------------


@ALL_COEFFICIENTS
@pytest.mark.parametrize(
    ("sticking", "regime", "tan_1", "tan_2"),
    [
        ("percussion_center", Regime.SLIDING, equations.SLIDING.tan_delta_1, equations.SLIDING.tan_delta_2),
        (
            "contact_point",
            Regime.STICKING,
            equations.CONTACT_POINT.tan_delta_1,
            equations.CONTACT_POINT.tan_delta_2,
        ),
        (
            "percussion_center",
            Regime.STICKING,
            equations.PERCUSSION_CENTER.tan_delta_1,
            equations.PERCUSSION_CENTER.tan_delta_2,
        ),
    ],
    ids=["eqs 18, 19", "eqs 20, 21", "eqs 22, 23"],
)
def test_scattering_angles_follow_eqs_18_to_23(coefficients, sticking, regime, tan_1, tan_2):
    c = homogeneous(random_impacts(coefficients, seed=5))
    got = strike(c, sticking)
    here = got.regime == regime
    assert np.sum(here) > 100
    # tan(delta_1) is the quotient of two velocities, and grows without bound near M = e_n: compared as
    # products.
    expected = tan_1(c) * got.v_1n
    np.testing.assert_allclose(got.v_1t[here], expected[here], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(got.v_2t[here] / got.v_2n[here], tan_2(c)[here], rtol=1e-11)


@ALL_COEFFICIENTS
@pytest.mark.parametrize(
    ("sticking", "transit"),
    [
        ("contact_point", equations.CONTACT_POINT.tan_psi_transit),
        ("percussion_center", equations.PERCUSSION_CENTER.tan_psi_transit),
    ],
    ids=["eq 24", "eq 25"],
)
def test_sliding_begins_at_the_angle_of_eqs_24_and_25(coefficients, sticking, transit):
    c = homogeneous(random_impacts(coefficients, seed=6))
    angle = np.arctan(transit(c))
    # 1e-9 rad on either side: far above round-off, far below the difference to the printed Eq. 24
    assert np.all(strike(replace(c, psi=angle - 1e-9), sticking).regime == Regime.STICKING)
    assert np.all(strike(replace(c, psi=angle + 1e-9), sticking).regime == Regime.SLIDING)


def test_transition_angle_is_independent_of_k_only_for_the_percussion_center():
    """Eq. 25 for any k. The contact point's is m_n/m_t mu (1 + e_n): the masses matter unless k_1 = k_2."""
    c = replace(random_impacts((0.87, -0.88, 0.21), seed=7), w_o=0.0)
    angle = np.arctan(2.0 * 0.21 * 1.87)
    assert np.all(strike(replace(c, psi=angle - 1e-9), "percussion_center").regime == Regime.STICKING)
    assert np.all(strike(replace(c, psi=angle + 1e-9), "percussion_center").regime == Regime.SLIDING)
    angle = np.arctan((1.0 + c.k_1 + c.M * (1.0 + c.k_2)) / (1.0 + c.M) * 0.21 * 1.87)
    assert np.all(strike(replace(c, psi=angle - 1e-9), "contact_point").regime == Regime.STICKING)
    assert np.all(strike(replace(c, psi=angle + 1e-9), "contact_point").regime == Regime.SLIDING)
    assert np.ptp(angle) > 0.1


@pytest.mark.parametrize("row", TABLE_II, ids=lambda row: row.disks)
def test_table_2_transition_angles(row):
    """Printed to 0.1 degrees, partly rounded and partly cut off: 0.1 degrees is what the print can hold."""
    a, b = (coins[name] for name in row.coins)
    law = coins.pair(*row.coins)
    assert (law.e_n, law.e_t, law.mu) == (row.e_n, row.e_t, row.mu)

    def regime(degrees: float) -> int:
        c = Impact(
            np.radians(degrees), law.e_n, law.e_t, law.mu, M=a.mass / b.mass, R_1=a.radius, R_2=b.radius
        )
        return int(strike(c, law.sticking).regime)

    assert regime(row.psi_transit - 0.1) == Regime.STICKING
    assert regime(row.psi_transit + 0.1) == Regime.SLIDING


# -- Equations 26 to 28, 30 --------------------------------------------------------------------------------


@ALL_COEFFICIENTS
@pytest.mark.parametrize(
    ("sticking", "regime", "e_t_apparent"),
    [
        ("percussion_center", Regime.SLIDING, equations.SLIDING.e_t_apparent),
        ("contact_point", Regime.STICKING, equations.CONTACT_POINT.e_t_apparent),
        ("percussion_center", Regime.STICKING, equations.PERCUSSION_CENTER.e_t_apparent),
    ],
    ids=["eq 26", "eq 27", "eq 28"],
)
def test_apparent_restitution_follows_eqs_26_to_28(coefficients, sticking, regime, e_t_apparent):
    for c in (random_impacts(coefficients, seed=8), homogeneous(random_impacts(coefficients, seed=9))):
        c = replace(c, w_o=0.0)
        got = strike(c, sticking)
        here = got.regime == regime
        assert np.sum(here) > 100
        # divided by the slip before, which is down to 1e-3 here
        np.testing.assert_allclose(got.e_t_apparent(c)[here], e_t_apparent(c)[here], rtol=1e-10, atol=1e-10)


def test_collision_is_an_inertial_balance_by_eq_30():
    c = Impact(np.linspace(0.1, 1.4, 50), 0.87, -0.88, 0.21, M=1.3, R_1=1.4, R_2=1.2)
    got = strike(c, "percussion_center")
    alpha_1 = np.arctan2(got.v_1t, got.v_1n) - c.psi
    alpha_2 = c.psi - np.arctan2(got.v_2t, got.v_2n)
    ratio = equations.balance(np.hypot(got.v_1n, got.v_1t), alpha_1, np.hypot(got.v_2n, got.v_2t), alpha_2)
    np.testing.assert_allclose(ratio, 1.3, rtol=1e-11)  # m_1/m_2; sines of angles down to 0.05
    assert np.all(np.abs(ratio - 1.0 / 1.3) > 0.5)  # printed as m_2/m_1


# -- Equations 31 to 41 and Table I: rolling friction ------------------------------------------------------

ROLLING = [
    ("percussion_center", Regime.SLIDING_ROLLING, 0.02, equations.SLIDING.Rw_2_rolling),
    ("percussion_center", Regime.SLIDING_NONROLLING, 0.60, equations.SLIDING.Rw_2_nonrolling),
    ("contact_point", Regime.STICKING_ROLLING, 0.02, equations.CONTACT_POINT.Rw_2_rolling),
    ("contact_point", Regime.STICKING_NONROLLING, 0.60, equations.CONTACT_POINT.Rw_2_nonrolling),
    ("percussion_center", Regime.STICKING_ROLLING, 0.02, equations.PERCUSSION_CENTER.Rw_2_rolling),
    ("percussion_center", Regime.STICKING_NONROLLING, 0.60, equations.PERCUSSION_CENTER.Rw_2_nonrolling),
]
ROLLING_IDS = ["eq 34", "eq 35", "eq 37", "eq 38", "eq 40", "eq 41"]
TANGENTIAL = {
    Regime.SLIDING: {"percussion_center": equations.SLIDING.P_t, "contact_point": equations.SLIDING.P_t},
    Regime.STICKING: {
        "percussion_center": equations.PERCUSSION_CENTER.P_t,
        "contact_point": equations.CONTACT_POINT.P_t,
    },
}


def rolling_impacts(rho: float) -> Impact:
    c = homogeneous(random_impacts((0.87, -0.88, 0.21), seed=11, n=4000))
    rng = np.random.default_rng(12)
    return replace(c, rho=rho, R_1=rng.uniform(0.8, 1.2, 4000), R_2=rng.uniform(0.8, 1.2, 4000))


@pytest.mark.parametrize(("sticking", "regime", "rho", "Rw_2"), ROLLING, ids=ROLLING_IDS)
def test_spin_with_rolling_friction_follows_eqs_34_to_41(sticking, regime, rho, Rw_2):
    c = rolling_impacts(rho)
    got = strike(c, sticking)
    # The printed equations hold while the torque does not stop the spin: they give it its sign.
    here = (got.regime == regime) & (Rw_2(c) > 0.0)
    assert np.sum(here) > 100
    np.testing.assert_allclose(got.Rw_2[here], Rw_2(c)[here], **ROUND_OFF)
    # beyond that the spin stops and does not reverse
    stopped = (got.regime == regime) & (Rw_2(c) <= 0.0)
    np.testing.assert_array_equal(got.Rw_2[stopped], 0.0)


@BOTH
@pytest.mark.parametrize("rho", [0.02, 0.60])
def test_the_smaller_torque_of_eqs_31_and_32_acts(sticking, rho):
    c = rolling_impacts(rho)
    got = strike(c, sticking)
    rolling = equations.T_rolling(c) < equations.T_nonrolling(c)
    sliding = equations.SLIDING.P_f(c) < friction_limit(c, sticking)
    expected = np.select(
        [sliding & rolling, rolling, sliding],
        [Regime.SLIDING_ROLLING, Regime.STICKING_ROLLING, Regime.SLIDING_NONROLLING],
        Regime.STICKING_NONROLLING,
    )
    np.testing.assert_array_equal(got.regime, expected)


@BOTH
def test_tangential_impulse_with_rolling_friction_follows_eqs_33_36_39(sticking):
    """Rolling friction does not change it."""
    c = rolling_impacts(0.02)
    got = strike(c, sticking)
    sliding = equations.SLIDING.P_f(c) < friction_limit(c, sticking)
    for regime, here in ((Regime.SLIDING, sliding), (Regime.STICKING, ~sliding)):
        np.testing.assert_allclose(got.P_t[here], TANGENTIAL[regime][sticking](c)[here], **ROUND_OFF)


TABLE_1 = [
    ("percussion_center", Regime.SLIDING_ROLLING, 0.02, equations.SLIDING.e_t_apparent),
    ("contact_point", Regime.STICKING_ROLLING, 0.02, equations.CONTACT_POINT.e_t_apparent),
    ("percussion_center", Regime.STICKING_ROLLING, 0.02, equations.PERCUSSION_CENTER.e_t_apparent),
    ("percussion_center", Regime.SLIDING_NONROLLING, 0.60, equations.SLIDING.e_t_apparent),
    ("contact_point", Regime.STICKING_NONROLLING, 0.60, equations.CONTACT_POINT.e_t_apparent),
    ("percussion_center", Regime.STICKING_NONROLLING, 0.60, equations.PERCUSSION_CENTER.e_t_apparent),
]


@pytest.mark.parametrize(("sticking", "regime", "rho", "without"), TABLE_1)
def test_apparent_restitution_with_rolling_friction_follows_table_1(sticking, regime, rho, without):
    rolls = regime in (Regime.SLIDING_ROLLING, Regime.STICKING_ROLLING)
    right = equations.e_t_apparent_rolling if rolls else equations.e_t_apparent_nonrolling
    printed = equations.Printed.rolling if rolls else equations.Printed.nonrolling
    c = rolling_impacts(rho)
    got = strike(c, sticking)
    here = (got.regime == regime) & (got.Rw_2 > 0.0) & (got.Rw_1 < 0.0)  # no spin stopped
    assert np.sum(here) > 100
    e_t_apparent = got.e_t_apparent(c)[here]
    # divided by the slip before, which is down to 1e-3 here
    np.testing.assert_allclose(e_t_apparent, right(c, without(c))[here], rtol=1e-10, atol=1e-10)
    unequal = (np.abs(np.log(c.M)) > 0.5) & (np.abs(np.log(c.R_1 / c.R_2)) > 0.1)
    difference = np.abs(got.e_t_apparent(c) - printed(c, without(c)))[here & unequal]
    # rolling: at least 2 rho (1 + e_n) cot(1.5) |lever - 1/r| = 5e-5 here; nonrolling: 2 against about 2/3
    assert np.all(difference > (1e-5 if rolls else 1.0))


@pytest.mark.parametrize("case", [{"R_2": 1.0, "M": 2.5}, {"R_2": 1.7, "M": 1.0}], ids=["R_1 = R_2", "M = 1"])
def test_table_1_nonrolling_is_two_thirds_for_equal_radii_or_masses(case):
    """The printed 2 should be 2/3 there, and 2 rho/r is right: (1/R_1 + M/R_2)/(1 + M) = 1/r."""
    c = Impact(np.array([0.05, 0.1]), 0.87, -0.88, 0.21, rho=2.0, **case)
    got = strike(c, "percussion_center")
    assert np.all(got.regime == Regime.STICKING_NONROLLING)
    np.testing.assert_allclose(got.e_t_apparent(c), -0.88 + 1.5 - 2.0 / 3.0, rtol=1e-12)  # e_t + 5/6
    c = replace(c, psi=0.5, rho=0.01)
    got = strike(c, "percussion_center")
    without = equations.PERCUSSION_CENTER.e_t_apparent(c)
    np.testing.assert_allclose(got.e_t_apparent(c), equations.Printed.rolling(c, without), rtol=1e-12)
    np.testing.assert_allclose(got.e_t_apparent(c), equations.e_t_apparent_rolling(c, without), rtol=1e-12)
