"""Starts from a frame of a trajectory."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import cases
from support.cases import Problems
from support.gases import touching

from ifrdem.case import starts
from ifrdem.case.gas import CaseGas
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.initial import packing, radii
from ifrdem.initial.placement import check_no_overlap
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

N = 60
CASE = cases.case_text({
    "run.collisions_per_disk": 2.0, "run.seed": 5, "run.name": None, "run.t_end": None,
    "box.packing_fraction": 0.6, "material[0].name": "m", "material[0].e_t": -0.9, "material[0].mu": 0.1,
    "species[0].name": "disks", "species[0].number": 60, "species[0].material": "m",
    "species[0].areal_density": 1.0,
    "species[0].radii": {"distribution": "uniform", "low": 0.5, "high": 1.0}, "species[0].mass": None,
    "species[0].radius": None, "start": {"positions": "old.h5"},
})  # fmt: skip
MOVING = ("start.motion=true", "species[0].speed_rms=")


def trajectory(
    folder: Path, precision: str = "f64", fields: list[str] | None = None, grid: float = 0.0, **options: Any
) -> list[State]:
    """A trajectory of three frames, old.h5, of the disks that the case has; positions may lie on a grid."""
    radius = radii.uniform(N, low=0.5, high=1.0, seed=5)  # the first species draws by the run's seed itself
    box = Box.from_packing_fraction(radius, 0.6)
    random = np.random.default_rng(1)
    random = np.random.default_rng(1)
    states = []
    for seed in range(3):
        position = touching(box, radius, packing.grown_positions(box, radius, seed=seed))
        position = np.round(position / grid) * grid if grid else position
        states.append(State(position, random.normal(size=(N, 2)), random.normal(size=N), time=seed))
    fields = ["position", "velocity", "angular_velocity"] if fields is None else fields
    disks = Disks(N, mass=np.pi * radius**2, radius=radius)
    with TrajectoryWriter(
        folder / "old.h5", disks, box, fields=fields, precision=precision, force=True, **options
    ) as file:
        for state in states:
            file.write(state)
    return states


def start(folder: Path, *overrides: str) -> tuple[CaseGas, State]:
    assert cases.problems(*overrides, text=CASE, folder=folder) == []
    gas = cases.case_gas(*overrides, text=CASE, folder=folder)
    return gas, starts.start(gas)


@pytest.mark.parametrize(("frame", "index"), [(None, 2), ("-1", 2), ("0", 0), ("-2", 1)])
def test_positions_are_those_of_the_frame(tmp_path: Path, frame: str | None, index: int) -> None:
    states = trajectory(tmp_path)
    _, state = start(tmp_path, *([f"start.frame={frame}"] if frame else []))
    np.testing.assert_array_equal(state.position, states[index].position)
    assert np.sqrt(np.mean(np.sum(state.velocity**2, axis=1))) == pytest.approx(1.0)  # speed_rms of the case
    assert state.time == states[index].time


def test_motion_takes_velocities_and_spins_too(tmp_path: Path) -> None:
    states = trajectory(tmp_path)
    gas, state = start(tmp_path, *MOVING, "start.frame=1")
    np.testing.assert_array_equal(state.velocity, states[1].velocity)
    np.testing.assert_array_equal(state.spin, states[1].spin)
    # What the estimates go by.
    assert gas.species[0].spin_rms == pytest.approx(np.sqrt(np.mean(states[1].spin ** 2)))


def test_rounding_of_single_precision_is_undone(tmp_path: Path) -> None:
    states = trajectory(tmp_path, precision="f32")
    gas, state = start(tmp_path)
    with pytest.raises(InputError, match="overlap"), Trajectory(tmp_path / "old.h5") as file:
        check_no_overlap(gas.box, gas.disks.radius, file[-1].position)
    check_no_overlap(gas.box, gas.disks.radius, state.position, tolerance=0.0)
    # 2^-24 of a box of 13 in each coordinate, and what neighbours push on.
    apart = gas.box.minimum_image(state.position - states[2].position)
    assert 0.0 < np.abs(apart).max() < 20.0 * 2.0**-24 * 13.0


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_rounding_of_a_run_in_single_precision_is_undone(
    problems: Problems, tmp_path: Path, precision: str
) -> None:
    """Its places lie on a grid of up to 2^-22 of the box, wherever they are stored: such frames were refused."""
    parameters = {"case_in_full": '{"run": {"precision": "f32"}}'}
    trajectory(tmp_path, precision, grid=13.0 * 2.0**-22, parameters=parameters)
    gas, state = start(tmp_path)
    with pytest.raises(InputError, match="overlap"), Trajectory(tmp_path / "old.h5") as file:
        check_no_overlap(gas.box, gas.disks.radius, file[-1].position, tolerance=1e-7)
    check_no_overlap(gas.box, gas.disks.radius, state.position, tolerance=0.0)
    trajectory(tmp_path, "f64", grid=13.0 * 2.0**-22)  # of another run, whose disks overlap
    assert "overlap" in problems(folder=tmp_path)[0]


def test_rounding_of_an_exported_frame_is_undone(problems: Problems, tmp_path: Path) -> None:
    """A CSV of positions that were stored in single precision; disks that overlap by more are refused."""
    trajectory(tmp_path, precision="f32")
    assert (
        cli.main(
            ["export", str(tmp_path / "old.h5"), "--to", "csv", "--frames=-1", "-o", f"{tmp_path}/a.csv"]
        )
        == 0
    )
    of_table = ["start.positions=", "start.file=a.csv", "species[0].speed_rms="]
    gas, state = start(tmp_path, *of_table)
    with pytest.raises(InputError, match="overlap"), Trajectory(tmp_path / "old.h5") as file:
        check_no_overlap(gas.box, gas.disks.radius, file[-1].position)
    check_no_overlap(gas.box, gas.disks.radius, state.position, tolerance=0.0)
    assert "overlap" in problems(*of_table, "species[0].radii.high=1.00002", folder=tmp_path)[0]


@pytest.mark.full(keep=4)
@pytest.mark.parametrize(
    ("overrides", "key", "says"),
    [
        (["start.positions=odl.h5"], 'start.positions = "odl.h5"', r"no such file \(did you mean 'old\.h5'"),
        (["start.frame=3"], 'start.positions = "old.h5"', r"frame 3 of .*: there are 3 frames \(0 to 2\)"),
        (["start.frame=-4"], 'start.positions = "old.h5"', "frame -4 of"),
        (["start.frame=1.5"], "start.frame = 1.5", "must be an integer"),
        (["species[0].number=61"], 'start.positions = "old.h5"', "has 60 disks: must be 61"),
        (
            ["box.packing_fraction=0.5"],
            'start.positions = "old.h5"',
            r"its box is 13\.\d+ x 13\.\d+, that of the case .*with box\.lengths = \[13\.\d+, 13\.\d+\] they agree",
        ),
        (["start.positions=random", "start.frame=1"], "start", 'frame: requires positions = "NAME.h5"'),
        (["start.positions=hexagonla"], 'start.positions = "hexagonla"', "did you mean 'hexagonal'"),
        (
            ["start.positions=", "start.file=old.h5"],
            "start",
            'is named by positions = "old.h5"; file is for CSV',
        ),
        (["start.file=a.csv"], "start", "positions cannot be combined with file"),
        (["start.motion=true"], "species[0].speed_rms = 1", "cannot be combined with start.motion = true"),
        (
            ["species[0].speed_rms="],
            "run.collisions_per_disk = 2",
            "start.motion = true or a species speed_rms",
        ),
    ],
)
def test_starts_that_lack_something_are_refused_with_what_the_file_has(
    problems: Problems, tmp_path: Path, overrides: list[str], key: str, says: str
) -> None:
    trajectory(tmp_path)
    (found,) = problems(*overrides, folder=tmp_path)
    assert found.startswith(key), found
    assert re.search(says, found), found


def test_disks_of_other_radii_that_overlap_are_explained(problems: Problems, tmp_path: Path) -> None:
    trajectory(tmp_path)
    sides = cases.case_gas(text=CASE, folder=tmp_path).box.lengths
    (found,) = problems(
        {"run.seed": 6, "box.packing_fraction": None, "box.lengths": [*sides]}, folder=tmp_path
    )
    assert re.search(r"frame 2 of 3: disks \d+ and \d+ overlap by .*other radii: disk 0 has", found)


def test_a_field_that_the_file_lacks_is_named(problems: Problems, tmp_path: Path) -> None:
    trajectory(tmp_path, fields=["position", "velocity"])
    (found,) = problems(*MOVING, folder=tmp_path)
    assert (
        "holds no field 'angular_velocity' (did you mean 'velocity'?); there are position, velocity" in found
    )
    assert problems(folder=tmp_path) == []


def test_a_file_that_is_no_trajectory_is_refused_with_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "old.h5").write_text("x", encoding="utf-8")
    (tmp_path / "case.toml").write_text(CASE, encoding="utf-8")
    assert cli.main(["check", str(tmp_path / "case.toml")]) == 2
    assert "old.h5 is not an HDF5 file" in capsys.readouterr().err
