"""Text files of users, of a bounded size: cases, measured impacts, starts."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from ..errors import InputError, nearest_file

_AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # a pipe is opened without waiting for a writer


def opened(path: Path) -> BinaryIO:
    """A regular file, open; InputError as `read`."""
    if "\0" in str(path):
        raise InputError("cannot be read: a null character stands in its name")
    try:
        file = open(path, "rb", opener=lambda name, flags: os.open(name, flags | _AT_ONCE))  # noqa: SIM115
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


def refuse_larger(size: int, most: int) -> None:
    """Raise InputError if a file has more than so many bytes."""
    if size > most:
        raise InputError(f"is larger than {most / 1e6:g} MB, the most that such a file may have")


def read(path: Path, *, most: int, bom: bool = False) -> str:
    """Text of a regular file in UTF-8 of at most so many bytes; with `bom`, a byte order mark is left out.

    Raises InputError if there is no such file, it is larger, a device, a pipe or a folder, or not text in UTF-8. The
    message does not name the file.
    """
    with opened(path) as file:
        try:
            content = file.read(most + 1)
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}") from None
    refuse_larger(len(content), most)
    try:
        return content.decode("utf-8-sig" if bom else "utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"not a text file in UTF-8: {error.reason} at byte {error.start}") from None
