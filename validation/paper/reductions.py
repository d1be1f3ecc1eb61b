"""Laws that IFR contains: Walton's and Brach's, smooth and perfectly rough disks; and those that it does not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..report import style
from ..report.registry import Picture, Result
from . import classic, pairs, predicted
from .equations import TABLE_II, Impact
from .pairs import ROUND_OFF

QUESTION = "Does IFR become Walton's, Brach's, smooth and perfectly rough disks where it should?"
REFERENCE = (
    "Sec. II E (Brach's sticking: e_t = -1, not 0), momentum and energy balance; validation/paper/classic.py"
)

Array = NDArray[np.float64]

EXACT = 1e-10
CONTACT = "contact_point"


def run(quick: bool) -> Result:
    """See the module's QUESTION."""
    result = Result()
    n = 100 if quick else 2000
    psi = np.linspace(0.05, 1.48, n)
    M = np.geomspace(0.2, 5.0, n)
    _walton_and_brach(result, psi, M)
    _smooth_and_rough(result, psi, M)
    _springs(result)
    result.pictures.append(_figure(40 if quick else 80))
    return result


def _walton_and_brach(result: Result, psi: Array, M: Array) -> None:
    """Sliding: P_t = mu P_n. Sticking: no slip afterwards (Brach), or a constant part of it (Walton)."""
    c = Impact(psi, 0.87, -1.0, 0.21, M=M)
    got, slide = pairs.fly(c, CONTACT), predicted.slides(c, CONTACT)
    source = "Walton and Brach, sliding: Coulomb's law"
    result.all_near(
        "P_t / P_n, e_t = -1, sliding",
        (got.P_t / got.P_n)[slide],
        np.full(slide.sum(), 0.21),
        EXACT,
        ROUND_OFF,
        source,
    )
    source = "Brach, no sliding (Eq. 27 at e_t = -1)"
    result.all_near(
        "e_t*, e_t = -1, sticking",
        got.e_t_apparent[~slide],
        np.zeros((~slide).sum()),
        EXACT,
        ROUND_OFF,
        source,
    )
    # Walton's restitution beta of the slip, in every collision: much friction, and e_t = beta - 1.
    beta = 0.4
    got = pairs.fly(Impact(psi, 0.87, beta - 1.0, 1e6, M=M), CONTACT)
    source = "Walton's constant restitution of the slip (Eq. 27)"
    result.all_near(
        "e_t*, e_t = -0.6, mu = 1e6", got.e_t_apparent, np.full(len(psi), beta), EXACT, ROUND_OFF, source
    )


def _smooth_and_rough(result: Result, psi: Array, M: Array) -> None:
    smooth = pairs.fly(Impact(psi, 0.9, -1.0, 0.0, M=M))
    source = "smooth disks: no tangential impulse"
    result.all_near("v_1t / v_o, mu = 0, e_t = -1", smooth.v_1t, np.sin(psi), EXACT, ROUND_OFF, source)
    result.all_near(
        "R_2 omega_2, mu = 0, e_t = -1", smooth.Rw_2, np.zeros(len(psi)), EXACT, ROUND_OFF, source
    )
    rough = pairs.fly(Impact(psi, 1.0, 1.0, 0.0, M=M))
    source = "perfectly rough elastic disks: the slip is reversed and energy kept"
    result.all_near("e_t*, mu = 0, e_t = 1", rough.e_t_apparent, np.ones(len(psi)), EXACT, ROUND_OFF, source)
    result.all_near(
        "energy after / before, mu = 0, e_n = e_t = 1",
        rough.energy_ratio,
        np.ones(len(psi)),
        EXACT,
        ROUND_OFF,
        source,
    )
    for e_t in (-0.9, -0.3, 0.5):
        got = pairs.fly(Impact(psi, 0.9, e_t, 0.0, M=M)).e_t_apparent
        source = "definition of e_t, above Eq. 8: without friction it is what one sees"
        result.all_near(f"e_t*, mu = 0, e_t = {e_t:g}", got, np.full(len(psi), e_t), EXACT, ROUND_OFF, source)


def _springs(result: Result) -> None:
    """The Hertz-Mindlin curves of the figures do what such contacts do."""
    e_n, _, mu = TABLE_II[1].e_n, TABLE_II[1].e_t, TABLE_II[1].mu
    psi = np.arctan(np.array([2.0, 3.0, 5.0]))
    found = classic.hertz_mindlin(psi, e_n, mu)
    source = "Coulomb's law through the whole contact"
    reason = "800 time steps a contact, first order"
    result.all_near(
        "P_t / P_n of a Hertz-Mindlin contact, tan(psi) = 2 to 5",
        found.tan_delta_2,
        np.full(3, mu),
        2e-3,
        reason,
        source,
    )


def _figure(n: int) -> Picture:
    """e_t* against cot(psi), IFR beside the classic laws."""
    row = TABLE_II[1]
    coefficients = (row.e_n, row.e_t, row.mu)
    cot = np.linspace(0.05, 4.0, n)
    psi = np.arctan(1.0 / cot)
    figure, (ax,) = style.panels(width=4.4, height=3.2)
    line = predicted.after(
        Impact(np.arctan(1.0 / np.linspace(0.01, 4.0, 500)), *coefficients), "percussion_center"
    )
    ax.plot(1.0 / np.tan(line.impact.psi), line.e_t_apparent, color=style.BLUE, label="IFR, Eqs. 26, 28")
    got = pairs.fly(Impact(np.arctan(1.0 / np.linspace(0.08, 3.9, 22)), *coefficients))
    style.points(ax, 1.0 / np.tan(got.impact.psi), got.e_t_apparent, style.BLUE, "IFR, simulated")
    # e_t* = 3 (1 + e_n) tan(delta_2) cot(psi) - 1 for two equal disks: P_t changes the slip by -3 P_t / m_n.
    for values, dash, colour, text in (
        (
            classic.walton_tan_delta_2(psi, row.e_n, row.mu, beta=0.4),
            ":",
            style.BLACK,
            r"constant $e_t^* = 0.4$ (Walton)",
        ),
        (
            classic.walton_tan_delta_2(psi, row.e_n, row.mu, beta=0.0),
            "-.",
            style.GREEN,
            "no slip afterwards (Brach)",
        ),
    ):
        ax.plot(cot, 3.0 * (1.0 + row.e_n) * values * cot - 1.0, dash, color=colour, label=text)
    spring = classic.hertz_mindlin(psi, row.e_n, row.mu)
    ax.plot(cot, 3.0 * (1.0 + spring.e_n) * spring.tan_delta_2 * cot - 1.0, "--", lw=1.0, color=style.VERMILION,
            label="Hertz-Mindlin contact")  # fmt: skip
    brach = pairs.fly(Impact(np.arctan(1.0 / np.linspace(0.15, 3.9, 14)), row.e_n, -1.0, row.mu), CONTACT)
    style.points(
        ax,
        1.0 / np.tan(brach.impact.psi),
        brach.e_t_apparent,
        style.GREEN,
        r"IFR, $e_t = -1$, contact point",
        "^",
    )
    ax.set(xlabel=r"$\cot\psi$", ylabel=r"$e_t^*$", xlim=(0, 4), ylim=(-1.05, 0.8))
    ax.legend(loc="lower right", fontsize=7)
    return Picture(
        "classic-laws",
        "Apparent tangential restitution of two aluminium coins. IFR starts at e_t for grazing impacts (left), where "
        "the classic laws start at -1. With e_t = -1 and contact-point sticking it is Brach's law.",
        figure,
    )
