"""Conservation laws and collision rates of the engine, and the end of unusual runs."""

from __future__ import annotations

import numpy as np
import pytest
from support.gases import COIN, ELASTIC, ROLLING, equal_disks, equilibrated, gas_of, mixture, run_to, start

import ifrdem.simulation.engine
from ifrdem import Device
from ifrdem.errors import EngineError, InputError, NoMoreCollisions
from ifrdem.initial import placement
from ifrdem.kernels.columns import bytes_per_disk
from ifrdem.model.box import Box
from ifrdem.model.forces import Rescale
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.simulation import backend
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.windows.windows import NEXT, WindowState
from ifrdem.validation.rows import engine_of

SMOOTH = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
COIN_LAW = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)


def advance(engine: Engine, per_disk: float) -> None:
    run_to(engine, collisions=engine.collisions + int(per_disk * engine.n / 2))


@pytest.mark.parametrize(
    ("packing_fraction", "rate"), [pytest.param(0.1, 0.5329, marks=pytest.mark.full), (0.3, 2.3996)]
)
def test_elastic_gas_keeps_energy_and_momentum_and_collides_at_the_enskog_rate(
    packing_fraction: float, rate: float, device: str
) -> None:
    """A million collisions of 20,000 smooth elastic disks, T = m = sigma = 1.

    Rate per disk: 8 phi g sqrt(T / (pi m)) / sigma, with g from the virial series of hard disks.
    """
    disks = equal_disks(20_000)
    box, state = equilibrated(disks, packing_fraction)
    engine = engine_of(disks, box, state, np.array([[ELASTIC]]), device=device)
    advance(engine, 100)
    end = engine.state()
    energy = [0.5 * float(np.sum(s.velocity**2)) for s in (state, end)]
    # Rounding: a random walk of 1e-16 relative steps, 100 for each disk, all disks alike: below 1e-13.
    assert energy[1] == pytest.approx(energy[0], rel=1e-12)
    drift = end.velocity.sum(axis=0) - state.velocity.sum(axis=0)
    np.testing.assert_allclose(drift / np.abs(state.velocity).sum(), 0.0, atol=1e-13)
    np.testing.assert_array_equal(end.spin, state.spin)  # smooth disks never turn
    # Temperature is conserved, so the rate is constant; a million collisions scatter by 0.1 %.
    assert 2 * engine.collisions / disks.n / engine.time == pytest.approx(rate, rel=0.005)
    assert int(end.collisions.sum()) == 2 * engine.collisions


def test_frictional_gas_keeps_momentum_and_loses_energy_at_every_frame(device: str) -> None:
    disks = mixture(3000)
    box, state = start(disks, 0.4)
    simulation = Simulation(disks, box, COIN_LAW, state, device=device)
    energies, momenta = [], []
    simulation.run(
        collisions_per_disk=20,
        frames=20,
        frame_callbacks=[lambda _, m: (energies.append(m.energy), momenta.append(m.momentum))],  # type: ignore[func-returns-value]
    )
    assert len(energies) == 21
    assert (np.diff(energies) < 0.0).all()
    scale = float(np.sum(disks.mass * np.hypot(*state.velocity.T)))
    np.testing.assert_allclose(np.array(momenta) / scale, 0.0, atol=1e-14)  # rounding


def test_dense_disks_never_overlap() -> None:
    disks = equal_disks(2000)
    box, state = equilibrated(disks, 0.7)
    engine = engine_of(disks, box, state, np.array([[COIN]]))
    for _ in range(20):
        advance(engine, 2)
        # A pair that just touched may stand closer than contact by the rounding of two positions.
        placement.check_no_overlap(box, disks.radius, engine.state().position, tolerance=1e-12)


def states_equal(a: State, b: State) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for name in ("position", "velocity", "spin", "collisions", "image")
    )


@pytest.mark.full
@pytest.mark.skipif(backend.cores() < 2, reason="needs two cores")
def test_trajectory_is_bitwise_the_same_on_one_and_two_threads() -> None:
    disks = equal_disks(20_000)
    box, state = start(disks, 0.5)
    ends = []
    for threads in (2, 1):
        engine = engine_of(
            disks,
            box,
            state,
            np.array([[COIN]]),
            device=Device(threads=threads),
            order="tiled",
            tile_disks=500,
        )
        advance(engine, 10)
        ends.append((engine.time, engine.state()))
    for time, end in ends[1:]:
        assert time == ends[0][0]
        assert states_equal(end, ends[0][1])


def test_order_of_disks_in_memory_does_not_matter_for_where_they_go() -> None:
    """Disks far from the origin, and across a side, move as they do elsewhere: a shifted gas is a shifted gas."""
    disks = equal_disks(500)
    box, state = equilibrated(disks, 0.4)
    shift = np.array([0.3, 0.7]) * box.lengths
    moved = State(box.wrap(state.position + shift), state.velocity, state.spin)
    ends = []
    for s in (state, moved):
        engine = engine_of(disks, box, s, np.array([[COIN]]))
        advance(engine, 4)
        ends.append(engine.state())
    # Other rounding from the start; four collisions amplify it by some 1e4.
    np.testing.assert_allclose(box.minimum_image(ends[1].position - ends[0].position - shift), 0.0, atol=1e-8)


def test_head_on_pair_meets_at_the_time_and_place_of_geometry(device: str) -> None:
    """Centres 4 apart, closing at 1.5, contact distance 1.1: they touch at t = 2.9 / 1.5 = 1.9333."""
    disks = Disks(2, mass=[2.0, 1.0], radius=[0.5, 0.6])
    box = Box((40.0, 40.0))
    state = State(np.array([[18.0, 20.0], [22.0, 20.0]]), np.array([[1.0, 0.0], [-0.5, 0.0]]), np.zeros(2))
    simulation = Simulation(disks, box, IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0), state, device=device)
    found = simulation.collide_until(5.0)
    np.testing.assert_array_equal(found.pair, [[0, 1]])
    assert found.time[0] == pytest.approx(2.9 / 1.5, rel=1e-14)  # rounding
    # Momentum 1.5 shared by 3, relative speed 0.8 * 1.5: v = 0.5 -+ (1/3, 2/3) * 1.2.
    np.testing.assert_allclose(simulation.state.velocity[:, 0], [0.5 - 0.4, 0.5 + 0.8], rtol=1e-14)
    t = 5.0 - 2.9 / 1.5
    np.testing.assert_allclose(
        simulation.state.position[:, 0],
        [18 + 2.9 / 1.5 + 0.1 * t, 22 - 0.5 * 2.9 / 1.5 + 1.3 * t],
        rtol=1e-14,
    )


def test_image_counts_unwrap_positions() -> None:
    disks = equal_disks(1)
    box = Box((5.0, 4.0))
    state = State(np.array([[1.0, 1.0]]), np.array([[3.0, -2.5]]), np.zeros(1))
    simulation = Simulation(disks, box, SMOOTH, state)
    simulation.run(t_end=7.0, frames=3)
    end = simulation.state
    assert simulation.time == 7.0
    unwrapped = end.position + end.image * np.array(box.lengths)
    np.testing.assert_allclose(unwrapped, [[22.0, -16.5]], rtol=1e-14)
    assert ((end.position >= 0.0) & (end.position < box.lengths)).all()


def test_frames_are_at_exactly_the_requested_collisions_and_times() -> None:
    simulation = gas_of(400, 0.3, COIN_LAW)
    counts: list[int] = []
    simulation.run(
        collisions_per_disk=2.5, frames=5, frame_callbacks=[lambda _, m: counts.append(m.collisions)]
    )
    assert counts == [0, 100, 200, 300, 400, 500]
    times: list[float] = []
    begin = simulation.time
    simulation.run(t_end=begin + 1.0, frames=4, frame_callbacks=[lambda s, _: times.append(s.time)])
    np.testing.assert_array_equal(times, np.linspace(begin, begin + 1.0, 5))


def test_a_run_by_collisions_ends_right_after_the_last_one() -> None:
    for count in range(1, 30):
        simulation = gas_of(100, 0.1, COIN_LAW)
        found = simulation.collide(count)
        assert len(found.time) == count
        assert simulation.time == pytest.approx(found.time[-1], rel=1e-15)


def test_an_interrupted_window_is_not_continued(monkeypatch: pytest.MonkeyPatch) -> None:
    disks = equal_disks(100)
    box, state = start(disks, 0.3)
    engine = engine_of(disks, box, state, np.array([[COIN]]))
    engine.advance(collisions=10)

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(engine.windows, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        engine.advance(collisions=20)
    monkeypatch.undo()
    for use in (lambda: engine.advance(collisions=20), engine.state):
        with pytest.raises(EngineError, match="interrupted half-way"):
            use()


def test_a_window_refuses_to_be_in_a_state_that_cannot_follow_its_present_one() -> None:
    """An error of the program: a moment within a window that has not been run would be read from old arrays."""
    windows = gas_of(9, 0.3, IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0))._engine.windows
    with pytest.raises(EngineError, match="from BETWEEN to INSIDE"):
        windows._to(WindowState.INSIDE)
    assert windows.state is WindowState.BETWEEN
    # A change from outside can begin a window wherever the last one stands.
    assert NEXT.keys() == {*WindowState}
    assert all(WindowState.BETWEEN in after for after in NEXT.values())


def test_gas_at_rest_stays_at_rest_and_cannot_give_collisions() -> None:
    disks = equal_disks(100)
    box, state = start(disks, 0.3)
    state = State(state.position, np.zeros((100, 2)), state.spin)
    simulation = Simulation(disks, box, COIN_LAW, state)
    simulation.run(t_end=10.0)
    assert simulation.collisions == 0
    np.testing.assert_allclose(
        simulation.state.position, box.wrap(state.position), atol=1e-14 * max(box.lengths)
    )
    with pytest.raises(NoMoreCollisions, match="no disk can meet another"):
        simulation.run(collisions_per_disk=1.0)


@pytest.mark.parametrize("n", [0, 1])
def test_too_few_disks_to_collide_fly_freely(n: int) -> None:
    disks = equal_disks(n)
    state = State(np.full((n, 2), 1.0), np.full((n, 2), 0.5), np.zeros(n))
    simulation = Simulation(disks, Box((5.0, 5.0)), SMOOTH, state)
    simulation.run(t_end=4.0)
    np.testing.assert_allclose(simulation.state.position, np.full((n, 2), 3.0))
    with pytest.raises(NoMoreCollisions, match="no disk can meet another"):
        simulation.run(collisions_per_disk=1.0) if n else simulation.collide(1)


def test_disks_that_never_meet_end_a_run_by_collisions_with_a_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ifrdem.simulation.engine, "PATIENCE", 20)
    disks = equal_disks(2)
    state = State(np.array([[1.0, 1.0], [1.0, 3.0]]), np.array([[1.0, 0.0], [2.0, 0.0]]), np.zeros(2))
    simulation = Simulation(disks, Box((4.0, 4.0)), SMOOTH, state)
    with pytest.raises(NoMoreCollisions, match="never to meet"):
        simulation.run(collisions_per_disk=1.0)


def test_three_inelastic_disks_in_a_row_do_not_hang_the_engine() -> None:
    """Below e_n = 7 - 4 sqrt(3) = 0.0718 they collide without end (Bernu & Mazighi, 10.1088/0305-4470/23/24/030).

    By symmetry the middle disk is hit from both sides in turn until rounding ends it, and all three stay together.
    """
    disks = equal_disks(3)
    x = np.array([10.0, 12.0, 14.0])
    state = State(
        np.stack([x, np.full(3, 3.0)], axis=1), np.array([[1.0, 0.0], [0.0, 0.0], [-1.0, 0.0]]), np.zeros(3)
    )
    simulation = Simulation(disks, Box((40.0, 6.0)), IFRLaw(e_n=0.05, e_t=-1.0, mu=0.0), state)
    simulation.run(t_end=5.0)
    assert simulation.collisions > 10
    np.testing.assert_allclose(np.diff(simulation.state.position[:, 0]), 1.0, atol=1e-6)


def test_inelastic_collapse_passes_in_finite_work() -> None:
    """Dense smooth disks at e_n = 0.05 collapse at once; contacts slower than rounding end each collapse."""
    disks = equal_disks(200)
    box, state = start(disks, 0.75)
    simulation = Simulation(disks, box, IFRLaw(e_n=0.05, e_t=-1.0, mu=0.0), state)
    simulation.run(t_end=0.1)
    # An elastic gas would have had some three per disk by then, 1.5 n in all.
    assert simulation.collisions > 15 * disks.n
    placement.check_no_overlap(box, disks.radius, simulation.state.position, tolerance=1e-12)


def test_tiles_go_through_a_collapse_like_the_whole_box_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of collisions within a rounding of each other; those at one and the same time are not parted."""
    monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 100)
    disks = equal_disks(2000)
    box, state = start(disks, 0.75)
    law = np.array([[(0.05, -1.0, 0.0, 0.0, 0.0)]])
    ends = []
    for order in ("tiled", "serial"):
        engine = engine_of(disks, box, state, law, order=order, tile_disks=250)
        advance(engine, 100)
        assert 0 <= engine.collisions - 50 * disks.n < 500
        ends.append(engine.state())
    placement.check_no_overlap(box, disks.radius, ends[0].position, tolerance=1e-12)
    assert states_equal(*ends)


def test_a_disk_wider_than_a_third_of_the_box_is_refused() -> None:
    state = State(np.array([[0.5, 0.5]]), np.zeros((1, 2)), np.zeros(1))
    with pytest.raises(InputError, match="more than a third of the periodic side"):
        Simulation(equal_disks(1), Box((2.9, 10.0)), SMOOTH, state)


def test_disks_are_listed_anew_in_the_order_of_their_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    """By tiles, then by the tiles that listed them, then as there; blocks of few disks do not change that."""
    disks = equal_disks(2000)
    box, state = start(disks, 0.4)
    engine = engine_of(disks, box, state, np.array([[ELASTIC]]), order="tiled", tile_disks=250)
    advance(engine, 5)
    engine.advance()  # to the end of the window
    engine.windows.commit()
    arrays = engine.arrays
    part = int(arrays.grid.part)
    held, listed = arrays.rows_held(part)
    tile = arrays.take_to_tiles(held, listed)
    assert np.any(tile != listed)
    order = np.lexsort((listed, tile))
    monkeypatch.setattr("ifrdem.simulation.windows.arrays.BLOCK", 300)
    arrays.relist()
    rows, now = arrays.rows_of(int(arrays.grid.part))
    np.testing.assert_array_equal(now, tile[order])
    for name in ("disk", "meta"):
        np.testing.assert_array_equal(arrays.values(name)[rows], held[name][order])


@pytest.mark.full
@pytest.mark.parametrize("ledger", [False, True])
def test_memory_on_one_thread_is_what_the_estimate_says(ledger: bool) -> None:
    """In addition there is the scratch space of the tiles that run at the same time, which does not grow with n."""
    disks = equal_disks(60_000)
    box, state = start(disks, 0.3)
    engine = engine_of(
        disks, box, state, np.array([[ELASTIC]]), record=["ledger"] * ledger, device=Device(threads=1)
    )
    engine.advance(t_end=1e-3)
    arrays = engine.arrays
    scratch = arrays.bytes_of("motion", "event_info", "image_info", "candidates", "head", "bin")
    assert arrays.bytes_allocated - scratch == pytest.approx(disks.n * bytes_per_disk(), rel=0.04)
    assert scratch < 4e6


@pytest.mark.parametrize(
    ("length", "speed", "mass", "precision", "named"),
    [
        (3.4e-10, 300.0, 6.6e-26, "f32", "k / (m R)"),  # argon: its inverse inertia leaves single precision
        (1.0, 1e155, 1.0, "f64", "v^2"),
        (1.0, 1e-150, 1.0, "f64", "v^2|to cross the box"),
        (1.0, 1e-30, 1.0, "f64", "to cross the box"),
    ],
)
def test_units_that_numbers_cannot_hold_are_refused(
    length: float, speed: float, mass: float, precision: str, named: str
) -> None:
    disks = Disks(2, mass=mass, radius=0.5 * length)
    position = np.array([[2.0, 5.0], [5.0, 5.0]]) * length
    state = State(position, np.array([[speed, 0.0], [0.0, 0.0]]), np.zeros(2))
    box = Box((10.0 * length, 10.0 * length))
    with pytest.raises(InputError, match=named.replace("^", r"\^").replace("(", r"\(").replace(")", r"\)")):
        engine_of(disks, box, state, np.array([[ELASTIC]]), device=Device(precision=precision))


@pytest.mark.full
@pytest.mark.parametrize("name", ["temperature", "energy"])
def test_a_thermostat_hotter_than_numbers_can_hold_is_refused(name: str) -> None:
    """v^2 = 2 T / m of 2e39 is beyond 3.4e38, the largest number of single precision."""
    disks = Disks(2, mass=1.0, radius=0.5)
    state = State([[2.0, 5.0], [5.0, 5.0]], np.ones((2, 2)), np.zeros(2))
    law = np.array([[ELASTIC]])
    forces = [Rescale(0.1, **{name: 1e39})]
    with pytest.raises(InputError, match=r"v.2 = .*f32 can compute with"):
        engine_of(disks, Box((10.0, 10.0)), state, law, device=Device(precision="f32"), forces=forces)
    engine = engine_of(disks, Box((10.0, 10.0)), state, law, device=Device(precision="f32"))
    with pytest.raises(InputError, match=r"v.2 = .*f32 can compute with"):
        engine.set_forces(forces)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_units_do_not_matter_to_the_last_bit(precision: str) -> None:
    """Powers of two in length, speed and mass only shift exponents."""
    ends = []
    for length, speed, mass in ((1.0, 1.0, 1.0), (2.0**-10, 2.0**7, 2.0**-20)):
        disks = Disks(200, mass=mass, radius=0.5 * length)
        box, state = start(equal_disks(200), 0.4)
        scaled = State(state.position * length, state.velocity * speed, state.spin * (speed / length))
        law = np.array([[(*ROLLING[:4], ROLLING[4] * length)]])
        larger = Box((box.lengths[0] * length, box.lengths[1] * length))
        engine = engine_of(disks, larger, scaled, law, device=Device(precision=precision))
        end = run_to(engine, collisions=2000)
        ends.append((end.position / length, end.velocity / speed, end.spin / (speed / length)))
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("value", [0, 1e-4, 10.1, float("nan"), "1", [1], True])
def test_lengths_of_windows_that_are_none_are_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"window_collisions = .*: must be"):
        Device(window_collisions=value)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [0, -5, 1.5, "x"])
def test_numbers_of_disks_in_a_tile_that_are_none_are_refused(value: object) -> None:
    disks = equal_disks(2)
    box, state = start(disks, 0.1)
    with pytest.raises(InputError, match=r"tile_disks = .*: must be"):
        engine_of(disks, box, state, np.array([[COIN]]), tile_disks=value)
