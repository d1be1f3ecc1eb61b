"""Studies of small gases: results, resuming, failures, and processes that are killed."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import distributed
import numpy as np
import pytest
import xarray
from matplotlib.collections import PolyCollection
from matplotlib.container import ErrorbarContainer
from support.cases import case_text
from support.worker_calls import quick_tasks

import ifrdem
from ifrdem.cli import main as cli
from ifrdem.errors import DamageError, DamageWarning, InputError
from ifrdem.simulation import backend
from ifrdem.study import task
from ifrdem.study.figure import _quantity, draw
from ifrdem.study.plan import ClusterSection
from ifrdem.study.results import Results
from ifrdem.study.study import StudyProgress
from ifrdem.study.task import Variable, load
from ifrdem.study.workers import dask, pool

CASE = case_text({
    "run.seed": 3, "run.collisions_per_disk": 4.0, "run.t_end": None, "species[0].number": 60,
    "species[0].speed_rms": 1.4, "output": {"series": 5},
})  # fmt: skip
VARY = "material[0].e_n=0.7,0.9"


def test_runs_are_others_if_the_file_of_a_wall_has_changed(toml: Path) -> None:
    """Runs that are done are known by their keys: they would be taken for those of the new wall."""
    text = CASE.replace("packing_fraction = 0.2", "lengths = [20.0, 20.0]")
    toml.write_text(f'{text}[[wall]]\nshape = "polyline"\nmaterial = "coin"\nfile = "wall.csv"\n')
    keys = []
    for points in ("2,2\n5,5\n", "2,2\n5,5\n", "2,2\n5,6\n"):
        toml.with_name("wall.csv").write_text(points)
        keys.append([task.key for task in ifrdem.Study(toml, vary=[VARY]).tasks])
    assert keys[0] == keys[1]
    assert len(keys[0]) == 2
    assert {*keys[0]}.isdisjoint(keys[2])


def same(one: Results, other: Results) -> bool:
    """Equal to the last bit, but for when they were written."""
    return one.variables.keys() == other.variables.keys() and all(
        each.dims == other.variables[name].dims
        and each.values.tobytes() == other.variables[name].values.tobytes()
        for name, each in one.variables.items()
        if each.values.dtype.kind in "iuf"
    )


def test_results_are_those_of_single_runs_with_means_and_standard_errors(toml, tmp_path):
    study = ifrdem.Study(toml, vary=[VARY], set=["output.series=8"], seeds=3, output=tmp_path / "out")
    assert study.run(workers=0) == {}
    found = xarray.open_dataset(tmp_path / "out.nc", engine="h5netcdf")
    assert dict(found.sizes) | {"e_n": 2, "seed": 3, "collisions_per_disk": 9} == dict(found.sizes)
    assert found.seed.values.tolist() == [3, 4, 5]  # from run.seed on
    assert found.collisions_per_disk.values.tolist() == [0.5 * i for i in range(9)]
    # The same gas by `ifrdem run`, which writes a file: equal to the last bit.
    changes = [
        "material[0].e_n=0.7",
        "run.seed=4",
        "output.series=8",
        "output.picture=false",
        "output.views=false",
    ]
    sets = [word for each in changes for word in ("--set", each)]
    assert cli.main(["run", str(toml), "-o", f"{tmp_path}/one", *sets]) == 0
    with ifrdem.Trajectory(tmp_path / "one.h5") as one:
        mine = found.sel(e_n=0.7, seed=4)
        assert np.array_equal(mine.temperature, one.series["temperature"])
        assert np.array_equal(mine.time, one.series.time)
        assert np.array_equal(mine.dissipated_by_mechanism, one.series["dissipated_by_mechanism"])
    T = found.temperature.values
    assert found.temperature_mean.values == pytest.approx(T.mean(axis=1), rel=1e-14)
    assert found.temperature_error.values == pytest.approx(
        T.std(axis=1, ddof=1) / np.sqrt(3.0), rel=1e-12, abs=1e-17
    )
    assert found.runs.values.tolist() == [3, 3]
    # T after 4 collisions each of disks without spin; theory is exact at the start and within noise of 60 disks later.
    assert found.temperature_theory.values[:, 0] == pytest.approx(T[:, 0, 0], rel=1e-12)
    assert found.temperature_theory.values == pytest.approx(found.temperature_mean.values, rel=0.15)
    assert xarray.open_dataset(tmp_path / "out.nc", engine="netcdf4").identical(found)
    assert study.dataset().temperature.identical(found.temperature)


def test_a_second_call_runs_only_what_is_new(toml, tmp_path, monkeypatch):
    first = ifrdem.Study(toml, vary=[VARY], seeds=2, output=tmp_path / "a")
    first.run(workers=0)
    done = {path.name: path.stat().st_mtime_ns for path in first.folder.glob("*.npz")}
    assert len(done) == 4
    more = ifrdem.Study(toml, vary=["material[0].e_n=0.7,0.8,0.9"], seeds=3, output=tmp_path / "a")
    more.run(workers=0)
    later = {path.name: path.stat().st_mtime_ns for path in more.folder.glob("*.npz")}
    assert len(later) == 9
    assert later.items() >= done.items()
    other = ifrdem.Study(toml, vary=[VARY], seeds=2, set=["box.packing_fraction=0.3"], output=tmp_path / "a")
    assert not any(task.result.exists() for task in other.tasks)


def test_keys_vary_together_or_in_every_combination(toml, tmp_path):
    (tmp_path / "study.toml").write_text("""
case = "gas.toml"
[sweep]
"material[0].mu" = { from = 0.01, to = 1.0, number = 3, spacing = "log" }
[[zip]]
"species[0].number" = { from = 20, to = 60, number = 2 }
"material[0].e_n" = [0.8, 0.9]
[ensemble]
seeds = [7, 1]
[output]
series = 2
""")
    study = ifrdem.Study(tmp_path / "study.toml", output=tmp_path / "s")
    study.run(workers=0)
    found = study.dataset()
    assert dict(found.sizes) | {"mu": 3, "number": 2, "seed": 2} == dict(found.sizes)
    assert found.mu.values.tolist() == [0.01, 0.1, 1.0]
    assert found.number.values.tolist() == [20, 60]
    assert found.e_n.dims == ("number",)
    assert found.seed.values.tolist() == [7, 1]
    # n disks of mass 1 at rms speed 1.4: n 1.4^2 / 2.
    assert found.energy.values[:, :, :, 0] == pytest.approx(
        np.broadcast_to([[19.6], [58.8]], (3, 2, 2)), rel=1e-12
    )


def test_names_of_axes_are_short_and_unique(toml):
    clash = ["material[0].e_n=0.7,0.8", "pair[0].e_n=0.7,0.8", "force[0].temperature=1.0,2.0"]
    study = ifrdem.Study(toml, vary=clash)
    assert [axis.names for axis in study.plan.axes] == [
        ("material0_e_n",),
        ("pair0_e_n",),
        ("force0_temperature",),
    ]


@pytest.mark.full
def test_frames_are_analysed_where_asked_for_and_trajectories_kept(toml, tmp_path):
    (tmp_path / "study.toml").write_text(f"""
case = "{toml.name}"
set = ["output.histories_all=true"]
[ensemble]
seeds = 2
[output]
series = 4
analyses = ["velocity", "impact"]
analyses_at = [1.5, 4.0]
trajectories = true
""")
    study = ifrdem.Study(tmp_path / "study.toml", output=tmp_path / "s")
    assert study.run(workers=0) == {}
    found = study.dataset()
    assert found["at"].values.tolist() == [1.5, 4.0]
    with ifrdem.Trajectory(study.folder / f"{found.run.values[1]}.h5") as kept:
        per_disk = 2.0 * kept.observables["collisions"] / 60
        frame = int(np.searchsorted(per_disk, 1.5))
        v2 = np.sum(kept[frame].velocity ** 2, axis=1)
    # a20 = <v^4> / (2 <v^2>^2) - 1 in two dimensions; the estimator takes the bias of 60 disks, some 1/60, off.
    assert found.velocity_a20.values[1, 0] == pytest.approx(
        np.mean(v2**2) / (2.0 * np.mean(v2) ** 2) - 1.0, abs=0.1
    )
    assert not np.array_equal(found.velocity_a20[:, 0], found.velocity_a20[:, 1])
    assert found.velocity_a20_mean.values == pytest.approx(found.velocity_a20.values.mean(axis=0))
    assert found.velocity_P_c.dims == ("seed", "at", "velocity_row")
    assert any(str(each).startswith("impact") for each in found)
    assert found.impact_mean_b_error.long_name == "mean of b = sin psi: standard error of the mean over seeds"
    with pytest.raises(InputError, match="impact_mean_b: is one number"):
        draw(study.results(), "impact_mean_b")
    (axes,) = draw(study.results(), "velocity_a20").axes
    assert axes.get_ylabel() == found.velocity_a20.long_name.replace("a20", "$a_{20}$")


def test_a_failed_run_is_listed_and_the_others_continue(toml, tmp_path, capsys):
    # Disks in an open box fly apart before each has had 4 collisions.
    words = ["study", str(toml), "--vary", "box.open=true,false", "-o", f"{tmp_path}/f", "--workers", "0"]
    assert cli.main(words) == 1
    printed = capsys.readouterr().err
    assert "1 of 2 runs failed" in printed
    assert "  open = true, seed 3: " in printed
    found = xarray.open_dataset(tmp_path / "f.nc", engine="h5netcdf")
    assert found.open.values.tolist() == ["true", "false"]
    assert found.runs.values.tolist() == [0, 1]
    assert [bool(text) for text in found.failure.values.ravel()] == [True, False]
    assert np.isnan(found.temperature_mean.values[0]).all()


def bad(tmp_path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert cli.main(["study", str(tmp_path / "gas.toml"), "-o", f"{tmp_path}/bad", *words]) == 2
    assert not list(tmp_path.glob("bad*"))
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--vary", "material[0].en=0.7,0.8"], "unknown key (did you mean 'e_n'?)"),
        (["--vary", VARY, "--vary", VARY], "two axes of this name"),
        (
            ["--vary", "material[0].e_n=0.7,1.2"],
            "e_n = 1.2: material[0].e_n = 1.2: must be a number from 0 to 1",
        ),
        (["--vary", "run.seed=1,2"], "cannot be swept: the seeds of the study"),
        (["--vary", "material[0].mu=0.1,0.1"], "0.1 is given twice"),
        (["--vary", "material[0].mu=0.1,0.2;material[0].e_n=0.7"], "as many values each"),
        (["--vary", "nonsense"], "must be KEY=VALUES"),
        (["--vary", "forces[0].rate=1,2"], "forces is not there (did you mean 'force'?)"),
        (["--seeds", "0"], "a number of seeds"),
        (["--part", "3/2"], "must be K/M"),
        (["--workers", "1", "--scheduler", "tcp://a:1"], "--workers: cannot be combined with --scheduler"),
        (["--scheduler", "nonsense://127.0.0.1:9"], "is no address such as tcp://host:8786"),
        (["--scheduler", "nonsense"], "is no address such as tcp://host:8786"),
    ],
)
def test_bad_input_is_refused_before_anything_starts(toml, tmp_path, capsys, words, message):
    assert message in bad(tmp_path, capsys, *words)


def test_coefficients_of_coins_come_with_advice_on_how_to_vary_them(tmp_path, capsys):
    coins = (
        CASE[: CASE.index("[[material]]")]
        + """
[[species]]
name = "coins"
coin = "1 pta"
number = 60
speed_rms = 1.4
"""
    )
    (tmp_path / "gas.toml").write_text(coins.replace('"reduced"', '"SI"'))
    messages = bad(tmp_path, capsys, "--vary", VARY)
    assert "material is not there: coefficients are those of species[0].coin" in messages
    assert (
        cli.main(["study", f"{tmp_path}/gas.toml", "--vary", 'species[0].coin="1 pta","5 pts"', "--dry-run"])
        == 0
    )


def test_points_that_check_refuses_are_left_out_by_keep_going_only(toml, tmp_path, capsys):
    words = ["study", str(toml), "--vary", "material[0].e_n=0.7,1.2", "-o", f"{tmp_path}/k", "--workers", "0"]
    assert cli.main(words) == 2
    assert "--keep-going" in capsys.readouterr().err
    assert cli.main([*words, "--keep-going"]) == 0
    found = xarray.open_dataset(tmp_path / "k.nc", engine="h5netcdf")
    assert found.runs.values.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("steps", "points"), [("0.01,9.0", "force0_step = 9.0, e_n = 0.7 (and 1 more): "), ("9.0", "")]
)
def test_a_dry_run_warns_once_of_long_steps_of_forces(toml, tmp_path, capsys, steps, points):
    force = 'force=[{ kind = "drag", rate = 0.1, step = 0.01 }]'
    words = ["study", str(toml), "-o", f"{tmp_path}/d", "--set", force, "--vary", f"force[0].step={steps}"]
    assert cli.main([*words, "--vary", VARY, "--dry-run"]) == 0
    printed = capsys.readouterr().err
    assert printed.count("warning: ") == 1
    assert f"warning: {points}force[0].step = 9: " in printed


def test_a_dry_run_starts_nothing(toml, tmp_path, capsys):
    assert (
        cli.main(["study", str(toml), "--vary", VARY, "--seeds", "5", "-o", f"{tmp_path}/d", "--dry-run"])
        == 0
    )
    printed = capsys.readouterr().out
    assert "2 points x 5 seeds = 10 runs" in printed
    assert "disk space" in printed
    # Not 0:00: processes start and load kernels in some 8 s, or compile them first.
    assert re.search(r"expected time +some 0:(08|09|1\d) on .*, up to a minute more", printed)
    assert [path.name for path in tmp_path.iterdir()] == ["gas.toml"]


def test_analyses_of_runs_take_time(toml, tmp_path):
    """Each run with analyses took 0.5 to 1 s of two busy cores, and was counted as one without, 0.1 s."""
    file, seconds = tmp_path / "study.toml", []
    for analyses in ("", 'analyses = ["velocity"]'):
        file.write_text(f'case = "gas.toml"\n[ensemble]\nseeds = 100\n[output]\nseries = 1\n{analyses}\n')
        seconds.append(ifrdem.Study(file).seconds)
    assert 5.0 < seconds[0] < 15.0
    assert 25.0 < seconds[1] < 100.0


def test_runs_in_this_process_take_the_threads_of_gases_without_a_number(
    toml: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They took all cores, also in a process that was to leave some to others."""
    study = ifrdem.Study(toml, vary=[VARY])
    for limit, threads in ((1, 1), (None, backend.cores())):
        monkeypatch.setattr(backend, "_most_threads", limit)
        assert study._processes(ClusterSection(workers=0)) == (0, threads)


def test_a_finished_study_expects_no_time(toml, tmp_path):
    study = ifrdem.Study(toml, vary=[VARY], seeds=1, output=tmp_path / "f")
    study.run(workers=0)
    assert study.summary(workers=0)[-1].split(maxsplit=2)[2] == "none: all runs are done"


def test_a_disk_that_becomes_full_ends_the_study_and_the_next_call_continues(
    toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of the other runs would be computed, for hours perhaps, and then lost as well."""
    save, tried = task.save, []

    def full(path: Path, *arguments: Any, **options: Any) -> None:
        tried.append(path)
        if len(tried) == 2:
            monkeypatch.setattr(tempfile, "TemporaryFile", none_left)
            raise InputError(f"output {path}: cannot be written: No space left on device")
        save(path, *arguments, **options)

    def none_left(**_options: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    words = ["study", str(toml), "--seeds", "4", "--workers", "0", "-o", str(tmp_path / "out.nc")]
    with monkeypatch.context():
        monkeypatch.setattr(task, "save", full)
        assert cli.main(words) == 1
    assert len(tried) == 2
    shown = " ".join(capsys.readouterr().err.split())
    assert (
        f"the study stops: {tmp_path / 'out.runs'} cannot be written to: No space left on device; free"
        in shown
    )
    assert "1 of 4 runs are done; the same command continues" in shown
    monkeypatch.undo()
    assert cli.main(words) == 0
    assert "4 of 4 runs" in capsys.readouterr().err


def test_the_disk_space_of_a_study_is_that_of_the_runs_that_are_left(
    toml: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = ifrdem.Study(toml, seeds=3, output=tmp_path / "out")
    assert study.run(workers=0) == {}
    used = sum(each.stat().st_size for each in tmp_path.rglob("out*") if each.is_file())
    used += sum(each.stat().st_size for each in (tmp_path / "out.runs").iterdir())
    assert 0.5 * used < study.bytes < 2.0 * used
    more, left = ifrdem.Study(toml, seeds=4, output=tmp_path / "out"), []
    for free in (10**6, 1000):
        monkeypatch.setattr(shutil, "disk_usage", lambda _folder, free=free: SimpleNamespace(free=free))
        try:
            more.check()
        except InputError as error:
            left.append(str(error))
    (text,) = left
    needed = float(
        re.search(r"needs some (\S+) kB more, and may take 900 bytes, 90 % of what is free", text)[1]
    )
    assert needed * 1e3 < more.bytes - 2 * 10_000  # three of four are there


def test_parts_of_an_array_job_add_up(toml, tmp_path):
    whole = ifrdem.Study(toml, vary=[VARY], seeds=2, output=tmp_path / "w")
    whole.run(workers=0)
    for k in (1, 2, 3):
        ifrdem.Study(toml, vary=[VARY], seeds=2, output=tmp_path / "p").run(workers=0, part=(k, 3))
        assert not (tmp_path / "p.nc").exists()
    parts = ifrdem.Study(toml, vary=[VARY], seeds=2, output=tmp_path / "p")
    assert same(parts.results(), whole.results())


def test_quantities_of_analyses_have_symbols_in_their_words() -> None:
    assert _quantity("stress_friction", "friction -P_xy / P_yy") == "friction $-P_{xy}$ / $P_{yy}$"


def results_of_panels(values: list[list[float]]) -> Results:
    """Results over rows at tau = 0, 1, ..., with a panel for each line of values."""
    shape = (len(values), 1)
    variables = {
        "a": Variable(("a",), np.arange(shape[0])),
        "b": Variable(("b",), np.arange(1)),
        "collisions_per_disk": Variable(("collisions_per_disk",), np.arange(len(values[0]), dtype=float)),
        "theta_mean": Variable(("a", "b", "collisions_per_disk"), np.array(values)[:, None]),
    }
    return Results(variables, {"axes": json.dumps({"a": ["a"], "b": ["b"]}), "title": "", "keys": "{}"})


@pytest.mark.parametrize(
    "values",
    [[[1.0, 2.0, 3.0], [-4.0, 5.0, 6.0]], [[1.0, 20.0, 300.0], [-4.0, 5.0, 6.0]]],
    ids=["even", "log"],
)
def test_axes_that_panels_share_show_the_values_of_all(values: list[list[float]]) -> None:
    panels = draw(results_of_panels(values), "theta", by="b").axes
    assert len(panels) == 2
    assert {axes.get_yscale() for axes in panels} == {"linear"}
    low, high = panels[0].get_ylim()
    assert low < np.min(values)
    assert high > np.max(values)


def test_pictures_of_studies_say_their_window_and_differ_in_grey() -> None:
    """A value at a swept key is that of the end, of a place of frames or of a window: titles say which.

    Powers of ten stand with the unit, not over the corner of the axes; intervals are inside of the axes; the places of
    frames are times with their unit; each column of panels has its numbers below, where the last row is short.
    """
    keys = {"e_n": "material[0].e_n", "mu": "material[0].mu"}
    axes = {"axes": json.dumps({name: [name] for name in keys}), "title": "gas", "keys": json.dumps(keys)}
    variables = {
        "e_n": Variable(("e_n",), np.array([0.7, 0.8]), ""), "mu": Variable(("mu",), np.arange(4.0), ""),
        "time": Variable(("time",), np.array([0.0, 1.0, 2.0]), "s"), "at": Variable(("at",), np.array([1.0, 2.0]), "s"),
        "seed": Variable(("seed",), np.arange(3), ""),
        "analyses_from": Variable(("e_n", "mu"), np.full((2, 4), 0.5), "s"),
    }  # fmt: skip
    for name, dims in {"temperature": ("time",), "velocity_a20": ("at",), "stress_p": ()}.items():
        shape = (2, 4, *(len(variables[dim].values) for dim in dims))
        variables[name] = Variable(("e_n", "mu", "seed", *dims), np.ones((2, 4, 3, *shape[2:])), "J")
        variables[f"{name}_mean"] = Variable(("e_n", "mu", *dims), np.full(shape, 2e-4), "J")
        variables[f"{name}_error"] = Variable(("e_n", "mu", *dims), np.full(shape, 1e-4), "J")
    results = Results(variables, axes)
    for what, end in (
        ("T", "at the end of the runs"),
        ("velocity_a20", "at t = 2 s"),
        ("stress_p", "means from t = 0.5 s on"),
    ):
        figure = draw(results, what, over="e_n")
        assert figure.get_suptitle() == f"gas; {end}"
        (panel,) = figure.axes
        low, high = panel.get_ylim()
        assert low < 2e-4 - 4.30 * 1e-4  # Student's t of two degrees of freedom
        assert high > 2e-4 + 4.30 * 1e-4
        assert len({line.get_marker() for line in panel.lines if str(line.get_label()).startswith("$")}) == 4
        assert panel.get_ylabel().endswith("($10^{-4}$ J)")
        figure.canvas.draw()
        assert panel.yaxis.get_offset_text().get_text() == ""
    figure = draw(results, "velocity_a20", by="e_n")
    assert figure.get_suptitle() == "gas"
    panels = [each for each in figure.axes if each.get_visible()]
    assert [each.get_xlabel() for each in panels] == ["", "time $t$ (s)", "time $t$ (s)", "time $t$ (s)"]


def test_names_of_quantities_are_listed_by_analyses(toml: Path, tmp_path: Path) -> None:
    """A list of a hundred names was no help."""
    names = [
        "energy",
        *(f"velocity_correlation_{i}" for i in range(20)),
        *(f"velocity_{i}" for i in range(5)),
        "rdf_g",
    ]
    variables = {f"{name}_mean": Variable(("time",), np.ones(2), "") for name in names}
    results = Results(
        {"time": Variable(("time",), np.arange(2.0), ""), **variables}, {"axes": "{}", "keys": "{}"}
    )
    with pytest.raises(InputError) as caught:
        draw(results, "nothing")
    text = str(caught.value)
    assert "velocity_correlation_3, 16 more velocity_correlation_..., velocity_0" in text
    assert text.endswith("velocity_3, 1 more velocity_..., rdf_g")


def test_species_of_a_quantity_are_curves_or_panels_beside_their_theory() -> None:
    values = np.arange(12.0).reshape(2, 3, 2)  # e_n, rows, species
    variables = {
        "e_n": Variable(("e_n",), np.array([0.8, 0.9])),
        "time": Variable(("time",), np.array([0.0, 1.0, 2.0])),
        "species": Variable(("species",), np.array(["heavy", "light"])),
        "heat_mean": Variable(("e_n", "time", "species"), values),
        "ratio_mean": Variable(("e_n",), np.array([0.5, 0.6])),
        "ratio_theory_mean": Variable(("e_n",), np.array([0.55, 0.65])),
    }
    results = Results(variables, {"axes": json.dumps({"e_n": ["e_n"]}), "title": "", "keys": "{}"})
    (axes,) = draw(results, "heat", over="e_n").axes
    drawn = {line.get_label(): line.get_ydata() for line in axes.lines}
    np.testing.assert_array_equal(drawn["heavy"], [4.0, 10.0])  # at the last row
    np.testing.assert_array_equal(drawn["light"], [5.0, 11.0])
    panels = draw(results, "heat").axes
    assert [each.get_title() for each in panels] == ["heavy", "light"]
    np.testing.assert_array_equal(panels[1].lines[1].get_ydata(), [7.0, 9.0, 11.0])
    (axes,) = draw(results, "heat", over="e_n", by="species").axes
    assert len(axes.lines) == 2
    (axes,) = draw(results, "ratio", over="e_n").axes
    found = [line.get_ydata().tolist() for line in axes.lines if len(line.get_ydata())]
    assert found == [[0.5, 0.6], [0.55, 0.65]]


def test_tables_are_drawn_over_their_first_column_and_others_are_refused(tmp_path: Path) -> None:
    """An assertion failed, and of what has no value an empty picture was drawn."""
    nan, dims = np.nan, ("e_n", "msd_row")
    variables = {
        "e_n": Variable(("e_n",), np.array([0.8, 0.9])),
        "seed": Variable(("seed",), np.array([1])),
        "collisions_per_disk": Variable(("collisions_per_disk",), np.array([0.0, 1.0])),
        "warnings": Variable(
            ("e_n", "seed"), np.array([["msd: 3 frames"], ["rdf: no\nmsd: 3 frames"]], object)
        ),
        "msd_D_mean": Variable(("e_n",), np.array([nan, nan])),
        "msd_lag_mean": Variable(dims, np.array([[0.0, 1.0, 2.0], [0.0, 3.0, nan]])),
        "msd_msd_mean": Variable(dims, np.array([[0.0, 4.0, 5.0], [0.0, 6.0, nan]])),
        "fields_x_mean": Variable(("fields_row",), np.array([0.0, 0.0, 1.0])),
        "fields_phi_mean": Variable(("fields_row",), np.array([0.1, 0.2, 0.3])),
    }
    Results(variables, {"axes": json.dumps({"e_n": ["e_n"]}), "title": "", "keys": '{"e_n": "e_n"}'}).write(
        tmp_path / "s.nc"
    )
    results = Results.read(tmp_path / "s.nc")
    (axes,) = draw(results, "msd_msd").axes
    assert axes.get_xlabel() == "msd lag"
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), [[0.0, 0.0], [1.0, 4.0], [2.0, 5.0]])
    np.testing.assert_array_equal(axes.lines[1].get_xydata()[:2], [[0.0, 0.0], [3.0, 6.0]])
    with pytest.raises(InputError, match=r"over = tau: allowed here are e_n, msd_lag"):
        draw(results, "msd_msd", over="tau")
    for name in ("msd_lag", "fields_x", "fields_phi"):
        with pytest.raises(InputError, match=rf"^{name}: is a column .* what can be drawn: msd_msd$"):
            draw(results, name)
    with pytest.raises(InputError, match=r"^no run has a value of msd_D: msd: 3 frames$"):
        draw(results, "msd_D")


class Unwritten:
    """Status that is written nowhere."""

    def update(self, **given: object) -> None:
        """Accept what a study reports."""


def test_progress_in_a_pipe_has_a_line_for_more_runs_only(capsys, monkeypatch) -> None:
    clock = iter(np.arange(0.0, 1000.0, 6.0))
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    progress = StudyProgress(2, [1.0, 1.0], Unwritten())
    for weight in (None, None, None, 1.0, None, 1.0):
        progress(weight, 0)
    runs = [line.split("%")[1].split(",")[0].strip() for line in capsys.readouterr().err.splitlines()]
    assert runs == ["0 of 2 runs", "1 of 2 runs", "2 of 2 runs"]


INTERVAL = "95 % interval of the mean (Student's $t$, 2 seeds)"


@pytest.mark.full
def test_a_study_is_followed_and_drawn(toml, tmp_path, capsys, drawn):
    study = ifrdem.Study(toml, vary=[VARY, "material[0].mu=0.1,0.5"], seeds=2, output=tmp_path / "t")
    study.run(workers=0)
    assert cli.main(["status", str(study.output), "--follow"]) == 0
    assert "8 of 8 runs" in capsys.readouterr().out
    assert cli.main(["plot", str(study.output), "T", "--over", "tau", "--by", "material[0].e_n"]) == 0
    assert "wrote t-T-over-tau-by-material-0-e_n.png\n" in "".join(capsys.readouterr())
    panels = drawn[0].axes
    assert [each.get_title() for each in panels] == [r"$\mu$ = 0.1", r"$\mu$ = 0.5"]
    labels = panels[0].get_legend_handles_labels()[1]
    assert labels[:2] == ["$e_n$ = 0.7", "$e_n$ = 0.9"]
    assert any("kinetic theory" in label for label in labels)
    handles = dict(zip(labels, panels[0].get_legend_handles_labels()[0], strict=True))
    assert isinstance(handles[INTERVAL], PolyCollection)  # a band, as is drawn
    assert (
        cli.main(["plot", str(study.output), "T", "--over", "material[0].e_n", "-o", f"{tmp_path}/ends"]) == 0
    )
    ends, names = drawn[1].axes[0].get_legend_handles_labels()
    # Theory between the swept values goes through what is stored at them.
    stored, at = study.results().variables["temperature_theory"].values, study.results().values("e_n")
    curves = [
        each for each in drawn[1].axes[0].lines if each.get_linestyle() == "--" and len(each.get_xdata()) > 2
    ]
    assert [len(each.get_xdata()) for each in curves] == [41, 41]
    for i, curve in enumerate(curves):
        x, y = curve.get_data()
        assert np.interp(at, x, y) == pytest.approx(stored[:, i, -1], rel=2e-5)  # both in 1500 times
        straight = np.interp(x, at, stored[:, i, -1])
        assert np.max(np.abs(y / straight - 1.0)) > 1e-3  # it is bent, which a line of two points is not
    assert isinstance(ends[names.index(INTERVAL)], ErrorbarContainer)
    solid = next(line for line in panels[0].lines if line.get_label() == "$e_n$ = 0.9")
    found = study.dataset()
    assert all("long_name" in each.attrs for each in found.variables.values())
    units = {"time": "reduced", "temperature_mean": "reduced", "theta": "1", "e_n": "1"}
    assert {name: found[name].units for name in units} == units
    mean = found.temperature_mean
    assert np.array_equal(solid.get_ydata(), mean.sel(e_n=0.9, mu=0.1))
    band = panels[0].collections[1].get_paths()[0].vertices[:, 1]  # of e_n = 0.9
    error = found.temperature_error.sel(e_n=0.9, mu=0.1).values
    # Of two values: tan(0.95 pi / 2), the quantile of a Cauchy distribution.
    assert band.max() == pytest.approx(np.max(mean.sel(e_n=0.9, mu=0.1) + np.tan(0.475 * np.pi) * error))
    assert cli.main(["plot", str(study.output), "theta", "--by", "foo"]) == 2
    capsys.readouterr()
    assert cli.main(["plot", str(study.output)]) == 2
    assert "temperature, rotational_temperature" in capsys.readouterr().err
    assert cli.main(["info", str(study.output)]) == 0
    printed = capsys.readouterr().out
    row = next(line for line in printed.splitlines() if line.split()[:3] == ["temperature", "0.9", "0.1"])
    last = found.isel(collisions_per_disk=-1).sel(e_n=0.9, mu=0.1)
    error = last.temperature_error.item()
    assert [float(each) for each in row.split()[3:7]] == pytest.approx(
        [last.temperature_mean.item(), error, np.tan(0.475 * np.pi) * error, 2], rel=1e-4
    )


def run_it(toml: Path, out: Path, engine: str) -> subprocess.Popen[str]:
    """A study of eight runs, in one process below its own: each more takes seconds to start."""
    program = f"""
import ifrdem
from ifrdem.study import workers
workers.has_dask = lambda: {engine == "dask"}
if __name__ == "__main__":
    changes = ["run.collisions_per_disk=200"]
    study = ifrdem.Study({str(toml)!r}, vary=["{VARY}"], seeds=4, set=changes, output={str(out)!r})
    print(study.run(workers=1), flush=True)
"""
    script = out.with_suffix(".py")
    script.write_text(program)
    return subprocess.Popen(
        [sys.executable, str(script)], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def children(pid: int) -> list[int]:
    """Processes below one, from /proc."""
    parents = {}
    for each in Path("/proc").iterdir():
        if each.name.isdecimal():
            try:
                parents[int(each.name)] = int((each / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
    found, new = [], [pid]
    while new:
        new = [one for one, parent in parents.items() if parent in new]
        found += new
    return found


def first_result(folder: Path, process: subprocess.Popen[str]) -> None:
    while not list(folder.glob("*.npz")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory) -> ifrdem.Study:
    """The study of `run_it`, of which nothing is killed."""
    folder = tmp_path_factory.mktemp("quiet")
    (folder / "gas.toml").write_text(CASE)
    study = ifrdem.Study(
        folder / "gas.toml",
        vary=[VARY],
        seeds=4,
        set=["run.collisions_per_disk=200"],
        output=folder / "quiet",
    )
    study.run(workers=0)
    backend.stop()  # stores the kernels, which processes below load
    return study


@pytest.mark.full
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")
@pytest.mark.parametrize("engine", ["pool", "dask"])
def test_killed_workers_and_clients_leave_the_same_bits_and_no_orphans(toml, quiet, tmp_path, engine):
    client = run_it(toml, tmp_path / "killed", engine)
    folder = tmp_path / "killed.runs"
    first_result(folder, client)
    below = children(client.pid)
    os.kill(client.pid, signal.SIGKILL)
    client.communicate()
    for _ in range(200):  # orphans see that their parent is gone
        if not any(Path(f"/proc/{pid}").exists() for pid in below):
            break
        time.sleep(0.05)
    assert not any(Path(f"/proc/{pid}").exists() for pid in below)
    kept = {path: path.stat().st_mtime_ns for path in folder.glob("*.npz")}
    for path in list(kept)[1:]:
        path.unlink()  # so that there is work left, however fast the machine is
    again = run_it(toml, tmp_path / "killed", engine)
    killed = False
    while not killed:  # a worker in the middle of its work
        assert again.poll() is None, again.communicate()
        if len(list(folder.glob("*.npz"))) > 1:
            workers_below = [
                pid
                for pid in children(again.pid)
                if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
            ]
            os.kill(workers_below[-1], signal.SIGKILL)
            killed = True
        time.sleep(0.02)
    printed, errors = again.communicate(timeout=120)
    assert printed.strip() == "{}", errors
    assert all(path.stat().st_mtime_ns == before for path, before in list(kept.items())[:1])
    assert same(Results.read(tmp_path / "killed.nc"), quiet.results())
    assert all(load(task.result) for task in quiet.tasks)


@pytest.mark.full
def test_a_run_that_ends_its_process_fails_alone_and_says_how() -> None:
    found = dict(filter(None, pool(quick_tasks("a", "ends", "b", path="ends"), 1, 1)))
    messages = {task.key: message for task, message in found.items()}
    assert messages == {
        "a": None,
        "b": None,
        "ends": "its process ended with status 7 and without a result, 3 times",
    }


@pytest.mark.full
def test_a_cluster_without_workers_is_waited_for_and_said() -> None:
    """Like a study with all its jobs ended at their time limit."""
    messages: list[str] = []
    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address="127.0.0.1:0") as cluster:
        place = ClusterSection(scheduler=cluster.scheduler_address)
        ended, looks = [], 0
        for one in dask(quick_tasks("a", "b"), place, 1, 1, messages.append):
            looks += one is None
            assert looks < 30  # seconds
            if one is None and looks > 2:
                cluster.scale(1)
            elif one is not None:
                ended.append((one[0].key, one[1]))
    assert sorted(ended) == [("a", None), ("b", None)]
    assert messages[1:] == ["the cluster has no worker: waiting for one"]


def test_the_template_is_a_study(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "study"]) == 0
    assert cli.main(["study", "study.toml", "--dry-run"]) == 0
    assert "9 points x 20 seeds = 180 runs" in capsys.readouterr().out


def test_a_result_that_would_fill_the_memory_is_damaged(tmp_path: Path) -> None:
    """Zeros are compressed to a thousandth of their size."""
    zeros = {"head": np.array('{"seconds": 1.0, "variables": {"a": [["x"], "", ""]}}'), "a": np.zeros(10**6)}
    np.savez(tmp_path / "right.npz", **zeros)
    assert len(load(tmp_path / "right.npz")[0]["a"].values) == 10**6
    np.savez_compressed(tmp_path / "bomb.npz", **zeros)
    with pytest.raises(
        DamageError, match=r"bomb\.npz is not a complete result .*a\.npy has 8000128 bytes, more"
    ):
        load(tmp_path / "bomb.npz")


@pytest.mark.full
def test_damaged_results_are_named_and_run_again(toml, tmp_path, capsys):
    """An empty, a truncated and a flipped result: before, EOFError, BadZipFile, or another number in silence."""
    words = [
        "study",
        str(toml),
        "--vary",
        VARY,
        "--seeds",
        "2",
        "--workers",
        "0",
        "-o",
        str(tmp_path / "s.nc"),
    ]
    assert cli.main(words) == 0
    whole = Results.read(tmp_path / "s.nc")
    empty, cut, flipped, _ = sorted((tmp_path / "s.runs").glob("*.npz"))
    content = flipped.read_bytes()
    empty.write_bytes(b"")
    cut.write_bytes(cut.read_bytes()[:3000])
    at = content.index(b"'shape': (6,)") + len(
        b"'shape': ("
    )  # 6 and 4 differ by one bit: four rows, if unnoticed
    flipped.write_bytes(content[:at] + b"4" + content[at + 1 :])
    capsys.readouterr()
    assert cli.main([*words, "--dry-run"]) == 0
    shown = capsys.readouterr().out
    assert "done already           1 of 4" in shown
    assert shown.count("to be run again") == 3
    study = ifrdem.Study(toml, vary=[VARY], seeds=2, output=tmp_path / "s.nc")
    with pytest.warns(DamageWarning, match="creates it again") as caught:
        partly = study.results()
    assert len(caught) == 3
    assert np.isnan(partly.values("temperature")[..., -1]).sum() == 3
    assert sum("not a complete result" in text for text in partly.values("failure").ravel()) == 3
    assert cli.main(words) == 0
    printed_again = capsys.readouterr().err
    assert printed_again.count("run again: e_n = ") == 3
    for each in (empty, cut, flipped):
        assert f"{each} is not a complete result of a study" in printed_again
    assert same(Results.read(tmp_path / "s.nc"), whole)


@pytest.mark.full
def test_results_that_crash_hdf5_end_in_a_message(toml, tmp_path, capsys):
    """H5DSis_scale of HDF5 2.0 frees memory twice where this text is another one, which aborts its process."""
    study = ifrdem.Study(toml, vary=[VARY], seeds=1, output=tmp_path / "s.nc")
    study.run(workers=0)
    content = (tmp_path / "s.nc").read_bytes()
    (tmp_path / "s.nc").write_bytes(content.replace(b"DIMENSION_SCALE", b"DIMENSION_SCALF", 1))
    with pytest.raises(DamageError, match=r"s\.nc is damaged: "):
        Results.read(tmp_path / "s.nc")
    assert cli.main(["plot", str(tmp_path / "s.nc"), "T", "-o", str(tmp_path / "T.png")]) == 2
    assert "s.nc is damaged" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"delete it, and it is made again from the runs in .*s\.runs"):
        study.run(workers=0)


@pytest.mark.parametrize(
    "make", [os.mkfifo, Path.mkdir, lambda place: place.write_text("x"), lambda place: None]
)
def test_what_is_no_file_of_results_is_refused(tmp_path, make):
    make(tmp_path / "s.nc")
    with pytest.raises(InputError, match=r"s\.nc: (is not a file|is not an HDF5 file|there is no such file)"):
        Results.read(tmp_path / "s.nc")


@pytest.mark.parametrize("seeds", [10**5001, "9" * 5001, [10**5001]], ids=["number", "text", "list"])
def test_seeds_that_python_cannot_write_are_refused(toml, tmp_path, seeds):
    with pytest.raises(ifrdem.InputError, match=r"seeds = .{1,80}: must be"):
        ifrdem.Study(toml, vary=[VARY], seeds=seeds, output=tmp_path / "out")


def test_values_that_stand_deep_in_each_other_are_refused(toml, tmp_path):
    deep = "[" * 3000 + "]" * 3000
    with pytest.raises(ifrdem.InputError, match=r"species\[0\]\.speed_rms = .*: must be"):
        ifrdem.Study(toml, vary=[f"species[0].speed_rms={deep},1"], seeds=1, output=tmp_path / "out").run()
