"""Moments within windows have the same bits in tiles as in the serial order of the whole box."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import test_forces_within_windows as forced
from support.gases import ELASTIC, equal_disks, mixture, start
from test_same_bits import COMPARED, GASES, NARROW, N, made, narrowed, same
from test_same_bits import windows_of_tiles as windows_of_tiles

from ifrdem import ContactTime, Device, IFRLaw, Rest, Simulation
from ifrdem.errors import InputError
from ifrdem.kernels.columns import TALLY
from ifrdem.kernels.layout import AT_END
from ifrdem.model.box import Box
from ifrdem.model.forces import PoissonKicks, SpinKicks
from ifrdem.model.state import State
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.steps.schedule import RunPoint
from ifrdem.simulation.windows.arrays import DeviceArrays
from ifrdem.simulation.windows.runner import TileRunner
from ifrdem.simulation.windows.windows import Windows
from ifrdem.validation.rows import engine_of

LOOKED_AT = (*COMPARED, "angle", "last_partner", "dissipated", "latest_collision")
KEPT: dict[str, Any] = {
    "record": ["ledger", "dissipated", "last_partner", "angle"], "collapse": ContactTime(1e-9),
}  # fmt: skip
FRAMES = [RunPoint(collisions=int(0.4 * N / 2 * i)) for i in range(1, 13)]  # one to four in each window


def looked_at(
    name: str, due: list[RunPoint], monkeypatch: pytest.MonkeyPatch, **options: Any
) -> tuple[list[tuple[State, Any, Any]], Engine, int]:
    """States, times and totals of an engine at points of a run; number of windows that it ran again."""
    computed = []
    compute = Windows._compute
    monkeypatch.setattr(
        Windows, "_compute", lambda self, *args, **more: computed.append(0) or compute(self, *args, **more)
    )
    disks, box, state, law, more = made(name)
    kept = KEPT | ({"record": [*KEPT["record"], "wall_sums"]} if "walls" in more else {})
    engine = engine_of(disks, box, state, np.array([[law]]), **more, **kept, **options)
    found = []
    while due:
        stop = functools.reduce(RunPoint.earlier, due)
        engine.advance(t_end=stop.time, collisions=stop.collisions, next_points=functools.partial(list, due))
        if stop.reached(engine.time, engine.collisions):
            found.append((engine.state(), engine.dissipated(), engine.wall_sums if "walls" in more else ()))
        due = [each for each in due if not each.reached(engine.time, engine.collisions)]
    return found, engine, len(computed) - engine.statistics.windows


@pytest.mark.full(keep=("clusters",))
@pytest.mark.parametrize("name", sorted(set(GASES) - {"driven"}))  # whose windows end at forces
def test_moments_in_windows_of_tiles_have_the_bits_of_the_serial_order(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At numbers of collisions, and at times halfway between them."""
    alone, _, _ = looked_at(name, FRAMES, monkeypatch, order="serial")
    times = [0.5 * (one.time + two.time) for (one, *_), (two, *_) in itertools.pairwise(alone)]
    points = [*FRAMES, *(RunPoint(time) for time in times)]
    expected, _, _ = looked_at(name, points, monkeypatch, order="serial")
    found, engine, again = looked_at(name, points, monkeypatch, order="tiled", tile_disks=250)
    assert len(found) == len(expected) == len(points)
    for (state, (lost, regimes), walls), (state_1, (lost_1, regimes_1), walls_1) in zip(
        found, expected, strict=True
    ):
        for each in LOOKED_AT:
            assert np.array_equal(getattr(state, each), getattr(state_1, each)), each
        assert np.array_equal(regimes, regimes_1)
        assert lost == pytest.approx(
            lost_1, rel=1e-11, abs=1e-12
        )  # sums of some thousand terms in another order
        assert walls == pytest.approx(walls_1, rel=1e-9, abs=1e-9)
    assert [state.collisions.sum() // 2 for state, *_ in found[::2]] == [due.collisions for due in FRAMES]
    # A window with numbers of collisions is repeated by its trail, when their times are known. Without a trail, where one
    # thread ran the whole box, it is run once more: for eight moments at a time.
    in_order = engine.statistics.in_order
    assert again <= (in_order + len(points) / 8 if in_order else 0), (again, in_order)
    assert engine.statistics.windows >= 3


def resting(**options: Any) -> Engine:
    """A bed of disks that fall asleep, by rows."""
    box, rng = Box((40.0, 30.0), (True, False)), np.random.default_rng(5)
    place = np.stack([np.arange(90) % 30 * 1.2 + 0.7, np.arange(90) // 30 * 1.1 + 0.7], axis=1)
    state = State(place, 0.2 * rng.normal(size=(90, 2)), 0.2 * rng.normal(size=90))
    return engine_of(
        equal_disks(90), box, state, np.array([[(0.4, -0.5, 0.4, 0.0, 0.0)]]), gravity=(0.0, -10.0),
        collapse=Rest(0.1), **options,
    )  # fmt: skip


REPEATED: dict[str, Callable[..., Engine]] = {
    "forces": lambda **o: forced.gas(
        mixture(700), [*forced.two_forces(), SpinKicks(0.07, power=0.3), PoissonKicks(3.0, power=0.5)], **o
    ),
    "walls": lambda **o: forced.bounded(forces=forced.two_forces(), **o),
    "shear": forced.in_shear,
    "resting": lambda **o: resting(**o | {"tile_disks": 10}),
}


@pytest.mark.full
@pytest.mark.parametrize("name", REPEATED)
def test_a_repeated_window_has_the_bits_of_one_that_is_run_again(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """States and sums after numbers of collisions, whatever happens between these: forces, walls, flow and sleep."""
    found, replays, done, replay = [], [], [], TileRunner.replay
    monkeypatch.setattr(TileRunner, "replay", lambda self: replays.append(0) or replay(self))
    for repeats in (True, False):
        monkeypatch.setattr(DeviceArrays, "keeps_trail", repeats)
        engine, seen = REPEATED[name](order="tiled", tile_disks=60), []
        assert engine.arrays.tiles > 3
        for count in range(25, 500, 25):
            while engine.collisions < count:
                engine.advance(collisions=count)
            seen.append((engine.time, engine.state(), engine.windows.sums, engine.totals(), engine.asleep))
        found.append(seen)
        done.append(len(replays))
    assert done[0] > 10
    assert done[1] == done[0]
    for (t, state, sums, totals, asleep), (t_1, state_1, sums_1, totals_1, asleep_1) in zip(
        *found, strict=True
    ):
        assert (t, asleep) == (t_1, asleep_1)
        assert same(state, state_1)
        assert np.array_equal(sums, sums_1)
        assert np.array_equal(totals, totals_1)
    assert (asleep > 0) == (name == "resting")


def little_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """For 16 collisions at first."""
    make_trail, made_before = DeviceArrays.make_trail, []

    def make(self: DeviceArrays, most: int) -> None:
        made_before.append(most)
        make_trail(self, most if len(made_before) > 2 else 16)

    monkeypatch.setattr(DeviceArrays, "make_trail", make)


def unexpected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Times of collisions are not written down before a number of them turns out to lie in the window."""
    monkeypatch.setattr(Windows, "_nears_count", lambda self: False)


@pytest.mark.full
@pytest.mark.parametrize("fault", [little_room, unexpected])
def test_moments_that_were_not_expected_are_found_by_another_run(
    fault: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected, _, _ = looked_at("phi = 0.3", FRAMES, monkeypatch, order="serial")
    fault(monkeypatch)
    found, _, _ = looked_at("phi = 0.3", FRAMES, monkeypatch, order="tiled", tile_disks=250)
    assert len(found) == len(expected)
    for (state, *_), (state_1, *_) in zip(found, expected, strict=True):
        for each in LOOKED_AT:
            assert np.array_equal(getattr(state, each), getattr(state_1, each)), each


@pytest.mark.full
def test_collisions_of_tiles_that_are_run_again_count_once(monkeypatch: pytest.MonkeyPatch) -> None:
    expected, _, _ = looked_at("phi = 0.6", FRAMES, monkeypatch, order="serial")
    narrowed(monkeypatch, NARROW)
    found, engine, again = looked_at("phi = 0.6", FRAMES, monkeypatch, order="tiled", tile_disks=250)
    assert engine.statistics.run_again > engine.statistics.windows > 2 * engine.statistics.in_order
    assert again < engine.statistics.in_order + len(FRAMES) / 8  # where one thread ran the whole box
    for (state, *_), (state_1, *_) in zip(found, expected, strict=True):
        assert all(np.array_equal(getattr(state, each), getattr(state_1, each)) for each in LOOKED_AT)


@pytest.mark.full
@pytest.mark.parametrize("name", ["phi = 0.3", "mixture"])
def test_low_memory_keeps_the_bits_without_room_for_moments(name: str) -> None:
    """At times, some of them in one window, and at numbers of collisions, the last of which lies in a later window."""
    found, engines = [], []
    disks, box, state, law, _ = made(name)
    for low in (False, True):
        device = Device(low_memory=low)
        engine = engine_of(disks, box, state, np.array([[law]]), order="tiled", tile_disks=250, device=device)
        states = []
        for i in range(1, 9):
            engine.advance(t_end=0.11 * i + 0.02 * (i % 2))
            states.append(engine.state())
        first = engine.collisions
        for target in [*range(first + 1, first + 60, 3), 4 * N]:
            for _ in range(100):
                engine.advance(collisions=target)
                if engine.collisions >= target:
                    break
            assert engine.collisions == target
            states.append(engine.state())
        found.append(states)
        engines.append(engine)
    assert all(same(one, other) for one, other in zip(*found, strict=True))
    assert engines[0].statistics.windows == engines[1].statistics.windows
    assert [engine.arrays.parts for engine in engines] == [3, 2]
    # Of collisions that were written down for their times, only these are kept.
    assert engines[1].arrays.grid.most_pairs == 0
    assert not len(engines[1].windows.pairs()[0])


@pytest.mark.full
def test_low_memory_keeps_the_histories_of_tracked_disks() -> None:
    """Windows are run again for moments in them, but what happened in them is written down once; bits stay the same."""
    disks, box, state, _, _ = made("phi = 0.3")
    law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    found, ends, parts = [], [], []
    for low in (False, True):
        tracked = range(0, N, 7)
        gas = Simulation(disks, box, law, state, histories=tracked, device=Device(low_memory=low))
        for end in (0.1, 0.2, 0.45, 0.7, 1.3):
            gas.run(t_end=end, progress=False)
        gas.run(collisions_per_disk=5.0, progress=False)
        found.append(gas.take_events())
        ends.append(gas.state)
        parts.append(gas._engine.arrays.parts)
    assert len(found[0].time) > 2000
    for field in dataclasses.fields(found[0]):
        np.testing.assert_array_equal(*(getattr(each, field.name) for each in found), err_msg=field.name)
    assert same(*ends)
    assert parts == [3, 2]


@pytest.mark.parametrize(
    "more",
    [
        {"walls": [Wall.line((0.0, 0.0), (0.0, 1.0))]},
        {"forces": [PoissonKicks(1.0, power=1.0)]},
        {"collapse": ContactTime(1e-9)},
    ],
)
def test_low_memory_is_refused_where_bits_depend_on_the_window(more: dict[str, Any]) -> None:
    disks = equal_disks(200)
    with pytest.raises(InputError, match=rf"low_memory = True: cannot be combined with {next(iter(more))}"):
        engine_of(disks, *start(disks, 0.1), np.array([[ELASTIC]]), device=Device(low_memory=True), **more)


@pytest.mark.full
def test_low_memory_tells_collisions_apart_that_differ_in_the_last_digits() -> None:
    """Two pairs 3 apart meet head on at t = 1.5 and at 1.5 / (1 - 2^-51): three units in the last place later."""
    slower = 1.0 - 2.0**-51
    position = np.array([[20.0, 25.0], [24.0, 25.0], [70.0, 75.0], [74.0, 75.0]])
    velocity = np.array([[1.0, 0.0], [-1.0, 0.0], [slower, 0.0], [-slower, 0.0]])
    state = State(position, velocity, np.zeros(4))
    engine = engine_of(
        equal_disks(4), Box((100.0, 100.0)), state, np.array([[ELASTIC]]), order="tiled", tile_disks=1,
        device=Device(low_memory=True),
    )  # fmt: skip
    for _ in range(100):
        engine.advance(collisions=1)
        if engine.collisions:
            break
    assert engine.collisions == 1
    assert engine.time == 1.5
    assert engine.arrays.parts == 2
    assert engine.state().collisions.tolist() == [1, 1, 0, 0]


@pytest.mark.full
def test_threads_take_the_tiles_with_most_collisions_first() -> None:
    disks, box, state, law, _ = made("phi = 0.3")
    engine = engine_of(disks, box, state, np.array([[law]]), order="tiled", tile_disks=250)
    engine.advance(t_end=0.5)
    arrays = engine.arrays
    tiles = arrays.costliest_first
    assert sorted(tiles) == list(range(arrays.tiles))
    assert (np.diff(arrays.values("tally")[tiles, AT_END, TALLY.collisions]) <= 0.0).all()
    assert not np.array_equal(tiles, np.arange(arrays.tiles))
