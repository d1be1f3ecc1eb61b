r"""Kinetic theory of a sheared gas of equal disks: evolution and steady state of its temperatures.

Uniform shear flow u_x = g y. In the mean flow's frame velocities V are Gaussian with p_ij = m <V_i V_j>, which need not
be isotropic, and spins w Gaussian about their mean W, with tau = I <(w - W)^2>; T = (p_xx + p_yy) / 2 and
T_rot = tau + I W^2. Where two disks touch, the flow itself differs by g sigma n_y. With <...> the sum over the
collisions of a disk per time (`collisional_changes`),

    dp_xx/dt = -2 g p_xy + <d(m V_x V_x)>,    dp_yy/dt = <d(m V_y V_y)>,    dp_xy/dt = -g p_yy + <d(m V_x V_y)>,
    dW/dt = <dw>,    dT_rot/dt = <d(I w^2)>.

What touching disks pass on, and the heat that this makes of the flow, are in these averages, because a pair's relative
velocity has the flow in it. The averages are exact for such Gaussians: to all orders in the anisotropy of p_ij and in
g sigma / sqrt(T / m), as J. T. Jenkins and M. W. Richman, J. Fluid Mech. 192, 313 (1988), have them for smooth disks
in the dilute and in the dense limit, and C.-S. Chou and M. W. Richman, Physica A 259, 430 (1998), for spheres.

*Range.* Off Enskog's equation, solved by Monte Carlo (5,000 disks, steps of 0.01 mean free times, which with noise are
worth 1 %; steady state), is T of theory by, in %,

    phi                                  0.02      0.1      0.3      0.5
    smooth, e_n = 0.8                    +1.5     +2.9     -0.4     -1.8
    smooth, e_n = 0.7                    +5.4     +2.9     -0.5     -2.0
    polyester (e_n = 0.67)               +6.8     +4.1     +0.3     -1.2
    its T_rot / T                        +1.8     +2.1     +2.8     +4.2

because velocities and spins are not Gaussian. Theory of first order (below) is off by more: T of smooth disks by +7,
+11 and +15 % at e_n = 0.8 and phi = 0.1, 0.3 and 0.5, and by +13, +19 and +25 % at 0.7. Below e_n = 0.65 and above
phi = 0.5 `steady_flow` and `sheared` warn (`TheoryWarning`).

Assumed: homogeneous, no correlations between velocities and spins or of what is going to collide.

*First order.* Where the anisotropy is small and g sigma too, collisions take z nu of T and l nu (`relaxation`) of what
is not isotropic, nu being the collision rate of a disk, and crowding enters by two factors (`stress_factors`). Then
nu^2 = g^2 (1 - z/l) / (l z) in a dilute gas that is steady; with z = (1 - e_n^2)/2 and l = (1 + e_n)(7 - 3 e_n)/8 for
smooth disks this is the result of A. Santos, V. Garzo and J. W. Dufty, Phys. Rev. E 69, 061303 (2004), in two
dimensions. The search for the steady state starts there, and viscosity (`hydrodynamics`) is of first order.
"""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import numpy as np

from ..errors import InputError, TheoryError, TheoryWarning
from ..model.laws.law import CollisionLaw
from ..model.observables import Stress
from ..tools.checked import Array, NonNegative, NonNegativeColumn, Positive, Real, validated
from .collisions import KineticLaw, collision_rate, is_smooth, slip_coefficients
from .contact import PackingFraction, contact_value
from .cooling_gas import changes, checked_times, integrated

LEAST_E_N = 0.65
MOST_PACKING = 0.5
"""Between which the theory is compared with Monte Carlo in the module's text."""

# Directions of the line of centres over half a turn: of a periodic function the mean converges fast.
_ANGLES = 24
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_FEW_NODES, _FEW_WEIGHTS = np.polynomial.legendre.leggauss(16)  # of three smooth pieces
_HIGHEST = 9.0  # of a Gaussian variable: averages of its sixth power have 1e-13 beyond


def relaxation(theta: float, law: CollisionLaw, k: float) -> float:
    r"""Rate l at which collisions make velocities isotropic, in units of the collision rate nu of a disk.

    Let the relative velocity (g_n, v_t) of the centres, in units of sqrt(2 T / m), be Gaussian with covariance
    1 + pi_ij, pi small and traceless. A collision changes m (v v) of both disks by (m/2) D, with

        D_nn = -(1 - e_n^2) g_n^2,  D_tt = 4 (p^2 - p v_t),  D_nt = -(1 + e_n) g_n v_t + 2 e_n g_n p,  p = P_t / m.

    pi weights pairs by pi_nn (g_n^2 - v_t^2)/2 + pi_nt g_n v_t. Averaged over the direction n, (n n - t t) pi_nn and
    (n t + t n) pi_nt both give pi_ij / 2, so that with the rate of collisions, proportional to g_n > 0,

        l = -(sqrt(2 pi) / 4) < g_n [ (D_nn - D_tt)(g_n^2 - v_t^2)/4 + D_nt g_n v_t ] >_(g_n > 0).

    The slip of the contact points is sqrt(S) u, u normal, S = 1 + k theta; given it, v_t is Gaussian with mean
    u/sqrt(S) and variance 1 - 1/S. P_t is as at `theory.cooling_rates`. `theta` is T_rot / T, `k` the shape number in
    I = m R^2 / k; the law has no rolling friction.
    """
    e, S = law.e_n, 1.0 + k * theta
    h, c = slip_coefficients(law, 1.0 / (1.0 + k))
    eta, gamma = 0.5 * h, 0.5 * c
    nodes = 0.5 * _HIGHEST * (_NODES + 1.0)  # of averages over half a normal variable, of total weight 1/2
    weights = 0.5 * _HIGHEST * _WEIGHTS * np.exp(-0.5 * nodes**2) / math.sqrt(2.0 * math.pi)
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


def stress_factors(packing_fraction: float, e_n: float) -> tuple[float, float]:
    """The factor of the kinetic stress, and the collisional stress in units of g T / nu.

    Multiply kinetic stress by the first when it is driven and when it is passed on; see the module's text.
    """
    crowd = packing_fraction * contact_value(packing_fraction)
    return 1.0 + 0.5 * (1.0 + e_n) * crowd, 0.5 * (1.0 + e_n) * (8.0 / math.pi) * crowd**2


class _Flow(NamedTuple):
    """State of a sheared gas, for m = sigma = 1: in free flight only `tilt` changes, at the rate -g."""

    across: float  # ln p_yy and ln(p_xx - p_xy^2 / p_yy): both are positive whatever an integrator tries
    along: float
    tilt: float  # p_xy / p_yy
    turn: float  # mean spin W
    tau: float  # I <(w - W)^2>

    @classmethod
    def of(cls, p_xx: float, p_yy: float, p_xy: float, turn: float, tau: float) -> _Flow:
        """The state from its moments."""
        return cls(math.log(p_yy), math.log(p_xx - p_xy**2 / p_yy), p_xy / p_yy, turn, tau)

    @property
    def p(self) -> tuple[float, float, float]:
        """p_xx, p_yy, p_xy."""
        p_yy = math.exp(self.across)
        return math.exp(self.along) + self.tilt**2 * p_yy, p_yy, self.tilt * p_yy

    def temperatures(self, k: float) -> tuple[float, float]:
        """T and T_rot."""
        return 0.5 * (self.p[0] + self.p[1]), self.tau + self.turn**2 / (4.0 * k)

    def rates(
        self, law: CollisionLaw, k: float, packing_fraction: float, g: float
    ) -> tuple[tuple[float, ...], float]:
        """Time derivatives in the order of the fields, and collisions of a disk per time, at the shear rate g."""
        p_yy = self.p[1]
        found = self.collisions(law, k, packing_fraction, g)
        rate, xx, yy, xy, turn, spinning = (float(one) for one in found[:6])
        along = (xx - 2.0 * self.tilt * xy + self.tilt**2 * yy) / math.exp(self.along)
        tilt, tau = -g + (xy - self.tilt * yy) / p_yy, spinning - self.turn * turn / (2.0 * k)
        return (yy / p_yy, along, tilt, turn, tau), rate

    def collisions(self, law: CollisionLaw, k: float, packing_fraction: float, g: float) -> Array:
        """`collisional_changes` per time."""
        p_xx, p_yy, p_xy = self.p
        frequency = 8.0 * packing_fraction * contact_value(packing_fraction)
        return frequency * collisional_changes(p_xx, p_yy, p_xy, self.turn, self.tau, g, law, k)


def collisional_changes(
    p_xx: float, p_yy: float, p_xy: float, turn: float, tau: float, g: float, law: CollisionLaw, k: float
) -> Array:
    r"""Changes of a disk by its collisions, over 8 phi chi and per time: of 1, of m V V (xx, yy, xy), of w and I w^2.

    The last four are what its collisions transfer, half of the sum of (dp)_a (r_i - r_j)_b (xx, xy, yx, yy).

    In units m = sigma = 1. Let n = (cos a, sin a) point from a disk to the other and t = (-sin a, cos a). The relative
    velocity of two Gaussian disks has the covariance C = 2 p in the basis (n, t), its slip 2 k tau more, which is
    R^2 times the variance of both spins; the flow adds -g n_x n_y to the approach g_n and g n_y^2 + W to the slip g_t.
    With g_n = r cos b and g_t = r sqrt(S) sin b the impulses of `collisions` are r times functions of b, with a
    kink where tan b = kappa, and the changes of a pair are quadratic in r: integrals over r > 0 of
    r^p exp(-q (r - h)^2 / 2) are known, those over a and b are sums. Of the velocity that goes with g_n and g_t, c_n is
    g_n less the flow's part, and the mean of c_t linear in both. Pairs come at the rate 8 phi chi times the average of
    g_n > 0 over a, and half the difference of what is exchanged belongs to either disk:

        d(V V) = -(P c + c P) / 2 + P P,    dw = -2 k P_t,    d(I w^2) = -P_t w + k P_t^2,

    and dp = -P_n n - P_t t goes from disk i, at r_i - r_j = -n, to j. Arguments as in the module's text: `turn` is W, g the shear rate; law and k as for `relaxation`.
    """
    from scipy.special import erfc

    angle = math.pi * (np.arange(_ANGLES)[:, None] + 0.5) / _ANGLES
    x, y = np.cos(angle), np.sin(angle)
    C_nn = 2.0 * (p_xx * x**2 + 2.0 * p_xy * x * y + p_yy * y**2)
    C_tt = 2.0 * (p_xx * y**2 - 2.0 * p_xy * x * y + p_yy * x**2)
    C_nt = 2.0 * ((p_yy - p_xx) * x * y + p_xy * (x**2 - y**2))
    spins = 2.0 * k * tau
    det = C_nn * spins + 4.0 * (p_xx * p_yy - p_xy**2)
    nn, tt, nt = (C_tt + spins) / det, C_nn / det, -C_nt / det  # inverse covariance of g_n and g_t
    flow_n, flow_t = -g * x * y, g * y**2 + turn

    root_S = math.sqrt(1.0 + 2.0 * k * tau / (p_xx + p_yy))
    h, c = slip_coefficients(law, 1.0 / (1.0 + k))
    kink = math.atan(law.mu * (1.0 + law.e_n) / (c * root_S))
    ends = np.array([-0.5 * math.pi, -kink, kink, 0.5 * math.pi])
    half = 0.5 * np.diff(ends)[:, None]
    b = (0.5 * (ends[1:] + ends[:-1])[:, None] + half * _FEW_NODES).ravel()
    g_n, g_t = np.cos(b), root_S * np.sin(b)  # over r
    P_n = 0.5 * (1.0 + law.e_n) * g_n
    friction = np.minimum(c * np.abs(g_t), law.mu * (1.0 + law.e_n) * g_n)
    P_t = 0.5 * (h * g_t + np.sign(g_t) * friction)

    q = nn * g_n**2 + 2.0 * nt * g_n * g_t + tt * g_t**2
    h = (nn * g_n * flow_n + nt * (g_n * flow_t + g_t * flow_n) + tt * g_t * flow_t) / q
    fixed = nn * flow_n**2 + 2.0 * nt * flow_n * flow_t + tt * flow_t**2
    I_0 = np.sqrt(0.5 * math.pi / q) * erfc(-h * np.sqrt(0.5 * q))
    I_1 = np.exp(-0.5 * q * h**2) / q + h * I_0
    I_2 = h * I_1 + I_0 / q
    I_3 = h * I_2 + 2.0 * I_1 / q
    I_4 = h * I_3 + 3.0 * I_2 / q
    # Cauchy and Schwarz; rounding of fast flows may say else.
    exponent = np.minimum(0.5 * (q * h**2 - fixed), 0.0)
    weight = np.exp(exponent) * root_S / (2.0 * math.pi * np.sqrt(det)) * g_n
    weight = weight * (half * _FEW_WEIGHTS).ravel()

    by_n, by_t = C_nt * nn + C_tt * nt, C_nt * nt + C_tt * tt
    c_t, c_t0 = by_n * g_n + by_t * g_t, by_n * flow_n + by_t * flow_t  # mean of c_t: r c_t - c_t0

    def average(square: Array, linear: Array) -> Array:
        """Over b and r, of square r^2 - linear r."""
        return np.asarray(np.sum(weight * (square * I_4 - linear * I_3), axis=1))

    d_nn = average(P_n**2 - P_n * g_n, -P_n * flow_n)
    d_tt = average(P_t**2 - P_t * c_t, -P_t * c_t0)
    d_nt = average(P_n * P_t - 0.5 * (P_n * c_t + P_t * g_n), -0.5 * (P_n * c_t0 + P_t * flow_n))
    mean_n, mean_t = (np.sum(weight * I_3 * P, axis=1) for P in (P_n, P_t))
    d_spinning = average(k * P_t**2 - P_t * (g_t - c_t), -P_t * (flow_t - c_t0 - turn))
    x, y = x[:, 0], y[:, 0]
    changes = (
        np.sum(weight * I_2, axis=1),
        x**2 * d_nn - 2.0 * x * y * d_nt + y**2 * d_tt,
        y**2 * d_nn + 2.0 * x * y * d_nt + x**2 * d_tt,
        x * y * (d_nn - d_tt) + (x**2 - y**2) * d_nt,
        -2.0 * k * mean_t,
        d_spinning,
        0.5 * (x * mean_n - y * mean_t) * x,
        0.5 * (x * mean_n - y * mean_t) * y,
        0.5 * (y * mean_n + x * mean_t) * x,
        0.5 * (y * mean_n + x * mean_t) * y,
    )
    return np.array(changes).mean(axis=1)


def _check(law: CollisionLaw, packing_fraction: float, shear_rate: float) -> None:
    if shear_rate == 0.0 or packing_fraction == 0.0:
        raise InputError(
            f"shear_rate = {shear_rate}, packing_fraction = {packing_fraction}: must not be 0 in a sheared gas"
        )
    if law.e_n < LEAST_E_N or packing_fraction > MOST_PACKING:
        of = f"e_n = {law.e_n:g}, packing fraction {packing_fraction:.4g}"
        range_ = f"e_n >= {LEAST_E_N} and packing fractions to {MOST_PACKING} only"
        text = f"theory of a sheared gas: {of}: it has been compared with simulations for {range_}"
        warnings.warn(text, TheoryWarning, stacklevel=1)  # one place, so that it is shown once


class SteadyFlow(NamedTuple):
    """Steady state of a sheared gas: temperatures [energy], pressure tensor, and collision rate of a disk [1/time].

    T_rot is nan for smooth disks, whose spins nothing changes.

    Examples
    --------
    >>> from ifrdem import IFRLaw, theory
    >>> flow = theory.steady_flow(IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0), 1.0, 0.5, 2.0, 0.1, shear_rate=0.5)
    >>> round(flow.stress.normal_difference, 3), round(flow.stress.temperature_ratio, 3)
    (0.297, 1.39)
    """

    temperature: float
    rotational_temperature: float
    stress: Stress
    collision_rate: float


@validated
def steady_flow(
    law: KineticLaw,
    mass: Positive,
    radius: Positive,
    k: Positive,
    packing_fraction: PackingFraction,
    shear_rate: Real,
) -> SteadyFlow | None:
    """Steady state of a gas of equal disks in uniform shear flow; None if it heats without end, as elastic disks do.

    Arguments as for `theory.cooling`, with the shear rate du_x/dy [1/time]. InputError if the law has rolling friction,
    the shear rate is 0 or a property is not positive. TheoryWarning outside the range of the module's text.

    Examples
    --------
    >>> from ifrdem import coins, theory
    >>> flow = theory.steady_flow(coins["1 pta"].law, 1.0, 0.5, 2.0, 0.1, shear_rate=0.5)
    >>> round(flow.temperature, 3), round(flow.stress.friction, 3)
    (4.18, 0.573)
    """
    from scipy.optimize import root

    _check(law, packing_fraction, shear_rate)
    smooth = is_smooth(law)
    theta = 0.0 if smooth else _steady_theta(law, k)
    if theta is None:
        return None
    z = -float(changes(np.asarray(theta), law, k)[0])
    ell = relaxation(theta, law, k)
    if not 0.0 < z < ell:
        return None
    # First order in units of m, sigma and the shear rate, of which T is m sigma^2 rate^2 times a number.
    more, contact = stress_factors(packing_fraction, law.e_n)
    nu = collision_rate(packing_fraction, 1.0, 1.0, 0.5)
    T, part = (more**2 * (1.0 - z / ell) / ell + contact) / (z * nu**2), z / ell
    shear = -T * math.sqrt(part * (1.0 - part))
    guess = _Flow.of(T * (1.0 + part), T * (1.0 - part), shear, -0.5, theta * T)

    def state(y: Array) -> _Flow:
        return _Flow._make((*y, 0.0, 0.0)) if smooth else _Flow(y[0], y[1], y[2], y[3], math.exp(y[4]))

    def change(y: Array) -> tuple[float, ...]:
        now = state(y)
        *rates, spinning = now.rates(law, k, packing_fraction, 1.0)[0]
        return tuple(rates[:3]) if smooth else (*rates, spinning / now.tau)

    start = guess[:3] if smooth else (*guess[:4], math.log(guess.tau))
    solved = root(change, start, tol=1e-12)
    if not solved.success and np.abs(solved.fun).max() > 1e-9:
        raise TheoryError(f"no steady state of the sheared gas was found: {solved.message}")
    found = state(solved.x)
    rate, *_, xx, xy, yx, yy = (float(each) for each in found.collisions(law, k, packing_fraction, 1.0))
    T, T_rot = found.temperatures(k)
    p_xx, p_yy, p_xy = found.p
    unit = mass * (2.0 * radius * shear_rate) ** 2
    way = np.array([[1.0, math.copysign(1.0, shear_rate)], [math.copysign(1.0, shear_rate), 1.0]])
    of_density = way * unit * packing_fraction / (math.pi * radius**2)
    stress = Stress(
        of_density * np.array([[p_xx, p_xy], [p_xy, p_yy]]), of_density * np.array([[xx, xy], [yx, yy]])
    )
    rotational = math.nan if smooth else float(unit * T_rot)
    return SteadyFlow(float(unit * T), rotational, stress, rate * abs(shear_rate))


def steady_state(
    law: CollisionLaw, mass: float, radius: float, k: float, packing_fraction: float, shear_rate: float
) -> tuple[float, float] | None:
    """Temperatures T and T_rot [energy] of `steady_flow`, as of `driven_gas.steady_state`."""
    found = steady_flow(law, mass, radius, k, packing_fraction, shear_rate)
    return None if found is None else (found.temperature, found.rotational_temperature)


def _steady_theta(law: CollisionLaw, k: float) -> float | None:
    """T_rot / T at which collisions leave T_rot alone while T is held; None if there is none up to 1e6."""
    from scipy.optimize import brentq

    def rotation(log_theta: float) -> float:
        return float(changes(np.asarray(math.exp(log_theta)), law, k)[1])

    low, high = -30.0, math.log(1e6)
    if rotation(low) <= 0.0 or rotation(high) >= 0.0:
        return None
    return math.exp(brentq(rotation, low, high, xtol=1e-12))


@validated
def sheared(
    law: KineticLaw,
    mass: Positive,
    radius: Positive,
    k: Positive,
    packing_fraction: PackingFraction,
    shear_rate: Real,
    T0: Positive,
    T_rot0: NonNegative,
    times: NonNegativeColumn,
) -> tuple[Array, Array, Array]:
    """Temperatures of a gas of equal disks, isotropic at time 0, from when its flow begins.

    InputError as `steady_flow`, or if T0 is not positive, T_rot0 negative, or the times decrease or are negative.
    TheoryError if the equations cannot be integrated: shear and collision rates differ by too many orders of
    magnitude. TheoryWarning as `steady_flow`.

    Arguments and what is returned as for `theory.cooling`, with the shear rate [1/time].
    """

    _check(law, packing_fraction, shear_rate)
    when = checked_times(times)
    if len(when) == 0 or when[-1] == 0.0:
        return np.full(len(when), T0), np.full(len(when), T_rot0), np.zeros(len(when))
    unit = math.sqrt(T0 / mass) / (2.0 * radius)  # of rates: m = sigma = T0 = 1 below

    def slope(_: float, y: Array) -> tuple[float, ...]:
        """Derivatives of the state and of the collisions."""
        state = _Flow._make((*(float(one) for one in y[:4]), max(float(y[4]), 0.0)))
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise"):
                rates, often = state.rates(law, k, packing_fraction, shear_rate / unit)
        except ArithmeticError as error:  # of NumPy, and of math
            raise TheoryError(
                f"the equations of the sheared gas leave the range of numbers: {error}"
            ) from None
        return (*rates, often)

    start = (*_Flow.of(1.0, 1.0, 0.0, 0.0, T_rot0 / T0), 0.0)
    *state, collisions = integrated(slope, start, unit * when, "sheared gas", rtol=1e-8, atol=1e-10)
    T, T_rot = np.array([_Flow._make(one).temperatures(k) for one in np.transpose(state)]).T
    return T0 * T, T0 * T_rot, collisions
