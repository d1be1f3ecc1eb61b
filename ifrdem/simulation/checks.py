"""What the engine refuses before it makes any array, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..kernels.limits import ADDRESSABLE, MOST_DISKS
from ..model.box import Box
from ..model.state import Disks, State
from ..model.walls import Wall
from . import magnitudes

if TYPE_CHECKING:
    from ..model.forces import Force


def check(
    disks: Disks,
    box: Box,
    state: State,
    materials: int,
    walls: Sequence[Wall],
    gravity: tuple[float, float],
    precision: str,
    forces: Sequence[Force],
    *,
    velocity_cutoff: float,
    contact_time: float,
) -> None:
    """Refuse what the engine cannot simulate; arguments as for `Engine`, `materials` the rows of the law's table.

    Raises
    ------
    InputError
        Names what is wrong, and what to do instead.
    """
    n = disks.n
    if n > MOST_DISKS:
        raise InputError(f"{n} disks: the engine's 32-bit indices allow {MOST_DISKS} at most")
    if state.n != n:
        raise InputError(f"the state has {state.n} disks: {n} are needed")
    check_motion(disks, state)
    if n and int(disks.material.max()) >= materials:
        raise InputError(f"material index {disks.material.max()}: the law table has {materials} materials")
    diameter = 2.0 * float(disks.radius.max()) if n else 0.0
    shortest = min(box.lengths)
    if diameter > shortest / 3.0:
        i = int(np.argmax(disks.radius))
        raise InputError(
            f"disk {i} has diameter {diameter:.6g}, more than a third of the box side {shortest:.6g}: "
            "it could meet its own periodic image; use a larger box"
        )
    for name, value in (("velocity_cutoff", velocity_cutoff), ("contact_time", contact_time)):
        if not (math.isfinite(value) and value >= 0.0):
            raise InputError(f"{name} = {value}: a finite number not below 0 is needed")
    hottest = max((wall.temperature or 0.0 for wall in walls), default=0.0)
    thermal = sum(wall.temperature is not None for wall in walls)
    if n * thermal > ADDRESSABLE:  # each disk's heat from each
        raise InputError(
            f"{n} disks and {thermal} thermal walls: the engine's 32-bit indices allow {ADDRESSABLE // thermal} disks "
            "with so many"
        )
    if box.shear_rate:
        _check_sheared(disks, box, walls)
    speed = magnitudes.fastest(disks, state.velocity, state.spin)
    magnitudes.check(disks, box, speed, precision, hottest)
    check_between_collisions(disks, box, gravity, forces)


def check_motion(disks: Disks, state: State) -> None:
    """Refuse immovable disks that move."""
    moving = ~disks.movable & (np.any(state.velocity != 0.0, axis=1) | (state.spin != 0.0))
    if np.any(moving):
        i = int(np.argmax(moving))
        raise InputError(
            f"disk {i} has an infinite mass and moves (velocity {state.velocity[i]}, spin {state.spin[i]}): "
            "an immovable disk must be at rest"
        )


def check_between_collisions(
    disks: Disks, box: Box, gravity: tuple[float, float], forces: Sequence[Force]
) -> None:
    """Refuse gravity and forces that cannot act on these disks; arguments as for `Engine`."""
    for axis, pull in enumerate(gravity):
        if pull != 0.0 and box.is_open:
            raise InputError(
                f"gravity = {gravity}: disks would fall for ever in an open box; use a box that is not periodic, "
                "with a floor"
            )
        if pull != 0.0 and box.periodic[axis]:
            raise InputError(
                f"gravity = {gravity}: disks would fall for ever in the periodic direction {'xy'[axis]}; make it "
                "not periodic, with a floor"
            )
    if forces and disks.n and not np.all(np.isfinite(disks.mass)):
        raise InputError(
            "forces are not supported where disks of infinite mass are: use walls (Wall.post) instead"
        )
    if any(gravity) and forces:
        from ..model.forces import TableFriction  # imports Taichi, as whoever made a force did

        if any(isinstance(force, TableFriction) for force in forces):
            raise InputError(
                f"gravity = {gravity}: along a table, table friction is not supported (a coin would have to stay where "
                "friction holds it); leave one of them out"
            )


def _check_sheared(disks: Disks, box: Box, walls: Sequence[Wall]) -> None:
    """Refuse what cannot be in a sheared box."""
    if walls:
        raise InputError(
            f"walls: not supported in a sheared box (shear_rate = {box.shear_rate:g}), whose flow and images would "
            "pass through them; use a box without shear_rate"
        )
    if not np.all(disks.movable):
        i = int(np.argmin(disks.movable))
        raise InputError(
            f"disk {i} has an infinite mass: immovable disks are not supported in a sheared box (shear_rate = "
            f"{box.shear_rate:g}), whose flow carries everything along"
        )
