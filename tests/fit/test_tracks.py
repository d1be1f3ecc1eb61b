"""Collisions from simulated videos, and back to a fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ifrdem import fit
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.fit import impacts, tracks
from ifrdem.model.walls.wall import Wall
from ifrdem.tools.tables import TableFormat
from ifrdem.validation.fit_video import COIN
from ifrdem.validation.fit_video import tracks as video

DISK = fit.Disk(mass=COIN.mass, radius=COIN.radius)
TRUTH = {"e_n": 0.87, "e_t": -0.88, "mu": 0.21}


@pytest.mark.full(keep=("120.0-12",))
@pytest.mark.parametrize(("fps", "window"), [(120.0, 12), (1000.0, 40)])
def test_video_with_pixel_noise_gives_the_coefficients_back(tmp_path: Path, fps: float, window: int) -> None:
    """0.1 mm is a quarter of a pixel of a camera that sees 40 cm with 1,000 pixels."""
    (tmp_path / "tracks.csv").write_text(video(fps, 1e-4, 12), encoding="utf-8")
    found = impacts.find(tracks.read(tmp_path / "tracks.csv"), DISK, window=window)
    assert len(found) == 12
    assert found.noise.typical == pytest.approx(1e-4, rel=0.1)
    assert found.noise.angle == pytest.approx(0.01, rel=0.1)
    assert not found.cut
    np.testing.assert_allclose(found.pairs["t"] % 1.0, 0.12, atol=6e-4)  # of the video's impacts
    (tmp_path / "hits.csv").write_text(impacts.csv(found.pairs), encoding="utf-8")
    law = fit.fit(fit.read(tmp_path / "hits.csv"), model=["ifr-percussion"], profile=False).laws[
        "ifr-percussion"
    ]
    assert abs(law.chi2 - law.dof) < 4.0 * np.sqrt(2.0 * law.dof)  # errors and their correlations are right
    for name, true in TRUTH.items():
        each = law.estimates[name]
        assert abs(each.value - true) < 4.0 * each.standard_error
        assert each.standard_error < 0.02


def test_disks_that_pass_each_other_have_not_collided(tmp_path: Path) -> None:
    t = np.arange(0.0, 0.3, 1e-3)
    rows = [f"{s},0,{s - 0.15},0.0\n{s},1,{0.15 - s},{2.05 * COIN.radius}\n" for s in t]
    (tmp_path / "pass.csv").write_text("t,id,x,y\n" + "".join(rows), encoding="utf-8")
    with pytest.raises(InputError, match="no impact was found"):
        impacts.find(tracks.read(tmp_path / "pass.csv"), DISK, error=1e-4)
    in_mm = fit.Disk(mass=1.0, radius=10.5)  # they pass at 2.05 radii of 10.5e-3
    with pytest.raises(InputError, match=r"as near as 0\.00102 times the sum of their radii: the radii or"):
        impacts.find(tracks.read(tmp_path / "pass.csv"), in_mm, error=1e-4)


def test_places_without_scatter_need_their_error(tmp_path: Path) -> None:
    t = np.arange(0.0, 0.3, 0.01)
    rows = [f"{s},{i},{(2 * i - 1) * (COIN.radius + abs(0.15 - s))},0\n" for s in t for i in (0, 1)]
    (tmp_path / "exact.csv").write_text("t,id,x,y\n" + "".join(rows), encoding="utf-8")
    observed = tracks.read(tmp_path / "exact.csv")
    with pytest.raises(InputError, match="error: must be given, as the positions do not scatter"):
        impacts.find(observed, DISK)
    assert len(impacts.find(observed, DISK, error=1e-5)) == 1
    still = tracks.Tracks(
        observed.time, observed.position, {i: 0.0 * t for i, t in observed.time.items()}, "still"
    )
    found = impacts.find(still, DISK, error=1e-5)  # disks that never turn have angles without scatter
    assert found.pairs["spin_1_after"][0] == pytest.approx(0.0, abs=1e-6)


def test_bounce_off_a_wall_is_found(tmp_path: Path) -> None:
    """Onto y = 0 at (1, -1), off at (0.8, 0.7), with noise; R = 10.5 mm above it."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 0.2, 2e-3)
    tau = t - 0.1
    x = np.where(tau < 0.0, tau, 0.8 * tau)
    y = COIN.radius + np.where(tau < 0.0, -tau, 0.7 * tau)
    lines = [
        f"{i},4,{a},{b}"
        for i, (a, b) in enumerate(np.stack([x, y], axis=-1) + rng.normal(0.0, 1e-5, (len(t), 2)))
    ]
    (tmp_path / "wall.csv").write_text("frame,id,x,y\n" + "\n".join(lines), encoding="utf-8")
    found = impacts.find(
        tracks.read(tmp_path / "wall.csv", fps=500.0), DISK, walls=[Wall.line((0.0, 0.0), (0.0, 1.0))]
    )
    assert len(found) == 1
    got = [found.walls[name][0] for name in ("nx", "ny", "vx_1", "vy_1", "vx_1_after", "vy_1_after")]
    np.testing.assert_allclose(got, [0.0, -1.0, 1.0, -1.0, 0.8, 0.7], atol=2e-3)
    assert found.walls["t"][0] == pytest.approx(0.1, abs=1e-4)
    assert np.isinf(found.walls["mass_2"][0])


def test_whole_pixels_have_the_error_of_rounding() -> None:
    """A uniform distribution of width q has the standard deviation q / sqrt(12)."""
    t = np.arange(300.0)
    paths = {
        i: np.round(np.stack([v * t, 2.0 - 0.7 * v * t], axis=-1)) for i, v in enumerate((1.9, 0.31, 0.0))
    }
    whole = tracks.Tracks(dict.fromkeys(paths, t), {i: 0.25 * x for i, x in paths.items()}, {}, "pixels")
    every = np.array([*tracks.noise(whole, {}).position.values()])
    np.testing.assert_allclose(every, 0.25 / np.sqrt(12.0), rtol=0.2)


def test_an_exchange_of_ids_is_undone_at_its_frame() -> None:
    """Two disks of radius 0.5 that pass each other, with the ids exchanged from frame 12 on."""
    t, true = np.arange(30.0), {}
    for one, sign in ((3, 1.0), (8, -1.0)):
        true[one] = np.stack([0.5 * t, 0.6 * sign + 0.0 * t], axis=-1)
    mixed = {3: np.concatenate([true[3][:12], true[8][12:]]), 8: np.concatenate([true[8][:12], true[3][12:]])}
    angles = {3: np.where(t < 12.0, 0.01 * t, -0.02 * t), 8: np.where(t < 12.0, -0.02 * t, 0.01 * t)}
    mixed_up = tracks.Tracks({3: t, 8: t}, mixed, angles, "mixed")
    found = tracks.exchanges_in(mixed_up, {3: 0.5, 8: 0.5})
    assert found == [tracks.Exchange((3, 8), 12.0)]
    back = tracks.exchanged(mixed_up, found)
    for one, x in true.items():
        np.testing.assert_array_equal(back.position[one], x)
    for one, spin in ((3, 0.01), (8, -0.02)):
        np.testing.assert_allclose(back.angle[one], spin * t, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        ("t,id,x\n0,1,2\n", [], "missing column y"),
        ("frame,id,x,y\n0,1,2,3\n", [], "a column frame requires --fps"),
        ("t,id,x,y\n0,1.5,2,3\n", [], "line 2: id = 1.5: must be an integer"),
        ("t,id,x,y\n0,1,2,3\n0,1,2,3\n", [], "line 3: disk 1 has two rows at one time"),
        ("t,id,x,y\n0,1,2,3\n", ["--disk", "1"], "--disk 1: must be MASS,RADIUS"),
        ("t,id,x,y\n0,1,2,3\n", ["--wall", "1,2"], "--wall 1,2: must be X1,Y1,X2,Y2"),
        ("t,id,x,y\n0,1,2,3\n", [], "no disk has 4 frames at equal steps"),
        ("t,id,x,y\n0,1,2,3\n0,2,2,3\n0,1,,3\n", [], "no disk has 4 frames at equal steps; 1 lines have no position"),
        ("", [], "is empty"),
        ("t,id,x,y\n", [], "no line of values follows the names of the columns"),
        ("t,id,x,y\n0,1,nan,3\n1,1,nan,3\n", [], "column x: has no value"),
        ("t,id,x,y\n0,1,nan,3\n1,1,2,\n", [], "no line has an id, a time and a position"),
        ("t,id,x,y\n0,1,2,3\n.1,1,2,3\n.2,1,2,3\n", ["--fps", "20"], "t has a frame every 0.1, which is --fps 10"),
    ],
)  # fmt: skip
def test_wrong_tracks_are_refused(
    text: str,
    options: list[str],
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tracks.csv").write_text(text, encoding="utf-8")
    assert (
        main(["collisions", "tracks.csv", *(["--disk", "1,1"] if "--disk" not in options else []), *options])
        == 2
    )
    assert says in capsys.readouterr().err
    assert not Path("tracks_collisions.csv").exists()


def test_clips_whose_frames_begin_anew_are_told_apart(tmp_path: Path) -> None:
    """Two clips of two frames and two disks, frame by frame; sorted by disk, nothing tells them apart."""
    path = tmp_path / "twice.csv"
    clip = [f"{frame},{one},{frame + one},0" for frame in (0, 1) for one in (3, 5)]
    path.write_text("\n".join(["frame,id,x,y", *clip, *clip]), encoding="utf-8")
    found = tracks.read(path, fps=10.0)
    assert [number for _, _, number in found.clips] == [1, 2]
    np.testing.assert_array_equal(found.position[5][:, 0], [5.0, 6.0, 5.0, 6.0])
    assert np.all(np.diff(found.time[5]) > 0.0)
    path.write_text(
        "\n".join(["frame,id,x,y", *sorted([*clip, *clip], key=lambda row: row[2])]), encoding="utf-8"
    )
    with pytest.raises(
        InputError, match=r"(?s)line 4: disk 3 has two rows .*\n.*: a column clip numbers clips"
    ):
        tracks.read(path, fps=10.0)


TRACKMATE = "TRACK_ID,POSITION_T (sec),POSITION_X (micron),POSITION_Y (micron)"
"""Columns of TrackMate (its names of columns and its units)."""


def test_units_of_trackmate_are_read_and_unknown_ones_refused(tmp_path: Path) -> None:
    """The unit of a column that an option names was ignored, if unknown: a track was 1e6 times as long."""
    names = dict(zip(("id", "t", "x", "y"), TRACKMATE.split(","), strict=True))
    path = tmp_path / "spots.csv"
    path.write_text(f"{TRACKMATE}\n0,0.5,250,1e4\n0,0.75,500,1e4\n", encoding="utf-8")
    found = tracks.read(path, form=TableFormat(columns=names))
    np.testing.assert_allclose(found.time[0], [0.5, 0.75])
    np.testing.assert_allclose(found.position[0], [[2.5e-4, 1e-2], [5e-4, 1e-2]])
    for micro in "\u00b5\u03bc":  # the sign and the Greek letter
        path.write_text(f"id,t,x ({micro}m),y (micron)\n0,0.5,250,1e4\n", encoding="utf-8")
        np.testing.assert_allclose(tracks.read(path).position[0], [[2.5e-4, 1e-2]])
        own = TableFormat(units={"x": f"{micro}m", "y": "mm"})
        np.testing.assert_allclose(tracks.read(path, form=own).position[0], [[2.5e-4, 10.0]])
    path.write_text(
        f"{TRACKMATE}\n0,0.5,250,1e4\n0,0.75,500,1e4\n".replace("_X (micron)", "_X (inch)"), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"did you mean 'POSITION_X \(inch\)'"):
        tracks.read(path, form=TableFormat(columns=names | {"x": "POSITION_X"}))
    with pytest.raises(
        InputError, match=r"'POSITION_X \(inch\)': x must be in m, cm, mm, um, micron, not in inch"
    ):
        tracks.read(path, form=TableFormat(columns=names | {"x": "POSITION_X (inch)"}))
    units = {"x": "0.0254"}
    np.testing.assert_allclose(
        tracks.read(path, form=TableFormat(columns=names | {"x": "POSITION_X (inch)"}, units=units)).position[
            0
        ][:, 0],
        [6.35, 12.7],
    )


def test_lines_of_names_below_the_header_are_named_once(tmp_path: Path) -> None:
    """TrackMate writes four lines of them: each cell was a line of the message."""
    path = tmp_path / "spots.csv"
    path.write_text("id,t,x,y\nTrack ID,T,X,Y\n,(sec),(micron),(micron)\n0,0.5,250,1e4\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        tracks.read(path)
    first, second = str(caught.value).splitlines()
    assert (
        "line 2: Track ID, T, X, Y: must be numbers; delete lines of names or units below the header" in first
    )
    assert "line 3: " in second
