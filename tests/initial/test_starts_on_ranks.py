"""Starts from files of which each rank of MPI reads the rows of its slice."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from support import mpi
from support.gases import touching

from ifrdem.initial import packing, radii
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.trajectory.parts_writer import PartsWriter
from ifrdem.trajectory.writer import TrajectoryWriter

SCRIPT = Path(__file__).parents[1] / "support" / "ranks" / "files.py"
N = 601
POST = Wall.post((3.0, 4.0), 0.8)
FIELDS = ["position", "velocity", "angular_velocity"]
CASE = """
run.collisions_per_disk = 2.0
run.units = "reduced"
[[material]]
name = "m"
e_n = 0.9
e_t = -0.9
mu = 0.1
[[wall]]
shape = "post"
center = [3.0, 4.0]
radius = 0.8
material = "m"
[[species]]
name = "various"
number = 200
material = "m"
areal_density = 1.0
radii = { distribution = "uniform", low = 0.5, high = 0.75 }
[[species]]
name = "equal"
number = 401
material = "m"
mass = 2.0
radius = 0.5
[output]
parts = true
"""


def lines(rows: list[str]) -> str:
    return "\n".join(["# made by hand", "x,y,vx,vy,spin", *rows, ""])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case, and its start in files: single and double precision, in parts, as CSV, right and wrong."""
    folder = tmp_path_factory.mktemp("files")
    radius = np.concatenate([radii.uniform(200, low=0.5, high=0.75, seed=0), np.full(401, 0.5)])
    box = Box.from_packing_fraction(radius, 0.6)
    (folder / "case.toml").write_text(f"box.lengths = {list(box.lengths)}\n{CASE}")
    position = packing.grown_positions(box, radius, seed=1, walls=[POST])
    position = touching(box, radius, position)
    while np.any(close := POST.gap(position, radius) < 0.0):  # which were moved into the post
        position[close] += 1e-3 * POST.normal(position[close])[0]
    position = packing.separate(box, radius, position, walls=[POST])
    random = np.random.default_rng(1)
    state = State(position, random.normal(size=(N, 2)), random.normal(size=N))
    disks = Disks(N, mass=1.0, radius=radius)
    for name, precision in (("single", "f32"), ("double", "f64")):
        with TrajectoryWriter(folder / f"{name}.h5", disks, box, fields=FIELDS, precision=precision) as file:
            file.write(state)
    options = {"number": 4, "fields": FIELDS, "precision": "f32"}
    for name in ("parts", "lacking"):
        with PartsWriter.create(folder / f"{name}.h5", disks, disks, box, **options) as parts:
            parts.write(state)
    (folder / "lacking.parts" / "0002.h5").unlink()
    columns = np.column_stack((position, state.velocity, state.spin))
    rows = [",".join(map(repr, each)) for each in columns.tolist()]
    near = columns.copy()
    near[400, :2] = box.wrap(near[400, :2] + 0.02)
    moved = [",".join(map(repr, each)) for each in near.tolist()]
    made = {
        "right": rows,
        "near": moved,
        "short": rows[:-1],
        "long": [*rows, "1,1,1,1,1"],
        "words": [each if i % 3 else f"{each}0,1" for i, each in enumerate(rows)],
        "gaps": [
            each if i not in (17, 599) else "nan" + each[each.index(",") :] for i, each in enumerate(rows)
        ],
        "outside": [*rows[:450], f"{box.lengths[0]!r},1,0,0,0", *rows[451:]],
        "twice": [*rows[:590], *rows[:11]],
        "in the post": [*rows[:500], "3.0,4.0,0,0,0", *rows[501:]],
        "at rest": [",".join([*each.split(",")[:2], "0,0,0"]) for each in rows],
    }
    for name, each in made.items():
        (folder / f"{name}.csv").write_text(lines(each))
    (folder / "columns.csv").write_text(lines(rows).replace("spin", "spn"))
    (folder / "latin.csv").write_bytes(lines(rows).encode() + b"1,1,\xe4,1,1\n")
    return folder


@pytest.mark.full
@mpi.needed
def test_three_ranks_and_two_have_the_bits_and_the_errors_of_one_process(folder: Path) -> None:
    names = [*(path.name for path in folder.glob("*.csv")), "none.csv"]
    questions = {name: [f"start.file={name}"] for name in names}
    questions["relaxed"] = ["start.file=near.csv", "start.relax=0.05"]
    questions["too near"] = ["start.file=near.csv", "start.relax=1e-3"]
    for name in ("single", "double", "parts", "lacking"):
        questions[name] = ["start.motion=true", f"start.positions={name}.h5"]
    questions["drawn"] = ["start.positions=single.h5", *(f"species[{i}].speed_rms=1.5" for i in (0, 1))]
    questions["radii"] = ["start.positions=double.h5", "species[1].radius=0.6", "species[0].speed_rms=1.0"]
    questions["numbers"] = ["start.positions=double.h5", "species[1].number=402", "species[0].speed_rms=1.0"]
    (folder / "changes.json").write_text(json.dumps(questions))
    done = mpi.on(3, sys.executable, "-m", "mpi4py", SCRIPT, folder / "case.toml", folder / "changes.json")
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)
    case = f"{folder}/case.toml: "
    right = ("right.csv", "relaxed", "single", "double", "parts", "drawn")
    says = {
        "short.csv": 'start.file = "short.csv": has 600 disks: must be 601, the sum of',
        "long.csv": "has 602 disks: must be 601, the sum of",
        "words.csv": "line 3: 6 values: must be 5",
        "gaps.csv": "line 20: x = nan: must be a finite number",
        "outside.csv": "line 453: x = ",
        "twice.csv": "11 pairs overlap",
        "in the post.csv": "disk 500 at (3, 4) overlaps wall 0 (post) by 1.3",
        "at rest.csv": "nothing moves at the start",
        "near.csv": "overlap by 0.0",
        "too near": "more than relax = 0.001",
        "columns.csv": "unknown column 'spn' (did you mean 'spin'?)",
        "latin.csv": "not a text file in UTF-8",
        "none.csv": "there is no such file",
        "lacking": "lacking.parts/0002.h5 (disks 300 to 449) is missing",
        "radii": "have other radii: disk 200 has 0.5 there, 0.6 in this case",
        "numbers": "has 601 disks: must be 602",
    }
    assert {name.rpartition(" ")[0] for name in results} == {*right, *says}
    for name, found in results.items():
        if name[:-2] in right:
            assert found is True, name
        else:
            assert found, f"{name}: not as one process says it"
            assert found.startswith(case), found
            assert says[name[:-2]] in found, found
