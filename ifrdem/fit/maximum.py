"""Maximum likelihood and profile likelihood, by SciPy's least squares from several starts."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares
from scipy.special import chdtrc, chdtri, fdtri  # chdtrc: tail of the chi-square distribution

from ..errors import InputError, counted, option_name, refuse
from ..tools.checked import Integer, NonNegative, Number, Positive, Seed, validated
from . import laws as of_laws
from .data import Collisions, Data
from .laws import IFR, Law, Range
from .likelihood import NU, Array, Likelihood, Points, covariance_of, inverse_of, unit_of
from .model import AngleProblem, CollisionProblem, FitProblem, Pair
from .result import (
    CONFIDENCE,
    TELLING,
    Estimate,
    Fit,
    Fitted,
    Interval,
    Suspect,
    admissibility,
    general_warnings,
    is_dominated,
    law_warnings,
)
from .trends import trends_of

Progress = Callable[[float], object]
Confidence = Annotated[float, Number(1e-6, 1.0 - 1e-6, "a number between 0 and 1, such as 0.95")]
Draws = Annotated[int, Integer(0, 10**7)]

SPINNING = ("Rw_1", "Rw_2", "e_t_apparent", "rebound_contact", "spin_1_after", "spin_2_after")
"""Quantities that depend on rolling friction."""

TRANSIT = "psi_transit"
_STARTS, _DESCENTS = 32, 6  # sampled points; the best of them, where searches start
_SAME_MINIMA = 2  # descents that end in the lowest minimum are enough
_MOST_MINIMA = 10  # times that a lower minimum is taken, at most, when the search for intervals finds one
_PRECISE = 3e-4  # of the distance of an end from the best value
_TOLERANCE = {"held": 1e-6, "robust": 1e-8, "plain": 1e-10}  # of descents; robust ones converge linearly
_BETTER = 1e-5  # a loss lower by this is another minimum
_SUSPICIOUS = 0.01  # probability, among all impacts, of one as far off
_LOWER = 1e-3  # decrease of the loss that begins the search for intervals anew; their ends are no better
_FOLDS, _ONE_BY_ONE = 10, 30  # of cross-validation; so many impacts are left out one by one
_RATIO = 1e3  # largest ratio of estimated errors, each over its first guess


@validated
def fit(
    data: Data | Collisions,
    *,
    M: NonNegative | None = None,
    k_1: Positive = 2.0,
    k_2: Positive = 2.0,
    R_1: Positive | None = None,
    R_2: Positive | None = None,
    model: Iterable[str] = IFR,
    own: Iterable[Law] = (),
    fix: Mapping[str, float] | None = None,
    rolling: bool = False,
    robust: bool = False,
    level: Confidence = CONFIDENCE,
    profile: bool = True,
    cross_validate: bool = False,
    bootstrap: Draws = 0,
    seed: Seed = 1,
    progress: Progress | None = None,
) -> Fit:
    """Fit the coefficients of laws to measured impacts.

    Raises InputError if an option is wrong, or the values are too few for the coefficients.

    Parameters
    ----------
    data : Data or Collisions
        A table of angles, or whole collisions.
    M, k_1, k_2, R_1, R_2 : float
        The disks of a table of angles, see `Pair`; M is needed there. `Collisions` have their own.
    model : iterable of str
        Names of `LAWS`, or "all".
    own : iterable of Law
        Further laws, see `own`.
    fix : mapping of str to float, optional
        Coefficients that are not fitted.
    rolling : bool
        Fit rolling friction rho of IFR laws too.
    robust : bool
        A Student-t likelihood, which outliers move little.
    level : float
        Of confidence of the intervals.
    profile : bool
        Intervals by profile likelihood; without it from the standard errors, in a tenth of the time.
    cross_validate : bool
        Predict each impact, of more than 30 each tenth of them, from the others.
    bootstrap : int
        Number of synthetic data sets of a parametric bootstrap; 0 for none.
    seed : int
        Of the bootstrap.
    progress : callable, optional
        Called after each step with the estimated part that is done, from 0 to 1.

    Examples
    --------
    >>> from ifrdem import fit
    >>> data = fit.read("data.csv", {"angles": 0.7})  # of `ifrdem fit --example > data.csv`
    >>> found = fit.fit(data, M=1.0)
    >>> found.best
    'ifr-percussion'
    """
    fixed, model = dict(fix or {}), list(model)
    chosen = of_laws.chosen(model, fixed, own)
    pair: Pair | None = None
    problems = []
    if isinstance(data, Data):
        if M is None:
            raise InputError("M: must be given, the mass ratio m_1 / m_2 of the disks, 0 for a wall")
        pair = Pair(M=M, k_1=k_1, k_2=k_2, R_1=R_1, R_2=R_2)
        problem: FitProblem = data.problem(pair)
        by_speed = [name for name, law in chosen.items() if law.depends_on_speed]
        problems += [
            f"model {name}: requires speeds, as in a table of whole collisions"
            for name in by_speed
            if name in model
        ]
        chosen = {name: law for name, law in chosen.items() if name not in by_speed}
        if (rolling or fixed.get("rho", 0.0) > 0.0) and not pair.has_radii:
            problems.append("rolling friction requires R_1 and R_2, the radii")
    else:
        problem = data.problem()
    if rolling:
        if not set(SPINNING) & set(data.names):
            text = f"rolling friction changes spins only: rho requires a column {' or '.join(SPINNING)}"
            problems.append(f"{data.source}: {text}; there are {', '.join(data.names)}")
        r = float(np.max(of_laws.reach(problem.probe())))
        chosen = {name: _rolling(law, r) if "rho" in law.ranges else law for name, law in chosen.items()}
    if isinstance(problem, CollisionProblem):
        unit = problem.speed**-0.2
        chosen = {n: law.measured_in("A", unit) if law.depends_on_speed else law for n, law in chosen.items()}
    if bootstrap != 0 and bootstrap < 40:
        problems.append(f"bootstrap = {bootstrap}: must be 0, or 40 or more for intervals")
    refuse(problems)
    nu = NU if robust else None
    found = {}
    for i, (name, law) in enumerate(chosen.items()):
        expected = _expected_descents(law, bootstrap, profile=profile)

        def step(done: int, i: int = i, expected: int = expected) -> None:
            if progress is not None:
                progress((i + min(done / expected, 1.0)) / len(chosen))

        climb = _LawFit(data, problem, law, nu, level, profile, step)
        found[name] = climb.fitted(bootstrap, seed, cross_validate)
    lowest = min(each.AIC for each in found.values())
    near = [name for name, each in found.items() if lowest + TELLING >= each.AIC]
    best = near[0]
    return Fit(data, pair, found, best, len(near) == 1, level, nu, tuple(general_warnings(data, found)))


def _expected_descents(law: Law, bootstrap: int, *, profile: bool) -> int:
    """Approximate number of descents of the fit of a law, for its progress."""
    return 10 + (10 * (len(law.free) + 1) if profile else 0) + 3 * bootstrap


def _rolling(law: Law, r: float) -> Law:
    fixed = {name: value for name, value in law.fixed.items() if name != "rho"}
    ranges, start_ranges = {**law.ranges, "rho": (0.0, 1.0)}, {**law.start_ranges, "rho": (0.0, 0.1)}
    return replace(law, fixed=fixed, ranges=ranges, start_ranges=start_ranges).measured_in("rho", r)


class _LowerMinimumError(Exception):
    """A descent has ended below the least loss that was expected."""


class Search:
    """Descents of the loss of one likelihood, with a coefficient or the angle of transition held if wished."""

    def __init__(self, likelihood: Likelihood, on_descent: Callable[[], object] | None = None) -> None:
        self.likelihood: Likelihood = likelihood
        self.on_descent: Callable[[], object] | None = on_descent
        self.law: Law = likelihood.law
        self.lowest: tuple[Array, float] | None = None
        self.least: float = -np.inf
        self._last: tuple[bytes, Points] | None = None

    def points(self, values: Array) -> Points:
        """Nearest points of coefficients (p,)."""
        key = values.tobytes()  # SciPy requests residuals and derivatives at one point one after the other
        if self._last is None or self._last[0] != key:
            self._last = key, self.likelihood.at(values)
        return self._last[1]

    @property
    def transits(self) -> bool:
        """True if all impacts have one angle of transition, which then is a quantity."""
        law, problem = self.law, self.likelihood.problem
        if not law.has_transition or law.depends_on_speed or "mu" not in law.free:
            return False
        c = law.stick(law.start_points(2)[1], problem.probe())
        return float(np.ptp(c)) <= 1e-9 * float(np.max(c))

    def transition(self, values: Array) -> float:
        """Angle of incidence [rad] at which sliding begins."""
        return float(self.law.transitions(values, self.likelihood.problem.probe())[0].flat[0])

    def quantities(self, values: Array) -> dict[str, tuple[float, float, Range]]:
        """Value, standard error and limits of the free coefficients, and of the angle of transition if it is one."""
        law = self.law
        covariance = covariance_at(self.points(values))[0]
        each = zip(law.free, values.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True)
        found = {name: (value, error, law.ranges[name]) for name, value, error in each}
        if self.transits:
            at, steepest = self.transition(values), values.copy()
            steepest[law.free.index("mu")] = law.ranges["mu"][1]
            error = float(np.sqrt(_variance(covariance, self._transition_slope(values))))
            found[TRANSIT] = at, error, (0.0, self.transition(steepest))
        return found

    def _transition_slope(self, values: Array) -> Array:
        at, steps = self.transition(values), 1e-6 * self.law.sizes
        return np.array([(self.transition(values + step) - at) / np.sum(step) for step in np.diag(steps)])

    def variance_ratios(self, values: Array) -> dict[str, float]:
        """Factor of the rise of the loss at the ends of the interval of each quantity.

        Each is the variance over the one that the curvature alone would give: 1 for a Gaussian likelihood (J. T. Kent,
        Biometrika 69, 19 (1982)).
        """
        covariance, plain = covariance_at(self.points(values))
        directions = dict(zip(self.law.free, np.eye(len(values)), strict=True))
        if self.transits:
            directions[TRANSIT] = self._transition_slope(values)
        found = {}
        for name, by in directions.items():
            alone = _variance(plain, by)
            ratio = _variance(covariance, by) / max(alone, 1e-300) if np.isfinite(alone) else 1.0
            found[name] = ratio if ratio > 0.0 else 1.0
        return found

    def _mu(self, values: Array, transition: float) -> float:
        """The mu that puts the transition at this angle."""
        c = float(np.ravel(self.law.stick(values, self.likelihood.problem.probe()))[0])
        return float(c * np.tan(transition) / (1.0 + self.law.full(values)["e_n"][0]))

    def descend(self, start: Array, held: Mapping[str, float] | None = None) -> tuple[Array, float]:
        """Coefficients and value of the least loss, from a start (p,), with quantities held."""
        law, held = self.law, dict(held or {})
        kind = "held" if held else "robust" if self.likelihood.robust is not None else "plain"
        tolerance = _TOLERANCE[kind]
        names = list(law.free)
        by_transit = held.pop(TRANSIT, None)
        taken = {*held, *(["mu"] if by_transit is not None else [])}
        moving = [i for i, name in enumerate(names) if name not in taken]
        base = start.copy()
        for name, value in held.items():
            base[names.index(name)] = value
        mu = names.index("mu") if by_transit is not None else -1

        def whole(free: Array) -> Array:
            values = base.copy()
            values[moving] = free
            if by_transit is not None:
                values[mu] = self._mu(values, by_transit)
            return values

        def jacobian(free: Array) -> Array:
            J = self.points(whole(free)).as_least_squares()[1]
            found = J[:, moving]
            if by_transit is not None:
                steps, here = np.diag(1e-6 * law.sizes[moving]), whole(free)[mu]
                by = np.array([(whole(free + step)[mu] - here) / np.sum(step) for step in steps])
                found = found + J[:, [mu]] * by
            return found

        if moving:
            low, high = law.low[moving], law.high[moving]
            begin = np.clip(start[moving], low, high)
            ended = least_squares(
                lambda free: self.points(whole(free)).as_least_squares()[0], begin, jacobian,
                bounds=(low, np.where(high > low, high, low + 1.0)), method="dogbox", x_scale="jac",
                ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=60,
            )  # fmt: skip
            values = whole(ended.x)
        else:
            values = whole(np.empty(0))
        loss = self.points(values).loss
        if self.on_descent is not None:
            self.on_descent()
        if self.lowest is None or loss < self.lowest[1] - _BETTER:
            self.lowest = (values, loss)
        if loss < self.least:
            raise _LowerMinimumError
        return values, loss

    def best(self, start: Array | None = None) -> tuple[Array, float]:
        """The lowest minimum that several starts lead to, and its loss."""
        points = self.law.start_points(_STARTS)
        order = np.argsort([self.likelihood.rough(each) for each in points])
        starts = [points[i] for i in order[:_DESCENTS]] + ([] if start is None else [start])
        self.ends: list[tuple[Array, float]] = []
        for each in starts:
            self.ends.append(self.descend(each))
            lowest = min(loss for _, loss in self.ends)
            if sum(loss - lowest < _BETTER for _, loss in self.ends) == _SAME_MINIMA:
                break
        nearby = self.near(self._lowest(self.ends)[0])[1:]
        if "mu" in self.law.free:  # without friction data below the transition look alike with another e_t
            smooth = points[:: _STARTS // 8].copy()
            smooth[:, self.law.free.index("mu")] = 0.0
            nearby.append(min(smooth, key=self.likelihood.rough))
        self.ends += [self.descend(each) for each in nearby]
        return self._lowest(self.ends)

    @staticmethod
    def _lowest(ends: Iterable[tuple[Array, float]]) -> tuple[Array, float]:
        """The lowest of minima; the first of those that are equally low."""
        ends = list(ends)
        least = min(loss for _, loss in ends)
        return next(each for each in ends if each[1] - least < _BETTER)

    def near(self, best: Array) -> list[Array]:
        """The best values, and with less and more friction: every impact that changes sides can make a minimum."""
        if "mu" not in self.law.free:
            return [best]
        by = np.array([float(name == "mu") for name in self.law.free])
        return [best, best * (1.0 - 0.3 * by), best * (1.0 + 0.4 * by)]

    def others(self, loss: float, ends: Mapping[str, Interval], rise: float) -> list[tuple[Array, float]]:
        """Minima outside of the intervals that are lower than their ends, the best one first."""
        free = self.law.free
        found = []
        for values, other in sorted(self.ends, key=lambda each: each[1]):
            spans = (
                (ends[name], value, 1e-3 * (1e-3 * size + abs(value)))
                for name, value, size in zip(free, values, self.law.sizes, strict=True)
            )
            out = any(not end.low - room <= value <= end.high + room for end, value, room in spans)
            if out and other - loss < rise:
                found.append((values, other))
        return found


@dataclass
class _LawFit:
    """The fit of one law, step by step."""

    data: Data | Collisions
    problem: FitProblem
    law: Law
    robust: float | None
    level: float
    profile: bool
    progress: Callable[[int], None]
    """Gets the number of descents that are done."""
    descents: int = 0

    def _descended(self) -> None:
        self.descents += 1
        self.progress(self.descents)

    def fitted(self, bootstrap: int, seed: int, cross_validate: bool) -> Fitted:
        """The fit with its intervals."""
        problem, search, errors_of_errors = self._search()
        rise = rise_of(search, self.level, estimated=bool(self.problem.estimated))
        assert search.lowest is not None
        for left in reversed(
            range(_MOST_MINIMA)
        ):  # until no lower minimum shows while its surroundings are searched
            best, loss = min(search.lowest, search.descend(search.lowest[0]), key=lambda each: each[1])
            search.least = loss - _LOWER if left else -np.inf
            # One impact tens of errors off makes a loss with many minima, whose profile takes long and means nothing.
            profile = self.profile and not is_dominated(search.points(best).distance, self.robust is not None)
            with contextlib.suppress(_LowerMinimumError):
                ends = intervals(search, best, rise, profile=profile)
                break
            search.least = -np.inf
        points, quantities = search.points(best), search.quantities(best)
        p, dof = len(best), int(np.sum(problem.redundancy)) - len(best)
        again = self._bootstrap(problem, best, points, bootstrap, seed) if bootstrap else {}
        estimates = {}
        for name, (value, error, _) in quantities.items():
            unit: Callable[[float], float] = (lambda x: float(np.degrees(x))) if name == TRANSIT else float
            end = ends[name]
            estimates[name] = Estimate(
                value=unit(value),
                standard_error=unit(error),
                interval=Interval(unit(end.low), unit(end.high), end.low_open, end.high_open),
                bootstrap=Interval(unit(again[name][0]), unit(again[name][1])) if again else None,
            )
        loss, chi2 = points.loss, float(np.sum(points.distance))
        given = not self.problem.estimated
        minus_2_ln_L = loss + float(np.sum(self._normalisation(problem, points)))
        penalty = self._penalty(problem, points)
        q = p + len(self.problem.estimated)
        suspects = self._suspects(problem, points)
        verdict = None
        if self.law.sticking is not None:
            values = {name: value for name, (value, *_) in quantities.items()}
            verdict = admissibility(self.law, {**self.law.fixed, **values}, self._pairs())
        found = Fitted(
            law=self.law,
            estimates=estimates,
            covariance=covariance_at(points)[0],
            flat=_flat(points.information, self.law.free),
            chi2=chi2,
            dof=dof,
            probability=float(chdtrc(dof, chi2)) if given else float("nan"),
            log_likelihood=-0.5 * minus_2_ln_L,
            AIC=minus_2_ln_L + penalty,
            BIC=minus_2_ln_L + q * float(np.log(len(problem.rows))),
            cross_validation=self._cross_validated(problem, best) if cross_validate else float("nan"),
            x=points.x,
            psi=np.degrees(points.x[:, 0]),
            regimes=problem.regimes(self.law, best, points.x),
            residuals=np.nan_to_num((problem.y - problem.predict(self.law, best, points.x)) / problem.s),
            distance=points.distance,
            weight=points.weight,
            problem=problem,
            errors={} if given else _group_errors(problem, self.problem.estimated),
            errors_of_errors=errors_of_errors,
            suspects=suspects,
            without=self._without(problem, best, suspects),
            admissibility=verdict,
            trends=trends_of(points, problem, self.law, best)
            if isinstance(problem, CollisionProblem)
            else None,
        )
        others = search.others(loss, ends, rise)
        return replace(found, warnings=tuple(law_warnings(found, others, robust=self.robust is not None)))

    def _search(self) -> tuple[FitProblem, Search, dict[str, float]]:
        """The problem, with errors estimated from its residuals, and a search that has found the minimum.

        Also the standard error of each estimated error, over it; infinite for one at the least that is tried.
        """
        problem, start, groups = self.problem, None, self.problem.estimated
        total = np.ones(len(groups))
        for step in range(60):
            search = Search(Likelihood(problem, self.law, self.robust), self._descended)
            p = len(self.law.free)
            redundancy = int(np.sum(problem.redundancy))
            if redundancy <= p + len(groups):
                q = len(groups)
                needed = f"must be more than {p + q} for {counted(p, 'coefficient')}"
                errors = f" and {counted(q, 'error')}" * bool(q)
                empty = [
                    name for name, y in zip(problem.names, problem.y.T, strict=True) if np.isnan(y).all()
                ]
                why = f"; columns without a value: {', '.join(empty)}" * bool(empty)
                raise InputError(
                    f"{self.data.source}: {counted(redundancy, 'value')} measured after the impact: "
                    f"{needed}{errors}{why}"
                )
            best, _ = search.best() if start is None else search.descend(start)
            if not groups:
                return problem, search, {}
            scoring = _Scoring(problem, search.points(best))
            if start is None and (unknown := scoring.undetermined):
                raise InputError(
                    f"{self.data.source}: the residuals do not determine the error of {unknown}: give it, e.g. "
                    f"{_error_of(unknown)}"
                )
            factors, least = scoring.factors(total)
            # Where a point changes its regime the likelihood has a ridge, over which full steps go to and fro.
            factors = factors ** (0.8 ** max(step - 12, 0))
            if np.all(np.abs(factors - 1.0) < 1e-3):
                search.best(best)
                known = np.where(least, np.inf, scoring.errors)
                return problem, search, dict(zip(groups, known.tolist(), strict=True))
            problem, start = problem.scaled(dict(zip(groups, factors.tolist(), strict=True))), best
            total = total * factors
            if np.max(total) < 1e-6:
                break
        one = "positions" if "x_1" in self.data.names else groups[0]
        raise InputError(
            f"{self.data.source}: the residuals do not determine the errors of {' and '.join(groups)}: give one of "
            f"them, e.g. {_error_of(one)}"
        )

    def _penalty(self, problem: FitProblem, points: Points) -> float:
        """Expected excess of -2 ln L of other impacts: AIC less -2 ln L. Infinite for too few values."""
        R, q = int(np.sum(problem.redundancy)), len(self.law.free) + len(self.problem.estimated)
        found = points.optimism + 2.0 * len(self.problem.estimated)
        if self.robust is not None or not self.problem.estimated:
            return found
        # C. M. Hurvich, C.-L. Tsai, Biometrika 76, 297 (1989), doi:10.1093/biomet/76.2.297
        return found + 2.0 * q * (q + 1) / (R - q - 1) if q + 1 < R else float("inf")

    def _normalisation(self, problem: FitProblem, points: Points) -> Array:
        """The constant of -2 ln L of each impact, (n,); where errors are estimated, integrated over true motions."""
        # Of a value that is known exactly nothing but its error, which is set, would count.
        left_out = np.isnan(problem.y) | (problem.known if not self.problem.estimated else False)
        size = np.log(2.0 * np.pi * np.where(left_out, 1.0, problem.s) ** 2)
        constant = np.sum(np.where(left_out, 0.0, size), axis=1)
        return np.asarray(constant + points.log_volumes if self.problem.estimated else constant)

    def _pairs(self) -> list[tuple[float, float, float, float]]:
        """k_1, k_2, m_1, m_2 of every kind of pair."""
        if isinstance(self.problem, AngleProblem):
            pair = self.problem.pair
            return [(pair.k_1, pair.k_2, pair.M, 1.0) if pair.M > 0.0 else (pair.k_1, pair.k_1, 1.0, np.inf)]
        assert isinstance(self.data, Collisions)
        one, two = self.data.disk_1, self.data.disk_2
        columns = (np.ravel(each).tolist() for each in (one.k, two.k, one.mass, two.mass))
        return list(dict.fromkeys(zip(*columns, strict=True)))

    def _suspects(self, problem: FitProblem, points: Points) -> tuple[Suspect, ...]:
        probability = chdtrc(np.maximum(problem.redundancy, 1), points.distance)
        found = []
        for i in np.argsort(probability, kind="stable"):
            if probability[i] < _SUSPICIOUS / len(probability):
                own = points.residual[i]
                at = int(np.argmax(np.abs(own)))
                numbers = float(points.distance[i]), float(probability[i])
                found.append(
                    Suspect(int(i), self.data.where(int(i)), *numbers, problem.names[at], float(own[at]))
                )
        return tuple(found)

    def _without(self, problem: FitProblem, best: Array, suspects: tuple[Suspect, ...]) -> dict[str, float]:
        """Coefficients of the Gaussian fit for a robust one, or of the fit without suspects for a Gaussian one."""
        if self.robust is None:
            if not suspects:
                return {}
            kept = np.setdiff1d(problem.rows, [each.index for each in suspects])
            if len(kept) * 2 < len(problem.rows):
                return {}
            problem = problem.take(kept)
        likelihood = Likelihood(problem, self.law)
        if np.sum(problem.redundancy) <= len(best):
            return {}
        values = _lower(Search(likelihood), best)
        return dict(zip(self.law.free, map(float, values), strict=True))

    def _cross_validated(self, problem: FitProblem, best: Array) -> float:
        """Mean of -2 ln L of impacts that the fit leaves out: one by one, or tenths of many."""
        n = len(problem.rows)
        folds = n if n <= _ONE_BY_ONE else _FOLDS
        # Drawn from the impacts in an order of their own, so that the order of the table does not matter.
        order = np.lexsort(np.nan_to_num(problem.y, nan=np.inf).T)
        fold = np.empty(n, dtype=np.int64)
        fold[order] = np.random.default_rng(1).permutation(n) % folds
        total = 0.0
        for each in range(folds):
            training, held_out = problem.rows[fold != each], problem.rows[fold == each]
            values, _ = Search(Likelihood(problem.take(training), self.law, self.robust)).descend(best)
            tested = problem.take(held_out)
            points = Likelihood(tested, self.law, self.robust).at(values)
            # Errors differ from law to law: larger ones must not look like success.
            total += points.loss + float(np.sum(self._normalisation(tested, points)))
        return total / n

    def _bootstrap(
        self,
        problem: FitProblem,
        best: Array,
        points: Points,
        number: int,
        seed: int,
    ) -> dict[str, Array]:
        """Percentiles (2,) of each quantity over synthetic data sets."""
        rng = np.random.default_rng(seed)
        exact = problem.predict(self.law, best, points.x)
        spread = np.linalg.pinv(problem.white)
        found = []
        for _ in range(number):
            noise = np.einsum("nab,nb->na", spread, rng.standard_normal(exact.shape))
            other = Search(Likelihood(problem.of(exact + noise), self.law, self.robust), self._descended)
            values = _lower(other, best)
            found.append([*values, *([other.transition(values)] if other.transits else [])])
        tail = 0.5 * (1.0 - self.level)
        names = (*self.law.free, TRANSIT)
        return dict(zip(names, np.quantile(found, [tail, 1.0 - tail], axis=0).T, strict=False))


def _lower(search: Search, best: Array) -> Array:
    """The lowest minimum (p,) near the best values of other data."""
    return min((search.descend(start) for start in search.near(best)), key=lambda each: each[1])[0]


def rise_of(search: Search, level: float, *, estimated: bool = False) -> float:
    """Rise of the loss at the ends of an interval of confidence `level`, without `Search.variance_ratios`.

    Of chi-square; of F where the errors, or the scatter of a robust likelihood, are estimated from the residuals.
    """
    problem, p = search.likelihood.problem, len(search.law.free)
    if search.likelihood.robust is not None:
        return float(fdtri(1, max(len(problem.rows) - p, 1), level))
    if not estimated:
        return float(chdtri(1, 1.0 - level))
    return float(fdtri(1, max(np.sum(problem.redundancy) - p, 1.0), level))


def intervals(search: Search, best: Array, rise: float, *, profile: bool = True) -> dict[str, Interval]:
    """Profile-likelihood intervals of every quantity: where the least loss with it held has risen by `rise`.

    Without `profile`, from the standard errors.
    """
    found = {}
    variance_ratios = search.variance_ratios(best)
    for name, (value, error, limits) in search.quantities(best).items():
        if profile:
            width = np.sqrt(rise) * error
            rises = rise * variance_ratios[name]
            ends = [_end(search, best, name, value, width, limit, rises) for limit in limits]
        else:
            half = np.sqrt(rise) * error
            low, high = max(value - half, limits[0]), min(value + half, limits[1])
            ends = [(low, value - half <= limits[0]), (high, value + half >= limits[1])]
        (low, low_open), (high, high_open) = ends
        found[name] = Interval(low, high, bool(low_open), bool(high_open))
    return found


def _end(
    search: Search, best: Array, name: str, value: float, width: float, limit: float, rise: float
) -> tuple[float, bool]:
    """One end of an interval, and whether it is the limit, up to which the loss does not rise enough.

    `width` is the distance that follows from the standard error.
    """
    loss = search.points(best).loss
    z = float(np.sqrt(rise))
    room = abs(limit - value)
    sign = 1.0 if limit > value else -1.0
    if room < 1e-9 * search.law.units.get(name, 1.0):
        return limit, True
    # By distance: root of the rise less z, and coefficients.
    evaluated: dict[float, tuple[float, Array]] = {0.0: (-z, best)}

    def rest(distance: float) -> float:
        if distance not in evaluated:
            nearest = min(evaluated, key=lambda each: abs(each - distance))
            start = evaluated[nearest][1]
            if nearest:  # on along the way from the best values
                start = best + (start - best) * distance / nearest
            values, least = search.descend(start, {name: value + sign * distance})
            over = float(np.sqrt(max(least - loss, 0.0))) - z
            evaluated[distance] = over if abs(over) > _PRECISE * z else 0.0, values
        return evaluated[distance][0]

    if not (np.isfinite(width) and width > 0.0):
        width = 0.1 * (room if np.isfinite(room) else 1.0)
    inside, outside = 0.0, min(width, room)
    for _ in range(60):
        over = rest(outside)
        if over >= 0.0:
            break
        inside = outside
        if outside >= room:
            return limit, True
        outside = min(1.5 * outside, room)
    else:
        return limit, True
    found = brentq(rest, inside, outside, xtol=_PRECISE * outside, rtol=1e-10)
    return value + sign * float(found), False


def covariance_at(points: Points) -> tuple[Array, Array]:
    """Covariance (p, p) of the coefficients at the minimum, and the one that the curvature alone would give.

    They differ for a robust likelihood, see `Points.scatter`.
    """
    bread = points.bread
    return covariance_of(bread, points.scatter), covariance_of(bread)


def _variance(covariance: Array, by: Array) -> float:
    """Variance of a quantity with derivatives `by` (p,) by the coefficients; infinite if it depends on one without error."""
    some = by != 0.0
    block = covariance[np.ix_(some, some)]
    return float(by[some] @ block @ by[some]) if np.isfinite(block).all() else float("inf")


def _flat(information: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the coefficients along combinations of which the loss does not change, if there are any."""
    unit = unit_of(information)
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    parts = np.linalg.norm(vectors[:, values <= 1e-10 * values[-1]], axis=1)
    return tuple(name for name, part in zip(names, parts, strict=True) if part > 0.05)


class _Scoring:
    """Fisher scoring of the errors of groups of quantities, by the likelihood integrated over true motions.

    The likelihood is that of what the fit leaves of the residuals, Q r with the projection Q of each impact, whose
    trace over the values of a group is its redundancy. Its derivative by the variance of a group is (redundancy -
    weighted squares), its expected second derivative the sum of Q_ab^2 over the values a and b of two groups, and of a
    Student-t likelihood (nu + m) / (nu + m + 2) of that less the product of redundancies over nu + m + 2 (K. L. Lange
    et al., J. Am. Stat. Assoc. 84, 881 (1989), doi:10.2307/2290063).
    """

    def __init__(self, problem: FitProblem, points: Points) -> None:
        A, J, w = points.slope, points.jacobian, points.weight
        q = points.residual.shape[1]
        present = np.any(A != 0.0, axis=2) | np.any(J != 0.0, axis=2) | (points.residual != 0.0)
        length = np.sqrt(np.sum(A**2, axis=1, keepdims=True))
        A = A / np.where(length > 0.0, length, 1.0)  # whatever the units of latent coordinates
        Q = np.eye(q) - A @ np.linalg.pinv(A, rcond=1e-9)
        if np.isfinite(
            points.information
        ).all():  # the same for every inverse where a combination is not determined
            Q = Q - w[:, None, None] * np.einsum("nqa,ab,nrb->nqr", J, inverse_of(points.information), J)
        Q = np.where(present[:, :, None] & present[:, None, :], Q, 0.0)
        self.groups: tuple[str, ...] = problem.estimated
        of_group = np.array([[one == group for one in problem.groups] for group in self.groups])
        member = (of_group & problem.unknown[:, None, :]).astype(np.float64)  # (n, g, q)
        redundancy = np.einsum("ngq,nqq->ng", member, Q)
        self.redundancy: Array = np.sum(redundancy, axis=0)
        self.squares: Array = np.einsum("ngq,n,nq->g", member, w, points.residual**2)
        each = np.einsum("ngq,nqr,nhr->ngh", member, Q**2, member)
        if points.robust is not None:
            m = (points.robust + points.redundancy + 2.0)[:, None, None]
            each = (m - 2.0) / m * each - redundancy[:, :, None] * redundancy[:, None, :] / m
        self.information: Array = np.sum(each, axis=0)

    @property
    def undetermined(self) -> str:
        """The first group whose values are all taken by the true motions; "" if there is none."""
        return next((g for g, each in zip(self.groups, self.redundancy, strict=True) if each < 0.5), "")

    @property
    def errors(self) -> Array:
        """Standard errors (g,) of the logarithms of the errors."""
        return np.sqrt(0.5 * np.diag(covariance_of(self.information)))

    def factors(self, total: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Factors (g,) of the errors, which are `total` times their first guesses, and which end at the least ratio."""
        wanted = self.squares - self.redundancy
        least = np.zeros(len(total), dtype=bool)
        while True:
            free = np.flatnonzero(~least)
            step = np.linalg.lstsq(self.information[np.ix_(free, free)], wanted[free], rcond=1e-12)[0]
            factors = np.ones(len(total))
            factors[free] = np.sqrt(np.clip(1.0 + step, 0.01, 100.0))
            floor = np.max((total * factors)[free]) / _RATIO
            below = ~least & (total * factors <= floor * (1.0 + 1e-6))
            factors[least | below] = (floor / total)[least | below]
            if not below.any():
                return factors, least
            least |= below


def _group_errors(problem: FitProblem, groups: tuple[str, ...]) -> dict[str, float]:
    of = {}
    for group in groups:
        members = [i for i, each in enumerate(problem.groups) if each == group]
        values = np.where(problem.unknown[:, members], problem.s[:, members], np.nan)
        of[group] = float(np.nanmedian(values))
    return of


def _error_of(group: str) -> str:
    """The option, or the argument in Python, that sets the standard error of a group of quantities."""
    return option_name(f"--error {group}=VALUE", f"errors = {{'{group}': VALUE}}")
