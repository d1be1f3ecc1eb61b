"""Arguments of a simulation as JSON has them: a checkpoint holds them, so that the gas can be made from the file."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from ...errors import InputError
from ...model.box import Box
from ...model.collapse import Collapse
from ...model.gravity import RotatingGravity
from ...model.laws.files import source_of
from ...model.laws.law import CollisionLaw
from ...model.laws.records import ARGUMENTS, from_record, is_custom, to_record
from ...model.state import COLUMNS
from ...model.walls.wall import at_displacements, from_json, to_json
from ..device import Device

if TYPE_CHECKING:
    from ...model.forces import Force
    from ..engine import Engine

_OF_EACH = ("_step", "_values")
"""Attributes that each force has; a record has them as step and values."""

_COLLAPSES = {each.__name__: each for each in get_args(Collapse)}


def gas_record(engine: Engine, laws: Sequence[Sequence[CollisionLaw]]) -> dict[str, Any]:
    """Record of the present box, laws, walls, forces and options of an engine, and a hash of its disks."""
    options = engine.options
    found = {
        "disks": [engine.comm.digest(getattr(engine.disks_here, name)).hex() for name in COLUMNS],
        "box": asdict(engine.box),
        "law": [[_law_record(law) for law in row] for row in laws],
        "walls": json.loads(to_json(engine.walls[: engine.given_walls])),
        "gravity": asdict(options.gravity)
        if isinstance(options.gravity, RotatingGravity)
        else engine.gravity,
        "forces": [_force_record(force) for force in engine.force_steps.forces],
        "collapse": None
        if options.collapse is None
        else [type(options.collapse).__name__, asdict(options.collapse)],
        "device": asdict(options.device),
        "record": sorted(options.record),
        "seed": options.seed,
        "species": dict(engine.kinds.species),
    }
    record: dict[str, Any] = json.loads(json.dumps(found))
    return record


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Names of what differs between two gases, but for what changes no bit: threads, and where pistons are."""
    a, b = _compared(one), _compared(other)
    return [name for name in a if a[name] != b.get(name)]


def arguments(
    record: dict[str, Any],
    displacements: Sequence[float],
    *,
    law: Any,
    forces: Sequence[Force] | None = None,
    device: Device | str | None = None,
) -> dict[str, Any]:
    """Arguments of `Simulation` from a record, but for disks, state, tracked ids and ranks.

    Pistons are at these displacements [length]. `law` is used (`laws_of`), and `forces` and `device` in place of those
    of the record.

    InputError if a custom force is not given, or the device differs in more than threads and `low_memory`.
    """
    was = Device(**record["device"])
    chosen = was if device is None else Device.of(device)
    if replace(chosen, threads=was.threads, low_memory=was.low_memory) != was:
        raise InputError(f"device = {chosen}: must be {was}; only threads and low_memory may differ")
    gravity, collapse = record["gravity"], record["collapse"]
    given = from_json(json.dumps(record["walls"]))
    return {
        "box": Box(**_with_tuples(record["box"])),
        "law": law,
        "walls": at_displacements(given, displacements),
        "gravity": RotatingGravity(**_with_tuples(gravity)) if isinstance(gravity, dict) else tuple(gravity),
        "forces": _forces_of(record["forces"]) if forces is None else forces,
        "collapse": None if collapse is None else _COLLAPSES[collapse[0]](**collapse[1]),
        "device": chosen,
        "record": record["record"],
        "seed": record["seed"],
    }  # fmt: skip


def _with_tuples(record: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in record.items()}


def _compared(record: dict[str, Any]) -> dict[str, Any]:
    free = ("threads", "low_memory")
    device = {key: value for key, value in record["device"].items() if key not in free}
    left_out = ("k", "path")
    law = [[{key: one[key] for key in one if key not in left_out} for one in row] for row in record["law"]]
    given = [dict(wall) for wall in record["walls"]]
    for wall in given:
        if piston := wall.get("piston"):  # where a piston starts, as where disks do
            wall["piston"] = {key: piston[key] for key in piston if key not in ("displacement", "velocity")}
    return {**record, "device": device, "law": law, "walls": given}


def _force_record(force: Force) -> dict[str, Any]:
    """Class, step and values of a force, and all other attributes of one of ours; a custom one is not restored."""
    record = {"kind": type(force).__name__, "step": force.step, "values": force.values}
    if type(force) not in _forces():
        return record | {"kind": f"custom {record['kind']}"}
    return record | {name: value for name, value in vars(force).items() if name not in _OF_EACH}


def _law_record(law: CollisionLaw) -> dict[str, Any]:
    if source_of(law) is not None or any(type(law) is kind for kind, _ in ARGUMENTS.values()):
        return to_record(law)
    return {"law": f"custom {law!r}"}


def laws_of(record: dict[str, Any], path: str | os.PathLike[str]) -> list[list[CollisionLaw]]:
    """The laws of a record in a checkpoint file; the code of custom ones from files is executed.

    InputError for other custom laws, and for files that are not there or have changed.
    """
    table = record["law"]
    if (kind := table[0][0]["law"]) not in ARGUMENTS and not is_custom(table[0][0]):
        raise InputError(
            f"{os.fspath(path)}: law = None: must be the {kind} of the gas: a checkpoint does not hold its code"
        )
    try:
        return [[from_record(one, Path(path).parent) for one in row] for row in table]
    except InputError as error:
        raise InputError(f"{os.fspath(path)}: {error}") from None


def _forces() -> list[type[Force]]:
    """Classes of the forces that the program has. Imports Taichi."""
    from ...model import forces

    found = [getattr(forces, name) for name in forces.__all__]
    return [
        each for each in found if isinstance(each, type) and each not in (forces.Force, forces.PoissonForce)
    ]


def _forces_of(record: list[dict[str, Any]]) -> list[Force]:
    if any(each["kind"].startswith("custom") for each in record):
        raise InputError(
            f"forces = None: must be the forces of the gas, {', '.join(each['kind'] for each in record)}: a "
            "checkpoint does not hold the code of custom ones"
        )
    if not record:
        return []
    from ...model.forces import Force

    known, found = {each.__name__: each for each in _forces()}, []
    for each in record:
        force = object.__new__(known[each["kind"]])  # not by its arguments, of which it may keep others
        Force.__init__(force, each["step"], **each["values"])
        others = {name: value for name, value in each.items() if name not in ("kind", "step", "values")}
        vars(force).update(_with_tuples(others))
        found.append(force)
    return found
