"""How often hard disks collide in a homogeneous gas whose velocities are Gaussian, and how far they fly between."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .contact import checked_packing_fraction, checked_positive, contact_value


def collision_rate(
    packing_fraction: float, T: float, mass: float, radius: float, g: float | None = None
) -> float:
    """Collisions per disk and time [1/time] of equal disks in equilibrium at temperature T [energy].

    A disk sees the others, with number density n, come from all directions: n g sigma times the integral of
    the mean approach speed over the angle, 2 pi <max(g_n, 0)>. One component of the relative velocity is
    Gaussian with variance 2 T / m, so <max(g_n, 0)> = sqrt(T / (pi m)), and with phi = pi n sigma^2 / 4 the
    rate is 8 phi g sqrt(T / (pi m)) / sigma.

    `g` is the pair correlation at contact; `contact_value(packing_fraction)` if not given.

    Raises
    ------
    InputError
        If T, mass or radius is not positive, or for an impossible packing fraction.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.collision_rate(0.1, 1.0, 1.0, 0.5, g=1.0), 4)  # 2 sigma n (pi T / m)^(1/2), n = 0.1 / (pi / 4)
    0.4514
    """
    checked_positive(T=T, mass=mass, radius=radius)
    phi = checked_packing_fraction(packing_fraction)
    crowding = contact_value(phi) if g is None else g
    return 8.0 * phi * crowding * math.sqrt(T / (math.pi * mass)) / (2.0 * radius)


def mean_free_path(packing_fraction: float, radius: float) -> float:
    """Mean speed over collision rate of equal disks in equilibrium [length]: pi sigma / (8 sqrt(2) phi g).

    The mean speed is sqrt(pi T / (2 m)). Infinite at packing fraction 0.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.mean_free_path(0.01, 0.5), 2)
    27.33
    """
    checked_positive(radius=radius)
    phi = checked_packing_fraction(packing_fraction)
    if phi == 0.0:
        return math.inf
    return math.pi * 2.0 * radius / (8.0 * math.sqrt(2.0) * phi * contact_value(phi))


def mixture_collision_rates(
    T: ArrayLike, mass: ArrayLike, radius: ArrayLike, number_density: ArrayLike, g: ArrayLike
) -> NDArray[np.float64]:
    """Collisions of a disk of species i with disks of species j per time [1/time], shape (s, s).

    As at `collision_rate`, with a relative velocity of variance V_ij = T_i/m_i + T_j/m_j and sigma_ij = R_i + R_j:
    n_j g_ij sigma_ij 2 pi sqrt(V_ij / (2 pi)).

    Parameters
    ----------
    T, mass, radius, number_density : array_like (s,)
        Temperatures m <v^2> / 2 [energy], masses [mass], radii [length], disks per area [1/length^2].
    g : array_like (s, s)
        Contact values (`mixture_contact_values`).

    Examples
    --------
    >>> from ifrdem import theory
    >>> chi = [[1.0, 1.0], [1.0, 1.0]]
    >>> theory.mixture_collision_rates([1.0, 1.0], [1.0, 4.0], [0.5, 1.0], [0.1, 0.05], chi).round(3)
    array([[0.354, 0.21 ],
           [0.42 , 0.177]])
    """
    R, n = np.asarray(radius, dtype=np.float64), np.asarray(number_density, dtype=np.float64)
    variance = np.asarray(T, dtype=np.float64) / np.asarray(mass, dtype=np.float64)
    relative = np.sqrt(2.0 * math.pi * (variance[:, None] + variance))
    return n * np.asarray(g, dtype=np.float64) * (R[:, None] + R) * relative
