"""Open boundaries: disks that fly apart for ever."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.gases import COIN, mixture, partners, run_to, start

from ifrdem import Device
from ifrdem.errors import InputError, NoMoreCollisions
from ifrdem.initial import placement
from ifrdem.model.box import Box
from ifrdem.model.forces import TableFriction
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.runs.info import describe
from ifrdem.simulation import backend
from ifrdem.simulation.engine import no_pair_approaches
from ifrdem.simulation.simulation import Simulation
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter
from ifrdem.validation.rows import engine_of

LAW = IFRLaw(e_n=COIN[0], e_t=COIN[1], mu=COIN[2])


def blob(n: int, packing_fraction: float = 0.4, at: tuple[float, float] = (-7.0, 3.0)) -> tuple[Disks, State]:
    """Disks of two kinds that fill a square with its corner anywhere."""
    disks = mixture(n)
    _, state = start(disks, packing_fraction)
    return disks, State(state.position + at, state.velocity, state.spin)


@pytest.mark.full
@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_collisions_are_those_in_a_huge_periodic_box(order: str) -> None:
    """Both gases have the same pairs in order until rounding separates them; no disk nears a side of the huge box."""
    disks, state = blob(150)
    found = []
    huge = State(state.position + 2000.0, state.velocity, state.spin)
    for box, begin in ((Box.open(), state), (Box((4000.0, 4000.0)), huge)):
        engine = engine_of(disks, box, begin, np.array([[COIN]]), order=order, tile_disks=40)
        engine.keep_collisions = True
        times, pairs = [], []
        while engine.time < 3.0:
            engine.advance(t_end=3.0)
            if engine.last_collisions is not None:
                times.append(engine.last_collisions.time)
                pairs.append(engine.last_collisions.pair)
        found.append((np.concatenate(times), np.concatenate(pairs), engine.state()))
    (t, pair, end), (t_huge, pair_huge, end_huge) = found
    assert len(t) > 250
    np.testing.assert_array_equal(partners(pair), partners(pair_huge))
    np.testing.assert_allclose(t, t_huge, rtol=1e-8)  # some collisions a disk enlarge the rounding of 4000
    np.testing.assert_allclose(end.position, end_huge.position - 2000.0, atol=1e-6)
    assert not end.image.any()


def test_a_gas_that_flies_apart_costs_the_logarithm_of_the_time() -> None:
    """Once no disk approaches another one there are no more windows; until then each tenfold time takes as many."""
    disks, state = blob(200)
    engine = engine_of(disks, Box.open(), state, np.array([[COIN]]))
    windows = []
    for t_end in (10.0, 100.0, 1e3, 1e4, 1e5, 1e12):
        run_to(engine, t_end)
        windows.append(engine.statistics.windows)
    assert windows[-1] < 500  # 200 were seen
    assert max(np.diff(windows)) < 200
    assert windows[-1] == windows[-2]
    end = engine.state()
    later = run_to(engine, 3e12)
    # f64 round-off of places in a box some 1e13 wide.
    np.testing.assert_allclose(later.position, end.position + 2e12 * end.velocity, atol=0.1)
    np.testing.assert_array_equal(later.velocity, end.velocity)
    with pytest.raises(NoMoreCollisions, match="flown apart, and none can meet another one any more"):
        engine.advance(collisions=engine.collisions + 1)


@pytest.mark.full
def test_no_pair_that_will_meet_is_taken_for_parted() -> None:
    """A disk that chases another one for 1e6 time units, in a gas that otherwise flies apart."""
    n = 40
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    out = np.column_stack((np.cos(angle), np.sin(angle)))
    position, velocity = 20.0 * out, 1.0 * out
    position[0], velocity[0] = [22.0, 0.0], [1.0, 0.0]
    position = np.vstack((position, [0.0, 0.0]))
    velocity = np.vstack((velocity, [1.0 + 21.0 / 1e6, 0.0]))
    disks = Disks(n + 1, mass=1.0, radius=0.5)
    state = State(position, velocity, np.zeros(n + 1))
    assert not no_pair_approaches(state, disks)
    simulation = Simulation(disks, Box.open(), LAW, state)
    found = simulation.collide_until(2e6)
    np.testing.assert_array_equal(found.pair, [[0, n]])
    assert found.time[0] == pytest.approx(1e6, rel=1e-9)
    assert no_pair_approaches(simulation.state, disks)


@pytest.mark.full
def test_any_number_of_threads_gives_the_same_bits() -> None:
    disks, state = blob(400)
    law = np.array([[COIN]])
    ends = [
        run_to(
            engine_of(
                disks, Box.open(), state, law, order="tiled", tile_disks=60, device=Device(threads=threads)
            ),
            20.0,
        )
        for threads in (min(2, backend.cores()), 1)
    ]
    for name in ("position", "velocity", "spin", "collisions"):
        np.testing.assert_array_equal(getattr(ends[0], name), getattr(ends[1], name))
    assert np.ptp(ends[0].position) > 4.0 * np.ptp(state.position)  # through several boxes


def test_momentum_and_the_balance_of_energy_are_kept_through_all_boxes() -> None:
    disks, state = blob(300)
    gas = Simulation(disks, Box.open(), LAW, state)
    gas.run(t_end=1e4)
    before, after = measure(disks, state), measure(disks, gas.state)
    assert gas.dissipated_energy == pytest.approx(before.energy - after.energy, rel=1e-13)
    assert gas.dissipated_energy > 0.05 * before.energy
    np.testing.assert_allclose(after.momentum, before.momentum, atol=1e-12 * np.abs(disks.mass).sum())


@pytest.mark.parametrize("n", [0, 1, 2, 3, 5])
def test_few_disks_fly_in_open_space(n: int) -> None:
    """On a line along x, the leftmost one at speed 1, smooth and elastic: it hands its speed on to the last one."""
    x = 3.0 * np.arange(n)
    velocity = np.zeros((n, 2))
    velocity[:1, 0] = 1.0
    elastic = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    begin = State(np.column_stack((x, np.zeros(n))), velocity, np.zeros(n))
    gas = Simulation(Disks(n, mass=1.0, radius=0.5), Box.open(), elastic, begin)
    gas.run(t_end=1e7, frames=3)
    assert gas.collisions == max(n - 1, 0)
    if n:
        # Each contact hands the place on by a diameter: 1e7 t less n - 1 diameters, from the first place.
        assert gas.state.position[-1, 0] == pytest.approx(1e7 + (n - 1) * 1.0, rel=1e-12)
        np.testing.assert_allclose(gas.state.velocity[:, 0], velocity[::-1, 0], atol=1e-15)


@pytest.mark.full
def test_coins_on_an_open_table_come_to_rest() -> None:
    """Friction in open space: 100 coins from a dense patch; the run reaches its end at no cost."""
    disks, state = blob(100)
    gas = Simulation(disks, Box.open(), LAW, state, forces=[TableFriction(0.05, mu=0.5, gravity=1.0)])
    gas.run(t_end=20.0)
    windows = gas.statistics.windows
    gas.run(t_end=1e8)
    assert gas.statistics.windows == windows
    assert not gas.state.velocity.any()
    placement.check_no_overlap(Box.open(), disks.radius, gas.state.position)
    begin = measure(disks, state).energy
    assert gas.dissipated_energy - gas.energy_input == pytest.approx(begin, rel=1e-12)


def test_a_trajectory_says_that_there_are_no_boundaries(tmp_path: Path) -> None:
    disks, state = blob(20)
    path = tmp_path / "open.h5"
    with TrajectoryWriter(path, disks, Box.open(), precision="f64", fields=["position", "image"]) as file:
        gas = Simulation(disks, Box.open(), LAW, state)
        gas.run(t_end=100.0, frames=2, frame_callbacks=[lambda state, _: file.write(state)])
    with Trajectory(path) as trajectory:
        assert trajectory.box == Box.open()
        assert list(trajectory._file["particles/all/box"].attrs["boundary"]) == [b"none"] * 3
        np.testing.assert_allclose(trajectory[0].position, state.position, atol=1e-14)  # rounding of its box
        np.testing.assert_array_equal(trajectory[-1].position, gas.state.position)
        assert not trajectory[-1].image.any()
    assert "box               open" in describe(path)
    assert "packing fraction" not in describe(path)


def test_a_box_is_open_on_all_sides_or_on_none() -> None:
    box = Box.open()
    assert box.is_open
    assert box == Box((math.inf, math.inf), (False, False))
    assert not Box((1.0, 1.0), (False, False)).is_open
    far = np.array([[-1e9, 3.0]])
    np.testing.assert_array_equal(box.wrap(far), far)
    np.testing.assert_array_equal(box.minimum_image(far), far)
    for lengths, periodic in (((math.inf, 1.0), (False, False)), ((math.inf, math.inf), (True, True))):
        with pytest.raises(InputError, match=r"must be two positive finite numbers \(Box.open"):
            Box(lengths, periodic)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"walls": [Wall.post((50.0, 0.0), 1.0)]}, r"walls: cannot be combined with box = Box.open"),
        ({"gravity": (0.0, -1.0)}, r"gravity = .* with box = Box.open"),
    ],
)
def test_what_an_open_box_cannot_have_is_refused(options: dict[str, Any], message: str) -> None:
    disks, state = blob(20)
    with pytest.raises(InputError, match=message):
        Simulation(disks, Box.open(), LAW, state, **options)


def test_disks_that_overlap_in_open_space_are_refused() -> None:
    state = State([[-5.0, 0.0], [-4.5, 0.0]], np.zeros((2, 2)), np.zeros(2))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"disks 0 and 1 overlap by 0\.5"):
        Simulation(Disks(2, mass=1.0, radius=0.5), Box.open(), LAW, state)
