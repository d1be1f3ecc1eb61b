r"""Chipmunk (`pymunk`) as a peer of disks that rest: rigid disks with friction, under gravity, in time steps.

Unlike LAMMPS's soft disks (`soft_grains`) contacts have no springs: in each step impulses are found that let no two
disks approach, and hold them by friction up to mu times the normal one, in as many sweeps over all contacts
(50; E. Catto, Game Developers Conference 2005); they begin with those of the last step. Such contacts are the
limit of infinite stiffness. What is not ours: steps, sweeps that do not find the impulses wholly, and restitution with
e_n at every speed of contacts that last. Disks may overlap by 1e-3; what is more is pushed apart.

Optional: `pip install 'ifrdem[bullet]'` adds it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...model.laws.ifr import IFRLaw
from ...model.state import Disks, State
from ...model.walls.wall import Wall
from ...tools.checked import Array
from ..engines.bullet_world import Surface
from ..engines.pymunk_world import PymunkWorld

STEP = 1e-3  # [time]


def run(
    disks: Disks, law: IFRLaw, start: State, *, t_end: float, every: float, walls: Sequence[Wall]
) -> Array:
    """Let Chipmunk move rigid disks between straight walls under g = 1 along -y.

    Parameters
    ----------
    disks, law, start
        As of a `Simulation`, from t = 0; of the law e_n and mu are taken.
    t_end, every : float
        End of the run, and time between two samples [time].
    walls : sequence of Wall
        Lines and segments.

    Returns
    -------
    position : ndarray (samples, n, 2)
        At t = 0 and after each `every`.

    Raises
    ------
    ModuleNotFoundError
        If pymunk is not installed.
    """
    surface = Surface(law.e_n, law.mu)
    with PymunkWorld(disks, surface, walls=walls, time_step=STEP, resting=True) as world:
        world.place(start.position, start.velocity, start.spin)
        found = [start.position]
        for _ in range(round(t_end / every)):
            world.step(max(round(every / STEP), 1))
            found.append(world.state().position)
    return np.array(found)
