"""Temperatures of the species of a mixture, their ratios, and those of kinetic theory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..quantities import SPECIES_SERIES
from ..tools.checked import Array
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory
from . import result as stored
from . import steadiness
from .common import FEWEST_CORRELATED, mean_with_error
from .gas_theory import gas_of
from .result import Columns, Evaluation, Reading, kinds, times
from .window import steady_frames

FRAME_OF_REFERENCE = (
    "temperatures are relative to the mean velocity where the gas can drift freely, else in the lab"
)


@dataclass(frozen=True, eq=False, repr=False)
class SpeciesTemperatures(Brief):
    """Temperatures of s species over time."""

    names: list[str]
    time: Array
    """Times [time], shape (rows,)."""
    collisions_per_disk: Array | None
    """tau of the whole gas, shape (rows,); None where the file does not count collisions."""
    temperature: Array
    rotational_temperature: Array
    """temperature, rotational_temperature: of velocities relative to the mean velocity of the whole gas where it can
    drift freely, otherwise in the lab [energy], shape (rows, s)."""
    theory: tuple[Array, Array] | None
    """T and T_rot of each species by kinetic theory, from those of the first frame [energy], two arrays of shape
    (rows, s); None where the theory does not apply."""


class _Rows(NamedTuple):
    time: Array
    tau: Array | None
    T: Array
    T_rot: Array


def of_species(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    groups = kinds(trajectory)
    if len(groups) < 2:
        raise InputError(f"{trajectory.path} has one species: must have two or more")
    names = [*groups]
    frames = steady_frames(trajectory, frames)
    used = stored.all_frames(trajectory, frames)
    rows = _of_series(trajectory, names, None if frames is None else times(trajectory, used))
    if rows is None:
        rows = _of_frames(trajectory, groups, used)
    notes, theory = [FRAME_OF_REFERENCE], None
    gas = gas_of(trajectory)
    if isinstance(gas, str):
        notes.append(gas)
    else:
        try:
            elapsed = np.maximum(rows.time - float(trajectory.times[0]), 0.0)
            T_theory, T_rot_theory, text = gas.of_groups([*groups.values()], elapsed)
            theory = T_theory, T_rot_theory
            notes.append(f"{text}, from the temperatures of the first frame")
        except InputError as error:
            notes.append(f"no kinetic theory here: {error}")
    late = slice(len(rows.time) // 2 if frames is None else 0, None)
    readings: list[Reading] = []
    changes: list[steadiness.Change] = []

    def add(
        name: str, key: str, measured: tuple[Array, Array], predicted: tuple[Array, Array] | None
    ) -> None:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = (measured[0] / measured[1])[late]
        if not np.isfinite(ratio).all():
            return
        readings.append(Reading.of(name, mean_with_error(ratio), key=key))
        if len(ratio) >= 2 * FEWEST_CORRELATED:
            early, later = np.array_split(ratio, 2)
            changes.append(steadiness.between(name, mean_with_error(early), mean_with_error(later)))
        if predicted is not None:
            value = float(np.mean((predicted[0] / predicted[1])[late]))
            readings.append(Reading(f"{name} by kinetic theory", value, key=f"{key}_theory"))

    def of(
        values: tuple[Array, Array] | None, i: int, j: int, upper: int, lower: int
    ) -> tuple[Array, Array] | None:
        return None if values is None else (values[upper][:, i], values[lower][:, j])

    both = (rows.T, rows.T_rot)
    for i in range(1, len(names)):
        text, key = f"T of {names[i]} / T of {names[0]}", f"T_ratio_{names[i]}"
        add(text, key, (both[0][:, i], both[0][:, 0]), of(theory, i, 0, 0, 0))
    for i, name in enumerate(names if np.any(rows.T_rot) else ()):
        add(f"theta of {name}", f"theta_of_{name}", (both[1][:, i], both[0][:, i]), of(theory, i, i, 1, 0))
    if not readings:
        raise InputError(f"{trajectory.path}: no ratio of temperatures: a species is at rest")
    notes.append(f"means over {'the second half of ' * (frames is None)}{len(rows.time)} rows")
    notes += stored.few_rows(len(rows.time[late]), "rows")
    table: Columns = {"time": rows.time}
    table |= {} if rows.tau is None else {"collisions_per_disk": rows.tau}
    for values, mark in ((both, ""), (theory, " by theory")):
        for i, name in enumerate(names if values is not None else ()):
            assert values is not None
            with np.errstate(divide="ignore", invalid="ignore"):
                theta = values[1][:, i] / values[0][:, i]
            table |= {
                f"T [{name}]{mark}": values[0][:, i], f"T_rot [{name}]{mark}": values[1][:, i],
                f"theta [{name}]{mark}": theta,
            }  # fmt: skip
    found = SpeciesTemperatures(names, rows.time, rows.tau, *both, theory)
    span = (float(rows.time[0]), float(rows.time[-1]))
    return Evaluation(found, readings, {"": table}, notes, span, steadiness.warnings(changes))


def _of_series(trajectory: Trajectory, names: list[str], span: tuple[float, float] | None) -> _Rows | None:
    """Temperatures from the series within a span of time; None if it does not have those of these species."""
    series = trajectory.series
    if any(name not in series for name in SPECIES_SERIES) or len(series.time) < 4:
        return None
    columns = series.columns(SPECIES_SERIES[0])
    if not set(names) <= set(columns):
        return None
    which = [columns.index(name) for name in names]
    inside = np.ones(len(series.time), dtype=bool)
    if span is not None:
        inside = (series.time >= span[0]) & (series.time <= span[1])
    tau = series["collisions_per_disk"][inside]
    T, T_rot = (series[name][inside][:, which] for name in SPECIES_SERIES[:2])
    return _Rows(series.time[inside], tau, T, T_rot)


def _of_frames(trajectory: Trajectory, groups: stored.Groups, used: Sequence[int]) -> _Rows:
    """Temperatures from velocities and spins of frames."""
    stored.require_velocities(trajectory, "angular_velocity")
    disks, drift = trajectory.disks, stored.drift(trajectory, used).velocity
    T, T_rot = [], []
    for i in used:
        frame = trajectory[i]
        moving = np.sum((frame.peculiar_velocity - drift) ** 2, axis=1)
        T.append([0.5 * np.mean(disks.mass[ids] * moving[ids]) for ids in groups.values()])
        T_rot.append([np.mean(disks.inertia[ids] * frame.spin[ids] ** 2) for ids in groups.values()])
    observables = trajectory.observables
    tau = observables["collisions_per_disk"][used] if "collisions" in observables else None
    return _Rows(trajectory.times[used], tau, np.array(T), np.array(T_rot))
