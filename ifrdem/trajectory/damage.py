"""Reading from HDF5 files of which parts may be damaged."""

from __future__ import annotations

import itertools
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError


class DamageError(InputError):
    """A part of a trajectory file that cannot be read."""


def read(dataset: h5py.Dataset, selection: Any = ()) -> NDArray[Any]:
    """What `dataset[selection]` gives; selections are numbers and slices.

    HDF5 notices damage in compressed data (deflate has a checksum) and in its own bookkeeping; changed numbers in
    uncompressed data look like other numbers. Where its bookkeeping has lost a chunk, it gives zeros; that is noticed
    here, because no writer of ours leaves a chunk of committed data out.

    Raises
    ------
    DamageError
        If HDF5 cannot read it; the message names the file and the dataset.
    """
    try:
        value = dataset[selection]
        missing = _lacks(dataset, selection, value)
    except (OSError, RuntimeError) as error:
        raise DamageError(_message(dataset, str(error))) from error
    if missing:
        raise DamageError(_message(dataset, "a chunk is missing"))
    return value


def _message(dataset: h5py.Dataset, reason: str) -> str:
    return (
        f"{dataset.file.filename} is damaged: {dataset.name} cannot be read ({reason}); "
        "`ifrdem repair` keeps what is whole"
    )


def _lacks(dataset: h5py.Dataset, selection: Any, value: NDArray[Any]) -> bool:
    """Whether a chunk of the selected part is not in the file; only one that reads as zeros can be."""
    if dataset.chunks is None or dataset.is_virtual or dataset.size == 0:
        return False
    parts = selection if isinstance(selection, tuple) else (selection,)
    lengths, chunks = [], []
    for axis, (length, chunk) in enumerate(zip(dataset.shape, dataset.chunks, strict=True)):
        part = parts[axis] if axis < len(parts) else slice(None)
        chosen = range(length)[part] if isinstance(part, slice) else range(length)[part:][:1]
        lengths.append(len(chosen))
        if len(chosen) == 0:
            return False
        low, high = sorted((chosen[0], chosen[-1]))
        whole = len(chosen) == high - low + 1 and chosen[0] == low
        chunks.append(
            [
                (first, slice(max(first - low, 0), first + chunk - low) if whole else slice(None))
                for first in range(low // chunk * chunk, high + 1, chunk)
            ]
        )
    block = np.reshape(value, lengths)
    for corner in itertools.product(*chunks):
        if not block[tuple(part for _, part in corner)].any():
            try:  # much quicker than to ask where it is
                dataset.id.read_direct_chunk(tuple(first for first, _ in corner))
            except (OSError, RuntimeError):
                return True
    return False
