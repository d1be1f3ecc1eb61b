"""Starts from a frame of a trajectory: positions, time, and velocities on request."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, nearest_file
from ..model.box import Box
from ..model.overlaps import COMPUTED, STORED, tolerances
from ..model.walls.checks import check as check_walls
from ..model.walls.wall import Wall, sides
from ..mpi import current
from ..quantities import PISTON_SERIES
from ..simulation.start.overlaps import check_no_overlap
from ..tools.checked import Array
from . import packing
from .from_csv import StartData

if TYPE_CHECKING:  # imports h5py
    from ..trajectory.reader import Frame, Trajectory

NEARLY = 16.0
"""Times the overlap that rounding explains: below it an overlap may be due to it all the same."""

COUNTS = ("collisions", "image", "angle", "last_partner")
"""Fields that continue with the clock of the frame: numbers of events and displacements since the first start."""


def read(
    path: Path, frame: int | None, radius: Array, box: Box | None = None, *, motion: bool = False,
    time: float | None = None, walls: Sequence[Wall] = (),
) -> StartData:  # fmt: skip
    """Read a start from a trajectory.

    InputError if the file cannot be read, or holds no such frame or field, another number of disks or another box; or
    if the disks overlap. The message describes the file.

    `frame` counts from 0, or from -1 backwards; None is the last one. The radii (n,) [length] are those of the disks
    that start there, which must fit; the box must be that of the trajectory. With `motion`, velocities and spins are
    taken too, and which disks sleep. Disks that touch overlap by the rounding of a file, or of a run, in single
    precision, some 1e-7 of the box: these are moved apart by as much (`packing.separate`). Of ranks of MPI
    (`Communicator`), each gives the radii of its slice, and reads its rows.

    By default the clock continues: time and walls are those of the frame, and counts of collisions and boxes travelled
    continue too (`COUNTS`). With a `time` [time] a new clock begins there, and all counts begin at 0. In a sheared box
    the images above are displaced by shear_rate Ly t. So the frame's box must have the same shear rate, and the clock
    continues; or it has none, and the clock begins at 0.
    """
    from ..trajectory.reader import Trajectory

    comm = current()
    ids, n = comm.number(len(radius))

    def rows() -> tuple[StartData, str, float, Box]:
        if not path.exists():
            names = [each.name for each in path.parent.glob("*.h5")] if path.parent.is_dir() else []
            raise InputError(f"there is no such file{nearest_file(path.name, names)}")
        with Trajectory(path) as trajectory:
            _check_whole(trajectory, n, box)
            at = trajectory[-1 if frame is None else frame]
            where = f"frame {at.index} of {len(trajectory)}"
            begin, continues = _clock(trajectory.box, box, at.time, time)
            own = slice(ids.start, ids.stop)
            given = of_frame(at, own, motion=motion, time=begin, continues=continues)
            return given, where, _rounding(trajectory), trajectory.box

    given, where, rounding, there = comm.run_on_all(rows)
    if "collisions" in given.past:
        given = replace(given, collisions=int(comm.total(given.past["collisions"])) // 2)
    if box is None:
        return given
    position = given.position
    overlap, into = tolerances(box, radius, position, rounding)
    moved = given.with_pistons(walls)

    def check(times: float = 1.0) -> None:
        check_no_overlap(box, radius, given.position, tolerance=times * overlap, time=given.time)
        check_walls(
            (*moved, *sides(box)), box, given.position, radius, time=given.time, tolerance=times * into,
            collisions=given.collisions,
        )  # fmt: skip

    try:
        check()
        if rounding and box.shear_rate and box.image_above(given.time) != 0.0:
            check_no_overlap(
                box, radius, position, time=given.time
            )  # `separate` does not know sheared images
        elif rounding:
            standing = [wall for wall in moved if wall.is_present(given.time, given.collisions)]
            position = packing.separate(box, radius, position, walls=standing, time=given.time)
    except InputError as error:
        reason = _other_radii(path, radius, ids)
        if not reason and time is not None and any(wall.changes_with_time for wall in walls):
            reason = ". At another start.time the walls stand elsewhere"
        elif not reason and rounding and _passes_nearly(check):
            reason = '. Positions in single precision are rounded: output.precision = "f64" keeps them'
        raise InputError(f"{where}: {error}{reason}") from None
    velocity = given.velocity
    if velocity is not None and not there.shear_rate:
        velocity = velocity + box.flow(position)
    return replace(given, position=position, velocity=velocity)


def _rounding(trajectory: Trajectory) -> float:
    """Rounding of the positions of a trajectory, for `tolerances`: by the file, and by the run that made it."""
    stored = STORED if trajectory.dtype("position") == np.float32 else 0.0
    in_single = trajectory.record(
        "case_in_full", lambda case: case["run"]["precision"] == "f32", '{"run": {"precision": ""}}'
    )
    return stored + COMPUTED * in_single


def _passes_nearly(check: Callable[[float], None]) -> bool:
    """True if a check passes with `NEARLY` times its tolerance."""
    try:
        check(NEARLY)
    except InputError:
        return False
    return True


def of_frame(
    frame: Frame,
    disks: slice = slice(None),
    *,
    motion: bool = True,
    time: float | None = None,
    continues: bool = True,
) -> StartData:
    """Start of some disks from a frame.

    InputError if the file does not hold the field. The `time` [time] is that of the frame, or another one; counts
    continue if the clock `continues`, else they begin at 0 (`COUNTS`).
    """
    trajectory = frame.trajectory

    def field(name: str) -> Array:
        value = trajectory.read(name, (frame.index, disks))
        return value.astype(np.float64) if value.dtype.kind == "f" else value

    position = trajectory.box.wrap(field("position"), frame.time)
    velocity, spin = (field("velocity"), field("angular_velocity")) if motion else (None, None)
    kept = [*(COUNTS if continues else ()), *(("asleep",) if motion else ())]
    past = {name: field(name) for name in kept if name in trajectory.fields}
    names = PISTON_SERIES[:2]
    pistons = None
    if names[0] in trajectory.observables:
        pistons = np.column_stack([trajectory.observables[name][frame.index] for name in names])
        pistons[:, 1] *= motion
    begin = frame.time if time is None else time
    return StartData(position, velocity, spin, time=begin, past=past, pistons=pistons)


def _clock(there: Box, box: Box | None, frame_time: float, time: float | None) -> tuple[float, bool]:
    """Time at which a run starts from a frame [time], and True if the clock of the frame continues."""
    rate = 0.0 if box is None else box.shear_rate
    if there.shear_rate and box is not None:
        if rate != there.shear_rate:
            raise InputError(
                f"its box is sheared (box.shear_rate = {there.shear_rate!r}), and the images above and below have "
                f"moved on since its start: the case must have the same rate, not {rate:g}"
            )
        boxes = rate * box.lengths[1] / box.lengths[0] * (frame_time - (frame_time if time is None else time))
        if abs(boxes - round(boxes)) > 1e-9:
            raise InputError(
                f"start.time = {time:g}: the images above and below are where the flow has moved them by t = "
                f"{frame_time!r}, the time of the frame: they must differ by a multiple of "
                f"{box.lengths[0] / abs(rate * box.lengths[1]):.6g} (without start.time they are the same)"
            )
    elif rate and time is None:
        return 0.0, False  # when the images stand as in a box at rest
    return (frame_time, True) if time is None else (time, False)


def _check_whole(trajectory: Trajectory, n: int, box: Box | None) -> None:
    """Refuse a trajectory of another number of disks, or another box."""
    sides = trajectory.box.lengths
    if trajectory.n != n:
        raise InputError(f"has {trajectory.n} disks: must be {n}, the sum of the species' numbers")
    if box is not None and not np.allclose(sides, box.lengths, rtol=1e-12, atol=0.0):
        if box.is_open or trajectory.box.is_open:
            raise InputError("either its box or that of the case is open: both must be, or neither")
        raise InputError(
            f"its box is {sides[0]:.9g} x {sides[1]:.9g}, that of the case {box.lengths[0]:.9g} x "
            f"{box.lengths[1]:.9g}: with box.lengths = [{sides[0]!r}, {sides[1]!r}] they agree"
        )


def _other_radii(path: Path, radius: Array, ids: range) -> str:
    """A likely cause of an overlap: the first disk whose radius in the trajectory differs; else empty."""

    def found() -> str:
        from ..trajectory.reader import Trajectory

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

    comm = current()
    return next(filter(None, comm.allgather(comm.run_on_all(found))), "")
