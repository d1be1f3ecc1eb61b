"""`mpiexec -n P python gpus.py`: a gas on P ranks with a GPU each, and on one; prints what differs (JSON).

CUDA_VISIBLE_DEVICES says which GPUs there are, in turn.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from mpi4py import MPI
from support.gases import COIN, mixture, start

from ifrdem.model.forces import Rescale
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.windows import tiling
from ifrdem.validation.rows import engine_of

tiling.GPU_CHAINS = 0.3  # halos that are too narrow for some tiles
N, COMM = 700, MPI.COMM_WORLD


def after(comm: Any) -> tuple[Engine, dict[str, Any]]:
    """A gas at its end, and what it is then."""
    disks: Any = mixture(N)
    state: Any = None
    box, state = start(disks, 0.4)
    if comm is not None and comm.rank:
        disks = state = None
    forces = [Rescale(0.3, energy=1.0)]
    engine = engine_of(
        disks,
        box,
        state,
        np.array([[COIN]]),
        comm=comm,
        device="cuda",
        record=["last_partner"],
        forces=forces,
        tile_disks=40,
    )
    goal = engine.collisions + N
    while engine.collisions < goal:
        engine.advance(collisions=goal)
    return engine, dict(vars(engine.state())) | {"windows": engine.statistics.windows}


if __name__ == "__main__":
    engine, found = after(COMM)
    results = {
        "tiles": engine.arrays.tiles,
        "run_again": engine.statistics.run_again,
        "seen": COMM.gather(os.environ["CUDA_VISIBLE_DEVICES"]),
    }
    if COMM.rank == 0:
        expected = after(None)[1]
        results["differ"] = [name for name in expected if not np.array_equal(expected[name], found[name])]
        print(json.dumps(results))
