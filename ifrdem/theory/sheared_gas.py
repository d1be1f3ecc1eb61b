r"""Kinetic theory of a sheared gas of equal disks: how its temperatures evolve, and where they stay.

Grad's moment method for uniform shear flow u_x = g y, in the mean flow's frame, with p_ij = m <V_i V_j> (per disk), the
temperature T = (p_xx + p_yy) / 2 and collisions that take -z nu of T and -l nu of what is not isotropic in p_ij:

    dT/dt    = -g p_xy             - z nu T,
    dp_yy/dt = -l nu (p_yy - T)    - z nu T,
    dp_xy/dt = -g p_yy - l nu p_xy,
    dT_rot/dt as in a cooling gas,

nu being the collision rate of a disk. In the steady state nu^2 = g^2 (1 - z/l) / (l z). For smooth disks
z = (1 - e_n^2)/2 and l = (1 + e_n)(7 - 3 e_n)/8, which is the result of A. Santos, V. Garzo and J. W. Dufty, Phys.
Rev. E 69, 061303 (2004), in two dimensions. z is that of `theory.cooling_rates`; l is
derived at `relaxation`.

Crowding enters as in Enskog's theory of nearly elastic disks (J. T. Jenkins, M. W. Richman, Phys. Fluids 28, 3485
(1985)): the kinetic stress is driven, and passed on, 1 + (1 + e_n) phi chi / 2 times as much, and
touching disks pass on (8/pi) phi^2 chi times the dilute viscosity; chi is the contact value.

Assumed: homogeneous, of zeroth and first order in the anisotropy, no correlations between velocities and spins. The
mean spin of a sheared gas, -g/2, is left out of T_rot: it is small where disks meet a few times in 1/g.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ..errors import InputError, TheoryError
from ..model.ifr import IFRLaw
from .collisions import collision_rate
from .contact import contact_value
from .cooling_gas import changes_per_collision, checked_times

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_HIGHEST = 7.0  # of a Gaussian variable, beyond which there is 1e-11 of it

MOST_CALLS = 10_000
"""Evaluations of the right-hand side that one integration may take; hundreds over nine decades of both rates."""


def _half_normal() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights of averages over the positive half of a normal variable, of total weight 1/2."""
    nodes = 0.5 * _HIGHEST * (_NODES + 1.0)
    return nodes, 0.5 * _HIGHEST * _WEIGHTS * np.exp(-0.5 * nodes**2) / math.sqrt(2.0 * math.pi)


def relaxation(theta: float, law: IFRLaw, k: float) -> float:
    r"""Rate l at which collisions make velocities isotropic, in units of the collision rate nu of a disk.

    Let the relative velocity (g_n, v_t) of the centres, in units of sqrt(2 T / m), be Gaussian with covariance
    1 + pi_ij, pi small and traceless. A collision changes m (v v) of both disks by (m/2) D, with

        D_nn = -(1 - e_n^2) g_n^2,  D_tt = 4 (p^2 - p v_t),  D_nt = -(1 + e_n) g_n v_t + 2 e_n g_n p,  p = P_t / m.

    pi weights pairs by pi_nn (g_n^2 - v_t^2)/2 + pi_nt g_n v_t. Averaged over the direction n, (n n - t t) pi_nn and
    (n t + t n) pi_nt both give pi_ij / 2, so that with the rate of collisions, proportional to g_n > 0,

        l = -(sqrt(2 pi) / 4) < g_n [ (D_nn - D_tt)(g_n^2 - v_t^2)/4 + D_nt g_n v_t ] >_(g_n > 0).

    The slip of the contact points is sqrt(S) u, u normal, S = 1 + k theta; given it, v_t is Gaussian with mean
    u/sqrt(S) and variance 1 - 1/S. P_t is as at `theory.cooling_rates`.

    Parameters
    ----------
    theta : float
        T_rot / T.
    law : IFRLaw
        Without rolling friction.
    k : float
        Shape number in I = m R^2 / k.
    """
    e, S = law.e_n, 1.0 + k * theta
    c = {"percussion_center": 0.5, "contact_point": 1.0 / (1.0 + k)}[law.sticking]
    eta, gamma = (1.0 + law.e_t) / (2.0 * (1.0 + k)), 0.5 * c
    nodes, weights = _half_normal()
    y, u = nodes[:, None], nodes[None, :]
    weight = 2.0 * weights[:, None] * weights[None, :]  # both signs of u give the same
    p = eta * math.sqrt(S) * u + gamma * np.minimum(math.sqrt(S) * u, law.mu * (1.0 + e) * y / c)
    a, q = u / math.sqrt(S), 1.0 - 1.0 / S  # mean and variance of v_t
    v2 = a**2 + q
    normal = -(1.0 - e**2) * y**2 * (y**2 - v2)
    tangential = 4.0 * p * (a * y**2 - a**3 - 3.0 * a * q) - 4.0 * p**2 * (y**2 - v2)
    mixed = y**2 * (-(1.0 + e) * v2 + 2.0 * e * p * a)
    average = float(np.sum(weight * y * (0.25 * (normal + tangential) + mixed)))
    return -math.sqrt(2.0 * math.pi) / 4.0 * average


def crowding(packing_fraction: float, e_n: float) -> tuple[float, float]:
    """By how much more kinetic stress counts, and what touching disks add to it in units of g T / nu.

    Multiply kinetic stress by the first when it is driven and when it is passed on; see the module's text.
    """
    crowd = packing_fraction * contact_value(packing_fraction)
    return 1.0 + 0.5 * (1.0 + e_n) * crowd, 0.5 * (1.0 + e_n) * (8.0 / math.pi) * crowd**2


def _check(law: IFRLaw, shear_rate: float) -> None:
    if law.rho != 0.0:
        raise InputError(f"rho = {law.rho}: the kinetic theory knows no rolling friction, only rho = 0")
    if not (math.isfinite(shear_rate) and shear_rate != 0.0):
        raise InputError(f"shear_rate = {shear_rate}: a finite number other than 0 is needed")


def steady_state(
    law: IFRLaw, mass: float, radius: float, k: float, packing_fraction: float, shear_rate: float
) -> tuple[float, float] | None:
    """T and T_rot [energy] at which a sheared gas stays; None where it goes on heating, as elastic disks do.

    T_rot is nan for smooth disks, whose spins nothing changes.

    Parameters
    ----------
    law, mass, radius, k, packing_fraction
        As for `theory.cooling`.
    shear_rate : float
        [1/time].

    Raises
    ------
    InputError
        If the law has rolling friction, the shear rate is 0 or a property is not positive.
    """
    _check(law, shear_rate)
    nu = collision_rate(packing_fraction, 1.0, mass, radius)  # at T = 1
    smooth = law.mu == 0.0 and law.e_t == -1.0
    theta = 0.0 if smooth else _steady_theta(law, k)
    if theta is None:
        return None
    z = -float(changes_per_collision(np.asarray(theta), law, k)[0])
    ell = relaxation(theta, law, k)
    if not 0.0 < z < ell:
        return None
    more, contact = crowding(packing_fraction, law.e_n)
    T = shear_rate**2 * (more**2 * (1.0 - z / ell) / ell + contact) / (z * nu**2)
    return T, math.nan if smooth else theta * T


def _steady_theta(law: IFRLaw, k: float) -> float | None:
    """T_rot / T at which collisions leave T_rot alone while T is held; None if there is none up to 1e6."""

    def rotation(log_theta: float) -> float:
        return float(changes_per_collision(np.asarray(math.exp(log_theta)), law, k)[1])

    low, high = -30.0, math.log(1e6)
    if rotation(low) <= 0.0 or rotation(high) >= 0.0:
        return None
    return math.exp(brentq(rotation, low, high, xtol=1e-12))


def sheared(
    law: IFRLaw,
    mass: float,
    radius: float,
    k: float,
    packing_fraction: float,
    shear_rate: float,
    T0: float,
    T_rot0: float,
    times: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Temperatures of a gas of equal disks, isotropic at time 0, from when its flow begins.

    Parameters
    ----------
    law, mass, radius, k, packing_fraction, T0, T_rot0, times
        As for `theory.cooling`.
    shear_rate : float
        [1/time].

    Returns
    -------
    T, T_rot, collisions_per_disk : arrays (steps,)
        [energy], [energy], and the collisions that each disk has had on average.

    Raises
    ------
    InputError
        As `steady_state`, or if T0 is not positive, T_rot0 negative, or the times decrease or are negative.
    TheoryError
        If the equations cannot be integrated: shear and collision rates differ by too many orders of magnitude.
    """
    _check(law, shear_rate)
    when = checked_times(times)
    if not (math.isfinite(T0) and T0 > 0.0 and math.isfinite(T_rot0) and T_rot0 >= 0.0):
        raise InputError(f"T0 = {T0}, T_rot0 = {T_rot0}: T0 > 0 and T_rot0 >= 0 are needed")
    if len(when) == 0 or when[-1] == 0.0:
        return np.full(len(when), T0), np.full(len(when), T_rot0), np.zeros(len(when))
    nu0 = collision_rate(packing_fraction, T0, mass, radius)
    more, contact = crowding(packing_fraction, law.e_n)
    g, calls = shear_rate, 0

    def slope(_: float, y: NDArray[np.float64]) -> tuple[float, ...]:
        """Of T, p_yy, p_xy, T_rot in units of T0, and collisions."""
        nonlocal calls
        calls += 1
        if calls > MOST_CALLS:
            raise TheoryError(
                f"the equations of the sheared gas take more than {MOST_CALLS} steps: shear rate {g:g}, collision rate "
                f"{nu0:g} at the start, time {when[-1]:g}"
            )
        T, p_yy, p_xy, T_rot, _collisions = y
        T = max(T, 1e-12)
        nu = nu0 * math.sqrt(T)
        theta = max(T_rot, 0.0) / T
        change, turn = (float(one) for one in changes_per_collision(np.asarray(theta), law, k))
        ell = relaxation(theta, law, k)
        stress = more * p_xy - contact * g * T / nu
        return (
            -g * stress + nu * change * T,
            -ell * nu * (p_yy - T) + nu * change * T,
            -g * more * p_yy - ell * nu * p_xy,
            nu * turn * T,
            nu,
        )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # `success` and `message` say the same
        solution = solve_ivp(
            slope,
            (0.0, when[-1]),
            (1.0, 1.0, 0.0, T_rot0 / T0, 0.0),
            method="LSODA",
            t_eval=when,
            rtol=1e-8,
            atol=1e-10,
        )
    if not solution.success:
        raise TheoryError(f"the equations of the sheared gas could not be integrated: {solution.message}")
    T, _, _, T_rot, collisions = solution.y
    return T0 * T, T0 * T_rot, collisions
