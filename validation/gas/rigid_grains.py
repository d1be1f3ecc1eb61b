r"""Chipmunk (`pymunk`) as a peer of disks that rest: rigid disks with friction, under gravity, in time steps.

Unlike LAMMPS's soft disks (`soft_grains`) contacts have no springs: in each step impulses are found that let no two
disks approach, and hold them by friction up to mu times the normal one, in as many sweeps over all contacts
(`ITERATIONS`; E. Catto, Game Developers Conference 2005); they begin with those of the last step. Such contacts are the
limit of infinite stiffness. What is not ours: steps, sweeps that do not find the impulses wholly, and restitution with
e_n at every speed of contacts that last. Disks may overlap by `OVERLAP`; what is more is pushed apart.

Optional: `pip install 'ifrdem[bullet]'` adds it.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...model.ifr import IFRLaw
from ...model.state import Disks, State
from ...tools.checked import Array

STEP, ITERATIONS, OVERLAP = 1e-3, 50, 1e-3  # time; sweeps; length
Segment = tuple[tuple[float, float], tuple[float, float]]


def run(
    disks: Disks, law: IFRLaw, start: State, *, t_end: float, every: float, walls: Sequence[Segment]
) -> Array:
    """Let Chipmunk move rigid disks between straight walls under g = 1 along -y.

    Parameters
    ----------
    disks, law, start
        As of a `Simulation`, from t = 0; of the law e_n and mu are taken.
    t_end, every : float
        End of the run, and time between two samples [time].
    walls : sequence of ((x, y), (x, y))
        Ends of each wall.

    Returns
    -------
    position : ndarray (samples, n, 2)
        At t = 0 and after each `every`.

    Raises
    ------
    ModuleNotFoundError
        If pymunk is not installed.
    """
    pymunk: Any = importlib.import_module("pymunk")
    space = pymunk.Space()
    space.gravity, space.iterations, space.collision_slop = (0.0, -1.0), ITERATIONS, OVERLAP
    bodies = []
    for i in range(disks.n):
        body = pymunk.Body(float(disks.mass[i]), float(disks.inertia[i]))
        body.position, body.velocity = tuple(start.position[i].tolist()), tuple(start.velocity[i].tolist())
        body.angular_velocity = float(start.spin[i])
        bodies.append(body)
    circles = [
        pymunk.Circle(body, radius) for body, radius in zip(bodies, disks.radius.tolist(), strict=True)
    ]
    lines = [pymunk.Segment(space.static_body, *ends, 0.0) for ends in walls]
    for shape in (*circles, *lines):  # Chipmunk multiplies the coefficients of both
        shape.elasticity, shape.friction = math.sqrt(law.e_n), math.sqrt(law.mu)
    space.add(*bodies, *circles, *lines)
    found = []
    between = max(round(every / STEP), 1)
    for step in range(round(t_end / STEP) + 1):
        if step % between == 0:
            found.append([tuple(body.position) for body in bodies])
        space.step(STEP)
    return np.array(found)
