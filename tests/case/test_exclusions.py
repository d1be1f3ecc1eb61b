"""What cannot go with what: one gas for each exclusion, refused by `Simulation` and by the case alike, both at once.

`Simulation` refuses before the runtime starts, a case before any work: `ifrdem check` and `ifrdem run` say the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ifrdem
from ifrdem import forces
from ifrdem.case.file import validated
from ifrdem.case.gas import CaseGas
from ifrdem.errors import InputError
from ifrdem.simulation import backend

SIDE = 40.0
PERIODIC, WALLED = (
    {"lengths": [SIDE, SIDE]},
    {"lengths": [SIDE, SIDE], "periodic": [True, False], "material": "a"},
)
ROOM, SHEARED = WALLED | {"periodic": [False, False]}, PERIODIC | {"shear_rate": 0.1}
OPEN, DOWN = {"open": True, "lengths": [100.0, 100.0]}, {"gravity": [0.0, -1.0]}
POST = {"shape": "post", "center": [35.0, 35.0], "radius": 0.5, "material": "a"}
PISTON = {
    "shape": "line",
    "point": [0.0, 34.0],
    "normal": [0.0, -1.0],
    "material": "a",
    "piston": {"mass": 10.0},
}
HIGH = PISTON | {"point": [0.0, 899.0]}
DRAG, KICKS = {"kind": "drag", "step": 0.1, "rate": 0.1}, {"kind": "random_force", "step": 0.1, "power": 1.0}
TABLE = {"kind": "table_friction", "step": 0.1, "mu": 0.2, "gravity": 9.81}
REST, TC = {"collapse": "rest", "resting_speed": 1e-3}, {"collapse": "tc", "contact_time": 1e-4}
WIDE = {"lengths": [900.0, 900.0]}
F32, LOW = {"precision": "f32"}, {"low_memory": True}
STRESS, HISTORIES = {"stress": True}, {"histories": [0]}
TURNS = DOWN | {"gravity_rotation_rate": 0.1}

# The gas, and words of both refusals: an argument, and the key of a case.
EXCLUDED: dict[str, tuple[dict[str, Any], str, str]] = {
    "gravity in open space": ({"box": OPEN | DOWN}, "gravity", "box: gravity"),
    "walls in open space": ({"box": OPEN, "wall": POST}, "walls", "wall"),
    "stress in open space": ({"box": OPEN, "output": STRESS}, 'record = "stress"', "output.stress"),
    "gravity along a period": ({"box": PERIODIC | DOWN}, "gravity", "box: gravity"),
    "gravity that turns along a period": ({"box": WALLED | TURNS}, "gravity", "box: gravity_rotation_rate"),
    "histories where gravity turns": ({"box": ROOM | TURNS, "output": HISTORIES}, "tracked", "output.histories"),
    "a piston where gravity turns": ({"box": ROOM | TURNS, "wall": PISTON}, "piston", "wall"),
    "a table under gravity": ({"box": WALLED | DOWN, "force": TABLE}, "table", "force[0].kind"),
    "walls in a sheared box": ({"box": SHEARED, "wall": POST}, "walls", "wall"),
    "histories in a sheared box": ({"box": SHEARED, "output": HISTORIES}, "tracked", "output.histories"),
    "sums of no walls": ({"box": PERIODIC, "output": {"wall_sums": True}}, 'record = "wall"', "output.wall_sums"),
    "stress with resting disks": ({"box": WALLED | DOWN, "run": REST, "output": STRESS}, '"stress"', "output.stress"),
    "stress with a piston": ({"box": WALLED, "wall": PISTON, "output": STRESS}, 'record = "stress"', "output.stress"),
    "rest in single precision": ({"box": WALLED | DOWN, "run": REST | F32}, "f64", "run.collapse"),
    "rest of many disks": ({"box": WALLED | DOWN | WIDE, "run": REST, "number": 21_000}, "21000 disks", "run.collapse"),
    "rest without gravity": ({"box": WALLED, "run": REST}, "gravity", "run.collapse"),
    "rest with a force": ({"box": WALLED | DOWN, "run": REST, "force": DRAG}, "forces", "run.collapse"),
    "rest in a sheared box": ({"box": SHEARED, "run": REST}, "collapse", "run.collapse"),
    "a piston in single precision": ({"box": WALLED, "wall": PISTON, "run": F32}, "f32", "wall"),
    "a piston of many disks": ({"box": WALLED | WIDE, "wall": HIGH, "number": 21_000}, "21000 disks", "wall"),
    "a piston with resting disks": ({"box": WALLED | DOWN, "wall": PISTON, "run": REST}, "collapse", "wall"),
    "random kicks of one disk": ({"box": WALLED, "force": KICKS, "number": 1}, "random kicks", "force[0].kind"),
    "low memory with walls": ({"box": WALLED, "run": LOW}, "low_memory", "run.low_memory"),
    "low memory with a force": ({"box": PERIODIC, "run": LOW, "force": DRAG}, "low_memory", "run.low_memory"),
    "low memory in a sheared box": ({"box": SHEARED, "run": LOW}, "low_memory", "run.low_memory"),
    "low memory with a contact time": ({"box": PERIODIC, "run": LOW | TC}, "low_memory", "run.low_memory"),
}  # fmt: skip

TAKEN: dict[str, dict[str, Any]] = {
    "open": {"box": OPEN},
    "gravity": {
        "box": WALLED | DOWN,
        "wall": PISTON,
        "output": {"wall_sums": True, "histories": [0]},
        "run": TC,
    },
    "gravity that turns": {"box": ROOM | TURNS, "wall": POST},
    "table": {"box": PERIODIC, "force": TABLE},
    "sheared": {"box": SHEARED, "output": {"stress": True}},
    "rest": {"box": WALLED | DOWN, "run": REST, "output": {"wall_sums": True}},
    "stress": {"box": WALLED, "wall": POST, "run": F32, "output": {"stress": True}},
    "one disk": {"box": WALLED, "force": DRAG, "number": 1},
    "kicks": {"box": PERIODIC, "force": KICKS},
    "low memory": {"box": PERIODIC, "run": LOW, "output": {"stress": True}},
}


class Started(Exception):
    """The runtime would start."""


def arguments(gas: dict[str, Any]) -> dict[str, Any]:
    """The same gas for `Simulation`."""
    n, box, run, output = gas.get("number", 2), gas["box"], gas.get("run", {}), gas.get("output", {})
    rows = int(np.sqrt(n)) + 1
    place = np.stack([np.arange(n) % rows, np.arange(n) // rows], axis=1) * 1.5 + 1.0
    down = tuple(box.get("gravity", (0.0, 0.0)))
    rate = box.get("gravity_rotation_rate")
    collapse = {"rest": ifrdem.Rest(1e-3), "tc": ifrdem.ContactTime(1e-4)}.get(run.get("collapse", ""))
    kinds = {
        "drag": lambda: forces.Drag(step=0.1, rate=0.1), "random_force": lambda: forces.RandomKicks(0.1, power=1.0),
        "table_friction": lambda: forces.TableFriction(step=0.1, mu=0.2),
    }  # fmt: skip
    shapes = {
        "post": lambda: ifrdem.Wall.post((35.0, 35.0), 0.5),
        "line": lambda: ifrdem.Wall.line(gas["wall"]["point"], (0.0, -1.0), piston=ifrdem.Piston(mass=10.0)),
    }
    space = ifrdem.Box.open()
    if not box.get("open"):
        space = ifrdem.Box(
            tuple(box["lengths"]), tuple(box.get("periodic", (True, True))), box.get("shear_rate", 0.0)
        )
    return {
        "disks": ifrdem.Disks(n, mass=1.0, radius=0.5), "box": space,
        "state": ifrdem.State(place, np.random.default_rng(1).normal(size=(n, 2)), np.zeros(n)),
        "law": ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.1), "collapse": collapse,
        "gravity": ifrdem.RotatingGravity(down, rate=rate) if rate else down,
        "walls": [shapes[gas["wall"]["shape"]]()] if "wall" in gas else [],
        "forces": [kinds[gas["force"]["kind"]]()] if "force" in gas else [],
        "record": [each for each, key in (("stress", "stress"), ("wall", "wall_sums")) if output.get(key)],
        "tracked": output.get("histories", []),
        "device": ifrdem.Device(threads=1, **{key: run[key] for key in ("precision", "low_memory") if key in run}),
    }  # fmt: skip


def refused_by_python(gas: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> str:
    def start(*_: object) -> None:
        raise Started

    monkeypatch.setattr(backend, "start_on_ranks", start)
    try:
        ifrdem.Simulation(**arguments(gas))
    except InputError as error:
        return str(error)
    except Started:
        return ""
    raise AssertionError


def refused_by_case(gas: dict[str, Any]) -> str:
    case: dict[str, Any] = {
        "run": {"name": "case", "units": "reduced", "t_end": 2.0, "threads": 1} | gas.get("run", {}),
        "box": gas["box"], "output": gas.get("output", {}),
        "material": [{"name": "a", "e_n": 0.9, "e_t": -1.0, "mu": 0.1}],
        "species": [
            {"name": "s", "number": gas.get("number", 2), "material": "a", "mass": 1.0, "radius": 0.5, "speed_rms": 1.0}
        ],
    }  # fmt: skip
    case |= {key: [gas[key]] for key in ("wall", "force") if key in gas}
    try:
        sections, problems = validated(case)
        if sections is None:
            return "\n".join(map(str, problems))
        CaseGas.from_case(sections, Path())
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", EXCLUDED)
def test_both_doors_refuse_what_cannot_go_together(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    gas, argument, key = EXCLUDED[name]
    assert argument in refused_by_python(gas, monkeypatch)
    assert key in refused_by_case(gas)


@pytest.mark.parametrize("name", TAKEN)
def test_both_doors_take_what_can(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert refused_by_python(TAKEN[name], monkeypatch) == ""
    assert refused_by_case(TAKEN[name]) == ""
