"""Start files: positions, and velocities if wished, of every disk as CSV."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError, nearest
from ..model.box import Box
from ..tools import csv as csv_rows
from ..tools.checked import Array

POSITION = ("x", "y")
MOTION = ("vx", "vy", "spin")
MOST_BYTES = 1_000_000_000  # the start of some 10 million disks
MOST_REPORTED = 5  # wrong lines that are listed one by one


@dataclass(frozen=True, eq=False)
class Given:
    """A start of n disks that a file gives."""

    position: Array  # centres [length], inside the box, shape (n, 2)
    velocity: Array | None  # in the lab [length/time], (n, 2), if given
    spin: Array | None  # counter-clockwise [rad/time], (n,), if given


def read(path: Path, n: int, box: Box | None = None) -> Given:
    """Read a start file.

    The first line names the columns: x and y [length], and either all or none of vx, vy [length/time] and spin
    [rad/time], in any order, separated by commas. Empty lines, and lines that begin with #, are skipped. InputError
    with a line for each thing that is wrong: a column, a value (by line and column), the number of disks.

    There must be `n` disks, in the `box` (lower sides included), if there is one.
    """
    rows, lines = csv_rows.read(path, most=MOST_BYTES)
    if not rows:
        raise InputError("is empty: a first line with the names of the columns is needed, such as x,y")
    names = [name.strip() for name in rows[0]]
    if all(csv_rows.is_number(name) for name in names):
        raise InputError(
            f"line {lines[0]}: there is no header: the first line must name the columns, such as "
            f"{','.join(POSITION)} or {','.join(POSITION + MOTION)}, and here it holds numbers"
        )
    wrong = _wrong_columns(names)
    if wrong:
        raise InputError("\n".join(wrong))
    found: list[str] = []
    values = np.zeros((len(rows) - 1, len(names)))
    for i, (row, line) in enumerate(zip(rows[1:], lines[1:], strict=True)):
        if len(row) != len(names):
            found.append(f"line {line} has {len(row)} values: {len(names)} are needed ({', '.join(names)})")
            continue
        for j, text in enumerate(row):
            try:
                values[i, j] = float(text)
            except ValueError:
                values[i, j] = math.nan
            if not math.isfinite(values[i, j]):
                found.append(f"line {line}: {names[j]} = {text.strip()}: a finite number is needed")
    position = np.column_stack([values[:, names.index(axis)] for axis in POSITION])
    if box is not None and not box.is_open and not found:
        outside = np.argwhere((position < 0.0) | (position >= np.array(box.lengths)))
        for i, axis in outside:
            found.append(
                f"line {lines[1 + i]}: {POSITION[axis]} = {position[i, axis]:g}: must lie inside the box, "
                f"from 0 to below {box.lengths[axis]:.6g}"
            )
    if len(found) > MOST_REPORTED:
        found[MOST_REPORTED:] = [f"{len(found) - MOST_REPORTED} more lines are wrong"]
    if len(rows) - 1 != n:
        found.append(f"has {len(rows) - 1} disks: {n} are needed, the sum of the species' numbers")
    if found:
        raise InputError("\n".join(found))
    moving = set(MOTION) <= set(names)
    return Given(
        position=position,
        velocity=np.column_stack([values[:, names.index(key)] for key in MOTION[:2]]) if moving else None,
        spin=values[:, names.index(MOTION[2])] if moving else None,
    )


def _wrong_columns(names: list[str]) -> list[str]:
    allowed = POSITION + MOTION
    wrong = []
    for name in names:
        if name not in allowed:
            wrong.append(f"unknown column '{name}'{nearest(name, allowed)}; allowed are {', '.join(allowed)}")
    missing = [name for name in POSITION if name not in names]
    given = [name for name in MOTION if name in names]
    if given and len(given) < len(MOTION):
        missing += [name for name in MOTION if name not in names]
    if missing:
        wrong.append(f"missing column {', '.join(missing)}; there are {', '.join(names)}")
    wrong += [f"column '{name}' stands twice" for name in sorted(set(names)) if names.count(name) > 1]
    return wrong
