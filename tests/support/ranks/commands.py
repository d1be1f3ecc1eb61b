"""`mpiexec -n P python commands.py STEPS.json`: commands of ifrdem one after another, each on some of the ranks.

STEPS.json lists [ranks, BLOCK, GATHERED, words of the command] (constants of `mpi/distribution`, or null), or
["touch", path]. Prints a line of JSON for each command: its exit status, what all ranks said, and the files that there
are then. Each process loads its kernels once, instead of at the start of each command.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ifrdem.cli.main import main
from ifrdem.mpi import communicator, distribution

COMM = MPI.COMM_WORLD
USUAL = distribution.BLOCK, distribution.GATHERED


def done(comm: Any, words: list[str]) -> dict[str, Any] | None:
    """The outcome of a command, on the first rank."""
    for name in communicator.SIZES:
        os.environ.pop(name, None)
    communicator._world = communicator.Communicator(comm)  # one rank is a process by itself
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(words)
    outcomes = comm.gather((status, out.getvalue(), err.getvalue()))
    if outcomes is None:
        return None
    statuses, outs, errs = zip(*outcomes, strict=True)
    return {"status": max(statuses), "out": "".join(outs), "err": "".join(errs)}


if __name__ == "__main__":
    place = Path(sys.argv[1])
    for step in json.loads(place.read_text()):
        if step[0] == "touch":
            if COMM.rank == 0:
                Path(step[1]).touch()
            continue
        ranks, block, gathered, words = step
        distribution.BLOCK, distribution.GATHERED = block or USUAL[0], gathered or USUAL[1]
        comm = COMM.Split(0 if COMM.rank < ranks else MPI.UNDEFINED)
        if comm != MPI.COMM_NULL and (found := done(comm, words)) is not None:
            found["files"] = sorted(str(each.relative_to(place.parent)) for each in place.parent.rglob("*"))
            print(json.dumps(found), flush=True)
        here = COMM.Ibarrier()
        while not here.Test():  # asleep: a rank that waits within MPI keeps a core busy
            time.sleep(0.01)
