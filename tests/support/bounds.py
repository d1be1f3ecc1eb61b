"""Bounds of speeds that tiles keep, against the velocities in histories."""

from __future__ import annotations

import numpy as np

from ifrdem.kernels.columns import named
from ifrdem.kernels.compiler.language import to_numpy
from ifrdem.simulation.measuring.tracking import Events
from ifrdem.simulation.simulation import Simulation


def check_bounds(simulation: Simulation, events: Events, gravity: tuple[float, float] = (0.0, 0.0)) -> None:
    """The bound on the speed of each disk in the latest window is not below that after any event, in the falling frame.

    A bound that is too small makes halos too narrow, or copies that went another way taken for right: very rarely.
    """
    windows, info = simulation._engine.windows, to_numpy(simulation._engine.arrays.event_info)
    info = named(info[: simulation.disks.n], "event_info")
    bound = np.empty(simulation.disks.n)
    bound[info.id] = (info.max_speed_sq.astype(np.int64) << 32).view(np.float64)
    rows = events.time >= windows.time_origin
    fall = np.outer(events.time[rows] - windows.time_origin, gravity)
    squares = np.sum((events.velocity_after[rows] - fall) ** 2, axis=1)
    assert np.all(squares <= bound[events.id[rows]])
