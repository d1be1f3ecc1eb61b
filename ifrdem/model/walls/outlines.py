"""Outlines: the points of polylines and polygons, from lists, CSV files and paths of SVG drawings.

Of SVG paths all commands are known: M, L, H, V, Z, C, S, Q, T and A, and their relative forms. Curves become straight
pieces that are nowhere further from them than a tolerance:

- a Bezier curve B(u), 0 <= u <= 1, with |B''| <= M lies within M h^2 / 8 of its chords over steps h of u; M is 6
  (cubic) or 2 (quadratic) times the largest second difference of its control points;
- a chord of an elliptic arc over the angle a, larger radius r, is within r (1 - cos(a / 2)) of it.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, cut, shortened
from ...kernels.columns import MOST_WALLS
from ...tools import checked, text_file
from ...tools.checked import Array

MOST_BYTES = 10_000_000
"""Largest file of an outline."""
TOLERANCE = 1e-4
"""Of curves, as a part of the larger side of the rectangle around the points of a path, where none is given."""
_FLAG = re.compile(r"[\s,]*([01])")
_NUMBER = re.compile(r"[\s,]*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_NUMBERS = {"M": 2, "L": 2, "H": 1, "V": 1, "Z": 0, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}
FLAT = 1e-12
"""Area of a polygon over that of the square of its perimeter, below which it encloses nothing: rounding of the area."""
AT_ONCE = 2_000_000
"""Largest number of pairs of sides that are checked together."""


def checked_points(name: str, points: Any, *, closed: bool) -> tuple[tuple[float, float], ...]:
    """Points as pairs of finite numbers; a polygon's last one is dropped where it is the first again.

    InputError if they are too few or too large, two that follow each other are the same, or sides of a polygon cross,
    double back or enclose no area.
    """
    if not isinstance(points, Sequence | np.ndarray) or isinstance(points, str):
        raise InputError(f"{name}, points = {shortened(points)}: must be a list of points [x, y]")
    found = [checked.PAIR(f"{name}, points[{i}]", point) for i, point in enumerate(points)]
    if closed and len(found) > 1 and found[0] == found[-1]:
        del found[-1]
    least = 3 if closed else 2
    if len(found) < least:
        raise InputError(f"{name}, points: {len(found)} of them: must be {least} or more")
    around = [*found, found[0]] if closed else found
    for i, (one, other) in enumerate(itertools.pairwise(around)):
        if one == other:
            raise InputError(
                f"{name}, points[{i}] and points[{(i + 1) % len(found)}] are both ({one[0]:.6g}, {one[1]:.6g}): a side "
                "between them has no length"
            )
    if not closed:
        return tuple(found)
    corners = np.array(around)
    after = np.diff(corners, axis=0)
    before = np.roll(after, 1, axis=0)
    back = (before[:, 0] * after[:, 1] == before[:, 1] * after[:, 0]) & (np.sum(before * after, axis=1) < 0.0)
    if back.any():
        j = int(np.argmax(np.roll(back, -1)) + 1) % len(found)  # the first after the beginning
        raise InputError(
            f"{name}, points[{j}] = ({found[j][0]:.6g}, {found[j][1]:.6g}): the outline doubles back there"
        )
    if crossing := first_crossing(corners):
        i, j = crossing
        raise InputError(
            f"{name}, points: the sides from points[{i}] and from points[{j}] cross; a polygon must not cross itself"
        )
    x, y = (corners - corners[0]).T
    around_it = float(np.hypot(*np.diff(corners, axis=0).T).sum())
    if abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))) <= FLAT * around_it**2:
        raise InputError(f"{name}, points: they enclose no area (nearly all on one line); take a polyline")
    return tuple(found)


def given(
    name: str, points: Any, scale: float = 1.0, tolerance: float | None = None, *, closed: bool
) -> Sequence[tuple[float, float]]:
    """Points as they are given, or those of a file: x and y in each line of a text, or an SVG drawing (.svg).

    InputError if the file cannot be read, or a polygon's outline does not come back to where it begins.

    Parameters
    ----------
    scale : float
        The length of a unit of the file [length].
    tolerance : float, optional
        Of the curves of a drawing [length]; see `of_path`.
    """
    unit = checked.POSITIVE(f"{name}, scale", scale)
    if not isinstance(points, str | os.PathLike):
        if unit != 1.0:
            raise InputError(f"{name}, scale = {scale}: only a file has it; points are lengths")
        return points
    points = checked.path(f"{name}, points", points)
    if points.suffix.lower() == ".svg":
        found, ends = of_svg(points, None if tolerance is None else tolerance / unit)
    else:
        found, ends = of_csv(points), False
    return outline(str(points), [(unit * x, unit * y) for x, y in found], ends, closed=closed)


def outline(
    name: str, found: list[tuple[float, float]], ends: bool, *, closed: bool
) -> list[tuple[float, float]]:
    """Points of a polyline or of a polygon, which must return to its beginning: `ends` if a path does by Z."""
    ends = ends or found[0] == found[-1]
    if closed and not ends:
        (x, y), (u, v) = found[0], found[-1]
        raise InputError(
            f"{name}: it begins at ({x:.6g}, {y:.6g}) and ends at ({u:.6g}, {v:.6g}): a polygon must come back to its "
            "beginning (in a path by Z, in a text file by the first point once more); or take a polyline"
        )
    return [*found, found[0]] if ends and not closed and found[0] != found[-1] else found


def first_crossing(corners: Array) -> tuple[int, int] | None:
    """Two sides of a closed polygon that cross or touch, though they do not follow each other; None if there are
    none."""
    a, b = corners[:-1], corners[1:]
    n = len(a)

    def left(p: Array, q: Array, r: Array) -> Array:
        return np.sign(
            (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
            - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
        )

    def on(p: Array, q: Array, r: Array) -> Any:
        return np.all((np.minimum(p, q) <= r) & (r <= np.maximum(p, q)), axis=-1)

    part = max(1, AT_ONCE // n)
    for first in range(0, n, part):
        i = np.arange(first, min(first + part, n))
        p, q = a[i, None], b[i, None]
        s_1, s_2, s_3, s_4 = left(p, q, a), left(p, q, b), left(a, b, p), left(a, b, q)
        crosses = (s_1 * s_2 < 0) & (s_3 * s_4 < 0)
        crosses |= ((s_1 == 0) & on(p, q, a)) | ((s_2 == 0) & on(p, q, b))
        apart = (np.arange(n) - i[:, None]) % n
        crosses &= (apart > 1) & (apart < n - 1)
        if crosses.any():
            k, j = (int(each[0]) for each in np.nonzero(crosses))
            return min(int(i[k]), j), max(int(i[k]), j)
    return None


def of_csv(path: str | os.PathLike[str]) -> list[tuple[float, float]]:
    """Points of a text file: x and y in each line, with a comma, semicolon or blanks between; # begins a comment.

    InputError names file and line.
    """
    found: list[tuple[float, float]] = []
    for number, line in enumerate(_text(path).splitlines(), start=1):
        line = line.split("#")[0].strip()
        parts = [each for each in re.split(r"[\s,;]+", line) if each]
        if not parts:
            continue
        try:
            x, y = (float(each) for each in parts)
        except ValueError:
            if not found and len(parts) == 2 and not any(re.match(r"[-+.\d]", each) for each in parts):
                continue  # names of columns
            raise InputError(f"{path}, line {number} = {cut(line)!r}: must be two numbers, x and y") from None
        if not (math.isfinite(x) and math.isfinite(y)):
            raise InputError(f"{path}, line {number} = {cut(line)!r}: must be finite numbers")
        found.append((x, y))
    if not found:
        raise InputError(f"{path}: no points are in it")
    return found


def of_svg(
    path: str | os.PathLike[str], tolerance: float | None = None
) -> tuple[list[tuple[float, float]], bool]:
    """Points of the one path of an SVG drawing, y upwards from the lower edge of its view box; and if it is closed.

    InputError if there is not exactly one path, or something moves it (transform).
    """
    try:
        root = ET.fromstring(_text(path))
    except (ET.ParseError, ValueError) as error:  # ValueError: of a declared encoding that Python lacks
        raise InputError(f"{path}: no SVG drawing ({error})") from None
    elements = list(root.iter())
    paths = [each for each in elements if each.tag.rpartition("}")[2] == "path"]
    if len(paths) != 1:
        raise InputError(f"{path} has {len(paths)} paths: must have exactly one")
    if moved := [each.tag.rpartition("}")[2] for each in elements if "transform" in each.attrib]:
        raise InputError(
            f"{path}: the transform of <{moved[0]}> is not supported; apply it to the path in the drawing"
        )
    try:
        box = [float(each) for each in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if each]
    except ValueError:
        box = []
    if len(box) != 4:
        raise InputError(f"{path}: must have a viewBox of four numbers, which says where y = 0 is")
    points, closed = of_path(paths[0].get("d", ""), tolerance, str(path))
    return [(x - box[0], box[1] + box[3] - y) for x, y in points], closed


def of_path(
    data: str, tolerance: float | None = None, name: str = "path"
) -> tuple[list[tuple[float, float]], bool]:
    """Points of the data of an SVG path, as they stand there; and if it ends with Z.

    InputError names what is not understood, and where.
    """
    commands = _commands(data, name)
    if tolerance is not None:
        checked.POSITIVE(f"{name}, tolerance", tolerance)
    else:
        ends = np.array([args[-2:] for command, args in commands if len(args) >= 2] or [[0.0, 0.0]])
        tolerance = TOLERANCE * (float(np.ptp(ends, axis=0).max()) or 1.0)
    points: list[tuple[float, float]] = []
    x = y = 0.0
    last, handle = "", (0.0, 0.0)  # the command before, and the control point next to its end
    closed = False
    for command, args in commands:
        if closed or (command in "Mm" and points):
            raise InputError(f"{name}: it has several parts; give each a wall of its own")
        if command in "Hh":
            args = [args[0], y if command == "H" else 0.0]
        elif command in "Vv":
            args = [x if command == "V" else 0.0, args[0]]
        if command.islower():
            others = 5 if command == "a" else 0  # numbers that are no places
            args = args[:others] + [each + (x, y)[i % 2] for i, each in enumerate(args[others:])]
        match command.upper():
            case "M" | "L" | "H" | "V":
                new = [(args[0], args[1])]
            case "C" | "S" | "Q" | "T":
                if command in "SsTt":  # a smooth continuation: the mirror image of the previous handle
                    smooth = last in ("CS" if command in "Ss" else "QT")
                    args = [*((2.0 * x - handle[0], 2.0 * y - handle[1]) if smooth else (x, y)), *args]
                handle = (args[-4], args[-3])
                new = _bezier(np.array([x, y, *args]).reshape(-1, 2), tolerance, name)
            case "A":
                new = _arc((x, y), args, tolerance, name)
            case _:
                closed, new = True, []
        points += new
        last = command.upper()
        if new:
            x, y = new[-1]
    if closed and len(points) > 1 and points[0] == points[-1]:
        del points[-1]
    return [point for i, point in enumerate(points) if i == 0 or point != points[i - 1]], closed


def _text(path: str | os.PathLike[str]) -> str:
    try:
        return text_file.read(Path(path), most=MOST_BYTES, bom=True)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _commands(data: str, name: str) -> list[tuple[str, list[float]]]:
    """Commands of a path, each with its numbers; what follows M counts as L."""
    found: list[tuple[str, list[float]]] = []
    command, at = "", 0
    while at < len(data):
        if data[at].isspace() or data[at] == ",":
            at += 1
            continue
        letter, here = data[at], f"{data[at : at + 12]!r} at character {at + 1}"
        if letter.isascii() and letter.isalpha():
            if letter.upper() not in _NUMBERS:
                raise InputError(
                    f"{name}: command {letter!r} at character {at + 1} is not known: must be one of "
                    f"{', '.join(_NUMBERS)} and their small letters"
                )
            command, at = letter, at + 1
        elif command in ("Z", "z"):
            raise InputError(f"{name}: {here}: Z takes no numbers")
        if not found and command not in ("M", "m"):
            raise InputError(f"{name}: {here}: a path begins with M and a point")
        numbers: list[float] = []
        for i in range(_NUMBERS[command.upper()]):
            read = (_FLAG if command in "Aa" and i in (3, 4) else _NUMBER).match(data, at)
            if read is None:
                needed = f"{command!r} takes {_NUMBERS[command.upper()]} numbers"
                raise InputError(f"{name}: {data[at : at + 12]!r} at character {at + 1}: {needed}")
            numbers.append(float(read[1]))
            at = read.end()
        if not all(map(math.isfinite, numbers)):
            raise InputError(f"{name}: a number before character {at + 1} is not finite")
        found.append((command, numbers))
        command = {"M": "L", "m": "l"}.get(command, command)
    if not found:
        raise InputError(f"{name} = {cut(data)!r}: a path begins with M and a point")
    return found


def _pieces(count: float, tolerance: float, name: str) -> int:
    """A number of pieces of a curve, as a whole one; InputError if there are too many."""
    if not count <= MOST_WALLS:
        raise InputError(
            f"{name}, tolerance = {tolerance:g}: a curve in {count:.3g} pieces; at most {MOST_WALLS} are allowed, take "
            "a larger tolerance or smaller curves"
        )
    return max(1, math.ceil(count))


def _bezier(control: Array, tolerance: float, name: str) -> list[tuple[float, float]]:
    """Points of a Bezier curve after its first one."""
    degree = len(control) - 1
    second = np.abs(np.diff(control, n=2, axis=0))
    bend = degree * (degree - 1) * float(np.hypot(*second.T).max())
    pieces = _pieces(math.sqrt(bend / (8.0 * tolerance)), tolerance, name)
    u = np.arange(1, pieces + 1)[:, None] / pieces
    powers = [math.comb(degree, i) * u**i * (1.0 - u) ** (degree - i) for i in range(degree + 1)]
    points: Array = np.sum([power * point for power, point in zip(powers, control, strict=True)], axis=0)
    points[-1] = control[-1]
    return [(float(x), float(y)) for x, y in points]


def _arc(
    start: tuple[float, float], args: list[float], tolerance: float, name: str
) -> list[tuple[float, float]]:
    """Points of an elliptic arc after its first one: SVG 2, appendix B.2.4, from its ends to its centre."""
    r_x, r_y, tilt, large, sweep, *end = args
    r_x, r_y = abs(r_x), abs(r_y)
    if (r_x == 0.0 or r_y == 0.0) or tuple(end) == start:
        raise InputError(f"{name}: an arc (A) without length or radius")
    phi = math.radians(tilt)
    turn = np.array([[math.cos(phi), math.sin(phi)], [-math.sin(phi), math.cos(phi)]])
    p = turn @ (0.5 * np.subtract(start, end))
    with np.errstate(over="ignore"):
        scale = (p[0] / r_x) ** 2 + (p[1] / r_y) ** 2
    if not 1e-20 < scale < 1e20:
        raise InputError(
            f"{name}: an arc (A) with radii {r_x:g} and {r_y:g} between ends that are {2.0 * float(np.hypot(*p)):.3g} "
            "apart; they may differ by a factor 1e10 (a line is L)"
        )
    if scale > 1.0:  # too small radii are enlarged until the ends can be reached
        r_x, r_y = r_x * math.sqrt(scale), r_y * math.sqrt(scale)
        scale = 1.0
    root = math.sqrt(max(0.0, 1.0 / scale - 1.0)) * (1.0 if large != sweep else -1.0)
    center = root * np.array([r_x * p[1] / r_y, -r_y * p[0] / r_x])
    begin = math.atan2((p[1] - center[1]) / r_y, (p[0] - center[0]) / r_x)
    angle = math.atan2((-p[1] - center[1]) / r_y, (-p[0] - center[0]) / r_x) - begin
    if sweep and angle < 0.0:
        angle += 2.0 * math.pi
    elif not sweep and angle > 0.0:
        angle -= 2.0 * math.pi
    # A chord of the angle h has the sagitta r (1 - cos(h / 2)) = 2 r sin^2(h / 4).
    step = 4.0 * math.asin(math.sqrt(0.5 * min(1.0, tolerance / max(r_x, r_y))))
    pieces = _pieces(abs(angle) / step, tolerance, name)
    u = begin + angle * np.arange(1, pieces + 1) / pieces
    points = (center + np.column_stack((r_x * np.cos(u), r_y * np.sin(u)))) @ turn + 0.5 * np.add(start, end)
    points[-1] = end
    return [(float(x), float(y)) for x, y in points]
