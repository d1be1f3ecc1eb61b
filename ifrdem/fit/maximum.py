"""The inverse problem: the law's coefficients from measured impacts of one disk on another at rest.

    data = fit.read("data.csv", {"angles": 0.7})
    found = fit.fit(data, M=1.0)
    print(fit.table(found))

Maximum likelihood with Gaussian errors in all measured values and in the impact angle, whose true values are nuisance
parameters (`likelihood` derives it), for both kinds of sticking; intervals by profile likelihood. Equations: A.
Domenech-Carbo, "Independent friction-restitution modeling of two-disk collisions".

Notes
-----
delta_2 alone, or delta_1 alone, cannot tell the two kinds of sticking apart. tan(delta_2) against tan(psi) is a line
with the intercept mu above the transition and one through the origin below it (Eqs. 19, 21, 23): three numbers, which
e_n, e_t and mu reproduce with either, unless e_n or e_t would leave its range. Two quantities measured together do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import cast

import numpy as np

from ..errors import InputError, nearest
from ..model.ifr import STICKING
from .data import Data, example, read
from .doubts import admissibility, doubts, doubts_of_both
from .intervals import covariance_of, intervals
from .likelihood import Array, Likelihood, Points
from .model import Model, Pair, Sticking
from .report import as_json, material, table
from .result import CONFIDENCE, TELLING, Closure, Estimate, Fit, Interval
from .search import Optimum, Search

__all__ = [
    "CONFIDENCE",
    "TELLING",
    "Closure",
    "Data",
    "Estimate",
    "Fit",
    "Interval",
    "Pair",
    "as_json",
    "example",
    "fit",
    "material",
    "read",
    "table",
]

SPINNING = ("Rw_2", "e_t_apparent")  # what rolling friction changes
_CHUNK = 100  # bootstrap data sets at a time


def fit(
    data: Data,
    *,
    M: float,
    k_1: float = 2.0,
    k_2: float = 2.0,
    R_1: float | None = None,
    R_2: float | None = None,
    rolling: bool = False,
    sticking: Sequence[str] = STICKING,
    bootstrap: int = 0,
    seed: int = 1,
    progress: Callable[[int], object] | None = None,
) -> Fit:
    """Fit e_n, e_t, mu, and rho if asked, to measured impacts.

    Parameters
    ----------
    data : Data
        See `read`.
    M : float
        Mass ratio m_1 / m_2 [1]; disk 1 is the one that moves.
    k_1, k_2 : float
        Shape numbers in I = m R^2 / k: 2 homogeneous disk, 1 hoop.
    R_1, R_2 : float, optional
        Radii [length]; needed for `rolling`, and the unit of rho.
    rolling : bool
        Fit rolling friction too. Needs Rw_2 or e_t_apparent among the data.
    sticking : sequence of str
        Which kinds to fit.
    bootstrap : int
        Number of synthetic data sets for a parametric bootstrap: impacts at the fitted true angles with the fitted
        law and the given errors, fitted again. 0 for none; otherwise 40 or more.
    seed : int
        Of the bootstrap's random numbers.
    progress : callable, optional
        Called with the number of bootstrap data sets done since its last call.

    Raises
    ------
    InputError
        If the pair is impossible, the data are too few, or what rolling friction needs is missing.

    Examples
    --------
    >>> from ifrdem import fit
    >>> from pathlib import Path
    >>> _ = Path("data.csv").write_text(fit.example())
    >>> data = fit.read("data.csv", {"angles": 0.7})
    >>> found = fit.fit(data, M=1.0)
    >>> found.best
    'percussion_center'
    """
    pair = Pair(M=M, k_1=k_1, k_2=k_2, R_1=R_1, R_2=R_2)
    _check(data, pair, rolling, sticking, bootstrap)
    closures = {}
    for kind in sticking:
        likelihood = Likelihood(data, Model(pair, cast(Sticking, kind)), rolling=rolling)
        closures[kind] = _closure(likelihood, bootstrap, seed, progress)
    order = sorted(closures, key=lambda kind: closures[kind].AIC)
    decided = len(order) == 1 or closures[order[1]].AIC - closures[order[0]].AIC >= TELLING
    best = order[0] if decided else STICKING[0]  # the paper's choice
    return Fit(data, pair, closures, best, decided, tuple(doubts_of_both(data, closures)))


def _check(data: Data, pair: Pair, rolling: bool, sticking: Sequence[str], bootstrap: int) -> None:
    wrong = [
        f"sticking = {kind!r}: must be one of {', '.join(map(repr, STICKING))}{nearest(str(kind), STICKING)}"
        for kind in sticking
        if kind not in STICKING
    ]
    if not sticking:
        wrong.append(f"sticking: at least one is needed of {', '.join(map(repr, STICKING))}")
    if rolling and not set(SPINNING) & set(data.names):
        wrong.append(
            f"{data.source}: rolling friction changes spins only: a column {' or '.join(SPINNING)} is needed to fit "
            f"rho; there are {', '.join(data.names)}"
        )
    if rolling and not pair.has_radii:
        wrong.append("R_1, R_2: the radii are needed to fit rho")
    values, p = len(data) * len(data.names), 3 + rolling
    if values <= p:
        wrong.append(
            f"{data.source}: {values} values measured after the impact: more than {p} are needed for {p} coefficients"
        )
    if bootstrap != 0 and bootstrap < 40:
        wrong.append(f"bootstrap = {bootstrap}: 0, or 40 data sets and more, are needed for 95 % intervals")
    if wrong:
        raise InputError("\n".join(wrong))


def _closure(
    likelihood: Likelihood, bootstrap: int, seed: int, progress: Callable[[int], object] | None
) -> Closure:
    from scipy.special import chdtrc, chdtri  # tail of the chi-square distribution, and its inverse

    search = Search(likelihood)
    rise = float(chdtri(1, 1.0 - CONFIDENCE))
    found = intervals(search, _polished(search, search.best()), rise)
    optimum = found.optimum
    by_angle, by_mu = np.zeros(1, dtype=bool), np.ones(1, dtype=bool)
    angle_covariance = covariance_of(search.points(optimum.at, by_angle, likelihood).information)[0]
    points = search.points(optimum.free, by_mu, likelihood)
    information = points.information[0]
    covariance = covariance_of(information)
    variance = dict(zip(likelihood.free, np.diag(covariance), strict=True))
    variance["psi_transit"] = angle_covariance[2, 2]
    value = dict(zip(likelihood.free, optimum.free[0], strict=True))
    value["psi_transit"] = optimum.at[0, 2]
    again = _bootstrap(search, found.ends[0], optimum, bootstrap, seed, progress) if bootstrap else {}
    estimates = {}
    for name, ends, opened in zip(found.quantities, found.ends[0], found.open[0], strict=True):
        unit = np.degrees if name == "psi_transit" else float
        low, high = (float(unit(end)) for end in ends)
        estimates[name] = Estimate(
            value=float(unit(value[name])),
            standard_error=float(unit(np.sqrt(variance[name]))),
            interval=Interval(low, high, bool(opened[0]), bool(opened[1])),
            bootstrap=Interval(float(unit(again[name][0])), float(unit(again[name][1]))) if again else None,
        )
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    p, count, chi2 = len(likelihood.free), likelihood.y.size, float(optimum.chi2[0])
    full = likelihood.full(optimum.free)[0]
    closure = Closure(
        sticking=likelihood.model.sticking,
        estimates=estimates,
        correlation=correlation,
        coefficients=likelihood.free,
        flat=_flat(information, likelihood.free),
        chi2=chi2,
        dof=count - p,
        probability=float(chdtrc(count - p, chi2)),
        AIC=chi2 + 2.0 * p,
        BIC=chi2 + p * float(np.log(count)),
        psi=np.degrees(points.psi[0]),
        regimes=likelihood.model.regimes(full, points.psi[0]),
        admissibility=admissibility(likelihood.model, full),
    )
    others = search.others(optimum, found.ends[0], rise)
    return replace(closure, warnings=tuple(doubts(closure, others)))


def _flat(information: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Names of the coefficients along a combination of which chi2 does not change, if there is one."""
    diagonal = np.diag(information)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    if values[0] > 1e-10 * values[-1]:
        return ()
    return tuple(name for name, part in zip(names, vectors[:, 0], strict=True) if abs(part) > 0.05)


def _polished(search: Search, optimum: Optimum) -> Optimum:
    """The end of SciPy's least squares from the minimum that was found, if it gets any lower."""
    from scipy.optimize import least_squares

    by_mu = np.zeros(1, dtype=bool)

    @lru_cache(maxsize=2)  # SciPy asks for residuals and derivatives at the same place one after the other
    def points(at: bytes) -> Points:
        return search.points(np.frombuffer(at)[None], by_mu, search.likelihood)

    def residual(at: Array) -> Array:
        return points(at.tobytes()).residual.ravel()

    def jacobian(at: Array) -> Array:
        return points(at.tobytes()).jacobian.reshape(-1, search.p)

    found = least_squares(
        residual, optimum.at[0], jacobian, bounds=(search.low, search.high), method="dogbox", x_scale="jac",
        ftol=1e-14, xtol=1e-14, gtol=1e-14, max_nfev=50,
    )  # fmt: skip
    chi2 = 2.0 * float(found.cost)
    if not chi2 < optimum.chi2[0]:
        return optimum
    return Optimum(found.x[None], search.free(found.x[None], by_mu), np.array([chi2]))


def _bootstrap(
    search: Search,
    ends: Array,
    optimum: Optimum,
    number: int,
    seed: int,
    progress: Callable[[int], object] | None,
) -> dict[str, Array]:
    """Percentiles (2,) of each quantity over synthetic data sets."""
    likelihood = search.likelihood
    points = likelihood.at(optimum.free)
    psi = points.psi[0]
    fitted = likelihood.model.predict(likelihood.full(optimum.free), psi, likelihood.names)
    rng = np.random.default_rng(seed)
    # Other transitions to start from: twice the interval, as synthetic data can scatter beyond it.
    low, high = ends[3]
    transitions = np.clip(np.linspace(1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low, 6), 0.0, search.high[2])
    starts = np.repeat(optimum.at, 1 + len(transitions), axis=0)
    starts[1:, 2] = transitions
    found: list[Array] = []
    for begin in range(0, number, _CHUNK):
        sets = min(_CHUNK, number - begin)
        synthetic = likelihood.of(
            psi + likelihood.s_psi * rng.standard_normal((sets, len(psi))),
            fitted + likelihood.s * rng.standard_normal((sets, *fitted.shape)),
        )
        rows = np.repeat(np.arange(sets), len(starts))
        ended = search.descend(np.tile(starts, (sets, 1)), likelihood=synthetic.take(rows))
        best = np.argmin(ended.chi2.reshape(sets, -1), axis=1) + np.arange(sets) * len(starts)
        found.append(np.column_stack([ended.free[best], ended.at[best, 2]]))
        if progress is not None:
            progress(sets)
    tail = 0.5 * (1.0 - CONFIDENCE)
    percentiles = np.quantile(np.concatenate(found), [tail, 1.0 - tail], axis=0)
    return dict(zip((*likelihood.free, "psi_transit"), percentiles.T, strict=True))
