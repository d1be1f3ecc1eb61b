"""Views of a trajectory for other programs: small files in its folder that refer to its data without a copy.

NAME.vtkhdf is a temporal PolyData of VTK's HDF format (version 2.0, "VTKHDF File Format" on docs.vtk.org), for
ParaView, PyVista and vtkHDFReader: points with z = 0, a vertex cell each, and as point data the stored fields (vectors
with z = 0), radius, mass, material, species and id. NAME.nc follows the AMBER convention
(ambermd.org/netcdf/nctraj.xhtml) in NetCDF-4, for OVITO, xarray and ASE: coordinates, velocities, and the other fields
by their names. Its cell has the length 0 where the box is not periodic, which is how ASE and OVITO write that; z is as
long as the longest side, because OVITO finds no neighbours in a cell without a volume, and 0 too where no side is
periodic. All disks have the atomic number 0, ASE's "X".

The data are virtual datasets of HDF5 that name NAME.h5, or its parts, from the folder that they are in: move the files
together. A view shows the
frames that were committed when it was made. Where HDF5 cannot reach NAME.h5 (moved away, or locked by a run that still
writes it), floats read as nan and counts as -2147483648. VTK's format has no box.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike

from ..errors import InputError
from ..mpi import distribution
from ..quantities import FIELDS
from ..tools import files
from ..tools.files import NO_VALUES, VIEWS, check_apart, check_files
from . import layout as layouts
from .descriptions import CONSTANTS, REDUCED, unit_of
from .file import check_views, new_file
from .parts import SEE, as_source, nothing
from .reader import Trajectory, check_file

CONSTANT = ("radius", "mass", "material", "species")  # constant properties that tools are shown
REDUCED_UNITS = dict.fromkeys(("length", "mass", "time", "velocity", "angular_velocity", "angle"), REDUCED)
TOPOLOGIES = ("Vertices", "Lines", "Strips", "Polygons")
# Axes of an AMBER file that have no values of their own, and their names in netCDF-4's own notation.
ZEROS = "zeros"  # the group of what fills z


def paths(trajectory: str | os.PathLike[str]) -> tuple[Path, Path]:
    """Paths of the views of a trajectory: NAME.vtkhdf and NAME.nc."""
    whole = Path(trajectory)
    name = whole.name.removesuffix(".h5")
    vtkhdf, nc = (whole.with_name(name + ending) for ending in VIEWS)
    return vtkhdf, nc


def stale(trajectory: str | os.PathLike[str]) -> list[Path]:
    """Paths of views that are missing, or older than the trajectory."""
    written = os.stat(trajectory).st_mtime_ns
    return [each for each in paths(trajectory) if not each.exists() or each.stat().st_mtime_ns < written]


def write_views(path: str | os.PathLike[str]) -> tuple[Path, Path]:
    """Write the views of a trajectory into its folder, replacing existing ones; return their paths.

    Raises InputError if the trajectory cannot be read, or has nothing to show (no frames, no disks, no positions), or a
    view cannot be written: where a folder, a device, the trajectory itself or a file that is no view is. Each view
    appears whole or not at all.
    """
    check_file(Path(path))
    made = paths(path)
    for view_path in made:
        check_apart(view_path, Path(path))
    check_files(made, force=True, elsewhere="views are written into the folder of the trajectory")
    check_views(made)
    with Trajectory(path) as trajectory:
        n, positions = trajectory.n, "position" in trajectory.fields
        needs = {"frames": len(trajectory), "disks": n, "positions": positions}
        if missing := [name for name, present in needs.items() if not present]:
            raise InputError(f"{path}: a view requires {missing[0]}, and there are none")
        if (parts := trajectory.parts) is not None:
            for number in trajectory.missing:
                if (part := parts.path_of(path, number)).exists() and not part.is_file():
                    # Programs that open the view would wait for a pipe.
                    raise InputError(f"{path}: its {parts.described(number)} is not a file{SEE}")
        for view_path, fill in zip(made, (_fill_vtkhdf, _fill_netcdf), strict=True):
            _write(view_path, trajectory, fill)
    return made


def _write(view_path: Path, trajectory: Trajectory, fill: Callable[[h5py.File, Trajectory], None]) -> None:
    try:
        # netCDF-4 wants the order of creation to be kept.
        with files.replacing(view_path) as new, new_file(new, track_order=True) as file:
            fill(file, trajectory)
    except (OSError, RuntimeError) as error:
        raise InputError(f"view {view_path} cannot be written: {files.cause(error)}") from error


def _view(
    group: h5py.Group, name: str, trajectory: Trajectory, source: str, shape: tuple[int, ...]
) -> h5py.Dataset:
    """A virtual dataset of a field or a constant, in another shape of as many numbers; vectors get z = 0."""
    frames, n, dtype, field = len(trajectory), trajectory.n, trajectory.dtype(source), source not in CONSTANT
    tail = trajectory.shape(source)[2:] if field else ()
    dataset = f"/{layouts.PARTICLES}/{source}" + (f"/{FIELDS[source].dataset}" if field else "")
    layout = h5py.VirtualLayout(shape=shape, dtype=dtype)
    vector = tail == (2,)
    for data_file, disks in _data_files(trajectory):
        count = disks.stop - disks.start
        held = (frames, count, *tail) if field else (count,)
        origin = h5py.VirtualSource(as_source(data_file), dataset, shape=held, dtype=dtype)
        rows: tuple[Any, ...] = (slice(None), disks) if field else (disks,)
        if count == n:
            rows = (Ellipsis,)
        elif field and shape[0] == frames * n:  # frame after frame
            rows = (h5py.MultiBlockSlice(start=disks.start, count=frames, stride=n, block=count),)
        layout[(*rows, slice(0, 2)) if vector else rows] = origin[:frames] if field else origin
    if vector:
        # Numbers of z that were never written take no room and read as 0.
        zeros = group.file.require_dataset(f"{ZEROS}/{dtype.str[1:]}", shape[:-1], dtype)
        layout[..., 2] = h5py.VirtualSource(".", zeros.name, shape=zeros.shape, dtype=zeros.dtype)
    return group.create_virtual_dataset(name, layout, fillvalue=nothing(dtype))


def _data_files(trajectory: Trajectory) -> Iterator[tuple[str, slice]]:
    """Files that hold the data, and the ids of the disks in each."""
    if trajectory.parts is None:
        yield trajectory.path.name, slice(0, trajectory.n)
        return
    for number in range(len(trajectory.parts)):
        yield trajectory.parts.name(number), trajectory.parts.disks(number)


def _number(group: h5py.Group, name: str, count: int, dtype: DTypeLike = np.int64) -> None:
    """Write the ids 0, 1, ..., block by block: all of them may exceed the memory."""
    whole = group.create_dataset(name, (count,), dtype)
    for each in distribution.blocks(range(count)):
        whole[each.start : each.stop] = np.arange(each.start, each.stop)


def _fill_vtkhdf(file: h5py.File, trajectory: Trajectory) -> None:
    frames, n = len(trajectory), trajectory.n
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array((2, 0), dtype=np.int64)
    root.attrs.create("Type", np.bytes_("PolyData"))  # a text of fixed length
    _view(root, "Points", trajectory, "position", (frames * n, 3))
    root["NumberOfPoints"] = np.full(frames, n, dtype=np.int64)
    for name in TOPOLOGIES:
        cells = n if name == "Vertices" else 0
        group = root.create_group(name)
        # One set of cells, to which all frames point.
        group["NumberOfCells"] = np.full(frames, cells, dtype=np.int64)
        group["NumberOfConnectivityIds"] = np.full(frames, cells, dtype=np.int64)
        _number(group, "Connectivity", cells)
        _number(group, "Offsets", cells + 1)
    data = root.create_group("PointData")
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = np.int64(frames)
    steps["Values"] = trajectory.times
    steps["PartOffsets"] = np.arange(frames, dtype=np.int64)
    steps["NumberOfParts"] = np.ones(frames, dtype=np.int64)
    steps["PointOffsets"] = np.arange(frames, dtype=np.int64) * n
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps[name] = np.zeros((frames, len(TOPOLOGIES)), dtype=np.int64)
    offsets = steps.create_group("PointDataOffsets")
    for name in trajectory.fields:
        if name == "position":
            continue
        tail = trajectory.shape(name)[2:]
        _view(data, name, trajectory, name, (frames * n, *((3,) if tail == (2,) else tail)))
        offsets[name] = np.arange(frames, dtype=np.int64) * n
    for name in CONSTANT:
        _view(data, name, trajectory, name, (n,))
        offsets[name] = np.zeros(frames, dtype=np.int64)
    _number(data, "id", n, np.int32 if n <= 2**31 else np.int64)
    offsets["id"] = np.zeros(frames, dtype=np.int64)


LONG_NAMES = {
    "time": "time of each frame", "collisions_per_disk": "collisions per disk so far, mean over all disks",
    "cell_lengths": "lengths of the edges of the periodic cell", "cell_angles": "angles between these edges",
    "coordinates": "positions of the centres, in the box; z is 0", "velocities": "velocities; z is 0",
    "angle": "angle turned since the start, counter-clockwise",
    "angular_velocity": "angular velocity, counter-clockwise", "asleep": "1 for disks that sleep",
    "collisions": "collisions of each disk so far", "image": "box lengths travelled through periodic sides; z is 0",
    "last_partner": "partner of the latest collision; -1 none yet, -2 - w wall w",
    "Z": "0: disks are no chemical elements", "radius": "radius", "mass": "mass",
    "material": "number of the material", "species": "number of the species",
    "spatial": "axes of vectors", "cell_spatial": "edges of the periodic cell",
}  # fmt: skip
"""What each variable of a NetCDF file holds."""


def _fill_netcdf(file: h5py.File, trajectory: Trajectory) -> None:
    frames, n = len(trajectory), trajectory.n
    for name, value in (
        ("Conventions", "AMBER"),
        ("ConventionVersion", "1.0"),
        ("program", "ifrdem"),
        ("programVersion", str(trajectory.parameters.get("versions/ifrdem", "unknown"))),
        ("title", str(trajectory.parameters.get("name", trajectory.path.stem))),
    ):
        file.attrs.create(name, np.bytes_(value.encode()))
    axes: dict[str, h5py.Dataset] = {}
    for number, (name, length) in enumerate(
        (("frame", frames), ("spatial", 3), ("atom", n), ("cell_spatial", 3), ("cell_angular", 3))
    ):
        if name in ("spatial", "cell_spatial"):
            labels = list("xyz" if name == "spatial" else "abc")
            axes[name] = file.create_dataset(name, data=np.array(labels, dtype="S1"))
            axes[name].make_scale(name)
            axes[name].attrs.create("long_name", np.bytes_(LONG_NAMES[name].encode()))
        else:
            axes[name] = file.create_dataset(name, shape=(length,), dtype=">f4")
            axes[name].make_scale(f"{NO_VALUES}{length:10d}")
        axes[name].attrs["_Netcdf4Dimid"] = np.int32(number)

    def attach(variable: h5py.Dataset, *names: str, unit: str | None = None) -> None:
        for axis, name in zip(variable.dims, names, strict=True):
            axis.attach_scale(axes[name])
        text = LONG_NAMES.get(variable.name[1:])
        for key, value in (("units", unit), ("long_name", text)):
            if value is not None:
                variable.attrs.create(key, np.bytes_(value.encode()))

    units = trajectory.units or ({} if trajectory.stated_units is None else REDUCED_UNITS)
    attach(file.create_dataset("time", data=trajectory.times), "frame", unit=units.get("time"))
    if "collisions" in trajectory.observables:
        per_disk = 2.0 * trajectory.observables["collisions"] / n
        attach(file.create_dataset("collisions_per_disk", data=per_disk), "frame", unit="1")
    lengths, angles = np.zeros((frames, 3)), np.full((frames, 3), 90.0)
    box = trajectory.box
    if any(box.periodic):
        sides = np.stack([box.cell(time) for time in trajectory.times.tolist()])
        lengths[:] = np.where((*box.periodic, True), np.linalg.norm(sides, axis=2), 0.0)
        lengths[:, 2] = max(box.lengths)
        angles[:, 2] = np.degrees(np.arctan2(sides[:, 1, 1], sides[:, 1, 0]))  # a lies along x
    cell = file.create_dataset("cell_lengths", data=lengths)
    attach(cell, "frame", "cell_spatial", unit=units.get("length"))
    attach(file.create_dataset("cell_angles", data=angles), "frame", "cell_angular", unit="degree")
    names = {"position": "coordinates", "velocity": "velocities"}
    for name in trajectory.fields:
        if name == "dissipated":  # six numbers a disk, for which the convention has no axis
            continue
        tail = (3,) if len(trajectory.shape(name)) == 3 else ()
        view = _view(file, names.get(name, name), trajectory, name, (frames, n, *tail))
        unit = unit_of(FIELDS[name].dimension, units)
        attach(view, "frame", "atom", *(("spatial",) if tail else ()), unit=unit)
    for zeros in file[ZEROS].values():
        attach(zeros, "frame", "atom")
    attach(file.create_dataset("Z", shape=(n,), dtype=np.int32), "atom", unit="1")
    for name in CONSTANT:
        # ASE takes `atom_types` for numbers of chemical elements, so materials keep their own name.
        view = _view(file, name, trajectory, name, (n,))
        attach(view, "atom", unit=unit_of(CONSTANTS[name].dimension, units))
