r"""Departure of velocities of smooth disks from Gaussian ones: the coefficient a_2 of Sonine's expansion.

Symbols: c = v / sqrt(2 T / m); f(c) = exp(-c^2) / pi [1 + a_2 S_2(c^2)], S_2(x) = x^2/2 - 2 x + 1, so that
<c^4> = 2 (1 + a_2), or a_2 = <v^4> / (2 <v^2>^2) - 1. e_n is the normal restitution; spins do not matter.

T. P. C. van Noije and M. H. Ernst, Granul. Matter 1, 57 (1998): let collisions change
<c^p> at the rate -mu_p. To first order in a_2, in d dimensions and in units in which mu_2 = 1 + (3/16) a_2,

    mu_4 = T_1 + a_2 T_2,  T_1 = d + 3/2 + e^2,  T_2 = (3/32) (10 d + 39 + 10 e^2) + (d - 1) / (1 - e).

In the cooling gas c keeps its distribution although v does not: mu_4 = (d + 2) (1 + a_2) mu_2. Where white noise
makes up for what collisions take, it adds to <v^4> in proportion to <v^2>: mu_4 = (d + 2) mu_2. Each is one linear
equation for a_2; both have e^2 - 1/2 on the right.

Kicks w at random times (a Poisson process of rate lambda, Gaussian components of variance s^2 = 2 D / lambda) are white
noise except for their higher moments: one changes <v^4> by 2 <w^2> <v^2> + 4 <(v.w)^2> + <w^4> = 2 (d + 2) s^2 <v^2>
+ d (d + 2) s^4 on average, of which white noise has the first part. If q T = d m s^2 / 2 is the mean energy of a kick,
and <v^2> = d T / m, that is mu_4 = (d + 2) (1 + q / 2) mu_2: one more equation, whose difference from white noise is
proportional to 1 / lambda. On Poisson white noise: M. Grigoriu, Nonlinear Dyn. 36, 255 (2004).

Polynomials of higher order change a_2 by a tenth and more: with S_2 to S_5, and brackets of a Monte Carlo of the law,
a_2 of the cooling gas is -0.0303 at e = 0.9 and -0.0260 at 0.8, here -0.0269 and -0.0219. DSMC of 10^6 disks had
-0.0305(5) at 0.9; at e = 0.5, where that series does not settle, 0.0725(10) against 0.0829 here.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..tools.checked import Array, FiniteArray, Fraction, NonNegative, Numbers, validated

_D = 2  # dimensions


@validated
def sonine_coefficient(velocity: Annotated[ArrayLike, Numbers(("n", 2), least=1)]) -> float:
    """a_2 = <v^4> / (2 <v^2>^2) - 1 of n > 0 velocities, shape (n, 2): 0 for Gaussian ones; nan where nothing moves.

    Of n independent Gaussian velocities it scatters by 1 / sqrt(n), around 1 + a_2 = n / (n + 1). To see it, let
    x = c^2, which has the density exp(-x): to first order in the scatter, a_2 is the mean of x^2/2 - 2 x + 1, of
    variance 1; and shares x_i / sum x are Dirichlet's, with mean squares 2 / (n (n + 1)).

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import theory
    >>> velocity = ifrdem.initial.maxwellian([1.0] * 100_000, temperature=1.0, seed=1)
    >>> abs(theory.sonine_coefficient(velocity)) < 0.02  # Gaussian: 0
    True
    """
    v = np.asarray(velocity, dtype=np.float64)
    v2 = np.sum(v**2, axis=-1)
    mean = float(np.mean(v2))
    return float(np.mean((v2 / mean) ** 2)) / 2.0 - 1.0 if mean > 0.0 else float("nan")


def _solved(e_n: float, a_2_of_the_state: float, factor: float = 1.0) -> float:
    """a_2 from T_1 + a_2 T_2 = (d + 2) `factor` (1 + (3/16 + `a_2_of_the_state`) a_2)."""
    lossy = 1.0 - e_n  # (1 - e) T_2 is finite for elastic disks, whose a_2 is 0
    T_1 = _D + 1.5 + e_n**2
    T_2 = 3.0 / 32.0 * (10 * _D + 39 + 10.0 * e_n**2) * lossy + (_D - 1)
    noise = (_D + 2) * factor
    return lossy * (T_1 - noise) / (lossy * noise * (3.0 / 16.0 + a_2_of_the_state) - T_2)


@validated
def cooling_sonine(e_n: Fraction) -> float:
    """a_2 of smooth disks that cool: 16 (1 - e) (1 - 2 e^2) / (57 - 25 e + 30 e^2 (1 - e)).

    Reached after some 10 collisions of each disk, while the gas is homogeneous. InputError if e_n is not from 0 to 1.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.cooling_sonine(0.9), 4)
    -0.0269
    """
    return _solved(e_n, 1.0)


@validated
def heated_sonine(e_n: Fraction, kick_energy: NonNegative = 0.0) -> float:
    """a_2 of smooth disks in the steady state of white noise: 16 (1 - e) (1 - 2 e^2) / (185 - 153 e + 30 e^2 (1 - e)).

    Of kicks at random times, `kick_energy` is the mean energy of one (of a disk at rest) over T, power / (rate T).
    To first order in a_2. InputError if e_n is not from 0 to 1, or the energy negative.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.heated_sonine(0.9), 4), round(theory.heated_sonine(0.9, 0.1), 4)
    (-0.0199, -0.0071)
    """
    return _solved(e_n, 0.0, 1.0 + 0.5 * kick_energy)


@validated
def cooling_factor(a_2: FiniteArray) -> Array:
    """Cooling rate of smooth disks relative to Gaussian ones at the same T: 1 + (3/16) a_2.

    The relative velocity of two disks has a_2 / 2 of its own; the mean of its cube, to which the loss per time is
    proportional, is 1 + (3/8) (a_2 / 2) times a Gaussian's.

    Examples
    --------
    >>> from ifrdem import theory
    >>> float(theory.cooling_factor(0.0))
    1.0
    """
    return np.asarray(1.0 + 3.0 / 16.0 * np.asarray(a_2, dtype=np.float64))


@validated
def collision_factor(a_2: FiniteArray) -> Array:
    """Collision rate of smooth disks relative to Gaussian ones at the same T: 1 - a_2 / 16.

    As at `cooling_factor`, with the mean relative speed instead of its cube: 1 - (1/8) (a_2 / 2).

    Examples
    --------
    >>> from ifrdem import theory
    >>> float(theory.collision_factor(0.0))
    1.0
    """
    return np.asarray(1.0 - np.asarray(a_2, dtype=np.float64) / 16.0)
