"""Laws that IFR contains: Walton's and Brach's, smooth and perfectly rough disks; and those that it does not."""

from __future__ import annotations

import numpy as np

from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import classic, pairs, predicted
from .equations import TABLE_II, Impact

QUESTION = "Does IFR become Walton's, Brach's, smooth and perfectly rough disks where it should?"
REFERENCE = (
    "Sec. II E (Brach's sticking: e_t = -1, not 0), momentum and energy balance; validation/paper/classic.py"
)

CONTACT = "contact_point"
ALUMINIUM = TABLE_II[1]


def run(quick: bool) -> Result:
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
    result.exact("P_t / P_n, e_t = -1, sliding", (got.P_t / got.P_n)[slide], 0.21, source)
    source = "Brach, no sliding (Eq. 27 at e_t = -1)"
    result.exact("e_t*, e_t = -1, sticking", got.e_t_apparent[~slide], 0.0, source)
    # Walton's restitution beta of the slip, in every collision: much friction, and e_t = beta - 1.
    got = pairs.fly(Impact(psi, 0.87, 0.4 - 1.0, 1e6, M=M), CONTACT)
    source = "Walton's constant restitution of the slip (Eq. 27)"
    result.exact("e_t*, e_t = -0.6, mu = 1e6", got.e_t_apparent, 0.4, source)


def _smooth_and_rough(result: Result, psi: Array, M: Array) -> None:
    smooth = pairs.fly(Impact(psi, 0.9, -1.0, 0.0, M=M))
    source = "smooth disks: no tangential impulse"
    result.exact("v_1t / v_o, mu = 0, e_t = -1", smooth.v_1t, np.sin(psi), source)
    result.exact("R_2 omega_2, mu = 0, e_t = -1", smooth.Rw_2, 0.0, source)
    rough = pairs.fly(Impact(psi, 1.0, 1.0, 0.0, M=M))
    source = "perfectly rough elastic disks: the slip is reversed and energy kept"
    result.exact("e_t*, mu = 0, e_t = 1", rough.e_t_apparent, 1.0, source)
    result.exact("energy after / before, mu = 0, e_n = e_t = 1", rough.energy_ratio, 1.0, source)
    source = "definition of e_t, above Eq. 8: without friction it is what one sees"
    for e_t in (-0.9, -0.3, 0.5):
        got = pairs.fly(Impact(psi, 0.9, e_t, 0.0, M=M)).e_t_apparent
        result.exact(f"e_t*, mu = 0, e_t = {e_t:g}", got, e_t, source)


def _springs(result: Result) -> None:
    """The Hertz-Mindlin curves of the figures do what such contacts do."""
    found = classic.hertz_mindlin(np.arctan([2.0, 3.0, 5.0]), ALUMINIUM.e_n, ALUMINIUM.mu)
    result.all_near(
        "P_t / P_n of a Hertz-Mindlin contact, tan(psi) = 2 to 5", found.tan_delta_2, ALUMINIUM.mu, 2e-3,
        "800 time steps a contact, first order", "Coulomb's law through the whole contact",
    )  # fmt: skip


def _figure(n: int) -> Picture:
    """e_t* against cot(psi), IFR and the classic laws."""
    row, cot = ALUMINIUM, np.linspace(0.05, 4.0, n)
    coefficients, psi = (row.e_n, row.e_t, row.mu), np.arctan(1.0 / cot)

    def angles(first: float, last: float, number: int) -> Array:
        return np.asarray(np.arctan(1.0 / np.linspace(first, last, number)))

    figure, (ax,) = style.panels(width=4.4, height=3.2)
    line = predicted.after(Impact(angles(0.01, 4.0, 500), *coefficients), "percussion_center")
    ax.plot(1.0 / np.tan(line.impact.psi), line.e_t_apparent, color=style.BLUE, label="IFR, Eqs. 26, 28")
    got = pairs.fly(Impact(angles(0.08, 3.9, 22), *coefficients))
    style.points(ax, 1.0 / np.tan(got.impact.psi), got.e_t_apparent, style.BLUE, "IFR, simulated")
    # e_t* = 3 (1 + e_n) tan(delta_2) cot(psi) - 1 for two equal disks: P_t changes the slip by -3 P_t / m_n.
    for beta, dash, colour, text in (
        (0.4, ":", style.BLACK, r"constant $e_t^* = 0.4$ (Walton)"),
        (0.0, "-.", style.GREEN, "no slip afterwards (Brach)"),
    ):
        values = classic.walton_tan_delta_2(psi, row.e_n, row.mu, beta=beta)
        ax.plot(cot, 3.0 * (1.0 + row.e_n) * values * cot - 1.0, dash, color=colour, label=text)
    spring = classic.hertz_mindlin(psi, row.e_n, row.mu)
    ax.plot(cot, 3.0 * (1.0 + spring.e_n) * spring.tan_delta_2 * cot - 1.0, "--", lw=1.0, color=style.VERMILION,
            label="Hertz-Mindlin contact")  # fmt: skip
    brach = pairs.fly(Impact(angles(0.15, 3.9, 14), row.e_n, -1.0, row.mu), CONTACT)
    label = r"IFR, $e_t = -1$, contact point"
    style.points(ax, 1.0 / np.tan(brach.impact.psi), brach.e_t_apparent, style.GREEN, label, "^")
    ax.set(xlabel=r"$\cot\psi$", ylabel=r"$e_t^*$", xlim=(0, 4), ylim=(-1.05, 0.8))
    ax.legend(loc="lower right", fontsize=7)
    caption = (
        "Apparent tangential restitution of two aluminium coins. IFR starts at e_t for grazing impacts (left), where "
        "the classic laws start at -1. With e_t = -1 and contact-point sticking it is Brach's law."
    )
    return Picture("classic-laws", caption, figure)
