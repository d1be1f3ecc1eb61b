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
from .common import mean_with_error

BLOCKS = 20
Components = Annotated[ArrayLike, Numbers(("rows", 4))]


@dataclass(frozen=True, eq=False, repr=False)
class MeanStress(Brief, ResultPlot):
    """The mean pressure tensor of a gas over a time, positive in compression [energy/length^2]."""

    stress: Stress
    """Kinetic and collisional part."""
    error: Array
    kinetic_error: Array
    """error, kinetic_error: standard errors of their sum and of the kinetic part, from blocks of time, shape (2, 2)."""
    pressure_error: float
    friction_error: float
    normal_difference_error: float
    """pressure_error, friction_error, normal_difference_error: of these properties of `stress`."""
    time: Array
    """Middle of each block [time], shape (blocks,)."""
    blocks: Array
    """Means over each block, shape (blocks, 2, 2)."""


@validated
def mean_stress(
    time: Column, stress: Components, kinetic: Components, *, span: tuple[Real, Real] | None = None
) -> MeanStress:
    """Mean pressure tensor over a span of time, with errors from up to `BLOCKS` equal blocks of it.

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
    whole, carried = (_block_means(t, one, edges) for one in parts)
    mean, of_disks = whole.mean(axis=0), carried.mean(axis=0)
    found = Stress(of_disks, mean - of_disks)

    def error(values: Array) -> float:
        return mean_with_error(values)[1]

    def errors(tensors: Array) -> Array:
        return np.array([[error(tensors[:, a, b]) for b in (0, 1)] for a in (0, 1)])

    xx, xy, yy = whole[:, 0, 0], whole[:, 0, 1], whole[:, 1, 1]
    pressure = 0.5 * (xx + yy)
    # Of ratios, to first order in what blocks differ by.
    friction = (-xy - found.friction * yy) / (yy.mean() or np.nan)
    normal = (xx - yy - found.normal_difference * pressure) / (found.pressure or np.nan)
    return MeanStress(
        found, errors(whole), errors(carried), error(pressure), error(friction), error(normal),
        0.5 * (edges[1:] + edges[:-1]), whole,
    )  # fmt: skip


def _block_means(time: Array, values: Array, edges: Array) -> Array:
    """Means between edges [time] of values (rows, 4) between times (rows + 1,), shape (edges - 1, 2, 2)."""
    integral = np.concatenate((np.zeros((1, 4)), np.cumsum(values * np.diff(time)[:, None], axis=0)))
    at = np.stack([np.interp(edges, time, column) for column in integral.T], axis=1)
    return np.asarray(np.diff(at, axis=0) / np.diff(edges)[:, None]).reshape(-1, 2, 2)
