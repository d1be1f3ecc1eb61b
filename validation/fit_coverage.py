"""Fits compared with simulated data of known truth: coverage of intervals, and how often the right law is found.

`python -m ifrdem.validation.fit_coverage coverage angles` (or `collisions`), `... selection` and `... coins` print
tables; `--sets` sets the number of data sets. An interval holds the truth if the loss, with the quantity held at
its true value, has risen by less than the quantile of chi-square: that is what the interval is made of, and takes
one descent instead of many.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

import numpy as np
from scipy.special import chdtri

from ifrdem.fit.data import WALL, Collisions, Disk
from ifrdem.fit.laws import LAWS
from ifrdem.fit.likelihood import NU, Likelihood
from ifrdem.fit.maximum import TRANSIT, Search, covariance_of, rise_of
from ifrdem.fit.model import AngleProblem, FitProblem, Pair
from ifrdem.tools.arguments import script
from ifrdem.validation.paper.equations import TABLE_II

TRUTH = {
    "ifr-percussion": [0.87, -0.88, 0.21],
    "ifr-contact": [0.87, -0.88, 0.21],
    "walton": [0.87, 0.4, 0.21],
    "brach": [0.87, 0.21],
}
LEVELS = (0.68, 0.95)


def angles(
    law: str, n: int, error: float, rng: np.random.Generator, *, M: float = 1.0, truth: Sequence[float] = ()
) -> FitProblem:
    """A table of delta_1 and delta_2 of n impacts of coins, psi from 4 to 75 degrees, with errors [deg]."""
    s = np.full((n, 3), error)
    problem = AngleProblem(("psi", "delta_1", "delta_2"), np.zeros((n, 3)), s, ["angles"] * 3, Pair(M=M))
    true = np.array(truth or TRUTH[law])
    exact = problem.predict(LAWS[law], true, np.radians(np.linspace(4.0, 75.0, n))[:, None])
    return problem.of(exact + error * rng.standard_normal(exact.shape))


def collisions(law: str, n: int, error: float, rng: np.random.Generator, *, wall: bool = False) -> FitProblem:
    """Whole collisions of two different spinning coins at 1 m/s, errors `error` of the velocities [m/s] and of R w."""
    R = 10.5e-3
    phi, chi = rng.uniform(0.0, 2.0 * np.pi, n), np.radians(rng.uniform(-75.0, 75.0, n))
    blank = {name: np.zeros(n) for name in ("vx_1", "vy_1", "spin_1", "vx_2", "vy_2", "spin_2")}
    if wall:
        blank = {name: value for name, value in blank.items() if name.endswith("1")}
    after = {f"{name}_after": value for name, value in blank.items()}
    measured: dict[str, np.ndarray] = {"nx": np.cos(phi), "ny": np.sin(phi), **blank, **after}
    measured["vx_1"], measured["vy_1"] = np.cos(phi), np.sin(phi)
    errors: dict[str, Any] = {name: error / R if name[0] == "s" else error for name in (*blank, *after)}
    errors["normal"] = np.full(n, error)
    coin, other = Disk(mass=1.19e-3, radius=R), WALL if wall else Disk(mass=3.0e-3, radius=8.75e-3)
    data = Collisions(disk_1=coin, disk_2=other, measured=measured, errors=errors)
    problem = data.problem()
    x = problem.start.copy()
    x[:, 0] = chi
    x[:, 3:] += rng.standard_normal(x[:, 3:].shape) * ([0.3, 0.3, 10.0, 10.0] if not wall else 10.0)
    exact = problem.predict(LAWS[law], np.array(TRUTH[law]), x)
    return problem.of(exact + problem.s * rng.standard_normal(exact.shape))


KINDS: dict[str, tuple[Callable[..., FitProblem], int, tuple[float, ...]]] = {
    "angles": (angles, 20, (0.5, 1.0)),
    "collisions": (collisions, 12, (0.005, 0.02)),
}


def best(problem: FitProblem, law: str, start: np.ndarray) -> tuple[Search, np.ndarray, float]:
    """Lowest minimum from the start and from others with more and less friction."""
    search = Search(Likelihood(problem, LAWS[law]))
    by = np.array([name == "mu" for name in LAWS[law].free])
    ends = [search.descend(start * np.where(by, factor, 1.0)) for factor in (1.0, 0.7, 1.4)]
    values, loss = min(ends, key=lambda each: each[1])
    return search, values, loss


def coverage(kind: str, sets: int, seed: int) -> Iterator[str]:
    """Lines of the table of coverage."""
    make, n, errors = KINDS[kind]
    law, truth = "ifr-percussion", np.array(TRUTH["ifr-percussion"])
    rises = chdtri(1, 1.0 - np.array(LEVELS))
    yield f"{kind}: {sets} data sets of {n}; part of the {LEVELS[0]:.0%} and {LEVELS[1]:.0%} intervals that hold the truth"
    for error in errors:
        rng = np.random.default_rng(seed)
        inside: dict[str, list[np.ndarray]] = {}
        chi2 = []
        for _ in range(sets):
            search, values, loss = best(make(law, n, error, rng), law, truth)
            held = dict(zip(LAWS[law].free, truth, strict=True))
            if search.transits:
                held[TRANSIT] = search.transition(truth)
            for name, value in held.items():
                start = values.copy()
                least = min(search.descend(each, {name: float(value)})[1] for each in (start, truth))
                inside.setdefault(name, []).append(least - loss < rises)
            chi2.append(loss)
        dof = int(np.sum(search.likelihood.problem.redundancy)) - 3
        shown = "; ".join(
            f"{name} {np.mean(each, axis=0)[0]:.3f} {np.mean(each, axis=0)[1]:.3f}"
            for name, each in inside.items()
        )
        yield f"  error {error:g}: {shown}; mean chi2 {np.mean(chi2):.2f} for {dof} degrees of freedom"


def robust(sets: int, seed: int, n: int = 30, error: float = 0.01) -> Iterator[str]:
    """Lines of the coverage of robust intervals, where a part of the collisions has errors ten times as large."""
    law, truth = "ifr-percussion", np.array(TRUTH["ifr-percussion"])
    names = LAWS[law].free
    yield f"robust: {sets} data sets of {n} collisions; part of the {LEVELS[0]:.0%} and {LEVELS[1]:.0%} intervals that hold the truth"
    for part in (0.0, 0.1, 0.3):
        rng = np.random.default_rng(seed)
        inside: dict[str, list[np.ndarray]] = {}
        for _ in range(sets):
            problem = collisions(law, n, error, rng)
            y = problem.y.copy()
            out = rng.permutation(n)[: round(part * n)]
            y[out] += np.sqrt(99.0) * problem.s[out] * rng.standard_normal(y[out].shape)  # 1 + 99 = 10^2
            search = Search(Likelihood(problem.of(y), LAWS[law], NU))
            values, loss = search.descend(truth)
            ratios = search.variance_ratios(values)
            for name, value in zip(names, truth.tolist(), strict=True):
                least = search.descend(values, {name: value})[1]
                rises = np.array([rise_of(search, level) for level in LEVELS])
                inside.setdefault(name, []).append(least - loss < ratios[name] * rises)
        shown = "; ".join(
            f"{name} {np.mean(each, axis=0)[0]:.3f} {np.mean(each, axis=0)[1]:.3f}"
            for name, each in inside.items()
        )
        yield f"  outliers {part:.0%}: {shown}"


def selection(sets: int, seed: int) -> Iterator[str]:
    """Lines of the table of laws found by AIC."""
    names = list(TRUTH)
    yield f"law found by the lowest AIC, in {sets} tables of 20 impacts (delta_1, delta_2)"
    yield f"  {'true law':<16}{'error [deg]':>12}" + "".join(f"{name:>16}" for name in names)
    for law in names:
        for error in (0.25, 0.5, 1.0, 2.0):
            rng = np.random.default_rng(seed)
            count = dict.fromkeys(names, 0)
            for _ in range(sets):
                problem = angles(law, 20, error, rng)
                AIC = {}
                for name in names:
                    start = np.array(TRUTH[name])
                    AIC[name] = best(problem, name, start)[2] + 2.0 * len(start)
                count[min(AIC, key=lambda each: AIC[each])] += 1
            yield f"  {law:<16}{error:>12g}" + "".join(f"{count[name] / sets:>16.3f}" for name in names)


def coins(seed: int, n: int = 20, error: float = 1.0) -> Iterator[str]:
    """Lines of Table II of the paper, fitted again to data made from it."""
    rng = np.random.default_rng(seed)
    yield f"Table II, and fits to {n} impacts (delta_1, delta_2) made from it, error {error:g} degrees"
    for row in TABLE_II:
        truth = (row.e_n, row.e_t, row.mu)
        problem = angles("ifr-percussion", n, error, rng, M=row.M, truth=truth)
        search = Search(Likelihood(problem, LAWS["ifr-percussion"]))
        values, loss = search.best()
        found = np.sqrt(np.diag(covariance_of(search.points(values).information)))
        each = (f"{a:g}: {b:.3f} +- {c:.3f}" for a, b, c in zip(truth, values, found, strict=True))
        yield f"  {row.disks:<24} {' | '.join(each)} | chi2 {loss:.1f} for {2 * n - 3}"


def fits(
    table: Literal["coverage", "robust", "selection", "coins"], kind: Literal["angles", "collisions"] = "angles", /, *,
    sets: int = 1000, seed: int = 1,
) -> None:  # fmt: skip
    """Print a table."""
    tables = {
        "selection": selection(sets, seed),
        "coverage": coverage(kind, sets, seed),
        "robust": robust(sets, seed),
        "coins": coins(seed),
    }
    for line in tables[table]:
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(script(fits))
