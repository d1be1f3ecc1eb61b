"""A trajectory writer in a separate thread: a run continues while its frames are written."""

from __future__ import annotations

import contextlib
import functools
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

from ..errors import TrajectoryError
from .writer import TrajectoryWriter

WAITING = 2
"""Calls that may wait, and so frames: they bound the memory."""


class AsyncWriter:
    """Calls the methods of a `TrajectoryWriter` in a separate thread, in order.

    Arguments must not change afterwards: they are written later, without a copy. Two calls can wait; one more waits
    until there is room. An error (InputError, TrajectoryError) is raised by the next call, by `flush` or by
    `close`; what was waiting is dropped then, and the file keeps what is committed. The writer belongs to the thread
    until `close`; `seconds` is the processor time that the thread has taken.

    Use it as a context manager: leaving it finishes all calls, and closes the file.
    """

    def __init__(self, writer: TrajectoryWriter) -> None:
        self._writer = writer
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue(WAITING)
        self._closed = False
        self.seconds: float = 0.0
        self._error: BaseException | None = None
        self._error_raised = False
        # A daemon: a run that dies without closing is not held up by it, and the file stays whole.
        self._thread = threading.Thread(target=self._work, name="trajectory", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        """Number of committed frames."""
        return len(self._writer)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._writer, name)
        if not callable(found):
            return found
        return lambda *given, **options: self._enqueue(functools.partial(found, *given, **options))

    def __enter__(self) -> AsyncWriter:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        # The exception in progress is the one to report.
        with contextlib.suppress(*(() if error is None else (TrajectoryError,))):
            self.close()

    def commit(self) -> None:
        """Do nothing: frames count once written, unlike those in parts."""

    def flush(self) -> None:
        """Wait until all calls are committed."""
        self._jobs.join()
        self.raise_error()

    def close(self) -> None:
        """Finish all calls and close the file. May be called twice."""
        if not self._closed:
            self._closed = True
            self._jobs.put(None)
        self._thread.join()
        self._writer.close()
        if not self._error_raised:
            self.raise_error()

    def _enqueue(self, job: Callable[[], None]) -> None:
        if self._closed:
            raise TrajectoryError(f"{self._writer.path} is closed: nothing can be added")
        self.raise_error()
        self._jobs.put(job)

    def raise_error(self) -> None:
        """Raise the first error so far."""
        if self._error is not None:
            self._error_raised = True
            raise self._error

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                if self._error is None:  # after an error the rest is dropped
                    job()
                    self.seconds = time.thread_time()
            except BaseException as error:
                # Any error is passed to the run's thread, which raises it.
                self._error = error
            del job  # a frame that is written need not stay in memory while the next is awaited
            self._jobs.task_done()
        self._jobs.task_done()
