"""Pressure tensor: momentum that collisions transfer, against other codes and exact identities."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from support.gases import COIN, equal_disks, gas_of, mixture, start
from support.gases import sheared as sheared_start
from support.shear_reference import Sheared

from ifrdem import ContactTime, Rest
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import Measure, Stress, heat_flux, measure, stress
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion
from ifrdem.model.walls.wall import Wall
from ifrdem.simulation.simulation import Simulation
from ifrdem.simulation.steps.schedule import Trigger
from ifrdem.validation.rows import engine_of

ROUGH = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)


def virial_of(events, disks: Disks) -> np.ndarray:
    """Sum of (dp_i)_a (r_i - r_j)_b over rows of tracked disks; of pairs that stand twice, half of each.

    The impulse is from velocities before and after; r_i - r_j is minus the normal times the distance of the contact.
    """
    p = disks.mass[events.id, None] * (events.velocity_after - events.velocity_before)
    pair = events.partner >= 0
    distance = disks.radius[events.id] + np.where(pair, disks.radius[np.where(pair, events.partner, 0)], 0.0)
    half = np.where(pair, 0.5, 1.0)
    return np.einsum("i,ia,ib->ab", -half * distance, p, events.normal)


def energy_of(events, disks: Disks) -> np.ndarray:
    """Sum of de_i (r_i - r_c)_b over rows of tracked disks: from the contact, a radius along the normal, to i."""
    before, after = (
        disks.mass[events.id] * np.sum(v**2, axis=1) + disks.inertia[events.id] * w**2
        for v, w in (
            (events.velocity_before, events.spin_before),
            (events.velocity_after, events.spin_after),
        )
    )
    return np.einsum("i,ib->b", -0.5 * (after - before) * disks.radius[events.id], events.normal)


def test_the_virial_is_that_of_tracked_collisions(device):
    """Of rough disks of many masses and radii, in a box without walls. So is the energy that they transfer."""
    disks = mixture(300)
    gas = gas_of(disks, 0.4, ROUGH, device=device, histories=range(300), record=["heat_flux"])
    gas.run(collisions_per_disk=8.0)
    events = gas.take_events()
    found = gas.measure().virial
    of_energy = energy_of(events, disks)
    assert np.abs(of_energy).min() > 1.0
    np.testing.assert_allclose(gas.measure().energy_transfer, of_energy, rtol=1e-9)
    np.testing.assert_allclose(found, virial_of(events, disks), rtol=1e-10, atol=1e-10 * np.abs(found).max())
    assert found[0, 0] > 0.0 < found[1, 1]  # positive in compression
    # Friction turns spins: P_xy and P_yx differ by more than rounding.
    assert abs(found[0, 1] - found[1, 0]) > 1e-4 * found[0, 0]


@pytest.mark.full
def test_walls_and_posts_transfer_momentum_and_energy_from_where_they_are_touched(device):
    """Walls that move and heat, an arc, a post and gravity; the normal of an event points from the disk to the wall."""
    box = Box((12.0, 30.0), (False, False))
    disks = equal_disks(40)
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2) * 1.4 + 1.0
    walls = [
        Wall.line((0.0, 0.3), (0.0, 1.0), motion=Motion("sine", amplitude=0.2, frequency=1.0)),
        Wall.line((0.0, 12.3), (0.0, -1.0), temperature=1.5),
        Wall.post((6.0, 9.6), 1.0),
        Wall.arc((6.0, 8.0), 3.0, (0.2, 1.2)),
    ]
    state = State(grid, rng.normal(size=(40, 2)), rng.normal(size=40))
    gas = Simulation(
        disks, box, ROUGH, state, device=device, walls=walls, gravity=(0.0, -0.05), histories=range(40),
        collapse=ContactTime(1e-5), record=["heat_flux", "wall_sums"],
    )  # fmt: skip
    gas.run(t_end=20.0)
    found = gas.measure().virial
    events = gas.take_events()
    np.testing.assert_allclose(gas.measure().energy_transfer, energy_of(events, disks), rtol=1e-9)
    assert np.count_nonzero(events.partner == -2 - 3) > 5 < np.count_nonzero(events.partner == -2 - 2)
    np.testing.assert_allclose(found, virial_of(events, disks), rtol=1e-9, atol=1e-9 * np.abs(found).max())


def test_an_immovable_disk_transfers_what_the_other_one_loses(device):
    """From the left onto an immovable disk: dp = -2 for the mover, 1 away along -x: virial 2."""
    for first in (0, 1):  # whichever id is smaller
        mass = np.where(np.arange(2) == first, np.inf, 1.0)
        x, v = np.array([[5.0, 5.0], [5.0, 5.0]]), np.zeros((2, 2))
        x[1 - first, 0], v[1 - first, 0] = 2.0, 1.0
        gas = Simulation(
            Disks(2, mass=mass, radius=0.5), Box((10.0, 10.0)), IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0),
            State(x, v, np.zeros(2)), device=device, record=["stress"], histories=[0, 1],
        )  # fmt: skip
        gas.run(t_end=3.0)
        assert gas.measure().virial == pytest.approx(np.array([[2.0, 0.0], [0.0, 0.0]]), abs=1e-12)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("order", ["serial", "tiled"])
def test_a_sheared_gas_transfers_the_momentum_of_a_serial_code(order):
    """Of a code in the lab without frames or rows (`Sheared`); 700 collisions, some across the moving images."""
    disks = mixture(300)
    box, state = sheared_start(disks, 0.3, 0.7)
    reference = Sheared(disks, box, COIN, state)
    reference.run(collisions=700, window=0.1)
    options = {"order": order, "tile_disks": 30 if order == "tiled" else None}
    engine = engine_of(disks, box, state, np.array([[COIN]]), record=["stress", "ledger"], **options)
    while engine.collisions < 700:
        engine.advance(collisions=700)
    # Rounding grows tenfold with each collision of a disk.
    scale = np.abs(reference.virial).max()
    np.testing.assert_allclose(engine.virial, reference.virial, atol=1e-6 * scale)
    assert engine.virial[0, 1] < -0.05 * scale  # the flow is slowed


def sheared_gas(n: int = 60, rate: float = 0.4) -> Simulation:
    disks = mixture(n)
    box, state = sheared_start(disks, 0.3, rate)
    return Simulation(disks, box, ROUGH, state, record=["stress", "ledger"])


@pytest.mark.full
def test_viscous_heating_is_the_shear_stress_times_the_rate():
    """dE/dt + dissipation = -rate P_xy A, to rounding: E of velocities relative to the flow.

    Between collisions m V_x V_y changes by -rate m V_y^2 a unit of time, so its integral from one collision to the next
    follows from its value after the first.
    """
    gas, rate = sheared_gas(), 0.4
    rows: list[Measure] = []
    every = Trigger(collisions=2.0 / gas.disks.n)
    gas.run(collisions_per_disk=30.0, series=every, series_callbacks=[rows.append])
    assert len(rows) == gas.collisions + 1
    kinetic = 0.0
    for before, after in itertools.pairwise(rows):
        dt = after.time - before.time
        kinetic += before.momentum_flux[0, 1] * dt - 0.5 * rate * before.momentum_flux[1, 1] * dt**2
    last = rows[-1]
    heat = -rate * (kinetic + last.virial[0, 1])
    lost = float(np.sum(last.dissipated))
    assert last.energy - rows[0].energy + lost == pytest.approx(heat, rel=1e-12)
    assert last.energy_input == pytest.approx(heat, rel=1e-12)
    assert heat > 10.0


@pytest.mark.full
def test_what_shear_stresses_differ_by_turns_the_spins():
    """Angular momentum: d(sum I w) = V_xy - V_yx, with V the virial, of laws without a rolling torque."""
    gas = sheared_gas()
    before = float(gas.disks.inertia @ gas.state.spin)
    gas.run(collisions_per_disk=30.0)
    virial = gas.measure().virial
    gained = float(gas.disks.inertia @ gas.state.spin) - before
    assert virial[0, 1] - virial[1, 0] == pytest.approx(gained, rel=1e-9)
    assert abs(gained) > 0.01


@pytest.mark.full
def test_the_virial_theorem_of_a_gas_between_walls():
    """d(sum p_x x) = integral of sum m v_x^2 + sum of impulses times x.

    Impulses of a pair make its part of the virial. A wall acts at the disk's centre: its part of the virial and the
    impulse times the x of the contact, 0 or 15. The integral is by steps, to 1e-5 of it.
    """
    box = Box((15.0, 12.0), (False, True))
    disks = mixture(60)
    position = np.stack(np.meshgrid(np.arange(10), np.arange(6)), axis=-1).reshape(-1, 2) * 1.4 + 1.0
    rng = np.random.default_rng(2)
    state = State(position, rng.normal(size=(60, 2)), rng.normal(size=60))
    gas = Simulation(disks, box, ROUGH, state, record=["stress", "wall_sums"])
    rows: list[Measure] = []
    gas.run(t_end=30.0, series=Trigger(number=4000), series_callbacks=[rows.append])
    t = np.array([row.time for row in rows])
    flux = np.array([row.momentum_flux[0, 0] for row in rows])
    integral = float(np.sum(0.5 * (flux[1:] + flux[:-1]) * np.diff(t)))
    change = float(disks.mass @ (gas.state.velocity[:, 0] * gas.state.position[:, 0]))
    change -= float(disks.mass @ (state.velocity[:, 0] * state.position[:, 0]))
    right = gas.wall_sums.values[1, 0]
    assert right < 0.0
    assert integral + rows[-1].virial[0, 0] == pytest.approx(change - 15.0 * right, rel=2e-4)


@pytest.mark.full
def test_sums_do_not_depend_on_what_looks():
    """With stresses, and from a state within the run: the same bits of the gas, and the same sums to rounding."""
    disks = mixture(300)
    ends = []
    for record in ([], ["stress"]):
        gas = gas_of(disks, 0.4, ROUGH, record=record, histories=[0])
        gas.run(t_end=0.9)
        ends.append(gas)
    np.testing.assert_array_equal(ends[0].state.velocity, ends[1].state.velocity)
    other = gas_of(disks, 0.4, ROUGH, record=["stress"], histories=[0])
    found = []
    frames = []
    other.run(
        t_end=0.9, series=Trigger(number=7), series_callbacks=[lambda m: found.append(m.virial)],
        frame_callbacks=[lambda _, m: frames.append(m.virial)],
    )  # fmt: skip
    np.testing.assert_allclose(found[-1], ends[1].measure().virial, rtol=1e-12)
    np.testing.assert_array_equal(frames[-1], found[-1])
    assert (np.diff([each[0, 0] for each in found]) > 0.0).all()


@pytest.mark.full
def test_sums_of_walls_and_heats_have_columns_of_their_own() -> None:
    """The bits of all sums of walls, with and without the virial before them. No gas has pistons and a virial."""
    position = np.stack(np.meshgrid(np.arange(10), np.arange(6)), axis=-1).reshape(-1, 2) * 1.3 + 1.0
    rng = np.random.default_rng(1)
    state = State(position, rng.normal(size=(60, 2)), rng.normal(size=60))
    walls = [
        Wall.line((0.0, 0.2), (0.0, 1.0), temperature=1.5),
        Wall.line((0.0, 12.0), (0.0, -1.0), surface_speed=0.5),
    ]
    found = []
    for record in (["wall_sums", "ledger"], ["wall_sums", "ledger", "stress"]):
        gas = Simulation(
            equal_disks(60), Box((15.0, 30.0), (True, False)), ROUGH, state, walls=walls, gravity=(0.0, -0.1),
            record=record, seed=3,
        )  # fmt: skip
        gas.run(t_end=15.0, progress=False)
        found.append((gas.wall_sums.values, gas.wall_heats, gas.measure().dissipated))
    for bare, stressed in zip(*found, strict=True):
        assert np.any(bare)
        np.testing.assert_array_equal(stressed, bare)


# --- the tensor --------------------------------------------------------------------------------------------


def test_a_stress_is_kinetic_and_collisional_in_the_area():
    disks = Disks(2, mass=2.0, radius=0.5)
    state = State([[1.0, 1.0], [3.0, 1.0]], [[1.0, 2.0], [-1.0, 2.0]], [0.0, 0.0])
    flux = measure(disks, state, about_mean=(False, False)).momentum_flux
    np.testing.assert_allclose(flux, [[4.0, 0.0], [0.0, 16.0]], rtol=1e-15)
    np.testing.assert_allclose(measure(disks, state).momentum_flux, [[4.0, 0.0], [0.0, 0.0]], atol=1e-15)
    found = Stress(np.array([[4.0, -1.0], [-1.0, 2.0]]), np.array([[2.0, -1.0], [0.0, 2.0]]))
    assert (found.pressure, found.friction) == (5.0, 0.5)
    assert found.normal_difference == pytest.approx(0.4)  # (6 - 4) / 5


def test_a_stress_needs_two_measures_of_a_run_that_records_it():
    gas = gas_of(equal_disks(20), 0.1, ROUGH)
    with pytest.raises(InputError, match=r'record=\["stress"\]'):
        stress(gas.measure(), gas.measure(), 1.0)
    gas = gas_of(equal_disks(20), 0.1, ROUGH, record=["stress"])
    with pytest.raises(InputError, match=r"after\.time = 0: must be later"):
        stress(gas.measure(), gas.measure(), 1.0)


def test_resting_disks_have_no_stress():
    box, state = start(equal_disks(20), 0.1)
    with pytest.raises(InputError, match=r'record = "stress": cannot be combined with collapse = Rest'):
        Simulation(equal_disks(20), box, ROUGH, state, collapse=Rest(0.01), record=["stress"])


def test_the_kinetic_heat_flux_is_about_the_mean_velocity_and_that_of_the_device(device):
    """Sum of (m V^2 + I w^2) V / 2 with V = v - sum m v / sum m, by NumPy; a drift that is added changes nothing."""
    disks = mixture(60)
    box, state = start(disks, 0.3)
    state.velocity[:] += disks.mass[:, None] * [0.3, -0.2]  # not thermal: a flux that is far from 0
    V = state.velocity - disks.mass @ state.velocity / disks.mass.sum()
    energy = 0.5 * (disks.mass * np.sum(V**2, axis=1) + disks.inertia * state.spin**2)
    expected = energy @ V
    assert np.linalg.norm(expected) > 1.0
    np.testing.assert_allclose(measure(disks, state).energy_flux, expected, rtol=1e-12)
    state.velocity[:] += [5.0, 2.0]
    gas = Simulation(disks, box, ROUGH, state, device=device, histories=range(60), record=["heat_flux"])
    first = gas.measure()
    np.testing.assert_allclose(first.energy_flux, expected, rtol=1e-10)
    assert first.mean_velocity == pytest.approx(disks.mass @ state.velocity / disks.mass.sum(), rel=1e-12)


def test_a_drift_of_the_whole_gas_changes_no_heat_flux():
    """Two gases that collide alike, one of which moves: de - u.dp is the same in both."""
    disks = mixture(60)
    box, state = start(disks, 0.3)
    found = []
    for drift in ((0.0, 0.0), (3.0, -1.0)):
        moving = State(state.position, state.velocity + drift, state.spin)
        gas = Simulation(disks, box, ROUGH, moving, histories=range(60), record=["heat_flux"])
        first = gas.measure()
        gas.run(t_end=0.5)
        found.append(heat_flux(first, gas.measure(), box.area))
    assert np.abs(found[0].collisional).min() > 1e-3
    np.testing.assert_allclose(found[1].collisional, found[0].collisional, rtol=1e-6)
    np.testing.assert_allclose(found[1].total, found[0].total, rtol=1e-6)
