r"""Cooling by the IFR law: the six materials of Table II, from cold and from hot spins, at three densities.

DSMC of the same law, which knows tails and correlations of spins but no places, begins at the rates of the closed form
(`theory.cooling`: Gaussian, uncorrelated, homogeneous). The gases follow DSMC until tau = 20, or until waves hold some
percent of T: both are theories of homogeneous gases. In collisions per disk neither depends on density.

*Rates at the start*, where velocities are Gaussian and the closed form is exact. Of f = ln(T / T_0), or T_rot / T_0,

    [4 f(h) - f(2 h)] / (2 h) = df/dtau - (h^2 / 3) d^3 f/dtau^3 + ...

does not depend on the second derivative, in which correlations of spins show first. It is compared with that of
the closed form; the third may be off by as much as the closed form's own, by which the left side differs from df/dtau.

*What the closed form leaves out.* Spins and velocities are soon correlated, and spins grow tails: the table lists DSMC
over closed form. *What DSMC leaves out*: correlations of places. Waves slow the cooling by a factor that `waves`
derives, with its uncertainty: it is proportional to density and losses, nothing in the dilute gas and some percent at
packing fraction 0.3. Disks that meet again have spins that know of each other, which slows the decay of hot spins at
0.3 by up to a tenth in theta (the table): theta is not compared with DSMC there, nor where waves hold more than a
twentieth of T, whose effect on the spins is not known.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ... import theory
from ...model.laws.coin_table import coins
from ...model.laws.ifr import IFRLaw
from ...model.observables import Measure
from ...plots.style import marks
from ...simulation.dsmc import DSMC
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result, Row, Table
from .sample import Mean, add_chi_square, compare, fluid, ratio, seeds_of, thermal
from .waves import MOST_SHARE, streams

QUESTION = "Do gases of all six materials cool as theory says at first, and as DSMC says for longer?"
REFERENCE = "closed-form cooling rates (ifrdem/theory/cooling_gas.py) and DSMC of the same law"

MATERIALS = ("1 pta", "5 pts", "50 cts", "100 pts", "200 pts", "polyester")
STARTS = {"cold": 0.0, "hot": 4.0}  # T_rot at T = 1
TAU = np.array([0.0, 1.0, 2.0, 3.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5, 20.0])
YOUNG = 5.0
STEP = 0.25  # h of the rates at the start [collisions per disk]
DISKS_OF_RATES, REPLICAS_OF_RATES = 50_000, 24
GAUSSIAN = "closed form: Luding et al. (1998), doi:10.1103/PhysRevE.58.3416, extended to the IFR law"
LARGE = 4096  # disks of a box that holds more waves, for the picture


class Size(NamedTuple):
    """Gases of one density: small boxes hold few of the waves that grow."""

    disks: int
    replicas: int


SIZES = {0.003: Size(1024, 32), 0.1: Size(400, 40), 0.3: Size(400, 32)}
"""By packing fraction."""
QUICK_SIZES = {0.003: Size(4096, 24)}
"""A dilute gas without waves, of so many disks that rates off by 1 %, which make 4 % of T after 20 collisions per disk
from cold spins, are seen. From hot ones theta of a replica scatters by 15 % by then: left to the full run."""
DISKS_OF_DSMC, REPLICAS_OF_DSMC = 10_000, 12
SPINS = (0.1, 0.05)  # packing fraction, and share of waves, up to which theta is compared with DSMC


class Cooling(NamedTuple):
    """T and T_rot at `TAU` of every replica, over T at the start; shape (replicas, tau)."""

    T: Array
    T_rot: Array

    @property
    def theta(self) -> Array:
        """T_rot / T, as `sample.ratio` has it."""
        each = [ratio(a, b) for a, b in zip(self.T_rot.T, self.T.T, strict=True)]
        return np.array(each).T


class CooledGas(NamedTuple):
    """One material at one density from one start."""

    heat: str
    small: Cooling
    large: Cooling | None
    dsmc: Cooling
    exact: Cooling
    rows: dict[tuple[str, str], Row]
    line: tuple[str | float, ...]


def run(quick: bool, seed: int) -> Result:
    result = Result()
    names = MATERIALS[:1] if quick else MATERIALS
    homogeneous = {}
    for i, name in enumerate(names):
        for j, T_rot in enumerate(STARTS.values()):
            seeds = seeds_of(seed, REPLICAS_OF_DSMC, 1000 + 40 * i + 20 * j)
            homogeneous[i, j] = by_dsmc(coins[name].law, T_rot, seeds)
            _rates(result, name, list(STARTS)[j], seeds_of(seed, REPLICAS_OF_RATES, 1300 + 60 * i + 30 * j))
    lines = []
    for at, (phi, size) in enumerate((QUICK_SIZES if quick else SIZES).items()):
        gases = []
        for (i, name), (j, heat) in itertools.product(enumerate(names), enumerate(STARTS)):
            place = 2000 + 1200 * at + 200 * i + 100 * j
            gases.append(_one(result, name, phi, size, heat, seed, place, *homogeneous[i, j]))
        whens = {"young": f"after {YOUNG:g} collisions per disk or less", "last": "at the latest"}
        for what, (when, text) in itertools.product(("T", "theta"), whens.items()):
            group = [gas.rows[what, when] for gas in gases if (what, when) in gas.rows]
            if len(group) > 1:
                add_chi_square(
                    result, f"{what} {text}, phi = {phi}, against DSMC", group, "DSMC of the same law"
                )
        result.pictures.append(_picture(phi, size, names, gases))
        lines += [gas.line for gas in gases]
    result.tables.append(
        Table(
            "Where and why they part",
            ("material", "phi", "spins", "T, DSMC / theory, tau = 5", "theta, DSMC / theory, tau = 5",
             "T, DSMC / theory, tau = 20", "theta, DSMC / theory, tau = 20", "theta, simulated / DSMC, tau = 5",
             "T, simulated / DSMC, tau = 20", "theta, simulated / DSMC, tau = 20", "factor of T by waves, tau = 20",
             "its uncertainty", "compared until tau", "a_2 of spins, DSMC"),
            lines,
            "tau: collisions per disk. The factor of T by waves is what hydrodynamics says of simulated over DSMC "
            "(validation/gas/waves.py), as long as it is small. a_2 of spins is <w^4>/(3 <w^2>^2) - 1, 0 for a "
            "Gaussian: where DSMC leaves the closed form most, spins have heavy tails.",
        )
    )  # fmt: skip
    return result


def measured(law: IFRLaw, phi: float, T_rot: float, seeds: range, n: int) -> Cooling:
    """The engine's gases of n disks."""
    found = []
    for seed in seeds:
        gas = fluid(n, phi, seed, law, melting=5.0, T_rot=T_rot)
        rows: list[Measure] = []
        for tau in TAU:
            gas.run(collisions_per_disk=max(tau, 1e-9))
            rows.append(gas.measure())
        T = np.array([one.temperature for one in rows]) * n / (n - 1.0)
        found.append((T, np.array([one.rotational_temperature for one in rows])))
    T_all, T_rot_all = np.array(found).transpose(1, 0, 2)
    return Cooling(T_all / T_all[:, :1], T_rot_all / T_all[:, :1])


def by_dsmc(law: IFRLaw, T_rot: float, seeds: range) -> tuple[Cooling, float]:
    """Gases by DSMC, and the mean a_2 of spins at the end."""
    found, tails = [], []
    for seed in seeds:
        disks, velocity, spin = thermal(DISKS_OF_DSMC, seed, T_rot=T_rot)
        one = DSMC(disks, law, 0.1, velocity, spin, seed=seed).run(
            collisions_per_disk=TAU[-1], samples=TAU[1:]
        )
        found.append((one.temperature, one.rotational_temperature))
        tails.append(one.a_2_rot[-1])
    T, T_rot_all = np.array(found).transpose(1, 0, 2)
    return Cooling(T, T_rot_all), float(np.mean(tails))


def by_theory(law: IFRLaw, T_rot: float, at: Array) -> Cooling:
    """The closed form after `at` collisions per disk: it does not depend on the density."""
    times = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 4000)])
    T, T_rot_of, tau = theory.cooling(law, 1.0, 0.5, 2.0, 0.1, 1.0, T_rot, times)
    T_at = np.exp(np.interp(at, tau, np.log(T)))
    return Cooling(T_at[None], np.interp(at, tau, T_rot_of / T)[None] * T_at)


def _rates(result: Result, name: str, heat: str, seeds: range) -> None:
    """Rates of T and T_rot at the start by DSMC against the closed form: see the module's text."""
    law, T_rot = coins[name].law, STARTS[heat]
    at = np.array([0.0, STEP, 2.0 * STEP])
    found = []
    for seed in seeds:
        disks, velocity, spin = thermal(DISKS_OF_RATES, seed, T_rot=T_rot)
        one = DSMC(disks, law, 0.1, velocity, spin, seed=seed).run(collisions_per_disk=at[-1], samples=at[1:])
        found.append(
            (
                _slope(np.log(one.temperature / one.temperature[0]), STEP),
                _slope(one.rotational_temperature / one.temperature[0], STEP),
            )
        )
    exact, soon = by_theory(law, T_rot, at), by_theory(law, T_rot, 0.01 * at)
    for i, (what, late, early) in enumerate(
        (("ln T", np.log(exact.T[0]), np.log(soon.T[0])), ("T_rot / T_0", exact.T_rot[0], soon.T_rot[0]))
    ):
        right = _slope(late, STEP)
        compare(
            result, f"d({what})/dtau at tau = 0, {name}, {heat} spins, DSMC against theory", [one[i] for one in found],
            right, disks=DISKS_OF_RATES, seeds=seeds, systematic=abs(right - _slope(early, 0.01 * STEP)), widest=0.06,
            why="the closed form's own third derivative (module's text)", source=GAUSSIAN,
        )  # fmt: skip


def _slope(f: Array, h: float) -> float:
    """df/dtau at 0 from f at 0, h and 2 h, without the second derivative."""
    return float(4.0 * f[1] - f[2] - 3.0 * f[0]) / (2.0 * h)


def _one(
    result: Result,
    name: str,
    phi: float,
    size: Size,
    heat: str,
    seed: int,
    place: int,
    dsmc: Cooling,
    tail: float,
) -> CooledGas:
    law, T_rot, (n, replicas) = coins[name].law, STARTS[heat], size
    quick = size in QUICK_SIZES.values()
    seeds = seeds_of(seed, replicas, place)
    got = measured(law, phi, T_rot, seeds, n)
    large = None if quick else measured(law, phi, T_rot, seeds_of(seed, 2, place + 80), LARGE)
    exact = by_theory(law, T_rot, TAU)
    theta = dsmc.theta.mean(axis=0)
    # How fast waves grow depends on theta: its mean until then.
    held = [streams(t, law, phi, n, theta=float(theta[: k + 1].mean())) for k, t in enumerate(TAU)]
    last = int(np.flatnonzero([one.share[0] <= MOST_SHARE for one in held])[-1])
    young = min(int(np.argmin(np.abs(TAU - YOUNG))), last)
    rows = {}
    for what, mine, right in (("T", got.T, dsmc.T), ("theta", got.theta, dsmc.theta)):
        for k, when in ((young, "young"), (last, "last")):
            wave = held[k]
            both = (wave.factor, wave.factor_error) if what == "T" else (wave.theta, wave.theta_error)
            factor, off = (float(one[0]) for one in both)
            clear = what == "T" or wave.share[0] <= SPINS[1]
            seen = clear and (what == "T" or phi <= SPINS[0])
            if not seen or (when == "last" and (last == young or (quick and what == "theta"))):
                continue
            mean = Mean.of(right[:, k]).times(factor)
            compare(
                result, f"{what} after {TAU[k]:g} collisions per disk, {name}, phi = {phi}, {heat} spins, against DSMC",
                mine[:, k], mean, disks=n, seeds=seeds,
                systematic=off * abs(mean.value), widest=0.25 if when == "last" else 0.12 if what == "T" else 0.15,
                why="waves too short for hydrodynamics; of theta also what spins see of them (validation/gas/waves.py)",
                source="DSMC of the same law",
            )  # fmt: skip
            rows[what, when] = result.rows[-1]

    def over(a: Array, b: Array, k: int) -> float:
        return float(a.mean(axis=0)[k] / b.mean(axis=0)[k])

    line = (
        name, phi, heat, over(dsmc.T, exact.T, young), over(dsmc.theta, exact.theta, young),
        over(dsmc.T, exact.T, -1), over(dsmc.theta, exact.theta, -1), over(got.theta, dsmc.theta, 4),
        over(got.T, dsmc.T, -1), over(got.theta, dsmc.theta, -1), float(held[-1].factor[0]),
        float(held[-1].factor_error[0]), float(TAU[last]), tail,
    )  # fmt: skip
    return CooledGas(heat, got, large, dsmc, exact, rows, line)


def _picture(phi: float, size: Size, names: Sequence[str], gases: list[CooledGas]) -> Picture:
    figure, axes = style.panels(len(names), 2, width=2.7, height=2.4)
    for at, gas in enumerate(gases):
        i = at // len(STARTS)
        colour = style.BLUE if gas.heat == "cold" else style.VERMILION
        for place, of, begin in ((axes[i], "T", 0), (axes[i + len(names)], "theta", 1)):
            each = (gas.small, gas.dsmc, gas.exact)
            small, dsmc, exact = (getattr(one, of).mean(axis=0)[begin:] for one in each)
            place.plot(TAU[begin:], exact, color=colour, lw=0.9)
            place.plot(TAU[begin:], dsmc, "--", color=colour, lw=0.9)
            style.points(place, TAU[begin:], small, colour, f"{gas.heat} spins", marks(colour)["marker"])
            if gas.large is not None:
                large = getattr(gas.large, of).mean(axis=0)[begin:]
                place.plot(TAU[begin:], large, "+", color=colour, ms=5.0)
    for i, name in enumerate(names):
        axes[i].set(yscale="log", title=name)
        axes[i + len(names)].set(yscale="log", xlabel=r"collisions per disk $\tau$")
    axes[0].set_ylabel(r"$T/T_0$")
    axes[len(names)].set_ylabel(r"$\theta = T_\mathrm{rot}/T$")
    axes[0].legend(fontsize=7)
    caption = (
        f"Cooling at packing fraction {phi} from cold (blue) and hot (vermilion) spins: simulated "
        f"({size.disks} disks circles and triangles, {LARGE} crosses), DSMC (dashed) and closed form (lines). Where markers "
        "leave the dashes, places matter: waves, and more of them in the larger box; where dashes leave the "
        "lines, velocities and spins are not Gaussian, spins with heavy tails first of all."
    )
    return Picture(f"gas_cooling_{phi:g}".replace(".", "_"), caption, figure)
