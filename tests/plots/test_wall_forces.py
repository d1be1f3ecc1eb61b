"""Picture of the momentum and energy that walls take from the disks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import grey
from support.figures import texts

from ifrdem import Box, Disks, InputError, State, Trajectory, TrajectoryWriter, Turn, Wall
from ifrdem.model.walls.wall import SUMS, wall_names
from ifrdem.plots import pictures, series

WALLS = [Wall.post((2.0 + i, 3.0), 0.1, group="rake" if i < 2 else "") for i in range(3)]
BOX = Box((9.0, 9.0), (True, False))


def write_sums(path: Path, *, sums: bool = True, turning: int = 0, box: Box = BOX) -> Path:
    """Walls whose sums grow steadily: wall j gives the momentum (0, -j t), the work 2 j t and the torque 3 j t."""
    disks, state = Disks(1, 1.0, 0.5), State([[5.0, 5.0]], [[0.0, 0.0]], [0.0])
    turn = Turn("steady", center=(3.0, 3.0), rate=1.0)
    walls = [replace(wall, turn=turn if i < turning else wall.turn) for i, wall in enumerate(WALLS)]
    with TrajectoryWriter(path, disks, box, walls=walls) as file:
        names = (*wall_names([*WALLS, *WALLS[:2]], BOX)[:3], "bottom", "top")
        each = np.arange(1.0, 6.0)
        rows, columns = [], {}
        for t in np.linspace(0.0, 10.0, 21):
            row = {"momentum_x": 0.0 * each, "momentum_y": -each * t, "torque": 3.0 * each * t, "work": 2.0 * each * t,
                   "heat": 0.0 * each, "hits": each * t}  # fmt: skip
            rows.append(
                (float(t), {f"walls_{name}": value for name, value in row.items()} if sums else {"x": 0.0})
            )
            columns = dict.fromkeys(rows[-1][1], names) if sums else {}
        file.write(state)
        file.write_series_rows(rows, columns)
    return path


def test_forces_are_the_momentum_that_walls_take_over_the_time(tmp_path: Path) -> None:
    with Trajectory(write_sums(tmp_path / "a.h5")) as run:
        np.testing.assert_allclose(run.series["walls_work/rake"], 6.0 * run.series.time)  # 2 (1 + 2) t
        np.testing.assert_allclose(run.series["walls_work/wall 2 post"], 6.0 * run.series.time)
        with pytest.raises(KeyError, match="no column 'rak'"):
            run.series["walls_work/rak"]
        figure = pictures.figure(run, "walls")
        force, torque, work = figure.axes  # none for heat: no wall gave any
        lines = {line.get_label(): line for line in force.lines}
        assert next(iter(lines)) == "rake"
        np.testing.assert_allclose(lines["rake"].get_ydata(), 3.0)
        np.testing.assert_allclose(lines["top"].get_ydata(), 5.0)
        np.testing.assert_allclose(torque.lines[0].get_ydata(), -9.0)
        np.testing.assert_allclose(work.lines[0].get_ydata(), 6.0 * run.series.time)
        assert "mean force on the wall" in texts(figure)
        assert grey.least_difference(*figure.axes) > 10.0  # as in test_grey.py
        figure.draw_without_rendering()


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    ("turning", "box", "says"),
    [
        (0, BOX, "mean torque about (0, 0)"),
        (1, BOX, "mean torque about (0, 0)\n(walls that turn: its centre)"),
        (3, BOX, "mean torque about (0, 0)\n(walls that turn: its centre)"),  # and sides
        (3, Box((9.0, 9.0)), "mean torque about the centre of its turn"),
    ],
)
def test_each_torque_is_about_the_centre_that_the_label_says(
    tmp_path: Path, turning: int, box: Box, says: str
) -> None:
    with Trajectory(write_sums(tmp_path / "a.h5", turning=turning, box=box)) as run:
        assert pictures.figure(run, "walls").axes[1].get_ylabel() == says


def test_endless_walls_have_no_torque_and_the_first_band_sets_no_axis(tmp_path: Path) -> None:
    """Rows of the first of two intervals scatter by 40; the force of the others is 1, and that of no wall is a torque."""
    path = tmp_path / "a.h5"
    wall = Wall.line((0.0, 0.0), (0.0, 1.0))
    time, each = np.linspace(0.0, 10.0, 1001), np.ones(1)
    total = time + np.where(time < 0.1, 0.4 * (np.arange(1001) % 2), 0.0)
    with TrajectoryWriter(path, Disks(1, 1.0, 0.5), Box((9.0, 9.0), (True, True)), walls=[wall]) as file:
        names = wall_names([wall], Box((9.0, 9.0), (True, True)))
        sums = [
            {"momentum_x": 0.0, "momentum_y": -p, "torque": 1e6 * p, "work": p, "heat": 0.0, "hits": t}
            for t, p in zip(time, total, strict=True)
        ]
        rows = [
            (float(t), {f"walls_{name}": value * each for name, value in row.items()})
            for t, row in zip(time, sums, strict=True)
        ]
        file.write(State([[5.0, 5.0]], [[0.0, 0.0]], [0.0]))
        file.write_series_rows(rows, dict.fromkeys(rows[0][1], names))
    with Trajectory(path) as run:
        figure = pictures.figure(run, "walls")
        force, work = figure.axes
        assert "torque" not in texts(figure)
        band = np.concatenate([each.get_paths()[0].vertices[:, 1] for each in force.collections])
        assert band.max() > 10.0  # of the first interval
        low, high = force.get_ylim()
        assert -0.2 < low < 0.0
        assert 1.0 < high < 1.3
        assert work.get_ylabel().startswith("work")


CLASHING = [
    # plates called as the sides of the box; groups whose names look like the columns of others
    *(
        Wall.post((2.0, 1.0 + i), 0.1, group=name)
        for i, name in enumerate(("bottom", "top", "wall", "wall 4 post"))
    ),
    *(Wall.post((4.0, 1.0 + i), 0.1, group=name) for i, name in enumerate(("", "a", "a 1 b", "bottom"))),
]


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("old", [False, True])
def test_the_name_of_a_group_gives_its_walls_and_no_others(tmp_path: Path, old: bool) -> None:
    """Wall i has 2^i hits at the end: sums tell which walls are in it. Old files named sides by themselves."""
    names = wall_names([*CLASHING, *WALLS[:2]], BOX)
    if old:
        names = (*(f"{wall.group or 'wall'} {i} post" for i, wall in enumerate(CLASHING)), "bottom", "top")
    hits = 2.0 ** np.arange(10.0)
    with TrajectoryWriter(tmp_path / "a.h5", Disks(1, 1.0, 0.5), BOX, walls=CLASHING) as file:
        file.write(State([[5.0, 5.0]], [[0.0, 0.0]], [0.0]))
        rows = [(t, {f"walls_{name}": t * hits for name in SUMS}) for t in (0.0, 1.0)]
        file.write_series_rows(rows, dict.fromkeys(rows[0][1], names))
    with Trajectory(tmp_path / "a.h5") as run:
        found = {
            name: run.series[f"walls_hits/{name}"][-1] for name in dict.fromkeys([*names, *groups(CLASHING)])
        }
        by_group = {
            "bottom": 1.0 + 128.0,
            "top": 2.0,
            "wall": 4.0,
            "wall 4 post": 8.0,
            "a": 32.0,
            "a 1 b": 64.0,
        }
        others = [16.0] * (not old) + [256.0, 512.0] * (not old)
        assert {name: found[name] for name in by_group} == by_group
        assert sorted(found.values()) == sorted([*by_group.values(), *hits[:4], *hits[5:8], *others])
        with pytest.raises(KeyError, match="did you mean 'bottom'"):
            run.series["walls_hits/botom"]
        drawn = {line.get_label(): line.get_ydata() for line in pictures.figure(run, "walls").axes[0].lines}
        for name in set(by_group) & set(drawn):  # the force on a wall in a time of 1 is minus the momentum
            np.testing.assert_array_equal(drawn[name], -by_group[name])
        assert {"bottom", "a 1 b"} <= set(drawn)


def groups(walls: list[Wall]) -> list[str]:
    return [wall.group for wall in walls if wall.group]


def test_a_file_without_sums_of_walls_names_the_key_that_stores_them(tmp_path: Path) -> None:
    with (
        Trajectory(write_sums(tmp_path / "a.h5", sums=False)) as run,
        pytest.raises(InputError, match=r"requires output\.wall_sums = true"),
    ):
        pictures.figure(run, "walls")


def test_rows_that_are_close_together_make_no_spike(tmp_path: Path) -> None:
    """A force of 27, and in the last row, 0.01 after the one before, one hit of 1.02: alone it is a force of 102."""
    time = np.append(np.arange(11.0), 10.01)
    total = np.append(27.0 * np.arange(11.0), 271.02)
    rows = series.intervals(time)
    assert np.diff(time[rows]).min() > 0.5
    mean, half = series.means(time, total, rows)
    assert rows[-1] == 11
    assert mean.max() < 30.0
    assert np.isnan(half).all()  # a row or two in each
    # Rows at geometric times: few long intervals, and as many short ones as are of about one length.
    rows = series.intervals(np.concatenate(([0.0], np.geomspace(1e-3, 10.0, 50))))
    assert np.all(np.diff(np.concatenate(([0.0], np.geomspace(1e-3, 10.0, 50)))[rows]) > 0.1)
    with TrajectoryWriter(tmp_path / "a.h5", Disks(1, 1.0, 0.5), BOX, walls=WALLS[2:]) as file:
        file.write(State([[5.0, 5.0]], [[0.0, 0.0]], [0.0]))
        names = ("momentum_x", "momentum_y", "torque", "work", "heat", "hits")
        sums = [
            (float(t), {f"walls_{name}": np.full(3, -value) for name in names})
            for t, value in zip(time, total, strict=True)
        ]
        file.write_series_rows(sums, dict.fromkeys(sums[0][1], ("wall 0 post", "bottom", "top")))
    with Trajectory(tmp_path / "a.h5") as run:
        line = pictures.figure(run, "walls").axes[0].lines[0]
        x, y = (np.asarray(one, dtype=float) for one in line.get_data())
        assert y.max() < 30.0
        # Each interval is as long as it is: the area below is the momentum.
        assert np.sum(y[::2] * (x[1::2] - x[::2])) == pytest.approx(271.02, rel=1e-6)


def test_bands_of_mean_forces_hold_the_force_as_often_as_they_say() -> None:
    """Poisson numbers of hits of exponential strength, in rows of uneven length, ten of them in an interval."""
    rng = np.random.default_rng(3)
    time = np.concatenate(([0.0], np.cumsum(rng.uniform(0.5, 1.5, size=5000))))
    hits = rng.poisson(20.0 * np.diff(time))
    total = np.concatenate(([0.0], np.cumsum(rng.gamma(hits, 1.0))))
    rows = np.arange(0, 5001, 10)
    mean, half = series.means(time, total, rows)
    assert 0.91 < np.mean(np.abs(mean - 20.0) <= half) < 0.98
