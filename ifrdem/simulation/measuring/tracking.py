"""Every collision of tracked disks, in physical quantities, from the engine's log."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError, shortened, there_are
from ...kernels import layout as k
from ...kernels.columns import EVENT as KERNEL_EVENT
from ...kernels.columns import named, rows_dtype
from ...model.box import Box, below
from ...model.custom_code import is_custom
from ...model.laws.collision import UNKNOWN, collide
from ...model.laws.ifr import ELASTIC, EnergyWarning
from ...model.laws.law import CollisionLaw, parts_of
from ...model.state import Disks
from ...model.walls.wall import Wall
from ...quantities import EVENT

KICK = k.KICKED
"""In place of a partner: a force changed the disk's velocity or spin."""


@dataclass(frozen=True, eq=False)
class Events:
    rows: NDArray[Any]

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.rows)

    def __getitem__(self, chosen: NDArray[Any] | slice) -> Events:
        """Events of the selected rows."""
        return Events(self.rows[chosen])

    def __getattr__(self, name: str) -> Any:
        if name not in EVENT:
            raise AttributeError(f"Events has no column {name!r}{there_are(name, EVENT)}")
        return self.rows[name]

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns by name."""
        return {name: self.rows[name] for name in EVENT}

    @classmethod
    def of(cls, count: int, **columns: ArrayLike) -> Events:
        """So many rows with these columns; the others are 0."""
        rows: NDArray[Any] = np.zeros(count, EVENT_ROW)
        for name, values in columns.items():
            rows[name] = values
        return cls(rows)

    @classmethod
    def joined(cls, parts: Sequence[Events]) -> Events:
        """The rows of all parts, one after another."""
        return cls(np.concatenate([np.zeros(0, EVENT_ROW), *(part.rows for part in parts)]))


EVENT_ROW = rows_dtype(EVENT.values(), "f8")
_COLUMNS = "\n".join(
    f"    {name} : array ({', '.join(map(str, ('e', *each.tail)))}) of {each.dtype()}\n"
    f"        {each.text[0].upper()}{each.text[1:]} [{each.dimension}]."
    for name, each in EVENT.items()
)
Events.__doc__ = f"""Collisions of tracked disks, in order of time, then id; a collision of two of them stands twice.

    Attributes
    ----------
    rows : array (e,)
        Structured array of the columns, which are attributes too.
{_COLUMNS}
    """


def checked_ids(histories: Sequence[int] | NDArray[np.integer], n: int) -> NDArray[np.int32]:
    """Ids of disks, in ascending order.

    Raises
    ------
    InputError
        If one is no whole number from 0 to n - 1, or stands there twice.
    """
    try:
        given = np.asarray(histories)
    except ValueError:  # rows of different lengths
        given = np.empty((0, 0))
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise InputError(
            f"histories = {shortened(histories)}: must be a list of disks' numbers, 0 to {n - 1}"
        )
    ids = np.sort(given).astype(np.int64)
    if ids.size and not 0 <= ids[0] <= ids[-1] < n:
        unknown = ids[0] if ids[0] < 0 else ids[-1]
        raise InputError(f"histories: there is no disk {unknown}; there are 0 to {n - 1}")
    twice = ids[1:][ids[1:] == ids[:-1]]
    if twice.size:
        raise InputError(f"histories: disk {twice[0]} is named twice")
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
        found = Events.joined(self._found)
        now = found.time <= until
        if now.all():
            self._found = []
            return found
        self._found = [found[~now]]
        return found[now]

    def drop_after(self, time: float) -> None:
        """Drop events after a time [time]: another window begins there."""
        self._found = [found[found.time <= time] for found in self._found]

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
        # What the law gives follows; all else has the same name in the kernel's rows.
        given = {name: getattr(event, name) for name in EVENT.keys() & KERNEL_EVENT.at.keys()}
        given |= {"time": window_begin + event.time, "id": info.id, "partner": info.partner}
        found = Events.of(len(real), **given | {"position": position, "image": image, "normal": normal})
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
        regime, hits = found.regime, np.flatnonzero(~kicked)
        regime[hits] = self._regime(found[hits], disks, (pair[0][hits], pair[1][hits]), box)
        regime[info.regime == k.BY_REMEDY] = ELASTIC
        regime[info.regime == k.BY_HEAT] = UNKNOWN
        found.impulse[:] = np.stack([_dot(impulse, normal), _cross(normal, impulse)], axis=1)
        found.psi[:] = np.arctan2(np.abs(across), np.maximum(along, 0.0))
        for column in (found.impulse, found.psi, found.partner_velocity_before, found.partner_velocity_after):
            column[kicked] = 0
        self._found.append(found)

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
        old, new = before[0][changed], after[0][changed]
        self._found.append(
            Events.of(
                len(changed), time=time, id=self.ids[changed], partner=KICK, image=before[1][changed],
                position=old[:, :2], velocity_before=old[:, 2:4], velocity_after=new[:, 2:4],
                spin_before=old[:, 4], spin_after=new[:, 4],
            )
        )  # fmt: skip

    def _regime(self, found: Events, disks: Disks, pair: Pair, box: Box) -> NDArray[np.int8]:
        """By the law, from the motion before."""
        from ...kernels.laws.law import reduced_radius  # imports Taichi, which is slow

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
            if is_custom(type(law)) or parts_of(type(law)) is None:
                continue
            rows = np.flatnonzero((one == a) & (two == b))
            wall, p = at_wall[rows], other[rows]
            radius = disks.radius[ids[rows]]
            contact = reduced_radius(radius, np.where(wall, radius, disks.radius[p]))
            for at in np.flatnonzero(wall):
                row = rows[at]
                contact[at] = self._walls[-2 - partner[row]].reduced_radius(
                    radius[at], found.position[row], found.normal[row], found.time[row], box
                )
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
                    contact,
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
