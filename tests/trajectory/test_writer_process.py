"""A writer in a process of its own: the same file, the same errors, and nothing left of it, however it ends."""

from __future__ import annotations

import errno
import gc
import os
import resource
import signal
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.trajectory_parts import TRACKED, batch
from test_reader import BOX, some_disks, some_state
from test_writer_resume import N, begun, content, go_on

from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.model.state import State, StoredState
from ifrdem.trajectory import file as output_file
from ifrdem.trajectory import writer_process
from ifrdem.trajectory.background import QueuedWriter
from ifrdem.trajectory.layout import FIELDS
from ifrdem.trajectory.ordered_file import OrderedFile
from ifrdem.trajectory.writer import TrajectoryError, TrajectoryWriter
from ifrdem.trajectory.writer_process import RemoteWriter

pytestmark = pytest.mark.skipif(
    # Elsewhere writers are threads, which other tests look at.
    not writer_process.possible(),
    reason="processes that share memory are for Linux here",
)


@pytest.fixture(params=[100, 2**16])
def shared(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Nearly all arrays go by way of the shared memory, or none that a small frame has."""
    monkeypatch.setattr(writer_process, "SHARED", request.param)
    return int(request.param)


@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "precision": "f8", "fields": list(FIELDS)}])
def test_its_file_is_that_of_a_writer_here(tmp_path, shared, options):
    begun(tmp_path / "plain.h5", 12, **options)
    remote = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX, **options)
    with QueuedWriter(remote) as writer:
        writer.begin_histories(TRACKED, some_state(N, 0))
        go_on(writer, 0, 12)
        writer.flush()
        assert (len(writer), writer.series_rows, writer.events) == (12, 12, 600)
        assert writer.seen == {"frames": 12, "series_rows": 12, "events": 600}
        assert writer.path == (tmp_path / "run.h5").resolve()
        assert (writer.compressor is None) == (not options)
    assert content(tmp_path / "run.h5") == content(tmp_path / "plain.h5")
    assert remote._process.poll() == 0


def test_frames_that_grow_larger_than_the_memory_that_was_shared_arrive(tmp_path, monkeypatch):
    """Each batch of events needs more of it than the one before."""
    monkeypatch.setattr(writer_process, "SHARED", 100)
    counts = [50, 500, 20, 5000, 40_000]
    writers = [
        TrajectoryWriter(tmp_path / "plain.h5", some_disks(N), BOX),
        RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX),
    ]
    for writer in writers:
        writer.begin_histories(TRACKED, some_state(N, 0))
        for number, count in enumerate(counts):
            writer.write_histories(*batch(number, count))
            writer.write(some_state(N, number))
        writer.close()
    assert content(tmp_path / "run.h5") == content(tmp_path / "plain.h5")


def test_it_goes_on_with_a_file(tmp_path):
    begun(tmp_path / "whole.h5", 9)
    begun(tmp_path / "run.h5", 5)
    seen = {"frames": 2, "series_rows": 2, "events": 100}
    writer = RemoteWriter("go_on", tmp_path / "run.h5", some_disks(N), BOX, **seen)
    assert (len(writer), writer.seen) == (5, seen)
    writer.begin_histories(TRACKED, some_state(N, 0))
    go_on(writer, 2, 9)
    writer.close()
    assert content(tmp_path / "run.h5") == content(tmp_path / "whole.h5")


def test_frames_of_many_disks_have_one(tmp_path, monkeypatch):
    monkeypatch.setattr(writer_process, "LEAST_DISKS", 41)
    for n, kind in ((40, TrajectoryWriter), (41, RemoteWriter)):
        path = tmp_path / f"{n}.h5"
        writer = writer_process.begin(path, some_disks(n), BOX)
        assert type(writer) is kind
        writer.write(some_state(n, 0))
        writer.close()
        writer = writer_process.go_on(path, some_disks(n), BOX, frames=1)
        assert type(writer) is kind
        writer.close()


def test_what_is_wrong_is_said_as_by_a_writer_here(tmp_path):
    path = tmp_path / "run.h5"
    path.write_text("other")
    with pytest.raises(InputError, match=r"run\.h5 exists: choose another name"):
        RemoteWriter("begin", path, some_disks(N), BOX)
    with pytest.raises(InputError, match="field = 'spin'"):
        RemoteWriter("begin", tmp_path / "new.h5", some_disks(N), BOX, fields=["spin"])
    assert os.listdir(tmp_path) == ["run.h5"]
    writer = RemoteWriter("begin", path, some_disks(N), BOX, force=True)
    writer.write(some_state(N, 0))
    with pytest.raises(InputError, match="41 disks: 40 are needed"):
        writer.write(some_state(N + 1, 1))
    path.unlink()
    with pytest.raises(TrajectoryError, match="somebody has deleted"):
        writer.write(some_state(N, 1))
    writer.close()
    assert writer._process.poll() is not None


def test_a_fault_of_its_own_is_told_with_its_place(tmp_path):
    """What no writer raises, here a name that none has, is no dead process, and the file is closed as ever."""
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    writer.write(some_state(N, 0))
    with pytest.raises(
        RuntimeError, match=r"the process that writes: AttributeError.*no_such[\s\S]*in serve"
    ):
        writer._call("no_such")
    writer.close()
    with h5py.File(tmp_path / "run.h5") as file:
        assert len(file["particles/all/position/step"]) == 1


@pytest.mark.parametrize("queued", [False, True])
def test_one_that_is_killed_is_told_of_and_the_file_keeps_what_is_committed(tmp_path, queued):
    remote = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    writer = QueuedWriter(remote) if queued else remote
    for number in range(3):
        writer.write(some_state(N, number))
    if queued:
        writer.flush()
    remote._process.kill()
    remote._process.wait()

    def write_and_wait() -> None:
        writer.write(some_state(N, 3))
        if isinstance(writer, QueuedWriter):
            writer.flush()

    with pytest.raises(
        TrajectoryError,
        match=r"run\.h5: the process that writes it was killed by SIGKILL: the system does that when memory runs "
        "out; the 3 frames before are kept",
    ):
        write_and_wait()
    writer.close()  # what was raised is not raised again
    with h5py.File(tmp_path / "run.h5", "r+") as file:  # and nobody holds it
        assert len(file["particles/all/position/step"]) == 3


def test_one_that_is_killed_in_the_middle_of_a_call_is_told_of(tmp_path):
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    writer.write(some_state(N, 0))
    writer._process.send_signal(signal.SIGSTOP)  # so that the call waits
    killer = threading.Timer(0.3, writer._process.kill)
    killer.start()
    with pytest.raises(TrajectoryError, match="was killed by SIGKILL"):
        writer.write(some_state(N, 1))
    writer.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_that_mean_the_run_do_not_end_it(tmp_path, number):
    """Also one that comes while it starts: those of a run are blocked from its first instruction on."""
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    status = Path(f"/proc/{writer._process.pid}/status").read_text()
    blocked = int(next(line for line in status.splitlines() if line.startswith("SigBlk")).split()[1], 16)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2):
        assert blocked & (1 << (number - 1))
    writer._process.send_signal(number)
    time.sleep(0.05)
    writer.write(some_state(N, 0))
    writer.close()
    assert writer._process.poll() == 0


def test_nothing_stays_of_one_that_is_forgotten(tmp_path):
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    process, memory = writer._process, writer._memory_file
    del writer
    gc.collect()
    assert process.poll() is not None
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(memory)


PARENT = """
import os, sys
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tests", sys.argv[1] + "/tests/trajectory"]
from test_reader import BOX, some_disks, some_state
from ifrdem.trajectory.writer_process import RemoteWriter
writer = RemoteWriter("begin", sys.argv[2], some_disks(3), BOX)
writer.write(some_state(3, 0))
print(writer._process.pid, flush=True)
if sys.argv[3] == "leaves":
    sys.exit(0)
if sys.argv[3] == "crashes":
    os._exit(7)
sys.stdin.read()
"""


@pytest.mark.parametrize("end", ["leaves", "crashes", "is killed"])
def test_it_ends_with_its_run_however_that_ends(tmp_path, end):
    root = str(Path(__file__).resolve().parents[2])
    path = tmp_path / "run.h5"
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, root, str(path), end],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as run:  # fmt: skip
        assert run.stdout is not None
        process = int(run.stdout.readline())
        if end == "is killed":
            run.kill()
        run.wait(30.0)
    for _ in range(500):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            break
        state = Path(f"/proc/{process}/stat")
        if state.exists() and state.read_text().split()[2] == "Z":  # whoever has it now has not looked yet
            break
        time.sleep(0.01)
    else:
        raise AssertionError("it has outlived its run")
    with TrajectoryWriter.resume(path, some_disks(3), BOX, frames=1) as writer:
        writer.write(some_state(3, 1))


def test_a_lock_that_is_given_back_soon_is_waited_for_and_another_not(tmp_path, monkeypatch):
    begun(tmp_path / "run.h5", 2)
    holder = OrderedFile(tmp_path / "run.h5")
    threading.Timer(0.3, holder.close).start()
    TrajectoryWriter.resume(tmp_path / "run.h5", some_disks(N), BOX, frames=2).close()
    monkeypatch.setattr(output_file, "LOCK_WAIT", 0.1)
    holder = OrderedFile(tmp_path / "run.h5")
    with pytest.raises(InputError, match="is open elsewhere"):
        TrajectoryWriter.resume(tmp_path / "run.h5", some_disks(N), BOX, frames=2)
    holder.close()


def test_where_no_process_is_to_be_had_a_writer_here_does_it_and_that_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    monkeypatch.setattr(writer_process, "LEAST_DISKS", 0)
    descriptors = len(os.listdir("/proc/self/fd"))
    with pytest.raises(InputError, match=r"run\.h5: no process can be started to write it"):
        RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    assert os.listdir(tmp_path) == []
    assert len(os.listdir("/proc/self/fd")) == descriptors
    with pytest.warns(RuntimeWarning, match="a thread of the run writes"):
        writer = writer_process.begin(tmp_path / "run.h5", some_disks(N), BOX)
    assert type(writer) is TrajectoryWriter
    writer.write(some_state(N, 0))
    writer.close()


def test_a_process_that_never_answers_leaves_the_writing_to_a_thread(tmp_path, monkeypatch, capsys):
    """Another interpreter that is none, say; `ifrdem run` says so as it says all."""
    monkeypatch.setattr(sys, "executable", "/bin/true")
    monkeypatch.setattr(writer_process, "LEAST_DISKS", 0)
    with pytest.warns(
        RuntimeWarning, match="ended with status 0 and without a result; a thread of the run writes"
    ):
        writer = writer_process.begin(tmp_path / "run.h5", some_disks(N), BOX)
    assert type(writer) is TrajectoryWriter
    writer.close()
    case = ["elastic", "--set", "species[0].number=100", "--set", "run.collisions_per_disk=1"]
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert cli.main(["run", *case, "-o", f"{tmp_path}/", "--no-picture"]) == 0
    told = capsys.readouterr().err
    assert "ifrdem: warning: output " in told
    assert "run.py" not in told


def test_memory_that_is_not_to_be_had_is_told_and_the_file_keeps_what_is_committed(tmp_path, monkeypatch):
    monkeypatch.setattr(writer_process, "SHARED", 100)
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    writer.write(some_state(N, 0))

    def refused(*_: int) -> None:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    monkeypatch.setattr(os, "posix_fallocate", refused)
    with pytest.raises(
        TrajectoryError, match=r"cannot be handed on \(Cannot allocate memory\); the 1 frames before are kept"
    ):
        writer.write_histories(*batch(0, 5000))
    writer.close()
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        assert len(file["particles/all/position/step"]) == 1


def test_an_answer_that_was_not_waited_for_is_nobody_elses(tmp_path, monkeypatch):
    """Ctrl-C in the middle of a call: the writer has ended then."""
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    writer.write(some_state(N, 0))

    def interrupted() -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(writer._line, "recv", interrupted)
        with pytest.raises(KeyboardInterrupt):
            writer.write(some_state(N, 1))
    assert writer._process.poll() is not None
    with pytest.raises(TrajectoryError, match="is closed: nothing can be added"):
        writer.write(some_state(N, 2))
    writer.close()


def test_one_field_may_be_given_as_a_text(tmp_path):
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX, fields="velocity")
    writer.write(some_state(N, 0))
    writer.close()
    with h5py.File(tmp_path / "run.h5") as file:
        expected = some_state(N, 0).velocity.astype(np.float32)
        assert np.array_equal(file["particles/all/velocity/value_2d"][0], expected)


def test_it_is_this_package_that_writes_whatever_the_present_folder_is(tmp_path, monkeypatch):
    """Where it was found by a relative path, which means another folder by now."""
    (tmp_path / "ifrdem").mkdir()
    (tmp_path / "ifrdem" / "__init__.py").write_text("raise SystemExit(9)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    writer.write(some_state(N, 0))
    writer.close()
    assert len(writer) == 1


def test_what_it_is_given_is_not_changed_and_may_change_afterwards(tmp_path, shared):
    """A call has done with its arguments when it returns."""
    state = some_state(N, 0)
    copies = {name: np.array(value) for name, value in vars(state).items() if isinstance(value, np.ndarray)}
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX, precision="f8")
    writer.write(state)
    for name, value in copies.items():
        assert np.array_equal(getattr(state, name), value)
    state.velocity[:] = 7.0
    writer.close()
    with h5py.File(tmp_path / "run.h5") as file:
        assert np.array_equal(file["particles/all/velocity/value_2d"][0], copies["velocity"])


def test_columns_of_larger_rows_arrive_as_they_are(tmp_path, shared):
    """The engine's frames: all numbers of a disk together, words of 4 bytes; whole numbers beside real ones."""
    plain = TrajectoryWriter(tmp_path / "plain.h5", some_disks(N), BOX, fields=list(FIELDS))
    remote = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX, fields=list(FIELDS))
    for number in range(3):
        whole = some_state(N, number)
        rows = np.zeros((N, 8), np.int32)
        reals = rows.view(np.float32)
        reals[:, 0:2], reals[:, 2:4], reals[:, 4] = whole.position, whole.velocity, whole.spin
        rows[:, 5], rows[:, 6:8] = whole.collisions, whole.image
        wide = np.arange(3 * N, dtype=np.int32).reshape(N, 3)
        state = StoredState(
            reals[:, 0:2], reals[:, 2:4], reals[:, 4], whole.time, rows[:, 5], rows[:, 6:8],
            last_partner=wide[:, number], angle=whole.angle,
        )  # fmt: skip
        for writer in (plain, remote):
            writer.write(state)
    plain.close()
    remote.close()
    assert content(tmp_path / "run.h5") == content(tmp_path / "plain.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        at = file["particles/all"]
        assert np.array_equal(at["velocity/value_2d"][2], some_state(N, 2).velocity.astype(np.float32))
        assert np.array_equal(at["image/value_2d"][2], some_state(N, 2).image)
        assert np.array_equal(at["last_partner/value"][2], wide[:, 2])


def in_fortran_order(state: State) -> State:
    for name in ("position", "velocity", "image"):
        setattr(state, name, np.asfortranarray(getattr(state, name)))
    return state


@pytest.mark.parametrize(
    "turned", [in_fortran_order, lambda state: replace(state, image=state.image[:, ::-1])]
)
def test_arrays_that_lie_otherwise_in_memory_arrive_as_they_are(tmp_path, shared, turned):
    observable = np.asfortranarray(np.random.default_rng(1).normal(size=(9000, 2)))
    plain = TrajectoryWriter(tmp_path / "plain.h5", some_disks(N), BOX, fields=list(FIELDS))
    remote = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX, fields=(each for each in FIELDS))
    for writer in (plain, remote):
        writer.write(turned(some_state(N, 1)), {"map": observable})
        writer.close()
    assert content(tmp_path / "run.h5") == content(tmp_path / "plain.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        assert np.array_equal(file["particles/all/image/value_2d"][0], turned(some_state(N, 1)).image)
        assert np.array_equal(file["observables/map/value"][0], observable)


def test_what_cannot_travel_is_refused_and_the_writer_goes_on(tmp_path):
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX)
    with pytest.raises(InputError, match="write: what is given cannot be handed to the process that writes"):
        writer.write(some_state(N, 0), {"energy": lambda: 1.0})  # type: ignore[dict-item]
    writer.write(some_state(N, 0), {"energy": 1.0})
    writer.close()
    assert len(writer) == 1
    with pytest.raises(TrajectoryError, match="is closed: nothing can be added"):
        writer.write(some_state(N, 1), {"energy": 1.0})


@pytest.mark.parametrize("force", [False, True])
def test_one_that_is_killed_before_its_first_frame_leaves_nothing(tmp_path, force):
    if force:
        begun(tmp_path / "run.h5", 2)
    before = sorted((each.name, each.read_bytes()) for each in tmp_path.iterdir())
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX, force=force)
    os.kill(writer._process.pid, signal.SIGKILL)
    writer._process.wait()
    with pytest.raises(TrajectoryError, match=r"was killed by SIGKILL.*; nothing was written"):
        writer.write(some_state(N, 0))
    writer.close()
    assert sorted((each.name, each.read_bytes()) for each in tmp_path.iterdir()) == before


@pytest.mark.parametrize("force", [False, True])
def test_a_first_frame_that_is_committed_stays_though_nobody_was_told(tmp_path, monkeypatch, force):
    """The process dies between its commit and its answer."""
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(N), BOX, force=force)

    def killed() -> None:
        assert writer._line.poll(30.0)  # the answer is there, and with it the frame
        os.kill(writer._process.pid, signal.SIGKILL)
        writer._process.wait()
        raise EOFError

    monkeypatch.setattr(writer._line, "recv", killed)
    with pytest.raises(TrajectoryError, match="was killed by SIGKILL"):
        writer.write(some_state(N, 0))
    writer.close()
    assert [each.name for each in tmp_path.iterdir()] == ["run.h5"]
    with h5py.File(tmp_path / "run.h5") as file:
        assert len(file["particles/all/position/step"]) == 1


def test_memory_that_runs_out_there_is_said_in_a_line(tmp_path):
    """It may have 200 kB more than it has, and is given more than a megabyte."""
    n = 40_000
    writer = RemoteWriter("begin", tmp_path / "run.h5", some_disks(n), BOX)
    writer.write(some_state(n, 0))
    status = Path(f"/proc/{writer._process.pid}/statm").read_text()
    limit = int(status.split()[0]) * os.sysconf("SC_PAGESIZE") + 200_000
    resource.prlimit(writer._process.pid, resource.RLIMIT_AS, (limit, limit))
    with pytest.raises(
        TrajectoryError, match=r"the process that writes: .*; the 1 frames before are kept"
    ) as caught:
        writer.begin_histories(TRACKED, some_state(n, 0))
    assert "Traceback" not in str(caught.value)
    writer.close()
    with h5py.File(tmp_path / "run.h5") as file:
        assert len(file["particles/all/position/step"]) == 1
