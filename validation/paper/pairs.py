"""Two disks flown into each other by the engine, thousands of pairs at once.

Every pair has a separate patch in one large periodic box, far from the others. All meet at the same time; the
run ends when they have flown apart again. The result is read back from the trajectory file, so that a
comparison with the paper goes through all of it: kernels, engine, file and reader.

Signs are the paper's: t along the tangential approach of disk 1, omega_1 counter-clockwise, omega_2 clockwise.
"""

from __future__ import annotations

import tempfile
import warnings
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import EngineError
from ...initial.placement import check_no_overlap
from ...model.box import Box
from ...model.laws import ifr as law_module
from ...model.state import Disks, State
from ...tools.checked import Array, choice
from ...trajectory.reader import Trajectory
from ...trajectory.writer import TrajectoryWriter
from ..report.registry import ROUND_OFF as ROUND_OFF
from ..rows import engine_of
from .equations import Impact

PATCH = 6.0  # side of a pair's patch, in largest contact distances
APPROACH = 0.5  # flight before the contact of the fastest disk, in smallest contact distances


@dataclass(frozen=True)
class After:
    """Pairs after their collision, in the paper's components and signs. Every array has shape (n,)."""

    impact: Impact  # what was flown; its fields are arrays (n,)
    w_2o: Array  # spin of disk 2 before, clockwise [rad/time]
    v_1n: Array  # velocities after [length/time]
    v_1t: Array
    v_2n: Array
    v_2t: Array
    Rw_1: Array  # R_1 omega_1 after, counter-clockwise [length/time]
    Rw_2: Array  # R_2 omega_2 after, clockwise [length/time]

    @classmethod
    def seen(cls, impact: Impact, w_2o: Array, normal: Array, velocity: Array, spin: Array) -> After:
        """Pairs from velocities (n, 2, 2) and counter-clockwise spins (n, 2) after: pair, disk, component."""
        along = (normal, perpendicular(normal))
        v = [np.sum(velocity[:, disk] * unit, axis=1) for disk in (0, 1) for unit in along]
        Rw = impact.R_1 * spin[:, 0], -impact.R_2 * spin[:, 1]
        return cls(impact, w_2o, v[0], v[1], v[2], v[3], *Rw)

    def __getitem__(self, chosen: Any) -> After:
        """The pairs that an index, a slice or a mask chooses."""
        own = {f.name: getattr(self, f.name)[chosen] for f in fields(self) if f.name != "impact"}
        c = self.impact
        return After(impact=Impact(**{f.name: getattr(c, f.name)[chosen] for f in fields(c)}), **own)

    @property
    def delta_1(self) -> Array:
        """Angle of disk 1 from the line of centres [rad]."""
        return np.arctan2(self.v_1t, self.v_1n)

    @property
    def delta_2(self) -> Array:
        """Angle of disk 2 from the line of centres [rad]."""
        return np.arctan2(self.v_2t, self.v_2n)

    @property
    def alpha_1(self) -> Array:
        """Angle of disk 1 from the incoming direction, delta_1 - psi [rad]."""
        return self.delta_1 - self.impact.psi

    @property
    def alpha_2(self) -> Array:
        """Angle of disk 2 from the incoming direction, psi - delta_2 [rad]."""
        return self.impact.psi - self.delta_2

    @property
    def v_1(self) -> Array:
        """Speed of disk 1 [length/time]."""
        return np.hypot(self.v_1n, self.v_1t)

    @property
    def v_2(self) -> Array:
        """Speed of disk 2 [length/time]."""
        return np.hypot(self.v_2n, self.v_2t)

    @property
    def V_ot(self) -> Array:
        """Tangential velocity of the contact before the impact, both spins counted [length/time]."""
        return self.impact.V_ot - self.impact.R_2 * self.w_2o

    @property
    def e_t_apparent(self) -> Array:
        """e_t* = -(slip after) / (slip before)."""
        return -(self.v_1t + self.Rw_1 - self.v_2t - self.Rw_2) / self.V_ot

    @property
    def P_n(self) -> Array:
        """Normal impulse, from what disk 1 lost [mass length/time]."""
        return self.impact.m_1 * (self.impact.V_on - self.v_1n)

    @property
    def P_t(self) -> Array:
        """Tangential impulse, from what disk 1 lost [mass length/time]."""
        return self.impact.m_1 * (self.impact.v_o * np.sin(self.impact.psi) - self.v_1t)

    @property
    def energy_ratio(self) -> Array:
        """Kinetic energy of the pair after over before; an immovable disk 2 counts for nothing."""
        c = self.impact
        with np.errstate(divide="ignore"):
            m_2 = np.where(c.M > 0.0, c.m_1 / c.M, 0.0)
        before = c.m_1 * (c.v_o**2 + (c.R_1 * c.w_o) ** 2 / c.k_1) + m_2 * (c.R_2 * self.w_2o) ** 2 / c.k_2
        after = c.m_1 * (self.v_1**2 + self.Rw_1**2 / c.k_1) + m_2 * (self.v_2**2 + self.Rw_2**2 / c.k_2)
        return after / before


def fly(
    impact: Impact,
    sticking: ArrayLike = "percussion_center",
    *,
    w_2o: ArrayLike = 0.0,
    checked: bool = True,
    seed: int = 1,
) -> After:
    """Collide every pair of `impact` once, in the engine; EngineError if one did not collide exactly once.

    Fields of the impact broadcast to (n,), as `sticking` ("percussion_center", "contact_point") and the spin `w_2o` of
    disk 2 before, clockwise [rad/time]; M = 0 makes disk 2 immovable, psi may be negative. Coefficients that can add
    energy are refused (InputError) unless `checked` is False. `seed`: of the directions of the lines of centres.
    """
    c, sticking, w_2o = broadcast(impact, sticking, w_2o)
    n = len(c.psi)
    table, row, column = _law_table(c, sticking, checked)

    sigma = c.R_1 + c.R_2
    side = PATCH * float(sigma.max())
    across = max(int(np.ceil(np.sqrt(n))), 4)
    place = np.stack(np.divmod(np.arange(n), across), axis=1)
    box = Box((across * side, across * side))
    normal = directions(np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, n))
    v_1 = approach(c, normal)
    contact_time = APPROACH * float(sigma.min()) / float(np.max(c.v_o))
    x_2 = (place + 0.5) * side
    x_1 = x_2 - sigma[:, None] * normal - contact_time * v_1
    with np.errstate(divide="ignore"):
        m_2 = c.m_1 / c.M

    # Disk 1 of pair p has id 2 p, disk 2 has 2 p + 1.
    columns = (_interleave(*each) for each in ((c.m_1, m_2), (c.R_1, c.R_2), (c.k_1, c.k_2), (row, column)))
    disks = Disks(2 * n, *columns)
    velocity = _interleave(v_1, np.zeros_like(v_1))
    start = State(box.wrap(_interleave(x_1, x_2)), velocity, _interleave(c.w_o, -w_2o))
    check_no_overlap(box, disks.radius, start.position)
    end = _run(disks, box, start, table, 2.0 * contact_time)
    return After.seen(c, w_2o, normal, end.velocity.reshape(n, 2, 2), end.spin.reshape(n, 2))


def directions(angle: Array) -> Array:
    """Unit vectors (n, 2) at angles (n,) [rad]."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def perpendicular(normal: Array) -> Array:
    """Unit vectors t = (-n_y, n_x), shape (n, 2)."""
    return np.stack([-normal[:, 1], normal[:, 0]], axis=1)


def approach(c: Impact, normal: Array) -> Array:
    """Velocities of disk 1 before the impact [length/time], shape (n, 2)."""
    return (c.v_o * np.cos(c.psi))[:, None] * normal + (c.v_o * np.sin(c.psi))[:, None] * perpendicular(
        normal
    )


def _run(disks: Disks, box: Box, start: State, table: Array, t_end: float) -> State:
    """Fly to `t_end` and return the last frame of the trajectory file."""
    engine = engine_of(disks, box, start, table)
    with tempfile.TemporaryDirectory(prefix="ifrdem-pairs-") as folder:
        path = Path(folder) / "pairs.h5"
        with TrajectoryWriter(path, disks, box, precision="f64") as file:
            file.write(start)
            while engine.time < t_end:
                engine.advance(t_end=t_end)
            file.write(engine.state())
        engine.release()
        with Trajectory(path) as trajectory:
            last = trajectory[-1]
            end = State(last.position, last.velocity, last.spin, last.time, last.collisions)
    wrong = np.flatnonzero(end.collisions != 1)
    if wrong.size:
        i = int(wrong[0])
        raise EngineError(
            f"pair {i // 2} of {disks.n // 2}: disk {i % 2 + 1} collided {end.collisions[i]} times instead of once"
        )
    return end


def broadcast(impact: Impact, sticking: ArrayLike, w_2o: ArrayLike) -> tuple[Impact, NDArray[np.str_], Array]:
    """The arguments of `fly` as arrays of one shape (n,)."""
    names = [f.name for f in fields(Impact)]
    values = [np.asarray(getattr(impact, name), dtype=np.float64) for name in names]
    *values, w_2o, sticking = np.broadcast_arrays(
        *values, np.asarray(w_2o, dtype=np.float64), np.asarray(sticking)
    )
    for name in np.unique(sticking):
        choice("sticking", str(name), law_module.STICKING)
    flat = {name: value.reshape(-1).copy() for name, value in zip(names, values, strict=True)}
    return replace(impact, **flat), sticking.reshape(-1), w_2o.reshape(-1).copy()


def _law_table(
    c: Impact, sticking: NDArray[np.str_], checked: bool
) -> tuple[Array, NDArray[np.int32], NDArray[np.int32]]:
    """A table of laws, shape (s, s, 5), and which entry of it is each pair's.

    u different laws need only s = O(sqrt(2 u)) materials: every pair of materials holds one of them.
    """
    contact = (sticking == "contact_point").astype(np.float64)
    laws, index = np.unique(
        np.stack([c.e_n, c.e_t, c.mu, contact, c.rho], axis=1), axis=0, return_inverse=True
    )
    if checked:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", law_module.EnergyWarning)
            k = max(float(c.k_1.max()), float(c.k_2.max()))
            for e_n, e_t, mu, point, rho in laws:
                law_module.IFRLaw(
                    e_n=e_n, e_t=e_t, mu=mu, rho=rho, k=k, sticking=law_module.STICKING[int(point)]  # type: ignore[arg-type]
                )  # fmt: skip
    side = int(np.ceil((np.sqrt(8.0 * len(laws) + 1.0) - 1.0) / 2.0))
    row, column = (places[: len(laws)] for places in np.tril_indices(side))
    table = np.zeros((side, side, 5))
    table[row, column] = table[column, row] = laws
    index = index.reshape(-1)
    return table, row[index].astype(np.int32), column[index].astype(np.int32)


def _interleave(first: NDArray, second: NDArray) -> NDArray:
    """Values of disk 1 and disk 2, shape (n, ...), in the order of ids, shape (2 n, ...)."""
    return np.stack([first, second], axis=1).reshape(2 * len(first), *first.shape[1:])
