"""Output of a case: cadences, tracked disks, refusals."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.cases import case_text

from ifrdem.case import file as case_file
from ifrdem.case import report, shipped, starts, summary
from ifrdem.case.case import UNITS
from ifrdem.case.estimate import RunEstimate, run_seconds, step_seconds
from ifrdem.case.gas import CaseGas
from ifrdem.case.output_section import OutputSection
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.model.observables import measure
from ifrdem.quantities import EVENT, MECHANISMS, REGIMES
from ifrdem.runs import run
from ifrdem.runs.recorder import Ledger
from ifrdem.simulation.steps.schedule import Trigger
from ifrdem.tools import seeds
from ifrdem.trajectory.writer import TrajectoryWriter

CASE = case_text({
    "run.t_end": 2.0, "box.lengths": [40.0, 30.0], "box.packing_fraction": None, "material[0].e_t": -0.9,
    "material[0].mu": 0.1, "species[0].number": 200,
})  # fmt: skip


def output(toml: Path, *overrides: str) -> OutputSection:
    return case_file.read(toml, [f"output.{each}" for each in overrides]).case.output


@pytest.mark.parametrize(
    ("overrides", "frames", "series"),
    [
        ((), Trigger(number=100), Trigger(number=1000, exact=False)),
        (("frames=7",), Trigger(number=7), Trigger(number=70, exact=False)),
        (("frames_interval=0.5",), Trigger(interval=0.5), Trigger(interval=0.05, exact=False)),
        (("frames_collisions=2.0",), Trigger(collisions=2.0), Trigger(collisions=0.2, exact=False)),
        (
            ("frames=9", "frames_spacing=log", "log_from=0.01"),
            Trigger(number=9, spacing="log", log_from=0.01),
            Trigger(number=90, spacing="log", log_from=0.01, exact=False),
        ),
        (("series=50",), Trigger(number=100), Trigger(number=50)),
        (("series_interval=0.1",), Trigger(number=100), Trigger(interval=0.1)),
    ],
)
def test_cadences_are_those_of_the_case(toml, overrides, frames, series):
    found = output(toml, *overrides)
    assert found.frame_cadence() == frames
    assert found.series_cadence() == series


def test_tracked_disks_are_a_list_a_sample_a_region_or_all(toml):
    position = np.random.default_rng(1).random((200, 2)) * (40.0, 30.0)
    rng = seeds.stream(0, seeds.HISTORIES)
    assert output(toml).tracked(200, rng, position).tolist() == []
    assert output(toml, "histories=[7, 3]").tracked(200, rng, position).tolist() == [3, 7]
    sample = output(toml, "histories_sample=50").tracked(200, rng, position)
    assert len(np.unique(sample)) == 50
    inside = output(toml, "histories_region=[0.0, 0.0, 10.0, 30.0]").tracked(200, rng, position)
    assert set(inside) == set(np.flatnonzero(position[:, 0] < 10.0))
    assert len(output(toml, "histories_all=true").tracked(200, rng, position)) == 200


def test_any_of_the_keys_of_histories_stores_them(toml):
    assert not output(toml).tracks
    assert not output(toml, "histories_all=false").tracks
    for each in ("all=true", "sample=5", "region=[0.0, 0.0, 9.0, 9.0]"):
        assert output(toml, f"histories_{each}").tracks
    assert output(toml, "histories=[0]").tracks


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        (("frames=3", "frames_interval=0.1"), "must have at most one of frames, frames_interval"),
        (("series=3", "series_collisions=0.1"), "must have at most one of series, series_interval"),
        (("frames_interval=0.1", "frames_spacing=log"), 'frames_spacing = "log": requires a number'),
        (("series_spacing=log",), "series, the number of rows, is missing"),
        (("log_from=0.1",), "log_from requires"),
        (("frames_interval=0.0",), "output.frames_interval = 0"),
        (("frames_interval=1e-300",), "frames_interval = 1e-300: must be"),
        (("series_collisions=1e-300",), "series_collisions = 1e-300: must be"),
        (("frames=1000000000000",), "output.frames = 1000000000000: must be an integer from 1 to 10000000"),
        (("histories=[]",), "output.histories = []: must have at least 1 entry, none given"),
        (
            ("histories_region=[1.0]",),
            "output.histories_region = [1.0]: must have at least 4 entries, 1 given",
        ),
        (("histories=[1]", "histories_all=true"), "must have at most one of histories"),
        (("histories=[1, 200]",), "output.histories = 200: there are disks 0 to 199"),
        (("histories=[1, 1]",), "output.histories = 1: given twice"),
        (("histories_sample=201",), "output.histories_sample = 201: there are 200 disks"),
        (("histories_region=[5.0, 0.0, 1.0, 9.0]",), "each low one below the high one"),
        (("histories_region=[50.0, 0.0, 60.0, 9.0]",), "lies outside of the box"),
        (("fields=['position', 'position']",), "given twice: each may be given once"),
        (("fields=['positions']",), "output.fields"),
        (("historys=[1]",), "did you mean 'histories'"),
        (("checkpoint_minutes=0",), "output.checkpoint_minutes"),
    ],
)
def test_what_contradicts_itself_is_refused_by_name(toml, overrides, reason):
    with pytest.raises(InputError) as caught:
        output(toml, *overrides)
    assert reason in str(caught.value)


def test_histories_in_a_sheared_box_are_refused(toml):
    with pytest.raises(InputError, match=r"output\.histories = \[1\]: cannot .* box\.shear_rate = 0\.1"):
        case_file.read(toml, ["box.shear_rate=0.1", "output.histories=[1]"])


def test_a_region_where_no_disk_starts_is_refused(toml):
    case = case_file.read(
        toml, ["output.histories_region=[0.0, 0.0, 0.01, 0.01]", "start.positions=hexagonal"]
    ).case
    gas = CaseGas.from_case(case)
    with pytest.raises(InputError, match="no disk starts there"):
        starts.tracked(gas, starts.start(gas))


def check_cadences(toml: Path, *overrides: str) -> None:
    case = case_file.read(toml, overrides).case
    gas = CaseGas.from_case(case)
    summary.refuse_cadences(gas, RunEstimate.of(gas))


BY_COLLISIONS = ("run.t_end=", "run.collisions_per_disk=20.0")


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        # 1e7 in the run's 2.0, or 2e-7 apart, are allowed
        (
            ("output.frames_interval=1e-9",),
            "output.frames_interval = 1e-09: must be 2e-07 or more: otherwise more than 10000000 frames in 2",
        ),
        (
            ("output.series_interval=1.9e-7",),
            "output.series_interval = 1.9e-07: must be 2e-07 or more: otherwise more than 10000000 rows in 2",
        ),
        # one collision is 2 of 200 disks
        (
            ("output.frames_collisions=0.009", *BY_COLLISIONS),
            "output.frames_collisions = 0.009: must be 0.01 or more: otherwise more often than one",
        ),
        (("output.frames_collisions=1e-8",), "more often than one collision"),
        (
            ("output.series_collisions=0.011", "run.t_end=", "run.collisions_per_disk=2e5"),
            "output.series_collisions = 0.011: must be 0.02 or more: otherwise more than 10000000 rows in 2e+05",
        ),
        (("output.frames_interval=1e-12", *BY_COLLISIONS), "the length of the run by kinetic theory"),
        # walls: no theory of the length, but a mean free time
        (
            (
                "output.frames_interval=1e-12",
                "box.periodic=[false, true]",
                "box.material=coin",
                *BY_COLLISIONS,
            ),
            "the shortest time that the case names",
        ),
    ],
)
def test_cadences_that_make_no_sense_are_refused_before_work(toml, overrides, reason):
    with pytest.raises(InputError) as caught:
        check_cadences(toml, *overrides)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        ("output.frames_interval=2.1e-7",),
        ("output.frames_collisions=0.01", *BY_COLLISIONS),
        ("output.frames=10000000",),
    ],
)
def test_dense_cadences_that_can_be_are_not_refused(toml, overrides):
    check_cadences(toml, *overrides)


def test_check_refuses_them_with_status_2_and_no_report(toml, capsys):
    for setting in (
        "output.frames_interval=1e-12",
        "output.frames_collisions=1e-9",
        "output.series_interval=1e-300",
    ):
        assert cli.main(["check", str(toml), "--set", setting]) == 2
        shown = capsys.readouterr()
        assert shown.out == ""
        assert setting.partition("=")[0].partition(".")[2] in shown.err


def test_check_warns_of_a_file_that_has_no_room_here(toml, capsys):
    large = ["output.frames=10000000", "species[0].number=20000", "box.lengths=[400.0, 300.0]"]
    settings = [word for one in large for word in ("--set", one)]
    assert cli.main(["check", str(toml), *settings]) == 0
    shown = capsys.readouterr()
    assert "warning: output: the trajectory requires about" in shown.err
    assert "`ifrdem run` would refuse it here" in shown.err


def test_the_estimate_counts_frames_rows_and_tracked_disks(toml):
    case = case_file.read(toml, ["output.histories_sample=50"]).case
    found = RunEstimate.of(CaseGas.from_case(case))
    assert (found.frames, found.rows, found.tracked) == (101, 1001, 50)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    "overrides",
    [
        ("output.frames=20", "species[0].number=40000", "box.lengths=[400.0, 400.0]"),
        ("output.frames=1000", "species[0].number=50", "output.precision=f64", "output.series=1000"),
        (
            "output.frames=2",
            "output.histories_all=true",
            "species[0].number=3000",
            "box.lengths=[120.0, 120.0]",
            "run.collisions_per_disk=40",
            "run.t_end=",
        ),
    ],
)
def test_the_size_of_a_file_agrees_with_its_estimate(toml, overrides):
    """Within 5 % where frames are large; of many small ones, indices of chunks take up to a fifth of the file."""
    file = case_file.read(toml, overrides)
    case, output = file.case, file.case.output
    gas = CaseGas.from_case(case)
    expected = RunEstimate.of(gas)
    start, ledger = starts.start(gas), Ledger()
    measured = measure(gas.disks, start)
    if output.ledger:
        measured = replace(
            measured, dissipated=np.zeros(len(MECHANISMS)), regimes=np.zeros(5, dtype=np.int64)
        )
    place = toml.with_suffix(".h5")
    with TrajectoryWriter(
        place, gas.disks, gas.box, fields=output.fields, precision=output.precision,
        parameters=run._record(file, "cpu"), units=UNITS["reduced"], walls=gas.walls,
    ) as writer:  # fmt: skip
        if expected.tracked:
            events = round(2.0 * expected.collisions / gas.disks.n * expected.tracked)
            writer.begin_histories(np.arange(expected.tracked), start)
            columns = {
                name: np.zeros((events, *column.tail), dtype=column.dtype()) for name, column in EVENT.items()
            }
            writer.write_histories(columns, 1.0)
        for number in range(expected.frames):
            writer.write(replace(start, time=float(number)), ledger.observables(measured))
        names = {"dissipated_by_mechanism": MECHANISMS, "collisions_by_regime": REGIMES}
        columns = names if output.ledger else None
        writer.write_series_rows([(1.0 * i, ledger.row(measured)) for i in range(expected.rows)], columns)
    assert expected.file_bytes == pytest.approx(place.stat().st_size, rel=0.05 if gas.n > 10_000 else 0.2)


@pytest.mark.parametrize(
    ("phi", "n", "threads", "seconds"),
    [
        # Speeds as measured (`ifrdem/docs/results/bench.md`), of a million collisions: in one tile, and in tiles.
        (0.3, 10_000, 1, 1.0 / 1.74),
        (0.1, 1_000_000, 2, 1.0 / 1.15),
        (0.3, 1_000_000, 2, 1.0 / 1.99),
        (1e-6, 10_000, 1, 50.0),  # `ifrdem/docs/results/search.md`
    ],
)
def test_the_estimated_time_is_within_a_third_of_the_measured(phi, n, threads, seconds):
    assert run_seconds(1e6, n, phi, threads) == pytest.approx(seconds, rel=0.33)


def test_the_time_of_a_small_thermostatted_gas_is_that_of_its_force_steps() -> None:
    """100 disks, steps with hardly a collision: 0.92 ms of processor time for each (2026-11-26)."""
    steps = {"rescale": {1e-3: 2000.0}, "drag": {1e-3: 2000.0}}
    assert step_seconds(steps, 100, 1) == pytest.approx(1.85, rel=0.33)
    text = """
run = { t_end = 2.0, units = "reduced", threads = 1 }
box = { packing_fraction = 0.2 }
material = [{ name = "a", e_n = 1.0, e_t = -1.0, mu = 0.0 }]
species = [{ name = "d", material = "a", number = 100, mass = 1.0, radius = 0.5, speed_rms = 1.0 }]
force = [{ kind = "rescale", step = 1e-3, temperature = 0.5 }, { kind = "drag", step = 1e-3, rate = 0.1 }]
"""
    gas = case_file.of_text(text, Path("gas.toml")).gas
    estimate = RunEstimate.of(gas)
    assert estimate.force_steps == {kind: pytest.approx(given) for kind, given in steps.items()}
    rows = {row.quantity: row.value for row in report.report(gas, estimate).rows}
    assert rows["run time (start, force steps, windows, frames and output)"].startswith(
        "about 2."
    )  # no theory gives the collisions


@pytest.mark.parametrize(
    ("name", "seconds"),
    [("mixture", 0.55), ("elastic", 1.05), ("clusters", 1.66), ("cooling", 6.99), ("driven", 3.4), ("shear", 5.38),
     ("coins_on_table", 0.63)],
)  # fmt: skip
def test_the_time_of_shipped_cases_is_within_a_factor_of_2(name: str, seconds: float) -> None:
    """Processor time of whole runs with their output, one thread, kernels compiled (2026-11-26, a busy machine)."""
    gas = case_file.read(shipped.find(name), ["run.threads=1"]).gas
    assert 0.5 * seconds < RunEstimate.of(gas).seconds(gas, 1) < 2.0 * seconds


def test_check_estimates_the_time_and_says_why_a_thin_gas_is_slow(toml):
    def printed(*overrides: str) -> str:
        case = case_file.read(toml, overrides).case
        gas = CaseGas.from_case(case)
        return report.report(gas, RunEstimate.of(gas)).text

    assert "ifrdem bench" in printed(*BY_COLLISIONS)
    assert "phi^(-1/2)" not in printed(*BY_COLLISIONS)
    assert "phi^(-1/2)" in printed(*BY_COLLISIONS, "box.lengths=[3000.0, 3000.0]")


@pytest.mark.parametrize(
    ("given", "n", "ranks", "in_parts"),
    [
        ("auto", 1_000_000, 8, False),
        ("auto", 1_000_001, 8, True),
        ("auto", 1_000_001, 1, False),
        (True, 200, 1, True),
        (False, 1_000_001, 8, False),
    ],
)
def test_many_disks_on_ranks_are_written_in_parts_unless_the_case_says_otherwise(given, n, ranks, in_parts):
    assert OutputSection(parts=given).in_parts(n, ranks) is in_parts
    assert OutputSection().parts == "auto"


def test_check_names_the_parts(toml, capsys):
    path = str(toml)
    assert cli.main(["check", path]) == 0
    assert ".parts" not in capsys.readouterr().out
    assert cli.main(["check", path, "--set", "output.parts=true"]) == 0
    assert "its fields in gas.parts, a file for each rank" in capsys.readouterr().out
    for wrong, message in (
        ('"aut"', """= "aut": must be true, false or "auto" (did you mean 'auto'?)"""),
        ("1", "= 1: must"),
    ):
        assert cli.main(["check", path, "--set", f"output.parts={wrong}"]) == 2
        assert f"output.parts {message}" in capsys.readouterr().err


def test_the_estimated_time_names_the_compilation_separately(toml, capsys):
    assert cli.main(["check", str(toml)]) == 0
    shown = capsys.readouterr().out
    assert "  run time (start, collisions, windows, frames and output) " in shown
    assert re.search("compilation of kernels, before the run +a second or two if ", shown)


def test_a_run_time_that_is_not_known_is_stated_with_the_reason(capsys):
    assert cli.main(["check", "heap"]) == 0
    assert re.search(
        "run time +not estimated: the number of collisions is not known", capsys.readouterr().out
    )
