"""The present state of an engine, read from the device.

Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import EngineError
from ...kernels.columns import READOUT, REGION, SPECIES, frame_dtype
from ...kernels.tiles.readout import read_out, read_regions, read_species
from ...model.box import below
from ...model.state import FrameRows, State

if TYPE_CHECKING:
    from ..engine import Engine


def totals(engine: Engine) -> NDArray[np.float64]:
    """Sums over all disks (`kernels/tiles/readout.py`) at the present time."""
    return _launch(engine, np.zeros((1, 1), np.int32), filled=0)


def species_totals(engine: Engine) -> NDArray[np.float64]:
    """Sums over each species at the present time, shape (species, columns of SPECIES)."""
    arrays, number = engine.arrays, len(engine.kinds.species)
    found = np.zeros((arrays.tiles, number, SPECIES.width))
    arrays.launch(read_species, engine.windows.part, species_totals=found)
    return arrays.domain.sums(found.reshape(arrays.tiles, -1)).reshape(number, SPECIES.width)


def region_totals(engine: Engine) -> NDArray[np.float64]:
    """Sums over the disks in each region at the present time, shape (regions, columns of REGION)."""
    arrays, sides = engine.arrays, np.array([*engine.setup.regions.values()])
    found = np.zeros((arrays.tiles, len(sides), REGION.width))
    arrays.launch(read_regions, engine.windows.part, engine.time, regions=sides, region_totals=found)
    return arrays.domain.sums(found.reshape(arrays.tiles, -1)).reshape(len(sides), REGION.width)


def _launch(engine: Engine, words: NDArray[Any], *, filled: int, first: int = 0) -> NDArray[np.float64]:
    arrays = engine.arrays
    found = np.zeros((arrays.tiles, READOUT.width))
    arrays.launch(read_out, engine.windows.part, engine.time, filled, first, frame_out=words, totals=found)
    sums = arrays.domain.sums(found)
    # Cubes of speeds may be beyond all numbers where energies are not.
    if not np.isfinite(np.delete(sums, [READOUT.energy_flux_x, READOUT.energy_flux_y])).all():
        raise EngineError(f"t = {engine.time:.9g}: a velocity or spin is not finite; please report this")
    return sums


def read_rows(
    engine: Engine,
    stored: np.dtype[Any] | None = None,
    whole: bool = False,
    rows_of: slice | None = None,
) -> tuple[FrameRows | None, NDArray[np.float64]]:
    """Disks at the present time, and their sums.

    Of ranks each gets its slice; or, of the `whole` gas, the first one all of it, and the others None. Without ranks,
    there may be only some of the disks, `rows_of` these ids; the sums are those of all. For a file, the
    rows have what it holds (`stored`, in its precision) and what the gas keeps of that.
    """
    domain, part = engine.arrays.domain, engine.windows.part
    held = {name: stored[name] for name in stored.names or ()} if stored is not None else {}
    single = any(each.base == np.float32 for each in held.values())
    kind, n = frame_dtype(engine.arrays.uses, single), domain.n_here(part)
    first = 0
    if rows_of is not None:
        first, n = rows_of.start, rows_of.stop - rows_of.start
    kept = kind.names or ()
    constant = {name: each for name, each in held.items() if name not in kept}
    rows: Any = np.empty(max(n, 1), [*kind.descr, *constant.items()])
    words = rows.view(np.uint32 if single else np.int32).reshape(len(rows), -1)
    sums = _launch(engine, words, filled=1, first=first)
    rows = rows[:n]
    if rows_of is None:
        (rows,) = domain.by_id(part, [rows])
    for name in constant:
        rows[name] = engine.past[name]
    if whole:
        gathered = engine.comm.gather_rows(engine.n, [rows])
        if gathered is None:
            return None, sums
        (rows,) = gathered
    position = rows["position"]
    for axis, periodic in enumerate(engine.box.periodic):
        if periodic:  # rounding can put a disk onto the far side, which is the next box already
            limit = below(engine.box.lengths[axis], position.dtype)
            np.minimum(position[:, axis], limit, out=position[:, axis])
    if "latest_collision" in kept:
        # Since the window's beginning; at its end, since that.
        latest = engine.windows.time_origin + rows["latest_collision"]
        rows["latest_collision"] = np.minimum(latest, engine.time)
    return FrameRows(engine.time, rows), sums


def read(engine: Engine, whole: bool = False) -> tuple[State | None, NDArray[np.float64]]:
    """The present state, and its sums; of ranks as `read_rows`."""
    frame, sums = read_rows(engine, whole=whole)
    kept = frame_dtype(engine.arrays.uses, False).names or ()
    names = [name for name in engine.past if name not in kept]
    past: Any = [np.asarray(engine.past[name]) for name in names]
    if whole:
        past = engine.comm.gather_rows(engine.n, past)
    if frame is None:
        return None, sums
    fields: dict[str, Any] = {name: np.ascontiguousarray(frame.rows[name]) for name in kept}
    for name, value in zip(names, past, strict=True):
        fields[name] = np.broadcast_to(value, value.shape)  # a view that is read-only
    flow = engine.box.flow(fields["position"]) if engine.box.shear_rate else None
    return State(time=frame.time, flow=flow, **fields), sums
