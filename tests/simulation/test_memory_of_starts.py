"""Memory that a start of many disks takes beside the arrays of the engine."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from ifrdem.initial import maxwellian, random_positions
from ifrdem.model.box import Box
from ifrdem.model.device import Device
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.mpi import distribution
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
