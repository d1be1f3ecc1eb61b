"""Gravity that rotates in steps: flight compared with the exact integral, work, waking, refusals."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.gases import boxed

from ifrdem import Rest, RotatingGravity
from ifrdem.errors import InputError
from ifrdem.initial import random_positions
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.simulation import Simulation

ROUGH = IFRLaw(e_n=0.6, e_t=-1.0, mu=0.5)
BOX = Box((12.0, 12.0), periodic=(False, False))


def turns(rate: float, **step: float) -> RotatingGravity:
    """Gravity of size 1 that points down at first."""
    return RotatingGravity((0.0, -1.0), rate=rate, **step)


def in_room(position: Any, velocity: Any = None, law: IFRLaw = ROUGH, **options: Any) -> Simulation:
    """Disks in a box of 12 x 12 with walls all around, g = 1."""
    return boxed(position=position, velocity=velocity, law=law,
                 **{"gravity": turns(0.05), "record": ["ledger"], "box": BOX} | options)  # fmt: skip


def drum(**options: Any) -> Simulation:
    """Forty disks of three sizes in a drum of radius 5.5, which may rest."""
    wall, radius = Wall.container((6.0, 6.0), 5.5), np.repeat([0.4, 0.5, 0.6], [14, 13, 13])
    start = State(random_positions(BOX, radius, seed=1, walls=[wall]), np.zeros((40, 2)), np.zeros(40))
    given = {"gravity": turns(-0.04, step=0.01)} | options
    return Simulation(
        Disks(40, mass=radius**2, radius=radius), BOX, ROUGH, start, walls=[wall], record=["ledger"],
        collapse=Rest(0.05), **given,
    )  # fmt: skip


def test_a_flight_converges_to_that_in_gravity_that_turns_all_the_time() -> None:
    """g (sin W t, -cos W t) gives x = g / W (t - sin(W t) / W), y = -g / W^2 (1 - cos W t): errors of second order."""
    rate, t = 0.5, 3.0
    exact = np.array([(t - math.sin(rate * t) / rate) / rate, -(1.0 - math.cos(rate * t)) / rate**2])
    errors = []
    for step in (0.1, 0.05, 0.025):
        run = in_room([[3.0, 8.0]], gravity=turns(rate, step=step))
        run.run(t_end=t)
        errors.append(np.linalg.norm(run.state.position[0] - [3.0, 8.0] - exact))
    assert errors[0] < 1e-2
    # 15, 30 and 60 whole steps: the error falls fourfold, but for terms of the next order.
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.02)


def test_the_change_of_potential_energy_is_put_in_and_elastic_disks_lose_nothing() -> None:
    """Every step puts in -m (g' - g).x, here from places at its time; g after k steps is turned by k times 0.05."""
    position = random_positions(BOX, np.full(8, 0.5), seed=2)
    law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    run = in_room(position, np.full((8, 2), 0.3), law, gravity=turns(0.1, step=0.05))
    first, work = run.measure().energy - np.sum(position @ run.gravity), 0.0
    for k in range(20):
        run.run(t_end=(k + 0.5) * 0.5)
        now, then = ((math.sin(0.05 * i), -math.cos(0.05 * i)) for i in (k, k + 1))
        np.testing.assert_allclose(run.gravity, then, atol=1e-15)
        work -= float(np.sum(run.state.position @ np.subtract(then, now)))
        assert run.energy_input == pytest.approx(work, abs=1e-12)
    assert run.wall_collisions > 0
    assert run.measure().energy - np.sum(run.state.position @ run.gravity) == pytest.approx(
        first + work, rel=1e-12
    )
    assert abs(run.dissipated_energy) < 1e-11


@pytest.mark.full
@pytest.mark.parametrize(("rate", "others"), [(0.01, 0), (-0.01, 0), (0.01, 1)])
def test_a_disk_wakes_when_rolling_friction_holds_it_no_longer(rate: float, others: int) -> None:
    """On a floor it is held while tan(angle) < rho / R. Steps of 0.1 degrees; it wakes 0.003 g / cos later at most.

    So it does where another one, behind a wall, jumps on, for which windows follow one another.
    """
    law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.5, rho=0.5 * math.tan(math.radians(10.0)))
    run = in_room(
        [[8.0, 0.5], [2.0, 9.0]][: 1 + others], law=law, walls=[Wall.segment((4.0, 0.0), (4.0, 12.0))],
        collapse=Rest(0.02), gravity=turns(rate, step=math.radians(0.1)),
    )  # fmt: skip
    run.run(t_end=math.radians(9.8) / 0.01)
    assert run.asleep == 1
    place = run.state.position[0, 0]
    run.run(t_end=math.radians(10.6) / 0.01)
    assert run.asleep == 0
    run.run(t_end=math.radians(14.0) / 0.01)
    assert (run.state.position[0, 0] - place) * rate > 0.0


@pytest.mark.full
def test_a_drum_flows_its_ledger_closes_and_looks_and_checkpoints_change_no_bit(tmp_path: Path) -> None:
    def end(run: Simulation) -> tuple[Any, ...]:
        state = run.state
        return state.position, state.velocity, state.spin, state.asleep, state.collisions, run.gravity

    plain, numbers = drum(), []
    plain.run(t_end=24.0, series=48, series_callbacks=[lambda measure: numbers.append(measure.asleep)])
    # They come to rest, but not on a slope of 0.96 rad, which would be there without avalanches.
    rested = int(np.argmax(numbers))
    assert numbers[rested] > 30
    assert min(numbers[rested:]) < 30
    lost = plain.measure().dissipated
    assert lost is not None
    assert plain.energy_input > 0.0
    assert plain.dissipated_energy == pytest.approx(lost.sum(), rel=1e-12)
    looked = drum()
    looked.run(t_end=24.0, frames=61, frame_callbacks=[lambda state, measure: None])
    stopped = drum()
    for k, stop in enumerate((0.1, 5.3, 16.125)):  # the last one where gravity turns
        stopped.run(t_end=stop)
        stopped.save_checkpoint(tmp_path / f"{k}.h5")
        stopped = drum()
        stopped.load_checkpoint(tmp_path / f"{k}.h5")
    stopped.run(t_end=24.0)
    for other in (looked, stopped):
        assert other.energy_input == plain.energy_input
        for found, expected in zip(end(other), end(plain), strict=True):
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"box": Box((12.0, 12.0), periodic=(True, False))}, r"combined with box.periodic = \(True, False\)"),
        ({"histories": [0]}, "histories: cannot be combined with gravity = Rot"),
    ],
)
def test_gravity_that_cannot_turn_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        in_room([[6.0, 6.0]], **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": (0.0, 0.0)}, r"start = \(0\.0, 0\.0\): must not be \(0, 0\)"),
        ({"rate": math.inf}, "rate = inf: must be a finite number"),
        ({"rate": 0.0}, "rate = 0: must not be 0"),
        ({"step": 0.0}, r"step = 0\.0: must be an angle above 0 and up to 0\.1 rad"),
        ({"step": 0.11}, r"step = 0\.11: must be an angle"),
    ],
)
def test_a_rotation_without_direction_rate_or_step_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RotatingGravity(**({"start": (0.0, -1.0), "rate": 0.05} | change))


def test_gravity_that_turns_cannot_be_set() -> None:
    with pytest.raises(InputError, match=r"cannot be set where gravity rotates \(RotatingGravity"):
        in_room([[6.0, 6.0]]).set_gravity((1.0, 0.0))
