"""The shipped cases: listed, found by name, and valid."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ifrdem import Trajectory
from ifrdem.case import file as case_file
from ifrdem.case import notices, shipped, template
from ifrdem.case.gas import CaseGas
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.study.study import Study

CASES = Path(__file__).parents[2] / "cases"


def test_every_shipped_case_is_listed_with_its_title(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["cases"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = sorted(path.stem for path in CASES.glob("*.toml"))
    assert {"cooling", "mixture"} <= set(names)
    for name, line in zip(names, lines, strict=False):
        assert line.startswith(f"{name} ")
        assert 10 < len(line) < 120
    assert "A cooling gas of coins" in next(line for line in lines if line.startswith("cooling "))


@pytest.mark.parametrize("name", sorted(path.stem for path in CASES.glob("*.toml")))
def test_every_shipped_case_is_in_order_and_named_like_its_file(name: str) -> None:
    file = case_file.read(shipped.find(name))
    assert file.case.run.name == name
    assert f"#   ifrdem run {name} " in file.text
    assert notices.unlikely_units(file.gas) == []


@pytest.mark.parametrize("name", shipped.studies())
def test_every_shipped_study_is_in_order_and_named_in_its_comment(name: str, tmp_path: Path) -> None:
    study = Study(name, output=tmp_path / "found.nc")
    assert study.check() == []
    assert study.runs == len(study.tasks)
    text = shipped.new(f"studies/{name}.toml")
    assert f"#   ifrdem study {name}\n" in text
    assert "doi:10." in text
    assert 8 <= sum(bool(line) and not line.startswith("#") for line in text.splitlines()) <= 20
    assert name not in shipped.names()


def test_a_shipped_study_is_copied_and_is_no_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["run", "rough_cooling"]) == 2
    error = capsys.readouterr().err
    assert "rough_cooling: is a shipped study, not a case: `ifrdem study rough_cooling` runs it" in error
    assert cli.main(["new", "studies/rough_cooling.toml"]) == 0
    assert "run it with `ifrdem study rough_cooling.toml`" in capsys.readouterr().out
    assert (tmp_path / "rough_cooling.toml").read_bytes() == (
        CASES / "studies/rough_cooling.toml"
    ).read_bytes()
    assert cli.main(["study", "rough_colling", "--dry-run"]) == 2
    assert "no shipped case or study of this name (did you mean 'rough_cooling'?)" in capsys.readouterr().err
    assert cli.main(["cases"]) == 0
    shown = capsys.readouterr().out
    assert all(re.search(rf"^{each} +\w", shown, flags=re.MULTILINE) for each in shipped.studies())


def test_listing_imports_nothing_heavy() -> None:
    code = (
        "import sys; from ifrdem.cli import main as cli; cli.main(['cases']); "
        "print(sorted(m for m in ('taichi', 'quadrants', 'matplotlib', 'h5py', 'scipy') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_file_of_the_folder_comes_before_a_shipped_case_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert shipped.find("mixture").resolve() == CASES / "mixture.toml"
    (tmp_path / "mixture").touch()
    assert shipped.find("mixture") == Path("mixture")
    assert shipped.find("mixture.toml") == Path("mixture.toml")  # a path is never a shipped case


@pytest.mark.parametrize("verb", ["run", "check"])
def test_a_name_that_is_neither_file_nor_case_gets_the_nearest(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main([verb, "mixtrue"]) == 2
    error = capsys.readouterr().err
    assert "no shipped case of this name (did you mean 'mixture'?)" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("spelling", ["cases/mixture.toml", "cases/mixture"])
def test_new_copies_a_shipped_case(spelling: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", spelling]) == 0
    assert (tmp_path / "mixture.toml").read_bytes() == (CASES / "mixture.toml").read_bytes()
    assert cli.main(["new", spelling]) == 2  # it exists


def test_new_prefers_the_template_where_both_have_a_name() -> None:
    assert shipped.new("cooling") == template.write("cooling")
    assert shipped.new("cases/cooling.toml") == (CASES / "cooling.toml").read_text(encoding="utf-8")
    with pytest.raises(
        InputError, match=r"'cases/coolin'.*did you mean.*templates: cooling, .*cases/cooling\.toml"
    ):
        shipped.new("cases/coolin")


@pytest.mark.full
def test_the_mixture_behaves_as_its_comment_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Smaller and shorter: the largest disks keep the higher temperature, in the number of disks' 10 % errors."""
    monkeypatch.chdir(tmp_path)
    changes = ["species[0].number=2000", "output.frames=1"]
    words = [word for change in changes for word in ("--set", change)]
    assert cli.main(["run", "mixture", "--no-picture", *words]) == 0
    trajectory = Trajectory("mixture.h5")
    order = np.argsort(trajectory.disks.radius)

    def ratio(frame: int) -> float:
        energy = trajectory.disks.mass * np.sum(trajectory[frame].velocity ** 2, axis=1)
        return float(energy[order[-200:]].mean() / energy[order[:200]].mean())

    assert ratio(0) == pytest.approx(1.0, abs=0.3)  # 200 disks each: standard error sqrt(2/200) = 0.1
    assert ratio(-1) > 1.4
    gas = CaseGas.from_case(case_file.read(CASES / "mixture.toml").case)
    assert gas.box.packing_fraction(gas.disks.radius) == pytest.approx(0.4, rel=1e-13)
    assert gas.disks.radius.max() / gas.disks.radius.min() < 8.0  # 40 mm over 5 mm


@pytest.mark.full
def test_large_disks_rise_or_sink_by_their_mass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a quarter of the time; the whole run has 24.6, 12.9 and 7.6 (its comment)."""
    monkeypatch.chdir(tmp_path)
    words = [word for change in ("run.t_end=120.0", "output.frames=20") for word in ("--set", change)]
    assert cli.main(["run", "brazil_nut", "--no-picture", *words]) == 0
    with Trajectory("brazil_nut.h5") as run:
        height = np.mean([frame.position[:, 1] for frame in run[15:]], axis=0)
    small, light, heavy = (
        float(height[part].mean()) for part in (slice(300), slice(300, 312), slice(312, None))
    )
    assert heavy + 3.0 < small < light - 1.5  # 12 disks that move some 3 up and down: standard error 1
