"""The walls of a case file: which keys each shape and each motion has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from ..model.walls import outlines
from ..model.walls.motion import Motion, Piston, Turn
from ..model.walls.wall import FULL_TURN
from ..model.walls.wall import Wall as ModelWall
from ..tools.checked import Natural, NonNegative, Part, Positive, Real
from .section import Pair, Section, field


def _point(value: list[float]) -> tuple[float, float]:
    return value[0], value[1]


def _nowhere(data: Mapping[str, Any], key: str) -> list[str]:
    none = (
        isinstance(vector := data.get(key), list) and len(vector) == 2 and all(each == 0 for each in vector)
    )
    return [f"{key} = [0, 0]: it has no direction"] if none else []


class MotionSection(Section):
    """Motion of a wall as a whole: a displacement s(t) from where it stands, along a direction."""

    kind: str = field("sine")
    """ "steady" (s = speed t), "sine" (s = amplitude sin(2 pi frequency t + phase)) or "sawtooth" (from -amplitude to
    amplitude at constant speed, and back)."""
    direction: Pair | None = field([0.0, 1.0], None)
    """Direction [x, y] of a positive displacement [1], of any length; upwards, [0, 1], without it."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, a direction of length 0 included."""
        return super().problems(data) + _nowhere(data, "direction")


class SteadyMotion(MotionSection):
    """A motion at constant velocity."""

    kind: Literal["steady"]
    speed: Real = field(0.1)
    """Along the direction [m/s]."""


class SineMotion(MotionSection):
    """A motion as a sine of time."""

    kind: Literal["sine"]
    amplitude: Positive = field(5.0e-3)
    """Largest displacement [m]."""
    frequency: Positive = field(20.0)
    """Periods per time [1/s]."""
    phase: Real | None = field(0.0, None)
    """At t = 0 [rad]; 2 pi is a period, 0 if not given."""


class SawtoothMotion(SineMotion):
    """A motion at constant speed, forth and back."""

    kind: Literal["sawtooth"]  # type: ignore[assignment]
    rise: Part | None = field(0.5, None)
    """Part of the period in which it goes forth [1]; 0.5 if not given."""


class TurnSection(Section):
    """Rotation of a wall as a whole about a centre, counter-clockwise."""

    kind: str = field("steady")
    """ "steady" (angle = rate t) or "sine" (angle = amplitude sin(2 pi frequency t + phase))."""
    center: Pair = field([0.5, 0.5])
    """Centre [x, y] of the rotation [m]; the wall's motion carries it along."""


class SteadyTurn(TurnSection):
    """A rotation at constant angular velocity."""

    kind: Literal["steady"]
    rate: Real = field(2.0)
    """Angular velocity [rad/s]."""


class SineTurn(TurnSection):
    """A rotation as a sine of time."""

    kind: Literal["sine"]
    amplitude: Positive = field(0.5)
    """Largest angle [rad]."""
    frequency: Positive = field(1.0)
    """Periods per time [1/s]."""
    phase: Real | None = field(0.0, None)
    """At t = 0 [rad]; 0 if not given."""


MotionOfWall = Annotated[SteadyMotion | SineMotion | SawtoothMotion, Field(discriminator="kind")]
TurnOfWall = Annotated[SteadyTurn | SineTurn, Field(discriminator="kind")]


class PistonSection(Section):
    """A mass by which a line, or a segment across the box, moves freely along its normal."""

    mass: Positive = field(0.05)
    """Of the wall [kg]."""
    force: Real | None = field(0.1, None)
    """Constant force along the normal [N]; of a line, a positive one presses on the disks. None without it."""
    spring: NonNegative | None = field(2.0, None)
    """Stiffness of a spring that is relaxed where the wall is given [N/m]. None without it."""
    displacement: Real | None = field(0.0, None)
    """Along the normal at t = 0, from where the wall is given [m]; 0 if not given."""
    velocity: Real | None = field(0.0, None)
    """Along the normal at t = 0 [m/s]; 0 if not given."""
    low: Real | None = field(-0.1, None)
    """Least displacement [m], at a stop that reflects it. No stop without it."""
    high: Real | None = field(0.1, None)
    """Largest displacement [m], likewise."""


class WallSection(Section):
    """A wall other than the sides of the box: at rest, moving, rotating, with a moving surface, or thermal."""

    kind_key: ClassVar[str] = "shape"

    shape: str = field("line")
    """ "line" (endless; point, normal), "segment" (both sides and the ends; start, end), "container" (a circle around
    the disks; center, radius), "post" (a round obstacle; center, radius), "arc" (both sides and the ends; center,
    radius, angles), "polyline" or "polygon" (both sides, all corners; points, file or path)."""
    material: str | None = field("steel", None, min_length=1, max_length=100)
    """Name of the material [text]: that of a species, or another one with a [[pair]] for each material of the disks.
    Every wall needs one, except a thermal wall, which has none."""
    motion: MotionOfWall | None = field({"kind": "sine", "amplitude": 5.0e-3, "frequency": 20.0}, None)
    """Motion of the whole wall [table; m, 1/s, rad]: "steady" (speed), "sine" or "sawtooth" (amplitude, frequency,
    phase; rise), along a direction. At rest without it."""
    turn: TurnOfWall | None = field({"kind": "steady", "center": [0.5, 0.5], "rate": 2.0}, None)
    """Rotation of the whole wall [table; m, rad/s, 1/s, rad]: "steady" (rate) or "sine" (amplitude, frequency, phase),
    about a center. Walls with the same motion and turn move as one."""
    piston: PistonSection | None = field({"mass": 0.05, "force": 0.1}, None)
    """A mass with which a line, or a segment across the box, moves freely along its normal [table; kg, N, N/m, m, m/s],
    driven by impacts, gravity, a constant force and a spring, between stops low and high."""
    moves_from: Real | None = field(1.0, None)
    """Time from which on it moves and turns [s]; its motion begins then, with its phase. Always without it."""
    moves_until: Real | None = field(2.0, None)
    """Time until which it moves and turns [s]; then it stays there. For ever without it."""
    opens_at: Real | None = field(1.0, None)
    """A gate: the time from which on it is gone [s]."""
    opens_after: Natural | None = field(1000, None)
    """A gate: the number of collisions of two disks after which it is gone [whole number]."""
    group: str | None = field("paddle", None, min_length=1, max_length=100)
    """Name under which what it gives to the disks is added up, with other walls of that name [text]."""
    surface_speed: Real = field(0.5, 0.0)
    """Speed of its surface along itself [m/s], as of a belt or drum; positive is clockwise for a container,
    counter-clockwise for a post, and to the left seen along a line's normal."""
    temperature: Positive | None = field(5.0e-4, None)
    """A thermal wall: disks leave it with random velocities, as if from a gas of this temperature, mean of m v^2 / 2
    [J]."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, a wall without a material or with two included."""
        problems = super().problems(data)
        if ("material" in data) == ("temperature" in data):
            problems.append(
                "must have either material or temperature: disks leave a thermal wall whatever it is made of"
            )
        return problems

    def wall(self, material: int = 0, folder: Path | None = None) -> ModelWall:
        """The wall that stands here, of the material in this row of the law's table; files are looked for in `folder`.

        Raises
        ------
        InputError
            If a file cannot be read, or its points or those given are no polyline or polygon.
        """
        options: dict[str, Any] = {"material": material, "surface_speed": self.surface_speed}
        if self.motion is not None:
            options["motion"] = Motion(**self.motion.model_dump(exclude_none=True))
        if self.turn is not None:
            given = self.turn.model_dump(exclude_none=True)
            options["turn"] = Turn(**{**given, "center": tuple(given["center"])})
        if self.piston is not None:
            options["piston"] = Piston(**self.piston.model_dump(exclude_none=True))
        for name in ("temperature", "moves_from", "moves_until", "opens_at", "opens_after", "group"):
            if (value := getattr(self, name)) is not None:
                options[name] = value
        return self._made(folder, options)

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        """The wall of this shape."""
        # Abstract: cases are read into one of the sections by shape below, and each has its own.
        raise NotImplementedError


class LineWall(WallSection):
    """An endless straight wall, with disks on one side."""

    shape: Literal["line"]
    point: Pair = field([0.0, 0.0])
    """A point [x, y] of it [m]."""
    normal: Pair = field([0.0, 1.0])
    """Direction [x, y] from it to the disks [1], of any length."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, a normal of length 0 and a rotation included."""
        turns = ["turn: a line has no end, so it cannot turn; use a segment"] * ("turn" in data)
        return super().problems(data) + turns + _nowhere(data, "normal")

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        return ModelWall.line(_point(self.point), _point(self.normal), **options)


class SegmentWall(WallSection):
    """A straight wall between two ends; disks may be on both sides."""

    shape: Literal["segment"]
    start: Pair = field([0.1, 0.1])
    """One end [x, y] [m]."""
    end: Pair = field([0.2, 0.1])
    """The other end [x, y] [m]."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, equal ends included."""
        same = "start" in data and data["start"] == data.get("end")
        text = 'start = end: a segment has two ends; a point is a "post" of radius 0'
        return super().problems(data) + [text] * same

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        return ModelWall.segment(_point(self.start), _point(self.end), **options)


class ContainerWall(WallSection):
    """A circle around the disks."""

    shape: Literal["container"]
    center: Pair = field([0.5, 0.5])
    """Centre [x, y] [m]."""
    radius: Positive = field(0.4)
    """Radius [m]."""

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        return ModelWall.container(_point(self.center), self.radius, **options)


class PostWall(WallSection):
    """A round obstacle."""

    shape: Literal["post"]
    center: Pair = field([0.5, 0.5])
    """Centre [x, y] [m]."""
    radius: NonNegative = field(0.4)
    """Radius [m]; 0 is a point."""

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        return ModelWall.post(_point(self.center), self.radius, **options)


class ArcWall(WallSection):
    """A part of a circle; disks may be on both sides."""

    shape: Literal["arc"]
    center: Pair = field([0.5, 0.5])
    """Centre [x, y] [m]."""
    radius: Positive = field(0.4)
    """Radius [m]."""
    angles: Pair | None = field([0.0, 3.14], None)
    """Angles [begin, end], counter-clockwise from the x axis [rad]; a whole circle without them."""

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        angles = (0.0, FULL_TURN) if self.angles is None else _point(self.angles)
        return ModelWall.arc(_point(self.center), self.radius, angles, **options)


class PolylineWall(WallSection):
    """Straight pieces between points; disks may be on both sides."""

    one_of: ClassVar[tuple[tuple[str, ...], ...]] = (("points", "file", "path"),)

    shape: Literal["polyline"]
    points: list[Pair] | None = field([[0.1, 0.1], [0.2, 0.3], [0.3, 0.1]], None)
    """Points [[x, y], ...] [m]."""
    file: str | None = field("hopper.csv", None, min_length=1)
    """Instead: a file of them [path from the case file], with x and y in each line [m], or an SVG drawing of one
    path."""
    path: str | None = field("M 0.1 0.1 L 0.2 0.3 C 0.3 0.3 0.3 0.2 0.4 0.1", None, min_length=1)
    """Instead: the data of an SVG path, y upwards [text of numbers in m]: commands M, L, H, V, Z, C, S, Q, T, A."""
    scale: Positive | None = field(1.0e-3, None)
    """Length of a unit of the file [m]; 1 if not given."""
    tolerance: Positive | None = field(1.0e-5, None)
    """Largest distance of the straight pieces that stand for curves of a path [m]; 1e-4 of its size if not given."""

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Mistakes, a tolerance without curves and a scale without a file included."""
        problems = super().problems(data)
        if "tolerance" in data and "points" in data:
            problems.append("tolerance: points have no curves")
        if "scale" in data and "file" not in data:
            problems.append("scale: only a file has it; points and paths are lengths")
        return problems

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        return ModelWall.polyline(self._outline(folder, closed=False), **options)

    def _outline(self, folder: Path | None, *, closed: bool) -> Sequence[tuple[float, float]]:
        """Points as they are given, from a file, or of a path.

        Raises InputError if a polygon's outline does not come back to where it begins.
        """
        if self.points is not None:
            return [(x, y) for x, y in self.points]
        if self.file is not None:
            place = (folder or Path()) / self.file
            return outlines.given(self.shape, place, self.scale or 1.0, self.tolerance, closed=closed)
        return outlines.outline("path", *outlines.of_path(self.path or "", self.tolerance), closed=closed)


class PolygonWall(PolylineWall):
    """A closed outline."""

    shape: Literal["polygon"]  # type: ignore[assignment]
    holds: Literal["both", "inside", "outside"] | None = field("inside", None)
    """Place of the disks at the start: "inside" of a polygon, "outside", or on "both" sides, if not given; packing
    fractions count it."""

    def _made(self, folder: Path | None, options: dict[str, Any]) -> ModelWall:
        return ModelWall.polygon(self._outline(folder, closed=True), self.holds or "both", **options)


Wall = Annotated[
    LineWall | SegmentWall | ContainerWall | PostWall | ArcWall | PolylineWall | PolygonWall,
    Field(discriminator="shape"),
]
