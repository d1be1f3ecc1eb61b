"""Collisions from tracks: impacts in positions per frame, with the flights before and after.

Two disks have collided where their distance has a minimum near the sum of their radii; a disk has hit a wall where its
distance from the wall has one near its radius. There, straight flights that meet at one time t_c are fitted:

    x(t) = x_c + v (t - t_c) before, x_c + v' (t - t_c) after,   |x_c2 - x_c1| = R_1 + R_2,

and straight lines for the angle of each disk, if it was tracked. Flights end at other impacts of the disk, and where a
change point makes two straight pieces far more likely than one, under Student-t noise. Normal and velocities share x_c
and t_c, so that their errors are correlated; the table has the covariances.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import find_peaks
from scipy.special import chdtrc

from ..errors import InputError, option_name, refuse
from ..model.walls.wall import Wall
from .data import NORMAL, Disk
from .tracks import (
    Array,
    Exchange,
    Noise,
    Tracks,
    cause_of_none,
    exchanged,
    exchanges_in,
    nearest_pair,
    noise,
)

WINDOW = 12
"""Frames of a flight that are used at most."""

LEAST = 3
"""Frames of a flight that are needed at least."""

POOR = 0.01
"""Quality below which a collision is not used by default: something else has changed its flights."""

_CONTACT = 5e-3  # how well the sum of the radii is known, over itself
_SURE = 4.0  # errors by which an impact must change the velocity along the normal
_NORMAL = 0.1  # largest error of the normal of an impact [rad]
_CHANGE = 40.0  # loss that a change point must save: by chance in one of some 1,000 flights
_OUTLIER = 30.0  # squared distance of a frame, in units of its errors, that counts as misread
_DEEP = 8.0  # errors by which a distance is less at an encounter than between it and the next one
_TOUCH = 6.0  # errors of a gap that may be none
_NU = 4.0  # degrees of freedom of the Student-t noise
_WRONG_SIZE = 0.05  # of the distance at impacts from the sum of the radii


@dataclass(frozen=True)
class LeftOut:
    """Something that was not used, and why."""

    reason: str
    ids: tuple[int, ...]
    time: float


@dataclass(frozen=True, eq=False)
class FoundCollisions:
    """Collisions that were found."""

    # (n,): tables of two disks and of disks with walls, as `ifrdem.fit.read` takes them: t, id_1, id_2, nx, ny,
    # velocities and spins with their errors and covariances, mass, radius and k of the disks, and `quality`, the
    # probability that noise alone scatters the positions so far from the flights
    pairs: Mapping[str, Array]
    walls: Mapping[str, Array]
    noise: Noise
    left_out: tuple[LeftOut, ...]  # encounters that gave no collision
    cut: tuple[LeftOut, ...]  # flights that were cut, because they are not straight
    exchanges: tuple[Exchange, ...]  # ids that were exchanged
    repaired: bool  # and exchanged back
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        """The number of collisions."""
        return sum(len(each["t"]) for each in (self.pairs, self.walls) if each)

    @property
    def reasons(self) -> Mapping[str, int]:
        """Numbers of encounters left out and of flights cut, by reason."""
        return Counter(each.reason for each in (*self.left_out, *self.cut))

    def report(self) -> str:
        """Encounters that were left out and flights that were cut, as CSV."""
        rows = [
            f"{each.time:.6g},{each.ids[0]},{each.ids[1] if len(each.ids) > 1 else ''},{each.reason}"
            for each in sorted((*self.left_out, *self.cut), key=lambda each: each.time)
        ]
        return "\n".join(("t,id_1,id_2,reason", *rows)) + "\n"


def csv(columns: Mapping[str, Array], about: str = "", materials: Mapping[int, str] | None = None) -> str:
    """A table of collisions as text, with the names of materials of disks by id."""
    header = "".join(f"# {line}\n" for line in about.splitlines())
    rows = np.stack([*columns.values()], axis=-1)
    lines = (",".join("" if math.isnan(value) else f"{value:.10g}" for value in row) for row in rows)
    names = [*columns]
    if materials:
        names += ["material_1", "material_2"]
        none = np.full(len(columns["id_1"]), -1)
        pairs = zip(columns["id_1"], columns.get("id_2", none), strict=True)
        named = (
            f"{materials.get(int(a), 'other')},{materials.get(int(b), 'wall' if b < 0 else 'other')}"
            for a, b in pairs
        )
        lines = (f"{line},{each}" for line, each in zip(lines, named, strict=True))
    return header + "\n".join((",".join(names), *lines)) + "\n"


def find(
    tracks: Tracks,
    disks: Mapping[int, Disk] | Disk,
    *,
    walls: Sequence[Wall] = (),
    window: int = WINDOW,
    error: float | None = None,
    repair_swaps: bool = False,
) -> FoundCollisions:
    """Find the impacts of disks with each other and with walls, and the motion before and after.

    Raises InputError if a disk is unknown, an option is wrong, no impact was found, or sizes, units or axes do not
    fit the motion.

    Parameters
    ----------
    tracks : Tracks
        Positions of disks per frame, and angles if they were tracked.
    disks : Disk, or mapping of int to Disk
        All disks, or each by its id: mass [mass], radius [length], k.
    walls : sequence of Wall
        All walls [length], at rest: their impacts end flights, and are found too.
    window : int
        Frames of a flight that are used at most.
    error : float, optional
        Standard error of a coordinate of a position [length]; by default from the scatter of the tracks.
    repair_swaps : bool
        Undo exchanges of ids between two tracks; otherwise impacts after an exchange have quality 0.
    """
    problems = []
    if window < LEAST:
        problems.append(f"window = {window}: must be at least {LEAST} frames")
    if error is not None and not 0.0 < error < math.inf:
        problems.append(f"{option_name('--noise', 'error')} = {error:g}: must be a positive finite number")
    moving = [wall for wall in walls if wall.changes_with_time or wall.piston is not None]
    problems += [f"{wall.shape} wall: must be at rest" for wall in moving]
    of = {one: disks if isinstance(disks, Disk) else disks.get(one) for one in tracks.time}
    problems += [f"disk {one}: its mass and radius are not given" for one, disk in of.items() if disk is None]
    refuse(problems)
    known = {one: disk for one, disk in of.items() if disk is not None}
    radius = {one: float(np.asarray(disk.radius)) for one, disk in known.items()}
    exchanges = exchanges_in(tracks, radius)
    if repair_swaps:
        tracks = exchanged(tracks, exchanges)
    finder = _Finder(tracks, known, radius, walls, window, error, () if repair_swaps else exchanges)
    return finder.found(tuple(exchanges), repair_swaps)


@dataclass(frozen=True)
class _Encounter:
    ids: tuple[int, ...]
    time: float
    wall: Wall | None = None


class _Finder:
    """Search for impacts in one set of tracks."""

    def __init__(
        self,
        tracks: Tracks,
        disks: Mapping[int, Disk],
        radius: Mapping[int, float],
        walls: Sequence[Wall],
        window: int,
        error: float | None,
        exchanges: Sequence[Exchange],
    ) -> None:
        self.tracks, self.disks, self.radius, self.window = tracks, disks, radius, window
        self.step = {
            one: float(np.median(np.diff(t))) if len(t) > 1 else 1.0 for one, t in tracks.time.items()
        }
        self.touching: dict[int, list[tuple[tuple[tuple[int, ...], Wall | None], Array]]] = {
            one: [] for one in tracks.time
        }
        self.exchanged_at: dict[int, list[float]] = {}
        for exchange in exchanges:
            for one in exchange.ids:
                self.exchanged_at.setdefault(one, []).append(exchange.time)
        self.noise = self._noise({}, error)
        self.encounters = self._encounters(walls)
        self.noise = self._noise(_times(self.encounters, self.exchanged_at), error)
        self.of = {one: [each for each in self.encounters if one in each.ids] for one in tracks.time}

    def _noise(self, events: Mapping[int, Sequence[float]], error: float | None) -> Noise:
        tracks, found = self.tracks, noise(self.tracks, events)
        if error is not None:
            found = Noise(dict.fromkeys(self.disks, np.full(2, error)), error, found.angle)
        if math.isnan(found.typical):
            missing = f"; {tracks.missing} lines have no position" * bool(tracks.missing)
            text = f"no disk has 3 frames at equal steps{missing}"
            raise InputError(f"{tracks.source}: no impact was found: {text}")
        if not found.typical > 1e-9 * min(self.radius.values()):
            how = option_name("--noise", "error")
            text = f"{how}: must be given, as the positions do not scatter about the flights"
            raise InputError(f"{tracks.source}: {text}")
        return found

    def _encounters(self, walls: Sequence[Wall]) -> list[_Encounter]:
        """Minima of the distance that are near contact."""
        tracks, found, touched = self.tracks, [], False
        ids = sorted(tracks.time)
        for i, a in enumerate(ids):
            t, x = tracks.time[a], tracks.position[a]
            for wall in walls:
                found += self._minima((a,), t, wall.gap(x, np.full(len(t), self.radius[a])), wall)
            for b in ids[i + 1 :]:
                both, k, m = np.intersect1d(t, tracks.time[b], assume_unique=True, return_indices=True)
                if len(both):
                    contact = self.radius[a] + self.radius[b]
                    gap = np.hypot(*(tracks.position[b][m] - x[k]).T) - contact
                    touched |= bool(np.any(gap < _change_per_frame(gap) + _WRONG_SIZE * contact))
                    found += self._minima((a, b), both, gap, None)
        if not touched and not any(each.wall for each in found):
            cause = cause_of_none(tracks, self.radius, with_walls=bool(walls))
            raise InputError(f"{tracks.source}: no impact was found: {cause}")
        return sorted(found, key=lambda each: each.time)

    def _minima(self, ids: tuple[int, ...], t: Array, gap: Array, wall: Wall | None) -> list[_Encounter]:
        """Minima near contact, deeper than noise makes them."""
        if len(t) < 2 * LEAST:
            return []
        near = _change_per_frame(gap)
        touching = t[gap < _TOUCH * self.noise.typical + 0.5 * near]
        for one in ids:
            self.touching[one].append(((ids, wall), touching))
        lowest, _ = find_peaks(-gap, prominence=_DEEP * self.noise.typical)
        is_near = gap[lowest] < 1.5 * near[lowest] + 0.15 * self.radius[ids[0]]
        return [_Encounter(ids, float(t[k]), wall) for k in lowest[is_near]]

    def found(self, exchanges: tuple[Exchange, ...], repaired: bool) -> FoundCollisions:
        """All impacts; InputError if there is none, or they contradict what was given."""
        times: dict[_Encounter, float] = {each: each.time for each in self.encounters}
        known: dict[tuple[_Encounter, tuple[tuple[float, float], ...]], _Flights | str] = {}
        for _ in range(
            3
        ):  # flights end where other encounters of the disk are found to be, if they are impacts
            before, missed = dict(times), set[_Encounter]()
            fits, left_out, cut = [], [], []
            for each in self.encounters:
                bounds = tuple(self._between(before, each, one) for one in each.ids)
                if (each, bounds) not in known:
                    known[each, bounds] = self._fitted(each, bounds)
                fitted = known[each, bounds]
                if isinstance(fitted, str):
                    left_out.append(LeftOut(fitted, each.ids, each.time))
                    continue
                if abs(fitted.time - each.time) > 0.5 * self.step[each.ids[0]]:
                    times[each] = fitted.time
                if (row := fitted.row(self.noise.angle)) is None:
                    if fitted.quality > POOR and fitted.frames >= self.window:
                        missed.add(each)
                    left_out.append(LeftOut("passed by without an impact", each.ids, each.time))
                    continue
                if any(min(self.exchanged_at.get(one, [math.inf])) <= fitted.time for one in each.ids):
                    row["quality"] = 0.0
                fits.append((fitted, row))
                cut += [LeftOut("flight is not straight: cut", (one,), time) for one, time in fitted.cut]
            times = {each: time for each, time in times.items() if each not in missed}
            if times == before:
                break
        source = self.tracks.source
        if not fits:
            reasons = ", ".join(
                f"{n} {text}" for text, n in Counter(each.reason for each in left_out).items()
            )
            why = f"; encounters: {reasons}" * bool(reasons)
            if (nearest := nearest_pair(self.tracks, self.radius)) < 0.5:
                why += f"; two disks come as near as {nearest:.3g} times the sum of their radii: "
                why += "the radii or the unit of x and y are wrong"
            raise InputError(f"{source}: no impact was found{why}")
        self._check_sizes([fitted for fitted, _ in fits])
        pairs, walls = (
            _columns([row for fitted, row in fits if (fitted.encounter.wall is not None) is with_wall])
            for with_wall in (False, True)
        )
        warnings = _spin_warnings((pairs, walls), source)
        return FoundCollisions(
            pairs, walls, self.noise, tuple(left_out), tuple(cut), exchanges, repaired, tuple(warnings)
        )

    def _between(
        self, times: Mapping[_Encounter, float], meeting: _Encounter, one: int
    ) -> tuple[float, float]:
        """Times of the last event of a disk before an encounter, and of the first after it."""
        at = times.get(meeting, meeting.time)
        others = [times[each] for each in self.of[one] if each is not meeting and each in times]
        others += self.exchanged_at.get(one, [])
        # Frames in contact with another body count too: noise hides impacts after which a disk hardly moves away.
        own = (meeting.ids, meeting.wall)
        others += [float(t) for body, touching in self.touching[one] if body != own for t in touching]
        return max((t for t in others if t <= at), default=-math.inf), min(
            (t for t in others if t >= at), default=math.inf
        )

    def _check_sizes(self, fits: Sequence[_Flights]) -> None:
        """InputError if the paths of disks with some radii turn at another distance than their sum."""
        of_radii: dict[tuple[float, ...], list[float]] = {}
        for each in fits:
            if each.encounter.wall is None:
                radii = tuple(sorted(self.radius[one] for one in each.encounter.ids))
                of_radii.setdefault(radii, []).append(each.gap)
        for (a, b), values in of_radii.items():
            gaps = np.array(values)
            off = float(np.median(gaps))
            scatter = 1.4826 * float(np.median(np.abs(gaps - off))) / math.sqrt(len(gaps))
            if len(gaps) >= 3 and abs(off) > max(_WRONG_SIZE, 4.0 * scatter):
                raise InputError(
                    f"{self.tracks.source}: the paths of disks of radii {a:g} and {b:g} turn at {1.0 + off:.3g} times "
                    f"the sum of their radii (median of {len(gaps)} impacts, error {scatter:.2g}): the radii or the "
                    "unit of x and y are wrong"
                )

    def _fitted(self, meeting: _Encounter, bounds: Sequence[tuple[float, float]]) -> _Flights | str:
        """The flights of a meeting between the times of other events of each disk, or why there are none."""
        at, rows_of_disks = meeting.time, []
        for one, (low, high) in zip(meeting.ids, bounds, strict=True):
            t = self.tracks.time[one]
            step = self.step[one]
            inside = (t > low + 0.51 * step) & (t < high - 0.51 * step)
            before, after = np.flatnonzero(inside & (t < at)), np.flatnonzero(inside & (t > at))
            rows = np.concatenate(
                [before[-self.window :], np.flatnonzero(inside & (t == at)), after[: self.window]]
            )
            rows_of_disks.append(_without_gaps(t, rows, at, step))
        cut: dict[int, float] = {}
        fitted: _Flights | str = ""
        time, few = at, f"a flight has fewer than {LEAST} frames"
        for _ in range(4):
            for one, rows in zip(meeting.ids, rows_of_disks, strict=True):
                t = self.tracks.time[one][rows]
                if min(np.sum(t < time), np.sum(t > time)) < LEAST:
                    return few + " that are straight" * bool(cut)
            fitted = self._least_squares(meeting, rows_of_disks, cut, time)
            if isinstance(fitted, str):
                return fitted
            time = fitted.time
            kept = [
                self._straight(one, rows, time, cut)
                for one, rows in zip(meeting.ids, rows_of_disks, strict=True)
            ]
            if all(len(a) == len(b) for a, b in zip(kept, rows_of_disks, strict=True)):
                break
            rows_of_disks = kept
        return fitted if isinstance(fitted, str) or fitted.frames >= LEAST else few

    def _straight(
        self, one: int, rows: NDArray[np.int64], time: float, cut: dict[int, float]
    ) -> NDArray[np.int64]:
        """The frames of a disk up to the change points next to an impact, without those that are misread."""
        t, x = self.tracks.time[one][rows], self.tracks.position[one][rows] / self.noise.position[one]
        good = np.ones(len(rows), dtype=bool)
        for side in (-1.0, 1.0):
            out = np.flatnonzero(side * (t - time) > 0.0)
            out = out[np.argsort(side * t[out])]  # from the impact on
            n, distance = _straight_part(side * (t[out] - time), x[out])
            if n < len(out) - 1:
                cut[one] = float(t[out[n]])
            good[out[n:]] = False
            good[out[:n]] = distance < _OUTLIER
        return rows[good]

    def _least_squares(
        self,
        meeting: _Encounter,
        rows_of_disks: Sequence[NDArray[np.int64]],
        cut: Mapping[int, float],
        at: float,
    ) -> _Flights | str:
        tracks, ids, wall = self.tracks, meeting.ids, meeting.wall
        contact = sum(self.radius[one] for one in ids)
        times = [tracks.time[one][rows] for one, rows in zip(ids, rows_of_disks, strict=True)]
        positions = [tracks.position[one][rows] for one, rows in zip(ids, rows_of_disks, strict=True)]
        sigma = [self.noise.position[one] for one in ids]
        span = self.step[ids[0]]
        start = [at]
        for t, x in zip(times, positions, strict=True):
            before, after = t < at, t > at
            v, w = (np.polyfit(t[some] - at, x[some], 1) for some in (before, after))
            start += [*(0.5 * (v[1] + w[1])), *v[0], *w[0]]

        def residual(p: Array) -> Array:
            found = []
            for i, (t, x, s) in enumerate(zip(times, positions, sigma, strict=True)):
                x_c, v, w = p[1 + 6 * i : 3 + 6 * i], p[3 + 6 * i : 5 + 6 * i], p[5 + 6 * i : 7 + 6 * i]
                tau = (t - p[0])[:, None]
                found.append(((x - x_c - np.minimum(tau, 0.0) * v - np.maximum(tau, 0.0) * w) / s).ravel())
            found.append(np.array([(_distance(p, wall)[0] - contact) / (_CONTACT * contact)]))
            return np.concatenate(found)

        def jacobian(p: Array) -> Array:
            found = np.zeros((sum(2 * len(t) for t in times) + 1, len(p)))
            first = 0
            for i, (t, s) in enumerate(zip(times, sigma, strict=True)):
                tau = t - p[0]
                for axis in (0, 1):
                    rows = slice(first + axis, first + 2 * len(t), 2)
                    v, w = p[3 + 6 * i + axis], p[5 + 6 * i + axis]
                    found[rows, 0] = np.where(tau < 0.0, v, w) / s[axis]
                    found[rows, 1 + 6 * i + axis] = -1.0 / s[axis]
                    found[rows, 3 + 6 * i + axis] = -np.minimum(tau, 0.0) / s[axis]
                    found[rows, 5 + 6 * i + axis] = -np.maximum(tau, 0.0) / s[axis]
                first += 2 * len(t)
            found[-1] = _distance(p, wall)[1] / (_CONTACT * contact)
            return found

        speed = 0.01 * contact / span
        ended = least_squares(
            residual, start, jacobian, x_scale=[span, *([contact] * 2 + [speed] * 4) * len(times)]
        )
        if abs(ended.x[0] - meeting.time) > max(5.0, 0.5 * self.window) * span:
            return "no time at which flights before and after meet"
        squares = float(np.sum(ended.fun**2))
        angles = tuple(
            _turned(tracks.time[one][rows] - ended.x[0], tracks.angle[one][rows])
            if one in tracks.angle
            else None
            for one, rows in zip(ids, rows_of_disks, strict=True)
        )
        shortest = min(int(np.sum(side * (t - ended.x[0]) > 0.0)) for t in times for side in (-1.0, 1.0))
        return _Flights(
            meeting, tuple(self.disks[one] for one in ids), ended.x, ended.jac, float(ended.fun[-1]),
            float(chdtrc(len(ended.fun) - len(ended.x), squares)), angles, shortest, tuple(cut.items()),
        )  # fmt: skip


def _change_per_frame(gap: Array) -> Array:
    """The larger change (n,) of a gap (n,) from or to a neighbouring frame."""
    step = np.abs(np.diff(gap))
    return np.maximum(np.concatenate([[0.0], step]), np.concatenate([step, [0.0]]))


def _times(
    encounters: Sequence[_Encounter], further: Mapping[int, Sequence[float]]
) -> dict[int, list[float]]:
    """Times of what happens to each disk."""
    found = {one: list(times) for one, times in further.items()}
    for each in encounters:
        for one in each.ids:
            found.setdefault(one, []).append(each.time)
    return found


def _without_gaps(t: Array, rows: NDArray[np.int64], at: float, step: float) -> NDArray[np.int64]:
    """Frames on either side of a time as far as no gap parts them."""
    gaps = np.flatnonzero(np.diff(t[rows]) > 3.5 * step)
    before, after = gaps[t[rows[gaps + 1]] <= at], gaps[t[rows[gaps]] >= at]
    return rows[before[-1] + 1 if len(before) else 0 : after[0] + 1 if len(after) else None]


def _straight_part(tau: Array, x: Array) -> tuple[int, Array]:
    """Number of frames, from the first on, of one straight flight, and their squared distances from it (n,).

    Positions x (n, 2) are in units of their errors.
    """
    n = len(tau)
    while True:
        every = np.ones((1, n), dtype=bool)
        loss, distance = _line_loss(tau[:n], x[:n], every)
        if n <= LEAST or loss[0] < _CHANGE:  # two pieces cannot save more than all of it
            return n, distance[0]
        splits = np.arange(LEAST, n)
        near = np.arange(n) < splits[:, None]
        pieces = [_line_loss(tau[:n], x[:n], some)[0] for some in (near, ~near)]
        saved = loss[0] - pieces[0] - pieces[1]
        best = int(np.argmax(saved))
        if saved[best] < _CHANGE:
            return n, distance[0]
        if best == len(splits) - 1:  # one frame is no flight, but misread
            outlier = _line_loss(tau[:n], x[:n], near[-1:])[1][0]
            n -= 1
            return n, outlier[:n]
        n = int(splits[best])


def _line_loss(t: Array, x: Array, some: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Student-t loss (k,) of straight flights through some of n frames, (k, n), and squared distances (k, n)."""
    w = some.astype(np.float64)
    for _ in range(6):
        s_0, s_1, s_2 = np.sum(w, axis=1), w @ t, w @ t**2
        x_0, x_1 = w @ x, (w * t) @ x
        det = s_0 * s_2 - s_1**2
        single = det <= 1e-12 * s_0 * s_2
        det = np.where(single, 1.0, det)
        slope = np.where(single[:, None], 0.0, (s_0[:, None] * x_1 - s_1[:, None] * x_0) / det[:, None])
        at = (x_0 - s_1[:, None] * slope) / np.maximum(s_0, 1e-300)[:, None]
        distance = np.sum((x - at[:, None] - slope[:, None] * t[:, None]) ** 2, axis=-1)
        w = some * (_NU + 2.0) / (_NU + distance)
    return np.sum(some * (_NU + 2.0) * np.log1p(distance / _NU), axis=1), distance


def _distance(p: Array, wall: Wall | None) -> tuple[float, Array]:
    """Distance of the centres, or of a centre from a wall, at the impact, and its derivative by the parameters."""
    by = np.zeros(len(p))
    if wall is not None:
        away, distance = wall.normal(p[None, 1:3])
        by[1:3] = away[0]
        return float(distance[0]), by
    d = p[7:9] - p[1:3]
    D = math.hypot(*d)
    by[1:3], by[7:9] = -d / D, d / D
    return D, by


def _turned(tau: Array, angle: Array) -> tuple[Array, Array] | None:
    """Angle at the impact and spins before and after, (3,), and (A^T A)^-1 of their fit; None without enough frames."""
    good = ~np.isnan(angle)
    tau = tau[good]
    if min(np.sum(tau < 0.0), np.sum(tau > 0.0)) < LEAST:
        return None
    A = np.stack([np.ones_like(tau), np.minimum(tau, 0.0), np.maximum(tau, 0.0)], axis=-1)
    solved, *_ = np.linalg.lstsq(A, angle[good], rcond=None)
    return solved, np.linalg.inv(A.T @ A)


@dataclass(frozen=True, eq=False)
class _Flights:
    """Flights of the disks of one meeting: t_c, then x_c, y_c, v_x, v_y, v_x', v_y' of each disk; angles apart."""

    encounter: _Encounter
    disks: tuple[Disk, ...]
    parameters: Array
    jacobian: Array  # of residuals in units of their errors; the last one is the distance
    last: float  # that residual
    quality: float
    angles: tuple[tuple[Array, Array] | None, ...]
    frames: int  # of the shortest flight
    cut: tuple[tuple[int, float], ...]  # disks whose flight was cut, and times

    @property
    def time(self) -> float:
        return float(self.parameters[0])

    @property
    def covariance(self) -> Array:
        size = np.sqrt(np.sum(self.jacobian**2, axis=0))  # times, lengths and velocities
        size = np.where(size > 0.0, size, 1.0)
        J = self.jacobian / size
        return np.asarray(np.linalg.pinv(J.T @ J, hermitian=True)) / np.outer(size, size)

    @property
    def gap(self) -> float:
        """Gap at the impact, over the sum of the radii, as the flights alone give it."""
        leverage = float(self.jacobian[-1] @ self.covariance @ self.jacobian[-1])
        return self.last / max(1.0 - leverage, 1e-6) * _CONTACT

    def row(self, sigma_angle: float) -> dict[str, float] | None:
        """A line of the table; None where the disks passed each other, by their speeds along the normal."""
        p, covariance, wall = self.parameters, self.covariance, self.encounter.wall
        by: dict[str, Array] = {}  # derivatives of what is measured by the parameters
        slope = _distance(p, wall)[1]
        normal = -slope[1:3]  # to the other disk or the wall
        tangent = np.array([-normal[1], normal[0]])
        turning = np.zeros(len(p))
        if wall is None:
            D = math.hypot(*(p[7:9] - p[1:3]))
            turning[1:3], turning[7:9] = -tangent / D, tangent / D
        else:
            h = 1e-4 * float(np.asarray(self.disks[0].radius))
            moved = -wall.normal(p[1:3] + h * np.array([[1.0, 0.0], [0.0, 1.0]]))[0]
            turning[1:3] = (moved - normal) @ tangent / h
        if np.any(turning != 0.0):
            by["normal"] = turning
        approach, parting = np.zeros(len(p)), np.zeros(len(p))
        for i, sign in zip(range(len(self.disks)), (1.0, -1.0), strict=False):
            approach[3 + 6 * i : 5 + 6 * i] = sign * normal
            parting[5 + 6 * i : 7 + 6 * i] = sign * normal
        error = {
            name: math.sqrt(max(float(each @ covariance @ each), 0.0))
            for name, each in (("speed", approach), ("change", approach - parting), ("normal", turning))
        }
        speed, left = float(approach @ p), float(parting @ p)
        if (
            speed < _SURE * error["speed"]
            or left > _SURE * error["speed"] + 0.02 * speed
            or speed - left < _SURE * error["change"]
            or error["normal"] > _NORMAL
        ):
            return None
        row: dict[str, float] = {"t": self.time}
        row |= {f"id_{i}": one for i, one in enumerate(self.encounter.ids, start=1)}
        row |= {"quality": self.quality, "nx": float(normal[0]), "ny": float(normal[1])}
        for i in range(len(self.disks)):
            for k, name in enumerate(("vx_{}", "vy_{}", "vx_{}_after", "vy_{}_after"), start=3 + 6 * i):
                by[name.format(i + 1)] = np.eye(len(p))[k]
        row |= {name: float(each @ p) for name, each in by.items() if name != "normal"}
        names, T = list(by), np.array(list(by.values()))
        C = T @ covariance @ T.T
        for name, each in zip(names, np.sqrt(np.diag(C)), strict=True):
            for key in NORMAL if name == "normal" else (name,):
                row[f"{key}_error"] = float(each)
        if "normal" not in by:
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
        if wall is not None:
            row |= {"mass_2": math.inf, "radius_2": row["radius_1"]}
        return row


def _columns(rows: Sequence[Mapping[str, float]]) -> dict[str, Array]:
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: np.array([row.get(name, math.nan) for row in rows]) for name in names}


def _spin_warnings(tables: Sequence[Mapping[str, Array]], source: str) -> list[str]:
    """Warnings of the response of spins to impacts; InputError where an axis runs the other way.

    A tangential impulse P changes v_t of disk 1 by -P / m and its spin by -k P / (m R), so that R dw / k = dv_t of disk
    1, and -dv_t of disk 2, under every law without rolling friction.
    """
    ratio, weight = [np.empty(0)], [np.empty(0)]
    for columns in tables:
        for i, sign in ((1, 1.0), (2, -1.0)):
            if f"spin_{i}_after" not in columns:
                continue
            R_k = columns[f"radius_{i}"] / columns[f"k_{i}"]
            x = [columns[f"v{a}_{i}_after"] - columns[f"v{a}_{i}"] for a in "xy"]
            dv = sign * (columns["nx"] * x[1] - columns["ny"] * x[0])
            dw = R_k * (columns[f"spin_{i}_after"] - columns[f"spin_{i}"])
            s_v = np.hypot(columns[f"vx_{i}_error"], columns[f"vx_{i}_after_error"])
            s_w = R_k * np.hypot(columns[f"spin_{i}_error"], columns[f"spin_{i}_after_error"])
            clear = (np.abs(dv) > 8.0 * s_v) & ~np.isnan(dw) & (columns["quality"] > POOR)
            ratio.append(dw[clear] / dv[clear])
            weight.append(np.abs(dv[clear]) / np.hypot(s_w[clear], s_v[clear]))
    r = np.concatenate(ratio)
    if len(r) < 5 or float(np.median(np.concatenate(weight))) < 1.0:
        return []
    slope = float(np.median(r))
    error = 1.4826 * float(np.median(np.abs(r - slope))) * math.sqrt(1.6 / len(r))
    text = f"{source}: spins respond to impacts with {slope:.3g} +- {error:.2g} times what the impulses give"
    if slope < -5.0 * error:
        flips = option_name("--flip y or --flip angle", "flip = ['y'] or ['angle']")
        raise InputError(f"{text}: y points down or angles run clockwise; {flips} reverses one of them")
    if abs(slope - 1.0) < 0.1 + 5.0 * error:
        return []
    for factor, unit in ((180.0 / math.pi, "deg"), (math.pi / 180.0, "rad")):
        if 0.8 < slope / factor < 1.25:
            how = option_name(f"--unit angle={unit}", f"units = {{'angle': '{unit}'}}")
            raise InputError(f"{text}: angles are in another unit; {how} says so")
    return [f"{text}: k, the radii, the unit of angles or of positions is wrong"]
