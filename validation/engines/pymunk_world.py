"""pymunk (Chipmunk), a second general-purpose engine, with the interface of `bullet_world.BulletWorld`.

Two-dimensional: circles and lines, impulses from velocities as in Bullet, restitution and friction of two shapes
multiplied. A step moves the bodies first and then gives impulses; what overlaps is pushed apart only beyond
`collision_slop`, which is set to more than ever occurs.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Sequence
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import install_extra
from ...model.state import Disks, State
from ...model.walls.wall import Wall
from .bullet_world import Surface

DISK, WALL = 1, 2  # collision types
LONG = 1e3  # half the length of a line, in diameters: Chipmunk has segments only
OVERLAP = 1e-3  # of disks that rest [length]


def absence() -> str | None:
    """Reason why pymunk cannot be used here; None if it can."""
    if importlib.util.find_spec("pymunk") is None:
        return f"pymunk is not installed: {install_extra('bullet')}"
    return None


class PymunkWorld:
    """Disks and straight walls in a space of pymunk; parameters and attributes as in `BulletWorld`.

    If they are `resting`, g = 1 pulls along -y, contacts begin with the impulses that they had, and overlaps of more
    than `OVERLAP` are pushed apart.
    """

    name = "pymunk"
    moves_first = True  # whether a step moves bodies before they collide

    def __init__(
        self,
        disks: Disks,
        surface: Surface,
        *,
        walls: Sequence[Wall] = (),
        time_step: float,
        resting: bool = False,
    ) -> None:
        self.pymunk: ModuleType = importlib.import_module("pymunk")
        self.time_step: float = time_step
        self.n: int = disks.n
        self.collisions: int = 0
        self.wall_collisions: int = 0
        diameter = 2.0 * float(disks.radius.max())
        self.space: Any = self.pymunk.Space()
        self.space.gravity = (0.0, -1.0 if resting else 0.0)
        self.space.iterations = 50
        self.space.collision_slop = OVERLAP if resting else diameter
        if not resting:
            # Impulses of an earlier contact of the same pair, kept for three steps by default, would count again.
            self.space.collision_persistence = 1
        self.bodies: list[Any] = []
        for mass, radius, inertia in zip(disks.mass, disks.radius, disks.inertia, strict=True):
            body = self.pymunk.Body(float(mass), float(inertia))
            self._add(body, self.pymunk.Circle(body, float(radius)), surface, DISK)
            self.bodies.append(body)
        for wall in walls:
            origin, towards = (np.array(each) for each in (wall.origin, wall.towards))
            along = LONG * diameter * np.array([-towards[1], towards[0]])
            both = (origin, origin + towards) if wall.shape == "segment" else (origin - along, origin + along)
            ends = (tuple(each.tolist()) for each in both)
            segment = self.pymunk.Segment(self.space.static_body, *ends, 0.0)
            self._add(None, segment, surface, WALL)
        self.space.on_collision(DISK, DISK, begin=partial(self._count, "collisions"))
        self.space.on_collision(DISK, WALL, begin=partial(self._count, "wall_collisions"))

    def _add(self, body: Any, shape: Any, surface: Surface, kind: int) -> None:
        shape.elasticity, shape.friction = math.sqrt(surface.e_n), math.sqrt(surface.mu)
        shape.collision_type = kind
        self.space.add(*((shape,) if body is None else (body, shape)))

    def _count(self, name: str, arbiter: Any, space: Any, data: Any) -> None:
        setattr(self, name, getattr(self, name) + 1)

    def __enter__(self) -> PymunkWorld:
        return self

    def __exit__(self, *error: object) -> None:
        del self.space, self.bodies

    def place(
        self, position: NDArray[np.float64], velocity: NDArray[np.float64], spin: NDArray[np.float64]
    ) -> None:
        """Put all disks at positions (n, 2), with velocities (n, 2) and spins (n,)."""
        for body, x, v, w in zip(self.bodies, position, velocity, spin, strict=True):
            body.position, body.velocity = tuple(x.tolist()), tuple(v.tolist())
            body.angular_velocity = float(w)

    def step(self, steps: int = 1) -> None:
        """Let pymunk advance by time steps."""
        for _ in range(steps):
            self.space.step(self.time_step)

    def state(self) -> State:
        """State of the disks."""
        return State(
            np.array([tuple(body.position) for body in self.bodies]),
            np.array([tuple(body.velocity) for body in self.bodies]),
            np.array([body.angular_velocity for body in self.bodies]),
        )
