"""The clock of a run that starts from a frame or a file: a run in two halves is the run in one piece."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.case import file as case_file
from ifrdem.case import notices, starts
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

GAS = """
run = { name = "whole", seed = 3, units = "reduced", t_end = 3.0 }
material = [{ name = "m", e_n = 0.9, e_t = -0.5, mu = 0.2 }]
species = [{ name = "disks", number = 20, material = "m", mass = 1.0, radius = 0.5, speed_rms = 1.0 }]
output = { precision = "f64", frames_interval = 1.5, views = false, picture = false }
"""
SIDES = 'lengths = [12.0, 12.0], material = "m", gravity = [0.0, -0.5]'
FLOOR = (
    '{ shape = "line", material = "m", point = [0.0, 1.0], normal = [0.0, 1.0], '
    'motion = { kind = "sine", amplitude = 0.5, frequency = 0.4 } }'
)
"""Half a period is 1.25: at t = 1.5 it moves downwards, and not as at t = 0."""
GATE = '{{ shape = "segment", material = "m", start = [1.0, {}], end = [11.0, {}], {} }}'
GATES = [GATE.format(6.0, 6.0, "opens_at = 1.0"), GATE.format(8.0, 8.0, "opens_after = 4")]
PISTON = (
    '{ shape = "line", material = "m", point = [0.0, 11.0], normal = [0.0, -1.0], '
    "piston = { mass = 5.0, spring = 2.0, displacement = 0.3, velocity = -0.2 } }"
)
GASES = {
    "a shaken floor and gates": f"box = {{ {SIDES}, periodic = [true, false] }}\nwall = [{', '.join([FLOOR, *GATES])}]",
    "gravity that turns": f"box = {{ {SIDES}, periodic = [false, false], gravity_rotation_rate = 0.7 }}",
    "a piston": f"box = {{ {SIDES}, periodic = [true, false] }}\nwall = [{PISTON}]",
    "a flow, and kicks": "box = { lengths = [12.0, 12.0], shear_rate = 0.7 }\n"
    'force = [{ kind = "random_kicks", step = 0.2, power = 0.1 }]',
}  # fmt: skip
"""Cases that depend on the clock or on the number of collisions, or have a state in addition to the disks."""


def set_(*changes: str) -> list[str]:
    return [word for each in changes for word in ("--set", each)]


def continues(*more: str) -> list[str]:
    return ["run.name=half", "species[0].speed_rms=", "start.positions=whole.h5", "start.frame=1", "start.motion=true",
            *more]  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("gas", GASES)
def test_a_run_from_a_frame_is_the_second_half_of_the_whole_run(
    gas: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The frame at t = 1.5 in double precision: all that differs is its rounding, 1e-16, which a few collisions of each
    disk make ten times larger each: 1e-9 is far above it, and far below a radius."""  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("gas.toml").write_text(GAS + GASES[gas])
    assert main(["run", "gas.toml", "--quiet"]) == 0
    own = ["wall[0].piston.displacement=", "wall[0].piston.velocity="] if gas == "a piston" else []
    assert main(["run", "gas.toml", "--quiet", *set_(*continues(*own))]) == 0
    with Trajectory("whole.h5") as whole, Trajectory("half.h5") as half:
        assert whole.times.tolist() == [0.0, 1.5, 3.0]
        assert half.times.tolist() == [1.5, 3.0]
        assert whole.observables["collisions"][1] >= 4  # the gate that waits for them is open
        for name in whole.fields:
            np.testing.assert_array_equal(half[0][name], whole[1][name], err_msg=name)
            np.testing.assert_allclose(half[1][name], whole[2][name], rtol=0.0, atol=1e-9, err_msg=name)
        if gas == "a piston":
            for name in ("piston_displacement", "piston_velocity"):
                np.testing.assert_allclose(
                    half.observables[name], whole.observables[name][1:], rtol=0.0, atol=1e-9
                )
    status = json.loads(Path("half.status.json").read_text())
    assert (status["state"], status["fraction"]) == ("done", 1.0)
    if "wall" not in GASES[gas]:
        return
    # Stopped and resumed, it is to the bit what it is.
    stopped = set_(*continues(*own), "run.name=stopped")
    assert main(["run", "gas.toml", "--quiet", "--max-hours", "1e-9", *stopped]) == 3
    assert main(["resume", "stopped.h5", "--quiet"]) == 0
    with Trajectory("half.h5") as half, Trajectory("stopped.h5") as resumed:
        for name in half.fields:
            np.testing.assert_array_equal(resumed[1][name], half[1][name], err_msg=name)


def read_case(folder: Path, *changes: str, text: str = "") -> case_file.CaseFile:
    """The case of a gas without time, or with walls."""
    path = folder / "case.toml"
    path.write_text(GAS + (text or "box = { lengths = [12.0, 12.0] }"))
    return case_file.read(path, changes)


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run to t = 3, whole.h5, of a box without anything in it."""
    folder = tmp_path_factory.mktemp("old")
    (folder / "gas.toml").write_text(GAS + "box = { lengths = [12.0, 12.0] }")
    assert main(["run", str(folder / "gas.toml"), "-o", f"{folder}/", "--quiet"]) == 0
    return folder


def test_the_clock_of_the_frame_continues_or_a_new_one_begins(
    old: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Trajectory(old / "whole.h5") as whole:
        collisions = int(whole.observables["collisions"][1])
        counted, image = whole[1].collisions, whole[1].image
    assert collisions > 0
    assert np.any(image)
    still = [each for each in continues() if "motion" not in each and "speed" not in each]
    for changes in (continues(), still):
        gas = read_case(old, *changes).gas
        state = starts.start(gas)
        assert (gas.begin, state.time) == ((1.5, collisions), 1.5)
        np.testing.assert_array_equal(state.collisions, counted)
        np.testing.assert_array_equal(state.image, image)
        gas = read_case(old, *changes, "start.time=0.5").gas
        state = starts.start(gas)
        assert (gas.begin, state.time) == ((0.5, 0), 0.5)
        assert not state.collisions.any()
        assert not state.image.any()
    gas_toml = str(old / "gas.toml")
    assert main(["check", gas_toml, *set_(*continues())]) == 0
    shown = capsys.readouterr().out
    assert f"from t = 1.5, after {collisions / 10:.4g} collisions per disk, to t = 3: " in shown
    # Half the time from the same motion: half of the collisions, and more by what cooling takes from the second half.
    half = float(re.search(r"to t = 3: ([\d.]+) collisions", shown)[1])  # type: ignore[index]
    assert main(["check", gas_toml, *set_(*continues("start.time=0"))]) == 0
    whole_run = re.search(r"run +to t = 3: ([\d.]+) collisions", capsys.readouterr().out)
    assert 0.5 * float(whole_run[1]) < half < 0.6 * float(whole_run[1])  # type: ignore[index]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (["run.t_end=1.5"], r"run\.t_end = 1\.5: must be after 1\.5.*start\.time = 0"),
        (["run.t_end=", "run.collisions_per_disk=0.1"], r"run\.collisions_per_disk = 0\.1: must be above [\d.]+, the "
         r"collisions per disk until the frame; start\.time = 0 begins"),
        (["start.time=3.0"], r"run\.t_end = 3: must be after 3, the time"),
        (["start.time=-1"], r"start\.time = -1: must be 0 or more"),
        (["start.positions=random", "start.frame=", "start.motion="], None),
        (["start.positions=random", "start.frame=", "start.motion=", "start.time=1"], "time: requires positions = "),
        (["box.shear_rate=0.5", "start.time=1.0"], None),
        (['force=[{kind="drag",rate=0.1,step=2.8}]'], r"force\[0\]\.step = 2\.8: .* before run\.t_end = 3"),
        (['force=[{kind="drag",rate=0.1,step=2.0}]'], None),
    ],
)  # fmt: skip
def test_ends_that_are_over_are_refused(old: Path, changes: list[str], says: str | None) -> None:
    """A force of step 2 acts at t = 1 and 3; of step 2.8 at 1.4, which is over, and at 4.2, which never comes."""
    if says is None:
        read_case(old, *continues(), *changes)
        return
    with pytest.raises(InputError, match=says):
        read_case(old, *continues(), *changes)


def test_a_csv_start_begins_at_its_time(tmp_path: Path) -> None:
    """At t = 0 the floor is at 1, at t = 0.625, a quarter of its period, at 1.5; a gate opens at 1."""
    walls = GASES["a shaken floor and gates"]
    (tmp_path / "start.csv").write_text("x,y\n2.0,1.7\n6.0,6.1\n")
    two = ["species[0].number=2", "start.file=start.csv"]
    with pytest.raises(
        InputError, match=r"disk 1 at \(6, 6\.1\) overlaps wall 1 \(segment\) at t = 0 by 0\.4"
    ):
        read_case(tmp_path, *two, "wall[2].opens_after=0", text=walls)
    with pytest.raises(
        InputError, match=r"disk 0 at \(2, 1\.7\) overlaps wall 0 \(line\) at t = 0\.625 by 0\.3"
    ):
        read_case(tmp_path, *two, "start.time=0.625", text=walls)
    gas = read_case(
        tmp_path, *two, "start.time=1.75", text=walls
    ).gas  # the floor is at 0.52, and the gate is open
    assert gas.simulation().time == starts.start(gas).time == 1.75
    assert gas.free_area.area() == pytest.approx(12.0 * (11.0 - 0.5 * np.sin(2.0 * np.pi * 0.4 * 1.75)))


def test_disks_of_a_csv_file_are_moved_apart_through_sheared_images(tmp_path: Path) -> None:
    """The image above is 0.5 12 t further: by 12, that is 0, at t = 2, and by 9 at 1.5, where disk 1 is near disk 0."""
    (tmp_path / "start.csv").write_text(
        "x,y\n2.0,0.4\n5.0,11.45\n"
    )  # an image of disk 0 at (11, 12.4), or (2, 12.4)
    two = ["species[0].number=2", "start.file=start.csv", "box.shear_rate=0.5", "start.relax=0.2"]
    gas = read_case(tmp_path, *two, "start.time=2.0").gas
    np.testing.assert_array_equal(starts.start(gas).position, [[2.0, 0.4], [5.0, 11.45]])
    (tmp_path / "start.csv").write_text("x,y\n2.0,0.4\n11.0,11.45\n")
    position = starts.start(
        read_case(tmp_path, *two, "start.time=1.5").gas
    ).position  # 0.95 apart: each moves by 0.025
    np.testing.assert_allclose(position, [[2.0, 0.425], [11.0, 11.425]], atol=1e-6)  # and some 1e-7 more


def frame_of(
    path: Path, position: list[list[float]], time: float, precision: str = "f64", **more: object
) -> None:
    """A trajectory of one frame of disks at rest in a box between walls."""
    n, box = len(position), Box((12.0, 12.0), (True, False))
    state = State(position, np.zeros((n, 2)), np.zeros(n), time=time, collisions=np.full(n, 10))
    fields: list[str] = ["position", "velocity", "angular_velocity", *more.pop("fields", ["collisions"])]  # type: ignore[misc]
    with TrajectoryWriter(
        path, Disks(n, 1.0, 0.5), box, fields=fields, precision=precision, force=True
    ) as file:
        file.write(state, more)  # type: ignore[arg-type]


def test_a_frame_in_single_precision_is_corrected_at_the_current_position_of_the_floor(
    tmp_path: Path,
) -> None:
    """Disks rest on the floor at t = 0.5, at 1 + 0.5 sin(0.4 pi): single precision rounds it down by 2e-8."""
    floor = 1.0 + 0.5 * np.sin(2.0 * np.pi * 0.4 * 0.5)
    assert np.float32(floor + 0.5) < floor + 0.5
    places = [[2.0 + 2.0 * i, floor + 0.5] for i in range(5)]
    frame_of(tmp_path / "old.h5", places, 0.5, "f32")
    gas = read_case(
        tmp_path, "species[0].number=5", "start.positions=old.h5", text=GASES["a shaken floor and gates"]
    ).gas
    position = starts.start(gas).position
    assert (position[:, 1] - 0.5 - floor).min() >= 0.0
    np.testing.assert_allclose(position, places, atol=1e-5)


@pytest.mark.parametrize(
    ("lower", "changes", "hint"),
    [
        # At t = 0.625 the floor stands at 1.5, some 0.024 higher than at t = 0.5, and at 1 at t = 0.
        (0.5, ["start.time=0.625"], "At another start.time the walls stand elsewhere"),
        (0.5, [], ""),
        # Single precision explains 2^-22 of the side, 2.9e-6: 1e-5 is of that size.
        (1e-5, [], "Positions in single precision are rounded"),
    ],
)
def test_an_overlap_with_the_floor_gets_the_hint_that_helps(
    lower: float, changes: list[str], hint: str, tmp_path: Path
) -> None:
    floor = 1.0 + 0.5 * np.sin(2.0 * np.pi * 0.4 * 0.5)
    frame_of(tmp_path / "old.h5", [[2.0 + 2.0 * i, floor + 0.5 - lower] for i in range(5)], 0.5, "f32")
    start = ["species[0].number=5", "start.positions=old.h5", *changes]
    with pytest.raises(InputError, match=r"overlaps wall 0 \(line\) at t = 0\.") as found:
        starts.start(read_case(tmp_path, *start, text=GASES["a shaken floor and gates"]).gas)
    hints = ("At another start.time the walls stand elsewhere", "Positions in single precision are rounded")
    assert [each for each in hints if each in str(found.value)] == [hint] * bool(hint)


def test_gates_and_pistons_start_where_the_frame_has_them(tmp_path: Path) -> None:
    """Two disks with ten collisions each, that is ten in all: the gate that waits for four is open."""
    walls, two = GASES["a shaken floor and gates"], ["species[0].number=2", "start.positions=old.h5"]
    frame_of(tmp_path / "old.h5", [[2.0, 3.0], [6.0, 8.1]], 2.0)
    assert read_case(tmp_path, *two, text=walls).gas.begin == (2.0, 10)
    with pytest.raises(
        InputError, match=r"disk 1 at \(6, 8\.1\) overlaps wall 2 \(segment\) at t = 2 by 0\.4"
    ):
        read_case(tmp_path, *two, "start.time=2.0", text=walls)
    frame_of(tmp_path / "bare.h5", [[2.0, 3.0], [6.0, 3.0]], 2.0, fields=[])
    with pytest.raises(InputError, match=r"wall\[2\]\.opens_after = 4: requires the field collisions"):
        read_case(tmp_path, *two, "start.positions=bare.h5", text=walls)
    moved: dict[str, object] = {
        f"piston_{name}": np.array([x]) for name, x in (("displacement", 2.0), ("velocity", 0.7))
    }
    frame_of(tmp_path / "old.h5", [[2.0, 3.0], [6.0, 8.4]], 2.0, **moved)
    piston = GASES["a piston"]
    with pytest.raises(
        InputError, match=r"wall\[0\]\.piston\.displacement = 0\.3: cannot be combined with a start from"
    ):
        read_case(tmp_path, *two, text=piston)
    own = ["wall[0].piston.displacement=", "wall[0].piston.velocity="]
    for motion, velocity in (("false", 0.0), ("true", 0.7)):
        more = [f"start.motion={motion}", *(["species[0].speed_rms="] if velocity else [])]
        gas = read_case(tmp_path, *two, *own, *more, text=piston).gas
        assert gas.simulation().pistons[0, :2].tolist() == [2.0, velocity]
    frame_of(tmp_path / "old.h5", [[2.0, 3.0], [6.0, 9.0]], 2.0, **moved)
    with pytest.raises(InputError, match=r"overlaps wall 0 \(line\) at its displacement 2 by 0\.5"):
        read_case(tmp_path, *two, *own, text=piston)


def test_a_start_warns_of_what_a_frame_does_not_store(old: Path) -> None:
    moving, hot = continues(), '{shape="line",temperature=1.0,point=[0.0,0.0],normal=[0.0,1.0]}'
    assert notices.notices(read_case(old, *moving).gas) == []
    (text,) = notices.notices(
        read_case(old, *moving, "run.collapse=contact_time", "run.contact_time=0.01").gas
    )
    assert "until t = 1.51, run.contact_time counts collisions since the start only" in text
    assert notices.notices(read_case(old, "run.collapse=contact_time", "run.contact_time=0.01").gas) == []
    frame_of(old / "hot.h5", [[2.0 + 2.0 * (i % 5), 2.0 + 2.0 * (i // 5)] for i in range(20)], 1.0)
    walls = f'box = {{ lengths = [12.0, 12.0], periodic = [true, false], material = "m" }}\nwall = [{hot}]'
    (text,) = notices.notices(
        read_case(old, *moving, "start.frame=0", "start.positions=hot.h5", text=walls).gas
    )
    assert "the same random velocities again, with another run.seed than 3" in text


def test_a_study_begins_at_0(old: Path) -> None:
    """Its runs share one time axis."""
    for more, wrong in (((), ["start.time = 1.5: must be 0 in a study, whose runs share one time axis "
                              "(without the key it is the time of the frame)"]), (("start.time=0",), [])):  # fmt: skip
        changes = [each for each in continues(*more) if "name" not in each]
        plan = ifrdem.Study(old / "gas.toml", vary=["material[0].e_n=0.8,0.9"], set=changes).plan
        assert plan.checked_cases()[1] == wrong
