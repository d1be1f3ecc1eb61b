"""Movies: disks at their positions and sizes, in the colours of their spins; the file plays."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import numpy as np
import pytest
from support.layout_files import BOX, write

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.motion import Motion, Turn
from ifrdem.model.walls.wall import Wall
from ifrdem.plots import disks as plot_disks
from ifrdem.plots import movie
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

pytestmark = pytest.mark.full


def two_disks(path: Path, **options) -> None:
    """One disk spins counter-clockwise at (5, 15), radius 2; one clockwise at (29, 4), across the right side."""
    disks = Disks(2, mass=1.0, radius=[2.0, 3.0])
    with TrajectoryWriter(path, disks, BOX, units={"length": "m", "time": "s"}, **options) as writer:
        for i in range(3):
            writer.write(State([[5.0, 15.0], [29.0, 4.0]], np.zeros((2, 2)), [2.0, -2.0], time=0.5 * i))


def inside(scene: movie.Scene) -> tuple[slice, slice]:
    """Rows and columns of the axes in a picture."""
    box, height = scene._axes.get_window_extent(), scene.size[1]
    return slice(height - round(box.y1), height - round(box.y0)), slice(round(box.x0), round(box.x1))


def colour_at(picture: np.ndarray, scene: movie.Scene, x: float, y: float) -> np.ndarray:
    """Colour of the picture at a position in the box."""
    rows, columns = inside(scene)
    column = columns.start + x / 30.0 * (columns.stop - columns.start)
    row = rows.stop - y / 20.0 * (rows.stop - rows.start)
    return picture[int(row), int(column)].astype(int)


def test_disks_are_drawn_where_they_are_in_the_colours_of_their_spins(tmp_path):
    two_disks(tmp_path / "run.h5")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        scene = movie.Scene(trajectory, range(3), (600, 500))
        picture = scene.draw(1)
        assert picture.shape == (500, 600, 3)
        orange, blue, white = [0xFF, 0x9A, 0x3D], [0x56, 0xB4, 0xE9], [255, 255, 255]
        for x, y in ((5.0, 15.0), (3.3, 15.0), (5.0, 16.7), (6.7, 15.0)):
            assert np.abs(colour_at(picture, scene, x, y) - orange).max() <= 2
        for x, y in ((29.0, 4.0), (27.0, 4.0), (1.0, 4.0)):  # and its image on the left
            assert np.abs(colour_at(picture, scene, x, y) - blue).max() <= 2
        for x, y in ((5.0, 12.5), (7.5, 15.0), (15.0, 10.0), (25.5, 4.0)):
            assert colour_at(picture, scene, x, y).tolist() == white
        again = scene.draw(1)
        assert np.array_equal(again, picture)
        assert not np.array_equal(scene.draw(2), picture)  # the time in its title


def test_moving_walls_are_drawn_where_they_are_then(tmp_path):
    wall = Wall.line((0.0, 5.0), (0.0, 1.0), motion=Motion(kind="steady", direction=(0.0, 1.0), speed=4.0))
    disks = Disks(1, mass=1.0, radius=0.5)
    with TrajectoryWriter(
        tmp_path / "run.h5", disks, Box((30.0, 20.0), (True, False)), walls=(wall,)
    ) as writer:
        for i in range(3):
            writer.write(State([[5.0, 18.0]], np.zeros((1, 2)), [1.0], time=1.0 * i))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        scene = movie.Scene(trajectory, range(3), (600, 500))
        for i, y in ((2, 13.0), (0, 5.0)):
            picture = scene.draw(i)
            for place in (5.0, 9.0, 13.0):
                assert (colour_at(picture, scene, 20.0, place).max() < 100) == (place == y)


def test_blades_are_drawn_as_they_turn_and_gates_until_they_open(tmp_path):
    """A blade along x from (15, 10) to (21, 10), a quarter of a turn later along y; a gate and an arc above it."""
    quarter = Turn("steady", center=(15.0, 10.0), rate=0.5 * np.pi)
    walls = (
        Wall.polyline([(15.0, 10.0), (18.0, 10.0), (21.0, 10.0)], turn=quarter),
        Wall.segment((2.0, 12.0), (8.0, 12.0), opens_at=1.0),
        Wall.segment((2.0, 8.0), (8.0, 8.0), opens_after=5),
        Wall.arc((25.0, 10.0), 3.0, (0.5 * np.pi, np.pi)),
    )
    disks = Disks(1, mass=1.0, radius=0.5)
    with TrajectoryWriter(
        tmp_path / "run.h5", disks, Box((30.0, 20.0), (True, False)), walls=walls
    ) as writer:
        for i in range(2):
            writer.write(State([[5.0, 18.0]], np.zeros((1, 2)), [1.0], time=1.0 * i), {"collisions": 6 * i})
    arc = 3.0 * np.sqrt(0.5)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        scene = movie.Scene(trajectory, range(2), (900, 700))
        for i, there, gone in (
            (0, [(19.0, 10.0), (5.0, 12.0), (5.0, 8.0)], [(15.0, 14.0)]),
            (1, [(15.0, 14.0)], [(19.0, 10.0), (5.0, 12.0), (5.0, 8.0)]),
        ):
            picture = scene.draw(i)
            for x, y in [*there, (25.0 - arc, 10.0 + arc)]:
                assert colour_at(picture, scene, x, y).max() < 100, (i, x, y)
            for x, y in [*gone, (25.0 + arc, 10.0 + arc)]:
                assert colour_at(picture, scene, x, y).min() > 200, (i, x, y)


def test_many_disks_are_a_map_of_the_area_fraction(tmp_path, monkeypatch):
    monkeypatch.setattr(plot_disks, "MOST_DISKS", 100)
    n = 400
    rng = np.random.default_rng(1)
    left = rng.uniform(0.0, 1.0, (n, 2)) * (12.0, 20.0)  # 10 of 25 columns of cells
    with TrajectoryWriter(tmp_path / "run.h5", Disks(n, mass=1.0, radius=0.1), BOX) as writer:
        for i in range(2):
            writer.write(State(left, np.zeros((n, 2)), np.zeros(n), time=1.0 * i))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        scene = movie.Scene(trajectory, range(2), (600, 500))
        covered = scene._covered(0)
        assert len(covered) == 25  # cells of 6 diameters
        assert covered[:10].mean() == pytest.approx(400 * np.pi * 0.01 / (12.0 * 20.0), rel=0.01)
        picture = scene.draw(0)
        rows, columns = inside(scene)
        half = (columns.start + columns.stop) // 2
        right = picture[rows, half + 5 : columns.stop - 5][5:-5]
        darkest = np.array([0, 34, 78])  # cividis at 0
        assert np.abs(right.astype(int) - darkest).max() <= 2
        brightness = picture[rows, columns.start + 5 : half - 5][5:-5].mean()
        assert brightness > darkest.mean() + 10.0


def test_angles_are_marked_where_the_file_holds_them(tmp_path):
    """Marks point where disks have turned to: one to the right, the other upwards."""
    state = State([[8.0, 10.0], [22.0, 10.0]], np.zeros((2, 2)), [3.0, 2.0])
    state.angle = np.array([0.0, 0.5 * np.pi])
    fields = ("position", "angular_velocity", "angle")
    with TrajectoryWriter(tmp_path / "run.h5", Disks(2, mass=1.0, radius=5.0), BOX, fields=fields) as writer:
        writer.write(state)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        scene = movie.Scene(trajectory, [0], (600, 500))
        picture = scene.draw(0)
        for x, y in ((11.0, 10.0), (22.0, 13.0)):
            assert colour_at(picture, scene, x, y).tolist() == [255, 255, 255]
        for x, y in ((5.0, 10.0), (8.0, 13.0), (8.0, 7.0), (22.0, 7.0), (19.0, 10.0), (25.0, 10.0)):
            assert colour_at(picture, scene, x, y).tolist() != [255, 255, 255]


# imageio-ffmpeg's reader leaves its pipes to the garbage collector.
@pytest.mark.full
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("colour", ["spin", "direction"])
def test_the_file_plays_with_as_many_pictures_as_frames(tmp_path, colour, capsys):
    import imageio_ffmpeg

    path = tmp_path / "run.h5"
    write(path, n=50, frames=6)
    arguments = ["movie", str(path), "--frames", "1:", "--fps", "10", "--size", "320x300", "--color", colour]
    assert main(arguments) == 0
    place = tmp_path / "run.mp4"
    assert f"wrote {place}: 5 pictures, 0.5 s" in capsys.readouterr().out
    pictures = imageio_ffmpeg.read_frames(str(place))
    about = next(pictures)
    assert about["codec"] == "h264"
    assert about["size"] == (320, 300)
    assert about["fps"] == 10.0
    shown = [np.frombuffer(each, dtype=np.uint8).reshape(300, 320, 3) for each in pictures]
    assert len(shown) == 5
    with Trajectory(path) as trajectory:
        scene = movie.Scene(trajectory, range(1, 6), (320, 300), colour)
        # compression changes the picture by a mean difference of some grey levels
        assert np.abs(scene.draw(3).astype(int) - shown[2]).mean() < 6.0
    assert sorted(os.listdir(tmp_path)) == ["run.h5", "run.mp4"]
    del pictures
    gc.collect()


def test_wrong_options_are_refused_before_work(tmp_path, capsys):
    path = tmp_path / "run.h5"
    write(path, n=5)
    for arguments, reason in (
        (["--size", "321x300"], "--size 321x300: must be width x height in pixels, even numbers"),
        (["--size", "big"], "such as 1280x720"),
        (["--fps", "0"], "--fps 0: must be an integer from 1 to 240"),
        (
            ["--color", "spni"],
            "--color spni: must be one of spin, speed, direction, temperature, radius, material",
        ),
        (["--frames", "7"], "names none of the 3 frames"),
    ):
        assert main(["movie", str(path), *arguments]) == 2
        assert reason in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["run.h5"]
    write(tmp_path / "bare.h5", fields=("position",))
    with (
        Trajectory(tmp_path / "bare.h5") as trajectory,
        pytest.raises(InputError, match="no field 'angular_velocity'"),
    ):
        movie.write(trajectory, tmp_path / "bare.mp4", range(3))


def test_disks_have_the_temperature_of_their_peculiar_velocity(tmp_path):
    """m c^2 / 2: mass 2 and velocity (3, 4) make 25; at y = 15, 5 above the middle, the flow of rate 0.4 is (2, 0)."""
    for box, expected in ((BOX, 25.0), (Box((30.0, 20.0), shear_rate=0.4), 1.0 + 16.0)):
        disks = Disks(1, mass=2.0, radius=1.0)
        with TrajectoryWriter(tmp_path / "run.h5", disks, box, precision="f64", force=True) as writer:
            writer.write(State([[5.0, 15.0]], [[3.0, 4.0]], [0.0]))
        with Trajectory(tmp_path / "run.h5") as trajectory:
            scene = movie.Scene(trajectory, [0], (600, 500), "temperature")
            assert scene._values(0).tolist() == pytest.approx([expected], rel=1e-15)


@pytest.mark.parametrize("lengths", [(0.8, 0.5), (0.3, 2.0), (30.0, 20.0)])
def test_a_movie_is_no_larger_than_the_box_and_its_margins(tmp_path, lengths):
    """Margins are narrow on all four sides, and nothing is cut: the outermost pixels are background."""
    scale = min(lengths)
    with TrajectoryWriter(
        tmp_path / "run.h5", Disks(2, mass=1.0, radius=0.05 * scale), Box(lengths)
    ) as writer:
        writer.write(State(np.array([[0.3, 0.3], [0.7, 0.7]]) * lengths, np.zeros((2, 2)), [1.0, -2.0]))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        scene = movie.Scene(trajectory, [0])
        picture = scene.draw(0)
    width, height = scene.size
    assert picture.shape == (height, width, 3)
    assert width % 2 == height % 2 == 0
    assert width <= 1200
    assert height <= 1080
    assert max(width / 1200, height / 1080) > 0.97
    used = np.argwhere((picture != 255).any(axis=2))
    low, high = used.min(axis=0), (height, width) - used.max(axis=0)
    assert low.min() > 1
    assert high.min() > 1
    assert max(*low, *high) < 40  # pixels


def test_titles_fit_on_small_pictures_with_the_time_below_the_name(tmp_path):
    two_disks(tmp_path / "run.h5", parameters={"name": "a name that is far too long for a picture"})
    with Trajectory(tmp_path / "run.h5") as trajectory:
        scene = movie.Scene(trajectory, range(3), (320, 300))
    time, name = (each for each in scene._axes.texts if each.get_text())
    extent = name.get_window_extent()
    assert 0.0 <= extent.x0 < extent.x1 <= 320.0
    assert extent.y1 <= 300.0
    assert time.get_window_extent().y1 <= extent.y0
    assert scene._axes.get_window_extent().y1 <= time.get_window_extent().y0


def test_the_scale_of_spins_is_that_of_frames_in_which_some_spin(tmp_path):
    """Disks at rest in most of the frames do not make the scale that of nothing."""
    disks = Disks(2, mass=1.0, radius=2.0)
    with TrajectoryWriter(tmp_path / "run.h5", disks, BOX) as writer:
        for i in range(9):
            spin = [8.0, -8.0] if i == 8 else [0.0, 0.0]
            writer.write(State([[5.0, 15.0], [20.0, 4.0]], np.zeros((2, 2)), spin, time=1.0 * i))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert (scene := movie.Scene(trajectory, range(9)))._high == 8.0
        assert scene._axes.child_axes
        assert not movie.Scene(trajectory, range(8))._axes.child_axes  # no spin, no bar


@pytest.mark.parametrize("kind", ["webp", "gif"])
def test_animations_for_web_pages_have_a_picture_a_frame(tmp_path, kind, capsys):
    from PIL import Image

    write(tmp_path / "run.h5", n=50, frames=6)
    out = tmp_path / f"a.{kind}"
    style = ["--style", "dark_background"]
    assert (
        main(["movie", str(tmp_path / "run.h5"), "-o", str(out), "--fps", "10", "--size", "320x300", *style])
        == 0
    )
    assert f"wrote {out}: 6 pictures, 0.6 s" in capsys.readouterr().out
    with Image.open(out) as shown:
        assert (shown.n_frames, shown.size) == (6, (320, 300))
        observed = []
        for i in range(6):
            shown.seek(i)
            shown.load()
            assert shown.info["duration"] == 100
            observed.append(np.asarray(shown.convert("RGB")).astype(int))
    assert max(observed[0][0, 0]) < 10  # dark
    assert np.abs(observed[0] - observed[5]).max() > 100


def test_unknown_endings_and_styles_are_refused(tmp_path, capsys):
    write(tmp_path / "run.h5", n=5)
    for arguments, reason in (
        (["-o", str(tmp_path / "a.avi")], "a movie is a file with the ending .mp4, .webp, .gif"),
        (["--style", "dark_backgroud"], "nor a file of one (did you mean 'dark_background'?)"),
        (["--quality", "0"], "--quality 0: must be an integer from 1 to 100"),
    ):
        assert main(["movie", str(tmp_path / "run.h5"), *arguments]) == 2
        assert reason in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["run.h5"]
