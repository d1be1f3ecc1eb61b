"""Reading trajectories: by name, lazily, also while they grow or where they are damaged."""

from __future__ import annotations

import copy
import pickle
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, FIELDS, MECHANISMS, add_series, some_disks, some_state, write
from test_reader import child

from ifrdem.errors import DamageError, InputError
from ifrdem.model.box import Box
from ifrdem.runs.info import describe
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter


def test_fields_are_there_by_name_as_items_and_attributes(tmp_path):
    write(tmp_path / "run.h5")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        frame, state = trajectory[1], some_state(5, 1)
        for name in FIELDS:
            given = getattr(state, "spin" if name == "angular_velocity" else name)
            for value in (frame[name], frame.field(name), getattr(frame, name)):
                assert np.array_equal(value, given.astype(np.float32) if given.dtype.kind == "f" else given)
        assert np.array_equal(frame["spin"], frame.angular_velocity)
        assert set(FIELDS) <= set(dir(frame))
        assert np.allclose(frame.unwrapped, frame.position + frame.image * np.array(BOX.lengths))


@pytest.mark.parametrize(
    "act",
    [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))],
    ids=["copy", "deep", "pickle"],
)
def test_copies_of_trajectories_frames_and_series_read_the_file_by_themselves(tmp_path, act):
    """A task of another process gets them: h5py's objects could not be pickled, and a copy shared the open file."""
    write(tmp_path / "run.h5")
    add_series(tmp_path / "run.h5")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        expected = trajectory[1].position, trajectory.series["energy"]
        whole, frame, series = act(trajectory), act(trajectory[1]), act(trajectory.series)
        opened = whole.file
    assert bool(opened)
    assert whole.path == trajectory.path
    assert np.array_equal(whole[1].position, expected[0])
    if act is not copy.copy:  # those refer to the trajectory, which is closed
        assert np.array_equal(frame.position, expected[0])
        assert np.array_equal(series["energy"], expected[1])
    writer = TrajectoryWriter(tmp_path / "new.h5", some_disks(5), BOX)
    with writer, pytest.raises(InputError, match="TrajectoryWriter cannot be copied or pickled"):
        act(writer)


def test_unknown_names_get_the_nearest_spelling(tmp_path):
    write(tmp_path / "run.h5")
    add_series(tmp_path / "run.h5")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        with pytest.raises(KeyError, match=r"no field 'velocty'.*did you mean 'velocity'"):
            trajectory[0]["velocty"]
        with pytest.raises(InputError, match="did you mean 'velocity'"):
            trajectory[0].velocty  # noqa: B018 the reading is the act
        assert not hasattr(trajectory[0], "velocty")
        with pytest.raises(InputError, match=r"no series 'enrgy'.*did you mean 'energy'"):
            trajectory.series["enrgy"]
        with pytest.raises(InputError, match=r"no column 'slidng'.*did you mean 'sliding'"):
            trajectory.series["dissipated_by_mechanism/slidng"]
        with pytest.raises(InputError, match=r"which = 'serie': must be one of .*did you mean 'series'"):
            trajectory.to_pandas("serie")
        with pytest.raises(InputError, match=r"disk 5 of .*there are 5 disks \(0 to 4\)") as caught:
            trajectory.disk(5)
        assert isinstance(caught.value, IndexError)


def test_series_come_back_with_columns_and_without_uncommitted_rows(tmp_path):
    write(tmp_path / "run.h5")
    given = add_series(tmp_path / "run.h5", rows=7)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        series = trajectory.series
        assert set(series) == set(given)
        assert np.array_equal(series.time, 0.02 * np.arange(7))
        for name, value in given.items():
            assert np.array_equal(series[name], value)
        assert series.columns("dissipated_by_mechanism") == MECHANISMS
        assert series.columns("energy") == ()
        for i, name in enumerate(MECHANISMS):
            column = series[f"dissipated_by_mechanism/{name}"]
            assert np.array_equal(column, given["dissipated_by_mechanism"][:, i])
        assert np.array_equal(trajectory.observables.time, trajectory.times)
    write(tmp_path / "old.h5")  # a file of layout 1.0
    with Trajectory(tmp_path / "old.h5") as trajectory:
        assert len(trajectory.series) == len(trajectory.series.time) == len(trajectory.tracked) == 0
        with pytest.raises(InputError, match=r"no series 'energy'; there are none; .*write_series\("):
            trajectory.series["energy"]


def test_tables_hold_every_column(tmp_path):
    write(tmp_path / "run.h5", n=6)
    given = add_series(tmp_path / "run.h5")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        table = trajectory.to_pandas("series")
        assert np.array_equal(table.index, trajectory.series.time)
        assert np.array_equal(table["momentum_y"], given["momentum"][:, 1])
        assert np.array_equal(
            table["dissipated_by_mechanism_rolling"], given["dissipated_by_mechanism"][:, 4]
        )
        assert list(trajectory.to_pandas("observables")["momentum_y"]) == [0.0, 1.0, 2.0]
        frame = trajectory.to_pandas("frame", 1)
        assert frame.index.name == "id"
        assert np.array_equal(frame[["position_x", "position_y"]], trajectory[1].position)
        assert np.array_equal(frame["mass"], some_disks(6).mass)
        with pytest.raises(InputError, match="frame 3"):
            trajectory.to_pandas("frame", 3)


def test_chunks_of_a_data_set_are_those_of_the_file_and_go_to_other_processes(tmp_path):
    """A chunk of the file has one frame. Processes of Dask read from files that they open: here a copy by pickle."""
    write(tmp_path / "run.h5", n=6, frames=4)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert trajectory.chunks("position") == (1, 6, 2)
        whole, copied = trajectory.to_xarray(), pickle.loads(pickle.dumps(trajectory.to_xarray(chunks={})))
        assert copied.position.chunks == ((1, 1, 1, 1), (6,), (2,))
        assert trajectory.to_xarray(chunks={"time": 3}).velocity.chunks == ((3, 1), (6,), (2,))
        assert trajectory.to_xarray(chunks="auto").velocity.chunks == ((4,), (6,), (2,))
        for given, text in (
            ({"frame": 1}, r"chunks: there is no axis 'frame' of frames or disks; there are time, disk"),
            ({"time": 0}, r"chunks\['time'\] = 0: must be an integer from 1"),
            ("all", r'chunks = \'all\': must be "auto", or numbers such as'),
            (3, r"chunks = 3: must be"),
        ):
            with pytest.raises(InputError, match=text):
                trajectory.to_xarray(chunks=given)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        np.testing.assert_array_equal(copied.velocity, trajectory.to_xarray().velocity)
    assert whole.position.chunks is None


def test_data_sets_of_xarray_are_lazy_and_equal_the_frames(tmp_path, monkeypatch):
    from ifrdem.trajectory import damage

    write(tmp_path / "run.h5", n=6, frames=4, units={"length": "m", "time": "s", "energy": "J"})
    add_series(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5", "r+") as file:  # an uncommitted frame behind the last
        file["particles/all/position/value_2d"].resize(5, axis=0)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        data = trajectory.to_xarray()
        assert data.position.shape == (4, 6, 2)
        read = damage.read
        selections = []

        def observed(dataset, selection=()):
            selections.append(selection)
            return read(dataset, selection)

        monkeypatch.setattr(damage, "read", observed)
        part = data.position.isel(time=[0, 2], disk=slice(1, 4), axis=1)
        assert not selections
        monkeypatch.setattr(damage, "read", read)
        expected = [trajectory[i].position[1:4, 1] for i in (0, 2)]
        assert np.array_equal(part.values, expected)
        monkeypatch.setattr(damage, "read", observed)
        _ = data.velocity.isel(time=3).values
        assert [each[0] for each in selections] == [3]  # one frame is read, and no other
        monkeypatch.undo()
        assert data.series_energy.dims == ("series_time",)
        assert data.observables_momentum.sel(axis="y").values.tolist() == [0.0, 1.0, 2.0, 3.0]
        assert data.position.attrs["units"] == "m"
        assert data.observables_energy.attrs["units"] == "J"
        dissipated = data.series_dissipated_by_mechanism.sel(mechanism="walls")
        assert np.array_equal(dissipated, trajectory.series["dissipated_by_mechanism/walls"])


def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch):
    import sys

    write(tmp_path / "run.h5")
    monkeypatch.setitem(sys.modules, "pandas", None)  # importing it fails now
    missing = pytest.raises(InputError, match=r"pandas is not installed: `pip install 'ifrdem\[analysis\]'")
    with Trajectory(tmp_path / "run.h5") as trajectory, missing:
        trajectory.to_pandas()


def test_a_disk_is_followed_over_the_frames(tmp_path):
    write(tmp_path / "run.h5", n=5, frames=4, precision="f64")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        path = trajectory.disk(3)
        states = [some_state(5, i) for i in range(4)]
        assert path.unwrapped
        assert np.array_equal(
            path.position, [one.position[3] + one.image[3] * np.array(BOX.lengths) for one in states]
        )
        assert np.array_equal(path["position"], [one.position[3] for one in states])
        assert np.array_equal(path["spin"], [one.spin[3] for one in states])
        assert np.array_equal(path.time, trajectory.times)
    write(tmp_path / "bare.h5", fields=("position",))
    with Trajectory(tmp_path / "bare.h5") as trajectory:
        path = trajectory.disk(0)
        assert not path.unwrapped
        assert np.array_equal(path.position, [frame.position[0] for frame in trajectory])
        with pytest.raises(InputError, match="no field 'velocity'"):
            path["velocity"]


@pytest.mark.parametrize(
    ("box", "factor"), [(Box((30.0, 20.0), shear_rate=0.5), 10.0), (Box.open(), 0.0)], ids=["sheared", "open"]
)
def test_paths_are_unwrapped_across_the_sides_of_the_box(tmp_path, box, factor):
    """Sheared: the image above lies shear_rate Ly t = 10 t further along x. Open: positions are plain."""
    write(tmp_path / "run.h5", box=box, precision="f64")
    with Trajectory(tmp_path / "run.h5") as trajectory:
        path = trajectory.disk(1)
        for i in range(3):
            state = some_state(5, i, box)
            image = state.image[1]
            shift = np.array([30.0 * image[0] + factor * state.time * image[1], 20.0 * image[1]])
            assert np.allclose(path.position[i], state.position[1] + shift, rtol=0.0, atol=1e-12)


def test_frames_are_gone_through_in_constant_memory(tmp_path):
    """60 frames of 20,000 disks: 29 MB of float32 in the file; a frame's arrays in float64 take 0.8 MB."""
    path, n = tmp_path / "run.h5", 20_000
    with TrajectoryWriter(path, some_disks(n), BOX) as writer:
        state = some_state(n, 0)
        for frame in range(60):
            state.time = 0.1 * frame
            writer.write(state)
    with Trajectory(path) as trajectory:
        tracemalloc.start()
        total = sum(
            float(frame.position[0, 0] + frame.velocity[0, 0] + frame.spin[0]) for frame in trajectory
        )
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert total == pytest.approx(
            60 * float(trajectory[0].position[0, 0] + trajectory[0].velocity[0, 0] + trajectory[0].spin[0])
        )
    assert most < 3e6


def test_refresh_finds_frames_that_a_run_has_added(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(5), BOX) as writer:
        writer.write(some_state(5, 0), {"energy": 1.0})
        with Trajectory(path) as trajectory:
            frame = trajectory[0]
            assert len(trajectory) == 1
            writer.write(some_state(5, 1), {"energy": 2.0})
            writer.write(some_state(5, 2), {"energy": 3.0})
            assert len(trajectory) == 1
            assert trajectory.refresh() == 2
            assert trajectory.refresh() == 0
            assert len(trajectory) == len(trajectory.times) == 3
            assert np.array_equal(trajectory.observables["energy"], [1.0, 2.0, 3.0])
            assert np.array_equal(trajectory[2].position, some_state(5, 2).position.astype(np.float32))
            assert np.array_equal(frame.position, some_state(5, 0).position.astype(np.float32))


@pytest.mark.full
def test_refresh_follows_a_run_in_another_process(tmp_path):
    """The run holds a lock, and writes while its file is opened and read."""
    path = tmp_path / "run.h5"
    with child(path, 40, pause=3) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stdout.read(3) == b"..."
        with Trajectory(path) as trajectory:
            assert len(trajectory) == 3
            process.stdin.close()  # it continues, as fast as it can
            rng = np.random.default_rng(1)
            for _ in range(20):
                process.stdout.read(1)
                trajectory.refresh()
                # The tree of chunks grows and splits meanwhile: no frame may be read as zeros.
                for index in (len(trajectory) - 1, *rng.integers(0, len(trajectory), 20)):
                    given = some_state(40, int(index)).position.astype(np.float32)
                    assert np.array_equal(trajectory[index].position, given)
                assert np.array_equal(trajectory.observables["energy"], 0.5 * np.arange(len(trajectory)))
            assert len(trajectory) >= 20
        process.kill()


def flip(path: Path, name: str, index: int) -> None:
    """Change bytes in the middle of a chunk of a compressed dataset."""
    with h5py.File(path) as file:
        chunk = file[name].id.get_chunk_info(index)
    with path.open("r+b") as raw:
        raw.seek(chunk.byte_offset + chunk.size // 2)
        old = raw.read(8)
        raw.seek(chunk.byte_offset + chunk.size // 2)
        raw.write(bytes(byte ^ 0xFF for byte in old))


def test_a_damaged_chunk_is_named_and_the_other_frames_are_read(tmp_path):
    path = tmp_path / "run.h5"
    write(path, n=400, frames=4, compression="gzip")
    flip(path, "particles/all/velocity/value_2d", 2)
    with Trajectory(path) as trajectory:
        for name in ("position", "spin"):
            trajectory[2][name]
        trajectory[1].velocity, trajectory[3].velocity
        with pytest.raises(
            DamageError, match=r"run\.h5 is damaged: /particles/all/velocity/value_2d .*repair"
        ):
            trajectory[2].velocity  # noqa: B018
        with pytest.raises(DamageError, match="velocity"):
            trajectory.to_xarray().velocity.values  # noqa: B018
        with pytest.raises(DamageError, match="velocity"):
            trajectory.disk(0)


def test_a_lost_chunk_is_noticed(tmp_path):
    """HDF5 reads chunks that were never written as zeros."""
    path = tmp_path / "run.h5"
    write(path, frames=2)
    with h5py.File(path, "r+") as file:
        for name in ("step", "time", "value"):
            file[f"particles/all/box/edges/{name}"].resize(3, axis=0)
        for name in ("position", "velocity", "image"):
            file[f"particles/all/{name}/value_2d"].resize(3, axis=0)
        for name in ("angular_velocity", "collisions"):
            file[f"particles/all/{name}/value"].resize(3, axis=0)
    with Trajectory(path) as trajectory:
        trajectory[1].position  # noqa: B018 the reading is the act
        with pytest.raises(DamageError, match=r"position/value_2d cannot be read \(a chunk is missing"):
            trajectory[2].position  # noqa: B018


def test_a_closed_trajectory_is_refused_as_closed(tmp_path):
    write(tmp_path / "run.h5")
    trajectory = Trajectory(tmp_path / "run.h5")
    frame = trajectory[0]
    trajectory.close()
    with pytest.raises(InputError, match="is closed"):
        frame.position  # noqa: B018 the reading is the act


def test_describe_names_series_ledger_and_related_files(tmp_path):
    path = tmp_path / "run.h5"
    write(path)
    given = add_series(path)
    (tmp_path / "run.checkpoint.h5").write_bytes(b"x" * 2000)
    (tmp_path / "run.status.json").write_text(
        '{"format": 1, "state": "interrupted", "message": "by SIGTERM", "pid": 1, "updated": "2026-11-22T12:00:00Z"}'
    )
    text = describe(path)
    worst = np.max(np.abs(given["ledger_residual"]))
    for part in (
        "series (7 rows, time 0 to 0.12)",
        "collisions_by_regime    int64 x 5: sliding, sticking",
        f"energy balance: largest error {worst:.3g}, {worst / np.max(given['energy']):.1e} of",
        "checkpoint        run.checkpoint.h5 (2 kB)",
        "run.status.json: interrupted, by SIGTERM",
    ):
        assert part in text, text
    (tmp_path / "run.status.json").write_text("{")
    assert "run.status.json is not a status file" in describe(path)  # the trajectory is none the worse for it
