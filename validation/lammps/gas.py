"""The same gas of Hertz-Mindlin contacts in LAMMPS and of laws of impacts in our engine: starts, runs, statistics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...model.laws.law import CollisionLaw
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..gas.sample import ELASTIC, Mean, fluid, restarted
from ..report.registry import Result
from .world import Contact, World

PHI = 0.15
MELTING = 20.0
OVERLAP = 3e-3
"""Overlap of contacts at g_n = 1.5 [diameters]: springs then hold less than 0.3 % of the energy."""
STEPS = 40
"""Steps of LAMMPS in a contact at g_n = 3, twice the thermal speed."""
ERRORS = 3.0
"""Standard errors that a difference may be off: of Student's t with 5 degrees of freedom, 97 of 100 are less."""
LAMMPS = "LAMMPS, Hertz-Mindlin"
Laws = Mapping[str, CollisionLaw]


def start(disks: int, seed: int) -> Simulation:
    """A gas at T = T_rot = 1 without memory of its first places."""
    return fluid(disks, PHI, seed, ELASTIC, melting=MELTING, T_rot=1.0)


def soft(gas: Simulation, contact: Contact, interval: float | None = None) -> World:
    """The gas in LAMMPS; an `interval` is a whole number of its steps."""
    step, state = float(contact.duration(3.0)) / STEPS, gas.state
    step = step if interval is None else interval / math.ceil(interval / step)
    return World(state.position, state.velocity, state.spin, gas.box.lengths, contact, step)


def temperatures(velocity: Array, spin: Array) -> tuple[float, float]:
    """T and T_rot: means of m v^2 / 2 and of I omega^2, I = 1/8."""
    n = len(spin)
    return float((velocity**2).sum()) / (2 * n), float((spin**2).sum()) / (8 * n)


def cooling(
    laws: Laws, contact: Contact, disks: int, seeds: Sequence[int], times: Array
) -> tuple[Array, Array]:
    """T and theta of LAMMPS and of each law, (codes, seeds, times, 2); collisions per disk of the first law, (times,)."""
    rows, counted = [], []
    for seed in seeds:
        gas = start(disks, seed)
        world, found = soft(gas, contact), []
        for t in times:
            world.run_to(float(t))
            found.append(temperatures(*world.state()[1:]))
        codes = [found]
        for law in laws.values():
            one, found, number = restarted(gas, law), [], []
            for t in times:
                one.run(t_end=float(t))
                found.append(temperatures(one.state.velocity, one.state.spin))
                number.append(2.0 * one.collisions / disks)
            codes.append(found)
            if len(codes) == 2:
                counted.append(number)
        rows.append(codes)
    values = np.array(rows).swapaxes(0, 1)
    values[..., 1] /= values[..., 0]
    return values, np.mean(counted, axis=0)


def over(values: Array, code: int) -> Array:
    """Ratio of a law's quantity to that of LAMMPS, paired by seeds, less 1."""
    return np.asarray(np.exp(np.log(values[code]) - np.log(values[0])) - 1.0)


def near(
    result: Result, quantity: str, differences: ArrayLike, expected: float, systematic: float, why: str, source: str
) -> None:  # fmt: skip
    """Add a row: the mean of paired relative differences against a number."""
    found = Mean.of(differences)
    tolerance = ERRORS * found.error + systematic
    reason = f"{ERRORS:g} standard errors of {found.replicas} pairs of gases ({found.error:.2g} each); {why}"
    result.near(quantity, found.value, expected, tolerance, reason, source)


def differs(
    result: Result, quantity: str, differences: ArrayLike, expected: float, within: float, source: str
) -> None:
    """Add two rows of a law that must be seen to differ: its mean difference, and that it is not chance."""
    found = Mean.of(differences)
    why = "an expected difference: a comparison that cannot fail proves nothing"
    result.near(quantity, found.value, expected, within, why, source)
    size = abs(found.value) / found.error
    result.at_least(f"{quantity}, in its standard errors", size, ERRORS, why, source)


def percent(differences: ArrayLike) -> str:
    """A mean difference and its standard error, in percent."""
    found = Mean.of(differences)
    return f"{100.0 * found.value:+.1f} +- {100.0 * found.error:.1f}"
