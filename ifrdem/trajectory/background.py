"""A trajectory writer in a thread of its own, so that a run goes on while its frames are written."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

from numpy.typing import ArrayLike

from ..model.state import State
from .file import TrajectoryError
from .writer import TrajectoryWriter

WAITING = 2
"""Calls that may wait, and so frames: they bound the memory."""


class QueuedWriter:
    """Hands frames, rows of series and histories to a `TrajectoryWriter` in a thread, in order.

    What is given must not change afterwards: it is written later, without a copy. Two calls can wait; one more waits
    until there is room. What goes wrong is raised by the next call, or by `close`; what was waiting is dropped then,
    and the file keeps what is committed.

    Use it as a context manager: leaving it writes all that waits, and closes the file.

    Parameters
    ----------
    writer : TrajectoryWriter
        It belongs to the thread until `close`; only what `QueuedWriter` has may be called.

    Attributes
    ----------
    seconds : float
        Processor time that the thread has taken.
    """

    def __init__(self, writer: TrajectoryWriter) -> None:
        self._writer = writer
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue(WAITING)
        self._closed = False
        self.seconds = 0.0
        self._error: BaseException | None = None
        self._said = False
        # A daemon: a run that dies without closing is not held up by it, and the file stays whole.
        self._thread = threading.Thread(target=self._work, name="trajectory", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        """Number of committed frames."""
        return len(self._writer)

    @property
    def path(self) -> Path:
        """The file."""
        return self._writer.path

    @property
    def gone(self) -> str | None:
        """Reason why the file is not at its place any more; None if it is."""
        return self._writer.gone

    @property
    def series_rows(self) -> int:
        """Number of committed rows of the series."""
        return self._writer.series_rows

    @property
    def events(self) -> int:
        """Number of committed events of the histories."""
        return self._writer.events

    @property
    def seen(self) -> dict[str, int]:
        """What a checkpoint keeps for `TrajectoryWriter.resume`: what has been written. `flush` first."""
        return self._writer.seen

    def __enter__(self) -> QueuedWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(TrajectoryError):  # what is on its way already is what is told
            self.close()

    def write(self, state: State, observables: Mapping[str, ArrayLike] | None = None) -> None:
        """As `TrajectoryWriter.write`, later."""
        self._put(lambda: self._writer.write(state, observables))

    def write_frames(self, frames: Sequence[tuple[State, Mapping[str, ArrayLike] | None]]) -> None:
        """As `TrajectoryWriter.write_frames`, later."""
        self._put(lambda: self._writer.write_frames(frames))

    def write_series(
        self, time: float, values: Mapping[str, ArrayLike], columns: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        """As `TrajectoryWriter.write_series`, later."""
        self._put(lambda: self._writer.write_series(time, values, columns))

    def write_series_rows(
        self,
        rows: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """As `TrajectoryWriter.write_series_rows`, later."""
        self._put(lambda: self._writer.write_series_rows(rows, columns))

    def begin_histories(self, ids: ArrayLike, state: State) -> None:
        """As `TrajectoryWriter.begin_histories`, later."""
        self._put(lambda: self._writer.begin_histories(ids, state))

    def write_histories(self, events: Mapping[str, ArrayLike], time: float) -> None:
        """As `TrajectoryWriter.write_histories`, later."""
        self._put(lambda: self._writer.write_histories(events, time))

    def write_history_parts(self, parts: Sequence[tuple[Mapping[str, ArrayLike], float]]) -> None:
        """As `TrajectoryWriter.write_history_parts`, later."""
        self._put(lambda: self._writer.write_history_parts(parts))

    def flush(self) -> None:
        """Wait until all that was given is committed.

        Raises
        ------
        InputError, TrajectoryError
            What went wrong meanwhile.
        """
        self._jobs.join()
        self._say()

    def close(self) -> None:
        """Write all that waits, and close the file. May be called twice.

        Raises
        ------
        InputError, TrajectoryError
            What went wrong meanwhile, if it was not raised before, or closing itself.
        """
        if not self._closed:
            self._closed = True
            self._jobs.put(None)
        self._thread.join()
        self._writer.close()
        if not self._said:
            self._say()

    def _put(self, job: Callable[[], None]) -> None:
        if self._closed:
            raise TrajectoryError(f"{self._writer.path} is closed: nothing can be added")
        self._say()
        self._jobs.put(job)

    def _say(self) -> None:
        if self._error is not None:
            self._said = True
            raise self._error

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                if self._error is None:  # after an error the rest is dropped
                    job()
                    self.seconds = time.thread_time()
            except BaseException as error:
                # Whatever it is, the run's thread has to hear of it: this one has nobody to raise it to.
                self._error = error
            del job  # a frame that is written need not stay in memory while the next is awaited
            self._jobs.task_done()
        self._jobs.task_done()
