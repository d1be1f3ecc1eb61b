"""The way of a run from its beginning to its end: when frames and rows of series are due, and how far it has come."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .cadence import Cadence, Schedule, Span
from .observables import Measure
from .state import State

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

    @property
    def frame_schedule(self) -> Schedule:
        """When frames are due."""
        return Schedule(self.frames, self.span)

    @property
    def row_schedule(self) -> Schedule:
        """When rows of series are due; only at the end if there are none."""
        return Schedule(self.series or Cadence(number=1), self.span)
