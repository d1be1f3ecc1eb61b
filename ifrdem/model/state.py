"""What a gas is made of (`Disks`, constant) and where it is now (`State`, changing)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..tools.reprs import Brief


def _positive(name: str, value: ArrayLike, n: int, *, infinite: bool = False) -> NDArray[np.float64]:
    column = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), (n,)))
    wrong = ~(column > 0.0) | (np.isinf(column) & (not infinite))
    if np.any(wrong):
        i = int(np.argmax(wrong))
        kind = (
            "a positive number (infinite for an immovable disk)" if infinite else "a positive finite number"
        )
        raise InputError(f"{name}[{i}] = {column[i]}: {kind} is needed")
    column.flags.writeable = False
    return column


@dataclass(frozen=True, eq=False, repr=False)
class Disks(Brief):
    """The constant properties of n disks.

    Every argument but `n` may be a number (the same for all) or an array of shape (n,).

    Parameters
    ----------
    n : int
        Number of disks.
    mass : array_like
        Masses m [mass]. An infinite one makes an immovable disk: it must be at rest, without spin, and counts
        neither in energies nor in momentum.
    radius : array_like
        Radii R [length].
    k : array_like
        Shape number in the moment of inertia I = m R^2 / k: 2 for a homogeneous disk, 1 for a hoop.
    material : array_like of int
        Index of each disk's material in the law table; 0 where there is one material.

    Raises
    ------
    InputError
        If n is negative, or a mass, radius or k is not a positive finite number (a mass may be infinite).
    """

    n: int
    mass: NDArray[np.float64]
    radius: NDArray[np.float64]
    k: NDArray[np.float64] = field(default_factory=lambda: np.array(2.0))
    material: NDArray[np.int32] = field(default_factory=lambda: np.array(0, dtype=np.int32))

    def __post_init__(self) -> None:
        if int(self.n) != self.n or self.n < 0:
            raise InputError(f"n = {self.n}: a whole number of disks, 0 or more, is needed")
        set_ = object.__setattr__
        set_(self, "n", int(self.n))
        for name in ("mass", "radius", "k"):
            set_(self, name, _positive(name, getattr(self, name), self.n, infinite=name == "mass"))
        material = np.array(np.broadcast_to(np.asarray(self.material, dtype=np.int32), (self.n,)))
        if np.any(material < 0):
            raise InputError("material: indices of 0 or more are needed")
        material.flags.writeable = False
        set_(self, "material", material)

    @property
    def movable(self) -> NDArray[np.bool_]:
        """Which disks have a finite mass, shape (n,)."""
        return np.isfinite(self.mass)

    @property
    def inertia(self) -> NDArray[np.float64]:
        """Moments of inertia m R^2 / k [mass length^2], shape (n,); infinite for an immovable disk."""
        return self.mass * self.radius**2 / self.k


@dataclass(eq=False, repr=False)
class State(Brief):
    """Where n disks are and how they move at one time.

    Attributes
    ----------
    position : array (n, 2)
        Centres [length], inside the box.
    velocity : array (n, 2)
        Velocities of the centres [length/time], in the lab: in a sheared box too.
    spin : array (n,)
        Angular velocities, counter-clockwise [rad/time].
    time : float
        The time [time].
    collisions : array (n,) of int32
        Collisions that each disk has had.
    image : array (n, 2) of int32
        How often each disk has left the box through each side: `Box.unwrap` makes paths without jumps of it.
    wall_hits : array (n,) of int32
        Collisions with walls that each disk has had. Thermal walls count them to draw their random numbers.
    latest_collision : array (n,)
        When each disk last collided with a disk or wall [time], -inf if never. Only runs with the tc rule
        (`Collapse`) keep it up to date.
    last_partner : array (n,) of int32
        Whom each disk hit last: an id, -1 if nobody yet, -2 - w for wall w. Only runs that are asked to
        (`Simulation(partners=True)`) keep it up to date.
    angle : array (n,)
        How far each disk has turned since the start, counter-clockwise, full turns included [rad]. Only runs that are
        asked to (`Simulation(angles=True)`) keep it up to date.
    flow : array (n, 2) or None
        Velocity of the mean flow at each disk [length/time]; None where there is none. A simulation in a sheared box
        sets it, and `observables.measure` needs it; to start one, it is not needed.

    Raises
    ------
    InputError
        If shapes do not fit or a value is not finite (the first such disk is named).
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]
    time: float = 0.0
    collisions: NDArray[np.int32] = None  # type: ignore[assignment]
    image: NDArray[np.int32] = None  # type: ignore[assignment]
    wall_hits: NDArray[np.int32] = None  # type: ignore[assignment]
    latest_collision: NDArray[np.float64] = None  # type: ignore[assignment]
    last_partner: NDArray[np.int32] = None  # type: ignore[assignment]
    angle: NDArray[np.float64] = None  # type: ignore[assignment]
    flow: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        self.position = np.ascontiguousarray(self.position, dtype=np.float64)
        self.velocity = np.ascontiguousarray(self.velocity, dtype=np.float64)
        self.spin = np.ascontiguousarray(self.spin, dtype=np.float64)
        n = len(self.spin)
        for name, value, shape in (
            ("position", self.position, (n, 2)),
            ("velocity", self.velocity, (n, 2)),
            ("spin", self.spin, (n,)),
        ):
            if value.shape != shape:
                raise InputError(f"{name} has shape {value.shape}: {shape} is needed")
            finite = np.isfinite(value)
            if not finite.all():
                i = int(np.argmin(finite)) // max(value.size // n, 1)
                raise InputError(f"{name}[{i}] = {value[i]}: every value must be finite")
        if self.collisions is None:
            self.collisions = np.zeros(n, dtype=np.int32)
        if self.image is None:
            self.image = np.zeros((n, 2), dtype=np.int32)
        if self.wall_hits is None:
            self.wall_hits = np.zeros(n, dtype=np.int32)
        if self.latest_collision is None:
            self.latest_collision = np.full(n, -np.inf)
        if self.last_partner is None:
            self.last_partner = np.full(n, -1, dtype=np.int32)
        if self.angle is None:
            self.angle = np.zeros(n)
        for name in ("wall_hits", "latest_collision", "last_partner", "angle"):
            if np.shape(getattr(self, name)) != (n,):
                raise InputError(f"{name} has shape {np.shape(getattr(self, name))}: {(n,)} is needed")
        late = ~(self.latest_collision <= self.time)
        if np.any(late):
            i = int(np.argmax(late))
            raise InputError(
                f"latest_collision[{i}] = {self.latest_collision[i]}: a time not after the state's, {self.time}, is "
                "needed"
            )

        if self.flow is not None:
            self.flow = np.ascontiguousarray(self.flow, dtype=np.float64)
            if self.flow.shape != (n, 2) or not np.isfinite(self.flow).all():
                raise InputError(f"flow has shape {self.flow.shape}: {(n, 2)} is needed, and finite values")

    @property
    def n(self) -> int:
        """Number of disks."""
        return len(self.spin)

    @property
    def peculiar_velocity(self) -> NDArray[np.float64]:
        """Velocities relative to the mean flow [length/time], shape (n, 2)."""
        return self.velocity if self.flow is None else self.velocity - self.flow


@dataclass(eq=False, repr=False)
class StoredState(State):
    """A state as a file in single precision keeps it: arrays of single precision, known to be finite.

    An engine makes it for who wants no more than to write it, in a third of the time. Its arrays are columns of one:
    what belongs to a disk stands together. `image` is None if it was not asked for.
    """

    def __post_init__(self) -> None:
        """Take the arrays as they are."""
