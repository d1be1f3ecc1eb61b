"""Quantities that a simulation records on request, by name."""

from __future__ import annotations

from collections.abc import Iterable

from ..errors import InputError, nearest

RECORDABLE = {
    "energy": "energy that collisions dissipate, by mechanism, and collisions by regime: `Measure`",
    "partner": "the disk or wall that each disk hit last: `State.last_partner`",
    "angle": "the angle by which each disk has turned: `State.angle`",
    "disk_energy": "energy that each disk's collisions dissipate, by mechanism: `State.dissipated`; includes energy",
    "wall": "momentum, torque, work, heat and collisions of each wall: `wall_sums` and `Measure`",
}


def validate(record: Iterable[str]) -> frozenset[str]:
    """Names of what is recorded, with those that others need: InputError for an unknown name."""
    known = ", ".join(RECORDABLE)
    names = list(record)
    for name in names:
        if name not in RECORDABLE:
            raise InputError(f"record: unknown name {name!r}{nearest(name, RECORDABLE)}; must be of {known}")
    return frozenset(names) | ({"energy"} if "disk_energy" in names else set())
