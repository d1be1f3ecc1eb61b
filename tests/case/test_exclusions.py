"""Exclusions: one gas for each row of `model.rules`, refused by `Simulation` and by the case alike.

`Simulation` refuses before the runtime starts, a case before any work: `ifrdem check` and `ifrdem run` say the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ifrdem
from ifrdem import forces, laws
from ifrdem.case import exclusions
from ifrdem.case.file import validated
from ifrdem.case.gas import CaseGas
from ifrdem.errors import InputError
from ifrdem.model import rules
from ifrdem.model.setup import Setup
from ifrdem.simulation import backend
from ifrdem.simulation.start.checks import check_exclusions

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
DRAG, KICKS = {"kind": "drag", "step": 0.1, "rate": 0.1}, {"kind": "random_kicks", "step": 0.1, "power": 1.0}
TABLE = {"kind": "table_friction", "step": 0.1, "mu": 0.2, "gravity": 9.81}
REST, TC = {"collapse": "rest", "resting_speed": 1e-3}, {"collapse": "contact_time", "contact_time": 1e-4}
WIDE = {"lengths": [900.0, 900.0]}
F32, LOW = {"precision": "f32"}, {"low_memory": True}
STRESS, HEAT, HISTORIES = {"stress": True}, {"heat_flux": True}, {"histories": [0]}
TURNS = DOWN | {"gravity_rotation_rate": 0.1}

# Of names of rules: how `Simulation` says them, and how a case does; "" where a case has no such key.
WORDS = {
    "box.open": ("box = Box.open()", "box.open = true"), "box.periodic": ("box.periodic = ", "box.periodic = "),
    "box.shear_rate": ("box.shear_rate = 0.1", "box.shear_rate = 0.1"), "gravity": ("gravity = (", "box.gravity = ["),
    "gravity.rate": ("gravity = RotatingGravity(", "box.gravity_rotation_rate = 0.1"), "walls": ("walls", "wall"),
    "walls.piston": ("walls[0].piston", "wall[0].piston"), "forces": ("forces = [<Drag", 'force[0].kind = "drag"'),
    "forces.TableFriction": ("forces[0] = <TableFriction", 'force[0].kind = "table_friction"'),
    "forces.RandomKicks": ("forces[0] = <RandomKicks", 'force[0].kind = "random_kicks"'),
    "collapse": ("collapse = ContactTime(", 'run.collapse = "contact_time"'),
    "collapse.Rest": ("collapse = Rest(", 'run.collapse = "rest"'),
    "law": ("law = Walton", 'material[0].law = "walton"'),
    "record.stress": ('record = "stress"', "output.stress = true"),
    "record.heat_flux": ('record = "heat_flux"', "output.heat_flux = true"),
    "record.wall_sums": ('record = "wall_sums"', "output.wall_sums = true"),
    "histories": ("histories", "output.histories = [0]"),
    "device.name": ('device.name = "cuda"', 'run.device = "cuda"'), "disks.n": ("{} disk", "{} disk"),
    "device.precision": ('device.precision = "f32"', 'run.precision = "f32"'), "order": ("order = ", ""),
    "device.low_memory": ("device.low_memory = True", "run.low_memory = true"),
    "disks.mass": ("disks of infinite mass", ""), "comm": ("comm of 2 ranks", ""),
}  # fmt: skip
CUDA, INF, TWO = {"device": "cuda"}, {"mass": np.inf}, {"ranks": 2}
FELL, REAL = {"box": WALLED | DOWN, "run": REST}, {"box": WALLED, "wall": PISTON}
# By the rule, the gas that breaks this one alone.
EXCLUDED: dict[tuple[str, str], dict[str, Any]] = {
    ("gravity", "box.open"): {"box": OPEN | DOWN}, ("walls", "box.open"): {"box": OPEN, "wall": POST},
    ("record.stress", "box.open"): {"box": OPEN, "output": STRESS},
    ("record.heat_flux", "box.open"): {"box": OPEN, "output": HEAT}, ("comm", "box.open"): {"box": OPEN} | TWO,
    ("gravity", "box.periodic"): {"box": PERIODIC | DOWN}, ("gravity.rate", "box.periodic"): {"box": WALLED | TURNS},
    ("histories", "gravity.rate"): {"box": ROOM | TURNS, "output": HISTORIES},
    ("comm", "gravity.rate"): {"box": ROOM | TURNS} | TWO,
    ("walls.piston", "gravity.rate"): {"box": ROOM | TURNS, "wall": PISTON},
    ("forces.TableFriction", "gravity"): {"box": WALLED | DOWN, "force": TABLE},
    ("box.shear_rate", "box.periodic"): {"box": WALLED | {"shear_rate": 0.1}},
    ("walls", "box.shear_rate"): {"box": SHEARED, "wall": POST},
    ("histories", "box.shear_rate"): {"box": SHEARED, "output": HISTORIES},
    ("disks.mass", "box.shear_rate"): {"box": SHEARED} | INF,
    ("record.wall_sums", "walls"): {"box": PERIODIC, "output": {"wall_sums": True}},
    ("record.stress", "collapse.Rest"): FELL | {"output": STRESS},
    ("record.heat_flux", "collapse.Rest"): FELL | {"output": HEAT},
    ("record.stress", "walls.piston"): REAL | {"output": STRESS},
    ("record.heat_flux", "walls.piston"): REAL | {"output": HEAT},
    ("record.heat_flux", "box.shear_rate"): {"box": SHEARED, "output": HEAT},
    ("collapse.Rest", "device.name"): FELL | {"run": REST | CUDA},
    ("collapse.Rest", "device.precision"): FELL | {"run": REST | F32},
    ("collapse.Rest", "disks.n"): {"box": WALLED | DOWN | WIDE, "run": REST, "number": 21_000},
    ("collapse.Rest", "gravity"): {"box": WALLED, "run": REST}, ("collapse.Rest", "law"): FELL | {"law": "walton"},
    ("collapse.Rest", "forces"): FELL | {"force": DRAG},
    ("comm", "collapse.Rest"): FELL | TWO,
    ("walls.piston", "device.name"): REAL | {"run": CUDA}, ("walls.piston", "device.precision"): REAL | {"run": F32},
    ("walls.piston", "order"): REAL | {"order": "tiled"},
    ("walls.piston", "disks.n"): {"box": WALLED | WIDE, "wall": HIGH, "number": 21_000},
    ("walls.piston", "collapse.Rest"): FELL | {"wall": PISTON}, ("comm", "walls.piston"): REAL | TWO,
    ("forces.RandomKicks", "disks.n"): {"box": WALLED, "force": KICKS, "number": 1},
    ("forces", "disks.mass"): {"box": PERIODIC, "force": DRAG} | INF,
    ("gravity", "disks.mass"): {"box": WALLED | DOWN} | INF,
    ("device.low_memory", "walls"): {"box": PERIODIC, "wall": POST, "run": LOW},
    ("device.low_memory", "forces"): {"box": PERIODIC, "run": LOW, "force": DRAG},
    ("device.low_memory", "box.shear_rate"): {"box": SHEARED, "run": LOW},
    ("device.low_memory", "collapse"): {"box": PERIODIC, "run": LOW | TC},
    ("comm", "device.precision"): {"box": PERIODIC, "run": F32} | TWO,
    ("comm", "order"): {"box": PERIODIC, "order": "serial"} | TWO,
    ("comm", "histories"): {"box": PERIODIC, "output": HISTORIES, "most": 2**31} | TWO,
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
    """Arguments of `Simulation` for this gas."""
    n, box, run, output = gas.get("number", 2), gas["box"], gas.get("run", {}), gas.get("output", {})
    rows = int(np.sqrt(n)) + 1
    place = np.stack([np.arange(n) % rows, np.arange(n) // rows], axis=1) * 1.5 + 1.0
    velocity = np.random.default_rng(1).normal(size=(n, 2))
    velocity[: "mass" in gas] = 0.0  # an immovable disk is at rest
    down = tuple(box.get("gravity", (0.0, 0.0)))
    rate = box.get("gravity_rotation_rate")
    collapse = {"rest": ifrdem.Rest(1e-3), "contact_time": ifrdem.ContactTime(1e-4)}.get(
        run.get("collapse", "")
    )
    kinds = {
        "drag": lambda: forces.Drag(step=0.1, rate=0.1), "random_kicks": lambda: forces.RandomKicks(0.1, power=1.0),
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
        "disks": ifrdem.Disks(n, mass=[gas.get("mass", 1.0)] + [1.0] * (n - 1), radius=0.5), "box": space,
        "state": ifrdem.State(place, velocity, np.zeros(n)),
        "law": laws.Walton(e_n=0.9, beta_0=0.5, mu=0.1) if "law" in gas else ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.1),
        "collapse": collapse,
        "gravity": ifrdem.RotatingGravity(down, rate=rate) if rate else down,
        "walls": [shapes[gas["wall"]["shape"]]()] if "wall" in gas else [],
        "forces": [kinds[gas["force"]["kind"]]()] if "force" in gas else [],
        "record": [each for each in ("stress", "heat_flux", "wall_sums") if output.get(each)],
        "histories": output.get("histories", []),
        "device": ifrdem.Device(
            run.get("device", "cpu"), threads=1, **{key: run[key] for key in ("precision", "low_memory") if key in run}
        ),
    }  # fmt: skip


def refused_by_python(gas: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> str:
    """What `Simulation` says of a gas; of ranks, and of an order of tiles, what its engine asks the rules."""

    def start(*_: object) -> None:
        raise Started

    monkeypatch.setattr(backend, "start_on_ranks", start)
    try:
        given = arguments(gas)
        if "ranks" in gas or "order" in gas:
            names = ("box", "walls", "device", "gravity", "forces", "collapse", "record")
            setup = Setup(law=((given["law"],),), **{name: given[name] for name in names})
            check_exclusions(
                setup, n=gas.get("most", 2), immovable=False, histories="histories" in gas.get("output", {}),
                ranks=gas.get("ranks", 1), order=gas.get("order", ""),
            )  # fmt: skip
        else:
            ifrdem.Simulation(**given)
    except InputError as error:
        return str(error)
    except Started:
        return ""
    return ""


def case_of(gas: dict[str, Any]) -> dict[str, Any]:
    """The same gas as a case."""
    law = {"law": "walton", "beta_0": 0.5} if "law" in gas else {"e_t": -1.0}
    case: dict[str, Any] = {
        "run": {"name": "case", "units": "reduced", "t_end": 2.0, "threads": 1} | gas.get("run", {}),
        "box": gas["box"], "output": gas.get("output", {}),
        "material": [{"name": "a", "e_n": 0.9, "mu": 0.1} | law],
        "species": [
            {"name": "s", "number": gas.get("number", 2), "material": "a", "mass": 1.0, "radius": 0.5, "speed_rms": 1.0}
        ],
    }  # fmt: skip
    return case | {key: [gas[key]] for key in ("wall", "force") if key in gas}


def refused_by_case(case: dict[str, Any]) -> str:
    try:
        sections, problems = validated(case)
        if sections is None:
            return "\n".join(map(str, problems))
        CaseGas.from_case(sections, Path())
    except InputError as error:
        return str(error)
    return ""


def of_ranks(gas: dict[str, Any]) -> str:
    """The keys for which ranks cannot share the gas of a case."""
    case = case_of(gas)
    case["species"][0]["number"] = gas.get("most", 2)
    sections, _ = validated(case)
    assert sections is not None
    return " and ".join(exclusions.undivided(sections))


def test_each_rule_has_a_gas() -> None:
    assert [(rule.at, rule.with_) for rule in rules.RULES] == list(EXCLUDED)
    assert {name for rule in EXCLUDED for name in rule} == set(WORDS)
    assert {name for name, (_, key) in WORDS.items() if key} == set(exclusions.KEY_OF)


@pytest.mark.parametrize("rule", EXCLUDED, ids=" ".join)
def test_both_doors_refuse_what_cannot_go_together(
    rule: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    gas = EXCLUDED[rule]
    (at, at_key), (other, other_key) = (
        [word.format(gas.get("number", 2)) for word in WORDS[name]] for name in rule
    )
    if rule == ("box.shear_rate", "box.periodic"):  # of Box
        at, other = "shear_rate = 0.1", "periodic = ("
    said = refused_by_python(gas, monkeypatch)
    assert len(said.splitlines()) == 1  # this rule alone
    assert said.startswith(at)
    assert f": cannot be combined with {other}" in said
    if rule[0] == "comm":
        assert of_ranks(gas).startswith(other_key)
    elif other_key and at_key:
        said = refused_by_case(case_of(gas))
        assert len(said.splitlines()) == 1
        assert said.startswith(at_key)
        assert f": cannot be combined with {other_key}" in said

    if rule == ("collapse.Rest", "gravity"):
        return  # left out, the height of jumps cannot be computed
    # No second statement of it: without the row, the same gas is taken.
    monkeypatch.setattr(rules, "RULES", [row for row in rules.RULES if (row.at, row.with_) != rule])
    assert refused_by_python(gas, monkeypatch) == ""
    assert of_ranks(gas) == "" if rule[0] == "comm" else refused_by_case(case_of(gas)) == ""


def test_exclusions_are_found_beside_keys_that_are_wrong_all_at_once() -> None:
    """A wrong key counts as not given: `gravity` with a text acts nowhere, and `precision` is that by default."""
    gas = {
        "box": SHEARED,
        "wall": POST,
        "output": HISTORIES | {"wall_sums": True},
        "run": LOW | {"threads": -1},
    }
    said = refused_by_case(case_of(gas)).splitlines()
    found = [line for line in said if "cannot be combined with box.shear_rate = 0.1" in line]
    assert [line.split(":")[0].split(" ")[0] for line in found] == [
        "wall",
        "output.histories",
        "run.low_memory",
    ]
    assert any(line.startswith("run.threads = -1") for line in said)
    wrong = {
        "box": PERIODIC | {"gravity": ["down", -1.0]},
        "run": REST | {"precision": "f16"},
        "wall": {"shape": "?"},
    }
    said = refused_by_case(case_of(wrong)).splitlines()
    assert not any("cannot be combined with run.precision" in line for line in said)
    assert not any(line.startswith("box.gravity = [") for line in said)
    assert any("box.gravity = [0.0, 0.0]: only gravity" in line for line in said)
    misspelt = case_of({"box": WALLED | DOWN, "run": REST, "law": "walton"})
    misspelt["material"][0]["law"] = "waltom"
    assert [line.split(":")[0] for line in refused_by_case(misspelt).splitlines()] == [
        'material[0].law = "waltom"'
    ]


@pytest.mark.parametrize("name", TAKEN)
def test_both_doors_take_what_can(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert refused_by_python(TAKEN[name], monkeypatch) == ""
    assert refused_by_case(case_of(TAKEN[name])) == ""
