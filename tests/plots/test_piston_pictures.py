"""Picture of pistons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import grey
from support.figures import texts

from ifrdem import Box, Disks, InputError, Piston, State, Trajectory, TrajectoryWriter, Wall
from ifrdem.plots import pictures


def write_pistons(path: Path, walls: list[Wall]) -> Path:
    """Pistons j = 1, 2, ... at s = j t with the energy -j t^2; the wall that is none comes first."""
    disks = Disks(1, 1.0, 0.5)
    number = np.arange(1.0, 1.0 + sum(wall.piston is not None for wall in walls))
    units = {"length": "m", "mass": "kg", "time": "s", "energy": "J"}
    with TrajectoryWriter(path, disks, Box((9.0, 9.0), (True, False)), walls=walls, units=units) as file:
        for t in (0.0, 1.0, 2.0):
            found = {"displacement": number * t, "velocity": number + 0.0 * t, "energy": -number * t * t}
            of_pistons = {f"piston_{name}": value for name, value in found.items() if len(number)}
            energies = {"translational_energy": 1.0, "rotational_energy": 0.0}
            file.write(
                State([[5.0, 4.0]], [[0.0, 0.0]], [0.0], time=t),
                {"collisions": int(3 * t), **energies, **of_pistons},
            )
    return path


PISTON, FLOOR = Wall.line((0.0, 8.0), (0.0, -1.0), piston=Piston(mass=2.0)), Wall.line((0.0, 1.0), (0.0, 1.0))


def test_place_and_speed_of_each_piston_are_drawn_against_time(tmp_path: Path) -> None:
    with Trajectory(write_pistons(tmp_path / "a.h5", [FLOOR, PISTON, PISTON])) as run:
        figure = pictures.figure(run, "piston")
        place, speed = figure.axes
        assert grey.least_difference(place) > 10.0  # as in test_grey.py
        assert [line.get_label() for line in place.lines] == ["wall 1 line", "wall 2 line"]
        np.testing.assert_array_equal(place.lines[1].get_xydata(), [[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]])
        np.testing.assert_array_equal(speed.lines[1].get_ydata(), 2.0)
        assert "displacement of the pistons (m)\n" in texts(figure)
        assert "velocity of the pistons (m/s)\n" in texts(figure)
        over = pictures.figure(run, "piston", over="tau").axes[0].lines[0]
        np.testing.assert_array_equal(over.get_xdata(), (0.0, 6.0, 12.0))
        curves = {line.get_label(): line for line in pictures.figure(run, "energy").axes[0].lines}
        np.testing.assert_array_equal(
            curves["pistons (kinetic and potential)"].get_ydata(), (0.0, -3.0, -12.0)
        )
        assert curves["pistons (kinetic and potential)"].axes.get_ylim()[0] < -12.0  # not cut off at 0


def test_a_file_without_a_piston_names_the_key_that_makes_one(tmp_path: Path) -> None:
    with (
        Trajectory(write_pistons(tmp_path / "a.h5", [FLOOR])) as run,
        pytest.raises(InputError, match=r"a wall with piston = \{ mass = \.\.\. \} in \[\[wall\]\]"),
    ):
        pictures.figure(run, "piston")
