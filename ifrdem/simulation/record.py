"""Quantities that a simulation records on request, by name."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from ..errors import InputError, nearest

RECORDABLE = {
    "energy": "energy that collisions dissipate, by mechanism, and collisions by regime: `Measure`",
    "partner": "the disk or wall that each disk hit last: `State.last_partner`",
    "angle": "the angle by which each disk has turned: `State.angle`",
    "disk_energy": "energy that each disk's collisions dissipate, by mechanism: `State.dissipated`; includes energy",
    "wall": "momentum, torque, work, heat and collisions of each wall: `wall_sums` and `Measure`",
}


def validate(record: Any) -> frozenset[str]:
    """Names of what is recorded, with those that others need: InputError for an unknown name."""
    known = ", ".join(RECORDABLE)
    if isinstance(record, str) or not isinstance(record, Iterable):
        raise InputError(f"record = {record!r}: must be a list of names, of {known}")
    names: Collection[Any] = list(record)
    for name in names:
        if not isinstance(name, str) or name not in RECORDABLE:
            spelling = nearest(name, RECORDABLE) if isinstance(name, str) else ""
            raise InputError(f"record: unknown name {name!r}{spelling}; must be of {known}")
    return frozenset(names) | ({"energy"} if "disk_energy" in names else set())
