"""Whatever ends a writing process or takes its disk away, the file keeps the committed frames and can be resumed."""

from __future__ import annotations

import errno
import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import BOX, some_disks
from support.layout_files import some_state as new_state
from support.trajectory_parts import SERIES_COLUMNS, TRACKED, row
from support.trajectory_parts import batch as new_batch

from ifrdem.errors import TrajectoryError
from ifrdem.quantities import EVENT
from ifrdem.trajectory.background import AsyncWriter
from ifrdem.trajectory.file import OrderedFile
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")

# Sixty files are compared with the same states.
some_state, batch = functools.cache(new_state), functools.cache(new_batch)

N = 3000
WRITTEN = 400  # as many numbers are written at most

# Imports once and forks a writer for each line on stdin, so that 60 of them are cheap. A writer says by letters in a
# file what has been committed: f, s and e for a frame, a row of series and a batch of events.
FORKS = """
import json, os, sys
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tests", sys.argv[1] + "/tests/trajectory"]
import test_killed_writer
from ifrdem.tools.versions import package_versions
package_versions()  # so that no child has to look for them
assert not {"taichi", "quadrants"} & set(sys.modules)
for line in sys.stdin:
    pid = os.fork()
    if pid == 0:
        try:
            test_killed_writer.write_until(**json.loads(line))
        finally:
            os._exit(1)
    print(pid, flush=True)
    os.waitpid(pid, 0)
    print("gone", flush=True)
"""


def write_until(path: str, log: str, compression: str, how: str, n: int, limit: int) -> None:
    """Write until something ends it; how: plain, or queued to a thread."""
    if limit:
        import resource

        signal.signal(
            signal.SIGXFSZ, signal.SIG_IGN
        )  # a write beyond the limit is an error then, not a death
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    voice = os.open(log, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    plain = TrajectoryWriter(path, some_disks(n), BOX, compression=compression)
    writer = plain if how == "plain" else AsyncWriter(plain)
    printed = {"f": 0, "s": 0, "e": 0}
    try:
        writer.begin_histories(TRACKED, some_state(n, 0))
        for number in range(WRITTEN):
            for step in (
                lambda: writer.write(some_state(n, number), {"energy": 0.5 * number}),  # noqa: B023 called at once
                lambda: writer.write_series(0.1 * number, row(number), SERIES_COLUMNS),  # noqa: B023
                lambda: writer.write_histories(*batch(number)),  # noqa: B023
            ):
                step()
                for letter, now in (
                    ("f", len(writer)),
                    ("s", writer.series_rows),
                    ("e", writer.events // 50),
                ):
                    os.write(voice, letter.encode() * (now - printed[letter]))
                    printed[letter] = now
    except TrajectoryError as error:
        os.write(voice, f"!{error}".encode())
    writer.close()
    os._exit(0)


@pytest.fixture(scope="module")
def forks() -> Iterator[subprocess.Popen[str]]:
    root = str(Path(__file__).resolve().parents[2])
    with subprocess.Popen(
        [sys.executable, "-c", FORKS, root], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process
        assert process.stdin is not None
        process.stdin.close()


def started(forks: subprocess.Popen[str], path: Path, log: Path, **options) -> int:
    """Fork a writer; returns its process id."""
    assert forks.stdin is not None
    assert forks.stdout is not None
    given = {"compression": "none", "how": "plain", "n": N, "limit": 0, **options}
    forks.stdin.write(json.dumps({"path": str(path), "log": str(log), **given}) + "\n")
    forks.stdin.flush()
    return int(forks.stdout.readline())


def gone(forks: subprocess.Popen[str]) -> None:
    assert forks.stdout is not None
    assert forks.stdout.readline() == "gone\n"


def assert_whole(path: Path, n: int, log: str) -> tuple[int, int, int]:
    """All that has a commit is as its number says, and all that was reported is there; returns how much."""
    with Trajectory(path):
        pass  # it is a whole trajectory file
    with h5py.File(path, "r") as file:
        particles = file["particles/all"]
        frames = len(particles["position/step"])
        assert frames >= log.count("f")
        for i in range(frames):
            state = some_state(n, i)
            assert particles["position/time"][i] == state.time
            assert np.array_equal(particles["position/value_2d"][i], state.position.astype(np.float32))
            assert np.array_equal(particles["velocity/value_2d"][i], state.velocity.astype(np.float32))
            assert np.array_equal(particles["angular_velocity/value"][i], state.spin.astype(np.float32))
            assert np.array_equal(particles["collisions/value"][i], state.collisions)
        if frames:
            assert np.array_equal(file["observables/energy/value"][:frames], 0.5 * np.arange(frames))
        rows = len(file["timeseries/step"]) if "timeseries" in file else 0
        assert rows >= log.count("s")
        for name, first in row(0).items() if rows else ():
            stored = file[f"timeseries/{name}/value"][:rows]
            assert np.array_equal(
                stored, np.array([row(i)[name] for i in range(rows)]).reshape(rows, *np.shape(first))
            )
        batches = 0
        if "histories" in file:
            commits = file["histories/committed/events"]
            batches = len(commits) - 1
            assert np.array_equal(commits, 50 * np.arange(len(commits)))
            events = [batch(i)[0] for i in range(batches)]
            for name in EVENT if batches else ():
                given = np.concatenate([each[name] for each in events])
                assert np.array_equal(file[f"histories/events/{name}"][: len(given)], given)
        assert batches >= log.count("e")
    return frames, rows, batches


def go_on(path: Path, n: int, compression: str, counted: tuple[int, int, int]) -> None:
    """The file can be gone on with, from a checkpoint before its end, to one of everything more."""
    frames, rows, batches = counted
    back = [max(0, each - 1) for each in counted]
    with TrajectoryWriter.resume(
        path,
        some_disks(n),
        BOX,
        compression=compression,
        frames=back[0],
        series_rows=back[1],
        events=50 * back[2],
    ) as writer:
        for number in range(back[0], frames + 1):
            writer.write(some_state(n, number), {"energy": 0.5 * number})
        for number in range(back[1], rows + 1):
            writer.write_series(0.1 * number, row(number), SERIES_COLUMNS)
        writer.begin_histories(TRACKED, some_state(n, 0))
        for number in range(back[2], batches + 1):
            writer.write_histories(*batch(number))
    assert assert_whole(path, n, "") == (frames + 1, rows + 1, batches + 1)


@pytest.mark.parametrize(("moments", "different"), [(12, 4), pytest.param(30, 5, marks=pytest.mark.full)])
def test_writers_killed_at_any_moment_leave_all_they_had_committed(tmp_path, forks, moments, different):
    committed = []
    for moment in range(moments):
        path, log = tmp_path / f"{moment}.h5", tmp_path / f"{moment}.log"
        compression, how = ("none", "gzip", "zstd")[moment % 3], ("plain", "queued")[moment % 2]
        n = (40, N)[moment % 5 != 0]
        pid = started(forks, path, log, compression=compression, how=how, n=n)
        # So many letters on, and a little more: a slow machine is killed no earlier than a fast one.
        rng = np.random.default_rng(moment)
        letters = int(rng.integers(0, 13))
        while not path.exists() or (log.stat().st_size if log.exists() else 0) < letters:
            time.sleep(0.0005)
        time.sleep(rng.uniform(0.0, 0.01))
        os.kill(pid, signal.SIGKILL)
        gone(forks)
        text = log.read_text() if log.exists() else ""
        counted = assert_whole(path, n, text)
        with h5py.File(path, "r+") as file:
            assert len(file["particles/all/position/step"]) == counted[0]
        go_on(path, n, compression, counted)
        committed.append(counted[0])
        path.unlink()
    assert committed.count(0) < moments // 4  # the moments are not all before the first frame
    assert len(set(committed)) >= different


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("how", ["plain", "queued"])
def test_a_limit_on_the_file_leaves_all_that_was_committed(tmp_path, forks, how):
    """A limit on the size of files fails writes as a full disk does."""
    path, log = tmp_path / "run.h5", tmp_path / "log"
    started(forks, path, log, how=how, limit=8_000_000)
    gone(forks)
    text, _, error = log.read_text().partition("!")
    assert "could not be written (File too large); the " in error
    assert "before it are kept" in error
    counted = assert_whole(path, N, text)
    assert counted[0] > 3
    go_on(path, N, "none", counted)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 8 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode != 0:
        # Mounting takes rights; without them, the test with a limit on the size of files replaces it.
        pytest.skip(f"no disk can be mounted here: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("how", ["plain", "queued"])
@pytest.mark.parametrize("compression", ["none", "gzip"])
def test_a_full_disk_leaves_all_that_was_committed(tmp_path, small_disk, forks, how, compression):
    path, log = small_disk / "run.h5", tmp_path / "log"
    started(forks, path, log, how=how, compression=compression)
    gone(forks)
    text, _, error = log.read_text().partition("!")
    assert "could not be written (No space left on device); the " in error
    counted = assert_whole(path, N, text)
    assert counted[0] > 3
    shutil.copy(path, tmp_path / "run.h5")
    go_on(tmp_path / "run.h5", N, compression, counted)


@pytest.mark.parametrize("queued", [False, True])
def test_a_file_that_is_deleted_or_replaced_meanwhile_is_reported(tmp_path, queued):
    path = tmp_path / "run.h5"
    for replace in (False, True):
        plain = TrajectoryWriter(path, some_disks(3), BOX, force=True)
        writer = AsyncWriter(plain) if queued else plain
        writer.write(some_state(3, 0))
        if queued:
            writer.flush()
        path.unlink()
        if replace:
            path.write_text("other")
        if queued:
            writer.write(some_state(3, 1))
        write_or_wait = writer.flush if queued else lambda: plain.write(some_state(3, 1))  # noqa: B023 called at once
        with pytest.raises(TrajectoryError, match="replaced" if replace else "deleted"):
            write_or_wait()
        writer.close()
        assert path.exists() == replace
    assert path.read_text() == "other"  # the file there now belongs to another process


@pytest.mark.full
@pytest.mark.parametrize("writes", range(8))
def test_a_failing_drive_in_the_middle_of_a_frame_leaves_the_previous_frames(tmp_path, monkeypatch, writes):
    """From some write on nothing reaches the disk any more, not even when the file is closed."""
    path = tmp_path / "run.h5"
    left, write = [10**9], OrderedFile._write

    def fail(self: OrderedFile, view: memoryview, place: int) -> None:
        if left[0] == 0:
            self.error = self.error or OSError(errno.EIO, os.strerror(errno.EIO))
            return
        left[0] -= 1
        write(self, view, place)

    monkeypatch.setattr(OrderedFile, "_write", fail)
    with TrajectoryWriter(path, some_disks(3), BOX) as writer:
        writer.begin_histories(TRACKED[:1], some_state(3, 0))
        writer.write(some_state(3, 0), {"energy": 0.0})
        writer.write_series(0.0, row(0), SERIES_COLUMNS)
        left[0] = writes
        with pytest.raises(
            TrajectoryError, match=r"\(Input/output error\); the 1 frame and 1 row of the series before"
        ):
            writer.write(some_state(3, 1), {"energy": 0.5})
        with pytest.raises(TrajectoryError, match="closed: rows of the series cannot be added"):
            writer.write_series(0.1, row(1))
    monkeypatch.undo()
    assert assert_whole(path, 3, "fs") == (1, 1, 0)


@pytest.mark.full
def test_a_disk_that_refuses_pieces_leaves_a_file_that_can_be_closed(tmp_path, monkeypatch):
    """An error remembers where it happened, and with that the memory that is let go of."""
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, some_disks(3000), BOX) as writer:
        writer.write(some_state(3000, 0), {"energy": 0.0})
        raw = writer._output._raw._raw

        class Refusing:
            def __getattr__(self, name: str) -> object:
                return getattr(raw, name)

            def write(self, data: memoryview) -> int:
                if len(data) > 10_000:
                    raise OSError(errno.EIO, os.strerror(errno.EIO))
                return raw.write(data)

        monkeypatch.setattr(writer._output._raw, "_raw", Refusing())
        with pytest.raises(TrajectoryError, match=r"\(Input/output error\); the 1 frame before"):
            writer.write(some_state(3000, 1), {"energy": 0.5})
        writer.close()
    monkeypatch.undo()
    assert assert_whole(path, 3000, "f") == (1, 0, 0)
