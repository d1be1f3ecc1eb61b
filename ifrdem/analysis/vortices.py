"""Velocity correlations and spectra of files, with the correlation length against collisions per disk."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ..errors import InputError
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from . import flow
from . import result as stored
from .result import Columns, Evaluation, Reading, second_half, times, unit

FARTHEST, HIGHEST = 60.0, 64
"""Largest distance of correlations in mean diameters; most waves of a spectrum along the longest side."""


def _velocities(trajectory: Trajectory, used: Sequence[int]) -> Iterator[Array]:
    return (trajectory[i].peculiar_velocity[stored.index_of_movable(trajectory.disks)] for i in used)


def _positions(trajectory: Trajectory, used: Sequence[int]) -> Iterator[Array]:
    return (trajectory[i].position[stored.index_of_movable(trajectory.disks)] for i in used)


def _by_frame(trajectory: Trajectory, used: Sequence[int], **columns: Sequence[float]) -> Columns:
    """Table of numbers of single frames, with their times and collisions per disk."""
    table: Columns = {"time": trajectory.times[list(used)]}
    if "collisions" in trajectory.observables:
        table["collisions_per_disk"] = trajectory.observables["collisions_per_disk"][list(used)]
    return table | {name: np.array(values) for name, values in columns.items()}


def of_correlation(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "position", "velocity")
    used, box = second_half(trajectory, frames), trajectory.box
    sides = [side for side in box.periods if side] or [math.inf]
    diameter = 2.0 * float(trajectory.disks.radius.mean())
    reach = min(FARTHEST * diameter, 0.5 * min(sides))
    singles = [_correlation(trajectory, [i], reach) for i in used]
    found = flow.mean_correlation(singles)
    lengths = [one.length for one in singles]
    of_length = unit(trajectory, "length")
    rows = [Reading("correlation length", found.length, unit=of_length, key="length")]
    rows += [
        Reading(f"correlation length, {name} frame", length, unit=of_length, key=f"length_{name}")
        for name, length in (("first", lengths[0]), ("last", lengths[-1]))
    ]
    # The first whole bin beyond contact of the smallest disks.
    near = int(np.argmax(found.r - found.r[0] >= 2.0 * float(trajectory.disks.radius.min())))
    rows += [
        Reading(
            f"correlation {name} r at contact", float(value[near]), float(error[near]), key=f"{name}_contact",
            n_eff=float(found.n_eff[near]),
        )
        for name, value, error in (
            ("along", found.along, found.along_error), ("across", found.across, found.across_error)
        )
    ]  # fmt: skip
    names = ("r", "along", "along_error", "across", "across_error", "n_eff", "pairs")
    table = {name: getattr(found, name)[near:] for name in names}
    notes = [
        "over <v^2> / 2: 0 for independent velocities, 1 for equal ones",
        "correlation length: where the correlation across r falls below 0; none if it is not clearly above 0 before",
    ]
    tables = {"": table, "frames": _by_frame(trajectory, used, length=lengths)}
    return Evaluation(
        found, rows, tables, notes, times(trajectory, used), stored.part_warnings(trajectory), len(used)
    )


def _correlation(trajectory: Trajectory, used: Sequence[int], reach: float) -> flow.VelocityCorrelation:
    return flow.velocity_correlation(
        _positions(trajectory, used), _velocities(trajectory, used), trajectory.box, r_max=reach,
        time=trajectory.times[list(used)],
    )  # fmt: skip


def of_spectrum(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "position", "velocity")
    used = second_half(trajectory, frames)
    singles = [_spectrum(trajectory, [i]) for i in used]
    found = _spectrum(trajectory, used) if len(used) > 1 else singles[0]
    high = int(np.argmax(found.across))
    wave, of_length = unit(trajectory, "1/length"), unit(trajectory, "length")
    across = found.across, found.across_error, found.across_ends
    along = found.along, found.along_error, found.along_ends
    rows = [
        Reading("smallest k", float(found.k[0]), unit=wave, key="smallest_k"),
        Reading.at(0, "across k, at the smallest k", "across_smallest_k", *across),
        Reading.at(0, "along k, at the smallest k", "along_smallest_k", *along),
        Reading.at(high, "highest across k", "across_max", *across),
        Reading("wavelength of the highest", found.wavelength, unit=of_length, key="wavelength"),
    ]
    names = ("k", "across", "across_error", "along", "along_error", "vorticity", "modes")
    table = {name: getattr(found, name) for name in names}
    for name, ends in (("across", found.across_ends), ("along", found.along_ends)):
        table |= {f"{name}_low": ends[0], f"{name}_high": ends[1]}
    notes = [
        "<|v_k|^2> across and along k over that of independent velocities; vorticity: k^2 times the part across k"
    ]
    by_frame = _by_frame(
        trajectory, used, wavelength=[one.wavelength for one in singles],
        highest=[float(one.across.max()) for one in singles],
    )  # fmt: skip
    tables = {"": table, "frames": by_frame}
    return Evaluation(
        found, rows, tables, notes, times(trajectory, used), stored.part_warnings(trajectory), len(used)
    )


def _spectrum(trajectory: Trajectory, used: Sequence[int]) -> flow.VelocitySpectrum:
    box = trajectory.box
    if box.is_open:
        raise InputError("box is open: must be periodic along x and y for a spectrum")
    k_max = 2.0 * np.pi * (HIGHEST + 0.5) / max(box.lengths)
    return flow.velocity_spectrum(
        _positions(trajectory, used), _velocities(trajectory, used), box, k_max=k_max, rings=HIGHEST,
        time=trajectory.times[list(used)],
    )  # fmt: skip
