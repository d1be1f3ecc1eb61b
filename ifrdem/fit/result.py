"""The result of a fit: estimates with intervals, for each law."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.ifr import Admissibility, IFRLaw, Regime
from .data import Collisions, Data
from .laws import Law, ifr_law
from .likelihood import Array
from .model import Pair, Problem

CONFIDENCE = 0.95
"""Of every interval, unless told."""

TELLING = 2.0
"""Difference in AIC from which on the data prefer a law."""


@dataclass(frozen=True)
class Interval:
    """An interval of confidence."""

    low: float
    high: float
    """low, high: its ends."""
    low_open: bool = False
    high_open: bool = False
    """low_open, high_open: the end is a limit of what the law allows (or, for mu and rho, of the search); the data do
    not set it."""

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Estimate:
    """A fitted quantity: a coefficient [1; rho: length], or psi_transit [deg]."""

    value: float
    """Of maximum likelihood."""
    standard_error: float
    """From the curvature of the likelihood; infinite where that is flat."""
    interval: Interval
    """By profile likelihood."""
    bootstrap: Interval | None = None
    """Percentiles of a parametric bootstrap, if one was asked for."""


@dataclass(frozen=True)
class Suspect:
    """An impact that hardly belongs to the others."""

    index: int  # its place among the impacts, from 0
    where: str  # its line in the file
    distance: float  # squared distance from the law, in units of its errors
    probability: float  # of such a distance or a larger one
    quantity: str  # the quantity that is furthest off
    residual: float  # of that quantity at the best true motion, over its error


@dataclass(frozen=True, eq=False)
class Fitted:
    """The fit of one law."""

    law: Law
    estimates: Mapping[str, Estimate]
    """The free coefficients, and psi_transit where the law has one transition for all impacts."""
    covariance: Array
    """Of the free coefficients, from the curvature; infinite where the likelihood is flat; shape (p, p)."""
    flat: tuple[str, ...]
    """Coefficients along a combination of which the likelihood does not change at all; empty if there is none."""
    chi2: float
    dof: int
    probability: float
    """chi2, dof, probability: sum of squares, degrees of freedom, and the probability of a larger sum if law and
    errors hold; the probability is NaN if errors were estimated."""
    log_likelihood: float
    AIC: float
    BIC: float
    cross_validation: float
    """Mean of -2 ln L of an impact that the fit did not see, without its constant; NaN if not asked for."""
    x: Array
    """Fitted true motion before the impacts; of a table of angles psi [rad]; shape (n, d)."""
    psi: Array
    """Angles of incidence at the contact [deg], of the true motion; shape (n,)."""
    regimes: NDArray[np.int8]
    """Values of `Regime` there; shape (n,)."""
    residuals: Array
    """Residuals of the problem's quantities over their errors, at the true motion; shape (n, q)."""
    distance: Array
    weight: Array
    """distance, weight: squared distance of each impact in units of its errors, and its weight in a robust fit; shape
    (n,)."""
    problem: Problem
    """With the errors as they were estimated."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Estimated errors by group of quantities, in standard units (angles of a table of angles in degrees)."""
    suspects: tuple[Suspect, ...] = ()
    without: Mapping[str, float] = field(default_factory=dict)
    """Coefficients of the other fit: of the Gaussian one beside a robust one; of the one without suspects beside a
    Gaussian one. Empty if there is none."""
    admissibility: Admissibility | None = None
    """The verdict on added energy: the necessary and sufficient set, and the strict one. None for another law than
    IFR."""
    warnings: tuple[str, ...] = ()
    """Doubts about the figures."""

    @property
    def coefficients(self) -> dict[str, float]:
        """Every coefficient of the law, fitted and fixed."""
        return {
            name: self.estimates[name].value if name in self.estimates else self.law.fixed[name]
            for name in self.law.ranges
        }

    @property
    def values(self) -> Array:
        """The free coefficients (p,)."""
        return np.array([self.estimates[name].value for name in self.law.free])

    @property
    def correlation(self) -> Array:
        """Of the free coefficients (p, p); NaN where the likelihood is flat."""
        with np.errstate(invalid="ignore"):
            scale = np.sqrt(np.diag(self.covariance))
            return np.asarray(self.covariance / np.outer(scale, scale))

    def count(self) -> dict[str, int]:
        """Number of impacts in each regime that the law can have, by the names of `Regime` in small letters."""
        if not self.law.has_transition:
            return {}
        kinds = list(Regime)[3:] if self.coefficients.get("rho", 0.0) > 0.0 else list(Regime)[1:3]
        return {kind.name.lower(): int(np.sum(self.regimes == kind)) for kind in kinds}

    def ifr(self, k: float = 2.0) -> IFRLaw:
        """The fitted law for disks of shape number k.

        Raises InputError if it is another law, or can add energy in collisions of the fitted disks.
        """
        if self.law.sticking is None or self.admissibility is None:
            raise InputError(f"{self.law.about}: is not an IFR law")
        if not self.admissibility.admissible:
            raise InputError(self.admissibility.message)
        return ifr_law(self.coefficients, self.law.sticking, k)

    def draw(self, number: int, seed: int = 1) -> list[dict[str, float]]:
        """Coefficients drawn from their joint distribution, Gaussian with the covariance, within what the law allows.

        Raises InputError if the likelihood is flat, or one draw in a thousand at most is one that the law allows.

        Parameters
        ----------
        number : int
            Of draws.
        seed : int
            Of the random numbers.
        """
        if not np.all(np.isfinite(self.covariance)):
            raise InputError(
                f"{', '.join(self.flat) or 'the coefficients'}: not determined, nothing can be drawn"
            )
        rng = np.random.default_rng(seed)
        found: list[dict[str, float]] = []
        for _ in range(1000):
            drawn = rng.multivariate_normal(self.values, self.covariance, size=number)
            inside = np.all((drawn >= self.law.low) & (drawn <= self.law.high), axis=1)
            for row in drawn[inside]:
                whole = {**self.law.fixed, **dict(zip(self.law.free, map(float, row), strict=True))}
                with contextlib.suppress(InputError):  # of a law that is not allowed
                    if self.law.sticking is not None:
                        ifr_law(whole, self.law.sticking)
                    found.append({name: whole[name] for name in self.law.ranges})
            if len(found) >= number:
                return found[:number]
        raise InputError(
            "the fitted coefficients lie so far outside of what the law allows that none can be drawn"
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """Laws fitted to one set of impacts."""

    data: Data | Collisions
    pair: Pair | None
    """The disks of a table of angles."""
    laws: Mapping[str, Fitted]
    """By name, as `--model` has it."""
    best: str
    """The law with the lowest AIC; of those within `TELLING` of it, the first that was asked for."""
    decided: bool
    """True if all others are further off, or only one was fitted."""
    level: float = CONFIDENCE
    """Of confidence of the intervals."""
    robust: float | None = None
    """nu of a Student-t likelihood."""
    warnings: tuple[str, ...] = ()
    """Those of the data and of the choice between laws."""

    def law(self, name: str | None = None) -> IFRLaw:
        """The fitted IFR law, the best one unless told.

        Raises InputError if it is another law, or can add energy in collisions of these disks.
        """
        return self.laws[self.best if name is None else name].ifr(self.smallest_k)

    @property
    def smallest_k(self) -> float:
        """The smaller k of the disks."""
        if isinstance(self.data, Collisions):
            return float(min(np.min(self.data.disk_1.k), np.min(self.data.disk_2.k)))
        assert self.pair is not None
        return min(self.pair.k_1, self.pair.k_2)
