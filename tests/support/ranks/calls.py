"""`mpiexec -n 3 python calls.py`: two of the ranks share a gas, make wrong calls, and print the errors.

Of disks, start, frame_callbacks and series_callbacks only the first one has any.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

import ifrdem

RANK = MPI.COMM_WORLD.rank
COMM = MPI.COMM_WORLD.Split(0 if RANK < 2 else MPI.UNDEFINED)
N = 24_000


def outcome(work: Callable[[], Any]) -> str:
    try:
        return repr(work())
    except (ifrdem.InputError, ifrdem.EngineError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


def gas(e_n: float, **options: Any) -> ifrdem.Simulation:
    disks: Any = None
    state: Any = None
    if RANK == 0:
        disks = ifrdem.Disks(N, mass=np.where(np.arange(N) % 3 == 0, 2.0, 1.0), radius=0.5)
        box = ifrdem.Box.from_packing_fraction(disks.radius, 0.3)
        position = ifrdem.initial.hexagonal_positions(box, disks.radius, seed=1)
        velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
        state = ifrdem.State(position, velocity, np.zeros(N))
    side = np.sqrt(N * np.pi * 0.25 / 0.3)
    law = ifrdem.IFRLaw(e_n=e_n, e_t=-0.9, mu=0.2)
    return ifrdem.Simulation(disks, ifrdem.Box((side, side)), law, state, comm=COMM, **options)


def fails(_state: Any, measure: Any) -> None:
    if measure.time > 0.0:
        raise ValueError("an observer has had enough")


if __name__ == "__main__":
    if COMM == MPI.COMM_NULL:
        sys.exit()
    found = {"law": outcome(lambda: gas(0.9 - 0.1 * RANK))}
    drag = [ifrdem.forces.Drag(0.1, rate=0.3 + 0.1 * RANK)]
    found["forces"] = outcome(lambda: gas(0.9, forces=drag))
    simulation, observed = gas(0.9), []
    found["set_forces"] = outcome(lambda: simulation.set_forces(drag))
    found["one_of_none"] = outcome(lambda: simulation.set_forces(drag if RANK == 0 else [None]))
    found["kinds"] = outcome(lambda: (simulation.disks.n, len(simulation.disks.mass)))
    found["end"] = outcome(lambda: simulation.run(collisions_per_disk=1.0 + RANK))
    frame_callbacks = [lambda _state, measure: observed.append(measure.collisions)] if RANK == 0 else []
    simulation.run(collisions_per_disk=0.5, frame_callbacks=frame_callbacks)
    found["seen"] = repr(observed)
    found["fails"] = outcome(
        lambda: simulation.run(collisions_per_disk=1.0, frame_callbacks=[fails] if RANK == 0 else [])
    )
    simulation.run(collisions_per_disk=1.5)  # it stays usable
    state = simulation.state
    found["there"] = repr((simulation.collisions, state.n, float(np.sum(state.position))))
    found["momentum"] = repr(bool(np.abs(simulation.measure().momentum).max() < 1e-9))
    for each in COMM.gather(found) or ():  # by one rank: lines of two may run into each other
        print(json.dumps(each))
