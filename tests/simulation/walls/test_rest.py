"""Heaps at rest: sleeping disks, contact forces, costs, and waking."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from support.bounds import check_bounds
from support.gases import boxed

from ifrdem import Device, Rest
from ifrdem.errors import InputError
from ifrdem.forces import Drag
from ifrdem.initial import maxwellian, random_positions
from ifrdem.kernels.columns import RESTING_BYTES
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.laws.walton import Walton
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.quantities import MECHANISMS
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.simulation.simulation import Simulation

SLOW = 0.02
REST = MECHANISMS.index("rest")
BOX = Box((12.0, 10.0), periodic=(False, False))
NEAR = 4.0 * SLOW**2  # gap of contacts, at g = 1


def in_room(position: Any, velocity: Any = None, law: Any = None, **options: Any) -> Simulation:
    """Disks in a box of 12 x 10 with walls all around, under g = 1."""
    given = {"gravity": (0.0, -1.0), "collapse": Rest(SLOW), "record": ["ledger"]} | options
    return boxed(BOX, position, velocity, law or IFRLaw(e_n=0.6, e_t=-1.0, mu=0.3), **given)


def set_asleep(run: Simulation, asleep: list[int], **law: float) -> Simulation:
    """The same disks, of which some are said to sleep, with another law."""
    state = run.state
    state.asleep = np.array(asleep)
    return Simulation(
        run.disks, run.box, IFRLaw(**law), state,
        gravity=(0.0, -1.0), collapse=Rest(SLOW), record=["ledger"],
    )  # fmt: skip


def pile(n: int = 60, seed: int = 1, **options: Any) -> Simulation:
    """Disks that fall from everywhere in the box."""
    radius = np.full(n, 0.5)
    speeds = maxwellian(np.ones(n), speed_rms=1.0, seed=seed)
    return in_room(random_positions(BOX, radius, seed=seed), speeds, **options)


def closes(run: Simulation) -> None:
    """The ledger has all energy that was lost, to rounding."""
    lost = run.measure().dissipated
    assert lost is not None
    turned_over = abs(run.dissipated_energy) + abs(run.measure().potential_energy) + 1.0
    assert abs(lost.sum() - run.dissipated_energy) < 1e-12 * turned_over


# --- one disk -------------------------------------------------------------------------------------------------


def test_a_disk_dropped_on_a_floor_rests_there_and_has_lost_its_fall() -> None:
    run = in_room([[6.0, 2.5]], mass=2.0)
    run.run(t_end=40.0)
    state = run.state
    assert state.asleep[0] == run.asleep == run.measure().asleep == 1
    np.testing.assert_allclose(state.position, [[6.0, 0.5]], rtol=0.0, atol=1e-13)
    assert not state.velocity.any()
    assert run.dissipated_energy == pytest.approx(2.0 * 1.0 * 2.0, rel=1e-13)  # m g h
    closes(run)
    lost = run.measure().dissipated
    assert lost is not None
    assert 0.0 < lost[REST] <= 0.5 * 2.0 * SLOW**2
    # v = 2 falls to v_s by factors 0.6: log(0.02 / 2) / log(0.6) = 9.02, so after 10 it is slow, and 1 more.
    assert run.wall_collisions == 11
    hits = run.wall_collisions
    run.run(t_end=1e9)
    assert run.wall_collisions == hits


def test_a_disk_rests_on_two_posts_but_not_on_top_of_one() -> None:
    """Off the top it rolls down: a = (2/3) g sin(angle) for rolling, which is not rest from 0.0015 on."""
    posts = [Wall.post((5.4, 3.0), 0.5), Wall.post((6.6, 3.0), 0.5)]
    run = in_room([[6.02, 4.0]], walls=posts)
    run.run(t_end=60.0)
    assert run.asleep == 1
    place = run.state.position[0]
    gaps = [math.hypot(place[0] - x, place[1] - 3.0) - 1.0 for x in (5.4, 6.6)]
    assert min(gaps) > -1e-12
    assert max(gaps) < NEAR
    run = in_room([[5.41, 4.001]], walls=posts[:1])
    run.run(t_end=60.0)
    assert run.asleep == 0
    assert run.state.position[0, 1] < 3.0


@pytest.mark.parametrize(("part", "rests"), [(0.97, True), (1.05, False)])
def test_on_a_slope_only_rolling_friction_holds_a_disk(part: float, rests: bool) -> None:
    """Weight m g sin(a) along the slope acts R above the contact: rho m g cos(a) holds it up to tan(a) = rho/R.

    Beyond, and without sliding, a = (g / (1 + 1/k)) (sin(a) - (rho/R) cos(a)): at 1.05 it is 0.0033 g.
    """
    angle = math.atan(part * 0.2)
    law = IFRLaw(e_n=0.6, e_t=-1.0, mu=0.8, rho=0.2 * 0.5)
    run = in_room([[3.0, 0.5 + 1e-5]], law=law, gravity=(math.sin(angle), -math.cos(angle)))
    run.run(t_end=15.0)
    assert run.asleep == int(rests)
    assert (run.state.position[0, 0] < 3.001) == rests


@pytest.mark.parametrize(("part", "rests"), [(1.01, True), (0.99, False)])
def test_a_disk_that_cannot_roll_rests_on_a_slope_up_to_the_angle_of_friction(
    part: float, rests: bool
) -> None:
    """Rolling friction of 2 R tan(a) holds any spin, so that friction m g sin(a) <= mu m g cos(a) alone has to hold.

    At mu = 0.99 tan(30 degrees) it slides with a = 0.01 g sin(a) = 0.005 g, which is no rest.
    """
    angle, time, slow = math.radians(30.0), 15.0, 0.002
    law = IFRLaw(e_n=0.6, e_t=-1.0, mu=part * math.tan(angle), rho=math.tan(angle))
    gravity = (math.sin(angle), -math.cos(angle))
    run = in_room([[3.0, 0.5 + 1e-9]], law=law, gravity=gravity, collapse=Rest(slow))
    run.run(t_end=time)
    assert run.asleep == int(rests)
    shift = run.state.position[0, 0] - 3.0
    if rests:
        assert shift < 1e-3
    else:  # A hop takes 2 v_s / (g cos(a)) at most: for so much longer or shorter has gravity acted.
        late = 2.0 * slow / math.cos(angle)
        assert shift == pytest.approx(0.5 * 0.005 * time**2, abs=0.5 * late * time)  # 0.035 of 0.56


@pytest.mark.parametrize("k", [1.0, 2.0])
@pytest.mark.parametrize("part", [1.01, 0.99])
def test_a_disk_rolls_down_a_slope_without_slip_up_to_a_third_of_the_angle_of_friction(
    part: float, k: float
) -> None:
    """With I = m R^2 / k, F the friction: m a = m g sin(A) - F, I a / R = F R where it rolls, so that F = m a / k,
    a = g sin(A) k / (1 + k), and F = m g sin(A) / (1 + k) <= mu m g cos(A) from mu = tan(A) / (1 + k) on: a third of
    tan(A) for a homogeneous disk, k = 2, a half for a hoop, k = 1.

    Below, it slips: a = g (sin(A) - mu cos(A)), R alpha = k mu g cos(A). At 0.99 the slip grows by 0.01 g sin(A).
    """
    angle, time, slow = math.atan(0.3), 6.0, 0.002
    law = IFRLaw(e_n=0.6, e_t=-1.0, mu=part * 0.3 / (1.0 + k))
    run = Simulation(
        Disks(1, mass=1.0, radius=0.5, k=k), BOX, law,
        State([[1.0, 0.5 + 1e-9]], [[0.0, 0.0]], [0.0]), gravity=(math.sin(angle), -math.cos(angle)),
        collapse=Rest(slow), record=["ledger"],
    )  # fmt: skip
    run.run(t_end=time)
    along, spin = run.state.velocity[0, 0], run.state.spin[0]
    pull, friction = math.sin(angle), min(part, 1.0) * math.sin(angle) / (1.0 + k)
    # A hop takes 2 v_s / g at most: by so much more or less time have gravity and friction acted.
    late = 2.0 * slow / math.cos(angle)
    assert along == pytest.approx((pull - friction) * time, abs=pull * late)
    assert -0.5 * spin == pytest.approx(k * friction * time, abs=k * pull * late)
    slip = along + 0.5 * spin
    assert slip == pytest.approx(
        0.0 if part > 1.0 else 0.01 * pull * time, abs=pull * late
    )  # 0.0012 of 0.0172


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_in_a_groove_a_disk_rests_without_friction_but_not_on_one_side_of_it(mu: float) -> None:
    """A groove of two slopes of 45 degrees: with both normals about the vertical no friction is needed."""
    law = IFRLaw(e_n=0.6, e_t=-1.0, mu=mu)
    slopes = [Wall.line((6.0, 2.0), (1.0, 1.0)), Wall.line((6.0, 2.0), (-1.0, 1.0))]
    run = in_room([[6.3, 5.0]], walls=slopes, law=law)
    run.run(t_end=60.0)
    assert run.asleep == 1
    np.testing.assert_allclose(run.state.position[0], [6.0, 2.0 + 0.5 * math.sqrt(2.0)], atol=2.0 * NEAR)
    run = in_room([[6.3, 5.0]], walls=slopes[:1], law=law)
    run.run(t_end=3.0)
    assert run.asleep == 0
    assert run.state.position[0, 0] > 6.5


# --- three disks ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("mu", "stands"), [(0.270, True), (0.266, False)])
def test_a_pyramid_of_three_is_stable_by_friction(mu: float, stands: bool) -> None:
    """The lower two touch the floor, and each other at most. The top, weight W, pushes each by N along a line 30
    degrees from the vertical, with friction T upwards. No torque on a lower disk: the floor's friction is T, inwards.
    Its balance along the floor, N sin 30 = T cos 30 + T, gives T/N = tan 15 = 0.2679; that of the top N = W/2, so the
    floor holds T = 0.134 W by 1.5 W: 0.089 is enough there.
    """
    between, floor = IFRLaw(e_n=0.6, e_t=-1.0, mu=mu), IFRLaw(e_n=0.6, e_t=-1.0, mu=0.5)
    place = [[5.5, 0.5001], [6.5001, 0.5001], [6.0, 0.5001 + 0.5 * math.sqrt(3.0) + 1e-3]]
    run = Simulation(
        Disks(3, mass=1.0, radius=0.5, material=1), BOX,
        [[floor, floor], [floor, between]], State(place, np.zeros((3, 2)), np.zeros(3)),
        gravity=(0.0, -1.0), collapse=Rest(0.005), record=["ledger"],
    )  # fmt: skip
    run.run(t_end=40.0)
    top = run.state.position[2, 1]
    if stands:
        assert run.asleep == 3
        assert top == pytest.approx(0.5 + 0.5 * math.sqrt(3.0), abs=1e-3)
    else:
        assert top < 1.0


@pytest.mark.parametrize("mu", [0.270, 0.266])
def test_a_pyramid_across_a_side_is_the_mirror_image_of_one_across_the_other_side(mu: float) -> None:
    """The contact of the lower two, and one of the top, are around the box: along x, or along y with gravity along x.

    x and y change places: sums of two squares and products keep their bits.
    """
    between, floor = IFRLaw(e_n=0.6, e_t=-1.0, mu=mu), IFRLaw(e_n=0.6, e_t=-1.0, mu=0.5)
    place = np.array([[11.5, 0.5001], [0.5001, 0.5001], [0.0, 0.5001 + 0.5 * math.sqrt(3.0) + 1e-3]])
    found = []
    for turn in (slice(None), slice(None, None, -1)):
        run = Simulation(
            Disks(3, mass=1.0, radius=0.5, material=1),
            Box((12.0, 10.0)[turn], periodic=(True, False)[turn]),
            [[floor, floor], [floor, between]], State(place[:, turn], np.zeros((3, 2)), np.zeros(3)),
            gravity=(0.0, -1.0)[turn], collapse=Rest(0.005), record=["ledger"],
        )  # fmt: skip
        run.run(t_end=40.0)
        found.append((run.state.position[:, turn], run.asleep, run.collisions))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    assert found[0][1:] == found[1][1:]
    assert found[0][1] == (3 if mu > 0.2679 else 1)


def test_contacts_for_which_there_is_no_room_are_counted_and_wake_no_disk() -> None:
    """There is room for eight; the disk lies on the ends of twenty segments at one place."""
    run = set_asleep(in_room([[6.0, 3.5]]), [1], e_n=0.6, e_t=-1.0, mu=0.3)
    state = run.state
    walls = [Wall.segment((4.0, 3.0), (8.0, 3.0)) for _ in range(20)]
    run = Simulation(
        run.disks, BOX, IFRLaw(e_n=0.6, e_t=-1.0, mu=0.3), state,
        walls=walls, gravity=(0.0, -1.0), collapse=Rest(SLOW), record=["ledger"],
    )  # fmt: skip
    run.run(t_end=3.0)
    assert run.statistics.unverified > 0
    assert run.asleep == 1
    np.testing.assert_array_equal(run.state.position, [[6.0, 3.5]])


def test_a_sleeping_disk_wakes_where_a_wall_comes_near_and_is_pushed() -> None:
    """The wall, x = 0.05 t, reaches the disk at t = 50; its law is not elastic: after t = 60 they move together."""
    start = set_asleep(in_room([[3.0, 0.5]]), [1], e_n=0.6, e_t=-1.0, mu=0.3)
    wall = Wall.line((0.0, 0.0), (1.0, 0.0), motion=Motion("steady", direction=(1.0, 0.0), speed=0.05))
    run = Simulation(
        start.disks, BOX, IFRLaw(e_n=0.6, e_t=-1.0, mu=0.3), start.state,
        walls=[wall], gravity=(0.0, -1.0), collapse=Rest(SLOW), record=["ledger"],
    )  # fmt: skip
    run.run(t_end=49.0)
    assert run.asleep == 1
    assert run.wall_collisions == 0
    np.testing.assert_array_equal(run.state.position, [[3.0, 0.5]])
    run.run(t_end=60.0)
    assert run.asleep == 0
    # Ahead of the wall by less than it moves in a hop on the floor, v_s / g a few times.
    assert 0.0 <= run.state.position[0, 0] - 3.5 < 0.05
    closes(run)


# --- hits -----------------------------------------------------------------------------------------------------


def sleeper_and(position: tuple[float, float], velocity: tuple[float, float], mu: float = 0.3) -> Simulation:
    """A disk that sleeps on the floor at x = 6, and another one."""
    run = in_room([[6.0, 0.5], position], [[0.0, 0.0], velocity])
    state = run.state
    state.asleep = np.array([1, 0])
    return Simulation(
        run.disks, run.box, IFRLaw(e_n=0.6, e_t=-1.0, mu=mu), state,
        gravity=(0.0, -1.0), collapse=Rest(SLOW), record=["ledger"],
    )  # fmt: skip


def test_a_hard_hit_from_above_wakes() -> None:
    """It comes at 3 + t, from a gap of 2; as seen by who falls, the one that sleeps flies up at t, slower than that."""
    run = sleeper_and((6.0, 3.5), (0.0, -3.0))
    found = run.collide(1).time[0]
    assert found == pytest.approx(np.sqrt(13.0) - 3.0, rel=1e-13)  # 3 t + t^2 / 2 = 2
    assert run.state.asleep[0] == 0


def test_a_flying_disk_meets_one_that_sleeps_where_their_parabola_says() -> None:
    """|r + v t + g t^2 / 2| = 2 R, a polynomial of fourth degree; its least root above 0."""
    offset, velocity = np.array([-2.3, 1.1]), np.array([1.4, 0.3])
    run = sleeper_and((6.0 + offset[0], 0.5 + offset[1]), (velocity[0], velocity[1]))
    found = run.collide(1).time[0]
    x, y = np.poly1d([0.0, velocity[0], offset[0]]), np.poly1d([-0.5, velocity[1], offset[1]])
    roots = (x * x + y * y - 1.0).roots
    first = min(root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0.0)
    assert found == pytest.approx(first, rel=1e-13)
    assert found > 1.0  # several windows of at most 8 v_s / g


def test_a_hard_hit_wakes_and_is_a_collision_of_two_disks() -> None:
    run = sleeper_and((4.0, 1.2), (3.0, 0.0), mu=0.0)
    assert run.asleep == 1
    run.collide(1)
    assert run.asleep == 0
    state = run.state
    assert state.velocity[0, 0] > 0.5
    assert state.velocity[:, 0].sum() == pytest.approx(3.0, rel=1e-12)  # momentum along the floor
    run.run(t_end=5000.0)  # without friction they slide until walls have slowed them
    assert run.asleep == 2
    closes(run)


@pytest.mark.parametrize("sleeper", [0, 1])
def test_the_bound_of_a_speed_is_that_of_a_disk_that_was_woken(sleeper: int) -> None:
    """Far from walls, whose hits raise it too, a sleeping disk gets (1 + .9) / 2 of a speed of 3.

    It is hit at t = .02 / 3, before its missing support is noticed.
    """
    position, velocity = np.array([[6.0, 5.0], [4.98, 5.0]]), np.array([[0.0, 0.0], [3.0, 0.0]])
    order = [sleeper, 1 - sleeper]
    run = set_asleep(
        in_room(position[order], velocity[order]), [1 - sleeper, sleeper], e_n=0.9, e_t=-1.0, mu=0.0
    )
    run.collide(1)
    state = run.state
    assert state.velocity[sleeper, 0] == pytest.approx(2.85, rel=1e-6)  # both fell 2e-5
    check_bounds(run, np.full(2, state.time), np.arange(2), state.velocity, gravity=(0.0, -1.0))


def test_a_slow_hit_wakes_no_disk() -> None:
    run = sleeper_and((6.0, 1.5 + 0.4 * SLOW**2), (0.0, 0.0))  # falls to sqrt(0.8) v_s
    run.collide(1)
    assert run.state.asleep[0] == 1
    assert not run.state.velocity[0].any()
    run.run(t_end=5.0)
    assert run.asleep == 2  # one upon the other, balanced
    assert run.state.position[1, 1] == pytest.approx(1.5, abs=1e-12)
    closes(run)


def test_a_disk_that_loses_its_support_wakes_and_falls() -> None:
    """A tower of two; a third disk knocks the lower one away along the floor, so no disk hits the upper one hard."""
    run = in_room([[6.0, 0.5], [6.0, 1.5], [3.0, 0.5]], [[0.0, 0.0], [0.0, 0.0], [6.0, 0.0]])
    run = set_asleep(run, [1, 1, 0], e_n=0.9, e_t=-1.0, mu=0.0)
    run.run(t_end=0.3)
    assert run.state.asleep[1] == 1  # nothing has touched it
    assert run.state.position[1, 1] == 1.5
    run.run(t_end=1.5)  # hit at t = 1/3; judged 8 v_s / g = 0.16 later at most
    fallen = 1.5 - run.state.position[1, 1]
    assert 0.5 * (1.5 - 1.0 / 3.0 - 0.16) ** 2 < fallen < 0.5 * (1.5 - 1.0 / 3.0) ** 2
    assert run.state.asleep[1] == 0


def test_a_sleeping_disk_without_support_is_detected_by_its_forces() -> None:
    """One in the air, one off the top of a third on the floor, which it pushes aside as it rolls down."""
    leaning = (9.0 + math.sin(0.2), 0.5 + math.cos(0.2))
    run = in_room([[3.0, 3.0], [9.0, 0.5], leaning])
    run = set_asleep(run, [1, 1, 1], e_n=0.6, e_t=-1.0, mu=0.3)
    assert run.asleep == 3
    run.collide(1)
    assert run.asleep == 0
    run.run(t_end=1.5)
    assert run.state.position[1, 0] < 9.0 < run.state.position[2, 0]
    assert run.state.position[0, 1] == pytest.approx(3.0 - 0.5 * 1.5**2, abs=1e-12)
    assert run.state.position[2, 0] > leaning[0] + 0.05


# --- a pile ---------------------------------------------------------------------------------------------------


def test_a_pile_comes_to_rest_at_a_bounded_cost() -> None:
    """With a cut-off of the same speed 3e6 events a unit of time have no end; here they all end before t = 30."""
    run = pile()
    run.run(t_end=40.0)
    state = run.state
    assert run.asleep == 60
    assert not state.velocity.any()
    assert not state.spin.any()
    events = run.collisions + run.wall_collisions
    assert events < 400_000
    assert run.statistics.unverified == 0
    closes(run)
    assert pdist(state.position).min() > 1.0 - 1e-11
    assert state.position.min() > 0.5 - 1e-11
    # Everybody has a support, and a heap that rests costs nothing.
    run.run(t_end=1e6)
    assert run.collisions + run.wall_collisions == events
    np.testing.assert_array_equal(run.state.position, state.position)


@pytest.mark.full
def test_the_more_disks_rest_the_more_steps_may_find_their_forces() -> None:
    """Each of 450 on a floor has a contact of its own, F_n = m g, found as quickly as one."""
    n = 450
    position = np.stack((1.0 + 1.1 * np.arange(n), np.full(n, 0.5)), axis=1)
    state = State(position, np.zeros((n, 2)), np.zeros(n))
    state.asleep = np.ones(n, dtype=np.int32)
    run = Simulation(
        Disks(n, mass=1.0, radius=0.5), Box((500.0, 10.0), periodic=(False, False)), IFRLaw(e_n=0.6, e_t=-1.0, mu=0.3),
        state, gravity=(0.0, -1.0), collapse=Rest(SLOW),
    )  # fmt: skip
    run.run(t_end=1.0)
    assert run.statistics.unverified == 0
    assert run.asleep == n


def test_a_pile_rests_at_any_friction() -> None:
    """Both edges of a cone of mu = 100 are almost opposite: amounts of them would take some mu^2 steps to find."""
    run = pile(30, law=IFRLaw(e_n=0.6, e_t=-1.0, mu=100.0))
    run.run(t_end=60.0)
    assert run.asleep == 30
    assert run.statistics.unverified == 0
    closes(run)


def with_all_features(box: Box, walls: list[Wall]) -> list[Wall]:
    """These walls, and a short arc below the top of the box with a gate, which no disk reaches: tests share kernels."""
    far = (0.5 * box.lengths[0], box.lengths[1] - 0.3)
    return [*walls, Wall.arc(far, 0.1, (0.0, 3.0), opens_at=1e6)]


def two_materials(n: int) -> NDArray[np.intp]:
    """Materials of disks that are alike otherwise: two kinds."""
    return np.arange(n) % 2


@pytest.mark.full
@pytest.mark.parametrize(
    ("box", "walls", "law"),
    [
        (
            Box((22.0, 22.0), (False, False)),
            [Wall.container((11.0, 11.0), 10.0)],
            IFRLaw(e_n=0.6, e_t=-1.0, mu=0.3),
        ),
        (
            Box((22.0, 22.0), (False, False)),
            [Wall.post((6.0, 5.0), 2.0), Wall.segment((2.0, 10.0), (9.0, 13.0))],
            IFRLaw(e_n=0.6, e_t=-1.0, mu=0.0),
        ),
        (Box((15.0, 22.0), (True, False)), [], IFRLaw(e_n=0.3, e_t=-0.5, mu=0.6, rho=0.05)),
    ],
    ids=["container", "posts, smooth", "periodic, rolling friction"],
)
def test_disks_of_many_sizes_rest_anywhere(box: Box, walls: list[Wall], law: IFRLaw) -> None:
    radius = np.random.default_rng(1).uniform(0.4, 0.6, 80)
    start = State(random_positions(box, radius, seed=1, walls=walls), np.zeros((80, 2)), np.zeros(80))
    run = Simulation(
        Disks(80, mass=radius**2, radius=radius), box, law, start, walls=with_all_features(box, walls),
        gravity=(0.0, -1.0), collapse=Rest(SLOW), record=["dissipated"],
    )  # fmt: skip
    run.run(t_end=150.0)
    assert run.asleep == 80
    closes(run)
    place = run.state.position
    gap = place[:, None] - place
    if box.periodic[0]:
        gap[..., 0] -= box.lengths[0] * np.round(gap[..., 0] / box.lengths[0])
    gap = np.linalg.norm(gap, axis=2) - radius[:, None] - radius
    assert gap[np.triu_indices(80, 1)].min() > -1e-11


def test_gravity_that_turns_wakes_piles_which_flow_and_rest_again() -> None:
    shifts = []
    for seed in range(1, 9):
        run = pile(30, seed)
        run.run(t_end=60.0)
        assert run.asleep == 30
        run.set_gravity((0.8, -0.6))
        assert run.asleep == 0
        run.run(t_end=200.0)
        # In one of 24 piles a disk hung between two others and friction just did not hold it: it is caught, and never
        # sleeps for long.
        assert run.asleep >= 29
        assert np.abs(run.state.velocity).max() < SLOW
        shifts.append(run.state.position[:, 0].mean() - 6.0)
        closes(run)
    # How far a pile flows varies much with its start. With another way to find the forces (by the edges of the
    # cones), 24 piles from these and further starts flowed by 1.71(10), with a standard deviation of 0.49: the mean
    # of eight is within three of its standard errors, 3 (0.49^2 / 8 + 0.10^2)^(1/2).
    assert np.mean(shifts) == pytest.approx(1.71, abs=0.60)


@pytest.mark.full
def test_a_heap_takes_the_memory_that_the_estimate_says() -> None:
    run = pile(30)
    run.run(t_end=0.1)
    arrays = run._engine.arrays
    of_heaps = arrays.bytes_of("rest", "residual_acceleration", "contact", "cached_force", "held", "asleep")
    assert of_heaps == 30 * RESTING_BYTES
    plain = pile(30, collapse=None)
    plain.run(t_end=0.1)
    assert arrays.bytes_allocated - plain._engine.arrays.bytes_allocated == pytest.approx(of_heaps, rel=0.01)


def test_frames_series_and_checkpoints_change_no_bit(tmp_path: Path) -> None:
    def end(run: Simulation) -> tuple[Any, ...]:
        state = run.state
        run.save_checkpoint(tmp_path / "end.h5")
        kept, _ = checkpoint.read(tmp_path / "end.h5")
        forces = kept["held"][np.argsort(kept["meta"][:, 0])]  # with which the next judgement begins
        assert np.count_nonzero(forces[:, 1] > 0.0) > 10
        return state.position, state.velocity, state.spin, state.asleep, state.collisions, run.asleep, forces

    plain = pile(40)
    plain.run(t_end=7.0)
    assert 0 < plain.asleep < 40
    looked = pile(40)
    looked.run(
        t_end=7.0,
        frames=37,
        frame_callbacks=[lambda state, measure: None],
        series=91,
        series_callbacks=[lambda _: None],
    )
    stopped = pile(40)
    for k, stop in enumerate((3.3, 5.1, 6.77)):
        stopped.run(t_end=stop)
        stopped.save_checkpoint(tmp_path / f"{k}.h5")
        stopped = pile(40)
        stopped.load_checkpoint(tmp_path / f"{k}.h5")
    stopped.run(t_end=7.0)
    for other in (looked, stopped):
        for found, expected in zip(end(other), end(plain), strict=True):
            np.testing.assert_array_equal(found, expected)
        lost, expected_lost = other.measure().dissipated, plain.measure().dissipated
        assert lost is not None
        assert expected_lost is not None
        assert lost[REST] == pytest.approx(expected_lost[REST], rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gravity": (0.0, 0.0)}, "only gravity holds disks"),
        ({"collapse": Rest(0.2)}, r"resting speed must be at most 0\.1"),
        ({"device": Device(precision="f32")}, "in double precision"),
    ],
)
def test_where_the_model_does_not_hold_it_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        in_room([[6.0, 2.5]], **change)


def test_what_rest_excludes_cannot_be_set_between_runs() -> None:
    """The table of exclusions is asked by each change; a change that it refuses would begin to run."""
    run = in_room([[6.0, 2.5]])
    with pytest.raises(InputError, match=r"collapse = Rest.* combined with gravity = \(0\.0, 0\.0\)"):
        run.set_gravity((0.0, 0.0))
    with pytest.raises(InputError, match=r"collapse = Rest.* combined with law = Walton"):
        run.set_law(Walton(e_n=0.5, beta_0=0.0, mu=0.3))
    with pytest.raises(InputError, match=r"collapse = Rest.* combined with forces = \[<Drag"):
        run.set_forces([Drag(0.1, rate=1.0)])


def test_a_belt_supports_no_disk() -> None:
    run = in_room([[6.0, 2.5]], walls=[Wall.line((0.0, 1.0), (0.0, 1.0), surface_speed=0.5)])
    run.run(t_end=7.0)
    assert run.asleep == 0


def test_a_gate_that_opens_under_sleeping_disks_wakes_them() -> None:
    plate = Wall.segment((0.0, 8.0), (12.0, 8.0), opens_at=60.0)
    disks = Disks(9, mass=1.0, radius=0.5, material=two_materials(9))
    box = Box((12.0, 20.0), (False, False))
    position = np.column_stack([np.linspace(1.0, 11.0, 9), np.full(9, 8.6)])
    start = State(position, np.zeros((9, 2)), np.zeros(9))
    law = IFRLaw(e_n=0.6, e_t=-1.0, mu=0.3)
    gas = Simulation(
        disks, box, [[law, law], [law, law]], start, walls=with_all_features(box, [plate]), gravity=(0.0, -1.0),
        collapse=Rest(0.05),
        record=["dissipated"],
    )  # fmt: skip
    gas.run(t_end=59.0)
    assert gas.asleep == 9
    assert gas.state.position[:, 1].min() > 8.49
    gas.run(t_end=63.0)  # a fall by g t^2 / 2 = 4.5 since
    assert gas.asleep == 0
    np.testing.assert_allclose(gas.state.position[:, 1], 8.5 - 4.5, atol=0.02)
    gas.run(t_end=120.0)
    assert gas.asleep == 9
    lost = gas.state.dissipated.sum(axis=0)
    assert lost[-1] > 0.0
    np.testing.assert_allclose(lost, gas.measure().dissipated, rtol=1e-12, atol=1e-15)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("angle", [20.0, 45.0])
def test_nothing_sleeps_on_the_slope_of_an_arc(angle: float) -> None:
    """Without rolling friction a disk rolls from the slope of a bowl, an arc as a container."""
    radius, middle, box = 5.0, np.array([10.0, 10.0]), Box((20.0, 20.0), (False, False))
    law = IFRLaw(e_n=0.5, e_t=-1.0, mu=0.5)
    at = np.radians(-90.0 + angle)
    place = middle + (radius - 0.5 - 1e-9) * np.array([np.cos(at), np.sin(at)])
    found = []
    for bowl in (Wall.arc((10.0, 10.0), radius, (np.pi, 2.0 * np.pi)), Wall.container((10.0, 10.0), radius)):
        run = Simulation(
            Disks(2, mass=1.0, radius=0.5, material=two_materials(2)), box, [[law, law], [law, law]],
            State([place, [8.0, 13.9]], np.zeros((2, 2)), np.zeros(2)), walls=with_all_features(box, [bowl]),
            gravity=(0.0, -1.0), collapse=Rest(SLOW), record=["dissipated"],
        )  # fmt: skip
        run.run(t_end=4.0)
        found.append(run.state.position[0])
        assert np.linalg.norm(found[-1] - place) > 0.5
    np.testing.assert_allclose(found[0], found[1], atol=0.05)
