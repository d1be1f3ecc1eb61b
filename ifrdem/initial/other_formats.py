"""Starts from dumps of LAMMPS and from extended XYZ: a frame as a table in the order of the species."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, counted, cut, listed, nearest
from ..model.box import Box
from ..mpi import current
from ..tools import text_file
from ..tools.checked import Array
from ..tools.tables import UNITS, ReadTable, TableFormat
from ..tools.values import number_of

NAMES: Mapping[str, tuple[str, ...]] = {
    "x": ("x", "xu", "xs", "xsu", "pos_x"),
    "y": ("y", "yu", "ys", "ysu", "pos_y"),
    "vx": ("vx", "velo_x", "vel_x", "velocity_x", "velocities_x"),
    "vy": ("vy", "velo_y", "vel_y", "velocity_y", "velocities_y"),
    "spin": ("omegaz", "omega_z", "angular_velocity", "angular_velocity_z"),
}
"""Our columns, and their names in other programs, the first that is there."""
SCALED = ("xs", "xsu", "ys", "ysu")
KINDS = {"LAMMPS": ("type",), "extended XYZ": ("kind", "type", "species")}
"""Columns that say which species a disk is of."""
LIKE = {"x": "length", "y": "length", "vx": "velocity", "vy": "velocity", "spin": "spin"}
MOST_REPORTED = 5
SAME_SIDE = 1e-6
"""Relative difference of sides of boxes that are rounded texts of one number."""

Species = Sequence[tuple[str, int]]
"""Names and numbers of the species of a case, in order."""


@dataclass
class _Frame:
    """A frame as it is written: columns, rows of texts with their lines, and its box."""

    names: list[str] = field(default_factory=list)
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    low: tuple[float, float] = (0.0, 0.0)
    sides: tuple[float, float] | None = None
    units: str = ""


def format_of(head: Sequence[str]) -> str:
    """The format of a file by its first lines; "" if it is none of these."""
    if head and head[0].startswith("ITEM: "):
        return "LAMMPS"
    return "extended XYZ" if len(head) > 1 and head[0].strip().isdigit() and "Properties=" in head[1] else ""


def read(
    path: Path,
    kind: str,
    n: int,
    species: Species,
    box: Box | None,
    form: TableFormat,
    *,
    frame: int = -1,
    most: int,
    units: str = "",
) -> ReadTable:
    """One frame of a dump of LAMMPS or of extended XYZ, as a table of x, y and perhaps vx, vy, spin.

    Rows are put into the order of the species, and by `id` within each. Type t of LAMMPS is species t of the case,
    counted from 1; names of extended XYZ are those of species, with _ for blanks. Scaled positions become lengths; the
    lower corner of the file's box becomes the origin; across periodic sides positions are taken back into the box.
    Numbers have the units of the case (`units`), or those of `form`; nothing is converted by itself.

    Raises InputError if the frame has other disks, another box, other units, or wrong values.
    """
    # Frames before the wanted one are forgotten: a file may have many.
    latest: deque[_Frame] = deque(maxlen=-frame if frame < 0 else 1)
    count = 0
    for each in _dumped(path, most) if kind == "LAMMPS" else _extended(path, most):
        if count <= frame or frame < 0:
            latest.append(each)
        count += 1
    if not -count <= frame < count:
        raise InputError(f"frame = {frame}: the file has {counted(count, 'frame')}")
    found = latest[0]
    wanted = _wanted(found.names, form, kind)
    _check_units(found.units, units, form, wanted)
    number = {name: i for i, name in enumerate(found.names)}
    problems = [
        f"line {line}: has {len(row)} values: must be {len(found.names)}, one for each of {cut(', '.join(found.names))}"
        for line, row in found.rows
        if len(row) != len(found.names)
    ]
    if problems:
        raise InputError(listed(problems, MOST_REPORTED))
    lines = np.array([line for line, _ in found.rows], dtype=np.int64)
    columns = {ours: _column(found, number[theirs], theirs) for ours, theirs in wanted.items()}
    order = _order(found, number, kind, species, n)
    for axis, (ours, theirs) in enumerate(list(wanted.items())[:2]):
        if theirs in SCALED:
            if found.sides is None:
                raise InputError(f"{theirs}: is scaled, and the file has no box")
            columns[ours] = columns[ours] * found.sides[axis]
        else:
            columns[ours] = columns[ours] - found.low[axis]
    for ours in columns:
        unit = form.units.get(ours)
        if unit is not None:
            factor = UNITS[LIKE[ours]].get(unit) or number_of(unit)
            if factor is None:
                raise InputError(f"units.{ours} = {unit}: must be {', '.join(UNITS[LIKE[ours]])} or a factor")
            columns[ours] = columns[ours] * factor
    if box is not None and not box.is_open:
        _check_box(found, box, form)
        for axis, ours in enumerate("xy"):
            if box.periodic[axis]:  # LAMMPS lets disks leave a little before it takes them back
                side = box.lengths[axis]
                columns[ours] = np.mod(columns[ours], side)
                columns[ours][columns[ours] >= side] = 0.0  # of -1e-20, by rounding
    own = current().slice_of(n)
    rows = order if len(order) != n else order[own.start : own.stop]
    return ReadTable(
        {name: each[rows] for name, each in columns.items()}, lines[rows], len(order), 0, (), str(path)
    )


def _dumped(path: Path, most: int) -> Iterator[_Frame]:
    """Frames of a dump of LAMMPS (`dump custom`)."""
    found, section, left = _Frame(), "", 0
    for number, text in enumerate(text_file.lines(path, most=most), start=1):
        line = text.strip()
        if line.startswith("ITEM: "):
            section = line.removeprefix("ITEM: ")
            if section.startswith("ATOMS"):
                found.names = section.split()[1:]
            elif section.startswith("BOX BOUNDS"):
                left = 2
                if "xy" in section or "abc" in section:
                    raise InputError(f"line {number}: a box that is tilted cannot start a run")
            elif section.startswith("TIMESTEP") and found.names:
                yield found
                found = _Frame(units=found.units)
        elif section.startswith("ATOMS") and line:
            found.rows.append((number, line.split()))
        elif section.startswith("BOX BOUNDS") and left:
            ends = [number_of(each) for each in line.split()[:2]]
            if len(ends) < 2 or None in ends:
                raise InputError(f"line {number}: must be two bounds of the box")
            (low, high), axis, left = ends, 2 - left, left - 1
            found.low = (low, found.low[1]) if axis == 0 else (found.low[0], low)  # type: ignore[assignment]
            side = high - low  # type: ignore[operator]
            found.sides = (side, side) if axis == 0 else ((found.sides or (0.0,))[0], side)
        elif section == "UNITS" and line:
            found.units = line
    if not found.names:
        raise InputError("has no line ITEM: ATOMS with the names of columns")
    yield found


def _extended(path: Path, most: int) -> Iterator[_Frame]:
    """Frames of extended XYZ."""
    rows = enumerate(text_file.lines(path, most=most), start=1)
    for number, text in rows:
        if not text.strip():
            continue
        if not text.strip().isdigit():
            raise InputError(f"line {number}: must be the number of disks of a frame")
        _, comment = next(rows, (0, ""))
        found = _Frame()
        properties = re.search(r'Properties="?([^\s"]+)', comment)
        if properties is None:
            raise InputError(f"line {number + 1}: has no Properties=, the names of columns")
        parts = properties[1].split(":")
        for name, width in zip(parts[::3], parts[2::3], strict=False):
            found.names += (
                [name] if width == "1" else [f"{name}_{axis}" for axis in "xyz"[: int(width)] or "xyz"]
            )
        if lattice := re.search(r'Lattice="([^"]*)"', comment):
            sides = [number_of(each) or 0.0 for each in lattice[1].split()]
            if len(sides) != 9 or any(sides[i] for i in (1, 3)):
                raise InputError(f"line {number + 1}: a box that is tilted cannot start a run")
            found.sides = sides[0], sides[4]
        if origin := re.search(r'Origin="([^"]*)"', comment):
            x, y, *_ = (number_of(each) or 0.0 for each in origin[1].split())
            found.low = x, y
        for _ in range(int(text)):
            line, row = next(rows, (0, ""))
            if not line:
                raise InputError(f"line {number}: {text.strip()} disks are to follow, and the file ends")
            found.rows.append((line, row.split()))
        yield found


def _wanted(names: Sequence[str], form: TableFormat, kind: str) -> dict[str, str]:
    """The file's name of each of our columns: x and y, and all of vx, vy, spin or none."""
    if (form.delimiter, form.decimal) != (TableFormat.delimiter, TableFormat.decimal):
        raise InputError(f"delimiter and decimal: are of CSV, and this is {kind}")
    if unknown := [each for each in form.columns if each not in NAMES]:
        raise InputError(
            f"columns.{unknown[0]}: no such column{nearest(unknown[0], NAMES)}; there are {', '.join(NAMES)}"
        )
    if lost := [each for each in form.columns.values() if each not in names]:
        raise InputError(
            f"columns: {kind} has no column {lost[0]}{nearest(lost[0], names)}; it has {', '.join(names)}"
        )
    found = {
        ours: form.columns.get(ours) or next((each for each in theirs if each in names), "")
        for ours, theirs in NAMES.items()
    }
    lacking = [ours for ours, theirs in found.items() if not theirs]
    moving = [ours for ours in list(NAMES)[2:] if found[ours]]
    if {"x", "y"} & {*lacking} or (moving and lacking):
        options = "; ".join(f"{ours} from {', '.join(NAMES[ours])}" for ours in lacking)
        text = f"has columns {', '.join(names)}, and lacks {', '.join(lacking)} ({options}): write them, or name them "
        raise InputError(
            f"{text}by columns"
            + ("; or write no velocities" if moving and not {"x", "y"} & {*lacking} else "")
        )
    return {ours: theirs for ours, theirs in found.items() if theirs}


def _check_units(own: str, units: str, form: TableFormat, wanted: Mapping[str, str]) -> None:
    """Raise InputError if a dump names units that are not those of the case, and the case does not convert them."""
    same = {"lj": "reduced", "si": "SI"}.get(own) == units or not own or not units
    if not same and not {*wanted} <= {*form.units}:
        text = f"is in LAMMPS's units {own}, and the case in {units}"
        raise InputError(
            f'{text}: give units of {", ".join(wanted)}, such as units = {{ x = "cm", y = "cm", ... }}'
        )


def _column(found: _Frame, at: int, name: str) -> Array:
    """Numbers of a column."""
    texts = [row[at] for _, row in found.rows]
    try:
        values = np.array(texts, dtype=np.float64)
    except ValueError:
        values = np.array([np.nan if number_of(each) is None else float(each) for each in texts])
    wrong = np.flatnonzero(~np.isfinite(values))
    problems = [
        f"line {found.rows[i][0]}: {name} = {cut(texts[i])}: must be a finite number"
        for i in wrong[:MOST_REPORTED]
    ]
    if problems:
        raise InputError(listed(problems, MOST_REPORTED, len(wrong)))
    return values


def _order(
    found: _Frame, number: Mapping[str, int], kind: str, species: Species, n: int
) -> NDArray[np.int64]:
    """Rows in the order of the species of the case, and by id within each."""
    count = len(found.rows)
    if count != n:
        raise InputError(f"has {counted(count, 'disk')}: must be {n}, the sum of the species' numbers")
    given = next((each for each in KINDS[kind] if each in number), None)
    which = np.zeros(n, dtype=np.int64)
    if given is None and len(species) > 1:
        raise InputError(
            f"has no column {' or '.join(KINDS[kind])}, by which disks belong to {len(species)} species"
        )
    if given is not None and (len(species) > 1 or kind == "LAMMPS"):
        texts = [row[number[given]] for _, row in found.rows]
        names = [*dict.fromkeys(texts)]
        of = {"_".join(name.split()): i for i, (name, _) in enumerate(species)}
        if all(each.isdigit() for each in names):
            of |= {str(i + 1): i for i in range(len(species))}
        if unknown := [each for each in names if each not in of]:
            ours = ", ".join(f"{i + 1} or {name}" for i, (name, _) in enumerate(species))
            raise InputError(f"{given} {cut(unknown[0])}: is no species of the case; these are {ours}")
        which = np.array([of[each] for each in texts])
        there = np.bincount(which, minlength=len(species)).tolist()
        problems = [
            f"has {there[i]} disks of {given} {i + 1 if kind == 'LAMMPS' else name}: must be {size}, the number of species[{i}], {name}"
            for i, (name, size) in enumerate(species)
            if there[i] != size
        ]
        if problems:
            raise InputError("\n".join(problems))
    ids = _column(found, number["id"], "id") if "id" in number else np.arange(float(n))
    values, counts = np.unique(ids, return_counts=True)
    if len(values) < n:
        raise InputError(f"id {values[counts > 1][0]:g}: is given twice")
    return np.lexsort((ids, which))


def _check_box(found: _Frame, box: Box, form: TableFormat) -> None:
    """Raise InputError if the box of the file has other sides than that of the case."""
    if found.sides is None:
        return
    factors = [
        UNITS["length"].get(unit, number_of(unit) or 1.0) if (unit := form.units.get(each)) else 1.0
        for each in "xy"
    ]
    sides = [side * factor for side, factor in zip(found.sides, factors, strict=True)]
    if any(not math.isclose(a, b, rel_tol=SAME_SIDE) for a, b in zip(sides, box.lengths, strict=True)):
        theirs, ours = (" x ".join(f"{each:.6g}" for each in one) for one in (sides, box.lengths))
        raise InputError(f"its box is {theirs}: must be that of the case, {ours}; box.lengths sets it")
