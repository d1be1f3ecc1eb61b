"""A fit as text, as JSON and as a material of a case file."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.ifr import STICKING
from .model import MEASURED
from .result import Closure, Estimate, Fit, Interval

KIND = {STICKING[0]: "percussion centre (Eq. 15)", STICKING[1]: "contact point (Eq. 12)"}
_UNITS = {"psi_transit": "deg", "rho": "length"}
_DIGITS = 6  # of the coefficients in a material, after the point


def table(fit: Fit) -> str:
    """The figures of both kinds of sticking as text.

    Examples
    --------
    >>> from ifrdem import fit
    >>> from pathlib import Path
    >>> _ = Path("data.csv").write_text(fit.example())
    >>> data = fit.read("data.csv", {"angles": 0.7})
    >>> fit.table(fit.fit(data, M=1.0)).splitlines()[0]
    'data.csv: 18 impacts, psi 4.24 to 71.43 degrees; fitted: delta_1, delta_2'
    """
    data, pair = fit.data, fit.pair
    angles = "" if not pair.has_radii else f", R_1 = {pair.R_1:g}, R_2 = {pair.R_2:g}"
    lines = [
        f"{data.source}: {len(data)} impacts, psi {np.min(data.psi):.4g} to {np.max(data.psi):.4g} degrees; fitted: "
        f"{', '.join(data.names)}",
        f"M = {pair.M:.6g}, k_1 = {pair.k_1:g}, k_2 = {pair.k_2:g}{angles}",
        f"errors (one sigma): {', '.join(_errors(fit))}",
    ]
    for kind, closure in fit.closures.items():
        mark = (
            "   <- preferred by the data"
            if kind == fit.best and fit.decided and len(fit.closures) > 1
            else ""
        )
        lines += ["", f"sticking: {KIND[kind]}{mark}", *_closure(closure)]
    if fit.warnings:
        lines += ["", *_wrapped(fit.warnings)]
    return "\n".join(lines)


def _errors(fit: Fit) -> Iterator[str]:
    for name in ("psi", *fit.data.names):
        error = fit.data.errors[name]
        unit = " deg" if name == "psi" or MEASURED[name].unit == "deg" else ""
        low, high = np.min(error), np.max(error)
        yield f"{name} {low:.3g}{unit}" if low == high else f"{name} {low:.3g} to {high:.3g}{unit}"


def _closure(closure: Closure) -> Iterator[str]:
    boot = any(each.bootstrap for each in closure.estimates.values())
    heading = (
        f"  {'':<18}{'value':>10}{'std. error':>12}   {'95 % interval':<24}{'bootstrap' if boot else ''}"
    )
    yield heading.rstrip()
    for name, each in closure.estimates.items():
        unit = f" [{_UNITS[name]}]" if name in _UNITS else ""
        row = f"  {name + unit:<18}{_short(each.value):>10}{_short(each.standard_error):>12}   "
        row += f"{_interval(each.interval):<24}" + (_interval(each.bootstrap) if each.bootstrap else "")
        yield row.rstrip()
    if any(_at_limit(each) for each in closure.estimates.values()):
        yield "  *: a limit of what is allowed; the data set no end there"
    names = closure.coefficients
    pairs = [(i, j) for i in range(len(names)) for j in range(i + 1, len(names))]
    yield "  correlation: " + ", ".join(
        f"{names[i]} {names[j]} {closure.correlation[i, j]:.2f}" for i, j in pairs
    )
    yield (
        f"  chi2 = {closure.chi2:.4g} for {closure.dof} degrees of freedom, probability {closure.probability:.3g}; "
        f"AIC = {closure.AIC:.2f}, BIC = {closure.BIC:.2f}"
    )
    yield "  impacts: " + ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in closure.count().items())
    verdict = closure.admissibility
    if verdict.strict:
        yield "  energy: no collision adds energy, nor do its tangential impulses alone"
    else:
        words = "no collision adds energy" if verdict.admissible else "SOME COLLISIONS ADD ENERGY"
        yield f"  energy: {words}, see below"
    yield from _wrapped(closure.warnings)


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
    low, high = (
        f"{_short(end)}{'*' * opened}"
        for end, opened in ((each.low, each.low_open), (each.high, each.high_open))
    )
    return f"{low} to {high}"


def _at_limit(each: Estimate) -> bool:
    return each.interval.low_open or each.interval.high_open


def figures(fit: Fit) -> dict[str, Any]:
    """Everything that was found as plain dictionaries, lists and numbers; what is not finite becomes None."""

    def interval(each: Interval | None) -> dict[str, Any] | None:
        if each is None:
            return None
        return {"low": each.low, "high": each.high, "low_open": each.low_open, "high_open": each.high_open}

    def closure(each: Closure) -> dict[str, Any]:
        return {
            "estimates": {
                name: {
                    "value": found.value,
                    "standard_error": found.standard_error,
                    "interval_95": interval(found.interval),
                    "bootstrap_95": interval(found.bootstrap),
                }
                for name, found in each.estimates.items()
            },
            "flat": list(each.flat),
            "correlation": {"of": list(each.coefficients), "matrix": each.correlation.tolist()},
            "chi2": each.chi2,
            "degrees_of_freedom": each.dof,
            "probability": each.probability,
            "AIC": each.AIC,
            "BIC": each.BIC,
            "impacts": each.count(),
            "psi_fitted": each.psi.tolist(),
            "adds_energy": not each.admissibility.admissible,
            "tangential_impulses_alone_add_energy": not each.admissibility.strict,
            "energy": each.admissibility.message,
            "warnings": list(each.warnings),
        }

    data, pair = fit.data, fit.pair
    return _finite(
        {
            "source": data.source,
            "units": {"angles": "deg", "rho": "unit of the radii"},
            "pair": {name: getattr(pair, name) for name in ("M", "k_1", "k_2", "R_1", "R_2")},
            "data": {
                "psi": data.psi.tolist(),
                **{name: values.tolist() for name, values in data.measured.items()},
                "errors": {name: values.tolist() for name, values in data.errors.items()},
            },
            "best": fit.best,
            "decided": fit.decided,
            "closures": {kind: closure(each) for kind, each in fit.closures.items()},
            "warnings": list(fit.warnings),
        }
    )


def as_json(fit: Fit) -> str:
    """`figures` as JSON text.

    Examples
    --------
    >>> from ifrdem import fit
    >>> from pathlib import Path
    >>> _ = Path("data.csv").write_text(fit.example())
    >>> data = fit.read("data.csv", {"angles": 0.7})
    >>> import json
    >>> sorted(json.loads(fit.as_json(fit.fit(data, M=1.0))))[:3]
    ['best', 'closures', 'data']
    """
    return json.dumps(figures(fit), indent=2, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def material(fit: Fit, name: str) -> str:
    """A `[[material]]` table of the better kind of sticking, for a case file.

    Parameters
    ----------
    name : str
        Of the material.

    Raises
    ------
    InputError
        If the fitted law can add energy in collisions of the fitted pair: no case would take it.

    Examples
    --------
    >>> from ifrdem import fit
    >>> from pathlib import Path
    >>> _ = Path("data.csv").write_text(fit.example())
    >>> data = fit.read("data.csv", {"angles": 0.7})
    >>> fit.material(fit.fit(data, M=1.0), "coins").splitlines()[0]
    '# Fitted to 18 impacts of data.csv (delta_1, delta_2) by `ifrdem fit`; M = 1, k = 2 and 2.'
    """
    closure = fit.closures[fit.best]
    if not closure.admissibility.admissible:
        raise InputError(
            f"no material is written, because no case would take it: {closure.admissibility.message}"
        )
    chosen = (
        "preferred by the data"
        if fit.decided
        else "not told from the other kind by the data: the paper's choice"
    )
    lines = [
        f"# Fitted to {len(fit.data)} impacts of {fit.data.source} ({', '.join(fit.data.names)}) by `ifrdem fit`; M = "
        f"{fit.pair.M:.6g}, k = {fit.pair.k_1:g} and {fit.pair.k_2:g}.",
        f"# chi2 = {closure.chi2:.4g} for {closure.dof} degrees of freedom, probability {closure.probability:.3g}.",
        *(f"# Warning: {each}" for each in closure.warnings),
        "[[material]]",
        f"name = {json.dumps(name, ensure_ascii=False)}",
    ]
    for key in closure.coefficients:
        each = closure.estimates[key]
        unit = "[length, in the unit of the fitted radii]" if key == "rho" else "[1]"
        value = float(round(each.value, _DIGITS)) if key != "rho" else float(f"{each.value:.{_DIGITS}g}")
        ends = f"{_short(each.interval.low)} to {_short(each.interval.high)}"
        lines.append(f"{key} = {value!r}  # {unit}, 95 % interval {ends}")
    lines.append(f'sticking = "{closure.sticking}"  # {chosen}')
    return "\n".join(lines) + "\n"
