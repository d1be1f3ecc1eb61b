"""Warnings of walls that crush a disk; none of walls that touch, cross or pass at a constant distance."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.cli.main import main
from ifrdem.model.box import Box
from ifrdem.model.walls.crush import crushes
from ifrdem.model.walls.motion import Motion, Turn
from ifrdem.model.walls.wall import Wall, sides

PISTON = """
run = { name = "piston", t_end = 0.8, units = "reduced" }
box = { lengths = [10.0, 10.0], periodic = [false, false], material = "m" }
material = [{ name = "m", e_n = 0.9, e_t = -1.0, mu = 0.0 }]
species = [{ name = "d", material = "m", mass = 1.0, diameter = 0.5, number = 5, speed_rms = 1.0 }]
[[wall]]
shape = "segment"
material = "m"
start = [2.0, 5.0]
end = [6.0, 5.0]
motion = { kind = "steady", speed = -1.0 }
group = "piston"
[[wall]]
shape = "segment"
material = "m"
start = [3.0, 4.0]
end = [5.0, 4.0]
"""
BOX = Box((10.0, 10.0), (False, False))
TURN = Turn("steady", center=(5.0, 5.0), rate=1.0)
DOWN = Motion("steady", speed=-1.0)


@pytest.mark.parametrize(
    ("walls", "gap", "time"),
    [
        # A piston 1 above a plate comes down at 1: closed at t = 1; looked for until t = 0.8, where 0.2 are left.
        ([Wall.segment((2.0, 5.0), (6.0, 5.0), motion=DOWN), Wall.segment((3.0, 4.0), (5.0, 4.0))], 0.2, 0.8),
        ([Wall.line((0.0, 9.0), (0.0, -1.0), motion=DOWN), Wall.line((0.0, 8.0), (0.0, 1.0))], 0.2, 0.8),
        # A blade of length 3 passes a post whose near side is 3.2 from the centre: at the angle 0.7.
        (
            [
                Wall.segment((5.0, 5.0), (8.0, 5.0), turn=TURN),
                Wall.post((5.0 + 4.0 * math.cos(0.7), 5.0 + 4.0 * math.sin(0.7)), 0.8),
            ],
            0.2, 0.7,
        ),
        # The same with an arc, of which the end is in the way.
        ([Wall.segment((5.0, 5.0), (8.0, 5.0), turn=TURN), Wall.arc((5.0, 5.0), 3.2, (0.7, 3.0))], 0.2, 0.7),
    ],
)  # fmt: skip
def test_walls_that_come_too_near_are_named(walls: list[Wall], gap: float, time: float) -> None:
    (found,) = crushes(walls, BOX, 0.5, 0.0, 0.8)
    assert (found.one, found.other) == (0, 1)
    assert found.gap == pytest.approx(gap, abs=0.08)
    assert found.time == pytest.approx(time, abs=0.2)


@pytest.mark.parametrize(
    "walls",
    [
        [
            Wall.line((0.0, 0.5), (0.0, 1.0), motion=Motion("sine", amplitude=0.4, frequency=1.0)),
            *sides(BOX)[:3],
        ],
        [
            Wall.segment((2.0, 5.0), (6.0, 5.0), motion=DOWN, moves_from=2.0),
            Wall.segment((3.0, 4.0), (5.0, 4.0)),
        ],
        [
            Wall.segment((2.0, 5.0), (6.0, 5.0), motion=DOWN),
            Wall.segment((3.0, 4.0), (5.0, 4.0), opens_at=0.3),
        ],
        # Blades that move as one; lifters of a drum that stands still; a blade in a round room, always as near.
        [Wall.segment((5.0, 5.0), (8.0, 5.0), turn=TURN), Wall.segment((5.0, 5.0), (5.0, 8.0), turn=TURN)],
        [Wall.container((5.0, 5.0), 4.0, surface_speed=4.0), Wall.segment((8.0, 5.0), (9.0, 5.0), turn=TURN)],
        [Wall.container((5.0, 5.0), 4.0), Wall.segment((5.0, 5.0), (8.8, 5.0), turn=TURN)],
        [Wall.segment((5.0, 5.0), (8.0, 5.0), turn=TURN), Wall.post((9.0, 9.0), 0.8)],
    ],
)
def test_walls_that_crush_no_disk_are_not_reported(walls: list[Wall]) -> None:
    assert list(crushes(walls, BOX, 0.5, 0.0, 0.8)) == []


@pytest.mark.full
def test_a_simulation_and_a_check_report_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walls = [
        Wall.segment((2.0, 5.0), (6.0, 5.0), motion=DOWN, group="piston"),
        Wall.segment((3.0, 4.0), (5.0, 4.0)),
    ]
    disks = ifrdem.Disks(1, mass=1.0, radius=0.25)
    start = ifrdem.State([[9.0, 9.0]], [[0.0, 0.0]], np.zeros(1))
    run = ifrdem.Simulation(disks, BOX, ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0), start, walls=walls)
    with pytest.warns(
        ifrdem.WallWarning, match="piston 0 segment and wall 1 segment approach .* to 0.25 at t = 0.75"
    ):
        run.run(t_end=0.8)
    run.run(t_end=0.81)  # reported once
    path = tmp_path / "piston.toml"
    path.write_text(PISTON)
    assert main(["check", str(path)]) == 0
    assert "piston 0 segment and wall 1 segment approach each other to 0.25" in capsys.readouterr().err


PRESS = """
run = { name = "press", t_end = 20.0, units = "reduced" }
box = { lengths = [10.0, 10.0], periodic = [true, false], material = "m" }
material = [{ name = "m", e_n = 0.9, e_t = -1.0, mu = 0.0 }]
species = [{ name = "d", material = "m", mass = 1.0, diameter = 0.5, number = 5, speed_rms = 1.0 }]
[[wall]]
shape = "line"
material = "m"
point = [0.0, 0.5]
normal = [0.0, 1.0]
motion = { kind = "steady", speed = 0.5 }
"""


def test_lines_that_close_on_all_disks_are_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A floor that rises from 0.5 at 0.5 is at the ceiling, at 10, at t = 19."""
    monkeypatch.chdir(tmp_path)
    path = Path("press.toml")
    path.write_text(PRESS)
    for verb in ("check", "run"):
        assert main([verb, str(path)]) == 2
        printed = capsys.readouterr()
        assert re.search(
            r"wall 0 line and .*(upper|top|y).* approach .* all disks are between them", printed.err
        ), printed.err
        assert not printed.out
    assert list(tmp_path.iterdir()) == [tmp_path / path]
    for change in ("moves_until = 10.0", "opens_at = 15.0", "opens_after = 10"):  # no more, or perhaps not
        path.write_text(f"{PRESS}{change}\n")
        assert main(["check", str(path)]) == 0
        capsys.readouterr()
    path.write_text(PRESS.replace("20.0", "18.0"))  # 0.5 is left
    assert main(["check", str(path)]) == 0


@pytest.mark.full
def test_a_simulation_refuses_lines_that_close_on_all_disks() -> None:
    walls = [Wall.line((0.0, 0.5), (0.0, 1.0), motion=Motion("steady", speed=0.5))]
    disks, start = ifrdem.Disks(1, 1.0, 0.25), ifrdem.State([[5.0, 5.0]], [[0.0, 0.0]], np.zeros(1))
    run = ifrdem.Simulation(disks, BOX, ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0), start, walls=walls)
    with pytest.raises(ifrdem.InputError, match="all disks are between them"):
        run.run(t_end=20.0)
    assert run.time == 0.0
    run.run(t_end=1.0)
