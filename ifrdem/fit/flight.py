"""Laws of flight on a tray that slows disks down, in closed form or by tables.

plain: an air table, rollers, a residual contact, air; centre and spin apart.

    dv/dt = -(a0 + a1 |v|) v/|v| + g,    dw/dt = -(b0 + b1 |w|) sign(w)

coin: a flat face under even pressure that slides and spins, mu g = a0; ring: a raised edge that does. Both motions are
coupled (`ifrdem.kernels.forces.table_friction`; Farkas et al. 2003, doi:10.1103/PhysRevLett.90.248302): with u = R |w|
and eps = v/u

    dv/dt = -a0 F(eps),    du/dt = -k a0 T(eps)

and both stop together. (v, u) -> (l v, l u), t -> l t leaves these equations as they are: all paths with eps above its
limit, where F = k T eps, are one path in other units, and all below it another one. Tables of these two, by the
stretched time s, hold what is left to go until rest, so that flights go forward, backward and to the stop alike.

g = (gx, gy) is gravity along a tilted tray. A disk that has stopped stays at rest.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from ..errors import refuse

Array = NDArray[np.float64]

NAMES = ("a0", "a1", "b0", "b1", "gx", "gy")
"""Constants of a tray: a0, gx, gy [length/time^2], a1, b1 [1/time], b0 [rad/time^2]."""

_START = 1e-7  # distance of the tables' first angles from pure sliding and pure spinning [rad]
_FAR = 100.0  # exponents of growth from which a disk may have come from anywhere
_AT_LIMIT = 1e-6  # distance from the limit at which a path is on it [rad]
_END, _STEP = 90.0, 0.002  # of the stretched time: q falls to exp(-90 F) at least
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(
    6
)  # the integrand s ln s ends at 0: errors below 1e-3 of it


@dataclass(frozen=True, kw_only=True)
class Tray:
    """Law of deceleration of disks on a tray, with its constants.

    Raises InputError for a law that does not exist, a constant that is not finite, or one that the law does not have.
    """

    law: str = "plain"
    """One of `LAWS`."""
    a0: float = 0.0
    a1: float = 0.0
    b0: float = 0.0
    b1: float = 0.0
    gx: float = 0.0
    gy: float = 0.0
    """Constants, see `NAMES`; of a coin and a ring a0 = mu g, and no a1, b0, b1."""

    def __post_init__(self) -> None:
        problems = []
        if self.law not in LAWS:
            problems.append(f"law = {self.law!r}: must be one of {', '.join(LAWS)}")
        else:
            problems += [
                f"{name} = {getattr(self, name):g}: the law {self.law} has no such constant"
                for name in NAMES
                if name not in LAWS[self.law] and getattr(self, name) != 0.0
            ]
        problems += [
            f"{name} = {getattr(self, name)}: must be a finite number"
            for name in NAMES
            if not math.isfinite(getattr(self, name))
        ]
        refuse(problems)

    @property
    def coupled(self) -> bool:
        """True if centre and spin are braked together."""
        return self.law != "plain" and self.a0 > 0.0

    def changed(self, constants: Mapping[str, float]) -> Tray:
        """The tray with other values of some constants."""
        given: dict[str, Any] = dict(constants)
        return replace(self, **given)

    def braking(self, speed: float, rim: float) -> float:
        """Deceleration of a centre [length/time^2] at a speed of it and of the rim [length/time]; not at rest."""
        if not self.coupled:
            return self.a0 + self.a1 * speed
        q = math.hypot(speed, rim)
        return self.a0 * float(FRICTION[self.law](np.array([speed / q]), np.array([rim / q]))[0][0])

    def text(self) -> str:
        """Law and constants."""
        values = [f"{name} = {value:g}" for name in NAMES if (value := getattr(self, name))]
        return f"{self.law}, {', '.join(values) or 'no friction'} (SI units)"

    def leaving(self, R: float, k: float, sigma: float, sigma_angle: float) -> tuple[float, float]:
        """Least acceleration with which centres and angles of disks that come to rest have approached their place.

        In units of their errors [1/time^2]; not positive where a tray is so steep that none comes to rest. Under a
        coupled law one number for both, the least over all directions of approach.
        """
        downhill = math.hypot(self.gx, self.gy)
        if not self.coupled:
            return (self.a0 - downhill) / sigma, self.b0 / sigma_angle
        theta = np.linspace(0.0, 0.5 * math.pi, 91)
        sine, cosine = np.sin(theta), np.cos(theta)
        F, T = FRICTION[self.law](sine, cosine)
        slower = self.a0 * (F * sine + k * T * cosine) - downhill * sine
        least = float(np.min(slower * np.hypot(sine / sigma, cosine / (R * sigma_angle))))
        return least, least

    def stopping(
        self, time: Array, R: float, k: float, sigma: float, sigma_angle: float
    ) -> tuple[Array, Array]:
        """Largest distances (m,) of centres and angles, in units of their errors, at times (m,) before they come to rest.

        Under a coupled law F and T are at most 1.
        """
        uphill = self.a0 + math.hypot(self.gx, self.gy)
        of_spin = k * self.a0 / R if self.coupled else self.b0
        return (
            uphill * _stopped_from(time, self.a1) / sigma,
            of_spin * _stopped_from(time, self.b1) / sigma_angle,
        )

    def flight(
        self, tau: Array, v: Array, w: Array, R: float | Array, k: float | Array
    ) -> tuple[Array, Array]:
        """Displacements (m, n, 2) [length] and angles turned (m, n) [rad] at times from one at which the motion is known.

        Parameters
        ----------
        tau : array (m, n)
            Times, in each row of one sign. A disk that moves at 0 has moved at all earlier times.
        v, w : arrays (m, 2), (m,)
            Velocities [length/time] and spins [rad/time] at 0.
        R, k : float, or arrays (m, 1), (m,)
            Radii [length] and shape numbers.
        """
        speed = np.hypot(v[:, 0], v[:, 1])[:, None]
        along = v / np.maximum(speed, 1e-300)
        if self.coupled:
            u = R * np.abs(w)[:, None]
            shape = np.broadcast_to(np.asarray(k, dtype=np.float64), (len(v),))
            moved, rim, t = np.zeros((3, *tau.shape))
            for one in np.unique(shape):
                some = shape == one
                moved[some], rim[some], t[some] = path(self.law, float(one)).moved(
                    tau[some], speed[some], u[some], self.a0
                )
            turned = rim / R
        else:
            moved, t = _braked(tau, speed, self.a0, self.a1)
            turned, _ = _braked(tau, np.abs(w)[:, None], self.b0, self.b1)
        displacement = moved[..., None] * along[:, None, :]
        if self.gx or self.gy:
            displacement = displacement + self._tilted(t, speed, along)
        return displacement, turned * np.sign(w)[:, None]

    def _tilted(self, t: Array, speed: Array, along: Array) -> Array:
        """Parts of displacements (m, n, 2) by g after times in motion t (m, n), to first order in g.

        A small velocity along the path decays by a1, one across it by a0/s + a1, so that it is s int dt/s. Of a
        coupled law the braking is that of pure sliding.
        """
        g = np.array([self.gx, self.gy])
        part = along @ g
        across = g - part[:, None] * along
        if self.a0 > 0.0:
            later = t[None] * 0.5 * (_NODES + 1.0)[:, None, None]
            grown = _grown(later, self.a1)
            left = np.maximum(1.0 - self.a0 * grown / np.maximum(speed, 1e-300), 1e-12)
            drift = speed * left * np.exp(-self.a1 * later) * -np.log(left) / self.a0
            sideways = 0.5 * t * np.einsum("i,imn->mn", _WEIGHTS, drift)
        else:
            sideways = _rest_of(t, self.a1)
        return (part[:, None] * _rest_of(t, self.a1))[..., None] * along[:, None, :] + across[
            :, None, :
        ] * sideways[..., None]


def _decayed(t: Array, rate: float) -> Array:
    """(1 - exp(-rate t))/rate, by its series where that loses digits."""
    if abs(rate) * float(np.max(np.abs(t), initial=0.0)) < 1e-3:
        return np.asarray(t - rate * t**2 / 2.0 + rate**2 * t**3 / 6.0)
    return np.asarray(-np.expm1(-rate * t) / rate)


def _grown(t: Array, rate: float) -> Array:
    """(exp(rate t) - 1)/rate."""
    return _decayed(t, -rate)


def _rest_of(t: Array, rate: float) -> Array:
    """(t - E)/rate with E of `_decayed`: the distance under a unit acceleration, t^2/2 without a rate."""
    if abs(rate) * float(np.max(np.abs(t), initial=0.0)) < 1e-3:
        return np.asarray(t**2 / 2.0 - rate * t**3 / 6.0 + rate**2 * t**4 / 24.0)
    return np.asarray((t - _decayed(t, rate)) / rate)


def _stopped_from(t: Array, rate: float) -> Array:
    """Distance at times before rest under ds/dt = -(1 + rate s): (exp(rate t) - 1 - rate t)/rate^2."""
    return _rest_of(np.minimum(t, _FAR / max(rate, 1e-300)), -rate)


def _braked(tau: Array, s: Array, a0: float, a1: float) -> tuple[Array, Array]:
    """Distances (m, n) under ds/dt = -(a0 + a1 s) from speeds (m, 1), and times in motion (m, n)."""
    t = tau
    if a0 > 0.0:
        ratio = np.maximum(a1 * s / a0, -0.999)
        stop = (
            s / a0 * np.where(np.abs(ratio) > 1e-6, np.log1p(ratio) / np.where(ratio == 0.0, 1.0, ratio), 1.0)
        )
        t = np.minimum(tau, stop)
    return s * _decayed(t, a1) - a0 * _rest_of(t, a1), t


def _integrals(sine: Array, cosine: Array) -> tuple[Array, Array, Array, Array, Array]:
    """r = min/max, m = r^2, and K, E, D = (K - E)/m of the parameter m; by series where D loses its digits."""
    r = np.minimum(sine, cosine) / np.maximum(sine, cosine)
    m = np.minimum(r * r, 1.0 - 1e-15)
    K, E = ellipk(m), ellipe(m)
    D = np.where(
        m > 1e-3,
        (K - E) / np.where(m > 1e-3, m, 1.0),
        np.pi / 4.0 * (1.0 + 3.0 / 8.0 * m + 15.0 / 64.0 * m**2 + 175.0 / 1024.0 * m**3),
    )
    return r, m, K, E, D


def friction_of_coin(sine: Array, cosine: Array) -> tuple[Array, Array]:
    """F and T (n,) of a face at eps = sine/cosine, as in `ifrdem.kernels.forces.table_friction`."""
    r, m, K, E, D = _integrals(sine, cosine)
    C = np.where(
        m > 1e-3,
        (2.0 * D - K) / np.where(m > 1e-3, m, 1.0),
        np.pi / 16.0 * (1.0 + 3.0 / 4.0 * m + 75.0 / 128.0 * m**2),
    )
    B = 4.0 / (3.0 * np.pi) * (2.0 * K - (1.0 + m) * D)
    slow = sine <= cosine
    F = np.where(slow, r * B, B)
    of_slow = (4.0 - 2.0 * m) * E - (1.0 - m) * K
    T = 4.0 / (9.0 * np.pi) * np.where(slow, of_slow, r * (C + 3.0 * K - 4.0 * D))
    return F, T


def friction_of_ring(sine: Array, cosine: Array) -> tuple[Array, Array]:
    """F and T (n,) of an edge at eps = sine/cosine.

    The derivatives by v and u of the mean speed on it, 2/pi (v + u) E(4 v u/(v + u)^2); by Gauss' transformation
    F = 2/pi eps (K - D) and T = 2/pi E of the parameter eps^2 for eps <= 1, and T(eps) = F(1/eps).
    """
    r, _, K, E, D = _integrals(sine, cosine)
    small, large = 2.0 / np.pi * r * (K - D), 2.0 / np.pi * E
    slow = sine <= cosine
    return np.where(slow, small, large), np.where(slow, large, small)


FRICTION: Mapping[str, Callable[[Array, Array], tuple[Array, Array]]] = MappingProxyType(
    {"coin": friction_of_coin, "ring": friction_of_ring}
)
LAWS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"plain": NAMES, **dict.fromkeys(FRICTION, ("a0", "gx", "gy"))}
)
"""Laws of flight, and the constants of each."""


@functools.cache
def path(law: str, k: float) -> Flight:
    """The paths to rest of disks with a shape number, 0.1 s of computing."""
    return Flight(law, k)


@dataclass(frozen=True)
class _Table:
    """A path by the stretched time: natural logarithms (n,) of what is left until rest, for a0 = 1."""

    away: Array  # of the angle from the start of the path
    q: Array
    t: Array
    moved: Array
    rim: Array
    early: tuple[float, float]  # powers of the time with which moved and rim grow before the table begins


class Flight:
    """Paths to rest: v = q sin(theta), u = q cos(theta), ds = a0 dt/q."""

    def __init__(self, law: str, k: float) -> None:
        friction = self.friction = FRICTION[law]
        self.k: float = k

        def rates(_: float, y: Array) -> Array:
            s, c = np.sin(y[0]), np.cos(y[0])
            F, T = friction(np.maximum(s, 0.0), np.maximum(c, 0.0))
            return np.array([-(F * c - k * T * s), -(F * s + k * T * c)])

        def turning(theta: float) -> float:
            return float(rates(0.0, np.array([theta, 0.0]))[0])

        near = 1e-3
        self.limit: float = 0.5 * math.pi
        if turning(near) <= 0.0:
            self.limit = 0.0
        elif turning(0.5 * math.pi - near) < 0.0:
            self.limit = brentq(turning, near, 0.5 * math.pi - near, xtol=1e-13)
        one, small = np.array([1.0]), np.array([_START])
        self.fast: _Table | None = None
        self.slow: _Table | None = None
        if self.limit < 0.5 * math.pi:  # du/dv = k T/F, T = c/eps and F = 1 for eps -> infinity
            spin = k * float(friction(one, small)[1][0]) / _START
            self.fast = self._table(rates, 0.5 * math.pi, -1.0, (2.0, 1.0 + spin))
        if self.limit > 0.0:  # dv/du = F/(k T), F = c eps for eps -> 0
            F, T = friction(small, one)
            self.slow = self._table(rates, 0.0, 1.0, (1.0 + float(F[0] / T[0]) / _START / k, 2.0))

    def _table(
        self,
        rates: Callable[[float, Array], Array],
        start: float,
        sense: float,
        early: tuple[float, float],
    ) -> _Table:
        s = np.arange(0.0, _END, _STEP)
        done = solve_ivp(
            rates, (0.0, s[-1]), [start + sense * _START, 0.0], t_eval=s, rtol=1e-9, atol=1e-12, max_step=0.2
        )
        theta, log_q = done.y
        on_limit = np.abs(theta - self.limit) < _AT_LIMIT
        n = int(np.argmax(on_limit)) + 1 if on_limit.any() else len(s)
        s, theta, q = s[:n], theta[:n], np.exp(log_q[:n])
        rate = -float(rates(0.0, np.array([theta[-1], 0.0]))[1])  # of ln q, from the end on

        def to_rest(f: Array, at_end: float) -> Array:
            """Integral of f by s from each point to rest: the trapezium with slopes at its ends."""
            h, slope = np.diff(s), np.gradient(f, s)
            each = 0.5 * (f[1:] + f[:-1]) * h + h**2 / 12.0 * (slope[:-1] - slope[1:])
            return np.concatenate([np.cumsum(each[::-1])[::-1], [0.0]]) + at_end

        sine, cosine = np.sin(theta), np.cos(theta)
        return _Table(
            np.log(np.abs(theta - start)),
            log_q[:n],
            np.log(to_rest(q, q[-1] / rate)),
            np.log(to_rest(q**2 * sine, q[-1] ** 2 * sine[-1] / (2.0 * rate))),
            np.log(to_rest(q**2 * cosine, q[-1] ** 2 * cosine[-1] / (2.0 * rate))),
            early,
        )

    def moved(self, tau: Array, v: Array, u: Array, a0: float) -> tuple[Array, Array, Array]:
        """Distances, distances of the rim and times in motion (m, n) from speeds v and rim speeds u (m, 1)."""
        q = np.hypot(v, u)
        theta = np.clip(np.arctan2(v, np.maximum(u, 1e-300)), _START, 0.5 * math.pi - _START)
        found = np.zeros((3, *tau.shape))
        is_fast = (theta >= self.limit)[:, 0]
        for table, of_branch in ((self.fast, is_fast), (self.slow, ~is_fast)):
            rows = np.flatnonzero(of_branch & (q > 0.0)[:, 0])
            if table is not None and len(rows):
                away = 0.5 * math.pi - theta[rows] if table is self.fast else theta[rows]
                found[:, rows] = _along(table, np.log(away), tau[rows], q[rows], a0)
                if self.limit in (0.0, 0.5 * math.pi) and np.any(last := away[:, 0] > np.exp(table.away[-1])):
                    found[:, rows[last]] = self._at_end(theta, tau, v, u, a0, rows[last])
        return found[0], found[1], found[2]

    def _at_end(
        self, theta: Array, tau: Array, v: Array, u: Array, a0: float, rows: NDArray[np.int64]
    ) -> Array:
        """Beyond the end of a table whose limit is a pure motion the angle hardly changes: constant decelerations."""
        v, u, sine, cosine = v[rows], u[rows], np.sin(theta[rows]), np.cos(theta[rows])
        F, T = self.friction(sine, cosine)
        slower = a0 * (F * sine + self.k * T * cosine)  # of q
        t = np.minimum(tau[rows], np.hypot(v, u) / slower)
        share = t - 0.5 * slower / np.hypot(v, u) * t**2
        return np.stack([v * share, u * share, t])


def _along(table: _Table, away: Array, tau: Array, q: Array, a0: float) -> Array:
    """Distances, rim distances and times in motion (3, m, n) on one table."""
    grid = np.arange(len(table.away), dtype=np.float64)
    at = np.interp(away, table.away, grid)
    unit = q / np.exp(np.interp(at, grid, table.q))
    rest = np.exp(np.interp(at, grid, table.t))
    left = rest - tau * a0 / unit
    log_left = np.log(np.maximum(left, 1e-300))
    now = np.interp(-log_left, -table.t, grid)
    beyond = np.maximum(table.t[-1] - log_left, 0.0)  # on the limit all decelerations are constant
    early = np.maximum(log_left - table.t[0], 0.0)
    found = np.empty((3, *tau.shape))
    for i, (part, power) in enumerate(zip((table.moved, table.rim), table.early, strict=True)):
        ahead = np.exp(np.interp(now, grid, part) - 2.0 * beyond + power * early)
        found[i] = np.exp(np.interp(at, grid, part)) - np.where(left > 0.0, ahead, 0.0)
    found[:2] *= unit**2 / a0
    found[2] = np.minimum(tau, rest * unit / a0)
    return found
