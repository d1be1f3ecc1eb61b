"""Inelastic collapse: its beginning, the two remedies, and the end of a run without one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from support.gases import COIN, ELASTIC, equal_disks, equilibrated, partners, run, run_to
from support.serial_reference import simulate

from ifrdem import ContactTime, Device, Rest, VelocityCutoff
from ifrdem.errors import InelasticCollapse, InputError
from ifrdem.model.box import Box
from ifrdem.model.collapse import Collapse
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import State
from ifrdem.simulation import backend
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.rows import engine_of

ORDERS = ("serial", "tiled")
INELASTIC = (0.6, *ELASTIC[1:])


def n_elastic(n: int, collisions: list[tuple[float, int, int]], contact_time: float) -> int:
    """How many of these collisions the tc rule makes elastic, straight from its definition."""
    latest = [-math.inf] * n
    found = 0
    for t, i, j in collisions:
        found += t - latest[i] < contact_time or t - latest[j] < contact_time
        latest[i] = latest[j] = t
    return found


# --- the tc rule ----------------------------------------------------------------------------------------------


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("packing_fraction", "law"), [(0.3, COIN), (0.65, INELASTIC)])
def test_collisions_by_the_tc_rule_are_those_of_the_serial_code(
    order: str, packing_fraction: float, law: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five collisions a disk, over several windows; a contact time that makes a third or so of them elastic."""
    disks = equal_disks(500)
    box, state = equilibrated(disks, packing_fraction)
    contact_time = 0.1 if packing_fraction < 0.5 else 0.02
    monkeypatch.setattr(
        "ifrdem.simulation.windows.tiling.SINGLE_TILE", 100
    )  # short windows, as of gases that are divided
    engine = engine_of(
        disks, box, state, np.array([[law]]), order=order, tile_disks=60, collapse=ContactTime(contact_time)
    )
    count = 1250
    end, expected = simulate(disks, box, law, state, max_collisions=count, contact_time=contact_time)
    elastic = n_elastic(disks.n, expected, contact_time)
    assert 0.15 * count < elastic < 0.7 * count
    np.testing.assert_array_equal(
        partners(run(engine, count).pair), partners(np.array([sorted(one[1:]) for one in expected]))
    )
    assert engine.statistics.windows > 2
    assert engine.statistics.elastic == elastic
    found = engine.state()
    np.testing.assert_allclose(found.latest_collision, end.latest_collision, atol=1e-7)
    np.testing.assert_allclose(found.velocity, end.velocity, atol=1e-5)
    other = simulate(disks, box, law, state, max_collisions=count)[1]
    assert [one[1:] for one in other] != [one[1:] for one in expected]  # the rule mattered


def test_a_stored_state_has_the_latest_collision_times() -> None:
    disks = equal_disks(500)
    box, state = equilibrated(disks, 0.65)

    def engine(state: State) -> Engine:
        return engine_of(disks, box, state, np.array([[INELASTIC]]), collapse=ContactTime(0.02))

    first = engine(state)
    run(first, 500)
    half = first.state()
    assert np.isfinite(half.latest_collision).mean() > 0.5
    on = run(first, 500).pair
    assert np.array_equal(partners(run(engine(half), 500).pair), partners(on))
    forgot = run(engine(replace(half, latest_collision=None)), 500).pair
    assert not np.array_equal(partners(np.array(forgot)), partners(on))


@pytest.mark.full
@pytest.mark.skipif(backend.cores() < 2, reason="needs two cores")
@pytest.mark.parametrize("order", ["tiled"])
def test_the_tc_rule_gives_the_same_bits_on_two_threads(order: str) -> None:
    disks = equal_disks(1000)
    box, state = equilibrated(disks, 0.6)
    ends = []
    for threads in (2, 1):
        engine = engine_of(
            disks,
            box,
            state,
            np.array([[COIN]]),
            device=Device(threads=threads),
            order=order,
            tile_disks=200,
            collapse=ContactTime(0.02),
        )
        ends.append((run_to(engine, collisions=3000), engine.statistics.elastic))
    assert ends[0][1] == ends[1][1] > 300
    for name in ("position", "velocity", "spin", "collisions", "latest_collision"):
        np.testing.assert_array_equal(getattr(ends[0][0], name), getattr(ends[1][0], name))


@pytest.mark.full(keep=("1.49-0-f64", "1.51-1-f64"))
@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize(("contact_time", "elastic"), [(1.49, 0), (1.51, 1)])
def test_a_collision_soon_after_another_is_elastic(contact_time: float, elastic: int, precision: str) -> None:
    """Disk 0 hits disk 1 at t = 1, which hits disk 2 with what it got, (1 + e_n) / 2 = 3/4, at t = 2.5: 1.5 later.

    The run is cut in between, so that the time must be kept from one window to the next; at a late time, so that
    single precision could not resolve.
    """
    disks = equal_disks(3)
    x = 10.0 + np.array([0.0, 2.0, 4.125])
    state = State(
        np.column_stack((x, np.full(3, 3.0))),
        np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        np.zeros(3),
        time=1e6,
    )
    law = np.array([[(0.5, *ELASTIC[1:])]])
    engine = engine_of(
        disks,
        Box((40.0, 6.0)),
        state,
        law,
        device=Device(precision=precision),
        collapse=ContactTime(contact_time),
    )
    for t in (1.7, 2.0, 3.0):
        run_to(engine, 1e6 + t)
    second = 1.0 if elastic else 0.75
    assert engine.statistics.elastic == elastic
    np.testing.assert_allclose(
        engine.state().velocity[:, 0], [0.25, 0.75 * (1.0 - second), 0.75 * second], atol=1e-6
    )


@pytest.mark.full
def test_a_bouncing_ball_ends_with_bounces_shorter_than_the_contact_time() -> None:
    """Dropped from 2.5 above contact with g = 1 it bounces with speeds v_k = sqrt(5) 2^-k, flights of 2 v_k / g.

    Collision k + 1 is elastic once 2 v_k / g < contact time: k = 8 is the first with 2 v_k < 0.02.
    """
    start = State(np.array([[5.0, 3.0]]), np.zeros((1, 2)), np.zeros(1))
    law = np.array([[(0.5, *ELASTIC[1:])]])
    engine = engine_of(
        equal_disks(1),
        Box((10.0, 10.0), (True, False)),
        start,
        law,
        gravity=(0.0, -1.0),
        collapse=ContactTime(0.02),
    )
    state, speed = run_to(engine, 30.0), math.sqrt(5.0) / 2.0**8
    at_floor = math.sqrt(state.velocity[0, 1] ** 2 + 2.0 * (state.position[0, 1] - 0.5))
    assert at_floor == pytest.approx(speed, rel=1e-6)
    assert engine.statistics.elastic == engine.wall_collisions - 8 > 1000
    assert 30.0 - 2.0 * speed <= state.latest_collision[0] <= 30.0


@pytest.mark.full
def test_a_column_of_disks_comes_to_rest_on_a_floor() -> None:
    """Ten disks fall onto each other. What is left is a jitter of bounces that are shorter than the contact time.

    Its energy is of the order of m (g t_c)^2, and each contact collides about once per contact time: finite cost.
    """
    n, contact_time, g = 10, 0.01, 1.0
    position = np.column_stack((np.full(n, 5.0), 1.0 + 1.3 * np.arange(n)))
    engine = engine_of(
        equal_disks(n),
        Box((10.0, 16.0), (True, False)),
        State(position, np.zeros((n, 2)), np.zeros(n)),
        np.array([[INELASTIC]]),
        gravity=(0.0, -g),
        collapse=ContactTime(contact_time),
    )
    resting, events = run_to(engine, 40.0), engine.collisions + engine.wall_collisions
    end = run_to(engine, 50.0)
    np.testing.assert_allclose(resting.position[:, 1], 0.5 + np.arange(n), atol=0.05)
    assert 0.5 * np.mean(end.velocity**2) < 10.0 * (g * contact_time) ** 2
    rate = (engine.collisions + engine.wall_collisions - events) / n / 10.0
    assert 0.3 / contact_time < rate < 10.0 / contact_time


# --- gases that collapse --------------------------------------------------------------------------------------


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(
    "law", [IFRLaw(e_n=0.4, e_t=-1.0, mu=0.0), IFRLaw(e_n=0.4, e_t=-0.5, mu=0.3)], ids=["smooth", "rough"]
)
@pytest.mark.parametrize("collapse", [None, ContactTime(1e-3), VelocityCutoff(1e-3)], ids=str)
def test_a_gas_that_collapses_ends_or_reports_it(collapse: Collapse | None, law: IFRLaw) -> None:
    """e_n = 0.4 at phi = 0.6, 200 collisions a disk. The mean free time is 0.09, the thermal speed 1."""
    disks = equal_disks(300)
    box, state = equilibrated(disks, 0.6)
    gas = Simulation(disks, box, law, state, collapse=collapse)
    message = ""
    try:
        gas.run(collisions_per_disk=200.0)
    except InelasticCollapse as stopped:
        message = str(stopped)
    if collapse is None and message:
        assert "collapse = ContactTime(time)" in message
    else:
        assert message == ""
        assert 30_000 <= gas.collisions < 30_200  # those at one and the same time are not parted
        assert (gas.statistics.elastic > 100) == (collapse is not None)


def three_in_a_row(e_n: float, most: int) -> tuple[list[tuple[Fraction, int, Fraction]], list[Fraction]]:
    """Three equal particles on a line in rational arithmetic: each collision's time, pair (0 or 1) and approach.

    And the velocities at the end. Only neighbours collide, and each collision turns their relative velocity g into
    -e_n g and gives each of the two half of the change.
    """
    gap, v, now = list(GAPS), list(VELOCITY), Fraction(0)
    found: list[tuple[Fraction, int, Fraction]] = []
    while len(found) < most:
        closing = [v[0] - v[1], v[1] - v[2]]
        # A pair that has just collided separates: its closing speed is not above 0.
        due = [(gap[pair] / closing[pair], pair) for pair in range(2) if closing[pair] > 0]
        if not due:
            break
        delay, pair = min(due)
        now += delay
        gap = [gap[i] - closing[i] * delay for i in range(2)]
        found.append((now, pair, closing[pair]))
        push = (1 + Fraction(e_n)) / 2 * closing[pair]
        v[pair] -= push
        v[pair + 1] += push
    return found, v


GAPS = (Fraction(1), Fraction(3, 4))
VELOCITY = (Fraction(1), Fraction(0), Fraction(-1, 4))
CRITICAL = 7.0 - 4.0 * math.sqrt(3.0)


def row_of_three(e_n: float) -> Simulation:
    x = np.array([10.0, 11.0 + float(GAPS[0]), 12.0 + float(GAPS[0] + GAPS[1])])
    velocity = np.column_stack(([float(v) for v in VELOCITY], np.zeros(3)))
    state = State(np.column_stack((x, np.full(3, 3.0))), velocity, np.zeros(3))
    return Simulation(equal_disks(3), Box((40.0, 6.0)), IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0), state)


@pytest.mark.parametrize("e_n", [0.076, 0.08, 0.1, 0.15, 0.3, 0.7, 1.0])
def test_three_disks_collide_a_finite_number_of_times_above_the_critical_restitution(e_n: float) -> None:
    """McNamara and Young (1992), doi:10.1063/1.858323: above e_n = 7 - 4 sqrt(3), as often as rational arithmetic says.

    The row is along x, and disks cannot leave it. Velocities depend on the sequence alone, and come out to the rounding
    of numbers near 1; times as well as gaps are known, some 1e-14, over the speed that closes them: 1e-8 for the last
    of the 14 collisions at e_n = 0.076, which brings them to 1/4 up to 7e-9.
    """
    assert e_n > CRITICAL
    expected, velocity = three_in_a_row(e_n, 1000)
    gas = row_of_three(e_n)
    found = gas.collide_until(20.0)
    assert [int(pair[0]) for pair in found.pair] == [pair for _, pair, _ in expected]
    error = np.abs(found.time - [float(t) for t, _, _ in expected])
    assert np.all(error < 4e-13 / np.minimum.accumulate([float(approach) for _, _, approach in expected]))
    np.testing.assert_allclose(gas.state.velocity[:, 0], [float(v) for v in velocity], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize(("e_n", "digits"), [(0.0717, 5e-3), (0.07, 2e-4), (0.05, 2e-8), (0.01, 2e-11)])
def test_three_disks_collapse_below_the_critical_restitution(e_n: float, digits: float) -> None:
    """Infinitely many collisions until a finite time, after which all three stay together, with one velocity.

    Near the critical value gaps vanish faster than the time that is left: they are below the rounding of positions when
    some of it is still to come, and the rest happens at once.
    """
    assert e_n < CRITICAL
    expected, velocity = three_in_a_row(e_n, 60)
    assert len(expected) == 60
    assert velocity[0] - velocity[2] < 1e-15
    gas = row_of_three(e_n)
    found = gas.collide_until(20.0)
    assert len(found.time) >= 14
    end = gas.state
    assert np.all(np.diff(found.time) >= 0.0)
    for time, pair, (exact, expected_pair, approach) in zip(
        found.time, found.pair, expected[:8], strict=False
    ):
        assert pair[0] == expected_pair
        assert abs(time - exact) < 4e-13 / approach
    assert found.time[-1] == pytest.approx(float(expected[-1][0]), rel=digits)
    np.testing.assert_allclose(np.diff(end.position[:, 0]), 1.0, rtol=1e-12)
    np.testing.assert_allclose(end.velocity[:, 0], 0.25, rtol=1e-12)  # momentum 3/4 of three


# --- what is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ContactTime(0.0), "time = 0.0: must be a positive number"),
        (lambda: ContactTime(math.nan), "time = nan: must be"),
        (lambda: VelocityCutoff(-1.0), "speed = -1.0: must be"),
        (lambda: Rest("x"), "speed = 'x': must be"),  # type: ignore[arg-type]
    ],
)
def test_a_remedy_of_no_size_is_refused(make: Callable[[], Collapse], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("collapse", ["tc", 0.1, VelocityCutoff])
def test_what_is_no_remedy_is_refused(collapse: object) -> None:
    disks = equal_disks(1)
    state = State(np.array([[5.0, 5.0]]), np.zeros((1, 2)), np.zeros(1))
    with pytest.raises(InputError, match=r"collapse = .*: must be"):
        Simulation(disks, Box((10.0, 10.0)), IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), state, collapse=collapse)  # type: ignore[arg-type]


def test_a_collision_in_the_future_is_refused() -> None:
    with pytest.raises(InputError, match=r"latest_collision\[0\] = 2.0: must be"):
        State(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1), time=1.0, latest_collision=np.array([2.0]))
