"""Description and unit of each dataset of a trajectory, as its attributes have them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import h5py
import numpy as np

from ..quantities import EVENT, FIELDS, NUMBER, SERIES, START, Quantity

REDUCED = "reduced"
"""Unit of every quantity in reduced units."""
NOT_STATED = "not stated"
"""Unit of a quantity that has one, in a file that states none for it."""


DERIVED = {
    "velocity": "length time-1", "angular_velocity": "angle time-1", "momentum": "mass length time-1",
    "energy": "mass length2 time-2", "force": "mass length time-2",
}  # fmt: skip
"""Quantities in terms of others, for files that state units of these alone."""
CONSTANTS = {each.name: each for each in (
    Quantity("radius", "radii", "length"),
    Quantity("mass", "masses; inf for immovable disks", "mass"),
    Quantity("k", "shape numbers k in the moments of inertia m R^2 / k"),
    Quantity("material", "numbers of the materials, in the order of the parameter materials"),
    Quantity("species", "numbers of the species, in the order of the parameter species; of the materials where no "
             "species are named"),
)}  # fmt: skip
CLOCKS = {
    ("frames", "step"): Quantity("step", "numbers of the frames; a frame counts only if it has one"),
    ("frames", "time"): Quantity("time", "times of the frames", "time"),
    ("timeseries", "step"): Quantity("step", "numbers of the rows; a row counts only if it has one"),
    ("timeseries", "time"): Quantity("time", "times of the rows", "time"),
}
"""Steps and times, which many groups share, of frames and of rows of the time series."""
OTHERS = {
    "particles/all/box/edges/value": Quantity(
        "edges", "edge vectors of the periodic cell, row by row", "length"
    ),
    "histories/tracked": Quantity("tracked", "numbers of the tracked disks, ascending"),
    "histories/start/time": Quantity("time", "time at which tracking began", "time"),
    "histories/committed/events": Quantity("events", "events that count, of each commit"),
    "histories/committed/time": Quantity("time", "times up to which the events are complete", "time"),
    "parts/first": Quantity(
        "first", "number of the first disk of each part; the number of all disks comes last"
    ),
    **{f"particles/all/{name}": each for name, each in CONSTANTS.items()},
    **{
        f"particles/all/{name}/{stored}": each
        for name, each in FIELDS.items()
        for stored in ("value", "value_2d")
    },
    **{f"histories/events/{name}": each for name, each in EVENT.items()},
    **{f"histories/start/{name}": each for name, each in START.items()},
}
"""Each dataset but those of whole-gas quantities, by its path."""
VIEWED = frozenset({"position", "velocity", "image"})
"""Fields whose `value` is a view in three dimensions."""


def unit_of(quantity: str, units: Mapping[str, str]) -> str | None:
    """Unit of a quantity, in the notation of H5MD's units; None where the units do not give it.

    Examples
    --------
    >>> unit_of("energy length-2", {"energy": "J", "length": "m"})
    'J m-2'
    """
    if quantity == NUMBER:
        return NUMBER
    if quantity == "radian":
        return "rad"
    if REDUCED in units.values():
        return REDUCED
    found = []
    for name, power in _factors(quantity):
        unit = units.get(name) or (unit_of(DERIVED[name], units) if name in DERIVED else None)
        unit = "rad" if unit is None and name == "angle" else unit
        if unit is None or (power != 1 and " " in unit):
            return None
        found.append(unit if power == 1 else f"{unit}{power}")
    return " ".join(found)


def _factors(quantity: str) -> Iterator[tuple[str, int]]:
    for factor in quantity.split():
        name = factor.rstrip("-0123456789")
        yield name, int(factor[len(name) :] or 1)


def unit_of_whole_gas(name: str, units: Mapping[str, str]) -> str | None:
    """Unit of a quantity of the whole gas, or `time` or a field; None for pure numbers, or where it is not known."""
    known = SERIES.get(name) or FIELDS.get(name) or CONSTANTS.get(name)
    dimension = "time" if name == "time" else known.dimension if known else NUMBER
    return None if dimension == NUMBER else unit_of(dimension, units)


def describe(file: h5py.File, units: Mapping[str, str], group: str = "/") -> None:
    """Write `units` and `description` of the datasets of a group, or of a dataset, that have none.

    A quantity that others have added by a name of their own is described by this name; its unit is not stated. The
    attribute is not `unit`, the one of H5MD, because MDAnalysis refuses files with units that it does not list.
    """
    found: list[h5py.Dataset] = []
    if isinstance(file[group], h5py.Dataset):
        found.append(file[group])
    else:
        file[group].visititems(lambda _, each: found.append(each) if isinstance(each, h5py.Dataset) else None)
    for dataset in found:
        path = str(dataset.name).lstrip("/").replace("_uncommitted", "", 1)
        if path.startswith("parameters/") or "description" in dataset.attrs:
            continue
        if (described := _described(path)) is None:
            continue
        text, dimension = described
        unit = NOT_STATED if dimension is None else unit_of(dimension, units) or NOT_STATED
        # Texts of fixed length: HDF5 may loop for ever in a damaged heap, which holds the others.
        for name, value in (("units", unit), ("description", text)):
            dataset.attrs.create(name, np.bytes_(value.encode()))


def _described(path: str) -> tuple[str, str | None] | None:
    """Text and dimension of a dataset; None as the dimension where only its writer knows it."""
    if (each := OTHERS.get(path)) is not None:
        flat = path.endswith("/value") and path.split("/")[-2] in VIEWED
        return (f"{each.text}; z is 0" if flat else each.text), each.dimension
    place, _, name = path.removesuffix("/value").partition("/")
    if (last := path.split("/")[-1]) in ("step", "time"):
        each = CLOCKS["timeseries" if place == "timeseries" else "frames", last]
        return each.text, each.dimension
    if place in ("observables", "timeseries"):
        if (known := SERIES.get(name)) is not None:
            return known.text, known.dimension
        return f"{name}, a quantity of the program that wrote the file", None
    return ("zeros that views show as z", NUMBER) if path.startswith("parts/zeros/") else None
