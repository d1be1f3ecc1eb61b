"""Disks among walls collide as in a serial code that shares no formula with the engine: partner by partner, in order.

Both start from the same state. As in `test_engine_serial_order`, rounding errors grow by some 10 with each collision of
a disk; the runs end after some six of them.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from support.gases import COIN, ROLLING
from support.serial_walls import Gas

from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Turn
from ifrdem.model.walls.wall import Wall, sides
from ifrdem.simulation.simulation import Simulation

SIDE = 20.0
BOX = Box((SIDE, SIDE), (False, False))
STILL = [
    Wall.segment((8.0, 9.0), (13.0, 11.0)),
    Wall.line((0.0, 5.0), (1.0, 1.0), surface_speed=0.4),  # a belt across the lower left corner
    Wall.post((15.0, 15.0), 1.2),
]
SHAKEN = [
    Wall.line((0.0, 1.0), (0.0, 1.0), motion=Motion("sine", amplitude=0.4, frequency=0.8, phase=1.0)),
    Wall.segment((6.0, 9.0), (13.0, 11.0), motion=Motion("sawtooth", amplitude=0.5, frequency=0.6, rise=0.3)),
    Wall.line((0.0, 20.5), (0.1, -1.0), motion=Motion("steady", direction=(0.0, 1.0), speed=-0.4)),
]
DRUM = [
    Wall.container(
        (10.0, 10.0), 9.3, surface_speed=0.8, motion=Motion("sine", (1.0, 0.5), amplitude=0.3, frequency=0.7)
    ),
    Wall.post(
        (11.0, 9.0), 1.2, motion=Motion("sawtooth", (1.0, 0.0), amplitude=0.5, frequency=0.5, rise=0.4)
    ),
    Wall.post((5.0, 12.0), 0.1, surface_speed=0.2),
]
ROOM = [(1.0, 3.0), (6.0, 0.7), (18.0, 1.0), (19.3, 12.0), (11.0, 19.0), (1.0, 18.0), (3.0, 10.0)]
CORNERS = [
    Wall.polygon(ROOM, holds="inside", surface_speed=0.2),  # with a corner that points inwards
    Wall.arc((10.0, 8.0), 3.0, (2.6, 6.4)),  # a bowl, in which disks start too
    Wall.arc((13.0, 14.0), 0.15, (0.3, 2.0)),  # smaller than the disks
    Wall.polyline([(5.0, 13.0), (6.0, 16.0), (7.2, 13.1)]),
]
ABOUT = (10.0, 10.0)
BLADES = Turn("steady", center=ABOUT, rate=0.8)
MIXER = [  # nowhere less than a diameter from each other
    Wall.segment((8.0, 10.0), (12.0, 10.0), turn=BLADES),
    Wall.arc(ABOUT, 2.6, (1.0, 2.5), turn=BLADES),
    Wall.post((10.0, 6.6), 0.4, turn=BLADES),
    # A bowl that swings while it is lifted and lowered, for a time only.
    Wall.arc(
        (16.0, 8.0), 1.2, (3.2, 6.2), turn=Turn("sine", center=(16.0, 8.4), amplitude=0.5, frequency=0.6, phase=0.4),
        motion=Motion("sine", (0.3, 1.0), amplitude=0.3, frequency=0.9), moves_from=0.3, moves_until=1.1,
    ),
    Wall.polygon([(3.8, 11.4), (5.4, 11.8), (4.2, 12.7)], turn=Turn("steady", center=(4.5, 12.0), rate=-1.3)),
    Wall.container(ABOUT, 9.7, turn=Turn("sine", center=(10.2, 10.0), amplitude=0.6, frequency=0.3)),
]  # fmt: skip


def idle(x: float, y: float) -> Wall:
    """A small arc that turns, and moves for a time, where no disk comes: all kept scenes have the same kernels."""
    return Wall.arc(
        (x, y), 0.1, (0.3, 2.0), group="idle", turn=Turn("steady", center=(x, y), rate=0.1),
        motion=Motion("sine", (1.0, 0.0), amplitude=0.01, frequency=0.1), moves_until=0.5,
    )  # fmt: skip


SCENES = {
    "still": (STILL, COIN, 0.0), "shaken": ([*SHAKEN, idle(10.0, 0.2)], ROLLING, -0.5), "drum": (DRUM, ROLLING, -0.3),
    "corners": ([*CORNERS, idle(19.6, 19.6)], ROLLING, -0.4), "mixer": (MIXER, ROLLING, -0.3),
}  # fmt: skip
PER_DISK = 6
STARTS = (7, 8)  # seeds


@cache
def scene(name: str, seed: int) -> tuple[Disks, State, list[tuple[float, int, int]]]:
    """Two kinds of disks wherever a lattice has room between the walls, and what the serial code says of them."""
    walls, law, gravity = SCENES[name]
    walls = [*walls, *sides(BOX)]
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(13), np.arange(13)), axis=-1).reshape(-1, 2) * 1.45 + 1.3
    reach = np.full(len(grid), 0.3)
    place = grid[np.all([wall.gap(grid, reach) > 0.05 for wall in walls], axis=0)]
    n = len(place)
    big = rng.random(n) < 0.5
    disks = Disks(n, np.where(big, 1.0, 0.4), np.where(big, 0.3, 0.2), k=np.where(big, 2.0, 1.0))
    state = State(place, rng.normal(size=(n, 2)), rng.normal(size=n))
    return disks, state, Gas(disks, state, law, walls, (0.0, gravity)).run(PER_DISK * n // 2)


@pytest.mark.full(keep=("shaken-True",))
@pytest.mark.parametrize("serial", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_collisions_with_disks_and_walls_are_those_of_the_serial_code(
    name: str, serial: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not serial:
        monkeypatch.setattr("ifrdem.simulation.windows.tiling.SINGLE_TILE", 50)
    walls, (e_n, e_t, mu, contact_point, rho), gravity = SCENES[name]
    sticking = "contact_point" if contact_point else "percussion_center"
    law = IFRLaw(e_n=e_n, e_t=e_t, mu=mu, sticking=sticking, rho=rho)
    met: set[int] = set()
    for seed in STARTS:
        disks, state, expected = scene(name, seed)
        gas = Simulation(
            disks, BOX, law, state, walls=walls, gravity=(0.0, gravity), histories=range(disks.n)
        )
        gas.run(t_end=expected[-1][0] + 1e-6)
        events = gas.take_events()
        once = (events.partner < 0) | (events.id < events.partner)
        found = sorted(zip(events.time[once], events.id[once], events.partner[once], strict=True))
        found = found[: len(expected)]
        assert [one[1:] for one in found] == [one[1:] for one in expected]
        # Errors of 1e-15 times some 10 per collision and disk; the busiest have twice the mean.
        times = [[time for time, *_ in events] for events in (found, expected)]
        np.testing.assert_allclose(*times, rtol=0.0, atol=1e-6)  # rounding grows with each collision
        met |= {partner for _, _, partner in expected if partner < 0}
    assert met >= {-2 - w for w, wall in enumerate(walls) if wall.group != "idle"}  # each of them was hit
