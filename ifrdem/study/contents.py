"""Content of the results of a study, as a table for people and for other programs."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, counted, nearest, option_name, printable
from ..plots.style import written
from ..tools.intervals import FEW, PERCENT
from ..tools.versions import described
from ..trajectory.descriptions import REDUCED
from .draws import COEFFICIENTS
from .pooled import is_drawn, parts_of_interval, pooled
from .results import (
    ADDING,
    BY_COEFFICIENTS,
    N_EFF,
    PARTS,
    ROWS,
    RUN_ERROR,
    SEED,
    SERIES_FROM,
    SHORT,
    START,
    THEORY,
    VELOCITY_WORDS,
    WINDOWED,
    Results,
    averaged,
    half_interval,
    theory_of,
    warnings_of,
)

TO = " to "


class PointMean(NamedTuple):
    """A number of a point: its mean over seeds."""

    quantity: str
    point: tuple[Any, ...]
    mean: float
    error: float
    half: float
    seeds: int
    n_eff: float
    theory: float
    unit: str
    by_coefficients: float = math.nan


def describe(
    path: str | os.PathLike[str], start: float | None = None, *, what: Sequence[str] = (), csv: bool = False
) -> str:
    """Title, seeds, and a line for each number of each point: its mean over seeds and standard error.

    Numbers of analyses stand first, then temperatures and other series: means over the steady window of each point
    (`averaged`), or from `start` on; of gases without a window values at the end of the runs. With fewer than 10 seeds
    half the 95 % interval is printed, too. Drawn coefficients are averaged over, with a column of the standard deviation
    by their errors. `what` chooses quantities by name. With `csv` it is that table alone, with
    every digit. Raises InputError as `Results.read`, or if no row is as late, or there is no such quantity.
    """
    whole = Results.read(path)
    results = averaged(whole, start, option_name("--from", "start ="))
    if is_drawn(results):
        results = pooled(results)
    keys = [key for names in results.axes.values() for key in names]
    chosen = [_known(results, each) for each in what]
    theories = {f"{name}_theory" for name in results.quantities}  # they are a column beside what they are of
    shown_of_all = [name for name in _ordered(results) if name not in theories]
    lines = [line for name in chosen or shown_of_all for line in _lines(results, name, asked=bool(chosen))]
    nothing = [] if chosen else _nothing(lines)
    lines = [line for line in lines if line.quantity not in nothing]
    shown_names = {line.quantity.split(" ")[0] for line in lines}
    for given, name in zip(what, chosen, strict=True):
        if name not in shown_names:
            text = f"`ifrdem plot {path} {given}` draws it"
            raise InputError(f"{given}: has more than one number a point, or no value; {text}")
    if csv:
        return _csv(keys, lines)
    head = [f"{path}: {results.attributes.get('title', 'results of a study')}"]
    head.append(f"  written by {described(results.attributes.get('ifrdem'), results.attributes.get('git'))}")
    head.append(f"  seeds  {', '.join(map(str, results.values(SEED)))}")
    head += [f"  ! {line}" for line in warnings_of(whole)]
    intervals = len(results.values(SEED)) < FEW
    text = f", and half the {PERCENT} interval by Student's t" * intervals
    head += ["", f"  means over seeds with standard errors{text}; {_series(results)}", *_window(whole)]
    if is_drawn(whole):
        head.append(
            _wrapped(
                f"{whole.attributes.get(COEFFICIENTS, COEFFICIENTS)}; by coefficients: {_of_draws(results)}"
            )
        )
    found = [*head, *_printed(keys, lines, intervals=intervals)]
    found += _against_theory(lines, results.attributes.get(VELOCITY_WORDS, ""))
    if nothing:
        found += ["", _wrapped(f"0 in all runs: {', '.join(nothing)}")]
    shown = {line.quantity.split(" ")[0] for line in lines} | {*nothing}
    if left_out := [name for name in results.quantities if name not in {*shown, *theories} and not chosen]:
        text = "not in the table (`ifrdem info FILE NAME`, `ifrdem plot FILE NAME`)"
        found += ["", _wrapped(f"{text}: {', '.join(left_out)}")]
    return printable("\n".join(found))


def _of_draws(results: Results) -> str:
    """Clause on what the standard deviations by coefficients are."""
    if len(results.values(SEED)) == 1:
        return f"standard deviation of {parts_of_interval(results)}: several seeds tell the two apart"
    return "standard deviation of the mean over many seeds, by the errors of coefficients"


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 110, initial_indent="  ", subsequent_indent="    ")


def _nothing(lines: Sequence[PointMean]) -> list[str]:
    """Names of quantities that are 0 at all points, such as the work of walls without walls."""
    zeros: dict[str, bool] = {}
    for line in lines:
        zeros[line.quantity] = zeros.get(line.quantity, True) and line.mean == 0.0 == line.error
    return [name for name, each in zeros.items() if each]


def _against_theory(lines: Sequence[PointMean], velocities: str = "") -> Iterator[str]:
    """Lines on the sum of squares of what means are off kinetic theory, in standard errors, of each quantity.

    p is the probability of that much by chance. Student's t of each point becomes the Gaussian number z of the same
    probability, and the sum of z^2 has the chi-square distribution: with few seeds that of t^2 is larger. `velocities`
    are those that the theory of the gas takes.
    """
    from scipy.special import chdtrc, ndtri, stdtr

    of_quantity: dict[str, list[PointMean]] = {}
    for line in lines:
        if np.isfinite(line.theory) and line.error > 0.0:
            of_quantity.setdefault(line.quantity, []).append(line)
    for i, (name, points) in enumerate(of_quantity.items()):
        t = np.array([abs(line.mean - line.theory) / line.error for line in points])
        count = np.array([line.seeds if line.seeds > 1 else line.n_eff for line in points])
        z = ndtri(stdtr(np.maximum(count - 1.0, 1.0), -t))
        p = float(chdtrc(len(points), np.sum(z**2)))
        if not i:
            yield ""
        words = f" ({velocities})" if velocities and name in THEORY else ""
        yield f"  {name} against kinetic theory{words}: chi2 = {np.sum(t**2):.3g} of {counted(len(points), 'point')}, p = {p:.2g}"


def runs(results: Results) -> dict[str, NDArray[Any]]:
    """Columns with a row for each run: values of the keys, seed, and numbers, with the name of a part behind a space.

    Series are means over the steady window of a run (`averaged`), with NAME_run_error and NAME_n_eff, or their last row
    where it has none. Columns of tables of analyses are left out. Runs that are missing have nan.
    """
    results = averaged(results)
    swept = [*results.axes]
    shape = tuple(len(results.values(dim)) for dim in (*swept, SEED))
    at = np.indices(shape).reshape(len(shape), -1)
    found = {key: results.values(key)[at[i]] for i, dim in enumerate(swept) for key in results.axes[dim]}
    found[SEED] = results.values(SEED)[at[-1]]
    for name in _ordered(results):
        for ending in ("", RUN_ERROR, N_EFF):
            one = results.variables.get(f"{name}{ending}")
            if (
                one is None
                or one.dims[: len(shape)] != (*swept, SEED)
                or {*one.dims[len(shape) :]} - {*PARTS, *ROWS}
            ):
                continue
            values = one.values
            for dim in [dim for dim in one.dims if dim in ROWS]:
                values = values.take(-1, axis=one.dims.index(dim))
            parts = [dim for dim in one.dims if dim in PARTS]
            for part in np.ndindex(values.shape[len(shape) :]):
                labels = [str(results.values(dim)[i]) for dim, i in zip(parts, part, strict=True)]
                column = values[(..., *part)].ravel()
                if not ending or np.isfinite(column).any():
                    found[" ".join((f"{name}{ending}", *labels))] = column
    return found


def _known(results: Results, name: str) -> str:
    """Full name of a quantity; InputError if there is none of this name."""
    full = SHORT.get(name, name)
    if full not in results.quantities:
        known = results.quantities
        text = f"{nearest(name, [*known, *SHORT])}; there are: {', '.join(known)}"
        raise InputError(f"no quantity is called '{name}'{text}")
    return full


def _ordered(results: Results) -> list[str]:
    """Names of quantities: numbers of analyses, temperatures, other series, and last what adds up over the run."""
    return sorted(
        results.quantities,
        key=lambda name: 0 if name in results.texts else 1 if name in THEORY else 3 if name in ADDING else 2,
    )


def _series(results: Results) -> str:
    """Clause on which part of the runs series are of."""
    if SERIES_FROM not in results.variables:
        return "series at the end of the runs"
    starts = results.values(SERIES_FROM)
    end = ", of points without one at the end of the runs" * bool(np.isnan(starts).any())
    return f"series are means from {results.row_axis} = {_place(results, SERIES_FROM)} on{end}"


def _place(results: Results, name: str) -> str:
    unit, places = results.variables[name].unit, _range(results.values(name))
    return places if unit in ("", REDUCED) else f"{places} {written(unit)}"


def _window(results: Results) -> list[str]:
    """A line on where averages over time begin, and on n_eff of T; none without such averages."""
    if START not in results.variables or not np.isfinite(results.values(START)).any():
        return []
    places = _place(results, START)
    start = f"from {results.row_axis} = {places} on"
    if TO in places:
        start = (
            f"to the end of each run; where they begin differs between points: {results.row_axis} = {places}"
        )
    n_eff = results.variables.get(WINDOWED)
    of_runs = "" if n_eff is None else f"; n_eff of T in a run: {_range(n_eff.values)}"
    return [f"  analyses over time average {start}{of_runs}"]


def _range(values: NDArray[np.float64]) -> str:
    """ "1.5 to 3", or the one value that there is."""
    return TO.join(dict.fromkeys(f"{one:.3g}" for one in (np.nanmin(values), np.nanmax(values))))


def _lines(results: Results, name: str, *, asked: bool) -> Iterator[PointMean]:
    """Lines of a quantity, with one for each of its parts; none if it has other dimensions, or adds up and has parts."""
    axes, each = [*results.axes], results.variables.get(name)
    mean, error = (results.variables.get(f"{name}_{kind}") for kind in ("mean", "error"))
    if mean is None or error is None or each is None:
        return
    rows = [dim for dim in mean.dims if dim in ROWS]
    parts = [dim for dim in mean.dims if dim in PARTS]
    if (
        mean.dims != (*axes, *rows, *parts)
        or each.dims != (*axes, SEED, *rows, *parts)
        or error.dims != mean.dims
    ):
        return
    if parts and name in ADDING and not asked:
        return
    half, theory = half_interval(results, name), theory_of(results, name)
    spread = results.variables.get(f"{name}{BY_COEFFICIENTS}")
    n_eff = results.variables.get(f"{name}{N_EFF}")
    sizes = [range(len(results.values(dim))) for dim in (*axes, *parts)]
    for at in itertools.product(*sizes):
        point, part = at[: len(axes)], at[len(axes) :]
        along: Any = (*point, *[slice(None)] * len(rows), *part)
        known = np.flatnonzero(np.isfinite(np.atleast_1d(mean.values[along])))
        if not len(known):
            continue
        last = known[-1]

        def number(values: NDArray[Any] | None, place: Any = along, last: int = last) -> float:
            return np.nan if values is None else float(np.atleast_1d(values[place])[last])

        runs: Any = (*point, slice(None), *[slice(None)] * len(rows), *part)
        finite = np.isfinite(each.values[runs].reshape(len(results.values(SEED)), -1)[:, last])
        of_runs = np.full(1, np.nan) if rows or n_eff is None else n_eff.values[runs][finite]
        labels = [str(results.values(dim)[i]) for dim, i in zip(parts, part, strict=True)]
        keys = [
            results.values(key)[i]
            for i, names in zip(point, results.axes.values(), strict=True)
            for key in names
        ]
        yield PointMean(
            " ".join((name, *labels)), tuple(keys), number(mean.values), number(error.values), number(half),
            int(finite.sum()), float(np.mean(of_runs)),
            number(None if theory is None or theory.dims != mean.dims else theory.values), mean.unit,
            number(None if spread is None else spread.values),
        )  # fmt: skip


def _printed(keys: Sequence[str], lines: Sequence[PointMean], *, intervals: bool) -> Iterator[str]:
    """The table in columns; of n_eff and theory only if a line has some."""
    of_windows, of_theory, of_draws = (
        any(np.isfinite(getattr(line, name)) for line in lines)
        for name in ("n_eff", "theory", "by_coefficients")
    )
    columns = [
        ("quantity", lambda line: line.quantity),
        *((key, lambda line, i=i: str(line.point[i])) for i, key in enumerate(keys)),
        ("mean", lambda line: f"{line.mean:.6g}"),
        ("error", lambda line: f"{line.error:.6g}"),
        *[(f"{PERCENT} +-", lambda line: f"{line.half:.6g}")] * intervals,
        *[("by coefficients", lambda line: _or_dash(line.by_coefficients, ".6g"))] * of_draws,
        ("seeds", lambda line: str(line.seeds)),
        *[("n_eff", lambda line: _or_dash(line.n_eff, ".3g"))] * of_windows,
        *[("theory", lambda line: _or_dash(line.theory, ".6g"))] * of_theory,
        ("unit", lambda line: written(line.unit)),
    ]
    rows = [[name for name, _ in columns], *([text(line) for _, text in columns] for line in lines)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()


def _or_dash(value: float, form: str) -> str:
    return f"{value:{form}}" if np.isfinite(value) else "-"


def _csv(keys: Sequence[str], lines: Iterable[PointMean]) -> str:
    """The table with every digit, nothing where there is no number."""
    held = io.StringIO()
    writer = csv.writer(held, lineterminator="\n")
    lines = list(lines)
    more = ["by_coefficients"] * any(np.isfinite(line.by_coefficients) for line in lines)
    writer.writerow(
        ("quantity", *keys, "mean", "error", "half_interval_95", "seeds", "n_eff", "theory", *more, "unit")
    )
    for line in lines:
        numbers = [line.mean, line.error, line.half, line.seeds, line.n_eff, line.theory]
        numbers += [line.by_coefficients] * len(more)
        shown = ["" if each != each else repr(each) for each in numbers]
        writer.writerow((line.quantity, *map(str, line.point), *shown, line.unit))
    return held.getvalue().rstrip("\n")
