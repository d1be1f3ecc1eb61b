"""Trajectories as tables of pandas and data sets of xarray."""

from __future__ import annotations

import contextlib
import importlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, NameMissing, install_extra, shortened, there_are
from ..quantities import AXES, FIELDS, MECHANISMS, PISTON_SERIES, SERIES
from ..tools import checked
from . import collisions
from .descriptions import unit_of_whole_gas
from .layout import STATIC, version_of
from .rows import converted

if TYPE_CHECKING:
    import MDAnalysis
    import pandas
    import xarray

    from .reader import Series, Trajectory

PER_DISK = "collisions_per_disk"
WHICH = ("series", "observables", "frame", "collisions")
DIVIDED = ("time", "disk")
"""Axes of fields that chunks divide."""


def optional_import(package: str, extra: str) -> Any:
    """Import an optional package; InputError names the extra that installs it."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise InputError(f"{package} is not installed: {install_extra(extra)}") from None


def columns(
    name: str, value: NDArray[Any], names: tuple[str, ...] = ()
) -> Iterator[tuple[str, NDArray[Any]]]:
    """A quantity of shape (rows, ...) as columns with names: a vector's end with _x and _y."""
    if value.ndim == 1:
        yield name, value
        return
    flat = value.reshape(len(value), int(np.prod(value.shape[1:])))
    names = MECHANISMS if name == "dissipated" else names
    ends = names or (AXES["axis"] if flat.shape[1] == 2 else tuple(map(str, range(flat.shape[1]))))
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
    return found | {"species": trajectory.constants("species")}


def to_pandas(trajectory: Trajectory, which: str, index: int) -> pandas.DataFrame:
    """Implement `Trajectory.to_pandas`."""
    checked.choice("which", which, WHICH)
    pandas = optional_import("pandas", "analysis")
    if which == "frame":
        found = frame_columns(trajectory, index)
        return pandas.DataFrame(found, index=pandas.RangeIndex(trajectory.n, name="id"))
    if which == "collisions":
        return pandas.DataFrame(collisions.table(trajectory))
    series: Series = getattr(trajectory, which)
    table: dict[str, NDArray[Any]] = {}
    for name in (*series, *series.derived):
        table.update(columns(name, series[name], series.columns(name)))
    return pandas.DataFrame(table, index=pandas.Index(series.time, name="time"))


def to_xarray(trajectory: Trajectory, chunks: Mapping[str, int] | str | None = None) -> xarray.Dataset:
    """Implement `Trajectory.to_xarray`."""
    xarray = optional_import("xarray", "analysis")
    if chunks is None:
        return _dataset(xarray, trajectory)
    if isinstance(chunks, Mapping):
        for axis, number in chunks.items():
            if axis not in DIVIDED:
                raise NameMissing(
                    f"chunks: there is no axis {axis!r} of frames or disks{there_are(str(axis), DIVIDED)}"
                )
            checked.integer(f"chunks[{axis!r}]", number, 1)
    elif not (isinstance(chunks, str) and chunks == "auto"):
        raise InputError(f'chunks = {shortened(chunks)}: must be "auto", or numbers such as {{"time": 10}}')
    optional_import("dask", "study")

    class InChunks(xarray.backends.BackendEntrypoint):  # type: ignore[name-defined,misc]
        """Has xarray divide the fields, by chunks that they have in the file."""

        def open_dataset(self, filename_or_obj: Any, *, drop_variables: Any = None) -> Any:
            return _dataset(xarray, filename_or_obj)

    return xarray.open_dataset(trajectory, engine=InChunks, chunks=chunks)


def _dataset(xarray: Any, trajectory: Trajectory) -> xarray.Dataset:
    """Fields, observables and series with named axes."""
    data: dict[str, Any] = {}
    for name in trajectory.fields:
        inner = (FIELDS[name].along,) if FIELDS[name].along else ()
        dims = ("time", "disk", *inner)
        data[name] = _lazy(xarray, trajectory, name, dims)
    for name in STATIC:
        data[name] = ("disk", getattr(trajectory.disks, name))
    data["disk_species"] = ("disk", trajectory.constants("species"))  # `species` is an axis of series
    coordinates: dict[str, Any] = {
        "time": trajectory.times, "disk": np.arange(trajectory.n), "axis": list(AXES["axis"]),
        **({"mechanism": list(MECHANISMS)} if "dissipated" in trajectory.fields else {}),
    }  # fmt: skip
    for series, time, prefix in (
        (trajectory.observables, "time", "observables"),
        (trajectory.series, "series_time", "series"),
    ):
        if len(series) and time == "series_time":
            coordinates[time] = series.time
        if "collisions" in series and trajectory.n:
            ends = "" if time == "time" else "series_"
            coordinates[f"{ends}{PER_DISK}"] = (time, series[PER_DISK])
        for name in (*series, *(each for each in series.derived if each != PER_DISK)):
            value = series[name]
            dims = (time, *_axes(name, value, series.columns(name), coordinates))
            data[f"{prefix}_{name}"] = (dims, value)
    attributes = {key: value for key, value in trajectory.parameters.items() if key != "case"}
    found = xarray.Dataset(data, coords=coordinates, attrs=attributes)
    for name, variable in found.variables.items():
        own = str(name).removeprefix("observables_").removeprefix("series_")
        if unit := unit_of_whole_gas(own, trajectory.units):
            variable.attrs["units"] = unit
    return found


def whole_gas(trajectory: Trajectory) -> dict[str, NDArray[np.float64]]:
    """Quantities of the whole gas, shape (rows, ...), at its rows of series or, without those, its frames.

    Among them `time`, and those that are derived (`Series`): `collisions_per_disk`, `collision_rate` and `theta`.

    Raises InputError if the file does not count collisions.
    """
    source = trajectory.series if "collisions" in trajectory.series else trajectory.observables
    if "collisions" not in source or not len(source.time):
        text = "holds no collisions of the whole gas, by which it could be joined"
        raise InputError(f"{trajectory.path}: {text}")
    found = {name: source[name].astype(np.float64) for name in (*source, *source.derived)}
    return {"time": source.time, **found}


def at_equal_collisions(trajectories: Sequence[Trajectory]) -> dict[str, NDArray[np.float64]]:
    """Common quantities with equal columns, shape (trajectories, rows, ...), at the same collisions per disk.

    The rows are those of the first trajectory, as far as all go; the others are interpolated linearly between theirs.
    """
    each = [whole_gas(one) for one in trajectories]
    last = min(one[PER_DISK][-1] for one in each)
    first = max(one[PER_DISK][0] for one in each)
    axis = each[0][PER_DISK]
    axis = np.unique(axis[(axis >= first) & (axis <= last)])

    def at(one: dict[str, NDArray[np.float64]], name: str) -> NDArray[np.float64]:
        values = one[name].reshape(len(one[name]), -1)
        columns = [np.interp(axis, one[PER_DISK], column) for column in values.T]
        return np.stack(columns, axis=1).reshape(len(axis), *one[name].shape[1:])

    def is_common(name: str) -> bool:
        return all(name in one and one[name].shape[1:] == each[0][name].shape[1:] for one in each)

    names = [name for name in each[0] if name != PER_DISK and is_common(name)]
    return {PER_DISK: axis, **{name: np.stack([at(one, name) for one in each]) for name in names}}


_OfFiles = Annotated[Any, checked.Each(None, "list of trajectories or files")]


@checked.validated
def concat(trajectories: _OfFiles) -> xarray.Dataset:
    """Join the whole-gas quantities of trajectories at equal collisions per disk, along a new dimension `run`.

    Rows of series, or frames where there are none, stand at those of the first trajectory, as far as all go; between
    the rows of the others they are interpolated linearly. Gases that cool at different rates are comparable so.

    Raises InputError if there is none, one has no whole-gas quantities, or xarray is not installed (extra `analysis`).

    Parameters
    ----------
    trajectories : iterable of Trajectory or path

    Returns
    -------
    xarray.Dataset
        Dimensions `run` and `collisions_per_disk`; `run` has the names of the files.

    Examples
    --------
    >>> import ifrdem
    >>> disks, box = ifrdem.Disks(2, mass=1.0, radius=0.5), ifrdem.Box((10.0, 10.0))
    >>> for name, T in (("a", 1.0), ("b", 3.0)):
    ...     with ifrdem.TrajectoryWriter(f"{name}.h5", disks, box) as file:
    ...         for i in range(3):
    ...             state = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0], time=float(i))
    ...             file.write(state, {"temperature": T / (1 + i), "collisions": i})
    ...
    >>> both = ifrdem.concat(["a.h5", "b.h5"])
    >>> both.temperature.mean("run").values
    array([2.        , 1.        , 0.66666667])
    """
    from .reader import Trajectory

    xarray = optional_import("xarray", "analysis")
    with contextlib.ExitStack() as stack:
        opened = [
            one
            if isinstance(one, Trajectory)
            else stack.enter_context(Trajectory(checked.path("trajectories", one)))
            for one in trajectories
        ]
        if not opened:
            raise InputError("trajectories: must be one or more")
        found = at_equal_collisions(opened)
        units = opened[0].units
        names = [one.path.stem for one in opened]
    coordinates = {"run": names, PER_DISK: found.pop(PER_DISK)}
    data = {}
    for name, value in found.items():
        dims = ("run", PER_DISK, *(f"{name}_{axis}" for axis in range(1, value.ndim - 1)))
        unit = unit_of_whole_gas(name, units)
        data[name] = (dims, value, {"units": unit} if unit else {})
    return xarray.Dataset(data, coordinates)


def _axes(
    name: str, value: NDArray[Any], names: tuple[str, ...], coordinates: dict[str, Any]
) -> tuple[str, ...]:
    """Names of the axes after the first."""
    if name in PISTON_SERIES:
        coordinates.update({"piston": list(names)} if names else {})
        return ("piston",)
    if value.ndim == 2 and names:
        # Files of other programs have quantities of their own; `species_theta` is derived, not stored.
        dimension = SERIES[name].along if name in SERIES else name.removesuffix("_theta")
        coordinates[dimension] = list(names)
        return (dimension,)
    if value.shape[1:] == (2,):
        return ("axis",)
    return tuple(f"{name}_{axis}" for axis in range(1, value.ndim))


def _lazy(xarray: Any, trajectory: Trajectory, name: str, dims: tuple[str, ...]) -> Any:
    """A stored field that xarray reads when it needs it, and its chunks in the file."""
    found = xarray.Variable(dims, xarray.core.indexing.LazilyIndexedArray(_stored(trajectory, name)))
    found.encoding["preferred_chunks"] = dict(zip(dims, trajectory.chunks(name), strict=True))
    return found


def _stored(trajectory: Trajectory, name: str) -> Any:
    """A stored field as xarray reads it; in another process from the file that is opened there."""
    from xarray.backends import BackendArray
    from xarray.core import indexing

    class Stored(BackendArray):
        def __init__(self) -> None:
            self.shape = trajectory.shape(name)
            self.dtype = trajectory.dtype(name)

        def __reduce__(self) -> Any:
            return _stored, (trajectory, name)

        def __getitem__(self, key: Any) -> Any:
            return indexing.explicit_indexing_adapter(
                key, self.shape, indexing.IndexingSupport.BASIC, lambda parts: trajectory.read(name, parts)
            )

    return Stored()


def universe(trajectory: Trajectory) -> MDAnalysis.Universe:
    """Implement `Trajectory.universe`."""
    from .export import kinds

    mda: Any = optional_import("MDAnalysis", "readers")
    trajectory.dataset("position")  # raises if it, or a part of it, is missing
    disks = trajectory.disks
    for name in {"position", "velocity"} & {*trajectory.fields} if len(trajectory) else ():
        converted(
            name, trajectory[0][name], np.float32, "MDAnalysis computes in it: export to xarray instead"
        )
    names, number = kinds(trajectory) or (None, disks.material)
    types = number.astype(str) if names is None else np.array(names, dtype=object)[number]
    made = mda.Universe.empty(disks.n, trajectory=True, velocities="velocity" in trajectory.fields)
    for name, values in (
        ("masses", disks.mass),
        ("radii", disks.radius),
        ("types", types),
    ):
        made.add_TopologyAttr(name, values)
    # MDAnalysis has a time step besides the times of frames: 1 if none is given, with a warning where it is used.
    steps = np.diff(trajectory.times)
    even = len(steps) > 0 and float(np.ptp(steps)) <= 1e-9 * float(trajectory.times[-1] - trajectory.times[0])
    given = {"dt": float(steps.mean())} if even and steps[0] > 0.0 else {}
    made.load_new(str(trajectory.path), format="H5MD", convert_units=False, **given)
    box, version = trajectory.box, version_of(trajectory.file)
    if version < (1, 4):
        text = (
            f"{trajectory.path} has layout {version[0]}.{version[1]}: MDAnalysis takes its walls, open sides and z = 1 "
            "as periodic; `ifrdem export FILE --to h5 -o NEW.h5` writes it in the present layout"
        )
        warnings.warn(text, UserWarning, stacklevel=3)
    elif box.periodic[0] != box.periodic[1]:
        axis = box.periodic.index(False)
        text = (
            f"{trajectory.path}: walls along {AXES['axis'][axis]}: MDAnalysis takes all sides as periodic, so its box "
            f"has {2.0 * box.lengths[axis]:.6g} there, twice the side, which no minimum image crosses; densities that "
            "use its volume are too low"
        )
        warnings.warn(text, UserWarning, stacklevel=3)
    return made
