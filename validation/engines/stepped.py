"""Collisions and gases in codes that advance by time steps: PyBullet and pymunk, each in its own world."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...model.state import Disks, State
from ...model.walls.wall import Wall
from ...tools.checked import Array
from ..paper import pairs
from ..paper.equations import Impact
from ..paper.pairs import After
from . import pymunk_world
from .bullet_world import BulletWorld, Surface
from .pymunk_world import PymunkWorld

World = type[BulletWorld] | type[PymunkWorld]

OVERLAP = 1e-6  # of a nominal contact, as a part of R_1 + R_2: Bullet's solver acts on what overlaps
INSTANT = 1e-9  # the step of a nominal contact, in R_1 / v_o: the line of centres turns by no more


def worlds() -> list[World]:
    """The worlds that can be used here; PyBullet's always is."""
    return [BulletWorld] if pymunk_world.absence() else [BulletWorld, PymunkWorld]


def not_measured() -> str:
    """Note of a table on a world that cannot be used here; empty if all can."""
    reason = pymunk_world.absence()
    return "" if reason is None else f"pymunk: not measured, {reason}."


def touch(
    world: World, impact: Impact, *, w_2o: ArrayLike = 0.0, seed: int = 1, along_y: bool = False
) -> After:
    """Every pair of `impact` collided by another code at its exact nominal geometry, in one step.

    Arguments as in `pairs.fly`; e_t, rho and k of the impact beyond what such codes know are not used. The disks
    are placed touching (overlapping by OVERLAP) with their velocities of approach. Lines of centres have random
    directions, or all lie along y, where Bullet's contact normals are exact.
    """
    return _collide(world, impact, w_2o, seed, None, along_y)


def fly(world: World, impact: Impact, step: float, *, w_2o: ArrayLike = 0.0, seed: int = 1) -> After:
    """Every pair of `impact` flown into each other, contact at a random phase of a time step, in R_1 / v_o."""
    return _collide(world, impact, w_2o, seed, step)


def _collide(
    world: World, impact: Impact, w_2o: ArrayLike, seed: int, step: float | None, along_y: bool = False
) -> After:
    c, _, w_2o = pairs.broadcast(impact, "contact_point", w_2o)
    n = len(c.psi)
    direction, phase = geometry(n, seed)
    if along_y:
        direction = np.full(n, 0.5 * np.pi)
    normal = pairs.directions(direction)
    v_1 = pairs.approach(c, normal)
    velocity = np.stack([v_1, np.zeros_like(v_1)], axis=1)
    spin = np.stack([c.w_o, -w_2o], axis=1)
    sigma = c.R_1 + c.R_2
    # Pairs that differ by their velocities alone share a world.
    columns = np.stack([c.m_1, c.M, c.R_1, c.R_2, c.k_1, c.k_2, c.e_n, c.mu, c.v_o], axis=1)
    kinds, which = np.unique(columns, axis=0, return_inverse=True)
    for kind, (m_1, M, R_1, R_2, k_1, k_2, e_n, mu, v_o) in enumerate(kinds):
        disks = Disks(2, mass=np.array([m_1, m_1 / M]), radius=np.array([R_1, R_2]), k=np.array([k_1, k_2]))
        dt = (INSTANT if step is None else step) * R_1 / v_o
        with world(disks, Surface(e_n, mu), time_step=dt) as one:
            for i in np.flatnonzero(which.reshape(-1) == kind):
                at = np.stack([-sigma[i] * normal[i], np.zeros(2)])
                if step is None:
                    at[0] *= 1.0 - OVERLAP
                    if world.moves_first:
                        at = at - velocity[i] * dt
                    steps = 1
                else:
                    # Five steps cover the contact, which falls between the second and the third, and the next
                    # one, for codes that answer later.
                    at = at - velocity[i] * (2.0 + phase[i]) * dt
                    steps = 5
                apart = at + 1e3 * sigma[i] * np.array([[0.0, 0.0], [1.0, 0.0]])
                one.place(apart, np.zeros((2, 2)), np.zeros(2))
                one.step()  # forgets the last contact
                one.place(at, velocity[i], spin[i])
                one.step(steps)
                state = one.state()
                velocity[i], spin[i] = state.velocity, state.spin
    return After.seen(c, w_2o, normal, velocity, spin)


def geometry(n: int, seed: int) -> tuple[Array, Array]:
    """Random directions of lines of centres [rad], and phases of the step at which disks meet, 0 to 1, shape (n,)."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(size=n)


def deviation(got: After, right: After) -> Array:
    """Largest difference of any velocity and R omega, in units of v_o, shape (n,)."""
    names = ("v_1n", "v_1t", "v_2n", "v_2t", "Rw_1", "Rw_2")
    differences = [np.abs(getattr(got, name) - getattr(right, name)) for name in names]
    return np.max(differences, axis=0) / np.asarray(got.impact.v_o)


@dataclass(frozen=True)
class Snapshots:
    """A gas at a number of times."""

    states: list[State]
    collisions: NDArray[np.int64]  # counted from the start, shape (times,)
    wall_collisions: NDArray[np.int64]
    seconds: float  # processor time of the steps or events alone

    def energy(self, disks: Disks) -> tuple[Array, Array]:
        """Translational and rotational energy [energy], shape (times,)."""
        moving = [0.5 * float(np.sum(disks.mass * np.sum(s.velocity**2, axis=1))) for s in self.states]
        turning = [0.5 * float(np.sum(disks.inertia * s.spin**2)) for s in self.states]
        return np.array(moving), np.array(turning)


def gas(
    world: World, disks: Disks, surface: Surface, walls: Sequence[Wall], start: State, *, time_step: float,
    steps: Sequence[int],
) -> Snapshots:  # fmt: skip
    """Run a gas from `start` and look at it after so many steps each."""
    states, counts, seconds = [], [], 0.0
    with world(disks, surface, walls=walls, time_step=time_step) as one:
        one.place(start.position, start.velocity, start.spin)
        done = 0
        for number in steps:
            began = time.process_time()
            one.step(number - done)
            seconds += time.process_time() - began
            done = number
            states.append(one.state())
            counts.append((one.collisions, one.wall_collisions))
    collisions, wall_collisions = np.array(counts, dtype=np.int64).T
    return Snapshots(states, collisions, wall_collisions, seconds)
