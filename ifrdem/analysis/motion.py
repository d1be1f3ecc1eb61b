"""Displacements and velocity autocorrelations of files: over time, or of a cooling gas over collisions per disk.

In a cooling gas a mean over time origins has no meaning, because velocities and D decrease as sqrt(T). A mean over
origins in tau, the accumulated collisions per disk, has one: while the gas is homogeneous, the collision rate nu also
decreases as sqrt(T), and the mean free path and the distribution of velocities over the thermal speed stay the same.

J. J. Brey, M. J. Ruiz-Montero, D. Cubero and R. Garcia-Rojo, Phys. Fluids 12, 876 (2000), doi:10.1063/1.870342.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..theory.hydrodynamics import self_diffusion
from ..tools.checked import Array
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory
from . import displacement
from . import result as stored
from .common import MeanValue
from .gas_theory import gas_of
from .result import Columns, Evaluation, FramesFrom, Groups, Reading, all_frames, kinds, times, unit
from .steadiness import is_stationary, stationarity_warning
from .window import is_driven, steady_frames

AT_ONCE = 1_000_000
"""Disks times frames of a field that are in memory at once."""


@dataclass(frozen=True, eq=False, repr=False)
class Displacement(Brief):
    """Mean-square displacement of a group of disks, its fit, its free path [length], and <v^2> of free flight.

    Free flight gives `flight` times the square of the lag [length^2 per lag^2], along the directions of the
    displacement. Both are nan if they are not known.
    """

    msd: displacement.Correlation
    fit: displacement.Diffusion | None
    free_path: float = math.nan
    flight: float = math.nan


class _Plan(NamedTuple):
    """Frames that are used, origins, notes, warnings; and collisions per disk at the frames, if these are the clock."""

    used: list[int]
    origins: Literal["all", "first"]
    notes: list[str]
    warnings: list[str]
    tau: Array | None = None

    def clock(self, trajectory: Trajectory) -> Array:
        """Times [time], or collisions per disk."""
        return trajectory.times[self.used] if self.tau is None else self.tau

    @property
    def column(self) -> str:
        """Name of the column of lags."""
        return "lag" if self.tau is None else "tau"


def _plan(trajectory: Trajectory, frames: Sequence[int] | None, consequence: str) -> _Plan:
    """Suitable frames and time origins; a warning that names the `consequence` if the temperature changes.

    Without a choice, those of the steady window of a gas that has one. All frames of a steady gas, else their second
    half if the gas is steady there. Otherwise all frames: against
    collisions per disk for a gas that cools without driving, with the first frame as the only origin for others.
    """
    frames = steady_frames(trajectory, frames)
    used = all_frames(trajectory, frames)
    if len(used) < 4:
        since = f" from {used.place} on" if isinstance(used, FramesFrom) else ""
        more = "output.frames sets how many a run has, in a study also analyses_at"
        raise InputError(
            f"{trajectory.path}: {len(used)} frames{since} are too few: must be at least 4; {more}"
        )
    T, middle = temperatures(trajectory, used), len(used) // 2
    notes, warnings = [], []
    if T is None:
        notes.append(
            "cannot check if the gas is stationary: the file holds neither temperatures nor velocities"
        )
    if T is not None and not is_stationary(T):
        tau = own_time(trajectory, used)
        if tau is not None and T[-1] < T[0]:
            even = _even(tau)
            text = "all origins" if even else "the first frame only: frames are not evenly spaced in tau"
            notes = [f"against tau, the collisions per disk: over {text}"]
            return _Plan(used, "all" if even else "first", notes, [], tau)
        warnings = [f"{stationarity_warning(trajectory, T)}{consequence}less than a tenth, or drive the gas"]
    if not _even(trajectory.times[used]):
        notes.append("frames are not evenly spaced in time: from the first frame only")
        return _Plan(used, "first", notes, warnings)
    if not warnings:
        return _Plan(used, "all", [*notes, "mean over all origins of time"], [])
    if frames is None and len(used) - middle >= 8 and T is not None and is_stationary(T[middle:]):
        note = "mean over all origins of time in the second half, where the gas is stationary"
        return _Plan(used[middle:], "all", [note], [])
    return _Plan(used, "first", ["the temperature changes: from the first frame only"], warnings)


def _even(clock: Array) -> bool:
    step = np.diff(clock)
    return bool(np.ptp(step) <= displacement.EVEN * np.mean(step))


def own_time(trajectory: Trajectory, used: Sequence[int]) -> Array | None:
    """Collisions per disk at frames of a gas in a periodic box without driving; None of others, and if not known."""
    box, observables = trajectory.box, trajectory.observables
    if box.is_open or box.shear_rate or trajectory.free_area.all_walls or "collisions" not in observables:
        return None
    if is_driven(trajectory):
        return None
    tau = observables["collisions_per_disk"][list(used)]
    return tau if np.all(np.diff(tau) > 0.0) else None


def temperatures(trajectory: Trajectory, used: list[int]) -> Array | None:
    """Temperatures of some frames [energy], stored or from velocities; None if the file holds neither."""
    if "temperature" in trajectory.observables:
        return np.asarray(trajectory.observables["temperature"][used])
    needed = {"velocity"} | ({"position"} if trajectory.box.shear_rate else set())
    if not needed <= set(trajectory.fields):
        return None
    movable = trajectory.disks.movable
    mass = np.where(movable, trajectory.disks.mass, 0.0)
    speeds2 = (np.sum(trajectory[i].peculiar_velocity ** 2, axis=1) for i in used)
    return np.array([0.5 * np.sum(mass * each) for each in speeds2]) / max(np.count_nonzero(movable), 1)


def _parts(
    trajectory: Trajectory, used: Sequence[int], name: str, ids: NDArray[np.intp] | None = None
) -> Iterator[Array]:
    """Yield a field over all frames for some disks at a time: of as many as AT_ONCE allows."""
    size = max(1, AT_ONCE // len(used))
    for first in range(0, trajectory.n, size):
        disks = slice(first, min(first + size, trajectory.n))
        own: slice | NDArray[np.intp] = slice(None)
        if ids is not None:
            wanted = ids[(ids >= disks.start) & (ids < disks.stop)]
            if not len(wanted):
                continue
            disks = slice(int(wanted[0]), int(wanted[-1]) + 1)
            own = wanted - disks.start
        read = [trajectory.read(name, (some, disks))[:, own] for some in evenly_spaced(used)]
        yield (read[0] if len(read) == 1 else np.concatenate(read)).astype(np.float64)


def evenly_spaced(numbers: Sequence[int]) -> Iterator[slice]:
    """Yield slices that give increasing numbers, one after another, each as many of them as are evenly spaced.

    A read of many frames takes little longer than that of one, if it is of few disks.
    """
    first = 0
    while first < len(numbers):
        end, step = first + 1, 1
        if end < len(numbers):
            step = numbers[end] - numbers[first]
        while end < len(numbers) and numbers[end] - numbers[end - 1] == step:
            end += 1
        yield slice(numbers[first], numbers[end - 1] + 1, step)
        first = end


def unwrapped(
    trajectory: Trajectory, used: Sequence[int], ids: NDArray[np.intp] | None = None
) -> Iterator[Array]:
    """Yield paths without jumps of the disks `ids`, or of all, for some at a time [length], shape (frames, disks, 2).

    InputError if the file does not determine how often disks went around the box (`displacement.unwrap`).
    """
    known = [name for name in ("image", "velocity") if name in trajectory.fields][:1]
    for position, *of_disks in zip(
        *(_parts(trajectory, used, name, ids) for name in ("position", *known)), strict=True
    ):
        given = dict(zip(known, of_disks, strict=True))
        yield displacement.unwrap(position, trajectory.box, times=trajectory.times[used], **given)


def _thermal_speeds(
    trajectory: Trajectory, used: Sequence[int], ids: NDArray[np.intp], drift: Array
) -> Array | None:
    """sqrt(<v^2> / 2) of a group of disks at frames [length/time]; None without velocities."""
    if "velocity" not in trajectory.fields:
        return None
    squares, n = np.zeros(len(used)), 0
    for part in _parts(trajectory, used, "velocity", ids):
        squares += np.sum((part - drift) ** 2, axis=(1, 2))
        n += part.shape[1]
    return np.sqrt(0.5 * squares / n)


def _flight(
    trajectory: Trajectory, origins: Sequence[int], ids: NDArray[np.intp], drift: Array, axis: int | None
) -> float:
    """<v^2> of a group of disks along an axis, or both, mean over frames [length^2/time^2]; nan without velocities."""
    if "velocity" not in trajectory.fields:
        return math.nan
    one = slice(None) if axis is None else slice(axis, axis + 1)
    squares, n = 0.0, 0
    for part in _parts(trajectory, origins, "velocity", ids):
        squares += float(np.sum((part - drift)[:, :, one] ** 2))
        n += part.shape[0] * part.shape[1]
    return squares / n


def thermal_path(when: Array, tau: Array, speed: Array) -> float:
    """Distance covered at the thermal speed sqrt(T / m) per collision of a disk of the whole gas [length].

    Between two times, the mean of a speed that falls by Haff's law from u to w is u w ln(u / w) / (u - w).
    """
    u, w = speed[:-1], speed[1:]
    same = np.abs(u - w) <= 1e-9 * u
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(same, u, u * w * np.log(u / w) / (u - w))
    return float(mean @ np.diff(when) / (tau[-1] - tau[0]))


def smooth_restitution(trajectory: Trajectory) -> float | None:
    """e_n of equal smooth disks in a gas that kinetic theory knows; None for others."""
    gas = gas_of(trajectory)
    return None if isinstance(gas, str) else gas.smooth_restitution


def _marks(groups: Groups, name: str) -> tuple[str, str]:
    """Endings of the names of a row and of a column of a group of disks."""
    return ("", "") if len(groups) == 1 else (f" of {name}", f" [{name}]")


def of_msd(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "position")
    words = ", and D with it, as sqrt(T): no single D. Choose frames over which T changes by "
    plan = _plan(trajectory, frames, words)
    used, notes, warnings = plan.used, [*plan.notes], [*plan.warnings]
    box, when, groups = trajectory.box, trajectory.times[used], kinds(trajectory)
    if "image" not in trajectory.fields and any(box.periodic):
        notes.append(
            'no "image" in the file: between frames disks are taken to move by the shortest way (minimum image)'
        )
    moving = stored.drift(trajectory, used)
    notes += moving.notes(trajectory, "displacements are relative to its mean path")
    warnings += [f"D is a mean {name}" for name in groups if "together" in name]
    axis, of_axis = _axis(trajectory)
    notes += of_axis
    if all(_confined_axes(trajectory)):
        warnings = [
            *warnings,
            "walls on all sides bound the displacement: D is at best that of short lags, before disks reach the walls",
        ]

    def paths(ids: NDArray[np.intp]) -> Iterator[Array]:
        for path in unwrapped(trajectory, used, ids):
            if moving:
                for one, t in zip(path, when - when[0], strict=True):
                    one -= t * moving.velocity
            yield path if axis is None else path[:, :, axis : axis + 1]

    results: dict[str, Displacement] = {}
    rows: list[Reading] = []
    table: Columns = {}
    e_n = smooth_restitution(trajectory) if plan.tau is not None else None
    for name, ids in groups.items():
        of, mark = _marks(groups, name)
        found = displacement.mean_square_displacement(
            plan.clock(trajectory), paths(ids), origins=plan.origins
        )
        fit = displacement.diffusion_coefficient(found)
        thermal = math.nan
        if plan.tau is None:
            D = MeanValue(math.nan, math.nan, math.nan) if plan.warnings else fit.mean
            rows.append(Reading.of(f"D{of}", D, unit(trajectory, "length^2/time"), f"D{mark}"))
        else:
            speed = _thermal_speeds(trajectory, used, ids, moving.velocity)
            thermal = math.nan if speed is None else thermal_path(when, plan.tau, speed)
            area = unit(trajectory, "length^2")
            rows.append(Reading.of(f"D / nu{of}", fit.mean, area, f"D_over_nu{mark}"))
            if math.isfinite(thermal):
                reduced = fit.mean.times(thermal**-2)
                rows.append(Reading.of(f"D m nu / T{of}", reduced, key=f"D_reduced{mark}"))
            if e_n is not None:
                theory = self_diffusion(e_n)
                rows.append(Reading("D m nu / T by kinetic theory", theory, key="D_reduced_theory"))
        exponent = fit.exponent, fit.exponent_error
        rows.append(Reading(f"exponent{of}", *exponent, "", f"exponent{mark}", fit.disks))
        if not plan.warnings and fit.no_diffusion:
            warnings.append(
                f"exponent{of} = {fit.exponent:.3g}: must be 1 in diffusion; D{of} is no diffusion coefficient"
            )
        free_path = math.sqrt(0.5 * math.pi) * thermal
        flight = found.components * thermal**2
        if plan.tau is None:
            flight = _flight(
                trajectory, used if plan.origins == "all" else used[:1], ids, moving.velocity, axis
            )
        results[name] = Displacement(found, fit, free_path, flight)
        table |= {plan.column: found.lag, f"msd{mark}": found.value, f"error{mark}": found.error}
        if math.isfinite(thermal):
            table[f"msd / free path^2{mark}"] = found.value / free_path**2
    if plan.tau is not None:
        notes.append(
            "nu: collisions of a disk per time, mean over all disks; free path: sqrt(pi T / (2 m)) / nu"
        )
    if not plan.warnings:
        notes.append(f"line fitted at lags from {fit.lags[0]:.4g} to {fit.lags[1]:.4g}")
    return Evaluation(results, rows, {"": table}, notes, times(trajectory, used), warnings, len(used))


def _axis(trajectory: Trajectory) -> tuple[int | None, list[str]]:
    """The only axis along which displacements count, None for both, and a note on it."""
    if trajectory.box.shear_rate:
        return 1, ["across the flow only"]
    bounded = _confined_axes(trajectory)
    if bounded[0] == bounded[1]:
        return None, []
    axis = bounded.index(False)
    return axis, [f"along {'xy'[axis]} only: walls bound the other direction"]


def _confined_axes(trajectory: Trajectory) -> list[bool]:
    """For x and y, whether walls bound the diffusion along it."""
    walls = trajectory.free_area.all_walls
    if any(wall.shape == "container" for wall in walls):
        return [True, True]
    # In an open box a line bounds one side only; in others, periodic or not, it bounds both.
    lines = [] if trajectory.box.is_open else [wall.towards for wall in walls if wall.shape == "line"]
    return [any(towards[1 - axis] == 0.0 for towards in lines) for axis in (0, 1)]


def of_vacf(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "velocity")
    if trajectory.box.shear_rate:
        text = "is not supported for a sheared box: velocities contain the flow"
        raise InputError(f"vacf {text}; use msd, the displacement across the flow")
    words = (
        ": velocities shrink or grow with sqrt(T), so their decay is not only loss of correlation. Choose frames "
        "over which T changes by "
    )
    plan = _plan(trajectory, frames, words)
    used, notes, groups = plan.used, [*plan.notes], kinds(trajectory)
    moving = stored.drift(trajectory, used)
    notes += moving.notes(trajectory, "velocities are relative to its mean velocity")
    results: dict[str, displacement.Correlation] = {}
    rows: list[Reading] = []
    table: Columns = {}
    for name, ids in groups.items():
        of, mark = _marks(groups, name)
        scale = np.ones(len(used))
        if plan.tau is not None:
            speed = _thermal_speeds(trajectory, used, ids, moving.velocity)
            assert speed is not None
            scale = math.sqrt(2.0) * speed
        parts = (
            (part - moving.velocity if moving else part) / scale[:, None, None]
            for part in _parts(trajectory, used, "velocity", ids)
        )
        found = displacement.velocity_autocorrelation(plan.clock(trajectory), parts, origins=plan.origins)
        first = found.value[0] if found.value[0] > 0.0 else np.nan
        below = np.flatnonzero(found.value < first / math.e)
        lag_unit = unit(trajectory, "time") if plan.tau is None else ""
        if plan.tau is None:
            square = unit(trajectory, "length^2/time^2")
            start = MeanValue(float(found.value[0]), float(found.error[0]), found.disks)
            rows.append(Reading.of(f"<v^2>{of}", start, square, f"v_squared{mark}"))
        if len(below):
            lag = float(found.lag[below[0]])
            rows.append(Reading(f"first lag below 1/e{of}", lag, unit=lag_unit, key=f"decay_lag{mark}"))
        results[name] = found
        table |= {plan.column: found.lag, f"vacf{mark}": found.value, f"error{mark}": found.error}
    if plan.tau is not None:
        notes.append("velocities over sqrt(<v^2>) of each frame; lags in collisions per disk")
        if (e_n := smooth_restitution(trajectory)) is not None:
            theory = self_diffusion(e_n)
            rows.append(Reading("decay by kinetic theory, collisions per disk", theory, key="decay_theory"))
    return Evaluation(results, rows, {"": table}, notes, times(trajectory, used), plan.warnings, len(used))
