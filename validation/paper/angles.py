"""Angles after the impact: Eqs. 18 to 25, Table II, Figs. 5 to 9, and beyond what the paper prints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np

from ...model.laws.coin_table import coins
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import classic, equations, pairs, predicted
from .equations import CLOSURES, FIGURE_5A, TABLE_II, Impact
from .pairs import After

QUESTION = "Do both disks leave at the angles of Eqs. 18 to 25, for any mass ratio, radii, k and spins?"
REFERENCE = "Eqs. 18 to 25 and Table II; Eqs. 6, 7, 10, 11, 13, 14, 16, 17 where those are too narrow"

STEEPEST = np.radians(85.0)
CLOSURE = "percussion_center"  # of the figures
ALUMINIUM, POLYESTER, BRONZE = ((row.e_n, row.e_t, row.mu) for row in (TABLE_II[1], TABLE_II[7], TABLE_II[5]))
M_LARGE = 12.00 / 9.23  # 500 pts on 100 pts, by the masses of Sec. III
BY_MASS = (
    (M_LARGE, "1.300", style.BLUE, "s"),
    (1.0, "1.000", style.BLACK, "o"),
    (1.0 / M_LARGE, "0.769", style.VERMILION, "^"),
)


@dataclass(frozen=True)
class Lines:
    """Slopes and intercepts of tan(delta_1) and tan(delta_2) against tan(psi), fitted to one pair of coins."""

    sliding_1: Array
    sliding_2: Array
    sticking_1: Array
    sticking_2: Array

    @classmethod
    def fit(cls, got: After, transit: float) -> Lines:
        """Least squares on either side of the transition, tan(psi) = `transit`."""
        x = np.tan(got.impact.psi)
        # Rounding of the velocities enters tan(delta) = v_t / v_n as 1 / v_n^2 where v_n is small.
        lines = [
            np.polyfit(x[where], (v_t / v_n)[where], 1, w=v_n[where] ** 2)
            for where in (x > 1.001 * transit, x < 0.999 * transit)
            for v_n, v_t in ((got.v_1n, got.v_1t), (got.v_2n, got.v_2t))
        ]
        return cls(*lines)

    @property
    def transit(self) -> float:
        """tan(psi) where the two lines of disk 2 meet."""
        return float((self.sliding_2[1] - self.sticking_2[1]) / (self.sticking_2[0] - self.sliding_2[0]))

    @property
    def coefficients(self) -> tuple[float, float, float]:
        """e_n, e_t, mu as the paper gets them: from Eq. 19's slope and intercept and Eq. 23's slope.

        Slopes A = (1 + e_t) / (3 (1 + e_n)) and B = (5 + 2 e_t) / (6 (1 + e_n)), so B - A = 1 / (2 (1 + e_n)).
        """
        A, B = float(self.sliding_2[0]), float(self.sticking_2[0])
        one_plus_e_n = 0.5 / (B - A)
        return one_plus_e_n - 1.0, 3.0 * A * one_plus_e_n - 1.0, float(self.sliding_2[1])


def coin_impact(row: equations.Table2Row, psi: Any) -> Impact:
    """An impact of the coins of a row of Table II, in SI units."""
    a, b = (coins[name] for name in row.coins)
    return Impact(psi, row.e_n, row.e_t, row.mu, M=a.mass / b.mass, m_1=a.mass, R_1=a.radius, R_2=b.radius)


def run(quick: bool) -> Result:
    result = Result()
    n = 60 if quick else 400
    _table_ii(result, n)
    _beyond(result, 300 if quick else 3000)
    _massive_plane(result, n)
    _figures(result)
    return result


def _table_ii(result: Result, n: int) -> None:
    """Every row of Table II, both closures: lines fitted to the simulated angles."""
    psi = np.linspace(0.01, STEEPEST, n)
    impacts = [coin_impact(row, psi) for row in TABLE_II]
    cells: list[tuple[str | float, ...]] = []
    for sticking, closure in CLOSURES.items():
        got = pairs.fly(joined(impacts), sticking)
        transits = [float(closure.tan_psi_transit(c)) for c in impacts]
        lines = [Lines.fit(got[i * n : (i + 1) * n], transit) for i, transit in enumerate(transits)]
        _compare_lines(result, closure, impacts, lines, transits)
        if sticking == "contact_point":
            continue
        for row, c, line, transit in zip(TABLE_II, impacts, lines, transits, strict=True):
            angle, right = np.degrees(np.arctan([line.transit, transit]))
            text = f"{row.disks}: transition angle [deg]"
            result.near(text, angle, right, 1e-9, pairs.ROUND_OFF, "Eq. 25, Table II")
            pairs_of = zip((row.e_n, row.e_t, row.mu), line.coefficients, strict=True)
            given = [value for pair in pairs_of for value in pair]
            cells.append((row.disks, round(float(c.M), 3), *given, row.psi_transit, float(angle)))
        result.exact(
            "e_n, e_t, mu recovered from the lines of all coins", [line.coefficients for line in lines],
            [(row.e_n, row.e_t, row.mu) for row in TABLE_II], "Table II; Eqs. 19 and 23 solved for them",
        )  # fmt: skip
    result.table(
        "Table II: coefficients that went in, and those recovered from the simulated angles",
        ("disks", "M", "e_n", "recovered", "e_t", "recovered", "mu", "recovered", "psi_transit, printed",
         "simulated (deg)"),
        cells,
        "M from the masses of Sec. III. The printed 29.6 degrees is 29.68; see the misprints.",
    )  # fmt: skip


def _compare_lines(
    result: Result,
    closure: equations.Equations,
    impacts: list[Impact],
    lines: list[Lines],
    transits: list[float],
) -> None:
    """Slopes are a law's difference over one unit of tan(psi), intercepts its value at psi = 0."""
    stick = f"Eqs. {closure.number['tan_delta']}"
    for field, text, law, source in (
        ("sliding_1", "tan(delta_1), sliding", equations.SLIDING.tan_delta_1, "Eq. 18"),
        ("sliding_2", "tan(delta_2), sliding", equations.SLIDING.tan_delta_2, "Eq. 19"),
        ("sticking_1", "tan(delta_1), sticking", closure.tan_delta_1, stick),
        ("sticking_2", "tan(delta_2), sticking", closure.tan_delta_2, stick),
    ):
        at_0, at_1 = (
            np.array([float(law(replace(c, psi=psi))) for c in impacts]) for psi in (0.0, np.arctan(1.0))
        )
        slope, intercept = np.array([getattr(line, field) for line in lines]).T
        result.exact(f"slope of {text}, {closure.text}, all coins", slope, at_1 - at_0, source)
        result.exact(f"intercept of {text}, {closure.text}, all coins", intercept, at_0, source)
    result.exact(
        f"tan(psi) at the transition, {closure.text}, all coins", [line.transit for line in lines], transits,
        f"Eq. {closure.number['tan_psi_transit']}",
    )  # fmt: skip


def _beyond(result: Result, n: int) -> None:
    """Angles of random pairs, against the velocities of Eqs. 6 to 17."""
    rng = np.random.default_rng(2)
    psi = rng.uniform(0.01, STEEPEST, n)
    base = Impact(psi, 0.87, -0.88, 0.21)
    radii = {"R_1": rng.uniform(0.5, 2.0, n), "R_2": rng.uniform(0.5, 2.0, n)}
    shapes = {"k_1": rng.uniform(1.0, 2.5, n), "k_2": rng.uniform(1.0, 2.5, n)}
    masses = {"M": 10.0 ** rng.uniform(-1.0, 1.0, n)}
    spin, spin_2 = rng.uniform(-2.0, 2.0, n), rng.uniform(-2.0, 2.0, n)
    groups: list[tuple[str, Impact, Any]] = [
        ("M = 0 (massive plane)", replace(base, M=0.0), 0.0),
        ("M = 0.769", replace(base, M=9.23 / 12.00), 0.0),
        ("M = 1", base, 0.0),
        ("M = 1.3", replace(base, M=12.00 / 9.23), 0.0),
        ("unequal radii, any M", replace(base, **radii, **masses), 0.0),
        ("k from 1 to 2.5, any M", replace(base, **shapes, **masses), 0.0),
        ("spinning disk 1", replace(base, **masses, w_o=spin), 0.0),
        ("spinning disk 2", replace(base, **masses), spin_2),
        ("both spinning, everything unequal", replace(base, **radii, **shapes, **masses, w_o=spin), spin_2),
    ]
    for sticking, closure in CLOSURES.items():
        for text, c, w_2o in groups:
            got, right = pairs.fly(c, sticking, w_2o=w_2o), predicted.after(c, sticking, w_2o)
            source = "Eqs. 6, 7, 10, 11 and " + ("13, 14" if sticking == "contact_point" else "16, 17")
            if w_2o is spin_2:
                source += "; spin of disk 2 by momentum balance (validation/paper/predicted.py)"
            result.exact(f"delta_1 [rad], {text}, {closure.text}", got.delta_1, right.delta_1, source)
            if np.all(got.impact.M > 0.0):  # an immovable disk 2 has no direction
                result.exact(f"delta_2 [rad], {text}, {closure.text}", got.delta_2, right.delta_2, source)


def _massive_plane(result: Result, n: int) -> None:
    """Eqs. 18, 20 and 22 at M = 0, fitted: the rebound from an infinitely massive body."""
    psi = np.linspace(0.01, STEEPEST, n)
    c = Impact(psi, 0.87, -0.88, 0.21, M=0.0)
    one = replace(c, psi=np.arctan(1.0))
    sliding = equations.SLIDING.tan_delta_1(one) - equations.SLIDING.tan_delta_1(replace(c, psi=0.0))
    for sticking, closure in CLOSURES.items():
        got = pairs.fly(c, sticking)
        x, y = np.tan(psi), got.v_1t / got.v_1n
        transit = float(closure.tan_psi_transit(c))
        low, high = (np.polyfit(x[where], y[where], 1) for where in (x < transit, x > transit))
        number, meet = closure.number["tan_delta_1"], (low[1] - high[1]) / (high[0] - low[0])
        for text, measured, expected, source in (
            ("slope of tan(delta_1), sticking", low[0], closure.tan_delta_1(one), f"Eq. {number} at M = 0"),
            ("slope of tan(delta_1), sliding", high[0], sliding, "Eq. 18 at M = 0"),
            ("tan(psi) at the transition", meet, transit, "Eqs. 24 (corrected), 25 at M = 0"),
        ):
            result.exact(f"{text}, M = 0, {closure.text}", measured, expected, source)


def joined(impacts: list[Impact]) -> Impact:
    """One impact whose arrays hold those of all, one after another."""
    n = len(impacts[0].psi)
    columns = {name: [np.broadcast_to(getattr(c, name), n) for c in impacts] for name in vars(impacts[0])}
    return Impact(**{name: np.concatenate(column) for name, column in columns.items()})


def _figures(result: Result) -> None:
    """Add figures 5, 6, 7, 8 and 9, and how far their points are from their lines."""
    by_mass = [(f"M = {text}", BRONZE, M, colour, marker) for M, text, colour, marker in BY_MASS]
    result.pictures += [
        _figure_5(result),
        _angle_of_disk_1(
            result, 6, "delta_1", by_mass, {"ylim": (0, 185), "yticks": range(0, 181, 30)},
            "Angle of disk 1 after the impact of bronze-aluminium coins. Lines: Eqs. 18 and 22; markers: "
            "simulated. For M = 0.769 < e_n = 0.9 disk 1 recoils: delta_1 starts at 180 degrees.",
        ),
        _figure_7(result),
        _angle_of_disk_1(
            result, 8, "alpha_1",
            [("aluminium", ALUMINIUM, 1.0, style.BLUE, "s"), ("polyester resin", POLYESTER, 1.0, style.VERMILION, "o")],
            {"ylim": (0, None)},
            "Deflection of disk 1 from its incoming direction, aluminium coins and polyester disks. Lines: "
            "Eqs. 18 and 22; markers: simulated.",
        ),
        _angle_of_disk_1(
            result, 9, "alpha_1", by_mass, {"ylim": (0, 185), "yticks": range(0, 181, 30)},
            "Deflection of disk 1 for bronze-aluminium coins of three mass ratios (the print has 1.28 and "
            "0.78; the masses of Sec. III give 1.300 and 0.769). Lines: Eqs. 18 and 22; markers: simulated.",
        ),
    ]  # fmt: skip


def _check(result: Result, figure: str, quantity: str, got: After, ordinate: Callable[[After], Any]) -> None:
    """A row: the points of a figure against its line."""
    right = ordinate(predicted.after(got.impact, CLOSURE))
    result.exact(f"points of {figure}, {quantity}", ordinate(got), right, "Eqs. 18, 19, 22, 23")


def _figure_5(result: Result) -> Picture:
    figure, axes = style.panels(2)
    for ax, coefficients, name, coin in zip(
        axes, (FIGURE_5A, ALUMINIUM), "ab", ("bronze-aluminium 5 pts", "aluminium 1 pta"), strict=True
    ):
        e_n, _, mu = coefficients
        psi = np.arctan(np.linspace(0.02, 5.5, 300))
        line = predicted.after(Impact(psi, *coefficients), CLOSURE)
        got = pairs.fly(Impact(np.arctan(np.r_[0.06:1.0:9j, 1.2:5.4:20j]), *coefficients), CLOSURE)
        _check(result, f"Fig. 5{name}", "tan(delta_2)", got, lambda pair: np.tan(pair.delta_2))
        ax.plot(np.tan(psi), np.tan(line.delta_2), color=style.BLUE, label="Eqs. 19, 23")
        style.points(ax, np.tan(got.impact.psi), np.tan(got.delta_2), style.BLUE, "simulated")
        ax.plot(np.tan(psi), classic.walton_tan_delta_2(psi, e_n, mu, beta=0.4), ":", color=style.BLACK,
                label=r"constant $e_t^* = 0.4$ (Walton)")  # fmt: skip
        spring = np.arctan(np.linspace(0.02, 5.5, 80))
        ax.plot(np.tan(spring), classic.hertz_mindlin(spring, e_n, mu).tan_delta_2, "--", color=style.VERMILION,
                lw=1.0, label="Hertz-Mindlin contact")  # fmt: skip
        ax.set(xlabel=r"$\tan\psi$", ylabel=r"$\tan\delta_2$", xlim=(0, 5.5), ylim=(0, None))
        ax.legend(loc="lower right", title=coin, title_fontsize=8)
    style.letters(*axes)
    caption = (
        "Figure 5. Angle of disk 2 after the impact of two equal coins. The classic laws (dotted: tangential "
        "restitution of the slip is constant until Coulomb's law limits it; dashed: Hertz-Mindlin springs with "
        "Coulomb's law, integrated in time) end on the horizontal line tan(delta_2) = mu; IFR continues with "
        "slope (1 + e_t) / (3 (1 + e_n)). Panel a is captioned copper-aluminium in print; its coefficients are "
        "those of the bronze-aluminium 5 pts coin."
    )
    return Picture("figure-05", caption, figure)


def _angle_of_disk_1(
    result: Result, number: int, name: str, coins: Sequence[tuple[str, tuple[float, float, float], float, str, str]],
    limits: dict[str, Any], about: str,
) -> Picture:  # fmt: skip
    """An angle of disk 1 against psi: name, coefficients, M, colour and marker of each kind of pairs."""
    figure, (ax,) = style.panels()
    fine, coarse = (np.radians(np.linspace(*ends)) for ends in ((0.05, 89.0, 600), (2.5, 87.5, 35)))
    for text, coefficients, M, colour, marker in coins:
        line = predicted.after(Impact(fine, *coefficients, M=M), CLOSURE)
        got = pairs.fly(Impact(coarse, *coefficients, M=M), CLOSURE)
        _check(result, f"Fig. {number}", f"{name} [rad], {text}", got, attrgetter(name))
        ax.plot(np.degrees(fine), np.degrees(getattr(line, name)), color=colour)
        style.points(ax, np.degrees(coarse), np.degrees(getattr(got, name)), colour, text, marker)
    ax.set(xlabel=r"$\psi$ (deg)", ylabel=rf"$\{name}$ (deg)", xlim=(0, 90), **limits)
    ax.legend(loc="upper right", title="M = 1" if number == 8 else None, title_fontsize=8)
    return Picture(f"figure-{number:02d}", f"Figure {number}. {about}", figure)


def _figure_7(result: Result) -> Picture:
    figure, (ax,) = style.panels()
    for M, text, colour, marker in BY_MASS:
        psi = np.arctan(np.linspace(0.0, 0.57, 50))
        line = predicted.after(Impact(psi, *BRONZE, M=M), CLOSURE)
        got = pairs.fly(Impact(np.arctan(np.linspace(0.02, 0.56, 18)), *BRONZE, M=M), CLOSURE)
        _check(result, "Fig. 7", f"tan(delta_1), M = {text}", got, lambda pair: pair.v_1t / pair.v_1n)
        ax.plot(np.tan(psi), line.v_1t / line.v_1n, color=colour)
        style.points(ax, np.tan(got.impact.psi), got.v_1t / got.v_1n, colour, f"M = {text}", marker)
    ax.axhline(0.0, color=style.GREY, lw=0.5)
    ax.set(xlabel=r"$\tan\psi$", ylabel=r"$\tan\delta_1$", xlim=(0, 0.58))
    ax.legend(loc="upper left")
    caption = (
        "Figure 7. Disk 1 in the sticking regime (bronze-aluminium coins). Lines: Eq. 22; markers: simulated."
    )
    return Picture("figure-07", caption, figure)
