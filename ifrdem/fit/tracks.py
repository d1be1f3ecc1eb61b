"""Collisions from tracks: impacts in positions per frame, with the flights before and after.

Two disks have met where their distance has a minimum near the sum of their radii. There, the places of both
are fitted by straight flights that meet at one time t_c,

    x(t) = x_c + v (t - t_c) before, x_c + v' (t - t_c) after,   |x_c2 - x_c1| = R_1 + R_2,

and so is, where it was tracked, the angle by which each has turned. All errors follow from the scatter of the
places about the flights; normal and velocities share x_c and t_c, so that their errors are correlated, and
the table says how.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..errors import InputError, option_name, refuse
from . import tabular
from .data import NORMAL, Disk
from .tabular import TableFormat

Array = NDArray[np.float64]
Wall = tuple[float, float, float, float]

KINDS = {"frame": "number", "t": "time", "id": "number", "x": "length", "y": "length", "angle": "angle"}
_SPELLINGS = {
    **{name: name for name in KINDS},
    **dict.fromkeys(("time", "seconds"), "t"),
    **dict.fromkeys(("disk", "particle", "track", "trackid", "particleid"), "id"),
    **dict.fromkeys(("orientation", "theta"), "angle"),
}
WINDOW = 12
"""Frames of a flight that are used at most."""

LEAST = 3
"""Frames of a flight that are needed at least."""

_CONTACT = 5e-3  # how well the sum of the radii is known, over itself
_SURE = 4.0  # errors by which the pair must separate after an impact
_MOST_DISKS = 500


@dataclass(frozen=True, eq=False)
class Tracks:
    """Positions of disks in the frames of a video."""

    time: Mapping[int, Array]  # (f,): times [time] of the frames that show a disk, by its id, ascending
    position: Mapping[int, Array]  # (f, 2): its centre [length]
    # (f,): the angle by which it has turned, counter-clockwise, unwrapped [rad]; empty if none was tracked
    angle: Mapping[int, Array]
    source: str
    missing: int = 0  # lines without a position


@dataclass(frozen=True, eq=False)
class FoundCollisions:
    """Collisions that were found."""

    # (n,): a table as `ifrdem.fit.read` takes it: t, id_1, id_2, nx, ny, velocities and spins with their errors
    # and covariances, and mass, radius and k of the disks
    columns: Mapping[str, Array]
    noise: float  # standard error of a coordinate of a position [length]
    angle_noise: float  # of an angle [rad]; NaN if none was tracked
    left_out: tuple[str, ...]  # encounters that gave no collision, and why
    bent: int  # flights that are not straight within the noise

    def __len__(self) -> int:
        """The number of collisions."""
        return len(self.columns["t"])

    def csv(self, about: str = "") -> str:
        """The table as text."""
        header = "".join(f"# {line}\n" for line in about.splitlines())
        names = list(self.columns)
        rows = np.stack([self.columns[name] for name in names], axis=-1)
        lines = (",".join("" if math.isnan(value) else f"{value:.10g}" for value in row) for row in rows)
        return header + "\n".join((",".join(names), *lines)) + "\n"


def read(path: Path | str, *, fps: float | None = None, form: TableFormat = TableFormat()) -> Tracks:  # noqa: B008  (frozen)
    """Read tracks: a line a frame and disk, with columns id, x, y, and t or frame; angle if disks were seen to turn.

    `fps`, frames per time, is needed with a column frame; `form` gives other names, units and signs of the file.

    Raises InputError with a line for each thing that is wrong.
    """
    table = tabular.read(path, KINDS, _SPELLINGS, form)
    columns, source = table.columns, table.source
    missing = [name for name in ("id", "x", "y") if name not in columns]
    if "t" not in columns and "frame" not in columns:
        missing.append("t or frame")
    problems = []
    if missing:
        problems.append(
            f"missing column {', '.join(missing)}; there are {', '.join((*columns, *table.unused))}"
        )
    if "t" not in columns and "frame" in columns and fps is None:
        problems.append(f"a column frame requires {option_name('--fps', 'fps')}, the frames per second")
    if fps is not None and not 0.0 < fps < math.inf:
        problems.append(f"fps = {fps:g}: must be a positive finite number")
    refuse(problems, source)
    times = columns["t"] if "t" in columns else columns["frame"] / float(fps or 1.0)
    ids = columns["id"]
    whole = np.all([~np.isnan(each) for each in (times, ids, columns["x"], columns["y"])], axis=0)
    bad = np.flatnonzero(whole & (ids != np.round(ids)))
    found = [f"line {table.line[i]}: id = {ids[i]:g}: must be an integer" for i in bad]
    time, position, angle = {}, {}, {}
    for one in np.unique(ids[whole]) if not found else ():
        rows = np.flatnonzero(whole & (ids == one))
        rows = rows[np.argsort(times[rows], kind="stable")]
        twice = np.flatnonzero(np.diff(times[rows]) <= 0.0)
        found += [f"line {table.line[rows[i + 1]]}: disk {one:g} has two rows at one time" for i in twice]
        time[int(one)] = times[rows]
        position[int(one)] = np.stack([columns["x"][rows], columns["y"][rows]], axis=-1)
        if "angle" in columns:
            angle[int(one)] = value = np.radians(columns["angle"][rows])
            measured = ~np.isnan(value)
            value[measured] = np.unwrap(value[measured])
    if len(time) > _MOST_DISKS:
        found.append(f"{len(time)} disks: at most {_MOST_DISKS} are looked through")
    refuse(found, source)
    return Tracks(time, position, angle, source, int(np.sum(~whole)))


def find(
    tracks: Tracks,
    disks: Mapping[int, Disk] | Disk,
    *,
    wall: Wall | None = None,
    window: int = WINDOW,
    noise: float | None = None,
) -> FoundCollisions:
    """Find the impacts of two disks, or of disks with a wall, and the motion before and after.

    Raises InputError if a disk is unknown, an option is wrong, or no impact was found.

    Parameters
    ----------
    tracks : Tracks
        What was seen.
    disks : Disk, or mapping of int to Disk
        All disks, or each by its id: mass [mass], radius [length], k.
    wall : (x_1, y_1, x_2, y_2), optional
        Two points of a straight wall [length]: its impacts are looked for instead of those of pairs.
    window : int
        Frames of a flight that are used at most.
    noise : float, optional
        Standard error of a coordinate of a position [length]; by the scatter about the flights without it.
    """
    problems = []
    if window < LEAST:
        problems.append(f"window = {window}: must be at least {LEAST} frames")
    if noise is not None and not 0.0 < noise < math.inf:
        problems.append(f"noise = {noise:g}: must be a positive finite number")
    if wall is not None and (wall[:2] == wall[2:] or not all(map(math.isfinite, wall))):
        problems.append(f"wall = {wall}: must be two different points")
    of = {one: disks if isinstance(disks, Disk) else disks.get(one) for one in tracks.time}
    problems += [f"disk {one}: its mass and radius are not given" for one, disk in of.items() if disk is None]
    refuse(problems)
    known = {one: disk for one, disk in of.items() if disk is not None}
    meetings = _encounters(tracks, known, wall)
    times_of_disks: dict[int, list[float]] = {}
    for meeting in meetings:
        for one in meeting.ids:
            times_of_disks.setdefault(one, []).append(meeting.time)
    fits, left_out = [], []
    for meeting in meetings:
        fitted = _fit(tracks, known, meeting, times_of_disks, wall, window)
        if isinstance(fitted, str):
            left_out.append(f"{meeting.about} at t = {meeting.time:.6g}: {fitted}")
        else:
            fits.append(fitted)
    if not fits:
        reason = f"; {len(left_out)} encounters were left out, the first: {left_out[0]}" if left_out else ""
        raise InputError(f"{tracks.source}: no impact was found{reason}")
    # Least squares of the scatter, with all flights together.
    sigma = noise or math.sqrt(sum(each.squares for each in fits) / max(sum(each.dof for each in fits), 1))
    if sigma < 1e-9 * min(float(np.min(disk.radius)) for disk in known.values()):
        how = option_name("--noise", "noise")
        text = f"the positions do not scatter about the flights: {how} must say how exact they are"
        raise InputError(f"{tracks.source}: {text}")
    turned = [each for each in fits if each.angle_dof > 0]
    squares, dof = sum(each.angle_squares for each in turned), sum(each.angle_dof for each in turned)
    sigma_angle = math.sqrt(squares / dof) if turned else math.nan
    rows, kept = [], []
    for each in fits:
        row = each.row(sigma, sigma_angle)
        if row is None:
            about = f"{each.meeting.about} at t = {each.time:.6g}"
            left_out.append(f"{about}: passed each other without an impact")
        else:
            rows.append(row)
            kept.append(each)
    if not rows:
        raise InputError(
            f"{tracks.source}: no impact was found; {len(left_out)} encounters changed no velocity"
        )
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: np.array([row.get(name, math.nan) for row in rows]) for name in names}
    bent = sum(each.squares > sigma**2 * (each.dof + 4.0 * math.sqrt(2.0 * each.dof)) for each in kept)
    return FoundCollisions(columns, sigma, sigma_angle, tuple(left_out), int(bent))


@dataclass(frozen=True)
class _Encounter:
    ids: tuple[int, ...]
    time: float

    @property
    def about(self) -> str:
        return f"disks {' and '.join(map(str, self.ids))}"


def _encounters(tracks: Tracks, disks: Mapping[int, Disk], wall: Wall | None) -> list[_Encounter]:
    """Minima of the distance that are near contact."""
    found = []
    ids = sorted(tracks.time)
    pairs: list[tuple[int, ...]] = (
        [(a,) for a in ids] if wall else [(a, b) for i, a in enumerate(ids) for b in ids[i + 1 :]]
    )
    for pair in pairs:
        times = tracks.time[pair[0]]
        positions = tracks.position[pair[0]]
        if wall:
            normal, offset = _wall_line(wall, positions)
            gap = np.abs(positions @ normal - offset) - float(np.asarray(disks[pair[0]].radius))
        else:
            times, i, j = np.intersect1d(times, tracks.time[pair[1]], return_indices=True)
            apart = tracks.position[pair[1]][j] - tracks.position[pair[0]][i]
            gap = np.hypot(*apart.T) - sum(float(np.asarray(disks[one].radius)) for one in pair)
        if len(times) < 2 * LEAST:
            continue
        step = np.abs(np.diff(gap))
        near = np.maximum(np.concatenate([[0.0], step]), np.concatenate([step, [0.0]]))
        scale = float(np.asarray(disks[pair[0]].radius))
        # One meeting for each stretch of frames near contact: noise makes several minima of it.
        near_contact = np.concatenate([[False], gap < 1.5 * near + 0.15 * scale, [False]])
        begin = np.flatnonzero(near_contact[1:] & ~near_contact[:-1])
        end = np.flatnonzero(near_contact[:-1] & ~near_contact[1:])
        far = begin[1:] - end[:-1] >= 2 * LEAST
        if len(begin):
            begin, end = begin[np.concatenate([[True], far])], end[np.concatenate([far, [True]])]
        for first, last in zip(begin, end, strict=True):
            k = first + int(np.argmin(gap[first:last]))
            if 0 < k < len(gap) - 1:
                found.append(_Encounter(pair, float(times[k])))
    return sorted(found, key=lambda each: each.time)


def _wall_line(wall: Sequence[float], positions: Array) -> tuple[Array, float]:
    """Unit normal from the disk to the wall, and offset of the wall along it."""
    x_1, y_1, x_2, y_2 = wall
    along = np.array([x_2 - x_1, y_2 - y_1]) / math.hypot(x_2 - x_1, y_2 - y_1)
    normal = np.array([-along[1], along[0]])
    offset = float(normal @ [x_1, y_1])
    return (normal, offset) if np.median(positions @ normal) < offset else (-normal, -offset)


@dataclass(frozen=True, eq=False)
class _Flights:
    """Flights of the disks of one meeting: t_c, then x_c, y_c, v_x, v_y, v_x', v_y' of each disk; angles apart."""

    meeting: _Encounter
    disks: tuple[Disk, ...]
    parameters: Array
    jacobian: Array
    squares: float
    dof: int
    angles: tuple[tuple[Array, Array] | None, ...]  # a_c, w, w' and (A^T A)^-1 of each disk
    angle_squares: float
    angle_dof: int
    wall: tuple[Array, float] | None

    @property
    def time(self) -> float:
        return float(self.parameters[0])

    def row(self, sigma: float, sigma_angle: float) -> dict[str, float] | None:
        """A line of the table; None where the disks passed each other, by their speeds along the normal."""
        # The constraint on the distance has its own weight, the last line of the Jacobian.
        weight = np.full(len(self.jacobian), 1.0 / sigma)
        weight[-1] = 1.0 / (_CONTACT * sum(float(np.asarray(each.radius)) for each in self.disks))
        J = self.jacobian * weight[:, None]
        size = np.sqrt(np.sum(J**2, axis=0))  # times, lengths and velocities
        covariance = np.linalg.inv((J / size).T @ (J / size)) / np.outer(size, size)
        p = self.parameters
        row: dict[str, float] = {"t": self.time}
        for i, one in enumerate(self.meeting.ids, start=1):
            row[f"id_{i}"] = one
        by: dict[str, Array] = {}  # derivatives of what is measured by the parameters
        if self.wall is None:
            dx, dy = p[7] - p[1], p[8] - p[2]
            D = math.hypot(dx, dy)
            normal = np.array([dx, dy]) / D
            by["normal"] = np.zeros(len(p))
            by["normal"][[1, 2, 7, 8]] = np.array([dy, -dx, -dy, dx]) / D**2
        else:
            normal = self.wall[0]
        approach, parting = np.zeros(len(p)), np.zeros(len(p))
        for i, sign in zip(range(len(self.disks)), (1.0, -1.0), strict=False):
            approach[3 + 6 * i : 5 + 6 * i] = sign * normal
            parting[5 + 6 * i : 7 + 6 * i] = sign * normal
        speed, sure = float(approach @ p), _SURE * math.sqrt(float(approach @ covariance @ approach))
        if not (speed > sure and float(parting @ p) < sure + 0.02 * speed):
            return None
        row |= {"nx": float(normal[0]), "ny": float(normal[1])}
        for i in range(len(self.disks)):
            for k, name in enumerate(("vx_{}", "vy_{}", "vx_{}_after", "vy_{}_after"), start=3 + 6 * i):
                by[name.format(i + 1)] = np.eye(len(p))[k]
        row |= {name: float(each @ p) for name, each in by.items() if name != "normal"}
        names, T = list(by), np.array(list(by.values()))
        C = T @ covariance @ T.T
        error = np.sqrt(np.diag(C))
        for name, each in zip(names, error, strict=True):
            for key in NORMAL if name == "normal" else (name,):
                row[f"{key}_error"] = float(each)
        if self.wall is not None:
            row |= {"nx_error": 1e-5, "ny_error": 1e-5}  # a straight wall is known much better than a flight
        for i, a in enumerate(names):
            for j, b in enumerate(names[:i]):
                row[f"cov:{b}:{a}"] = float(C[i, j])
        for i, angle in enumerate(self.angles, start=1):
            if angle is not None:
                value, inverse = angle
                for end, k in (("", 1), ("_after", 2)):
                    row[f"spin_{i}{end}"] = float(value[k])
                    row[f"spin_{i}{end}_error"] = sigma_angle * math.sqrt(inverse[k, k])
                row[f"cov:spin_{i}:spin_{i}_after"] = sigma_angle**2 * float(inverse[1, 2])
        for i, disk in enumerate(self.disks, start=1):
            row |= {f"{key}_{i}": float(np.asarray(getattr(disk, key))) for key in ("mass", "radius", "k")}
        if self.wall is not None:
            row |= {"mass_2": math.inf, "radius_2": row["radius_1"]}
        return row


def _fit(
    tracks: Tracks,
    disks: Mapping[int, Disk],
    meeting: _Encounter,
    times_of_disks: Mapping[int, Sequence[float]],
    wall: Wall | None,
    window: int,
) -> _Flights | str:
    """The flights of a meeting, or why there are none."""
    at = meeting.time
    rows_of_disks = []
    for one in meeting.ids:
        others = [each for each in times_of_disks[one] if each != at]
        low = max((each for each in others if each < at), default=-math.inf)
        high = min((each for each in others if each > at), default=math.inf)
        t = tracks.time[one]
        step = float(np.median(np.diff(t)))
        inside = (t > low + 0.51 * step) & (t < high - 0.51 * step)
        before, after = np.flatnonzero(inside & (t < at)), np.flatnonzero(inside & (t > at))
        here = np.flatnonzero(inside & (t == at))
        rows = np.concatenate([before[-window:], here, after[:window]])
        if min(len(before), len(after)) < LEAST:
            flights = f"{len(before)} frames of its flight before and {len(after)} after"
            return f"disk {one} is seen in {flights}: must be {LEAST} or more"
        if len(rows) > 1 and float(np.max(np.diff(t[rows]))) > 3.5 * step:
            return f"disk {one} was lost near the impact"
        rows_of_disks.append(rows)
    contact = sum(float(np.asarray(disks[one].radius)) for one in meeting.ids)
    line = None if wall is None else _wall_line(wall, tracks.position[meeting.ids[0]])
    times = [tracks.time[one][rows] for one, rows in zip(meeting.ids, rows_of_disks, strict=True)]
    positions = [tracks.position[one][rows] for one, rows in zip(meeting.ids, rows_of_disks, strict=True)]
    span = float(np.median(np.diff(times[0])))
    start = [at]
    for t, x in zip(times, positions, strict=True):
        before, after = t < at, t > at
        v, w = ((x[some][-1] - x[some][0]) / (t[some][-1] - t[some][0]) for some in (before, after))
        start += [*x[np.argmin(np.abs(t - at))], *v, *w]
    scale = 0.01 * contact  # of the scatter, so far; its size changes nothing but the weight of the distance

    def residual(p: Array) -> Array:
        found = []
        for i, (t, x) in enumerate(zip(times, positions, strict=True)):
            x_c, v, w = p[1 + 6 * i : 3 + 6 * i], p[3 + 6 * i : 5 + 6 * i], p[5 + 6 * i : 7 + 6 * i]
            tau = (t - p[0])[:, None]
            found.append((x - x_c - np.minimum(tau, 0.0) * v - np.maximum(tau, 0.0) * w).ravel())
        apart = math.hypot(p[7] - p[1], p[8] - p[2]) if line is None else line[1] - line[0] @ p[1:3]
        found.append(np.array([apart - contact]))
        return np.concatenate(found)

    ended = least_squares(
        residual, start, x_scale=[span, *([contact] * 2 + [scale / span] * 4) * len(times)], method="trf"
    )
    if abs(ended.x[0] - at) > max(5.0, 0.5 * window) * span:
        return "no time at which flights before and after meet"
    angles: list[tuple[Array, Array] | None] = []
    angle_squares, angle_dof = 0.0, 0
    for one, rows, t in zip(meeting.ids, rows_of_disks, times, strict=True):
        value = tracks.angle.get(one, np.full(len(tracks.time[one]), math.nan))[rows]
        good = ~np.isnan(value)
        tau = (t - ended.x[0])[good]
        if min(np.sum(tau < 0.0), np.sum(tau > 0.0)) < LEAST:
            angles.append(None)
            continue
        A = np.stack([np.ones_like(tau), np.minimum(tau, 0.0), np.maximum(tau, 0.0)], axis=-1)
        solved, *_ = np.linalg.lstsq(A, value[good], rcond=None)
        angle_squares += float(np.sum((value[good] - A @ solved) ** 2))
        angle_dof += int(np.sum(good)) - 3
        angles.append((solved, np.linalg.inv(A.T @ A)))
    squares = float(np.sum(ended.fun[:-1] ** 2))
    return _Flights(
        meeting, tuple(disks[one] for one in meeting.ids), ended.x, ended.jac, squares,
        len(ended.fun) - len(ended.x), tuple(angles), angle_squares, angle_dof, line,
    )  # fmt: skip
