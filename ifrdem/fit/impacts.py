"""Collisions from tracks: impacts in positions per frame, with the flights before and after.

Two disks have collided where their distance has a minimum near the sum of their radii; a disk has hit a wall where its
distance from the wall has one near its radius. There, the flights before and after are fitted (`meeting`), with the
law by which the tray slows disks down (`flight`), which all flights of the film give (`tray`). Flights end at other
impacts of the disk, and where a change point makes two pieces far more likely than one, under Student-t noise. Normal,
velocities and spins share x_c and t_c, so that their errors are correlated; the table has the covariances.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from ..errors import InputError, counted, option_name, refuse
from ..model.walls.wall import Wall
from .data import Disk
from .flight import LAWS, Tray
from .meeting import CONTACT, LEAST, Flights, Side
from .meeting import fitted as fitted_flights
from .tracks import (
    GAP,
    Array,
    Exchange,
    Noise,
    Tracks,
    cause_of_none,
    exchanged,
    exchanges_in,
    nearest_pair,
    noise,
    of_unknown_size,
)
from .tray import DIFFER, LEAST_FRAMES, LONGEST, Piece, TrayEstimate, estimate, frames_at_rest

WINDOWS = (6, 30)
"""Least and largest number of frames of a flight that are used at most, unless it is given."""

FRICTIONS = ("estimate", "none", *LAWS)
"""Names by which the law of flight is chosen, where its constants are not given."""

POOR = 0.01
"""Quality below which a collision is not used by default: something else has changed its flights."""

_CHANGE = 40.0  # loss that a change point must save: by chance in one of some 1,000 flights
_OUTLIER = 30.0  # squared distance of a frame, in units of its errors, that counts as misread
_DEEP = 8.0  # errors by which a distance is less at an encounter than between it and the next one
_KINDS = "kinds of disks"
_TOUCH = 6.0  # errors of a gap that may be none
_NU = 4.0  # degrees of freedom of the Student-t noise
_SHORT = 12  # frames of a flight that are always enough
_RESTS = 10.0  # errors by which a disk that moves would have left its place
_STRAYS = 5.0  # errors by which frames of a disk at rest stray from their mean
_HIDDEN = 4.0, 0.25  # errors by which a disk moves before frames tell that it does, and that do not matter
_SLOW = 4.0  # errors of a velocity that may be none
_EXACT_ANGLE = 1e-6  # error of angles that do not scatter [rad]
_FEW = f"a flight has fewer than {LEAST} frames"
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
    tray: TrayEstimate | None  # how flights slow down; None if it was given, or no flight is long enough
    trays: Mapping[
        tuple[float, float, float], TrayEstimate
    ]  # the same by (mass, radius, k) of disks, if these differ
    window: int  # frames of a flight that were used at most
    tracks: Tracks
    step: float  # time between two frames
    friction: str | Tray  # as it was asked for

    def __len__(self) -> int:
        """The number of collisions."""
        return sum(len(each["t"]) for each in (self.pairs, self.walls) if each)

    @property
    def reasons(self) -> Mapping[str, int]:
        """Numbers of encounters left out and of flights cut, by reason."""
        return Counter(each.reason for each in (*self.left_out, *self.cut))

    @property
    def poor(self) -> Mapping[str, int]:
        """Numbers of collisions that a fit leaves out, and of those with angles that do not fit."""
        tables = [each for each in (self.pairs, self.walls) if each]
        angles = [each["quality_angles"][each["quality"] >= POOR] for each in tables]
        return {
            f"of quality below {POOR:g}, which `ifrdem fit` leaves out": int(
                sum(np.sum(each["quality"] < POOR) for each in tables)
            ),
            f"with spins of quality below {POOR:g}": int(sum(np.sum(each < POOR) for each in angles)),
        }

    def tray_text(self) -> list[str]:
        """Lines on the law of flight."""
        found = [
            f"disks of {mass:g} kg and {radius:g} m: {each.text()}"
            for (mass, radius, _), each in self.trays.items()
        ]
        if isinstance(self.friction, Tray):
            found.append(f"the tray is given: {self.friction.text()}")
        elif self.friction == "none":
            found.append("flights are taken as straight")
        elif self.tray is None:
            found.append("flights are taken as straight: none has frames enough to tell how they slow down")
        elif not found:
            found.append(self.tray.text())
        used = self.tray is not None and self.tray.names and self.friction != "none"
        if used and (moves := self.common_error) > 0.0:
            found.append(
                f"the error of these constants is common to all impacts and moves e_n by less than {moves:.1g}"
            )
        return [*found, f"at most {self.window} frames of a flight are used"]

    @property
    def common_error(self) -> float:
        """By how much the error of the deceleration moves e_n, as of the median impact.

        An error da moves both velocities along the normal by da T/2 at most, T the time of a flight, and so e_n by
        (1 + e_n) da T/(2 v_n).
        """
        if self.tray is None:
            return 0.0
        speeds = [
            np.abs(sum((c[f"v{a}_1"] - c.get(f"v{a}_2", 0.0)) * c[f"n{a}"] for a in "xy"))
            for c in (self.pairs, self.walls)
            if c
        ]
        v_n = float(np.median(np.concatenate(speeds)))
        return self.tray.slowing[1] * self.window * self.step / v_n

    def report(self) -> str:
        """Encounters that were left out and flights that were cut, as CSV, with the law of flight as comments."""
        head = [f"# {text}" for text in self.tray_text()]
        clips, rows = len(self.tracks.clips) > 1, []
        for each in sorted((*self.left_out, *self.cut), key=lambda each: each.time):
            number, time = self.tracks.when(each.time)
            other = each.ids[1] if len(each.ids) > 1 else ""
            rows.append(f"{time:.6g},{f'{number},' * clips}{each.ids[0]},{other},{each.reason}")
        return "\n".join((*head, f"t,{'clip,' * clips}id_1,id_2,reason", *rows)) + "\n"


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
    window: int | None = None,
    error: float | None = None,
    repair_swaps: bool = False,
    friction: str | Tray = "estimate",
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
    window : int, optional
        Frames of a flight that are used at most; by default those for which errors of the law of flight count as much
        as those of positions.
    error : float, optional
        Standard error of a coordinate of a position [length]; by default from the scatter of the tracks.
    repair_swaps : bool
        Undo exchanges of ids between two tracks; otherwise impacts after an exchange have quality 0.
    friction : str or Tray
        How the tray slows disks down: "estimate", from all flights; "plain", "coin" or "ring", under this law only;
        "none", straight flights; or a `Tray` that is known.
    """
    problems = []
    if not isinstance(friction, Tray) and friction not in FRICTIONS:
        problems.append(f"friction = {friction!r}: must be a Tray or one of {', '.join(FRICTIONS)}")
    coupled = (
        friction.coupled if isinstance(friction, Tray) else friction not in ("estimate", "none", "plain")
    )
    if coupled and not tracks.angle:
        how = option_name("--friction", "friction")
        problems.append(
            f"{how} {friction}: requires angles of the disks, as their spins change how they slow down"
        )
    if window is not None and window < LEAST:
        problems.append(f"window = {window}: must be at least {LEAST} frames")
    if error is not None and not 0.0 < error < math.inf:
        problems.append(f"{option_name('--noise', 'error')} = {error:g}: must be a positive finite number")
    moving = [wall for wall in walls if wall.changes_with_time or wall.piston is not None]
    problems += [f"{wall.shape} wall: must be at rest" for wall in moving]
    known = dict.fromkeys(tracks.time, disks) if isinstance(disks, Disk) else disks
    problems += of_unknown_size(tracks, known)
    refuse(problems)
    known = {one: known[one] for one in tracks.time}
    radius = {one: float(np.asarray(disk.radius)) for one, disk in known.items()}
    exchanges = exchanges_in(tracks, radius)
    if repair_swaps:
        tracks = exchanged(tracks, exchanges)
    finder = _Finder(tracks, known, radius, walls, window, error, () if repair_swaps else exchanges, friction)
    return finder.found(tuple(exchanges), repair_swaps)


@dataclass(frozen=True, eq=False)  # each is one object: hashes of its wall would cost more than the fits
class _Encounter:
    ids: tuple[int, ...]
    time: float
    wall: Wall | None = None


_Result = tuple[Flights | str, dict[int, float]]
"""The flights of a meeting, or why there are none, and times at which they were cut, by disk."""


@dataclass(frozen=True)
class _Rest:
    """Rest of a disk before an impact by its frames: of its centre, and of its spin."""

    certain: tuple[bool, bool]
    perhaps: tuple[bool, bool]
    frames: int  # next to the impact, in which it rests if it rests at the impact; 0 if it moves
    # Error of a velocity and a spin, from straight flights through all frames in which it keeps its place, of which
    # `frames` may be a part: if it moves at the impact, it moves in all of them.
    slow: tuple[float, float]


class _Finder:
    """Search for impacts in one set of tracks."""

    def __init__(
        self,
        tracks: Tracks,
        disks: Mapping[int, Disk],
        radius: Mapping[int, float],
        walls: Sequence[Wall],
        window: int | None,
        error: float | None,
        exchanges: Sequence[Exchange],
        friction: str | Tray,
    ) -> None:
        self.tracks, self.disks, self.radius = tracks, disks, radius
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
        self.friction = friction
        self.estimate: TrayEstimate | None = None
        self.of_kinds: dict[tuple[float, float, float], TrayEstimate] = {}
        self.trays = dict.fromkeys(disks, friction if isinstance(friction, Tray) else Tray())
        if not isinstance(friction, Tray):
            self._estimate(friction)
        self.window = window or self._best_window()

    def _kind(self, one: int) -> tuple[float, float, float]:
        mass, radius, k = (
            float(np.asarray(getattr(self.disks[one], key))) for key in ("mass", "radius", "k")
        )
        return mass, radius, k

    def _estimate(self, friction: str) -> None:
        """The law of the tray from all flights; for each kind of disks, if they differ."""
        law = "estimate" if friction == "none" else friction
        kinds = list(dict.fromkeys(map(self._kind, sorted(self.disks))))
        pieces = self._pieces(kinds)
        if not pieces:
            return
        self.estimate = estimate(pieces, law)
        if friction == "none":
            return
        self.trays = dict.fromkeys(self.disks, self.estimate.tray)
        if self.estimate.differences.get(_KINDS, 1.0) > DIFFER:
            return
        self.of_kinds = {
            kind: estimate([each for each in pieces if each.group[_KINDS] == i], law)
            for i, kind in enumerate(kinds)
        }
        self.trays = {one: self.of_kinds[self._kind(one)].tray for one in self.disks}

    def _pieces(self, kinds: Sequence[tuple[float, float, float]]) -> list[Piece]:
        """Flights of each disk between its encounters."""
        found, tracks = [], self.tracks
        places = np.concatenate([*tracks.position.values()])
        middle = np.median(places, axis=0)
        times = np.concatenate([*tracks.time.values()])
        thirds = np.quantile(times, [1.0 / 3.0, 2.0 / 3.0])
        for one, t in tracks.time.items():
            step, x = self.step[one], tracks.position[one]
            angle = tracks.angle.get(one) if math.isfinite(self.noise.angle) else None
            events = [each.time for each in self.of[one]] + self.exchanged_at.get(one, [])
            events += [float(each) for _, touching in self.touching[one] for each in touching]
            ends = np.array([-math.inf, *sorted(events), math.inf])
            number = np.searchsorted(ends, t)
            clear = np.minimum(t - ends[number - 1], ends[number] - t) > 1.01 * step
            index = np.flatnonzero(clear if angle is None else clear & ~np.isnan(angle))
            if len(index) < LEAST_FRAMES:
                continue
            most = max(round(LONGEST / step), _SHORT)
            parts = np.flatnonzero((np.diff(number[index]) != 0) | (np.diff(t[index]) > GAP * step)) + 1
            for part in np.split(index, parts):
                for rows in np.array_split(part, max(1, math.ceil(len(part) / most))):
                    if len(rows) < LEAST_FRAMES:
                        continue
                    centre, begin = np.mean(x[rows], axis=0), t[rows[0]]
                    group = {
                        _KINDS: kinds.index(self._kind(one)),
                        "quarters of the tray": int(2 * (centre[0] > middle[0]) + (centre[1] > middle[1])),
                        "thirds of the film": int(np.sum(begin > thirds)),
                    }
                    found.append(
                        Piece(
                            t[rows] - begin, x[rows], None if angle is None else angle[rows],
                            self.noise.position[one], self.noise.angle, self.radius[one], self._kind(one)[2], group,
                        )
                    )  # fmt: skip
        return found

    def _best_window(self) -> int:
        """Frames for which errors of the deceleration cost a mean over all impacts as much as those of positions.

        The error of a velocity falls with n frames as n^-3/2, and an error da of the deceleration moves all velocities
        by da n dt/2: the least sum has n^5 = 72/N (sigma/(da dt^2))^2 over N impacts.
        """
        if self.estimate is None or self.friction == "none":
            return _SHORT
        step = float(np.median([*self.step.values()]))
        over = self.noise.typical / (self.estimate.slowing[1] * step**2)
        n = (72.0 / max(len(self.encounters), 1) * over**2) ** 0.2
        return int(np.clip(round(n), *WINDOWS))

    def _rest(self, one: int, rows: NDArray[np.int64], at: float) -> _Rest:
        """Rest of a disk before an impact, by the frames before it, the nearest ones first.

        It does for certain if it has one place in n frames next to it, and a disk that moves, however slowly, would
        have left that place: by a T^2/2 at least, T the time of these frames and a the deceleration. It moves for
        certain if it was farther away before than the deceleration allows.
        """
        tray, tracks, R = self.trays[one], self.tracks, self.radius[one]
        before = rows[tracks.time[one][rows] < at - 0.01 * self.step[one]][::-1]
        away = at - tracks.time[one][before]
        own, k = self.noise.position[one], self._kind(one)[2]
        errors = float(np.max(own)), self.noise.angle
        parts = [tracks.position[one][before] / own]
        if one in tracks.angle and math.isfinite(errors[1]):
            parts.append(tracks.angle[one][before][:, None] / errors[1])
        leaving, frames = tray.leaving(R, k, *errors), [0, 0]
        for i, x in enumerate(parts):
            n = frames_at_rest(x) if leaving[i] > 0.0 else 0
            if n < LEAST:
                continue
            # It is at rest in the nearest frames, and may have stopped just before them.
            time = np.maximum(away - away[LEAST - 1], 0.0)
            if _could_stop(x, n, tray.stopping(time, R, k, float(np.min(own)), errors[1])[i]):
                frames[i] = n
        if tray.coupled:  # both stop together
            frames = [min(frames)] * 2
        certain = [
            n > 0 and a * float(away[n - 1]) ** 2 / 2.0 >= _RESTS
            for n, a in zip(frames, leaving, strict=True)
        ]
        perhaps = [n > 0 and not sure for n, sure in zip(frames, certain, strict=True)]
        slow = [
            error * math.sqrt(12.0 / (n * (n * n - 1.0))) / self.step[one] if n else 0.0
            for n, error in zip(frames, errors, strict=True)
        ]
        # The farthest of these frames may be those of a disk that was about to stop; not if they are all that there are,
        # as no frame shows then that it moved before.
        still = [
            n if n == len(before) else _still(away[:n], *(math.sqrt(2.0 * part / a) for part in _HIDDEN))
            for n, a in zip(frames, leaving, strict=True)
            if n
        ]
        least = max(min(still), LEAST) if still else 0
        return _Rest((certain[0], certain[1]), (perhaps[0], perhaps[1]), least, (slow[0], slow[1]))

    def _noise(self, events: Mapping[int, Sequence[float]], error: float | None) -> Noise:
        tracks, found = self.tracks, noise(self.tracks, events)
        if error is not None:
            found = Noise(dict.fromkeys(self.disks, np.full(2, error)), error, found.angle)
        if math.isnan(found.typical):
            missing = f"; {tracks.missing} lines have no position" * bool(tracks.missing)
            text = f"no disk has 4 frames at equal steps{missing}"
            raise InputError(f"{tracks.source}: no impact was found: {text}")
        if not found.typical > 1e-9 * min(self.radius.values()):
            how = option_name("--noise", "error")
            text = f"{how}: must be given, as the positions do not scatter about the flights"
            raise InputError(f"{tracks.source}: {text}")
        return replace(found, angle=max(found.angle, _EXACT_ANGLE)) if math.isfinite(found.angle) else found

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
                    near = _change_per_frame(both, gap, GAP * self.step[a])
                    touched |= bool(np.any(gap < near + _WRONG_SIZE * contact))
                    found += self._minima((a, b), both, gap, None)
        if not touched and not any(each.wall for each in found):
            cause = cause_of_none(tracks, self.radius, with_walls=bool(walls))
            raise InputError(f"{tracks.source}: no impact was found: {cause}")
        return sorted(found, key=lambda each: each.time)

    def _minima(self, ids: tuple[int, ...], t: Array, gap: Array, wall: Wall | None) -> list[_Encounter]:
        """Minima near contact, deeper than noise makes them."""
        if len(t) < 2 * LEAST:
            return []
        near = _change_per_frame(t, gap, GAP * self.step[ids[0]])
        touching = t[gap < _TOUCH * self.noise.typical + 0.5 * near]
        for one in ids:
            self.touching[one].append(((ids, wall), touching))
        found = []
        ends = np.flatnonzero(np.diff(t) > GAP * self.step[ids[0]]) + 1
        for rows in np.split(np.arange(len(t)), ends):  # what happens while nothing is seen is no encounter
            lowest, _ = find_peaks(-gap[rows], prominence=_DEEP * self.noise.typical)
            lowest = rows[lowest]
            is_near = gap[lowest] < 1.5 * near[lowest] + 0.15 * self.radius[ids[0]]
            found += [_Encounter(ids, float(t[k]), wall) for k in lowest[is_near]]
        return found

    def found(self, exchanges: tuple[Exchange, ...], repaired: bool) -> FoundCollisions:
        """All impacts; InputError if there is none, or they contradict what was given."""
        times: dict[_Encounter, float] = {each: each.time for each in self.encounters}
        known: dict[tuple[_Encounter, tuple[tuple[float, float], ...]], _Result] = {}
        for _ in range(
            3
        ):  # flights end where other encounters of the disk are found to be, if they are impacts
            before, missed = dict(times), set[_Encounter]()
            fits, left_out, cut = [], [], []
            for each in self.encounters:
                bounds = tuple(self._between(before, each, one) for one in each.ids)
                if (each, bounds) not in known:
                    known[each, bounds] = self._fitted(each, bounds)
                fitted, cut_at = known[each, bounds]
                if isinstance(fitted, str):
                    left_out.append(LeftOut(fitted, each.ids, each.time))
                    continue
                if abs(fitted.time - each.time) > 0.5 * self.step[each.ids[0]]:
                    times[each] = fitted.time
                if (row := fitted.row()) is None:
                    if fitted.quality > POOR and fitted.frames >= min(self.window, _SHORT):
                        missed.add(each)
                    left_out.append(LeftOut("passed by without an impact", each.ids, each.time))
                    continue
                if any(self._after_exchange(one, fitted.time) for one in each.ids):
                    row["quality"] = 0.0
                clip, time = self.tracks.when(fitted.time)
                number = {"clip": clip} if len(self.tracks.clips) > 1 else {}
                fits.append((each, fitted, {"t": time, **number, **_ids(each), **row}))
                cut += [
                    LeftOut("flight has a change point: cut", (one,), time) for one, time in cut_at.items()
                ]
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
            elif 2.0 < nearest < math.inf:
                why += f"; {cause_of_none(self.tracks, self.radius, with_walls=False)}"
            raise InputError(f"{source}: no impact was found{why}")
        bent = self._not_of_the_law()
        of_pairs = [(each.ids, fitted.gap) for each, fitted, _ in fits if each.wall is None]
        sizes = [] if bent else [*self._of_sizes(of_pairs)]
        pairs, walls = (
            _columns([row for each, _, row in fits if (each.wall is not None) is with_wall])
            for with_wall in (False, True)
        )
        warnings = _spin_warnings((pairs, walls), source, be_silent=bool(bent))
        short = sum(each.reason.startswith(_FEW) for each in left_out)
        if short > len(fits):
            text = f"in {short} encounters {_FEW}; {counted(len(fits), 'impact')} were found"
            warnings.append(f"{source}: {text}. Film at more frames per second, or with fewer disks")
        return FoundCollisions(
            pairs, walls, self.noise, tuple(left_out), tuple(cut), exchanges, repaired,
            (*bent, *self._of_unseen_spins(), *sizes, *warnings), self.estimate, self.of_kinds, self.window, self.tracks, float(np.median([*self.step.values()])), self.friction,
        )  # fmt: skip

    def _after_exchange(self, one: int, time: float) -> bool:
        """True if a disk has exchanged its id before a time of the same clip."""
        clip = self.tracks.clip(time)
        return any(at <= time and self.tracks.clip(at) == clip for at in self.exchanged_at.get(one, ()))

    def _not_of_the_law(self) -> tuple[str, ...]:
        """Warnings on flights that the law does not describe: no other cause is named then."""
        found, source = self.estimate, self.tracks.source
        if found is None:
            return ()
        if self.friction == "none" and found.names:
            how = option_name("--friction estimate", "friction = 'estimate'")
            return (
                f"{source}: {found.text()}: velocities and spins at impacts are wrong; {how} takes it into account",
            )
        several = self.of_kinds.values() or (found,)
        texts = dict.fromkeys(text for each in several for text in each.warnings())
        return tuple(f"{source}: {text}" for text in texts)

    def _of_unseen_spins(self) -> tuple[str, ...]:
        """A warning if spins may change how disks slow down, but no angle was tracked."""
        found = self.estimate
        if self.tracks.angle or found is None or self.friction == "none" or found.tray.a0 <= 0.0:
            return ()
        text = (
            "angles were not tracked: the spins of disks that lie flat on the tray change how they slow down"
        )
        return (f"{self.tracks.source}: {text}",)

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

    def _of_sizes(self, fits: Sequence[tuple[tuple[int, ...], float]]) -> Iterator[str]:
        """Warnings if the paths of disks with some radii turn at another distance than their sum; InputError if far."""
        of_radii: dict[tuple[float, ...], list[float]] = {}
        for ids, gap in fits:
            of_radii.setdefault(tuple(sorted(self.radius[one] for one in ids)), []).append(gap)
        for (a, b), values in of_radii.items():
            gaps = np.array(values)
            off = float(np.median(gaps))
            scatter = 1.4826 * float(np.median(np.abs(gaps - off))) / math.sqrt(len(gaps))
            if len(gaps) < 3 or abs(off) < max(CONTACT, 4.0 * scatter):
                continue
            text = (
                f"{self.tracks.source}: the paths of disks of radii {a:g} and {b:g} turn at {1.0 + off:.3g} times "
                f"the sum of their radii (median of {len(gaps)} impacts, error {scatter:.2g}): the radii or the "
                "unit of x and y are wrong"
            )
            if abs(off) > _WRONG_SIZE:
                raise InputError(text)
            yield f"{text} by that much; normals of oblique impacts too"

    def _fitted(self, meeting: _Encounter, bounds: Sequence[tuple[float, float]]) -> _Result:
        """The flights of a meeting between the times of other events of each disk."""
        at, rows_of_disks, rests = meeting.time, [], []
        for one, (low, high) in zip(meeting.ids, bounds, strict=True):
            t = self.tracks.time[one]
            step = self.step[one]
            inside = (t > low + 0.51 * step) & (t < high - 0.51 * step)
            rows = _without_gaps(t, np.flatnonzero(inside), at, step)
            rests.append(self._rest(one, rows, at))
            before, after = rows[t[rows] < at], rows[t[rows] > at]
            rows = np.concatenate([before[-self.window :], rows[t[rows] == at], after[: self.window]])
            rows_of_disks.append(
                self._resting_rows(one, rows, at, rests[-1]) if any(rests[-1].certain) else rows
            )
        cut = dict[int, float]()
        fitted: Flights | str = ""
        time = at
        certain = [rest.certain for rest in rests]
        for _ in range(4):
            for one, rows in zip(meeting.ids, rows_of_disks, strict=True):
                t = self.tracks.time[one][rows]
                if min(np.sum(t < time), np.sum(t > time)) < LEAST:
                    return _FEW + " without a change point" * bool(cut), cut
            fitted = self._joint(meeting, rows_of_disks, certain, time)
            if isinstance(fitted, str):
                return fitted, cut
            time = fitted.time
            kept = [
                self._of_one_flight(one, rows, time, cut, bent)
                for one, rows, bent in zip(meeting.ids, rows_of_disks, fitted.bent, strict=True)
            ]
            if all(len(a) == len(b) for a, b in zip(kept, rows_of_disks, strict=True)):
                break
            rows_of_disks = kept
        if isinstance(fitted, str) or fitted.frames < LEAST:
            return (fitted if isinstance(fitted, str) else _FEW), cut
        return self._doubted(meeting, fitted, rows_of_disks, rests), cut

    def _resting_rows(self, one: int, rows: NDArray[np.int64], at: float, rest: _Rest) -> NDArray[np.int64]:
        """Frames without those before a disk has come to rest."""
        before = int(np.sum(self.tracks.time[one][rows] < at - 0.01 * self.step[one]))
        return rows[max(before - rest.frames, 0) :]

    def _doubted(
        self,
        meeting: _Encounter,
        moving: Flights,
        rows_of_disks: Sequence[NDArray[np.int64]],
        rests: Sequence[_Rest],
    ) -> Flights:
        """Flights where it is not certain whether a disk moved before, by that branch which fits better.

        The two do not join: a disk at rest stays, one that moves at the impact, however slowly, came from a T^2/2 away.
        Its motion before then has an error that covers both.
        """
        best, doubts = moving, dict[int, tuple[float, float]]()
        for i, rest in enumerate(rests):
            if not any(rest.perhaps):
                continue
            spin_at = moving.spin_at[i]
            v = float(np.hypot(*moving.parameters[3 + 6 * i : 5 + 6 * i]))
            w = 0.0 if spin_at is None else abs(float(moving.parameters[spin_at + 1]))
            slow = [
                perhaps and value < _SLOW * error
                for perhaps, value, error in zip(rest.perhaps, (v, w), rest.slow, strict=True)
            ]
            if moving.sides[i].tray.coupled and not all(slow):
                continue
            if not any(slow):
                continue
            certain = [each.certain for each in rests]
            certain[i] = (rest.certain[0] or slow[0], rest.certain[1] or slow[1])
            rows = [*rows_of_disks]
            rows[i] = self._resting_rows(meeting.ids[i], rows[i], meeting.time, rest)
            t = self.tracks.time[meeting.ids[i]][rows[i]]
            if min(np.sum(t < moving.time), np.sum(t > moving.time)) < LEAST:
                continue
            resting = self._joint(meeting, rows, certain, moving.time)
            if isinstance(resting, str) or resting.frames < LEAST:
                continue
            doubts[i] = (
                math.hypot(v, rest.slow[0]) if slow[0] else 0.0,
                math.hypot(w, rest.slow[1]) if slow[1] else 0.0,
            )
            if resting.quality_of_all > best.quality_of_all:
                best = resting
        for i, doubt in doubts.items():
            best = best.doubting(i, doubt)
        return best

    def _of_one_flight(
        self, one: int, rows: NDArray[np.int64], time: float, cut: dict[int, float], bent: Array
    ) -> NDArray[np.int64]:
        """The frames of a disk up to the change points next to an impact, without those that are misread.

        `bent` (n, 2) is what the tray adds to straight flights.
        """
        t = self.tracks.time[one][rows]
        x = (self.tracks.position[one][rows] - bent) / self.noise.position[one]
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

    def _joint(
        self,
        meeting: _Encounter,
        rows_of_disks: Sequence[NDArray[np.int64]],
        rests: Sequence[tuple[bool, bool]],
        at: float,
    ) -> Flights | str:
        """The fit of some frames of each disk, or why there is none."""
        sides, tracks = [], self.tracks
        for one, rows, rest in zip(meeting.ids, rows_of_disks, rests, strict=True):
            angle = tracks.angle.get(one)
            side = Side(
                self.disks[one], self.trays[one], tracks.time[one][rows], tracks.position[one][rows],
                None if angle is None else angle[rows], self.noise.position[one], self.noise.angle, rest,
            )  # fmt: skip
            if side.tray.coupled and side.turned(at) is None:
                return "angles are missing, and spins change how disks slow down"
            sides.append(side)
        span = self.step[meeting.ids[0]]
        found = fitted_flights(sides, meeting.wall, at, span)
        if abs(found.time - meeting.time) > max(5.0, 0.5 * min(self.window, _SHORT)) * span:
            return "no time at which flights before and after meet"
        return found


def _could_stop(x: Array, n: int, farthest: Array) -> bool:
    """True if a disk that has one place in the nearest n frames was nowhere beyond the distance from which it can stop.

    x (m, d) and the largest distances (m,) in units of errors; one frame may be misread.
    """
    farther = np.sqrt(np.sum((x - np.nanmean(x[:n], axis=0)) ** 2, axis=1))
    return int(np.sum(farther > 1.5 * farthest + _STRAYS)) <= 1


def _still(away: Array, hidden: float, unseen: float) -> int:
    """Number of frames, at times (n,) before an impact, without those within a time `hidden` of the farthest one.

    All frames within a time `unseen` of the impact are kept.
    """
    return int(np.searchsorted(away, max(away[-1] - hidden, unseen), side="right"))


def _ids(encounter: _Encounter) -> dict[str, float]:
    """Columns of ids."""
    return {f"id_{i}": one for i, one in enumerate(encounter.ids, start=1)}


def _change_per_frame(t: Array, gap: Array, longest: float) -> Array:
    """The larger change (n,) of a gap (n,) from or to a neighbouring frame that is not farther away than `longest`."""
    step = np.where(np.diff(t) > longest, 0.0, np.abs(np.diff(gap)))
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
    gaps = np.flatnonzero(np.diff(t[rows]) > GAP * step)
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


def _columns(rows: Sequence[Mapping[str, float]]) -> dict[str, Array]:
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: np.array([row.get(name, math.nan) for row in rows]) for name in names}


def _spin_warnings(tables: Sequence[Mapping[str, Array]], source: str, *, be_silent: bool) -> list[str]:
    """Warnings of the response of spins to impacts; InputError where an axis runs the other way.

    A tangential impulse P changes v_t of disk 1 by -P / m and its spin by -k P / (m R), so that R dw / k = dv_t of disk
    1, and -dv_t of disk 2, under every law without rolling friction. `be_silent` where flights are known to be wrong.
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
    if be_silent or abs(slope - 1.0) < 0.1 + 5.0 * error:
        return []
    for factor, unit in ((180.0 / math.pi, "deg"), (math.pi / 180.0, "rad")):
        if 0.8 < slope / factor < 1.25:
            how = option_name(f"--unit angle={unit}", f"units = {{'angle': '{unit}'}}")
            raise InputError(f"{text}: angles are in another unit; {how} says so")
    return [f"{text}: k, the radii, the unit of angles or of positions is wrong"]
