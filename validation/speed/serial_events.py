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
  disk is predicted anew when the void one comes up: no real contact of that disk can come before, for it would
  have been its earliest, or else is held by a disk that changed later.
- A disk that collides is predicted anew against all neighbours; one that enters a cell, against the three cells
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
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...model.box import Box
from ...model.state import State

_Function = TypeVar("_Function", bound=Callable[..., Any])

COMPILED = importlib.util.find_spec("numba") is not None
"""True if Numba is here to compile this module; figures of speed mean something only then."""


def _compile(function: _Function) -> _Function:
    """The function, compiled at its first call where Numba is here."""
    if not COMPILED:
        return function
    compiled: _Function = importlib.import_module("numba").njit(error_model="numpy")(function)
    return compiled


# --- the heap: disks ordered by the time of their next event; `place` says where in it a disk stands ---------------


@_compile
def _rise(heap, place, key, at):
    """Move the disk at this place of the heap up until its parent is not later."""
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
def _sink(heap, place, key, at):
    """Move the disk at this place of the heap down until no child is earlier."""
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
def _schedule(i, contact, crossing, key, heap, place):
    """Put disk i where its earlier event belongs."""
    before = key[i]
    key[i] = min(contact[i], crossing[i])
    if key[i] < before:
        _rise(heap, place, key, place[i])
    else:
        _sink(heap, place, key, place[i])


# --- predictions ---------------------------------------------------------------------------------------------------


@_compile
def _contact_time(i, j, now, L, sigma, r, v, clock):
    """Time at which disks i and j touch, not before `now`; infinity if they do not.

    |d + u t| = sigma with separation d and relative velocity u: u^2 t^2 + 2 b t + c = 0, b = d.u, c = d^2 - sigma^2.
    The earlier root is c / (sqrt(b^2 - u^2 c) - b), without cancellation for b < 0.
    """
    dx = (r[j, 0] + v[j, 0] * (now - clock[j])) - (r[i, 0] + v[i, 0] * (now - clock[i]))
    dy = (r[j, 1] + v[j, 1] * (now - clock[j])) - (r[i, 1] + v[i, 1] * (now - clock[i]))
    dx -= L[0] * np.rint(dx / L[0])
    dy -= L[1] * np.rint(dy / L[1])
    ux = v[j, 0] - v[i, 0]
    uy = v[j, 1] - v[i, 1]
    b = dx * ux + dy * uy
    if b >= 0.0:
        return np.inf
    c = dx * dx + dy * dy - sigma * sigma
    discriminant = b * b - (ux * ux + uy * uy) * c
    if discriminant < 0.0:
        return np.inf
    return now + max(0.0, c / (math.sqrt(discriminant) - b))


@_compile
def _search(
    i, first_x, last_x, first_y, last_y, now, skip,
    L, sigma, M, r, v, clock, count, cell, head, following, contact, partner, stamp,
):  # fmt: skip
    """Lower disk i's contact to its earliest with the disks of the cells at these offsets; `skip` is left out."""
    for dx in range(first_x, last_x + 1):
        column = (cell[i, 0] + dx) % M[0]
        for dy in range(first_y, last_y + 1):
            j = head[column * M[1] + (cell[i, 1] + dy) % M[1]]
            while j >= 0:
                if j != i and j != skip:
                    t = _contact_time(i, j, now, L, sigma, r, v, clock)
                    if t < contact[i]:
                        contact[i] = t
                        partner[i] = j
                        stamp[i] = count[j]
                j = following[j]


@_compile
def _predict_crossing(i, now, width, r, v, clock, cell, crossing, axis):
    """Time at which disk i leaves its cell, and the side: axis 0 or 1."""
    crossing[i] = np.inf
    for a in range(2):
        if v[i, a] != 0.0:
            border = (cell[i, a] + (1 if v[i, a] > 0.0 else 0)) * width[a]
            t = max(now, clock[i] + (border - r[i, a]) / v[i, a])
            if t < crossing[i]:
                crossing[i] = t
                axis[i] = a


@_compile
def _enter(i, M, cell, head, following, before):
    """Put disk i first on the list of its cell."""
    c = cell[i, 0] * M[1] + cell[i, 1]
    following[i] = head[c]
    before[i] = -1
    if head[c] >= 0:
        before[head[c]] = i
    head[c] = i


@_compile
def _leave(i, M, cell, head, following, before):
    """Take disk i off the list of its cell."""
    if before[i] >= 0:
        following[before[i]] = following[i]
    else:
        head[cell[i, 0] * M[1] + cell[i, 1]] = following[i]
    if following[i] >= 0:
        before[following[i]] = before[i]


# --- the run -------------------------------------------------------------------------------------------------------


@_compile
def _prepare(
    L, sigma, M, width, r, v, clock, count, cell, head, following, before,
    contact, partner, stamp, crossing, axis, key, heap, place,
):  # fmt: skip
    """Put the disks into cells, predict each, and order the heap."""
    n = heap.size
    for i in range(n):
        for a in range(2):
            cell[i, a] = min(int(r[i, a] / width[a]), M[a] - 1)
        _enter(i, M, cell, head, following, before)
    for i in range(n):
        _search(
            i, -1, 1, -1, 1, 0.0, -1,
            L, sigma, M, r, v, clock, count, cell, head, following, contact, partner, stamp,
        )  # fmt: skip
        _predict_crossing(i, 0.0, width, r, v, clock, cell, crossing, axis)
        key[i] = min(contact[i], crossing[i])
    for i in range(n):
        heap[i] = i
        place[i] = i
        _rise(heap, place, key, i)


@_compile
def _run(
    collisions, e_n, times, pairs,
    L, sigma, M, width, r, v, clock, count, cell, head, following, before,
    contact, partner, stamp, crossing, axis, key, heap, place,
):  # fmt: skip
    """Process events until so many more collisions have happened or no event is to come; returns the last one's time.

    The first `times.size` collisions are written to `times` and `pairs`.
    """
    done = 0
    now = 0.0
    while done < collisions:
        i = heap[0]
        if key[i] == np.inf:
            break
        now = key[i]
        if crossing[i] < contact[i]:
            # Into the next cell: the three cells beyond it become neighbours.
            a = axis[i]
            step = 1 if v[i, a] > 0.0 else -1
            _leave(i, M, cell, head, following, before)
            cell[i, a] += step
            if cell[i, a] == M[a]:
                cell[i, a] = 0
                r[i, a] -= L[a]
            elif cell[i, a] < 0:
                cell[i, a] = M[a] - 1
                r[i, a] += L[a]
            _enter(i, M, cell, head, following, before)
            first_x, last_x, first_y, last_y = -1, 1, -1, 1
            if a == 0:
                first_x = last_x = step
            else:
                first_y = last_y = step
            _search(
                i, first_x, last_x, first_y, last_y, now, -1,
                L, sigma, M, r, v, clock, count, cell, head, following, contact, partner, stamp,
            )  # fmt: skip
            _predict_crossing(i, now, width, r, v, clock, cell, crossing, axis)
            _schedule(i, contact, crossing, key, heap, place)
            continue
        j = partner[i]
        if count[j] != stamp[i]:
            # The partner collided since: void.
            contact[i] = np.inf
            _search(
                i, -1, 1, -1, 1, now, -1,
                L, sigma, M, r, v, clock, count, cell, head, following, contact, partner, stamp,
            )  # fmt: skip
            _schedule(i, contact, crossing, key, heap, place)
            continue
        for d in (i, j):
            r[d, 0] += v[d, 0] * (now - clock[d])
            r[d, 1] += v[d, 1] * (now - clock[d])
            clock[d] = now
            count[d] += 1
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
            contact[d] = np.inf
            # The two separate, even where rounding does not say so (b = -1e-17 at contact).
            _search(
                d, -1, 1, -1, 1, now, i + j - d,
                L, sigma, M, r, v, clock, count, cell, head, following, contact, partner, stamp,
            )  # fmt: skip
            _predict_crossing(d, now, width, r, v, clock, cell, crossing, axis)
            _schedule(d, contact, crossing, key, heap, place)
    return now


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a run."""

    state: State  # at the time of the last collision; positions in the box
    time: NDArray[np.float64]  # (c,): times of the first collisions, as many as were to be recorded
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
        integer = np.int64
        self._sigma = float(diameter)
        self._L = np.array(box.lengths)
        self._M = np.array(cells, dtype=integer)
        self._r = box.wrap(state.position)
        self._v = state.velocity.copy()
        self._clock = np.zeros(n)
        self._count = np.zeros(n, dtype=integer)
        self._rest = (
            np.zeros((n, 2), dtype=integer),  # cell
            np.full(cells[0] * cells[1], -1, dtype=integer),  # head: first disk of each cell
            np.full(n, -1, dtype=integer),  # following: next disk of the same cell
            np.full(n, -1, dtype=integer),  # before: the one that this one follows
            np.full(n, np.inf),  # contact: time of the earliest contact
            np.full(n, -1, dtype=integer),  # partner in it
            np.zeros(n, dtype=integer),  # stamp: the partner's number of collisions when it was predicted
            np.full(n, np.inf),  # crossing: time of leaving the cell
            np.zeros(n, dtype=integer),  # axis of the side that it leaves through
            np.full(n, np.inf),  # key: the earlier of contact and crossing
            np.zeros(n, dtype=integer),  # heap of disks
            np.zeros(n, dtype=integer),  # place of each disk in the heap
        )
        width = self._L / self._M
        self._arrays = (self._L, self._sigma, self._M, width, self._r, self._v, self._clock, self._count)
        _prepare(*self._arrays, *self._rest)
        self._now = 0.0

    @property
    def collisions(self) -> int:
        """Collisions so far."""
        return int(self._count.sum()) // 2

    @property
    def temperature(self) -> float:
        """T = <v^2> / 2 [energy], mass 1."""
        return 0.5 * float(np.mean(np.sum(self._v**2, axis=1)))

    def run(self, collisions: int, *, record: int = 0) -> Outcome:
        """Run for so many more collisions (fewer only if none is to come) and return the first `record` of them."""
        times = np.zeros(min(record, collisions))
        pairs = np.zeros((len(times), 2), dtype=np.int32)
        before = self.collisions
        self._now = float(_run(collisions, self._e_n, times, pairs, *self._arrays, *self._rest))
        recorded = min(len(times), self.collisions - before)
        flown = self._r + self._v * (self._now - self._clock)[:, None]
        state = State(
            position=self._box.wrap(flown),
            velocity=self._v.copy(),
            spin=self._start.spin.copy(),
            time=self._start.time + self._now,
            collisions=self._start.collisions + self._count.astype(np.int32),
        )
        return Outcome(state, self._start.time + times[:recorded], pairs[:recorded])
