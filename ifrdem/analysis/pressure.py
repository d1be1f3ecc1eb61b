"""Pressure: the kinetic and the collisional part, from impulses or from the collision rate.

In two dimensions, each collision passes the impulse J = P_n n + P_t t over the distance sigma n between two centres, so
that over a time t::

    P_ab A = sum m V_a V_b + (1 / t) sum_c sigma J_a n_b,      p = (P_xx + P_yy) / 2
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..tools.checked import (
    LEAST,
    MOST,
    Array,
    Column,
    Count,
    Fraction,
    NonNegative,
    Numbers,
    Packed,
    Positive,
    PositiveColumn,
    Real,
    Vectors,
    validated,
)
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from .common import BLOCKS, MeanValue, mean_with_error
from .steadiness import is_stationary


def blocks(span: tuple[float, float]) -> list[tuple[float, float]]:
    """`BLOCKS` equal parts of a span of time."""
    edges = np.linspace(*span, BLOCKS + 1)
    return [(float(low), float(high)) for low, high in itertools.pairwise(edges)]


@dataclass(frozen=True, eq=False, repr=False)
class Pressure(Brief, ResultPlot):
    """The pressure of a gas, in two dimensions a force on a length [energy/length^2]."""

    kinetic: float
    collisional: float
    total: float
    """kinetic, collisional, total: n T / A; what collisions pass on; the sum."""
    kinetic_error: float
    collisional_error: float
    error: float
    """kinetic_error, collisional_error, error: standard errors of these, from blocks of time. Both parts follow T, so
    that of the sum is larger than that of either."""
    Z: float
    Z_error: float
    """Z, Z_error: compressibility factor p A / (N T), from blocks in which each part is that at its T."""
    kinetic_n_eff: float
    collisional_n_eff: float
    n_eff: float
    Z_n_eff: float
    """kinetic_n_eff, collisional_n_eff, n_eff, Z_n_eff: of each error, the number of independent values with that
    error: intervals are Student's t with n_eff - 1 degrees of freedom, 1 at least."""
    collisional_tensor: Array
    """P_ab of collisions, as in `observables.Stress`: first the component of the impulse; shape (2, 2)."""


@validated
def pressure_from_impulses(
    time: Column,
    normal: Vectors,
    impulse: Vectors,
    distance: PositiveColumn,
    *,
    span: tuple[Real, Real],
    area: Positive,
    disks: Count,
    tracked: Count,
    temperature: Annotated[
        ArrayLike, Numbers((BLOCKS,), low=LEAST, each=f"positive, from {LEAST:g} to {MOST:g}", scalar=True)
    ],
) -> Pressure:
    """Pressure from the collisions of tracked disks with disks, each listed once for every tracked disk in it.

    Of each listed collision, half belongs to the disk that it is listed for; the sum over tracked disks stands for
    all disks in the ratio of their numbers. That is exact if all are tracked, else right in the mean for a choice at
    random. InputError if the span is empty, or a collision lies outside.

    Parameters
    ----------
    time, distance : array (c,)
        When they happened [time], inside `span`; distance of the two centres, the sum of the radii [length].
    normal, impulse : array (c, 2)
        Unit vectors from the disk to its partner; P_n and P_t that it gives to the partner along n and t = (-n_y, n_x)
        [mass length/time].
    span : tuple of two floats
        The time that was watched [time].
    area, disks, tracked : float, int, int
        Area of the box [length^2], number of all disks and of tracked ones.
    temperature : float or array (BLOCKS,)
        T of the gas, mean over that time, or over each of `blocks(span)` [energy]. Errors
        include the scatter of T only in the latter form. If T changes there by more than a tenth, that is no scatter:
        `collisional_error` and `error` are then those at the given T, and `kinetic_error` is nan.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> n = np.arange(100)
    >>> normal, impulse = np.tile([[1.0, 0.0], [0.0, 1.0]], (50, 1)), np.tile([2.0, 0.0], (100, 1))
    >>> gas = {"span": (0.0, 10.0), "area": 100.0, "disks": 10, "tracked": 10, "temperature": 1.0}
    >>> found = analysis.pressure_from_impulses(0.1 * n + 0.05, normal, impulse, np.ones(100), **gas)
    >>> round(found.kinetic, 6), round(found.collisional, 6)  # n T; sum of P_n sigma / 2, over 2 area span
    (0.1, 0.05)
    """
    t, n, J, sigma = (np.asarray(one, dtype=float) for one in (time, normal, impulse, distance))
    for name, one in (("normal", n), ("impulse", J), ("distance", sigma)):
        if len(one) != len(t):
            raise InputError(f"{name} has {len(one)} collisions: must have {len(t)}, as time")
    begin, end = span
    if not end > begin:
        raise InputError(f"span = {span}: must end later than it begins")
    if len(t) and (t.min() < begin or t.max() > end):
        raise InputError(f"time from {t.min():g} to {t.max():g}: must lie in the span, {begin:g} to {end:g}")
    if tracked > disks:
        raise InputError(f"tracked = {tracked}: must be from 1 to disks = {disks}")
    tangent = np.stack((-n[:, 1], n[:, 0]), axis=1)
    passed = J[:, :1] * n + J[:, 1:] * tangent
    virial = 0.5 * disks / tracked * sigma[:, None, None] * passed[:, :, None] * n[:, None, :] / area
    tensor = virial.sum(axis=0) / (end - begin)
    block = np.minimum(((t - begin) / (end - begin) * BLOCKS).astype(int), BLOCKS - 1)
    trace = 0.5 * (virial[:, 0, 0] + virial[:, 1, 1])
    series = np.bincount(block, trace, minlength=BLOCKS) * BLOCKS / (end - begin)
    T = np.broadcast_to(np.asarray(temperature, dtype=float), (BLOCKS,))
    kinetic = disks * float(T.mean()) / area
    collisional = 0.5 * float(np.trace(tensor))
    total = kinetic + collisional
    Z = total / kinetic if kinetic > 0.0 else math.nan
    at_T = mean_with_error(series / T).times(float(T.mean()))
    errors = [MeanValue(kinetic, math.nan, math.nan), at_T, at_T]
    if is_stationary(T):
        T = T if np.ptp(T) > 1e-12 * T.mean() else np.full(BLOCKS, T.mean())  # rounding of a constant T
        carried = disks * T / area
        errors = [mean_with_error(one) for one in (carried, series, carried + series)]
    of_kinetic, of_collisional, of_total = errors
    return Pressure(
        kinetic=kinetic,
        collisional=collisional,
        total=total,
        kinetic_error=of_kinetic.error,
        collisional_error=of_collisional.error,
        error=of_total.error,
        Z=Z,
        Z_error=at_T.error / (kinetic or math.nan),
        kinetic_n_eff=of_kinetic.n_eff,
        collisional_n_eff=of_collisional.n_eff,
        n_eff=of_total.n_eff,
        Z_n_eff=at_T.n_eff,
        collisional_tensor=tensor,
    )


@validated
def compressibility(packing_fraction: Fraction, contact: NonNegative, e_n: Fraction = 1.0) -> float:
    """Z = p A / (N T) of a homogeneous gas of equal disks with the contact value chi: 1 + (1 + e_n) phi chi.

    Disks meet with <P_n> = (1 + e_n) (m / 2) sqrt(pi T / m) at the rate nu = 8 phi chi sqrt(T / (pi m)) / sigma each
    (`theory.collision_rate`), half a collision a disk, and each passes sigma P_n / 2 to p A: together (1 + e_n) phi chi
    T a disk. Tangential impulses do not enter. Velocities are Maxwellian and without correlations.

    Examples
    --------
    >>> from ifrdem import analysis
    >>> round(analysis.compressibility(0.1, 1.0), 12)  # 1 + (1 + e_n) phi chi
    1.2
    """
    return 1.0 + (1.0 + e_n) * packing_fraction * contact


@validated
def contact_from_rate(
    rate: NonNegative, *, packing_fraction: Packed, temperature: Positive, mass: Positive, radius: Positive
) -> float:
    """The contact value chi that a collision rate [1/time] of equal disks shows: `theory.collision_rate` inverted.

    Examples
    --------
    >>> from ifrdem import analysis
    >>> from ifrdem.theory import collision_rate
    >>> rate = collision_rate(0.1, 1.0, 1.0, 0.5, g=1.2)
    >>> round(analysis.contact_from_rate(rate, packing_fraction=0.1, temperature=1.0, mass=1.0, radius=0.5), 6)
    1.2
    """
    from ..theory import collision_rate

    return rate / collision_rate(packing_fraction, temperature, mass, radius, g=1.0)
