"""A disk on a table, by other means than `kernels/forces/table_friction.py`: quadrature, and SciPy's integrator.

Speeds and lengths are reduced: mu_s g = 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...tools.checked import Array


def friction_by_quadrature(eps: float) -> tuple[float, float]:
    """F and T at eps > 0, not 1, by integrals over one angle.

    The disk (radius 1) turns about a point C at the distance eps from its centre, and every element is dragged
    at right angles to its line to C. In polar coordinates (r, phi) about C, phi from the direction of the
    centre, the force is cos(phi) r dr dphi / pi and its moment about the centre (r - eps cos(phi)) r dr dphi /
    pi; both integrate over r at once, from one side of the rim to the other.
    """
    from scipy.integrate import quad

    def rim(phi: float) -> tuple[float, float]:
        root = np.sqrt(max(1.0 - (eps * np.sin(phi)) ** 2, 0.0))
        near = eps * np.cos(phi) - root
        return (near if eps > 1.0 else 0.0), eps * np.cos(phi) + root

    def force(phi: float) -> float:
        near, far = rim(phi)
        return float(np.cos(phi) * (far**2 - near**2) / 2.0)

    def moment(phi: float) -> float:
        near, far = rim(phi)
        return float((far**3 - near**3) / 3.0 - eps * np.cos(phi) * (far**2 - near**2) / 2.0)

    end = np.pi if eps < 1.0 else float(np.arcsin(1.0 / eps))
    options = {"epsabs": 1e-12, "epsrel": 1e-12, "limit": 200}
    F, T = (2.0 * quad(f, 0.0, end, **options)[0] / np.pi for f in (force, moment))
    return F, T


def friction(eps: float) -> tuple[float, float]:
    """F and T at eps > 0 by SciPy's elliptic integrals of parameter m (the formulas of Farkas et al., 2003)."""
    from scipy.special import ellipe, ellipkm1

    m = min(eps, 1.0 / eps) ** 2
    one_minus_m = abs(1.0 - eps) * (1.0 + eps) / max(eps, 1.0) ** 2
    E, K = ellipe(m), ellipkm1(max(one_minus_m, 1e-300))  # at eps = 1 K only appears as 0 K
    e2 = eps * eps
    if eps <= 1.0:
        F = 4.0 / (3.0 * np.pi * eps) * ((e2 + 1.0) * E + (e2 - 1.0) * K)
        T = 4.0 / (9.0 * np.pi) * ((4.0 - 2.0 * e2) * E + (e2 - 1.0) * K)
    else:
        F = 4.0 / (3.0 * np.pi) * ((e2 + 1.0) * E - (e2 - 1.0) * K)
        T = 4.0 * eps / (9.0 * np.pi) * ((4.0 - 2.0 * e2) * E + (2.0 * e2 - 5.0 + 3.0 / e2) * K)
    return float(F), float(T)


def fly(v: float, u: float, k: float, duration: float = np.inf) -> tuple[float, float, float, float]:
    """Speed v and rim speed u > 0 after `duration`, or at rest; and the distance and time moved.

    SciPy's DOP853 in the plain variables, with tolerances of 1e-12; rest is where v + u has fallen to 1e-7 of
    its start, which leaves out 1e-14 of the distance and 1e-7 of the time.
    """
    from scipy.integrate import solve_ivp

    def rates(_: float, y: Array) -> list[float]:
        F, T = friction(min(max(y[0], 1e-12) / max(y[1], 1e-12), 1e6))
        return [-F, -k * T, y[0]]

    def nearly_at_rest(_: float, y: Array) -> float:
        return float(y[0] + y[1] - 1e-7 * (v + u))

    nearly_at_rest.terminal = True  # type: ignore[attr-defined]
    end = min(duration, 2.0 * (v + u))  # d(v + u)/dt is -F - k T, -0.8 or less for k of 1 and more
    found = solve_ivp(
        rates, (0.0, end), [v, u, 0.0], method="DOP853", rtol=1e-12, atol=1e-15, events=nearly_at_rest
    )
    at_rest = len(found.t_events[0]) > 0
    v_end, u_end, x = (float(value) for value in found.y[:, -1])
    return (0.0 if at_rest else v_end), (0.0 if at_rest else u_end), x, float(found.t[-1])


def stopping_distance(v: ArrayLike, u: ArrayLike, k: float = 2.0) -> Array:
    """Distances to rest, by `fly`; arrays of speeds v and rim speeds, whose sign does not matter, shape (n,)."""
    return np.array([fly(one_v, max(abs(one_u), 1e-12), k)[2] for one_v, one_u in np.broadcast(v, u)])


def common_ratio(k: float = 2.0) -> float:
    """eps at which v and u fall in proportion, F = k T eps: every flight ends there (0.653 for k = 2)."""
    from scipy.optimize import brentq

    def off(eps: float) -> float:
        F, T = friction(eps)
        return F - k * T * eps

    return float(brentq(off, 0.1, 0.99, xtol=1e-14))
