r"""Inelastic rough disks of constant e_n and beta beyond Gaussian velocities, by Sonine's expansion.

Every collision sticks at the contact point: the slip g_t becomes -beta g_t, beta = e_t* (-1 smooth, 1 perfectly rough).
A. Megias and A. Santos, arXiv:2303.00057, doi:10.48550/arXiv.2303.00057, whose expansion this is. With x = m v^2 / 2 T,
y = I w^2 / 2 T_rot and theta = T_rot / T,

    f = f_M [1 + a_20 (x^2/2 - 2 x + 1) + a_02 (y^2/2 - 3 y/2 + 3/8) + a_11 (1 - x) (1/2 - y)],
    <x^2> = 2 (1 + a_20),  <y^2> = (3/4) (1 + a_02),  <x y> = (1 + a_11) / 2.

J[psi] is the mean loss of psi by a collision of a disk, per collision that Gaussian velocities would have, to first
order in the cumulants. All J are integrals of polynomials over Gaussians and the normal speed g, of density
g exp(-g^2/2), of the eighth degree at most: Gauss' rules of 5 nodes, and of 3 in g^2/2, are exact. They are sums of
powers theta^-2 to theta^2, because spins enter in even powers.

A gas that cools: T and T_rot lose J[x] and 2 J[y] of themselves per collision, so with Y = theta y, q = theta^2 (1 +
a_02) and r = theta (1 + a_11), which are 0 for spins at rest,

    dT/T = -J[x],  d theta = theta (J[x] - 2 J[y]),  2 d a_20 = 4 (1 + a_20) J[x] - J[x^2],
    (3/4) dq = (3/2) q J[x] - theta^2 J[y^2],  (1/2) dr = r J[x] - theta J[x y],

each per collision of Gaussian velocities; of the real ones there are 1 - a_20 / 16 times as many (`sonine`). In the
state that is reached, scaled moments do not change: J[x] = 2 J[y], J[x^2] = 2 <x^2> J[x], J[y^2] = 2 <y^2> J[x] and
J[x y] = 2 <x y> J[x] are four equations for theta, a_20, a_02 and a_11, here to first order. For smooth disks a_20 is
that of van Noije and Ernst. First order leaves out a tenth to a fifth of a cumulant (`sonine`).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ..errors import InputError, TheoryError
from ..tools.checked import (
    Array,
    Fraction,
    NonNegative,
    NonNegativeColumn,
    Positive,
    TangentialRestitution,
    validated,
)
from .collisions import collision_rate
from .contact import PackingFraction
from .cooling_gas import checked_times
from .sonine import collision_factor

POWERS = np.arange(-2, 3)
"""Powers of theta in J."""
X, Y, X2, Y2, XY = range(5)
"""Rows of J."""


class RoughSonine(NamedTuple):
    """The state of cooling rough disks to first order in the cumulants: theta = T_rot / T, a_20, a_02, a_11.

    Examples
    --------
    >>> from ifrdem import theory
    >>> theory.rough_sonine(0.9, 0.5)._asdict().keys()
    dict_keys(['theta', 'a_20', 'a_02', 'a_11'])
    """

    theta: float
    a_20: float
    a_02: float
    a_11: float


@cache
def _nodes() -> tuple[Array, Array]:
    """Normal and tangential g, V along both, and both spins, scaled by (2 T / m)^(1/2) or their own; and weights."""
    from numpy.polynomial.hermite_e import hermegauss
    from numpy.polynomial.laguerre import laggauss

    x, weight = hermegauss(5)
    weight = weight / weight.sum()
    half_square, exponential = laggauss(3)
    rules = [(np.sqrt(2.0 * half_square), exponential)]  # g, of density g exp(-g^2 / 2)
    rules += [(scale * x, weight) for scale in (1.0, 0.5, 0.5, np.sqrt(0.5), np.sqrt(0.5))]
    at = np.meshgrid(*(each for each, _ in rules), indexing="ij")
    weights = np.meshgrid(*(each for _, each in rules), indexing="ij")
    return np.array([each.ravel() for each in at]), np.prod([each.ravel() for each in weights], axis=0)


def _losses(e_n: float, beta: float, theta: float, k: float) -> Array:
    """`losses` by quadrature, at one theta above 0."""
    (g_n, g_t, V_n, V_t, w_1, w_2), weight = _nodes()
    spin = np.sqrt(theta * k)  # R w_i = spin * w_i in units of (2 T / m)^(1/2): I = m R^2 / k
    P_n = 0.5 * (1.0 + e_n) * g_n
    P_t = 0.5 * (1.0 + beta) / (1.0 + k) * (g_t + spin * (w_1 + w_2))
    turned = k * P_t / spin
    before, after = [], []
    for sign, w in ((1.0, w_1), (-1.0, w_2)):
        n, t = V_n + 0.5 * sign * g_n, V_t + 0.5 * sign * g_t
        before.append((n**2 + t**2, w**2))
        after.append(((n - sign * P_n) ** 2 + (t - sign * P_t) ** 2, (w - turned) ** 2))
    rows = []
    for psi in (
        lambda x, y: x,
        lambda x, y: y,
        lambda x, y: x * x,
        lambda x, y: y * y,
        lambda x, y: x * y,
    ):
        rows.append(0.5 * weight * sum(psi(*b) - psi(*a) for a, b in zip(after, before, strict=True)))
    columns = [np.ones_like(weight)]
    for polynomial in (
        lambda x, y: 0.5 * x * x - 2.0 * x + 1.0,
        lambda x, y: 0.5 * y * y - 1.5 * y + 0.375,
        lambda x, y: (1.0 - x) * (0.5 - y),
    ):
        columns.append(sum(polynomial(*one) for one in before))
    return np.asarray(np.array(rows) @ np.array(columns).T)


@cache
def _coefficients(e_n: float, beta: float, k: float) -> Array:
    """Coefficients of J as a sum over `POWERS` of theta, shape (5, 5, 4): power, row, column."""
    at = np.array([0.25, 0.5, 1.0, 2.0, 4.0])
    values = np.array([_losses(e_n, beta, float(theta), k) for theta in at])
    found = np.linalg.solve(at[:, None] ** POWERS, values.reshape(len(at), -1)).reshape(values.shape)
    found[np.abs(found) < 1e-11 * np.abs(values).max()] = 0.0
    return found


def losses(e_n: float, beta: float, theta: float, k: float) -> Array:
    """J of x, y, x^2, y^2 and x y (rows): of Gaussians, and for each unit of a_20, a_02 and a_11 (columns); (5, 4).

    It is a sum over powers of theta (`_coefficients`), whose coefficients are kept for each e_n, beta and k.
    """
    return np.asarray(np.tensordot(float(theta) ** POWERS.astype(float), _coefficients(e_n, beta, k), 1))


def _cumulants(e_n: float, beta: float, theta: float, k: float) -> tuple[Array, float]:
    """a_20, a_02, a_11 at a temperature ratio, and J[x] - 2 J[y], which is 0 in the cooling state."""
    J = losses(e_n, beta, theta, k)
    A, b = np.zeros((3, 3)), np.zeros(3)
    for i, (row, moment) in enumerate(((X2, 2.0), (Y2, 0.75), (XY, 0.5))):
        A[i] = J[row, 1:] - 2.0 * moment * J[X, 1:]
        A[i, i] -= 2.0 * moment * J[X, 0]
        b[i] = 2.0 * moment * J[X, 0] - J[row, 0]
    a = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
    whole = np.concatenate([[1.0], a])
    return a, float(J[X] @ whole - 2.0 * (J[Y] @ whole))


@validated
def rough_sonine(e_n: Fraction, beta: TangentialRestitution, k: Positive = 2.0) -> RoughSonine:
    """State of cooling rough disks with constant e_n and beta, to first order in the cumulants.

    It is reached after some 10 to 20 collisions of each disk, while the gas is homogeneous. By Gaussian velocities,
    theta is `cooling_ratios`. InputError where there is none, such as of smooth disks, or with e_n below 0.4.

    Parameters
    ----------
    e_n, beta : float
        Normal restitution, and ratio of the slip at the contact after and before, with its sign changed.
    k : float
        Of the moment of inertia m R^2 / k.

    Examples
    --------
    >>> from ifrdem import theory
    >>> state = theory.rough_sonine(0.9, 0.5)
    >>> round(state.theta, 3), round(state.a_20, 4)
    (0.772, -0.0203)
    """
    from scipy.optimize import brentq

    def gaussian(theta: float) -> float:
        J = losses(e_n, beta, theta, k)
        return float(J[X, 0] - 2.0 * J[Y, 0])

    try:
        first = brentq(gaussian, 1e-3, 1e3)
        theta = float(brentq(lambda one: _cumulants(e_n, beta, one, k)[1], 0.7 * first, 1.4 * first))
    except ValueError:
        text = "must be of rough disks that cool to a state with theta from 0.001 to 1000, near that of Gaussians"
        raise InputError(f"e_n = {e_n:g}, beta = {beta:g}, k = {k:g}: {text}") from None
    return RoughSonine(theta, *map(float, _cumulants(e_n, beta, theta, k)[0]))


class RoughCooling(NamedTuple):
    """Temperatures [energy], collisions per disk [1] and cumulants of cooling rough disks at times, (steps,) each.

    Examples
    --------
    >>> from ifrdem import theory
    >>> found = theory.rough_cooling(0.9, 0.5, 1.0, 0.5, 2.0, 0.1, 1.0, 1.0, [0.0, 1.0])
    >>> found.temperature.round(3)
    array([1.  , 0.92])
    """

    temperature: Array
    rotational_temperature: Array
    collisions_per_disk: Array
    a_20: Array
    a_02: Array
    a_11: Array


LEAST_THETA = 1e-9
"""theta of spins at rest."""


@validated
def rough_cooling(
    e_n: Fraction, beta: TangentialRestitution, mass: Positive, radius: Positive, k: Positive, packing_fraction: PackingFraction,
    T0: Positive, T_rot0: NonNegative, times: NonNegativeColumn,
) -> RoughCooling:  # fmt: skip
    """Cooling of a homogeneous gas of rough disks that starts with Gaussian velocities and spins.

    a_02 and a_11 of spins that begin at rest begin large, as few disks have collided; they change T and T_rot by little.
    TheoryError if the equations cannot be integrated.

    Parameters
    ----------
    e_n, beta, k : float
        As for `rough_sonine`.
    mass, radius, packing_fraction : float
        Of one disk [mass], [length]; part of the area that the disks cover.
    T0, T_rot0, times : float and array_like (steps,)
        Temperatures at time 0 [energy]; times since then, not decreasing [time].

    Examples
    --------
    >>> from ifrdem import theory
    >>> found = theory.rough_cooling(0.9, 0.5, 1.0, 0.5, 2.0, 0.1, 1.0, 1.0, [0.0, 1e4])
    >>> state = theory.rough_sonine(0.9, 0.5)
    >>> bool(abs(found.rotational_temperature[-1] / found.temperature[-1] / state.theta - 1.0) < 0.01)
    True
    """
    from scipy.integrate import solve_ivp

    when = checked_times(times)
    rate = collision_rate(packing_fraction, T0, mass, radius)
    theta0 = max(T_rot0 / T0, LEAST_THETA)

    def change(_: float, state: Array) -> list[float]:
        log_T, theta, a_20, q, r = state[:5]
        theta = max(theta, LEAST_THETA)
        a = np.array([1.0, a_20, q / theta**2 - 1.0, r / theta - 1.0])
        J = losses(e_n, beta, theta, k) @ a
        nu = rate * np.exp(0.5 * log_T)
        return [
            nu * each
            for each in (
                -J[X], theta * (J[X] - 2.0 * J[Y]), 2.0 * (1.0 + a_20) * J[X] - 0.5 * J[X2],
                2.0 * q * J[X] - theta**2 * J[Y2] / 0.75, 2.0 * r * J[X] - 2.0 * theta * J[XY],
                float(collision_factor(a_20)),
            )
        ]  # fmt: skip

    start = [0.0, theta0, 0.0, theta0**2, theta0, 0.0]
    if not len(when) or when[-1] == 0.0:
        states = np.repeat(np.array(start)[:, None], len(when), axis=1)
    else:
        span = (0.0, float(when[-1]))
        each, place = np.unique(when, return_inverse=True)
        found = solve_ivp(change, span, start, "LSODA", each, rtol=1e-8, atol=1e-12)
        if not found.success:
            raise TheoryError(
                f"the equations of cooling rough disks could not be integrated: {found.message}"
            )
        states = found.y[:, place]
    log_T, theta, a_20, q, r, tau = states
    T = T0 * np.exp(log_T)
    return RoughCooling(T, theta * T, tau, a_20, q / theta**2 - 1.0, r / theta - 1.0)
