"""Every misprint of the paper: what is printed, what is right, and what the simulated collision says.

The collision is one of the paper's own, a 500 pts coin on a 100 pts coin: neither M nor R_1/R_2 is 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..report.registry import Result, Table
from . import angles, equations, pairs, stopping, table_reference
from .equations import FIGURE_5A, TABLE_II, Array, Impact, Law

QUESTION = "Where print and derivation differ, which one do the disks follow?"
REFERENCE = "momentum and angular momentum balance; each row names the equation that contradicts the print"

PERCUSSION, CONTACT = "percussion_center", "contact_point"
LARGE_ON_SMALL = TABLE_II[4]  # 500 pts on 100 pts
STEEP, FLAT = np.radians(45.0), np.radians(20.0)  # slides, sticks


def run(quick: bool) -> Result:
    """See the module's QUESTION; there is nothing to shorten."""
    result = Result()
    for where, measured, right, printed, source in (
        _inertia(), *_equations(), _sticking_condition(), _equation_24(), _brach(), _balance(), *_table_i(),
    ):  # fmt: skip
        result.exact(where, measured, right, source, printed=printed)
    _figures_and_tables(result)
    _section_ii_f(result)
    result.tables.append(_summary(result))
    return result


Misprint = tuple[str, float, float, float, str]
"""Place in the paper; the simulated value, which must be the corrected one, and not the printed one; the evidence."""


def _case(psi: float, **changes: float) -> Impact:
    return replace(angles.coin_impact(LARGE_ON_SMALL, psi), **changes)


def _inertia() -> Misprint:
    c = _case(STEEP)
    got = pairs.fly(c)
    # Eq. 3: I omega_2 = R_2 P_t. The moment of inertia that the collision had, over m R^2.
    measured = float((c.R_2 * got.P_t / (got.Rw_2 / c.R_2))[0])
    m_2 = c.m_1 / c.M
    unit = m_2 * c.R_2**2
    right, printed = (
        float(law(m_2, c.R_2, 2.0)) / unit for law in (equations.inertia, equations.Printed.inertia)
    )
    return "inertia of disk 2, in m R^2 (SI)", measured / unit, right, printed, "Eq. 3"


def _equations() -> Iterator[Misprint]:
    """Equations with a wrong factor, compared at M = 1.3."""
    rho = 0.6 * float(_case(STEEP).R_2)  # nonrolling
    table: list[tuple[str, str, float, float, str, Law, Law, str]] = [
        ("Eq. 10: v_1t, sliding", PERCUSSION, STEEP, 0.0, "v_1t",
         equations.SLIDING.v_1t, equations.Printed.eq_10, "Eqs. 2 and 18"),
        ("Eq. 14: v_2t, sticking, contact point", CONTACT, FLAT, 0.0, "v_2t",
         equations.CONTACT_POINT.v_2t, equations.Printed.eq_14, "Eqs. 2 and 21"),
        ("Eq. 33: P_t / m_1, sliding", PERCUSSION, STEEP, 0.0, "P_t",
         equations.SLIDING.P_t, equations.Printed.eq_33, "Eq. 34"),
        ("Eq. 35: R_2 omega_2, sliding plus nonrolling", PERCUSSION, np.radians(32.0), rho, "Rw_2",
         equations.SLIDING.Rw_2_nonrolling, equations.Printed.eq_35, "Eqs. 32 and 33"),
        ("Eq. 38: R_2 omega_2, sticking plus nonrolling, contact point", CONTACT, FLAT, rho, "Rw_2",
         equations.CONTACT_POINT.Rw_2_nonrolling, equations.Printed.eq_38, "Eqs. 32 and 36"),
        ("Eq. 41: R_2 omega_2, sticking plus nonrolling", PERCUSSION, FLAT, rho, "Rw_2",
         equations.PERCUSSION_CENTER.Rw_2_nonrolling, equations.Printed.eq_41,
         "Eqs. 32 and 39"),
    ]  # fmt: skip
    for where, sticking, psi, one_rho, quantity, right, printed, source in table:
        c = _case(psi, rho=one_rho)
        unit = float(c.m_1) if quantity == "P_t" else 1.0
        measured = float(getattr(pairs.fly(c, sticking), quantity)[0])
        yield where, measured / unit, float(right(c)) / unit, float(printed(c)) / unit, source


def _sticking_condition() -> Misprint:
    """Without restitution (e_t = -1) the contact points stay together: V_1t = V_2t after the impact."""
    c = _case(FLAT, e_t=-1.0)
    got = pairs.fly(c, CONTACT)
    state = (got.v_1t[0], got.v_2t[0], c.R_1, got.Rw_1[0] / c.R_1, c.R_2, got.Rw_2[0] / c.R_2)
    # Print: v_1t - R_1 omega_1 = v_2t + R_2 omega_2. Its left side, less the right one, is not 0.
    where = "above Eq. 12: v_1t + R_1 omega_1 - v_2t - R_2 omega_2 (printed with - R_1 omega_1)"
    printed = float(equations.Printed.contact_slip(*state))
    return where, float(equations.contact_slip(*state)), 0.0, printed, "Eq. 12"


def _transition(row: equations.Table2Row, tan_psi: Array, sticking: str = PERCUSSION) -> tuple[float, float]:
    """Angle at which the lines of the two regimes meet, simulated and by Eq. 24 or 25 [deg]."""
    c = angles.coin_impact(row, np.arctan(tan_psi))
    right = float(equations.CLOSURES[sticking].tan_psi_transit(c))
    simulated = angles.Lines.fit(pairs.fly(c, sticking), right).transit
    return float(np.degrees(np.arctan(simulated))), float(np.degrees(np.arctan(right)))


def _equation_24() -> Misprint:
    measured, right = _transition(LARGE_ON_SMALL, np.linspace(0.05, 3.0, 120), CONTACT)
    printed = float(np.degrees(np.arctan(equations.Printed.eq_24(_case(STEEP)))))
    return "Eq. 24: transition angle, contact point [deg]", measured, right, printed, "Eqs. 19 and 21"


def _brach() -> Misprint:
    """Brach's sticking has no slip afterwards, e_t* = 0. Which e_t gives that, by a straight line through two."""
    e_t = np.array([-1.0, -0.5])
    got = pairs.fly(replace(_case(FLAT), e_t=e_t), CONTACT).e_t_apparent
    root = float(e_t[0] - got[0] * (e_t[1] - e_t[0]) / (got[1] - got[0]))
    return "Sec. II E: e_t at which sticking is Brach's", root, -1.0, 0.0, "Eq. 27"


def _weighed(c: Impact) -> float:
    """m_1/m_2 by the collision."""
    got = pairs.fly(c)
    return float(equations.balance(got.v_1, got.alpha_1, got.v_2, got.alpha_2)[0])


def _balance() -> Misprint:
    c = _case(STEEP)
    where = "Eq. 30: v_2 sin(alpha_2) / (v_1 sin(alpha_1)), printed as m_2/m_1"
    return where, _weighed(c), c.M, 1.0 / c.M, "momentum across the incoming direction"


def _table_i() -> Iterator[Misprint]:
    for kind, rho, right, printed, number in (
        ("nonrolling", 0.6, equations.e_t_apparent_nonrolling, equations.Printed.nonrolling, 32),
        ("rolling", 0.02, equations.e_t_apparent_rolling, equations.Printed.rolling, 31),
    ):
        c = _case(FLAT, rho=rho * float(_case(FLAT).R_2))
        without = equations.PERCUSSION_CENTER.e_t_apparent(c)
        where = f"Table I: e_t*, sticking plus {kind}, percussion centre"
        measured, source = float(pairs.fly(c).e_t_apparent[0]), f"Eq. {number} and the contact velocities"
        yield where, measured, float(right(c, without)), float(printed(c, without)), source


def _figures_and_tables(result: Result) -> None:
    spheres = Impact(np.radians(60.0), 0.98, -0.96, 0.09, M=0.0, k_1=2.5, k_2=2.5)
    factor = float((pairs.fly(spheres).e_t_apparent[0] + 0.96) * np.tan(spheres.psi) / (0.09 * 1.98))
    text = "Fig. 3: factor of Eq. 26 for spheres on a plane"
    result.exact(text, factor, 3.5, "m_n/m_t = 1 + k", printed=3.0)

    # Fig. 5a is captioned copper-aluminium. Its coefficients give the transition angle of one row of Table II.
    tan_psi = np.linspace(0.02, 2.0, 120)
    c = Impact(np.arctan(tan_psi), *FIGURE_5A)
    lines = angles.Lines.fit(pairs.fly(c), float(equations.PERCUSSION_CENTER.tan_psi_transit(c)))
    result.near(
        "Fig. 5a: transition angle [deg]; 5 pts coins have 21.6, copper-nickel coins 35.2 and 28.0",
        np.degrees(np.arctan(lines.transit)), TABLE_II[2].psi_transit, 0.05, "printed to 0.1 deg",
        "Table II, 5 pts coins", printed=TABLE_II[3].psi_transit,
    )  # fmt: skip
    c = Impact(np.radians(45.0), 0.90, -0.90, 0.15)
    right, printed = (float(equations.SLIDING.Rw_2_rolling(replace(c, rho=rho))) for rho in (0.0, 0.02))
    result.exact(
        "Fig. 11, dotted line: R_2 omega_2 / v_o at 45 deg", float(pairs.fly(c).Rw_2[0]), right,
        "Eq. 34 with rho = 0: the caption's own sentence", printed=printed,
    )  # fmt: skip
    # The mass ratio, weighed by a collision; Table II has 1.28 and 0.79, Fig. 9 0.78.
    for row, name, M in (
        (TABLE_II[4], "500-100 pts", 12.00 / 9.23),
        (TABLE_II[6], "100-500 pts", 9.23 / 12.00),
    ):
        measured, source = _weighed(angles.coin_impact(row, STEEP)), "masses of Sec. III; Eq. 30"
        result.exact(f"Table II: mass ratio of {name}", measured, M, source, printed=row.M)
    measured, right = _transition(TABLE_II[5], tan_psi)
    text = "Table II: psi_transit of bronze-aluminium [deg]"
    result.exact(text, measured, right, "Eq. 25", printed=TABLE_II[5].psi_transit)


def _section_ii_f(result: Result) -> None:
    """Uniform decelerations stop speed and spin at two times; exact friction at one, with another distance."""
    got = pairs.fly(angles.coin_impact(TABLE_II[1], STEEP))
    slide = stopping.to_rest(got.v_1, got.Rw_1)
    v, u = float(got.v_1[0]), float(abs(got.Rw_1[0]))
    right = table_reference.fly(v, u, 2.0)[2] / stopping.DECELERATION
    uniform = v**2 / (2.0 * stopping.DECELERATION)
    result.near(
        "Sec. II F: distance of disk 1 over that of a uniform deceleration mu_s g", slide.x[0] / uniform,
        right / uniform, 1e-9, stopping.FLIGHT, "exact sliding and spinning", printed=1.0,
    )  # fmt: skip


def _summary(result: Result) -> Table:
    cells: list[tuple[str | float, ...]] = [
        (row.quantity, float(row.printed), row.expected, row.measured, row.source)
        for row in result.rows
        if row.printed is not None
    ]
    return Table(
        "The misprints",
        ("where", "printed", "corrected", "simulated", "evidence"),
        cells,
        "500 pts on 100 pts coins, 45 degrees (sliding) or 20 degrees (sticking), v_o = 1 m/s, unless the row says "
        "otherwise. Eqs. 10, 14, 35 and 38 happen to be right at M = 1. One more is text against text: Table II lists "
        "25 cts coins where Sec. III has a 50 cts coin of the same alloy; as M = 1 either way, no collision shows it.",
    )
