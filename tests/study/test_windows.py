"""Averages over time in studies: where they begin, for all seeds, and what is marked."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.signal import lfilter
from support.cases import case_text
from test_study import CASE

import ifrdem
from ifrdem import plots
from ifrdem.analysis.catalogue import FUNCTIONS
from ifrdem.analysis.common import mean_errors
from ifrdem.analysis.motion import of_msd
from ifrdem.analysis.result import Evaluation, FramesFrom
from ifrdem.analysis.window import frames_from, steady_frames
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.study.contents import _window, describe
from ifrdem.study.figure import WINDOW_START, draw
from ifrdem.study.lines import Rows, _of_curves
from ifrdem.study.results import (
    THEORY,
    Predicted,
    Results,
    averaged,
    half_interval,
    theory_of,
    warnings_of,
)
from ifrdem.study.study import START_SECONDS
from ifrdem.study.task import Task, Variable
from ifrdem.study.windows import SAME_RUN, window_of
from ifrdem.tools import versions
from ifrdem.tools.intervals import student_t

SHEARED = case_text({
    "material[0].e_n": 0.8, "run.collisions_per_disk": None, "run.t_end": 20.0, "box.shear_rate": 1.0,
    "species[0].speed_rms": 6.0, "output": {"series": 80, "stress": True, "frames": 20},
}, text=CASE)  # fmt: skip
STUDY = """
case = "gas.toml"
[ensemble]
seeds = {seeds}
[output]
analyses = ["stress"]
"""


@pytest.fixture(scope="module")
def sheared(tmp_path_factory: pytest.TempPathFactory) -> ifrdem.Study:
    """A sheared gas that starts six times as hot as it ends, of six seeds."""
    return study(tmp_path_factory.mktemp("sheared"), SHEARED, STUDY.format(seeds=6) + "trajectories = true\n")


def study(folder: Path, case: str, text: str) -> ifrdem.Study:
    (folder / "gas.toml").write_text(case)
    (folder / "study.toml").write_text(text)
    found = ifrdem.Study(folder / "study.toml", output=folder / "s")
    assert found.run(workers=0) == {}
    return found


def normal_difference(stress: np.ndarray) -> np.ndarray:
    """N_1 of each seed from rows (seeds, rows, 4) of the pressure tensor, of equal times."""
    xx, yy = stress[..., 0].mean(axis=1), stress[..., 3].mean(axis=1)
    return 2.0 * (xx - yy) / (xx + yy)


@pytest.mark.full
def test_averages_of_all_seeds_begin_after_the_transient(sheared):
    """N_1 and the viscosity were means from t = 0 on: here 0.35 for 0.46, 0.61 for 0.49, 5 errors off."""
    found = sheared.results()
    assert found.values("analyses_from") == 10.0  # the transient takes a quarter of the run
    rows, stress = found.values("time"), found.values("stress")
    late = stress[:, rows > 10.0]  # a row has the mean from the one before
    assert found.values("stress_N_1") == pytest.approx(normal_difference(late), rel=1e-9)
    viscosity = -late[..., 1].mean(axis=1)  # the shear rate is 1
    assert found.values("stress_viscosity") == pytest.approx(viscosity, rel=1e-9)
    assert found.values("stress_N_1_error") == pytest.approx(normal_difference(late).std(ddof=1) / 6**0.5)
    whole = normal_difference(stress[:, 1:])
    assert normal_difference(late).mean() - whole.mean() > 3.0 * found.values("stress_N_1_error")
    # Independent rows would be 40; T of so few disks is remembered for many collisions.
    n_eff = found.values("temperature_n_eff")
    assert np.all((n_eff >= 1.0) & (n_eff < 20.0))
    assert not any(found.values("warnings"))


def test_a_single_run_begins_where_a_study_of_one_seed_does(sheared, tmp_path, capsys):
    found = ifrdem.Study(sheared.output.with_name("study.toml"), seeds=1, output=sheared.output)
    results = found.results()  # of a run that is done
    start = float(results.values("analyses_from"))
    assert 0.0 < start <= 10.0
    path = found.folder / f"{results.values('run')[0]}.h5"
    with ifrdem.Trajectory(path) as trajectory:
        own = FUNCTIONS["stress"](trajectory, None)
    assert own.times == (start, 20.0)
    values = {row.key or row.name: row.value for row in own.rows}
    assert results.values("stress_N_1")[0] == values["N_1"]
    out = ["-o", str(tmp_path / "a"), "--force"]
    assert cli.main(["analyse", str(path), "stress", "--from", "3", *out]) == 0
    assert "t = 3 to 20" in capsys.readouterr().out
    assert cli.main(["analyse", str(path), "stress", "--from", "21", *out]) == 2
    assert "--from 21: must be before the end of the run, t = 20" in capsys.readouterr().err
    assert cli.main(["analyse", str(path), "stress", "--from", "3", "--frames", "5:", *out]) == 2
    assert "--from: cannot be combined with --frames" in capsys.readouterr().err
    assert cli.main(["plot", str(path), "temperatures", "--from", "3"]) == 2
    assert cli.main(["info", str(path), "--from", "3"]) == 2


def test_a_start_that_is_given_wins_and_must_lie_in_the_run(tmp_path):
    text = STUDY.format(seeds=2) + "analyses_from = {}\n"
    found = study(tmp_path, SHEARED.replace("t_end = 20.0", "t_end = 2.0"), text.format(1.5)).results()
    late = found.values("stress")[:, found.values("time") > 1.5]
    assert found.values("stress_N_1") == pytest.approx(normal_difference(late), rel=1e-9)
    assert found.values("analyses_from") == 1.5
    assert "averages begin here (analyses_from)" in draw(found, "T").axes[0].get_legend_handles_labels()[1]
    (tmp_path / "study.toml").write_text(text.format(2.0))
    with pytest.raises(InputError, match=r"analyses_from = 2: must be"):
        ifrdem.Study(tmp_path / "study.toml")


@pytest.mark.full
def test_warnings_of_runs_are_kept_and_counted(tmp_path, capsys):
    """They were dropped, although a single run gives them."""
    short = SHEARED.replace("t_end = 20.0", "t_end = 1.5").replace("speed_rms = 6.0", "speed_rms = 30.0")
    found = study(tmp_path, short, STUDY.format(seeds=4))
    texts = found.results().values("warnings")
    assert all("the gas is not stationary from t = 0.75 on: T goes from " in text for text in texts)
    assert all("stress: P_ab: flux of momentum " in text for text in found.results().values("notes"))
    capsys.readouterr()
    assert cli.main(["study", str(tmp_path / "study.toml"), "-o", str(tmp_path / "s"), "--workers", "0"]) == 0
    assert "4 of 4 runs with warnings" in capsys.readouterr().err
    assert cli.main(["info", f"{tmp_path}/s.nc"]) == 0
    printed = capsys.readouterr().out
    assert "! 4 of 4 runs with warnings" in printed
    assert f"  written by {versions.shown()}\n" in printed
    assert "analyses over time average from time = 0.75 on; n_eff of T in a run: " in printed
    assert cli.main(["plot", f"{tmp_path}/s.nc", "T", "-o", f"{tmp_path}/T"]) == 0
    assert "4 of 4 runs with warnings: `ifrdem info " in capsys.readouterr().err
    # Of two seeds each run is compared with itself.
    two = study(tmp_path, short, STUDY.format(seeds=2) + "analyses_from = 0.0\n").results().values("warnings")
    assert all("stress: the gas is not stationary: T goes from " in text for text in two)


def test_a_cooling_gas_is_averaged_over_the_whole_run(tmp_path):
    text = STUDY.format(seeds=2).replace("stress", "pressure") + "trajectories = true\n"
    found = study(tmp_path, CASE, text).results()
    assert found.values("analyses_from") == 0.0
    warned = [str(each) for each in found.values("warnings")]
    assert all("pressure: the gas is not stationary: T goes from " in text for text in warned)
    with ifrdem.Trajectory(tmp_path / "s.runs" / f"{found.values('run')[0]}.h5") as run:
        assert steady_frames(run, None) is None
        # A place is collisions per disk where these end the run: the first row with as many.
        tau = run.series["collisions_per_disk"]
        assert frames_from(run, 2.0, "x").time == run.series.time[tau >= 2.0][0]


def test_seeds_that_give_the_same_run_have_no_error():
    """Their error was 0, and drawn."""
    T = np.array([2.0, 1.0, 3.0])
    runs = {seed: {"temperature": Variable(("time",), T.copy())} for seed in (0, 1, 2)}
    window = window_of("time", np.arange(3.0), runs, None)
    assert window.marks == [SAME_RUN]
    runs[1]["temperature"].values[1] = runs[2]["temperature"].values[2] = 5.0
    assert window_of("time", np.arange(3.0), runs, None).marks == []


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with gas.h5, whose frames are 0.5 apart, and cases that start from it."""
    folder = tmp_path_factory.mktemp("frame")
    case = SHEARED.replace("t_end = 20.0", "t_end = 1.0").replace(
        "frames = 20", "frames = 4\npicture = false"
    )
    (folder / "gas.toml").write_text(case)
    assert cli.main(["run", str(folder / "gas.toml"), "-o", str(folder / "gas")]) == 0
    return folder


def test_seeds_that_change_nothing_are_refused_before_any_work(frame, monkeypatch):
    """Runs from a frame with its motion were equal to the bit, and their error was 0."""
    monkeypatch.chdir(frame)
    start = ['start.positions="gas.h5"', "start.frame=0", "run.t_end=2.0"]
    motion = [*start, "start.motion=true", "species[0].speed_rms="]
    with pytest.raises(
        InputError, match=r"seeds = 3: all runs would be the same.*Without start\.motion = true"
    ):
        ifrdem.Study("gas.toml", set=motion, seeds=3, output="out").check()
    assert not list(frame.glob("out*"))
    ifrdem.Study("gas.toml", set=motion, seeds=1, output="out").check()
    ifrdem.Study("gas.toml", set=start, seeds=3, output="out").check()  # velocities are drawn
    kicks = ['force=[{kind="poisson_spin_kicks", power=0.1, rate=5.0}]']
    ifrdem.Study("gas.toml", set=[*motion, *kicks], seeds=3, output="out").check()
    drag = ['force=[{kind="drag", rate=0.1, step=0.01}]']
    with pytest.raises(InputError, match="seeds = 3: all runs would be the same"):
        ifrdem.Study("gas.toml", set=[*motion, *drag], seeds=3, output="out").check()


def test_messages_on_a_frame_of_a_sheared_box_do_not_contradict(frame, monkeypatch):
    """One wanted start.time = 0 and the other none; a frame at a multiple of L_x / (shear rate L_y) = 1 needs 0."""
    monkeypatch.chdir(frame)
    start = ['start.positions="gas.h5"', "run.t_end=2.0"]

    def check(*changes: str) -> None:
        ifrdem.Study("gas.toml", set=[*start, *changes], output="out").check()

    with pytest.raises(
        InputError, match=r"start\.time = 0\.5: must be 0 .* this needs a frame at a multiple of 1$"
    ):
        check("start.frame=2")
    with pytest.raises(
        InputError, match=r"start\.time = 0: .* by t = 0\.5.* differ by a multiple of 1 "
    ) as caught:
        check("start.frame=2", "start.time=0.0")
    assert "leave start.time out" not in str(caught.value)
    check("start.frame=4", "start.time=0.0")


@pytest.mark.full
def test_frames_of_runs_that_end_at_a_time_are_drawn_over_both_clocks(tmp_path):
    """Over tau this was a ValueError: places of frames are no rows of series."""
    short, text = (
        SHEARED.replace("t_end = 20.0", "t_end = 1.5"),
        STUDY.format(seeds=2).replace("stress", "velocity"),
    )
    undated = study(tmp_path, short, text).results()  # of frames of the second half
    results = study(tmp_path, short, text + "analyses_at = [0.5, 1.5]\n").results()
    tau = results.values("collisions_per_disk_mean")
    rows = results.values("time")
    (axes,) = draw(results, "velocity_a20", over="tau").axes
    assert axes.lines[0].get_xdata() == pytest.approx(np.interp([0.5, 1.5], rows, tau))
    (axes,) = draw(results, "velocity_a20", over="t").axes
    assert axes.lines[0].get_xdata() == pytest.approx([0.5, 1.5])
    with pytest.raises(InputError, match=r"over = tau: allowed here are velocity_c"):
        draw(undated, "velocity_P_c", over="tau")


@pytest.mark.full
def test_series_are_averaged_from_a_place_on(sheared, capsys):
    results = sheared.results()
    T = results.values("temperature")[:, results.values("time") >= 12.0].mean(axis=1)
    # Student's t of 5 degrees of freedom at 95 %: 2.5706 (tables).
    expected = [T.mean(), T.std(ddof=1) / 6**0.5, 2.5706 * T.std(ddof=1) / 6**0.5, 6]
    printed = describe(sheared.output, 12.0)
    row = next(line for line in printed.splitlines() if line.split()[:1] == ["temperature"])
    assert [float(each) for each in row.split()[1:5]] == pytest.approx(expected, rel=1e-4)
    assert "series are means from time = 12 on" in printed
    assert cli.main(["info", str(sheared.output), "--from", "21"]) == 2
    assert "--from 21: must be at most 20, the last row of time" in capsys.readouterr().err
    assert cli.main(["plot", str(sheared.output), "stress_N_1", "--from", "3"]) == 2
    assert "stress_N_1 is no series" in capsys.readouterr().err


def test_series_of_a_driven_gas_are_means_over_the_steady_window(sheared):
    """Tables and pictures had the last row, whose error is that of a single row."""
    results = sheared.results()
    rows = results.values("time") >= 10.0  # the window, as above
    found = averaged(results)
    T = results.values("temperature")[:, rows]
    assert found.values("temperature") == pytest.approx(T.mean(axis=1))
    error, n_eff = mean_errors(T.T)
    assert found.values("temperature_run_error") == pytest.approx(error)
    assert found.values("temperature_n_eff") == pytest.approx(n_eff)
    assert found.values("series_from") == 10.0
    # Rows of the stress are means since the row before: without the one that ends where the window begins.
    assert found.values("stress") == pytest.approx(
        results.values("stress")[:, results.values("time") >= 10.0].mean(axis=1)
    )
    # What adds up has its value at the end.
    assert np.array_equal(found.values("dissipated_energy"), results.values("dissipated_energy")[:, -1])
    printed = describe(sheared.output)
    row = next(line for line in printed.splitlines() if line.split()[:1] == ["temperature"]).split()
    assert float(row[1]) == pytest.approx(T.mean(), rel=1e-4)
    assert float(row[5]) == pytest.approx(n_eff.mean(), rel=1e-2)
    assert "series are means from time = 10 on" in printed
    assert "stress xy" in printed
    (axes,) = draw(results, "T").axes
    (begin,) = [line for line in axes.lines if line.get_gid() == WINDOW_START]
    assert begin.get_xdata()[0] == 10.0
    assert "the steady window begins" in axes.get_legend_handles_labels()[1]
    data = sheared.means(12.0)
    assert float(data.temperature_mean) == pytest.approx(
        results.values("temperature")[:, results.values("time") >= 12.0].mean()
    )


def synthetic(T: np.ndarray, drive: float = 1.0) -> Results:
    """Results of one point from rows of T (seeds, rows), through the choice of its window."""
    seeds, rows = T.shape
    places = np.arange(float(rows))
    runs = {i: {"temperature": Variable(("time",), T[i])} for i in range(seeds)}
    window = window_of("time", places, runs, None, steady=drive > 0.0)
    n_eff = np.array([[window.effective[i] for i in range(seeds)]])
    variables = {
        "e_n": Variable(("e_n",), np.array([0.9])), "seed": Variable(("seed",), np.arange(seeds)),
        "time": Variable(("time",), places), "temperature": Variable(("e_n", "seed", "time"), T[None]),
        "temperature_mean": Variable(("e_n", "time"), T.mean(axis=0)[None]),
        "analyses_from": Variable(("e_n",), np.array([window.start])), "temperature_n_eff": Variable(("e_n", "seed"), n_eff),
    }  # fmt: skip
    return Results(variables, {"axes": '{"e_n": ["e_n"]}', "keys": "{}"})


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(
    ("seeds", "rho", "amplitude"), [(1, 0.8, 0.0), (1, 0.95, 20.0), (4, 0.8, 20.0), (4, 0.95, 20.0)]
)
def test_intervals_of_means_over_the_window_hold_the_truth(seeds, rho, amplitude):
    """Noise of correlation rho^lag with a transient of a twentieth of the run: the truth is 0.

    Means over all rows hold it in none of the trials with a transient, and an interval by n_eff = rows in a third.
    """
    rng, rows, trials = np.random.default_rng(1), 200, 100
    held = 0
    for _ in range(trials):
        noise = rng.normal(size=(seeds, rows)) * np.sqrt(1.0 - rho**2)
        noise[:, 0] /= np.sqrt(1.0 - rho**2)
        T = lfilter([1.0], [1.0, -rho], noise, axis=1) + amplitude * np.exp(-np.arange(rows) / (0.05 * rows))
        found = averaged(synthetic(T))
        half = half_interval(found, "temperature")
        assert half is not None
        if seeds == 1:
            error, n_eff = (found.values(f"temperature_{name}")[0, 0] for name in ("run_error", "n_eff"))
            assert half[0] == pytest.approx(student_t(n_eff) * error)
        held += abs(found.values("temperature_mean")[0]) < half[0]
    assert held >= 0.88 * trials  # of 95 %: 3.2 standard deviations of their number


@pytest.mark.full
def test_results_of_older_versions_are_read_still(sheared, tmp_path):
    results = sheared.results()
    new = ("warnings", "notes", "analyses_from", "temperature_n_eff")
    old = {name: one for name, one in results.variables.items() if name not in new}
    Results(old, results.attributes).write(tmp_path / "old.nc")
    assert "stress_N_1" in describe(tmp_path / "old.nc")
    assert draw(Results.read(tmp_path / "old.nc"), "T").axes
    assert warnings_of(Results.read(tmp_path / "old.nc")) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ('cores = "vier"', r'cluster\.options\.cores = "vier": must be a whole number, 1 or more'),
        ("cores = 2, processes = 0", r"cluster\.options\.processes = 0: must be a whole number"),
        ("memory = 16", r"cluster\.options\.memory = 16: must be a text with a unit"),
        ('memory = "much"', r"cluster\.options: dask-jobqueue makes no job of .*Could not interpret 'much'"),
        ("cors = 4", r"cluster\.options\.cors: .* \(did you mean 'cores'\?\)"),
    ],
)
def test_a_dry_run_checks_the_options_of_a_cluster(tmp_path, capsys, options, message):
    (tmp_path / "s.toml").write_text(
        f'case = "cooling"\n[cluster]\nkind = "slurm"\noptions = {{ {options} }}\n'
    )
    assert cli.main(["study", str(tmp_path / "s.toml"), "-o", str(tmp_path / "s"), "--dry-run"]) == 2
    assert re.search(message, capsys.readouterr().err)


def test_names_that_are_too_long_are_refused():
    """OSError before."""
    for given in ("a" * 300, "a" * 300 + ".toml", "a/" * 3000 + "b.toml"):
        with pytest.raises(InputError, match="must be a path of 4095 bytes at most, each name of 255"):
            ifrdem.Study(given)
    for output in ("a" * 300, "a/" * 3000 + "b"):
        with pytest.raises(InputError, match="must be a path of 4095 bytes at most, each name of 255"):
            ifrdem.Study("cooling", output=output).check()


def test_too_few_frames_are_said_once_with_window_and_remedy_and_without_a_path(monkeypatch) -> None:
    """The path was that of a file which is removed after the run, so that each run had a line of its own."""

    class Frames(SimpleNamespace):
        def __len__(self) -> int:
            return 4

    def few(trajectory: Frames, start: FramesFrom) -> Evaluation:
        if start.time == 0.0:
            return Evaluation(None, [], {}, [], (0.0, 1.0))
        return of_msd(trajectory, start)

    texts = []
    starts = [FramesFrom([0], 0.0), FramesFrom([1, 2, 3], 0.75)]
    task = Task(
        "key", (0,), "", "", (), "", analyses=("msd",), at=(), start=None, trajectory=False, weight=1.0
    )
    monkeypatch.setattr("ifrdem.analysis.window.has_window", lambda trajectory: True)
    monkeypatch.setattr("ifrdem.analysis.window.steady_starts", lambda trajectory: starts)
    monkeypatch.setattr("ifrdem.analysis.catalogue.FUNCTIONS", {"msd": few})
    for name in ("one.h5", "two.h5"):
        found = task._analysed(Frames(path=Path(name), fields=["position"]))
        texts.append(str(found["warnings"].values[1]))
    assert texts[0] == texts[1]
    assert re.match(
        r"msd: not possible: 3 frames from t = 0.75 on are too few: .* 4; output.frames ", texts[0]
    )


def test_the_range_of_starts_is_no_interval_of_time() -> None:
    """It read "average from time = 0.75 to 1.5 on"."""
    variables = {
        "time": Variable(("time",), np.array([0.0, 3.0])),
        "analyses_from": Variable(("e_n",), np.array([0.75, 1.5]), "s"),
    }
    (line,) = _window(Results(variables))
    text = "average to the end of each run; where they begin differs between points: time = 0.75 to 1.5 s"
    assert text in line


def test_theory_of_theta_between_points_is_a_mean_of_ratios_as_that_of_the_rows() -> None:
    """Rows at 1 and 2 with T = 1, 2 and T_rot = 1, 1: the mean of ratios is 3/4, the ratio of means 2/3."""
    places = np.array([0.0, 1.0, 2.0])
    curves = Predicted(places, places, np.array([9.0, 1.0, 2.0]), np.array([9.0, 1.0, 1.0]), "Gaussian", None)
    rows = Rows("time", places, 0.0, 2.0)
    assert [_of_curves(name, curves, rows) for name in THEORY] == [1.5, 1.0, 0.75]
    assert np.isnan(_of_curves("theta", curves, rows._replace(places=places + 1.0)))  # beyond the curves


def test_stresses_of_a_flow_stand_beside_those_of_theory(sheared: ifrdem.Study) -> None:
    """The theory of an analysis is a column of the table, not a quantity of its own, and has a chi2."""
    found = sheared.results()
    theory = theory_of(found, "stress_N_1")
    assert theory is not None
    assert theory.dims == found.variables["stress_N_1_mean"].dims
    assert 0.0 < theory.values.ravel()[0] < 2.0
    lines = describe(sheared.output, what=["stress_N_1", "stress_T_x_over_T_y"]).splitlines()
    (head,) = (line for line in lines if line.startswith("  quantity"))
    (row,) = (line for line in lines if line.startswith("  stress_N_1 ") and "against" not in line)
    place = head.index("theory")
    assert float(row[place:].split()[0]) == pytest.approx(theory.values.ravel()[0], rel=1e-5)
    assert any(line.startswith("  stress_T_x_over_T_y against kinetic theory: chi2 = ") for line in lines)
    assert "stress_N_1_theory" not in describe(sheared.output)


def test_ratios_of_stresses_are_drawn_beside_theory(sheared: ifrdem.Study) -> None:
    """A third panel of a sheared gas has N_1, friction and T_x / T_y of the disks, and those of the theory."""
    path = sheared.folder / f"{sheared.results().values('run')[0]}.h5"
    with ifrdem.Trajectory(path) as run:
        rows = {row.key: row.value for row in FUNCTIONS["stress"](run, None).rows}
        *_, axes = plots.figure(run, "stress").axes
        run.plot("stress", ax=(two := Figure().subplots(1, 2)))  # without the ratios
    assert all(each.has_data() for each in two)
    (seen,) = (each for each in axes.lines if "kinetic theory" in each.get_label())
    names = ("N_1", "friction", "T_x_over_T_y")
    assert seen.get_ydata() == pytest.approx([rows[f"{name}_theory"] for name in names])
    (bars,) = axes.containers
    assert bars[0].get_ydata() == pytest.approx([rows[name] for name in names])


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("rough_cooling", 43.4),
        ("viscoelastic_cooling", 36.2),
        ("mixture_cooling", 161.0),
        ("shear_stress", 262.0),
    ],
)
def test_the_time_of_shipped_studies_is_within_a_factor_of_2(
    name: str, seconds: float, tmp_path: Path
) -> None:
    """Processor time of the command with one process, kernels compiled (2026-11-29, a busy machine)."""
    expected = START_SECONDS + ifrdem.Study(name, output=tmp_path / "none.nc").seconds
    assert 0.5 * seconds < expected < 2.0 * seconds
