"""Angles of impact and regimes of the collisions of a gas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..model.laws.ifr import ELASTIC, Regime
from ..tools.checked import Array, Integer, Integers, Numbers, validated
from ..tools.intervals import error_of_share, of_share
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief

REGIMES = {
    -1: "not known",
    **{int(one): one.name.lower().replace("_", " + ") for one in Regime},
    ELASTIC: "elastic (remedy)",
}
"""Names of the numbers of `regime` in a file."""
COUNTED = {
    "sliding": REGIMES[Regime.SLIDING],
    "sticking": REGIMES[Regime.STICKING],
    "rolling_sliding": REGIMES[Regime.SLIDING_ROLLING],
    "rolling_sticking": REGIMES[Regime.STICKING_ROLLING],
    "elastic": REGIMES[ELASTIC],
}
"""Labels of the regimes that a run counts, `quantities.REGIMES`; regimes without the torque rho P_n are one there."""
BINS = (9, 45)
"""Of psi, from 0 to pi / 2, at least and at most."""
PER_BIN = 40
"""Collisions that a bin has in the mean."""


@dataclass(frozen=True, eq=False, repr=False)
class Impacts(Brief, ResultPlot):
    """Distributions of the angle of impact psi, and of the regimes.

    psi is the angle between the relative velocity of the centres and the line of centres at contact. Where velocities
    of colliding disks know nothing of where they meet (molecular chaos), the impact parameter b = sin psi is uniform
    from 0 to 1, and the density of psi is cos psi.
    """

    psi: Array
    density: Array
    density_error: Array
    """psi, density, density_error: middles of bins from 0 to pi / 2 [rad]; probability density [1/rad], and its
    standard error by counting (`tools.intervals.error_of_share`), which is not 0 for empty bins; shape (bins,)."""
    mean_b: float
    mean_b_error: float
    p_value: float
    """mean_b, mean_b_error, p_value: mean of sin psi, 1/2 in molecular chaos. Probability that as many independent
    collisions would be as far from a uniform b, or farther, if it were uniform (Kolmogorov and Smirnov); not that
    it is."""
    regimes: dict[str, tuple[float, float]]
    """Name of a regime -> share of the collisions, its standard error (`tools.intervals.error_of_share`)."""
    collisions: int
    regime_collisions: int
    """collisions, regime_collisions: how many there were, and of how many the regimes are known."""

    @property
    def density_ends(self) -> tuple[Array, Array]:
        """Ends of the 95 % interval of the density [1/rad], by counting (`tools.intervals.of_share`), (bins,) each."""
        width = 0.5 * np.pi / len(self.psi)
        low, high = of_share(self.density * width * self.collisions, self.collisions)
        return low / width, high / width

    def regime_ends(self, name: str) -> tuple[float, float]:
        """Ends of the 95 % interval of the share of a regime, by counting (`tools.intervals.of_share`)."""
        n = self.regime_collisions
        low, high = of_share(self.regimes[name][0] * n, n)
        return float(low), float(high)


_QUARTER = 0.5 * np.pi * (1.0 + 1e-12)
_Angles = Annotated[ArrayLike, Numbers(("c",), 0.0, _QUARTER, "from 0 to pi / 2 [rad]", least=1)]


@validated
def impacts(
    psi: _Angles,
    regime: Annotated[ArrayLike, Integers(("c",))] | None = None,
    *,
    bins: Annotated[int, Integer(1, 1_000_000)] | None = None,
) -> Impacts:
    """Distributions of angles of impact psi [rad], shape (c,), and of regimes, shape (c,) (values of `law.Regime`).

    Without `bins`, there are so many that a bin has `PER_BIN` collisions in the mean, within `BINS`. InputError
    without collisions, or if an angle is outside of 0 to pi / 2.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> found = analysis.impacts(np.arcsin(rng.uniform(0.0, 1.0, size=10_000)))
    >>> bool(abs(found.mean_b - 0.5) < 4.0 * found.mean_b_error)
    True
    """
    from scipy.stats import kstest

    angle = np.asarray(psi, dtype=float)
    n = len(angle)
    counts, edges = np.histogram(
        angle, int(np.clip(n // PER_BIN, *BINS)) if bins is None else bins, (0.0, _QUARTER)
    )
    width = edges[1] - edges[0]
    b = np.sin(angle)
    shares: dict[str, tuple[float, float]] = {}
    if regime is not None:
        values = np.asarray(regime, dtype=np.int64)
        if len(values) != n:
            raise InputError(f"regime has {len(values)} collisions: must have {n}, as psi")
        found = np.array(np.unique(values, return_counts=True)).T.tolist()
        shares = regime_shares({REGIMES.get(value, f"regime {value}"): count for value, count in found})
    return Impacts(
        psi=0.5 * (edges[1:] + edges[:-1]),
        density=counts / n / width,
        density_error=error_of_share(counts, n) / width,
        mean_b=float(b.mean()),
        mean_b_error=float(np.std(b, ddof=1) / np.sqrt(n)) if n > 1 else float("nan"),
        p_value=float(kstest(b, "uniform").pvalue),
        regimes=shares,
        collisions=n,
        regime_collisions=n if shares else 0,
    )


def regime_shares(counts: Mapping[str, int]) -> dict[str, tuple[float, float]]:
    """Share of each regime that occurs, and its standard error, from numbers of independent collisions."""
    n = sum(counts.values())
    return {name: (count / n, float(error_of_share(count, n))) for name, count in counts.items() if count}
