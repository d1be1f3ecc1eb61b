"""Histograms of collisions that a run counts as they happen, of each pair of species: `record=["histograms"]`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..kernels.columns import FIRST_OCTAVE, HISTOGRAM, OCTAVES, PER_OCTAVE
from ..tools.checked import Array, validated
from ..tools.intervals import error_of_share
from ..tools.values import Choice
from .observables import Measure

NAMES = tuple(HISTOGRAM.at)
"""Of the histograms, in the order in which `Measure.histograms` has them."""
HistogramName = Annotated[str, Choice(NAMES)]


@dataclass(frozen=True, eq=False)
class Histogram:
    """Counts of collisions of two disks between two times, of each pair of species.

    The pair of species i >= j, numbered in the order of `Disks.species`, is row i (i + 1) / 2 + j.

    Attributes
    ----------
    name : str
        "impact_angle": psi, between the relative velocity of the centres and the line of centres [rad];
        "normal_speed": g_n [length/time]; "regime": number in `quantities.REGIMES`; "free_time": time since the latest
        collision, with a disk or a wall, of both disks, if they have had one [time] (record=["free_times"]).
    edges : array (b + 1,)
        Edges of the bins. Speeds and times beyond the first and last one are counted in the bins there.
    counts : array (pairs, b) of int

    Examples
    --------
    >>> import numpy as np
    >>> import ifrdem
    >>> found = ifrdem.observables.Histogram("regime", np.arange(6) - 0.5, np.array([[3, 1, 0, 0, 0]]))
    >>> found.total, found.density[0]
    (array([4]), array([0.75, 0.25, 0.  , 0.  , 0.  ]))
    """

    name: str
    edges: Array
    counts: NDArray[np.int64]

    @property
    def total(self) -> NDArray[np.int64]:
        """Number of all counts of each pair, shape (pairs,)."""
        return self.counts.sum(axis=1)

    @property
    def density(self) -> Array:
        """Probability density, shape (pairs, b) [1/unit of the edges]; nan for a pair that has not collided."""
        with np.errstate(invalid="ignore"):
            return self.counts / self.total[:, None] / np.diff(self.edges)

    @property
    def density_error(self) -> Array:
        """Standard error of the density by counting (`tools.intervals.error_of_share`), shape (pairs, b)."""
        return np.array([error_of_share(row, row.sum()) for row in self.counts]) / np.diff(self.edges)


@validated
def histogram_edges(name: HistogramName) -> Array:
    """Edges of the bins of a histogram, shape (bins + 1,): [rad], [length/time], [time] or numbers of regimes.

    Bins of the angle are even in tan psi / (1 + tan psi); those of speeds and times divide each power of 2 evenly.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.observables.histogram_edges("normal_speed")[[224, 225, 232]]
    array([1.   , 1.125, 2.   ])
    """
    number = HISTOGRAM.at[name].width
    if name == "impact_angle":
        part = np.arange(number + 1) / number
        return np.arctan2(part, 1.0 - part)
    if name == "regime":
        return np.arange(number + 1) - 0.5
    k = np.arange(OCTAVES * PER_OCTAVE + 1)
    return np.ldexp(1.0 + k % PER_OCTAVE / PER_OCTAVE, FIRST_OCTAVE + k // PER_OCTAVE)


@validated
def histogram(name: HistogramName, after: Measure, before: Measure | None = None) -> Histogram:
    """The histogram of this name of the collisions until a measure, from the start or from another measure on.

    Raises
    ------
    InputError
        If a measure has no histograms (record=["histograms"]), or the second one is the later one.

    Examples
    --------
    >>> import ifrdem
    >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    >>> law = ifrdem.IFRLaw(e_n=1.0, e_t=-1.0, mu=0.0)
    >>> start = ifrdem.State([[2.0, 2.0], [4.0, 2.0]], [[1.0, 0.0], [-1.0, 0.0]], [0.0, 0.0])
    >>> gas = ifrdem.Simulation(disks, ifrdem.Box((10.0, 10.0)), law, start, record=["histograms"])
    >>> _ = gas.run(t_end=1.0)
    >>> found = ifrdem.observables.histogram("normal_speed", gas.measure())
    >>> int(found.counts[0].argmax()), float(found.edges[found.counts[0].argmax()])
    (232, 2.0)
    """
    counts, earlier = after.histograms, None if before is None else before.histograms
    if counts is None or (before is not None and earlier is None):
        raise InputError('histograms: not recorded; make the simulation with record=["histograms"]')
    if before is not None and not after.time > before.time:
        raise InputError(f"after.time = {after.time:g}: must be later than before.time = {before.time:g}")
    since = counts if earlier is None else counts - earlier
    if name not in (found := split(since)):
        raise InputError(f'{name}: not recorded; make the simulation with record=["free_times"]')
    return Histogram(name, histogram_edges(name), found[name])


def split(counts: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
    """The histograms by name, shape (..., bins) each, of counts as `Measure.histograms` has them: those that it has."""
    return {
        name: counts[..., at.first : at.first + at.width]
        for name, at in HISTOGRAM.at.items()
        if at.first < counts.shape[-1]
    }
