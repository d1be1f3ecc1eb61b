"""Rows of datasets that grow together, and that count only once they are committed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from .file import TrajectoryError

# Room on the disk that HDF5 may need for a dataset's next rows beside the chunks: a node of the chunk index.
_INDEX_ROOM = 8192


class Rows:
    """Datasets with the same number of rows (first axis), and a marker that grows last: the commit.

    Rows beyond the marker do not count. A resumed run gives rows again that are committed: they are compared
    with the file bit for bit.

    Parameters
    ----------
    what : str
        What one row is, e.g. "frame".
    marker : h5py.Dataset or None
        One number a row; None where something else counts the rows.
    datasets : mapping
        Name -> dataset.
    committed : int
        Rows that count.
    at : int, optional
        Number of the row that comes next; by default the one after the committed ones.

    Attributes
    ----------
    committed, at : int
        As above, at present.
    datasets : dict
        Name -> dataset; may be added to before the first row.
    """

    def __init__(
        self,
        what: str,
        marker: h5py.Dataset | None,
        datasets: Mapping[str, h5py.Dataset],
        committed: int = 0,
        at: int | None = None,
    ) -> None:
        self.what = what
        self.marker = marker
        self.datasets = dict(datasets)
        self.committed = committed
        self.at = committed if at is None else at

    def room(self, count: int) -> int:
        """Bytes that `count` more rows take at most."""
        new = count - self.known(count)
        if new == 0:
            return 0
        room = 0
        for dataset in self._all():
            cells = [
                -(-length // chunk) * chunk
                for length, chunk in zip(dataset.shape[1:], dataset.chunks[1:], strict=True)
            ]
            per_chunk = dataset.chunks[0]
            chunks = -(-(self.committed + new) // per_chunk) - -(-self.committed // per_chunk)
            room += chunks * per_chunk * int(np.prod(cells)) * dataset.dtype.itemsize + _INDEX_ROOM
        return room

    def known(self, count: int) -> int:
        """How many of the next `count` rows the file has."""
        return min(count, self.committed - self.at)

    def add(self, rows: Mapping[str, NDArray[Any]]) -> None:
        """Compare the rows that the file has, and append the others without committing them.

        Parameters
        ----------
        rows : mapping
            Name of each dataset -> values, shape (count, ...), in the dataset's type.

        Raises
        ------
        TrajectoryError
            If a row differs from what is committed.
        """
        known = self.known(len(next(iter(rows.values()))))
        if known:
            for name, values in rows.items():
                self._compare(name, values[:known])
        new = {name: values[known:] for name, values in rows.items()}
        if len(next(iter(new.values()))):
            self._put(new)

    def mark(self, marks: NDArray[np.int64]) -> None:
        """Append to the marker: what was added is committed once this is flushed."""
        assert self.marker is not None
        self._append(self.marker, marks)

    def confirm(self, count: int) -> None:
        """Take note that the last `count` rows are committed."""
        self.committed += count - self.known(count)
        self.at += count

    def drop_uncommitted(self) -> None:
        """Remove what an interrupted commit left behind the last one."""
        for dataset in self._all():
            if len(dataset) > self.committed:
                dataset.resize(self.committed, axis=0)

    def _all(self) -> list[h5py.Dataset]:
        return [*([] if self.marker is None else [self.marker]), *self.datasets.values()]

    def _put(self, new: Mapping[str, NDArray[Any]]) -> None:
        for name, values in new.items():
            self._append(self.datasets[name], values)

    def _append(self, dataset: h5py.Dataset, values: NDArray[Any]) -> None:
        dataset.resize(self.committed + len(values), axis=0)
        dataset[self.committed :] = values

    def _compare(self, name: str, values: NDArray[Any]) -> None:
        dataset = self.datasets[name]
        stored = dataset[self.at : self.at + len(values)]
        values = np.ascontiguousarray(values, dtype=stored.dtype)
        different = values.reshape(-1).view(np.uint8) != stored.reshape(-1).view(np.uint8)
        if not different.any():
            return
        where = np.unravel_index(int(np.argmax(different)) // stored.dtype.itemsize, stored.shape)
        row, *place = (int(index) for index in where)
        raise TrajectoryError(
            f"{self.what} {self.at + row}, computed again, differs from the file: "
            f"{self._place(name, place)} is {values[where]}, the file holds {stored[where]}. "
            "This is not the same run: the file is kept as it is"
        )

    def _place(self, name: str, place: list[int]) -> str:
        """Names an element of a row."""
        return f"{name}[{', '.join(map(str, place))}]" if place else name
