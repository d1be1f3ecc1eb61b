"""Benchmarks: correct counts, and output of what was requested. No test looks at speed."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support import manual
from support.cases import case_text

import ifrdem
from ifrdem import Device
from ifrdem.case import summary
from ifrdem.case.gas import CaseGas
from ifrdem.cli import main as cli
from ifrdem.errors import EngineError, InputError
from ifrdem.kernels.columns import bytes_per_disk
from ifrdem.kernels.compiler import runtime
from ifrdem.simulation import backend
from ifrdem.simulation.simulation import Simulation
from ifrdem.tools.arguments import script
from ifrdem.validation.speed import bench, start, table
from ifrdem.validation.speed.bench import Benchmark, TimedRun
from ifrdem.validation.speed.table import Cost, Memory, Speed

SMALL = ["--n", "200", "--phi", "0.2", "--threads", "1", "--runs", "2", "--seconds", "0.01"]

CASE = case_text({
    "run.name": "coins", "run.threads": 1, "run.units": None, "species[0].coin": "1 pta",
    "species[0].number": 150, "species[0].material": None, "species[0].mass": None,
    "species[0].radius": None, "material": None,
})  # fmt: skip


@pytest.fixture
def case_file(tmp_path: Path) -> str:
    (tmp_path / "coins.toml").write_text(CASE, encoding="utf-8")
    return str(tmp_path / "coins.toml")


@pytest.fixture
def unprofiled() -> Iterator[None]:
    """Ends a Taichi that runs with its profiler."""
    yield
    backend.stop()


def output(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Lines that `ifrdem bench` prints on the standard output stream."""
    assert cli.main(["bench", *arguments]) == 0
    return capsys.readouterr().out


def refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The message of an `ifrdem bench` that must be refused before it prints anything."""
    assert cli.main(["bench", *arguments]) == cli.BAD_INPUT
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "Traceback" not in shown.err
    return shown.err


def found(
    n: int = 1000, phi: float = 0.3, seconds: tuple[float, ...] = (1.0, 2.0, 4.0), **also: Any
) -> Benchmark:
    """A benchmark of made-up runs, each of 8000 collisions."""
    done = {"windows": 4, "in_order": 1, "run_again": 20, "elastic": 0}
    runs = [TimedRun(each, 8000, dict(done), slowest=each / 2.0) for each in seconds]
    given = {"threads": 2, "bytes_per_disk": 240.0, "environment": bench.environment(), **also}
    return Benchmark(
        gas="elastic gas", n=n, phi=phi, device="cpu", precision="f64", seed=1,
        collisions_before=5000, runs=runs, **given,
    )  # fmt: skip


# --- one gas ----------------------------------------------------------------------------------------------


def test_json_is_one_object_with_every_figure(capsys: pytest.CaptureFixture[str]) -> None:
    own = json.loads(output([*SMALL, "--json", "--seed", "3", "--precision", "f64"], capsys))
    assert (own["n"], own["phi"], own["device"], own["threads"]) == (200, pytest.approx(0.2), "cpu", 1)
    assert (own["precision"], own["seed"]) == ("f64", 3)
    assert own["bytes_per_disk"] > 0.0
    assert len(own["runs"]) == 2
    assert (
        own["collisions_per_second_min"] <= own["collisions_per_second"] <= own["collisions_per_second_max"]
    )
    assert own["ns_per_collision"] == pytest.approx(1e9 / own["collisions_per_second"])
    for key in ("collisions", "windows"):
        assert own[key] == sum(run[key] for run in own["runs"])
    assert own["tiles_run_again"] == own["windows_in_order"] == 0  # one tile is the whole box
    assert own["ifrdem"] == ifrdem.__version__
    assert own["runtime"] == runtime.describe()
    assert own["python"] == ".".join(str(part) for part in sys.version_info[:3])
    assert own["processor"] == backend.cpu_name()
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT.*", own["date"])
    assert own["profile"] is None


def test_report_names_the_measured_quantities(capsys: pytest.CaptureFixture[str]) -> None:
    text = output(SMALL, capsys)
    assert text.startswith("elastic gas: 200 disks, packing fraction 0.2, after ")
    assert "on cpu, 1 thread, f64" in text
    for name in (
        "collisions/s",
        "time a collision",
        "time a disk and window",
        "windows",
        "time a window",
        "memory",
    ):
        assert re.search(rf"^  {name} ", text, flags=re.MULTILINE)
    assert "2 runs" in text


def test_every_option_that_the_manual_lists_exists(capsys: pytest.CaptureFixture[str]) -> None:
    section = manual.page("performance.md").split("## Benchmark")[1].split("\n## ")[0]
    rows = "\n".join(line for line in section.splitlines() if line.startswith("| `--"))
    listed = set(re.findall(r"--[a-z][a-z-]*", rows))
    assert len(listed) >= 9
    assert cli.main(["bench", "--help"]) == 0
    assert listed <= set(re.findall(r"--[a-z][a-z-]*", capsys.readouterr().out))


def test_figures_follow_from_the_runs() -> None:
    """Three runs of 8000 collisions in 1, 2 and 4 s, 4 windows each, 1000 disks on 2 threads."""
    own = found().figures()
    assert own["collisions_per_second"] == 4000.0  # the median
    assert (own["collisions_per_second_min"], own["collisions_per_second_max"]) == (2000.0, 8000.0)
    assert own["ns_per_collision"] == 250_000.0
    assert own["thread_ns_per_disk_and_window"] == pytest.approx(2 * 7e9 / (1000 * 12))
    assert own["collisions_per_disk_and_window"] == pytest.approx(2 * 24_000 / (1000 * 12))
    assert (own["windows_in_order"], own["tiles_run_again"]) == (3, 60)
    assert own["slowest_window_seconds"] == 2.0


def test_a_timed_run_counts_the_collisions_of_the_simulation() -> None:
    case = bench.elastic_gas(150, 0.3, threads=1)
    simulation = CaseGas.from_case(case).simulation()
    simulation.run(t_end=0.5)
    collisions, windows = simulation.collisions, simulation.statistics.windows
    run = bench.timed(simulation, 0.0)
    assert run.collisions == simulation.collisions - collisions
    assert run.done["windows"] == simulation.statistics.windows - windows >= bench.LEAST_LAUNCHES
    assert (
        run.seconds >= run.slowest >= run.seconds / (1 + run.done["windows"])
    )  # the rest of one before them
    again = bench.timed(simulation, 0.0)  # it stopped between two windows: it continues
    assert simulation.collisions == collisions + run.collisions + again.collisions


def test_a_benchmark_adds_up_to_the_collisions_of_its_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Simulation] = []

    def remember(self: CaseGas, *given: Any, **options: Any) -> Simulation:
        made.append(original(self, *given, **options))
        return made[-1]

    original = CaseGas.simulation
    monkeypatch.setattr(CaseGas, "simulation", remember)
    own = bench.measure(bench.elastic_gas(150, 0.3, threads=1), runs=2, seconds=0.01)
    (simulation,) = made
    assert own.collisions_before + sum(run.collisions for run in own.runs) == simulation.collisions
    assert own.bytes_per_disk == simulation.bytes_allocated / 150


def test_the_elastic_gas_starts_at_its_temperature_and_mixes_for_ten_mean_free_times() -> None:
    """At phi = 0.3 a disk has 10 collisions less those that the lattice makes it wait for."""
    case = bench.elastic_gas(400, 0.3, threads=1)
    gas = CaseGas.from_case(case)
    simulation = gas.simulation()
    velocity = simulation.state.velocity
    # T = <m v^2> / 2 = 1 with m = 1; 400 disks sample it within 1 / sqrt(400) of it.
    assert float((velocity**2).sum()) / (2 * 400) == pytest.approx(1.0, abs=0.15)
    simulation.run(t_end=bench.mixing_time(gas))
    assert 2 * simulation.collisions / 400 == pytest.approx(9.5, abs=1.0)


def test_a_case_is_timed_after_the_requested_collisions(
    case_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--case", case_file, "--after", "3", "--set", "species[0].number=120", *SMALL[4:]]
    own = json.loads(output([*arguments, "--json"], capsys))
    assert (own["gas"], own["n"], own["threads"]) == ("coins", 120, 1)
    assert own["collisions_before"] >= 3 * 120 / 2
    assert own["slowest_window_seconds"] > 0.0
    assert output(arguments, capsys).startswith("coins: 120 disks")


def test_a_case_at_rest_ends_with_a_message(case_file: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--case", case_file, "--set", "species[0].speed_rms=0", *SMALL[4:]]
    assert cli.main(["bench", *arguments]) == cli.FAILED
    assert "no disk can meet another one" in capsys.readouterr().err


# --- refusals ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--n", "1.5"], "--n 1.5: must be an integer"),
        (["--n", "1"], "--n 1: must be an integer"),
        (["--n", "1e12"], "--n 1e12: must be an integer from 2 to"),
        (["--n", "inf"], "--n inf: must be an integer"),
        (["--phi", "1.2"], "--phi 1.2: must be a packing fraction from 1e-05 to 0.9068"),
        (["--phi", "nan"], "--phi nan: must be a packing fraction"),
        (["--device", "cdua"], "--device cdua: must be one of 'cpu', 'cuda' (did you mean 'cuda'?)"),
        (["--precision", "f23"], "--precision f23: must be one of 'f64', 'f32' (did you mean 'f32'?)"),
        (["--threads", "0"], "--threads 0: must be"),
        (["--runs", "none"], "--runs none: must be an integer from 1 to 10000"),
        (["--seconds", "-1"], "--seconds -1: must be"),
        (["--seed", "-1"], "--seed -1: must be"),
        (["--n", "3"], "--n 3 --phi 0.3: box = "),
        (["--after", "3"], "--after requires --case"),
        (["--set", "run.seed=3"], "--set requires --case"),
        (["--case", "x.toml", "--phi", "0.2"], "--set changes the case's box.packing_fraction"),
        (["--case", "nowhere.toml"], "nowhere.toml: there is no such file"),
        (
            ["--case", "x.toml", "--after", "-1"],
            "--after -1: must be",
        ),
        (["--prot"], "unknown option --prot (did you mean '--profile'?)"),
    ],
)
def test_what_cannot_be_is_refused(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in refusal(arguments, capsys)


def test_a_gas_beyond_the_memory_is_refused_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch, case_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(backend, "memory_available", lambda: 10_000_000)
    monkeypatch.setattr(CaseGas, "from_case", lambda *_: pytest.fail("it was made"))
    for arguments in (
        ["--n", "1e5"],
        ["--case", case_file, "--set", "species[0].number=100000"],
    ):
        assert "of memory, and 10 MB are free" in refusal(arguments, capsys)
    capsys.readouterr()
    assert script(table.table, []) == 2
    assert "of memory, and 10 MB are free" in capsys.readouterr().err
    assert cli.main(["run", case_file, "--set", "species[0].number=100000"]) == cli.BAD_INPUT
    monkeypatch.setattr(backend, "gpu_memory", lambda: 1_000_000_000)
    gpu = 800_000_000  # beyond scratch space
    for options, most in (
        ({}, gpu // (bytes_per_disk() + 120)),
        ({"low_memory": True}, gpu // (bytes_per_disk() - 56 + 120)),
        ({"layered": True}, 400_000),
    ):
        with pytest.raises(InputError, match=rf"9000000 disks: the GPU has 1 GB .*{most} fit"):
            summary.refuse_beyond_memory(9_000_000, "cuda", **options)
    with pytest.raises(InputError, match=r"900000 disks: 2 GPUs have 1 GB .*800000 fit"):
        summary.refuse_beyond_memory(900_000, "cuda", ranks=2, layered=True)
    with pytest.raises(InputError, match="100000 disks need some 20 MB"):
        summary.refuse_beyond_memory(100_000, "cuda")  # the GPU's own memory holds the rest
    summary.refuse_beyond_memory(1000, "cpu")
    summary.refuse_beyond_memory(20_000, "cuda", "random")
    with pytest.raises(InputError, match=r"20000 disks need some 20 MB"):
        summary.refuse_beyond_memory(20_000, "cuda", "grown")
    # 200 bytes of the writer, when those of the start are free, and 192 of the engine, of which others of 8 ranks have
    # seven parts; few frames take less.
    with pytest.raises(InputError, match=r"30000 disks need some 11.8 MB"):
        summary.refuse_beyond_memory(30_000, "cpu")
    summary.refuse_beyond_memory(30_000, "cpu", share=1 / 8)
    summary.refuse_beyond_memory(30_000, "cpu", writer=100)


@pytest.mark.full
def test_interruption_ends_with_a_message_and_its_status() -> None:
    command = [sys.executable, "-m", "ifrdem", "bench", *SMALL, "--runs", "10000", "--seconds", "10"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = process.stderr.readline()  # the end of the equilibration: the timed runs have started
        time.sleep(0.5)
        os.kill(process.pid, signal.SIGINT)
        try:
            out, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert "ETA" in line
    assert process.returncode == cli.INTERRUPTED
    assert out == ""
    assert err.endswith("ifrdem: interrupted\n")
    assert "Traceback" not in err


# --- starts -----------------------------------------------------------------------------------------------


@pytest.mark.full
def test_starts_are_timed_in_fresh_processes(capsys: pytest.CaptureFixture[str]) -> None:
    assert script(start.start, ["--n", "100", "--threads", "1"]) == 0
    lines = [line.split(": ", 1) for line in capsys.readouterr().out.splitlines()]
    assert [name for name, _ in lines] == [
        "start_a_gas, kernels cold", "start_a_gas, kernels warm",
        "start_a_run, kernels cold", "start_a_run, kernels warm",
    ]  # fmt: skip
    for _, text in lines[:2]:
        seconds = json.loads(text)
        assert 0.0 < seconds["imports"] < seconds["first_window"] <= seconds["all_kernels"]
    assert all(json.loads(text)["first_progress"] > 0.0 for _, text in lines[2:])


def test_a_process_that_fails_is_an_error() -> None:
    with pytest.raises(EngineError, match=r"that was to be timed ended with 1: .*threads"):
        start.start(n=200, threads=10_000)


# --- profile ----------------------------------------------------------------------------------------------


def test_loops_of_a_kernel_are_summed() -> None:
    """Two calls of one instance of `run_windows`, each with two loops, and one of another; milliseconds."""
    records = [
        ("run_windows_c80_0_kernel_0_serial", 1.0),
        ("run_windows_c80_0_kernel_11_range_for", 2.0),
        ("verify_c86_0_kernel_1_range_for", 7.0),
        ("run_windows_c80_0_kernel_0_serial", 1.0),
        ("run_windows_c80_0_kernel_11_range_for", 2.0),
        ("run_windows_c80_1_kernel_0_serial", 3.0),
        ("other", 0.5),
    ]
    assert [
        (each.kernel, each.calls, pytest.approx(each.seconds)) for each in bench.kernel_times(records)
    ] == [
        ("run_windows", 3, 9e-3),
        ("verify", 1, 7e-3),
        ("other", 1, 0.5e-3),
    ]


@pytest.mark.full
@pytest.mark.usefixtures("unprofiled")
def test_the_profile_is_of_the_time_that_passed(capsys: pytest.CaptureFixture[str]) -> None:
    own = json.loads(output([*SMALL, "--profile", "--json"], capsys))["profile"]
    kernels = own["kernels"]
    assert "run_windows" in {each["kernel"] for each in kernels}
    assert all(each["calls"] > 0 for each in kernels)
    assert 0.0 < sum(each["seconds"] for each in kernels) < own["seconds"]
    assert sum(each["share"] for each in kernels) + own["outside_kernels_share"] == pytest.approx(1.0)
    text = output([*SMALL, "--profile"], capsys)
    assert re.search(r"^  run_windows +\d+ +\S+ +\S+ %$", text, flags=re.MULTILINE)
    assert re.search(r"^  outside: Python, launches +\S+ +\S+ %$", text, flags=re.MULTILINE)


@pytest.mark.full
@pytest.mark.usefixtures("unprofiled")
def test_a_profiled_device_serves_a_simulation_that_asks_for_no_profile() -> None:
    profiled = backend.start(Device("cpu", threads=1), profile=True)
    assert backend.start(Device("cpu", threads=1)) is profiled
    backend.stop()
    assert not backend.start(Device("cpu", threads=1)).profile


# --- the table --------------------------------------------------------------------------------------------


def test_rows_come_in_order_of_size() -> None:
    sizes = [each.n for each in table.ROWS]
    assert sizes == sorted(sizes)


def test_a_row_is_reached_by_its_median() -> None:
    row = Speed(1000, 0.3, 4000.0).row(found())  # 8000 collisions in 1, 2 and 4 s
    assert row == "| elastic, N = 1e3, phi = 0.3 | 4.00e3 (2.00e3 to 8.00e3) | 4.00e3 | yes |"
    assert Speed(1000, 0.3, 4001.0).row(found()).endswith("| no |")


def test_clusters_are_held_to_their_slowest_window() -> None:
    row = Speed(1000, 0.3, 4000.0, slowest=2.0).row(found())
    assert row.startswith("| coins in clusters, N = 1e3, phi = 0.3, after 300 per disk | ")
    assert row.endswith("; the slowest window took 2 s | 4.00e3, no window above 2 s | yes |")
    assert Speed(1000, 0.3, 4000.0, slowest=1.9).row(found()).endswith("| no |")


def test_memory_is_held_to_its_bytes() -> None:
    assert Memory(1000, 240.0).row(found()).endswith("| 240 bytes per disk | 240 bytes per disk | yes |")
    assert Memory(1000, 239.0).row(found()).endswith("| no |")


def test_a_cost_is_the_median_of_runs_side_by_side() -> None:
    """At 6, 8 and 2 collisions a second against 9, 10 and 4: 1.5, 1.25 and 2 times the time of a collision."""
    times = [iter([TimedRun(1.0, count, {}, 1.0) for count in counts]) for counts in ((6, 8, 2), (9, 10, 4))]
    cost = Cost("a", 1000, 1.5, lambda _n: tuple((lambda _s, each=each: next(each)) for each in times))
    assert cost.measure(3, 1.0) == "| a, N = 1e3 | 1.5 times (1.25 to 2) | 1.5 times | yes |"
    assert replace(cost, target=1.49).row([1.5]).endswith("| no |")


def test_two_sizes_share_the_area() -> None:
    disks = CaseGas.from_case(table.two_sizes(1010, 0.3, threads=1)).disks
    small = disks.radius == 0.5
    assert disks.radius[~small] == pytest.approx(5.0)
    assert (disks.radius[small] ** 2).sum() == pytest.approx((disks.radius[~small] ** 2).sum())
    assert disks.mass == pytest.approx(4.0 * disks.radius**2)  # of one density; the small ones have mass 1


@pytest.mark.full
def test_the_table_measures_each_of_its_gases(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = [replace(each, n=500) for each in table.ROWS if each.n <= 200_000]
    monkeypatch.setattr(table, "ROWS", (*small[:1], *small[2:5], *small[-2:], Memory(500, 1e6)))
    monkeypatch.setattr(table, "AFTER", 2.0)
    monkeypatch.setattr(backend, "stop", lambda: None)  # to give memory back: kernels would be lost
    assert script(table.table, ["--runs", "1", "--seconds", "0.01", "--threads", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("1 thread of ")
    assert lines[2:4] == ["| gas | measured | target | reached |", "|---|---|---|---|"]
    assert [line.split(" | ")[0].removeprefix("| ") for line in lines[4:]] == [
        "elastic, N = 5e2, phi = 0.3, one thread",
        "a collision at phi = 0.0001, against phi = 0.1, N = 5e2",
        "a collision at phi = 1e-06, against phi = 0.1, N = 5e2",
        "two sizes 1 : 10 of equal areas, against one, phi = 0.5, N = 5e2",
        "the IFR law with the energy ledger, against the same without, N = 5e2",
        "coins in clusters, N = 5e2, phi = 0.3, after 2 per disk",
        "memory at N = 5e2, ledger included",
    ]
    assert all(line.count("|") == 5 for line in lines[2:])
    assert lines[-1].endswith("| yes |")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--most", "10"], "--most 10: the smallest gas of the table has 1000 disks"), (["--most", "x"], '"x"')],
)
def test_a_script_refuses_impossible_arguments(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert script(table.table, arguments) == 2
    assert message in capsys.readouterr().err


def test_mean_free_time_is_that_of_the_collisions_seen() -> None:
    """With some 5000 collisions the statistical error is 1.4 %; theory is good to 0.5 %."""
    case = bench.elastic_gas(1000, 0.3, threads=1)
    gas = CaseGas.from_case(case)
    simulation = gas.simulation()
    simulation.run(t_end=bench.mixing_time(gas))
    before, start = simulation.collisions, simulation.time
    simulation.run(t_end=start + 10.0 * bench.mean_free_time(gas))
    per_disk = 2.0 * (simulation.collisions - before) / 1000
    assert math.isclose(per_disk, 10.0, rel_tol=0.05)  # 3.5 standard errors
