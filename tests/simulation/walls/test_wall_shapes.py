"""Arcs, polygons, rotating walls, gates, and sums of each wall: bits, balances, and no disk escapes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.gases import COIN, ELASTIC, run_to

from ifrdem import Device, VelocityCutoff
from ifrdem.errors import InputError
from ifrdem.initial import maxwellian, random_positions
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Turn
from ifrdem.model.walls.wall import SUMS, Wall
from ifrdem.simulation import backend
from ifrdem.simulation.engine import ORDERS, Engine
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.rows import engine_of

SIDE = 30.0
BOX = Box((SIDE, SIDE), (False, False))
MIDDLE = (15.0, 15.0)
PADDLE = Turn("steady", center=MIDDLE, rate=0.7)


def outline(radius: float, sides: int) -> list[tuple[float, float]]:
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return [(15.0 + radius * math.cos(a), 15.0 + radius * math.sin(a)) for a in angle]


def room() -> list[Wall]:
    """A room of many sides with a paddle, a bowl that swings, a zigzag, an obstacle and two gates."""
    swing = Turn("sine", center=(15.0, 24.0), amplitude=0.4, frequency=0.2)
    return [
        Wall.polygon(outline(14.5, 40), holds="inside"),
        Wall.segment((11.0, 15.0), (19.0, 15.0), turn=PADDLE, group="paddle"),
        Wall.segment((15.0, 11.0), (15.0, 19.0), turn=PADDLE, group="paddle"),
        Wall.arc((15.0, 24.0), 1.5, (-2.8, 0.3), turn=swing),
        Wall.polyline([(4.0, 11.0), (6.0, 14.0), (4.0, 17.0), (6.0, 19.0)]),
        Wall.polygon([(15.0, 4.0), (17.0, 6.0), (14.0, 5.5)], holds="outside"),
        Wall.segment((24.0, 8.0), (24.0, 12.0), opens_at=1.3),
        Wall.arc((24.0, 19.0), 1.0, (0.0, 2.0 * math.pi), opens_after=150),
        Wall.post((0.03, 0.03), 0.01, temperature=1.0),  # out of reach: all scenes share kernels
    ]


# So deep in a corner that no disk reaches them: what the room has too.
CORNER = [
    Wall.segment(
        (0.03, 0.03), (0.05, 0.03), turn=Turn("steady", center=(0.04, 0.03), rate=0.1), opens_at=1e3
    ),
    Wall.arc((0.03, 0.05), 0.01, (0.0, 3.0)),
    Wall.polyline([(0.05, 0.02), (0.06, 0.03), (0.05, 0.04)], temperature=1.0),
]
K = np.array([2.0, 1.0])  # two kinds of disks, for the same reason


def in_room(
    order: str | None = None, *, n: int = 120, law: tuple[float, ...] = COIN, sums: bool = True,
    threads: int | None = None, walls: list[Wall] | None = None, gravity: tuple[float, float] = (0.0, -0.3),
    cutoff: float = 0.0,
) -> Engine:  # fmt: skip
    disks = Disks(n, mass=1.0, radius=np.where(np.arange(n) % 3 == 0, 0.45, 0.3))
    walls = room() if walls is None else walls
    position = random_positions(BOX, disks.radius, seed=3, walls=walls)
    state = State(position, maxwellian(disks.mass, speed_rms=1.0, seed=3), np.zeros(n))
    return engine_of(
        disks, BOX, state, np.array([[law]]), order=order, walls=walls, gravity=gravity, record=["wall_sums"] * sums,
        tile_disks=30, device=Device(threads=threads), collapse=VelocityCutoff(cutoff) if cutoff else None,
    )  # fmt: skip


def same(one: State, other: State) -> None:
    for name in ("position", "velocity", "spin", "collisions", "wall_collisions"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.full
def test_bits_do_not_depend_on_tiles_threads_looks_or_sums() -> None:
    """Gates end windows; a readout, or sums of impulses, change nothing."""
    end = 9.0
    expected = in_room("serial")
    state = run_to(expected, end)
    assert expected.collisions > 300
    assert list(np.flatnonzero(expected.open_gates)) == [6, 7]
    assert expected.wall_sums[:8, SUMS.index("hits")].min() > 0  # each was hit
    for order in ORDERS[1:]:
        tiles = in_room(order)
        same(run_to(tiles, end), state)
        assert tiles.arrays.tiles == 4
        np.testing.assert_allclose(tiles.wall_sums, expected.wall_sums, rtol=0.0, atol=1e-10)
    same(run_to(in_room("serial", sums=False), end), state)
    looked = in_room("serial")
    for t in np.linspace(0.0, end, 41)[1:]:
        same_time = run_to(looked, float(t))
    same(same_time, state)
    np.testing.assert_array_equal(looked.wall_sums, expected.wall_sums)
    same(run_to(in_room("tiled", threads=min(2, backend.cores())), end), state)


@pytest.mark.full
def test_bits_of_a_shaken_container_under_gravity_do_not_depend_on_tiles() -> None:
    """Its root is found in steps whose last bits depend on how far ahead their bounds reach: to the window's end."""
    shaken = Motion("sine", (1.0, 0.4), amplitude=0.3, frequency=0.3)
    walls = [Wall.container(MIDDLE, 14.5, motion=shaken), Wall.post((15.0, 10.0), 1.0), *CORNER]
    for pull in (-0.4, -0.5):
        one, other = (in_room(order, walls=walls, gravity=(0.1, pull)) for order in ORDERS)
        same(run_to(one, 9.0), run_to(other, 9.0))
        assert one.wall_collisions > 150


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("order", ORDERS)
def test_walls_give_what_disks_get(order: str) -> None:
    """Momentum: of the disks, less what gravity gave. Energy: elastic disks keep all work. Rotation: work is torque
    times w.

    Spins too: rough disks of e_t = 1 keep their energy (Eq. 8: the slip is reversed). Momentum in y falls by m g t n.
    """
    for law in (ELASTIC, (1.0, 1.0, 0.0, 1.0, 0.0)):
        engine = in_room(order, law=law)
        start = engine.state()
        end = run_to(engine, 5.0)
        sums = engine.wall_sums
        n = engine.n
        gained = end.velocity.sum(axis=0) - start.velocity.sum(axis=0) - [0.0, -0.3 * 5.0 * n]
        np.testing.assert_allclose(sums[:, :2].sum(axis=0), gained, atol=1e-10)
        kinetic = [
            0.5 * np.sum(s.velocity**2)
            + 0.5 * np.sum(engine.disks.inertia * s.spin**2)
            + 0.3 * np.sum(s.position[:, 1])
            for s in (start, end)
        ]
        work = sums[:, SUMS.index("work")]
        assert work.sum() == pytest.approx(kinetic[1] - kinetic[0], abs=1e-9)
        assert engine.wall_work == pytest.approx(work.sum(), abs=1e-9)
        paddle = sums[1:3]
        assert abs(paddle[:, SUMS.index("work")].sum()) > 1.0
        np.testing.assert_allclose(paddle[:, 3], PADDLE.rate * paddle[:, 2], rtol=1e-12)
        np.testing.assert_array_equal(sums[[0, 4, 5, 6], 3], 0.0)  # at rest
        assert sums[:, SUMS.index("hits")].sum() == engine.wall_collisions


def test_torques_about_the_origin_are_those_of_the_angular_momentum() -> None:
    """Of walls at rest and without gravity: the angular momentum of all disks about the origin changes by them only."""
    walls = [
        Wall.polygon(outline(14.5, 9), holds="inside"),
        Wall.arc(MIDDLE, 4.0, (0.3, 4.0), surface_speed=0.4),
        *CORNER,
    ]
    engine = in_room(walls=walls, gravity=(0.0, 0.0))
    start, end = engine.state(), run_to(engine, 5.0)
    spun = [
        float(np.sum(s.position[:, 0] * s.velocity[:, 1] - s.position[:, 1] * s.velocity[:, 0]))
        + float(np.sum(engine.disks.inertia * s.spin))
        for s in (start, end)
    ]
    assert abs(spun[1] - spun[0]) > 1.0
    assert engine.wall_sums[:, SUMS.index("torque")].sum() == pytest.approx(spun[1] - spun[0], abs=1e-10)


def test_heat_of_a_thermal_wall_is_among_its_sums() -> None:
    walls = [Wall.polygon(outline(14.5, 6), holds="inside", temperature=2.0), Wall.post(MIDDLE, 2.0), *CORNER]
    engine = in_room(walls=walls, gravity=(0.0, 0.0))
    run_to(engine, 5.0)
    heat = engine.wall_sums[:, SUMS.index("heat")]
    assert heat[0] != 0.0
    np.testing.assert_array_equal(heat, engine.wall_heats)


@pytest.mark.full
def test_a_rotating_wall_is_equivalent_to_a_rotating_frame() -> None:
    """A free disk near a steadily rotating blade, in the frame of the blade: it meets it where plane geometry says.

    A disk of radius R at rest at distance d from the centre is met by a blade through the centre, at the angle beta
    against it, when sin(beta - w t) = R / d; an elastic smooth blade sends it off at 2 w sqrt(d^2 - R^2), the speed of
    the blade at the foot of the disk twice, along the blade's normal.
    """
    w, d, R, beta = 0.9, 3.0, 0.5, 1.0
    disks = Disks(2, mass=1.0, radius=R, k=K)
    start = State(
        [[15.0 + d * math.cos(beta), 15.0 + d * math.sin(beta)], [28.0, 28.0]], np.zeros((2, 2)), [0.0] * 2
    )
    blade = Wall.segment(MIDDLE, (20.0, 15.0), turn=Turn("steady", center=MIDDLE, rate=w))
    engine = engine_of(disks, BOX, start, np.array([[ELASTIC]]), walls=[blade, *CORNER], record=["wall_sums"])
    t = (beta - math.asin(R / d)) / w
    run_to(engine, t - 1e-12)
    assert engine.wall_collisions == 0
    state = run_to(engine, t + 1e-12)
    assert engine.wall_collisions == 1
    foot = math.sqrt(d * d - R * R)
    normal = np.array([-math.sin(w * t), math.cos(w * t)])
    np.testing.assert_allclose(state.velocity[0], 2.0 * w * foot * normal, rtol=1e-12)
    assert engine.wall_sums[0, SUMS.index("torque")] == pytest.approx(2.0 * w * foot**2, rel=1e-12)


@pytest.mark.full
@pytest.mark.parametrize("order", ORDERS)
def test_a_gate_opens_at_its_time_and_after_its_collisions_to_the_collision(order: str) -> None:
    """Disks behind a wall across the room do not pass it before; the n-th collision, found by a run without the gate
    moving, is when it opens: until then both runs are one."""
    ends = {"start": (0.0, 15.0), "end": (30.0, 15.0)}
    below = [Wall.line((0.0, 14.9), (0.0, -1.0))]  # where disks start, only
    disks = Disks(60, mass=1.0, radius=0.4, k=np.tile(K, 30))
    position = random_positions(BOX, disks.radius, seed=5, walls=below)
    state = State(position, maxwellian(disks.mass, speed_rms=1.0, seed=5), np.zeros(60))

    def behind(state: State, walls: list[Wall]) -> Engine:
        return engine_of(
            disks,
            BOX,
            state,
            np.array([[COIN]]),
            walls=walls,
            order=order,
            tile_disks=20,
            record=["wall_sums"],
        )

    def gated(**options: float) -> Engine:
        wall = Wall.segment(ends["start"], ends["end"], **options)  # type: ignore[arg-type]
        return behind(state, [wall, *CORNER])

    closed = gated()
    by_time, by_count = gated(opens_at=2.5), gated(opens_after=40)
    run_to(closed, collisions=40)
    while not by_count.open_gates[0]:
        by_count.advance(t_end=50.0)
    assert by_count.collisions == 40
    assert by_count.time == closed.time
    same(by_count.state(), closed.state())
    # From then on it is a gas without the gate, at once.
    opened = by_count.state()
    free = behind(opened, CORNER)
    t = opened.time + 1.0
    np.testing.assert_allclose(run_to(by_count, t).position, run_to(free, t).position, rtol=0.0, atol=1e-9)
    assert run_to(by_time, 2.5).position[:, 1].max() <= 14.6 + 1e-9
    assert by_time.open_gates[0]
    for engine in (by_time, by_count):
        assert run_to(engine, 12.0).position[:, 1].max() > 16.0
    assert run_to(closed, 12.0).position[:, 1].max() <= 14.6 + 1e-9


def test_a_wall_moves_from_one_time_to_another() -> None:
    """A floor that moves up by 0.5 in a second, from t = 1 to 2, meets a disk at rest 0.2 above it at t = 1.4."""
    floor = Wall.line(
        (0.0, 10.0), (0.0, 1.0), motion=Motion("steady", speed=0.5), moves_from=1.0, moves_until=2.0
    )
    disks = Disks(2, mass=1.0, radius=0.5, k=K)  # the second one is far away

    def above(y: float, speed: float, t: float) -> Engine:
        start = State([[15.0, y], [25.0, 25.0]], [[0.0, speed], [0.0, 0.0]], np.zeros(2), time=t)
        walls = [floor, *CORNER]
        return engine_of(disks, BOX, start, np.array([[ELASTIC]]), walls=walls, record=["wall_sums"])

    engine = above(10.7, 0.0, 0.0)  # the floor stands at 10 before
    run_to(engine, 1.4 - 1e-9)
    assert engine.wall_collisions == 0
    assert run_to(engine, 1.4 + 1e-9).velocity[0, 1] == pytest.approx(1.0, rel=1e-12)  # twice the floor's
    engine = above(12.5, -0.5, 1.9)  # the floor stands at 10.5 from t = 2 on
    assert run_to(engine, 1.9 + 3.0 + 1e-9).velocity[0, 1] == pytest.approx(0.5, rel=1e-12)  # met at rest


@pytest.mark.full
@pytest.mark.parametrize("order", ORDERS)
def test_walls_at_the_edges_of_cells_are_hit_as_elsewhere(order: str) -> None:
    """Each disk alone between two of the walls x = 0, 1, 2, ..., at the same places as edges of cells and tiles.

    Its centre moves freely on a segment of length w = 1 - 2 R, unfolded: (w / 2 + u t) mod 2 w.
    """
    side, radius, end = 64, 0.1, 5.0
    column, row = np.divmod(np.arange(side**2), side)
    u = np.random.default_rng(1).uniform(-2.0, 2.0, side**2)
    walls = [Wall.segment((float(x), 0.01), (float(x), side - 0.01)) for x in range(1, side)]
    state = State(np.stack((column + 0.5, row + 0.5), axis=1), np.stack((u, 0.0 * u), axis=1), 0.0 * u)
    box, disks = Box((side, side), (False, True)), Disks(side**2, mass=1.0, radius=radius)
    engine = engine_of(disks, box, state, np.array([[ELASTIC]]), walls=walls, order=order, tile_disks=64)
    assert engine.arrays.tiles == (1 if order == "serial" else 64)
    found = run_to(engine, end)
    w = 1.0 - 2.0 * radius
    turns, rest = np.divmod(0.5 * w + u * end, w)
    expected = column + radius + np.where(turns % 2 == 0, rest, w - rest)
    np.testing.assert_allclose(found.position[:, 0], expected, atol=1e-12)
    assert engine.wall_collisions == np.abs(turns).sum()
    assert engine.collisions == 0


@pytest.mark.parametrize(("above", "hits"), [(0.3, 1), (0.5 - 5e-10, 1), (0.5 + 5e-10, 0), (-1e-12, 1)])
def test_the_end_of_a_segment_is_a_point_and_nothing_is_beyond_it(above: float, hits: int) -> None:
    """A disk that flies past at this height above the end touches it at the angle whose sine is height over radius."""
    wall = Wall.segment((10.0, 8.0), (10.0, 12.0))
    start = State([[4.0, 12.0 + above]], [[1.0, 0.0]], [0.0])
    engine = engine_of(
        Disks(1, mass=1.0, radius=0.5), BOX, start, np.array([[ELASTIC]]), walls=[wall], order="serial"
    )
    found = run_to(engine, 8.0)
    height = max(above, 0.0)
    way = math.sqrt(max(0.25 - height**2, 0.0))
    normal = np.array([-way, height]) / 0.5
    velocity = np.array([1.0, 0.0]) - 2.0 * hits * normal[0] * normal
    touched = np.array([10.0 - way * hits, 12.0 + above])
    expected = touched + velocity * (8.0 - (touched[0] - 4.0))
    assert engine.wall_collisions == hits
    # Where it grazes, rounding of the height is that of way^2 = 5e-10: 1e-16 / 2e-5 of the angle.
    np.testing.assert_allclose(found.position[0], expected, atol=1e-9)


def test_sums_are_there_only_where_they_are_asked_for() -> None:
    disks = Disks(1, mass=1.0, radius=0.5)
    start = State([[8.0, 15.0]], [[0.0, 0.0]], [0.0])
    law = IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    run = Simulation(disks, BOX, law, start)
    with pytest.raises(InputError, match="wall_sums: not recorded"):
        _ = run.wall_sums
    run = Simulation(disks, BOX, law, start, walls=room()[:3], record=["wall_sums"])
    assert run.wall_sums.values.shape == (7, 6)
    assert run.measure().walls is not None
    assert run.wall_sums.of("paddle").values.shape == (1, 6)
    with pytest.raises(InputError, match="did you mean 'paddle'"):
        run.wall_sums.of("padle")


def test_a_disk_at_a_wall_may_start_but_for_rounding() -> None:
    """As disks that rest upon a wall do when a run is resumed: they stand a few times 1e-15 inside it."""
    container, law = Wall.container(MIDDLE, 4.0), IFRLaw(e_n=0.9, e_t=-0.7, mu=0.2)

    def start(overlap: float) -> Simulation:
        state = State(np.array([[18.5 + overlap, 15.0]]), np.array([[0.1, 0.3]]), np.zeros(1))
        return Simulation(Disks(1, mass=1.0, radius=0.5), BOX, law, state, walls=[container])

    gas = start(5e-15)
    gas.run(t_end=20.0)
    assert gas.wall_collisions > 0
    assert np.hypot(*(gas.state.position[0] - MIDDLE)) < 3.5 + 1e-12
    with pytest.raises(InputError, match=r"disk 0 at \(18.5, 15\) overlaps wall 0 \(container\) by 1e-08"):
        start(1e-8)
