"""The complete state of an engine, to the last bit: copy and restore it.

A state in the order of disks (`State`) gives a gas to rounding: the engine measures positions from its tiles' corners,
and a run that stopped within a window resumes from its beginning.
Imports Taichi: import this module only after `backend.start`.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from ...kernels import layout as k
from ...kernels.compiler.language import from_numpy
from ..measuring.tracking import Statistics

if TYPE_CHECKING:
    from ..engine import Engine

_LENGTHS = ("path", "tile_side", "free_path", "in_window", "speed", "local_collisions")
Snapshot = dict[str, Any]


def take(engine: Engine, *, by_block: bool = False) -> Snapshot:
    """Copy everything: the beginning of the present window, and how far the run has come in it.

    Arrays of disks (`checkpoint.OF_DISKS`) are in order of ids; of ranks each gets those of its slice, and the others
    whole. With `by_block` lists of disks may be `RowsByBlock`, which hold until the engine goes on.
    """
    with engine.exclusive_update():
        engine.take_force_values()
        a, windows, steps = engine.arrays, engine.windows, engine.force_steps
        if not engine._nothing_happens():
            windows.go_on(engine.next_kick)
        lists = a.lists(int(a.grid.part))
        found: Snapshot = {name: each if by_block else each[0 : len(each)] for name, each in lists.items()}
        found["edge_x"], found["edge_y"] = a.edges
        found["protrudes"] = np.array([a.clock.overhang])
        found["scales"] = np.array(
            [*(getattr(a.clock, name) for name in _LENGTHS), a.scale.cell_side, a.area], np.float64
        )
        found["gates"] = engine.open_gates.copy()
        found["clock"] = np.array([engine.time, engine._collided_at, engine._flow_excess])
        found.update(windows.snapshot())
        found["counts"] = np.array(
            [
                *engine._before,
                engine._asleep_before,
                engine._resting,
                engine._no_future_collisions,
                engine._windows_to_check,
            ],
            dtype=np.int64,
        )
        found["statistics"] = np.array(list(asdict(engine.statistics).values()), dtype=np.int64)
        found.update(steps.snapshot())
        found["turning"] = np.array([engine.rotation.next_step, engine.rotation.work])
        for name, value in engine.past.items():
            found[f"before_{name}"] = np.asarray(value)
    return found


def restore(engine: Engine, found: Snapshot) -> None:
    """Make an engine of the same gas what the snapshot's was; of ranks, each gives the disks of its slice.

    Raises
    ------
    InputError
        If the snapshot is incomplete, or of another number of disks.
    """
    try:
        with engine.exclusive_update():
            _restore(engine, found)
    except KeyError as error:
        raise InputError(f"checkpoint: {error.args[0]} is missing") from None


def _restore(engine: Engine, found: Snapshot) -> None:
    a, windows = engine.arrays, engine.windows
    n = len(engine.comm.slice_of(engine.n))
    if len(found["disk"]) != n:
        raise InputError(f"checkpoint: {len(found['disk'])} disks, here are {n}")
    low, high = (np.array([found["edge_x"][end], found["edge_y"][end]]) for end in (0, -1))
    a.divide((len(found["edge_x"]) - 1, len(found["edge_y"]) - 1), low, high)
    for axis, name in enumerate(("edge_x", "edge_y")):
        a.edges[axis] = found[name]
        from_numpy(getattr(a, name), found[name])
    a.single_tile = a.single_tile and a.tiles == 1
    a.grid.single_tile = int(a.single_tile)
    a.grid.part = 0
    a.take_lists(found)
    *lengths, a.scale.cell_side, a.area = found["scales"].tolist()
    for name, value in zip(_LENGTHS, lengths, strict=True):
        setattr(a.clock, name, value)
    _time, engine._collided_at, engine._flow_excess = found["clock"].tolist()
    *before, engine._resting, separated, engine._windows_to_check = found["counts"].tolist()
    engine._before, engine._asleep_before, engine._no_future_collisions = (
        before[:2],
        before[2],
        bool(separated),
    )
    if engine.rotation.rotating:
        step, engine.rotation.work = found["turning"].tolist()
        engine.rotation.next_step = int(step)
        engine.apply_gravity()
    a.clock.overhang = found["protrudes"].max()
    engine.set_gates(found["gates"])
    windows.restore(found, k.TRACKED if engine.tracking is not None else 0)
    if engine.tracking is not None:
        engine.tracking.take()  # of what was before, nothing
        engine._take_watched(k.TRACKED, windows.now)
        engine.tracking.take(windows.now)
    engine.statistics.__dict__.update(asdict(Statistics(*found["statistics"].tolist())))
    engine._counters_hold = 0  # to be looked at
    engine.past = {name: found[f"before_{name}"] for name in engine.past}
