"""Content of the results of a study, as a table for people."""

from __future__ import annotations

import itertools
import os
import textwrap

import numpy as np
from numpy.typing import NDArray

from ..errors import option_name, printable
from ..plots.style import written
from ..tools.intervals import FEW, PERCENT
from ..tools.versions import described
from ..trajectory.descriptions import REDUCED
from .results import N_EFF, ROWS, SEED, START, Results, averaged, half_interval, warnings_of

TO = " to "


def describe(path: str | os.PathLike[str], start: float | None = None) -> str:
    """Title, seeds, and a line for each quantity of one number and each point: its mean over seeds and standard error.

    With fewer than 10 seeds half the 95 % interval is printed, too. Series have their value at the end of the runs,
    or with `start` their mean from there on (`averaged`). Raises InputError as `Results.read`, or if no row is as
    late.
    """
    results = Results.read(path)
    series = "at the end of the runs"
    if start is not None:
        results = averaged(results, start, option_name("--from", "start ="))
        series = f"from {start:g} on, in what ends the runs"
    keys = [key for names in results.axes.values() for key in names]
    lines = [f"{path}: {results.attributes.get('title', 'results of a study')}"]
    lines.append(f"  written by {described(results.attributes.get('ifrdem'), results.attributes.get('git'))}")
    lines.append(f"  seeds  {', '.join(map(str, results.values(SEED)))}")
    lines += [f"  ! {line}" for line in warnings_of(results)]
    intervals = len(results.values(SEED)) < FEW
    head = ("quantity", *keys, "mean", "error", *[f"{PERCENT} +-"] * intervals, "seeds", "unit")
    rows, left_out = [], []
    for name in results.quantities:
        if (found := _rows(results, name, intervals)) is None:
            left_out.append(name)
        else:
            rows += found
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    text = f", and half the {PERCENT} interval by Student's t" * intervals
    lines += ["", f"  means over seeds with standard errors{text}; series {series}"]
    lines += _window(results)
    for row in (head, *rows):
        lines.append(
            "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        )
    if left_out:
        text = f"of more than one number a point (`ifrdem plot`): {', '.join(left_out)}"
        lines += ["", textwrap.fill(text, 110, initial_indent="  ", subsequent_indent="    ")]
    return printable("\n".join(lines))


def _window(results: Results) -> list[str]:
    """A line on where averages over time begin, and on n_eff of T; none without such averages."""
    if START not in results.variables or not np.isfinite(results.values(START)).any():
        return []
    unit = results.variables[START].unit
    places = _range(results.values(START))
    places = places if unit in ("", REDUCED) else f"{places} {written(unit)}"
    start = f"from {results.row_axis} = {places} on"
    if TO in places:
        start = (
            f"to the end of each run; where they begin differs between points: {results.row_axis} = {places}"
        )
    n_eff = results.variables.get(f"temperature{N_EFF}")
    of_runs = "" if n_eff is None else f"; n_eff of T in a run: {_range(n_eff.values)}"
    return [f"  analyses over time average {start}{of_runs}"]


def _range(values: NDArray[np.float64]) -> str:
    """ "1.5 to 3", or the one value that there is."""
    return TO.join(dict.fromkeys(f"{one:.3g}" for one in (np.nanmin(values), np.nanmax(values))))


def _rows(results: Results, name: str, intervals: bool) -> list[tuple[str, ...]] | None:
    """Lines of a quantity; None if it has other dimensions than those of points and rows."""
    axes, each = [*results.axes], results.variables.get(name)
    mean, error = (results.variables.get(f"{name}_{kind}") for kind in ("mean", "error"))
    if mean is None or error is None or each is None:
        return None
    rows = [dim for dim in mean.dims if dim in ROWS]
    if mean.dims != (*axes, *rows) or each.dims != (*axes, SEED, *rows) or error.dims != mean.dims:
        return None
    half = half_interval(results, name)
    shown = [mean.values, error.values, *([half] if intervals and half is not None else [])]
    found = []
    for at in itertools.product(*(range(len(results.values(axis))) for axis in axes)):
        known = np.flatnonzero(np.isfinite(np.atleast_1d(mean.values[at])))
        if not len(known):
            continue
        last = known[-1]
        seeds = np.isfinite(each.values[at].reshape(len(results.values(SEED)), -1)[:, last]).sum()
        point = [
            f"{results.values(key)[i]}"
            for i, names in zip(at, results.axes.values(), strict=True)
            for key in names
        ]
        numbers = (f"{np.atleast_1d(one[at])[last]:.6g}" for one in shown)
        found.append((name, *point, *numbers, str(seeds), written(mean.unit)))
    return found
