"""Tracks of disks in a video: positions per frame, their noise, and ids that were exchanged."""

from __future__ import annotations

import bisect
import math
import tempfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, option_name, refuse
from ..model.walls.wall import Wall
from ..tools import tables
from ..tools.tables import TableFormat
from . import trackers
from .data import Disk

Array = NDArray[np.float64]

KINDS = {
    "frame": "number",
    "t": "time",
    "id": "number",
    "x": "length",
    "y": "length",
    "angle": "angle",
    "clip": "number",
}
_SPELLINGS = {
    **{name: name for name in KINDS},
    **dict.fromkeys(("time", "seconds", "timestamp"), "t"),
    **dict.fromkeys(("framenumber", "frameid", "frameno", "frameindex"), "frame"),
    **dict.fromkeys(
        ("disk", "particle", "track", "trackid", "particleid", "objectid", "markerid", "label"), "id"
    ),
    **{f"{word}{axis}": axis for axis in "xy" for word in ("c", "center", "centre", "centroid", "pos")},
    **{f"{axis}{word}": axis for axis in "xy" for word in ("c", "center", "centre", "centroid", "pos")},
    **dict.fromkeys(("orientation", "theta"), "angle"),
}
FLIPS = ("y", "angle")
"""Axes that can be reversed."""

GAP = 3.5
"""Steps from one frame to the next beyond which a motion is not followed."""

_LONG_GAP = 30.0  # steps without a disk that part two clips
_MOST_DISKS = 500
_OWN_NOISE = 200  # third differences from which a coordinate of a disk has its own noise
_SHARPEST = 0.01  # least noise of a coordinate of a disk, over that of all
_FAR = 6.0  # times the sum of the radii: if no two disks come nearer, the unit is wrong
_TRIMMED = 0.98658  # standard deviation of a unit Gaussian within three of them


@dataclass(frozen=True, eq=False)
class Tracks:
    """Positions of disks in the frames of a video."""

    time: Mapping[int, Array]  # (f,): times [time] of the frames that show a disk, by its id, ascending
    position: Mapping[int, Array]  # (f, 2): its centre [length]
    # (f,): the angle by which it has turned, counter-clockwise, unwrapped [rad]; empty if none was tracked
    angle: Mapping[int, Array]
    source: str
    missing: int = 0  # lines without a position
    # clips of the film, which follow each other in `time`: the first frame of each, what its times have been moved by,
    # and its number in the file; ids of one are not those of another
    clips: tuple[tuple[float, float, int], ...] = ((-math.inf, 0.0, 1),)
    note: str = ""  # what was made of the file of a tracking program

    def clip(self, time: float) -> int:
        """Index of the clip of a time."""
        return max(bisect.bisect_right([first for first, _, _ in self.clips], time) - 1, 0)

    def when(self, time: float) -> tuple[int, float]:
        """Number of the clip of a time, and the time in the file."""
        _, moved, number = self.clips[self.clip(time)]
        return number, time - moved

    def text(self, time: float) -> str:
        """A time as messages name it."""
        number, shown = self.when(time)
        return f"t = {shown:.6g}" + f" of clip {number}" * (len(self.clips) > 1)


def read(
    path: Path | str,
    *,
    fps: float | None = None,
    form: TableFormat = TableFormat(),  # noqa: B008  (frozen)
    flip: Collection[str] = (),
) -> Tracks:
    """Read tracks: a line for each disk in each frame, with columns id, x, y, and t or frame; angle if disks were seen to turn.

    A column clip numbers clips of one film, each of which has its own ids; without it times that begin anew, or a gap
    in time that no disk can have crossed so, part two.

    `fps`, frames per time, is needed with a column frame; `form` gives other names, units and signs of the file; axes
    in `flip`, of `FLIPS`, are reversed.

    Raises InputError with a line for each thing that is wrong.
    """
    table, note = _table(Path(path), form)
    columns, source = dict(table.columns), table.source
    missing = [name for name in ("id", "x", "y") if name not in columns]
    if "t" not in columns and "frame" not in columns:
        missing.append("t or frame")
    problems = [
        f"column {name}: has no value"
        for name, each in columns.items()
        if np.isnan(each).all() and name != "angle"
    ]
    if missing:
        problems.append(
            f"missing column {', '.join(missing)}; there are {', '.join((*columns, *table.unused))}"
        )
    if "t" not in columns and "frame" in columns and fps is None:
        problems.append(f"a column frame requires {option_name('--fps', 'fps')}, the frames per second")
    if fps is not None and not 0.0 < fps < math.inf:
        problems.append(f"fps = {fps:g}: must be a positive finite number")
    elif fps is not None and "t" in columns:
        problems += _fps_problems(columns["t"], fps)
    problems += [f"flip = {each!r}: must be one of {', '.join(FLIPS)}" for each in flip if each not in FLIPS]
    refuse(problems, source)
    for name in {*flip} & {*columns}:
        columns[name] = -columns[name]
    times = columns["t"] if "t" in columns else columns["frame"] / float(fps or 1.0)
    ids = columns["id"]
    if "clip" not in columns and (number := _counted_anew(times, ids)) is not None:
        columns["clip"] = number
    clips, times, bad_clips = _clips(columns.get("clip"), times)
    whole = np.all([~np.isnan(each) for each in (times, ids, columns["x"], columns["y"])], axis=0)
    if not whole.any():
        raise InputError(f"{source}: no line has an id, a time and a position")
    bad = np.flatnonzero(whole & (ids != np.round(ids)))
    found = [f"line {table.line[i]}: id = {ids[i]:g}: must be an integer" for i in bad]
    found += [f"line {table.line[i]}: clip = {columns['clip'][i]:g}: must be an integer" for i in bad_clips]
    time, position, angle, twice = {}, {}, {}, list[str]()
    for one in np.unique(ids[whole]) if not found else ():
        rows = np.flatnonzero(whole & (ids == one))
        rows = rows[np.argsort(times[rows], kind="stable")]
        again = rows[1:][np.diff(times[rows]) <= 0.0]
        twice += [f"line {table.line[i]}: disk {one:g} has two rows at one time" for i in again]
        time[int(one)] = times[rows]
        position[int(one)] = np.stack([columns["x"][rows], columns["y"][rows]], axis=-1)
        if "angle" in columns:
            angle[int(one)] = value = np.radians(columns["angle"][rows])
            measured = ~np.isnan(value)
            value[measured] = np.unwrap(value[measured])
    if twice:
        found += [*twice[:5], *[f"and {len(twice) - 5} more such lines"] * (len(twice) > 5)]
        found.append("a column clip numbers clips whose frames, or times, begin anew")
    if "clip" not in columns and not found:
        clips = _gaps(time, position)
    if len(time) > _MOST_DISKS:
        found.append(f"{len(time)} disks: at most {_MOST_DISKS} are looked through")
    refuse(found, source)
    return Tracks(time, position, angle, source, int(np.sum(~whole)), clips, note)


def _table(path: Path, form: TableFormat) -> tuple[tables.ReadTable, str]:
    """The table of a file, of a tracking program too, and what was made of it."""
    found = trackers.converted(path)
    if found is None:
        return tables.read(path, KINDS, _SPELLINGS, form), ""
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "tracks.csv"
        plain.write_text(found.text, encoding="utf-8")
        try:
            table = tables.read(plain, KINDS, _SPELLINGS, replace(form, delimiter=",", decimal="."))
        except InputError as error:
            text = str(error).replace(str(plain), f"{path} (of {found.program})")
            raise InputError(text) from None
    return replace(table, source=str(path)), f"a file of {found.program}: {found.note}"


Clips = tuple[tuple[float, float, int], ...]


def _counted_anew(times: Array, ids: Array) -> Array | None:
    """Numbers of clips (n,) from 1, whose times begin anew below the last line of the one before.

    None if no disk has two lines at one time, also if that happens within a part, or parts are those of one disk each.
    """
    good = np.flatnonzero(~np.isnan(times) & ~np.isnan(ids))
    t, one = times[good], ids[good]
    part = np.concatenate([[1.0], 1.0 + np.cumsum(np.diff(t) < 0.0)])[: len(good)]
    if np.unique(np.stack([one, t]), axis=1).shape[1] == len(good):
        return None
    if np.unique(np.stack([part, one, t]), axis=1).shape[1] < len(good):
        return None
    if np.min(np.unique(np.unique(np.stack([part, one]), axis=1)[0], return_counts=True)[1]) < 2:
        return None
    number = np.ones(len(times))
    number[good] = part
    return np.asarray(np.maximum.accumulate(number))


def _clips(number: Array | None, times: Array) -> tuple[Clips, Array, NDArray[np.int64]]:
    """Clips that a column numbers, times (n,) that follow each other, and rows whose number is wrong."""
    if number is None or np.isnan(times).all():
        return ((-math.inf, 0.0, 1),), times, np.empty(0, dtype=np.int64)
    bad = np.flatnonzero(number != np.round(number))  # or missing
    if len(bad):
        return (), times, bad
    clips: list[tuple[float, float, int]] = []
    moved, end = times.copy(), -math.inf
    steps = np.concatenate(
        [np.diff(np.unique(times[(number == one) & ~np.isnan(times)])) for one in np.unique(number)]
    )
    apart = 2.0 * _LONG_GAP * float(np.median(steps)) if len(steps) else 1.0
    for one in np.unique(number):
        own = number == one
        if np.isnan(times[own]).all():
            continue
        first = float(np.nanmin(times[own]))
        by = max(end + apart - first, 0.0) if clips else 0.0
        moved[own] = times[own] + by
        end = float(np.nanmax(moved[own]))
        clips.append((first + by, by, int(one)))
    return tuple(clips), moved, bad


def _gaps(time: Mapping[int, Array], position: Mapping[int, Array]) -> Clips:
    """Clips that gaps in time part, numbered from 1.

    In a gap of m frames a disk moves by m times what it does in one at most: where half of the disks have moved by more
    than fast disks do, or none is seen on both sides, or the gap is long, another clip begins.
    """
    every = np.unique(np.concatenate([*time.values()]))
    steps = np.diff(every)
    clips = [(-math.inf, 0.0, 1)]
    if not len(steps) or not np.any(gap := steps > GAP * (step := float(np.median(steps)))):
        return tuple(clips)
    moved = np.concatenate(
        [np.hypot(*np.diff(x, axis=0).T)[np.diff(time[one]) < GAP * step] for one, x in position.items()]
    )
    fast = float(np.quantile(moved, 0.99)) if len(moved) else 0.0
    for i in np.flatnonzero(gap):
        over = [
            math.dist(position[one][k], position[one][k - 1])
            for one, t in time.items()
            if 0 < (k := int(np.searchsorted(t, every[i + 1]))) < len(t) and t[k] - t[k - 1] < 1.5 * steps[i]
        ]
        m = steps[i] / step
        if m > _LONG_GAP or not over or float(np.median(over)) > fast * m:
            clips.append((float(every[i + 1]), 0.0, len(clips) + 1))
    return tuple(clips)


def _fps_problems(times: Array, fps: float) -> list[str]:
    """A line if the times of frames (n,) are not those of a video of `fps` frames per time."""
    frames = np.unique(times[~np.isnan(times)])
    if len(frames) < 3:
        return []
    step = float(np.median(np.diff(frames)))
    if abs(step * fps - 1.0) < 0.1:
        return []
    fits = option_name(f"--fps {1.0 / step:.4g}", f"fps = {1.0 / step:.4g}")
    return [f"fps = {fps:g}: the column t has a frame every {step:.4g}, which is {fits}; t alone is enough"]


@dataclass(frozen=True)
class Exchange:
    """Two tracks that exchange their ids between two frames."""

    ids: tuple[int, int]
    time: float  # of the first frame after it


def exchanges_in(tracks: Tracks, radius: Mapping[int, float]) -> list[Exchange]:
    """Pairs of tracks each of which continues, from one frame on, where the other was expected; in order of time."""
    jumps: dict[tuple[float, float], list[tuple[int, int, Array]]] = {}
    for one, t in tracks.time.items():
        x = tracks.position[one]
        if len(t) < 4:
            continue
        back = np.maximum(np.arange(len(t) - 1) - 3, 0)
        ahead = np.arange(len(t) - 1)
        ahead[0] = 1  # the first step has no velocity before it
        v = (x[ahead] - x[back]) / (t[ahead] - t[back])[:, None]
        expected = x[:-1] + v * np.diff(t)[:, None]
        for i in np.flatnonzero(np.hypot(*(x[1:] - expected).T) > 0.5 * radius[one]):
            if tracks.clip(float(t[i])) != tracks.clip(float(t[i + 1])):
                continue
            jumps.setdefault((float(t[i]), float(t[i + 1])), []).append((one, int(i), expected[i]))
    found = []
    for (_, time), several in sorted(jumps.items()):
        for first, (a, k, of_a) in enumerate(several):
            for b, m, of_b in several[first + 1 :]:
                now_a, now_b = tracks.position[a][k + 1], tracks.position[b][m + 1]
                crossed = max(math.dist(now_a, of_b) / radius[b], math.dist(now_b, of_a) / radius[a])
                if crossed < 0.5:
                    found.append(Exchange((a, b), time))
    return found


def exchanged(tracks: Tracks, found: Sequence[Exchange]) -> Tracks:
    """Tracks with these exchanges undone."""
    parts = [dict(tracks.time), dict(tracks.position), dict(tracks.angle)]
    for exchange in sorted(
        found, key=lambda each: -each.time
    ):  # the last one first: ids before it are those of the file
        a, b = exchange.ids
        later = [first for first, _, _ in tracks.clips if first > exchange.time]
        (i, i_end), (j, j_end) = (
            np.searchsorted(parts[0][one], [exchange.time, min(later, default=math.inf)]).tolist()
            for one in (a, b)
        )
        for part in parts:
            if a in part:
                first, second = part[a], part[b]
                part[a] = np.concatenate([first[:i], second[j:j_end], first[i_end:]])
                part[b] = np.concatenate([second[:j], first[i:i_end], second[j_end:]])
    for value in parts[2].values():
        measured = ~np.isnan(value)
        value[measured] = np.unwrap(value[measured])
    return replace(tracks, time=parts[0], position=parts[1], angle=parts[2])


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard errors from the scatter of tracks."""

    position: Mapping[int, Array]  # (2,): of x and y of a disk [length]
    typical: float  # of a coordinate [length]
    angle: float  # [rad]; NaN if none was tracked


def noise(tracks: Tracks, events: Mapping[int, Sequence[float]]) -> Noise:
    """Noise from third differences of positions and angles, which vanish for constant decelerations at equal steps.

    Differences across an event of the disk are left out; `events` has times of impacts by id. Outliers hardly matter:
    the width is first that of the middle half, then that of all values within three widths. A coordinate with few
    frames gets the noise of all disks. Positions that are rounded, such as whole pixels, have at least the error of
    rounding.
    """
    of = {one: _third(t, tracks.position[one], events.get(one, ())) for one, t in tracks.time.items()}
    turned = [_third(tracks.time[one], a[:, None], events.get(one, ())) for one, a in tracks.angle.items()]
    typical = _width(np.concatenate([each.ravel() for each in of.values()]))
    rounding = _resolution(np.concatenate([*tracks.position.values()])) / math.sqrt(12.0)
    typical = float(np.maximum(typical, np.min(rounding)))
    least = np.maximum(rounding, _SHARPEST * typical)
    position = {
        one: np.maximum([_width(each[:, i]) for i in (0, 1)], least)
        if len(each) >= _OWN_NOISE
        else np.maximum(typical, rounding)
        for one, each in of.items()
    }
    return Noise(position, typical, _width(np.concatenate(turned).ravel()) if turned else math.nan)


def _resolution(x: Array) -> Array:
    """Step (2,) of which all coordinates (n, 2) are multiples, such as a pixel; 0 if there is none."""
    found = np.zeros(2)
    for axis in (0, 1):
        values = np.unique(x[:, axis])
        steps = np.diff(values)
        if len(steps) and (step := float(np.min(steps))) > 1e-12 * float(np.max(np.abs(values))):
            number = (values - values[0]) / step
            found[axis] = step if np.max(np.abs(number - np.round(number))) < 1e-3 else 0.0
    return found


def _third(t: Array, x: Array, events: Sequence[float]) -> Array:
    """Third differences (m, d) of x (n, d) at equal steps of t (n,), scaled to the errors of x; none across events."""
    if len(t) < 4:
        return np.empty((0, x.shape[1]))
    steps = np.diff(t)
    step = float(np.median(steps))
    same = np.abs(steps - step) < 0.01 * step
    good = same[:-2] & same[1:-1] & same[2:]
    if len(events):
        middle = 0.5 * (t[1:-2] + t[2:-1])
        good &= np.min(np.abs(middle[:, None] - np.asarray(events)), axis=1) > 3.0 * step
    third = (x[3:] - 3.0 * x[2:-1] + 3.0 * x[1:-2] - x[:-3])[good] / math.sqrt(20.0)
    return third[~np.isnan(third).any(axis=1)]


def _width(values: Array) -> float:
    """Standard deviation of the Gaussian part; NaN of no values."""
    if not len(values):
        return math.nan
    size = np.abs(values)
    width = 1.4826 * float(np.median(size))
    for _ in range(5):
        inside = size[size <= 3.0 * width]
        width = float(np.sqrt(np.mean(inside**2))) / _TRIMMED
    return width


def nearest_pair(tracks: Tracks, radius: Mapping[int, float]) -> float:
    """Least distance of two disks at one time, over the sum of their radii; infinite without two disks."""
    nearest, ids = math.inf, sorted(tracks.time)
    for i, a in enumerate(ids):
        for b in ids[i + 1 :]:
            _, k, m = np.intersect1d(tracks.time[a], tracks.time[b], assume_unique=True, return_indices=True)
            if len(k):
                away = np.hypot(*(tracks.position[b][m] - tracks.position[a][k]).T)
                nearest = min(nearest, float(np.min(away)) / (radius[a] + radius[b]))
    return nearest


def cause_of_none(tracks: Tracks, radius: Mapping[int, float], *, with_walls: bool) -> str:
    """Likely cause why no disk touches another one or a wall, for messages."""
    times = nearest_pair(tracks, radius)
    if times == math.inf:
        no_walls = f"no walls are given: {option_name('--walls or --wall', 'walls')} gives them"
        wrong = "no disk comes near a wall: the walls, or the unit of x and y, are wrong"
        return f"no two disks are seen at one time, and {wrong if with_walls else no_walls}"
    contact = 2.0 * float(np.median([*radius.values()]))
    text = (
        f"the nearest two disks are {times * contact:.4g} apart, {times:.3g} times the sum of their radii: "
    )
    if times < _FAR:
        return f"{text}the radii or the unit of x and y are wrong, or no two disks touched"
    scale = f"{1.0 / times:.2g}"
    how = option_name(f"--unit x={scale} --unit y={scale}", f"units = {{'x': '{scale}', 'y': '{scale}'}}")
    return f"{text}positions are in pixels or another unit; {how} if these two touched"


def wall_of_numbers(numbers: Sequence[float], tracks: Tracks) -> Wall:
    """The wall X1,Y1,X2,Y2 (a line through two points), X,Y,R (a circle), or X1,Y1,X2,Y2,X3,Y3,... (a polygon).

    Most disks are on its inner side.
    """
    places = np.concatenate([*tracks.position.values()])
    if len(numbers) == 3:
        centre, radius = (numbers[0], numbers[1]), numbers[2]
        inside = float(np.median(np.hypot(*(places - centre).T))) < radius
        return Wall.container(centre, radius) if inside else Wall.post(centre, radius)
    if len(numbers) > 4:
        corners = np.reshape(np.asarray(numbers), (-1, 2))
        wall = Wall.polygon(corners, holds="inside")
        held = float(np.median(wall.normal(places)[1])) > 0.0
        return wall if held else Wall.polygon(corners, holds="outside")
    x_1, y_1, x_2, y_2 = numbers
    normal = np.array([y_1 - y_2, x_2 - x_1])
    if np.median((places - [x_1, y_1]) @ normal) < 0.0:
        normal = -normal
    return Wall.line((x_1, y_1), (float(normal[0]), float(normal[1])))


_DISK_KINDS = {"id": "number", "mass": "mass", "radius": "length", "k": "number", "material": "text"}


def of_unknown_size(tracks: Tracks, known: Collection[int]) -> list[str]:
    """A line if the mass and radius of some disks are not known."""
    unknown = [one for one in tracks.time if one not in known]
    if not unknown:
        return []
    more = f" and {len(unknown) - 5} more" * (len(unknown) > 5)
    named = f"disk{'s' * (len(unknown) > 1)} {', '.join(map(str, unknown[:5]))}{more}"
    how = option_name("; --disk MASS,RADIUS,K without ID= gives those of all others", "")
    note = f" ({tracks.note})" * bool(tracks.note)
    return [f"{tracks.source}: {named}: mass and radius are not given{how}{note}"]


def read_disks(path: Path | str) -> tuple[dict[int, Disk], dict[int, str]]:
    """Disks by id, and their materials, from a CSV file with columns id, mass, radius, and perhaps k and material.

    Raises InputError with a line for each thing that is wrong.
    """
    spellings = {
        **{name: name for name in _DISK_KINDS},
        **dict.fromkeys(("disk", "particle"), "id"),
        "species": "material",
    }
    table = tables.read(path, _DISK_KINDS, spellings, gaps=False)
    columns, source = table.columns, table.source
    missing = [name for name in ("id", "mass", "radius") if name not in columns]
    if missing:
        have = ", ".join((*columns, *table.unused))
        refuse([f"missing column {', '.join(missing)}; there are {have}"], source)
    ids = columns["id"]
    problems = [
        f"line {table.line[i]}: id = {ids[i]:g}: must be an integer"
        for i in np.flatnonzero(ids != np.round(ids))
    ]
    for name in ("mass", "radius", "k"):
        values = columns.get(name, np.ones(len(ids)))
        bad = np.flatnonzero(~((values > 0.0) & np.isfinite(values)))
        problems += [
            f"line {table.line[i]}: {name} = {values[i]:g}: must be a positive finite number" for i in bad
        ]
    twice = [i for i in range(len(ids)) if ids[i] in ids[:i]]
    problems += [f"line {table.line[i]}: disk {ids[i]:g} is given twice" for i in twice]
    refuse(problems, source)
    k = columns.get("k", np.full(len(ids), 2.0))
    disks = {
        int(one): Disk(mass=float(m), radius=float(R), k=float(each))
        for one, m, R, each in zip(ids, columns["mass"], columns["radius"], k, strict=True)
    }
    named = columns.get("material")
    return disks, {} if named is None else {
        int(one): table.texts[int(at)] for one, at in zip(ids, named, strict=True)
    }
