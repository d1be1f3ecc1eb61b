"""Estimates of a case before it runs: mean free paths, collisions, bytes.

A trajectory file holds its data in whole chunks, HDF5's trees of chunks, and groups. In HDF5's default format ("File
Format Specification", version 1 of its B-trees) a chunk is stored whole, however few rows of it are used; the tree of a
dataset of rank r has nodes for 64 chunks, of 24 + 64 x 8 + 65 x (8 + 8 (r + 1)) bytes, and where chunks come in order
each is left nine tenths full. What groups, links and headers take was measured on files with 2 to 20,000 frames and
rows (HDF5 of h5py 3.16, 2026-11-21): some 1,510 bytes a dataset, whatever it holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import theory
from ..errors import TheoryError
from ..kernels import limits
from ..model.observables import MECHANISMS, REGIMES
from ..theory import driven_gas, sheared_gas
from ..theory.driven_gas import Drive
from ..trajectory import layout
from .case import Case
from .gas import Gas, Species
from .output_section import OutputSection

OBSERVABLES = {
    "translational_energy": 1,
    "rotational_energy": 1,
    "energy": 1,
    "temperature": 1,
    "rotational_temperature": 1,
    "momentum": 2,
    "potential_energy": 1,
    "energy_input": 1,
    "wall_work": 1,
    "wall_heat": 1,
    "dissipated_energy": 1,
    "collisions": 1,
    "wall_hits": 1,
}
"""What a run writes of the whole gas at each frame, with the number of components."""
SERIES = {**OBSERVABLES, "time": 1, "step": 1}
LEDGER = {
    "dissipated_by_mechanism": len(MECHANISMS),
    "collisions_by_regime": len(REGIMES),
    "ledger_residual": 1,
}
"""The same of the time series, the latter with output.ledger."""

GROUP_BYTES = 1510
"""Of each dataset with a group of its own, links and header."""
SHARED_BYTES = 690
"""Of those that share a group, the columns of histories."""
RECORD_BYTES = 14_000
"""Of the record (`parameters`), the constant properties and the box, beside the texts of the case."""
COPIES = 2
"""Of the case's text: as it was written, and in full."""
NODE = 64
FILLED = 0.9 * NODE


@dataclass(frozen=True)
class Estimate:
    """Figures of a gas at its start, and of its run.

    Attributes
    ----------
    packing_fraction : float
        Part of the area that the disks cover; between walls, of the room that these leave (`room.py`); 0 if open.
    number_density : float
        Disks per area [1/length^2]; 0 in an open box.
    collision_rate : tuple of float
        Collisions per disk and time [1/time], species by species; 0 in an open box.
    free_path : tuple of float
        Mean free paths [length], species by species: mean speed over collision rate; nan where nothing moves.
    end_time : float
        Simulated time at the end [time]; nan where theory does not tell.
    collisions : float
        Collisions of two disks in the whole run, each counted once; nan where theory does not tell.
    collisions_at_most : bool
        Whether `collisions` is only an upper bound: the initial rate, which cooling lowers.
    steady_state : tuple of float or None
        T and T_rot [energy] at which a driven or sheared gas would stay, by kinetic theory.
    wall_hits : float
        Collisions with walls per time [1/time] at the start; 0 without walls.
    file_bytes, array_bytes : int
        Size of the trajectory file, and of the engine's arrays.
    frames, rows, tracked : int
        Frames and rows of the time series, at most, and disks with histories.
    """

    packing_fraction: float
    number_density: float
    collision_rate: tuple[float, ...]
    free_path: tuple[float, ...]
    end_time: float
    collisions: float
    collisions_at_most: bool
    steady_state: tuple[float, float] | None
    wall_hits: float
    file_bytes: int
    array_bytes: int
    frames: int
    rows: int
    tracked: int

    @classmethod
    def of(cls, gas: Gas, case: Case) -> Estimate:
        """The estimate for a gas and the case that it comes from."""
        n, phi, area = gas.disks.n, gas.room.packing_fraction(gas.disks.radius), gas.room.area()
        rates, speeds = _rates_and_speeds(gas)
        paths = [speed / rate if rate > 0.0 else math.nan for speed, rate in zip(speeds, rates, strict=True)]
        mean_rate = sum(each.number * rate for each, rate in zip(gas.species, rates, strict=True)) / n
        drive, steady = None, None
        if case.force and case.homogeneous and len(gas.species) == 1 and gas.species[0].equal:
            (each,) = gas.species
            mass, radius = float(each.mass[0]), float(each.radius[0])
            drive = Drive.of([force.model_dump() for force in case.force], mass, mass * radius**2 / each.k)
            if drive is not None and not gas.box.is_open and gas.law().rho == 0.0:
                steady = driven_gas.steady_state(gas.law(), mass, radius, each.k, phi, drive)
        end, per_disk = (
            case.run.t_end if case.run.t_end is not None else math.nan,
            case.run.collisions_per_disk if case.run.collisions_per_disk is not None else math.nan,
        )
        if gas.box.shear_rate:
            steady, per_disk = _sheared(gas, phi, case)
        elif case.homogeneous and not gas.box.is_open and (not case.force or drive is not None):
            end, per_disk = _expected(gas, phi, mean_rate, drive, steady, end, per_disk)
        # A drive, a flow, a fall or a wall that moves or is hot may raise the rate; in an open box there is none.
        driven = bool(case.force) or any(case.box.gravity) or gas.box.shear_rate != 0.0
        driven |= any(each.motion is not None or each.temperature is not None for each in case.wall)
        at_most = math.isnan(per_disk) and not driven and not gas.box.is_open
        if at_most:
            per_disk = mean_rate * (case.run.t_end or 0.0)
        output = case.output
        frames, rows = (
            each.count(duration=end, collisions_per_disk=per_disk) + 1
            for each in (output.frame_cadence, output.series_cadence)
        )
        tracked = _tracked(output, gas)
        # Every collision of a tracked disk, and each time that forces act on it; unknown ones do not count.
        changes = [per_disk, *(end / step for step in {force.step for force in case.force})]
        events = sum(round(tracked * each) for each in changes if not math.isnan(each))
        return cls(
            packing_fraction=phi,
            number_density=n / area,
            collision_rate=tuple(rates),
            free_path=tuple(paths),
            end_time=end,
            collisions=0.5 * n * per_disk,
            collisions_at_most=at_most,
            steady_state=steady,
            wall_hits=_wall_hits(gas),
            file_bytes=trajectory_bytes(
                n,
                output.fields,
                output.precision,
                frames=frames,
                observables=OBSERVABLES,
                rows=rows,
                series={**SERIES, **(LEDGER if output.ledger else {})},
                tracked=tracked,
                events=events,
                text=len(case.model_dump_json()),
            ),
            frames=frames,
            rows=rows,
            tracked=tracked,
            array_bytes=n * (limits.BYTES_PER_DISK + output.ledger * limits.LEDGER_BYTES_PER_DISK),
        )


def _tracked(output: OutputSection, gas: Gas) -> int:
    """About how many disks have histories."""
    if output.histories_all:
        return gas.disks.n
    if output.histories is not None:
        return len(output.histories)
    if output.histories_region is not None:
        x_low, y_low, x_high, y_high = output.histories_region
        width = min(x_high, gas.box.lengths[0]) - max(x_low, 0.0)
        height = min(y_high, gas.box.lengths[1]) - max(y_low, 0.0)
        return 0 if gas.box.is_open else round(gas.disks.n * width * height / gas.box.area)
    return output.histories_sample or 0


def _rates_and_speeds(gas: Gas) -> tuple[list[float], list[float]]:
    """Collision rate [1/time] and mean speed [length/time] of a disk of each species, means over its radii."""
    classes = [each.classes() for each in gas.species]
    found = iter(collision_rates([one for group in classes for one in group], gas.room.area()))
    rates, speeds = [], []
    for group in classes:
        number = np.array([one.number for one in group])
        rates.append(float(np.average([next(found) for _ in group], weights=number)))
        rms = np.average([one.speed_rms for one in group], weights=number)
        speeds.append(math.sqrt(math.pi / 4.0) * float(rms))  # of a Maxwellian in two dimensions
    return rates, speeds


def _wall_hits(gas: Gas) -> float:
    """Collisions with walls per time [1/time] of a gas with Maxwellian velocities.

    Disks of one kind cross a line one way at n_w sqrt(T / (2 pi m)) per length, where v_x^2 has the mean T / m. At a
    wall, in equilibrium, their density n_w is that of the middle times p / (n T) = 1 + 2 phi g, because the pressure is
    the same; here the mean is taken for the middle, and centres stay a radius off.
    """
    room = gas.room
    if not room.all_walls:
        return 0.0
    phi = room.packing_fraction(gas.disks.radius)
    crowding = 1.0 + 2.0 * phi * theory.contact_value(min(phi, 0.9))
    rate = 0.0
    for each in gas.species:
        inset = float(each.radius.mean())
        area = room.area(inset)
        if area > 0.0:
            along_x = each.speed_rms / math.sqrt(2.0)
            flux = each.number / area * along_x / math.sqrt(2.0 * math.pi)
            rate += crowding * flux * room.wall_length(inset)
    return rate


def collision_rates(species: Sequence[Species], area: float) -> NDArray[np.float64]:
    """Collisions per disk and time [1/time] of each species of equal disks in a gas with Maxwellian velocities.

    Enskog's rate: disks of species j, with number density n_j, meet one of species i at
    sqrt(2 pi) n_j sigma_ij g_ij sqrt(u_i^2 + u_j^2), where sigma_ij = R_i + R_j, u^2 is the variance of a
    velocity component, and sqrt(2 pi) comes from the mean relative speed, sqrt(pi/2) sqrt(u_i^2 + u_j^2),
    times the width 2 sigma_ij. The contact values follow from those of equal disks at the same packing
    fraction,

        g_ij = 1/(1 - phi) + (g - 1/(1 - phi)) (sigma_i sigma_j / sigma_ij) <sigma> / <sigma^2>

    with sigma the diameters (and sigma_ij the mean of the two): Santos, Yuste and Lopez de Haro, Mol. Phys.
    96, 1 (1999). For one species this is `theory.collision_rate`.

    Parameters
    ----------
    species : sequence of Species
        Masses do not matter, because speeds are given, not temperatures.
    area : float
        Area of the box [length^2].
    """
    number = np.array([each.number for each in species], dtype=np.float64)
    diameter = np.array([2.0 * each.radius.mean() for each in species])
    variance = np.array([0.5 * each.speed_rms**2 for each in species])
    phi = float(np.sum(number * math.pi * diameter**2 / 4.0)) / area
    sigma = 0.5 * (diameter[:, None] + diameter[None, :])
    ideal = 1.0 / (1.0 - phi)
    mean_ratio = np.sum(number * diameter) / np.sum(number * diameter**2)
    mixed = np.outer(diameter, diameter) / sigma * mean_ratio
    g = ideal + (theory.contact_value(phi) - ideal) * mixed
    speed = np.sqrt(variance[:, None] + variance[None, :])
    return math.sqrt(2.0 * math.pi) * np.sum(number[None, :] / area * sigma * g * speed, axis=1)


def _sheared(gas: Gas, phi: float, case: Case) -> tuple[tuple[float, float] | None, float]:
    """Where a sheared gas would stay, and collisions per disk at the end; None and nan where theory does not tell."""
    per_disk = case.run.collisions_per_disk if case.run.collisions_per_disk is not None else math.nan
    law = gas.law()
    if case.force or len(gas.species) > 1 or not gas.species[0].equal or law.rho > 0.0:
        return None, per_disk
    (each,) = gas.species
    mass, radius = float(each.mass[0]), float(each.radius[0])
    one = (law, mass, radius, each.k, phi, gas.box.shear_rate)
    T, T_rot = 0.5 * mass * each.speed_rms**2, mass * radius**2 / each.k * each.spin_rms**2
    try:
        if case.run.t_end is not None and T > 0.0:
            per_disk = float(sheared_gas.sheared(*one, T, T_rot, [case.run.t_end])[2][0])
        return sheared_gas.steady_state(*one), per_disk
    except TheoryError:
        return None, per_disk


def _expected(
    gas: Gas,
    phi: float,
    rate: float,
    drive: Drive | None,
    steady: tuple[float, float] | None,
    t_end: float,
    collisions_per_disk: float,
) -> tuple[float, float]:
    """Time and collisions per disk at the end, by kinetic theory; nan for what it does not tell.

    One of the two is given, the other nan; `rate` is that of collisions of a disk at the start [1/time].
    """
    from scipy.optimize import brentq

    unknown = t_end, collisions_per_disk
    law = gas.law()
    if len(gas.species) > 1 or not gas.species[0].equal or law.rho > 0.0:
        return unknown
    (each,) = gas.species
    mass, radius = float(each.mass[0]), float(each.radius[0])
    if steady is not None:
        rate = max(rate, theory.collision_rate(phi, steady[0], mass, radius))
    T = 0.5 * mass * each.speed_rms**2
    if rate == 0.0 or (T == 0.0 and (drive is None or drive.power == 0.0)):
        return unknown
    T_rot = mass * radius**2 / each.k * each.spin_rms**2

    def per_disk(time: float) -> float:
        one = (law, mass, radius, each.k, phi)
        if drive is None:
            return float(theory.cooling(*one, T, T_rot, [time])[2][0])
        return float(driven_gas.driven(*one, drive, T, T_rot, [time])[2][0])

    if math.isnan(collisions_per_disk):
        return t_end, per_disk(t_end)
    # Cooling slows the collisions: double the time until there are enough, then close in.
    late = collisions_per_disk / rate
    while per_disk(late) < collisions_per_disk:
        late *= 2.0
        if late > 1e12 * collisions_per_disk / rate:
            return unknown
    return float(
        brentq(lambda time: per_disk(time) - collisions_per_disk, 0.0, late, rtol=1e-6)
    ), collisions_per_disk


def disk_bytes(fields: Sequence[str], precision: str) -> int:
    """Bytes per disk and frame of these fields in a trajectory file without compression."""
    size = np.dtype(layout.PRECISIONS[precision]).itemsize
    chosen = [layout.FIELDS[name] for name in fields]
    return sum(field.components * (4 if field.count else size) for field in chosen)


def trajectory_bytes(
    n: int,
    fields: Sequence[str],
    precision: str,
    *,
    frames: int,
    observables: Mapping[str, int],
    rows: int,
    series: Mapping[str, int],
    tracked: int,
    events: int,
    text: int,
) -> int:
    """Bytes of a trajectory file without compression.

    Parameters
    ----------
    n : int
        Disks.
    fields, precision
        What a frame holds of each.
    frames, rows, events : int
        Of the trajectory, of the time series, of the histories.
    observables, series : mapping
        Name -> number of components, of 8 bytes each.
    tracked : int
        Disks with histories.
    text : int
        Characters of the case.
    """
    stored = [_dataset(frames, layout.CHUNK_FRAMES, width, 8) for width in (1, 1, 3, *observables.values())]
    per_chunk, item = layout.chunk_disks(n), np.dtype(layout.PRECISIONS[precision]).itemsize
    for name in fields:
        field = layout.FIELDS[name]
        chunks = frames * -(-n // per_chunk)
        size = per_chunk * field.components * (4 if field.count else item)
        stored.append(chunks * size + _tree(chunks, 1 + field.components) + GROUP_BYTES)
    if rows:
        stored += [_dataset(rows, max(1, layout.CHUNK_ROWS // width), width, 8) for width in series.values()]
    if tracked:
        most, few = layout.CHUNK_EVENTS, layout.FEW_EVENTS
        chunk = most if tracked >= layout.MANY else min(most, few)
        for column in layout.EVENT_COLUMNS.values():
            size = _dataset(events, chunk, column.components, np.dtype(column.dtype).itemsize)
            stored.append(size - GROUP_BYTES + SHARED_BYTES)
        # Where they begin: position, velocity, spin, image, and which they are.
        stored.append((2 * 8 + 2 * 8 + 8 + 2 * 4 + 4) * tracked + 8 * SHARED_BYTES)
    # The constant properties once: radius, mass, k in 8 bytes, the material in 4.
    return sum(stored) + 28 * n + RECORD_BYTES + COPIES * text


def _dataset(rows: int, chunk: int, width: int, item: int) -> int:
    """Bytes of rows of `width` items, with so many rows in a chunk."""
    chunks = math.ceil(rows / chunk)
    return chunks * chunk * width * item + _tree(chunks, 1 if width == 1 else 2) + GROUP_BYTES


def _tree(chunks: int, rank: int) -> int:
    """Bytes of the tree of so many chunks of a dataset of this rank."""
    node = 24 + NODE * 8 + (NODE + 1) * (8 + 8 * (rank + 1))
    if chunks <= NODE:
        return node if chunks else 0
    leaves = math.ceil(chunks / FILLED)
    return node * leaves + _tree(leaves, rank)
