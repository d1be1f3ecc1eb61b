"""Reading from HDF5 files that may be damaged or malicious."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import DamageError, InputError, ReadError
from ..tools.text_file import at_once

FAULTS = (
    OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, MemoryError,
)  # fmt: skip
"""Exceptions of HDF5, NumPy, JSON and Python about content that is not what it should be."""
HINT = "; `ifrdem repair` keeps what is whole"
SYSTEM = frozenset(
    (
        errno.EACCES, errno.EPERM, errno.EROFS, errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.ESTALE, errno.ETIMEDOUT,
        errno.EMFILE, errno.ENFILE, errno.ENODEV, errno.ENXIO, errno.EBUSY, errno.ENOTCONN, errno.EINTR, errno.EBADF,
    )
)  # fmt: skip
"""Errors of the system, its drives and networks, in reading; all others can come of what a file holds."""
ZSTD = 32015  # number of the filter, https://github.com/HDFGroup/hdf5_plugins
# Numbers of bytes made of one, at most: zlib's technical details; a block of Zstandard, RFC 8878: 128 KiB of 4 bytes.
EXPANSION: dict[str | None, int] = {None: 1, "gzip": 1032, "zstd": 2**15}
# Texts and views stand in global heaps, which a file gets when it is made: those of 1e5 disks within so many bytes.
HEAPS = 1 << 24


@contextlib.contextmanager
def as_damage_error(path: str | os.PathLike[str], part: str, hint: str = HINT) -> Iterator[None]:
    """Turn every HDF5 error inside the `with` block into a DamageError that names the file and its part.

    Where the system could not read, it is a ReadError. Only for what reads and checks; faults of a computation are not
    the file's.
    """
    try:
        yield
    except ReadError:
        raise
    except InputError as error:
        if os.fspath(path) in str(error):
            raise
        raise DamageError(f"{os.fspath(path)} is damaged: {part}: {error}{hint}") from error
    except FAULTS as error:
        check_system(error, path)
        reason = f"{error.args[0]} is missing" if type(error) is KeyError and error.args else str(error)
        raise DamageError(
            f"{os.fspath(path)} is damaged: {part} cannot be read ({reason or type(error).__name__}){hint}"
        ) from error


@contextlib.contextmanager
def system_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn errors inside the `with` block into a ReadError where the system failed to read a file."""
    try:
        yield
    except InputError:
        raise
    except FAULTS as error:
        check_system(error, path)
        raise


def check_system(error: BaseException, path: str | os.PathLike[str]) -> None:
    """Raise ReadError if the system failed to read a file: an error of Python, or of HDF5, which names its number."""
    number = error.errno if isinstance(error, OSError) else None
    if number is None and (named := re.search(r"\berrno = (\d+)", str(error))):
        number = int(named[1])
    if number in SYSTEM:
        raise ReadError(
            f"{os.fspath(path)} cannot be read: {os.strerror(number)}; this says nothing of what it holds"
        ) from error


def check_readable(path: str | os.PathLike[str]) -> None:
    """Raise ReadError if the system does not read a file; `h5py.is_hdf5` then says that it is none of HDF5."""
    with system_errors(path), open(path, "rb", opener=at_once) as file:
        file.read(1)


def read(dataset: h5py.Dataset, selection: Any = ()) -> NDArray[Any]:
    """Numbers of a dataset, `dataset[selection]`; selections are numbers and slices.

    HDF5 notices damage in compressed data (deflate has a checksum) and in its own bookkeeping; changed numbers in
    uncompressed data look like other numbers. Where its bookkeeping has lost a chunk, it gives zeros; that is noticed
    here, because no writer of ours leaves a chunk of committed data out.

    Raises DamageError if HDF5 cannot read it, there are no numbers, or more than the file has room for; the message
    names the file and the dataset.
    """
    with as_damage_error(dataset.file.filename, str(dataset.name)):
        if dataset.dtype.kind not in "biuf":
            raise TypeError(f"it holds {dataset.dtype}: must be numbers")
        chosen = _selected_indices(dataset, selection)
        size = dataset.dtype.itemsize
        for one in chosen:
            size *= len(one)
        most = dataset.file.id.get_filesize() * EXPANSION[compression(dataset)]
        if size > most:
            raise ValueError(f"{size} bytes of it are requested, and the file can hold no more than {most}")
        value = dataset[selection]
        if _lacks_chunk(dataset, chosen, value):
            raise ValueError("a chunk is missing")
    return value


def compression(dataset: h5py.Dataset) -> str | None:
    """The compression of a dataset: "gzip", "zstd", None.

    Raises DamageError if it is another one, which no writer of ours uses.
    """
    filters = dataset.id.get_create_plist()
    known = {h5py.h5z.FILTER_DEFLATE: "gzip", ZSTD: "zstd"}
    harmless = (h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32)
    numbers = [filters.get_filter(i)[0] for i in range(filters.get_nfilters())]
    for number in numbers:
        if number not in known and number not in harmless:
            raise DamageError(
                f"{dataset.name} is compressed by filter {number} of HDF5, and gzip and zstd are known"
            )
    return next((known[number] for number in numbers if number in known), None)


def parameter(dataset: h5py.Dataset) -> str | int | float:
    """A scalar dataset: a text or a number.

    Raises DamageError if it is neither, or cannot be read.
    """
    with as_damage_error(dataset.file.filename, str(dataset.name)):
        if dataset.shape != ():
            raise TypeError(f"its shape is {dataset.shape}: must be one text or number")
        value = dataset[()]
        if isinstance(value, bytes):
            return value.decode()
        if dataset.dtype.kind not in "biuf":
            raise TypeError(f"it holds {dataset.dtype}: must be a text or a number")
        return value.item()


def require_shape(dataset: h5py.Dataset, shape: tuple[int | None, ...], kinds: str = "iuf") -> None:
    """Raise unless a dataset has this shape (None: any length) and one of these kinds of dtype.

    Raises DamageError with both shapes.
    """
    with as_damage_error(dataset.file.filename, str(dataset.name)):
        found = dataset.shape
        fits = len(found) == len(shape) and all(
            b is None or a == b for a, b in zip(found, shape, strict=True)
        )
        if not fits or dataset.dtype.kind not in kinds:
            needed = ", ".join("any" if one is None else str(one) for one in shape)
            kind = " or ".join({"f": "floats", "i": "integers", "u": "counts"}[one] for one in kinds)
            raise TypeError(f"it holds {dataset.dtype} of shape {found}: must be {kind} of shape ({needed})")


def check_links(
    file: h5py.File, path: str, views: Mapping[str, Collection[tuple[str, str]]] | None = None
) -> None:
    """Refuse links to data in other files, before anything is read: HDF5 would follow them to any file or pipe.

    `views` are the virtual datasets that there may be, and what each shows: files ("." for this one) and datasets;
    `path` is for messages.

    Raises InputError if there are links to other files, datasets whose numbers lie in other files, or other virtual
    datasets.
    """
    allowed = views or {}

    links: list[tuple[bytes, int]] = []  # checked later: h5py loses exceptions in here
    with as_damage_error(path, "its list of contents"):
        # A file that is opened by an object of Python has no name of its own.
        _check_heaps(file.filename if os.path.exists(file.filename) else path)
        file.id.links.visit(lambda name, info: links.append((name, info.type)), info=True)
    for name, kind in links:
        try:
            wrong = _external_target(file, name, kind, allowed)
        except FAULTS:  # what cannot be opened leads nowhere; reading it raises
            continue
        if wrong is not None:
            raise InputError(
                f"{path} is refused: {text_of(name)} {wrong}; a file of ifrdem holds its own data"
            )


def _check_heaps(path: str) -> None:
    """Refuse inconsistent global heaps, in which HDF5 would loop for ever.

    https://github.com/HDFGroup/hdf5/issues/1707. The format: https://docs.hdfgroup.org/documentation/hdf5/latest/
    _f_m_t3.html, III.E: a collection has a head of 16 bytes, as has each object; object 0 is what is free.
    """
    with open(path, "rb") as file:
        beginning = file.read(HEAPS)
        for found in re.finditer(rb"GCOL\x01\0\0\0", beginning):
            file.seek(found.start() + 8)
            size = int.from_bytes(file.read(8), "little")
            heap = file.read(size - 16) if 16 <= size <= os.path.getsize(path) else b""
            at = 0
            while at + 16 <= len(heap):
                index, length = (
                    int.from_bytes(heap[at : at + 2], "little"),
                    int.from_bytes(heap[at + 8 : at + 16], "little"),
                )
                needed = 16 + (length + 7) // 8 * 8 if index else length
                if needed < 16:
                    break
                at += needed
            if not len(heap) - 16 < at <= len(heap) == size - 16:
                raise ValueError(f"the global heap at byte {found.start()} has no end")


def text_of(name: bytes | str) -> str:
    """A name in a file; h5py gives bytes where it is no UTF-8."""
    return name if isinstance(name, str) else name.decode(errors="backslashreplace")


def _external_target(
    file: h5py.File, name: bytes, kind: int, views: Mapping[str, Collection[tuple[str, str]]]
) -> str | None:
    """Description of a link to other files, or of a dataset whose numbers lie elsewhere."""
    if kind == h5py.h5l.TYPE_SOFT:  # within the file, where everything is checked
        return None
    if kind != h5py.h5l.TYPE_HARD:
        return "is a link to another file"
    if h5py.h5o.get_info(file.id, name).type != h5py.h5o.TYPE_DATASET:
        return None
    # Not `Dataset.shape`: HDF5 opens the sources of a virtual dataset for it.
    settings = h5py.h5d.open(file.id, name).get_create_plist()
    if settings.get_external_count():
        return "holds its numbers in another file"
    if settings.get_layout() != h5py.h5d.VIRTUAL:
        return None
    sources = views.get(name.decode(errors="replace"))
    shown = {
        (settings.get_virtual_filename(i), settings.get_virtual_dsetname(i))
        for i in range(settings.get_virtual_count())
    }
    fits = sources is not None and shown.issubset(sources)
    return None if fits else "is a virtual dataset of another place"


def _selected_indices(dataset: h5py.Dataset, selection: Any) -> list[range]:
    """Selected indices along each axis."""
    parts = selection if isinstance(selection, tuple) else (selection,)
    chosen = []
    for axis, length in enumerate(dataset.shape):
        part = parts[axis] if axis < len(parts) else slice(None)
        chosen.append(range(length)[part] if isinstance(part, slice) else range(length)[part:][:1])
    return chosen


def _lacks_chunk(dataset: h5py.Dataset, chosen: list[range], value: NDArray) -> bool:
    """True if a chunk of the selected part is not in the file; only one that reads as zeros can be."""
    if dataset.chunks is None or dataset.is_virtual or 0 in map(len, chosen):
        return False
    chunks = []
    for one, chunk in zip(chosen, dataset.chunks, strict=True):
        low, high = sorted((one[0], one[-1]))
        whole = len(one) == high - low + 1 and one[0] == low
        chunks.append(
            [
                (first, slice(max(first - low, 0), first + chunk - low) if whole else slice(None))
                for first in range(low // chunk * chunk, high + 1, chunk)
            ]
        )
    block = np.reshape(value, [len(one) for one in chosen])
    for corner in itertools.product(*chunks):
        if not block[tuple(part for _, part in corner)].any():
            try:  # much quicker than to ask where it is
                dataset.id.read_direct_chunk(tuple(first for first, _ in corner))
            except (OSError, RuntimeError) as error:
                check_system(error, dataset.file.filename)
                return True
    return False
