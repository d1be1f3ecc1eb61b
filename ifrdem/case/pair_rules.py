"""The pairs of species: which coefficients they collide with, and whether those can add energy."""

from __future__ import annotations

import contextlib
import itertools
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from ..errors import InputError, nearest
from ..model.coin_table import coins
from ..model.ifr import COEFFICIENTS, EnergyWarning, IFRLaw
from .case import CaseSections
from .species import Species


class PairVerdict(NamedTuple):
    """Verdict on the law of two species, or of one and walls of a material: it may add energy, or is missing."""

    first: str
    second: str
    key: str
    admissible: bool
    strict: bool
    message: str
    law: IFRLaw | None
    materials: frozenset[str] = frozenset()


Coefficients = tuple[str, dict[str, Any]]
"""The key that coefficients come from, and what a law is made of."""


def _of_law(key: str, law: IFRLaw, **other: Any) -> Coefficients:
    return key, {name: getattr(law, name) for name in COEFFICIENTS} | other


def _coefficients(case: CaseSections, a: str, b: str) -> Coefficients | str | None:
    """The coefficients of a pair of materials; what is wrong if there are none; None if that cannot be told."""
    if a != b:
        for i, pair in enumerate(case.pair):
            if set(pair.materials) == {a, b}:
                return f"pair[{i}]", pair.model_dump(exclude={"materials"})
        coin_a, coin_b = _coin_of(case, a), _coin_of(case, b)
        if coin_a is not None and coin_b is not None:
            with contextlib.suppress(InputError):  # the paper did not measure this pair: the case has to say
                return _of_law(f"'{coin_a}' with '{coin_b}'", coins.pair(coin_a, coin_b))
        return f"missing for the materials '{a}' and '{b}': give their e_n, e_t and mu in a [[pair]]"
    for i, material in enumerate(case.material):
        if material.name == a and material.coin is None:
            return f"material[{i}]", material.model_dump(include=set(COEFFICIENTS))
        if material.name == a and material.coin is not None:
            law = coins[material.coin].law
            return _of_law(f"material[{i}]", law, sticking=material.sticking, rho=material.rho)
    return _of_law(f"coin '{a}'", coins[a].law) if a in coins and _coin_of(case, a) == a else None


def _coin_of(case: CaseSections, material: str) -> str | None:
    """The coin whose coefficients a material has, if it has a coin's."""
    for each in case.material:
        if each.name == material:
            plain = each.sticking == "percussion_center" and each.rho == 0.0
            return each.coin if plain else None
    used = (each.coin for each in case.species if each.material is None)
    return material if material in used else None


def verdicts(case: CaseSections, species: Sequence[Species]) -> Iterator[PairVerdict]:
    """Verdicts on the energy of collisions, for every pair of species whose coefficients are known."""
    order = list(dict.fromkeys(each.material for each in species))
    for one, other in itertools.combinations_with_replacement(species, 2):
        # In one order, so that a pair that is missing is named once.
        made_of = _coefficients(case, *sorted((one.material, other.material), key=order.index))
        if isinstance(made_of, str):
            yield PairVerdict(one.name, other.name, "pair", False, False, made_of, None)
        elif made_of is not None:
            yield _worst(made_of, one, other)


def wall_verdicts(case: CaseSections, species: Sequence[Species]) -> Iterator[PairVerdict]:
    """The same for every species and every material of walls."""
    names = [each.name for each in case.material] + [name for pair in case.pair for name in pair.materials]
    for material in case.materials_of_walls:
        wall = f"wall ({material})"
        for each in species:
            made_of = _coefficients(case, each.material, material)
            if isinstance(made_of, str):
                text = made_of + ("" if material in names else nearest(material, names))
                yield PairVerdict(each.name, wall, "pair", False, False, text, None)
            elif made_of is not None:
                # Beside an infinite mass, the pair's mean k is the disk's own.
                found = _verdict(made_of, each.name, wall, each.k, each.k)
                yield found._replace(materials=frozenset((each.material, material)))


def _worst(made_of: Coefficients, one: Species, other: Species) -> PairVerdict:
    """The worst verdict for any two disks of the species.

    Masses enter by the mean k = (k_1 m_2 + k_2 m_1)/(m_1 + m_2) alone, which is monotone in m_1/m_2, and the mean k
    that are admissible form an interval: each condition of `IFRLaw.admissibility` asks a convex function of it to be
    no more than a linear one, or bounds it from above. So the ends of the mass ratio decide.
    """
    mass, others = one.summary.mass, other.summary.mass
    ends = {(mass.low, others.high), (mass.high, others.low)}
    found = [_verdict(made_of, one.name, other.name, one.k, other.k, *masses) for masses in ends]
    worst = min(found, key=lambda each: (each.admissible, each.strict, -each.law.k if each.law else 0.0))
    return worst._replace(materials=frozenset((one.material, other.material)))


def _verdict(
    made_of: Coefficients, first: str, second: str, k_1: float, k_2: float, m_1: float = 1.0, m_2: float = 1.0
) -> PairVerdict:
    """The verdict for two disks with these k and masses."""
    key, coefficients = made_of
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyWarning)  # the verdict says the same
            law = IFRLaw(**coefficients, k=(k_1 * m_2 + k_2 * m_1) / (m_1 + m_2))
        return PairVerdict(first, second, key, *law.admissibility(k_1, k_2, m_1, m_2), law)
    except InputError as error:
        return PairVerdict(first, second, key, False, False, str(error), None)
