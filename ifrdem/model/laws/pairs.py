"""The laws of all pairs of materials of a gas, which are checked here and nowhere else."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InputError, shortened
from ...tools.checked import MOST, Array
from ..state import Disks, unlike
from .law import CollisionLaw
from .sampling import check_by_sampling, is_sampled

Laws = list[list[CollisionLaw]]
MEAN_APPROACH = math.sqrt(0.5 * math.pi)
"""Mean of g_n over collisions of equal disks in a Maxwellian gas, per rms speed."""
MOST_COEFFICIENT = {"f32": 1e30, "f64": MOST}
"""Largest coefficient of a law: products of it with impulses and masses are formed."""


@dataclass(frozen=True)
class PairLaws:
    """Laws of one class for all pairs of materials of a gas.

    Attributes
    ----------
    table : list of lists of CollisionLaw
        `[material][material]`, symmetric.
    kind : class of laws
    coefficients : array (M, M, c)
        What kernels take (`table_row`). A law without any has a column of zeros.
    """

    table: Laws
    kind: type[CollisionLaw]
    coefficients: Array

    @classmethod
    def of(
        cls,
        law: CollisionLaw | Sequence[Sequence[CollisionLaw]],
        disks: Disks,
        of_walls: Iterable[int] = (),
        precision: str = "f64",
    ) -> PairLaws:
        """The laws of these disks and of walls of the materials `of_walls`: one law for all, or a table.

        InputError if it is neither, not square, too small for the materials that are there, or not symmetric; if laws
        are of several classes; if one could add energy for a pair that is there; or if the precision cannot hold a
        coefficient.
        """
        of_walls = set(of_walls)
        table = table_of(law, max(int(disks.material.max()) if disks.n else 0, *of_walls, 0) + 1)
        kind = _kind(table, table_given=not isinstance(law, CollisionLaw))
        check_symmetric(table)
        _check_energy(table, disks, of_walls)
        coefficients = rows_of(table)
        _check_magnitudes(coefficients, precision)
        return cls(table, kind, coefficients)

    @property
    def is_passive(self) -> bool:
        """True if it is known that no collision adds energy."""
        return self.kind.is_passive

    def check_speed(self, disks: Disks, speed_rms: float) -> None:
        """Refuse laws that hold for no pair of these disks at the mean approach speed of disks with this rms speed.

        Collisions of a Maxwellian gas have sqrt(pi / 2) of the rms speed as mean of g_n. The law is taken at its most
        elastic: of the heaviest disks, with the smallest radius; of one disk and a flat wall where no disk has one of
        the two materials.
        """
        movable = np.isfinite(disks.mass)
        if speed_rms == 0.0 or not movable.any():
            return
        m, radius, of_disks = (
            float(disks.mass[movable].max()),
            float(disks.radius.min()),
            {*disks.material.tolist()},
        )
        for i, row in enumerate(self.table):
            for j, law in enumerate(row):
                number = 2 if {i, j} <= of_disks else 1  # of disks that move, whose variances and 1/m add
                law.check_speed(
                    MEAN_APPROACH * speed_rms * math.sqrt(number / 2), m / number, radius / number
                )

    @property
    def is_sampled(self) -> bool:
        """True if `check_by_sampling` tries the laws: custom ones, also those that say that they are passive."""
        return is_sampled(self.kind)

    def check_by_sampling(self, disks: Disks, of_walls: Sequence[int], speed: float) -> None:
        """Try laws that `is_sampled` on random pairs (`sampling.py`)."""
        if self.is_sampled:
            check_by_sampling(self.kind, self.coefficients, disks, of_walls, speed)


def rows_of(table: Sequence[Sequence[CollisionLaw]]) -> Array:
    """Coefficients of a table of laws (`table_row`), shape (M, M, c); a zero for a law without any."""
    return np.array([[one.table_row() or (0.0,) for one in row] for row in table], dtype=np.float64)


def table_of(law: Any, materials: int) -> Laws:
    """One law for all pairs of so many materials as a table, or a table that is large enough."""
    if isinstance(law, CollisionLaw):
        return [[law] * materials for _ in range(materials)]
    if not isinstance(law, Sequence) or isinstance(law, str):
        unknown: Any = law
        _kind([[unknown]], table_given=False)  # refuses it by name
    if not all(isinstance(row, Sequence) for row in law):
        raise InputError("law table: must be a list of lists of laws, [[law]], or one law for all")
    table = [list(row) for row in law]
    if len(table) < materials or any(len(row) != len(table) for row in table):
        lengths = {len(row) for row in table}
        shape = (
            f"of shape ({len(table)}, {lengths.pop()})"
            if len(lengths) == 1
            else f"of {len(table)} unequal rows"
        )
        raise InputError(f"law = table {shape}: must be a square table of at least {materials} materials")
    return table


def _kind(table: Laws, table_given: bool) -> type[CollisionLaw]:
    """The one class of all laws of a table.

    InputError if one is no law, or says not how disks collide, or there are several classes.
    """
    kinds: list[type[CollisionLaw]] = []
    for a, b in ((a, b) for a, row in enumerate(table) for b in range(len(row))):
        law = table[a][b]
        kind: Any = type(law)
        if not isinstance(law, CollisionLaw) or kind.collide is CollisionLaw.collide:
            place = f"law[{a}][{b}]" if table_given else "law"
            raise InputError(
                f"{place} = {shortened(law)}: must be an IFRLaw, or an object of a class derived from "
                "ifrdem.CollisionLaw with a method collide"
            )
        if kind not in kinds:
            kinds.append(kind)
    if len(kinds) > 1:
        raise InputError(
            f"law table: laws of {len(kinds)} classes, {', '.join(kind.__name__ for kind in kinds)}: one class serves "
            "a whole simulation; write one whose collide distinguishes them by a coefficient"
        )
    return kinds[0]


def check_symmetric(table: Sequence[Sequence[CollisionLaw]]) -> None:
    """Refuse a table in which a pair has two laws."""
    for a, row in enumerate(table):
        for b, one in enumerate(row[:a]):
            if one.table_row() != table[b][a].table_row():
                raise InputError(f"law table: [{b}][{a}] and [{a}][{b}] differ; a pair has one law")


def _check_energy(laws: Laws, disks: Disks, of_walls: Collection[int]) -> None:
    """Refuse a law that could add energy for a pair that is there, walls of the materials `of_walls` included.

    Of disks with one k and material, the lightest and the heaviest decide: the mean k of a
    pair lies between those of these two.
    """
    of_disks, k, mass = unlike([disks.material, disks.k, disks.mass])
    kinds, which = np.unique(np.stack([of_disks, k], axis=1), axis=0, return_inverse=True)
    lightest, heaviest = np.full(len(kinds), np.inf), np.zeros(len(kinds))
    np.minimum.at(lightest, which.ravel(), mass)
    np.maximum.at(heaviest, which.ravel(), mass)
    for one, (a, k_a) in enumerate(kinds):
        for other in range(one, len(kinds)):
            b, k_b = kinds[other]
            for m_a, m_b in {(lightest[one], heaviest[other]), (heaviest[one], lightest[other])}:
                if math.isinf(m_a) and math.isinf(m_b):
                    continue  # neither moves: they never meet
                laws[int(a)][int(b)].check(k_a, k_b, m_a, m_b)
    for material in of_walls:
        for a, k_a in kinds:
            # With a wall's infinite mass, the pair's mean k is that of the disk.
            laws[int(a)][material].check(k_a, k_a)


def _check_magnitudes(coefficients: Array, precision: str) -> None:
    """Refuse coefficients that the precision cannot hold: an infinite one would not stay a number."""
    most = MOST_COEFFICIENT.get(precision, np.inf)  # the engine refuses others
    largest = float(np.abs(coefficients).max(initial=0.0))
    if not largest <= most:
        raise InputError(
            f"law: a coefficient of {largest:.3g} is beyond {most:g}, what {precision} can compute with"
        )
