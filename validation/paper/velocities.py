"""Velocities and spins after the impact (Eqs. 4 to 17), and their independence of the impact speed (Fig. 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..report import style
from ..report.registry import Picture, Result
from . import angles, equations, pairs, predicted
from .equations import TABLE_II, Impact
from .pairs import ROUND_OFF

QUESTION = "Do velocities, impulses and spins follow Eqs. 4 to 17, and scale with the impact speed (Fig. 4)?"
REFERENCE = "Eqs. 4 to 17 (10 and 14 corrected); Fig. 4: no dependence on the speed"

Array = NDArray[np.float64]

EXACT = 1e-10
COEFFICIENTS = [(0.87, -0.88, 0.21), (0.67, -0.95, 0.14), (0.30, -1.00, 0.60), (0.95, -0.80, 0.05)]
ANGLES = (16.0, 30.0, 45.0, 60.0)  # of Fig. 4 [deg]
SPEEDS = (0.2, 1.5)  # slowest and fastest launch of Sec. III [m/s]


def run(quick: bool) -> Result:
    """See the module's QUESTION."""
    result = Result()
    c = random_impacts(400 if quick else 5000)
    for sticking in angles.CLOSURES:
        _equations(result, c, sticking)
    _speeds(result, 6 if quick else 27)
    return result


def random_impacts(n: int) -> Impact:
    """Impacts of any masses, radii, shapes and spin of disk 1, with four sets of coefficients in turn."""
    rng = np.random.default_rng(4)
    psi, R_1, v_o = rng.uniform(0.01, 1.48, n), rng.uniform(0.5, 2.0, n), rng.uniform(0.2, 1.5, n)
    e_n, e_t, mu = np.array(COEFFICIENTS)[np.arange(n) % len(COEFFICIENTS)].T
    return Impact(
        psi,
        *(e_n, e_t, mu),
        M=10.0 ** rng.uniform(-1.0, 1.0, n),
        m_1=rng.uniform(0.1, 3.0, n),
        R_1=R_1,
        R_2=rng.uniform(0.5, 2.0, n),
        k_1=rng.uniform(1.0, 2.5, n),
        k_2=rng.uniform(1.0, 2.5, n),
        v_o=v_o,
        w_o=v_o * np.sin(psi) / R_1 * rng.uniform(-0.9, 2.0, n),
    )


def _equations(result: Result, c: Impact, sticking: str) -> None:
    got, right = pairs.fly(c, sticking), predicted.after(c, sticking)
    name = angles.NAMES[sticking]
    slide = predicted.slides(c, sticking)
    result.all_near(
        f"v_2n - v_1n, {name}", got.v_2n - got.v_1n, equations.separation(c), EXACT, ROUND_OFF, "Eq. 4"
    )
    result.all_near(f"P_n, {name}", got.P_n, equations.P_n(c), EXACT, ROUND_OFF, "Eq. 5")
    result.all_near(f"v_1n, {name}", got.v_1n, equations.v_1n(c), EXACT, ROUND_OFF, "Eq. 6")
    result.all_near(f"v_2n, {name}", got.v_2n, equations.v_2n(c), EXACT, ROUND_OFF, "Eq. 7")
    stick, v_1t, v_2t, one, two, limit = {
        "contact_point": (
            equations.P_f_contact_point, equations.v_1t_contact_point, equations.v_2t_contact_point,
            13, "14, corrected", 12,
        ),
        "percussion_center": (
            equations.P_f_percussion_center, equations.v_1t_percussion_center, equations.v_2t_percussion_center,
            16, "17", 15,
        ),
    }[sticking]  # fmt: skip
    for regime, where, friction, first, second, sources in (
        (
            "sliding",
            slide,
            equations.P_f_sliding,
            equations.v_1t_sliding,
            equations.v_2t_sliding,
            (9, "10, corrected", "11"),
        ),
        ("sticking", ~slide, stick, v_1t, v_2t, (limit, one, two)),
    ):
        text = f"{regime}, {name}"
        P_t = equations.P_et(c) + friction(c)
        result.all_near(
            f"P_t, {text}", got.P_t[where], P_t[where], EXACT, ROUND_OFF, f"Eqs. 8 and {sources[0]}"
        )
        result.all_near(
            f"v_1t, {text}", got.v_1t[where], first(c)[where], EXACT, ROUND_OFF, f"Eq. {sources[1]}"
        )
        result.all_near(
            f"v_2t, {text}", got.v_2t[where], second(c)[where], EXACT, ROUND_OFF, f"Eq. {sources[2]}"
        )
    result.all_near(
        f"R_1 omega_1, {name}", got.Rw_1, right.Rw_1, EXACT, ROUND_OFF, "Eq. 3 with I = m R^2 / k"
    )
    result.all_near(
        f"R_2 omega_2, {name}", got.Rw_2, right.Rw_2, EXACT, ROUND_OFF, "Eq. 3 with I = m R^2 / k"
    )


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
    shape = (len(ANGLES), steps)
    source = "constant by construction: Eqs. 5 to 17 are homogeneous in the speeds (Fig. 4)"
    for name, values in (
        ("alpha_1 [rad]", got.alpha_1), ("alpha_2 [rad]", got.alpha_2), ("v_1 / v_o", got.v_1 / v_o),
        ("v_2 / v_o", got.v_2 / v_o), ("R_2 omega_2 / v_o", got.Rw_2 / v_o),
    ):  # fmt: skip
        grid = values.reshape(shape)
        at_first = np.repeat(grid[:, :1], steps, axis=1)
        result.all_near(
            f"{name} from that at 0.2 m/s, up to 1.5 m/s", grid, at_first, EXACT, ROUND_OFF, source
        )
    right = predicted.after(angles.coin_impact(row, np.radians(ANGLES)), "percussion_center")
    expected = np.repeat(right.alpha_1[:, None], steps, axis=1)
    measured = got.alpha_1.reshape(shape)
    result.all_near("points of Fig. 4, alpha_1 [rad]", measured, expected, EXACT, ROUND_OFF, "Eqs. 18 and 22")
    figure, (ax,) = style.panels()
    shown = np.unique(np.linspace(0, steps - 1, 6).astype(int))
    markers = zip(ANGLES, style.COLOURS, ("o", "s", "^", "D"), strict=False)
    for i, (angle, colour, marker) in enumerate(markers):
        ax.axhline(np.degrees(right.alpha_1[i]), color=colour)
        alpha = np.degrees(got.alpha_1.reshape(shape)[i, shown])
        style.points(ax, speeds[shown], alpha, colour, rf"$\psi = {angle:g}\degree$", marker)
    ax.set(xlabel=r"$v_o$ (m/s)", ylabel=r"$\alpha_1$ (deg)", xlim=(0.1, 1.6), ylim=(25, 75))
    ax.legend(loc="upper center", ncols=4, columnspacing=0.8, handletextpad=0.2)
    result.pictures.append(
        Picture(
            "figure-04",
            "Figure 4. Deflection of disk 1 in collisions of two bronze-aluminium coins at six speeds of the paper's "
            "range. Lines: Eqs. 18 and 22, which have no speed in them; markers: simulated.",
            figure,
        )
    )
