"""Collision rates and free paths of hard disks in a homogeneous gas whose velocities are Gaussian.

What a collision by the IFR law changes on average, of two disks that differ in all but are uncorrelated.

Symbols: disks i and j have masses m_i, m_j and moments of inertia I = m R^2 / k; velocities and spins are Gaussian,
T = m <v^2> / 2, tau = I <w^2>; m_n and m_t are the effective masses of the law (`kernels/laws/law.py`), mu, e_n, e_t
its coefficients.

*The impulses.* With h = (1 + e_t) m_t / m_n, and c m_n |g_t| what stops the slip g_t: c = 1/2 for the percussion
centre, m_t / m_n for the contact point,

    P_n = (1 + e_n) m_n g_n,    P_t = m_n sign(g_t) [h |g_t| + min(c |g_t|, mu (1 + e_n) g_n)].

*Averages.* The relative velocity of the centres has the variance V = T_i/m_i + T_j/m_j per component. Colliding pairs
are weighted by the approach speed g_n = sqrt(V) y: y has the density y exp(-y^2/2), with <y^2> = 2. The slip g_t = v_t
+ R_i w_i + R_j w_j is Gaussian with variance V S, S = 1 + (k_i tau_i/m_i + k_j tau_j/m_j) / V, because R^2 <w^2> = k
tau / m; call it sqrt(V S) u. Then P_t = m_n sqrt(V S) sign(u) [h |u| + c min(|u|, kappa y)] with kappa = mu (1 + e_n) /
(c sqrt S). Since P(y > a) = exp(-a^2/2), the average over y of min(|u|, kappa y) is the integral of exp(-z^2 / (2
kappa^2)) from 0 to |u|, and likewise for its square with 2 z in the integrand. Averaging over the normal u,

    J_1 = <|u| min> = sqrt(2/pi) int_0^inf exp(-z^2 (1 + 1/kappa^2) / 2) dz = kappa / sqrt(1 + kappa^2)
    J_2 = <min^2> = int_0^inf 2 z exp(-z^2 / (2 kappa^2)) erfc(z / sqrt 2) dz = 2 kappa^2 (1 - J_1),

so that <P_t g_t> = m_n V S A and <P_t^2> = m_n^2 V S B, with A = h + c J_1 and B = h^2 + 2 h c J_1 + c^2 J_2; and
<P_n g_n> = 2 (1 + e_n) m_n V, <P_n^2> = 2 (1 + e_n)^2 m_n^2 V.

*Energies.* Disk i gives the impulses away: its motion gains -P_n v_in - P_t v_it + (P_n^2 + P_t^2) / (2 m_i), its spin
-R_i w_i P_t + k_i P_t^2 / (2 m_i). All are Gaussian, so that given g_n the mean of v_in is a_i g_n, a_i = T_i/(m_i V);
given g_t that of v_it is (a_i/S) g_t, and that of R_i w_i is (k_i tau_i / (m_i V S)) g_t. Together

    <dE_i>     = m_n V [-2 (1 + e_n) a_i + (1 + e_n)^2 m_n/m_i - a_i A + (m_n/(2 m_i)) S B]
    <dE_rot,i> = m_n V k_i [-(tau_i / (m_i V)) A + (m_n/(2 m_i)) S B].

*Other laws* say h and c themselves (`CollisionLaw.slip_coefficients`): Walton's has h = 0 and c = (1 + beta_0) m_t /
m_n. Where e_n depends on g_n, as of viscoelastic spheres, the average over u comes first: with a = kappa y,

    <|u| min(|u|, a)> = erf(a / sqrt 2),
    <min(|u|, a)^2>   = erf(a / sqrt 2) - a sqrt(2/pi) exp(-a^2 / 2) + a^2 erfc(a / sqrt 2),

and a sum over y gives J_1, J_2, and <(1 + e_n) y^2> and <(1 + e_n)^2 y^2> in place of 2 (1 + e_n) and 2 (1 + e_n)^2.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..model.laws.ifr import smooth_disks
from ..model.laws.law import CollisionLaw
from ..model.laws.records import LAWS
from ..tools.checked import (
    Array,
    NonNegative,
    NonNegativeArray,
    NonNegativeColumn,
    Positive,
    PositiveColumn,
    must_be,
    validated,
)
from .contact import PackingFraction, contact_value


class Collider(NamedTuple):
    """One of the two: mass [mass], shape number k in I = m R^2 / k, temperatures T, T_rot [energy]; or arrays.

    The radius [length] matters to viscoelastic spheres only.
    """

    mass: ArrayLike
    k: ArrayLike
    T: ArrayLike
    T_rot: ArrayLike
    radius: float = math.nan


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_HIGHEST = 9.0  # of y: beyond are 3e-18 of all collisions
_ROOT = 0.5 * math.sqrt(_HIGHEST) * (_NODES + 1.0)  # of y, so that the power 1/5 is smooth enough
_Y = _ROOT**2
_Y_WEIGHTS = math.sqrt(_HIGHEST) * _WEIGHTS * _ROOT * _Y * np.exp(-0.5 * _Y**2)


def checked_law(name: str, law: Any) -> CollisionLaw:
    """The law, if its averages are known.

    InputError if they are not, or it has rolling friction.
    """
    if not isinstance(law, CollisionLaw) or not law.has_averages:
        known = dict.fromkeys(each.kind.__name__ for each in LAWS.values() if each.kind.has_averages)
        known_laws = f"({', '.join(known)} do): those are known"
        raise must_be(name, law, f"a law that says has_averages {known_laws} (ifrdem.DSMC takes any law)")
    for needed in ("mu",) if law.depends_on_speed else ("e_n", "mu"):
        if not hasattr(law, needed):
            raise InputError(
                f"{name} = {law}: has_averages = True requires an attribute {needed}; {law} has none"
            )
    if not law.depends_on_speed and not np.any(law.slip_coefficients(np.array(1.0))):
        return smooth_disks(law.e_n)  # nothing that stops the slip: no friction either
    if getattr(law, "rho", 0.0) != 0.0:
        raise InputError(
            f"{name}: rho = {law.rho}: must be 0, kinetic theory has no rolling friction (ifrdem.DSMC has)"
        )
    return law


def closed_law(name: str, law: Any) -> CollisionLaw:
    """The law, if its averages have closed forms; else InputError."""
    found = checked_law(name, law)
    if found.depends_on_speed:
        raise must_be(
            name, law, "a law whose e_n is a constant (theory.prediction takes any that has averages)"
        )
    return found


KineticLaw = Annotated[CollisionLaw, closed_law]
"""A law of constant e_n whose averages are known."""


def slip_coefficients(law: CollisionLaw, inverse_a: ArrayLike) -> tuple[Array, Array]:
    """h and c of a law (`CollisionLaw.slip_coefficients`) at inverse_a = m_t / m_n."""
    return law.slip_coefficients(np.asarray(inverse_a, dtype=np.float64))


def is_smooth(law: CollisionLaw) -> bool:
    """True if the law has no tangential impulse."""
    h, _ = slip_coefficients(law, 1.0)
    return law.mu == 0.0 and not np.any(h)


def tangential_averages(law: CollisionLaw, inverse_a: ArrayLike, S: ArrayLike) -> tuple[Array, Array]:
    """A and B of the tangential impulse, at inverse_a = m_t / m_n and S = <g_t^2> / V."""
    h, c = slip_coefficients(law, inverse_a)
    kappa = law.mu * (1.0 + law.e_n) / (c * np.sqrt(np.asarray(S, dtype=np.float64)))
    root = np.sqrt(1.0 + kappa**2)
    J_1 = kappa / root
    J_2 = 2.0 * kappa**2 / (root * (root + kappa))  # = 2 kappa^2 (1 - J_1), without its cancellation
    return h + c * J_1, h**2 + 2.0 * h * c * J_1 + c**2 * J_2


def _averages(
    law: CollisionLaw, inverse_a: Array, S: Array, m_n: Array, speed: Array, R: float
) -> tuple[Any, Any, Array, Array]:
    """<(1 + e_n) y^2>, <(1 + e_n)^2 y^2> / 2, A, B for g_n = speed y [length/time], effective radius R [length]."""
    if not law.depends_on_speed:
        constant = 1.0 + law.e_n
        return 2.0 * constant, constant**2, *tangential_averages(law, inverse_a, S)
    from scipy.special import erf, erfc

    both = 1.0 + law.restitutions(speed[..., None] * _Y, m_n[..., None], R)
    h, c = slip_coefficients(law, inverse_a)
    # Where c = 0 no slip is stopped: the averages of the limit, which it multiplies.
    a = law.mu * both * _Y / (np.maximum(c, 1e-30) * np.sqrt(S))[..., None]
    first, tail = erf(a / math.sqrt(2.0)), erfc(a / math.sqrt(2.0))
    second = first - a * math.sqrt(2.0 / math.pi) * np.exp(-0.5 * a**2) + a**2 * tail
    J_1, J_2 = first @ _Y_WEIGHTS, second @ _Y_WEIGHTS
    A, B = h + c * J_1, h**2 + 2.0 * h * c * J_1 + c**2 * J_2
    return (both * _Y**2) @ _Y_WEIGHTS, 0.5 * ((both * _Y) ** 2 @ _Y_WEIGHTS), A, B


def energy_changes(
    law: CollisionLaw, disk: Collider, other: Collider, unit: float = 1.0
) -> tuple[Array, Array]:
    """Mean energies [energy] that the motion and the spin of `disk` gain in a collision with `other`.

    The two gases may have different temperatures; one at least of the two must move. Temperatures may be in units of
    mass times a speed `unit` [length/time] squared. Derived in the module's text.
    """
    m_i, k_i, T_i, tau_i = (np.asarray(value, dtype=np.float64) for value in disk[:4])
    m_j, k_j, T_j, tau_j = (np.asarray(value, dtype=np.float64) for value in other[:4])
    m_n = 1.0 / (1.0 / m_i + 1.0 / m_j)
    m_t = 1.0 / ((1.0 + k_i) / m_i + (1.0 + k_j) / m_j)
    V = T_i / m_i + T_j / m_j
    S = 1.0 + (k_i * tau_i / m_i + k_j * tau_j / m_j) / V
    R = disk.radius * other.radius / (disk.radius + other.radius)
    N_1, N_2, A, B = _averages(law, m_t / m_n, S, m_n, unit * np.sqrt(V), R)
    a_i = T_i / (m_i * V)
    half = 0.5 * (m_n / m_i) * S * B
    translation = m_n * V * (-N_1 * a_i + N_2 * (m_n / m_i) - a_i * A + half)
    rotation = m_n * V * k_i * (-tau_i / (m_i * V) * A + half)
    return translation, rotation


@validated
def collision_rate(
    packing_fraction: PackingFraction,
    T: Positive,
    mass: Positive,
    radius: Positive,
    g: NonNegative | None = None,
) -> float:
    """Collisions per disk and time [1/time] of equal disks in equilibrium at temperature T [energy].

    A disk sees the others, with number density n, come from all directions: n g sigma times the integral of
    the mean approach speed over the angle, 2 pi <max(g_n, 0)>. One component of the relative velocity is
    Gaussian with variance 2 T / m, so <max(g_n, 0)> = sqrt(T / (pi m)), and with phi = pi n sigma^2 / 4 the
    rate is 8 phi g sqrt(T / (pi m)) / sigma.

    `g` is the pair correlation at contact; `contact_value(packing_fraction)` if not given. InputError if T, mass or
    radius is not positive, or for an impossible packing fraction.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.collision_rate(0.1, 1.0, 1.0, 0.5, g=1.0), 4)  # 2 sigma n (pi T / m)^(1/2), n = 0.1 / (pi / 4)
    0.4514
    """
    contact = contact_value(packing_fraction) if g is None else g
    return 8.0 * packing_fraction * contact * math.sqrt(T / (math.pi * mass)) / (2.0 * radius)


@validated
def mean_free_path(packing_fraction: PackingFraction, radius: Positive) -> float:
    """Mean speed over collision rate of equal disks in equilibrium [length]: pi sigma / (8 sqrt(2) phi g).

    The mean speed is sqrt(pi T / (2 m)). Infinite at packing fraction 0.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.mean_free_path(0.01, 0.5), 2)
    27.33
    """
    if packing_fraction == 0.0:
        return math.inf
    return math.sqrt(math.pi / 2.0) / collision_rate(packing_fraction, 1.0, 1.0, radius)


@validated
def mixture_collision_rates(
    T: NonNegativeColumn,
    mass: PositiveColumn,
    radius: PositiveColumn,
    number_density: NonNegativeColumn,
    g: NonNegativeArray,
) -> Array:
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
    columns = {"T": T, "mass": mass, "radius": radius, "number_density": number_density}
    t, m, R, n = (np.asarray(column, dtype=np.float64) for column in columns.values())
    expected_shape = {**dict.fromkeys(columns, m.shape), "g": 2 * m.shape}
    for name, value in {**columns, "g": g}.items():
        if np.shape(value) != expected_shape[name]:
            raise InputError(
                f"{name} has shape {np.shape(value)}: must be {expected_shape[name]}, as mass has {m.shape}"
            )
    variance = t / m
    relative = np.sqrt(2.0 * math.pi * (variance[:, None] + variance))
    return n * np.asarray(g, dtype=np.float64) * (R[:, None] + R) * relative
