"""Other collision laws, for comparison with IFR: constant tangential restitution, and springs in time.

Both are for two equal homogeneous disks, disk 2 at rest, as in Fig. 5.

- Constant restitution of the slip up to Coulomb's limit: O. R. Walton, in Particulate Two-Phase Flow (1993);
  P_t = min(mu P_n, (1 + beta) m_t g_t), m_t = m_n / 3 for homogeneous disks.
- Hertz's normal and Mindlin's tangential spring with Coulomb's limit, the usual contact of discrete element
  codes (K. L. Johnson, Contact Mechanics (1985), chap. 7 and 11; damping by Y. Tsuji, T. Tanaka, T. Ishida,
  Powder Technol. 71, 239 (1992), doi:10.1016/0032-5910(92)88030-L).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...tools.checked import Array


class Spring(NamedTuple):
    """Outcome of a contact with springs: tan(delta_2) = P_t / P_n, and e_n = -(normal velocity after) / before."""

    tan_delta_2: Array
    e_n: Array


def walton_tan_delta_2(psi: Array, e_n: float, mu: float, beta: float) -> Array:
    """tan(delta_2) = P_t / P_n of Walton's law with restitution `beta` of the slip."""
    return np.minimum(mu, (1.0 + beta) / (3.0 * (1.0 + e_n)) * np.tan(psi))


def hertz_mindlin(psi: Array, e_n: float, mu: float, *, poisson: float = 0.33, steps: int = 800) -> Spring:
    """Integrate contacts with Hertz's and Mindlin's springs in time.

    Units: effective mass m_n = 1, v_o = 1 and Hertz's stiffness 1: F_n = d^(3/2) + damping. Mindlin's
    tangential stiffness is 2 (1 - nu) / (2 - nu) of the normal one, 3/2 sqrt(d): the two springs of equal
    spheres. Semi-implicit Euler steps of 1/`steps` of a contact: errors of order 1/`steps`.
    """
    # Tsuji's damping ratio as a function of e_n, fitted there graphically: here the value that gives it.
    damping = _damping(e_n, steps)
    return _integrate(psi, mu, damping, 2.0 * (1.0 - poisson) / (2.0 - poisson), steps)


@lru_cache
def _damping(e_n: float, steps: int) -> float:
    from scipy.optimize import brentq

    head_on = np.zeros(1)
    return float(brentq(lambda a: float(_integrate(head_on, 0.0, a, 1.0, steps).e_n[0]) - e_n, 0.0, 1.0))


def _integrate(psi: Array, mu: float, damping: float, ratio: float, steps: int) -> Spring:
    v_n, slip = np.cos(psi), np.sin(psi)
    # A contact of F = d^(3/2) without damping lasts 3.21 (m^2 / v)^(1/5) (Johnson, Eq. 11.24).
    dt = 3.3 * np.cos(psi) ** -0.2 / steps
    d, stretch = np.zeros_like(psi), np.zeros_like(psi)
    P_n, P_t = np.zeros_like(psi), np.zeros_like(psi)
    touching = np.ones_like(psi, dtype=bool)
    for _ in range(3 * steps):
        d = np.where(touching, d + dt * v_n, d)
        depth = np.maximum(d, 0.0)
        # No pull: the contact ends when the force does.
        F_n = np.maximum(depth**1.5 + damping * depth**0.25 * v_n, 0.0)
        touching &= (F_n > 0.0) & (d > 0.0)
        if not touching.any():
            break
        stiffness = 1.5 * ratio * np.sqrt(depth)
        stretch = np.where(touching, stretch + dt * slip, stretch)
        F_t = stiffness * stretch
        limit = mu * F_n
        slides = np.abs(F_t) > limit
        F_t = np.where(slides, np.sign(F_t) * limit, F_t)
        # While it slides the spring is as long as Coulomb's law allows.
        stretch = np.where(
            slides & (stiffness > 0.0), F_t / np.where(stiffness > 0.0, stiffness, 1.0), stretch
        )
        F_n, F_t = np.where(touching, F_n, 0.0), np.where(touching, F_t, 0.0)
        v_n = v_n - dt * F_n
        slip = slip - dt * 3.0 * F_t  # m_t = m_n / 3
        P_n, P_t = P_n + dt * F_n, P_t + dt * F_t
    return Spring(P_t / P_n, -v_n / np.cos(psi))
