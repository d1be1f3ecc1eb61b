"""The region that disks move in: a rectangle, whose sides are periodic or walls, at rest or sheared."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, overload

import numpy as np
from numpy.typing import DTypeLike

from ..errors import InputError
from ..mpi import collective, current
from ..tools.checked import (
    LEAST,
    MOST,
    Array,
    Images,
    Moments,
    Number,
    Places,
    Positive,
    PositiveColumn,
    validated,
)
from . import rules
from .density import disk_area, packing_fraction

_Side = Annotated[
    float,
    Number(
        LEAST, math.inf, f"a positive number from {LEAST:g} to {MOST:g} (Box.open() has no sides)", units=True
    ),
]
_DENSEST = math.pi / (2.0 * math.sqrt(3.0))
PackingFraction = Annotated[
    float,
    Number(LEAST, _DENSEST, f"a number above 0, at most {_DENSEST:.4f}, the densest packing of equal disks"),
]


@validated
@dataclass(frozen=True)
class Box:
    """A rectangle with its lower left corner at the origin; or the whole plane, `Box.open()`.

    InputError if a length is not a positive finite number, the shear rate is not finite, or a sheared box has walls.

    Parameters
    ----------
    lengths : tuple of two floats
        Side lengths (Lx, Ly) [length].
    periodic : tuple of two bools
        Whether disks that leave on one side come in on the other, along x and along y. Where not, walls stand.
    shear_rate : float
        du_x/dy [1/time] of a steady shear flow u = (shear_rate (y - Ly/2), 0), by the periodic sides of Lees and
        Edwards (1972), doi:10.1088/0022-3719/5/15/006: at time t the image above lies shear_rate Ly t further along x,
        and moves shear_rate Ly faster. The box is a window at rest in the lab; a disk that leaves it above comes in
        below, that much further to the left and slower.

    Notes
    -----
    Velocities are those in the lab everywhere (as in LAMMPS and DynamO); less `flow` they are *peculiar*, which is
    what temperatures are made of.

    Examples
    --------
    >>> import ifrdem
    >>> box = ifrdem.Box((4.0, 2.0))
    >>> box.area
    8.0
    >>> round(ifrdem.Box.from_packing_fraction([0.5] * 100, 0.25).packing_fraction([0.5] * 100), 12)
    0.25
    >>> ifrdem.Box.open()
    Box(lengths=(inf, inf), periodic=(False, False), shear_rate=0.0)
    """

    lengths: tuple[_Side, _Side]
    periodic: tuple[bool, bool] = (True, True)
    shear_rate: float = 0.0

    def __post_init__(self) -> None:
        lengths, periodic = self.lengths, tuple(bool(one) for one in self.periodic)
        whole_plane = lengths == (math.inf, math.inf) and not any(periodic)
        if not (whole_plane or max(lengths) <= MOST):
            raise InputError(
                f"lengths = {lengths}: must be two positive finite numbers (Box.open() has no sides)"
            )
        shear_rate = self.shear_rate
        text = f"shear_rate = {shear_rate:g}"
        for rule in rules.refusals(rules.Facts(periodic=(periodic[0], periodic[1]), shear_rate=shear_rate)):
            raise InputError(f"{text}: cannot be combined with periodic = {periodic}: {rule.why}")
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
        """True for the whole plane."""
        return math.isinf(self.lengths[0])

    @property
    def area(self) -> float:
        """Area Lx Ly [length^2]."""
        return self.lengths[0] * self.lengths[1]

    @property
    def periods(self) -> tuple[float, float]:
        """Lengths of periodic directions, 0 for others."""
        width, height = self.lengths
        return (width if self.periodic[0] else 0.0, height if self.periodic[1] else 0.0)

    @property
    def shortest_period(self) -> float:
        """The shorter periodic side [length]; infinite without one."""
        return min((each for each in self.periods if each), default=math.inf)

    @classmethod
    @validated
    @collective
    def from_packing_fraction(
        cls,
        radius: PositiveColumn,
        packing_fraction: PackingFraction,
        aspect: Positive = 1.0,
        *,
        shear_rate: float = 0.0,
    ) -> Box:
        """The box in which disks of these radii [length], shape (n,), fill the given fraction of the area.

        `aspect` is Lx / Ly; `shear_rate` as for a box [1/time]. Of ranks of MPI, each gives the radii of its slice
        (`Communicator`). InputError if the packing fraction is not between 0 and pi / (2 sqrt 3) = 0.9069, the
        densest packing of equal disks, or if there are no disks.
        """
        return cls.around(disk_area(radius, current()), packing_fraction, aspect, shear_rate)

    @classmethod
    def around(cls, covered: float, packing_fraction: float, aspect: float, shear_rate: float = 0.0) -> Box:
        """The box in which disks of this total area [length^2] fill the given fraction; other arguments as above."""
        if covered <= 0.0:
            raise InputError("radius has shape (0,): must be that of one disk or more")
        area = covered / packing_fraction
        return cls((math.sqrt(area * aspect), math.sqrt(area / aspect)), shear_rate=shear_rate)

    @validated
    def packing_fraction(self, radius: PositiveColumn) -> float:
        """Fraction of the area that disks of these radii [length], shape (n,), cover."""
        return packing_fraction(disk_area(radius), self.area)

    @validated
    def flow(self, position: Places) -> Array:
        """Velocity of the mean flow [length/time] at positions [length], both of shape (..., 2); 0 without shear."""
        flow = np.zeros_like(position, dtype=np.float64)
        if self.shear_rate == 0.0:
            return flow
        flow[..., 0] = self.shear_rate * (position[..., 1] - 0.5 * self.lengths[1])
        return flow

    @overload
    def image_above(self, time: float) -> float: ...
    @overload
    def image_above(self, time: Array) -> Array: ...
    @validated
    def image_above(self, time: Moments) -> float | Array:
        """Shift along x of the image above at times [time]: shear_rate Ly t, in [0, Lx) [length]."""
        shift = self.shear_rate * self.lengths[1] * time % self.lengths[0]
        return shift if np.ndim(shift) else float(shift)

    def cell(self, time: float = 0.0) -> Array:
        """Edge vectors of a cell for programs that take each of its sides as periodic [length], row by row, (3, 3).

        Periodic sides are those of the box; in a sheared box the second one leans by the shift of the image above,
        within half of Lx. A side between walls is twice as long, and z as long as the longest: two disks in the box are
        less than half of such a side apart, so a minimum image never crosses it.
        """
        x, y = (
            side if periodic else 2.0 * side
            for side, periodic in zip(self.lengths, self.periodic, strict=True)
        )
        shift = self.image_above(time) if self.shear_rate else 0.0
        return np.array([[x, 0.0, 0.0], [shift - x * round(shift / x), y, 0.0], [0.0, 0.0, max(x, y)]])

    @validated
    def wrap(self, position: Places, time: Moments = 0.0) -> Array:
        """Positions [length], shape (..., 2), moved by whole boxes into [0, Lx) x [0, Ly) where periodic.

        In a sheared box that depends on the `time` [time], a number or an array (...).
        """
        _check_times(position, time)
        if self.is_open:
            return np.array(position, dtype=np.float64)
        lengths = np.asarray(self.lengths)
        inside = position.size > 0 and position.min() >= 0.0
        if inside and all(position[..., axis].max() < length for axis, length in enumerate(self.lengths)):
            return np.asarray(position, dtype=np.float64) + 0.0  # -0 becomes 0
        if self.shear_rate:
            position = position.copy()
            position[..., 0] -= np.floor(position[..., 1] / lengths[1]) * self.image_above(time)
        wrapped = np.mod(position, lengths)
        # np.mod of a tiny negative number rounds to the length itself.
        wrapped = np.where(wrapped >= lengths, 0.0, wrapped)
        return np.where(self.periodic, wrapped, position)

    @validated
    def minimum_image(self, difference: Places, time: Moments = 0.0) -> Array:
        """The shortest periodic equivalent of differences of positions [length], shape (..., 2).

        In a sheared box that depends on the `time` [time], a number or an array (...), and is the shortest one if that
        is below half of each side.
        """
        if self.is_open:
            return difference
        lengths = np.asarray(self.lengths)
        if self.shear_rate:
            difference = difference.copy()
            difference[..., 0] -= np.round(difference[..., 1] / lengths[1]) * self.image_above(time)
        return difference - np.where(self.periodic, lengths * np.round(difference / lengths), 0.0)

    @validated
    def unwrap(self, position: Places, image: Images, time: Moments = 0.0) -> Array:
        """Places on paths without jumps [length], shape (..., 2): of positions in the box and the boxes travelled.

        position + image * lengths; in a sheared box, the box above lies shear_rate Ly t further along x, and the path
        is that of a disk that moves on into faster and faster flow. The time is a number or an array (...).
        """
        _check_times(position, time)
        if np.shape(image) != position.shape:
            raise InputError(
                f"image has shape {np.shape(image)}: must have that of position, {position.shape}"
            )
        if self.is_open:
            return np.array(position, dtype=np.float64)
        unwrapped = position + image * np.asarray(self.lengths)
        unwrapped[..., 0] += image[..., 1] * (self.shear_rate * self.lengths[1] * time)
        return unwrapped


def _check_times(position: Array, time: Any) -> None:
    try:
        np.broadcast_shapes(np.shape(time), position.shape[:-1])
    except ValueError:
        needed = f"a number, or one for each position, {position.shape[:-1]}"
        raise InputError(f"time has shape {np.shape(time)}: must be {needed}") from None


def below(length: float, dtype: DTypeLike) -> float:
    """The largest number of a type that is less than a length [length]: the last place inside a periodic box."""
    rounded = np.array(length, dtype=dtype)
    return float(np.nextafter(rounded, np.zeros_like(rounded)) if rounded >= length else rounded)


def describe_sides(box: Box) -> str:
    """Sides of a box, in words."""
    if box.shear_rate:
        return f"periodic, sheared at the rate {box.shear_rate:.6g}"
    if box.periodic[0] == box.periodic[1]:
        return "periodic" if box.periodic[0] else "between walls"
    across, between = "xy" if box.periodic[0] else "yx"
    return f"periodic in {across}, between walls in {between}"
