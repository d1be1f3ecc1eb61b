"""Points of a study on the viewer's page: quantities at the end of their runs, curves of each, its trajectories."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..study.results import ENDING, RUNS, SEED, Results, averaged, half_interval
from ..tools.checked import Array
from ..tools.intervals import PERCENT
from .content import numbers

FIRST = ("temperature", "rotational_temperature", "theta")


class StudyPoints:
    """The results of a study, and its folder of runs.

    Parameters
    ----------
    path : Path
        The results NAME.nc, or the folder NAME.runs next to them.

    Raises
    ------
    InputError
        If they are no results of a study, or nothing has been swept.
    """

    def __init__(self, path: Path) -> None:
        if not path.name.endswith((ENDING, RUNS)):
            raise InputError(
                f"{path}: must be the results of a study, NAME{ENDING}, or its folder NAME{RUNS}"
            )
        name = path.name.removesuffix(RUNS).removesuffix(ENDING)
        self._folder = path.with_name(name + RUNS)
        self.path: Path = path.with_name(name + ENDING)
        self._results = Results.read(self.path)
        self._axes = list(self._results.axes)
        if not self._axes or SEED not in self._results.variables:
            raise InputError(f"{self.path}: no key was varied: there are no points to show")
        self._means = averaged(self._results)

    @property
    def _indices(self) -> list[tuple[int, ...]]:
        return list(itertools.product(*(range(len(self._results.values(axis))) for axis in self._axes)))

    def head(self) -> dict[str, Any]:
        """The content except curves of single points, for JSON."""
        it = self._results
        keys = json.loads(it.attributes["keys"])
        ends = {}
        for name in sorted(it.quantities, key=lambda one: FIRST.index(one) if one in FIRST else len(FIRST)):
            if (mean := self._end(name, "mean")) is not None:
                parts = {kind: self._end(name, kind) for kind in ("error", "theory")}
                ends[name] = {"unit": it.variables[f"{name}_mean"].unit, "mean": numbers(mean)} | {
                    kind: numbers(part) for kind, part in parts.items() if part is not None
                }
        runs, failures = it.values("run"), it.values("failure")
        return {
            "title": it.attributes.get("title", self.path.stem),
            "axes": [
                {"name": axis, "key": keys.get(axis, axis), "values": self._values(axis)} for axis in self._axes
            ],
            "ends": ends,
            "seeds": it.values(SEED).tolist(),
            "points": [
                {
                    "index": index,
                    "label": ", ".join(
                        f"{name} = {self._values(name)[i]}"
                        for axis, i in zip(self._axes, index, strict=True) for name in it.axes[axis]
                    ),
                    "runs": [str(run) if self._path(str(run)).is_file() else "" for run in runs[index]],
                    "failures": [str(one) for one in failures[index] if one],
                }
                for index in self._indices
            ],
        }  # fmt: skip

    def _values(self, name: str) -> list[Any]:
        values = self._results.values(name)
        return numbers(values) if values.dtype.kind == "f" else values.tolist()

    def _end(self, name: str, kind: str) -> NDArray[np.float64] | None:
        """A quantity of each point: over its steady window, or at the last known row; None if it has other dimensions.

        An "error" is half the interval of the mean.
        """
        one = self._means.variables.get(f"{name}_{kind}")
        dims = ((*self._axes,), (*self._axes, self._rows))
        if one is None or one.dims not in dims or one.values.dtype.kind not in "iuf":
            return None
        values = half_interval(self._means, name) if kind == "error" else one.values
        assert values is not None  # its errors are there
        return np.array([_last(values[index]) for index in self._indices])

    @property
    def _rows(self) -> str:
        return self._results.row_axis

    def point(self, number: int) -> dict[str, Any]:
        """Curves of a point: means over seeds with bands of their errors, and kinetic theory."""
        if number >= len(self._indices):
            raise InputError(f"point = {number}: there are {len(self._indices)}")
        it, index, rows, charts = self._results, self._indices[number], self._rows, []
        for name in FIRST:
            mean = it.variables.get(f"{name}_mean")
            if mean is None or mean.dims != (*self._axes, rows):
                continue
            half, theory = half_interval(it, name), it.variables.get(f"{name}_theory")
            lines: list[dict[str, Any]] = [
                {"name": f"mean, {PERCENT} interval", "y": numbers(mean.values[index])}
            ]
            if half is not None:
                lines[0]["error"] = numbers(half[index])
            if theory is not None:
                lines.append({"name": "kinetic theory", "y": numbers(theory.values[index]), "dashed": True})
            unit = "" if name == "theta" else mean.unit
            charts.append(
                {"name": f"{name.replace('_', ' ')}, all seeds", "unit": unit, "over": rows.replace("_", " "),
                 "x": numbers(it.values(rows)), "lines": lines}
            )  # fmt: skip
        return {"charts": charts}

    def _path(self, run: str) -> Path:
        return self._folder / f"{Path(run).name}.h5"  # a file may name runs of other folders

    def trajectory(self, run: str) -> Path:
        """The trajectory of a run; InputError if the study has no such run, or kept none of it."""
        if run not in self._results.values("run") or not self._path(run).is_file():
            raise InputError(
                f"run = {run}: the study kept no trajectory of it ([output] trajectories = true keeps them)"
            )
        return self._path(run)


def _last(values: Array) -> float:
    known = np.atleast_1d(values)[np.isfinite(np.atleast_1d(values))]
    return float(known[-1]) if len(known) else float("nan")
