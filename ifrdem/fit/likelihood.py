"""The likelihood of measured impacts: distances of points from the predicted curve, with errors in every angle.

Every measured value is Gaussian about the law's prediction at the true impact angle, and the measured impact
angle is Gaussian about the true one. The true angles psi_i are nuisance parameters, over which the likelihood is
maximised: up to a constant

    -2 ln L = chi2 = sum_i min over psi_i of [ (psi_obs,i - psi_i)^2 / s_psi,i^2
                                               + sum_q (y_q,i - f_q(psi_i))^2 / s_q,i^2 ],

the squared distance of each point from the curve in units of its errors. For a straight line that is the
effective variance s_y^2 + f'^2 s_psi^2. It also holds where the curve bends within an error (delta_1 near M =
e_n), and, unlike a variance with a slope that jumps, it is continuous in the coefficients where a point changes
from sticking to sliding: the law's curve has a corner there, and the nearest point of a curve with a corner moves
continuously. For errors that are small on the scale of the curve, chi2 follows a chi-square distribution with
(values measured after the impact) - (coefficients) degrees of freedom.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .data import Data
from .model import COEFFICIENTS, Model

Array = NDArray[np.float64]

_STEP = 1e-6  # of a one-sided difference, in radians or of a coefficient: error 1e-6, round-off 1e-10
_WIDE = 1e-4  # [rad] of a difference that gives the bend of a curve too
_MOST_STEPS = 30
_CLOSE = 1e-7  # of an error: chi2 is stationary in the true angles, so that this changes it by 1e-14


@dataclass(frozen=True)
class Points:
    """The nearest points of the curves of some coefficients; the leading axes `...` are those of the coefficients.

    Attributes
    ----------
    psi : array (..., n)
        True impact angles that fit best [rad].
    residual : array (..., n, 1 + q)
        (measured - fitted) / error, of psi first; chi2 is the sum of squares.
    jacobian : array (..., n, 1 + q, p)
        Its derivative by the free coefficients, the true angles following.
    """

    psi: Array
    residual: Array
    jacobian: Array

    @property
    def chi2(self) -> Array:
        """Sum of squared residuals, (...)."""
        return np.asarray(np.sum(self.residual**2, axis=(-2, -1)))

    @property
    def gradient(self) -> Array:
        """Half the derivative of chi2, J^T r, (..., p)."""
        return np.asarray(np.einsum("...nqp,...nq->...p", self.jacobian, self.residual))

    @property
    def information(self) -> Array:
        """J^T J, (..., p, p): the inverse of the covariance matrix."""
        return np.asarray(np.einsum("...nqa,...nqb->...ab", self.jacobian, self.jacobian))


class Likelihood:
    """chi2 of `Data` under a `Model`, as a function of the free coefficients.

    Parameters
    ----------
    data : Data
        What was measured.
    model : Model
        The pair and its kind of sticking.
    rolling : bool
        Whether rho is free; it is 0 otherwise.

    Attributes
    ----------
    free : tuple of str
        Names of the free coefficients, the p last axis of every array of them.
    psi, y : array (..., n) and (..., n, q)
        Measured impact angles [rad] and values. With leading axes, several sets of impacts with the same errors;
        coefficients then have the same leading axes.
    """

    def __init__(self, data: Data, model: Model, *, rolling: bool = False) -> None:
        self.model = model
        self.free: tuple[str, ...] = COEFFICIENTS if rolling else COEFFICIENTS[:3]
        self.names: tuple[str, ...] = data.names
        self.psi: Array = np.radians(data.psi)
        self.y: Array = np.stack([data.measured[name] for name in self.names], axis=-1)
        self.s_psi: Array = np.radians(data.errors["psi"])
        self.s: Array = np.stack([data.errors[name] for name in self.names], axis=-1)

    def of(self, psi: Array, y: Array) -> Likelihood:
        """The same for other values measured, with the same errors."""
        other = copy.copy(self)
        other.psi, other.y = psi, y
        return other

    def take(self, which: NDArray[np.int64]) -> Likelihood:
        """For these of the sets of impacts, which may repeat; without leading axes there is one, for all."""
        return self if self.psi.ndim == 1 else self.of(self.psi[which], self.y[which])

    def full(self, free: Array) -> Array:
        """All four coefficients (..., 4) from the free ones (..., p)."""
        rest = len(COEFFICIENTS) - free.shape[-1]
        return np.concatenate([free, np.zeros((*free.shape[:-1], rest))], axis=-1)

    def at(self, free: Array) -> Points:
        """Nearest points and derivatives for free coefficients (..., p)."""
        full = self.full(free)
        psi, at_edge = self._nearest(full)
        # All derivatives in one call: at psi, at psi a little further, and with each coefficient changed.
        p = free.shape[-1]
        inside = self._inside(full, psi)
        changed = self.full(free + _STEP * np.eye(p).reshape(p, *np.ones(free.ndim - 1, dtype=int), p))
        moved = psi + self._moved_edges(full, changed, at_edge)  # (p, ..., n)
        angles = np.concatenate([[psi, psi + _STEP * inside], moved])
        coefficients = np.concatenate([np.broadcast_to(full, (2, *full.shape)), changed])
        f = self.model.predict(coefficients[..., None, :], angles, self.names)  # (2 + p, ..., n, q)
        residual = np.concatenate(
            [((self.psi - psi) / self.s_psi)[..., None], (self.y - f[0]) / self.s], axis=-1
        )
        slope = (f[1] - f[0]) / (_STEP * inside)[..., None] / self.s
        by_psi = -np.concatenate([np.broadcast_to(1.0 / self.s_psi, psi.shape)[..., None], slope], axis=-1)
        by_coefficient = -np.concatenate(
            [((moved - psi) / self.s_psi)[..., None], (f[2:] - f[0]) / self.s], axis=-1
        )
        jacobian = np.moveaxis(by_coefficient / _STEP, 0, -1)
        # Where the true angle is free it follows so as to keep the distance least, which takes the part along
        # the curve out of the derivative. At an edge between regimes it moves with the edge, as `moved` has it.
        along = np.einsum("...q,...qp->...p", by_psi, jacobian) / np.sum(by_psi**2, axis=-1)[..., None]
        along[at_edge >= 0] = 0.0
        return Points(psi, residual, jacobian - by_psi[..., None] * along[..., None, :])

    def _edges(self, full: Array) -> Array:
        return self.model.edges(full, rolling=len(self.free) > 3)

    def _inside(self, full: Array, psi: Array) -> Array:
        """+1 or -1: on which side of psi the curve stays smooth."""
        gap = psi[..., :, None] - self._edges(full)[..., None, :]
        nearest = np.take_along_axis(gap, np.argmin(np.abs(gap), axis=-1)[..., None], axis=-1)[..., 0]
        return np.where(nearest >= 0.0, 1.0, -1.0)

    def _moved_edges(self, full: Array, changed: Array, at_edge: NDArray[np.int64]) -> Array:
        """How far (p, ..., n) the true angles that sit at an edge move with it."""
        shift = self._edges(changed) - self._edges(full)
        which = np.broadcast_to(np.maximum(at_edge, 0), (len(shift), *at_edge.shape))
        return np.where(at_edge >= 0, np.take_along_axis(shift, which, axis=-1), 0.0)

    def _nearest(self, full: Array) -> tuple[Array, NDArray[np.int64]]:
        """Nearest points of the curves of coefficients (..., 4), each smooth stretch of which is searched.

        Returns
        -------
        psi : array (..., n)
            True angle of each point [rad].
        at_edge : array (..., n) of int
            The edge between regimes that it sits at, -1 if it sits at none.
        """
        edges = self._edges(full)
        stretches = edges.shape[-1] - 1
        shape = (*full.shape[:-1], self.psi.shape[-1])
        observed = np.broadcast_to(self.psi, shape).ravel()
        edge = np.broadcast_to(edges[..., None, :], (*shape, stretches + 1)).reshape(-1, stretches + 1)
        row = np.broadcast_to(
            np.arange(len(edge) // shape[-1])[:, None], (len(edge) // shape[-1], shape[-1])
        ).ravel()
        tasks = _Tasks(
            model=self.model,
            names=self.names,
            coefficients=full.reshape(-1, 4)[row],
            observed=observed,
            y=np.broadcast_to(self.y, (*shape, len(self.names))).reshape(-1, len(self.names)),
            s_psi=np.broadcast_to(self.s_psi, shape).ravel(),
            s=np.broadcast_to(self.s, (*shape, len(self.names))).reshape(-1, len(self.names)),
        )
        every = np.arange(len(observed))
        own = np.clip(np.sum(observed[:, None] >= edge, axis=-1) - 1, 0, stretches - 1)
        psi, distance = tasks.solve(every, edge[every, own], edge[every, own + 1])
        best = own.copy()
        for other in range(stretches):
            gap = np.clip(observed, edge[:, other], edge[:, other + 1]) - observed
            near = every[(own != other) & (0.5 * (gap / tasks.s_psi) ** 2 < distance)]
            if len(near) == 0:
                continue
            new_psi, new_distance = tasks.solve(near, edge[near, other], edge[near, other + 1])
            better = new_distance < distance[near]
            psi[near[better]], distance[near[better]] = new_psi[better], new_distance[better]
            best[near[better]] = other
        at_low, at_high = psi == edge[every, best], psi == edge[every, best + 1]
        at_edge = np.where(at_low, best, np.where(at_high, best + 1, -1))
        return psi.reshape(shape), at_edge.reshape(shape)


@dataclass(frozen=True)
class _Tasks:
    """Points and the curves to which the way is to be found, m of them in a row."""

    model: Model
    names: tuple[str, ...]
    coefficients: Array  # (m, 4)
    observed: Array  # (m,)
    y: Array  # (m, q)
    s_psi: Array  # (m,)
    s: Array  # (m, q)

    def solve(self, which: NDArray[np.int64], low: Array, high: Array) -> tuple[Array, Array]:
        """Nearest points of some tasks on smooth stretches from `low` to `high` [rad], by Newton's method.

        Returns
        -------
        psi, distance : array (len(which),)
            True angle [rad], and half the squared distance.
        """
        psi = np.clip(self.observed[which], low, high)
        distance, step = self._measure(which, psi, psi < 0.5 * (low + high))
        going = np.arange(len(which))
        for _ in range(_MOST_STEPS):
            tried = np.clip(psi[going] + step[going], low[going], high[going])
            moving = np.abs(tried - psi[going]) > _CLOSE * self.s_psi[which[going]]
            going, tried = going[moving], tried[moving]
            if len(going) == 0:
                break
            left = tried < 0.5 * (low[going] + high[going])
            new_distance, new_step = self._measure(which[going], tried, left)
            better = new_distance < distance[going]
            step[going] = np.where(better, new_step, 0.25 * step[going])
            at = going[better]
            psi[at], distance[at] = tried[better], new_distance[better]
        return psi, distance

    def _measure(self, which: NDArray[np.int64], psi: Array, left: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Half the squared distance at psi, and Newton's step towards its minimum.

        Differences are taken to the right where `left`, so that they stay on a stretch's own curve.
        """
        side = np.where(left, _WIDE, -_WIDE)
        angles = np.stack([psi, psi + side, psi + 2.0 * side])
        f = self.model.predict(self.coefficients[which], angles, self.names)
        s, s_psi, side = self.s[which], self.s_psi[which], side[:, None]
        away = (self.y[which] - f[0]) / s
        slope = (4.0 * f[1] - 3.0 * f[0] - f[2]) / (2.0 * side) / s
        bend = (f[0] - 2.0 * f[1] + f[2]) / side**2 / s
        off = (self.observed[which] - psi) / s_psi
        gauss = 1.0 / s_psi**2 + np.sum(slope**2, axis=-1)
        newton = np.maximum(gauss - np.sum(bend * away, axis=-1), 0.3 * gauss)  # never uphill
        step = (off / s_psi + np.sum(slope * away, axis=-1)) / newton
        return 0.5 * (off**2 + np.sum(away**2, axis=-1)), step
