r"""Inelastic rough disks that cool: temperature ratio and cumulants of velocities and spins in the cooling state.

Every collision sticks (mu = 10^6) by the contact-point law, e_t* = 1 + e_t: constant coefficients of restitution alpha
= e_n and beta = e_t*, the model of A. Megias and A. Santos, arXiv:2303.00057, doi:10.48550/arXiv.2303.00057. The
expansion in Sonine polynomials is that of `theory.rough_gas`, to first order, which leaves out a tenth to a fifth of a
cumulant.

T_rot / T for seven beta, with the errors of a study of that size, is compared with that of Gaussian velocities too:
chi-square of the differences, in standard errors, is that of chance for the expansion, and some 200 for Gaussians.
"""

from __future__ import annotations

import math

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


def run(quick: bool, seed: int) -> Result:
    result = Result()
    end = QUICK_END if quick else END
    figure, axes = style.panels(3, width=2.9)
    fine = np.linspace(-0.1, 0.95, 8 if quick else 22)
    lines = [theory.rough_sonine(PAIRS[0][0], beta) for beta in fine]
    for one, name, of in zip(
        axes,
        (r"$\theta = T_\mathrm{rot}/T$", r"$a_{20}$", r"$a_{02}$"),
        theory.RoughSonine._fields[:3],
        strict=True,
    ):
        one.plot(
            fine,
            [getattr(line, of) for line in lines],
            color=style.BLACK,
            label=rf"theory, $\alpha$ = {PAIRS[0][0]}",
        )
        one.set(xlabel=r"$\beta$", ylabel=name)
    for i, (alpha, beta) in enumerate(PAIRS[:1] if quick else PAIRS):
        right = theory.rough_sonine(alpha, beta)
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
    if not quick:
        _against_both(result, seed)
    axes[1].legend(fontsize=7)
    caption = (
        f"Cooling rough disks that always stick: temperature ratio and cumulants by the Sonine expansion of first "
        f"order, by DSMC of the settled gas, and by the engine at packing fraction {DILUTE} while it settles."
    )
    result.pictures.append(Picture("gas_rough", caption, figure))
    return result


BETAS = (0.0, 0.1, 0.25, 0.4, 0.5, 0.65, 0.8)
STUDY, STUDY_SEEDS = 2000, 12
"""Disks and seeds of each beta."""


def _against_both(result: Result, seed: int) -> None:
    """Chi-square of T_rot / T of seven beta against the expansion, and against Gaussian velocities."""
    sums, apart = np.zeros(2), 0.0
    for i, beta in enumerate(BETAS):
        theories = theory.rough_sonine(0.9, beta).theta, theory.cooling_ratio(law_of(0.9, beta), K, 1.0)
        found = []
        for one in seeds_of(seed, STUDY_SEEDS, 4650 + 20 * i):
            disks, velocity, spin = thermal(STUDY, one, T_rot=theories[0])
            gas = DSMC(disks, law_of(0.9, beta), DILUTE, velocity, spin, seed=one, contact="dilute")
            gas.run(collisions_per_disk=SETTLED, samples=1)
            late = gas.run(collisions_per_disk=SETTLED + 4.0, samples=4)
            found.append(np.mean(late.rotational_temperature) / np.mean(late.temperature))
        mean = Mean.of(found)
        sums += [((mean.value - each) / mean.error) ** 2 for each in theories]
        apart += ((theories[1] - theories[0]) / mean.error) ** 2
    n, freedom = len(BETAS), STUDY_SEEDS - 1.0
    expected = n * freedom / (freedom - 2.0)  # of t^2
    result.near(
        f"chi-square of T_rot / T for {n} beta, {STUDY_SEEDS} seeds of {STUDY} disks, against the expansion", sums[0], expected,
        3.0 * expected, "four times what chance gives: the terms that first order leaves out", SOURCE,
    )  # fmt: skip
    result.near(
        "chi-square of the same against Gaussian velocities", sums[1], expected + apart,
        3.0 * expected + 6.0 * math.sqrt(apart),
        "the same, and what the two theories are apart, whose scatter is 2 sqrt(apart)", SOURCE,
    )  # fmt: skip


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
