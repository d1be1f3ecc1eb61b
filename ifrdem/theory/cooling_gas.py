"""Kinetic theory of a homogeneous gas of equal disks: how it cools.

Enskog's picture: before they touch, two disks are uncorrelated but for the crowding factor g, their
velocities and spins are Gaussian with temperatures T = m <v^2> / 2 and T_rot = I <w^2> (energies, k_B = 1),
and nothing depends on the place. A gas that cools leaves this picture after some collisions per disk: density
and velocity patterns grow, spins correlate with velocities, and tails become heavier than Gaussian.

Symbols: m mass, R radius, sigma = 2 R, I = m R^2 / k, phi packing fraction.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from ..errors import InputError, TheoryError
from ..model.laws.law import CollisionLaw
from ..tools.checked import (
    Array,
    Fraction,
    NonNegative,
    NonNegativeArray,
    NonNegativeColumn,
    Positive,
    PositiveArray,
    TangentialRestitution,
    validated,
)
from .collisions import Collider, KineticLaw, collision_rate, energy_changes, slip_coefficients
from .contact import PackingFraction


@validated
def changes_per_collision(theta: NonNegativeArray, law: KineticLaw, k: Positive) -> tuple[Array, Array]:
    """Relative changes (dT / T, dT_rot / T) per collision of a disk, at theta = T_rot / T.

    Derived in `cooling_rates`.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    >>> [float(change) for change in theory.changes_per_collision(0.5, law, 2.0)]
    [0.0, 0.0]
    """
    return changes(np.asarray(theta, dtype=np.float64), law, k)


def changes(theta: float | Array, law: CollisionLaw, k: float) -> tuple[Array, Array]:
    """As `changes_per_collision`, unchecked: theta grows without end in gases that keep their spins."""
    disk = Collider(1.0, k, 1.0, np.asarray(theta, dtype=np.float64))
    translation, rotation = energy_changes(law, disk, disk)
    return translation, 2.0 * rotation  # energies T and T_rot / 2


@validated
def cooling_rates(
    T: PositiveArray,
    T_rot: NonNegativeArray,
    *,
    law: KineticLaw,
    mass: Positive,
    radius: Positive,
    k: Positive,
    number_density: NonNegative,
) -> tuple[Array, Array]:
    r"""Rates (dT/dt, dT_rot/dt) [energy/time] at which a homogeneous gas of equal disks cools.

    InputError if the law has rolling friction, a property is not positive, or T <= 0 or T_rot < 0.

    Parameters
    ----------
    T, T_rot : array_like
        Translational and rotational temperature, m <v^2> / 2 and I <w^2> [energy]; shapes that broadcast.
    law : IFRLaw
        The collision law, without rolling friction.
    mass, radius, k, number_density : float
        Of one disk [mass], [length], I = m R^2 / k; disks per area [1/length^2].

    Notes
    -----
    `collisions` gives what a collision changes. For equal disks m_n = m/2, V = 2 T / m and a_i = 1/2; with
    theta = T_rot / T, S = 1 + k theta, c = 1/2 (percussion centre) or 1 / (1 + k) (contact point), and halves of its
    averages, gamma = c/2, eta = h/2 = (1 + e_t) / (2 (1 + k)),

        kappa = mu (1 + e_n) / (c sqrt(S)),  J_1 = kappa / sqrt(1 + kappa^2),  J_2 = 2 kappa^2 (1 - J_1),
        A = eta + gamma J_1,   B = eta^2 + 2 eta gamma J_1 + gamma^2 J_2.

    Each disk collides at the rate nu and has the energies T and T_rot / 2:

        dT/dt = (nu/2) T [-(1 - e_n^2) - 2 A + 2 S B],   dT_rot/dt = 2 k nu T [S B - theta A].

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> law = IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    >>> dT, dT_rot = theory.cooling_rates(1.0, 0.5, law=law, mass=1.0, radius=0.5, k=2.0, number_density=0.1)
    >>> float(dT), float(dT_rot)
    (0.0, 0.0)
    """
    translational = np.asarray(T, dtype=np.float64)
    rotational = np.asarray(T_rot, dtype=np.float64)
    try:
        np.broadcast_shapes(translational.shape, rotational.shape)
    except ValueError:
        raise InputError(
            f"T_rot has shape {rotational.shape}: must be one that broadcasts with that of T, {translational.shape}"
        ) from None
    rate = collision_rate(number_density * math.pi * radius**2, 1.0, mass, radius) * np.sqrt(translational)
    translation, rotation = changes(rotational / translational, law, k)
    return rate * translational * translation, rate * translational * rotation


@validated
def checked_times(times: NonNegativeColumn) -> Array:
    """Times [time] as an array of shape (steps,); InputError unless they are finite, 0 or more, and do not decrease.

    Examples
    --------
    >>> from ifrdem import theory
    >>> theory.checked_times([0.0, 1.0])
    array([0., 1.])
    >>> theory.checked_times([0.0, -1.0])
    Traceback (most recent call last):
        ...
    ifrdem.errors.InputError: times[1] = -1.0: must be 0, or from 1e-50 to 1e+50
    """
    when = np.asarray(times, dtype=np.float64)
    if np.any(falling := np.diff(when) < 0.0):
        i = int(np.argmax(falling)) + 1
        raise InputError(f"times[{i}] = {when[i]}: must be in increasing order, but follows {when[i - 1]}")
    return when


MOST_CALLS = 10_000
"""Calls of a slope that one integration may take: hundreds are needed, also where rates differ by nine decades; of some
that differ by more it would never end."""


def integrated(
    slope: Callable[..., Sequence[float] | Array], start: Sequence[float] | Array, at: Array, what: str,
    *, rtol: float = 1e-9, atol: float = 1e-12,
) -> Array:  # fmt: skip
    """Solution of dy/dt = slope(t, y) at times (steps,), y = start at 0, by LSODA; shape (unknowns, steps).

    Times do not decrease; equal ones have equal rows.

    TheoryError if the equations of `what` cannot be integrated, or take more than `MOST_CALLS` calls of `slope`.
    """
    from scipy.integrate import solve_ivp

    calls = itertools.count(1)

    def counted(t: float, y: Array) -> Sequence[float] | Array:
        if next(calls) > MOST_CALLS:
            raise TheoryError(
                f"the equations of the {what} take more than {MOST_CALLS} steps until the last of the times; end "
                "earlier, or choose temperatures and rates that differ less"
            )
        return slope(t, y)

    with warnings.catch_warnings(action="ignore", category=UserWarning):  # `success` and `message` say it
        span = (0.0, max(float(at[-1]), 1e-300))
        times, row = np.unique(at, return_inverse=True)  # solve_ivp wants each once
        found = solve_ivp(counted, span, start, method="LSODA", t_eval=times, rtol=rtol, atol=atol)
    if not found.success:
        raise TheoryError(f"the equations of the {what} could not be integrated: {found.message}")
    return np.asarray(found.y[:, row])


def cooled(slope: Callable[[Array], Array], start: Array, x: Array) -> Array:
    """Solution of dy/dx = slope(y) at x (steps,), y = start at x = 0; shape (unknowns, steps).

    Integrated over ln(1 + x), x being time in units of the first mean free time: temperatures fall like powers of time
    and collisions grow like its logarithm, so that a decade of time takes a bounded number of steps.
    """
    return integrated(lambda s, y: math.exp(s) * slope(y), start, np.log1p(x), "cooling gas", rtol=1e-10)


@validated
def cooling(
    law: KineticLaw,
    mass: Positive,
    radius: Positive,
    k: Positive,
    packing_fraction: PackingFraction,
    T0: Positive,
    T_rot0: NonNegative,
    times: NonNegativeColumn,
) -> tuple[Array, Array, Array]:
    """Temperatures of a homogeneous gas of equal disks as it cools: `cooling_rates` integrated.

    InputError as `cooling_rates`, or if the times decrease or are negative.

    Parameters
    ----------
    law, mass, radius, k
        As for `cooling_rates`.
    packing_fraction, T0, T_rot0 : float
        Part of the area that the disks cover; temperatures at time 0, T0 > 0 and T_rot0 >= 0 [energy].
    times : array_like (steps,)
        Times since the start [time], 0 or more and not decreasing.

    Returns
    -------
    T, T_rot, collisions_per_disk : arrays (steps,)
        [energy], [energy], and the collisions each disk has had on average (each pair's counts for both).

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> law = IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)
    >>> T, T_rot, collisions_per_disk = theory.cooling(law, 1.0, 0.5, 2.0, 0.1, 1.0, 0.0, [0.0, 10.0])
    >>> T.round(3), T_rot
    (array([1.   , 0.637]), array([0., 0.]))
    """
    when = checked_times(times)
    rate0 = collision_rate(packing_fraction, T0, mass, radius)
    if len(when) == 0 or when[-1] == 0.0 or rate0 == 0.0:
        return np.full(len(when), T0), np.full(len(when), T_rot0), np.zeros(len(when))

    def slope(y: Array) -> Array:
        """Derivatives of ln(T/T0), theta and collisions per disk by rate0 t."""
        log_T, theta, _collisions = y
        translation, rotation = changes(max(theta, 0.0), law, k)
        return math.exp(0.5 * log_T) * np.array([translation, rotation - theta * translation, 1.0])

    log_T, theta, collisions = cooled(slope, np.array([0.0, T_rot0 / T0, 0.0]), rate0 * when)
    T = T0 * np.exp(log_T)
    return T, theta * T, collisions


_STEP = 0.35
"""Step of `cooling_until`, as a fraction of the collisions in which temperatures change."""
_SETTLED = 1e-10
_MOST = 200.0  # of |ln(T/T0)|


def cooling_until(
    law: CollisionLaw, k: float, theta0: float, *, collisions: float = math.inf, time: float = math.inf
) -> tuple[float, float]:
    """Collisions per disk and time, over 1 / (initial collision rate), at which a cooling gas reaches either limit.

    For estimates: to 1e-5, in milliseconds. A Runge-Kutta method integrates over collisions per disk, in which the
    equations are not stiff. Once theta = T_rot / T is constant, each collision removes the same fraction of T (Haff's
    law), and the rest has a closed form. The time is infinite if T first falls to e^-200 of its initial value.
    `theta0` is the initial theta.
    """

    def slope(y: Array) -> Array:
        """Derivatives of ln(T/T0), theta and time by collisions per disk."""
        theta = min(max(float(y[1]), 0.0), 1e100)
        translation, rotation = changes(theta, law, k)
        return np.array([translation, rotation - theta * translation, math.exp(-0.5 * y[0])])

    def later(y: Array, first: Array, step: float) -> Array:
        second = slope(y + 0.5 * step * first)
        third = slope(y + 0.5 * step * second)
        fourth = slope(y + step * third)
        return y + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)

    done, y = 0.0, np.array([0.0, theta0, 0.0])
    while True:
        if abs(y[0]) > _MOST:
            return collisions, math.inf
        now, near = slope(y), 1e-6 * (1.0 + y[1])
        shifted = slope(np.array([y[0], y[1] + near, y[2]]))
        relaxation = abs(float(shifted[1] - now[1])) / near + abs(float(now[0]))
        if abs(now[1]) <= _SETTLED * relaxation * (1.0 + y[1]):
            break
        step = min(_STEP / (relaxation + abs(float(now[1])) / (1.0 + y[1])), collisions - done)
        new = later(y, now, step)
        if new[2] >= time:
            for _ in range(6):  # Newton's method for the step that ends there
                step -= (new[2] - time) / math.exp(-0.5 * new[0])
                new = later(y, now, step)
            return done + step, time
        done, y = done + step, new
        if done >= collisions:
            return collisions, float(y[2])
    # Relative growth of 1 / speed in each collision.
    growth, pace = -0.5 * float(now[0]), float(now[2])
    if math.isinf(time):
        left = collisions - done
        grown = math.expm1(min(growth * left, 700.0)) / growth if growth else left
        return collisions, float(y[2]) + pace * grown
    left = (time - float(y[2])) / pace
    return done + (math.log1p(growth * left) / growth if growth else left), time


@validated
def haff_time(e_n: Fraction, rate0: Positive) -> float:
    """Haff's time t_H [time] of smooth equal disks, 4 / ((1 - e_n^2) rate0): infinite for elastic ones.

    Each collision of a disk takes (1 - e_n^2) / 2 of its temperature, at a rate nu = rate0 sqrt(T / T0): dT/dt = -(1 -
    e_n^2) nu T / 2, of which T0 / (1 + t / t_H)^2 is the solution. P. K. Haff, J. Fluid Mech. 134, 401 (1983).

    Parameters
    ----------
    rate0 : float
        Collisions per disk and time at time 0 [1/time], from `collision_rate`.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.haff_time(0.9, 1.0), 6)  # 4 / ((1 - e_n^2) rate0)
    21.052632
    """
    return math.inf if e_n == 1.0 else 4.0 / ((1.0 - e_n**2) * rate0)


@validated
def haff(T0: Positive, e_n: Fraction, rate0: Positive, times: NonNegativeArray) -> Array:
    """Temperature of smooth equal disks [energy]: Haff's law T0 / (1 + t / t_H)^2, shape of `times`.

    The special case mu = 0, e_t = -1 of `cooling_rates`; t_H and rate0 as in `haff_time`.

    Examples
    --------
    >>> from ifrdem import theory
    >>> theory.haff(1.0, 0.9, 1.0, [0.0, theory.haff_time(0.9, 1.0)])
    array([1.  , 0.25])
    """
    return T0 / (1.0 + np.asarray(times, dtype=np.float64) / haff_time(e_n, rate0)) ** 2


@validated
def rough_rates(
    theta: NonNegativeArray, e_n: Fraction, beta: TangentialRestitution, k: Positive
) -> tuple[Array, Array]:
    """(dT / T, dT_rot / T) per collision of disks of constant roughness beta, at theta = T_rot / T.

    Every collision reverses the slip to -beta times itself: the limit mu -> infinity of the law that sticks at the
    contact point, with beta = 1 + e_t. With P_t = m q g_t, q = (1 + beta) / (2 (1 + k)), the averages over colliding
    pairs <g_t^2> = 2 (T + k T_rot) / m, <g_t v_t> = 2 T / m and <g_t R (w_i + w_j)> = 2 k T_rot / m, the pair's motion
    gains P_t^2/m - P_t v_t and its spins k P_t^2/m - P_t R (w_i + w_j) in addition to the normal loss (1 - e_n^2) T.
    These are the equations of S. Luding, M. Huthmann, S. McNamara and A. Zippelius, Phys. Rev. E 58, 3416 (1998).

    Examples
    --------
    >>> from ifrdem import theory
    >>> [float(rate) for rate in theory.rough_rates(1.0, 1.0, 1.0, 2.0)]  # perfectly rough, at equipartition
    [0.0, 0.0]
    """
    theta = np.asarray(theta, dtype=np.float64)
    q = (1.0 + beta) / (2.0 * (1.0 + k))
    translation = -0.5 * (1.0 - e_n**2) + q**2 * (1.0 + k * theta) - q
    rotation = 2.0 * k * (q**2 * (1.0 + k * theta) - q * theta)
    return translation, rotation


class CoolingRatio(NamedTuple):
    """A ratio theta = T_rot / T that stays constant in a cooling gas."""

    theta: float
    stable: bool  # True if nearby ratios tend to it, False if they go away from it


@validated
def cooling_ratios(law: KineticLaw, k: Positive) -> tuple[CoolingRatio, ...]:
    r"""All constant ratios theta = T_rot / T > 0 of a cooling gas, increasing; none for smooth disks.

    A gas may have two stable ones with an unstable one between: to which it tends depends on its start
    (`cooling_ratio`). In simulations of some laws spins get tails that are heavier than Gaussian, and another theta.
    InputError as `cooling_rates`.

    Notes
    -----
    In the symbols of `cooling_rates` let f = mu (1 + e_n) / c and S = r^2 - f^2, so that J_1 = f / r. With d = r - f,
    theta changes at a rate that is, times r, a polynomial in d, because S = d (d + 2 f) and

        r A = gamma f + eta r,    r S B = S (eta^2 r + 2 eta gamma f) + 2 gamma^2 f^2 d.

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import theory
    >>> coin = ifrdem.coins["1 pta"]
    >>> [(round(found.theta, 3), found.stable) for found in theory.cooling_ratios(coin.law, coin.k)]
    [(0.619, True)]
    """
    h, c = slip_coefficients(law, 1.0 / (1.0 + k))
    eta, gamma, f = 0.5 * float(h), 0.5 * float(c), law.mu * (1.0 + law.e_n) / float(c)
    d = Polynomial([0.0, 1.0 / (1.0 + f)])  # of order 1, however large f
    r, S = d + f, d * (d + 2.0 * f)
    theta = (S - 1.0) / k
    A = gamma * f + eta * r
    SB = S * (eta**2 * r + 2.0 * eta * gamma * f) + 2.0 * (gamma * f) ** 2 * d
    change = 2.0 * k * (SB - theta * A) - theta * (-0.5 * (1.0 - law.e_n**2) * r - A + SB)
    if not np.any(change.coef):
        return ()
    roots = change.trim().roots()
    real = np.sort(roots.real[(roots.imag == 0.0) & (roots.real > 0.0)])
    found = [(float(theta(one)), bool(change.deriv()(one) < 0.0)) for one in real]
    return tuple(CoolingRatio(*one) for one in found if one[0] > 1e-12)


@validated
def cooling_ratio(law: KineticLaw, k: Positive, theta0: NonNegative) -> float:
    """The asymptotic T_rot / T of a cooling gas that starts with theta0; inf if T decays faster than T_rot.

    InputError as `cooling_ratios`, or if theta0 is not a finite number of 0 or more.

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import theory
    >>> coin = ifrdem.coins["1 pta"]
    >>> round(theory.cooling_ratio(coin.law, coin.k, 0.0), 3)
    0.619
    """
    ratios = [one.theta for one in cooling_ratios(law, k)]
    translation, rotation = (float(one) for one in changes(theta0, law, k))
    rising = rotation - theta0 * translation
    if rising == 0.0:
        return theta0
    if rising > 0.0:
        return min((one for one in ratios if one > theta0), default=math.inf)
    return max((one for one in ratios if one < theta0), default=0.0)
