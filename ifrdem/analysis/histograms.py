"""Distributions of collisions that a run has counted, compared with those of a gas in equilibrium."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..model.histograms import Histogram, histogram_edges
from ..quantities import HISTOGRAMS, REGIMES
from ..tools.checked import Array, validated
from ..tools.intervals import error_of_share, of_share
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from ..trajectory.export import species
from ..trajectory.reader import Trajectory
from .result import Columns, Evaluation, Reading, all_frames, times, unit
from .window import steady_frames

FEWEST_EXPECTED = 5.0
"""Collisions that equilibrium expects in a bin at least, or in several together, for the p-value."""


@dataclass(frozen=True, eq=False, repr=False)
class CollisionDistribution(Brief, ResultPlot):
    """Distribution of the collisions of a pair of species by the angle of impact, the normal speed or the free time.

    In equilibrium the angle psi has the density cos psi, as in molecular chaos. The normal speed has (g / s^2)
    exp(-g^2 / 2 s^2), for the relative velocity along a line is Gaussian, with the variance s^2, and pairs meet in
    proportion to g. The free time has nearly exp(-t / mean) / mean in a dilute gas: fast disks collide more often (P.
    Visco, F. van Wijland, E. Trizac, Phys. Rev. E 77, 041117 (2008), doi:10.1103/PhysRevE.77.041117). s and the mean
    are those of the counts.

    Examples
    --------
    >>> import ifrdem
    >>> from ifrdem import analysis
    >>> edges = ifrdem.observables.histogram_edges("free_time")
    >>> counts = 1000 * (edges[:-1] == 1.0)[None]
    >>> found = analysis.collision_distribution(ifrdem.observables.Histogram("free_time", edges, counts))
    >>> float(found.density.max()), found.mean  # all in the bin from 1 to 1.125
    (8.0, 1.0625)
    """

    name: str
    """As of `Histogram`."""
    edges: Array
    """Edges of the bins, shape (b + 1,)."""
    density: Array
    density_error: Array
    """density, density_error: probability density [1/unit of the edges], and its standard error by counting, shape
    (b,)."""
    equilibrium: Array
    """Density in equilibrium, its mean over each bin, shape (b,)."""
    mean: float
    mean_error: float
    """mean, mean_error: of the quantity, from the middles of the bins, and its standard error for independent
    collisions."""
    p_value: float
    """Probability that as many independent collisions in equilibrium would be as far from `equilibrium`, or farther
    (chi-square, bins with few collisions together); nan if one bin is left."""
    count: int
    """Number of counts: collisions, or free times."""
    outside: int
    """Counts in the first and the last bin of speeds and times, which may be beyond these."""


@validated
def collision_distribution(histogram: Histogram, pair: int = 0) -> CollisionDistribution:
    """The distribution of the collisions of a pair of species that a histogram has counted.

    Raises
    ------
    InputError
        If the histogram is that of regimes, has no such pair, or has counted nothing for it.

    Examples
    --------
    >>> import numpy as np
    >>> import ifrdem
    >>> from ifrdem import analysis
    >>> edges = ifrdem.observables.histogram_edges("impact_angle")
    >>> psi = np.arcsin(np.random.default_rng(1).uniform(size=100_000))
    >>> counts = np.histogram(psi, edges)[0][None]
    >>> found = analysis.collision_distribution(ifrdem.observables.Histogram("impact_angle", edges, counts))
    >>> bool(0.001 < found.p_value), round(found.mean, 1)  # the mean of psi is pi / 2 - 1
    (True, 0.6)
    """
    if histogram.name == "regime":
        raise InputError("histogram.name = 'regime': regimes have shares, no density")
    if not 0 <= pair < len(histogram.counts):
        raise InputError(f"pair = {pair}: must be from 0 to {len(histogram.counts) - 1}")
    counts, edges = histogram.counts[pair], histogram.edges
    n = int(counts.sum())
    if not n:
        raise InputError(f"{histogram.name}: no collision of pair {pair} was counted")
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    mean = float(counts @ middle) / n
    square = float(counts @ middle**2) / n
    below = {
        "impact_angle": lambda: np.sin(edges),
        "normal_speed": lambda: -np.expm1(-(edges**2) / square),
        "free_time": lambda: -np.expm1(-edges / mean),
    }[histogram.name]()
    spread = max(square - mean**2, 0.0)
    ends = 0 if histogram.name == "impact_angle" else int(counts[0] + counts[-1])
    return CollisionDistribution(
        name=histogram.name,
        edges=edges,
        density=counts / n / width,
        density_error=error_of_share(counts, n) / width,
        equilibrium=np.diff(below) / width,
        mean=mean,
        mean_error=float(np.sqrt(spread / (n - 1))) if n > 1 else float("nan"),
        p_value=_p_value(counts, n * np.diff(below), fitted=histogram.name != "impact_angle"),
        count=n,
        outside=ends,
    )


def _p_value(counts: Array, expected: Array, *, fitted: bool) -> float:
    """Of chi-square, over groups of neighbouring bins in which at least FEWEST_EXPECTED are expected."""
    from scipy.special import chdtrc

    seen, wanted = [0.0], [0.0]
    for found, each in zip(counts, expected, strict=True):
        if wanted[-1] >= FEWEST_EXPECTED:
            seen.append(0.0)
            wanted.append(0.0)
        seen[-1] += float(found)
        wanted[-1] += float(each)
    if wanted[-1] < FEWEST_EXPECTED and len(wanted) > 1:
        seen[-2:], wanted[-2:] = [sum(seen[-2:])], [sum(wanted[-2:])]
    free = len(wanted) - 1 - fitted
    if free < 1:
        return float("nan")
    square = sum((a - b) ** 2 / b for a, b in zip(seen, wanted, strict=True))
    return float(chdtrc(free, square))


TITLES = {"impact_angle": "angle of impact", "normal_speed": "normal speed", "free_time": "free time"}
_UNITS = {"impact_angle": "", "normal_speed": "length/time", "free_time": "time"}
_MEANS = {"impact_angle": "psi", "normal_speed": "g_n", "free_time": "free time"}


def of_histograms(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    """The distributions of the collisions between two frames of a file, of each pair of species that has collided."""
    stored = {name.removeprefix("histogram_"): name for name in HISTOGRAMS if name in trajectory.observables}
    if not stored:
        raise InputError(
            f"{trajectory.path} holds no histograms of collisions: set output.histograms = true in the case and run it "
            'again; from Python, Simulation(..., record=["histograms"]), and file.write(state, '
            "ledger.observables(measure))"
        )
    used = all_frames(trajectory, steady_frames(trajectory, frames))
    if len(used) < 2:
        raise InputError(f"{trajectory.path}: collisions are counted between two frames or more")
    counts = {
        name: np.diff(trajectory.observables[whole][[min(used), max(used)]], axis=0)[0]
        for name, whole in stored.items()
    }
    pairs = list(_names_of_pairs(trajectory))
    rows: list[Reading] = []
    table: dict[str, Columns] = {}
    results: dict[str, dict[str, CollisionDistribution]] = {}
    for pair, label in enumerate(pairs):
        regimes = counts["regime"][pair]
        if not regimes.any():
            continue
        of, suffix = (f" of {label}", f"_{label}") if len(pairs) > 1 else ("", "")
        rows.append(Reading(f"collisions{of}", int(regimes.sum())))
        results[label] = {}
        for name, title in TITLES.items():
            if name not in counts or not counts[name][pair].any():
                continue
            found = collision_distribution(Histogram(name, histogram_edges(name), counts[name]), pair)
            results[label][name] = found
            quantity = unit(trajectory, _UNITS[name]) if _UNITS[name] else "rad"
            key = f"mean_{name}{suffix}"
            rows.append(
                Reading(f"mean {_MEANS[name]}{of}", found.mean, found.mean_error, quantity, key, found.count)
            )
            rows.append(
                Reading(
                    f"p-value of equilibrium, {title}{of}",
                    found.p_value,
                    key=f"p_{name}{suffix}",
                )
            )
            table[f"{name}{suffix}"] = {
                "low": found.edges[:-1], "high": found.edges[1:], "density": found.density,
                "error": found.density_error, "equilibrium": found.equilibrium,
            }  # fmt: skip
        for regime, number in zip(REGIMES, regimes.tolist(), strict=True):
            if number:
                total = int(regimes.sum())
                ends = tuple(float(end) for end in of_share(number, total))
                share = Reading(
                    f"share of {regime}{of}", number / total, float(error_of_share(number, total)),
                    key=f"share_{regime}{suffix}", ends=(ends[0], ends[1]),
                )  # fmt: skip
                rows.append(share)
    if not rows:
        raise InputError(f"{trajectory.path}: no disks collided between these frames")
    notes = [
        "of all collisions of two disks, counted as they happened; equilibrium: density cos psi of the angle, "
        "g_n exp(-g_n^2 / 2 s^2) of the normal speed, exp(-t / mean) of the free time of a dilute gas, with the s and "
        "the mean of these data"
    ]
    warnings = [
        f"{found.outside} of {found.count} counts of the {TITLES[name]} are in the first or last bin, and may be beyond it"
        for each in results.values()
        for name, found in each.items()
        if found.outside > 1e-3 * found.count
    ]
    return Evaluation(results, rows, table, notes, times(trajectory, used), warnings, len(used))


def _names_of_pairs(trajectory: Trajectory) -> Iterator[str]:
    """Names of the pairs of species of a file, in the order of its histograms; "all disks" without species."""
    names = list(species(trajectory) or ())
    if not names:
        yield "all disks"
    for i, one in enumerate(names):
        for other in names[: i + 1]:
            yield f"{other}-{one}"
