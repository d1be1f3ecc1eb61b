"""Variants of a case as an axis, options of analyses, equilibrated starts, maps, and chi2 against theory."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas
import pytest
from scipy.stats import kstest
from support.manual import block
from test_study import CASE

import ifrdem
from ifrdem.analysis.result import Evaluation
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.study.contents import PointMean, _against_theory, describe
from ifrdem.study.figure import draw
from ifrdem.study.results import Results
from ifrdem.study.task import Task, Variable

STUDY = """
case = "gas.toml"
set = ["run.collisions_per_disk=2"]
[[variants]]
name = "rough"
[[variants]]
name = "smooth"
set = ["material[0].mu=0.0", "material[0].e_t=-1.0"]
remove = ["material[0].rho"]
[[variants]]
name = "other"
case = "other.toml"
[sweep]
"material[0].e_n" = [0.7, 0.9]
[equilibrate]
set = ["run.collisions_per_disk=1", "material[0].e_n=1.0"]
[ensemble]
seeds = 2
[output]
analyses = ["profiles"]
options = { profiles = { axis = "y", bins = 3, frames = "1:" } }
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> ifrdem.Study:
    """Three variants at two e_n, each seed from the end of its own elastic gas."""
    folder = tmp_path_factory.mktemp("variants")
    (folder / "gas.toml").write_text(CASE.replace("[[material]]", "[[material]]\nrho = 0.0", 1))
    (folder / "other.toml").write_text(CASE.replace("speed_rms = 1.4", "speed_rms = 2.8"))
    (folder / "study.toml").write_text(STUDY)
    found = ifrdem.Study(folder / "study.toml", output=folder / "s")
    assert found.run(workers=0) == {}
    return found


@pytest.mark.full
def test_variants_are_an_axis_with_keys_set_and_removed_and_with_other_cases(study):
    found = study.results()
    assert found.values("variant").tolist() == ["rough", "smooth", "other"]
    T, T_rot = found.values("temperature"), found.values("rotational_temperature")
    assert T.shape[:3] == (3, 2, 2)
    assert T[2, ..., 0] == pytest.approx(4.0 * T[0, ..., 0], rel=1e-3)  # twice the speed
    assert np.all(T_rot[1] == 0.0)
    assert np.all(T_rot[0] > 0.0)
    given = ["rho" in case.material[0].model_fields_set for case in study._checked_cases[0].values()]
    assert given == [True, True, False, False, False, False]
    (left, right) = draw(found, "T").axes[:2]
    assert [line.get_label() for line in left.lines if not str(line.get_label()).startswith("_")][:3] == [
        "rough", "smooth", "other",
    ]  # fmt: skip
    assert right.get_title() == "$e_n$ = 0.9"
    with pytest.raises(InputError, match="as_map: requires two swept keys; there are: variant, e_n"):
        draw(found, "T", "tau", as_map=True)


@pytest.mark.full
def test_runs_begin_with_the_last_frame_of_their_own_equilibration(study):
    """Two values of e_n share the elastic gas of a seed, whose energy is that of the start."""
    found = study.results()
    assert len(study.equilibrations) == 3 * 2  # variants and seeds
    T = found.values("temperature")[..., 0]
    assert np.array_equal(T[:, 0], T[:, 1])  # of both e_n
    assert not np.any(T[:, :, 0] == T[:, :, 1])  # of both seeds
    first = study.equilibrations[0]
    with ifrdem.Trajectory(first.result.with_suffix(".h5")) as run:
        assert T[0, 0, 0] == pytest.approx(run.observables["temperature"][-1], rel=1e-6)
        # The random numbers of the first run are others, so that forces do not repeat theirs.
        assert run.parameters["seed"] == 3 + 1_000_003
    # Theory begins with the energies that are measured: here T and T_rot differ from the start of the case.
    assert found.values("temperature_theory")[0, 0, 0] == pytest.approx(T[0, 0].mean(), rel=1e-6)
    stamps = [task.result.stat().st_mtime_ns for task in (*study.equilibrations, *study.tasks)]
    assert ifrdem.Study(study.output.with_name("study.toml"), output=study.output).run(workers=0) == {}
    assert stamps == [task.result.stat().st_mtime_ns for task in (*study.equilibrations, *study.tasks)]


@pytest.mark.full
def test_options_of_analyses_reach_them(study):
    assert study.results().values("profiles_bins").tolist() == [[[3.0, 3.0]] * 2] * 3
    name = next(name for name in study.results().variables if name.startswith("profiles_y"))
    assert study.results().variables[name].dims[-1] == "profiles_row"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"smooth"', '"rough"', r'variants: two are called "rough"'),
        ('case = "other.toml"', 'set = ["run.nothing=1"]', "variant = other.*nothing"),
        ('case = "other.toml"', 'set = ["run.collisions_per_disk=3"]', "same end, rows and names of species"),
        ("bins = 3", "bins = 0", r"profiles\.bins.* 0: must be"),
        ("[0].rho", "[0].roh", r"variants: smooth: remove: material\[0\]\.roh: there is no such key in the case \(did you mean 'rho'\?\)"),
        ("[ensemble]", 'remove = ["material[0].rho", "material[0].roh"]\n[ensemble]', r"equilibrate: remove: material\[0\]\.roh: there is no such key in the case \(did you mean 'rho'\?\)"),
        ('"material[0].e_n" = [0.7', 'variant = [1, 2]\n"material[0].e_n" = [0.7', "variant: is no key of a case that can be swept"),
        ("bins = 3", "bin = 3", r"profiles\.bin: no option of profiles \(did you mean 'bins'\?\)"),
        ('"1:"', '"one"', r"profiles\.frames = one: must be a number or a:b:c"),
        ("{ profiles =", "{ velocity =", "velocity: must be among the analyses"),
        ("[ensemble]", 'along = ["material[0].e_m"]\n[ensemble]', r"equilibrate\.along: material\[0\]\.e_m: must be a swept key"),
        ('"material[0].e_n" = [0.7', '"species[0].number" = [50, 60]\n"material[0].e_n" = [0.7', "name the swept keys that change them in along"),
    ],
)  # fmt: skip
def test_mistakes_in_variants_are_said_before_anything_starts(study, tmp_path, old, new, message):
    for name in ("gas.toml", "other.toml"):
        (tmp_path / name).write_text(study.output.with_name(name).read_text())
    assert old in STUDY
    (tmp_path / "study.toml").write_text(STUDY.replace(old, new))
    with pytest.raises(InputError, match=message):
        ifrdem.Study(tmp_path / "study.toml", output=tmp_path / "s").check()


def swept(values: np.ndarray) -> Results:
    """Results of a number over two swept keys."""
    variables = {
        "e_n": Variable(("e_n",), np.array([0.7, 0.8, 0.9])), "mu": Variable(("mu",), np.array([0.01, 0.1, 1.0, 10.0])),
        "seed": Variable(("seed",), np.array([1])), "time": Variable(("time",), np.arange(2.0)),
        "x": Variable(("e_n", "mu", "seed"), values[..., None]), "x_mean": Variable(("e_n", "mu"), values),
        "x_error": Variable(("e_n", "mu"), np.full(values.shape, np.nan)),
    }  # fmt: skip
    return Results(
        variables,
        {
            "axes": '{"e_n": ["e_n"], "mu": ["mu"]}',
            "keys": '{"e_n": "material[0].e_n", "mu": "material[0].mu"}',
        },
    )


def test_a_map_has_each_value_at_its_place():
    values = np.arange(12.0).reshape(3, 4)
    for over, by, expected in (("e_n", "mu", values.T), ("mu", "e_n", values), (None, None, values.T)):
        axes = draw(swept(values), "x", over, by, as_map=True).axes[0]
        (mesh,) = axes.collections
        assert np.array_equal(np.ma.asarray(mesh.get_array()).reshape(expected.shape), expected)
    assert axes.get_yscale() == "log"


def test_chi_square_of_few_seeds_has_its_distribution():
    """Of Gaussian means with estimated errors p is uniform; that of the sum of t^2 of 3 seeds is below 0.05 in 70 %."""
    rng, found = np.random.default_rng(1), []
    for _ in range(300):
        x = rng.normal(size=(7, 3))
        lines = [
            PointMean("x", (), float(one.mean()), float(one.std(ddof=1) / 3**0.5), 0.0, 3, np.nan, 0.0, "")
            for one in x
        ]
        text = list(_against_theory(lines))[1]
        assert "of 7 points" in text
        found.append(float(text.rpartition("p = ")[2]))
    assert kstest(found, "uniform").pvalue > 0.01


@pytest.mark.full
def test_a_study_is_printed_as_a_table_for_programs(study, capsys):
    capsys.readouterr()
    assert cli.main(["info", str(study.output), "T", "profiles_bins", "--csv"]) == 0
    head, *rows = [line.split(",") for line in capsys.readouterr().out.splitlines()]
    assert head[:4] == ["quantity", "variant", "e_n", "mean"]
    assert len(rows) == 2 * 6
    means = study.results().values("temperature_mean")[..., -1].ravel()
    assert [float(row[3]) for row in rows[:6]] == pytest.approx(means, rel=1e-15)
    assert cli.main(["info", str(study.output), "temprature"]) == 2
    assert "did you mean 'temperature'" in capsys.readouterr().err


def test_results_first_and_what_is_zero_apart(study):
    """The table began with energies and with walls that the gas does not have."""
    lines = describe(Path(study.output)).splitlines()
    names = [line.split()[0] for line in lines if line.startswith("  ") and line.split()]
    assert (
        names.index("profiles_bins")
        < names.index("temperature")
        < names.index("energy")
        < names.index("collisions")
    )
    assert any(line.startswith("  0 in all runs: potential_energy") for line in lines)


def test_the_example_of_the_manual_is_in_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(block("variants study"))
    study = ifrdem.Study("study.toml")
    assert study.plan.shape == (2, 3, 2, 10)
    study.check()
    assert len(study.equilibrations) == 2 * 2 * 10


@pytest.mark.full
def test_a_study_is_exported_with_a_line_for_each_run(study, tmp_path, capsys):
    for to in ("csv", "parquet"):
        out = tmp_path / f"s.{to}"
        assert cli.main(["export", str(study.output), "--to", to, "-o", str(out)]) == 0
        found = pandas.read_csv(out) if to == "csv" else pandas.read_parquet(out)
        assert len(found) == 3 * 2 * 2
        assert found[["variant", "e_n", "seed"]].drop_duplicates().shape == (12, 3)
        T = study.results().values("temperature")[..., -1].ravel()
        assert np.array_equal(found["temperature"], T)
        assert "dissipated_by_mechanism sliding" in found
    capsys.readouterr()
    assert cli.main(["export", str(study.output), "--to", "gsd"]) == 2
    assert "--to gsd: the results of a study are exported to csv, parquet" in capsys.readouterr().err


def test_frames_of_an_analysis_replace_its_window(monkeypatch):
    """Of the options the frames go to the function in place of the steady window, and others by their names."""

    class Frames(SimpleNamespace):
        def __len__(self) -> int:
            return 6

    seen = {}

    def analysis(name: str) -> Callable[..., Evaluation]:
        def found(trajectory: Frames, frames: list[int], **options: object) -> Evaluation:
            seen[name] = (frames, options)
            return Evaluation(None, [], {}, [], (0.0, 1.0))

        return found

    options = {"profiles": {"frames": "2:4", "bins": 3}, "velocity": {"frames": "-1:"}}
    names = ("profiles", "velocity", "stress")
    task = Task("key", (0,), "", "", (), "", names, (), None, trajectory=False, weight=1.0, options=options)
    monkeypatch.setattr("ifrdem.analysis.window.has_window", lambda trajectory: False)
    monkeypatch.setattr("ifrdem.analysis.catalogue.FUNCTIONS", {name: analysis(name) for name in names})
    task._analysed(Frames(path=Path("run.h5")))
    assert seen == {"profiles": ([2, 3], {"bins": 3}), "velocity": ([5], {}), "stress": (None, {})}
