"""Sums of walls in the time series of a run: those of the simulation, under the names of the walls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.case import file as case_file
from ifrdem.cli.main import main
from ifrdem.model.walls.wall import SUMS
from ifrdem.viewer.content import Content

CASE = """
run = { name = "stirred", t_end = 3.0, units = "reduced", seed = 4 }
box = { lengths = [12.0, 9.0], periodic = [false, false], material = "m" }
material = [{ name = "m", e_n = 0.9, e_t = -0.5, mu = 0.2 }]
species = [{ name = "d", material = "m", mass = 1.0, diameter = 0.5, number = 40, speed_rms = 1.0 }]
output = { frames = 3, series = 6, wall_sums = true, picture = false, views = false, precision = "f64" }
[[wall]]
shape = "polyline"
material = "m"
points = [[5.0, 4.0], [6.0, 4.5], [7.0, 5.0]]
turn = { kind = "steady", center = [6.0, 4.5], rate = 1.5 }
group = "paddle"
[[wall]]
shape = "arc"
material = "m"
center = [2.5, 6.0]
radius = 1.0
angles = [0.0, 3.0]
opens_at = 1.0
"""


@pytest.mark.full
def test_sums_of_walls_are_columns_of_the_series(
    toml: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(toml)]) == 0
    assert (
        "energy balance: relative error" in capsys.readouterr().out
    )  # the ledger, with the work of the paddle
    run = case_file.read(toml, []).gas.simulation()
    run.run(t_end=3.0)
    expected = run.wall_sums.values
    with ifrdem.Trajectory("stirred.h5") as file:
        for name, column in zip(SUMS, expected.T, strict=True):
            found = file.series[f"walls_{name}"]
            assert found.shape == (7, 6)
            np.testing.assert_array_equal(found[-1], column)
            assert (found[0] == 0.0).all()
        hits = file.series["walls_hits"]
        assert hits[-1].sum() == run.wall_collisions
        assert (np.diff(hits[2:, 1]) == 0.0).all()  # rows at 0, 0.5, 1.0, ...: the arc is gone
        names = file.to_xarray().wall.values.tolist()
        assert names == ["paddle 0 polyline", "wall 1 arc", "left", "right", "bottom", "top"]
        content = Content(file)
        shown = [[wall["shape"] for wall in content.frame(i)[0]["walls"]] for i in (0, 3)]
        assert shown == [["polyline", "arc"], ["polyline"]]
        end = np.array(content.frame(3)[0]["walls"][0]["points"][-1])
        np.testing.assert_allclose(end, [6.0 + np.hypot(1.0, 0.5) * np.cos(4.5 + np.arctan(0.5)),
                                         4.5 + np.hypot(1.0, 0.5) * np.sin(4.5 + np.arctan(0.5))])  # fmt: skip


def test_sums_need_walls(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.toml"
    open_box = CASE[: CASE.index("[[wall]]")].replace(
        'periodic = [false, false], material = "m"', "periodic = [true, true]"
    )
    path.write_text(open_box)
    assert main(["check", str(path)]) == 2
    assert "output.wall_sums = true: cannot be combined with wall = []" in capsys.readouterr().err
