"""Output of a run: times of frames and of rows of series, and the callbacks that get them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, TypedDict, Unpack

from ...errors import InputError, shortened
from ...mpi import Communicator
from ...tools import checked
from .schedule import AT_END, OUTPUTS, FrameCallback, Progress, SeriesCallback, Trigger

_FUNCTIONS = checked.Each(checked.Instance((Callable,)), "list")  # type: ignore[arg-type]


class OutputOptions(TypedDict, total=False):
    """Output of a run, as users give it: see `Simulation.run`."""

    frames: int | Trigger
    frame_callbacks: Iterable[FrameCallback]
    series: int | Trigger | None
    series_callbacks: Iterable[SeriesCallback]
    progress: Progress | bool | None


@dataclass(frozen=True)
class Output:
    """Output of a run, checked.

    Attributes
    ----------
    frames : Trigger
        When frame callbacks are called, in addition to the beginning.
    frame_callbacks, series_callbacks : tuple of callables
        Called with a state and its measure, or with a measure.
    series : Trigger or None
        When series callbacks are called, in addition to the beginning and the end.
    progress : callable, bool or None
        Called with the time and the number of collisions after every window; or whether a bar is shown, by default
        (None) where someone looks on.
    """

    frames: Trigger = AT_END
    frame_callbacks: tuple[FrameCallback, ...] = ()
    series: Trigger | None = None
    series_callbacks: tuple[SeriesCallback, ...] = ()
    progress: Progress | bool | None = None

    @classmethod
    def of(cls, **given: Unpack[OutputOptions]) -> Output:
        """The output that a user asks for.

        Raises
        ------
        InputError
            If a number of frames or rows is none, something that is to be called cannot be, or `progress` is neither.
        """
        progress, series = given.get("progress"), given.get("series")
        if not (progress is None or isinstance(progress, bool) or callable(progress)):
            raise InputError(f"progress = {shortened(progress)}: must be True, False or a function")
        return cls(
            _trigger("frames", given.get("frames", AT_END)),
            _FUNCTIONS("frame_callbacks", given.get("frame_callbacks", ())),
            None if series is None else _trigger("series", series),
            _FUNCTIONS("series_callbacks", given.get("series_callbacks", ())),
            progress,
        )

    def on(self, comm: Communicator) -> Output:
        """The output on a rank of several: those that call no callback take part where another one calls some."""
        of_frames, of_series = comm.bcast((len(self.frame_callbacks), len(self.series_callbacks)))
        if comm.is_root:
            return self
        frames = self.frame_callbacks if comm.is_distributed else (_nothing,) * of_frames
        return replace(self, frame_callbacks=frames, series_callbacks=(_nothing,) * of_series)


def _nothing(*_: Any) -> None:
    """Callback without effect, for ranks other than the root."""


def _trigger(name: str, given: int | Trigger) -> Trigger:
    if isinstance(given, Trigger):
        return given
    return Trigger(number=OUTPUTS(name, given))
