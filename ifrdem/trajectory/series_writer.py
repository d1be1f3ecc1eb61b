"""Writes time series of whole-gas quantities into a trajectory file, each row committed by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from . import layout, staged_group
from .file import OutputFile
from .quantities import checked, is_number
from .rows import Rows


class SeriesWriter:
    """The group `timeseries` of a file that is being written; it appears with the first row.

    Parameters
    ----------
    output : OutputFile
        The file.
    at : int
        Rows that the run has written; there may be more in the file, which are compared then.

    Raises
    ------
    InputError
        If the file holds fewer rows.
    """

    def __init__(self, output: OutputFile, at: int = 0) -> None:
        self._output = output
        self._rows: Rows | None = None
        self._columns: dict[str, tuple[str, ...]] = {}
        self._last_time = -np.inf
        file = output.file
        rows = len(file[f"{layout.TIMESERIES}/step"]) if layout.TIMESERIES in file else 0
        if at > rows:
            raise InputError(
                f"{output.path} holds {rows} rows of series, the checkpoint had seen {at}: it is another file's"
            )
        if rows == 0:
            return
        group = file[layout.TIMESERIES]
        names = [name for name in group if name not in ("step", "time")]
        datasets = {name: group[f"{name}/value"] for name in names}
        self._rows = Rows("row of the series", group["step"], {"time": group["time"], **datasets}, rows, at)
        self._columns = {
            name: tuple(str(one) for one in group[name].attrs["columns"])
            for name in names
            if "columns" in group[name].attrs
        }
        self._last_time = float(group["time"][at - 1]) if at else -np.inf

    def __len__(self) -> int:
        """Number of committed rows."""
        return 0 if self._rows is None else self._rows.committed

    @property
    def at(self) -> int:
        """Rows that the run has written: less than the committed ones while it repeats them."""
        return 0 if self._rows is None else self._rows.at

    def write(
        self,
        given: Sequence[tuple[float, Mapping[str, ArrayLike]]],
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Append rows and commit them together; see `TrajectoryWriter.write_series_rows`."""
        checked_rows: list[dict[str, NDArray[Any]]] = []
        before = self._last_time
        for time, values in given:
            checked_rows.append(self._checked(time, values, columns, before, checked_rows))
            before = float(time)
        if not checked_rows:
            return
        if self._rows is None:
            self._rows = self._create(checked_rows[0])
        rows, count = self._rows, len(checked_rows)
        self._output.reserve(rows.room(count))
        new = count - rows.known(count)
        stacked = {name: np.stack([row[name] for row in checked_rows]) for name in checked_rows[0]}
        rows.add({"time": np.array([float(time) for time, _ in given]), **stacked})
        if new:
            self._output.flush()
            rows.mark(np.arange(rows.committed, rows.committed + new))
            self._output.flush()
        rows.confirm(count)
        self._last_time = before

    def drop_uncommitted(self) -> None:
        """Remove what an interrupted write left behind the last commit."""
        file = self._output.file
        staged_group.drop(file, layout.TIMESERIES)
        if self._rows is not None and self._rows.committed:
            self._rows.drop_uncommitted()
        elif layout.TIMESERIES in file:
            del file[layout.TIMESERIES]
            self._rows = None

    def _create(self, row: Mapping[str, NDArray[Any]]) -> Rows:
        file = self._output.file
        if layout.TIMESERIES in file:  # an interrupt ended the first attempt
            del file[layout.TIMESERIES]
        layout.create_timeseries(file, row, self._columns)
        group = file[layout.TIMESERIES]
        datasets = {name: group[f"{name}/value"] for name in row}
        return Rows("row of the series", group["step"], {"time": group["time"], **datasets})

    def _checked(
        self,
        time: float,
        values: Mapping[str, ArrayLike],
        columns: Mapping[str, Sequence[str]] | None,
        before: float,
        rows: Sequence[Mapping[str, NDArray[Any]]],
    ) -> dict[str, NDArray[Any]]:
        """A row that comes after time `before`, and after `rows` that are not in the file yet."""
        first: dict[str, Any] | None = (
            {name: value[None] for name, value in rows[0].items()} if rows else None
        )
        if self._rows is not None:
            first = {name: dataset for name, dataset in self._rows.datasets.items() if name != "time"}
        if not isinstance(values, Mapping):
            raise InputError(f"series: numbers by name are needed, not {values!r}")
        for name in ("step", "time"):
            if name in values:
                raise InputError(f"name of series = {name!r}: the file has it already for all of them")
        row = checked("series", "row", values, first)
        if not row:
            raise InputError("series: a row without any quantity cannot be written")
        if not (is_number(time) and np.isfinite(time) and time >= before):
            raise InputError(f"time = {time}: a finite time not before {before} is needed")
        named = {name: tuple(names) for name, names in (columns or {}).items()}
        for name, names in named.items():
            if name not in row or row[name].shape != (len(names),):
                shape = row[name].shape if name in row else "no value"
                raise InputError(f"columns of series {name} = {list(names)}: the series has {shape}")
        if first is None:
            self._columns = named
        elif columns is not None and named != self._columns:
            raise InputError(f"columns = {named}: the first row has {self._columns}")
        return row
