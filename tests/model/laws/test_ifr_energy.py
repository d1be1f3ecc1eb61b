"""Coefficients with which collisions add energy: the law is refused exactly then."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.kernels.laws.law import collide_pair
from ifrdem.model.laws.ifr import EnergyWarning, IFRLaw

ROUND_OFF = 1e-13  # energies are sums of some ten squares: f64 round-off, relative to the energy before


def mean_k(k, m):
    return (k[0] * m[1] + k[1] * m[0]) / (m[0] + m[1])


def random_pair(rng):
    """Masses, radii and k of two disks; one in ten is a wall."""
    m, R, k = 10.0 ** rng.uniform(-1.0, 1.0, 2), rng.uniform(0.3, 3.0, 2), rng.uniform(0.5, 4.0, 2)
    if rng.random() < 0.1:
        m[1] = np.inf
        return m, R, k, k[0]
    return m, R, k, mean_k(k, m)


def energies(coefficients, m, R, k, n, rng):
    """Energy before and after n random collisions, and the normal loss (1 - e_n^2) m_n g_n^2 / 2.

    Calls the law itself, because `IFRLaw` refuses some of what is tried here. The slips |g_t| are spread
    evenly in log scale over 1e-2 to 1e2 times g_n. A wall rests, so that it has no energy.
    """
    e_n = coefficients[0]
    inverse = 1.0 / m
    v_i, v_j = rng.normal(size=(2, 2, n)), rng.normal(size=(2, 2, n))
    w_i, w_j = rng.normal(size=(2, n))
    if np.isinf(m[1]):
        v_j, w_j = np.zeros((2, n)), np.zeros(n)
    # n = (1, 0): another direction is the same collision turned, which another test holds
    v_i[0] = v_j[0] + np.abs(v_i[0] - v_j[0])
    g_n = v_i[0] - v_j[0]
    slip = g_n * 10.0 ** rng.uniform(-2.0, 2.0, n) * rng.choice([-1.0, 1.0], n)
    v_i[1] = v_j[1] - R[0] * w_i - R[1] * w_j + slip
    after = collide_pair(
        *(*coefficients, 1.0, 0.0),
        *(inverse[0], R[0], k[0], v_i[0], v_i[1], w_i),
        *(inverse[1], R[1], k[1], v_j[0], v_j[1], w_j),
    )

    def energy(vx_i, vy_i, w_i, vx_j, vy_j, w_j):
        first = 0.5 * m[0] * (vx_i**2 + vy_i**2 + (R[0] * w_i) ** 2 / k[0])
        if np.isinf(m[1]):
            return first
        return first + 0.5 * m[1] * (vx_j**2 + vy_j**2 + (R[1] * w_j) ** 2 / k[1])

    loss = 0.5 * (1.0 - e_n**2) * g_n**2 / inverse.sum()
    return energy(v_i[0], v_i[1], w_i, v_j[0], v_j[1], w_j), energy(*after[:6]), loss


def test_energy_never_rises_in_1e5_admissible_collisions():
    """For a law that is admitted without a warning, the tangential impulses alone never add energy."""
    rng = np.random.default_rng(1)
    collisions = {"strict": 0, "total": 0, "refused": 0}
    while collisions["strict"] + collisions["total"] < 100_000:
        m, R, k, k_bar = random_pair(rng)
        e_n, e_t, mu, rho = (
            rng.uniform(0, 1),
            rng.uniform(-1, 1),
            10 ** rng.uniform(-2, 0.5),
            rng.uniform(-1, 1),
        )
        sticking = rng.choice(["percussion_center", "contact_point"])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                law = IFRLaw(e_n=e_n, e_t=e_t, mu=mu, sticking=sticking, rho=max(rho, 0.0), k=k_bar)
            except InputError:
                collisions["refused"] += 50
                continue
        before, after, normal_loss = energies(law.table_row(), m, R, k, 50, rng)
        assert np.all(after - before <= ROUND_OFF * before), law
        if caught:
            assert caught[0].category is EnergyWarning
        else:
            assert np.all(after - before + normal_loss <= ROUND_OFF * before), law
        collisions["total" if caught else "strict"] += 50
    assert min(collisions.values()) > 5_000, collisions  # the sample has all three


def largest_admissible_mu(e_n, e_t, sticking, k_bar):
    """The friction above which the worst collision adds energy, found by search rather than by inequalities.

    Per m_n (1 + e_n)^2 g_n^2 / (2 a), with x = m_t |g_t| / P_n and P_f = P_n min(mu, a c x), the energy rises
    by (min(mu, a c x) + e_t x)^2 - x^2 - (1 - e_n) / (a (1 + e_n)). With x = mu y the first two terms are
    mu^2 h(y).
    """
    a = 1.0 + k_bar
    ac = 1.0 if sticking == "contact_point" else 0.5 * a
    y = np.append(np.geomspace(1e-3, 1e3, 20_001), 1.0 / ac)
    h = np.max((np.minimum(1.0, ac * y) + e_t * y) ** 2 - y**2)
    return np.sqrt((1.0 - e_n) / (a * (1.0 + e_n)) / h) if h > 0.0 else np.inf


def laws_at_the_boundary(n, seed):
    """Random coefficients whose mu is the largest admissible one, with a pair of disks."""
    rng = np.random.default_rng(seed)
    while n:
        e_n, e_t = rng.uniform(0.1, 0.99), rng.uniform(-1.0, 0.97)
        m, R, k, k_bar = random_pair(rng)
        sticking = rng.choice(["percussion_center", "contact_point"])
        mu = largest_admissible_mu(e_n, e_t, sticking, k_bar)
        if mu < np.inf:
            n -= 1
            yield e_n, e_t, mu, sticking, m, R, k, k_bar, rng


@pytest.mark.full
def test_energy_rises_just_outside_the_admissible_set_and_not_just_inside():
    """1 % of mu on either side of the boundary: the law is refused where a random search finds a gain.

    The search takes 20,000 collisions over four decades of slip, some 20 in each 1 %.
    """
    kinks = 0
    for e_n, e_t, mu, sticking, m, R, k, k_bar, rng in laws_at_the_boundary(150, seed=2):
        point = float(sticking == "contact_point")
        with pytest.raises(InputError, match="add energy"):
            IFRLaw(e_n=e_n, e_t=e_t, mu=1.01 * mu, sticking=sticking, k=k_bar)
        before, after, _ = energies((e_n, e_t, 1.01 * mu, point, 0.0), m, R, k, 20_000, rng)
        assert np.max(after / before) > 1.0 + 1e-6
        with pytest.warns(EnergyWarning):
            IFRLaw(e_n=e_n, e_t=e_t, mu=0.99 * mu, sticking=sticking, k=k_bar)
        before, after, _ = energies((e_n, e_t, 0.99 * mu, point, 0.0), m, R, k, 20_000, rng)
        assert np.max(after / before) < 1.0 + ROUND_OFF
        a_c = 1.0 if point else 0.5 * (1.0 + k_bar)
        kinks += e_t * a_c <= 1.0 - e_t**2
    assert 20 < kinks < 130  # both inequalities decide, each for some


@pytest.mark.parametrize("sticking", ["percussion_center", "contact_point"])
@pytest.mark.parametrize("k", [1.0, 2.0, 2.5])
def test_warning_begins_where_tangential_impulses_alone_add_energy(sticking, k):
    """At e_t = 0 (contact point) or (1 - k)/2 (percussion centre), with a tiny friction."""
    bound = 0.0 if sticking == "contact_point" else 0.5 * (1.0 - k)
    point = float(sticking == "contact_point")
    rng = np.random.default_rng(3)
    m, R = np.array([1.0, 2.5]), np.array([1.0, 0.4])
    for e_t, adds in ((bound - 0.001, False), (bound, False), (bound + 0.001, True)):
        law = (0.5, e_t, 0.01)
        if adds:
            with pytest.warns(EnergyWarning, match="tangential impulses alone"):
                IFRLaw(e_n=0.5, e_t=e_t, mu=0.01, sticking=sticking, k=k)
        else:
            IFRLaw(e_n=0.5, e_t=e_t, mu=0.01, sticking=sticking, k=k)  # a warning would be an error
        before, after, normal_loss = energies((*law, point, 0.0), m, R, np.array([k, k]), 20_000, rng)
        gain = np.max((after - before + normal_loss) / before)
        assert (gain > 1e-12) == adds, gain


def test_percussion_center_always_warns_above_k_of_3():
    """The strict set -1 <= e_t <= (1 - k)/2 is empty there."""
    IFRLaw(e_n=0.5, e_t=-1.0, mu=0.1, k=3.0)
    with pytest.warns(EnergyWarning):
        IFRLaw(e_n=0.5, e_t=-1.0, mu=0.1, k=3.01)


@pytest.mark.parametrize(
    ("coefficients", "message"),
    [
        ({"e_n": 1.01, "e_t": -1.0, "mu": 0.0}, "e_n = 1.01: must be a number from 0 to 1"),
        ({"e_n": 0.5, "e_t": 1.1, "mu": 0.0}, "e_t = 1.1: must be a number from -1 to 1"),
        ({"e_n": 0.5, "e_t": -1.1, "mu": 0.0}, "e_t = -1.1: must be a number from -1 to 1"),
        (
            {"e_n": 0.0, "e_t": 1.0, "mu": 0.05},
            "a grazing collision would add energy; with mu > 0, e_t must be below 1",
        ),
        ({"e_n": 1.0, "e_t": -0.45, "mu": 0.05}, "e_t <= -0.5 or mu = 0 it would not"),
    ],
)
def test_coefficients_that_always_add_energy_somewhere_are_refused(coefficients, message):
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        IFRLaw(**coefficients)
    row = (*coefficients.values(), 0.0, 0.0)
    before, after, _ = energies(
        row, np.ones(2), np.ones(2), 2.0 * np.ones(2), 20_000, np.random.default_rng(4)
    )
    assert np.max(after / before) > 1.0 + 1e-6


@pytest.mark.parametrize("e_t", [-1.0, 1.0])
def test_elastic_collisions_keep_energy(e_t):
    """e_n = 1 and smooth (e_t = -1) or perfectly rough (e_t = 1) disks without friction."""
    law = IFRLaw(e_n=1.0, e_t=e_t, mu=0.0)
    rng = np.random.default_rng(5)
    for _ in range(20):
        m, R, k, _ = random_pair(rng)
        before, after, _ = energies(law.table_row(), m, R, k, 1000, rng)
        np.testing.assert_allclose(after, before, rtol=ROUND_OFF)


@pytest.mark.parametrize("point", [0.0, 1.0])
def test_energy_changes_by_the_work_of_the_impulses(point):
    """An impulse does the work P times the mean of the velocities before and after, of the contact points."""
    rng = np.random.default_rng(6)
    im, R, k = (
        10.0 ** rng.uniform(-1, 1, (2, 5000)),
        rng.uniform(0.3, 3, (2, 5000)),
        rng.uniform(1, 2, (2, 5000)),
    )
    vx, vy, w = rng.normal(size=(3, 2, 5000))
    vx[0] = vx[1] + np.abs(vx[0] - vx[1])
    out = collide_pair(
        *(0.7, -0.6, 0.3, point, 0.0, 1.0, 0.0),
        *(im[0], R[0], k[0], vx[0], vy[0], w[0], im[1], R[1], k[1], vx[1], vy[1], w[1]),
    )
    vx_, vy_, w_ = np.array([out[0], out[3]]), np.array([out[1], out[4]]), np.array([out[2], out[5]])
    P_n, P_t = out[6], out[7]
    inertia = R**2 / (im * k)
    gain = 0.5 * np.sum((vx_**2 + vy_**2 - vx**2 - vy**2) / im + inertia * (w_**2 - w**2), axis=0)
    g_n, g_t = vx + vx_, vy + vy_ + np.array([[1.0], [-1.0]]) * R * (w + w_)
    work = -0.5 * (P_n * (g_n[0] - g_n[1]) + P_t * (g_t[0] - g_t[1]))
    np.testing.assert_allclose(gain, work, rtol=1e-11, atol=1e-11)  # of energies up to 1e2
