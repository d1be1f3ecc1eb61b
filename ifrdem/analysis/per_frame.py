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
from . import common, fields, steadiness, structure, velocities
from . import result as stored
from .result import Columns, Evaluation, Reading, kinds, latest, times, unit

GAP = 0.1
"""Of the mean diameter: the gap below which disks are of one cluster."""
NEAR = 1.25
"""Mean diameters below which others are near a disk: by their number g near contact is held for steady or not."""
BINS = 81
"""Of distributions of velocities and spins."""
SONINE = ("a20", "a02", "a11")
Indices = NDArray[np.intp]


def of_velocity(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "velocity", "angular_velocity", *["position"] * bool(trajectory.box.shear_rate))
    used, disks = latest(trajectory, chosen), trajectory.disks
    results: dict[str, velocities.VelocityDistribution] = {}
    rows: list[Reading] = []
    table: Columns = {}
    changes: list[steadiness.Change] = []

    def distribution(which: Indices, some: Sequence[int], bins: int) -> velocities.VelocityDistribution:
        names = ("peculiar_velocity", "spin")
        frames = [[getattr(trajectory[i], name)[which] for i in some] for name in names]
        mass, inertia = disks.mass[which], disks.inertia[which]
        return velocities.velocity_distribution(frames[0], frames[1], mass=mass, inertia=inertia, bins=bins)

    def coefficient(found: velocities.VelocityDistribution, label: str) -> tuple[float, float]:
        return getattr(found.sonine, label), getattr(found.sonine, f"{label}_error")

    for name, which in kinds(trajectory).items():
        found = results[name] = distribution(which, used, BINS)
        of, mark = ("", "") if len(which) == disks.n else (f" of {name}", f" [{name}]")
        rows += [Reading(f"{label}{of}", *coefficient(found, label)) for label in SONINE]
        if len(used) > 1:
            early, late = (distribution(which, half, 1) for half in steadiness.halves(used))
            for label in SONINE:
                then, now = coefficient(early, label), coefficient(late, label)
                changes.append(steadiness.between(f"{label}{of}", then, now, len(which) - 1))
        columns = {"c": "speed", "P(c)": "density", "P(w)": "spin_density"}
        columns |= {f"{name} error": f"{columns[name]}_error" for name in ("P(c)", "P(w)")}
        order = ("c", "P(c)", "P(c) error", "P(w)", "P(w) error")
        table |= {f"{name}{mark}": getattr(found, columns[name]) for name in order}
    notes = [f"of {name}" for name in results if "together" in name]
    notes += ["c = v_x or v_y over sqrt(2 T / m), w = omega over sqrt(2 T_rot / I); 0 for Gaussians"]
    doubts = steadiness.doubts(changes)
    return Evaluation(results, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def _positions(trajectory: Trajectory, used: Sequence[int]) -> Iterator[Array]:
    return (trajectory[i].position for i in used)


def of_pairs(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "position")
    used = latest(trajectory, chosen)
    box, radius, when = trajectory.box, trajectory.disks.radius, trajectory.times[used]
    diameter = 2.0 * float(radius.mean())
    reach = min(6.0 * diameter, 0.45 * min(box.lengths))
    found = structure.pair_correlation(_positions(trajectory, used), box, r_max=reach, bins=240, time=when)
    rows: list[Reading] = []
    try:
        if trajectory.room.all_walls:
            notes = ["walls: no contact value, and g is relative to the mean density of the whole box"]
        else:
            contact = structure.contact_value(_positions(trajectory, used), box, radius=radius, time=when)
            rows.append(Reading("g at contact", contact.g, contact.error))
            quality = f"chi^2 = {contact.chi_square:.1f} for {contact.degrees} degrees of freedom"
            notes = [f"parabola fitted to ln g up to 1.25 diameters: {quality}"]
    except InputError as error:
        notes = [f"no contact value: {error}"]
    highest = float(found.r[np.argmax(found.g)])
    rows.append(Reading("r of the highest g", highest, unit=unit(trajectory, "length")))
    table = {"r": found.r, "g": found.g, "error": found.g_error}
    doubts = _neighbours_change(trajectory, used, min(NEAR * diameter, reach))
    return Evaluation(found, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def _neighbours_change(trajectory: Trajectory, used: Sequence[int], reach: float) -> list[str]:
    """Doubt of a g near contact over a change: how many others a disk has near it, cell by cell."""
    if len(used) < 2:
        return []
    count, where = [], []
    for i in used:
        frame = trajectory[i]
        ends = common.neighbours(frame.position, trajectory.box, reach, frame.time, "g(r)")[:2]
        both = np.concatenate(ends)
        count.append(np.bincount(both, minlength=len(frame.position)).astype(float))
        where.append(frame.position)
    what = f"the number of others whose centres are nearer to a disk's than {NEAR:g} mean diameters"
    return steadiness.doubts([steadiness.between_cells(what, count, where, trajectory.box)])


def of_structure(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "position")
    used = latest(trajectory, chosen)
    k_max, when = 10.0 / float(trajectory.disks.radius.mean()), trajectory.times[used]
    found = structure.structure_factor(_positions(trajectory, used), trajectory.box, k_max=k_max, time=when)
    high = int(np.argmax(found.S))
    wave = unit(trajectory, "1/length")
    rows = [
        Reading("S at the smallest k", float(found.S[0]), float(found.S_error[0])),
        Reading("smallest k", float(found.k[0]), unit=wave),
        Reading("highest S", float(found.S[high]), float(found.S_error[high])),
        Reading("its k", float(found.k[high]), unit=wave),
    ]
    table = {"k": found.k, "S": found.S, "error": found.S_error, "modes": found.modes}
    notes = [
        "errors as if frames were independent: at small k they are not if they follow each other closely"
    ]
    doubts = _modes_change(trajectory, used)
    return Evaluation(found, rows, {"": table}, notes, times(trajectory, used), doubts, len(used))


def _modes_change(trajectory: Trajectory, used: Sequence[int]) -> list[str]:
    """Doubt of an S(k) over a change: the intensities of the longest waves, mode by mode."""
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
    what = f"S in the mean over the {len(longest)} longest waves"
    return steadiness.doubts([steadiness.between_modes(what, [S.ravel()[longest] for _, S in modes])])


def of_fields(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "position", "velocity")
    used = latest(trajectory, chosen)[-1]
    disks, frame, box = trajectory.disks, trajectory[used], trajectory.box
    movable = np.isfinite(disks.mass)
    position = frame.position[movable]
    lengths = np.ptp(position, axis=0) if box.is_open else np.array(box.lengths)
    # Some 20 disks a cell, and 200 cells along a side at most.
    side = np.sqrt(float(np.prod(lengths)) * 20.0 / max(len(position), 1))
    a, b = (int(number) for number in np.clip(np.rint(lengths / side), 1, 200))
    spin = frame.spin[movable] if "angular_velocity" in trajectory.fields else None
    found = fields.coarse_grain(
        position, frame.peculiar_velocity[movable], spin, box=box, cells=(a, b), mass=disks.mass[movable],
        radius=disks.radius[movable], inertia=disks.inertia[movable],
    )  # fmt: skip
    phi, T = found.packing_fraction, found.temperature[np.isfinite(found.temperature)]
    mean_T = float(T.mean()) if len(T) else float("nan")
    flow = float(np.sqrt(np.nanmean(np.sum(found.velocity**2, axis=-1))))
    rows = [
        Reading("cells along x", a),
        Reading("cells along y", b),
        Reading("packing fraction, mean", float(phi.mean())),
        Reading("packing fraction, standard deviation", float(phi.std())),
        Reading("thermal temperature, mean over cells", mean_T, unit=unit(trajectory, "energy")),
        Reading("flow, root mean square", flow, unit=unit(trajectory, "length/time")),
    ]
    x, y = np.meshgrid(found.x, found.y, indexing="ij")
    columns = {
        "x": x, "y": y, "number_density": found.number, "packing_fraction": phi, "u_x": found.velocity[..., 0],
        "u_y": found.velocity[..., 1], "temperature": found.temperature,
        "rotational_temperature": found.rotational_temperature,
    }  # fmt: skip
    table = {name: column.ravel() for name, column in columns.items()}
    notes = [f"frame {used}; temperatures relative to the mean velocity of the cell"]
    if box.shear_rate:
        notes.append("velocities relative to the flow that the box imposes")
    return Evaluation(found, rows, {"": table}, notes, times(trajectory, [used]), frames=1)


@dataclass(frozen=True, eq=False, repr=False)
class ClusterSeries(Brief):
    """Clusters of some frames: their times, and what was found."""

    times: list[float] = field(default_factory=list)
    clusters: list[structure.Clusters] = field(default_factory=list)


def of_clusters(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "position")
    used, box, radius = latest(trajectory, chosen), trajectory.box, trajectory.disks.radius
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
        Reading("share of the largest cluster, last frame", last.largest),
        Reading("disks in it", int(last.sizes[0]) if len(last.sizes) else 0),
        Reading("its radius of gyration", float(last.radius_of_gyration[0]), unit=unit(trajectory, "length")),
        Reading("mean size of the cluster of a disk", last.mean_size),
        Reading("clusters of 2 or more", int(np.count_nonzero(last.sizes > 1))),
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
    return Evaluation(found, rows, tables, notes, times(trajectory, used), frames=len(used))


def of_psi6(trajectory: Trajectory, chosen: Sequence[int] | None) -> Evaluation:
    stored.need(trajectory, "position")
    used = latest(trajectory, chosen)
    where, box, when = list(_positions(trajectory, used)), trajectory.box, trajectory.times[used]
    found = [structure.hexatic(x, box, time=float(t)) for x, t in zip(where, when, strict=True)]
    local, whole = ([getattr(one, name) for one in found] for name in ("local", "whole"))
    rows = [
        Reading("mean of |psi_6|", *common.mean_with_error(local)),
        Reading("|mean of psi_6|", *common.mean_with_error(whole)),
    ]
    table = {"time": when, "local": np.array(local), "whole": np.array(whole)}
    notes, doubts = ["of the six nearest neighbours"], []
    if len(used) > 1:
        notes.append("errors by the scatter over frames")
        values = [np.abs(one.psi6) for one in found]
        doubts = steadiness.doubts([steadiness.between_cells("the mean of |psi_6|", values, where, box)])
    return Evaluation(found[-1], rows, {"": table}, notes, times(trajectory, used), doubts, len(used))
