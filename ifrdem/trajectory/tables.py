"""Trajectories as tables of pandas and data sets of xarray."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..tools import checked
from .layout import STATIC

if TYPE_CHECKING:
    import pandas
    import xarray

    from .reader import Trajectory
    from .series import Series

AXES = ("x", "y")
WHICH = ("series", "observables", "frame")


def needed(package: str, extra: str) -> Any:
    """Import an optional package; InputError names the extra that installs it."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise InputError(f'{package} is not installed: pip install "ifrdem[{extra}]"') from None


def columns(
    name: str, value: NDArray[Any], names: tuple[str, ...] = ()
) -> Iterator[tuple[str, NDArray[Any]]]:
    """A quantity of shape (rows, ...) as columns with names: a vector's end with _x and _y."""
    if value.ndim == 1:
        yield name, value
        return
    flat = value.reshape(len(value), int(np.prod(value.shape[1:])))
    ends = names or (AXES if flat.shape[1] == 2 else tuple(map(str, range(flat.shape[1]))))
    for end, column in zip(ends, flat.T, strict=True):
        yield f"{name}_{end}", column


def frame_columns(trajectory: Trajectory, index: int) -> dict[str, NDArray[Any]]:
    """The disks of a frame: stored fields, then the constant properties, as columns (n,)."""
    frame, disks = trajectory[index], trajectory.disks
    found: dict[str, NDArray[Any]] = {}
    for name in trajectory.fields:
        found.update(columns(name, frame[name]))
    for name in STATIC:
        found[name] = getattr(disks, name)
    return found


def to_pandas(trajectory: Trajectory, which: str, index: int) -> pandas.DataFrame:
    """As `Trajectory.to_pandas`."""
    checked.one_of("which", which, WHICH)
    pandas = needed("pandas", "analysis")
    if which == "frame":
        found = frame_columns(trajectory, index)
        return pandas.DataFrame(found, index=pandas.RangeIndex(trajectory.disks.n, name="id"))
    series: Series = getattr(trajectory, which)
    table: dict[str, NDArray[Any]] = {}
    for name in series:
        table.update(columns(name, series[name], series.columns(name)))
    return pandas.DataFrame(table, index=pandas.Index(series.time, name="time"))


def to_xarray(trajectory: Trajectory) -> xarray.Dataset:
    """As `Trajectory.to_xarray`."""
    xarray = needed("xarray", "analysis")
    data: dict[str, Any] = {}
    for name in trajectory.fields:
        stored = trajectory.dataset(name)
        dims = ("time", "disk", "axis")[: stored.ndim]
        data[name] = (dims, _lazy(xarray, trajectory, name))
    for name in STATIC:
        data[name] = ("disk", getattr(trajectory.disks, name))
    coordinates: dict[str, Any] = {
        "time": trajectory.times, "disk": np.arange(trajectory.disks.n), "axis": list(AXES)
    }  # fmt: skip
    for series, time, prefix in (
        (trajectory.observables, "time", "observables"),
        (trajectory.series, "series_time", "series"),
    ):
        if len(series) and time == "series_time":
            coordinates[time] = series.time
        for name in series:
            value = series[name]
            dims = (time, *_axes(name, value, series.columns(name), coordinates))
            data[f"{prefix}_{name}"] = (dims, value)
    attributes = {key: value for key, value in trajectory.parameters.items() if key != "case"}
    found = xarray.Dataset(data, coords=coordinates, attrs=attributes)
    for name, variable in found.variables.items():
        if unit := trajectory.units.get(
            _QUANTITIES.get(str(name).removeprefix("observables_").removeprefix("series_"), "")
        ):
            variable.attrs["units"] = unit
    return found


_QUANTITIES = {
    "time": "time", "position": "length", "radius": "length", "mass": "mass",
    "momentum": "momentum",
    **dict.fromkeys(
        ("translational_energy", "rotational_energy", "energy", "temperature", "rotational_temperature",
         "potential_energy", "energy_input", "wall_work", "wall_heat", "dissipated_energy",
         "dissipated_by_mechanism", "ledger_residual"),
        "energy",
    ),
}  # fmt: skip
"""The units' name of each quantity that has a unit of its own."""


def _axes(
    name: str, value: NDArray[Any], names: tuple[str, ...], coordinates: dict[str, Any]
) -> tuple[str, ...]:
    """Names of the axes behind the first."""
    if value.ndim == 2 and names:
        dimension = name.removeprefix("dissipated_by_").removeprefix("collisions_by_")
        coordinates[dimension] = list(names)
        return (dimension,)
    if value.shape[1:] == (2,):
        return ("axis",)
    return tuple(f"{name}_{axis}" for axis in range(1, value.ndim))


def _lazy(xarray: Any, trajectory: Trajectory, name: str) -> Any:
    """A stored field that xarray reads when it needs it."""
    from xarray.backends import BackendArray
    from xarray.core import indexing

    stored = trajectory.dataset(name)

    class Stored(BackendArray):
        def __init__(self) -> None:
            self.shape = (len(trajectory), *stored.shape[1:])
            self.dtype = stored.dtype

        def __getitem__(self, key: Any) -> Any:
            return indexing.explicit_indexing_adapter(
                key, self.shape, indexing.IndexingSupport.BASIC, lambda parts: trajectory.read(name, parts)
            )

    return xarray.Variable(("time", "disk", "axis")[: stored.ndim], indexing.LazilyIndexedArray(Stored()))
