"""Text files of users: regular ones, of a bounded size, in UTF-8. All texts that are not our own are read here."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path

from ..errors import InputError, nearest_file

MOST_LINE = 100_000
"""Characters of a line of a table at most."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_ESCAPED = re.compile("[\udc80-\udcff]")  # bytes that are no UTF-8, as the handler "surrogateescape" has them


def at_once(name: str, flags: int) -> int:
    """Open a file without waiting for a writer of a pipe, or for content: an `opener` of `open`."""
    return os.open(name, flags | getattr(os, "O_NONBLOCK", 0))


def opened(path: Path) -> io.BufferedReader:
    """A regular file, open; InputError as `read`."""
    if "\0" in str(path):
        raise InputError("cannot be read: a null character stands in its name")
    try:
        file = open(path, "rb", opener=at_once)  # noqa: SIM115
    except FileNotFoundError:
        folder = path.parent
        near = sorted((*folder.glob("*.toml"), *folder.glob("*.csv"))) if folder.is_dir() else []
        raise InputError(
            f"there is no such file{nearest_file(path.name, [each.name for each in near])}"
        ) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from None
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise InputError("is a device or pipe: must be a regular file")
    return file


def _refuse_hdf5(content: bytes) -> None:
    """Raise InputError if a file begins as HDF5 files do."""
    if content.startswith(_HDF5):
        raise InputError("is an HDF5 file, as trajectories, checkpoints and studies are: must be a text file")


def _refuse_larger(size: int, most: int) -> None:
    """Raise InputError if a file has more than so many bytes."""
    if size > most:
        raise InputError(f"is larger than {most / 1e6:g} MB, the most that such a file may have")


def _not_utf_8(line: int, byte: int) -> InputError:
    return InputError(f"line {line}: not a text file in UTF-8 (byte 0x{byte:02x}): save it as UTF-8")


def read(path: Path, *, most: int, bom: bool = False) -> str:
    """Text of a regular file in UTF-8 of at most so many bytes; with `bom`, a byte order mark is left out.

    Raises InputError if there is no such file, it is larger, a device, a pipe or a folder, or not text in UTF-8. The
    message does not name the file.
    """
    with opened(path) as file:
        try:
            content: bytes | None = file.read(most + 1)
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}") from None
    if content is None:  # some files of the system wait for what is to come, as /proc/kmsg does
        raise InputError("cannot be read: the system waits for its content; must be a regular file")
    _refuse_hdf5(content)
    _refuse_larger(len(content), most)
    try:
        return content.decode("utf-8-sig" if bom else "utf-8")
    except UnicodeDecodeError as error:
        raise _not_utf_8(error.object.count(b"\n", 0, error.start) + 1, error.object[error.start]) from None


def lines(path: Path, *, most: int) -> Iterator[str]:
    """Lines of a regular file, as `read` with `bom`, one by one, with the ends that they have.

    Raises InputError as `read`, or if a line has more than `MOST_LINE` characters.
    """
    with opened(path) as file:
        with contextlib.suppress(OSError):  # said below, with the line
            _refuse_hdf5(file.peek(len(_HDF5)))
        _refuse_larger(os.fstat(file.fileno()).st_size, most)
        text = io.TextIOWrapper(file, "utf-8-sig", "surrogateescape", newline="")
        for number in itertools.count(1):
            try:
                line = text.readline(MOST_LINE + 1)
            except OSError as error:
                raise InputError(f"cannot be read: {error.strerror}") from None
            if len(line) > MOST_LINE:
                raise InputError(f"line {number}: has more than {MOST_LINE} characters, the most allowed")
            if not line.isascii() and (wrong := _ESCAPED.search(line)):
                raise _not_utf_8(number, ord(wrong[0]) - 0xDC00)
            if not line:
                return
            yield line
