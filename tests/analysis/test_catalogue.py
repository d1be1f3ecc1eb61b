"""Numbers of analyses of files, for motions with known answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.analysis import catalogue, motion, result
from ifrdem.quantities import STRESS_SERIES


def test_velocities_that_turn_forget_their_direction_where_the_cosine_does(tmp_path: Path) -> None:
    """All turn by 0.3 between frames: <v(0) v(t)> = <v^2> cos(0.3 t), 0.62 after three, 0.362 < 1/e after four."""
    disks = ifrdem.Disks(40, mass=1.0, radius=0.5)
    position = 1.0 + 2.0 * np.argwhere(np.ones((8, 5)))
    speed, angle = np.random.default_rng(1).uniform(0.5, 1.5, 40), 2.0 * np.pi * np.arange(40) / 40
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, ifrdem.Box((20.0, 20.0))) as file:
        for time in range(12):
            turned = angle + 0.3 * time
            velocity = speed[:, None] * np.stack((np.cos(turned), np.sin(turned)), axis=1)
            state = ifrdem.State(position, velocity, np.zeros(40), float(time))
            file.write(state, {"temperature": ifrdem.observables.measure(disks, state).temperature})
    found = motion.of_vacf(ifrdem.Trajectory(tmp_path / "a.h5"), None)
    rows = {row.name: row.value for row in found.rows}
    assert rows["<v^2>"] == pytest.approx(np.mean(speed**2), rel=1e-6)  # stored in f32
    assert rows["first lag below 1/e"] == 4.0


FLOOR = ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0))
WALKS = {  # the box, its walls, directions along which disks can diffuse
    "periodic": (ifrdem.Box((50.0, 20.0)), (), 2),
    "sides": (ifrdem.Box((50.0, 20.0), (True, False)), (), 1),
    "floor": (ifrdem.Box((50.0, 20.0)), (FLOOR,), 1),
    "closed": (ifrdem.Box((50.0, 20.0), (False, False)), (), 2),
}


@pytest.mark.parametrize("kind", WALKS)
def test_diffusion_counts_directions_without_walls(tmp_path: Path, kind: str) -> None:
    """Steps of +-1 along x alone: <x^2> = t, so that D = <x^2> / (2 d t) is 1/2 of one direction, and 1/4 of two."""
    box, walls, directions = WALKS[kind]
    draw, n = np.random.default_rng(2), 400
    disks = ifrdem.Disks(n, mass=1.0, radius=0.1)
    x, y = 25.0 * np.ones(n), draw.uniform(1.0, 19.0, n)
    fields = ("position", "velocity", "image")
    with ifrdem.TrajectoryWriter(
        tmp_path / "walk.h5", disks, box, walls=walls, fields=fields, precision="f64"
    ) as file:
        for time in range(40):
            image = np.stack((np.floor(x / 50.0) * box.periodic[0], np.zeros(n)), axis=1).astype(np.int32)
            position = np.stack((x - 50.0 * image[:, 0], y), axis=1)
            velocity = np.zeros((n, 2))
            state = ifrdem.State(position, velocity, np.zeros(n), float(time), image=image)
            file.write(state, {"temperature": 1.0})
            x = x + draw.choice([-1.0, 1.0], n)
    found = motion.of_msd(ifrdem.Trajectory(tmp_path / "walk.h5"), None)
    rows = {row.name: row.value for row in found.rows}
    # 400 walks of 40 steps: <x^2> at the lags of the fit has a standard error of some 3 %.
    assert rows["D"] == pytest.approx(0.5 / directions, rel=0.12)
    assert ("along x only: walls bound the other direction" in found.notes) == (directions == 1)
    assert any("walls on all sides" in warning for warning in found.warnings) == (kind == "closed")


@pytest.mark.parametrize(
    ("n", "lengths", "cells"),
    [(180, (30.0, 10.0), (5, 2)), (1, (30.0, 1.0), (1, 1))],
)
def test_cells_of_fields_are_squares_for_twenty_disks(
    tmp_path: Path, n: int, lengths: tuple[float, float], cells: tuple[int, int]
) -> None:
    """Of side a = sqrt(20 Lx Ly / n): 180 disks on 30 x 10 have 30 / a = 5.2, 10 / a = 1.7; one on 30 x 1 has 1.2."""
    disks = ifrdem.Disks(n + 1, mass=np.r_[np.ones(n), np.inf], radius=0.1)
    position = np.random.default_rng(3).uniform(0.0, lengths, (n + 1, 2))
    with ifrdem.TrajectoryWriter(tmp_path / "gas.h5", disks, ifrdem.Box(lengths)) as file:
        file.write(ifrdem.State(position, np.ones((n + 1, 2)), np.zeros(n + 1)), {"temperature": 1.0})
    found = catalogue.of_fields(ifrdem.Trajectory(tmp_path / "gas.h5"), None)
    rows = {row.name: row.value for row in found.rows}
    assert (rows["cells along x"], rows["cells along y"]) == cells


def test_disks_that_cannot_move_have_no_fields(tmp_path: Path) -> None:
    disks = ifrdem.Disks(1, mass=np.inf, radius=0.1)
    with ifrdem.TrajectoryWriter(tmp_path / "still.h5", disks, ifrdem.Box((2.0, 2.0))) as file:
        file.write(ifrdem.State([[1.0, 1.0]], [[0.0, 0.0]], [0.0]), {"temperature": 0.0})
    with pytest.raises(ifrdem.InputError, match="mass: must be finite"):
        catalogue.of_fields(ifrdem.Trajectory(tmp_path / "still.h5"), None)


def test_a_gas_at_rest_has_no_pressure(tmp_path: Path) -> None:
    disks = ifrdem.Disks(1, mass=1.0, radius=0.1)
    with ifrdem.TrajectoryWriter(tmp_path / "rest.h5", disks, ifrdem.Box((2.0, 2.0))) as file:
        for time in (0.0, 1.0):
            state = ifrdem.State([[1.0, 1.0]], [[0.0, 0.0]], [0.0], time)
            file.write(state, {"temperature": 0.0, "collisions": 0})
    with pytest.raises(ifrdem.InputError, match=r"rest\.h5: T = 0: must be above 0"):
        catalogue.of_pressure(ifrdem.Trajectory(tmp_path / "rest.h5"), None)


def test_keys_of_numbers_are_short_and_apart_from_columns(tmp_path: Path) -> None:
    """In a study both are variables named after the analysis."""
    draw, n = np.random.default_rng(5), 60
    disks = ifrdem.Disks(n, mass=1.0, radius=0.1, species={"heavy": 30, "light": 30})
    fields = ("position", "velocity", "angular_velocity", "image")
    with ifrdem.TrajectoryWriter(tmp_path / "gas.h5", disks, ifrdem.Box((9.0, 9.0)), fields=fields) as file:
        for time in range(6):
            place, push = draw.uniform(0.0, 9.0, (n, 2)), draw.normal(size=(n, 2))
            state = ifrdem.State(
                place, push, draw.normal(size=n), float(time), image=np.zeros((n, 2), np.int32)
            )
            file.write(state, {"temperature": 1.0, "rotational_temperature": 1.0, "collisions": 30 * time})
    run = ifrdem.Trajectory(tmp_path / "gas.h5")
    for name in ("velocity", "msd", "vacf", "species", "fields"):
        found = catalogue.FUNCTIONS[name](run, None)
        keys = [result.identifier(row.key or row.name) for row in found.rows]
        columns = {result.identifier(column) for column in found.tables[""]}
        assert len(set(keys)) == len(keys) > 0
        assert not columns & set(keys)
        assert all(len(key) <= 26 for key in keys), keys
        assert any("errors from 3 rows: fewer than 20" in note for note in found.notes) == (name == "species")


@pytest.mark.parametrize("collisions", [0, 1])
def test_one_collision_is_enough_for_a_value_from_their_rate_and_none_is_said(
    tmp_path: Path, collisions: int
) -> None:
    disks, draw = ifrdem.Disks(200, mass=1.0, radius=0.1), np.random.default_rng(3)
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, ifrdem.Box((20.0, 20.0))) as file:
        for time in range(2):
            position, velocity = draw.uniform(0.0, 20.0, (200, 2)), draw.normal(size=(200, 2))
            state = ifrdem.State(position, velocity, np.zeros(200), float(time))
            file.write(state, {"temperature": 1.0, "collisions": collisions * time})
    with ifrdem.Trajectory(tmp_path / "a.h5") as trajectory:
        if collisions:
            rows = catalogue.FUNCTIONS["pressure"](trajectory, None).rows
            assert "g_contact_from_rate" in [row.key for row in rows]
        else:
            with pytest.raises(ifrdem.InputError, match="there are no collisions"):
                catalogue.FUNCTIONS["pressure"](trajectory, None)


@pytest.mark.parametrize("rows", [1, 2])
def test_two_rows_of_a_series_are_enough_for_a_stress(tmp_path: Path, rows: int) -> None:
    """The stress of a row is the mean since the row before: p = (3 + 1) / 2, of the second row alone."""
    disks = ifrdem.Disks(2, mass=1.0, radius=0.1)
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, ifrdem.Box((2.0, 2.0))) as file:
        for time in range(2):
            file.write(ifrdem.State([[0.5, 0.5], [1.5, 1.5]], np.zeros((2, 2)), np.zeros(2), float(time)))
        for time in range(rows):
            stress = [3.0, 0.0, 0.0, 1.0] if time else [9.0, 0.0, 0.0, 9.0]
            file.write_series(float(time), dict.fromkeys(STRESS_SERIES, stress))
    with ifrdem.Trajectory(tmp_path / "a.h5") as trajectory:
        if rows == 2:
            found = catalogue.FUNCTIONS["stress"](trajectory, None).rows
            assert found[0].value == pytest.approx(2.0, rel=1e-12)
        else:
            with pytest.raises(ifrdem.InputError, match="two rows of the series"):
                catalogue.FUNCTIONS["stress"](trajectory, None)
