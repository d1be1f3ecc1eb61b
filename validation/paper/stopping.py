"""Stopping distances on the table (Sec. II F): exact friction, the error of Eq. 29, and the balance of Eq. 30."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...model.box import Box
from ...model.gravity import EARTH
from ...model.laws.coin_table import coins
from ...model.state import Disks, State
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result, Table
from . import angles, equations, pairs, predicted, table_reference
from .equations import TABLE_II
from .pairs import ROUND_OFF, After

QUESTION = "Where do the coins stop, how wrong is Eq. 29, and does the collision weigh them (Eq. 30)?"
REFERENCE = (
    "F and T by quadrature, flights by SciPy's DOP853 (validation/paper/table_reference.py); Eqs. 29 and 30"
)

TOLERANCE = 1e-12  # of a step of the table kernels
POLE = "f64 round-off; K is cut off at 36 where eps = 1, and cancels"
FLIGHT = "steps of 1e-12, and those of the reference; terms like x ln|x| where eps passes 1"
BY_DOP853 = "Eqs. 6 to 17 and DOP853"
SHOWN = (15, 30, 45, 60, 75)  # angles of tables [deg]
STEEPEST = 85.0  # [deg]; the error of Eq. 29 grows beyond, see `_grazing`
TABLE_FRICTION = 0.2  # mu_s; no ratio depends on it
DECELERATION = TABLE_FRICTION * EARTH  # [m/s^2]


@dataclass(frozen=True)
class Slides:
    """Slides to rest, arrays (n,): distance [length], time, and v / (R |w|) at the end."""

    x: Array
    t: Array
    eps: Array


def _kernels() -> Any:
    from ...kernels.forces import table_friction  # imports Taichi, which is slow
    from ...simulation import backend

    backend.start()
    return table_friction


def to_rest(v: Array, u: Array, k: float = 2.0) -> Slides:
    """Slide disks of speed v and rim speed u to rest by the table kernels."""
    table_friction = _kernels()
    v, u = np.array(v, dtype=float), np.array(u, dtype=float)
    x, t, eps = np.zeros((3, len(v)))
    shape = np.ones(len(v))
    table_friction.slide_coins(
        table_friction.NEVER, TOLERANCE, DECELERATION * shape, k * shape, v, u, x, t, eps
    )
    if np.any(v != 0.0) or np.any(u != 0.0):
        raise RuntimeError("a disk on the table did not come to rest")
    return Slides(x, t, eps)


def run(quick: bool) -> Result:
    result = Result()
    _friction(result)
    psi = np.radians(np.linspace(2.0, STEEPEST, 84 if quick else 333))
    flown = [pairs.fly(angles.coin_impact(row, psi)) for row in TABLE_II]
    slides = [(to_rest(got.v_1, got.Rw_1), to_rest(got.v_2, got.Rw_2)) for got in flown]
    _flights(result, flown[1], slides[1], every=21 if quick else 8)
    errors = [
        np.sqrt(second.x / first.x) / (got.v_2 / got.v_1) - 1.0
        for got, (first, second) in zip(flown, slides, strict=True)
    ]
    _equation_29(result, psi, errors)
    _grazing(result)
    _balance(result, psi, flown, slides)
    result.pictures += [_figure_10(result), _figure_errors(psi, errors), _figure_table()]
    return result


def _friction(result: Result) -> None:
    """F and T of the kernel against integrals over the disk."""
    table_friction = _kernels()
    eps = np.array([0.01, 0.1, 0.3, 0.653, 0.9, 0.99, 1.01, 1.2, 2.0, 5.0, 50.0])
    F, T = np.zeros((2, len(eps)))
    table_friction.friction_of(eps, np.ones_like(eps), F, T)
    right = np.array([table_reference.friction_by_quadrature(one) for one in eps])
    reason = "quadrature to 1e-12 of integrands with a square root at the rim"
    source = "integral over the disk, in polar coordinates about the centre of rotation"
    for name, values, expected in zip("FT", (F, T), right.T, strict=True):
        result.all_near(f"{name}(eps), eps = 0.01 to 50", values, expected, 1e-9, reason, source)
    # eps = 0, 1 and infinity by hand. A disk that spins only: T = int r dA / pi = 2/3. A disk that does not spin:
    # F = 1. At eps = 1, E = 1 and (eps^2 - 1) K = 0: F = 8/(3 pi), T = 8/(9 pi).
    v, u = np.array([0.0, 1.0, 1.0]), np.array([1.0, 1.0, 0.0])
    F, T = np.zeros((2, 3))
    table_friction.friction_of(v, u, F, T)
    by_hand = ([0.0, 8.0 / (3.0 * np.pi), 1.0], [2.0 / 3.0, 8.0 / (9.0 * np.pi), 0.0])
    for name, values, expected in zip("FT", (F, T), by_hand, strict=True):
        result.all_near(f"{name} at eps = 0, 1, infinity", values, expected, 1e-13, POLE, "by hand")


def _flights(result: Result, got: After, slides: tuple[Slides, Slides], every: int) -> None:
    """Distances and the common end of aluminium coins after collisions at all angles."""
    for number, v, u, slide in ((1, got.v_1, got.Rw_1, slides[0]), (2, got.v_2, got.Rw_2, slides[1])):
        ratio = slide.x[::every] * DECELERATION / table_reference.stopping_distance(v[::every], u[::every])
        text, source = (
            f"d_{number} relative to the reference, aluminium coins",
            "Sec. II F, exact: DOP853 in v and R w",
        )
        result.all_near(text, ratio, 1.0, 1e-9, FLIGHT, source)
    eps = np.concatenate([slide.eps for slide in slides])
    common = table_reference.common_ratio()
    reason = "what is left of the start where q has fallen to 1e-12 of it"
    result.all_near("v / (R |w|) when both stop", eps, common, 2e-3, reason, "F = 2 T eps")
    text, reason = "v / (R |w|) when both stop, median", "three digits are given"
    result.near(text, np.median(eps), 0.653, 5e-4, reason, "Farkas et al. (2003)")


def _equation_29(result: Result, psi: Array, errors: list[Array]) -> None:
    """Deviation of sqrt(d_2/d_1) from v_2/v_1, coin by coin."""
    cells: list[tuple[str | float, ...]] = []
    for row, error in zip(TABLE_II, errors, strict=True):
        i = int(np.argmax(np.abs(error)))
        degrees = float(np.degrees(psi[i]))
        text = f"{row.disks}: largest error of Eq. 29 (at {degrees:.1f} deg)"
        result.near(text, error[i], _expected_error(row, psi[i]), 1e-9, FLIGHT, BY_DOP853)
        cells.append((row.disks, *_at_angles(psi, 100.0 * error), 100.0 * float(error[i]), degrees))
    header = ("disks", *(f"{angle} deg" for angle in SHOWN), "largest", "at (deg)")
    note = (
        "Eq. 29 follows from one uniform deceleration for both disks. Spin makes sliding friction weaker, so the "
        "disk that spins more flies farther than Eq. 29 says."
    )
    result.tables.append(Table("Error of Eq. 29, sqrt(d_2/d_1) / (v_2/v_1) - 1, in %", header, cells, note))


def _at_angles(psi: Array, values: Array) -> list[float]:
    return [float(np.interp(np.radians(angle), psi, values)) for angle in SHOWN]


def _grazing(result: Result) -> None:
    """Near 90 degrees disk 2 gets no normal velocity but all of the spin, and Eq. 29 fails badly."""
    psi = np.radians(np.array([89.5]))
    got = pairs.fly(angles.coin_impact(TABLE_II[1], psi))
    d_1, d_2 = to_rest(got.v_1, got.Rw_1).x, to_rest(got.v_2, got.Rw_2).x
    error = np.sqrt(d_2 / d_1) * got.v_1 / got.v_2 - 1.0
    text, expected = "error of Eq. 29, aluminium coins at 89.5 deg", _expected_error(TABLE_II[1], psi[0])
    result.near(text, error[0], expected, 1e-9, FLIGHT, BY_DOP853)


def _expected_error(row: equations.Table2Row, psi: float) -> float:
    """Error of Eq. 29 by the closed forms and the reference flights."""
    right, d_1, d_2 = _reference(row, np.array([psi]))
    return float((np.sqrt(d_2 / d_1) * right.v_1 / right.v_2)[0] - 1.0)


def _reference(row: equations.Table2Row, psi: Array) -> tuple[After, Array, Array]:
    """Pairs of coins by the closed forms, and their stopping distances, shape (n,), by the reference."""
    right = predicted.after(angles.coin_impact(row, psi), "percussion_center")
    d_1 = table_reference.stopping_distance(right.v_1, right.Rw_1) / DECELERATION
    return right, d_1, table_reference.stopping_distance(right.v_2, right.Rw_2) / DECELERATION


def _balance(result: Result, psi: Array, flown: list[After], slides: list[tuple[Slides, Slides]]) -> None:
    """Eq. 30: the mass ratio from speeds and angles, and from distances and angles."""
    cells: list[tuple[str | float, ...]] = []
    for row, got, (first, second) in zip(TABLE_II, flown, slides, strict=True):
        if row.coins[0] == row.coins[1] and row.coins[0] != "1 pta":
            continue
        M = float(got.impact.M[0])
        by_speed = equations.balance(got.v_1, got.alpha_1, got.v_2, got.alpha_2)
        by_distance = equations.balance(np.sqrt(first.x), got.alpha_1, np.sqrt(second.x), got.alpha_2)
        source = "Eq. 30, corrected: momentum across the incoming direction"
        result.all_near(f"{row.disks}: m_1/m_2 from speeds and angles", by_speed, M, 1e-9, ROUND_OFF, source)
        worst = 100.0 * float(np.max(np.abs(by_distance / M - 1.0)))
        cells.append((row.disks, M, float(np.mean(by_speed)), *_at_angles(psi, by_distance), worst))
    columns = (f"by distances, {angle} deg" for angle in SHOWN)
    note = (
        "The inertial balance is exact with speeds. With stopping distances it inherits the error of Eq. 29."
    )
    title = "The collision as a balance (Eq. 30, which gives m_1/m_2)"
    result.table(title, ("disks", "m_1/m_2", "by speeds", *columns, "worst (%)"), cells, note)


class Table10(NamedTuple):
    """Pairs of aluminium coins on the table, by `Simulation`: arrays (n,)."""

    v_1: Array
    v_2: Array
    d_1: Array
    d_2: Array


STEPS = 4000  # of the table's force in the time to rest of a coin that slides without spin


def on_the_table(psi: Array) -> Table10:
    """Collide pairs of aluminium coins of 1 m/s, and let them slide and spin to rest under `TableFriction`.

    They start 10 pm apart and meet long before the first step of the force, so that none collides in the middle
    of one: distances to rest are off by mu g step^2 / 8 at most.
    """
    from ...model.forces import TableFriction  # imports Taichi, which is slow

    coin, v_o, n, near = coins["1 pta"], 1.0, len(psi), 1e-11
    longest = v_o / DECELERATION  # a coin that spins slides on, but not for twice as long
    step = longest / STEPS
    # A coin goes less than half of it, even when spin has made its friction weaker.
    side = 2.2 * v_o**2 / DECELERATION
    across = int(np.ceil(np.sqrt(n)))
    box = Box((across * side, across * side))
    x_2 = (np.stack(np.divmod(np.arange(n), across), axis=1) + 0.5) * side
    position = np.stack([x_2 - [coin.diameter + near, 0.0], x_2], axis=1)
    velocity = np.stack([v_o * pairs.directions(psi), np.zeros((n, 2))], axis=1)
    disks = Disks(2 * n, mass=np.full(2 * n, coin.mass), radius=np.full(2 * n, coin.radius))
    start = State(position.reshape(-1, 2), velocity.reshape(-1, 2), np.zeros(2 * n))
    gas = Simulation(disks, box, coin.law, start, forces=[TableFriction(step, mu=TABLE_FRICTION)])
    gas.run(t_end=0.25 * step)
    struck = gas.state
    if np.any(struck.collisions != 1):
        raise RuntimeError(f"{np.sum(struck.collisions != 1)} of {2 * n} coins did not collide exactly once")
    gas.run(t_end=2.0 * longest)
    end = gas.state
    if np.any(end.velocity != 0.0) or np.any(end.spin != 0.0) or gas.collisions != n:
        raise RuntimeError("coins on the table did not come to rest, or met others")
    v = np.hypot(*struck.velocity.T).reshape(n, 2)
    d = np.hypot(*box.minimum_image(end.position - start.position).T).reshape(n, 2)
    return Table10(v[:, 0], v[:, 1], d[:, 0], d[:, 1])


def _figure_10(result: Result) -> Picture:
    figure, (ax, low) = style.panels(2)
    row = TABLE_II[1]
    fine = np.radians(np.linspace(0.5, 89.5, 400))
    line = predicted.after(angles.coin_impact(row, fine), "percussion_center")
    ax.plot(np.degrees(fine), line.v_2 / line.v_1, color=style.BLUE, label=r"$v_2/v_1$ (Eq. 29)")
    # Each point is a flight by SciPy: few of them, and the corner where sliding begins.
    corner = np.arctan(equations.PERCUSSION_CENTER.tan_psi_transit(angles.coin_impact(row, 0.0)))
    degrees = np.concatenate([np.linspace(1.0, 76.0, 22), np.linspace(78.0, STEEPEST, 8)])
    coarse, d_1, d_2 = _reference(row, np.sort(np.append(np.radians(degrees), corner)))
    at, exact, by_speed = np.degrees(coarse.impact.psi), np.sqrt(d_2 / d_1), coarse.v_2 / coarse.v_1
    ax.plot(at, exact, "--", color=style.VERMILION, label="exact sliding and spinning")
    low.plot(at, exact / by_speed, "--", color=style.VERMILION, label="exact sliding and spinning")
    low.axhline(1.0, color=style.BLUE, label="Eq. 29")
    psi = np.radians(np.linspace(2.0, STEEPEST, 16))
    got = on_the_table(psi)
    law, d_1, d_2 = _reference(row, psi)
    result.all_near(
        "points of Fig. 10, v_2/v_1, Simulation", got.v_2 / got.v_1, law.v_2 / law.v_1, 1e-7,
        "coins 10 pm apart at the start: psi is off by 1e-11 / 0.021 tan(psi), and v_2 by tan(psi) times that",
        "Eqs. 6 to 17",
    )  # fmt: skip
    # mu g step^2 / 8 with step = v_o / (mu g STEPS).
    off = 1.0 / (8.0 * DECELERATION * STEPS**2) + 1e-10
    for number, mine, right in ((1, got.d_1, d_1), (2, got.d_2, d_2)):
        result.all_near(
            f"d_{number} [m] of Fig. 10, Simulation with TableFriction", mine, right, off,
            "mu g step^2 / 8 (the force acts at the middle of its steps), and what v_2 is off by",
            BY_DOP853,
        )  # fmt: skip
    ratio = np.sqrt(got.d_2 / got.d_1)
    style.points(ax, np.degrees(psi), got.v_2 / got.v_1, style.BLUE, r"simulated $v_2/v_1$")
    style.points(ax, np.degrees(psi), ratio, style.VERMILION, r"simulated $(d_2/d_1)^{1/2}$", "s")
    ax.set(xlabel=r"$\psi$ (deg)", ylabel=r"$(d_2/d_1)^{1/2}$, $v_2/v_1$")
    ax.set(xlim=(0, 90), ylim=(0.02, 40.0), yscale="log")
    ax.legend(loc="lower left")
    style.points(low, np.degrees(psi), ratio / (got.v_2 / got.v_1), style.VERMILION, "simulated", "s")
    low.set(xlabel=r"$\psi$ (deg)", ylabel=r"$(d_2/d_1)^{1/2} / (v_2/v_1)$", xlim=(0, 90), ylim=(0.92, 1.1))
    low.legend(loc="upper center")
    style.letters(ax, low)
    caption = (
        "Figure 10. Stopping distances of two aluminium coins after their collision, by a simulation with table "
        "friction. Eq. 29 takes (d_2/d_1)^(1/2) for v_2/v_1; with the exact friction of a disk that slides and spins "
        "the two differ (b)."
    )
    return Picture("figure-10", caption, figure)


def _figure_errors(psi: Array, errors: list[Array]) -> Picture:
    figure, (ax,) = style.panels(width=4.6, height=3.2)
    shown = (1, 2, 0, 3, 5, 4, 6, 7)  # the 500 and 100 pts coins share their law
    names = [row.disks.replace(" coins", "").replace(" disks", "") for row in TABLE_II]
    names[0] = "50 cts-50 cts"
    dashes = ("-", "--", "-.", ":", "-", "--", "-.", ":")
    for i, dash, colour in zip(shown, dashes, (*style.COLOURS, style.BLACK, style.GREY), strict=True):
        ax.plot(np.degrees(psi), 100.0 * errors[i], dash, color=colour, label=names[i])
    ax.axhline(0.0, color=style.GREY, lw=0.5)
    ax.set(xlabel=r"$\psi$ (deg)", ylabel=r"$(d_2/d_1)^{1/2} / (v_2/v_1) - 1$ (%)", xlim=(0, 90))
    ax.legend(loc="best", ncols=2, fontsize=7)
    caption = "The error of Eq. 29 for the coins of Table II, by simulated collisions and flights."
    return Picture("error-of-eq-29", caption, figure)


def _figure_table() -> Picture:
    table_friction = _kernels()
    figure, (left, right) = style.panels(2)
    eps = np.geomspace(0.02, 50.0, 25)
    F, T = np.zeros((2, len(eps)))
    table_friction.friction_of(eps, np.ones_like(eps), F, T)
    fine = np.geomspace(0.02, 50.0, 120)
    by_quadrature = np.array([table_reference.friction_by_quadrature(one) for one in fine])
    for i, (values, name, colour) in enumerate(((F, "F", style.BLUE), (T, "T", style.VERMILION))):
        left.plot(fine, by_quadrature[:, i], color=colour, label=f"{name}, quadrature")
        style.points(left, eps, values, colour, f"{name}, kernel")
    left.set(xscale="log", ylim=(0, 1.05))
    left.set(xlabel=r"$\varepsilon = v / (R\,|\omega|)$", ylabel="force, torque (reduced)")
    left.legend(loc="center right", fontsize=7)
    common = table_reference.common_ratio()
    for start, colour in zip((0.05, 0.3, 1.0, 3.0, 20.0), style.COLOURS, strict=False):
        angle = np.arctan([start])
        whole = to_rest(np.sin(angle), np.cos(angle)).t[0] * DECELERATION
        left_over, eps_t = np.geomspace(1.0, 1e-3, 40)[1:], []
        for time in whole * (1.0 - left_over):  # each its own duration
            v, u, x, t, end = np.sin(angle), np.cos(angle), *np.zeros((3, 1))
            table_friction.slide_coins(float(time), TOLERANCE, np.ones(1), np.full(1, 2.0), v, u, x, t, end)
            eps_t.append(float(end[0]))
        label = rf"$\varepsilon_0 = {start:g}$"
        right.plot(left_over, eps_t, "o-", ms=2.5, lw=0.8, color=colour, label=label)
    right.axhline(common, color=style.BLACK, ls=":", lw=1.0)
    right.annotate(f"{common:.3f}", (0.9, common), (0, -10), textcoords="offset points")
    right.set(xscale="log", yscale="log", xlim=(1.0, 1e-3), ylim=(0.03, 60.0))
    right.set(xlabel=r"time left, $1 - t/t_\mathrm{stop}$", ylabel=r"$\varepsilon$")
    right.legend(loc="upper right", fontsize=7)
    style.letters(left, right)
    caption = (
        "A disk on the table. (a) Force and torque of friction. (b) Whatever the start, speed and spin stop "
        "together, at eps = 0.653 (k = 2)."
    )
    return Picture("table-friction", caption, figure)
