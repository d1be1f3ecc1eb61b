"""A gas of which no rank has all disks is, to the last bit, that of one process; and its refusals."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
from support import mpi

pytestmark = pytest.mark.full

SCRIPT = Path(__file__).parents[2] / "support" / "ranks" / "starts.py"
CASE = """
[run]
name = "gas"
threads = 1
units = "reduced"
collisions_per_disk = 1.0
[box]
packing_fraction = 0.3
[[material]]
name = "a"
e_n = 0.9
e_t = -0.9
mu = 0.2
[[species]]
name = "light"
material = "a"
number = 11001
mass = 1.0
radius = 0.5
speed_rms = 1.0
[[species]]
name = "heavy"
material = "a"
number = 12999
mass = 2.0
radius = 0.55
speed_rms = 1.0
spin_rms = 2.0
[start]
positions = "hexagonal"
"""


@mpi.needed
def test_slices_of_ranks_move_as_one_process_does(tmp_path: Path) -> None:
    """Starts, frames, energies and checkpoints, loaded by ranks and by one process; a case; errors on all ranks."""
    case = tmp_path / "gas.toml"
    case.write_text(CASE)
    done = mpi.on(3, sys.executable, "-m", "mpi4py", SCRIPT, case, tmp_path, timeout=300.0)
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == 3
    first = lines[0]
    for name in (
        "start",
        "frame 0",
        "frame 1",
        "frame 2",
        "end",
        "again",
        "remade",
        "case",
        "random case",
        "given",
    ):
        assert first[name] == [], name
    assert first["alone"]
    assert first["energy"] == first["expected energy"]
    for each in lines:
        assert each["disks"] == [24000, 4, 8000]  # no array of all disks anywhere
        assert each["case sliced"]
        for name in ("energy", "overlap", "infinite", "slices"):
            assert each[name] == first[name]
    assert re.match(r"InputError: disks 0 and 23999 overlap by", first["overlap"])
    assert re.match(r"InputError: velocity\[3\] = \[ +inf", first["infinite"])
    assert first["infinite"].endswith("(rank 1 numbers the disks of its slice from 0 on)")
    assert first["slices"].startswith("InputError: comm = Communicator(distributed=True): the ranks give [")
