"""Renamed words: those of users are refused with the present ones, those in files are read as before."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ifrdem
from ifrdem.analysis import gas_theory
from ifrdem.case import file as case_file
from ifrdem.case.case import CaseSections
from ifrdem.errors import RENAMED, InputError
from ifrdem.model.setup import Setup
from ifrdem.runs import compare
from ifrdem.study.lines import TheoryLine, theory_between
from ifrdem.study.results import Results
from ifrdem.study.task import Variable
from ifrdem.theory.choose import prediction
from ifrdem.tools.old_words import present_case

CASE = """
run = { name = "tc", t_end = 2.0, units = "reduced" }
box = { packing_fraction = 0.2 }
material = [{ name = "wall", e_n = 0.9, e_t = -0.8, mu = 0.2 }]
species = [{ name = "energy", number = 50, material = "wall", mass = 1.0, diameter = 1.0, speed_rms = 1.0 }]
force = [{ kind = "random_kicks", step = 0.1, power = 0.1 }]
start = { positions = "grown" }
output = { precision = "f64", histories = [0] }
"""
OLD = {
    '"random_kicks"': '"random_force"',
    '"grown"': '"lubachevsky_stillinger"',
    '"f64"': '"f8"',
    '"reduced" }': '"reduced", collapse = "tc", contact_time = 1e-3 }',
}
"""The same with old words, and with the remedy for collapse that was renamed."""


def old_text(*but: str) -> str:
    text = CASE
    for word, old in OLD.items():
        text = text if word in but else text.replace(word, old)
    return text


def recorded(word: str) -> None:
    law = ifrdem.IFRLaw(e_n=0.9, e_t=-0.8, mu=0.2)
    Setup(ifrdem.Box((9.0, 9.0)), ((law,),), record=[word])  # type: ignore[arg-type]  # checked there


def with_key(key: str) -> Callable[[str], Any]:
    return lambda word: case_file.of_text(CASE, Path("gas.toml"), [f"{key}={word}"])


def tracked(word: str) -> None:
    ifrdem.Simulation(**{word: [0]})  # type: ignore[arg-type]


DOORS: dict[str, Callable[[str], Any]] = {
    "energy": recorded, "disk_energy": recorded, "partner": recorded, "wall": recorded, "tracked": tracked,
    "grow": lambda word: getattr(ifrdem.initial, word), "tc": with_key("run.collapse"),
    "random_force": with_key("force[0].kind"), "random_torque": with_key("force[0].kind"),
    "lubachevsky_stillinger": with_key("start.positions"), "f4": with_key("output.precision"),
    "f8": with_key("output.precision"),
}  # fmt: skip
"""Where users wrote the old words."""


def test_every_old_word_is_refused_with_the_present_one() -> None:
    """A word without a door, or one whose message guesses at a spelling, would leave a user with an old script."""
    assert DOORS.keys() == RENAMED.keys()
    assert not {each for words in RENAMED.values() for each in words} & RENAMED.keys()
    for word, present in RENAMED.items():
        named = " or ".join(f'"{each}"' for each in present)
        with pytest.raises((InputError, AttributeError), match=rf"{word}.*\(it is called {named} now\)"):
            DOORS[word](word)


def test_names_of_the_writer_and_of_theory_are_refused_with_the_present_ones(tmp_path: Path) -> None:
    disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    with pytest.raises(InputError, match=r"""precision = 'f8'.*\(it is called "f64" now\)"""):
        ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, ifrdem.Box((9.0, 9.0)), precision="f8")
    law, force = ifrdem.IFRLaw(e_n=0.9, e_t=-0.8, mu=0.2), {"kind": "random_torque", "power": 1.0}
    with pytest.raises(
        InputError, match=r'random_torque \(it is called "spin_kicks" or "poisson_spin_kicks" now\):'
    ):
        prediction(disks, law, 0.2, 1.0, 0.0, [0.0, 1.0], forces=[force])


def test_a_stored_case_with_old_words_is_read_and_one_of_a_user_is_not() -> None:
    """Names that users chose stay, though they look like old words: of the run, of a material, of a species."""
    old, now = tomllib.loads(old_text()), tomllib.loads(CASE)
    now["run"] |= {"collapse": "contact_time", "contact_time": 1e-3}
    assert present_case(old) == now
    assert present_case(now) == now
    with pytest.raises(InputError) as found:
        case_file.of_text(old_text(), Path("gas.toml"))
    lines = str(found.value).splitlines()
    assert len(lines) == len(OLD)
    assert all("now)" in line for line in lines)
    assert case_file.of_text(old_text(), Path("gas.toml"), stored=True).case == CaseSections.model_validate(
        now
    )
    # The case of a trajectory, with an assignment of its command line.
    assert compare._case_of(old_text(), "run.seed=3\noutput.precision=f4").output.precision == "f32"


def test_theory_knows_the_forces_of_old_trajectories() -> None:
    old = [
        {"kind": "random_force", "rate": 2.0, "power": 1.0},
        {"kind": "random_torque", "step": 0.1, "power": 1.0},
    ]
    assert [each["kind"] for each in gas_theory._forces(old)] == ["poisson_kicks", "spin_kicks"]


@pytest.mark.full
def test_theory_between_the_points_of_an_old_study_is_that_of_a_new_one() -> None:
    rows = ("e_n", "time")
    variables = {
        "e_n": Variable(("e_n",), np.array([0.8, 0.9])),
        "time": Variable(("time",), np.array([0.0, 1.0])),
        "temperature_theory": Variable(rows, np.ones((2, 2))),
    }
    axes = json.dumps({"e_n": ["e_n"]})
    of_all = {
        "axes": axes,
        "keys": '{"e_n": "material[0].e_n"}',
        "path": "gas.toml",
        "overrides": "run.t_end=1.0",
    }
    curves = [
        theory_between(Results(variables, {**of_all, "case": text}), "temperature", "e_n", {})
        for text in (CASE, old_text('"reduced" }'))
    ]
    assert isinstance(curves[0], TheoryLine)
    assert isinstance(curves[1], TheoryLine)
    assert np.isfinite(curves[0].theory).all()
    np.testing.assert_array_equal(curves[0].theory, curves[1].theory)
