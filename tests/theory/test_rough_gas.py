"""Sonine theory of rough disks with constant coefficients: limits, rates, and the gas that it describes better."""

from __future__ import annotations

import numpy as np
import pytest

import ifrdem
from ifrdem import IFRLaw, theory
from ifrdem.errors import InputError
from ifrdem.theory import rough_gas

PAIRS = ((0.9, 0.5), (0.9, 0.0), (0.9, 0.75), (0.8, 0.5))


def law_of(e_n: float, beta: float) -> IFRLaw:
    """A law with a constant beta."""
    return IFRLaw(e_n=e_n, e_t=beta - 1.0, mu=1e6, sticking="contact_point")


def test_the_expansion_of_rough_disks_has_the_smooth_and_the_perfectly_rough_ones() -> None:
    """Smooth: a_20 by van Noije and Ernst. alpha = beta = 1: equipartition, no cumulants.

    Gaussians: J of Luding et al., x by -(1 - alpha^2)/4 and what friction does, in `theory.rough_rates`.
    """
    for alpha in (0.6, 0.8, 0.95):
        J = rough_gas.losses(alpha, -1.0, 1.0, 2.0)
        a_20 = (4.0 * J[0, 0] - J[2, 0]) / (J[2, 1] - 4.0 * J[0, 1] - 4.0 * J[0, 0])
        assert a_20 == pytest.approx(theory.cooling_sonine(alpha), rel=1e-10)
    a, balance = rough_gas._cumulants(1.0, 1.0, 1.0, 2.0)
    np.testing.assert_allclose(a, 0.0, atol=1e-12)
    assert balance == pytest.approx(0.0, abs=1e-12)
    # The ratio of Gaussians, which another module has in closed form.
    for alpha, beta in PAIRS:
        law = law_of(alpha, beta)
        found = theory.cooling_ratio(law, 2.0, 1.0)
        J = rough_gas.losses(alpha, beta, found, 2.0)
        assert J[0, 0] == pytest.approx(2.0 * J[1, 0], rel=1e-6)
        assert theory.rough_sonine(alpha, beta).theta == pytest.approx(found, rel=0.1)


def test_a_gas_begins_at_the_rates_of_gaussians_and_ends_in_the_state_of_the_expansion() -> None:
    """Rates of `cooling_rates` at first; the end to second order of the cumulants, which the two drop differently."""
    gas = {"mass": 1.5, "radius": 0.4, "k": 2.0}
    for e_n, beta in PAIRS:
        found = theory.rough_cooling(e_n, beta, *gas.values(), 0.1, 2.0, 1.0, [0.0, 1e-5, 1e4])
        rates = theory.cooling_rates(
            2.0, 1.0, law=law_of(e_n, beta), number_density=0.1 / (np.pi * 0.16), **gas
        )
        slopes = [(each[1] - each[0]) / 1e-5 for each in (found.temperature, found.rotational_temperature)]
        assert slopes == pytest.approx([float(each) for each in rates], rel=1e-4, abs=1e-6)
        state = theory.rough_sonine(e_n, beta)
        assert found.rotational_temperature[-1] / found.temperature[-1] == pytest.approx(
            state.theta, rel=1e-3
        )
        assert (found.a_20[-1], found.a_02[-1]) == pytest.approx((state.a_20, state.a_02), rel=0.07)
    nu = theory.collision_rate(0.1, 2.0, 1.5, 0.4)
    assert found.collisions_per_disk[1] == pytest.approx(1e-5 * nu, rel=1e-3)


def test_spins_at_rest_gain_energy_as_by_gaussians_at_first() -> None:
    """A spin at rest gets <w^2> of the slip alone: T_rot per collision is that of `changes_per_collision` at theta = 0."""
    found = theory.rough_cooling(0.9, 0.5, 1.0, 0.5, 2.0, 0.1, 1.0, 0.0, [0.0, 0.01])
    gained = theory.changes_per_collision(0.0, law_of(0.9, 0.5), 2.0)[1]
    assert found.rotational_temperature[1] / found.collisions_per_disk[1] == pytest.approx(
        float(gained), rel=0.02
    )


def test_theory_of_constant_beta_is_chosen_where_it_holds() -> None:
    disks = ifrdem.Disks(10, mass=1.0, radius=0.5)
    given = (0.1, 1.0, 0.0, [0.0, 10.0])
    best = theory.prediction(disks, law_of(0.9, 0.5), *given, velocities="best")
    plain = theory.prediction(disks, law_of(0.9, 0.5), *given)
    assert (best.velocities, plain.velocities) == ("sonine", "gaussian")
    assert best.theta[-1] == pytest.approx(plain.theta[-1], rel=0.1)
    assert best.theta[-1] != plain.theta[-1]
    slides = IFRLaw(e_n=0.9, e_t=-0.5, mu=0.3, sticking="contact_point")
    assert theory.prediction(disks, slides, *given, velocities="best").velocities == "gaussian"
    with pytest.raises(InputError, match='velocities = "sonine": must be "gaussian" or "best"'):
        theory.prediction(disks, slides, *given, velocities="sonine")
    walton = ifrdem.laws.Walton(e_n=0.9, beta_0=0.5, mu=1e6)
    assert theory.constant_beta(walton, 2.0) == pytest.approx(0.5)
    assert theory.constant_beta(IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0), 2.0) is None
    assert theory.constant_beta(ifrdem.laws.rough_disks(0.9, 0.5), 2.0) == pytest.approx(
        0.5
    )  # no friction: all by e_t
    with pytest.raises(InputError, match=r"beta = -1, k = 2: must be of rough disks that cool"):
        theory.rough_sonine(0.9, -1.0)
