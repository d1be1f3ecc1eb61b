"""The frames of a trajectory file: whole chunks of disks are handed to HDF5, compressed beforehand if they are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from .deflate import Deflate
from .rows import Rows


class FrameRows(Rows):
    """Rows that are frames: the fields, in chunks of one frame and many disks, beside short datasets.

    Parameters
    ----------
    fields : mapping
        Name -> dataset of each per-disk field, shape (frames, n, ...).
    deflate : Deflate or None
        What compresses the fields, if they are compressed.

    Others are those of `Rows`.
    """

    def __init__(
        self,
        marker: h5py.Dataset,
        datasets: Mapping[str, h5py.Dataset],
        fields: Mapping[str, h5py.Dataset],
        deflate: Deflate | None,
        committed: int = 0,
        at: int | None = None,
    ) -> None:
        super().__init__("frame", marker, {**datasets, **fields}, committed, at)
        self.fields = dict(fields)
        self._deflate = deflate

    def _put(self, new: Mapping[str, NDArray[Any]]) -> None:
        if self._deflate is not None and not self._deflate.available:  # HDF5's filters do it
            super()._put(new)
            return
        # One after the other, so that the memory of a chunk is that of the last; compressed, all at once.
        stored = self._cut(new)
        if self._deflate is not None:
            cut = list(stored)
            packed = self._deflate.compress([chunk for _, _, chunk in cut])
            stored = ((dataset, place, data) for (dataset, place, _), data in zip(cut, packed, strict=True))
        super()._put({name: values for name, values in new.items() if name not in self.fields})
        for dataset in self.fields.values():
            dataset.resize(self.committed + 1, axis=0)
        for dataset, place, data in stored:
            self._store(dataset, place, data)

    def _cut(self, new: Mapping[str, NDArray[Any]]) -> Iterator[tuple[h5py.Dataset, tuple[int, ...], Any]]:
        """Dataset, place and values of each chunk of the next frame."""
        for name, dataset in self.fields.items():
            for offset, chunk in _chunks(dataset, new[name][0]):
                yield dataset, (self.committed, offset, *(0,) * (chunk.ndim - 1)), chunk

    def _store(self, dataset: h5py.Dataset, place: tuple[int, ...], chunk: object) -> None:
        """Write the bytes of one chunk, past HDF5's filters and its cache."""
        dataset.id.write_direct_chunk(place, chunk)

    def _place(self, name: str, place: list[int]) -> str:
        if name not in self.fields:
            return super()._place(name, place)
        component = f", component {'xy'[place[1]]}," if len(place) > 1 else ""
        return f"{name} of disk {place[0]}{component}"


def _chunks(dataset: h5py.Dataset, values: NDArray[Any]) -> Iterable[tuple[int, NDArray[Any]]]:
    """Cut one frame of a field, shape (n, ...), into whole chunks; the last is filled up with zeros."""
    size = dataset.chunks[1]
    for offset in range(0, len(values), size):
        chunk = values[offset : offset + size]
        if len(chunk) < size:
            chunk = np.concatenate([chunk, np.zeros((size - len(chunk), *chunk.shape[1:]), chunk.dtype)])
        yield offset, np.ascontiguousarray(chunk)
