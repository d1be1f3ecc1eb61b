"""Series, histories and compressed chunks: data are read as written, in the layout that other tools read."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, FIELDS, some_disks, some_state
from support.trajectory_parts import SERIES_COLUMNS, TRACKED, batch, partnered, row

from ifrdem.errors import InputError, TrajectoryError
from ifrdem.model.box import Box
from ifrdem.model.observables import measure
from ifrdem.model.state import Disks, State
from ifrdem.quantities import EVENT
from ifrdem.runs.info import describe
from ifrdem.trajectory.export import species
from ifrdem.trajectory.parts_writer import PartsWriter
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

N = 40


def write_all(path: Path, *, frames: int = 2, rows: int = 5, batches: int = 3, **options) -> None:
    with TrajectoryWriter(path, some_disks(N), BOX, **options) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        for number in range(rows):
            writer.write_series(0.03 * number, row(number), SERIES_COLUMNS)
        for number in range(batches):
            writer.write_histories(*batch(number))
        for frame in range(frames):
            writer.write(some_state(N, frame), {"energy": 0.5 * frame})


def test_chunks_that_are_written_one_by_one_hold_what_is_given(tmp_path, monkeypatch):
    """As those of large frames are; the last chunk of 40 disks in chunks of 14 is not full."""
    monkeypatch.setattr("ifrdem.trajectory.layout.CHUNK_DISKS", 15)
    monkeypatch.setattr("ifrdem.trajectory.rows.MOST_AT_ONCE", 20)
    path = tmp_path / "run.h5"
    write_all(path, precision="f64")
    with h5py.File(path) as file:
        assert file["particles/all/angular_velocity/value"].chunks[1] == 14
    with Trajectory(path) as found:
        for number in range(2):
            state = some_state(N, number)
            assert np.array_equal(found[number].velocity, state.velocity)
            assert np.array_equal(found[number].spin, state.spin)


# --- series


def test_series_come_back_at_their_own_cadence(tmp_path):
    path = tmp_path / "run.h5"
    write_all(path, frames=2, rows=5)
    with h5py.File(path) as file:
        series = file["timeseries"]
        assert set(series) == {"step", "time", *row(0)}
        assert np.array_equal(series["step"], [0, 1, 2, 3, 4])
        assert np.array_equal(series["time"], 0.03 * np.arange(5))
        for name in row(0):
            for shared in ("step", "time"):
                assert series[name][shared] == series[shared]  # the same object in the file
            assert np.array_equal(series[name]["value"], [row(number)[name] for number in range(5)])
        assert series["collisions/value"].dtype == np.int64
        assert list(series["dissipated_by_mechanism"].attrs["columns"]) == ["normal", "sliding"]
        assert "columns" not in series["energy"].attrs
        assert len(file["observables/energy/value"]) == 2


def test_a_file_without_series_and_histories_has_no_groups_for_them(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        writer.write(some_state(3, 0))
    with h5py.File(path) as file:
        assert set(file) == {"h5md", "observables", "parameters", "particles"}
        assert list(file["h5md/modules/ifrdem"].attrs["version"]) == [1, 6]


def test_series_rows_that_do_not_fit_are_refused_and_the_file_unchanged(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        writer.write(some_state(3, 0))
        for name in ("time", "step"):
            with pytest.raises(InputError, match=f"name of series = '{name}'"):
                writer.write_series(0.0, {name: 1.0})
        with pytest.raises(InputError, match="one quantity or more"):
            writer.write_series(0.0, {})
        with pytest.raises(InputError, match=r"columns of series a = .*the series has \(2,\)"):
            writer.write_series(0.0, {"a": [1.0, 2.0]}, {"a": ["x"]})
        with pytest.raises(InputError, match=r"columns of series b .*no value"):
            writer.write_series(0.0, {"a": [1.0, 2.0]}, {"b": ["x", "y"]})
        writer.write_series(1.0, {"a": [1.0, 2.0], "count": 3}, {"a": ["x", "y"]})
        for when, values, columns, reason in (
            (0.5, {"a": [1.0, 2.0], "count": 3}, None, r"time = 0\.5: .*not before 1\.0"),
            (float("nan"), {"a": [1.0, 2.0], "count": 3}, None, "time = nan"),
            (2.0, {"a": [1.0, 2.0]}, None, "the first row has"),
            (2.0, {"a": 1.0, "count": 3}, None, "series a has shape"),
            (2.0, {"a": [1.0, 2.0], "count": 3.5}, None, "integer in the first row"),
            (2.0, {"a": [1.0, 2.0], "count": 3}, {"a": ["x", "z"]}, "the first row has"),
        ):
            with pytest.raises(InputError, match=reason):
                writer.write_series(when, values, columns)
        writer.write_series(2.0, {"a": [3, 4], "count": 4})
        assert writer.series_rows == 2
    with h5py.File(path) as file:
        assert np.array_equal(file["timeseries/a/value"], [[1.0, 2.0], [3.0, 4.0]])
        assert np.array_equal(file["timeseries/time"], [1.0, 2.0])


# --- histories


def test_histories_come_back_with_start_and_commits(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(N), BOX) as writer:
        writer.begin_histories(TRACKED[::-1], some_state(N, 4))
        writer.write(some_state(N, 4))
        for number in range(1, 4):
            writer.write_histories(*batch(number))
        nothing = {name: values[:0] for name, values in batch(0)[0].items()}
        writer.write_histories(nothing, 4.5)
        assert writer.events == 150
    state = some_state(N, 4)
    with h5py.File(path) as file:
        group = file["histories"]
        assert np.array_equal(group["tracked"], TRACKED)  # ascending, whatever the order they were named in
        assert group["start/time"][()] == state.time
        for name in ("position", "velocity", "spin", "image"):
            assert np.array_equal(group[f"start/{name}"], getattr(state, name)[list(TRACKED)])
        assert np.array_equal(group["committed/events"], [0, 50, 100, 150, 150])
        assert np.array_equal(group["committed/time"], [state.time, 2.0, 3.0, 4.0, 4.5])
        for name, column in EVENT.items():
            given = np.concatenate([batch(number)[0][name] for number in range(1, 4)])
            stored = group[f"events/{name}"]
            assert stored.dtype == column.dtype()
            assert stored.compression is None  # its last chunk is rewritten in place at each commit
            assert np.array_equal(stored, given)


def test_histories_that_do_not_fit_are_refused_and_the_file_unchanged(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(N), BOX) as writer:
        state = some_state(N, 0)
        writer.write(state)
        for ids, reason in (([40], "from 0 to 39"), ([], "from 0"), ([1, 1], "disk 1 is given twice")):
            with pytest.raises(InputError, match=reason):
                writer.begin_histories(ids, state)
        with pytest.raises(InputError, match="begin_histories comes before"):
            writer.write_histories(*batch(0))
        writer.begin_histories(TRACKED, state)

        def changed(**columns):
            events, _ = batch(0)
            return {name: value for name, value in {**events, **columns}.items() if value is not None}

        events, end = batch(0)
        swapped = events["time"][::-1].copy()
        infinite = events["psi"].copy()
        infinite[3] = np.inf
        for columns, when, reason in (
            (changed(psi=None), end, "the events lack psi"),
            (changed(spn=events["psi"]), end, "no column 'spn'"),
            (changed(psi=events["psi"][:-1]), end, "psi has shape"),
            (changed(position=events["psi"]), end, "position has shape"),
            (changed(partner=events["psi"]), end, "partner has type float64"),
            (changed(regime=events["id"] + 1000), end, "regime: numbers beyond 127"),
            (changed(psi=infinite), end, r"psi\[3\] = inf"),
            (changed(time=swapped), end, "not in the order of time and id"),
            (changed(id=events["id"] * 0 + 3), end, "disk 3 is not tracked"),
            (changed(), 0.5, "not before the last event"),
        ):
            with pytest.raises(InputError, match=reason):
                writer.write_histories(columns, when)
        writer.write_histories(events, end)
        with pytest.raises(TrajectoryError, match=r"complete up to t = 1\.0"):
            writer.write_histories(events, end)
    with h5py.File(path) as file:
        assert np.array_equal(file["histories/committed/events"], [0, 50])
        assert np.array_equal(file["histories/events/psi"], events["psi"])


def test_events_of_one_time_are_sorted_by_id(tmp_path):
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(N), BOX) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        events = {name: values[:2] for name, values in batch(0)[0].items()}
        events["time"] = np.array([0.5, 0.5])
        events["id"] = np.array([5, 2])
        with pytest.raises(InputError, match=r"event 1 at t = 0\.5 is not in the order"):
            writer.write_histories(events, 1.0)
        events["id"] = np.array([2, 5])
        writer.write_histories(events, 1.0)


@pytest.mark.full
def test_a_million_events_are_one_call(tmp_path):
    count = 1_000_000
    events, end = batch(0, count)
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(N), BOX) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        writer.write(some_state(N, 0))
        writer.write_histories(events, end)
    with h5py.File(tmp_path / "run.h5") as file:
        assert np.array_equal(file["histories/events/impulse"][-3:], events["impulse"][-3:])
        assert file["histories/committed/events"][-1] == count


# --- fields and chunks


def test_the_latest_partner_is_a_field_of_counts(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(N), BOX, fields=("position", "last_partner")) as writer:
        for frame in range(2):
            writer.write(partnered(N, frame))
    with Trajectory(path) as trajectory:
        assert trajectory.fields == ("position", "last_partner")
        for frame in range(2):
            stored = trajectory[frame].field("last_partner")
            assert stored.dtype == np.int32
            assert np.array_equal(stored, partnered(N, frame).last_partner)


@pytest.mark.parametrize("compression", ["none", "gzip", "zstd"])
@pytest.mark.parametrize("n", [16384, 20001])
def test_frames_of_several_chunks_come_back(tmp_path, n, compression):
    """20001 disks are two chunks of 10001, the second filled up."""
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(n), BOX, fields=FIELDS, compression=compression) as writer:
        for frame in range(2):
            writer.write(some_state(n, frame))
    with Trajectory(path) as trajectory:
        for index, frame in enumerate(trajectory):
            state = some_state(n, index)
            assert np.array_equal(frame.position, state.position.astype(np.float32))
            assert np.array_equal(frame.spin, state.spin.astype(np.float32))
            assert np.array_equal(frame.image, state.image)


@pytest.mark.parametrize("compression", ["gzip", "zstd"])
def test_a_gas_at_rest_compresses_to_little(tmp_path, compression):
    """Velocities, spins and counts of zeros are a few bytes a chunk: only the positions take room."""
    n = 20_000
    state = State(some_state(n, 0).position, np.zeros((n, 2)), np.zeros(n))
    with TrajectoryWriter(
        tmp_path / "run.h5", Disks(n, mass=1.0, radius=0.01), BOX, compression=compression
    ) as writer:
        writer.write(state)
    with h5py.File(tmp_path / "run.h5") as file:
        for name in ("velocity/value_2d", "angular_velocity/value", "collisions/value"):
            assert file[f"particles/all/{name}"].id.get_storage_size() < 0.02 * 4 * n


def test_zstd_is_a_filter_that_only_the_plugin_undoes(tmp_path, monkeypatch):
    """Filter 32015 of HDF5's register, behind the shuffle: without hdf5plugin nothing is written and nothing read."""
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(100), BOX, compression="zstd") as writer:
        writer.write(some_state(100, 1))
    with h5py.File(path) as file:
        filters = file["particles/all/angular_velocity/value"].id.get_create_plist()
        assert [filters.get_filter(i)[0] for i in range(filters.get_nfilters())] == [2, 32015]
    assert "zstd" in describe(path)
    with TrajectoryWriter.resume(path, some_disks(100), BOX, compression="zstd", frames=1) as writer:
        writer.write(some_state(100, 2))
    with pytest.raises(InputError, match="has compression 'zstd', the run has 'gzip'"):
        TrajectoryWriter.resume(path, some_disks(100), BOX, compression="gzip", frames=1)
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    with pytest.raises(InputError, match=r'compression "zstd" requires the package hdf5plugin'):
        TrajectoryWriter(tmp_path / "other.h5", some_disks(100), BOX, compression="zstd")
    with pytest.raises(InputError, match=r"run\.h5 is compressed by zstd.*hdf5plugin"):
        Trajectory(path)
    assert [each.name for each in tmp_path.iterdir()] == ["run.h5"]


def in_fortran_order(state: State) -> State:
    for name in ("position", "velocity", "image"):
        setattr(state, name, np.asfortranarray(getattr(state, name)))
    return state


@pytest.mark.parametrize(
    "turned", [in_fortran_order, lambda state: replace(state, image=state.image[:, ::-1])]
)
def test_arrays_that_lie_otherwise_in_memory_are_written_as_they_are(tmp_path, turned):
    observable = np.asfortranarray(np.random.default_rng(1).normal(size=(9000, 2)))
    state = turned(some_state(N, 1))
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(N), BOX, fields=list(FIELDS)) as writer:
        writer.write(state, {"map": observable})
    with h5py.File(tmp_path / "run.h5") as file:
        assert np.array_equal(file["particles/all/image/value_2d"][0], state.image)
        assert np.array_equal(file["particles/all/velocity/value_2d"][0], state.velocity.astype(np.float32))
        assert np.array_equal(file["observables/map/value"][0], observable)


# --- what is damaged is said


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("timeseries/energy/value", "time series energy holds 1 of 5 rows"),
        ("timeseries/time", "time series time holds 1 of 5 rows"),
        ("histories/events/psi", r"its histories hold 1 of 150 events \(psi\)"),
        ("histories/committed/time", "its histories have no commit"),
    ],
)
def test_series_and_histories_that_lack_rows_are_refused_as_damaged(tmp_path, name, reason):
    path = tmp_path / "run.h5"
    write_all(path)
    with h5py.File(path, "r+") as file:
        file[name].resize(1, axis=0)
    with pytest.raises(InputError, match=f"damaged: {reason}"):
        Trajectory(path)


def test_files_of_layout_1_0_are_read(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        writer.write(some_state(3, 0))
    with h5py.File(path, "r+") as file:
        file["h5md/modules/ifrdem"].attrs["version"] = [1, 0]
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 1


@pytest.mark.parametrize(
    ("time", "values", "message"),
    [
        ("a", {"energy": 1.0}, "time = a: must be a finite time"),
        (None, {"energy": 1.0}, "time = None: must be a finite time"),
        (True, {"energy": 1.0}, "time = True: must be a finite time"),
        (0.5, [1.0], r"series: must be numbers by name, not \[1\.0\]"),
        (0.5, {"energy": "b"}, "series energy = 'b': must be a number or numbers"),
    ],
)
def test_invalid_rows_are_refused_and_the_file_stays_usable(tmp_path, time, values, message):
    with TrajectoryWriter(tmp_path / "a.h5", Disks(2, 1.0, 0.1), Box((3.0, 3.0))) as writer:
        writer.write_series(0.0, {"energy": 1.0})
        with pytest.raises(InputError, match=message):
            writer.write_series(time, values)
        with pytest.raises(InputError):
            writer.write_histories({}, time)
        writer.write_series(np.float64(1.0), {"energy": 2.0})
        writer.write(State(np.ones((2, 2)), np.zeros((2, 2)), np.zeros(2)))
    with Trajectory(tmp_path / "a.h5") as trajectory:
        assert trajectory.series.time.tolist() == [0.0, 1.0]


# --- batches


def test_a_measure_is_no_observables(tmp_path):
    disks, state = some_disks(N), some_state(N, 0)
    with TrajectoryWriter(tmp_path / "run.h5", disks, BOX) as writer:
        with pytest.raises(InputError, match="observables = Measure: must be"):
            writer.write(state, measure(disks, state))
        writer.write(state, {"temperature": measure(disks, state).temperature})
        assert len(writer) == 1


def test_frames_written_in_batches_equal_those_written_one_by_one(tmp_path):
    write_all(tmp_path / "one.h5", frames=4, batches=3)
    with TrajectoryWriter(tmp_path / "all.h5", some_disks(N), BOX) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        writer.write_series_rows([(0.03 * number, row(number)) for number in range(5)], SERIES_COLUMNS)
        writer.write_history_parts([batch(number) for number in range(3)])
        writer.write_frames([(some_state(N, frame), {"energy": 0.5 * frame}) for frame in range(3)])
        with pytest.raises(InputError, match="observables"):
            writer.write_frames([(some_state(N, 3), {"energy": 1.5}), (some_state(N, 4), {})])
        assert len(writer) == 3  # none of the two
        writer.write_frames([(some_state(N, 3), {"energy": 1.5})])
    found: list[dict[str, bytes]] = []
    for name in ("one.h5", "all.h5"):
        found.append({})
        with h5py.File(tmp_path / name) as file:
            file.visititems(
                lambda key, item: (
                    found[-1].update({key: np.asarray(item[()]).tobytes()})
                    if isinstance(item, h5py.Dataset) and item.shape
                    else None
                )
            )
    assert found[0] == found[1]


def test_species_of_the_disks_are_those_of_the_file(tmp_path):
    disks = Disks(3, mass=1.0, radius=0.5, species={"light": 2, "heavy": 1})
    state = State([[1.0, 1.0], [3.0, 1.0], [5.0, 1.0]], np.zeros((3, 2)), np.zeros(3))
    own = '[{"name": "a", "number": 1}, {"name": "b", "number": 2}]'
    for name, parameters, names, numbers in (
        ("disks.h5", None, {"light": 2, "heavy": 1}, [0, 0, 1]),
        ("given.h5", {"species": own}, {"a": 1, "b": 2}, [0, 1, 1]),
    ):
        with TrajectoryWriter(tmp_path / name, disks, Box((10.0, 10.0)), parameters=parameters) as file:
            file.write(state)
        with Trajectory(tmp_path / name) as run:
            assert species(run) == names
        with h5py.File(tmp_path / name) as raw:
            assert raw["particles/all/species"][()].tolist() == numbers
    path = tmp_path / "parts.h5"
    with PartsWriter.create(path, disks, disks, Box((10.0, 10.0)), number=2) as file:
        file.write(state)
    with Trajectory(path) as run, h5py.File(path) as raw:
        assert species(run) == {"light": 2, "heavy": 1}
        assert raw["particles/all/species"][()].tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    ("field", "value", "shown"),
    [("dissipated", 1e39, r"dissipated\[0, 0\] = 1e\+39"), ("dissipated", 1e-50, r"dissipated\[0, 0\] = 1e-50"),
     ("velocity", 1e39, r"velocity\[0, 0\] = 1e\+39"), ("velocity", 1e-50, r"velocity\[0, 0\] = 1e-50")],
)  # fmt: skip
def test_numbers_beyond_single_precision_are_refused_with_the_precision_that_holds_them(
    tmp_path, field, value, shown
):
    """Single precision ends at 2^128 = 3.4e38, and rounds below 2^-150 = 7e-46 to 0."""
    disks, box = Disks(1, 1.0, 0.5), Box((5.0, 5.0))
    state = replace(
        State([[1.0, 1.0]], [[0.0, 0.0]], [0.0]),
        **{field: np.full((1, 7 if field == "dissipated" else 2), value)},
    )
    with TrajectoryWriter(tmp_path / "f4.h5", disks, box, fields=[field]) as file:
        with pytest.raises(
            InputError, match=f'{shown}: .* from 1.18e-38 to 3.4e.38 .*precision "f64" .output.precision'
        ):
            file.write(state)
        file.write(State([[1.0, 1.0]], [[1.0, 0.0]], [0.0], dissipated=np.zeros((1, 7))))
        if (field, value) == ("velocity", 1e-50):  # disks that drag has stopped end no run
            file.write(replace(state, time=1.0))
    with TrajectoryWriter(tmp_path / "f8.h5", disks, box, fields=[field], precision="f64") as file:
        file.write(state)
    with Trajectory(tmp_path / "f8.h5") as run:
        assert run[0][field][0, 0] == value
