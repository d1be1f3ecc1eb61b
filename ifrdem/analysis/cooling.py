"""Fits to a cooling gas: Haff's law, and the relaxation of the ratio of temperatures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..tools.checked import Array, Column, Count, Real, validated
from ..tools.notebook import ResultPlot
from .common import correlation_time, mean_with_error

MODES = 5
"""Slow waves, at most, that are looked for in what a law leaves."""
POINTS_PER_MODE = 4
FEWEST = 10
"""Least number of points that distinguish noise from waves."""
FEWEST_HAFF = 4
"""Least number of points for Haff's law."""
CHANCE = 1e-3
"""Probability below which waves are no chance."""
OUTRIGHT = 2.5
"""Times the scatter, above which waves are a misfit whatever the rest looks like. Those of T of n smooth disks that
cool by Haff's law had 0.4 (e_n = 0.8) to 0.65 (0.5) / sqrt(n) rms, 1.0 at most in 45 runs by Monte Carlo (2026-11-21).
"""
ROUNDING = 1e-6
"""Waves below this part of what is fitted are no misfit, even in exact numbers."""

Law = Callable[[Array], Array]


@dataclass(frozen=True)
class Goodness:
    """Goodness of a least-squares fit; errors of its parameters are nan if the law does not hold."""

    rms: float
    correlation_time: float
    """rms, correlation_time: root of the mean square of what is left, and its integrated autocorrelation time, in
    points."""
    misfit: float
    p_value: float
    """misfit, p_value: root of the mean square of its slow waves, and the probability of such waves by chance (`fit`);
    nan with too few points."""
    describes: bool
    """False where the waves are neither chance nor within the scatter that is allowed."""
    n_eff: float
    """Independent values as good as the points, less those that the other parameters take, 1 at least: a parameter's
    interval is Student's t with n_eff - 1 degrees of freedom, 1 at least."""


def fit(
    law: Law, data: Array, start: Array, along: Array, *, scatter: float
) -> tuple[Array, Array, Goodness]:
    """Fit a law by least squares, and test it against smooth deviations from it.

    The residuals of a law that holds are noise; those of one that does not hold are slow waves. Linear least squares
    split the residuals r into three parts:

    - what changed parameters explain;
    - what up to `MODES` Legendre polynomials of `along` explain beyond that: B z, with B orthonormal;
    - the rest, which a misfit does not reach. It gives the noise: variance s^2 and correlations rho^|lag|. rho is from
      the correlation of successive points, corrected for the modes (`_autoregression`), or from the integrated
      autocorrelation time if that is longer.

    If r is such noise, z has the covariance
    s^2 B' R B, R_ij = rho^|i - j|, and of n points n (1 - rho) / (1 + rho) are as good as independent, so that

        F = z' (s^2 B' R B)^-1 z / q

    is distributed about as F with q and n (1 - rho) / (1 + rho) - d degrees of freedom, 2 at least; q are the modes
    beyond the parameters, d the dimensions of all. The law does not describe the data where this has a probability
    below `CHANCE` and the root mean square of the waves, |z| / sqrt(n), is above the scatter that is allowed, or where
    it is above `OUTRIGHT` times that, if there is one. Its parameters are then those of the nearest curve of its kind:
    they have no statistical error, and `errors` are nan.

    Otherwise errors are those of least squares under such noise, (J'J)^-1 J' R J (J'J)^-1 s^2, with rho and s of r.

    `law` gives values where the data (n,) are from parameters (p,), of which `start` are the first; `along` (n,) is a
    rising coordinate in which misfits are smooth; `scatter` the root mean square of slow waves that noise has anyway,
    in the units of the data, 0 if that is not known. Returns parameters, their standard errors, and the goodness.
    """
    from scipy.optimize import least_squares

    found = least_squares(lambda p: law(p) - data, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12)
    left, n = found.fun, len(data)
    tau, whole = correlation_time(left), float(left @ left)
    own = _basis(found.jac)
    z = 2.0 * (along - along[0]) / (along[-1] - along[0]) - 1.0
    waves = np.polynomial.legendre.legvander(z, min(MODES, n // POINTS_PER_MODE))
    beyond = _basis(waves - own @ (own.T @ waves))
    coefficients = beyond.T @ left
    misfit = float(np.sqrt(coefficients @ coefficients / n))
    p_value = _p_value(left - own @ (own.T @ left), own, beyond)
    allowed = max(scatter, ROUNDING * float(np.sqrt(np.mean(data**2))))
    describes = not (
        (p_value < CHANCE and misfit > allowed) or (scatter > 0.0 and misfit > OUTRIGHT * allowed)
    )
    rho, kept = _autoregression(left - own @ (own.T @ left), own)
    covariance = covariance_of(found.jac, rho, whole / max(kept, 1e-300))
    errors = np.sqrt(np.diag(covariance)) if describes else np.full(len(start), np.nan)
    n_eff = max(_independent(n, rho) - len(start) + 1.0, 1.0)
    return found.x, errors, Goodness(float(np.sqrt(whole / n)), tau, misfit, p_value, describes, n_eff)


def _independent(n: int, rho: float) -> float:
    """Number of independent values that determine a smooth curve as well as n of the correlation rho^|lag|."""
    return n * (1.0 - rho) / (1.0 + rho)


def covariance_of(J: Array, rho: float, variance: float) -> Array:
    """Covariance (p, p) of parameters of least squares with derivatives J (n, p) and noise of correlation rho^|lag|.

    (J'J)^-1 J' R J (J'J)^-1 times the variance of the noise. Parameters in a combination that the data do not determine
    have an infinite one: a pseudo-inverse would leave out that very direction, and give an error of nearly 0.
    """
    size = np.linalg.norm(J, axis=0)
    moving = size > 0.0
    unit = 1.0 / np.where(moving, size, 1.0)
    _, singular, directions = np.linalg.svd(J * unit, full_matrices=False)
    flat = singular <= FLAT * singular[0]
    inverse = (directions.T / np.where(flat, 1.0, singular) ** 2) @ directions
    found = inverse @ ((J * unit).T @ correlated(J * unit, rho)) @ inverse * variance
    tied = ~moving | np.any(np.abs(directions[flat]) > FLAT, axis=0)
    found = found * np.outer(unit, unit)
    found[tied, tied] = np.inf
    return np.asarray(found)


FLAT = 1e-6
"""Singular value of the derivatives over the largest, below which a combination of parameters is not determined."""


def _basis(columns: Array) -> Array:
    """An orthonormal basis, shape (n, d), of the span of some columns, to rounding."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-10 * max(float(size.max()), 1e-300)]
    columns = columns / np.linalg.norm(columns, axis=0)
    basis, weight, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(basis[:, weight > 1e-8])


def _p_value(left: Array, own: Array, beyond: Array) -> float:
    """p-value of the residuals' components along `beyond` under noise alone; nan with too few points."""
    from scipy.stats import f as f_distribution

    n, modes = len(left), beyond.shape[1]
    all_modes = np.column_stack((own, beyond))
    coefficients = beyond.T @ left
    rest = left - beyond @ coefficients
    rho, kept = _autoregression(rest, all_modes)
    freedom = max(2.0, _independent(n, rho) - all_modes.shape[1])
    if modes == 0 or n < FEWEST:
        return float("nan")
    variance = max(float(rest @ rest) / kept, 1e-300)
    covariance = variance * beyond.T @ correlated(beyond, rho)
    F = float(coefficients @ np.linalg.solve(covariance, coefficients)) / modes
    return float(f_distribution.sf(F, modes, freedom))


def correlated(columns: Array, rho: float) -> Array:
    """Product of the correlation matrix R_ij = rho^|i - j| and columns."""
    from scipy.signal import lfilter

    later = lfilter([1.0], [1.0, -rho], columns, axis=0)
    earlier = lfilter([1.0], [1.0, -rho], columns[::-1], axis=0)[::-1]
    return np.asarray(later + earlier - columns)


def _autoregression(rest: Array, modes: Array) -> tuple[float, float]:
    """rho of noise with some modes removed, and the ratio of the residual sum of squares to its variance.

    With M = (1 - B B') R (1 - B B'), the square of the rest has the mean trace M, and its product with itself one point
    on the sum of M's off-diagonal entries: rho is where the two are in the ratio that is seen.
    """
    from scipy.optimize import brentq

    n = len(rest)

    def means(rho: float) -> tuple[float, float]:
        moved = correlated(modes, rho)
        inner = modes.T @ moved
        square = n - float(np.sum(modes * moved))
        off_diagonal = (n - 1) * rho - float(np.sum(modes[:-1] * moved[1:] + moved[:-1] * modes[1:]))
        return square, off_diagonal + float(np.sum((modes[:-1] @ inner) * modes[1:]))

    correlation = float(rest[:-1] @ rest[1:]) / max(float(rest @ rest), 1e-300)

    def excess(rho: float) -> float:
        square, off_diagonal = means(rho)
        return off_diagonal / square - correlation

    low, high = 0.0, 1.0 - 0.1 / n
    rho = low if excess(low) >= 0.0 else high
    if excess(low) < 0.0 < excess(high):
        rho = float(brentq(excess, low, high, xtol=1e-6))
    tau = correlation_time(rest)
    rho = max(rho, (tau - 0.5) / (tau + 0.5))
    return rho, means(rho)[0]


@dataclass(frozen=True)
class HaffFit(Goodness, ResultPlot):
    """T(t) = T0 / (1 + (t - t_first) / t_H)^2: P. K. Haff, J. Fluid Mech. 134, 401 (1983).

    Attributes
    ----------
    T0, T0_error, t_H, t_H_error : float
        Temperature at the first time of the fit [energy], and Haff's time [time], counted from there.
    times : tuple of two floats
        First and last time of the fit.
    rms, correlation_time, misfit, p_value, describes, n_eff
        Of what is left of ln T, as in `Goodness`.
    """

    T0: float
    T0_error: float
    t_H: float
    t_H_error: float
    times: tuple[float, float]


@dataclass(frozen=True)
class RatioFit(Goodness, ResultPlot):
    """theta(x) = theta_end + (theta_0 - theta_end) exp(-(x - x_first) / lag), x a time or collisions per disk.

    Attributes
    ----------
    theta_0, theta_end, lag, and theta_0_error, theta_end_error, lag_error : float
        Ratio T_rot / T at the begin, the one that it tends to, after which x 1/e of the way is left; and their errors.
        The lag is nan where the data do not show it (`ratio_fit`), and so is theta_end, unless they show no change:
        then it is their mean.
    rms, correlation_time, misfit, p_value, describes, n_eff
        Of what is left of theta, as in `Goodness`.
    """

    theta_0: float
    theta_0_error: float
    theta_end: float
    theta_end_error: float
    lag: float
    lag_error: float


@validated
def haff_fit(
    time: Column,
    temperature: Column,
    *,
    first: Real | None = None,
    last: Real | None = None,
    disks: Count | None = None,
) -> HaffFit:
    """Fit Haff's law to ln T by least squares, between two times, and test whether it holds (`fit`).

    InputError for fewer than 4 points, temperatures that are not positive, or a gas that does not cool.

    Parameters
    ----------
    time, temperature : array (s,)
        Times [time], rising, and temperatures [energy], above 0.
    first, last : float, optional
        Where the fit begins and ends; without them, everywhere.
    disks : int, optional
        How many there are: ln T of n disks scatters slowly by 1 / sqrt(n) about any law (the energy of n independent
        Gaussian velocities in two dimensions has the relative variance 1 / n), which is no misfit. Without it, no
        scatter is allowed for.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> time = np.linspace(0.0, 20.0, 200)
    >>> found = analysis.haff_fit(time, 3.0 * (1.0 + time / 2.0) ** -2 * (1.0 + 0.01 * rng.normal(size=200)))
    >>> bool(abs(found.t_H - 2.0) < 0.05), bool(abs(found.T0 - 3.0) < 0.05)
    (True, True)
    """
    t, T = _window(first, last, FEWEST_HAFF, time=time, temperature=temperature)
    if np.any(T <= 0.0):
        raise InputError("temperature: must be above 0 for Haff's law")
    x = t - t[0]
    # 1 / sqrt(T) is a straight line of it: a start for the fit.
    slope, begin = np.polyfit(x, T**-0.5, 1)
    if slope <= 0.0:
        raise InputError("Haff's law: this gas does not cool")
    begin = max(float(begin), 0.1 * float(T[0] ** -0.5))
    start = np.array([-2.0 * np.log(begin), np.log(begin / slope)])

    def law(p: Array) -> Array:
        return p[0] - 2.0 * np.log1p(x / np.exp(p[1]))

    scatter = 0.0 if disks is None else disks**-0.5
    values, errors, goodness = fit(law, np.log(T), start, np.log1p(x / np.exp(start[1])), scatter=scatter)
    (T0, t_H), (T0_error, t_H_error) = np.exp(values).tolist(), (np.exp(values) * errors).tolist()
    return HaffFit(**vars(goodness), T0=T0, T0_error=T0_error, t_H=t_H, t_H_error=t_H_error,
                   times=(float(t[0]), float(t[-1])))  # fmt: skip


@validated
def ratio_fit(
    x: Column,
    theta: Column,
    *,
    first: Real | None = None,
    last: Real | None = None,
    disks: Count | None = None,
) -> RatioFit:
    """Fit an exponential approach to the ratio of temperatures, and test whether it holds (`fit`).

    Data show an end only if they contain most of the approach to it. theta_end and the lag are given where the standard
    error of ln lag is below `DETERMINED`, the lag is shorter than the data, and three lags are longer than the first
    step. Otherwise the lag is nan; theta_end is the mean (`mean_with_error`) if a straight line through the data
    changes by less than 2 standard errors, else nan; theta_0 is where that line begins.

    InputError for fewer than 6 points, or a ratio that does not change.

    Parameters
    ----------
    x, theta : array (s,)
        Collisions per disk, in which a cooling gas has one lag, or times, rising; and T_rot / T.
    first, last : float, optional
        Where the fit begins and ends; without them, everywhere.
    disks : int, optional
        As for `haff_fit`: theta of n disks scatters by theta sqrt(3 / n), 1 / n of ln T and 2 / n of ln T_rot.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> tau = np.linspace(0.0, 20.0, 200)
    >>> found = analysis.ratio_fit(tau, 0.6 - 0.6 * np.exp(-tau / 3.0) + 0.002 * rng.normal(size=200))
    >>> round(found.theta_end, 2), round(found.lag, 1)
    (0.6, 3.0)
    """
    at, ratio = _window(first, last, 6, x=x, theta=theta)
    if np.ptp(ratio) == 0.0:
        raise InputError("the ratio of temperatures does not change: there is nothing to fit")
    along = at - at[0]
    end = float(np.mean(ratio[-max(1, len(ratio) // 5) :]))
    below = np.abs(ratio - end) < abs(ratio[0] - end) / np.e
    lag = float(along[np.argmax(below)]) if np.any(below[1:]) else 0.3 * float(along[-1])
    start = np.array([ratio[0], end, np.log(max(lag, 0.2 * float(along[1])))])

    def law(p: Array) -> Array:
        return p[1] + (p[0] - p[1]) * np.exp(-along / np.exp(np.clip(p[2], -50.0, 50.0)))

    scatter = 0.0 if disks is None else float(np.mean(np.abs(ratio))) * (3.0 / disks) ** 0.5
    values, errors, goodness = fit(law, ratio, start, np.log1p(along / np.exp(start[2])), scatter=scatter)
    begin, end, lag = float(values[0]), float(values[1]), float(np.exp(np.clip(values[2], -50.0, 50.0)))
    begin_error, end_error, of_lag = errors.tolist()
    lag_error = lag * of_lag
    if goodness.describes and not (of_lag < DETERMINED and lag < along[-1] and 3.0 * lag > along[1]):
        ends, covariance = straight_line(along, ratio)
        begin, begin_error = float(ends[0]), float(covariance[0, 0] ** 0.5)
        change = float(covariance[0, 0] - 2.0 * covariance[0, 1] + covariance[1, 1]) ** 0.5
        lag = lag_error = end = end_error = float("nan")
        if abs(ends[1] - ends[0]) < 2.0 * change:
            end, end_error, n_eff = mean_with_error(ratio)
            goodness = replace(goodness, n_eff=n_eff)
    return RatioFit(**vars(goodness), theta_0=begin, theta_0_error=begin_error, theta_end=end,
                    theta_end_error=end_error, lag=lag, lag_error=lag_error)  # fmt: skip


DETERMINED = 0.5
"""Largest standard error of the logarithm of a lag that is determined."""


def noise_about_parabola(y: Array) -> tuple[float, float, float]:
    """rho, variance, and number of independent values as good as these, of the noise of y (n,) about a parabola."""
    own = _basis(np.asarray(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(y)), 2), dtype=float))
    left = y - own @ (own.T @ y)
    rho, kept = _autoregression(left, own)
    return rho, float(left @ left) / max(kept, 1e-300), _independent(len(y), rho)


def straight_line(x: Array, y: Array) -> tuple[Array, Array]:
    """Values (2,) at both ends of the straight line of least squares through y (n,), and their covariance (2, 2).

    The noise has the correlation rho^|lag|.
    """
    part = (x - x[0]) / (x[-1] - x[0])
    J: Array = np.stack((1.0 - part, part), axis=1)
    own = _basis(J)
    left = y - own @ (own.T @ y)
    rho, kept = _autoregression(left, own)
    values = np.linalg.lstsq(J, y, rcond=None)[0]
    return np.asarray(values), covariance_of(J, rho, float(left @ left) / max(kept, 1e-300))


def _window(first: float | None, last: float | None, least: int, **columns: ArrayLike) -> tuple[Array, Array]:
    """Check two named columns and select the rows between two ends; the first must increase."""
    (x, y), (at, value) = columns, (np.asarray(column, dtype=float) for column in columns.values())
    if at.shape != value.shape:
        raise InputError(f"{x} has shape {at.shape}, {y} {value.shape}: must be the same")
    begin, end = -np.inf if first is None else first, np.inf if last is None else last
    used = (at >= begin) & (at <= end)
    if np.count_nonzero(used) < least:
        ends = ", ".join(
            f"{name} = {one:g}" for name, one in (("first", first), ("last", last)) if one is not None
        )
        where = f" with {ends}" if ends else ""
        raise InputError(f"{x} has {np.count_nonzero(used)} points{where}: must be {least} or more for a fit")
    if np.any(np.diff(at[used]) <= 0.0):
        raise InputError(f"{x}: must be in rising order")
    return at[used], value[used]
