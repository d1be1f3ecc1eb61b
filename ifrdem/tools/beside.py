"""New files that grow up beside their place, and take it when they are whole."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path


def create(place: Path) -> Path:
    """Create an empty file beside a place, which nothing that is there can be or lead to; returns its path.

    Raises
    ------
    OSError
        If it cannot be created.
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
