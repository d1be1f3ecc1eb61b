r"""Inelastic rough disks that cool: temperature ratio and cumulants of velocities and spins in the cooling state.

Every collision sticks (mu = 10^6) by the contact-point law, e_t* = 1 + e_t: constant coefficients of restitution alpha
= e_n and beta = e_t*, the model of A. Megias and A. Santos, arXiv:2303.00057, doi:10.48550/arXiv.2303.00057, who
expand in Sonine polynomials as is done here. With x = m v^2 / 2 T, y = I w^2 / 2 T_rot and theta = T_rot / T,

    f = f_M [1 + a_20 (x^2/2 - 2 x + 1) + a_02 (y^2/2 - 3 y/2 + 3/8) + a_11 (1 - x) (1/2 - y)],
    <x^2> = 2 (1 + a_20),  <y^2> = (3/4) (1 + a_02),  <x y> = (1 + a_11) / 2.

J[psi] is the mean change of psi in a collision, to first order in the cumulants. Scaled moments of the cooling state do
not change: J[x] = 2 J[y], J[x^2] = 2 <x^2> J[x], J[y^2] = 2 <y^2> J[x] and J[x y] = 2 <x y> J[x] are four equations
for theta, a_20, a_02 and a_11. All J are integrals of polynomials over Gaussians and the normal speed g, of density
g exp(-g^2/2), of the eighth degree at most: Gauss' rules of 5 nodes, and of 3 in g^2/2, are exact. For smooth disks
a_20 is that of van Noije and Ernst.

First order leaves out a tenth to a fifth of a cumulant (`sonine`).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ... import theory
from ...model.laws.ifr import IFRLaw
from ...simulation.dsmc import DSMC
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import Mean, compare, fluid, ratio, sampled_run, seeds_of, thermal

QUESTION = "Have cooling rough disks the temperature ratio and the cumulants of theory, and the engine those of DSMC?"
REFERENCE = "Sonine expansion of Megias and Santos, doi:10.48550/arXiv.2303.00057; DSMC of the same law"

SOURCE = "Sonine expansion as by Megias and Santos, doi:10.48550/arXiv.2303.00057"
PAIRS = ((0.9, 0.5), (0.9, 0.0), (0.9, 0.75), (0.8, 0.5))
"""alpha and beta; the first for the engine too."""
WINDOW = (6.0, 14.0)  # collisions per disk over which the engine is averaged: later, streams are Gaussian
SETTLED, END, QUICK_END = 20.0, 50.0, 35.0  # and DSMC
DILUTE, DISKS = 0.01, 8192  # the engine's packing fraction and disks
K = 2.0


def law_of(alpha: float, beta: float) -> IFRLaw:
    """Constant coefficients of restitution."""
    return IFRLaw(e_n=alpha, e_t=beta - 1.0, mu=1e6, sticking="contact_point")


class Sonine(NamedTuple):
    """The cooling state to first order in the cumulants."""

    theta: float
    a_20: float
    a_02: float
    a_11: float


@cache
def _nodes() -> tuple[Array, Array]:
    """Normal and tangential g, V along both, and both spins, scaled by (2 T / m)^(1/2) or their own; and weights."""
    from numpy.polynomial.hermite_e import hermegauss
    from numpy.polynomial.laguerre import laggauss

    x, weight = hermegauss(5)
    weight = weight / weight.sum()
    half_square, exponential = laggauss(3)
    rules = [(np.sqrt(2.0 * half_square), exponential)]  # g, of density g exp(-g^2 / 2)
    rules += [(scale * x, weight) for scale in (1.0, 0.5, 0.5, np.sqrt(0.5), np.sqrt(0.5))]
    at = np.meshgrid(*(each for each, _ in rules), indexing="ij")
    weights = np.meshgrid(*(each for _, each in rules), indexing="ij")
    return np.array([each.ravel() for each in at]), np.prod([each.ravel() for each in weights], axis=0)


def changes(alpha: float, beta: float, theta: float, k: float = K) -> Array:
    """J of x, y, x^2, y^2 and x y (rows): of Gaussians, and for each unit of a_20, a_02 and a_11 (columns)."""
    (g_n, g_t, V_n, V_t, w_1, w_2), weight = _nodes()
    spin = np.sqrt(theta * k)  # R w_i = spin * w_i in units of (2 T / m)^(1/2): I = m R^2 / k
    P_n = 0.5 * (1.0 + alpha) * g_n
    P_t = 0.5 * (1.0 + beta) / (1.0 + k) * (g_t + spin * (w_1 + w_2))
    turned = k * P_t / spin
    before, after = [], []
    for sign, w in ((1.0, w_1), (-1.0, w_2)):
        n, t = V_n + 0.5 * sign * g_n, V_t + 0.5 * sign * g_t
        before.append((n**2 + t**2, w**2))
        after.append(((n - sign * P_n) ** 2 + (t - sign * P_t) ** 2, (w - turned) ** 2))
    rows = []
    for psi in (
        lambda x, y: x,
        lambda x, y: y,
        lambda x, y: x * x,
        lambda x, y: y * y,
        lambda x, y: x * y,
    ):
        rows.append(0.5 * weight * sum(psi(*b) - psi(*a) for a, b in zip(before, after, strict=True)))
    columns = [np.ones_like(weight)]
    for polynomial in (
        lambda x, y: 0.5 * x * x - 2.0 * x + 1.0,
        lambda x, y: 0.5 * y * y - 1.5 * y + 0.375,
        lambda x, y: (1.0 - x) * (0.5 - y),
    ):
        columns.append(sum(polynomial(*one) for one in before))
    return np.asarray(np.array(rows) @ np.array(columns).T)


def cumulants(alpha: float, beta: float, theta: float) -> tuple[Array, float]:
    """a_20, a_02, a_11 at a temperature ratio, and J[x] - 2 J[y], which is 0 in the cooling state."""
    J = changes(alpha, beta, theta)
    A, b = np.zeros((3, 3)), np.zeros(3)
    for i, (row, moment) in enumerate(((2, 2.0), (3, 0.75), (4, 0.5))):
        A[i] = J[row, 1:] - 2.0 * moment * J[0, 1:]
        A[i, i] -= 2.0 * moment * J[0, 0]
        b[i] = 2.0 * moment * J[0, 0] - J[row, 0]
    a: Array = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
    whole = np.concatenate([[1.0], a])
    return a, float(J[0] @ whole - 2.0 * (J[1] @ whole))


def sonine(alpha: float, beta: float) -> Sonine:
    """The cooling state, with theta between a half and twice that of Gaussians."""
    from scipy.optimize import brentq

    def gaussian(theta: float) -> float:
        J = changes(alpha, beta, theta)
        return float(J[0, 0] - 2.0 * J[1, 0])

    first = brentq(gaussian, 1e-3, 1e3)
    theta = float(brentq(lambda one: cumulants(alpha, beta, one)[1], 0.7 * first, 1.4 * first))
    a_20, a_02, a_11 = cumulants(alpha, beta, theta)[0]
    return Sonine(theta, float(a_20), float(a_02), float(a_11))


def run(quick: bool, seed: int) -> Result:
    result = Result()
    end = QUICK_END if quick else END
    figure, axes = style.panels(3, width=2.9)
    fine = np.linspace(-0.1, 0.95, 8 if quick else 22)
    lines = [sonine(PAIRS[0][0], beta) for beta in fine]
    for one, name, of in zip(
        axes, (r"$\theta = T_\mathrm{rot}/T$", r"$a_{20}$", r"$a_{02}$"), Sonine._fields[:3], strict=True
    ):
        one.plot(
            fine,
            [getattr(line, of) for line in lines],
            color=style.BLACK,
            label=rf"theory, $\alpha$ = {PAIRS[0][0]}",
        )
        one.set(xlabel=r"$\beta$", ylabel=name)
    for i, (alpha, beta) in enumerate(PAIRS[:1] if quick else PAIRS):
        right = sonine(alpha, beta)
        seeds = seeds_of(seed, 16, 4500 + 20 * i)
        early, late = np.array([_by_dsmc(alpha, beta, right.theta, one, end) for one in seeds]).transpose(
            1, 2, 0
        )
        text = f"alpha = {alpha}, beta = {beta}"
        theta = ratio(late[1], late[0])
        compare(
            result, f"T_rot / T of cooling rough disks by DSMC, {text}", theta, right.theta, disks=20_000, seeds=seeds,
            systematic=0.02 * right.theta, widest=0.035, source=SOURCE,
            why="2 %: cumulants of first order, a fifth of which change theta by so much",
        )  # fmt: skip
        for name, values, expected in (("a_20", late[2], right.a_20), ("a_02", late[3], right.a_02)):
            compare(
                result, f"{name} of cooling rough disks by DSMC, {text}", values, expected, disks=20_000, seeds=seeds,
                systematic=0.002 + 0.2 * abs(expected), widest=max(0.6, 0.02 / abs(expected)), source=SOURCE,
                why="a fifth of it and 0.002: polynomials of higher order",
            )  # fmt: skip
        for place, values in zip(axes, (theta, late[2], late[3]), strict=True):
            label = {0: "DSMC", 3: rf"DSMC, $\alpha$ = {alpha}"}.get(i)
            style.errorbars(place, beta, values, style.VERMILION, label, "s" if i < 3 else "D")
        if i == 0 and not quick:
            for place, values in zip(
                axes, _engine(result, seed, alpha, beta, right.theta, early), strict=True
            ):
                style.errorbars(place, beta + 0.02, values, style.BLUE, "simulated")
    axes[1].legend(fontsize=7)
    caption = (
        f"Cooling rough disks that always stick: temperature ratio and cumulants by the Sonine expansion of first "
        f"order, by DSMC of the settled gas, and by the engine at packing fraction {DILUTE} while it settles."
    )
    result.pictures.append(Picture("gas_rough", caption, figure))
    return result


def _by_dsmc(
    alpha: float, beta: float, theta: float, seed: int, end: float
) -> tuple[list[float], list[float]]:
    """T, T_rot, a_20 and a_02 while they settle, over `WINDOW`, and after; T and T_rot over T then."""
    disks, velocity, spin = thermal(20_000, seed, T_rot=theta)
    gas = DSMC(disks, law_of(alpha, beta), DILUTE, velocity, spin, seed=seed, contact="dilute")
    gas.run(collisions_per_disk=WINDOW[0], samples=1)
    found = [gas.run(collisions_per_disk=WINDOW[1], samples=16)]
    gas.run(collisions_per_disk=SETTLED, samples=1)
    found.append(gas.run(collisions_per_disk=end, samples=30))
    early, late = (
        [
            float(np.mean(each))
            for each in (
                np.ones_like(one.temperature),
                one.rotational_temperature / one.temperature,
                one.a_2,
                one.a_2_rot,
            )
        ]
        for one in found
    )
    return early, late


def _engine(result: Result, seed: int, alpha: float, beta: float, theta: float, early: Array) -> Array:
    """T_rot / T, a_20 and a_02 of the engine over `WINDOW`, shape (3, replicas), against DSMC."""
    seeds = seeds_of(seed, 24, 4600)
    found = []
    for one in seeds:
        gas = fluid(DISKS, DILUTE, one, law_of(alpha, beta), melting=5.0, T_rot=theta)
        gas.run(collisions_per_disk=WINDOW[0])
        states, rows = sampled_run(gas, 16, collisions_per_disk=WINDOW[1])
        ratios = [row.rotational_temperature / row.temperature for row in rows]
        a_20 = [theory.sonine_coefficient(state.velocity) for state in states]
        squares = [state.spin**2 for state in states]
        a_02 = [np.mean(each**2) / (3.0 * np.mean(each) ** 2) - 1.0 for each in squares]
        found.append(np.mean(np.column_stack((ratios, a_20, a_02)), axis=0))
    columns = np.array(found).T
    for name, values, dsmc, off, widest in (
        ("T_rot / T", columns[0], early[1], 0.005 * theta, 0.03),
        ("a_20", columns[1], early[2], 0.001, 0.5),
        ("a_02", columns[2], early[3], 0.003, 0.35),
    ):
        compare(
            result, f"{name} of cooling rough disks, alpha = {alpha}, beta = {beta}, phi = {DILUTE}, {WINDOW[0]:g} to "
            f"{WINDOW[1]:g} collisions per disk, against DSMC", values, Mean.of(dsmc), disks=DISKS, seeds=seeds,
            systematic=off, widest=widest, source="DSMC of the same law",
            why="phi / 2 of theta, and what half a percent of T in waves and recollisions change of cumulants",
        )  # fmt: skip
    return columns
