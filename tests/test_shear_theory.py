"""Kinetic theory of the sheared gas against closed forms and a Monte Carlo of the law."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem import theory
from ifrdem.coins import coins
from ifrdem.errors import InputError
from ifrdem.law import IFRLaw, collide
from ifrdem.shear_theory import relaxation, sheared, steady_state

COIN = coins["1 pta"].law
GAS = (1.0, 0.5, 2.0)  # mass, radius, k


def smooth(e_n: float) -> IFRLaw:
    return IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)


@pytest.mark.parametrize("e_n", [1.0, 0.9, 0.5])
def test_smooth_disks_relax_as_published(e_n: float) -> None:
    """(1 + e_n)(7 - 3 e_n)/8 of the collision rate: Grad's method in d = 2, doi:10.1103/PhysRevE.69.061303."""
    assert relaxation(0.3, smooth(e_n), 2.0) == pytest.approx((1.0 + e_n) * (7.0 - 3.0 * e_n) / 8.0, rel=1e-8)


@pytest.mark.parametrize("law", [COIN, IFRLaw(e_n=0.8, e_t=-0.7, mu=0.5, sticking="contact_point")])
def test_relaxation_is_that_of_colliding_pairs(law: IFRLaw) -> None:
    """A million pairs of a gas with m <v_x v_y> = pi T, to first order in pi, collided by the law at random angles.

    Each is weighted by its approach speed and by pi (v_1x v_1y + v_2x v_2y) m/T; of the rate nu a pair has two halves.
    """
    rng, n, theta = np.random.default_rng(5), 1_000_000, 0.4
    velocity = rng.normal(size=(n, 2, 2))
    spin = rng.normal(size=(n, 2)) * math.sqrt(theta / 0.125)  # I = m R^2 / 2
    angle = rng.uniform(0.0, 2.0 * math.pi, n)
    normal = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    approach = np.maximum(np.sum((velocity[:, 0] - velocity[:, 1]) * normal, axis=1), 0.0)
    after = collide(law, normal, np.ones(2), np.full(2, 0.5), np.full(2, 2.0), velocity, spin).velocity
    before_xy, after_xy = (np.sum(v[..., 0] * v[..., 1], axis=1) for v in (velocity, after))
    found = -0.5 * np.average((after_xy - before_xy) * before_xy, weights=approach)
    # The product scatters by some 3: 0.003 for a million pairs.
    assert relaxation(theta, law, 2.0) == pytest.approx(found, abs=0.012)


def test_a_dilute_gas_of_smooth_disks_stays_where_santos_garzo_and_dufty_say() -> None:
    """a^2 = (zeta/beta)(beta + zeta)^2 in d = 2, with a = rate / nu, beta = (1 + e)(3 + e)/8, zeta = (1 - e^2)/2."""
    e, rate, phi = 0.8, 0.3, 1e-9
    beta, zeta = (1.0 + e) * (3.0 + e) / 8.0, 0.5 * (1.0 - e * e)
    nu = rate / math.sqrt(zeta / beta) / (beta + zeta)
    T, T_rot = steady_state(smooth(e), *GAS, phi, rate) or (0.0, 0.0)
    assert theory.collision_rate(phi, T, 1.0, 0.5) == pytest.approx(nu, rel=1e-6)
    assert math.isnan(T_rot)  # nothing acts on the spins


def test_nearly_elastic_disks_are_heated_by_the_viscosity_of_enskog() -> None:
    """eta rate^2 = (1 - e_n^2) nu n T / 2 with Gass's viscosity of hard disks, J. Chem. Phys. 54, 1898 (1971)."""
    e, rate, phi = 1.0 - 1e-6, 0.3, 0.5  # dense: 1 % of the term with 8/pi is 0.5 % of eta
    chi = theory.contact_value(phi)
    T, _ = steady_state(smooth(e), *GAS, phi, rate) or (0.0, 0.0)
    dilute = 0.5 * math.sqrt(T / math.pi)
    eta = dilute * (1.0 / chi + 2.0 * phi + (1.0 + 8.0 / math.pi) * chi * phi**2)
    density = phi / (math.pi / 4.0)
    lost = 0.5 * (1.0 - e * e) * theory.collision_rate(phi, T, 1.0, 0.5) * density * T
    assert eta * rate**2 == pytest.approx(lost, rel=1e-5)  # 1 - e_n = 1e-6, and quadrature


def test_the_steady_state_is_where_temperatures_go_and_scales_with_the_square_of_the_rate() -> None:
    T, T_rot = steady_state(COIN, *GAS, 0.1, 0.4) or (0.0, 0.0)
    found = sheared(COIN, *GAS, 0.1, 0.4, 0.1 * T, 0.0, [0.0, 400.0])
    np.testing.assert_allclose((found[0][-1], found[1][-1]), (T, T_rot), rtol=1e-5)
    np.testing.assert_allclose(steady_state(COIN, *GAS, 0.1, -0.8), (4.0 * T, 4.0 * T_rot), rtol=1e-9)


def test_elastic_disks_never_stop_heating() -> None:
    assert steady_state(smooth(1.0), *GAS, 0.1, 0.4) is None
    T, _, _ = sheared(smooth(1.0), *GAS, 0.1, 0.4, 1.0, 0.0, [100.0, 200.0])
    assert T[1] > 2.0 * T[0]


def test_a_weak_flow_leaves_the_cooling_gas() -> None:
    times = np.linspace(0.0, 20.0, 5)
    one = sheared(COIN, *GAS, 0.1, 1e-6, 1.0, 0.2, times)
    for a, b in zip(one, theory.cooling(COIN, *GAS, 0.1, 1.0, 0.2, times), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-9)


def test_what_the_theory_does_not_know_is_refused() -> None:
    with pytest.raises(InputError, match=r"rho = 0\.1"):
        steady_state(IFRLaw(e_n=0.9, e_t=-1.0, mu=0.1, rho=0.1), *GAS, 0.1, 0.4)
    with pytest.raises(InputError, match="shear_rate = 0"):
        steady_state(COIN, *GAS, 0.1, 0.0)
    with pytest.raises(InputError, match="T0 = 0"):
        sheared(COIN, *GAS, 0.1, 0.4, 0.0, 0.0, [1.0])
