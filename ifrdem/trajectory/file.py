"""An HDF5 file that is being written: at its place, with room on the disk, and whole whatever happens."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import h5py
from numpy.typing import NDArray

from ..errors import InputError
from ..tools import files
from .ordered_file import OrderedFile

LOST = "its frames are not at their place any more"
LOCK_WAIT = 2.0  # seconds for which a lock may yet be given back


class TrajectoryError(RuntimeError):
    """A trajectory cannot be written further (a full disk, a closed file). Its committed frames are kept."""


class OutputFile:
    """An HDF5 file open for writing.

    A new one grows up beside its place, so that its place never holds half a file; `publish` puts it there.
    HDF5 cannot undo half a write: room on the disk is reserved before HDF5 begins (`reserve`).

    Attributes
    ----------
    path : Path
        Its place, links followed: what they point to is replaced, not they.
    file : h5py.File
        The open file.
    failed : bool
        Whether writing has failed; nothing is written any more then.
    """

    def __init__(
        self,
        file: h5py.File,
        raw: OrderedFile | None,
        path: Path,
        present: Path,
        *,
        replaces: bool,
        new: bool,
    ) -> None:
        self.file = file
        self._raw = raw
        self.path = path
        self.failed = False
        self._present = present
        self._replaces = replaces
        self._removable = new
        # HDF5 must not call a file of Python's once Python is gone: one that was not closed is closed before.
        self._at_exit = weakref.finalize(self, _close, file, raw)

    @classmethod
    def create(
        cls, given: str | os.PathLike[str], fill: Callable[[h5py.File], None], *, force: bool
    ) -> OutputFile:
        """A new file; `fill` writes what stands in it before its first commit.

        Raises
        ------
        InputError
            If the path exists and `force` is not given, or the file cannot be made. Nothing is left behind.
        """
        path = Path(os.path.realpath(given))
        replaces = _check_output(path, given, force=force)
        present = _create_empty(path, given)
        file, raw = None, None
        try:
            raw = _ordered(present)
            # The default libver: files written with "latest" do not open after a kill.
            file = h5py.File(raw or present, "w")
            fill(file)
            output = cls(file, raw, path, present, replaces=replaces, new=True)
            output.flush()
            if not replaces:  # else the old file keeps the place until the first commit
                output.publish()
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            _close(file, raw)
            present.unlink(missing_ok=True)
            raise InputError(f"output {os.fspath(given)} cannot be written: {error}") from error
        return output

    @classmethod
    def reopen(cls, given: str | os.PathLike[str]) -> OutputFile:
        """A file that is there, to be written further; no other process can write it meanwhile.

        Raises
        ------
        InputError
            If it is not there, not HDF5, damaged, or open elsewhere.
        """
        path = Path(os.path.realpath(given))
        if not os.path.isfile(path):
            raise InputError(f"{os.fspath(given)}: there is no such file to go on with")
        raw = None
        try:
            raw = _ordered_soon(path)
            file = h5py.File(raw or path, "r+")
        except BlockingIOError as error:
            raise InputError(
                f"{os.fspath(given)} is open elsewhere: a run is writing it, or a program holds it"
            ) from error
        except (OSError, RuntimeError) as error:
            _close(None, raw)
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise InputError(f"{os.fspath(given)} cannot be written further: {reason}") from error
        return cls(file, raw, path, path, replaces=False, new=False)

    def __bool__(self) -> bool:
        """Whether it is open."""
        return bool(self.file)

    @property
    def present(self) -> Path:
        """Where the file is until it is published, and then."""
        return self._present

    @property
    def identity(self) -> tuple[int, int] | None:
        """Device and number of the open file on its file system; None where the system does not tell."""
        if self._raw is None or not self.file:
            return None
        own = os.fstat(self._raw.fileno())
        return own.st_dev, own.st_ino

    def publish(self) -> None:
        """Put the file at its place."""
        if self._present == self.path:
            return
        if self._replaces:
            os.replace(self._present, self.path)
        else:
            try:
                os.link(self._present, self.path)  # unlike a renaming, this never overwrites
            except FileExistsError:  # somebody was quicker
                raise
            except OSError:  # a file system without hard links
                os.rename(self._present, self.path)
            else:
                self._present.unlink()
        self._present = self.path

    def lend(self, arrays: Iterable[NDArray[Any]]) -> None:
        """Arrays that are going to be written, and stay as they are until the next flush: it copies them then."""
        if self._raw is not None:
            self._raw.lend(arrays)

    def reserve(self, room: int) -> None:
        """Reserve so many bytes on the disk, and see that the file is still there.

        Raises
        ------
        OSError
            If the disk is full, or somebody has deleted or replaced the file.
        """
        if self._raw is not None:
            own = os.fstat(self._raw.fileno())
            if reason := gone(self._present, self.identity):
                raise FileNotFoundError(reason)
        size = self.file.id.get_filesize()
        if self._raw is None or not hasattr(os, "posix_fallocate"):
            if shutil.disk_usage(self._present.parent).free < room:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return
        if own.st_size >= size + room:  # reserved before
            return
        try:
            os.posix_fallocate(self._raw.fileno(), size, room)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # some file systems cannot reserve
                raise

    @contextlib.contextmanager
    def committing(self, what: str, kept: Callable[[], str]) -> Iterator[None]:
        """Turn what fails inside into a TrajectoryError; nothing is written after it.

        Parameters
        ----------
        what : str
            What is being written, e.g. "a frame".
        kept : callable
            Says what the file keeps.
        """
        if self.failed or not self.file:
            raise TrajectoryError(f"{self.path} is closed: {what} cannot be added")
        try:
            yield
        except TrajectoryError as error:
            self.failed = True
            raise TrajectoryError(f"{self.path}: {error}") from error
        except (OSError, RuntimeError) as caught:
            self.failed = True
            reason = (
                os.strerror(caught.errno) if isinstance(caught, OSError) and caught.errno else str(caught)
            )
            left = LOST if gone(self._present, self.identity) else kept()
            raise TrajectoryError(f"{self.path}: {what} could not be written ({reason}); {left}") from caught

    def flush(self) -> None:
        """Have all that was written on its way to the disk.

        Raises
        ------
        OSError
            If something could not be written. Nothing reaches the file any more then.
        """
        self.file.flush()
        if self._raw is not None and self._raw.error is not None:
            raise self._raw.error

    def close(self, drop: Callable[[], None], *, keep: bool) -> None:
        """Close the file.

        Parameters
        ----------
        drop : callable
            Removes what is not committed.
        keep : bool
            Whether a new file has something committed in it; otherwise it is removed.

        Raises
        ------
        TrajectoryError
            If closing fails, e.g. because the disk has gone.
        """
        if not self.file:
            return
        keep = keep or not self._removable
        try:
            if not self.failed:
                drop()
                self.flush()
            self.file.close()
            if self._raw is not None:
                self._raw.close()
                if self._raw.error is not None and not self.failed:
                    raise self._raw.error
            if keep:
                self.publish()
        except (OSError, RuntimeError) as error:
            if not self.failed:  # otherwise the write that failed has said it
                self.failed = True
                raise TrajectoryError(f"{self.path} could not be closed: {error}") from error
        finally:
            self._at_exit()
            if not keep:
                self._present.unlink(missing_ok=True)


def gone(path: Path, identity: tuple[int, int] | None) -> str | None:
    """Reason why a file that was written is not at its place any more; None if it is, or that is not known."""
    if identity is None:
        return None
    try:
        there = os.stat(path)
    except FileNotFoundError:
        return "somebody has deleted or moved it meanwhile"
    return None if (there.st_dev, there.st_ino) == identity else "somebody has replaced it meanwhile"


def _ordered(path: Path) -> OrderedFile | None:
    """The file below HDF5; None where the system has no writing at a place (Windows), and HDF5 opens it itself."""
    return OrderedFile(path) if hasattr(os, "pwrite") else None


def _ordered_soon(path: Path) -> OrderedFile | None:
    """The same for a file that may be locked for a moment yet: by the writing process of a run that was killed."""
    until = time.monotonic() + LOCK_WAIT
    while True:
        try:
            return _ordered(path)
        except BlockingIOError:
            if time.monotonic() > until:
                raise
        time.sleep(0.02)


def _close(file: h5py.File | None, raw: OrderedFile | None) -> None:
    for one in (file, raw):
        if one is not None:
            with contextlib.suppress(OSError, RuntimeError):
                one.close()


def _check_output(path: Path, given: str | os.PathLike[str], *, force: bool) -> bool:
    """Whether there is a file to replace at `path`; raises InputError if that must not be."""
    if os.path.isdir(path):  # unlike Path.is_dir, os.path takes an impossible name for an absent file
        raise InputError(f"output {os.fspath(given)} is a folder: the name of a file is needed")
    if not os.path.isdir(path.parent):
        raise InputError(f"output {os.fspath(given)}: there is no folder {path.parent}")
    if not os.path.exists(path):
        return False
    if not os.path.isfile(path):
        raise InputError(f"output {os.fspath(given)} is not a regular file")
    if not force:
        raise InputError(f"output {os.fspath(given)} exists: choose another name, or replace it (--force)")
    return True


def _create_empty(path: Path, given: str | os.PathLike[str]) -> Path:
    """Create an empty file beside `path` and return its path."""
    try:
        return files.create(path)
    except OSError as error:
        raise InputError(f"output {os.fspath(given)} cannot be created: {error.strerror}") from error
