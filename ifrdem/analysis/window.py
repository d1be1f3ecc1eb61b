"""Steady window of a run: from where on averages over a run are taken, and whether the gas is steady there.

A gas that is driven, sheared or between walls begins with a transient, which is left out: the run is divided into
eighths, and averages begin at the first of 0, 1/8, ..., 1/2 of it that is not before twice the start that MSER-5 finds
(K. P. White, Simulation 69, 323 (1997), doi:10.1177/003754979706900601). A gas that cools freely has no steady part.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..quantities import COMPONENTS, SPECIES_SERIES, STRESS_SERIES
from ..tools.checked import Array
from ..trajectory.reader import Trajectory
from .result import FramesFrom, all_frames
from .steadiness import Change

PARTS = 8
"""Parts of a run; the window begins at one of their ends, so that few windows are to be analysed."""
SHARES = tuple(part / PARTS for part in range(PARTS // 2 + 1))
"""Parts of a run at which its window may begin: half of it at most is left out."""
BATCH, FEWEST_BATCHES = 5, 4
"""Rows in a batch; batches below which nothing is known, and the window is the second half."""
DRIVES = ("energy_input", "wall_work", "wall_heat")
"""Whole-gas quantities that are 0 in a gas that is not driven."""
LEVEL = 0.01
"""Share of steady points of a study that are marked as not steady."""
WINDOW_SERIES = ("temperature", "rotational_temperature", *SPECIES_SERIES[:2], STRESS_SERIES[0])
"""Series by which the window is found and judged (`window_rows`)."""
FEWEST_SEEDS = 3
"""Seeds below which runs are not compared with each other, but each with itself."""


def mser_row(rows: Array) -> int:
    """Row from which series are taken as steady, (n,) or (n, quantities): 2 x MSER-5, at most half of the rows.

    Of the means of 5 rows b_1, ..., b_k, MSER-5 leaves out the first d <= k / 2 for which var(b_d+1, ..., b_k) /
    (k - d) is smallest. Of several quantities the sum of these counts, each in parts of its value at d = k / 2. Twice
    as much is left out, because the minimum lies where a transient has fallen to the noise, but is still there.
    """
    x = np.asarray(rows, dtype=float).reshape(len(rows), -1)
    half, k = len(x) // 2, len(x) // BATCH
    if k < FEWEST_BATCHES:
        return half
    means = x[: k * BATCH].reshape(k, BATCH, -1).mean(axis=1)
    variance = np.array([means[d:].var(axis=0) / (k - d) for d in range(k // 2 + 1)])
    with np.errstate(over="ignore"):
        relative = variance / np.where(variance[-1] > 0.0, variance[-1], np.finfo(float).tiny)
    return min(2 * BATCH * int(np.argmin(relative.sum(axis=1))), half)


def steady_share(place: Array, rows: Array) -> float:
    """Part of a run before its steady window, one of `SHARES`.

    `place` are the times of rows, or collisions per disk, rising, shape (n,); `rows` as of `mser_row`. Rows that are
    not even there, as with logarithmic spacing, are interpolated at even places.
    """
    steps = np.diff(place)
    if len(steps) and np.ptp(steps) > 0.5 * np.mean(steps):
        even = np.linspace(place[0], place[-1], len(place))
        columns = np.asarray(rows, dtype=float).reshape(len(place), -1).T
        rows = np.stack([np.interp(even, place, column) for column in columns], axis=1)
    share = mser_row(rows) / max(len(place) - 1, 1)
    return min(math.ceil(PARTS * share - 1e-9) / PARTS, SHARES[-1])


def changes_between_seeds(quantities: Mapping[str, Array]) -> list[Change]:
    """Change of each quantity from the early to the late half of the window, by Student's t over seeds.

    `quantities` are rows within the window, (seeds, rows), of 3 seeds or more and 2 rows or more. Of each seed the mean
    over the late half less that over the early half is one value: seeds are independent, so that nothing is assumed of
    correlations over time.
    """
    found = []
    for what, rows in quantities.items():
        middle = rows.shape[1] // 2
        early, late = rows[:, :middle].mean(axis=1), rows[:, -middle:].mean(axis=1)
        change = late - early
        error = float(np.std(change, ddof=1)) / math.sqrt(len(change))
        t = float(change.mean()) / error if error > 0.0 else math.nan
        found.append(Change(what, float(early.mean()), float(late.mean()), t, len(change) - 1))
    return found


def window_rows(series: Mapping[str, Array], species: Sequence[str] = ()) -> dict[str, Array]:
    """Rows by which the window is found and judged, (..., rows) each, with "T" among them.

    `series` are quantities of the whole gas by name, (..., rows) or with columns (..., rows, columns), of which these
    count, where they change: T and T_rot of the gas and of each of the `species`, whose ratios may relax while T does
    not change, and the pressure tensor, xx, xy, yx, yy of means from one row to the next. The first row of that, before
    which nothing is, counts as the second one does.
    """
    of_gas = {"T": "temperature", "T_rot": "rotational_temperature"}
    found = {symbol: series[name] for symbol, name in of_gas.items() if name in series}
    for name, symbol in zip(SPECIES_SERIES[:2], ("T", "T_rot"), strict=True):
        if name in series:
            found |= {f"{symbol} of {each}": series[name][..., i] for i, each in enumerate(species)}
    if STRESS_SERIES[0] in series and found["T"].shape[-1] > 1:
        stress = series[STRESS_SERIES[0]]
        filled = np.concatenate((stress[..., 1:2, :], stress[..., 1:, :]), axis=-2)
        found |= {f"P_{name}": filled[..., i] for i, name in enumerate(COMPONENTS) if name != "yx"}
    return {name: rows for name, rows in found.items() if name == "T" or np.any(rows != rows[..., :1])}


def is_driven(trajectory: Trajectory) -> bool:
    """True if energy enters or leaves the gas otherwise than by collisions of disks."""
    return any_drives((trajectory.series, trajectory.observables))


def any_drives(quantities: Iterable[Mapping[str, Any]]) -> bool:
    """True if one of `DRIVES` is not 0 among quantities by name; values that are nan do not count."""
    return any(
        name in each and bool(np.nan_to_num(each[name]).any()) for each in quantities for name in DRIVES
    )


def becomes_steady(shear_rate: float, *, walled: bool, driven: bool) -> bool:
    """True of gases that are driven, sheared or between walls; others cool freely, or nothing changes in them."""
    return shear_rate != 0.0 or walled or driven


def has_window(trajectory: Trajectory) -> bool:
    """`becomes_steady` of the gas of a trajectory."""
    walled = not trajectory.box.is_open and bool(trajectory.free_area.all_walls)
    walled |= bool(trajectory.walls)
    return becomes_steady(trajectory.box.shear_rate, walled=walled, driven=is_driven(trajectory))


def ends_at_collisions(trajectory: Trajectory) -> bool:
    """True if the case of the run ends it at a number of collisions per disk, not at a time."""

    def at_collisions(case: Any) -> bool:
        return case.get("run", {}).get("collisions_per_disk") is not None

    return trajectory.record("case_in_full", at_collisions, "{}")


def frames_from(trajectory: Trajectory, place: float, name: str) -> FramesFrom:
    """Frames from a place on: a time [time], or collisions per disk if the run ends at a number of these.

    `name` is that of the option or key for messages. Raises InputError if no frame is as late.
    """
    all_frames(trajectory, None)  # raises InputError if there is none
    time, what = place, "t"
    if ends_at_collisions(trajectory):
        what = "collisions_per_disk"
        rows = trajectory.series if "collisions" in trajectory.series else trajectory.observables
        when = trajectory.series.time if rows is trajectory.series else trajectory.times
        time = float(when[since(rows[what], place)].min(initial=math.inf))
    slack = 1e-12 * float(np.ptp(trajectory.times))
    found = np.flatnonzero(trajectory.times >= time - slack)
    if not len(found):
        last = trajectory.observables[what][-1] if what != "t" else trajectory.times[-1]
        raise InputError(f"{name} {place:g}: must be before the end of the run, {what} = {last:g}")
    return FramesFrom(found.tolist(), time, f"{what} = {place:.4g}")


def since(places: Array, start: float) -> NDArray[np.bool_]:
    """True of places from a start on, shape (n,); a difference by rounding does not count."""
    return np.asarray(places >= start * (1.0 - 1e-12))


def steady_starts(trajectory: Trajectory) -> list[FramesFrom]:
    """Frames from each place at which the steady window may begin, those of `SHARES`."""
    place, _ = _rows(trajectory)
    ends = float(place[0]), float(place[-1])
    return [frames_from(trajectory, ends[0] + share * (ends[1] - ends[0]), "from") for share in SHARES]


def steady_frames(trajectory: Trajectory, frames: Sequence[int] | None) -> Sequence[int] | None:
    """The chosen frames; without a choice those of the steady window; None if the gas has none, or T is not stored."""
    if frames is not None or len(trajectory) < 2 or not has_window(trajectory):
        return frames
    place, rows = _rows(trajectory)
    if len(place) < 2:
        return None
    share = steady_share(place, np.stack([*rows.values()], axis=1))
    return steady_starts(trajectory)[SHARES.index(share)]


def _rows(trajectory: Trajectory) -> tuple[Array, dict[str, Array]]:
    """Places of rows of the run, times or collisions per disk, and `window_rows`; empty without T."""
    series = trajectory.series
    in_series = "temperature" in series and len(series.time) > 1
    rows = series if in_series else trajectory.observables
    if "temperature" not in rows:
        return np.zeros(0), {}
    place = series.time if in_series else trajectory.times
    if ends_at_collisions(trajectory):
        place = rows["collisions_per_disk"]
    names = WINDOW_SERIES if in_series else WINDOW_SERIES[:2]
    species = rows.columns(SPECIES_SERIES[0]) if in_series and SPECIES_SERIES[0] in rows else ()
    found = window_rows({name: np.asarray(rows[name], float) for name in names if name in rows}, species)
    rising = np.concatenate(([True], np.diff(place) > 0.0))
    return np.asarray(place, float)[rising], {name: each[rising] for name, each in found.items()}
