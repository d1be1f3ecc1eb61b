"""Analyses of single frames of a file: velocities, g(r), S(k), fields, clusters, psi_6."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..tools.checked import Array
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory
from . import cluster, common, fields, pairs, psi6, steadiness, structure, velocities
from . import result as stored
from .result import Columns, Outcome, Row, kinds, latest, times, unit

GAP = 0.1
"""Of the mean diameter: the gap below which disks are of one cluster."""
NEAR = 1.25
"""Mean diameters below which others are near a disk: by their number g near contact is held for steady or not."""
BINS = 81
"""Of distributions of velocities and spins."""
SONINE = ("a20", "a02", "a11")


def of_velocity(trajectory: Trajectory, chosen: Sequence[int] | None) -> Outcome:
    stored.need(
        trajectory, "velocity", "angular_velocity", *(["position"] if trajectory.box.shear_rate else [])
    )
    used = latest(trajectory, chosen)
    disks = trajectory.disks
    results: dict[str, velocities.VelocityDistribution] = {}
    rows: list[Row] = []
    table: Columns = {}
    changes: list[steadiness.Change] = []

    def distribution(
        which: NDArray[np.intp], some: Sequence[int], bins: int
    ) -> velocities.VelocityDistribution:
        return velocities.velocity_distribution(
            (trajectory[i].peculiar_velocity[which] for i in some),
            (trajectory[i].spin[which] for i in some),
            mass=disks.mass[which],
            inertia=disks.inertia[which],
            bins=bins,
        )

    for name, which in kinds(trajectory).items():
        found = distribution(which, used, BINS)
        results[name] = found
        of = "" if len(which) == disks.n else f" of {name}"
        sonine = found.sonine
        rows += [
            Row(f"{label}{of}", getattr(sonine, label), getattr(sonine, f"{label}_error")) for label in SONINE
        ]
        if len(used) > 1:
            early, late = (distribution(which, half, 1).sonine for half in steadiness.halves(used))
            for label in SONINE:
                then, now = ((getattr(one, label), getattr(one, f"{label}_error")) for one in (early, late))
                changes.append(steadiness.between(f"{label}{of}", then, now, len(which) - 1))
        mark = "" if not of else f" [{name}]"
        table |= {
            f"c{mark}": found.speed,
            f"P(c){mark}": found.density,
            f"P(c) error{mark}": found.density_error,
            f"P(w){mark}": found.spin_density,
            f"P(w) error{mark}": found.spin_density_error,
        }
    notes = [f"of {name}" for name in results if "together" in name]
    notes += ["c = v_x or v_y over sqrt(2 T / m), w = omega over sqrt(2 T_rot / I); 0 for Gaussians"]
    doubts = steadiness.doubts(changes)
    return Outcome(results, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def _positions(trajectory: Trajectory, used: Sequence[int]) -> Iterator[Array]:
    return (trajectory[i].position for i in used)


def of_pairs(trajectory: Trajectory, chosen: Sequence[int] | None) -> Outcome:
    stored.need(trajectory, "position")
    used = latest(trajectory, chosen)
    box, disks = trajectory.box, trajectory.disks
    diameter = 2.0 * float(disks.radius.mean())
    when = trajectory.times[used]
    reach = min(6.0 * diameter, 0.45 * min(box.lengths))
    found = pairs.pair_correlation(_positions(trajectory, used), box, r_max=reach, bins=240, time=when)
    rows: list[Row] = []
    notes: list[str] = []
    if trajectory.room.all_walls:
        notes.append("walls: no contact value, and g is relative to the mean density of the whole box")
    else:
        try:
            contact = pairs.contact_value(_positions(trajectory, used), box, radius=disks.radius, time=when)
            rows.append(Row("g at contact", contact.g, contact.error))
            notes.append(
                "parabola fitted to ln g up to 1.25 diameters: "
                f"chi^2 = {contact.chi_square:.1f} for {contact.degrees} degrees of freedom"
            )
        except InputError as error:
            notes.append(f"no contact value: {error}")
    rows.append(
        Row("r of the highest g", float(found.r[np.argmax(found.g)]), unit=unit(trajectory, "length"))
    )
    table = {"r": found.r, "g": found.g, "error": found.g_error}
    doubts = _neighbours_change(trajectory, used, min(NEAR * diameter, reach))
    return Outcome(found, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def _neighbours_change(trajectory: Trajectory, used: Sequence[int], reach: float) -> list[str]:
    """Why g near contact is a mean over a change: how many others a disk has near it, cell by cell."""
    if len(used) < 2:
        return []
    count, where = [], []
    for i in used:
        frame = trajectory[i]
        first, second, _ = common.neighbours(frame.position, trajectory.box, reach, frame.time, "g(r)")
        both = np.concatenate((first, second))
        count.append(np.bincount(both, minlength=len(frame.position)).astype(float))
        where.append(frame.position)
    what = f"the number of others whose centres are nearer to a disk's than {NEAR:g} mean diameters"
    return steadiness.doubts([steadiness.between_cells(what, count, where, trajectory.box)])


def of_structure(trajectory: Trajectory, chosen: Sequence[int] | None) -> Outcome:
    stored.need(trajectory, "position")
    used = latest(trajectory, chosen)
    diameter = 2.0 * float(trajectory.disks.radius.mean())
    found = structure.structure_factor(
        _positions(trajectory, used), trajectory.box, k_max=20.0 / diameter, time=trajectory.times[used]
    )
    high = int(np.argmax(found.S))
    rows = [
        Row("S at the smallest k", float(found.S[0]), float(found.S_error[0])),
        Row("smallest k", float(found.k[0]), unit=unit(trajectory, "1/length")),
        Row("highest S", float(found.S[high]), float(found.S_error[high])),
        Row("its k", float(found.k[high]), unit=unit(trajectory, "1/length")),
    ]
    table = {"k": found.k, "S": found.S, "error": found.S_error, "modes": found.modes}
    notes = [
        "errors as if frames were independent: at small k they are not if they follow each other closely"
    ]
    doubts = _modes_change(trajectory, used)
    return Outcome(found, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def _modes_change(trajectory: Trajectory, used: Sequence[int]) -> list[str]:
    """Why S(k) is a mean over a change: the intensities of the longest waves, mode by mode."""
    if len(used) < 2:
        return []
    box, most = trajectory.box, steadiness.MODES
    # All of the longest waves lie within: along one axis only there are so many if the box is that narrow. The shear
    # turns all waves but those across the flow.
    reach = (0, most) if box.shear_rate else (most, most)
    k, _ = structure.mode_intensities(
        trajectory[used[0]].position, box, reach, time=trajectory.times[used[0]]
    )
    size = np.hypot(k[..., 0], k[..., 1]).ravel()
    middle = len(size) // 2  # k = 0; of k and -k one
    longest = middle + 1 + np.argsort(size[middle + 1 :], kind="stable")[:most]
    found = [
        structure.mode_intensities(trajectory[i].position, box, reach, time=trajectory.times[i])[1].ravel()[
            longest
        ]
        for i in used
    ]
    what = f"S in the mean over the {len(longest)} longest waves"
    return steadiness.doubts([steadiness.between_modes(what, found)])


def of_fields(trajectory: Trajectory, chosen: Sequence[int] | None) -> Outcome:
    stored.need(trajectory, "position", "velocity")
    used = latest(trajectory, chosen)[-1]
    disks, frame, box = trajectory.disks, trajectory[used], trajectory.box
    movable = np.isfinite(disks.mass)
    position = frame.position[movable]
    lengths = np.ptp(position, axis=0) if box.is_open else np.array(box.lengths)
    # Some 20 disks a cell, and 200 cells along a side at most.
    side = np.sqrt(float(np.prod(lengths)) * 20.0 / max(len(position), 1))
    count = np.clip(np.rint(lengths / side), 1, 200).astype(int)
    spin = frame.spin[movable] if "angular_velocity" in trajectory.fields else None
    found = fields.coarse_grain(
        position,
        frame.peculiar_velocity[movable],
        spin,
        box=box,
        cells=(int(count[0]), int(count[1])),
        mass=disks.mass[movable],
        radius=disks.radius[movable],
        inertia=disks.inertia[movable],
    )
    phi, T = found.packing_fraction, found.temperature[np.isfinite(found.temperature)]
    speed = np.linalg.norm(found.velocity, axis=-1)
    energy = unit(trajectory, "energy")
    rows = [
        Row("cells along x", int(count[0])),
        Row("cells along y", int(count[1])),
        Row("packing fraction, mean", float(phi.mean())),
        Row("packing fraction, standard deviation", float(phi.std())),
        Row("thermal temperature, mean over cells", float(T.mean()) if len(T) else float("nan"), unit=energy),
        Row(
            "flow, root mean square",
            float(np.sqrt(np.nanmean(speed**2))),
            unit=unit(trajectory, "length/time"),
        ),
    ]
    x, y = np.meshgrid(found.x, found.y, indexing="ij")
    table = {
        "x": x.ravel(),
        "y": y.ravel(),
        "number_density": found.number.ravel(),
        "packing_fraction": phi.ravel(),
        "u_x": found.velocity[..., 0].ravel(),
        "u_y": found.velocity[..., 1].ravel(),
        "temperature": found.temperature.ravel(),
        "rotational_temperature": found.rotational_temperature.ravel(),
    }
    notes = [f"frame {used}; temperatures relative to the mean velocity of the cell"]
    if box.shear_rate:
        notes.append("velocities relative to the flow that the box imposes")
    return Outcome(found, rows, {"": table}, notes, times(trajectory, [used]), frames=1)


@dataclass(frozen=True, eq=False, repr=False)
class ClusterSeries(Brief):
    """Clusters of some frames: their times, and what was found."""

    times: list[float] = field(default_factory=list)
    clusters: list[cluster.Clusters] = field(default_factory=list)


def of_clusters(trajectory: Trajectory, chosen: Sequence[int] | None) -> Outcome:
    stored.need(trajectory, "position")
    used = latest(trajectory, chosen)
    diameter = 2.0 * float(trajectory.disks.radius.mean())
    found = ClusterSeries()
    for i in used:
        frame = trajectory[i]
        found.times.append(frame.time)
        found.clusters.append(
            cluster.clusters(
                frame.position,
                trajectory.box,
                radius=trajectory.disks.radius,
                gap=GAP * diameter,
                time=frame.time,
            )
        )
    last = found.clusters[-1]
    length = unit(trajectory, "length")
    rows = [
        Row("share of the largest cluster, last frame", last.largest),
        Row("disks in it", int(last.sizes[0]) if len(last.sizes) else 0),
        Row("its radius of gyration", float(last.radius_of_gyration[0]), unit=length),
        Row("mean size of the cluster of a disk", last.mean_size),
        Row("clusters of 2 or more", int(np.count_nonzero(last.sizes > 1))),
    ]
    size, count = np.unique(last.sizes, return_counts=True)
    tables = {
        "": {
            "time": np.array(found.times),
            "largest": np.array([one.largest for one in found.clusters]),
            "mean_size": np.array([one.mean_size for one in found.clusters]),
            "radius_of_gyration": np.array([one.radius_of_gyration[0] for one in found.clusters]),
        },
        "sizes": {"size": size, "clusters": count},
    }
    gap = trajectory.with_unit(f"{last.gap:.4g}", "length")
    notes = [f"disks whose surfaces are nearer than {gap} ({GAP:g} mean diameters) are joined"]
    if last.spans[:1].any():
        notes.append("the largest spans the box: it has no radius of gyration")
    return Outcome(found, rows, tables, notes, times(trajectory, used), frames=len(used))


def of_psi6(trajectory: Trajectory, chosen: Sequence[int] | None) -> Outcome:
    stored.need(trajectory, "position")
    used = latest(trajectory, chosen)
    local, whole = [], []
    value, where = [], []
    for i in used:
        frame = trajectory[i]
        result = psi6.hexatic(frame.position, trajectory.box, time=frame.time)
        local.append(result.local)
        whole.append(result.whole)
        value.append(np.abs(result.psi6))
        where.append(frame.position)
    rows = [
        Row("mean of |psi_6|", *common.mean_with_error(local)),
        Row("|mean of psi_6|", *common.mean_with_error(whole)),
    ]
    table = {"time": trajectory.times[used], "local": np.array(local), "whole": np.array(whole)}
    notes = ["of the six nearest neighbours"]
    if len(used) > 1:
        notes.append("errors by the scatter over frames")
    doubts: list[str] = []
    if len(used) > 1:
        doubts = steadiness.doubts(
            [steadiness.between_cells("the mean of |psi_6|", value, where, trajectory.box)]
        )
    return Outcome(result, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))
