"""Rolling friction: Eqs. 34 to 41 as corrected, Fig. 11, and where the four regimes meet."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import equations, pairs, predicted
from .equations import TABLE_II, Impact, Law

QUESTION = "Does disk 2 spin as Eqs. 34 to 41 say, and do the four regimes meet where they should?"
REFERENCE = "Eqs. 31 to 41 (33, 35, 38, 41 corrected); boundaries by equality of the impulses"

BRONZE = (TABLE_II[5].e_n, TABLE_II[5].e_t, TABLE_II[5].mu)
REGIMES = tuple(
    f"{slide} plus {roll}" for roll in ("rolling", "nonrolling") for slide in ("sliding", "sticking")
)


def spin_laws(sticking: str) -> dict[str, tuple[Law, str]]:
    """R_2 omega_2 in the four regimes, and its equation."""
    found = {}
    for slide, by in (("sliding", equations.SLIDING), ("sticking", equations.CLOSURES[sticking])):
        found[f"{slide} plus rolling"] = (by.Rw_2_rolling, f"Eq. {by.number['rolling']}")
        found[f"{slide} plus nonrolling"] = (by.Rw_2_nonrolling, f"Eq. {by.number['nonrolling']}")
    return found


def regime_of(c: Impact, sticking: str) -> NDArray[np.str_]:
    """Names of the regimes by the smaller of Eqs. 31 and 32, and of 9 and 12 or 15."""
    slide = np.where(predicted.slides(c, sticking), "sliding", "sticking")
    roll = np.where(equations.T_rolling(c) < equations.T_nonrolling(c), " plus rolling", " plus nonrolling")
    return np.char.add(slide, roll)


def run(quick: bool) -> Result:
    result = Result()
    n = 400 if quick else 4000
    for sticking in equations.CLOSURES:
        _spins(result, sticking, n)
        _boundaries(result, sticking, 60 if quick else 200)
    result.pictures += [_figure_11(result), _figure_regimes()]
    return result


def _spins(result: Result, sticking: str, n: int) -> None:
    """Random homogeneous pairs, small and large rho: each of the four regimes."""
    rng = np.random.default_rng(7)
    c = Impact(
        rng.uniform(0.01, 1.48, n), 0.87, -0.88, 0.21, M=10.0 ** rng.uniform(-0.7, 0.7, n),
        R_1=rng.uniform(0.8, 1.2, n), R_2=rng.uniform(0.8, 1.2, n), rho=rng.choice([0.02, 0.6], n),
    )  # fmt: skip
    got, regime, name = pairs.fly(c, sticking), regime_of(c, sticking), equations.CLOSURES[sticking].text
    stopped = np.zeros(n, dtype=bool)
    for text, (law, source) in spin_laws(sticking).items():
        free = law(c) > 0.0  # the torque does not stop the spin
        here = (regime == text) & free
        result.exact(f"R_2 omega_2, {text}, {name}", got.Rw_2[here], law(c)[here], source)
        stopped |= (regime == text) & ~free
    result.all_near(
        f"R_2 omega_2 where the torque is larger than what stops the spin, {name}", got.Rw_2[stopped], 0.0, 1e-15,
        "f64 round-off of one subtraction", "no spin is reversed (the printed equations would)",
    )  # fmt: skip
    # Rolling friction turns, and does not push.
    right = predicted.after(replace(c, rho=0.0), sticking)
    for text, measured, expected in (("v_1t", got.v_1t, right.v_1t), ("v_2t", got.v_2t, right.v_2t)):
        result.exact(f"{text}, {name}", measured, expected, "Eqs. 33 (corrected), 36, 39")


def _boundaries(result: Result, sticking: str, n: int) -> None:
    """Boundaries of the regimes: R_2 omega_2 / V_on is a broken line in tan(psi), and its corners are measured.

    Eqs. 9 and 15 (or 12) are equal at tan(psi) = 2 mu (1 + e_n) (or 3 mu (1 + e_n)), Eqs. 31 and 32 at
    3 rho (1 + e_n) / r: with small rho nonrolling ends while the pair sticks, with large rho while it slides.
    """
    e_n, _, mu = BRONZE
    name = equations.CLOSURES[sticking].text
    slides_from = (3.0 if sticking == "contact_point" else 2.0) * mu * (1.0 + e_n)
    M, R_1, R_2 = 1.3, 0.5, 1.0  # a small r, so that no spin is stopped
    r = 2.0 * R_1 * R_2 / (R_1 + R_2)
    for words, rolls_from in (("small rho", 0.4 * slides_from), ("large rho", 1.25 * slides_from)):
        corners = sorted((slides_from, rolls_from))
        ends = (0.02, *corners, 1.6 * slides_from)
        rho = rolls_from * r / (3.0 * (1.0 + e_n))
        tan_psi = np.concatenate([np.linspace(a + 1e-3, b - 1e-3, n) for a, b in pairwise(ends)])
        c = Impact(np.arctan(tan_psi), *BRONZE, M=M, R_1=R_1, R_2=R_2, rho=rho)
        y = pairs.fly(c, sticking).Rw_2 / c.V_on
        lines = [np.polyfit(tan_psi[i * n : (i + 1) * n], y[i * n : (i + 1) * n], 1) for i in range(3)]
        for (a, b), corner in zip(pairwise(lines), corners, strict=True):
            slides = corner == slides_from
            text = f"tan(psi) from {'sticking to sliding' if slides else 'nonrolling to rolling'}, {words}, {name}"
            source = "Eqs. 9 and 12 or 15" if slides else "Eqs. 31 and 32"
            result.exact(text, (a[1] - b[1]) / (b[0] - a[0]), corner, source)


def _spin_of_disk_2(c: Impact, sticking: str) -> Array:
    """R_2 omega_2 by the equation of each impact's regime."""
    regime = regime_of(c, sticking)
    laws = spin_laws(sticking)
    return np.select([regime == name for name in laws], [law(c) for law, _ in laws.values()])


def _figure_11(result: Result) -> Picture:
    figure, (ax,) = style.panels()
    psi = np.radians(np.linspace(0.02, 89.9, 700))
    for rho, dash, colour, marker, text, label in (
        (0.02, "-", style.BLUE, "o", "rho/R_2 = 0.02", r"$\rho/R_2 = 0.02$"),
        (0.0, ":", style.VERMILION, "s", "rho = 0", r"$\rho = 0$"),
    ):
        got = pairs.fly(Impact(np.radians(np.linspace(2.0, 88.0, 30)), *BRONZE, rho=rho))
        right = _spin_of_disk_2(got.impact, "percussion_center")
        result.exact(f"points of Fig. 11, {text}", got.Rw_2, right, "Eqs. 34, 40 and 41 (corrected)")
        line = _spin_of_disk_2(Impact(psi, *BRONZE, rho=rho), "percussion_center")
        ax.plot(np.degrees(psi), line, dash, color=colour, label=f"Eqs. 34, 40, {label}")
        style.points(ax, np.degrees(got.impact.psi), got.Rw_2, colour, f"simulated, {label}", marker)
    ax.set(xlabel=r"$\psi$ (deg)", ylabel=r"$R_2\omega_2/v_o$", xlim=(0, 90), ylim=(0, 0.32))
    ax.legend(loc="upper right", fontsize=7.5)
    caption = (
        "Figure 11. Spin of disk 2 (bronze-aluminium coins, M = 1). Solid: rho/R_2 = 0.02; dotted: without rolling "
        "friction (the printed caption gives 0.02 for both). Markers: simulated. Sticking plus nonrolling holds below "
        "6.5 degrees."
    )
    return Picture("figure-11", caption, figure)


def _figure_regimes() -> Picture:
    figure, axes = style.panels(2, height=3.3)
    looks = list(zip(REGIMES, (style.BLUE, style.GREEN, style.ORANGE, style.VERMILION), "os^D", strict=True))
    e_n, _, mu = BRONZE
    for ax, (sticking, closure), name in zip(axes, equations.CLOSURES.items(), "ab", strict=True):
        grid = np.meshgrid(np.linspace(0.05, 1.3, 18), np.linspace(0.004, 0.2, 14), indexing="ij")
        tan_psi, rho = (one.reshape(-1) for one in grid)
        c = Impact(np.arctan(tan_psi), *BRONZE, rho=rho)
        spin, laws = pairs.fly(c, sticking).Rw_2, spin_laws(sticking)
        off = np.stack([np.abs(spin - np.maximum(laws[regime][0](c), 0.0)) for regime in REGIMES])
        # Where the spin stops, rolling and nonrolling look alike.
        seen = np.where(spin > 1e-12, np.argmin(off, axis=0), -1)
        for i, (regime, colour, marker) in enumerate(looks):
            label = regime if ax is axes[0] else None
            style.points(ax, tan_psi[seen == i], rho[seen == i], colour, label, marker)
        label = "spin stopped" if ax is axes[0] else None
        ax.plot(tan_psi[seen < 0], rho[seen < 0], ".", ms=2.5, color=style.GREY, label=label)
        ax.axvline((3.0 if sticking == "contact_point" else 2.0) * mu * (1.0 + e_n), color=style.BLACK)
        line = np.array([0.0, 1.3])
        ax.plot(line, line / (3.0 * (1.0 + e_n)), "--", color=style.BLACK)
        ax.set(xlabel=r"$\tan\psi$", ylabel=r"$\rho/R$", xlim=(0, 1.35), ylim=(0, 0.21))
        ax.set_title(f"({name}) {closure.text}", fontsize=9)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    caption = (
        "The regimes of rolling friction for two equal bronze-aluminium disks: markers say which of the four equations "
        "the simulated spin of disk 2 obeys. Solid: sliding begins (Eqs. 9 and 15 or 12); dashed: rolling begins "
        "(Eqs. 31 and 32)."
    )
    return Picture("rolling-regimes", caption, figure)
