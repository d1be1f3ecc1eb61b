"""Analyses of trajectory files by name: of single frames first, then of changes between frames."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, TheoryError
from ..quantities import COMPONENTS, STRESS_SERIES
from ..theory.choose import is_closed
from ..theory.sonine import cooling_sonine
from ..tools.checked import Array
from ..tools.intervals import PERCENT, of_count
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory
from . import (
    averages,
    common,
    cooling,
    cycle,
    fields,
    histograms,
    impact,
    motion,
    pressure,
    species,
    steadiness,
    structure,
    tails,
    transport,
    velocities,
    vortices,
)
from . import result as stored
from . import stress as stresses
from .gas_theory import FLOW, gas_of, name_of_theory
from .result import Columns, Evaluation, Reading, all_frames, kinds, second_half, times, unit
from .steadiness import is_stationary, stationarity_warning
from .window import steady_frames

GAP = 0.1
"""Of the mean diameter: the gap below which disks are of one cluster."""
NEAR = 1.25
"""Mean diameters below which others are near a disk: by their number g near contact is held for steady or not."""
BINS = 81
"""Of distributions of velocities and spins."""
MOST_SPECIES = 4
"""Most species for which g(r) is given for each pair."""
SONINE = ("a20", "a02", "a11", "a30", "a03", "a21", "a12")
Indices = NDArray[np.intp]


def of_velocity(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_velocities(trajectory, "angular_velocity")
    used, disks = second_half(trajectory, frames), trajectory.disks
    results: dict[str, velocities.VelocityDistribution] = {}
    rows: list[Reading] = []
    table: Columns = {}
    changes: list[steadiness.Change] = []
    left_out: list[str] = []
    by_frame: Columns = {"time": trajectory.times[used]}
    if "collisions" in trajectory.observables:
        by_frame["collisions_per_disk"] = trajectory.observables["collisions_per_disk"][used]

    def distribution(which: Indices, frames: Sequence[int], bins: int) -> velocities.VelocityDistribution:
        chosen: Any = slice(None) if len(which) == disks.n else which  # without a copy of all

        def read(name: str) -> Iterator[NDArray[np.float64]]:
            for i in frames:  # one by one
                yield getattr(trajectory[i], name)[chosen]

        mass, inertia = disks.mass[chosen], disks.inertia[chosen]
        v, omega = read("peculiar_velocity"), read("spin")
        return velocities.velocity_distribution(v, omega, mass=mass, inertia=inertia, bins=bins)

    def coefficient(found: velocities.VelocityDistribution, label: str) -> common.MeanValue:
        values = getattr(found.sonine, label), getattr(found.sonine, f"{label}_error")
        return common.MeanValue(*values, found.sonine.disks)

    for name, which in kinds(trajectory).items():
        of, mark = ("", "") if len(which) == disks.n else (f" of {name}", f" [{name}]")
        try:
            found = results[name] = distribution(which, used, BINS)
        except InputError as error:  # of a kind with a single disk, say: the others have theirs
            left_out.append(f"no distribution{of}: {error}" if of else str(error))
            continue
        rows += [
            Reading.of(f"{label}{of}", coefficient(found, label), key=f"{label}{mark}") for label in SONINE
        ]
        rows += [
            Reading(
                f"disks with |c| > {c:g} relative to a Gaussian{of}",
                part.value,
                part.error,
                "",
                f"tail_{c:g}{mark}",
                ends=part.ends,
            )
            for c, part in found.tail.items()
        ]
        by_frame |= _sonine_over_frames([distribution(which, [i], 1) for i in used], mark)
        if len(used) > 1:
            early, late = (distribution(which, half, 1) for half in steadiness.halves(used))
            for label in SONINE:
                then, now = coefficient(early, label), coefficient(late, label)
                changes.append(steadiness.between(f"{label}{of}", then, now))
        columns = {"c": "speed", "P(c)": "density", "P(w)": "spin_density"}
        columns |= {f"{name} error": f"{columns[name]}_error" for name in ("P(c)", "P(w)")}
        order = ("c", "P(c)", "P(c) error", "P(w)", "P(w) error")
        table |= {f"{name}{mark}": getattr(found, columns[name]) for name in order}
    if not results:
        raise InputError("; ".join(left_out))
    if (
        motion.own_time(trajectory, used) is not None
        and (e_n := motion.smooth_restitution(trajectory)) is not None
    ):
        theory = cooling_sonine(e_n)
        rows.append(Reading("a20 by kinetic theory (homogeneous cooling)", theory, key="a20_theory"))
    notes = [f"of {name}" for name in results if "together" in name] + left_out
    notes += ["c = v_x or v_y over sqrt(2 T / m), w = omega over sqrt(2 T_rot / I); 0 for Gaussians"]
    notes += stored.drift(trajectory, all_frames(trajectory, None)).notes(
        trajectory, "c and T are relative to its mean velocity"
    )
    warnings = steadiness.warnings(changes)
    tables = {"": table, "frames": by_frame}
    return Evaluation(results, rows, tables, notes, times(trajectory, used), warnings, len(used))


def _sonine_over_frames(found: Sequence[velocities.VelocityDistribution], mark: str) -> Columns:
    """Coefficients of single frames, and their errors."""
    names = [f"{label}{end}" for label in SONINE for end in ("", "_error")]
    return {f"{name}{mark}": np.array([getattr(one.sonine, name) for one in found]) for name in names}


def _positions(trajectory: Trajectory, used: Sequence[int]) -> Iterator[Array]:
    return (trajectory[i].position for i in used)


def of_pairs(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "position")
    used = second_half(trajectory, frames)
    box, radius, when = trajectory.box, trajectory.disks.radius, trajectory.times[used]
    diameter = 2.0 * float(radius.mean())
    reach = min(6.0 * diameter, 0.45 * min(box.lengths))
    walled = bool(trajectory.free_area.all_walls)
    notes = ["walls: no contact value, and g is relative to the mean density of the whole box"] * walled
    results: dict[str, structure.PairCorrelation] = {}
    rows: list[Reading] = []
    table: Columns = {}
    poor: list[str] = []
    groups = kinds(trajectory)
    pairs: list[tuple[str, Indices | slice, Indices | slice | None]] = [("all disks", slice(None), None)]
    if 1 < len(groups) <= MOST_SPECIES:
        names = [*groups]
        pairs += [
            (f"{a}, {b}", groups[a], None if a == b else groups[b])
            for i, a in enumerate(names)
            for b in names[i:]
        ]
    for name, first, second in pairs:
        of, mark = ("", "") if name == "all disks" else (f" of {name}", f" [{name}]")

        def positions(ids: Indices | slice) -> Iterator[Array]:
            return (position[ids] for position in _positions(trajectory, used))

        def given(second: Indices | slice | None = second) -> dict[str, Any]:
            return {} if second is None else {"others": positions(second)}

        try:
            found = structure.pair_correlation(
                positions(first), box, r_max=reach, bins=240, time=when, **given()
            )
        except InputError as error:
            if not of:
                raise
            notes.append(f"no g(r){of}: {error}")
            continue
        of_second = radius[first if second is None else second].min()
        core = (found.r + 0.5 * (found.r[1] - found.r[0]) <= radius[first].min() + of_second) & (
            found.pairs == 0.0
        )
        found = replace(
            found, g_error=np.where(core, 0.0, found.g_error)
        )  # disks cannot overlap: g is 0 exactly
        results[name] = found
        if not walled:
            sizes = {} if second is None else {"radius_of_others": radius[second]}
            try:
                contact = structure.contact_value(
                    positions(first), box, radius=radius[first], time=when, **given(), **sizes
                )
            except InputError as error:
                notes.append(f"no contact value{of}: {error}")
            else:
                quality = f"chi^2 = {contact.chi_square:.1f} for {contact.degrees} degrees of freedom"
                notes.append(f"parabola fitted to ln g{of} up to 1.25 diameters: {quality}")
                known = contact.error if contact.describes else math.nan
                ends = contact.ends if contact.describes else (math.nan, math.nan)
                rows.append(Reading(f"g at contact{of}", contact.g, known, key=f"g_contact{mark}", ends=ends))
                poor += [f"g at contact{of}: {quality}"] * (not contact.describes)
        highest = float(found.r[np.argmax(found.g)])
        rows.append(
            Reading(
                f"r of the highest g{of}", highest, unit=unit(trajectory, "length"), key=f"r_highest{mark}"
            )
        )
        table |= {"r": found.r, f"g{mark}": found.g, f"error{mark}": found.g_error}
        table |= dict(zip((f"low{mark}", f"high{mark}"), found.ends, strict=True))
    warnings = stored.part_warnings(trajectory) + _neighbours_change(
        trajectory, used, min(NEAR * diameter, reach)
    )
    if poor:
        warnings.append(
            f"{'; '.join(poor)}: a parabola does not describe ln g near contact. The value is that of the best fit "
            "(poor), without an error; `pressure` gives another from the collision rate"
        )
    return Evaluation(results, rows, {"": table}, notes, times(trajectory, used), warnings, len(used))


def _neighbours_change(trajectory: Trajectory, used: Sequence[int], reach: float) -> list[str]:
    """Warning if g near contact changes over the frames, by the number of neighbours in each cell."""
    if len(used) < 2:
        return []
    count, where = [], []
    for i in used:
        frame = trajectory[i]
        ends = common.neighbours(frame.position, trajectory.box, reach, frame.time, "g(r)")[:2]
        both = np.concatenate(ends)
        count.append(np.bincount(both, minlength=len(frame.position)).astype(float))
        where.append(frame.position)
    what = f"the mean number of neighbours within {NEAR:g} mean diameters (centre to centre)"
    return steadiness.warnings([steadiness.between_cells(what, count, where, trajectory.box)])


def of_structure(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "position")
    used = second_half(trajectory, frames)
    k_max, when = 10.0 / float(trajectory.disks.radius.mean()), trajectory.times[used]
    found = structure.structure_factor(_positions(trajectory, used), trajectory.box, k_max=k_max, time=when)
    high = int(np.argmax(found.S))
    wave, of_rings = unit(trajectory, "1/length"), (found.S, found.S_error, found.ends)
    rows = [
        Reading.at(0, "S at the smallest k", "S_smallest_k", *of_rings),
        Reading("smallest k", float(found.k[0]), unit=wave, key="smallest_k"),
        Reading.at(high, "highest S", "S_max", *of_rings),
        Reading("k of the highest S", float(found.k[high]), unit=wave, key="k_of_S_max"),
    ]
    table = {
        "k": found.k, "S": found.S, "error": found.S_error, "low": found.ends[0], "high": found.ends[1],
        "modes": found.modes,
    }  # fmt: skip
    notes = ["errors from the scatter over modes, each averaged over the frames"]
    if trajectory.box.shear_rate:
        notes = ["errors treat frames as independent"]
    warnings = stored.part_warnings(trajectory) + _modes_change(trajectory, used)
    return Evaluation(found, rows, {"": table}, notes, times(trajectory, used), warnings, len(used))


def _modes_change(trajectory: Trajectory, used: Sequence[int]) -> list[str]:
    """Warning if S(k) changes over the frames, by the intensities of the longest waves, mode by mode."""
    if len(used) < 2:
        return []
    box, most = trajectory.box, steadiness.MODES
    # All of the longest waves lie within: along one axis only there are so many if the box is that narrow. The shear
    # turns all waves but those across the flow.
    reach = (0, most) if box.shear_rate else (most, most)
    where = ((trajectory[i].position, trajectory.times[i]) for i in used)
    modes = [structure.mode_intensities(position, box, reach, time=time) for position, time in where]
    size = np.hypot(modes[0][0][..., 0], modes[0][0][..., 1]).ravel()
    middle = len(size) // 2  # k = 0; of k and -k one
    longest = middle + 1 + np.argsort(size[middle + 1 :], kind="stable")[:most]
    what = f"the mean of S over the {len(longest)} longest waves"
    return steadiness.warnings([steadiness.between_modes(what, [S.ravel()[longest] for _, S in modes])])


def of_profiles(
    trajectory: Trajectory, frames: Sequence[int] | None, *, axis: str | None = None, bins: int | None = None,
    windows: int | None = None, phases: int | None = None,
) -> Evaluation:  # fmt: skip
    if windows is not None or phases is not None:
        return _of_groups(trajectory, frames, axis, bins, windows, phases)
    found = averages.profiles(trajectory, axis, bins, frames=frames)
    return _of_bins(trajectory, found, [*_strips(trajectory, found), *_extremes(trajectory, found)])


def _strips(trajectory: Trajectory, found: averages.BinAverages) -> list[Reading]:
    (edges,) = found.edges
    width = float(edges[1] - edges[0])
    return [
        Reading(f"bins along {found.axes[0]}", len(edges) - 1, key="bins"),
        Reading("width of a bin", width, unit=unit(trajectory, "length"), key="bin_width"),
    ]


def _of_groups(
    trajectory: Trajectory, frames: Sequence[int] | None, axis: str | None, bins: int | None, windows: int | None,
    phases: int | None,
) -> Evaluation:  # fmt: skip
    """Profiles in windows of time, or at phases of the moving walls, in the same bins."""
    if windows is not None and phases is not None:
        raise InputError("windows: cannot be combined with phases; choose one")
    if windows is not None:  # of all frames: what changes is what they are for
        used = all_frames(trajectory, frames)
        places, groups = cycle.frames_in_windows(trajectory, used, windows)
    else:
        used = all_frames(trajectory, steady_frames(trajectory, frames))
        places, groups = cycle.frames_at_phases(trajectory, used, phases or 1)
    over = "time" if windows is not None else "phase"
    found = averages.profiles_of_groups(trajectory, places, groups, over, axis, bins)
    rows = [
        *_strips(trajectory, found.profiles[0]),
        Reading(f"profiles over {over}", len(places), key="profiles"),
        Reading("frames in a profile, fewest", min(map(len, groups)), key="fewest_frames"),
    ]
    each = [one.columns() for one in found.profiles]
    count = len(next(iter(each[0].values())))
    kept = [name for name in each[0] if all(name in one for one in each)]
    table: Columns = {over: np.repeat(places, count)}
    table |= {name: np.concatenate([one[name] for one in each]) for name in kept}
    notes = ["P_ab: flux of momentum along a through a line with its normal along b, positive in compression"]
    if over == "phase":
        notes.append("each profile is a mean over frames of many periods at this phase")
    warnings = stored.part_warnings(trajectory)
    return Evaluation(found, rows, {"": table}, notes, times(trajectory, used), warnings, len(used))


def _extremes(trajectory: Trajectory, found: averages.BinAverages) -> Iterator[Reading]:
    """Lowest and highest value over the bins of some quantities; nearly empty ones only of density and stress."""
    last = found.directions[1] if found.axes[-1] == "y" else found.directions[0]
    normal = 1 if found.axes[-1] == "y" else 0
    chosen: dict[str, tuple[str, tuple[int, ...]]] = {
        "packing fraction": ("packing_fraction", ()), "temperature": ("temperature", ()), "theta": ("theta", ()),
        f"u_{found.directions[1 - normal]}": ("velocity", (1 - normal,)),
        f"P_{last}{last}{'' if found.has_collisions else ', kinetic part'}": ("stress", (normal, normal)),
    }  # fmt: skip
    for text, (name, at) in chosen.items():
        key = "stress_kinetic" if name == "stress" and not found.has_collisions else name
        value, error, n_eff = (
            getattr(one, key)[(..., *at)].ravel() for one in (found.mean, found.error, found.n_eff)
        )
        if name in averages.OF_DISKS and (filled := found.disks.ravel() >= found.frames).any():
            value = np.where(filled, value, np.nan)
        if not np.isfinite(value).any():
            continue
        short = text.replace(", kinetic part", "_kinetic").replace(" ", "_")
        ends = ("lowest", "min", np.nanargmin(value)), ("highest", "max", np.nanargmax(value))
        for which, end, place in ends:
            of_unit = unit(trajectory, averages.UNITS.get(key, ""))
            at_place = common.MeanValue(*(float(one[place]) for one in (value, error, n_eff)))
            yield Reading.of(f"{which} {text}", at_place, of_unit, key=f"{short}_{end}")


def _of_bins(trajectory: Trajectory, found: averages.BinAverages, rows: list[Reading]) -> Evaluation:
    """Evaluation of averages in bins: notes on their errors and on the collisional part."""
    notes = ["P_ab: flux of momentum along a through a line with its normal along b, positive in compression"]
    if (found.disks < found.frames).any():
        notes.append(
            "lowest and highest temperature, theta and u: of bins with at least one disk a frame on average"
        )
    if found.frames > 1:
        notes.append(f"errors from {min(common.BLOCKS, found.frames)} blocks of frames")
    notes += stored.few_rows(found.frames, "frames")
    tracked, movable = len(trajectory.tracked), trajectory.disks.n_movable
    if found.has_collisions:
        scaled = f", scaled to all {movable}: valid if they are a random sample" if tracked < movable else ""
        notes.append(f"collisional parts of P and q from histories of {tracked} disks{scaled}")
    elif trajectory.box.shear_rate:
        text = "a sheared box has no histories; `analyse stress` gives both parts for the whole gas"
        notes.append(f"P and q: kinetic part only: {text}")
    elif tracked:
        notes.append("P and q: kinetic part only: fewer than two of these frames are within the histories")
    else:
        text = "for the collisional part set output.histories_all = true and run the case again"
        notes.append(f"P and q: kinetic part only: {text}")
    notes += stored.drift(trajectory, all_frames(trajectory, None)).notes(trajectory, "the flow contains it")
    warnings = stored.part_warnings(trajectory)
    inside = [i for i in range(len(trajectory)) if found.times[0] <= trajectory.times[i] <= found.times[1]]
    T = motion.temperatures(trajectory, inside) if "temperature" in trajectory.observables else None
    if T is not None and not is_stationary(T):
        text = "averages are means over that time; choose frames over which T changes by less than a tenth"
        warnings.append(f"{stationarity_warning(trajectory, T)}, and {text}")
    return Evaluation(found, rows, {"": found.columns()}, notes, found.times, warnings, found.frames)


def of_fields(
    trajectory: Trajectory, frames: Sequence[int] | None, *, cells: tuple[int, int] | None = None, average: bool = False
) -> Evaluation:  # fmt: skip
    stored.require_fields(trajectory, "position", "velocity")
    if average:
        means = averages.mean_fields(trajectory, cells, frames=frames)
        a, b = means.mean.number_density.shape
        return _of_bins(trajectory, means, [*_cells(a, b), *_extremes(trajectory, means)])
    used = second_half(trajectory, frames)[-1]
    disks, frame, box = trajectory.disks, trajectory[used], trajectory.box
    movable = stored.index_of_movable(disks)
    position = frame.position[movable]
    if not len(position):
        raise InputError(
            "mass: must be finite for at least one disk; fields are those of disks that can move"
        )
    lengths = np.ptp(position, axis=0) if box.is_open else np.array(box.lengths)
    a, b = cells or averages.default_cells(lengths, len(position))
    spin = frame.spin[movable] if "angular_velocity" in trajectory.fields else None
    found = fields.coarse_grain(
        position, frame.peculiar_velocity[movable], spin, box=box, cells=(a, b), mass=disks.mass[movable],
        radius=disks.radius[movable], inertia=disks.inertia[movable],
    )  # fmt: skip
    phi, T = found.packing_fraction, found.temperature[np.isfinite(found.temperature)]
    mean_T = float(T.mean()) if len(T) else float("nan")
    flow = float(np.sqrt(np.nanmean(np.sum(found.velocity**2, axis=-1))))
    rows = [
        *_cells(a, b),
        Reading("packing fraction of cells, mean", float(phi.mean()), key="packing_fraction_of_cells"),
        Reading(
            "packing fraction of cells, standard deviation",
            float(phi.std()),
            key="packing_fraction_deviation",
        ),
        Reading(
            "thermal temperature, mean over cells",
            mean_T,
            unit=unit(trajectory, "energy"),
            key="thermal_temperature",
        ),
        Reading("flow, root mean square", flow, unit=unit(trajectory, "length/time"), key="flow_rms"),
    ]
    x, y = np.meshgrid(found.x, found.y, indexing="ij")
    columns = {
        "x": x, "y": y, "number_density": found.number, "packing_fraction": phi, "u_x": found.velocity[..., 0],
        "u_y": found.velocity[..., 1], "temperature": found.temperature,
        "rotational_temperature": found.rotational_temperature,
    }  # fmt: skip
    table = {name: column.ravel() for name, column in columns.items()}
    notes = [f"frame {used}; temperatures relative to the mean velocity of the cell"]
    notes += stored.drift(trajectory, all_frames(trajectory, None)).notes(trajectory, "the flow contains it")
    if box.shear_rate:
        notes.append("velocities relative to the imposed flow")
    warnings = stored.part_warnings(trajectory)
    return Evaluation(found, rows, {"": table}, notes, times(trajectory, [used]), warnings, 1)


def _cells(a: int, b: int) -> list[Reading]:
    return [Reading("cells along x", a, key="cells_x"), Reading("cells along y", b, key="cells_y")]


@dataclass(frozen=True, eq=False, repr=False)
class ClusterSeries(Brief):
    """Clusters of some frames, and their times."""

    times: list[float] = field(default_factory=list)
    clusters: list[structure.Clusters] = field(default_factory=list)


def of_clusters(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "position")
    used, box, radius = second_half(trajectory, frames), trajectory.box, trajectory.disks.radius
    gap = GAP * 2.0 * float(radius.mean())
    found = ClusterSeries()
    for i in used:
        frame = trajectory[i]
        found.times.append(frame.time)
        found.clusters.append(
            structure.clusters(frame.position, box, radius=radius, gap=gap, time=frame.time)
        )
    last = found.clusters[-1]
    rows = [
        Reading("share of the largest cluster, last frame", last.largest, key="largest_share"),
        Reading(
            "disks in the largest cluster", int(last.sizes[0]) if len(last.sizes) else 0, key="largest_disks"
        ),
        Reading(
            "radius of gyration of the largest cluster",
            float(last.radius_of_gyration[0]),
            unit=unit(trajectory, "length"),
            key="largest_radius",
        ),
        Reading("mean size of the cluster of a disk", last.mean_size, key="size_of_disk"),
        Reading("clusters of 2 or more", int(np.count_nonzero(last.sizes > 1)), key="number"),
    ]
    size, count = np.unique(last.sizes, return_counts=True)
    columns = {
        name: np.array([getattr(one, name) for one in found.clusters]) for name in ("largest", "mean_size")
    }
    gyration = np.array([one.radius_of_gyration[0] for one in found.clusters])
    main = {"time": np.array(found.times), **columns, "radius_of_gyration": gyration}
    tables: dict[str, Columns] = {"": main, "sizes": {"size": size, "clusters": count}}
    words = trajectory.with_unit(f"{last.gap:.4g}", "length")
    notes = [f"disks whose surfaces are nearer than {words} ({GAP:g} mean diameters) are joined"]
    if last.spans[:1].any():
        notes.append("the largest spans the box: it has no radius of gyration")
    warnings = stored.part_warnings(trajectory)
    return Evaluation(found, rows, tables, notes, times(trajectory, used), warnings, len(used))


def of_psi6(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_fields(trajectory, "position")
    used = second_half(trajectory, frames)
    where, box, when = list(_positions(trajectory, used)), trajectory.box, trajectory.times[used]
    found = [structure.hexatic(x, box, time=float(t)) for x, t in zip(where, when, strict=True)]
    local, whole = ([getattr(one, name) for one in found] for name in ("local", "whole"))
    rows = [
        Reading.of("mean of |psi_6|", common.mean_with_error(local), key="mean_abs"),
        Reading.of("|mean of psi_6|", common.mean_with_error(whole), key="abs_mean"),
    ]
    table = {"time": when, "local": np.array(local), "whole": np.array(whole)}
    notes, warnings = ["of the six nearest neighbours"], stored.part_warnings(trajectory)
    notes += stored.few_rows(len(used), "frames")
    if len(used) > 1:
        notes.append("errors from the scatter over frames")
        values = [np.abs(one.psi6) for one in found]
        warnings += steadiness.warnings([steadiness.between_cells("the mean of |psi_6|", values, where, box)])
    return Evaluation(found[-1], rows, {"": table}, notes, times(trajectory, used), warnings, len(used))


def _drift_remarks(trajectory: Trajectory) -> tuple[list[str], list[str]]:
    """Notes and warnings on the temperature of a drifting gas: old files include the energy of the drift in it."""
    moving = stored.drift(trajectory, all_frames(trajectory, None))
    if moving and "temperature" in trajectory.observables:
        T, energy = (trajectory.observables[name][0] for name in ("temperature", "translational_energy"))
        inside = float(T) * np.count_nonzero(trajectory.disks.movable) - float(energy) + moving.energy
        if inside > 1e-6 * moving.energy:
            return [], moving.notes(trajectory, "the temperatures of this file include it")
    return moving.notes(trajectory, "temperatures are relative to its mean velocity"), []


def _span_mean(when: Array, values: Array, span: tuple[float, float]) -> float:
    """Mean of a series over a span of time, linear between its points."""
    inner = (when > span[0]) & (when < span[1])
    t = np.concatenate(([span[0]], when[inner], [span[1]]))
    return float(np.trapezoid(np.interp(t, when, values), t) / (span[1] - span[0]))


def of_pressure(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    box, disks = trajectory.box, trajectory.disks
    if box.is_open or trajectory.free_area.all_walls:
        text = "pressure of a homogeneous gas in a periodic box only: this one has walls or no sides"
        raise InputError(
            text if box.is_open else f"{text}; `analyse stress` gives the pressure tensor between walls"
        )
    used = all_frames(trajectory, steady_frames(trajectory, frames))
    span = times(trajectory, used)
    when, (T, count) = stored.series(trajectory, "temperature", "collisions")
    inside = (when >= span[0]) & (when <= span[1])
    when, T, count = when[inside], T[inside], count[inside]
    if len(T) and not np.any(T > 0.0):
        raise InputError(
            f"{trajectory.path}: T = 0: must be above 0 for a pressure; in these frames no disk moves"
        )
    rows: list[Reading] = []
    notes, warnings = _drift_remarks(trajectory)
    result = None
    if not is_stationary(T):
        warnings.append(
            f"{stationarity_warning(trajectory, T)}. Pressures are means over that time, and their errors do not "
            "include the change. Z is the mean pressure over the mean of N T / A: it holds at each time if the gas "
            "stays homogeneous. For a pressure at one temperature choose frames over which T changes by less than a "
            "tenth"
        )
    try:
        found = stored.collisions(trajectory)
    except InputError as error:
        stress = "" if "stress" in trajectory.series else ", or set output.stress = true for `analyse stress`"
        notes.append(f"not from impulses: {error}{stress}")
        if box.shear_rate:  # which has no histories
            notes[-1] = "not from impulses: `analyse stress` gives the pressure tensor of a sheared gas"
    else:
        span = (max(span[0], found.span[0]), min(span[1], found.span[1]))
        if not span[1] > span[0]:
            raise InputError(f"{trajectory.path}: its histories do not overlap the chosen frames")
        inside = (found.time >= span[0]) & (found.time <= span[1])
        sigma = disks.radius[found.id] + disks.radius[found.partner]
        columns = (found.time, found.normal, found.impulse, sigma)
        result = pressure.pressure_from_impulses(
            *(column[inside] for column in columns), span=span, area=box.area, disks=disks.n,
            tracked=len(found.tracked),
            temperature=np.array([_span_mean(when, T, part) for part in pressure.blocks(span)]),
        )  # fmt: skip
        force = unit(trajectory, "energy/length^2")
        rows += [
            Reading("pressure", result.total, result.error, force, "p", result.n_eff),
            Reading(
                "kinetic part", result.kinetic, result.kinetic_error, force, "kinetic", result.kinetic_n_eff
            ),
            Reading(
                "collisional part",
                result.collisional,
                result.collisional_error,
                force,
                "collisional",
                result.collisional_n_eff,
            ),
            Reading("Z = p A / (N T)", result.Z, result.Z_error, "", "Z", result.Z_n_eff),
        ]
        notes.append(f"impulses of {len(found.tracked)} tracked disks")
    rows += _pressure_by_rate(trajectory, when, T, count, notes)
    if not rows:
        raise InputError(f"{trajectory.path}: no pressure: " + "; ".join(notes))
    names, values = ([getattr(row, name) for row in rows] for name in ("name", "value"))
    tables = {"": {"quantity": np.array(names), "value": np.array(values)}}
    return Evaluation(result, rows, tables, notes, span, warnings)


def _pressure_by_rate(
    trajectory: Trajectory, when: Array, T: Array, count: Array, notes: list[str]
) -> list[Reading]:
    """Return chi and Z from the number of collisions, for equal disks with a constant e_n."""
    disks = trajectory.disks
    if any(np.ptp(one) != 0 for one in (disks.mass, disks.radius, disks.material)) or len(when) < 2:
        notes.append("not from the collision rate: this requires equal disks and two times")
        return []
    collisions, phi = float(count[-1] - count[0]), trajectory.box.packing_fraction(disks.radius)
    # The rate goes like sqrt(T): of the mean of that, a gas that cools has the collisions that it has.
    mean = _span_mean(when, np.sqrt(T), (float(when[0]), float(when[-1]))) ** 2
    if collisions < 1 or mean <= 0.0:
        notes.append("not from the collision rate: there are no collisions")
        return []
    rate = 2.0 * collisions / disks.n / float(when[-1] - when[0])
    mass, radius = float(disks.mass[0]), float(disks.radius[0])
    chi = pressure.contact_from_rate(rate, packing_fraction=phi, temperature=mean, mass=mass, radius=radius)
    fewest, most = (float(end) / collisions for end in of_count(collisions))
    rows = [
        Reading(
            "g at contact, from the collision rate", chi, chi / math.sqrt(collisions), key="g_contact_from_rate",
            ends=(chi * fewest, chi * most),
        )
    ]  # fmt: skip
    if "laws" in trajectory.parameters and not trajectory.has_custom_laws:
        material = int(disks.material[0])
        law = trajectory.laws[material][material]
        if law is not None and law.has_averages and not law.depends_on_speed:
            Z = pressure.compressibility(phi, chi, law.e_n)
            rows.append(
                Reading(
                    "Z, from the collision rate", Z, (Z - 1.0) / math.sqrt(collisions), key="Z_from_rate",
                    ends=(1.0 + (Z - 1.0) * fewest, 1.0 + (Z - 1.0) * most),
                )
            )  # fmt: skip
    notes.append("g at contact from the rate assumes Maxwellian, uncorrelated velocities")
    return rows


def of_stress(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    series = trajectory.series
    if "stress" not in series:
        raise InputError(
            f"{trajectory.path} holds no stress: set output.stress = true in the case and run it again; from Python, "
            'Simulation(..., record=["stress"]), ledger = ifrdem.Ledger(area=box.area), and gas.run(..., series=100, '
            "series_callbacks=[lambda measure: file.write_series(measure.time, ledger.row(measure))])"
        )
    rising = np.concatenate(([True], np.diff(series.time) > 0.0))
    when, rows_of = series.time[rising], {name: series[name][rising] for name in STRESS_SERIES}
    if len(when) < 2:
        raise InputError(f"{trajectory.path}: must have two rows of the series or more for a stress")
    frames = steady_frames(trajectory, frames)
    used = all_frames(trajectory, frames)
    span = times(trajectory, used) if frames is not None else (float(when[0]), float(when[-1]))
    span = (max(span[0], float(when[0])), min(span[1], float(when[-1])))
    if not span[1] > span[0]:
        raise InputError(f"{trajectory.path}: a stress is a mean over time: must be two frames or more")
    found = stresses.mean_stress(when, *(rows_of[name][1:] for name in STRESS_SERIES), span=span)
    mean, force = found.stress, unit(trajectory, "energy/length^2")
    pressure = common.MeanValue(mean.pressure, found.pressure_error, found.pressure_n_eff)
    rows = [Reading.of("pressure p = (P_xx + P_yy) / 2", pressure, force, "p")]
    pairs = {name: divmod(i, 2) for i, name in enumerate(COMPONENTS)}

    def component(at: tuple[int, int], value: Array, error: Array, n_eff: Array) -> common.MeanValue:
        return common.MeanValue(float(value[at]), float(error[at]), float(n_eff[at]))

    total = {name: component(at, mean.total, found.error, found.n_eff) for name, at in pairs.items()}
    rows += [Reading.of(f"P_{name}", each, force) for name, each in total.items()]
    for name, at in pairs.items():
        part = component(at, mean.kinetic, found.kinetic_error, found.kinetic_n_eff)
        rows.append(Reading.of(f"kinetic part of P_{name}", part, force, f"P_{name}_kinetic"))

    def ratio(name: str, key: str, of: str) -> Reading:
        """A ratio of components, by the name of its property."""
        error, n_eff = (getattr(found, f"{of}_{each}") for each in ("error", "n_eff"))
        return Reading.of(name, common.MeanValue(getattr(mean, of), error, n_eff), key=key)

    rows.append(ratio("N_1 = (P_xx - P_yy) / p", "N_1", "normal_difference"))
    of_theory: list[str] = []
    if rate := trajectory.box.shear_rate:
        rows.append(ratio("friction -P_xy / P_yy", "friction", "friction"))
        rows.append(ratio("T_x / T_y", "T_x_over_T_y", "temperature_ratio"))
        of_viscosity = unit(trajectory, "energy time/length^2")
        viscosity = total["xy"].times(-1.0 / rate)
        rows.append(Reading.of("viscosity -P_xy / shear rate", viscosity, of_viscosity, "viscosity"))
        of_theory = _flow_by_theory(trajectory, rate, span, rows, of_viscosity)
    notes = ["P_ab: flux of momentum along a through a line with its normal along b, positive in compression"]
    notes += [*stored.few_rows(found.rows, "rows of the series"), *of_theory]
    warnings = []
    inside = (series.time >= span[0]) & (series.time <= span[1])
    if "temperature" in series and not is_stationary(T := series["temperature"][inside]):
        text = (
            "and stresses are means over that time; choose frames over which T changes by less than a tenth"
        )
        warnings.append(f"{stationarity_warning(trajectory, T)}, {text}")
    table: Columns = {"time": found.time}
    table |= {f"P_{name}(t)": found.blocks[:, at[0], at[1]] for name, at in pairs.items()}
    return Evaluation(found, rows, {"": table}, notes, span, warnings)


def _flow_by_theory(
    trajectory: Trajectory, rate: float, span: tuple[float, float], rows: list[Reading], of_viscosity: str
) -> list[str]:
    """Add the ratios of stresses of a flow by the theory in use to rows; return a note on it, or why there is none."""
    gas = gas_of(trajectory)
    if isinstance(gas, str):
        return [gas]
    try:
        first = float(trajectory.times[0])
        of_theory = gas.of_flow(rate, (span[0] - first, span[1] - first))
    except (InputError, TheoryError) as error:
        return [str(error)]
    for key, value in of_theory.items():
        of = of_viscosity if key == "viscosity" else ""
        rows.append(Reading.of(f"{FLOW[key]} by {name_of_theory()}", value, of, f"{key}_theory"))
    if not is_closed():
        return ["DSMC: of a homogeneous flow from the temperatures of the first frame, over the same times"]
    return ["kinetic theory: steady state of a homogeneous flow (`theory.steady_flow`)"]


def of_cooling(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    for name in ("energy_input", "wall_work", "wall_heat"):
        if name in trajectory.observables and np.any(trajectory.observables[name]):
            raise InputError(f"{name} is not 0: the gas is driven; Haff's law is for a gas without driving")
    when, (T, T_rot, count) = stored.series(trajectory, "temperature", "rotational_temperature", "collisions")
    used = np.ones(len(when), dtype=bool)
    if frames is not None:
        begin, end = times(trajectory, frames)
        used = (when >= begin) & (when <= end)
    when, T, T_rot, count = when[used], T[used], T_rot[used], count[used]
    n = trajectory.n
    if len(when) < cooling.FEWEST_HAFF:
        where = f" from t = {begin:g} to {end:g}" if frames is not None else ""
        raise InputError(
            f"{trajectory.path}: {len(when)} row{'s' * (len(when) != 1)} of T{where}: must be {cooling.FEWEST_HAFF} "
            "or more for Haff's law; choose a longer time"
        )
    haff = cooling.haff_fit(when, T, disks=n)
    energy, time = unit(trajectory, "energy"), unit(trajectory, "time")
    rows = [
        Reading("T0", haff.T0, haff.T0_error, energy, n_eff=haff.n_eff),
        Reading("t_H", haff.t_H, haff.t_H_error, time, n_eff=haff.n_eff),
        Reading("rms residual of ln T", haff.rms, key="rms_ln_T"),
    ]
    notes, warnings = _drift_remarks(trajectory)
    notes += [
        "Haff: T = T0 / (1 + (t - t_first) / t_H)^2; errors include the autocorrelation of the residuals"
    ]
    warnings += [] if haff.describes else [_misfit("Haff's law", haff.misfit, n, "ln T", n**-0.5)]
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
            Reading("theta_0", ratio.theta_0, ratio.theta_0_error, n_eff=ratio.n_eff),
            Reading("theta_end", ratio.theta_end, ratio.theta_end_error, n_eff=ratio.n_eff),
            Reading(
                "relaxation of theta, collisions per disk",
                ratio.lag,
                ratio.lag_error,
                "",
                "theta_relaxation",
                ratio.n_eff,
            ),
            Reading("rms residual of theta", ratio.rms, key="rms_theta"),
        ]
        notes.append("theta = T_rot / T, exponential in collisions per disk")
        if not ratio.describes:
            scatter = float(np.mean(np.abs(theta[rising]))) * (3.0 / n) ** 0.5
            warnings.append(_misfit("one exponential", ratio.misfit, n, "theta", scatter))
        elif not math.isfinite(ratio.theta_end):
            warnings.append(
                "theta_end and its relaxation are not determined: theta changes, and these data do not show where it "
                "ends. Run longer"
            )
        elif not math.isfinite(ratio.lag):
            notes.append("theta shows no relaxation in these data: theta_end is its mean")
    table = {
        "time": when, "collisions_per_disk": tau, "temperature": T, "rotational_temperature": T_rot, "theta": theta,
    }  # fmt: skip
    return Evaluation((haff, ratio), rows, {"": table}, notes, (float(when[0]), float(when[-1])), warnings)


def _misfit(law: str, misfit: float, n: int, quantity: str, scatter: float) -> str:
    """Warning that a law does not describe the data, by how much, and the meaning of its parameters then."""
    return (
        f"{law} does not describe this run: {quantity} deviates systematically from the fit: rms {misfit:.2g}, "
        f"expected noise {scatter:.2g} for {n} disks. The parameters are of the best fit (poor), without errors; "
        "choose frames where the law may hold"
    )


def of_impact(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    found, frames = stored.collisions(trajectory), steady_frames(trajectory, frames)
    inside = found.first_of_pair
    span = found.span
    if frames is not None:
        span = times(trajectory, frames)
        inside &= (found.time >= span[0]) & (found.time <= span[1])
    result = impact.impacts(found.psi[inside], found.regime[inside])
    counts = None if np.any(found.regime[inside] < 0) else _regime_counts(trajectory, span)
    of_tracked = f"of {len(found.tracked)} tracked disks"
    if counts is not None:
        result = replace(result, regimes=impact.regime_shares(counts), regime_collisions=sum(counts.values()))
    rows = [
        Reading("collisions", result.collisions),
        Reading("mean of b = sin psi", result.mean_b, result.mean_b_error, "", "mean_b", result.collisions),
        Reading("p-value of a uniform b (Kolmogorov-Smirnov)", result.p_value, key="p_value"),
        *(
            Reading(f"share of {name}", *share, key=f"share_{name}", ends=result.regime_ends(name))
            for name, share in result.regimes.items()
        ),
    ]
    low, high = result.density_ends
    table = {
        "psi": result.psi, "density": result.density, "error": result.density_error, "low": low, "high": high,
    }  # fmt: skip
    notes = [f"{of_tracked}; in molecular chaos b is uniform and psi has the density cos psi"]
    if counts is not None:
        all_of = f"of all {result.regime_collisions} collisions of two disks"
        notes.append(f"regimes from the time series: {all_of}")
    return Evaluation(result, rows, {"": table}, notes, span)


def _regime_counts(trajectory: Trajectory, span: tuple[float, float]) -> dict[str, int] | None:
    """Number of collisions of the whole gas by regime within a span of time; None if the file lacks it."""
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


FUNCTIONS: dict[str, Callable[..., Evaluation]] = {
    "velocity": of_velocity, "tail": tails.of_tail, "rdf": of_pairs, "structure-factor": of_structure, "msd": motion.of_msd,
    "vacf": motion.of_vacf, "profiles": of_profiles, "cycle": cycle.of_cycle, "fields": of_fields, "clusters": of_clusters, "psi6": of_psi6,
    "pressure": of_pressure, "stress": of_stress, "transport": transport.of_transport, "cooling": of_cooling,
    "velocity-correlation": vortices.of_correlation, "vorticity": vortices.of_spectrum, "species": species.of_species,
    "impact": of_impact, "histograms": histograms.of_histograms,
}  # fmt: skip
"""Functions of a file, frames (None: suitable ones) and options, by the names in `names.ANALYSES`."""


def report(name: str, title: str, evaluation: Evaluation, span: str) -> str:
    """The result of an analysis as a text table; `span` names its frames and times."""
    lines = [f"{name}: {title}, {span}", *(f"  ! {warning}" for warning in evaluation.warnings)]
    width = max((len(row.name) for row in evaluation.rows), default=0)
    lines += [f"  {row.name:<{width}}  {number(row)}" for row in evaluation.rows]
    lines += [f"  ({note})" for note in evaluation.notes]
    return "\n".join(lines)


def number(row: Reading) -> str:
    """A value with its error to two digits, its unit, and n_eff, or the 95 % interval where value +- error is none."""
    unit = f" {row.unit}" if row.unit else ""
    if isinstance(row.value, numbers.Integral):
        return f"{row.value}{unit}"
    if not math.isfinite(row.value):
        return "none"
    if math.isinf(row.error):
        return "not determined"
    if math.isnan(row.error) or row.error <= 0.0:
        return f"{row.value:.5g}{unit}"
    more = ""
    if row.ends is not None:
        more = f" ({PERCENT}: {row.ends[0]:.3g} to {row.ends[1]:.3g})"
    elif math.isfinite(row.n_eff):
        more = f" (n_eff {row.n_eff:.{1 if row.n_eff < 9.95 else 0}f})"
    digits = 1 - math.floor(math.log10(row.error))
    if digits <= 6 and abs(row.value) < 1e5:
        return f"{row.value:.{max(digits, 0)}f} +- {row.error:.{max(digits, 0)}f}{unit}{more}"
    places = max(1, math.floor(math.log10(max(abs(row.value), row.error) / row.error)) + 1)
    return f"{row.value:.{places}e} +- {row.error:.1e}{unit}{more}"


def json_number(value: float) -> float | None:
    """A number for JSON: an integer if it is whole, None if it is not finite."""
    if isinstance(value, numbers.Integral):
        return int(value)
    return float(value) if math.isfinite(value) else None
