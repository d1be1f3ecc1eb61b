"""Commands that read a trajectory give the same results for one in parts as for one file."""

from __future__ import annotations

import functools
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.cases import case_text

import ifrdem
from ifrdem.analysis.catalogue import FUNCTIONS
from ifrdem.cli.main import main
from ifrdem.plots import run
from ifrdem.trajectory.parts_writer import PartsWriter

pytestmark = pytest.mark.full

CASE = case_text({
    "run.collisions_per_disk": 4.0, "run.t_end": None, "run.units": None, "box.packing_fraction": 0.3,
    "species[0].coin": "1 pta", "species[0].number": 300, "species[0].material": None,
    "species[0].mass": None, "species[0].radius": None,
    "output": {
        "frames": 6, "histories": [0, 7],
        "fields": ["position", "velocity", "angular_velocity", "collisions", "image", "angle", "last_partner", "dissipated"],
    },
    "material": None,
})  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same run in one file and in three parts."""
    folder, found = tmp_path_factory.mktemp("runs"), {}
    (folder / "gas.toml").write_text(CASE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PartsWriter, "create", functools.partial(PartsWriter.create, number=3))
        for name, parts in (("one", "false"), ("parts", "true")):
            found[name] = folder / name / "gas.h5"
            found[name].parent.mkdir()
            place = ["-o", f"{folder / name}/", "--set", f"output.parts={parts}"]
            assert main(["run", str(folder / "gas.toml"), *place, "--quiet"]) == 0
    assert len(list((folder / "parts" / "gas.parts").iterdir())) == 3
    return found


def same(
    runs: dict[str, Path], words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Run a command on both; `FILE` stands for the trajectory, `OUT` for what it writes."""
    printed, wrote = {}, {}
    for name, path in runs.items():
        out = path.parent / "out"
        monkeypatch.chdir(path.parent)
        given = [word.replace("FILE", str(path)).replace("OUT", str(out)) for word in words.split()]
        assert main(given) == 0, capsys.readouterr().err
        captured = capsys.readouterr()
        printed[name] = re.sub(r"[^ ]*/(one|parts)/", "", captured.out + captured.err)
        wrote[name] = out.read_bytes() if out.exists() else b""
        out.unlink(missing_ok=True)
    assert printed["one"] == printed["parts"]
    assert wrote["one"] == wrote["parts"]
    assert printed["one"] or wrote["one"]


@pytest.mark.parametrize(
    "words",
    [
        "analyse FILE",
        "analyse FILE msd vacf velocity --force",
        "history FILE --id 7 -o OUT",
        "export FILE --to csv -o OUT",
        "export FILE --to extxyz -o OUT --frames ::2",
        "compare FILE MEASURED --error positions=0.001",
    ],
)
def test_commands_say_the_same(runs, words, capsys, tmp_path, monkeypatch):
    if "MEASURED" in words:
        with ifrdem.Trajectory(runs["one"]) as run:
            x, y = run[3].position[7]
            t = run[3].time
        (tmp_path / "seen.csv").write_text(f"id,x,y,t\n7,{x},{y},{t}\n", encoding="utf-8")
        words = words.replace("MEASURED", str(tmp_path / "seen.csv"))
    same(runs, words, capsys, monkeypatch)


@pytest.mark.parametrize("what", ["temperatures", "energy", "disks", "velocity", "dissipation", "msd"])
def test_pictures_are_drawn_of_the_same_numbers(runs, what):
    drawn = {}
    for name, path in runs.items():
        with ifrdem.Trajectory(path) as run:
            axes = np.atleast_1d(run.plot(what)).ravel()
            drawn[name] = [line.get_xydata().tolist() for each in axes for line in each.lines]
            drawn[name] += [
                np.asarray(each.get_offsets()).tolist() for one in axes for each in one.collections
            ]
            drawn[name] += [np.asarray(each.get_array()).tolist() for one in axes for each in one.images]
    assert repr(drawn["one"]) == repr(drawn["parts"])
    assert drawn["one"]


def test_the_objects_of_notebooks_are_the_same(runs):
    with ifrdem.Trajectory(runs["one"]) as one, ifrdem.Trajectory(runs["parts"]) as parts:
        xarray = pytest.importorskip("xarray")
        xarray.testing.assert_identical(parts.to_xarray().drop_attrs(), one.to_xarray().drop_attrs())
        assert parts.to_pandas("frame", 3).equals(one.to_pandas("frame", 3))
        assert parts.to_pandas("series").equals(one.to_pandas("series"))
        assert repr(parts[2]) == repr(one[2])
        assert np.array_equal(parts[2].walls, one[2].walls)


def test_a_run_begins_with_a_frame_of_parts(runs, capsys, tmp_path):
    for name, path in runs.items():
        text = CASE.replace('name = "gas"', f'name = "{name}"').replace(
            "[output]", f'[start]\npositions = "{path}"\n[output]'
        )
        (tmp_path / f"{name}.toml").write_text(text)
        given = ["run", str(tmp_path / f"{name}.toml"), "-o", f"{tmp_path}/", "--quiet", "--no-picture"]
        assert main([*given, "--set", "run.collisions_per_disk=5.0"]) == 0, capsys.readouterr().err
    with ifrdem.Trajectory(tmp_path / "one.h5") as one, ifrdem.Trajectory(tmp_path / "parts.h5") as parts:
        assert np.array_equal(one[-1].position, parts[-1].position)


@pytest.mark.filterwarnings("default")
def test_analyses_that_a_missing_part_prevents_are_no_success(runs, capsys, tmp_path):
    shutil.copytree(runs["parts"].parent, tmp_path / "copy")
    path, out = tmp_path / "copy" / "gas.h5", ["-o", str(tmp_path / "out")]
    part = path.with_suffix(".parts") / "0001.h5"
    part.rename(tmp_path / "0001.h5")
    assert main(["analyse", str(path), *out]) == 1
    assert "velocity: not possible: " in capsys.readouterr().out
    record = json.loads((tmp_path / "out" / "gas.json").read_text())
    assert "cooling" in record["analyses"]
    assert {"velocity", "rdf", "msd"} <= set(record["damaged"])
    (tmp_path / "0001.h5").rename(part)
    assert main(["analyse", str(path), *out]) == 0  # those that were not possible are
    assert "velocity: velocities and spins" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "gas.json").read_text())["damaged"] == {}


def test_a_part_alone_is_distinguished_from_the_whole_gas(runs, capsys, tmp_path):
    part = runs["parts"].with_suffix(".parts") / "0001.h5"
    with ifrdem.Trajectory(part) as file:
        title = run.title(file)
        warnings = {
            name: FUNCTIONS[name](file, None).warnings
            for name in ("rdf", "structure-factor", "fields", "clusters", "psi6")
        }
        assert (file.part.number, file.part.first) == (1, 100)
    assert title == "0001: 100 disks, part 1 of a trajectory (disks 100 to 199)"
    for found in warnings.values():
        assert "part 1 of a trajectory (disks 100 to 199)" in found[0]
    for whole in runs.values():
        with ifrdem.Trajectory(whole) as file:
            assert file.part is None
            assert "packing fraction" in run.title(file)
            assert FUNCTIONS["fields"](file, None).warnings == []
    assert main(["info", str(part)]) == 0
    printed = capsys.readouterr().out
    assert "1 of a trajectory" in printed
    assert "packing fraction" not in printed
