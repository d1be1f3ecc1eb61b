"""Checks of walls: their types, their positions in a box, and overlaps with disks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...errors import InputError, shortened
from ...kernels.columns import MOST_WALLS
from ...mpi import current
from ...tools.checked import Array
from ..box import Box
from .wall import Wall, pieces


def check_types(walls: Sequence[Wall]) -> None:
    """Raise InputError unless these are walls."""
    if isinstance(walls, Wall) or not isinstance(walls, Sequence):
        raise InputError(f"walls = {shortened(walls)}: must be a list of walls, [wall] for one")
    for w, one in enumerate(walls):
        if not isinstance(one, Wall):
            raise InputError(f"walls[{w}] = {shortened(one)}: must be a Wall, such as Wall.line(...)")


def check_place(wall: Wall, box: Box) -> None:
    """Raise InputError if a wall reaches across a periodic side of the box, where it is not repeated.

    Also if it is a segment and a piston, and does not reach from side to side.
    """
    if wall.piston is not None and wall.shape == "segment":
        _check_spans(wall, box)
    low, high = wall.bounds()
    reach = 0.0 if math.isinf(wall.motion.extent) else wall.motion.extent
    for axis, side in enumerate(box.lengths):
        if not box.periodic[axis]:
            continue
        if wall.geometry.is_endless:
            if wall.towards[axis] != 0.0:
                raise InputError(
                    f"a line across a periodic direction of the box ({'xy'[axis]}); make that direction not periodic"
                )
            continue
        if wall.piston is not None and wall.normal_of_piston[axis] != 0.0:
            raise InputError(
                f"as a piston it would leave through a periodic side of the box ({'xy'[axis]}); make that direction "
                "not periodic"
            )
        if math.isinf(wall.motion.extent) and wall.motion.direction[axis] != 0.0:
            raise InputError(
                f"its steady motion carries it across a periodic side of the box ({'xy'[axis]}), where walls are not "
                "repeated; let it oscillate, or make that direction not periodic"
            )
        if low[axis] - reach < 0.0 or high[axis] + reach > side:
            raise InputError(
                f"at ({wall.origin[0]:.6g}, {wall.origin[1]:.6g}) it reaches beyond a periodic side of the box, where "
                "walls are not repeated; move it inside, or make that direction not periodic"
            )


def _check_spans(wall: Wall, box: Box) -> None:
    """Raise InputError unless a segment reaches across the box along an axis: its ends would be hit aslant."""
    for axis in range(2):
        ends = wall.origin[axis], wall.origin[axis] + wall.towards[axis]
        if wall.towards[1 - axis] == 0.0 and min(ends) <= 0.0 and max(ends) >= box.lengths[axis]:
            return
    raise InputError(
        "as a piston a segment must run from side to side of the box, along x or y, so that disks hit it along the way "
        "that it moves; give such a one, or a line"
    )


def check(
    walls: Sequence[Wall], box: Box, position: Array, radius: Array, materials: int | None = None,
    time: float = 0.0, tolerance: float = 0.0, collisions: int = 0,
) -> None:  # fmt: skip
    """Refuse walls that cannot be simulated, or that disks overlap at the start, at `time` [time], after `collisions`.

    Of ranks of MPI, each gives the disks of its slice, and all raise the same.

    `materials` is how many the law's table has, if it is known; overlaps up to `tolerance` [length] do not count.
    InputError names wall and disk, and by how much they overlap.
    """
    if (count := pieces(walls)) > MOST_WALLS:
        most = f"{MOST_WALLS} at most are supported, pieces of polylines and the sides of the box included"
        raise InputError(f"{count} walls: {most}")
    comm = current()
    ids, n = comm.number(len(position))
    for w, wall in enumerate(walls):
        name = f"wall {w} ({wall.shape})"
        if materials is not None and not 0 <= wall.material < materials:
            index = f"material index {wall.material}"
            raise InputError(f"{name}: {index}: the law table has {materials} materials")
        try:
            check_place(wall, box)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
        if n and wall.is_present(time, collisions):
            deepest = math.inf, 0, ""
            if len(position):
                gap = wall.gap(position, radius, time)
                i = int(np.argmin(gap))
                deepest = float(gap[i]), ids.start + i, f"({position[i, 0]:.6g}, {position[i, 1]:.6g})"
            least, disk, center = min(comm.allgather(deepest))
            if least < -tolerance:
                raise InputError(
                    f"disk {disk} at {center} overlaps {name}{_standing(wall, time)} by {-least:.3g}"
                )


def _standing(wall: Wall, time: float) -> str:
    """Text on the time or displacement of a wall that moves or opens, for a message; "" for others."""
    if wall.piston is not None:
        return f" at its displacement {wall.piston.displacement:g}"
    return f" at t = {time:g}" if wall.changes_with_time else ""
