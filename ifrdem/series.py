"""Whole-gas quantities of a trajectory over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import h5py
import numpy as np
from numpy.typing import NDArray

from . import damage
from .errors import nearest
from .frame import NameMissing


class Series(Mapping[str, NDArray]):
    """Quantities by name: arrays over a time of their own, shape (rows, ...), read when asked for.

    A quantity with named columns gives one of them too: `series["dissipated_by_mechanism/sliding"]`.

    Attributes
    ----------
    time : array (rows,)
        Times of the rows [time].
    """

    def __init__(self, group: h5py.Group | None, time: NDArray[np.float64], kind: str, path: str) -> None:
        self._group = group
        self._kind = kind
        self._path = path
        self.time = time

    def __getitem__(self, name: str) -> NDArray:
        whole, _, column = str(name).partition("/")
        names = list(self)
        if self._group is None or whole not in names:
            raise NameMissing(
                f"{self._path} holds no {self._kind} {whole!r}: "
                f"there are {', '.join(names) or 'none'}{nearest(whole, names)}"
            )
        value = damage.read(self._group[whole]["value"], slice(0, len(self.time)))
        if not column:
            return value
        columns = self.columns(whole)
        if column not in columns:
            raise NameMissing(
                f"{self._path}: {self._kind} {whole!r} has no column {column!r}: "
                f"there are {', '.join(columns) or 'none'}{nearest(column, columns)}"
            )
        return value[:, columns.index(column)]

    def __iter__(self) -> Iterator[str]:
        if self._group is not None:
            yield from (name for name in self._group if isinstance(self._group[name], h5py.Group))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def columns(self, name: str) -> tuple[str, ...]:
        """Names of the columns of a quantity; empty if it has none."""
        if self._group is None or name not in self:
            self[name]  # says what is missing
        assert self._group is not None
        return tuple(
            one.decode() if isinstance(one, bytes) else str(one)
            for one in self._group[name].attrs.get("columns", ())
        )

    def __contains__(self, name: object) -> bool:
        return any(each == name for each in self)

    def __repr__(self) -> str:
        return f"<{self._kind} of {len(self.time)} rows: {', '.join(self) or 'none'}>"
