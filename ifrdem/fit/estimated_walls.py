"""Walls of a tray, estimated from tracks: straight or round, where disks change direction far from other disks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, option_name
from ..model.walls.wall import Wall
from .tracks import Array, Tracks, cause_of_none, nearest_pair, noise

_FRAMES = 4  # of the pieces before and after a turn
_CLEAR = 8.0  # errors by which the velocity changes
_LEAST = 4  # turns at a wall
_TRIES = 400  # circles through three turns
_ALONE = 1.3  # distance from the next disk, over the sum of the radii
_PART = 0.6  # of all turns that walls must explain


@dataclass(frozen=True)
class _Turns:
    position: Array  # (m, 2): of the centres
    inward: Array  # (m, 2): directions of the changes of velocity
    radius: Array  # (m,)
    tolerance: float

    def take(self, rows: NDArray[np.bool_]) -> _Turns:
        return _Turns(self.position[rows], self.inward[rows], self.radius[rows], self.tolerance)


def estimated(tracks: Tracks, radius: Mapping[int, float]) -> list[Wall]:
    """Straight walls, or one round one, that keep all disks in, from turns far from other disks.

    A turn is a change of direction. `radius` has the radii of the disks by id [length]. Raises InputError if less than
    six tenths of these turns lie on such walls.
    """
    turns = _turns(tracks, radius)
    number = len(turns.radius)
    lines, left = [], turns
    while (found := _line(left, tracks, radius)) is not None:
        wall, on = found
        lines.append(wall)
        left = left.take(~on)
    circle = _circle(turns, tracks, radius)
    straight = number - len(left.radius)
    if circle is not None and circle[1] > straight:
        walls, explained = [circle[0]], circle[1]
    else:
        walls, explained = lines, straight
    if explained < max(_PART * number, _LEAST):
        text = (
            f"{tracks.source}: {explained} of {number} changes of direction far from other disks lie on straight or "
            "round walls: walls cannot be estimated"
        )
        if 2.0 < nearest_pair(tracks, radius) < math.inf:
            raise InputError(f"{text}; {cause_of_none(tracks, radius, with_walls=False)}")
        raise InputError(f"{text}; give them by {option_name('--walls CASE or --wall', 'walls')}")
    return walls


def _turns(tracks: Tracks, radius: Mapping[int, float]) -> _Turns:
    """Turns of single disks, with at least 1.3 times contact distance to all others."""
    sigma = noise(tracks, {}).typical
    found: list[tuple[Array, Array, float]] = []
    for one, t in tracks.time.items():
        x, n = tracks.position[one], len(t)
        if n < 2 * _FRAMES:
            continue
        step = float(np.median(np.diff(t)))
        rows = np.arange(n - 2 * _FRAMES + 1)[:, None] + np.arange(2 * _FRAMES)
        even = np.ptp(t[rows], axis=1) < (2 * _FRAMES - 0.5) * step
        before, after = rows[:, :_FRAMES], rows[:, _FRAMES:]
        tau = np.arange(_FRAMES) - 0.5 * (_FRAMES - 1)
        v = [np.einsum("k,mka->ma", tau, x[part]) / (step * np.sum(tau**2)) for part in (before, after)]
        change = v[1] - v[0]
        size = np.hypot(*change.T)
        error = sigma / (step * math.sqrt(0.5 * np.sum(tau**2)))
        best = size == np.max(np.stack([np.roll(size, k) for k in range(-_FRAMES, _FRAMES + 1)]), axis=0)
        for i in np.flatnonzero(even & best & (size > _CLEAR * error)):
            middle = [np.mean(x[part[i]], axis=0) for part in (before, after)]
            times = [float(np.mean(t[part[i]])) for part in (before, after)]
            at = [m - each[i] * time for m, each, time in zip(middle, v, times, strict=True)]
            when = -float((at[1] - at[0]) @ change[i]) / size[i] ** 2  # where both lines are nearest
            if not times[0] <= when <= times[1]:
                continue
            place = 0.5 * (at[0] + v[0][i] * when + at[1] + v[1][i] * when)
            if not _near_another(tracks, radius, one, when, place, step):
                found.append((place, change[i] / size[i], radius[one]))
    if not found:
        return _Turns(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), sigma)
    places, inward, radii = (np.array(each) for each in zip(*found, strict=True))
    return _Turns(places, inward, radii, 4.0 * sigma + 0.03 * float(np.median(radii)))


def _near_another(
    tracks: Tracks, radius: Mapping[int, float], one: int, time: float, place: Array, step: float
) -> bool:
    for other, t in tracks.time.items():
        if other == one or not len(t):
            continue
        near = np.abs(t - time) < 2.5 * step
        away = np.hypot(*(tracks.position[other][near] - place).T)
        if np.any(away < _ALONE * (radius[one] + radius[other])):
            return True
    return False


def _keeps_in(wall: Wall, tracks: Tracks, radius: Mapping[int, float], tolerance: float) -> bool:
    """True if all but one in a thousand positions lie on the inner side of a wall."""
    gaps = [wall.gap(x, np.full(len(x), radius[one])) for one, x in tracks.position.items()]
    return float(np.mean(np.concatenate(gaps) < -tolerance)) < 1e-3


def _line(
    turns: _Turns, tracks: Tracks, radius: Mapping[int, float]
) -> tuple[Wall, NDArray[np.bool_]] | None:
    """The straight wall with most turns on it, and which; None with fewer than four."""
    best: tuple[int, Wall, NDArray[np.bool_]] = (
        _LEAST - 1,
        Wall.line((0.0, 0.0), (1.0, 0.0)),
        np.zeros(0, bool),
    )
    places, R = turns.position, turns.radius
    for i in range(len(R)):
        for j in range(i):
            if turns.inward[i] @ turns.inward[j] < 0.7 or math.dist(places[i], places[j]) < 2.0 * max(
                R[i], R[j]
            ):
                continue
            normal = _normal(places[i] - places[j], R[i] - R[j], turns.inward[i])
            if normal is None:
                continue
            offset = float(places[i] @ normal - R[i])
            on = _on_line(turns, normal, offset)
            if np.sum(on) <= best[0]:
                continue
            # a line through all of them, by their scatter about it
            centred = places[on] - places[on].mean(axis=0)
            radii = R[on] - R[on].mean()
            along = np.array([normal[1], -normal[0]])
            tilt = float(
                np.sum((centred @ normal - radii) * (centred @ along))
                / max(np.sum((centred @ along) ** 2), 1e-300)
            )
            normal = normal - tilt * along
            normal = normal / np.hypot(*normal)
            offset = float(np.median(places[on] @ normal - R[on]))
            wall = Wall.line(tuple((offset * normal).tolist()), tuple(normal.tolist()))
            on = _on_line(turns, normal, offset)
            if np.sum(on) > best[0] and _keeps_in(wall, tracks, radius, turns.tolerance):
                best = int(np.sum(on)), wall, on
    return None if best[0] < _LEAST else (best[1], best[2])


def _normal(away: Array, difference: float, inward: Array) -> Array | None:
    """Unit vector n with n . away = difference that points inward."""
    length = math.hypot(*away)
    if abs(difference) >= length:
        return None
    along, across = away / length, np.array([-away[1], away[0]]) / length
    part = difference / length
    across = across if across @ inward > 0.0 else -across
    return np.asarray(part * along + math.sqrt(1.0 - part**2) * across)


def _on_line(turns: _Turns, normal: Array, offset: float) -> NDArray[np.bool_]:
    gap = turns.position @ normal - turns.radius - offset
    return (np.abs(gap) < turns.tolerance) & (turns.inward @ normal > 0.7)


def _circle(turns: _Turns, tracks: Tracks, radius: Mapping[int, float]) -> tuple[Wall, int] | None:
    """The round wall around all disks with most turns on it, and their number."""
    n, places, R = len(turns.radius), turns.position, turns.radius
    if n < _LEAST:
        return None
    rng, best = np.random.default_rng(1), None
    most = _LEAST - 1
    for _ in range(_TRIES):
        rows = rng.choice(n, 3, replace=False)
        solved = _circle_through(places[rows], R[rows])
        for _ in range(3):  # with all turns on it
            if solved is None:
                break
            centre, size = solved
            on = np.abs(size - R - np.hypot(*(places - centre).T)) < turns.tolerance
            on &= np.sum(turns.inward * (centre - places), axis=1) > 0.7 * np.hypot(*(places - centre).T)
            solved = _circle_through(places[on], R[on]) if np.sum(on) >= 3 else None
        if solved is None or np.sum(on) <= most:
            continue
        wall = Wall.container(tuple(centre.tolist()), size)
        if _keeps_in(wall, tracks, radius, turns.tolerance):
            most, best = int(np.sum(on)), wall
    return None if best is None else (best, most)


def _circle_through(places: Array, R: Array) -> tuple[Array, float] | None:
    """Centre and radius S of the circle with |x - c| = S - R, or x^2 - R^2 = 2 c x - 2 S R + S^2 - c^2."""
    A = np.column_stack([2.0 * places, np.ones(len(R)), -2.0 * R]) if np.ptp(R) > 0.0 and len(R) > 3 else (
        np.column_stack([2.0 * places, np.ones(len(R))])
    )  # fmt: skip
    solved, _, rank, _ = np.linalg.lstsq(A, np.sum(places**2, axis=1) - R**2 * (A.shape[1] == 4), rcond=None)
    if rank < A.shape[1]:
        return None
    centre = solved[:2]
    size = float(np.mean(np.hypot(*(places - centre).T) + R))
    return (centre, size) if 0.0 < size < 1e3 * float(np.ptp(places) + 1e-300) else None
