"""`ifrdem validate --jobs`: workers give the results of one process, and none is lost or left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from support import worker_calls

from ifrdem.cli import main as cli
from ifrdem.simulation import backend
from ifrdem.tools.processes import ProcessDied
from ifrdem.validation.report import registry, runner, terminal
from ifrdem.validation.report.registry import Result, Row


@pytest.mark.full
def test_rows_and_figures_of_workers_are_those_of_one_process_to_the_last_bit(tmp_path, capsys) -> None:
    names = ["misprints", "gas_collapse"]
    for jobs in ("1", "2"):
        assert cli.main(["validate", *names, "--quick", "--jobs", jobs, "-o", str(tmp_path / jobs)]) == 0
    out = capsys.readouterr().out
    assert "[1/2] misprints" in out  # in this process in their order
    assert "[1/2] gas_collapse" in out  # in workers the longest first
    one, two = tmp_path / "1", tmp_path / "2"
    rows = json.loads((one / "results.json").read_text())
    assert list(dict.fromkeys(row["case"] for row in rows)) == names
    files = [path.name for path in one.iterdir() if path.suffix in (".json", ".png", ".pdf")]
    assert "gas_collapse.pdf" in files
    for name in files:
        assert (one / name).read_bytes() == (two / name).read_bytes()


def collected(names: list[str], jobs: int, **more: Any) -> tuple[list[str], dict[str, Any], list[list[str]]]:
    """Order in which calls of `worker_calls.shout` began, their results, and the calls in work at times."""
    started: list[str] = []
    found: dict[str, Any] = {}
    observed: list[list[str]] = []
    runner.in_workers(
        worker_calls.shout, names, jobs, begun=started.append, ended=found.__setitem__,
        waiting=lambda running: observed.append(list(running)), **more,
    )  # fmt: skip
    return started, found, observed


@pytest.mark.full
def test_a_worker_that_dies_is_reported_and_the_other_calls_are_made() -> None:
    started, found, _ = collected(["killed 1", "left 1", "a", "b"], 2)
    assert started == ["killed 1", "left 1", "a", "b"]
    assert [found[name][0] for name in "ab"] == ["A", "B"]
    assert isinstance(found["killed 1"], ProcessDied)
    assert "killed by SIGKILL: the system does that when memory" in found["killed 1"].reason
    assert found["left 1"] == ProcessDied("its process ended with status 3 and without a result")


@pytest.mark.full
def test_each_call_has_a_separate_process_with_its_part_of_the_cores() -> None:
    started, found, observed = collected(["slow threads 1", "slow threads 2", "threads 3"], 2, every=0.2)
    assert started == ["slow threads 1", "slow threads 2", "threads 3"]
    processes = [process for _, process, _ in found.values()]
    assert len(set(processes)) == 3
    assert os.getpid() not in processes
    assert {threads for *_, threads in found.values()} == {max(1, backend.cores() // 2)}
    assert ["slow threads 1", "slow threads 2"] in observed


@pytest.mark.full
def test_a_case_with_a_dead_worker_fails_and_rows_keep_their_order(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(runner, "run_case", worker_calls.case)
    names = ["energy", "angles", "misprints"]
    assert cli.main(["validate", *names, "--jobs", "3", "-o", str(tmp_path)]) == 1
    rows = json.loads((tmp_path / "results.json").read_text())
    assert [(row["case"], row["status"]) for row in rows] == [
        ("energy", "passed"), ("angles", "failed"), ("misprints", "passed"),
    ]  # fmt: skip
    assert rows[1]["reason"].startswith("no result: its process was killed by SIGKILL")
    out = capsys.readouterr().out
    assert "cases failed: angles" in out
    assert out.index("misprints passed") < out.index("energy passed")  # as they end
    assert "no result: its process was killed" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_the_command(tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C, which a terminal sends to all processes of the command; and its death, which it cannot act upon."""
    root = Path(__file__).parents[2]
    tests = root / "tests"
    with subprocess.Popen(
        [sys.executable, str(tests / "support" / "worker_calls.py")], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL,
        env={**os.environ, "WORKERS": str(tmp_path), "PYTHONPATH": f"{root}{os.pathsep}{tests}"},
        start_new_session=True, text=True,
    ) as command:  # fmt: skip
        try:
            wait_until(lambda: len(processes(tmp_path)) == 2)
            (os.killpg if number == signal.SIGINT else os.kill)(command.pid, number)
            message = command.communicate(timeout=120.0)[1]
            wait_until(lambda: not any(Path(f"/proc/{one}").exists() for one in processes(tmp_path)))
        finally:
            command.kill()
            for one in processes(tmp_path):
                if Path(f"/proc/{one}").exists():
                    os.kill(one, signal.SIGKILL)
    if number == signal.SIGINT:
        assert (command.returncode, message) == (130, "ifrdem: interrupted\n")


def processes(folder: Path) -> list[int]:
    return [int(path.name) for path in folder.iterdir() if path.name.isdigit()]


def wait_until(true: Any, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize("jobs", ["0", "-1", "x", "1.5"])
def test_an_impossible_number_of_jobs_is_refused(tmp_path, capsys, jobs) -> None:
    assert cli.main(["validate", "gas", f"--jobs={jobs}", "-o", str(tmp_path / "a")]) == 2
    assert f"--jobs {jobs}: must be" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_only_gases_run_at_once_without_being_asked_to(monkeypatch) -> None:
    monkeypatch.setattr(backend, "cores", lambda: 4)
    gases = list(registry.GAS)
    assert runner._jobs(None, list(registry.PAPER)) == 1
    assert runner._jobs(None, [*registry.PAPER, *gases[:1]]) == 1
    assert runner._jobs(None, gases[:3]) == 3
    assert runner._jobs(None, gases) == 4
    assert runner._jobs(99, gases) == len(gases)


def test_the_time_left_goes_by_the_pace_of_cases_that_ended(monkeypatch) -> None:
    """Two at a time of 100, 60, 40 and 30 s, at twice the time: 200 s and, in the other, 120, 80 and 60.

    After 130 s: 70 are left of the first and 70 of the third, the fourth's 60 come after one of them.
    """
    monkeypatch.setattr(registry, "SECONDS", {"energy": (100.0, 1.0), "angles": (60.0, 1.0),
                                              "rolling": (40.0, 1.0), "stopping": (30.0, 1.0)})  # fmt: skip
    now, messages = [0.0], []
    pace = terminal.Pace(
        ["energy", "angles", "rolling", "stopping"],
        quick=False,
        jobs=2,
        log=messages.append,
        clock=lambda: now[0],
    )
    pace.begun("energy")
    pace.begun("angles")
    now[0] = 60.0
    pace.waiting()
    assert messages[-1] == "  in work: energy (1:00), angles (1:00)"
    now[0] = 120.0
    pace.ended(
        runner.Verdict("angles", "?", "a book", Result([Row("x", 1.0, 1.0, 0.1, "", "")]), seconds=120.0)
    )
    pace.begun("rolling")
    now[0] = 130.0
    pace.waiting()
    assert messages[-1] == "  in work: energy (2:10), rolling (0:10); ETA 2:10"
    assert pace.seconds_left == pytest.approx(130.0)
