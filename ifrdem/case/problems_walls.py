"""What is wrong with the walls of a case, beyond types and ranges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..kernels.limits import MOST_WALLS
from ..model.box import Box
from ..model.free_area import Room
from ..model.walls import Wall, check_place
from .draft import Draft, Problem, wall_of


def problems_of_walls(draft: Draft, box: Box, radius: NDArray[np.float64]) -> Iterator[Problem]:
    """What is wrong with walls around disks of these radii [length], shape (n,)."""
    if box.is_open:
        if draft.wall:
            yield Problem(
                "wall", None, "walls in an open box are not supported: leave out box.open and give lengths"
            )
        return
    if draft.box is not None and draft.box.lengths is None and draft.wall:
        text = "walls stand at places in the box: box.lengths is needed instead, and `ifrdem check` says the fraction"
        yield Problem("box.packing_fraction", f"{draft.box.packing_fraction:g}", text)
        return
    walls: list[Wall] = []
    for i, section in enumerate(draft.wall):
        if section is None:
            continue
        key = f"wall[{i}]"
        wall = wall_of(section)
        try:
            check_place(wall, box)
        except InputError as error:
            yield Problem(key, None, f"{section.shape}: {error}")
            continue
        if _outside(wall, box):
            width, height = box.lengths
            yield Problem(
                key,
                None,
                f"the {wall.shape} lies outside of the box, which reaches from [0, 0] to [{width:.6g}, {height:.6g}]",
            )
            continue
        walls.append(wall)
    room = Room(box, tuple(walls))
    if len(room.all_walls) > MOST_WALLS:
        text = (
            f"{len(room.all_walls)} walls: {MOST_WALLS} at most are supported, the sides of the box included"
        )
        yield Problem("wall", None, text)
    elif len(walls) == len(draft.wall) and room.all_walls and room.area(float(radius.max())) <= 0.0:
        yield Problem(
            "wall" if walls else "box.lengths",
            None,
            f"the walls leave no room for a disk of diameter {2.0 * float(radius.max()):.6g}",
        )


def _outside(wall: Wall, box: Box) -> bool:
    """Whether a post or segment is out of reach of the box; a line or container so placed leaves no room."""
    if wall.shape not in ("post", "segment") or wall.motion.kind == "steady":
        return False
    reach = wall.radius + wall.motion.extent
    ends = np.array((wall.place, np.add(wall.place, wall.towards)))
    beyond = (ends.max(axis=0) + reach <= 0.0) | (ends.min(axis=0) - reach >= box.lengths)
    return bool(np.any(beyond))
