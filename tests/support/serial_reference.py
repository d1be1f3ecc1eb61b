"""A plain serial event-driven simulation of hard disks, for comparison with the parallel engine.

One heap of events, one disk pair at a time, ordinary Python floats: slow (some 1e4 collisions/s) and easy to
check by reading. Only the collision law is shared with the engine.

- Every disk keeps the position, velocity and time of its latest collision, and flies straight from there.
  Positions are never wrapped: a pair's periodic image is a whole number of box lengths added to the
  separation, so cell crossings do not touch a trajectory.
- Disks live in a grid of cells no smaller than the largest contact distance, so only disks in neighbouring
  cells can touch. A pair is tested whenever either of them collides, and whenever their cells become
  neighbours; between two such moments the outcome cannot change.
- The heap holds every predicted contact and each disk's next cell crossing. An event counts only if its
  disks have not collided since it was predicted (by their numbers of collisions).
- Events run in the order (time, smaller id, larger id); cell crossings come before contacts at equal times,
  because they may bring a contact to light.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import ArrayLike
from support.plain_law import collide_pair

from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State

CROSSING = -1  # stands in a crossing's event where a contact has its smaller id


def contact_delay(rx: float, ry: float, vx: float, vy: float, sigma: float) -> float:
    """Time until two disks touch, or infinity.

    `r` is the separation, `v` the relative velocity (both second minus first), `sigma` the contact distance.
    They touch when |r + v t| = sigma, i.e. v^2 t^2 + 2 b t + c = 0 with b = r.v and c = r^2 - sigma^2. The
    earlier root is (-b - sqrt(b^2 - v^2 c)) / v^2; multiplied out as c / (sqrt(...) - b) it has no
    cancellation for b < 0, and v = 0 needs no case of its own. Rounding can leave a touching pair with
    c < 0: approaching, it touches now.
    """
    b = rx * vx + ry * vy
    if b >= 0.0:
        return math.inf
    c = rx * rx + ry * ry - sigma * sigma
    discriminant = b * b - (vx * vx + vy * vy) * c
    if discriminant < 0.0:
        return math.inf
    return max(0.0, c / (math.sqrt(discriminant) - b))


class _Gas:
    """The moving disks, their cells, and the heap of what comes next."""

    def __init__(
        self, disks: Disks, box: Box, laws: np.ndarray, state: State, contact_time: float = 0.0
    ) -> None:
        self.mass = disks.mass.tolist()
        self.radius = disks.radius.tolist()
        self.k = disks.k.tolist()
        self.material = disks.material.tolist()
        self.laws = laws.tolist()  # [material of i][material of j] -> (e_n, e_t, mu, contact_point, rho)
        self.lengths = box.lengths
        n = disks.n

        start = box.wrap(state.position)
        self.x = start[:, 0].tolist()  # position at the disk's own clock, not wrapped
        self.y = start[:, 1].tolist()
        self.vx = state.velocity[:, 0].tolist()
        self.vy = state.velocity[:, 1].tolist()
        self.spin = state.spin.tolist()
        self.clock = [state.time] * n
        self.count = [0] * n  # collisions since the start
        self.contact_time = contact_time
        self.latest = state.latest_collision.tolist()
        # The pair that collided last, as (partner, image): it cannot touch again before either touches
        # something else, since it separates. True also where rounding hides it (b = -1e-17 at contact).
        self.last: list[tuple[int, int, int] | None] = [None] * n

        # Cells at least as wide as the largest contact distance (a little wider: rounding at cell borders).
        widest = 2.0 * max(self.radius) * (1.0 + 1e-9)
        wanted = max(widest, math.sqrt(box.area / n))
        self.cells = tuple(max(3, int(length / wanted)) for length in box.lengths)
        self.width = tuple(length / m for length, m in zip(box.lengths, self.cells, strict=True))
        if min(self.width) < widest:
            raise ValueError("the serial reference needs box sides of more than three largest diameters")
        # Cell numbers are not wrapped either; modulo the grid's size they name the cell.
        self.cx = [min(int(x / self.width[0]), self.cells[0] - 1) for x in self.x]
        self.cy = [min(int(y / self.width[1]), self.cells[1] - 1) for y in self.y]
        self.members: list[list[set[int]]] = [
            [set() for _ in range(self.cells[1])] for _ in range(self.cells[0])
        ]
        for i in range(n):
            self.members[self.cx[i]][self.cy[i]].add(i)

        self.heap: list[tuple[float, int, int, int, int, int, int]] = []
        for i in range(n):
            self.predict_contacts(i, state.time, [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
            self.predict_crossing(i, state.time)

    def predict_contacts(self, i: int, now: float, offsets: list[tuple[int, int]]) -> None:
        """Put the contacts of disk i with the disks of the cells at these offsets on the heap."""
        x, y, vx, vy, clock, radius = self.x, self.y, self.vx, self.vy, self.clock, self.radius
        (m_x, m_y), (L_x, L_y), since = self.cells, self.lengths, now - clock[i]
        x_i, y_i, vx_i, vy_i, radius_i = x[i] + vx[i] * since, y[i] + vy[i] * since, vx[i], vy[i], radius[i]
        for dx, dy in offsets:
            column, row = self.cx[i] + dx, self.cy[i] + dy
            for j in self.members[column % m_x][row % m_y]:
                if j == i:
                    continue
                # The image of j that is in that cell: how many boxes from where j itself is.
                sx, sy = (column - self.cx[j]) // m_x, (row - self.cy[j]) // m_y
                if self.last[i] == (j, sx, sy) and self.last[j] == (i, -sx, -sy):
                    continue
                since = now - clock[j]
                rx, ry = (x[j] + vx[j] * since) - x_i + sx * L_x, (y[j] + vy[j] * since) - y_i + sy * L_y
                delay = contact_delay(rx, ry, vx[j] - vx_i, vy[j] - vy_i, radius_i + radius[j])
                if delay < math.inf:
                    first = (i, j, self.count[i], self.count[j], sx, sy)
                    other = (j, i, self.count[j], self.count[i], -sx, -sy)
                    heapq.heappush(self.heap, (now + delay, *(first if i < j else other)))

    def separation(self, i: int, j: int, sx: int, sy: int, now: float) -> tuple[float, float]:
        """From disk i to the image of disk j that is (sx, sy) boxes away from disk j itself."""
        since_i, since_j = now - self.clock[i], now - self.clock[j]
        rx = (self.x[j] + self.vx[j] * since_j) - (self.x[i] + self.vx[i] * since_i)
        ry = (self.y[j] + self.vy[j] * since_j) - (self.y[i] + self.vy[i] * since_i)
        return rx + sx * self.lengths[0], ry + sy * self.lengths[1]

    def predict_crossing(self, i: int, now: float) -> None:
        """Put the time when disk i leaves its cell on the heap, with the cell step it then makes."""
        best = (math.inf, 0, 0)
        for axis, position, speed, cell in (
            (0, self.x[i], self.vx[i], self.cx[i]),
            (1, self.y[i], self.vy[i], self.cy[i]),
        ):
            if speed != 0.0:
                step = 1 if speed > 0.0 else -1
                border = (cell + (step > 0)) * self.width[axis]
                when = max(now, self.clock[i] + (border - position) / speed)
                best = min(best, (when, step if axis == 0 else 0, step if axis == 1 else 0))
        if best[0] < math.inf:
            heapq.heappush(self.heap, (best[0], CROSSING, i, self.count[i], 0, best[1], best[2]))

    def cross(self, i: int, step_x: int, step_y: int, now: float) -> None:
        """Disk i enters the next cell: test the three cells that become neighbours."""
        self.members[self.cx[i] % self.cells[0]][self.cy[i] % self.cells[1]].remove(i)
        self.cx[i] += step_x
        self.cy[i] += step_y
        self.members[self.cx[i] % self.cells[0]][self.cy[i] % self.cells[1]].add(i)
        ahead = [(step_x, d) if step_x else (d, step_y) for d in (-1, 0, 1)]
        self.predict_contacts(i, now, ahead)
        self.predict_crossing(i, now)

    def collide(self, i: int, j: int, sx: int, sy: int, now: float) -> None:
        """Disks i and j touch now: apply the law and predict both again."""
        for d in (i, j):
            self.x[d] += self.vx[d] * (now - self.clock[d])
            self.y[d] += self.vy[d] * (now - self.clock[d])
            self.clock[d] = now
        rx, ry = self.separation(i, j, sx, sy, now)
        distance = math.hypot(rx, ry)
        law = self.laws[self.material[i]][self.material[j]]
        # Luding and McNamara's rule: elastic if either partner's latest collision was less than the contact time ago.
        if min(now - self.latest[i], now - self.latest[j]) < self.contact_time:
            law = [1.0, -1.0, 0.0, 0.0, 0.0]
        self.latest[i] = self.latest[j] = now
        after = collide_pair(
            *law,
            rx / distance,
            ry / distance,
            1.0 / self.mass[i],
            self.radius[i],
            self.k[i],
            self.vx[i],
            self.vy[i],
            self.spin[i],
            1.0 / self.mass[j],
            self.radius[j],
            self.k[j],
            self.vx[j],
            self.vy[j],
            self.spin[j],
        )
        self.vx[i], self.vy[i], self.spin[i] = (float(value) for value in after[:3])
        self.vx[j], self.vy[j], self.spin[j] = (float(value) for value in after[3:6])
        self.last[i], self.last[j] = (j, sx, sy), (i, -sx, -sy)
        everywhere = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        for d in (i, j):
            self.count[d] += 1
        for d in (i, j):
            self.predict_contacts(d, now, everywhere)
            self.predict_crossing(d, now)


def simulate(
    disks: Disks,
    box: Box,
    law: ArrayLike,
    state: State,
    *,
    t_end: float | None = None,
    max_collisions: int | None = None,
    contact_time: float = 0.0,
) -> tuple[State, list[tuple[float, int, int]]]:
    """Simulate hard disks in a periodic box, event by event.

    Parameters
    ----------
    disks, box, state
        The gas and its start; not changed.
    law : array_like, shape (5,) or (materials, materials, 5)
        (e_n, e_t, mu, contact_point, rho), one row or one per pair of materials, symmetric.
    t_end : float, optional
        Stop at this time [time], an absolute one like `state.time`; contacts before it happen.
    max_collisions : int, optional
        Stop right after this many collisions, at the time of the last one.
        Stops at whichever comes first. Without `t_end`, disks that move and never touch run for ever.
    contact_time : float
        Of the tc rule [time]; 0 does without.

    Returns
    -------
    State
        At the end; positions wrapped into the box.
    list of (time, i, j)
        Every collision in order, i < j.
    """
    if t_end is None and max_collisions is None:
        raise ValueError("t_end or max_collisions is needed")
    if disks.n == 0:
        raise ValueError("the serial reference needs at least one disk")
    laws = np.asarray(law, dtype=np.float64)
    laws = laws.reshape(1, 1, 5) if laws.ndim == 1 else laws
    most = math.inf if max_collisions is None else max_collisions
    stop = math.inf if t_end is None else t_end

    collisions: list[tuple[float, int, int]] = []
    gas = _Gas(disks, box, laws, state, contact_time)
    while gas.heap and len(collisions) < most and gas.heap[0][0] < stop:
        now, i, j, stamp_i, stamp_j, sx, sy = heapq.heappop(gas.heap)
        if i == CROSSING:
            if gas.count[j] == stamp_i:
                gas.cross(j, sx, sy, now)
        elif gas.count[i] == stamp_i and gas.count[j] == stamp_j:
            gas.collide(i, j, sx, sy, now)
            collisions.append((now, i, j))

    end = collisions[-1][0] if collisions else state.time
    if t_end is not None and len(collisions) < most:
        end = t_end
    since = (end - np.array(gas.clock))[:, None]
    velocity = np.column_stack((gas.vx, gas.vy))
    flown = np.column_stack((gas.x, gas.y)) + velocity * since
    position = box.wrap(flown)
    turns = np.rint((flown - position + state.position - box.wrap(state.position)) / box.lengths)
    return (
        State(
            position=position,
            velocity=velocity,
            spin=np.array(gas.spin),
            time=end,
            collisions=state.collisions + np.array(gas.count, dtype=np.int32),
            image=state.image + turns.astype(np.int32),
            latest_collision=np.array(gas.latest),
        ),
        collisions,
    )
