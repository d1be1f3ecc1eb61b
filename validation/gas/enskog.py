"""Monte Carlo of Enskog's equation: rough disks in a uniform flow u_x = y, in units of mass, diameter and shear rate.

The method is that of J. M. Montanero and A. Santos, Phys. Rev. E 54, 438 (1996), doi:10.1103/PhysRevE.54.438, with
Kac's process: in every step of `STEP` mean free times each disk has one partner, at a random angle, and both collide
with the probability dt 8 phi chi (g_n > 0). Velocities of colliding disks are uncorrelated before the collision.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ... import theory
from ...model.laws.collision import collide
from ...model.laws.ifr import IFRLaw
from ...tools.checked import Array

STEP = 0.02  # mean free times
K = 2.0  # homogeneous disks


class Step(NamedTuple):
    """The gas at the end of a step, and its pressure tensor over n, shape (2, 2), in two parts."""

    velocity: Array  # relative to the flow, shape (n, 2)
    spin: Array
    kinetic: Array  # in the middle of the step
    transferred: Array


def collision_factor(phi: float) -> float:
    """8 phi chi: collisions of a disk in a unit of time over the mean of max(g_n, 0)."""
    return 8.0 * phi * theory.contact_value(phi)


def time_step(phi: float, T: float) -> float:
    """Duration of a step of a gas of temperature T."""
    return STEP / (collision_factor(phi) * math.sqrt(T / math.pi))


def sheared_gas(law: IFRLaw, phi: float, T: float, T_rot: float, n: int, seed: int) -> Iterator[Step]:
    """Steps without end of a gas of n disks that starts with these temperatures, which also set the time step."""
    rng = np.random.default_rng(seed)
    velocity = rng.normal(size=(n, 2)) * math.sqrt(T)
    velocity -= velocity.mean(axis=0)  # which the flow would shear
    spin = rng.normal(size=n) * math.sqrt(8.0 * T_rot)
    often, dt = collision_factor(phi), time_step(phi, T)
    while True:
        velocity[:, 0] -= 0.5 * dt * velocity[:, 1]
        pair = rng.permutation(n).reshape(-1, 2)
        angle = rng.uniform(0.0, 2.0 * math.pi, n // 2)
        normal = np.stack((np.cos(angle), np.sin(angle)), axis=1)
        v = velocity[pair]
        v[:, 1, 0] += normal[:, 1]  # the flow between the two
        approach = np.sum((v[:, 0] - v[:, 1]) * normal, axis=1)
        hit = rng.random(n // 2) < dt * often * approach
        after = collide(law, normal[hit], np.ones(2), np.full(2, 0.5), np.full(2, K), v[hit], spin[pair[hit]])
        new = after.velocity.copy()
        kinetic = velocity.T @ velocity / n
        transferred = -np.einsum("ca,cb->ab", new[:, 0] - v[hit, 0], normal[hit]) / (n * dt)
        new[:, 1, 0] -= normal[hit, 1]
        velocity[pair[hit]], spin[pair[hit]] = new, after.spin
        velocity[:, 0] -= 0.5 * dt * velocity[:, 1]
        yield Step(velocity, spin, kinetic, transferred)
