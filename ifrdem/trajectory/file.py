"""An HDF5 file open for writing: locked, and valid after every write that reaches the disk."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import h5py

from ..errors import InputError, TrajectoryError, option_name, refuse
from ..tools import files

_SUPERBLOCK = b"\x89HDF\r\n\x1a\n"
PAGE = 4096
"""Bytes that reach a file together: a kill in the middle of a write leaves the pages before, not those after."""
ALIGNED = 2096
"""Bytes from which on a piece begins on a page: nodes of the index of a dataset's chunks have 2096 to 3136."""
ON_PAGES = {"alignment_threshold": ALIGNED, "alignment_interval": PAGE}
"""That, as `h5py.File` takes it."""


@contextlib.contextmanager
def signals_postponed() -> Iterator[Callable[[], None]]:
    """Postpone the handlers of signals (Ctrl-C) to the end; the function that it gives calls those that wait, at once.

    HDF5 crashes if a handler raises while it calls an `OrderedFile`. Handlers run in the main thread only.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    waiting: list[int] = []  # numbers of signals
    postponed = True

    def handle(number: int, frame: FrameType | None) -> None:
        if postponed:
            waiting.append(number)
        else:  # the handlers are being put back
            handlers[number](number, frame)

    def call() -> None:
        while waiting:
            first = waiting.pop(0)
            handlers[first](first, None)

    try:
        for each in signal.valid_signals():
            if callable(handler := signal.getsignal(each)):
                handlers[each] = handler
                signal.signal(each, handle)
        yield call
    finally:
        postponed = False
        for number, handler in handlers.items():
            signal.signal(number, handler)
        call()


@contextlib.contextmanager
def new_file(path: Path, **options: Any) -> Iterator[NewFile]:
    """An HDF5 file to be filled, in the place of an empty one; of any size, since none of it waits in memory.

    HDF5 can crash if it writes a file itself and the disk is full. Signals wait for the end, or for `NewFile.check`.

    Raises OSError if it cannot be written.
    """
    with signals_postponed() as call:
        raw = OrderedFile(path)
        try:
            with NewFile(raw, "w", **options) as file:
                file.raw, file.call = raw, call
                try:
                    yield file
                except BaseException:
                    raw.dropping = True  # nobody needs what HDF5 writes when it closes the file
                    raise
        except Exception as error:
            if raw.error is None or raw.error is error:
                raise
            raise raw.error from error  # of which the other one is a consequence
        finally:
            raw.close()
        if raw.error is not None:
            raise raw.error


class NewFile(h5py.File):  # type: ignore[misc]  # h5py has no types
    """A file of `new_file`; `check` may be called in the midst of a long work on it."""

    raw: OrderedFile
    call: Callable[[], None]

    def check(self) -> None:
        """Raise OSError if something could not be written so far; call the handlers of signals."""
        self.call()
        if self.raw.error is not None:
            raise self.raw.error


class OrderedFile:
    """File under HDF5 that orders its writes to the disk: after any of them the file is valid.

    HDF5 flushes its metadata by address. When the index of a dataset's chunks splits, the node that points to new ones
    is then written before them: a process killed in between leaves a file whose committed frames cannot be found. Here,
    new space is written at once, and changes of space in use wait for the flush: first the superblock, which says how
    far the file reaches, then the indexes, parents before children, then the numbers of rows. A parent that names a new
    child early is harmless, because the old one still holds what has moved. Only a new name in a group that exists
    changes two pieces that must fit, its heap's head and body: groups are added before the first frame where possible.

    A kill in the middle of a write leaves its first pages: no node of an index lies across two (`ALIGNED`), or half of
    it would hide chunks, whose numbers HDF5 reads as zeros. A header may; the bytes of it that change are on one page,
    but for one header in 2,000 of those that are added after compressed frames.

    The file exists, and is locked until `close`. The first failure (`error`) is not raised, because HDF5 cannot handle
    it in the middle of its work: nothing is written any more (`dropping`), and the writer checks it after each flush.
    For the same reason signals wait while HDF5 may use the file (`signals_postponed`).

    Raises BlockingIOError that names the process if one has locked the file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.error: OSError | None = None
        self.dropping: bool = False  # nothing is written any more
        self._raw = open(path, "r+b", buffering=0)  # noqa: SIM115 closed by `close`
        try:
            files.lock(self.fileno(), path)
        except OSError:
            self._raw.close()
            raise
        self._at = 0
        self._size = self._in_use = os.fstat(self.fileno()).st_size
        self._waiting: dict[int, bytes] = {}  # changes of space in use, by place; they do not overlap

    def fileno(self) -> int:
        """The descriptor."""
        return self._raw.fileno()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move; from the start or from the end."""
        self._at = offset + (self._size if whence == os.SEEK_END else 0)
        return self._at

    def tell(self) -> int:
        """The current position."""
        return self._at

    def readinto(self, buffer: bytearray) -> int:
        """Fill a buffer from the present place; zeros beyond the end."""
        view = memoryview(buffer).cast("B")
        done = 0
        with self._noting():
            self._raw.seek(self._at)
            while more := self._raw.readinto(view[done:]):
                done += more
        view[done:] = bytes(len(view) - done)
        for start, held in self._waiting.items():
            low, high = max(start, self._at), min(start + len(held), self._at + len(view))
            if low < high:
                view[low - self._at : high - self._at] = held[low - start : high - start]
        self._at += len(view)
        return len(view)

    def read(self, size: int) -> bytes:
        """The next bytes; h5py takes for a file what can do this."""
        data = bytearray(size)
        self.readinto(data)
        return bytes(data)

    def write(self, buffer: bytes) -> int:
        """Write at the present place: to new space now, to space in use at the next flush."""
        view = memoryview(buffer).cast("B")
        old = max(0, min(len(view), self._in_use - self._at))
        if old:
            with self._noting():
                self._defer(self._at, bytes(view[:old]))
        if old < len(view):
            self._write(view[old:], self._at + old)
        self._at += len(view)
        self._size = max(self._size, self._at)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the size; a file that is to be shorter is cut when it is closed."""
        self._size = self._at if size is None else size
        if os.fstat(self.fileno()).st_size < self._size:
            self._cut()
        return self._size

    def flush(self) -> None:
        """Write pending data, in an order that leaves a valid file if interrupted."""
        for start, data in sorted(self._waiting.items(), key=lambda item: _order(item[1])):
            self._write(memoryview(data), start)
        self._waiting.clear()
        self._in_use = max(self._in_use, self._size)

    def close(self) -> None:
        """Write pending data and release the file."""
        if self._raw.closed:
            return
        self.flush()
        self._cut()
        files.unlock(self.fileno())
        self._raw.close()

    def _defer(self, start: int, data: bytes) -> None:
        """Keep a change of space in use; one piece of all that overlap, the new one above."""
        end = start + len(data)
        for position, held in list(self._waiting.items()):
            if position < end and start < position + len(held):
                low, high = min(position, start), max(position + len(held), end)
                whole = bytearray(high - low)
                whole[position - low : position - low + len(held)] = held
                whole[start - low : start - low + len(data)] = data
                del self._waiting[position]
                start, data, end = low, bytes(whole), high
        self._waiting[start] = data

    def _write(self, view: memoryview, position: int) -> None:
        with self._noting():
            if not self.dropping:
                self._raw.seek(position)
                while len(view):
                    view = view[self._raw.write(view) :]

    def _cut(self) -> None:
        with self._noting():
            if not self.dropping:
                self._raw.truncate(self._size)

    @contextlib.contextmanager
    def _noting(self) -> Iterator[None]:
        try:
            yield
        except (OSError, MemoryError) as error:
            known = error if isinstance(error, OSError) else OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))
            # Without its traceback: the frames there hold memory of HDF5 that has to be let go of.
            self.error = self.error or known.with_traceback(None)
            self.dropping = True


def _order(data: bytes) -> tuple[int, int]:
    """Rank of a piece in the order of writing. Pieces of one rank keep HDF5's order: data, then their headers."""
    for number, mark in ((0, _SUPERBLOCK), (1, b"HEAP"), (2, b"TREE\x01"), (4, b"TREE"), (5, b"SNOD")):
        # A heap holds names, trees chunks (\x01) or names: from the root down, whose level is the sixth byte.
        if data.startswith(mark):
            return number, -data[5] if mark.startswith(b"TREE") else 0
    return 3, 0  # names, numbers, and headers of datasets, which say how many rows there are


class OutputFile:
    """An HDF5 file open for writing.

    A new one is written under a temporary name in the same folder; `publish` renames it. No half file has its name.

    Its place `path` has links followed: what they point to is replaced, not they. After a failure (`failed`) nothing is
    written any more.
    """

    def __init__(
        self,
        file: h5py.File,
        raw: OrderedFile,
        path: Path,
        present: Path,
        *,
        replaces: bool,
        new: bool,
        held: files.Hold | None = None,
    ) -> None:
        self.file = file
        self._raw = raw
        self.path = path
        self.failed: bool = False
        self._present = present
        self._replaces = replaces
        self._held = held  # the old file, locked until this one takes its place
        self._removable = new
        # HDF5 must not call a file of Python's once Python is gone: one that was not closed is closed before.
        self._at_exit = weakref.finalize(self, _close, file, raw, held)

    @classmethod
    def create(
        cls, given: str | os.PathLike[str], fill: Callable[[h5py.File], None], *, force: bool
    ) -> OutputFile:
        """A new file; `fill` writes its content before its first commit.

        Raises InputError if the path exists and `force` is not given, a process writes it, or the file cannot be made.
        Nothing remains then.
        """
        path, name = Path(os.path.realpath(given)), f"output {os.fspath(given)}"
        if os.path.isdir(path):  # unlike Path.is_dir, os.path takes an impossible name for an absent file
            raise InputError(f"{name} is a folder: must be the name of a file")
        if not os.path.isdir(path.parent):
            raise InputError(f"{name}: the folder {path.parent} does not exist")
        if (replaces := os.path.exists(path)) and not os.path.isfile(path):
            raise InputError(f"{name} is not a regular file")
        if replaces and not force:
            raise InputError(
                f"{name} exists: choose another name, or replace it ({option_name('--force', 'force=True')})"
            )
        held = None
        try:
            held = files.Hold(path) if replaces else None
            present = files.create(path)
        except OSError as error:
            _close(held)
            raise InputError(f"{name} cannot be created: {files.cause(error)}") from error
        file, raw, output = None, None, None
        try:
            with signals_postponed():
                raw = OrderedFile(present)
                # The default libver: files written with "latest" do not open after a kill.
                file = h5py.File(raw, "w", **ON_PAGES)
                fill(file)
                output = cls(file, raw, path, present, replaces=replaces, new=True, held=held)
                output.flush()
                if not replaces:  # else the old file keeps the place until the first commit
                    if force:
                        remove_views(path)
                    output.publish()
        except BaseException as error:
            failure = raw.error if raw is not None else None
            with signals_postponed():
                if raw is not None:
                    raw.dropping = True
                if output is not None:
                    output.failed = True
                    output.close(lambda: None, keep=False)
                else:
                    _close(file, raw, held)
                    present.unlink(missing_ok=True)
            if failure is None and not isinstance(error, OSError | RuntimeError | ValueError | TypeError):
                raise
            raise InputError(f"{name} cannot be written: {files.cause(failure or error)}") from error
        return output

    @classmethod
    def reopen(cls, given: str | os.PathLike[str]) -> OutputFile:
        """An existing file, opened for further writing; no other process can write it meanwhile.

        Raises InputError if it is not there, not HDF5, damaged, or open elsewhere.
        """
        path, name, raw = Path(os.path.realpath(given)), os.fspath(given), None
        if not os.path.isfile(path):
            raise InputError(f"{name}: there is no such file to continue")
        try:
            with signals_postponed():
                raw = OrderedFile(path)
                file = h5py.File(raw, "r+", **ON_PAGES)
        except BlockingIOError as error:
            raise InputError(f"{name} is open elsewhere: {error.strerror}") from error
        except (OSError, RuntimeError) as error:
            _close(raw)
            raise InputError(f"{name} cannot be appended to: {files.cause(error)}") from error
        return cls(file, raw, path, path, replaces=False, new=False)

    @property
    def replaced_or_removed(self) -> str | None:
        """Reason why the open file is no longer at its path; None if it is."""
        if not self.file:
            return None
        try:
            there = os.stat(self._present)
        except FileNotFoundError:
            return "another process has deleted or moved it"
        same = os.path.samestat(there, os.fstat(self._raw.fileno()))
        return None if same else "another process has replaced it"

    def publish(self) -> None:
        """Give the file its name."""
        if self._present == self.path:
            return
        if self._replaces:
            _close(self._held)
            # The lock does not exclude new writers while others read the old file.
            if use := files.being_written(self.path):
                raise BlockingIOError(errno.EWOULDBLOCK, f"another file was written there meanwhile: {use}")
            remove_views(self.path)
            os.replace(self._present, self.path)
        else:
            try:
                os.link(self._present, self.path)  # unlike a renaming, this never overwrites
            except FileExistsError:  # another process was faster
                raise
            except OSError:  # a file system without hard links
                os.rename(self._present, self.path)
            else:
                self._present.unlink()
        self._present = self.path

    @contextlib.contextmanager
    def committing(self, what: str, kept: Callable[[], str]) -> Iterator[None]:
        """Turn what fails inside, where `what` is written, into a TrajectoryError; nothing is written after it.

        `kept` describes what the file keeps.
        """
        if self.failed or not self.file:
            raise TrajectoryError(f"{self.path} is closed: {what} cannot be added")
        try:
            if reason := self.replaced_or_removed:
                raise FileNotFoundError(reason)
            with signals_postponed():
                yield
        except TrajectoryError as error:
            self.failed = True
            raise TrajectoryError(f"{self.path}: {error}") from error
        except Exception as error:
            failure = self._raw.error or error  # of which the other one is a consequence
            if not isinstance(failure, OSError | RuntimeError):
                raise
            self.failed = True
            if self.replaced_or_removed:
                left = "its frames are no longer there"
            elif self._present != self.path:
                left = "nothing of it is kept; the file that was there before stays"
            else:
                left = kept()
            raise TrajectoryError(
                f"{self.path}: {what} could not be written ({files.reason(failure)}); {left}{files.remedy(failure)}"
            ) from error

    def flush(self) -> None:
        """Flush everything written to the disk.

        Raises OSError if something could not be written. Nothing reaches the file any more then.
        """
        self.file.flush()
        if self._raw.error is not None:
            raise self._raw.error

    def close(self, drop: Callable[[], None], *, keep: bool) -> None:
        """Close the file; `drop` removes what is not committed, and a new file is removed unless `keep`.

        Raises TrajectoryError if closing fails, e.g. because the disk has gone.
        """
        if not self.file:
            return
        keep = keep or not self._removable
        with signals_postponed():
            try:
                if not self.failed:
                    drop()
                    self.flush()
                self.file.close()
                self._raw.close()
                if self._raw.error is not None and not self.failed:
                    raise self._raw.error
                if keep and not self.failed:
                    self.publish()
            except (OSError, RuntimeError) as error:
                if not self.failed:  # otherwise the write that failed has said it
                    self.failed = True
                    raise TrajectoryError(f"{self.path} could not be closed: {files.cause(error)}") from error
            finally:
                self._at_exit()
                if not keep or self._present != self.path:
                    self._present.unlink(missing_ok=True)


@contextlib.contextmanager
def staged(file: h5py.File, name: str) -> Iterator[h5py.Group]:
    """A new group to fill; it gets its name at the end, when all that is in it has been written."""
    drop_staged(file, name)
    yield file.create_group(f"{name}_uncommitted")
    file.flush()
    file.move(f"{name}_uncommitted", name)


def drop_staged(file: h5py.File, name: str) -> None:
    """Remove a group that a kill or an error left unfinished."""
    if f"{name}_uncommitted" in file:
        del file[f"{name}_uncommitted"]


def on_pages(size: int) -> int:
    """Bytes of a piece of a file, rounded up to whole pages if it begins on one."""
    return -(-size // PAGE) * PAGE if size >= ALIGNED else size


def views_of(trajectory: str | os.PathLike[str]) -> list[Path]:
    """Views of a trajectory in its folder: files without data of their own, under the names of views."""
    path = Path(trajectory)
    name = path.name.removesuffix(".h5")
    return [one for each in files.VIEWS if _is_view(one := path.with_name(name + each))]


def check_views(paths: Iterable[Path]) -> None:
    """Refuse to write views where other files stand, such as the results of a study: InputError names them."""
    refuse(
        [
            f"output {path}: is no view of a trajectory, and is not replaced: move it, or write elsewhere"
            for path in paths
            if path.is_file() and not _is_view(path)
        ]
    )


def _is_view(path: Path) -> bool:
    with contextlib.suppress(OSError, RuntimeError, KeyError, AttributeError):
        if path.is_file():  # a pipe would be waited for
            with h5py.File(path) as file:
                return bool(file["VTKHDF/Points" if "VTKHDF" in file else "coordinates"].is_virtual)
    return False


def remove_views(trajectory: str | os.PathLike[str]) -> None:
    """Remove the views of a trajectory that is replaced: they would show the new data at old times."""
    for view in views_of(trajectory):
        view.unlink()


def _close(*each: h5py.File | OrderedFile | files.Hold | None) -> None:
    for one in each:
        if one is not None:
            with contextlib.suppress(OSError, RuntimeError):
                one.close()
