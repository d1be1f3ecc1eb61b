"""What the figures of a fit do not show by themselves: limits, undetermined coefficients, added energy."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import InputError
from ..model.ifr import Admissibility, EnergyWarning, IFRLaw
from .data import Data
from .model import MEASURED, Array, Model
from .result import TELLING, Closure

_TIED = 0.995  # correlation of two coefficients that are known in combination only


def admissibility(model: Model, coefficients: Array) -> Admissibility:
    """Whether the law with coefficients (4,) can add energy in collisions of the model's pair."""
    e_n, e_t, mu, rho = coefficients
    pair = model.pair
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EnergyWarning)
        try:  # the sets are largest for the smaller k: a law that is refused there is refused for the pair
            law = IFRLaw(e_n=e_n, e_t=e_t, mu=mu, rho=rho, sticking=model.sticking, k=min(pair.k_1, pair.k_2))
        except InputError as error:
            return Admissibility(False, False, str(error))
    return law.admissibility(pair.k_1, pair.k_2, pair.M, 1.0)


def doubts(closure: Closure, others: Sequence[tuple[Array, float]]) -> list[str]:
    """What to know before the figures of one kind of sticking are used.

    `others` are coefficients (p,) and chi2 of solutions outside of the intervals, the best one first.
    """
    found = []
    if others:
        free, chi2 = others[0]
        values = ", ".join(
            f"{name} = {value:.4g}" for name, value in zip(closure.coefficients, free, strict=True)
        )
        found.append(
            f"another solution, outside of these intervals, fits nearly as well: {values}, chi2 = {chi2:.4g}; impacts "
            "over a wider range of psi, or another quantity, would tell"
        )
    estimates, count = closure.estimates, closure.count()
    sliding = sum(n for name, n in count.items() if name.startswith("sliding"))
    mu, transition = estimates["mu"].interval, estimates["psi_transit"].interval
    if sliding == 0:
        known = (
            "at all"
            if mu.low_open
            else f"beyond being above {mu.low:.3g} (and the transition above {transition.low:.3g} degrees)"
        )
        found.append(f"no impact slides: mu is not determined {known}; impacts at larger psi are needed")
    elif mu.high_open:
        found.append("mu is not determined: the data set no upper end to it; more sliding impacts are needed")
    if sliding == len(closure.psi):
        found.append(
            f"no impact sticks: the kind of sticking is not tested, and the transition is only known to be below "
            f"{transition.high:.3g} degrees; impacts at smaller psi are needed"
        )
    for name, whole in (("e_n", 1.0), ("e_t", 2.0)):
        low, high = estimates[name].interval.low, estimates[name].interval.high
        if high - low > 0.5 * whole:
            found.append(
                f"{name} is not determined: its 95 % interval, {low:.3g} to {high:.3g}, covers more than half "
                "of what the law allows"
            )
    if "rho" in estimates:
        rolling = estimates["rho"].interval
        if rolling.high_open:
            found.append("rho is not determined: the data set no upper end to it")
        elif rolling.low_open:
            found.append(f"rho is compatible with 0: it is below {rolling.high:.3g}")
    if len(closure.flat) > 1:
        found.append(f"{', '.join(closure.flat)} are determined in combination only: chi2 is flat along it")
    p = len(closure.coefficients)
    for i, j in zip(*np.triu_indices(p, 1), strict=True):
        if abs(closure.correlation[i, j]) > _TIED:
            a, b = closure.coefficients[i], closure.coefficients[j]
            found.append(
                f"{a} and {b} are determined in combination rather than each by itself: their correlation is "
                f"{closure.correlation[i, j]:.4f}"
            )
    limits = {"e_n": (0.0, 1.0), "e_t": (-1.0, 1.0), "mu": (0.0, np.inf)}
    for name, ends in limits.items():
        for end in ends:
            if abs(estimates[name].value - end) < 1e-6:
                found.append(f"{name} lies at its limit, {end:g}: the data alone would go beyond")
    if closure.probability < 0.01:
        found.append(
            f"chi2 is {closure.chi2:.4g} for {closure.dof} degrees of freedom (probability {closure.probability:.2g}): "
            "the law does not hold or the errors are larger than stated, and the intervals are too narrow"
        )
    elif closure.probability > 0.99:
        found.append(
            f"chi2 is only {closure.chi2:.4g} for {closure.dof} degrees of freedom: the errors are smaller than "
            "stated, and the intervals are too wide"
        )
    if not closure.admissibility.admissible:
        found.append(
            "the fit leaves the set in which no collision adds energy (necessary and sufficient): "
            f"{closure.admissibility.message}"
        )
    elif not closure.admissibility.strict:
        found.append(
            "the fit leaves the strict set, not the necessary and sufficient one: "
            f"{closure.admissibility.message}"
        )
    return found


def doubts_of_both(data: Data, closures: Mapping[str, Closure]) -> list[str]:
    """What to know of the data and of the choice between kinds of sticking."""
    found = []
    if "sqrt_d2_d1" in data.names:
        found.append(
            "sqrt_d2_d1 is taken as v_2 / v_1 (Eq. 29), which sliding and spinning on the table put off by up to 9 % "
            "for coins: its error should say so"
        )
    if len(data) > 2 and np.max(data.psi) < 1.6:
        found.append(
            f"the largest psi is {np.max(data.psi):g} degrees: angles must be in degrees, not in radians"
        )
    difference = abs(np.ptp([closure.AIC for closure in closures.values()]))
    if len(closures) > 1 and difference < TELLING:
        why = ""
        if len(data.names) == 1 and MEASURED[data.names[0]].unit == "deg":
            why = (
                f"; {data.names[0]} alone hardly ever does, because both kinds give the same curves with other e_n and "
                "e_t: measure another quantity too"
            )
        found.append(
            f"the data do not tell the kinds of sticking apart: AIC differs by {difference:.2g}, and {TELLING:g} would "
            f"count{why}"
        )
    return found
