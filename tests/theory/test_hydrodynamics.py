"""Viscosity, conductivity and the lengths of a cooling gas against Enskog's numbers and a linear system of modes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.model.laws.coin_table import coins
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.theory import changes_per_collision, collision_rate, cooling, cooling_rates, cooling_ratio
from ifrdem.theory.contact import compressibility, contact_value
from ifrdem.theory.hydrodynamics import (
    clustering_length,
    excess,
    self_diffusion,
    shear_length,
    shear_mode_energy,
    shear_mode_time,
    shear_viscosity,
    thermal_conductivity,
    waves,
)

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
SMOOTH = IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)


@pytest.mark.parametrize("phi", [1e-9, 0.1, 0.4, 0.6])
def test_elastic_transport_coefficients_are_enskog_s_to_rounding(phi: float) -> None:
    """Enskog's theory of disks, D. M. Gass, J. Chem. Phys. 54, 1898 (1971), in the first Sonine approximation.

    With bn = pi n sigma^2 / 2 = 2 phi, eta_0 = sqrt(m T / pi) / (2 sigma) and kappa_0 = 4 eta_0 / m,

        eta = eta_0 [1/g + bn + (1/4 + 2/pi) g bn^2],  kappa = kappa_0 [1/g + (3/2) bn + (9/16 + 1/pi) g bn^2].

    *Kinetic part.* What is passed on at contact raises the drive by a factor 1 + phi g for momentum, 1 + (3/2) phi g
    for energy, and the flux of a distorted gas by the same factor: (1 + phi g)^2 / g = 1/g + bn + g bn^2 / 4, and
    (1 + (3/2) phi g)^2 / g = 1/g + (3/2) bn + (9/16) g bn^2.

    *Contact part*, without distortion. Collisions per area, time and angle: n^2 g sigma / 2 times the mean of the
    approach G, <G> = sqrt(T / (pi m)). Each passes on m G n over sigma n. In a shear u_x = a y, G is larger by
    -a sigma n_x n_y, so that p_xy = -(n^2 g sigma / 2) sigma m 2 <G> a sigma (pi/4), pi/4 being the integral of
    (n_x n_y)^2: eta has (pi/4) n^2 g sigma^3 sqrt(m T / pi) = eta_0 (2/pi) g bn^2. Of energy m G (v_i + v_j) n / 2 is
    passed on; given G, its mean is m G^2 (T_i - T_j) / (4 T), with T_j - T_i = sigma n_x dT/dx. By <G^3> = 4 (T/m) <G>
    and pi, the integral of n_x^2, kappa has (pi/2) n^2 g sigma^3 <G> = kappa_0 (1/pi) g bn^2.
    """
    g, m, T, R = contact_value(phi), 1.7, 2.3, 0.4
    eta_0, bn = math.sqrt(m * T / math.pi) / (4.0 * R), 2.0 * phi
    eta = eta_0 * (1 / g + bn + (1 / 4 + 2 / math.pi) * g * bn**2)
    assert shear_viscosity(phi, T, m, R) == pytest.approx(eta, rel=1e-12)
    kappa = 4.0 * eta_0 / m * (1 / g + 1.5 * bn + (9 / 16 + 1 / math.pi) * g * bn**2)
    assert thermal_conductivity(phi, T, m, R) == pytest.approx(kappa, rel=1e-12)


@pytest.mark.parametrize("phi", [1e-9, 0.1, 0.4, 0.6])
def test_elastic_transport_coefficients_are_near_those_of_higher_approximations(phi: float) -> None:
    """Gass (1971): eta = 1.022 eta_0 [1/g + b n + 0.8729 g (b n)^2], kappa = 1.029 kappa_0 [1/g + ... 0.8718 ...].

    b n = 2 phi; 1.022 and 1.029 are what higher Sonine approximations add to the first, which is here.
    """
    g, m, T, R = contact_value(phi), 1.7, 2.3, 0.4
    eta_0 = math.sqrt(m * T / math.pi) / (4.0 * R)
    eta = shear_viscosity(phi, T, m, R)
    assert eta == pytest.approx(eta_0 * (1 / g + 2 * phi + 0.8729 * 1.022 * g * (2 * phi) ** 2), rel=0.01)
    kappa_0 = math.sqrt(T / (math.pi * m)) / R
    kappa = thermal_conductivity(phi, T, m, R)
    assert kappa == pytest.approx(kappa_0 * (1 / g + 3 * phi + 0.8718 * 1.029 * g * (2 * phi) ** 2), rel=0.02)
    if phi < 1e-6:  # Eucken's factor in two dimensions
        assert kappa * m / eta == pytest.approx(4.0, rel=1e-6)


def test_viscosity_of_a_dilute_cooling_gas_is_that_of_kinetic_theory() -> None:
    """eta = n T / (l nu - zeta / 2) of smooth disks.

    l nu / nu_0 and zeta / nu_0 in two dimensions from J. J. Brey, J. W. Dufty, C. S. Kim and A. Santos, Phys. Rev. E
    58, 4638 (1998), without a_2: (3/4) (1 - e + (2/3) d) (1 + e) / d and (1 - e^2) / d * (d + 2) / 4 with
    nu_0 = n T / eta_0 = nu of a disk.
    """
    e, d = 0.8, 2
    law = IFRLaw(e_n=e, e_t=-1.0, mu=0.0)
    eta_0 = shear_viscosity(1e-9, 1.0, 1.0, 0.5)
    ell = 0.75 * (1.0 - e + 2.0 / 3.0 * d) * (1.0 + e) / d
    zeta = (d + 2) / (4.0 * d) * (1.0 - e**2)
    assert shear_viscosity(1e-9, 1.0, 1.0, 0.5, law=law) / eta_0 == pytest.approx(
        1.0 / (ell - 0.5 * zeta), rel=1e-6
    )


@pytest.mark.parametrize("e_n", [0.5, 0.8, 1.0])
def test_self_diffusion_is_that_of_tagged_disks_in_a_cooling_gas(e_n: float) -> None:
    """D = (T / m) / (a - zeta / 2): tagged disks forget their velocity at the rate a, and the unit sqrt(T) falls.

    In a collision a disk's velocity changes by -(1 + e) / 2 g_n n, and given g_n its own component along n is g_n / 2
    on average: a / nu = <v dv> / <v^2> = (1 + e) / 4 <g_n^2> / (2 T / m), with <g_n^2> = 4 T / m of colliding pairs.
    zeta is that of the theory of cooling. e_n = 0.8: V. Garzo and A. Santos (2003), doi:10.1017/CBO9780511812903, and
    J. J. Brey et al. (2000), doi:10.1063/1.870342, in two dimensions: D / D_elastic = 2 / [(1 + e) - (1 - e^2) / 2].
    """
    z, _ = changes_per_collision(0.0, IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0), 2.0)
    assert self_diffusion(e_n) == pytest.approx(1.0 / (0.5 * (1.0 + e_n) + 0.5 * float(z)), rel=1e-12)
    if e_n == 0.8:
        assert self_diffusion(e_n) == pytest.approx(2.0 / (1.8 - 0.18), rel=1e-12)


@pytest.mark.parametrize("law", [SMOOTH, COIN])
def test_a_wave_of_the_shear_length_decays_just_as_fast_as_thermal_velocities(law: IFRLaw) -> None:
    phi, R, m, T = 0.3, 0.5, 2.0, 0.7
    theta = cooling_ratio(law, 2.0, 0.0)
    n = phi / (math.pi * R**2)
    length = shear_length(law, R, phi, theta=theta)
    wave = shear_viscosity(phi, T, m, R, law=law, theta=theta) / (n * m) * (2.0 * math.pi / length) ** 2
    T_rate, T_rot_rate = cooling_rates(T, theta * T, law=law, mass=m, radius=R, k=2.0, number_density=n)
    assert wave == pytest.approx(-0.5 * float(T_rate) / T, rel=1e-9)
    if law is COIN:  # and T_rot / T stays
        assert float(T_rot_rate) / theta == pytest.approx(float(T_rate), rel=1e-8)


def test_lengths_scale_with_the_disks_and_diverge_where_nothing_is_lost() -> None:
    assert shear_length(SMOOTH, 5.0, 0.2) == pytest.approx(10.0 * shear_length(SMOOTH, 0.5, 0.2), rel=1e-12)
    assert shear_length(IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), 0.5, 0.2) == math.inf
    assert clustering_length(1.0, 0.5, 0.2) == math.inf
    for e in (0.99, 0.999):  # xi goes with 1 / sqrt(1 - e^2)
        law = IFRLaw(e_n=e, e_t=-1.0, mu=0.0)
        assert shear_length(law, 0.5, 0.2) * math.sqrt(1.0 - e**2) == pytest.approx(
            shear_length(SMOOTH, 0.5, 0.2) * math.sqrt(0.19), rel=0.04
        )
        assert clustering_length(e, 0.5, 0.2) > shear_length(law, 0.5, 0.2)


def test_the_heat_mode_of_the_clustering_length_neither_grows_nor_decays() -> None:
    """Linear equations of density r, velocity w along the wave, and temperature q, in units of n, sqrt(T), T:

    dr/dt = -i k w,  dw/dt = (z/2) w - i k (p_n r + p_T q) / m - nu_l k^2 w,
    dq/dt = -z [a r + q/2] - i k P w - D k^2 q,  P = p / (n T) = Z, p_n = T d(nZ)/dn, p_T = Z.
    """
    phi, R, e = 0.25, 0.5, 0.95
    n, nu = phi / (math.pi * R**2), collision_rate(phi, 1.0, 1.0, R)
    h = 1e-5
    Z = compressibility(phi)
    dZ = (compressibility(phi + h) - compressibility(phi - h)) / (2 * h)
    dg = (contact_value(phi + h) - contact_value(phi - h)) / (2 * h)
    z = 0.5 * (1 - e**2) * nu
    p_n, a = Z + phi * dZ, 1.0 + phi * dg / contact_value(phi)
    D, nu_l = thermal_conductivity(phi, 1.0, 1.0, R) / n, 2.0 * shear_viscosity(phi, 1.0, 1.0, R) / n

    def growth(length: float) -> float:
        k = 2.0 * math.pi / length
        matrix = np.array([
            [0.0, -1j * k, 0.0],
            [-1j * k * p_n, 0.5 * z - nu_l * k**2, -1j * k * Z],
            [-z * a, -1j * k * Z, -0.5 * z - D * k**2],
        ])  # fmt: skip
        values = np.linalg.eigvals(matrix)
        return float(values[np.argmin(np.abs(values.imag))].real)  # not the sound modes

    critical = clustering_length(e, R, phi)
    assert growth(critical) == pytest.approx(0.0, abs=1e-7 * z)
    assert growth(1.05 * critical) > 0.0 > growth(0.95 * critical)


def test_energy_of_shear_modes_solves_its_equation() -> None:
    """dS/dtau = z (1 - q) S + z q from S = 1, q = k^2 xi^2, summed over the waves of the box, by small steps."""
    R, phi, box = 0.5, 0.2, (90.0, 70.0)
    z = 0.5 * 0.19
    length = shear_length(SMOOTH, R, phi)
    number = phi * box[0] * box[1] / (math.pi * R**2)
    total, tau, steps = 0.0, 40.0, 20_000
    for i in range(-9, 10):
        for j in range(-9, 10):
            q = (i * length / box[0]) ** 2 + (j * length / box[1]) ** 2
            if 0.0 < q < 1.0:
                S = 1.0
                for _ in range(steps):
                    middle = S + 0.5 * tau / steps * z * ((1.0 - q) * S + q)
                    S += tau / steps * z * ((1.0 - q) * middle + q)
                total += S - 1.0
    expected = total / (2.0 * number)
    assert shear_mode_energy(tau, SMOOTH, R, phi, box) == pytest.approx(expected, rel=1e-5)
    found = shear_mode_time(SMOOTH, 1.0, R, phi, box, 1.0, share=expected)
    assert found.collisions_per_disk == pytest.approx(tau, rel=1e-5)
    # Haff: tau = (2 / z) ln(1 + t z nu_0 / 2), t_H = 4 / ((1 - e^2) nu_0) = 2 / (z nu_0)
    t_H = 4.0 / (0.19 * collision_rate(phi, 1.0, 1.0, R))
    assert found.time == pytest.approx(t_H * math.expm1(0.5 * z * tau), rel=1e-5)


def test_waves_of_a_box_are_counted_each_once() -> None:
    """In a box of 2 by 1, k / 2 pi = (i / 2, j): below 1.05, (+-1/2, 0), (+-1, 0) and (0, +-1)."""
    found = sorted(waves((2.0, 1.0), 2.0 * math.pi * 1.05))
    assert found == pytest.approx([0.25, 0.25, 1.0, 1.0, 1.0, 1.0])


def test_a_wave_that_keeps_up_with_thermal_velocities_grows_by_noise_alone() -> None:
    """dS/dx = (1 - q) S + q: for q = 1 S = 1 + x; for q > 1 it ends at q / (q - 1)."""
    assert excess(3.0, np.array([0.0])).item() == pytest.approx(3.0)
    assert excess(3.0, np.array([1e-8])).item() == pytest.approx(3.0, rel=1e-6)
    assert excess(1e3, np.array([-0.5])).item() == pytest.approx(1.5 / 0.5 - 1.0)


def test_the_asymptotic_shear_length_is_that_of_the_ratio_that_cooling_reaches() -> None:
    """`theory.cooling` from spins at rest: after 1e8 units of time the ratio does not change any more."""
    T, T_rot, _ = cooling(COIN, 1.0, 0.5, 2.0, 0.2, 1.0, 0.0, [1e8])
    length = shear_length(COIN, 0.5, 0.2, theta=float(T_rot[0] / T[0]))
    assert shear_length(COIN, 0.5, 0.2, theta="asymptotic") == pytest.approx(length, rel=1e-5)
    assert shear_length(SMOOTH, 0.5, 0.2, theta="asymptotic") == shear_length(SMOOTH, 0.5, 0.2)
    with pytest.raises(
        InputError, match=r'theta = .asymptot.: must be a number of 0 or more, or "asymptotic"'
    ):
        shear_length(COIN, 0.5, 0.2, theta="asymptot")  # type: ignore[arg-type]


@pytest.mark.full
def test_a_box_below_the_shear_length_has_no_growing_modes() -> None:
    theta = cooling_ratio(COIN, 2.0, 0.0)  # from where it stays
    length = shear_length(COIN, 0.5, 0.3, theta=theta)
    small = (0.99 * length, 0.99 * length)
    assert shear_mode_energy(1e3, COIN, 0.5, 0.3, small, theta0=theta) == 0.0
    assert shear_mode_time(COIN, 1.0, 0.5, 0.3, small, 1.0, theta0=theta).time == math.inf
    large = (1.01 * length, length)
    assert shear_mode_time(COIN, 1.0, 0.5, 0.3, large, 1.0, theta0=theta).time < math.inf


@pytest.mark.parametrize(("name", "simulated"), [("5 pts", 40.5), ("200 pts", 37.8), ("polyester", 33.5)])
def test_waves_of_coins_grow_as_in_simulated_gases(name: str, simulated: float) -> None:
    """Shear lengths in diameters of gases at phi = 0.1, from simulations in which T_rot was near T.

    Theory is some 6 % longer: its viscosity is a first Sonine approximation, and waves are only a few mean free paths
    long. In the limit of late times it has 135, 90 and 85, which no gas reaches: theta there is 3979, 782 and 947.
    """
    law = coins[name].law
    assert shear_length(law, 0.5, 0.1, theta=1.0) == pytest.approx(simulated, rel=0.08)
    # In a box of 60 diameters, waves have grown 10-fold after some 10 collisions per disk: S - 1 of 4 waves.
    for theta0 in (0.0, 1.0):
        found = shear_mode_time(law, 1.0, 0.5, 0.1, (60.0, 60.0), 1.0, theta0=theta0)
        assert 2.0 < found.collisions_per_disk < 20.0
        assert found.time == pytest.approx(_time(law, theta0, found.collisions_per_disk), rel=1e-4)


def _time(law: IFRLaw, theta0: float, collisions_per_disk: float) -> float:
    """When so many have happened in a homogeneous gas at phi = 0.1, T = 1 at first."""
    times = np.linspace(0.0, 200.0, 20_001)
    return float(
        np.interp(collisions_per_disk, cooling(law, 1.0, 0.5, 2.0, 0.1, 1.0, theta0, times)[2], times)
    )


@pytest.mark.full
def test_energy_of_shear_modes_follows_spins_that_wind_up() -> None:
    """dS/dtau = z (S - k^2 xi^2 (S - 1)) with z and xi of theta at each time, by small steps, of a single length."""
    law, R, phi, side, tau, steps = coins["5 pts"].law, 0.5, 0.1, 50.0, 12.0, 3000
    S, theta, h = 1.0, 0.0, tau / steps
    for _ in range(steps):
        z, spun = (float(one) for one in changes_per_collision(theta, law, 2.0))
        q = (shear_length(law, R, phi, theta=theta) / side) ** 2
        S += h * -z * (S - q * (S - 1.0))
        theta += h * (spun - theta * z)
    # (+-1, 0), (0, +-1); the next waves are 1.41 times as short, and decay
    expected = 4.0 * (S - 1.0) / (2.0 * phi * side**2 / (math.pi * R**2))
    assert shear_mode_energy(tau, law, R, phi, (side, side), theta0=0.0) == pytest.approx(expected, rel=3e-3)


def test_what_is_not_known_is_refused() -> None:
    with pytest.raises(InputError, match=r"rho = 0\.01"):
        shear_length(IFRLaw(e_n=0.9, e_t=-0.8, mu=0.2, rho=0.01), 0.5, 0.2)
    with pytest.raises(InputError, match=r"packing_fraction = 0\.0"):
        clustering_length(0.9, 0.5, 0.0)
    with pytest.raises(InputError, match="theta = -1"):
        shear_length(COIN, 0.5, 0.2, theta=-1.0)
    with pytest.raises(InputError, match="theta: T_rot / T"):
        shear_length(COIN, 0.5, 0.2)
    with pytest.raises(InputError, match="theta0: T_rot / T"):
        shear_mode_time(COIN, 1.0, 0.5, 0.2, (90.0, 90.0), 1.0)
