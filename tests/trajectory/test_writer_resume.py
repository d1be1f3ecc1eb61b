"""Resuming a trajectory file: existing frames are compared, missing ones appended, different ones refused."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, FIELDS, some_disks, some_state
from support.trajectory_parts import SERIES_COLUMNS, TRACKED, batch, row

from ifrdem.errors import InputError, TrajectoryError
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.model.walls.wall import Wall
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

N = 40


def go_on(writer: TrajectoryWriter, first: int, end: int) -> None:
    """Frames, rows and batches of events from one number to another."""
    for number in range(first, end):
        writer.write(some_state(N, number), {"energy": 0.5 * number, "momentum": [1.0, number]})
        writer.write_series(0.03 * number, row(number), SERIES_COLUMNS)
        writer.write_histories(*batch(number))


def begin_file(path: Path, end: int, **options) -> None:
    with TrajectoryWriter(path, some_disks(N), BOX, **options) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        go_on(writer, 0, end)


def resume(path: Path, written: int, **options) -> TrajectoryWriter:
    options = {"frames": written, "series_rows": written, "events": 50 * written, **options}
    return TrajectoryWriter.resume(path, some_disks(N), BOX, **options)


def content(path: Path) -> dict[str, bytes]:
    """Every dataset of a file, as stored."""
    found = {}

    def take(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf":
            found[name] = item[()].tobytes()

    with h5py.File(path) as file:
        file.visititems(take)
    return found


@pytest.mark.full(keep=2)
@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "precision": "f64", "fields": FIELDS}])
@pytest.mark.parametrize("written", [0, 2, 5])
def test_a_resumed_file_is_that_of_an_uninterrupted_run(tmp_path, written, options):
    """Five frames were committed; the checkpoint was made after 0, 2 or all of them; the run continues to nine."""
    begin_file(tmp_path / "whole.h5", 9, **options)
    begin_file(tmp_path / "run.h5", 5, **options)
    with resume(tmp_path / "run.h5", written, **options) as writer:
        assert len(writer) == 5
        assert writer.written_counts == {"frames": written, "series_rows": written, "events": 50 * written}
        writer.begin_histories(TRACKED, some_state(N, 0))  # as it began: registered, not created again
        go_on(writer, written, 9)
        assert (len(writer), writer.series_rows, writer.events) == (9, 9, 450)
        assert writer.written_counts == {"frames": 9, "series_rows": 9, "events": 450}
    assert content(tmp_path / "run.h5") == content(tmp_path / "whole.h5")


def test_a_resumed_run_may_end_before_it_has_caught_up(tmp_path):
    path = tmp_path / "run.h5"
    begin_file(path, 5)
    before = content(path)
    with resume(path, 1) as writer:
        go_on(writer, 1, 3)
    assert content(path) == before
    with resume(path, 3) as writer:
        go_on(writer, 3, 6)
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 6


def test_events_may_come_in_other_pieces_than_before(tmp_path):
    """A resumed run commits at other times: halves of batches first, then two at once across the end of the file."""
    path = tmp_path / "run.h5"
    begin_file(path, 3)
    pieces = [batch(number)[0] for number in range(2, 5)]
    events = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    with resume(path, 2) as writer:
        half = {name: values[:25] for name, values in events.items()}
        writer.write_histories(half, float(half["time"][-1]))
        rest = {name: values[25:] for name, values in events.items()}
        writer.write_histories(rest, 5.0)
    with h5py.File(path) as file:
        assert np.array_equal(file["histories/committed/events"], [0, 50, 100, 150, 250])
        assert np.array_equal(file["histories/committed/time"], [0.0, 1.0, 2.0, 3.0, 5.0])
        assert np.array_equal(file["histories/events/psi"][100:], events["psi"])


def test_a_missing_or_added_event_is_a_difference(tmp_path):
    events, end = batch(1)
    fewer = {name: values[:30] for name, values in events.items()}
    more = {name: np.concatenate([values, values[-1:]]) for name, values in events.items()}
    for number, (given, reason) in enumerate(
        ((fewer, r"event 80 of its histories, at t = 1\.\d+, is missing"), (more, r"is not in the file"))
    ):
        path = tmp_path / f"{number}.h5"
        begin_file(path, 2)
        with resume(path, 1) as writer, pytest.raises(TrajectoryError, match=reason):
            writer.write_histories(given, end)


def test_a_difference_names_frame_field_disk_and_both_values(tmp_path):
    path = tmp_path / "run.h5"
    begin_file(path, 5)
    before = content(path)
    states = [some_state(N, 3) for _ in range(4)]
    states[0].velocity[7, 1] = 0.25
    counts = states[1].collisions.copy()
    counts[11] = 4321
    states[1] = replace(states[1], collisions=counts)
    states[2].time = 0.31
    held = some_state(N, 3)
    for state, energy, reason in (
        (
            states[0],
            1.5,
            f"frame 3, .*velocity of disk 7, component y, is 0.25, the file holds {np.float32(held.velocity[7, 1])}",
        ),
        (states[1], 1.5, f"frame 3, .*collisions of disk 11 is 4321, the file holds {held.collisions[11]}"),
        (states[2], 1.5, f"frame 3, .*time is 0.31, the file holds {held.time}"),
        (states[3], 1.25, "frame 3, .*observable energy is 1.25, the file holds 1.5"),
    ):
        with resume(path, 2) as writer:
            writer.write(some_state(N, 2), {"energy": 1.0, "momentum": [1.0, 2]})
            with pytest.raises(TrajectoryError, match=reason):
                writer.write(state, {"energy": energy, "momentum": [1.0, 3]})
            with pytest.raises(TrajectoryError, match="closed"):
                writer.write(some_state(N, 3), {"energy": 1.5, "momentum": [1.0, 3]})
    with resume(path, 2) as writer:
        values = {**row(2), "dissipated_by_mechanism": [2.0, 0.5]}
        with pytest.raises(
            TrajectoryError, match=r"row of the series 2, .*dissipated_by_mechanism\[1\] is 0.5, .*holds 0.25"
        ):
            writer.write_series(0.06, values)
    with resume(path, 2) as writer:
        events, end = batch(2)
        events["psi"][4] = 0.5
        with pytest.raises(TrajectoryError, match=r"event of the histories 104, .*psi is 0.5"):
            writer.write_histories(events, end)
    with resume(path, 0) as writer, pytest.raises(TrajectoryError, match="began with another position"):
        writer.begin_histories(TRACKED, moved_slightly())
    with resume(path, 0) as writer, pytest.raises(TrajectoryError, match="histories of other disks"):
        writer.begin_histories([1, 2], some_state(N, 0))
    assert content(path) == before  # no difference has changed the file


def moved_slightly() -> State:
    state = some_state(N, 0)
    state.position[TRACKED[0], 0] += 1e-9
    return state


def test_a_zero_of_the_other_sign_is_a_difference(tmp_path):
    """Equal to ==, but another run: bits are compared."""
    path = tmp_path / "run.h5"
    state = some_state(N, 0)
    state.spin[3] = 0.0
    with TrajectoryWriter(path, some_disks(N), BOX) as writer:
        writer.write(state)
    state.spin[3] = -0.0
    with (
        resume(path, 0) as writer,
        pytest.raises(TrajectoryError, match=r"disk 3 is -0\.0, .*holds 0\.0"),
    ):
        writer.write(state)


def test_what_a_kill_left_uncommitted_is_dropped(tmp_path):
    path = tmp_path / "run.h5"
    begin_file(path, 3)
    before = content(path)
    with h5py.File(path, "r+") as file:
        for name in (
            "particles/all/position/value_2d",
            "particles/all/position/time",
            "observables/energy/value",
        ):
            file[name].resize(4, axis=0)
        for name in ("timeseries/time", "timeseries/energy/value"):
            file[name].resize(5, axis=0)
        for name in ("histories/events/psi", "histories/events/time"):
            file[name].resize(160, axis=0)
        file["histories/committed/time"].resize(7, axis=0)
    assert content(path) != before
    resume(path, 3).close()
    assert content(path) == before


def test_series_and_histories_that_were_only_created_are_created_again(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(N), BOX) as writer:
        writer.write(some_state(N, 0))
    with h5py.File(path, "r+") as file:  # killed while the groups were made
        file.create_group("timeseries_uncommitted/energy")
        file.create_group("histories_uncommitted/events")
    with resume(path, 1, series_rows=0, events=0) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        writer.write_series(0.0, row(0), SERIES_COLUMNS)
        writer.write_histories(*batch(0))
    with h5py.File(path) as file:
        assert len(file["timeseries/energy/value"]) == 1
        assert file["histories/committed/events"][-1] == 50
        assert set(file) == {"h5md", "histories", "observables", "parameters", "particles", "timeseries"}


def test_a_file_of_another_run_is_refused_and_kept(tmp_path):
    path = tmp_path / "run.h5"
    wall = Wall.line((0.0, 1.0), (0.0, 1.0))
    begin_file(path, 2)
    before = path.read_bytes()
    heavier = some_disks(N)
    mass = heavier.mass.copy()
    mass[7] = 3.0
    heavier = Disks(N, mass=mass, radius=heavier.radius, k=heavier.k, material=heavier.material)
    for disks, box, options, reason in (
        (some_disks(N + 1), BOX, {}, f"has {N} disks, the run has {N + 1}"),
        (heavier, BOX, {}, r"mass of disk 7 is 1\.\d+, the run's is 3\.0"),
        (some_disks(N), Box((30.0, 21.0)), {}, r"its lengths is \[30\. 20\.\]"),
        (some_disks(N), Box((30.0, 20.0), (True, False)), {}, "its boundary is"),
        (some_disks(N), Box((30.0, 20.0), shear_rate=0.5), {}, "its shear_rate is None, the run's is 0.5"),
        (some_disks(N), BOX, {"fields": ("position",)}, "holds the fields position, velocity"),
        (some_disks(N), BOX, {"precision": "f64"}, "holds position as float32"),
        (some_disks(N), BOX, {"compression": "gzip"}, "has compression 'none', the run has 'gzip'"),
        (some_disks(N), BOX, {"walls": [wall]}, "has other walls: none"),
        (some_disks(N), BOX, {"frames": 3}, "holds 2 frames, the checkpoint had seen 3"),
        (some_disks(N), BOX, {"series_rows": 3}, "holds 2 rows of series, the checkpoint had seen 3"),
        (some_disks(N), BOX, {"events": 101}, "holds 100 events, the checkpoint had seen 101"),
        (some_disks(N), BOX, {"frames": -1}, "frames = -1: must be an integer"),
    ):
        given = {"frames": 2, **options}
        with pytest.raises(InputError, match=reason):
            TrajectoryWriter.resume(path, disks, box, **given)
        assert path.read_bytes() == before


def test_what_cannot_be_gone_on_with_is_refused(tmp_path):
    path = tmp_path / "run.h5"
    with pytest.raises(InputError, match="no such file"):
        resume(path, 0)
    path.write_text("x" * 5000)
    with pytest.raises(InputError, match="cannot be appended to"):
        resume(path, 0)
    begin_file(tmp_path / "old.h5", 1)
    with h5py.File(tmp_path / "old.h5", "r+") as file:
        file["h5md/modules/ifrdem"].attrs["version"] = [1, 0]
    with pytest.raises(
        InputError, match=re.escape("has layout 1.0: a run can be resumed only with files of layout 1.6")
    ):
        resume(tmp_path / "old.h5", 1)


def test_one_writer_locks_out_another(tmp_path):
    path = tmp_path / "run.h5"
    begin_file(path, 2)
    child = (
        "import sys; sys.path[:0] = [sys.argv[1] + each for each in ('', '/tests', '/tests/trajectory')]\n"
        "from test_writer_resume import resume\n"
        "from ifrdem.errors import InputError\n"
        "try:\n    resume(sys.argv[2], 2)\n"
        "except InputError as error:\n    print(error); sys.exit(2)\n"
    )
    root = str(Path(__file__).resolve().parents[2])
    with resume(path, 2) as writer:
        second = subprocess.run(
            [sys.executable, "-c", child, root, str(path)],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert second.returncode == 2
        assert f"is open elsewhere: process {os.getpid()} on " in second.stdout
        go_on(writer, 2, 3)
    with Trajectory(path) as trajectory:
        assert len(trajectory) == 3
