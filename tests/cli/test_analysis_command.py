"""`ifrdem analyse` and `ifrdem plot`: they print and write the results of the functions; messages name bad input."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from scipy.stats import beta
from support.figures import texts

from ifrdem import Box, Disks, State, Trajectory, TrajectoryWriter, analysis, observables
from ifrdem.analysis import catalogue
from ifrdem.analysis import result as outcome
from ifrdem.analysis import result as stored
from ifrdem.analysis.catalogue import number
from ifrdem.analysis.names import ANALYSES
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.plots import pictures
from ifrdem.quantities import COMPONENTS, EVENT, START, STRESS_SERIES

N, FRAMES, SPAN = 300, 12, 4.0
BOX = Box((40.0, 30.0))
NOT_POSSIBLE = {"species", "impact", "histograms", "cycle", "transport", "tail"}
"""Analyses that the file of `write_cooling` does not allow."""


def write_cooling(
    path: Path,
    *,
    fields: tuple[str, ...] = ("position", "velocity", "angular_velocity", "collisions", "image"),
    disks: Disks | None = None,
    box: Box = BOX,
    driven: float = 0.0,
    stressed: bool = False,
) -> Path:
    """An ideal gas that flies freely, and cools by Haff's law with t_H = 2 if one believes what is written of it."""
    disks = Disks(N, mass=1.0, radius=0.2) if disks is None else disks
    rng = np.random.default_rng(5)
    begin, velocity = rng.random((disks.n, 2)) * 30.0, rng.normal(size=(disks.n, 2))
    spin = rng.normal(size=disks.n)
    laws = json.dumps(
        [
            [
                {
                    "law": "ifr",
                    "e_n": 0.9,
                    "e_t": -1.0,
                    "mu": 0.0,
                    "sticking": "percussion_center",
                    "rho": 0.0,
                    "k": 2.0,
                }
            ]
        ]
    )
    parameters = {"name": "made up", "laws": laws}
    with TrajectoryWriter(path, disks, box, fields=fields, parameters=parameters, units={}) as writer:
        for time in np.linspace(0.0, SPAN, FRAMES):
            place = begin + velocity * time + (box.flow(begin) * time if box.shear_rate else 0.0)
            position = box.wrap(place, time)
            image = np.zeros_like(place) if box.is_open else np.floor(place / box.lengths)
            T = 1.5 / (1.0 + time / 2.0) ** 2
            totals = {
                "temperature": T,
                "rotational_temperature": T * (0.8 - 0.6 * np.exp(-time / 2.0)),
                "collisions": int(disks.n * 100.0 * time / 2.0),
                "energy": disks.n * T,
                "translational_energy": disks.n * T,
                "rotational_energy": 0.1 * disks.n * T,
                "potential_energy": 0.0,
                "dissipated_energy": disks.n * (1.5 - T),
                "energy_input": driven,
                "wall_work": 0.0,
                "wall_heat": 0.0,
            }
            state = State(position, velocity, spin, time=time, image=image.astype(np.int32))
            writer.write(state, totals)
        rows = [(t, dict.fromkeys(STRESS_SERIES, np.full(4, 1.0 if t else np.nan))) for t in (0.0, SPAN)]
        if stressed:
            writer.write_series_rows(rows, dict.fromkeys(STRESS_SERIES, COMPONENTS))
    return path


def add_histories(path: Path, count: int = 4000) -> np.ndarray:
    """Collisions of disks 3, 7 and 20 as layout 1.1 has them, and an uncommitted row; psi of each between disks."""
    rng = np.random.default_rng(6)
    b = rng.random(count + 1)
    partner = np.where(rng.random(count + 1) < 0.1, -2, 100 + np.arange(count + 1) % 50)
    angle = rng.random(count + 1) * 2.0 * np.pi
    columns = {
        "time": np.sort(rng.random(count + 1)) * SPAN,
        "id": rng.choice([3, 7, 20], count + 1).astype(np.int32),
        "partner": partner.astype(np.int32),
        "normal": np.stack((np.cos(angle), np.sin(angle)), axis=1),
        "impulse": np.tile([2.0, 0.3], (count + 1, 1)),
        "psi": np.arcsin(b),
        "regime": np.where(np.arange(count + 1) % 2, 1, 2).astype(np.int8),
    }
    # One collision of two tracked disks is there twice.
    columns["id"][:2], columns["partner"][:2] = (3, 7), (7, 3)
    columns["time"][-1] = 2.0 * SPAN
    with h5py.File(path, "r+") as file:
        group = file.create_group("histories")
        group["tracked"] = np.array([3, 7, 20], dtype=np.int32)
        group["start/time"] = 0.0
        for name, column in START.items():  # which analyses do not read
            group[f"start/{name}"] = np.zeros((3, *column.tail), dtype=column.dtype())
        for name, column in EVENT.items():
            if name not in columns:
                group[f"events/{name}"] = np.zeros((count + 1, *column.tail), dtype=column.dtype())
        group["committed/events"] = np.array([count // 2, count])
        group["committed/time"] = np.array([SPAN / 2.0, SPAN, 2.0 * SPAN])
        for name, values in columns.items():
            group[f"events/{name}"] = values
    pair = columns["partner"][:count] >= 0
    pair[1] = False
    return columns["psi"][:count][pair]


def table(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    return {name: np.array([row[i] for row in rows[1:]]) for i, name in enumerate(rows[0])}


def test_analyse_does_what_the_file_allows_and_reports_what_it_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5", stressed=True)
    assert cli.main(["analyse", "run.h5"]) == 0
    shown = capsys.readouterr().out
    record = json.loads(Path("run-analysis/run.json").read_text())
    assert set(record["analyses"]) | set(record["not_possible"]) == set(ANALYSES) == set(catalogue.FUNCTIONS)
    assert set(record["not_possible"]) == NOT_POSSIBLE
    assert "impact: not possible: run.h5 holds no histories of collisions" in shown
    assert "output.histories of the case" in shown
    for found in record["analyses"].values():
        for file in found["files"]:
            columns = table(Path("run-analysis") / file)
            assert len(next(iter(columns.values()))) > 0
    # The same numbers as by the functions.
    with Trajectory("run.h5") as trajectory:
        frames = trajectory[-7:]  # the second half
        sonine = analysis.velocity_distribution([f.velocity for f in frames], [f.spin for f in frames]).sonine
    stored = record["analyses"]["velocity"]["values"]["a20"]
    assert (stored["value"], stored["error"]) == pytest.approx((sonine.a20, sonine.a20_error))
    assert all(key.isidentifier() for found in record["analyses"].values() for key in found["values"])
    assert record["analyses"]["structure-factor"]["values"]["k_of_S_max"]["name"] == "k of the highest S"
    cooling = record["analyses"]["cooling"]["values"]
    assert cooling["t_H"]["value"] == pytest.approx(2.0, rel=1e-6)
    assert cooling["theta_relaxation"]["value"] == pytest.approx(200.0, rel=1e-3)
    # Free flight: the exponent is 2, which is no diffusion; the temperature that is written falls: in tau, no single D.
    assert record["analyses"]["msd"]["values"]["exponent"]["value"] == pytest.approx(2.0, abs=1e-4)
    assert "D" not in record["analyses"]["msd"]["values"]
    assert "  ! exponent = 2: must be 1 in diffusion" in shown
    assert (
        "  ! the gas is not stationary: T goes from 1.5 to 0.1667 in that time. Pressures are means over that time"
        in shown
    )
    msd = table(Path("run-analysis/run-msd.csv"))
    with Trajectory("run.h5") as trajectory:
        speed = float(np.mean(np.sum(trajectory[0].velocity ** 2, axis=1)))
    lag = msd["tau"].astype(float)[1:] / 100.0
    np.testing.assert_allclose(msd["msd"].astype(float)[1:], speed * lag**2, rtol=3e-4)


@pytest.mark.full
def test_a_folder_gets_the_analyses_that_it_lacks_and_keeps_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5", stressed=True)
    assert cli.main(["analyse", "run.h5", "cooling", "--json", "-o", "out"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert list(record["analyses"]) == ["cooling"]
    before = Path("out/run-cooling.csv").stat().st_mtime_ns
    # What is there is replaced by --force only, and nothing is computed before that is said.
    assert cli.main(["analyse", "run.h5", "velocity", "cooling", "-o", "out"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "out/run.json: holds cooling already; --force" in captured.err
    assert cli.main(["analyse", "run.h5", "velocity", "-o", "out"]) == 0
    shown = capsys.readouterr().out
    assert "wrote out/run-velocity.csv" in shown
    assert "wrote out/run.json" in shown
    assert not re.search("^cooling", shown, flags=re.MULTILINE)
    assert set(json.loads(Path("out/run.json").read_text())["analyses"]) == {"velocity", "cooling"}
    # All others, but not these again.
    assert cli.main(["analyse", "run.h5", "-o", "out"]) == 0
    shown = capsys.readouterr().out
    assert "cooling: is there already" in shown
    assert "impact: not possible" in shown
    record = json.loads(Path("out/run.json").read_text())
    assert set(record["analyses"]) == set(ANALYSES) - NOT_POSSIBLE
    assert set(record["not_possible"]) == NOT_POSSIBLE
    assert Path("out/run-cooling.csv").stat().st_mtime_ns == before
    assert cli.main(["analyse", "run.h5", "-o", "out"]) == 2
    assert "holds all that the file allows already" in capsys.readouterr().err
    assert cli.main(["analyse", "run.h5", "cooling", "-o", "out", "--force"]) == 0
    assert Path("out/run-cooling.csv").stat().st_mtime_ns > before
    assert set(json.loads(Path("out/run.json").read_text())["analyses"]) == set(ANALYSES) - NOT_POSSIBLE
    # What has become possible since is said to be so no more.
    add_histories(tmp_path / "run.h5")
    assert cli.main(["analyse", "run.h5", "impact", "-o", "out"]) == 0
    assert json.loads(Path("out/run.json").read_text())["not_possible"].keys() == NOT_POSSIBLE - {"impact"}


def test_analyses_of_another_run_and_foreign_files_in_the_folder_are_not_mixed_or_harmed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5")
    assert cli.main(["analyse", "run.h5", "cooling", "-o", "out"]) == 0
    other = tmp_path / "other"
    other.mkdir()
    write_cooling(other / "run.h5", disks=Disks(N - 1, mass=1.0, radius=0.2))
    assert cli.main(["analyse", "other/run.h5", "velocity", "-o", "out"]) == 2
    assert "holds analyses of another run (run.h5)" in capsys.readouterr().err
    assert cli.main(["analyse", "other/run.h5", "velocity", "-o", "out", "--force"]) == 0
    assert list(json.loads(Path("out/run.json").read_text())["analyses"]) == ["velocity"]
    # A table of that name that no summary knows, and one that is the trajectory itself under another name.
    Path("out/run-msd.csv").write_text("mine")
    assert cli.main(["analyse", "other/run.h5", "msd", "-o", "out"]) == 2
    assert "exists already; --force replaces it" in capsys.readouterr().err
    assert Path("out/run-msd.csv").read_text() == "mine"
    Path("out/run-vacf.csv").symlink_to(other / "run.h5")
    size = (other / "run.h5").stat().st_size
    assert cli.main(["analyse", "other/run.h5", "vacf", "-o", "out", "--force"]) == 2
    assert "is the trajectory itself" in capsys.readouterr().err
    assert (other / "run.h5").stat().st_size == size
    record = json.loads(Path("out/run.json").read_text())
    del record["analyses"]["velocity"]["values"]["a20"]["name"]
    for text in ("{}", json.dumps(record), '{"analyses": {"psi6": 1}, "not_possible": {}}'):
        Path("out/run.json").write_text(text)
        assert cli.main(["analyse", "other/run.h5", "psi6", "-o", "out"]) == 2
        assert "is not a summary that `ifrdem analyse` wrote" in capsys.readouterr().err
        assert Path("out/run.json").read_text() == text


def test_too_short_a_time_for_haffs_law_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(Path("run.h5"))  # frames at 40 / 11 and 4
    assert cli.main(["analyse", "run.h5", "cooling", "--from", "3.5"]) == 2
    assert "run.h5: 2 rows of T from t = 3.5 to 4: must be 4 or more" in capsys.readouterr().err


@pytest.mark.parametrize("stressed", [True, False])
def test_a_pressure_asks_for_stresses_only_where_there_are_none(tmp_path: Path, stressed: bool) -> None:
    with Trajectory(write_cooling(tmp_path / "run.h5", stressed=stressed)) as trajectory:
        (note,) = (one for one in catalogue.of_pressure(trajectory, None).notes if "not from impulses" in one)
    assert ("output.stress" in note) is not stressed


def test_a_gas_that_does_not_cool_by_haffs_law_is_reported_and_gets_no_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """T = 1.5 (1 - exp(t - 6) ...): a gas whose cooling breaks off, and theta that turns round."""
    monkeypatch.chdir(tmp_path)
    path = write_cooling(tmp_path / "run.h5")
    t = np.linspace(0.0, SPAN, 500)
    with h5py.File(path, "r+") as file:
        group = file.create_group("timeseries")
        group["step"], group["time"] = np.arange(500), t
        T = 1.5 / (1.0 + 5.0 * t) ** 2 + 0.3 * np.exp(-t)
        for name, values in (
            ("temperature", T),
            ("rotational_temperature", T * (0.5 + 0.4 * np.sin(3.0 * t))),
            ("collisions", np.arange(500) * 10),
        ):
            group[f"{name}/value"] = values
    assert cli.main(["analyse", "run.h5", "cooling"]) == 0
    shown = capsys.readouterr().out
    lines = shown.splitlines()
    assert lines[1].startswith("  ! Haff's law does not describe this run: ln T ")
    assert "rms 0.17" in lines[1]
    assert "noise 0.058 for 300 disks" in lines[1]
    assert lines[2].startswith("  ! one exponential does not describe this run: theta ")
    assert "+-" not in shown
    record = json.loads(Path("run-analysis/run.json").read_text())["analyses"]["cooling"]
    assert record["values"]["t_H"]["error"] is None
    assert len(record["warnings"]) == 2
    with Trajectory(path) as trajectory:
        message = texts(pictures.figure(trajectory, "cooling"))
    assert message.count("(poor)") == 4  # in two labels and two warnings
    assert "nan" not in message


def test_pressure_and_diffusion_of_a_gas_that_changes_warn_that_it_is_not_stationary(
    tmp_path: Path,
) -> None:
    path = write_cooling(tmp_path / "run.h5", driven=1.0)  # not only cooling, so that tau is no clock for it
    add_histories(path)
    with Trajectory(path) as trajectory:
        pressure = catalogue.FUNCTIONS["pressure"](trajectory, None)
        msd = catalogue.FUNCTIONS["msd"](trajectory, None)
        short = catalogue.FUNCTIONS["msd"](trajectory, list(range(3, 7)))
        label = texts(pictures.figure(trajectory, "msd"))
    for warning in (pressure.warnings[0], msd.warnings[0], short.warnings[0]):
        assert warning.startswith("the gas is not stationary: T goes from ")
    # From the middle one of 12 rows on, t = 24 / 11 (too few to find a start by): 1.5 / (1 + 12 / 11)^2 = 0.3431.
    assert "T goes from 0.3431 to 0.1667 in that time" in msd.warnings[0]
    assert np.isnan(msd.rows[0].value)
    assert "no $D$" in label
    steady = write_cooling(tmp_path / "steady.h5")
    with h5py.File(steady, "r+") as file:
        file["observables/temperature/value"][...] = 1.5
    with Trajectory(steady) as trajectory:
        assert catalogue.FUNCTIONS["pressure"](trajectory, None).warnings == []
        found = catalogue.FUNCTIONS["msd"](trajectory, None)
        assert not any("not stationary" in warning for warning in found.warnings)
        assert np.isfinite(found.rows[0].value)


def test_without_stored_temperatures_velocities_decide(tmp_path: Path) -> None:
    """Free disks whose speeds fall like 1 / (1 + t): T = <v^2> / 2 by 25 from t = 0 to 4."""
    rng, disks = np.random.default_rng(5), Disks(N, mass=1.0, radius=0.2)
    begin, velocity = rng.random((N, 2)) * 30.0, rng.normal(size=(N, 2))
    first = 0.5 * float(np.mean(np.sum(velocity**2, axis=1)))
    for fields in (("position", "velocity"), ("position",)):
        with TrajectoryWriter(tmp_path / "run.h5", disks, BOX, fields=fields, force=True) as writer:
            for t in np.linspace(0.0, 4.0, FRAMES):
                place = BOX.wrap(begin + velocity * np.log1p(t), t)
                writer.write(State(place, velocity / (1.0 + t), np.zeros(N), time=t))
        with Trajectory(tmp_path / "run.h5") as trajectory:
            found = catalogue.FUNCTIONS["msd"](trajectory, None)
        if "velocity" in fields:
            span = f"T goes from {first:.4g} to {first / 25.0:.4g} in that time"
            assert found.warnings[0].startswith(f"the gas is not stationary: {span}")
            assert np.isnan(found.rows[0].value)
        else:
            assert not any("not stationary" in warning for warning in found.warnings)
            assert any("temperatures nor velocities" in note for note in found.notes)


def test_error_of_a_pressure_distinguishes_cooling_from_scatter(tmp_path: Path) -> None:
    """2000 equal impulses at a rate that goes as T, of Poisson: 1 / sqrt(2000) of the collisional part.

    Without T in the blocks their fall by 25 counts as scatter: some 50 %.
    """
    rng = np.random.default_rng(8)
    # By the inverse of the integral of (1 + t / 2)^-2 from 0 to 8: u = (t / (1 + t / 2)) / 1.6.
    u = np.sort(rng.random(2000)) * 1.6
    time = u / (1.0 - u / 2.0)
    edges = np.linspace(0.0, 8.0, 21)
    mean = np.diff(edges / (1.0 + edges / 2.0)) / np.diff(edges)
    found = [
        analysis.pressure_from_impulses(
            time, np.tile([1.0, 0.0], (2000, 1)), np.tile([1.0, 0.0], (2000, 1)), np.ones(2000),
            span=(0.0, 8.0), area=10.0, disks=40, tracked=40, temperature=temperature,
        )
        for temperature in (mean, float(mean.mean()))
    ]  # fmt: skip
    assert found[0].kinetic == pytest.approx(found[1].kinetic) == pytest.approx(40 * 0.2 / 10.0)
    assert pytest.approx(found[1].Z) == found[0].Z
    # 20 blocks, of which the late ones have few collisions: the mean of their ratios has more scatter than the whole.
    assert 1.0 < found[0].error / found[0].collisional * np.sqrt(2000.0) < 4.0
    assert found[1].error / found[1].collisional > 0.2


def test_histories_give_angles_of_impact_once_each_and_a_pressure(tmp_path: Path) -> None:
    """Uncommitted rows and walls do not count. Each of those of 3 of 300 disks stands for 100 times sigma P_n / 2."""
    path = write_cooling(tmp_path / "run.h5")
    psi = add_histories(path)
    with Trajectory(path) as trajectory:
        found = catalogue.FUNCTIONS["impact"](trajectory, None)
        assert found.result.collisions == len(psi)
        assert found.result.mean_b == pytest.approx(np.sin(psi).mean())
        assert found.result.p_value > 1e-3
        shown = {row.name: row.value for row in found.rows}
        assert shown["p-value of a uniform b (Kolmogorov-Smirnov)"] == found.result.p_value
        assert not any("probability" in name for name in shown)
        pressure = catalogue.FUNCTIONS["pressure"](trajectory, None)
        half = catalogue.FUNCTIONS["impact"](trajectory, [0, 5])
    listed = len(psi) + 1
    expected = 0.5 * 100.0 * listed * 0.4 * 2.0 / (2.0 * 40.0 * 30.0 * SPAN)
    assert pressure.result.collisional == pytest.approx(expected)
    # T between frames is taken to be a straight line: a little more than the mean of 1.5 / (1 + t / 2)^2.
    exact = 1.5 * 2.0 * (1.0 - 1.0 / 3.0) / SPAN
    assert pressure.result.kinetic == pytest.approx(300.0 * exact / 1200.0, rel=0.02)
    assert 0.4 < half.result.collisions / len(psi) < 0.5
    # 100 collisions a disk and time; the mean of sqrt(T) from 0 to 4 is sqrt(1.5) 2 ln(3) / 4.
    phi = 300.0 * np.pi * 0.2**2 / 1200.0
    root = np.sqrt(1.5) * np.log(3.0) / 2.0
    chi = next(row.value for row in pressure.rows if row.name == "g at contact, from the collision rate")
    assert chi == pytest.approx(100.0 * 0.4 * np.sqrt(np.pi) / (8.0 * phi * root), rel=0.01)
    Z = next(row.value for row in pressure.rows if row.name == "Z, from the collision rate")
    assert pytest.approx(1.0 + 1.9 * phi * chi) == Z


def test_regimes_are_those_of_the_whole_gas_where_the_series_counts_them(tmp_path: Path) -> None:
    """Rows at t = 0, 1, ... 5, of which 4 is the last that the histories know."""
    path = write_cooling(tmp_path / "run.h5")
    add_histories(path)
    with Trajectory(path) as trajectory:
        tracked = catalogue.FUNCTIONS["impact"](trajectory, None).result
    assert tracked.regime_collisions == tracked.collisions
    rate = np.array([100, 700, 0, 200, 1000])  # of all five kinds, in a time of 1
    with h5py.File(path, "r+") as file:
        group = file.create_group("timeseries")
        group["step"], group["time"] = np.arange(6), np.arange(6.0)
        group["collisions_by_regime/value"] = np.arange(6)[:, None] * rate + 17
        columns = ["sliding", "sticking", "rolling_sliding", "rolling_sticking", "elastic"]
        group["collisions_by_regime"].attrs["columns"] = columns
    with Trajectory(path) as trajectory:
        outcome_ = catalogue.FUNCTIONS["impact"](trajectory, None)
        message = texts(pictures.figure(trajectory, "impact"))
    found = outcome_.result
    assert found.regime_collisions == 4 * 2000
    assert {name: share for name, (share, _) in found.regimes.items()} == {
        "sliding": 0.05,
        "sticking": 0.35,
        "sticking + rolling": 0.1,
        "elastic (remedy)": 0.5,
    }
    assert found.regimes["sliding"][1] == pytest.approx(beta(400.5, 7600.5).std())  # by Jeffreys' prior
    assert "of all 8000 collisions of two disks" in " ".join(outcome_.notes)
    assert "regimes of 8000 collisions" in message
    # A custom law has no regimes, and its counts mean nothing.
    with h5py.File(path, "r+") as file:
        file["histories/events/regime"][...] = -1
    with Trajectory(path) as trajectory:
        assert list(catalogue.FUNCTIONS["impact"](trajectory, None).result.regimes) == ["not known"]


def test_denser_series_are_used_where_the_file_has_them(tmp_path: Path) -> None:
    path = write_cooling(tmp_path / "run.h5")
    t = np.linspace(0.0, SPAN, 500)
    with h5py.File(path, "r+") as file:
        group = file.create_group("timeseries")
        group["step"], group["time"] = np.arange(499), t  # the last is not committed
        for name, values in (
            ("temperature", 3.0 / (1.0 + t / 5.0) ** 2),
            ("rotational_temperature", 0.1 + 0.0 * t),
            ("collisions", np.arange(500) * 10),
        ):
            group[f"{name}/value"] = values
    with Trajectory(path) as trajectory:
        found = catalogue.FUNCTIONS["cooling"](trajectory, None)
    haff, _ = found.result
    assert haff.t_H == pytest.approx(5.0, rel=1e-6)
    assert len(found.tables[""]["time"]) == 499


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    "what",
    [
        one
        for one in pictures.PICTURES
        if one not in NOT_POSSIBLE | {"mechanisms", "dissipation", "walls", "piston"} or one == "impact"
    ],
)
def test_every_picture_is_drawn_with_labels_and_legends(what: str, tmp_path: Path) -> None:
    path = write_cooling(tmp_path / "run.h5", stressed=True)
    add_histories(path)
    with Trajectory(path) as trajectory:
        figure = pictures.figure(trajectory, what)
        assert isinstance(figure, Figure)
        for axes in figure.axes[:2]:
            assert axes.get_xlabel() or axes.get_ylabel()
        message = texts(figure)
        for word in {
            "rdf": "at contact",
            "velocity": "Gaussian",
            "impact": "molecular chaos",
            "msd": "free flight",
        }.get(what, "").split("|"):
            assert word in message
        figure.draw_without_rendering()  # labels that mathtext cannot read fail here


@pytest.mark.full
@pytest.mark.parametrize("what", ["velocity", "energy", "ledger", "mechanisms"])
def test_legends_hide_no_curve_and_axes_end_where_the_data_do(what: str, tmp_path: Path) -> None:
    """Legends stand outside of the axes, on the page, and apart from the title."""
    path = write_cooling(tmp_path / "run.h5", driven=1.0)
    with TrajectoryWriter(
        tmp_path / "all.h5", Disks(N, mass=1.0, radius=0.2), BOX, units={}
    ) as writer, Trajectory(path) as gas:  # fmt: skip
        for i, frame in enumerate(gas):
            totals = {name: gas.observables[name][i] for name in gas.observables}
            totals["dissipated_by_mechanism"] = i * np.arange(1.0, 7.0)
            writer.write(State(frame.position, frame.velocity, frame.spin, time=frame.time), totals)
    with Trajectory(tmp_path / "all.h5") as trajectory:
        figure = pictures.figure(trajectory, what)
    figure.draw_without_rendering()
    legends = 0
    title = next(one for one in figure.texts if "disks" in one.get_text()).get_window_extent()
    for axes in figure.axes:
        if (legend := axes.get_legend()) is None:
            continue
        legends += 1
        place = legend.get_window_extent()
        assert place.y0 >= axes.get_window_extent().y1
        assert place.y1 <= title.y0
        assert place.x0 >= 0.0
        assert place.x1 <= figure.bbox.x1
        highest = max(np.nanmax(np.asarray(line.get_ydata(), dtype=float)) for line in axes.lines)
        assert highest < axes.get_ylim()[1] <= 2.5 * highest
    assert legends == (2 if what == "velocity" else 1)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    ("given", "made", "begin"),
    [
        ("d0", "d0.png", b"\x89PNG"),
        ("mu0.21", "mu0.21.png", b"\x89PNG"),
        ("a.png", "a.png", b"\x89PNG"),
        ("A.PNG", "A.PNG", b"\x89PNG"),
        ("a.svg", "a.svg", b"<?xml"),
        ("a.pdf", "a.pdf", b"%PDF"),
    ],
)
def test_the_ending_of_a_picture_gives_its_format_and_png_is_the_default(
    given: str, made: str, begin: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5")
    assert cli.main(["plot", "run.h5", "energy", "-o", given]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([made, "run.h5"])
    assert Path(made).read_bytes().startswith(begin)
    assert f"wrote {made}" in capsys.readouterr().out
    assert cli.main(["plot", "run.h5", "energy", "-o", given]) == 2
    assert f"{made}: exists already" in capsys.readouterr().err


def test_plot_writes_a_png_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5")
    assert cli.main(["plot", "run.h5", "energy"]) == 0
    assert Path("run-energy.png").read_bytes().startswith(b"\x89PNG")
    assert cli.main(["plot", "run.h5", "energy"]) == 2
    assert "exists already" in capsys.readouterr().err
    for command, names in (("plot", pictures.PICTURES), ("analyse", ANALYSES)):
        assert cli.main([command, "--list"]) == 0
        assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [*names]


@pytest.mark.full
def test_plots_have_colours_styles_and_an_axis_of_collisions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5")
    assert cli.main(["plot", "run.h5", "disks", "--color", "speed", "--style", "dark_background"]) == 0
    assert imread("run-disks.png")[0, 0, :3].max() < 0.1
    assert cli.main(["plot", "run.h5", "disks", "--color", "speed", "-o", "light"]) == 0
    assert imread("light.png")[0, 0, :3].min() > 0.9
    assert cli.main(["plot", "run.h5", "temperatures", "--over", "tau"]) == 0
    assert Path("run-temperatures-over-tau.png").exists()
    for words, message in (
        (("disks", "--color", "sped"), "--color sped: must be one of spin, speed"),
        (
            ("energy", "--color", "speed"),
            "color = speed: cannot be combined with energy; it is an option of disks",
        ),
        (("disks", "--style", "dark_backgroud"), "(did you mean 'dark_background'?)"),
        (
            ("rdf", "--over", "tau"),
            "--over tau: cannot be combined with rdf; it is an option of temperatures, energy, ledger, mechanisms, "
            "walls, piston, species",
        ),
    ):
        assert cli.main(["plot", "run.h5", *words, "-o", "no.png"]) == 2
        assert message in capsys.readouterr().err
    assert not Path("no.png").exists()


@pytest.mark.full(keep=7)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("analyse", "run.h5", "velocty"), "no analysis is called 'velocty' (did you mean 'velocity'?)"),
        (
            ("plot", "run.h5", "temperature"),
            "no picture is called 'temperature' (did you mean 'temperatures'?)",
        ),
        (("plot", "run.h5"), "TRAJECTORY or WHAT is missing"),
        (("plot", "run.h5", "disks", "-o", "run.h5", "--force"), "is the trajectory itself"),
        (("plot", "run.h5", "disks", "-o", "/dev/zero", "--force"), "is a device or pipe"),
        (
            ("plot", "run.h5", "disks", "-o", "a.tif"),
            "-o a.tif: the name of a picture ends in .png, .svg, .pdf, or has no ending",
        ),
        (
            ("analyse", "run.h5", "impact"),
            "holds no histories of collisions: name the disks to track in output.hist",
        ),
        (("analyse", "no.h5"), "there is no such file"),
        (("analyse", "run.h5", "--frames", "12"), "names none of the 12 frames (0 to 11)"),
        (("analyse", "run.h5", "--frames", "1:x"), "must be a number or a:b:c"),
        (("analyse", "run.h5", "--frames", "20:"), "none of the 12 frames"),
        (("analyse", "run.h5", "-o", "no/where"), "output folder no/where: no does not exist"),
        (("analyse", "run.h5", "msd", "--frames", "3"), "1 frames are too few"),
        (("analyse", "run.h5", "profiles", "--axis", "z"), "--axis z: must be one of 'x', 'y', 'r'"),
        (("analyse", "run.h5", "profiles", "--axis", "r"), "axis = r: must have circular walls"),
        (("analyse", "run.h5", "profiles", "--bins", "0"), "--bins 0: must be an integer from 1 to 10000"),
        (("analyse", "run.h5", "fields", "--cells", "20"), "--cells 20: must be two integers from 1 to 300"),
        (
            ("analyse", "run.h5", "fields", "--cells", "20,x"),
            "--cells 20,x: must be two integers from 1 to 300",
        ),
        (("analyse", "run.h5", "msd", "--bins", "3"), "--bins requires profiles"),
        (("plot", "run.h5", "profiles", "--average"), "--average requires fields"),
        (("plot", "run.h5", "other.h5", "T", "--axis", "y"), "--axis requires profiles"),
    ],
)
def test_bad_input_ends_with_one_message(
    words: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5")
    assert cli.main([*words]) == 2
    assert message in capsys.readouterr().err
    assert not Path("run-analysis").exists()


def test_profiles_and_fields_take_bins_from_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_cooling(tmp_path / "run.h5")
    words = ("--axis", "x", "--bins", "5", "--cells", "2,3", "--average", "--frames", "4:", "--json")
    assert cli.main(["analyse", "run.h5", "profiles", "fields", *words]) == 0
    record = json.loads(capsys.readouterr().out)["analyses"]
    profile, grid = (table(Path("run-analysis") / f"run-{name}.csv") for name in ("profiles", "fields"))
    with Trajectory("run.h5") as trajectory:
        found = analysis.profiles(trajectory, "x", 5, frames=range(4, FRAMES))
        with pytest.raises(
            InputError, match=r"bins = 3: cannot be combined with msd; it is an option of profiles"
        ):
            trajectory.plot("msd", bins=3)
    np.testing.assert_allclose(profile["x"].astype(float), [4.0, 12.0, 20.0, 28.0, 36.0])
    np.testing.assert_allclose(
        profile["temperature_y"].astype(float), found.mean.temperatures[:, 1], rtol=1e-9
    )
    assert len(grid["u_x"]) == 6
    assert profile["disks"].astype(float).sum() == grid["disks"].astype(float).sum() == N * (FRAMES - 4)
    for name in ("profiles", "fields"):
        assert record[name]["frames"] == FRAMES - 4
        assert any("set output.histories_all = true" in note for note in record[name]["notes"])
    assert record["profiles"]["values"]["bin_width"]["value"] == 8.0


def test_missing_fields_are_named_with_the_key_that_stores_them(tmp_path: Path) -> None:
    path = write_cooling(tmp_path / "run.h5", fields=("position",))
    with Trajectory(path) as trajectory:
        with pytest.raises(InputError, match=r'"velocity" and "angular_velocity" into output\.fields'):
            catalogue.FUNCTIONS["velocity"](trajectory, None)
        with pytest.raises(InputError, match=r'put "velocity" into output\.fields'):
            catalogue.FUNCTIONS["fields"](trajectory, None)
        assert 'no "image" in the file' in " ".join(catalogue.FUNCTIONS["msd"](trajectory, None).notes)


def test_missing_observables_are_named_with_the_key_that_stores_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The field `collisions` of the disks is no observable; what the message gives as code works."""
    path = tmp_path / "gas.h5"
    disks, rng = Disks(N, mass=1.0, radius=0.2), np.random.default_rng(1)
    with TrajectoryWriter(path, disks, BOX) as writer:
        for time in (0.0, 1.0):
            state = State(rng.random((N, 2)) * 30.0, rng.normal(size=(N, 2)), np.ones(N), time=time)
            writer.write(state, {"temperature": 1.0})
    assert cli.main(["analyse", str(path), "pressure"]) == 2
    message = capsys.readouterr().err
    assert "gas.h5 holds no observable collisions (collisions of each disk" in message
    code = '{"collisions": measure.collisions}'
    assert f"file.write(state, {code})" in message
    totals = eval(code, {"measure": observables.measure(disks, state)})  # the test's own text
    assert totals == {"collisions": 0}
    with Trajectory(path) as trajectory, pytest.raises(InputError, match=r'"ledger_residual": \.\.\.}'):
        stored.series(trajectory, "ledger_residual")


def test_driven_gases_get_no_haff_law_and_walls_no_contact_value(tmp_path: Path) -> None:
    path = write_cooling(tmp_path / "run.h5", driven=3.0, box=Box((40.0, 40.0), periodic=(True, False)))
    with Trajectory(path) as trajectory:
        with pytest.raises(InputError, match="energy_input is not 0"):
            catalogue.FUNCTIONS["cooling"](trajectory, None)
        with pytest.raises(InputError, match="periodic box only"):
            catalogue.FUNCTIONS["pressure"](trajectory, None)
        assert "no contact value" in catalogue.FUNCTIONS["rdf"](trajectory, None).notes[0]


def test_species_are_distinguished_and_immovable_disks_left_out(tmp_path: Path) -> None:
    radius = np.where(np.arange(N) % 2, 0.2, 0.4)
    mass = np.where(np.arange(N) % 2, 1.0, 8.0)
    mass[0] = np.inf
    path = write_cooling(
        tmp_path / "run.h5", disks=Disks(N, mass=mass, radius=radius, material=np.arange(N) % 2)
    )
    with Trajectory(path) as trajectory:
        found = catalogue.FUNCTIONS["velocity"](trajectory, None)
        assert list(found.result) == ["material 0, R = 0.4", "material 1, R = 0.2"]
        assert [one.sonine.disks for one in found.result.values()] == [149, 150]
        for over, x in (("t", trajectory.times), ("tau", 2.0 * trajectory.observables["collisions"] / N)):
            upper, lower = trajectory.plot("species", ax=Figure().subplots(2), over=over)
            np.testing.assert_allclose(upper.lines[0].get_xdata(), x)
            assert lower.get_legend().get_bbox_to_anchor().y0 >= lower.bbox.y1  # above the curves
    many = Disks(N, mass=1.0, radius=np.linspace(0.1, 0.2, N))
    with Trajectory(write_cooling(tmp_path / "many.h5", disks=many)) as trajectory:
        assert list(outcome.kinds(trajectory)) == ["disks of 300 kinds together, as if at one temperature"]


@pytest.mark.full
@pytest.mark.parametrize(
    "box", [Box((40.0, 30.0), shear_rate=0.3), Box.open(), Box((40.0, 40.0), periodic=(False, False))]
)
def test_every_kind_of_box_is_analysed_or_refused_with_a_reason(box: Box, tmp_path: Path) -> None:
    with Trajectory(write_cooling(tmp_path / "run.h5", box=box)) as trajectory:
        done, reasons = [], []
        for name, one in catalogue.FUNCTIONS.items():
            try:
                one(trajectory, None)
                done.append(name)
            except InputError as error:
                reasons.append(str(error))
        assert all("\n" not in reason and len(reason) > 20 for reason in reasons)
        assert {"velocity", "msd", "fields", "clusters", "psi6", "cooling"} <= set(done)
        assert ("rdf" in done) != box.is_open
        assert ("structure-factor" in done) == all(box.periodic)


def test_numbers_are_rounded_to_their_errors() -> None:
    assert number(outcome.Reading("x", 1.23456, 0.0123)) == "1.235 +- 0.012"
    assert number(outcome.Reading("x", 5.9515e-9, 2.03e-12, "J")) == "5.9515e-09 +- 2.0e-12 J"
    assert number(outcome.Reading("x", 12345.6, 230.0)) == "12346 +- 230"
    assert number(outcome.Reading("x", float("nan"))) == "none"
    assert number(outcome.Reading("x", 0.25, unit="m")) == "0.25 m"


def test_several_files_give_means_with_errors_and_curves_together(
    tmp_path, capsys, drawn, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        write_cooling(tmp_path / f"{name}.h5", driven=1.0)
    assert cli.main(["analyse", "a.h5", "b.h5", "velocity"]) == 0
    printed = capsys.readouterr().out
    assert "mean over 2 files" in printed
    one = json.loads((tmp_path / "b-analysis" / "b.json").read_text())["analyses"]["velocity"]["values"][
        "a20"
    ]["value"]
    assert re.search(rf"velocity: a20 +{one:.3f}", printed)  # of two equal files
    assert cli.main(["plot", "a.h5", "b.h5", "theta", "--over", "tau"]) == 0
    (axes,) = drawn[0].axes
    assert [line.get_label() for line in axes.lines] == ["a", "b"]
    # theta = T_rot / T = 0.8 - 0.6 exp(-t / 2) of what was written.
    assert axes.lines[0].get_ydata()[-1] == pytest.approx(0.8 - 0.6 * math.exp(-SPAN / 2.0))
    assert cli.main(["plot", "a.h5", "b.h5", "nonsense"]) == 2
    assert cli.main(["analyse", "none.h5", "velocity"]) == 2
