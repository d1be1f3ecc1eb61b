r"""Elastic smooth disks at equilibrium: velocities, free paths, self-diffusion, and the pressure on hard walls.

Units: mass and diameter sigma of a disk, T = 1; n is the number density, nu the collision rate of a disk, Z the
equation of state of Kolafa and Rottner (`gas_state.compressibility`), chi = (Z - 1) / (2 phi).

*Velocities* (J. C. Maxwell, Phil. Mag. 19, 19 (1860), doi:10.1080/14786446008642818). All disks start with one speed.
x = m v^2 / (2 T) must become exponential: the test of Kolmogorov and Smirnov, and <x^2> / 2 = 1 + a_2 = N / (N + 1)
of N disks that share their energy (`sonine.sonine_coefficient`).

*Free paths* (P. Visco, F. van Wijland and E. Trizac, Phys. Rev. E 77, 041117 (2008), doi:10.1103/PhysRevE.77.041117).
A disk of speed v collides at the rate nu(v) = 2 n sigma chi <|v - v_1|>, v_1 Maxwellian,

    <|v - v_1|> ~ exp(-x/2) [(1 + x) I_0(x/2) + x I_1(x/2)],

and its flights last for an exponential time; a flight begins with the probability f(v) nu(v) / nu. So

    <l> = <v> / nu = 1 / (2 sqrt(2) n sigma chi),  <l^2> / <l>^2 = 2 <v^2 / nu(v)> nu / <v>^2 = 2.1598,
    <t^2> / <t>^2 = 2 <1 / nu(v)> nu = 2.1084,

both 2 if flights were exponential for all alike. The mean is exact at any density, the others are those of a dilute
gas: disks that have met fly apart and shade each other, which changes them by some phi.

*Self-diffusion*. Let phi_p = L_p^(1)(x) v, and b_pq = <phi_p . (phi_q - phi_q')> in a collision, phi_q' after it. With
v = V + g/2, the relative velocity along the normal g of density g exp(-g^2/2) and all else Gaussian, b_00 = 1, b_01 =
-1/4, b_11 = 43/16: D = T / (m nu) in the first order of Sonine's polynomials, the Enskog value sqrt(T / (pi m)) / (2 n
sigma chi), and 43/42 of it in the second; later ones add some 0.3 %. In two dimensions velocities remember:
their autocorrelation has a tail (B. J. Alder and T. E. Wainwright, Phys. Rev. A 1, 18 (1970),
doi:10.1103/PhysRevA.1.18), 1 / (8 pi n (D + eta / (m n)) t) of its start, with Enskog's D and viscosity
phi / (pi nu t). It makes D grow by (phi / pi) ln(nu t / s) until the time t, s being the number of collisions at which
the tail begins, between 1 and nu t. D is measured over times shorter than a sound wave needs to cross the box.

*Walls*. Two walls hold the gas in y, x is periodic. Per length of wall there are Gamma more disks than the bulk's n
times the room of the centres, n_bulk L (L - sigma) + 2 Gamma L = N. By scaled particle theory (E. Helfand, H. L.
Frisch and J. L. Lebowitz, J. Chem. Phys. 34, 1037 (1961)), inserting a disk of radius R costs (P/T) pi R^2 +
pi R n sigma / (1 - phi) + ..., so that the tension of a wall where centres end is gamma / T = -(n sigma / 2)
phi / (1 - phi)^2, and Gamma = -d gamma / d mu = n sigma phi / (1 + phi). To the lowest order in density it is exactly
8 / (3 pi) of that: the density next to a wall is n (1 + n A(z)), A the part of the excluded circle beyond the wall,
of which the integral over z is 2 sigma^3 / 3. The truth is taken to lie between. P is then that of n_bulk, with
the correction for N disks of `gas_state`. A collision gives the wall 2 m |v_y|, (2 pi m T)^(1/2) in the mean: the
pressure is that times the rate of collisions, and also the momentum that all of them hand over
(`Simulation.wall_sums`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ... import analysis
from ...model.box import Box
from ...model.state import State
from ...simulation.simulation import Simulation
from ...theory.collisions import collision_rate, mean_free_path
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import (
    CHANCE,
    ELASTIC,
    compare,
    equal_disks,
    fluid,
    ratio,
    restarted,
    sampled_run,
    scattered,
    seeds_of,
)
from .state import SOURCE as EQUATION
from .state import compressibility, log_structure

QUESTION = "Are elastic disks Maxwellian, with the free paths, diffusion and wall pressure of kinetic theory?"
REFERENCE = (
    "Maxwell, doi:10.1080/14786446008642818; Visco et al., doi:10.1103/PhysRevE.77.041117; "
    "doi:10.1080/00268970600967963"
)

MAXWELL = "Maxwell, Phil. Mag. 19, 19 (1860), doi:10.1080/14786446008642818"
VISCO = "Visco, van Wijland and Trizac (2008), doi:10.1103/PhysRevE.77.041117"
ENSKOG = "Enskog's theory; tail: Alder and Wainwright (1970), doi:10.1103/PhysRevA.1.18"

SPEEDS = (0.3, 2048)  # packing fraction, disks
APART = 10.0  # collisions per disk between looks at velocities
PATHS = (0.01, 1024, 60.0)  # and collisions per disk
DIFFUSION = (0.01, 0.05)
DIFFUSING, FIT = 2048, (6.0, 12.0)  # disks, and collisions of each over which the displacement is fitted
SONINE = 43.0 / 42.0  # D of the second order over that of the first
WALLS, HELD = (0.1, 0.3), 1024


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, axes = style.panels(2, 2)
    _speeds(result, quick, seed, axes[0])
    _paths(result, quick, seed, axes[1])
    if quick:
        for one in axes[2:]:
            one.set_axis_off()
    else:
        _diffusion(result, seed, axes[2])
        _walls(result, seed, axes[3])
    style.titles(*axes)
    caption = (
        f"Elastic disks at equilibrium. (a) Energies of disks that began with one speed, over Maxwell's. (b) Free "
        f"paths, phi = {PATHS[0]}, and an exponential. (c) Mean-square displacement over 4 D t, D by Enskog's theory. "
        "(d) Pressure on walls over that of the bulk, with and without the layer at the walls."
    )
    result.pictures.append(Picture("gas_equilibrium", caption, figure))
    return result


def _chi(phi: float) -> float:
    """Contact value of g(r)."""
    return float((compressibility(phi) - 1.0) / (2.0 * phi))


# -- velocities --------------------------------------------------------------------------------------------


def energies(seed: int, looks: int) -> Array:
    """x = m v^2 / 2 T of a gas that began with one speed, shape (looks, n)."""
    phi, n = SPEEDS
    begin = fluid(n, phi, seed, melting=1.0)
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, n)
    velocity = math.sqrt(2.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start = State(begin.state.position, velocity - velocity.mean(axis=0), np.zeros(n))
    gas = Simulation(begin.disks, begin.box, ELASTIC, start)
    found = []
    for look in range(3, looks + 3):
        # By time: at the moment of a collision its pair has more energy than others.
        gas.run(t_end=look * APART / collision_rate(phi, 1.0, 1.0, 0.5))
        square = np.sum(gas.state.velocity**2, axis=1)
        found.append(square / square.mean())
    return np.array(found)


def _speeds(result: Result, quick: bool, seed: int, axes: Any) -> None:
    from scipy.special import kolmogi, kolmogorov

    (phi, n), replicas, looks = SPEEDS, 24, 3 if quick else 8
    seeds = seeds_of(seed, replicas, 4000)
    x = np.array([energies(one, looks) for one in seeds])
    every = np.sort(x.ravel())
    step = np.arange(len(every) + 1) / len(every)
    right = -np.expm1(-every)
    apart = float(max(np.max(step[1:] - right), np.max(right - step[:-1])))
    result.near(
        f"largest difference of distributions of m v^2 / 2 T, {len(every)} energies, phi = {phi} (probability of more: "
        f"{kolmogorov(apart * math.sqrt(len(every))):.2g})", apart, 0.0, float(kolmogi(CHANCE)) / math.sqrt(len(every)),
        "Kolmogorov's statistic, which chance alone exceeds as rarely as a Gaussian 4 errors", MAXWELL,
    )  # fmt: skip
    compare(
        result, f"<(m v^2 / 2 T)^2> / 2 = 1 + a_2, phi = {phi}", 0.5 * np.mean(x**2, axis=(1, 2)), n / (n + 1.0),
        disks=n, seeds=seeds, systematic=1.0 / n, why="1/N: the total momentum is kept too", widest=0.02,
        source=MAXWELL,
    )  # fmt: skip
    edges = np.linspace(0.0, 8.0, 33)
    counts = np.histogram(every, edges)[0]
    expected = len(every) * -np.diff(np.exp(-edges))
    axes.errorbar(0.5 * (edges[1:] + edges[:-1]), counts / expected, np.sqrt(expected) / expected, fmt="o", mfc="none",
                  color=style.BLUE, ms=3.5, lw=0.9, label="simulated")  # fmt: skip
    axes.axhline(1.0, color=style.BLACK, label="Maxwell")
    axes.set(xlabel=r"$m v^2 / 2T$", ylabel="density / Maxwell's", ylim=(0.8, 1.2))
    axes.legend(loc="lower left")


# -- free paths --------------------------------------------------------------------------------------------


def flights() -> tuple[float, float]:
    """<l^2> / <l>^2 and <t^2> / <t>^2 of a dilute gas."""
    from scipy.integrate import quad
    from scipy.special import ive

    def mean(power: float, inverse: float) -> float:
        """<v^power nu(v)^inverse> in units that cancel; x = m v^2 / 2 T."""

        def term(x: float) -> float:
            rate = (1.0 + x) * ive(0, 0.5 * x) + x * ive(1, 0.5 * x)
            return float(x ** (0.5 * power) * rate**inverse * math.exp(-x))

        return float(quad(term, 0.0, 60.0, epsabs=1e-10, epsrel=1e-10, limit=200)[0])

    nu = mean(0.0, 1.0)
    return 2.0 * mean(2.0, -1.0) * nu / mean(1.0, 0.0) ** 2, 2.0 * mean(0.0, -1.0) * nu


def _flown(seed: int, collisions: float) -> tuple[Array, Array]:
    """Lengths and times of whole flights between collisions."""
    phi, n, _ = PATHS
    gas = fluid(n, phi, seed, melting=5.0, histories=range(n))
    gas.run(collisions_per_disk=collisions)
    events = gas.take_events()
    order = np.lexsort((events.time, events.id))
    who, when = events.id[order], events.time[order]
    speed = np.hypot(*events.velocity_before[order].T)
    same = who[1:] == who[:-1]
    lasted = np.diff(when)[same]
    # Flights that begin early only: near the end long ones would be missing. 15 mean times are 1e-5 of them.
    early = when[:-1][same] < gas.time * (1.0 - 15.0 / collisions)
    return (lasted * speed[1:][same])[early], lasted[early]


def _paths(result: Result, quick: bool, seed: int, axes: Any) -> None:
    phi, n, collisions = PATHS
    replicas, collisions = (18, 45.0) if quick else (24, collisions)
    seeds = seeds_of(seed, replicas, 4100)
    found = [_flown(one, collisions) for one in seeds]
    length, time = ([each[i] for each in found] for i in (0, 1))
    chi = _chi(phi)
    exact = math.pi / (8.0 * math.sqrt(2.0) * phi * chi)  # n = 4 phi / pi
    options: dict[str, Any] = {"disks": n, "seeds": seeds, "source": VISCO}
    compare(
        result, f"mean free path [diameters], phi = {phi}", [one.mean() for one in length], exact,
        systematic=0.001 * exact, why="0.1 %: 1/N, and flights that the end cuts off", widest=0.015, **options,
    )  # fmt: skip
    for name, each, right in zip(("l", "t"), (length, time), flights(), strict=True):
        compare(
            result, f"<{name}^2> / <{name}>^2 of free {'paths' if name == 'l' else 'times'}, phi = {phi}",
            ratio([np.mean(one**2) for one in each], [np.mean(one) ** 2 for one in each]), right,
            systematic=phi * right, why="phi of it: disks that have just met do not meet each other next, in a gas "
            "that is not dilute", widest=0.035, **options,
        )  # fmt: skip
    every = np.concatenate(length) / mean_free_path(phi, 0.5)
    edges = np.linspace(0.0, 8.0, 41)
    middle = 0.5 * (edges[1:] + edges[:-1])
    style.points(
        axes, middle, np.histogram(every, edges)[0] / (len(every) * np.diff(edges)), style.BLUE, "simulated"
    )
    axes.plot(edges, np.exp(-edges), color=style.BLACK, label="exponential")
    axes.set(yscale="log", xlabel="free path / mean free path", ylabel="density")
    axes.legend()


# -- self-diffusion ----------------------------------------------------------------------------------------


def enskog(phi: float) -> float:
    """Coefficient of self-diffusion by Enskog's theory, to the second order in Sonine's polynomials."""
    density = 4.0 * phi / math.pi
    return SONINE / (2.0 * math.sqrt(math.pi) * density * _chi(phi))


def _displaced(phi: float, seed: int, spans: int) -> tuple[float, Array, Array]:
    """D by the slope of the displacement over `FIT`, and lags [collisions per disk] and displacements."""
    gas = fluid(DIFFUSING, phi, seed, melting=5.0)
    mean_time = 1.0 / collision_rate(phi, 1.0, 1.0, 0.5, g=_chi(phi))
    states, _ = sampled_run(gas, round(2 * spans * FIT[1]), t_end=spans * FIT[1] * mean_time)
    path = analysis.unwrap(np.array([state.position for state in states]), gas.box)
    times = [state.time for state in states]
    found = analysis.mean_square_displacement(times, path, most_lags=round(2 * FIT[1]) + 1)
    fit = analysis.diffusion_coefficient(found, first=FIT[0] * mean_time, last=(FIT[1] + 0.1) * mean_time)
    return fit.D, found.lag / mean_time, found.value


def _diffusion(result: Result, seed: int, axes: Any) -> None:
    replicas, spans = 24, 6
    for i, phi in enumerate(DIFFUSION):
        seeds = seeds_of(seed, replicas, 4200 + 40 * i)
        found = [_displaced(phi, one, spans) for one in seeds]
        tail = phi / math.pi * math.log(0.5 * sum(FIT))  # if it began with the first collision
        T = DIFFUSING / (DIFFUSING - 1.0)
        expected = enskog(phi) * math.sqrt(T) * (1.0 + 0.5 * tail)
        compare(
            result, f"D [sigma (T/m)^(1/2)] over {FIT[0]:g} to {FIT[1]:g} collisions per disk, phi = {phi}",
            [one[0] for one in found], expected, disks=DIFFUSING, seeds=seeds,
            systematic=(0.5 * tail + 0.004) * expected, widest=0.05,
            why=f"{100.0 * tail:.1f} %, none or all of the tail; 0.4 % for polynomials of higher order", source=ENSKOG,
        )  # fmt: skip
        lag = found[0][1][1:]
        mean = np.mean([one[2] for one in found], axis=0)[1:]
        time = lag / collision_rate(phi, 1.0, 1.0, 0.5, g=_chi(phi))
        style.points(
            axes, lag, mean / (4.0 * enskog(phi) * time), style.COLOURS[i], rf"$\phi$ = {phi}", "os"[i]
        )
    at = np.linspace(0.5, FIT[1], 100)
    axes.plot(at, 1.0 - -np.expm1(-at) / at, color=style.BLACK, label="exponential memory")
    axes.set(xlabel="collisions per disk", ylabel=r"$\langle r^2 \rangle / 4 D t$", ylim=(0.0, 1.2))
    axes.legend(loc="lower right")


# -- walls -------------------------------------------------------------------------------------------------


def bulk_density(n: int, side: float, layer: float) -> float:
    """Density of the bulk between two walls [1/sigma^2]; `layer` is Gamma over that of scaled particle theory."""
    density = n / (side * (side - 1.0))
    for _ in range(100):
        phi = 0.25 * math.pi * density
        density = n / (side * (side - 1.0) + 2.0 * side * layer * phi / (1.0 + phi))
    return density


def wall_pressure(n: int, side: float, layer: float) -> float:
    """P / T of n disks between two walls [1/sigma^2]."""
    density = bulk_density(n, side, layer)
    phi = 0.25 * math.pi * density
    return density * (float(compressibility(phi)) + log_structure(phi) / (2.0 * n))


def _pushed(phi: float, seed: int, long: float) -> tuple[float, float, float]:
    """Momentum that a wall takes in a collision over its mean; P / T by the number of these, and by all momentum."""
    n = HELD
    side = math.sqrt(0.25 * math.pi * n / phi)
    disks, box = equal_disks(n), Box((side, side), (True, False))
    gas = Simulation(disks, box, ELASTIC, scattered(disks, box, seed, temperature=1.0))
    gas.run(collisions_per_disk=20.0)
    T = 0.5 * float(np.sum(gas.state.velocity**2)) / (n - 0.5)  # the momentum along the walls is kept
    gas = restarted(gas, record=["wall_sums"])
    gas.run(collisions_per_disk=long)
    mean, sums = math.sqrt(2.0 * math.pi * T), gas.wall_sums
    given = float(np.abs(sums.momentum[:, 1]).sum())  # lower and upper wall
    both = 2.0 * side * gas.time * T
    return given / float(sums.hits.sum()) / mean, mean * gas.wall_collisions / both, given / both


def _walls(result: Result, seed: int, axes: Any) -> None:
    long, replicas = 1600.0, 24
    each = []
    for i, phi in enumerate(WALLS):
        seeds = seeds_of(seed, replicas, 4300 + 40 * i)
        side = math.sqrt(0.25 * math.pi * HELD / phi)
        ends = [wall_pressure(HELD, side, layer) for layer in (8.0 / (3.0 * math.pi), 1.0)]
        expected = 0.5 * (ends[0] + ends[1])
        taken, found, pushed = np.array([_pushed(phi, one, long) for one in seeds]).T
        each.append(taken)
        compare(
            result, f"pressure on walls P sigma^2 / T by the rate of their collisions, {HELD} disks, phi = {phi}",
            found, expected, disks=HELD, seeds=seeds, systematic=0.5 * abs(ends[0] - ends[1]) + 5e-4 * expected,
            widest=0.012, source=EQUATION,
            why="the layer at walls, 8/(3 pi) to 1 of that of scaled particle theory, and 5e-4 of Z",
        )  # fmt: skip
        compare(
            result, f"pressure on walls P sigma^2 / T by the momentum that they take, {HELD} disks, phi = {phi}",
            pushed, expected, disks=HELD, seeds=seeds, systematic=0.5 * abs(ends[0] - ends[1]) + 5e-4 * expected,
            widest=0.02, source=EQUATION, why="the same",
        )  # fmt: skip
        bare = HELD / side**2 * float(compressibility(phi))
        style.errorbars(axes, phi, found / bare, style.BLUE, "simulated" if i == 0 else None)
        room = HELD / (side * (side - 1.0))
        without = room * float(compressibility(0.25 * math.pi * room))
        axes.plot(phi, expected / bare, "_", color=style.BLACK, ms=12, label="expected" if i == 0 else None)
        axes.plot(
            phi, without / bare, "x", color=style.GREY, label="without the layer at walls" if i == 0 else None
        )
    compare(
        result, "momentum that a wall takes in a collision over (2 pi m T)^(1/2)", np.concatenate(each), 1.0,
        disks=HELD, seeds=range(min(seeds_of(seed, 1, 4300)), seeds[-1] + 1), systematic=1.0 / HELD, widest=0.03,
        source=MAXWELL, why="1/N: the energy is kept",
    )  # fmt: skip
    axes.axhline(1.0, color=style.GREY, lw=0.6)
    axes.set(xlabel=r"packing fraction $\phi$", ylabel=r"$P / n T Z(\phi)$, $n = N / L^2$", xlim=(0.0, 0.4))
    axes.legend(loc="upper left")
