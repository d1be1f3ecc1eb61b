"""Output of a run as it goes: frames, time series, histories, and the energy ledger."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np

from ..errors import InputError, TrajectoryError
from ..model.histograms import split
from ..model.observables import Measure, heat_flux, stress
from ..model.state import FrameRows, State
from ..quantities import (
    AXES,
    CENTER_SERIES,
    HEAT_SERIES,
    HISTOGRAMS,
    OBSERVABLES,
    PISTON_SERIES,
    REGION_SERIES,
    SERIES,
    SPECIES_SERIES,
    STRESS_SERIES,
    WALL_SERIES,
)
from ..simulation.measuring.tracking import Events
from ..tools.checked import Array, Integer, Positive, validated
from ..trajectory.background import AsyncWriter
from ..trajectory.parts_writer import PartsWriter

ROWS_AT_ONCE, BYTES_AT_ONCE, WAIT = 256, 16 << 20, 2.0
"""Rows of the time series and bytes of frames that are written together at most, and seconds after which the next row
or frame has those written that wait: each commit costs a run, however little there is in it."""
BYTES_PER_DISK = 64
"""Of a state that waits, about."""
EVENTS_AT_ONCE = 200_000
"""Events that wait in memory before they are written."""


@validated
@dataclass(slots=True)
class Ledger:
    """Energy ledger of a trajectory: `observables` makes quantities of the whole gas from the measure of each frame.

    Examples
    --------
    >>> import ifrdem
    >>> disks = ifrdem.Disks(1, mass=2.0, radius=0.5)
    >>> state = ifrdem.State([[1.0, 1.0]], [[3.0, 0.0]], [0.0])
    >>> row = ifrdem.Ledger().observables(ifrdem.observables.measure(disks, state))
    >>> float(row["energy"]), sorted(row)[:3]
    (9.0, ['collisions', 'dissipated_energy', 'energy'])
    """

    first: Measure | None = None
    latest: Measure | None = None
    """first, latest: those in the trajectory."""
    frames: Annotated[int, Integer(0)] = 0
    """Their number."""
    area: Positive | None = None
    """Area that stresses refer to [length^2]; needed where measures have a virial (record=["stress"])."""
    latest_row: Measure | None = None
    """That of the latest row of the time series, from which stresses are means."""

    @validated
    def dissipated(self, measure: Measure) -> float:
        """Energy that collisions have taken since the first frame [energy]."""
        assert self.first is not None
        return self.first.unspent - measure.unspent

    @validated
    def residual(self, measure: Measure) -> float | None:
        """Energy that is missing beyond what the mechanisms took [energy]; None without a ledger."""
        if measure.dissipated is None:
            return None
        return self.dissipated(measure) - float(measure.dissipated.sum())

    @validated
    def turned(self, measure: Measure) -> float:
        """All energy at the start and put in [energy]."""
        assert self.first is not None
        first, now = self.first, measure
        return sum(map(abs, (first.energy, now.energy_input, now.wall_work, now.wall_heat)))

    @validated
    def relative_residual(self, measure: Measure) -> float | None:
        """The residual over all energy at the start and put in."""
        residual = self.residual(measure)
        turned = self.turned(measure)
        return None if residual is None or turned == 0.0 else residual / turned

    @validated
    def observables(self, measure: Measure) -> dict[str, Any]:
        """Quantities of the whole gas in a frame (`quantities.OBSERVABLES`), and histograms if the measure has them."""
        found = self._of_frames_and_rows(measure)
        if measure.histograms is not None:
            found |= dict(zip(HISTOGRAMS, split(measure.histograms).values(), strict=False))
        return found

    def _of_frames_and_rows(self, measure: Measure) -> dict[str, Any]:
        if self.first is None:
            self.first = measure
        # What is missing of what was there and what forces and walls put in was dissipated.
        own = {"dissipated_energy": self.dissipated(measure)}
        found = {name: own[name] if name in own else getattr(measure, name) for name in OBSERVABLES}
        if measure.pistons is not None:
            found |= dict(zip(PISTON_SERIES, measure.pistons.T, strict=True))
        return found

    @validated
    def row(self, measure: Measure) -> dict[str, Any]:
        """Quantities of a row of the time series (with `quantities.LEDGER`).

        Stresses and heat fluxes are means since the row before, nan in the first one (`observables.stress`,
        `observables.heat_flux`); InputError if the measure has a virial and the ledger no area.
        """
        row = self._of_frames_and_rows(measure)
        if measure.dissipated is not None and measure.regimes is not None:
            row |= {
                "dissipated_by_mechanism": measure.dissipated,
                "collisions_by_regime": measure.regimes,
                "ledger_residual": self.residual(measure),
            }
        if measure.virial is not None:
            if self.area is None:
                raise InputError("area = None: must be given for a stress: ifrdem.Ledger(area=box.area)")
            row |= self._fluxes(measure, self.area)
        if measure.species_temperature is not None:
            row |= {name: getattr(measure, name) for name in SPECIES_SERIES}
        if measure.center_of_mass is not None:
            row |= dict.fromkeys(CENTER_SERIES, measure.center_of_mass)
        if measure.regions is not None:
            row |= dict(zip(REGION_SERIES, measure.regions.T, strict=True))
        if measure.walls is not None:
            row |= dict(zip(WALL_SERIES, measure.walls.T, strict=True))
        return row

    def _fluxes(self, measure: Measure, area: float) -> dict[str, Array]:
        """Stress, by `COMPONENTS`, and heat flux since the row before, and their kinetic parts."""
        before, self.latest_row = self.latest_row, measure
        recorded = {STRESS_SERIES: stress} | (
            {HEAT_SERIES: heat_flux} if measure.energy_transfer is not None else {}
        )
        row: dict[str, Array] = {}
        for names, function in recorded.items():
            if before is None or not measure.time > before.time:
                row |= {name: np.full(SERIES[name].components, np.nan) for name in names}
            else:
                found = function(before, measure, area)
                row |= dict(zip(names, (found.total.ravel(), found.kinetic.ravel()), strict=True))
        return row

    def to_record(self) -> dict[str, Any]:
        """The ledger in the form of JSON, for a checkpoint."""
        measures = {name: _plain(getattr(self, name)) for name in ("first", "latest", "latest_row")}
        return {**measures, "frames": self.frames, "area": self.area}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Ledger:
        """The ledger that `to_record` gave."""
        first, latest, row = (_measure(record[name]) for name in ("first", "latest", "latest_row"))
        return cls(first, latest, int(record["frames"]), record["area"], row)


def _plain(measure: Measure | None) -> dict[str, Any] | None:
    if measure is None:
        return None
    values = {each.name: getattr(measure, each.name) for each in fields(measure)}
    return {name: each.tolist() if isinstance(each, np.ndarray) else each for name, each in values.items()}


def _measure(record: Mapping[str, Any] | None) -> Measure | None:
    if record is None:
        return None
    values: Any = {name: np.array(each) if isinstance(each, list) else each for name, each in record.items()}
    return Measure(**values)


class Recorder:
    """Writer of the output of a running simulation; a context manager, which writes pending output at its end.

    `take_events` gives what happened to tracked disks since the last call (`Simulation.take_events`); `pending` are
    events that were not written yet when the run stopped; `clock` gives seconds of real time; `walls` are the names of
    those that have sums, `pistons` of those that are some, `species` of species, `regions` of regions. `seconds` is the
    processor time that this has taken of the run's thread.
    """

    def __init__(
        self,
        writer: AsyncWriter | PartsWriter,
        ledger: Ledger,
        take_events: Callable[[], Events] | None = None,
        pending: Events | None = None,
        clock: Callable[[], float] = time.monotonic,
        walls: Sequence[str] = (),
        pistons: Sequence[str] = (),
        species: Sequence[str] = (),
        regions: Sequence[str] = (),
    ) -> None:
        self._writer, self._take = writer, take_events
        self.ledger: Ledger = ledger
        self._names = AXES | {
            "wall": tuple(walls), "piston": tuple(pistons), "species": tuple(species), "region": tuple(regions),
        }  # fmt: skip
        del self._names["axis"]  # vectors are stored without names of their columns
        self._clock, self._wrote = clock, -math.inf
        self.seconds: float = 0.0
        self._rows: list[tuple[float, dict[str, Any]]] = []
        self._frames: list[tuple[Any, dict[str, Any]]] = []
        self._parts: list[tuple[Mapping[str, Any], float]] = []
        self._pending = [] if pending is None or not len(pending) else [pending]

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Write what waits; if the run has failed, its error is raised, not one of this writing."""
        with contextlib.nullcontext() if kind is None else contextlib.suppress(InputError, TrajectoryError):
            self.write()

    def frame(self, state: State | FrameRows, measure: Measure) -> None:
        """Write a frame, and the events until then, now or together with some others."""
        started = time.thread_time()
        self._close_part(measure.time)
        self._frames.append((state, self.ledger.observables(measure)))
        self.ledger.latest = measure
        self.ledger.frames += 1
        self._write_due(started)

    def row(self, measure: Measure) -> None:
        """Write a row of the time series, now or together with some others."""
        started = time.thread_time()
        self._rows.append((measure.time, self.ledger.row(measure)))
        self._write_due(started)

    def _write_due(self, started: float) -> None:
        bytes_waiting = sum(BYTES_PER_DISK * state.n for state, _ in self._frames)
        full = len(self._rows) >= ROWS_AT_ONCE or bytes_waiting >= BYTES_AT_ONCE
        if full or self._clock() - self._wrote >= WAIT:
            self.write()
        self.seconds += time.thread_time() - started

    def write(self) -> None:
        """Write pending rows, events and frames."""
        if self._rows:
            first = self._rows[0][1]
            axes = {name: SERIES[name].along for name in first}
            columns = {name: self._names[axis] for name, axis in axes.items() if axis in self._names}
            self._writer.write_series_rows(self._rows, columns)
        if self._parts:
            self._writer.write_history_parts(self._parts)
        if self._frames:
            self._writer.write_frames(self._frames)
        self._rows, self._parts, self._frames, self._wrote = [], [], [], self._clock()

    def between(self, now: float) -> None:
        """Write events if many are pending; the run is at this time [time]."""
        self._gather()
        if sum(len(each) for each in self._pending) >= EVENTS_AT_ONCE:
            self._close_part(now)
            self.write()

    @property
    def pending(self) -> Events | None:
        """Pending events, for a checkpoint; None if no disk is tracked."""
        if self._take is None:
            return None
        self._gather()
        return Events.joined(self._pending)

    def _gather(self) -> None:
        if self._take is not None and len(found := self._take()):
            self._pending.append(found)

    def _close_part(self, now: float) -> None:
        """Close a part of the histories: its events, until now, are written in one commit."""
        if self._take is not None:
            self._gather()
            found = Events.joined(self._pending)
            self._parts.append((found.columns(), now))
            self._pending = []
