"""The pairs of species: which coefficients they collide with, and whether those can add energy."""

from __future__ import annotations

import contextlib
import itertools
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from ..errors import InputError, nearest
from ..model.laws.coin_table import coins
from ..model.laws.ifr import FOR_OTHER_DISKS, EnergyWarning, IFRLaw
from ..model.laws.law import CollisionLaw
from .case import CaseSections
from .laws_section import FileKeys, IFRMaterial, Material, PairOfMaterials, TableKeys
from .species import Species


class PairVerdict(NamedTuple):
    """Verdict on the law of two species, or of one and walls of a material: it may add energy, or is missing."""

    first: str
    second: str
    key: str
    admissible: bool
    strict: bool
    message: str
    law: CollisionLaw | None
    materials: frozenset[str] = frozenset()


Coefficients = tuple[str, Callable[[float], CollisionLaw]]
"""The key that coefficients come from, and what makes the law of a mean shape number k."""
FromFiles = Mapping[str, CollisionLaw]


def _of_coin(key: str, law: IFRLaw) -> Coefficients:
    return key, lambda k: replace(law, k=k)


def _of_section(key: str, section: Material | PairOfMaterials, from_files: FromFiles) -> Coefficients | None:
    if not isinstance(section, FileKeys | TableKeys):
        return key, section.made
    law = from_files.get(key)
    return None if law is None else (key, lambda _k: law)


def _coefficients(case: CaseSections, a: str, b: str, from_files: FromFiles) -> Coefficients | str | None:
    """The coefficients of a pair of materials; what is wrong if there are none; None if that is unknown."""
    if a != b:
        for i, pair in enumerate(case.pair):
            if set(pair.materials) == {a, b}:
                return _of_section(f"pair[{i}]", pair, from_files)
        coin_a, coin_b = _coin_of(case, a), _coin_of(case, b)
        if coin_a is not None and coin_b is not None:
            with contextlib.suppress(InputError):  # the paper did not measure this pair: the case has to say
                return _of_coin(f"'{coin_a}' with '{coin_b}'", coins.pair(coin_a, coin_b))
        others = {each.law for each in case.material if each.name in (a, b)} - {"ifr"}
        given = f'law = "{others.pop()}" and its coefficients' if len(others) == 1 else "e_n, e_t and mu"
        return f"missing for the materials '{a}' and '{b}': give their {given} in a [[pair]]"
    for i, material in enumerate(case.material):
        if material.name == a:
            return _of_section(f"material[{i}]", material, from_files)
    return _of_coin(f"coin '{a}'", coins[a].law) if a in coins and _coin_of(case, a) == a else None


def _is_defined(case: CaseSections, material: str) -> bool:
    """True unless the name of a species' material is one that nothing defines, which is reported by itself."""
    return any(each.name == material for each in case.material) or _coin_of(case, material) is not None


def _coin_of(case: CaseSections, material: str) -> str | None:
    """The coin whose coefficients a material has, if it has a coin's."""
    for each in case.material:
        if each.name == material:
            if not isinstance(each, IFRMaterial):
                return None
            plain = each.sticking == "percussion_center" and each.rho == 0.0
            return each.coin if plain else None
    used = (each.coin for each in case.species if each.material is None)
    return material if material in used else None


def verdicts(
    case: CaseSections, species: Sequence[Species], from_files: FromFiles = MappingProxyType({})
) -> Iterator[PairVerdict]:
    """Verdicts on the energy of collisions, for every pair of species whose coefficients are known.

    `from_files` has the custom laws of sections, by keys such as "material[0]".
    """
    species = [each for each in species if _is_defined(case, each.material)]
    order = list(dict.fromkeys(each.material for each in species))
    for one, other in itertools.combinations_with_replacement(species, 2):
        # In one order, so that a pair that is missing is named once.
        a, b = sorted((one.material, other.material), key=order.index)
        made_of = _coefficients(case, a, b, from_files)
        if isinstance(made_of, str):
            yield PairVerdict(one.name, other.name, "pair", False, False, made_of, None)
        elif made_of is not None:
            yield _worst(made_of, one, other)


def wall_verdicts(
    case: CaseSections, species: Sequence[Species], from_files: FromFiles = MappingProxyType({})
) -> Iterator[PairVerdict]:
    """Verdicts on the energy of collisions, for every species and every material of walls; as `verdicts`."""
    names = [each.name for each in case.material] + [name for pair in case.pair for name in pair.materials]
    for material in case.materials_of_walls:
        wall = f"wall ({material})"
        for each in species:
            if not _is_defined(case, each.material):
                continue
            made_of = _coefficients(case, each.material, material, from_files)
            if isinstance(made_of, str):
                text = made_of + ("" if material in names else nearest(material, names))
                yield PairVerdict(each.name, wall, "pair", False, False, text, None)
            elif made_of is not None:
                # With an infinite mass, the pair's mean k is that of the disk.
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
    worst = min(found, key=lambda each: (each.admissible, each.strict, -getattr(each.law, "k", 0.0)))
    return worst._replace(materials=frozenset((one.material, other.material)))


def _verdict(
    made_of: Coefficients, first: str, second: str, k_1: float, k_2: float, m_1: float = 1.0, m_2: float = 1.0
) -> PairVerdict:
    """The verdict for two disks with these k and masses."""
    key, law_of = made_of
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyWarning)  # the verdict says the same
            law = law_of((k_1 * m_2 + k_2 * m_1) / (m_1 + m_2))
            return PairVerdict(first, second, key, *law.admissibility(k_1, k_2, m_1, m_2), law)
    except InputError as error:
        return PairVerdict(first, second, key, False, False, str(error).removesuffix(FOR_OTHER_DISKS), None)
