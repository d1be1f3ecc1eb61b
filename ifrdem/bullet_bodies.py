"""Disks and walls as PyBullet has them: upright cylinders and planes, and where they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import bullet_package
from .errors import InputError

Array = NDArray[np.float64]

UPRIGHT = 1e-6  # how far a cylinder's axis may lean, as the x and y of its quaternion


class Disk(NamedTuple):
    """A PyBullet cylinder whose axis is along z: its body's id and its radius [length]."""

    body: int
    radius: float


class Wall(NamedTuple):
    """A PyBullet plane that stands upright: its body's id, a point on it [length] and its normal towards the disks."""

    body: int
    point: tuple[float, float]
    normal: tuple[float, float]


def add_disk(
    client: int,
    mass: float,
    radius: float,
    *,
    k: float = 2.0,
    height: float | None = None,
    friction: float = 0.0,
    restitution: float = 0.0,
) -> Disk:
    """Add a cylinder that moves in the plane z = 0 only, at the origin, at rest.

    Its tilt is locked, by moments of inertia about x and y that PyBullet reads as infinite, and it has no damping.

    Parameters
    ----------
    client : int
        What `pybullet.connect` returned.
    mass, radius, k : float
        Mass [mass], radius [length], shape number in I = m R^2 / k.
    height : float
        Along z [length]; by default the radius. One height for all keeps their contacts in the plane.
    friction, restitution : float
        For Bullet's own response, in which those of two bodies are multiplied; `bullet.step` does not use them.

    Raises
    ------
    InputError
        If a number is not positive and finite, or PyBullet is absent.

    Examples
    --------
    >>> import pybullet
    >>> from ifrdem import bullet
    >>> client = pybullet.connect(pybullet.DIRECT)
    >>> disk = bullet.add_disk(client, mass=1.0, radius=0.5)
    >>> disk.radius
    0.5
    >>> pybullet.disconnect(client)
    """
    p = bullet_package.load()
    height = radius if height is None else height
    for name, value in (("mass", mass), ("radius", radius), ("k", k), ("height", height)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name} = {value}: a positive finite number is needed")
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=radius, height=height, physicsClientId=client)
    body = p.createMultiBody(
        mass, shape, -1, [0.0, 0.0, 0.0], useMaximalCoordinates=1, physicsClientId=client
    )
    _surface(p, client, body, friction, restitution)
    # The margin is part of the cylinder, and its default of 0.04 more than a coin in metres has. Contact normals come
    # out within 8e-7 with this one, within 1e-6 with larger ones.
    p.changeDynamics(body, -1, collisionMargin=0.05 * min(height, radius), physicsClientId=client)
    # Without `mass` this call would set it to 0.
    inertia = [0.0, 0.0, mass * radius**2 / k]
    p.changeDynamics(body, -1, mass=mass, localInertiaDiagonal=inertia, physicsClientId=client)
    return Disk(body, radius)


def add_wall(
    client: int,
    point: tuple[float, float],
    normal: tuple[float, float],
    *,
    friction: float = 0.0,
    restitution: float = 0.0,
) -> Wall:
    """Add an immovable plane through `point` [length]; disks are on the side to which `normal` points.

    Raises
    ------
    InputError
        If the normal has no direction, or PyBullet is absent.

    Examples
    --------
    >>> import pybullet
    >>> from ifrdem import bullet
    >>> client = pybullet.connect(pybullet.DIRECT)
    >>> wall = bullet.add_wall(client, (0.0, 0.0), (0.0, 1.0))
    >>> wall.normal
    (0.0, 1.0)
    >>> pybullet.disconnect(client)
    """
    p = bullet_package.load()
    length = math.hypot(*normal)
    if not (math.isfinite(length) and length > 0.0):
        raise InputError(f"wall normal = {normal}: it has no direction")
    unit = (normal[0] / length, normal[1] / length)
    shape = p.createCollisionShape(p.GEOM_PLANE, planeNormal=[*unit, 0.0], physicsClientId=client)
    body = p.createMultiBody(0.0, shape, -1, [*point, 0.0], useMaximalCoordinates=1, physicsClientId=client)
    _surface(p, client, body, friction, restitution)
    return Wall(body, point, unit)


def _surface(p: Any, client: int, body: int, friction: float, restitution: float) -> None:
    p.changeDynamics(
        body, -1, lateralFriction=friction, restitution=restitution, rollingFriction=0.0, spinningFriction=0.0,
        linearDamping=0.0, angularDamping=0.0, contactProcessingThreshold=0.0, physicsClientId=client,
    )  # fmt: skip


def place(
    client: int,
    body: int,
    position: Sequence[float] | Array,
    velocity: Sequence[float] | Array,
    spin: float,
    *,
    angle: float = 0.0,
    z: float = 0.0,
) -> None:
    """Put a body at a position [length] with a velocity [length/time], a spin [rad/time] and an angle [rad].

    Examples
    --------
    >>> import pybullet
    >>> from ifrdem import bullet
    >>> client = pybullet.connect(pybullet.DIRECT)
    >>> disk = bullet.add_disk(client, mass=1.0, radius=0.5)
    >>> bullet.place(client, disk.body, (1.0, 2.0), (3.0, 0.0), spin=0.0)
    >>> pybullet.getBaseVelocity(disk.body, physicsClientId=client)[0]
    (3.0, 0.0, 0.0)
    >>> pybullet.disconnect(client)
    """
    p = bullet_package.load()
    turn = [0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)]
    x, y = float(position[0]), float(position[1])
    p.resetBasePositionAndOrientation(body, [x, y, z], turn, physicsClientId=client)
    # In this order: resetting the position sets the velocity to zero.
    v = [float(velocity[0]), float(velocity[1]), 0.0]
    p.resetBaseVelocity(body, v, [0.0, 0.0, float(spin)], physicsClientId=client)


@dataclass(frozen=True, eq=False)
class Bodies:
    """What collides: disks and walls, with what PyBullet knows of them, read once.

    Attributes
    ----------
    disks : tuple of Disk
        n of them. One of mass 0 is an immovable post.
    walls : tuple of Wall
    mass, radius, k : arrays (n,)
        Masses [mass], infinite for a post, radii [length], shape numbers in I = m R^2 / k.
    """

    disks: tuple[Disk, ...]
    walls: tuple[Wall, ...]
    mass: Array
    radius: Array
    k: Array

    @classmethod
    def read(cls, client: int, bodies: Sequence[Disk | Wall | int]) -> Bodies:
        """Read masses and moments of inertia of disks and walls.

        A plain id will do for a body that was made without `useMaximalCoordinates`: of the other kind PyBullet does
        not tell radius or plane, so it needs a `Disk` or a `Wall`.

        Raises
        ------
        InputError
            If a body is not there, is neither cylinder nor plane, does not stand upright, or cannot turn.
        """
        p = bullet_package.load()
        known = [_recognized(p, client, body) if isinstance(body, int) else body for body in bodies]
        disks = tuple(one for one in known if isinstance(one, Disk))
        walls = tuple(one for one in known if isinstance(one, Wall))
        ids = [one.body for one in known]
        if len(set(ids)) < len(ids):
            raise InputError(f"bodies = {ids}: one of them is there twice")
        mass, k = np.full(len(disks), np.inf), np.full(len(disks), 2.0)
        for i, disk in enumerate(disks):
            _check_upright(p, client, disk.body)
            m, _, inertia = p.getDynamicsInfo(disk.body, -1, physicsClientId=client)[:3]
            if m > 0.0:
                if not inertia[2] > 0.0:
                    raise InputError(f"body {disk.body}: its moment of inertia about z is {inertia[2]}, none")
                mass[i], k[i] = m, m * disk.radius**2 / inertia[2]
        return cls(disks, walls, mass, np.array([disk.radius for disk in disks]), k)

    def state(self, client: int) -> tuple[Array, Array, Array, Array]:
        """Positions (n, 3) [length], velocities (n, 2) [length/time], spins and angles (n,) [rad/time, rad]."""
        p = bullet_package.load()
        position, velocity = np.empty((len(self.disks), 3)), np.empty((len(self.disks), 2))
        spin, angle = np.empty(len(self.disks)), np.empty(len(self.disks))
        for i, disk in enumerate(self.disks):
            position[i], turn = p.getBasePositionAndOrientation(disk.body, physicsClientId=client)
            v, w = p.getBaseVelocity(disk.body, physicsClientId=client)
            velocity[i], spin[i] = v[:2], w[2]
            angle[i] = 2.0 * math.atan2(turn[2], turn[3])
        return position, velocity, spin, angle


def _recognized(p: Any, client: int, body: int) -> Disk | Wall:
    """The disk or wall behind a plain id."""
    try:
        ((_, _, kind, size, *_),) = p.getCollisionShapeData(body, -1, physicsClientId=client)
    except (p.error, ValueError):
        raise InputError(
            f"body {body}: PyBullet does not tell its shape; give ifrdem.bullet.Disk(body, radius) or "
            "ifrdem.bullet.Wall(body, point, normal)"
        ) from None
    if kind == p.GEOM_CYLINDER:
        return Disk(body, size[1])  # its height comes first
    if kind == p.GEOM_PLANE:
        (x, y, _), _ = p.getBasePositionAndOrientation(body, physicsClientId=client)
        if abs(size[2]) > UPRIGHT:
            raise InputError(f"body {body}: a plane with normal {size}, which does not stand upright")
        return Wall(body, (x, y), (size[0], size[1]))
    raise InputError(f"body {body}: neither a cylinder nor a plane")


def _check_upright(p: Any, client: int, body: int) -> None:
    try:
        _, turn = p.getBasePositionAndOrientation(body, physicsClientId=client)
    except p.error:
        raise InputError(f"body {body}: there is no such body in this client") from None
    if abs(turn[0]) > UPRIGHT or abs(turn[1]) > UPRIGHT:
        raise InputError(f"body {body}: its axis is not along z; disks move in the plane z = constant")
