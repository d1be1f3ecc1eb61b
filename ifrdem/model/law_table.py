"""The laws of all pairs of materials: as a table, and whether any of them could add energy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .law import CollisionLaw, checked_class
from .state import Disks


def law_table(
    law: CollisionLaw | Sequence[Sequence[CollisionLaw]], disks: Disks, most_of_walls: int = 0
) -> list[list[CollisionLaw]]:
    """The table [material][material] of one law for all, or of a table that is checked.

    Parameters
    ----------
    law : CollisionLaw or sequence of sequences of CollisionLaw
    disks : Disks
    most_of_walls : int
        The highest material of walls.

    Raises
    ------
    InputError
        If it is neither, not square, too small for the materials that are there, or not symmetric.
    """
    materials = max(int(disks.material.max()) if disks.n else 0, most_of_walls) + 1
    if isinstance(law, CollisionLaw):
        return [[law] * materials for _ in range(materials)]
    if not isinstance(law, Sequence):
        checked_class([[law]])  # refuses it by name
    table = [list(row) for row in law]
    if len(table) < materials or any(len(row) != len(table) for row in table):
        raise InputError(f"law table: a square table of at least {materials} materials is needed")
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


def coefficient_table(laws: list[list[CollisionLaw]]) -> NDArray[np.float64]:
    """The coefficients as kernels take them, shape (M, M, c). A law without any has a column of zeros."""
    return np.array([[one.table_row() or (0.0,) for one in row] for row in laws])
