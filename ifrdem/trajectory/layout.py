"""The layout of a trajectory file: H5MD 1.1 with raw two-dimensional data and 3D views of it.

H5MD: P. de Buyl, P. H. Colberg and F. Hoefling, Comput. Phys. Commun. 185, 1546 (2014),
doi:10.1016/j.cpc.2014.01.018. With n disks and F frames::

    h5md                                attribute version = [1, 1]; author, creator
      modules/units                     attributes version = [1, 0], system = "SI"; absent without SI units
      modules/ifrdem                    attribute version: the version of this layout
    particles/all
      box                               attributes dimension = 3, boundary, lengths = (Lx, Ly); shear_rate if sheared
        edges/{step, time, value}       (F, 3): Lx, Ly and the placeholder 1
      position/value_2d                 (F, n, 2): the stored data
      position/{step, time, value}      (F, n, 3): a virtual dataset of value_2d with z = 0
      velocity/...                      as position
      angle/{step, time, value}       (F, n), counter-clockwise since the start, full turns included
      angular_velocity/{step, time, value}   (F, n), counter-clockwise
      collisions/{step, time, value}    (F, n) int32, how many each disk has had
      image/...                         as position, int32: box lengths travelled
      last_partner/...                  (F, n) int32: partner of the latest collision; -1 none yet, -2 - w wall w
      radius, mass, k, material         (n,): constant; `species` is another name of `material`
    observables/<name>/{step, time, value}   (F, ...) whole-gas quantities
    timeseries                          absent without series
      {step, time}                      (S,), the number of the row and its time
      <name>/{step, time, value}        (S, ...) whole-gas quantities at times of their own
    histories                           collisions of the tracked disks; see `ifrdem.trajectory.history_columns`
    parameters                          case text, seed, device, ...; versions/<package>
      units/<quantity>                  e.g. momentum = "kg m s-1"; or units = "reduced" for all of them

`step` (the number of the frame) and `time` exist once; the groups share them by hard links, and likewise those of
the time series. `step` is the commit marker: it grows last, so that a frame counts only if it has a step. Wall w
is that of the parameter "walls", then come the sides of the box (`walls.sides`). The names of a series' columns
stand in its attribute `columns`. Layout 1.0 had no last_partner, timeseries and histories, 1.1 no angle. Readers
that need three components (MDAnalysis, VMD, ASE) take `value`; nothing is stored twice. H5MD knows no sheared box:
what such readers make of images above and below is wrong in one. There are no `unit` attributes, because MDAnalysis
refuses units that are not in its list.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..errors import InputError
from ..model.box import Box
from ..model.state import Disks
from ..tools.versions import package_versions
from . import damage, history_columns
from .staged_group import staged

CHECKPOINT = ".checkpoint.h5"
"""Ending of the file from which a run goes on, beside its trajectory."""

H5MD_VERSION = (1, 1)
LAYOUT_VERSION = (1, 2)
PARTICLES = "particles/all"
EDGES = f"{PARTICLES}/box/edges"
TIMESERIES = "timeseries"
REDUCED = "reduced"
"""What stands for the unit of every quantity where there are none."""
SI_SYMBOLS = ("m", "kg", "s", "rad", "J", "N", "Hz")
STATIC = ("radius", "mass", "k", "material")

# Disks per chunk at most: one disk's history needs one chunk a frame, and a chunk must stay small.
CHUNK_DISKS = 16384
# Frames per chunk of the short series (step, time, observables).
CHUNK_FRAMES = 64
# Rows per chunk of the time series.
CHUNK_ROWS = 512


@dataclass(frozen=True)
class Field:
    """A quantity stored per disk and frame.

    Attributes
    ----------
    attribute : str
        Its name in `State`.
    components : int
        2 for vectors, stored as (frames, n, 2) with a 3D view; 1 for scalars, (frames, n).
    count : bool
        Stored as int32; otherwise in the floating-point precision of the file.
    """

    attribute: str
    components: int
    count: bool = False

    @property
    def dataset(self) -> str:
        """Name of the dataset with the stored data inside the field's group."""
        return "value_2d" if self.components == 2 else "value"


FIELDS = {
    "position": Field("position", 2),
    "velocity": Field("velocity", 2),
    "angle": Field("angle", 1),
    "angular_velocity": Field("spin", 1),
    "collisions": Field("collisions", 1, count=True),
    "image": Field("image", 2, count=True),
    "last_partner": Field("last_partner", 1, count=True),
}

VIEWS = {
    f"{PARTICLES}/{name}/value": f"/{PARTICLES}/{name}/{field.dataset}"
    for name, field in FIELDS.items()
    if field.components == 2
}
"""Virtual datasets of a trajectory, and what each shows."""
PRECISIONS: dict[str, type[np.floating]] = {"f4": np.float32, "f8": np.float64}
COMPRESSIONS: dict[str, dict[str, object]] = {
    "none": {},
    # The one compression that every HDF5 reader knows: byte shuffle and deflate.
    "gzip": {"compression": "gzip", "compression_opts": 1, "shuffle": True},
}


def create(
    file: h5py.File,
    *,
    disks: Disks,
    box: Box,
    fields: Sequence[str],
    precision: str,
    compression: str,
    parameters: Mapping[str, str | int | float],
    units: Mapping[str, str],
) -> None:
    """Write everything but the frames into an empty file: groups, constant data, empty series.

    The names and choices are expected to have been checked.
    """
    h5md = file.create_group("h5md")
    h5md.attrs["version"] = np.array(H5MD_VERSION, dtype=np.int32)
    h5md.create_group("author").attrs["name"] = str(parameters.get("author", "not stated"))
    versions = package_versions()
    creator = h5md.create_group("creator")
    creator.attrs["name"] = "ifrdem"
    creator.attrs["version"] = str(parameters.get("versions/ifrdem", versions["ifrdem"]))
    h5md.create_group("modules/ifrdem").attrs["version"] = np.array(LAYOUT_VERSION, dtype=np.int32)
    if _are_si(units):
        module = h5md.create_group("modules/units")
        module.attrs["version"] = np.array((1, 0), dtype=np.int32)
        module.attrs["system"] = np.bytes_("SI")  # the module wants a text of fixed length

    particles = file.create_group(PARTICLES)
    frame_box = particles.create_group("box")
    for name, value in box_attributes(box).items():
        frame_box.attrs[name] = value
    edges = frame_box.create_group("edges")
    edges.create_dataset("step", shape=(0,), maxshape=(None,), chunks=(CHUNK_FRAMES,), dtype=np.int64)
    edges.create_dataset("time", shape=(0,), maxshape=(None,), chunks=(CHUNK_FRAMES,), dtype=np.float64)
    edges.create_dataset(
        "value", shape=(0, 3), maxshape=(None, 3), chunks=(CHUNK_FRAMES, 3), dtype=np.float64
    )

    for name in STATIC:
        particles[name] = getattr(disks, name)
    particles["species"] = particles["material"]
    for name in fields:
        field = FIELDS[name]
        dtype: DTypeLike = np.int32 if field.count else PRECISIONS[precision]
        _create_field(file, name, field, disks.n, dtype, COMPRESSIONS[compression])

    stored = file.create_group("parameters")
    for package, version in versions.items():
        if f"versions/{package}" not in parameters:
            stored[f"versions/{package}"] = version
    if units and set(units.values()) == {REDUCED}:
        stored["units"] = REDUCED
    else:
        for quantity, unit in units.items():
            stored[f"units/{quantity}"] = unit
    for name, value in parameters.items():
        stored[name] = value
    file.create_group("observables")


def box_attributes(box: Box) -> dict[str, Any]:
    """What a file says of its box."""
    sides: dict[str, Any] = {
        "dimension": 3,
        "boundary": [*("periodic" if one else "none" for one in box.periodic), "none"],
        "lengths": np.array(box.lengths),
    }
    return {**sides, "shear_rate": box.shear_rate} if box.shear_rate else sides


def _are_si(units: Mapping[str, str]) -> bool:
    """Whether there are units and all are powers of SI symbols in the module's notation: "kg m s-1"."""
    factors = [factor for unit in units.values() for factor in unit.split(" ")]
    power = rf"({'|'.join(SI_SYMBOLS)})([+-][1-9][0-9]*)?"
    return bool(factors) and all(re.fullmatch(power, factor) for factor in factors)


def _create_field(
    file: h5py.File, name: str, field: Field, n: int, dtype: DTypeLike, filters: Mapping[str, object]
) -> None:
    group = file.create_group(f"{PARTICLES}/{name}")
    _link_steps(file, group)
    tail = (2,) if field.components == 2 else ()
    # HDF5 has no chunks of size 0 in an axis that cannot grow.
    limit = n if n > 0 else None
    group.create_dataset(
        field.dataset,
        shape=(0, n, *tail),
        maxshape=(None, limit, *tail),
        chunks=(1, chunk_disks(n), *tail),
        dtype=dtype,
        **filters,
    )
    if field.components != 2:
        return
    if n == 0:  # nothing to view, and HDF5 has no unlimited view of an empty selection
        group.create_dataset(
            "value", shape=(0, 0, 3), maxshape=(None, None, 3), chunks=(1, 1, 3), dtype=dtype
        )
        return
    source = h5py.VirtualSource(
        ".", f"/{PARTICLES}/{name}/{field.dataset}", shape=(1, n, 2), maxshape=(None, n, 2), dtype=dtype
    )
    view = h5py.VirtualLayout(shape=(1, n, 3), maxshape=(None, n, 3), dtype=dtype)
    frames = slice(0, h5py.h5s.UNLIMITED)  # the view grows with its source
    view[frames, :, :2] = source[frames, :, :]
    group.create_virtual_dataset("value", view, fillvalue=0)


def add_observable(file: h5py.File, name: str, sample: NDArray[Any]) -> h5py.Dataset:
    """Add an empty series for values of the shape and type of `sample`; returns its dataset."""
    group = file.create_group(f"observables/{name}")
    _link_steps(file, group)
    return group.create_dataset(
        "value",
        shape=(0, *sample.shape),
        maxshape=(None, *sample.shape),
        chunks=(CHUNK_FRAMES if sample.size <= 16 else 1, *sample.shape),
        dtype=sample.dtype,
    )


def create_timeseries(
    file: h5py.File, samples: Mapping[str, NDArray[Any]], columns: Mapping[str, Sequence[str]]
) -> None:
    """Write the group of the time series, without a row yet, for values of the shapes and types of `samples`."""
    with staged(file, TIMESERIES) as group:
        for name, dtype in (("step", np.int64), ("time", np.float64)):
            group.create_dataset(name, shape=(0,), maxshape=(None,), chunks=(CHUNK_ROWS,), dtype=dtype)
        for name, sample in samples.items():
            series = group.create_group(name)
            series["step"], series["time"] = group["step"], group["time"]
            if name in columns:
                series.attrs["columns"] = list(columns[name])
            series.create_dataset(
                "value",
                shape=(0, *sample.shape),
                maxshape=(None, *sample.shape),
                chunks=(max(1, CHUNK_ROWS // sample.size), *sample.shape),
                dtype=sample.dtype,
            )


def _link_steps(file: h5py.File, group: h5py.Group) -> None:
    for name in ("step", "time"):
        group[name] = file[f"{EDGES}/{name}"]


def chunk_disks(n: int) -> int:
    """Disks per chunk: equal chunks, as few as CHUNK_DISKS allows, so that the last is not mostly empty."""
    if n == 0:
        return 1
    chunks = -(-n // CHUNK_DISKS)
    return -(-n // chunks)


def stored_fields(file: h5py.File) -> tuple[str, ...]:
    """Names of the per-disk fields that the file holds."""
    return tuple(name for name in FIELDS if f"{PARTICLES}/{name}" in file)


def field_dataset(file: h5py.File, name: str) -> h5py.Dataset:
    """The dataset with the stored data of a field, (frames, n) or (frames, n, 2)."""
    return file[f"{PARTICLES}/{name}/{FIELDS[name].dataset}"]


def plain_views(file: h5py.File) -> list[h5py.Dataset]:
    """The views that do not grow by themselves: those of no disks."""
    views = [
        file[f"{PARTICLES}/{name}/value"] for name in stored_fields(file) if FIELDS[name].components == 2
    ]
    return [view for view in views if not view.is_virtual]


def check_layout(file: h5py.File, path: str) -> None:
    """Raise InputError that says what is missing or wrong unless the file has this layout, and holds all its data."""
    damage.check_links(file, path, VIEWS)
    with damage.reading(path, "its layout"):
        _check_layout(file, path)


def _check_layout(file: h5py.File, path: str) -> None:
    if "h5md" not in file or "version" not in file["h5md"].attrs:
        found = ", ".join(sorted(file)) or "nothing"
        raise InputError(
            f"{path} is HDF5 but not H5MD: its group h5md with a version is missing (it holds {found})"
        )
    needed = [f"{EDGES}/{name}" for name in ("step", "time", "value")]
    needed += [f"{PARTICLES}/{name}" for name in STATIC]
    needed += ["h5md/modules/ifrdem", "parameters", "observables"]
    missing = [name for name in needed if name not in file]
    for name in stored_fields(file):
        if FIELDS[name].dataset not in file[f"{PARTICLES}/{name}"]:
            missing.append(f"{PARTICLES}/{name}/{FIELDS[name].dataset}")
    if missing:
        creator = file["h5md/creator"].attrs.get("name", "unknown") if "h5md/creator" in file else "unknown"
        raise InputError(
            f"{path} is H5MD but not a trajectory of ifrdem (its creator: {creator}): "
            f"missing {', '.join(missing)}"
        )
    version = tuple(int(part) for part in file["h5md/modules/ifrdem"].attrs["version"])
    if version[0] != LAYOUT_VERSION[0]:
        raise InputError(
            f"{path} has layout version {version[0]}.{version[1]}; this ifrdem reads {LAYOUT_VERSION[0]}.x"
        )
    steps = len(file[f"{EDGES}/step"])
    for name in stored_fields(file):
        frames = len(field_dataset(file, name))
        if frames < steps:
            raise InputError(f"{path} is damaged: {name} holds {frames} of {steps} frames")
    _check_numbers(file)
    _check_series(file, path)
    history_columns.check_layout(file, path)


def _check_numbers(file: h5py.File) -> None:
    """Raise DamageError unless frames and disks are numbers of the right shape."""
    n = len(file[f"{PARTICLES}/radius"])
    for name in STATIC:
        damage.expect(file[f"{PARTICLES}/{name}"], (n,), "iu" if name == "material" else "f")
    for name, tail, kinds in (("step", (), "iu"), ("time", (), "f"), ("value", (3,), "f")):
        damage.expect(file[f"{EDGES}/{name}"], (None, *tail), kinds)
    for name in stored_fields(file):
        field = FIELDS[name]
        tail = (2,) if field.components == 2 else ()
        damage.expect(field_dataset(file, name), (None, n, *tail), "i" if field.count else "f")


def _check_series(file: h5py.File, path: str) -> None:
    if TIMESERIES not in file:
        return
    group = file[TIMESERIES]
    if "step" not in group or "time" not in group:
        raise InputError(f"{path} is damaged: its time series have no steps or times")
    steps = len(group["step"])
    for name, item in group.items():
        rows = item if name in ("step", "time") else item.get("value")
        if steps and (rows is None or len(rows) < steps):
            held = 0 if rows is None else len(rows)
            raise InputError(f"{path} is damaged: time series {name} holds {held} of {steps} rows")


def checkpoint_of(trajectory: Path) -> Path:
    """The checkpoint that belongs to a trajectory, NAME.checkpoint.h5 for NAME.h5."""
    return trajectory.with_name(trajectory.name.removesuffix(".h5") + CHECKPOINT)
