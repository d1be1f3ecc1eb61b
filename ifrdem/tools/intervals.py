"""Confidence intervals of means by Student's t."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVEL = 0.95
"""Probability that the interval of a mean holds the true value."""
FEW = 10
"""Values below which half the interval of their mean is printed too: it is longer than two standard errors."""
PERCENT = f"{100.0 * LEVEL:g} %"


def student_t(count: ArrayLike) -> NDArray[np.float64]:
    """Half the width of the interval of a mean of `count` values, in standard errors of that mean.

    One value has no standard error; it gets the number of two values.

    Examples
    --------
    >>> student_t([2, 10, 10_000]).round(2).tolist()
    [12.71, 2.26, 1.96]
    """
    from scipy.special import stdtrit

    return np.asarray(stdtrit(np.maximum(np.subtract(count, 1), 1), 0.5 * (1.0 + LEVEL)))
