"""Replicas of a gas, and a comparison of their mean with a number from elsewhere: statistics never tuned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...initial import placement
from ...model.box import Box
from ...model.laws.ifr import IFRLaw
from ...model.laws.law import CollisionLaw
from ...model.observables import Measure
from ...model.state import Disks, State
from ...model.walls.wall import Wall
from ...simulation.simulation import Simulation
from ...tools.checked import Array
from ..report.registry import Result, Row, Sampling

CHANCE = 6.334e-5
"""By which chance alone a row may fail: that of a Gaussian value to be off by 4 standard errors, so that of 300 rows
all pass in 98 of 100 runs. Of few replicas Student's t makes it more than 4 errors."""
STRIDE = 10_000
"""Seeds of `--seed n` and of `--seed n + 1` are so far apart; no case needs as many."""

ELASTIC = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)


def seeds_of(seed: int, replicas: int, begin: int = 0) -> range:
    """The seeds of replicas: those of another `seed` all differ, and so do those of another part of a case."""
    first = STRIDE * seed + begin
    return range(first, first + replicas)


def student(freedom: float) -> float:
    """Standard errors that a mean may be off, with `CHANCE` of more: their own degrees of freedom decide."""
    from scipy.stats import t

    return float(t.isf(0.5 * CHANCE, freedom))


@dataclass(frozen=True)
class Mean:
    """Mean of replicas and its standard error, from their scatter; of one replica, an error that is known."""

    value: float
    error: float
    replicas: int

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the error."""
        return self.replicas - 1.0 if self.replicas > 1 else math.inf

    @classmethod
    def of(cls, values: ArrayLike) -> Mean:
        """Of two values at least."""
        each = np.asarray(values, dtype=float)
        return cls(float(each.mean()), float(each.std(ddof=1) / math.sqrt(len(each))), len(each))

    def times(self, factor: float) -> Mean:
        """The mean of values that are all so many times as large."""
        return Mean(factor * self.value, abs(factor) * self.error, self.replicas)


def ratio(above: ArrayLike, below: ArrayLike) -> Array:
    """Values whose mean is the ratio of two means over replicas, and whose scatter is that ratio's, to first order.

    The mean of ratios would be off by the variance of what stands below.
    """
    a, b = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    whole = a.mean() / b.mean()
    return np.asarray(whole + (a - whole * b) / b.mean())


def compare(
    result: Result,
    quantity: str,
    values: ArrayLike | Mean,
    expected: float | Mean,
    *,
    disks: int,
    seeds: Sequence[int],
    systematic: float,
    why: str,
    source: str,
    widest: float,
) -> None:
    """Add a row: the mean of replicas against a number, or against the mean of other replicas.

    Parameters
    ----------
    values : array_like (replicas,) or Mean
        One of each replica; they are independent.
    expected : float or Mean
        If a mean, its error counts too; degrees of freedom are then Welch's (Biometrika 34, 28 (1947)).
    disks : int
        How many a replica has.
    systematic : float
        How far the expected value itself, or what it assumes, may be off; `why` says why.
    widest : float
        The largest tolerance, relative to the expected value, with which the row says something: see `Sampling`.
    """
    found = values if isinstance(values, Mean) else Mean.of(values)
    right, error, freedom = expected, found.error, found.freedom
    if isinstance(expected, Mean):
        right, error = expected.value, math.hypot(found.error, expected.error)
        freedom = error**4 / sum(one.error**4 / one.freedom for one in (found, expected))
    right, z, span = float(right), student(freedom), (min(seeds), max(seeds))  # type: ignore[arg-type]
    sampling = Sampling(disks, span, found.replicas, error, z, systematic, widest * abs(right), freedom)
    text = f"statistical (as many standard errors as Student's t says); systematic: {why}"
    tolerance = z * error + systematic
    result.rows.append(Row(quantity, found.value, right, tolerance, text, source, sampling=sampling))


def add_chi_square(result: Result, quantity: str, rows: Sequence[Row], source: str) -> None:
    """Add a row: chi-square of rows that are independent of each other.

    Of each row, what its deviation exceeds the systematic tolerance by, in standard errors; a value of Student's t
    counts as the Gaussian one that is as improbable. If systematic tolerances are all needed, chi-square is that of
    as many degrees of freedom as there are rows; if they are not, it is less.
    """
    from scipy.stats import chi2, t

    total = 0.0
    for row in rows:
        s = row.sampling
        if s is None:
            raise ValueError(f"{row.quantity}: nothing random")
        off = max(0.0, abs(row.measured - row.expected) - s.systematic) / s.error
        total += float(chi2.isf(2.0 * t.sf(off, s.freedom), 1))
    n = len(rows)
    most = float(chi2.isf(CHANCE, n))
    result.near(
        f"chi-square of {n} rows: {quantity} (probability of more: {chi2.sf(total, n):.2g})", total, n, most - n,
        f"{most:.1f}, which chi-square of as many degrees of freedom exceeds as rarely as a Gaussian 4 errors", source,
    )  # fmt: skip


def equal_disks(n: int) -> Disks:
    """Homogeneous disks of mass and diameter 1."""
    return Disks(n, mass=np.full(n, 1.0), radius=np.full(n, 0.5))


def thermal(n: int, seed: int, *, T: float = 1.0, T_rot: float = 0.0) -> tuple[Disks, Array, Array]:
    """Equal disks of mass and diameter 1, Maxwellian velocities and Gaussian spins."""
    disks = equal_disks(n)
    velocity = placement.maxwellian(disks.mass, temperature=T, seed=seed)
    spin_rms = math.sqrt(T_rot / float(disks.inertia[0]))
    return disks, velocity, placement.gaussian_spins(n, spin_rms=spin_rms, seed=seed)


def scattered(disks: Disks, box: Box, seed: int, walls: Sequence[Wall] = (), **speed: float) -> State:
    """Disks at random places, with Maxwellian velocities of a `temperature` or `speed_rms`, without spins."""
    position = placement.random_positions(box, disks.radius, seed=seed, walls=walls)
    return State(position, placement.maxwellian(disks.mass, seed=seed, **speed), np.zeros(disks.n))


LOOSE = 0.3  # packing fraction up to which disks find random places, which are almost those of the fluid


def fluid(
    n: int,
    packing_fraction: float,
    seed: int,
    law: CollisionLaw = ELASTIC,
    *,
    melting: float,
    T: float = 1.0,
    T_rot: float = 0.0,
    **options: Any,
) -> Simulation:
    """A gas of `thermal` disks without memory of its first places, random or, where dense, of a lattice.

    It had `melting` elastic collisions per disk; time and counts are 0. `options` as of a `Simulation`.
    """
    disks, velocity, spin = thermal(n, seed, T=T, T_rot=T_rot)
    box = Box.from_packing_fraction(disks.radius, packing_fraction)
    place = placement.random_positions if packing_fraction <= LOOSE else placement.hexagonal_positions
    gas = Simulation(disks, box, ELASTIC, State(place(box, disks.radius, seed=seed), velocity, spin))
    gas.run(collisions_per_disk=melting)
    return restarted(gas, law, seed=seed, **options)


def restarted(gas: Simulation, law: CollisionLaw = ELASTIC, **options: Any) -> Simulation:
    """A simulation from the present state of another one in a box without walls, time and counts at 0."""
    now = gas.state
    return Simulation(gas.disks, gas.box, law, State(now.position, now.velocity, now.spin), **options)


def sampled_run(gas: Simulation, frames: int, **end: Any) -> tuple[list[State], list[Measure]]:
    """States and measures of a run to an end (`t_end`, `collisions_per_disk`): at its start, and at even times."""
    seen: list[tuple[State, Measure]] = []
    gas.run(frames=frames, frame_callbacks=[lambda *one: seen.append(one)], **end)
    states, measures = zip(*seen, strict=True)
    return list(states), list(measures)
