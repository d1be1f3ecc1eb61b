"""Warnings beside the figures of a fit: limits, undetermined coefficients, outliers, added energy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import InputError
from ..model.ifr import Admissibility
from .data import Collisions, Data
from .laws import Law, ifr_law
from .likelihood import Array
from .model import MEASURED
from .result import TELLING, Fitted

_TIED = 0.995  # correlation of two coefficients that are known in combination only
_MOST_NAMED = 20  # suspicious lines


def admissibility(
    law: Law, coefficients: Mapping[str, float], pairs: Sequence[tuple[float, float, float, float]]
) -> Admissibility:
    """The verdict on the energy of the worst of pairs of k_1, k_2, m_1, m_2."""
    assert law.sticking is not None
    own = {name: coefficients[name] for name in law.ranges}
    try:  # the sets are largest for the smaller k: a law that is refused there is refused for all
        made = ifr_law(own, law.sticking, min(min(pair[:2]) for pair in pairs))
    except InputError as error:
        return Admissibility(False, False, str(error))
    return min((made.admissibility(*pair) for pair in pairs), key=lambda each: each[:2])


def doubts(fitted: Fitted, others: Sequence[tuple[Array, float]], *, robust: bool) -> list[str]:
    """Warnings for one law.

    `others` are coefficients (p,) and loss of solutions outside of the intervals, the best one first.
    """
    found = _outliers(fitted, robust)
    if others:
        free, chi2 = others[0]
        values = ", ".join(f"{name} = {value:.4g}" for name, value in zip(fitted.law.free, free, strict=True))
        found.append(
            f"another solution, outside of these intervals, fits nearly as well: {values}, chi2 = {chi2:.4g}; impacts "
            "over a wider range of psi, or another quantity, would tell"
        )
    estimates, count = fitted.estimates, fitted.count()
    if fitted.law.has_transition and "mu" in fitted.law.free:
        sliding = sum(n for name, n in count.items() if name.startswith("sliding"))
        mu, transition = estimates["mu"].interval, estimates.get("psi_transit")
        if sliding == 0:
            known = "at all"
            if not mu.low_open:
                known = f"beyond being above {mu.low:.3g}"
                if transition is not None:
                    known += f" (and the transition above {transition.interval.low:.3g} degrees)"
            found.append(f"no impact slides: mu is not determined {known}; impacts at larger psi are needed")
        elif mu.high_open:
            found.append(
                "mu is not determined: the data set no upper end to it; more sliding impacts are needed"
            )
        if sliding == len(fitted.psi):
            below = ""
            if transition is not None:
                high = transition.interval.high
                below = f", and the transition is only known to be below {high:.3g} degrees"
            text = "no impact sticks: the kind of sticking is not tested"
            found.append(f"{text}{below}; impacts at smaller psi are needed")
    for name, whole in (("e_n", 1.0), ("e_t", 2.0), ("beta", 2.0)):
        if name not in estimates:
            continue
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
    if len(fitted.flat) > 1:
        found.append(f"{', '.join(fitted.flat)} are determined in combination only: chi2 is flat along it")
    p = len(fitted.law.free)
    for i, j in zip(*np.triu_indices(p, 1), strict=True):
        if abs(fitted.correlation[i, j]) > _TIED:
            a, b = fitted.law.free[i], fitted.law.free[j]
            found.append(
                f"{a} and {b} are determined in combination rather than each by itself: their correlation is "
                f"{fitted.correlation[i, j]:.4f}"
            )
    for name in fitted.law.free:
        for end in fitted.law.ranges[name]:
            if abs(estimates[name].value - end) < 1e-6 and not (name == "rho" and end > 0.0):
                found.append(f"{name} lies at its limit, {end:g}: the data alone would go beyond")
    chi2, dof, probability, left = fitted.chi2, fitted.dof, fitted.probability, ""
    if _few(fitted) and np.isfinite(probability):  # these are named; do the others follow the law?
        from scipy.special import chdtrc

        gone = [each.index for each in fitted.suspects]
        chi2 -= float(np.sum(fitted.distance[gone]))
        dof -= int(np.sum(fitted.problem.redundancy[gone]))
        probability, left = float(chdtrc(max(dof, 1), chi2)), " without the suspicious lines"
    of = f"{chi2:.4g} for {dof} degrees of freedom{left}"
    if probability < 0.01:
        text = "the law does not hold or the errors are larger than stated, and the intervals are too narrow"
        found.append(f"chi2 is {of} (probability {probability:.2g}): {text}")
    elif probability > 0.99:
        text = "the errors are smaller than stated, and the intervals are too wide"
        found.append(f"chi2 is only {of}: {text}")
    verdict = fitted.admissibility
    if verdict is not None and not verdict.strict:
        text = "the strict set, not the necessary and sufficient one"
        if not verdict.admissible:
            text = "the set in which no collision adds energy (necessary and sufficient)"
        found.append(f"the fit leaves {text}: {verdict.message}")
    return found


def _few(fitted: Fitted) -> bool:
    """True if single impacts are suspicious, rather than the law or the errors."""
    return 0 < len(fitted.suspects) <= max(0.25 * len(fitted.psi), 1.0)


def _outliers(fitted: Fitted, robust: bool) -> list[str]:
    """Suspicious lines, and what they do to the coefficients."""
    found = []
    named = [
        f"{each.where} ({each.quantity} {each.residual:+.1f} errors off, chi2 {each.distance:.4g}, "
        f"probability {each.probability:.1g})"
        for each in fitted.suspects[:_MOST_NAMED]
    ]
    if fitted.suspects and not _few(fitted):
        count = f"{len(fitted.suspects)} of {len(fitted.psi)} impacts are far off"
        return [f"{count}: the law or the errors are in doubt, rather than single lines"]
    s = "s" * (len(fitted.suspects) > 1)
    if named:
        more = f" and {len(fitted.suspects) - len(named)} more" if len(fitted.suspects) > len(named) else ""
        found.append(f"suspicious line{s}: {'; '.join(named)}{more}")
    if fitted.without and (named or robust):
        changes = []
        for name, other in fitted.without.items():
            each = fitted.estimates[name]
            by = (other - each.value) / each.standard_error
            changes.append(f"{name} = {other:.4g} ({by:+.1f} standard errors)")
        first, last = f"without the suspicious line{s}", "; --robust gives outliers little weight"
        if robust:
            first, last = "without --robust", ""
        found.append(f"{first}: {', '.join(changes)}{last}")
    return found


def doubts_of_all(data: Data | Collisions, laws: Mapping[str, Fitted]) -> list[str]:
    """Warnings of the data and of the choice between laws."""
    found = list(data.notes)
    angles = isinstance(data, Data)
    if "sqrt_d2_d1" in data.names:
        found.append(
            "sqrt_d2_d1 is taken as v_2 / v_1 (Eq. 29), which sliding and spinning on the table put off by up to 9 % "
            "for coins: its error should say so"
        )
    if isinstance(data, Data) and len(data) > 2 and np.max(data.psi) < 1.6:
        found.append(
            f"the largest psi is {np.max(data.psi):g} degrees: a column in radians is named psi (rad), "
            "or --unit psi=rad"
        )
    order = sorted(laws.values(), key=lambda each: each.AIC)
    if len(order) > 1 and (difference := order[1].AIC - order[0].AIC) < TELLING:
        why = ""
        if angles and len(data.names) == 1 and MEASURED[data.names[0]].unit == "deg":
            why = (
                f"; {data.names[0]} alone hardly ever does, because both kinds give the same curves with other e_n and "
                "e_t: measure another quantity too"
            )
        a, b = order[0].law.name, order[1].law.name
        found.append(
            f"the data do not tell {a} and {b} apart: AIC differs by {difference:.2g}, and {TELLING:g} would "
            f"count{why}"
        )
    return found
