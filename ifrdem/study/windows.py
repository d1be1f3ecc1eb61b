"""Steady window of each point of a study: one start for all its seeds and all averages over time; and its marks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..analysis.common import mean_errors
from ..analysis.names import OVER_TIME
from ..analysis.result import NOT_STATIONARY, TOO_SHORT
from ..analysis.steadiness import T_CHANGES, beyond_chance, is_stationary
from ..analysis.window import (
    FEWEST_SEEDS,
    LEVEL,
    SHARES,
    WINDOW_SERIES,
    changes_between_seeds,
    since,
    steady_share,
    window_rows,
)
from .task import WARNINGS, WINDOW, Variable

SAME_RUN = "the seeds give the same run: there is no error. Nothing in this case is drawn at random"
RunResult = Mapping[str, Variable]


@dataclass(frozen=True)
class PointWindow:
    """The part of the runs of a point over which averages are taken."""

    start: float = 0.0  # in what ends the runs
    index: int | None = None  # of the dimension `WINDOW` of the results of runs; None where they have none
    marks: list[str] = field(default_factory=list)  # of all runs of the point
    of_runs: dict[int, list[str]] = field(default_factory=dict)  # by seed's place
    effective: dict[int, float] = field(default_factory=dict)  # n_eff of the temperature, by seed's place
    compared: bool = (
        False  # by a comparison of the seeds, which is more certain than what each run says of itself
    )

    def of_run(self, seed: int, result: RunResult) -> dict[str, Variable]:
        """The result of a run in this window, with its marks among its warnings."""
        found = {name: self._chosen(one) for name, one in result.items()}
        lines = str(found[WARNINGS].values).splitlines() if WARNINGS in found else []
        lines = [line for line in lines if not (self.compared and _own_mark(line))]
        if not any(NOT_STATIONARY in line for line in lines):
            lines = [*self.of_runs.get(seed, []), *lines]
        found[WARNINGS] = Variable((), np.array("\n".join((*self.marks, *lines))))
        return found

    def _chosen(self, one: Variable) -> Variable:
        if WINDOW not in one.dims:
            return one
        axis = one.dims.index(WINDOW)
        dims = one.dims[:axis] + one.dims[axis + 1 :]
        return one._replace(dims=dims, values=np.take(one.values, self.index or 0, axis=axis))


def _own_mark(line: str) -> bool:
    """True of a warning of an average over time that several seeds judge better: T changes, or the run is short."""
    return any(line.startswith(f"{name}: {mark}") for name in OVER_TIME for mark in (T_CHANGES, TOO_SHORT))


def window_of(
    row_axis: str, positions: NDArray[np.float64], results: Mapping[int, RunResult], given: float | None,
    species: Sequence[str] = (), *, steady: bool = False,
) -> PointWindow:  # fmt: skip
    """The window of a point from the rows of its runs, by seed's place.

    `given` is the start that the study sets; without it only gases that become `steady` have a window.
    """
    marks = [SAME_RUN] if _alike(results) else []
    windowed = any(WINDOW in one.dims for result in results.values() for one in result.values())
    if given is None and not (windowed or steady):
        return PointWindow(marks=marks)
    rows = _rows(results, species)
    known = np.all([np.isfinite(each).all(axis=0) for each in rows.values()], axis=0)
    index, start = None, given
    if start is None:
        mean = np.stack([each.mean(axis=0)[known] for each in rows.values()], axis=1)
        share = steady_share(positions[known], mean)
        index, start = SHARES.index(share), share * float(positions[-1])
    inside = known & since(positions, start)
    rows = {name: each[:, inside] for name, each in rows.items()}
    effective = {seed: float(mean_errors(T).effective) for seed, T in zip(results, rows["T"], strict=True)}
    of_runs: dict[int, list[str]] = {}
    place = f"{'t' if row_axis == 'time' else 'tau'} = {start:.4g}"
    compared = len(results) >= FEWEST_SEEDS and int(inside.sum()) > 1
    if compared and not marks:
        marks = _marks(rows, place, len(results))
    elif not compared:
        text = f"{NOT_STATIONARY}: T changes from {place} on, and averages over time include that change"
        of_runs = {seed: [text] for seed, T in zip(results, rows["T"], strict=True) if not is_stationary(T)}
    return PointWindow(start, index, marks, of_runs, effective, compared)


def _rows(results: Mapping[int, RunResult], species: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Rows by which the window is found and judged, (seeds, rows) each."""
    recorded = [name for name in WINDOW_SERIES if all(name in result for result in results.values())]
    series = {name: np.stack([result[name].values for result in results.values()]) for name in recorded}
    return window_rows(series, species)


def _marks(rows: Mapping[str, NDArray[np.float64]], place: str, seeds: int) -> list[str]:
    """A line on the quantities that change between the halves of the window by more than chance, or none."""
    if not (changed := beyond_chance(changes_between_seeds(rows), LEVEL)):
        return []
    return [
        f"{NOT_STATIONARY} from {place} on: {changed} from the early to the late half, by {seeds} seeds; "
        "averages over time include that change. Run longer, or begin later (analyses_from)"
    ]


def _alike(results: Mapping[int, RunResult]) -> bool:
    """True if two runs are equal to the last bit in all their numbers."""
    numbers = [
        tuple(
            (name, one.values.tobytes())
            for name, one in sorted(result.items())
            if one.values.dtype.kind in "biuf"
        )
        for result in results.values()
    ]
    return len({*numbers}) < len(numbers)
