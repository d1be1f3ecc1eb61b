"""Groups of an HDF5 file that appear in it at once and whole."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import h5py


def _aside(name: str) -> str:
    return f"{name}_uncommitted"


@contextlib.contextmanager
def staged(file: h5py.File, name: str) -> Iterator[h5py.Group]:
    """A new group to fill; it gets its name at the end, when all that is in it has been written."""
    drop(file, name)
    yield file.create_group(_aside(name))
    file.flush()
    file.move(_aside(name), name)


def drop(file: h5py.File, name: str) -> None:
    """Remove a group that a kill or an error left unfinished."""
    if _aside(name) in file:
        del file[_aside(name)]
