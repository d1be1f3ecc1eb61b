"""Impacts in tracks of a simulator that shares no code with the engine."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import track_simulator as simulator
from support.track_coverage import WALLS, X, Y

from ifrdem import fit
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.fit import impacts, meeting, tracks
from ifrdem.fit.flight import Tray
from ifrdem.model.walls.wall import Wall

MATERIAL = np.arange(20) % 2
DISKS = {i: fit.Disk(mass=simulator.MASS[m], radius=simulator.RADIUS[m]) for i, m in enumerate(MATERIAL)}


def loaded(folder: Path, text: str, fps: float, **options: Any) -> tracks.Tracks:
    (folder / "tracks.csv").write_text(text, encoding="utf-8")
    return tracks.read(folder / "tracks.csv", fps=fps, **options)


def worst(row: dict[str, float], motion: simulator.Motion) -> float:
    """The largest distance of a velocity or spin from the truth, in its errors; infinite without a true impact."""
    ids = {int(row[name]) for name in ("id_1", "id_2") if name in row}
    near = [each for each in motion.impacts if abs(each.t - row["t"]) < 0.02]
    near = [each for each in near if ids == ({each.i} if each.j < 0 else {each.i, each.j})]
    if not near:
        return np.inf
    true = min(near, key=lambda each: abs(each.t - row["t"]))
    pulls = [0.0]
    for n in range(1, len(ids) + 1):
        k = 0 if int(row[f"id_{n}"]) == true.i else 1
        for q, name in enumerate(("vx", "vy", "spin")):
            for end, of in (("", true.before), ("_after", true.after)):
                column = f"{name}_{n}{end}"
                if not np.isnan(row.get(column, np.nan)):
                    pulls.append(abs(row[column] - of[k, q]) / row[f"{column}_error"])
    return max(pulls)


def rows(columns: Mapping[str, NDArray[np.float64]]) -> list[dict[str, float]]:
    return [dict(zip(columns, each, strict=True)) for each in zip(*columns.values(), strict=True)]


@pytest.mark.full
@pytest.mark.parametrize(
    ("fps", "spoilt"),
    [(120.0, {}), (240.0, {}), (1000.0, {}), (240.0, {"lost": 0.02}), (240.0, {"swaps": 4})],
    ids=["120", "240", "1000", "lost frames", "swapped ids"],
)
def test_impacts_in_a_walled_tray_are_right_within_their_errors(
    fps: float, spoilt: dict[str, Any], tmp_path: Path
) -> None:
    motion = simulator.simulate(fps, 3.0, seed=2)
    observed = loaded(tmp_path, simulator.film(motion, 3, **spoilt), fps)
    found = impacts.find(observed, DISKS, walls=WALLS, repair_swaps=True)
    assert found.noise.typical == pytest.approx(3e-4, rel=0.03)
    assert found.noise.angle == pytest.approx(np.radians(1.0), rel=0.05)
    every = np.array([*found.noise.position.values()])
    np.testing.assert_allclose(every, 3e-4, rtol=0.2)  # each from some 360 third differences at least: 5 %
    good = [
        row
        for columns in (found.pairs, found.walls)
        for row in rows(columns)
        if row["quality"] >= impacts.POOR
    ]
    assert len(good) > 0.7 * len(motion.impacts)
    assert max(worst(row, motion) for row in good) < 5.0
    assert len(found.exchanges) == spoilt.get("swaps", 0)


@pytest.mark.parametrize(
    ("a", "v", "rested", "noise"),
    [
        (2.0, 0.0, np.inf, (1e-4, 1e-4)),
        (0.02, 0.165, np.inf, (1e-4, 1e-4)),
        (2.0, 0.0, 0.02, (1e-5, 3e-5)),
    ],
    ids=["rests", "moves", "stops"],
)
def test_rest_before_an_impact_is_told_from_motion(
    a: float, v: float, rested: float, noise: tuple[float, float]
) -> None:
    """By all frames before: errors are those of a velocity that is known, or of 12 frames, 0.1 mm sqrt(12/12^3)/1 ms.

    Under 2 m/s2 and with noise of 0.1 mm, 12 frames of 1 ms do not tell rest from a stop (0.14 mm), 80 do (6.4 mm). At
    0.165 m/s a disk is in four frames within the noise of one place, and 13 mm away in the first one: under 0.02 m/s2 a
    disk that stops was 0.06 mm away. One that stopped 20 ms before was 3.6 mm away along x, 360 errors of x or 120 of y.
    """
    t = np.arange(-80, 161) / 1000.0

    def path(before: float, after: float) -> Any:
        stop = np.clip(t, 0.0, after / a)
        return np.where(
            t < 0.0, before * t - 0.5 * a * t**2 * (before > 0.0), after * stop - 0.5 * a * stop**2
        )

    change = 0.9 * (0.5 - v)  # e_n = 0.8, head-on, equal masses
    rng = np.random.default_rng(1)
    place = {
        i: np.stack([x, 0.0 * x], axis=-1) + noise * rng.standard_normal((len(t), 2))
        for i, x in enumerate((path(0.5, 0.5 - change), 0.02 + path(v, v + change)))
    }
    place[1][:, 0] -= 0.5 * a * np.maximum(-rested - t, 0.0) ** 2
    film = tracks.Tracks(dict.fromkeys(place, t), place, {}, "film")
    found = impacts.find(film, fit.Disk(mass=1.0, radius=0.01), friction=Tray(a0=a))
    (row,) = rows(found.pairs)
    moving = noise[0] * 1000.0 * np.sqrt(12.0 / 12.0**3)
    assert row["vx_2_error"] == pytest.approx(moving if v else 0.2 * row["vx_1_error"], rel=0.3)
    assert abs(row["vx_2"] - v) < 4.0 * row["vx_2_error"]
    assert abs(row["vx_1"] - 0.5) < 4.0 * row["vx_1_error"]
    assert bool(row["vx_2"] == row["vy_2"] == 0.0) is (v == 0.0)


def test_frames_in_which_a_disk_may_not_have_stopped_yet_are_not_those_of_rest() -> None:
    """It stopped 8 ms before an impact: 13 ms earlier it was 0.16 mm away, in noise of 0.1 mm.

    With these frames its velocity after the impact, along its way before, was off by 1.9 errors on average.
    """
    a, R, T, noise = 2.0, 0.01, 0.008, 1e-4
    t = np.arange(-80, 81) / 1000.0
    z = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        x = np.where(t < 0.0, 0.5 * t - 0.5 * a * t**2, 0.05 * t - 0.5 * a * np.minimum(t, 0.025) ** 2)
        other = 2.0 * R + np.where(t > 0.0, 0.45 * t - 0.5 * a * t**2, 0.0)
        across = -0.5 * a * np.maximum(-T - t, 0.0) ** 2
        place = {
            i: np.stack(each, axis=-1) + noise * rng.standard_normal((len(t), 2))
            for i, each in enumerate(((x, 0.0 * t), (other, across)))
        }
        film = tracks.Tracks(dict.fromkeys(place, t), place, {}, "film")
        found = impacts.find(film, fit.Disk(mass=1.0, radius=R), friction=Tray(a0=a), window=30)
        (row,) = rows(found.pairs)
        z.append(row["vy_2_after"] / row["vy_2_after_error"])
    assert abs(np.mean(z)) < 0.8  # 0.29 is its error


def test_a_coin_without_spin_after_an_impact_has_the_error_of_its_spin() -> None:
    """It slides to rest within the frames: the error of a spin near 0 was too small, at 0 none, that of the frames is 0.3."""
    disk, tray, rng = fit.Disk(mass=1.0, radius=0.01), Tray(law="coin", a0=2.0), np.random.default_rng(1)
    t, v, w = np.arange(-30, 31) / 1000.0, np.array([[0.1, -0.6], [0.02, 0.04]]), np.array([-9.0, 1e-4])
    moved, turned = tray.flight(np.stack([np.minimum(t, 0.0), np.maximum(t, 0.0)]), v, w, 0.01, 2.0)
    x = np.array([0.0, 0.01]) + np.sum(moved, axis=0) + 1e-4 * rng.standard_normal((len(t), 2))
    side = meeting.Side(disk, tray, t, x, np.sum(turned, axis=0), np.full(2, 1e-4), 0.01)
    flights = meeting.fitted([side], Wall.line((0, 0), (0, 1)), 0.0004, 0.001)
    row, at = flights.row(), flights.spin_at[0]
    assert row is not None
    assert at is not None
    assert abs(row["spin_1_after"]) < 0.05
    assert row["spin_1_after_error"] == pytest.approx(np.sqrt(flights.covariance[at + 2, at + 2]), rel=1e-6)
    assert row["spin_1_after_error"] > 0.1


def test_too_few_frames_per_second_are_named(tmp_path: Path) -> None:
    motion = simulator.simulate(30.0, 2.0, seed=5)
    found = impacts.find(loaded(tmp_path, simulator.film(motion, 3), 30.0), DISKS, walls=WALLS)
    short = found.reasons["a flight has fewer than 3 frames"]
    assert short > len(found)
    says = f"in {short} encounters a flight has fewer than 3 frames; {len(found)} impacts were found. Film at more"
    assert any(says in each for each in found.warnings)


@pytest.mark.full
def test_walls_that_are_not_given_are_found_as_change_points(tmp_path: Path) -> None:
    motion = simulator.simulate(240.0, 3.0, seed=2)
    found = impacts.find(loaded(tmp_path, simulator.film(motion, 3), 240.0), DISKS)
    good = [row for row in rows(found.pairs) if row["quality"] >= impacts.POOR]
    assert found.cut
    assert not found.walls
    assert sum(worst(row, motion) > 5.0 for row in good) <= 1  # two impacts within a frame of each other
    assert "flight has a change point: cut" in found.report()


@pytest.mark.full
def test_ids_that_were_exchanged_are_named_and_their_impacts_marked(tmp_path: Path) -> None:
    motion = simulator.simulate(240.0, 3.0, seed=2)
    observed = loaded(tmp_path, simulator.film(motion, 3, swaps=2), 240.0)
    found = impacts.find(observed, DISKS, walls=WALLS)
    true = {(each.i, each.j) for each in motion.impacts}
    assert len(found.exchanges) == 2
    assert all(each.ids in true or each.ids[::-1] in true for each in found.exchanges)
    for row in rows(found.pairs):
        for exchange in found.exchanges:
            if {row["id_1"], row["id_2"]} & {*exchange.ids} and row["t"] > exchange.time:
                assert row["quality"] == 0.0


@pytest.fixture(scope="module")
def motion() -> simulator.Motion:
    return simulator.simulate(240.0, 2.0, seed=5)


@pytest.mark.full
def test_mirrored_pictures_are_found_by_the_spins(motion: simulator.Motion, tmp_path: Path) -> None:
    text = simulator.film(motion, 3, y_sign=-1.0)
    with pytest.raises(
        InputError, match=r"y points down or angles run clockwise; flip = \['y'\] or \['angle'\]"
    ):
        impacts.find(loaded(tmp_path, text, 240.0), DISKS)
    turned = impacts.find(loaded(tmp_path, text, 240.0, flip=["y"]), DISKS, walls=WALLS)
    good = [row for row in rows(turned.pairs) if row["quality"] >= impacts.POOR]
    assert max(worst(row, motion) for row in good) < 5.0
    assert not turned.warnings


@pytest.mark.full(keep=1)
@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("pixels", r"positions are in pixels or another unit; units = \{'x': '0.0002"),
        ("radii of the other disks", r"radii 0.025 and 0.025 turn at 0.8\d* times the sum of their radii"),
        ("0.8 radii", r"nearest two disks are .* 1.2\d times the sum of their radii: the radii or the unit"),
        ("angles", r"angles are in another unit; units = \{'angle': 'rad'\}"),
    ],
)
def test_wrong_units_and_sizes_are_named(
    change: str, says: str, motion: simulator.Motion, tmp_path: Path
) -> None:
    text = simulator.film(motion, 3, scale=4000.0 if change == "pixels" else 1.0)
    if change == "angles":
        text = text.replace("angle (rad)", "angle")
    disks = DISKS
    if change.endswith("radii"):
        by = float(change.split()[0])
        disks = {i: fit.Disk(mass=d.mass, radius=by * float(np.asarray(d.radius))) for i, d in DISKS.items()}
    elif change.startswith("radii"):
        disks = {i: DISKS[i + 1 - 2 * (i % 2)] for i in DISKS}
    with pytest.raises(InputError, match=says):
        impacts.find(loaded(tmp_path, text, 240.0), disks)


@pytest.mark.parametrize(
    ("off", "scatter", "says"),
    [
        (0.07, 0.02, ""), (0.09, 0.02, "wrong$"), (-0.09, 0.02, "wrong$"), (0.02, 0.002, "wrong by that much"),
        (-0.02, 0.002, "wrong by that much"),
        (0.007, 0.002, ""), (0.004, 0.0002, ""),
    ],
)  # fmt: skip
def test_sizes_are_off_beyond_four_errors_of_the_median_gap(off: float, scatter: float, says: str) -> None:
    """Of 101 gaps, all but the median are 10/1.4826 of its error away from it; 0.005 is how well a sum of radii is known."""
    gaps = off + np.append(np.repeat([-1.0, 1.0], 50), 0.0) * scatter * np.sqrt(101) / 1.4826
    fits = [((0, 1), float(gap)) for gap in gaps]
    finder: Any = SimpleNamespace(radius={0: 0.02, 1: 0.03}, tracks=SimpleNamespace(source="tracks.csv"))
    text = rf"turn at {1.0 + off:.3g} times .*of 101 impacts, error {scatter:.2g}\): .* are {says}"
    if says == "wrong$":
        with pytest.raises(InputError, match=text):
            [*impacts._Finder._of_sizes(finder, fits)]
        return
    found = [*impacts._Finder._of_sizes(finder, fits)]
    assert len(found) == bool(says)
    assert all(re.search(text, each) for each in found)


@pytest.mark.full
def test_command_writes_tables_that_a_fit_takes(
    motion: simulator.Motion,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    head, *lines = simulator.film(motion, 3).splitlines()
    assert head.startswith("frame,id,x,y")
    text = "\n".join(("frame,particle,x,y,angle (rad)", *lines))  # as Trackpy names it
    Path("tracks.csv").write_text(text + "\n", encoding="utf-8")
    disks = ["--disk", "0.03,0.025"]
    for i in range(1, 20, 2):
        disks += ["--disk", f"{i}=0.02,0.02"]
    walls = [f"--wall={x}" for x in (f"0,0,{X},0", f"0,0,0,{Y}", f"{X},{Y},0,{Y}", f"{X},{Y},{X},0")]
    assert main(["collisions", "tracks.csv", "--fps", "240", *disks, *walls, "-o", "hits.csv"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"^standard error of a coordinate \S+ m, of an angle", shown, re.M)
    assert fit.read("hits.csv").si
    assert shown.startswith("found 62 collisions: 36 of two disks, 26 with walls\n")
    assert "17 a flight has fewer than 3 frames" in shown
    assert Path("hits_report.csv").read_text(encoding="utf-8").splitlines()[2] == "t,id_1,id_2,reason"
    of_walls = fit.read("hits_walls.csv")
    assert isinstance(of_walls, fit.Collisions)
    assert of_walls.wall
    hits = Path("hits.csv").read_text(encoding="utf-8").splitlines()
    hits[2] = ",".join("0" if i == 3 else value for i, value in enumerate(hits[2].split(",")))
    assert hits[1].split(",")[3] == "quality"
    Path("hits.csv").write_text("\n".join(hits) + "\n", encoding="utf-8")
    data, every = fit.read("hits.csv"), fit.read("hits.csv", min_quality=0.0)
    assert any(
        each.startswith(f"{len(every) - len(data)} of {len(every)} lines are left out") for each in data.notes
    )
    assert not any(each.startswith("columns not used") for each in data.notes)  # of t, id_1, id_2
    law = fit.fit(of_walls, model=["ifr-percussion"], profile=False).laws["ifr-percussion"]
    for name, true in zip(("e_n", "e_t", "mu"), simulator.WALL, strict=True):
        each = law.estimates[name]
        assert abs(each.value - true) < 4.0 * each.standard_error


@pytest.mark.full
def test_each_pair_of_materials_has_its_coefficients(tmp_path: Path) -> None:
    motion = simulator.simulate(240.0, 6.0, seed=11)
    found = impacts.find(loaded(tmp_path, simulator.film(motion, 12), 240.0), DISKS, walls=WALLS)
    (tmp_path / "hits.csv").write_text(impacts.csv(found.pairs), encoding="utf-8")
    data = fit.read(tmp_path / "hits.csv")
    assert isinstance(data, fit.Collisions)
    parts = data.kinds()
    assert len(parts) == 3
    for part in parts:
        masses = (float(np.asarray(disk.mass)[0]) for disk in (part.disk_1, part.disk_2))
        one, two = sorted(simulator.MASS.index(mass) for mass in masses)
        law = fit.fit(part, model=["ifr-percussion"], profile=False).laws["ifr-percussion"]
        for name, true in zip(("e_n", "e_t", "mu"), simulator.PAIR[one, two], strict=True):
            each = law.estimates[name]
            assert abs(each.value - true) < 4.0 * each.standard_error
