"""Apparent tangential restitution e_t*: Eqs. 26 to 28, Table I, Figs. 3 and 12, and the spheres of Fig. 3 measured.

A. H. Kharaz, D. A. Gorham and A. D. Salman, Powder Technology 120, 281 (2001), doi:10.1016/S0032-5910(01)00283-2, shot
spheres without spin at a glass anvil; `kharaz2001.csv` has points that others digitised from their figures. With the
impulse P_t, the velocity v along the anvil and v' after:

    m (v - v') = P_t,  m R omega / k = P_t,  slip' = v - (1 + k) P_t / m.

*Without any law*, then, k = R omega / (v - v'), and 1 + k = (v - slip') / (v - v'). *With the IFR law*, of a sphere
that slides to the end, tan psi > (1 + k) mu (1 + e_n),

    P_t / m v_o = (1 + e_t) / (1 + k) sin psi + mu (1 + e_n) cos psi,

so that e_com = v'/v and the angle of the centre hold k in (1 + e_t) / (1 + k) only: between 7/2 and 3 e_com changes by
0.002, less than what it was read off to. They cannot distinguish the two; omega, with k in front of it, can, and so
can the slip, with 1 + k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...tools import csv as csv_rows
from ...tools.checked import Array
from ..report import style
from ..report.registry import EXACT, Picture, Result
from . import equations, pairs, predicted
from .equations import CLOSURES, TABLE_II, Impact
from .pairs import After

QUESTION = (
    "Does the apparent tangential restitution follow Eqs. 26 to 28 and Table I, and that of spheres 7/2 or 3?"
)
REFERENCE = "Eqs. 26 to 28, Table I (corrected); 1 + k = 7/2 for a sphere; doi:10.1016/S0032-5910(01)00283-2"

REASON = "f64 round-off, divided by the slip before, 0.05 or more"
# Fig. 3: coefficients e_n, e_t, mu that the paper gives oxide spheres on a glass anvil (Kharaz et al.), and granules on
# a steel plate (Antonyuk et al.).
SPHERES = (("oxide spheres on glass", (0.98, -0.96, 0.09)), ("granules on steel", (0.77, -0.86, 0.16)))
FACTORS = {"7/2": 2.5, "3": 2.0}
"""k, by the factor 1 + k: that of a sphere, and that of a disk, which the paper takes."""
SPEED, RADIUS = 3.875, 2.5e-3  # of the spheres [m/s, m]: 3.85 to 3.9 m/s, and 5 mm across
READ = {"e_com": 0.003, "omega": 6.5, "patch": 0.5, "psi": 1.25, "speed": 0.025, "e_n": 0.01}
"""Uncertainties of the digitised points, in their units: how far the two digitisations are apart at most (e_com,
omega), and angles of one impact between graphs (psi); speeds as given; half a degree of slip, and 1 % of e_n."""
QUANTITIES = {
    "e_com": ("e_com", "", 1.0), "omega": ("spin after", "rad/s", SPEED / RADIUS),
    "centre": ("angle of the centre after", "deg", 57.3), "patch": ("angle of the contact point after", "deg", 57.3),
}  # fmt: skip
"""Name, unit and scale of what was measured."""
KHARAZ = "Kharaz et al. (2001), doi:10.1016/S0032-5910(01)00283-2, digitised by others (kharaz2001.csv)"
USED = ("Kratos", "Lethe")
PERCUSSION = "percussion_center"
POLYESTER = (TABLE_II[7].e_n, TABLE_II[7].e_t, TABLE_II[7].mu)


def run(quick: bool) -> Result:
    result = Result()
    n = 200 if quick else 3000
    _equations_26_to_28(result, n)
    _table_i(result, n)
    _spheres(result)
    points = measured()
    _without_law(result, points)
    _residuals(result, points)
    result.pictures += [_figure_3(result, points), _figure_12(result)]
    return result


def _equations_26_to_28(result: Result, n: int) -> None:
    rng = np.random.default_rng(5)
    psi = rng.uniform(0.05, 1.48, n)
    base = Impact(psi, 0.87, -0.88, 0.21, M=10.0 ** rng.uniform(-1.0, 1.0, n))
    shapes = replace(base, k_1=rng.uniform(1.0, 2.5, n), k_2=rng.uniform(1.0, 2.5, n))
    for text, c, more in (
        ("homogeneous disks", base, ""),
        ("k from 1 to 2.5", shapes, ", with m_n/m_t for 3"),
    ):
        for sticking, stick in CLOSURES.items():
            got, slide = pairs.fly(c, sticking).e_t_apparent, predicted.slides(c, sticking)
            for regime, where, by in (("sliding", slide, equations.SLIDING), ("sticking", ~slide, stick)):
                quantity, source = (
                    f"e_t*, {regime}, {text}, {stick.text}",
                    f"Eq. {by.number['e_t_apparent']}{more}",
                )
                result.all_near(quantity, got[where], by.e_t_apparent(c)[where], EXACT, REASON, source)


def _table_i(result: Result, n: int) -> None:
    """The six regimes of Table I: unequal radii and masses; where no spin is stopped."""
    rng = np.random.default_rng(6)
    c = Impact(
        rng.uniform(0.05, 1.48, n), 0.87, -0.88, 0.21, M=10.0 ** rng.uniform(-0.5, 0.5, n),
        R_1=rng.uniform(0.8, 1.2, n), R_2=rng.uniform(0.8, 1.2, n),
    )  # fmt: skip
    lever = "(1/R_1 + M/R_2)/(1 + M)"
    torques = (
        ("rolling", 0.02, equations.e_t_apparent_rolling, f"2 rho (1 + e_n) cot(psi) {lever}",
         equations.Printed.rolling, "2 rho (1 + e_n) cot(psi) / r"),
        ("nonrolling", 0.6, equations.e_t_apparent_nonrolling, f"2/3 r {lever}",
         equations.Printed.nonrolling, "2"),
    )  # fmt: skip
    cells: list[tuple[str | float, ...]] = []
    for name, sticking, without, words in (
        ("sliding", PERCUSSION, equations.SLIDING.e_t_apparent, "e_t + 3 mu (1 + e_n) cot(psi)"),
        ("sticking, contact point", "contact_point", equations.CONTACT_POINT.e_t_apparent, "1 + e_t"),
        ("sticking, percussion centre", PERCUSSION, equations.PERCUSSION_CENTER.e_t_apparent, "3/2 + e_t"),
    ):
        for kind, rho, right, less, misprint, wrong in torques:
            one = replace(c, rho=rho)
            got = pairs.fly(one, sticking)
            where = (got.Rw_2 > 1e-9) & (got.Rw_1 < -1e-9)  # Table I holds while friction stops no spin
            where &= (equations.T_rolling(one) < equations.T_nonrolling(one)) == (kind == "rolling")
            where &= predicted.slides(one, sticking) == (name == "sliding")
            measured, text = got.e_t_apparent[where], f"{name} plus {kind}"
            expected, printed = (law(one, without(one))[where] for law in (right, misprint))
            result.all_near(f"e_t*, {text}", measured, expected, EXACT, REASON, "Table I, corrected")
            off = [float(np.max(np.abs(measured - each), initial=0.0)) for each in (expected, printed)]
            cells.append((text, f"{words} - {less}", off[0], f"{words} - {wrong}", off[1]))
    result.table(
        "Table I: apparent tangential restitution, corrected and as printed",
        ("regime", "e_t*, corrected", "largest deviation", "as printed", "largest deviation"),
        cells,
        "Two homogeneous disks of random masses and radii (0.8 to 1.2). r (1/R_1 + M/R_2)/(1 + M) is 1 for "
        "R_1 = R_2 or M = 1.",
    )


def _spheres(result: Result) -> None:
    """The slope of e_t* over mu (1 + e_n) cot(psi), Fig. 3: 7/2 for spheres on a plane, 3 for disks."""
    psi = np.radians(np.linspace(45.0, 85.0, 40))
    for text, (e_n, e_t, mu) in SPHERES:
        for body, k, factor in (("spheres", 2.5, 3.5), ("disks", 2.0, 3.0)):
            c = Impact(psi, e_n, e_t, mu, M=0.0, k_1=k, k_2=k)
            slope, _ = np.polyfit(mu * (1.0 + e_n) / np.tan(psi), pairs.fly(c).e_t_apparent, 1)
            quantity = f"slope of e_t* over mu (1 + e_n) cot(psi), {body}, {text}"
            result.near(quantity, slope, factor, EXACT, REASON, "Eq. 26 with m_n/m_t = 1 + k")


class Readings(NamedTuple):
    """Measured spheres: angles of incidence [rad], and values in the units of `QUANTITIES`; both of shape (n,)."""

    psi: Array
    value: Array

    def within(self, mask: NDArray[np.bool_]) -> Readings:
        """Those that a mask chooses."""
        return Readings(self.psi[mask], self.value[mask])


def measured() -> dict[tuple[str, str], Readings]:
    """The digitised points of Kharaz et al., by quantity and digitisation."""
    _, *lines = (row for row, _ in csv_rows.each(Path(__file__).with_name("kharaz2001.csv"), most=100_000))
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for quantity, psi, value, who in lines:
        found.setdefault((quantity, who), []).append((float(psi), float(value)))
    columns = {key: np.array(pairs_).T for key, pairs_ in found.items()}
    return {key: Readings(np.radians(psi), value) for key, (psi, value) in columns.items()}


def _together(points: dict[tuple[str, str], Readings], quantity: str) -> Readings:
    """Both digitisations, of spheres that slide to the end: tan psi > (7/2) mu (1 + e_n) with the paper's mu."""
    both = [points[quantity, who] for who in USED if (quantity, who) in points]
    whole = Readings(*(np.concatenate(each) for each in zip(*both, strict=True)))
    e_n, _, mu = SPHERES[0][1]
    return whole.within(np.tan(whole.psi) > 3.5 * mu * (1.0 + e_n))


def _impact(psi: Array, k: float, coefficients: Sequence[float] = SPHERES[0][1]) -> Impact:
    """Spheres of Kharaz et al., or bodies of another k, on the anvil, in SI units."""
    e_n, e_t, mu = coefficients
    return Impact(psi, e_n, e_t, mu, M=0.0, R_1=RADIUS, R_2=RADIUS, k_1=k, k_2=k, v_o=SPEED)


def _observables(got: After) -> dict[str, Array]:
    """Observables of Kharaz et al., of simulated or predicted impacts."""
    away, c = -got.v_1n, got.impact
    return {
        "e_com": got.v_1t / (c.v_o * np.sin(c.psi)),
        "omega": -got.Rw_1 / c.R_1,
        "centre": np.degrees(np.arctan2(got.v_1t, away)),
        "patch": np.degrees(np.arctan2(got.v_1t + got.Rw_1, away)),
    }


def _inertia(quantity: str, centre: Readings, other: Readings, **off: float) -> float:
    """1 + k by impulse and angular momentum alone, from e_com and spins or slips of the same impacts.

    Readings are shifted by these errors, with the names of `READ`.
    """
    v, psi = SPEED + off.get("speed", 0.0), centre.psi + np.radians(off.get("psi", 0.0))
    lost = np.sum(v * np.sin(psi) * (1.0 - centre.value - off.get("e_com", 0.0)))
    value = other.value + off.get(quantity, 0.0)
    if quantity == "omega":
        return 1.0 + float(np.sum(RADIUS * value) / lost)
    slip = (SPHERES[0][1][0] + off.get("e_n", 0.0)) * np.cos(psi) * np.tan(np.radians(value))
    return float(np.sum(v * (np.sin(psi) - slip)) / lost)


def _without_law(result: Result, points: dict[tuple[str, str], Readings]) -> None:
    """k of the spheres, of impacts from 15 to 65 degrees.

    Below, a degree of psi is more than 7 % of v; beyond, v - v' is lost in what e_com was read off to.
    """
    for quantity, who in (("omega", "Kratos"), ("omega", "Lethe"), ("patch", "Kratos")):
        centre, other = points["e_com", who], points[quantity, who]
        apart = np.abs(np.degrees(centre.psi[:, None] - other.psi))
        same = (apart.min(axis=1) < 1.5) & (np.abs(np.degrees(centre.psi) - 40.0) < 25.0)
        centre = centre.within(same)
        other = Readings(*(each[apart.argmin(axis=1)[same]] for each in other))
        found = _inertia(quantity, centre, other)
        names = [name for name in READ if name in ("e_com", "psi", "speed", "e_n", quantity)]
        tolerance = sum(
            abs(_inertia(quantity, centre, other, **{name: READ[name]}) - found) for name in names
        )
        result.near(
            f"1 + k of spheres from {QUANTITIES[quantity][0]} and e_com, {len(centre.psi)} impacts, by {who}, no law",
            found, 3.5, tolerance,
            "1.25 deg of psi, 0.003 of e_com, 0.025 m/s, and 6.5 rad/s or 0.5 deg and 0.01 of e_n, each the same way "
            "in all readings, added up", KHARAZ,
        )  # fmt: skip


def _residuals(result: Result, points: dict[tuple[str, str], Readings]) -> None:
    """Residuals of measured spheres from simulated ones with 7/2 and with 3, and fits of mu and e_t with each."""
    from scipy.optimize import least_squares

    cells: list[tuple[str | float, ...]] = []
    for quantity, (name, unit, scale) in QUANTITIES.items():
        psi, value = _together(points, quantity)
        line: list[str | float] = [f"{name} [{unit}]" if unit else name, float(len(psi))]
        spread, fits, curves = [], [], []
        for factor, k in FACTORS.items():
            got = _observables(pairs.fly(_impact(psi, k)))[quantity]
            exact = _observables(predicted.after(_impact(psi, k), "percussion_center"))[quantity]
            found, expected = (float(np.sqrt(np.mean((value - each) ** 2))) for each in (got, exact))
            result.near(
                f"rms residual of {name}{f' [{unit}]' if unit else ''}, {len(psi)} measured points that slide, factor "
                f"{factor}", found, expected, scale * EXACT, REASON, f"Eqs. 6 to 17 with k = {k:g}; {KHARAZ}",
            )  # fmt: skip

            def misfit(p: Array, k: float = k, psi: Array = psi, value: Array = value, quantity: str = quantity,
                       scale: float = scale) -> Array:  # fmt: skip
                c = _impact(psi, k, (SPHERES[0][1][0], p[1], p[0]))
                sliding = replace(predicted.after(c, "percussion_center"), v_1t=equations.SLIDING.v_1t(c),
                                  Rw_1=-k * (equations.P_et(c) + equations.SLIDING.P_f(c)))  # fmt: skip
                return np.asarray((_observables(sliding)[quantity] - value) / scale)

            fit = least_squares(misfit, [0.09, -0.96])
            spread.append(found)
            fits += [float(fit.x[0]), float(fit.x[1])]
            curves.append(got)
        apart = float(np.sqrt(np.mean((curves[0] - curves[1]) ** 2)))
        better = "7/2" if spread[0] < spread[1] else "3"
        cells.append((*line, *spread, apart, better, fits[0], fits[2], fits[1], fits[3]))
    result.table(
        "Spheres of Kharaz et al. that slide: residuals with the paper's coefficients, and fits of mu and e_t",
        ("quantity", "points", "rms, 7/2", "rms, 3", "7/2 and 3 apart (rms)", "smaller rms", "mu fitted, 7/2",
         "mu fitted, 3", "e_t fitted, 7/2", "e_t fitted, 3"),
        cells,
        "e_n = 0.98 throughout. A factor that is right must give one mu for all four quantities. e_com and the "
        "angle of the centre do not discriminate: there the factors differ by less than the residuals of either.",
    )  # fmt: skip


def _figure_3(result: Result, points: dict[tuple[str, str], Readings]) -> Picture:
    figure, (ax, spins) = style.panels(2, width=4.0, height=3.3)
    for (text, coefficients), colour, marker in zip(SPHERES, style.COLOURS, "os", strict=False):
        e_n, _, mu = coefficients
        for (note, k), dash in zip(FACTORS.items(), ("-", "--"), strict=True):
            # The sliding regime: cot(psi) up to 1 / (2 mu (1 + e_n)).
            cot = np.linspace(0.02, 0.5 / (mu * (1.0 + e_n)), 15)
            c = Impact(np.arctan(1.0 / cot), *coefficients, M=0.0, k_1=k, k_2=k)
            got, right = pairs.fly(c).e_t_apparent, equations.SLIDING.e_t_apparent(c)
            ax.plot(cot, right, dash, color=colour, label=f"{text}, {note}")
            result.all_near(f"points of Fig. 3, {text}, factor {note}", got, right, EXACT, REASON, "Eq. 26")
            style.points(ax, cot, got, colour, None, marker if k == 2.5 else "x")
    slip = points["patch", "Kratos"]
    slip = slip.within(np.tan(slip.psi) > 1.0 / 3.0)
    e_t = -SPHERES[0][1][0] * np.tan(np.radians(slip.value)) / np.tan(slip.psi)
    measured_look: Any = {"color": style.BLACK, "ms": 4.0, "ls": "none"}
    ax.plot(1.0 / np.tan(slip.psi), e_t, "D", label="Kharaz et al. (2001)", zorder=4, **measured_look)
    ax.set(xlabel=r"$\cot\psi$", ylabel=r"$e_t^*$", xlim=(0, 3), ylim=(-1.3, 1.0))
    ax.legend(loc="lower right", fontsize=7)
    psi = np.radians(np.linspace(3.0, 89.0, 400))
    for (note, k), dash in zip(FACTORS.items(), ("-", "--"), strict=True):
        line = _observables(predicted.after(_impact(psi, k), "percussion_center"))["omega"]
        spins.plot(np.degrees(psi), line, dash, color=style.BLUE, label=f"factor {note}")
    for who, marker, face in zip(USED, "D^", (style.BLACK, "none"), strict=True):
        one, label = points["omega", who], f"Kharaz et al., by {who}"
        spins.plot(np.degrees(one.psi), one.value, marker, mfc=face, label=label, **measured_look)
    spins.set(
        xlabel=r"angle of incidence $\psi$ (deg)", ylabel="spin after (rad/s)", xlim=(0, 90), ylim=(0, 850)
    )
    spins.legend(loc="upper right", fontsize=7)
    style.letters(ax, spins)
    caption = (
        "Figure 3. (a) Sliding spheres on a massive plane, coefficients of the paper. Solid lines and open markers: "
        "spheres (k = 5/2, factor 7/2); dashed and crosses: the factor 3 of disks that the paper uses. Diamonds: "
        "contact point of the spheres of Kharaz et al., doi:10.1016/S0032-5910(01)00283-2; there are no data of the "
        "granules here. (b) Spin of those spheres, measured and by the law with both factors; below 20 degrees "
        "they stick."
    )
    return Picture("figure-03", caption, figure)


def _figure_12(result: Result) -> Picture:
    figure, (ax,) = style.panels()
    psi = np.radians(np.linspace(3.0, 88.0, 600))
    line: Any = predicted.after(Impact(psi, *POLYESTER), "percussion_center")
    got = pairs.fly(Impact(np.radians(np.linspace(8.0, 87.0, 34)), *POLYESTER))
    right = predicted.after(got.impact, "percussion_center").e_t_apparent
    result.all_near("points of Fig. 12, e_t*", got.e_t_apparent, right, EXACT, REASON, "Eqs. 26 and 28")
    ax.plot(1.0 / np.tan(psi), line.e_t_apparent, color=style.BLUE, label="Eqs. 26, 28")
    style.points(ax, 1.0 / np.tan(got.impact.psi), got.e_t_apparent, style.BLUE, "simulated")
    ax.axhline(0.0, color=style.GREY, lw=0.5)
    ax.set(xlabel=r"$\cot\psi$", ylabel=r"$e_t^*$", xlim=(0, 5), ylim=(-1.0, 0.8))
    ax.legend(loc="lower right", title="polyester resin, M = 1", title_fontsize=8)
    caption = (
        "Figure 12. Apparent tangential restitution of polyester disks: linear in cot(psi) while they slide (left), "
        "constant while they stick. Line: Eqs. 26 and 28; markers: simulated."
    )
    return Picture("figure-12", caption, figure)
