"""Kinetic theory of the sheared gas against closed forms and a Monte Carlo of the law."""

from __future__ import annotations

import math
import warnings
from itertools import islice

import numpy as np
import pytest
from numpy.typing import NDArray

from ifrdem import theory
from ifrdem.errors import InputError, TheoryWarning
from ifrdem.model.laws.coin_table import coins
from ifrdem.model.laws.collision import collide
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.theory.collisions import Collider, energy_changes
from ifrdem.theory.sheared_gas import collisional_changes, relaxation, sheared, steady_state
from ifrdem.validation.gas import enskog

COIN = coins["1 pta"].law
GAS = (1.0, 0.5, 2.0)  # mass, radius, k
Array = NDArray[np.float64]


def smooth(e_n: float) -> IFRLaw:
    return IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)


@pytest.mark.parametrize("e_n", [1.0, 0.9, 0.5])
def test_smooth_disks_relax_as_published(e_n: float) -> None:
    """(1 + e_n)(7 - 3 e_n)/8 of the collision rate: Grad's method in d = 2, doi:10.1103/PhysRevE.69.061303."""
    assert relaxation(0.3, smooth(e_n), 2.0) == pytest.approx((1.0 + e_n) * (7.0 - 3.0 * e_n) / 8.0, rel=1e-8)


@pytest.mark.full(keep=1)
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


def test_for_hoops_both_kinds_of_sticking_are_one_law() -> None:
    """The impulse that stops the slip is m_t |g_t| = m_n |g_t| / (1 + k) at the contact point and m_n |g_t| / 2 at the
    percussion centre: the same for k = 1. So are all averages, each of which holds the two factors by itself."""
    point, centre = (
        IFRLaw(e_n=0.8, e_t=-0.7, mu=0.3, sticking=name) for name in ("contact_point", "percussion_center")
    )

    def found(law: IFRLaw) -> list[float]:
        disk, other = Collider(1.0, 1.0, 1.0, 0.4), Collider(3.0, 1.0, 0.7, 0.2)
        rates = theory.cooling_rates(1.0, 0.4, law=law, mass=1.0, radius=0.5, k=1.0, number_density=0.1)
        values = [
            relaxation(0.4, law, 1.0),
            collisional_changes(1.3, 0.7, -0.5, -0.4, 0.6, 0.9, law, 1.0),
            energy_changes(law, disk, other),
            theory.changes_per_collision(0.4, law, 1.0),
            rates,
            theory.cooling_ratio(law, 1.0, 0.4),
        ]
        return [float(one) for value in values for one in np.ravel(value)]

    np.testing.assert_allclose(found(point), found(centre), rtol=1e-12)


def test_a_dilute_gas_of_nearly_elastic_disks_agrees_with_santos_garzo_and_dufty() -> None:
    """a^2 = (zeta/beta)(beta + zeta)^2 in d = 2, with a = rate / nu, beta = (1 + e)(3 + e)/8, zeta = (1 - e^2)/2.

    That is of first order in the anisotropy, of which the square is zeta / (beta + zeta) = (1 - e) / 2 at most.
    """
    e, rate, phi = 0.999, 0.3, 1e-9
    beta, zeta = (1.0 + e) * (3.0 + e) / 8.0, 0.5 * (1.0 - e * e)
    nu = rate / math.sqrt(zeta / beta) / (beta + zeta)
    T, T_rot = steady_state(smooth(e), *GAS, phi, rate) or (0.0, 0.0)
    assert theory.collision_rate(phi, T, 1.0, 0.5) == pytest.approx(nu, rel=5e-4)
    assert math.isnan(T_rot)  # nothing acts on the spins
    flow = theory.steady_flow(smooth(e), *GAS, phi, rate)
    assert flow is not None
    # P_xx = (beta + 2 zeta) / (beta + zeta), P_yy = beta / (beta + zeta), P_xy = -a P_yy / (beta + zeta) of n T
    assert flow.stress.normal_difference == pytest.approx(2.0 * zeta / (beta + zeta), rel=2e-3)
    assert flow.stress.temperature_ratio - 1.0 == pytest.approx(2.0 * zeta / beta, rel=2e-3)
    assert flow.stress.friction == pytest.approx(math.sqrt(zeta / beta), rel=1e-3)


@pytest.mark.parametrize("law", [COIN, IFRLaw(e_n=0.8, e_t=-0.7, mu=0.5, sticking="contact_point")])
def test_changes_of_anisotropic_gases_are_those_of_colliding_pairs(law: IFRLaw) -> None:
    """Half a million pairs of Gaussian velocities and spins, with a flow between them, collided at random angles.

    n points from the first to the second, which the flow takes g n_y faster along x; m = sigma = 1, I = 1/8.
    """
    p, turn, tau, g = np.array([[1.3, -0.5], [-0.5, 0.7]]), -0.4, 0.6, 0.9
    rng, n = np.random.default_rng(3), 500_000
    peculiar = rng.multivariate_normal([0.0, 0.0], p, size=(n, 2))
    spin = turn + math.sqrt(8.0 * tau) * rng.normal(size=(n, 2))
    angle = rng.uniform(0.0, 2.0 * math.pi, n)
    normal = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    flow = np.zeros((n, 2, 2))
    flow[:, 1, 0] = g * normal[:, 1]
    velocity = peculiar + flow
    approach = np.maximum(np.sum((velocity[:, 0] - velocity[:, 1]) * normal, axis=1), 0.0)
    after = collide(law, normal, np.ones(2), np.full(2, 0.5), np.full(2, 2.0), velocity, spin)

    def moments(v: Array, w: Array) -> Array:
        """1, V V, w, I w^2 of both disks of each pair, the mean of the two."""
        each = [np.ones_like(w), v[..., 0] ** 2, v[..., 1] ** 2, v[..., 0] * v[..., 1], w, w**2 / 8.0]
        return np.mean(each, axis=2)

    change = moments(after.velocity - flow, after.spin) - moments(peculiar, spin)
    change[0] = 1.0
    given = after.velocity[:, 0] - velocity[:, 0]  # of the first disk, at -n from the second
    transferred = -0.5 * np.einsum("ca,cb->abc", given, normal).reshape(4, n)
    change = np.concatenate((change, transferred))
    samples = approach * change
    found, error = samples.mean(axis=1), samples.std(axis=1) / math.sqrt(n)
    expected = collisional_changes(p[0, 0], p[1, 1], p[0, 1], turn, tau, g, law, 2.0)
    np.testing.assert_array_less(np.abs(found - expected), 4.0 * error)


def test_an_isotropic_gas_at_rest_cools_as_the_closed_forms_say() -> None:
    T, T_rot = 1.3, 0.6
    rate, xx, yy, xy, turn, spinning, *_ = collisional_changes(T, T, 0.0, 0.0, T_rot, 0.0, COIN, 2.0)
    translation, rotation = theory.changes_per_collision(T_rot / T, COIN, 2.0)
    assert 8.0 * 0.1 * theory.contact_value(0.1) * rate == pytest.approx(
        theory.collision_rate(0.1, T, 1.0, 0.5)
    )
    assert (0.5 * (xx + yy) / T, spinning / T) == pytest.approx(
        (rate * translation, rate * rotation), rel=1e-10
    )
    assert (xx - yy, xy, turn) == pytest.approx((0.0, 0.0, 0.0), abs=1e-14)
    tilted = collisional_changes(T, T, 1e-5, 0.0, T_rot, 0.0, COIN, 2.0)
    assert -tilted[3] / (1e-5 * rate) == pytest.approx(relaxation(T_rot / T, COIN, 2.0), rel=1e-5)


@pytest.mark.full(keep=("rough",))
@pytest.mark.parametrize(
    ("law", "theta_off"), [(smooth(0.7), None), (coins["polyester"].law, 0.06)], ids=["smooth", "rough"]
)
def test_a_dense_sheared_gas_is_that_of_enskog_s_equation(law: IFRLaw, theta_off: float | None) -> None:
    """T, and theta of rough disks, against a Monte Carlo of Enskog's equation in a uniform flow at phi = 0.5.

    A step of 0.02 mean free times is 1 % of T off; noise is some 1 %, and 2 % are what velocities that are not
    Gaussian make of T, 4 % of theta. Theory of first order is 25 % and 15 % off.
    """
    phi = 0.5
    steady = warned_steady_state(law, phi)
    T, T_rot = steady[0], 0.0 if math.isnan(steady[1]) else steady[1]
    steps, observed = round(20.0 / enskog.time_step(phi, T)), []
    for step in islice(enskog.sheared_gas(law, phi, T, T_rot, 3000, seed=1), steps // 5 + 1, steps):
        observed.append((0.5 * np.mean(np.sum(step.velocity**2, axis=1)), np.mean(step.spin**2) / 8.0))
    found, found_rot = np.mean(observed, axis=0)
    assert pytest.approx(found, rel=0.04) == T
    if theta_off is not None:
        assert T_rot / T == pytest.approx(found_rot / found, rel=theta_off)


def warned_steady_state(law: IFRLaw, phi: float) -> tuple[float, float]:
    """At a shear rate of 1."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TheoryWarning)
        found = steady_state(law, *GAS, phi, 1.0)
    assert found is not None
    return found


def test_flows_beyond_the_compared_range_give_a_warning() -> None:
    with pytest.warns(TheoryWarning, match=r"e_n = 0\.4, packing fraction 0\.2: .* e_n >= 0\."):
        steady_state(smooth(0.4), *GAS, 0.2, 1.0)
    with pytest.warns(TheoryWarning, match=r"packing fraction 0\.6"):
        sheared(smooth(0.9), *GAS, 0.6, 1.0, 1.0, 0.0, [0.1])


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


@pytest.mark.parametrize(("phi", "rate", "off"), [(0.01, 0.4, 0.08), (0.3, -0.4, 0.2)])
def test_stresses_of_the_steady_flow_are_those_of_its_balances(phi: float, rate: float, off: float) -> None:
    """Collisions lose -rate P_xy: more than in an isotropic gas, by the anisotropy, and by the flow of a dense gas over a
    diameter (13 % at phi = 0.3). Spins that are steady get nothing: P_xy = P_yx. The pressure is nearly that at rest."""
    flow = theory.steady_flow(COIN, *GAS, phi, rate)
    assert flow is not None
    stress, n, T = flow.stress, phi / (math.pi / 4.0), flow.temperature
    theta = flow.rotational_temperature / T
    lost = -np.dot((1.0, 0.5), theory.changes_per_collision(theta, COIN, 2.0)) * flow.collision_rate * n * T
    assert -rate * stress.total[0, 1] == pytest.approx(lost, rel=off)
    assert stress.collisional[0, 1] == pytest.approx(stress.collisional[1, 0], rel=1e-8)
    assert 0.5 * np.trace(stress.kinetic) == pytest.approx(n * T, rel=1e-12)
    assert stress.pressure == pytest.approx(n * T * theory.compressibility(phi), rel=0.03)


@pytest.mark.parametrize("p", [(1.3, 0.7, -0.5), (0.4, 2.0, 0.3)])
def test_what_rough_elastic_disks_get_of_the_flow_is_what_they_transfer(
    p: tuple[float, float, float],
) -> None:
    """All energy is kept (e_n = 1, beta = 1): m V V / 2 and I w^2 / 2 rise by -g times the transfer of x along y in
    collisions, to rounding of the quadrature, and spins by I dw = (transfer xy) - (transfer yx); I = 1/8."""
    law, turn, tau, g = IFRLaw(e_n=1.0, e_t=0.0, mu=1e9, sticking="contact_point"), -0.4, 0.6, 0.9
    _, xx, yy, _, turned, spinning, *transfer = collisional_changes(*p, turn, tau, g, law, 2.0)
    xy, yx = transfer[1:3]
    assert abs(xy) > 0.02
    assert 0.5 * (xx + yy) + 0.5 * spinning == pytest.approx(-g * xy, abs=1e-6)
    assert turned / 8.0 == pytest.approx(xy - yx, rel=1e-9)


@pytest.mark.full
def test_elastic_disks_never_stop_heating() -> None:
    assert steady_state(smooth(1.0), *GAS, 0.1, 0.4) is None
    T, _, _ = sheared(smooth(1.0), *GAS, 0.1, 0.4, 1.0, 0.0, [100.0, 200.0])
    assert T[1] > 2.0 * T[0]


def test_a_weak_flow_leaves_the_cooling_gas() -> None:
    times = np.linspace(0.0, 20.0, 5)
    one = sheared(COIN, *GAS, 0.1, 1e-6, 1.0, 0.2, times)
    for a, b in zip(one, theory.cooling(COIN, *GAS, 0.1, 1.0, 0.2, times), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-9)


def test_cases_beyond_the_theory_are_refused() -> None:
    with pytest.raises(InputError, match=r"rho = 0\.1"):
        steady_state(IFRLaw(e_n=0.9, e_t=-1.0, mu=0.1, rho=0.1), *GAS, 0.1, 0.4)
    with pytest.raises(InputError, match="shear_rate = 0"):
        steady_state(COIN, *GAS, 0.1, 0.0)
    with pytest.raises(InputError, match="T0 = 0"):
        sheared(COIN, *GAS, 0.1, 0.4, 0.0, 0.0, [1.0])
