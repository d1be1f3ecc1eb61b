"""No command writes to a device, a pipe, a folder or the trajectory that it reads."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from support.layout_files import write

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.plots import movie, run
from ifrdem.runs.outputs import Outputs
from ifrdem.tools.files import write_aside
from ifrdem.trajectory import export, repair, views
from ifrdem.trajectory.reader import Trajectory


def make_pipe(place: Path, path: Path) -> None:
    os.mkfifo(place)


def make_folder(place: Path, path: Path) -> None:
    place.mkdir()


def link(place: Path, path: Path) -> None:
    place.symlink_to(path)


def second_name(place: Path, path: Path) -> None:
    os.link(path, place)


THINGS: list[tuple[Callable[[Path, Path], None], str]] = [
    (make_pipe, "is a device or pipe"),
    (make_folder, "is a folder"),
    (link, "is the trajectory itself"),
    (second_name, "is the trajectory itself"),
]


def kind(place: Path) -> int:
    return stat.S_IFMT(os.lstat(place).st_mode)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write(tmp_path / "run.h5", n=20, frames=3)
    return tmp_path / "run.h5"


@pytest.mark.parametrize(("make", "message"), THINGS)
@pytest.mark.parametrize("name", ["run.vtkhdf", "run.nc"])
def test_views_replace_views_only(path: Path, make: Callable, message: str, name: str, capsys) -> None:
    place, before = path.with_name(name), path.read_bytes()
    make(place, path)
    was = kind(place)
    assert main(["link", str(path)]) == 2
    assert message in capsys.readouterr().err
    assert kind(place) == was
    assert path.read_bytes() == before
    assert sorted(os.listdir(path.parent)) == sorted(["run.h5", name])  # nor is the other one written


@pytest.mark.full(keep=4)
@pytest.mark.parametrize(("make", "message"), THINGS)
@pytest.mark.parametrize("verb", ["repair", "movie", "export --to csv", "plot disks"])
def test_verbs_replace_files_only_and_never_their_input(
    path: Path, make: Callable, message: str, verb: str, capsys
) -> None:
    place, before = path.with_name("out"), path.read_bytes()
    make(place, path)
    was = kind(place)
    first, *rest = verb.split()
    assert main([first, str(path), *rest, "-o", str(place), "--force"]) == 2
    assert message in capsys.readouterr().err
    assert kind(place) == was
    assert path.read_bytes() == before


@pytest.mark.parametrize(("make", "message"), THINGS)
def test_functions_refuse_likewise(path: Path, make: Callable, message: str) -> None:
    place, before = path.with_name("out"), path.read_bytes()
    make(place, path)
    with Trajectory(path) as trajectory:
        for write_it in (
            lambda: export.export(trajectory, place, "csv", [0]),
            lambda: movie.write(trajectory, place, [0], size=(160, 160)),
            lambda: repair.repair(path, place, log=lambda line: None),
        ):
            with pytest.raises(InputError, match=message):
                write_it()
    assert path.read_bytes() == before
    assert kind(place) in (stat.S_IFIFO, stat.S_IFDIR, stat.S_IFLNK, stat.S_IFREG)


@pytest.mark.parametrize(("make", "message"), THINGS[:2])
def test_nothing_that_is_no_file_is_replaced_by_a_picture(path: Path, make: Callable, message: str) -> None:
    from matplotlib.figure import Figure

    place = path.with_name("out.png")
    make(place, path)
    was = kind(place)
    with pytest.raises(InputError, match=message):
        run.save(Figure(), place)
    with pytest.raises(InputError, match=message):
        write_aside(place, lambda aside: aside.write_text("x"))
    assert kind(place) == was
    assert len(os.listdir(path.parent)) == 2


def test_views_go_with_the_trajectory_that_they_show(path: Path) -> None:
    """A run that writes no views takes the place of one that had them: its frames are not shown at the old times."""
    made = views.write_views(path)
    theirs = path.with_name("run.png")  # some other file next to it
    theirs.write_text("mine")
    outputs = Outputs(path, None)
    with pytest.raises(
        InputError, match=r"run\.h5: exists already[^$]*run\.vtkhdf: exists[^$]*run\.nc: exists"
    ):
        outputs.check(force=False)
    write(path, n=20, frames=2, force=True)
    assert sorted(os.listdir(path.parent)) == ["run.h5", "run.png"]

    # Renamed, the trajectory leaves its views at the old name, where the next run would be shown by them.
    views.write_views(path)
    path.rename(path.with_name("kept.h5"))
    with pytest.raises(InputError, match=r"run\.nc: exists already"):
        outputs.check(force=False)
    outputs.check(force=True)
    write(path, n=20, frames=2, force=True)
    assert not any(view.exists() for view in made)
    made[1].write_text("no view")
    outputs.check(force=True)
    write(path, n=20, frames=2, force=True)
    assert made[1].read_text() == "no view"


@pytest.mark.parametrize("verb", ["info", "link", "repair", "repair --in-place", "export --to csv"])
def test_a_pipe_is_no_trajectory_and_is_not_waited_for(tmp_path: Path, verb: str, capsys) -> None:
    os.mkfifo(tmp_path / "run.h5")
    first, *rest = verb.split()
    assert main([first, str(tmp_path / "run.h5"), *rest]) == 2
    assert "is a device or pipe: must be a trajectory file" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["run.h5"]


def test_repair_in_place_of_a_link_repairs_what_it_points_to(path: Path, capsys) -> None:
    import h5py

    named = path.with_name("latest.h5")
    named.symlink_to(path)
    with h5py.File(path, "r+") as file:
        file["particles/all/position/step"].resize(2, axis=0)
    assert main(["repair", str(named), "--in-place"]) == 0
    assert named.is_symlink()
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 2
    assert repair.repair(path, path, log=lambda line: None) is False


def test_views_written_twice_are_replaced(path: Path) -> None:
    made = views.write_views(path)
    assert views.write_views(path) == made
    assert [one.exists() for one in made] == [True, True]
