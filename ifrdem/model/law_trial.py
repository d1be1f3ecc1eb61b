"""A law of one's own, tried on random pairs: does it keep disks apart, does it add energy?

Imports the kernels, and Taichi with them: import this module only after `backend.start`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..kernels.contact import try_law
from .ifr import EnergyWarning
from .law import CollisionLaw, compiled
from .state import Disks

from taichi.lang.exception import TaichiCompilationError  # isort: skip  (after the kernels, which silence its banner)

PAIRS = 4096
_ROUND_OFF = (
    1e-9  # of an impulse or an energy, in single precision too where its sums do not go into the state
)


def try_on(
    kind: type[CollisionLaw], table: NDArray[np.float64], disks: Disks, walls: Sequence[int], speed: float
) -> None:
    """Try a law on pairs drawn from these disks and walls, always the same ones.

    Angles are uniform, spins up to twice the speed at the rim, and speeds spread over 1e-3 to 10 times `speed`.

    Parameters
    ----------
    kind : class of laws
    table : array (M, M, c)
        Its coefficients for each pair of materials.
    disks : Disks
    walls : sequence of int
        Materials of the walls.
    speed : float
        The fastest at the start [length/time].

    Raises
    ------
    InputError
        If impulses are not finite, or too small to keep two disks from going through each other.

    Warns
    -----
    EnergyWarning
        Always: how many of these collisions added energy, and how much; others are not checked.
    """
    movable = np.flatnonzero(disks.movable)
    if not len(movable):
        return
    draw = np.random.default_rng(1)
    i, j = draw.choice(movable, PAIRS), draw.choice(disks.n, PAIRS)
    # One pair in 8 is with a wall, if there are walls: an infinite mass with the disk's own radius.
    wall = draw.random(PAIRS) < (0.125 if len(walls) else 0.0)
    of_wall = draw.choice(walls, PAIRS) if len(walls) else np.zeros(PAIRS)
    v = max(speed, 1e-30) * 10.0 ** draw.uniform(-3.0, 1.0, PAIRS)
    psi = np.radians(draw.uniform(-89.9, 89.9, PAIRS))
    rim = v * draw.uniform(-2.0, 2.0, (2, PAIRS))
    R_j = np.where(wall, disks.radius[i], disks.radius[j])
    still = wall | ~disks.movable[j]
    pairs = np.column_stack((
        disks.material[i], np.where(wall, of_wall, disks.material[j]),
        1.0 / disks.mass[i], disks.radius[i], disks.k[i],
        np.where(wall, 0.0, 1.0 / disks.mass[j]), R_j, disks.k[j],
        v * np.cos(psi), v * np.sin(psi), rim[0] / disks.radius[i], np.where(still, 0.0, rim[1] / R_j),
    ))  # fmt: skip
    found = np.zeros((PAIRS, 8))
    law: Any = kind  # mypy does not take a class for hashable
    try:
        try_law(compiled(law), np.ascontiguousarray(table), pairs, found)
    except TaichiCompilationError as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise InputError(
            f"law {kind.__name__}: Taichi cannot compile its collide(pair, coefficients), a static method that returns "
            f"P_n, P_t and T: {reason}"
        ) from error
    _refuse_too_weak(kind, pairs, found)
    gain = _energy(pairs, found[:, 2:]) / _energy(pairs, _before(pairs)) - 1.0
    gaining = np.count_nonzero(gain > _ROUND_OFF)
    outcome = (
        f"{gaining} did, one of them {100.0 * gain.max():.3g} % of the pair's" if gaining else "none did"
    )
    warnings.warn(
        f"law {kind.__name__}: whether it adds energy is not known as it is of the IFR law; of {PAIRS} random "
        f"collisions {outcome}. Simulation.dissipated_energy tells what becomes of it",
        EnergyWarning,
        stacklevel=4,
    )


def _refuse_too_weak(
    kind: type[CollisionLaw], pairs: NDArray[np.float64], found: NDArray[np.float64]
) -> None:
    P_n, least = found[:, 0], found[:, 1]
    wrong = ~np.isfinite(found).all(axis=1) | ~(P_n >= least * (1.0 - _ROUND_OFF))
    if wrong.any():
        c = int(np.argmax(wrong))
        raise InputError(
            f"law {kind.__name__}: disks of materials {pairs[c, 0]:.0f} and {pairs[c, 1]:.0f} that approach with "
            f"g_n = {pairs[c, 8]:.4g} get P_n = {P_n[c]:.4g}: a finite number, not below m_n g_n = {least[c]:.4g}, is "
            f"needed, and finite P_t and T; or they would go through each other ({np.count_nonzero(wrong)} of {PAIRS} "
            "random pairs)"
        )


def _before(pairs: NDArray[np.float64]) -> NDArray[np.float64]:
    zero = np.zeros(len(pairs))
    return np.column_stack((pairs[:, 8], pairs[:, 9], pairs[:, 10], zero, zero, pairs[:, 11]))


def _energy(pairs: NDArray[np.float64], motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Kinetic energy of each pair, of which j may be a wall."""
    energy = np.zeros(len(pairs))
    for inverse, radius, k, first in ((2, 3, 4, 0), (5, 6, 7, 3)):
        vx, vy, spin = motion[:, first : first + 3].T
        finite = pairs[:, inverse] > 0.0
        twice = vx**2 + vy**2 + (pairs[:, radius] * spin) ** 2 / pairs[:, k]
        energy += np.divide(0.5 * twice, pairs[:, inverse], where=finite, out=np.zeros(len(pairs)))
    return energy
