"""Test of stationarity: averages over the first half of the frames compared with the second half.

Frames that follow each other closely show nearly the same gas, and by how much they differ says little of how sure a
mean is. So a difference is compared not with the scatter over frames, but with that over parts of the gas which
know little of each other and are each compared with themselves: disks, cells of the box, modes. However long a part
remembers, its differences between the halves have the mean 0 in a steady gas.

The mean difference over its standard error is then as Student's t, by the central limit theorem for cells and modes, of
which there are few. A mark is set beyond the two-sided level of 3 standard errors of a Gaussian, 0.27 %, divided by the
number of quantities that an analysis compares (Bonferroni). So at most 0.27 % of analyses of a steady gas have one, as
long as its correlations are shorter than a cell, which in a dense or driven gas they need not be.

In 2000 elastic disks at packing fraction 0.3, 25 stretches of 20 frames 0.25 collisions per disk apart, the rms of t
was 0.5 to 0.9 for neighbours and velocities, 1.2 and 1.3 for S and psi_6 where Student's t has 1.03 and 1.02;
none had a mark.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..model.box import Box
from ..tools.checked import Array
from ..tools.intervals import student_t
from ..trajectory.reader import Trajectory
from .common import LEVEL, MeanValue, cells_of
from .cooling import correlated, noise_about_parabola
from .result import NOT_STATIONARY

CELLS, DISKS = (5, 32), 40
"""Cells along a side of the box at least (24 degrees of freedom) and at most; disks that a cell has between: its side
is some 10 diameters at packing fraction 0.3, where pairs know of each other over 2 or 3."""
MODES = 32
ROUNDING = 1e-6
"""Relative change that may be rounding: g(r) and psi_6 are found in single precision, S(k) to 1e-9 of its largest."""


def is_stationary(T: Array) -> bool:
    """True if T changes by at most a tenth over the rows, or by no more than its noise explains.

    Two changes are looked at: that of the straight line of least squares through all rows, and that from the mean of
    the first tenth to the mean of the last half (J. Geweke, in Bayesian Statistics 4, Oxford 1992). The noise is that
    of the quieter half about its own parabola (`cooling.noise_about_parabola`), with the correlation rho^|lag|, because
    rows closer than the gas remembers are not independent. A change is no noise beyond half the level `LEVEL` of
    Student's t with n_eff - 3 degrees of freedom of that half, 3 at least.
    """
    n = len(T)
    T = np.asarray(T, dtype=float)
    if n < 2 or np.ptp(T) == 0.0:
        return True
    place = np.arange(n) - 0.5 * (n - 1)
    line = np.asarray(place * ((n - 1) / float(place @ place)), dtype=float)

    def is_small(change: float, noise: float) -> bool:
        return abs(change) <= max(0.1 * (float(np.mean(T)) + 0.5 * abs(change)), noise)

    if n < FEWEST_CHANGES:
        noise = float(np.mean(np.diff(T, 2) ** 2)) / 6.0 if n > 2 else 0.0
        return is_small(float(line @ T), 3.0 * math.sqrt(12.0 * noise * (n - 1) / (n * (n + 1))))
    halves_of = [noise_about_parabola(part) for part in (T[n // 2 :], T[: n - n // 2])]
    rho, variance, effective = min(halves_of, key=lambda each: each[1])
    early = np.zeros(n)
    early[: max(n // 10, 1)], early[n // 2 :] = -1.0 / max(n // 10, 1), 1.0 / (n - n // 2)
    beyond = float(student_t(max(effective - 2.0, 4.0), 1.0 - 0.5 * LEVEL))
    errors = (
        math.sqrt(variance * float(each @ correlated(each[:, None], rho)[:, 0])) for each in (line, early)
    )
    return all(
        is_small(float(each @ T), beyond * error) for each, error in zip((line, early), errors, strict=True)
    )


FEWEST_CHANGES = 8
"""Rows below which nothing is known of the correlation of their noise: second differences then stand for it."""


def stationarity_warning(trajectory: Trajectory, T: Array) -> str:
    """Warning that the temperature changes, from its first value to its last [energy]."""
    first, last = (trajectory.with_unit(f"{one:.4g}", "energy") for one in (T[0], T[-1]))
    return f"{T_CHANGES} from {first} to {last} in that time"


T_CHANGES = f"{NOT_STATIONARY}: T goes"
"""Beginning of that warning."""


class Change(NamedTuple):
    """A quantity in the first and the second half of the frames, and their difference over its standard error."""

    what: str
    early: float
    late: float
    t: float
    degrees: float


def halves(used: Sequence[int]) -> tuple[list[int], list[int]]:
    """The first and the second half of some frames, two or more."""
    middle = len(used) // 2
    return list(used[:middle]), list(used[middle:])


def warnings(changes: Sequence[Change]) -> list[str]:
    """Warn of quantities that change by more than chance; return none or one line."""
    if not (changed := beyond_chance(changes, LEVEL)):
        return []
    return [
        f"{NOT_STATIONARY}: {changed} from the first half of these frames to the second; the means "
        "average over that change, and their errors do not include it. Choose other frames"
    ]


def beyond_chance(changes: Sequence[Change], level: float) -> str:
    """Text of the changes that are more than chance, by Student's t; empty without any.

    `level` is the probability that chance alone gives such a text, at most.
    """
    return ", ".join(
        f"{one.what} goes from {one.early:.3g} to {one.late:.3g} "
        f"({f'{abs(one.t):.1f} standard errors' if math.isfinite(one.t) else 'each is constant'})"
        for one in changes
        if not math.isnan(one.t) and abs(one.t) > student_t(one.degrees + 1, 1.0 - level / len(changes))
    )


def between(what: str, early: MeanValue, late: MeanValue) -> Change:
    """Two values with standard errors and n_eff; where the halves are correlated, they differ by less than these say.

    The degrees of freedom of t are those of B. L. Welch, Biometrika 34, 28 (1947), doi:10.1093/biomet/34.1-2.28, from
    n_eff - 1 of each half, 1 at least: the number of rows says nothing of them.
    """
    squares = np.array([early.error, late.error]) ** 2
    own = np.maximum(np.array([early.n_eff, late.n_eff]) - 1.0, 1.0)
    error = float(np.sqrt(squares.sum()))
    degrees = float(squares.sum() ** 2 / np.sum(squares**2 / own)) if error > 0.0 else 1.0
    return _change(what, early.mean, late.mean, error, degrees)


def _change(what: str, early: float, late: float, error: float, degrees: float) -> Change:
    """A change with its standard error, nan if it is not known; what may be rounding has t = 0.

    A change from one constant to another one has no error, and is no chance.
    """
    change = late - early if abs(late - early) > ROUNDING * max(abs(early), abs(late)) else 0.0
    if error == 0.0 and change:
        return Change(what, early, late, math.copysign(math.inf, change), degrees)
    return Change(what, early, late, change / error if error > 0.0 else math.nan, degrees)


def between_cells(what: str, values: Sequence[Array], positions: Sequence[Array], box: Box) -> Change:
    """Means over disks of values, one array (n,) a frame, compared in each cell of the box; positions [length]."""
    side = int(np.clip(np.sqrt(len(values[0]) / DISKS), *CELLS))
    sums, counts = np.zeros((2, side**2)), np.zeros((2, side**2))
    for half, frames in enumerate(halves(range(len(values)))):
        for i in frames:
            where = cells_of(positions[i], box, side)
            sums[half] += np.bincount(where, values[i], minlength=side**2)
            counts[half] += np.bincount(where, minlength=side**2)
    total = counts.sum(axis=1)
    mean = sums.sum(axis=1) / total
    # What cells add to the ratio of the sums, to first order: more disks in a cell are no change by themselves.
    parts = (sums - mean[:, None] * counts) / total[:, None]
    parts = parts[:, counts.any(axis=0)]  # cells above a heap carry no information on its scatter
    cells = parts.shape[1]
    error = float(np.std(parts[1] - parts[0], ddof=1) * np.sqrt(cells)) if cells > 1 else math.nan
    return _change(what, float(mean[0]), float(mean[1]), error, cells - 1)


def between_modes(what: str, intensities: Sequence[Array]) -> Change:
    """Means over modes of intensities, one array (modes,) a frame.

    Each mode counts with its difference over its sum, which no single strong mode rules, and whose mean is 0 in a
    steady gas whatever S(k) is.
    """
    early, late = (
        np.mean([intensities[i] for i in frames], axis=0) for frames in halves(range(len(intensities)))
    )
    share = (late - early) / (late + early)
    error = float(np.std(share, ddof=1) / np.sqrt(len(share)))
    change = float(share.mean()) if abs(share.mean()) > ROUNDING else 0.0
    t = change / error if error > 0.0 else float("nan")
    return Change(what, float(early.mean()), float(late.mean()), t, len(share) - 1)
