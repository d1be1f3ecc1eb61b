"""Walls estimated from tracks, polygons, and tables of disks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import track_simulator as simulator

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.fit import tracks
from ifrdem.fit.estimated_walls import _line, _Turns, estimated

X, Y = simulator.TRAY
RADIUS = {i: simulator.RADIUS[i % 2] for i in range(20)}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the film of a tray, 4 s at 240 frames/s."""
    monkeypatch.chdir(tmp_path)
    Path("tracks.csv").write_text(simulator.film(simulator.simulate(240.0, 4.0, 21), 21), encoding="utf-8")
    lines = ["id,mass (g),radius (mm),material"]
    for i in range(20):
        m = i % 2
        lines.append(f"{i},{1e3 * simulator.MASS[m]},{1e3 * simulator.RADIUS[m]},{'AB'[m]}")
    Path("disks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return tmp_path


def test_straight_walls_are_those_of_the_tray(folder: Path) -> None:
    """The four sides, to a millimetre (radii are 20 and 25 mm, the noise 0.3 mm) and to 5 mrad."""
    found = estimated(tracks.read("tracks.csv", fps=240.0), RADIUS)
    assert len(found) == 4
    sides = [(np.array(n), at) for n, at in simulator.SIDES]
    for outward, at in sides:
        (wall,) = (
            each for each in found if -np.array(each.normal(np.array([[X / 2, Y / 2]]))[0][0]) @ outward > 0.9
        )
        points = np.array([[0.2 * X, 0.2 * Y], [0.8 * X, 0.8 * Y], [0.2 * X, 0.8 * Y]])
        np.testing.assert_allclose(wall.normal(points)[1], at - points @ outward, atol=1e-3 + 5e-3 * 0.5)


def test_radii_do_not_tilt_or_shift_an_estimated_wall() -> None:
    """Turns of disks with radii of 20 mm on the left and 60 mm on the right; the wall is y = 0, without noise."""
    x, R = np.linspace(0.0, 1.0, 8), np.array([0.02] * 4 + [0.06] * 4)
    places, up = np.stack([x, R], axis=-1), np.tile([0.0, 1.0], (8, 1))
    # the second turn is off by 2 mm, so that the first pair of turns does not give the wall by itself
    places[1, 1] += 2e-3
    turns = _Turns(places, up, R, 4e-3)
    inside = tracks.Tracks({0: x}, {0: places + np.array([0.0, 0.1])}, {}, "turns")
    found = _line(turns, inside, {0: 0.02})
    assert found is not None
    wall, on = found
    assert on.all()
    points = np.array([[0.0, 0.5], [1.0, 0.5]])
    np.testing.assert_allclose(wall.normal(points)[1], 0.5, atol=2e-3)
    assert np.ptp(wall.normal(points)[1]) < 2.5e-3  # least squares of one value that is 2 mm off


def circle(seed: int, n: int = 240 * 8) -> tracks.Tracks:
    """One disk of radius 0.02 in a round tray of radius 0.3 about (0.1, 0.2), elastic and smooth, noise of 0.3 mm."""
    rng = np.random.default_rng(seed)
    x, v, dt = np.array([0.05, 0.02]), np.array([0.7, 0.4]), 1.0 / 240.0
    places = []
    for _ in range(n):
        places.append(x + np.array([0.1, 0.2]))
        left = dt
        while True:
            b, c = x @ v, x @ x - 0.28**2
            wait = (-b + np.sqrt(b * b - (v @ v) * c)) / (v @ v)
            if wait > left:
                x = x + left * v
                break
            x, left = x + wait * v, left - wait
            v = v - 2.0 * (v @ x) * x / (x @ x)
    position = np.array(places) + 3e-4 * rng.standard_normal((n, 2))
    return tracks.Tracks({0: np.arange(n) * dt}, {0: position}, {}, "circle")


def test_a_round_tray_is_found_as_one() -> None:
    (wall,) = estimated(circle(1), {0: 0.02})
    assert wall.shape == "container"
    np.testing.assert_allclose(wall.origin, [0.1, 0.2], atol=1e-3)
    assert wall.radius == pytest.approx(0.3, abs=1e-3)


def test_tracks_without_walls_give_none() -> None:
    t = np.arange(200) / 240.0
    free = np.stack([0.3 * t, 0.1 * t], axis=-1) + 3e-4 * np.random.default_rng(1).standard_normal((200, 2))
    with pytest.raises(InputError, match="0 of 0 changes of direction far from other disks lie on straight"):
        estimated(tracks.Tracks({0: t}, {0: free}, {}, "free"), {0: 0.02})


@pytest.mark.full
def test_estimated_polygonal_and_given_walls_find_the_same_impacts(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counts, lines = (
        {},
        [f"--wall=0,0,{X},0", f"--wall=0,0,0,{Y}", f"--wall={X},0,{X},{Y}", f"--wall=0,{Y},{X},{Y}"],
    )
    for name, walls in (
        ("given", lines),
        ("polygon", [f"--wall=0,0,{X},0,{X},{Y},0,{Y}"]),
        ("estimated", ["--walls", "estimate"]),
    ):
        assert (
            main(
                [
                    "collisions",
                    "tracks.csv",
                    "--fps",
                    "240",
                    "--disks",
                    "disks.csv",
                    *walls,
                    "-o",
                    f"{name}.csv",
                ]
            )
            == 0
        )
        shown = capsys.readouterr().out
        assert ("estimated wall: --wall " in shown) is (name == "estimated")
        texts = [
            Path(f"{name}{end}.csv").read_text(encoding="utf-8").splitlines()[1:] for end in ("", "_walls")
        ]
        counts[name] = [len(each) - 1 for each in texts]
        assert texts[0][0].endswith("material_1,material_2")
        assert {line.rsplit(",", 2)[1] for line in texts[0][1:]} == {"A", "B"}
        assert {line.rsplit(",", 1)[1] for line in texts[1][1:]} == {"wall"}
    assert min(counts["given"]) > 20
    for name in ("polygon", "estimated"):  # a corner, or a wall 0.1 mm away, can turn an encounter or two
        np.testing.assert_allclose(counts[name], counts["given"], atol=2)


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("id,mass,radius\n0,1,1\n0,1,1\n", "line 3: disk 0 is given twice"),
        ("id,mass,radius\n0,-1,1\n", "line 2: mass = -1: must be a positive finite number"),
        ("id,mass,radius\n0.5,1,1\n", "line 2: id = 0.5: must be an integer"),
        ("id,mass\n0,1\n", "missing column radius; there are id, mass"),
        ("id,mass,radius\n0,1,\n", "radius = nothing: must be a finite number"),
        (
            "id,mass,radius\n0,1,1\n",
            "tracks.csv: disks 1, 2, 3, 4, 5 and 14 more: mass and radius are not given; --disk MASS,RADIUS,K",
        ),
    ],
)
def test_bad_tables_of_disks_are_refused(
    table: str, says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("bad.csv").write_text(table, encoding="utf-8")
    assert main(["collisions", "tracks.csv", "--fps", "240", "--disks", "bad.csv"]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize("wall", ["1,2,3,4,5", "1,2", "0,0,0,0", "a,b,c", "1,2,-1"])
def test_bad_walls_are_refused(wall: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["collisions", "tracks.csv", "--fps", "240", "--disks", "disks.csv", f"--wall={wall}"]) == 2
    assert f"--wall {wall}: must be X1,Y1,X2,Y2" in capsys.readouterr().err
