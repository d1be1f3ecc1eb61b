"""The likelihood of measured impacts: distances of points from what a law can give, with errors in everything.

Every measured value is Gaussian about the law's prediction h at the true motion x before the impact, and so is what was
measured before. The true motions are nuisance parameters, over which the likelihood is maximised: up to a constant

    -2 ln L = chi2 = sum_i c_i,   c_i = min over x of |W_i (y_i - h(x))|^2,

with W_i^T W_i the inverse of the covariance of impact i (total least squares). For a straight line that is
the effective variance s_y^2 + f'^2 s_x^2. It also holds where the curve bends within an error, and, unlike a
variance with a slope that jumps, it is continuous in the coefficients where a point changes from sticking to
sliding. For errors that are small on the scale of the curve, c_i follows a chi-square distribution with m_i
degrees of freedom, the values measured less the coordinates of x.

Robust: the errors of an impact are a scale mixture, c_i / (an inverse gamma variable), which makes them
Student-t with nu degrees of freedom; integrated over x at each scale,

    -2 ln L = sum_i (nu + m_i) ln(1 + c_i / nu),

so that x is where it was, and an impact far out weighs (nu + m_i) / (nu + c_i).

Where errors are estimated from the residuals, a maximum over x is no likelihood of them: every impact takes as many
values as x has coordinates (J. Neyman and E. L. Scott, Econometrica 16, 1 (1948), doi:10.2307/1914288). It is then
integrated over x, by Laplace's method, which is exact where h is linear over an error,

    -2 ln L = sum_i (c_i + sum_j ln(2 pi s_ij^2) + ln det A_i^T A_i - d ln 2 pi),   A_i = W_i dh/dx.

Its derivative by ln s_g^2 is 0 where the squared residuals of the group g add up to its redundancy. x has the same
coordinates for all laws, so that differences between laws depend neither on units nor on the choice of coordinates
that are linear in one another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .laws import Law
from .model import FitProblem, latent_slope

Array = NDArray[np.float64]

NU = 4.0
"""Degrees of freedom of a robust fit: tails as heavy as tables of measurements have (Lange et al., JASA 84, 881, 1989)."""

_STEP = 1e-6  # of a one-sided difference by a coefficient, over its size: error 1e-6, round-off 1e-10
_MOST_STEPS = 40
_CLOSE = 1e-10  # gain of a step below which the search ends: a step of 1e-5 standard errors
_ROUNDING = 1e-13  # the same over the distance
_SHORTEST = 1e-4  # length of a step, over that of Gauss-Newton
_LARGEST_GAIN = 10.0  # decrease that is still possible at most, over the gain of the next step
_LN_2_PI = float(np.log(2.0 * np.pi))
_SINGULAR = (
    1e-12  # of the largest eigenvalue, in units of single coefficients: below it there is no information
)
_NOTHING_LEFT = 1e-8  # of a derivative by a coefficient, where the true motion follows
_RIDGE = 1e-12  # fixes a direction that no measured value determines


@dataclass(frozen=True)
class Points:
    """The nearest points of one set of coefficients."""

    x: Array  # (n, d): latent coordinates that fit best
    residual: Array  # (n, q): W (y - h), normal with unit variance; 0 where a value is missing
    slope: Array  # (n, q, d): its derivative by x, in the directions that x is free to follow
    jacobian: Array  # (n, q, p): its derivative by the free coefficients, x following
    robust: float | None  # nu of a Student-t likelihood
    redundancy: Array  # (n,)
    tangents: Array  # (n, q, d): `slope` with chi free at edges between regimes too, on the side of the point
    scale: Array  # (d,): units of the latent coordinates, the same for all laws

    @property
    def log_volumes(self) -> Array:
        """ln det A^T A - d ln 2 pi of each impact, (n,), A the whitened slope by latent coordinates over their `scale`.

        Without directions that no measured value determines; d is the number of the others. exp(-half of it) is the
        volume of true motions that agree with what was measured.
        """
        singular = np.linalg.svd(self.tangents * self.scale, compute_uv=False)
        determined = singular > 1e-9 * singular[:, :1]
        return np.asarray(
            np.sum(
                np.where(determined, 2.0 * np.log(np.where(determined, singular, 1.0)) - _LN_2_PI, 0.0),
                axis=1,
            )
        )

    @property
    def distance(self) -> Array:
        """c_i, (n,): squared distance of each impact, in units of its errors."""
        return np.asarray(np.sum(self.residual**2, axis=-1))

    @property
    def losses(self) -> Array:
        """-2 ln L of each impact, (n,), without its constant."""
        return _losses(self.distance, self.robust, self.redundancy)

    @property
    def loss(self) -> float:
        """-2 ln L without its constant; chi2 if it is Gaussian."""
        return float(np.sum(self.losses))

    @property
    def weight(self) -> Array:
        """Weight of each impact, (n,); 1 if Gaussian."""
        c = self.distance
        return np.ones(len(c)) if self.robust is None else (self.robust + self.redundancy) / (self.robust + c)

    def as_least_squares(self) -> tuple[Array, Array]:
        """Residuals (n q,) whose squares add up to `loss`, and their Jacobian (n q, p)."""
        r, J = self.residual, self.jacobian
        if self.robust is not None:
            # r~ = s(c) r with s = sqrt(rho(c) / c), and dr~ = s dr + 2 s' r (r . dr)
            c = np.maximum(self.distance, 1e-9)
            rho = (self.robust + self.redundancy) * np.log1p(c / self.robust)
            s = np.sqrt(rho / c)
            by_c = (self.weight / c - rho / c**2) / (2.0 * s)
            along = np.einsum("nq,nqp->np", r, J)
            J = s[:, None, None] * J + 2.0 * by_c[:, None, None] * r[..., None] * along[:, None, :]
            r = s[:, None] * r
        return r.ravel(), J.reshape(-1, J.shape[-1])

    @property
    def information(self) -> Array:
        """Half of the second derivatives (p, p) of the loss, in the Gauss-Newton approximation."""
        return np.asarray(np.einsum("n,nqa,nqb->ab", self.weight, self.jacobian, self.jacobian))

    @property
    def scatter(self) -> Array | None:
        """Covariance (p, p) of half the gradient of the loss, from its scatter over the impacts.

        None for a Gaussian likelihood, where it is `information`; a Student-t one only replaces errors of unknown
        distribution. The covariance of the coefficients is then H^-1 V H^-1, with V this scatter (P. J. Huber, Proc.
        Fifth Berkeley Symp. 1, 221 (1967)).
        """
        if self.robust is None:
            return None
        each = self.weight[:, None] * np.einsum("nqp,nq->np", self.jacobian, self.residual)
        return each.T @ each * (len(each) / max(len(each) - each.shape[1], 1))

    @property
    def curvature(self) -> Array:
        """Half of the second derivatives (p, p) of the loss, with those of the Student-t weights."""
        if self.robust is None:
            return self.information
        along = np.einsum("nqp,nq->np", self.jacobian, self.residual)
        by = 2.0 * self.weight / (self.robust + self.distance)
        return self.information - np.einsum("n,na,nb->ab", by, along, along)

    @property
    def bread(self) -> Array:
        """H (p, p) of the covariance H^-1 V H^-1: `curvature`, or `information` where that is no minimum's.

        It is a minimum's if it is flat along a combination of coefficients.
        """
        information, curvature = self.information, self.curvature
        unit = unit_of(information)
        values = np.linalg.eigvalsh(curvature * np.outer(unit, unit))
        return information if values[0] < -_SINGULAR * values[-1] else curvature

    @property
    def known(self) -> Array:
        """Information (p, p) of the impacts on the coefficients, the inverse of their covariance: H V^-1 H."""
        if (scatter := self.scatter) is None:
            return self.information
        return np.asarray(self.bread @ inverse_of(scatter) @ self.bread)

    @property
    def optimism(self) -> float:
        """By how much -2 ln L of other impacts exceeds that of these, as expected: 2 tr(V H^-1), 2 p if Gaussian.

        It is the penalty of a likelihood that is not that of the errors (E. Ronchetti, Stat. Probab. Lett. 3, 21
        (1985), doi:10.1016/0167-7152(85)90006-9).
        """
        if (scatter := self.scatter) is None:
            return 2.0 * self.jacobian.shape[-1]
        return 2.0 * float(np.trace(scatter @ inverse_of(self.bread)))


class Likelihood:
    """-2 ln L of a problem under a law, as a function of its free coefficients, the p last axis of arrays.

    `robust` is nu of a Student-t likelihood; it is Gaussian without.
    """

    def __init__(self, problem: FitProblem, law: Law, robust: float | None = None) -> None:
        self.problem: FitProblem = problem
        self.law: Law = law
        self.robust: float | None = robust
        problem.set_redundancy(law, law.start_points(2)[1])

    def at(self, values: Array) -> Points:
        """Nearest points and derivatives for free coefficients (p,)."""
        problem, law, p = self.problem, self.law, len(values)
        edges = problem.edges(law, values)
        x, at_edge = self._nearest(values, edges)
        chi = x[:, 0]
        gap = chi[:, None] - edges
        side = np.where(
            np.take_along_axis(gap, np.argmin(np.abs(gap), axis=1)[:, None], axis=1)[:, 0] >= 0.0, 1.0, -1.0
        )
        rows, y = problem.rows, np.nan_to_num(problem.y)
        f, slope = latent_slope(problem, law, values, x, rows, side)
        tangents = problem.white @ slope
        slope = tangents.copy()
        slope[at_edge >= 0, :, 0] = 0.0
        # At an edge between regimes chi moves with the edge; elsewhere it is free to follow.
        steps = _STEP * law.sizes
        changed = values + np.diag(steps)
        moved = np.tile(x, (p, 1, 1))
        shift = problem.edges(law, changed) - edges
        which = np.broadcast_to(np.maximum(at_edge, 0)[:, None], (p, len(x), 1))
        moved[..., 0] += np.where(at_edge >= 0, np.take_along_axis(shift, which, axis=-1)[..., 0], 0.0)
        by_value = np.moveaxis(problem.predict(law, changed, moved, rows) - f, 0, -1) / steps
        by_value = problem.white @ by_value
        along = _solve(slope, by_value)
        residual = np.einsum("nab,nb->na", problem.white, y - np.where(np.isnan(problem.y), 0.0, f))
        jacobian, scale = slope @ along - by_value, problem.step * 1e6
        # Of a coefficient that the true motion makes up for entirely, rounding is left.
        left, all_of_it = (np.sum(each**2, axis=(0, 1)) for each in (jacobian, by_value))
        jacobian[:, :, left < _NOTHING_LEFT**2 * all_of_it] = 0.0
        return Points(x, residual, slope, jacobian, self.robust, problem.redundancy, tangents, scale)

    def rough(self, values: Array) -> float:
        """The loss with each distance after one step from the motion as it was measured: to choose starts by."""
        problem = self.problem
        x = problem.start
        residual, slope = self._residual(values, problem.rows, x, np.ones(len(x)))
        left = residual - (slope @ _solve(slope, residual[..., None]))[..., 0]
        return float(np.sum(_losses(np.sum(left**2, axis=-1), self.robust, problem.redundancy)))

    def _residual(self, values: Array, rows: NDArray[np.int64], x: Array, side: Array) -> tuple[Array, Array]:
        """Residuals (m, q) at x (m, d), and the slope (m, q, d) of what is subtracted in them."""
        problem = self.problem
        f, slope = latent_slope(problem, self.law, values, x, rows, side)
        white, y = problem.white[rows], problem.y[rows]
        return np.einsum("nab,nb->na", white, np.where(np.isnan(y), 0.0, y - f)), white @ slope

    def _nearest(self, values: Array, edges: Array) -> tuple[Array, NDArray[np.int64]]:
        """Nearest points (n, d), each smooth stretch of which is searched, and the edge that chi sits at, or -1."""
        problem = self.problem
        observed, every = problem.start[:, 0], problem.rows
        n_intervals = edges.shape[-1] - 1
        best = np.clip(np.sum(observed[:, None] >= edges, axis=-1) - 1, 0, n_intervals - 1)
        x, distance = self._descend(
            values,
            every,
            problem.start,
            edges[every, best],
            edges[every, best + 1],
            np.full(len(every), np.inf),
        )
        own = best.copy()
        for other in range(n_intervals):
            low, high = edges[:, other], edges[:, other + 1]
            gap = np.clip(observed, low, high) - observed
            near = every[(own != other) & ((gap / problem.spread) ** 2 < distance) & (high > low)]
            if len(near):
                new, new_distance = self._descend(
                    values, near, x[near], low[near], high[near], distance[near]
                )
                better = new_distance < distance[near]
                x[near[better]], distance[near[better]], best[near[better]] = (
                    new[better],
                    new_distance[better],
                    other,
                )
        at_low, at_high = x[:, 0] == edges[every, best], x[:, 0] == edges[every, best + 1]
        return x, np.where(at_low, best, np.where(at_high, best + 1, -1))

    def _descend(
        self, values: Array, rows: NDArray[np.int64], start: Array, low: Array, high: Array, below: Array
    ) -> tuple[Array, Array]:
        """Nearest points (m, d) with chi from `low` to `high`, and squared distances (m,), by Gauss-Newton steps.

        The search of a row stops early if it cannot reach a distance below `below` (m,).
        """
        x = start.copy()
        x[:, 0] = np.clip(x[:, 0], low, high)
        distance, step, gain = self._measure(values, rows, x, low, high)
        active, scale, length = np.arange(len(rows)), self._scale[rows], np.ones(len(rows))
        for _ in range(_MOST_STEPS):
            open_ = (gain > _CLOSE + _ROUNDING * distance) & (distance - _LARGEST_GAIN * gain < below)
            active = active[open_[active] & (length[active] > _SHORTEST)]
            if len(active) == 0:
                break
            trial = x[active] + length[active, None] * step[active]
            trial[:, 0] = np.clip(trial[:, 0], low[active], high[active])
            measured = self._measure(values, rows[active], trial, low[active], high[active])
            better = measured[0] < distance[active]
            # Gauss-Newton steps overshoot or fall short by a constant factor where residuals are large. The next step
            # has the length that would have been right for the last one (J. Barzilai and J. M. Borwein, IMA J. Numer.
            # Anal. 8, 141 (1988)).
            done = (trial - x[active]) / scale[active]
            change = np.sum(done * (step[active] - measured[1]) / scale[active], axis=1)
            fitting = np.sum(done**2, axis=1) / np.where(change > 0.0, change, 1.0)
            fitting = np.where(change > 0.0, np.clip(fitting, 0.3, 3.0), 1.0)
            length[active] = np.where(better, fitting, 0.25 * length[active])
            at = active[better]
            x[at] = trial[better]
            distance[at], step[at], gain[at] = (each[better] for each in measured)
        return x, distance

    @property
    def _scale(self) -> Array:
        """Size (n, d) of the errors of latent coordinates: of chi its spread; of others a part of what they are."""
        problem = self.problem
        size = np.broadcast_to(problem.step * 1e4, problem.start.shape).copy()
        size[:, 0] = np.minimum(problem.spread, 0.1)
        return size

    def _measure(
        self, values: Array, rows: NDArray[np.int64], x: Array, low: Array, high: Array
    ) -> tuple[Array, Array, Array]:
        """Squared distances (m,) at x (m, d), steps (m, d) towards the least within the limits of chi, and their gain.

        The gain (m,) is the decrease of the squared distance to first order.
        """
        # Differences go inwards, so that they stay on a stretch's own curve.
        side = np.where(x[:, 0] < 0.5 * (low + high), 1.0, -1.0)
        r, slope = self._residual(values, rows, x, side)
        step = _solve(slope, r[..., None])[..., 0]
        inside = np.clip(x[:, 0] + step[:, 0], low, high) - x[:, 0]
        limited = inside != step[:, 0]
        if limited.any() and x.shape[1] > 1:  # the others follow chi, which stops at the limit
            rest = r[limited] - slope[limited, :, 0] * inside[limited, None]
            step[limited, 1:] = _solve(slope[limited, :, 1:], rest[..., None])[..., 0]
        step[:, 0] = inside
        distance = np.sum(r**2, axis=-1)
        left = r - np.einsum("nqd,nd->nq", slope, step)
        return distance, step, distance - np.sum(left**2, axis=-1)


def _losses(c: Array, robust: float | None, redundancy: Array) -> Array:
    """-2 ln L (n,) at squared distances (n,), without its constant."""
    return c if robust is None else (robust + redundancy) * np.log1p(c / robust)


def _solve(A: Array, B: Array) -> Array:
    """Least squares solutions (m, d, k) of A (m, q, d) x = B (m, q, k); 0 along the null space of A."""
    scale = np.sqrt(np.sum(A**2, axis=1))
    scale = np.where(scale > 0.0, scale, 1.0)
    A = A / scale[:, None, :]
    normal = np.swapaxes(A, 1, 2) @ A + _RIDGE * np.eye(A.shape[2])
    return np.linalg.solve(normal, np.swapaxes(A, 1, 2) @ B) / scale[..., None]


def inverse_of(positive: Array) -> Array:
    """Inverse of (p, p), without the directions in which it is 0."""
    unit = unit_of(positive)
    scaled = positive * np.outer(unit, unit)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-10, hermitian=True) * np.outer(unit, unit))


def covariance_of(information: Array, scatter: Array | None = None) -> Array:
    """Inverse H^-1 of (p, p), or H^-1 V H^-1 with a scatter V, infinite for coefficients in a combination without information."""
    if not np.isfinite(information).all():
        return np.full_like(information, np.inf)
    unit = unit_of(information)
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    known = values > _SINGULAR * values[-1]
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T * np.outer(unit, unit)
    if scatter is not None:
        inverse = inverse @ scatter @ inverse
    lost = np.any(np.abs(vectors[:, ~known]) > math.sqrt(_SINGULAR), axis=1)
    inverse[lost, :] = inverse[:, lost] = np.inf
    return np.asarray(inverse)


def unit_of(information: Array) -> Array:
    """Scale (p,) of each coefficient from its information; 1 where there is none."""
    diagonal = np.diag(information)
    return np.asarray(1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)))
