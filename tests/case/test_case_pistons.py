"""Pistons in case files: refusals, frames and series, a resumed run, and figures."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from support.cases import case_text

from ifrdem.cli.main import main
from ifrdem.errors import Stopped
from ifrdem.runs.signals import Stops
from ifrdem.trajectory.reader import Trajectory
from ifrdem.viewer.content import Content

CASE = case_text({
    "run.name": "lid", "run.t_end": 12.0, "box.lengths": [10.0, 20.0], "box.periodic": [True, False],
    "box.material": "coin", "box.gravity": [0.0, -0.1], "box.packing_fraction": None,
    "material[0].e_n": 0.95, "material[0].e_t": -0.6, "material[0].mu": 0.1, "species[0].number": 40,
    "species[0].speed_rms": 1.4,
    "wall": [
        {"shape": "line", "material": "coin", "point": [0.0, 12.0], "normal": [0.0, -1.0],
         "piston": {"mass": 10.0, "force": 2.0, "high": 6.0}},
    ],
    "output": {
        "frames": 9, "series": 30, "picture": False,
        "fields": ["position", "velocity", "angular_velocity", "collisions"],
    },
})  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("{ mass = 10.0, ", "{ ", "wall[0].piston.mass: missing"),
        ("mass = 10.0, force", "mass = -10.0, force", "wall[0].piston.mass = -10.0"),
        ("force = 2.0", "spring = -2.0", "wall[0].piston.spring = -2.0"),
        ("force = 2.0", "forse = 2.0", "wall[0].piston.forse"),
        ("high = 6.0", "low = 7.0, high = 6.0", "wall[0]: piston low = 7, high = 6: low must be below high"),
        (
            'units = "reduced"',
            'units = "reduced"\nprecision = "f32"',
            'wall[0].piston: cannot be combined with run.precision = "f32"',
        ),
        ("number = 40", "number = 30000", "wall[0].piston: cannot be combined with 30000 disks"),
        ("piston =", 'motion = { kind = "steady", speed = 0.1 }\npiston =', "wall[0]: line wall, piston"),
        (
            'shape = "line"\nmaterial = "coin"\npoint = [0.0, 12.0]\nnormal = [0.0, -1.0]',
            'shape = "post"\nmaterial = "coin"\ncenter = [5.0, 5.0]\nradius = 1.0',
            "wall[0]: post wall, piston: only a line or a segment",
        ),
        (
            'shape = "line"\nmaterial = "coin"\npoint = [0.0, 12.0]\nnormal = [0.0, -1.0]',
            'shape = "segment"\nmaterial = "coin"\nstart = [1.0, 5.0]\nend = [9.0, 5.0]',
            "wall[0]: segment: as a piston a segment must run from side to side",
        ),
    ],
)
def test_wrong_pistons_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, says: str
) -> None:
    assert CASE.count(old) == 1
    path = tmp_path / "lid.toml"
    path.write_text(CASE.replace(old, new))
    assert main(["check", str(path)]) == 2
    printed = capsys.readouterr().err
    assert says in printed
    assert "Traceback" not in printed


@pytest.mark.full
def test_frames_and_series_have_the_position_of_the_piston(tmp_path: Path) -> None:
    (tmp_path / "lid.toml").write_text(CASE)
    assert main(["run", str(tmp_path / "lid.toml"), "-o", f"{tmp_path}/", "--quiet"]) == 0
    with Trajectory(tmp_path / "lid.h5") as file:
        assert file.series.columns("piston_velocity") == ("wall 0 line",)
        # Energy of disks and piston is there or was dissipated, in each row.
        rows = file.series
        both = rows["energy"] + rows["potential_energy"] + rows["piston_energy"][:, 0]
        np.testing.assert_allclose(both + rows["dissipated_energy"], both[0], rtol=1e-11)
        assert rows["dissipated_energy"][-1] > 0.1 * rows["energy"][0]
        s = file.observables["piston_displacement"][:, 0]
        assert np.ptp(s) > 1.0
        for frame in file:
            (piston,) = frame.walls
            assert piston.gap(frame.position, file.disks.radius).min() > -1e-5  # places are f4
            # The page draws it there, and the piston of the trajectory is where it began.
            drawn = Content(file)._walls(frame)[0]
            np.testing.assert_allclose(drawn["origin"], (0.0, 12.0 - s[frame.index]))
        assert file.walls[0].piston is not None
        assert file.walls[0].piston.displacement == 0.0
        found = file.to_xarray()
        assert found["series_piston_energy"].dims == ("series_time", "piston")


@pytest.mark.full
def test_a_stopped_run_with_a_piston_resumes_to_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("whole", "cut"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "lid.toml").write_text(CASE)
    assert main(["run", str(tmp_path / "whole" / "lid.toml"), "-o", f"{tmp_path}/whole/", "--quiet"]) == 0
    looks = iter(range(100_000))

    def check(self: Stops) -> None:
        if next(looks) == 9:
            raise Stopped("interrupted", 130)

    monkeypatch.setattr(Stops, "check", check)
    assert main(["run", str(tmp_path / "cut" / "lid.toml"), "-o", f"{tmp_path}/cut/", "--quiet"]) == 130
    with Trajectory(tmp_path / "cut" / "lid.h5") as file:
        assert 1 < len(file) < 10
    assert main(["resume", str(tmp_path / "cut" / "lid.h5"), "--quiet"]) == 0
    with h5py.File(tmp_path / "whole" / "lid.h5") as one, h5py.File(tmp_path / "cut" / "lid.h5") as other:
        for name in (
            "particles/all/position/value_2d", "observables/piston_displacement/value",
            "timeseries/piston_velocity/value", "timeseries/energy/value",
        ):  # fmt: skip
            np.testing.assert_array_equal(one[name][()], other[name][()])


def test_check_advises_a_remedy_for_collapse_that_pistons_take(
    toml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(toml)]) == 0
    assert 'set run.collapse = "velocity_cutoff" or "contact_time"' in capsys.readouterr().out
    for remedy, value in (
        ("velocity_cutoff", "run.velocity_cutoff=0.01"),
        ("contact_time", "run.contact_time=0.01"),
    ):
        assert main(["check", str(toml), "--set", f"run.collapse={remedy}", "--set", value]) == 0
