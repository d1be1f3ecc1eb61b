r"""Disks under gravity on a hot floor: a layer that floats and swings, and mixtures whose large disks rise or sink.

Units: mass and diameter d of a (small) disk and g are 1.

*A layer that floats* (P. Eshuis, K. van der Weele, D. van der Meer and D. Lohse, Phys. Rev. Lett. 95, 258001 (2005),
doi:10.1103/PhysRevLett.95.258001). F layers of inelastic disks lie on a floor that shakes with a sin(omega t); S =
(a omega)^2 / (g d). Hard and with enough layers, a dense cluster, crystalline in the experiment, floats on a thin gas.
Packing fractions are means over time; hard disks are a crystal from 0.720 on.

*It swings* (N. Rivas, S. Luding and A. R. Thornton, New J. Phys. 15, 113043 (2013), doi:10.1088/1367-2630/15/11/113043,
who saw it first). The layer, of mass M per length, is a piston on the gas, of thickness h: M h'' = P(h) - M g, and P(h)
goes like h^-gamma, so that

    omega_0^2 = gamma g / h,

whatever M is. A gas that keeps the temperature that the floor gives it has gamma = 1, one that keeps its energy gamma =
2 (smooth disks in two dimensions); a disk crosses the gas some times in a period, so that the truth is between,
nearer 1. That omega_0 (h / g)^(1/2) lies from 1 to 2^(1/2) is what is tested; h varies fourfold with S. h ends where
the density is half of its maximum, and is the room of centres above the middle of the floor's motion. omega_0 is that
of a damped oscillator which noise drives, fitted (Whittle's likelihood) to the spectrum of the mean height.

*Mixtures* (D. C. Hong, P. V. Quinn and S. Luding, Phys. Rev. Lett. 86, 3423 (2001),
doi:10.1103/PhysRevLett.86.3423: large disks rise or sink by their mass; J. A. Both and D. C. Hong, Phys. Rev. Lett. 88,
124301 (2002), doi:10.1103/PhysRevLett.88.124301: the same by minimising a free energy of local densities). Elastic
disks of two sizes on a floor of temperature T are in equilibrium:

    ln n_i + mu_i(n) + m_i g y / T = const.,  mu_i = dF/dn_i,
    F = n [-(1 - xi) ln(1 - phi) + xi A(phi)],  A = int_0^phi (Z - 1) dphi'/phi',  xi = <d>^2 / <d^2>,

F / T being the free energy per area beyond that of an ideal gas, by integrating Z of a mixture (A. Santos, S. B. Yuste
and M. Lopez de Haro, Mol. Phys. 96, 1 (1999): (1 - xi) / (1 - phi) + xi Z), with Z of equal disks by Kolafa and Rottner
(`gas_state`). Such a theory knows nothing of the layers in which disks lie at the floor: one small diameter is granted.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ...model.box import Box
from ...model.collapse import VelocityCutoff
from ...model.laws.ifr import IFRLaw
from ...model.state import Disks
from ...model.walls.motion import Motion
from ...model.walls.wall import Wall
from ...plots.style import dashes, marks
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import ELASTIC, compare, equal_disks, ratio, sampled_run, scattered, seeds_of
from .state import compressibility

QUESTION = "Does a shaken layer float and swing on its gas, and do large disks rise or sink by their mass?"
REFERENCE = (
    "Eshuis et al. (2005), doi:10.1103/PhysRevLett.95.258001; Rivas et al. (2013), doi:10.1088/1367-2630/15/11/113043; "
    "Hong et al. (2001), doi:10.1103/PhysRevLett.86.3423"
)

FLOATING = "Eshuis et al. (2005), doi:10.1103/PhysRevLett.95.258001"
SWINGING = "a piston on a gas, between isothermal and adiabatic: validation/gas/shaken.py"
MIXED = "local densities, as Both and Hong (2002), doi:10.1103/PhysRevLett.88.124301"
MELTING = 0.720
"""Packing fraction from which on hard disks are a crystal (Bernard and Krauth, doi:10.1103/PhysRevLett.107.155704)."""

SHAKEN = IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0)
STRENGTHS = (50.0, 100.0, 200.0)
LAYERS, BED, AMPLITUDE = 12, 10.0, 0.3  # F, width of the box, a
STRIP = 0.5  # of the density profile

LARGE = 2.0  # diameter of large disks
MASSES = (1.0, 1.75, 2.25, 3.0)  # of large disks; T is such that they are neither gas nor crystal
COUNTS, ROOM, WARM = (120, 40), (20.0, 150.0), 6.0  # small and large ones; width and height of the box; T


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, axes = style.panels(2, 2)
    _floating(result, quick, seed, axes[0], axes[1])
    _mixtures(result, quick, seed, axes[2], axes[3])
    style.letters(*axes)
    caption = (
        f"(a) Packing fraction above a shaken floor, {LAYERS} layers and 2. (b) Frequency of the layer over "
        "(g / h)^(1/2); band: gas below it between isothermal and adiabatic. (c) Mean heights of small and large disks "
        "(diameters 1 and 2) in equilibrium, against the mass of the large ones; lines: local densities. (d) Their "
        "densities for the lightest and the heaviest large disks."
    )
    result.pictures.append(Picture("gas_shaken", caption, figure))
    return result


# -- a layer that floats -----------------------------------------------------------------------------------


class Bed(NamedTuple):
    """Means of a shaken bed over time."""

    height: Array  # middles of strips
    phi: Array  # packing fraction in them
    time: Array  # of samples
    mean: Array  # mean height of the disks then

    @property
    def top(self) -> int:
        """The densest strip."""
        return int(self.phi.argmax())

    @property
    def gas(self) -> float:
        """Least packing fraction below it, out of the floor's reach."""
        below = (self.height > 2.0 * AMPLITUDE + 0.6) & (self.height < self.height[self.top])
        return float(self.phi[below].min()) if below.any() else float(self.phi[self.top])

    @property
    def thickness(self) -> float:
        """Room of centres between the floor's middle and half of the largest density."""
        half = 0.5 * self.phi[self.top]
        last = int(np.nonzero(self.phi[: self.top] < half)[0][-1])
        edge = np.interp(half, self.phi[last : last + 2], self.height[last : last + 2])
        return float(edge) - AMPLITUDE - 0.5


def _bed(strength: float, layers: int, seed: int, long: float) -> Bed:
    """Shake a bed for a fifth of `long`, and measure it for the rest."""
    n = round(layers * BED)
    omega = math.sqrt(strength) / AMPLITUDE
    motion = Motion("sine", amplitude=AMPLITUDE, frequency=omega / (2.0 * math.pi))
    floor = Wall.line((0.0, AMPLITUDE), (0.0, 1.0), motion=motion)
    disks, box = equal_disks(n), Box((BED, 200.0), (True, False))
    start = scattered(disks, Box((BED, 60.0), (True, False)), seed, [floor], temperature=1.0)
    bed = Simulation(
        disks, box, SHAKEN, start, walls=[floor], gravity=(0.0, -1.0), collapse=VelocityCutoff(1e-3),
    )  # fmt: skip
    bed.run(t_end=0.2 * long)
    states, _ = sampled_run(bed, round(1.6 * long), t_end=long)
    edges = np.arange(0.0, 200.0 + 0.5 * STRIP, STRIP)
    y = np.array([state.position[:, 1] for state in states])
    phi = np.histogram(y, edges)[0] * 0.25 * math.pi / (len(y) * BED * STRIP)
    return Bed(
        0.5 * (edges[1:] + edges[:-1]), phi, np.array([state.time for state in states]), y.mean(axis=1)
    )


def swing(time: Array, height: Array, guess: float) -> float:
    """Frequency [rad/time] of a damped oscillator that white noise drives, from a quarter to twice a guess."""
    from scipy.optimize import minimize

    y, step = height - height.mean(), float(np.diff(time).mean())
    power = np.abs(np.fft.rfft(y)) ** 2 / len(y)
    omega = 2.0 * math.pi * np.fft.rfftfreq(len(y), step)
    near = (omega > 0.25 * guess) & (omega < 2.0 * guess)
    omega, power = omega[near], power[near]

    def loss(logs: Array) -> float:
        own, damping, scale = np.exp(logs)
        model = scale / ((own**2 - omega**2) ** 2 + (damping * omega) ** 2)
        return float(np.sum(np.log(model) + power / model))

    starts = ((guess, part * guess, power.mean() * part * guess**4) for part in (0.2, 0.6))
    found = (
        minimize(loss, np.log(start), method="Nelder-Mead", options={"maxiter": 4000}) for start in starts
    )
    return float(np.exp(min(found, key=lambda one: one.fun).x[0]))


def _floating(result: Result, quick: bool, seed: int, left: Any, right: Any) -> None:
    replicas, long = (6, 400.0) if quick else (8, 1000.0)
    for i, strength in enumerate(STRENGTHS):
        if quick and i != 1:
            continue
        seeds = seeds_of(seed, replicas, 6000 + 50 * i)
        beds = [_bed(strength, LAYERS, one, long) for one in seeds]
        name = f"{LAYERS} layers shaken with S = {strength:g}"
        densest = [bed.phi[bed.top] for bed in beds]
        thin = [bed.gas for bed in beds]
        result.at_least(
            f"packing fraction of {name}: largest over least below it", np.mean(densest) / np.mean(thin), 2.0,
            "half as dense below the layer as in it: 1 without a layer that floats", FLOATING,
        )  # fmt: skip
        if strength <= 100.0:  # harder shaken it swings too far for its mean to be that of a crystal
            result.at_least(
                f"packing fraction of {name}, largest", np.mean(densest), MELTING, "a crystal, as in the experiment",
                FLOATING,
            )  # fmt: skip
        swings = [swing(bed.time, bed.mean, bed.thickness**-0.5) * bed.thickness**0.5 for bed in beds]
        ends = (1.0, math.sqrt(2.0))
        compare(
            result, f"frequency of {name}, over (g / h)^(1/2)", swings, 0.5 * sum(ends), disks=round(LAYERS * BED),
            seeds=seeds, systematic=0.5 * (ends[1] - ends[0]), widest=0.35, source=SWINGING,
            why="from 1, a gas of constant temperature, to 2^(1/2), one of constant energy",
        )  # fmt: skip
        left.plot(np.mean([bed.phi for bed in beds], axis=0), beds[0].height,
                  label=f"$S$ = {strength:g}, $F$ = {LAYERS}", **dashes(style.COLOURS[i]))  # fmt: skip
        style.errorbars(right, strength, swings, style.BLUE, None if i > 1 else "simulated")
    few = [_bed(100.0, 2, one, 0.5 * long) for one in seeds_of(seed, 4, 6200)]
    result.near(
        "packing fraction of 2 layers shaken with S = 100, largest", np.mean([bed.phi[bed.top] for bed in few]), 0.0,
        0.5 * MELTING, "a gas: no more than half as dense as a crystal", FLOATING,
    )  # fmt: skip
    left.plot(
        np.mean([bed.phi for bed in few], axis=0), few[0].height, color=style.GREY, label="$S$ = 100, $F$ = 2"
    )
    left.set(xlabel=r"packing fraction $\phi$", ylabel="height / $d$", ylim=(0.0, 40.0), xlim=(0.0, 0.9))
    left.legend()
    right.axhspan(1.0, math.sqrt(2.0), color=style.GREY, alpha=0.25, lw=0.0)
    right.set(
        xlabel="shaking strength $S$", ylabel=r"$\omega_0\ (h / g)^{1/2}$", xlim=(0.0, 250.0), ylim=(0.5, 2.0)
    )
    right.legend()


# -- mixtures ----------------------------------------------------------------------------------------------


@cache
def _free_energy() -> tuple[Array, Array]:
    """Packing fractions, and A of equal disks there."""
    from scipy.integrate import cumulative_trapezoid

    phi = np.linspace(1e-6, 0.76, 8001)
    return phi, cumulative_trapezoid((compressibility(phi) - 1.0) / phi, phi, initial=0.0)


def chemical_potential(n: Array, diameter: Array) -> Array:
    """mu_i / T beyond that of an ideal gas, of densities n (species, heights)."""
    phi = np.minimum(0.25 * math.pi * (n * diameter**2).sum(axis=0), 0.75)
    first, second = (n * diameter).sum(axis=0), (n * diameter**2).sum(axis=0)
    A = np.interp(phi, *_free_energy())
    empty = -np.log1p(-phi)
    # F = n empty + q (A - empty), q = n xi = first^2 / second
    q = first**2 / second
    dq = 2.0 * first * diameter / second - (q / second) * diameter**2
    slope = (n.sum(axis=0) - q) / (1.0 - phi) + q * (compressibility(phi) - 1.0) / phi
    return np.asarray(empty + dq * (A - empty) + slope * 0.25 * math.pi * diameter**2)


def densities(mass: float) -> tuple[Array, Array]:
    """Heights, and densities (2, heights) of small disks and of large ones of this mass, in equilibrium."""
    width, top = ROOM
    y = np.linspace(0.0, top, 601)
    diameter, m, many = np.array([[1.0], [LARGE]]), np.array([[1.0], [mass]]), np.array(COUNTS)

    def whole(shape: Array) -> Array:
        shape = np.where(y >= 0.5 * diameter, shape, 0.0) + 1e-12
        return np.asarray(shape * (many / (width * np.trapezoid(shape, y, axis=1)))[:, None])

    n = whole(np.exp(-m * y / (6.0 * WARM)))
    for _ in range(4000):
        mu = chemical_potential(n, diameter)
        new = whole(np.exp(-m * y / WARM - mu + mu.min()))
        if np.abs(new - n).max() < 1e-6:
            return y, new
        n += 0.05 * (new - n)
    raise ValueError(f"no densities of large disks of mass {mass}: a crystal at the floor?")


def _settled(mass: float, seed: int, collisions: float) -> tuple[float, float, Array]:
    """Mean heights of small and of large disks, and histograms (2, strips) of their heights."""
    small, large = COUNTS
    radius = np.repeat((0.5, 0.5 * LARGE), COUNTS)
    disks = Disks(small + large, mass=np.repeat((1.0, mass), COUNTS), radius=radius)
    box = Box(ROOM, (True, False))
    floor = Wall.line((0.0, 0.0), (0.0, 1.0), temperature=WARM)
    # From about as much energy as they have in equilibrium: the floor alone would take long to take it.
    start = scattered(disks, Box((ROOM[0], 7.5 * WARM), (True, False)), seed, temperature=0.5 * WARM)
    gas = Simulation(disks, box, ELASTIC, start, walls=[floor], gravity=(0.0, -1.0), seed=seed)
    gas.run(collisions_per_disk=0.25 * collisions)
    states, _ = sampled_run(gas, round(0.1 * collisions), collisions_per_disk=collisions)
    y = np.array([state.position[:, 1] for state in states])
    strips = np.arange(0.0, ROOM[1] + 0.5, 1.0)
    both = (y[:, :small], y[:, small:])
    per = np.array([np.histogram(each, strips)[0] / len(y) / ROOM[0] for each in both])
    return float(both[0].mean()), float(both[1].mean()), per


def _mixtures(result: Result, quick: bool, seed: int, left: Any, right: Any) -> None:
    replicas, collisions = (10, 4000.0) if quick else (12, 6000.0)
    apart, expected = {}, {}
    for i, mass in enumerate(MASSES):
        if quick and 0 < i < 3:
            continue
        seeds = seeds_of(seed, replicas, 6300 + 50 * i)
        found = [_settled(mass, one, collisions) for one in seeds]
        y, n = densities(mass)
        theirs = (n * y).sum(axis=1) / n.sum(axis=1)
        apart[mass] = np.array([large - small for small, large, _ in found])
        expected[mass] = float(theirs[1] - theirs[0])
        if i in (0, 3):
            compare(
                result, f"height of large disks of mass {mass:g} above that of small ones [diameters]", apart[mass],
                expected[mass], disks=sum(COUNTS), seeds=seeds, systematic=1.0, widest=0.5, source=MIXED,
                why="one diameter, for layers at the floor",
            )  # fmt: skip
            for j in range(2):
                mean = np.mean([one[2][j] for one in found], axis=0)
                colour = style.COLOURS[j + 2 * (i == 3)]
                kind = f"{('small', 'large')[j]}; mass of large {mass:g}"
                style.points(right, np.arange(len(mean)) + 0.5, mean, colour, kind, marks(colour)["marker"])
                right.plot(y, n[j], **dashes(colour))
        for j in range(2):
            label, colour = None if i else ("small", "large")[j], style.COLOURS[j]
            style.errorbars(left, mass, [one[j] for one in found], colour, label, marks(colour)["marker"])
    at = np.linspace(0.75, 3.0, 10)
    curves = np.array([(n * y).sum(axis=1) / n.sum(axis=1) for y, n in (densities(float(one)) for one in at)])
    for j in range(2):
        left.plot(at, curves[:, j], **dashes(style.COLOURS[j]))
    if not quick:
        low, high = MASSES[1:3]
        values = low + (high - low) * ratio(apart[low], apart[low] - apart[high])
        crossover = low + (high - low) * expected[low] / (expected[low] - expected[high])
        compare(
            result, "mass of large disks, of diameter 2, that neither rise nor sink", values, crossover,
            disks=sum(COUNTS), seeds=seeds_of(seed, replicas, 6350), systematic=0.15, widest=0.2, source=MIXED,
            why="one diameter of height, which changes by 6 per mass",
        )  # fmt: skip
    left.set(xlabel="mass of large disks", ylabel="mean height / $d$", ylim=(0.0, 30.0))
    left.legend()
    right.set(
        xlabel="height / $d$", ylabel="number density", xlim=(0.0, 50.0), yscale="log", ylim=(1e-3, 1.0)
    )
    right.legend()
