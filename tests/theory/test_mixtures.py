"""Kinetic theory of mixtures against a Monte Carlo of the law itself, exact limits, and simulated mixtures."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
import scipy.optimize
from numpy.typing import NDArray
from support.serial_reference import simulate

from ifrdem import theory
from ifrdem.errors import InputError
from ifrdem.initial.placement import hexagonal_positions, maxwellian
from ifrdem.model.box import Box
from ifrdem.model.laws.collision import collide
from ifrdem.model.laws.ifr import EnergyWarning, IFRLaw
from ifrdem.model.laws.law import CollisionLaw
from ifrdem.model.state import Disks, State
from ifrdem.theory import cooling, cooling_rates, prediction
from ifrdem.theory.contact import compressibility, mixture_contact_values
from ifrdem.theory.driven_gas import Driving, driven, steady_state
from ifrdem.theory.mixtures import Mixture, mixture_cooling, mixture_cooling_rates, mixture_driven

COIN = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
ELASTIC = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)


def random_mixture(seed: int) -> tuple[Mixture, NDArray[np.float64], NDArray[np.float64]]:
    """Two species that differ in all, three different laws, and temperatures."""
    rng = np.random.default_rng(seed)
    m, R, x = np.exp(rng.uniform(-1.2, 1.2, (3, 2)))
    k = rng.uniform(0.8, 2.5, 2)

    def law() -> IFRLaw:
        sticking = ("percussion_center", "contact_point")[rng.integers(2)]
        while True:  # until it adds no energy
            try:
                return IFRLaw(
                    e_n=rng.uniform(0.4, 1.0), e_t=rng.uniform(-1.0, -0.2), mu=rng.uniform(0.0, 0.8),
                    sticking=sticking, k=float(k.max()),
                )  # fmt: skip
            except InputError:
                continue

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EnergyWarning)
        a, b, c = law(), law(), law()
        mixture = Mixture(m, R, [[a, b], [b, c]], rng.uniform(0.05, 0.5), k=k, fraction=x)
    T, T_rot = np.exp(rng.uniform(-1.5, 1.5, (2, 2)))
    return mixture, T, T_rot


def sampled_changes(
    mixture: Mixture, i: int, j: int, T: NDArray[np.float64], T_rot: NDArray[np.float64], pairs: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means and standard errors of max(g_n, 0) and of g_n times the gains of energy: motion and spin of i, of j.

    n along x; both velocities and spins are drawn from Gaussians. The law is `ifrdem.collide`.
    """
    rng = np.random.default_rng(100 + 10 * i + j)
    own = [i, j]
    m, R, k = mixture.mass[own], mixture.radius[own], mixture.k[own]
    v = rng.normal(size=(pairs, 2, 2)) * np.sqrt(T[own] / m)[:, None]
    inertia = m * R**2 / k
    w = rng.normal(size=(pairs, 2)) * np.sqrt(T_rot[own] / inertia)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EnergyWarning)
        after = collide(mixture.law[i][j], [1.0, 0.0], m, R, k, v, w)
    approach = np.maximum(v[:, 0, 0] - v[:, 1, 0], 0.0)
    motion = 0.5 * m * (np.sum(after.velocity**2, axis=2) - np.sum(v**2, axis=2))
    spin = 0.5 * inertia * (after.spin**2 - w**2)
    samples = np.stack(
        [approach, *(approach * gain for gain in (motion[:, 0], spin[:, 0], motion[:, 1], spin[:, 1]))]
    )
    return samples.mean(axis=1), samples.std(axis=1) / math.sqrt(pairs)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
def test_rates_of_a_mixture_are_those_of_a_monte_carlo_of_the_law(seed: int) -> None:
    """Disk i meets n_j g_ij sigma_ij 2 pi <max(g_n, 0) ...> of species j: the law itself gives the changes."""
    mixture, T, T_rot = random_mixture(seed)
    n, R = mixture.number_density, mixture.radius
    g = mixture_contact_values(mixture.packing_fraction, R, mixture.fraction)
    rates, expected, error2 = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2))
    for i in range(2):
        for j in range(2):
            mean, error = sampled_changes(mixture, i, j, T, T_rot, pairs=250_000)
            often = n[j] * g[i, j] * (R[i] + R[j]) * 2.0 * math.pi
            assert mixture.collision_rates(T)[i, j] == pytest.approx(
                often * mean[0], abs=4.0 * often * error[0]
            )
            expected[:, i] += often * mean[1:3] * (1.0, 2.0)  # energies T and T_rot / 2
            error2[:, i] += (often * error[1:3] * (1.0, 2.0)) ** 2
    rates = np.array(mixture_cooling_rates(mixture, T, T_rot))
    # 20 comparisons: 4 standard errors are passed by chance in 1 of 800 runs, and the seeds are fixed.
    assert np.all(np.abs(rates - expected) < 4.0 * np.sqrt(error2) + 1e-13)
    # Sharp enough to see a wrong term: 1 % of what a collision moves to and fro.
    assert np.all(np.sqrt(error2) < 0.01 * mixture.collision_rates(T).sum(axis=1) * (T.max() + T_rot.max()))


def test_the_energy_that_a_pair_loses_is_that_of_its_impulses() -> None:
    """Normal: m_n (1 - e_n^2) <g_n^2> / 2 = m_n (1 - e_n^2) V; tangential 0 if m_t g_t' = -m_t g_t."""
    # Perfectly rough disks that stick at the contact point (e_t = 0: g_t' = -g_t) lose the normal part only.
    law = IFRLaw(e_n=0.7, e_t=0.0, mu=1e9, sticking="contact_point")
    mixture = Mixture([1.0, 3.0], [0.5, 0.2], law, 0.3, fraction=[1.0, 2.0])
    T, T_rot = np.array([1.3, 0.4]), np.array([0.2, 2.0])
    dT, dT_rot = mixture_cooling_rates(mixture, T, T_rot)
    often, x, V = mixture.collision_rates(T), mixture.fraction, T / mixture.mass
    m_n = 1.0 / (1.0 / mixture.mass[:, None] + 1.0 / mixture.mass)
    loss = 0.5 * np.sum(x[:, None] * often * m_n * (1.0 - 0.49) * (V[:, None] + V))
    assert x @ (dT + 0.5 * dT_rot) == pytest.approx(-loss, rel=1e-9)  # 1/mu enters squared


def test_collision_rates_of_a_pair_are_equal_for_both_species() -> None:
    mixture, T, _ = random_mixture(3)
    met = mixture.number_density[:, None] * mixture.collision_rates(T)
    np.testing.assert_allclose(met, met.T, rtol=1e-14)


@pytest.mark.parametrize("law", [COIN, IFRLaw(e_n=0.9, e_t=-0.7, mu=0.1, sticking="contact_point")])
def test_species_that_are_alike_cool_like_one(law: IFRLaw) -> None:
    mixture = Mixture([1.7, 1.7, 1.7], 0.4, law, 0.25, fraction=[1.0, 5.0, 2.0])
    T, T_rot = mixture_cooling_rates(mixture, 2.3, 0.9)
    one = cooling_rates(
        2.3, 0.9, law=law, mass=1.7, radius=0.4, k=2.0, number_density=0.25 / (math.pi * 0.16)
    )
    np.testing.assert_allclose(T, one[0], rtol=1e-12)
    np.testing.assert_allclose(T_rot, one[1], rtol=1e-12)
    times = np.geomspace(0.1, 1e3, 5)
    found = mixture_cooling(mixture, 2.3, 0.9, times).mean(mixture)
    for a, b in zip(found, cooling(law, 1.7, 0.4, 2.0, 0.25, 2.3, 0.9, times), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-7)  # 1e-10 a step


def test_elastic_rough_species_exchange_energy_until_all_four_temperatures_agree() -> None:
    law = IFRLaw(e_n=1.0, e_t=0.0, mu=1e9, sticking="contact_point")
    mixture = Mixture([1.0, 4.0], [0.5, 0.9], law, 0.2, fraction=[3.0, 1.0])
    x = mixture.fraction
    T0, T_rot0 = np.array([2.0, 0.0]), np.array([0.5, 4.0])
    found = mixture_cooling(mixture, T0, T_rot0, [0.0, 200.0])
    # Energy T + T_rot / 2 of a disk is kept, 1.5 T at the end.
    energy = float(x @ (T0 + 0.5 * T_rot0))
    np.testing.assert_allclose(
        [*found.temperature[-1], *found.rotational_temperature[-1]], energy / 1.5, rtol=1e-7
    )
    np.testing.assert_allclose(mixture_cooling_rates(mixture, energy, energy), 0.0, atol=1e-12)


def test_a_species_at_rest_is_set_in_motion_and_both_at_rest_do_nothing() -> None:
    mixture = Mixture([1.0, 2.0], 0.5, COIN, 0.2)
    dT, dT_rot = mixture_cooling_rates(mixture, [1.0, 0.0], 0.0)
    assert dT[0] < 0.0 < dT[1]
    assert np.all(dT_rot > 0.0)
    np.testing.assert_array_equal(mixture_cooling_rates(mixture, [0.0, 0.0], 1.0), 0.0)


def test_contact_values_of_a_mixture_in_exact_limits() -> None:
    phi, R = 0.35, np.array([0.5, 1e-9])
    g = mixture_contact_values(phi, R, [1.0, 1.0])
    assert g[1, 1] == pytest.approx(1.0 / (1.0 - phi), rel=1e-7)  # of two points: the area that is left
    alike = mixture_contact_values(phi, [0.5, 0.5], [1.0, 9.0])
    # 1 + 2 phi g is the virial series at phi = 0.35, from its first terms within a few %: B_2 ... B_6
    b = (1.0, 0.7820044, 0.5322318, 0.33355604, 0.1988425)
    series = sum(B * (2.0 * phi) ** n for n, B in enumerate(b))
    np.testing.assert_allclose(alike, series, rtol=0.04)
    np.testing.assert_array_equal(mixture_contact_values(phi, R, None, "dilute"), 1.0)
    assert compressibility(phi) == pytest.approx(1.0 + 2.0 * phi * alike[0, 0], rel=1e-14)


def test_the_second_virial_coefficient_of_a_mixture_is_exact() -> None:
    """Z = 1 + n sum x_i x_j (pi/2) sigma_ij^2 + ...: half the area that j excludes from i."""
    R, x, phi = np.array([0.5, 0.2, 0.9]), np.array([0.5, 0.3, 0.2]), 1e-6
    density = phi / (math.pi * np.sum(x * R**2))
    excluded = sum(x[i] * x[j] * 0.5 * math.pi * (R[i] + R[j]) ** 2 for i in range(3) for j in range(3))
    assert compressibility(phi, R, x) - 1.0 == pytest.approx(density * excluded, rel=1e-5)  # phi beyond


def test_an_elastic_mixture_collides_at_the_predicted_rates() -> None:
    n, phi = 600, 0.4
    big = np.arange(n) % 3 == 0
    disks = Disks(n, np.where(big, 3.0, 1.0), np.where(big, 1.0, 0.5))
    box = Box.from_packing_fraction(disks.radius, phi)
    start = State(
        hexagonal_positions(box, disks.radius, seed=1),
        maxwellian(disks.mass, temperature=1.0, seed=4),
        np.zeros(n),
    )
    elastic = (1.0, -1.0, 0.0, 0.0, 0.0)
    mixed, _ = simulate(disks, box, elastic, start, max_collisions=4_000)
    end, collisions = simulate(disks, box, elastic, mixed, max_collisions=14_000)
    mixture, which = Mixture.of(disks, IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0), phi)
    pairs = np.array([(c[1], c[2]) for c in collisions])
    kinds = which[pairs.astype(int)].sum(axis=1)
    # Ids of species: by mass, the small ones first.
    number = mixture.fraction * n
    often = mixture.collision_rates([1.0, 1.0]) * (end.time - mixed.time)
    for kind, expected in ((0, 0.5 * number[0] * often[0, 0]), (1, number[0] * often[0, 1]),
                           (2, 0.5 * number[1] * often[1, 1])):  # fmt: skip
        count = int(np.sum(kinds == kind))
        # Three standard errors of counting, and 1.5 % for the contact values.
        assert count == pytest.approx(expected, rel=0.015 + 3.0 / math.sqrt(expected))


def test_a_driven_mixture_of_like_species_is_the_driven_gas() -> None:
    mixture = Mixture([1.0, 1.0], 0.5, COIN, 0.2)
    driving = Driving(power=1.0, spin_power=0.1, rate=0.05)
    times = [0.0, 1.0, 100.0]
    found = mixture_driven(mixture, [driving, driving], 0.0, 0.0, times)
    T, T_rot, collisions = driven(COIN, 1.0, 0.5, 2.0, 0.2, driving, 0.0, 0.0, times)
    np.testing.assert_allclose(found.mean(mixture), (T, T_rot, collisions), rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(
        found.temperature[-1], (steady_state(COIN, 1.0, 0.5, 2.0, 0.2, driving) or (0.0,))[0], rtol=1e-6
    )


def test_a_prediction_takes_the_theory_that_belongs_to_the_gas() -> None:
    times = np.array([0.0, 3.0, 9.0])
    one = Disks(100, 1.0, 0.5)
    found = prediction(one, COIN, 0.2, 1.0, 0.1, times)
    assert found.kind == "cooling"
    np.testing.assert_allclose(
        found.temperature, cooling(COIN, 1.0, 0.5, 2.0, 0.2, 1.0, 0.1, times)[0], rtol=1e-8
    )
    bath = {"kind": "langevin", "temperature": 2.0, "rate": 0.3, "spin_rate": 0.1}
    found = prediction(one, COIN, 0.2, 1.0, 0.1, times, forces=[bath])
    assert found.kind == "driven"
    driving = Driving.of([bath], 1.0, 0.125) or Driving()
    np.testing.assert_allclose(
        found.temperature, driven(COIN, 1.0, 0.5, 2.0, 0.2, driving, 1.0, 0.1, times)[0], rtol=1e-6
    )
    assert prediction(one, COIN, 0.2, 1.0, 0.1, times, shear_rate=0.1).kind == "sheared"
    two = Disks(2, 1.0, [0.5, 0.4], material=np.array([1, 0]))
    found = prediction(two, [[COIN, COIN], [COIN, COIN]], 0.2, 1.0, 0.1, times)
    assert found.species is not None
    assert found.species.temperature.shape == (3, 2)
    for change, message in (
        ({"shear_rate": 0.1}, "sheared gas with 2 species"),
        ({"forces": [{"kind": "rescale", "temperature": 1.0}]}, "rescale: kinetic theory knows linear"),
    ):
        with pytest.raises(InputError, match=message):
            prediction(two, COIN, 0.2, 1.0, 0.1, times, **change)


def test_each_species_is_driven_by_its_own_mass_and_inertia() -> None:
    """Smooth elastic disks: spins keep what they get, a power I D or T_rot = 2 I D t, and all share 2 m D t."""
    disks = Disks(4, mass=[1.0, 1.0, 1.0, 3.0], radius=[0.5, 0.5, 0.5, 0.4], k=[2.0, 2.0, 2.0, 1.0])
    t, forces = np.array([0.0, 2.0, 5.0]), [{"kind": "spin_kicks", "diffusion": 0.3}]
    forces.append({"kind": "random_kicks", "diffusion": 0.2})
    found = prediction(disks, ELASTIC, 0.2, 1.0, 0.1, t, forces=forces)
    inertia = np.array([1.0 * 0.25 / 2.0, 3.0 * 0.16 / 1.0])  # lighter ones first
    assert found.species is not None
    np.testing.assert_allclose(
        found.species.rotational_temperature, 0.1 + 0.6 * t[:, None] * inertia, rtol=1e-6
    )
    np.testing.assert_allclose(found.temperature, 1.0 + 0.4 * 1.5 * t, rtol=1e-6)  # of a mean mass of 1.5


def test_each_species_has_the_collisions_of_its_own_rates() -> None:
    """Elastic disks at T = 1: n_j g_ij sigma_ij sqrt(2 pi (1 / m_i + 1 / m_j)) of a disk i with disks j."""
    m, R, x = np.array([1.0, 4.0]), np.array([0.5, 1.0]), np.array([0.8, 0.2])
    mixture = Mixture(m, R, ELASTIC, 0.2, fraction=x)
    density = x * 0.2 / (math.pi * (0.8 * 0.25 + 0.2 * 1.0))
    g = mixture_contact_values(0.2, R, x)
    sigma, inverse = R[:, None] + R, 1.0 / m
    rate = (density * g * sigma * np.sqrt(2.0 * math.pi * (inverse[:, None] + inverse))).sum(axis=1)
    for found in (
        mixture_cooling(mixture, 1.0, 0.0, [0.0, 3.0]),
        mixture_driven(mixture, [Driving(), Driving()], 1.0, 0.0, [0.0, 3.0]),
    ):
        np.testing.assert_allclose(found.collisions_per_disk[-1], 3.0 * rate, rtol=1e-6)
        assert found.mean(mixture)[2][-1] == pytest.approx(3.0 * float(x @ rate), rel=1e-6)


class Sticky(CollisionLaw):
    """A custom law without a theory."""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": IFRLaw(e_n=0.9, e_t=-0.8, mu=0.2, rho=0.01)}, r"rho = 0\.01: .* no rolling friction"),
        ({"law": Sticky()}, "must be a law that says has_averages"),
        ({"law": [[COIN, COIN]]}, "2 rows of 2 laws"),
        (
            {"law": [[COIN, COIN], [IFRLaw(e_n=0.5, e_t=-0.8, mu=0.2), COIN]]},
            r"\[0\]\[1\] and \[1\]\[0\] differ",
        ),
        ({"law": IFRLaw(e_n=0.99, e_t=0.0, mu=0.5, k=1.0)}, "would add energy"),
        ({"mass": [1.0, -2.0]}, r"mass\[1\] = -2\.0"),
        ({"mass": [1.0, 2.0, 3.0], "radius": [0.5, 0.4]}, "one number per species"),
        ({"packing_fraction": 0.95}, "packing_fraction = 0.95"),
        ({"contact": "hendersen"}, "'henderson'"),
    ],
)
def test_impossible_mixtures_are_refused(change: dict, message: str) -> None:
    given = {"mass": [1.0, 2.0], "radius": 0.5, "law": COIN, "packing_fraction": 0.2} | change
    with pytest.raises(InputError, match=message):
        Mixture(**given)


def test_temperatures_that_do_not_fit_are_refused() -> None:
    mixture = Mixture([1.0, 2.0], 0.5, COIN, 0.2)
    with pytest.raises(InputError, match="number for each of 2 species"):
        mixture_cooling_rates(mixture, [1.0, 1.0, 1.0], 0.0)
    with pytest.raises(InputError, match="nothing moves"):
        mixture_cooling(mixture, 0.0, 1.0, [1.0])
    with pytest.raises(InputError, match="driving has 1: must be one for each of 2 species"):
        mixture_driven(mixture, [Driving(power=1.0)], 1.0, 1.0, [1.0])
    with pytest.raises(InputError, match="finite mass"):
        Mixture.of(Disks(2, [1.0, math.inf], 0.5), COIN, 0.2)


def equal_cooling_rates(
    mass: np.ndarray, radius: np.ndarray, x: np.ndarray, g: np.ndarray, e: float
) -> float:
    """T_2 / T_1 of two species by V. Garzo and J. Dufty, Phys. Rev. E 60, 5706 (1999), in d = 2, Maxwellian velocities.

    The cooling rate of species i, with theta_i = m_i / T_i, mu_ji = m_j / (m_i + m_j), up to a factor of both,

        zeta_i = sum_j x_j g_ij s_ij mu_ji (1 + e) sqrt((th_i + th_j) / (th_i th_j))
                 [1 - mu_ji (1 + e) (th_i + th_j) / (2 th_j)]:

    a disk i loses m_i v_i . dv_i with dv_i = mu_ji (1 + e) g_n, and gains half the square of that; <v_i . n g_n^2> and
    <g_n^3> of Gaussians with the variances 1 / th_i and 1 / th_j give it.
    """

    def difference(ratio: float) -> float:
        T = np.array([1.0, ratio])
        th = mass / T
        zeta = np.zeros(2)
        for i in (0, 1):
            for j in (0, 1):
                mu, both = mass[j] / (mass[i] + mass[j]), th[i] + th[j]
                often = x[j] * g[i, j] * (radius[i] + radius[j]) * np.sqrt(both / (th[i] * th[j]))
                zeta[i] += often * mu * (1.0 + e) * (1.0 - 0.5 * mu * (1.0 + e) * both / th[j])
        return float(zeta[0] - zeta[1])

    return float(scipy.optimize.brentq(difference, 1e-2, 1e2, xtol=1e-13))


@pytest.mark.parametrize("e", [0.5, 0.8, 0.95])
@pytest.mark.parametrize("mass", [(1.0, 8.0), (3.0, 1.0)])
def test_ratio_of_temperatures_of_smooth_disks_is_that_of_garzo_and_dufty(
    e: float, mass: tuple[float, float]
) -> None:
    radius, x = np.array([0.5, 0.8]), np.array([0.3, 0.7])
    law = IFRLaw(e_n=e, e_t=-1.0, mu=0.0)
    mixture = theory.Mixture(mass, radius, law, 0.3, fraction=x)
    T, T_rot = theory.mixture_cooling_ratios(mixture)
    expected = equal_cooling_rates(np.array(mass), radius, x, mixture.contact_values(), e)
    assert T[1] / T[0] == pytest.approx(expected, rel=1e-6)
    assert x @ T == pytest.approx(1.0, rel=1e-9)
    assert not T_rot.any()


def test_ratio_of_temperatures_of_equal_rough_disks_is_that_of_one_species() -> None:
    """Of two names for the same disks; theta by the polynomial of `cooling_ratio`."""
    law = IFRLaw(e_n=0.87, e_t=-0.88, mu=0.21)
    T, T_rot = theory.mixture_cooling_ratios(theory.Mixture([1.0, 1.0], [0.5, 0.5], law, 0.2), 0.3)
    assert pytest.approx([1.0, 1.0], rel=1e-7) == T
    assert T_rot == pytest.approx([theory.cooling_ratio(law, 2.0, 0.3)] * 2, rel=1e-5)


def test_rough_mixture_tends_to_equal_cooling_rates() -> None:
    law = IFRLaw(e_n=0.8, e_t=-0.5, mu=0.3)
    mixture = theory.Mixture([1.0, 5.0], [0.5, 1.0], law, 0.2, fraction=[0.8, 0.2])
    T, T_rot = theory.mixture_cooling_ratios(mixture)
    dT, dT_rot = theory.mixture_cooling_rates(mixture, T, T_rot)
    rates = np.concatenate([dT / T, dT_rot / T_rot])
    assert np.ptp(rates) < 1e-6 * abs(rates[0])
