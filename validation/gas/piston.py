"""A gas at constant pressure: elastic smooth disks under a piston, compressed slowly and let out again.

The box is periodic along x, of width W. A force F presses the piston, of mass M, on N disks: P = F / W. All kinetic
energy is N T: 2 N - 1 directions of disks, whose momentum along x is kept, and that of the piston. F h + N T, h the
height of the piston above the floor, is conserved while F is constant, and grows by h dF where it changes.

*Equation of state.* P = rho T Z(phi) with Z of Kolafa and Rottner (`state.compressibility`) gives the density of the
bulk; h then follows from the number of disks, N = rho W (h - sigma) + 2 W Gamma. The excess at a hard wall that
centres cannot pass is Gamma = rho sigma phi / (1 + phi) by scaled particle theory, and 8/(3 pi) of that at low density
(`equilibrium.bulk_density`): one diameter of a hundred is known to a tenth.

*Adiabat.* N dT = -F dh and F = W rho T Z: d(ln T)/d(phi) = -(W / N) rho Z dh/d(phi); without walls Z / phi.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...model.box import Box
from ...model.observables import Measure
from ...model.walls.motion import Piston
from ...model.walls.wall import Wall
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import ELASTIC, compare, equal_disks, scattered, seeds_of
from .state import SOURCE, compressibility

QUESTION = "Does a gas under a free piston have the density of its pressure, and follow the adiabat when that changes?"
REFERENCE = "Kolafa and Rottner (2006), doi:10.1080/00268970600967963, and d(N T) = -P dV"

FROM, TO = 0.2, 0.3  # packing fractions of the bulk
WIDTH, MASS = 16.0, 40.0
STEPS = 100  # of the force, each short against the time that sound takes to the floor and back
LAYER = 0.5 * (1.0 + 8.0 / (3.0 * math.pi))  # Gamma over that of scaled particle theory
PHI = np.linspace(0.5 * FROM, 1.3 * TO, 20_001)


def height(phi: Any, n: int, layer: float = LAYER) -> Any:
    """Height of the piston above the floor [sigma] with n disks below it, at packing fractions of their bulk."""
    return 1.0 + n / (4.0 / math.pi * phi * WIDTH) - 2.0 * layer * phi / (1.0 + phi)


def force(phi: Any, T: Any) -> Any:
    """Force on the piston."""
    return WIDTH * 4.0 / math.pi * phi * T * compressibility(phi)


@dataclass(frozen=True)
class Equilibrium:
    """Bulk packing fraction, temperature, height, and enthalpy F h + N T."""

    phi: float
    T: float
    h: float
    enthalpy: float

    @classmethod
    def at(cls, F: float, T: Any, n: int) -> Equilibrium:
        """At a force; `T` is the temperature, or on the grid `PHI` that of an adiabat."""
        phi = float(np.interp(F, force(PHI, T), PHI))
        here = float(np.interp(phi, PHI, T + 0.0 * PHI))
        h = float(height(phi, n))
        return cls(phi, here, h, F * h + n * here)


def with_enthalpy(F: float, enthalpy: float, n: int) -> Equilibrium:
    """The equilibrium of this force and enthalpy."""
    T = F / force(PHI, 1.0)
    found = F * height(PHI, n) + n * T  # falls with the packing fraction
    return Equilibrium.at(F, float(np.interp(enthalpy, found[::-1], T[::-1])), n)


def adiabat(begin: Equilibrium, n: int) -> Array:
    """Temperatures at `PHI` on the adiabat through an equilibrium."""
    slope = -(WIDTH / n) * 4.0 / math.pi * PHI * compressibility(PHI) * np.gradient(height(PHI, n), PHI)
    grown = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(PHI) * (slope[1:] + slope[:-1]))))
    return np.asarray(begin.T * np.exp(grown - np.interp(begin.phi, PHI, grown)))


@dataclass(frozen=True)
class Path:
    """Results of one gas: mean height and temperature at both forces, enthalpies then and back at the first."""

    h: tuple[float, float]
    T: tuple[float, float]
    enthalpy: tuple[float, float, float]
    ways: list[tuple[float, float]]  # h and T while it is compressed and let out


def follow(n: int, seed: int, forces: tuple[float, float], stay: float, ramp: float) -> Path:
    """Begin near equilibrium at the first force, go to the second in a time `ramp`, `stay` at each, and go back."""
    start = Equilibrium.at(forces[0], 1.0, n)
    box = Box((WIDTH, round(1.6 * start.h)), (True, False))
    piston = Wall.line((0.0, start.h), (0.0, -1.0), piston=Piston(mass=MASS, force=forces[0]))
    disks = equal_disks(n)
    begin = scattered(disks, box, seed, [piston], temperature=1.0)
    gas = Simulation(disks, box, ELASTIC, begin, walls=[piston])
    heights: list[float] = []
    temperatures: list[float] = []
    F = forces[0]

    def sample(measure: Measure) -> None:
        assert measure.pistons is not None
        s, _, energy, _ = measure.pistons[0]
        heights.append(start.h - s)
        # The piston's kinetic energy is its whole one but for -F s.
        temperatures.append((measure.translational_energy + energy + F * s) / n)

    def staying() -> tuple[float, float, float]:
        gas.run(t_end=gas.time + 0.1 * stay, progress=False)
        heights.clear()
        temperatures.clear()
        gas.run(t_end=gas.time + stay, series=round(2.0 * stay), series_callbacks=[sample], progress=False)
        return float(np.mean(heights)), float(np.mean(temperatures)), F * heights[-1] + n * temperatures[-1]

    ways = []
    found = [staying()]
    for first, last in (forces, forces[::-1]):
        for step in range(STEPS):
            F = float(first * (last / first) ** ((step + 1) / STEPS))
            gas.set_piston_force(0, F)
            gas.run(t_end=gas.time + ramp / STEPS, progress=False)
            sample(gas.measure())
            ways.append((heights[-1], temperatures[-1]))
        if last == forces[1]:
            found.append(staying())
    h, T, enthalpy = zip(*found, strict=True)
    return Path(h, T, (*enthalpy, F * heights[-1] + n * temperatures[-1]), ways)


def run(quick: bool, seed: int) -> Result:
    n, replicas, stay, ramp = (300, 10, 150.0, 400.0) if quick else (600, 12, 1000.0, 1500.0)
    on_adiabat = adiabat(Equilibrium.at(force(FROM, 1.0), 1.0, n), n)
    forces = float(force(FROM, 1.0)), float(np.interp(TO, PHI, force(PHI, on_adiabat)))
    seeds = seeds_of(seed, replicas, 7000)
    paths = [follow(n, one, forces, stay, ramp) for one in seeds]
    result = Result()
    layers = abs(height(FROM, n, 1.0) - height(FROM, n, 8.0 / (3.0 * math.pi))) / 2.0 / height(FROM, n)
    systematic = 5e-4 + layers + 1.0 / n
    why = f"5e-4 of Z, the layer at walls ({layers:.1g}), and fluctuations of a gas of {n} disks, 1/N"

    # A compression that is not endlessly slow heats the gas, by its viscosity and the swing of the piston.
    slow, why_slow = 1.0 / ramp, f"{why}; 1 / ramp, for a compression in a time {ramp:g}"

    def row(quantity: str, found: list[float], more: float = 0.0) -> None:
        compare(
            result, quantity, found, 1.0, disks=n, seeds=seeds, systematic=systematic + more,
            why=why_slow if more else why, source=SOURCE,
            widest=0.04 if quick else 0.008,
        )  # fmt: skip

    for i, phi in enumerate((FROM, TO)):
        row(
            f"packing fraction under the piston over that of its pressure and temperature, phi = {phi}",
            [
                (Equilibrium.at(forces[i], each.T[i], n).h - 1.0) / (each.h[i] - 1.0)
                for each in paths
            ],
        )  # fmt: skip
    expected = [
        Equilibrium.at(forces[1], adiabat(with_enthalpy(forces[0], each.enthalpy[0], n), n), n)
        for each in paths
    ]
    pairs = list(zip(paths, expected, strict=True))
    row(
        f"temperature after compression to phi = {TO} over that of the adiabat",
        [a.T[1] / b.T for a, b in pairs],
        slow,
    )
    row("height of the piston then over that of the adiabat", [a.h[1] / b.h for a, b in pairs], slow)
    row("enthalpy then over that of the adiabat", [a.enthalpy[1] / b.enthalpy for a, b in pairs], slow)
    row(
        "enthalpy after expansion over that at the start",
        [a.enthalpy[2] / a.enthalpy[0] for a in paths],
        2.0 * slow,
    )
    result.pictures.append(_picture(n, forces, paths, on_adiabat))
    return result


def _picture(n: int, forces: tuple[float, float], paths: list[Path], on_adiabat: Array) -> Picture:
    """Temperature against height and force, and the adiabat."""
    figure, (left, right) = style.panels(1, 2)
    ways = np.mean([each.ways for each in paths], axis=0)
    line = height(PHI, n)
    shown = (line > ways[:, 0].min()) & (line < ways[:, 0].max())
    for axes, scale, at in ((left, line[shown], ways[:, 0]), (right, force(PHI, on_adiabat)[shown], None)):
        steps = np.concatenate(
            [np.geomspace(*forces, STEPS + 1)[1:], np.geomspace(*forces[::-1], STEPS + 1)[1:]]
        )
        x = steps if at is None else at
        axes.plot(x[:STEPS:2], ways[:STEPS:2, 1], "o", ms=3, label="compressed")
        axes.plot(x[STEPS::2], ways[STEPS::2, 1], "s", ms=3, mfc="none", label="let out")
        axes.plot(scale, on_adiabat[shown], color=style.BLACK, label="adiabat of Kolafa and Rottner")
        axes.set_ylabel("T / T(start)")
    left.set_xlabel("height of the piston / diameter")
    right.set_xlabel("force on the piston / (T / diameter)")
    left.legend()
    caption = (
        f"{n} elastic disks under a piston whose force grows and falls slowly; means of {len(paths)} gases. Line: the "
        "adiabat from the equation of state of Kolafa and Rottner, about which the piston swings."
    )
    return Picture("gas_piston", caption, figure)
