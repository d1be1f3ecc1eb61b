"""What a case keeps of its run: frames, series, histories, checkpoints."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

from ..errors import InputError
from ..simulation.schedule import MOST as MOST_FRAMES
from ..simulation.schedule import Cadence
from .section import Section

FieldName = Literal[
    "position", "velocity", "angle", "angular_velocity", "collisions", "image", "last_partner"
]
Interval = Annotated[float, Field(gt=0.0)]
ROWS_PER_FRAME = 10  # of series, up to, where a case does not say
_TRACKED = ("histories", "histories_sample", "histories_region", "histories_all")


class OutputSection(Section):
    """What is kept."""

    frames: int = Field(
        default=100,
        ge=1,
        le=MOST_FRAMES,
        description="frames after the initial one [whole number], evenly spaced in what ends the run",
        examples=[100],
    )
    frames_interval: Interval | None = Field(
        default=None, description="instead: time between two frames [s]", examples=[0.01]
    )
    frames_collisions: Interval | None = Field(
        default=None, description="instead: collisions per disk between two frames [1]", examples=[0.5]
    )
    frames_spacing: Literal["even", "log"] = Field(
        default="even",
        description='of a number of frames: "even", or "log" (each later than the one before by a constant factor)',
        examples=["log"],
    )
    fields: list[FieldName] = Field(
        default=["position", "velocity", "angular_velocity", "collisions"],
        description="what every frame holds of every disk [list of names]; image: box lengths travelled; angle: how "
        "far it has turned since the start; last_partner: whom it hit last",
        examples=[["position", "velocity", "angular_velocity", "collisions"]],
    )
    series: int | None = Field(
        default=None,
        ge=1,
        le=MOST_FRAMES,
        description="rows of the time series (energies, temperatures, momentum, collisions by regime, what dissipates "
        "energy) after the initial one [whole number]. Each ends an epoch of the engine, which costs time. Without "
        "this key, rows stand where epochs end by themselves, up to 10 for each frame, and cost little",
        examples=[1000],
    )
    series_interval: Interval | None = Field(
        default=None, description="instead: time between two rows [s]", examples=[0.001]
    )
    series_collisions: Interval | None = Field(
        default=None, description="instead: collisions per disk between two rows [1]", examples=[0.05]
    )
    series_spacing: Literal["even", "log"] = Field(
        default="even", description='of a number of rows: "even" or "log"', examples=["log"]
    )
    log_from: float = Field(
        default=1e-3,
        gt=0.0,
        lt=1.0,
        description='with spacing "log": where the first one stands, as a part of the run [1]',
        examples=[1e-3],
    )
    ledger: bool = Field(
        default=True,
        description="add up what dissipates energy, by mechanism, in the time series [true or false]",
        examples=[True],
    )
    histories: list[Annotated[int, Field(ge=0)]] | None = Field(
        default=None,
        min_length=1,
        description="disks of which every collision is kept [list of their numbers, from 0]; so their paths are exact",
        examples=[[0, 7]],
    )
    histories_sample: int | None = Field(
        default=None,
        ge=1,
        description="instead: so many disks, drawn by run.seed [whole number]",
        examples=[100],
    )
    histories_region: list[float] | None = Field(
        default=None,
        min_length=4,
        max_length=4,
        description="instead: disks that start in this rectangle [x_low, y_low, x_high, y_high] [m]",
        examples=[[0.0, 0.0, 0.1, 0.1]],
    )
    histories_all: bool = Field(
        default=False, description="instead: all disks [true or false]", examples=[True]
    )
    compression: Literal["none", "gzip", "zstd"] = Field(
        default="none",
        description='"none" (fast), "gzip" (about three quarters of the size, slower to write and to read) or "zstd" '
        "(faster than gzip; the package hdf5plugin is needed here and by whatever reads the file)",
        examples=["none"],
    )
    precision: Literal["f4", "f8"] = Field(
        default="f4",
        description='"f4" or "f8": bytes of each number in the file, whatever run.precision is',
        examples=["f4"],
    )
    checkpoint_minutes: float = Field(
        default=10.0,
        gt=0.0,
        description="real time between two checkpoints, from which `ifrdem resume` goes on [minutes]; one is also "
        "written when a run is interrupted",
        examples=[10.0],
    )
    views: bool = Field(
        default=True,
        description="write NAME.vtkhdf and NAME.nc at the end, by which ParaView, OVITO and others read NAME.h5 [true "
        "or false]; they need positions",
        examples=[True],
    )
    picture: bool = Field(
        default=True, description="draw NAME.png at the end [true or false]", examples=[True]
    )

    @field_validator("compression")
    @classmethod
    def _available(cls, compression: str) -> str:
        if compression == "zstd":
            from ..trajectory.layout import need_zstd  # imports h5py

            try:
                need_zstd("this compression")
            except InputError as error:
                raise PydanticCustomError("package", "{text}", {"text": str(error)}) from error
        return compression

    @classmethod
    def wrong_choice(cls, data: dict[str, Any]) -> str | None:
        """Which keys exclude each other."""
        wrong = []
        for what in ("frames", "series"):
            ways = (what, f"{what}_interval", f"{what}_collisions")
            given = [key for key in ways if key in data]
            if len(given) > 1:
                wrong.append(f"at most one is needed of: {', '.join(ways)}; given: {', '.join(given)}")
            if data.get(f"{what}_spacing", "even") == "log" and set(given) - {what}:
                wrong.append(f'{what}_spacing = "log": only with a number, {what}')
        if data.get("series_spacing", "even") == "log" and "series" not in data:
            wrong.append('series_spacing = "log": series, the number of rows, is missing')
        logs = [data.get(f"{what}_spacing") == "log" for what in ("frames", "series")]
        if "log_from" in data and not any(logs):
            wrong.append('log_from: only with frames_spacing or series_spacing = "log"')
        given = [key for key in _TRACKED if key in data and data[key] is not False]
        if len(given) > 1:
            wrong.append(f"at most one is needed of: {', '.join(_TRACKED)}; given: {', '.join(given)}")
        return "; ".join(wrong) or None

    @property
    def frame_cadence(self) -> Cadence:
        """When frames are due."""
        return self._cadence(
            self.frames, self.frames_interval, self.frames_collisions, self.frames_spacing, exact=True
        )

    @property
    def series_cadence(self) -> Cadence:
        """When rows of the time series are due."""
        ways = (self.series, self.series_interval, self.series_collisions)
        if any(each is not None for each in ways):
            number = self.series or 1
            return self._cadence(number, ways[1], ways[2], self.series_spacing, exact=True)
        if self.frames_interval is not None or self.frames_collisions is not None:
            interval, collisions = (
                None if each is None else each / ROWS_PER_FRAME
                for each in (self.frames_interval, self.frames_collisions)
            )
            return self._cadence(1, interval, collisions, "even", exact=False)
        return self._cadence(ROWS_PER_FRAME * self.frames, None, None, self.frames_spacing, exact=False)

    def _cadence(
        self, number: int, interval: float | None, collisions: float | None, spacing: str, *, exact: bool
    ) -> Cadence:
        if interval is not None:
            return Cadence(interval=interval, exact=exact)
        if collisions is not None:
            return Cadence(collisions=collisions, exact=exact)
        return Cadence(number=number, spacing=spacing, log_from=self.log_from, exact=exact)

    @property
    def tracks(self) -> bool:
        """Whether histories are kept."""
        return self.histories_all or any(
            each is not None for each in (self.histories, self.histories_sample, self.histories_region)
        )

    def tracked(self, position: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.int32]:
        """Disks of which histories are kept, by where they start, shape (n, 2) [length]; ascending."""
        n = len(position)
        if self.histories_all:
            return np.arange(n, dtype=np.int32)
        if self.histories is not None:
            return np.unique(np.array(self.histories, dtype=np.int32))
        if self.histories_sample is not None:
            return np.sort(rng.choice(n, size=self.histories_sample, replace=False)).astype(np.int32)
        if self.histories_region is not None:
            low, high = np.array(self.histories_region[:2]), np.array(self.histories_region[2:])
            return np.flatnonzero(np.all((position >= low) & (position < high), axis=1)).astype(np.int32)
        return np.empty(0, dtype=np.int32)
