"""The order in which a trajectory reaches the disk: whatever a kill cuts off, committed frames are there."""

from __future__ import annotations

import os
import sys

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, some_disks, some_state
from support.trajectory_parts import SERIES_COLUMNS, TRACKED, batch, row

from ifrdem.errors import InputError
from ifrdem.trajectory import layout
from ifrdem.trajectory.file import PAGE, OrderedFile, OutputFile
from ifrdem.trajectory.writer import TrajectoryWriter

CUT_FROM, FRAMES = (
    58,
    70,
)  # the index of a field's chunks splits at 64 frames, and with chunks of one row, of all others


@pytest.mark.full
@pytest.mark.parametrize("n", [40, 1200])
def test_every_prefix_of_the_written_bytes_holds_the_committed_frames(tmp_path, monkeypatch, n):
    """A kill leaves the writes up to some moment, and the last of them up to the end of some page.

    By HDF5 alone, 11 moments at each split lose all frames. A node of an index across two pages, half of it written,
    shows frames as zeros.
    """
    monkeypatch.setattr(layout, "CHUNK_ROWS", 1)
    monkeypatch.setattr(layout, "CHUNK_EVENTS", 50)
    writes: list[tuple[int, bytes]] = []
    write = OrderedFile._write

    def record(self: OrderedFile, view: memoryview, place: int) -> None:
        writes.append((place, bytes(view)))
        write(self, view, place)

    monkeypatch.setattr(OrderedFile, "_write", record)
    commits = []  # writes, frames, rows, batches
    fields = ["position", "velocity", "angular_velocity", "collisions"]
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(n), BOX, fields=fields) as writer:
        writer.begin_histories(TRACKED, some_state(n, 0))
        for number in range(FRAMES):
            writer.write_series(0.1 * number, row(number), SERIES_COLUMNS)
            commits.append((len(writes), number, number + 1, number))
            writer.write_histories(*batch(number))
            commits.append((len(writes), number, number + 1, number + 1))
            writer.write(some_state(n, number), {"energy": 0.5 * number})
            commits.append((len(writes), number + 1, number + 1, number + 1))
    states = [some_state(n, number) for number in range(FRAMES)]
    written = {
        "position/time": np.array([state.time for state in states]),
        "position/value_2d": np.array([state.position for state in states], np.float32),
        "velocity/value_2d": np.array([state.velocity for state in states], np.float32),
        "angular_velocity/value": np.array([state.spin for state in states], np.float32),
        "collisions/value": np.array([state.collisions for state in states]),
    }
    psi = np.concatenate([batch(number)[0]["psi"] for number in range(FRAMES)])
    left = tmp_path / "left.h5"

    def check(committed: tuple[int, int, int, int]) -> None:
        with h5py.File(left, "r") as file:
            frames = len(file["particles/all/position/step"])
            rows = len(file["timeseries/step"])
            events = int(file["histories/committed/events"][-1])
            assert frames >= committed[1]
            assert rows >= committed[2]
            assert events >= 50 * committed[3]
            for name, values in written.items():
                assert np.array_equal(file[f"particles/all/{name}"][:frames], values[:frames])
            assert np.array_equal(file["observables/energy/value"][:frames], 0.5 * np.arange(frames))
            assert np.array_equal(file["timeseries/collisions/value"][:rows], 7 * np.arange(rows))
            assert np.array_equal(file["histories/events/psi"][:events], psi[:events])

    committed, whole, torn, size = commits[0], 0, 0, 0
    with open(left, "wb", buffering=0) as image:
        for number, (place, data) in enumerate(writes, 1):
            used = place < size
            size = max(size, place + len(data))
            image.truncate(size)
            for end in range((place // PAGE + 1) * PAGE, place + len(data), PAGE) if used else ():
                os.pwrite(image.fileno(), data[: end - place], place)
                if committed[1] >= CUT_FROM:
                    check(committed)
                    torn += 1
            os.pwrite(image.fileno(), data, place)
            while commits and commits[0][0] <= number:
                committed = commits.pop(0)
            if committed[1] >= CUT_FROM:
                check(committed)
                whole += 1
    assert whole > 150
    assert torn > 8


@pytest.mark.parametrize("longest", [1000, 20_000])
def test_overlapping_pieces_give_the_file_that_was_written(tmp_path, longest):
    """Random reads and writes against an array, across flushes."""
    rng = np.random.default_rng(5)
    path = tmp_path / "file"
    path.write_bytes(b"")
    file, expected = OrderedFile(path), np.zeros(4 * longest, np.uint8)
    end = 0
    for _ in range(3000):
        place, length = int(rng.integers(0, 3 * longest)), int(rng.integers(1, longest))
        if rng.random() < 0.3:  # where the last piece ended
            place = min(file.tell(), 3 * longest)
        file.seek(place)
        if rng.random() < 0.5:
            data = rng.integers(0, 256, length, dtype=np.uint8)
            file.write(data.tobytes())
            expected[place : place + length] = data
            end = max(end, place + length)
        else:
            assert file.read(length) == expected[place : place + length].tobytes()
        if rng.random() < 0.02:
            file.flush()
    assert file.error is None
    assert file.seek(0, os.SEEK_END) == end
    file.close()
    assert path.read_bytes() == expected[:end].tobytes()


def test_space_in_use_changes_only_at_a_flush(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    file = OrderedFile(path)
    file.seek(0)
    file.write(b"newer")
    assert path.read_bytes()[:3] == b"old"
    file.flush()
    assert path.read_bytes() == b"newer"
    file.close()


def test_new_space_is_on_the_disk_before_space_in_use_changes(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    file = OrderedFile(path)
    order: list[tuple[int, bytes]] = []
    file._write = lambda view, place: order.append((place, bytes(view)))  # type: ignore[method-assign]
    for place, data in ((3, b"aa"), (0, b"new"), (5, b"bb"), (9, b"cc")):
        file.seek(place)
        file.write(data)
    file.flush()
    assert order == [(3, b"aa"), (5, b"bb"), (9, b"cc"), (0, b"new")]
    file.close()


def test_the_superblock_goes_first_and_indexes_go_before_numbers_of_rows(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(bytes(1000))
    file = OrderedFile(path)
    order: list[int] = []
    file._write = lambda view, place: order.append(place)  # type: ignore[method-assign]
    pieces = {
        0: b"SNOD....",
        50: b"TREE\x00\x00..",  # a leaf of names
        100: b"TREE\x01\x00..",  # a leaf of chunks; the sixth byte is its level
        200: b"TREE\x01\x02..",
        300: b"TREE\x01\x01..",
        400: b"anything",
        500: b"HEAP....",
        600: b"\x89HDF\r\n\x1a\n...",
    }
    for place, data in pieces.items():
        file.seek(place)
        file.write(data)
    file.flush()
    assert order == [600, 500, 200, 300, 100, 400, 50, 0]
    file.close()


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of this kind there")
def test_a_locked_file_is_refused(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        writer.write(some_state(3, 0))
        with pytest.raises(BlockingIOError):
            OrderedFile(path)
        with pytest.raises(InputError, match="is open elsewhere"):
            OutputFile.reopen(path)
    OutputFile.reopen(path).close(lambda: None, keep=True)
