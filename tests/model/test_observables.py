"""Observables of a gas, compared with sums by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State


def test_two_disks_measured_by_hand() -> None:
    disks = Disks(2, mass=[2.0, 3.0], radius=[1.0, 2.0], k=[2.0, 1.0])
    state = State(
        position=[[1.0, 1.0], [5.0, 5.0]],
        velocity=[[3.0, 4.0], [-1.0, 2.0]],
        spin=[5.0, -0.5],
        time=7.25,
        collisions=np.array([3, 3], dtype=np.int32),
    )
    result = measure(disks, state)
    assert result.time == 7.25
    assert result.collisions == 3
    # 2 * 25 / 2 + 3 * 5 / 2
    assert result.translational_energy == 32.5
    # I = 2 * 1 / 2 = 1 and 3 * 4 / 1 = 12: 1 * 25 / 2 + 12 * 0.25 / 2
    assert result.rotational_energy == 14.0
    assert result.energy == 46.5
    # (6 - 3, 8 + 6), (9 + 196) / (2 5)
    np.testing.assert_array_equal(result.momentum, [3.0, 14.0])
    assert result.drift_energy == pytest.approx(20.5, rel=1e-15)
    # About the mean velocity: the reduced mass 6/5 with the relative velocity (4, 2), 6/5 * 20 / 2 = 12. I w^2 per disk
    assert result.temperature == pytest.approx(6.0, rel=1e-15)
    assert result.rotational_temperature == 14.0
    # m V_x V_y about it, too: 6/5 * 4 * 2
    assert result.momentum_flux[0, 1] == pytest.approx(9.6, rel=1e-15)
    # Between walls: m v^2 / 2 per disk. Between floors without friction: 32.5 - 9 / 10 = 31.6.
    assert measure(disks, state, about_mean=(False, False)).temperature == 16.25
    assert measure(disks, state, about_mean=(True, False)).temperature == pytest.approx(15.8, rel=1e-15)


def test_equipartition_makes_both_temperatures_equal() -> None:
    # Every degree of freedom has variance T over its inertia: m v_x^2 = m v_y^2 = I w^2 = T = 0.7.
    n = 10
    disks = Disks(n, mass=np.linspace(1.0, 2.0, n), radius=np.linspace(0.5, 0.9, n), k=1.5)
    speed = np.sqrt(0.7 / disks.mass)
    state = State(np.zeros((n, 2)), np.column_stack((speed, -speed)), np.sqrt(0.7 / disks.inertia))
    result = measure(disks, state, about_mean=(False, False))
    assert result.temperature == pytest.approx(0.7, rel=1e-14)  # f64 round-off of ten terms
    assert result.rotational_temperature == pytest.approx(0.7, rel=1e-14)


def test_collisions_beyond_32_bits_are_counted() -> None:
    n = 4
    state = State(
        np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n), collisions=np.full(n, 2_000_000_000, dtype=np.int32)
    )
    assert measure(Disks(n, 1.0, 0.5), state).collisions == 4_000_000_000


def test_a_state_of_another_number_of_disks_is_refused() -> None:
    state = State(np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2))
    with pytest.raises(InputError, match="state has 2 disks, disks 3: must be the same number"):
        measure(Disks(3, 1.0, 0.5), state)


@pytest.mark.parametrize("about_mean", [(True, True), (True, False), (False, True), (False, False)])
def test_the_kinetic_stress_is_about_the_mean_of_each_free_direction(about_mean: tuple[bool, bool]) -> None:
    """Sum m v_x v_y with the mean velocity taken off along free directions only, by NumPy."""
    chance = np.random.default_rng(4)
    mass, v = chance.uniform(1.0, 3.0, 30), chance.normal(size=(30, 2)) + np.array([5.0, 2.0])
    relative = v - np.where(about_mean, mass @ v / mass.sum(), 0.0)
    state = State(np.zeros((30, 2)), v, np.zeros(30))
    found = measure(Disks(30, mass, 0.5), state, about_mean=about_mean)
    assert found.momentum_flux[0, 1] == pytest.approx(
        np.sum(mass * relative[:, 0] * relative[:, 1]), rel=1e-12
    )
