"""Fits to a cooling gas: Haff's law, and how the ratio of temperatures comes to its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .goodness import fit


@dataclass(frozen=True)
class HaffFit:
    """T(t) = T0 / (1 + (t - t_first) / t_H)^2: P. K. Haff, J. Fluid Mech. 134, 401 (1983).

    Attributes
    ----------
    T0, T0_error : float
        Temperature at the first time of the fit [energy].
    t_H, t_H_error : float
        Haff's time [time], counted from there. Errors are nan where the law does not describe the gas.
    rms : float
        Root of the mean square of what is left of ln T.
    correlation_time : float
        Integrated autocorrelation time of what is left, in points; errors are sqrt(2 of it) times those of independent
        points.
    misfit : float
        Root of the mean square of the slow waves in what is left of ln T: by so much the gas leaves the law.
    p_value : float
        Probability of such waves by chance (`goodness.fit`); nan where too few points are left to tell.
    describes : bool
        Whether the law describes the gas: False where the waves are neither chance nor within the scatter of T.
    times : tuple of two floats
        First and last time of the fit.
    """

    T0: float
    T0_error: float
    t_H: float
    t_H_error: float
    rms: float
    correlation_time: float
    misfit: float
    p_value: float
    describes: bool
    times: tuple[float, float]


@dataclass(frozen=True)
class RatioFit:
    """theta(x) = theta_end + (theta_0 - theta_end) exp(-(x - x_first) / lag), x a time or collisions per disk.

    Attributes
    ----------
    theta_0, theta_0_error : float
        Ratio T_rot / T at the begin.
    theta_end, theta_end_error : float
        Ratio that it tends to.
    lag, lag_error : float
        After which 1/e of the way is left, as x.
    rms, correlation_time, misfit, p_value : float
    describes : bool
        Of what is left of theta, as in `HaffFit`. Errors are nan where the exponential does not describe it.
    """

    theta_0: float
    theta_0_error: float
    theta_end: float
    theta_end_error: float
    lag: float
    lag_error: float
    rms: float
    correlation_time: float
    misfit: float
    p_value: float
    describes: bool


def haff_fit(
    time: ArrayLike,
    temperature: ArrayLike,
    *,
    first: float | None = None,
    last: float | None = None,
    disks: int | None = None,
) -> HaffFit:
    """Fit Haff's law to ln T by least squares, between two times, and test whether it holds (`goodness.fit`).

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

    Raises
    ------
    InputError
        For fewer than 4 points, temperatures that are not positive, or a gas that does not cool.

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
    t, T = _window(time, temperature, first, last, 4, "Haff's law")
    if np.any(T <= 0.0):
        raise InputError("Haff's law: temperatures must be above 0")
    x = t - t[0]
    # 1 / sqrt(T) is a straight line of it: a start for the fit.
    slope, begin = np.polyfit(x, T**-0.5, 1)
    if slope <= 0.0:
        raise InputError("Haff's law: this gas does not cool")
    begin = max(float(begin), 0.1 * float(T[0] ** -0.5))
    start = np.array([-2.0 * np.log(begin), np.log(begin / slope)])

    def law(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return p[0] - 2.0 * np.log1p(x / np.exp(p[1]))

    scatter = 0.0 if disks is None else disks**-0.5
    found = fit(law, np.log(T), start, np.log1p(x / np.exp(start[1])), scatter=scatter)
    T0, t_H = (float(one) for one in np.exp(found.values))
    error = [float(one) for one in found.errors]
    return HaffFit(
        T0,
        T0 * error[0],
        t_H,
        t_H * error[1],
        found.rms,
        found.correlation_time,
        found.misfit,
        found.p_value,
        found.describes,
        (float(t[0]), float(t[-1])),
    )


def ratio_fit(
    x: ArrayLike,
    theta: ArrayLike,
    *,
    first: float | None = None,
    last: float | None = None,
    disks: int | None = None,
) -> RatioFit:
    """Fit an exponential approach to the ratio of temperatures, and test whether it holds (`goodness.fit`).

    Parameters
    ----------
    x : array (s,)
        Collisions per disk, in which a cooling gas has one lag, or times; rising.
    theta : array (s,)
        T_rot / T.
    first, last : float, optional
        Where the fit begins and ends; without them, everywhere.
    disks : int, optional
        As for `haff_fit`: theta of n disks scatters by theta sqrt(3 / n), 1 / n of ln T and 2 / n of ln T_rot.

    Raises
    ------
    InputError
        For fewer than 6 points, or a ratio that does not change.

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
    at, ratio = _window(x, theta, first, last, 6, "the ratio of temperatures")
    if np.ptp(ratio) == 0.0:
        raise InputError("the ratio of temperatures does not change: there is nothing to fit")
    along = at - at[0]
    end = float(np.mean(ratio[-max(1, len(ratio) // 5) :]))
    below = np.abs(ratio - end) < abs(ratio[0] - end) / np.e
    lag = float(along[np.argmax(below)]) if np.any(below[1:]) else 0.3 * float(along[-1])
    start = np.array([ratio[0], end, np.log(max(lag, 0.2 * float(along[1])))])

    def law(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return p[1] + (p[0] - p[1]) * np.exp(-along / np.exp(np.clip(p[2], -50.0, 50.0)))

    scatter = 0.0 if disks is None else float(np.mean(np.abs(ratio))) * (3.0 / disks) ** 0.5
    found = fit(law, ratio, start, np.log1p(along / np.exp(start[2])), scatter=scatter)
    begin, end, lag = float(found.values[0]), float(found.values[1]), float(np.exp(found.values[2]))
    error = [float(one) for one in found.errors]
    return RatioFit(
        begin,
        error[0],
        end,
        error[1],
        lag,
        lag * error[2],
        found.rms,
        found.correlation_time,
        found.misfit,
        found.p_value,
        found.describes,
    )


def _window(
    x: ArrayLike, y: ArrayLike, first: float | None, last: float | None, least: int, what: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    at, value = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if at.shape != value.shape or at.ndim != 1:
        raise InputError(f"{what}: shapes {at.shape} and {value.shape} do not match")
    used = (at >= (-np.inf if first is None else first)) & (at <= (np.inf if last is None else last))
    used &= np.isfinite(value)
    if np.count_nonzero(used) < least:
        raise InputError(
            f"{what}: {np.count_nonzero(used)} points between the ends are too few, {least} are needed"
        )
    if np.any(np.diff(at[used]) <= 0.0):
        raise InputError(f"{what}: points must be in rising order")
    return at[used], value[used]
