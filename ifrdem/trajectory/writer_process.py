"""A trajectory writer in a process of its own.

A thread beside a run needs Python's lock, which Taichi holds while a kernel runs: what the thread then takes of the
time is the run's. A process takes what the run leaves of the processors. It is a new one, not a fork, which would share
the run's memory until one of the two writes there.

Calls go to it by name with their arguments, pickled; large arrays by way of memory that both have, of which it writes
to the file without another copy than the file's own.
"""

from __future__ import annotations

import contextlib
import copy
import ctypes
import io
import math
import mmap
import os
import pickle
import signal
import subprocess
import sys
import threading
import traceback
import warnings
import weakref
from collections.abc import Mapping, Sequence
from multiprocessing import connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..model.box import Box
from ..model.state import Disks, State
from ..tools import processes
from ..tools.buffers import copy_into
from . import layout
from .file import LOST, TrajectoryError, gone
from .writer import DEFAULT_FIELDS, TrajectoryWriter

LEAST_DISKS = 100_000
"""Disks from which on a run's writer gets a process of its own: for fewer, starting one costs more than it saves."""
SHARED = 2**16
"""Bytes from which on an array goes by way of the memory that both have."""
PATIENCE = 20.0  # seconds in which the process ends once its line is broken
PAGE = 4096
# It imports this very package, whatever the present folder and others of its name are by now; all else as it is found.
_SERVE = """
import sys
line, memory, parent, main, package, *sys.path[:] = sys.argv[1:]
import h5py, numpy
sys.path.insert(0, package)
from ifrdem.writer_process import serve
del sys.path[0]
serve(int(line), int(memory), int(parent), main == "main")
"""
_DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG
# Where an array is in the memory that both have: its first byte, type and shape.
_Place = tuple[int, np.dtype[Any], tuple[int, ...]]


class NoProcessError(InputError):
    """There can be no further process, or none with which memory can be shared."""


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
        As `TrajectoryWriter`.

    Warns
    -----
    RuntimeWarning
        If there can be no further process: the writer is one here then.
    """
    apart = _apart(path, disks, "begin", box, options)
    return TrajectoryWriter(path, disks, box, **options) if apart is None else apart


def go_on(
    path: str | os.PathLike[str], disks: Disks, box: Box, **options: Any
) -> TrajectoryWriter | RemoteWriter:
    """`TrajectoryWriter.resume` with these arguments, likewise."""
    apart = _apart(path, disks, "go_on", box, options)
    return TrajectoryWriter.resume(path, disks, box, **options) if apart is None else apart


def _apart(
    path: str | os.PathLike[str], disks: Disks, how: str, box: Box, options: Mapping[str, Any]
) -> RemoteWriter | None:
    """The writer in a process of its own, or None where there is to be none."""
    if disks.n < LEAST_DISKS or not possible():
        return None
    try:
        return RemoteWriter(how, path, disks, box, **options)
    except NoProcessError as error:
        warnings.warn(
            f"{error}; a thread of the run writes, which takes more of its time", RuntimeWarning, stacklevel=3
        )
        return None


class _NoAnswerError(TrajectoryError):
    """The process cannot be reached; `reason` says how that is, the message also what is kept."""

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


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
        As these. Nothing is left behind.
    NoProcessError
        If there can be no further process.
    """

    def __init__(
        self, how: str, path: str | os.PathLike[str], disks: Disks, box: Box, **options: Any
    ) -> None:
        self.path = Path(path)
        fields = options.get("fields", DEFAULT_FIELDS)
        fields = [fields] if isinstance(fields, str) else list(fields)
        if "fields" in options:
            options["fields"] = fields  # it may be a generator, which is empty now
        self._fields = [layout.FIELDS[name].attribute for name in fields if name in layout.FIELDS]
        self._news: dict[str, Any] = _news_of(None)
        self._closed = False
        self._bare = how == "begin"  # the file is new, and nothing that it could hold has been handed on
        self._memory: mmap.mmap | None = None
        try:
            self._process, self._line, self._memory_file = _start()
        except OSError as error:
            raise NoProcessError(
                f"output {os.fspath(path)}: no process can be started to write it: {error}"
            ) from error
        self._end = weakref.finalize(self, _end, self._process, self._line, self._memory_file)
        try:
            self._call(how, path, disks, box, **options)
        except _NoAnswerError as error:  # it never worked: so a thread may
            raise NoProcessError(f"output {os.fspath(path)}: {error.reason}") from error
        except BaseException:
            self._end()
            raise

    def __len__(self) -> int:
        """Number of committed frames."""
        return int(self._news["frames"])

    @property
    def gone(self) -> str | None:
        """As `TrajectoryWriter.gone`."""
        return gone(Path(self._news["present"] or self.path), self._news["identity"])

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
            self._memory = None

    def _call(self, name: str, *given: Any, **options: Any) -> None:
        if self._closed and name != "close":
            raise TrajectoryError(f"{self.path} is closed: nothing can be added")
        message = io.BytesIO()
        pickler = _Pickler(message)
        try:
            pickler.dump((name, given, options))
        except (pickle.PicklingError, TypeError, AttributeError) as wrong:
            raise InputError(
                f"{name}: what is given cannot be handed to the process that writes: {wrong}"
            ) from wrong
        try:
            if self._process.poll() is not None:
                raise EOFError
            places = self._share(pickler.apart)
            self._bare = self._bare and name == "begin"
            self._line.send((places, message.getvalue()))
            error, self._news = self._line.recv()
        except (EOFError, OSError) as broken:
            self._closed = True
            if isinstance(broken, EOFError | ConnectionError):
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(PATIENCE)
                what = f"the process that writes it {processes.how_it_ended(self._process.poll())}"
            else:  # there is no memory to be had, or the like
                what = f"what is to be written cannot be handed on ({broken.strerror or broken})"
            self._end()
            kept = LOST if self.gone else f"the {len(self)} frames before are kept"
            if self._bare and self._news["present"]:  # otherwise it may hold more than was answered for
                Path(self._news["present"]).unlink(missing_ok=True)
                kept = "nothing was written"
            raise _NoAnswerError(f"{self.path}: {what}; {kept}", what) from broken
        except BaseException:
            # The answer is still to come: another call must not take it for its own.
            self._closed = True
            self._end()
            raise
        self.path = Path(self._news["path"] or self.path)
        if error is not None:
            raise error

    def _share(self, arrays: Sequence[NDArray[Any]]) -> list[_Place]:
        """Copy these into the memory that both have, without Python's lock; returns where they are."""
        places: list[_Place] = []
        end = 0
        for array in arrays:
            begin = -(-end // PAGE) * PAGE
            end = begin + array.nbytes
            places.append((begin, array.dtype, array.shape))
        if end and (self._memory is None or len(self._memory) < end):
            # Reserved now: where there is too little, it would otherwise be the end of whoever touches it first.
            os.posix_fallocate(self._memory_file, 0, end)
            self._memory = mmap.mmap(self._memory_file, end)
        for array, place in zip(arrays, places, strict=True):
            assert self._memory is not None
            copy_into(_array_in(self._memory, place), array)
        return places


class _Pickler(pickle.Pickler):
    """Leaves large arrays out, which go by way of the memory that both have: `apart`."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=5)
        self.apart: list[NDArray[Any]] = []

    def persistent_id(self, thing: Any) -> int | None:
        """The number of an array that is left out."""
        if type(thing) is not np.ndarray or thing.nbytes < SHARED or thing.dtype.hasobject:
            return None
        self.apart.append(thing)
        return len(self.apart) - 1


class _Unpickler(pickle.Unpickler):
    """Puts arrays in for those that were left out."""

    def __init__(self, data: bytes, arrays: Sequence[NDArray[Any]]) -> None:
        super().__init__(io.BytesIO(data))
        self._arrays = arrays

    def persistent_load(self, number: int) -> NDArray[Any]:
        """The array of this number."""
        return self._arrays[number]


def _array_in(memory: mmap.mmap, place: _Place) -> NDArray[Any]:
    begin, kind, shape = place
    return np.frombuffer(memory, kind, math.prod(shape), begin).reshape(shape)


def _start() -> tuple[subprocess.Popen[bytes], connection.Connection, int]:
    """Start a process: it, the line to it, and the file of the memory that both have."""
    package = str(Path(__file__).resolve().parents[2])
    main = threading.current_thread() is threading.main_thread()
    with contextlib.ExitStack() as undo:
        memory = os.memfd_create("ifrdem-frames")
        undo.callback(os.close, memory)
        line, theirs = connection.Pipe()
        undo.callback(line.close)
        with theirs, processes.deaf():  # it is closed here, so that the line breaks when the process ends
            process = subprocess.Popen(
                [
                    sys.executable, "-c", _SERVE, str(theirs.fileno()), str(memory), str(os.getpid()),
                    "main" if main else "other", package, *filter(os.path.isabs, sys.path),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(), memory),
            )  # fmt: skip
        undo.pop_all()
    return process, line, memory


def _end(process: subprocess.Popen[bytes], line: connection.Connection, memory_file: int) -> None:
    """Leave nothing of the process; its file keeps what is committed."""
    process.kill()
    process.wait()
    line.close()
    os.close(memory_file)


# ---------------------------------------------------------------------- in the process


def _news_of(writer: TrajectoryWriter | None) -> dict[str, Any]:
    """What the run is told after each call."""
    if writer is None:
        return {
            "frames": 0, "series_rows": 0, "events": 0, "seen": {}, "compressor": None, "path": None, "present": None,
            "identity": None,
        }  # fmt: skip
    return {
        "frames": len(writer), "series_rows": writer.series_rows, "events": writer.events, "seen": writer.seen,
        "compressor": writer.compressor, "path": os.fspath(writer.path), "present": os.fspath(writer.present),
        "identity": writer.identity,
    }  # fmt: skip


def serve(line_file: int, memory_file: int, parent: int, of_main_thread: bool) -> None:
    """Do what the line says until it breaks; then end at once, as the run has ended, however it did."""
    for number in (*processes.SIGNALS, signal.SIGHUP):
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
    name = ""
    while True:
        error: Exception | None = None
        try:
            try:
                places, data = line.recv()
            except (EOFError, ConnectionError):
                os._exit(1)
            if places and (memory is None or len(memory) < os.fstat(memory_file).st_size):
                memory = mmap.mmap(memory_file, 0)
            arrays = [_array_in(memory, place) for place in places]  # type: ignore[arg-type]
            name, given, options = _Unpickler(data, arrays).load()
            if name in ("begin", "go_on"):
                make = TrajectoryWriter if name == "begin" else TrajectoryWriter.resume
                writer = make(*given, **options)
            else:
                getattr(writer, name)(*given, **options)
            del given, options, arrays
        except (InputError, TrajectoryError) as caught:
            error = caught
        except (MemoryError, OSError) as caught:  # of what is done here; the writer has messages of its own
            frames = 0 if writer is None else len(writer)
            why = (caught.strerror or str(caught)) if isinstance(caught, OSError) else "out of memory"
            kept = LOST if writer is not None and writer.gone else f"the {frames} frames before are kept"
            error = TrajectoryError(f"the process that writes: {why}; {kept}")
        except Exception as caught:
            # Not swallowed: the run raises it, with where it was; here nobody would see it.
            error = RuntimeError(f"the process that writes: {caught!r}\n{traceback.format_exc()}")
        try:
            line.send((error, _news_of(writer)))
        except ConnectionError:
            os._exit(1)
        if name == "close":
            os._exit(0)
