"""Pressure tensor of a gas: its mean over time, with errors, from the time series of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..model.observables import Stress
from ..tools.checked import Array, Column, Numbers, Real, validated
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from .common import BLOCKS, mean_errors

Components = Annotated[ArrayLike, Numbers(("rows", 4))]


@dataclass(frozen=True, eq=False, repr=False)
class MeanStress(Brief, ResultPlot):
    """The mean pressure tensor of a gas over a time, positive in compression [energy/length^2]."""

    stress: Stress
    """Kinetic and collisional part."""
    error: Array
    kinetic_error: Array
    """error, kinetic_error: standard errors of their sum and of the kinetic part, shape (2, 2)."""
    pressure_error: float
    friction_error: float
    normal_difference_error: float
    temperature_ratio_error: float
    """pressure_error, friction_error, ...: of these properties of `stress`."""
    n_eff: Array
    kinetic_n_eff: Array
    pressure_n_eff: float
    friction_n_eff: float
    normal_difference_n_eff: float
    temperature_ratio_n_eff: float
    """n_eff, ...: of each error, the number of independent values with that error: intervals are Student's t with
    n_eff - 1 degrees of freedom, 1 at least; shapes as of the errors."""
    rows: int
    """Rows of the series within the time."""
    time: Array
    """Middle of each block [time], shape (blocks,)."""
    blocks: Array
    """Means over each block, shape (blocks, 2, 2)."""


@validated
def mean_stress(
    time: Column, stress: Components, kinetic: Components, *, span: tuple[Real, Real] | None = None
) -> MeanStress:
    """Mean pressure tensor over a span of time, with errors that include the correlation of the rows.

    Errors are those of `mean_with_error`: of as many equal parts of the span as it has rows, and of `BLOCKS` of them.

    Parameters
    ----------
    time : array (rows + 1,)
        Rising times [time].
    stress, kinetic : array (rows, 4)
        xx, xy, yx, yy of the pressure tensor and of its kinetic part, means from each time to the next
        [energy/length^2].
    span : tuple of two floats, optional
        The time to average over [time], within those times; by default all.

    Raises
    ------
    InputError
        If there is no row, times do not rise, or the span is empty or reaches beyond them.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rows = np.tile([2.0, -0.5, -0.5, 1.0], (10, 1))
    >>> found = analysis.mean_stress(np.arange(11.0), rows, 0.5 * rows)
    >>> found.stress.pressure, found.stress.friction
    (1.5, 0.5)
    """
    t = np.asarray(time, dtype=float)
    if len(t) < 2 or not np.all(np.diff(t) > 0.0):
        raise InputError("time: must be two or more times, each later than the one before")
    parts = [np.asarray(one, dtype=float) for one in (stress, kinetic)]
    for name, one in zip(("stress", "kinetic"), parts, strict=True):
        if len(one) != len(t) - 1:
            raise InputError(f"{name} has {len(one)} rows: must have {len(t) - 1}, one less than time")
    begin, end = (float(t[0]), float(t[-1])) if span is None else span
    if not t[0] <= begin < end <= t[-1]:
        raise InputError(f"span = ({begin:g}, {end:g}): must lie within time, {t[0]:g} to {t[-1]:g}")
    inside = int(np.count_nonzero((t > begin) & (t <= end)))
    edges = np.linspace(begin, end, min(BLOCKS, max(inside, 1)) + 1)
    fine = np.linspace(begin, end, max(inside, 1) + 1)
    whole, carried = (_block_means(t, one, fine) for one in parts)
    mean, of_disks = whole.mean(axis=0), carried.mean(axis=0)
    found = Stress(of_disks, mean - of_disks)
    xx, xy, yy = whole[:, 0, 0], whole[:, 0, 1], whole[:, 1, 1]
    pressure = 0.5 * (xx + yy)
    # Of ratios, to first order in what rows differ by; nan of those in a gas at rest.
    friction = (-xy - found.friction * yy) / (yy.mean() or np.nan)
    normal = (xx - yy - found.normal_difference * pressure) / (found.pressure or np.nan)
    of_y = carried[:, 1, 1].mean() or np.nan
    ratio = (carried[:, 0, 0] - found.temperature_ratio * carried[:, 1, 1]) / of_y
    total, of_kinetic, of_pressure, of_friction, of_normal, of_ratio = (
        mean_errors(one) for one in (whole, carried, pressure, friction, normal, ratio)
    )
    return MeanStress(
        stress=found,
        error=total.error,
        kinetic_error=of_kinetic.error,
        pressure_error=float(of_pressure.error),
        friction_error=float(of_friction.error),
        normal_difference_error=float(of_normal.error),
        temperature_ratio_error=float(of_ratio.error),
        n_eff=total.effective,
        kinetic_n_eff=of_kinetic.effective,
        pressure_n_eff=float(of_pressure.effective),
        friction_n_eff=float(of_friction.effective),
        normal_difference_n_eff=float(of_normal.effective),
        temperature_ratio_n_eff=float(of_ratio.effective),
        rows=inside,
        time=0.5 * (edges[1:] + edges[:-1]),
        blocks=_block_means(t, parts[0], edges),
    )


def means_between(time: Array, values: Array, edges: Array) -> Array:
    """Means between edges [time] of values (rows, columns) between times (rows + 1,), shape (edges - 1, columns)."""
    integral = np.cumsum(values * np.diff(time)[:, None], axis=0)
    integral = np.concatenate((np.zeros_like(integral[:1]), integral))
    at = np.stack([np.interp(edges, time, column) for column in integral.T], axis=1)
    return np.asarray(np.diff(at, axis=0) / np.diff(edges)[:, None])


def _block_means(time: Array, values: Array, edges: Array) -> Array:
    """Means of tensors, shape (edges - 1, 2, 2)."""
    return means_between(time, values, edges).reshape(-1, 2, 2)
