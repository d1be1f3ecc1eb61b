"""Walls: exact hit times, the law at a wall, energy from moving walls, the same collisions with any tiles."""

from __future__ import annotations

import math
import re
import signal
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from support.gases import COIN, ELASTIC, partners, run_to
from support.serial_reference import simulate

from ifrdem import Device, VelocityCutoff, forces, laws
from ifrdem.errors import InelasticCollapse, InputError
from ifrdem.initial import maxwellian, random_positions
from ifrdem.kernels.events.events import EVENTS_OF_A_LOOK, LONG, LONG_OF_A_DISK, MOST_EVENTS_OF_A_LAUNCH
from ifrdem.kernels.laws.law import collide_pair
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.setup import Setup
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.windows.runner import TileRunner
from ifrdem.validation.rows import engine_of

ORDERS = ("serial", "tiled")
RUNNER = "ifrdem.simulation.windows.runner"
LAW = np.array([[ELASTIC]])


def gas_in(box: Box, n: int, seed: int = 1, radius: float = 0.5) -> tuple[Disks, State]:
    """Disks on a square lattice well inside of the box, with Gaussian velocities and spins."""
    rng = np.random.default_rng(seed)
    columns = math.ceil(math.sqrt(n * box.lengths[0] / box.lengths[1]))
    rows = math.ceil(n / columns)
    i = np.arange(n)
    spacing = np.array([box.lengths[0] / columns, box.lengths[1] / rows])
    position = (np.column_stack((i % columns, i // columns)) + 0.5) * spacing
    disks = Disks(n, mass=1.0, radius=radius)
    return disks, State(position, rng.normal(size=(n, 2)), rng.normal(size=n))


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("order", ORDERS)
def test_a_ball_on_a_floor_bounces_with_the_period_of_a_parabola(order: str) -> None:
    """Dropped from height h above contact, an elastic ball is back at 2 sqrt(2 h / g), and drifts sideways steadily."""
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State(np.array([[5.0, 3.0]]), np.array([[0.3, 0.0]]), np.zeros(1))
    engine = engine_of(disks, Box((10.0, 10.0), (True, False)), start, LAW, gravity=(0.0, -2.0), order=order)
    period = 2.0 * math.sqrt(2.0 * 2.5 / 2.0)
    for bounce in range(1, 21):
        state = run_to(engine, bounce * period)
        assert engine.wall_collisions == bounce
        np.testing.assert_allclose(state.position[0, 1], 3.0, atol=1e-11)
        np.testing.assert_allclose(state.velocity[0], [0.3, 0.0], atol=1e-11)
    assert state.collisions[0] == 0


def test_a_wall_is_a_disk_of_infinite_mass_to_the_law() -> None:
    disks = Disks(1, mass=2.0, radius=0.5, k=1.7)
    start = State(np.array([[5.0, 1.0]]), np.array([[0.7, -1.0]]), np.array([0.4]))
    wall = Wall.line(
        (0.0, 0.2), (0.0, 1.0), material=1, surface_speed=0.3, motion=Motion("steady", speed=0.1)
    )
    law = np.array([[ELASTIC, COIN], [COIN, ELASTIC]])
    engine = engine_of(disks, Box((10.0, 10.0), (True, False)), start, law, walls=[wall])
    after = run_to(engine, 1.0)
    vx, vy, spin, *_ = collide_pair(
        *COIN, 0.0, -1.0, 1.0 / 2.0, 0.5, 1.7, 0.7, -1.0, 0.4, 0.0, 0.5, 1.0, -0.3, 0.1, 0.0
    )
    np.testing.assert_allclose(after.velocity[0], [vx, vy], rtol=1e-13)
    np.testing.assert_allclose(after.spin[0], spin, rtol=1e-13)
    hit = (1.0 - 0.2 - 0.5) / 1.1  # the gap over the speed of approach
    np.testing.assert_allclose(after.position[0, 1], 1.0 - hit + vy * (1.0 - hit), rtol=1e-13)
    # The wall's impulse times its velocity is what the disk gains, less what the law dissipates.
    impulse = 2.0 * (after.velocity[0] - [0.7, -1.0])
    np.testing.assert_allclose(engine.wall_work, impulse @ [-0.3, 0.1], rtol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_a_billiard_in_a_circle_keeps_its_angular_momentum(order: str) -> None:
    """Its hits are 2 sqrt(r^2 - b^2) / v apart, b the distance of its path from the middle, r = R_c - R."""
    disks = Disks(1, mass=1.0, radius=0.5)
    velocity = np.array([0.8, 0.6])
    start = State(np.array([[6.0, 4.5]]), velocity[None, :], np.zeros(1))
    engine = engine_of(
        disks,
        Box((10.0, 10.0), (False, False)),
        start,
        LAW,
        order=order,
        walls=[Wall.container((5.0, 5.0), 4.0)],
    )
    offset = np.array([1.0, -0.5])
    b = offset[0] * velocity[1] - offset[1] * velocity[0]
    r = 3.5
    half = math.sqrt(r * r - b * b)
    first = half - offset @ velocity
    for hits in (1, 10, 100):
        state = run_to(engine, first + (hits - 0.5) * 2.0 * half)
        assert engine.wall_collisions == hits
        d = state.position[0] - 5.0
        assert d[0] * state.velocity[0, 1] - d[1] * state.velocity[0, 0] == pytest.approx(b, rel=1e-11)
        assert math.hypot(*d) == pytest.approx(abs(b), rel=1e-9)  # half-way between two hits


MOTIONS = [
    Motion("sine", amplitude=0.4, frequency=0.7, phase=1.0),
    Motion("sine", amplitude=0.05, frequency=9.0),
    Motion("sine", direction=(1.0, 1.0), amplitude=0.4, frequency=0.7),
    Motion("sawtooth", amplitude=0.4, frequency=0.7, rise=0.2, phase=2.0),
    Motion("sawtooth", amplitude=0.1, frequency=5.0, rise=0.5),
    Motion("steady", speed=0.2),
]
SHAPES = {
    "line": lambda motion: Wall.line((0.0, 1.0), (0.0, 1.0), motion=motion),
    "segment": lambda motion: Wall.segment((3.0, 1.0), (5.3, 1.4), motion=motion),
    "post": lambda motion: Wall.post((5.1, 1.0), 0.5, motion=motion),
    "container": lambda motion: Wall.container((5.0, 5.0), 4.2, motion=motion),
}


@pytest.mark.full(keep=12)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("motion", MOTIONS, ids=lambda m: f"{m.kind}-{m.frequency}-{m.direction[0]:.1f}")
@pytest.mark.parametrize("gravity", [0.0, 0.5])
def test_a_moving_wall_is_hit_at_the_first_root(shape: str, motion: Motion, gravity: float) -> None:
    """Against a search for the first change of sign of the gap, in steps of 0.002, and Brent's method there."""
    wall, still = SHAPES[shape](motion), SHAPES[shape](Motion())
    times = np.linspace(0.0, 6.0, 3001)
    steps = np.array([wall.moved(t)[0] for t in times])
    disks = Disks(1, mass=1.0, radius=0.5)
    starts = np.array([[5.0, 3.5], [4.6, 3.0], [5.6, 4.0]])
    box = Box((10.0, 10.0), (False, False))
    compared = 0
    for x, v in zip(starts, ([0.1, -0.7], [0.3, -0.2], [-0.2, -1.1]), strict=True):
        velocity = np.array(v)

        def place(t: np.ndarray, x: np.ndarray = x, velocity: np.ndarray = velocity) -> np.ndarray:
            return x + np.multiply.outer(t, velocity) + np.multiply.outer(0.5 * t * t, [0.0, -gravity])

        def gap(t: float) -> float:
            return float(wall.gap(place(np.array([t])), np.array([0.5]), t)[0])

        gaps = still.gap(place(times) - steps, np.array([0.5]))  # of all times at once, as seen from the wall
        crossing = np.flatnonzero(gaps < 0.0)
        if not len(crossing):
            continue
        expected = brentq(gap, times[crossing[0] - 1], times[crossing[0]], xtol=1e-14, rtol=1e-15)
        if expected > _time_to_sides(x, velocity, gravity):
            continue
        compared += 1
        start = State(x[None, :], velocity[None, :], np.zeros(1))
        engine = engine_of(disks, box, start, LAW, walls=[wall], gravity=(0.0, -gravity))
        state = run_to(engine, expected - 1e-9)
        assert engine.wall_collisions == 0, (shape, motion)
        state = run_to(engine, expected + 1e-9)
        assert engine.wall_collisions == 1, (shape, motion)
        assert np.all(np.isfinite(state.velocity))
    assert compared > 0


@pytest.mark.parametrize("order", ORDERS)
def test_a_disk_meets_the_image_of_a_post_behind_a_periodic_side(order: str) -> None:
    """It sees the post from in front of the side and touches it behind, where the post is a mirror."""
    begin, v, post = np.array([9.7, 3.5]), np.array([0.5, 1.0]), np.array([10.6, 5.0])
    r = begin - post
    hit = (-(r @ v) - math.sqrt((r @ v) ** 2 - (v @ v) * (r @ r - 0.8**2))) / (v @ v)
    normal = (r + v * hit) / 0.8
    after = v - 2.0 * (v @ normal) * normal
    end = begin + v * hit + after * (2.0 - hit)
    assert (begin + v * hit)[0] > 10.0
    for turned in (slice(None), slice(None, None, -1)):
        start = State(begin[None, turned], v[None, turned], np.zeros(1))
        wall = Wall.post(tuple((post - [10.0, 0.0])[turned]), 0.3)
        disk = Disks(1, mass=1.0, radius=0.5)
        engine = engine_of(disk, Box((10.0, 10.0)), start, LAW, walls=[wall], order=order)
        state = run_to(engine, 2.0)
        assert engine.wall_collisions == 1
        np.testing.assert_allclose((state.position + 10.0 * state.image)[0, turned], end, rtol=1e-13)
        np.testing.assert_allclose(state.velocity[0, turned], after, rtol=1e-12)


@pytest.mark.parametrize("kind", ["sine", "sawtooth"])
def test_a_slow_disk_is_not_at_rest_near_a_fast_wall(kind: str) -> None:
    """It takes a thousand periods of the wall until the disk is within its amplitude.

    In a period of 1e-4 the disk moves by 1e-5, and the wall by 4e-3: it hits the disk within the next period.
    """
    A, frequency, speed = 1e-3, 1e4, 0.1
    floor = Wall.line((0.0, 1.0), (0.0, 1.0), motion=Motion(kind, amplitude=A, frequency=frequency))  # type: ignore[arg-type]
    distance = 2.0 * A + 1e-2  # from the mean position of the wall
    start = State(np.array([[5.0, 1.5 + distance]]), np.array([[0.0, -speed]]), np.zeros(1))
    engine = engine_of(
        Disks(1, mass=1.0, radius=0.5), Box((10.0, 10.0), (True, False)), start, LAW, walls=[floor]
    )
    reached = (distance - A) / speed
    run_to(engine, reached - 1e-9)
    assert engine.wall_collisions == 0
    run_to(engine, reached + 1.01 / frequency)
    assert engine.wall_collisions >= 1


def _time_to_sides(x: np.ndarray, v: np.ndarray, gravity: float) -> float:
    """When a disk of radius 0.5 reaches a side of the box of side 10."""
    times = [math.inf]
    for axis, a in ((0, 0.0), (1, -gravity)):
        for side in (0.5, 9.5):
            roots = (
                np.roots([0.5 * a, v[axis], x[axis] - side]) if a else np.array([(side - x[axis]) / v[axis]])
            )
            times += [float(r.real) for r in np.atleast_1d(roots) if abs(r.imag) < 1e-12 and r.real > 0.0]
    return min(times)


@pytest.mark.parametrize("order", ORDERS)
def test_smooth_elastic_walls_are_mirrors(order: str) -> None:
    """A gas between two such walls and its mirror image are a periodic gas of twice the width: that of the serial code.

    There a disk that meets its own image is one that meets the wall.
    """
    n, width = 60, 12.0
    box = Box((width, 10.0), (False, True))
    disks, state = gas_in(box, n, radius=0.4)
    spinless = State(state.position, state.velocity, np.zeros(n))
    mirrored = State(
        np.vstack((state.position, [2.0 * width, 0.0] + state.position * [-1.0, 1.0])),
        np.vstack((state.velocity, state.velocity * [-1.0, 1.0])),
        np.zeros(2 * n),
    )
    _, found = simulate(
        Disks(2 * n, mass=1.0, radius=0.4), Box((2.0 * width, 10.0)), ELASTIC, mirrored, max_collisions=600
    )
    expected = [(t, a, b) for t, a, b in found if a < n and b < n]
    walls = [t for t, a, b in found if abs(a - b) == n]
    engine = engine_of(disks, box, spinless, LAW, order=order, tile_disks=20)
    engine.keep_collisions = True
    pairs, times = [], []
    end = expected[150][0]
    while engine.time < end:
        engine.advance(t_end=end)
        if engine.last_collisions is not None:
            pairs += [tuple(pair) for pair in engine.last_collisions.pair]
            times += list(engine.last_collisions.time)
    np.testing.assert_array_equal(
        partners(np.array(pairs)), partners(np.array([sorted((a, b)) for _, a, b in expected[: len(pairs)]]))
    )
    assert len(pairs) >= 150
    np.testing.assert_allclose(times, [t for t, _, _ in expected[: len(times)]], atol=1e-7)
    assert engine.wall_collisions == sum(t < end for t in walls)


def shaken(order: str, threads: int | None = None, n: int = 300, law: tuple[float, ...] = COIN) -> Engine:
    box = Box((30.0, 40.0), (False, False))
    disks, state = gas_in(box, n)
    floor = Wall.line((0.0, 0.3), (0.0, 1.0), motion=Motion("sine", amplitude=0.3, frequency=0.8))
    inside = [
        Wall.segment((5.0, 38.2), (12.0, 37.8)),
        Wall.post(
            (18.0, 0.3), 0.1, motion=Motion("sawtooth", amplitude=0.2, frequency=0.5, direction=(1.0, 0.0))
        ),
    ]
    return engine_of(
        disks, box, state, np.array([[law]]), order=order, device=Device(threads=threads), tile_disks=60,
        walls=[floor, *inside], gravity=(0.0, -0.1),
    )  # fmt: skip


def test_every_way_of_running_gives_the_same_shaken_gas() -> None:
    ends = {order: run_to(shaken(order), 4.0) for order in ORDERS}
    for order in ORDERS[1:]:
        for name in ("position", "velocity", "spin", "collisions", "wall_collisions"):
            np.testing.assert_array_equal(getattr(ends[order], name), getattr(ends["serial"], name))


@pytest.mark.full
def test_a_shaken_gas_is_the_same_on_two_threads() -> None:
    # Another number restarts Taichi, which takes seconds: that of other tests is first.
    two, one = ([run_to(shaken(order, threads), 5.0) for order in ORDERS] for threads in (2, 1))
    for order in range(len(ORDERS)):
        for name in ("position", "velocity", "spin", "collisions"):
            np.testing.assert_array_equal(getattr(one[order], name), getattr(two[order], name))


@pytest.mark.parametrize("order", ORDERS)
def test_what_walls_give_is_what_elastic_disks_gain(order: str) -> None:
    """Kinetic energy and m g h together; nothing is dissipated."""
    engine = shaken(order, law=ELASTIC)
    start = engine.state()
    end = run_to(engine, 15.0)

    def energy(state: State) -> float:
        kinetic = 0.5 * np.sum(state.velocity**2) + 0.5 * np.sum(engine.disks.inertia * state.spin**2)
        return float(kinetic + 0.1 * np.sum(state.position[:, 1]))

    assert engine.wall_collisions > 300
    assert abs(engine.wall_work) > 1.0
    assert energy(end) - energy(start) == pytest.approx(engine.wall_work, abs=1e-9)
    assert np.all(end.position > 0.5 - 1e-9)


def test_a_ball_that_comes_to_rest_on_a_wall_stops_the_run_with_a_reason() -> None:
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State(np.array([[5.0, 3.0]]), np.zeros((1, 2)), np.zeros(1))
    law = np.array([[(0.5, *ELASTIC[1:])]])
    engine = engine_of(disks, Box((10.0, 10.0), (True, False)), start, law, gravity=(0.0, -1.0))
    with pytest.raises(InelasticCollapse, match="came to rest on a wall"):
        run_to(engine, 100.0)


def hits_of_a_viscoelastic_ball(height: float, A: float, Y: float, most: int) -> np.ndarray:
    """Times of hits of a disk of mass 1 and radius 1/2 on a floor under gravity 1, dropped from a height above it.

    Between two hits it flies for 2 v / g. With e_n = 1 - c v^(1/5), v falls by c v^(6/5) a hit: v_n goes as
    (5 / c n)^5, and the sum of the flights converges, so that infinitely many hits take a finite time. e_n is the
    approximant of Mueller and Poeschel, Phys. Rev. E 84, 021302 (2011); at a flat wall R is the disk's radius.
    """
    v, times = math.sqrt(2.0 * height), [math.sqrt(2.0 * height)]
    while len(times) < most:
        b = 1.5 * A * ((2.0 * Y * math.sqrt(0.5) / 3.0) ** 2 * v) ** 0.2
        x = math.sqrt(b)
        v *= (1.0 + 0.501086 * x) / (1.0 + 0.501086 * x + b * (1.15345 + 0.577977 * x + 0.532178 * b))
        times.append(times[-1] + 2.0 * v)
    return np.array(times)


def viscoelastic_balls(n: int = 1, **options: Any) -> Engine:
    """Balls side by side, dropped from some height above a floor; the last one from 1.5."""
    law, x = laws.Viscoelastic(A=0.3, Y=math.sqrt(2.0)), np.arange(1.0, 2.0 * n, 2.0)
    start = State(
        np.column_stack([x, 2.0 + 0.1 * (np.arange(1, n + 1) % n % 7)]), np.zeros((n, 2)), np.zeros(n)
    )
    box, disks = Box((max(10.0, 2.0 * n), 10.0), (True, False)), Disks(n, mass=1.0, radius=0.5)
    return Engine(Setup(box, ((law,),), gravity=(0.0, -1.0)), disks, start, **options)


@pytest.mark.full
def test_a_viscoelastic_ball_that_comes_to_rest_stops_the_run_with_a_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its losses go below rounding before its speed does: it then bounces for ever, each time for 6e-14.

    A run said nothing, and did not end. The first launch ends after a second of work, where Python regains control.
    """
    monkeypatch.setattr(f"{RUNNER}.LONG", 0)  # one launch has shown it
    times = hits_of_a_viscoelastic_ball(1.5, 0.3, math.sqrt(2.0), 100_000)
    assert 9.27 < times[-1] < 9.28
    engine = viscoelastic_balls()
    run_to(engine, 9.2)
    assert engine.wall_collisions == np.count_nonzero(times < 9.2) == 24
    with pytest.raises(InelasticCollapse, match="without end in a window") as stopped:
        run_to(engine, 20.0)
    begin, end = map(float, re.findall(r"t = (\S+) to (\S+):", str(stopped.value))[0])
    assert begin < times[-1] < end
    assert "packing fraction" not in str(stopped.value)  # only a wall is hit


@pytest.mark.full
def test_a_window_without_end_lets_signals_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels hold the interpreter's lock: a launch ends after some 1e5 events, so that a handler can act."""
    monkeypatch.setattr(f"{RUNNER}.LONG", 10**12)
    before = signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(TimeoutError))
    engine = viscoelastic_balls()
    run_to(engine, 8.0)
    signal.setitimer(signal.ITIMER_REAL, 0.1, 0.1)
    try:
        with pytest.raises(TimeoutError):
            run_to(engine, 20.0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.full
def test_a_long_window_that_pauses_for_its_work_has_the_bits_of_one_that_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A ball between walls 1e-6 apart hits them 8.8e5 times in the time 0.44 of a window: launches end within it.

    With frames in it, which the run has to find again after each pause.
    """
    ends, launches = [], []

    def counted(self: Any, *given: int) -> None:
        launches.append(None)
        work_on(self, *given)

    slot = [Wall.line((0.0, 4.5), (0.0, 1.0)), Wall.line((0.0, 5.5 + 1e-6), (0.0, -1.0))]
    start = State([[5.0, 5.0 + 5e-7]], [[0.3, 1.0]], [0.0])
    for steps in ([2.0], [0.05, 0.6, 0.61, 2.0]):
        engine = engine_of(
            Disks(1, mass=1.0, radius=0.5), Box((10.0, 10.0), (True, False)), start, LAW, walls=slot
        )
        if not ends:
            work_on = type(engine.windows.runner)._work_on
            monkeypatch.setattr(f"{RUNNER}.TileRunner._work_on", counted)
        for t in steps:
            state = run_to(engine, t)
        ends.append((state.position, state.velocity, engine.wall_collisions))
    assert launches  # that ended within a window
    # Each crossing of 1e-6 at a speed of 1.
    assert ends[0][2] == pytest.approx(2.0e6, abs=2)
    assert ends[0][2] == ends[1][2]
    for one, other in zip(ends[0][:2], ends[1][:2], strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.full
def test_a_collapse_in_one_of_many_tiles_stops_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tile cannot pause: it leaves the window to one thread, which can. Ctrl-C acts after each launch: all are short.

    A launch of 24 tiles had 15 million events, in 17 s, and those of one thread afterwards 14 s.
    """
    launches = []

    def counted(self: Any, *given: int) -> None:
        call_kernels(self, *given)
        launches.append((bool(self.arrays.grid.single_tile), int(self.arrays.counter.n_events)))

    call_kernels = TileRunner._call_kernels
    monkeypatch.setattr(TileRunner, "_call_kernels", counted)
    engine = viscoelastic_balls(24, order="tiled", tile_disks=6)
    assert engine.arrays.tiles > 1
    with pytest.raises(InelasticCollapse, match="without end in a window"):
        run_to(engine, 20.0)
    longest = [max(events for alone, events in launches if alone is single) for single in (False, True)]
    # One tile a thread until it is marked, and the others until they look.
    assert (
        0 < longest[0] < 2 * (LONG // 5 + 24 * LONG_OF_A_DISK) + (engine.arrays.tiles + 2) * EVENTS_OF_A_LOOK
    )
    assert 0 < longest[1] < MOST_EVENTS_OF_A_LAUNCH + 2 * EVENTS_OF_A_LOOK


@pytest.mark.parametrize("order", ORDERS)
def test_a_cut_off_keeps_a_ball_bouncing_with_a_speed_just_below_it(order: str) -> None:
    """Each bounce faster than the cut-off halves the speed, the others keep it: it ends between half of it and it."""
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State(np.array([[5.0, 3.0]]), np.zeros((1, 2)), np.zeros(1))
    law = np.array([[(0.5, *ELASTIC[1:])]])
    engine = engine_of(
        disks,
        Box((10.0, 10.0), (True, False)),
        start,
        law,
        gravity=(0.0, -1.0),
        collapse=VelocityCutoff(0.3),
        order=order,
    )
    state = run_to(engine, 60.0)
    speed = math.sqrt(state.velocity[0, 1] ** 2 + 2.0 * (state.position[0, 1] - 0.5))  # at the floor
    fallen = math.sqrt(2.0 * 2.5)
    slowing = math.ceil(math.log2(fallen / 0.3))
    assert speed == pytest.approx(fallen / 2.0**slowing, rel=1e-9)
    assert engine.statistics.elastic == engine.wall_collisions - slowing > 50


@pytest.mark.parametrize("order", ORDERS)
def test_a_cut_off_takes_no_energy_from_slow_collisions(order: str) -> None:
    box = Box((12.0, 12.0), (False, True))
    disks, state = gas_in(box, 60)
    engine = engine_of(
        disks, box, state, np.array([[COIN]]), collapse=VelocityCutoff(100.0), order=order, tile_disks=20
    )
    end = run_to(engine, 10.0)
    assert engine.statistics.elastic == engine.collisions + engine.wall_collisions > 100
    assert np.sum(end.velocity**2) == pytest.approx(np.sum(state.velocity**2), rel=1e-12)
    np.testing.assert_array_equal(end.spin, state.spin)


@pytest.mark.parametrize(
    ("wall", "message"),
    [
        (lambda: Wall.line((0.0, 3.2), (0.0, 1.0)), "overlaps wall 0"),
        (lambda: Wall.line((0.0, 1.0), (0.0, 0.0)), r"towards = \(0, 0\): must not be 0"),
        (lambda: Wall.container((5.0, 5.0), -1.0), "radius = -1.0"),
        (lambda: Wall.line((0.0, 1.0), (0.0, 1.0), motion=Motion("sin")), "nearest|did you mean"),
        (lambda: Wall.post((5.0, 1.0), 0.5, material=3), "material index 3"),
        (lambda: Wall.line((1.0, 0.0), (1.0, 0.0)), "across a periodic direction"),
    ],
)
def test_impossible_walls_are_refused(wall: object, message: str) -> None:
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State(np.array([[5.0, 3.0]]), np.zeros((1, 2)), np.zeros(1))
    with pytest.raises(InputError, match=message):
        engine_of(disks, Box((10.0, 10.0), (True, False)), start, LAW, walls=[wall()])  # type: ignore[operator]


@pytest.mark.full
@pytest.mark.parametrize("order", ORDERS)
def test_drag_and_gravity_together_reach_the_terminal_velocity(order: str) -> None:
    """dv/dt = g - gamma v ends at g / gamma; midpoint steps of dt leave a relative error of (gamma dt)^2 / 24.

    A step: v gains g dt / 2, is multiplied by exp(-gamma dt), and gains g dt / 2. Its fixed point just before a half
    step ends is g dt (1 + exp(-gamma dt)) / (2 (1 - exp(-gamma dt))) = (g / gamma) (1 + (gamma dt)^2 / 12 + ...).
    """
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State(np.array([[5.0, 380.0]]), np.zeros((1, 2)), np.zeros(1))
    dt, gamma = 0.1, 0.5
    engine = engine_of(
        disks, Box((40.0, 400.0), (True, False)), start, LAW, gravity=(0.0, -2.0), order=order,
        forces=[forces.Drag(step=dt, rate=gamma)],
    )  # fmt: skip
    state = run_to(engine, 60.0)
    decay = math.exp(-gamma * dt)
    assert state.velocity[0, 1] == pytest.approx(-2.0 * dt * (1.0 + decay) / (2.0 * (1.0 - decay)), rel=1e-9)
    assert engine.wall_collisions == 0


@pytest.mark.parametrize("wall", ["post", "segment"])
def test_a_wall_that_would_leave_through_a_periodic_side_is_refused(wall: str) -> None:
    motion = Motion("steady", direction=(1.0, 0.0), speed=1.0)
    places = {
        "post": Wall.post((15.0, 15.0), 4.0, motion=motion),
        "segment": Wall.segment((15.0, 10.0), (15.0, 20.0), motion=motion),
    }
    state = State(np.array([[2.0, 2.0]]), np.zeros((1, 2)), np.zeros(1))
    with pytest.raises(InputError, match="carries it across a periodic side"):
        engine_of(
            Disks(1, mass=1.0, radius=0.5),
            Box((30.0, 30.0)),
            state,
            np.array([[ELASTIC]]),
            walls=[places[wall]],
        )


@pytest.mark.parametrize("frames", [1, 20, 80, 400])
def test_a_disk_that_comes_to_rest_on_a_wall_ends_the_run_at_any_rate_of_readout(frames):
    disks, box = Disks(1, mass=1.0, radius=0.5), Box((10.0, 10.0), periodic=(False, False))
    start = State([[5.0, 1.0]], [[0.0, 0.0]], [0.0])
    run = Simulation(disks, box, IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0), start, gravity=(0.0, -1.0))
    # It falls for a time 1; then it jumps for 2 (e + e^2 + ...) = 2: at rest at t = 3, found at the window's end.
    with pytest.raises(InelasticCollapse):
        run.run(t_end=8.0, frames=frames)
    assert run.time < 3.1


@pytest.mark.full
def test_windows_under_oblique_gravity_are_planned_alike_by_host_and_kernel():
    """Their length has the square root of g_x^2 + g_y^2: one formula on the host and in the kernel, to the last bit."""
    g = (0.8603990317990844, 2.8716236178431096)  # math.hypot differs in its last bit
    disks, box = Disks(120, mass=1.0, radius=0.4), Box((30.0, 30.0), periodic=(False, False))
    position = random_positions(box, disks.radius, seed=0)
    start = State(position, maxwellian(disks.mass, speed_rms=1.0, seed=0), np.zeros(120))
    found = []
    for tracked in ([], [3]):
        run = Simulation(disks, box, IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), start, gravity=g, histories=tracked)
        run.run(t_end=5.0)
        found.append(run.state.position)
    assert np.array_equal(*found)


def test_a_gas_that_starts_at_rest_falls_alike_in_tiles_and_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Squares of speeds are added up in a unit that fits speeds at the end of a window, which no disk has before."""
    side, n = 40, 1600
    lattice = np.stack(np.meshgrid(*[1.3 * np.arange(side) + 0.65] * 2), axis=-1).reshape(-1, 2)
    position = lattice + np.random.default_rng(5).uniform(-0.05, 0.05, lattice.shape)
    start = State(position, np.zeros((n, 2)), np.zeros(n))
    box = Box((1.3 * side, 1.3 * side + 5.0), (True, False))
    found = []
    for alone in (20_000, 100):
        monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", alone)
        gas = Simulation(
            Disks(n, mass=1.0, radius=0.5), box, IFRLaw(e_n=0.9, e_t=-0.6, mu=0.3), start, gravity=(0.0, -1.0),
            device=Device(window_collisions=1.0),
        )  # fmt: skip
        gas.run(t_end=2.0)
        found.append(gas)
    assert found[0].collisions > 300
    assert [gas.collisions for gas in found] == [found[0].collisions] * 2
    np.testing.assert_array_equal(found[1].state.position, found[0].state.position)
    np.testing.assert_array_equal(found[1].state.velocity, found[0].state.velocity)
