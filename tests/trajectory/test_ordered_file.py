"""The order in which a trajectory reaches the disk: whatever a kill cuts off, what was committed is there."""

from __future__ import annotations

import errno
import io
import os
import weakref
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.trajectory_parts import SERIES_COLUMNS, TRACKED, batch, row
from test_reader import BOX, some_disks, some_state

from ifrdem.errors import InputError
from ifrdem.trajectory import history_columns, layout, ordered_file
from ifrdem.trajectory.file import OutputFile
from ifrdem.trajectory.ordered_file import OrderedFile
from ifrdem.trajectory.reader import TrajectoryWriter

fcntl = pytest.importorskip("fcntl")
pytestmark = pytest.mark.skipif(not hasattr(os, "pwrite"), reason="HDF5 writes by itself here")

N = 40
CUT_FROM, FRAMES = (
    58,
    70,
)  # the index of a field's chunks splits at 64 frames, and with chunks of one row, of all others


def test_every_beginning_of_what_is_written_holds_what_was_committed(tmp_path, monkeypatch):
    """A kill leaves the writes up to some moment. By HDF5 alone, 11 moments at each split lose all frames."""
    monkeypatch.setattr(layout, "CHUNK_ROWS", 1)
    monkeypatch.setattr(history_columns, "CHUNK_EVENTS", 50)
    writes: list[tuple[int, bytes]] = []
    write = OrderedFile._write

    def record(self: OrderedFile, view: memoryview, place: int) -> None:
        writes.append((place, bytes(view)))
        write(self, view, place)

    monkeypatch.setattr(OrderedFile, "_write", record)
    commits = []  # writes, frames, rows, batches
    with TrajectoryWriter(tmp_path / "run.h5", some_disks(N), BOX) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        for number in range(FRAMES):
            writer.write_series(0.1 * number, row(number), SERIES_COLUMNS)
            commits.append((len(writes), number, number + 1, number))
            writer.write_histories(*batch(number))
            commits.append((len(writes), number, number + 1, number + 1))
            writer.write(some_state(N, number), {"energy": 0.5 * number})
            commits.append((len(writes), number + 1, number + 1, number + 1))
    states = [some_state(N, number).velocity.astype(np.float32) for number in range(FRAMES)]
    psi = np.concatenate([batch(number)[0]["psi"] for number in range(FRAMES)])
    image = bytearray()
    committed, cut = commits[0], 0
    for number, (place, data) in enumerate(writes, 1):
        image.extend(bytes(max(0, place + len(data) - len(image))))
        image[place : place + len(data)] = data
        while commits and commits[0][0] <= number:
            committed = commits.pop(0)
        if committed[1] < CUT_FROM:
            continue
        cut += 1
        with h5py.File(io.BytesIO(bytes(image)), "r") as file:
            frames = len(file["particles/all/position/step"])
            rows = len(file["timeseries/step"])
            events = int(file["histories/committed/events"][-1])
            assert frames >= committed[1]
            assert rows >= committed[2]
            assert events >= 50 * committed[3]
            assert np.array_equal(file["particles/all/velocity/value_2d"][:frames], states[:frames])
            assert np.array_equal(file["observables/energy/value"][:frames], 0.5 * np.arange(frames))
            assert np.array_equal(file["timeseries/collisions/value"][:rows], 7 * np.arange(rows))
            assert np.array_equal(file["histories/events/psi"][:events], psi[:events])
    assert cut > 150


@pytest.mark.parametrize("longest", [1000, 20_000])
def test_the_file_is_what_was_written_where_pieces_overlap(tmp_path, monkeypatch, longest):
    """Random reads and writes against an array, across flushes; long pieces pass by the system's cache."""
    monkeypatch.setattr(ordered_file, "LARGE", 8192)
    monkeypatch.setattr(ordered_file, "LEAST_LENT", 100)
    monkeypatch.setattr(ordered_file, "MOST_HELD", 2 * longest)
    rng = np.random.default_rng(5)
    path = tmp_path / "file"
    path.write_bytes(b"")
    file, expected = OrderedFile(path), np.zeros(4 * longest, np.uint8)
    end = 0
    lent = rng.integers(0, 256, 3 * longest, dtype=np.uint8)
    for _ in range(3000):
        place, length = int(rng.integers(0, 3 * longest)), int(rng.integers(1, longest))
        if rng.random() < 0.3:  # where the last piece ended
            place = min(file.tell(), 3 * longest)
        file.seek(place)
        if rng.random() < 0.5:
            if rng.random() < 0.3:  # of an array that is lent
                first = int(rng.integers(0, len(lent) - length))
                data = lent[first : first + length]
                file.lend([lent])
                for part in np.array_split(data, int(rng.integers(1, 4))):
                    file.write(part)
            else:
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


def test_the_file_is_what_was_written_as_it_grows_by_pieces_of_lent_arrays(tmp_path, monkeypatch):
    """At its end, in new space: parts of arrays in and out of turn, others between them, reads of both, and gaps.

    Gaps of up to MOST_GAP and larger ones, which are read as zeros until a later piece fills them, before the flush or
    after it; or stay.
    """
    monkeypatch.setattr(ordered_file, "LARGE", 8192)
    monkeypatch.setattr(ordered_file, "MOST_GAP", 1000)
    monkeypatch.setattr(ordered_file, "LEAST_LENT", 100)
    monkeypatch.setattr(ordered_file, "MOST_HELD", 20_000)
    rng = np.random.default_rng(7)
    path = tmp_path / "file"
    path.write_bytes(b"")
    file, expected = OrderedFile(path), bytearray()
    gaps: list[tuple[int, int]] = []
    for _ in range(300):
        arrays = [rng.integers(0, 256, 20_000, dtype=np.uint8) for _ in range(2)]
        file.lend(arrays)
        at = [0, 0]
        for _ in range(int(rng.integers(1, 12))):
            which, length = int(rng.integers(0, 2)), int(rng.integers(1, 4000))
            if rng.random() < 0.2:  # out of turn
                at[which] = int(rng.integers(0, 15_000))
            part = arrays[which][at[which] : at[which] + length]
            at[which] += length
            if rng.random() < 0.3:
                part = rng.integers(0, 256, length, dtype=np.uint8)
            if rng.random() < 0.2:
                gaps.append((len(expected), int(rng.integers(1, 1500))))
                expected += bytes(gaps[-1][1])
            file.seek(len(expected))
            file.write(part)
            expected += part.tobytes()
            if gaps and rng.random() < 0.2:
                place, length = gaps.pop(int(rng.integers(0, len(gaps))))
                file.seek(place)
                file.write(filling := rng.integers(0, 256, length, dtype=np.uint8).tobytes())
                expected[place : place + length] = filling
            if rng.random() < 0.2:  # over what is there, and beyond its end
                place = max(0, len(expected) - int(rng.integers(1, 9000)))
                file.seek(place)
                file.write(anew := rng.integers(0, 256, int(rng.integers(1, 9500)), dtype=np.uint8).tobytes())
                expected[place : place + len(anew)] = anew
            if rng.random() < 0.3:
                place = max(0, len(expected) - int(rng.integers(1, 9000)))
                file.seek(place)
                assert file.read(5000) == bytes(expected[place : place + 5000]).ljust(5000, b"\0")
        file.flush()
        known = weakref.ref(arrays[0])
        del arrays, part
        assert known() is None  # the flush has given them back
    file.close()
    assert path.read_bytes() == bytes(expected)


def large_pieces(path: Path, count: int) -> bytes:
    """Give a new file pieces that are flushed each; returns what it must hold."""
    path.write_bytes(b"")
    file = OrderedFile(path)
    pieces = [bytes([i + 1]) * (ordered_file.LARGE + 5000 * i + 777) for i in range(count)]
    for piece in pieces:
        file.write(piece)
        file.flush()
    if file.error is not None:
        raise file.error
    file.close()
    return b"".join(pieces)


def watch(monkeypatch, failing: int = 0) -> list[bool]:
    """Whether each writing passes by the system's cache; those that do may fail with an errno."""
    past: list[bool] = []
    pwrite = os.pwrite

    def watched(descriptor: int, data: memoryview, place: int) -> int:
        past.append(bool(fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_DIRECT))
        if past[-1]:
            address = np.frombuffer(data, np.uint8).ctypes.data
            assert address % 4096 == len(data) % 4096 == place % 4096 == 0
            if failing:
                raise OSError(failing, os.strerror(failing))
        return pwrite(descriptor, data, place)

    monkeypatch.setattr(os, "pwrite", watched)
    return past


@pytest.fixture
def way_past_the_cache(tmp_path):
    """Not everywhere is there one."""
    try:
        os.close(os.open(tmp_path / "probe", os.O_CREAT | os.O_RDWR | os.O_DIRECT))
    except (AttributeError, OSError):
        # Some file systems, and all but Linux, have no such way; there the file takes the other, which the rest tests.
        pytest.skip("writings cannot pass by the cache here")


@pytest.mark.usefixtures("way_past_the_cache")
@pytest.mark.parametrize(("failing", "times"), [(0, 3), (errno.EINVAL, 1), (errno.EOPNOTSUPP, 1)])
def test_large_pieces_pass_by_the_cache_unless_that_cannot_be(tmp_path, monkeypatch, failing, times):
    """A file system that cannot gets the others by way of the cache; the file is the same."""
    past = watch(monkeypatch, failing)
    expected = large_pieces(tmp_path / "file", 3)
    assert sum(past) == times
    assert (tmp_path / "file").read_bytes() == expected


@pytest.mark.usefixtures("way_past_the_cache")
def test_a_full_disk_is_told_where_pieces_pass_by_the_cache(tmp_path, monkeypatch):
    past = watch(monkeypatch, errno.ENOSPC)
    with pytest.raises(OSError, match="No space left"):
        large_pieces(tmp_path / "file", 2)
    assert sum(past) == 1


def test_the_fields_of_a_frame_are_copied_by_the_flush_alone(tmp_path, monkeypatch):
    """Whole chunks of arrays as the file wants them stay where they are until then; the last chunk is padded."""
    put_off: list[int] = []
    ask = OrderedFile._put_off

    def asked(self: OrderedFile, start: int, data: memoryview) -> bool:
        answer = ask(self, start, data)
        put_off.extend([len(data)] * answer)
        return answer

    monkeypatch.setattr(OrderedFile, "_put_off", asked)
    n = 40_000
    state = some_state(n, 0)
    with TrajectoryWriter(
        tmp_path / "run.h5", some_disks(n), BOX, precision="f8", fields=["velocity"]
    ) as writer:
        writer.write(state)
    assert sum(put_off) > 0.6 * 16 * n
    with h5py.File(tmp_path / "run.h5") as file:
        assert np.array_equal(file["particles/all/velocity/value_2d"][0], state.velocity)


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
    # What follows each other is one writing, and so is what has a small gap between.
    assert order == [(3, b"aabb\0\0cc"), (0, b"new")]


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


def test_a_locked_file_is_refused(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        writer.write(some_state(3, 0))
        with pytest.raises(BlockingIOError):
            OrderedFile(path)
        with pytest.raises(InputError, match="is open elsewhere"):
            OutputFile.reopen(path)
    OutputFile.reopen(path).close(lambda: None, keep=True)


def test_reserved_room_is_given_back_at_the_end(tmp_path):
    path = Path(tmp_path / "run.h5")
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        writer.write(some_state(3, 0))
        writer._output.reserve(1_000_000)
        assert path.stat().st_size > 1_000_000
    assert path.stat().st_size < 100_000
