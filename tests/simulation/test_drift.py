"""A gas that moves as a whole is the same gas: thermostats, temperatures and collisions about its mean velocity."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.gases import mixture, start

import ifrdem
from ifrdem import Device
from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, Force, Langevin, RandomKicks, Rescale, SpinKicks, TableFriction
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall, free_directions, smooth_materials
from ifrdem.simulation.simulation import Simulation

SMOOTH = IFRLaw(e_n=0.7, e_t=-1.0, mu=0.0)
ROUGH = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)


def thermal(mass: NDArray[np.float64], velocity: NDArray[np.float64]) -> float:
    """T about the mean velocity, by two passes over the disks."""
    u = np.average(velocity, axis=0, weights=mass)
    return float(np.mean(0.5 * mass * np.sum((velocity - u) ** 2, axis=1)))


def rescaled(gas: Simulation, step: float, collisions_per_disk: float) -> State:
    """The state right after the thermostat has acted, when each disk has had so many collisions."""
    gas.run(collisions_per_disk=collisions_per_disk)
    gas.run(t_end=(math.ceil(gas.time / step + 0.5) - 0.5) * step)
    return gas.state


@pytest.mark.full
@pytest.mark.parametrize(
    ("precision", "collisions", "drift", "exact"),
    # Sums of 50 terms in double precision; velocities are stored, and the factor computed, to 6e-8 in single.
    [("f64", 2000, 0.0, 1e-13), ("f32", 500, 0.0, 1e-6), ("f32", 500, 3.0, 1e-5), ("f32", 20, 1000.0, 1e-4)],
)
def test_a_thermostat_does_not_freeze_its_gas(
    precision: str, collisions: int, drift: float, exact: float
) -> None:
    """The flying ice cube: a factor on all velocities makes an exponential drift of the rounding of the momentum.

    With it, half of the energy was in the drift after some 300 collisions per disk in double precision. Without it, the
    momentum is a random walk: K steps round N velocities, and C collisions two each, by half a unit in the last place
    of some 2 (fast disks), or of the drift.
    """
    n, step = 50, 2.0
    disks = Disks(n, mass=1.0, radius=0.5)
    box, state = start(disks, 0.2)
    state.velocity = state.velocity + np.array([drift, 0.0])
    gas = Simulation(
        disks, box, SMOOTH, state, forces=[Rescale(step, temperature=1.0)], device=Device(precision=precision)
    )
    before = gas.measure().momentum
    end = rescaled(gas, step, collisions)
    assert thermal(disks.mass, end.velocity) == pytest.approx(1.0, rel=exact)
    assert gas.measure().temperature == pytest.approx(1.0, rel=exact)
    roundings = n * gas.time / step + 2.0 * gas.collisions
    ulp = np.finfo(precision.replace("f", "float")).eps * (2.0 + drift)
    assert np.abs(gas.measure().momentum - before).max() < 5.0 * math.sqrt(roundings) * ulp


def test_energies_of_rough_disks_are_rescaled_about_the_drift() -> None:
    """Two masses in motion: the kinetic energy about the mean velocity becomes the given one, the momentum stays."""
    disks = mixture(200)
    box, state = start(disks, 0.3)
    state.velocity = state.velocity + np.array([5.0, -3.0])
    gas = Simulation(disks, box, ROUGH, state, forces=[Rescale(0.5, energy=1.7)])
    end = rescaled(gas, 0.5, 20.0)
    spins = 0.5 * float(disks.inertia @ end.spin**2)
    # The drift has 20 times the energy, in whose rounding the rest is found.
    assert thermal(disks.mass, end.velocity) + spins / 200 == pytest.approx(1.7, rel=1e-13)
    np.testing.assert_allclose(
        disks.mass @ end.velocity, disks.mass.sum() * np.array([5.0, -3.0]), rtol=1e-13
    )


@pytest.mark.full
def test_disks_that_fly_side_by_side_are_at_rest_to_a_thermostat() -> None:
    """They have no thermal velocities that could be scaled, only the rounding of their mean."""
    disks = Disks(50, mass=0.3, radius=0.5)
    box, state = start(disks, 0.2)
    state.velocity = np.tile([0.1, 0.7], (50, 1))
    state.spin = np.zeros(50)
    gas = Simulation(disks, box, ROUGH, state, forces=[Rescale(0.5, temperature=1.0)])
    gas.run(t_end=5.0)
    np.testing.assert_allclose(gas.state.velocity, state.velocity, rtol=1e-13)


@pytest.mark.full
@pytest.mark.parametrize(("law", "free"), [(SMOOTH, True), (ROUGH, False)])
def test_between_walls_the_gas_drifts_along_smooth_ones_only(law: IFRLaw, free: bool) -> None:
    """Floor and ceiling without friction keep P_x; other velocities, and those between rough ones, are in the lab."""
    disks = Disks(50, mass=1.0, radius=0.5)
    box = Box((20.0, 10.0), (True, False))
    position = ifrdem.initial.hexagonal_positions(box, disks.radius)
    velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1) + np.array([2.0, 0.0])
    gas = Simulation(
        disks, box, law, State(position, velocity, np.zeros(50)), forces=[Rescale(1.0, temperature=1.0)]
    )
    end = rescaled(gas, 1.0, 300.0)
    about = end.velocity - (end.velocity.mean(axis=0) * (free, 0.0))
    assert float(np.mean(0.5 * np.sum(about**2, axis=1))) == pytest.approx(1.0, rel=1e-13)
    assert gas.measure().temperature == pytest.approx(1.0, rel=1e-13)
    assert (abs(end.velocity[:, 0].sum() - 100.0) < 1e-10) == free


def test_directions_in_which_a_gas_can_drift() -> None:
    """No wall pushes along itself without friction; all others do, and disks of infinite mass."""
    floor, side = Wall.line((0.0, 0.0), (0.0, 1.0)), Wall.line((0.0, 0.0), (1.0, 0.0))
    smooth = frozenset({0})
    assert free_directions(()) == (True, True)
    assert free_directions((), immovable=True) == (False, False)
    assert free_directions([floor]) == (False, False)
    assert free_directions([floor], smooth=smooth) == (True, False)
    assert free_directions([side], smooth=smooth) == (False, True)
    assert free_directions([floor, side], smooth=smooth) == (False, False)
    shaken = Wall.line((0.0, 0.0), (0.0, 1.0), motion=Motion("sine", amplitude=0.1, frequency=1.0))
    assert free_directions([shaken], smooth=smooth) == (True, False)
    for other in (
        Wall.line((0.0, 0.0), (0.0, 1.0), temperature=1.0),  # gives a tangential velocity
        Wall.line((0.0, 0.0), (0.0, 1.0), material=1),
        Wall.line((0.0, 0.0), (0.1, 1.0)),
        Wall.segment((0.0, 0.0), (1.0, 0.0)),  # has ends
        Wall.post((0.0, 0.0), 0.0),
    ):
        assert free_directions([other], smooth=smooth) == (False, False)
    e_t, mu = np.array([[-1.0, -1.0], [-1.0, -0.9]]), np.array([[0.0, 0.0], [0.0, 0.0]])
    assert smooth_materials(e_t, mu, [0]) == {0, 1}
    assert smooth_materials(e_t, mu, [0, 1]) == {0}
    assert smooth_materials(e_t, np.where(np.eye(2), 0.1, mu), [0]) == {1}


def test_forces_say_if_they_keep_the_momentum() -> None:
    class Own(Force):
        pass

    kept = [RandomKicks(1.0, power=1.0), SpinKicks(1.0, power=1.0), Rescale(1.0, energy=1.0)]
    kept += [Langevin(1.0, temperature=1.0, spin_rate=1.0), Drag(1.0, spin_rate=1.0)]
    changed = [Langevin(1.0, temperature=1.0, rate=0.1), Drag(1.0, rate=0.1), Drag(1.0, quadratic=0.1)]
    changed += [TableFriction(1.0, mu=0.1), Own(1.0)]
    assert [each.keeps_momentum for each in (*kept, *changed)] == [True] * 5 + [False] * 5


@pytest.mark.full(keep=("0.4",))
@pytest.mark.parametrize("shear_rate", [0.0, 0.4])
def test_a_gas_in_motion_is_the_gas_at_rest(shear_rate: float) -> None:
    """Galilei: the same collisions, temperatures and stresses, to what rounding has become in 3 collisions per disk.

    In a flow (rate y, 0), too: the drift along y carries the gas into faster layers, behind which its mean velocity
    along x falls as -rate w_y t, and velocities relative to both are those of the gas without a drift.
    """
    n, w = 500, np.array([3.0, -2.0])
    disks = mixture(n)
    box = Box.from_packing_fraction(disks.radius, 0.3, shear_rate=shear_rate)
    position = ifrdem.initial.hexagonal_positions(box, disks.radius, seed=1)
    peculiar = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
    found = []
    for drift in (np.zeros(2), w):
        state = State(position, peculiar + drift + box.flow(position), np.zeros(n))
        gas = Simulation(disks, box, ROUGH, state)
        gas.run(t_end=1.0)
        found.append(gas.measure())
    rest, moving = found
    assert rest.collisions == moving.collisions > n
    # Places are rounded by 1e-15, and shifts grow tenfold with each collision of a disk.
    for name in ("temperature", "rotational_temperature", "momentum_flux"):
        assert getattr(moving, name) == pytest.approx(getattr(rest, name), rel=1e-9)
    u = w - (shear_rate * w[1], 0.0)
    np.testing.assert_allclose(moving.momentum, disks.mass.sum() * u, rtol=1e-12)
    assert moving.drift_energy == pytest.approx(0.5 * disks.mass.sum() * float(u @ u), rel=1e-12)
    assert rest.drift_energy < 1e-20


def test_a_cold_gas_in_fast_motion_is_waited_for() -> None:
    """The drift is 3000 times the thermal speed: the free time follows from the latter.

    Two disks that fly side by side never meet, which is reported soon.
    """
    disks = Disks(20, mass=1.0, radius=0.5)
    box, state = start(disks, 0.05)
    cold = State(state.position, 1e-3 * state.velocity + (3.0, 0.0), np.zeros(20))
    gas = Simulation(disks, box, SMOOTH, cold)
    gas.run(collisions_per_disk=1.0)
    assert gas.collisions == 10
    still = State(state.position, np.tile([3.0, 0.0], (20, 1)), np.zeros(20))
    with pytest.raises(ifrdem.NoMoreCollisions):
        Simulation(disks, box, SMOOTH, still).run(collisions_per_disk=1.0)


@pytest.mark.full
def test_where_a_medium_is_at_rest_temperatures_are_in_its_frame() -> None:
    """Disks without collisions slow down as exp(-rate t) in the medium, and T as its square."""
    disks = Disks(4, mass=2.0, radius=0.01)
    state = State(
        np.array([[1.0, 1.0], [1.0, 5.0], [5.0, 1.0], [5.0, 5.0]]), np.tile([3.0, 0.0], (4, 1)), np.zeros(4)
    )
    gas = Simulation(disks, Box((8.0, 8.0)), ROUGH, state, forces=[Drag(0.1, rate=0.5)])
    assert gas.measure().temperature == 9.0
    gas.run(t_end=1.0)
    assert gas.measure().temperature == pytest.approx(9.0 * math.exp(-1.0), rel=1e-12)
    assert gas.measure().drift_energy == 0.0
    gas.set_forces([])
    assert gas.measure().temperature == 0.0
    assert measure(disks, gas.state).temperature == 0.0
