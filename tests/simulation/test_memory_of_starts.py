"""Memory that a start of many disks and a checkpoint take beside the arrays of the engine."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from ifrdem.initial import maxwellian, random_positions
from ifrdem.model.box import Box
from ifrdem.model.device import Device
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.mpi import distribution
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.simulation.simulation import Simulation

N = 120_000
"""More than NumPy places and compares (`cells.FEW`)."""


def test_what_is_the_same_for_all_disks_is_in_memory_once() -> None:
    disks = Disks(N, mass=np.full(N, 2.0), radius=0.5)
    state = State(np.zeros((N, 2)), np.zeros((N, 2)), np.zeros(N))
    state = State(**{name: getattr(state, name) for name in state.assignable if name != "flow"})  # once more
    alike = [disks.mass, disks.radius, disks.k, disks.material, state.collisions, state.image, state.wall_collisions,
             state.latest_collision, state.last_partner, state.angle, state.dissipated, state.asleep]  # fmt: skip
    assert all(each.strides[0] == 0 and len(each) == N for each in alike)
    with pytest.raises(ValueError, match="read-only"):
        disks.mass[0] = 1.0


def test_a_start_takes_little_memory_beside_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Less than 60 bytes a disk of NumPy: cells of 24, and what is made block by block. Rows of all at once were 260.

    Arrays of the runtime are not counted, nor is the state that is given.
    """
    disks = Disks(N, mass=1.0, radius=0.5)
    box, law = Box.from_packing_fraction(disks.radius, 0.2), IFRLaw(e_n=0.9, e_t=-0.9, mu=0.1)
    position = random_positions(box, disks.radius, seed=1)
    state = State(position, maxwellian(disks.mass, speed_rms=1.0, seed=1), np.zeros(N))
    monkeypatch.setattr(distribution, "BLOCK", 5000)  # few of all
    Simulation(disks, box, law, state, device=Device(low_memory=True))  # imports what it needs
    tracemalloc.start()
    try:
        gas = Simulation(disks, box, law, state, device=Device(low_memory=True))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 60.0 * N
    assert gas.disks.n == N


@pytest.mark.full
def test_a_checkpoint_takes_little_memory_and_has_the_same_rows(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Less than 40 bytes a disk of NumPy: an index, and a third of the present state. Rows of all at once were 160.

    Lists and states that are read in parts are those read at once, and so is what an engine makes of them.
    """
    n = 30_000
    disks = Disks(n, mass=1.0, radius=0.5)
    box, law = Box.from_packing_fraction(disks.radius, 0.2), IFRLaw(e_n=0.9, e_t=-0.9, mu=0.1)
    position = random_positions(box, disks.radius, seed=1)
    state = State(position, maxwellian(disks.mass, speed_rms=1.0, seed=1), np.zeros(n))
    gas = Simulation(disks, box, law, state, device=Device(low_memory=True))
    gas.run(t_end=0.05, progress=False)
    gas.save_checkpoint(tmp_path / "whole.h5")
    monkeypatch.setattr(distribution, "BLOCK", 2000)
    monkeypatch.setattr("ifrdem.simulation.windows.arrays.BLOCK", 2000)
    monkeypatch.setattr("ifrdem.simulation.engine.LARGE", n // 2)
    tracemalloc.start()
    try:
        gas.save_checkpoint(tmp_path / "parts.h5")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 40.0 * n
    one, other = (checkpoint.read(tmp_path / name)[0] for name in ("whole.h5", "parts.h5"))
    assert one.keys() == other.keys()
    for name, rows in one.items():
        np.testing.assert_array_equal(rows, other[name], err_msg=name)
    again = Simulation.from_checkpoint(tmp_path / "parts.h5")
    np.testing.assert_array_equal(again.state.position, gas.state.position)
    lists = [each._engine.arrays.lists(int(each._engine.arrays.grid.part)) for each in (gas, again)]
    for name, rows in lists[0].items():
        np.testing.assert_array_equal(rows[0:n], lists[1][name][0:n], err_msg=name)
