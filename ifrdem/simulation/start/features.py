"""Features of a gas, for which its kernels are compiled (`kernels/layout.py`, `Uses`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...kernels.columns import named
from ...kernels.layout import Uses
from ...kernels.walls.kinds import ARC_INSIDE, ARC_OUTSIDE
from ...model.laws.law import compiled

if TYPE_CHECKING:
    from ...model.setup import Setup


def features_of(
    setup: Setup, wall_rows: NDArray[np.float64], *, histories: bool, ranks: int, species: int
) -> Uses:
    """The features of a gas of so many species, on so many ranks.

    `wall_rows` are those of all walls, sides of the box included.

    Those that follow from the kinds of disks are left to `DeviceArrays`.
    """
    walls = setup.all_walls
    kind: Any = setup.law_class  # mypy does not take a class for hashable
    return Uses(
        walls=len(walls) > 0,
        thermal_walls=any(wall.temperature for wall in walls),
        wall_pieces=len(wall_rows) != len(walls),
        arcs=bool(np.isin(named(wall_rows, "walls").kind, (ARC_INSIDE, ARC_OUTSIDE)).any()),
        turning_walls=any(wall.turn.kind != "still" for wall in walls),
        timed_walls=any(
            wall.gated or wall.moves_from is not None or wall.moves_until is not None for wall in walls
        ),
        wall_sums="wall_sums" in setup.record and len(walls) > 0,
        pistons=any(wall.piston is not None for wall in walls),
        contact_time=setup.contact_time > 0.0,
        latest_collision="latest_collision" in setup.recorded,
        histograms=max(species, 1) if "histograms" in setup.record else 0,
        free_times="free_times" in setup.record,
        shear=setup.box.shear_rate != 0.0,
        ledger=setup.has_ledger,
        stress="stress" in setup.record,
        heat_flux="heat_flux" in setup.record,
        last_partner="last_partner" in setup.record,
        angle="angle" in setup.record,
        dissipated="dissipated" in setup.record,
        histories=histories,
        rest=setup.resting_speed > 0.0,
        ranks=ranks > 1,
        low_memory=setup.device.low_memory,
        collision_law=compiled(kind),
    )
