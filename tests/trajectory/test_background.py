"""Writing in the background of a run: order, bounds, errors, and concurrent readers."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from support.layout_files import BOX, some_disks, some_state
from support.trajectory_parts import TRACKED, row
from test_writer_resume import N, begin_file, content, go_on

from ifrdem.errors import InputError, TrajectoryError
from ifrdem.trajectory.background import WAITING, AsyncWriter
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter


class Gate(TrajectoryWriter):
    """A writer that waits before each frame until it is let through."""

    assignable = ("gate", "fail_at")

    def __init__(self, *given, **options) -> None:
        super().__init__(*given, **options)
        self.gate = threading.Semaphore(0)
        self.fail_at: int | None = None

    def write(self, state, observables=None) -> None:
        assert self.gate.acquire(timeout=30.0)
        if self.fail_at == len(self):
            raise TrajectoryError("the disk is full")
        super().write(state, observables)


def test_a_queued_file_is_that_of_a_plain_writer(tmp_path):
    begin_file(tmp_path / "plain.h5", 20)
    with AsyncWriter(TrajectoryWriter(tmp_path / "run.h5", some_disks(N), BOX)) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        go_on(writer, 0, 20)
        writer.flush()
        assert (len(writer), writer.series_rows, writer.events) == (20, 20, 1000)
        assert writer.written_counts == {"frames": 20, "series_rows": 20, "events": 1000}
    assert content(tmp_path / "run.h5") == content(tmp_path / "plain.h5")


def test_at_most_two_frames_wait(tmp_path):
    """One is being written and two wait; the fourth call waits until the first is done."""
    inner = Gate(tmp_path / "run.h5", some_disks(3), BOX)
    writer = AsyncWriter(inner)
    for frame in range(1 + WAITING):
        writer.write(some_state(3, frame))
    returned = threading.Event()

    def fourth() -> None:
        writer.write(some_state(3, 3))
        returned.set()

    thread = threading.Thread(target=fourth)
    thread.start()
    assert not returned.wait(0.2)
    inner.gate.release()
    assert returned.wait(30.0)
    for _ in range(3):
        inner.gate.release()
    thread.join()
    writer.close()
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert np.array_equal(trajectory.times, [some_state(3, i).time for i in range(4)])


def test_closing_writes_queued_frames(tmp_path):
    inner = Gate(tmp_path / "run.h5", some_disks(3), BOX)
    for _ in range(3):
        inner.gate.release()
    with AsyncWriter(inner) as writer:
        for frame in range(3):
            writer.write(some_state(3, frame))
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert len(trajectory) == 3
    writer.close()  # a second time does nothing
    with pytest.raises(TrajectoryError, match="closed"):
        writer.write(some_state(3, 3))


@pytest.mark.parametrize("next_call", ["write", "flush", "close"])
def test_an_error_surfaces_at_the_next_call_and_the_file_keeps_what_is_committed(tmp_path, next_call):
    inner = Gate(tmp_path / "run.h5", some_disks(3), BOX)
    inner.fail_at = 2
    writer = AsyncWriter(inner)
    for frame in range(3):
        inner.gate.release()
        writer.write(some_state(3, frame))
    while inner.gate._value or len(writer) < 2:  # the third is taken up
        time.sleep(0.001)
    while writer._error is None:
        time.sleep(0.001)
    with pytest.raises(TrajectoryError, match="the disk is full"):
        {"write": lambda: writer.write(some_state(3, 3)), "flush": writer.flush, "close": writer.close}[
            next_call
        ]()
    writer.close()  # what was raised is not raised again
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert len(trajectory) == 2


def test_a_frame_that_does_not_fit_is_an_input_error_of_the_next_call(tmp_path):
    writer = AsyncWriter(TrajectoryWriter(tmp_path / "run.h5", some_disks(3), BOX))
    writer.write(some_state(3, 0))
    writer.write(some_state(4, 1))
    with pytest.raises(InputError, match="4 disks: must be 3"):
        writer.flush()
    writer.close()
    with Trajectory(tmp_path / "run.h5") as trajectory:
        assert len(trajectory) == 1


def test_an_error_of_the_run_itself_is_not_hidden_by_one_of_the_queue(tmp_path):
    with pytest.raises(ZeroDivisionError), AsyncWriter(Gate(tmp_path / "run.h5", some_disks(3), BOX)):
        1 / 0  # noqa: B018 any error of a run
    assert not (tmp_path / "run.h5").exists()


def newest(path: Path) -> tuple[int, float, NDArray]:
    """Number of frames, and time and velocities of the last one, read while it is being written.

    HDF5 learns how far a file reaches when it opens it: of what is committed between this and the reading it says that
    it lies beyond the end, and the file is opened again.
    """
    for _ in range(100):
        try:
            with Trajectory(path) as trajectory:
                if len(trajectory):
                    return len(trajectory), trajectory[-1].time, trajectory[-1].velocity
        except OSError as error:
            assert "addr overflow" in str(error)  # noqa: PT017 other errors are none of the race
        time.sleep(0.001)
    raise AssertionError("it could not be read in 100 attempts")


@pytest.mark.full
def test_a_file_can_be_read_while_the_queue_writes_it(tmp_path):
    """A reader sees only whole frames, and ever more of them."""
    path = tmp_path / "run.h5"
    n, observed = 3000, []
    with AsyncWriter(TrajectoryWriter(path, some_disks(n), BOX)) as writer:
        for frame in range(60):
            writer.write(some_state(n, frame))
            writer.write_series(0.1 * frame, row(frame))
            if frame % 6 == 5:
                frames, when, velocity = newest(path)
                last = some_state(n, frames - 1)
                assert np.array_equal(velocity, last.velocity.astype(np.float32))
                assert when == last.time
                observed.append(frames)
    assert observed == sorted(observed)
    assert observed[-1] > observed[0]
    with h5py.File(path) as file:
        assert len(file["timeseries/step"]) == 60


def test_the_first_error_is_raised_and_not_that_of_closing(tmp_path):
    class Torn(TrajectoryWriter):
        def close(self) -> None:
            super().close()
            raise TrajectoryError("closing failed, too")

    with pytest.raises(ZeroDivisionError), AsyncWriter(Torn(tmp_path / "a.h5", some_disks(3), BOX)):
        raise ZeroDivisionError
    with pytest.raises(TrajectoryError, match="closing failed"):  # noqa: SIM117 closing is what is looked at
        with AsyncWriter(Torn(tmp_path / "b.h5", some_disks(3), BOX)):
            pass
