"""The laws of all pairs of materials: as a table, and whether any of them could add energy.

`try_on` tries a law of one's own on random pairs: it keeps disks apart, or not; it adds energy, or not.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..tools.checked import Array
from .ifr import EnergyWarning
from .law import CollisionLaw, checked_class, compiled
from .state import Disks

PAIRS = 4096
_ROUND_OFF = 1e-9  # of an impulse or energy, in single precision too where its sums do not go into the state


def try_on(kind: type[CollisionLaw], table: Array, disks: Disks, walls: Sequence[int], speed: float) -> None:
    """Try a law on pairs drawn from these disks and walls, always the same ones.

    Angles are uniform, spins up to twice the speed at the rim, and speeds spread over 1e-3 to 10 times `speed`.
    InputError if impulses are not finite, or too small to keep two disks from going through each other. EnergyWarning
    if some of these collisions added energy: how many, and how much; others are not checked.

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
    from taichi.lang.exception import TaichiCompilationError

    from ..kernels.contact import try_law

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
    if gaining := np.count_nonzero(gain > _ROUND_OFF):
        most = f"one of them {100.0 * gain.max():.3g} % of the pair's"
        text = f"of {PAIRS} random collisions {gaining} added energy, {most}"
        more = "Simulation.dissipated_energy tells what becomes of it"
        warnings.warn(f"law {kind.__name__}: {text}. {more}", EnergyWarning, stacklevel=4)


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


def law_table(
    law: CollisionLaw | Sequence[Sequence[CollisionLaw]], disks: Disks, most_of_walls: int = 0
) -> list[list[CollisionLaw]]:
    """The table [material][material] of one law for all, or of a table that is checked.

    InputError if it is neither, not square, too small for the materials that are there, or not symmetric.

    Parameters
    ----------
    law : CollisionLaw or sequence of sequences of CollisionLaw
    disks : Disks
    most_of_walls : int
        The highest material of walls.
    """
    materials = max(int(disks.material.max()) if disks.n else 0, most_of_walls) + 1
    if isinstance(law, CollisionLaw):
        return [[law] * materials for _ in range(materials)]
    if not isinstance(law, Sequence) or isinstance(law, str):
        checked_class([[law]])  # refuses it by name
    if not all(isinstance(row, Sequence) for row in law):
        raise InputError("law table: a list of lists of laws, [[law]], is needed, or one law for all")
    table = [list(row) for row in law]
    if len(table) < materials or any(len(row) != len(table) for row in table):
        raise InputError(f"law table: a square table of at least {materials} materials is needed")
    checked_class(table)
    for a, row in enumerate(table):
        for b, one in enumerate(row):
            if one.table_row() != table[b][a].table_row():
                raise InputError(f"law table: [{a}][{b}] and [{b}][{a}] differ; a pair has one law")
    return table


def check_energy(laws: list[list[CollisionLaw]], disks: Disks, of_walls: Iterable[int] = ()) -> None:
    """Refuse a law that could add energy for a pair that is there, walls of the materials `of_walls` included.

    Of disks with one k and material, the lightest and the heaviest decide: see `pairing`.
    """
    kinds, which = np.unique(np.stack([disks.material, disks.k], axis=1), axis=0, return_inverse=True)
    lightest, heaviest = np.full(len(kinds), np.inf), np.zeros(len(kinds))
    np.minimum.at(lightest, which.ravel(), disks.mass)
    np.maximum.at(heaviest, which.ravel(), disks.mass)
    for one, (a, k_a) in enumerate(kinds):
        for other in range(one, len(kinds)):
            b, k_b = kinds[other]
            for m_a, m_b in {(lightest[one], heaviest[other]), (heaviest[one], lightest[other])}:
                if math.isinf(m_a) and math.isinf(m_b):
                    continue  # neither moves: they never meet
                laws[int(a)][int(b)].check(k_a, k_b, m_a, m_b)
    for material in set(of_walls):
        for a, k_a in kinds:
            # Beside a wall's infinite mass, the pair's mean k is the disk's own.
            laws[int(a)][material].check(k_a, k_a)


def coefficient_table(laws: list[list[CollisionLaw]]) -> Array:
    """The coefficients as kernels take them, shape (M, M, c). A law without any has a column of zeros."""
    return np.array([[one.table_row() or (0.0,) for one in row] for row in laws])
