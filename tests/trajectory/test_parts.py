"""Trajectories in parts: NAME.h5 has bit for bit the content of one file, and no reader accepts an incomplete one."""

from __future__ import annotations

import functools
import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, FIELDS, some_disks, some_state
from support.trajectory_parts import SERIES_COLUMNS, TRACKED, batch, row
from test_writer_resume import content

from ifrdem.cli.main import main
from ifrdem.errors import DamageError, DamageWarning, InputError, TrajectoryError
from ifrdem.model.state import Disks, State
from ifrdem.mpi import SERIAL
from ifrdem.runs.info import describe
from ifrdem.trajectory import parts as part_files
from ifrdem.trajectory.parts_writer import PartsWriter
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.views import write_views
from ifrdem.trajectory.writer import TrajectoryWriter

N = 41
SOME = {"fields": FIELDS, "precision": "f64", "compression": "gzip"}


def go_on(writer: TrajectoryWriter | PartsWriter, first: int, end: int, n: int = N) -> None:
    """Frames, rows and batches of events from one number to another."""
    for number in range(first, end):
        state, observables = some_state(n, number), {"energy": 0.5 * number, "momentum": [1.0, number]}
        if isinstance(writer, PartsWriter):
            writer.write_frames([(writer.shares(state), observables)])
            writer.commit()
        else:
            writer.write(state, observables)
        writer.write_series(0.03 * number, row(number), SERIES_COLUMNS)
        writer.write_histories(*batch(number))


def write_parts(path: Path, number: int, frames: int = 5, n: int = N, **options) -> None:
    disks = some_disks(n)
    with PartsWriter.create(path, disks, disks, BOX, number=number, **options) as writer:
        writer.begin_histories(TRACKED, some_state(n, 0))
        go_on(writer, 0, frames, n)
        writer.flush()


def write_one(path: Path, frames: int = 5, n: int = N, **options) -> None:
    with TrajectoryWriter(path, some_disks(n), BOX, **options) as writer:
        writer.begin_histories(TRACKED, some_state(n, 0))
        go_on(writer, 0, frames, n)


def resume(
    path: Path, frames: int, n: int = N, disks: Disks | None = None, plain: bool = False, **options
) -> PartsWriter:
    """Resume from a checkpoint after so many frames, rows and batches of events; `plain` had frames only."""
    written = {} if plain else {"series_rows": frames, "events": 50 * frames}
    disks = some_disks(n) if disks is None else disks
    head = TrajectoryWriter.resume(path, disks, BOX, frames=frames, **written, **options)
    try:
        return PartsWriter.resume(head, disks, BOX, frames=frames, **options)
    except BaseException:
        head.close()
        raise


def shown(path: Path) -> dict[str, bytes]:
    """Every dataset as HDF5 shows it, without those about parts."""
    return {name: each for name, each in content(path).items() if not name.startswith("parts/")}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("original")
    write_parts(folder / "run.h5", 4)
    return folder


@pytest.fixture
def made(original: Path, tmp_path: Path) -> Path:
    """A trajectory in four parts of 10, 10, 10 and 11 disks."""
    shutil.copytree(original, tmp_path, dirs_exist_ok=True)
    return tmp_path / "run.h5"


def part(path: Path, number: int) -> Path:
    return path.parent / "run.parts" / f"{number:04d}.h5"


# --- the same bits


@pytest.mark.full(keep=2)
@pytest.mark.parametrize("options", [{}, SOME])
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_every_dataset_and_view_has_the_bits_of_one_file(tmp_path, number, options):
    for folder, write in (("one", write_one), ("parts", lambda *a, **b: write_parts(*a, number, **b))):
        (tmp_path / folder).mkdir()
        write(tmp_path / folder / "run.h5", **options)
        write_views(tmp_path / folder / "run.h5")
    for name in ("run.h5", "run.vtkhdf", "run.nc"):
        one, parts = (shown(tmp_path / folder / name) for folder in ("one", "parts"))
        assert parts == one
        assert len(one) > 10
    with h5py.File(tmp_path / "parts" / "run.h5") as file:  # no copy of the disks' numbers
        for name in ("radius", "position/value", "position/value_2d", "collisions/value"):
            assert file[f"particles/all/{name}"].is_virtual


def test_our_readers_see_the_same_as_in_one_file(tmp_path, made):
    write_one(tmp_path / "one.h5")
    with Trajectory(tmp_path / "one.h5") as one, Trajectory(made) as parts:
        assert one.parts is None
        assert parts.parts is not None
        assert len(parts.parts) == 4
        for name in ("radius", "mass", "k", "material"):
            assert np.array_equal(getattr(parts.disks, name), getattr(one.disks, name))
        for a, b in zip(parts, one, strict=True):
            assert a.time == b.time
            for name in one.fields:
                assert np.array_equal(a[name], b[name])
        for disk in (0, 9, 10, 39, 40):
            assert np.array_equal(parts.disk(disk).position, one.disk(disk).position)
        assert np.array_equal(parts.dataset("position")[1:3, 5:25], one.dataset("position")[1:3, 5:25])
        held = parts.dataset("position")  # for which HDF5 keeps the parts open, in its own way
        assert np.array_equal(held[2], one[2].position)
        assert np.array_equal(parts[2].position, held[2])
        assert np.array_equal(parts.history(TRACKED[0])["psi"], one.history(TRACKED[0])["psi"])
        assert np.array_equal(parts.observables["energy"], one.observables["energy"])
    printed = describe(made)
    assert "4 parts" in printed
    assert "run.parts/0002.h5: disks 20 to 29" in printed
    assert "packing fraction" in printed
    printed = describe(part(made, 2))
    assert "disks 20 to 29" in printed
    assert "packing fraction" not in printed  # that of the gas is not known there


def test_parts_of_any_selection_are_read(made):
    frames = [0, -1, slice(None), slice(1, 4, 2)]
    disks = [
        0,
        9,
        10,
        -1,
        slice(None),
        slice(3, 38, 4),
        slice(12, 15),
        slice(9, 11),
        slice(30, 2, -7),
        slice(5, 5),
    ]
    with Trajectory(made) as trajectory:
        whole = np.stack([some_state(N, i).position.astype("f4") for i in range(5)])
        for one, other in itertools.product(frames, disks):
            assert np.array_equal(trajectory.read("position", (one, other)), whole[one, other])
            assert np.array_equal(trajectory.read("position", (one, other, 1)), whole[one, other, 1])


def test_each_part_is_a_trajectory_of_its_own_disks(made):
    with Trajectory(part(made, 1)) as trajectory:
        assert trajectory.disks.n == 10
        assert np.array_equal(trajectory[3].position, some_state(N, 3).position[10:20].astype("f4"))


def test_mdanalysis_reads_it(made):
    mda = pytest.importorskip("MDAnalysis")
    universe = mda.Universe.empty(N, trajectory=True)
    universe.load_new(str(made), format="H5MD", convert_units=False)
    assert universe.trajectory.n_frames == 5
    for index, frame in enumerate(universe.trajectory):
        assert np.array_equal(frame.positions[:, :2], some_state(N, index).position.astype("f4"))
        assert not frame.positions[:, 2].any()
    with Trajectory(made) as trajectory:
        assert len(trajectory.universe().atoms) == N


def test_a_folder_that_is_moved_reads_the_same(tmp_path, made, monkeypatch):
    write_views(made)
    before = {name: shown(made.with_name(name)) for name in ("run.h5", "run.nc", "run.vtkhdf")}
    (tmp_path / "else").mkdir()
    for each in list(tmp_path.iterdir()):
        if each.name != "else":
            shutil.move(each, tmp_path / "else")
    assert {name: shown(tmp_path / "else" / name) for name in before} == before
    (tmp_path / "else" / "run.h5").rename(tmp_path / "else" / "other.h5")  # its parts keep their name
    assert shown(tmp_path / "else" / "other.h5") == before["run.h5"]
    monkeypatch.chdir(tmp_path / "else")
    with Trajectory("other.h5") as trajectory:
        assert len(trajectory) == 5


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("name", ["100%%.h5", "x%b.h5"])
def test_percent_signs_of_a_name_are_no_format_of_hdf5(tmp_path, name):
    write_parts(tmp_path / name, 3, **SOME)
    write_one(tmp_path / "one.h5", **SOME)
    with h5py.File(tmp_path / name) as shown, h5py.File(tmp_path / "one.h5") as stored:
        for at in ("position/value_2d", "position/value", "velocity/value_2d"):
            np.testing.assert_array_equal(shown[f"particles/all/{at}"], stored[f"particles/all/{at}"])
    assert main(["info", str(tmp_path / name)]) == 0
    for view in write_views(tmp_path / name):
        with h5py.File(view) as file:
            assert not any(np.isnan(each).any() for each in numbers(file))


def numbers(group: h5py.Group) -> list[np.ndarray]:
    """All datasets of floating point numbers in a group."""
    found: list[np.ndarray] = []
    for each in group.values():
        if isinstance(each, h5py.Group):
            found += numbers(each)
        elif each.dtype.kind == "f":
            found.append(each[()])
    return found


@pytest.mark.full
def test_export_puts_the_parts_together(tmp_path, made, capsys):
    write_one(tmp_path / "one.h5")
    assert main(["export", str(made), "--to", "h5"]) == 2  # onto itself
    assert "-o writes elsewhere" in capsys.readouterr().err
    assert main(["export", str(made), "--to", "h5", "-o", str(tmp_path / "whole.h5")]) == 0
    assert content(tmp_path / "whole.h5") == content(tmp_path / "one.h5")
    assert main(["export", str(made), "--to", "h5", "-o", str(tmp_path / "some.h5"), "--frames", "1::3"]) == 0
    with Trajectory(tmp_path / "some.h5") as trajectory:
        assert [frame.time for frame in trajectory] == [some_state(N, i).time for i in (1, 4)]
    main(["export", str(part(made, 2)), "--to", "h5", "-o", str(tmp_path / "part.h5")])
    with h5py.File(tmp_path / "part.h5") as file:
        assert part_files.PART not in file  # it is a plain file now


# --- what is missing


def foreign(path: Path, number: int) -> None:
    """A part of another run."""
    write_parts(path.parent / "other.h5", 4)
    shutil.copy(path.parent / "other.parts" / f"{number:04d}.h5", part(path, number))


def shorten(path: Path, number: int, frames: int = 3) -> None:
    """Take frames from the end of a part, as a copy of an hour ago lacks them."""

    def cut(_name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and item.maxshape[:1] == (None,) and not item.is_virtual:
            item.resize(frames, axis=0)

    with h5py.File(part(path, number), "r+") as file:
        file.visititems(cut)


WRONG = {
    "is missing": lambda path, number: part(path, number).unlink(),
    "is not a file": lambda path, number: (part(path, number).unlink(), part(path, number).mkdir()),
    "it belongs to another run": foreign,
    "it is part 1": lambda path, number: shutil.copy(part(path, 1), part(path, number)),
    "cannot be opened": lambda path, number: os.truncate(part(path, number), 5000),
    "does not say which part it is": lambda path, number: write_one(part(path, number), force=True),
    "is too short: it holds 3 of 5 frames": shorten,
}


@pytest.mark.full(keep=2)
@pytest.mark.parametrize("message", WRONG)
def test_readers_and_repair_name_a_part_that_is_missing_or_changed(made, message, capsys):
    WRONG[message](made, 2)
    short = "short" in message
    for read in (Trajectory, describe) if short else (lambda path: Trajectory(path)[2].position,):
        with pytest.raises(DamageError) as caught, warnings.catch_warnings(action="ignore"):
            read(made)
        assert "run.parts/0002.h5 (disks 20 to 29)" in str(caught.value)
        assert message in str(caught.value)
        assert "0001.h5" not in str(caught.value)
    assert main(["repair", str(made)]) == (0 if short else 2)
    printed = capsys.readouterr()
    assert "run.parts/0002.h5 (disks 20 to 29)" in printed.out
    assert message in printed.out
    if short:  # what all parts have is kept
        assert "3 of 5 frames are kept" in printed.out
        with Trajectory(made.with_name("run.repaired.h5")) as trajectory:
            assert trajectory.parts is None
            assert len(trajectory) == 3
            assert np.array_equal(trajectory[2].position, some_state(N, 2).position.astype("f4"))
    else:
        assert "1 of its 4 parts cannot be used" in printed.err
        assert not made.with_name("run.repaired.h5").exists()


@pytest.mark.full(keep=2)
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("message", [each for each in WRONG if "short" not in each])
def test_what_does_not_need_a_missing_part_can_be_read(made, message, capsys, tmp_path):
    with Trajectory(made) as whole:
        series, radius = whole.series["energy"], whole.constants("radius")
        positions = [frame.position for frame in whole]
    WRONG[message](made, 2)
    with pytest.warns(DamageWarning) as printed:
        trajectory = Trajectory(made)
    (warning,) = (str(each.message) for each in printed)
    assert f"run.parts/0002.h5 (disks 20 to 29) {'is missing' if message == 'is missing' else ''}" in warning
    assert message in warning
    assert "cannot be read, all else can" in warning
    assert (trajectory.n, len(trajectory), trajectory.missing) == (N, 5, (2,))
    assert "41 disks, 5 frames" in repr(trajectory)
    assert np.array_equal(trajectory.series["energy"], series)
    assert trajectory.observables["momentum"].tolist() == [[1.0, i] for i in range(5)]
    assert trajectory.tracked.tolist() == list(TRACKED)
    assert np.array_equal(trajectory.constants("radius", slice(30, 41)), radius[30:])
    assert np.array_equal(trajectory.read("position", (3, slice(3, 20))), positions[3][3:20].astype("f4"))
    path = trajectory.disk(33)
    assert path.unwrapped
    assert np.array_equal(trajectory.box.wrap(path.position), [frame[33] for frame in positions])
    for wrong in (
        lambda: trajectory.disks,
        lambda: trajectory.constants("mass", slice(19, 21)),
        lambda: trajectory[0].position,
        lambda: trajectory.disk(29),
        lambda: trajectory.history(5),  # which takes the radii of its partners
        lambda: trajectory.read("velocity", (1, slice(28, 35))),
    ):
        with pytest.raises(DamageError, match=r"run.parts/0002.h5 \(disks 20 to 29\)"):
            wrong()
    trajectory.close()
    assert main(["info", str(made)]) == 0
    out = capsys.readouterr()
    assert "0002.h5: disks 20 to 29, MISSING" in out.out
    assert "series (5 rows" in out.out
    assert out.err.count("warning") == 1
    assert main(["plot", str(made), "disks", "-o", str(tmp_path / "disks.png")]) == 2
    assert "0002.h5 (disks 20 to 29)" in capsys.readouterr().err


@pytest.mark.full
@pytest.mark.filterwarnings("default")
def test_temperatures_are_drawn_though_a_part_is_missing(tmp_path, capsys):
    path, disks = tmp_path / "run.h5", some_disks(N)
    with PartsWriter.create(path, disks, disks, BOX, number=4) as writer:
        for number in range(3):
            temperatures = {"temperature": 2.0 / (1 + number), "rotational_temperature": 0.5}
            writer.write(some_state(N, number), temperatures | {"collisions": 10 * number})
    part(path, 2).unlink()
    for over in ("t", "tau"):
        out = tmp_path / f"{over}.png"
        assert main(["plot", str(path), "temperatures", "--over", over, "-o", str(out)]) == 0
        assert out.stat().st_size > 1000
    assert capsys.readouterr().err.count("0002.h5 (disks 20 to 29) is missing") == 2


def test_repair_names_every_part_that_is_wrong(made, capsys):
    part(made, 0).unlink()
    shorten(made, 1)
    part(made, 3).unlink()
    assert main(["repair", str(made)]) == 2
    printed = capsys.readouterr()
    assert [f"{number:04d}.h5" in printed.out for number in range(4)] == [True, True, False, True]
    assert "2 of its 4 parts cannot be used" in printed.err


def test_repair_keeps_no_frame_that_a_part_does_not_count(made, capsys):
    with h5py.File(part(made, 1), "r+") as file:  # its fields are there, as after a kill before they counted
        for name in ("step", "time", "value"):
            file[f"particles/all/box/edges/{name}"].resize(4, axis=0)
    assert main(["repair", str(made)]) == 0
    assert "4 of 5 frames are kept" in capsys.readouterr().out


def test_repair_finds_nothing_wrong_and_does_not_replace_parts(made, capsys):
    write_views(made)
    assert main(["repair", str(made)]) == 0
    assert "nothing is wrong" in capsys.readouterr().out
    shorten(made, 1)
    before = made.read_bytes()
    assert main(["repair", str(made), "--in-place"]) == 2
    assert "--in-place cannot merge them" in capsys.readouterr().err
    assert made.read_bytes() == before


@pytest.mark.full
def test_repair_mends_a_part_up_to_its_first_damaged_frame(tmp_path, capsys):
    path = tmp_path / "run.h5"
    write_parts(path, 4, compression="gzip")
    with h5py.File(part(path, 2)) as file:
        place = file["particles/all/position/value_2d"].id.get_chunk_info(3)
    with open(part(path, 2), "r+b") as raw:
        raw.seek(place.byte_offset)
        raw.write(b"\x55" * place.size)
    with Trajectory(path) as trajectory, pytest.raises(DamageError, match=r"0002\.h5 is damaged"):
        trajectory[3].position  # noqa: B018 it is read
    assert main(["repair", str(part(path, 2)), "--in-place"]) == 0
    with pytest.raises(DamageError, match=r"0002\.h5 .* is too short: it holds 3 of 5 frames"):
        Trajectory(path)
    assert main(["repair", str(path)]) == 0
    with Trajectory(tmp_path / "run.repaired.h5") as trajectory:
        assert len(trajectory) == 3


def test_where_a_part_is_missing_other_programs_see_no_numbers(made):
    part(made, 1).unlink()
    with h5py.File(made) as file:
        value = file["particles/all/position/value"][0]
        assert np.isnan(value[10:20, :2]).all()
        assert np.isfinite(value[:10]).all()
        assert np.isfinite(value[20:]).all()
        assert np.isnan(file["particles/all/mass"][10:20]).all()
        assert (file["particles/all/collisions/value"][0, 10:20] == np.iinfo(np.int32).min).all()


@pytest.mark.parametrize("place", ["/etc/run.parts/0000.h5", "../run.parts/0000.h5", "secret.h5"])
def test_data_that_lie_elsewhere_than_in_the_parts_are_refused(made, place):
    with h5py.File(made, "r+") as file:
        group = file["particles/all"]
        del group["radius"]
        shows = h5py.VirtualLayout((N,), "f8")
        shows[:] = h5py.VirtualSource(place, "/particles/all/radius", shape=(N,), dtype="f8")
        group.create_virtual_dataset("radius", shows)
    with pytest.raises(InputError, match="radius is a virtual dataset of another place"):
        Trajectory(made)


def test_a_folder_of_parts_elsewhere_is_refused(made):
    with h5py.File(made, "r+") as file:
        file["parts"].attrs["folder"] = np.bytes_("../run.parts")
    with pytest.raises(DamageError, match="is no folder"):
        Trajectory(made)


# --- frames count when they are in all parts


def test_frames_count_when_all_parts_have_them(tmp_path):
    path, disks = tmp_path / "run.h5", some_disks(N)
    with PartsWriter.create(path, disks, disks, BOX, number=3) as writer:
        go_on_without_commit(writer, 0, 2)
        for queue in writer._own.values():
            queue.flush()
        assert [len(queue) for queue in writer._own.values()] == [2, 2, 2]
        assert len(writer) == 0
        with Trajectory(path) as trajectory:  # which is being written
            assert len(trajectory) == 0
        writer.flush()
        with Trajectory(path) as trajectory:
            assert len(trajectory) == 2
            assert np.array_equal(trajectory[1].position, some_state(N, 1).position.astype("f4"))
            go_on_without_commit(writer, 2, 3)
            writer.flush()
            assert trajectory.refresh() == 1
            assert np.array_equal(trajectory[2].position, some_state(N, 2).position.astype("f4"))


def go_on_without_commit(writer: PartsWriter, first: int, end: int) -> None:
    for number in range(first, end):
        writer.write_frames([(writer.shares(some_state(N, number)), {"energy": 1.0})])


def test_the_slowest_part_decides(tmp_path, monkeypatch):
    """One of three parts has two frames fewer than the others when frames are committed."""
    path, disks = tmp_path / "run.h5", some_disks(N)
    with PartsWriter.create(path, disks, disks, BOX, number=3) as writer:
        go_on_without_commit(writer, 0, 1)
        writer.flush()
        slow = writer._own.pop(1)
        go_on_without_commit(writer, 1, 3)
        for queue in writer._own.values():
            queue.flush()
        writer._own[1] = slow
        writer.commit()
        writer.commit()  # which changes nothing
        writer._head.flush()
        assert len(writer) == 1
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 1
    assert [len(h5py.File(part(path, i))["particles/all/box/edges/step"]) for i in range(3)] == [3, 1, 3]
    with resume(path, 1, plain=True) as writer:  # frames that only some parts have are compared there
        go_on_without_commit(writer, 1, 4)
        writer.flush()
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 4


def test_the_slowest_rank_decides(tmp_path):
    """Here three frames are in the part; another rank has one."""

    class Slow:
        def allgather(self, done: int) -> list[int]:
            return [done, 1]

    path, disks = tmp_path / "run.h5", some_disks(N)
    with PartsWriter.create(path, disks, disks, BOX) as writer:
        go_on_without_commit(writer, 0, 3)
        writer._own[0].flush()
        writer._comm = Slow()
        writer.commit()
        writer._head.flush()
        with Trajectory(path) as trajectory:
            assert len(trajectory) == 1
        writer._comm = SERIAL
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 3


@pytest.mark.full(keep=("2-options1",))
@pytest.mark.parametrize("options", [{}, SOME])
@pytest.mark.parametrize("written", [0, 2, 5])
def test_a_resumed_trajectory_is_that_of_an_uninterrupted_run(tmp_path, written, options):
    write_parts(tmp_path / "whole.h5", 3, 9, **options)
    write_parts(tmp_path / "run.h5", 3, 5, **options)
    with resume(tmp_path / "run.h5", written, **options) as writer:
        assert len(writer) == 5
        writer.begin_histories(TRACKED, some_state(N, 0))
        go_on(writer, written, 9)
        writer.flush()
        assert len(writer) == 9
        assert writer.written_counts == {"frames": 9, "series_rows": 9, "events": 450}
    assert shown(tmp_path / "run.h5") == shown(tmp_path / "whole.h5")


def test_another_run_is_refused_by_the_part_that_sees_it(made):
    state = some_state(N, 3)
    state.velocity[27, 1] = 0.25
    wrong = r"0002\.h5: frame 3.*velocity of disk 27, component y, is 0\.25"  # of all, not of the part
    writer = resume(made, 3)
    writer.write_frames([(writer.shares(state), {"energy": 1.5, "momentum": [1.0, 3]})])
    with pytest.raises(TrajectoryError, match=wrong):
        writer.flush()
    writer.close()
    heavier = some_disks(N)
    mass = heavier.mass.copy()
    mass[27] = 3.0
    heavier = type(heavier)(N, mass=mass, radius=heavier.radius, k=heavier.k, material=heavier.material)
    with pytest.raises(InputError, match=r"0002\.h5 has other disks: mass of disk 27"):
        resume(made, 3, disks=heavier)
    part(made, 3).unlink()
    with pytest.raises(InputError, match=r"0003\.h5 .* is missing"):
        resume(made, 3)


def test_what_is_there_is_replaced_only_by_force(made, tmp_path):
    before = content(made)
    with pytest.raises(InputError, match=r"0000\.h5 exists"):
        write_parts(made, 2)
    made.rename(tmp_path / "kept.h5")
    with pytest.raises(InputError, match=r"0000\.h5 exists"):
        write_parts(made, 2)
    (tmp_path / "kept.h5").rename(made)
    assert content(made) == before
    write_parts(made, 2, 3, force=True)
    assert [each.name for each in part_files.existing(made)] == ["0000.h5", "0001.h5"]
    with Trajectory(made) as trajectory:
        assert len(trajectory) == 3


def test_without_a_frame_nothing_is_left(tmp_path):
    disks = some_disks(N)
    PartsWriter.create(tmp_path / "run.h5", disks, disks, BOX, number=3).close()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="number = 42: must be at most the number of disks, 41"):
        PartsWriter.create(tmp_path / "run.h5", disks, disks, BOX, number=N + 1)
    with pytest.raises(InputError, match="must be one of 'f32', 'f64'"):
        PartsWriter.create(tmp_path / "run.h5", disks, disks, BOX, number=2, precision="f9")
    assert list(tmp_path.iterdir()) == []


# Imports once and forks a writer for each path on stdin.
FORKS = """
import os, sys
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tests", sys.argv[1] + "/tests/trajectory"]
import test_parts
for line in sys.stdin:
    pid = os.fork()
    if pid == 0:
        try:
            test_parts.write_many(test_parts.Path(line.strip()))
        finally:
            os._exit(1)
    os.waitpid(pid, 0)
    print("gone", flush=True)
"""
MANY = 3000


def go_on_frames(writer: PartsWriter, first: int, end: int) -> None:
    for number in range(first, end):
        writer.write_frames([(writer.shares(many(number)), {"energy": 0.5 * number})])
        writer.commit()


@functools.cache
def many(number: int) -> State:
    return some_state(MANY, number)


def write_many(path: Path) -> None:
    disks = some_disks(MANY)
    writer = PartsWriter.create(path, disks, disks, BOX, number=3)
    print(os.getpid(), flush=True)
    go_on_frames(writer, 0, 200)


@pytest.mark.full
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_killed_writer_leaves_frames_that_are_whole_in_all_parts(tmp_path):
    """Killed at four moments of writing 200 frames; what counts is whole, and the run can be gone on with."""
    root, lengths = str(Path(__file__).resolve().parents[2]), []
    words = [sys.executable, "-c", FORKS, root]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as forks:
        assert forks.stdin is not None
        assert forks.stdout is not None
        for number in range(4):
            path = tmp_path / str(number) / "run.h5"
            path.parent.mkdir()
            print(path, file=forks.stdin, flush=True)
            writer = int(forks.stdout.readline())
            time.sleep(0.02 + 0.14 * number)
            os.kill(writer, signal.SIGKILL)
            assert forks.stdout.readline() == "gone\n"
            with Trajectory(path) as trajectory:
                lengths.append(len(trajectory))
                for index, frame in enumerate(trajectory):
                    assert np.array_equal(frame.position, many(index).position.astype("f4"))
            written = max(lengths[-1] - 1, 0)
            with resume(path, written, MANY, plain=True) as again:
                go_on_frames(again, written, lengths[-1] + 3)
                again.flush()
            with Trajectory(path) as trajectory:
                assert len(trajectory) >= lengths[-1] + 3  # parts may have had more
                for index, frame in enumerate(trajectory):
                    assert np.array_equal(frame.velocity, many(index).velocity.astype("f4"))
        forks.stdin.close()
    assert len(set(lengths)) > 2, lengths  # not all were killed at one moment
