"""Output of a run: frames, series, histories, checkpoints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from ..errors import InputError, nearest
from ..mpi.distribution import GATHERED
from ..quantities import FIELDS
from ..simulation.steps.schedule import OUTPUTS, Trigger
from ..tools.checked import FINITE, Count, Each, Natural, Part, Positive, Ratio
from .section import Section, field, refusal

if TYPE_CHECKING:
    FieldName = str
else:
    FieldName = Literal[tuple(FIELDS)]
Outputs = Annotated[int, OUTPUTS]
Region = Annotated[list[float], Each(FINITE, length=4)]
ROWS_PER_FRAME = 10  # of series, up to, where a case does not say
TRACKED = ("histories", "histories_sample", "histories_region", "histories_all")
"""Keys that say which disks are tracked."""


class OutputSection(Section):
    """The output of the run."""

    frames: Outputs = field(100, 100)
    """Frames after the initial one [whole number], evenly spaced in time or in collisions, as the run ends."""
    frames_interval: Positive | None = field(0.01, None)
    """Instead: time between two frames [s]."""
    frames_collisions: Ratio | None = field(0.5, None)
    """Instead: collisions per disk between two frames [1]."""
    frames_phases: Outputs | None = field(8, None)
    """Instead: frames at so many phases of each period of the walls that move to and fro [whole number]."""
    frames_spacing: Literal["even", "log"] = field("log", "even")
    """Spacing of a number of frames: "even", or "log" (each is later than the one before by a constant factor)."""
    fields: list[FieldName] = field(
        ["position", "velocity", "angular_velocity", "collisions", "image"],
        ["position", "velocity", "angular_velocity", "collisions", "image"],
    )
    """Fields of every disk in every frame [list of names; [] for sums over all disks alone]; image: box lengths
    travelled, for paths through periodic sides; angle: rotation since the start; last_partner: latest collision
    partner; dissipated: energy lost in its collisions, by mechanism (half of each); asleep: 1 for disks that sleep,
    with run.collapse = "rest"."""
    series: Outputs | None = field(1000, None)
    """Rows of the time series (energies, temperatures, momentum, collisions by regime, dissipation by mechanism) after
    the initial one [whole number]. Each may cost the computation of its window once more. Without this key, rows are
    at the ends of windows, up to 10 for each frame, and cost little."""
    series_interval: Positive | None = field(0.001, None)
    """Instead: time between two rows [s]."""
    series_collisions: Ratio | None = field(0.05, None)
    """Instead: collisions per disk between two rows [1]."""
    series_phases: Outputs | None = field(8, None)
    """Instead: rows at so many phases of each period of the walls that move to and fro [whole number]."""
    series_spacing: Literal["even", "log"] = field("log", "even")
    """Spacing of a number of rows: "even" or "log"."""
    log_from: Part = field(1e-3, 1e-3)
    """With spacing "log": position of the first one, as a fraction of the run [1]."""
    ledger: bool = field(True, True)
    """Store the dissipated energy by mechanism in the time series [true or false]."""
    wall_sums: bool = field(True, False)
    """Store what each wall gives to the disks (momentum, torque, work, heat, hits) in the time series [true or
    false]."""
    stress: bool = field(True, False)
    """Store the pressure tensor P_ab in the time series: positive in compression, mean since the row before [true or
    false]."""
    heat_flux: bool = field(True, False)
    """Store the heat flux q in the time series too, mean since the row before; includes stress [true or false]."""
    regions: dict[str, Region] = field({"left": [0.0, 0.0, 0.5, 1.0]}, {})
    """Store the number, mass and kinetic energy of the disks in rectangles in the time series [table of name = [x_low,
    y_low, x_high, y_high], m]."""
    histograms: bool = field(True, False)
    """Count collisions of each pair of species by angle of impact, normal speed and regime, and store the counts in
    frames; costs far less than histories [true or false]."""
    free_times: bool = field(True, False)
    """Count them also by the time since the latest collision of either disk; includes histograms [true or false]."""
    histories: list[Natural] | None = field([0, 7], None, min_length=1)
    """Disks of which every collision is stored [list of their numbers, from 0]; their paths are then exact."""
    histories_sample: Count | None = field(100, None)
    """Instead: number of disks to track, chosen at random by run.seed [whole number]."""
    histories_region: Region | None = field([0.0, 0.0, 0.1, 0.1], None)
    """Instead: disks that start in this rectangle [x_low, y_low, x_high, y_high] [m]."""
    histories_all: bool = field(True, False)
    """Instead: all disks [true or false]."""
    compression: Literal["none", "gzip", "zstd"] = field("none", "none")
    """ "none" (fast), "gzip" (about three quarters of the size, slower to write and to read) or "zstd" (faster than
    gzip; requires the package hdf5plugin here and in each reader)."""
    precision: Literal["f32", "f64"] = field("f32", "f32")
    """ "f32" (single precision) or "f64" (double): numbers in the file, for any run.precision."""
    parts: bool | Literal["auto"] = field("auto", "auto")
    """Each rank writes its disks, and checkpoints, into its own file in the folder NAME.parts; readers see NAME.h5 as
    one file [true, false or "auto": on several ranks, with more than 1e6 disks]."""
    checkpoint_minutes: Positive = field(10.0, 10.0)
    """Real time between two checkpoints, from which `ifrdem resume` continues [minutes]; one is also written when a run
    is interrupted."""
    views: bool = field(True, True)
    """Write NAME.vtkhdf and NAME.nc at the end, through which ParaView, OVITO and others read NAME.h5 [true or false];
    they need positions."""
    picture: bool = field(True, True)
    """Draw NAME.png at the end [true or false]."""

    @field_validator("compression")
    @classmethod
    def _available(cls, compression: str) -> str:
        if compression == "zstd":
            from ..trajectory.layout import need_zstd  # imports h5py

            try:
                need_zstd("this compression")
            except InputError as error:
                raise refusal(str(error), "package") from error
        return compression

    @field_validator("parts", mode="before")
    @classmethod
    def _choice(cls, parts: object) -> object:
        if isinstance(parts, bool) or parts == "auto":
            return parts
        text = 'must be true, false or "auto"' + nearest(str(parts), ["auto", "true", "false"])
        raise refusal(text, "unknown_name")

    @classmethod
    def problems(cls, data: Mapping[str, Any]) -> list[str]:
        """Keys that exclude each other."""
        problems = []
        others = ("interval", "collisions", "phases")
        alternatives = [(what, *(f"{what}_{one}" for one in others)) for what in ("frames", "series")]
        for keys in (*alternatives, TRACKED):
            given = [key for key in keys if data.get(key, False) is not False]
            if len(given) > 1:
                problems.append(f"must have at most one of {', '.join(keys)}; given: {', '.join(given)}")
        log = [keys[0] for keys in alternatives if data.get(f"{keys[0]}_spacing") == "log"]
        for what in log:
            if {f"{what}_{one}" for one in others} & set(data):
                problems.append(f'{what}_spacing = "log": requires a number, {what}')
        if "series" in log and "series" not in data:
            problems.append('series_spacing = "log": series, the number of rows, is missing')
        if "log_from" in data and not log:
            problems.append('log_from requires frames_spacing or series_spacing = "log"')
        return problems

    def record(self) -> list[str]:
        """Names of what a simulation records for it (`Setup.record`)."""
        fields = self.fields
        quantities = {
            "ledger": self.ledger, "wall_sums": self.wall_sums, "stress": self.stress,
            "heat_flux": self.heat_flux, "histograms": self.histograms, "free_times": self.free_times, **{name: name in fields for name in ("last_partner", "angle", "dissipated")},
        }  # fmt: skip
        return [name for name, enabled in quantities.items() if enabled]

    def frame_cadence(self, period: float | None = None) -> Trigger:
        """Times or collisions at which frames are due; the period is that of the walls [time]."""
        interval = _of_phases(self.frames_interval, self.frames_phases, period)
        return self._cadence(self.frames, interval, self.frames_collisions, self.frames_spacing, exact=True)

    def series_cadence(self, period: float | None = None) -> Trigger:
        """Times or collisions at which rows of the time series are due."""
        interval = _of_phases(self.series_interval, self.series_phases, period)
        if self.series is not None or interval is not None or self.series_collisions is not None:
            return self._cadence(
                self.series or 1, interval, self.series_collisions, self.series_spacing, exact=True
            )
        between = _of_phases(self.frames_interval, self.frames_phases, period)
        interval, collisions = (
            None if each is None else each / ROWS_PER_FRAME for each in (between, self.frames_collisions)
        )
        number = ROWS_PER_FRAME * self.frames
        return self._cadence(number, interval, collisions, self.frames_spacing, exact=False)

    def _cadence(
        self, number: int, interval: float | None, collisions: float | None, spacing: str, *, exact: bool
    ) -> Trigger:
        if interval is None and collisions is None:
            return Trigger(number=number, spacing=spacing, log_from=self.log_from, exact=exact)
        return Trigger(interval=interval, collisions=collisions, exact=exact)

    def in_parts(self, n: int, ranks: int) -> bool:
        """True if a run of n disks on so many ranks writes a file for each."""
        return bool(self.parts) if self.parts != "auto" else ranks > 1 and n > GATHERED

    @property
    def tracks(self) -> bool:
        """True if histories are kept."""
        return self.histories_all or any(
            each is not None for each in (self.histories, self.histories_sample, self.histories_region)
        )

    def tracked(
        self, n: int, rng: np.random.Generator, position: NDArray[np.float64], first: int = 0
    ) -> NDArray[np.int32]:
        """Disks of n of which histories are kept, ascending.

        Those of a region by where they start, shape (rows, 2) [length], of disks `first` and following.
        """
        if self.histories_all:
            return np.arange(n, dtype=np.int32)
        if self.histories is not None:
            return np.unique(np.array(self.histories, dtype=np.int32))
        if self.histories_sample is not None:
            return np.sort(rng.choice(n, size=self.histories_sample, replace=False)).astype(np.int32)
        if self.histories_region is not None:
            low, high = np.array(self.histories_region[:2]), np.array(self.histories_region[2:])
            inside = np.all((position >= low) & (position < high), axis=1)
            return (first + np.flatnonzero(inside)).astype(np.int32)
        return np.empty(0, dtype=np.int32)


def _of_phases(interval: float | None, phases: int | None, period: float | None) -> float | None:
    """The interval, or that of so many phases of a period [time]; rules refuse phases without a period."""
    return interval if phases is None or period is None else period / phases
