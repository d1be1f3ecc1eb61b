"""Reading from HDF5 files of which parts may be damaged."""

from __future__ import annotations

from typing import Any

import h5py
from numpy.typing import NDArray

from .errors import InputError


class DamageError(InputError):
    """A part of a trajectory file that cannot be read."""


def read(dataset: h5py.Dataset, selection: Any = ()) -> NDArray:
    """What `dataset[selection]` gives.

    HDF5 notices damage in compressed data (deflate has a checksum) and in its own bookkeeping; changed numbers in
    uncompressed data look like other numbers.

    Raises
    ------
    DamageError
        If HDF5 cannot read it; the message names the file and the dataset.
    """
    try:
        return dataset[selection]
    except (OSError, RuntimeError) as error:
        raise DamageError(
            f"{dataset.file.filename} is damaged: {dataset.name} cannot be read ({error}); "
            f"`ifrdem repair` keeps what is whole"
        ) from error
