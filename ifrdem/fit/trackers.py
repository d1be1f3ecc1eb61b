"""Files of tracking programs as tables of tracks: one line a disk and frame, with columns id, x, y, and t or frame.

TrackMate (spots as CSV): four lines of header, of which the first has names and the last units; TRACK_ID is the disk.
DeepLabCut (CSV): three lines of header, scorer, bodyparts and coords, or four with individuals; a column x, y and
likelihood for each part. Tracker (physlets.org): the names of masses, then t, x, y of each side by side. OpenPTV
(ptv_is.N): a file for each frame, a line of the number of disks, then previous and next row, x, y, z [mm]. Trackpy
(CSV by pandas): one line of header; tables from which short tracks were removed (filter_stubs) have the frame twice,
as index and as column.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, refuse
from ..tools import text_file
from ..tools.checked import number_of
from ..tools.tables import MOST_BYTES

LEAST_LIKELIHOOD = 0.6
"""Likelihood of a position of DeepLabCut below which it counts as missing, that program's own limit."""

_TRACKMATE = {
    "TRACK_ID": "id",
    "POSITION_X": "x",
    "POSITION_Y": "y",
    "POSITION_T": "t",
    "FRAME": "frame",
    "ID": "spot",
    "LABEL": "name",
    "POSITION_Z": "z",
}
_FRAME = re.compile(r"ptv_is\.\d+")
_NO_UNITS = ("(pixel)", "(quality)")


@dataclass(frozen=True)
class Converted:
    """A file as a table of tracks."""

    program: str
    text: str
    note: str  # what was made of it


def converted(path: Path) -> Converted | None:
    """The table of a file, or of a folder of files, of a tracking program; None of another one.

    Raises InputError with a line for each value that is no number.
    """
    if path.is_dir():
        files = [each for each in path.glob("ptv_is.*") if _FRAME.fullmatch(each.name)]
        return _openptv(path, sorted(files, key=lambda each: int(each.suffix[1:]))) if files else None
    if _FRAME.fullmatch(path.name):
        raise InputError(f"{path}: is one frame of OpenPTV; give the folder of all ptv_is files")
    lines = [line.rstrip("\r\n") for line in _head(path)]
    if not lines:
        return None
    cells = [[text.strip().strip('"') for text in line.split(",")] for line in lines]
    if {"TRACK_ID", "POSITION_X", "POSITION_Y"} <= {*cells[0]} and len(lines) > 3:
        return _trackmate(path, cells)
    if cells[0][0] == "scorer" and len(lines) > 3:
        return _deeplabcut(path)
    if cells[0][0] == "frame" and {"frame", "particle"} <= {*cells[0][1:]}:
        return _trackpy(path)
    titled = len(lines) > 2 and not lines[0].startswith("#") and not _is_tracker(lines[0])
    if lines[0].startswith("#multi:") or (titled and _is_tracker(lines[1])):
        return _tracker(path)
    return None


def _head(path: Path) -> list[str]:
    """The first lines of a file."""
    found = []
    for line in text_file.lines(path, most=MOST_BYTES):
        found.append(line)
        if len(found) == 6:
            break
    return found


def _rows(path: Path) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text_file.lines(path, most=MOST_BYTES), start=1):
        if line.strip():
            yield number, line.rstrip("\r\n")


def _is_tracker(line: str) -> bool:
    names = [text.strip() for text in re.split(r"[\t,;]", line) if text.strip()]
    return len(names) >= 3 and names[0] == "t" and {"x", "y"} <= {*names} and "id" not in names


def _number(text: str) -> str | None:
    """A number as text, empty for a missing one; None if it is neither."""
    text = text.strip()
    return "" if text.lower() in ("", "nan") else text if number_of(text) is not None else None


def _table(
    path: Path, program: str, header: str, rows: Sequence[str], problems: Sequence[str], note: str
) -> Converted:
    refuse(problems, path, most=5)
    return Converted(program, "\n".join((header, *rows)) + "\n", note)


def _trackmate(path: Path, cells: Sequence[Sequence[str]]) -> Converted:
    """Lines with the names of columns that tracks have; lines below the header are left out."""
    names = [_TRACKMATE.get(name, name) for name in cells[0]]
    below = 1
    while below < len(cells) and all(number_of(text) is None for text in cells[below] if text):
        below += 1
    units = cells[below - 1] if below > 1 else [""] * len(names)
    header = [
        f"{name} {unit}"
        if unit.startswith("(") and name in ("x", "y", "t") and unit not in _NO_UNITS
        else name
        for name, unit in zip(names, units, strict=False)
    ]
    lines = ["" if 1 < number <= below else line for number, line in _rows(path)]
    used = "TRACK_ID as id, POSITION_X and POSITION_Y as x and y, POSITION_T as t"
    return Converted("TrackMate", "\n".join((",".join(header), *lines[1:])) + "\n", used)


def _trackpy(path: Path) -> Converted:
    """A table without its index."""
    rows = [line.partition(",")[2] for _, line in _rows(path)]
    return Converted("Trackpy", "\n".join(rows) + "\n", "its index repeats the column frame, and is not used")


def _deeplabcut(path: Path) -> Converted:
    """Each part of each individual is a disk, numbered from 0 in the order of the columns."""
    head: dict[str, list[str]] = {}
    rows, problems, ids = list[str](), list[str](), dict[tuple[str, ...], int]()
    for number, line in _rows(path):
        cells = [text.strip() for text in line.split(",")]
        if "coords" not in head:
            head[cells[0]] = cells
            continue
        coords = head["coords"]
        values: dict[int, dict[str, str]] = {}
        for i in range(1, min(len(cells), *(len(each) for each in head.values()))):
            part = tuple(head[name][i] for name in ("individuals", "bodyparts") if name in head)
            one = ids.setdefault(part, len(ids))
            if (text := _number(cells[i])) is None:
                problems.append(
                    f"line {number}: {coords[i]} of {' '.join(part)} = {cells[i]}: must be a number"
                )
            values.setdefault(one, {})[coords[i]] = text or ""
        for one, each in values.items():
            unsure = float(each.get("likelihood") or 1.0) < LEAST_LIKELIHOOD
            x, y = ("", "") if unsure else (each.get("x", ""), each.get("y", ""))
            rows.append(f"{cells[0]},{one},{x},{y}")
    named = ", ".join(f"{one} {' '.join(part)}" for part, one in list(ids.items())[:8]) + ", ..." * (
        len(ids) > 8
    )
    note = f"positions in pixels; of likelihood below {LEAST_LIKELIHOOD:g} none; ids: {named}"
    return _table(path, "DeepLabCut", "frame,id,x,y", rows, problems, note)


def _tracker(path: Path) -> Converted:
    """Masses side by side, or one; a name stands over the first column of its mass."""
    lines = [each for each in _rows(path) if not each[1].startswith("#multi:")]
    sign = next((mark for mark in ("\t", ";", ",") if len(lines) > 2 and mark in lines[1][1]), None)
    if sign is None:
        raise InputError(
            f"{path}: is a file of Tracker without values: must have names of masses, of columns, and values"
        )
    names = lines[0][1].split(sign)
    columns = [text.strip() for text in lines[1][1].split(sign)]
    masses: list[dict[str, int]] = []
    titles: list[str] = []
    title, time = "", 0
    for i, column in enumerate(columns):
        title = names[i].strip() if i < len(names) and names[i].strip() else title
        if column == "t":
            time = i
        elif column == "x":
            masses.append({"t": time, "x": i})
            titles.append(title or f"mass {len(masses)}")
        elif masses and column:
            masses[-1].setdefault(column, i)
    rows, problems = list[str](), list[str]()
    for number, line in lines[2:]:
        cells = line.split(sign)
        for one, mass in enumerate(masses):
            found = []
            for name in ("t", "x", "y"):
                at = mass.get(name, len(cells))
                cell = cells[at] if at < len(cells) else ""
                text = _number(cell if sign == "," else cell.replace(",", "."))  # by the language of its user
                if text is None:
                    problems.append(f"line {number}: {name} of {titles[one]} = {cells[at]}: must be a number")
                found.append(text or "")
            rows.append(f"{found[0]},{one},{found[1]},{found[2]}")
    named = ", ".join(f"{i} {title}" for i, title in enumerate(titles))
    note = f"lengths and times in the units of its calibration; ids: {named}"
    return _table(path, "Tracker", "t,id,x,y", rows, problems, note)


def _openptv(path: Path, files: Sequence[Path]) -> Converted:
    """Disks are linked from frame to frame by the row in the frame before."""
    rows, problems = list[str](), list[str]()
    before: list[int] = []
    number = 0
    for file in files:
        frame = int(file.suffix[1:])
        now: list[int] = []
        for at, line in list(_rows(file))[1:]:
            cells = line.split()
            if len(cells) < 4 or any(_number(text) in (None, "") for text in cells[:4]):
                problems.append(f"{file.name}, line {at}: must be previous and next row, x, y, z")
                now.append(-1)
                continue
            previous = int(float(cells[0]))
            if 0 <= previous < len(before):
                one = before[previous]
            else:
                one, number = number, number + 1
            now.append(one)
            rows.append(f"{frame},{one},{cells[2]},{cells[3]}")
        before = now
    note = (
        f"{len(files)} frames; x and y in mm, z is not used; a disk that was lost has another id afterwards"
    )
    return _table(path, "OpenPTV", "frame,id,x (mm),y (mm)", rows, problems, note)
