"""Replicas of a gas, and a comparison of their mean with a number from elsewhere: statistics never tuned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .. import placement
from ..box import Box
from ..law import IFRLaw
from ..simulation import Simulation
from ..state import Disks, State
from .registry import Result, Row, Sampling

CHANCE = 6.334e-5
"""By which chance alone a row may fail: that of a Gaussian value to be off by 4 standard errors, so that of 200 rows
all pass in 99 of 100 runs. Of few replicas Student's t makes it more than 4 errors."""
STRIDE = 10_000
"""Seeds of `--seed n` and of `--seed n + 1` are so far apart; no case needs as many."""

ELASTIC = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)


def seeds_of(seed: int, replicas: int, begin: int = 0) -> range:
    """The seeds of replicas: those of another `seed` all differ, and so do those of another part of a case."""
    first = STRIDE * seed + begin
    return range(first, first + replicas)


def student(replicas: int) -> float:
    """How many standard errors the mean of so many values may be off, with `CHANCE` of more."""
    from scipy.stats import t

    return float(t.isf(0.5 * CHANCE, replicas - 1))


@dataclass(frozen=True)
class Mean:
    """Mean of replicas and its standard error, from their scatter."""

    value: float
    error: float
    replicas: int

    @classmethod
    def of(cls, values: ArrayLike) -> Mean:
        """Of two values at least."""
        each = np.asarray(values, dtype=float)
        return cls(float(each.mean()), float(each.std(ddof=1) / math.sqrt(len(each))), len(each))


def compare(
    result: Result,
    quantity: str,
    values: ArrayLike,
    expected: float | Mean,
    *,
    disks: int,
    seeds: Sequence[int],
    systematic: float,
    why: str,
    source: str,
) -> None:
    """Add a row: the mean of replicas against a number, or against the mean of other replicas.

    Parameters
    ----------
    values : array_like (replicas,)
        One of each replica; they are independent.
    expected : float or Mean
        If a mean, its error counts too.
    disks : int
        How many a replica has.
    systematic : float
        How far the expected value itself, or what it assumes, may be off; `why` says why.
    """
    found = Mean.of(values)
    right, error, replicas = expected, found.error, found.replicas
    if isinstance(expected, Mean):
        right, error = expected.value, math.hypot(error, expected.error)
        replicas = min(replicas, expected.replicas)
    z = student(replicas)
    sampling = Sampling(disks, (min(seeds), max(seeds)), found.replicas, error, z, systematic)
    result.rows.append(
        Row(
            quantity,
            found.value,
            float(right),  # type: ignore[arg-type]
            z * error + systematic,
            f"{z:.1f} standard errors (4 of a Gaussian; Student's t of {replicas} replicas), and {why}",
            source,
            sampling=sampling,
        )
    )


def equal_disks(n: int) -> Disks:
    """Homogeneous disks of mass and diameter 1."""
    return Disks(n, mass=np.full(n, 1.0), radius=np.full(n, 0.5))


def start(
    n: int, packing_fraction: float, seed: int, *, T: float = 1.0, T_rot: float = 0.0
) -> tuple[Disks, Box, State]:
    """Equal disks of mass and diameter 1 on a lattice, Maxwellian; the box and the state."""
    disks = equal_disks(n)
    box = Box.from_packing_fraction(disks.radius, packing_fraction)
    spin_rms = math.sqrt(T_rot / float(disks.inertia[0]))
    return (
        disks,
        box,
        State(
            placement.hexagonal_positions(box, disks.radius, seed=seed),
            placement.maxwellian(disks.mass, temperature=T, seed=seed),
            placement.gaussian_spins(n, spin_rms=spin_rms, seed=seed),
        ),
    )


def fluid(
    n: int, packing_fraction: float, seed: int, *, melting: float, T: float = 1.0, T_rot: float = 0.0
) -> tuple[Disks, Box, State]:
    """The same after `melting` elastic collisions per disk, without memory of the lattice; time and counts at 0."""
    disks, box, begin = start(n, packing_fraction, seed, T=T, T_rot=T_rot)
    gas = Simulation(disks, box, ELASTIC, begin)
    gas.run(collisions_per_disk=melting)
    end = gas.state
    return disks, box, State(end.position, end.velocity, end.spin)
