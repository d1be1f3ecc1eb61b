"""Profiles across a gas between walls, and their picture: curves agree with the data written to the file."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from support import grey
from support.figures import texts

from ifrdem import analysis
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.plots import analyses, pictures, profiles, run
from ifrdem.plots.temperatures import theory
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

WIDTH, HEIGHT = 30.0, 20.0
SI = {"length": "m", "mass": "kg", "time": "s", "energy": "J"}


def write_layers(
    path: Path,
    walls: tuple[Wall, ...] = (),
    *,
    gravity: tuple[float, float] = (0.0, -1.0),
    periodic: tuple[bool, bool] = (True, False),
    frames: int = 10,
    n: int = 4000,
) -> None:
    """Disks in the lower half, uniformly; at the height y they drift with (1 + y, 0), T_x = 4, T_y = 9 and T_rot = 2.

    In the first half of the frames everything is at rest: it must not count.
    """
    rng = np.random.default_rng(3)
    disks = Disks(n, np.where(np.arange(n) % 2 == 0, 1.0, 3.0), 0.1)
    box = Box((WIDTH, HEIGHT), periodic)
    with TrajectoryWriter(
        path, disks, box, parameters={"gravity": json.dumps(gravity)}, units=SI, walls=walls, precision="f64"
    ) as writer:
        for time in np.arange(frames, dtype=float):
            position = rng.random((n, 2)) * (WIDTH, HEIGHT / 2)
            scale = 1.0 if time >= frames // 2 else 0.0
            drift = np.column_stack((1.0 + position[:, 1], np.zeros(n)))
            random = rng.normal(size=(n, 2)) * (2.0, 3.0) / np.sqrt(disks.mass)[:, None]
            spin = rng.normal(size=n) * np.sqrt(2.0 / disks.inertia)
            state = State(position, scale * (drift + random), scale * spin, time=time)
            writer.write(state, {"temperature": 1.0, "rotational_temperature": 0.5, "collisions": 0})


def test_profiles_are_those_of_the_second_half(tmp_path: Path) -> None:
    write_layers(tmp_path / "a.h5")
    with Trajectory(tmp_path / "a.h5") as trajectory:
        found = profiles.of(trajectory)
    assert found is not None
    assert (found.axes, found.times) == (("y",), (5.0, 9.0))
    (middle,), mean = found.middles, found.mean
    phi = 4000 * math.pi * 0.01 / (WIDTH * HEIGHT / 2)
    inner = slice(1, -3)  # at the ends strips are not full: disks stick out of what they were drawn in
    # 20,000 disks in 40 strips: 500 each, standard error 4.5 % (Poisson), 6 % for a variance.
    np.testing.assert_allclose(mean.packing_fraction[inner], phi, rtol=0.2)
    np.testing.assert_allclose(mean.velocity[inner, 0], 1.0 + middle[inner], atol=0.5)
    np.testing.assert_allclose(mean.velocity[inner, 1], 0.0, atol=0.6)
    np.testing.assert_allclose(mean.temperatures[inner], [[4.0, 9.0]] * len(middle[inner]), rtol=0.3)
    np.testing.assert_allclose(mean.rotational_temperature[inner], 2.0, rtol=0.3)
    # Over all strips the errors are six times smaller; the drift's own spread within a strip adds 2 x 0.26^2 / 12.
    np.testing.assert_allclose(mean.temperatures[inner].mean(axis=0), [4.0, 9.0], rtol=0.04)
    np.testing.assert_allclose(mean.rotational_temperature[inner].mean(), 2.0, rtol=0.04)


def test_temperature_of_few_disks_in_a_strip_is_without_bias(tmp_path: Path) -> None:
    """Of N disks of one mass about their own mean: the sum of squares over N - 1, as any variance of a sample."""
    rng, each = np.random.default_rng(2), 20
    y = np.repeat((np.arange(8) + 0.5) * 8.0 / 8.0, each)
    velocity, disks = rng.normal(size=(len(y), 2)), Disks(len(y), 2.0, 0.5)
    position = np.column_stack((np.tile(np.arange(each) + 0.5, 8), y))
    with TrajectoryWriter(
        tmp_path / "a.h5", disks, Box((each, 8.0), (True, False)), precision="f64"
    ) as writer:
        writer.write(State(position, velocity, np.zeros(len(y))))
    with Trajectory(tmp_path / "a.h5") as trajectory:
        found = profiles.of(trajectory)
    assert found is not None
    expected = 2.0 * np.var(velocity.reshape(8, each, 2), axis=1, ddof=1)
    np.testing.assert_allclose(found.mean.temperatures, expected, rtol=1e-12)


def test_a_disk_is_shared_out_among_strips_by_area(tmp_path: Path) -> None:
    """One disk across three strips, its middle at a quarter of one: areas of circular segments."""
    disks, box = Disks(1, 1.0, 1.0), Box((8.0, 8.0), (True, False))
    with TrajectoryWriter(tmp_path / "a.h5", disks, box, precision="f64") as writer:
        writer.write(State(np.array([[4.0, 4.25]]), np.zeros((1, 2)), np.zeros(1)))
    with Trajectory(tmp_path / "a.h5") as trajectory:
        found = profiles.of(trajectory)
    assert found is not None
    areas = found.mean.packing_fraction * np.diff(found.edges[0]) * 8.0
    assert np.sum(areas) == pytest.approx(math.pi, rel=1e-12)

    def below(edge: float) -> float:  # pi - (area of the cap of height h = 1 - u, u the distance of the edge)
        u = min(max(edge - 4.25, -1.0), 1.0)
        return math.pi - (math.acos(u) - u * math.sqrt(1.0 - u * u))

    expected = [below(high) - below(low) for low, high in itertools.pairwise(found.edges[0])]
    np.testing.assert_allclose(areas, expected, atol=1e-12)
    assert np.all(np.isnan(found.mean.temperature))  # one disk has none


def test_strips_of_a_container_are_compared_with_its_own_room(tmp_path: Path) -> None:
    """A uniform gas in a circle has a flat profile, though strips at its ends are short."""
    rng = np.random.default_rng(4)
    n = 20_000
    r, angle = 9.0 * np.sqrt(rng.random(n)), 2.0 * np.pi * rng.random(n)
    position = 10.0 + np.column_stack((r * np.cos(angle), r * np.sin(angle)))
    drum = Wall.container((10.0, 10.0), 9.0)
    disks = Disks(n, 1.0, 0.05)
    parameters = {"gravity": "[0.0, -1.0]"}
    with TrajectoryWriter(
        tmp_path / "a.h5", disks, Box((20.0, 20.0), (False, False)), walls=[drum], parameters=parameters
    ) as writer:
        writer.write(State(position, np.zeros((n, 2)), np.zeros(n)))
    with Trajectory(tmp_path / "a.h5") as trajectory:
        found = profiles.of(trajectory)
        phi = trajectory.free_area.packing_fraction(disks.radius)
    assert found is not None
    assert phi == pytest.approx(n * 0.05**2 / 81.0)
    np.testing.assert_allclose(
        found.mean.packing_fraction[2:-2], phi, rtol=0.25
    )  # 200 disks a strip and more: 7 %
    np.testing.assert_allclose(found.mean.packing_fraction[10:-10].mean(), phi, rtol=0.04)


@pytest.mark.parametrize(
    ("gravity", "periodic", "walls", "axis"),
    [
        ((1.0, 0.0), (False, False), (), 0),
        ((0.5, -1.0), (False, False), (), 1),
        ((0.0, 0.0), (False, True), (), 0),
        ((0.0, 0.0), (True, False), (), 1),
        ((0.0, 0.0), (False, False), (Wall.line((0.0, 1.0), (0.0, 1.0)),), 1),
    ],
)
def test_profiles_go_along_gravity_or_from_wall_to_wall(
    tmp_path: Path,
    gravity: tuple[float, float],
    periodic: tuple[bool, bool],
    walls: tuple[Wall, ...],
    axis: int,
) -> None:
    write_layers(tmp_path / "a.h5", walls, gravity=gravity, periodic=periodic, frames=2, n=500)
    with Trajectory(tmp_path / "a.h5") as trajectory:
        found = profiles.of(trajectory)
    assert found is not None
    assert found.axes == ("xy"[axis],)


def test_the_picture_shows_walls_profiles_and_no_theory(tmp_path: Path, drawn: list[Figure]) -> None:
    sine = Motion("sine", amplitude=0.5, frequency=0.25)
    walls = (
        Wall.line((0.0, 1.0), (0.0, 1.0), motion=sine),
        Wall.post((20.0, 15.0), 2.0, surface_speed=0.5),
        Wall.segment((2.0, 12.0), (6.0, 14.0)),
        Wall.line((0.0, 20.0), (0.0, -1.0), temperature=5.0),
    )
    write_layers(tmp_path / "a.h5", walls)
    run.walled(tmp_path / "a.h5", tmp_path / "a.png")
    (figure,) = drawn
    shown = texts(figure)
    for label in (
        "temperature (J)",
        "time $t$ (s)",
        "$y$ (m)",
        r"packing fraction $\phi$",
        "means from 5 s to 9 s",
    ):
        assert label in shown
    assert "kinetic theory" not in shown
    assert "packing fraction of the free area" in shown
    with Trajectory(tmp_path / "a.h5") as trajectory:
        found = profiles.of(trajectory)
        assert theory(trajectory)[2] == "walls: no kinetic theory here"
    assert found is not None
    density, temperatures, velocities = figure.axes[1:4]  # a surface moves, so the velocity is shown
    assert grey.least_difference(temperatures, velocities) > 10.0  # as in test_grey.py
    np.testing.assert_array_equal(density.lines[0].get_xdata(), found.mean.packing_fraction)
    np.testing.assert_array_equal(density.lines[0].get_ydata(), found.middles[0])
    for line, values in zip(
        temperatures.lines,
        (*found.mean.temperatures.T[::-1], found.mean.rotational_temperature),
        strict=False,
    ):
        np.testing.assert_array_equal(line.get_xdata(), values)
    assert [tuple(np.ravel(line.get_xydata())) for line in temperatures.lines[3:]] == [(5.0, 20.0)]
    np.testing.assert_array_equal(velocities.lines[0].get_xdata(), found.mean.velocity[:, 0])
    (panel,) = [axes for axes in figure.axes if axes.findobj(EllipseCollection)]
    heights = [np.asarray(line.get_ydata()) for line in panel.lines]
    np.testing.assert_allclose(heights[0], 1.5, rtol=1e-12)  # at t = 9: 2.25 periods
    np.testing.assert_array_equal(heights[1], [12.0, 14.0])
    assert panel.get_xlim() == (0.0, WIDTH)
    (post,) = [each for each in panel.patches if isinstance(each, Circle)]
    assert (post.center, post.radius) == ((20.0, 15.0), 2.0)
    assert panel.spines["bottom"].get_linewidth() > panel.spines["left"].get_linewidth()


def test_a_file_without_velocities_has_no_profile_and_a_picture(tmp_path: Path, drawn: list[Figure]) -> None:
    disks, box = Disks(1, 1.0, 1.0), Box((8.0, 8.0), (True, False))
    with TrajectoryWriter(tmp_path / "a.h5", disks, box, fields=["position"]) as writer:
        state = State(np.array([[4.0, 4.0]]), np.zeros((1, 2)), np.zeros(1))
        writer.write(state, {"temperature": 1.0, "rotational_temperature": 0.0})
    run.walled(tmp_path / "a.h5", tmp_path / "a.png")
    assert "packing fraction $" not in texts(drawn[0])


def test_missing_profiles_are_reported_and_gases_at_rest_have_temperature_0(tmp_path: Path) -> None:
    disks, box = Disks(40, 1.0, 0.5), Box((WIDTH, HEIGHT), (True, False))
    position = np.random.default_rng(1).random((40, 2)) * (WIDTH, HEIGHT)
    still = State(position, np.zeros((40, 2)), np.zeros(40))
    for fields, says in (
        (("position", "velocity"), "the file holds no angular_velocity"),
        (("position",), "no profiles: the file holds no velocity"),
    ):
        path = tmp_path / f"{len(fields)}.h5"
        with TrajectoryWriter(path, disks, box, fields=fields) as writer:
            for time in (0.0, 1.0, 2.0):
                state = State(still.position, still.velocity, still.spin, time=time)
                writer.write(
                    state, {"temperature": 1.0 - time / 2.0, "rotational_temperature": 0.0, "collisions": 0}
                )
        figure = run.walled(path)
        assert says in texts(figure)
        lines = figure.axes[0].lines
        np.testing.assert_array_equal(lines[0].get_ydata(), (1.0, 0.5, 0.0))
        assert len(lines) == 1  # nothing spins
        assert figure.axes[0].get_yscale() == "linear"


def test_temperatures_that_fall_over_decades_have_a_logarithmic_axis_without_zeros(tmp_path: Path) -> None:
    disks, box = Disks(1, 1.0, 0.5), Box((8.0, 8.0), (True, False))
    with TrajectoryWriter(tmp_path / "a.h5", disks, box, fields=("position",)) as writer:
        for time, T in enumerate((1.0, 1e-2, 1e-4, 0.0)):
            state = State([[4.0, 4.0]], np.zeros((1, 2)), np.zeros(1), time=time)
            writer.write(state, {"temperature": T, "rotational_temperature": 0.0, "collisions": 0})
    axes = run.walled(tmp_path / "a.h5").axes[0]
    assert axes.get_yscale() == "log"
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), (1.0, 1e-2, 1e-4, np.nan))


@pytest.mark.full
def test_a_bin_with_two_disks_in_all_frames_does_not_stretch_an_axis(tmp_path: Path) -> None:
    """A gas with T = 1, and above it a fast disk: twice in 40 frames in one strip, in all the others in another one."""
    rng, n, box = np.random.default_rng(6), 100, Box((10.0, 10.0))
    with TrajectoryWriter(tmp_path / "a.h5", Disks(n + 1, 1.0, 0.1), box, precision="f64") as writer:
        for time in range(40):
            position = np.append(rng.random((n, 2)) * (10.0, 5.0), [[5.0, 9.5 if time < 2 else 7.5]], axis=0)
            velocity = np.append(rng.normal(size=(n, 2)), [[900.0 * (-1.0) ** time, 0.0]], axis=0)
            spin = np.append(rng.normal(size=n), 1e4)
            writer.write(State(position, velocity, spin, time=float(time)))
    with Trajectory(tmp_path / "a.h5") as trajectory:
        figure = pictures.figure(trajectory, "profiles", axis="y", bins=10, frames=list(range(40)))
        flow, temperatures = figure.axes[1:3]
        assert max(abs(end) for end in flow.get_ylim()) < 2.0
        assert temperatures.get_ylim()[1] < 3.0
        assert figure.axes[0].get_xlim()[1] > 9.0  # all strips are there
        stress = figure.axes[3]
        assert stress.get_ylim()[1] < 1.2 * max(
            np.nanmax(np.asarray(one.get_ydata())) for one in stress.lines
        )
        drawn = {float(x) for line in temperatures.lines for x, y in line.get_xydata() if np.isfinite(y)}
    assert 9.5 not in drawn


def test_intervals_of_n_eff_near_one_do_not_stretch_an_axis() -> None:
    """0.1 +- 0.1 with n_eff 2 reaches from -1.2 to 1.4 (t = 12.7), 0.3 +- 0.01 with n_eff 20 to 0.321 (t = 2.09)."""
    value, error, n_eff = np.array([[0.1, 0.3, 0.3], [0.1, 0.01, 0.01], [2.0, 20.0, 20.0]])
    mean, errors, effective = (SimpleNamespace(packing_fraction=one) for one in (value, error, n_eff))
    found: Any = SimpleNamespace(
        mean=mean, error=errors, n_eff=effective, disks=np.full(3, 100), frames=10, middles=(np.arange(3.0),),
        species={},
    )  # fmt: skip
    axes = Figure().subplots()
    analyses._density(axes, found)
    assert 0.321 < axes.get_ylim()[1] < 0.35
    ends = [segment[:, 1] for bars in axes.collections for segment in bars.get_segments()]
    assert max(end.max() for end in ends) == pytest.approx(1.37, abs=0.01)  # drawn all the same, and clipped


def test_profiles_of_an_open_box_have_no_empty_panels(tmp_path: Path) -> None:
    rng, disks = np.random.default_rng(7), Disks(200, 1.0, 0.1)
    with TrajectoryWriter(tmp_path / "a.h5", disks, Box.open()) as writer:
        for time in range(10):
            state = State(
                10.0 * rng.random((200, 2)), rng.normal(size=(200, 2)), rng.normal(size=200), time=time
            )
            writer.write(state)
    with Trajectory(tmp_path / "a.h5") as trajectory:
        figure = pictures.figure(trajectory, "profiles", axis="x", bins=8)
        shown = [axes for axes in figure.axes if axes.get_visible()]
        assert len(shown) == 3
        for axes in shown:
            assert any(np.isfinite(np.asarray(line.get_ydata(), dtype=float)).any() for line in axes.lines)
        left, right = analysis.profiles(trajectory, "x", 8).plot()
        for axes in (left, right):
            assert any(np.isfinite(np.asarray(line.get_ydata(), dtype=float)).any() for line in axes.lines)
