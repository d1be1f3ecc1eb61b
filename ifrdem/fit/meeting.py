"""One fit of the flights of the disks that meet, before and after an impact: positions and angles together.

    x(t) = x_c + S(min(t - t_c, 0); v, w) + S(max(t - t_c, 0); v', w'),   |x_c2 - x_c1| = R_1 + R_2,

with the law S of flight on the tray (`flight`), and the same for the angle of each disk that was tracked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ..model.walls.wall import Wall
from .data import NORMAL, Disk
from .flight import Tray
from .model import DIRECTION

Array = NDArray[np.float64]

LEAST = 3
"""Frames of a flight that are needed at least."""
CONTACT = 5e-3
"""Relative error of the sum of two radii as they are given."""

_SURE = 4.0  # errors by which an impact must change the velocity along the normal
_NORMAL = 0.1  # largest error of the normal of an impact [rad]
_NEAR = 6  # frames from which a velocity is guessed
_ENOUGH = 1e-4  # gain of chi-square below which the search ends: 1 % of a standard error
_STEPS = 40
_TURNS_BACK = (
    4.0  # times the spin that turns a disk by its error until it stops: beyond it the sense is clear
)
_UNCLEAR = 6.0  # a distance to the stop of three errors
_KNOWN = 0.2  # error of a velocity or spin at rest, over the least one of the impact
_WALL_ERROR = 1e-5  # of the normal of a straight wall, which is known much better than a flight [rad]


@dataclass(frozen=True, eq=False)
class Side:
    """One of the disks that meet: its frames, and the law of its flight."""

    disk: Disk
    tray: Tray
    t: Array  # (n,): times of frames, ascending
    x: Array  # (n, 2): positions [length]
    angle: Array | None  # (n,): angles [rad], NaN where one is missing
    sigma: Array  # (2,): errors of positions
    sigma_angle: float
    rests: tuple[bool, bool] = (False, False)  # its centre and its spin are at rest before the impact
    # errors [length/time, rad/time] of the motion before, where the frames do not tell rest from motion; 0 where they do
    doubt: tuple[float, float] = (0.0, 0.0)

    @property
    def R(self) -> float:
        """Radius [length]."""
        return float(np.asarray(self.disk.radius))

    @property
    def k(self) -> float:
        """Shape number."""
        return float(np.asarray(self.disk.k))

    @cached_property
    def leaving(self) -> tuple[float, float]:
        """Least decelerations of centre and angle to rest, see `Tray.leaving`."""
        return self.tray.leaving(self.R, self.k, *self.errors)

    @property
    def errors(self) -> tuple[float, float]:
        """Errors of a coordinate [length] and of an angle [rad]."""
        return float(np.min(self.sigma)), self.sigma_angle

    def after(self, at: float) -> float:
        """Time from an impact to the last frame."""
        return float(self.t[-1]) - at

    def turned(self, at: float) -> NDArray[np.int64] | None:
        """Frames with an angle, if there are enough before and after a time."""
        if self.angle is None or not math.isfinite(self.sigma_angle):
            return None
        good = np.flatnonzero(~np.isnan(self.angle))
        before = int(np.sum(self.t[good] < at))
        return good if min(before, len(good) - before) >= LEAST else None

    def line(self, some: NDArray[np.int64], values: Array, at: float) -> Array:
        """Slope and value at a time of a straight line through the frames next to it."""
        near = some[np.argsort(np.abs(self.t[some] - at))[:_NEAR]]
        return np.asarray(np.polyfit(self.t[near] - at, values[near], 1))


class _Model:
    """Residuals of the frames of an impact: t_c, then x, y, v, v' of each disk, then angle, w, w' of each tracked one."""

    def __init__(self, sides: Sequence[Side], wall: Wall | None, at: float, step: float) -> None:
        self.sides, self.wall, self.step = sides, wall, step
        self.contact = sum(side.R for side in sides)
        self.turned = [side.turned(at) for side in sides]
        self.spin_at: list[int | None] = []
        start, spins = [at], list[float]()
        for side in sides:
            some = np.flatnonzero(side.t < at), np.flatnonzero(side.t > at)
            before, after = (side.line(each, side.x, at) for each in some)
            start += [*(0.5 * (before[1] + after[1])), *(before[0] * (not side.rests[0])), *after[0]]
        for side, good in zip(sides, self.turned, strict=True):
            self.spin_at.append(None if good is None else 1 + 6 * len(sides) + len(spins))
            if good is not None and side.angle is not None:
                some = good[side.t[good] < at], good[side.t[good] > at]
                before, after = (side.line(each, side.angle, at) for each in some)
                spins += [0.5 * (before[1] + after[1]), before[0] * (not side.rests[1]), after[0]]
        self.start = np.array([*start, *spins])

    def flights(self, p: Array, i: int) -> list[tuple[Array, Array, Array]]:
        """Displacements (5, n, 2) and angles (5, n) of disk i before and after, and steps (4,).

        Rows are those of p, of changed v_x, v_y and spin, and of later times.
        """
        side, at = self.sides[i], self.spin_at[i]
        tau, found = side.t - p[0], []
        for end, part in enumerate((np.minimum(tau, 0.0), np.maximum(tau, 0.0))):
            v = p[3 + 6 * i + 2 * end : 5 + 6 * i + 2 * end]
            spin = 0.0 if at is None else float(p[at + 1 + end])
            sign = -1.0 if end == 0 else 1.0
            h = np.array(
                [
                    *[1e-4 * float(np.hypot(*v)) + 1e-2 * float(np.min(side.sigma)) / (self.step * 10.0)] * 2,
                    0.0,
                    0.0,
                ]
            )
            h[2] = 1e-4 * abs(spin) + h[0] / side.R
            h[3] = sign * 1e-2 * self.step
            vs, ws, taus = np.tile(v, (5, 1)), np.full(5, spin), np.tile(part, (5, 1))
            vs[1, 0] += h[0]
            vs[2, 1] += h[1]
            ws[3] += h[2]
            taus[4] = np.where(part != 0.0, part + h[3], 0.0)
            moved, angles = side.tray.flight(taus, vs, ws, side.R, side.k)
            if end == 0:
                moved, angles = moved * (not side.rests[0]), angles * (not side.rests[1])
            found.append((moved, angles, h))
        return found

    def at(self, p: Array) -> tuple[Array, Array]:
        """Residuals in units of their errors, and their derivatives; the last one is the distance at contact."""
        residuals, jacobians = [], []
        for i, (side, good, at) in enumerate(zip(self.sides, self.turned, self.spin_at, strict=True)):
            both = self.flights(p, i)
            late, c = side.t >= p[0], 1 + 6 * i
            (moved_b, turned_b, h_b), (moved_a, turned_a, h_a) = both
            residuals.append(((side.x - p[c : c + 2] - moved_b[0] - moved_a[0]) / side.sigma).ravel())
            J = np.zeros((len(side.t), 2, len(p)))
            rate_b, rate_a = (moved_b[4] - moved_b[0]) / h_b[3], (moved_a[4] - moved_a[0]) / h_a[3]
            J[:, :, 0] = np.where(late[:, None], rate_a, rate_b)
            J[:, 0, c] = J[:, 1, c + 1] = -1.0
            for end, (moved, _, h) in enumerate(both):
                for m in (0, 1):
                    J[:, :, c + 2 + 2 * end + m] = -(moved[1 + m] - moved[0]) / h[m]
                if at is not None:
                    J[:, :, at + 1 + end] = -(moved[3] - moved[0]) / h[2]
            jacobians.append((J / side.sigma[None, :, None]).reshape(2 * len(side.t), -1))
            if good is None or at is None or side.angle is None:
                continue
            residuals.append(
                (side.angle[good] - p[at] - turned_b[0, good] - turned_a[0, good]) / side.sigma_angle
            )
            J = np.zeros((len(good), len(p)))
            rate_b, rate_a = (turned_b[4] - turned_b[0]) / h_b[3], (turned_a[4] - turned_a[0]) / h_a[3]
            J[:, 0], J[:, at] = np.where(late, rate_a, rate_b)[good], -1.0
            for end, (_, turned, h) in enumerate(both):
                J[:, at + 1 + end] = -(turned[3] - turned[0])[good] / h[2]
                for m in (0, 1):
                    J[:, c + 2 + 2 * end + m] = -(turned[1 + m] - turned[0])[good] / h[m]
            jacobians.append(J / side.sigma_angle)
        distance, by = distance_of(p, self.wall)
        residuals.append(np.array([(distance - self.contact) / (CONTACT * self.contact)]))
        jacobians.append(by[None] / (CONTACT * self.contact))
        return np.concatenate(residuals), np.concatenate(jacobians)

    @property
    def of_angles(self) -> NDArray[np.bool_]:
        """Residuals that are those of angles."""
        parts = []
        for side, good in zip(self.sides, self.turned, strict=True):
            parts += [
                np.zeros(2 * len(side.t), dtype=bool),
                np.ones(0 if good is None else len(good), dtype=bool),
            ]
        return np.concatenate([*parts, [False]])

    def bent(self, p: Array, i: int) -> Array:
        """Displacements of the frames of disk i from straight flights, by the tray, (n, 2) [length]."""
        (before, _, _), (after, _, _) = self.flights(p, i)
        tau, k = (self.sides[i].t - p[0])[:, None], 3 + 6 * i
        line = np.minimum(tau, 0.0) * p[k : k + 2] + np.maximum(tau, 0.0) * p[k + 2 : k + 4]
        return np.asarray(before[0] + after[0] - line)


def fitted(sides: Sequence[Side], wall: Wall | None, at: float, step: float) -> Flights:
    """The flights of disks that meet near a time; `step` is that of frames [time]."""
    model = _Model(sides, wall, at, step)
    p, r, J = _descended(model, model.start)
    for side, spin in zip(sides, model.spin_at, strict=True):
        # Where a slow spin has stopped, its angle is that of w^2, which has a minimum for either sense.
        slow = _TURNS_BACK * math.sqrt(2.0 * side.leaving[1]) * side.sigma_angle
        for i in () if spin is None else (spin + 1, spin + 2):
            if 0.0 < abs(float(p[i])) < slow:
                trial = p.copy()
                trial[i] *= -1.0
                other = _descended(model, trial)
                if other[1] @ other[1] < r @ r:
                    p, r, J = other
    bent = tuple(model.bent(p, i) for i in range(len(sides)))
    return Flights(tuple(sides), wall, p, J, r, model.of_angles, tuple(model.spin_at), bent)


def _descended(model: _Model, p: Array) -> tuple[Array, Array, Array]:
    """Parameters, residuals and derivatives at the least chi-square next to p, by Levenberg and Marquardt's method."""
    damping, (r, J) = 1e-3, model.at(p)
    square = float(r @ r)
    for _ in range(_STEPS):
        size = np.sqrt(np.sum(J**2, axis=0))
        A = J / np.where(size > 0.0, size, 1.0)
        slope = A.T @ r
        scaled = np.linalg.solve(A.T @ A + damping * np.eye(len(p)), -slope)
        if abs(float(slope @ scaled)) < _ENOUGH:
            break
        trial = p + scaled / np.where(size > 0.0, size, 1.0)
        new_r, new_J = model.at(trial)
        new = float(new_r @ new_r)
        if new <= square:
            p, r, J, square, damping = trial, new_r, new_J, new, max(damping * 0.1, 1e-9)
        else:
            damping = max(damping * 10.0, 1e-6)
            if damping > 1e8:
                break
    return p, r, J


def distance_of(p: Array, wall: Wall | None) -> tuple[float, Array]:
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


@dataclass(frozen=True, eq=False)
class Flights:
    """Flights of the disks that meet, as they were fitted."""

    sides: tuple[Side, ...]
    wall: Wall | None
    parameters: Array
    jacobian: Array  # of residuals
    residual: Array  # in units of their errors; the last one is the distance
    of_angles: NDArray[np.bool_]
    spin_at: tuple[int | None, ...]  # first of angle, spin before and after of each disk among the parameters
    bent: tuple[Array, ...]  # (f, 2): what the tray adds to straight flights at the frames of each disk

    @property
    def time(self) -> float:
        """Time of the impact."""
        return float(self.parameters[0])

    @property
    def frames(self) -> int:
        """Frames of the shortest flight."""
        return min(
            int(np.sum(sign * (side.t - self.time) > 0.0)) for side in self.sides for sign in (-1.0, 1.0)
        )

    @property
    def square(self) -> float:
        """chi-square."""
        return float(self.residual @ self.residual)

    @property
    def covariance(self) -> Array:
        """Of the parameters."""
        size = np.sqrt(np.sum(self.jacobian**2, axis=0))  # times, lengths and velocities
        size = np.where(size > 0.0, size, 1.0)
        J = self.jacobian / size
        return np.asarray(np.linalg.pinv(J.T @ J, hermitian=True)) / np.outer(size, size)

    def _quality(self, some: NDArray[np.bool_]) -> float:
        """Probability that noise alone gives such residuals: each has 1 - its leverage degrees of freedom."""
        leverage = np.einsum("na,ab,nb->n", self.jacobian, self.covariance, self.jacobian)
        dof = float(np.sum(1.0 - leverage[some]))
        return float(chdtrc(max(dof, 1e-6), float(np.sum(self.residual[some] ** 2))))

    @property
    def quality(self) -> float:
        """Quality of positions."""
        return self._quality(~self.of_angles)

    @property
    def quality_of_angles(self) -> float:
        """Quality of angles; NaN if none was tracked."""
        return self._quality(self.of_angles) if self.of_angles.any() else math.nan

    @property
    def quality_of_all(self) -> float:
        """Quality of positions and angles together."""
        return self._quality(np.ones(len(self.residual), dtype=bool))

    @property
    def gap(self) -> float:
        """Gap at the impact, over the sum of the radii, as the flights alone give it."""
        leverage = float(self.jacobian[-1] @ self.covariance @ self.jacobian[-1])
        return float(self.residual[-1]) / max(1.0 - leverage, 1e-6) * CONTACT

    def doubting(self, i: int, doubt: tuple[float, float]) -> Flights:
        """These flights, with errors of the motion of disk i before."""
        return replace(
            self, sides=tuple(replace(s, doubt=doubt) if j == i else s for j, s in enumerate(self.sides))
        )

    def row(self) -> dict[str, float] | None:
        """Columns of the table but t and ids; None where the disks passed each other, by their speeds along the normal."""
        p, covariance, wall = self.parameters, self.covariance, self.wall
        by: dict[str, Array] = {}  # derivatives of what is measured by the parameters
        normal = -distance_of(p, wall)[1][1:3]  # to the other disk or the wall
        tangent = np.array([-normal[1], normal[0]])
        turning = np.zeros(len(p))
        if wall is None:
            D = math.hypot(*(p[7:9] - p[1:3]))
            turning[1:3], turning[7:9] = -tangent / D, tangent / D
        else:
            h = 1e-4 * self.sides[0].R
            moved = -wall.normal(p[1:3] + h * np.array([[1.0, 0.0], [0.0, 1.0]]))[0]
            turning[1:3] = (moved - normal) @ tangent / h
        if np.any(turning != 0.0):
            by[DIRECTION] = turning
        approach, parting = np.zeros(len(p)), np.zeros(len(p))
        for i, sign in zip(range(len(self.sides)), (1.0, -1.0), strict=False):
            approach[3 + 6 * i : 5 + 6 * i] = sign * normal
            parting[5 + 6 * i : 7 + 6 * i] = sign * normal
        error = {
            name: math.sqrt(max(float(each @ covariance @ each), 0.0))
            for name, each in (("speed", approach), ("change", approach - parting), (DIRECTION, turning))
        }
        speed, left = float(approach @ p), float(parting @ p)
        if (
            speed < _SURE * error["speed"]
            or left > _SURE * error["speed"] + 0.02 * speed
            or speed - left < _SURE * error["change"]
            or error[DIRECTION] > _NORMAL
        ):
            return None
        row = {"quality": self.quality, "quality_angles": self.quality_of_angles}
        row |= {"nx": float(normal[0]), "ny": float(normal[1])}
        unit = np.eye(len(p))
        for i, k in enumerate(self.spin_at):
            own = 3 + 6 * i
            by |= {f"vx_{i + 1}": unit[own], f"vy_{i + 1}": unit[own + 1]}
            by |= {f"vx_{i + 1}_after": unit[own + 2], f"vy_{i + 1}_after": unit[own + 3]}
            if k is not None:
                by |= {f"spin_{i + 1}": unit[k + 1], f"spin_{i + 1}_after": unit[k + 2]}
        row |= {name: float(each @ p) for name, each in by.items() if name != DIRECTION}
        names, T = list(by), np.array(list(by.values()))
        C = T @ covariance @ T.T
        self._widen(C, names)
        for name, each in zip(names, np.sqrt(np.diag(C)), strict=True):
            for key in NORMAL if name == DIRECTION else (name,):
                row[f"{key}_error"] = float(each)
        if DIRECTION not in by:
            row |= {"nx_error": _WALL_ERROR, "ny_error": _WALL_ERROR}
        for i, a in enumerate(names):
            for j, b in enumerate(names[:i]):
                row[f"cov:{b}:{a}"] = float(C[i, j])
        for i, side in enumerate(self.sides, start=1):
            row |= {
                f"{key}_{i}": float(np.asarray(getattr(side.disk, key))) for key in ("mass", "radius", "k")
            }
        if wall is not None:
            row |= {"mass_2": math.inf, "radius_2": row["radius_1"]}
        return row

    def _speed(self, name: str) -> float:
        """Speed or spin, without sense, of a column of the motion."""
        kind, number, *after = name.split("_")
        i, end = int(number) - 1, len(after)
        if kind == "spin":
            return abs(float(self.parameters[(self.spin_at[i] or 0) + 1 + end]))
        return float(np.hypot(*self.parameters[3 + 6 * i + 2 * end : 5 + 6 * i + 2 * end]))

    def _widen(self, C: Array, names: Sequence[str]) -> None:
        """Errors of motions at rest, of those that may be at rest, and of those that end at once.

        The distance d to the stop is v^2/(2 a), which says nothing of a small v to first order: its error is at most
        that of a v whose d is one error of the frames. Where d is not clearly more than its own error s_d, that of
        v is sqrt(2 a s_d): the other sense is possible too. The error of a spin w is no less than to first order, as frames
        show the turn of a coin, which is proportional to w, not to w^2.
        """
        known = []
        for i, name in enumerate(names):
            if name == DIRECTION:
                continue
            kind, number, *after = name.split("_")
            side, which = self.sides[int(number) - 1], int(kind == "spin")
            if not after and side.rests[which] and not side.doubt[which]:
                known.append((i, "spin" if which else "v"))
                continue
            if not after and side.doubt[which]:
                own = side.doubt[which]
            elif after and (speed := self._speed(name)) < side.leaving[which] * side.errors[
                which
            ] * side.after(self.time):
                n, linear = int(np.sum(side.t > self.time)), math.sqrt(max(C[i, i], 0.0))
                own = math.sqrt(2.0 * side.leaving[which]) * side.errors[which] / n**0.25
                if 0.0 < linear < own:
                    if linear < speed / _UNCLEAR:
                        continue
                    own = max(linear, math.sqrt(2.0 * linear * speed))
            else:
                continue
            C[i, :] = C[:, i] = 0.0
            C[i, i] = own**2
        for i, kind in known:
            at_rest = {j for j, _ in known}
            others = [C[j, j] for j, name in enumerate(names) if name.startswith(kind) and j not in at_rest]
            C[i, :] = C[:, i] = 0.0
            C[i, i] = _KNOWN**2 * min(others, default=1.0)
