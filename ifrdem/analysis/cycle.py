"""Phases of walls that move to and fro: means of series, and groups of frames, at each phase of the period.

The phase of a wall is 0 at t = 0 of its motion, and 1 after a period, whatever the phase that its formula has: that of
the first such wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..quantities import CENTER_SERIES, REGION_SERIES, SERIES
from ..tools.checked import Array, Column, Integer, Numbers, Positive, Real, validated
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from ..trajectory.reader import Trajectory
from . import result as stored
from .common import MeanValue, mean_errors, mean_with_error
from .result import Columns, Evaluation, Reading, all_frames, times, unit
from .window import steady_frames

PHASES = 20
"""Phases by default, if the rows have not got fewer."""
MOST_PHASES, FEWEST_PHASES = 1000, 3
SHOWN = ("temperature", "rotational_temperature", "energy", *CENTER_SERIES, *REGION_SERIES)
"""Quantities of series whose means are taken: those that are no sums since the start."""
ALIKE = 1e-3
"""Of a period, the difference of phases that are one."""


@dataclass(frozen=True, eq=False, repr=False)
class Cycle(Brief, ResultPlot):
    """Means of a series at phases of a periodic motion.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> t = np.arange(80) / 8.0
    >>> found = analysis.phase_average(t, 3.0 + 2.0 * np.cos(2.0 * np.pi * t), period=1.0)
    >>> round(found.whole.mean, 6), round(found.amplitude.mean, 6)
    (3.0, 2.0)
    """

    phase: Array
    """Middles of the phases, from 0 to 1, shape (p,)."""
    mean: Array
    error: Array
    n_eff: Array
    """mean, error, n_eff: over periods, the standard error, and the number of periods with that error, shape (p,)."""
    periods: int
    """Periods that have a row at each phase."""

    whole: MeanValue
    """Mean over the periods, with its error."""
    amplitude: MeanValue
    """Of the first harmonic, with the error of its projections on its phase; nan with fewer than 3 phases."""
    maximum: float
    """Phase at which the first harmonic has its maximum, 0 to 1."""


@validated
def phase_average(
    time: Column,
    series: Annotated[ArrayLike, Numbers(("rows",))],
    *,
    period: Positive,
    begin: Real = 0.0,
    phases: Annotated[int, Integer(1, MOST_PHASES)] | None = None,
) -> Cycle:
    """Means of a series at phases of a period, with errors by the scatter over periods, which may be correlated.

    Parameters
    ----------
    time, series : array (rows,)
        Rising times [time], and the values there.
    period, begin : float
        Period, and a time at which the phase is 0 [time].
    phases : int, optional
        Phases, each a part of the period about its middle k / phases; by default 20, or the number of different phases
        that the rows have, if that is less.

    Raises
    ------
    InputError
        If times do not rise, or fewer than two periods have a row at each phase.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> t = np.arange(80) / 8.0
    >>> found = analysis.phase_average(t, np.sin(2.0 * np.pi * t), period=1.0)
    >>> found.phase[:3].tolist(), (found.mean[:3].round(3) + 0.0).tolist(), found.periods
    ([0.0, 0.125, 0.25], [0.0, 0.707, 1.0], 10)
    """
    t, x = np.asarray(time, dtype=float), np.asarray(series, dtype=float)
    if len(t) != len(x) or not np.all(np.diff(t) > 0.0):
        raise InputError(f"time: must be {len(x)} times, each later than the one before, as series has rows")
    place = (t - begin) / period
    number = default_phases(place) if phases is None else phases
    at = np.floor(place * number + 0.5).astype(np.int64)
    turn, which = np.divmod(at, number)
    first = int(turn.min())
    sums, count = np.zeros((2, int(turn.max()) - first + 1, number))
    np.add.at(sums, (turn - first, which), x)
    np.add.at(count, (turn - first, which), 1.0)
    whole = np.all(count > 0.0, axis=1)
    if np.count_nonzero(whole) < 2:
        raise InputError(
            f"{np.count_nonzero(whole)} periods have a row at each of {number} phases: must be 2 or more; "
            "output.series_phases = 8 stores rows at 8 phases of each period"
        )
    of_periods = sums[whole] / count[whole]
    error, n_eff = mean_errors(of_periods)
    phase = np.arange(number) / number
    harmonic = 2.0 / number * of_periods @ np.exp(2.0j * np.pi * phase)
    angle = float(np.angle(harmonic.mean()))
    amplitude = mean_with_error((harmonic * np.exp(-1.0j * angle)).real)
    if number < FEWEST_PHASES:
        amplitude, angle = MeanValue(np.nan, np.nan, np.nan), np.nan
    return Cycle(
        phase, of_periods.mean(axis=0), error, n_eff, len(of_periods), mean_with_error(of_periods.mean(axis=1)),
        amplitude, angle / (2.0 * np.pi) % 1.0,
    )  # fmt: skip


def default_phases(place: Array) -> int:
    """Number of different phases of rows at these places in periods, up to 20."""
    phase = np.sort(place % 1.0)
    new = np.diff(phase, append=phase[0] + 1.0) > ALIKE
    return int(np.clip(np.count_nonzero(new), 1, PHASES))


def motion_of(trajectory: Trajectory) -> tuple[float, float]:
    """Period of the walls that move to and fro, and a time at which the first one has the phase 0 [time].

    InputError if there are none, or several frequencies.
    """
    found: dict[float, float] = {}
    for wall in trajectory.walls:
        for each in (wall.motion, wall.turn):
            if getattr(each, "frequency", 0.0) > 0.0 and each.kind in ("sine", "sawtooth"):
                found.setdefault(each.frequency, wall.moves_from or 0.0)
    if len(found) != 1:
        several = f"the walls of this one have the frequencies {', '.join(f'{each:g}' for each in found)}"
        none = "no wall of this one does"
        raise InputError(
            "phases are those of walls that move or turn to and fro with one frequency: "
            f"{several if found else none}"
        )
    ((frequency, begin),) = found.items()
    return 1.0 / frequency, begin


def frames_at_phases(
    trajectory: Trajectory, used: Sequence[int], phases: int
) -> tuple[Array, list[list[int]]]:
    """The phases k / phases, and the frames of each; InputError if one has none."""
    period, begin = motion_of(trajectory)
    place = (trajectory.times[list(used)] - begin) / period
    which = np.floor(place * phases + 0.5).astype(np.int64) % phases
    groups = [[frame for frame, each in zip(used, which, strict=True) if each == k] for k in range(phases)]
    if empty := [k for k, each in enumerate(groups) if not each]:
        raise InputError(
            f"phases = {phases}: no frame is at phase {empty[0]}/{phases}; output.frames_phases = {phases} stores "
            "frames at these"
        )
    return np.arange(phases) / phases, groups


def frames_in_windows(
    trajectory: Trajectory, used: Sequence[int], windows: int
) -> tuple[Array, list[list[int]]]:
    """Middles of equal windows of time [time], and the frames in each; InputError if one has none."""
    t = trajectory.times[list(used)]
    edges = np.linspace(t[0], t[-1], windows + 1)
    which = np.clip(np.searchsorted(edges, t, "right") - 1, 0, windows - 1)
    groups = [[frame for frame, each in zip(used, which, strict=True) if each == k] for k in range(windows)]
    if not all(groups):
        raise InputError(
            f"windows = {windows}: must be {len(used)} or fewer, and have a frame each: there are {len(used)} frames"
        )
    return 0.5 * (edges[1:] + edges[:-1]), groups


# -- of a trajectory ---------------------------------------------------------------------------------------


def of_cycle(trajectory: Trajectory, frames: Sequence[int] | None) -> Evaluation:
    period, begin = motion_of(trajectory)
    series = trajectory.series
    used = all_frames(trajectory, steady_frames(trajectory, frames))
    span = times(trajectory, used)
    inside = (series.time >= span[0]) & (series.time <= span[1])
    inside[1:] &= np.diff(series.time) > 0.0
    when = series.time[inside]
    if len(when) < 2:
        raise InputError(f"{trajectory.path}: must have two rows of the series or more within the frames")
    results: dict[str, Cycle] = {}
    rows: list[Reading] = [Reading("period", period, unit=unit(trajectory, "time"))]
    table: Columns = {}
    for name, values in _quantities(trajectory, inside).items():
        found = results[name] = phase_average(when, values, period=period, begin=begin)
        quantity = name.partition("/")[0]
        of = unit(trajectory, _UNITS[SERIES[quantity].dimension])
        rows += [
            Reading.of(f"{name}, mean", found.whole, of, f"{name}_cycle_mean"),
            Reading.of(f"{name}, amplitude", found.amplitude, of, f"{name}_amplitude"),
            Reading(f"{name}, phase of the maximum", found.maximum, key=f"{name}_phase"),
        ]
        table |= {"phase": found.phase, name: found.mean, f"{name} error": found.error}
        table[f"{name} n_eff"] = found.n_eff
    some = next(iter(results.values()))
    notes = [
        f"means over {some.periods} periods at {len(some.phase)} phases; the phase is 0 at t = {begin:g} and each "
        "period after it; amplitudes and maxima are those of the first harmonic"
    ]
    notes += stored.few_rows(some.periods, "periods")
    return Evaluation(results, rows, {"": table}, notes, span)


_UNITS = {"energy": "energy", "length": "length", "mass": "mass", "1": "1"}
"""Units of the dimensions of `SHOWN`."""


def _quantities(trajectory: Trajectory, inside: NDArray[np.bool_]) -> dict[str, Array]:
    """Columns of the series by name, NAME/COLUMN of those with several, that change."""
    series = trajectory.series
    found: dict[str, Array] = {}
    for name in SHOWN:
        if name not in series:
            continue
        values = np.asarray(series[name], dtype=float)[inside]
        if name in CENTER_SERIES:  # along periodic sides a mean of wrapped places says nothing
            values = np.where(trajectory.box.periodic, 0.0, values)
        names = series.columns(name) or (("x", "y") if values.ndim > 1 else ())
        columns = {f"{name}/{one}": values[:, i] for i, one in enumerate(names)} if names else {name: values}
        found |= {label: each for label, each in columns.items() if np.ptp(each) > 0.0}
    if not found:
        raise InputError(f"{trajectory.path}: no quantity of its series changes")
    return found
