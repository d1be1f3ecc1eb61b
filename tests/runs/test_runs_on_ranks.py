"""`ifrdem run` and `resume` on several ranks of MPI."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from support import mpi
from support.cases import case_text
from support.manual import block
from support.ranks.results import differing

import ifrdem
from ifrdem.case import file as case_file
from ifrdem.case import shipped
from ifrdem.cli import main as cli
from ifrdem.mpi import communicator
from ifrdem.tools.files import checkpoint_of
from ifrdem.trajectory import layout

CASE = case_text({
    "run.collisions_per_disk": 5.0, "run.t_end": None, "run.units": None, "box.packing_fraction": 0.3,
    "species[0].coin": "1 pta", "species[0].number": 21000, "species[0].material": None,
    "species[0].mass": None, "species[0].radius": None,
    "force": [
        {"kind": "random_kicks", "step": 0.02, "power": 0.002},
        {"kind": "langevin", "step": 0.027, "temperature": 0.001, "rate": 0.5},
        {"kind": "rescale", "step": 0.05, "energy": 0.001},
    ],
    "output": {"frames": 4, "histories_sample": 40, "picture": False, "views": False}, "material": None,
})  # fmt: skip
SUPPORT = Path(__file__).parents[1] / "support"


@pytest.fixture(scope="module")
def toml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ranks") / "gas.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def plain(toml: Path) -> Path:
    """The trajectory of one process."""
    folder = toml.parent / "plain"
    folder.mkdir()
    assert cli.main(["run", str(toml), "-o", f"{folder}/"]) == 0
    return folder / "gas.h5"


# The first 26 of 60 frames are committed together.
LONG = ["--set", "output.frames=60", "--set", "run.collisions_per_disk=60.0"]


@pytest.fixture(scope="module")
def long(toml: Path) -> Path:
    """The same, longer and with 60 frames: a run that can be killed on the way."""
    folder = toml.parent / "long"
    folder.mkdir()
    words = mpi.ifrdem("run", toml, "-o", f"{folder}/", *LONG)
    subprocess.run(list(map(str, words)), check=True, capture_output=True)
    return folder / "gas.h5"


MAX_HOURS = ["--max-hours", "1e-6"]
PARTS = ["--set", "output.parts=true"]
ONE = ["--set", "run.threads=1"]  # of a process, as those of ranks here, which keeps its kernels


def _material_and_radii() -> list[str]:
    """Words that give each disk a radius of its own, by two distributions."""
    one = 'name="{}",material="a",areal_density=1.0,speed_rms=1.0,radii='
    lognormal = '{distribution="lognormal",mean=0.01,deviation=0.002,low=0.006,high=0.02}'
    uniform = '{distribution="uniform",low=0.012,high=0.016}'
    species = (
        f"[{{number=15000,{one.format('small')}{lognormal}}},{{number=6000,{one.format('large')}{uniform}}}]"
    )
    changes = ['material=[{name="a",e_n=0.9,e_t=-0.9,mu=0.2}]', f"species={species}"]
    changes += ["start.positions=hexagonal", "output.frames=2"]
    return [word for each in changes for word in ("--set", each)]


@pytest.fixture(scope="module")
def outcomes(toml: Path, plain: Path) -> dict[str, dict[str, Any]]:
    """Commands on some of four ranks, one after another: how each ended, what it said, the files there were then."""
    folder, radii = toml.parent, _material_and_radii()
    start = ["start.motion=true", f"start.positions={plain}", "species[0].speed_rms=", "output.frames=1"]
    start += ["run.collisions_per_disk=8.0"]  # the clock continues: 3 more
    frame = [word for each in start for word in ("--set", each)]

    def run(name: str, *more: str) -> list[str]:
        (folder / name).mkdir()
        return ["run", str(toml), "-o", f"{folder / name}/", *more]

    def resume(name: str, *more: str) -> list[str]:
        return ["resume", str(folder / name / "gas.h5"), *more]

    few = {"block": 4096}  # disks of a block, so that slices begin within blocks
    many = {"gathered": 1000}  # disks, of which more are too many for a rank
    stopped = [*PARTS, *MAX_HOURS]
    steps: dict[str, tuple[int, dict[str, int], list[str]]] = {
        "stopped": (3, {}, run("stopped", *MAX_HOURS)),
        "stopped goes on": (2, {}, resume("stopped")),
        "4 parts": (4, {}, run("parts4", *PARTS)),
        "4 parts again": (2, {}, ["run", str(toml), "-o", f"{folder / 'parts4'}/", *PARTS]),
        "radii stopped": (3, few, run("radii", *radii, *stopped)),
        "radii stopped again": (2, few, resume("radii", *MAX_HOURS)),
        "gathered stopped": (2, many, run("gathered", "--set", "output.parts=false", *MAX_HOURS)),
        "gathered goes on": (3, many, resume("gathered")),
        "from a frame on ranks": (2, {}, run("from_frame", *frame, *PARTS)),
        "from a frame": (1, {}, run("from_frame_alone", *frame, *ONE)),
        "radii go on": (1, few, resume("radii", "--threads", "1")),
        "radii alone": (1, few, run("radii_alone", *radii, *ONE)),
        "1 part": (1, {}, run("parts1", *PARTS, *ONE)),
    }
    listed: list[list[Any]] = []
    for name, (ranks, constants, words) in steps.items():
        if name == "radii go on":  # no file of another run is removed
            listed.append(["touch", str(folder / "radii" / "gas.checkpoint.parts" / "gone")])
        listed.append([ranks, constants.get("block"), constants.get("gathered"), words])
    (folder / "steps.json").write_text(json.dumps(listed))
    script = SUPPORT / "ranks" / "commands.py"
    done = mpi.on(4, sys.executable, "-m", "mpi4py", script, folder / "steps.json", timeout=600.0)
    assert done.returncode == 0, done.stderr + done.stdout
    return dict(zip(steps, map(json.loads, done.stdout.splitlines()), strict=True))


def _in(folder: str, files: list[str]) -> list[str]:
    """Names of what is in a folder, of all files there are."""
    return [each.removeprefix(f"{folder}/") for each in files if str(Path(each).parent) == folder]


@pytest.mark.full
@mpi.needed
def test_a_stopped_run_resumes_bitwise_with_another_number_of_ranks(
    plain: Path, outcomes: dict[str, dict[str, Any]]
) -> None:
    """Three ranks until time is up, then two: the file of one process."""
    stopped, goes_on = outcomes["stopped"], outcomes["stopped goes on"]
    assert stopped["status"] == 3, stopped["err"]
    assert stopped["err"].count("hours are up (--max-hours)") == 1  # reported once
    assert "used by each of 3 ranks" in stopped["out"]
    assert goes_on["status"] == 0, goes_on["err"]
    assert differing(plain, plain.parents[1] / "stopped" / "gas.h5") == []
    assert _in("stopped", goes_on["files"]) == ["gas.h5", "gas.status.json"]


@pytest.mark.full
@mpi.needed
@pytest.mark.parametrize("ranks", [1, 4])  # 3, 2 and 1 one after another below
def test_a_run_in_parts_has_the_bits_of_one_file(
    plain: Path, outcomes: dict[str, dict[str, Any]], ranks: int
) -> None:
    done = outcomes["1 part" if ranks == 1 else "4 parts"]
    assert done["status"] == 0, done["err"]
    assert differing(plain, plain.parents[1] / f"parts{ranks}" / "gas.h5") == []
    names = [f"{number:04d}.h5" for number in range(ranks)]
    assert _in(f"parts{ranks}/gas.parts", done["files"]) == names
    assert _in(f"parts{ranks}", done["files"]) == ["gas.h5", "gas.parts", "gas.status.json"]
    assert all(f"gas.parts/{name}" in done["out"] for name in names)
    if ranks > 1:  # reported once
        again = outcomes["4 parts again"]
        assert again["status"] == 2
        assert again["err"].count("exists already; --force replaces it") == 1


@pytest.mark.full
@mpi.needed
def test_a_run_from_a_frame_that_ranks_read_in_slices_has_the_bits_of_one_process(
    plain: Path, outcomes: dict[str, dict[str, Any]]
) -> None:
    assert outcomes["from a frame"]["status"] == 0, outcomes["from a frame"]["err"]
    assert outcomes["from a frame on ranks"]["status"] == 0, outcomes["from a frame on ranks"]["err"]
    folders = [plain.parents[1] / name for name in ("from_frame_alone", "from_frame")]
    assert differing(*(folder / "gas.h5" for folder in folders)) == []


@pytest.mark.full
@mpi.needed
def test_a_run_in_parts_resumes_with_any_number_of_ranks(
    plain: Path, outcomes: dict[str, dict[str, Any]]
) -> None:
    """Three ranks, then two, then one process: three parts, and the file of one process, under forces.

    Each disk has a radius of its own, by two distributions, drawn in slices that begin within blocks.
    """
    folder = plain.parents[1]
    for name, status, parts in (("radii stopped", 3, 3), ("radii stopped again", 3, 2)):
        assert outcomes[name]["status"] == status, outcomes[name]["err"]
        assert len(_in("radii/gas.checkpoint.parts", outcomes[name]["files"])) == parts
    done = outcomes["radii go on"]
    assert done["status"] == 0, done["err"]
    assert outcomes["radii alone"]["status"] == 0, outcomes["radii alone"]["err"]
    assert differing(folder / "radii_alone" / "gas.h5", folder / "radii" / "gas.h5") == []
    assert len(_in("radii/gas.parts", done["files"])) == 3
    assert _in("radii/gas.checkpoint.parts", done["files"]) == ["gone"]  # which nothing else was left in
    names = ["gas.checkpoint.parts", "gas.h5", "gas.parts", "gas.status.json"]
    assert _in("radii", done["files"]) == names
    with h5py.File(folder / "radii" / "gas.h5") as file:
        assert len(np.unique(file["particles/all/radius"])) > 20_990  # hardly any two alike


@pytest.mark.full
@mpi.needed
def test_many_disks_go_into_one_file_if_the_case_says_so(
    plain: Path, outcomes: dict[str, dict[str, Any]]
) -> None:
    """No rank has all disks, but frames are gathered; checkpoints are in parts, and another number of ranks resumes."""
    stopped, goes_on = outcomes["gathered stopped"], outcomes["gathered goes on"]
    assert stopped["status"] == 3, stopped["err"]
    assert len(_in("gathered/gas.checkpoint.parts", stopped["files"])) == 2
    assert goes_on["status"] == 0, goes_on["err"]
    assert differing(plain, plain.parents[1] / "gathered" / "gas.h5") == []
    assert _in("gathered", goes_on["files"]) == ["gas.h5", "gas.status.json"]


@pytest.mark.full
@mpi.needed
def test_a_rank_that_dies_ends_the_run_and_the_checkpoint_is_good(toml: Path, plain: Path) -> None:
    folder = toml.parent / "killed"
    folder.mkdir()
    longer = ["--set", "output.frames=40"]
    words = mpi.command(2, *mpi.ifrdem("run", toml, "-o", f"{folder}/", *longer))
    run = subprocess.Popen(words, env=mpi.environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    checkpoint = checkpoint_of(folder / "gas.h5")
    end = time.monotonic() + 60.0
    while not checkpoint.exists():
        assert run.poll() is None, "it ended before it wrote a checkpoint"
        assert time.monotonic() < end
        time.sleep(0.02)
    os.kill(_rank(run.pid, 1), signal.SIGKILL)
    assert run.wait(30.0) != 0
    assert checkpoint.exists()
    assert cli.main(["resume", str(folder / "gas.h5")]) == 0
    with ifrdem.Trajectory(folder / "gas.h5") as found, ifrdem.Trajectory(plain) as expected:
        assert len(found) == 41
        assert np.array_equal(found[-1].position, expected[-1].position)
        assert np.array_equal(found[-1].velocity, expected[-1].velocity)


@pytest.mark.full
@mpi.needed
def test_a_rank_that_dies_leaves_frames_that_are_whole_in_all_parts(toml: Path, long: Path) -> None:
    """The second of two ranks is killed; the file has the counts of the run. Three ranks resume to the same bits."""
    folder = toml.parent / "dies"
    folder.mkdir()
    file = folder / "gas.h5"
    begin = mpi.ifrdem("run", toml, "-o", f"{folder}/", *LONG, "--set", "output.parts=true")
    _kill_after(3, file, 2, 1, begin)
    with ifrdem.Trajectory(file) as found, ifrdem.Trajectory(long) as expected:
        assert 3 <= len(found) < 61
        for frame, right in zip(found, expected, strict=False):
            for name in found.fields:
                assert np.array_equal(frame[name], right[name])
    done = mpi.on(3, *mpi.ifrdem("resume", file))
    assert done.returncode == 0, done.stderr
    assert differing(long, file) == []


def _kill_after(frames: int, path: Path, ranks: int, victim: int, words: Sequence[object]) -> None:
    """Start a run on ranks, and kill one of them when the file counts so many frames."""
    command, nowhere = mpi.command(ranks, *words), subprocess.DEVNULL
    run = subprocess.Popen(command, env=mpi.environment(), stdout=nowhere, stderr=nowhere)
    end = time.monotonic() + 100.0
    while _counted(path) < frames:
        assert run.poll() is None, "it ended before it was killed"
        assert time.monotonic() < end
        time.sleep(0.01)
    os.kill(_rank(run.pid, victim), signal.SIGKILL)
    assert run.wait(30.0) != 0


def _counted(path: Path) -> int:
    """Frames of a file that a run is writing, or about to; without a lock, which a resumed run would refuse."""
    try:
        with h5py.File(path, locking=False) as file:
            return len(file[f"{layout.EDGES}/step"])
    except (OSError, KeyError, RuntimeError):
        return 0


@pytest.mark.full
@mpi.needed
def test_a_checkpoint_or_trajectory_that_lacks_a_part_is_refused_on_all_ranks(toml: Path) -> None:
    folder = toml.parent / "lacking"
    folder.mkdir()
    words = mpi.ifrdem("run", toml, "-o", f"{folder}/", "--set", "output.parts=true", "--max-hours", "1e-6")
    assert mpi.on(2, *words).returncode == 3
    for part in (folder / "gas.parts" / "0001.h5", *sorted((folder / "gas.checkpoint.parts").iterdir())[1:]):
        part.rename(folder / "away")
        done = mpi.on(2, *mpi.ifrdem("resume", folder / "gas.h5"))
        assert done.returncode == 2, done.stderr
        assert done.stderr.count(part.name) == 1
        assert "is missing" in done.stderr
        assert "Traceback" not in done.stderr
        (folder / "away").rename(part)


def _rank(launcher: int, rank: int) -> int:
    """Process of a rank."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            try:
                variables = (folder / "environ").read_text().split("\0")
            except OSError:
                continue
            if f"PMI_RANK={rank}" in variables and _descends(int(folder.name), launcher):
                return int(folder.name)
    raise AssertionError("no such rank")


def _descends(process: int, ancestor: int) -> bool:
    while process > 1 and process != ancestor:
        process = int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return process == ancestor


@pytest.mark.parametrize(
    ("name", "changes", "key"),
    [
        ("heap", [], 'run.collapse = "rest"'),
        ("avalanches", [], "box.gravity_rotation_rate = -0.01"),
        ("coins_on_table", [], "box.open = true"),
        ("piston", [], "wall[0].piston"),
        ("cooling", ["run.precision=f32"], 'run.precision = "f32"'),
    ],
)
def test_what_cannot_be_divided_is_named(name: str, changes: list[str], key: str) -> None:
    count, why = case_file.read(shipped.find(name), changes).gas.usable_ranks(2)
    assert count == 1
    assert key in why


def test_a_gas_is_shared_by_as_many_ranks_as_its_tiles_can_be_divided_among(toml: Path) -> None:
    gas = case_file.read(toml, ["species[0].number=200000"]).gas
    assert gas.usable_ranks(4) == (4, "")
    count, why = gas.usable_ranks(1000)
    assert 16 <= count <= 36  # straight cuts cannot make 36 blocks of one tile each
    assert why == "200000 disks make 6 x 6 tiles"


@pytest.mark.full
@mpi.needed
def test_a_case_is_checked_on_ranks_as_by_one_process(toml: Path) -> None:
    words = list(map(str, mpi.ifrdem("check", toml)))
    alone = subprocess.run(words, check=True, capture_output=True, text=True)
    done = mpi.on(2, *words)
    assert done.returncode == 0, done.stderr
    assert done.stdout == alone.stdout


@pytest.mark.full
@mpi.needed
def test_the_lines_of_the_manual_run(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(block("ranks python"))
    done = mpi.on(2, sys.executable, "-m", "mpi4py", script)
    assert done.returncode == 0, done.stderr
    collisions, temperature = map(float, done.stdout.split())
    assert collisions == 30_000
    assert 0.5 < temperature < 1.0


@pytest.mark.full
@mpi.needed
def test_the_lines_of_the_manual_on_slices_run(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(block("ranks slices"))
    done = mpi.on(2, sys.executable, "-m", "mpi4py", script)
    assert done.returncode == 0, done.stderr
    assert (
        done.stdout.count("15000") == 4
    )  # two frames of two slices; lines of two ranks may run into each other


@pytest.mark.full
@mpi.needed
def test_calls_that_differ_from_rank_to_rank_end_on_all() -> None:
    """Two of three ranks share a gas of which only the first has disks; both raise errors, and the gas stays usable."""
    done = mpi.on(3, sys.executable, "-m", "mpi4py", SUPPORT / "ranks" / "calls.py")
    assert done.returncode == 0, done.stderr
    first, second = map(json.loads, done.stdout.splitlines())
    assert first["kinds"] == "(24000, 24000)"
    assert second["kinds"] == "(24000, 2)"  # no array of all disks there
    for each in (first, second):
        assert each["law"].startswith("InputError: box, law, walls, forces or options differ")
        assert each["forces"].startswith("InputError: box, law, walls, forces or options differ")
        assert each["set_forces"].startswith("InputError: box, law, walls, forces or options differ")
        assert "forces[0] = None: must be an object of a class" in each["one_of_none"]
        assert each["end"].startswith("InputError: the end of a run")
    assert first["seen"] == "[0, 6000]"
    assert second["seen"] == "[]"
    assert first["fails"] == "ValueError: an observer has had enough"
    assert second["fails"] == "EngineError: ValueError: an observer has had enough"
    assert first["there"] == second["there"]
    assert first["there"].startswith("(18000, 24000, ")
    assert first["momentum"] == second["momentum"] == "True"  # masses went with their disks


def test_without_mpi4py_several_ranks_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    with pytest.raises(
        communicator.InputError, match=r"requires the extra mpi: `pip install 'ifrdem\[mpi\]'"
    ):
        communicator.world()
