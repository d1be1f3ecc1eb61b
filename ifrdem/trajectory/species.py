"""Species of a trajectory: names and numbers of disks, as the parameter `species` gives them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import printable
from .damage import FAULTS


def named_species(parameters: Mapping[str, object], n: int) -> dict[str, int] | None:
    """Names and numbers of the species of n disks, in the order of ids; None if the parameters give none."""
    try:
        found = json.loads(str(parameters["species"]))
        numbers = {printable(str(one["name"])): int(one["number"]) for one in found}
        if len(numbers) == len(found) and min(numbers.values()) >= 0 and sum(numbers.values()) == n:
            return numbers
    except FAULTS:  # the file may come from another program
        pass
    return None


def with_species(parameters: Mapping[str, Any] | None, species: Mapping[str, int]) -> dict[str, Any]:
    """The parameters, with the names and numbers of these species unless they give some themselves."""
    found = dict(parameters or {})
    if species:
        found.setdefault("species", json.dumps([{"name": key, "number": n} for key, n in species.items()]))
    return found


def species_of_disks(numbers: Sequence[int], first: int, n: int) -> NDArray[np.int32]:
    """Number of the species of each of n disks from `first` on; the species have these numbers of disks."""
    ends = np.cumsum(np.asarray(numbers, dtype=np.int64))
    return np.searchsorted(ends, np.arange(first, first + n), side="right").astype(np.int32)
