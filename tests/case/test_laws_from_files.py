"""Custom laws in case files, `law = "FILE.py:CLASS"`: runs, records, resumed runs, studies, ranks, messages."""

from __future__ import annotations

import copy
import hashlib
import json
import pickle
import re
import subprocess
import sys
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
from support import law_examples, mpi
from support.cases import case_text

import ifrdem
from ifrdem.cli import main as cli
from ifrdem.errors import InputError, Stopped
from ifrdem.model.laws import files as law_files
from ifrdem.runs import compare
from ifrdem.runs.signals import Stops
from ifrdem.tools.tables import TableFormat

LAW = '''
import ifrdem
from ifrdem import ti
from ifrdem.kernels.laws.law import ifr_impulses


class SpeedDependent(ifrdem.CollisionLaw):
    """e_n = 1 - c g_n^(1/5), as `support.law_examples.Viscoelastic`."""

    coefficients = ("c", "e_t", "mu")

    @staticmethod
    def collide(pair, law):
        e_n = ti.max(1.0 - law.c * pair.g_n**0.2, 0.0)
        P_n, P_t, T, _, _, _ = ifr_impulses(
            e_n, law.e_t, law.mu, 1.0, 0.0,
            pair.g_n, pair.g_t, pair.m_n, pair.m_t, pair.radius_i, pair.radius_j,
        )
        return P_n, P_t, T


class Gaining(ifrdem.CollisionLaw):
    """Smooth disks with e_n = gain."""

    coefficients = ("gain",)

    @staticmethod
    def collide(pair, law):
        return (1.0 + law.gain) * pair.m_n * pair.g_n, 0.0, 0.0


class Named(Gaining):
    coefficients = ("name",)
'''
CASE = case_text({
    "run.collisions_per_disk": 4.0, "run.seed": 2, "run.t_end": None, "material[0].name": "a",
    "material[0].law": "laws/mylaw.py:SpeedDependent", "material[0].c": 0.1, "material[0].e_t": -0.9,
    "material[0].e_n": None, "species[0].name": "a", "species[0].number": 100, "species[0].material": "a",
    "output": {"frames": 4, "series": 8, "histories_all": True, "picture": False, "views": False},
})  # fmt: skip
GAINING = ['material[0].law="laws/mylaw.py:Gaining"', "material[0].c=", "material[0].e_t=", "material[0].mu="]
VALUES = {"c": 0.1, "e_t": -0.9, "mu": 0.2}


@pytest.fixture(autouse=True)
def law_file(tmp_path: Path) -> None:
    """Beside the case."""
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "mylaw.py").write_text(LAW, encoding="utf-8")


def file_of(toml: Path) -> Path:
    return toml.parent / "laws" / "mylaw.py"


def executed(toml: Path, *words: object) -> int:
    return cli.main([*map(str, words[:1]), str(toml), *map(str, words[1:])])


def sets(*assignments: str) -> list[str]:
    return [word for each in assignments for word in ("--set", each)]


@pytest.mark.full
def test_a_run_has_the_bits_of_the_same_law_from_python(toml: Path) -> None:
    out = toml.with_name("gas.h5")
    assert executed(toml, "run", "-o", out) == 0
    gas = ifrdem.Case.read(toml).simulation()
    same = ifrdem.Simulation(
        gas.disks, gas.box, law_examples.Viscoelastic(**VALUES), gas.state, record=["ledger"], seed=2
    )
    same.run(collisions_per_disk=4.0)
    with ifrdem.Trajectory(out, run_law_files=True) as trajectory:
        assert trajectory.laws[0][0].table_row() == (0.1, -0.9, 0.2)
        assert trajectory.has_custom_laws
        (record,) = json.loads(trajectory.parameters["laws"])[0]
        assert trajectory.times[-1] == same.time
        assert trajectory.observables["energy"][-1] == same.measure().energy
        with pytest.raises(InputError, match="must be a law that says has_averages"):
            ifrdem.theory.prediction(gas.disks, trajectory.laws, 0.2, 1.0, 0.0, [1.0])
        one = ifrdem.DSMC(gas.disks, trajectory.laws, 0.2, gas.state.velocity, seed=1)
        assert one.run(collisions_per_disk=2.0, samples=1).temperature[-1] < 0.5
        assert sum(len(trajectory.history(i).time) for i in range(100)) == 2 * same.collisions
    assert record["sha256"] == hashlib.sha256(file_of(toml).read_bytes()).hexdigest()
    assert (record["law"], record["path"]) == ("mylaw.py:SpeedDependent", str(file_of(toml).resolve()))


@pytest.mark.full
def test_the_law_of_a_trajectory_is_refused_without_its_file(toml: Path) -> None:
    out, law = toml.with_name("gas.h5"), file_of(toml)
    assert executed(toml, "run", "-o", out, *sets("run.collisions_per_disk=1.0")) == 0
    with ifrdem.Trajectory(out, run_law_files=True) as trajectory:
        (found,) = trajectory.laws[0]
        law.rename(out.with_name("mylaw.py"))  # next to the trajectory
        assert trajectory.laws[0][0].table_row() == found.table_row()
        out.with_name("mylaw.py").write_text(LAW + "# changed\n", encoding="utf-8")
        with pytest.raises(
            InputError, match=r"gas\.h5: law mylaw\.py:SpeedDependent: .*has changed .*sha256"
        ):
            _ = trajectory.laws
        out.with_name("mylaw.py").unlink()
        with pytest.raises(InputError, match=r"mylaw\.py: must be the file of the run"):
            _ = trajectory.laws
    # Programs that come with a trajectory are executed only if the caller says so.
    out.with_name("mylaw.py").write_text(
        f"__import__('os').mkdir({str(out.with_name('executed'))!r})\n{LAW}", encoding="utf-8"
    )
    sha256 = hashlib.sha256(out.with_name("mylaw.py").read_bytes()).hexdigest()
    with h5py.File(out, "r+") as file:
        (records,) = json.loads(file["parameters/laws"][()])
        del file["parameters/laws"], file["parameters/case"]
        file["parameters/laws"] = json.dumps([[{**records[0], "sha256": sha256}]])
        text = toml.read_text(encoding="utf-8").replace("laws/mylaw.py", str(out.with_name("mylaw.py")))
        file["parameters/case"] = text
    with ifrdem.Trajectory(out) as trajectory, pytest.raises(InputError, match="run_law_files=True"):
        _ = trajectory.laws
    (measured := out.with_name("measured.csv")).write_text("id,time,x,y\n0,0.01,1,1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"law of the program .*mylaw\.py: case = FILE"):
        compare.compare(out, compare.read(measured, {}, TableFormat()), members=6)
    assert not out.with_name("executed").exists()
    assert cli.main(["info", str(out)]) == 0  # does not execute it
    assert cli.main(["plot", str(out), "temperatures", "-o", str(out.with_name("T.png"))]) == 0
    assert not out.with_name("executed").exists()
    with ifrdem.Trajectory(out, run_law_files=True) as trajectory:
        _ = trajectory.laws
    assert out.with_name("executed").exists()


def test_a_law_goes_to_other_processes_with_its_text(toml: Path) -> None:
    law = law_files.find("mylaw.py:SpeedDependent", file_of(toml).parent).kind(**VALUES)
    assert copy.deepcopy(law) == law
    toml.with_name("law.pickle").write_bytes(pickle.dumps(law))
    file_of(toml).unlink()
    code = "import pickle, sys; print(pickle.load(open(sys.argv[1], 'rb')))"
    words = [sys.executable, "-c", code, str(toml.with_name("law.pickle"))]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "SpeedDependent(c=0.1, e_t=-0.9, mu=0.2)"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["material[0].c="], "material[0].c: missing: must be a finite number; mylaw.py:SpeedDependent has the "),
        (["material[0].muu=0.1"], "material[0].muu = 0.1: unknown coefficient (did you mean 'mu'?); mylaw.py:"),
        (['material[0].mu="much"'], 'material[0].mu = "much": must be a finite number'),
        (['material[0].law="laws/mylaw.py:Speed"'], "no law 'Speed' in "),
        (['material[0].law="laws/my.py:Speed"'], 'law = "laws/my.py:Speed": there is no file '),
        (['material[0].law="laws/mylaw.py"'], "material[0].law = \"laws/mylaw.py\": must be one of 'ifr', 'walton',"),
        (
            ['material[0].law="laws/mylaw.py:Named"', "material[0].c=", "material[0].e_t=", "material[0].mu="],
            "name cannot be a coefficient: it is a key of [[material]]",
        ),
        (['pair=[{ materials = ["a", "b"] }]'], "pair[0].e_n: missing"),
    ],
    ids=["missing", "unknown", "text", "class", "file", "form", "name", "pair"],
)  # fmt: skip
def test_mistakes_name_key_value_and_what_is_there(
    toml: Path, settings: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert executed(toml, "check", *sets(*settings)) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import ifrdem\nx = 1 / 0\n", "mylaw.py, line 2: the file cannot be executed: ZeroDivisionError"),
        ("import ifrdem\nclass (:\n", "mylaw.py, line 2: the file cannot be executed: SyntaxError"),
        ("import no_such_module\n", "mylaw.py, line 1: the file cannot be executed: ModuleNotFoundError"),
        (
            "import ifrdem\nclass SpeedDependent(ifrdem.CollisionLaw):\n    coefficients = ('c',)\n",
            "mylaw.py: must have a static method collide(pair, law)",
        ),
    ],
    ids=["error", "syntax", "import", "empty"],
)
def test_errors_in_the_file_are_told_with_their_line(
    toml: Path, text: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file_of(toml).write_text(text, encoding="utf-8")
    assert executed(toml, "check") == 2
    assert message in capsys.readouterr().err


@pytest.mark.full
@pytest.mark.filterwarnings("always::ifrdem.EnergyWarning")
def test_a_law_that_adds_energy_is_reported_by_check_and_run(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # e_n = 1.1: a head-on collision of equal disks gains (1.1^2 - 1) of the energy of the relative motion.
    settings = sets(*GAINING, "material[0].gain=1.1")
    assert executed(toml, "check", *settings) == 0
    shown = capsys.readouterr()
    at = f'{toml}: material[0].law = "laws/mylaw.py:Gaining": '
    assert f"{at}law Gaining: of 4096 random collisions 4096 added energy, one of them" in shown.err
    assert "custom, tried on 4096 random pairs" in shown.out
    assert executed(toml, "run", "-o", toml.with_name("gas.h5"), *settings) == 0
    shown = capsys.readouterr()
    assert f"{at}law Gaining: of 4096 random collisions 4096 added energy" in shown.err
    assert "collisions have added energy" in shown.err
    with pytest.warns(ifrdem.EnergyWarning, match="law Gaining: of 4096"):
        ifrdem.Case.read(toml, set=[*GAINING, "material[0].gain=1.1"]).simulation()
    # P_n = 0.9 m_n g_n would let disks pass through each other: before any file is written.
    out = toml.with_name("weak.h5")
    for command in (["check"], ["run", "-o", out]):
        assert executed(toml, *command, *sets(*GAINING, "material[0].gain=-0.1")) == 2
        err = capsys.readouterr().err
        assert f"{at}law Gaining: " in err
        assert "go through each other" in err
    assert not out.exists()


PASSIVE = """
import ifrdem
import numpy as np


class Smooth(ifrdem.CollisionLaw):
    coefficients = ("e_n",)
    is_passive = True
    has_averages = True
    mu = 0.0

    @staticmethod
    def collide(pair, law):
        return (1.0 + law.e_n) * pair.m_n * pair.g_n, 0.0, 0.0

    def slip_coefficients(self, inverse_a):
        return np.zeros_like(inverse_a), inverse_a
"""
SMOOTH = sets(
    'material[0].law="laws/mylaw.py:Smooth"', "material[0].c=", "material[0].e_t=", "material[0].mu=", "run.t_end=3.0",
    "run.collisions_per_disk=",
)  # fmt: skip


@pytest.mark.full
def test_a_law_that_says_that_it_is_passive_is_checked_and_runs(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`is_passive` once led theory to take the law for one of the package: neither command ran.

    With its averages, the estimate of collisions is that of smooth disks (`law = "smooth"`), which theory gives.
    """
    file_of(toml).write_text(PASSIVE, encoding="utf-8")
    assert executed(toml, "check", *SMOOTH, *sets("material[0].e_n=0.9")) == 0
    shown = capsys.readouterr().out
    assert "custom, tried on 4096 random pairs" in shown
    out = toml.with_name("gas.h5")
    assert executed(toml, "run", "-o", out, *SMOOTH, *sets("material[0].e_n=0.9")) == 0
    assert executed(toml, "check", *SMOOTH, *sets("material[0].e_n=0.9", 'material[0].law="smooth"')) == 0
    known = capsys.readouterr().out
    (estimate,) = re.findall(r"to t = 3: .* collisions", shown)
    assert estimate in known
    # What is not true is refused: e_n = 1.1 adds energy.
    assert executed(toml, "check", *SMOOTH, *sets("material[0].e_n=1.1")) == 2
    assert "is_passive = True: must be False, because of 4096 random" in capsys.readouterr().err


def test_the_former_name_of_what_a_law_says_is_refused_with_the_present_ones(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file_of(toml).write_text(PASSIVE.replace("is_passive", "is_proved"), encoding="utf-8")
    assert executed(toml, "check", *SMOOTH, *sets("material[0].e_n=0.9")) == 2
    assert (
        "is_proved = True: must be replaced by those of is_passive, has_averages, has_ifr_symbols that hold"
        in (capsys.readouterr().err)
    )


def test_a_law_that_loses_energy_gives_no_warning(toml: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ifrdem.Case.read(toml).check().warnings == ()


@pytest.mark.full
def test_an_interrupted_run_resumes_with_the_same_file_only(
    toml: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, part = toml.with_name("whole.h5"), toml.with_name("part.h5")
    assert executed(toml, "run", "-o", whole) == 0
    with monkeypatch.context() as patch:
        counts: list[int] = []

        def check(self: Stops) -> None:
            counts.append(1)
            if len(counts) == 3:
                raise Stopped("stopped", 3)

        patch.setattr(Stops, "check", check)
        assert executed(toml, "run", "-o", part) == 3
    text = file_of(toml).read_text(encoding="utf-8")
    file_of(toml).write_text(text.replace("1.0 -", "1.0 - 0.1 *"), encoding="utf-8")
    for words in ([], ["--ignore-case-changes"]):
        assert cli.main(["resume", str(part), *words]) == 2
        error = capsys.readouterr().err
        assert "has changed" in error
        assert 'start.positions = "part.h5"' in error
        assert "must be the file of the run" in error
    file_of(toml).unlink()
    assert cli.main(["resume", str(part)]) == 2
    assert f"there is no file {file_of(toml).resolve()}" in capsys.readouterr().err
    file_of(toml).write_text(text, encoding="utf-8")
    assert cli.main(["resume", str(part)]) == 0
    with ifrdem.Trajectory(whole) as a, ifrdem.Trajectory(part) as b:
        for name in ("position", "velocity", "spin"):
            np.testing.assert_array_equal(getattr(a[-1], name), getattr(b[-1], name))


def test_a_checkpoint_of_python_holds_the_law_by_its_file(toml: Path) -> None:
    gas, path = ifrdem.Case.read(toml).simulation(), toml.with_name("gas.checkpoint.h5")
    gas.run(collisions_per_disk=1)
    gas.save_checkpoint(path)
    again = ifrdem.Simulation.from_checkpoint(path)
    for one in (gas, again):
        one.run(collisions_per_disk=2)
    np.testing.assert_array_equal(gas.state.velocity, again.state.velocity)
    file_of(toml).write_text(LAW + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"gas\.checkpoint\.h5: law mylaw\.py:SpeedDependent: .*has changed"):
        ifrdem.Simulation.from_checkpoint(path)


@pytest.mark.full
def test_a_study_sweeps_a_coefficient_and_knows_a_changed_file(toml: Path) -> None:
    def study() -> ifrdem.Study:
        return ifrdem.Study(
            toml,
            vary=["material[0].c=0.0,0.2"],
            seeds=1,
            set=["output.histories_all="],
            output=toml.with_name("s.nc"),
        )

    first = study()
    first.run(workers=0)
    T = first.results().variables["temperature"].values
    assert T.shape[:2] == (2, 1)
    assert T[1, 0, -1] < T[0, 0, -1]
    keys = {task.key for task in first.tasks}
    assert {task.key for task in study().tasks} == keys
    file_of(toml).write_text(LAW + "\n", encoding="utf-8")
    assert not {task.key for task in study().tasks} & keys


@pytest.mark.full
@mpi.needed
def test_two_ranks_have_the_law_of_the_root(toml: Path) -> None:
    alone, both = toml.with_name("alone.h5"), toml.with_name("both.h5")
    settings = sets("species[0].number=21000", "run.collisions_per_disk=0.5", "output.histories_all=")
    assert executed(toml, "run", "-o", alone, *settings) == 0
    done = mpi.on(2, *mpi.ifrdem("run", toml, "-o", both, *settings))
    assert done.returncode == 0, done.stderr
    with ifrdem.Trajectory(alone) as a, ifrdem.Trajectory(both) as b:
        assert int(b.parameters["ranks"]) == 2
        np.testing.assert_array_equal(a[-1].velocity, b[-1].velocity)


def test_run_stops_before_any_file_if_a_law_cannot_be_compiled(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file_of(toml).write_text(LAW.replace("law.mu", "law.mue"), encoding="utf-8")
    for command in (["check"], ["run", "-o", toml.with_name("gas.h5")]):
        assert executed(toml, *command) == 2
        error = capsys.readouterr().err
        assert "mylaw.py, line 16, in collide" in error
        assert "no 'mue' (did you mean 'mu'?)" in error
    assert not toml.with_name("gas.h5").exists()
