"""All that decides an engine's future, to the last bit; and how it is put back.

A state in the order of disks (`State`) tells a gas to rounding: the engine measures positions from the corners of its
tiles, and knows when windows got short and the log long. A snapshot copies the device's arrays as they are.
Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..kernels.layout import CELLS_X, CELLS_Y, LOG_CAPACITY, SPIN, TILES_X, TILES_Y, VX, VY, X, Y
from ..kernels.layout import ROW as ROW_LENGTH
from ..model.box import Box
from ..model.state import State
from .tracking import Statistics

if TYPE_CHECKING:
    from .engine import Engine

Snapshot = dict[str, NDArray[Any]]

_FLIGHT = [X, Y, VX, VY, SPIN]
# Device arrays that outlive an epoch, beside flights.
_LASTING = (
    "meta", "image", "cell", "wall_hits", "wall_work", "wall_heat", "latest", "flow_work", "last_partner",
    "angle",
)  # fmt: skip


def fingerprint(engine: Engine) -> str:
    """A hash of what must be the same for a snapshot to fit: disks, box, laws, walls, forces, seed, precision."""
    engine.check_whole()
    a, disks, box = engine.arrays, engine.disks, engine.box
    digest = hashlib.sha256()
    parts: list[Any] = [
        disks.mass, disks.radius, disks.k, disks.material, np.array(box.lengths), np.array(box.periodic),
        np.array([box.shear_rate, *engine.gravity]), a.law.to_numpy(), np.array(a.uses[:4]),
        np.array([wall.row(np.zeros(2)) for wall in engine.walls]), str(np.dtype(a.real)), engine.order == "alone",
        a.uses.tallied, a.uses.partnered, a.uses.turned, engine.seed, a.uses.collision_law.impulses.__qualname__,
    ]  # fmt: skip
    for force in engine.splitting.forces:
        parts += [type(force).__name__, np.array(force.parameters), force.step]
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(str(part.shape).encode() + np.ascontiguousarray(part).tobytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()


def take(engine: Engine) -> Snapshot:
    """Copy everything; the disks settle, which changes nothing."""
    with engine.changing():
        engine.epochs.settle(engine.time)
    a, epochs, splitting = engine.arrays, engine.epochs, engine.splitting
    found: Snapshot = {"flight": np.ascontiguousarray(a.flight.to_numpy()[:, _FLIGHT])}
    for name in _LASTING:
        found[name] = getattr(a, name).to_numpy()
    found["losses"], found["regimes"] = a.losses.copy(), a.regimes.copy()
    for name, value in a.before.items():
        found[f"before_{name}"] = value
    found["division"] = a.grid[[TILES_X, TILES_Y, CELLS_X, CELLS_Y]].astype(np.int64)
    found["room"] = a.grid[[ROW_LENGTH, LOG_CAPACITY]].astype(np.int64)
    found["clock"] = np.array([engine.time, engine._collided_at, engine._flow_excess, engine.flow_work])
    found["counts"] = np.array(
        [engine.collisions, engine.wall_hits, engine._stalled, engine._resting, epochs._in_order, epochs._burst,
         epochs.log_growth, epochs._log_growths], dtype=np.int64,
    )  # fmt: skip
    found["window"] = np.array([epochs._window])
    found["statistics"] = np.array(list(asdict(engine.statistics).values()), dtype=np.int64)
    found["next_steps"] = np.array(splitting.next_steps, dtype=np.int64)
    found["energy_inputs"] = splitting.energy_inputs.copy()
    found["lost_before"], found["regimes_before"] = engine._lost_before.copy(), engine._regimes_before.copy()
    if engine._space is not None:
        found["open"] = np.array(
            [*engine._inner.lengths, *engine._offset, engine.skin, *engine._space.numbers()]
        )
    return found


def put_back(engine: Engine, found: Snapshot) -> None:
    """Make an engine of the same gas what the snapshot's was.

    Raises
    ------
    InputError
        If the snapshot is that of another division into tiles, or incomplete.
    """
    try:
        with engine.changing():
            _put_back(engine, found)
    except KeyError as error:
        raise InputError(f"checkpoint: {error.args[0]} is missing") from None


def _put_back(engine: Engine, found: Snapshot) -> None:
    engine.epochs.settle(engine.time)
    if engine._space is not None:
        length_x, length_y, offset_x, offset_y, engine.skin, *numbers = found["open"].tolist()
        engine.lay(dummy_state(engine.n), Box((length_x, length_y)), np.array([offset_x, offset_y]))
        engine._space.set_numbers(engine._inner, numbers)
    a, epochs = engine.arrays, engine.epochs
    division = a.grid[[TILES_X, TILES_Y, CELLS_X, CELLS_Y]]
    if not np.array_equal(division, found["division"]) or len(found["flight"]) != max(engine.n, 1):
        raise InputError("checkpoint: the box is divided otherwise here; was the skin another one?")
    row, records = (int(each) for each in found["room"])
    if row > a.grid[ROW_LENGTH]:
        a.make_rows(row)
    a.make_log(records)
    flight = a.flight.to_numpy()
    flight[:, _FLIGHT] = found["flight"]
    a.flight.from_numpy(flight)
    for name in _LASTING:
        getattr(a, name).from_numpy(found[name])
    a.losses[:], a.regimes[:] = found["losses"], found["regimes"]
    a.before = {name: found[f"before_{name}"] for name in a.before}
    engine.time, engine._collided_at, engine._flow_excess, engine.flow_work = found["clock"].tolist()
    (
        engine.collisions, engine.wall_hits, engine._stalled, engine._resting, epochs._in_order, epochs._burst,
        epochs.log_growth, epochs._log_growths,
    ) = found["counts"].tolist()  # fmt: skip
    epochs.unsettle()
    epochs._window = float(found["window"][0])
    counted = Statistics(*found["statistics"].tolist())
    engine.statistics.__dict__.update(asdict(counted))
    engine.splitting.next_steps = found["next_steps"].tolist()
    engine.splitting.energy_inputs = found["energy_inputs"].copy()
    engine._lost_before, engine._regimes_before = found["lost_before"], found["regimes_before"]


def dummy_state(n: int) -> State:
    """A state whose numbers nobody reads."""
    return State(position=np.zeros((n, 2)), velocity=np.zeros((n, 2)), spin=np.zeros(n))
