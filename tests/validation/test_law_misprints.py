"""Every misprint of the paper's equations, tables and figures, shown by a number.

The collision is one of the paper's own: a 500 pts coin on a 100 pts coin, so that M and R_1/R_2 are not 1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_paper_equations import strike

from ifrdem.model.laws.coin_table import coins
from ifrdem.model.laws.ifr import Regime
from ifrdem.validation.paper import equations
from ifrdem.validation.paper.equations import FIGURE_5A, TABLE_II, Impact

PERCUSSION, CONTACT = "percussion_center", "contact_point"
LARGE, SMALL = coins["500 pts"], coins["100 pts"]
LAW = coins.pair("500 pts", "100 pts")
CASE = Impact(
    np.radians(45.0),
    *(LAW.e_n, LAW.e_t, LAW.mu),
    M=LARGE.mass / SMALL.mass,
    m_1=LARGE.mass,
    R_1=LARGE.radius,
    R_2=SMALL.radius,
)
STEEP, FLAT = (
    np.radians(32.0),
    np.radians(20.0),
)  # slides, sticks: Eq. 25 puts the transition at 29.68 degrees

EQUATIONS = [
    ("eq 10", PERCUSSION, STEEP, 0.0, "v_1t", equations.SLIDING.v_1t, equations.Printed.eq_10),
    ("eq 14", CONTACT, FLAT, 0.0, "v_2t", equations.CONTACT_POINT.v_2t, equations.Printed.eq_14),
    ("eq 33", PERCUSSION, STEEP, 0.0, "P_t", equations.SLIDING.P_t, equations.Printed.eq_33),
    (
        *("eq 35", PERCUSSION, STEEP, 1.0, "Rw_2"),
        *(equations.SLIDING.Rw_2_nonrolling, equations.Printed.eq_35),
    ),
    (
        *("eq 38", CONTACT, FLAT, 1.0, "Rw_2"),
        *(equations.CONTACT_POINT.Rw_2_nonrolling, equations.Printed.eq_38),
    ),
    (
        *("eq 41", PERCUSSION, FLAT, 1.0, "Rw_2"),
        *(equations.PERCUSSION_CENTER.Rw_2_nonrolling, equations.Printed.eq_41),
    ),
]
RIGHT_AT_EQUAL_MASSES = {"eq 10", "eq 14", "eq 35", "eq 38"}


@pytest.mark.parametrize(
    ("name", "sticking", "psi", "rho", "quantity", "right", "printed"),
    EQUATIONS,
    ids=[row[0] for row in EQUATIONS],
)
def test_printed_equation_misses_the_collision(name, sticking, psi, rho, quantity, right, printed):
    c = replace(CASE, psi=psi, rho=rho)
    measured = getattr(strike(c, sticking), quantity)
    np.testing.assert_allclose(measured, right(c), rtol=1e-12)  # f64 round-off
    assert abs(printed(c) - measured) > 0.05 * abs(measured)  # the smallest is Eq. 10's, 7.6 %
    equal = replace(c, M=1.0)
    measured = getattr(strike(equal, sticking), quantity)
    np.testing.assert_allclose(measured, right(equal), rtol=1e-12)
    assert np.isclose(measured, printed(equal), rtol=1e-12) == (name in RIGHT_AT_EQUAL_MASSES)


def test_moment_of_inertia_needs_the_radius_squared():
    """Eq. 3 is I d(omega) = -R P_t with I = m R^2 / k; with the printed m R / k it is not."""
    got = strike(CASE, PERCUSSION)
    omega_2 = got.Rw_2 / CASE.R_2
    m_2 = CASE.m_1 / CASE.M
    np.testing.assert_allclose(
        equations.inertia(m_2, CASE.R_2, 2.0) * omega_2, CASE.R_2 * got.P_t, rtol=1e-12
    )
    printed = equations.Printed.inertia(m_2, CASE.R_2, 2.0) * omega_2
    np.testing.assert_allclose(printed / (CASE.R_2 * got.P_t), 1.0 / CASE.R_2, rtol=1e-12)  # 81.6 for metres


def test_sticking_contact_points_have_equal_velocities_with_plus_signs():
    """Above Eq. 12: without restitution (e_t = -1) the contacts move together; printed with - R_1 omega_1."""
    c = replace(CASE, psi=FLAT, e_t=-1.0)
    got = strike(c, CONTACT)
    assert got.regime == Regime.STICKING
    state = (got.v_1t, got.v_2t, c.R_1, got.Rw_1 / c.R_1, c.R_2, got.Rw_2 / c.R_2)
    np.testing.assert_allclose(equations.contact_slip(*state), 0.0, atol=1e-15)  # of velocities of order 0.1
    # 2 R_1 omega_1 is left over: Eq. 12 gives R_1 omega_1 = -2 P_f/m_1 = -2 sin(psi) / (3 (1 + M))
    np.testing.assert_allclose(
        equations.Printed.contact_slip(*state), 4.0 * np.sin(FLAT) / (3.0 * (1.0 + c.M)), rtol=1e-12
    )


def test_eq_24_has_no_division_by_one_plus_e_t():
    """Sliding (Eq. 19) and contact-point sticking (Eq. 21) are equal at the corrected angle only."""
    right = np.arctan(equations.CONTACT_POINT.tan_psi_transit(CASE))
    printed = np.arctan(equations.Printed.eq_24(CASE))
    np.testing.assert_allclose(
        np.degrees([right, printed]), [40.53, 83.33], atol=0.005
    )  # 3 0.15 1.9; ... / 0.1
    for psi, equal in ((right, True), (printed, False)):
        c = replace(CASE, psi=psi)
        sliding, sticking = equations.SLIDING.tan_delta_2(c), equations.CONTACT_POINT.tan_delta_2(c)
        assert np.isclose(sliding, sticking, rtol=1e-12) == equal
    between = strike(replace(CASE, psi=np.linspace(right + 1e-9, printed, 100)), CONTACT)
    assert np.all(between.regime == Regime.SLIDING)


def test_brachs_sticking_is_e_t_of_minus_one_not_zero():
    """Brach: no slip afterwards, e_t* = 0. Eq. 27 gives it for e_t = -1; for the printed 0 it gives 1."""
    for e_t, e_t_apparent in ((-1.0, 0.0), (0.0, 1.0)):
        c = replace(CASE, psi=FLAT, e_t=e_t)
        got = strike(c, CONTACT)
        assert got.regime == Regime.STICKING
        np.testing.assert_allclose(got.e_t_apparent(c), e_t_apparent, atol=1e-14)


def test_eq_26_for_the_spheres_of_fig_3_has_seven_halves():
    """Kharaz' spheres on an anvil (e_n = 0.98, e_t = -0.96, mu = 0.09): 1 + k = 7/2 for k = 5/2, not 3."""
    c = Impact(np.radians(60.0), 0.98, -0.96, 0.09, M=1e-14, k_1=2.5, k_2=2.5)
    got = strike(c, PERCUSSION)
    assert got.regime == Regime.SLIDING
    slope = (got.e_t_apparent(c) - c.e_t) / (c.mu * (1.0 + c.e_n) / np.tan(c.psi))
    np.testing.assert_allclose(slope, 3.5, rtol=1e-12)
    np.testing.assert_allclose(got.e_t_apparent(c), equations.SLIDING.e_t_apparent(c), rtol=1e-12)
    assert got.e_t_apparent(c) - equations.Printed.eq_26(c) > 0.05


def test_mass_ratios_of_500_and_100_pts_are_not_the_printed_ones():
    row = {row.coins: row.M for row in TABLE_II}
    assert LARGE.mass / SMALL.mass == pytest.approx(1.300, abs=5e-4)  # 12.00 g / 9.23 g
    assert row["500 pts", "100 pts"] == 1.28
    assert row["100 pts", "500 pts"] == 0.79  # Fig. 9 has 0.78; 1/1.300 = 0.769, and 1/1.28 = 0.781


def test_table_2_angle_of_bronze_aluminium_is_29_7_when_rounded():
    """Eq. 25: arctan(2 0.15 1.9) = 29.683 degrees, printed as 29.6."""
    bronze = [row for row in TABLE_II if row.psi_transit == 29.6]
    assert len(bronze) == 3
    for row in bronze:
        c = Impact(0.0, row.e_n, row.e_t, row.mu)
        assert np.degrees(np.arctan(equations.PERCUSSION_CENTER.tan_psi_transit(c))) == pytest.approx(
            29.683, abs=5e-4
        )


def test_table_2_lists_a_coin_that_section_3_does_not_have():
    assert "25 cts" in TABLE_II[0].disks
    assert "25 cts" not in coins
    assert coins["50 cts"].material == TABLE_II[0].material.lower()


def test_fig_5a_is_the_bronze_aluminium_5_pts_coin():
    """Its caption says copper-aluminum; its coefficients are those of one row of Table II."""
    rows = [row for row in TABLE_II if (row.e_n, row.e_t, row.mu) == FIGURE_5A]
    assert [(row.coins, row.material) for row in rows] == [(("5 pts", "5 pts"), "Bronze-aluminum")]


def test_fig_11_dotted_line_has_no_rolling_friction():
    """The caption gives both lines rho/R_2 = 0.02, so one line; the dotted one ignores it, rho = 0."""
    c = Impact(np.radians(45.0), 0.90, -0.90, 0.15, rho=0.02)
    with_rolling, without = strike(c, PERCUSSION), strike(replace(c, rho=0.0), PERCUSSION)
    np.testing.assert_allclose(with_rolling.Rw_2, equations.SLIDING.Rw_2_rolling(c), rtol=1e-12)
    # Eq. 34 less Eq. 34 at rho = 0: (rho/R_2) (1 + e_n) cos(psi), at M = 1
    np.testing.assert_allclose(without.Rw_2 - with_rolling.Rw_2, 0.02 * 1.9 * np.cos(c.psi), rtol=1e-12)
