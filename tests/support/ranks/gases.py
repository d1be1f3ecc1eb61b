"""Gases on several ranks: `mpiexec -n 4 python gases.py RANKS:NAME[:FAULT]...` prints a line of JSON for each.

It prints what differs from the same gas on one rank, which the first rank computes as well. One process for all of them
compiles the kernels of each once.
"""

from __future__ import annotations

import functools
import json
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from mpi4py import MPI
from support import gases
from support.gases import COIN, ELASTIC, ROLLING, equal_disks, mixture, start

from ifrdem import ContactTime, Device
from ifrdem.errors import EngineError
from ifrdem.kernels import layout as k
from ifrdem.kernels.columns import KIND, named
from ifrdem.kernels.tiles import sums
from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, PoissonKicks, RandomKicks, Rescale, SpinKicks, TableFriction
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.engine import Engine
from ifrdem.simulation.windows import arrays, ranks, runner, tiling
from ifrdem.validation.rows import engine_of

k.BLOCK_OF_TILES = sums.BLOCK_OF_TILES = 3  # so that blocks lie on several ranks
tiling.SINGLE_TILE = 100  # windows as short as those of gases that are divided
N = 3000
COMM = MPI.COMM_WORLD
Gas = tuple[Any, Box, State, tuple[float, ...], float, dict[str, Any]]
"""Disks, box, start, law, collisions of each disk, options."""


def periodic(
    packing_fraction: float, law: tuple[float, ...], per_disk: float, make: Any = equal_disks, **more: Any
) -> Gas:
    disks = make(N)
    return disks, *start(disks, packing_fraction), law, per_disk, more


def walled() -> Gas:
    """Shaken from below, heated from above, under gravity, with an obstacle."""
    disks = mixture(N)
    box = Box((75.0, 130.0), (True, False))
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(60) * 1.25 + 0.6, np.arange(50) * 1.25 + 1.2)
    state = State(np.stack([x, y], axis=-1).reshape(-1, 2)[:N], rng.normal(size=(N, 2)), rng.normal(size=N))
    walls = [
        Wall.line((0.0, 0.4), (0.0, 1.0), motion=Motion("sine", amplitude=0.3, frequency=0.7)),
        Wall.line((0.0, 129.0), (0.0, -1.0), temperature=2.0),
        Wall.post((30.0, 100.0), 3.0),
    ]
    regions = {"left": (0.0, 0.0, 37.0, 130.0), "low": (0.0, 0.0, 75.0, 30.0)}
    more = {
        "walls": walls,
        "gravity": (0.0, -0.05),
        "seed": 4,
        "record": ["ledger", "heat_flux"],
        "regions": regions,
    }
    return disks, box, state, (0.98, *COIN[1:]), 10.0, more


def sheared() -> Gas:
    disks = equal_disks(N)
    return disks, *gases.sheared(disks, 0.3, rate=0.4), COIN, 10.0, {"record": ["stress"]}


def sizes(n: int, small: float = 1.0) -> Disks:
    """A mass and a radius of each, a third of a size, the others `small`: more kinds than ranks have a table of all."""
    rng, third = np.random.default_rng(3), np.arange(n) % 3 == 0
    radius = rng.uniform(0.4, 0.5, n) * np.where(third, 1.0, small)
    return Disks(n, mass=rng.uniform(3.0, 4.0, n) * radius**2, radius=radius, k=np.where(third, 2.0, 1.0))


def fast(make: Any = mixture) -> Gas:
    """Heavy disks fly through tiles within a window: no halo is wide enough, and lists go to other ranks.

    Some fly the other way, for the thermostat leaves a drift alone, and has the rest get the energy.
    """
    disks = make(N)
    disks = Disks(N, np.where(np.arange(N) % 1000 == 0, 1e4, disks.mass), disks.radius, disks.k)
    box, state = start(disks, 0.1)
    state.velocity[::2000], state.velocity[1000::2000] = (40.0, 30.0), (-40.0, -30.0)
    return disks, box, state, COIN, 6.0, {"record": ["ledger"], "forces": [Rescale(0.2, energy=1e4)]}


def spreading(make: Any = mixture) -> Gas:
    """All disks begin in a quarter of the box, and fly on together: tiles go to other ranks."""
    disks = make(N)
    box, state = start(disks, 0.2)
    wide = Box((4.0 * box.lengths[0], box.lengths[1]))
    state.velocity[:, 0] += 4.0
    return disks, wide, state, COIN, 16.0, {"record": ["ledger"]}


def driven(make: Any = mixture) -> Gas:
    """Kicked, and braked on a table; kicks need sums over all disks."""
    forces = [
        RandomKicks(0.05, power=1.0),
        SpinKicks(0.08, power=0.2),
        TableFriction(0.05, mu=0.02, gravity=10.0),
        PoissonKicks(3.0, power=0.5),
    ]
    return periodic(0.3, COIN, 5.0, make, seed=3, record=["ledger"], forces=[*forces, Drag(0.1, rate=0.3)])


GASES: dict[str, Any] = {
    "elastic": lambda: periodic(0.3, ELASTIC, 20.0, mixture, record=["ledger"]),
    "cooling": lambda: periodic(0.4, COIN, 80.0, record=["ledger", "last_partner", "angle"]),
    "mixture": lambda: periodic(
        0.4, ROLLING, 5.0, mixture, collapse=ContactTime(1e-3), record=["free_times"]
    ),
    "walls": walled,
    "shear": sheared,
    "driven": driven,
    "driven sizes": lambda: driven(sizes),
    "fast": fast,
    "spreading": spreading,
    "sizes": lambda: periodic(0.2, COIN, 20.0, lambda n: sizes(n, 0.3), record=["ledger"]),
    "fast sizes": lambda: fast(sizes),
    "spreading sizes": lambda: spreading(sizes),
}


def after(gas: Gas, comm: Any) -> tuple[Engine, dict[str, Any]]:
    """A gas at its end, all numbers that it has."""
    disks, box, state, law, per_disk, more = gas
    options = {"order": "tiled", "tile_disks": 150, "device": Device(threads=1)} | more
    if comm is not None and comm.rank:  # those of the first are taken
        disks, state = None, None  # type: ignore[assignment]
    engine = engine_of(disks, box, state, np.array([[law]]), comm=comm, **options)
    half = engine.collisions + int(per_disk * N / 4)
    while engine.collisions < half:
        engine.advance(collisions=half)
    engine.state()  # looked at within a window
    while engine.collisions < 2 * half:
        engine.advance(collisions=2 * half)
    found = dict(vars(engine.state())) | {
        f"statistics {name}": n for name, n in vars(engine.statistics).items()
    }
    past = engine.comm.gather_rows(N, [engine.past["angle"]]) or [None]
    found |= {"totals": engine.totals(), "sums": engine.windows.sums, "past": past[0]}
    if engine.setup.regions:
        found["regions"] = engine.region_totals()
    found["inputs"] = engine.force_steps.energy_inputs
    engine.keep_collisions = True
    engine.advance(collisions=2 * half + 500)
    assert engine.last_collisions is not None
    return engine, found | {"times": engine.last_collisions.time, "pairs": engine.last_collisions.pair}


@functools.cache
def alone(name: str) -> dict[str, Any]:
    """All numbers of a gas on one rank; faults are of several."""
    return after(GASES[name](), None)[1]


def sleep_until_all_are_here() -> None:
    """Wait for the ranks that have work, asleep: one that waits within MPI keeps a core busy."""
    here = COMM.Ibarrier()
    while not here.Test():
        time.sleep(0.01)


# --- faults, of which each has to be found out --------------------------------------------------------------------


def half_a_ring() -> None:
    """Half of the copies of neighbours' disks are not there."""
    whole = ranks.RankDomain.fetch

    def half(self: Any, **how: bool) -> None:
        whole(self, **how)
        for tiles in self._ghost_tiles:
            named(ranks.view(self.arrays.tile), "tile").count[tiles, int(self.arrays.grid.part)] //= 2

    ranks.RankDomain.fetch = half  # type: ignore[method-assign]


def half_a_halo() -> None:
    """Neighbours send a quarter of what halos need."""
    whole = ranks.RankDomain.bands
    ranks.RankDomain.bands = lambda self: whole(self) / ranks.HALO_GROWTH / 4.0  # type: ignore[method-assign]
    ranks.RankDomain.n_short = lambda self, bad: 0  # type: ignore[method-assign]


def no_foresight() -> None:
    """Neighbours send what halos need at first. This is no fault: it costs time."""
    whole = ranks.RankDomain.bands
    ranks.RankDomain.bands = lambda self: whole(self) / ranks.HALO_GROWTH  # type: ignore[method-assign]


def no_hashes() -> None:
    """Neighbours send nothing about the disks that they ran."""
    whole, exchange = ranks.RankDomain.exchange_hashes, ranks.RankDomain.exchange

    def silent(self: Any, again: bool) -> None:
        ranks.RankDomain.exchange = (
            lambda self, messages: exchange(  # type: ignore[method-assign]
                self, [(*(each[:0] for each in message[:3]), *message[3:]) for message in messages]
            )
        )
        whole(self, again)
        ranks.RankDomain.exchange = exchange  # type: ignore[method-assign]

    ranks.RankDomain.exchange_hashes = silent  # type: ignore[method-assign]


def no_verification() -> None:
    """Hashes are exchanged, but not compared."""
    runner.TileRunner.run_until_good = lambda self: None  # type: ignore[method-assign]


def other_order() -> None:
    """Blocks of tiles are added up in another order."""
    whole = ranks.RankDomain._all_blocks
    ranks.RankDomain._all_blocks = lambda self, blocks: whole(self, blocks)[::-1]  # type: ignore[method-assign]


def wrong_owner() -> None:
    """A tile that its owner does not run."""
    whole = runner.TileRunner.run_all

    def fewer(self: Any, most: int = 1, **given: Any) -> None:
        own = self.arrays.own
        self.arrays.own = own[1:] if COMM.rank == 1 else own
        whole(self, most, **given)
        self.arrays.own = own

    runner.TileRunner.run_all = fewer  # type: ignore[method-assign]


def wrong_row() -> None:
    """Masses stand one row too far down in the tables of kinds of disks that are here."""
    whole, of_mass = ranks.kind_rows, [KIND.inverse_mass, KIND.mass, KIND.inertia]

    def shifted(*columns: Any) -> Any:
        rows = whole(*columns)
        rows[:, of_mass] = np.roll(rows[:, of_mass], 1, axis=0)
        return rows

    ranks.kind_rows = shifted


def ids_below_0() -> None:
    """Ids begin below 0, as those of more than 2^31 disks. This is no fault."""
    ranks.first_id = lambda n: -(n // 2)


FAULTS = {
    each.__name__: each
    for each in (
        ids_below_0, no_foresight, half_a_ring, half_a_halo, no_hashes, no_verification, other_order, wrong_owner,
        wrong_row,
    )
}  # fmt: skip
COUNTED = {"relist": 0, "_empty_table": 0}


def count_calls() -> None:
    """Count how often disks are listed again, which sends them to other ranks, and tables of kinds are restarted."""

    def count(of: type, name: str, whole: Any) -> None:
        def counted(self: Any, *given: Any) -> None:
            COUNTED[name] += 1
            whole(self, *given)

        setattr(of, name, counted)

    for name, of in (("relist", arrays.DeviceArrays), ("_empty_table", ranks.RankDomain)):
        count(of, name, getattr(of, name))


def outcome_of(comm: Any, name: str) -> dict[str, Any]:
    """Digest of a gas at its end, for the first rank to print."""
    gas = GASES[name]()
    COUNTED.update(dict.fromkeys(COUNTED, 0))
    try:
        engine, found = after(gas, comm)
    except EngineError as error:
        return {"error": str(error)}
    if comm.rank:
        return {}
    expected = alone(name)
    differ = [
        each for each in expected if not np.array_equal(np.asarray(expected[each]), np.asarray(found[each]))
    ]
    counted = vars(engine.statistics) | {
        "relisted": COUNTED["relist"],
        "tables": COUNTED["_empty_table"],
    }
    if comm.size > 1:
        counted["whole"] = engine.arrays.domain.communication.whole
        counted["moved"] = engine.arrays.domain.communication.moved
    own = int(np.sum(np.asarray(getattr(engine.arrays, "own", [])) >= 0))
    differ = [
        each for each in differ if each != "statistics run_again"
    ]  # depends on room for ghost records too
    return {"differ": differ, **counted, "tiles": engine.arrays.tiles, "own": own}


if __name__ == "__main__":
    count_calls()
    for word in sys.argv[1:]:
        size, name, *faults = word.split(":")
        kept = [(of, dict(vars(of))) for of in (ranks, ranks.RankDomain, runner.TileRunner)]
        for fault in faults:
            FAULTS[fault]()
        comm = COMM.Split(0 if COMM.rank < int(size) else MPI.UNDEFINED)
        if comm != MPI.COMM_NULL:
            line = {"word": word} | outcome_of(comm, name)
            if COMM.rank == 0:
                print(json.dumps(line), flush=True)
        sleep_until_all_are_here()
        for of, whole in kept:
            for name in [name for name in vars(of) if name not in whole]:
                delattr(of, name)
            for name, value in whole.items():
                if vars(of)[name] is not value:
                    setattr(of, name, value)
