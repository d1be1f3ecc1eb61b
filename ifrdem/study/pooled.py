"""The spread that errors of coefficients give to results of a study, apart from that of its seeds."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, counted
from ..tools.intervals import student_t
from .draws import COEFFICIENTS
from .results import (
    BY_COEFFICIENTS,
    HALF_INTERVAL,
    SEED,
    SERIES_FROM,
    START,
    WINDOWED,
    Results,
    half_interval,
    means_over_seeds,
)

DRAWS = "draws"
"""Attribute of pooled results: the number of drawn sets of coefficients."""


def is_drawn(results: Results) -> bool:
    """True if the results have drawn coefficients as an axis."""
    return COEFFICIENTS in results.axes


def is_pooled(results: Results) -> bool:
    """True of what `pooled` returns."""
    return DRAWS in results.attributes


def pooled(results: Results) -> Results:
    """Results without the axis of drawn coefficients: means over all draws and seeds, and two parts of their spread.

    NAME_error is the standard error over seeds of the mean over draws, which more seeds make smaller.
    NAME_by_coefficients is the standard deviation, by coefficients, of the mean over many seeds, which only a better
    experiment makes smaller. Draws with a missing run are left out. Of a single seed, NAME_by_coefficients holds the
    scatter between gases, too.

    Raises InputError if the results have no drawn coefficients.

    The parts are those of a two-way layout with draws and seeds, x = m + a_draw + b_seed + e, in which one seed starts
    all draws alike: var(a) = (MS_draws - MS_e) / S of its mean squares (H. Scheffe, The Analysis of Variance, Wiley
    1959, section 7.4).
    """
    if not is_drawn(results):
        raise InputError("the results have no drawn coefficients: `ifrdem study --coefficients N` draws some")
    axes = [*results.axes]
    draw = axes.index(COEFFICIENTS)
    quantities, means, found, spreads = {*results.quantities}, {}, {}, {}
    for name, one in results.variables.items():
        less = tuple(dim for dim in one.dims if dim != COEFFICIENTS)
        if name in quantities:
            of_seeds, spreads[name] = _two_way(np.moveaxis(one.values, (draw, len(axes)), (0, 1)))
            means[name] = one._replace(dims=less, values=np.moveaxis(of_seeds, 0, len(axes) - 1))
        elif COEFFICIENTS not in one.dims:
            found[name] = one
        elif name in (START, SERIES_FROM):
            found[name] = one._replace(dims=less, values=_known(np.nanmax, one.values, draw))
        elif name.endswith("_theory") or name == WINDOWED:
            found[name] = one._replace(dims=less, values=_known(np.nanmean, one.values, draw))
    found |= means_over_seeds(means, len(axes) - 1)
    for name, spread in spreads.items():
        found[f"{name}{BY_COEFFICIENTS}"] = found[f"{name}_mean"]._replace(values=spread)
    kept = {dim: names for dim, names in results.axes.items() if dim != COEFFICIENTS}
    keys = json.loads(results.attributes["keys"])
    changed = {
        "axes": json.dumps(kept),
        "keys": json.dumps({name: keys[name] for names in kept.values() for name in names}),
        DRAWS: str(len(results.values(COEFFICIENTS))),
    }
    return Results(found, results.attributes | changed)


def _known(
    of: Callable[..., NDArray[np.float64]], values: NDArray[np.float64], axis: int
) -> NDArray[np.float64]:
    """Mean or maximum along an axis, without what is nan; nan where all is."""
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        return of(values, axis=axis)


def _two_way(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means over draws (S, ...), and the standard deviation (...) by draws, of values (C, S, ...)."""
    S = values.shape[1]
    used: NDArray[np.bool_] = np.all(np.isfinite(values), axis=1)  # (C, ...)
    x, C = np.where(used[:, None], values, 0.0), used.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_seed, of_draw = x.sum(axis=0) / C, x.mean(axis=1)
        mean = of_seed.mean(axis=0)
        by_draw = np.where(used, of_draw - mean, 0.0)
        rest = np.where(used[:, None], x - of_draw[:, None] - of_seed + mean, 0.0)
        free = np.where(C > 1, C - 1.0, np.nan)
        squares = S * np.sum(by_draw**2, axis=0) / free
        squares_rest = np.sum(rest**2, axis=(0, 1)) / (free * (S - 1)) if S > 1 else 0.0
    return of_seed, np.sqrt(np.maximum(squares - squares_rest, 0.0) / S)


def half_of_both(results: Results, name: str) -> NDArray[np.float64] | None:
    """Half the 95 % interval of a prediction of pooled results, by seeds and coefficients; None of other results.

    Coefficients have Student's t of C draws, and the mean over draws is off by a further 1 / C of their variance.
    """
    spread, half = results.variables.get(f"{name}{BY_COEFFICIENTS}"), half_interval(results, name)
    if spread is None or half is None:
        return None
    C = int(results.attributes[DRAWS])
    own = float(student_t(np.array(C))) * math.sqrt(1.0 + 1.0 / C) * spread.values
    return np.asarray(np.hypot(np.nan_to_num(half), own))


def with_half_intervals(results: Results) -> Results:
    """Pooled results with half the 95 % interval of each prediction (`half_of_both`), NAME_half_interval."""
    halves = {
        f"{name}{HALF_INTERVAL}": results.variables[f"{name}_mean"]._replace(values=half)
        for name in results.quantities
        if (half := half_of_both(results, name)) is not None
    }
    return Results(results.variables | halves, results.attributes)


def parts_of_interval(results: Results) -> str:
    """Clause on what the two parts of an interval of pooled results are."""
    seeds = len(results.values(SEED))
    if seeds == 1:
        return f"the scatter of one gas for each of {results.attributes[DRAWS]} drawn sets of coefficients"
    return f"{counted(seeds, 'seed')}, and errors of coefficients ({results.attributes[DRAWS]} draws)"
