"""The walls of a case file: which keys each shape and each motion has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from ..model.walls import Motion, Wall
from .section import Section

SHAPES: Mapping[str, tuple[str, ...]] = {
    "line": ("point", "normal"),
    "segment": ("start", "end"),
    "container": ("center", "radius"),
    "post": ("center", "radius"),
}
"""Keys that each shape needs, and no other one has."""

MOTIONS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "steady": (("speed",), ()),
    "sine": (("amplitude", "frequency"), ("phase",)),
    "sawtooth": (("amplitude", "frequency"), ("phase", "rise")),
}
"""Keys that each kind of motion needs, and those that it may have; all of them may have a direction."""

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]


def _wrong_keys(what: str, needed: tuple[str, ...], known: tuple[str, ...], given: set[str]) -> str | None:
    """Which keys are missing or cannot stand there, or None."""
    wrong = []
    foreign = sorted(given - set(known))
    if foreign:
        wrong.append(f"{', '.join(foreign)} cannot stand here; known for it: {', '.join(known)}")
    missing = [key for key in needed if key not in given]
    if missing:
        wrong.append(f"{', '.join(missing)} missing")
    return f"{what}: {'; '.join(wrong)}" if wrong else None


def _nowhere(vector: Any) -> bool:
    return isinstance(vector, list) and len(vector) == 2 and all(each == 0 for each in vector)


class MotionSection(Section):
    """How a wall moves as a whole: a displacement s(t) from where it stands, along a direction."""

    kind: Literal["steady", "sine", "sawtooth"] = Field(
        description='"steady" (s = speed t), "sine" (s = amplitude sin(2 pi frequency t + phase)) or "sawtooth" '
        "(from -amplitude to amplitude at constant speed, and back)",
        examples=["sine"],
    )
    direction: Pair | None = Field(
        default=None,
        description="direction [x, y] of a positive displacement [1], of any length; upwards, [0, 1], without it",
        examples=[[0.0, 1.0]],
    )
    speed: float | None = Field(default=None, description="of a steady motion [m/s]", examples=[0.1])
    amplitude: float | None = Field(
        default=None, gt=0.0, description="largest displacement [m]", examples=[5.0e-3]
    )
    frequency: float | None = Field(
        default=None, gt=0.0, description="periods per time [1/s]", examples=[20.0]
    )
    phase: float | None = Field(
        default=None, description="at t = 0 [rad]; 2 pi is a period, 0 if not given", examples=[0.0]
    )
    rise: float | None = Field(
        default=None,
        gt=0.0,
        lt=1.0,
        description="part of the period in which a sawtooth rises [1]; 0.5 if not given",
        examples=[0.5],
    )

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """Which keys this kind of motion lacks, or cannot have."""
        kind = data.get("kind")
        if not isinstance(kind, str) or kind not in MOTIONS:
            return None  # said of the kind itself
        needed, also = MOTIONS[kind]
        given = {key for key in data if key in cls.model_fields} - {"kind", "direction"}
        found = _wrong_keys(f'kind = "{kind}"', needed, needed + also, given)
        if found is None and _nowhere(data.get("direction")):
            found = "direction = [0, 0]: it has no direction"
        return found


class WallSection(Section):
    """A wall beside the sides of the box: at rest, moving, with a moving surface, or hot. Up to 31 with the sides."""

    shape: Literal["line", "segment", "container", "post"] = Field(
        description='"line" (endless; point, normal), "segment" (both sides and the ends; start, end), "container" (a '
        'circle around the disks; center, radius) or "post" (a round obstacle; center, radius)',
        examples=["line"],
    )
    material: str | None = Field(
        default=None,
        min_length=1,
        max_length=100,
        description="name of the material [text]: that of a species, or another one with a [[pair]] for each material "
        "of the disks. Needed but for a thermal wall, which has none",
        examples=["steel"],
    )
    point: Pair | None = Field(
        default=None, description="a point [x, y] of a line [m]", examples=[[0.0, 0.0]]
    )
    normal: Pair | None = Field(
        default=None,
        description="direction [x, y] from a line to the disks [1], of any length",
        examples=[[0.0, 1.0]],
    )
    start: Pair | None = Field(
        default=None, description="one end [x, y] of a segment [m]", examples=[[0.1, 0.1]]
    )
    end: Pair | None = Field(
        default=None, description="the other end [x, y] of a segment [m]", examples=[[0.2, 0.1]]
    )
    center: Pair | None = Field(
        default=None, description="centre [x, y] of a container or post [m]", examples=[[0.5, 0.5]]
    )
    radius: float | None = Field(
        default=None,
        ge=0.0,
        description="radius of a container or post [m]; a post may have 0",
        examples=[0.4],
    )
    motion: MotionSection | None = Field(
        default=None,
        description='how it moves as a whole [table; m, 1/s, rad]: "steady" (speed), "sine" or "sawtooth" (amplitude, '
        "frequency, phase; rise), along a direction. At rest without it",
        examples=[{"kind": "sine", "amplitude": 5.0e-3, "frequency": 20.0}],
    )
    surface_speed: float = Field(
        default=0.0,
        description="speed of its surface along itself [m/s], as of a belt or drum; positive is clockwise for a "
        "container, counter-clockwise for a post, and to the left seen along a line's normal",
        examples=[0.5],
    )
    temperature: float | None = Field(
        default=None,
        gt=0.0,
        description="a thermal wall: disks leave it with random velocities, as if from a gas of this temperature, "
        "mean of m v^2 / 2 [J]",
        examples=[5.0e-4],
    )

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """Which keys this shape lacks, or cannot have."""
        shape = data.get("shape")
        if not isinstance(shape, str) or shape not in SHAPES:
            return None  # said of the shape itself
        of_any = {"shape", "material", "motion", "surface_speed", "temperature"}
        given = {key for key in data if key in cls.model_fields} - of_any
        found = _wrong_keys(f'shape = "{shape}"', SHAPES[shape], SHAPES[shape], given)
        if ("material" in data) == ("temperature" in data):
            text = (
                "either material or temperature is needed: disks leave a thermal wall whatever it is made of"
            )
            found = f"{found}; {text}" if found else text
        if found is None and shape == "container" and data.get("radius") == 0:
            found = "radius = 0: a container needs one above 0"
        if found is None and shape == "line" and _nowhere(data.get("normal")):
            found = "normal = [0, 0]: it has no direction"
        if found is None and shape == "segment" and data.get("start") == data.get("end"):
            found = 'start = end: a segment has two ends; a point is a "post" of radius 0'
        return found

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
