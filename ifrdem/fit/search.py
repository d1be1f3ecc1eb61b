"""Maximum likelihood and profile likelihood of `likelihood.Likelihood`, for many starts or data sets at once.

chi2 can have several minima, because points may be shared out between sticking and sliding in several ways. So the
angle of transition, not mu, is the coordinate that is searched, from starts all over its range; Levenberg-Marquardt
steps with box limits go downhill from all of them together, which costs little more than from one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .likelihood import Array, Likelihood, Points
from .model import LARGEST

MU_LARGEST = 10.0
"""Up to here mu is searched; a real one is well below."""

_MOST_STEPS = 60
_LITTLE = 1e-11  # what chi2 can still fall by when a descent ends, over max(1, chi2): round-off of a sum
_SAME = 1e-9  # difference of chi2 between descents to the same depth
_STARTS_E = ((0.9, -0.95), (0.6, -0.6), (0.3, 0.1), (0.98, -0.5), (0.4, -0.98))  # e_n, e_t


@dataclass(frozen=True)
class Optimum:
    """Where descents ended; the leading axis is that of the descents.

    Attributes
    ----------
    at : array (b, p)
        Coordinates: e_n, e_t, the angle of transition [rad] (or mu), and rho if it is free.
    free : array (b, p)
        Coefficients: e_n, e_t, mu and rho if it is free.
    chi2 : array (b,)
    """

    at: Array
    free: Array
    chi2: Array


class Search:
    """Descents of the chi2 of one likelihood.

    Parameters
    ----------
    likelihood : Likelihood
        Of one set of impacts, or of several with one leading axis (s, n).
    """

    def __init__(self, likelihood: Likelihood) -> None:
        self.likelihood = likelihood
        self.p: int = len(likelihood.free)
        self.low: Array = np.array([0.0, -1.0, 0.0, 0.0])[: self.p]
        steepest = np.arctan(MU_LARGEST / likelihood.model.stick)  # where mu is `MU_LARGEST` for e_n = 0
        self.high: Array = np.array([1.0, 1.0, steepest, likelihood.model.pair.r])[: self.p]

    def limits(self, by_mu: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Lowest and highest coordinates (b, p)."""
        low, high = (np.tile(each, (len(by_mu), 1)) for each in (self.low, self.high))
        high[by_mu, 2] = MU_LARGEST
        return low, high

    def free(self, at: Array, by_mu: NDArray[np.bool_]) -> Array:
        """Coefficients (b, p) at coordinates (b, p)."""
        free = at.copy()
        tan_psi = np.tan(at[:, 2])
        free[:, 2] = np.where(by_mu, at[:, 2], self.likelihood.model.mu_of_transition(at[:, 0], tan_psi))
        return free

    def points(self, at: Array, by_mu: NDArray[np.bool_], likelihood: Likelihood) -> Points:
        """Nearest points, with the derivatives by the coordinates."""
        free = self.free(at, by_mu)
        found = likelihood.at(free)
        # mu = c tan(psi_transit) / (1 + e_n)
        by_angle = likelihood.model.mu_of_transition(at[:, 0], 1.0 / np.cos(at[:, 2]) ** 2)
        by_e_n = -free[:, 2] / (1.0 + at[:, 0])
        chain = np.tile(np.eye(self.p), (len(at), 1, 1))
        chain[:, 2, 2] = np.where(by_mu, 1.0, by_angle)
        chain[:, 2, 0] = np.where(by_mu, 0.0, by_e_n)
        return Points(found.psi, found.residual, np.einsum("bnqp,bpc->bnqc", found.jacobian, chain))

    def descend(
        self,
        start: Array,
        *,
        by_mu: NDArray[np.bool_] | None = None,
        held: NDArray[np.bool_] | None = None,
        likelihood: Likelihood | None = None,
    ) -> Optimum:
        """Go downhill from each start.

        Parameters
        ----------
        start : array (b, p)
            Coordinates.
        by_mu : array (b,) of bool, optional
            Where the third coordinate is mu, not the angle of transition.
        held : array (b, p) of bool, optional
            Coordinates that keep their value.
        likelihood : Likelihood, optional
            Sets of impacts (b, n), one a start, instead of the search's own.
        """
        data = self.likelihood if likelihood is None else likelihood
        by_mu = np.zeros(len(start), dtype=bool) if by_mu is None else by_mu
        held = np.zeros(start.shape, dtype=bool) if held is None else held
        low, high = self.limits(by_mu)
        best = np.clip(start, low, high)
        chi2 = np.full(len(best), np.inf)
        going = np.arange(len(best))
        damping = np.full(len(best), 1e-3)
        now = self.points(best, by_mu, data)
        chi2[:] = now.chi2
        gradient, information = now.gradient, now.information
        for _ in range(_MOST_STEPS):
            step, fall = _step(
                best[going], gradient[going], information[going], damping[going],
                low[going], high[going], held[going],
            )  # fmt: skip
            tried = np.clip(best[going] + step, low[going], high[going])
            new = self.points(tried, by_mu[going], data.take(going))
            better = new.chi2 < chi2[going]
            better_rows = going[better]
            best[better_rows], chi2[better_rows] = tried[better], new.chi2[better]
            gradient[better_rows], information[better_rows] = new.gradient[better], new.information[better]
            damping[going] = np.where(better, 0.1 * damping[going], 8.0 * damping[going])
            done = (fall <= _LITTLE * np.maximum(1.0, chi2[going])) | (damping[going] > 1e10)
            going = going[~done]
            if len(going) == 0:
                break
        return Optimum(best, self.free(best, by_mu), chi2)

    def starts(self) -> Array:
        """Coordinates (b, p) to start from: transitions all over the data, and both ends of it."""
        psi = np.median(np.atleast_2d(self.likelihood.psi), axis=0)
        angles = np.quantile(np.clip(psi, 0.0, LARGEST), np.linspace(0.0, 1.0, 9))
        angles = np.concatenate(
            [[0.5 * angles[0]], 0.5 * (angles[1:] + angles[:-1]), [0.5 * (angles[-1] + LARGEST)]]
        )
        rolling = [0.02 * self.likelihood.model.pair.r] * (self.p - 3)
        # The transition is what makes minima many; with several sets one e_n and e_t has to do.
        pairs = _STARTS_E if self.likelihood.psi.ndim == 1 else _STARTS_E[:1]
        return np.array([[*e, angle, *rolling] for angle in angles for e in pairs])

    def best(self) -> Optimum:
        """The lowest minimum found, of each set of impacts: (1, p) or (s, p).

        Of minima that are as low, the one with the largest angle of transition: where nothing slides, chi2 does not
        change from the last impact on.
        """
        starts = self.starts()
        if self.likelihood.psi.ndim == 1:
            found = self.descend(starts)
            sets = 1
        else:
            sets = len(self.likelihood.psi)
            rows = np.repeat(np.arange(sets), len(starts))
            found = self.descend(np.tile(starts, (sets, 1)), likelihood=self.likelihood.take(rows))
        self.found = found
        chi2, angle = found.chi2.reshape(sets, -1), found.at[:, 2].reshape(sets, -1)
        low = chi2 <= np.min(chi2, axis=1, keepdims=True) + _SAME
        first = np.argmax(np.where(low, angle, -1.0), axis=1) + np.arange(sets) * len(starts)
        return Optimum(found.at[first], found.free[first], found.chi2[first])

    def others(self, optimum: Optimum, ends: Array, rise: float) -> list[tuple[Array, float]]:
        """Coefficients (p,) and chi2 of minima that `best` met outside of intervals, though chi2 allows them.

        Parameters
        ----------
        optimum : Optimum
            That of the one set of impacts.
        ends : array (q, 2)
            Intervals of e_n, e_t, mu, the transition [rad], and rho.
        rise : float
            Of chi2 at the ends.
        """
        values = np.column_stack([self.found.free[:, :3], self.found.at[:, 2], self.found.free[:, 3:]])
        slack = 1e-3 * (ends[:, 1] - ends[:, 0]) + 1e-9
        outside = np.any((values < ends[:, 0] - slack) | (values > ends[:, 1] + slack), axis=1)
        which = np.flatnonzero(outside & (self.found.chi2 < optimum.chi2[0] + rise))
        order = which[np.argsort(self.found.chi2[which])]
        return [(self.found.free[i], float(self.found.chi2[i])) for i in order]


def _step(
    at: Array,
    gradient: Array,
    information: Array,
    damping: Array,
    low: Array,
    high: Array,
    held: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """A damped Gauss-Newton step (b, p), and by how much chi2 should fall (b,)."""
    p = at.shape[1]
    diagonal = np.einsum("bii->bi", information)
    # At a limit that chi2 falls beyond, or where it does not depend on a coordinate, that one stays.
    stays = held | ((at <= low) & (gradient > 0.0)) | ((at >= high) & (gradient < 0.0)) | (diagonal <= 0.0)
    moves = ~stays
    matrix = information * moves[:, :, None] * moves[:, None, :]
    index = np.arange(p)
    scale = np.where(moves, diagonal, 1.0)
    matrix[:, index, index] = np.where(moves, diagonal * (1.0 + damping[:, None]), 1.0)
    # In units in which the diagonal is 1, so that the smallest damping that matters is the same for all.
    unit = 1.0 / np.sqrt(scale)
    matrix = matrix * unit[:, :, None] * unit[:, None, :] + 1e-14 * np.eye(p)
    downhill = -np.where(moves, gradient, 0.0)
    step = unit * np.linalg.solve(matrix, (unit * downhill)[..., None])[..., 0]
    return step, np.einsum("bp,bp->b", downhill, step)
