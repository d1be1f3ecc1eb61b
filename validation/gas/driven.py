r"""Steady states: coins that kicks heat, disks that a flow heats, and a column under gravity.

*Kicks.* Power per disk equals what collisions take: by `driven_gas` of a Gaussian gas, by DSMC of what distribution
there is. Of smooth disks it is known how much more a gas that is not Gaussian takes: 1 + (3/16) a_2 times as much, so
that T, whose power 3/2 the loss goes with, is less by 2/3 of that; a_2 = -0.020 at e_n = 0.9, and its next orders a
tenth of it. Rough coins are compared with DSMC only, because that number is not known. Kicks feed waves too: see
`waves.driven_streams`. Kicks at random times are compared where they differ from white noise: each gives half of T
on average, five collisions of a disk apart. They move a_2 from -0.020 to 0.045 (`theory.heated_sonine`), and T by
-0.8 %.

*Flow.* Lees and Edwards' sides, against `sheared_gas`: velocities that are Gaussian but not isotropic. That they are
not quite Gaussian is worth up to 3 % of T at e_n = 0.8, phi = 0.1 and below, by Monte Carlo of Enskog's equation.

*Gravity.* dP/dy = -m g rho with the local pressure P = rho T Z(phi), Z of Kolafa and Rottner (`gas_state`): the
barometric law with its correction for finite density. Between an elastic floor and ceiling the energy is kept, not
T: a column of N disks with the mean energy of one at T has that T but for 1 / N. At the floor disks lie in layers,
which a local pressure does not know: what stands above the first two strips is compared, with itself.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ... import theory
from ...initial import placement
from ...model.box import Box
from ...model.forces import PoissonKicks, RandomKicks
from ...model.laws.coin_table import coins
from ...model.laws.ifr import IFRLaw
from ...model.state import State
from ...simulation.dsmc import DSMC
from ...simulation.simulation import Simulation
from ...theory import driven_gas, sheared_gas
from ...theory.driven_gas import Driving
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import state as gas_state
from .sample import ELASTIC, Mean, compare, equal_disks, fluid, sampled_run, scattered, seeds_of, thermal
from .waves import driven_streams

QUESTION = "Do driven, sheared and falling gases settle where kinetic theory and hydrostatics say?"
REFERENCE = "ifrdem/theory/driven_gas.py; sheared_gas.py; hydrostatics"

SHEARED = (
    "sheared_gas.py: anisotropic Gaussians, as J. T. Jenkins, M. W. Richman, J. Fluid Mech. 192, 313 (1988)"
)
DRIVEN = "power = loss, with a_2 of van Noije and Ernst, Granul. Matter 1, 57 (1998)"
COLUMN = "hydrostatics with Z of Kolafa and Rottner (2006), doi:10.1080/00268970600967963"


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, (left, middle, right) = style.panels(3, width=3.3)
    _kicked(result, quick, seed, left)
    _sheared(result, quick, seed, middle)
    _column(result, quick, seed, right)
    style.titles(left, middle, right)
    caption = (
        "Steady states. (a) Temperatures of coins (1 pta) and of smooth disks that random kicks heat, over theory: "
        "of coins that of Gaussian velocities; waves, which DSMC does "
        "not have, hold 2 % of T at packing fraction 0.1. (b) Temperature of sheared smooth "
        "disks over theory. (c) Density of a column of elastic disks under gravity, and hydrostatics "
        "with and without the correction for finite density (barometric law)."
    )
    result.pictures.append(Picture("gas_driven", caption, figure))
    return result


def _means(gas: Simulation, span: float, frames: int) -> tuple[float, float]:
    """T and T_rot over the next `span` collisions per disk."""
    begin = 2.0 * gas.collisions / gas.disks.n
    _, rows = sampled_run(gas, frames, collisions_per_disk=begin + span)
    T, T_rot = ([getattr(one, name) for one in rows] for name in ("temperature", "rotational_temperature"))
    return float(np.mean(T)), float(np.mean(T_rot))


def _kicked(result: Result, quick: bool, seed: int, axes: Any) -> None:
    n, replicas = 400, 12 if quick else 24
    law = coins["1 pta"].law
    driving = Driving(power=1.0)
    _kicked_smooth(result, quick, seed, driving, axes)
    _kicked_at_random(result, quick, seed)
    steady = {
        phi: driven_gas.steady_state(law, 1.0, 0.5, 2.0, phi, driving) or (math.nan, math.nan)
        for phi in (0.02, 0.1)
    }
    others = seeds_of(seed, 8, 5100)
    many = 2_500 if quick else 10_000
    first = np.array([_by_dsmc(law, 0.02, many, one, *steady[0.02]) for one in others])
    for i, (phi, right) in enumerate(steady.items()):
        if quick and i == 1:
            continue
        seeds = seeds_of(seed, replicas, 5000 + 50 * i)
        T, T_rot = right
        values = np.array([_heated(law, phi, n, one, T, T_rot) for one in seeds])
        # The density sets the unit of time only: power over (power of T) is the same for all.
        dsmc = first * (T / steady[0.02][0])
        share, off = driven_streams(law, phi, n, T_rot / T)
        for j, name in enumerate(("T", "T_rot")):
            factor = 1.0 + share if name == "T" else 1.0
            mean = Mean.of(dsmc[:, j]).times(factor)
            compare(
                result, f"{name} of coins (1 pta) heated by kicks, phi = {phi}, against DSMC", values[:, j], mean,
                disks=n, seeds=seeds, systematic=off * mean.value, widest=0.06, source="DSMC of the same law",
                why="what waves hold that are too short for hydrodynamics",
            )  # fmt: skip
            for shift, what, marker in ((-0.002, values, "os"[j]), (0.002, dsmc, "x+"[j])):
                symbol = (r"$T$", r"$T_\mathrm{rot}$")[j]
                label = None if i else symbol if what is values else f"{symbol}, DSMC"
                style.errorbars(axes, phi + shift, what[:, j] / right[j], style.COLOURS[j], label, marker)
    axes.axhline(1.0, color=style.BLACK)
    axes.set(
        xlabel=r"packing fraction $\phi$", ylabel="simulated / theory", ylim=(0.9, 1.1), xlim=(0.0, 0.15)
    )
    axes.legend()


def _kicked_smooth(result: Result, quick: bool, seed: int, driving: Driving, axes: Any) -> None:
    """Smooth disks in a dilute gas, in which waves hold little."""
    n, phi, e_n, replicas = 1600, 0.005, 0.9, 16 if quick else 40
    law = IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)
    gaussian, _ = driven_gas.steady_state(law, 1.0, 0.5, 2.0, phi, driving) or (math.nan, math.nan)
    a_2 = theory.heated_sonine(e_n)
    right = gaussian * float(theory.cooling_factor(a_2)) ** (-2.0 / 3.0)
    share, off = driven_streams(law, phi, n, 0.0)
    seeds = seeds_of(seed, replicas, 8000)
    found = np.array([_heated(law, phi, n, one, right, 0.0)[0] for one in seeds])
    compare(
        result, f"T of smooth disks heated by kicks, e_n = {e_n}, phi = {phi}, against theory", found,
        right * (1.0 + share), disks=n, seeds=seeds, systematic=(off + abs(a_2) / 80.0) * right, widest=0.05,
        source=DRIVEN, why="short waves, and a tenth of a_2",
    )  # fmt: skip
    style.errorbars(axes, phi, found / right, style.BLACK, "$T$, smooth", "^")


def _kicked_at_random(result: Result, quick: bool, seed: int) -> None:
    """Smooth disks in a dilute gas with kicks at random times, T and a_2."""
    n, phi, e_n, replicas, energy = 1600, 0.005, 0.9, 16 if quick else 40, 0.5
    law = IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)
    gaussian, _ = driven_gas.steady_state(law, 1.0, 0.5, 2.0, phi, Driving(power=1.0)) or (math.nan, math.nan)
    a_2, of_noise = theory.heated_sonine(e_n, energy), theory.heated_sonine(e_n)
    right = gaussian * float(theory.cooling_factor(a_2)) ** (-2.0 / 3.0)
    share, off = driven_streams(law, phi, n, 0.0)
    seeds = seeds_of(seed, replicas, 8200)
    rows = []
    for one in seeds:
        kicks = PoissonKicks(1.0 / (energy * right), power=1.0)
        gas = fluid(n, phi, one, law, melting=5.0, T=right, T_rot=0.0, forces=[kicks])
        gas.run(collisions_per_disk=20.0)
        states, measures = sampled_run(gas, 50, collisions_per_disk=70.0)
        velocities = [state.velocity - state.velocity.mean(axis=0) for state in states]
        # Of n Gaussian velocities 1 + a_2 is n / (n + 1) on average.
        rows.append([
            np.mean([each.temperature for each in measures]),
            np.mean([(1.0 + theory.sonine_coefficient(v)) * (n + 1) / n - 1.0 for v in velocities]),
        ])  # fmt: skip
    found = np.array(rows)
    gas_of = f"of smooth disks kicked at random times, e_n = {e_n}, phi = {phi}, a kick of T / 2"
    compare(
        result, f"T {gas_of}", found[:, 0], right * (1.0 + share), disks=n, seeds=seeds,
        systematic=(off + abs(a_2) / 80.0) * right, widest=0.05, source=DRIVEN, why="short waves, and a tenth of a_2",
    )  # fmt: skip
    compare(
        result, f"a_2 {gas_of}", found[:, 1], a_2, disks=n, seeds=seeds, systematic=0.1 * (a_2 - of_noise),
        widest=0.4, source="fourth moments of collisions and kicks: theory/sonine.py",
        why="a tenth of what the kicks change: higher orders",
    )  # fmt: skip


def _heated(law: IFRLaw, phi: float, n: int, seed: int, T: float, T_rot: float) -> tuple[float, float]:
    """T and T_rot of a kicked gas, 20 to 70 collisions per disk from a start near its steady state."""
    # Two kicks or more between collisions.
    kicks = RandomKicks(0.25 / theory.collision_rate(phi, T, 1.0, 0.5), power=1.0)
    gas = fluid(n, phi, seed, law, melting=5.0, T=T, T_rot=T_rot, forces=[kicks])
    gas.run(collisions_per_disk=20.0)
    return _means(gas, 50.0, 50)


def _by_dsmc(law: IFRLaw, phi: float, n: int, seed: int, T: float, T_rot: float) -> tuple[float, float]:
    """T and T_rot of the same gas by DSMC."""
    disks, velocity, spin = thermal(n, seed, T=T, T_rot=T_rot)
    gas = DSMC(disks, law, phi, velocity, spin, seed=seed, driving=Driving(power=1.0))
    gas.run(collisions_per_disk=10.0, samples=1)
    found = gas.run(collisions_per_disk=30.0, samples=20)
    return float(found.temperature.mean()), float(found.rotational_temperature.mean())


def _sheared(result: Result, quick: bool, seed: int, axes: Any) -> None:
    n, replicas, rate, phi = 400, 24, 0.5, 0.05
    for i, e_n in enumerate(() if quick else (0.95, 0.9, 0.8)):
        seeds = seeds_of(seed, replicas, 5200 + 50 * i)
        law = IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)
        T, _ = sheared_gas.steady_state(law, 1.0, 0.5, 2.0, phi, rate) or (math.nan, math.nan)
        found = []
        for one in seeds:
            disks = equal_disks(n)
            box = Box.from_packing_fraction(disks.radius, phi, shear_rate=rate)
            strip = Box((box.lengths[0], box.lengths[1] - 1.0))  # free at the seam
            start = scattered(disks, strip, one, temperature=T)
            velocity = start.velocity + box.flow(start.position)
            gas = Simulation(disks, box, law, State(start.position, velocity, start.spin))
            gas.run(collisions_per_disk=25.0)
            found.append(_means(gas, 75.0, 75)[0])
        part = 0.15 * (1.0 - e_n)
        compare(
            result, f"T of sheared smooth disks, e_n = {e_n}, phi = {phi}, shear rate {rate}", found, T, disks=n,
            seeds=seeds, systematic=part * T, widest=0.12, source=SHEARED,
            why="0.15 (1 - e_n): velocities are not quite Gaussian, 3 % of T at e_n = 0.8",
        )  # fmt: skip
        style.errorbars(axes, e_n, np.array(found) / T, style.BLUE)
        axes.fill_between([e_n - 0.01, e_n + 0.01], 1.0 - part, 1.0 + part, color=style.GREY, alpha=0.25, lw=0.0,
                          label="not Gaussian" if e_n == 0.9 else None)  # fmt: skip
    axes.axhline(1.0, color=style.BLACK)
    axes.set(xlabel=r"normal restitution $e_n$", ylabel=r"$T$, simulated / theory", ylim=(0.85, 1.15))
    if quick:
        axes.text(0.5, 0.6, "left out by --quick", transform=axes.transAxes, ha="center")
    else:
        axes.legend()


# Mass and diameter 1. A scale height T / (m g) = 20 diameters; phi is 0.17 at the floor.
COUNT, WIDTH, HEIGHT, GRAVITY = 400, 100.0, 240.0, 0.05
STRIPS = 12
FLOOR = 2  # strips at the floor, where disks lie in layers


def below(T: float) -> tuple[Array, Array]:
    """Heights, and the part of the disks' centres below each, by hydrostatics: d(P)/dy = -g rho."""
    from scipy.integrate import cumulative_trapezoid, solve_ivp
    from scipy.optimize import brentq

    y = np.linspace(0.5, HEIGHT - 0.5, 2001)

    def slope(_: float, log_rho: Array) -> Array:
        phi = math.pi / 4.0 * np.exp(log_rho)
        step = 1e-5 * phi
        # T d(rho Z)/d rho, rho Z being proportional to phi Z
        stiff = (
            (phi + step) * gas_state.compressibility(phi + step)
            - (phi - step) * gas_state.compressibility(phi - step)
        ) / (2.0 * step)
        return np.asarray(-GRAVITY / (T * stiff))

    def density(log_floor: float) -> Array:
        return np.exp(solve_ivp(slope, (y[0], y[-1]), [log_floor], t_eval=y, rtol=1e-9, atol=1e-11).y[0])

    def missing(log_floor: float) -> float:
        return float(WIDTH * np.trapezoid(density(log_floor), y)) - COUNT

    rho = density(float(brentq(missing, math.log(0.02), math.log(0.6), xtol=1e-10)))
    return y, cumulative_trapezoid(WIDTH * rho, y, initial=0.0) / COUNT


def _column(result: Result, quick: bool, seed: int, axes: Any) -> None:
    replicas, frames = (12, 40) if quick else (16, 200)
    seeds = seeds_of(seed, replicas, 5400)
    T = 1.0
    y, part = below(T)
    mean_height = float(y[-1] - np.trapezoid(part, y))
    edges = np.interp(np.linspace(0.0, 1.0, STRIPS + 1), part, y)
    edges[0], edges[-1] = 0.0, HEIGHT
    found = [_fallen(one, T, mean_height, edges, frames) for one in seeds]
    shares = np.array([share for share, _ in found])
    above = shares[:, FLOOR:]
    above = above / above.sum(axis=1)[:, None]
    whole = STRIPS - FLOOR
    why = "1 %: T differs by 1 / N; more at the floor leaves less above"
    for i in (0, whole - 2, whole - 1):  # gravity changes those between little
        low, high = edges[FLOOR + i], edges[FLOOR + i + 1]
        compare(
            result, f"of a column's disks above {edges[FLOOR]:.1f} diameters, part between {low:.1f} and {high:.1f}",
            above[:, i], 1.0 / whole, disks=COUNT, seeds=seeds, systematic=0.01 / whole, widest=0.1, why=why,
            source=COLUMN,
        )  # fmt: skip
    heights = [height for _, height in found]
    compare(
        result, "mean height of a column of disks [diameters]", heights, mean_height, disks=COUNT, seeds=seeds,
        systematic=0.005 * mean_height, widest=0.015, source=COLUMN,
        why="0.5 %: T differs by 1 / N; layers at the floor",
    )  # fmt: skip
    middle = 0.5 * (edges[1:] + edges[:-1])[:-1]
    rho = shares * COUNT / WIDTH / np.diff(np.maximum(edges, 0.5))  # centres stay above 1/2
    axes.plot(
        np.gradient(part, y) * COUNT / WIDTH * math.pi / 4.0, y, color=style.BLACK, label="hydrostatics"
    )
    ideal = COUNT / WIDTH * GRAVITY / T * np.exp(-(y - 0.5) * GRAVITY / T) * math.pi / 4.0
    axes.plot(ideal, y, "--", color=style.GREEN, label="barometric law")
    axes.errorbar(
        (rho.mean(axis=0) * math.pi / 4.0)[:-1], middle,
        xerr=(rho.std(axis=0, ddof=1) / math.sqrt(replicas) * math.pi / 4.0)[:-1], fmt="o", mfc="none",
        color=style.BLUE, label="simulated",
    )  # fmt: skip
    axes.set(
        xlabel=r"packing fraction $\phi$",
        ylabel="height (diameters)",
        ylim=(0.0, 110.0),
        xticks=(0.0, 0.05, 0.1, 0.15),
    )
    axes.legend()


def _fallen(seed: int, T: float, mean_height: float, edges: Array, frames: int) -> tuple[Array, float]:
    """Parts of the disks in each strip, and their mean height, over frames a few crossing times apart."""
    disks = equal_disks(COUNT)
    i = np.arange(COUNT)
    position = np.column_stack(((i % 25 + 0.5) * WIDTH / 25, 2.0 + 4.0 * (i // 25)))
    velocity = placement.maxwellian(disks.mass, temperature=T, seed=seed)
    velocity *= math.sqrt(1.0 + GRAVITY * (mean_height - position[:, 1].mean()) / T)
    gas = Simulation(
        disks, Box((WIDTH, HEIGHT), (True, False)), ELASTIC, State(position, velocity, np.zeros(COUNT)),
        gravity=(0.0, -GRAVITY),
    )  # fmt: skip
    every = 2.0 * math.sqrt(T) / GRAVITY
    gas.run(t_end=8.0 * every)
    states, _ = sampled_run(gas, frames, t_end=(8.0 + frames) * every)
    heights = np.array([state.position[:, 1] for state in states])
    counts = np.histogram(heights, edges)[0]
    return counts / counts.sum(), float(heights.mean(axis=1).mean())
