"""Output files: whether they may be written, and how one appears whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ..errors import InputError, refuse

CHECKPOINT = ".checkpoint.h5"
"""Ending of the file from which a run goes on, beside its trajectory."""
VIEWS = (".vtkhdf", ".nc")
"""Endings of the files that let other programs read a trajectory (`views.py`)."""


def create(place: Path) -> Path:
    """Create an empty file beside a place, which nothing that is there can be or lead to; returns its path.

    Raises OSError if it cannot be created.
    """
    beside = place.with_name(f".{place.name[:100]}.{secrets.token_hex(4)}.part")
    flags = os.O_CREAT | os.O_EXCL | os.O_RDWR | getattr(os, "O_NOFOLLOW", 0)
    os.close(os.open(beside, flags, 0o666))
    return beside


@contextlib.contextmanager
def replacing(place: Path) -> Iterator[Path]:
    """A new file to be filled, which takes its place at the end; after an exception nothing is left of it."""
    new = create(place)
    try:
        yield new
        os.replace(new, place)
    finally:
        new.unlink(missing_ok=True)


def check_apart(path: Path, trajectory: Path, option: str = "-o") -> None:
    """Refuse an output that would replace the trajectory that it is made of.

    Raises InputError if both are one file.
    """
    if path.exists() and path.samefile(trajectory):
        raise InputError(f"output {path}: is the trajectory itself; {option} writes elsewhere")


def check_files(paths: Sequence[Path], *, force: bool, elsewhere: str = "-o writes elsewhere") -> None:
    """Refuse files that exist (unless `force`) or cannot be written.

    Raises InputError with a line for each thing that is wrong; `elsewhere` says how to choose another place. Nothing is
    left behind.
    """
    wrong = []
    for path in paths:
        if special := not_a_file(path):
            wrong.append(special)
        elif path.exists() and not force:
            wrong.append(f"output {path}: exists already; --force replaces it, {elsewhere}")
    for folder in dict.fromkeys(path.parent for path in paths):
        if not folder.exists():
            wrong.append(f"output folder {folder}: does not exist")
        elif not folder.is_dir():
            wrong.append(f"output folder {folder}: is not a folder")
        else:
            try:  # asking for permissions would be wrong for root, and on read-only file systems
                tempfile.TemporaryFile(dir=folder, prefix=".ifrdem-").close()
            except OSError as error:
                wrong.append(f"output folder {folder}: cannot be written to: {error.strerror}")
    refuse(wrong)


def write_aside(place: Path, write: Callable[[Path], object]) -> None:
    """Let `write` write a file beside its place, and rename it into place: it appears whole or not at all.

    Raises InputError if the place is a folder, a device or a pipe, which nothing must take the place of, or cannot be
    written.
    """
    if special := not_a_file(place):
        raise InputError(special)
    try:
        with replacing(place) as new:
            write(new)
    except OSError as error:
        raise InputError(f"output {place}: cannot be written: {error.strerror or error}") from error


def write_text(place: Path, text: str) -> None:
    """Write a text in UTF-8, whole or not at all; InputError as `write_aside`."""
    write_aside(place, lambda aside: aside.write_text(text, encoding="utf-8"))


def not_a_file(path: Path) -> str | None:
    """Reason why something that is there can be no output; None for files and where nothing is."""
    if path.is_dir():
        return f"output {path}: is a folder"
    if path.exists() and not path.is_file():
        return f"output {path}: is a device or pipe, no file that could be replaced"
    return None


def checkpoint_of(trajectory: Path) -> Path:
    """The checkpoint that belongs to a trajectory, NAME.checkpoint.h5 for NAME.h5."""
    return trajectory.with_name(trajectory.name.removesuffix(".h5") + CHECKPOINT)
