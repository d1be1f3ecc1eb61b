"""`check` and the first step of `run` agree; 2,000 cases in `ifrdem validate gas_cases`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from support.cases import case_text
from support.drawn import examples, random_cases

from ifrdem.cli.main import main
from ifrdem.simulation import backend
from ifrdem.validation.gas import cases

CASE = case_text({"run.name": "case", "run.t_end": 2.0, "material[0].e_t": -1.0, "species[0].number": 10})
UNDER_GRAVITY = {
    "box": {"lengths": [10.0, 10.0], "periodic": [True, False], "material": "coin", "gravity": [0.0, -1.0]},
}  # fmt: skip
Drawn = tuple[dict[str, Any], str | None]


@pytest.mark.full
def test_what_check_accepts_runs(tmp_path: Path) -> None:
    """Of features whose kernels other tests need too."""
    answers = []

    @given(random_cases(("plain", "mixed", "still")))
    @examples(18)
    def agree(drawn: Drawn) -> None:
        answer, fault = cases.disagreement(*drawn, tmp_path)
        answers.append(answer)
        assert fault is None

    agree()
    assert answers.count("accepted") > len(answers) / 3


@pytest.mark.full
@given(random_cases())
@examples(40)
def test_no_drawn_case_ends_check_with_a_traceback(tmp_path: Path, drawn: Drawn) -> None:
    case, file = drawn
    path = tmp_path / "case.toml"
    path.write_text(cases.text_of(case), encoding="utf-8")
    if file is not None:
        (tmp_path / "start.csv").write_text(file, encoding="utf-8")
    assert main(["check", str(path)]) in (0, 2)


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
    change: str, text: str, toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["check", str(toml)], ["run", str(toml), "-o", f"{toml.parent}/"]):
        assert main([*words, "--set", change]) == 2
        assert re.search(text, capsys.readouterr().err)
    assert not toml.with_suffix(".h5").exists()


def test_check_reports_what_run_would_refuse_on_this_machine(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    many = f"run.threads={backend.cores() + 1}"
    assert main(["check", str(toml), "--set", many]) == 0
    message = capsys.readouterr().err
    assert f"threads = {backend.cores() + 1}: must" in message
    assert "`ifrdem run` would refuse it here" in message
    assert main(["run", str(toml), "-o", f"{toml.parent}/", "--set", many]) == 2
    assert f"threads = {backend.cores() + 1}: must" in capsys.readouterr().err


def test_no_rebound_with_a_cut_off_is_refused_under_gravity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "case.toml"
    cutoff = {"run.collapse": "velocity_cutoff", "run.velocity_cutoff": 0.01}
    smooth = {"material[0].e_n": 0.0, "material[0].mu": 0.0}
    path.write_text(case_text(UNDER_GRAVITY | cutoff | smooth, text=CASE), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert 'run.collapse = "velocity_cutoff": disks that hit bottom with e_n = 0' in capsys.readouterr().err
    assert main(["check", str(path), "--set", "material[0].e_n=0.5"]) == 0


@pytest.mark.parametrize(("y", "vy", "status"), [(0.5, 0.0, 2), (0.5, 1.0, 0), (0.6, 0.0, 0), (9.5, 0.0, 0)])
def test_a_disk_that_lies_on_the_floor_is_refused_unless_it_may_rest(
    y: float, vy: float, status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Radius 0.5: it touches the floor at y = 0.5, where gravity holds it, and the ceiling at 9.5, which it leaves."""
    path = tmp_path / "case.toml"
    two = {"species[0].number": 2, "species[0].speed_rms": None, "start.file": "start.csv"}
    path.write_text(case_text(UNDER_GRAVITY | two, text=CASE), encoding="utf-8")
    (tmp_path / "start.csv").write_text(f"x,y,vx,vy,spin\n2,5,1,0,0\n5,{y},0,{vy},0\n", encoding="utf-8")
    assert main(["check", str(path)]) == status
    if status == 2:
        assert "disk 1 lies on bottom without speed" in capsys.readouterr().err
        rest = ["--set", "run.collapse=rest", "--set", "run.resting_speed=0.01"]
        assert main(["check", str(path), *rest]) == 0
