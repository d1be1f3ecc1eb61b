"""Shuffle and deflate of chunks, as HDF5's filters make them, by ISA-L and several threads.

HDF5's own deflate takes some ten times longer and one thread. What comes out is the same format (zlib, RFC
1950, behind HDF5's byte shuffle), which every HDF5 reader undoes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..simulation import device

LEVEL = 1
MOST_THREADS = 4


def _isal() -> ModuleType | None:
    """ISA-L's zlib, or None where the extra `fast` is not installed."""
    try:
        from isal import isal_zlib
    except ImportError:
        return None
    return isal_zlib


def isal_version() -> str:
    """Version of the package isal."""
    import isal

    return str(isal.__version__)


class Deflate:
    """Compresses chunks by ISA-L.

    Parameters
    ----------
    threads : int, optional
        Threads that compress; by default as many as there are cores for this process, and at most 4.

    Attributes
    ----------
    description : str
        Who compresses, for people: "isal 1.9.1, 2 threads", or why HDF5 has to do it.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._zlib = _isal()
        if self._zlib is None:
            self.description = (
                'HDF5\'s own deflate, slowly; `pip install "ifrdem[fast]"` brings one ten times faster'
            )
            return
        threads = threads or min(MOST_THREADS, device.cores())
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="deflate")
        self.description = f"isal {isal_version()}, {threads} thread{'' if threads == 1 else 's'}"

    @property
    def available(self) -> bool:
        """Whether ISA-L is there; otherwise the file's own filter has to compress."""
        return self._zlib is not None

    def compress(self, chunks: Sequence[NDArray[Any]]) -> Iterator[bytes]:
        """The stored bytes of each chunk, in order."""
        return self._pool.map(self._compress, chunks)

    def close(self) -> None:
        """Let the threads go."""
        if self.available:
            self._pool.shutdown()

    def _compress(self, chunk: NDArray[Any]) -> bytes:
        assert self._zlib is not None
        return self._zlib.compress(shuffled(chunk), LEVEL)


def shuffled(chunk: NDArray[Any]) -> NDArray[np.uint8]:
    """The bytes of an array as HDF5's shuffle filter orders them: all first bytes, all second ones, ..."""
    size = chunk.dtype.itemsize
    return np.ascontiguousarray(np.ascontiguousarray(chunk).reshape(-1).view(np.uint8).reshape(-1, size).T)
