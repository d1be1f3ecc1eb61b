r"""Smooth disks that cool: Haff's law with what shear modes add to it, and how far velocities are from Gaussian.

*Haff's law.* Each collision of a disk takes (1 - e^2) / 2 of its temperature, times a factor of the cumulant a_2
(`theory.cooling_factor`); so T falls like exp(-z tau) in collisions per disk, and like 1 / (1 + t / t_H)^2 in time
(P. K. Haff, J. Fluid Mech. 134, 401 (1983), doi:10.1017/S0022112083003419). In a box with waves above the shear
length these grow beside thermal velocities: T counts both, and is 1 + `theory.shear_mode_energy` times that of a
homogeneous gas (T. P. C. van Noije, M. H. Ernst, R. Brito and J. A. G. Orza, Phys. Rev. Lett. 79, 411 (1997),
doi:10.1103/PhysRevLett.79.411). Here the share stays below 0.02; where it is, T has been seen
3 % above a homogeneous gas's (`theory.shear_mode_time`), so that 1.2 times the share is left to other waves.

*Cumulant.* T. P. C. van Noije and M. H. Ernst, Granul. Matter 1, 57 (1998), doi:10.1007/s100350050009, to first order
in a_2: the next orders change it by a tenth and more (`sonine_theory`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import analysis, theory
from ..dsmc import DSMC
from ..law import IFRLaw
from ..observables import Measure
from ..simulation import Simulation
from ..state import State
from . import style
from .gas_sample import Mean, compare, fluid, seeds_of, start
from .registry import Picture, Result

QUESTION = (
    "Do smooth disks cool by Haff's law with its shear modes, and become as non-Gaussian as theory says?"
)
REFERENCE = (
    "Haff (1983), doi:10.1017/S0022112083003419; van Noije and Ernst (1998), doi:10.1007/s100350050009"
)

HAFF = "Haff (1983), doi:10.1017/S0022112083003419; shear modes: doi:10.1103/PhysRevLett.79.411"
CUMULANT = "van Noije and Ernst (1998), doi:10.1007/s100350050009"
E_N, PHI, N = 0.9, 0.1, 2048
TAU = np.array([0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0])
CUMULANTS = (0.95, 0.9, 0.8, 0.7, 0.6)  # e_n at which DSMC is asked for a_2
SETTLED = (10.0, 40.0)  # collisions per disk over which a_2 is averaged
Array = NDArray[np.float64]


def smooth(e_n: float) -> IFRLaw:
    """Disks without friction."""
    return IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)


def run(quick: bool, seed: int) -> Result:
    """See the module's QUESTION."""
    result = Result()
    figure, (left, right) = style.panels(2)
    _haff(result, quick, seed, left)
    _cumulants(result, quick, seed, right)
    caption = (
        f"(a) Temperature of {N} smooth disks, e_n = {E_N}, packing fraction {PHI}, over Haff's law; with shear "
        f"modes, and "
        "without. (b) Cumulant a_2 of the cooling state, first-order theory and simulations."
    )
    for axes, text in ((left, "a"), (right, "b")):
        axes.set_title(text, loc="left", weight="bold", fontsize=9)
    result.pictures.append(Picture("gas_haff", caption, figure))
    return result


def _replica(seed: int) -> tuple[list[Measure], list[State]]:
    disks, box, begin = fluid(N, PHI, seed, melting=20.0)
    gas = Simulation(disks, box, smooth(E_N), begin)
    rows: list[Measure] = []
    states: list[State] = []

    def keep(state: State, measure: Measure) -> None:
        rows.append(measure)
        states.append(state)

    for tau in TAU:
        gas.run(collisions_per_disk=max(tau, 1e-9), observers=[keep])
    return rows[1::2], states[1::2]


def _haff(result: Result, quick: bool, seed: int, axes: Any) -> None:
    replicas = 12 if quick else 40
    seeds = seeds_of(seed, replicas, 300)
    runs = [_replica(one)[0] for one in seeds]
    tau = np.array([[2.0 * one.collisions / N for one in rows] for rows in runs])
    T = np.array([[one.temperature for one in rows] for rows in runs]) * N / (N - 1.0)
    T = T / T[:, :1]
    side = math.sqrt(N * math.pi / 4.0 / PHI)
    law, box = smooth(E_N), (side, side)
    z = 0.5 * (1.0 - E_N**2)
    a_2 = theory.cooling_sonine(E_N)
    exact = z * float(theory.cooling_factor(a_2) / theory.collision_factor(a_2))
    share = np.array([theory.shear_mode_energy(float(x), law, 0.5, PHI, box) for x in TAU])
    why = "0.5 %: a_2 takes ten collisions to its end; 1.2 times the share: other waves grow too (`hydrodynamics`)"
    scaled = T * np.exp(exact * tau)
    for i in range(2, len(TAU)):
        compare(
            result, f"T over exp(-z tau) after {TAU[i]:g} collisions per disk, e_n = {E_N}, shear modes' share "
            f"{share[i]:.3f}",
            scaled[:, i], 1.0 + share[i], disks=N, seeds=seeds, systematic=0.005 + 1.2 * share[i], why=why, source=HAFF,
        )  # fmt: skip
    fits = [
        analysis.haff_fit([m.time for m in rows[:5]], [m.temperature for m in rows[:5]]).t_H for rows in runs
    ]
    rate = theory.collision_rate(PHI, N / (N - 1.0), 1.0, 0.5) * float(theory.collision_factor(a_2))
    t_H = 2.0 / (exact * rate)
    compare(
        result, f"Haff's time t_H [1 / collision rate] to 15 collisions per disk, e_n = {E_N}",
        np.array(fits) * rate, t_H * rate, disks=N, seeds=seeds, systematic=0.01 * t_H * rate,
        why="1 %: a_2 on its way, and shear modes", source=HAFF,
    )  # fmt: skip
    fine = np.linspace(0.0, TAU[-1], 100)
    axes.plot(
        fine, 1.0 + np.array([theory.shear_mode_energy(float(x), law, 0.5, PHI, box) for x in fine]),
        color=style.BLACK, label="shear modes",
    )  # fmt: skip
    axes.axhline(1.0, color=style.GREEN, ls="--", label="Haff's law")
    error = scaled.std(axis=0, ddof=1) / math.sqrt(replicas)
    axes.errorbar(TAU, scaled.mean(axis=0), error, fmt="o", mfc="none", color=style.BLUE, label="simulated")
    axes.set(xlabel=r"collisions per disk $\tau$", ylabel=r"$T\,/\,T_0 e^{-z\tau}$")
    axes.legend(loc="upper left")


def _cumulants(result: Result, quick: bool, seed: int, axes: Any) -> None:
    n, replicas = (20_000, 8) if quick else (50_000, 16)
    fine = np.linspace(0.5, 1.0, 100)
    axes.plot(fine, [theory.cooling_sonine(e) for e in fine], color=style.BLACK, label="van Noije and Ernst")
    why = "a fifth of it and 0.002: the next orders in a_2 (see sonine_theory)"
    for i, e_n in enumerate(CUMULANTS):
        if quick and e_n not in (E_N, 0.7):
            continue
        seeds = seeds_of(seed, replicas, 400 + 20 * i)
        found = np.array([_cumulant(e_n, n, one) for one in seeds])
        expected = theory.cooling_sonine(e_n)
        compare(
            result, f"a_2 of dilute cooling disks by DSMC, e_n = {e_n}", found, expected, disks=n, seeds=seeds,
            systematic=0.002 + 0.2 * abs(expected), why=why, source=CUMULANT,
        )  # fmt: skip
        mean = Mean.of(found)
        axes.errorbar(e_n, mean.value, mean.error, fmt="s", mfc="none", color=style.VERMILION,
                      label="DSMC" if e_n == E_N else None)  # fmt: skip
        if e_n == E_N:
            _engine_cumulant(result, mean, quick, seed, axes)
    axes.axhline(0.0, color=style.GREY, lw=0.6)
    axes.set(xlabel=r"normal restitution $e_n$", ylabel=r"$a_2$")
    axes.legend()


def _cumulant(e_n: float, n: int, seed: int) -> float:
    disks, _, begin = start(n, 0.01, seed)
    gas = DSMC(disks, smooth(e_n), 0.01, begin.velocity, seed=seed, contact="dilute")
    gas.run(collisions_per_disk=SETTLED[0], samples=1)
    return float(gas.run(collisions_per_disk=SETTLED[1], samples=15).a_2.mean())


def _engine_cumulant(result: Result, right: Mean, quick: bool, seed: int, axes: Any) -> None:
    """a_2 by the engine, between 6 and 14 collisions per disk: later, streams make velocities Gaussian again."""
    n, phi, replicas = 8192, 0.02, (8 if quick else 32)
    seeds = seeds_of(seed, replicas, 500)
    found = []
    for one in seeds:
        disks, box, begin = fluid(n, phi, one, melting=10.0)
        gas = Simulation(disks, box, smooth(E_N), begin)
        gas.run(collisions_per_disk=6.0)
        each: list[float] = []

        def keep(state: State, _: Measure, each: list[float] = each) -> None:
            each.append(theory.sonine_coefficient(state.velocity))

        gas.run(collisions_per_disk=14.0, frames=8, observers=[keep])
        found.append(np.mean(each))
    compare(
        result, f"a_2 of cooling disks, e_n = {E_N}, phi = {phi}, 6 to 14 collisions per disk, against DSMC", found,
        right, disks=n, seeds=seeds, systematic=0.003,
        why="0.003: a tenth of a_2, for streams and for its last approach to the end", source="DSMC of the same law",
    )  # fmt: skip
    mean = Mean.of(found)
    axes.errorbar(
        E_N + 0.004, mean.value, mean.error, fmt="o", mfc="none", color=style.BLUE, label="simulated"
    )
