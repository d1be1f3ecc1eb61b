"""Disks and pistons collide as in a serial code that shares no formula with the engine: hit by hit, in order.

As in `test_walls_serial`, rounding errors grow by some 10 with each collision of a disk.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.gases import COIN, ROLLING
from support.serial_piston import PistonGas

from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Piston
from ifrdem.model.walls.wall import Wall, sides
from ifrdem.simulation.simulation import Simulation

BOX = Box((10.0, 14.0), (False, False))
PISTON = Wall.line((0.0, 10.0), (0.0, -1.0), piston=Piston(mass=5.0, force=6.0, velocity=0.3))
ASLANT = Wall.line(
    (1.0, 0.5), (1.0, 3.0), surface_speed=0.4, piston=Piston(mass=3.0, spring=4.0, velocity=0.5)
)
DIVIDER = Wall.segment(
    (0.0, 6.0), (10.0, 6.0), piston=Piston(mass=2.0, force=-0.5, low=-0.4, high=0.6, velocity=0.4)
)
SPRUNG = Wall.line(
    (0.0, 9.0), (0.0, -1.0), piston=Piston(mass=2.0, force=5.0, spring=20.0, low=-0.1, high=0.6)
)
SCENES = {
    "lid": ([PISTON], COIN, 0.0),
    "falling": ([PISTON, ASLANT], ROLLING, -0.5),
    "divider": ([DIVIDER], ROLLING, -0.3),
    "sprung": ([SPRUNG], ROLLING, 0.4),
}  # fmt: skip


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("name", SCENES)
def test_hits_of_pistons_are_those_of_the_serial_code(name: str) -> None:
    walls, row, gravity = SCENES[name]
    e_n, e_t, mu, contact_point, rho = row
    sticking = "contact_point" if contact_point else "percussion_center"
    law = IFRLaw(e_n=e_n, e_t=e_t, mu=mu, sticking=sticking, rho=rho)
    hits, bounces = 0, 0
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        grid = np.stack(np.meshgrid(np.arange(7), np.arange(9)), axis=-1).reshape(-1, 2) * 1.4 + 0.6
        room = [wall.gap(grid, np.full(len(grid), 0.3)) > 0.05 for wall in (*walls, *sides(BOX))]
        place = grid[np.all(room, axis=0)]
        n = len(place)
        big = rng.random(n) < 0.5
        disks = Disks(n, np.where(big, 1.0, 0.4), np.where(big, 0.3, 0.2), k=np.where(big, 2.0, 1.0))
        state = State(place, rng.normal(size=(n, 2)), rng.normal(size=n))
        serial = PistonGas(disks, state, row, [*walls, *sides(BOX)], (0.0, gravity))
        expected = serial.run(3 * n)
        bounces += serial.bounces
        gas = Simulation(disks, BOX, law, state, walls=walls, gravity=(0.0, gravity), histories=range(n))
        gas.run(t_end=expected[-1][0] + 1e-6)
        events = gas.take_events()
        once = (events.partner < 0) | (events.id < events.partner)
        found = sorted(zip(events.time[once], events.id[once], events.partner[once], strict=True))[
            : len(expected)
        ]
        assert [one[1:] for one in found] == [one[1:] for one in expected]
        times = [[time for time, *_ in events] for events in (found, expected)]
        np.testing.assert_allclose(*times, rtol=0.0, atol=1e-6)  # rounding grows with each collision
        at = events.partner == -2  # of the first piston, unless it hits its stops
        if walls[0].piston.low is None:
            gained = events.partner_velocity_after[at] - events.partner_velocity_before[at]
            along = np.sum(gained * events.normal[at], axis=1)
            assert at.sum() > 5
            np.testing.assert_allclose(walls[0].piston.mass * along, events.impulse[at, 0], rtol=1e-11)
            np.testing.assert_allclose(gained[:, 0], 0.0, atol=1e-16)
        hits += sum(partner < 0 and partner >= -1 - len(walls) for _, _, partner in expected)
    assert hits > 20
    assert (bounces > 3) == any(wall.piston.low is not None for wall in walls if wall.piston)
