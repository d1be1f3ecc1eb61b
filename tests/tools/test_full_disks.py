"""On full disks, after Ctrl-C, on drives that fail: writers leave what was there, and nothing half; readers say why."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import zipfile
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.layout_files import write

from ifrdem.cli.main import main
from ifrdem.errors import DamageError, InputError, ReadError
from ifrdem.simulation.checkpoints import checkpoint
from ifrdem.study import task
from ifrdem.study.results import Results
from ifrdem.study.task import Variable
from ifrdem.tools import files
from ifrdem.trajectory import damage
from ifrdem.trajectory.file import OrderedFile, new_file
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.repair import _Salvage, repair

TESTS = Path(__file__).resolve().parents[1]
MOUNTED = ("unshare", "-rm", "sh", "-c", 'mount -t tmpfs -o size=4m tmpfs "$0" && exec "$@"')
"""Words before a folder and a command, which then has a file system of 4 MiB there; not only root may do this."""


def walked(folder: Path, kind: str, levels: int) -> Counter[str]:
    """Attempts of each writer that were refused; all that is wrong fails the test."""
    words = [sys.executable, "-m", "support.full_disks", str(folder), kind, str(levels)]
    given = os.environ | {"PYTHONPATH": os.pathsep.join((str(TESTS), str(TESTS.parent)))}
    if kind == "disk":
        words = [*MOUNTED, str(folder), *words]
    done = subprocess.run(words, env=given, capture_output=True, text=True, check=False)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, (done.returncode, lines[-1:], done.stderr[-3000:])
    assert done.stderr == ""
    found = Counter[str]()
    for name, room, message, wrong in lines:
        assert not wrong, (name, room, wrong)
        found[name] += bool(message)
    return found


def can_mount(folder: Path) -> bool:
    """True if a small disk can be had here."""
    try:
        return (
            subprocess.run([*MOUNTED, str(folder), "true"], capture_output=True, check=False).returncode == 0
        )
    except FileNotFoundError:
        return False


@pytest.mark.full
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no limits on files here")
@pytest.mark.parametrize("kind", ["disk", "limit"])
def test_no_writer_dies_or_leaves_half_a_file_on_a_full_disk(tmp_path, kind):
    """HDF5 wrote checkpoints, results, views and exports itself: SIGSEGV, or a message in lines, and half a file.

    matplotlib raised an AttributeError from PDF; ffmpeg's half movie took the place of the old one.
    """
    if kind == "disk" and not can_mount(tmp_path):
        pytest.skip("no disk can be mounted here; a limit on the size of files takes its place")
    refused = walked(tmp_path, kind, 12)
    assert all(refused.values()), refused  # each was seen on a disk too small for it


INTERRUPTED = """
import os, signal, sys
from pathlib import Path
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tests"]
import numpy as np
from support.layout_files import BOX, some_disks, some_state
from ifrdem.tools import files
from ifrdem.trajectory.file import OrderedFile, new_file
from ifrdem.trajectory.reader import Trajectory
from ifrdem.trajectory.writer import TrajectoryWriter

signal.signal(signal.SIGINT, signal.default_int_handler)
calls, at = 0, 0
for name in ("seek", "write", "readinto", "flush", "truncate"):
    def counting(*given, act=getattr(OrderedFile, name)):
        global calls
        calls += 1
        if calls == at:
            signal.raise_signal(signal.SIGINT)
        return act(*given)
    setattr(OrderedFile, name, counting)

def whole(path):
    with files.replacing(path, synced=False) as new, new_file(new) as file:
        for number in range(3):
            file.create_dataset(f"group {number}/x", data=np.arange(2000.0), chunks=(100,), compression="gzip")

def frames(path):
    with TrajectoryWriter(path, some_disks(4), BOX) as writer:
        for number in range(3):
            writer.write(some_state(4, number), {"energy": 1.0})
            done.append(number)

folder = Path(sys.argv[2])
for write in (whole, frames):
    calls, at, done = 0, 0, []
    write(folder / "a.h5")
    last = calls
    os.unlink(folder / "a.h5")
    steps = range(1, last, max(1, last // 25))
    for step in steps:
        calls, at, done = 0, step, []
        try:
            write(folder / "a.h5")
        except KeyboardInterrupt:
            pass
        else:
            sys.exit(f"no interrupt in {write.__name__} at {step}")
        left = os.listdir(folder)
        if left and (write is whole or left != ["a.h5"]):
            sys.exit(f"{write.__name__} at {step} left {left}")
        if left:
            with Trajectory(folder / "a.h5") as trajectory:
                held = len(trajectory)
            os.unlink(folder / "a.h5")
            if held < max(1, len(done)):
                sys.exit(f"{held} frames for {done}")
        elif done:
            sys.exit(f"lost {done}")
    print(write.__name__, len(steps))
"""


def test_ctrl_c_in_the_middle_of_hdf5_neither_crashes_nor_leaves_half_a_file(tmp_path):
    """A handler that raised while HDF5 called the file of Python's ended in SIGSEGV, also in a script with a writer."""
    root = str(TESTS.parent)
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, root, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["whole", "frames"]


def refusing(raw: OrderedFile, number: int) -> object:
    """The file under another one, each write to which fails."""

    class Refusing:
        def __getattr__(self, name: str) -> object:
            return getattr(below, name)

        def write(self, _: object) -> int:
            raise OSError(number, os.strerror(number))

    below = raw._raw
    return Refusing()


def test_work_on_a_new_file_ends_soon_after_ctrl_c_or_a_failure(tmp_path):
    """An export of gigabytes must not go on to its end."""
    path, steps = tmp_path / "a.h5", []

    def interrupted() -> None:
        with files.replacing(path) as new, new_file(new) as file:
            signal.raise_signal(signal.SIGINT)
            steps.append("it waits")
            file.check()
            steps.append("went on")

    def refused() -> None:
        with files.replacing(path) as new, new_file(new) as file:
            file.raw._raw = refusing(file.raw, errno.EDQUOT)
            file["x"] = np.arange(100_000)  # HDF5 is told of success: it could not handle the failure
            steps.append("it waits")
            file.check()
            steps.append("went on")

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    with pytest.raises(OSError, match="quota"):
        refused()
    assert steps == ["it waits", "it waits"]
    assert os.listdir(tmp_path) == []


MEMORY = "/proc/self/mem"
"""A regular file, reading of whose beginning is an input/output error, as of a drive that fails."""
needs_memory = pytest.mark.skipif(not os.path.exists(MEMORY), reason="no file whose reading fails here")


def fail_from_now_on(file: h5py.File) -> None:
    """Let the system fail to read a file that HDF5 has open."""
    memory = os.open(MEMORY, os.O_RDONLY)
    os.dup2(memory, file.id.get_vfd_handle())
    os.close(memory)


@needs_memory
def test_a_drive_that_fails_is_no_damage_of_a_trajectory(tmp_path):
    """It was "damaged", with the advice to repair: a copy of what was read before the drive failed."""
    write(tmp_path / "run.h5", n=3000)
    with Trajectory(tmp_path / "run.h5") as trajectory:
        fail_from_now_on(trajectory.file)
        with pytest.raises(
            ReadError, match=r"run\.h5 cannot be read: Input/output error; this says nothing of"
        ) as raised:
            trajectory[1].position  # noqa: B018 read
    assert "repair" not in str(raised.value)


@needs_memory
@pytest.mark.parametrize("in_place", [False, True])
def test_repair_drops_no_frame_because_a_drive_fails(tmp_path, monkeypatch, in_place):
    """In place, it replaced the file by one without the frames that it could not read at that moment."""
    path = tmp_path / "run.h5"
    write(path, n=3000, frames=4)
    with h5py.File(path, "r+") as file:
        file["particles/all/position/step"].resize(3, axis=0)
    content, readable = path.read_bytes(), _Salvage._readable_rows

    def failing(self: _Salvage, dataset: h5py.Dataset, *given: int) -> object:
        if "velocity" in dataset.name:
            fail_from_now_on(self._file)
        return readable(self, dataset, *given)

    monkeypatch.setattr(_Salvage, "_readable_rows", failing)
    with pytest.raises(ReadError, match="Input/output error"):
        repair(path, path if in_place else tmp_path / "whole.h5", log=lambda _text: None)
    assert os.listdir(tmp_path) == ["run.h5"]
    assert path.read_bytes() == content


@needs_memory
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("a.checkpoint.h5", checkpoint.read), ("s.nc", Results.read),
        ("a.h5", lambda path: repair(path, path.with_name("b.h5"), log=lambda _text: None)), ("a.h5", Trajectory),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_read_is_not_called_damaged_or_foreign(tmp_path, name, read):
    (tmp_path / name).symlink_to(MEMORY)
    with pytest.raises(InputError, match=f"{name}.* cannot be read: Input/output error") as raised:
        read(tmp_path / name)
    assert not isinstance(raised.value, DamageError)


def test_a_result_that_cannot_be_read_now_is_not_run_again(tmp_path, monkeypatch):
    """The study took it for damaged, ran it again and wrote over it; what is damaged is run again."""
    path = tmp_path / "0.npz"
    task.save(path, {"x": Variable(("t",), np.arange(3.0), "")}, seconds=1.0)
    content = path.read_bytes()
    one = task.Task("0", (0,), "", "", (), str(tmp_path), (), (), None, False, 1.0)
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda *_: fail(errno.EIO))
    with pytest.raises(ReadError, match=r"0\.npz cannot be read: Input/output error"):
        one.done  # noqa: B018 read
    assert one.perform() == f"{path} cannot be read: Input/output error; this says nothing of what it holds"
    monkeypatch.undo()
    assert path.read_bytes() == content
    assert one.done
    path.write_bytes(content[:-30])
    assert not one.done


def fail(number: int) -> None:
    raise OSError(number, os.strerror(number))


@pytest.mark.parametrize(
    "number", [errno.EIO, errno.EACCES, errno.EROFS, errno.EDQUOT, errno.ENOSPC, errno.ESTALE]
)
@pytest.mark.parametrize("by", [OSError, RuntimeError, KeyError])
def test_errors_of_the_system_are_told_from_damage(number, by):
    """HDF5 raises whatever its function raises, and names the number of the system's error in its text."""
    text = f"Unable to open object (file read failed: time = now, errno = {number}, error message = '...', offset = 96)"
    with pytest.raises(ReadError, match=os.strerror(number)), damage.as_damage_error("a.h5", "its box"):
        raise OSError(number, os.strerror(number)) if by is OSError else by(text)
    with pytest.raises(DamageError), damage.as_damage_error("a.h5", "its box"):
        raise (
            by("bad object header version number, errno = 0")
            if by is not OSError
            else OSError("truncated file")
        )


@pytest.mark.parametrize(
    "number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO, errno.EFBIG]
)
def test_repair_says_what_keeps_it_from_writing(tmp_path, monkeypatch, capsys, number):
    """It said that nothing could be kept, and to run the case again."""
    path = tmp_path / "run.h5"
    write(path, n=60, frames=4)
    with h5py.File(path, "r+") as file:
        file["particles/all/position/step"].resize(3, axis=0)
    begin = OrderedFile.__init__

    def failing(self: OrderedFile, given: Path) -> None:
        begin(self, given)
        self._raw = refusing(self, number)

    monkeypatch.setattr(OrderedFile, "__init__", failing)
    assert main(["repair", str(path), "-o", str(tmp_path / "whole.h5")]) == 2
    *_, last = capsys.readouterr().err.strip().splitlines()
    assert last.startswith(f"ifrdem: output {tmp_path}/whole.h5: cannot be written: {os.strerror(number)}; ")
    assert os.listdir(tmp_path) == ["run.h5"]
