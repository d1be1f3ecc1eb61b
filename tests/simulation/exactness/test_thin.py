"""Thin gases, whose neighbours are found by lines of flight: the bits of the search among disks in cells."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.gases import ROUGH, equal_disks, mixture, start

from ifrdem import Device
from ifrdem.model.box import Box
from ifrdem.model.forces import PoissonKicks, RandomKicks
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.simulation import Simulation

THREAD = Device(threads=1)
RECORD = ["last_partner"]  # as tests of tracking, whose kernels serve where neighbours are not found by lines
N = 300
PHI = 1e-3


def bits_of(value: Any) -> dict[str, bytes]:
    """All numbers of a record, by name."""
    return {
        each.name: np.asarray(getattr(value, each.name)).tobytes()
        for each in dataclasses.fields(value)
        if isinstance(getattr(value, each.name), (int, float, np.ndarray))
    }


def with_few_light(n: int) -> Disks:
    """One disk in ten is so light that it is a hundred times as fast as the others."""
    disks = mixture(n)
    return dataclasses.replace(disks, mass=np.where(np.arange(n) % 10 == 1, 1e-4, disks.mass))


def spread(disks: Disks) -> tuple[Box, State]:
    """One disk is a thousand times as fast as the others, and makes fast those that it hits."""
    box, state = start(disks, PHI)
    state.velocity[7] *= 1000.0
    return box, state


def crowded(disks: Disks) -> tuple[Box, State]:
    """Half of the disks begin as a dense drop, which all lies in one cell, and flies apart through others."""
    box, state = start(disks, PHI)
    drop = np.arange(disks.n) % 2 == 0
    grid = np.stack(np.meshgrid(np.arange(15), np.arange(15)), axis=-1).reshape(-1, 2)[: int(drop.sum())]
    state.position[drop] = 1.05 * grid + 0.4
    apart = np.hypot(*box.minimum_image(state.position[~drop] - 8.0).T) < 16.0
    state.position[np.flatnonzero(~drop)[apart]] += 0.5 * np.array(box.lengths)
    return box, State(state.position, state.velocity, state.spin)


def in_walls(disks: Disks, box: Box) -> dict[str, Any]:
    floor, lid = Wall.line((0.0, 1.0), (0.0, 1.0)), Wall.line((0.0, box.lengths[1] - 1.0), (0.0, -1.0))
    forces = [RandomKicks(40.0, power=0.01), PoissonKicks(0.02, power=0.01)]
    return {"walls": [floor, lid], "gravity": (0.0, -1e-3), "forces": forces, "seed": 3}


GASES: dict[str, tuple[Callable[[int], Disks], Callable[[Disks], tuple[Box, State]]]] = {
    "mixture": (mixture, spread),
    "light disks": (with_few_light, spread),
    "drop": (mixture, crowded),
}


def story(gas: Simulation, folder: Path) -> list[dict[str, bytes]]:
    """Bytes of frames, rows, stops by time and by count, changes, tracked disks and a checkpoint of a gas."""
    told: list[dict[str, bytes]] = []
    gas.run(
        collisions_per_disk=1.5, frames=7, series=5,
        frame_callbacks=[lambda state, measure: told.extend([bits_of(state), bits_of(measure)])],
        series_callbacks=[lambda measure: told.append(bits_of(measure))],
    )  # fmt: skip
    gas.run_for(time=3.7)
    velocity = gas.state.velocity
    velocity[::40] *= -50.0
    gas.set_velocities(velocity, 2.0 * gas.state.spin)
    gas.run_for(collisions_per_disk=0.1)
    gas.save_checkpoint(folder / "c.h5")
    resumed = Simulation.from_checkpoint(folder / "c.h5", device=THREAD)
    for each in (gas, resumed):
        each.run_for(collisions_per_disk=0.7)
        told.extend([bits_of(each.state), bits_of(each.measure()), bits_of(each.take_events())])
    assert told[-6] == told[-3]
    return told


def both(
    make: Callable[[], Simulation], monkeypatch: pytest.MonkeyPatch, folder: Path
) -> list[list[dict[str, bytes]]]:
    """Bytes of a gas whose neighbours are found by lines, and of the same gas where they are not."""
    found = []
    for thin in (True, False):
        with monkeypatch.context() as patch:
            if not thin:
                patch.setattr("ifrdem.simulation.windows.tiling.THIN", 0.0)
            gas = make()
            assert gas._engine.arrays.uses.thin == thin
            found.append(story(gas, folder))
    return found


@pytest.mark.full
@pytest.mark.parametrize("name", GASES)
def test_lines_of_flight_change_no_bit(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Frames, rows, stops by time and by count, tracked disks, other velocities, and a checkpoint.

    Finds pairs that the lines leave out: fast disks, those that a collision makes fast, and full cells.
    """
    make, lay = GASES[name]

    def gas() -> Simulation:
        disks = make(N)
        box, state = lay(disks)
        return Simulation(disks, box, ROUGH, state, device=THREAD, record=RECORD, histories=range(0, N, 3))

    thin, other = both(gas, monkeypatch, tmp_path)
    assert thin == other


@pytest.mark.full
@pytest.mark.parametrize("options", ["plain", "walls and forces", "in tiles"])
def test_nor_in_other_gases(options: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Equal disks; walls, gravity and forces that act within windows; tiles with halos.

    Where walls and forces change a velocity the line must follow; the default run has `test_lines_of_flight...`.
    """
    if options == "in tiles":
        monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 100)
        monkeypatch.setattr("ifrdem.simulation.windows.tiling.tile_parameters", lambda phi: (0.5, 60))

    def gas() -> Simulation:
        disks = equal_disks(N)
        box, state = start(disks, PHI)
        more: dict[str, Any] = {"histories": range(0, N, 3)}
        if options == "walls and forces":
            box = Box(box.lengths, (True, False))
            more |= in_walls(disks, box)
        simulation = Simulation(disks, box, ROUGH, state, device=THREAD, **more)
        assert simulation._engine.arrays.single_tile == (options != "in tiles")
        return simulation

    thin, other = both(gas, monkeypatch, tmp_path)
    assert thin == other
