"""Walls, gravity and remedies for collapse in case files: keys, refusals, `check` and `run`."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.cases import MakeCase, Problems, case_text, changed

from ifrdem import RotatingGravity
from ifrdem.case import file as case_file
from ifrdem.case import gas as gas_module
from ifrdem.case import rules, starts, template
from ifrdem.case.case import CaseSections
from ifrdem.case.estimate import RunEstimate
from ifrdem.case.gas import CaseGas
from ifrdem.case.messages import kind_of, models_in
from ifrdem.case.walls_section import MotionOfWall, PistonSection
from ifrdem.case.walls_section import Wall as AnyWall
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.model.collapse import ContactTime, Rest, VelocityCutoff
from ifrdem.model.observables import measure
from ifrdem.model.walls.free_area import FreeArea
from ifrdem.model.walls.motion import Motion, Piston, Turn
from ifrdem.model.walls.wall import Wall, from_json, to_json
from ifrdem.plots import profiles
from ifrdem.plots.temperatures import theory
from ifrdem.runs.info import describe
from ifrdem.trajectory.reader import Trajectory

ROOT = Path(__file__).parents[2]

CASE = case_text({
    "run.name": "shaken", "run.seed": 4, "box.lengths": [20.0, 24.0], "box.periodic": [False, False],
    "box.material": "glass", "box.gravity": [0.0, -1.0], "box.packing_fraction": None,
    "material[0].e_n": 0.87, "material[0].e_t": -0.88, "material[0].mu": 0.21,
    "pair": [
        {"materials": ["coin", "glass"], "e_n": 0.9, "e_t": -0.8, "mu": 0.3},
        {"materials": ["steel", "coin"], "e_n": 0.95, "e_t": -0.7, "mu": 0.1},
    ],
    "species[0].number": 100, "species[0].mass": 2.0, "species[0].speed_rms": 2.0,
    "wall": [
        {"shape": "line", "material": "steel", "point": [0.0, 0.5], "normal": [0.0, 1.0],
         "motion": {"kind": "sine", "amplitude": 0.5, "frequency": 2.0}},
        {"shape": "post", "material": "coin", "center": [10.0, 8.0], "radius": 2.0, "surface_speed": 0.5},
    ],
    "output": {"frames": 4, "precision": "f64"},
})  # fmt: skip


def test_the_case_is_in_order(problems: Problems) -> None:
    """Coins at rest too: the floor and gravity move them. The post needs no pair: it is made of what the coins are."""
    assert problems() == []
    assert problems("species[0].speed_rms=", "run.t_end=", "run.collisions_per_disk=5.0") == []


@pytest.mark.parametrize(
    ("overrides", "key", "says"),
    [
        (["wall[0].shape=lin"], 'wall[0].shape = "lin"', "did you mean 'line'"),
        (["wall[0].normal="], "wall[0].normal", "missing: direction"),
        (
            ["wall[0].radius=1.0"],
            "wall[0].radius = 1",
            "requires shape = 'container', 'post' or 'arc', not with 'line'",
        ),
        (["wall[0].normal=[0.0, 0.0]"], "wall[0]", "no direction"),
        (["wall[0].normal=[0.0]"], "wall[0].normal", "at least 2 entries"),
        (["wall[1].radius=-1.0"], "wall[1].radius = -1.0", "must be"),
        (["wall[1].shape=container", "wall[1].radius=0"], "wall[1].radius = 0", "must be"),
        (["wall[1].surface_sped=1.0"], "wall[1].surface_sped = 1.0", "did you mean 'surface_speed'"),
        (["wall[0].material="], "wall[0]", "must have either material or temperature"),
        (["wall[0].temperature=2.0"], "wall[0]", "must have either material or temperature"),
        (["wall[0].motion.kind=sin"], 'wall[0].motion.kind = "sin"', "did you mean 'sine'"),
        (["wall[0].motion.frequency="], "wall[0].motion.frequency", "missing: periods"),
        (
            ["wall[0].motion.speed=1.0"],
            "wall[0].motion.speed = 1",
            "requires kind = 'steady', not with 'sine'",
        ),
        (["wall[0].motion.direction=[0.0, 0.0]"], "wall[0].motion", "it has no direction"),
        (["wall[0].motion.frequency=0.0"], "wall[0].motion.frequency = 0.0", "must be"),
        (
            ["wall[0].material=stele"],
            "pair",
            "missing for the materials 'coin' and 'stele'.*did you mean 'steel'",
        ),
        (["box.material="], "box", "material is missing"),
        (["box.material=steal"], "pair", "'coin' and 'steal'.*did you mean 'steel'"),
        (["box.gravity=[0.0]"], "box.gravity", "at least 2 entries"),
        (["box.periodic=[true, 1]"], "box.periodic[1] = 1", "boolean"),
        (
            ["box.periodic=[true, false]", "box.gravity=[1.0, -1.0]"],
            "box.gravity = [1.0, -1.0]",
            "cannot be combined with box.periodic = \\[true, false\\]",
        ),
        (
            ["box.periodic=[true, false]", "wall[0].normal=[1.0, 1.0]"],
            "wall[0]",
            "line: a line across a periodic",
        ),
        (
            ["box.periodic=[true, false]", "wall[1].center=[1.0, 8.0]"],
            "wall[1]",
            "post: at .1, 8. it reaches beyond a periodic side",
        ),
        (["wall[1].center=[10.0, 27.0]"], "wall[1]", "the post lies outside of the box, which reaches from"),
        (["wall[0].point=[0.0, 23.5]"], "wall", "the walls leave no room for a disk of diameter 1"),
        (["box.lengths=", "box.packing_fraction=0.2"], "box.packing_fraction", "give box.lengths"),
        (["run.collapse=velocity"], 'run.collapse = "velocity"', "did you mean 'velocity_cutoff'"),
        (["run.collapse=velocity_cutoff"], "run", 'collapse = "velocity_cutoff": velocity_cutoff missing'),
        (["run.collapse=rest"], "run", 'collapse = "rest": resting_speed missing'),
        (["run.velocity_cutoff=0.1"], "run", 'velocity_cutoff cannot be combined with collapse = "none"'),
        (
            ["run.collapse=contact_time", "run.contact_time=0.1", "run.velocity_cutoff=0.1"],
            "run",
            'it is of collapse = "velocity_cutoff"',
        ),
        (["species[0].number=500"], "box.lengths = 0.8585", "too dense for a random start"),
        (
            ["species[0].number=700"],
            "box.lengths = 1.2",
            "than the free area between walls has: some 318 of them",
        ),
        (["wall[0].material=coin", 'pair[1].materials=["coin", "stel"]'], "pair[1].materials", "no material"),
    ],
)
def test_a_wrong_wall_is_named_with_what_is_allowed(
    problems: Problems, overrides: list[str], key: str, says: str
) -> None:
    found = problems(*overrides)
    assert found, overrides
    assert any(line.startswith(key) and re.search(says, line) for line in found), found


@pytest.mark.parametrize(
    ("wall", "says"),
    [
        ('shape = "polygon"\npoints = [[1.0, 1.0], [4.0, 4.0], [4.0, 1.0], [1.0, 4.0]]', r"\[0\] and .*\[2\] cross"),
        ('shape = "polygon"\npoints = [[1.0, 1.0], [4.0, 4.0]]', "2 of them: must be 3 or more"),
        ('shape = "polyline"\npoints = [[1.0, 1.0], [4.0, 4.0], [4.0, 4.0]]', r"points\[1\] and points\[2\] are both"),
        ('shape = "polygon"\nfile = "open.csv"', "begins at .1, 1. and ends at .1, 4.: a polygon must come back"),
        ('shape = "polygon"\npath = "M 1 1 L 4 1 L 4 4"', "begins at .1, 1. and ends at .4, 4.: a polygon"),
        ('shape = "polyline"\nfile = "wrong.csv"', "wrong.csv, line 2 = '4, x': must be two numbers"),
        ('shape = "polyline"\nfile = "none.csv"', "none.csv: there is no such file"),
        ('shape = "polyline"\npath = "M 1 1 B 2 2 3 3"', "'B' at character 7 is not known: must be one of M, L, H"),
        ('shape = "polyline"\nfile = "open.csv"\nscale = 0.0', "scale.*must be a positive number"),
        ('shape = "polyline"\npoints = [[1.0, 1.0], [4.0, 4.0]]\nscale = 2.0', "scale: only a file has it"),
        ('shape = "polygon"\npoints = [[1.0, 1.0], [4.0, 4.0], [6.0, 6.0]]', r"points\[2\] = .6, 6.: the outline"),
        ('shape = "polyline"\npath = "M 1 1 L 2"', "'L' takes 2 numbers"),
        ('shape = "polyline"\npath = "M 1 1 L 2 2 M 3 3 L 4 4"', "several parts"),
        ('shape = "polyline"', "must have exactly one of points, file, path"),
        ('shape = "arc"\ncenter = [5.0, 5.0]\nradius = 1.0\nangles = [1.0, 1.0]', "an arc without length"),
        ('shape = "arc"\ncenter = [5.0, 5.0]\nradius = 0.0', "must be"),
        (
            'shape = "line"\npoint = [1.0, 1.0]\nnormal = [0.0, 1.0]\n'
            'turn = { kind = "steady", center = [1.0, 1.0], rate = 1.0 }',
            "a line has no end",
        ),
        ('shape = "post"\ncenter = [5.0, 5.0]\nradius = 1.0\nmoves_from = 2.0\nmoves_until = 1.0', "later than"),
    ],
)  # fmt: skip
def test_invalid_shapes_are_refused_with_their_position_in_the_list(
    wall: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "open.csv").write_text("x,y\n1, 1\n4, 1\n4, 4\n1, 4\n")
    (tmp_path / "wrong.csv").write_text("1 1\n4, x\n")
    path = tmp_path / "case.toml"
    path.write_text(f'{CASE}\n[[wall]]\nmaterial = "steel"\n{wall}\n')
    assert main(["check", str(path)]) == 2
    message = capsys.readouterr().err
    assert "wall[2]" in message, message
    assert re.search(says, message), message


def test_mistakes_of_walls_come_with_all_others(problems: Problems) -> None:
    found = problems("wall[0].motion.kind=sin", "wall[1].radius=x", "run.sede=1", "box.gravity=[0.0, nan]")
    assert {line.split(" ")[0].rstrip(":") for line in found} == {
        "run.sede",
        "box.gravity[1]",
        "wall[0].motion.kind",
        "wall[1].radius",
    }


def test_a_wall_that_can_add_energy_is_refused_with_its_pair(problems: Problems) -> None:
    (found,) = problems("pair[1].e_t=1.0")
    assert found.startswith("pair[1]")
    assert "energy" in found


def test_too_many_walls_are_counted_with_the_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    raw = changed(text=CASE)
    del raw["pair"][1]  # no steel
    post = {"shape": "post", "material": "coin", "radius": 0.1}
    monkeypatch.setattr(rules, "MOST_WALLS", 31)
    raw["wall"] = [post | {"center": [0.5 * i + 1.0, 20.0]} for i in range(28)]
    (found,) = case_file.validate_parsed(raw, Path())[-1]
    assert "32 walls: 31 at most" in str(found)


def test_every_key_of_a_wall_reaches_the_engine() -> None:
    motions = {
        "steady": ({"speed": 0.1}, Motion("steady", speed=0.1)),
        "sine": (
            {"amplitude": 0.1, "frequency": 2.0, "phase": 1.0, "direction": [1.0, 0.0]},
            Motion("sine", (1.0, 0.0), amplitude=0.1, frequency=2.0, phase=1.0),
        ),
        "sawtooth": (
            {"amplitude": 0.1, "frequency": 2.0, "rise": 0.3},
            Motion("sawtooth", amplitude=0.1, frequency=2.0, rise=0.3),
        ),
    }
    shapes = {
        "line": ({"point": [0.0, 0.5], "normal": [0.0, 2.0]}, Wall.line((0.0, 0.5), (0.0, 1.0), material=2)),
        "segment": (
            {"start": [1.0, 20.0], "end": [2.0, 21.0], "surface_speed": 0.5},
            Wall.segment((1.0, 20.0), (2.0, 21.0), material=2, surface_speed=0.5),
        ),
        "container": (
            {"center": [10.0, 12.0], "radius": 9.0},
            Wall.container((10.0, 12.0), 9.0, material=2),
        ),
        "post": ({"center": [10.0, 12.0], "radius": 0.0}, Wall.post((10.0, 12.0), 0.0, material=2)),
        "arc": (
            {"center": [10.0, 12.0], "radius": 2.0, "angles": [0.5, 2.0], "opens_at": 3.0},
            Wall.arc((10.0, 12.0), 2.0, (0.5, 2.0), material=2, opens_at=3.0),
        ),
        "polyline": (
            {"path": "M 3 4 h 2 v 1", "turn": {"kind": "steady", "center": [4.0, 4.0], "rate": 0.5}, "group": "arm"},
            Wall.polyline(
                [(3.0, 4.0), (5.0, 4.0), (5.0, 5.0)], material=2, turn=Turn("steady", (4.0, 4.0), rate=0.5), group="arm"
            ),
        ),
        "polygon": (
            {
                "points": [[1.0, 1.0], [2.0, 1.0], [1.5, 2.0]], "holds": "outside", "moves_from": 1.0,
                "moves_until": 2.0, "opens_after": 7,
                "turn": {"kind": "sine", "center": [5.0, 4.0], "amplitude": 0.1, "frequency": 2.0, "phase": 1.0},
            },
            Wall.polygon(
                [(1.0, 1.0), (2.0, 1.0), (1.5, 2.0)], "outside", material=2, moves_from=1.0, moves_until=2.0,
                turn=Turn("sine", (5.0, 4.0), amplitude=0.1, frequency=2.0, phase=1.0), opens_after=7,
            ),
        ),
    }  # fmt: skip
    kinds, kinds_of_motion = models_in(AnyWall), models_in(MotionOfWall)
    assert shapes.keys() == {kind_of(each) for each in kinds}
    assert motions.keys() == {kind_of(each) for each in kinds_of_motion}
    raw = changed("run.collapse=velocity_cutoff", "run.velocity_cutoff=0.25", text=CASE)
    raw["wall"] = [{"shape": shape, "material": "steel"} | keys for shape, (keys, _) in shapes.items()]
    raw["wall"] += [
        {"shape": "post", "material": "coin", "center": [5.0, 5.0], "radius": 1.0}
        | {"motion": {"kind": kind} | keys}
        for kind, (keys, _) in motions.items()
    ]
    piston = {
        "mass": 9.0,
        "force": 2.0,
        "spring": 3.0,
        "displacement": 0.1,
        "velocity": 0.2,
        "low": -1.0,
        "high": 1.0,
    }
    assert piston.keys() == PistonSection.model_fields.keys()
    raw["wall"] += [
        {"shape": "line", "material": "coin", "point": [0.0, 14.0], "normal": [0.0, -1.0], "piston": piston}
    ]
    gas = CaseGas.from_case(CaseSections.model_validate(raw))
    assert gas.materials == ("glass", "coin", "steel")  # the engine makes the sides of the first
    expected = [wall for _, wall in shapes.values()]
    expected += [Wall.post((5.0, 5.0), 1.0, material=1, motion=motion) for _, motion in motions.values()]
    expected += [Wall.line((0.0, 14.0), (0.0, -1.0), material=1, piston=Piston(**piston))]
    assert list(gas.walls) == expected
    assert from_json(to_json(gas.walls)) == gas.walls
    law = gas.laws[1][2]
    assert law is not None
    assert (law.e_n, law.e_t, law.mu) == (0.95, -0.7, 0.1)
    assert gas.laws[2][1] is law or gas.laws[2][1] == law
    assert gas.laws[0][2] is None  # glass and steel never meet


def test_a_thermal_wall_needs_no_material(
    case: MakeCase, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hot = ["wall[0].material=", "wall[0].temperature=2.5", 'pair[1].materials=["coin", "glass"]', "pair[0]="]
    gas = CaseGas.from_case(case(*hot))
    floor = Wall.line((0.0, 0.5), (0.0, 1.0), temperature=2.5, motion=gas.walls[0].motion)
    assert gas.walls[0] == floor
    assert gas.materials == ("glass", "coin")
    (tmp_path / "hot.toml").write_text(CASE)
    assert (
        main(["check", str(tmp_path / "hot.toml"), *(word for each in hot for word in ("--set", each))]) == 0
    )
    assert "line, thermal" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        ("velocity_cutoff", "velocity_cutoff", 0.25),
        ("contact_time", "contact_time", 0.25),
        ("rest", "resting_speed", 0.05),
    ],
)
def test_remedies_for_collapse_reach_the_engine(
    case: MakeCase,
    kind: str,
    key: str,
    value: float,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given: dict[str, object] = {}
    monkeypatch.setattr(gas_module, "Simulation", lambda *args, **options: given.update(options))
    overrides = [f"run.collapse={kind}", f"run.{key}={value}"]
    made = case(*overrides)
    CaseGas.from_case(made).simulation()
    remedies = {"velocity_cutoff": VelocityCutoff, "contact_time": ContactTime, "rest": Rest}
    assert {name: given[name] for name in ("collapse", "gravity", "seed")} == {
        "collapse": remedies[kind](value),
        "gravity": (0.0, -1.0),
        "seed": 4,
    }
    (tmp_path / "case.toml").write_text(CASE)
    assert (
        main(["check", str(tmp_path / "case.toml"), *(w for each in overrides for w in ("--set", each))]) == 0
    )
    message = (
        rf"  (collisions (slower|sooner) .* are elastic|contacts slower than this last) +{value:g}( |\n)"
    )
    assert re.search(message, capsys.readouterr().out)


def test_check_refuses_rest_where_the_run_would(case: MakeCase) -> None:
    with pytest.raises(InputError, match=r"resting speed must be at most 0\.1"):
        CaseGas.from_case(case("run.collapse=rest", "run.resting_speed=0.25"))


def test_rotating_gravity_reaches_the_engine_and_check_gives_its_rate(
    case: MakeCase, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given: dict[str, object] = {}
    monkeypatch.setattr(gas_module, "Simulation", lambda *args, **options: given.update(options))
    overrides = ["box.gravity_rotation_rate=-0.05", "box.gravity_rotation_step=0.01"]
    made = case(*overrides)
    CaseGas.from_case(made).simulation()
    assert given["gravity"] == RotatingGravity((0.0, -1.0), rate=-0.05, step=0.01)
    (tmp_path / "case.toml").write_text(CASE)
    words = [word for each in overrides for word in ("--set", each)]
    assert main(["check", str(tmp_path / "case.toml"), *words]) == 0
    message = capsys.readouterr()
    # Omega^2 R / g with R = 24 / 2, half of the longer side.
    assert re.search(
        r"rotation of gravity +-0\.05\n +step of the rotation +0\.01 +rad\n +Froude number of such a drum +0\.03",
        message.out,
    )
    assert "the Froude number of such a drum, 0.03, is above 0.01" in message.err


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (["box.gravity_rotation_rate=0.1", "box.gravity=[0.0, 0.0]"], "there is no gravity to turn"),
        (
            ["box.gravity_rotation_rate=0.1", "box.periodic=[true, false]"],
            "box.gravity_rotation_rate = 0.1: cannot be combined with box.periodic = [true, false]",
        ),
        (["box.gravity_rotation_step=0.01"], "gravity_rotation_step requires gravity_rotation_rate"),
        (["box.gravity_rotation_rate=0.1", "box.gravity_rotation_step=0.2"], "gravity_rotation_step"),
        (["box.gravity_rotation_rate=0.1", "output.histories=[0]"], "output.histories = [0]: cannot"),
    ],
)
def test_gravity_that_cannot_turn_is_refused(
    override: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "case.toml").write_text(CASE)
    words = [word for each in override for word in ("--set", each)]
    assert main(["check", str(tmp_path / "case.toml"), *words]) == 2
    assert message in capsys.readouterr().err


def test_check_names_walls_on_which_no_disk_can_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It advised rest on a floor that shakes, and said in the next line that no disk rests there."""
    (tmp_path / "case.toml").write_text(CASE)
    words = ["--set", "run.collapse=rest", "--set", "run.resting_speed=0.05"]
    assert main(["check", str(tmp_path / "case.toml"), *words]) == 0
    assert "moves, and supports no disks" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "case.toml")]) == 0
    remedies = '"velocity_cutoff" or "contact_time", or "rest" on walls that stand'
    assert f"set run.collapse = {remedies}" in capsys.readouterr().out
    forces = ["--set", 'force=[{kind="drag", step=0.1, rate=0.1}]']
    assert main(["check", str(tmp_path / "case.toml"), *forces]) == 0
    assert "rest" not in capsys.readouterr().out.partition("set run.collapse")[2].partition("\n")[0]


def test_check_describes_the_motion_of_walls(toml: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(toml)]) == 0
    shown = capsys.readouterr().out
    area = 20.0 * 23.5 - 4.0 * math.pi
    assert "100 disks in a box of 20 x 24, between walls, reduced units" in shown
    assert re.search(rf"packing fraction of the free area +{100 * math.pi / 4 / area:.5g}\n", shown)
    assert re.search(rf"free area, to which densities refer +{area:.5g}\n", shown)
    assert re.search(r"energy to lift a mean disk by one diameter +2\n", shown)  # m g d = 2 x 1 x 1
    assert re.search(r"sides +walls of glass across x and y", shown)
    # 2 pi f A = 6.283; m v^2 / 2 = 39.48; A (2 pi f)^2 / g = 78.96
    assert re.search(r"wall 0 +line, of steel\n +wall 0: motion +sine\n", shown)
    assert re.search(
        r"wall 0: amplitude +0\.5\n +wall 0: frequency +2\n +wall 0: largest speed +6\.283\n", shown
    )
    assert re.search(r"wall 0: energy of a mean disk at that speed +39\.48\n", shown)
    assert re.search(r"wall 0: largest acceleration +78\.96 +g\n", shown)
    assert re.search(r"wall 1 +post, of coin\n +wall 1: speed of the surface +0.5\n", shown)
    assert re.search(r"law of coins, wall \(steel\) +strictly admissible \(law = ifr, e_n = 0.95", shown)
    assert "an unknown number of collisions" in shown
    assert "without histories" not in shown
    assert main(["check", str(toml), "--set", "output.histories_all=true"]) == 0  # and so of events
    assert re.search(r"trajectory file .* \S+B without histories, ", capsys.readouterr().out)
    assert re.search(
        r"estimated wall collision rate \(homogeneous, Maxwellian\) +[\d.]+ +per unit time", shown
    )
    assert main(["check", str(toml), "--set", "wall[0].shape=lin"]) == 2
    assert "did you mean 'line'" in capsys.readouterr().err


ELASTIC = case_text({
    "run.name": "elastic", "run.t_end": 20.0, "box.lengths": [24.0, 16.0], "box.periodic": [False, True],
    "box.material": "smooth", "box.packing_fraction": None, "material[0].name": "smooth",
    "material[0].e_n": 1.0, "material[0].e_t": -1.0, "material[0].mu": 0.0, "species[0].name": "disks",
    "species[0].number": 100, "species[0].material": "smooth", "species[0].mass": 2.0,
    "wall": [{"shape": "post", "material": "smooth", "center": [12.0, 8.0], "radius": 2.0}],
    "output": {"frames": 10, "precision": "f64"},
})  # fmt: skip


@pytest.mark.full
def test_a_run_between_walls_stores_them_and_its_ledger(
    case: MakeCase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("shaken.toml").write_text(CASE)
    assert main(["run", "shaken.toml"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"\d+ collisions with walls, which gave [\d.]+ as work", shown)
    assert Path("shaken.png").stat().st_size > 50_000
    with h5py.File("shaken.h5") as file:
        assert list(file["particles/all/box"].attrs["boundary"]) == [b"none", b"none", b"none"]
        np.testing.assert_array_equal(file["particles/all/box"].attrs["lengths"], [20.0, 24.0])
    gas = CaseGas.from_case(case())
    with Trajectory("shaken.h5") as trajectory:
        assert trajectory.box == gas.box
        assert trajectory.walls == gas.walls
        assert json.loads(str(trajectory.parameters["gravity"])) == [0.0, -1.0]
        laws = json.loads(str(trajectory.parameters["laws"]))
        assert laws[0][2] is None
        assert laws[1][2]["e_n"] == 0.95
        totals = {name: values[:] for name, values in trajectory.observables.items()}
        last = trajectory[-1]
        height = last.position[:, 1]
        for frame in trajectory:
            assert np.all(FreeArea(gas.box).gap(frame.position, gas.disks.radius) > -1e-9)
        assert theory(trajectory) == (None, None, "walls: no kinetic theory here")
    assert totals["potential_energy"][-1] == pytest.approx(2.0 * np.sum(height), rel=1e-12)  # m g y
    assert np.all(np.diff(totals["wall_collisions"]) > 0)
    assert totals["wall_work"][-1] > 0.0
    balance = (
        totals["energy"] + totals["potential_energy"] + totals["dissipated_energy"] - totals["wall_work"]
    )
    np.testing.assert_allclose(balance, balance[0], rtol=1e-12)
    # That dissipation is what disks lose, not what is left over: it never falls.
    assert np.all(np.diff(totals["dissipated_energy"]) > 0.0)
    text = describe("shaken.h5")
    assert "between walls" in text
    assert "1 line, 1 post" in text
    phi = gas.free_area.packing_fraction(gas.disks.radius)
    assert f"packing fraction  {phi:.4f} of the free area" in text


@pytest.mark.full
def test_elastic_walls_are_hit_as_often_as_kinetic_theory_says(
    case: MakeCase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They take no energy: the ledger's dissipation is rounding."""
    monkeypatch.chdir(tmp_path)
    Path("elastic.toml").write_text(ELASTIC)
    assert main(["run", "elastic.toml", "--no-picture"]) == 0
    made = case(text=ELASTIC)
    estimate = RunEstimate.of(CaseGas.from_case(made))
    with Trajectory("elastic.h5") as trajectory:
        hits = trajectory.observables["wall_collisions"]
        energy = trajectory.observables["energy"]
        dissipated = trajectory.observables["dissipated_energy"]
        collisions = trajectory.observables["collisions"][-1]
    # Some 400 hits: standard error 5 %.
    assert hits[-1] == pytest.approx(20.0 * estimate.wall_collisions, rel=0.15)
    np.testing.assert_allclose(dissipated, 0.0, atol=1e-12 * energy[0])
    assert estimate.collisions_are == "about"  # nothing slows it: chance makes them more or fewer
    assert collisions == pytest.approx(estimate.collisions, rel=0.15)


def test_a_run_continues_from_a_frame_between_walls(
    problems: Problems, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Positions in single precision: disks that touched a wall are moved off it."""
    monkeypatch.chdir(tmp_path)
    Path("elastic.toml").write_text(ELASTIC)
    short = ["--no-picture", "--set", "output.precision=f32"]
    assert main(["run", "elastic.toml", *short, "--set", "run.t_end=1.0"]) == 0
    again = [
        "--set",
        "run.t_end=2.0",
        "--set",
        "run.name=again",
        "--set",
        "start.positions=elastic.h5",
        "--set",
        "start.motion=true",
    ]
    assert main(["run", "elastic.toml", *short, *again, "--set", "species[0].speed_rms="]) == 0
    with Trajectory("elastic.h5") as first, Trajectory("again.h5") as second:
        np.testing.assert_allclose(second[0].position, first[-1].position, atol=1e-5)
    wide = "wall[0].radius=4.0"
    found = problems(
        "start.positions=elastic.h5", "species[0].speed_rms=", "start.motion=true", wide, text=ELASTIC
    )
    assert "overlaps wall 0 (post)" in found[0]


def test_positions_of_a_file_must_keep_off_walls(
    problems: Problems, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("start.csv").write_text("x,y\n1.0,2.0\n10.0,10.2\n")
    (found,) = problems("species[0].number=2", "start.file=start.csv")
    assert re.search(r"disk 1 at \(10, 10.2\) overlaps wall 1 \(post\) by 0.3", found)
    (found,) = problems("species[0].number=2", "start.file=start.csv", "wall[1].center=[10.0, 20.0]",
                        "wall[0].motion.phase=1.5707963267948966", "wall[0].point=[0.0, 1.1]")  # fmt: skip
    assert "disk 0 at (1, 2) overlaps wall 0 (line) at t = 0 by 0.1" in found  # where the floor is at 1.6
    # After half a period it is at the other end of its way.
    assert problems("species[0].number=2", "start.file=start.csv", "wall[1].center=[10.0, 20.0]", "start.time=0.25",
                    "wall[0].motion.phase=1.5707963267948966", "wall[0].point=[0.0, 1.1]") == []  # fmt: skip


def test_walls_are_where_they_are_at_the_start_time_of_a_state(case: MakeCase) -> None:
    """A state at a time at which the floor is low may have disks where it is at t = 0."""
    made = case()
    gas = CaseGas.from_case(made)
    state = starts.start(gas)
    state.position[0] = (
        1.0,
        0.5 + 0.5 - 0.4,
    )  # overlaps the floor at 0.5, and not at 0.5 - 0.5 at t = 3/4 period
    state.time = 0.375
    others = np.hypot(*(state.position[1:] - state.position[0]).T)
    assert others.min() > 1.0
    assert gas.simulation(state).time == 0.375


@pytest.mark.parametrize("way", ["grown", "hexagonal"])
def test_dense_starts_of_a_case_keep_off_walls(case: MakeCase, way: str) -> None:
    made = case("species[0].number=300", f"start.positions={way}")
    gas = CaseGas.from_case(made)
    assert np.all(gas.free_area.gap(starts.start(gas).position, gas.disks.radius) >= 0.0)


@pytest.mark.full
def test_the_vibrated_layer_floats(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Density inversion, as its comment says, in a box a quarter as wide and for a second and a half."""
    monkeypatch.chdir(tmp_path)
    less = ["box.lengths=[0.2625, 0.7]", "species[0].number=100", "run.t_end=1.5", "output.frames=30"]
    words = [word for each in less for word in ("--set", each)]
    assert main(["run", "vibrated", "--no-picture", *words]) == 0
    with Trajectory("vibrated.h5") as trajectory:
        found = profiles.of(trajectory)
    assert found is not None
    phi, T = found.mean.packing_fraction, found.mean.temperatures
    densest = int(np.argmax(phi))
    assert phi[densest] > 0.5
    assert 4.0 < (found.middles[0][densest] - 0.0105) / 0.021 < 9.0  # diameters above the floor
    assert phi[0] < 0.5 * phi[densest]
    assert T[0, 1] > 2.0 * T[0, 0]
    assert T[0, 1] > 8.0 * T[densest, 1]


def test_the_template_of_walls_is_a_shaken_floor() -> None:
    case = CaseSections.model_validate(template.TEMPLATES["walls"].values)
    gas = CaseGas.from_case(case)
    assert [wall.motion.kind for wall in gas.walls] == ["sine"]
    assert "# shape = " not in template.write("walls").split("[[wall]]")[1].split("[start]")[0]


def test_measures_without_gravity_have_no_potential_energy(case: MakeCase) -> None:
    gas = CaseGas.from_case(case("box.gravity=[0.0, 0.0]"))
    state = starts.start(gas)
    assert measure(gas.disks, state).potential_energy == 0.0
    tilted = measure(gas.disks, state, gravity=(0.5, -2.0)).potential_energy
    assert tilted == pytest.approx(2.0 * np.sum(2.0 * state.position[:, 1] - 0.5 * state.position[:, 0]))
