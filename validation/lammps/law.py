"""Gases that LAMMPS moves and laws of ours collide, against our engine: the same places, to rounding.

LAMMPS moves disks freely; those that met in a step collide by `engines.collide_step`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...engines import collide_step
from ...model.box import Box
from ...model.laws.ifr import IFRLaw
from ...model.laws.law import CollisionLaw
from ...model.laws.table import TableLaw
from ...model.laws.viscoelastic import Viscoelastic
from ...model.laws.walton import Walton
from ...model.state import State
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..gas.sample import fluid
from ..report.registry import Result
from . import library
from .world import World

QUESTION = "Does a general-purpose engine, with our law in its steps, move the same gas?"
REFERENCE = "our engine, from the same start"

PHI, DISKS, END, STEPS = 0.15, 500, 3.0, (0.05, 0.02)
OF_OTHERS = {"disks": 300, "end": 2.0}
OTHERS: tuple[CollisionLaw, ...] = (
    Walton(e_n=0.9, beta_0=0.28, mu=0.2),
    Viscoelastic.of_restitution(0.9, g_n=1.0, mass=1.0, radius=0.5, friction="walton", beta_0=0.28, mu=0.2),
    TableLaw(slip=[0.2, 0.5, 1.0, 1.6], ratio=[0.03, 0.12, 0.18, 0.2], e_n=[0.95, 0.85], g_n=[0.1, 3.0]),
)
TOLERANCE = 1e-9
REASON = "rounding grows e-fold in 0.6 collisions per disk; up to 3 per disk here, seen 4e-11 diameters"


def run(quick: bool) -> Result:
    library.load()
    result = Result()
    law = IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2)
    ours = fluid(DISKS, PHI, 1, law, melting=20.0, T_rot=1.0)
    _compare(result, f"{DISKS} disks, IFR", ours, law, END, STEPS[:1] if quick else STEPS)
    for other in OTHERS:
        gas = fluid(int(OF_OTHERS["disks"]), PHI, 2, other, melting=20.0, T_rot=1.0)
        name = f"{gas.disks.n} disks, {other.name_in_cases}"
        _compare(result, name, gas, other, OF_OTHERS["end"], STEPS[:1])
    return result


class Moved:
    """Equal disks of mass and diameter 1 from a state in a periodic box, moved by LAMMPS; `count` collisions so far."""

    def __init__(self, state: State, box: Box, law: CollisionLaw, step: float) -> None:
        self.world = World(state.position, state.velocity, state.spin, box.lengths, None, step)
        self.law, self.count = law, 0
        self.world.call(self._end_of_step)

    def _end_of_step(self, _lammps: Any, step: int, n: int, _ids: Any, x: Array, force: Array) -> None:
        force[:n] = 0.0
        if step == 0:
            return  # the set-up: nothing has moved
        v, w = self.world.array("v")[:, :2], self.world.array("omega")[:, 2]
        hits = collide_step(
            x[:n, :2], v, w, self.world.step, self.law, mass=1.0, radius=0.5, lengths=self.world.lengths
        )
        self.count += len(hits)


def _compare(
    result: Result, name: str, ours: Simulation, law: CollisionLaw, end: float, steps: tuple[float, ...]
) -> None:
    begin = ours.state
    ours.run(t_end=end)
    source = "our engine"
    for step in steps:
        theirs = Moved(begin, ours.box, law, step)
        theirs.world.run_to(end)
        x, v, w = theirs.world.state()
        text = f"{name}, moved by LAMMPS in steps of {step:g}"
        reason = "each collision is found, also of disks that touch and part within a step"
        result.near(f"collisions by t = {end:g}, {text}", theirs.count, ours.collisions, 0.0, reason, source)
        off = theirs.world.apart(x - ours.state.position)
        result.all_near(f"places [diameters], {text}", off, 0.0, TOLERANCE, REASON, source)
        motion = np.concatenate((v - ours.state.velocity, (w - ours.state.spin)[:, None]), axis=1)
        result.all_near(f"velocities and spins, {text}", motion, 0.0, 10.0 * TOLERANCE, REASON, source)
