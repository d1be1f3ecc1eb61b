"""The one description of a gas: cases, simulations and checkpoints are made from it."""

from __future__ import annotations

import inspect
import json
import warnings
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from ifrdem import Box, ContactTime, Device, IFRLaw, InputError, Motion, RotatingGravity, Simulation, Wall
from ifrdem.case import file as case_file
from ifrdem.case import shipped
from ifrdem.model.forces import Force, Langevin, RandomKicks
from ifrdem.model.laws.walton import Walton
from ifrdem.model.setup import Setup
from ifrdem.simulation.checkpoints import checkpoint

# Two records as checkpoints of format 11 held them before there was a `Setup`.
WALLED = json.loads(
    '{"box": {"lengths": [9.0, 9.0], "periodic": [true, false], "shear_rate": 0.0}, "law": [[{"law": "ifr", '
    '"e_n": 0.9, "e_t": -0.5, "mu": 0.2, "sticking": "percussion_center", "rho": 0.01, "k": 1.0}]], "walls": '
    '[{"shape": "post", "origin": [7.5, 7.5], "towards": [0.0, 0.0], "radius": 0.25, "angles": [0.0, '
    '6.283185307179586], "points": [], "holds": "both", "material": 0, "motion": {"kind": "sine", "direction": '
    '[0.0, 1.0], "speed": 0.0, "amplitude": 0.1, "frequency": 0.5, "phase": 0.0, "rise": 0.5}, "turn": {"kind": '
    '"still", "center": [0.0, 0.0], "rate": 0.0, "amplitude": 0.0, "frequency": 0.0, "phase": 0.0}, "moves_from": '
    'null, "moves_until": null, "opens_at": null, "opens_after": null, "surface_speed": 0.0, "temperature": null, '
    '"group": "", "piston": null}], "gravity": [0.0, 0.0], "forces": [{"kind": "RandomKicks", "step": 0.1, '
    '"values": {"power": 0.5, "diffusion": 0.0}}, {"kind": "Langevin", "step": 0.2, "values": {"temperature": 1.0, '
    '"rate": 0.3, "spin_temperature": 1.0, "spin_rate": 0.0}}], "collapse": ["ContactTime", {"time": 0.001}], '
    '"device": {"name": "cpu", "threads": 1, "precision": "f64", "window_collisions": null, "low_memory": false}, '
    '"record": ["dissipated", "ledger", "wall_sums"], "seed": 7}'
)
TURNING = json.loads(
    '{"box": {"lengths": [9.0, 9.0], "periodic": [false, false], "shear_rate": 0.0}, "law": [[{"law": "walton", '
    '"e_n": 0.9, "beta_0": 0.3, "mu": 0.2}]], "walls": [], "gravity": {"start": [0.0, -1.0], "rate": 0.1, "step": '
    '0.005}, "forces": [], "collapse": null, "device": {"name": "cpu", "threads": 1, "precision": "f64", '
    '"window_collisions": null, "low_memory": false}, "record": [], "seed": 0}'
)
POST = Wall.post((7.5, 7.5), 0.25, motion=Motion("sine", amplitude=0.1, frequency=0.5))
SETUPS: dict[str, tuple[Setup, dict[str, Any]]] = {
    "walled": (
        Setup(
            Box((9.0, 9.0), (True, False)),
            ((IFRLaw(e_n=0.9, e_t=-0.5, mu=0.2, rho=0.01, k=1.0),),),
            (POST,),
            forces=(RandomKicks(0.1, power=0.5), Langevin(0.2, temperature=1.0, rate=0.3)),
            collapse=ContactTime(1e-3),
            device=Device(threads=1),
            record=frozenset(["dissipated", "wall_sums"]),
            seed=7,
        ),
        WALLED,
    ),
    "turning": (
        Setup(
            Box((9.0, 9.0), (False, False)),
            ((Walton(e_n=0.9, beta_0=0.3, mu=0.2),),),
            gravity=RotatingGravity((0.0, -1.0), rate=0.1),
            device=Device(threads=1),
        ),
        TURNING,
    ),
}


def test_its_fields_are_the_arguments_of_a_simulation_besides_disks_and_state() -> None:
    """An argument that only one of both had would be lost in checkpoints, or could not be given."""
    arguments = [*inspect.signature(Simulation.__init__).parameters]
    besides = ("self", "disks", "state", "histories", "comm")
    assert {each.name for each in fields(Setup)} == {each for each in arguments if each not in besides}


@pytest.mark.parametrize("name", SETUPS)
def test_the_record_is_that_of_checkpoints_before(name: str) -> None:
    """A key or a value in another form: older checkpoints would be those of another gas."""
    setup, record = SETUPS[name]
    assert setup.to_record() == record
    again = Setup.from_record(record)
    assert again.to_record() == record
    assert [(type(one), vars(one)) for one in again.forces] == [
        (type(one), vars(one)) for one in setup.forces
    ]
    assert replace(again, forces=()) == replace(setup, forces=())


def test_a_record_with_old_words_is_that_of_the_same_setup() -> None:
    """Names of `record=[...]` as checkpoints of earlier versions hold them, sorted."""
    setup, record = SETUPS["walled"]
    old = {**record, "record": ["disk_energy", "energy", "wall"]}
    assert Setup.from_record(old).to_record() == record
    assert checkpoint.differences(setup.to_record(), old) == []
    assert checkpoint.differences(replace(setup, record=frozenset(["last_partner"])).to_record(), old) == [
        "record"
    ]


def test_the_records_of_all_shipped_cases_make_the_same_setups_again() -> None:
    for name in shipped.names():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            setup = case_file.read(shipped.find(name)).gas.setup
            record = setup.to_record()
            assert json.loads(json.dumps(record)) == record
            again = Setup.from_record(record)
        assert again.to_record() == record, name
        assert np.array_equal(again.law_rows, setup.law_rows), name
        assert replace(again, forces=()) == replace(setup, forces=()), name


def test_regions_are_in_the_record_of_a_gas_that_has_some() -> None:
    """Records without them are those of versions before, which had none."""
    setup = replace(SETUPS["walled"][0], regions={"left": (0, 0, 1, 2)})
    record = setup.to_record()
    assert record == WALLED | {"regions": {"left": [0.0, 0.0, 1.0, 2.0]}}
    assert Setup.from_record(record).regions == {"left": (0.0, 0.0, 1.0, 2.0)}


def test_a_record_without_the_code_of_a_force_needs_it() -> None:
    class Wind(Force):
        def act(self, disk: Any, p: Any) -> Any:
            return disk

    setup = replace(SETUPS["walled"][0], forces=(Wind(0.1),))
    record = setup.to_record()
    assert record["forces"] == [{"kind": "custom Wind", "step": 0.1, "values": {}}]
    with pytest.raises(InputError, match="forces = None: must be the forces of the gas, custom Wind"):
        Setup.from_record(record)
    assert Setup.from_record(record, forces=setup.forces).forces == setup.forces


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("gravity", (1.0,), r"gravity = \(1\.0,\): must be a sequence of 2, each a finite number"),
        ("forces", RandomKicks(0.1, power=1.0), r"forces = <RandomKicks.*: must be a list of forces"),
        ("forces", [Force(0.1)], r"forces\[0\] = .*: must be an object of a class derived from"),
        ("collapse", "rest", r"collapse = 'rest': must be VelocityCutoff\(speed\)"),
        ("device", "gpu", "device = 'gpu': must be"),
        ("record", ["ledgr"], r"record: unknown name 'ledgr' \(did you mean 'ledger'\?\)"),
        (
            "regions",
            {"a": (1, 0, 0, 1)},
            r"regions\['a'\] = \(1, 0, 0, 1\): must be \[x_low, y_low, x_high, y_high\]",
        ),
        ("regions", {"a": (0, 1)}, r"regions\['a'\] has shape \(2,\)"),
        ("regions", [(0, 0, 1, 1)], r"regions = \[\(0, 0, 1, 1\)\]: must be a mapping of names"),
        ("seed", -1, "seed = -1: must be"),
    ],
)
def test_a_value_that_is_none_is_refused_by_name(name: str, value: Any, text: str) -> None:
    """Also where it is changed between runs, which replaces the field."""
    with pytest.raises(InputError, match=text):
        replace(SETUPS["walled"][0], **{name: value})
