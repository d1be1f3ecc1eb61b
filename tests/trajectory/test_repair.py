"""Undamaged data of a trajectory are kept, and nothing else; losses are reported."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import FIELDS, add_histories, add_series, some_state, write
from test_frame import flip
from test_reader import child

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.repair import repair

N = 300


def assert_frames(path: Path, frames: list[int], dtype: type = np.float32) -> None:
    """The file opens by itself and holds these frames of `some_state`, in its views too."""
    with Trajectory(path) as trajectory:
        assert len(trajectory) == len(frames)
        for frame, number in zip(trajectory, frames, strict=True):
            state = some_state(N, number)
            assert frame.time == state.time
            assert np.array_equal(frame.position, state.position.astype(dtype))
            assert np.array_equal(frame.velocity, state.velocity.astype(dtype))
            assert np.array_equal(frame.spin, state.spin.astype(dtype))
            assert np.array_equal(frame.image, state.image)
        assert np.array_equal(trajectory.observables["energy"], 0.1 * np.array(frames))
        assert "versions/numpy" in trajectory.parameters
    with h5py.File(path) as file:
        assert file["particles/all/position/step"][()].tolist() == frames
        assert file["particles/all/velocity/step"] == file["particles/all/box/edges/step"]  # hard links still
        view = file["particles/all/position/value"]
        assert view.is_virtual
        assert view.shape == (len(frames), N, 3)
        last = some_state(N, frames[-1]).position.astype(dtype)
        assert np.array_equal(view[-1, :, :2], last)


def repaired(path: Path) -> tuple[Path, list[str]]:
    lines: list[str] = []
    place = path.with_name("whole.h5")
    assert repair(path, place, log=lines.append)
    return place, lines


def test_a_whole_file_is_left_alone(tmp_path):
    write(tmp_path / "run.h5", n=N)
    lines: list[str] = []
    assert not repair(tmp_path / "run.h5", tmp_path / "whole.h5", log=lines.append)
    assert lines == []
    assert os.listdir(tmp_path) == ["run.h5"]


def test_an_uncommitted_end_is_cut_off(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=N, frames=4)
    add_series(path)
    with h5py.File(path, "r+") as file:
        file["particles/all/position/step"].resize(3, axis=0)
    place, lines = repaired(path)
    assert_frames(place, [0, 1, 2])
    assert "  particles/all/velocity/value_2d: 1 uncommitted after the last frame" in lines
    assert "  timeseries/time: 1 uncommitted after the last row" in lines
    assert not repair(place, tmp_path / "again.h5", log=lines.append)  # nothing is wrong any more


def test_a_file_compressed_by_zstd_stays_so(tmp_path):
    """A chunk that has lost its head is none of Zstandard."""
    path = tmp_path / "run.h5"
    write(path, n=N, frames=5, compression="zstd")
    with h5py.File(path) as file:
        start = file["particles/all/velocity/value_2d"].id.get_chunk_info(3).byte_offset
    data = bytearray(path.read_bytes())
    data[start : start + 8] = bytes(8)
    path.write_bytes(data)
    place, lines = repaired(path)
    assert lines[0] == "  particles/all/velocity/value_2d: frame 3 cannot be read"
    assert_frames(place, [0, 1, 2, 4])
    with h5py.File(place) as file:
        filters = file["particles/all/velocity/value_2d"].id.get_create_plist()
        assert [filters.get_filter(i)[0] for i in range(filters.get_nfilters())] == [2, 32015]


@pytest.mark.parametrize("name", ["position/value_2d", "angular_velocity/value", "image/value_2d"])
def test_damaged_frames_in_the_middle_are_left_out(tmp_path, name):
    path = tmp_path / "run.h5"
    write(path, n=N, frames=5, compression="gzip")
    flip(path, f"particles/all/{name}", 1)
    flip(path, f"particles/all/{name}", 3)
    before = path.read_bytes()
    place, lines = repaired(path)
    assert lines == [
        f"  particles/all/{name}: 2 frames (1, 3) cannot be read",
        "  3 of 5 frames are kept",
    ]
    assert_frames(place, [0, 2, 4])
    with h5py.File(place) as file:
        dataset = file[f"particles/all/{name}"]
        assert (dataset.compression, dataset.shuffle, dataset.chunks[0]) == ("gzip", True, 1)
    assert path.read_bytes() == before


def test_a_field_with_too_few_frames_ends_the_trajectory(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=N, frames=5)
    with h5py.File(path, "r+") as file:
        file["particles/all/velocity/value_2d"].resize(2, axis=0)
    with pytest.raises(InputError, match="damaged"):
        Trajectory(path)
    place, _ = repaired(path)
    assert_frames(place, [0, 1])


def test_a_file_whose_end_is_lost_keeps_the_frames_before(tmp_path):
    """HDF5 does not open a file that is shorter than it was; frames whose bytes are there are kept."""
    path = tmp_path / "run.h5"
    write(path, n=N, frames=6)
    with h5py.File(path) as file:  # cut within the third frame's velocities
        cut = file["particles/all/velocity/value_2d"].id.get_chunk_info(3).byte_offset + 100
        behind = [
            i
            for i in range(6)
            if any(
                file[f"particles/all/{name}"].id.get_chunk_info(i).byte_offset
                + file[f"particles/all/{name}"].id.get_chunk_info(i).size
                > cut
                for name in (
                    "position/value_2d",
                    "velocity/value_2d",
                    "angular_velocity/value",
                    "image/value_2d",
                )
            )
        ]
    assert 3 in behind
    os.truncate(path, cut)
    with pytest.raises(InputError, match="damaged"):
        Trajectory(path)
    try:
        place, lines = repaired(path)
    except InputError as error:  # HDF5 may have put its bookkeeping behind the cut
        pytest.fail(f"nothing was kept: {error}")
    assert any("its end is missing" in line for line in lines)
    assert_frames(place, [i for i in range(6) if i not in behind])
    assert sorted(os.listdir(tmp_path)) == ["run.h5", "whole.h5"]


def test_series_and_histories_end_before_their_damage(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=N, frames=2)
    given = add_series(path)
    start = some_state(N, 0)
    first = {"time": 0.0, **{k: getattr(start, k)[[2, 5]] for k in ("position", "velocity", "spin", "image")}}
    events = [{"time": 0.1 * i, "id": 2, "partner": i} for i in range(20)]
    add_histories(path, [2, 5], first, events, [(5, 0.5), (12, 1.2), (20, 2.0)])
    with h5py.File(path, "r+") as file:
        del file["histories/events/psi"]
        column = np.zeros(13)
        file.create_dataset("histories/events/psi", data=column, maxshape=(None,), chunks=(16384,))
        file["timeseries/energy/value"].resize(4, axis=0)
    place, lines = repaired(path)
    assert "  timeseries: only the first 4 of 7 rows can be read" in lines
    assert "  histories: only the first 13 of 20 events can be read" in lines
    with Trajectory(place) as trajectory:
        assert len(trajectory) == 2
        assert np.array_equal(trajectory.series["momentum"], given["momentum"][:4])
        assert trajectory.series.columns("collisions_by_regime")[0] == "sliding"
        history = trajectory.history(2)
        assert history.partner.tolist() == list(range(12))  # up to the last commit that is whole
        assert history.end == 1.2


def test_an_observable_that_is_damaged_is_left_out(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=N, frames=3)
    with h5py.File(path, "r+") as file:
        file["observables/momentum/value"].resize(1, axis=0)
    place, lines = repaired(path)
    assert lines[0] == "  observables/momentum: cannot be read; the copy lacks it"
    assert_frames(place, [0, 1, 2])
    with Trajectory(place) as trajectory:
        assert set(trajectory.observables) == {"energy", "collisions"}


def test_what_cannot_be_repaired_is_reported_with_a_remedy(tmp_path):
    path = tmp_path / "run.h5"
    path.write_bytes(b"not HDF5 at all")
    with pytest.raises(InputError, match=r"not an HDF5 file.*no checkpoint"):
        repair(path, tmp_path / "whole.h5")
    (tmp_path / "run.checkpoint.h5").write_bytes(b"")
    with pytest.raises(InputError, match=r"run\.checkpoint\.h5 holds a state"):
        repair(path, tmp_path / "whole.h5")
    write(path, n=N, force=True)
    os.truncate(path, 1000)  # the bookkeeping at the beginning is lost too
    with pytest.raises(InputError, match="nothing can be kept"):
        repair(path, tmp_path / "whole.h5", log=lambda line: None)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["weather"] = 1.0
    with pytest.raises(InputError, match=r"cannot be made a trajectory .*frames/step"):
        repair(tmp_path / "other.h5", tmp_path / "whole.h5")
    write(path, n=N, frames=2, force=True, compression="gzip")
    for frame in range(2):
        flip(path, "particles/all/position/value_2d", frame)
    with pytest.raises(InputError, match="no frame of 2 is whole"):
        repair(path, tmp_path / "whole.h5", log=lambda line: None)
    assert sorted(os.listdir(tmp_path)) == ["other.h5", "run.checkpoint.h5", "run.h5"]


def test_a_file_that_a_run_is_writing_is_left_alone(tmp_path):
    path = tmp_path / "run.h5"
    with child(path, 40, pause=3) as process:
        assert process.stdout is not None
        assert process.stdout.read(3) == b"..."
        with pytest.raises(InputError, match=f"process {process.pid} on .* is writing it"):
            repair(path, path)
        process.kill()
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 3


def test_a_length_that_is_damaged_costs_no_memory(tmp_path, capsys):
    """2^40 frames by the steps, 4 by the times: repair asked for 1 TiB, and kept nothing."""
    path = tmp_path / "run.h5"
    write(path, n=N, frames=4, fields=FIELDS)
    with h5py.File(path, "r+") as file:
        file["particles/all/box/edges/step"].resize((2**40,))
    assert main(["repair", str(path)]) == 0
    assert f"{2**40} frames, of which 4 have a time" in capsys.readouterr().out
    assert_frames(tmp_path / "run.repaired.h5", [0, 1, 2, 3])


def test_a_file_repaired_in_place_keeps_the_given_name(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(Path("run.h5"), n=N, frames=4, compression="gzip", fields=FIELDS)
    flip(Path("run.h5"), "particles/all/velocity/value_2d", 2)
    assert main(["repair", "run.h5", "--in-place"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "run.h5:"
    assert printed[-2:] == ["wrote run.h5", "wrote run.vtkhdf, run.nc"]


def test_the_command_writes_a_new_file_or_in_place_and_renews_views(tmp_path, capsys):
    path = tmp_path / "run.h5"
    write(path, n=N, frames=4, compression="gzip", fields=FIELDS)
    assert main(["repair", str(path)]) == 0  # whole, but without views
    shown = capsys.readouterr().out
    assert "nothing is wrong" in shown
    assert sorted(os.listdir(tmp_path)) == ["run.h5", "run.nc", "run.vtkhdf"]
    flip(path, "particles/all/velocity/value_2d", 2)
    assert main(["repair", str(path)]) == 0
    assert "3 of 4 frames are kept" in capsys.readouterr().out
    assert_frames(tmp_path / "run.repaired.h5", [0, 1, 3])
    assert main(["repair", str(path)]) == 2  # the copy is there
    assert "exists already" in capsys.readouterr().err
    assert main(["repair", str(path), "--in-place", "-o", "x.h5"]) == 2
    assert "--in-place: cannot be combined with -o" in capsys.readouterr().err
    assert main(["repair", str(path), "--in-place"]) == 0
    assert_frames(path, [0, 1, 3])
    with h5py.File(tmp_path / "run.nc") as file:  # renewed
        assert file["coordinates"].shape == (3, N, 3)
    assert main(["repair", str(tmp_path / "absent.h5")]) == 2
    assert "there is no such file" in capsys.readouterr().err
