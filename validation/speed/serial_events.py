"""A serial event-driven simulation of equal smooth disks: the ordinary algorithm, as a peer to time against.

One event a disk in one binary heap, cells for neighbours, positions kept at each disk's own clock: what a good
textbook code does (M. Marin, D. Risso, P. Cordero, "Efficient algorithms for many-body hard particle molecular
dynamics", J. Comput. Phys. 109, 306 (1993), doi:10.1006/jcph.1993.1219), and no more. Numba compiles it
(`pip install 'ifrdem[peers]'`); without Numba the same functions run as plain Python, right but hundreds of times
slower. It shares nothing with the engine, not even the collision law.

How it finds every collision, in order:

- A disk holds its earliest contact with the disks of its own and the eight neighbouring cells, as they moved
  when it was predicted, and the time it leaves its cell. The heap orders disks by the earlier of the two.
- A contact carries the partner's number of collisions. If the partner collided since, the contact is void, and the
  disk is predicted again when the void one comes up: no real contact of that disk can come before, for it would
  have been its earliest, or else is held by a disk that changed later.
- A disk that collides is predicted again with all neighbours; one that enters a cell, against the three cells
  that became its neighbours.

Limits: equal disks of mass 1, at least four cells along each side, no remedy for inelastic collapse. Times count from
the start of the run, so rounding grows with its length.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...model.box import Box
from ...model.state import State
from ...tools.checked import Array

_Function = TypeVar("_Function", bound=Callable[..., Any])
Whole = NDArray[np.int64]

COMPILED = importlib.util.find_spec("numba") is not None
"""True if Numba is here to compile this module; figures of speed mean something only then."""


def _compile(function: _Function) -> _Function:
    """The function, compiled at its first call where Numba is here."""
    if not COMPILED:
        return function
    compiled: _Function = importlib.import_module("numba").njit(error_model="numpy")(function)
    return compiled


class SerialArrays(NamedTuple):
    """The disks, and what is known of their next events; arrays (n,) unless it is said."""

    L: Array  # (2,): sides of the box
    sigma: float  # diameter
    M: Whole  # (2,): cells along each side
    width: Array  # (2,): of a cell
    r: Array  # (n, 2): positions at the disks' own clocks
    v: Array  # (n, 2)
    clock: Array
    collisions: Whole  # so far
    cell: Whole  # (n, 2)
    head: Whole  # (cells,): first disk of each cell
    following: Whole  # next disk of the same cell
    before: Whole  # the one that this one follows
    contact: Array  # time of the earliest contact
    partner: Whole  # in it
    stamp: Whole  # the partner's number of collisions when it was predicted
    crossing: Array  # time of leaving the cell
    axis: Whole  # of the side that it leaves through
    key: Array  # the earlier of contact and crossing
    heap: Whole  # disks ordered by it
    place: Whole  # of each disk in the heap


# --- the heap: disks ordered by the time of their next event; `place` says where in it a disk stands ---------------


@_compile
def _rise(g, at):
    """Move the disk at this place of the heap up until its parent is not later."""
    heap, place, key = g.heap, g.place, g.key
    disk = heap[at]
    while at > 0:
        parent = (at - 1) // 2
        if key[heap[parent]] <= key[disk]:
            break
        heap[at] = heap[parent]
        place[heap[at]] = at
        at = parent
    heap[at] = disk
    place[disk] = at


@_compile
def _sink(g, at):
    """Move the disk at this place of the heap down until no child is earlier."""
    heap, place, key = g.heap, g.place, g.key
    disk = heap[at]
    n = heap.size
    while 2 * at + 1 < n:
        child = 2 * at + 1
        if child + 1 < n and key[heap[child + 1]] < key[heap[child]]:
            child += 1
        if key[disk] <= key[heap[child]]:
            break
        heap[at] = heap[child]
        place[heap[at]] = at
        at = child
    heap[at] = disk
    place[disk] = at


@_compile
def _schedule(g, i):
    """Restore the heap after a change of disk i's next event."""
    before = g.key[i]
    g.key[i] = min(g.contact[i], g.crossing[i])
    if g.key[i] < before:
        _rise(g, g.place[i])
    else:
        _sink(g, g.place[i])


# --- predictions ---------------------------------------------------------------------------------------------------


@_compile
def _contact_time(g, i, j, now):
    """Time at which disks i and j touch, not before `now`; infinity if they do not.

    |d + u t| = sigma with separation d and relative velocity u: u^2 t^2 + 2 b t + c = 0, b = d.u, c = d^2 - sigma^2.
    The earlier root is c / (sqrt(b^2 - u^2 c) - b), without cancellation for b < 0.
    """
    L, r, v, clock = g.L, g.r, g.v, g.clock
    dx = (r[j, 0] + v[j, 0] * (now - clock[j])) - (r[i, 0] + v[i, 0] * (now - clock[i]))
    dy = (r[j, 1] + v[j, 1] * (now - clock[j])) - (r[i, 1] + v[i, 1] * (now - clock[i]))
    dx -= L[0] * np.rint(dx / L[0])
    dy -= L[1] * np.rint(dy / L[1])
    ux = v[j, 0] - v[i, 0]
    uy = v[j, 1] - v[i, 1]
    b = dx * ux + dy * uy
    if b >= 0.0:
        return np.inf
    c = dx * dx + dy * dy - g.sigma * g.sigma
    discriminant = b * b - (ux * ux + uy * uy) * c
    if discriminant < 0.0:
        return np.inf
    return now + max(0.0, c / (math.sqrt(discriminant) - b))


@_compile
def _search(g, i, first_x, last_x, first_y, last_y, now, skip):
    """Lower disk i's contact to its earliest with the disks of the cells at these offsets; `skip` is left out."""
    for dx in range(first_x, last_x + 1):
        column = (g.cell[i, 0] + dx) % g.M[0]
        for dy in range(first_y, last_y + 1):
            j = g.head[column * g.M[1] + (g.cell[i, 1] + dy) % g.M[1]]
            while j >= 0:
                if j != i and j != skip:
                    t = _contact_time(g, i, j, now)
                    if t < g.contact[i]:
                        g.contact[i] = t
                        g.partner[i] = j
                        g.stamp[i] = g.collisions[j]
                j = g.following[j]


@_compile
def _predict_crossing(g, i, now):
    """Time at which disk i leaves its cell, and the side: axis 0 or 1."""
    g.crossing[i] = np.inf
    for a in range(2):
        if g.v[i, a] != 0.0:
            border = (g.cell[i, a] + (1 if g.v[i, a] > 0.0 else 0)) * g.width[a]
            t = max(now, g.clock[i] + (border - g.r[i, a]) / g.v[i, a])
            if t < g.crossing[i]:
                g.crossing[i] = t
                g.axis[i] = a


@_compile
def _enter(g, i):
    """Insert disk i into the list of its cell."""
    c = g.cell[i, 0] * g.M[1] + g.cell[i, 1]
    g.following[i] = g.head[c]
    g.before[i] = -1
    if g.head[c] >= 0:
        g.before[g.head[c]] = i
    g.head[c] = i


@_compile
def _leave(g, i):
    """Remove disk i from the list of its cell."""
    if g.before[i] >= 0:
        g.following[g.before[i]] = g.following[i]
    else:
        g.head[g.cell[i, 0] * g.M[1] + g.cell[i, 1]] = g.following[i]
    if g.following[i] >= 0:
        g.before[g.following[i]] = g.before[i]


# --- the run -------------------------------------------------------------------------------------------------------


@_compile
def _prepare(g):
    """Build the cell lists, predict the events of each disk, and order the heap."""
    n = g.heap.size
    for i in range(n):
        for a in range(2):
            g.cell[i, a] = min(int(g.r[i, a] / g.width[a]), g.M[a] - 1)
        _enter(g, i)
    for i in range(n):
        _search(g, i, -1, 1, -1, 1, 0.0, -1)
        _predict_crossing(g, i, 0.0)
        g.key[i] = min(g.contact[i], g.crossing[i])
    for i in range(n):
        g.heap[i] = i
        g.place[i] = i
        _rise(g, i)


@_compile
def _run(g, collisions, e_n, times, pairs):
    """Process events until so many more collisions have happened or no event is to come; returns the last one's time.

    The first `times.size` collisions are written to `times` and `pairs`.
    """
    L, M, r, v, clock = g.L, g.M, g.r, g.v, g.clock
    done = 0
    now = 0.0
    while done < collisions:
        i = g.heap[0]
        if g.key[i] == np.inf:
            break
        now = g.key[i]
        if g.crossing[i] < g.contact[i]:
            # Into the next cell: the three cells beyond it become neighbours.
            a = g.axis[i]
            step = 1 if v[i, a] > 0.0 else -1
            _leave(g, i)
            g.cell[i, a] += step
            if g.cell[i, a] == M[a]:
                g.cell[i, a] = 0
                r[i, a] -= L[a]
            elif g.cell[i, a] < 0:
                g.cell[i, a] = M[a] - 1
                r[i, a] += L[a]
            _enter(g, i)
            first_x, last_x, first_y, last_y = -1, 1, -1, 1
            if a == 0:
                first_x = last_x = step
            else:
                first_y = last_y = step
            _search(g, i, first_x, last_x, first_y, last_y, now, -1)
            _predict_crossing(g, i, now)
            _schedule(g, i)
            continue
        j = g.partner[i]
        if g.collisions[j] != g.stamp[i]:
            # The partner collided since: void.
            g.contact[i] = np.inf
            _search(g, i, -1, 1, -1, 1, now, -1)
            _schedule(g, i)
            continue
        for d in (i, j):
            r[d, 0] += v[d, 0] * (now - clock[d])
            r[d, 1] += v[d, 1] * (now - clock[d])
            clock[d] = now
            g.collisions[d] += 1
        # Equal masses: each disk's normal velocity changes by (1 + e_n) / 2 of the approach speed.
        nx = r[j, 0] - r[i, 0]
        ny = r[j, 1] - r[i, 1]
        nx -= L[0] * np.rint(nx / L[0])
        ny -= L[1] * np.rint(ny / L[1])
        length = math.sqrt(nx * nx + ny * ny)
        nx /= length
        ny /= length
        g_n = (v[i, 0] - v[j, 0]) * nx + (v[i, 1] - v[j, 1]) * ny
        change = 0.5 * (1.0 + e_n) * g_n
        v[i, 0] -= change * nx
        v[i, 1] -= change * ny
        v[j, 0] += change * nx
        v[j, 1] += change * ny
        if done < times.size:
            times[done] = now
            pairs[done, 0] = min(i, j)
            pairs[done, 1] = max(i, j)
        done += 1
        for d in (i, j):
            g.contact[d] = np.inf
            # The two separate, even where rounding does not say so (b = -1e-17 at contact).
            _search(g, d, -1, 1, -1, 1, now, i + j - d)
            _predict_crossing(g, d, now)
            _schedule(g, d)
    return now


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a run."""

    state: State  # at the time of the last collision; positions in the box
    time: Array  # (c,): times of the first collisions, as many as were to be recorded
    pair: NDArray[np.int32]  # (c, 2): their disks, the smaller number first


class SerialEvents:
    """Equal smooth disks of mass 1 in a periodic box, collided one after the other.

    Parameters
    ----------
    box : Box
        The periodic box; each side at least four diameters.
    diameter : float
        Of every disk [length].
    e_n : float
        Coefficient of normal restitution.
    state : State
        The start; not changed.

    Raises
    ------
    InputError
        If there are fewer than two disks, or the box is too small for the cells.
    """

    def __init__(self, box: Box, diameter: float, e_n: float, state: State) -> None:
        n = state.n
        if n < 2:
            raise InputError(f"n = {n}: the serial peer needs at least two disks")
        # About one disk a cell, and no cell smaller than a diameter (with a margin for rounding at its borders).
        wanted = max(diameter * (1.0 + 1e-9), math.sqrt(box.area / n))
        cells = [int(side / wanted) for side in box.lengths]
        if min(cells) < 4:
            raise InputError(
                f"box {box.lengths[0]:.6g} x {box.lengths[1]:.6g}: the serial peer needs four cells of side "
                f"{wanted:.6g} along each side; use more disks"
            )
        self._box = box
        self._e_n = e_n
        self._start = state
        L, M = np.array(box.lengths), np.array(cells)
        times, none = np.full(n, np.inf), np.full(n, -1)
        self._arrays = g = SerialArrays(
            L=L, sigma=float(diameter), M=M, width=L / M, r=box.wrap(state.position), v=state.velocity.copy(),
            clock=np.zeros(n), collisions=np.zeros(n, np.int64), cell=np.zeros((n, 2), np.int64),
            head=np.full(cells[0] * cells[1], -1), following=none, before=none.copy(),
            contact=times, partner=none.copy(), stamp=np.zeros(n, np.int64),
            crossing=times.copy(), axis=np.zeros(n, np.int64), key=times.copy(),
            heap=np.zeros(n, np.int64), place=np.zeros(n, np.int64),
        )  # fmt: skip
        _prepare(g)
        self._now = 0.0

    @property
    def collisions(self) -> int:
        """Collisions so far."""
        return int(self._arrays.collisions.sum()) // 2

    @property
    def temperature(self) -> float:
        """T = <v^2> / 2 [energy], mass 1."""
        return 0.5 * float(np.mean(np.sum(self._arrays.v**2, axis=1)))

    def run(self, collisions: int, *, record: int = 0) -> Outcome:
        """Run for so many more collisions (fewer only if none is to come) and return the first `record` of them."""
        times = np.zeros(min(record, collisions))
        pairs = np.zeros((len(times), 2), dtype=np.int32)
        before = self.collisions
        self._now = float(_run(self._arrays, collisions, self._e_n, times, pairs))
        recorded = min(len(times), self.collisions - before)
        g = self._arrays
        flown = g.r + g.v * (self._now - g.clock)[:, None]
        state = State(
            position=self._box.wrap(flown),
            velocity=g.v.copy(),
            spin=self._start.spin.copy(),
            time=self._start.time + self._now,
            collisions=self._start.collisions + g.collisions.astype(np.int32),
        )
        return Outcome(state, self._start.time + times[:recorded], pairs[:recorded])
