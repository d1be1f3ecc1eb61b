"""Open boxes and tables in case files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ifrdem.case import file as case_file
from ifrdem.case import starts
from ifrdem.case.case import TableFrictionForce
from ifrdem.case.gas import CaseGas
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.plots import run
from ifrdem.trajectory.reader import Trajectory

CASE = Path(__file__).parents[2] / "cases" / "coins_on_table.toml"
SMALL = ["species[0].number=60", "output.frames=6", "force[0].step=0.01", "run.t_end=1.5"]


def changed(*changes: str) -> list[str]:
    return [word for change in changes for word in ("--set", change)]


@pytest.mark.full
def test_coins_on_a_table_come_to_rest_and_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    drawn: dict[str, Any] = {}
    monkeypatch.setattr(run, "save", lambda figure, path: drawn.setdefault("figure", figure))
    assert cli.main(["run", str(CASE), *changed(*SMALL)]) == 0
    assert "forces put in -" in capsys.readouterr().out
    with Trajectory("coins_on_table.h5") as trajectory:
        assert trajectory.box.is_open
        first, last = trajectory[0], trajectory[-1]
        assert not last.velocity.any()
        assert not last.spin.any()
        # What was there, the table and collisions have taken: f4 does not matter to observables.
        taken = trajectory.observables["dissipated_energy"][-1] - trajectory.observables["energy_input"][-1]
        assert taken == pytest.approx(trajectory.observables["energy"][0], rel=1e-12)
        assert np.ptp(last.position) > np.ptp(first.position)
        run.driven("coins_on_table.h5", "other.png")  # every picture can draw an open box
    energies, moving, paths, *_ = drawn["figure"].axes
    assert energies.get_yscale() == "log"
    assert moving.lines[0].get_ydata()[0] == 60
    assert moving.lines[0].get_ydata()[-1] == 0
    assert len(paths.collections[0].get_paths()) == 60


def test_keys_of_table_friction_make_the_force() -> None:
    case = case_file.read(CASE, ["force[0].gravity=1.62"]).case
    (force,) = (each.made() for each in case.force)
    assert force.deceleration == 0.2 * 1.62
    assert TableFrictionForce.model_fields["mu"].is_required()
    (earth,) = (each.made() for each in case_file.read(CASE).case.force)
    assert earth.deceleration == 0.2 * 9.81


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["force[0].mu="], r"force\[0\]\.mu: missing"),
        (["force[0].rate=1.0"], r"force\[0\]\.rate = 1\.0: requires kind = 'poisson_kicks', .* or 'drag'"),
        (["run.units=reduced"], r"force\[0\]\.gravity: missing: 9\.81 m/s\^2 is meant in SI units only"),
        (
            ["box.packing_fraction="],
            r'box\.open = true: disks that start at "random" places need a rectangle',
        ),
        (["box.packing_fraction=", "box.aspect=2.0"], r"aspect requires packing_fraction"),
        (["box.open=yes"], r'box\.open = "yes": must be a boolean'),
        (["box.packing_fraction=0.7"], r"too dense for a random start"),
    ],
)
def test_what_cannot_be_is_refused_by_key(changes: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        case_file.read(CASE, changes)


def test_an_open_box_starts_from_a_file_with_any_places(tmp_path: Path) -> None:
    (tmp_path / "start.csv").write_text("x,y,vx,vy,spin\n-3.0,-1e3,1.0,0.0,0.0\n-2.9,-1e3,0.0,0.0,1.0\n")
    changes = ["species[0].number=2", "box.packing_fraction=", "start.positions=", "start.file=start.csv"]
    path = tmp_path / "two.toml"
    text = CASE.read_text().replace("speed_rms = 1.0", "k = 2.0")
    path.write_text(text)
    file = case_file.read(path, changes)
    gas = CaseGas.from_case(file.case, file.folder)
    assert gas.box.is_open
    np.testing.assert_array_equal(starts.start(gas).position[:, 0], [-3.0, -2.9])
    (tmp_path / "start.csv").write_text("x,y\n0.0,0.0\n0.01,0.0\n")
    with pytest.raises(InputError, match="disks 0 and 1 overlap"):
        case_file.read(path, changes)


def test_check_names_the_region_where_an_open_gas_starts(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", str(CASE)]) == 0
    shown = capsys.readouterr().out
    assert "400 disks in an open box, SI units" in shown
    assert re.search(r"packing fraction there +0\.4\n", shown)
    assert re.search(r"table_friction \(mu = 0\.2\)\n.*force 0: step +0\.001 +s\n", shown)
    assert "mean free path" not in shown
