"""Kinetic theory of the driven gas against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem import theory
from ifrdem.errors import InputError
from ifrdem.model.laws.coin_table import coins
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.theory.collisions import collision_rate
from ifrdem.theory.driven_gas import Driving, driven, steady_state

COIN = coins["1 pta"].law
GAS = (1.0, 0.5, 2.0, 0.2)  # mass, radius, k, packing fraction


def test_smooth_disks_stay_where_kicks_balance_haff_s_losses() -> None:
    """Each collision takes (1 - e_n^2) T / 2 of a disk: power = (1 - e_n^2) nu_1 T^(3/2) / 2."""
    rate = theory.collision_rate(0.2, 1.0, 1.0, 0.5)
    T, T_rot = steady_state(IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0), *GAS, Driving(power=0.7)) or (0.0, 0.0)
    expected = (0.7 / (0.5 * rate * (1.0 - 0.81))) ** (2.0 / 3.0)
    np.testing.assert_allclose(T, expected, rtol=1e-10)
    assert math.isnan(T_rot)  # nothing acts on the spins


def test_elastic_disks_take_the_temperature_of_their_bath() -> None:
    bath = {"kind": "langevin", "temperature": 2.0, "rate": 0.3, "spin_rate": 0.1}
    driving = Driving.of([bath], 1.0, 0.125)
    assert driving is not None
    # mu = 0, e_t = -1: translation and rotation are on their own, both at 2.
    state = steady_state(IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), *GAS, driving)
    np.testing.assert_allclose(state, (2.0, 2.0), rtol=1e-10)


def test_the_ratio_of_driven_coins_does_not_depend_on_power_and_density() -> None:
    """T_rot has no other source or sink than collisions, whose rate drops out: only the law sets theta."""
    states = [
        steady_state(COIN, 1.0, 0.5, 2.0, phi, Driving(power=power)) or (math.nan, math.nan)
        for phi, power in ((0.2, 1.0), (0.2, 8.0), (0.05, 1.0))
    ]
    theta = [T_rot / T for T, T_rot in states]
    np.testing.assert_allclose(theta, theta[0], rtol=1e-9)
    assert states[1][0] == pytest.approx(4.0 * states[0][0], rel=1e-9)  # 8^(2/3)
    # The rate of rotational cooling vanishes there, by the formula for undriven gases.
    T, T_rot = states[0]
    rates = theory.cooling_rates(
        T, T_rot, law=COIN, mass=1.0, radius=0.5, k=2.0, number_density=0.2 / (math.pi * 0.25)
    )
    np.testing.assert_allclose(rates, (-1.0, 0.0), atol=1e-9)


@pytest.mark.parametrize("driving", [Driving(power=0.5), Driving(power=0.2, spin_power=0.5)])
def test_a_driven_gas_stays_steady_for_any_time(driving: Driving) -> None:
    """Without beginning to drift: from then on its collisions are the rate of the steady state times time."""
    steady = steady_state(COIN, *GAS, driving)
    assert steady is not None
    times = [1e6, 1e12, 1e30, 1e50]
    T, T_rot, collisions = driven(COIN, *GAS, driving, 0.0, 0.0, times)
    np.testing.assert_allclose(T, steady[0], rtol=1e-8)
    np.testing.assert_allclose(T_rot, steady[1], rtol=1e-8)
    mass, radius, _, phi = GAS
    np.testing.assert_allclose(
        collisions, collision_rate(phi, steady[0], mass, radius) * np.array(times), rtol=1e-5
    )


def test_without_forces_the_driven_gas_is_the_cooling_one() -> None:
    times = np.linspace(0.0, 20.0, 9)
    one = driven(COIN, *GAS, Driving(), 1.0, 0.2, times)
    other = theory.cooling(COIN, *GAS, 1.0, 0.2, times)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9)


def test_a_gas_from_rest_is_heated_by_the_power_and_ends_in_its_steady_state() -> None:
    driving = Driving(power=1.0, spin_power=0.2)
    T, T_rot, collisions = driven(COIN, *GAS, driving, 0.0, 0.0, [0.0, 1e-3, 100.0])
    np.testing.assert_allclose([T[1], T_rot[1]], [1e-3, 4e-4], rtol=1e-3)  # T is the energy, T_rot twice it
    np.testing.assert_allclose([T[2], T_rot[2]], steady_state(COIN, *GAS, driving), rtol=1e-6)
    assert collisions[0] == 0.0
    assert collisions[2] > 100.0


@pytest.mark.parametrize(
    ("law", "driving"),
    [
        (COIN, Driving(rate=1.0)),  # only losses
        (IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), Driving(power=1.0)),  # only gains
    ],
)
def test_a_gas_without_balance_has_no_steady_state(law: IFRLaw, driving: Driving) -> None:
    assert steady_state(law, *GAS, driving) is None


def test_forces_add_up_to_one_drive() -> None:
    """mass 2, inertia 3: a diffusion D is a power 2 m D, for spins I D; a bath is friction and 2 rate T."""
    forces = [
        {"kind": "random_kicks", "power": 1.0},
        {"kind": "random_kicks", "power": None, "diffusion": 0.5},
        {"kind": "spin_kicks", "diffusion": 0.1},
        {"kind": "drag", "rate": 0.2, "spin_rate": 0.3, "quadratic": 0.0},
        {"kind": "langevin", "temperature": 5.0, "rate": 0.1, "spin_temperature": 4.0, "spin_rate": 0.01},
    ]
    driving = Driving.of(forces, 2.0, 3.0)
    assert driving is not None
    found = (driving.power, driving.spin_power, driving.rate, driving.spin_rate)
    np.testing.assert_allclose(found, (1.0 + 2.0 + 1.0, 0.3 + 0.04, 0.3, 0.31))
    for other in ({"kind": "drag", "quadratic": 0.1}, {"kind": "rescale", "temperature": 1.0}):
        assert Driving.of([*forces, other], 2.0, 3.0) is None


def test_impossible_input_is_refused() -> None:
    with pytest.raises(InputError, match="nothing moves"):
        driven(COIN, *GAS, Driving(spin_power=1.0), 0.0, 0.0, [1.0])
    with pytest.raises(InputError, match="times"):
        driven(COIN, *GAS, Driving(), 1.0, 0.0, [2.0, 1.0])
    with pytest.raises(InputError, match="T0 = -1"):
        driven(COIN, *GAS, Driving(), -1.0, 0.0, [1.0])


def test_the_initial_temperatures_are_returned_at_time_0_from_rest_too() -> None:
    """No time has passed: an integration over no time must not search for a step."""
    for T0 in (0.0, 0.5):
        T, T_rot, collisions = driven(COIN, *GAS, Driving(power=0.1), T0, 0.25, [0.0, 0.0])
        assert T.tolist() == [T0, T0]
        assert T_rot.tolist() == [0.25, 0.25]
        assert not collisions.any()
