"""Cases as objects of Python: the same results as case files and the command line."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ifrdem
from ifrdem.case import file as case_file
from ifrdem.case import shipped
from ifrdem.cli.main import main
from ifrdem.errors import Stopped
from ifrdem.runs.case import differences

SMALL: dict[str, Any] = {
    "species[0].number": 60, "run.collisions_per_disk": 3.0, "output.frames": 4, "output.histories": None,
    "output.precision": "f64", "output.picture": False, "output.views": False,
}  # fmt: skip


def words(changes: dict[str, Any]) -> list[str]:
    made = [f"{key}={'' if value is None else str(value).lower()}" for key, value in changes.items()]
    return [word for each in made for word in ("--set", each)]


def test_python_and_the_command_line_run_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "cooling", *words(SMALL), "--seed", "5", "-o", "cli"]) == 0
    case = ifrdem.Case.read("cooling", set=SMALL)
    case.run.seed = 5
    with ifrdem.Trajectory("cli.h5") as expected, case.run_to("python.h5") as found:
        assert len(found) == len(expected) == 5
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one.position, other.position)
            np.testing.assert_array_equal(one.velocity, other.velocity)
        assert found.parameters["case_in_full"] == expected.parameters["case_in_full"]
        assert found.parameters["case"] == expected.parameters["case"]
        assert found.parameters["overrides"].splitlines()[-1] == "run.seed=5"
    with (
        ifrdem.run("cooling", "again.h5", set={**SMALL, "run.seed": 5}) as again,
        ifrdem.Trajectory("cli.h5") as cli,
    ):
        np.testing.assert_array_equal(again[-1].position, cli[-1].position)
    gas = case.simulation()
    gas.run(collisions_per_disk=3.0)
    with ifrdem.Trajectory("cli.h5") as cli:
        np.testing.assert_array_equal(gas.state.velocity, cli[-1].velocity)


@pytest.mark.parametrize(
    ("output", "changes", "message"),
    [
        (
            "there.h5",
            {},
            r"output there.h5: exists already; force=True replaces it, another output writes elsewhere",
        ),
        ("", {}, "output = '': must be a text or a path, not empty"),
        ("a\0b", {}, r"output = 'a\\x00b': must be a text or a path, not empty"),
        (os.devnull, {}, f"output = '{os.devnull}': must be a folder, or the path of files"),
        ("new.h5", ["run.seed"], "set: run.seed: must be KEY=VALUE"),
        ("new.h5", {"material[3].e_n": 0.5}, r"set: material.3..e_n=0.5: material has \d entries"),
    ],
)
def test_messages_of_python_calls_name_arguments_of_python(
    output: str, changes: Any, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.h5").write_text("precious", encoding="utf-8")
    with pytest.raises(ifrdem.InputError, match=message) as raised:
        ifrdem.run("elastic", output, set=changes, picture=False)
    assert "--" not in str(raised.value)
    assert [each.name for each in tmp_path.iterdir()] == ["there.h5"]


@pytest.mark.parametrize("name", shipped.names())
def test_a_case_given_as_text_is_the_same_case(name: str) -> None:
    case = ifrdem.Case.read(name)
    raw = tomllib.loads(case.to_toml())
    assert raw == tomllib.loads(shipped.find(name).read_text(encoding="utf-8"))
    assert ifrdem.Case(**raw).run == case.run


def test_changes_in_python_are_kept_as_overrides() -> None:
    case = ifrdem.Case.read("cooling", set=["run.seed=4"])
    case.species[0].number = 77
    case.run.threads = 1
    case.output.frames = None  # type: ignore[assignment]
    case.material = [*case.material, {"name": "b", "coin": "1 pta"}]  # type: ignore[list-item]
    file = case.file()
    assert file.overrides[0] == "run.seed=4"
    assert set(file.overrides) >= {"run.seed=4", "run.threads=1", "species[0].number=77", "output.frames="}
    assert case_file.of_text(file.text, file.path, file.overrides).case == file.case
    assert (file.case.run.seed, file.case.species[0].number, file.case.output.frames) == (4, 77, 100)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ({"a": 1}, {"a": 1}, []),
        ({"w": [{"x": 1}, {"x": 2}]}, {"w": [{"x": 1}, {"x": 3, "y": [1.5]}]}, ["w[1].x=3", "w[1].y=[1.5]"]),
        ({"w": [{"x": 1}]}, {"w": []}, ["w=[]"]),
        ({"s": {"a": True, "b": 2}}, {"s": {"a": False}}, ["s.a=false", "s.b="]),
        ({}, {"s": {"t": 'a "b"'}}, ['s={ t = "a \\"b\\"" }']),
    ],
)
def test_differences_are_the_assignments_between(old: Any, new: Any, found: list[str]) -> None:
    assert list(differences(old, new)) == found
    for assignment in found:
        case_file.override(old, assignment)
    assert old == new


@pytest.mark.parametrize(
    ("section", "key", "value", "says"),
    [
        ("run", "seed", -1, ("run.seed = -1", "must be")),
        ("run", "seed", 1.5, ("run.seed = 1.5", "whole number")),
        ("run", "sede", 1, ("run.sede = 1", "unknown key (did you mean 'seed'?)")),
        ("run", "device", "cdua", ('run.device = "cdua"', "did you mean 'cuda'?")),
        ("box", "packing_fraction", float("nan"), ("box.packing_fraction = nan", "must be a number above 0")),
        ("start", "positions", "randm", ('start.positions = "randm"', "did you mean 'random'?")),
        (None, "box", 3, ("box = 3", "must be a table ([box])")),
        (None, "wall", [{"shape": "lin"}], ('wall[0].shape = "lin"', "did you mean 'line'?")),
        (None, "force", [{"kind": "drag", "rate": 1.0}], ("force[0].step", "missing")),
        (None, "force", [{"kind": "drag", "step": 1.0, "rate": 1.0, "mu": 1.0}],
         ("force[0].mu", "requires kind = 'table_friction'")),
        (None, "walls", [], ("walls", "unknown key (did you mean 'wall'?)")),
    ],
)  # fmt: skip
def test_a_value_is_checked_when_it_is_set(
    section: str | None, key: str, value: Any, says: tuple[str, str]
) -> None:
    case = ifrdem.Case.read("cooling")
    before = case.to_toml()
    with pytest.raises(ifrdem.InputError) as caught:
        setattr(case if section is None else getattr(case, section), key, value)
    assert str(caught.value).startswith(says[0])
    assert says[1] in str(caught.value)
    assert case.to_toml() == before


def test_mistakes_of_several_keys_are_found_before_anything_is_made(tmp_path: Path) -> None:
    case = ifrdem.Case.read("cooling", set=SMALL)
    case.run.t_end = 1.0
    for act in (case.check, case.simulation, lambda: case.run_to(tmp_path / "out.h5")):
        with pytest.raises(
            ifrdem.InputError, match="run: must have exactly one of t_end, collisions_per_disk"
        ):
            act()
    assert not list(tmp_path.iterdir())
    case.run.collisions_per_disk = None
    assert "to t = 1 s" in str(case.check())
    case.species[0].material = "lead"
    with pytest.raises(
        ifrdem.InputError, match=r'species\[0\]\.material = "lead": no such material.*set in Python'
    ):
        case.check()


def test_check_in_python_gives_the_text_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "drum"]) == 0
    shown = capsys.readouterr()
    report = ifrdem.Case.read("drum").check()
    assert report.text == shown.out.rstrip("\n")
    assert all(each in shown.err for each in report.warnings)


def test_a_case_that_was_stopped_is_resumed_from_the_command_line(tmp_path: Path) -> None:
    case = ifrdem.Case.read("cooling", set=SMALL)
    case.run.seed = 2
    with pytest.raises(Stopped, match="hours are up"):
        case.run_to(tmp_path / "stopped.h5", max_hours=1e-9)
    assert main(["resume", str(tmp_path), "--quiet"]) == 0
    with case.run_to(tmp_path / "whole.h5") as whole, ifrdem.Trajectory(tmp_path / "stopped.h5") as stopped:
        assert len(stopped) == len(whole) == 5
        np.testing.assert_array_equal(stopped[-1].position, whole[-1].position)
    with pytest.raises(ifrdem.InputError, match=r"whole\.h5: exists"):
        case.run_to(tmp_path / "whole.h5")


def test_a_case_made_in_python_runs(tmp_path: Path) -> None:
    case = ifrdem.Case(
        run={"name": "made", "t_end": 1.0, "units": "reduced", "seed": 1},
        box={"packing_fraction": 0.1},
        material=[{"name": "a", "e_n": 0.9, "e_t": -0.9, "mu": 0.1}],
        species=[{"name": "d", "number": 30, "material": "a", "mass": 1.0, "radius": 0.5, "speed_rms": 1.0}],
        output={"frames": 2, "picture": False, "views": False},
    )
    with case.run_to(f"{tmp_path}/") as found:
        assert (found.path, len(found)) == (tmp_path / "made.h5", 3)
        assert tomllib.loads(str(found.parameters["case"])) == tomllib.loads(str(case))
    with pytest.raises(ifrdem.InputError) as caught:
        ifrdem.Case(run={"name": "x"}, box={})
    assert [line.split(":")[0] for line in str(caught.value).splitlines()] == ["run", "box", "species"]


def test_sections_that_were_not_given_can_be_changed_in_place() -> None:
    case = ifrdem.Case(
        run={"collisions_per_disk": 1.0},
        box={"packing_fraction": 0.1},
        species=[{"name": "d", "coin": "1 pta", "number": 30, "speed_rms": 1.0}],
    )
    assert "output" not in str(case)
    case.output.frames = 3
    case.start.positions = "hexagonal"
    case.force.append({"kind": "drag", "step": 0.1, "rate": 1.0})  # type: ignore[arg-type]
    found = case.file().case
    assert (found.output.frames, found.start.positions, len(found.force)) == (3, "hexagonal", 1)
    shipped = ifrdem.Case.read("cooling")
    shipped.force.append({"kind": "drag", "step": 0.1, "rate": 1.0})  # type: ignore[arg-type]
    assert len(shipped.file().case.force) == 1


@pytest.mark.filterwarnings("error")
def test_invalid_items_assigned_into_a_list_are_refused() -> None:
    read = ifrdem.Case.read("cooling", set=SMALL)
    made = ifrdem.Case(**read.model_dump(exclude_unset=True, exclude_none=True))
    for one in (read, made):
        for wrong in (None, 3, "x", {"kind": "drug"}):
            case = one.model_copy(deep=True)
            case.force.append(wrong)  # type: ignore[arg-type]
            with pytest.raises(ifrdem.InputError, match=r"force\[0\]"):
                case.check()


def test_numbers_of_numpy_and_tuples_are_values() -> None:
    case = ifrdem.Case.read("cooling", set={"run.seed": np.int64(3), "box.aspect": np.float32(0.5)})
    case.species[0].number = np.int64(300)  # type: ignore[assignment]
    case.box.packing_fraction = None
    case.box.lengths = np.array([1.0, 2.0])  # type: ignore[assignment]
    case.box.aspect = None  # type: ignore[assignment]
    case.box.periodic = (True, True)  # type: ignore[assignment]
    found = case.file().case
    assert (found.run.seed, found.species[0].number, found.box.lengths) == (3, 300, [1.0, 2.0])


def test_arguments_are_checked_before_anything_is_written(tmp_path: Path) -> None:
    case, there = ifrdem.Case.read("cooling", set=SMALL), tmp_path / "gas.h5"
    wrong: dict[str, Any] = {"max_hours": float("nan"), "picture": 3, "log": None, "warn": 3, "force": "x"}
    for name, value in wrong.items():
        with pytest.raises(ifrdem.InputError, match=f"^{name} = "):
            case.run_to(there, **{name: value})
        with pytest.raises(ifrdem.InputError, match=f"^{name} = "):
            ifrdem.run(case, there, **{name: value})
    for hours in (-1, 0):
        with pytest.raises(ifrdem.InputError, match=r"^max_hours = "):
            case.run_to(there, max_hours=hours)
    for place in (3, b"x"):
        with pytest.raises(ifrdem.InputError, match=r"^output = "):
            case.run_to(place)  # type: ignore[arg-type]
        with pytest.raises(ifrdem.InputError, match=r"^path = "):
            ifrdem.Case.read(place)  # type: ignore[arg-type]
        with pytest.raises(ifrdem.InputError, match=r"^case = "):
            ifrdem.run(place)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_invalid_changes_are_refused() -> None:
    wrong: Any
    for wrong in ("run.seed=3", ["run.seed"], {"run.seed]": 3}, None, 3, [1], {"run.seed": object()}):
        with pytest.raises(ifrdem.InputError, match="set"):
            ifrdem.Case.read("cooling", set=wrong)
    with pytest.raises(ifrdem.InputError, match="set: cannot be combined with a Case"):
        ifrdem.run(ifrdem.Case.read("cooling"), set={"run.seed": 3})


def test_a_wrong_attribute_of_a_species_says_of_which() -> None:
    case = ifrdem.Case.read("cooling")
    name = case.species[0].name
    with pytest.raises(ifrdem.InputError, match=re.escape(f"species[{name!r}].radius = -1")):
        case.species[0].radius = -1
    with pytest.raises(ifrdem.InputError, match=r"^run\.seed = -1"):
        case.run.seed = -1
