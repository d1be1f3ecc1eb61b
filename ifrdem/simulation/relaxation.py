"""What is seen of a gas without places as it changes, and what it takes to go on with it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.state import Disks
from ..theory.sonine import sonine_coefficient


@dataclass(frozen=True)
class Relaxation:
    """How a homogeneous gas changed; q samples, s species.

    Attributes
    ----------
    time : array (q,)
        [time].
    collisions_per_disk : array (q,)
        Twice the collisions over the number of disks.
    T, T_rot : array (q,)
        m <v^2> / 2, relative to the mean velocity, and I <w^2>, of all disks [energy].
    a_2, a_2_rot : array (q,)
        <c^4> / (2 <c^2>^2) - 1 with c^2 = m v^2, and <W^4> / (3 <W^2>^2) - 1 with W^2 = I w^2: 0 for Gaussians at one
        temperature; nan where nothing moves.
    T_of, T_rot_of, a_2_of, a_2_rot_of, collisions_per_disk_of : array (q, s)
        The same of each species.
    energy : array (q,)
        Kinetic energy of all disks, with spins [energy].
    energy_input : array (q,)
        What the drive has given since the start, less what it took [energy].
    """

    time: NDArray[np.float64]
    collisions_per_disk: NDArray[np.float64]
    T: NDArray[np.float64]
    T_rot: NDArray[np.float64]
    a_2: NDArray[np.float64]
    a_2_rot: NDArray[np.float64]
    T_of: NDArray[np.float64]
    T_rot_of: NDArray[np.float64]
    a_2_of: NDArray[np.float64]
    a_2_rot_of: NDArray[np.float64]
    collisions_per_disk_of: NDArray[np.float64]
    energy: NDArray[np.float64]
    energy_input: NDArray[np.float64]


@dataclass(frozen=True)
class Checkpoint:
    """All that decides how a gas goes on, but for what it is made of: see `DSMC.resume`.

    Attributes
    ----------
    velocity : array (n, 2)
        [length/time].
    spin : array (n,)
        [rad/time].
    collisions_of_disks : array (n,)
        Collisions that each disk has had.
    time : float
        [time].
    energy_input : float
        What the drive has given so far [energy].
    batches, kicks : int
        How often random numbers were drawn, for collisions and for the drive.
    """

    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]
    collisions_of_disks: NDArray[np.int32]
    time: float
    energy_input: float
    batches: int
    kicks: int


def sample(
    disks: Disks,
    velocity: NDArray[np.float64],
    spin: NDArray[np.float64],
    hits: NDArray[np.int32],
    species: NDArray[np.intp],
) -> dict[str, Any]:
    """What `Relaxation` has of one time, but for that and what was put in.

    Parameters
    ----------
    disks : Disks
    velocity : array (n, 2)
        [length/time].
    spin : array (n,)
        [rad/time].
    hits : array (n,)
        Collisions that each disk has had.
    species : array (n,)
        0 to s - 1: what each disk is summed up with.
    """
    drift = np.sum(disks.mass[:, None] * velocity, axis=0) / disks.mass.sum()
    # Scaled so that their squares are twice the energies: disks of different masses can be summed up.
    c = np.sqrt(disks.mass)[:, None] * (velocity - drift)
    W = np.sqrt(disks.inertia) * spin
    members = [species == each for each in range(int(species.max()) + 1)]
    of = [_moments(c[own], W[own]) for own in members]
    whole = _moments(c, W)
    return {
        "collisions_per_disk": float(np.mean(hits)),
        **whole,
        **{f"{name}_of": np.array([each[name] for each in of]) for name in whole},
        "collisions_per_disk_of": np.array([float(np.mean(hits[own])) for own in members]),
        "energy": 0.5 * float(np.sum(disks.mass * np.sum(velocity**2, axis=1)) + np.sum(W**2)),
    }


def _moments(c: NDArray[np.float64], W: NDArray[np.float64]) -> dict[str, float]:
    """Temperatures and fourth cumulants of velocities times sqrt(m) and spins times sqrt(I)."""
    T, T_rot = 0.5 * float(np.mean(np.sum(c**2, axis=1))), float(np.mean(W**2))
    a_2_rot = float(np.mean((W**2 / T_rot) ** 2)) / 3.0 - 1.0 if T_rot > 0.0 else math.nan
    return {"T": T, "T_rot": T_rot, "a_2": sonine_coefficient(c), "a_2_rot": a_2_rot}
