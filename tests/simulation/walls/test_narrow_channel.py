"""Channels between walls that are narrower than three disks: only across periodic sides could a disk meet its image."""

from __future__ import annotations

import numpy as np
import pytest
from support.gases import COIN, run_to
from support.serial_walls import Gas

from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import sides
from ifrdem.simulation.simulation import Simulation
from ifrdem.validation.rows import engine_of

WIDTH = 1.3  # diameters are 0.8 and 1


def channel(n: int) -> tuple[Disks, State]:
    """Disks of two kinds in a row, two apart, none nearer to a wall than 0.02."""
    rng = np.random.default_rng(3)
    big = rng.random(n) < 0.5
    disks = Disks(n, np.where(big, 1.0, 0.64), np.where(big, 0.5, 0.4))
    place = np.column_stack([2.0 * np.arange(n) + 1.0, 0.5 * WIDTH + rng.uniform(-0.1, 0.1, n)])
    return disks, State(place, rng.normal(size=(n, 2)), rng.normal(size=n))


@pytest.mark.full
def test_disks_in_a_narrow_channel_collide_as_in_a_serial_code() -> None:
    """A channel closed at its ends; the code shares no formula with the engine."""
    disks, state = channel(12)
    box = Box((24.0, WIDTH), (False, False))
    expected = Gas(disks, state, COIN, sides(box), (0.0, 0.0)).run(36)
    e_n, e_t, mu, contact_point, rho = COIN
    law = IFRLaw(
        e_n=e_n, e_t=e_t, mu=mu, sticking="contact_point" if contact_point else "percussion_center", rho=rho
    )
    gas = Simulation(disks, box, law, state, histories=range(disks.n))
    gas.run(t_end=expected[-1][0] + 1e-6)
    events = gas.take_events()
    once = (events.partner < 0) | (events.id < events.partner)
    found = sorted(zip(events.time[once], events.id[once], events.partner[once], strict=True))[
        : len(expected)
    ]
    assert [one[1:] for one in found] == [one[1:] for one in expected]
    # Rounding of 1e-16 grows some tenfold with each collision of a disk, of which the busiest have ten or so.
    np.testing.assert_allclose([one[0] for one in found], [one[0] for one in expected], rtol=0.0, atol=1e-6)


@pytest.mark.full
def test_a_narrow_channel_in_many_tiles_has_the_bits_of_one() -> None:
    disks, state = channel(150)
    box = Box((300.0, WIDTH), (True, False))
    ends = []
    for order in ("serial", "tiled"):
        engine = engine_of(disks, box, state, np.array([[COIN]]), order=order, tile_disks=15)
        ends.append(run_to(engine, 4.0))
        assert engine.collisions > 75  # one of each disk
        assert (engine.arrays.tiles > 5) == (order == "tiled")
    for name in ("position", "velocity", "spin", "collisions", "image"):
        np.testing.assert_array_equal(*(getattr(end, name) for end in ends), err_msg=name)


def test_a_periodic_side_must_be_three_disks_wide_and_one_between_walls_one() -> None:
    disks, state = channel(3)
    law = IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    with pytest.raises(InputError, match=r"more than a third of the periodic side 1\.3"):
        Simulation(disks, Box((24.0, WIDTH)), law, state)
    with pytest.raises(InputError, match=r"more than a third of the periodic side 1\.3"):
        Simulation(disks, Box((24.0, WIDTH), (False, True)), law, state)
    with pytest.raises(InputError, match=r"overlaps wall \d \(line\)"):
        Simulation(
            disks,
            Box((24.0, 0.9), (True, False)),
            law,
            State(state.position * [1.0, 0.6], state.velocity, state.spin),
        )
