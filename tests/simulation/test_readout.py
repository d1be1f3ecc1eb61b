"""Frames within windows: a readout does not change the motion."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from support.gases import equal_disks, gas_of, mixture

from ifrdem import ContactTime, Device
from ifrdem.errors import EngineError, InputError
from ifrdem.model.box import Box, below
from ifrdem.model.forces import RandomKicks
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import Measure, measure
from ifrdem.model.state import FrameRows, State
from ifrdem.quantities import FIELDS
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.steps.schedule import RunPlan, RunPoint, Trigger
from ifrdem.trajectory import layout
from ifrdem.trajectory.writer import TrajectoryWriter

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
COMPARED = ("position", "velocity", "spin", "collisions", "image", "last_partner", "angle")
STORED = layout.frame_dtype(tuple(FIELDS), "f32")
Frames = list[tuple[State, Measure]]


@pytest.fixture(params=["serial", "tiled"])
def order(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every way of running windows."""
    chosen: str = request.param
    monkeypatch.setattr(
        "ifrdem.simulation.simulation.Engine", functools.partial(Engine, order=chosen, tile_disks=300)
    )
    return chosen


def dense(*, n: int = 1500, **options: object) -> Simulation:
    return gas_of(mixture(n), 0.5, COIN, record=["ledger", "last_partner", "angle"], **options)


def frames_of(simulation: Simulation, **until: object) -> Frames:
    found: Frames = []
    simulation.run(**until, frame_callbacks=[lambda state, measure: found.append((state, measure))])
    return found


def same(one: State, other: State) -> None:
    assert one.time == other.time
    for name in COMPARED:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("until", [{"t_end": 0.6}, {"collisions_per_disk": 1.3}], ids=["time", "collisions"])
def test_the_motion_does_not_depend_on_how_often_it_is_read(order: str, until: dict[str, float]) -> None:
    rare, often = dense(), dense()
    frames_of(rare, **until, frames=1)
    found = frames_of(often, **until, frames=37)
    assert len(found) == 38
    same(rare.state, often.state)
    assert rare.collisions == often.collisions
    assert rare.statistics.windows == often.statistics.windows


@pytest.mark.full(keep=1)
def test_series_tracked_disks_and_the_ledger_change_no_bit(order: str) -> None:
    bare = gas_of(mixture(1500), 0.5, COIN)
    bare.run(t_end=0.6)
    expected = bare.state
    followed = dense(histories=[0, 7, 700])
    rows: list[Measure] = []
    followed.run(t_end=0.6, series=41, series_callbacks=[rows.append])
    assert len(rows) == 42
    assert len(followed.take_events()) > 0
    for name in COMPARED[:5]:
        assert np.array_equal(getattr(followed.state, name), getattr(expected, name)), name


def test_a_frame_is_the_state_of_a_run_that_ends_there(order: str) -> None:
    found = frames_of(dense(), t_end=0.6, frames=5)
    for k, (state, recorded) in enumerate(found):
        ended = dense()
        ended.run(t_end=0.6 * k / 5)
        same(state, ended.state)
        assert state.time == 0.6 * k / 5 == recorded.time
        assert recorded.collisions == ended.collisions


def test_a_frame_by_collisions_is_right_after_the_last_of_them(order: str) -> None:
    found = frames_of(dense(n=1600), collisions_per_disk=1.5, frames=6)
    ended = dense(n=1600)
    for k, (state, recorded) in enumerate(found):
        ended.run(collisions_per_disk=0.25 * k)
        assert recorded.collisions == ended.collisions == 200 * k
        assert state.collisions.sum() == 400 * k
        same(state, ended.state)


def test_what_is_measured_at_a_frame_is_that_of_its_state(order: str) -> None:
    for state, recorded in frames_of(dense(), t_end=0.6, frames=4):
        expected = measure(mixture(1500), state)
        assert recorded.dissipated is None
        assert recorded.regimes is None
        for name in ("translational_energy", "rotational_energy", "temperature", "energy"):
            assert getattr(recorded, name) == pytest.approx(getattr(expected, name), rel=1e-13), name
        assert recorded.momentum == pytest.approx(expected.momentum, abs=1e-11)
        assert recorded.collisions == expected.collisions


def test_positions_of_a_frame_lie_in_the_box_and_paths_have_no_jumps(order: str) -> None:
    simulation = dense()
    found = [state for state, _ in frames_of(simulation, t_end=0.6, frames=60)]
    lengths = np.array(simulation.box.lengths)
    for state in found:
        assert np.all((state.position >= 0.0) & (state.position < lengths))
    paths = np.array([state.position + state.image * lengths for state in found])
    fastest = np.max([np.hypot(*state.velocity.T) for state in found], axis=0)
    steps = np.hypot(*np.moveaxis(np.diff(paths, axis=0), -1, 0))
    # No disk is faster in between than at both ends by more than what one collision gives: a box is 40 wide.
    assert steps.max() < 3.0 * 0.01 * fastest.max()
    assert any(state.image.any() for state in found)


def test_the_angle_is_the_integral_of_the_spin_of_the_history(order: str) -> None:
    # Collision by collision, from what is kept of every one: spin before, from the latest one on, times the time.
    simulation = dense(n=300, histories=range(300))
    found = [state for state, _ in frames_of(simulation, t_end=1.5, frames=7)]
    events = simulation.take_events()
    begin = found[0]
    for state in found:
        angle, spin, since = np.zeros(300), begin.spin.copy(), np.zeros(300)
        for time, i, after in zip(events.time, events.id, events.spin_after, strict=True):
            if time <= state.time:
                angle[i] += spin[i] * (time - since[i])
                spin[i], since[i] = after, time
        angle += spin * (state.time - since)
        assert state.angle == pytest.approx(angle, rel=1e-10, abs=1e-12)
    assert np.abs(found[-1].angle).max() > math.pi


@pytest.mark.full
def test_threads_do_not_matter() -> None:
    found = []
    for threads in (2, 1):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                "ifrdem.simulation.simulation.Engine",
                functools.partial(Engine, order="tiled", tile_disks=300),
            )
            found.append(frames_of(dense(device=Device(threads=threads)), t_end=0.5, frames=9))
    for (one, measured_one), (other, measured_other) in zip(*found, strict=True):
        same(one, other)
        assert measured_one.energy == measured_other.energy
        assert np.array_equal(measured_one.momentum, measured_other.momentum)


@pytest.mark.full
def test_kicks_do_not_move_frames(order: str) -> None:
    def driven() -> Simulation:
        return dense(forces=[RandomKicks(0.07, power=0.5)], seed=5)

    rare, often = driven(), driven()
    frames_of(rare, t_end=0.6, frames=1)
    found = frames_of(often, t_end=0.6, frames=24)
    same(rare.state, often.state)
    assert rare.energy_input == often.energy_input
    assert [state.time for state, _ in found] == pytest.approx(np.arange(25) / 40)
    # A kick at 0.035 + 0.07 k changes the velocity of every disk, and nothing else does.
    velocities = [state.velocity for state, _ in found]
    kicked = [bool(np.all(a != b)) for a, b in itertools.pairwise(velocities)]
    kicks = [np.floor((t + 0.035) / 0.07 + 1e-9) for t in np.arange(25) / 40]
    assert kicked == [bool(b > a) for a, b in itertools.pairwise(kicks)]


def test_frames_of_disks_without_collisions_are_at_their_times() -> None:
    begin = State([[2.0, 2.0], [5.0, 5.0]], [[1.0, 0.0], [1.0, 0.0]], [0.5, -0.5])
    for box in (Box((10.0, 10.0)), Box.open()):
        simulation = Simulation(mixture(2), box, COIN, begin, record=["ledger", "last_partner", "angle"])
        found = [state for state, _ in frames_of(simulation, t_end=8.0, frames=4)]
        assert [state.time for state in found] == [0.0, 2.0, 4.0, 6.0, 8.0]
        for state in found:
            paths = state.position + state.image * np.array(box.lengths if not box.is_open else (0.0, 0.0))
            assert paths[:, 0] == pytest.approx(begin.position[:, 0] + state.time)
            assert state.angle == pytest.approx([0.5 * state.time, -0.5 * state.time])


def test_frames_of_one_disk_and_of_disks_at_rest_are_at_their_times() -> None:
    for begin in (
        State([[2.0, 2.0]], [[1.0, 0.5]], [0.5]),
        State([[2.0, 2.0], [5.0, 5.0]], np.zeros((2, 2)), [0.0, 0.0]),
    ):
        simulation = Simulation(equal_disks(begin.n), Box((10.0, 10.0)), COIN, begin, record=["angle"])
        found = [state for state, _ in frames_of(simulation, t_end=8.0, frames=4)]
        assert [state.time for state in found] == [0.0, 2.0, 4.0, 6.0, 8.0]
        for state in found:
            paths = state.position + 10.0 * state.image
            assert paths == pytest.approx(begin.position + begin.velocity * state.time)
            assert state.angle == pytest.approx(begin.spin * state.time)


def test_an_open_gas_does_not_mind_being_looked_at() -> None:
    rare, often = dense(n=200, box=Box.open()), dense(n=200, box=Box.open())
    frames_of(rare, t_end=3.0, frames=1)
    found = frames_of(often, t_end=3.0, frames=31)
    same(rare.state, often.state)
    assert [state.time for state, _ in found] == pytest.approx(np.arange(32) * 3.0 / 31)


def test_frames_that_coincide_are_given_once() -> None:
    # 40 points within some tens of collisions: many fall onto the same collision.
    simulation = dense(n=100)
    found = frames_of(simulation, collisions_per_disk=0.5, frames=Trigger(number=40, spacing="log"))
    counts = [recorded.collisions for _, recorded in found]
    assert counts == sorted(set(counts))
    assert counts[0] == 0
    assert counts[-1] == simulation.collisions == 25


def test_a_run_that_a_callback_ends_can_be_continued() -> None:
    class Enough(Exception):
        pass

    def stop(state: State, _measure: Measure) -> None:
        if state.time > 0.2:
            raise Enough

    stopped, whole = dense(), dense()
    with pytest.raises(Enough):
        stopped.run(t_end=0.6, frames=20, frame_callbacks=[stop])
    assert stopped.time == pytest.approx(0.21)  # frame 7 of 20
    stopped.run(t_end=0.6)
    whole.run(t_end=0.6)
    same(stopped.state, whole.state)


@pytest.mark.full
def test_single_precision_looks_back_to_its_rounding() -> None:
    double = dense(device=Device(threads=1))  # as the test before this one: another number restarts Taichi
    exact, box = frames_of(double, t_end=0.3, frames=3), np.array(double.box.lengths)
    found = frames_of(dense(device=Device(precision="f32")), t_end=0.3, frames=3)
    for (state, _), (expected, _) in zip(found, exact, strict=True):
        apart = state.position + state.image * box - expected.position - expected.image * box
        assert np.median(np.abs(apart)) < 1e-5
        assert np.sum(state.collisions != expected.collisions) <= 4


def test_single_frames_are_the_exact_ones_rounded_and_lie_in_the_box(order: str) -> None:
    found: list[list[State]] = [[], []]
    for frames, stored in zip(found, (None, STORED), strict=True):
        simulation = dense()
        simulation.follow(
            RunPlan(1500, RunPoint(0.0, 0), RunPoint(time=0.6), Trigger(number=12)),
            frame_callbacks=[lambda state, _, to=frames: to.append(state)],
            stored=stored,
        )
    exact, rounded = found
    assert sum(isinstance(state, FrameRows) for state in rounded) == 13  # the first and the last, too
    for one, other in zip(exact, rounded, strict=True):
        assert one.time == other.time
        inside = np.array([below(length, np.float32) for length in dense().box.lengths])
        expected = np.minimum(one.position, inside).astype(np.float32)
        assert np.array_equal(np.asarray(other.position, dtype=np.float32), expected)
        for name in ("velocity", "spin", "angle"):
            value = np.asarray(getattr(other, name), dtype=np.float32)
            assert np.array_equal(value, getattr(one, name).astype(np.float32)), name
        for name in ("collisions", "image", "last_partner"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert not other.asleep.any()  # a field that this gas does not keep has what it had at the start


@pytest.mark.parametrize("stored", [None, STORED])
def test_frames_that_are_kept_are_not_written_over(stored: np.dtype | None) -> None:
    # Memory of frames is used again; there are more than ever wait for a writer, and every one is still held.
    kept: list[State] = []
    copies: list[tuple[np.ndarray, ...]] = []

    def look(state: State, _measure: Measure) -> None:
        kept.append(state)
        copies.append(tuple(np.array(getattr(state, name)) for name in COMPARED))

    dense(n=300).follow(
        RunPlan(300, RunPoint(0.0, 0), RunPoint(time=0.6), Trigger(number=20)),
        frame_callbacks=[look],
        stored=stored,
    )
    assert len(kept) == 21
    for state, copy in zip(kept, copies, strict=True):
        for name, value in zip(COMPARED, copy, strict=True):
            assert np.array_equal(getattr(state, name), value), name


def test_frames_at_intervals_of_time_end_with_the_collisions_of_the_run(order: str) -> None:
    simulation = dense()
    found = frames_of(simulation, collisions_per_disk=1.0, frames=Trigger(interval=0.02))
    times = [state.time for state, _ in found]
    assert times[:-1] == pytest.approx(0.02 * np.arange(len(times) - 1))
    assert times[-2] < times[-1] == simulation.time <= times[-2] + 0.02
    assert found[-1][1].collisions == simulation.collisions == 750


@pytest.mark.parametrize("frames", [5, Trigger(interval=0.5)])
def test_collisions_that_can_never_come_are_said_whatever_the_frames(frames: int | Trigger) -> None:
    disks = equal_disks(2)
    apart = State([[2.0, 2.0], [5.0, 5.0]], [[-1.0, 0.0], [1.0, 0.0]], [0.0, 0.0])
    still = State([[2.0, 2.0], [5.0, 5.0]], np.zeros((2, 2)), [0.0, 0.0])
    for box, begin in ((Box.open(), apart), (Box((10.0, 10.0)), still)):
        simulation = Simulation(disks, box, COIN, begin)
        with pytest.raises(EngineError, match=r"more collisions are requested"):
            simulation.run(collisions_per_disk=3.0, frames=frames)


def test_an_observer_may_ask_the_simulation_and_save_it(order: str, tmp_path: Path) -> None:
    asked, plain = dense(n=900), dense(n=900)
    path = tmp_path / "a.h5"
    asked_of: list[tuple[State, Measure, State, Measure]] = []

    def ask(state: State, recorded: Measure) -> None:
        assert asked.time == state.time
        assert asked.collisions == recorded.collisions
        asked_of.append((state, recorded, asked.state, asked.measure()))
        asked.save_checkpoint(path)

    asked.run(t_end=0.4, frames=7, frame_callbacks=[ask])
    plain.run(t_end=0.4)
    assert len(asked_of) == 8
    for state, recorded, present, measured in asked_of:
        same(state, present)
        assert measured.energy == recorded.energy
        assert measured.dissipated is not None
        assert measured.regimes is not None
        assert measured.regimes.sum() == recorded.collisions
    same(asked.state, plain.state)


def test_series_callbacks_get_the_exact_moment(order: str) -> None:
    simulation = dense(n=900)
    frames: Frames = []
    rows: list[Measure] = []
    simulation.run(
        t_end=0.4,
        frames=5,
        frame_callbacks=[lambda state, recorded: frames.append((state, recorded))],
        series=10,
        series_callbacks=[rows.append],
    )
    assert [row.time for row in rows] == pytest.approx(0.04 * np.arange(11), abs=1e-15)
    for (state, recorded), row in zip(frames, rows[::2], strict=True):
        assert row.time == state.time
        assert row.energy == recorded.energy
        assert row.collisions == recorded.collisions
        assert row.regimes is not None
        assert row.regimes.sum() == row.collisions


def test_moments_one_clock_step_apart_are_separate_frames() -> None:
    simulation = dense(n=300)
    simulation.run(t_end=0.1)
    before = simulation.state
    after = float(np.nextafter(0.1, 1.0))
    simulation.run(t_end=after)
    assert simulation.time == after
    assert np.array_equal(simulation.state.velocity, before.velocity)


RECORDED_BY = {
    "latest_collision": {"collapse": ContactTime(1e-6)},
    "last_partner": {"record": ["last_partner"]},
    "angle": {"record": ["angle"]},
    "dissipated": {"record": ["dissipated"]},
}


@pytest.mark.parametrize("name", RECORDED_BY)
def test_a_quantity_that_is_not_recorded_raises_instead_of_reading_as_zeros(
    name: str, tmp_path: Path
) -> None:
    disks = equal_disks(2)
    box, begin = Box((10.0, 10.0)), State([[2.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.5, 0.0])
    without = Simulation(disks, box, COIN, begin)
    states = [state for state, _ in frames_of(without, t_end=3.0)]
    uses = (np.sum, np.asarray, lambda value: value + 1.0, lambda value: value[0], lambda value: value.shape)
    for state in (without.state, deepcopy(without.state), *states):
        for use in uses:
            with pytest.raises(InputError, match=f"State.{name} was not recorded"):
                use(getattr(state, name))
    assert f"{name} not recorded" in repr(without.state)
    # A start of another run, whose quantities begin at 0 or with no collision.
    begin = dataclasses.replace(without.state, spin=np.ones(2))
    again = Simulation(disks, box, COIN, begin, **RECORDED_BY[name])
    expected = {"latest_collision": -np.inf, "last_partner": -1}.get(name, 0.0)
    assert np.all(getattr(again.state, name) == expected)
    if name in FIELDS:
        with (
            TrajectoryWriter(tmp_path / "gas.h5", disks, box, fields=("position", name)) as file,
            pytest.raises(InputError, match=f"State.{name} was not recorded"),
        ):
            file.write(without.state)
