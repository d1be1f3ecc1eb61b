"""A heap on a plate: its angle of repose and the packing fraction inside of it.

The heap of the case `heap`: 650 disks of e_n = 0.5 and mu = 0.5 rain onto a plate of 30 diameters with a rim. The
angle is the mean of both sides, by straight lines through the surface (the highest point of all disks at 60 places)
from 2 to 13 diameters from the middle of the plate. The packing fraction is the covered part of the rectangle from
-5 to 5 diameters across and 1.5 to 4.5 above the plate, which lies below the surface (`Heap.cover`).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...model.box import Box
from ...model.collapse import Rest
from ...model.state import Disks, State
from ...model.walls.wall import Wall, sides
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..gas.sample import scattered
from . import rigid_grains, soft_grains
from .drum import LAW, highest

NUMBER, BOX = 650, Box((44.0, 50.0), (False, False))
LEFT, RIGHT, PLATE, RIM, THICK = 7.0, 37.0, 16.0, 17.0, 0.2
MIDDLE, SIDE, BASE, TOP = 0.5 * (LEFT + RIGHT), 5.0, PLATE + 1.5, PLATE + 4.5
END = 80.0
PIXEL = 0.02


class Heap(NamedTuple):
    """Angle of repose [degrees], packing fraction, room between rectangle and surface, number of disks awake."""

    angle: float
    packing_fraction: float
    cover: float
    awake: int


def start(seed: int) -> tuple[Disks, list[Wall], State]:
    """Disks all over the box, at random, out of LAMMPS's plate and rims, which are thick."""
    radius = np.random.default_rng(seed).uniform(0.4, 0.6, NUMBER)
    disks = Disks(NUMBER, mass=math.pi * radius**2, radius=radius)
    walls = [
        Wall.segment((LEFT, PLATE), (RIGHT, PLATE)),
        Wall.segment((LEFT, PLATE), (LEFT, RIM)),
        Wall.segment((RIGHT, PLATE), (RIGHT, RIM)),
    ]
    solid = [
        *(Wall.segment((LEFT - THICK, y), (RIGHT + THICK, y)) for y in (PLATE - 0.5, PLATE - 1.0)),
        *(Wall.segment((x, PLATE - 1.0), (x, RIM)) for x in (LEFT - THICK, RIGHT + THICK)),
    ]
    return disks, walls, scattered(disks, BOX, seed, [*walls, *solid], speed_rms=0.1)


def rained(seed: int, resting_speed: float) -> Heap:
    """The heap by ifrdem."""
    disks, walls, begin = start(seed)
    heap = Simulation(disks, BOX, LAW, begin, walls=walls, gravity=(0.0, -1.0), collapse=Rest(resting_speed))
    heap.run(t_end=END, progress=False)
    return of(disks, heap.state.position, NUMBER - heap.asleep)


def rained_by_lammps(seed: int, contact_time: float, folder: Path) -> Heap:
    """The heap by LAMMPS from the same start; awake are disks that move by 1e-3 diameters in the last tenth."""
    disks, _, begin = start(seed)
    walls = [
        (f"block {LEFT} {RIGHT} {PLATE - 1.0} {PLATE} -1 1", "out"),
        (f"block {LEFT - THICK} {LEFT} {PLATE - 1.0} {RIM} -1 1", "out"),
        (f"block {RIGHT} {RIGHT + THICK} {PLATE - 1.0} {RIM} -1 1", "out"),
    ]
    _, places = soft_grains.run(
        folder, disks, BOX, LAW, begin, t_end=END, every=0.1 * END, walls=walls, contact_time=contact_time
    )
    return of(disks, places[-1], moved(places))


def rained_by_chipmunk(seed: int) -> Heap:
    """The heap by Chipmunk from the same start; awake as with LAMMPS."""
    disks, walls, begin = start(seed)
    places = rigid_grains.run(disks, LAW, begin, t_end=END, every=0.1 * END, walls=[*sides(BOX), *walls])
    return of(disks, places[-1], moved(places))


def moved(places: Array) -> int:
    """Number of disks that moved by more than 1e-3 diameters between the last two samples."""
    return int((np.linalg.norm(places[-1] - places[-2], axis=1) > 1e-3).sum())


def of(disks: Disks, position: Array, awake: int) -> Heap:
    """Angle and packing fraction of a heap."""
    above = position[:, 1] > PLATE
    (x, y), radius = position[above].T, disks.radius[above]

    def surface(first: float, last: float) -> tuple[Array, Array]:
        return highest(x, y, radius, np.linspace(MIDDLE + first, MIDDLE + last, 60))

    slopes = [np.polyfit(*surface(*span), 1)[0] for span in ((-13.0, -2.0), (2.0, 13.0))]
    angle = 0.5 * (math.degrees(math.atan(slopes[0])) - math.degrees(math.atan(slopes[1])))
    return Heap(angle, covered(x, y, radius), float(surface(-SIDE, SIDE)[1].min()) - TOP, awake)


def covered(x: Array, y: Array, radius: Array) -> float:
    """The part of the rectangle that disks cover."""
    across = np.arange(MIDDLE - SIDE + 0.5 * PIXEL, MIDDLE + SIDE, PIXEL)
    upwards = np.arange(BASE + 0.5 * PIXEL, TOP, PIXEL)
    found = np.zeros((len(across), len(upwards)), dtype=bool)
    for i in np.flatnonzero((abs(x - MIDDLE) < SIDE + 1.0) & (abs(y - 0.5 * (BASE + TOP)) < 3.0)):
        found |= (across[:, None] - x[i]) ** 2 + (upwards - y[i]) ** 2 < radius[i] ** 2
    return float(found.mean())
