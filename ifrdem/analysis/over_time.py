"""Analyses of what happens between frames of a file: displacements, pressure, cooling, angles of impact."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from . import cooling, displacement, impact, pressure
from . import result as stored
from .result import NOT_STEADY, Evaluation, Reading, every, times, unit


def _motion(
    trajectory: Trajectory, chosen: Sequence[int] | None, consequence: str
) -> tuple[list[int], str, list[str], list[str]]:
    """Frames and origins of time that suit them, why, and a doubt with its consequence if the temperature changes.

    A gas that cools or heats up has no mean over origins. All frames if the gas is steady, else their second half if it
    is steady there, else all from the first one on.
    """
    used = every(trajectory, chosen)
    if len(used) < 4:
        raise InputError(f"{trajectory.path}: {len(used)} frames are too few for what changes with time")
    T, middle = _temperatures(trajectory, used), len(used) // 2
    notes, doubts = [], []
    if T is None:
        notes.append("the file holds no temperatures or velocities that tell if the gas is steady")
    if T is not None and not _keeps(T):
        doubts = [f"{_unsteady(trajectory, T)}{consequence}less than a tenth, or drive the gas"]
    step = np.diff(trajectory.times[used])
    if np.ptp(step) > displacement.EVEN * np.mean(step):
        notes.append("frames are not evenly spaced in time: from the first frame only")
        return used, "first", notes, doubts
    if not doubts:
        return used, "all", [*notes, "mean over all origins of time"], []
    if chosen is None and len(used) - middle >= 8 and T is not None and _keeps(T[middle:]):
        told = "mean over all origins of time in the second half, where the gas is steady"
        return used[middle:], "all", [told], []
    return used, "first", ["the temperature changes: from the first frame only"], doubts


def _temperatures(trajectory: Trajectory, used: list[int]) -> Array | None:
    """Temperatures of these frames [energy], as stored or by the velocities; None if the file holds neither."""
    if "temperature" in trajectory.observables:
        return np.asarray(trajectory.observables["temperature"][used])
    needed = {"velocity"} | ({"position"} if trajectory.box.shear_rate else set())
    if not needed <= set(trajectory.fields):
        return None
    movable = trajectory.disks.movable
    mass = np.where(movable, trajectory.disks.mass, 0.0)
    speeds2 = (np.sum(trajectory[i].peculiar_velocity ** 2, axis=1) for i in used)
    return np.array([0.5 * np.sum(mass * each) for each in speeds2]) / max(np.count_nonzero(movable), 1)


def _keeps(T: Array) -> bool:
    """True if temperatures of the later half differ by less than a tenth from those of the earlier, in the mean."""
    if len(T) < 2:
        return True
    early, late = (float(np.mean(part)) for part in np.array_split(T, 2))
    return abs(late - early) <= 0.1 * max(early, late)


def _unsteady(trajectory: Trajectory, T: Array) -> str:
    first, last = (trajectory.with_unit(f"{one:.4g}", "energy") for one in (T[0], T[-1]))
    return f"{NOT_STEADY}: T goes from {first} to {last} in that time"


def _parts(trajectory: Trajectory, used: Sequence[int], name: str) -> Iterator[Array]:
    """A field of some disks over all frames, a part at a time: memory holds few millions of numbers."""
    size = max(1, 2_000_000 // len(used))
    for first in range(0, trajectory.n, size):
        disks = slice(first, min(first + size, trajectory.n))
        found = [trajectory.read(name, (index, disks)) for index in used]
        yield np.stack(found).astype(np.float64)


def of_msd(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "position")
    words = ", and D with it, as sqrt(T): no single D. Choose --frames over which T changes by "
    used, origins, notes, doubts = _motion(trajectory, chosen, words)
    box, when = trajectory.box, trajectory.times[used]
    has_image = "image" in trajectory.fields
    if not has_image and not box.is_open:
        notes.append('no "image" in the file: each step is taken for the shortest through the sides')

    def paths() -> Iterator[Array]:
        images = _parts(trajectory, used, "image") if has_image else itertools.repeat(None)
        for position, image in zip(_parts(trajectory, used, "position"), images, strict=False):
            path = displacement.unwrap(position, box, image=image, times=when)
            yield path[:, :, 1:] if box.shear_rate else path

    if box.shear_rate:
        notes.append("across the flow only")
    found = displacement.mean_square_displacement(when, paths(), origins=origins)  # type: ignore[arg-type]
    fit = displacement.diffusion_coefficient(found)
    D = (math.nan, math.nan) if doubts else (fit.D, fit.error)
    rows = [Reading("D", *D, unit(trajectory, "length^2/time")), Reading("exponent", fit.exponent)]
    if not doubts:
        notes.append(f"line fitted at lags from {fit.lags[0]:.4g} to {fit.lags[1]:.4g}")
        if abs(fit.exponent - 1.0) > 0.2:
            notes.append("the exponent is not 1: this D is no diffusion coefficient")
    table = {"lag": found.lag, "msd": found.value, "error": found.error}
    return Evaluation((found, fit), rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def of_vacf(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "velocity")
    if trajectory.box.shear_rate:
        text = "velocities in the lab of a sheared gas say little"
        raise InputError(f"{text}: the displacement across the flow is `msd`")
    words = (
        ": velocities shrink or grow with sqrt(T), so that they do not decay by loss of memory alone. Choose --frames "
        "over which T changes by "
    )
    used, origins, notes, doubts = _motion(trajectory, chosen, words)
    parts = _parts(trajectory, used, "velocity")
    found = displacement.velocity_autocorrelation(trajectory.times[used], parts, origins=origins)  # type: ignore[arg-type]
    scale = found.value[0] if found.value[0] > 0.0 else np.nan
    below = np.flatnonzero(found.value < scale / math.e)
    square = unit(trajectory, "length^2/time^2")
    rows = [Reading("<v^2>", float(found.value[0]), float(found.error[0]), square)]
    if len(below):
        rows.append(Reading("first lag below 1/e", float(found.lag[below[0]]), unit=unit(trajectory, "time")))
    table = {"lag": found.lag, "vacf": found.value, "error": found.error}
    return Evaluation(found, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def _span_mean(when: Array, values: Array, span: tuple[float, float]) -> float:
    """Mean of a series over a span of time, linear between its points."""
    inner = (when > span[0]) & (when < span[1])
    t = np.concatenate(([span[0]], when[inner], [span[1]]))
    return float(np.trapezoid(np.interp(t, when, values), t) / (span[1] - span[0]))


def of_pressure(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    box, disks = trajectory.box, trajectory.disks
    if box.is_open or trajectory.room.all_walls:
        text = "pressure of a homogeneous gas in a periodic box only"
        raise InputError(f"{text}: this one has walls or no sides")
    used = every(trajectory, chosen)
    span = times(trajectory, used)
    when, (T, count) = stored.series(trajectory, "temperature", "collisions")
    inside = (when >= span[0]) & (when <= span[1])
    when, T, count = when[inside], T[inside], count[inside]
    rows: list[Reading] = []
    notes: list[str] = []
    doubts: list[str] = []
    result = None
    if not _keeps(T):
        doubts.append(
            f"{_unsteady(trajectory, T)}, and the pressure with it: pressures are means over that time. Z is that "
            "mean over the mean of N T / A, which is Z at each moment as long as the gas stays homogeneous. For a "
            "pressure at one temperature choose --frames over which T changes by less than a tenth"
        )
    try:
        found = stored.collisions(trajectory)
    except InputError as error:
        notes.append(f"not from impulses: {error}")
    else:
        span = (max(span[0], found.span[0]), min(span[1], found.span[1]))
        if not span[1] > span[0]:
            raise InputError(f"{trajectory.path}: its histories know no time between the frames chosen")
        seen = (found.time >= span[0]) & (found.time <= span[1])
        sigma = disks.radius[found.id] + disks.radius[found.partner]
        columns = (found.time, found.normal, found.impulse, sigma)
        result = pressure.pressure_from_impulses(
            *(column[seen] for column in columns), span=span, area=box.area, disks=disks.n, tracked=len(found.tracked),
            temperature=np.array([_span_mean(when, T, part) for part in pressure.blocks(span)]),
        )  # fmt: skip
        force, of_Z = unit(trajectory, "energy/length^2"), result.error / (result.kinetic or math.nan)
        rows += [
            Reading("pressure", result.total, result.error, force),
            Reading("kinetic part", result.kinetic, unit=force),
            Reading("collisional part", result.collisional, result.error, force),
            Reading("Z = p A / (N T)", result.Z, of_Z),
        ]
        notes.append(f"impulses of {len(found.tracked)} tracked disks")
    rows += _pressure_by_rate(trajectory, when, T, count, notes)
    if not rows:
        raise InputError(f"{trajectory.path}: no pressure: " + "; ".join(notes))
    names, values = ([getattr(row, name) for row in rows] for name in ("name", "value"))
    tables = {"": {"quantity": np.array(names), "value": np.array(values)}}
    return Evaluation(result, rows, tables, notes, span, doubts)


def _pressure_by_rate(
    trajectory: Trajectory, when: Array, T: Array, count: Array, notes: list[str]
) -> list[Reading]:
    """chi and Z by the number of collisions, for equal disks of a law with a constant e_n."""
    disks = trajectory.disks
    if any(np.ptp(one) != 0 for one in (disks.mass, disks.radius, disks.material)) or len(when) < 2:
        notes.append("not by the rate of collisions: it takes equal disks and two times")
        return []
    collisions, phi = float(count[-1] - count[0]), trajectory.box.packing_fraction(disks.radius)
    # The rate goes like sqrt(T): of the mean of that, a gas that cools has the collisions that it has.
    mean = _span_mean(when, np.sqrt(T), (float(when[0]), float(when[-1]))) ** 2
    if collisions < 1 or mean <= 0.0:
        notes.append("not by the rate of collisions: there are none")
        return []
    rate = 2.0 * collisions / disks.n / float(when[-1] - when[0])
    mass, radius = float(disks.mass[0]), float(disks.radius[0])
    chi = pressure.contact_from_rate(rate, packing_fraction=phi, temperature=mean, mass=mass, radius=radius)
    rows = [Reading("g at contact, by the rate of collisions", chi, chi / np.sqrt(collisions))]
    if "laws" in trajectory.parameters:
        material = int(disks.material[0])
        law = trajectory.laws[material][material]
        assert law is not None  # its disks have collided
        Z = pressure.compressibility(phi, chi, float(law["e_n"]))
        rows.append(Reading("Z by it", Z, (Z - 1.0) / np.sqrt(collisions)))
    notes.append("the rate tells g at contact where velocities are Maxwellian and without correlations")
    return rows


def of_cooling(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    for name in ("energy_input", "wall_work", "wall_heat"):
        if name in trajectory.observables and np.any(trajectory.observables[name]):
            law = "Haff's law is that of a gas left to itself"
            raise InputError(f"{law}, and this one is driven ({name} is not 0)")
    when, (T, T_rot, count) = stored.series(trajectory, "temperature", "rotational_temperature", "collisions")
    used = np.ones(len(when), dtype=bool)
    if chosen is not None:
        begin, end = times(trajectory, list(chosen))
        used = (when >= begin) & (when <= end)
    when, T, T_rot, count = when[used], T[used], T_rot[used], count[used]
    n = trajectory.n
    haff = cooling.haff_fit(when, T, disks=n)
    energy, time = unit(trajectory, "energy"), unit(trajectory, "time")
    rows = [
        Reading("T0", haff.T0, haff.T0_error, energy),
        Reading("t_H", haff.t_H, haff.t_H_error, time),
        Reading("rms of what is left of ln T", haff.rms),
    ]
    notes = ["Haff: T = T0 / (1 + (t - t_first) / t_H)^2; errors with the autocorrelation of what is left"]
    doubts = [] if haff.describes else [_misfit("Haff's law", haff.misfit, n, "ln T", n**-0.5)]
    tau = 2.0 * count / n
    theta = np.divide(T_rot, T, out=np.full_like(T, np.nan), where=T > 0.0)
    ratio = None
    rising = np.concatenate(([True], np.diff(tau) > 0.0))
    try:
        ratio = cooling.ratio_fit(tau[rising], theta[rising], disks=n)
    except InputError as error:
        notes.append(f"no fit to theta: {error}")
    else:
        rows += [
            Reading("theta_0", ratio.theta_0, ratio.theta_0_error),
            Reading("theta_end", ratio.theta_end, ratio.theta_end_error),
            Reading("lag of theta, collisions per disk", ratio.lag, ratio.lag_error),
            Reading("rms of what is left of theta", ratio.rms),
        ]
        notes.append("theta = T_rot / T, exponential in collisions per disk")
        if not ratio.describes:
            scatter = float(np.mean(np.abs(theta[rising]))) * (3.0 / n) ** 0.5
            doubts.append(_misfit("one exponential", ratio.misfit, n, "theta", scatter))
        elif not ratio.lag_error < ratio.lag:
            doubts.append("the run is too short to tell where theta ends, and its lag: theta has hardly bent")
    table = {
        "time": when, "collisions_per_disk": tau, "temperature": T, "rotational_temperature": T_rot, "theta": theta,
    }  # fmt: skip
    return Evaluation((haff, ratio), rows, {"": table}, notes, (float(when[0]), float(when[-1])), doubts)


def _misfit(law: str, misfit: float, n: int, quantity: str, scatter: float) -> str:
    """That a law does not hold, by how much, and what its parameters then are."""
    beside = f"of {misfit:.2g} rms, where {n} disks scatter by about {scatter:.2g}"
    return (
        f"{law} does not describe this run: {quantity} leaves it in slow waves {beside}. The numbers are those of the "
        "nearest curve, without errors; --frames chooses a stretch where it may hold"
    )


def of_impact(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    found = stored.collisions(trajectory)
    seen = found.once
    span = found.span
    if chosen is not None:
        span = times(trajectory, list(chosen))
        seen &= (found.time >= span[0]) & (found.time <= span[1])
    result = impact.impacts(found.psi[seen], found.regime[seen])
    counts = None if np.any(found.regime[seen] < 0) else _counted_regimes(trajectory, span)
    of_whom = f"of {len(found.tracked)} tracked disks"
    if counts is not None:
        result = replace(result, regimes=impact.regime_shares(counts), regime_collisions=sum(counts.values()))
    rows = [
        Reading("collisions", result.collisions),
        Reading("mean of b = sin psi", result.mean_b, result.mean_b_error),
        Reading("p-value of a uniform b (Kolmogorov-Smirnov)", result.p_value),
        *(Reading(f"share of {name}", *share) for name, share in result.regimes.items()),
    ]
    table = {"psi": result.psi, "density": result.density, "error": result.density_error}
    notes = [f"{of_whom}; in molecular chaos b is uniform and psi has the density cos psi"]
    if counts is not None:
        all_of = f"of all {result.regime_collisions} collisions of two disks"
        notes.append(f"regimes by the time series: {all_of}, within rows of it")
    return Evaluation(result, rows, {"": table}, notes, span)


def _counted_regimes(trajectory: Trajectory, span: tuple[float, float]) -> dict[str, int] | None:
    """Collisions of the whole gas by regime within a span of time; None if the file does not tell."""
    name, time = "collisions_by_regime", trajectory.series.time
    inside = np.flatnonzero((time >= span[0]) & (time <= span[1]))
    if name not in trajectory.series or len(inside) < 2:
        return None
    columns = trajectory.series.columns(name)
    count = trajectory.series[name]
    between = count[inside[-1]] - count[inside[0]]
    if set(columns) - set(impact.COUNTED) or not np.any(between):
        return None
    return {impact.COUNTED[column]: int(each) for column, each in zip(columns, between, strict=True)}
