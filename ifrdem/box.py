"""The region that disks move in: a rectangle, whose sides are periodic or walls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import InputError


@dataclass(frozen=True)
class Box:
    """A rectangle with its lower left corner at the origin; or the whole plane, `Box.open()`.

    Parameters
    ----------
    lengths : tuple of two floats
        Side lengths (Lx, Ly) [length].
    periodic : tuple of two bools
        Whether disks that leave on one side come in on the other, along x and along y. Where not, walls stand.

    Raises
    ------
    InputError
        If a length is not a positive finite number.
    """

    lengths: tuple[float, float]
    periodic: tuple[bool, bool] = (True, True)

    def __post_init__(self) -> None:
        lengths = tuple(float(side) for side in self.lengths)
        periodic = tuple(bool(one) for one in self.periodic)
        if len(periodic) != 2:
            raise InputError(f"box periodic = {self.periodic}: one value for x and one for y are needed")
        whole_plane = lengths == (math.inf, math.inf) and not any(periodic)
        if len(lengths) != 2 or not (
            whole_plane or all(math.isfinite(side) and side > 0 for side in lengths)
        ):
            raise InputError(
                f"box lengths = {self.lengths}: two positive finite numbers are needed (Box.open() has no sides)"
            )
        object.__setattr__(self, "lengths", lengths)
        object.__setattr__(self, "periodic", periodic)

    @classmethod
    def open(cls) -> Box:
        """No box at all: disks anywhere in the plane, which may fly apart for ever.

        Its lengths and its area are infinite, its packing fraction is 0, and positions are plain: never wrapped, with
        all image counts 0.
        """
        return cls((math.inf, math.inf), (False, False))

    @property
    def is_open(self) -> bool:
        """Whether it is the whole plane."""
        return math.isinf(self.lengths[0])

    @property
    def area(self) -> float:
        """Area Lx Ly [length^2]."""
        return self.lengths[0] * self.lengths[1]

    @property
    def periods(self) -> tuple[float, float]:
        """Lengths of periodic directions, 0 for others, as `scipy.spatial.cKDTree` wants them."""
        width, height = self.lengths
        return (width if self.periodic[0] else 0.0, height if self.periodic[1] else 0.0)

    @classmethod
    def from_packing_fraction(
        cls, radius: NDArray[np.float64], packing_fraction: float, aspect: float = 1.0
    ) -> Box:
        """The box in which disks of these radii [length], shape (n,), fill the given fraction of the area.

        `aspect` is Lx / Ly.

        Raises
        ------
        InputError
            If the packing fraction is not between 0 and pi / (2 sqrt 3) = 0.9069, the densest packing of
            equal disks, or if there are no disks.
        """
        densest = math.pi / (2.0 * math.sqrt(3.0))
        if not 0.0 < packing_fraction <= densest:
            raise InputError(
                f"packing fraction = {packing_fraction}: must lie above 0 and not above {densest:.4f}, "
                "the densest packing of equal disks"
            )
        disk_area = math.pi * float(np.sum(np.square(radius)))
        if disk_area <= 0.0:
            raise InputError("a packing fraction needs at least one disk")
        if not (math.isfinite(aspect) and aspect > 0.0):
            raise InputError(f"box aspect = {aspect}: a positive finite number is needed")
        area = disk_area / packing_fraction
        return cls((math.sqrt(area * aspect), math.sqrt(area / aspect)))

    def packing_fraction(self, radius: NDArray[np.float64]) -> float:
        """Fraction of the area that disks of these radii [length], shape (n,), cover."""
        return math.pi * float(np.sum(np.square(radius))) / self.area

    def wrap(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions [length], shape (..., 2), moved by whole box lengths into [0, Lx) x [0, Ly) where periodic."""
        if self.is_open:
            return np.array(position, dtype=np.float64)
        lengths = np.asarray(self.lengths)
        wrapped = np.mod(position, lengths)
        # np.mod of a tiny negative number rounds to the length itself.
        wrapped = np.where(wrapped >= lengths, 0.0, wrapped)
        return np.where(self.periodic, wrapped, position)

    def minimum_image(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """The shortest periodic equivalent of differences of positions [length], shape (..., 2)."""
        if self.is_open:
            return difference
        lengths = np.asarray(self.lengths)
        return difference - np.where(self.periodic, lengths * np.round(difference / lengths), 0.0)
