"""What HDF5 writes, put on the disk in an order in which every beginning of it is a good file.

HDF5 flushes its metadata by address. When the index of a dataset's chunks splits, the node that points to new ones
is then written before them: a process killed in between leaves a file whose committed frames cannot be found. Here,
what goes into new space is written at once, and what changes space in use waits until the flush and goes last: first
the superblock, which says how far the file reaches, then the indexes, parents before children, then the numbers of
rows. A parent that knows a new child early is harmless, because the old one still holds what has moved. Only a new
name in a group that exists changes two pieces that must fit, its heap's head and body: groups are added before the
first frame where possible.
"""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

MOST_HELD = 2**26
"""Bytes for new space that are held back at most, to be written as one."""
BLOCK = 4096
"""Bytes: what passes by the system's cache must begin and end at a multiple of this, in the file and in memory."""
LARGE = 2**22
"""Pieces of so many bytes pass by the system's cache: a copy of them there costs a run more than the disk's work."""

MOST_GAP = 2**16
"""Bytes between two pieces for new space up to which they are written as one: HDF5 leaves such gaps for the parts of an
index, and fills them at the flush. A frame of 1e6 disks is then one writing, and not five, of which two were too short
to pass by the cache."""

LEAST_LENT = 4096
"""Smaller pieces are copied at once."""
_PRIVATE = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS} if hasattr(mmap, "MAP_ANONYMOUS") else {}
"""What is staged belongs to the process: a fork of it must not write into it."""
_SUPERBLOCK = b"\x89HDF\r\n\x1a\n"


class OrderedFile:
    """A file for HDF5's driver of Python objects. Only its process can write it: it holds a lock.

    Parameters
    ----------
    path : str or path
        A file that exists.

    Attributes
    ----------
    error : OSError or None
        The first failure. It is not raised, because HDF5 cannot be told of it in the middle of its work: nothing is
        written any more, and whoever writes looks here after each flush.

    Raises
    ------
    BlockingIOError
        If another process has locked the file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.error: OSError | None = None
        self._descriptor = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        try:
            if fcntl is not None:
                fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._descriptor)
            raise
        self._at = 0
        # The file's size to HDF5: room that is reserved behind it does not count.
        self._size = os.fstat(self._descriptor).st_size
        self._in_use = self._size
        self._waiting: dict[int, bytes] = {}
        # What is for new space, one piece: what comes next usually begins where it ends. Its memory is used again, and
        # touched only as far as pieces reach.
        self._memory = mmap.mmap(-1, MOST_HELD + BLOCK, **_PRIVATE)
        self._staged = memoryview(self._memory)
        self._new_start = self._new_end = self._size
        # Arrays that are lent, by their addresses, and what of them is still to be copied: place, array, first, length.
        self._lent: list[tuple[int, NDArray[np.uint8]]] = []
        self._late: list[tuple[int, NDArray[np.uint8], int, int]] = []
        self._past_cache = fcntl is not None and hasattr(os, "O_DIRECT")

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move; from the start or from the end."""
        self._at = offset + (self._size if whence == os.SEEK_END else 0)
        return self._at

    def tell(self) -> int:
        """Where reading and writing go on."""
        return self._at

    def readinto(self, buffer: bytearray) -> int:
        """Fill a buffer from the present place; zeros beyond the end."""
        view = memoryview(buffer).cast("B")
        data = b""
        with self._noting():
            data = os.pread(self._descriptor, len(view), self._at)
        view[: len(data)] = data
        view[len(data) :] = bytes(len(view) - len(data))
        self._copy_late()
        pieces: list[tuple[int, bytes | memoryview]] = [
            (self._new_start, self._new()),
            *self._waiting.items(),
        ]
        for start, held in pieces:
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
        """Write at the present place: it reaches the disk at the next flush, or before where that is new space."""
        view = memoryview(buffer).cast("B")
        old = max(0, min(len(view), self._in_use - self._at))
        if old:
            self._wait(self._at, bytes(view[:old]))
        if old < len(view):
            self._put(self._at + old, view[old:])
        self._at += len(view)
        self._size = max(self._size, self._at)
        return len(view)

    def lend(self, arrays: Iterable[NDArray[Any]]) -> None:
        """What of these arrays is written until the next flush may be copied then: they must stay as they are."""
        for array in arrays:
            if array.flags.c_contiguous and array.nbytes >= LEAST_LENT:
                self._lent.append((array.ctypes.data, array.reshape(-1).view(np.uint8)))

    def truncate(self, size: int | None = None) -> int:
        """Set the size; a file that is to be shorter is cut when it is closed."""
        self._size = self._at if size is None else size
        if os.fstat(self._descriptor).st_size < self._size:
            with self._noting():
                os.ftruncate(self._descriptor, self._size)
        return self._size

    def flush(self) -> None:
        """Write what waits, in an order that leaves a good file whenever it ends."""
        self._write_new()
        for start, data in sorted(self._waiting.items(), key=lambda item: _order(item[1])):
            self._write(memoryview(data), start)
        self._waiting.clear()
        self._lent.clear()
        self._in_use = self._new_start = self._new_end = max(self._in_use, self._size)

    def close(self) -> None:
        """Write what waits, give back reserved room, and let go of the file."""
        if self._descriptor < 0:
            return
        self.flush()
        if self.error is None:
            with self._noting():
                os.ftruncate(self._descriptor, self._size)
        os.close(self._descriptor)
        self._descriptor = -1
        self._staged.release()
        self._memory.close()

    def _put(self, start: int, data: memoryview) -> None:
        """Take a piece for new space. Pieces that follow each other are written as one.

        A thread beside a run gets its turn only between two kernels of Taichi, and gives it up with every writing: the
        250 chunks of a frame of 1e6 disks must not be 250 writings.
        """
        end = start + len(data)
        if self._new_start == self._new_end <= start:
            self._new_start = self._new_end = start
        if not self._new_start <= start <= self._new_end + MOST_GAP or end - self._new_start > MOST_HELD:
            self._write_new()
            if start < self._new_end or len(data) > MOST_HELD:  # it may replace one that came before
                self._write(data, start)
                self._new_start = self._new_end = max(self._new_end, end)
                return
            self._new_start = self._new_end = start
        replaces, gap = start < self._new_end, start - self._new_end
        if replaces:
            self._copy_late()  # what it replaces may have been put off
        self._new_end = max(self._new_end, end)
        staged, first = self._new(), start - self._new_start
        if gap > 0:
            staged[first - gap : first] = bytes(gap)
        if replaces or not self._put_off(start, data):
            staged[first : first + len(data)] = data

    def _put_off(self, start: int, data: memoryview) -> bool:
        """Leave a piece of an array that is lent where it is; whether it is one.

        All of an array can then be copied at once, without Python's lock, which a thread beside a run has to wait for.
        """
        if not self._lent or len(data) < LEAST_LENT:
            return False
        address = np.frombuffer(data, np.uint8).ctypes.data
        for begin, array in self._lent:
            first = address - begin
            if first >= 0 and first + len(data) <= len(array):
                if self._late:
                    place, last, its_first, length = self._late[-1]
                    if last is array and its_first + length == first and place + length == start:
                        self._late[-1] = place, array, its_first, length + len(data)
                        return True
                self._late.append((start, array, first, len(data)))
                return True
        return False

    def _copy_late(self) -> None:
        """Copy what was put off."""
        if self._late:
            staged = np.frombuffer(self._new(), np.uint8)
            for place, array, first, length in self._late:
                begin = place - self._new_start
                np.copyto(staged[begin : begin + length], array[first : first + length])
            self._late.clear()

    def _new(self) -> memoryview:
        """What waits for new space. In memory it lies as far from a multiple of a block as in the file."""
        offset = self._new_start % BLOCK
        return self._staged[offset : offset + self._new_end - self._new_start]

    def _write_new(self) -> None:
        """Write what is for new space."""
        if self._new_end > self._new_start:
            self._copy_late()
            self._write(self._new(), self._new_start)
            self._new_start = self._new_end

    def _wait(self, start: int, data: bytes) -> None:
        end = start + len(data)
        for place, held in list(self._waiting.items()):
            if place < end and start < place + len(
                held
            ):  # they overlap: one piece of both, the new one above
                low, high = min(place, start), max(place + len(held), end)
                whole = bytearray(high - low)
                whole[place - low : place - low + len(held)] = held
                whole[start - low : start - low + len(data)] = data
                del self._waiting[place]
                start, data, end = low, bytes(whole), high
        self._waiting[start] = data

    def _write(self, view: memoryview, place: int) -> None:
        first = -place % BLOCK
        whole = (len(view) - first) // BLOCK * BLOCK
        if not self._past_cache or whole < LARGE or view.obj is not self._memory:
            self._write_all(view, place)
            return
        self._write_all(view[:first], place)
        done = self._write_past_cache(view[first : first + whole], place + first)
        self._write_all(view[first + done :], place + first + done)

    def _write_all(self, view: memoryview, place: int) -> None:
        with self._noting():
            while len(view) and self.error is None:
                done = os.pwrite(self._descriptor, view, place)
                view, place = view[done:], place + done

    def _write_past_cache(self, view: memoryview, place: int) -> int:
        """Write whole blocks from memory to the disk; returns how many bytes. What is left the cache can take.

        Not all file systems do this; with those that do not, it is not tried again.
        """
        if self.error is not None:
            return 0
        flags = fcntl.fcntl(self._descriptor, fcntl.F_GETFL)
        try:
            fcntl.fcntl(self._descriptor, fcntl.F_SETFL, flags | os.O_DIRECT)
            done = os.pwrite(self._descriptor, view, place)
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.EOPNOTSUPP):
                self._past_cache = False
            else:
                self._note(error)
            done = 0
        finally:
            fcntl.fcntl(self._descriptor, fcntl.F_SETFL, flags)
        return done

    @contextlib.contextmanager
    def _noting(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._note(error)

    def _note(self, error: OSError) -> None:
        """Keep the first error, without its traceback: the frames there hold memory that has to be let go of."""
        self.error = self.error or error.with_traceback(None)


def _order(data: bytes) -> tuple[int, int]:
    """When a piece is written: see the numbers. Pieces of one number keep HDF5's order: data, then their headers."""
    if data.startswith(_SUPERBLOCK):
        return 0, 0
    if data.startswith(b"HEAP"):  # of names
        return 1, 0
    if data.startswith(
        b"TREE\x01"
    ):  # of chunks, from the root down; the sixth byte is the level, 0 for leaves
        return 2, -data[5]
    if data.startswith(b"TREE"):  # of the names in a group
        return 4, -data[5]
    # Without a mark: names, numbers, and headers of datasets, which say how many rows there are.
    return (5, 0) if data.startswith(b"SNOD") else (3, 0)
