r"""Rough disks that keep their energy: e_n = 1 and friction that always sticks, with the slip reversed.

The contact-point law with e_t = 0 and the percussion-centre law with e_t = -1/2 (k = 2) both reverse the slip, g_t' =
-g_t: perfectly rough disks. mu = 10^6 takes the place of infinity: 1 in some 10^12 collisions would slide.

*Relaxation.* A collision gives P_t = 2 m_t g_t = m g_t / (1 + k). Averaged over colliding pairs of Gaussian velocities
and spins (`theory.rough_rates`, S. Luding, M. Huthmann, S. McNamara and A. Zippelius, Phys. Rev. E 58, 3416 (1998),
doi:10.1103/PhysRevE.58.3416), each collision of a disk changes T by k (T_rot - T) / (1 + k)^2 and T_rot by twice
that of the other sign, so that the difference falls like exp(-lambda tau), lambda = 3 k / (1 + k)^2 = 2/3. On the way
velocities and spins are neither Gaussian nor independent: from T_rot / T = 1/7, a_02 of the spins is 0.53 after a
quarter of a collision per disk, and a_11 grows to 0.09. The moments of the fourth degree, by the integrals of `rough`
to first order in the cumulants, make the difference 0.11 % larger after half a collision per disk, and 0.54 % after
one. Cumulants so large have a second order; it is taken to change as much as the first.

*Equipartition.* Momentum is kept, the angular one is not in a periodic box: energies of 2 (N - 1) components of motion
and N of spin have the same mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ... import theory
from ...model.laws.ifr import IFRLaw
from ...simulation.dsmc import DSMC
from ...theory.collisions import collision_rate
from ...theory.rough_gas import losses
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import Mean, compare, fluid, sampled_run, seeds_of, thermal

QUESTION = (
    "Do perfectly rough disks keep their energy, relax at the rate of kinetic theory, and share it equally?"
)
REFERENCE = "Luding et al. (1998), doi:10.1103/PhysRevE.58.3416; equipartition"

LAWS = {
    "contact point, e_t = 0": IFRLaw(e_n=1.0, e_t=0.0, mu=1e6, sticking="contact_point"),
    "percussion centre, e_t = -1/2": IFRLaw(e_n=1.0, e_t=-0.5, mu=1e6, sticking="percussion_center"),
}
LAMBDA = 2.0 / 3.0
N, PHI = 16384, 0.02
FEW = 512  # disks of the longer runs for equipartition
T, T_ROT = 1.4, 0.2  # at the start: the mean energy of a component is 1/2
TAU = np.linspace(0.0, 2.0, 9)
LATER, QUICK_LATER = (40.0, 540.0), (40.0, 240.0)  # collisions per disk over which equipartition is measured
SOURCE = "Luding et al. (1998), doi:10.1103/PhysRevE.58.3416"


def relaxed(tau: Array) -> Array:
    """T - T_rot over that at the start, with cumulants to first order, after `tau` collisions per disk (steps,)."""
    from scipy.integrate import solve_ivp

    gaussian = np.array([1.0, 0.5, 2.0, 0.75, 0.5])  # <x>, <y>, <x^2>, <y^2> and <x y>

    def units(M: Array) -> Array:
        moving, spinning = M[0] / gaussian[0], M[1] / gaussian[1]
        return np.array([moving, spinning, moving**2, spinning**2, moving * spinning])

    def slope(_: float, M: Array) -> Array:
        size = units(M)
        a = M / (gaussian * size) - 1.0
        J = -losses(1.0, 1.0, size[1] / size[0], 2.0) @ [1.0, *a[2:]]
        return np.asarray(size * J / float(theory.collision_factor(a[2])))

    begin = gaussian * units(gaussian * [T, T_ROT, 0.0, 0.0, 0.0])
    M = solve_ivp(slope, (tau[0], tau[-1]), begin, t_eval=tau, rtol=1e-9, atol=1e-12).y
    apart = M[0] / gaussian[0] - M[1] / gaussian[1]
    return np.asarray(apart / apart[0])


def run(quick: bool, seed: int) -> Result:
    result = Result()
    replicas, span = (20, QUICK_LATER) if quick else (24, LATER)
    figure, (left, right) = style.panels(2)
    bridge = np.array([_dsmc(one, N) for one in seeds_of(seed, replicas, 180)])
    laws = dict(list(LAWS.items())[-1:]) if quick else LAWS
    exact = np.exp(-LAMBDA * TAU)
    for i, (name, law) in enumerate(laws.items()):
        seeds = seeds_of(seed, replicas, 100 + 40 * i)
        ratio, drift, shares = (
            np.array(part) for part in zip(*(_replica(law, one, span) for one in seeds), strict=True)
        )
        result.near(
            f"largest relative change of the energy, {name}, {span[1]:g} collisions per disk",
            drift.max(), 0.0, 1e-12, "f64 round-off of 3e5 collisions", "conservation of energy",
        )  # fmt: skip
        _compare(result, name, seeds, ratio, bridge, shares, span)
        look = style.COLOURS[i], name.replace("e_t", "$e_t$").replace("-1/2", "$-$1/2"), "os"[i]
        style.errorbars(left, TAU, ratio, *look)
        style.errorbars(right, TAU + 0.01 * (2 * i - 1), 100.0 * (ratio / exact - 1.0), *look)
    left.plot(TAU, exact, color=style.BLACK, label=r"$e^{-2\tau/3}$")
    mean, error = bridge.mean(axis=0) / exact, bridge.std(axis=0, ddof=1) / math.sqrt(len(bridge)) / exact
    right.plot(TAU, 100.0 * (mean - 1.0), color=style.GREEN, label="DSMC")
    right.fill_between(
        TAU, 100.0 * (mean - error - 1.0), 100.0 * (mean + error - 1.0), color=style.GREEN, alpha=0.2, lw=0.0
    )
    right.axhline(0.0, color=style.BLACK)
    right.plot(TAU, 100.0 * (relaxed(TAU) / exact - 1.0), "--", color=style.BLACK, label="with cumulants")
    left.set(
        yscale="log",
        xlabel=r"collisions per disk $\tau$",
        ylabel=r"$(T - T_\mathrm{rot})$ / that at the start",
    )
    right.set(xlabel=r"collisions per disk $\tau$", ylabel=r"difference from $e^{-2\tau/3}$ (%)")
    left.legend()
    right.legend()
    caption = (
        f"Relaxation of perfectly rough disks at packing fraction {PHI}; mean of {replicas} gases of {N} with standard "
        "errors, which are those of one and the same gas at all times."
    )
    result.pictures.append(Picture("gas_elastic", caption, figure))
    return result


def _compare(
    result: Result,
    name: str,
    seeds: Sequence[int],
    ratio: Array,
    bridge: Array,
    shares: Array,
    span: tuple[float, float],
) -> None:
    theoretical = relaxed(TAU)
    for tau in (0.5, 1.0, 2.0) if span == LATER else (0.5, 1.0):
        at = int(np.argmin(np.abs(TAU - tau)))
        expected = float(theoretical[at])
        text = f"(T - T_rot) / that at the start after {tau:g} collisions per disk, {name}"
        if tau <= 1.0:
            compare(
                result, f"{text}, against theory", ratio[:, at], expected, disks=N, seeds=seeds, widest=0.05,
                systematic=abs(expected - math.exp(-LAMBDA * tau)), source=SOURCE,
                why="as much again as first-order cumulants of velocities and spins change (module's text)",
            )  # fmt: skip
        mean = Mean.of(bridge[:, at])
        compare(
            result, f"{text}, against DSMC", ratio[:, at], mean, disks=N, seeds=seeds, widest=0.08,
            systematic=0.2 * PHI * mean.value,
            why="phi / 5: two disks may meet again, having met others in between, in a gas of packing fraction phi",
            source="DSMC of the same law",
        )  # fmt: skip
    compare(
        result, f"T_rot / T, {span[0]:g} to {span[1]:g} collisions per disk, {name}", shares, 1.0, disks=FEW,
        seeds=seeds, systematic=0.0, why="none: both are known exactly", source="equipartition", widest=0.02,
    )  # fmt: skip


def _replica(law: IFRLaw, seed: int, span: tuple[float, float]) -> tuple[Array, float, float]:
    """(T - T_rot) relative to the start at `TAU`, the relative change of the energy, and T_rot / T later on."""
    gas = fluid(N, PHI, seed, law, melting=3.0, T=T, T_rot=T_ROT)
    _, rows = sampled_run(gas, len(TAU) - 1, collisions_per_disk=TAU[-1])
    apart = np.array([one.temperature - one.rotational_temperature for one in rows])
    gas = fluid(FEW, PHI, seed, law, melting=5.0, T=T, T_rot=T_ROT)
    # By time: at the moment of a collision its pair has more energy of motion than others, T / 2 in the mean.
    first, last = (tau / collision_rate(PHI, 1.0, 1.0, 0.5) for tau in span)
    gas.run(t_end=first)
    _, later = sampled_run(gas, round((span[1] - span[0]) / 2.0), t_end=last)
    drifts = [abs(run[-1].energy / run[0].energy - 1.0) for run in (rows, later)]
    moving = np.mean([one.temperature for one in later]) * FEW / (FEW - 1.0)
    shares = float(np.mean([one.rotational_temperature for one in later]) / moving)
    return apart / apart[0], max(drifts), shares


def _dsmc(seed: int, n: int) -> Array:
    """The same relaxation by DSMC."""
    disks, velocity, spin = thermal(n, seed, T=T, T_rot=T_ROT)
    gas = DSMC(disks, LAWS["contact point, e_t = 0"], PHI, velocity, spin, seed=seed)
    found = gas.run(collisions_per_disk=TAU[-1], samples=TAU[1:])
    apart = found.temperature - found.rotational_temperature
    return apart / apart[0]
