"""Starts from a frame of a trajectory: positions, and velocities and spins if wished."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, nearest
from ..model.box import Box
from ..model.free_area import Room
from ..model.overlaps import TOLERANCE
from ..model.walls import Wall
from ..model.walls import check as check_walls
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from . import packing
from .from_csv import Given
from .placement import check_no_overlap

ROUNDING = 2.0**-22
"""Overlap, as a part of the box's longer side, that single precision explains: twice sqrt(2) times 2^-24, and some."""


def read(
    path: Path, frame: int | None, radius: Array, box: Box | None = None, *, motion: bool = False,
    walls: Sequence[Wall] = (),
) -> Given:  # fmt: skip
    """Read a start from a trajectory.

    InputError if the file cannot be read, or holds no such frame or field, another number of disks or another box; or
    if the disks overlap. The message says what is there.

    `frame` counts from 0, or from -1 backwards; None is the last one. The radii (n,) [length] are those of the disks
    that start there, which must fit; the box must be that of the trajectory, and walls stand where they are at t = 0.
    With `motion`, velocities and spins are taken too. Disks that touch in a file in single precision overlap by its
    rounding, some 1e-7 of the box: these are moved apart by as much (`packing.separate`).
    """
    if not path.exists():
        names = [each.name for each in path.parent.glob("*.h5")] if path.parent.is_dir() else []
        raise InputError(f"there is no such file{nearest(path.name, names)}")
    with Trajectory(path) as trajectory:
        n, sides = trajectory.disks.n, trajectory.box.lengths
        if trajectory.box.shear_rate:
            raise InputError(
                f"its box is sheared (shear_rate = {trajectory.box.shear_rate:g}), and the images above and below have "
                "moved on since its start: from Python, Simulation goes on from a State with the frame's time"
            )
        if n != len(radius):
            raise InputError(f"has {n} disks: {len(radius)} are needed, the sum of the species' numbers")
        if box is not None and not np.allclose(sides, box.lengths, rtol=1e-12, atol=0.0):
            if box.is_open or trajectory.box.is_open:
                raise InputError("either its box or that of the case is open: both must be, or neither")
            raise InputError(
                f"its box is {sides[0]:.9g} x {sides[1]:.9g}, that of the case {box.lengths[0]:.9g} x "
                f"{box.lengths[1]:.9g}: with box.lengths = [{sides[0]!r}, {sides[1]!r}] they agree"
            )
        at = trajectory[-1 if frame is None else frame]
        position = trajectory.box.wrap(at.position)
        velocity, spin = (at.velocity, at.spin) if motion else (None, None)
        single = trajectory.dataset("position").dtype == np.float32
        if box is None:
            return Given(position, velocity, spin)
        size = float(np.abs(position).max(initial=0.0)) if box.is_open else max(sides)
        try:
            all_walls = Room(box, tuple(walls)).all_walls
            if not single:
                check_no_overlap(box, radius, position)
                check_walls(
                    all_walls, box, position, radius, tolerance=TOLERANCE * float(radius.max(initial=0.0))
                )
            else:
                check_no_overlap(
                    box, radius, position, tolerance=ROUNDING * size / (2.0 * float(radius.min()))
                )
                check_walls(all_walls, box, position, radius, tolerance=ROUNDING * max(sides))
                position = packing.separate(box, radius, position, walls=walls)
        except InputError as error:
            raise InputError(
                f"frame {at.index} of {len(trajectory)}: {error}{_why(trajectory, radius, single)}"
            ) from None
    return Given(position, velocity, spin)


def _why(trajectory: Trajectory, radius: Array, single: bool) -> str:
    """Likely cause of an overlap."""
    other = np.abs(trajectory.disks.radius - radius) > 1e-6 * radius  # more than rounding
    if other.any():
        i = int(np.argmax(other))
        return (
            f". The trajectory's disks have other radii: disk {i} has {trajectory.disks.radius[i]:.6g} there, "
            f"{radius[i]:.6g} in this case"
        )
    return '. Positions in single precision are rounded: output.precision = "f8" keeps them' if single else ""
