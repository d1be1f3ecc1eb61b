"""Tails of the distribution of speeds: counts to the last one, and a stretched exponential.

With c = |v| / sqrt(2 T / m) the density of velocities is f(c), exp(-c^2) / pi in a Gaussian gas, and 2 pi c f(c) that of
speeds. Kinetic theory has f ~ exp(-A c^nu) far out, with nu = 1 in a gas that cools and 3/2 in one heated by kicks: T. P.
C. van Noije and M. H. Ernst, Granul. Matter 1, 57 (1998), doi:10.1007/s100350050009. A and nu are those of the largest
likelihood for the speeds above a first one, c_1, whose density is c exp(-A c^nu) over its integral,

    int_c1^inf c exp(-A c^nu) dc = A^(-2 / nu) Gamma(2 / nu, A c_1^nu) / nu.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..tools.checked import Array, Integer, Positive, PositivePerDisk, rows, validated
from ..tools.intervals import error_of_share
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory
from . import result as stored
from .common import BLOCKS, MeanValue, Positions
from .result import Columns, Evaluation, Reading, kinds, second_half, times

FIRST = 2.0
"""c_1 by default: 1.8 % of the disks of a Gaussian gas are beyond it."""
FEWEST = 10 * BLOCKS
"""Speeds beyond c_1 that a fit needs."""
EXPONENTS = (0.1, 10.0)


@dataclass(frozen=True, eq=False, repr=False)
class SpeedTail(Brief, ResultPlot):
    """Distribution of speeds to its end, and a fit of exp(-A c^nu) to its tail.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> found = analysis.speed_tail(np.random.default_rng(1).normal(size=(4000, 2)), first=1.0)
    >>> int(found.counts.sum()), bool(found.fitted(np.array(2.0)) > 0.0)
    (4000, True)
    """

    edges: Array
    """Edges of the bins of c, from 0 to the largest speed, shape (bins + 1,)."""
    counts: NDArray[np.int64]
    """Speeds in each, over all frames, shape (bins,)."""
    density: Array
    density_error: Array
    """density, density_error: f(c), normalised over the plane, and its standard error by counting, shape (bins,): of as
    many independent speeds as the scatter over blocks of disks shows, those of one frame at least."""
    first: float
    """c_1."""
    A: MeanValue
    nu: MeanValue
    """A, nu: of the fit, with the standard error by the jackknife over 20 blocks of disks, and their number."""
    beyond: int
    """Speeds above c_1."""

    def fitted(self, c: Array) -> Array:
        """The fit, with as many speeds above c_1 as were counted."""
        share = self.beyond / max(int(self.counts.sum()), 1)
        log = -self.A.mean * np.asarray(c, dtype=float) ** self.nu.mean
        return np.asarray(
            share * np.exp(log - _log_integral(self.A.mean, self.nu.mean, self.first)) / (2.0 * np.pi)
        )


def _log_integral(A: float, nu: float, first: float) -> float:
    """ln int_c1^inf c exp(-A c^nu) dc."""
    from scipy.special import gammaincc, gammaln

    upper = float(gammaincc(2.0 / nu, A * first**nu))
    if upper <= 0.0:  # far out: the first term of its expansion
        x = A * first**nu
        return float(-x + (2.0 / nu - 1.0) * np.log(x) - 2.0 / nu * np.log(A) - np.log(nu))
    return float(np.log(upper) + gammaln(2.0 / nu) - 2.0 / nu * np.log(A) - np.log(nu))


def fit(c: Array, first: float, near: tuple[float, float] | None = None) -> tuple[float, float]:
    """A and nu of the largest likelihood for speeds c above the first one; sooner found if they are `near` others."""
    from scipy.optimize import minimize

    def loss(x: Array) -> float:
        slope, nu = np.exp(x)  # of A c^nu at c_1, which hardly depends on nu
        A = slope / (nu * first ** (nu - 1.0))
        return float(A * np.mean(c**nu) + _log_integral(A, nu, first))

    ends = [(np.log(1e-3), np.log(1e3)), tuple(np.log(EXPONENTS))]
    A, nu = near or (1.0, 2.0)
    found = minimize(loss, np.log([A * nu * first ** (nu - 1.0), nu]), method="L-BFGS-B", bounds=ends)
    slope, nu = np.exp(found.x)
    return float(slope / (nu * first ** (nu - 1.0))), float(nu)


@validated
def speed_tail(
    velocity: Positions,
    *,
    mass: PositivePerDisk = 1.0,
    first: Positive = FIRST,
    bins: Annotated[int, Integer(1, 10_000)] = 50,
) -> SpeedTail:
    """Distribution of speeds to the largest one, and a fit of exp(-A c^nu) beyond the first one (the module's text).

    Frames are relative to their own mean velocity and temperature. A disk counts in all of them, so that errors are by
    blocks of disks. InputError if fewer than 200 speeds are beyond the first one, or nothing moves.

    Parameters
    ----------
    velocity : array (n, 2), or frames of them
        Of a sheared gas the peculiar ones [length/time].
    mass : float or array (n,)
        Different ones count with v sqrt(m).
    first : float
        c_1.
    bins : int
        Bins of equal width up to the largest speed.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> found = analysis.speed_tail(np.random.default_rng(1).normal(size=(100_000, 2)))  # Gaussian: nu = 2
    >>> bool(abs(found.nu.mean - 2.0) < 4.0 * found.nu.error < 4.0)
    True
    """
    speeds: list[Array] = []
    for v in velocity:
        if len(v) < BLOCKS:
            raise InputError(
                f"velocity has {len(v)} disks: must have {BLOCKS} or more, for errors by blocks of them"
            )
        weight = rows("mass", mass, len(v))
        own = v - weight @ v / weight.sum()
        squares = weight * np.sum(own**2, axis=1)
        if not squares.sum() > 0.0:
            raise InputError("velocity: must have disks that move")
        speeds.append(np.sqrt(squares / squares.mean()))
    if not speeds or len({len(one) for one in speeds}) > 1:
        raise InputError("velocity: must have one frame or more, of one number of disks")
    c = np.stack(speeds)  # c^2 = m v^2 / (2 T), T = <m v^2> / 2
    disks = c.shape[1]
    beyond = int(np.count_nonzero(c > first))
    if beyond < FEWEST:
        raise InputError(
            f"{beyond} speeds are beyond first = {first:g}: must be {FEWEST} or more for a fit; take more frames, more "
            "disks, or a lower speed"
        )
    edges = np.linspace(0.0, np.nextafter(float(c.max()), np.inf), bins + 1)
    counts = np.histogram(c, edges)[0]
    area = np.pi * np.diff(edges**2)
    block = np.arange(disks) * BLOCKS // disks
    A, nu = fit(c[c > first], first)
    without = np.array(
        [fit(rest[rest > first], first, (A, nu)) for rest in (c[:, block != k] for k in range(BLOCKS))]
    )
    error = np.sqrt((BLOCKS - 1.0) / BLOCKS * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    p = counts / c.size
    of_blocks = np.array([np.histogram(c[:, block == k], edges)[0] for k in range(BLOCKS)])
    of_blocks = of_blocks / (len(c) * np.bincount(block)[:, None])
    # Of all bins together: that of one bin is not known well from 20 blocks.
    counted = float(np.sum(p * (1.0 - p)))
    spread = float(np.sum(np.var(of_blocks, axis=0, ddof=1))) / BLOCKS
    independent = float(disks)  # blocks that do not differ, as of one bin with all, tell nothing
    if spread > 0.0:
        independent = float(np.clip(counted / spread, disks, c.size))
    share = error_of_share(p * independent, independent)
    return SpeedTail(
        edges, counts, counts / (c.size * area), share / area, first,
        MeanValue(A, float(error[0]), BLOCKS), MeanValue(nu, float(error[1]), BLOCKS), beyond,
    )  # fmt: skip


# -- of a trajectory ---------------------------------------------------------------------------------------


def of_tail(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    stored.require_velocities(trajectory)
    used, disks = second_half(trajectory, frames), trajectory.disks
    results: dict[str, SpeedTail] = {}
    readings: list[Reading] = []
    tables: dict[str, Columns] = {}
    left_out: list[str] = []
    groups = kinds(trajectory)
    for name, which in groups.items():
        of, mark = ("", "") if len(groups) == 1 else (f" of {name}", f" [{name}]")

        def velocities(which: NDArray[np.intp] = which) -> Iterator[Array]:
            return (trajectory[i].peculiar_velocity[which] for i in used)

        try:
            found = results[name] = speed_tail(velocities(), mass=disks.mass[which])
        except InputError as error:
            left_out.append(f"no tail{of}: {error}")
            continue
        readings += [
            Reading.of(f"nu of exp(-A c^nu){of}", found.nu, key=f"nu{mark}"),
            Reading.of(f"A of exp(-A c^nu){of}", found.A, key=f"A{mark}"),
            Reading(f"speeds above c = {found.first:g}{of}", found.beyond, key=f"beyond{mark}"),
            Reading(f"largest c{of}", float(found.edges[-1]), key=f"largest{mark}"),
        ]
        middle = 0.5 * (found.edges[1:] + found.edges[:-1])
        tables[name if mark else ""] = {
            "low": found.edges[:-1], "high": found.edges[1:], "counts": found.counts, "f": found.density,
            "error": found.density_error, "gaussian": np.exp(-(middle**2)) / np.pi, "fit": found.fitted(middle),
        }  # fmt: skip
    if not results:
        raise InputError("; ".join(left_out))
    notes = [
        "c = |v| / sqrt(2 T / m); f(c): density in the plane of velocities, exp(-c^2) / pi of a Gaussian gas",
        f"A and nu by the largest likelihood above c = {FIRST:g}; errors by the jackknife over {BLOCKS} blocks of disks",
        *left_out,
    ]
    return Evaluation(results, readings, tables, notes, times(trajectory, used), [], len(used))
