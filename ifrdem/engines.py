"""The laws of collisions in other engines: `collide_step` takes their disks at the end of a free flight.

An engine moves its disks by one of its steps, without contacts of its own. `collide_step` then looks back: for every
contact within the step, also one that began and ended in it, both disks go back to the time of contact, collide by
`ifrdem.collide`, and fly on to the end of the step, in the order of the contacts. The result does not depend on the
length of the step, only its cost does; steps too long for the periodic sides are refused.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InelasticCollapse, InputError
from .model.laws.collision import collide
from .model.laws.law import CollisionLaw
from .model.laws.records import any_law
from .tools.checked import LEAST, MOST, Array, Numbers, Positive, PositivePerDisk, validated
from .tools.values import must_be

__all__ = ["Hit", "collide_step"]

MOST_HITS = 1000  # hits of one disk in one step; more is an inelastic collapse

Masses = Annotated[
    ArrayLike, Numbers(("n",), LEAST, math.inf, f"positive, from {LEAST:g}, or inf", scalar=True)
]
Pairs = Annotated[ArrayLike, Numbers(("n", 2))]
Sides = Annotated[Sequence[float] | Array, Numbers((2,), LEAST, math.inf, "positive, or inf")]
Line = tuple[tuple[float, float], tuple[float, float]]
"""A straight wall: a point on it [length], and a normal towards the disks, of any length."""
LawOfPair = Callable[[int, int], Any]


def _in_place(name: str, value: Any) -> Any:
    plain = isinstance(value, np.ndarray) and not isinstance(value, np.matrix | np.ma.MaskedArray)
    if not plain or value.dtype != np.float64 or not value.flags.writeable:
        raise must_be(name, value, "an array of float64, which is changed in place")
    if not (np.abs(value) <= MOST).all():
        raise must_be(name, value, f"finite numbers, at most {MOST:g} in size")
    return value


InPlace = Annotated[Array, _in_place]


def _law(name: str, value: Any) -> Any:
    if isinstance(value, type) and issubclass(value, CollisionLaw):
        raise must_be(name, value, f"a law with its coefficients, {value.__name__}(...), not its class")
    return value if callable(value) else any_law(name, value)


LawOrFunction = Annotated[CollisionLaw | Mapping[str, Any] | LawOfPair, _law]
"""A law, as `ifrdem.collide` takes it, or a function of the numbers of a pair that returns one."""


class Hit(NamedTuple):
    """A collision: its time since the beginning of the step [time], both disks, and the impulses.

    A disk is its index, and a wall its index after those of the disks; of a disk and a wall the disk comes first.
    `P_n` and `P_t` [mass length/time] are what the first one gives to the second along the normal n and
    t = (-n_y, n_x).
    """

    time: float
    a: int
    b: int
    P_n: float
    P_t: float


@validated
def collide_step(
    position: InPlace,
    velocity: InPlace,
    spin: InPlace,
    dt: Positive,
    law: LawOrFunction,
    *,
    mass: Masses,
    radius: PositivePerDisk,
    k: PositivePerDisk = 2.0,
    lengths: Sides | None = None,
    walls: Sequence[Line] = (),
    angle: InPlace | None = None,
) -> list[Hit]:
    """Let disks collide that have flown freely for a time `dt`; the arrays get their state after the collisions.

    Parameters
    ----------
    position, velocity, spin : arrays of float64 (n, 2), (n, 2) and (n,)
        Centres [length], velocities [length/time] and spins, counter-clockwise [rad/time], at the end of a straight
        flight of `dt`; changed in place.
    dt : float
        Time of the flight [time].
    law : CollisionLaw, mapping or callable
        One law, as `ifrdem.collide` takes it, or a function of two numbers (of disks, or n + the index of a wall) that
        returns their law.
    mass, radius, k : float or array (n,)
        Masses [mass], infinite for a disk that nothing moves, radii [length], shape numbers in I = m R^2 / k.
    lengths : array (2,), optional
        Sides of a periodic box [length]; infinite for one that is not periodic. Positions may lie outside of it, and
        stay where they are.
    walls : sequence of (point, normal)
        Straight walls at rest: a point [length], and a normal towards the disks.
    angle : array (n,), optional
        Orientations [rad] at the end of the flight, changed in place.

    Returns
    -------
    list of Hit
        The collisions of the step, in order.

    Raises
    ------
    InputError
        If a shape does not fit, a number is not finite or beyond 1e50 in size, arrays share memory, the law is a class,
        or can add energy for a pair; if a disk of infinite mass moves; or if two disks move, relative to each other, by
        more than half a periodic side less their contact distance within the step.
    InelasticCollapse
        If a disk collides again and again in one step.

    Notes
    -----
    Forces of the engine must act at the beginning of its step, on the velocities: flights within a step are straight.
    Disks that overlap and approach at the beginning of a step collide right there.

    Examples
    --------
    Two disks whose flight of 0.5 has taken them past their contact, at which smooth disks with e_n = 0.5 collide:

    >>> import numpy as np
    >>> import ifrdem
    >>> x, v, w = np.array([[0.5, 0.0], [1.25, 0.0]]), np.array([[1.0, 0.0], [0.0, 0.0]]), np.zeros(2)
    >>> law = ifrdem.IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0)
    >>> hits = ifrdem.engines.collide_step(x, v, w, 0.5, law, mass=1.0, radius=0.5)
    >>> hits[0].time, round(hits[0].P_n, 9), v[:, 0].tolist()  # P_n = (1 + e_n) m_n g_n
    (0.25, 0.75, [0.25, 0.75])
    """
    n = len(np.ravel(spin))
    arrays = {"spin": (spin, (n,)), "position": (position, (n, 2)), "velocity": (velocity, (n, 2))}
    arrays |= {} if angle is None else {"angle": (angle, (n,))}
    for name, (each, shape) in arrays.items():
        if each.shape != shape:
            raise must_be(name, each, f"of shape {shape}")
    for (one, (first, _)), (other, (second, _)) in itertools.combinations(arrays.items(), 2):
        if np.shares_memory(first, second):
            raise InputError(f"{one}, {other}: must be arrays of their own, which are changed in place")
    try:
        lines = np.array([[point, normal] for point, normal in walls], dtype=float).reshape(-1, 2, 2)
    except (TypeError, ValueError):
        lines = np.full((1, 2, 2), np.nan)
    size = np.hypot(*lines[:, 1].T)
    if not (np.isfinite(lines).all() and (size > 0.0).all()):
        raise must_be(
            "walls", walls, "pairs of a point and of a normal that has a direction, ((x, y), (n_x, n_y))"
        )
    of_disks = []
    for name, value in (("mass", mass), ("radius", radius), ("k", k)):
        each = np.asarray(value, dtype=float)
        if each.shape not in ((), (n,)):
            raise must_be(name, value, f"a number, or one for each of {n} disks")
        of_disks.append(np.broadcast_to(each, (n,)))
    if np.any(velocity[np.isinf(of_disks[0])]):
        raise must_be("velocity", velocity, "0 for disks of infinite mass, which stay where they are")
    return _Step(
        position, velocity, spin, angle, dt, law, of_disks, lengths, lines[:, 0], lines[:, 1] / size[:, None]
    ).run()


class _Step:
    """One step: flights are kept as their end points, `x` at the end of the step, and times run from -dt to 0."""

    def __init__(
        self,
        x: Array,
        v: Array,
        w: Array,
        angle: Array | None,
        dt: float,
        law: Any,
        of_disks: Sequence[Array],
        lengths: Any,
        point: Array,
        normal: Array,
    ) -> None:
        self.x, self.v, self.w, self.angle, self.dt, self.n = x, v, w, angle, dt, len(w)
        self.mass, self.radius, self.k = of_disks
        self.law: LawOfPair = law if callable(law) else lambda _a, _b: law
        self.lengths: Array = np.full(2, np.inf) if lengths is None else np.asarray(lengths, dtype=float)
        self.point, self.normal = point, normal
        self.since = np.full(self.n + len(point), -dt)  # when each present flight began

    def run(self) -> list[Hit]:
        """The collisions, in order."""
        hits: list[Hit] = []
        count = np.zeros(self.n, dtype=int)
        pairs, times = self._all()
        while True:
            due = np.flatnonzero(times == times.min(initial=np.inf))
            if not len(due) or not times[due[0]] <= 0.0:
                return hits
            first = min(due, key=lambda at: tuple(pairs[at]))  # exact ties: the smallest numbers
            i, j = map(int, pairs[first])
            hits.append(self._collide(float(times[first]), i, j))
            hit = [one for one in (i, j) if one < self.n]
            count[hit] += 1
            if count.max() > MOST_HITS:
                text = f"{MOST_HITS} times in one step of {self.dt:g}: an inelastic collapse"
                raise InelasticCollapse(f"disk {int(count.argmax())} collided {text}")
            apart = ~np.isin(pairs, hit).any(axis=1)
            new = self._of(hit)
            pairs = np.concatenate([pairs[apart], new])
            times = np.concatenate([times[apart], self._times(new)])

    def _reach(self) -> float:
        """More than any two disks move towards each other in a step."""
        return 2.0 * self.dt * float(np.hypot(*self.v.T).max(initial=0.0))

    def _all(self) -> tuple[NDArray[np.int64], Array]:
        """Pairs (m, 2) that may touch within the step, and the times at which they do."""
        from scipy.spatial import cKDTree  # slow to import

        periodic = np.isfinite(self.lengths)
        sides = np.where(periodic, self.lengths, 0.0)  # which SciPy takes as not periodic
        x = np.where(periodic, np.mod(self.x, np.where(periodic, self.lengths, 1.0)), self.x)
        x = np.where(periodic & (x >= sides), 0.0, x)
        reach = self._reach() + 2.0 * float(self.radius.max(initial=0.0))
        if (reach > 0.5 * self.lengths).any():  # more than one image may be near, or the tree may not hold it
            near = np.stack(np.triu_indices(self.n, 1), axis=1)
        else:
            near = cKDTree(x, boxsize=sides).query_pairs(reach, output_type="ndarray").reshape(-1, 2)
        pairs = np.concatenate([near.astype(np.int64), self._with_all_walls(range(self.n))])
        return pairs, self._times(pairs)

    def _of(self, disks: Iterable[int]) -> NDArray[np.int64]:
        """Pairs (m, 2), each once, of which one is among these disks."""
        found, reach = [], self._reach()
        done: list[int] = []
        for i in disks:
            d = self._nearest(self.x - self.x[i])
            near = np.hypot(*d.T) <= reach + self.radius + self.radius[i]
            near[[i, *done]] = False
            others = np.flatnonzero(near)
            found.append(np.stack([np.minimum(others, i), np.maximum(others, i)], axis=1))
            done.append(i)
        return np.concatenate([*found, self._with_all_walls(done)])

    def _with_all_walls(self, disks: Iterable[int]) -> NDArray[np.int64]:
        """Pairs (m, 2) of these disks and each wall."""
        pairs = [(i, self.n + wall) for i in disks for wall in range(len(self.point))]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    def _nearest(self, d: Array) -> Array:
        """Distances (..., 2) to the nearest periodic image."""
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(self.lengths), d - self.lengths * np.round(d / self.lengths), d)

    def _times(self, pairs: NDArray[np.int64]) -> Array:
        """Times at which pairs (m, 2) touch; infinite where they do not."""
        of_disks = pairs[:, 1] < self.n
        times = np.empty(len(pairs))
        times[of_disks] = self._with_disks(pairs[of_disks])
        times[~of_disks] = self._with_walls(pairs[~of_disks])
        return times

    def _with_disks(self, pair: NDArray[np.int64]) -> Array:
        i, j = pair.T
        flight_start = np.maximum(self.since[i], self.since[j])
        v = self.v[j] - self.v[i]
        r = self._nearest(self.x[j] - self.x[i]) + v * flight_start[:, None]
        sigma = self.radius[i] + self.radius[j]
        far = np.abs(v) * -flight_start[:, None] + sigma[:, None] > 0.5 * self.lengths
        if far.any():  # the image that is nearest at the end of the step need not be the one that was hit
            at = int(np.flatnonzero(far.any(axis=1))[0])
            raise InputError(
                f"dt = {self.dt:g}: disks {i[at]} and {j[at]} move by more than half a periodic side, less their "
                "contact distance, relative to each other: take shorter steps"
            )
        b, c, vv = np.sum(r * v, axis=1), np.sum(r * r, axis=1) - sigma**2, np.sum(v * v, axis=1)
        root = b * b - vv * c
        meet = (b < 0.0) & (root >= 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(meet, flight_start + np.maximum(c, 0.0) / (np.sqrt(root) - b), np.inf)

    def _with_walls(self, pair: NDArray[np.int64]) -> Array:
        i, wall = pair[:, 0], pair[:, 1] - self.n
        flight_start = np.maximum(self.since[i], self.since[pair[:, 1]])
        n = self.normal[wall]
        approach = -np.sum(self.v[i] * n, axis=1)
        at = self.x[i] + self.v[i] * flight_start[:, None] - self.point[wall]
        gap = np.sum(at * n, axis=1) - self.radius[i]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(approach > 0.0, flight_start + np.maximum(gap, 0.0) / approach, np.inf)

    def _collide(self, time: float, i: int, j: int) -> Hit:
        """Collide i and j at `time`, and put them where they then are at the end of the step."""
        if j < self.n:
            between = self._nearest(self.x[j] - self.x[i]) + (self.v[j] - self.v[i]) * time
            normal = between / math.hypot(*between)
            m_j, R_j, k_j, v_j, w_j = self.mass[j], self.radius[j], self.k[j], self.v[j], self.w[j]
        else:
            normal = -self.normal[j - self.n]
            m_j, R_j, k_j, v_j, w_j = math.inf, math.inf, self.k[i], np.zeros(2), 0.0
        after = collide(
            self.law(i, j), normal, [self.mass[i], m_j], [self.radius[i], R_j], [self.k[i], k_j],
            [self.v[i], v_j], [self.w[i], w_j],
        )  # fmt: skip
        for side, one in enumerate((i, j)):
            if one < self.n and math.isfinite(self.mass[one]):
                self.since[one] = time
                velocity, spin = after.velocity[side], float(after.spin[side])
                self.x[one] += (self.v[one] - velocity) * time
                if self.angle is not None:
                    self.angle[one] += (self.w[one] - spin) * time
                self.v[one], self.w[one] = velocity, spin
        return Hit(time + self.dt, i, j, float(after.P_n), float(after.P_t))
