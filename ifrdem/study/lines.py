"""Kinetic theory between the swept values of a study, for lines in its figures."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..analysis.gas_theory import FLOW, TheoryGas
from ..analysis.result import identifier
from ..analysis.transport import NAMES as COEFFICIENTS
from ..analysis.window import since
from ..case.case import CaseSections
from ..case.file import CaseFile
from ..case.gas import CaseGas
from ..errors import InputError, TheoryError
from ..theory.choose import is_closed
from ..theory.hydrodynamics import self_diffusion
from ..theory.sonine import cooling_sonine
from .results import (
    EQUILIBRATED,
    SERIES_FROM,
    THEORY,
    Predicted,
    Results,
    gas_of_case,
    predicted,
    row_weights,
    stored_case,
    window_starts,
)

FINE = 41
"""Values between the swept ones at which theory is drawn."""


class TheoryLine(NamedTuple):
    """Values between those of a swept key, and kinetic theory for a quantity at them, nan where it holds not."""

    values: NDArray[np.float64]
    theory: NDArray[np.float64]


class Rows(NamedTuple):
    """Rows of a point: clock, places, where its steady window begins, nan without one, and the latest time [time]."""

    clock: str
    places: NDArray[np.float64]
    start: float
    end: float


def theory_between(results: Results, name: str, x: str, fixed: Mapping[str, int]) -> TheoryLine | str:
    """Theory for a quantity between the values of the swept key `x`, or the reason why it is at those alone.

    It is that of the cases between them: of a series at the last row, or of `averaged` results a mean over rows, from
    a place that is interpolated between those of the swept values. `fixed` are the positions on the other swept
    dimensions.
    """
    if not is_closed():
        return "DSMC is not run between swept values"
    if "path" not in results.attributes:
        return "the results hold no case of their gas"
    if EQUILIBRATED in results.attributes:
        return "runs begin with the ends of others"
    if len(results.axes.get(x, ())) != 1 or results.values(x).dtype.kind not in "if":
        return f"{x} is not one numeric key"
    if (value_of := _function(name)) is None:
        return f"{name} has no closed form between swept values"
    swept, keys = results.values(x), json.loads(results.attributes["keys"])
    if len(swept) < 2:
        return f"{x} has one value"
    row_axis, places = results.row_axis, results.row_places
    at = tuple(fixed.get(dim, slice(None)) for dim in results.axes)
    if name not in THEORY:
        starts = window_starts(results)[at]
    elif SERIES_FROM in results.variables:
        starts = results.values(SERIES_FROM)[at]
    else:
        starts = np.full(len(swept), np.nan)
    times = places if row_axis == "time" else results.values("time_mean")[at]
    low, high = float(swept.min()), float(swept.max())
    space = np.geomspace if low > 0.0 and high > 10.0 * low else np.linspace
    fine = space(low, high, FINE)
    values = np.unique(np.rint(fine)).astype(int) if swept.dtype.kind == "i" else fine
    order, found, reason = np.argsort(swept), [], ""
    for value in values.tolist():
        start = float(np.interp(value, swept[order], starts[order]))
        rows = Rows(row_axis, places, start, float(np.nanmax(times)))
        try:
            found.append(value_of(stored_case(results, fixed, f"{keys[x]}={value}"), rows))
        except (InputError, TheoryError) as error:  # not every value between has an admissible law
            found.append(np.nan)
            reason = str(error).splitlines()[0]
    theory = np.array(found)
    if not np.isfinite(theory).any():
        return reason or f"no theory of {name} between swept values"
    return TheoryLine(np.asarray(values, dtype=float), theory)


_Value = Callable[[CaseFile, Rows], float]


def _function(name: str) -> _Value | None:
    """Kinetic theory of a quantity as a function of a case and rows; None where there is none in closed form."""
    if name in THEORY:
        return lambda file, rows: _of_series(name, file, rows)
    if (of_gas := OF_GAS.get(name)) is not None:
        return lambda file, _: of_gas(_gas(file), file.case)
    if name.startswith((RATIO, THETA)):
        return lambda file, rows: _of_species(name, file, rows)
    return None


def _gas(file: CaseFile) -> TheoryGas:
    gas = gas_of_case(file.case, file.path.parent)
    if gas is None:
        raise InputError("no kinetic theory of this gas")
    return gas


def _of_flow(key: str) -> Callable[[TheoryGas, CaseSections], float]:
    return lambda gas, case: gas.of_flow(case.box.shear_rate)[key].mean


def _of_elastic(key: str) -> Callable[[TheoryGas, CaseSections], float]:
    """Its temperature is that of the start, which a gas without driving keeps."""

    def value(gas: TheoryGas, case: CaseSections) -> float:
        if case.force or case.box.shear_rate:
            raise InputError("the gas is driven: theory takes its measured temperature")
        return gas.enskog(float(gas.T0[0]), spins=bool(gas.T_rot0.any())).get(key, np.nan)

    return value


def _of_smooth(formula: Callable[[float], float]) -> Callable[[TheoryGas, CaseSections], float]:
    def value(gas: TheoryGas, _: CaseSections) -> float:
        return np.nan if (e_n := gas.smooth_restitution) is None else float(formula(e_n))

    return value


OF_GAS: Mapping[str, Callable[[TheoryGas, CaseSections], float]] = {
    **{identifier("stress", key): _of_flow(key) for key in FLOW},
    **{identifier("transport", key): _of_elastic(key) for key in COEFFICIENTS},
    identifier("velocity", "a20"): _of_smooth(cooling_sonine),
    identifier("msd", "D_reduced"): _of_smooth(self_diffusion),
}
"""Numbers of analyses whose theory is a function of the gas alone."""
RATIO, THETA = (identifier("species", key, "") + "_" for key in ("T_ratio", "theta_of"))
"""Beginnings of the names of ratios of temperatures of species."""


def _of_series(name: str, file: CaseFile, rows: Rows) -> float:
    curves = predicted(file.case, file.path.parent, rows.end)
    return np.nan if curves is None else _of_curves(name, curves, rows)


def _of_curves(name: str, curves: Predicted, rows: Rows) -> float:
    """A quantity of `THEORY`, averaged over rows; nan beyond the curves. theta is a mean of ratios, as that of rows."""
    weights = row_weights(rows.places, rows.start)
    T, T_rot = (
        _at(curves, each, rows, weights > 0.0) for each in (curves.temperature, curves.rotational_temperature)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        values = {"temperature": T, "rotational_temperature": T_rot, "theta": T_rot / T}[name]
    return float(np.average(values, weights=weights[weights > 0.0]))


def _at(
    curves: Predicted, values: NDArray[np.float64], rows: Rows, used: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """A curve at the rows that are used, nan beyond its end."""
    base = curves.times if rows.clock == "time" else curves.collisions_per_disk
    return np.asarray(np.interp(rows.places[used], base, values, right=np.nan))


def _of_species(name: str, file: CaseFile, rows: Rows) -> float:
    """A ratio of temperatures of species, the mean of `analyse species`: over the window, or the second half of rows.

    All rows count the same there.
    """
    gas, curves = _gas(file), predicted(file.case, file.path.parent, rows.end)
    species = CaseGas.from_case(file.case, file.path.parent).species
    if curves is None or curves.species is None:
        return np.nan
    steady = since(rows.places, rows.start)
    used = steady if steady.any() else np.arange(len(rows.places)) >= len(rows.places) // 2
    ends = np.cumsum([each.number for each in species])
    T, T_rot = {}, {}
    for each, end in zip(species, ends.tolist(), strict=True):
        kinds = np.bincount(gas.kind[end - each.number : end], minlength=gas.kinds) / each.number
        T[each.name] = _at(curves, curves.species.temperature @ kinds, rows, used)
        T_rot[each.name] = _at(curves, curves.species.rotational_temperature @ kinds, rows, used)
    first = next(iter(T))
    known = {f"{RATIO}{identifier(one)}": T[one] / T[first] for one in T}
    known |= {f"{THETA}{identifier(one)}": T_rot[one] / T[one] for one in T}
    return float(np.mean(known[name])) if name in known else np.nan
