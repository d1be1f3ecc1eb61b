"""The walls of a case file: which keys each shape and each motion has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from ..model.walls import Motion, Wall
from .section import Keys, Section, key

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]


def _nowhere(data: dict[str, Any], key: str) -> list[str]:
    none = (
        isinstance(vector := data.get(key), list) and len(vector) == 2 and all(each == 0 for each in vector)
    )
    return [f"{key} = [0, 0]: it has no direction"] if none else []


class MotionSection(Section):
    """Motion of a wall as a whole: a displacement s(t) from where it stands, along a direction."""

    kind: Literal["steady", "sine", "sawtooth"] = key("sine")
    """ "steady" (s = speed t), "sine" (s = amplitude sin(2 pi frequency t + phase)) or "sawtooth" (from -amplitude to
    amplitude at constant speed, and back)."""
    direction: Pair | None = key([0.0, 1.0], None)
    """Direction [x, y] of a positive displacement [1], of any length; upwards, [0, 1], without it."""
    speed: float | None = key(0.1, None)
    """Of a steady motion [m/s]."""
    amplitude: float | None = key(5.0e-3, None, gt=0.0)
    """Largest displacement [m]."""
    frequency: float | None = key(20.0, None, gt=0.0)
    """Periods per time [1/s]."""
    phase: float | None = key(0.0, None)
    """At t = 0 [rad]; 2 pi is a period, 0 if not given."""
    rise: float | None = key(0.5, None, gt=0.0, lt=1.0)
    """Part of the period in which a sawtooth rises [1]; 0.5 if not given."""

    kinds: ClassVar[Mapping[str, Keys]] = {
        "steady": Keys(("speed",)),
        "sine": Keys(("amplitude", "frequency"), also=("phase",)),
        "sawtooth": Keys(("amplitude", "frequency"), also=("phase", "rise")),
    }

    @classmethod
    def mistakes(cls, data: dict[str, Any]) -> list[str]:
        """Also a direction that is none."""
        return super().mistakes(data) + _nowhere(data, "direction")


class WallSection(Section):
    """A wall beside the sides of the box: at rest, moving, with a moving surface, or hot. Up to 31 with the sides."""

    shape: Literal["line", "segment", "container", "post"] = key("line")
    """ "line" (endless; point, normal), "segment" (both sides and the ends; start, end), "container" (a circle around
    the disks; center, radius) or "post" (a round obstacle; center, radius)."""
    material: str | None = key("steel", None, min_length=1, max_length=100)
    """Name of the material [text]: that of a species, or another one with a [[pair]] for each material of the disks.
    Needed but for a thermal wall, which has none."""
    point: Pair | None = key([0.0, 0.0], None)
    """A point [x, y] of a line [m]."""
    normal: Pair | None = key([0.0, 1.0], None)
    """Direction [x, y] from a line to the disks [1], of any length."""
    start: Pair | None = key([0.1, 0.1], None)
    """One end [x, y] of a segment [m]."""
    end: Pair | None = key([0.2, 0.1], None)
    """The other end [x, y] of a segment [m]."""
    center: Pair | None = key([0.5, 0.5], None)
    """Centre [x, y] of a container or post [m]."""
    radius: float | None = key(0.4, None, ge=0.0)
    """Radius of a container or post [m]; a post may have 0."""
    motion: MotionSection | None = key({"kind": "sine", "amplitude": 5.0e-3, "frequency": 20.0}, None)
    """How it moves as a whole [table; m, 1/s, rad]: "steady" (speed), "sine" or "sawtooth" (amplitude, frequency,
    phase; rise), along a direction. At rest without it."""
    surface_speed: float = key(0.5, 0.0)
    """Speed of its surface along itself [m/s], as of a belt or drum; positive is clockwise for a container,
    counter-clockwise for a post, and to the left seen along a line's normal."""
    temperature: float | None = key(5.0e-4, None, gt=0.0)
    """A thermal wall: disks leave it with random velocities, as if from a gas of this temperature, mean of m v^2 / 2
    [J]."""

    selector = "shape"
    kinds: ClassVar[Mapping[str, Keys]] = {
        "line": Keys(("point", "normal")),
        "segment": Keys(("start", "end")),
        "container": Keys(("center", "radius")),
        "post": Keys(("center", "radius")),
    }

    @classmethod
    def mistakes(cls, data: dict[str, Any]) -> list[str]:
        """Also a wall of no material or of two, and places that are none."""
        wrong = super().mistakes(data)
        if ("material" in data) == ("temperature" in data):
            wrong.append(
                "either material or temperature is needed: disks leave a thermal wall whatever it is made of"
            )
        if data.get("shape") == "container" and data.get("radius") == 0:
            wrong.append("radius = 0: a container needs one above 0")
        if data.get("shape") == "segment" and "start" in data and data["start"] == data.get("end"):
            wrong.append('start = end: a segment has two ends; a point is a "post" of radius 0')
        return wrong + _nowhere(data, "normal")

    def wall(self, material: int = 0) -> Wall:
        """The wall that stands here, of the material in this row of the law's table."""
        options: dict[str, Any] = {"material": material, "surface_speed": self.surface_speed}
        if self.motion is not None:
            options["motion"] = Motion(**self.motion.model_dump(exclude_none=True))
        if self.temperature is not None:
            options["temperature"] = self.temperature

        def point(value: list[float] | None) -> tuple[float, float]:
            assert value is not None  # `wrong_choice` sees to it
            return value[0], value[1]

        match self.shape:
            case "line":
                return Wall.line(point(self.point), point(self.normal), **options)
            case "segment":
                return Wall.segment(point(self.start), point(self.end), **options)
            case "container":
                return Wall.container(point(self.center), self.radius or 0.0, **options)
            case "post":
                return Wall.post(point(self.center), self.radius or 0.0, **options)
