"""Contact values of g(r) of hard disks, equal or not: they raise collision rate and pressure.

Symbols: phi packing fraction, sigma = 2 R diameter, g pair correlation at contact, Z = P / (n T) of the elastic gas.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np

from ..errors import InputError
from ..model.density import henderson
from ..tools.checked import (
    LEAST,
    Array,
    NonNegativeColumn,
    Number,
    PositiveColumn,
    validated,
)

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
"""B_2 ... B_10 of hard disks, B_i / B_2^(i-1): N. Clisby and B. M. McCoy, J. Stat. Phys. 122, 15 (2006)."""

# (1 - phi)^2 g as a series in 2 phi to the same order. g itself grows like (1 - phi)^-2, and its bare series
# is 1e-4 too small at phi = 0.3 and 3.5 % at 0.6; this product is almost constant and its series is not.
_RESUMMED = np.convolve(VIRIAL, (1.0, -1.0, 0.25))[: len(VIRIAL)]

Contact = Literal["virial", "henderson", "dilute"]
"""Source of the contact value of equal disks; "dilute" is g = 1, Boltzmann's gas."""


_DENSEST = math.pi / (2.0 * math.sqrt(3.0))
PackingFraction = Annotated[
    float,
    Number(
        LEAST, _DENSEST, f"0, or a number from {LEAST:g} to {_DENSEST:.4f}, the densest packing", zero=True
    ),
]
"""Part of the area that equal disks can cover."""


@validated
def contact_value(packing_fraction: PackingFraction, contact: Contact = "virial") -> float:
    """Contact value g of equal hard disks: the factor by which a finite density raises the collision rate.

    "virial": from the virial series to the tenth coefficient, Z = 1 + sum B_i rho^(i-1) = 1 + 2 phi g. Known to about
    1e-5 at packing fraction 0.3 and 1e-4 at 0.5, estimated from the spread of other resummations of the same series;
    near freezing (0.70) the real fluid orders and its g is smaller.

    "henderson": (1 - 7 phi / 16) / (1 - phi)^2, D. Henderson, Mol. Phys. 30, 971 (1975). Within 1e-3 of the virial
    series up to packing fraction 0.3, 1 % up to 0.55.

    "dilute": 1. InputError if the packing fraction is not between 0 and 0.9069.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.contact_value(0.3), 3)
    1.772
    >>> round(theory.contact_value(0.3, "henderson"), 3)
    1.773
    """
    phi = packing_fraction
    if contact == "dilute":
        return 1.0
    if contact == "henderson":
        return henderson(phi)
    return float(np.polynomial.polynomial.polyval(2.0 * phi, _RESUMMED)) / (1.0 - phi) ** 2


@validated
def contact_value_coefficients(
    packing_fraction: PackingFraction,
    radius: PositiveColumn,
    fraction: NonNegativeColumn | None = None,
    contact: Contact = "virial",
) -> tuple[float, float]:
    """Coefficients (a, b) [1, 1/length] of the contact values g_ij = a + b R_i R_j / (R_i + R_j) of a mixture.

    A. Santos, S. B. Yuste and M. Lopez de Haro, Mol. Phys. 96, 1 (1999), arXiv:cond-mat/0204246, in two dimensions:

        g_ij = 1 / (1 - phi) + [g(phi) - 1 / (1 - phi)] (<sigma> / <sigma^2>) sigma_i sigma_j / sigma_ij,

    with sigma_ij = R_i + R_j. It gives g(phi) for equal disks, and for a point, sigma_i = 0, the exact 1 / (1 - phi):
    only the remaining area determines how often a point is hit. With Henderson's g(phi) the bracket is (9/16) phi /
    (1 - phi)^2. InputError as `contact_value`.

    Parameters
    ----------
    packing_fraction : float
    radius, fraction : array_like (s,)
        Radii [length], of species or of disks; what part of all disks each is, alike without it.
    contact : {"virial", "henderson", "dilute"}
        g(phi) of equal disks; "dilute" makes all contact values 1.
    """
    g = contact_value(packing_fraction, contact)
    R = np.asarray(radius, dtype=np.float64)
    parts = np.ones(len(R)) if fraction is None else np.asarray(fraction, dtype=np.float64)
    if parts.shape != R.shape or not parts.any():
        raise InputError(
            f"fraction has shape {parts.shape} and the sum {parts.sum():g}: must have that of radius, {R.shape}, "
            "and a sum above 0"
        )
    if contact == "dilute":
        return 1.0, 0.0
    a = 1.0 / (1.0 - packing_fraction)
    diameter = 2.0 * R
    mean, mean_square = (float(np.average(diameter**power, weights=parts)) for power in (1, 2))
    # sigma_i sigma_j / sigma_ij = 4 R_i R_j / (R_i + R_j)
    return a, 4.0 * (g - a) * mean / mean_square


@validated
def mixture_contact_values(
    packing_fraction: PackingFraction,
    radius: PositiveColumn,
    fraction: NonNegativeColumn | None = None,
    contact: Contact = "virial",
) -> Array:
    """Contact values g_ij of hard disks of different sizes, shape (s, s); see `contact_value_coefficients`.

    Examples
    --------
    >>> from ifrdem import theory
    >>> theory.mixture_contact_values(0.2, [0.5, 1.0]).round(3)
    array([[1.356, 1.391],
           [1.391, 1.461]])
    """
    a, b = contact_value_coefficients(packing_fraction, radius, fraction, contact)
    R = np.asarray(radius, dtype=np.float64)
    return a + b * R[:, None] * R / (R[:, None] + R)


@validated
def compressibility(
    packing_fraction: PackingFraction,
    radius: PositiveColumn = (1.0,),
    fraction: NonNegativeColumn | None = None,
    contact: Contact = "virial",
) -> float:
    """Z = P / (n T) of elastic hard disks of one or several sizes: 1 + (pi/2) n sum_ij x_i x_j sigma_ij^2 g_ij.

    The virial theorem in two dimensions; n sum_i x_i sigma_i^2 = 4 phi / pi. For equal disks it is 1 + 2 phi g.
    Arguments as for `contact_value_coefficients`; without radii, equal disks.

    Examples
    --------
    >>> from ifrdem import theory
    >>> round(theory.compressibility(0.01), 4)  # 1 + 2 phi + ...
    1.0203
    """
    R = np.asarray(radius, dtype=np.float64)
    x = np.full(len(R), 1.0) if fraction is None else np.asarray(fraction, dtype=np.float64)
    g = mixture_contact_values(packing_fraction, R, x, contact)
    x = x / x.sum()
    density = packing_fraction / (math.pi * float(np.sum(x * R**2)))
    return 1.0 + 0.5 * math.pi * density * float(x @ (g * (R[:, None] + R) ** 2) @ x)
