"""Laws as the records of trajectories and checkpoints have them: their names and arguments.

A custom law from a file has the name FILE.py:CLASS, the path of the file, the hash of its text, and its coefficients.
"""

from __future__ import annotations

import inspect
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from ...errors import InputError, shortened
from ...tools import checked
from . import files as law_files
from .files import LawSource
from .ifr import EnergyWarning, IFRLaw, rough_disks, smooth_disks
from .law import CollisionLaw, Key
from .table import KEYS, TableLaw
from .viscoelastic import Viscoelastic
from .walton import Walton


@dataclass(frozen=True)
class NamedLaw:
    """A law as cases and mappings name it."""

    name: str
    kind: type[CollisionLaw]
    """The class of the law."""
    make: Callable[..., CollisionLaw]
    """Constructor of the law from its keys: the class, or a function."""
    keys: Mapping[str, Key]

    @property
    def about(self) -> str:
        """The first line of the docstring of what makes it: of a class, if that is a method of it."""
        made_by = self.kind if hasattr(self.make, "__self__") else self.make
        return (made_by.__doc__ or "").strip().splitlines()[0]

    @property
    def defaults(self) -> dict[str, Any]:
        """Defaults of those keys that have one."""
        arguments = inspect.signature(self.make).parameters
        given = {name: arguments[name].default for name in self.keys if name in arguments}
        return {name: default for name, default in given.items() if default is not inspect.Parameter.empty}


_RESTITUTION = IFRLaw.keys["e_n"]
_BETA = Key(checked.E_T, "tangential restitution of the slip [1], -1 (smooth) to 1 (perfectly rough)", 0.5)
LAWS: Mapping[str, NamedLaw] = {
    law.name: law
    for law in (
        *(NamedLaw(kind.name_in_cases, kind, kind, kind.keys) for kind in (IFRLaw, Walton, Viscoelastic)),
        NamedLaw(TableLaw.name_in_cases, TableLaw, TableLaw.read, KEYS),
        NamedLaw("rough", IFRLaw, rough_disks, {"e_n": _RESTITUTION, "beta": _BETA}),
        NamedLaw("smooth", IFRLaw, smooth_disks, {"e_n": _RESTITUTION}),
    )
}
"""Laws by the names that cases have; the first is the default."""
ARGUMENTS: Mapping[str, tuple[type[CollisionLaw], tuple[str, ...]]] = {
    name: (law.kind, (*law.keys, *["k"] * law.kind.takes_k))
    for name, law in LAWS.items()
    if law.make is law.kind
} | {TableLaw.name_in_cases: (TableLaw, ("slip", "ratio", "e_n", "g_n", "k"))}
"""Classes and names of arguments of laws by the names that records have."""


def any_law(name: str, law: Any) -> CollisionLaw:
    """The law, or that of a mapping with its name and coefficients: {"law": "walton", "e_n": ...}; else InputError."""
    if isinstance(law, CollisionLaw):
        return law
    if not isinstance(law, Mapping):
        raise checked.must_be(
            name, law, "a law, or a mapping with the name of one, {'law': 'walton', 'e_n': ...}"
        )
    given = dict(law)
    kind = checked.choice(f"{name}['law']", given.pop("law", next(iter(LAWS))), LAWS)
    try:
        return LAWS[kind].make(**given)
    except TypeError as error:  # a coefficient that is missing
        raise InputError(f"{name} = {shortened(law)}: {error}") from None


AnyLaw = Annotated[CollisionLaw | Mapping[str, Any], any_law]


def to_record(law: CollisionLaw) -> dict[str, Any]:
    """The name of a law and its arguments. InputError for a custom law that is not from a file."""
    if (source := law_files.source_of(law)) is not None:
        values = {key: getattr(law, key) for key in law.coefficients}
        return {"law": source.law, "path": source.path, "sha256": source.sha256, "coefficients": values}
    for name, (kind, arguments) in ARGUMENTS.items():
        if type(law) is kind:
            values = {key: getattr(law, key) for key in arguments}
            return {"law": name} | {
                key: getattr(each, "tolist", lambda each=each: each)() for key, each in values.items()
            }
    raise InputError(
        f"law = {shortened(law)}: must be one of {', '.join(ARGUMENTS)}, or from a file, to be stored"
    )


def from_record(record: Mapping[str, Any], folder: Path | str = ".") -> CollisionLaw:
    """The law of a record.

    The file of a custom law is looked for where it was, and in `folder`; its code is executed. InputError if the record
    is none, its arguments are no law's, or the file is not there or has changed.
    """
    name = str(record.get("law"))
    if is_custom(record):
        law, wrong = law_files.made(source_of_record(record, folder).kind, record["coefficients"])
        if law is None:
            raise InputError(f"law {name}: {'; '.join(filter(None, (': '.join(each) for each in wrong)))}")
        return law
    if name not in ARGUMENTS:
        raise InputError(f"law = {shortened(name)}: must be one of {', '.join(ARGUMENTS)}")
    kind, arguments = ARGUMENTS[name]
    given = {key: value for key, value in record.items() if key != "law"}
    # Records of earlier versions lack arguments that a law has got since, of which the default is what it was.
    missing = {*arguments} - {*given} - {*LAWS[name].defaults}
    if missing or not {*given} <= {*arguments}:
        raise InputError(f"law {name}: has {', '.join(given)}: must have {', '.join(arguments)}")
    with warnings.catch_warnings(action="ignore", category=EnergyWarning):  # the run has said so
        return kind(**given)


def is_custom(record: Mapping[str, Any]) -> bool:
    """True of the record of a law from a file."""
    return law_files.is_reference(record.get("law"))


def checked_record(record: Mapping[str, Any]) -> Mapping[str, Any]:
    """A record of a custom law whose parts are of the right types; ValueError or LookupError if they are not."""
    values = {str(key): float(value) for key, value in record["coefficients"].items()}
    texts = {key: str(record[key]) for key in ("law", "path", "sha256")}
    return {**texts, "coefficients": values}


def of_table(table: Iterable[Iterable[Mapping[str, Any] | None]]) -> Iterator[Mapping[str, Any]]:
    """The records of a table of laws, [material][material]; None in it stands for materials that never meet."""
    return (one for row in table for one in row if one is not None)


def source_of_record(record: Mapping[str, Any], folder: Path | str = ".") -> LawSource:
    """The source of the custom law of a record, unchanged, from where it was or from `folder`. Nothing is executed.

    InputError if it is in neither place, or has changed.
    """
    path, (file, _, name) = Path(record["path"]), str(record["law"]).rpartition(":")
    changed, places = [], dict.fromkeys((path.parent, Path(os.path.realpath(folder))))
    for place in places:
        if (place / file).is_file():
            found = law_files.find(f"{file}:{name}", place)
            if found.sha256 == record["sha256"]:
                return found
            changed.append(f"{found.path} has changed (sha256 {found.sha256[:12]}...)")
    reason = " and ".join(changed) or f"there is no file {path}"
    raise InputError(
        f"law {record['law']}: {reason}: must be the file of the run (sha256 {record['sha256']}), in "
        f"{' or '.join(map(str, places))}"
    )
