"""A case before it is known to be right: its sections one by one, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from .box import Box
from .case import (
    BoxSection,
    Case,
    MaterialSection,
    PairSection,
    RunSection,
    SpeciesSection,
    StartSection,
)
from .case_forces import ForceSection
from .coins import coins
from .section import Section

S = TypeVar("S", bound=Section)


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where, what stands there (as text; None where nothing does), why."""

    key: str
    value: str | None
    text: str

    def __str__(self) -> str:
        place = self.key if self.value is None else f"{self.key} = {self.value}"
        return f"{place}: {self.text}"


@dataclass(frozen=True)
class Species:
    """Equal disks of the gas.

    Attributes
    ----------
    name, material : str
        What they are called, and what they are made of.
    number : int
        How many there are.
    mass, radius, k : float
        Mass [mass], radius [length], shape number of one disk.
    speed_rms, spin_rms : float
        Root mean square speed [length/time] and spin [rad/time] at the start.
    """

    name: str
    material: str
    number: int
    mass: float
    radius: float
    k: float
    speed_rms: float
    spin_rms: float


@dataclass(frozen=True)
class Draft:
    """The sections of a case, with None for each that is not valid by itself."""

    run: RunSection | None
    box: BoxSection | None
    material: tuple[MaterialSection | None, ...]
    pair: tuple[PairSection | None, ...]
    species: tuple[SpeciesSection | None, ...]
    start: StartSection | None
    material_names: tuple[str, ...]  # those of sections with mistakes too
    force: tuple[ForceSection | None, ...] = ()

    @classmethod
    def from_sections(cls, raw: Mapping[str, Any]) -> Draft:
        """From the parsed text of a case file."""

        def one(model: type[S], value: Any) -> S | None:
            try:
                return model.model_validate(value)
            except ValidationError:
                return None

        def several(model: type[S], value: Any) -> tuple[S | None, ...]:
            return tuple(one(model, each) for each in value) if isinstance(value, list) else (None,)

        materials = raw.get("material")
        return cls(
            run=one(RunSection, raw.get("run")),
            box=one(BoxSection, raw.get("box")),
            material=several(MaterialSection, raw.get("material", [])),
            pair=several(PairSection, raw.get("pair", [])),
            species=several(SpeciesSection, raw.get("species")),
            start=one(StartSection, raw.get("start", {})),
            material_names=tuple(
                each["name"]
                for each in (materials if isinstance(materials, list) else ())
                if isinstance(each, Mapping) and isinstance(each.get("name"), str)
            ),
            force=several(ForceSection, raw.get("force", [])),
        )

    @classmethod
    def from_case(cls, case: Case) -> Draft:
        """From a case whose sections are all valid."""
        return cls(
            case.run,
            case.box,
            tuple(case.material),
            tuple(case.pair),
            tuple(case.species),
            case.start,
            tuple(each.name for each in case.material),
            tuple(case.force),
        )

    @property
    def sets_in_motion(self) -> bool:
        """Whether a force moves disks that are at rest, or may: one with mistakes counts."""
        moving = ("kicks", "langevin")
        return any(
            each is None or (each.kind in moving and each.temperature != 0.0 and each.rate != 0.0)
            for each in self.force
        )

    def known_species(self) -> list[Species]:
        """The species that are in order."""
        found = []
        for each in self.species:
            if each is None or (each.coin is not None and each.coin not in coins):
                continue
            if each.coin is not None:
                coin = coins[each.coin]
                mass, radius, k = coin.mass, coin.radius, coin.k
            else:
                assert each.mass is not None  # the section's alternatives see to it
                radius = each.radius if each.radius is not None else 0.5 * (each.diameter or 0.0)
                mass, k = each.mass, each.k
            material = each.material if each.material is not None else (each.coin or "")
            found.append(
                Species(each.name, material, each.number, mass, radius, k, each.speed_rms, each.spin_rms)
            )
        return found


def box_around(section: BoxSection, radius: NDArray[np.float64]) -> Box:
    """The box that a section describes, for disks of these radii [length], shape (n,).

    Raises
    ------
    InputError
        If they can never cover that fraction of it.
    """
    if section.lengths is not None:
        return Box((section.lengths[0], section.lengths[1]))
    assert section.packing_fraction is not None
    return Box.from_packing_fraction(radius, section.packing_fraction, section.aspect)
