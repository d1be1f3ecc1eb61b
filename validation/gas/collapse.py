r"""Three disks in a row: how often they collide, and when infinitely often.

The left one, with speed 1, hits the other two, which are at rest. Let r_n be the speed of approach of the n-th
collision, which alternate between the pairs. A collision makes of its pair's r_n -e r_n, and takes (1 + e) r_n / 2
from the middle disk or gives it, to the other pair: that had -e r_(n-1) since its own last one, so that

    r_(n+1) = (1 + e) r_n / 2 - e r_(n-1),   r_0 = 0, r_1 = 1.

With cos(theta) = (1 + e) / (4 sqrt(e)) it is e^((n-1)/2) sin(n theta) / sin(theta): positive as long as n theta < pi,
which is ceil(pi / theta) - 1 collisions. theta is real for e^2 - 14 e + 1 < 0, that is e > 7 - 4 sqrt(3) = 0.0718;
below, no r_n is negative, all gaps close in a finite time, and the three stay together with a third of the momentum.

S. McNamara and W. R. Young, Phys. Fluids A 4, 496 (1992); T. Zhou and L. P. Kadanoff, Phys. Rev.
E 54, 623 (1996), arXiv:mtrl-th/9604003.
"""

from __future__ import annotations

import math

import numpy as np

from ...model.box import Box
from ...model.laws.ifr import IFRLaw
from ...model.state import State
from ...simulation.simulation import Simulation
from ..report import style
from ..report.registry import Picture, Result
from .sample import equal_disks

QUESTION = "Do three disks in a row collapse below e_n = 7 - 4 sqrt(3), and only there?"
REFERENCE = "McNamara and Young, Phys. Fluids A 4, 496 (1992); the recurrence in validation/gas/collapse.py"

CRITICAL = 7.0 - 4.0 * math.sqrt(3.0)
ABOVE = (0.078, 0.08, 0.085, 0.09, 0.1, 0.13, 0.2, 0.3, 0.5, 0.7)
BELOW = (0.01, 0.03, 0.05, 0.06, 0.07)
GAPS = (1.0, 0.75)
END = 30.0  # of the runs [time]; at e_n = 0.17 or 0.9 the last r_n is so small that it would take a thousand
SOURCE = "McNamara and Young, Phys. Fluids A 4, 496 (1992)"


def count(e_n: float) -> float:
    """Collisions of the row; infinitely many below `CRITICAL`."""
    if e_n <= CRITICAL:
        return math.inf
    return math.ceil(math.pi / math.acos((1.0 + e_n) / (4.0 * math.sqrt(e_n)))) - 1


def velocities(e_n: float) -> list[float]:
    """Velocities of the three disks after their last collision, by the recurrence; only above `CRITICAL`."""
    v = [1.0, 0.0, 0.0]
    for n in range(int(count(e_n))):
        pair = n % 2
        push = 0.5 * (1.0 + e_n) * (v[pair] - v[pair + 1])
        v[pair] -= push
        v[pair + 1] += push
    return v


def row(e_n: float) -> tuple[int, State]:
    """The row as the engine runs it: number of collisions, and the state at the end."""
    x = np.array([5.0, 6.0 + GAPS[0], 7.0 + GAPS[0] + GAPS[1]])
    v = np.zeros((3, 2))
    v[0, 0] = 1.0
    begin = State(np.column_stack((x, np.full(3, 3.0))), v, np.zeros(3))
    gas = Simulation(equal_disks(3), Box((200.0, 6.0)), IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0), begin)
    gas.run(t_end=END)
    return gas.collisions, gas.state


def run(quick: bool, seed: int) -> Result:
    """Compare counts and velocities; nothing is random here."""
    result = Result()
    counts = {}
    for e_n in ABOVE:
        counts[e_n], end = row(e_n)
        theory = "ceil(pi / theta) - 1, cos(theta) = (1 + e) / (4 sqrt(e))"
        result.near(f"collisions at e_n = {e_n}", counts[e_n], count(e_n), 0.0, "a count", theory)
        result.all_near(
            f"velocities at the end, e_n = {e_n}", end.velocity[:, 0], velocities(e_n), 1e-13,
            "rounding of some ten collisions of speed 1", "the recurrence in validation/gas/collapse.py",
        )  # fmt: skip
    for e_n in BELOW:
        counts[e_n], end = row(e_n)
        text, why = (
            f"after the collapse, e_n = {e_n}",
            "rounding of positions near 10, over the speed that closes the last gaps",
        )
        third, apart = np.full(3, 1.0 / 3.0), np.diff(end.position[:, 0])
        result.all_near(f"velocities {text}", end.velocity[:, 0], third, 1e-12, why, SOURCE)
        result.all_near(f"distances of neighbours {text}", apart, np.ones(2), 1e-12, why, SOURCE)
    result.pictures.append(_figure(counts))
    return result


def _figure(counts: dict[float, int]) -> Picture:
    figure, (axes,) = style.panels(width=4.6)
    at = np.concatenate([CRITICAL + np.geomspace(1e-4, 0.05, 2000), np.linspace(0.122, 1.0, 2000)])
    axes.plot(at, [count(e) for e in at], color=style.BLACK, label=r"$\lceil\pi/\theta\rceil - 1$")
    style.points(axes, ABOVE, [counts[e] for e in ABOVE], style.BLUE, "simulated")
    axes.axvspan(0.008, CRITICAL, color=style.ORANGE, alpha=0.25, lw=0.0)
    axes.text(0.0095, 4.0, "collapse:\ninfinitely many", fontsize=8.5)
    style.points(axes, BELOW, [counts[e] for e in BELOW], style.VERMILION, "until gaps are rounding", "s")
    axes.axvline(CRITICAL, color=style.BLACK, lw=0.8, ls="--")
    axes.annotate(r"$7 - 4\sqrt{3}$", (CRITICAL, 1.3), (5, 0), textcoords="offset points")
    axes.set(xscale="log", yscale="log", xlabel=r"normal restitution $e_n$", ylabel="collisions", ylim=(1.0, 1000.0),
             xlim=(0.008, 1.1))  # fmt: skip
    axes.legend(loc="upper right", fontsize=7.5)
    caption = (
        "Three disks in a row, one of which hits the other two: collisions until they part, or collapse."
    )
    return Picture("gas_collapse", caption, figure)
