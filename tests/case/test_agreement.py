"""`check` and the first step of `run` agree; 2,000 cases in `ifrdem validate gas_cases`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from ifrdem.cli.main import main
from ifrdem.simulation import backend
from ifrdem.validation.gas import cases


def test_what_check_accepts_runs(tmp_path: Path) -> None:
    """Of features whose kernels other tests need too."""
    answers = []
    for number in range(18):
        dice = cases.Dice(f"sample {number}")
        case, file = cases.random_case(dice, ("plain", "mixed", "still")[number % 3])
        answer, fault = cases.disagreement(case, file, tmp_path)
        assert fault is None, f"{fault}\n{cases.text_of(case)}"
        answers.append(answer)
    assert answers.count("accepted") > 6


def test_no_drawn_case_ends_check_with_a_traceback(tmp_path: Path) -> None:
    for _, case, file in cases.cases(0, 40, 7):
        path = tmp_path / "case.toml"
        path.write_text(cases.text_of(case), encoding="utf-8")
        if file is not None:
            (tmp_path / "start.csv").write_text(file, encoding="utf-8")
        assert main(["check", str(path)]) in (0, 2)


BASE: dict[str, Any] = {
    "run": {"name": "case", "units": "reduced", "t_end": 2.0},
    "box": {"packing_fraction": 0.2},
    "material": [{"name": "a", "e_n": 0.9, "e_t": -1.0, "mu": 0.1}],
    "species": [
        {"name": "s", "number": 10, "material": "a", "mass": 1.0, "radius": 0.5, "speed_rms": 1.0},
    ],
}


@pytest.mark.parametrize(
    ("change", "text"),
    [
        # 1e-30 of the box, 10 disks of radius 0.5: a side of 2.8e15, in which doubles are 0.5 apart.
        ("box.packing_fraction=1e-30", "box.packing_fraction = 1e-30: .* resolves positions to"),
        # A flow by which the image above has come 2e31 times its size.
        ("box.shear_rate=1e30", "run.t_end = 2: images across a sheared box move by"),
    ],
)
def test_what_no_run_could_compute_is_refused(
    change: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "case.toml"
    path.write_text(cases.text_of(BASE), encoding="utf-8")
    for words in (["check", str(path)], ["run", str(path), "-o", f"{tmp_path}/"]):
        assert main([*words, "--set", change]) == 2
        assert re.search(text, capsys.readouterr().err)
    assert not (tmp_path / "case.h5").exists()


def test_check_reports_what_run_would_refuse_on_this_machine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "case.toml"
    path.write_text(cases.text_of(BASE), encoding="utf-8")
    many = f"run.threads={backend.cores() + 1}"
    assert main(["check", str(path), "--set", many]) == 0
    message = capsys.readouterr().err
    assert f"threads = {backend.cores() + 1}: must" in message
    assert "`ifrdem run` would refuse it here" in message
    assert main(["run", str(path), "-o", f"{tmp_path}/", "--set", many]) == 2
    assert f"threads = {backend.cores() + 1}: must" in capsys.readouterr().err


def test_no_rebound_with_a_cut_off_is_refused_under_gravity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "case.toml"
    box = {"lengths": [10.0, 10.0], "periodic": [True, False], "material": "a", "gravity": [0.0, -1.0]}
    law = {"name": "a", "e_n": 0.0, "e_t": -1.0, "mu": 0.0}
    run = BASE["run"] | {"collapse": "velocity_cutoff", "velocity_cutoff": 0.01}
    path.write_text(cases.text_of(BASE | {"run": run, "box": box, "material": [law]}), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert 'run.collapse = "velocity_cutoff": disks that hit bottom with e_n = 0' in capsys.readouterr().err
    assert main(["check", str(path), "--set", "material[0].e_n=0.5"]) == 0


@pytest.mark.parametrize(("y", "vy", "status"), [(0.5, 0.0, 2), (0.5, 1.0, 0), (0.6, 0.0, 0), (9.5, 0.0, 0)])
def test_a_disk_that_lies_on_the_floor_is_refused_unless_it_may_rest(
    y: float, vy: float, status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Radius 0.5: it touches the floor at y = 0.5, where gravity holds it, and the ceiling at 9.5, which it leaves."""
    path = tmp_path / "case.toml"
    box = {"lengths": [10.0, 10.0], "periodic": [True, False], "material": "a", "gravity": [0.0, -1.0]}
    species = [BASE["species"][0] | {"number": 2}]
    del species[0]["speed_rms"]
    file = {"file": "start.csv"}
    path.write_text(cases.text_of(BASE | {"box": box, "species": species, "start": file}), encoding="utf-8")
    (tmp_path / "start.csv").write_text(f"x,y,vx,vy,spin\n2,5,1,0,0\n5,{y},0,{vy},0\n", encoding="utf-8")
    assert main(["check", str(path)]) == status
    if status == 2:
        assert "disk 1 lies on bottom without speed" in capsys.readouterr().err
        rest = ["--set", "run.collapse=rest", "--set", "run.resting_speed=0.01"]
        assert main(["check", str(path), *rest]) == 0
