"""Kinetic theory of a homogeneous gas of equal disks: collision rate, mean free path, cooling.

Enskog's picture: before they touch, two disks are uncorrelated but for the crowding factor g, their
velocities and spins are Gaussian with temperatures T = m <v^2> / 2 and T_rot = I <w^2> (energies, k_B = 1),
and nothing depends on the place. A gas that cools leaves this picture after some collisions per disk: density
and velocity patterns grow, spins correlate with velocities, and tails become heavier than Gaussian.

Symbols: m mass, R radius, sigma = 2 R, I = m R^2 / k, phi packing fraction.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from .errors import InputError

if TYPE_CHECKING:
    from .law import IFRLaw

VIRIAL = (
    1.0,
    4.0 / 3.0 - math.sqrt(3.0) / math.pi,
    2.0 - 9.0 * math.sqrt(3.0) / (2.0 * math.pi) + 10.0 / math.pi**2,
    0.33355604,
    0.1988425,
    0.1148728,
    0.0649930,
    0.0362193,
    0.0199537,
)
"""B_2 ... B_10 of hard disks, B_i / B_2^(i-1): Clisby and McCoy (2006), doi:10.1007/s10955-005-8080-0."""

# (1 - phi)^2 g as a series in 2 phi to the same order. g itself grows like (1 - phi)^-2, and its bare series
# is 1e-4 too small at phi = 0.3 and 3.5 % at 0.6; this product is almost constant and its series is not.
_RESUMMED = np.convolve(VIRIAL, (1.0, -1.0, 0.25))[: len(VIRIAL)]


def _packing_fraction(value: float) -> float:
    densest = math.pi / (2.0 * math.sqrt(3.0))
    if not 0.0 <= value <= densest:
        raise InputError(f"packing fraction = {value}: must lie between 0 and {densest:.4f}")
    return float(value)


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name} = {value}: a positive finite number is needed")


def contact_value(packing_fraction: float) -> float:
    """Pair correlation g of equal hard disks at contact: how much crowding raises the collision rate.

    From the virial series to the tenth coefficient, Z = 1 + sum B_i rho^(i-1) = 1 + 2 phi g. Known to about
    1e-5 at packing fraction 0.3 and 1e-4 at 0.5, if the spread of other resummations of the same series
    tells; near freezing (0.70) the real fluid orders and its g is smaller.

    Raises
    ------
    InputError
        If the packing fraction is not between 0 and 0.9069.
    """
    phi = _packing_fraction(packing_fraction)
    return float(np.polynomial.polynomial.polyval(2.0 * phi, _RESUMMED)) / (1.0 - phi) ** 2


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
    """
    _positive(T=T, mass=mass, radius=radius)
    phi = _packing_fraction(packing_fraction)
    crowding = contact_value(phi) if g is None else g
    return 8.0 * phi * crowding * math.sqrt(T / (math.pi * mass)) / (2.0 * radius)


def mean_free_path(packing_fraction: float, radius: float) -> float:
    """Mean speed over collision rate of equal disks in equilibrium [length]: pi sigma / (8 sqrt(2) phi g).

    The mean speed is sqrt(pi T / (2 m)). Infinite at packing fraction 0.
    """
    _positive(radius=radius)
    phi = _packing_fraction(packing_fraction)
    if phi == 0.0:
        return math.inf
    return math.pi * 2.0 * radius / (8.0 * math.sqrt(2.0) * phi * contact_value(phi))


def changes_per_collision(
    theta: NDArray[np.float64], law: IFRLaw, k: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Relative changes (dT / T, dT_rot / T) per collision of a disk, at theta = T_rot / T.

    Derived in `cooling_rates`.
    """
    S = 1.0 + k * theta
    c = {"percussion_center": 0.5, "contact_point": 1.0 / (1.0 + k)}[law.sticking]
    eta = (1.0 + law.e_t) / (2.0 * (1.0 + k))
    gamma = 0.5 * c
    kappa = law.mu * (1.0 + law.e_n) / (c * np.sqrt(S))
    root = np.sqrt(1.0 + kappa**2)
    J_1 = kappa / root
    J_2 = 2.0 * kappa**2 / (root * (root + kappa))  # = 2 kappa^2 (1 - J_1), without its cancellation
    A = eta + gamma * J_1
    B = eta**2 + 2.0 * eta * gamma * J_1 + gamma**2 * J_2
    translation = 0.5 * (-(1.0 - law.e_n**2) - 2.0 * A + 2.0 * S * B)
    rotation = 2.0 * k * (-theta * A + S * B)
    return translation, rotation


def _check(law: IFRLaw, mass: float, radius: float, k: float) -> None:
    _positive(mass=mass, radius=radius, k=k)
    if law.rho != 0.0:
        raise InputError(f"rho = {law.rho}: the kinetic theory knows no rolling friction, only rho = 0")


def cooling_rates(
    T: ArrayLike,
    T_rot: ArrayLike,
    *,
    law: IFRLaw,
    mass: float,
    radius: float,
    k: float,
    number_density: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r"""Rates (dT/dt, dT_rot/dt) [energy/time] at which a homogeneous gas of equal disks cools.

    Parameters
    ----------
    T, T_rot : array_like
        Translational and rotational temperature, m <v^2> / 2 and I <w^2> [energy]; shapes that broadcast.
    law : IFRLaw
        The collision law, without rolling friction.
    mass, radius, k : float
        Of one disk [mass], [length], I = m R^2 / k.
    number_density : float
        Disks per area [1/length^2].

    Raises
    ------
    InputError
        If the law has rolling friction, a property is not positive, or T <= 0 or T_rot < 0.

    Notes
    -----
    *The law for equal disks.* m_n = m/2 and m_t = m / (2 (1 + k)). With the approach speed g_n and the slip
    g_t of the contact points the impulses are, for both closures of the friction,

        P_n = (m/2) (1 + e_n) g_n
        P_t = m sign(g_t) [eta |g_t| + gamma min(|g_t|, mu (1 + e_n) g_n / c)],
        eta = (1 + e_t) / (2 (1 + k)),  gamma = c / 2,

    where sticking takes the impulse c m_n |g_t|: c = 1/2 for the percussion centre, 1 / (1 + k) for the
    contact point.

    *Averages.* Colliding pairs are weighted by g_n. With s^2 = 2 T / m, y = g_n / s then has the density
    y exp(-y^2/2), with <y^2> = 2. The slip is v_t + R (w_i + w_j), Gaussian with variance
    s^2 + 2 R^2 T_rot / I = s^2 S, S = 1 + k theta, theta = T_rot / T; call it s sqrt(S) u. The friction
    impulse is m gamma s sqrt(S) min(|u|, kappa y), kappa = mu (1 + e_n) / (c sqrt(S)). Since P(y > a) =
    exp(-a^2/2), the average over y of min(|u|, kappa y) is the integral of exp(-z^2 / (2 kappa^2)) from 0 to
    |u|, and likewise for its square with 2 z in the integrand. Averaging over the normal u,

        J_1 = <|u| min> = sqrt(2/pi) int_0^inf exp(-z^2 (1 + 1/kappa^2) / 2) dz = kappa / sqrt(1 + kappa^2)
        J_2 = <min^2> = int_0^inf 2 z exp(-z^2 / (2 kappa^2)) erfc(z / sqrt 2) dz = 2 kappa^2 (1 - J_1),

    so that <P_t g_t> = m s^2 S A and <P_t^2> = m^2 s^2 S B, with

        A = eta + gamma J_1,   B = eta^2 + 2 eta gamma J_1 + gamma^2 J_2.

    *Energy of the pair.* Its centres lose P_n g_n - P_n^2/m, on average (1 - e_n^2) T, and gain
    P_t^2/m - P_t v_t. Given the slip, the mean of v_t is g_t / S, so this is 2 T (S B - A). The spins change
    by -k P_t / (m R) each, and their energy by k P_t^2/m - P_t R (w_i + w_j); the mean of R (w_i + w_j) is
    g_t k theta / S, which gives 2 T k (S B - theta A).

    *Rates.* Each disk collides at the rate nu, a disk has half of a pair's change, and energies T and
    T_rot / 2:

        dT/dt = (nu/2) T [-(1 - e_n^2) - 2 A + 2 S B],   dT_rot/dt = 2 k nu T [S B - theta A].
    """
    _check(law, mass, radius, k)
    translational = np.asarray(T, dtype=np.float64)
    rotational = np.asarray(T_rot, dtype=np.float64)
    if not (np.all(translational > 0.0) and np.all(rotational >= 0.0)):
        raise InputError("temperatures: T > 0 and T_rot >= 0 are needed")
    rate = collision_rate(number_density * math.pi * radius**2, 1.0, mass, radius) * np.sqrt(translational)
    translation, rotation = changes_per_collision(rotational / translational, law, k)
    return rate * translational * translation, rate * translational * rotation


def checked_times(times: ArrayLike) -> NDArray[np.float64]:
    """Times [time] as an array of shape (steps,); InputError unless they are finite, 0 or more, and do not decrease."""
    when = np.asarray(times, dtype=np.float64)
    if when.ndim != 1 or not np.all(np.isfinite(when)) or np.any(np.diff(when, prepend=0.0) < 0.0):
        raise InputError("times: finite numbers of 0 or more in increasing order are needed, shape (steps,)")
    return when


def cooling(
    law: IFRLaw,
    mass: float,
    radius: float,
    k: float,
    packing_fraction: float,
    T0: float,
    T_rot0: float,
    times: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Temperatures of a homogeneous gas of equal disks as it cools: `cooling_rates` integrated.

    Parameters
    ----------
    law, mass, radius, k
        As for `cooling_rates`.
    packing_fraction : float
        Part of the area that the disks cover.
    T0, T_rot0 : float
        Temperatures at time 0, T0 > 0 and T_rot0 >= 0 [energy].
    times : array_like (steps,)
        Times since the start [time], 0 or more and not decreasing.

    Returns
    -------
    T, T_rot, collisions_per_disk : arrays (steps,)
        [energy], [energy], and the collisions each disk has had on average (each pair's counts for both).

    Raises
    ------
    InputError
        As `cooling_rates`, or if the times decrease or are negative.
    """
    _check(law, mass, radius, k)
    when = checked_times(times)
    if not (math.isfinite(T0) and T0 > 0.0 and math.isfinite(T_rot0) and T_rot0 >= 0.0):
        raise InputError(f"T0 = {T0}, T_rot0 = {T_rot0}: T0 > 0 and T_rot0 >= 0 are needed")
    rate0 = collision_rate(packing_fraction, T0, mass, radius)
    if len(when) == 0 or when[-1] == 0.0 or rate0 == 0.0:
        return np.full(len(when), T0), np.full(len(when), T_rot0), np.zeros(len(when))

    def slope(_: float, y: NDArray[np.float64]) -> tuple[float, float, float]:
        """Derivatives of ln(T/T0), theta and collisions per disk by rate0 t: all of order 1, over decades."""
        log_T, theta, _collisions = y
        translation, rotation = changes_per_collision(np.asarray(max(theta, 0.0)), law, k)
        speed = math.exp(0.5 * log_T)
        return speed * float(translation), speed * float(rotation - theta * translation), speed

    solution = solve_ivp(
        slope,
        (0.0, rate0 * when[-1]),
        (0.0, T_rot0 / T0, 0.0),
        method="DOP853",
        t_eval=rate0 * when,
        rtol=1e-10,
        atol=1e-12,
    )
    if not solution.success:
        raise RuntimeError(f"the cooling equations could not be integrated: {solution.message}")
    log_T, theta, collisions = solution.y
    T = T0 * np.exp(log_T)
    return T, theta * T, collisions


def haff(T0: float, e_n: float, rate0: float, times: ArrayLike) -> NDArray[np.float64]:
    """Temperature of smooth equal disks [energy]: Haff's law T0 / (1 + t / t_H)^2, shape of `times`.

    The special case mu = 0, e_t = -1 of `cooling_rates`: each collision of a disk takes (1 - e_n^2) / 2 of
    its temperature, at a rate that goes with sqrt(T); so 1 / t_H = (1 - e_n^2) rate0 / 4. Haff (1983),
    doi:10.1017/S0022112083003419.

    Parameters
    ----------
    rate0 : float
        Collisions per disk and time at time 0 [1/time], from `collision_rate`.
    """
    return T0 / (1.0 + 0.25 * (1.0 - e_n**2) * rate0 * np.asarray(times, dtype=np.float64)) ** 2
