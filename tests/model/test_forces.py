"""Forces between collisions: order of accuracy, conserved quantities, energy put in, devices."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from support.force_examples import SMOOTH, Magnus, Push, Trap, one_disk, still
from support.gases import gas_of, mixture

from ifrdem.model.box import Box
from ifrdem.model.forces import Drag, Force, Langevin, RandomKicks, Rescale, SpinKicks
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.simulation.simulation import Simulation

IDLE = (
    Langevin(1e6, temperature=1.0, rate=1.0), RandomKicks(1e6, power=1.0), Drag(1e6, rate=1.0),
    SpinKicks(1e6, power=1.0), SpinKicks(1e6, power=1.0),
)  # fmt: skip


def among_all(*given: Force) -> list[Force]:
    """Forces among those of gases of this file, in the order of `IDLE`, the others of which never act.

    Kernels are compiled for a list of forces: with the same one, once for all gases of two kinds of disks.
    """
    left = list(given)
    found = [left.pop(0) if left and type(left[0]) is type(force) else force for force in IDLE]
    assert not left
    return found


def slope(error: Sequence[float]) -> float:
    """Order of convergence from the errors at steps that each are half the one before."""
    return math.log2(error[0] / error[-1]) / (len(error) - 1)


# --- accuracy ----------------------------------------------------------------------------------------------


def test_drag_is_exact_in_velocity_and_of_second_order_in_position() -> None:
    """dv/dt = -v / 2: v exp(-t / 2), and the way 2 v (1 - exp(-t / 2))."""
    errors = []
    for step in (0.25, 0.125, 0.0625):
        end = one_disk([Drag(step, rate=0.5, spin_rate=0.2)], 2.0)
        np.testing.assert_allclose(end.velocity[0], np.array([1.0, 0.5]) * math.exp(-1.0), rtol=1e-13)
        assert end.spin[0] == pytest.approx(2.0 * math.exp(-0.4), rel=1e-13)
        errors.append(abs(end.position[0, 0] - 20.0 - 2.0 * (1.0 - math.exp(-1.0))))
    assert 1.9 < slope(errors) < 2.1


@pytest.mark.parametrize("rate", [0.0, 0.3])
def test_quadratic_drag_is_exact_in_velocity(rate: float) -> None:
    """ds/dt = -rate s - 0.7 s^2: with u = 1/s, du/dt = rate u + 0.7, a linear equation."""
    end = one_disk([Drag(0.1, rate=rate, quadratic=0.7)], 3.0)
    u = 1.0 / math.hypot(1.0, 0.5)
    u = u + 0.7 * 3.0 if rate == 0.0 else (u + 0.7 / rate) * math.exp(3.0 * rate) - 0.7 / rate
    np.testing.assert_allclose(end.velocity[0] * math.hypot(1.0, 0.5), np.array([1.0, 0.5]) / u, rtol=1e-13)


def test_a_custom_force_that_depends_on_velocity_is_of_second_order() -> None:
    """The velocity turns at the rate c w = 0.6: a circle of radius |v| / 0.6."""
    errors = []
    for step in (0.25, 0.125, 0.0625):
        end = one_disk([Magnus(step, c=0.3)], 4.0)
        way = (1.0 + 0.5j) * (np.exp(2.4j) - 1.0) / 0.6j
        errors.append(float(np.hypot(*(end.position[0] - 20.0 - [way.real, way.imag]))))
    assert 1.9 < slope(errors) < 2.1


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (0.32, -0.64)])
def test_a_force_that_depends_on_place_is_of_second_order(gravity: tuple[float, float]) -> None:
    """A harmonic oscillator of frequency 0.8 about (19, 20.5), from (20, 20) with velocity (1, 0.5).

    Gravity moves its middle by g / 0.64. Within a window the place includes the fall since it began.
    """
    errors, middle = [], [19.0 + gravity[0] / 0.64, 20.5 + gravity[1] / 0.64]
    for step in (0.25, 0.125, 0.0625):
        end = one_disk([Trap(step, stiffness=0.64, x=19.0, y=20.5, frequency=0.0)], 3.0, gravity=gravity)
        c, s = math.cos(2.4), math.sin(2.4)
        exact = [
            middle[0] + (20.0 - middle[0]) * c + 1.0 / 0.8 * s,
            middle[1] + (20.0 - middle[1]) * c + 0.5 / 0.8 * s,
        ]
        errors.append(float(np.hypot(*(end.position[0] - exact))))
    assert 1.9 < slope(errors) < 2.1


def test_a_force_gets_the_time() -> None:
    """Far from the middle, dv = -pull D cos(w t) dt with D = 1e6: the sum over midpoints, steps 0.1 from t = 3.7 on."""
    force = Trap(0.1, stiffness=1e-6, x=20.0 - 1e6, y=20.0, frequency=1.5)
    end = one_disk([force], 5.0, time=3.7)
    expected = 1.0 - 0.1 * sum(math.cos(1.5 * (k + 0.5) * 0.1) for k in range(37, 50))
    assert end.velocity[0, 0] == pytest.approx(expected, abs=1e-5)  # the disk moves a little


def test_forces_that_do_not_commute_are_of_second_order_together() -> None:
    """dv/dt = 1 - v: v = 1 + (v_0 - 1) exp(-t). In one fixed order of push and drag, the slope would be 1.

    Steps of 1 and 3 coincide at every third of the first, whose order alternates too.
    """
    for ratio in (1, 3):
        errors = []
        for step in (0.25, 0.125, 0.0625):
            end = one_disk([Push(step, acceleration=1.0), Drag(step / ratio, rate=1.0)], 3.0)
            # v_x starts at 1, where it would stay; v_y at 0.5 has no push.
            errors.append(abs(end.velocity[0, 0] - 1.0))
            assert end.velocity[0, 1] == pytest.approx(0.5 * math.exp(-3.0), rel=1e-12)
        assert 1.9 < slope(errors) < 2.1


def test_a_run_in_parts_is_the_run_as_a_whole() -> None:
    """Forces act at times counted from 0: neither the frames of a run nor a restart shifts them."""
    forces = [Langevin(0.3, temperature=2.0, rate=0.7, spin_rate=0.4), Push(0.1, acceleration=1.0)]
    whole = one_disk(forces, 6.0)
    disks = Disks(1, mass=2.0, radius=0.5)
    state = State(np.array([[20.0, 20.0]]), np.array([[1.0, 0.5]]), np.array([2.0]))
    for end in (0.15, 0.3, 1.0, 1.0499999, 1.05, 2.7, 6.0):  # at 0.15, 1.05 and 2.7 (rounded up), forces act
        simulation = Simulation(disks, Box((40.0, 40.0)), SMOOTH, state, forces=forces)
        simulation.run(t_end=end)
        state = simulation.state
    np.testing.assert_array_equal(state.velocity, whole.velocity)
    np.testing.assert_array_equal(state.spin, whole.spin)
    np.testing.assert_allclose(state.position, whole.position, rtol=1e-13)


# --- heat baths and kicks -----------------------------------------------------------------------------------


def test_velocities_of_free_disks_in_a_bath_forget_exponentially() -> None:
    """Ornstein-Uhlenbeck: <v(t)> = v_0 exp(-rate t), variance (T/m) (1 - exp(-2 rate t)); the autocorrelation follows.

    4000 free disks; tolerances are five standard errors. Spins likewise, with their own bath.
    """
    n = 4000
    disks, box, state = still(n, mass=2.0, speed=1.5, kinds=2)
    bath = Langevin(0.2, temperature=3.0, rate=0.5, spin_temperature=5e-7, spin_rate=0.25)
    simulation = Simulation(disks, box, SMOOTH, state, forces=among_all(bath), seed=11)
    inertia = 2.0 * 1e-6 / 2.0
    velocities: list[NDArray[np.float64]] = []
    spins: list[NDArray[np.float64]] = []
    simulation.run(
        t_end=8.0,
        frames=4,
        frame_callbacks=[lambda s, _: (velocities.append(s.velocity), spins.append(s.spin))],
    )  # type: ignore[func-returns-value]
    for t, v, w in zip((2.0, 4.0, 6.0, 8.0), velocities[1:], spins[1:], strict=True):
        variance = 1.5 * (1.0 - math.exp(-t))
        error = 5.0 * math.sqrt(variance / n)
        np.testing.assert_allclose(v.mean(axis=0), [1.5 * math.exp(-0.5 * t), 0.0], atol=error)
        np.testing.assert_allclose(v.var(axis=0), variance, rtol=5.0 * math.sqrt(2.0 / n))
        turning = 5e-7 / inertia * (1.0 - math.exp(-0.5 * t))
        assert w.var() == pytest.approx(turning, rel=5.0 * math.sqrt(2.0 / n))
        noise = np.corrcoef((*v.T, w))  # of independent numbers
        np.testing.assert_allclose(noise, np.eye(3), atol=5.0 / math.sqrt(n))
    later = np.cov(velocities[3][:, 1], velocities[4][:, 1])
    # <v(t) v(t + 2)> = variance(t) exp(-1)
    expected = 1.5 * (1.0 - math.exp(-6.0)) * math.exp(-1.0)
    assert later[0, 1] == pytest.approx(expected, abs=5.0 * 1.5 / math.sqrt(n))


@pytest.mark.full
def test_an_elastic_gas_in_a_bath_reaches_its_temperature() -> None:
    """Equilibrium at T whatever the step: 2000 disks that collide, energies of 20 frames two relaxation times apart.

    The mean of 20 x 4000 squared Gaussian components scatters by sqrt(2 / 80000) = 0.5 %; five of these are allowed.
    """
    disks = mixture(2000)
    bath = Langevin(0.5, temperature=2.5, rate=1.0, spin_temperature=0.5, spin_rate=1.0)
    simulation = gas_of(disks, 0.2, SMOOTH, forces=among_all(bath), seed=3)
    simulation.run(t_end=5.0)
    found: list[tuple[float, float]] = []
    simulation.run(
        t_end=45.0,
        frames=20,
        frame_callbacks=[lambda _, m: found.append((m.temperature, m.rotational_temperature))],
    )
    assert simulation.collisions > 20 * disks.n
    mean = np.mean(found, axis=0)
    assert mean[0] == pytest.approx(2.5, rel=0.025)
    assert mean[1] == pytest.approx(0.5, rel=0.035)  # one component instead of two: sqrt(2) more


@pytest.mark.full
@pytest.mark.parametrize("strength", [{"power": 0.6}, {"diffusion": 0.3}])
def test_kicks_keep_the_momentum_and_put_in_the_power_that_was_set(strength: dict[str, float]) -> None:
    """400 kicks of 1000 disks in pairs of masses 0.5 and 1.5, or of equal masses, 2 m D = 0.6.

    A disk that was kicked has an energy of exponential distribution, so that their mean scatters by 1/sqrt(N) = 3.2 %;
    five of these are allowed, after all kicks and after the first.
    """
    n = 1000
    mass = np.where(np.arange(n) % 2 == 0, 0.5, 1.5) if "power" in strength else 1.0
    disks, box, state = still(n, mass=mass)
    energies: list[float] = []
    momenta: list[NDArray[np.float64]] = []
    simulation = Simulation(disks, box, SMOOTH, state, forces=[RandomKicks(0.01, **strength)], seed=5)
    simulation.run(
        t_end=4.0,
        frames=400,
        frame_callbacks=[lambda _, m: (energies.append(m.energy), momenta.append(m.momentum))],  # type: ignore[func-returns-value]
    )
    scale = float(np.sum(disks.mass) * math.sqrt(2.0 * 0.6 * 4.0))
    np.testing.assert_allclose(np.array(momenta) / scale, 0.0, atol=1e-14)
    assert energies[-1] / n == pytest.approx(0.6 * 4.0, rel=5.0 / math.sqrt(n))
    assert energies[1] / n == pytest.approx(0.6 * 0.01, rel=5.0 / math.sqrt(n))


def test_kicks_of_few_disks_put_in_the_power_too() -> None:
    """Without the factor N/(N-1), three disks would get two thirds. A strong drag brings them to rest.

    At the same times it acts after a kick and before one by turns, so that kicks come in pairs after the first. The
    energy of a pair has 4 degrees of freedom: it scatters by sqrt(2 / 4), the mean of 200 by 5 %.
    """
    disks, box, state = still(3, kinds=2)
    forces = among_all(RandomKicks(1.0, power=0.6), Drag(1.0, rate=1e4))
    simulation = Simulation(disks, box, SMOOTH, state, forces=forces, seed=1)
    simulation.run(t_end=399.0)
    assert simulation.energy_inputs[1] == pytest.approx(399 * 3 * 0.6, rel=0.18)
    assert simulation.energy_inputs[2] == pytest.approx(-simulation.energy_inputs[1], rel=1e-12)


@pytest.mark.parametrize("speed", [0.0, 1.5])
def test_spin_kicks_put_in_the_power_that_was_set(speed: float) -> None:
    """Two forces at the same times, whose numbers are independent: with the same ones they would give twice as much.

    They act between windows where no disk moves, else within.
    """
    disks, box, state = still(2000, speed=speed, kinds=2)
    inertia = 1e-6 / 2.0
    forces = among_all(SpinKicks(0.1, power=3e-7), SpinKicks(0.1, diffusion=3e-7 / inertia))
    simulation = Simulation(disks, box, SMOOTH, state, forces=forces, seed=2)
    simulation.run(t_end=10.0)
    # I w^2 / 2 of 2000 Gaussians scatters by sqrt(2 / 2000) = 3.2 %. Of one of two, steps add w dw + dw^2 / 2
    # with the w of both: its variance for a disk is 4 E^2, where its mean is E.
    assert simulation.energy_input / disks.n == pytest.approx(6e-6, rel=0.16)
    np.testing.assert_allclose(simulation.energy_inputs[3:] / disks.n, 3e-6, rtol=5.0 * 2.0 / math.sqrt(2000))
    assert measure(disks, simulation.state).rotational_energy == pytest.approx(
        simulation.energy_input, rel=1e-12
    )


def test_rescaling_keeps_temperature_or_energy_to_rounding() -> None:
    disks = mixture(2000)
    law = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
    for force in (Rescale(0.1, temperature=1.7), Rescale(0.1, energy=1.7)):
        simulation = gas_of(disks, 0.3, law, forces=[force])
        for k in range(4):
            simulation.run(t_end=(k + 0.5) * 0.1)  # right after the force
            found = measure(disks, simulation.state)
            energy = found.translational_energy if force.with_spins == 0.0 else found.energy
            assert energy / disks.n == pytest.approx(1.7, rel=1e-14)
        assert simulation.collisions > 100


def test_the_hottest_of_a_thermostat_is_the_largest_temperature_that_it_sets() -> None:
    """By it `check` and the engine judge magnitudes before a run: that of spins counts, too."""
    for T, T_spin in ((1.0, 3.0), (3.0, 1.0)):
        bath = Langevin(0.1, temperature=T, rate=0.1, spin_temperature=T_spin, spin_rate=0.1)
        assert bath.hottest == 3.0
    assert Rescale(0.1, energy=2.0).hottest == 2.0
    assert Drag(0.1, rate=0.1).hottest == 0.0
