r"""Smooth disks that cool: Haff's law with what shear modes add to it, and how far velocities are from Gaussian.

*Haff's law.* Each collision of a disk takes (1 - e^2) / 2 of its temperature, times a factor of the cumulant a_2
(`theory.cooling_factor`); so T falls like exp(-z tau) in collisions per disk, and like 1 / (1 + t / t_H)^2 in time (P.
K. Haff, J. Fluid Mech. 134, 401 (1983)). T is taken over that after 5 collisions per disk, when a_2 has come near its
end. One gas is dilute, in a box below the shear length: nothing grows there. In the other, waves above the shear length
grow relative to thermal velocities, and T is F times as large (validation/gas/waves.py; T. P. C. van Noije, M. H.
Ernst, R. Brito and J. A. G. Orza, Phys. Rev. Lett. 79, 411 (1997), doi:10.1103/PhysRevLett.79.411; J. J. Brey and M. J.
Ruiz-Montero, arXiv:cond-mat/0701249). A fifth of a_2, by which its first order is off, changes z by a twentieth of a_2.

*Cumulant.* T. P. C. van Noije and M. H. Ernst, Granul. Matter 1, 57 (1998). Their first order in a_2, which the
package has, is off by a tenth and more; polynomials up to the sixth, by quadrature (validation/gas/sonine_series.py),
leave 0.1 % at e_n = 0.9 and 5 % at 0.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ... import analysis, theory
from ...model.laws.ifr import IFRLaw
from ...model.observables import Measure
from ...plots.style import dashes, marks
from ...simulation.dsmc import DSMC
from ..report import style
from ..report.registry import Picture, Result
from .sample import Mean, compare, fluid, sampled_run, seeds_of, thermal
from .sonine_series import cooling_sonine
from .waves import streams

QUESTION = (
    "Do smooth disks cool by Haff's law with its shear modes, and become as non-Gaussian as theory says?"
)
REFERENCE = "Haff, J. Fluid Mech. 134, 401 (1983); van Noije and Ernst, Granul. Matter 1, 57 (1998)"

HAFF = "Haff, J. Fluid Mech. 134, 401 (1983); shear modes: doi:10.1103/PhysRevLett.79.411"
CUMULANT = "equations of van Noije and Ernst, Granul. Matter 1, 57 (1998), with S_2 to S_6"
E_N = 0.9
DILUTE, DENSE = (0.01, 4096), (0.1, 16384)  # packing fraction, disks
TAU = np.array([0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0])
NORMAL = 2  # T is taken over that at TAU[NORMAL]
CUMULANTS = (0.95, 0.9, 0.8, 0.6)  # e_n at which DSMC computes a_2
SETTLING = (
    6.0,
    14.0,
)  # collisions per disk over which a_2 is averaged for the engine: later, streams are Gaussian
SETTLED = 66.0  # until which it is averaged by DSMC


def smooth(e_n: float) -> IFRLaw:
    """Disks without friction."""
    return IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, (left, right) = style.panels(2)
    _haff(result, quick, seed, left)
    _cumulants(result, quick, seed, right)
    caption = (
        f"(a) Temperature of smooth disks, e_n = {E_N}, over Haff's law, both as after {TAU[NORMAL]:g} collisions per "
        "disk; lines: with shear modes, with what is uncertain of them. (b) Cumulant a_2 of the cooling state, "
        "first-order theory, polynomials up to the sixth, DSMC of the settled gas, and the simulated one while it "
        "settles."
    )
    style.titles(left, right)
    result.pictures.append(Picture("gas_haff", caption, figure))
    return result


def _replica(phi: float, n: int, seed: int) -> list[Measure]:
    gas = fluid(n, phi, seed, smooth(E_N), melting=5.0)
    rows: list[Measure] = []
    for tau in TAU:
        gas.run(collisions_per_disk=max(tau, 1e-9))
        rows.append(gas.measure())
    return rows


def _haff(result: Result, quick: bool, seed: int, axes: Any) -> None:
    z = 0.5 * (1.0 - E_N**2)
    a_2 = theory.cooling_sonine(E_N)
    exact = z * float(theory.cooling_factor(a_2) / theory.collision_factor(a_2))
    replicas = 18 if quick else 24
    for i, (phi, n) in enumerate((DILUTE,) if quick else (DILUTE, DENSE)):
        seeds = seeds_of(seed, replicas, 300 + 40 * i)
        runs = [_replica(phi, n, one) for one in seeds]
        tau = np.array([[2.0 * one.collisions / n for one in rows] for rows in runs])
        T = np.array([[one.temperature for one in rows] for rows in runs])
        scaled = T * np.exp(exact * tau)
        scaled = scaled / scaled[:, NORMAL : NORMAL + 1]
        waves = streams(TAU, smooth(E_N), phi, n)
        right = waves.factor / waves.factor[NORMAL]
        off = waves.factor_error - waves.factor_error[NORMAL] + 0.05 * abs(a_2) * z * (TAU - TAU[NORMAL])
        for k in range(NORMAL + 1, len(TAU)):
            if TAU[k] not in (10.0, 20.0, 30.0):
                continue
            compare(
                result, f"T after {TAU[k]:g} collisions per disk over that after {TAU[NORMAL]:g} and exp(-z tau), "
                f"e_n = {E_N}, phi = {phi}, with a factor of {right[k]:.4f} by waves",
                scaled[:, k], right[k], disks=n, seeds=seeds, systematic=off[k], widest=0.035, source=HAFF,
                why="waves too short for hydrodynamics (validation/gas/waves.py), and a fifth of a_2 in z",
            )  # fmt: skip
        if phi == DILUTE[0]:
            _haff_time(result, runs, exact, a_2, seeds)
        colour = (style.BLUE, style.VERMILION)[i]
        axes.plot(TAU[NORMAL:], right[NORMAL:], **dashes(colour))
        axes.fill_between(
            TAU[NORMAL:], (right - off)[NORMAL:], (right + off)[NORMAL:], color=colour, alpha=0.15, lw=0.0
        )
        marker = marks(colour)["marker"]
        style.errorbars(axes, TAU, scaled, colour, rf"$\phi$ = {phi}, {n:,} disks", marker)
    axes.axhline(1.0, label="Haff's law", **dashes(style.GREEN))
    axes.set(xlabel=r"collisions per disk $\tau$", ylabel=r"$T\,/\,T_5\, e^{-z(\tau - 5)}$")
    axes.legend(loc="upper left")


def _haff_time(result: Result, runs: list[list[Measure]], z: float, a_2: float, seeds: Sequence[int]) -> None:
    """Haff's time of the dilute gas from its state after 5 collisions per disk on: T(t) = T_5 / (1 + t / t_H)^2."""
    phi, n = DILUTE
    last = int(np.flatnonzero(TAU == 20.0)[0]) + 1
    found = []
    for rows in runs:
        kept = rows[NORMAL:last]
        T_5 = kept[0].temperature * n / (n - 1.0)
        rate = theory.collision_rate(phi, T_5, 1.0, 0.5) * float(theory.collision_factor(a_2))
        fit = analysis.haff_fit([m.time - kept[0].time for m in kept], [m.temperature for m in kept])
        found.append(fit.t_H * rate)
    compare(
        result, f"Haff's time t_H [1 / collision rate], 5 to 20 collisions per disk, e_n = {E_N}, phi = {phi}", found,
        2.0 / z, disks=n, seeds=seeds, systematic=0.005 * 2.0 / z, widest=0.03, source=HAFF,
        why="0.5 %: waves of 0.3 %, and a fifth of a_2 in z and in the collision rate",
    )  # fmt: skip


def _cumulants(result: Result, quick: bool, seed: int, axes: Any) -> None:
    n = 10_000 if quick else 20_000
    fine = np.linspace(0.5, 1.0, 100)
    axes.plot(
        fine, [theory.cooling_sonine(e) for e in fine], color=style.BLACK, label="van Noije and Ernst, $S_2$"
    )
    why = "what S_5 or S_6 change"
    for i, e_n in enumerate(CUMULANTS):
        if quick and e_n != E_N:
            continue
        replicas = 16 if quick else 64 if e_n == E_N else 24
        seeds = seeds_of(seed, replicas, 7000 + 100 * i)
        early, found = np.array([_cumulant(e_n, n, one) for one in seeds]).T
        expected, off = cooling_sonine(e_n)
        compare(
            result, f"a_2 of dilute cooling disks by DSMC, e_n = {e_n}", found, expected, disks=n, seeds=seeds,
            systematic=off, widest=0.005 / abs(expected), why=why, source=CUMULANT,
        )  # fmt: skip
        style.errorbars(axes, e_n, found, style.VERMILION, "DSMC" if e_n == E_N else None, "s")
        axes.plot(e_n, expected, "x", color=style.BLACK, label="up to $S_6$" if e_n == E_N else None)
        if e_n == E_N and not quick:
            _engine_cumulant(result, Mean.of(early), seed, axes)
    axes.axhline(0.0, color=style.GREY, lw=0.6)
    axes.set(xlabel=r"normal restitution $e_n$", ylabel=r"$a_2$")
    axes.legend()


def _cumulant(e_n: float, n: int, seed: int) -> tuple[float, float]:
    """a_2 while it settles, over `SETTLING`, and after."""
    disks, velocity, _ = thermal(n, seed)
    gas = DSMC(disks, smooth(e_n), 0.01, velocity, seed=seed, contact="dilute")
    gas.run(collisions_per_disk=SETTLING[0], samples=1)
    early = gas.run(collisions_per_disk=SETTLING[1], samples=16)
    return float(early.a_2.mean()), float(gas.run(collisions_per_disk=SETTLED, samples=30).a_2.mean())


def _engine_cumulant(result: Result, right: Mean, seed: int, axes: Any) -> None:
    """a_2 by the engine, between 6 and 14 collisions per disk: later, streams make velocities Gaussian again."""
    n, phi, replicas = 16384, 0.02, 32
    seeds = seeds_of(seed, replicas, 500)
    found = []
    for one in seeds:
        gas = fluid(n, phi, one, smooth(E_N), melting=5.0)
        gas.run(collisions_per_disk=SETTLING[0])
        states, _ = sampled_run(gas, 16, collisions_per_disk=SETTLING[1])
        found.append(np.mean([theory.sonine_coefficient(state.velocity) for state in states]))
    compare(
        result, f"a_2 of cooling disks, e_n = {E_N}, phi = {phi}, 6 to 14 collisions per disk, against DSMC", found,
        right, disks=n, seeds=seeds, systematic=0.001, widest=0.25,
        why="3 % of a_2: waves, which are Gaussian, hold half a percent of T; recollisions",
        source="DSMC of the same law",
    )  # fmt: skip
    style.errorbars(axes, E_N + 0.004, found, style.BLUE, "simulated")
