"""Start commands on several ranks of MPI."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest


def mpiexec() -> Path | None:
    """The launcher of the extra `mpi`, or else one of this machine; None if there is none, or no mpi4py."""
    if importlib.util.find_spec("mpi4py") is None:
        return None
    try:
        files = importlib.metadata.files("mpich") or []
        return next(Path(str(each.locate())).resolve() for each in files if each.name == "mpiexec")
    except (importlib.metadata.PackageNotFoundError, StopIteration):
        found = shutil.which("mpiexec")
        return None if found is None else Path(found)


MPIEXEC = mpiexec()
needed = pytest.mark.skipif(MPIEXEC is None, reason="needs mpi4py and mpiexec: pip install '.[mpi]'")


def command(ranks: int, *words: object) -> list[str]:
    """Words of a command that runs on so many ranks."""
    return [str(MPIEXEC), "-n", str(ranks), *map(str, words)]


def environment(**more: str) -> dict[str, str]:
    """Environment in which mpi4py finds the library of that launcher, and ranks that wait let others compute.

    MPICH looks a thousand times for a message before it yields: there are more ranks than cores here.
    """
    assert MPIEXEC is not None
    path = os.pathsep.join(
        filter(None, (str(MPIEXEC.parent.parent / "lib"), os.environ.get("LD_LIBRARY_PATH")))
    )
    return os.environ | {"LD_LIBRARY_PATH": path, "MPIR_CVAR_POLLS_BEFORE_YIELD": "1"} | more


def on(ranks: int, *words: object, timeout: float = 120.0, **more: str) -> subprocess.CompletedProcess[str]:
    """Run a command on so many ranks to its end."""
    return subprocess.run(
        command(ranks, *words), env=environment(**more), capture_output=True, text=True, timeout=timeout
    )


def ifrdem(*words: object) -> Sequence[object]:
    """The words of a command of `ifrdem`."""
    return [sys.executable, "-m", "ifrdem", *words]
