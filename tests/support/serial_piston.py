"""The serial code of `serial_walls.py` with pistons: walls that have a mass and one degree of freedom.

It shares no formula with the package. Between its events a piston follows a parabola, or a rotation in the complex
plane of s - s_0 + i s'/omega by exp(-i omega t); stops are found like hits, by looking in steps and Brent's method; a
hit gives the impulse of the law to both bodies. After each event of a piston all disks search for walls again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ifrdem.model.walls.wall import Wall

from .serial_walls import STEP, Array, Gas, nearest_at_rest, pair_impulse


class PistonGas(Gas):
    """Disks among walls, some of them pistons, under gravity."""

    def __init__(self, *given: Any) -> None:
        """Arguments as for `Gas`."""
        _, state, _, walls, gravity = given
        self.g = np.array(gravity)
        self.bounces = 0
        self.changed: float | None = None  # latest event of a piston since the last search
        self.moving = {
            id(wall): (wall.piston.displacement, wall.piston.velocity, state.time)
            for wall in walls
            if wall.piston
        }
        super().__init__(*given)

    def along(self, wall: Wall) -> Array:
        """Unit vector of a positive displacement: a line's normal, a segment's direction turned to the left."""
        if wall.shape not in ("line", "segment"):
            raise NotImplementedError(f"a piston of shape {wall.shape!r}")
        x, y = np.array(wall.towards) / np.linalg.norm(wall.towards)
        return np.array([x, y] if wall.shape == "line" else [-y, x])

    def piston(self, wall: Wall, t: Array) -> tuple[Array, Array]:
        """Displacement and velocity at times t."""
        s, v, since = self.moving[id(wall)]
        piston, dt = wall.piston, t - since
        assert piston is not None
        pull = piston.force / piston.mass + self.g @ self.along(wall)
        if piston.spring == 0.0:
            return s + v * dt + pull * dt**2 / 2, v + pull * dt
        omega = math.sqrt(piston.spring / piston.mass)
        z = (s - pull / omega**2 + 1j * v / omega) * np.exp(-1j * omega * dt)
        return pull / omega**2 + z.real, omega * z.imag

    def nearest(self, wall: Wall, x: Array, t: Array) -> tuple[Array, Array]:
        if wall.piston is None:
            return super().nearest(wall, x, t)
        return nearest_at_rest(wall, x - self.piston(wall, t)[0][:, None] * self.along(wall))

    def stop(self, end: float) -> tuple[float, Wall | None, float]:
        """The next time before `end` at which a piston meets a stop, the piston and the stop."""
        first: tuple[float, Wall | None, float] = (end, None, 0.0)
        for wall in self.walls:
            if wall.piston is None:
                continue
            since = self.moving[id(wall)][2]
            times = since + np.concatenate([[1e-9], np.arange(1e-8, end - since, STEP), [end - since]])
            for stop, sign in ((wall.piston.low, 1.0), (wall.piston.high, -1.0)):
                if stop is None:
                    continue
                room = sign * (self.piston(wall, times)[0] - stop)
                beyond = np.flatnonzero(room < 0.0)
                if len(beyond) and beyond[0] > 0:

                    def gap(t: float, wall: Wall = wall, stop: float = stop) -> float:
                        return float(self.piston(wall, np.array([t]))[0][0]) - stop

                    at = brentq(gap, times[beyond[0] - 1], times[beyond[0]], xtol=1e-15, rtol=1e-15)
                    first = min(first, (at, wall, stop), key=lambda each: each[0])
        return first

    def step(self) -> None:
        at, wall, stop = self.stop(min(float(self.wall_time.min()), float(self.pair_time.min())))
        if wall is None:
            super().step()
        else:
            self.moving[id(wall)] = (stop, -float(self.piston(wall, np.array([at]))[1][0]), at)
            self.changed = at
            self.bounces += 1
        if self.changed is not None:
            for i in range(self.disks.n):
                self.look_for_walls(i, self.changed)
        self.changed = None

    def hit_wall(self, i: int, wall: Wall, now: float) -> None:
        if wall.piston is None:
            super().hit_wall(i, wall, now)
            return
        m, M, R, k = self.disks.mass[i], wall.piston.mass, self.disks.radius[i], self.disks.k[i]
        self.move_to(i, now)
        out, one = self.along(wall), np.array([now])
        s, speed = (float(each[0]) for each in self.piston(wall, one))
        face = self.nearest(wall, self.x[i : i + 1], one)[0][0]
        n = -face
        u = self.v[i] - speed * out - wall.surface_speed * np.array([-face[1], face[0]])
        slip = float(u @ np.array([-n[1], n[0]])) + R * self.w[i]
        # The piston yields along n by its mass, along t not at all.
        P, P_t, brake = pair_impulse(self.law, n, float(u @ n), slip, m * M / (m + M), m / (1.0 + k), R)
        self.v[i] -= P / m
        self.turn(i, P_t, brake)
        self.moving[id(wall)] = (s, speed + float(P @ out) / M, now)
        self.changed = now
