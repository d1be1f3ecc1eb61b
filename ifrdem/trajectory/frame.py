"""A frame of a trajectory: where the disks were at one time, read when asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import AttributeMissing, InputError, NameMissing
from ..model.walls import OF_PISTONS, Wall, at_displacements
from ..tools.pictured import PicturedDisks
from ..tools.sealed import Sealed

if TYPE_CHECKING:
    from .reader import Trajectory

SPIN = "angular_velocity"
"""Name of the spin in H5MD; both names are understood."""


class Frame(Sealed, PicturedDisks):
    """One frame of a trajectory; each array is read when asked for. Floats are float64 whatever is stored.

    Every stored field is there by its name, as `frame["velocity"]` and as `frame.velocity`; "spin" is another name of
    "angular_velocity".

    Attributes
    ----------
    index : int
        Number of the frame, from 0.
    time : float
        Its time [time].
    trajectory : Trajectory
        Whose frame it is.
    """

    index: int
    trajectory: Trajectory

    def __init__(self, trajectory: Trajectory, index: int) -> None:
        self._set(trajectory=trajectory, index=index)

    def __repr__(self) -> str:
        """Number of the frame of how many, and its time."""
        trajectory = self.trajectory
        return (
            f"<Frame {self.index} of {len(trajectory)}: {trajectory.n} disks at "
            f"t = {trajectory.with_unit(f'{self.time:.6g}', 'time')}>"
        )

    def __getitem__(self, name: str) -> NDArray[Any]:
        """The same as `field`."""
        return self.field(name)

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self.trajectory.fields:
            try:
                self.trajectory.dataset(name)
            except NameMissing as error:
                raise AttributeMissing(str(error)) from None
        return self.field(name)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.trajectory.fields})

    def field(self, name: str) -> NDArray[Any]:
        """A stored field by its name in the file, shape (n,) or (n, 2).

        Raises InputError if the file does not hold it (also a KeyError), or it cannot be read (`DamageError`).
        """
        value = self.trajectory.read(name, self.index)
        return value.astype(np.float64) if value.dtype.kind == "f" else value

    @property
    def time(self) -> float:
        """The time [time]."""
        return float(self.trajectory.times[self.index])

    @property
    def walls(self) -> tuple[Wall, ...]:
        """Walls of the trajectory, pistons where they are in this frame; for the others `Wall.outline` takes the time.

        The sides of the box are not among them.
        """
        trajectory = self.trajectory
        if f"{OF_PISTONS}displacement" not in trajectory.observables:
            return trajectory.walls
        return at_displacements(
            trajectory.walls, trajectory.observables[f"{OF_PISTONS}displacement"][self.index].tolist()
        )

    @property
    def position(self) -> NDArray[np.float64]:
        """Centres [length], shape (n, 2), inside the box; anywhere in the plane if that is open."""
        return self.field("position")

    @property
    def box(self) -> tuple[float, float, float, float, float, float]:
        """The box as freud, HOOMD and gsd have it: (Lx, Ly, Lz, xy, xz, yz) [length, length, 0, 1, 0, 0].

        All its sides count as periodic there. InputError for an open box.
        """
        box = self.trajectory.box
        if box.is_open:
            raise InputError(f"{self.trajectory.path}: an open box has no sides: give freud a box of its own")
        x, y = box.lengths
        shift = box.image_above(self.time) if box.shear_rate else 0.0
        return x, y, 0.0, (shift - x * round(shift / x)) / y, 0.0, 0.0

    @property
    def points(self) -> NDArray[np.float64]:
        """Centres with z = 0 about the middle of the box [length], shape (n, 3), as freud takes them with `box`."""
        middle = 0.5 * np.array(self.box[:2])
        return np.column_stack([self.position - middle, np.zeros(self.trajectory.n)])

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocities in the lab [length/time], shape (n, 2)."""
        return self.field("velocity")

    @property
    def peculiar_velocity(self) -> NDArray[np.float64]:
        """Velocities relative to the mean flow of a sheared box [length/time], shape (n, 2); in others the same."""
        if self.trajectory.box.shear_rate == 0.0:
            return self.velocity
        return self.velocity - self.trajectory.box.flow(self.position)

    @property
    def spin(self) -> NDArray[np.float64]:
        """Angular velocities, counter-clockwise [rad/time], shape (n,)."""
        return self.field(SPIN)

    @property
    def collisions(self) -> NDArray[np.int32]:
        """Collisions that each disk has had, shape (n,)."""
        return self.field("collisions")

    @property
    def image(self) -> NDArray[np.int32]:
        """Box lengths that each disk has travelled along each axis, shape (n, 2); see `Box.unwrap`."""
        return self.field("image")

    @property
    def unwrapped(self) -> NDArray[np.float64]:
        """Places on paths without jumps [length], shape (n, 2); the file must hold `image`."""
        return self.trajectory.box.unwrap(self.position, self.image, self.time)
