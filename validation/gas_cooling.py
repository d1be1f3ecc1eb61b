r"""Cooling by the IFR law: the six materials of Table II, from cold and from hot spins, at two densities.

T and theta = T_rot / T against the closed form (`theory.cooling`: Gaussian, uncorrelated, homogeneous) while tau, the
collisions of a disk, is 5 or less; against DSMC of the same law, which knows tails and correlations of spins but no
places, until tau = 20, or until shear modes hold a twentieth of T: both are theories of homogeneous gases.

*What the theory leaves out*, and how much it may be: spins and velocities are soon correlated, and spins grow tails
(the last digits of DSMC against theory below are that alone). *What DSMC leaves out*: correlations of places. Shear
modes, in boxes longer than their length, hold the part `theory.shear_mode_energy` of T; and collisions in a dense
gas are not independent, by some percent at packing fraction 0.3 (`ifrdem.dsmc` says the same of 1 pta).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import theory
from ..coins import coins
from ..dsmc import DSMC
from ..law import IFRLaw
from ..observables import Measure
from ..simulation import Simulation
from . import style
from .gas_sample import Mean, compare, fluid, seeds_of, start
from .registry import Picture, Result, Table

QUESTION = "Do gases of all six materials cool as theory says at first, and as DSMC says for longer?"
REFERENCE = "closed-form cooling rates (ifrdem/cooling_theory.py) and DSMC of the same law"

MATERIALS = ("1 pta", "5 pts", "50 cts", "100 pts", "200 pts", "polyester")
PHI = (0.1, 0.3)
STARTS = {"cold": 0.0, "hot": 4.0}  # T_rot at T = 1
TAU = np.array([0.0, 1.0, 2.0, 3.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5, 20.0])
YOUNG = 5.0
MOST_SHARE = 0.05  # of shear modes: a gas with more is not held against theories of homogeneous ones
N = 400  # a small box, which holds few of the waves that grow
LARGE = 4096  # and one that holds more, for the picture
Array = NDArray[np.float64]


class Cooling(NamedTuple):
    """T and theta at `TAU` of every replica, shape (replicas, tau)."""

    T: Array
    theta: Array


def run(quick: bool, seed: int) -> Result:
    """See the module's QUESTION."""
    result = Result()
    figures = {}
    rows: list[tuple[str | float, ...]] = []
    names = MATERIALS[:2] if quick else MATERIALS
    for at, phi in enumerate(PHI):
        if quick and phi != PHI[0]:
            continue
        figures[phi] = style.panels(len(names), 2, width=2.7, height=2.4)
        for i, name in enumerate(names):
            for j, (heat, T_rot) in enumerate(STARTS.items()):
                column = figures[phi][1]
                place = 1000 + 1200 * at + 200 * i + 100 * j
                rows.append(
                    _one(
                        result, name, phi, heat, T_rot, quick, seed, place, column[i], column[i + len(names)]
                    )
                )
    for phi, (figure, axes) in figures.items():
        for i, name in enumerate(names):
            axes[i].set(yscale="log", title=name)
            axes[i + len(names)].set(yscale="log", xlabel=r"collisions per disk $\tau$")
        axes[0].set_ylabel(r"$T/T_0$")
        axes[len(names)].set_ylabel(r"$\theta = T_\mathrm{rot}/T$")
        axes[0].legend(fontsize=7)
        caption = (
            f"Cooling at packing fraction {phi} from cold (blue) and hot (vermilion) spins: simulated "
            f"({N} disks circles, {LARGE} crosses), DSMC (dashed) and closed form (lines). Where markers leave "
            f"the dashes, "
            "places matter: shear modes, and more of them in the larger box; where dashes "
            "leave the lines, velocities and spins are not Gaussian, spins with heavy tails first of all."
        )
        result.pictures.append(Picture(f"gas_cooling_{phi:g}".replace(".", "_"), caption, figure))
    result.tables.append(
        Table(
            "Where and why they part, at 20 collisions per disk",
            ("material", "phi", "spins", "T, simulated / DSMC", "T, DSMC / theory", "theta, simulated / DSMC",
             "theta, DSMC / theory", "compared until tau", "share of shear modes", "a_2 of spins, DSMC"),
            rows,
            "The share of shear modes is hydrodynamic theory's, of T; a_2 of spins is <w^4>/(3 <w^2>^2) - 1, 0 "
            "for a Gaussian.",
        )
    )  # fmt: skip
    return result


def measured(law: IFRLaw, phi: float, T_rot: float, seeds: range, n: int) -> Cooling:
    """The engine's gases of n disks."""
    found = []
    for seed in seeds:
        disks, box, begin = fluid(n, phi, seed, melting=15.0, T_rot=T_rot)
        gas = Simulation(disks, box, law, begin)
        rows: list[Measure] = []
        for tau in TAU:
            gas.run(collisions_per_disk=max(tau, 1e-9))
            rows.append(gas.measure())
        T = np.array([one.temperature for one in rows]) * n / (n - 1.0)
        found.append((T, np.array([one.rotational_temperature for one in rows]) / T))
    T_all, theta = np.array(found).transpose(1, 0, 2)
    return Cooling(T_all / T_all[:, :1], theta)


def by_dsmc(law: IFRLaw, phi: float, T_rot: float, seeds: range, n: int) -> tuple[Cooling, float]:
    """The same by DSMC, and the mean a_2 of spins at the end."""
    found, tails = [], []
    for seed in seeds:
        disks, _, begin = start(n, phi, seed, T_rot=T_rot)
        one = DSMC(disks, law, phi, begin.velocity, begin.spin, seed=seed).run(
            collisions_per_disk=TAU[-1], samples=TAU[1:]
        )
        found.append((one.T, one.T_rot / one.T))
        tails.append(one.a_2_rot[-1])
    T, theta = np.array(found).transpose(1, 0, 2)
    return Cooling(T, theta), float(np.mean(tails))


def by_theory(law: IFRLaw, T_rot: float) -> Cooling:
    """The closed form at `TAU`: in collisions per disk it does not depend on the density."""
    times = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 4000)])
    T, T_rot_of, tau = theory.cooling(law, 1.0, 0.5, 2.0, 0.1, 1.0, T_rot, times)
    T_at = np.exp(np.interp(TAU, tau, np.log(T)))
    return Cooling(T_at[None], np.interp(TAU, tau, T_rot_of / T)[None])


def _one(
    result: Result, name: str, phi: float, heat: str, T_rot: float, quick: bool, seed: int, place: int, top: Any,
    low: Any
) -> tuple[str | float, ...]:  # fmt: skip
    law = coins[name].law
    replicas, n = (16, 10_000) if quick else (40, 20_000)
    seeds = seeds_of(seed, replicas, place)
    got = measured(law, phi, T_rot, seeds, N)
    large = measured(law, phi, T_rot, seeds_of(seed, 2, place + 60), LARGE)
    dsmc, tail = by_dsmc(law, phi, T_rot, seeds_of(seed, 4 if quick else 8, place + 80), n)
    theirs = by_theory(law, T_rot)
    side = math.sqrt(N * math.pi / 4.0 / phi)
    theta_end = max(float(dsmc.theta.mean(axis=0)[-1]), 0.0)
    shares = np.array(
        [theory.shear_mode_energy(t, law, 0.5, phi, (side, side), theta=theta_end) for t in TAU]
    )
    last = int(np.flatnonzero(shares <= MOST_SHARE)[-1])
    young = min(int(np.argmin(np.abs(TAU - YOUNG))), last)
    for what, mine, right, exact, sign in (
        ("T", got.T, dsmc.T, theirs.T, 1.0),
        ("theta", got.theta, dsmc.theta, theirs.theta, -1.0),
    ):
        text = f"{what} after {{:g}} collisions per disk, {name}, phi = {phi}, {heat} spins, {{}}"
        gaussian = 0.03 if what == "T" else 0.1
        streams = (1.0 + shares) ** sign  # T counts them, and theta = T_rot / T
        compare(
            result, text.format(TAU[young], "against theory"), mine[:, young],
            float(exact[0, young] * streams[young]), disks=N, seeds=seeds,
            systematic=(gaussian + 1.2 * shares[young]) * float(exact[0, young]),
            why="3 % of T, 10 % of theta: velocities and spins are not Gaussian; 1.2 times the shear modes' share",
            source="cooling_theory.py; Luding et al. (1998), doi:10.1103/PhysRevE.58.3416, extended to the IFR law",
        )  # fmt: skip
        for k in sorted({young, last}):
            mean = Mean.of(right[:, k] * streams[k])
            compare(
                result, text.format(TAU[k], "against DSMC"), mine[:, k], mean, disks=N, seeds=seeds,
                systematic=(0.02 + 0.1 * phi + 1.2 * shares[k]) * abs(mean.value),
                why="2 % + phi / 10: collisions are not independent where there are places; 1.2 times the shear "
                "modes' share: other waves grow too",
                source="DSMC of the same law",
            )  # fmt: skip
    colour = style.BLUE if heat == "cold" else style.VERMILION
    for axes, mine, more, right, exact in (
        (top, got.T, large.T, dsmc.T, theirs.T),
        (low, got.theta, large.theta, dsmc.theta, theirs.theta),
    ):
        shown = slice(1, None) if axes is low else slice(None)
        axes.plot(TAU[shown], exact[0, shown], color=colour, lw=0.9, label=f"{heat} spins")
        axes.plot(TAU[shown], right.mean(axis=0)[shown], "--", color=colour, lw=0.9)
        style.points(axes, TAU[shown], mine.mean(axis=0)[shown], colour)
        axes.plot(TAU[shown], more.mean(axis=0)[shown], "+", color=colour, ms=5.0)
    at_end = [
        float(one.mean(axis=0)[-1]) for one in (got.T, dsmc.T, theirs.T, got.theta, dsmc.theta, theirs.theta)
    ]
    return (
        name, phi, heat, at_end[0] / at_end[1], at_end[1] / at_end[2], at_end[3] / at_end[4], at_end[4] / at_end[5],
        float(TAU[last]), float(shares[-1]), tail,
    )  # fmt: skip
