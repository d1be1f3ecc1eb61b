r"""A slow drum whose bulk rests: the angle of its surface against its speed.

Units: mean diameter d of a disk, its mass per area and g are 1. 200 disks (e_n = 0.5, mu = 0.5) half fill a drum of
23 diameters, in whose frame gravity turns by Omega. Two angles against gravity, in each sample:

    surface    of the straight line through the surface, which is the highest point of all disks at each of 40 places
               within 0.6 radii of the axis;
    centre     under which the axis sees the centre of mass. Both are equal where the surface is a straight line and
               the density the same everywhere.

From 0.6 rad of turning on their means over pieces of 0.6 rad, some five avalanches each, are taken as independent.
They scatter, because a slope can stand at any angle between that at which an avalanche stops and that at which the next
one begins, and forces in the bulk are not unique.

LAMMPS (`soft_grains`) moves soft disks of the same coefficients, from starts of the same kind, in the same turning
gravity. `drum.csv` has the angles of both, written by `python -m ifrdem.validation.heaps.measured`. This is a
measurement of what the model of resting contact does, not a case of `ifrdem validate`: its bias is of the size of the
scatter, and nothing known beforehand says how large it may be.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...model.box import Box
from ...model.collapse import Rest
from ...model.gravity import RotatingGravity
from ...model.laws.ifr import IFRLaw
from ...model.state import Disks, State
from ...model.walls.wall import Wall
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..gas.sample import Mean, sampled_run, scattered
from ..report import style
from . import soft_grains

LAW = IFRLaw(e_n=0.5, e_t=-1.0, mu=0.5)
NUMBER, RADIUS, CENTRE = 200, 11.5, 12.0
BOX = Box((2.0 * CENTRE, 2.0 * CENTRE), (False, False))
RESTING_SPEED = 0.02
BEGIN, PIECE, SAMPLE = 0.6, 0.6, 0.02  # rad: what is left out, means, and samples
PLACES, INNER = 40, 0.6  # of the surface; part of the radius
MEASURED = Path(__file__).parent / "drum.csv"


class Angles(NamedTuple):
    """Means over one piece of turning: angles of surface and centre of mass [degrees], part of the disks that sleep."""

    surface: float
    centre: float
    asleep: float


def mean_of(pieces: list[Angles], name: str) -> Mean:
    """Mean over pieces of one of the `Angles`."""
    return Mean.of([getattr(one, name) for one in pieces])


def draw(axes: Any, found: dict[str, dict[float, list[Angles]]]) -> None:
    """Draw angles of the surface against the speed, of several codes."""
    looks = zip(
        found.items(), (style.BLACK, style.ORANGE, style.BLUE), "s^o", (-2e-4, 0.0, 2e-4), strict=False
    )
    for (name, each), colour, marker, shift in looks:
        means = [mean_of(pieces, "surface") for pieces in each.values()]
        axes.errorbar(
            [rate + shift for rate in each], [one.value for one in means], [one.error for one in means],
            fmt=marker, mfc="none", color=colour, capsize=2.0, label=name,
        )  # fmt: skip
    axes.set(xlabel=r"$\Omega\ (d / g)^{1/2}$", ylabel="angle of the surface [degrees]", xlim=(0.0, None))
    axes.legend()


def start(seed: int) -> tuple[Disks, Wall, State]:
    """Disks all over the drum, at random."""
    radius = np.random.default_rng(seed).uniform(0.4, 0.6, NUMBER)
    disks = Disks(NUMBER, mass=math.pi * radius**2, radius=radius)
    drum = Wall.container((CENTRE, CENTRE), RADIUS)
    return disks, drum, scattered(disks, BOX, seed, [drum], speed_rms=0.1)


def turned(rate: float, seed: int, pieces: int, resting_speed: float = RESTING_SPEED) -> list[Angles]:
    """Angles of our disks in a drum that turns at a rate [rad/time], piece by piece."""
    disks, drum, begin = start(seed)
    simulation = Simulation(
        disks, BOX, LAW, begin, walls=[drum], gravity=RotatingGravity((0.0, -1.0), rate=-rate),
        collapse=Rest(resting_speed),
    )  # fmt: skip
    end = BEGIN + pieces * PIECE
    states, _ = sampled_run(simulation, round(end / SAMPLE), t_end=end / rate, progress=False)
    seen = ([getattr(one, name) for one in states] for name in ("time", "position", "asleep"))
    time, position, asleep = map(np.array, seen)
    return of_pieces(disks, rate, time, position, asleep.mean(axis=1), pieces)


def turned_by_lammps(rate: float, seed: int, pieces: int, contact_time: float, folder: Path) -> list[Angles]:
    """Angles of disks by LAMMPS in the same drum; LAMMPS writes its files into a folder."""
    disks, _, begin = start(seed)
    time, position = soft_grains.run(
        folder, disks, BOX, LAW, begin, t_end=(BEGIN + pieces * PIECE) / rate, every=SAMPLE / rate,
        walls=[(f"cylinder z {CENTRE} {CENTRE} {RADIUS} -1 1", "in")], gravity_rotation_rate=-rate,
        contact_time=contact_time,
    )  # fmt: skip
    return of_pieces(disks, rate, time, position, np.zeros(len(time)), pieces)


def of_pieces(
    disks: Disks, rate: float, time: Array, position: Array, asleep: Array, pieces: int
) -> list[Angles]:
    """Means over pieces, from samples (S,) of time and sleeping disks, and (S, n, 2) of positions."""
    each = np.array([angles(disks, -rate * t, at) for t, at in zip(time, position, strict=True)])
    piece = np.floor((rate * time - BEGIN) / PIECE + 1e-6)
    means = [np.append(each[piece == p].mean(axis=0), asleep[piece == p].mean()) for p in range(pieces)]
    return [Angles(*one.tolist()) for one in means]


def angles(disks: Disks, turned: float, position: Array) -> tuple[float, float]:
    """Angles of surface and centre of mass [degrees] against gravity, which has turned so far [rad]."""
    right = np.array((math.cos(turned), math.sin(turned)))
    up = np.array((-right[1], right[0]))
    x, y = (position - CENTRE) @ right, (position - CENTRE) @ up
    across = np.average(x, weights=disks.mass)
    centre = math.degrees(math.atan2(across, -np.average(y, weights=disks.mass)))
    at, top = highest(x, y, disks.radius, np.linspace(-INNER * RADIUS, INNER * RADIUS, PLACES))
    return math.degrees(math.atan(np.polyfit(at, top, 1)[0])), centre


def highest(x: Array, y: Array, radius: Array, at: Array) -> tuple[Array, Array]:
    """The highest point of all disks above those of the places `at` that have a disk, and these places."""
    h = radius[:, None] ** 2 - (x[:, None] - at) ** 2
    top = np.where(h > 0.0, y[:, None] + np.sqrt(np.maximum(h, 0.0)), -np.inf).max(axis=0)
    there = np.isfinite(top)
    return at[there], top[there]


def measured(code: str) -> dict[float, list[Angles]]:
    """Pieces of the file `drum.csv` by rate; `code` is "LAMMPS" or "ifrdem"."""
    found: dict[float, list[Angles]] = {}
    with MEASURED.open(encoding="ascii", newline="") as file:
        for row in csv.DictReader(file):
            if row["code"] == code:
                values = (float(row[name]) for name in Angles._fields)
                found.setdefault(float(row["rate"]), []).append(Angles(*values))
    return found
