"""Bounds of speeds that tiles keep."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ifrdem.kernels.columns import named
from ifrdem.kernels.compiler.language import to_numpy
from ifrdem.simulation.simulation import Simulation


def check_bounds(
    simulation: Simulation,
    time: NDArray[np.float64],
    disk: NDArray[np.integer],
    velocity: NDArray[np.float64],
    gravity: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Check that these velocities, shape (n, 2), are within the disks' bounds, as far as they are of the latest window.

    Bounds are those of a window, on speeds in the falling frame. One that misses an event, or keeps the smallest,
    makes halos too narrow, or takes a copy that went another way for right: bits of a gas hardly show it.
    """
    windows, arrays = simulation._engine.windows, cast(Any, simulation._engine.arrays)
    info = named(to_numpy(arrays.event_info)[: simulation.disks.n], "event_info")
    bound = np.empty(simulation.disks.n)
    bound[info.id] = (info.max_speed_sq.astype(np.int64) << 32).view(np.float64)
    latest = time >= windows.time_origin
    assert latest.any()
    fall = np.outer(time[latest] - windows.time_origin, gravity)
    squares = np.sum((velocity[latest] - fall) ** 2, axis=1)
    assert np.all(squares <= bound[disk[latest]])
