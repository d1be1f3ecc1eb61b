"""Confidence intervals: of means by Student's t, of counts, of shares, of intensities of waves."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVEL = 0.95
"""Probability that the interval of a mean holds the true value."""
FEW = 10
"""Values below which half the interval of their mean is printed too: it is longer than two standard errors."""
PERCENT = f"{100.0 * LEVEL:g} %"


def student_t(count: ArrayLike, level: float = LEVEL) -> NDArray[np.float64]:
    """Half the width of the interval of a mean of `count` values, in standard errors of that mean.

    It holds the true value with the probability `level`. One value has no standard error; it gets the number of two
    values.

    Examples
    --------
    >>> student_t([2, 10, 10_000]).round(2).tolist()
    [12.71, 2.26, 1.96]
    """
    from scipy.special import stdtrit

    return np.asarray(stdtrit(np.maximum(np.subtract(count, 1), 1), 0.5 * (1.0 + level)))


Interval = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lower and upper end."""
_ENDS = (0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL))


def of_share(count: ArrayLike, total: ArrayLike) -> Interval:
    """Interval of a probability, of which `count` of `total` independent trials are a sample.

    It is that of Jeffreys' prior, a beta distribution with count + 1/2 and total - count + 1/2 (L. D. Brown, T. T. Cai,
    A. DasGupta, Stat. Sci. 16, 101 (2001), doi:10.1214/ss/1009213286). Neither number must be whole: of correlated
    trials they are those of as many independent ones as are as good.

    Examples
    --------
    >>> [round(float(end), 4) for end in of_share(0, 100)]
    [0.0, 0.0247]
    """
    from scipy.special import betaincinv

    a, b = np.add(count, 0.5), np.subtract(total, count) + 0.5
    low, high = (np.asarray(betaincinv(a, b, end)) for end in _ENDS)
    return np.where(np.asarray(count) > 0.0, low, 0.0), np.where(np.less(count, total), high, 1.0)


def error_of_share(count: ArrayLike, total: ArrayLike) -> NDArray[np.float64]:
    """Standard error of a share: the standard deviation of the distribution of `of_share`, never 0.

    sqrt(p (1 - p) / (total + 2)) with p = (count + 1/2) / (total + 1).

    Examples
    --------
    >>> round(float(error_of_share(0, 100)), 4)
    0.0069
    """
    p = np.add(count, 0.5) / np.add(total, 1.0)
    return np.asarray(np.sqrt(p * (1.0 - p) / np.add(total, 2.0)))


def of_count(count: ArrayLike) -> Interval:
    """Interval of the expectation of a number of independent events, by Jeffreys' prior: gamma with count + 1/2.

    Examples
    --------
    >>> [round(float(end), 2) for end in of_count(0)]
    [0.0, 2.51]
    """
    from scipy.special import gammaincinv

    low, high = (np.asarray(gammaincinv(np.add(count, 0.5), end)) for end in _ENDS)
    return np.where(np.asarray(count) > 0.0, low, 0.0), high


def of_intensity(mean: ArrayLike, error: ArrayLike) -> Interval:
    """Interval of the mean intensity of waves of random phase and Gaussian amplitude, from a mean of independent ones.

    Intensities of such waves are exponentially distributed, and the sum of n of them over their mean has a gamma
    distribution with n, here the number with this standard error, mean / sqrt(n). A mean over 2 waves may be off by a
    factor of 3, in one direction: no +- says that.

    Examples
    --------
    >>> [round(float(end), 2) for end in of_intensity(1.0, 0.5**0.5)]
    [0.36, 8.26]
    """
    from scipy.special import gammaincinv

    count = np.square(np.divide(mean, error))
    high, low = (np.asarray(mean) * count / gammaincinv(count, end) for end in _ENDS)
    return low, high
