"""The setup of a gas: everything that decides the course of a run, besides the disks and their state.

A gas is described in three forms, with one way between two of them:

======  ===========================================================  ==============================================
case    a recipe, in `ifrdem.case`: keys, units, alternatives,       made of a text, or in Python
        draws by a seed
Setup   what was made                                                made of a case's sections (`CaseGas.setup`), of
                                                                     the arguments of `Simulation`, which are its
                                                                     fields, or of a record (`Setup.from_record`)
record  a setup as JSON, which checkpoints hold                      made of a setup (`Setup.to_record`)
======  ===========================================================  ==============================================

No array of all disks is in a setup, so that every rank has it. What excludes what in it: `model/rules.py`.
"""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from ..errors import InputError, nearest, shortened
from ..tools import seeds
from ..tools.checked import Array, Numbers
from ..tools.old_words import present_record
from . import collapse as collapses
from . import gravity as gravities
from .box import Box
from .collapse import Collapse, ContactTime, Rest, VelocityCutoff
from .device import Device
from .gravity import Gravity, RotatingGravity
from .laws.files import source_of
from .laws.ifr import IFRLaw
from .laws.law import CollisionLaw
from .laws.pairs import rows_of, table_of
from .laws.records import ARGUMENTS, from_record, is_custom, to_record
from .rules import Facts
from .walls.wall import Wall, from_json, sides, to_json

if TYPE_CHECKING:
    from .forces import Force

RECORDABLE = {
    "ledger": "energy that collisions dissipate, by mechanism, and collisions by regime: `Measure`",
    "last_partner": "the disk or wall that each disk hit last: `State.last_partner`",
    "angle": "the angle by which each disk has turned: `State.angle`",
    "dissipated": "energy that each disk's collisions dissipate, by mechanism: `State.dissipated`; includes ledger",
    "stress": "momentum that collisions transfer, for the pressure tensor: `Measure.virial`",
    "heat_flux": "energy that collisions transfer, for the heat flux: `Measure.energy_transfer`; includes stress",
    "histograms": "collisions of each pair of species by angle of impact, normal speed and regime: "
    "`Measure.histograms`; includes ledger",
    "free_times": "also by the time since the latest collision of either disk; includes histograms",
    "wall_sums": "momentum, torque, work, heat and collisions of each wall: `wall_sums` and `Measure`",
}
INCLUDES = {
    "dissipated": "ledger", "free_times": "histograms", "histograms": "ledger", "heat_flux": "stress",
}  # fmt: skip
"""Records that another record includes, by the name of the latter."""
_COLLAPSES = {each.__name__: each for each in get_args(Collapse)}
_OF_EACH = ("_step", "_values")
"""Attributes that each force has; a record has them as step and values."""


@dataclass(frozen=True)
class Setup:
    """The setup of a gas; its fields are the arguments of `Simulation` of these names.

    Attributes
    ----------
    box : Box
    law : tuple of tuples of CollisionLaw
        A table, [material][material].
    walls : tuple of Wall
        Those among the disks, without the sides of the box.
    gravity : tuple of two floats, or RotatingGravity
        Acceleration of all disks [length/time^2].
    forces : tuple of Force
    collapse : VelocityCutoff, ContactTime, Rest or None
    device : Device
    record : frozenset of str
        Names of `RECORDABLE`, those included that others need.
    regions : mapping of str to four floats
        Rectangles (x_low, y_low, x_high, y_high) by name, whose disks are counted [length].
    seed : int

    Raises
    ------
    InputError
        If a gravity, a force, a remedy for collapse, a device, a name of what is recorded, a region or a seed is none.
    """

    box: Box
    law: tuple[tuple[CollisionLaw, ...], ...]
    walls: tuple[Wall, ...] = ()
    gravity: Gravity = (0.0, 0.0)
    forces: tuple[Force, ...] = ()
    collapse: Collapse | None = None
    device: Device = field(default_factory=Device)
    record: frozenset[str] = frozenset()
    regions: Mapping[str, tuple[float, float, float, float]] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        checked_values = {
            "law": tuple(map(tuple, self.law)),
            "walls": tuple(self.walls),
            "gravity": gravities.validate(self.gravity),
            "forces": _checked_forces(self.forces),
            "collapse": collapses.validate(self.collapse),
            "device": Device.of(self.device),
            "record": _checked_names(self.record),
            "regions": _checked_regions(self.regions),
            "seed": seeds.of_device(self.seed),
        }
        for name, value in checked_values.items():
            object.__setattr__(self, name, value)

    @property
    def arguments(self) -> dict[str, Any]:
        """The fields by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    # ------------------------------------------------------------------ what follows from it

    @functools.cached_property
    def all_walls(self) -> tuple[Wall, ...]:
        """The walls, and behind them those at the sides of the box."""
        return (*self.walls, *sides(self.box))

    @property
    def law_class(self) -> type[CollisionLaw]:
        """The class of all laws."""
        return type(self.law[0][0])

    @functools.cached_property
    def law_rows(self) -> Array:
        """Coefficients of the law for each pair of materials (`table_row`), shape (M, M, c)."""
        return rows_of(self.law)

    @property
    def recorded(self) -> list[str]:
        """Those quantities of a state (`state.RECORDED`) that the engine keeps up to date."""
        kept = {
            "latest_collision": isinstance(self.collapse, ContactTime) or "free_times" in self.record,
            "last_partner": "last_partner" in self.record,
            "angle": "angle" in self.record,
            "dissipated": "dissipated" in self.record,
        }
        return [name for name, there in kept.items() if there]

    @property
    def velocity_cutoff(self) -> float:
        """Cut-off for kernels [length/time]; 0 without."""
        return self.collapse.speed if isinstance(self.collapse, VelocityCutoff) else 0.0

    @property
    def contact_time(self) -> float:
        """Contact time for kernels [time]; 0 without."""
        return self.collapse.time if isinstance(self.collapse, ContactTime) else 0.0

    @property
    def resting_speed(self) -> float:
        """Resting speed for kernels [length/time]; 0 without."""
        return self.collapse.speed if isinstance(self.collapse, Rest) else 0.0

    @property
    def start_gravity(self) -> tuple[float, float]:
        """Gravity at time 0 [length/time^2]."""
        return self.gravity.start if isinstance(self.gravity, RotatingGravity) else self.gravity

    @property
    def has_ledger(self) -> bool:
        """True if dissipated energy is added up, by mechanism."""
        return "ledger" in self.record

    def facts(self, **others: Any) -> Facts:
        """The facts that rules ask for; `others` are those of no setup: n, immovable, histories, ranks, order."""
        kinds = [library_classes(force) for force in self.forces]
        return Facts(
            is_open=self.box.is_open, periodic=self.box.periodic, shear_rate=self.box.shear_rate,
            walls=len(self.walls), pistons=sum(wall.piston is not None for wall in self.walls),
            gravity=self.start_gravity, rotating=isinstance(self.gravity, RotatingGravity),
            forces=frozenset[str]().union(*kinds), collapse=type(self.collapse).__name__ if self.collapse else "",
            law="" if self.law_class is IFRLaw else self.law_class.__name__, record=self.record,
            device=self.device.name, precision=self.device.precision, low_memory=self.device.low_memory, **others,
        )  # fmt: skip

    # ------------------------------------------------------------------ its record

    def to_record(self) -> dict[str, Any]:
        """The record; custom forces, and custom laws that are from no file, are only named in it."""
        found = {
            "box": asdict(self.box),
            "law": [[_law_record(law) for law in row] for row in self.law],
            "walls": json.loads(to_json(self.walls)),
            "gravity": asdict(self.gravity) if isinstance(self.gravity, RotatingGravity) else self.gravity,
            "forces": [_force_record(force) for force in self.forces],
            "collapse": None
            if self.collapse is None
            else [type(self.collapse).__name__, asdict(self.collapse)],
            "device": asdict(self.device),
            "record": sorted(self.record),
            **({"regions": dict(self.regions)} if self.regions else {}),
            "seed": self.seed,
        }
        record: dict[str, Any] = json.loads(json.dumps(found))
        return record

    @classmethod
    def from_record(
        cls,
        record: Mapping[str, Any],
        path: str | os.PathLike[str] = "record",
        *,
        law: CollisionLaw | Sequence[Sequence[CollisionLaw]] | None = None,
        forces: Sequence[Force] | None = None,
        device: Device | str | None = None,
    ) -> Setup:
        """The setup of the record in a file; `law`, `forces` and `device` are taken in place of those of the record.

        InputError if a custom law (`laws_of`) or a custom force is not given, or the device differs in more than
        threads and `low_memory`.
        """
        was = Device(**record["device"])
        chosen = was if device is None else Device.of(device)
        if replace(chosen, threads=was.threads, low_memory=was.low_memory) != was:
            raise InputError(f"device = {chosen}: must be {was}; only threads and low_memory may differ")
        gravity, collapse = record["gravity"], record["collapse"]
        table = laws_of(record, path) if law is None else law
        return cls(
            box=Box(**_with_tuples(record["box"])),
            law=tuple(map(tuple, table_of(table, len(record["law"])))),
            walls=tuple(from_json(json.dumps(record["walls"]))),
            gravity=RotatingGravity(**_with_tuples(gravity)) if isinstance(gravity, dict) else gravity,
            forces=_forces_of(record["forces"]) if forces is None else forces,  # type: ignore[arg-type]  # checked there
            collapse=None if collapse is None else _COLLAPSES[collapse[0]](**collapse[1]),
            device=chosen,
            record=frozenset(present_record(record["record"])),
            regions=record.get("regions", {}),  # which checkpoints of versions before had not
            seed=record["seed"],
        )


def library_classes(force: Force) -> frozenset[str]:
    """Names of the classes of this library that a force is of."""
    return frozenset(
        kind.__name__ for kind in type(force).__mro__ if kind.__module__ == "ifrdem.model.forces"
    )


def _checked_names(record: Iterable[str]) -> frozenset[str]:
    """Names of what is recorded, with those that others need: InputError for an unknown name."""
    known = ", ".join(RECORDABLE)
    names = list(record)
    for name in names:
        if name not in RECORDABLE:
            raise InputError(
                f"record: unknown name {shortened(name)}{nearest(name, RECORDABLE)}; must be of {known}"
            )
    found: set[str] = set()
    while names:
        name = names.pop()
        found.add(name)
        names += [INCLUDES[name]] if name in INCLUDES else []
    return frozenset(found)


def _checked_regions(regions: Any) -> dict[str, tuple[float, float, float, float]]:
    """Rectangles by name: InputError unless each has sides."""
    if not isinstance(regions, Mapping):
        raise InputError(
            f"regions = {shortened(regions)}: must be a mapping of names to (x_low, y_low, x_high, y_high)"
        )
    found = {}
    for name, given in regions.items():
        at = f"regions[{shortened(name)}]"
        if not isinstance(name, str) or not name:
            raise InputError(f"{at}: must have a name that is a text of one letter or more")
        x_low, y_low, x_high, y_high = Numbers((4,))(at, given).tolist()
        if not (x_low < x_high and y_low < y_high):
            raise InputError(f"{at} = {shortened(given)}: {RECTANGLE}")
        found[name] = (x_low, y_low, x_high, y_high)
    return found


RECTANGLE = "must be [x_low, y_low, x_high, y_high], each low one below the high one"


def _checked_forces(forces: Any) -> tuple[Force, ...]:
    """Forces as a tuple: InputError unless all are objects of classes with a method act."""
    if not isinstance(forces, Sequence) or isinstance(forces, str):
        raise InputError(f"forces = {shortened(forces)}: must be a list of forces, [force] for one")
    if not forces:
        return ()
    from .forces import Force  # imports Taichi, which is slow

    for i, force in enumerate(forces):
        if not isinstance(force, Force) or type(force).act is Force.act:
            raise InputError(
                f"forces[{i}] = {shortened(force)}: must be an object of a class derived from "
                "ifrdem.forces.Force, with a method act"
            )
    return tuple(forces)


def _with_tuples(record: Mapping[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in record.items()}


def _law_record(law: CollisionLaw) -> dict[str, Any]:
    if source_of(law) is not None or any(type(law) is kind for kind, _ in ARGUMENTS.values()):
        return to_record(law)
    return {"law": f"custom {law!r}"}


def laws_of(record: Mapping[str, Any], path: str | os.PathLike[str]) -> list[list[CollisionLaw]]:
    """The laws of the record in a file; the code of custom ones from files is executed.

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


def _force_classes() -> list[type[Force]]:
    """Classes of the forces that the program has. Imports Taichi."""
    from . import forces

    found = [getattr(forces, name) for name in forces.__all__]
    return [
        each for each in found if isinstance(each, type) and each not in (forces.Force, forces.PoissonForce)
    ]


def _force_record(force: Force) -> dict[str, Any]:
    """Class, step and values of a force, and all other attributes of one of ours; a custom one is not restored."""
    record = {"kind": type(force).__name__, "step": force.step, "values": force.values}
    if type(force) not in _force_classes():
        return record | {"kind": f"custom {record['kind']}"}
    return record | {name: value for name, value in vars(force).items() if name not in _OF_EACH}


def _forces_of(record: Sequence[Mapping[str, Any]]) -> list[Force]:
    if any(each["kind"].startswith("custom") for each in record):
        raise InputError(
            f"forces = None: must be the forces of the gas, {', '.join(each['kind'] for each in record)}: a "
            "checkpoint does not hold the code of custom ones"
        )
    if not record:
        return []
    from .forces import Force

    known, found = {each.__name__: each for each in _force_classes()}, []
    for each in record:
        force = object.__new__(known[each["kind"]])  # not by its arguments, of which it may keep others
        Force.__init__(force, each["step"], **each["values"])
        others = {name: value for name, value in each.items() if name not in ("kind", "step", "values")}
        vars(force).update(_with_tuples(others))
        found.append(force)
    return found
