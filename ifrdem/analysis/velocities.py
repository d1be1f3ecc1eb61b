"""Distributions of velocities and spins, and how far they are from Gaussian: Sonine coefficients."""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..tools.checked import Array, FiniteArray, Integer, Positive, PositivePerDisk, Real, rows, validated
from ..tools.intervals import error_of_share, of_share
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from . import common
from .common import Positions, Spins

AT_ONCE = 1 << 16
"""Disks whose terms are computed together."""
TAIL = (2.0, 3.0)
"""Speeds |c| above which disks are counted."""


@dataclass(frozen=True)
class SonineCoefficients:
    """Coefficients of velocities and spins of disks, 0 for independent Gaussians, with their standard errors.

    With c = v / sqrt(2 T / m) and w = omega / sqrt(2 T_rot / I), the coefficients of the expansion of the distribution
    in Sonine (Laguerre) polynomials that belong to c^4, w^4 and c^2 w^2, and to the products of sixth order::

        a20 = <v^4> / (2 <v^2>^2) - 1
        a02 = <omega^4> / (3 <omega^2>^2) - 1
        a11 = <v^2 omega^2> / (<v^2> <omega^2>) - 1
        a30 = 1 + 3 a20 - <v^6> / (6 <v^2>^3)
        a03 = 1 + 3 a02 - <omega^6> / (15 <omega^2>^3)
        a21 = 1 + a20 + 2 a11 - <v^4 omega^2> / (2 <v^2>^2 <omega^2>)
        a12 = 1 + a02 + 2 a11 - <v^2 omega^4> / (3 <v^2> <omega^2>^2)

    The first three are also known as a_2, b_2 and c_2 or b (translational, rotational, cross); a30 is a_3.

    These are the definitions of A. Santos, G. M. Kremer and M. dos Santos, Phys. Fluids 23, 030604 (2011),
    arXiv:1009.6180, for spheres, <c^4> = d (d + 2) (1 + a20) / 4, at two components of v and one of omega, as
    for disks in A. Megias and A. Santos, arXiv:2303.00057. Positive values mean heavy tails (a20, a02), or that fast
    disks spin fast (a11). Other numbers go by these or like names: the excess kurtosis of a velocity component is
    3 a20, that of spins 3 a02; of spheres, with three components each, a20 and a02 have 3/5 in place of 1/2 and 1/3;
    and coefficients fitted to a histogram, or cut off at another order of the series, are no cumulants.

    Attributes
    ----------
    a20, a02, a11, a30, a03, a21, a12, and each with _error : float
        The coefficients, nan for what does not move; and their standard errors, to first order in them. Disks count as
        independent of one another, frames do not: a disk's contributions are summed over the frames first. Of n disks
        of a Gaussian gas in one frame they are 1 / sqrt(n), sqrt(8 / (3 n)) and sqrt(2 / n). Where velocities are
        correlated in space, errors are larger.
    disks, frames : int
    """

    a20: float
    a20_error: float
    a02: float
    a02_error: float
    a11: float
    a11_error: float
    a30: float
    a30_error: float
    a03: float
    a03_error: float
    a21: float
    a21_error: float
    a12: float
    a12_error: float
    disks: int
    frames: int


class Tail(NamedTuple):
    """Fraction of disks with |c| above a speed, over exp(-c^2) of a Gaussian gas."""

    value: float
    error: float
    ends: tuple[float, float]
    """error, ends: standard error, and ends of the 95 % interval, of a share p of n independent trials
    (`tools.intervals`). n is the number of disks, or more where the scatter between disks shows that they change from
    frame to frame: p (1 - p) over the variance of the mean. The error is not 0 where no disk was counted."""


@dataclass(frozen=True, eq=False, repr=False)
class VelocityDistribution(Brief, ResultPlot):
    """Distributions of velocity components and spins over their thermal speeds."""

    speed: Array
    density: Array
    density_error: Array
    """speed, density, density_error: middles of the bins of c_x and c_y, c = v / sqrt(2 T / m); probability density of
    a component, both counted; standard error, as of `Tail`; shape (bins,)."""
    spin: Array
    spin_density: Array
    spin_density_error: Array
    """spin, spin_density, spin_density_error: the distribution of w = omega / sqrt(2 T_rot / I); densities are nan
    where
    nothing spins; shape (bins,)."""
    sonine: SonineCoefficients
    tail: dict[float, Tail]
    """Speed |c| of `TAIL` -> the disks above it."""


@validated
def gaussian(c: FiniteArray) -> Array:
    """Density of a component c over its thermal speed in a Gaussian gas: exp(-c^2) / sqrt(pi).

    Examples
    --------
    >>> from ifrdem import analysis
    >>> float(analysis.gaussian(0.0))  # pi^(-1/2)
    0.5641895835477563
    """
    x = np.asarray(c, dtype=float)
    return np.exp(-x * x) / np.sqrt(np.pi)


@validated
def sonine_density(c: FiniteArray, a2: Real) -> Array:
    """Density of a component c in a gas with fourth cumulant a2: `gaussian` times 1 + a2 (c^4 / 2 - 3 c^2 / 2 + 3 / 8).

    That is L_2^(-1/2)(c^2), of a spin with a02 and, because L_2^(0)(c_x^2 + c_y^2) leaves it when c_y is integrated
    out, of a velocity component with a20.

    Examples
    --------
    >>> from ifrdem import analysis
    >>> float(analysis.sonine_density(1.0, 0.0) - analysis.gaussian(1.0))
    0.0
    """
    x = np.minimum(np.square(np.asarray(c, dtype=float)), 1e4)  # beyond, the Gaussian is 0
    return gaussian(c) * (1.0 + a2 * (0.5 * x * x - 1.5 * x + 0.375))


@validated
def velocity_distribution(
    velocity: Positions,
    spin: Spins,
    *,
    mass: PositivePerDisk = 1.0,
    inertia: PositivePerDisk = 1.0,
    bins: Annotated[int, Integer(1, 1_000_000)] = 81,
    widest: Positive = 5.0,
) -> VelocityDistribution:
    """Distributions of velocities and spins, each frame relative to its own mean velocity and its own temperatures.

    InputError if shapes do not match, there are no frames, fewer than 2 disks, or nothing moves.

    Parameters
    ----------
    velocity, spin : arrays (n, 2) and (n,), or as many frames of them
        Velocities [length/time], of a sheared gas the peculiar ones; spins [rad/time], whose mean is not taken off.
    mass, inertia : float or array (n,)
        Masses [mass] and moments of inertia [mass length^2]. Different ones count with v sqrt(m): right if all have one
        temperature; pass one species at a time where they have not.
    bins, widest : int, float
        Number of bins, and end of the outermost; what is beyond is not in the densities, and is in the coefficients.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> found = analysis.velocity_distribution(rng.normal(size=(20_000, 2)), rng.normal(size=20_000))
    >>> bool(abs(found.sonine.a20) < 4.0 * found.sonine.a20_error)  # Gaussian
    True
    """
    edges = np.linspace(-widest, widest, bins + 1)
    counts, spin_counts = _Counts(bins, widest), _Counts(bins, widest)
    sums: Array | None = None  # over the frames, of each disk
    moments, frames = _Moments(9 + len(TAIL)), 0
    given = itertools.zip_longest(velocity, spin)
    present = next(given, None)
    while present is not None:
        v, omega = present
        if v is None or omega is None:
            raise InputError("velocity and spin: must have the same number of frames")
        n = len(v)
        if n != len(omega) or n < 2:
            raise InputError(f"velocity has {n} disks, spin {len(omega)}: must be the same number, 2 or more")
        following = next(given, None)
        weight, inertias = rows("mass", mass, n), rows("inertia", inertia, n)
        if sums is None and following is not None:
            sums = np.zeros((9 + len(TAIL), n))
        # All disks at once would need several times the memory of a frame.
        blocks = [*common.blocks(n, AT_ONCE)]
        drift = _total(weight[some] @ v[some] for some in blocks) / _total(
            weight[some].sum() for some in blocks
        )

        def scaled(some: slice, v: Any = v, drift: Any = drift, weight: Any = weight) -> Array:
            found: Array = (v[some] - drift) * np.sqrt(weight[some])[:, None]
            return found

        T2 = _total(np.sum(scaled(some) ** 2) for some in blocks) / n
        T2_rot = 2.0 * _total(np.sum(inertias[some] * np.square(omega[some])) for some in blocks) / n
        if T2 == 0.0:
            raise InputError("velocity: must differ between disks: without motion there is no distribution")
        for some in blocks:
            c = scaled(some)
            # x and y have mean 1.
            x, y = np.sum(c * c, axis=1) / T2, np.full(len(c), np.nan)
            counts.add(c / np.sqrt(T2), some.start, n)
            if T2_rot > 0.0:
                w = np.sqrt(inertias[some]) * omega[some]
                y = 2.0 * w * w / T2_rot
                spin_counts.add((w / np.sqrt(T2_rot))[:, None], some.start, n)
            orders = (x, y, x * x, y * y, x * y, x**3, y**3, x * x * y, x * y * y)
            terms = np.stack((*orders, *(x > speed**2 for speed in TAIL)))
            if sums is None:
                moments.add(terms)
            else:
                sums[:, some] += terms
        frames += 1
        present = following
    if not frames:
        raise InputError("velocity and spin have no frames: must have one or more")
    del v, omega, present, following  # as large as what comes
    if sums is not None:
        for some in common.blocks(sums.shape[1], AT_ONCE):
            moments.add(sums[:, some] / frames)
    density, error = counts.density()
    turning = bool(np.isfinite(moments.mean[1]))
    nothing = np.full(bins, np.nan)
    spin_density, spin_error = spin_counts.density() if turning else (nothing, nothing)
    middle = 0.5 * (edges[1:] + edges[:-1])
    tail = {c: _tail(c, moments, len(moments.mean) - len(TAIL) + i) for i, c in enumerate(TAIL)}
    return VelocityDistribution(
        middle, density, error, middle, spin_density, spin_error, _sonine(moments, frames), tail
    )


def _total(terms: Iterable[Any]) -> Any:
    """Sum of terms, one after another."""
    return functools.reduce(operator.add, terms)


class _Moments:
    """Means and covariances of quantities of independent disks, which are added in blocks."""

    def __init__(self, quantities: int) -> None:
        self.n = 0
        self.mean: Array = np.zeros(quantities)
        self._products: Array = np.zeros((quantities, quantities))

    def add(self, values: Array) -> None:
        """Add some disks, shape (quantities, disks).

        By the update of Chan, Golub and LeVeque, The American Statistician 37, 242 (1983), doi:10.1080/00031305.1983.10483115.
        """
        n, mean = values.shape[1], values.mean(axis=1)
        apart, apart_squared = mean - self.mean, self.n * n / (self.n + n)
        centered = values - mean[:, None]
        self._products += centered @ centered.T + apart_squared * np.outer(apart, apart)
        self.n += n
        self.mean += apart * (n / self.n)

    def variance(self, factors: Array) -> float:
        """Variance of a sum of the quantities with these factors; those with the factor 0 may be nan."""
        used = np.flatnonzero(factors)
        chosen = factors[used]
        return float(chosen @ self._products[np.ix_(used, used)] @ chosen) / (self.n - 1)


MOST_COUNTS = 10_000_000
"""Numbers of disks in bins that are kept to find how much frames differ; of larger gases some disks stand for all."""


class _Counts:
    """Histogram over frames of the components of disks, and of each of some disks."""

    def __init__(self, bins: int, widest: float) -> None:
        self.bins, self.widest = bins, widest
        self.total = np.zeros(bins)
        self.of_disks: Array = np.zeros((0, bins))
        self.disks = self.values = 0

    def add(self, components: Array, first: int, n: int) -> None:
        """Count components of disks of one frame, (disks, d), from number `first` on, of n in all."""
        self.total += np.histogram(components, self.bins, (-self.widest, self.widest))[0]
        every = -(-n * self.bins // MOST_COUNTS)
        if not len(self.of_disks):
            self.of_disks, self.disks = np.zeros((-(-n // every), self.bins)), n
        chosen = components[-first % every :: every]
        at = np.floor((chosen + self.widest) * (self.bins / (2.0 * self.widest)))
        disk, _ = inside = np.nonzero((at >= 0) & (at < self.bins))
        np.add.at(self.of_disks, (disk + -(-first // every), at[inside].astype(np.intp)), 1.0)
        if first == 0:
            self.values += components.shape[1]

    def density(self) -> tuple[Array, Array]:
        """Probability density, and its standard error."""
        width, share = 2.0 * self.widest / self.bins, self.total / (self.disks * self.values)
        n = _trials(share, np.var(self.of_disks / self.values, axis=0, ddof=1), self.disks)
        return share / width, error_of_share(share * n, n) / width


def _trials(share: Array, variance: Array, disks: int) -> Array:
    """Independent trials as good as disks with this variance of the share of values that each has, at least disks."""
    found = share * (1.0 - share) / np.where(variance > 0.0, variance, np.inf)
    return disks * np.maximum(found, 1.0)


def _tail(c: float, moments: _Moments, number: int) -> Tail:
    """Tail beyond c, from the share of frames that each disk is there, the quantity of this number."""
    share = float(moments.mean[number])
    own = np.zeros(len(moments.mean))
    own[number] = 1.0
    n = float(_trials(np.asarray(share), np.asarray(moments.variance(own)), moments.n))
    low, high = of_share(share * n, n)
    scale = float(np.exp(c**2))
    ends = float(low) * scale, float(high) * scale
    return Tail(share * scale, float(error_of_share(share * n, n)) * scale, ends)


def _sonine(moments: _Moments, frames: int) -> SonineCoefficients:
    """Coefficients and errors from moments of each disk's means over frames of x, y and their products; <x> = <y> = 1.

    A sum of these quantities is the array of its factors.
    """
    x, y, xx, yy, xy, xxx, yyy, xxy, xyy = np.eye(9, len(moments.mean))

    def mean(q: Array) -> float:
        used = np.flatnonzero(q)
        return float(q[used] @ moments.mean[used])

    def estimate(q: Array, influence: Array) -> tuple[float, float]:
        """The mean of q, less 1, and the error that the spread of each disk's influence on it makes."""
        return mean(q) - 1.0, math.sqrt(moments.variance(influence) / moments.n)

    def moment(q: Array, power_x: int, power_y: int) -> Array:
        """Influence of each disk on a moment divided by powers of <x> and <y>, which are 1."""
        return q - mean(q) * (power_x * x + power_y * y)

    # d(m4 / m2^2) = dm4 - 2 m4 dm2 at m2 = 1, and so for the mixed one.
    i20, i02, i11 = moment(0.5 * xx, 2, 0), moment(yy / 3.0, 0, 2), moment(xy, 1, 1)
    second = estimate(0.5 * xx, i20), estimate(yy / 3.0, i02), estimate(xy, i11)
    sixth = (  # terms of each, and influence of each disk
        (1.5 * xx - xxx / 6.0, 3.0 * i20 - moment(xxx / 6.0, 3, 0)),
        (yy - yyy / 15.0, 3.0 * i02 - moment(yyy / 15.0, 0, 3)),
        (0.5 * xx + 2.0 * xy - 0.5 * xxy, i20 + 2.0 * i11 - moment(0.5 * xxy, 2, 1)),
        (yy / 3.0 + 2.0 * xy - xyy / 3.0, i02 + 2.0 * i11 - moment(xyy / 3.0, 1, 2)),
    )
    found = [(value - 1.0, error) for value, error in (estimate(*each) for each in sixth)]
    numbers: list[Any] = [*itertools.chain(*second, *found), moments.n, frames]
    return SonineCoefficients(*numbers)
