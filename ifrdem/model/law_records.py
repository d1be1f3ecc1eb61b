"""Laws as the records of trajectories have them: their names and arguments."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from ..errors import InputError
from .ifr import EnergyWarning, IFRLaw
from .law import CollisionLaw
from .viscoelastic import Viscoelastic
from .walton import Walton

_WITH_FRICTION = ("e_t", "mu", "sticking", "rho", "k")
ARGUMENTS: Mapping[str, tuple[type[CollisionLaw], tuple[str, ...]]] = {
    "ifr": (IFRLaw, ("e_n", *_WITH_FRICTION)),
    "walton": (Walton, Walton.coefficients),
    "viscoelastic": (Viscoelastic, ("A", "Y", *_WITH_FRICTION)),
}
"""Classes and names of arguments by the name of a law."""


def to_record(law: CollisionLaw) -> dict[str, Any]:
    """The name of a law and its arguments."""
    for name, (kind, arguments) in ARGUMENTS.items():
        if type(law) is kind:
            return {"law": name} | {key: getattr(law, key) for key in arguments}
    raise InputError(f"law = {law!r}: must be one of {', '.join(ARGUMENTS)} to be stored")


def from_record(record: Mapping[str, Any]) -> CollisionLaw:
    """The law of a record. InputError if it is none, or its arguments are no law's."""
    name = str(record.get("law"))
    if name not in ARGUMENTS:
        raise InputError(f"law = {name!r}: must be one of {', '.join(ARGUMENTS)}")
    kind, arguments = ARGUMENTS[name]
    given = {key: value for key, value in record.items() if key != "law"}
    if set(given) != set(arguments):
        raise InputError(f"law {name}: has {', '.join(given)}: must have {', '.join(arguments)}")
    with warnings.catch_warnings(action="ignore", category=EnergyWarning):  # the run has said so
        return kind(**given)
