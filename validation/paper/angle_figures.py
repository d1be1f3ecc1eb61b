"""Figures 5 to 9 of the paper, with simulated points on its lines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from ..report import style
from ..report.registry import Picture, Result
from . import classic, pairs, predicted
from .equations import FIGURE_5A, TABLE_II, Impact
from .pairs import After

CLOSURE = "percussion_center"
ALUMINIUM, POLYESTER, BRONZE = ((row.e_n, row.e_t, row.mu) for row in (TABLE_II[1], TABLE_II[7], TABLE_II[5]))
M_LARGE = 12.00 / 9.23  # 500 pts on 100 pts, by the masses of Sec. III
BY_MASS = (
    (M_LARGE, "1.300", style.BLUE, "s"),
    (1.0, "1.000", style.BLACK, "o"),
    (1.0 / M_LARGE, "0.769", style.VERMILION, "^"),
)


def draw(result: Result) -> None:
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
        "Coulomb's law, integrated in time) end on the horizontal line tan(delta_2) = mu; IFR goes on with "
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
