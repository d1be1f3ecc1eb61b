"""Exclusions of a case: the rules of `model.rules`, by its keys.

Facts are read key by key, so that exclusions are found beside keys that are wrong, which count as not given.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ..errors import Problem
from ..model import rules
from ..model.collapse import Rest
from .case import REMEDIES, CaseSections, class_of
from .laws_section import IFR_LAWS
from .output_section import TRACKED

KEY_OF: Mapping[str, str] = {
    "box.open": "box.open", "box.periodic": "box.periodic", "box.shear_rate": "box.shear_rate",
    "gravity": "box.gravity", "gravity.rate": "box.gravity_rotation_rate", "walls": "wall",
    "walls.piston": "wall[].piston", "forces": "force[].kind", "forces.TableFriction": "force[].kind",
    "forces.RandomKicks": "force[].kind", "collapse": "run.collapse", "collapse.Rest": "run.collapse",
    "law": "material[].law", "record.stress": "output.stress", "record.heat_flux": "output.heat_flux", "record.wall_sums": "output.wall_sums",
    "histories": "output.histories", "device.name": "run.device", "device.precision": "run.precision",
    "device.low_memory": "run.low_memory", "disks.n": "species",
}  # fmt: skip
"""Keys of a case by names of arguments: what the rules have besides is not in a case."""


class _Given:
    """Facts of a case that the rules ask for.

    Parameters
    ----------
    case : mapping
        Sections by name, as they are parsed: keys with the right types, of which any may be missing.
    """

    def __init__(self, case: Mapping[str, Any]) -> None:
        self.tables = {key: value for key, value in case.items() if isinstance(value, Mapping)}
        self.lists = {key: value for key, value in case.items() if isinstance(value, list)}

    def value(self, section: str, key: str) -> Any:
        """The value of a key of a section that is there once, by default its default."""
        field: Any = CaseSections.model_fields[section].annotation
        default = field.model_fields[key].get_default(call_default_factory=True)
        return self.tables.get(section, {}).get(key, default)

    def each(self, section: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Sections that may be there many times, with their numbers, but for those that are no tables."""
        return ((i, one) for i, one in enumerate(self.lists.get(section, [])) if isinstance(one, Mapping))

    @property
    def pistons(self) -> list[int]:
        """Numbers of the walls that are pistons."""
        return [i for i, one in self.each("wall") if "piston" in one]

    @property
    def forces(self) -> dict[int, str]:
        """The names of the classes of the forces, by their numbers."""
        return {i: class_of(str(one.get("kind"))) for i, one in self.each("force")}

    @property
    def laws(self) -> dict[int, str]:
        """The laws of materials of disks that are no IFR law, by the numbers of the materials."""
        used = [one.get("material") for _, one in self.each("species")]
        found = {
            i: one.get("law", IFR_LAWS[0]) for i, one in self.each("material") if one.get("name") in used
        }
        return {i: law for i, law in found.items() if law not in IFR_LAWS}

    @property
    def collapse(self) -> str:
        """Name of the class of the remedy for inelastic collapse, "" without."""
        chosen = self.value("run", "collapse")
        return REMEDIES[chosen][1].__name__ if chosen in REMEDIES else ""

    @property
    def record(self) -> frozenset[str]:
        """Records that rules ask for."""
        keys = ((name.partition("."), key.partition(".")) for name, key in KEY_OF.items())
        return frozenset(name[2] for name, key in keys if name[0] == "record" and self.value(key[0], key[2]))

    @property
    def tracked(self) -> list[str]:
        """The keys that say which disks are tracked."""
        return [key for key in TRACKED if self.value("output", key) not in (None, False)]

    @property
    def n(self) -> int:
        """Number of disks, as far as it is known: then not less than two."""
        numbers = [one.get("number") for _, one in self.each("species")]
        known = [each for each in numbers if isinstance(each, int)]
        return sum(known) if known and len(known) == len(numbers) else max(2, sum(known))

    @property
    def facts(self) -> rules.Facts:
        """Facts for `model.rules.refusals`."""
        is_open, periodic, gravity = (self.value("box", key) for key in ("open", "periodic", "gravity"))
        return rules.Facts(
            is_open=is_open, periodic=(False, False) if is_open else (periodic[0], periodic[1]),
            shear_rate=self.value("box", "shear_rate"), walls=len(self.lists.get("wall", [])),
            pistons=len(self.pistons), gravity=(gravity[0], gravity[1]),
            rotating=bool(self.value("box", "gravity_rotation_rate")), forces=frozenset(self.forces.values()),
            collapse=self.collapse, law=next(iter(self.laws.values()), ""), record=self.record,
            device=self.value("run", "device"), precision=self.value("run", "precision"),
            low_memory=self.value("run", "low_memory"), histories=bool(self.tracked), n=self.n,
        )  # fmt: skip

    def place(self, name: str) -> tuple[str, str | None]:
        """The key of a case that a name of the rules means, and its value as text, None of a table."""
        if name == "disks.n":
            return "species", f"{self.n} disk{'s' * (self.n != 1)}"
        if name == "walls" and not self.lists.get("wall") and self.facts.walled:
            name = "box.periodic"
        if name == "box.periodic" and self.value("box", "open"):
            name = "box.open"
        key = KEY_OF[name]
        if name == "histories":
            key = f"output.{self.tracked[0]}"
        if name == "walls":
            return key, None if self.lists.get(key) else "[]"
        section, _, last = key.partition(".")
        if not section.endswith("[]"):
            return key, _shown(self.value(section, last))
        section, kind = section.removesuffix("[]"), name.partition(".")[2]
        which = {"wall": self.pistons, "material": list(self.laws)}.get(section)
        i = which[0] if which else next(i for i, each in self.forces.items() if kind in ("", each))
        value = self.lists[section][i].get(last)
        return f"{section}[{i}].{last}", None if value is None or isinstance(value, Mapping) else _shown(
            value
        )

    def said(self, name: str) -> str:
        """A key with its value."""
        key, value = self.place(name)
        return value or "" if key == "species" else key if value is None else f"{key} = {value}"


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def problems(case: Mapping[str, Any]) -> list[Problem]:
    """All exclusions that a case breaks, which has the right types, by the keys at which it is refused."""
    given = _Given(case)
    return [
        Problem(*given.place(rule.at), f"cannot be combined with {given.said(rule.with_)}: {rule.why}")
        for rule in rules.refusals(given.facts)
    ]


def undivided(case: CaseSections) -> list[str]:
    """The keys of a valid case, with their values, because of which ranks of MPI cannot share its gas."""
    given = _Given(parsed(case))
    broken = rules.refusals(replace(given.facts, ranks=2))
    return [given.said(rule.with_) for rule in broken if rule.at == "comm"]


def parsed(case: CaseSections) -> dict[str, Any]:
    """A valid case as if it were parsed, as far as the rules look at it."""
    whole = dict.fromkeys(("run", "box", "species", "material", "force", "output"), True)
    return case.model_dump(include={**whole, "wall": {"__all__": {"piston"}}}, exclude_none=True)


def may_rest(case: CaseSections) -> bool:
    """True if the gas may have disks at rest, by `run.collapse`."""
    facts = replace(_Given(parsed(case)).facts, collapse=Rest.__name__)
    return next(rules.refusals(facts), None) is None
