r"""Disks that flow out of a hopper: Beverloo's law.

Units: mean diameter d of a disk, its mass and g are 1. The rate at which disks leave an outlet of width D does not
depend on how much lies above. They fall from an arch as wide as the room of their centres, with a speed that goes
like the root of this width, so that in two dimensions W = C (D - k)^(3/2) disks leave in a unit of time (W. A.
Beverloo, H. A. Leniger and J. van de Velde, Chem. Eng. Sci. 15, 260 (1961), doi:10.1016/0009-2509(61)85030-6, with
5/2 in three dimensions; both measured by C. Mankoc et al., Granul. Matter 9, 407 (2007),
doi:10.1007/s10035-007-0062-2). Nothing predicts C; k is 1 to 2 where it was measured, 1.4 for Beverloo's seeds. With
k = 1.4 the exponent is the slope of ln W over ln(D - k); k = 1 makes it larger by 0.09 and k = 1.8 smaller by 0.09.

Disks with friction, whose radii spread by 10 %, rest in the hopper as `collapse = "rest"` has it, until a gate opens.
The rate is a straight line through the number of disks that are out, from 20 to 65 % of them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...model.box import Box
from ...model.collapse import Rest
from ...model.laws.ifr import IFRLaw
from ...model.state import Disks
from ...model.walls.wall import Wall
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..report import style
from ..report.registry import Picture, Result
from .sample import compare, sampled_run, scattered, seeds_of

QUESTION = "Does a hopper empty by Beverloo's law, with the exponent 3/2 of two dimensions?"
REFERENCE = "Beverloo, Leniger and van de Velde (1961), doi:10.1016/0009-2509(61)85030-6"

LAW = IFRLaw(e_n=0.7, e_t=-0.6, mu=0.4)
SLOPE = math.tan(math.radians(56.0))
FLOOR, RESTED = 25.0, 14.0  # height of the outlet, and the time at which its gate opens
K = 1.4
FILLING = 35.0  # disks for each diameter of the outlet
OUT = (0.2, 0.65)  # parts of the disks that are out


def run(quick: bool, seed: int) -> Result:
    result = Result()
    outlets, replicas = ((6.0, 12.0), 10) if quick else ((6.0, 8.0, 10.0, 12.0), 12)
    seeds = [seeds_of(seed, replicas, 6600 + 50 * i) for i in range(len(outlets))]
    rates = np.array([[flow(D, one) for one in each] for D, each in zip(outlets, seeds, strict=True)])
    slopes = np.polyfit(np.log(np.array(outlets) - K), np.log(rates), 1)[0]
    compare(
        result, f"exponent of Beverloo's law, outlets of 6 to 12 diameters, k = {K}", slopes, 1.5,
        disks=round(FILLING * outlets[-1]), seeds=[one for each in seeds for one in each], systematic=0.15,
        why="0.15: k from 1 to 2, and outlets of few diameters", widest=0.35, source=REFERENCE,
    )  # fmt: skip
    result.pictures.append(_figure(outlets, rates))
    return result


def flow(outlet: float, seed: int) -> float:
    """Disks that leave an outlet in a unit of time."""
    n = round(FILLING * outlet)
    width = outlet + 20.0
    radius = 0.5 * (1.0 + np.random.default_rng(seed).uniform(-0.1, 0.1, n))
    left, right, top = 0.5 * (width - outlet), 0.5 * (width + outlet), FLOOR + SLOPE * 0.5 * (width - outlet)
    walls = [
        Wall.segment((0.0, top), (left, FLOOR)),
        Wall.segment((width, top), (right, FLOOR)),
        Wall.segment((left, FLOOR), (right, FLOOR), opens_at=RESTED),
        Wall.line((0.0, top + 0.1), (0.0, 1.0), opens_at=1e-6),  # the start is above the funnel
    ]
    # The packing fraction of the start, and so the height of the box, bounds the time of the fall.
    box = Box((width, top + math.pi * n / (4.0 * 0.3 * width) + 1.0), (False, False))
    disks = Disks(n, mass=4.0 * radius**2, radius=radius)
    start = scattered(disks, box, seed, walls, speed_rms=0.3)
    hopper = Simulation(disks, box, LAW, start, walls=walls, gravity=(0.0, -1.0), collapse=Rest(0.05))
    hopper.run(t_end=RESTED)
    states, _ = sampled_run(hopper, 400, t_end=RESTED + 1.5 * n / (outlet - 1.5) ** 1.5)
    t = np.array([state.time for state in states])
    gone = np.array([(state.position[:, 1] < FLOOR).sum() for state in states])
    used = (gone > OUT[0] * n) & (gone < OUT[1] * n)
    return float(np.polyfit(t[used], gone[used], 1)[0])


def _figure(outlets: Any, rates: Array) -> Picture:
    figure, (axes,) = style.panels(width=4.2)
    mean = rates.mean(axis=1)
    error = rates.std(axis=1, ddof=1) / math.sqrt(rates.shape[1])
    power = mean ** (2.0 / 3.0)
    axes.errorbar(
        outlets,
        power,
        2.0 / 3.0 * power * error / mean,
        fmt="o",
        mfc="none",
        color=style.BLUE,
        label="simulated",
    )
    slope, zero = np.polyfit(outlets, power, 1)
    at = np.array((-zero / slope, max(outlets) + 1.0))
    axes.plot(at, slope * at + zero, color=style.BLACK, label=f"$C$ = {slope**1.5:.2f}, $k$ = {at[0]:.2f}")
    axes.set(
        xlabel="width of the outlet / $d$",
        ylabel=r"$(W\ (d / g)^{1/2})^{2/3}$",
        xlim=(0.0, None),
        ylim=(0.0, None),
    )
    axes.legend()
    caption = (
        "Disks that leave a hopper in a unit of time, to the power 2/3: by Beverloo's law a straight line."
    )
    return Picture("gas_hopper", caption, figure)
