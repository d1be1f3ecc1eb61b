"""Coarse-grained fields: density, velocity and temperatures relative to the local flow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..errors import InputError
from ..model.box import Box
from ..tools.checked import (
    Array,
    Column,
    Integer,
    NonNegative,
    NonNegativePerDisk,
    PositivePerDisk,
    Vectors,
    rows,
    validated,
)
from ..tools.notebook import ResultPlot
from ..tools.reprs import Brief
from .common import BoxLike, blocks


@dataclass(frozen=True, eq=False, repr=False)
class Fields(Brief, ResultPlot):
    """Fields on a grid of a x b cells."""

    x: Array
    y: Array
    """x, y: middles of the cells [length]; shape (a,)."""
    number: Array
    packing_fraction: Array
    """number, packing_fraction: number density [1/length^2], and area of the disks in it over area, each counted whole
    at its centre; shape (a, b)."""
    velocity: Array
    """Mean velocity weighted by mass [length/time]; nan in empty cells; shape (a, b, 2)."""
    temperature: Array
    rotational_temperature: Array
    """temperature, rotational_temperature: t = <m |v - u|^2> / 2 relative to the mean velocity u of the place, without
    bias by the number of disks that u is the mean of, nan where fewer than two are; it contains what u varies by
    within the place. T_rot = <I omega^2>. [energy]; shape (a, b)."""
    width: float
    """Standard deviation of the Gaussian [length], 0 for plain cells."""


Cells = Annotated[int, Integer(1, 10_000)]


@validated
def coarse_grain(
    position: Vectors, velocity: Vectors, spin: Column | None = None, *, box: BoxLike,
    cells: tuple[Cells, Cells], mass: PositivePerDisk = 1.0, radius: NonNegativePerDisk = 0.0,
    inertia: NonNegativePerDisk = 0.0, width: NonNegative = 0.0,
) -> Fields:  # fmt: skip
    """Fields of one frame, by cells or by Gaussians around each disk.

    With weights phi of the disks at a place (1 in its cell, or the Gaussian of the distance), u = sum m v phi over
    sum m phi, and T = sum m |v - u|^2 phi / (2 (sum phi - sum m phi^2 / sum m phi)): the bracket makes the mean of T
    right if velocities are independent and all have one temperature. Weights as in I. Goldhirsch, Granul. Matter 12,
    239 (2010), doi:10.1007/s10035-010-0181-z. InputError if shapes do not match, cells are not positive, the width is
    below half a cell or above the longest side, Gaussians are used in a sheared box, centres lie above or below a
    sheared box, or an open box has no disks.

    Parameters
    ----------
    position, velocity, spin : arrays (n, 2), (n, 2) and (n,)
        Centres [length], velocities [length/time] and spins [rad/time], without which T_rot is 0. Centres outside are
        moved into the box through its periodic sides.
    box : Box, or two lengths of a periodic one
        An open one takes what holds all centres.
    cells : tuple of two ints
        Cells along x and y.
    mass, radius, inertia : float or array (n,)
        Masses, radii [length], moments of inertia.
    width : float
        Standard deviation of Gaussians [length]; 0 for plain cells. Each disk is put into its cell and the grid is
        smoothed, so that cells should be smaller than the width. Near walls only the weights inside count.

    Examples
    --------
    >>> import numpy as np
    >>> from ifrdem import analysis
    >>> rng = np.random.default_rng(1)
    >>> position = 10.0 * rng.random((1000, 2))
    >>> fields = analysis.coarse_grain(position, rng.normal(size=(1000, 2)), box=(10.0, 10.0), cells=(2, 2))
    >>> fields.number.shape, float(fields.number.sum())
    ((2, 2), 40.0)
    """
    x, v = (np.asarray(one, dtype=np.float64) for one in (position, velocity))
    n = len(x)
    omega = np.broadcast_to(0.0, n) if spin is None else np.asarray(spin, dtype=np.float64)
    if not len(v) == len(omega) == n:
        raise InputError(f"velocity has {len(v)} disks, spin {len(omega)}: must have {n}, as position")
    if width and box.shear_rate:
        raise InputError("Gaussians in a sheared box are not supported: take plain cells, width = 0")
    low, lengths = np.zeros(2), np.array(box.lengths)
    if box.shear_rate and n and not (x[:, 1].min() >= 0.0 and x[:, 1].max() <= lengths[1]):
        raise InputError(
            f"position: y from {x[:, 1].min():g} to {x[:, 1].max():g} must lie in the sheared box, "
            f"0 to {lengths[1]:g}: Box.wrap moves centres, and velocities change with them by shear_rate Ly"
        )
    if box.is_open:
        if not n:
            raise InputError(
                "position has 0 disks: an open box must have one or more, whose centres are its ends"
            )
        low, lengths = x.min(axis=0), np.maximum(np.ptp(x, axis=0), 1e-300) * (1.0 + 1e-9)
    size = lengths / cells
    if width > lengths.max():
        raise InputError(f"width = {width:g}: must be at most the longest side, {lengths.max():.4g}")
    if width and width < 0.5 * size.max():
        raise InputError(
            f"width = {width:g}: cells of {size.max():.4g} are too large for it; take more or a wider one"
        )
    m, R, inertia_of = rows("mass", mass, n), rows("radius", radius, n), rows("inertia", inertia, n)
    # A deviation from the mean of all, so that no digits are lost where all drift.
    drift = sum((m[some] @ v[some] for some in blocks(n)), start=np.zeros(2))
    drift /= sum(float(m[some].sum()) for some in blocks(n)) if n else 1.0
    inside = _smoothed(np.ones(cells), width, size, box) if width else np.ones(cells)
    sums = np.zeros((7, cells[0] * cells[1]))
    for some in blocks(n):
        cell = np.clip(((box.wrap(x[some]) - low) / size).astype(np.intp), 0, np.array(cells) - 1)
        index = cell[:, 0] * cells[1] + cell[:, 1]
        w, mass_of = v[some] - drift, m[some]
        terms = (
            None, mass_of, mass_of * w[:, 0], mass_of * w[:, 1], mass_of * np.sum(w * w, axis=1),
            inertia_of[some] * omega[some] * omega[some], np.pi * R[some] * R[some],
        )  # fmt: skip
        for total_of, row in zip(sums, terms, strict=True):
            total_of += np.bincount(index, row, minlength=cells[0] * cells[1])

    def total(of_cells: Array, squared: bool = False) -> Array:
        """Sums of weights times phi, or phi^2, of those in cells: a Gaussian that sums to 1, or 1 in the own cell."""
        binned = of_cells.reshape(cells)
        if not width:
            return binned
        if not squared:
            return _smoothed(binned, width, size, box) / inside
        # The square of a Gaussian is one of width / sqrt 2, times this.
        factor = float(np.prod(size)) / (4.0 * np.pi * width**2)
        return factor * _smoothed(binned, width / np.sqrt(2.0), size, box) / inside**2

    number, mass_, momentum_x, momentum_y, square, rotation, covered = map(total, sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.stack([momentum_x / mass_, momentum_y / mass_], axis=-1)
        spread = square - mass_ * np.sum(u * u, axis=-1)
        freedom = number - total(sums[1], squared=True) / mass_
        enough = freedom > 1e-6 * np.maximum(number, 1e-300)
        T = np.where(enough, np.maximum(spread, 0.0) / (2.0 * freedom), np.nan)
        T_rot = rotation / number
    area = float(np.prod(size))
    x, y = (low[axis] + (np.arange(cells[axis]) + 0.5) * size[axis] for axis in (0, 1))
    return Fields(x, y, number / area, covered / area, u + drift, T, T_rot, width)


def _smoothed(values: Array, width: float, size: Array, box: Box) -> Array:
    """Values of cells of a size (2,), spread by a Gaussian."""
    from scipy.ndimage import gaussian_filter1d

    for axis in (0, 1):
        # Being put into the middle of a cell has spread disks by cell^2 / 12 already.
        sigma = np.sqrt(max(width**2 - size[axis] ** 2 / 12.0, 0.0)) / size[axis]
        mode = "wrap" if box.periodic[axis] else "constant"
        values = gaussian_filter1d(values, sigma, axis=axis, mode=mode, truncate=6.0)
    return values
