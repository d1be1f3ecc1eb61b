"""A plain serial event-driven simulation of disks with Lees-Edwards boundaries, for comparison with the engine.

Everything is in the lab, and every disk is tested against all images of all others: no cells, no frames. Only the law
is shared with the engine.

- The image (sx, sy) of a disk lies sx Lx + sy s(t) further along x, s(t) = shear_rate Ly t, and sy Ly along y, and
  moves sy shear_rate Ly faster along x.
- Time goes by windows, short enough that only the nearest images matter; at the beginning of each, disks that
  left the box are put back by the same rule.
"""

from __future__ import annotations

import math

import numpy as np
from support.plain_law import collide_pair

from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State

IMAGES = np.array([(sx, sy) for sx in (-2, -1, 0, 1, 2) for sy in (-1, 0, 1)])


class Sheared:
    """Disks in a sheared box, moved from collision to collision.

    Attributes
    ----------
    lost : float
        Energy that collisions have dissipated, seen from where they happen.
    collisions : list of (time, i, j)
        All of them, i < j.
    virial : array (2, 2)
        Sum over collisions of the momentum that the first disk gains, times the vector to it from the second.
    """

    def __init__(self, disks: Disks, box: Box, law: tuple[float, ...], state: State) -> None:
        self.disks, self.box, self.law = disks, box, law
        self.x, self.v, self.w = state.position.copy(), state.velocity.copy(), state.spin.copy()
        self.now = self.opened = state.time
        self.clock = np.full(disks.n, state.time)
        self.lost, self.virial = 0.0, np.zeros((2, 2))
        self.collisions: list[tuple[float, int, int]] = []
        self.step = box.shear_rate * box.lengths[1]  # velocity of the image above
        self.last: dict[int, tuple[int, int, int]] = {}

    def run(self, *, collisions: int, window: float) -> None:
        """Advance by so many collisions."""
        target = len(self.collisions) + collisions
        while len(self.collisions) < target:
            self._fly(np.arange(self.disks.n), self.now)
            self._wrap()
            self.last, self.opened = {}, self.now
            self._window(self.now + window, target)

    def state(self) -> State:
        """The present state, inside the box."""
        self._fly(np.arange(self.disks.n), self.now)
        self._wrap()
        return State(self.x, self.v, self.w, time=self.now)

    def _fly(self, which: np.ndarray, now: float) -> None:
        self.x[which] += self.v[which] * (now - self.clock[which])[:, None]
        self.clock[which] = now

    def _wrap(self) -> None:
        up = np.floor(self.x[:, 1] / self.box.lengths[1])
        self.x[:, 1] -= up * self.box.lengths[1]
        self.x[:, 0] -= up * math.fmod(self.step * self.now, self.box.lengths[0])
        self.v[:, 0] -= up * self.step
        self.x[:, 0] -= np.floor(self.x[:, 0] / self.box.lengths[0]) * self.box.lengths[0]

    def _window(self, end: float, target: int) -> None:
        n = self.disks.n
        when, partner, image = np.full(n, np.inf), np.full(n, -1), np.zeros((n, 2), dtype=int)
        again = list(range(n))
        while True:
            for i in again:
                when[i], partner[i], image[i] = self._first(i)
            i = int(np.argmin(when))
            if when[i] >= end:
                self.now = end
                return
            self.now, j = when[i], int(partner[i])
            self._collide(i, j, int(image[i, 0]), int(image[i, 1]))
            if len(self.collisions) == target:
                return
            again = [k for k in range(n) if k in (i, j) or partner[k] in (i, j)]

    def _offset(self, sx: np.ndarray, sy: np.ndarray, now: float) -> np.ndarray:
        width, height = self.box.lengths
        # Whole boxes are taken off at the window's beginning only: an image keeps its number through it.
        offset = math.fmod(self.step * self.opened, width) + self.step * (now - self.opened)
        return np.stack((sx * width + sy * offset, sy * height), axis=-1)

    def _first(self, i: int) -> tuple[float, int, tuple[int, int]]:
        """When disk i first touches the image of another one, of which, and which image; from now on."""
        at = (self.x + self.v * (self.now - self.clock)[:, None]).T[:, :, None]  # shape (2, disks, 1)
        sx, sy = IMAGES.T
        (rx, ry), v = at + self._offset(sx, sy, self.now).T[:, None] - at[:, i, None], self.v.T[:, :, None]
        ux, uy = v[0] + sy * self.step - v[0, i], v[1] - v[1, i]
        sigma = (self.disks.radius + self.disks.radius[i])[:, None]
        b, c, u2 = rx * ux + ry * uy, rx * rx + ry * ry - sigma**2, ux * ux + uy * uy
        d = b * b - u2 * c
        hits = (b < 0.0) & (d > 0.0)
        hits[i] = False
        if i in self.last:
            j, jx, jy = self.last[i]
            if self.last.get(j) == (i, -jx, -jy):  # they separate
                hits[j, (sx == jx) & (sy == jy)] = False
        delay = np.full(b.shape, np.inf)
        delay[hits] = np.maximum(c[hits] / (np.sqrt(d[hits]) - b[hits]), 0.0)
        j, s = np.unravel_index(np.argmin(delay), delay.shape)
        return self.now + float(delay[j, s]), int(j), (int(sx[s]), int(sy[s]))

    def _collide(self, i: int, j: int, sx: int, sy: int) -> None:
        if i > j:
            i, j, sx, sy = j, i, -sx, -sy
        self._fly(np.array([i, j]), self.now)
        r = self.x[j] + self._offset(np.array(sx), np.array(sy), self.now) - self.x[i]
        normal = r / np.hypot(*r)
        shift = np.array([sy * self.step, 0.0])
        m, radius, k = self.disks.mass, self.disks.radius, self.disks.k
        after = collide_pair(
            *self.law, *normal,
            1.0 / m[i], radius[i], k[i], *self.v[i], self.w[i],
            1.0 / m[j], radius[j], k[j], *(self.v[j] + shift), self.w[j],
        )  # fmt: skip
        new = [np.array(after[0:2]), np.array(after[3:5])]
        spins = after[2], after[5]
        self.virial += np.outer(m[i] * (new[0] - self.v[i]), -r)
        for d, old, v, w in ((i, self.v[i], new[0], spins[0]), (j, self.v[j] + shift, new[1], spins[1])):
            inertia = m[d] * radius[d] ** 2 / k[d]
            self.lost += 0.5 * m[d] * float(old @ old - v @ v)
            self.lost += 0.5 * inertia * float(self.w[d] ** 2 - w**2)
        self.v[i], self.w[i] = new[0], spins[0]
        self.v[j], self.w[j] = new[1] - shift, spins[1]
        self.last[i], self.last[j] = (j, sx, sy), (i, -sx, -sy)
        self.collisions.append((float(self.now), i, j))
