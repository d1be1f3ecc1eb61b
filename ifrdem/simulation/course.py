"""The way of a run from its beginning to its end: when frames and rows of series are due, and how far it has come."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ..model.observables import Measure
from ..model.state import State
from .schedule import Cadence, Due, Schedule, Span

Observer = Callable[[State, Measure], None]
Sampler = Callable[[Measure], None]
Progress = Callable[[float, int], None]


@dataclass
class Course:
    """How a run goes, and what of it is done.

    Attributes
    ----------
    span : Span
        Its beginning and end.
    frames : Cadence
        When observers are called, beside the beginning: exactly then.
    series : Cadence or None
        When samplers are called, beside the beginning and the end.
    next_frame, next_row : int
        What is due next, counted from 1; 0 is the beginning.
    """

    span: Span
    frames: Cadence
    series: Cadence | None = None
    next_frame: int = 0
    next_row: int = 0

    def to_record(self) -> dict[str, Any]:
        """As JSON knows it, for a checkpoint; cadences are those of the case."""
        return {"span": asdict(self.span), "next_frame": self.next_frame, "next_row": self.next_row}

    @classmethod
    def from_record(cls, record: Mapping[str, Any], frames: Cadence, series: Cadence | None) -> Course:
        """What `to_record` gave."""
        span = dict(record["span"])
        end = Due(**span.pop("end"))
        return cls(Span(**span, end=end), frames, series, record["next_frame"], record["next_row"])

    @property
    def frame_schedule(self) -> Schedule:
        """When frames are due."""
        return Schedule(self.frames, self.span)

    @property
    def row_schedule(self) -> Schedule:
        """When rows of series are due; only at the end if there are none."""
        return Schedule(self.series or Cadence(number=1), self.span)
