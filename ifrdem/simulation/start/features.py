"""Features of a gas: what it records, and what its kernels are compiled for (`kernels/layout.py`, `Uses`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, nearest, shortened
from ...kernels.columns import named
from ...kernels.layout import Uses
from ...kernels.walls.kinds import ARC_INSIDE, ARC_OUTSIDE
from ...model.box import Box
from ...model.laws.law import CollisionLaw, compiled
from ...model.walls.wall import Wall

if TYPE_CHECKING:
    from ..engine import EngineOptions

RECORDABLE = {
    "energy": "energy that collisions dissipate, by mechanism, and collisions by regime: `Measure`",
    "partner": "the disk or wall that each disk hit last: `State.last_partner`",
    "angle": "the angle by which each disk has turned: `State.angle`",
    "disk_energy": "energy that each disk's collisions dissipate, by mechanism: `State.dissipated`; includes energy",
    "stress": "momentum that collisions transfer, for the pressure tensor: `Measure.virial`",
    "wall": "momentum, torque, work, heat and collisions of each wall: `wall_sums` and `Measure`",
}


def validate_record(record: Iterable[str]) -> frozenset[str]:
    """Names of what is recorded, with those that others need: InputError for an unknown name."""
    known = ", ".join(RECORDABLE)
    names = list(record)
    for name in names:
        if name not in RECORDABLE:
            raise InputError(
                f"record: unknown name {shortened(name)}{nearest(name, RECORDABLE)}; must be of {known}"
            )
    return frozenset(names) | ({"energy"} if "disk_energy" in names else set())


def features_of(
    box: Box,
    walls: Sequence[Wall],
    wall_rows: NDArray[np.float64],
    law: type[CollisionLaw],
    options: EngineOptions,
    *,
    tracked: bool,
    ranks: int,
) -> Uses:
    """The features of a gas in a box, on so many ranks; `wall_rows` are those of all `walls`, sides included.

    Those that follow from the kinds of disks are left to `DeviceArrays`.
    """
    kind: Any = law  # mypy does not take a class for hashable
    return Uses(
        walled=len(walls) > 0,
        thermal=any(wall.temperature for wall in walls),
        pieced=len(wall_rows) != len(walls),
        arched=bool(np.isin(named(wall_rows, "walls").kind, (ARC_INSIDE, ARC_OUTSIDE)).any()),
        turning=any(wall.turn.kind != "still" for wall in walls),
        timed=any(
            wall.gated or wall.moves_from is not None or wall.moves_until is not None for wall in walls
        ),
        summed="wall" in options.record and len(walls) > 0,
        pistons=any(wall.piston is not None for wall in walls),
        remembers=options.contact_time > 0.0,
        sheared=box.shear_rate != 0.0,
        tallied=options.has_ledger,
        stressed="stress" in options.record,
        partnered="partner" in options.record,
        turned="angle" in options.record,
        itemised="disk_energy" in options.record,
        watched=tracked,
        rests=options.resting_speed > 0.0,
        shared=ranks > 1,
        cut=options.device.low_memory,
        collision_law=compiled(kind),
    )
