"""An immovable disk: a body of infinite mass that others bounce off."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from ifrdem import (
    Box,
    Disks,
    IFRLaw,
    InputError,
    RotatingGravity,
    Simulation,
    State,
    Trajectory,
    TrajectoryWriter,
)
from ifrdem.model.observables import measure


def two(mass: list[float]) -> tuple[Disks, Box]:
    return Disks(2, mass=mass, radius=[0.5, 1.0]), Box((12.0, 12.0))


def test_a_disk_rebounds_from_an_immovable_one_which_stays(tmp_path):
    """Head on, without spin: -e_n v (Eq. 6 at M = 0)."""
    disks, box = two([2.0, np.inf])
    start = State(position=[[3.0, 6.0], [6.0, 6.0]], velocity=[[1.5, 0.0], [0.0, 0.0]], spin=[0.0, 0.0])
    simulation = Simulation(disks, box, IFRLaw(e_n=0.8, e_t=-0.9, mu=0.2), start)
    path = tmp_path / "wall.h5"
    with warnings.catch_warnings(), TrajectoryWriter(path, disks, box, precision="f64") as file:
        warnings.simplefilter("error")  # no NaN on the way, not even a hidden one
        simulation.run(
            t_end=2.0,
            frame_callbacks=[lambda state, observed: file.write(state, {"energy": observed.energy})],
        )
    with Trajectory(path) as trajectory:
        assert list(trajectory[-1].collisions) == [1, 1]
        np.testing.assert_allclose(trajectory[-1].velocity, [[-1.2, 0.0], [0.0, 0.0]], atol=1e-14)
        np.testing.assert_array_equal(trajectory[-1].position[1], [6.0, 6.0])
        np.testing.assert_allclose(trajectory.observables["energy"], [2.25, 1.44], rtol=1e-13)


def test_it_counts_neither_in_energy_nor_in_momentum_nor_in_temperature():
    disks, _ = two([2.0, np.inf])
    state = State(position=[[3.0, 6.0], [6.0, 6.0]], velocity=[[1.5, 0.0], [0.0, 0.0]], spin=[4.0, 0.0])
    found = measure(disks, state)
    # m v^2 / 2 = 2.25; I = 2 0.25 / 2 = 0.25, so I w^2 / 2 = 2; one disk that can move
    assert (found.translational_energy, found.rotational_energy) == (2.25, 2.0)
    assert (found.temperature, found.rotational_temperature) == (2.25, 4.0)
    np.testing.assert_array_equal(found.momentum, [3.0, 0.0])


def test_a_gas_among_immovable_disks_keeps_its_energy():
    """Elastic smooth disks between fixed obstacles, as in a Lorentz gas; many collisions, no NaN."""
    rng = np.random.default_rng(1)
    places = np.stack(np.divmod(np.arange(64), 8), axis=1) * 2.0 + 1.0
    mass = np.where(np.arange(64) % 7 == 0, np.inf, 1.0)
    velocity = np.where(np.isinf(mass)[:, None], 0.0, rng.normal(size=(64, 2)))
    disks = Disks(64, mass=mass, radius=0.5)
    gas = Simulation(
        disks, Box((16.0, 16.0)), IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), State(places, velocity, np.zeros(64))
    )
    before = measure(disks, gas.state).energy
    gas.run(collisions_per_disk=20)
    state = gas.state
    assert np.all(np.isfinite(state.velocity))
    assert measure(disks, state).energy == pytest.approx(before, rel=1e-12)  # f64 round-off of 640 collisions
    fixed = np.isinf(mass)
    assert state.collisions[fixed].min() > 0
    np.testing.assert_array_equal(state.velocity[fixed], 0.0)
    np.testing.assert_allclose(state.position[fixed], places[fixed], rtol=1e-15)


@pytest.mark.parametrize(("velocity", "spin"), [([1.0, 0.0], 0.0), ([0.0, 0.0], 2.0)])
def test_an_immovable_disk_must_be_at_rest(velocity, spin):
    disks, box = two([2.0, np.inf])
    state = State(position=[[3.0, 6.0], [6.0, 6.0]], velocity=[[0.0, 0.0], velocity], spin=[0.0, spin])
    with pytest.raises(InputError, match="disk 1 has an infinite mass and moves"):
        Simulation(disks, box, IFRLaw(e_n=0.8, e_t=-0.9, mu=0.2), state)


@pytest.mark.parametrize("gravity", [(0.0, -1.0), RotatingGravity((0.0, -1.0), rate=0.1)])
def test_gravity_is_refused_where_immovable_disks_are(gravity):
    """It acted on them too: they fell, and at the floor, inf - inf, ended the run with a velocity that is no number."""
    disks, _ = two([2.0, np.inf])
    state = State(position=[[3.0, 6.0], [6.0, 6.0]], velocity=np.zeros((2, 2)), spin=np.zeros(2))
    law, box = IFRLaw(e_n=0.8, e_t=-0.9, mu=0.2), Box((12.0, 12.0), (False, False))
    with pytest.raises(InputError, match=r"gravity = .*disks of infinite mass.*Wall\.post"):
        Simulation(disks, box, law, state, gravity=gravity)
    gas = Simulation(disks, box, law, state)
    with pytest.raises(InputError, match=r"gravity = .*disks of infinite mass"):
        gas.set_gravity((0.0, -1.0))


def test_radius_and_k_must_still_be_finite():
    for wrong in ({"radius": np.inf}, {"radius": 1.0, "k": np.inf}):
        with pytest.raises(InputError, match="must be positive, from 1e-50 to"):
            Disks(1, mass=1.0, **wrong)
    with pytest.raises(
        InputError, match=r"mass = nan: must be positive, from 1e-50, or inf for an immovable disk"
    ):
        Disks(1, mass=np.nan, radius=1.0)
