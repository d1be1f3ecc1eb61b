"""Fits to a cooling gas: Haff's law, and how the ratio of temperatures comes to its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .frames import correlation_time


@dataclass(frozen=True)
class HaffFit:
    """T(t) = T0 / (1 + (t - t_first) / t_H)^2: P. K. Haff, J. Fluid Mech. 134, 401 (1983).

    Attributes
    ----------
    T0, T0_error : float
        Temperature at the first time of the fit [energy].
    t_H, t_H_error : float
        Haff's time [time], counted from there.
    rms : float
        Root of the mean square of what is left of ln T: how well the law holds.
    correlation_time : float
        Integrated autocorrelation time of what is left, in points; errors are sqrt(2 of it) times those of independent
        points. A law that does not hold leaves waves, a long correlation time, and larger errors.
    times : tuple of two floats
        First and last time of the fit.
    """

    T0: float
    T0_error: float
    t_H: float
    t_H_error: float
    rms: float
    correlation_time: float
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
    rms, correlation_time : float
        Of what is left of theta, as in `HaffFit`.
    """

    theta_0: float
    theta_0_error: float
    theta_end: float
    theta_end_error: float
    lag: float
    lag_error: float
    rms: float
    correlation_time: float


def haff_fit(
    time: ArrayLike, temperature: ArrayLike, *, first: float | None = None, last: float | None = None
) -> HaffFit:
    """Fit Haff's law to ln T by least squares, between two times.

    Parameters
    ----------
    time, temperature : array (s,)
        Times [time], rising, and temperatures [energy], above 0.
    first, last : float, optional
        Where the fit begins and ends; without them, everywhere.

    Raises
    ------
    InputError
        For fewer than 4 points, temperatures that are not positive, or a gas that does not cool.
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

    p, error, rms, tau = _fit(law, np.log(T), start)
    T0, t_H = np.exp(p)
    return HaffFit(
        float(T0),
        float(T0 * error[0]),
        float(t_H),
        float(t_H * error[1]),
        rms,
        tau,
        (float(t[0]), float(t[-1])),
    )


def ratio_fit(
    x: ArrayLike, theta: ArrayLike, *, first: float | None = None, last: float | None = None
) -> RatioFit:
    """Fit an exponential approach to the ratio of temperatures.

    Parameters
    ----------
    x : array (s,)
        Collisions per disk, in which a cooling gas has one lag, or times; rising.
    theta : array (s,)
        T_rot / T.
    first, last : float, optional
        Where the fit begins and ends; without them, everywhere.

    Raises
    ------
    InputError
        For fewer than 6 points, or a ratio that does not change.
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

    p, error, rms, tau = _fit(law, ratio, start)
    found = float(np.exp(p[2]))
    return RatioFit(
        float(p[0]), error[0], float(p[1]), error[1], found, found * error[2], rms=rms, correlation_time=tau
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


def _fit(
    law: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    data: NDArray[np.float64],
    start: NDArray[np.float64],
) -> tuple[NDArray[np.float64], list[float], float, float]:
    """Least squares: parameters, errors with the correlation of what is left, its rms and correlation time."""
    from scipy.optimize import least_squares

    found = least_squares(lambda p: law(p) - data, start, x_scale="jac", xtol=1e-12, ftol=1e-12)
    left = found.fun
    freedom = max(len(data) - len(start), 1)
    tau = correlation_time(left)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * (left @ left) / freedom * 2.0 * tau
    return (
        found.x,
        [float(one) for one in np.sqrt(np.diag(covariance))],
        float(np.sqrt(np.mean(left**2))),
        tau,
    )
