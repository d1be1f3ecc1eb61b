"""The pressure tensor in the time series of a run: values, resumed runs, messages, analysis and picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.analysis.catalogue import FUNCTIONS
from ifrdem.case import file as case_file
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.plots import pictures

CASE = """
run = { name = "flow", t_end = 4.0, units = "reduced", seed = 4 }
box = { packing_fraction = 0.2, shear_rate = 0.5 }
material = [{ name = "m", e_n = 0.9, e_t = -0.5, mu = 0.2 }]
species = [{ name = "d", material = "m", mass = 1.0, diameter = 0.5, number = 150, speed_rms = 1.0 }]
output = { frames = 4, series = 8, stress = true, picture = false, views = false, precision = "f64" }
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flow.toml").write_text(CASE)
    return tmp_path


@pytest.mark.full
def test_rows_are_means_since_the_row_before(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Against the measures of the same gas at the same times, in the box of 150 pi / 16 / 0.2."""
    assert main(["run", "flow.toml"]) == 0
    gas = case_file.read(Path("flow.toml"), []).gas.simulation()
    rows = []
    gas.run(t_end=4.0, series=8, series_callbacks=[rows.append])
    area = 150 * np.pi / 16.0 / 0.2
    with ifrdem.Trajectory("flow.h5") as file:
        series = file.series
        assert series.columns("stress") == series.columns("stress_kinetic") == ("xx", "xy", "yx", "yy")
        assert np.isnan(series["stress"][0]).all()
        for i in range(1, 9):
            before, after = rows[i - 1], rows[i]
            kinetic = 0.5 * (before.momentum_flux + after.momentum_flux) / area
            whole = kinetic + (after.virial - before.virial) / (0.5 * area)
            np.testing.assert_allclose(series["stress_kinetic"][i], kinetic.ravel(), rtol=1e-12)
            np.testing.assert_allclose(series["stress"][i], whole.ravel(), rtol=1e-12)
        np.testing.assert_array_equal(series["stress/xy"], series["stress"][:, 1])
        assert "stress_xy" in file.to_pandas("series")
        assert file.to_xarray().series_stress.sel(component="yy")[3] == series["stress/yy"][3]
        pictures.figure(file, "stress").draw_without_rendering()
    capsys.readouterr()
    assert main(["analyse", "flow.h5", "stress", "--from", "0"]) == 0
    assert "friction -P_xy / P_yy" in capsys.readouterr().out
    found = json.loads(Path("flow-analysis/flow.json").read_text())["analyses"]["stress"]["values"]
    mean = (rows[-1].virial - rows[0].virial) / (4.0 * area)
    for name, (a, b) in {"P_xy": (0, 1), "P_yy": (1, 1)}.items():
        part = found[name]["value"] - found[f"{name}_kinetic"]["value"]
        assert part == pytest.approx(mean[a, b], rel=1e-12)


@pytest.mark.full
def test_a_run_that_is_resumed_has_the_same_rows(folder: Path) -> None:
    from ifrdem.runs import resume

    assert main(["run", "flow.toml"]) == 0
    with ifrdem.Trajectory("flow.h5") as file:
        whole = file.series["stress"]
    assert main(["run", "flow.toml", "--force", "--max-hours", "1e-9"]) == 3
    with ifrdem.Trajectory("flow.h5") as file:
        assert len(file.series["stress"]) < 9
    resume.resume("flow.h5", log=lambda _: None)
    with ifrdem.Trajectory("flow.h5") as file:
        np.testing.assert_array_equal(file.series["stress"], whole)


@pytest.mark.full
def test_between_walls_stresses_refer_to_the_free_area(folder: Path) -> None:
    """A container of radius 4 in a box of 9 x 9: the trace of the kinetic part is the energy over 16 pi."""
    walls = CASE.replace("packing_fraction = 0.2, shear_rate = 0.5", "lengths = [9.0, 9.0], periodic = [false, false], "
                         'material = "m"').replace("number = 150", "number = 50")  # fmt: skip
    walls += '[[wall]]\nshape = "container"\nmaterial = "m"\ncenter = [4.5, 4.5]\nradius = 4.0\n'
    Path("walls.toml").write_text(walls)
    assert main(["run", "walls.toml"]) == 0
    with ifrdem.Trajectory("flow.h5") as file:
        energy = file.series["translational_energy"]
        trace = file.series["stress_kinetic"][:, [0, 3]].sum(axis=1)
        np.testing.assert_allclose(trace[1:], (energy[1:] + energy[:-1]) / (16.0 * np.pi), rtol=1e-9)
    with (
        ifrdem.Trajectory("flow.h5") as file,
        pytest.raises(InputError, match="`analyse stress` gives the pressure"),
    ):
        FUNCTIONS["pressure"](file, None)


@pytest.mark.full
def test_a_study_has_stresses(folder: Path) -> None:
    """A study over e_n, in the columns of the tensor; the first row has none."""
    keys = (
        'case = "flow.toml"',
        "[ensemble]",
        "seeds = 2",
        "[output]",
        "series = 4",
        'analyses = ["stress"]',
    )
    Path("study.toml").write_text("\n".join(keys))
    study = ifrdem.Study("study.toml", vary=["material[0].e_n=0.7,0.9"], output="s")
    assert study.run(workers=0) == {}
    found = study.dataset()
    assert found["stress"].dims == ("e_n", "seed", "time", "component")
    value = found["stress"].values
    assert np.isnan(value[:, :, 0]).all()
    assert (value[:, :, 1:, [0, 3]] > 0.0).all()
    assert found.component.values.tolist() == ["xx", "xy", "yx", "yy"]
    assert found["stress_friction"].dims == ("e_n", "seed")


def test_an_open_box_has_no_stress(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = CASE.replace("packing_fraction = 0.2, shear_rate = 0.5", "open = true, packing_fraction = 0.2")
    Path("flow.toml").write_text(text)
    assert main(["check", "flow.toml"]) == 2
    assert "output.stress = true: cannot be combined with box.open = true" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("keys", "other"),
    [
        (["wall[0].piston={mass=4.0, force=-1.0}"], "wall[0].piston"),
        (["run.collapse=rest", "run.resting_speed=0.1", "box.gravity=[0.0, -1.0]"], 'run.collapse = "rest"'),
    ],
)
def test_gases_without_a_stress_are_refused(
    folder: Path, keys: list[str], other: str, capsys: pytest.CaptureFixture[str]
) -> None:
    sides = 'lengths = [9.0, 9.0], periodic = [true, false], material = "m"'
    text = CASE.replace("packing_fraction = 0.2, shear_rate = 0.5", sides).replace(
        "number = 150", "number = 50"
    )
    text += '[[wall]]\nshape = "line"\nmaterial = "m"\npoint = [0.0, 8.0]\nnormal = [0.0, -1.0]\n'
    Path("flow.toml").write_text(text)
    assert main(["check", "flow.toml", *(word for key in keys for word in ("--set", key))]) == 2
    assert f"output.stress = true: cannot be combined with {other}" in capsys.readouterr().err


@pytest.mark.full
def test_a_file_without_stresses_says_how_to_get_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "flow.toml", "--set", "output.stress=false"]) == 0
    assert main(["analyse", "flow.h5", "stress"]) == 2
    assert "output.stress = true" in capsys.readouterr().err
    assert main(["analyse", "flow.h5", "pressure"]) == 0
    assert "`analyse stress` gives the pressure tensor of a sheared gas" in capsys.readouterr().out
