"""A fit as text, JSON, a material of a case file, or drawn coefficients."""

from __future__ import annotations

import json
import math
import os
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import combinations
from typing import Any

import numpy as np

from ..errors import InputError, option_name
from ..model.laws.files import source_of
from ..tools.checked import Count, Seed, validated
from ..tools.toml import toml
from .data import Collisions, Data
from .model import DIRECTION, MEASURED, MOTION
from .result import Fit, Fitted, Interval, of_probability

_DIGITS = 6  # of the coefficients in a material, after the point


@validated
def table(fit: Fit) -> str:
    """The figures of every law as text.

    Examples
    --------
    >>> from ifrdem import fit
    >>> data = fit.read("data.csv", {"angles": 0.7})  # of `ifrdem fit --example > data.csv`
    >>> fit.table(fit.fit(data, M=1.0, model=["smooth"])).splitlines()[0]
    'data.csv: 18 impacts, psi 4.24 to 71.43 degrees; fitted: delta_1, delta_2'
    """
    data, first = fit.data, next(iter(fit.laws.values()))
    noun = "impacts" if isinstance(data, Data) else "collisions with a wall" if data.wall else "collisions"
    psi = np.abs(data.psi if isinstance(data, Data) else first.psi)
    lines = [
        f"{data.source}: {len(data)} {noun}, psi {np.min(psi):.4g} to {np.max(psi):.4g} degrees; fitted: "
        f"{', '.join(data.names)}",
        *_disks(fit),
    ]
    likelihood = "" if fit.robust is None else f"; Student-t likelihood with nu = {fit.robust:g}"
    if not first.errors:
        lines.append(f"errors (one sigma): {', '.join(_errors(fit))}{likelihood}")
    if len(fit.laws) > 1:
        lines += ["", *_comparison(fit)]
    for name, fitted in fit.laws.items():
        mark = "   <- preferred by the data" if name == fit.best and fit.decided and len(fit.laws) > 1 else ""
        lines += ["", f"{name}: {fitted.law.about}{mark}"]
        if fitted.errors:
            errors = fitted.errors.items()
            listed = ", ".join(f"{group} {each:.3g}{_unit(group, fit.data)}" for group, each in errors)
            lines.append(f"  errors estimated from the residuals (one sigma): {listed}{likelihood}")
        lines += _fitted(fit, fitted)
    if fit.warnings:
        lines += ["", *_wrapped(fit.warnings)]
    return "\n".join(lines)


def overview(fits: Sequence[Fit]) -> str:
    """Table of the coefficients of the best law of each fit, with a line for each pair of kinds of disks."""
    named = max((len(each) for fit in fits for each in _material_of(fit)), default=0) + 2
    named = max(named, len("material") + 2) if named > 2 else 0
    head = f"{'material' if named else '':>{named}}{'mass':>24}{'radius':>24}{'impacts':>9}"
    lines = [f"{head}  law, coefficients with standard errors"]
    for fit in fits:
        assert not isinstance(fit.data, Data)
        pair = (fit.data.disk_1, fit.data.disk_2)
        sizes = [
            ", ".join(sorted(f"{float(np.asarray(getattr(disk, key)).flat[0]):.5g}" for disk in pair))
            for key in ("mass", "radius")
        ]
        values = ", ".join(
            f"{name} {each.value:.4g} +- {each.standard_error:.2g}"
            for name, each in fit.laws[fit.best].estimates.items()
            if not _of_coefficient(name, fit.data)
        )
        material = ", ".join(_material_of(fit)) if named else ""
        lines.append(
            f"{material:>{named}}{sizes[0]:>24}{sizes[1]:>24}{len(fit.data):>9}  {fit.best}: {values}"
        )
    return "\n".join(lines)


def _material_of(fit: Fit) -> list[str]:
    """The one pair of materials of all collisions, if there is one."""
    found = [] if isinstance(fit.data, Data) else list(dict.fromkeys(fit.data.materials))
    return found if len(found) == 1 else []


def _disks(fit: Fit) -> Iterator[str]:
    if fit.pair is not None:
        pair = fit.pair
        radii = "" if not pair.has_radii else f", R_1 = {pair.R_1:g}, R_2 = {pair.R_2:g}"
        wall = " (a wall)" if pair.M == 0.0 else ""
        yield f"M = {pair.M:.6g}{wall}, k_1 = {pair.k_1:g}, k_2 = {pair.k_2:g}{radii}"
        return
    assert not isinstance(fit.data, Data)
    for number, disk in ((1, fit.data.disk_1), (2, fit.data.disk_2)):
        if number == 2 and fit.data.wall:
            yield "disk 2: a wall or fixed disk"
            continue
        each = (
            f"{key} {np.min(value):.6g}"
            + (f" to {np.max(value):.6g}" if np.ptp(value) else "")
            + f" {fit.data.unit(f'{key}_{number}')}".rstrip()
            for key, value in (("mass", disk.mass), ("radius", disk.radius), ("k", disk.k))
        )
        yield f"disk {number}: {', '.join(each)}"
    if fit.data.materials:
        yield f"materials: {'; '.join(dict.fromkeys(fit.data.materials))}"


def _of_coefficient(name: str, data: Data | Collisions) -> str:
    """The unit of a coefficient; empty of a pure number."""
    length, speed = ("", "") if isinstance(data, Data) else (data.unit("radius_1"), data.unit(MOTION[0]))
    units = {
        "psi_transit": "deg",
        "rho": length or "length",
        "A": f"({speed})^-1/5" if speed else "speed^-1/5",
    }
    return units.get(name, "")


def _unit(name: str, data: Data | Collisions) -> str:
    if name in ("angles", "psi") or (name in MEASURED and MEASURED[name].unit == "deg"):
        return " deg"
    if isinstance(data, Collisions) and (unit := data.unit(name)):
        return f" {unit}"
    return {DIRECTION: " rad", "spins": " [rad/time]", "velocities": " [length/time]"}.get(name, "")


def _errors(fit: Fit) -> Iterator[str]:
    problem = next(iter(fit.laws.values())).problem
    for i, name in enumerate(problem.names):
        error = np.where(problem.known[:, i], np.nan, problem.s[:, i])
        if np.isnan(error).all():
            continue
        low, high = np.nanmin(error), np.nanmax(error)
        end = "" if high - low <= 1e-6 * high else f" to {high:.3g}"
        yield f"{name} {low:.3g}{end}{_unit(name, fit.data)}"


def _comparison(fit: Fit) -> Iterator[str]:
    """Laws side by side, by differences to the best: absolute values depend on units."""
    laws = fit.laws.values()
    crossed = any(math.isfinite(each.cross_validation) for each in laws)
    corrected = "AIC" if fit.robust is not None or not next(iter(laws)).errors else "AICc"
    heads = ["ln L - best", f"{corrected} - best", "BIC - best"]
    lists = [[getattr(each, name) for each in laws] for name in ("log_likelihood", "AIC", "BIC")]
    least = [max(lists[0]), min(lists[1]), min(lists[2])]
    last = "  -2 ln L of an unseen impact - best" if crossed else ""
    yield (
        f"  {'law':<18}{'coefficients':>12}"
        + "".join(f"{head:>13}" for head in heads)
        + f"{'chi2 / dof':>18}{last}"
    )
    for i, (name, each) in enumerate(fit.laws.items()):
        ratio = f"{each.chi2:.4g} / {each.dof}"
        parts = [column[i] - best for column, best in zip(lists, least, strict=True)]
        cells = "".join(
            f"{part if math.isfinite(part) else '-':>13{'.2f' * math.isfinite(part)}}" for part in parts
        )
        lowest = min(one.cross_validation for one in laws)
        end = f"  {each.cross_validation - lowest:>12.4f}" if crossed else ""
        yield f"  {name:<18}{len(each.law.free):>12}{cells}{ratio:>18}{end}"


def _fitted(fit: Fit, fitted: Fitted) -> Iterator[str]:
    boot = any(each.bootstrap for each in fitted.estimates.values())
    level = f"{100.0 * fit.level:g} % interval"
    yield f"  {'':<18}{'value':>10}{'std. error':>12}   {level:<24}{'bootstrap' if boot else ''}".rstrip()
    for name, each in fitted.estimates.items():
        unit = f" [{found}]" if (found := _of_coefficient(name, fit.data)) else ""
        row = f"  {name + unit:<18}{_short(each.value):>10}{_short(each.standard_error):>12}   "
        row += f"{_interval(each.interval):<24}" + (_interval(each.bootstrap) if each.bootstrap else "")
        yield row.rstrip()
    if any(each.interval.low_open or each.interval.high_open for each in fitted.estimates.values()):
        yield "  *: a limit of what is allowed; the data set no end there"
    held = {name: value for name, value in fitted.law.fixed.items() if name != "rho" or value}
    if held:
        yield "  fixed: " + ", ".join(f"{name} = {value:g}" for name, value in held.items())
    names = fitted.law.free
    pairs = (
        f"{names[i]} {names[j]} {fitted.correlation[i, j]:.2f}"
        for i, j in combinations(range(len(names)), 2)
        if math.isfinite(fitted.correlation[i, j])
    )
    if text := ", ".join(pairs):
        yield f"  correlation: {text}"
    known = math.isfinite(fitted.probability)
    tested = f", probability {of_probability(fitted.probability, 3)}" if known else " (by the errors)"
    yield f"  chi2 = {fitted.chi2:.4g} for {fitted.dof} degrees of freedom{tested}"
    if counted := fitted.count():
        yield "  impacts: " + ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counted.items())
    for against in ("g_n", "rim speed"):
        each_trend = [each for each in fitted.trends.each if each.against == against] if fitted.trends else []
        if each_trend:
            changes = (
                f"{each.coefficient} {each.change:+.2g} +- {each.error:.2g} (p {of_probability(each.probability, 2, '= ')})"
                for each in each_trend
            )
            unit = "" if isinstance(fit.data, Data) else fit.data.unit(MOTION[0])
            ends = f"{each_trend[0].low:.3g} to {each_trend[0].high:.3g} {unit}".rstrip()
            yield f"  change with {against} from {ends}: {', '.join(changes)}"
    verdict = fitted.admissibility
    if verdict is not None and verdict.strict:
        yield "  energy: no collision adds energy, nor do its tangential impulses alone"
    elif verdict is not None:
        words = "no collision adds energy" if verdict.admissible else "SOME COLLISIONS ADD ENERGY"
        yield f"  energy: {words}, see below"
    yield from _wrapped(fitted.warnings)


def _wrapped(warnings: tuple[str, ...]) -> Iterator[str]:
    for each in warnings:
        yield textwrap.fill(
            each, 110, initial_indent="  ! ", subsequent_indent="    ", break_on_hyphens=False
        )


def _short(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    if abs(value) >= 10.0:
        return f"{value:.2f}"
    return f"{value:.4f}" if abs(value) >= 1e-3 or value == 0.0 else f"{value:.2e}"


def _interval(each: Interval) -> str:
    return f"{_short(each.low)}{'*' * each.low_open} to {_short(each.high)}{'*' * each.high_open}"


def figures(fit: Fit) -> dict[str, Any]:
    """The complete result as plain dictionaries, lists and numbers; non-finite numbers become None."""

    def one(each: Fitted) -> dict[str, Any]:
        verdict, free = each.admissibility, list(each.law.free)
        residuals = dict(zip(each.problem.names, each.residuals.T.tolist(), strict=True))
        plain = ("coefficients", "chi2", "probability", "log_likelihood", "AIC", "BIC", "cross_validation")
        arrays = ("distance", "weight")
        return {
            "estimates": {name: asdict(found) for name, found in each.estimates.items()},
            "sticking": each.law.sticking,
            "flat": list(each.flat),
            "covariance": {"of": free, "matrix": each.covariance.tolist()},
            "correlation": {"of": free, "matrix": each.correlation.tolist()},
            "degrees_of_freedom": each.dof,
            **{name: getattr(each, name) for name in plain},
            "errors_by_residuals": dict(each.errors),
            "errors_of_errors": dict(each.errors_of_errors),
            "impacts": each.count(),
            "psi_fitted": each.psi.tolist(),
            "residuals": residuals,
            **{name: getattr(each, name).tolist() for name in arrays},
            "suspects": [asdict(suspect) for suspect in each.suspects],
            "without": dict(each.without),
            "adds_energy": None if verdict is None else not verdict.admissible,
            "tangential_impulses_alone_add_energy": None if verdict is None else not verdict.strict,
            "energy": "" if verdict is None else verdict.message,
            "trends": [] if each.trends is None else [asdict(trend) for trend in each.trends.each],
            "clusters_of_e_n": None if each.trends is None else each.trends.clusters,
            "warnings": list(each.warnings),
        }

    data, pair = fit.data, fit.pair
    measured = {name: values.tolist() for name, values in data.measured.items()}
    return _finite(
        {
            "source": data.source,
            "units": {"angles": "deg", DIRECTION: "rad", "rho": "unit of the radii"},
            "pair": None if pair is None else asdict(pair),
            "data": {
                **({"psi": data.psi.tolist()} if isinstance(data, Data) else {}),
                **measured,
                "errors": {name: values.tolist() for name, values in data.errors.items()},
            },
            "level": fit.level,
            "robust": fit.robust,
            "best": fit.best,
            "decided": fit.decided,
            "laws": {name: one(each) for name, each in fit.laws.items()},
            "warnings": list(fit.warnings),
        }
    )


@validated
def as_json(fit: Fit) -> str:
    """`figures` as JSON text.

    Examples
    --------
    >>> from ifrdem import fit
    >>> data = fit.read("data.csv", {"angles": 0.7})  # of `ifrdem fit --example > data.csv`
    >>> import json
    >>> sorted(json.loads(fit.as_json(fit.fit(data, M=1.0, model=["smooth"]))))[:3]
    ['best', 'data', 'decided']
    """
    return json.dumps(figures(fit), indent=2, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@validated
def material(fit: Fit, name: str) -> str:
    """A `[[material]]` table of the best law, for a case file; `name` is that of the material.

    Raises InputError if the fitted law can add energy in collisions of the fitted pair: no case would take it.

    Examples
    --------
    >>> from ifrdem import fit
    >>> data = fit.read("data.csv", {"angles": 0.7})  # of `ifrdem fit --example > data.csv`
    >>> fit.material(fit.fit(data, M=1.0, model=["brach"]), "coins").splitlines()[0]
    '# Fitted to 18 impacts of data.csv (delta_1, delta_2) by `ifrdem fit`; M = 1, k_1 = 2, k_2 = 2.'
    """
    fitted = fit.laws[fit.best]
    if reason := not_in_cases(fitted):
        raise InputError(f"no material is written{reason}")
    heading = ["[[material]]", f"name = {json.dumps(name, ensure_ascii=False)}"]
    return "\n".join((*origin(fit, fitted), *law_lines(heading, fitted))) + "\n"


def not_in_cases(fitted: Fitted) -> str:
    """Clause on why no case takes a fitted law; empty if one does."""
    law, choose = fitted.law, option_name("--model", "model")
    if not law.kind.name_in_cases and source_of(law.kind) is None:
        return f": a case knows laws by name or file, and {law.name}, which fits best, has neither; {choose} chooses"
    if law.depends_on_speed:
        return (
            f': no case has the law {law.name}; law = "viscoelastic" requires A and Y, and impacts give only a '
            f"combination of both; {choose} chooses another law"
        )
    verdict = fitted.admissibility
    refused = verdict is not None and not verdict.admissible
    return f", because a case would refuse it: {verdict.message}" if verdict is not None and refused else ""


def origin(fit: Fit, fitted: Fitted) -> list[str]:
    """Comments of a case on where the coefficients of a law come from."""
    chosen = (
        "preferred by the data"
        if fit.decided
        else "not distinguished from other laws by the data: the first of these"
    )
    if len(fit.laws) == 1:
        chosen = "as requested"
    elif fitted is not fit.laws[fit.best]:
        chosen = f"not the best, which is {fit.best}: all pairs of a case have laws of one class"
    tested = (
        f", probability {of_probability(fitted.probability, 3)}" if math.isfinite(fitted.probability) else ""
    )
    disks = "; ".join(_disks(fit))
    return [
        f"# Fitted to {len(fit.data)} impacts of {fit.data.source} ({', '.join(fit.data.names)}) by "
        f"`ifrdem fit`; {disks}.",
        f"# {fitted.law.name}, {chosen}. chi2 = {fitted.chi2:.4g} for {fitted.dof} degrees of freedom{tested}.",
        *(f"# Warning: {each}" for each in fitted.warnings),
    ]


def law_lines(heading: Sequence[str], fitted: Fitted) -> list[str]:
    """Lines of a material or pair of a case, behind its heading: law, coefficients, their errors and correlations."""
    law = [f'law = "{fitted.law.kind.name_in_cases}"'] * (fitted.law.sticking is None)
    if (source := source_of(fitted.law.kind)) is not None:
        reference = f"{os.path.relpath(source.path).replace(os.sep, '/')}:{source.name}"
        law = [f"law = {json.dumps(reference)}  # path from the case file, which runs its code"]
    lines = [*heading, *law]
    for key, number in fitted.coefficients.items():
        if key == "rho" and number == 0.0:
            continue
        unit = "[length, in the unit of the fitted radii]" if key == "rho" else "[1]"
        value = float(round(number, _DIGITS)) if key != "rho" else float(f"{number:.{_DIGITS}g}")
        about = "fixed"
        if key in fitted.estimates:
            each = fitted.estimates[key]
            about = f"interval {_short(each.interval.low)} to {_short(each.interval.high)}"
        lines.append(f"{key} = {value!r}  # {unit}, {about}")
    lines += [] if law else [f'sticking = "{fitted.law.sticking}"']
    names, lost = fitted.law.free, ~np.isfinite(np.diag(fitted.covariance))
    if lost.any():
        lines.append(
            f"# no errors: {', '.join(each for each, no in zip(names, lost, strict=True) if no)} not determined"
        )
    each_error = {
        name: float(f"{fitted.estimates[name].standard_error:.3g}")
        for name, no in zip(names, lost, strict=True)
        if not no
    }
    if each_error:
        lines.append(f"errors = {toml(each_error)}")
    pairs: dict[str, dict[str, float]] = {}
    for i, j in combinations(np.flatnonzero(~lost).tolist(), 2):
        pairs.setdefault(names[i], {})[names[j]] = float(round(fitted.correlation[i, j], 4))
    return [*lines, f"correlations = {toml(pairs)}"] if pairs else lines


@validated
def draws(fit: Fit, number: Count, seed: Seed = 1) -> str:
    """A CSV table of coefficients of the best law, drawn from their joint distribution: a line for each draw.

    Raises InputError as `Fitted.draw`.

    Examples
    --------
    >>> from ifrdem import fit
    >>> found = fit.fit(fit.read("data.csv", {"angles": 0.7}), M=1.0)
    >>> fit.draws(found, 2).splitlines()[2]
    'e_n,e_t,mu,rho'
    """
    fitted = fit.laws[fit.best]
    rows = fitted.draw(number, seed)
    header = [
        f"# {number} draws of the coefficients of {fit.best} fitted to {fit.data.source}: Gaussian, "
        "with their covariance",
        *([f"# sticking: {fitted.law.sticking}"] if fitted.law.sticking else []),
        ",".join(rows[0]),
    ]
    return "\n".join((*header, *(",".join(f"{value:.8g}" for value in row.values()) for row in rows))) + "\n"
