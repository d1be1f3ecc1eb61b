"""Walls: lines, segments, containers and posts, at rest, moving, or with a moving surface.

A wall is a disk of infinite mass to the collision law, with a material of its own. `kernels/walls.py` finds when disks
meet it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal, TypedDict, Unpack

import numpy as np

from ..errors import InputError, nearest
from ..kernels.limits import MOST_WALLS
from ..tools import checked
from ..tools.checked import Array
from .box import Box

Point = tuple[float, float]
SHAPES = ("line", "segment", "container", "post")
MOTIONS = ("still", "steady", "sine", "sawtooth")


def _number(
    name: str, value: float, low: float = -math.inf, high: float = math.inf, *, open_: bool = False
) -> float:
    number = checked.real(name, value, "a finite number is needed")
    inside = low < number < high if open_ else low <= number <= high
    if not (math.isfinite(number) and inside):
        between = "" if low == -math.inf else f" {'above' if open_ else 'not below'} {low:g}"
        between += "" if high == math.inf else f" and {'below' if open_ else 'not above'} {high:g}"
        raise InputError(f"{name} = {value}: a finite number{between} is needed")
    return number


@dataclass(frozen=True)
class Motion:
    """Motion of a wall as a whole: a displacement s(t) along a direction; t is the time of the run.

    InputError if a number is not finite or out of its range.

    Parameters
    ----------
    kind : {"still", "steady", "sine", "sawtooth"}
        steady: s = speed t. sine: s = amplitude sin(2 pi frequency t + phase). sawtooth: at constant speed from
        -amplitude to +amplitude in the part `rise`, between 0 and 1, of a period, and back in the rest of it.
    direction : two floats
        Any length but 0; only the direction counts.
    speed, amplitude, frequency : float
        [length/time], [length], [1/time].
    phase : float
        At t = 0 [rad]; 2 pi is a whole period.

    Examples
    --------
    >>> import ifrdem
    >>> floor = ifrdem.Motion("sine", amplitude=0.01, frequency=20.0)
    >>> floor.kind, floor.direction
    ('sine', (0.0, 1.0))
    """

    kind: str = "still"
    direction: Point = (0.0, 1.0)
    speed: float = 0.0
    amplitude: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0
    rise: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in MOTIONS:
            raise InputError(
                f"motion kind = '{self.kind}': allowed are {', '.join(MOTIONS)}{nearest(self.kind, MOTIONS)}"
            )
        x, y = checked.finite_pair("motion direction", self.direction)
        length = math.hypot(x, y)
        if length == 0.0:
            raise InputError("motion direction = (0, 0): it has no direction")
        set_ = object.__setattr__
        set_(self, "direction", (x / length, y / length))
        for name, low in (("speed", -math.inf), ("amplitude", 0.0), ("frequency", 0.0), ("phase", -math.inf)):
            set_(self, name, _number(f"motion {name}", getattr(self, name), low))
        set_(self, "rise", _number("motion rise", self.rise, 0.0, 1.0, open_=True))
        if self.kind in ("sine", "sawtooth") and self.frequency == 0.0:
            raise InputError(f"motion kind = '{self.kind}': a frequency above 0 is needed")

    @property
    def most_speed(self) -> float:
        """The largest speed [length/time]."""
        if self.kind == "steady":
            return abs(self.speed)
        if self.kind == "sine":
            return 2.0 * math.pi * self.frequency * self.amplitude
        if self.kind == "sawtooth":
            return 2.0 * self.amplitude * self.frequency / min(self.rise, 1.0 - self.rise)
        return 0.0

    @property
    def extent(self) -> float:
        """Largest displacement from its middle position [length]; infinite for a steady motion."""
        return math.inf if self.kind == "steady" and self.speed != 0.0 else self.amplitude

    def displacement(self, t: float) -> float:
        """s(t) [length]."""
        if self.kind == "steady":
            return self.speed * t
        if self.kind == "sine":
            return self.amplitude * math.sin(2.0 * math.pi * self.frequency * t + self.phase)
        if self.kind == "sawtooth":
            part = (self.frequency * t + self.phase / (2.0 * math.pi)) % 1.0
            if part < self.rise:
                return self.amplitude * (2.0 * part / self.rise - 1.0)
            return self.amplitude * (1.0 - 2.0 * (part - self.rise) / (1.0 - self.rise))
        return 0.0


class WallOptions(TypedDict, total=False):
    """Options of any wall; see `Wall`."""

    material: int
    motion: Motion
    surface_speed: float
    temperature: float | None


@dataclass(frozen=True)
class Wall:
    """A wall. Make one by `line`, `segment`, `container` or `post`.

    Notes
    -----
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
    """

    shape: Literal["line", "segment", "container", "post"]
    place: Point
    towards: Point = (0.0, 0.0)
    """place, towards: a point of a line and its unit normal towards the disks; the beginning of a segment and the
    vector to its end [length]; the centre of a circle [length]."""
    radius: float = 0.0
    """Of a circle [length]."""
    material: int = 0
    """Row of the law's table."""
    motion: Motion = Motion()
    surface_speed: float = 0.0
    """Of the surface along its tangent [length/time]: a belt, the rim of a drum. Positive to the left of the normal
    that points to the disk, that is clockwise for a container and counter-clockwise for a post."""
    temperature: float | None = None
    """Of a thermal wall, above 0 [energy]: the mean of m v_x^2 of the disks of a gas behind it, so that T = <m v^2>/2,
    and of I omega^2. None for a wall that follows the law."""

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise InputError(
                f"wall shape = '{self.shape}': allowed are {', '.join(SHAPES)}{nearest(self.shape, SHAPES)}"
            )
        set_, name = object.__setattr__, f"{self.shape} wall"
        set_(self, "place", checked.finite_pair(f"{name}, place", self.place))
        set_(self, "towards", checked.finite_pair(f"{name}, direction", self.towards))
        if self.shape in ("line", "segment") and math.hypot(*self.towards) == 0.0:
            line = self.shape == "line"
            wrong = "normal = (0, 0): it has no direction" if line else "both ends are the same"
            raise InputError(f"{name}: {wrong}")
        if self.shape == "line":
            length = math.hypot(*self.towards)
            set_(self, "towards", (self.towards[0] / length, self.towards[1] / length))
        set_(self, "radius", _number(f"{name}, radius", self.radius, 0.0, open_=self.shape == "container"))
        set_(self, "material", checked.whole(f"{name}, material", self.material, 0))
        set_(self, "surface_speed", _number(f"{name}, surface speed", self.surface_speed))
        if not isinstance(self.motion, Motion):
            raise InputError(f"{name}, motion = {self.motion!r}: a Motion is needed")
        if self.temperature is not None:
            set_(self, "temperature", _number(f"{name}, temperature", self.temperature, 0.0, open_=True))

    @classmethod
    def line(cls, point: Point, normal: Point, **options: Unpack[WallOptions]) -> Wall:
        """An endless straight wall through `point`; disks are on the side to which `normal` points."""
        return cls("line", point, normal, **options)

    @classmethod
    def segment(cls, start: Point, end: Point, **options: Unpack[WallOptions]) -> Wall:
        """A straight wall from `start` to `end`, without thickness; disks collide with both sides and the ends."""
        x, y = checked.finite_pair("segment wall, start", start)
        x_1, y_1 = checked.finite_pair("segment wall, end", end)
        return cls("segment", (x, y), (x_1 - x, y_1 - y), **options)

    @classmethod
    def container(cls, center: Point, radius: float, **options: Unpack[WallOptions]) -> Wall:
        """A circular wall around the disks."""
        return cls("container", center, radius=radius, **options)

    @classmethod
    def post(cls, center: Point, radius: float, **options: Unpack[WallOptions]) -> Wall:
        """A round wall among the disks; radius 0 is a point."""
        return cls("post", center, radius=radius, **options)

    def row(self, offset: Array) -> Array:
        """The wall as a row of `kernels/walls.py`, every position moved by `offset` [length], shape (2,)."""
        motion, turn = self.motion, 2.0 * math.pi
        amplitude = motion.speed if motion.kind == "steady" else motion.amplitude
        rate, phase = motion.frequency, motion.phase / turn
        if motion.kind == "sine":
            rate, phase = turn * rate, motion.phase
        row = [
            SHAPES.index(self.shape), *(np.array(self.place) + offset), *self.towards, self.radius,
            MOTIONS.index(motion.kind), *motion.direction, amplitude, rate, phase, motion.rise,
            self.surface_speed, self.material, 0.0, self.temperature or 0.0, -1.0,
        ]  # fmt: skip
        return np.array(row, dtype=np.float64)

    def gap(self, position: Array, radius: Array, t: float = 0.0) -> Array:
        """Distance between wall and disks [length] at time t, shape (n,); negative where they overlap."""
        return self.normal(position, t)[1] - radius

    def normal(self, position: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Unit vectors from the wall to points, towards the disks' side, shape (n, 2), and distances, shape (n,).

        A distance [length] is negative on the wrong side of a line, outside of a container or inside of a post.
        """
        moved = np.array(self.place) + np.array(self.motion.direction) * self.motion.displacement(t)
        d = position - moved
        towards = np.array(self.towards)
        if self.shape == "line":
            return np.broadcast_to(towards, d.shape), d @ towards
        if self.shape == "segment":
            along = np.clip(d @ towards / (towards @ towards), 0.0, 1.0)
            d = d - along[:, None] * towards
        r = np.hypot(d[:, 0], d[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            away = np.where(r[:, None] > 0.0, d / r[:, None], (1.0, 0.0))  # in its middle, any direction does
        return (-away, self.radius - r) if self.shape == "container" else (away, r - self.radius)

    @property
    def most_speed(self) -> float:
        """The largest speed of any point of its surface [length/time]."""
        return self.motion.most_speed + abs(self.surface_speed)


def sides(box: Box, material: int = 0) -> list[Wall]:
    """Straight walls at those sides of a box that are not periodic; an open one has no sides."""
    if box.is_open:
        return []
    width, height = box.lengths
    found = []
    if not box.periodic[0]:
        found += [((0.0, 0.0), (1.0, 0.0)), ((width, 0.0), (-1.0, 0.0))]
    if not box.periodic[1]:
        found += [((0.0, 0.0), (0.0, 1.0)), ((0.0, height), (0.0, -1.0))]
    return [Wall.line(point, normal, material=material) for point, normal in found]


def check_types(walls: Sequence[Wall]) -> None:
    """Raise InputError unless these are walls."""
    if isinstance(walls, Wall) or not isinstance(walls, Sequence):
        raise InputError(f"walls = {walls!r}: a list of walls is needed, [wall] for one")
    for w, one in enumerate(walls):
        if not isinstance(one, Wall):
            raise InputError(f"walls[{w}] = {one!r}: a Wall is needed, such as Wall.line(...)")


def check_place(wall: Wall, box: Box) -> None:
    """Raise InputError if a wall reaches across a periodic side of the box, where it is not repeated."""
    x, y = wall.place
    reach = wall.radius + (0.0 if math.isinf(wall.motion.extent) else wall.motion.extent)
    for axis, side in enumerate(box.lengths):
        if not box.periodic[axis]:
            continue
        if wall.shape == "line":
            if wall.towards[axis] != 0.0:
                raise InputError(
                    f"a line across a periodic direction of the box ({'xy'[axis]}); make that direction not periodic"
                )
            continue
        if math.isinf(wall.motion.extent) and wall.motion.direction[axis] != 0.0:
            raise InputError(
                f"its steady motion carries it across a periodic side of the box ({'xy'[axis]}), where walls are not "
                "repeated; let it oscillate, or make that direction not periodic"
            )
        end = wall.place[axis] + (wall.towards[axis] if wall.shape == "segment" else 0.0)
        if min(wall.place[axis], end) - reach < 0.0 or max(wall.place[axis], end) + reach > side:
            raise InputError(
                f"at ({x:.6g}, {y:.6g}) it reaches beyond a periodic side of the box, where walls are not repeated; "
                "move it inside, or make that direction not periodic"
            )


def check(
    walls: Sequence[Wall], box: Box, position: Array, radius: Array, materials: int | None = None,
    time: float = 0.0, tolerance: float = 0.0,
) -> None:  # fmt: skip
    """Refuse walls that cannot be simulated, or that disks overlap at the start, which is at `time` [time].

    `materials` is how many the law's table has, if it is known; overlaps up to `tolerance` [length] do not count.
    InputError names wall and disk, and by how much they overlap.
    """
    if walls and box.is_open:
        instead = "use a box with sides, large enough for the disks not to reach them"
        raise InputError(f"walls are not supported in an open box: {instead}")
    if len(walls) > MOST_WALLS:
        most = f"{MOST_WALLS} at most are supported, the sides of the box included"
        raise InputError(f"{len(walls)} walls: {most}")
    for w, wall in enumerate(walls):
        name = f"wall {w} ({wall.shape})"
        if materials is not None and not 0 <= wall.material < materials:
            index = f"material index {wall.material}"
            raise InputError(f"{name}: {index}: the law table has {materials} materials")
        try:
            check_place(wall, box)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
        if len(position):
            gap = wall.gap(position, radius, time)
            worst = int(np.argmin(gap))
            if gap[worst] < -tolerance:
                where = f"disk {worst} at ({position[worst, 0]:.6g}, {position[worst, 1]:.6g})"
                raise InputError(f"{where} overlaps {name} by {-gap[worst]:.3g}")


def to_json(walls: Sequence[Wall]) -> str:
    """Walls as text, for the record of a trajectory."""
    return json.dumps([asdict(wall) for wall in walls])


def from_json(text: str) -> tuple[Wall, ...]:
    """Walls from the text of `to_json`."""
    return tuple(Wall(**{**one, "motion": Motion(**one["motion"])}) for one in json.loads(text))
