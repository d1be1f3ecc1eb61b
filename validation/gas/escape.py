"""Does any disk ever get through a wall? `python -m ifrdem.validation.gas.escape --hits 1e7`

A few disks in a room of every kind of wall of one piece: four sides, one of them thermal; a container around them that
cuts the corners off, with a turning surface; a floor that moves as a sine and a wall that moves as a sawtooth; posts at
rest, in motion and of radius 0; a segment. Gravity pulls. Inelastic rough disks lose what moving walls give; slow
collisions are elastic, so that none comes to rest on a post.

`--room corners`: disks in a star, around polylines and arcs with many corners, joints and ends, some of which turn or
swing.

After every stretch of collisions each disk is checked against each wall: a gap below zero by more than rounding is an
escape, or the beginning of one, and the engine itself refuses a state with a disk outside of the box.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np

from ...errors import EngineError
from ...initial import maxwellian, random_positions
from ...model.box import Box
from ...model.collapse import VelocityCutoff
from ...model.laws.coin_table import coins
from ...model.laws.ifr import IFRLaw
from ...model.setup import Setup
from ...model.state import Disks, State
from ...model.walls.motion import Motion, Turn
from ...model.walls.wall import Wall
from ...simulation.engine import ORDERS, Engine
from ...tools.arguments import script
from ...tools.checked import Integer, choice

ROUNDING = 1e-9  # of the gap [length]: thousands of times the rounding of a place in this room


@dataclass(frozen=True)
class Escape:
    """Findings of a run."""

    hits: int  # collisions with walls
    collisions: int  # and between disks
    time: float  # simulated time at the end [time]
    states: int  # number of times at which all gaps were checked
    least_gap: float  # between a disk and a wall in all of them [length]; below 0 it is an overlap


def room(order: str = "serial", *, seed: int = 1) -> Engine:
    """Twelve disks of diameter and mass 1 in the room."""
    rng = np.random.default_rng(seed)
    grid = np.arange(12)
    position = np.column_stack((9.0 + 4.0 * (grid % 4), 9.0 + 4.0 * (grid // 4)))
    state = State(position, rng.normal(size=(12, 2)), rng.normal(size=12))
    sine = Motion("sine", amplitude=0.4, frequency=0.3)
    sawtooth = Motion("sawtooth", direction=(1.0, 0.0), amplitude=0.3, frequency=0.5)
    aslant = Motion("sine", direction=(1.0, 1.0), amplitude=1.5, frequency=0.2)
    walls = [
        Wall.container((15.0, 15.0), 17.5, surface_speed=0.3),
        Wall.line((0.0, 0.5), (0.0, 1.0), motion=sine),
        Wall.line((0.5, 0.0), (1.0, 0.0), motion=sawtooth),
        Wall.line((30.0, 0.0), (-1.0, 0.0), temperature=1.0),
        Wall.segment((4.0, 22.0), (11.0, 24.0)),
        Wall.post((7.0, 7.0), 1.0),
        Wall.post((22.0, 8.0), 0.7, motion=aslant),
        Wall.post((15.0, 26.0), 0.0),
    ]
    disks = Disks(12, mass=np.ones(12), radius=np.full(12, 0.5))
    setup = Setup(
        Box((30.0, 30.0), (False, False)), ((coins["1 pta"].law,),), tuple(walls), (0.0, -0.02),
        collapse=VelocityCutoff(0.01), seed=seed,
    )  # fmt: skip
    return Engine(setup, disks, state, order=order)


def corners(order: str = "serial", *, seed: int = 1) -> Engine:
    """Forty disks of diameter 0.7 among corners, joints and ends; walls are nowhere less than a diameter apart."""
    middle, box = (15.0, 15.0), Box((30.0, 30.0), (False, False))
    star = [
        (15.0 + r * math.cos(a), 15.0 + r * math.sin(a))
        for r, a in zip([14.0, 11.5] * 12, 2.0 * np.pi * np.arange(24) / 24, strict=True)
    ]
    turn = Turn("steady", center=middle, rate=0.5)
    back = Turn("sine", center=middle, amplitude=2.0, frequency=0.05, phase=0.3)
    walls = [
        Wall.polygon(star, holds="inside"),
        Wall.polyline([(12.0, 15.0), (14.0, 15.8), (16.0, 14.2), (18.0, 15.0)], turn=turn),
        *(
            Wall.arc(
                (15.0 + 5.0 * math.cos(a), 15.0 + 5.0 * math.sin(a)), 1.0, (a + 1.5, a + 4.8), turn=turn
            )  # open outwards
            for a in (0.0, 2.0, 4.0)
        ),
        *(Wall.arc(middle, 8.5, (a, a + 0.5), turn=back) for a in (0.0, 1.5, 3.0, 4.5)),
    ]
    disks = Disks(40, mass=np.ones(40), radius=np.full(40, 0.35))
    position = random_positions(box, disks.radius, seed=seed, walls=walls)
    state = State(position, maxwellian(disks.mass, speed_rms=1.0, seed=seed), np.zeros(40))
    setup = Setup(
        box, ((IFRLaw(e_n=0.85, e_t=-0.6, mu=0.2),),), tuple(walls), (0.0, -0.02), collapse=VelocityCutoff(1e-3),
        seed=seed,
    )  # fmt: skip
    return Engine(setup, disks, state, order=order)


ROOMS = {"kinds": room, "corners": corners}


def run(hits: int, order: str = "serial", *, where: str = "kinds", seed: int = 1) -> Escape:
    """Run in one of `ROOMS` until so many wall hits.

    Raises EngineError if a disk is found inside of a wall or beyond it.
    """
    engine = ROOMS[where](order, seed=seed)
    least, states = np.inf, 0
    while engine.wall_collisions < hits:
        before = engine.wall_collisions
        # Stretches of about a thousandth of the run, to look at all gaps at times unrelated to hits.
        stop = engine.time + (0.001 * hits * engine.time / before if before else 1.0)
        while engine.time < stop:
            engine.advance(t_end=stop)
        state = engine.state()
        states += 1
        for w, wall in enumerate(engine.walls):
            gap = wall.gap(state.position, engine.disks.radius, state.time)
            least = min(least, float(gap.min()))
            if not least >= -ROUNDING:
                who = f"disk {int(gap.argmin())} overlaps wall {w} ({wall.shape}) by {-least:.3g}"
                raise EngineError(f"t = {state.time:.9g}, after {engine.wall_collisions} wall hits: {who}")
    return Escape(engine.wall_collisions, engine.collisions, engine.time, states, least)


def escape(*, hits: str = "1e7", room: str = "kinds", order: str = "serial", seed: str = "1") -> None:
    """Look for disks that get through walls, until so many wall hits.

    Parameters
    ----------
    hits
        wall hits
    room
        walls: kinds, or corners
    order
        order of the engine
    seed
        seed
    """
    choice("--order", order, ORDERS)
    choice("--room", room, ROOMS)
    found = run(
        Integer(1).of_text("--hits", hits),
        order,
        where=room,
        seed=Integer(0, 2**63 - 1).of_text("--seed", seed),
    )
    print(
        f"{found.hits} wall hits and {found.collisions} collisions to t = {found.time:.6g}; {found.states} states "
        f"looked at: no disk escaped, least gap {found.least_gap:.3g}"
    )


if __name__ == "__main__":
    sys.exit(script(escape))
