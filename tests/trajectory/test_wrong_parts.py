"""Parts that are not trajectories or not files: each reader names the part, and none waits for a pipe."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.layout_files import BOX, FIELDS, some_disks, some_state
from support.trajectory_parts import SERIES_COLUMNS, TRACKED, batch, row
from test_fuzz_files import no_hang

import ifrdem
from ifrdem.cli.main import main
from ifrdem.errors import DamageError, InputError
from ifrdem.trajectory.parts_writer import PartsWriter
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.views import write_views

N, FRAMES, NUMBER = 41, 3, 4
NAMED = r"part run.parts/0002.h5 \(disks 20 to 29\)"


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("original") / "run.h5"
    disks = some_disks(N)
    with PartsWriter.create(path, disks, disks, BOX, number=NUMBER, fields=FIELDS) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        for number in range(FRAMES):
            whole = {
                "temperature": 2.0 / (1 + number),
                "rotational_temperature": 0.5,
                "collisions": 10 * number,
            }
            writer.write(some_state(N, number), whole)
            writer.write_series(0.03 * number, row(number), SERIES_COLUMNS)
            writer.write_histories(*batch(number))
    return path


def device(place: Path) -> None:
    place.symlink_to("/dev/zero")


WRONG: dict[str, Callable[[Path], object]] = {
    "empty": Path.touch,
    "a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "a device": device,
    "a link to nothing": lambda place: place.symlink_to("nowhere"),
    "a text": lambda place: place.write_text("[run]"),
}
WHOLE_GAS = ("info", "plot temperatures")
"""Commands that need no data of disks, and succeed."""
OF_DISKS = (
    "export --to csv", "export --to extxyz", "export --to gsd", "export --to h5 -o whole.h5", "history --id 5",
    "plot disks", "plot velocity", "plot msd", "plot rdf", "movie -o movie.webp", "view --html page.html",
    "analyse velocity msd", "repair",
)  # fmt: skip


@pytest.fixture(params=WRONG)
def wrong(request: pytest.FixtureRequest, original: Path, tmp_path: Path, monkeypatch) -> Path:
    shutil.copytree(original.parent, tmp_path, dirs_exist_ok=True)
    place = tmp_path / "run.parts/0002.h5"
    place.unlink()
    WRONG[request.param](place)
    monkeypatch.chdir(tmp_path)
    return Path("run.h5")


@pytest.mark.full
@pytest.mark.filterwarnings("default")
def test_every_verb_names_the_part(wrong, request, capsys):
    kind = list(WRONG).index(request.node.callspec.params["wrong"])
    some = OF_DISKS if kind == 1 else OF_DISKS[kind % 3 :: 3]  # all of them on a pipe, which hangs
    with no_hang():
        for words in (*WHOLE_GAS, *some):
            verb, *others = words.split()
            status = main([verb, str(wrong), *others])
            shown = capsys.readouterr()
            assert status == (0 if words in WHOLE_GAS else 2), (words, shown.err)
            assert "run.parts/0002.h5" in shown.err + shown.out, words


@pytest.mark.full(keep=1)
@pytest.mark.filterwarnings("ignore::ifrdem.errors.DamageWarning")
def test_every_method_names_the_part(wrong):
    with no_hang(), Trajectory(wrong) as trajectory:
        for act in (
            lambda: trajectory.dataset("position"),
            lambda: trajectory[0].position,
            lambda: trajectory[1].unwrapped,
            lambda: trajectory.disk(25),
            lambda: trajectory.universe(),
            lambda: trajectory.to_pandas("frame"),
            lambda: trajectory.to_xarray(),
            lambda: trajectory[0].plot(),
        ):
            with pytest.raises(DamageError, match=NAMED):
                act()
        for name in FIELDS:
            with Trajectory(wrong.with_name("run.parts") / "0001.h5") as part:
                frames, _, *tail = part.dataset(name).shape
                assert trajectory.shape(name) == (frames, N, *tail)
                assert trajectory.dtype(name) == part.dataset(name).dtype
        assert np.array_equal(
            trajectory.read("position", (1, 33)), some_state(N, 1).position[33].astype("f4")
        )
        assert trajectory.to_pandas().index.tolist() == [0.0, 0.03, 0.06]
        assert "temperature" in repr(trajectory.observables)
    with no_hang():
        assert ifrdem.concat([wrong, wrong]).sizes["run"] == 2


@pytest.mark.filterwarnings("ignore::ifrdem.errors.DamageWarning")
def test_views_show_what_is_there_and_lead_to_no_pipe(wrong):
    place = wrong.with_name("run.parts") / "0002.h5"
    with no_hang():
        if place.exists() and not place.is_file():
            with pytest.raises(InputError, match=f"{NAMED} is not a file"):
                write_views(wrong)
            assert not Path("run.nc").exists()
        else:
            write_views(wrong)
