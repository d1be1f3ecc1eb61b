"""Runs compared with measured positions."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from support.cases import case_text
from support.layout_files import some_disks

import ifrdem
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.model.state import State
from ifrdem.runs import compare
from ifrdem.tools.tables import TableFormat
from ifrdem.trajectory.writer import TrajectoryWriter

CASE = case_text({
    "run.name": "two", "run.t_end": 2.0, "run.units": None, "box.open": True, "box.packing_fraction": None,
    "material[0].name": "m", "material[0].e_n": 0.8, "material[0].e_t": -1.0, "material[0].mu": 0.0,
    "species[0].name": "a", "species[0].number": 2, "species[0].material": "m",
    "species[0].speed_rms": None, "start": {"file": "start.csv"}, "output": {"frames": 4},
})  # fmt: skip


@pytest.fixture
def head_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Disk 0 at 1 m/s meets disk 1 at rest after 1 s, head-on: e_n = 0.8 leaves it 0.1 m/s, and gives 0.9 m/s."""
    monkeypatch.chdir(tmp_path)
    Path("two.toml").write_text(CASE, encoding="utf-8")
    Path("start.csv").write_text("x,y,vx,vy,spin\n0,0,1,0,0\n2,0,0,0,0\n", encoding="utf-8")
    assert main(["run", "two.toml", "--no-picture", "--quiet"]) == 0
    return tmp_path / "two.h5"


@pytest.mark.full
def test_picture_has_walls_and_times_of_positions(head_on: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    walls = '[[wall]]\nshape = "line"\npoint = [0.0, 4.45]\nnormal = [0.0, 1.0]\nmaterial = "m"\n'
    case = CASE.replace("open = true", 'lengths = [10.0, 10.0]\nperiodic = [true, false]\nmaterial = "m"')
    Path("two.toml").write_text(case + walls, encoding="utf-8")
    Path("start.csv").write_text("x,y,vx,vy,spin\n0,5,1,0,0\n2,5,0,0,0\n", encoding="utf-8")
    assert main(["run", "two.toml", "--no-picture", "--quiet", "--force"]) == 0
    Path("rest.csv").write_text("id,x,y,t\n0,1.1,5.3,\n0,0.5,5,0.5\n", encoding="utf-8")
    found = compare.compare(head_on, compare.read("rest.csv", {"positions": 0.1}, TableFormat()))
    figures = []
    monkeypatch.setattr(compare, "save", lambda figure, paths: figures.append(figure))
    found.draw([Path("two.png")])
    (axes,) = figures[0].axes
    assert [text.get_text() for text in axes.texts] == ["0", "0, t = 0.5"]
    assert any(np.allclose(line.get_ydata(), 4.45) for line in axes.lines)
    figures[0].savefig("two.png")


def test_places_distances_and_spread_are_those_of_the_mechanics(
    head_on: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("rest.csv").write_text("id,x,y,t\n0,1.1,0.3,\n1,2.9,0,\n0,0.5,0,0.5\n", encoding="utf-8")
    observed = compare.read("rest.csv", {"positions": 0.1}, TableFormat())
    found = compare.compare(
        head_on,
        observed,
        laws=[{"e_n": 0.6, "e_t": -1.0, "mu": 0.0}, {"e_n": 1.0, "e_t": -1.0, "mu": 0.0}],
        members=4,
    )
    np.testing.assert_allclose(found.position, [[1.1, 0.0], [2.9, 0.0], [0.5, 0.0]], atol=1e-5)
    np.testing.assert_allclose(found.distance, [0.3, 0.0, 0.0], atol=1e-5)
    # e_n = 0.6, 1: disk 0 leaves at 0.2, 0 m/s and disk 1 at 0.8, 1 m/s, for one second
    np.testing.assert_allclose(found.members[:2, :, 0], [[1.2, 2.8, 0.5], [1.0, 3.0, 0.5]], atol=1e-5)
    spread = math.sqrt(4 * 0.1**2 / 3)
    np.testing.assert_allclose(found.spread[:2, 0], spread, rtol=1e-3)
    assert found.deviation[0] == pytest.approx(
        3.0, rel=1e-3
    )  # 0.3 across, where nothing but the error of 0.1 is
    assert "within the 68 % ellipse 67%" in found.table()
    found.draw([Path("two.png")])
    assert Path("two.png").read_bytes().startswith(b"\x89PNG")
    assert main(["compare", "two.h5", "rest.csv", "-o", "out.csv"]) == 0
    assert "root mean square distance 0.1732" in capsys.readouterr().out
    assert Path("out.csv").read_text(encoding="utf-8").startswith("id,t,x,y,x_run")


@pytest.mark.parametrize("error", [0.0, 1.0])
@pytest.mark.parametrize("members", [5, 50])
def test_ellipses_contain_the_stated_share_of_positions(members: int, error: float) -> None:
    """The truth is one more of the runs, and 4,000 places make a statistical error of 0.007 and 0.003.

    Chi-square limits instead of Hotelling's hold 49 and 75 % for five runs without errors of the measurement.
    """
    rng, m = np.random.default_rng(1), 4000
    root = np.array([[2.0, 0.0], [1.5, 0.5]])
    places = rng.standard_normal((members + 1, m, 2)) @ root.T
    observed = compare.Measured(
        np.arange(m), np.full(m, math.inf), places[-1] + error * rng.standard_normal((m, 2)),
        np.full((m, 2), error), np.full(m, math.nan), np.full(m, math.nan),
    )  # fmt: skip
    found = compare.Comparison(
        observed, places[0], observed.angle, places[:-1], np.ones((m, 2)), places[:1], np.ones(1), ""
    )
    assert np.mean(found.probability < 0.68) == pytest.approx(0.68, abs=0.03)
    assert np.mean(found.probability < 0.95) == pytest.approx(0.95, abs=0.015)


def test_start_errors_spread_the_runs(head_on: Path) -> None:
    """Of 0.1 m/s: disk 0 flies 1 s at v, then a second or so at 0.1 v; disk 1 takes 0.9 v: spreads follow by differences."""
    Path("rest.csv").write_text("id,x,y,t\n0,0.5,0,0.5\n", encoding="utf-8")
    observed = compare.read("rest.csv", {}, TableFormat())
    found = compare.compare(head_on, observed, errors={"velocities": 0.1}, members=6, seed=3)
    assert 0.02 < found.spread[0, 0] < 0.1  # 0.05 for 0.5 s, from six draws


@pytest.mark.full(keep=2)
@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("id,x\n0,1\n", "missing column y"),
        ("id,x,y\n0.5,1,1\n", "line 2: id = 0.5: must be an integer"),
        ("id,x,y\n7,1,1\n", "disk 7: the run has disks 0 to 1"),
        ("id,x,y,t\n0,1,1,9\n", "t = 9: the run lasts from 0 to 2"),
        ("id,x,y,x_error\n0,1,1,-1\n", "line 2: error of x = -1"),
    ],
)
def test_wrong_places_are_refused(head_on: Path, text: str, says: str) -> None:
    Path("rest.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=says):
        compare.compare(head_on, compare.read("rest.csv", {}, TableFormat()))


@pytest.mark.parametrize(
    ("units", "says"),
    [({}, ""), ({"length": "reduced"}, "lengths in reduced units, "), ({"length": "m"}, "lengths in m, ")],
)
def test_units_are_those_that_the_file_states(tmp_path: Path, units: dict[str, str], says: str) -> None:
    disks, box = ifrdem.Disks(1, 1.0, 0.5), ifrdem.Box((9.0, 9.0))
    with ifrdem.TrajectoryWriter(tmp_path / "one.h5", disks, box, units=units) as file:
        file.write(ifrdem.State([[1.0, 2.0]], [[0.0, 0.0]], [0.0]))
    (tmp_path / "seen.csv").write_text("id,x,y,t\n0,1,2,0\n", encoding="utf-8")
    observed = compare.read(tmp_path / "seen.csv", {"positions": 0.1}, TableFormat())
    table = compare.compare(tmp_path / "one.h5", observed, members=0).table()
    assert table.splitlines()[0] == f"1 places; {says}angles in degrees"


def test_many_rows_lie_between_the_frames(tmp_path: Path) -> None:
    """30,000 rows: a pass over all of them for each row would take minutes."""
    n, frames, rows, chance = 10, 50, 30_000, np.random.default_rng(1)
    times = np.cumsum(chance.uniform(0.05, 0.2, frames))
    places, angles = chance.uniform(0.0, 20.0, (frames, n, 2)), chance.normal(size=(frames, n))
    fields = ("position", "velocity", "angular_velocity", "angle")
    walled = ifrdem.Box((20.0, 20.0), periodic=(False, False))  # no side to go around
    with TrajectoryWriter(
        tmp_path / "run.h5", some_disks(n), walled, fields=fields, precision="f64"
    ) as writer:
        for time, place, angle in zip(times, places, angles, strict=True):
            writer.write(State(place, np.zeros((n, 2)), np.zeros(n), time=time, angle=angle))
    disks, at = chance.integers(0, n, rows), chance.uniform(times[0], times[-1], rows)
    at[:frames] = times  # at frames, to the bit
    at[-1] = np.inf
    measured = compare.Measured(
        disks,
        at,
        chance.uniform(0.0, 20.0, (rows, 2)),
        np.full((rows, 2), 0.1),
        np.zeros(rows),
        np.zeros(rows),
    )
    found = compare.compare(tmp_path / "run.h5", measured)
    text, csv = found.table(), found.csv()
    assert (len(text.splitlines()), len(csv.splitlines())) == (rows + 4, rows + 1)
    some = np.r_[0:frames, chance.integers(0, rows, 200), rows - 1]
    for i in some:  # NumPy's own interpolation, a row at a time
        when = min(at[i], times[-1])
        assert found.angle[i] == np.interp(when, times, angles[:, disks[i]])
        for axis in (0, 1):
            assert found.position[i, axis] == np.interp(when, times, places[:, disks[i], axis])
