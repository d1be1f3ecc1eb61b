"""Laws of collisions for bodies of PyBullet: `step(client, bodies, law)` moves a PyBullet world by one of its steps.

PyBullet moves the bodies. Its own response to contacts is switched off, because Newton's restitution and Coulomb's
friction are all it knows (its friction ends at sticking: e_t = -1 and contact-point sticking in our terms).
`engines.collide_step` lets the bodies collide.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from types import ModuleType
from typing import Annotated, Any, NamedTuple

import numpy as np

from .engines import Hit, LawOrFunction, collide_step
from .errors import InputError, install_extra
from .tools.checked import Array, Integer, NonNegative, Numbers, Positive, Real, validated

LAST_PYTHON = (3, 11)  # PyBullet publishes wheels for Python 3.9 to 3.11


def absence() -> str | None:
    """Reason why PyBullet cannot be used here, with a way out; None if it can.

    Examples
    --------
    >>> from ifrdem import bullet
    >>> bullet.absence() is None or 'not installed' in bullet.absence()
    True
    """
    if importlib.util.find_spec("pybullet") is not None:
        return None
    here = sys.version_info[:2]
    if here > LAST_PYTHON:
        return (
            f"not installed, and PyBullet has no wheel for Python {here[0]}.{here[1]} (only up to 3.11): "
            "use Python 3.11 for comparisons with it; everything else works without"
        )
    return f"not installed: {install_extra('bullet')}; everything else works without"


def describe() -> str:
    """PyBullet's version, or why it is absent.

    Examples
    --------
    >>> from ifrdem import bullet
    >>> isinstance(bullet.describe(), str)
    True
    """
    return absence() or f"PyBullet {version('pybullet')}"


def load() -> ModuleType:
    """Import PyBullet.

    Raises InputError if it is absent, with what to do. It is never compiled or installed on the way.

    Examples
    --------
    >>> from ifrdem import bullet
    >>> import pybullet
    >>> bullet.load() is pybullet
    True
    """
    reason = absence()
    if reason is not None:
        raise InputError(f"pybullet: {reason}")
    return importlib.import_module("pybullet")


Client = Annotated[int, Integer(0)]
Body = Annotated[int, Integer(0)]
Pair = Annotated[Sequence[float] | Array, Numbers((2,))]


def _world(client: int) -> ModuleType:
    """PyBullet, if it has a world of this number; InputError if not."""
    p = load()
    if not p.isConnected(physicsClientId=client):
        raise InputError(f"client = {client}: must be a number that pybullet.connect returned")
    return p


UPRIGHT = 1e-6  # how far a cylinder's axis may lean, as the x and y of its quaternion


class DiskBody(NamedTuple):
    """A PyBullet cylinder whose axis is along z: its body's id and its radius [length]."""

    body: int
    radius: float


class WallBody(NamedTuple):
    """A PyBullet plane that stands upright: its body's id, a point on it [length] and its normal towards the disks."""

    body: int
    point: tuple[float, float]
    normal: tuple[float, float]


@validated
def add_disk(
    client: Client,
    mass: Positive,
    radius: Positive,
    *,
    k: Positive = 2.0,
    height: Positive | None = None,
    friction: NonNegative = 0.0,
    restitution: NonNegative = 0.0,
) -> DiskBody:
    """Add a cylinder that moves in the plane z = 0 only, at the origin, at rest.

    Its tilt is locked, by moments of inertia about x and y that PyBullet reads as infinite, and it has no damping.

    Raises InputError if a number is not positive and finite, or PyBullet is absent.

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
    p = _world(client)
    height = radius if height is None else height
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=radius, height=height, physicsClientId=client)
    body = p.createMultiBody(mass, shape, -1, [0.0] * 3, useMaximalCoordinates=1, physicsClientId=client)
    _surface(p, client, body, friction, restitution)
    # The margin is part of the cylinder, and its default of 0.04 more than a coin in metres has. Contact normals come
    # out within 8e-7 with this one, within 1e-6 with larger ones.
    p.changeDynamics(body, -1, collisionMargin=0.05 * min(height, radius), physicsClientId=client)
    # Without `mass` this call would set it to 0.
    inertia = [0.0, 0.0, mass * radius**2 / k]
    p.changeDynamics(body, -1, mass=mass, localInertiaDiagonal=inertia, physicsClientId=client)
    return DiskBody(body, radius)


@validated
def add_wall(
    client: Client,
    point: tuple[Real, Real],
    normal: tuple[Real, Real],
    *,
    friction: NonNegative = 0.0,
    restitution: NonNegative = 0.0,
) -> WallBody:
    """Add an immovable plane through `point` [length]; disks are on the side to which `normal` points.

    Raises InputError if the normal has no direction, or PyBullet is absent.

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
    p = _world(client)
    length = math.hypot(*normal)
    if length == 0.0:
        raise InputError(f"normal = {normal}: must have a direction")
    unit = (normal[0] / length, normal[1] / length)
    shape = p.createCollisionShape(p.GEOM_PLANE, planeNormal=[*unit, 0.0], physicsClientId=client)
    body = p.createMultiBody(0.0, shape, -1, [*point, 0.0], useMaximalCoordinates=1, physicsClientId=client)
    _surface(p, client, body, friction, restitution)
    return WallBody(body, point, unit)


def _surface(p: Any, client: int, body: int, friction: float, restitution: float) -> None:
    p.changeDynamics(
        body, -1, lateralFriction=friction, restitution=restitution, rollingFriction=0.0, spinningFriction=0.0,
        linearDamping=0.0, angularDamping=0.0, contactProcessingThreshold=0.0, physicsClientId=client,
    )  # fmt: skip


@validated
def place(
    client: Client,
    body: Body,
    position: Pair,
    velocity: Pair,
    spin: Real,
    *,
    angle: Real = 0.0,
    z: Real = 0.0,
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
    p = _world(client)
    turn = [0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)]
    x, y = float(position[0]), float(position[1])
    try:
        p.resetBasePositionAndOrientation(body, [x, y, z], turn, physicsClientId=client)
    except p.error:
        raise InputError(f"body = {body}: must be a body of this client") from None
    # In this order: resetting the position sets the velocity to zero.
    v = [float(velocity[0]), float(velocity[1]), 0.0]
    p.resetBaseVelocity(body, v, [0.0, 0.0, float(spin)], physicsClientId=client)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Colliding bodies: disks and walls, with their properties in PyBullet, read once."""

    disks: tuple[DiskBody, ...]
    """n of them. One of mass 0 is an immovable post."""
    walls: tuple[WallBody, ...]
    mass: Array
    radius: Array
    k: Array
    """mass, radius, k: masses [mass], infinite for a post, radii [length], shape numbers in I = m R^2 / k."""

    @classmethod
    @validated
    def read(cls, client: Client, bodies: Sequence[DiskBody | WallBody | int]) -> Bodies:
        """Read masses and moments of inertia of disks and walls.

        A plain id will do for a body that was made without `useMaximalCoordinates`: of the other kind PyBullet does
        not provide radius or plane, so it requires a `DiskBody` or a `WallBody`.

        Raises InputError if a body is not there, is neither cylinder nor plane, does not stand upright, or cannot
        turn.
        """
        p = _world(client)
        known = [_recognized(p, client, body) if isinstance(body, int) else body for body in bodies]
        disks = tuple(one for one in known if isinstance(one, DiskBody))
        walls = tuple(one for one in known if isinstance(one, WallBody))
        ids = [one.body for one in known]
        if len(set(ids)) < len(ids):
            raise InputError(f"bodies = {ids}: one of them is given twice")
        mass, k = np.full(len(disks), np.inf), np.full(len(disks), 2.0)
        for i, disk in enumerate(disks):
            _check_upright(p, client, disk.body)
            m, _, inertia = p.getDynamicsInfo(disk.body, -1, physicsClientId=client)[:3]
            if m > 0.0:
                if not inertia[2] > 0.0:
                    raise InputError(f"body {disk.body}: its moment of inertia about z is {inertia[2]}, none")
                mass[i], k[i] = m, m * disk.radius**2 / inertia[2]
        return cls(disks, walls, mass, np.array([disk.radius for disk in disks]), k)

    @validated
    def state(self, client: Client) -> tuple[Array, Array, Array, Array]:
        """Positions (n, 3) [length], velocities (n, 2) [length/time], spins and angles (n,) [rad/time, rad]."""
        p = _world(client)
        position, velocity = np.empty((len(self.disks), 3)), np.empty((len(self.disks), 2))
        spin, angle = np.empty(len(self.disks)), np.empty(len(self.disks))
        for i, disk in enumerate(self.disks):
            position[i], turn = p.getBasePositionAndOrientation(disk.body, physicsClientId=client)
            v, w = p.getBaseVelocity(disk.body, physicsClientId=client)
            velocity[i], spin[i] = v[:2], w[2]
            angle[i] = 2.0 * math.atan2(turn[2], turn[3])
        return position, velocity, spin, angle


def _recognized(p: Any, client: int, body: int) -> DiskBody | WallBody:
    """The disk or wall of a plain id."""
    try:
        ((_, _, kind, size, *_),) = p.getCollisionShapeData(body, -1, physicsClientId=client)
    except (p.error, ValueError):
        raise InputError(
            f"body {body}: its shape is not available from PyBullet; give ifrdem.bullet.DiskBody(body, radius) or "
            "ifrdem.bullet.WallBody(body, point, normal)"
        ) from None
    if kind == p.GEOM_CYLINDER:
        return DiskBody(body, size[1])  # its height comes first
    if kind == p.GEOM_PLANE:
        (x, y, _), _ = p.getBasePositionAndOrientation(body, physicsClientId=client)
        if abs(size[2]) > UPRIGHT:
            raise InputError(f"body {body}: a plane with normal {size}, which is not upright")
        return WallBody(body, (x, y), (size[0], size[1]))
    raise InputError(f"body {body}: neither a cylinder nor a plane")


def _check_upright(p: Any, client: int, body: int) -> None:
    try:
        _, turn = p.getBasePositionAndOrientation(body, physicsClientId=client)
    except p.error:
        raise InputError(f"body {body}: there is no such body in this client") from None
    if abs(turn[0]) > UPRIGHT or abs(turn[1]) > UPRIGHT:
        raise InputError(f"body {body}: its axis is not along z; disks move in the plane z = constant")


__all__ = [
    "Bodies", "DiskBody", "Hit", "WallBody", "absence", "add_disk", "add_wall", "describe", "load", "place", "step",
]  # fmt: skip


@validated
def step(
    client: Client, bodies: Bodies | Sequence[DiskBody | WallBody | int], law: LawOrFunction
) -> list[Hit]:
    """Advance a PyBullet world by one step, in which `bodies` collide by a law of `ifrdem.collide`.

    Use it in place of `pybullet.stepSimulation`. Gravity and external forces act as in PyBullet: at the beginning of
    the step, on the velocity; flights within a step are straight.

    Parameters
    ----------
    client : int
        What `pybullet.connect` returned.
    bodies : Bodies or sequence of DiskBody, WallBody or int
        Cylinders and planes that collide with each other. `Bodies.read(client, ...)`, called once, saves reading
        masses at every step.
    law : CollisionLaw, mapping or callable
        One law, as `ifrdem.collide` takes it, or a function of two bodies' ids that returns their law.

    Returns
    -------
    list of Hit
        The collisions of this step, in order, with the ids of both bodies.

    Raises
    ------
    InputError
        If a body is not what `Bodies.read` takes, the law can add energy for a pair, or PyBullet is absent.
    InelasticCollapse
        If a body collides again and again in one step.

    Notes
    -----
    The solver of the whole client stays switched off (`numSolverIterations = 0`): joints, and bodies that are not in
    `bodies`, get no impulses any more. Whether two bodies collide is decided by `bodies` alone; Bullet's collision
    filters do not count. Bodies should have no damping (`changeDynamics(..., linearDamping=0, angularDamping=0)`), or
    Bullet slows them down between collisions. Bodies that overlap and approach at the beginning of a step collide
    right there.

    Examples
    --------
    >>> import ifrdem
    >>> import pybullet
    >>> from ifrdem import bullet
    >>> client = pybullet.connect(pybullet.DIRECT)
    >>> pybullet.setPhysicsEngineParameter(fixedTimeStep=0.5, physicsClientId=client)
    >>> disks = [bullet.add_disk(client, mass=1.0, radius=0.5) for _ in range(2)]
    >>> bullet.place(client, disks[0].body, (0.0, 0.0), (1.0, 0.0), spin=0.0)
    >>> bullet.place(client, disks[1].body, (1.25, 0.0), (0.0, 0.0), spin=0.0)
    >>> hits = bullet.step(client, disks, ifrdem.IFRLaw(e_n=0.5, e_t=-1.0, mu=0.0))
    >>> len(hits), round(hits[0].P_n, 9)  # P_n = (1 + e_n) m_n g_n
    (1, 0.75)
    >>> pybullet.disconnect(client)
    """
    p = _world(client)
    if not isinstance(bodies, Bodies):
        bodies = Bodies.read(client, bodies)
    # Zero iterations: contacts are found, but nothing acts in them. Warm starting would, by earlier impulses.
    p.setPhysicsEngineParameter(numSolverIterations=0, warmStartingFactor=0.0, physicsClientId=client)
    p.stepSimulation(physicsClientId=client)
    position, velocity, spin, angle = bodies.state(client)
    x = position[:, :2].copy()
    members: list[DiskBody | WallBody] = [*bodies.disks, *bodies.walls]
    ids = [one.body for one in members]
    hits = collide_step(
        x, velocity, spin, float(p.getPhysicsEngineParameters(physicsClientId=client)["fixedTimeStep"]),
        (lambda a, b: law(ids[a], ids[b])) if callable(law) else law,
        mass=bodies.mass, radius=bodies.radius, k=bodies.k, angle=angle,
        walls=[(wall.point, wall.normal) for wall in bodies.walls],
    )  # fmt: skip
    for i in sorted(
        {i for hit in hits for i in hit[1:3] if i < len(bodies.disks) and math.isfinite(bodies.mass[i])}
    ):
        z = float(position[i, 2])
        place(client, ids[i], x[i], velocity[i], float(spin[i]), angle=float(angle[i]), z=z)
    return [hit._replace(a=ids[hit.a], b=ids[hit.b]) for hit in hits]
