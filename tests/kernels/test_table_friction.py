"""A disk that slides and spins on a table: `table_friction.py` against integrals and SciPy's integrator."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem import Device
from ifrdem.simulation import backend
from ifrdem.validation.paper import table_reference

K = 2.0


def friction_of(v: list[float], u: list[float]) -> np.ndarray:
    from ifrdem.kernels.forces import table_friction

    backend.start()
    F, T = np.zeros((2, len(v)))
    table_friction.friction_of(np.array(v), np.array(u), F, T)
    return np.array([F, T])


def slide(v, u, *, dt=None, a=1.0, k=K, tolerance=1e-12, precision="f64"):
    """v, u, x, t, eps after dt, or at rest; arrays."""
    from ifrdem.kernels.forces import table_friction

    backend.start(Device(precision=precision))
    real = np.float64 if precision == "f64" else np.float32
    v, u = (np.array(values, dtype=real) for values in np.broadcast_arrays(v, u))
    x, t, eps = np.zeros((3, len(v)), dtype=real)
    shape = np.ones(len(v), dtype=real)
    table_friction.slide_coins(
        table_friction.NEVER if dt is None else dt,
        tolerance,
        real(a) * shape,
        real(k) * shape,
        v,
        u,
        x,
        t,
        eps,
    )
    return v, u, x, t, eps


EPS = [1e-3, 0.2, 0.653, 0.95, 0.999, 1.001, 1.3, 4.0, 100.0]


def test_force_and_torque_are_the_integrals_over_the_disk():
    expected = np.array([table_reference.friction_by_quadrature(eps) for eps in EPS]).T
    np.testing.assert_allclose(friction_of(EPS, [1.0] * len(EPS)), expected, rtol=1e-9)  # of the quadrature


def test_force_and_torque_at_zero_one_and_infinity():
    """By hand: int r dA / pi = 2/3 for a disk that spins only, 1 for one that slides only; E(1) = 1, 0 K(1) = 0."""
    expected = [[0.0, 8.0 / (3.0 * np.pi), 1.0], [2.0 / 3.0, 8.0 / (9.0 * np.pi), 0.0]]
    np.testing.assert_allclose(
        friction_of([0.0, 1.0, 1.0], [1.0, 1.0, 0.0]), expected, atol=1e-13
    )  # K cut at 36


def test_force_and_torque_at_small_and_large_ratios_are_their_series():
    """F = eps - eps^3/8 and T = 2/3 - eps^2/2 for eps -> 0; F = 1 - 1/(8 eps^2) and T = 1/(4 eps) for eps -> infinity.

    From the binomial series of the elliptic integrals; the next terms are eps^2 smaller.
    """
    eps = np.array([1e-7, 1e-4])
    F, T = friction_of(list(eps), [1.0, 1.0])
    np.testing.assert_allclose(F, eps - eps**3 / 8.0, rtol=1e-13)
    np.testing.assert_allclose(T, 2.0 / 3.0 - eps**2 / 2.0, rtol=1e-13)
    F, T = friction_of([1.0, 1.0], list(eps))
    np.testing.assert_allclose(F, 1.0 - eps**2 / 8.0, rtol=1e-13)
    np.testing.assert_allclose(T, eps / 4.0, rtol=1e-8)


@pytest.mark.parametrize("k", [1.0, 2.0, 2.5])
def test_flights_to_rest_follow_an_independent_integrator(k):
    angle = np.array([0.05, 0.4, 0.7853, 0.9, 1.2, 1.52])
    v, u = 1.7 * np.sin(angle), 1.7 * np.cos(angle)
    got = slide(v, u, k=k)
    expected = np.array([table_reference.fly(*start, k) for start in zip(v, u, strict=True)]).T
    np.testing.assert_array_equal(got[0], 0.0)
    np.testing.assert_array_equal(got[1], 0.0)
    np.testing.assert_allclose(got[2], expected[2], rtol=1e-10)  # steps of 1e-12 in both, x ln|x| at eps = 1
    np.testing.assert_allclose(got[3], expected[3], atol=3e-7)  # the reference stops at 1e-7 of the speed


@pytest.mark.parametrize("dt", [0.01, 0.3, 0.8])
def test_a_step_of_time_follows_an_independent_integrator(dt):
    angle = np.array([0.1, 0.5, 0.85, 1.4])
    v, u = np.sin(angle), np.cos(angle)
    got = slide(v, -u, dt=dt)  # a clockwise spin stays clockwise
    for i, start in enumerate(zip(v, u, strict=True)):
        v_end, u_end, x, t = table_reference.fly(*start, K, dt)
        np.testing.assert_allclose(
            [got[0][i], -got[1][i], got[2][i], got[3][i]], [v_end, u_end, x, t], atol=2e-11
        )


def test_two_half_steps_are_one_step():
    """What a substep of a many-body run needs; across eps = 1 and up to rest."""
    rng = np.random.default_rng(1)
    angle = rng.uniform(0.0, np.pi / 2.0, 50)
    v, u = np.sin(angle), np.cos(angle)
    for dt in (0.2, 3.0):
        whole = slide(v, u, dt=dt)
        first = slide(v, u, dt=dt / 2.0)
        second = slide(first[0], first[1], dt=dt / 2.0)
        for i in (0, 1):
            np.testing.assert_allclose(second[i], whole[i], atol=3e-11)  # some tens of steps of 1e-12
        np.testing.assert_allclose(first[2] + second[2], whole[2], atol=3e-11)


def test_sliding_alone_and_spinning_alone_are_uniform_decelerations():
    """F = 1: x = v^2/(2 a), t = v/a. T = 2/3: t = u/(2/3 k a), x = 0. At rest nothing happens."""
    v, u, x, t, _ = slide([1.5, 0.0, 0.0], [0.0, -1.5, 0.0], a=2.0, k=1.5)
    np.testing.assert_array_equal([v, u], 0.0)
    np.testing.assert_allclose(x, [1.5**2 / 4.0, 0.0, 0.0], rtol=1e-11)
    np.testing.assert_allclose(t, [0.75, 0.75, 0.0], rtol=1e-11)
    v, u, x, t, _ = slide([1.5], [0.0], dt=0.25, a=2.0)
    np.testing.assert_allclose([v[0], u[0], x[0], t[0]], [1.0, 0.0, 0.3125, 0.25], rtol=1e-11)


def test_both_motions_stop_together_at_the_common_ratio():
    angle = np.linspace(0.3, 1.5, 13)
    eps = slide(np.sin(angle), np.cos(angle))[4]
    common = table_reference.common_ratio()
    assert common == pytest.approx(0.653, abs=5e-4)  # Farkas et al., PRL 90, 248302 (2003)
    np.testing.assert_allclose(eps, common, atol=1e-5)  # q has fallen to 1e-12 of its start


def test_distances_scale_as_speed_squared_over_deceleration():
    one = slide([0.8], [0.6])
    other = slide([2.4], [1.8], a=0.5)
    assert other[2][0] == pytest.approx(9.0 * 2.0 * one[2][0], rel=1e-11)
    assert other[3][0] == pytest.approx(3.0 * 2.0 * one[3][0], rel=1e-11)


@pytest.mark.full
@pytest.mark.parametrize("dt", [1e-4, 0.03])
def test_short_steps_end_in_single_precision_too(dt):
    """A friction that is nearly constant: v - a F dt and u - k a T dt, to the square of the step."""
    angle = np.linspace(0.1, 1.5, 15)
    v, u = np.sin(angle), np.cos(angle)
    F, T = friction_of(list(v), list(u))
    try:
        got = slide(v, u, dt=dt, precision="f32", tolerance=1e-5)
    finally:
        backend.start()
    np.testing.assert_allclose(got[3], dt, rtol=1e-5)
    np.testing.assert_allclose(got[0], v - F * dt, atol=4.0 * dt**2 + 1e-6)
    np.testing.assert_allclose(got[1], u - 2.0 * T * dt, atol=4.0 * dt**2 + 1e-6)


@pytest.mark.full
def test_single_precision_agrees_to_its_own():
    angle = np.linspace(0.1, 1.5, 15)
    v, u = np.sin(angle), np.cos(angle)
    exact = slide(v, u)
    try:
        single = slide(v, u, precision="f32", tolerance=1e-5)
    finally:
        backend.start()
    assert single[2].dtype == np.float32
    np.testing.assert_allclose(single[2], exact[2], rtol=2e-4)  # some ten steps of 1e-5
    np.testing.assert_allclose(single[3], exact[3], rtol=2e-4)
