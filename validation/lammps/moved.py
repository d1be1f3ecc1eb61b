"""A law of ours inside LAMMPS: LAMMPS moves disks freely, and those that met in a step collide by `ifrdem.collide`.

A pair that met goes back to its time of contact, collides, and flies on to the end of the step, the earliest pair
first. Contacts that began and ended within a step are found too, so that the result does not depend on its length.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...model.box import Box
from ...model.laws.collision import collide
from ...model.laws.law import CollisionLaw
from ...model.state import State
from ...tools.checked import Array
from .world import World

Meeting = tuple[float, int, int]
"""How long before the end of the step two disks met, and which."""


class Moved:
    """Equal disks of mass and diameter 1 from a state in a periodic box, moved by LAMMPS; `count` collisions so far."""

    def __init__(self, state: State, box: Box, law: CollisionLaw, step: float) -> None:
        self.world = World(state.position, state.velocity, state.spin, box.lengths, None, step)
        self.law, self.count = law, 0
        self.world.call(self._end_of_step)

    def run_to(self, time: float) -> None:
        """Advance to a time."""
        self.world.run_to(time)

    def _end_of_step(self, _lammps: Any, step: int, n: int, _ids: Any, x: Array, force: Array) -> None:
        from scipy.spatial import cKDTree

        force[:n] = 0.0
        if step == 0:
            return  # the set-up: nothing has moved
        self._x, self._v = x[:n, :2], self.world.array("v")[:, :2]
        self._w = self.world.array("omega")[:, 2]
        fastest = float(np.sqrt((self._v**2).sum(1).max()))
        self._reach = 1.0 + 2.0 * self.world.step * fastest
        places = cKDTree(np.mod(self._x, self.world.lengths), boxsize=self.world.lengths)
        queue = self._met(places.query_pairs(self._reach, output_type="ndarray"), self.world.step)
        while queue:
            back, i, j = max(queue)
            self._collide(back, i, j)
            queue = [each for each in queue if not {*each[1:]} & {i, j}]
            for a in (i, j):
                d = self.world.apart(self._x - self._x[a])
                near = np.flatnonzero((d * d).sum(1) < self._reach**2)
                queue += self._met(((a, int(b)) for b in near if b != a), back)

    def _met(self, pairs: Iterable[Any], longest: float) -> list[Meeting]:
        """Those of the pairs that met at most `longest` before the end of the step."""
        found = []
        for i, j in pairs:
            d, u = self.world.apart(self._x[j] - self._x[i]), self._v[j] - self._v[i]
            du, uu = float(d @ u), float(u @ u)
            root = du * du - uu * (float(d @ d) - 1.0)
            if uu > 0.0 and root > 0.0:
                back = (du + root**0.5) / uu
                if 0.0 < back <= longest * (1.0 + 1e-9) and du - back * uu < 0.0:
                    found.append((back, int(i), int(j)))
        return found

    def _collide(self, back: float, i: int, j: int) -> None:
        two = [i, j]
        self._x[two] -= back * self._v[two]
        d = self.world.apart(self._x[j] - self._x[i])
        after = collide(
            self.law, d / np.hypot(*d), [1.0, 1.0], [0.5, 0.5], [2.0, 2.0], self._v[two], self._w[two]
        )  # fmt: skip
        self._v[two], self._w[two] = after.velocity, after.spin
        self._x[two] += back * self._v[two]
        self.count += 1
