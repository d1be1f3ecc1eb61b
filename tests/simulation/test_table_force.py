"""Coins on a table: friction as a force between collisions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from support.gases import COIN, equal_disks, run_to, start

from ifrdem import Device
from ifrdem.errors import InputError, NoMoreCollisions
from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, RandomKicks, TableFriction
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.simulation import backend
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.paper import table_reference
from ifrdem.validation.rows import engine_of

HEAD_ON = IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0)  # no friction between coins
BOX = Box((400.0, 400.0))


def table(step: float) -> TableFriction:
    """mu g = 1: speeds and lengths are reduced."""
    return TableFriction(step, mu=0.25, gravity=4.0)


def apart(n: int) -> np.ndarray:
    """Places far from each other, shape (n, 2)."""
    return np.column_stack((np.full(n, 100.0), 20.0 * np.arange(n) + 10.0))


def slope(errors: list[float]) -> float:
    return math.log2(errors[0] / errors[-1]) / (len(errors) - 1)


V, U = np.array([1.0, 0.8, 0.3, 0.9]), np.array([0.5, -0.9, 1.2, 0.2])  # speeds, R omega; R = 1/2


def slid(step: float, t_end: float) -> State:
    n = len(V)
    direction = np.array([0.6, -0.8])
    begin = State(apart(n), V[:, None] * direction, 2.0 * U)
    run = Simulation(Disks(n, mass=2.0, radius=0.5), BOX, HEAD_ON, begin, forces=[table(step)])
    run.run(t_end=t_end)
    assert run.energy_input == pytest.approx(
        measure(run.disks, run.state).energy - measure(run.disks, begin).energy, rel=1e-13
    )
    return run.state


def test_coins_move_as_by_an_independent_integrator_with_second_order_errors() -> None:
    """Speeds and spins at multiples of the step are exact; distances by straight flights between kicks, trapezia."""
    t_end = 0.25  # all move still
    expected = np.array([table_reference.fly(v, abs(u), 2.0, t_end) for v, u in zip(V, U, strict=True)])
    errors = []
    for step in (0.0625, 0.03125, 0.015625):
        end = slid(step, t_end)
        np.testing.assert_allclose(np.hypot(*end.velocity.T), expected[:, 0], rtol=1e-10)
        np.testing.assert_allclose(0.5 * end.spin, np.sign(U) * expected[:, 1], rtol=1e-10)
        np.testing.assert_allclose(end.velocity[:, 1] / end.velocity[:, 0], -0.8 / 0.6, rtol=1e-14)
        errors.append(float(np.abs(np.hypot(*(end.position - apart(len(V))).T) - expected[:, 2]).max()))
    assert 1.9 < slope(errors) < 2.1


def test_coins_stop_at_the_right_distance_and_time() -> None:
    """Distance: off by mu g step^2 / 8 at most for the last step, and as much for all before it. Time: the kicks at
    which the spins and speeds vanish enclose it, because speeds are exact at multiples of the step."""
    expected = np.array([table_reference.fly(v, abs(u), 2.0) for v, u in zip(V, U, strict=True)])
    for step in (0.04, 0.01):
        end = slid(step, 2.0)
        assert not end.velocity.any()
        assert not end.spin.any()
        distance = np.hypot(*(end.position - apart(len(V))).T)
        np.testing.assert_allclose(distance, expected[:, 2], atol=0.25 * step**2)
        for i, stop in enumerate(expected[:, 3]):
            last = math.floor(stop / step) * step  # the last multiple of the step at which it moves
            assert slid(step, last + 0.1 * step).velocity[i].any()
            assert not slid(step, last + 1.1 * step).velocity[i].any()


def test_a_pair_that_collides_underway_stops_where_it_should() -> None:
    """A coin hits a resting one head-on: v^2 = v_0^2 - 2 d, then (1 -+ e) v / 2 each, which stop after v^2 / 2.

    An impact early or late in a step comes with a velocity that is up to mu g step / 2 too high or too low, by turns:
    over all phases the errors cancel to the second order; each alone is of the first.
    """
    v0, phases, means, worst = 1.5, 32, [], []
    for step in (0.08, 0.04, 0.02):
        time = 0.4 + step * (np.arange(phases) + 0.5) / phases  # of the contact: all phases of a step
        d = v0 * time - time**2 / 2.0
        left = apart(2 * phases)[::2] * [1.0, 0.3]
        place = np.concatenate([left, left + np.column_stack((d + 1.0, np.zeros(phases)))])
        velocity = np.zeros((2 * phases, 2))
        velocity[:phases, 0] = v0
        begin = State(place, velocity, np.zeros(2 * phases))
        run = Simulation(equal_disks(2 * phases), BOX, HEAD_ON, begin, forces=[table(step)])
        run.run(t_end=3.0)
        assert run.collisions == phases
        assert not run.state.velocity.any()
        v = v0 - time
        moved = (run.state.position - place)[:, 0]
        off = moved - np.concatenate([d + (0.1 * v) ** 2 / 2.0, (0.9 * v) ** 2 / 2.0])
        means.append(abs(float(off[phases:].mean())))
        worst.append(float(np.abs(off).max()))
    assert 1.7 < slope(means) < 2.3
    assert 0.7 < slope(worst) < 1.3
    assert worst[-1] < 0.02 * v0  # of the order of (1 - e) mu g step / 2 times the time to stop


@pytest.mark.full
@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_a_gas_that_has_come_to_rest_goes_to_the_end_at_no_cost(order: str) -> None:
    """The ledger is complete: friction and collisions have taken all energy."""
    disks = equal_disks(200)
    box, state = start(disks, 0.3)
    engine = engine_of(
        disks,
        box,
        state,
        np.array([[COIN]]),
        forces=[table(0.05)],
        order=order,
        tile_disks=60,
        device=Device(threads=2),
    )
    rest = run_to(engine, 20.0)
    assert not rest.velocity.any()
    assert not rest.spin.any()
    assert engine.force_steps.energy_inputs[0] < 0.0
    windows = engine.statistics.windows
    engine.advance(t_end=1e9)  # 2e10 steps
    assert engine.time == 1e9
    assert engine.statistics.windows == windows
    np.testing.assert_array_equal(engine.state().position, rest.position)
    with pytest.raises(NoMoreCollisions, match="no disk can meet another"):
        engine.advance(collisions=engine.collisions + 1)


def test_resting_spins_are_braked_before_a_gas_goes_to_the_end() -> None:
    """u = R omega = 1 stops after u / (k T a), T = 2/3: at 0.75. Nothing moves meanwhile."""
    disks = equal_disks(4)
    begin = State(apart(4), np.zeros((4, 2)), np.full(4, 2.0))
    run = Simulation(disks, BOX, HEAD_ON, begin, forces=[table(0.1)])
    run.run(t_end=0.7)
    np.testing.assert_allclose(0.5 * run.state.spin, 1.0 - 0.7 / 0.75, rtol=1e-10)
    run.run(t_end=1e6)
    assert not run.state.spin.any()
    assert run.energy_input == pytest.approx(-measure(disks, begin).energy, rel=1e-14)


@pytest.mark.full
def test_resting_is_left_only_with_forces_that_set_in_motion() -> None:
    disks = equal_disks(4)
    begin = State(apart(4), np.zeros((4, 2)), np.zeros(4))
    run = Simulation(
        disks, BOX, HEAD_ON, begin, forces=[table(0.1), RandomKicks(0.5, power=1.0), Drag(0.1, rate=1.0)]
    )
    run.run(t_end=1.0)
    assert run.state.velocity.any()


@pytest.mark.full
def test_threads_orders_and_precisions_agree() -> None:
    disks = equal_disks(300)
    box, state = start(disks, 0.3)

    def end(order: str, **options: Any) -> State:
        engine = engine_of(
            disks, box, state, np.array([[COIN]]), forces=[table(0.05)], order=order, tile_disks=60, **options
        )
        reached = run_to(engine, 0.4)
        assert engine.collisions > 30
        return reached

    # Another number of threads, or precision, restarts Taichi.
    alone, two, one, single = (
        end("serial"),
        end("tiled", device=Device(threads=min(2, backend.cores()))),
        end("tiled", device=Device(threads=1)),
        end("serial", device=Device(precision="f32")),
    )
    np.testing.assert_allclose(single.position, alone.position, atol=1e-3)
    for name in ("position", "velocity", "spin"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    np.testing.assert_allclose(alone.position, one.position, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mu": 0.0}, r"mu = 0\.0: must be"),
        ({"mu": 0.2, "gravity": -1.0}, "gravity = -1.0: must be a positive number"),
    ],
)
def test_friction_without_strength_is_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        TableFriction(0.1, **options)


def test_a_tilted_table_is_refused() -> None:
    begin = State(apart(2), np.zeros((2, 2)), np.zeros(2))
    box = Box((400.0, 400.0), (True, False))
    with pytest.raises(InputError, match=r"forces\[0\] = <TableFriction: .* combined with gravity = "):
        Simulation(equal_disks(2), box, HEAD_ON, begin, forces=[table(0.1)], gravity=(0.0, -1.0))
