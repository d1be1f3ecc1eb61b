"""Starts from a frame of a trajectory: positions, and velocities and spins if wished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, nearest
from ..model.box import Box
from ..model.free_area import Room
from ..model.overlaps import TOLERANCE, check_no_overlap
from ..model.walls import Wall
from ..model.walls import check as check_walls
from ..tools import slices, world
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from . import packing
from .from_csv import Given

ROUNDING = 2.0**-22
"""Overlap, as a part of the box's longer side, that single precision explains: twice sqrt(2) times 2^-24, and some."""


def read(
    path: Path, frame: int | None, radius: Array, box: Box | None = None, *, motion: bool = False,
    walls: Sequence[Wall] = (), comm: Any = None,
) -> Given:  # fmt: skip
    """Read a start from a trajectory.

    InputError if the file cannot be read, or holds no such frame or field, another number of disks or another box; or
    if the disks overlap. The message says what is there.

    `frame` counts from 0, or from -1 backwards; None is the last one. The radii (n,) [length] are those of the disks
    that start there, which must fit; the box must be that of the trajectory, and walls stand where they are at t = 0.
    With `motion`, velocities and spins are taken too. Disks that touch in a file in single precision overlap by its
    rounding, some 1e-7 of the box: these are moved apart by as much (`packing.separate`). Of ranks of MPI (`comm`),
    each gives the radii of its slice (`slice_of`), and reads its rows.
    """
    ids, n = slices.numbered(len(radius), comm)

    def rows() -> tuple[Given, str, bool, float]:
        if not path.exists():
            names = [each.name for each in path.parent.glob("*.h5")] if path.parent.is_dir() else []
            raise InputError(f"there is no such file{nearest(path.name, names)}")
        with Trajectory(path) as trajectory:
            _check_whole(trajectory, n, box)
            at = trajectory[-1 if frame is None else frame]
            own = slice(ids.start, ids.stop)

            def field(name: str) -> Array:
                return trajectory.read(name, (at.index, own)).astype(np.float64)

            position = trajectory.box.wrap(field("position"))
            velocity, spin = (field("velocity"), field("spin")) if motion else (None, None)
            single = trajectory.dtype("position") == np.float32
            given, where = Given(position, velocity, spin), f"frame {at.index} of {len(trajectory)}"
            return given, where, single, max(trajectory.box.lengths)

    given, where, single, side = world.together(comm, rows)
    if box is None:
        return given
    position = given.position
    size = world.largest(comm, float(np.abs(position).max(initial=0.0))) if box.is_open else side
    largest = world.largest(comm, float(radius.max(initial=0.0)))
    smallest = -world.largest(comm, -float(radius.min(initial=np.inf)))
    overlap, into = TOLERANCE, TOLERANCE * largest  # that is taken as rounding, with others and with walls
    if single:
        overlap, into = ROUNDING * size / (2.0 * smallest), ROUNDING * side
    try:
        all_walls = Room(box, tuple(walls)).all_walls
        check_no_overlap(box, radius, position, tolerance=overlap, comm=comm)
        check_walls(all_walls, box, position, radius, tolerance=into, comm=comm)
        if single:
            given = replace(given, position=packing.separate(box, radius, position, walls=walls, comm=comm))
    except InputError as error:
        why = _other_radii(path, radius, ids, comm)
        if single and not why:
            why = '. Positions in single precision are rounded: output.precision = "f8" keeps them'
        raise InputError(f"{where}: {error}{why}") from None
    return given


def _check_whole(trajectory: Trajectory, n: int, box: Box | None) -> None:
    """Refuse a trajectory of another number of disks, or another box."""
    sides = trajectory.box.lengths
    if trajectory.box.shear_rate:
        raise InputError(
            f"its box is sheared (shear_rate = {trajectory.box.shear_rate:g}), and the images above and below have "
            "moved on since its start: from Python, Simulation goes on from a State with the frame's time"
        )
    if trajectory.n != n:
        raise InputError(f"has {trajectory.n} disks: {n} are needed, the sum of the species' numbers")
    if box is not None and not np.allclose(sides, box.lengths, rtol=1e-12, atol=0.0):
        if box.is_open or trajectory.box.is_open:
            raise InputError("either its box or that of the case is open: both must be, or neither")
        raise InputError(
            f"its box is {sides[0]:.9g} x {sides[1]:.9g}, that of the case {box.lengths[0]:.9g} x "
            f"{box.lengths[1]:.9g}: with box.lengths = [{sides[0]!r}, {sides[1]!r}] they agree"
        )


def _other_radii(path: Path, radius: Array, ids: range, comm: Any) -> str:
    """Likely cause of an overlap: disks of the trajectory have other radii; the first one is named."""

    def told() -> str:
        with Trajectory(path) as trajectory:
            there = trajectory.constants("radius", slice(ids.start, ids.stop))
        other = np.abs(there - radius) > 1e-6 * radius  # more than rounding
        if not other.any():
            return ""
        i = int(np.argmax(other))
        return (
            f". The trajectory's disks have other radii: disk {ids[i]} has {there[i]:.6g} there, "
            f"{radius[i]:.6g} in this case"
        )

    found = world.together(comm, told)
    return found if comm is None else next(filter(None, comm.allgather(found)), "")
