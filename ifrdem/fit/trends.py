"""Trends of coefficients with speed and spin, and signs of two materials, in the residuals of a fit.

Of each impact alone, with the other coefficients as fitted, a coefficient is its fitted value less (J . r) / (J . J),
with the residuals r and their derivatives J. A trend is a further coefficient b, theta_k + b (u - mean u): one
Gauss-Newton step fits it together with all others. Its variance comes from the scatter of the impacts (H. White,
Econometrica 48, 817 (1980)). This is also right if errors are wrong, or are estimated from the residuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from .laws import Law
from .likelihood import Array, Points, covariance_of
from .model import CollisionProblem

LEAST = 8
"""Least number of impacts for a trend, in addition to the number of coefficients."""

_CLUSTERS = 12.0  # gain in ln L of two values of e_n over one, whose scatter is free: BIC for two parameters needs ln n
_SHARE = 0.1  # of the impacts, in the smaller cluster
_APART = 3.0  # distance of both, over their median error


@dataclass(frozen=True)
class Trend:
    """Change of a coefficient between the 5th and the 95th percentile of a speed."""

    coefficient: str
    against: str  # "g_n", or "rim speed": |R_1 w_1 + R_2 w_2| before the impact
    low: float
    high: float  # low, high: these percentiles [length/time]
    change: float
    error: float  # standard error of the change
    pivot: float  # speed at which the coefficient has its fitted value [length/time]
    probability: float  # p-value: of so large a change without a trend


@dataclass(frozen=True, eq=False)
class Trends:
    """Coefficients of single impacts, and their trends."""

    names: tuple[str, ...]
    value: Array  # (n, p): each coefficient of each impact alone
    error: Array  # (n, p): its standard error; infinite where the impact does not depend on it
    speed: Array  # (n,): g_n [length/time]
    rim: Array  # (n,): |R_1 w_1 + R_2 w_2| [length/time]
    each: tuple[Trend, ...]
    clusters: tuple[tuple[float, int], ...] | None = None  # values of e_n, and their impacts


def trends_of(points: Points, problem: CollisionProblem, law: Law, values: Array) -> Trends | None:
    """Trends of the coefficients with g_n, and of e_t with the rim speed; None for too few impacts."""
    n, _, p = points.jacobian.shape
    if n < p + LEAST:
        return None
    J, r, w = points.jacobian, points.residual, points.weight
    size = np.einsum("nqp,nqp->np", J, J)
    known = size > 1e-12 * np.max(size, axis=0)
    step = -np.einsum("nqp,nq->np", J, r) / np.where(known, size, 1.0)
    error = np.where(known, 1.0 / np.sqrt(np.where(known, size, 1.0)), np.inf)
    alone = np.where(known, values + step, np.nan)
    speed = points.x[:, 2] * np.cos(points.x[:, 0])
    motion = problem.motion(points.x, problem.rows)
    rim = np.abs(motion[3] * motion[7] + motion[9] * motion[13])
    found = []
    for k, name in enumerate(law.free):
        for against, u in (("g_n", np.log(np.maximum(speed, 1e-300))), ("rim speed", rim)):
            if against == "rim speed" and name != "e_t":
                continue
            if (one := _trend(J, r, w, k, u)) is None:
                continue
            ends = np.quantile(u, [0.05, 0.95])
            slope, sigma, pivot = one
            change, sigma = slope * float(ends[1] - ends[0]), sigma * float(ends[1] - ends[0])
            low, high, middle = np.exp([*ends, pivot]) if against == "g_n" else [*ends, pivot]
            chance = float(fdtrc(1, n - p - 1, (change / sigma) ** 2))
            found.append(Trend(name, against, float(low), float(high), change, sigma, float(middle), chance))
    first = law.free[0]
    clusters = _clusters(alone[:, 0], error[:, 0], w) if first == "e_n" else None
    return Trends(law.free, alone, error, speed, rim, tuple(found), clusters)


def _trend(J: Array, r: Array, w: Array, k: int, u: Array) -> tuple[float, float, float] | None:
    """Slope of a coefficient with u (n,), its standard error, and mean u; None if the data do not determine it."""
    weight = w * np.sum(J[:, :, k] ** 2, axis=1)
    if not np.sum(weight) > 0.0:
        return None
    mean = float(np.sum(weight * u) / np.sum(weight))
    u = u - mean
    E = np.concatenate([J, (J[:, :, k] * u[:, None])[..., None]], axis=-1)
    inverse = covariance_of(np.einsum("n,nqa,nqb->ab", w, E, E))
    if not np.isfinite(inverse).all():
        return None
    scores = w[:, None] * np.einsum("nqa,nq->na", E, r)
    n, m = scores.shape
    covariance = inverse @ (scores.T @ scores) @ inverse * (n / (n - m))
    slope = -(inverse @ scores.sum(axis=0))[-1]
    return float(slope), math.sqrt(max(float(covariance[-1, -1]), 1e-300)), mean


def _clusters(value: Array, error: Array, weight: Array) -> tuple[tuple[float, int], ...] | None:
    """Two or three values of a coefficient with the numbers of impacts, if they are far more likely than one.

    The scatter about them is that of the errors times a factor, free in all cases; outliers of a robust fit are left
    out.
    """
    good = np.isfinite(value) & np.isfinite(error) & (weight > 0.3)
    x, s = value[good], error[good]
    if len(x) < 2 * LEAST:
        return None
    found, gained = None, 0.0
    (_, _, _, one) = _mixture(x, s, np.median(x, keepdims=True))
    for starts in (((0.2, 0.8),), ((0.1, 0.5, 0.9), (0.1, 0.25, 0.75), (0.25, 0.75, 0.9))):
        mixtures = [_mixture(x, s, np.quantile(x, each)) for each in starts]
        centres, scale, belongs, total = max(mixtures, key=lambda each: each[-1])
        apart = float(np.min(np.diff(np.sort(centres)))) > _APART * scale * float(np.median(s))
        further = len(centres) - (1 if found is None else len(found))
        if (
            apart
            and total - one - gained >= further * _CLUSTERS
            and np.min(np.mean(belongs, axis=1)) > _SHARE
        ):
            gained = total - one
            numbers = np.bincount(np.argmax(belongs, axis=0), minlength=len(centres))
            found = tuple((float(centres[i]), int(numbers[i])) for i in np.argsort(centres))
    return found


def _mixture(x: Array, s: Array, centres: Array) -> tuple[Array, float, Array, float]:
    """Values (k,), the factor of the errors s (n,), parts of each value in x, (k, n), and ln L, by EM from centres."""
    n = len(x)
    factor = math.sqrt(float(np.mean(((x - np.median(x)) / s) ** 2)))
    part, scale, last = np.full(len(centres), 1.0 / len(centres)), factor / len(centres), -math.inf
    for _ in range(200):
        squares = ((x - centres[:, None]) / s) ** 2
        each = np.log(part)[:, None] - math.log(scale) - 0.5 * squares / scale**2
        total = np.logaddexp.reduce(each, axis=0)
        belongs = np.exp(each - total)
        if (now := float(np.sum(total))) - last < 1e-9:
            break
        last = now
        centres = np.sum(belongs * x / s**2, axis=1) / np.maximum(np.sum(belongs / s**2, axis=1), 1e-300)
        squares = ((x - centres[:, None]) / s) ** 2
        scale = max(math.sqrt(float(np.sum(belongs * squares)) / n), 1e-3 * factor)
        part = np.clip(np.mean(belongs, axis=1), 1e-3, 1.0)
    return centres, scale, belongs, now
