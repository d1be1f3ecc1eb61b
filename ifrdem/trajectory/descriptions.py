"""Description and unit of each dataset of a trajectory, as its attributes have them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import h5py
import numpy as np

REDUCED = "reduced"
"""Unit of every quantity in reduced units."""
NUMBER = "1"
"""Unit of pure numbers and counts."""
NOT_STATED = "not stated"
"""Unit of a quantity that has one, in a file that states none for it."""


class Described(NamedTuple):
    """The description of a dataset, and its dimension: names and powers such as "energy length-2", "1" or "radian"."""

    text: str
    quantity: str = NUMBER


DERIVED = {
    "velocity": "length time-1", "angular_velocity": "angle time-1", "momentum": "mass length time-1",
    "energy": "mass length2 time-2", "force": "mass length time-2",
}  # fmt: skip
"""Quantities in terms of others, for files that state units of these alone."""
FIELDS = {
    "position": Described("positions of the centres, inside the box", "length"),
    "velocity": Described("velocities of the centres", "velocity"),
    "angle": Described("angles turned since the start, full turns included, counter-clockwise", "angle"),
    "angular_velocity": Described("angular velocities, counter-clockwise", "angular_velocity"),
    "collisions": Described("collisions of each disk so far"),
    "image": Described("box lengths travelled through periodic sides"),
    "last_partner": Described("partner of the latest collision; -1 none yet, -2 - w wall w"),
    "dissipated": Described(
        "energy dissipated by the collisions of each disk so far, half of each collision, by mechanism: normal "
        "restitution, tangential restitution, sliding, sticking, rolling friction, walls, falling asleep", "energy",
    ),
    "asleep": Described("1 for disks that sleep"),
}  # fmt: skip
CONSTANTS = {
    "radius": Described("radii", "length"),
    "mass": Described("masses; inf for immovable disks", "mass"),
    "k": Described("shape numbers k in the moments of inertia m R^2 / k"),
    "material": Described("numbers of the materials, in the order of the parameter materials"),
    "species": Described(
        "numbers of the species, in the order of the parameter species; of the materials where no species are named"
    ),
}
WHOLE_GAS = {
    "translational_energy": Described("kinetic energy of translation", "energy"),
    "rotational_energy": Described("kinetic energy of rotation", "energy"),
    "energy": Described("kinetic energy, translational and rotational", "energy"),
    "temperature": Described(
        "translational temperature T = <m v^2> / 2, v relative to the mean velocity where the whole gas can drift "
        "freely, otherwise in the lab", "energy",
    ),
    "rotational_temperature": Described("rotational temperature T_rot = <I w^2>", "energy"),
    "momentum": Described("total momentum", "momentum"),
    "potential_energy": Described("potential energy in gravity, 0 at the lower left corner of the box", "energy"),
    "energy_input": Described("energy that forces and the mean flow have put in since the start", "energy"),
    "wall_work": Described("work of moving walls on the disks since the start", "energy"),
    "wall_heat": Described("heat from thermal walls since the start", "energy"),
    "dissipated_energy": Described("energy dissipated since the start", "energy"),
    "collisions": Described("collisions of two disks since the start, each counted once"),
    "wall_collisions": Described("collisions with walls since the start"),
    "dissipated_by_mechanism": Described("energy dissipated since the start, by mechanism", "energy"),
    "collisions_by_regime": Described("collisions of two disks since the start, by regime"),
    "ledger_residual": Described("initial energy + input - dissipated - present energy: rounding", "energy"),
    "stress": Described("pressure tensor, mean since the row before", "energy length-2"),
    "stress_kinetic": Described("kinetic part of stress, mean of this row and the row before", "energy length-2"),
    "species_temperature": Described("translational temperature of each species, v as in temperature", "energy"),
    "species_rotational_temperature": Described("rotational temperature of each species", "energy"),
    "species_collisions": Described("collisions since the start, counted at each disk of a species"),
    "piston_displacement": Described("displacement of each piston along its line of motion", "length"),
    "piston_velocity": Described("velocity of each piston along its line of motion", "velocity"),
    "piston_energy": Described("kinetic and potential energy of each piston", "energy"),
    "piston_force": Described("force of its drive on each piston", "force"),
    "walls_momentum_x": Described("momentum along x that each wall has given to the disks", "momentum"),
    "walls_momentum_y": Described("momentum along y that each wall has given to the disks", "momentum"),
    "walls_torque": Described("angular momentum that each wall has given to the disks", "energy time"),
    "walls_work": Described("work of each wall on the disks since the start", "energy"),
    "walls_heat": Described("heat from each wall since the start", "energy"),
    "walls_hits": Described("collisions with each wall since the start"),
}  # fmt: skip
EVENTS = {
    "time": Described("time of the collision", "time"),
    "id": Described("number of the tracked disk"),
    "partner": Described("partner of the collision: a disk, a wall, or none"),
    "position": Described("position of the disk's centre, inside the box", "length"),
    "image": FIELDS["image"],
    "normal": Described("unit vector from the disk's centre to the partner; 0 without a collision"),
    "velocity_before": Described("velocity of the disk before the collision", "velocity"),
    "velocity_after": Described("velocity of the disk after the collision", "velocity"),
    "spin_before": Described("angular velocity of the disk before the collision", "angular_velocity"),
    "spin_after": Described("angular velocity of the disk after the collision", "angular_velocity"),
    "partner_velocity_before": Described("velocity of the partner before; of a wall, at the contact", "velocity"),
    "partner_velocity_after": Described("velocity of the partner after; of a wall, at the contact", "velocity"),
    "partner_spin_before": Described("angular velocity of the partner before; 0 of a wall", "angular_velocity"),
    "partner_spin_after": Described("angular velocity of the partner after; 0 of a wall", "angular_velocity"),
    "impulse": Described("normal and tangential impulse of the disk on its partner", "momentum"),
    "psi": Described("impact angle, between relative velocity and line of centres, 0 to pi/2", "radian"),
    "regime": Described("regime of the collision"),
}  # fmt: skip
CLOCKS = {
    ("frames", "step"): Described("numbers of the frames; a frame counts only if it has one"),
    ("frames", "time"): Described("times of the frames", "time"),
    ("timeseries", "step"): Described("numbers of the rows; a row counts only if it has one"),
    ("timeseries", "time"): Described("times of the rows", "time"),
}
"""Steps and times, which many groups share, of frames and of rows of the time series."""
START = {
    "time": Described("time at which tracking began", "time"),
    "position": Described("positions of the tracked disks at that time, inside the box", "length"),
    "velocity": Described("velocities of the tracked disks at that time", "velocity"),
    "spin": Described("angular velocities of the tracked disks at that time", "angular_velocity"),
    "image": FIELDS["image"],
}
OTHERS = {
    "particles/all/box/edges/value": Described("edge vectors of the periodic cell, row by row", "length"),
    "histories/tracked": Described("numbers of the tracked disks, ascending"),
    "histories/committed/events": Described("events that count, of each commit"),
    "histories/committed/time": Described("times up to which the events are complete", "time"),
    "parts/first": Described("number of the first disk of each part; the number of all disks comes last"),
    **{f"particles/all/{name}": each for name, each in CONSTANTS.items()},
    **{
        f"particles/all/{name}/{stored}": each
        for name, each in FIELDS.items()
        for stored in ("value", "value_2d")
    },
    **{f"histories/events/{name}": each for name, each in EVENTS.items()},
    **{f"histories/start/{name}": each for name, each in START.items()},
}
"""Description of each dataset but those of whole-gas quantities, by its path."""
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
    described = WHOLE_GAS.get(name) or FIELDS.get(name) or CONSTANTS.get(name)
    quantity = "time" if name == "time" else described.quantity if described else NUMBER
    return None if quantity == NUMBER else unit_of(quantity, units)


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
        text, quantity = described
        unit = NOT_STATED if quantity is None else unit_of(quantity, units) or NOT_STATED
        # Texts of fixed length: HDF5 may loop for ever in a damaged heap, which holds the others.
        for name, value in (("units", unit), ("description", text)):
            dataset.attrs.create(name, np.bytes_(value.encode()))


def _described(path: str) -> tuple[str, str | None] | None:
    """Text and quantity of a dataset; None as the quantity where only its writer knows it."""
    if (each := OTHERS.get(path)) is not None:
        flat = path.endswith("/value") and path.split("/")[-2] in VIEWED
        return (f"{each.text}; z is 0" if flat else each.text), each.quantity
    place, _, name = path.removesuffix("/value").partition("/")
    if (last := path.split("/")[-1]) in ("step", "time"):
        return CLOCKS["timeseries" if place == "timeseries" else "frames", last]
    if place in ("observables", "timeseries"):
        known = WHOLE_GAS.get(name)
        return (
            known if known is not None else (f"{name}, a quantity of the program that wrote the file", None)
        )
    return ("zeros that views show as z", NUMBER) if path.startswith("parts/zeros/") else None
