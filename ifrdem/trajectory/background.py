"""A trajectory writer that works beside the run: what is given to it is written by a thread of its own."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

from numpy.typing import ArrayLike

from ..model.state import State
from .file import TrajectoryError
from .writer import TrajectoryWriter
from .writer_process import RemoteWriter

# How many calls of each kind may wait: they bound the memory.
WAITING = {"frame": 2, "series": 1024, "histories": 2}


class QueuedWriter:
    """Hands frames, rows of series and histories to a `TrajectoryWriter` in a thread, in order.

    What is given must not change afterwards: it is written later, without a copy. Two frames and two pieces
    of histories can wait; one more waits until there is room. What goes wrong is raised by the next call, or
    by `close`; what was waiting is dropped then, and the file keeps what is committed.

    Use it as a context manager: leaving it writes all that waits, and closes the file.

    Taichi holds Python's lock while a kernel runs, so that beside kernels the thread gets on between them: where frames
    are large, a `RemoteWriter` does the work elsewhere. Where that is possible both take only what the run leaves of
    the processors; where the run waits for them, that is all of them.

    Parameters
    ----------
    writer : TrajectoryWriter or RemoteWriter
        What writes. It belongs to the thread until `close`; only what `QueuedWriter` has may be called.
    """

    def __init__(self, writer: TrajectoryWriter | RemoteWriter) -> None:
        self._writer = writer
        self._jobs: deque[tuple[str, Callable[[], None]]] = deque()
        self._waiting: Counter[str] = Counter()
        self._busy = False
        self._closing = False
        self._error: BaseException | None = None
        self._said = False
        self._change = threading.Condition()
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
    def compressor(self) -> str | None:
        """Who compresses, for people; None if nothing is compressed."""
        return self._writer.compressor

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
        self._put("frame", lambda: self._writer.write(state, observables))

    def write_series(
        self,
        time: float,
        values: Mapping[str, ArrayLike],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """As `TrajectoryWriter.write_series`, later."""
        self._put("series", lambda: self._writer.write_series(time, values, columns))

    def write_series_rows(
        self,
        rows: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """As `TrajectoryWriter.write_series_rows`, later."""
        self._put("series", lambda: self._writer.write_series_rows(rows, columns))

    def begin_histories(self, ids: ArrayLike, state: State) -> None:
        """As `TrajectoryWriter.begin_histories`, later."""
        self._put("histories", lambda: self._writer.begin_histories(ids, state))

    def write_histories(self, events: Mapping[str, ArrayLike], time: float) -> None:
        """As `TrajectoryWriter.write_histories`, later."""
        self._put("histories", lambda: self._writer.write_histories(events, time))

    def flush(self) -> None:
        """Wait until all that was given is committed.

        Raises
        ------
        InputError, TrajectoryError
            What went wrong meanwhile, if it was not raised before.
        """
        with self._change:
            self._change.wait_for(lambda: self._error is not None or not (self._jobs or self._busy))
            self._say()

    def close(self) -> None:
        """Write all that waits, and close the file. May be called twice.

        Raises
        ------
        InputError, TrajectoryError
            What went wrong meanwhile, if it was not raised before, or closing itself.
        """
        with self._change:
            self._closing = True
            self._change.notify_all()
        self._thread.join()
        self._writer.close()
        if not self._said:
            self._say()

    def _put(self, kind: str, job: Callable[[], None]) -> None:
        with self._change:
            if self._closing:
                raise TrajectoryError(f"{self._writer.path} is closed: nothing can be added")
            self._change.wait_for(lambda: self._error is not None or self._waiting[kind] < WAITING[kind])
            self._say()
            self._jobs.append((kind, job))
            self._waiting[kind] += 1
            self._change.notify_all()

    def _say(self) -> None:
        if self._error is not None:
            self._said = True
            raise self._error

    def _work(self) -> None:
        _step_back()
        while True:
            with self._change:
                self._change.wait_for(lambda: self._jobs or self._closing)
                if not self._jobs:
                    return
                kind, job = self._jobs.popleft()
                self._waiting[kind] -= 1
                self._busy = True
                self._change.notify_all()
            try:
                job()
            except BaseException as error:
                # Whatever it is, the run's thread has to hear of it: this one has nobody to raise it to.
                with self._change:
                    self._error = error
                    self._jobs.clear()
                    self._busy = False
                    self._change.notify_all()
                return
            del job  # a frame that is written need not stay in memory while the next is awaited
            with self._change:
                self._busy = False
                self._change.notify_all()


def _step_back() -> None:
    """Give the present thread the lowest priority, where threads have one of their own.

    A loop on all cores is as slow as its slowest thread, and kernels leave cores idle often enough.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # a container may forbid it, and nothing depends on it
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
