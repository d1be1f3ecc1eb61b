"""Intervals by profile likelihood: where the best chi2 with one quantity held has risen by a quantile of chi-square.

They need neither symmetry nor straight lines, end at the limits of what the law allows, and go through any function
of a quantity unchanged. The angle of transition is a coordinate of the search, so it is profiled as the
coefficients are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .likelihood import Array
from .search import Optimum, Search

_MOST_TRIES = 40
_PRECISE = 1e-4  # of the root of the rise in chi2, and so of the distance of an end from the best value
_BETTER = 1e-6  # a minimum that is lower by this in chi2 is another one
_CHECKS, _CHECKS_OF_ONE = 3, 6  # transitions with which each end is looked at again: of many sets, of one


@dataclass(frozen=True)
class Intervals:
    """Intervals of each set of impacts; axes: sets s, quantities q, lower and upper end.

    Attributes
    ----------
    quantities : tuple of str
        e_n, e_t, mu, psi_transit [rad], and rho if it is free.
    ends : array (s, q, 2)
    open : array (s, q, 2) of bool
        The end is a limit of the search, up to which chi2 does not rise enough.
    optimum : Optimum
        The minima (s, p) they belong to: the ones given, or lower ones that were met on the way.
    """

    quantities: tuple[str, ...]
    ends: Array
    open: NDArray[np.bool_]
    optimum: Optimum


def intervals(search: Search, optimum: Optimum, rise: float) -> Intervals:
    """Profile-likelihood intervals.

    Parameters
    ----------
    search : Search
        Of one set of impacts, or of several.
    optimum : Optimum
        `search.best()`.
    rise : float
        Of chi2 at the ends: the quantile of the chi-square distribution with one degree of freedom.
    """
    for _ in range(5):
        ends = _Ends(search, optimum, rise)
        ends.find()
        ends.look_again()
        if ends.lower is None:
            break
        optimum = ends.lower
    else:
        raise RuntimeError("the minimum of chi2 sank five times while its surroundings were searched")
    return Intervals(ends.quantities, ends.table(ends.end), ends.table(ends.open), optimum)


class _Ends:
    """All ends that are looked for, in rows: by set, then quantity, then lower and upper end."""

    def __init__(self, search: Search, optimum: Optimum, rise: float) -> None:
        s, p = optimum.at.shape
        self.search, self.optimum, self.z = search, optimum, np.sqrt(rise)
        self.quantities = ("e_n", "e_t", "mu", "psi_transit", "rho")[: p + 1]
        column = np.array([0, 1, 2, 2, 3][: p + 1])
        each = len(self.quantities)
        self.set = np.repeat(np.arange(s), 2 * each)
        self.column = np.tile(np.repeat(column, 2), s)
        self.by_mu = np.tile(np.repeat([name == "mu" for name in self.quantities], 2), s)
        self.sign = np.tile([-1.0, 1.0], s * each)
        self.rows = np.arange(len(self.set))
        self.held = np.zeros((len(self.rows), p), dtype=bool)
        self.held[self.rows, self.column] = True
        self.low, self.high = search.limits(self.by_mu)
        self.limit = np.where(
            self.sign < 0, self.low[self.rows, self.column], self.high[self.rows, self.column]
        )
        self.at = optimum.at[self.set]  # where the last profile point is
        self.at[self.by_mu, 2] = optimum.free[self.set[self.by_mu], 2]
        self.best = self.at[self.rows, self.column]
        self.chi2 = optimum.chi2[self.set]
        self.inside, self.w_inside = self.best.copy(), np.zeros(len(self.rows))
        self.outside, self.w_outside = np.full((2, len(self.rows)), np.nan)
        self.open = np.abs(self.limit - self.best) < 1e-12
        self.end = np.where(self.open, self.limit, self.best)
        self.lower: Optimum | None = None

    def table(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of the rows as (s, q, 2)."""
        return values.reshape(-1, len(self.quantities), 2)

    def find(self) -> None:
        """Go from the best value to each end."""
        width = self.z * self._standard_error()
        room = np.abs(self.limit - self.best)
        value = self.best + self.sign * np.minimum(np.where(np.isfinite(width), width, 0.25 * room), room)
        self._search(self.rows[~self.open], value)

    def look_again(self) -> None:
        """Try to get lower in chi2 at each end with other transitions, and go on where that succeeds."""
        # A 95 % end of e_n, say, lies within the 95 % intervals of all other quantities. With mu held the
        # transition follows from e_n.
        column = np.where(self.by_mu, 0, 2)
        of = np.where(self.by_mu, 0, self.quantities.index("psi_transit"))
        ends = self.table(self.end)[self.set, of]
        rows = self.rows[~self.open & (self.by_mu | ~self.held[:, 2])]
        checks = _CHECKS if self.set[-1] > 0 else _CHECKS_OF_ONE
        for _ in range(3):
            if len(rows) == 0 or self.lower is not None:
                return
            each = np.tile(rows, checks)
            start, here = self.at[each], np.arange(len(each))
            start[here, self.column[each]] = self.end[each]
            share = np.repeat(np.linspace(0.0, 1.0, checks), len(rows))
            start[here, column[each]] = (1.0 - share) * ends[each, 0] + share * ends[each, 1]
            found = self._profile(each, start)
            lowest = np.argmin(found.chi2.reshape(checks, -1), axis=0) * len(rows) + np.arange(len(rows))
            w = np.sqrt(np.maximum(found.chi2[lowest] - self.chi2[rows], 0.0))
            lower = w < self.z * (1.0 - 10.0 * _PRECISE)
            rows, lowest, w = rows[lower], lowest[lower], w[lower]
            self.at[rows], self.inside[rows], self.w_inside[rows] = found.at[lowest], self.end[rows], w
            self.outside[rows] = self.w_outside[rows] = np.nan
            self._search(rows, self._outwards(rows, np.full(len(self.rows), 1.2)))
            rows = rows[~self.open[rows]]

    def _profile(self, rows: NDArray[np.int64], start: Array) -> Optimum:
        """The best chi2 with the quantity held; remembers a minimum that is lower than the best one."""
        data = self.search.likelihood.take(self.set[rows])
        found = self.search.descend(start, by_mu=self.by_mu[rows], held=self.held[rows], likelihood=data)
        for i in np.flatnonzero(found.chi2 < self.chi2[rows] - _BETTER):
            self._remember(int(self.set[rows[i]]), found.free[i])
        return found

    def _remember(self, which: int, free: Array) -> None:
        kept = self.optimum if self.lower is None else self.lower
        at = free.copy()
        at[2] = np.arctan(self.search.likelihood.model.tan_transition(self.search.likelihood.full(free)))
        found = self.search.descend(at[None], likelihood=self.search.likelihood.take(np.array([which])))
        if found.chi2[0] < kept.chi2[which]:
            changed = [each.copy() for each in (kept.at, kept.free, kept.chi2)]
            for each, new in zip(changed, (found.at, found.free, found.chi2), strict=True):
                each[which] = new[0]
            self.lower = Optimum(*changed)

    def _search(self, rows: NDArray[np.int64], value: Array) -> None:
        """Find the ends of some rows, from a first guess of each; w = sqrt(rise of chi2) is nearly linear."""
        for attempt in range(_MOST_TRIES):
            if len(rows) == 0 or self.lower is not None:
                return
            start = self.at[rows]
            start[np.arange(len(rows)), self.column[rows]] = value[rows]
            found = self._profile(rows, start)
            w = np.sqrt(np.maximum(found.chi2 - self.chi2[rows], 0.0))
            within = w < self.z
            self.at[rows[within]] = found.at[within]
            reached = np.abs(w - self.z) < _PRECISE * self.z
            at_limit = within & (value[rows] == self.limit[rows])
            done = reached | at_limit
            self.end[rows[done]], self.open[rows] = value[rows[done]], at_limit & ~reached
            for some, ends, ws in (
                (within, self.inside, self.w_inside),
                (~within, self.outside, self.w_outside),
            ):
                ends[rows[some]], ws[rows[some]] = value[rows[some]], w[some]
            rows = rows[~done]
            unbounded = np.isnan(self.outside[rows])
            growth = np.clip(1.1 * self.z / np.maximum(self.w_inside, 1e-9), 1.2, 5.0)
            value = value.copy()
            value[rows[unbounded]] = self._outwards(rows, growth)[rows[unbounded]]
            between = rows[~unbounded]
            part = (self.z - self.w_inside[between]) / (self.w_outside[between] - self.w_inside[between])
            if attempt >= 4 and attempt % 2 == 0:  # where w jumps, or bends much, halving is safe
                part = np.full(len(between), 0.5)
            value[between] = self.inside[between] + part * (self.outside[between] - self.inside[between])
            # Where chi2 jumps to another minimum, the place of the jump is the end.
            closed = (
                np.abs(self.outside - self.inside)[rows] < _PRECISE * np.abs(self.outside - self.best)[rows]
            )
            self.end[rows[closed]] = self.inside[rows[closed]]
            rows = rows[~closed]
        raise RuntimeError(f"no end of {len(rows)} intervals was found in {_MOST_TRIES} steps")

    def _outwards(self, rows: NDArray[np.int64], growth: Array) -> Array:
        """Values beyond the outermost one that is inside, not beyond the limit."""
        value = self.best.copy()
        distance = np.abs(self.inside - self.best) * growth
        distance = np.where(distance > 0.0, distance, 1e-3)
        value[rows] = (self.best + self.sign * np.minimum(distance, np.abs(self.limit - self.best)))[rows]
        return np.where(np.abs(value - self.limit) < 1e-12, self.limit, value)

    def _standard_error(self) -> Array:
        """Of each row's quantity, by the curvature at the best values; not finite if that is flat."""
        points = self.search.points(self.at, self.by_mu, self.search.likelihood.take(self.set))
        covariance = covariance_of(points.information)
        return np.sqrt(covariance[self.rows, self.column, self.column])


def covariance_of(information: Array) -> Array:
    """Inverse of (..., p, p), infinite in the rows of a matrix that has none."""
    diagonal = np.einsum("...ii->...i", information)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = information * unit[..., :, None] * unit[..., None, :]
    singular = np.any(diagonal <= 0.0, axis=-1) | (np.linalg.cond(scaled) > 1e12)
    scaled[singular] = np.eye(information.shape[-1])
    covariance = np.linalg.inv(scaled) * unit[..., :, None] * unit[..., None, :]
    covariance[singular] = np.inf
    return np.asarray(covariance)
