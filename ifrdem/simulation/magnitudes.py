"""Whether the numbers of a gas can be computed with at all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.box import Box
from ..model.state import Disks

MOST_COEFFICIENT = {"f32": 1e30, "f64": 1e100}
"""Largest coefficient of a law: products of it with impulses and masses are formed."""


def fastest(disks: Disks, velocity: NDArray[np.float64], spin: NDArray[np.float64]) -> float:
    """The largest velocity component or R |omega| of disks [length/time]; 0 without disks."""
    return float(max(np.abs(velocity).max(initial=0.0), (np.abs(spin) * disks.radius).max(initial=0.0)))


def check(disks: Disks, box: Box, speed: float, precision: str, hottest: float = 0.0) -> None:
    """Refuse units in which numbers that the kernels form would leave the range of their type, silently.

    Squares of discriminants and inverse inertias go furthest; times must stay below FAR (`kernels/layout.py`). The
    disks are as fast as `speed` (`fastest`); walls may be as hot as `hottest` [energy].

    Raises
    ------
    InputError
        Names the number, its value and the range.
    """
    with np.errstate(over="ignore", under="ignore"):
        _check(disks, box, speed, precision, hottest)


def check_coefficients(law_table: NDArray[np.float64], precision: str) -> None:
    """Refuse coefficients of a law that the precision cannot hold: an infinite one would not stay a number.

    Raises
    ------
    InputError
        Names the largest, and the limit.
    """
    most = MOST_COEFFICIENT.get(precision, np.inf)  # the engine refuses others
    largest = float(np.abs(law_table).max(initial=0.0))
    if not largest <= most:
        raise InputError(
            f"law: a coefficient of {largest:.3g} is beyond {most:g}, what {precision} can compute with"
        )


def _check(disks: Disks, box: Box, speed: float, precision: str, hottest: float) -> None:
    low, high = (1e-30, 1e30) if precision == "f32" else (1e-280, 1e280)
    finite = np.isfinite(disks.mass)
    if not disks.n or not finite.any():
        return
    m, R, k = disks.mass[finite], disks.radius[finite], disks.k[finite]
    v = max(speed, float(np.sqrt(hottest / m.min())))  # of disks that come from there, v and R omega alike
    formed = {"m": m, "1 / m": 1.0 / m, "R^2": R * R, "k / (m R)": k / m / R, "k / (m R^2)": k / m / R / R}
    if v > 0.0:
        formed |= {"v^2": np.array([v * v]), "(R v)^2": (R * v) ** 2, "m v": m * v}
    for name, values in formed.items():
        if values.min() < low or values.max() > high:
            worst = values.min() if values.min() < low else values.max()
            raise InputError(
                f"units: {name} = {worst:.3g} (v: the largest speed) lies outside of {low:g} to {high:g}, what "
                f"{precision} can compute with; choose units in which masses, radii and speeds are nearer to 1"
                + ("" if precision == "f64" else ', or precision "f64"')
            )
    if v > 0.0 and not box.is_open and max(box.lengths) / v > 1e27:
        raise InputError(
            f"units: a speed of {v:.3g} takes {max(box.lengths) / v:.3g} to cross the box: more than 1e27, the longest "
            "time of the engine; choose a larger unit of time"
        )


def check_stored(largest: Mapping[str, float], precision: str) -> None:
    """Refuse quantities, the largest of each by name, that a trajectory file in single precision cannot hold.

    `precision` is "f4" or "f8".

    Raises
    ------
    InputError
        Names the quantity, its value and the range.
    """
    limits = np.finfo(precision)
    low, high = float(limits.tiny), float(limits.max)
    for name, value in largest.items():
        if value != 0.0 and not low <= value <= high:
            raise InputError(
                f'output.precision = "{precision}": {name} of {value:.3g} cannot be stored, only from {low:.3g} to '
                f"{high:.3g}; choose units in which it is nearer to 1"
                + (', or "f8"' if precision == "f4" else "")
            )
