"""No command and no writer replaces a file that a process is writing: the error names the process."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.cases import case_text
from support.layout_files import BOX, some_disks, some_state, write

from ifrdem.cli.main import main
from ifrdem.errors import InputError, TrajectoryError
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.study.results import Results
from ifrdem.tools import files
from ifrdem.trajectory import parts, repair, views
from ifrdem.trajectory.parts_writer import PartsWriter
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

CHILD = """
import fcntl, sys
sys.path[:0] = [sys.argv[1] + each for each in ("", "/tests")]
from support.layout_files import BOX, some_disks, some_state
from ifrdem.trajectory.writer import TrajectoryWriter
held = []
for place in sys.argv[3:]:
    held.append(open(place, "r+b"))
    fcntl.flock(held[-1], fcntl.LOCK_EX)
with TrajectoryWriter(sys.argv[2], some_disks(3), BOX, force=True) as writer:
    writer.write(some_state(3, 0))
    print("ready", flush=True)
    sys.stdin.readline()
    writer.write(some_state(3, 1))
"""
CASE = case_text({
    "run.t_end": 0.001, "run.units": None, "box.packing_fraction": 0.1, "species[0].number": 3,
})  # fmt: skip
LOCKED = (
    "other.nc",
    "other.vtkhdf",
    "other.csv",
    "movie.webp",
    "gas.parts/0000.h5",
    "notes/other-velocity.csv",
    "study.nc",
    "plot.png",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("use")
    write(folder / "other.h5", n=20, frames=2)
    (folder / "gas.toml").write_text(CASE)
    for name in ("gas.parts", "notes"):
        (folder / name).mkdir()
    for name in LOCKED:
        (folder / name).write_text("mine")
    return folder


@pytest.fixture(scope="module")
def writing(folder: Path) -> Iterator[int]:
    """The id of a process that writes gas.h5, and has locked some files more."""
    root = str(Path(__file__).resolve().parents[2])
    words = [
        sys.executable,
        "-c",
        CHILD,
        root,
        str(folder / "gas.h5"),
        *(str(folder / one) for one in LOCKED),
    ]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        yield child.pid
        child.stdin.write("\n")
        child.stdin.flush()
        assert child.wait(60) == 0
    with Trajectory(folder / "gas.h5") as trajectory:  # all frames are there
        assert len(trajectory) == 2


def unchanged(folder: Path) -> dict[str, tuple[int, float]]:
    found = {}
    for each in sorted(folder.rglob("*")):
        if each.is_file():
            found[str(each)] = each.stat().st_ino, each.stat().st_mtime_ns
    return found


COMMANDS = {
    "run": "run gas.toml --force --no-picture",
    "run without --force": "run gas.toml --no-picture",
    "export": "export other.h5 --to csv -o gas.h5 --force",
    "export h5": "export other.h5 --to h5 -o gas.h5 --force",
    "export beside": "export other.h5 --to csv --force",
    "movie": "movie other.h5 -o movie.webp --force",
    "plot": "plot other.h5 disks -o plot.png --force",
    "analyse": "analyse other.h5 velocity -o notes --force",
    "view": "view other.h5 --html gas.h5 --force",
    "link": "link other.h5",
    "repair": "repair other.h5 -o gas.h5 --force",
    "repair in place": "repair gas.h5 --in-place",
    "new": "new cooling -o gas.h5 --force",
    "study": "study gas.toml --seeds 1 --workers 0 -o study.nc",
}


@pytest.mark.full(keep=5)
@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_verbs_name_the_process(folder, writing, monkeypatch, capsys, words):
    monkeypatch.chdir(folder)
    before = unchanged(folder)
    assert main(words.split()) == 2
    shown = capsys.readouterr().err
    assert f"process {writing} on " in shown
    assert unchanged(folder) == before


def test_writers_name_the_process(folder, writing):
    path = folder / "gas.h5"
    named = f"process {writing} on "
    before = unchanged(folder)
    with pytest.raises(InputError, match=named):
        TrajectoryWriter(path, some_disks(3), BOX, force=True)
    with pytest.raises(InputError, match=f"checkpoint .*gas.checkpoint.h5 cannot be written: .*{named}"):
        checkpoint.write(folder / "gas.checkpoint.h5", {"one": np.zeros(3)}, {})
    with pytest.raises(InputError, match=named):
        PartsWriter.create(path, some_disks(3), some_disks(3), BOX, number=2, force=True)
    with pytest.raises(InputError, match=named):
        parts.remove(path)
    with pytest.raises(InputError, match=named):
        views.write_views(folder / "other.h5")
    with pytest.raises(InputError, match=named):
        repair.repair(path, path)
    with pytest.raises(InputError, match=named):
        Results({}, {}).write(folder / "gas.h5")
    assert unchanged(folder) == before


def test_a_part_that_is_written_keeps_its_trajectory(folder, writing, monkeypatch, capsys):
    """NAME.h5 may be another host's, whose locks are not seen: the lock of a part is enough."""
    monkeypatch.chdir(folder)
    (folder / "parted.toml").write_text(CASE.replace('"gas"', '"parted"'))
    os.makedirs(folder / "parted.parts")
    os.link(folder / "gas.parts/0000.h5", folder / "parted.parts/0000.h5")
    assert main(["run", "parted.toml", "--force", "--no-picture"]) == 2
    assert f"0000.h5: process {writing} on " in capsys.readouterr().err
    assert (folder / "parted.parts/0000.h5").exists()


def test_two_writers_of_one_process(tmp_path):
    """The old file keeps its place until the first frame; a second writer is refused from the beginning on."""
    path = tmp_path / "run.h5"
    write(path, n=3, frames=1)
    first = TrajectoryWriter(path, some_disks(3), BOX, force=True)
    with pytest.raises(InputError, match="this process is writing it"):
        TrajectoryWriter(path, some_disks(3), BOX, force=True)
    first.write(some_state(3, 0))
    with pytest.raises(InputError, match="this process is writing it"):
        TrajectoryWriter(path, some_disks(3), BOX, force=True)
    first.close()
    TrajectoryWriter(path, some_disks(3), BOX, force=True).close()  # not one frame: the old file stays
    del first
    forgotten = TrajectoryWriter(path, some_disks(3), BOX, force=True)
    del forgotten
    TrajectoryWriter(path, some_disks(3), BOX, force=True).close()
    assert len(Trajectory(path)) == 1


def test_readers_do_not_keep_a_file_from_being_replaced(tmp_path):
    """Readers hold a shared lock, and keep the file that they have opened."""
    path = tmp_path / "run.h5"
    write(path, n=3, frames=3)
    with Trajectory(path) as old:
        with TrajectoryWriter(path, some_disks(3), BOX, force=True) as writer:
            writer.write(some_state(3, 0))
        assert len(old) == 3
        assert np.isfinite(old[2].position).all()
    # While a reader kept both from locking the old file, the one that is late loses.
    with Trajectory(path):
        early, late = (TrajectoryWriter(path, some_disks(3), BOX, force=True) for _ in range(2))
        early.write(some_state(3, 0))
        with pytest.raises(TrajectoryError, match="another file was written there meanwhile"):
            late.write(some_state(3, 0))
        early.write(some_state(3, 1))
        early.close()
        late.close()
    assert [each.name for each in tmp_path.iterdir()] == ["run.h5"]
    assert len(Trajectory(path)) == 2


def test_a_run_writes_the_checkpoint_of_its_own_trajectory(tmp_path):
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(3), BOX) as writer:
        writer.write(some_state(3, 0))
        checkpoint.write(tmp_path / "run.checkpoint.h5", {"one": np.zeros(3)}, {})
    assert checkpoint.read(tmp_path / "run.checkpoint.h5")[0]["one"].tolist() == [0.0, 0.0, 0.0]


def test_a_lock_of_another_machine_is_named_by_the_status(tmp_path, monkeypatch):
    """The kernel lists no process of another machine; the status file of the run knows it."""
    path = tmp_path / "run.h5"
    path.write_text("x")
    (tmp_path / "run.status.json").write_text('{"state": "running", "pid": 41, "host": "node7"}')
    real = open

    def without_list(name, *args, **options):
        if name == "/proc/locks":
            raise FileNotFoundError(name)
        return real(name, *args, **options)

    monkeypatch.setattr("builtins.open", without_list)
    with path.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert files.being_written(path) == "process 41 on node7 is writing it"
        (tmp_path / "run.status.json").write_text("[" * 100_000)
        assert files.being_written(path) == "another process is writing it"
    assert files.being_written(path) is None


def test_parts_of_a_study_run_at_the_same_time_and_a_whole_one_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gas.toml").write_text(CASE)
    words = ["study", "gas.toml", "--seeds", "2", "--workers", "0", "-o", "study.nc"]
    (tmp_path / "study.runs").mkdir()
    with (tmp_path / "study.runs/study.lock").open("ab") as held:
        fcntl.flock(held, fcntl.LOCK_SH)  # another part
        assert main([*words, "--part", "1/2"]) == 0
        assert main(words) == 2
        assert (
            f"study.nc: another process is running this study: process {os.getpid()} on "
            in capsys.readouterr().err
        )
    assert main(words) == 0
    assert len(list((tmp_path / "study.runs").glob("*.npz"))) == 2
