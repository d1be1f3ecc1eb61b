"""The layout of a trajectory file: H5MD 1.1 with raw two-dimensional data and 3D views of it.

H5MD: P. de Buyl, P. H. Colberg and F. Hoefling, Comput. Phys. Commun. 185, 1546 (2014),
doi:10.1016/j.cpc.2014.01.018. The manual has all groups and datasets (`ifrdem docs format`). Layout 1.0 had no
last_partner, timeseries and histories, 1.1 no angle, 1.2 no asleep and dissipated, and up to 1.3 `edges` were three
lengths, z a placeholder of 1, also in boxes without a periodic side. Up to 1.5 `species` were materials, and datasets
had no attributes `units` and `description`.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..errors import DamageError, InputError, install_extra
from ..kernels.columns import rows_dtype
from ..kernels.compiler.runtime import of_versions
from ..model.box import Box
from ..model.state import Disks
from ..quantities import EVENT, FIELDS, PRECISIONS, START, Quantity
from ..tools.versions import package_versions, revision
from . import damage
from . import parts as part_files
from .descriptions import REDUCED, describe
from .file import staged
from .parts import Part, Parts
from .species import named_species, species_of_disks

H5MD_VERSION = (1, 1)
LAYOUT_VERSION = (1, 6)
PARTICLES = "particles/all"
EDGES = f"{PARTICLES}/box/edges"
FRAMES = "frames"
"""Group of the steps and times of frames where there are no edges: H5MD lets them be absent without a periodic side."""
TIMESERIES = "timeseries"
RUNTIMES = "versions/runtimes"
"""Parameter with the runtimes that wrote a file, in order; its length is fixed, because a resumed run adds its own."""
RUNTIMES_TYPE = "S200"
SI_SYMBOLS = ("m", "kg", "s", "rad", "J", "N", "Hz")
STATIC: dict[str, DTypeLike] = {
    "radius": np.float64,
    "mass": np.float64,
    "k": np.float64,
    "material": np.int32,
}

# Disks per chunk at most: one disk's history needs one chunk a frame, and a chunk must stay small.
CHUNK_DISKS = 16384
# Frames per chunk of the short series (step, time, observables).
CHUNK_FRAMES = 64
# Rows per chunk of the time series.
CHUNK_ROWS = 512


VIEWS = {
    f"{PARTICLES}/{name}/value": {(".", f"/{PARTICLES}/{name}/{field.dataset}")}
    for name, field in FIELDS.items()
    if field.along == "axis"
}
"""Virtual datasets of a trajectory, and what each shows: files and datasets."""
COMPRESSIONS: dict[str, dict[str, object]] = {
    "none": {},
    # The one compression that every HDF5 reader knows: byte shuffle and deflate.
    "gzip": {"compression": "gzip", "compression_opts": 1, "shuffle": True},
    # Level 3; readers need a plugin of HDF5, which `import hdf5plugin` is for h5py.
    "zstd": {"compression": damage.ZSTD, "compression_opts": (3,), "shuffle": True},
}


HISTORIES = "histories"
CHUNK_EVENTS, FEW_EVENTS, MANY = 16384, 512, 1000
"""Events per chunk of many tracked disks; of fewer than MANY."""


MEANINGS = {
    "partner": "0 or more: a disk; -1: none, a force changed the motion; -2 - w: wall w",
    "regime": "0 none; 1 sliding, 2 sticking; with rolling friction 3 sliding rolling, 4 sticking rolling, 5 sliding "
    "non-rolling, 6 sticking non-rolling; 9 elastic by a remedy for collapse; -1 not known",
}
"""Meaning of numbers; in the file an attribute of the column."""


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
    within: Parts | Part | None = None,
) -> None:
    """Write everything but the frames into an empty file: groups, constant data, empty series; names are checked.

    Of a trajectory in parts, `within` are all of them for NAME.h5, which shows their disks, or which one this is.
    """
    parts = within if isinstance(within, Parts) else None
    if within is not None:
        within.write(file)
    h5md = file.create_group("h5md")
    h5md.attrs["version"] = np.array(H5MD_VERSION, dtype=np.int32)
    # H5MD wants texts of fixed length.
    h5md.create_group("author").attrs["name"] = _fixed(str(parameters.get("author", "not stated")))
    versions = package_versions()
    creator = h5md.create_group("creator")
    creator.attrs["name"] = _fixed("ifrdem")
    creator.attrs["version"] = _fixed(str(parameters.get("versions/ifrdem", versions["ifrdem"])))
    h5md.create_group("modules/ifrdem").attrs["version"] = np.array(LAYOUT_VERSION, dtype=np.int32)
    if _are_si(units):
        module = h5md.create_group("modules/units")
        module.attrs["version"] = np.array((1, 0), dtype=np.int32)
        module.attrs["system"] = np.bytes_("SI")  # the module wants a text of fixed length

    particles = file.create_group(PARTICLES)
    particles.create_group("box").attrs.update(box_attributes(box))
    clock = file.create_group(EDGES if any(box.periodic) else FRAMES)
    for name, dtype in (("step", np.int64), ("time", np.float64)):
        _growing(clock, name, dtype, CHUNK_FRAMES)
    if any(box.periodic):
        _growing(clock, "value", np.float64, CHUNK_FRAMES, (3, 3))
    for name, kind in STATIC.items():
        if parts is None:
            particles[name] = getattr(disks, name)
        else:
            parts.show(particles, name, f"/{PARTICLES}/{name}", (), kind, frames=False)
    _add_species(particles, disks.n, within, parameters)
    for name in fields:
        group, field = _stepped(file, f"{PARTICLES}/{name}"), FIELDS[name]
        stored_as: DTypeLike = field.dtype(PRECISIONS[precision])
        if parts is None:
            _create_field(group, field, disks.n, stored_as, COMPRESSIONS[compression])
            continue
        for shown in dict.fromkeys((field.dataset, "value")):
            parts.show(group, shown, f"{group.name}/{field.dataset}", field.tail, stored_as, frames=True)

    stored = file.create_group("parameters")
    reduced = bool(units) and set(units.values()) == {REDUCED}
    record = {f"versions/{package}": version for package, version in versions.items()}
    record |= {"units": REDUCED} if reduced else {f"units/{name}": unit for name, unit in units.items()}
    record[RUNTIMES] = " ".join(of_versions(versions))
    record["git"] = revision()
    for name, value in {**record, **parameters}.items():
        stored.create_dataset(name, data=value, dtype=RUNTIMES_TYPE if name == RUNTIMES else None)
    file.create_group("observables")
    describe(file, units)


def _add_species(
    particles: h5py.Group, n: int, within: Parts | Part | None, parameters: Mapping[str, object]
) -> None:
    """Write the number of each disk's species, or of its material where no species are named."""
    named = named_species(parameters, n)
    numbers = within.species if isinstance(within, Part) else tuple(named.values()) if named else ()
    if not numbers:
        particles["species"] = particles["material"]
    elif isinstance(within, Parts):
        within.show(particles, "species", f"/{PARTICLES}/species", (), np.int32, frames=False)
    else:
        first = within.first if isinstance(within, Part) else 0
        particles["species"] = species_of_disks(numbers, first, n)


def units_of(file: h5py.File) -> dict[str, str]:
    """Unit of each quantity as the file states them; "reduced" for each, or none."""
    group = file["parameters"].get("units")
    if isinstance(group, h5py.Group):
        return {name: damage.text_of(each[()]) for name, each in group.items()}
    return {} if group is None else {"time": REDUCED}


def record_runtime(file: h5py.File) -> None:
    """Add the present runtime of kernels to those that have written a file, if it is another one."""
    present = " ".join(of_versions(package_versions()))
    with damage.as_damage_error(file.filename, RUNTIMES):
        held = file[f"parameters/{RUNTIMES}"]
        names = held[()].decode().split(", ")
        if present not in names:
            held[()] = ", ".join([*names, present])


def _growing(
    group: h5py.Group, name: str, dtype: DTypeLike, chunk: int, tail: tuple[int, ...] = ()
) -> h5py.Dataset:
    """An empty dataset that grows along its first axis, by rows of the shape `tail`."""
    chunks = (chunk, *tail)
    return group.create_dataset(name, shape=(0, *tail), maxshape=(None, *tail), chunks=chunks, dtype=dtype)


def box_attributes(box: Box) -> dict[str, Any]:
    """Attributes of a box in the file."""
    sides: dict[str, Any] = {
        "dimension": 3,
        "boundary": np.array([*("periodic" if one else "none" for one in box.periodic), "none"], dtype="S"),
        "lengths": np.array(box.lengths),
    }
    return {**sides, "shear_rate": box.shear_rate} if box.shear_rate else sides


def _fixed(text: str) -> Any:
    return np.array(text.encode(), dtype=h5py.string_dtype(length=max(1, len(text.encode()))))


def frame_dtype(fields: Sequence[str], precision: str) -> np.dtype[Any]:
    """Type of a disk in a frame of a file with these fields, by the names in `State`."""
    return rows_dtype((FIELDS[name] for name in fields), PRECISIONS[precision])


def clock(file: h5py.File) -> str:
    """Name of the group with the steps and times of frames."""
    return EDGES if EDGES in file else FRAMES


def _are_si(units: Mapping[str, str]) -> bool:
    """True if there are units and all are powers of SI symbols in the module's notation: "kg m s-1"."""
    factors = [factor for unit in units.values() for factor in unit.split(" ")]
    power = rf"({'|'.join(SI_SYMBOLS)})([+-][1-9][0-9]*)?"
    return bool(factors) and all(re.fullmatch(power, factor) for factor in factors)


def _create_field(
    group: h5py.Group, field: Quantity, n: int, dtype: DTypeLike, filters: Mapping[str, object]
) -> None:
    # HDF5 has no chunks of size 0 in an axis that cannot grow.
    group.create_dataset(
        field.dataset,
        shape=(0, n, *field.tail),
        maxshape=(None, n or None, *field.tail),
        chunks=(1, chunk_disks(n), *field.tail),
        dtype=dtype,
        **filters,
    )
    if field.along != "axis":
        return
    if n == 0:  # nothing to view, and HDF5 has no unlimited view of an empty selection
        group.create_dataset(
            "value", shape=(0, 0, 3), maxshape=(None, None, 3), chunks=(1, 1, 3), dtype=dtype
        )
        return
    shape = {"shape": (1, n, 2), "maxshape": (None, n, 2), "dtype": dtype}
    source = h5py.VirtualSource(".", f"{group.name}/{field.dataset}", **shape)
    view = h5py.VirtualLayout(shape=(1, n, 3), maxshape=(None, n, 3), dtype=dtype)
    frames = slice(0, h5py.h5s.UNLIMITED)  # the view grows with its source
    view[frames, :, :2] = source[frames, :, :]
    group.create_virtual_dataset("value", view, fillvalue=0)


def views_of(parts: Parts | None) -> Mapping[str, Collection[tuple[str, str]]]:
    """Virtual datasets that a file may have, and their sources: files and datasets."""
    if parts is None:
        return VIEWS
    sources = {f"{PARTICLES}/{name}": f"/{PARTICLES}/{name}" for name in STATIC}
    sources[f"{PARTICLES}/species"] = f"/{PARTICLES}/species"
    for name, field in FIELDS.items():
        for shown in (field.dataset, "value"):
            sources[f"{PARTICLES}/{name}/{shown}"] = f"/{PARTICLES}/{name}/{field.dataset}"
    names = [part_files.as_source(parts.name(number)) for number in range(len(parts))]
    found = {path: {(name, source) for name in names} for path, source in sources.items()}
    # Where no species are named, another name of the materials.
    found[f"{PARTICLES}/species"] |= found[f"{PARTICLES}/material"]
    for path in VIEWS:
        found[path] |= {(".", f"/{part_files.ZEROS}/{kind}") for kind in ("f4", "f8", "i4")}
    return found


def add_observable(file: h5py.File, name: str, sample: NDArray[Any]) -> h5py.Dataset:
    """Add an empty series for values of the shape and type of `sample`; returns its dataset."""
    group = _stepped(file, f"observables/{name}")
    chunk = CHUNK_FRAMES if sample.size <= 16 else 1
    dataset = _growing(group, "value", sample.dtype, chunk, sample.shape)
    describe(file, units_of(file), str(dataset.name))
    return dataset


def create_timeseries(
    file: h5py.File, samples: Mapping[str, NDArray[Any]], columns: Mapping[str, Sequence[str]]
) -> None:
    """Write the group of the time series, without a row yet, for values of the shapes and types of `samples`."""
    with staged(file, TIMESERIES) as group:
        _growing(group, "step", np.int64, CHUNK_ROWS)
        _growing(group, "time", np.float64, CHUNK_ROWS)
        for name, sample in samples.items():
            series = group.create_group(name)
            series["step"], series["time"] = group["step"], group["time"]
            if name in columns:
                series.attrs["columns"] = list(columns[name])
            _growing(series, "value", sample.dtype, max(1, CHUNK_ROWS // sample.size), sample.shape)
        describe(file, units_of(file), str(group.name))


def create_histories(
    file: h5py.File, tracked: NDArray[np.int32], start: Mapping[str, NDArray[Any] | np.float64]
) -> None:
    """Write the group of the tracked disks with no event yet; `start` is where they are, and the time."""
    with staged(file, HISTORIES) as group:
        group["tracked"] = tracked
        for name, values in start.items():
            group[f"start/{name}"] = values
        for name, column in EVENT.items():
            _growing(group, f"events/{name}", column.dtype(), chunk_events(len(tracked)), column.tail)
        for name, text in MEANINGS.items():
            group[f"events/{name}"].attrs["meaning"] = text
        for name, first in (("events", np.int64(0)), ("time", np.float64(start["time"]))):
            group.create_dataset(f"committed/{name}", data=[first], maxshape=(None,), chunks=(64,))
        describe(file, units_of(file), str(group.name))


def _stepped(file: h5py.File, path: str) -> h5py.Group:
    """Make a group of something that each frame has."""
    group = file.create_group(path)
    for name in ("step", "time"):
        group[name] = file[f"{clock(file)}/{name}"]
    return group


def chunk_disks(n: int) -> int:
    """Disks per chunk: equal chunks, as few as CHUNK_DISKS allows, so that the last is not mostly empty."""
    return -(-n // -(-n // CHUNK_DISKS)) if n else 1


def chunk_events(tracked: int) -> int:
    """Events per chunk; never compressed: each commit writes the last chunk again, which must stay in its place."""
    return CHUNK_EVENTS if tracked >= MANY else min(CHUNK_EVENTS, FEW_EVENTS)


def stored_fields(file: h5py.File) -> tuple[str, ...]:
    """Names of the per-disk fields that the file holds."""
    return tuple(name for name in FIELDS if f"{PARTICLES}/{name}" in file)


def field_dataset(file: h5py.File, name: str) -> h5py.Dataset:
    """The dataset with the stored data of a field, (frames, n) or (frames, n, 2)."""
    return file[f"{PARTICLES}/{name}/{FIELDS[name].dataset}"]


def committed_rows(file: h5py.File) -> int:
    """Number of committed rows of the time series."""
    return len(file[f"{TIMESERIES}/step"]) if TIMESERIES in file else 0


def need_zstd(what: str) -> None:
    """Make zstd known to HDF5.

    Raises InputError if the package for it is missing; `what` needs it.
    """
    try:
        import hdf5plugin  # noqa: F401 importing it is what makes the filter known
    except ImportError as error:
        raise InputError(
            f'{what} requires the package hdf5plugin: {install_extra("zstd")}; "gzip" requires none'
        ) from error


def load_compression(file: h5py.File, path: str) -> None:
    """Make the compression of a file's fields known to HDF5; an InputError says which package it needs."""
    if part_files.GROUP in file:  # it holds none
        return
    for name in stored_fields(file):
        dataset = file[f"{PARTICLES}/{name}"].get(FIELDS[name].dataset)
        if isinstance(dataset, h5py.Dataset) and damage.compression(dataset) == "zstd":
            need_zstd(f"{path} is compressed by zstd: reading it")
            return


def version_of(file: h5py.File) -> tuple[int, ...]:
    """Layout version of a file, (0, 0) if it has none."""
    module = file.get("h5md/modules/ifrdem")
    version = () if module is None else module.attrs.get("version", ())
    return tuple(int(part) for part in version) or (0, 0)


def newer(file: h5py.File, path: str) -> str:
    """Message about a file that cannot be read because it has a newer layout; empty for others."""
    with contextlib.suppress(*damage.FAULTS):
        if (version := version_of(file)) > LAYOUT_VERSION:
            found, known = (".".join(map(str, one)) for one in (version, LAYOUT_VERSION))
            return (
                f"{path} was written by a newer ifrdem: its layout is {found}, this one reads up to {known}; install "
                "a newer version"
            )
    return ""


def check_layout(
    file: h5py.File, path: str, lacks: dict[int, part_files.MissingPart] | None = None
) -> Parts | None:
    """The parts that a file is in, None if it holds all data itself.

    Parts that are missing are put into `lacks`, by their numbers, or refused without it.

    Raises InputError unless the file has this layout, and it or its parts hold all
    data.
    """
    with damage.as_damage_error(path, "its version"):
        if version_of(file)[0] > LAYOUT_VERSION[0]:
            raise InputError(newer(file, path))
    parts = part_files.of(file, path)
    damage.check_links(file, path, views_of(parts))
    load_compression(file, path)
    with damage.as_damage_error(path, "its layout"):
        _check_frames(file, path, parts)
        if TIMESERIES in file:
            _check_series(file[TIMESERIES], path)
        if HISTORIES in file:
            _check_histories(file[HISTORIES], path)
    if parts is not None:
        for number in range(len(parts)):
            try:
                check_part(file, path, parts, number)
            except part_files.MissingPart as error:
                if lacks is None:
                    raise
                lacks[number] = error
    return parts


def check_part(file: h5py.File, path: str, parts: Parts, number: int) -> None:
    """Raise DamageError that names a part of a trajectory unless it is there, and has all frames that count."""
    what = f"{path}: its {parts.described(number)}"
    with parts.open(path, number) as part:
        try:
            check_layout(part, str(part.filename))
            disks = part[f"{PARTICLES}/radius"].shape
        except InputError as error:
            raise DamageError(f"{what} cannot be read: {error}") from error
        own, frames = parts.disks(number), len(file[f"{clock(file)}/step"])
        if disks != (own.stop - own.start,):
            raise DamageError(f"{what} holds {disks[0]} disks instead{part_files.SEE}")
        held = len(part[f"{clock(part)}/step"])
        if held < frames:
            raise part_files.ShortPart(
                f"{what} is too short: it holds {held} of {frames} frames{part_files.SEE}"
            )
        for name in stored_fields(file):
            if name not in stored_fields(part):
                raise DamageError(f"{what} lacks {name}{part_files.SEE}")


Expected = dict[str, tuple[tuple[int | None, ...], str]]
"""Name of each dataset -> its shape (None: any length), and the kinds of its numbers (NumPy's letters)."""


def _check_frames(file: h5py.File, path: str, parts: Parts | None) -> None:
    if "h5md" not in file or "version" not in file["h5md"].attrs:
        found = ", ".join(sorted(file)) or "nothing"
        raise InputError(
            f"{path} is HDF5 but not H5MD: its group h5md with a version is missing (it holds {found})"
        )
    frames = clock(file)
    expected: Expected = {f"{frames}/step": ((None,), "iu"), f"{frames}/time": ((None,), "f")}
    if frames == EDGES:
        edges = file.get(f"{EDGES}/value")
        expected[f"{EDGES}/value"] = ((None, 3, 3) if getattr(edges, "ndim", 0) == 3 else (None, 3)), "f"
    n = len(file[f"{PARTICLES}/radius"]) if parts is None and f"{PARTICLES}/radius" in file else 0
    own: Expected = {f"{PARTICLES}/{name}": ((n,), "iu" if name == "material" else "f") for name in STATIC}
    for name in stored_fields(file):
        field = FIELDS[name]
        own[f"{PARTICLES}/{name}/{field.dataset}"] = (None, n, *field.tail), "i" if field.whole else "f"
    groups = ("h5md/modules/ifrdem", "parameters", "observables")
    if missing := [name for name in (*expected, *own, *groups) if name not in file]:
        name = file["h5md/creator"].attrs.get("name", "unknown") if "h5md/creator" in file else "unknown"
        creator = damage.text_of(name)
        raise InputError(
            f"{path} is H5MD but not a trajectory of ifrdem (its creator: {creator}): missing {', '.join(missing)}"
        )
    version = version_of(file)
    if version[0] != LAYOUT_VERSION[0]:
        raise InputError(
            f"{path} has layout version {version[0]}.{version[1]}; this ifrdem reads {LAYOUT_VERSION[0]}.x"
        )
    steps = len(file[f"{frames}/step"])
    for name in stored_fields(file) if parts is None else ():
        if (held := len(field_dataset(file, name))) < steps:
            raise InputError(f"{path} is damaged: {name} holds {held} of {steps} frames")
    _require_shapes(file, expected | own if parts is None else expected)  # parts have their own shapes


def _require_shapes(group: h5py.Group, expected: Expected) -> None:
    for name, (shape, kinds) in expected.items():
        damage.require_shape(group[name], shape, kinds)


def _check_series(group: h5py.Group, path: str) -> None:
    if "step" not in group or "time" not in group:
        raise InputError(f"{path} is damaged: its time series have no steps or times")
    steps = len(group["step"])
    for name, item in group.items():
        rows = item if name in ("step", "time") else item.get("value")
        if (held := 0 if rows is None else len(rows)) < steps:
            raise InputError(f"{path} is damaged: time series {name} holds {held} of {steps} rows")


def _check_histories(group: h5py.Group, path: str) -> None:
    tracked = len(group["tracked"]) if "tracked" in group else 0
    expected: Expected = {
        "tracked": ((None,), "i"),
        "start/time": ((), "iuf"),
        **{f"start/{name}": ((tracked, *column.tail), "iuf") for name, column in START.items()},
        **{f"events/{name}": ((None, *column.tail), column.dtype()[0]) for name, column in EVENT.items()},
        "committed/events": ((None,), "iu"),
        "committed/time": ((None,), "f"),
    }
    if missing := [name for name in expected if name not in group]:
        raise InputError(f"{path} is damaged: its histories lack {', '.join(missing)}")
    _require_shapes(group, expected)
    commits = len(group["committed/events"])
    if not 0 < commits <= len(group["committed/time"]):
        raise InputError(f"{path} is damaged: its histories have no commit")
    events = int(damage.read(group["committed/events"], commits - 1))
    if events < 0:
        raise InputError(f"{path} is damaged: its histories have {events} events")
    for name in EVENT:
        if (held := len(group[f"events/{name}"])) < events:
            raise InputError(f"{path} is damaged: its histories hold {held} of {events} events ({name})")
