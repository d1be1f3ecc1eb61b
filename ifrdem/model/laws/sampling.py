"""A check of a custom law on random pairs: whether it keeps disks apart, and whether it adds energy."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import InputError, outside_level
from ...tools.checked import Array
from ..custom_code import is_custom, why_not_compiled
from ..state import Disks
from .law import OF_PAIR, CollisionLaw, EnergyWarning, check_law_constants, compiled

PAIRS = 4096
_ROUND_OFF = 1e-9  # of an impulse or energy, in single precision too where its sums do not go into the state


def is_sampled(kind: type[CollisionLaw]) -> bool:
    """True if laws of a class are tried on random pairs: all but those of this package with a proof."""
    return is_custom(kind) or not kind.is_passive


def check_by_sampling(
    kind: type[CollisionLaw], table: Array, disks: Disks, walls: Sequence[int], speed: float
) -> None:
    """Check a law on random pairs of these disks and walls, always the same ones.

    Angles are uniform, spins up to twice the speed at the rim, and speeds spread over 1e-3 to 10 times `speed`.
    InputError if impulses are not finite, or too small to keep two disks from going through each other. EnergyWarning
    if some of these collisions added energy: how many, and how much; InputError if the class says `is_passive`. Others
    are not checked.

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
    """
    from ...kernels.compiler.language import CompilationError
    from ...kernels.laws.contact import sample_law
    from ...kernels.layout import Uses

    check_law_constants(kind)
    movable = np.flatnonzero(disks.movable)
    if not len(movable):
        return
    draw = np.random.default_rng(1)
    i, j = draw.choice(movable, PAIRS), draw.choice(disks.n, PAIRS)
    # One pair in 8 is with a wall, if there are walls: flat, with the disk's own radius where a lever is needed.
    wall = draw.random(PAIRS) < (0.125 if len(walls) else 0.0)
    of_wall = draw.choice(walls, PAIRS) if len(walls) else np.zeros(PAIRS)
    v = max(speed, 1e-30) * 10.0 ** draw.uniform(-3.0, 1.0, PAIRS)
    psi = np.radians(draw.uniform(-89.9, 89.9, PAIRS))
    rim = v * draw.uniform(-2.0, 2.0, (2, PAIRS))
    R_j = np.where(wall, disks.radius[i], disks.radius[j])
    of_two = disks.radius[i] * R_j / (disks.radius[i] + R_j)
    still = wall | ~disks.movable[j]
    pairs = np.column_stack((
        disks.material[i], np.where(wall, of_wall, disks.material[j]),
        1.0 / disks.mass[i], disks.radius[i], disks.k[i],
        np.where(wall, 0.0, 1.0 / disks.mass[j]), R_j, disks.k[j],
        v * np.cos(psi), v * np.sin(psi), rim[0] / disks.radius[i], np.where(still, 0.0, rim[1] / R_j),
        np.where(wall, disks.radius[i], of_two),
    ))  # fmt: skip
    found = np.zeros((PAIRS, 8))
    law: Any = kind  # mypy does not take a class for hashable
    try:
        sample_law(Uses(collision_law=compiled(law)), np.ascontiguousarray(table), pairs, found)
    except CompilationError as error:
        reason = why_not_compiled(
            error,
            [kind.collide],
            {"pair": OF_PAIR, "law": kind.coefficients},
            "collide must return P_n, P_t and T",
        )
        raise InputError(f"law {kind.__name__}: cannot compile its collide: {reason}") from error
    _refuse_too_weak(kind, pairs, found)
    gain = _energy(pairs, found[:, 2:]) / _energy(pairs, _before(pairs)) - 1.0
    if gaining := np.count_nonzero(gain > _ROUND_OFF):
        most = f"one of them {100.0 * gain.max():.3g} % of the pair's"
        text = f"of {PAIRS} random collisions {gaining} added energy, {most}"
        if kind.is_passive:
            raise InputError(f"law {kind.__name__}: is_passive = True: must be False, because {text}")
        more = "dissipated_energy counts it as a negative loss"
        warnings.warn(f"law {kind.__name__}: {text}. {more}", EnergyWarning, stacklevel=outside_level())


def _refuse_too_weak(kind: type[CollisionLaw], pairs: Array, found: Array) -> None:
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


def _before(pairs: Array) -> Array:
    zero = np.zeros(len(pairs))
    return np.column_stack((pairs[:, 8], pairs[:, 9], pairs[:, 10], zero, zero, pairs[:, 11]))


def _energy(pairs: Array, motion: Array) -> Array:
    """Kinetic energy of each pair, of which j may be a wall."""
    energy = np.zeros(len(pairs))
    for inverse, radius, k, first in ((2, 3, 4, 0), (5, 6, 7, 3)):
        vx, vy, spin = motion[:, first : first + 3].T
        finite = pairs[:, inverse] > 0.0
        twice = vx**2 + vy**2 + (pairs[:, radius] * spin) ** 2 / pairs[:, k]
        energy += np.divide(0.5 * twice, pairs[:, inverse], where=finite, out=np.zeros(len(pairs)))
    return energy
