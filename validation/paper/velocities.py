"""Velocities and spins after the impact (Eqs. 4 to 17), and their independence of the impact speed (Fig. 4)."""

from __future__ import annotations

import numpy as np

from ..report import style
from ..report.registry import Picture, Result
from . import angles, equations, pairs, predicted
from .equations import TABLE_II, Impact

QUESTION = "Do velocities, impulses and spins follow Eqs. 4 to 17, and scale with the impact speed (Fig. 4)?"
REFERENCE = "Eqs. 4 to 17 (10 and 14 corrected); Fig. 4: no dependence on the speed"

COEFFICIENTS = [(0.87, -0.88, 0.21), (0.67, -0.95, 0.14), (0.30, -1.00, 0.60), (0.95, -0.80, 0.05)]
ANGLES = (16.0, 30.0, 45.0, 60.0)  # of Fig. 4 [deg]
SPEEDS = (0.2, 1.5)  # slowest and fastest launch of Sec. III [m/s]


def run(quick: bool) -> Result:
    result = Result()
    c = random_impacts(400 if quick else 5000)
    for sticking in equations.CLOSURES:
        _equations(result, c, sticking)
    _speeds(result, 6 if quick else 27)
    return result


def random_impacts(n: int) -> Impact:
    """Impacts of any masses, radii, shapes and spin of disk 1, with four sets of coefficients in turn."""
    rng = np.random.default_rng(4)
    psi, R_1, v_o = rng.uniform(0.01, 1.48, n), rng.uniform(0.5, 2.0, n), rng.uniform(0.2, 1.5, n)
    e_n, e_t, mu = np.array(COEFFICIENTS)[np.arange(n) % len(COEFFICIENTS)].T
    M, m_1, R_2 = 10.0 ** rng.uniform(-1.0, 1.0, n), rng.uniform(0.1, 3.0, n), rng.uniform(0.5, 2.0, n)
    k_1, k_2 = rng.uniform(1.0, 2.5, (2, n))
    w_o = v_o * np.sin(psi) / R_1 * rng.uniform(-0.9, 2.0, n)
    return Impact(psi, e_n, e_t, mu, M, m_1, R_1, R_2, k_1, k_2, v_o, w_o)


def _equations(result: Result, c: Impact, sticking: str) -> None:
    got, right, stick = pairs.fly(c, sticking), predicted.after(c, sticking), equations.CLOSURES[sticking]
    slide = predicted.slides(c, sticking)
    eq_3 = "Eq. 3 with I = m R^2 / k"
    rows = [
        ("v_2n - v_1n", got.v_2n - got.v_1n, equations.separation(c), "Eq. 4"),
        ("P_n", got.P_n, equations.P_n(c), "Eq. 5"),
        ("v_1n", got.v_1n, equations.v_1n(c), "Eq. 6"),
        ("v_2n", got.v_2n, equations.v_2n(c), "Eq. 7"),
    ]
    for regime, where, by in (("sliding", slide, equations.SLIDING), ("sticking", ~slide, stick)):
        P_t = equations.P_et(c) + by.P_f(c)
        rows += [
            (f"P_t, {regime}", got.P_t[where], P_t[where], f"Eqs. 8 and {by.number['P_f']}"),
            (f"v_1t, {regime}", got.v_1t[where], by.v_1t(c)[where], f"Eq. {by.number['v_1t']}"),
            (f"v_2t, {regime}", got.v_2t[where], by.v_2t(c)[where], f"Eq. {by.number['v_2t']}"),
        ]
    rows += [("R_1 omega_1", got.Rw_1, right.Rw_1, eq_3), ("R_2 omega_2", got.Rw_2, right.Rw_2, eq_3)]
    for quantity, measured, expected, source in rows:
        result.exact(f"{quantity}, {stick.text}", measured, expected, source)


def _speeds(result: Result, steps: int) -> None:
    """The same impacts at other speeds: equal angles, and velocities in proportion.

    With constant coefficients every impulse is proportional to the speed, so this is constant by construction, and says
    nothing about coins: it fails only where the kernels have a speed of their own.
    """
    row = TABLE_II[5]  # two 100 pts coins: bronze-aluminium, M = 1
    speeds = np.linspace(*SPEEDS, steps)
    psi, v_o = (grid.reshape(-1) for grid in np.meshgrid(np.radians(ANGLES), speeds, indexing="ij"))
    impact = angles.coin_impact(row, psi)
    got = pairs.fly(Impact(**{**vars(impact), "v_o": v_o}))
    source = "constant by construction: Eqs. 5 to 17 are homogeneous in the speeds (Fig. 4)"
    for name, values in (
        ("alpha_1 [rad]", got.alpha_1), ("alpha_2 [rad]", got.alpha_2), ("v_1 / v_o", got.v_1 / v_o),
        ("v_2 / v_o", got.v_2 / v_o), ("R_2 omega_2 / v_o", got.Rw_2 / v_o),
    ):  # fmt: skip
        grid = values.reshape(-1, steps)
        result.exact(f"{name} from that at 0.2 m/s, up to 1.5 m/s", grid, grid[:, :1], source)
    right = predicted.after(angles.coin_impact(row, np.radians(ANGLES)), "percussion_center").alpha_1
    measured = got.alpha_1.reshape(-1, steps)
    result.exact("points of Fig. 4, alpha_1 [rad]", measured, right[:, None], "Eqs. 18 and 22")
    figure, (ax,) = style.panels()
    shown = np.unique(np.linspace(0, steps - 1, 6).astype(int))
    for i, (angle, colour, marker) in enumerate(zip(ANGLES, style.COLOURS, "os^D", strict=False)):
        ax.axhline(np.degrees(right[i]), color=colour)
        alpha = np.degrees(measured[i, shown])
        style.points(ax, speeds[shown], alpha, colour, rf"$\psi = {angle:g}\degree$", marker)
    ax.set(xlabel=r"$v_o$ (m/s)", ylabel=r"$\alpha_1$ (deg)", xlim=(0.1, 1.6), ylim=(25, 75))
    ax.legend(loc="upper center", ncols=4, columnspacing=0.8, handletextpad=0.2)
    caption = (
        "Figure 4. Deflection of disk 1 in collisions of two bronze-aluminium coins at six speeds of the paper's "
        "range. Lines: Eqs. 18 and 22, which have no speed in them; markers: simulated."
    )
    result.pictures.append(Picture("figure-04", caption, figure))
