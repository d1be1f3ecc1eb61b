r"""Pressure tensor of a gas: equation of state, viscous heating, simple shear, pressure on walls.

The tensor is that of `observables.stress`, P_ab A = sum m V_a V_b + (1/dt) sum (dp_i)_a (r_i - r_j)_b. Units: mass and
diameter sigma of a disk.

*Equation of state*. Elastic disks: Z = 1 + (P_c / P_k) (N - 1) / N, the collisional over the kinetic part of the
pressure, because the temperature of N disks at rest as a whole is E / (N - 1). Expected: Z_N of `gas_state` by Kolafa
and Rottner; at phi = 0.69, next to freezing, where no correction for N disks is known, the Monte Carlo of Li et al.

*Viscous heating*. In the frame of a flow u_x = g y free flight changes m V_x^2 / 2 by -g m V_x V_y a unit of time, a
collision at heights y_i and y_j by -g (dp_i)_x (y_i - y_j) beyond what it dissipates:

    d(E + dissipated)/dt = -g P_xy A,

to rounding, with the integral of m V_x V_y from its value after each collision, as V_x falls by g V_y t in flight.

*Spins*. A collision without a rolling torque keeps the angular momentum of the pair: d(sum I w) = sum of
(dp_i)_x (y_i - y_j) - (dp_i)_y (x_i - x_j). So the spins turn by (P_xy - P_yx) A dt, to rounding.

*Simple shear*. Expected: Enskog's equation for a uniform flow, solved by Monte Carlo (`enskog`). It has no correlations
between velocities of disks that are going to collide.

*Walls*. d(sum m v_x x)/dt = sum m v_x^2 + sum of impulses times x: P_xx less the change of sum m v_x x / (A t) is the
mean force on a length of the wall at x = L, but for the sampling of the kinetic part.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...model.box import Box
from ...model.laws.coin_table import coins
from ...model.laws.ifr import IFRLaw
from ...model.observables import Measure, Stress, stress
from ...model.state import Disks, State
from ...model.walls.wall import Wall
from ...simulation.simulation import Simulation
from ...simulation.steps.schedule import Trigger
from ...theory.sheared_gas import steady_state
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from . import enskog
from .sample import ELASTIC, LOOSE, Mean, compare, equal_disks, fluid, restarted, scattered, seeds_of, thermal
from .state import LI, SOURCE, compressibility, of_few

QUESTION = (
    "Is the pressure tensor that of the equation of state, of viscous heating, of sheared gases and of walls?"
)
REFERENCE = (
    "Kolafa and Rottner (2006), doi:10.1080/00268970600967963; Li et al. (2022), doi:10.1063/5.0126437; energy and "
    "angular momentum; Monte Carlo of Enskog's equation"
)

PHI, N, REPLICAS = (0.1, 0.3, 0.5, 0.6, 0.65), 1024, 8
QUICK_PHI = 0.3
LAWS = {"smooth, e_n = 0.9": IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0), "aluminium coins": coins["1 pta"].law}
SHEARED = (0.1, 0.3)
SHEARED_N = 500
ENSKOG = "Enskog's equation by Monte Carlo, as Montanero and Santos (1996), doi:10.1103/PhysRevE.54.438"
CORRELATIONS = "2 %: correlations of velocities, waves in the box, steps of the Monte Carlo"
ROUNDING = 1e-10
COMPONENTS = {"xx": (0, 0), "yy": (1, 1), "xy": (0, 1), "yx": (1, 0)}


def run(quick: bool, seed: int) -> Result:
    result = Result()
    figure, (left, right) = style.panels(2)
    _equation_of_state(result, quick, seed, left)
    _balances(result, seed)
    _simple_shear(result, quick, seed, right)
    _walls(result, quick, seed)
    style.titles(left, right)
    caption = (
        "(a) Compressibility of elastic disks from the pressure tensor, and the equation of state of Kolafa and "
        f"Rottner. (b) Pressure tensor of sheared gases, phi = {SHEARED[0]}, over n T: simulated, and by the "
        "Monte Carlo of Enskog's equation (lines)."
    )
    result.pictures.append(Picture("gas_stress", caption, figure))
    return result


def mean_of(rows: Sequence[Measure], area: float) -> Stress:
    """Mean pressure tensor over the rows of a run, at even times."""
    kinetic = np.mean([stress(a, b, area).kinetic for a, b in itertools.pairwise(rows)], axis=0)
    return Stress(kinetic, stress(rows[0], rows[-1], area).collisional)


def observed(gas: Simulation, number: int, **end: Any) -> list[Measure]:
    """Measures at the start of a run, and at so many even steps to its end."""
    rows: list[Measure] = []
    gas.run(series=number, series_callbacks=[rows.append], progress=False, **end)
    return rows


# -- equation of state -------------------------------------------------------------------------------------


def _compressibility(phi: float, n: int, seed: int) -> tuple[float, float]:
    """Z, and P_xx over the pressure, of one gas."""
    melting, per_disk = (10.0, 150.0) if phi <= LOOSE else (100.0, 300.0)
    if phi > 0.66:
        melting, per_disk = 1000.0, 4000.0
    gas = restarted(fluid(n, phi, seed, melting=melting), record=["stress"])
    rows = observed(gas, 100, collisions_per_disk=per_disk)
    found = mean_of(rows, gas.box.area)
    parts = [0.5 * float(np.trace(one)) for one in (found.kinetic, found.collisional)]
    return 1.0 + parts[1] / parts[0] * (n - 1.0) / n, float(found.total[0, 0]) / found.pressure


def _equation_of_state(result: Result, quick: bool, seed: int, axes: Any) -> None:
    at = np.linspace(0.02, 0.7, 200)
    axes.plot(at, compressibility(at), color=style.BLACK, label="Kolafa and Rottner")
    for i, phi in enumerate((QUICK_PHI,) if quick else PHI):
        seeds = seeds_of(seed, REPLICAS, 8000 + 20 * i)
        Z, along = np.array([_compressibility(phi, N, one) for one in seeds]).T
        expected = of_few(phi, N)
        compare(
            result, f"Z by the pressure tensor, phi = {phi}", Z, expected, disks=N, seeds=seeds, source=SOURCE,
            systematic=5e-4 * expected, why="5e-4 of Z, which the fit may be off by", widest=0.01,
        )  # fmt: skip
        compare(
            result, f"P_xx / p of elastic disks, phi = {phi}", along, 1.0, disks=N, seeds=seeds, source="isotropy",
            systematic=0.0, why="none", widest=0.02,
        )  # fmt: skip
        style.points(axes, [phi], [Z.mean()], style.VERMILION, "pressure tensor" if not i else None, "s")
    if not quick:
        phi, n, P, error = LI
        seeds = seeds_of(seed, REPLICAS, 8200)
        Z = np.array([_compressibility(phi, n, one)[0] for one in seeds])
        compare(
            result, f"P sigma^2 / T of {n} disks by the pressure tensor, phi = {phi}", Z * 4.0 * phi / np.pi, P,
            disks=n, seeds=seeds, systematic=4.0 * error, why=f"4 errors of the Monte Carlo, {error}", widest=0.01,
            source="Li et al. (2022), doi:10.1063/5.0126437, event-chain Monte Carlo",
        )  # fmt: skip
    axes.set(xlabel=r"packing fraction $\phi$", ylabel=r"$Z = P/(nT)$", xlim=(0.0, 0.72))
    axes.legend()


# -- balances ----------------------------------------------------------------------------------------------


def balances(n: int, seed: int, rate: float, per_disk: float) -> tuple[float, float]:
    """Energy of a sheared mixture over that by P_xy, and the angular momentum of spins over that by P_xy - P_yx."""
    rng = np.random.default_rng(seed)
    disks = Disks(n, mass=rng.uniform(0.5, 2.0, n), radius=rng.uniform(0.3, 0.6, n))
    box = Box.from_packing_fraction(disks.radius, 0.3, shear_rate=rate)
    start = scattered(disks, box, seed, temperature=1.0)
    start.velocity = start.velocity + box.flow(start.position)
    gas = Simulation(disks, box, coins["1 pta"].law, start, record=["stress", "ledger"])
    rows: list[Measure] = []
    every = Trigger(collisions=2.0 / n)
    spin = float(disks.inertia @ gas.state.spin)
    gas.run(collisions_per_disk=per_disk, series=every, series_callbacks=[rows.append], progress=False)
    kinetic = 0.0
    for before, after in itertools.pairwise(rows):
        dt = after.time - before.time
        kinetic += before.momentum_flux[0, 1] * dt - 0.5 * rate * before.momentum_flux[1, 1] * dt**2
    first, last = rows[0], rows[-1]
    assert last.virial is not None
    assert last.dissipated is not None
    heat = -rate * (kinetic + last.virial[0, 1])
    gained = float(disks.inertia @ gas.state.spin) - spin
    turned = last.virial[0, 1] - last.virial[1, 0]
    return (last.energy - first.energy + float(last.dissipated.sum())) / heat, gained / float(turned)


def _balances(result: Result, seed: int) -> None:
    energy, spin = np.array([balances(100, one, 0.5, 20.0) for one in seeds_of(seed, 3, 8300)]).T
    result.all_near(
        "energy of rough disks in a sheared box over -rate P_xy A t", energy, 1.0, ROUNDING,
        "f64 round-off of 1e3 collisions", "conservation of energy",
    )  # fmt: skip
    result.all_near(
        "angular momentum of spins over (P_xy - P_yx) A t", spin, 1.0, 1e3 * ROUNDING,
        "f64 round-off of 1e3 collisions, enlarged by sums that cancel", "conservation of angular momentum",
    )  # fmt: skip


# -- simple shear ------------------------------------------------------------------------------------------


def steady_temperatures(law: IFRLaw, phi: float) -> tuple[float, float]:
    """T and T_rot of kinetic theory at a shear rate of 1; smooth disks have no T_rot, which is 0 here."""
    steady = steady_state(law, 1.0, 0.5, 2.0, phi, 1.0)
    assert steady is not None
    return steady[0], 0.0 if math.isnan(steady[1]) else steady[1]


def monte_carlo(law: IFRLaw, phi: float, seed: int, n: int, span: float) -> Array:
    """Pressure tensor over n T of a sheared gas, shape (2, 2): mean over `span` mean free times after 20."""
    steps = enskog.sheared_gas(law, phi, *steady_temperatures(law, phi), n, seed)
    begin, end = round(20.0 / enskog.STEP), round((20.0 + span) / enskog.STEP)
    kinetic, transferred = np.zeros((2, 2)), np.zeros((2, 2))
    for step in itertools.islice(steps, begin, end):
        kinetic += step.kinetic
        transferred += step.transferred
    return np.asarray((kinetic + transferred) / (0.5 * np.trace(kinetic)))


def sheared(law: IFRLaw, phi: float, seed: int, per_disk: float) -> Array:
    """Pressure tensor over n T of a gas that is sheared at the rate 1, shape (2, 2)."""
    T, T_rot = steady_temperatures(law, phi)
    disks, velocity, spin = thermal(SHEARED_N, seed, T=T, T_rot=T_rot)
    box = Box.from_packing_fraction(disks.radius, phi, shear_rate=1.0)
    position = scattered(disks, box, seed, temperature=1.0).position
    gas = Simulation(disks, box, law, State(position, velocity + box.flow(position), spin), record=["stress"])
    gas.run(collisions_per_disk=20.0, progress=False)
    rows = observed(gas, 400, collisions_per_disk=20.0 + per_disk)
    found = mean_of(rows, box.area)
    return np.asarray(found.total / (0.5 * np.trace(found.kinetic)))


def _simple_shear(result: Result, quick: bool, seed: int, axes: Any) -> None:
    for i, (name, law) in enumerate(LAWS.items()):
        if quick and i == 0:
            continue
        for j, phi in enumerate(SHEARED[:1] if quick else SHEARED):
            seeds = seeds_of(seed, 8, 8400 + 40 * i + 20 * j)
            found = np.array([sheared(law, phi, one, 60.0 if quick else 150.0) for one in seeds])
            right = np.array([monte_carlo(law, phi, one, 2000, 30.0 if quick else 60.0) for one in seeds[:6]])
            options: Any = {"disks": SHEARED_N, "seeds": seeds, "source": ENSKOG}
            of = f"of sheared disks, {name}, phi = {phi}"
            for component, (a, b) in COMPONENTS.items():
                expected = Mean.of(right[:, a, b])
                compare(
                    result, f"P_{component} / n T {of}", found[:, a, b], expected,
                    systematic=0.02 * abs(expected.value), why=CORRELATIONS, widest=0.1, **options,
                )  # fmt: skip
            compare(
                result, f"-P_xy / P_yy {of}", -found[:, 0, 1] / found[:, 1, 1],
                Mean.of(-right[:, 0, 1] / right[:, 1, 1]), widest=0.1,
                systematic=0.02 * float(np.mean(-right[:, 0, 1] / right[:, 1, 1])), why=CORRELATIONS, **options,
            )  # fmt: skip
            if j == 0:
                _draw_tensor(axes, found, right, i, name)
    axes.set_xticks(range(len(COMPONENTS)), [f"$P_{{{name}}}$" for name in COMPONENTS])
    axes.set_ylabel("$P_{ab} / nT$")
    axes.legend()


def _draw_tensor(axes: Any, found: Array, right: Array, i: int, name: str) -> None:
    """Draw the components of replicas, and the Monte Carlo as lines."""
    places, color = np.arange(len(COMPONENTS)) + 0.3 * (i - 0.5), (style.VERMILION, style.BLUE)[i]
    for place, (a, b) in zip(places, COMPONENTS.values(), strict=True):
        style.errorbars(axes, place, found[:, a, b], color, name if (a, b) == (0, 0) else None, "so"[i])
        axes.hlines(right[:, a, b].mean(), place - 0.13, place + 0.13, color=color, lw=1.0)


# -- walls -------------------------------------------------------------------------------------------------


def on_walls(law: IFRLaw, seed: int, t_end: float, *, hot: bool) -> float:
    """Mean P_xx of a gas between walls at x = 0 and L, over the force on a length of that at L, and what is left of it.

    That is what sum m v_x x changed by. `hot` walls have the temperatures 1 and 2.
    """
    disks, L = equal_disks(400), 30.0
    box = Box((L, L), (False, True))
    walls = [
        Wall.line((0.0, 0.0), (1.0, 0.0), temperature=1.0),
        Wall.line((L, 0.0), (-1.0, 0.0), temperature=2.0),
    ]
    walls = walls if hot else []
    start = scattered(disks, box, seed, walls, temperature=1.0)
    gas = Simulation(disks, box, law, start, walls=walls, record=["stress", "wall_sums"], seed=seed)
    rows = observed(gas, round(4.0 * t_end), t_end=t_end)
    end = gas.state
    change = float(
        disks.mass @ (end.velocity[:, 0] * end.position[:, 0] - start.velocity[:, 0] * start.position[:, 0])
    )
    force = -float(gas.wall_sums.values[1, 0]) / (L * t_end)
    return (float(mean_of(rows, box.area).total[0, 0]) - change / (box.area * t_end)) / force


def _walls(result: Result, quick: bool, seed: int) -> None:
    cases = {
        "elastic disks": (ELASTIC, False),
        "coins between walls at T = 1 and 2": (coins["1 pta"].law, True),
    }
    t_end = 25.0 if quick else 100.0
    for i, (name, (law, hot)) in enumerate(cases.items()):
        seeds = seeds_of(seed, 6, 8600 + 20 * i)
        found = [on_walls(law, one, t_end, hot=hot) for one in seeds]
        compare(
            result, f"P_xx over the pressure on walls across x, {name}, t = {t_end:g}", found, 1.0, disks=400,
            seeds=seeds, systematic=0.0, widest=0.01, source="the virial theorem", why="none",
        )  # fmt: skip
