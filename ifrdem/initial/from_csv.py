"""Start files: positions, and velocities if wished, of every disk as CSV."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, listed, nearest
from ..model.box import Box
from ..model.walls.wall import Wall, at_displacements
from ..mpi import current
from ..quantities import FIELDS
from ..tools import tables, text_file
from ..tools.checked import Array
from ..tools.tables import TableFormat
from . import other_formats

POSITION = ("x", "y")
MOTION = ("vx", "vy", "spin")
KINDS = {
    **dict.fromkeys(POSITION, "length"),
    **dict.fromkeys(MOTION[:2], "velocity"),
    "spin": "spin",
    "id": "number",
}
EXPORTED = {
    "x": "position_x", "y": "position_y", "vx": "velocity_x", "vy": "velocity_y", "spin": "angular_velocity"
}  # fmt: skip
"""Names of the columns in the CSV of `ifrdem export`."""
MOST_BYTES = 1_000_000_000  # the start of some 10 million disks
MOST_REPORTED = 5  # wrong lines that are listed one by one


@dataclass(frozen=True, eq=False)
class StartData:
    """A start of n disks that a file gives; of ranks, each has the rows of its slice."""

    position: Array  # centres [length], inside the box, shape (n, 2)
    velocity: Array | None  # in the lab [length/time], (n, 2), if given
    spin: Array | None  # counter-clockwise [rad/time], (n,), if given
    # Standard errors of columns, if they are given, (n,).
    errors: Mapping[str, Array] = field(default_factory=dict)
    time: float = 0.0  # of the run's clock [time]
    collisions: int = 0  # of all disks until then, each of two disks
    # What else a frame has of the disks, by its name in `State`, (n, ...).
    past: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    # Displacement [length] and velocity [length/time] of each piston, (pistons, 2), if given.
    pistons: Array | None = None

    def with_pistons(self, walls: Sequence[Wall]) -> tuple[Wall, ...]:
        """The walls with their pistons at the start; unchanged if the file has another number of pistons."""
        if self.pistons is None or len(self.pistons) != sum(wall.piston is not None for wall in walls):
            return tuple(walls)
        return at_displacements(walls, *self.pistons.T.tolist())


def read(
    path: Path,
    n: int,
    box: Box | None = None,
    form: TableFormat | None = None,
    *,
    species: other_formats.Species = (),
    frame: int | None = None,
    units: str = "",
) -> StartData:
    """Read a start file: CSV, or a frame of a dump of LAMMPS or of extended XYZ (`other_formats`).

    The first line names the columns: x and y [length], and either all or none of vx, vy [length/time] and spin
    [rad/time], in any order, each with a column NAME_error if wished; units in brackets, such as x (mm), are
    converted to SI units. Rows are in the order of the species; a column id must be 0, 1, 2, ... The CSV of
    `ifrdem export` of one frame is such a file, except of a sheared box: its names (`EXPORTED`) are understood, and its
    other columns skipped. `form` gives names, units and signs of the file if they differ. Empty lines, and
    lines that begin with #, are skipped. InputError with a line for each thing that is wrong: a column, a value (by
    line and column), the number of disks.

    `species` are names and numbers of the species, `frame` the number of a frame, -1 (the last) without it, and `units`
    those of the case; CSV needs none of these.

    There must be `n` disks, in the `box` (lower sides included), if there is one. Of ranks of MPI, each reads all
    lines, and keeps the values of its slice (`Communicator`); all raise the same.
    """
    head = [line for line, _ in zip(text_file.lines(path, most=MOST_BYTES), range(2), strict=False)]
    kind = other_formats.format_of(head)
    if not kind and frame is not None:
        raise InputError(
            f"frame = {frame}: is of dumps of LAMMPS, extended XYZ and trajectories; this is CSV"
        )
    try:
        if kind:
            table = other_formats.read(
                path, kind, n, species or [("", n)], box, form or TableFormat(),
                frame=-1 if frame is None else frame, most=MOST_BYTES, units=units,
            )  # fmt: skip
        else:
            table = tables.read(
                path, KINDS, {tables.plain(key): name for name in KINDS for key in (name, EXPORTED.get(name, name))},
                form or TableFormat(), most=MOST_BYTES, most_problems=MOST_REPORTED, gaps=False, n=n, setting=_key,
            )  # fmt: skip
    except InputError as error:
        lines = [line.removeprefix(f"{path}: ") for line in str(error).splitlines()]
        raise InputError("\n".join(lines)) from None
    from ..trajectory.export import CSV_KEYS, csv_names  # imports h5py

    comm, columns = current(), table.columns
    names = [name for name in columns if not name.endswith("_error")]
    unused = table.unused
    if set(CSV_KEYS) <= {*unused, *names}:
        if box is not None and box.shear_rate:
            raise InputError(
                f"columns {', '.join(CSV_KEYS)}: a frame of `ifrdem export` cannot start a sheared box, in which the "
                "images above and below have moved on since t = 0"
            )
        unused = tuple(name for name in unused if name not in (*CSV_KEYS, *csv_names(FIELDS)))
    problems = _column_problems(names, () if form is not None and form.columns else unused)
    if problems:
        raise InputError("\n".join(problems))
    position = np.column_stack([columns[axis] for axis in POSITION])
    bad = {name: ~np.isfinite(values) for name, values in columns.items()}
    inside = dict[str, str]()
    if box is not None and not box.is_open:
        for axis, side in zip(POSITION, box.lengths, strict=True):
            inside[axis] = f"must lie inside the box, from 0 to below {side:.6g}"
            bad[axis] |= (columns[axis] < 0.0) | (columns[axis] >= side)
    expected = comm.slice_of(n).start + np.arange(len(table))
    if "id" in columns and table.rows == n:
        bad["id"] |= columns["id"] != expected
    rows = np.flatnonzero(np.any(list(bad.values()), axis=0))
    texts = [
        f"line {table.line[i]}: {name} = {value:g}: "
        + (
            "must be a finite number"
            if not math.isfinite(value)
            else f"must be {expected[i]}: rows are in the order of the species"
            if name == "id"
            else inside[name]
        )
        for i in rows[:MOST_REPORTED]
        for name, value in ((name, columns[name][i]) for name in columns if bad[name][i])
    ]
    texts, count = comm.first_texts(texts, sum(map(np.count_nonzero, bad.values())), MOST_REPORTED)
    problems = listed(texts, MOST_REPORTED, count).splitlines()
    if table.rows != n:
        more = "; `ifrdem export` writes one frame with --frames=-1" if "id" in columns else ""
        problems.append(
            f"has {table.rows} disks: must be {n}, the sum of the species' numbers, in the order of the species{more}"
        )
    if problems:
        raise InputError("\n".join(problems))
    moving = set(MOTION) <= set(names)
    return StartData(
        position=position,
        velocity=np.column_stack([columns[key] for key in MOTION[:2]]) if moving else None,
        spin=columns[MOTION[2]] if moving else None,
        errors={name: value for name, value in columns.items() if name.endswith("_error")},
    )


def _key(key: str, value: str, name: str) -> str:
    """Text that sets a key of the format to a value in a case, of `columns` for a name."""
    return f'start.{key} = {{{name} = "{value}"}}' if name else f"start.{key} = {json.dumps(value)}"


def _column_problems(names: list[str], unused: tuple[str, ...]) -> list[str]:
    allowed = tuple(KINDS)
    problems = [
        f"unknown column '{name}'{nearest(name, allowed)}; there are {', '.join(allowed)}" for name in unused
    ]
    missing = [name for name in POSITION if name not in names]
    given = [name for name in MOTION if name in names]
    if given and len(given) < len(MOTION):
        missing += [name for name in MOTION if name not in names]
    if missing:
        problems.append(
            f"missing column {', '.join(missing)}; there are {', '.join(names) or 'none that is known'}"
        )
    return problems
