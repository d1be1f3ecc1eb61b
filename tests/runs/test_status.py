"""The live state of a run: written whole, read back, followed to its end; a dead run is recognised."""

from __future__ import annotations

import errno
import json
import math
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.runs import status
from ifrdem.runs.status import Status


def dead_pid() -> int:
    """The number of a process that has ended."""
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    return process.pid


def changed(path, **values) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


def test_a_status_file_holds_the_reported_values(tmp_path):
    one = Status(tmp_path / "gas.h5", name="gas", t_end=10.0, device="cpu: 2 cores", interval=0.0)
    one.update(
        time=2.5, collisions=np.int64(100), temperature=np.float64(0.5), fraction=0.25, eta_seconds=math.inf
    )
    assert one.path == tmp_path / "gas.status.json"
    content = json.loads(one.path.read_text())
    assert (content["name"], content["state"], content["trajectory"]) == ("gas", "running", "gas.h5")
    assert (content["format"], content["pid"], content["device"]) == (1, os.getpid(), "cpu: 2 cores")
    assert (content["time"], content["collisions"], content["temperature"]) == (2.5, 100, 0.5)
    assert isinstance(content["collisions"], int)
    assert content["eta_seconds"] is None  # JSON has no infinity
    assert content["ledger_residual"] is None  # not given
    assert (content["t_end"], content["collisions_per_disk_end"]) == (10.0, None)
    assert os.listdir(tmp_path) == ["gas.status.json"]
    with pytest.raises(TypeError, match="no value 'tmie'"):
        one.update(tmie=1.0)


def test_a_status_is_written_once_an_interval_and_at_the_end(tmp_path):
    now = [0.0]
    one = Status(tmp_path / "gas.h5", name="gas", interval=1.0, clock=lambda: now[0])
    observed = []
    for second in (0.5, 0.9, 1.2, 1.9, 2.3):
        now[0] = second
        one.update(time=second)
        observed.append(status.read(tmp_path / "gas.h5")["time"])
    assert observed == [None, None, 1.2, 1.2, 2.3]
    now[0] = 2.4
    one.update(time=2.4)
    one.finish("interrupted", "by Ctrl-C")
    content = status.read(one.path)
    assert (content["time"], content["state"], content["message"]) == (2.4, "interrupted", "by Ctrl-C")


def test_a_reader_never_sees_half_a_status(tmp_path):
    one = Status(tmp_path / "gas.h5", name="gas" * 1000, interval=0.0)
    stop = threading.Event()

    def write() -> None:
        number = 0
        while not stop.is_set():
            number += 1
            one.update(time=float(number))

    thread = threading.Thread(target=write)
    thread.start()
    try:
        times = [status.read(tmp_path)["time"] or 0.0 for _ in range(300)]
    finally:
        stop.set()
        thread.join()
    assert times == sorted(times)
    assert times[-1] > times[0]


def test_a_status_that_cannot_be_written_does_not_end_the_run(tmp_path):
    folder = tmp_path / "gone"
    folder.mkdir()
    one = Status(folder / "gas.h5", name="gas", interval=0.0)
    one.path.unlink()
    folder.rmdir()
    one.update(time=1.0)
    assert one.trouble == f"{one.path} could not be written: No such file or directory"
    folder.mkdir()
    one.update(time=2.0)
    assert one.trouble is None
    assert status.read(folder)["time"] == 2.0


def test_the_status_of_a_folder_is_that_of_its_newest_run(tmp_path):
    for age, name in ((200, "a"), (100, "c"), (300, "b")):
        path = Status(tmp_path / f"{name}.h5", name=name).path
        os.utime(path, (1e9 - age, 1e9 - age))
    assert status.read(tmp_path)["name"] == "c"
    assert status.read(tmp_path / "a.h5")["name"] == "a"
    assert status.read(tmp_path / "b.status.json")["name"] == "b"


def test_what_is_no_status_is_refused(tmp_path):
    with pytest.raises(InputError, match="no run has written its status"):
        status.read(tmp_path)
    with pytest.raises(InputError, match=r"there is no status file .*gas\.status\.json"):
        status.read(tmp_path / "gas.h5")
    path = tmp_path / "gas.status.json"
    for text in ("{", "[]", '{"format": 2, "state": "done"}'):
        path.write_text(text)
        with pytest.raises(InputError, match="is not a status file of ifrdem"):
            status.read(path)


def test_a_dead_run_is_reported(tmp_path):
    one = Status(tmp_path / "gas.h5", name="gas", interval=0.0)
    one.update(frames=12, fraction=0.3)
    pid = dead_pid()
    changed(one.path, pid=pid)
    lines: list[str] = []
    assert status.show(tmp_path, lines.append, follow=True) == "dead"
    assert lines[-1].startswith(f" 30.0 %, dead: process {pid} is gone")
    assert "gas.h5 holds the 12 frames" in lines[-1]


def test_a_run_on_another_machine_is_classified_by_its_last_update(tmp_path):
    one = Status(tmp_path / "gas.h5", name="gas")
    changed(one.path, host="elsewhere", pid=dead_pid())
    assert status.read(tmp_path)["state"] == "running"
    changed(one.path, updated="2020-01-01T00:00:00+00:00")
    assert status.read(tmp_path)["state"] == "dead"


def test_tail_prints_a_line_at_each_news_until_the_run_ends(tmp_path):
    one = Status(tmp_path / "gas.h5", name="gas", interval=0.0)
    # What the run does while the reader sleeps: news, none, news, the end.
    news = [
        lambda: one.update(
            time=1.0,
            collisions=5000,
            collisions_per_disk=2.5,
            fraction=0.25,
            temperature=0.5,
            rotational_temperature=0.4,
            ledger_residual=3e-16,
            collisions_per_second=123456.0,
            eta_seconds=61.0,
        ),
        lambda: None,
        lambda: one.update(time=2.0, fraction=0.5),
        lambda: one.finish("done"),
    ]
    lines: list[str] = []
    assert (
        status.show(tmp_path / "gas.h5", lines.append, follow=True, sleep=lambda _: news.pop(0)()) == "done"
    )
    assert news == []
    assert lines[0].startswith("gas: gas.h5, started 20")
    assert lines[1] == "ETA -"
    assert lines[2] == (
        " 25.0 %, t = 1, 2.50 collisions per disk, T = 0.5, T_rot/T = 0.8000, residual 3.0e-16, "
        "1.23e+05 collisions/s, ETA 1:01"
    )
    assert lines[3].startswith(" 50.0 %, t = 2, ")
    assert lines[4].endswith("1.23e+05 collisions/s, done")
    assert len(lines) == 5


@pytest.mark.parametrize(
    ("state", "ended"), [("running", 0), ("done", 0), ("full disk", 1), ("failed", 1), ("interrupted", 3)]
)
def test_the_command_prints_once_and_exits_with_the_state_of_the_run(tmp_path, capsys, state, ended):
    one = Status(tmp_path / "gas.h5", name="gas")
    one.finish(state)
    assert main(["status", str(tmp_path)]) == ended
    assert len(capsys.readouterr().out.splitlines()) == 2
    for interval in ("0", "soon", "nan"):
        assert main(["status", str(tmp_path), "--follow", "--interval", interval]) == 2
        assert f"--interval {interval}: " in capsys.readouterr().err


@pytest.fixture
def full_disk(monkeypatch):
    """No file can be written from a call of this on."""

    def fill() -> None:
        def refused(path, *_args, **_options):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

        monkeypatch.setattr(Path, "write_bytes", refused)
        monkeypatch.setattr(Path, "write_text", refused)

    return fill


def test_a_full_disk_leaves_the_last_status_whole(tmp_path, full_disk):
    one = Status(tmp_path / "gas.h5", name="gas", interval=0.0)
    one.update(time=2.0)
    full_disk()
    one.update(time=3.0)
    one.finish("failed", "gas.h5 could not be written: No space left on device")
    content = status.read(one.path)
    assert (content["time"], content["state"]) == (2.0, "running")  # "dead" once the process is gone
    assert one.trouble == f"{one.path} could not be written: No space left on device"
    assert os.listdir(tmp_path) == ["gas.status.json"]


def test_a_full_disk_for_the_status_file_does_not_end_the_run(tmp_path, full_disk):
    full_disk()
    one = Status(tmp_path / "gas.h5", name="gas")
    assert one.trouble == f"{one.path} could not be written: No space left on device"
