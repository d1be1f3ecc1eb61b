"""Numbers by name, as custom laws and forces declare them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..errors import InputError, nearest
from ..tools import checked


def named_numbers(owner: str, what: str, names: Sequence[str], given: Mapping[str, Any]) -> dict[str, float]:
    """A finite number for each of the names, in their order.

    InputError, which calls them `what` of the `owner`, if one is missing, unknown or not finite.
    """
    for name in given:
        if name not in names:
            known_names = ", ".join(names) or "none"
            raise InputError(f"{owner}: unknown {what} '{name}'{nearest(name, names)}; it has: {known_names}")
    for name in names:
        if name not in given:
            raise InputError(f"{owner}: {name} is missing; it has: {', '.join(names)}")
    return {name: checked.FINITE(f"{owner}: {name}", given[name]) for name in names}
