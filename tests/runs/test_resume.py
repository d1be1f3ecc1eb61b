"""A stopped run resumes to the same file, bit for bit, as an uninterrupted one."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.cases import case_text

from ifrdem.case import starts
from ifrdem.case.case import CaseSections
from ifrdem.cli import main as cli
from ifrdem.errors import InputError, Stopped
from ifrdem.kernels.events.events import MOST_EVENTS_OF_A_LAUNCH
from ifrdem.model.observables import Measure
from ifrdem.model.state import State
from ifrdem.runs import run
from ifrdem.runs.recorder import Recorder
from ifrdem.runs.signals import Stops
from ifrdem.simulation import backend
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.windows.runner import TileRunner
from ifrdem.tools.versions import package_versions
from ifrdem.trajectory.background import AsyncWriter
from ifrdem.trajectory.reader import Trajectory

CASE = case_text({
    "run.seed": 3, "run.threads": 1, "run.t_end": 2.0, "box.packing_fraction": 0.3, "material[0].e_n": 0.87,
    "material[0].e_t": -0.88, "material[0].mu": 0.21, "species[0].number": 400,
    "species[0].speed_rms": 1.4, "force": [{"kind": "random_kicks", "step": 0.05, "power": 0.5}],
    "output": {
        "frames": 12,
        "fields": ["position", "velocity", "angle", "angular_velocity", "collisions", "image", "last_partner"],
        "series": 70, "histories_sample": 20, "picture": False,
    },
})  # fmt: skip


def contents(path: Path) -> dict[str, bytes]:
    """Every dataset and attribute of a trajectory but the time and place of its writing."""
    found: dict[str, bytes] = {}

    def take(name: str, item: h5py.Dataset | h5py.Group) -> None:
        for key, value in item.attrs.items():
            found[f"{name}@{key}"] = str(np.asarray(value).tolist()).encode()
        if isinstance(item, h5py.Dataset) and name not in ("parameters/started", "parameters/threads"):
            found[name] = np.asarray(item[()]).tobytes() if item.shape else str(item[()]).encode()

    with h5py.File(path, "r") as file:
        file.visititems(take)
    return found


def same(one: Path, other: Path) -> None:
    a, b = contents(one), contents(other)
    assert a.keys() == b.keys()
    assert [name for name in a if a[name] != b[name]] == []


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The trajectory of the uninterrupted run; the case file is next to it."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "gas.toml").write_text(CASE)
    assert cli.main(["run", str(folder / "gas.toml"), "-o", f"{folder}/"]) == 0
    assert sorted(each.name for each in folder.iterdir()) == [
        "gas.h5",
        "gas.nc",
        "gas.status.json",
        "gas.toml",
        "gas.vtkhdf",
    ]
    backend.stop()  # stores the kernels, which processes below load
    return folder / "gas.h5"


@pytest.fixture
def stopping(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Stops the run after so many looks at the signals, the first of the list; the run after it by the second ..."""
    plan: list[int] = []

    def check(self: Stops) -> None:
        if plan:
            plan[0] -= 1
            if plan[0] < 0:
                plan.pop(0)
                raise Stopped("interrupted", 130)

    monkeypatch.setattr(Stops, "check", check)
    return plan


SAVE = run.save


def save_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the first checkpoint is written: what comes after it is lost, as if the run were killed."""
    calls: list[int] = []

    def first_only(running: run.Run, recorder: run.Recorder) -> None:
        calls.append(1)
        if len(calls) == 1:
            SAVE(running, recorder)

    monkeypatch.setattr(run, "save", first_only)


@pytest.mark.full
@pytest.mark.parametrize("threads", ["1", "2"])
def test_a_run_stopped_again_and_again_is_the_same_to_the_bit(whole, tmp_path, stopping, threads, capsys):
    case = whole.parent / "gas.toml"
    stopping += [0, 5, 13, 40]  # in the very beginning, and later
    assert cli.main(["run", str(case), "-o", f"{tmp_path}/", "--set", f"run.threads={threads}"]) == 130
    printed = capsys.readouterr().err
    assert "gas.h5 holds the 1 frame so far" in printed
    assert f"ifrdem resume {tmp_path / 'gas.h5'}" in printed
    for _ in range(3):
        assert cli.main(["resume", str(tmp_path)]) == 130
    assert cli.main(["resume", str(tmp_path / "gas.h5")]) == 0
    assert "energy balance: relative error" in capsys.readouterr().out
    made = contents(tmp_path / "gas.h5")
    expected = contents(whole)
    # The command line's own words are in the record.
    differ = {name for name in made if made[name] != expected[name]}
    assert differ <= {"parameters/overrides", "parameters/case_in_full"}
    assert not (tmp_path / "gas.checkpoint.h5").exists()


@pytest.mark.full
def test_frames_after_the_checkpoint_are_kept_and_compared(whole, tmp_path, monkeypatch, stopping):
    """Killed long after its checkpoint: later committed frames stay, and the resumed run has the same ones."""
    case = whole.parent / "gas.toml"
    stopping += [60]
    save_once(monkeypatch)
    monkeypatch.setattr("ifrdem.runs.recorder.WAIT", 0.0)  # every row is committed at once
    assert cli.main(["run", str(case), "-o", f"{tmp_path}/"]) == 130
    with h5py.File(tmp_path / "gas.h5") as file:
        frames = len(file["particles/all/box/edges/step"])
        rows = len(file["timeseries/step"])
    assert frames > 3
    assert rows > 10
    monkeypatch.setattr(run, "save", SAVE)
    assert cli.main(["resume", str(tmp_path)]) == 0
    same(tmp_path / "gas.h5", whole)


@pytest.mark.full
def test_a_run_with_old_words_is_resumed(whole, tmp_path, stopping):
    """A checkpoint as an earlier version wrote it, beside the case file of its run, which the user has not changed."""
    shutil.copy(whole.parent / "gas.toml", case := tmp_path / "gas.toml")
    stopping += [30]
    assert cli.main(["run", str(case), "-o", f"{tmp_path}/"]) == 130
    arrays, record = checkpoint.read(tmp_path / "gas.checkpoint.h5")
    assert record["gas"]["record"] == ["angle", "last_partner", "ledger"]
    record["gas"]["record"] = ["angle", "energy", "partner"]
    old = record["extra"]["case"].replace("random_kicks", "random_force")
    as_set = record["extra"]["case_as_set"].replace("random_kicks", "random_force")
    assert as_set != record["extra"]["case_as_set"]
    record["extra"] |= {"case": old, "case_as_set": as_set}
    checkpoint.write(tmp_path / "gas.checkpoint.h5", arrays, record)
    case.write_text(old)
    assert cli.main(["resume", str(tmp_path)]) == 0
    same(tmp_path / "gas.h5", whole)


def test_a_file_that_was_changed_is_not_gone_on_with(whole, tmp_path, monkeypatch, stopping, capsys):
    case = whole.parent / "gas.toml"
    stopping += [30]
    save_once(monkeypatch)
    assert cli.main(["run", str(case), "-o", f"{tmp_path}/"]) == 130
    monkeypatch.setattr(run, "save", SAVE)
    with h5py.File(tmp_path / "gas.h5", "r+") as file:
        file["particles/all/velocity/value_2d"][2, 17, 0] += np.float32(1e-3)
    capsys.readouterr()
    assert cli.main(["resume", str(tmp_path)]) == 1
    printed = capsys.readouterr().err
    assert "velocity" in printed
    assert "17" in printed


def test_rates_after_a_resume_are_those_of_what_was_done_since(
    whole, tmp_path, stopping, monkeypatch, capsys
):
    """With what was done before they would be twice as large or more."""
    stopping += [60]
    assert cli.main(["run", str(whole.parent / "gas.toml"), "-o", f"{tmp_path}/"]) == 130
    monkeypatch.setattr(run, "write_views", lambda _: None)  # which takes time, and is no part of the rate
    capsys.readouterr()
    assert cli.main(["resume", str(tmp_path), "--no-picture"]) == 0
    captured = capsys.readouterr().out
    before = int(re.search(r"after (\d+) collisions", captured).group(1))  # type: ignore[union-attr]
    printed = re.search(
        r"done in (\S+) s: (\d+) collisions since it was resumed, in all (\d+) collisions \(.*, (\S+) in all",
        captured,
    )
    assert printed is not None
    since, done = int(printed[2]), int(printed[3])
    assert since == done - before
    assert 2 * before > done
    assert float(printed[4]) * float(printed[1]) == pytest.approx(done - before, rel=0.3)


def test_a_signal_while_the_last_frames_are_written_leaves_a_run_that_is_done(
    whole, tmp_path, monkeypatch, capsys
):
    flush, sent = AsyncWriter.flush, []

    def signalled(self: AsyncWriter) -> None:
        if self.series_rows and not sent:
            sent.append(1)
            os.kill(os.getpid(), signal.SIGTERM)
        flush(self)

    monkeypatch.setattr(AsyncWriter, "flush", signalled)
    assert cli.main(["run", str(whole.parent / "gas.toml"), "-o", f"{tmp_path}/"]) == 0
    assert sent
    assert "terminated" in capsys.readouterr().err
    assert json.loads((tmp_path / "gas.status.json").read_text())["state"] == "done"
    same(tmp_path / "gas.h5", whole)


def test_an_unexpected_exception_leaves_no_running_status(whole, tmp_path, monkeypatch):
    def odd(_self: Recorder, _state: object, measure: Measure) -> None:
        if measure.time > 1.0:
            raise ZeroDivisionError("odd")

    monkeypatch.setattr(Recorder, "frame", odd)
    with pytest.raises(ZeroDivisionError):
        cli.main(["run", str(whole.parent / "gas.toml"), "-o", f"{tmp_path}/"])
    status = json.loads((tmp_path / "gas.status.json").read_text())
    assert (status["state"], status["message"]) == ("failed", "ZeroDivisionError('odd')")


def test_a_checkpoint_that_cannot_be_written_reports_what_remains(
    whole, tmp_path, monkeypatch, stopping, capsys
):
    case = whole.parent / "gas.toml"
    stopping += [30]
    save = Simulation.save_checkpoint
    calls: list[int] = []

    def first_only(self: Simulation, path: Path, *record: object) -> None:
        calls.append(1)
        if len(calls) > 1:
            raise InputError(f"checkpoint {path} cannot be written: Read-only file system")
        save(self, path, *record)  # type: ignore[arg-type]

    monkeypatch.setattr(Simulation, "save_checkpoint", first_only)
    assert cli.main(["run", str(case), "-o", f"{tmp_path}/"]) == 1
    printed = capsys.readouterr().err
    assert "gas.checkpoint.h5 cannot be written: Read-only file system: " in printed
    assert "so far, to t = " in printed
    assert f"to resume: ifrdem resume {tmp_path / 'gas.h5'}" in printed
    monkeypatch.undo()
    assert cli.main(["resume", str(tmp_path)]) == 0
    same(tmp_path / "gas.h5", whole)


def test_a_changed_case_is_refused_with_what_changed(whole, toml, tmp_path, stopping, capsys):
    stopping += [20]
    assert cli.main(["run", str(toml), "-o", f"{tmp_path}/"]) == 130
    toml.write_text(CASE.replace("mu = 0.21", "mu = 0.3"))
    capsys.readouterr()
    assert cli.main(["resume", str(tmp_path)]) == 2
    printed = capsys.readouterr().err
    assert "-mu = 0.21; +mu = 0.3" in printed
    assert "--ignore-case-changes" in printed
    assert cli.main(["resume", str(tmp_path), "--ignore-case-changes"]) == 0
    same(tmp_path / "gas.h5", whole)


def test_what_cannot_be_resumed_is_refused_with_the_reason(whole, tmp_path, capsys):
    killed = shutil.copy(whole, tmp_path / "killed.h5")
    for place, reason in (
        (str(whole), f"{whole}: the run is done. A new run can begin"),
        (str(killed), "the run is done, or was killed in its very beginning"),
        (str(whole.parent), "no run to resume here"),
        (str(tmp_path / "none"), "there is no such file or folder"),
    ):
        assert cli.main(["resume", place]) == 2
        assert reason in capsys.readouterr().err
    (tmp_path / "a.checkpoint.h5").write_text("x")
    (tmp_path / "b.checkpoint.h5").write_text("x")
    assert cli.main(["resume", str(tmp_path)]) == 2
    assert "name one of a.h5, b.h5" in capsys.readouterr().err
    (tmp_path / "a.h5").write_text("x")
    assert cli.main(["resume", str(tmp_path / "a.h5")]) == 2
    assert "damaged, or no checkpoint" in capsys.readouterr().err
    for hours in ("0", "-1", "many", "inf"):
        assert cli.main(["resume", str(tmp_path), "--max-hours", hours]) == 2
        assert f"--max-hours {hours}" in capsys.readouterr().err


def test_checkpoints_of_others_are_refused_before_anything_is_done(tmp_path, monkeypatch, capsys):
    """One of Python's own, one that was renamed, one of another version."""
    place = tmp_path / "a.checkpoint.h5"

    def printed() -> str:
        assert cli.main(["resume", str(place)]) == 2
        return capsys.readouterr().err

    checkpoint.write(place, {"a": np.arange(3)}, {"extra": {"mine": 1}})
    assert "Simulation.from_checkpoint resumes from it" in printed()
    case = CaseSections.model_validate(tomllib.loads(CASE)).model_dump_json(exclude_unset=True)
    run_of_b = {
        "plan": {},
        "case_path": str(tmp_path / "gone.toml"),
        "case_as_set": case,
        "trajectory": "b.h5",
    }
    checkpoint.write(place, {"a": np.arange(3)}, {"extra": run_of_b})
    assert "belongs to b.h5: rename it back" in printed()
    versions = {**package_versions(), "ifrdem": "0.0.1"}
    with monkeypatch.context() as other:
        other.setattr(checkpoint, "package_versions", lambda: versions)
        checkpoint.write(place, {"a": np.arange(3)}, {"extra": run_of_b})
    assert "was written by ifrdem 0.0.1" in printed()
    assert os.listdir(tmp_path) == ["a.checkpoint.h5"]


def launched(case: Path) -> subprocess.Popen[str]:
    """A run in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "ifrdem", "run", str(case), "-o", f"{case.parent}/"],
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, start_new_session=True,
    )  # fmt: skip


def wait_for_checkpoint(folder: Path, process: subprocess.Popen[str]) -> None:
    for _ in range(30_000):
        if (folder / "gas.checkpoint.h5").exists():
            return
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.005)
    raise AssertionError("the run does not get on")


LONG = CASE.replace("t_end = 2.0", "t_end = 400.0").replace("frames = 12", "frames = 4000")


@pytest.mark.full
def test_ctrl_c_ends_a_run_with_a_checkpoint(tmp_path):
    """All processes of the run get it, as from a terminal."""
    (tmp_path / "gas.toml").write_text(LONG)
    process = launched(tmp_path / "gas.toml")
    wait_for_checkpoint(tmp_path, process)
    time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, printed = process.communicate(timeout=60)
    assert process.returncode == 130
    stopped_with_a_checkpoint(tmp_path, "interrupted", printed)


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(
    ("number", "status", "word"),
    [
        (signal.SIGINT, 130, "interrupted"),
        (signal.SIGTERM, 143, "terminated (SIGTERM)"),
        (signal.SIGUSR1, 3, "warned (SIGUSR1)"),  # as batch systems do some time before a job's limit
        (signal.SIGUSR2, 3, "warned (SIGUSR2)"),
    ],
)
def test_signals_end_a_run_with_a_checkpoint(tmp_path, monkeypatch, capsys, number, status, word):
    (tmp_path / "gas.toml").write_text(LONG)
    frame, sent = Recorder.frame, []

    def signalled(self: Recorder, state: State, measure: Measure) -> None:
        frame(self, state, measure)
        if measure.time > 0.5 and not sent:  # five frames, after the first checkpoint
            sent.append(1)
            os.kill(os.getpid(), number)

    monkeypatch.setattr(Recorder, "frame", signalled)
    assert cli.main(["run", str(tmp_path / "gas.toml"), "-o", f"{tmp_path}/"]) == status
    assert sent
    stopped_with_a_checkpoint(tmp_path, word, capsys.readouterr().err)
    with h5py.File(tmp_path / "gas.h5") as file:
        assert 5 < len(file["particles/all/box/edges/step"]) < 100  # of 4001


SLOT = case_text({
    "run.t_end": 0.26, "run.threads": 1, "box.lengths": [10.0, 1.0000002], "box.periodic": [True, False],
    "box.material": "coin", "box.packing_fraction": None, "material[0].e_n": 1.0, "material[0].e_t": -1.0,
    "material[0].mu": 0.0, "species[0].number": 1, "species[0].diameter": 1.0, "species[0].speed_rms": 1.4,
    "species[0].radius": None, "output": {"frames": 1, "picture": False, "views": False},
})  # fmt: skip


@pytest.mark.full
def test_a_signal_within_a_window_of_a_million_events_ends_the_run_there(tmp_path, monkeypatch, capsys):
    """A disk in a slot 2e-7 wide hits its sides 4.2e6 times in a unit of time: a launch ends within the window.

    The run went on to the window's end, however far that is. A row of the series stands at the end of a window, and
    not where the run was stopped.
    """
    (tmp_path / "gas.toml").write_text(SLOT)
    work_on, windows = TileRunner._work_on, []

    def interrupted(self: TileRunner, *given: int) -> None:
        signal.raise_signal(signal.SIGINT)
        work_on(self, *given)
        windows.append(float(self.arrays.scale.window))

    monkeypatch.setattr(TileRunner, "_work_on", interrupted)
    assert cli.main(["run", str(tmp_path / "gas.toml"), "-o", f"{tmp_path}/"]) == 130
    monkeypatch.undo()
    stopped_with_a_checkpoint(tmp_path, "interrupted", capsys.readouterr().err)
    with h5py.File(tmp_path / "gas.h5") as file:
        speed = abs(float(file["particles/all/velocity/value"][0, 0, 1]))
    reached = json.loads((tmp_path / "gas.status.json").read_text())["time"]
    assert reached == pytest.approx(0.5 * MOST_EVENTS_OF_A_LAUNCH * 2e-7 / speed, rel=1e-3)
    assert [reached < min(window, 0.26) for window in windows] == [True]
    assert cli.main(["resume", str(tmp_path)]) == 0
    (hits,) = re.findall(r"(\d+) collisions with walls", capsys.readouterr().out)
    assert int(hits) == pytest.approx(0.26 * speed / 2e-7, abs=1.0)
    with Trajectory(tmp_path / "gas.h5") as trajectory:
        assert trajectory.series.time.tolist() == [0.0, 0.26]


def stopped_with_a_checkpoint(folder: Path, word: str, printed: str) -> None:
    assert f"{word}: the run stops after this window, with a checkpoint" in printed
    assert "to resume: ifrdem resume" in printed
    assert (folder / "gas.checkpoint.h5").exists()
    content = json.loads((folder / "gas.status.json").read_text())
    assert content["state"] == "interrupted"


def test_a_killed_run_resumes_to_the_same_file(whole, toml, tmp_path):
    """SIGKILL at moments of its life drawn at random; the checkpoint is the one of the beginning."""
    rng = random.Random(5)
    process = launched(toml)
    wait_for_checkpoint(tmp_path, process)
    time.sleep(0.3 * rng.random())  # the rest of the run takes a second
    process.kill()
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert cli.main(["resume", str(tmp_path)]) == 0
    same(tmp_path / "gas.h5", whole)


def test_max_hours_stop_a_run_that_can_be_resumed(whole, tmp_path, capsys):
    case = whole.parent / "gas.toml"
    assert cli.main(["run", str(case), "-o", f"{tmp_path}/", "--max-hours", "1e-9"]) == 3
    assert "1e-09 hours are up (--max-hours)" in capsys.readouterr().err
    assert cli.main(["resume", str(tmp_path)]) == 0
    same(tmp_path / "gas.h5", whole)


@pytest.mark.full
def test_max_hours_count_the_making_of_the_start(whole, tmp_path, capsys, monkeypatch):
    case, made = whole.parent / "gas.toml", starts.start

    def slowly(*given):
        time.sleep(0.4)
        return made(*given)

    monkeypatch.setattr(starts, "start", slowly)
    assert cli.main(["run", str(case), "-o", f"{tmp_path}/", "--max-hours", "1e-4"]) == 3  # 0.36 s
    assert "0.0001 hours are up (--max-hours)" in capsys.readouterr().err
    assert cli.main(["resume", str(tmp_path)]) == 0
    assert "resume at t = 0, after 0 collisions" in capsys.readouterr().out
    same(tmp_path / "gas.h5", whole)
