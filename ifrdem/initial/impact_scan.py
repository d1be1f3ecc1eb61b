"""An impact scan: pairs of disks, one of each at rest and hit by the other, at many angles of impact.

The experiment of A. Domenech-Carbo et al., "Independent friction-restitution modeling of two-disk collisions". Pairs
stand far apart in open space; all meet at one time. The first half of the disks hits the second half.
"""

from __future__ import annotations

import math

import numpy as np

from ..model.state import Disks
from ..tools import seeds
from ..tools.checked import Array
from .from_csv import StartData

PATCH = 8.0  # side of a pair's patch, in largest contact distances
APPROACH = 0.5  # flight before the contact, in contact distances


def angles(n: int, psi: tuple[float, float]) -> Array:
    """Angles of impact of n pairs from the line of centres [rad], evenly from the first to the last [degrees]."""
    return np.radians(np.linspace(*psi, n))


def start(disks: Disks, psi: tuple[float, float], speed: float, *, seed: int) -> StartData:
    """Positions and velocities of the pairs: disk p hits disk n/2 + p, of an even number n.

    `psi` are the first and last angle of impact [degrees], `speed` [length/time] is of those that hit, and the
    directions of the lines of centres are random by the `seed`.
    """
    n = disks.n // 2
    sigma = disks.radius[:n] + disks.radius[n:]
    side, across = PATCH * float(sigma.max(initial=0.0)), math.ceil(math.sqrt(max(n, 1)))
    cell = np.stack(np.divmod(np.arange(n), across), axis=1)
    direction = seeds.stream(seed, seeds.POSITIONS).uniform(0.0, 2.0 * np.pi, n)
    normal = np.stack([np.cos(direction), np.sin(direction)], axis=1)
    heading = direction + angles(n, psi)
    velocity = speed * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    hit = (cell + 0.5) * side
    # All at the same distance from contact along their flights, so that all touch at the time APPROACH sigma / speed.
    hitting = hit - sigma[:, None] * normal - (APPROACH * float(sigma.min(initial=1.0)) / speed) * velocity
    return StartData(
        position=np.concatenate([hitting, hit]),
        velocity=np.concatenate([velocity, np.zeros_like(velocity)]),
        spin=np.zeros(2 * n),
    )


def line_of_centres(position: Array, velocity: Array, sigma: Array) -> Array:
    """Unit vectors from the disks that hit to those that are hit, at their contact, shape (n, 2).

    From a start: position and velocity (n, 2, 2) of the disk that hits and of the one that is hit, and contact
    distances sigma (n,).
    """
    r, v = position[:, 1] - position[:, 0], velocity[:, 1] - velocity[:, 0]
    b, c, v2 = np.sum(r * v, axis=1), np.sum(r * r, axis=1) - sigma**2, np.sum(v * v, axis=1)
    time = c / (np.sqrt(b * b - v2 * c) - b)
    touching = r + v * time[:, None]
    found: Array = touching / np.linalg.norm(touching, axis=1)[:, None]
    return found
