"""The present state of an engine, read from the device.

Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import EngineError
from ..kernels.columns import HITS_OUT, INT_OUT, MECHANISM, PAST, READOUT, REAL_OUT, named
from ..kernels.readout import read_out
from ..model.box import below
from ..model.state import State, StoredState

if TYPE_CHECKING:
    from .engine import Engine


def totals(engine: Engine) -> NDArray[np.float64]:
    """Sums over all disks (`kernels/readout.py`) at the present time."""
    part = engine.windows.part
    found = np.zeros((engine.arrays.tiles, READOUT.width))
    one, whole = np.zeros((1, REAL_OUT.width), engine.arrays.real), np.zeros((1, 3), np.int32)
    engine.arrays.launch(
        read_out, part, engine.time, 0, real_out=one, int_out=whole, past_out=np.zeros((1, PAST.width)), hits_out=whole,
        dissipated_out=np.zeros((1, MECHANISM.width)), totals=found,
    )  # fmt: skip
    return _finite(engine.arrays.domain.sums(found), engine.time)


def _finite(sums: NDArray[np.float64], time: float) -> NDArray[np.float64]:
    if not np.isfinite(sums).all():
        raise EngineError(f"t = {time:.9g}: a velocity or spin is not finite; please report this")
    return sums


def read(
    engine: Engine, stored: Collection[str] | None, whole: bool = False
) -> tuple[State | None, NDArray[np.float64]]:
    """The present state by id, and its sums.

    With the fields that a file in single precision has (`stored`) it is one for that (`StoredState`). Of ranks each
    gets its slice; or, of the `whole` gas, the first one all of it, and the others None.
    """
    arrays, uses, time = engine.arrays, engine.arrays.uses, engine.time
    part = engine.windows.part
    rows = arrays.domain.n_here(part)
    real = np.empty((max(rows, 1), REAL_OUT.width), np.float64 if stored is None else np.float32)
    counts = np.empty((max(rows, 1), INT_OUT.width), np.int32)
    dated, counted = uses.remembers or uses.turned, uses.walled or uses.partnered or uses.rests
    past: NDArray[Any] = np.empty((rows if dated else 1, PAST.width))
    hits: NDArray[Any] = np.empty((rows if counted else 1, HITS_OUT.width), np.int32)
    dissipated = np.empty((rows if uses.itemised else 1, MECHANISM.width))
    found = np.zeros((arrays.tiles, READOUT.width))
    arrays.launch(
        read_out, part, time, 1, real_out=real, int_out=counts, past_out=past, hits_out=hits, dissipated_out=dissipated,
        totals=found,
    )  # fmt: skip
    sums = _finite(arrays.domain.sums(found), time)
    columns = [real[:rows], counts[:rows]]
    columns += [past] * dated + [hits] * counted + [dissipated] * uses.itemised
    columns = arrays.domain.by_id(part, columns)
    past_before = [np.asarray(each) for each in engine.past.values()]
    if whole:
        gathered = engine.comm.gather_rows(engine.n, [*columns, *past_before])
        if gathered is None:
            return None, sums
        columns, past_before = gathered[: len(columns)], gathered[len(columns) :]
    real, counts, *columns = columns
    past, hits, dissipated = (
        columns.pop(0) if kept else none
        for kept, none in ((dated, past), (counted, hits), (uses.itemised, dissipated))
    )
    dates, counts_of = named(past, "past"), named(hits, "hits_out")
    position = real[:, 0:2]
    for axis, periodic in enumerate(engine.box.periodic):
        if periodic:  # rounding can put a disk onto the far side, which is the next box already
            np.minimum(position[:, axis], below(engine.box.lengths[axis], real.dtype), out=position[:, axis])
    fields: dict[str, Any] = {
        name: _read_only(value) for name, value in zip(engine.past, past_before, strict=True)
    }
    if uses.walled:
        fields["wall_collisions"] = counts_of.wall_collisions.copy()
    if uses.rests:
        fields["asleep"] = counts_of.asleep.copy()
    if uses.partnered:
        fields["last_partner"] = counts_of.last_partner.copy()
    if uses.remembers:
        # Since the window's beginning; at its end, since that.
        fields["latest_collision"] = np.minimum(engine.windows.time_origin + dates.latest, time)
    if uses.turned:
        fields["angle"] = dates.angle.copy()
    if uses.itemised:
        fields["dissipated"] = dissipated
    events = counts[:, 0] - (fields["wall_collisions"] if uses.walled else 0)
    flow = engine.box.flow(position.astype(np.float64)) if engine.box.shear_rate else None
    state: State
    if stored is None:
        state = State(
            np.ascontiguousarray(position), np.ascontiguousarray(real[:, 2:4]), np.ascontiguousarray(real[:, 4]), time,
            events, counts[:, 1:3].copy(), flow=flow, **fields,
        )  # fmt: skip
    else:
        image = counts[:, 1:3] if "image" in stored else None
        state = StoredState(position, real[:, 2:4], real[:, 4], time, events, image, flow=flow, **fields)  # type: ignore[arg-type]
    return state, sums


def _read_only(array: NDArray[np.generic]) -> NDArray[np.generic]:
    view = array.view()
    view.flags.writeable = False
    return view
