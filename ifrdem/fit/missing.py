"""Unmeasured quantities that would determine coefficients that the data do not."""

from __future__ import annotations

import copy
from collections.abc import Collection, Sequence

import numpy as np

from .laws import Law
from .likelihood import Array, Likelihood, covariance_of
from .model import MEASURED, AngleProblem, CollisionProblem, FitProblem, whitening

_HELPS = 0.5  # least reduction of a standard error by a quantity, as a part of it


def helpful(
    problem: FitProblem, law: Law, values: Array, coefficients: Collection[str]
) -> list[tuple[str, ...]]:
    """Unmeasured quantities, each of which would determine these coefficients; if none does alone, all spins together.

    Each is tried by the expected information: it is added to every impact as the law gives it at the measured motion
    before, with the error of its kind.
    """
    which = [law.free.index(name) for name in coefficients]
    now = _errors(problem, law, values)[which]
    single = [(name,) for name in _not_measured(problem)]
    spins = tuple(name for (name,) in single if name.startswith("spin"))
    for candidates in (single, [spins] if len(spins) > 1 else []):
        found = []
        for names in candidates:
            then = _errors(_with(problem, law, values, names), law, values)[which]
            if np.all(np.isfinite(then)) and np.all(then < (1.0 - _HELPS) * now):
                found.append(names)
        if found:
            return found
    return []


def _not_measured(problem: FitProblem) -> list[str]:
    if isinstance(problem, AngleProblem):
        of_a_wall = {"delta_2", "Rw_2", "sqrt_d2_d1"} if problem.pair.M == 0.0 else set()
        return [name for name in MEASURED if name not in (*problem.names, *of_a_wall)]
    return [name for name, column in zip(problem.names, problem.y.T, strict=True) if np.isnan(column).all()]


def _errors(problem: FitProblem, law: Law, values: Array) -> Array:
    return np.sqrt(np.diag(covariance_of(Likelihood(problem, law).at(values).information)))


def _with(problem: FitProblem, law: Law, values: Array, names: Sequence[str]) -> FitProblem:
    """The impacts with further quantities, as predicted."""
    x = problem.start
    if isinstance(problem, AngleProblem):
        every = (*problem.names, *names)
        degrees = float(np.nanmedian(problem.s[:, 0]))
        sizes = [degrees if MEASURED[name].unit == "deg" else float(np.radians(degrees)) for name in names]
        s = np.column_stack([problem.s, np.tile(sizes, (len(problem.y), 1))])
        groups = [*problem.groups, *names]
        blank = AngleProblem(every, np.zeros_like(s), s.copy(), groups, problem.pair)
        y = np.column_stack([problem.y, blank.predict(law, values, x)[:, len(problem.names) :]])
        return AngleProblem(every, y, s, groups, problem.pair)
    assert isinstance(problem, CollisionProblem)
    other, exact = copy.copy(problem), problem.predict(law, values, x)
    other.y, other.s = problem.y.copy(), problem.s.copy()
    for name in names:
        i = problem.names.index(name)
        alike = problem.s[:, [k for k, group in enumerate(problem.groups) if group == problem.groups[i]]]
        size = (
            float(np.nanmedian(alike)) if np.isfinite(alike).any() else problem.first_guess(problem.groups[i])
        )
        other.y[:, i], other.s[:, i] = exact[:, i], size
    other.white = whitening(other.s, {}, other.names)
    other.begin()
    return other
