"""Densities of disks: the part of an area that they cover, and how it raises the collision rate."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ..mpi import SERIAL, Communicator


def disk_area(radius: ArrayLike, comm: Communicator = SERIAL) -> float:
    """Area [length^2] of disks of these radii [length], shape (n,); of ranks, of those that all give."""
    return math.pi * float(comm.total(np.square(radius)))


def packing_fraction(covered: float, area: float) -> float:
    """Fraction of an area that disks cover, whose own area is `covered` [length^2]; infinite if there is none."""
    return covered / area if area > 0.0 else math.inf


def henderson(packing_fraction: float) -> float:
    """Contact value of equal hard disks, (1 - 7 phi / 16) / (1 - phi)^2: D. Henderson, Mol. Phys. 30, 971 (1975)."""
    return (1.0 - 7.0 * packing_fraction / 16.0) / (1.0 - packing_fraction) ** 2


def path_in_collisions(collisions: float, area_per_disk: float, diameter: float, contact: float) -> float:
    """Path [length] of a disk at the rms speed while it has so many collisions, of a contact value `contact`.

    It is `collisions` times the mean free path (`theory.mean_free_path`) times 2 / sqrt(pi), the rms over the mean
    speed.
    """
    return collisions * area_per_disk / (math.sqrt(2.0 * math.pi) * diameter * contact)
