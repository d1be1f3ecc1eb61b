"""Mean-square displacement and velocity autocorrelation over frames, and the diffusion coefficient."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..tools.checked import Array, Count, Numbers, Real, must_be, validated
from ..tools.intervals import student_t
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from .common import LEVEL, BoxLike, MeanValue

FAR = 0.2
"""Difference of the exponent of a displacement from 1 above which it is no diffusion, unless it is chance."""
AT_A_TIME = 1024
"""Disks whose transforms are in memory at a time: they take ten times the memory of their paths."""
EVEN = 1e-3  # of the mean interval: how far intervals may differ where all origins are used


@dataclass(frozen=True, eq=False, repr=False)
class Correlation(Brief, ResultPlot):
    """A mean over disks at lags in time, such as a mean-square displacement."""

    lag: Array
    value: Array
    error: Array
    """lag, value, error: lags [time], the first is 0; the mean, and its standard error: disks count as independent,
    lags and origins of a disk do not; shape (lags,)."""
    covariance: Array
    """Covariance of `value` by the spread over disks: what a fit to it needs; shape (lags, lags)."""
    components: int
    disks: int
    origins: str
    """components, disks, origins: directions in space that it is the sum of, number of disks, "all" or "first"."""


@dataclass(frozen=True)
class Diffusion:
    """A diffusion coefficient from a mean-square displacement."""

    D: float
    error: float
    """D, error: slope over twice the number of directions [length^2/time], and its standard error by the spread over
    disks."""
    exponent: float
    exponent_error: float
    """exponent, exponent_error: of the power law between the ends of the fit: 1 where it diffuses, 2 where disks fly,
    between them where the fit is too early or the gas cools; and its standard error by the spread over disks."""
    disks: int
    """Number of disks: intervals are Student's t with one degree of freedom less."""
    lags: tuple[float, float]
    """Of the first and the last lag used [time]."""

    @property
    def mean(self) -> MeanValue:
        """D, its error, and the number of disks."""
        return MeanValue(self.D, self.error, self.disks)

    @property
    def no_diffusion(self) -> bool:
        """True if the exponent is off 1 by more than `FAR`, and by more than chance (0.27 % in Student's t)."""
        off = abs(self.exponent - 1.0)
        beyond = float(student_t(self.disks, 1.0 - LEVEL)) * self.exponent_error
        return off > FAR and not off <= beyond


_Frames = Annotated[ArrayLike, Numbers(("frames", "n", 2))]
_FrameTimes = Annotated[ArrayLike, Numbers(("frames",))]


@validated
def unwrap(
    position: _Frames, box: BoxLike, *, image: _Frames | None = None, velocity: _Frames | None = None,
    times: Annotated[ArrayLike, Numbers(("frames",), scalar=True)] = 0.0,
) -> Array:  # fmt: skip
    """Paths without jumps through periodic sides [length], shape (frames, n, 2).

    InputError if steps of any disk are too long, or a sheared box has no images.

    Parameters
    ----------
    position : array (frames, n, 2)
        Centres in the box [length].
    image : array (frames, n, 2), optional
        Box lengths travelled. Without them each step between frames is taken as the shortest possible one, and
        refused if a disk may have moved further than half of the box.
    velocity : array (frames, n, 2), optional
        Velocities [length/time]: the largest step of a disk is its speed in either frame times the time between them.
        Without them the root of the mean square of each disk's own steps must be below an eighth of the box.
    times : array (frames,), optional
        Needed for velocities and sheared boxes [time].

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> position = np.array([[[9.5, 5.0]], [[0.5, 5.0]]])  # one disk at two times, across a side
    >>> analysis.unwrap(position, (10.0, 10.0))[:, 0, 0]
    array([ 9.5, 10.5])
    """
    x = np.array(position, dtype=np.float64)
    if box.is_open:
        return x
    if image is not None:
        if np.shape(image) != x.shape:
            raise InputError(f"image has shape {np.shape(image)}: must have that of position, {x.shape}")
        if np.shape(times) not in ((), (len(x),)):
            raise InputError(
                f"times has shape {np.shape(times)}: must have a number for each of {len(x)} frames"
            )
        when = np.broadcast_to(np.asarray(times, dtype=float), len(x))
        for one, turns, t in zip(x, np.asarray(image), when, strict=True):
            one[:] = box.unwrap(one, turns, float(t))
        return x
    if box.shear_rate:
        raise InputError('paths in a sheared box need images: put "image" into output.fields of the case')
    step = box.minimum_image(np.diff(x, axis=0))
    if velocity is None:
        # Of each disk: fast ones among many slow ones hide in a mean over all. Gaussian steps beyond half a box, four
        # times the rms, are 6e-5 of all; uniform ones, which determine nothing, have an rms of 0.29 boxes.
        per_interval, most = (
            np.sqrt(np.mean(step**2, axis=0, keepdims=True)) if len(step) else step,
            1.0 / 8.0,
        )
    else:
        v = np.abs(np.asarray(velocity, dtype=np.float64))
        if v.shape != x.shape:
            raise InputError(f"velocity has shape {v.shape}: must have that of position, {x.shape}")
        time = np.broadcast_to(np.asarray(times, dtype=np.float64), len(x))
        per_interval, most = np.maximum(v[1:], v[:-1]) * np.diff(time)[:, None, None], 0.5
    for axis in (0, 1):
        longest = float(per_interval[:, :, axis].max(initial=0.0)) / box.lengths[axis]
        if box.periodic[axis] and longest > most:
            raise InputError(
                f"between frames a disk moves {longest:.2g} of the box along {'xy'[axis]}: must be at most {most:g} "
                'without images; put "image" into output.fields of the case, or write more frames'
            )
    return np.concatenate((x[:1], x[:1] + np.cumsum(step, axis=0)))


_OF_PATHS = Numbers(("frames", "n", "d"))


def _paths(name: str, value: Any) -> Iterable[Array]:
    """Paths, or parts of them one after another."""
    if isinstance(value, np.ndarray):
        return (_OF_PATHS(name, value),)
    if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping | type):
        raise must_be(name, value, f"{_OF_PATHS.needed}, or parts of it for some disks each")
    return (_OF_PATHS(f"{name}[{i}]", part) for i, part in enumerate(value))


Paths = Annotated[Array | Iterable[Array], _paths]
"""Paths of disks, shape (frames, n, d), or parts of them for some disks each."""


def _correlation(
    name: str, times: ArrayLike, paths: Any, origins: str, most: int, values: Callable[[Array, int], Array]
) -> Correlation:
    """The mean over disks of values (lags, n) of paths (frames, n, d), a few disks at a time."""
    lag = _lags(times, origins, most)
    n, components, total, square = 0, 0, np.zeros(len(lag)), np.zeros((len(lag), len(lag)))
    for path in _parts(name, paths, len(np.asarray(times))):
        found = np.empty((len(lag), path.shape[1]))
        for first in range(0, path.shape[1], AT_A_TIME):
            few = slice(first, first + AT_A_TIME)
            found[:, few] = values(path[:, few], len(lag))
        n, components = n + path.shape[1], path.shape[2]
        total += found.sum(axis=1)
        square += found @ found.T
    mean = total / n
    covariance = (square / n - np.outer(mean, mean)) / (n - 1) if n > 1 else np.full_like(square, np.nan)
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Correlation(lag, mean, error, covariance, components, n, origins)


def _lags(times: ArrayLike, origins: str, most: int) -> Array:
    """Lags for these times, at most so many; InputError if they do not suit the origins."""
    t = np.asarray(times, dtype=float)
    if len(t) < 2:
        raise InputError(f"times has shape {t.shape}: must have 2 frames or more")
    if not np.all(np.diff(t) > 0.0):
        raise InputError(f"times from {t[0]:g} to {t[-1]:g}: must increase from each frame to the next")
    if origins == "all" and np.ptp(np.diff(t)) > EVEN * np.mean(np.diff(t)):
        raise InputError('frames are not evenly spaced in time: origins = "first" is possible, "all" is not')
    lag = t - t[0]
    return lag if origins == "first" else lag[: min(len(t), most)]


@validated
def mean_square_displacement(
    times: _FrameTimes,
    paths: Paths,
    *,
    origins: Literal["all", "first"] = "all",
    most_lags: Count = 500,
) -> Correlation:
    """Mean-square displacement <|x(s + t) - x(s)|^2> over disks and time origins s (all frames, or the first).

    Over all frames by the Fourier transform (V. Calandrini et al., Collection SFN 12, 201 (2011),
    doi:10.1051/sfn/201112010), which needs frames that are evenly spaced and a gas in a steady state. A gas that
    cools has no such mean: take "first" there. InputError if times are not even for "all", or shapes do not match.

    Parameters
    ----------
    times : array (frames,)
        Times of the frames [time].
    paths : array (frames, n, d), or parts of it for some disks each
        Unwrapped positions [length] (see `unwrap`); d directions count.
    most_lags : int
        Lags at most, from the shortest on, where all origins count.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> times = np.arange(200.0)
    >>> paths = np.cumsum(rng.normal(size=(200, 100, 2)), axis=0)
    >>> msd = analysis.mean_square_displacement(times, paths)
    >>> bool(abs(msd.value[msd.lag == 10.0][0] / 20.0 - 1.0) < 0.1)  # a random walk of unit steps: 2 t
    True
    """

    def values(path: Array, lags: int) -> Array:
        path = path - path[0]
        if origins == "first":
            return np.sum(path**2, axis=2)
        frames, step = len(path), np.arange(lags)
        square = np.concatenate((np.zeros_like(path[:1, :, 0]), np.cumsum(np.sum(path**2, axis=2), axis=0)))
        # Sums of |x(s)|^2 and |x(s + t)|^2 over the origins s that a lag has.
        ends = square[frames - step] + (square[frames] - square[step])
        return (ends - 2.0 * _autocorrelation(path)[:lags]) / (frames - step)[:, None]

    return _correlation("paths", times, paths, origins, most_lags, values)


@validated
def velocity_autocorrelation(
    times: _FrameTimes,
    velocity: Paths,
    *,
    origins: Literal["all", "first"] = "all",
    most_lags: Count = 500,
) -> Correlation:
    """Velocity autocorrelation <v(s) . v(s + t)> over disks and origins s [length^2/time^2], not normalised.

    `velocity` as `paths` of `mean_square_displacement` [length/time]; the rest as there.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> found = analysis.velocity_autocorrelation(np.arange(50.0), rng.normal(size=(50, 1000, 2)))
    >>> found.value[:2].round(1) + 0.0
    array([2., 0.])
    """

    def values(v: Array, lags: int) -> Array:
        if origins == "first":
            return np.sum(v * v[0], axis=2)
        return _autocorrelation(v)[:lags] / (len(v) - np.arange(lags))[:, None]

    return _correlation("velocity", times, velocity, origins, most_lags, values)


def _parts(name: str, values: Array | Iterable[Array], frames: int) -> Iterable[Array]:
    found = False
    for part in values:
        if len(part) != frames:
            raise InputError(f"{name} has shape {part.shape}: must have {frames} frames, as many as times")
        found = found or part.size > 0
        yield part
    if not found:
        raise InputError(f"{name}: must have one disk or more")


def _autocorrelation(x: Array) -> Array:
    """Sum over s of x(s) . x(s + t), shape (frames, n), of x of shape (frames, n, d)."""
    frames = len(x)
    transformed = np.fft.rfft(x, 2 * frames, axis=0)
    return np.fft.irfft(np.sum(np.abs(transformed) ** 2, axis=2), 2 * frames, axis=0)[:frames]


@validated
def diffusion_coefficient(
    msd: Correlation, *, first: Real | None = None, last: Real | None = None
) -> Diffusion:
    """Fit a diffusion coefficient to a mean-square displacement between two lags [time].

    By default from a half of the longest lag to its end where the origin is the first frame, and from a tenth of it
    to a half, which more origins know, where all are; all lags if these are fewer than 3. InputError if fewer than 3
    lags lie between.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> times = np.arange(200.0)
    >>> paths = np.cumsum(rng.normal(size=(200, 100, 2)), axis=0)
    >>> msd = analysis.mean_square_displacement(times, paths)
    >>> found = analysis.diffusion_coefficient(msd)
    >>> bool(abs(found.D - 0.5) < 4.0 * found.error + 0.05)
    True
    """
    longest = float(msd.lag[-1])
    share = (0.1, 0.5) if msd.origins == "all" else (0.5, 1.0)
    low = share[0] * longest if first is None else first
    high = share[1] * longest if last is None else last
    used = (msd.lag >= low) & (msd.lag <= high) & (msd.lag > 0.0)
    if first is None and last is None and np.count_nonzero(used) < 3:
        used = msd.lag > 0.0  # so few that all are needed
    if np.count_nonzero(used) < 3:
        lags = f"first = {low:.4g}, last = {high:.4g}: {np.count_nonzero(used)} lags"
        raise InputError(f"{lags} lie between them, must be 3 or more for a fit")
    t, value = msd.lag[used], msd.value[used]
    weight = (t - t.mean()) / np.sum((t - t.mean()) ** 2)  # slope = weight . value
    variance = float(weight @ msd.covariance[np.ix_(used, used)] @ weight)
    factor = 2.0 * msd.components
    exponent = of_exponent = float("nan")
    if np.all(value > 0.0):
        log = np.log(t) - np.log(t).mean()
        of_log = log / (log @ log)  # exponent = of_log . ln value
        exponent = float(of_log @ np.log(value))
        of_log = of_log / value
        of_exponent = float(np.sqrt(max(of_log @ msd.covariance[np.ix_(used, used)] @ of_log, 0.0)))
    ends, D = (float(t[0]), float(t[-1])), float(weight @ value) / factor
    error = float(np.sqrt(max(variance, 0.0))) / factor
    return Diffusion(D, error, exponent, of_exponent, msd.disks, ends)
