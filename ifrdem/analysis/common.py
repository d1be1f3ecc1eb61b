"""Helpers of all analyses: frames as arrays, boxes, neighbours, standard errors of correlated series."""

from __future__ import annotations

import functools
import importlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import ModuleType
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, install_extra
from ..model.box import Box
from ..tools.checked import LEAST, Array, Numbers, Real, check_of, is_masked, must_be, validated

PACKAGES = {"freud": "freud-analysis", "finufft": "finufft"}
"""Name to import -> name to install."""


def load(name: str, purpose: str) -> ModuleType:
    """Import an optional package.

    InputError if it is absent: the message says what needs it and how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"{purpose} requires the package {PACKAGES[name]}: {install_extra('analysis')} ({error})"
        ) from None


def _frames(shape: tuple[int | str, ...]) -> Callable[[str, Any], Iterable[Array]]:
    """A check of one frame of this shape, or of several: an array or an iterable of frames."""
    one = Numbers(shape)

    def check(name: str, value: Any) -> Iterable[Array]:
        if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping | type):
            raise must_be(name, value, f"{one.needed}, or frames of them")
        single = isinstance(value, np.ndarray) and (value.ndim <= len(shape) or is_masked(value))
        if not single and isinstance(value, Sequence) and len(value):
            first = value[0]
            if len(shape) == 2 and isinstance(first, Sequence) and len(first):
                first = first[0]
            single = isinstance(first, int | float)
        return (one(name, value),) if single else (one(f"{name}[{i}]", each) for i, each in enumerate(value))

    return check


Positions = Annotated[Array | Iterable[Array], _frames(("n", 2))]
"""One frame, shape (n, 2), or several: an array (frames, n, 2) or anything that yields frames one by one."""
Spins = Annotated[Array | Iterable[Array], _frames(("n",))]
"""As `Positions`, with one number for each disk, shape (n,)."""


def as_box(name: str, box: Any) -> Box:
    """Return a box unchanged, or the periodic box of two side lengths [length]."""
    if isinstance(box, Box):
        return box
    try:
        sides = Numbers((2,), low=LEAST, each="positive and finite")(name, box)
    except InputError as error:
        raise InputError(f"{error} (or it must be a Box)") from None
    return Box((float(sides[0]), float(sides[1])))


BoxLike = Annotated[Any, as_box]
"""A box, or two side lengths [length] of a periodic one."""


def _times(name: str, time: Any) -> Iterable[float]:
    """The times of frames: those given, or one time for all."""
    of_frame = check_of(Real)
    assert of_frame is not None
    if not isinstance(time, Iterable) or (isinstance(time, np.ndarray) and not time.ndim):
        return itertools.repeat(of_frame(name, time))
    if isinstance(time, str | bytes | Mapping | type) or is_masked(time):
        raise must_be(name, time, f"{of_frame.needed}, or one for each frame")

    def each() -> Iterator[float]:
        for i, one in enumerate(time):
            yield of_frame(f"{name}[{i}]", one)
        raise InputError(f"{name}: must have a time for each frame")

    return each()


Times = Annotated[Any, _times]
"""A time of all frames, or one for each [time]."""


MOST_AT_ONE_PLACE = 1000
"""Centres at one place: of 50,000, freud overflows its stack, which ends the process."""
MOST_PAIRS = 1e8
"""Pairs of neighbours that are listed at once, which take some 4 GB."""


class FreudFrame(NamedTuple):
    """A frame as freud takes it."""

    box: Any
    points: NDArray[np.float32]


def _sides_for_freud(position: Array, box: Box, reach: float) -> tuple[Array, Array]:
    """Corner and lengths [length] of the box that freud gets; an open one is what the disks span."""
    low, lengths = np.zeros(2), np.array(box.lengths)
    if box.is_open:
        low = position.min(axis=0)
        lengths = np.ptp(position, axis=0)
    periodic = np.array(box.periodic)
    return np.where(periodic, low, low - 1.25 * reach), np.where(periodic, lengths, lengths + 2.5 * reach)


def freud_frame(position: Array, box: Box, reach: float, time: float, purpose: str) -> FreudFrame:
    """Positions [length] in a box of freud whose sides are all periodic, for neighbours up to `reach` [length].

    Where the box is not periodic it is wider by `reach`, so that nothing has neighbours through a side. A sheared box
    is a skewed one. freud computes in single precision. InputError if the reach is more than half the shortest side,
    where neighbours would be counted twice.
    """
    freud = load("freud", purpose)
    low, lengths = _sides_for_freud(position, box, reach)
    if reach >= 0.5 * lengths.min():
        raise InputError(
            f"{purpose}: neighbours up to {reach:.4g}: must be less than half the shortest side of the box, "
            f"{0.5 * lengths.min():.4g}; choose a shorter distance"
        )
    shift = box.image_above(time) if box.shear_rate else 0.0
    shift -= lengths[0] if shift > 0.5 * lengths[0] else 0.0
    made = freud.box.Box(lengths[0], lengths[1], xy=shift / lengths[1], is2D=True)
    points = np.zeros((len(position), 3), dtype=np.float32)
    points[:, :2] = position - (low + 0.5 * lengths)
    points = made.wrap(points)
    places = np.sort(np.ascontiguousarray(points[:, :2]).view(np.int64).ravel())
    if (places[MOST_AT_ONE_PLACE:] == places[:-MOST_AT_ONE_PLACE]).any():
        raise InputError(
            f"{purpose}: position: more than {MOST_AT_ONE_PLACE} disks have their centres at one place, where no disks "
            "of a gas can be"
        )
    return FreudFrame(made, points)


def neighbours(
    position: Array, box: Box, reach: float, time: float = 0.0, purpose: str = "neighbours"
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Pairs i < j of centres nearer than `reach` [length], and the vectors from i to j [length], (p,), (p,), (p, 2).

    Found by freud in single precision with a margin, measured in double.
    """
    if len(position) < 2:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), np.zeros((0, 2))
    freud = load("freud", purpose)
    span = 1.0 if box.is_open else max(box.lengths)
    margin = reach + SINGLE * span
    area = float(np.prod(_sides_for_freud(position, box, margin)[1]))
    pairs = 0.5 * len(position) ** 2 * min(1.0, np.pi * margin**2 / area)
    if pairs > MOST_PAIRS:
        raise InputError(
            f"{purpose}: neighbours up to {reach:.4g} of {len(position)} disks are some {pairs:.2g} pairs: at most "
            f"{MOST_PAIRS:g}; choose a shorter distance"
        )
    found = []
    rows = strips_of(len(position), box)
    for row in range(rows):
        near, own = strip(position, box, row, rows, margin)
        frame = freud_frame(position[near], box, margin, time, purpose)
        query = freud.locality.AABBQuery(frame.box, frame.points).query(frame.points[own], {"r_max": margin})
        listed = query.toNeighborList()
        i = near[own[listed.query_point_indices]]
        j = near[listed.point_indices]
        once = i < j
        i, j = i[once], j[once]
        vector = box.minimum_image(position[j] - position[i], time)
        close = np.einsum("ij,ij->i", vector, vector) < reach * reach
        found.append((i[close], j[close], vector[close]))
    i, j, vector = (np.concatenate(each) for each in zip(*found, strict=True))
    return i, j, vector


SINGLE = 1e-6
"""Part of the box that positions in single precision are off by, at most."""
AT_ONCE = 1 << 20
"""Disks that are worked on together, where what is computed of all would need several times the memory of a frame."""


def blocks(n: int, size: int = 0) -> Iterator[slice]:
    """Slices of n disks, one after another, of this size or AT_ONCE."""
    size = size or AT_ONCE
    for first in range(0, n, size):
        yield slice(first, min(first + size, n))


def near_row(y: Array, box: Box, row: int, rows: int, reach: float) -> NDArray[np.bool_]:
    """True for disks, of these y [length], that are in a row of equal rows of the box along x, or nearer to it."""
    length = box.lengths[1]
    farthest = 0.5 * length / rows + reach + SINGLE * max(box.lengths)
    near = np.empty(len(y), dtype=bool)
    for some in blocks(len(y)):
        away = y[some] - (row + 0.5) * length / rows
        if box.periodic[1]:
            away -= length * np.round(away / length)
        near[some] = np.abs(away) <= farthest
    return near


def strips_of(n: int, box: Box) -> int:
    """Number of strips in which neighbours of n disks are looked for: of some AT_ONCE disks; one of an open box."""
    return 1 if box.is_open else max(1, -(-n // AT_ONCE))


def strip(
    position: Array, box: Box, row: int, rows: int, reach: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Disks in one of equal strips of the box along x or nearer to it than `reach` [length], and which are in it.

    The latter as places in the former. Each disk is in one strip.
    """
    if rows == 1:
        return np.arange(len(position)), np.arange(len(position))
    near = np.flatnonzero(near_row(position[:, 1], box, row, rows, reach))
    y = position[near, 1] / box.lengths[1]
    level = rows * (y - np.floor(y)) if box.periodic[1] else rows * y
    return near, np.flatnonzero(np.clip(level.astype(np.intp), 0, rows - 1) == row)


def cells_of(position: Array, box: Box, side: int) -> NDArray[np.intp]:
    """Cell of the box, or of what the disks span in an open one, of each disk; so many along a side."""
    low, lengths = np.zeros(2), np.array(box.lengths)
    if box.is_open:
        low, lengths = position.min(axis=0), np.ptp(position, axis=0)
    cell = np.clip((side * (position - low) / lengths).astype(np.intp), 0, side - 1)
    return cell[:, 0] * side + cell[:, 1]


def share_in_cell(r: Array, sides: Array) -> Array:
    """Share of the pairs of points at a distance r [length] that lie in one cell with these sides [length]."""
    a, b = sides
    share: Array = 1.0 - 2.0 * r / np.pi * (1.0 / a + 1.0 / b) + r**2 / (np.pi * a * b)
    return np.where(r < min(a, b), np.maximum(share, 0.0), 0.0)


Series = Annotated[ArrayLike, Numbers(("n",), least=1)]


@validated
def correlation_time(series: Series) -> float:
    """Integrated autocorrelation time of a series in steps, at least 1/2; the error of its mean is sqrt(2 tau / n) std.

    The sum of the autocorrelation, stopped at the first lag above five times itself (Madras and Sokal, J. Stat. Phys.
    50, 109 (1988), doi:10.1007/BF01022990).

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> round(analysis.correlation_time(rng.normal(size=10_000)), 1)  # independent numbers
    0.5
    """
    return float(_correlation_times(np.array(series, dtype=float)))


def _correlation_times(x: Array) -> Array:
    """`correlation_time` of series along the first axis, (n, ...)."""
    x = x - x.mean(axis=0)
    n = len(x)
    some = np.any(x, axis=0)
    if n < 4 or not np.any(some):
        return np.full(x.shape[1:], 0.5)
    padded = np.fft.rfft(x, 2 * n, axis=0)
    covariance = np.fft.irfft(np.abs(padded) ** 2, axis=0)[:n]
    tau = 0.5 + np.cumsum(covariance[1:] / np.where(some, covariance[0], 1.0), axis=0)
    lags = np.arange(1, n).reshape(-1, *[1] * (x.ndim - 1))
    # The last lag always qualifies: over all lags the autocorrelation about the mean adds up to -1/2, and tau to 0.
    stop = np.argmax(lags >= 5.0 * np.maximum(tau, 0.5), axis=0)
    return np.maximum(0.5, np.take_along_axis(tau, stop[None], axis=0)[0])


class MeanErrors(NamedTuple):
    """Standard errors of means of correlated series, and the number of independent values with the same error."""

    error: Array
    effective: Array


LEVEL = 0.0027
"""Probability of a mark by chance: that of a Gaussian beyond 3 standard errors."""
BLOCKS = 20
"""Blocks of a series whose means are looked at too; and values of a series below which nothing is said of correlations:
an interval of fewer holds less often than it says (n = 10, rho = 0.9: 80 % for 95 %)."""


def mean_errors(series: Array) -> MeanErrors:
    """Standard errors of the means of series along the first axis, (n, ...), and n_eff; nan for one row.

    Of a series of 40 rows or more, the means of `BLOCKS` equal blocks are a series too, with the same mean and slower
    correlations. The larger error of the two is taken, with its n_eff: noise of one correlation time gets the same from
    both, and a slow part below fast noise, which successive rows hide, is seen in the blocks.

    A series is taken as of the correlation rho^|lag|. The mean is one of the sample, so that the correlation of
    successive values that is seen is too low, by some (1 + 3 rho) / n (F. H. C. Marriott and J. A. Pope, Biometrika 41,
    390 (1954), doi:10.1093/biomet/41.3-4.390), and so is the sum of squares, by 1 / n_eff. Both are inverted exactly:
    rho is where the expectation of the correlation is the one that is seen, or follows from the integrated
    autocorrelation time if that is longer. Then

        n_eff = n^2 / sum_ij rho^|i - j|,    error^2 = sum_i (x_i - mean)^2 / (n (1 - 1 / n_eff)) / n_eff,

    and an interval of confidence is that of Student's t with n_eff - 1 degrees of freedom, 1 at least
    (`tools.intervals.student_t` of n_eff).
    """
    x = np.asarray(series, dtype=float)
    found = _errors_of_rows(x)
    if len(x) < 2 * BLOCKS:
        return found
    of_blocks = _errors_of_rows(block_means(x))
    larger = of_blocks.error > found.error * (1.0 + 1e-9)
    return MeanErrors(*(np.where(larger, new, old) for new, old in zip(of_blocks, found, strict=True)))


def block_means(series: Array) -> Array:
    """Means over `BLOCKS` equal parts of a series along the first axis, which may cut rows, (BLOCKS, ...)."""
    n = len(series)
    sums = np.concatenate((np.zeros_like(series[:1]), np.cumsum(series - series.mean(axis=0), axis=0)))
    at = n * np.arange(BLOCKS + 1) / BLOCKS
    row = np.minimum(at.astype(np.intp), n - 1)
    part = (at - row).reshape(-1, *[1] * (series.ndim - 1))
    cut: Array = sums[row] + part * (sums[row + 1] - sums[row])
    return np.asarray(series.mean(axis=0) + np.diff(cut, axis=0) * (BLOCKS / n))


def _errors_of_rows(x: Array) -> MeanErrors:
    """`mean_errors` by the correlation of rows alone."""
    n = len(x)
    if n < 2:
        nothing = np.full(x.shape[1:], np.nan)
        return MeanErrors(nothing, nothing)
    own = np.where(np.ptp(x, axis=0) == 0.0, 0.0, x - x.mean(axis=0))  # equal values have no rounding
    square = np.sum(own**2, axis=0)
    rho = np.zeros(x.shape[1:])
    if n >= FEWEST_CORRELATED:
        observed = np.sum(own[1:] * own[:-1], axis=0) / np.where(square > 0.0, square, 1.0)
        values, expected = _expected_correlation(n)
        rho = np.interp(observed, expected, values)
        tau = _correlation_times(x)
        rho = np.where(square > 0.0, np.maximum(rho, (tau - 0.5) / (tau + 0.5)), 0.0)
    share = _variance_of_mean(n, rho)
    return MeanErrors(np.sqrt(square / (n * (1.0 - share)) * share), 1.0 / share)


FEWEST_CORRELATED = 4
"""Values below which a series says nothing of its own correlation."""


def _variance_of_mean(n: int, rho: Array) -> Array:
    """Variance of the mean of n values of variance 1 and correlation rho^|lag|: sum_ij rho^|i - j| / n^2."""
    return np.asarray((n + 2.0 * rho / (1.0 - rho) * (n - (1.0 - rho**n) / (1.0 - rho))) / n**2)


@functools.lru_cache(maxsize=64)
def _expected_correlation(n: int) -> tuple[Array, Array]:
    """Values of rho, and the mean correlation of successive values about the mean of n of them, both rising."""
    rho = np.concatenate((np.linspace(0.0, 0.9, 181), 1.0 - np.geomspace(0.0995, 0.01, 60)))
    rho = np.concatenate((rho, 1.0 - np.geomspace(0.0099, 0.1 / n, 120))) if n > 10 else rho
    rho = rho[rho <= 1.0 - 0.1 / n]
    of_mean = _variance_of_mean(n, rho)
    end = (1.0 - rho**n) / (1.0 - rho) / n  # covariance of the mean with the first value
    product = (n - 1) * rho - 2.0 * (n * of_mean - end) + (n - 1) * of_mean
    return rho, np.maximum.accumulate(product / (n * (1.0 - of_mean)))


class MeanValue(NamedTuple):
    """Mean of a series, its standard error, and the number of independent values with the same error."""

    mean: float
    error: float
    n_eff: float

    def times(self, factor: float) -> MeanValue:
        """The mean and its error times a number."""
        return MeanValue(self.mean * factor, self.error * abs(factor), self.n_eff)


@validated
def mean_with_error(series: Series) -> MeanValue:
    """Mean of a series, its standard error and n_eff by `mean_errors`; error and n_eff are nan for one value.

    Successive values may be correlated: n_eff is the number of independent values with the same error. The 95 %
    interval is the mean +- t times the error, with Student's t for n_eff - 1 degrees of freedom, 1 at least. Constant
    values have the error 0. Correlations of fewer than 20 values cannot be judged.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> mean, error, n_eff = analysis.mean_with_error(rng.normal(5.0, 1.0, size=10_000))
    >>> bool(abs(mean - 5.0) < 4.0 * error), round(error, 2)
    (True, 0.01)
    """
    x = np.asarray(series, dtype=float)
    error, n_eff = mean_errors(x)
    return MeanValue(float(x.mean()), float(error), float(n_eff))
