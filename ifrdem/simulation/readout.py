"""Moments within an epoch, by its log, when it is over and nothing has settled: frames there end no epoch.

So a trajectory does not depend, to the last bit, on how often somebody looks. Imports Taichi: import this module only
after `backend.start`.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError
from ..kernels.layout import BLOCK
from ..kernels.passing import (
    ROW_EVENTS,
    ROW_IMAGE_X,
    ROW_IMAGE_Y,
    ROW_SPIN,
    ROW_VX,
    ROW_VY,
    ROW_WORDS,
    ROW_X,
    ROW_Y,
    look_back,
)
from ..kernels.totals import TOTALS
from ..model.state import State, StoredState
from ..tools.buffers import compact
from .schedule import Due

if TYPE_CHECKING:
    from .engine import Engine


class Passing:
    """The epoch that an engine has just finished.

    Parameters
    ----------
    engine : Engine
        At the end of the epoch, which has not settled. One that `looks_back`.
    began : float
        When the epoch began [time].

    Attributes
    ----------
    before : int
        Collisions before the epoch.
    told : tuple of two floats or None
        Time of the point that was asked for last, and how long after the beginning of the epoch it is [time].
    """

    def __init__(self, engine: Engine, began: float) -> None:
        self._engine, self._began = engine, began
        self.before = engine.collisions - engine.epochs.standing()
        self.told: tuple[float, float] | None = None

    def holds(self, due: Due, end: Due) -> bool:
        """Whether a point lies in the epoch, before its end; by collisions its end counts too, but the run's not."""
        by_count = due.collisions is not None and due.collisions <= self._engine.collisions
        return (by_count and due.collisions != end.collisions) or due.time < self._engine.time

    def at(self, due: Due, *, stored: Collection[str] | None = None) -> tuple[State, NDArray[np.float64]]:
        """The state at a point that the epoch `holds`, and its sums (`kernels/totals.py`).

        Right after the last of so many collisions, and after any others at exactly that time. With the fields that a
        file in single precision has (`stored`) it is one for that (`StoredState`).
        """
        engine = self._engine
        time, moment = due.time, max(due.time - self._began, 0.0)
        if due.collisions is not None and due.collisions <= engine.collisions:
            count = due.collisions - self.before
            met = engine.epochs.time_of_collision(count) if count > 0 else 0.0
            if met < moment:
                time, moment = self._began + met, met
        self.told = time, moment
        return state_at(engine, moment, time, stored=stored)


def state_at(
    engine: Engine, moment: float, time: float, *, stored: Collection[str] | None = None
) -> tuple[State, NDArray[np.float64]]:
    """The state at a moment of the epoch that is over, which is this time, and its sums; 0 if all has settled."""
    n, take, arrays = engine.n, engine.buffers.take, engine.arrays
    wide = stored is None
    real, whole = (np.float64, np.int64) if wide else (np.float32, np.int32)
    imaged = stored is None or "image" in stored
    rows = take((n, ROW_WORDS), whole)
    past = {name: _read_only(value) for name, value in arrays.before.items()}
    if arrays.uses.partnered:
        past["last_partner"] = take((n,), np.int32)
    if arrays.uses.turned:
        past["angle"] = take((n,))
    sums = np.zeros((n // BLOCK + 1, TOTALS))
    arrays.launch(
        look_back, wide, moment, *engine.origin, *engine.highest(np.dtype(real)), int(imaged), rows_out=rows,
        partner_out=past["last_partner"], angle_out=past["angle"], sums=sums,
    )  # fmt: skip
    reals = rows.view(real)
    place, velocity = reals[:, ROW_X : ROW_Y + 1], reals[:, ROW_VX : ROW_VY + 1]
    spin = reals[:, ROW_SPIN]
    if wide:
        place, velocity, spin = compact(place), compact(velocity), compact(spin)
    events = rows[:, ROW_EVENTS].astype(np.int32, copy=False)
    image = rows[:, ROW_IMAGE_X : ROW_IMAGE_Y + 1].astype(np.int32, copy=False) if imaged else None
    kind = State if wide else StoredState
    state = kind(place, velocity, spin, time, events, image, **past)  # type: ignore[arg-type]
    totals: NDArray[np.float64] = np.ascontiguousarray(sums.T).sum(axis=1)
    if not np.isfinite(totals).all():
        raise EngineError(f"t = {time:.9g}: a velocity or spin is not finite; please report this")
    return state, totals


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view
