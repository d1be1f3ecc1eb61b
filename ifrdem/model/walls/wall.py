"""Walls: lines, circles, arcs, polylines and polygons, at rest, moving, turning, or with a moving surface.

A wall is a disk of infinite mass to the collision law, with a material of its own. `kernels/walls` finds when disks
meet it, or one of the pieces that an arc, a polyline or a polygon has.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, nearest, shortened
from ...kernels.columns import WALL, Named, named
from ...kernels.layout import FAR
from ...kernels.walls.kinds import FREE, MOTIONS, PIECES, TURNS
from ...quantities import WALL_SERIES
from ...tools.checked import Array, Integer, NonNegative, Numbers, Pair, Positive, Real, validated
from ..box import Box
from . import outlines
from .motion import Motion, Piston, Turn
from .shapes import FULL_TURN, SHAPES, Circle, Pieces, Shape

SUMS = tuple(name.removeprefix("walls_") for name in WALL_SERIES)
"""Columns of `Simulation.wall_sums`."""
_ON_FACE = 1e-3
"""Part of a distance from the centre of a circle, by which single precision may be off where a disk touches it."""
_STILL, _UNTURNED = Motion(), Turn()


class WallOptions(TypedDict, total=False):
    """Options of any wall; see `Wall`."""

    material: int
    motion: Motion
    turn: Turn
    moves_from: float | None
    moves_until: float | None
    opens_at: float | None
    opens_after: int | None
    surface_speed: float
    temperature: float | None
    group: str
    piston: Piston | None


@validated
@dataclass(frozen=True)
class Wall:
    """A wall. Make one by `line`, `segment`, `container`, `post`, `arc`, `polyline` or `polygon`.

    Notes
    -----
    Walls with the same motion and turn move as one rigid body, as the blades of a paddle do. Walls are ghosts to each
    other: they may cross.

    A disk that hits a thermal wall leaves it with a random velocity, whatever it had, in the frame of the wall's
    surface at that place and time. In a gas of temperature T, disks that cross a line have velocities distributed as
    v_n exp(-m v^2 / (2 T)), because the faster ones come from further away. So v_n = sqrt(-2 (T/m) ln u), u uniform
    in (0, 1] (Rayleigh's distribution), v_t is Gaussian with variance T/m, and the spin, whose distribution has no
    such factor, Gaussian with variance T/I about 0. A gas of elastic disks that has the wall's temperature keeps it;
    a Gaussian v_n would cool it (Tehver et al. 1998, doi:10.1103/PhysRevE.57.R17). On average disks leave with
    m <v^2> / 2 = 3 T / 2: they are faster than those inside. Neither material nor remedies for collapse matter at
    such a wall. Smooth disks get spins from it too.

    Examples
    --------
    >>> import ifrdem
    >>> floor = ifrdem.Wall.line((0.0, 0.01), (0.0, 1.0))
    >>> drum = ifrdem.Wall.container((0.5, 0.5), 0.4, surface_speed=0.2)
    >>> hot = ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0), temperature=2.0)
    >>> floor.shape, drum.radius, hot.temperature
    ('line', 0.4, 2.0)
    >>> chute = ifrdem.Wall.polyline([(0.0, 0.6), (0.4, 0.2), (0.4, 0.1)])
    >>> lid = ifrdem.Wall.segment((0.4, 0.1), (0.6, 0.1), opens_at=2.0)
    >>> blade = ifrdem.Wall.segment((0.3, 0.5), (0.7, 0.5), turn=ifrdem.Turn("steady", center=(0.5, 0.5), rate=3.0))
    >>> len(chute.points), lid.is_present(2.5), blade.most_speed
    (3, False, 0.6000000000000001)
    """

    shape: Literal["line", "segment", "container", "post", "arc", "polyline", "polygon"]
    origin: Pair
    towards: Pair = (0.0, 0.0)
    """origin, towards: a point of a line and its unit normal towards the disks; the beginning of a segment and the
    vector to its end [length]; the centre of a circle [length]."""
    radius: NonNegative = 0.0
    """Of a circle or arc [length]."""
    angles: Pair = (0.0, FULL_TURN)
    """Of an arc: where it begins and, counter-clockwise, where it ends [rad]."""
    points: tuple[Pair, ...] = ()
    """Of a polyline or polygon [length]."""
    holds: Literal["both", "inside", "outside"] = "both"
    """Of a polygon: the side on which disks start, for placements and packing fractions; disks collide with both."""
    material: Annotated[int, Integer(0)] = 0
    """Row of the law's table."""
    motion: Motion = _STILL
    turn: Turn = _UNTURNED
    moves_from: Real | None = None
    moves_until: Real | None = None
    """moves_from, moves_until: times between which the wall moves and rotates [time]; before and after, it stands
    where its motion begins and ends. With `moves_from`, t in the motion counts from it: a steady wall begins where it
    is given."""
    opens_at: Real | None = None
    """A gate: the time from which on the wall is gone [time]."""
    opens_after: Annotated[int, Integer(0, 2**63 - 1)] | None = None
    """A gate: the number of collisions between disks, those before the start included, after which the wall is gone."""
    surface_speed: Real = 0.0
    """Of the surface along its tangent [length/time]: a belt, the rim of a drum. Positive to the left of the normal
    that points to the disk, that is clockwise for a container and counter-clockwise for a post."""
    temperature: Positive | None = None
    """Of a thermal wall, above 0 [energy]: the mean of m v_x^2 of the disks of a gas behind it, so that T = <m v^2>/2,
    and of I omega^2. None for a wall that follows the law."""
    group: str = ""
    """Name that its sums are added up under, together with those of other walls of that name; none by itself."""
    piston: Piston | None = None
    """A mass with which a line, or a segment across the whole box, moves freely along its normal."""

    def __post_init__(self) -> None:
        name = f"{self.shape} wall"
        object.__setattr__(self, "points", tuple(self.points))
        for field, value in SHAPES[self.shape].checked(name, self).items():
            object.__setattr__(self, field, value)
        if self.turn.kind != "still" and not self.geometry.can_turn:
            raise InputError(f"{name}, turn: a line has no end, so it cannot turn; use a segment")
        begin, end = self.moving_times
        if not begin < end:
            raise InputError(f"{name}, moves_until = {end:g}: must be later than moves_from = {begin:g}")
        if self.piston is not None:
            self._check_piston(name)

    def _check_piston(self, name: str) -> None:
        if not self.geometry.can_be_piston:
            raise InputError(
                f"{name}, piston: only a line or a segment can be one, which disks hit along the way that it moves"
            )
        excluded = {
            "motion": self.motion.kind != "still", "turn": self.turn.kind != "still",
            "moves_from": self.moves_from is not None, "moves_until": self.moves_until is not None,
            "opens_at": self.opens_at is not None, "opens_after": self.opens_after is not None,
            "temperature": self.temperature is not None,
        }  # fmt: skip
        for key, given in excluded.items():
            if given:
                raise InputError(f"{name}, piston: it moves freely, and follows the law; leave out {key}")

    def at(self, displacement: float, velocity: float = 0.0) -> Wall:
        """This wall, which is a piston, with its piston elsewhere: displacement [length], velocity [length/time]."""
        assert self.piston is not None
        low, high = self.piston.stops
        inside = min(max(displacement, low), high)
        return replace(self, piston=replace(self.piston, displacement=inside, velocity=velocity))

    @property
    def normal_of_piston(self) -> Pair:
        """Unit vector along which a piston moves: a line's normal, or to the left of a segment."""
        x, y = self.towards
        length = math.hypot(x, y)
        return (x, y) if self.geometry.is_endless else (-y / length, x / length)

    @property
    def geometry(self) -> Shape:
        """Geometry of the shape, before the wall moves."""
        return SHAPES[self.shape](self)

    @classmethod
    @validated
    def line(cls, point: Pair, normal: Pair, **options: Unpack[WallOptions]) -> Wall:
        """An endless straight wall through `point`; disks are on the side to which `normal` points."""
        return cls("line", point, normal, **options)

    @classmethod
    @validated
    def segment(cls, start: Pair, end: Pair, **options: Unpack[WallOptions]) -> Wall:
        """A straight wall from `start` to `end`, without thickness; disks collide with both sides and the ends."""
        (x, y), (x_1, y_1) = start, end
        return cls("segment", (x, y), (x_1 - x, y_1 - y), **options)

    @classmethod
    @validated
    def container(cls, center: Pair, radius: NonNegative, **options: Unpack[WallOptions]) -> Wall:
        """A circular wall around the disks."""
        return cls("container", center, radius=radius, **options)

    @classmethod
    @validated
    def post(cls, center: Pair, radius: NonNegative, **options: Unpack[WallOptions]) -> Wall:
        """A round wall among the disks; radius 0 is a point."""
        return cls("post", center, radius=radius, **options)

    @classmethod
    @validated
    def arc(
        cls,
        center: Pair,
        radius: NonNegative,
        angles: Pair = (0.0, FULL_TURN),
        **options: Unpack[WallOptions],
    ) -> Wall:
        """A part of a circle, without thickness, from the first of two angles [rad] counter-clockwise to the second.

        Disks collide with both sides and the ends.
        """
        return cls("arc", center, radius=radius, angles=angles, **options)

    @classmethod
    @validated
    def polyline(
        cls,
        points: Sequence[Pair] | Array | str | os.PathLike[str],
        *,
        scale: Positive = 1.0,
        **options: Unpack[WallOptions],
    ) -> Wall:
        """Straight walls from point to point, without thickness; disks collide with both sides and the ends.

        `points` may be a file of them: x and y in each line of a text, or an SVG drawing of one path; `scale` is the
        length of its unit [length].
        """
        given = outlines.given("polyline wall", points, scale, closed=False)
        return cls("polyline", (0.0, 0.0), points=given, **options)  # type: ignore[arg-type]

    @classmethod
    @validated
    def polygon(
        cls,
        points: Sequence[Pair] | Array | str | os.PathLike[str],
        holds: Literal["both", "inside", "outside"] = "both",
        *,
        scale: Positive = 1.0,
        **options: Unpack[WallOptions],
    ) -> Wall:
        """The closed outline through some points, without thickness: a container, an obstacle, or both.

        Disks collide with both sides; on which of them they start is for `holds` to say. `points` may be a file, as
        of a `polyline`.
        """
        given = outlines.given("polygon wall", points, scale, closed=True)
        return cls("polygon", (0.0, 0.0), points=given, holds=holds, **options)  # type: ignore[arg-type]

    def rows(self) -> Array:
        """The pieces of the wall as rows of `columns.WALL`, shape (pieces, columns)."""
        pieces = self.geometry.pieces()
        array = np.zeros((sum(len(each.origin) for each in pieces), WALL.width))
        first = 0
        for each in pieces:
            self._write_pieces(named(array[first : first + len(each.origin)], "walls"), each)
            first += len(each.origin)
        rows = named(array, "walls")
        rows.material, rows.surface_speed = self.material, self.surface_speed
        rows.temperature, rows.heat = self.temperature or 0.0, -1.0
        rows.moving.begin, rows.moving.end = np.clip(self.moving_times, -FAR, FAR)
        rows.moving.now = 1.0
        self._write_motion(rows.motion)
        self._write_turn(rows.turn)
        self._write_piston(rows)
        return array

    def _write_pieces(self, rows: Named, pieces: Pieces) -> None:
        rows.kind, rows.radius, rows.half = PIECES.index(pieces.kind), pieces.radius, pieces.half
        rows.x, rows.y = pieces.origin.T
        rows.towards_x, rows.towards_y = pieces.towards.T
        lever = np.hypot(*(pieces.origin - self.turn.center).T)
        if pieces.kind == "segment":
            lever = np.maximum(lever, np.hypot(*(pieces.origin + pieces.towards - self.turn.center).T))
        rows.turn.lever = lever + pieces.radius

    def _write_motion(self, row: Named) -> None:
        motion = self.motion
        row.kind, (row.x, row.y), row.rise = MOTIONS.index(motion.kind), motion.direction, motion.rise
        row.amplitude = motion.speed if motion.kind == "steady" else motion.amplitude
        row.rate, row.phase = motion.frequency, motion.phase / FULL_TURN
        if motion.kind == "sine":
            row.rate, row.phase = FULL_TURN * motion.frequency, motion.phase

    def _write_turn(self, row: Named) -> None:
        turn = self.turn
        row.kind, (row.x, row.y), row.rate = TURNS.index(turn.kind), turn.center, FULL_TURN * turn.frequency
        row.amplitude, row.phase = (turn.rate, 0.0) if turn.kind == "steady" else (turn.amplitude, turn.phase)

    def _write_piston(self, row: Named) -> None:
        row.piston.next = row.piston.sums = -1.0
        row.piston.low, row.piston.high, row.piston.stop_at = -FAR, FAR, FAR
        if (piston := self.piston) is not None:
            row.motion.kind, (row.motion.x, row.motion.y) = FREE, self.normal_of_piston
            row.piston.displacement, row.piston.speed = piston.displacement, piston.velocity
            row.piston.push, row.piston.rate = (
                piston.force / piston.mass,
                math.sqrt(piston.spring / piston.mass),
            )
            row.piston.inverse_mass = 1.0 / piston.mass
            row.piston.low, row.piston.high = np.clip(piston.stops, -FAR, FAR)

    # ------------------------------------------------------------------ where it is

    @property
    def moving_times(self) -> tuple[float, float]:
        """Begin and end of translation and rotation [time]; infinite if they never begin or end."""
        return (
            -math.inf if self.moves_from is None else self.moves_from,
            math.inf if self.moves_until is None else self.moves_until,
        )

    @property
    def gated(self) -> bool:
        """True if it is a gate."""
        return self.opens_at is not None or self.opens_after is not None

    @property
    def changes_with_time(self) -> bool:
        """True if it moves by itself, or is a gate; a piston is moved by disks."""
        return self.motion.kind != "still" or self.turn.kind != "still" or self.gated

    @property
    def supports_rest(self) -> bool:
        """True if disks may come to rest on it (`is_support` of the kernels): it is no piston, neither."""
        still = self.motion.kind == self.turn.kind == "still" and self.piston is None
        return still and not (self.surface_speed or self.temperature)

    def is_present(self, t: float, collisions: int = 0) -> bool:
        """True unless it is a gate that has opened by the time t, or after so many collisions."""
        return (self.opens_at is None or t < self.opens_at) and (
            self.opens_after is None or collisions < self.opens_after
        )

    def moved(self, t: float) -> tuple[Array, float]:
        """Displacement of the wall at a time [length], shape (2,), and the angle by which it has turned [rad].

        A piston is where it starts, or `at` another displacement.
        """
        if self.piston is not None:
            return np.array(self.normal_of_piston) * self.piston.displacement, 0.0
        begin, end = self.moving_times
        t = min(max(t, begin), end)
        t -= begin if math.isfinite(begin) else 0.0
        return np.array(self.motion.direction) * self.motion.displacement(t), self.turn.angle(t)

    def transform(self, points: Array, t: float) -> Array:
        """Points of the wall as it is given [length], shape (n, 2), at the time t."""
        step, angle = self.moved(t)
        if self.turn.kind == "still":
            return points + step
        return _rotated(points - self.turn.center, angle) + self.turn.center + step

    def outline(self, t: float = 0.0, step: float = 0.05) -> Array:
        """Points along the wall at a time [length], shape (n, 2), in steps of this angle [rad] along a circle or arc.

        Empty for a line.
        """
        return self.transform(self.geometry.outline(step), t)

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest x and y [length] of the wall as it turns, but for its displacement, shape (2,)."""
        if self.turn.kind == "still":
            found = self.geometry.extremes()
            return found.min(axis=0), found.max(axis=0)
        lever = self.lever
        return np.subtract(self.turn.center, lever), np.add(self.turn.center, lever)

    @property
    def lever(self) -> float:
        """Distance of its farthest point from the centre of its turn [length]."""
        return self.geometry.lever(self.turn.center)

    def gap(self, position: Array, radius: Array, t: float = 0.0) -> Array:
        """Distance between wall and disks [length] at time t, shape (n,); negative where they overlap."""
        return self.normal(position, t)[1] - radius

    def normal(self, position: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Unit vectors from the wall to points, towards the disks' side, shape (n, 2), and distances, shape (n,).

        A distance [length] is negative on the wrong side of a line, outside of a container, inside of a post or on that
        side of a polygon which does not hold the disks.
        """
        step, angle = self.moved(t)
        position = position - step
        if self.turn.kind == "still":
            return self.geometry.nearest(position)
        away, distance = self.geometry.nearest(
            _rotated(position - self.turn.center, -angle) + self.turn.center
        )
        return _rotated(away, angle), distance

    def reduced_radius(self, radius: float, position: Array, normal: Array, t: float, box: Box) -> float:
        """Radius of Hertz's contact [length] of a disk that hits the wall, as of `kernels.walls.shapes`.

        `normal` is that from the disk to the wall; ends of arcs count as flat.
        """
        if isinstance(self.geometry, Circle) and self.radius > 0.0:
            away = position - self.transform(np.array((self.origin,)), t)[0]
            for each in (away, box.minimum_image(away, t)):
                reach = self.radius - radius if each @ normal > 0.0 else self.radius + radius
                if reach > 0.0 and abs(math.hypot(*each) - reach) < _ON_FACE * reach:
                    return radius * (self.radius / reach)
        return radius

    @property
    def most_speed(self) -> float:
        """The largest speed of any point of its surface [length/time]."""
        turning = self.turn.most_rate * self.lever if self.turn.kind != "still" else 0.0
        return self.motion.most_speed + turning + abs(self.surface_speed)

    @property
    def presses(self) -> bool:
        """True if disks may be pressed against it without gravity: it is curved about them, or accelerates."""
        accelerates = self.motion.kind == "sine" or self.turn.kind != "still" or self.piston is not None
        return accelerates or self.geometry.presses


def _rotated(vectors: Array, angle: float) -> Array:
    """Vectors, shape (n, 2), turned counter-clockwise."""
    c, s = math.cos(angle), math.sin(angle)
    x, y = vectors.T
    return np.column_stack((c * x - s * y, s * x + c * y))


@validated
@dataclass(frozen=True, eq=False)
class WallSums:
    """Sums over all collisions with walls: what the walls gave to the disks.

    Parameters
    ----------
    walls : sequence of Wall
    values : array (walls, 6)
        Columns by the names in `SUMS`.

    Examples
    --------
    >>> import ifrdem
    >>> import numpy as np
    >>> floor = ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0), group="floor")
    >>> sums = ifrdem.WallSums([floor], np.array([[0.0, 6.0, 0.0, 0.0, 0.0, 3.0]]))
    >>> sums.momentum / 2.0  # mean force of the floor on the disks in a time of 2
    array([[0., 3.]])
    >>> sums.of("floor").hits
    array([3.])
    """

    walls: Sequence[Wall]
    values: Annotated[Array, Numbers(("walls", len(SUMS)), -math.inf, math.inf)]

    @property
    def momentum(self) -> Array:
        """Momentum [mass length/time], shape (walls, 2); the mean force on a wall is its negative over the time."""
        return self.values[:, :2]

    @property
    def torque(self) -> Array:
        """Angular momentum, spins included, about the centre of a wall's turn, or the origin [mass length^2/time]."""
        return self.values[:, 2]

    @property
    def work(self) -> Array:
        """Work [energy], shape (walls,)."""
        return self.values[:, 3]

    @property
    def heat(self) -> Array:
        """Heat of thermal walls [energy], shape (walls,)."""
        return self.values[:, 4]

    @property
    def hits(self) -> Array:
        """Number of collisions, shape (walls,)."""
        return self.values[:, 5]

    def of(self, group: str) -> WallSums:
        """The sums of all walls of a group together: arrays of one entry.

        InputError if there is no wall of that name.
        """
        chosen = [wall.group == group for wall in self.walls]
        if not any(chosen) or not group:
            names = sorted({wall.group for wall in self.walls} - {""})
            raise InputError(
                f"group = {shortened(group)}: allowed are {', '.join(names) or 'none'}{nearest(group, names)}"
            )
        first = chosen.index(True)
        return WallSums((self.walls[first],), self.values[chosen].sum(axis=0)[None])


def rows_of(walls: Sequence[Wall]) -> Array:
    """The pieces of walls as rows of `columns.WALL`, shape (pieces, columns); each has its wall's number."""
    found = [wall.rows() for wall in walls]
    for number, rows in enumerate(found):
        named(rows, "walls").owner = number
    return np.concatenate(found) if found else np.empty((0, WALL.width))


def at_displacements(
    walls: Sequence[Wall], displacements: Sequence[float], velocities: Sequence[float] | None = None
) -> tuple[Wall, ...]:
    """Walls with their pistons, one after another, at these displacements [length], with velocities [length/time].

    The pistons are at rest without them.
    """
    left = zip(displacements, velocities or [0.0] * len(displacements), strict=True)
    return tuple(wall if wall.piston is None else wall.at(*next(left)) for wall in walls)


def sides(box: Box) -> list[Wall]:
    """Straight walls at those sides of a box that are not periodic; an open one has no sides."""
    if box.is_open:
        return []
    width, height = box.lengths
    found = []
    if not box.periodic[0]:
        found += [((0.0, 0.0), (1.0, 0.0)), ((width, 0.0), (-1.0, 0.0))]
    if not box.periodic[1]:
        found += [((0.0, 0.0), (0.0, 1.0)), ((0.0, height), (0.0, -1.0))]
    return [Wall.line(point, normal) for point, normal in found]


def free_directions(
    walls: Sequence[Wall], *, immovable: bool = False, smooth: Collection[int] = ()
) -> tuple[bool, bool]:
    """True along x and y where the whole gas can drift: nothing but disks of finite mass pushes it there.

    Collisions conserve its momentum along these directions. Every wall pushes along its normal, and along itself too
    unless it is a line without friction. `walls` are all of them, those at the sides of the box included; `immovable`
    is True if there are disks of infinite mass; `smooth` are the materials of walls without friction
    (`smooth_materials`).

    Examples
    --------
    >>> import ifrdem
    >>> floor = ifrdem.Wall.line((0.0, 0.0), (0.0, 1.0))
    >>> free_directions([]), free_directions([floor]), free_directions([floor], smooth={0})
    ((True, True), (False, False), (True, False))
    """
    along_x, along_y = (
        not immovable and all(axis == _slid_along(wall, smooth) for wall in walls) for axis in (0, 1)
    )
    return along_x, along_y


def _slid_along(wall: Wall, smooth: Collection[int]) -> int | None:
    """Axis along which a wall gives no momentum to disks; None if there is none."""
    if wall.shape != "line" or wall.temperature is not None or wall.material not in smooth:
        return None
    return wall.towards.index(0.0) if 0.0 in wall.towards else None


def smooth_materials(e_t: ArrayLike, mu: ArrayLike, of_disks: Iterable[int]) -> frozenset[int]:
    """Materials of walls whose collisions with disks of all these materials have no tangential impulse.

    `e_t` and `mu` are those of each pair of materials, shape (M, M), nan where a pair has no `IFRLaw`.
    """
    smooth = (np.asarray(e_t) == -1.0) & (np.asarray(mu) == 0.0)
    return frozenset(np.flatnonzero(smooth[sorted(set(of_disks))].all(axis=0)).tolist())


def pieces(walls: Sequence[Wall]) -> int:
    """Number of pieces of walls."""
    return sum(len(group.origin) for wall in walls for group in wall.geometry.pieces())


def wall_names(walls: Sequence[Wall], box: Box) -> tuple[str, ...]:
    """A name for each wall, those at the sides of the box last: its group and shape, its number, or the side.

    The name of a group stands for all of its walls (`columns_of`): a wall or a side that is called like a group of
    others gets an addition.
    """
    at_sides = [name for axis, names in enumerate((("left", "right"), ("bottom", "top"))) for name in names
                if not box.is_open and not box.periodic[axis]]  # fmt: skip
    given = walls[: len(walls) - len(at_sides)]
    groups = {wall.group for wall in given}

    def apart(name: str) -> str:
        while name in groups:
            name += " (not the group)"
        return name

    return tuple(
        map(apart, (*(f"{wall.group or 'wall'} {i} {wall.shape}" for i, wall in enumerate(given)), *at_sides))
    )


def columns_of(name: str, columns: Sequence[str], groups: Sequence[str]) -> list[int]:
    """Numbers of the columns of `wall_names` that a name stands for: those of a group of walls, or the one it names.

    `groups` has the group of each wall, without the sides of the box.
    """
    of_group = [i for i, group in enumerate(groups[: len(columns)]) if group == name != ""]
    return of_group or [i for i, one in enumerate(columns) if one == name]


def to_json(walls: Sequence[Wall]) -> str:
    """Walls as text, for the record of a trajectory."""
    return json.dumps([asdict(wall) for wall in walls])


def from_json(text: str) -> tuple[Wall, ...]:
    """Walls from the text of `to_json`."""
    made = {"motion": Motion, "turn": Turn, "piston": Piston}
    return tuple(
        Wall(
            **{
                key: made[key](**value) if key in made and value is not None else value
                for key, value in one.items()
            }
        )
        for one in json.loads(text)
    )
