"""Whole-gas quantities of a trajectory over time."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import NameMissing, there_are
from ..tools.sealed import Sealed
from .damage import text_of


class Series(Sealed, Mapping[str, NDArray[Any]]):
    """Quantities by name: arrays over a time of their own, shape (rows, ...), read when asked for.

    A quantity with named columns gives one of them too: `series["dissipated_by_mechanism/sliding"]`,
    `series["walls_work/wall 0 line"]`; by the name of a group of walls, their sum: `series["walls_work/paddle"]`.

    Attributes
    ----------
    time : array (rows,)
        Times of the rows [time].
    """

    time: NDArray[np.float64]

    def __init__(
        self,
        group: h5py.Group | None,
        time: NDArray[np.float64],
        kind: str,
        read: Callable[[str, int, int], NDArray[Any]],
    ) -> None:
        self._kind = kind
        self._path = "" if group is None else str(group.name)
        self._read = read
        self._columns: dict[str, tuple[str, ...]] = {}
        for name, item in () if group is None else group.items():
            if isinstance(item, h5py.Group):
                columns = item.attrs.get("columns", ())
                self._columns[text_of(name)] = tuple(
                    one.decode() if isinstance(one, bytes) else str(one) for one in columns
                )
        self._set(time=time)

    def __getitem__(self, name: str) -> NDArray[Any]:
        whole, _, column = str(name).partition("/")
        columns = self.columns(whole)
        value = self._read(f"{self._path}/{whole}/value", len(self.time), len(columns))
        if not column:
            return value
        if column not in columns:
            group = [i for i, one in enumerate(columns) if re.fullmatch(rf"{re.escape(column)} \d+ .*", one)]
            if group:  # of walls
                return np.asarray(value[:, group].sum(axis=1))
            raise NameMissing(
                f"{self._kind} {whole!r} of the file has no column {column!r}{there_are(column, columns)}"
            )
        return value[:, columns.index(column)]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def columns(self, name: str) -> tuple[str, ...]:
        """Names of the columns of a quantity; empty if it has none."""
        if name not in self._columns:
            raise NameMissing(f"the file holds no {self._kind} {name!r}{there_are(str(name), self)}")
        return self._columns[name]

    def __repr__(self) -> str:
        return f"<{self._kind} of {len(self.time)} rows: {', '.join(self) or 'none'}>"
