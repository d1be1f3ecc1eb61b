r"""a_2 of cooling smooth disks from Sonine polynomials of higher order, by quadrature: no first order in a_2.

Symbols as in `ifrdem.theory.sonine`: c = v / sqrt(2 T / m), f(c) = exp(-c^2)/pi [1 + sum_k a_k S_k(c^2)], k = 2 to K,
S_k the Laguerre polynomials L_k, which are orthonormal for the weight exp(-x), x = c^2. By T, a_1 = 0.

Let collisions change <c^2p> at the rate -mu_2p. In the cooling gas f keeps its form (T. P. C. van Noije and M. H.
Ernst, Granul. Matter 1, 57 (1998)): mu_2p = p mu_2 <c^2p> for p = 2 to K. Both sides are quadratic in a_k. mu_2p is an
average over pairs, weighted by their approach speed, of what a collision takes of c_1^2p + c_2^2p, normal velocities
being reversed and multiplied by e_n:

    mu_2p = < |g_n| (c_1^2p + c_2^2p - c_1'^2p - c_2'^2p) >, up to a factor that is the same for all p.

With c_1,2 = C +- g/2 the Gaussian weights are those of C and g, and the integrand is |g_n| times a polynomial: nodes of
Gauss for C_x, C_y and the tangential part of g, for which n is the x axis (f is isotropic), and of Gauss for the weight
y exp(-y^2/2) of its normal part, make the averages exact. Newton's method solves the K - 1 equations.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import hermite_e, laguerre

from ...tools.checked import Array

HIGHEST = 6  # K
NODES = 19  # of each of three directions: exact up to order 37, and 36 is the highest of c^2K S_K S_K


def cooling_sonine(e_n: float) -> tuple[float, float]:
    """a_2 with polynomials up to the sixth, and by how much the fifth or the sixth changed it."""
    mu, moments = brackets(e_n)
    values = [float(coefficients(mu, moments, K)[0]) for K in (HIGHEST - 2, HIGHEST - 1, HIGHEST)]
    return values[-1], max(abs(values[2] - values[1]), abs(values[1] - values[0]))


def brackets(e_n: float) -> tuple[Array, Array]:
    """Contribution of a_j of one disk and a_k of the other to mu_2p, and a_k to <c^2p>, p from 1 on."""
    x_1, x_2, y_1, y_2, weight = _pairs(e_n)
    S_1, S_2 = _polynomials(x_1), _polynomials(x_2)
    powers = np.arange(1, HIGHEST + 1)
    lost = np.array([x_1**p + x_2**p - y_1**p - y_2**p for p in powers])
    mu = np.einsum("n,pn,jn,kn->pjk", weight, lost, S_1, S_2, optimize=True)
    node, mass = np.polynomial.laguerre.laggauss(40)
    moments = np.einsum("n,pn,kn->pk", mass, node ** powers[:, None], _polynomials(node))
    return mu, moments


def coefficients(mu: Array, moments: Array, K: int) -> Array:
    """a_2 to a_K, from `brackets`."""
    mu, moments, powers = mu[:K, : K + 1, : K + 1], moments[:K, : K + 1], np.arange(1, K + 1)

    def missing(tail: Array) -> Array:
        a = np.concatenate([[1.0, 0.0], tail])
        rates, means = np.einsum("pjk,j,k->p", mu, a, a), moments @ a
        return np.asarray((rates - powers * rates[0] * means)[1:] / (powers * rates[0] * means)[1:])

    a = np.zeros(K - 1)
    for _ in range(50):
        step = 1e-7
        slope = np.array(
            [(missing(a + step * one) - missing(a - step * one)) / (2.0 * step) for one in np.eye(len(a))]
        ).T
        change = np.linalg.solve(slope, missing(a))
        a = a - change
        if np.abs(change).max() < 1e-12:
            return a
    raise RuntimeError(f"the equations of {K - 1} Sonine coefficients have no solution near a Gaussian")


def _polynomials(x: Array) -> Array:
    """S_0 to S_K at x."""
    return np.array([laguerre.lagval(x, one) for one in np.eye(HIGHEST + 1)])


def _pairs(e_n: float) -> tuple[Array, Array, Array, Array, Array]:
    """c_1^2, c_2^2 before and after the collision, and weights, at all nodes; C and g in units of their own width."""
    normal, of_normal = hermite_e.hermegauss(NODES)
    half, of_half = _half_range()
    C_x, C_y, g_t, g_n = (part.ravel() for part in np.meshgrid(normal, normal, normal, half, indexing="ij"))
    weight = np.einsum("i,j,k,l->ijkl", of_normal, of_normal, of_normal, of_half).ravel()
    # c has variance 1/2 a component: C = (c_1 + c_2)/2 has 1/4, g = c_1 - c_2 has 1.
    C_x, C_y = 0.5 * C_x, 0.5 * C_y

    def squares(g_x: Array) -> tuple[Array, Array]:
        return (
            (C_x + 0.5 * g_x) ** 2 + (C_y + 0.5 * g_t) ** 2,
            (C_x - 0.5 * g_x) ** 2 + (C_y - 0.5 * g_t) ** 2,
        )

    x_1, x_2 = squares(g_n)
    y_1, y_2 = squares(-e_n * g_n)
    return x_1, x_2, y_1, y_2, weight / weight.sum()


def _half_range() -> tuple[Array, Array]:
    """Nodes and weights for y exp(-y^2/2) on y > 0: Gauss and Legendre's up to 12, beyond which there is 1e-31."""
    node, weight = np.polynomial.legendre.leggauss(60)
    y = 6.0 * (node + 1.0)
    return y, 6.0 * weight * y * np.exp(-0.5 * y**2)
