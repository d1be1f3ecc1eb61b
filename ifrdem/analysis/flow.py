"""Velocity correlations in space, and their spectrum: vortices of a cooling gas.

T. P. C. van Noije, M. H. Ernst, R. Brito and J. A. G. Orza, Phys. Rev. Lett. 79, 411 (1997),
doi:10.1103/PhysRevLett.79.411.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import Array, Positive, validated
from ..tools.intervals import of_intensity
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from .common import BoxLike, Positions, Times, blocks, cells_of, share_in_cell
from .structure import Bins, in_rings, mode_amplitudes, ring_edges

MOST_PAIRS = 4_000_000
"""Most pairs of a frame that are counted (about 1 s). In larger gases centres are drawn at random."""
MOST_WAVES = 20_000_000
"""Waves of a spectrum (some 2 GB of memory)."""
BLOCK = 2_000_000
"""Number of pairs that are computed at a time."""
SIDE = 5
"""Cells along a side of the box; errors come from the scatter between cells."""
CLEAR = 3.0
"""Standard errors by which a correlation must be above 0 before its length is given."""


@dataclass(frozen=True, eq=False, repr=False)
class VelocityCorrelation(Brief, ResultPlot):
    """Correlation of the velocities of two disks at a distance r, along r and across it, over <v^2> / 2."""

    r: Array
    along: Array
    along_error: Array
    across: Array
    across_error: Array
    """r, along, across: middles of the bins [length]; <(v_i . e)(v_j . e)> / (<v^2> / 2) with e along r_j - r_i, and
    across it; 0 for independent velocities, 1 for equal ones; and their standard errors from the scatter between 25
    cells of the box, nan where only one has pairs. Frames count as fully correlated: more of them do not reduce the
    errors. Shape (bins,)."""
    n_eff: Array
    """Cells with pairs, the fewest in any frame: intervals are Student's t with n_eff - 1 degrees of freedom. Shape
    (bins,)."""
    pairs: Array
    """Number of pairs over all frames, shape (bins,)."""
    frames: int

    @property
    def length(self) -> float:
        """Correlation length: the r at which the correlation across r first falls below 0; nan if none is seen.

        It is nan, too, if no bin before that is above 0 by 3 standard errors. In a plane shear wave of wave number k
        it is 1.841 / k.
        """
        below = np.flatnonzero(self.across < 0.0)
        first = int(below[0]) if len(below) else 0
        clear = self.across[:first] > CLEAR * self.across_error[:first]
        if not clear.any():
            return float("nan")
        a, b = self.across[first - 1], self.across[first]
        return float(self.r[first - 1] + (self.r[first] - self.r[first - 1]) * a / (a - b))


@validated
def velocity_correlation(
    position: Positions,
    velocity: Positions,
    box: BoxLike,
    *,
    r_max: Positive,
    bins: Bins = 60,
    time: Times = 0.0,
) -> VelocityCorrelation:
    """Velocity correlations along and across r, of one or several frames.

    Velocities are relative to the mean of each frame, which makes the mean over all pairs -1 / (n - 1).

    InputError if shapes do not match, there are no frames or fewer than 2 disks, nothing moves, or r_max is beyond half
    the shortest periodic side.

    Parameters
    ----------
    position, velocity : array (n, 2) or frames of them
        Centres [length] and velocities [length/time], of a sheared gas the peculiar ones.
    box : Box, or two lengths of a periodic one
    r_max, bins : float, int
        Where the bins end [length], and their number.
    time : float or one for each frame
        Needed for sheared boxes [time].

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> x, v = 50.0 * rng.random((2000, 2)), rng.normal(size=(2000, 2))
    >>> found = analysis.velocity_correlation(x, v, (50.0, 50.0), r_max=20.0)
    >>> bool(np.all(np.abs(found.along[10:]) < 0.1)), found.length  # no correlation, no length
    (True, nan)
    """
    half = 0.5 * min([side for side in box.periods if side] or [np.inf])
    if r_max > half:
        raise InputError(f"r_max = {r_max:g}: must be at most half the shortest side of the box, {half:g}")
    edges = np.linspace(0.0, r_max, bins + 1)
    found = []
    for x, v, when in _frames(position, velocity, time):
        parts, of_centres = _pair_sums(x, v, box, r_max, bins, when)  # (3, cells, bins)
        totals = parts.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = totals[:2] / totals[2]
            own = parts[:2] - mean[:, None] * parts[2]
            cells = np.count_nonzero(parts[2], axis=0).astype(float)
            error = np.sqrt(np.sum(own**2, axis=1) * (cells / (cells - 1.0))) / totals[2]
        r = 0.5 * (edges[1:] + edges[:-1])
        # A pair across two cells of two centres is counted once in each, and the covariance of the cells is missing.
        same = share_in_cell(r, (np.ptp(x, axis=0) if box.is_open else np.array(box.lengths)) / SIDE)
        error *= np.sqrt((1.0 + of_centres) / (1.0 + of_centres * same))
        found.append(VelocityCorrelation(r, mean[0], error[0], mean[1], error[1], cells, totals[2], 1))
    if not found:
        raise InputError("position has no frames: must have one or more")
    return mean_correlation(found)


def mean_correlation(found: Sequence[VelocityCorrelation]) -> VelocityCorrelation:
    """Mean of correlations of single frames, weighted by their pairs; errors take frames as fully correlated."""
    weight = np.array([one.pairs for one in found])
    pairs = weight.sum(axis=0)

    def over_frames(name: str) -> Array:
        values = np.array([getattr(one, name) for one in found])
        with np.errstate(divide="ignore", invalid="ignore"):
            mean: Array = np.sum(np.where(weight > 0.0, values * weight, 0.0), axis=0) / pairs
        return mean

    along, along_error, across, across_error = map(
        over_frames, ("along", "along_error", "across", "across_error")
    )
    cells = np.min([np.where(one.pairs > 0.0, one.n_eff, np.inf) for one in found], axis=0)
    cells = np.where(pairs > 0.0, cells, 0.0)
    return VelocityCorrelation(found[0].r, along, along_error, across, across_error, cells, pairs, len(found))


def _frames(position: Positions, velocity: Positions, time: Times) -> Iterator[tuple[Array, Array, float]]:
    """Positions, velocities about their mean over sqrt(<v^2> / 2), and the time of each frame."""
    times = iter(time)
    for x, v in itertools.zip_longest(position, velocity):
        if x is None or v is None or x.shape != v.shape or len(x) < 2:
            raise InputError("position and velocity: must have the same shape, of 2 disks or more")
        own = v - v.mean(axis=0)
        square = 0.5 * sum(float(np.sum(own[some] ** 2)) for some in blocks(len(own))) / len(own)
        if square == 0.0:
            raise InputError("velocity: must differ between disks: without motion there is no correlation")
        own /= np.sqrt(square)  # no copy: of many disks each takes as much memory as the frame
        yield x, own, next(times)


def _pair_sums(x: Array, v: Array, box: Box, r_max: float, bins: int, time: float) -> tuple[Array, float]:
    """Sums over pairs of both products and of 1, by cell of the first centre and bin of r, shape (3, cells, bins).

    And the share of all disks that are first ones.
    """
    n = len(x)
    centres: NDArray[np.intp] = np.arange(n)
    if n * n > MOST_PAIRS:
        centres = np.random.default_rng(0).choice(n, max(MOST_PAIRS // n, 100), replace=False)
    cell = cells_of(box.wrap(x, time), box, SIDE)
    found = np.zeros((3, SIDE**2 * bins))
    size = max(1, BLOCK // n)
    for first in range(0, len(centres), size):
        i = centres[first : first + size]
        vector = box.minimum_image(x[None, :, :] - x[i][:, None, :], time)
        r = np.hypot(vector[..., 0], vector[..., 1])
        near = (r > 0.0) & (r < r_max)
        row, j = np.nonzero(near)
        e = vector[near] / r[near][:, None]
        a, b = v[i[row]], v[j]
        along = np.sum(a * e, axis=1) * np.sum(b * e, axis=1)
        across = (a[:, 1] * e[:, 0] - a[:, 0] * e[:, 1]) * (b[:, 1] * e[:, 0] - b[:, 0] * e[:, 1])
        at = cell[i[row]] * bins + np.minimum((r[near] * (bins / r_max)).astype(np.intp), bins - 1)
        for k, weight in enumerate((along, across, None)):
            found[k] += np.bincount(at, weight, minlength=SIDE**2 * bins)
    return found.reshape(3, SIDE**2, bins), len(centres) / n


@dataclass(frozen=True, eq=False, repr=False)
class VelocitySpectrum(Brief, ResultPlot):
    """Spectrum of the velocity field, across k (its vorticity) and along k, over that of independent velocities."""

    k: Array
    across: Array
    across_error: Array
    along: Array
    along_error: Array
    """k, across, along: mean |k| of the modes in each ring [1/length]; <|v_k|^2> / (n <v^2> / 2) with
    v_k = sum_j v_j exp(-i k r_j), its part across k, and along it; 1 for independent velocities; and their standard
    errors, which take frames as fully correlated; shape (rings,)."""
    modes: NDArray[np.int64]
    """Number of modes in a frame, counting one of k and -k, shape (rings,)."""
    frames: int

    @property
    def across_ends(self) -> tuple[Array, Array]:
        """Ends of the 95 % interval across k, (rings,) each, as `StructureFactor.ends`."""
        return of_intensity(self.across, self.across_error)

    @property
    def along_ends(self) -> tuple[Array, Array]:
        """Ends of the 95 % interval along k, (rings,) each, as `StructureFactor.ends`."""
        return of_intensity(self.along, self.along_error)

    @property
    def vorticity(self) -> Array:
        """k^2 times the part across k, the spectrum of the vorticity over <v^2> / 2 [1/length^2], shape (rings,)."""
        found: Array = self.k**2 * self.across
        return found

    @property
    def wavelength(self) -> float:
        """2 pi over the k of the strongest ring across k [length]."""
        return float(2.0 * np.pi / self.k[int(np.argmax(self.across))])


@validated
def velocity_spectrum(
    position: Positions,
    velocity: Positions,
    box: BoxLike,
    *,
    k_max: Positive,
    rings: Bins = 60,
    time: Times = 0.0,
) -> VelocitySpectrum:
    """Spectrum of the velocity field of one or several frames, by finufft, at the k that a periodic box allows.

    InputError as `velocity_correlation`; if the box is not periodic, k_max is below 2 pi / L or so high that there are
    more than `MOST_WAVES` waves, or finufft is missing.

    Parameters
    ----------
    position, velocity, box, time
        As for `velocity_correlation`.
    k_max, rings : float, int
        End of the rings [1/length], and their number at most; they are no narrower than 2 pi / L.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> x, v = 50.0 * rng.random((2000, 2)), rng.normal(size=(2000, 2))
    >>> found = analysis.velocity_spectrum(x, v, (50.0, 50.0), k_max=2.0)
    >>> bool(abs(found.across[-1] - 1.0) < 0.3)  # independent velocities: 1
    True
    """
    edges = ring_edges(box, k_max, rings)
    lengths, count = np.array(box.lengths), len(edges) - 1
    modes = np.ceil(k_max * lengths / (2.0 * np.pi))
    if box.shear_rate:  # the skew moves k_y by up to k_x / 2 Lx / Ly
        modes[1] += np.ceil(0.5 * modes[0]) + 1.0
    if float(np.prod(2.0 * modes + 1.0)) > MOST_WAVES:
        most = np.pi * np.sqrt(MOST_WAVES / (lengths[0] * lengths[1]))
        raise InputError(
            f"k_max = {k_max:g}: must be at most about {most:.3g}, up to which this box allows {MOST_WAVES:,} waves"
        )
    number, sum_k, sums, squares = (
        np.zeros(count),
        np.zeros(count),
        np.zeros((2, count)),
        np.zeros((2, count)),
    )
    frames, (a, b) = 0, modes.astype(int).tolist()
    for x, v, when in _frames(position, velocity, time):
        k, v_k = mode_amplitudes(x, v.T, box, (a, b), time=when)
        chosen, size, ring = in_rings(k, edges, edges[0], k_max)
        e, amplitude = k[chosen] / size[:, None], v_k[:, chosen]
        parts = (
            np.abs(e[:, 0] * amplitude[1] - e[:, 1] * amplitude[0]) ** 2 / len(x),
            np.abs(e[:, 0] * amplitude[0] + e[:, 1] * amplitude[1]) ** 2 / len(x),
        )
        number += np.bincount(ring, minlength=count)
        sum_k += np.bincount(ring, size, minlength=count)
        for i, part in enumerate(parts):
            sums[i] += np.bincount(ring, part, minlength=count)
            squares[i] += np.bincount(ring, part**2, minlength=count)
        frames += 1
    if frames == 0:
        raise InputError("position has no frames: must have one or more")
    full = number > 0.0
    mean = sums[:, full] / number[full]
    # The square of a Gaussian mode has a standard deviation equal to its mean: the least, as one mode has no scatter.
    spread = np.maximum(squares[:, full] / number[full] - mean**2, mean**2)
    error = np.sqrt(spread / (number[full] / frames))
    whole = np.rint(number[full] / frames).astype(np.int64)
    return VelocitySpectrum(sum_k[full] / number[full], mean[0], error[0], mean[1], error[1], whole, frames)
