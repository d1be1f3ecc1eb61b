"""The bits of a state do not depend on threads and tiles; and errors that these tests would find.

Any difference of a last bit has grown to that of another gas after some fifteen collisions of a disk: equal states
after fifty say that none was ever there.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from support.gases import COIN, ELASTIC, ROLLING, equal_disks, equilibrated, mixture, run_to

from ifrdem import Device
from ifrdem.kernels.columns import TABLES, named
from ifrdem.model.box import Box
from ifrdem.model.forces import Langevin, RandomKicks, Rescale
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation import backend
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.windows.runner import TileRunner
from ifrdem.simulation.windows.windows import Windows
from ifrdem.validation.rows import engine_of

pytestmark = pytest.mark.optimised

N = 4000
COMPARED = ("time", "position", "velocity", "spin", "collisions", "image", "wall_collisions")
THREADS = [t for t in (2, 1) if t <= backend.cores()]
TILES = (60, 250, 1000)
Gas = tuple[Disks, Box, State, tuple[float, ...], dict[str, Any]]


@pytest.fixture(autouse=True)
def windows_of_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows as short as those of gases that are divided: few disks have longer ones, which would need wide halos."""
    monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 100)


def periodic(
    packing_fraction: float, law: tuple[float, ...] = ELASTIC, make: Callable[[int], Disks] = equal_disks
) -> Gas:
    disks = make(N)
    return disks, *equilibrated(disks, packing_fraction), law, {}


def driven() -> Gas:
    """Of sums over all disks, each in another order of lists, the motion takes some bits at each step."""
    disks, box, state, law, _ = periodic(0.3, ROLLING, mixture)
    forces = [
        RandomKicks(0.05, power=1.0),
        Langevin(0.08, temperature=1.0, rate=0.3),
        Rescale(0.13, energy=1.5),
    ]
    return disks, box, state, law, {"forces": forces, "seed": 2}


def walled() -> Gas:
    """Between walls that shake and heat, under gravity: a dense bed with a thin gas above it."""
    disks = mixture(N)
    box = Box((75.0, 150.0), (True, False))
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.arange(60) * 1.25 + 0.6, np.arange(67) * 1.25 + 1.2), axis=-1).reshape(
        -1, 2
    )[:N]
    state = State(grid, rng.normal(size=(N, 2)), rng.normal(size=N))
    walls = [
        Wall.line((0.0, 0.4), (0.0, 1.0), motion=Motion("sine", amplitude=0.3, frequency=0.7)),
        Wall.line((0.0, 149.0), (0.0, -1.0), temperature=2.0),
        Wall.post((30.0, 120.0), 3.0),
        Wall.segment((10.0, 100.0), (60.0, 110.0), surface_speed=0.5),
    ]
    return disks, box, state, (0.98, *COIN[1:]), {"walls": walls, "gravity": (0.0, -0.05), "seed": 4}


def clusters() -> Gas:
    """Coins that have cooled for 150 collisions each: dense clusters in a thin gas."""
    disks = equal_disks(N)
    box, state = equilibrated(disks, 0.3)
    cooled = run_to(engine_of(disks, box, state, np.array([[COIN]]), order="serial"), collisions=75 * N)
    count = np.histogram2d(*cooled.position.T, bins=12, range=[(0.0, length) for length in box.lengths])[0]
    assert count.var() > 3.0 * count.mean()  # of chance alone at this density: 0.4 times
    scale = np.sqrt(2.0 / np.mean(np.sum(cooled.velocity**2, axis=1)))
    return disks, box, State(cooled.position, scale * cooled.velocity, scale * cooled.spin), COIN, {}


GASES: dict[str, Callable[[], Gas]] = {
    "phi = 0.1": lambda: periodic(0.1),
    "phi = 0.3": lambda: periodic(0.3),
    "phi = 0.6": lambda: periodic(0.6),
    "mixture": lambda: periodic(0.4, ROLLING, mixture),
    "driven": driven,
    "walls": walled,
    "clusters": clusters,
}
PER_DISK = {"mixture": 40, "driven": 20, "walls": 20, "clusters": 40}  # 100 for others: 2e5 collisions


@cache
def made(name: str) -> Gas:
    return GASES[name]()


def after(name: str, per_disk: float | None = None, **options: Any) -> tuple[Engine, State]:
    disks, box, state, law, more = made(name)
    engine = engine_of(disks, box, state, np.array([[law]]), **more, **options)
    return engine, run_to(engine, collisions=int((per_disk or PER_DISK.get(name, 100)) * N / 2))


@cache
def in_order(name: str, per_disk: float | None = None) -> State:
    """By one thread, the whole box in one tile."""
    engine, state = after(name, per_disk, order="serial")
    assert engine.arrays.tiles == 1
    return state


def same(one: State, other: State) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in COMPARED)


@pytest.mark.full(keep=("2-phi = 0.3",) if len(THREADS) > 1 else 1)
@pytest.mark.parametrize(
    ("threads", "name"),
    [(threads, name) for threads in THREADS for name in GASES if threads > 1 or name.startswith("phi")],
)
def test_tiles_and_threads_and_the_whole_box_in_order_give_the_same_bits(name: str, threads: int) -> None:
    expected = in_order(name)
    for tile_disks in TILES:
        engine, state = after(name, order="tiled", tile_disks=tile_disks, device=Device(threads=threads))
        for each in COMPARED:
            assert np.array_equal(getattr(state, each), getattr(expected, each)), (tile_disks, each)
        assert engine.arrays.tiles > 1
        if name == "clusters":  # histories reach through whole clusters
            assert engine.statistics.run_again > 0
        else:  # They were tiles indeed: the last resort of all had few windows to do.
            assert engine.statistics.in_order < 0.2 * engine.statistics.windows


def test_more_than_a_million_collisions_at_each_density_have_the_same_bits() -> None:
    """By the test above: of each density of equal disks, in three sizes of tiles, on two threads and on one."""
    assert 100 * N / 2 * len(TILES) * 2 > 1_000_000


# --- what verification is for: without a part of it, the bits change ----------------------------------------------

# Halos narrower than the engine would take them: as wide as who may come at all, and a little for chains.
NARROW = 0.55
FAULTY = {"name": "phi = 0.6", "per_disk": 60}


def narrowed(monkeypatch: pytest.MonkeyPatch, part: float) -> None:
    plan = Windows._plan

    def narrow(self: Windows, **steps: bool) -> None:
        plan(self, **steps)
        self.arrays.scale.usual_halo *= part

    monkeypatch.setattr(Windows, "_plan", narrow)


def in_tiles() -> tuple[Engine, State]:
    return after(**FAULTY, order="tiled", tile_disks=250)


@pytest.mark.full
@pytest.mark.parametrize("part", [NARROW, 0.3])
def test_narrow_halos_that_are_verified_give_the_same_bits(
    part: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    narrowed(monkeypatch, part)
    engine, state = in_tiles()
    assert engine.statistics.run_again > engine.statistics.windows
    assert same(state, in_order(**FAULTY))


@pytest.mark.parametrize(
    ("first", "second", "halo", "bad"),
    [
        ((20.6, 18.0), (27.4, 18.0), 3.3, 12),
        ((23.9, 19.9), (28.1, 24.1), 4.05, 2),
    ],
    ids=["head on", "in a third tile"],
)
def test_a_pair_that_no_tile_sees_is_found_by_the_width_of_halos_alone(
    first: tuple[float, float],
    second: tuple[float, float],
    halo: float,
    bad: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two disks of speed 1 fly at each other for a window of 3, from tiles whose halos do not hold the other one.

    Both tiles find free flights, and agree on them: no ghost record that counts is wrong. Tiles have sides of 12.

    *Head on*, 3.4 on either side of x = 24: contact after (6.8 - 1) / 2 = 2.9. Around the tiles of the pair, where
    disks come by 3, a halo has to be 1 + 3 wide: in 12 tiles, which have one of these two as a neighbour.

    *In a third tile*, which has no disk near: from tiles (1, 1) and (2, 2) into (2, 1), along the diagonal of a square
    of 4.2, with contact after (4.2 sqrt 2 - 1) / 2 = 2.47. In (2, 1) both are copies, and no own disk is near. Halos
    of 4.05 hold 1 + 3, but the disks leave their own two tiles.

    Smooth elastic disks of one mass exchange velocities along their line.
    """
    start = np.array([first, second])
    apart = float(np.linalg.norm(start[1] - start[0]))
    velocity = (start[1] - start[0]) / apart * np.array([[1.0], [-1.0]])
    at_rest = np.stack(np.meshgrid(np.arange(6.0, 48.0, 12.0), np.arange(6.0, 48.0, 12.0)), axis=-1).reshape(
        -1, 2
    )
    disks = equal_disks(18)
    state = State(
        np.concatenate((start, at_rest)), np.concatenate((velocity, np.zeros((16, 2)))), np.zeros(18)
    )
    plan = Windows._plan

    def narrow(self: Windows, **steps: bool) -> None:
        plan(self, **steps)
        self.arrays.scale.usual_halo = halo

    run_bad, found_bad = TileRunner.run_bad, []

    def count(self: TileRunner) -> None:
        found_bad.append(self.n_bad)
        run_bad(self)

    monkeypatch.setattr(Windows, "_plan", narrow)
    monkeypatch.setattr(TileRunner, "run_bad", count)
    engine = engine_of(disks, Box((48.0, 48.0)), state, np.array([[ELASTIC]]), order="tiled", tile_disks=1)
    assert engine.arrays.tiles == 16
    engine.arrays.clock.path, engine.arrays.clock.longest = 1e9, 3.0
    engine.advance(t_end=3.0)
    found = engine.state()
    assert found.time == 3.0
    assert engine.collisions == 1
    np.testing.assert_allclose(found.velocity[:2], -velocity, atol=1e-14)
    flown = (apart - 1.0) - 3.0  # there and back
    np.testing.assert_allclose(found.position[:2], start + flown * velocity, atol=1e-13)
    assert found_bad[0] == bad
    assert engine.statistics.in_order == 0


def test_windows_that_no_halo_is_wide_enough_for_give_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each window, found in tiles first, is run again in the region that is the whole box, from the tiles' lists."""
    monkeypatch.setattr(TileRunner, "run_until_good", TileRunner._run_whole_box)
    engine, state = after("phi = 0.6", per_disk=5, order="tiled", tile_disks=250)
    assert engine.arrays.tiles == 16
    assert engine.statistics.in_order == engine.statistics.windows > 3
    assert same(state, in_order("phi = 0.6", 5))


def unverified(monkeypatch: pytest.MonkeyPatch, part: float = NARROW) -> None:
    narrowed(monkeypatch, part)
    monkeypatch.setattr(TileRunner, "run_until_good", lambda self: None)


def with_half_halos_unverified(monkeypatch: pytest.MonkeyPatch) -> None:
    unverified(monkeypatch, 0.5)


def without_ghosts(monkeypatch: pytest.MonkeyPatch) -> None:
    from ifrdem.kernels.windows.windows import verify
    from ifrdem.simulation.windows.arrays import DeviceArrays

    call = DeviceArrays._call

    def drop(self: DeviceArrays, kernel: Any, numbers: tuple[float, ...], given: dict[str, Any]) -> None:
        if kernel is verify:
            tile = self.tile.to_numpy()
            named(tile, "tile").n_ghosts = 0
            self.tile.from_numpy(tile)
        call(self, kernel, numbers, given)

    monkeypatch.setattr(DeviceArrays, "_call", drop)
    narrowed(monkeypatch, NARROW)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("fault", [unverified, with_half_halos_unverified, without_ghosts])
def test_without_verification_the_bits_would_change(
    fault: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    fault(monkeypatch)
    _, state = in_tiles()
    assert not same(state, in_order(**FAULTY))


def hash_of(*collisions: tuple[float, int]) -> tuple[int, int]:
    """Of the history of a disk with these collisions (time, partner)."""
    backend.start()
    from support.kernels.histories import enter

    from ifrdem.kernels.compiler.language import ti

    info = ti.Vector.ndarray(TABLES["event_info"].width, ti.i32, 1)
    time, partner = np.array([t for t, _ in collisions]), np.array([j for _, j in collisions], dtype=np.int32)
    enter(time, partner, info)
    row = named(info.to_numpy()[0], "event_info")
    return int(row.hash_1), int(row.hash_2)


def test_the_hash_of_a_history_depends_on_times_partners_and_their_order() -> None:
    history = ((0.125, 3), (0.25, 7), (0.25, 9))
    others = [
        ((0.125, 4), (0.25, 7), (0.25, 9)),  # another partner at the same time
        ((0.125, 3), (0.25, 7), (0.25, -10)),  # a wall
        ((0.125, 3), (0.25, 9), (0.25, 7)),  # both at one time, the other way round
        ((float(np.nextafter(0.125, 1.0)), 3), (0.25, 7), (0.25, 9)),
        ((0.125, 3), (0.25, 7)),
        (),
    ]
    found = [hash_of(*each) for each in (history, *others)]
    assert hash_of(*history) == found[0]
    assert len(set(found)) == len(found)


def test_hashes_of_histories_that_nearly_agree_differ() -> None:
    """Of one collision with one of 20 partners at one of 20 times, each a rounding from the next: 400 histories."""
    times = np.spacing(1.0) * np.arange(20) + 1.0
    found = [hash_of((float(t), j)) for t in times for j in range(20)]
    assert len(set(found)) == 400


@pytest.mark.full
@pytest.mark.parametrize("partners", [16, 10**6])
def test_hashes_that_agree_are_as_rare_as_chance_makes_them(partners: int) -> None:
    """Of 2^20 histories of two collisions, 2^39 pairs: 2^39 / 2^32 = 128 agree in one word of 32 bits, 3e-8 in both.

    Five standard errors of a Poisson number.
    """
    backend.start()
    from support.kernels.histories import enter_each

    from ifrdem.kernels.compiler.language import ti

    n, rng = 2**20, np.random.default_rng(3)
    info = ti.Vector.ndarray(TABLES["event_info"].width, ti.i32, n)
    enter_each(rng.random((n, 2)), rng.integers(0, partners, (n, 2), dtype=np.int32), info)
    rows = named(info.to_numpy(), "event_info")
    one, two = rows.hash_1.astype(np.int64), rows.hash_2.astype(np.int64)
    for word in (one, two):
        count = np.unique(word, return_counts=True)[1].astype(np.int64)
        assert (count * (count - 1) // 2).sum() == pytest.approx(128, abs=5 * 128**0.5)
    assert len(np.unique(one * 2**32 + two)) == n


@pytest.mark.full
def test_ids_up_to_the_last_of_32_bits_on_one_thread() -> None:
    """The last disk has number 2^31 - 1, as in a gas of so many: it moves as disk 3999 does, and names its partners."""
    disks, box, state, law, _ = periodic(0.3, COIN)
    shift = 2**31 - N
    found = []
    for first in (0, shift):
        engine = engine_of(
            disks,
            box,
            state,
            np.array([[law]]),
            order="tiled",
            tile_disks=250,
            device=Device(threads=1),
            record=["last_partner"],
        )
        meta = engine.arrays.meta.to_numpy()
        named(meta[:N], "meta").id += first
        engine.arrays.meta.from_numpy(meta)
        engine.keep_collisions = True
        while engine.collisions < 10 * N:
            engine.advance(collisions=10 * N)
        arrays = engine.arrays
        rows = slice(engine.windows.part * arrays.room, engine.windows.part * arrays.room + N)
        lists = {
            name: getattr(arrays, name).to_numpy()[rows]
            for name, kept in arrays.state_arrays().items()
            if kept
        }
        named(lists["meta"], "meta").id -= first
        hits = named(lists["hits"], "hits")
        partner = hits.last_partner
        assert partner.min() >= first - 1
        hits.last_partner = np.where(partner >= 0, partner - first, partner)
        assert engine.last_collisions is not None
        found.append(
            lists | {"pair": engine.last_collisions.pair - first, "time": engine.last_collisions.time}
        )
    assert len(found[0]["pair"]) > 0
    for name, values in found[0].items():
        assert np.array_equal(values, found[1][name]), name
