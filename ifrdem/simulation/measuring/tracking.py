"""Every collision of tracked disks, in physical quantities, from the engine's log."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, shortened
from ...kernels import layout as k
from ...kernels.columns import named
from ...model.box import Box, below
from ...model.laws.collision import UNKNOWN, collide
from ...model.laws.ifr import EnergyWarning
from ...model.laws.law import CollisionLaw, parts_of
from ...model.state import Disks
from ...model.walls.wall import Wall

KICK = k.KICKED
"""In place of a partner: a force changed the disk's velocity or spin."""
ELASTIC = 9
"""In place of a `law.Regime`: a custom law or a thermal wall; elastic by a remedy for collapse."""


@dataclass(frozen=True, eq=False)
class Events:
    """Collisions of tracked disks, e rows in order of time, then id; a collision of two of them stands twice.

    Attributes
    ----------
    time : array (e,)
        When [time].
    id : array (e,) of int32
        The disk.
    partner : array (e,) of int32
        The disk that it hit; -2 - w for wall w (those at sides of the box come last); -1 (`KICK`) where a force changed
        its motion.
    position : array (e, 2)
        Its centre [length], inside the box.
    image : array (e, 2) of int32
        Box lengths travelled.
    normal : array (e, 2)
        Unit vector from its centre to the partner's, or to the wall; 0 for a kick.
    velocity_before, velocity_after : array (e, 2)
        Its velocity [length/time].
    spin_before, spin_after : array (e,)
        Its spin [rad/time].
    partner_velocity_before, partner_velocity_after : array (e, 2)
        The partner's velocity; of a wall, that of its surface at the contact.
    partner_spin_before, partner_spin_after : array (e,)
        The partner's spin; 0 for a wall.
    impulse : array (e, 2)
        P_n, P_t that it gives to the partner along n and t = (-n_y, n_x) [mass length/time].
    psi : array (e,)
        Angle of impact: between the centres' relative velocity and n, 0 to pi/2 [rad].
    regime : array (e,) of int8
        `law.Regime`; `UNKNOWN` or `ELASTIC`; 0 for a kick.
    """

    time: NDArray[np.float64]
    id: NDArray[np.int32]
    partner: NDArray[np.int32]
    position: NDArray[np.float64]
    image: NDArray[np.int32]
    normal: NDArray[np.float64]
    velocity_before: NDArray[np.float64]
    velocity_after: NDArray[np.float64]
    spin_before: NDArray[np.float64]
    spin_after: NDArray[np.float64]
    partner_velocity_before: NDArray[np.float64]
    partner_velocity_after: NDArray[np.float64]
    partner_spin_before: NDArray[np.float64]
    partner_spin_after: NDArray[np.float64]
    impulse: NDArray[np.float64]
    psi: NDArray[np.float64]
    regime: NDArray[np.int8]

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.time)

    def columns(self) -> dict[str, NDArray[Any]]:
        """The arrays by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def where(self, chosen: NDArray[Any]) -> Events:
        """Events of the selected rows."""
        return Events(*(column[chosen] for column in self.columns().values()))


def joined(parts: Sequence[Events]) -> Events:
    """The rows of all parts, one after another."""
    return Events(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Events)))


def blank(rows: int) -> Events:
    """So many rows of zeros."""
    one, pair, ids = np.zeros(rows), np.zeros((rows, 2)), np.zeros(rows, dtype=np.int32)
    return Events(
        one, ids, ids, pair, np.zeros((rows, 2), dtype=np.int32), pair, pair, pair, one, one, pair, pair, one, one,
        pair, one, np.zeros(rows, dtype=np.int8),
    )  # fmt: skip


def checked_ids(tracked: Sequence[int] | NDArray[np.integer], n: int) -> NDArray[np.int32]:
    """Ids of disks, in ascending order.

    Raises
    ------
    InputError
        If one is no whole number from 0 to n - 1, or stands there twice.
    """
    try:
        given = np.asarray(tracked)
    except ValueError:  # rows of different lengths
        given = np.empty((0, 0))
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise InputError(f"tracked = {shortened(tracked)}: must be a list of disks' numbers, 0 to {n - 1}")
    ids = np.sort(given).astype(np.int64)
    if ids.size and not 0 <= ids[0] <= ids[-1] < n:
        unknown = ids[0] if ids[0] < 0 else ids[-1]
        raise InputError(f"tracked: there is no disk {unknown}; there are 0 to {n - 1}")
    twice = ids[1:][ids[1:] == ids[:-1]]
    if twice.size:
        raise InputError(f"tracked: disk {twice[0]} is named twice")
    return ids.astype(np.int32)


Rows = Callable[[NDArray[np.int32]], Disks]
"""Gives the disks of some ids; of ranks, all call it, each for its own."""


class Tracking:
    """Follows some disks of one engine of n, by ascending ids (m,); walls at sides of the box are the last ones.

    Of ranks, the root gets the events of all disks; the others have none.
    """

    def __init__(
        self,
        ids: NDArray[np.int32],
        n: int,
        disks_of: Rows,
        laws: Sequence[Sequence[CollisionLaw]],
        walls: Sequence[Wall],
    ) -> None:
        self.ids: NDArray[np.int32] = ids
        self.laws: Sequence[Sequence[CollisionLaw]] = laws
        self._disks_of, self._walls = disks_of, walls
        self.rows: NDArray[np.int32] = np.zeros(max(n, 1), dtype=np.int32)
        self.rows[ids] = np.arange(1, len(ids) + 1)
        self._found: list[Events] = []

    def take(self, until: float = math.inf) -> Events:
        """The events since the last call, up to a time [time]."""
        found = joined(self._found) if self._found else blank(0)
        now = found.time <= until
        if now.all():
            self._found = []
            return found
        self._found = [found.where(~now)]
        return found.where(now)

    def drop_after(self, time: float) -> None:
        """Drop events after a time [time]: another window begins there."""
        self._found = [found.where(found.time <= time) for found in self._found]

    def gather(self, window_begin: float, real: NDArray[Any], whole: NDArray[Any], box: Box) -> None:
        """Enter the collisions of a window that began at this time [time]: rows of `event` and `event_int`."""
        order = np.lexsort(
            (named(whole, "event_int").number, named(whole, "event_int").id, named(real, "event").time)
        )
        real, whole = real[order].astype(np.float64), whole[order]
        event, info = named(real, "event"), named(whole, "event_int")
        kicked = info.partner == KICK
        normal = event.normal.copy()
        normal /= np.where(kicked, 1.0, np.hypot(normal[:, 0], normal[:, 1]))[
            :, None
        ]  # single precision rounds it
        position, image = event.position.copy(), info.image.copy()
        for axis, length in enumerate(box.lengths):
            if box.periodic[axis]:
                boxes = np.floor(position[:, axis] / length)
                position[:, axis] = np.minimum(
                    position[:, axis] - boxes * length, below(length, np.dtype(np.float64))
                )
                image[:, axis] += boxes.astype(np.int32)
        found = replace(
            blank(len(real)),
            time=window_begin + event.time,
            id=info.id.copy(),
            partner=info.partner.copy(),
            position=position,
            image=image,
            normal=normal,
            velocity_before=event.velocity_before.copy(),
            velocity_after=event.velocity_after.copy(),
            spin_before=event.spin_before.copy(),
            spin_after=event.spin_after.copy(),
            partner_velocity_before=event.partner_velocity_before.copy(),
            partner_velocity_after=event.partner_velocity_after.copy(),
            partner_spin_before=event.partner_spin_before.copy(),
            partner_spin_after=event.partner_spin_after.copy(),
        )
        known = np.unique(np.concatenate([found.id, found.partner[found.partner >= 0]]))
        disks = self._disks_of(known)
        if not len(found):
            return
        one, two = (np.searchsorted(known, np.maximum(ids, 0)) for ids in (found.id, found.partner))
        pair = one, np.minimum(two, len(known) - 1)  # rows of `disks`; of walls, any
        relative, impulse = (
            found.velocity_before - found.partner_velocity_before,
            _impulse(found, disks, pair),
        )
        along, across = _dot(relative, normal), _cross(normal, relative)
        regime, hits = np.zeros(len(found), dtype=np.int8), np.flatnonzero(~kicked)
        regime[hits] = self._regime(found.where(hits), disks, (pair[0][hits], pair[1][hits]))
        regime[info.regime == k.BY_REMEDY] = ELASTIC
        regime[info.regime == k.BY_HEAT] = UNKNOWN
        impulse = np.stack([_dot(impulse, normal), _cross(normal, impulse)], axis=1)
        psi = np.arctan2(np.abs(across), np.maximum(along, 0.0))
        for column in (impulse, psi, found.partner_velocity_before, found.partner_velocity_after):
            column[kicked] = 0
        self._found.append(replace(found, impulse=impulse, psi=psi, regime=regime))

    def kick(
        self,
        time: float,
        before: tuple[NDArray[np.float64], NDArray[np.int32]],
        after: tuple[NDArray[np.float64], NDArray[np.int32]],
    ) -> None:
        """Note whose motion forces changed at a time [time], from places, velocities, spins (m, 5), images then."""
        changed = np.flatnonzero(np.any(before[0][:, 2:] != after[0][:, 2:], axis=1))
        if not changed.size:
            return
        old, new, rows = before[0][changed], after[0][changed], blank(len(changed))
        self._found.append(
            replace(
                rows, time=rows.time + time, id=self.ids[changed], partner=rows.partner + KICK,
                image=before[1][changed], position=old[:, :2].copy(), velocity_before=old[:, 2:4].copy(),
                velocity_after=new[:, 2:4].copy(), spin_before=old[:, 4].copy(), spin_after=new[:, 4].copy(),
            )
        )  # fmt: skip

    def _regime(self, found: Events, disks: Disks, pair: Pair) -> NDArray[np.int8]:
        """By the law, from the motion before."""
        (ids, other), partner = pair, found.partner
        velocity = np.stack([found.velocity_before, found.partner_velocity_before], axis=1)
        spin = np.stack([found.spin_before, found.partner_spin_before], axis=1)
        at_wall = partner < 0
        of_walls = np.array([wall.material for wall in self._walls] or [0])
        one = disks.material[ids]
        two = np.where(
            at_wall,
            of_walls[np.where(at_wall, -2 - partner, 0)],
            disks.material[other],
        )
        regime = np.full(len(ids), UNKNOWN, dtype=np.int8)
        for a, b in {(int(a), int(b)) for a, b in zip(one, two, strict=True)}:
            law = self.laws[a][b]
            if not law.is_proved or parts_of(type(law)) is None:
                continue
            rows = np.flatnonzero((one == a) & (two == b))
            wall, p = at_wall[rows], other[rows]
            radius = disks.radius[ids[rows]]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", EnergyWarning)  # the simulation has said so
                regime[rows] = collide(
                    law,
                    found.normal[rows],
                    np.stack([disks.mass[ids[rows]], np.where(wall, np.inf, disks.mass[p])], axis=1),
                    np.stack([radius, np.where(wall, radius, disks.radius[p])], axis=1),
                    np.stack([disks.k[ids[rows]], np.where(wall, 1.0, disks.k[p])], axis=1),
                    velocity[rows],
                    spin[rows],
                ).regime
        return regime


def _impulse(found: Events, disks: Disks, pair: Pair) -> NDArray[np.float64]:
    """Momentum that the disk gave: its own loss of momentum, or the partner's gain where it cannot move itself."""
    one, two = pair
    mass = disks.mass[one]
    lost = found.velocity_before - found.velocity_after
    given = np.where(np.isfinite(mass), mass, 0.0)[:, None] * lost
    stuck = np.flatnonzero(~np.isfinite(mass) & (found.partner >= 0))
    gained = found.partner_velocity_after[stuck] - found.partner_velocity_before[stuck]
    given[stuck] = disks.mass[two[stuck]][:, None] * gained
    return given


Pair = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows of both disks of each event among some disks; of a wall, any row."""


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


@dataclass
class Statistics:
    """Counts of the engine since it was made.

    Attributes
    ----------
    windows : int
        Windows.
    run_again : int
        Tiles that were run again.
    in_order : int
        Windows that were left to one thread.
    elastic : int
        Collisions that were elastic for a remedy for collapse, or slower than the resting speed.
    unverified : int
        Windows in which the forces in a heap did not reach the accuracy that the test of resting disks needs.
    jammed : int
        Times that a disk fell asleep at speed, jammed between others without room to fly (`kernels/events/rest.py`).
    """

    windows: int = 0
    in_order: int = 0
    run_again: int = 0
    elastic: int = 0
    unverified: int = 0
    jammed: int = 0
