"""Content of the results of a study, as a table for people."""

from __future__ import annotations

import itertools
import os
import textwrap

import numpy as np

from ..errors import printable
from ..plots.style import written
from .results import SEED, Results

ROWS = ("time", "collisions_per_disk")
"""Dimensions of series, of which the last known row is printed."""


def describe(path: str | os.PathLike[str]) -> str:
    """Title, seeds, and a line for each quantity of one number and each point: its mean over seeds and standard error.

    Series have their value at the end of the runs. Raises InputError as `Results.read`.
    """
    results = Results.read(path)
    keys = [key for names in results.axes.values() for key in names]
    lines = [f"{path}: {results.attributes.get('title', 'results of a study')}"]
    lines.append(f"  seeds  {', '.join(map(str, results.values(SEED)))}")
    head = ("quantity", *keys, "mean", "error", "seeds", "unit")
    rows, left_out = [], []
    for name in results.quantities:
        if (found := _rows(results, name)) is None:
            left_out.append(name)
        else:
            rows += found
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines += ["", "  means over seeds at the end of the runs, with standard errors"]
    for row in (head, *rows):
        lines.append(
            "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        )
    if left_out:
        text = f"of more than one number a point (`ifrdem plot`): {', '.join(left_out)}"
        lines += ["", textwrap.fill(text, 110, initial_indent="  ", subsequent_indent="    ")]
    return printable("\n".join(lines))


def _rows(results: Results, name: str) -> list[tuple[str, ...]] | None:
    """Lines of a quantity; None if it has other dimensions than those of points and rows."""
    axes, each = [*results.axes], results.variables.get(name)
    mean, error = (results.variables.get(f"{name}_{kind}") for kind in ("mean", "error"))
    if mean is None or error is None or each is None:
        return None
    rows = [dim for dim in mean.dims if dim in ROWS]
    if mean.dims != (*axes, *rows) or each.dims != (*axes, SEED, *rows) or error.dims != mean.dims:
        return None
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
        numbers = (f"{np.atleast_1d(one.values[at])[last]:.6g}" for one in (mean, error))
        found.append((name, *point, *numbers, str(seeds), written(mean.unit)))
    return found
