"""Present words for those that older versions wrote into trajectories, checkpoints and results of studies.

What a user writes is not translated: old words are refused there, with the present ones (`errors.nearest`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ..errors import RENAMED

_RENAMED_VALUES = (("run", "collapse"), ("start", "positions"), ("output", "precision"))
"""Keys of a case of which values were renamed, besides the kinds of forces."""


def present_case(case: Mapping[str, Any]) -> dict[str, Any]:
    """A parsed case with present words.

    Examples
    --------
    >>> present_case({"run": {"name": "tc", "collapse": "tc"}, "force": [{"kind": "random_force", "rate": 2.0}]})
    {'run': {'name': 'tc', 'collapse': 'contact_time'}, 'force': [{'kind': 'poisson_kicks', 'rate': 2.0}]}
    """
    found = dict(case)
    for section, key in _RENAMED_VALUES:
        table = found.get(section)
        if isinstance(table, Mapping) and key in table:
            found[section] = {**table, key: _present(table[key])}
    if isinstance(forces := found.get("force"), list):
        found["force"] = [present_force(each) if isinstance(each, Mapping) else each for each in forces]
    return found


def present_force(force: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a force with its present kind: kicks at random times, which have a rate, have kinds of their own."""
    kind = {"kind": _present(force["kind"], force.get("rate") is not None)} if "kind" in force else {}
    return {**force, **kind}


def present_record(names: Iterable[str]) -> list[str]:
    """Present names of what a simulation records."""
    return sorted(map(_present, names))


def _present(word: Any, which: int = 0) -> Any:
    """The present word, of two the one numbered `which`; the same if it was not renamed."""
    words = RENAMED.get(word) if isinstance(word, str) else None
    return word if words is None else words[which]
