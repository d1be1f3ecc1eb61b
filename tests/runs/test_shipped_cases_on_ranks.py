"""`mpiexec -n 2 ifrdem run NAME` writes the file of one process, for each kind of shipped case."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import h5py
import pytest
from support import mpi
from support.ranks.results import differing

from ifrdem.case import file as case_file
from ifrdem.case import shipped

pytestmark = pytest.mark.full

SCRIPT = Path(__file__).parents[1] / "support" / "ranks" / "commands.py"
# A free gas with a history, friction on a table, disks at rest, a piston, a sheared box.
NAMES = ["cooling", "coins_on_table", "heap", "piston", "shear"]
DIVIDED = ["cooling"]  # more than one tile of some 5000 disks, and nothing that cannot be divided


def shortened(name: str) -> list[str]:
    """Words that make a run of a case a short one, with three frames and one thread."""
    run = case_file.read(shipped.find(name)).case.run
    changes = ["output.frames=2", "output.picture=false", "output.views=false", "run.threads=1"]
    if run.t_end is not None:
        changes.append(f"run.t_end={run.t_end / 500.0:.3g}")
    else:
        changes.append("run.collisions_per_disk=0.25")
    return [word for change in changes for word in ("--set", change)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shipped")


@pytest.fixture(scope="module")
def outcomes(folder: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Exit status and messages of each case on one rank and on two; each process loads its kernels once."""
    steps, keys = list[Any](), [(name, ranks) for name in NAMES for ranks in (1, 2)]
    for name, ranks in keys:
        (folder / str(ranks)).mkdir(exist_ok=True)
        words = ["run", name, "-o", f"{folder}/{ranks}/", *shortened(name)]
        steps.append([ranks, None, None, words])
    (folder / "steps.json").write_text(json.dumps(steps))
    done = mpi.on(2, sys.executable, "-m", "mpi4py", SCRIPT, folder / "steps.json", timeout=600.0)
    assert done.returncode == 0, done.stderr + done.stdout
    return dict(zip(keys, map(json.loads, done.stdout.splitlines()), strict=True))


@mpi.needed
@pytest.mark.parametrize("name", NAMES)
def test_two_ranks_write_the_file_of_one(
    name: str, folder: Path, outcomes: dict[tuple[str, int], dict[str, Any]]
) -> None:
    for ranks in (1, 2):
        assert outcomes[name, ranks]["status"] == 0, outcomes[name, ranks]["err"]
    assert differing(folder / "1" / f"{name}.h5", folder / "2" / f"{name}.h5") == []
    message = outcomes[name, 2]["out"] + outcomes[name, 2]["err"]
    assert message.count("1 of 2 ranks computes, the others wait: ") == (name not in DIVIDED)
    assert ("by each of 2 ranks" in message) == (name in DIVIDED)


@mpi.needed
def test_ranks_write_the_history_that_the_case_asks_for(
    folder: Path, outcomes: dict[tuple[str, int], dict[str, Any]]
) -> None:
    assert outcomes["cooling", 2]["status"] == 0
    with h5py.File(folder / "2" / "cooling.h5") as file:
        group = file["histories"]
        assert group["tracked"][()].tolist() == [7]
        assert set(group["events/id"][()].tolist()) <= {7}
