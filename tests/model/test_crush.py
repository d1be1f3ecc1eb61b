"""Walls that would crush a disk are foreseen; those that only touch, cross or pass at a constant distance are not."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.cli.main import main
from ifrdem.model.box import Box
from ifrdem.model.crush import crushes
from ifrdem.model.walls import Motion, Turn, Wall, sides

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
def test_walls_that_crush_nobody_are_not(walls: list[Wall]) -> None:
    assert list(crushes(walls, BOX, 0.5, 0.0, 0.8)) == []


def test_a_simulation_and_a_check_tell_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walls = [
        Wall.segment((2.0, 5.0), (6.0, 5.0), motion=DOWN, group="piston"),
        Wall.segment((3.0, 4.0), (5.0, 4.0)),
    ]
    disks = ifrdem.Disks(1, mass=1.0, radius=0.25)
    start = ifrdem.State([[9.0, 9.0]], [[0.0, 0.0]], np.zeros(1))
    run = ifrdem.Simulation(disks, BOX, ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0), start, walls=walls)
    with pytest.warns(
        ifrdem.WallWarning, match="piston 0 segment and wall 1 segment come within 0.25 .* at t = 0.75"
    ):
        run.run(t_end=0.8)
    run.run(t_end=0.81)  # told once
    path = tmp_path / "piston.toml"
    path.write_text(PISTON)
    assert main(["check", str(path)]) == 0
    assert "piston 0 segment and wall 1 segment come within 0.25" in capsys.readouterr().err
