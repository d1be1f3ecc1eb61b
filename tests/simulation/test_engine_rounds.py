"""Rounds over all disks, what a GPU runs: room in the log, collisions without number at one place, large arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import taichi as ti
from support.gases import ELASTIC, equal_disks, equilibrated, run

import ifrdem.simulation.checks
from ifrdem.errors import InputError
from ifrdem.kernels.layout import LENGTH, N_LOG, OTHER, ROW, SAME_FRAME
from ifrdem.kernels.rounds import one_round, rounds_by_one_thread
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.model.walls import Wall
from ifrdem.simulation import device
from ifrdem.simulation.arrays import DeviceArrays
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.epochs import Epochs

pytestmark = pytest.mark.unoptimised


def watch_log(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """After every launch, see that no more was written than the log has room for; returns the kernels launched."""
    launch, launched = engine.arrays.launch, []

    def checked(kernel: Any, *numbers: float, **given: Any) -> None:
        launch(kernel, *numbers, **given)
        launched.append(kernel)
        assert engine.arrays.counter[N_LOG] <= engine.arrays.records

    monkeypatch.setattr(engine.arrays, "launch", checked)
    return launched


def test_a_wall_that_all_disks_hit_at_once_does_not_overfill_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    """A column of disks that reach it together after 4.5: n records in one round, in a log of n / 2 + 1024."""
    n = 2100
    column = np.column_stack((np.full(n, 4.0), 1.5 * (np.arange(n) + 0.5)))
    state = State(column, np.tile([1.0, 0.0], (n, 1)), np.zeros(n))
    box = Box((9.0, 1.5 * n), (False, True))
    engine = Engine(Disks(n, mass=1.0, radius=0.5), box, state, np.array([[ELASTIC]]), order="rounds")
    assert n > n // 2 + 1024
    watch_log(engine, monkeypatch)
    while engine.time < 6.0:
        engine.advance(t_end=6.0)
    end = engine.state()
    assert (end.wall_hits == 1).all()
    np.testing.assert_array_equal(end.velocity, np.tile([-1.0, 0.0], (n, 1)))
    np.testing.assert_allclose(end.position[:, 0], 8.5 - 1.5, rtol=1e-14)  # there after 4.5, and 1.5 back


def test_every_window_finds_room_in_the_log_for_all_disks(monkeypatch: pytest.MonkeyPatch) -> None:
    """32 rows of three disks, where the first hits the second at t = 0.1, and that the third at t = 0.3; 100 of two.

    Those meet at t = 0.3. An epoch is 0.5 / 1.15 = 0.43 long and has two windows: 32 records in the first, 132 at once
    in the second, and a log of 148, half the disks. Equal elastic disks exchange their velocities.
    """
    threes, twos = 32, 100
    row = np.concatenate((np.repeat(np.arange(threes), 3), threes + np.repeat(np.arange(twos), 2)))
    x = np.concatenate((np.tile([2.0, 3.1, 4.3], threes), np.tile([2.0, 3.3], twos)))
    first = np.diff(row, prepend=-1) > 0
    last = np.diff(row, append=row[-1] + 1) > 0
    n = len(row)
    velocity = np.column_stack((np.where(first, 1.0, 0.0), np.zeros(n)))
    state = State(np.column_stack((x, 2.5 * (row + 0.5))), velocity, np.zeros(n))
    box = Box((12.0, 2.5 * (threes + twos)))
    disks = Disks(n, mass=1.0, radius=0.5)
    engine = Engine(
        disks, box, state, np.array([[ELASTIC]]), skin=1.0, order="rounds", windows=2, tile_disks=10**6
    )
    engine.epochs.log_growth = 1  # keep the log short
    engine.arrays.make_log(n // 2)
    assert engine.arrays.records == n // 2 == 148
    watch_log(engine, monkeypatch)
    while engine.time < 0.4:
        engine.advance(t_end=0.4)
    assert engine.statistics.cut_for_log > 0
    assert engine.collisions == 2 * threes + twos
    end = engine.state()
    np.testing.assert_array_equal(end.velocity[:, 0], np.where(last, 1.0, 0.0))
    np.testing.assert_allclose(end.position[last, 0], x[last] + 0.1, rtol=1e-14)


@pytest.mark.parametrize("order", ["alone", "tiles", "rounds"])
def test_more_collisions_at_one_time_than_an_epoch_has_rounds_are_no_collapse(order: str) -> None:
    """A light disk between two heavy ones that it touches, one of which moves: a billiard in the tip of a wedge.

    In coordinates scaled by the roots of the masses, elastic collisions reflect at two lines under the angle theta,
    cos theta = sqrt(m_1 m_3 / (m_1 + m_2) / (m_2 + m_3)). Unfolded, the path comes along one of the lines (light and
    second heavy disk have one velocity), goes straight through the tip, and so crosses the lines at theta, 2 theta, ...
    before pi: ceil(pi / theta) - 1 collisions, all at t = 0.
    """
    mass = np.array([1.0, 1e-6, 1.0])
    theta = math.acos(math.sqrt(mass[0] * mass[2] / (mass[0] + mass[1]) / (mass[1] + mass[2])))
    count = math.ceil(math.pi / theta) - 1
    assert count == 2221
    disks = Disks(3, mass=mass, radius=0.5)
    position = np.column_stack(([4.0, 5.0, 6.0], np.full(3, 3.0)))
    state = State(position, np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.zeros(3))
    engine = Engine(disks, Box((40.0, 6.0)), state, np.array([[ELASTIC]]), order=order)
    while engine.time < 1.0:
        engine.advance(t_end=1.0)
    assert engine.collisions == count
    end = engine.state().velocity[:, 0]
    assert mass @ end == pytest.approx(1.0, rel=1e-12)
    assert mass @ end**2 == pytest.approx(1.0, rel=1e-12)


def test_on_a_gpu_no_round_is_left_to_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds of a small gas, as `arch="cuda"` runs them, here on the CPU: a GPU's thread takes 20 ms for them."""
    disks = equal_disks(100)
    box, state = equilibrated(disks, 0.3)
    engine = Engine(disks, box, state, np.array([[ELASTIC]]), order="rounds")
    engine.epochs = Epochs(engine.arrays, engine.statistics, "rounds", arch="cuda")
    launched = watch_log(engine, monkeypatch)
    run(engine, 100)
    assert one_round in launched
    assert rounds_by_one_thread not in launched


def test_the_log_grows_only_as_far_as_its_indices_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    """11 numbers a record. Where the log cannot be doubled, epochs get shorter."""
    disks = equal_disks(500)
    box, state = equilibrated(disks, 0.6)
    engine = Engine(disks, box, state, np.array([[ELASTIC]]), skin=3.0, order="rounds", tile_disks=10**6)
    assert 11 * engine.arrays.most_records <= 2**31 - 1 < 11 * (engine.arrays.most_records + 1)
    engine.arrays.make_log(disks.n // 2)
    monkeypatch.setattr(DeviceArrays, "most_records", 545)
    run(engine, 2500)
    assert engine.statistics.cut_for_log > 2
    assert engine.arrays.records == 500  # doubled once


def test_more_disks_than_the_heat_of_thermal_walls_has_indices_for_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ifrdem.simulation.checks, "ADDRESSABLE", 100)
    hot = [Wall.line((0.0, y), (0.0, 1.0), temperature=1.0) for y in (0.0, 0.1)]
    state = State(
        np.column_stack((2.0 * np.arange(51) + 1.0, np.full(51, 3.0))), np.zeros((51, 2)), np.zeros(51)
    )
    with pytest.raises(InputError, match=r"51 disks and 2 thermal walls.*allow 50 disks"):
        Engine(
            Disks(51, mass=1.0, radius=0.5),
            Box((102.0, 6.0), (True, False)),
            state,
            np.array([[ELASTIC]]),
            walls=hot,
        )


@pytest.mark.parametrize("shift", [SAME_FRAME, SAME_FRAME + 1])
def test_an_entry_that_is_not_written_yet_is_not_in_a_list(shift: int) -> None:
    """While lists are extended, a thread raises a list's length and then writes the entry; another may look in between.

    Disk 0 has neighbour 1 in its frame and 2 in another one; a third entry is announced, and in its place disk 7 stands
    from an earlier epoch. To count it as listed would lose the pair 0 and 7.
    """
    device.start("cpu")
    from support.list_kernels import list_of_first_has, raise_first

    def entry(slot: int) -> int:
        return slot if shift == SAME_FRAME else 9 * slot + shift

    grid = np.zeros(14, dtype=np.int32)
    grid[ROW] = 6
    link = ti.Vector.ndarray(8, ti.i32, (8,))
    rows = np.zeros((8, 8), dtype=np.int32)
    rows[0, LENGTH] = 1 + OTHER
    link.from_numpy(rows)
    neighbour = ti.ndarray(ti.i32, (48,))
    own = [1, 7, 0, 0, 0, 9 * 2 + shift]
    others = [1, 0, 0, 0, entry(7), entry(2)]
    neighbour.from_numpy(np.array([*(own if shift == SAME_FRAME else others), *[0] * 42], dtype=np.int32))
    raise_first(1, grid, link, np.zeros(17, dtype=np.int32))
    rows = link.to_numpy()
    rows[0, LENGTH] += 1 if shift == SAME_FRAME else OTHER
    link.from_numpy(rows)
    assert list_of_first_has(1 if shift == SAME_FRAME else 2, shift, grid, link, neighbour) == 1
    assert list_of_first_has(7, shift, grid, link, neighbour) == 0
