"""The result of a fit: estimates with intervals, and warnings, for each law."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, option_name
from ..model.laws.ifr import Admissibility, IFRLaw, Regime
from ..tools.checked import Count, Positive, Seed, choice, validated
from .data import BEFORE, Collisions, Data
from .laws import Law, ifr_law
from .likelihood import Array
from .missing import helpful
from .model import DIRECTION, MEASURED, CollisionProblem, FitProblem, Pair
from .trends import Trends

CONFIDENCE = 0.95
"""Default confidence of every interval."""

TELLING = 2.0
"""Difference in AIC from which on the data prefer a law."""

_LEAST_PROBABILITY = 1e-16  # below it no figure means anything: errors are no such Gaussians
_DOMINANT = 0.9  # part of chi2 that one impact has if it alone decides on the fit
_TIED = 0.995  # correlation of two coefficients that are known in combination only
_MOST_NAMED = 20  # suspicious lines


def of_probability(value: float, digits: int, equals: str = "") -> str:
    """A probability as text, behind `equals`; "below 1e-16" of less.

    Examples
    --------
    >>> of_probability(0.0, 3), of_probability(0.8172, 2, "= ")
    ('below 1e-16', '= 0.82')
    """
    least = f"below {_LEAST_PROBABILITY:g}"
    return least if value < _LEAST_PROBABILITY else f"{equals}{value:.{digits}g}"


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
    """Percentiles of a parametric bootstrap, if one was made."""


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
    """ln L; where errors are estimated, integrated over the true motions. It depends on units, as each density does:
    only differences between laws mean something."""
    AIC: float
    """-2 ln L + 2 q, with q coefficients and estimated errors. Where errors are estimated AICc, infinite for too few
    values; of a robust fit with the expected optimism, `Points.optimism`, instead of 2 for each coefficient."""
    BIC: float
    """-2 ln L + q ln n for n impacts."""
    cross_validation: float
    """Mean of -2 ln L of an impact that the fit did not use; NaN if not computed."""
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
    problem: FitProblem
    """With the errors as they were estimated."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Estimated errors by group of quantities, in standard units (angles of a table of angles in degrees)."""
    errors_of_errors: Mapping[str, float] = field(default_factory=dict)
    """Their standard errors, over them; infinite for one that is as small as is tried."""
    suspects: tuple[Suspect, ...] = ()
    without: Mapping[str, float] = field(default_factory=dict)
    """Coefficients of the other fit: of the Gaussian one for a robust one; of the one without suspects for a
    Gaussian one. Empty if there is none."""
    admissibility: Admissibility | None = None
    """The verdict on added energy: the necessary and sufficient set, and the strict one. None for another law than
    IFR."""
    warnings: tuple[str, ...] = ()
    """Doubts about the figures."""
    trends: Trends | None = None
    """Of whole collisions, if there are enough: how the coefficients of single impacts change with speed and spin."""

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
        """Correlation matrix of the free coefficients (p, p); NaN where the likelihood is flat."""
        with np.errstate(invalid="ignore"):
            scale = np.sqrt(np.diag(self.covariance))
            return np.asarray(self.covariance / np.outer(scale, scale))

    def count(self) -> dict[str, int]:
        """Number of impacts in each regime that the law can have, by the names of `Regime` in small letters."""
        if not self.law.has_transition:
            return {}
        kinds = list(Regime)[3:] if self.coefficients.get("rho", 0.0) > 0.0 else list(Regime)[1:3]
        return {kind.name.lower(): int(np.sum(self.regimes == kind)) for kind in kinds}

    @validated
    def ifr(self, k: Positive = 2.0) -> IFRLaw:
        """The fitted law for disks of shape number k.

        Raises InputError if it is another law, or can add energy in collisions of the fitted disks.
        """
        if self.law.sticking is None or self.admissibility is None:
            raise InputError(f"{self.law.about}: is not an IFR law")
        if self.law.depends_on_speed:
            raise InputError(f"{self.law.name}: cannot be an `IFRLaw`, because its e_n depends on speed")
        if not self.admissibility.admissible:
            raise InputError(self.admissibility.message)
        return ifr_law(self.coefficients, self.law.sticking, k)

    @validated
    def draw(self, number: Count, seed: Seed = 1) -> list[dict[str, float]]:
        """`number` draws of the coefficients from their joint distribution, within what the law allows.

        The distribution is Gaussian with the covariance. Raises InputError if the likelihood is flat, or one draw in a
        thousand at most is one that the law allows.
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
                    if self.law.sticking is not None and not self.law.depends_on_speed:
                        ifr_law(whole, self.law.sticking)
                    found.append({name: whole[name] for name in self.law.ranges})
            if len(found) >= number:
                return found[:number]
        raise InputError(
            "no coefficients can be drawn: the fitted ones are too far outside the range of the law"
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
    """The law with the lowest AIC; of those within `TELLING` of it, the first in the given order."""
    decided: bool
    """True if all others are further off, or only one was fitted."""
    level: float = CONFIDENCE
    """Of confidence of the intervals."""
    robust: float | None = None
    """nu of a Student-t likelihood."""
    warnings: tuple[str, ...] = ()
    """Those of the data and of the choice between laws."""

    @validated
    def law(self, name: str | None = None) -> IFRLaw:
        """The fitted IFR law of this name, by default the best one.

        Raises InputError if it is another law, or can add energy in collisions of these disks.
        """
        chosen = self.best if name is None else choice("name", name, self.laws)
        return self.laws[chosen].ifr(self.smallest_k)

    @property
    def smallest_k(self) -> float:
        """The smaller k of the disks."""
        if isinstance(self.data, Collisions):
            return float(min(np.min(self.data.disk_1.k), np.min(self.data.disk_2.k)))
        assert self.pair is not None
        return min(self.pair.k_1, self.pair.k_2)


def is_dominated(distance: Array, robust: bool) -> bool:
    """True if one of the squared distances (n,) is nearly all chi2, and no Student-t likelihood limits its effect."""
    return not robust and len(distance) > 1 and bool(np.max(distance) > _DOMINANT * np.sum(distance) > 0.0)


def admissibility(
    law: Law, coefficients: Mapping[str, float], pairs: Sequence[tuple[float, float, float, float]]
) -> Admissibility:
    """The verdict on the energy of the worst of pairs of k_1, k_2, m_1, m_2."""
    assert law.sticking is not None
    own = {name: coefficients[name] for name in law.ranges if name != "A"}
    if law.depends_on_speed:
        own["e_n"] = 1.0  # of slow impacts: each condition is met the better the smaller e_n is
    try:  # the sets are largest for the smaller k: a law that is refused there is refused for all
        made = ifr_law(own, law.sticking, min(min(pair[:2]) for pair in pairs))
    except InputError as error:
        return Admissibility(False, False, str(error))
    return min((made.admissibility(*pair) for pair in pairs), key=lambda each: each[:2])


def law_warnings(fitted: Fitted, others: Sequence[tuple[Array, float]], *, robust: bool) -> list[str]:
    """Warnings for one law.

    `others` are coefficients (p,) and loss of solutions outside of the intervals, the best one first.
    """
    found = (_systematic(fitted) or _outliers(fitted, robust)) + _trends(fitted) + _poor_errors(fitted)
    if is_dominated(fitted.distance, robust):
        text = f"{100.0 * float(np.max(fitted.distance)) / fitted.chi2:.3g} % of chi2 is that of one impact"
        found.append(f"{text}: intervals are from the standard errors, and mean little")
    advice = _missing(fitted)
    if others:
        free, chi2 = others[0]
        values = ", ".join(
            f"{name} = {round(value, 9):.4g}" for name, value in zip(fitted.law.free, free, strict=True)
        )
        found.append(
            f"another solution, outside of these intervals, fits nearly as well: {values}, chi2 = {chi2:.4g}; impacts "
            "over a wider range of psi, or another quantity, would decide between them"
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
            larger = "" if advice else "; measure impacts at larger psi"
            found.append(f"no impact slides: mu is not determined {known}{larger}")
        elif mu.high_open:
            more = "" if advice else "; measure more sliding impacts"
            found.append(f"mu is not determined: the data set no upper end to it{more}")
        if sliding == len(fitted.psi):
            below = ""
            if transition is not None:
                high = transition.interval.high
                below = f", and the transition is only known to be below {high:.3g} degrees"
            text = "no impact sticks: the kind of sticking is not tested"
            found.append(f"{text}{below}; measure impacts at smaller psi")
    for name, whole in (("e_n", 1.0), ("e_t", 2.0), ("beta_0", 2.0)):
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
        found.append(f"{', '.join(fitted.flat)} are not determined: chi2 is flat along a combination of them")
    p = len(fitted.law.free)
    for i, j in zip(*np.triu_indices(p, 1), strict=True):
        if abs(fitted.correlation[i, j]) > _TIED:
            a, b = fitted.law.free[i], fitted.law.free[j]
            found.append(
                f"{a} and {b} are determined in combination rather than each by itself: their correlation is "
                f"{fitted.correlation[i, j]:.4f}"
            )
    found += advice
    for name in fitted.law.free:
        for end in fitted.law.ranges[name]:
            if abs(estimates[name].value - end) < 1e-6 * fitted.law.units.get(name, 1.0) and not (
                name == "rho" and end > 0.0
            ):
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
        found.append(f"chi2 is {of} (probability {of_probability(probability, 2)}): {text}")
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


def _missing(fitted: Fitted) -> list[str]:
    """Advice on what to measure, where coefficients are known in combination only."""
    free, tied = fitted.law.free, set(fitted.flat)
    errors = np.sqrt(np.diag(fitted.covariance))
    tied |= {name for name, error in zip(free, errors, strict=True) if not np.isfinite(error)}
    for i, j in zip(*np.triu_indices(len(free), 1), strict=True):
        if abs(fitted.correlation[i, j]) > _TIED:
            tied |= {free[i], free[j]}
    together = [name for name in free if name in tied]
    if len(together) < 2:
        return []
    # If some coefficient is not determined, fitted values are arbitrary: typical ones are taken.
    values = fitted.values if np.isfinite(errors).all() else fitted.law.start_points(2)[1]
    found = helpful(fitted.problem, fitted.law, values, together)
    if not found:
        return []
    names = [" and ".join(each) for each in found]
    be, it = ("is", "it") if len(found[0]) == 1 else ("are", "them")
    others = f" (or {' or '.join(names[1:])})" * (len(names) > 1)
    return [
        f"{names[0]} {be} not measured: {' and '.join(together)} cannot be separated; measure {it}{others}"
    ]


_CLEAR = 1e-3  # p-value below which a warning names a trend


def _trends(fitted: Fitted) -> list[str]:
    """Warnings of trends with speed, and of clusters of impacts."""
    if fitted.trends is None:
        return []
    found = []
    for each in fitted.trends.each:
        if each.probability < _CLEAR:
            name = f"{fitted.law.kind.name_in_cases or 'ifr'}-viscoelastic"
            model = option_name(f"--model {name}", f"model = ['{name}']")
            fits = f"; {model} fits e_n = 1 - A g_n^(1/5)" * (each.coefficient == "e_n" and each.change < 0.0)
            found.append(
                f"{each.coefficient} depends on {each.against}: it changes by {each.change:+.3g} +- {each.error:.2g} "
                f"from {each.low:.3g} to {each.high:.3g} (p {of_probability(each.probability, 1, '= ')}){fits}"
            )
    if fitted.trends.clusters is not None:
        clusters = fitted.trends.clusters
        each_one = ", ".join(f"{value:.3g} ({number} impacts)" for value, number in clusters)
        found.append(
            f"e_n of single impacts has {len(clusters)} clusters, {each_one}; if materials are mixed, name them in "
            "columns material_1 and material_2: each pair is then fitted separately"
        )
    return found


_NO_CHANCE = 1e-6  # p-value of residuals that errors of measurement do not have
_FEWEST = 20  # impacts, for residuals to show a course
_ROUNDING = 1e-9  # of the motion, below which residuals are


def _series(fitted: Fitted) -> Iterator[tuple[str, Array]]:
    """Residuals in the order of |psi|, (n,) each: of collisions along the normal and along the slip, whatever the frame."""
    problem, order = fitted.problem, np.argsort(np.abs(fitted.x[:, 0]), kind="stable")
    raw, size = fitted.residuals * problem.s, np.nan_to_num(np.abs(problem.y))
    if not isinstance(problem, CollisionProblem):
        yield from zip(problem.names, raw[order].T, strict=True)
        return
    side, columns = np.sign(fitted.x[:, 0]), dict(zip(problem.names, raw.T, strict=True))
    large = dict(zip(problem.names, np.max(size, axis=0), strict=True))
    phi = problem.y[:, 0]
    for name, one in columns.items():
        if name.startswith("vx"):
            other = columns["vy" + name[2:]]
            least = _ROUNDING * max(large[name], large["vy" + name[2:]])
            for what, along in (
                ("along the normal", (np.cos(phi), np.sin(phi))),
                ("along the slip", (-side * np.sin(phi), side * np.cos(phi))),
            ):
                each = along[0] * one + along[1] * other
                yield f"v{name[2:]} {what}", np.where(np.abs(each) > least, each, np.nan)[order]
        elif name.startswith("spin"):
            yield name, np.where(np.abs(one) > _ROUNDING * large[name], side * one, np.nan)[order]


def _systematic(fitted: Fitted) -> list[str]:
    """A warning if residuals follow the angle of incidence, as errors of measurement never do.

    Signs of neighbours in the order of psi are alike in half of the cases, whatever the distribution of errors, if
    these are independent and as often positive as negative. The largest excess of all quantities is tested.
    """
    from scipy.special import ndtr

    found = []
    for name, each in _series(fitted):
        sign = np.sign(each[np.isfinite(each) & (each != 0.0)])
        if len(sign) >= _FEWEST:
            alike = sign[1:] * sign[:-1]
            found.append((float(np.sum(alike) / np.sqrt(len(alike))), name, float(np.mean(alike > 0.0))))
    if not found:
        return []
    z, name, part = max(found)
    p = len(found) * float(ndtr(-z))
    if not p < _NO_CHANCE:
        return []
    exact = option_name(
        f"--error estimate --error {BEFORE}=0 --error {DIRECTION}=0",
        f"errors = {{{BEFORE!r}: 0, {DIRECTION!r}: 0}}",
    )
    text = (
        f"residuals of {name} follow psi: neighbours have one sign in {100.0 * part:.0f} % of cases (p = {p:.1g}): these are "
        "no errors of measurement, the law does not hold, and standard errors, intervals and suspicious lines mean nothing"
    )
    more = f"; of impacts computed by a program give {exact}" if fitted.errors else ""
    models = option_name("--model all", "model = ['all']")
    return [f"{text}; {models} compares laws{more}"]


_POOR = 0.5  # standard error of the logarithm of an error


def _poor_errors(fitted: Fitted) -> list[str]:
    """Warnings of estimated errors that the residuals hardly determine."""
    found = []
    for group, error in fitted.errors_of_errors.items():
        if error > _POOR:
            end = "compatible with 0" if np.isinf(error) else f"known to a factor of {np.exp(error):.2g}"
            how = option_name(f"--error {group}=VALUE", f"errors = {{'{group}': VALUE}}")
            found.append(
                f"the error of {group} is poorly known: the residuals leave it {end}; if you know it, give {how}"
            )
    return found


def _few(fitted: Fitted) -> bool:
    """True if single impacts are suspicious, rather than the law or the errors."""
    return 0 < len(fitted.suspects) <= max(0.25 * len(fitted.psi), 1.0)


def _outliers(fitted: Fitted, robust: bool) -> list[str]:
    """Suspicious lines, and their effect on the coefficients."""
    found = []
    named = [
        f"{each.where} ({each.quantity} {each.residual:+.1f} errors off, chi2 {each.distance:.4g}, "
        f"probability {of_probability(each.probability, 1)})"
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
        first, last = (
            f"without the suspicious line{s}",
            f"; {option_name('--robust', 'robust = True')} gives outliers little weight",
        )
        if robust:
            first, last = f"without {option_name('--robust', 'robust = True')}", ""
        found.append(f"{first}: {', '.join(changes)}{last}")
    return found


def _copies(data: Data | Collisions) -> list[str]:
    """A warning of lines that are equal in all values."""
    columns = [*data.measured.values(), *([data.psi] if isinstance(data, Data) else [])]
    rows = np.nan_to_num(np.stack(columns, axis=-1), nan=np.inf)
    alike: dict[bytes, list[int]] = {}
    for i, row in enumerate(rows):
        alike.setdefault((row + 0.0).tobytes(), []).append(i)
    several = [" and ".join(data.where(i) for i in each) for each in alike.values() if len(each) > 1]
    if not several:
        return []
    more = f" and {len(several) - _MOST_NAMED} more such" * (len(several) > _MOST_NAMED)
    text = "equal in every value: if they are copies, all standard errors are too small"
    return [f"{'; '.join(several[:_MOST_NAMED])}{more}: {text}"]


def general_warnings(data: Data | Collisions, laws: Mapping[str, Fitted]) -> list[str]:
    """Warnings of the data and of the choice between laws."""
    found = [*data.notes, *_copies(data)]
    angles = isinstance(data, Data)
    if "sqrt_d2_d1" in data.names:
        found.append(
            "sqrt_d2_d1 is taken as v_2 / v_1 (Eq. 29), which sliding and spinning on the table put off by up to 9 % "
            "for coins: its error should say so"
        )
    if isinstance(data, Data) and len(data) > 2 and np.max(data.psi) < 1.6:
        found.append(
            f"the largest psi is {np.max(data.psi):g} degrees: a column in radians is named psi (rad), "
            f"or {option_name('--unit psi=rad', 'units has psi: rad')}"
        )
    order = sorted(laws.values(), key=lambda each: each.AIC)
    if len(order) > 1 and (few := [each.law.name for each in order if np.isinf(each.AIC)]):
        needed = "AICc needs two values more than coefficients and errors"
        found.append(f"too few values to compare {', '.join(few)} with other laws: {needed}")
    elif len(order) > 1 and (difference := order[1].AIC - order[0].AIC) < TELLING:
        reason = ""
        if angles and len(data.names) == 1 and MEASURED[data.names[0]].unit == "deg":
            reason = (
                f"; {data.names[0]} alone hardly ever does, because both kinds give the same curves with other e_n and "
                "e_t: measure another quantity too"
            )
        a, b = order[0].law.name, order[1].law.name
        found.append(
            f"the data do not distinguish {a} from {b}: AIC differs by {difference:.2g}, and {TELLING:g} would "
            f"count{reason}"
        )
    return found
