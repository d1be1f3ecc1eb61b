"""Paths through periodic sides, with `image` and without: no path is shorter than that of the disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from ifrdem import analysis, plots
from ifrdem.analysis import catalogue
from ifrdem.case.case import CaseSections
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.runs import compare
from ifrdem.tools.tables import TableFormat
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

BOX = Box((10.0, 10.0))
HEAVY, LIGHT = 300, 12
N = HEAVY + LIGHT


def walks(frames: int = 60) -> np.ndarray:
    """Random walks, (frames, N, 2): steps of a heavy disk have the deviation 0.1 along each axis, of a light one 6."""
    rng = np.random.default_rng(4)
    size = np.repeat([0.1, 6.0], [HEAVY, LIGHT])[:, None]
    return 5.0 + np.cumsum(rng.normal(size=(frames, N, 2)) * size, axis=0)


def on_paths(path: Path, places: np.ndarray, velocity: np.ndarray, fields: list[str], box: Box = BOX) -> Path:
    """A trajectory of these places on paths without jumps, a frame in each unit of time."""
    n = places.shape[1]
    with TrajectoryWriter(path, Disks(n, 1.0, 0.01), box, fields=fields, precision="f64", units={}) as file:
        for t, place in enumerate(places):
            image = np.floor(place / box.lengths).astype(np.int32)
            v = velocity[t]
            state = State(place - image * box.lengths, v, np.zeros(n), time=float(t), image=image)
            sums = {"temperature": 1.0, "translational_energy": 1.0, "rotational_energy": 0.0}
            file.write(state, sums)
    return path


def test_few_fast_disks_do_not_hide_among_many_slow_ones(tmp_path: Path) -> None:
    """The deviation of all steps is sqrt(12 / 312 36) = 1.18, below an eighth of the box, 1.25; that of light ones 6.

    D = sum of the variances of steps along x and y / (4 disks) = (300 0.01 + 12 36) / (2 x 312) = 0.697.
    """
    path = walks()
    inside = path - np.floor(path / 10.0) * 10.0
    steps = BOX.minimum_image(np.diff(inside, axis=0))
    assert np.sqrt(np.mean(steps**2, axis=(0, 1))).max() < 10.0 / 8.0
    with pytest.raises(
        InputError, match=r'a disk moves 0\.\d+ of the box along x.*"image" into output\.fields'
    ):
        analysis.unwrap(inside, BOX)
    slow = slice(0, HEAVY)
    np.testing.assert_allclose(np.diff(analysis.unwrap(inside[:, slow], BOX), axis=0), np.diff(path[:, slow], axis=0),
                               atol=1e-12)  # fmt: skip
    bare = on_paths(tmp_path / "bare.h5", path, np.zeros_like(path), ["position"])
    with Trajectory(bare) as trajectory, pytest.raises(InputError, match='"image" into'):
        catalogue.FUNCTIONS["msd"](trajectory, None)
    whole = on_paths(tmp_path / "whole.h5", path, np.zeros_like(path), ["position", "image"])
    with Trajectory(whole) as trajectory:
        found = catalogue.FUNCTIONS["msd"](trajectory, None).result["all disks"].fit
    # Of 12 disks that make all of it, over 60 frames: the error that it states, by the spread over disks.
    assert pytest.approx(0.697, abs=3.5 * found.error) == found.D
    assert found.error < 0.3


def test_speeds_show_jumps_that_steps_hide() -> None:
    """A disk goes once round the box, 10, from frame to frame, and seems to stand; another one goes 0.4 of it."""
    times = np.arange(4.0)
    velocity = np.broadcast_to([[10.0, 0.0], [4.0, 0.0]], (4, 2, 2))
    path = [1.0, 1.0] + velocity * times[:, None, None]
    inside = path % 10.0
    assert not np.diff(analysis.unwrap(inside[:, :1], BOX), axis=0).any()  # it seems to stand
    with pytest.raises(InputError, match=r"a disk moves 1 of the box along x"):
        analysis.unwrap(inside, BOX, velocity=velocity, times=times)
    own = analysis.unwrap(inside[:, 1:], BOX, velocity=velocity[:, 1:], times=times)
    np.testing.assert_allclose(own, path[:, 1:], atol=1e-12)
    with pytest.raises(InputError, match=r"velocity has shape .*: must have that of position"):
        analysis.unwrap(inside, BOX, velocity=velocity[:, 1:], times=times)
    walled = analysis.unwrap(inside, Box((10.0, 10.0), (False, True)), velocity=velocity, times=times)
    np.testing.assert_array_equal(walled, inside)  # nothing goes through a wall, however fast


def test_a_case_stores_images_by_default(tmp_path: Path) -> None:
    assert "image" in CaseSections.model_fields["output"].get_default(call_default_factory=True).fields
    with TrajectoryWriter(tmp_path / "new.h5", Disks(1, 1.0, 0.1), BOX) as file:
        file.write(State([[1.0, 1.0]], [[0.0, 0.0]], [0.0]))
    with Trajectory(tmp_path / "new.h5") as trajectory:
        assert "image" in trajectory.fields


def test_a_place_between_two_frames_is_on_the_way_through_the_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk at 3 along x is at 9 at t = 2 and at 2 = 12 at t = 3: at 10.5, that is 0.5, at t = 2.5, not at 5.5.

    With the speed and frames at half the time, a file without images is enough too; frames at t = 0, 1, ... are not.
    """
    monkeypatch.chdir(tmp_path)
    velocity = np.broadcast_to([[[3.0, 0.0]]], (5, 1, 2))
    path = np.array([[3.0, 5.0]]) + velocity * np.arange(5.0)[:, None, None]
    fields = ["position", "velocity", "angular_velocity"]
    run = on_paths(Path("run.h5"), path, velocity, [*fields, "image"])
    Path("seen.csv").write_text("id,x,y,t\n0,0.6,5,2.5\n0,9.9,5,2.25\n0,5,5,\n")
    found = compare.compare(run, compare.read("seen.csv", {}, TableFormat()))
    np.testing.assert_allclose(found.distance, [0.1, 0.15, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.position[:, 0], [0.5, 9.75, 5.0], atol=1e-12)
    found.draw([Path("seen.png")])
    bare = on_paths(Path("bare.h5"), path, velocity, fields)
    np.testing.assert_allclose(compare.compare(bare, compare.read("seen.csv", {}, TableFormat())).distance,
                               [0.1, 0.15, 0.0], atol=1e-12)  # fmt: skip
    Path("soon.csv").write_text("id,x,y,t\n0,6,5,0.5\n")
    fast = on_paths(Path("fast.h5"), path[::2], 2.0 * velocity[::2], fields)
    with pytest.raises(InputError, match=r"a disk moves 0\.6 of the box along x"):
        compare.compare(fast, compare.read("soon.csv", {}, TableFormat()))


def test_the_picture_of_a_table_draws_no_paths_without_positions(tmp_path: Path) -> None:
    path = walks(4)
    names = ["position", "velocity", "angular_velocity"]
    still = np.zeros_like(path)
    for name, fields, velocity in (("known", [*names, "image"], still), ("unknown", names, still + 9.0)):
        figure = plots.table(on_paths(tmp_path / f"{name}.h5", path, velocity, fields))
        axes = figure.axes[2]
        drawn = any(isinstance(each, LineCollection) for each in axes.collections)
        assert drawn == (name == "known")
        assert ("need the field image" in axes.get_title()) == (name == "unknown")


def test_displacements_of_a_run_as_it_comes_are_those_of_its_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Disks that hardly ever meet go 15 on average between two frames, further than the box of 9: <x^2> = (5 t)^2."""
    monkeypatch.chdir(tmp_path)
    Path("gas.toml").write_text(
        'run = { name = "gas", t_end = 9.0, units = "reduced" }\nbox = { lengths = [9.0, 9.0] }\n'
        'material = [{ name = "m", e_n = 1.0, e_t = -1.0, mu = 0.0 }]\n'
        'species = [{ name = "d", number = 3, material = "m", mass = 1.0, radius = 1e-9, speed_rms = 5.0 }]\n'
        "output = { frames = 3, views = false, picture = false }\n"
    )
    assert main(["run", "gas.toml", "--quiet"]) == 0
    with Trajectory("gas.h5") as trajectory:
        msd = catalogue.FUNCTIONS["msd"](trajectory, None).result["all disks"].msd
    np.testing.assert_allclose(msd.value, 25.0 * msd.lag**2, rtol=1e-5, atol=1e-9)  # single precision
