"""`mpiexec -n 3 python files.py CASE CHANGES.json`: starts that ranks read in slices; prints a line of JSON.

Each list of changes of the case is read on three ranks, on two of them, and by the first one alone. It prints what
differs, and what each rank says where a start is refused.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ifrdem.case import file, rules, starts
from ifrdem.errors import InputError
from ifrdem.mpi import Communicator, distribution

PATH = Path(sys.argv[1])
distribution.BLOCK = 1 << 8  # so that sums are those of several blocks, and radii of the first species of one
rules.usable_ranks = lambda *given: (given[-1], "")  # so few disks make one tile: nothing is run here
ALL = MPI.COMM_WORLD
TWO = ALL.Split(0 if ALL.rank < 2 else MPI.UNDEFINED)


def start(changes: list[str], comm: Communicator) -> Any:
    """Columns of the own slice, and speeds of the species, or the message of an error."""
    try:
        found = file.read_on_ranks(lambda: PATH, changes, comm)
        assert found is not None
        assert found.gas.given is not None
        assert len(found.gas.given.position) == len(comm.slice_of(found.gas.n))
        gas = found.gas
        with comm:
            state = starts.start(gas)
        speeds = np.array([(each.speed_rms, each.spin_rms) for each in gas.species])
        return [state.position, state.velocity, state.spin], speeds
    except InputError as error:
        return str(error)


results: dict[str, Any] = {}
for name, changes in json.loads(Path(sys.argv[2]).read_text()).items():
    alone = start(changes, Communicator()) if ALL.rank == 0 else None
    for given in (ALL, TWO):
        if given == MPI.COMM_NULL:
            continue
        comm = Communicator(given)
        own = start(changes, comm)
        if len({isinstance(each, str) for each in comm.allgather(own)}) > 1:
            raise SystemExit(f"{name}: only some ranks refuse it")
        if isinstance(own, str):
            messages = comm.gather(own)
            if ALL.rank == 0:
                results[f"{name} {comm.size}"] = {*messages} == {alone} and own
            continue
        speeds = comm.gather(own[1])
        rows = comm.gather_rows(comm.allreduce(len(own[0][2])), own[0])
        if rows is not None:
            same = [
                a.tobytes() == np.ascontiguousarray(b).tobytes() for a, b in zip(rows, alone[0], strict=True)
            ]
            results[f"{name} {comm.size}"] = all(same) and all(
                np.array_equal(each, alone[1]) for each in speeds
            )
if ALL.rank == 0:
    print(json.dumps(results))
