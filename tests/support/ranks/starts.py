"""`mpiexec -n P python starts.py CASE FOLDER`: gases of which no rank has all disks; prints a line of JSON.

Each is compared with the same one of one process, which the first rank computes as well.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import ifrdem
from ifrdem.case import file, starts
from ifrdem.initial.from_csv import StartData
from ifrdem.mpi import Communicator, distribution

COMM = Communicator(MPI.COMM_WORLD, distributed=True)
distribution.BLOCK = 1 << 11  # so that slices begin within blocks
N = 24_000
IDS = ifrdem.slice_of(N, COMM)
FIELDS = ("position", "velocity", "spin", "collisions", "image", "last_partner", "angle", "dissipated")


def outcome(work: Callable[[], Any]) -> str:
    try:
        return repr(work())
    except (ifrdem.InputError, ifrdem.EngineError) as error:
        return f"{type(error).__name__}: {error}"


def start(ids: range) -> tuple[Any, ...]:
    """Disks of two kinds on a lattice, and all that a simulation needs."""
    number = np.arange(ids.start, ids.stop)
    disks = ifrdem.Disks(
        len(ids), mass=np.where(number % 3 == 0, 2.0, 1.0), radius=np.where(number % 5 == 0, 0.6, 0.5)
    )
    box = ifrdem.Box.from_packing_fraction(disks.radius, 0.3)
    position = ifrdem.initial.hexagonal_positions(box, disks.radius, seed=1)
    velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
    spin = ifrdem.initial.gaussian_spins(disks.n, spin_rms=1.0, seed=1)
    law = ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2)
    return disks, box, law, ifrdem.State(position, velocity, spin)


def simulation(
    comm: Communicator | None, ids: range, change: Callable[..., None] = lambda *_: None
) -> ifrdem.Simulation:
    with comm or Communicator():
        disks, box, law, state = start(ids)
    change(disks, box, state)
    options: Any = {
        "record": ["last_partner", "angle", "dissipated"],
        "device": ifrdem.Device(threads=1),
        "comm": comm,
    }
    return ifrdem.Simulation(disks, box, law, state, **options)


def differing(own: Any, expected: Any, names: tuple[str, ...] = FIELDS) -> list[str]:
    """Fields of slices that are not, to the bit, those of a whole state, which the first rank has."""
    arrays = [np.asarray(getattr(own, name)) for name in names]
    found = COMM.gather_rows(N, arrays)
    if found is None:
        return []
    return [
        name
        for name, each in zip(names, found, strict=True)
        if each.tobytes() != np.ascontiguousarray(getattr(expected, name)).tobytes()
    ]


def overlapping(disks: Any, box: Any, state: Any) -> None:
    """Disk N - 1, of the last rank, stands at the place of disk 0, of the first one."""
    place = COMM.bcast(state.position[0].copy())
    if COMM.rank == COMM.size - 1:
        state.position[-1] = place + np.array([0.125, 0.0])


def halved(disks: Any, box: Any, state: Any) -> None:
    """One rank has a disk of no use: its radius is too large."""
    if COMM.rank == 1:
        state.velocity[3, 0] = np.inf


found: dict[str, Any] = {}
gas = simulation(COMM, IDS)
observed: list[int] = []
plain = simulation(None, range(N)) if COMM.rank == 0 else None
found["start"] = differing(gas.state, plain and plain.state)
found["disks"] = [gas.disks.n, len(gas.disks.mass), gas.disks_here.n]
frames: list[Any] = []
gas.run(collisions_per_disk=1.0, frames=2, frame_callbacks=[lambda state, _: frames.append(state)])
expected: list[Any] = [None] * 3
if plain is not None:
    expected = []
    plain.run(collisions_per_disk=1.0, frames=2, frame_callbacks=[lambda state, _: expected.append(state)])
for i, (own, whole) in enumerate(zip(frames, expected, strict=True)):
    found[f"frame {i}"] = differing(own, whole)
found["energy"] = repr((gas.dissipated_energy, gas.measure().energy))
path = str(Path(sys.argv[2]) / "slices.checkpoint")
gas.save_checkpoint(path)
gas.run(collisions_per_disk=1.5)
again = simulation(COMM, IDS)
again.load_checkpoint(path)
again.run(collisions_per_disk=1.5)
remade = ifrdem.Simulation.from_checkpoint(path, comm=COMM)
remade.run(collisions_per_disk=1.5)
if plain is not None:
    found["expected energy"] = repr((plain.dissipated_energy, plain.measure().energy))
    plain.run(collisions_per_disk=1.5)
    alone = ifrdem.Simulation.from_checkpoint(path)  # by one process
    alone.run(collisions_per_disk=1.5)
    found["alone"] = bool(np.array_equal(alone.state.position, plain.state.position))
found["end"] = differing(gas.state, plain and plain.state)
found["again"] = differing(again.state, plain and plain.state)
found["remade"] = differing(remade.state, plain and plain.state)
found["overlap"] = outcome(lambda: simulation(COMM, IDS, overlapping))
found["infinite"] = outcome(lambda: simulation(COMM, IDS, halved))
found["slices"] = outcome(lambda: simulation(COMM, range(N // COMM.size - COMM.rank)))
# A case, whose slices are drawn by each rank alone; a start that only the first one has, and deals out.
for name, changes in (("case", []), ("random case", ["start.positions=random"]), ("given", [])):
    gas_of_case = file.read(sys.argv[1], changes).gas
    whole = gas_of_case.simulation().state if COMM.rank == 0 else None
    if name == "given" and COMM.rank == 0:
        gas_of_case = replace(gas_of_case, given=StartData(starts.start(gas_of_case).position, None, None))
    sliced = gas_of_case.simulation(comm=COMM)
    found[name] = differing(sliced.state, whole, FIELDS[:3])
    found["case sliced"] = sliced.comm.is_distributed
for each in COMM.gather(found) or ():
    print(json.dumps(each))
