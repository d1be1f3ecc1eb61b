"""Runs whose next collision is far away, or never comes: one step, a refusal, or a message with the reason."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from ifrdem import (
    Box,
    ContactTime,
    Device,
    Disks,
    EngineError,
    IFRLaw,
    InelasticCollapse,
    InputError,
    NoMoreCollisions,
    Simulation,
    State,
    VelocityCutoff,
    Wall,
)
from ifrdem.simulation.steps.schedule import RunPoint
from ifrdem.simulation.steps.slow_run import SlowRunCheck

LAW = IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)


def flock(velocity: list[list[float]], box: Box | None = None, **options: Any) -> Simulation:
    """Disks of diameter 1 in a row, two diameters apart."""
    n = len(velocity)
    start = State([[1.0 + 2.0 * i, 2.0] for i in range(n)], velocity, np.zeros(n))
    return Simulation(
        Disks(n, mass=1.0, radius=0.5),
        box or Box((8.0, 8.0)),
        LAW,
        start,
        device=Device(threads=1),
        **options,
    )


def test_disks_of_one_velocity_fly_any_time_in_one_step() -> None:
    gas = flock([[1.0, 0.25]] * 3)
    gas.run(t_end=8.0e5, frames=1)
    assert gas.statistics.windows == 0
    # 8e5 is 1e5 boxes along x, and 2.5e4 along y: all are where they were.
    np.testing.assert_array_equal(gas.state.position, [[1.0, 2.0], [3.0, 2.0], [5.0, 2.0]])
    np.testing.assert_array_equal(gas.state.image, [[100_000, 25_000]] * 3)


def test_disks_of_one_velocity_never_collide_until_one_has_another() -> None:
    gas = flock([[1.0, 0.25]] * 3)
    with pytest.raises(NoMoreCollisions, match="all fly at one velocity"):
        gas.run(collisions_per_disk=2)
    gas = flock([[1.0, 0.25]] * 3)
    gas.run(t_end=8.0, frames=1)
    gas.set_velocities([[2.0, 0.25], [1.0, 0.25], [1.0, 0.25]])
    gas.run(t_end=8.5, frames=1)
    assert gas.collisions == 0
    gas.run(t_end=9.5, frames=1)  # a gap of 1 closes at the speed 1: at t = 9
    assert gas.collisions == 1


def test_a_flight_of_more_boxes_than_are_counted_is_refused() -> None:
    """They are counted in 32 bits: after 2e9 boxes of 8, 2^31 - 1 of them are left for 1.18e9 at the speed 1."""
    gas = flock([[1.0, 0.0]])
    gas.run(t_end=8.0 * 2.0e9, frames=1)
    assert gas.state.image[0, 0] == 2_000_000_000
    with pytest.raises(
        InputError,
        match=r"disks that never meet fly 1e\+30 .*2000000000 so far.*must be a time of at most 1\.2e\+09",
    ):
        gas.run(t_end=1e30)


def test_a_box_in_which_places_are_coarser_than_disks_is_refused() -> None:
    """A double has 53 binary digits: in 1e16, places are 2 apart, or 1 in single numbers."""
    with pytest.raises(InputError, match="f64 resolves positions to 4, which must be at most"):
        flock([[1.0, 0.0], [-1.0, 0.0]], Box((1e16, 1e16)))
    flock([[1.0, 0.0], [-1.0, 0.0]], Box((1e13, 1e13)))


def test_a_strain_beyond_the_digits_of_the_image_above_is_refused() -> None:
    """The image above comes rate Ly t = 8e13 for a rate of 1e13: rounded by 2^-53 of it, 0.009, of a radius of 0.5."""
    flock([[1.0, 0.0], [-1.0, 0.0]], Box((8.0, 8.0), shear_rate=1e11)).run(t_end=1e-11)
    with pytest.raises(InputError, match="images across a sheared box move by"):
        flock([[1.0, 0.0], [-1.0, 0.0]], Box((8.0, 8.0), shear_rate=1e13)).run(t_end=1.0)


class Clock:
    """Real time that tests set [s]."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_run_without_collisions_says_once_what_it_waits_for() -> None:
    clock = Clock()
    pace = SlowRunCheck(RunPoint(collisions=100), clock)

    def at(real: float, time: float, collisions: int) -> str | None:
        clock.now = real
        return pace.trouble(time, collisions, lambda: 3.0e12)

    assert at(5.0, 1.0, 0) is None
    assert at(20.0, 2.0, 0) is None
    assert at(40.0, 3.0, 1) is None  # there was one
    # 36 s for a time of 9: 3e12 take 1.2e13 s, which are 3.8e5 years of 365.25 days.
    text = at(76.0, 12.0, 1)
    assert text is not None
    assert "the mean time between two at this density and speed is 3e+12, 3.8e+05 years" in text
    assert at(120.0, 13.0, 1) is None


def test_a_run_with_a_distant_end_gives_a_warning() -> None:
    clock = Clock()
    pace = SlowRunCheck(RunPoint(time=1e10), clock)
    assert pace.trouble(0.0, 0, lambda: 1.0) is None
    clock.now = 31.557600
    # At a rate of 1 / 31.5576 s, 1e10 take 1e10 * 31.5576 s = 1e4 years.
    assert "reaches t_end = 1e+10 in 1e+04 years" in str(pace.trouble(1.0, 5, lambda: 1.0))
    pace = SlowRunCheck(RunPoint(time=1e10), clock)
    assert pace.trouble(0.0, 0, lambda: 1.0) is None
    clock.now += 31.0
    assert pace.trouble(1e8, 5, lambda: 1.0) is None


# ---------------------------------------------------------------------- rest


def ball(e_n: float, walls: tuple[Wall, ...] = (), **options: Any) -> Simulation:
    start = State([[2.0, 1.5]], [[0.0, 0.1]], np.zeros(1))
    box = Box((8.0, 8.0), periodic=(True, False))
    law = IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)
    return Simulation(
        Disks(1, mass=1.0, radius=0.5), box, law, start, walls=walls, device=Device(threads=1), **options
    )


DOWN = {"gravity": (0.0, -1.0)}


@pytest.mark.parametrize("remedy", [{"collapse": ContactTime(0.01)}, {"collapse": VelocityCutoff(0.01)}])
def test_no_rebound_and_elastic_slow_collisions_exclude_each_other(remedy: dict[str, Any]) -> None:
    """A hit with e_n = 0 leaves no speed, and an elastic collision without speed is none: the disk would rest."""
    with pytest.raises(InputError, match="disks that hit bottom with e_n = 0 stay there"):
        ball(0.0, **DOWN, **remedy)
    with pytest.raises(InputError, match="disks that hit wall 0 container"):
        ball(0.0, (Wall.container((4.0, 4.0), 3.9),), **remedy)
    ball(0.0, **remedy)  # flat walls at rest hold no disk without gravity
    gas = ball(0.5, **DOWN, **remedy)
    with pytest.raises(InputError, match="e_n = 0"):
        gas.set_law(IFRLaw(e_n=0.0, e_t=-1.0, mu=0.0))
    gas = ball(0.0, **remedy)
    with pytest.raises(InputError, match="e_n = 0"):
        gas.set_gravity((0.0, -1.0))


def message(gas: Simulation) -> str:
    with pytest.raises(InelasticCollapse) as stopped:
        gas.run(t_end=50.0, frames=1)
    return str(stopped.value)


@pytest.mark.full
def test_a_collapse_advises_what_is_not_set_and_could_help() -> None:
    text = message(ball(0.5, **DOWN))
    assert "ContactTime" in text
    assert "Rest(speed)" in text
    assert "a larger e_n" in text
    text = message(ball(0.0, **DOWN))
    assert "ContactTime" not in text  # which would be refused
    assert "Rest(speed)" in text
    text = message(ball(0.5, **DOWN, collapse=ContactTime(1e-49)))
    assert "a larger contact time" in text
    assert "Rest" not in text


def test_elastic_collisions_without_end_are_named_elastic() -> None:
    """A disk of diameter 1 between walls that are 1 apart."""
    slot = (Wall.line((0.0, 1.0), (0.0, 1.0)), Wall.line((0.0, 2.0), (0.0, -1.0)))
    text = message(ball(1.0, slot))
    assert "All these collisions are elastic" in text
    assert "e_n" not in text


def test_gravity_alone_does_not_press_disks_against_flat_walls_at_rest() -> None:
    assert not Wall.line((0.0, 0.0), (0.0, 1.0)).presses
    assert Wall.container((0.0, 0.0), 1.0).presses
    assert math.isfinite(ball(0.0, collapse=VelocityCutoff(0.01)).time)


# --- counters of 32 bits --------------------------------------------------------------------------------------


def test_boxes_travelled_are_refused_before_their_counter_is_full() -> None:
    """A lone disk at a speed of 1e9 in a box of side 1: 3e9 boxes in three runs were -1294967296."""
    start = State([[0.5, 0.5]], [[1e9, 0.0]], [0.0])
    gas = Simulation(
        Disks(1, mass=1.0, radius=0.1), Box((1.0, 1.0)), IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), start
    )
    for t in (1.0, 2.0):
        gas.run(t_end=t)
        assert gas.state.image[0, 0] == pytest.approx(1e9 * t, abs=1)
    with pytest.raises(InputError, match=r"200000000\d so far.* a time of at most 0\.1"):
        gas.run(t_end=3.0)
    gas.run(t_end=2.1)
    assert gas.state.image[0, 0] == pytest.approx(2.1e9, abs=1)


@pytest.mark.parametrize("counted", ["collisions", "wall_collisions", "image"])
def test_a_gas_whose_counters_are_nearly_full_is_ended(counted: str) -> None:
    """A disk has 2^31 - 1 of each: the next one was -2^31."""
    start = flock([[1.0, 0.0], [-1.0, 0.3], [0.0, 1.0]]).state
    setattr(start, counted, np.full_like(getattr(start, counted), 2**31 - 3))
    gas = Simulation(Disks(3, mass=1.0, radius=0.5), Box((8.0, 8.0)), LAW, start, device=Device(threads=1))
    with pytest.raises(EngineError, match="2147483647"):
        gas.run(t_end=10.0)
