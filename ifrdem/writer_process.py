"""A trajectory writer in a process of its own.

A thread beside a run needs Python's lock, which Taichi holds while a kernel runs: what the thread then takes of the
time is the run's. A process takes what the run leaves of the processors. It is a new one, not a fork, which would share
the run's memory until one of the two writes there.

Calls go to it by name with their arguments, pickled; arrays by way of memory that both have, of which it writes to the
file without another copy than the file's own.
"""

from __future__ import annotations

import contextlib
import copy
import ctypes
import mmap
import os
import pickle
import signal
import subprocess
import sys
import threading
import traceback
import weakref
from collections.abc import Mapping, Sequence
from multiprocessing import connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import children, h5md
from .box import Box
from .errors import InputError
from .output_file import TrajectoryError
from .state import Disks, State
from .trajectory_writer import DEFAULT_FIELDS, TrajectoryWriter

LEAST_DISKS = 100_000
"""Disks from which on a run's writer gets a process of its own: for fewer, starting one costs more than it saves."""
SHARED = 2**16
"""Bytes from which on an array goes by way of the memory that both have."""
PATIENCE = 20.0  # seconds in which the process ends once its line is broken
PAGE = 4096
_SERVE = (
    "import sys; a = sys.argv; sys.path[:] = a[5:]; "
    "from ifrdem.writer_process import serve; serve(int(a[1]), int(a[2]), int(a[3]), a[4] == 'main')"
)
_DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG


def possible() -> bool:
    """Whether this system has what it takes."""
    return sys.platform == "linux" and hasattr(os, "memfd_create") and bool(sys.executable)


def begin(
    path: str | os.PathLike[str], disks: Disks, box: Box, **options: Any
) -> TrajectoryWriter | RemoteWriter:
    """A `TrajectoryWriter` of these arguments; where there are many disks, in a process of its own.

    Raises
    ------
    InputError
        As `TrajectoryWriter`, or if there can be no further process.
    """
    if disks.n < LEAST_DISKS or not possible():
        return TrajectoryWriter(path, disks, box, **options)
    return RemoteWriter("begin", path, disks, box, **options)


def go_on(
    path: str | os.PathLike[str], disks: Disks, box: Box, **options: Any
) -> TrajectoryWriter | RemoteWriter:
    """`TrajectoryWriter.resume` with these arguments, likewise."""
    if disks.n < LEAST_DISKS or not possible():
        return TrajectoryWriter.resume(path, disks, box, **options)
    return RemoteWriter("go_on", path, disks, box, **options)


class RemoteWriter:
    """What `QueuedWriter` needs of a `TrajectoryWriter`, done by a process of its own; each call waits for it.

    Parameters
    ----------
    how : {"begin", "go_on"}
        Whether the file is new, or of a run that goes on.
    path, disks, box, options
        As for `TrajectoryWriter` or `TrajectoryWriter.resume`.

    Raises
    ------
    InputError
        As these; or if there can be no further process. Nothing is left behind.
    """

    def __init__(
        self, how: str, path: str | os.PathLike[str], disks: Disks, box: Box, **options: Any
    ) -> None:
        self.path = Path(path)
        self._fields = [
            h5md.FIELDS[name].attribute
            for name in options.get("fields", DEFAULT_FIELDS)
            if name in h5md.FIELDS
        ]
        self._news: dict[str, Any] = {
            "frames": 0,
            "series_rows": 0,
            "events": 0,
            "seen": {},
            "compressor": None,
        }
        self._closed = False
        self._memory_file = os.memfd_create("ifrdem-frames")
        self._memory: mmap.mmap | None = None
        self._line, theirs = connection.Pipe()
        main = threading.current_thread() is threading.main_thread()
        try:
            with children.deaf():
                self._process = subprocess.Popen(
                    [
                        sys.executable, "-c", _SERVE, str(theirs.fileno()), str(self._memory_file), str(os.getpid()),
                        "main" if main else "other", *sys.path,
                    ],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    pass_fds=(theirs.fileno(), self._memory_file),
                )  # fmt: skip
        except OSError as error:
            self._line.close()
            os.close(self._memory_file)
            raise InputError(
                f"output {os.fspath(path)}: no process can be started to write it: {error}"
            ) from error
        finally:
            theirs.close()  # so that the line breaks when the process ends
        self._end = weakref.finalize(self, _end, self._process, self._line, self._memory_file)
        try:
            self._call(how, path, disks, box, **options)
        except BaseException:
            self._end()
            raise

    def __len__(self) -> int:
        """Number of committed frames."""
        return int(self._news["frames"])

    @property
    def series_rows(self) -> int:
        """Number of committed rows of the series."""
        return int(self._news["series_rows"])

    @property
    def events(self) -> int:
        """Number of committed events of the histories."""
        return int(self._news["events"])

    @property
    def compressor(self) -> str | None:
        """Who compresses, for people; None if nothing is compressed."""
        return self._news["compressor"]  # type: ignore[no-any-return,unused-ignore]

    @property
    def seen(self) -> dict[str, int]:
        """As `TrajectoryWriter.seen`."""
        return dict(self._news["seen"])

    def write(self, state: State, observables: Mapping[str, ArrayLike] | None = None) -> None:
        """As `TrajectoryWriter.write`."""
        slim = copy.copy(state)  # the rest need not travel; spins say how many disks there are
        for name in ("position", "velocity", "collisions", "image", "last_partner", "angle"):
            if name not in self._fields:
                setattr(slim, name, None)
        slim.flow = slim.wall_hits = slim.latest_collision = None  # type: ignore[assignment]
        self._call("write", slim, observables)

    def write_series(
        self, time: float, values: Mapping[str, ArrayLike], columns: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        """As `TrajectoryWriter.write_series`."""
        self._call("write_series", time, values, columns)

    def write_series_rows(
        self,
        rows: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """As `TrajectoryWriter.write_series_rows`."""
        self._call("write_series_rows", rows, columns)

    def begin_histories(self, ids: ArrayLike, state: State) -> None:
        """As `TrajectoryWriter.begin_histories`."""
        self._call("begin_histories", ids, state)

    def write_histories(self, events: Mapping[str, ArrayLike], time: float) -> None:
        """As `TrajectoryWriter.write_histories`."""
        self._call("write_histories", events, time)

    def close(self) -> None:
        """As `TrajectoryWriter.close`; the process ends."""
        if self._closed:
            return
        self._closed = True
        try:
            self._call("close")
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(PATIENCE)
        finally:
            self._end()

    def _call(self, name: str, *given: Any, **options: Any) -> None:
        buffers: list[pickle.PickleBuffer] = []

        def apart(buffer: pickle.PickleBuffer) -> bool:
            """Whether a buffer stays among the rest."""
            if buffer.raw().nbytes < SHARED:
                return True
            buffers.append(buffer)
            return False

        data = pickle.dumps((name, given, options), protocol=5, buffer_callback=apart)
        try:
            if self._process.poll() is not None:
                raise EOFError
            places = self._share(buffers)
            self._line.send((places, data))
            error, self._news = self._line.recv()
        except (EOFError, ConnectionError) as broken:
            self._closed = True
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(PATIENCE)
            ended = children.how_it_ended(self._process.poll())
            self._end()
            raise TrajectoryError(
                f"{self.path}: the process that writes it {ended}; the {len(self)} frames before are kept"
            ) from broken
        self.path = Path(self._news["path"] or self.path)
        if error is not None:
            raise error

    def _share(self, buffers: Sequence[pickle.PickleBuffer]) -> list[tuple[int, int]]:
        """Copy these into the memory that both have, without Python's lock; returns where they are: begin and end."""
        places: list[tuple[int, int]] = []
        end = 0
        for buffer in buffers:
            begin = -(-end // PAGE) * PAGE
            end = begin + buffer.raw().nbytes
            places.append((begin, end))
        if end and (self._memory is None or len(self._memory) < end):
            os.ftruncate(self._memory_file, end)
            self._memory = mmap.mmap(self._memory_file, end)
        for buffer, (begin, end) in zip(buffers, places, strict=True):
            assert self._memory is not None
            np.copyto(_bytes_of(self._memory)[begin:end], _bytes_of(buffer.raw()))
        return places


def _bytes_of(memory: mmap.mmap | memoryview) -> NDArray[np.uint8]:
    return np.frombuffer(memory, np.uint8)


def _end(process: subprocess.Popen[bytes], line: connection.Connection, memory_file: int) -> None:
    """Leave nothing of the process; its file keeps what is committed."""
    process.kill()
    process.wait()
    line.close()
    os.close(memory_file)


# ---------------------------------------------------------------------- in the process


def serve(line_file: int, memory_file: int, parent: int, of_main_thread: bool) -> None:
    """Do what the line says until it breaks; then end at once, as the run has ended, however it did."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # the run's matter
    with contextlib.suppress(OSError):  # a container may forbid it, and nothing depends on it
        os.setpriority(os.PRIO_PROCESS, 0, 19)
    if of_main_thread:
        # Not to outlive a run that is killed, not even for the rest of a frame: it would hold the file's lock.
        ctypes.CDLL(None).prctl(_DEATH_OF_PARENT, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
    line: connection.Connection[Any, Any] = connection.Connection(line_file)
    memory: mmap.mmap | None = None
    writer: TrajectoryWriter | None = None
    while True:
        try:
            places, data = line.recv()
        except (EOFError, ConnectionError):
            os._exit(1)
        error: Exception | None = None
        try:
            if places and (memory is None or len(memory) < places[-1][1]):
                memory = mmap.mmap(memory_file, 0)
            views = [memoryview(memory)[begin:end] for begin, end in places]  # type: ignore[arg-type]
            name, given, options = pickle.loads(data, buffers=views)
            if name in ("begin", "go_on"):
                make = TrajectoryWriter if name == "begin" else TrajectoryWriter.resume
                writer = make(*given, **options)
            else:
                getattr(writer, name)(*given, **options)
            del given, options, views
        except (InputError, TrajectoryError) as caught:
            error = caught
        except Exception as caught:  # whatever it is, the run has to hear of it
            error = RuntimeError(f"the process that writes: {caught!r}\n{traceback.format_exc()}")
        news: dict[str, Any] = {
            "frames": 0,
            "series_rows": 0,
            "events": 0,
            "seen": {},
            "compressor": None,
            "path": None,
        }
        if writer is not None:
            news = {
                "frames": len(writer), "series_rows": writer.series_rows, "events": writer.events,
                "seen": writer.seen, "compressor": writer.compressor, "path": os.fspath(writer.path),
            }  # fmt: skip
        try:
            line.send((error, news))
        except ConnectionError:
            os._exit(1)
        if name == "close":
            os._exit(0)
