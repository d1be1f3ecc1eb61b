"""A hexagonal lattice of disks between walls: the widest one that has enough sites off the walls."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.free_area import Room

CLOSER, CLEAR = (
    1.0 - 1e-9,
    1.0 + 1e-9,
)  # of the diameter among sites, of the radius at walls: room for rounding
HALVINGS = 40


def sites(room: Room, n: int, radius: float) -> NDArray[np.float64]:
    """Sites [length], shape (n, 2), for disks of this radius [length] that overlap neither each other nor a wall.

    Rows along x or along y, which continue across periodic sides. What sites are left over are spread evenly.

    Raises
    ------
    InputError
        If fewer sites than n find room; the message says how many do.
    """
    low = 2.0 * radius * CLOSER
    most = {upright: _free(room, radius, low, upright) for upright in (False, True)}
    upright = len(most[True]) > len(most[False])
    found = most[upright]
    if len(found) < n:
        covered = room.packing_fraction(np.full(len(found), radius))
        raise InputError(
            f"{n} disks of diameter {2.0 * radius:.6g} do not fit on a hexagonal lattice between the walls: "
            f"at most {len(found)} do, which is packing fraction {covered:.4f}"
        )
    high = max(room.box.lengths)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        wider = max((_free(room, radius, middle, along_y) for along_y in (False, True)), key=len)
        if len(wider) >= n:
            low, found = middle, wider
        else:
            high = middle
    return found[np.arange(n, dtype=np.int64) * len(found) // n]


def _free(room: Room, radius: float, distance: float, upright: bool) -> NDArray[np.float64]:
    """Sites at this distance from their nearest neighbours, or a little more, off the walls; shape (sites, 2).

    They keep half of the distance from straight walls along the axes, as if there were sites behind them too.
    """
    margin = max(radius * CLEAR, 0.5 * distance)
    low, high = (corner[0] for corner in room.spans(np.array([margin])))
    periodic = np.array(room.box.periodic) & (low == 0.0) & (high == room.box.lengths)
    along, across = (1, 0) if upright else (0, 1)
    side, height = high[along] - low[along], high[across] - low[across]
    columns = int(side / distance) + (0 if periodic[along] else 1)
    if columns < 1:
        return np.empty((0, 2))
    step = side / columns if periodic[along] else distance
    # Neighbours in the next row are half a step away along it; those in the second next are straight across.
    rise = max(0.5 * distance, math.sqrt(max(0.0, distance**2 - 0.25 * step**2)))
    if periodic[across]:
        rows = int(height / rise) // 2 * 2  # every second row is shifted, so their number is even
        if rows < 2:
            return np.empty((0, 2))
        rise = height / rows
    else:
        rows = int(height / rise) + 1
    row, column = np.divmod(np.arange(rows * columns), columns)
    shift = 0.5 * (row % 2)
    position = np.empty((rows * columns, 2))
    position[:, along] = low[along] + (column + shift) * step
    position[:, across] = low[across] + row * rise
    return position[room.gap(position, np.full(len(position), radius)) >= 0.0]
