"""Angles of impact and regimes of the collisions of a gas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..law import Regime

REGIMES = {
    -1: "not known",
    **{int(one): one.name.lower().replace("_", " + ") for one in Regime},
    9: "elastic (remedy)",
}
"""What the numbers of `regime` in a file mean."""


@dataclass(frozen=True, eq=False)
class Impacts:
    """Distributions of the angle of impact psi, and of the regimes.

    psi is the angle between the relative velocity of the centres and the line of centres at contact. Where velocities
    of colliding disks know nothing of where they meet (molecular chaos), the impact parameter b = sin psi is uniform
    from 0 to 1, and the density of psi is cos psi.

    Attributes
    ----------
    psi : array (bins,)
        Middles of bins from 0 to pi / 2 [rad].
    density, density_error : array (bins,)
        Probability density [1/rad], and its standard error by counting.
    mean_b, mean_b_error : float
        Mean of sin psi, 1/2 in molecular chaos.
    p_value : float
        Probability that b would be as far from uniform by chance (Kolmogorov and Smirnov), for independent collisions.
    regimes : dict
        Name of a regime -> share of the collisions, its standard error.
    collisions : int
        How many there were.
    """

    psi: NDArray[np.float64]
    density: NDArray[np.float64]
    density_error: NDArray[np.float64]
    mean_b: float
    mean_b_error: float
    p_value: float
    regimes: dict[str, tuple[float, float]]
    collisions: int


def impacts(psi: ArrayLike, regime: ArrayLike | None = None, *, bins: int = 45) -> Impacts:
    """Distributions of angles of impact psi [rad], shape (c,), and of regimes, shape (c,) (values of `law.Regime`).

    Raises
    ------
    InputError
        Without collisions, or if an angle is outside of 0 to pi / 2.
    """
    from scipy.stats import kstest

    angle = np.asarray(psi, dtype=float)
    n = len(angle)
    if n == 0:
        raise InputError("no collisions: there are no angles of impact")
    if not (np.all(angle >= 0.0) and np.all(angle <= 0.5 * np.pi * (1.0 + 1e-12))):
        raise InputError("angles of impact must be from 0 to pi / 2 [rad]")
    counts, edges = np.histogram(angle, bins, (0.0, 0.5 * np.pi * (1.0 + 1e-12)))
    share, width = counts / n, edges[1] - edges[0]
    b = np.sin(angle)
    shares = {}
    if regime is not None:
        values = np.asarray(regime)
        if len(values) != n:
            raise InputError(f"{len(values)} regimes of {n} collisions: as many are needed")
        for value, count in zip(*np.unique(values, return_counts=True), strict=True):
            p = count / n
            name = REGIMES.get(int(value), f"regime {int(value)}")
            shares[name] = (float(p), float(np.sqrt(p * (1.0 - p) / n)))
    return Impacts(
        psi=0.5 * (edges[1:] + edges[:-1]),
        density=share / width,
        density_error=np.sqrt(share * (1.0 - share) / n) / width,
        mean_b=float(b.mean()),
        mean_b_error=float(np.std(b, ddof=1) / np.sqrt(n)) if n > 1 else float("nan"),
        p_value=float(kstest(b, "uniform").pvalue),
        regimes=shares,
        collisions=n,
    )
