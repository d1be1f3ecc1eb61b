"""What a fit found: estimates with intervals, for each kind of sticking."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.ifr import Admissibility, EnergyWarning, IFRLaw, Regime
from .data import Data
from .model import COEFFICIENTS, Array, Model, Pair, Sticking

CONFIDENCE = 0.95
"""Of every interval."""

TELLING = 2.0
"""Difference in AIC from which on the data prefer a kind of sticking."""


@dataclass(frozen=True)
class Interval:
    """A 95 % interval.

    Attributes
    ----------
    low, high : float
        Its ends.
    low_open, high_open : bool
        The end is a limit of what the law allows (or, for mu and rho, of the search); the data do not set it.
    """

    low: float
    high: float
    low_open: bool = False
    high_open: bool = False

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Estimate:
    """A fitted quantity: e_n, e_t, mu [1], psi_transit [deg] or rho [length].

    Attributes
    ----------
    value : float
        Of maximum likelihood.
    standard_error : float
        From the curvature of the likelihood; infinite where that is flat.
    interval : Interval
        By profile likelihood.
    bootstrap : Interval or None
        Percentiles of a parametric bootstrap, if one was asked for.
    """

    value: float
    standard_error: float
    interval: Interval
    bootstrap: Interval | None = None


@dataclass(frozen=True, eq=False)
class Closure:
    """The fit with one kind of sticking.

    Attributes
    ----------
    sticking : str
        "percussion_center" or "contact_point".
    estimates : mapping of str to Estimate
        e_n, e_t, mu, psi_transit, and rho if it was fitted.
    correlation : array (p, p)
        Of the coefficients `coefficients`; NaN where the likelihood is flat.
    coefficients : tuple of str
        e_n, e_t, mu, and rho if it was fitted.
    flat : tuple of str
        Coefficients along a combination of which chi2 does not change at all; empty if there is none.
    chi2, dof, probability : float, int, float
        Sum of squares, degrees of freedom, and the probability of a larger sum if law and errors hold.
    AIC, BIC : float
        chi2 + 2 p and chi2 + p ln(number of values).
    psi : array (n,)
        Fitted true impact angles [deg].
    regimes : array (n,) of int8
        Values of `Regime` at these angles.
    admissibility : Admissibility
        Whether the fitted law can add energy in collisions of this pair: the necessary and sufficient set, and the
        strict one.
    warnings : tuple of str
        What to know before the figures are used.
    """

    sticking: Sticking
    estimates: Mapping[str, Estimate]
    correlation: Array
    coefficients: tuple[str, ...]
    flat: tuple[str, ...]
    chi2: float
    dof: int
    probability: float
    AIC: float
    BIC: float
    psi: Array
    regimes: NDArray[np.int8]
    admissibility: Admissibility
    warnings: tuple[str, ...] = ()

    @property
    def values(self) -> Array:
        """e_n, e_t, mu, rho: shape (4,)."""
        return np.array(
            [self.estimates[name].value if name in self.estimates else 0.0 for name in COEFFICIENTS]
        )

    def count(self) -> dict[str, int]:
        """Number of impacts in each regime that the law can have, by the names of `Regime` in small letters."""
        kinds = list(Regime)[3:] if self.values[3] > 0.0 else list(Regime)[1:3]
        return {kind.name.lower(): int(np.sum(self.regimes == kind)) for kind in kinds}


@dataclass(frozen=True, eq=False)
class Fit:
    """Both kinds of sticking fitted to one set of impacts.

    Attributes
    ----------
    data : Data
    pair : Pair
    closures : mapping of str to Closure
        By kind of sticking.
    best : str
        The kind with the lower AIC; the paper's percussion centre if they differ by less than `TELLING`.
    decided : bool
        Whether they differ by more, or only one was fitted.
    warnings : tuple of str
        What concerns both.
    """

    data: Data
    pair: Pair
    closures: Mapping[str, Closure]
    best: str
    decided: bool
    warnings: tuple[str, ...] = ()

    def predict(self, sticking: str, psi: Array) -> Array:
        """Fitted values (n, q) of `data.names` at impact angles (n,) [deg]; angles in degrees."""
        model = Model(self.pair, self.closures[sticking].sticking)
        return model.predict(self.closures[sticking].values, np.radians(psi), self.data.names)

    def law(self, sticking: str | None = None) -> IFRLaw:
        """The fitted law, of the better kind unless told.

        Raises
        ------
        InputError
            If it can add energy in collisions of this pair.
        """
        closure = self.closures[self.best if sticking is None else sticking]
        if not closure.admissibility.admissible:
            raise InputError(closure.admissibility.message)
        e_n, e_t, mu, rho = closure.values
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyWarning)  # `admissibility.strict` says the same
            return IFRLaw(
                e_n=e_n,
                e_t=e_t,
                mu=mu,
                rho=rho,
                sticking=closure.sticking,
                k=min(self.pair.k_1, self.pair.k_2),
            )
