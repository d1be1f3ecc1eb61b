"""A plain serial event-driven code for disks among walls that shares no formula with the package.

Every disk knows its latest place, velocity and time; the next event is the smallest of all pairs' and all disks' times.

- Pairs: both fall alike, so that they approach along straight lines; the smaller root of a quadratic equation.
- Arcs and corners: the nearest point of an arc by its angle, of a polyline by looking at every side. A wall that turns
  is looked at from a frame that turns with it; the velocity of its surface is that of a rigid body at the contact.
- Walls: the distance to a wall is written down as a function of time and looked at in steps of `STEP`, the first of
  them much shorter; where it changes its sign, Brent's method finds the root, and where it comes close to zero without
  doing so, its minimum is looked up. Slow, but the same for every shape and motion, with gravity or without.
- The law: the impulses of the paper (Eqs. 5, 8, 9, 12, 15, 31, 32), written here with vectors. A wall has infinite
  mass.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall

Array = NDArray[np.float64]
STEP = 0.01
WINDOW = 1.0  # how far ahead walls are looked for; then again
FIRST_STEPS = np.concatenate([[0.0], np.geomspace(1e-9, STEP, 30)])


def displaced(wall: Wall, t: Array) -> tuple[Array, Array]:
    """Displacement of a wall along its direction, and its speed, at times t."""
    motion = wall.motion
    going = (t >= wall.moving_times[0]) & (t < wall.moving_times[1])
    t = np.clip(t, *wall.moving_times) - (wall.moves_from or 0.0)  # a motion counts from where it begins
    if motion.kind == "still":
        return 0.0 * t, 0.0 * t
    if motion.kind == "steady":
        return motion.speed * t, np.where(going, motion.speed, 0.0)
    if motion.kind == "sine":
        rate = 2.0 * math.pi * motion.frequency
        s, speed = (motion.amplitude * each(rate * t + motion.phase) for each in (np.sin, np.cos))
        return s, np.where(going, rate * speed, 0.0)
    if motion.kind != "sawtooth":
        raise NotImplementedError(f"a motion of kind {motion.kind!r}")
    # A sawtooth: the corners of one period, and straight lines between them.
    part = (motion.frequency * t + motion.phase / (2.0 * math.pi)) % 1.0
    up = part < motion.rise
    rising = 2.0 * motion.amplitude * motion.frequency / motion.rise
    falling = -2.0 * motion.amplitude * motion.frequency / (1.0 - motion.rise)
    s = np.interp(part, [0.0, motion.rise, 1.0], motion.amplitude * np.array([-1.0, 1.0, -1.0]))
    return s, np.where(going, np.where(up, rising, falling), 0.0)


def turned(wall: Wall, t: Array) -> tuple[Array, Array]:
    """Angle of a wall at times t, and its angular velocity."""
    turn = wall.turn
    going = (t >= wall.moving_times[0]) & (t < wall.moving_times[1])
    t = np.clip(t, *wall.moving_times) - (wall.moves_from or 0.0)  # a motion counts from where it begins
    if turn.kind == "sine":
        rate = 2.0 * math.pi * turn.frequency
        angle, spin = (
            turn.amplitude * np.sin(rate * t + turn.phase),
            turn.amplitude * rate * np.cos(rate * t + turn.phase),
        )
        return angle, np.where(going, spin, 0.0)
    if turn.kind not in ("steady", "still"):
        raise NotImplementedError(f"a turn of kind {turn.kind!r}")
    rate = turn.rate if turn.kind == "steady" else 0.0
    return rate * t, np.where(going, rate, 0.0)


def nearest(wall: Wall, x: Array, t: Array) -> tuple[Array, Array]:
    """Unit vectors (steps, 2) from a wall to a disk's centres x, shape (steps, 2), at times t, and the distances."""
    x = x - displaced(wall, t)[0][:, None] * np.array(wall.motion.direction)
    if wall.turn.kind == "still":
        return nearest_at_rest(wall, x)
    # Complex numbers turn: back by the angle, and the vectors found forth again.
    about, way = complex(*wall.turn.center), np.exp(1j * turned(wall, t)[0])
    z = (x[:, 0] + 1j * x[:, 1] - about) / way + about
    out, distance = nearest_at_rest(wall, np.column_stack((z.real, z.imag)))
    z = (out[:, 0] + 1j * out[:, 1]) * way
    return np.column_stack((z.real, z.imag)), distance


@functools.cache
def sides_between(points: tuple[tuple[float, float], ...]) -> list[Wall]:
    """Straight walls from each of some points to the next."""
    return [Wall.segment(a, b) for a, b in itertools.pairwise(points)]


def nearest_at_rest(wall: Wall, x: Array) -> tuple[Array, Array]:
    """The same of a wall that stands as it is given."""
    if wall.points:
        ends = (*wall.points, *(wall.points[:1] if wall.shape == "polygon" else ()))
        sides = [nearest_at_rest(side, x) for side in sides_between(ends)]
        first = np.argmin([distance for _, distance in sides], axis=0)
        steps = np.arange(len(x))
        return np.array([out for out, _ in sides])[first, steps], np.array([d for _, d in sides])[
            first, steps
        ]
    d = x - np.array(wall.origin)
    if wall.shape == "arc":
        low, high = wall.angles
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        angle = (np.arctan2(d[:, 1], d[:, 0]) - middle + math.pi) % (2.0 * math.pi) - math.pi
        at = middle + np.clip(angle, -half, half)
        away = d - wall.radius * np.column_stack((np.cos(at), np.sin(at)))
        distance = np.linalg.norm(away, axis=1)
        return away / distance[:, None], distance
    if wall.shape == "line":
        normal = np.array(wall.towards) / np.linalg.norm(wall.towards)
        return np.broadcast_to(normal, d.shape), d @ normal
    if wall.shape not in ("segment", "post", "container"):
        raise NotImplementedError(f"the nearest point of a wall of shape {wall.shape!r}")
    if wall.shape == "segment":
        long = float(np.linalg.norm(wall.towards))
        way = np.array(wall.towards) / long
        d = d - np.minimum(np.maximum(d @ way, 0.0), long)[:, None] * way
    r = np.linalg.norm(d, axis=1)
    out = d / r[:, None]
    return (-out, wall.radius - r) if wall.shape == "container" else (out, r - wall.radius)


def pair_impulse(
    law: tuple[float, ...], n: Array, g_n: float, g_t: float, m_n: float, m_t: float, r: float
) -> tuple[Array, float, float]:
    """Impulse that the first gives to the second, its tangential part, and the most that rolling friction takes."""
    e_n, e_t, mu, contact_point, rho = law
    across = np.array([-n[1], n[0]])
    P_n = (1.0 + e_n) * m_n * g_n
    stick = m_t * abs(g_t) if contact_point else 0.5 * m_n * abs(g_t)
    P_t = (1.0 + e_t) * m_t * g_t + math.copysign(min(mu * P_n, stick), g_t)
    return P_n * n + P_t * across, P_t, min(rho * P_n, r * m_t * abs(g_t))


class Gas:
    """Disks among walls under gravity."""

    def __init__(
        self,
        disks: Disks,
        state: State,
        law: tuple[float, ...],
        walls: list[Wall],
        gravity: tuple[float, float],
    ) -> None:
        self.disks, self.law, self.walls, self.g = disks, law, walls, np.array(gravity)
        n = disks.n
        self.x, self.v, self.w = state.position.copy(), state.velocity.copy(), state.spin.copy()
        self.clock = np.full(n, state.time)
        self.inertia = disks.mass * disks.radius**2 / disks.k
        self.pair_time = np.full((n, n), np.inf)
        self.wall_time = np.full(n, np.inf)
        self.wall = np.full(n, -1)
        self.events: list[tuple[float, int, int]] = []
        for i in range(n):
            self.predict(i, state.time)

    def nearest(self, wall: Wall, x: Array, t: Array) -> tuple[Array, Array]:
        """As `nearest`, of walls whose motion is known beforehand."""
        return nearest(wall, x, t)

    def place(self, i: int | slice, t: float | Array) -> Array:
        """Centres at a time; of one disk also at many."""
        since = np.asarray(t - self.clock[i])[..., None]
        return np.asarray(self.x[i] + self.v[i] * since + 0.5 * self.g * since**2)

    def velocity(self, i: int | slice, t: float) -> Array:
        return np.asarray(self.v[i] + self.g * np.asarray(t - self.clock[i])[..., None])

    def predict(self, i: int, now: float) -> None:
        """When disk i, after an event of its own, meets any other disk, and the first wall."""
        r = self.place(slice(None), now) - self.place(i, now)
        u = self.velocity(slice(None), now) - self.velocity(i, now)
        sigma = self.disks.radius + self.disks.radius[i]
        b, uu = np.sum(r * u, axis=1), np.sum(u * u, axis=1)
        d = b * b - uu * (np.sum(r * r, axis=1) - sigma**2)
        meets = (b < 0.0) & (d > 0.0)
        meets[i] = False
        # c / (sqrt(d) - b), the smaller root without its cancellation
        c = np.sum(r * r, axis=1) - sigma**2
        with np.errstate(divide="ignore", invalid="ignore"):
            delay = np.where(meets, np.maximum(c, 0.0) / (np.sqrt(np.maximum(d, 0.0)) - b), np.inf)
        self.pair_time[i, :] = self.pair_time[:, i] = now + delay
        self.look_for_walls(i, now)

    def look_for_walls(self, i: int, now: float) -> None:
        times = now + np.concatenate([FIRST_STEPS, np.arange(STEP, WINDOW, STEP)[1:], [WINDOW]])
        path = self.place(i, times)
        self.wall_time[i], self.wall[i] = times[-1], -1  # nothing: look again then
        way = float(np.linalg.norm(self.velocity(i, now)) + 0.5 * np.linalg.norm(self.g) * WINDOW) * WINDOW
        for number, wall in enumerate(self.walls):
            to_go = self.nearest(wall, path[:1], times[:1])[1][0] - self.disks.radius[i]
            if (
                wall.turn.kind == "still"
                and wall.piston is None
                and to_go > way + max(2.0 * wall.motion.amplitude, abs(wall.motion.speed) * WINDOW)
            ):
                continue  # further away than both go in the window

            def gap(t: float, wall: Wall = wall) -> float:
                one = np.array([t])
                return float(self.nearest(wall, self.place(i, one), one)[1][0]) - float(self.disks.radius[i])

            gaps = self.nearest(wall, path, times)[1] - self.disks.radius[i]
            gaps[0] = max(gaps[0], 0.0)  # just after a hit it is a rounding error
            inside = np.flatnonzero(gaps < 0.0)
            last = int(inside[0]) if len(inside) else len(gaps)
            # It may touch and leave between two steps: only where it comes close.
            low = np.flatnonzero((gaps[1:-1] < gaps[:-2]) & (gaps[1:-1] <= gaps[2:])) + 1
            for k in low[(low < last) & (gaps[low] < 1e-2)]:
                bounds = (times[k - 1], times[k + 1])
                least = minimize_scalar(gap, bounds=bounds, method="bounded", options={"xatol": 1e-12})
                if least.fun < 0.0:
                    self.meet(i, number, brentq(gap, times[k - 1], least.x, xtol=1e-15, rtol=1e-15))
                    break
            else:
                if last < len(gaps):
                    assert last > 1, "a disk came to rest on a wall"
                    self.meet(i, number, brentq(gap, times[last - 1], times[last], xtol=1e-15, rtol=1e-15))

    def meet(self, i: int, wall: int, t: float) -> None:
        if t < self.wall_time[i]:
            self.wall_time[i], self.wall[i] = t, wall

    def run(self, events: int) -> list[tuple[float, int, int]]:
        """Events (time, disk, partner) until there are so many; wall w is the partner -2 - w."""
        while len(self.events) < events:
            self.step()
        return self.events

    def step(self) -> None:
        """The next event, or a look at what comes after WINDOW."""
        i = int(np.argmin(self.wall_time))
        p, q = divmod(int(np.argmin(self.pair_time)), self.disks.n)
        if self.wall_time[i] < self.pair_time[p, q]:
            now = float(self.wall_time[i])
            if self.wall[i] < 0:
                self.look_for_walls(i, now)
            else:
                self.hit_wall(i, self.walls[self.wall[i]], now)
                self.events.append((now, i, -2 - int(self.wall[i])))
                self.predict(i, now)
        else:
            now = float(self.pair_time[p, q])
            self.collide(p, q, now)
            self.events.append((now, min(p, q), max(p, q)))
            self.predict(p, now)
            self.predict(q, now)

    def move_to(self, i: int, now: float) -> None:
        self.x[i], self.v[i], self.clock[i] = self.place(i, now), self.velocity(i, now), now

    def turn(self, i: int, P_t: float, brake: float) -> None:
        """dw = -R P_t / I of either disk; then rolling friction, at most to rest."""
        w = self.w[i] - self.disks.radius[i] * P_t / self.inertia[i]
        self.w[i] = math.copysign(max(0.0, abs(w) - brake / self.inertia[i]), w)

    def collide(self, i: int, j: int, now: float) -> None:
        m, R, k = self.disks.mass, self.disks.radius, self.disks.k
        self.move_to(i, now)
        self.move_to(j, now)
        n = (self.x[j] - self.x[i]) / np.linalg.norm(self.x[j] - self.x[i])
        across = np.array([-n[1], n[0]])
        u = self.v[i] - self.v[j]
        m_n = m[i] * m[j] / (m[i] + m[j])
        m_t = 1.0 / ((1.0 + k[i]) / m[i] + (1.0 + k[j]) / m[j])
        slip = u @ across + R[i] * self.w[i] + R[j] * self.w[j]
        r = 2.0 * R[i] * R[j] / (R[i] + R[j])
        P, P_t, brake = pair_impulse(self.law, n, float(u @ n), float(slip), m_n, m_t, r)
        self.v[i] -= P / m[i]
        self.v[j] += P / m[j]
        self.turn(i, P_t, brake)
        self.turn(j, P_t, brake)

    def hit_wall(self, i: int, wall: Wall, now: float) -> None:
        """The second body has infinite mass: m_n = m, m_t = m / (1 + k); of rolling friction r is R."""
        m, R, k = self.disks.mass[i], self.disks.radius[i], self.disks.k[i]
        self.move_to(i, now)
        out = nearest(wall, self.x[i : i + 1], np.array([now]))[0][0]
        _, speed = displaced(wall, np.array([now]))
        # The surface runs to the left of the normal that points to the disk.
        surface = wall.surface_speed * np.array([-out[1], out[0]])
        # Of the rigid wall at the contact; against it the disk spins, which rolling friction brakes.
        s, spin = displaced(wall, np.array([now]))[0][0], turned(wall, np.array([now]))[1][0]
        x, y = self.x[i] - R * out - np.array(wall.turn.center) - s * np.array(wall.motion.direction)
        rigid = speed[0] * np.array(wall.motion.direction) + spin * np.array([-y, x])
        u = self.v[i] - spin * R * np.array([-out[1], out[0]]) - rigid - surface
        self.w[i] -= spin
        n = -out
        slip = u @ np.array([-n[1], n[0]]) + R * self.w[i]
        P, P_t, brake = pair_impulse(self.law, n, float(u @ n), float(slip), m, m / (1.0 + k), R)
        self.v[i] -= P / m
        self.turn(i, P_t, brake)
        self.w[i] += spin
