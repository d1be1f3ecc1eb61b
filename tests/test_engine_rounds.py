"""Rounds over all disks, what a GPU runs: room in the log, collisions without number at one place, large arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from gases import ELASTIC

from ifrdem.box import Box
from ifrdem.engine import Engine
from ifrdem.kernels.layout import N_LOG
from ifrdem.state import Disks, State

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
    engine = Engine(disks, box, state, np.array([[ELASTIC]]), skin=1.0, order="rounds", windows=2, tile_disks=10**6)
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
