"""Trajectories in the formats of other codes: copies, unlike `views`."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import printable
from ..quantities import FIELDS
from ..tools import checked
from ..tools.files import check_apart, write_aside
from . import collisions, tables
from .damage import FAULTS
from .formats import FORMATS, TABLES
from .history import History
from .layout import chunk_disks
from .reader import SPIN, Trajectory
from .repair import write_whole
from .rows import converted
from .species import named_species

EXTXYZ_NAMES = {"position": "pos", "velocity": "velo"}  # what OVITO calls them
CONSTANT = ("radius", "mass", "k", "material", "species")  # properties of disks that other formats are given
TEXTS_AT_ONCE = 1 << 16
"""Disks of a frame that are written together, as text."""
CSV_KEYS = ("frame", "time", "id")  # first columns of a CSV


def export(
    trajectory: Trajectory,
    path: str | os.PathLike[str],
    to: str,
    frames: Sequence[int],
    *,
    progress: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> None:
    """Write frames of a trajectory to a file; memory holds one frame at a time, of csv and extxyz a part of it.

    The file at `path` appears whole or not at all, and replaces one that is there; `frames` are written in this order,
    and `progress` wraps them, to show how far it is.

    gsd: HOOMD's schema in two dimensions, single precision, with the origin in the middle of the box, whose sides
    between walls are twice as long because HOOMD takes all as periodic (`Box.cell`); `angle` as orientations, spins as
    angular momenta, both also as logged quantities `particles/angle` and `particles/angular_velocity`, times as `time`;
    types are species. extxyz: extended XYZ with z = 0, every stored field, names of species without blanks in the
    column `kind`, and what ASE takes: `masses`, and `momenta` where velocities are stored. csv: a line for each
    disk in each frame, with a header; of one frame, a start file. The last two keep every digit that is stored. h5: a trajectory of
    these frames, ascending, with series and histories, in one file; so parts are put together.

    Raises InputError if the format is none of these, a field it needs is not stored, a package is missing, numbers are
    outside of the range of single precision for gsd, or it cannot be written.
    """
    checked.choice("to", to, FORMATS)
    writers = {"gsd": _gsd, "extxyz": _extxyz, "csv": _csv, "h5": write_whole}
    if to in ("gsd", "extxyz"):
        trajectory.require("position")
    check_apart(Path(path), trajectory.path)
    write_aside(Path(path), lambda aside: writers[to](trajectory, aside, progress(frames)))


def write_history(history: History, path: Path) -> None:
    """A disk's events as CSV with a header, a line an event; every digit is kept.

    NumPy writes numbers as the shortest texts from which they come back.
    """
    found: dict[str, NDArray[Any]] = {}
    for name, value in history.columns.items():
        ends = ("n", "t") if name == "impulse" else ()
        found.update(tables.columns(name, value, ends))
    texts = np.column_stack([column.astype(str) for column in found.values()]).tolist()
    write_aside(path, lambda aside: write_csv(aside, found, texts))


def export_collisions(trajectory: Trajectory, path: Path, to: str) -> int:
    """Write the table of collisions of tracked disks (`collisions.table`) as csv or parquet; return their number.

    Raises InputError if the file has no histories, a package is missing, or the table cannot be written.
    """
    found = collisions.table(trajectory)
    check_apart(path, trajectory.path)
    write_table(path, found, to)
    return len(found["time"])


def write_table(path: Path, columns: dict[str, NDArray[Any]], to: str) -> None:
    """Write columns, (rows,) each, as csv with every digit, or as parquet; the file appears whole or not at all."""
    checked.choice("to", to, TABLES)
    if to == "csv":
        texts = [each.astype(str).tolist() for each in columns.values()]
        write_aside(path, lambda aside: write_csv(aside, columns, zip(*texts, strict=True)))
        return
    parquet, arrow = (tables.optional_import(name, "export") for name in ("pyarrow.parquet", "pyarrow"))
    write_aside(path, lambda aside: parquet.write_table(arrow.table(columns), aside))


def write_csv(path: Path, names: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a header and rows."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(rows)


def _blocks(n: int) -> Iterator[slice]:
    """Slices of n disks, of whole chunks of the file: as many as are written together, as text."""
    step = max(TEXTS_AT_ONCE // chunk_disks(n), 1) * chunk_disks(n)
    for first in range(0, n, step):
        yield slice(first, min(first + step, n))


def _stored(trajectory: Trajectory, index: int, disks: slice) -> dict[str, NDArray[Any]]:
    """The fields of some disks of a frame in the precision in which they are stored, and their constant properties."""
    fields = {name: trajectory.read(name, (index, disks)) for name in trajectory.fields}
    return fields | {name: trajectory.constants(name, disks) for name in CONSTANT}


def _csv(trajectory: Trajectory, path: Path, frames: Iterable[int]) -> None:
    def rows() -> Iterable[tuple[object, ...]]:
        for index in frames:
            keys = str(index), repr(float(trajectory.times[index]))
            for disks in _blocks(trajectory.n):
                columns = _stored(trajectory, index, disks)
                parts = (part for name, value in columns.items() for part in tables.columns(name, value))
                texts = (column.astype(str).tolist() for _, column in parts)
                for i, *row in zip(range(disks.start, disks.stop), *texts, strict=True):
                    yield *keys, i, *row

    write_csv(path, [*CSV_KEYS, *csv_names(trajectory.fields)], rows())


def csv_names(fields: Iterable[str]) -> list[str]:
    """Names of the columns of a CSV after the keys: fields, then constant properties."""
    empty = {name: np.zeros((0, *FIELDS[name].tail)) for name in fields}
    return [*(end for name, value in empty.items() for end, _ in tables.columns(name, value)), *CONSTANT]


def kinds(trajectory: Trajectory) -> tuple[list[str], NDArray[np.intp]] | None:
    """Names of the kinds of disks, and the kind of each: species, else materials; None if the file has no names."""
    if (named := species(trajectory)) is not None:
        return [*named], np.repeat(np.arange(len(named)), [*named.values()])
    materials = material_names(trajectory)
    return None if materials is None else (materials, trajectory.disks.material.astype(np.intp))


def species(trajectory: Trajectory) -> dict[str, int] | None:
    """Names and numbers of species, in the order of ids; None if the file has none."""
    return named_species(trajectory.parameters, trajectory.n)


def material_names(trajectory: Trajectory) -> list[str] | None:
    """Names of the materials of disks and walls, by their numbers; None if the file has none."""
    try:
        names = json.loads(str(trajectory.parameters["materials"]))
        known = isinstance(names, list) and all(isinstance(name, str) for name in names)
        if known and len(names) > trajectory.disks.material.max(initial=-1):
            return [*map(printable, names)]
    except FAULTS:  # parameters may be anybody's
        pass
    return None


def _extxyz(trajectory: Trajectory, path: Path, frames: Iterable[int]) -> None:
    n, box, named = trajectory.n, trajectory.box, kinds(trajectory)
    names = None if named is None else np.array(["_".join(name.split()) or "_" for name in named[0]])

    def columns_of(index: int, disks: slice) -> tuple[list[str], list[list[str]]]:
        """Properties of a frame, and texts of some disks, column by column."""
        number = disks.stop - disks.start
        # X is no chemical element; ASE takes no other name.
        properties, columns = ["species:S:1"], [["X"] * number]
        if named is not None and names is not None:
            properties.append("kind:S:1")
            columns.append(names[named[1][disks]].tolist())
        stored = _stored(trajectory, index, disks)
        del stored["species"]  # the word is that of chemical elements here
        mass = stored["mass"]
        if "velocity" in stored:  # immovable disks are at rest
            weight = np.where(np.isfinite(mass), mass, 0.0)
            momenta = weight[:, None] * stored["velocity"].astype(np.float64)
            fields = {name: stored[name] for name in trajectory.fields}
            stored = {**fields, "momenta": momenta, **stored}
        stored["masses"] = mass  # OVITO knows `mass` and `velo`, ASE `masses` and `momenta`
        for name, value in stored.items():
            vector = value.shape[1:] == (2,)
            kind = "I" if value.dtype.kind == "i" else "R"
            count = 3 if vector else int(np.prod(value.shape[1:]))
            properties.append(f"{EXTXYZ_NAMES.get(name, name)}:{kind}:{count}")
            columns += (value.T if value.ndim == 2 else value[None]).astype(str).tolist()
            if vector:
                columns.append(["0"] * number)
        return properties, columns

    with path.open("w", encoding="utf-8") as file:
        for index in frames:
            properties, _ = columns_of(index, slice(0, 0))
            time = float(trajectory.times[index])
            cell = ""
            if not box.is_open:
                above = box.image_above(time)
                width, height = box.lengths
                # OVITO's Voronoi cells of disks on a side of a leaning cell have no area: z is from -1/2 to 1/2.
                cell = f'Lattice="{width!r} 0 0 {above!r} {height!r} 0 0 0 1" Origin="0 0 -0.5" '
            periodic = " ".join("T" if one else "F" for one in (*box.periodic, False))
            head = f'{cell}Properties={":".join(properties)} pbc="{periodic}" time={time!r} frame={index}'
            file.write(f"{n}\n{head}\n")
            for disks in _blocks(n):
                _, columns = columns_of(index, disks)
                file.writelines(f"{' '.join(row)}\n" for row in zip(*columns, strict=True))


def _gsd(trajectory: Trajectory, path: Path, frames: Iterable[int]) -> None:
    hoomd = tables.optional_import("gsd.hoomd", "export")
    path.touch()  # GSD makes files that others cannot read, whatever the umask allows
    with hoomd.open(str(path), "w") as file:
        for index in frames:
            file.append(_snapshot(hoomd, trajectory, index))


def _snapshot(hoomd: Any, trajectory: Trajectory, index: int) -> Any:
    """A frame in HOOMD-blue's schema: the box about the origin, Lz = 0 and dimensions = 2."""
    frame, disks, box = trajectory[index], trajectory.disks, trajectory.box
    n = disks.n
    flat = np.zeros((n, 3), dtype=np.float32)
    snapshot = hoomd.Frame()
    snapshot.configuration.step = index
    snapshot.configuration.dimensions = 2
    position = frame.position
    if box.is_open:  # HOOMD knows no open plane: a square about all of them
        middle = (position.min(axis=0) + position.max(axis=0)) / 2.0 if n else np.zeros(2)
        # Twice as large as they are spread out, so that no minimum image crosses it.
        side = 2.0 * float(np.ptp(position, axis=0).max() + 2.0 * disks.radius.max()) if n else 1.0
        lengths, tilt = np.array([side, side]), 0.0
    else:
        middle, lengths, tilt = 0.5 * np.asarray(box.lengths), np.asarray(frame.box[:2]), frame.box[3]
    centred = position - middle
    if tilt:  # into HOOMD's parallelogram
        centred[:, 0] -= lengths[0] * np.round((centred[:, 0] - tilt * centred[:, 1]) / lengths[0])
    flat[:, :2] = _single("position", centred)
    snapshot.configuration.box = [*_single("side of the box", lengths), 0.0, tilt, 0.0, 0.0]
    particles = snapshot.particles
    particles.N, particles.position = n, flat
    particles.mass, particles.diameter = _single("mass", disks.mass), _single("diameter", 2.0 * disks.radius)
    numbered = [f"M{i}" for i in range(int(disks.material.max(initial=-1)) + 1)]
    particles.types, particles.typeid = kinds(trajectory) or (numbered, disks.material)
    inertia = np.zeros((n, 3), dtype=np.float32)
    inertia[:, 2] = _single("moment of inertia", disks.inertia)
    particles.moment_inertia = inertia
    half = np.zeros(n)
    if "angle" in trajectory.fields:
        half = 0.5 * frame["angle"]
        particles.orientation = _about_z(np.cos(half), np.sin(half))
    if SPIN in trajectory.fields:
        # HOOMD's angmom p is 2 q (0, L), L in the body's axes: L = Im(q* p) / 2. Immovable disks are at rest.
        doubled = 2.0 * np.where(disks.movable, disks.inertia, 0.0) * frame.spin
        momentum = _single("angular momentum, doubled", doubled)
        particles.angmom = _about_z(-np.sin(half) * momentum, np.cos(half) * momentum)
    for name in ("velocity", "image"):
        # Images of a sheared box are counted along other axes than those of the parallelogram.
        if name in trajectory.fields and not (name == "image" and box.shear_rate):
            value = np.zeros((n, 3), dtype=np.float32 if name == "velocity" else np.int32)
            value[:, :2] = _single(name, frame[name]) if name == "velocity" else frame[name]
            setattr(particles, name, value)
    snapshot.log["time"] = np.array([frame.time])
    for name in trajectory.fields:
        if name not in ("position", "velocity", "image"):
            snapshot.log[f"particles/{name}"] = frame[name]
    return snapshot


def _single(what: str, values: NDArray[Any]) -> NDArray[np.float32]:
    """Numbers in the precision of GSD; InputError if they are outside of its range."""
    return converted(what, values, np.float32, "export to extxyz, csv or h5, which hold double precision")


def _about_z(real: NDArray[Any], along_z: NDArray[Any]) -> NDArray[Any]:
    """Quaternions (real, 0, 0, z), shape (n, 4)."""
    zero = np.zeros_like(real)
    return np.stack((real, zero, zero, along_z), axis=1)
