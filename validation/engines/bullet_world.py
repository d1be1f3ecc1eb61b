"""PyBullet's own collisions of disks, with the settings under which they are Newton's and Coulomb's.

Bullet computes impulses from velocities: the normal velocity is reversed and multiplied by the restitution, friction
is at most mu times the normal impulse and at most what stops the slip of the contact point. In our terms: e_t = -1 and
contact-point sticking. Nothing in it corresponds to e_t > -1 or to the percussion centre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import bullet
from ...model.state import Disks, State
from ...model.walls.wall import Wall
from ..report.registry import Skip

SETTINGS: dict[str, float] = {
    "numSubSteps": 0,
    "numSolverIterations": 50,
    "solverResidualThreshold": 0.0,  # else it stops iterating before the impulses have settled
    "restitutionVelocityThreshold": 0.0,  # else slow contacts do not bounce at all
    "contactERP": 0.0,  # no pushing apart of what overlaps: the overlap is the late detection's
    "contactSlop": 0.0,
    "globalCFM": 0.0,
    "contactBreakingThreshold": 1e-4,  # global to the process: it survives resetSimulation
    "deterministicOverlappingPairs": 1,
    "warmStartingFactor": 0.0,
}
"""Parameters of `setPhysicsEngineParameter`. With PyBullet's defaults restitution comes out near zero."""


def require() -> Any:
    """PyBullet's module; Skip, with what to do, if it is not installed."""
    reason = bullet.absence()
    if reason is not None:
        raise Skip(f"PyBullet is {reason}")
    return bullet.load()


@dataclass(frozen=True)
class Surface:
    """Newton's restitution and Coulomb's friction of every pair in a world."""

    e_n: float
    mu: float


class BulletWorld:
    """Disks and straight walls (lines), all of one surface, in a PyBullet client of their own; in a `with` statement.

    `collisions` and `wall_collisions` count contacts in which the solver of Bullet pushed: of two disks, of a
    disk and a wall.
    """

    name = "PyBullet"
    moves_first = False  # whether a step moves bodies before they collide

    def __init__(
        self, disks: Disks, surface: Surface, *, walls: Sequence[Wall] = (), time_step: float
    ) -> None:
        p = require()
        self.p: Any = p
        self.n: int = disks.n
        self.collisions: int = 0
        self.wall_collisions: int = 0
        self._pressed: set[tuple[int, int]] = set()
        self.client: int = p.connect(p.DIRECT)
        p.setGravity(0.0, 0.0, 0.0, physicsClientId=self.client)
        p.setPhysicsEngineParameter(fixedTimeStep=time_step, **SETTINGS, physicsClientId=self.client)
        # Bullet multiplies the coefficients of two bodies.
        own = {"friction": math.sqrt(surface.mu), "restitution": math.sqrt(surface.e_n)}
        height = float(disks.radius.min())
        self.disks: list[bullet.DiskBody] = [
            bullet.add_disk(self.client, disks.mass[i], disks.radius[i], k=disks.k[i], height=height, **own)
            for i in range(disks.n)
        ]
        self.walls: list[bullet.WallBody] = [
            bullet.add_wall(self.client, wall.origin, wall.towards, **own) for wall in walls
        ]
        self._wall_ids = {wall.body for wall in self.walls}
        # A step with nothing near: Bullet takes over inverse moments of inertia at the end of a step.
        apart = 4.0 * float(disks.radius.max())
        far = np.stack([apart * np.arange(disks.n), np.full(disks.n, -1e3 * apart)], axis=1)
        self.place(far, np.zeros((disks.n, 2)), np.zeros(disks.n))
        self.step()

    def __enter__(self) -> BulletWorld:
        return self

    def __exit__(self, *error: object) -> None:
        self.p.disconnect(self.client)

    def place(
        self, position: NDArray[np.float64], velocity: NDArray[np.float64], spin: NDArray[np.float64]
    ) -> None:
        """Put all disks at positions (n, 2), with velocities (n, 2) and spins (n,)."""
        for disk, x, v, w in zip(self.disks, position, velocity, spin, strict=True):
            bullet.place(self.client, disk.body, x, v, w)

    def step(self, steps: int = 1) -> None:
        """Let Bullet advance by time steps, with its own response."""
        for _ in range(steps):
            self.p.stepSimulation(physicsClientId=self.client)
            pairs = {
                (contact[1], contact[2])
                for contact in self.p.getContactPoints(physicsClientId=self.client)
                if contact[9] > 0.0  # the normal force
            }
            new = pairs - self._pressed  # while a pair still overlaps, the solver may push a little again
            self._pressed = pairs
            hits = sum(not self._wall_ids.isdisjoint(pair) for pair in new)
            self.wall_collisions += hits
            self.collisions += len(new) - hits

    def state(self) -> State:
        """State of the disks."""
        position, velocity, spin = np.empty((self.n, 2)), np.empty((self.n, 2)), np.empty(self.n)
        for i, disk in enumerate(self.disks):
            position[i] = self.p.getBasePositionAndOrientation(disk.body, physicsClientId=self.client)[0][:2]
            v, w = self.p.getBaseVelocity(disk.body, physicsClientId=self.client)
            velocity[i], spin[i] = v[:2], w[2]
        return State(position, velocity, spin)
