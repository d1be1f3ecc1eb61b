"""Devices: named, checked before use, never replaced silently."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from ifrdem import Device
from ifrdem.errors import InputError
from ifrdem.kernels.compiler import runtime
from ifrdem.simulation import backend


def test_a_cpu_is_always_available() -> None:
    (cpu,) = (device for device in backend.available() if device.name == "cpu")
    assert f"{backend.cores()} threads" in cpu.description


@pytest.mark.parametrize(
    ("device", "threads", "message"),
    [
        ("cdua", None, "= 'cdua': must be one of 'cpu', 'cuda' .did you mean 'cuda'"),
        ("gpu", None, "= 'gpu': must be"),
        ("cpu", 0, "threads = 0: must be"),
        ("cpu", backend.cores() + 1, f"must be from 1 to the {backend.cores()} cores"),
    ],
)
def test_what_is_not_there_is_refused(device: str, threads: int | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        backend.start(Device(device, threads=threads))


@pytest.mark.skipif(len(backend.available()) > 1, reason="this machine has a CUDA device")
def test_an_absent_gpu_is_refused_and_not_replaced_by_the_cpu() -> None:
    with pytest.raises(InputError, match="no such device on this machine; present: cpu"):
        backend.start("cuda")


def test_starting_again_with_the_same_settings_keeps_what_runs() -> None:
    from ifrdem.kernels.compiler.language import ti

    running = backend.start("cpu")
    program = ti.lang.impl.get_runtime().prog
    assert backend.start("cpu") is running
    assert ti.lang.impl.get_runtime().prog is program


@pytest.mark.full
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_precision_is_the_type_of_real_numbers(precision: str) -> None:
    from ifrdem.kernels.compiler.language import ti

    try:
        assert backend.start(Device("cpu", precision=precision)).precision == precision
        assert ti.lang.impl.get_runtime().default_fp == getattr(ti, precision)
    finally:
        backend.stop()


def test_an_unknown_precision_is_refused_with_the_nearest_spelling() -> None:
    with pytest.raises(InputError, match=r"precision = 'f46': .*did you mean 'f64'\?\)"):
        backend.start(Device("cpu", precision="f46"))


def test_memory_that_is_available_is_no_more_than_there_is() -> None:
    free = backend.memory_available()
    if free is not None:  # reported by the system
        assert 0 < free <= os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def test_neither_the_environment_nor_an_unwritable_cache_changes_what_runs() -> None:
    code = (
        "from ifrdem.simulation import backend; backend.start('cpu'); from ifrdem.kernels.compiler.language import ti; "
        "assert ti.cfg.arch == ti.cpu, ti.cfg.arch"
    )
    environment = {**os.environ, runtime.variable("ARCH"): "vulkan", CACHE: "/proc/1/nowhere"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment
    )
    assert done.returncode == 0, done.stderr


def test_starting_prints_nothing_on_stdout() -> None:
    code = "from ifrdem.simulation import backend; backend.available(); backend.start('cpu')"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout == ""


@pytest.mark.full
def test_arrays_of_a_runtime_that_ended_take_none_of_the_next_with_them() -> None:
    # The runtime knows arrays by their addresses: without `free_array` some of the new ones are freed with the old.
    from ifrdem.kernels.compiler.language import ti

    backend.start("cpu")
    for _ in range(3):
        old = [ti.ndarray(ti.i32, (100,)) for _ in range(200)]
        backend.stop()
        assert all(array.arr is None for array in old)
        backend.start("cpu")
        new = [ti.Vector.ndarray(3, ti.f32, (100,)) for _ in range(200)]
        del old
        others = [ti.ndarray(ti.i32, (7,)) for _ in range(200)]
        assert all(list(array.arr.shape) == [100] for array in new)
        assert len(others) == 200
    backend.stop()


CACHE = runtime.variable("OFFLINE_CACHE_FILE_PATH")
DRIVER = """
int cuInit(unsigned flags) { return %d; }
int cuDeviceGetCount(int *count) { *count = 0; return 0; }
"""


@pytest.mark.full(keep=1)
@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, to make a driver")
@pytest.mark.parametrize(
    ("library", "error", "says"),
    [
        ("libcuda.so", 100, "finds no device that works (cuInit gives error 100)"),
        ("libcuda.so", 0, "has no device (CUDA_VISIBLE_DEVICES = 7)"),
        ("libcuda.so.1", 0, "libcuda.so.1 only, and {runtime} opens libcuda.so"),
    ],
)
def test_a_driver_without_a_device_and_no_device_are_reported(
    library: str, error: int, says: str, tmp_path: Path
) -> None:
    """Error 100 is CUDA_ERROR_NO_DEVICE, what a driver says where no GPU was handed to a container or a job."""
    says = says.format(runtime=runtime.chosen())
    (tmp_path / "driver.c").write_text(DRIVER % error)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, "driver.c"], cwd=tmp_path, check=True)
    environment = {**os.environ, "LD_LIBRARY_PATH": str(tmp_path), "CUDA_VISIBLE_DEVICES": "7"}

    def run(code: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment
        )

    listed = run("from ifrdem.cli.main import main; main(['devices'])").stdout
    assert says in listed
    assert [line.split()[0] for line in listed.splitlines() if "not usable" not in line] == [
        "cpu",
        "runtime",
        "pybullet",
    ]
    started = run("from ifrdem.simulation import backend; backend.start('cuda')")
    assert says in started.stderr.splitlines()[-1]
    assert "InputError: device = 'cuda': no such device" in started.stderr.splitlines()[-1]


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, to make a driver")
def test_more_ranks_than_gpus_are_refused_with_the_way_to_share(tmp_path: Path) -> None:
    (tmp_path / "driver.c").write_text(DRIVER % 100)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", "libcuda.so", "driver.c"], cwd=tmp_path, check=True)
    environment = {**os.environ, "LD_LIBRARY_PATH": str(tmp_path)}
    environment.pop("CUDA_VISIBLE_DEVICES", None)
    code = "from ifrdem.simulation import backend; backend.show_gpu(3); backend.check('cuda')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert "this rank was to have GPU 3" in done.stderr


@pytest.mark.parametrize(
    ("named", "number", "visible"),
    [(None, 2, "2"), ("4,5", 1, "5"), ("4, 5", 3, "5"), ("GPU-8932f937", 1, "GPU-8932f937"), ("", 1, "")],
)
def test_a_rank_sees_the_gpu_of_its_number(
    named: str | None, number: int, visible: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of those that are named, in turn; without names of all."""
    monkeypatch.setattr(backend, "_shown", None)
    monkeypatch.setattr(backend, "_driver_queried", False)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "" if named is None else named)
    if named is None:
        monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    backend.show_gpu(number)
    assert os.environ["CUDA_VISIBLE_DEVICES"] == visible
    backend.show_gpu(number + 1)  # of another gas: it stays
    assert os.environ["CUDA_VISIBLE_DEVICES"] == visible


def test_a_gpu_cannot_be_chosen_after_the_driver_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "_shown", None)
    monkeypatch.setattr(backend, "_driver_queried", True)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,5")
    with pytest.raises(InputError, match=r"rank 1 .* GPU 5, .* before"):
        backend.show_gpu(1)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5")
    backend.show_gpu(1)  # what the driver shows already


@pytest.mark.full(keep=("False",))
@pytest.mark.parametrize("cache", [True, False])
def test_the_runtime_starts_without_a_home(tmp_path: Path, cache: bool) -> None:
    """Taichi itself aborts then; batch systems and containers may leave HOME out."""
    code = "from ifrdem.simulation import backend; backend.start(backend.Device('cpu', threads=1)); print('runs')"
    environment = {key: value for key, value in os.environ.items() if key != "HOME"}
    environment.pop(CACHE, None)
    if cache:
        environment[CACHE] = str(tmp_path)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "runs\n"), done.stderr


@pytest.mark.skipif(os.name != "posix", reason="no owners and modes of folders")
def test_a_user_without_a_home_gets_a_private_folder(tmp_path: Path) -> None:
    """A fixed name in the folder for temporary files could be made by another user, who would choose the code."""
    (tmp_path / ".cache").mkdir(mode=0o777)
    code = (
        "import os, pwd, warnings\n"
        "def without(user): raise KeyError(user)\n"
        "pwd.getpwuid = without\n"
        "from ifrdem.simulation import backend\n"
        "with warnings.catch_warnings(record=True) as caught:\n"
        "    backend.start(backend.Device(threads=1))\n"
        "print(len(caught), caught[0].message)\n"
        "print(*(f'{os.stat(one.path).st_mode & 0o777:o}' for one in os.scandir(os.environ['TMPDIR'])\n"
        "        if one.name != '.cache'))\n"
    )
    environment = {key: value for key, value in os.environ.items() if key != "HOME"}
    environment |= {"TMPDIR": str(tmp_path)}
    environment.pop(CACHE, None)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    warning, modes = done.stdout.splitlines()
    assert warning.startswith("1 kernel cache: this user has no home folder: every process compiles")
    assert set(modes.split()) == {"700"}
    assert [each.name for each in tmp_path.rglob("*")] == [".cache"]  # nothing in it, and all else is removed


def test_a_kernel_cache_that_others_may_write_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its files are code that the process executes."""
    grp, pwd = pytest.importorskip("grp"), pytest.importorskip("pwd")  # not on Windows
    folder = tmp_path / "new" / "cache"
    monkeypatch.setenv(CACHE, str(folder))
    before = os.umask(0)
    try:
        assert backend.kernel_cache_trouble() is None
    finally:
        os.umask(before)
    assert folder.stat().st_mode & 0o777 == 0o700
    for mode, what in ((0o702, "every user may write it"), (0o720, "its group may write it")):
        folder.chmod(mode)
        with monkeypatch.context() as patch:
            patch.setattr(grp, "getgrgid", lambda gid: SimpleNamespace(gr_name="physics", gr_mem=[]))
            trouble = backend.kernel_cache_trouble() or ""
        assert f"kernel cache {folder}: {what}" in trouble
        assert f"set {CACHE} to a folder of your own" in trouble
    name = pwd.getpwuid(os.geteuid()).pw_name  # many systems make a group for each user
    for members, used in (([], True), ([name, "other"], False)):
        with monkeypatch.context() as patch:
            patch.setattr(grp, "getgrgid", lambda gid, m=members: SimpleNamespace(gr_name=name, gr_mem=m))
            assert (backend.kernel_cache_trouble() is None) == used
    folder.chmod(0o700)
    if os.geteuid() == 0:
        os.chown(folder, 54321, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 54321)
    assert "it belongs to another user" in (backend.kernel_cache_trouble() or "")
    with pytest.warns(UserWarning, match="it belongs to another user"):
        assert backend._kernel_cache() == backend._temporary_cache()


@pytest.mark.skipif(os.name != "posix", reason="no owners and modes of folders")
def test_a_kernel_cache_below_a_folder_that_others_may_write_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who may write a folder may rename those in it and put others there, unless it is sticky, as /tmp is."""
    shared = tmp_path / "shared"
    monkeypatch.setenv(CACHE, str(shared / "cache" / "kernels"))
    link = tmp_path / "link"
    link.symlink_to(shared)
    for mode in (0o700, 0o1777):
        shared.mkdir(exist_ok=True)
        shared.chmod(mode)
        assert backend.kernel_cache_trouble() is None
    shared.chmod(0o777)
    assert f": every user may write {shared}, and kernels" in (backend.kernel_cache_trouble() or "")
    monkeypatch.setenv(CACHE, str(link / "cache" / "kernels"))
    assert f": every user may write {shared}, and kernels" in (backend.kernel_cache_trouble() or "")
    aside = tmp_path / "aside"  # a link there can be replaced, though it leads to a private folder
    aside.mkdir()
    (aside / "link").symlink_to(shared)
    monkeypatch.setenv(CACHE, str(aside / "link"))
    shared.chmod(0o700)
    assert backend.kernel_cache_trouble() is None
    aside.chmod(0o702)
    assert f": every user may write {aside}, and kernels" in (backend.kernel_cache_trouble() or "")


START = "from ifrdem.simulation import backend; backend.start(backend.Device(threads=1))"
RUN = (
    "from ifrdem.cli.main import main; main(['-q', 'run', 'cooling', '-o', sys.argv[1] + '/run.h5', '--set', "
    "'species[0].number=30', '--set', 'run.collisions_per_disk=1'])"
)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("use", [START, RUN], ids=["start", "run"])
def test_no_connection_is_opened_and_no_identifier_left(use: str, tmp_path: Path) -> None:
    """By itself Taichi asks its server for the newest version, in a thread, and stores a random number of the user."""
    home, out = tmp_path / "home", tmp_path / "out"
    for each in (home, out):
        each.mkdir()
    code = (
        "import sys, threading\n"
        "seen = []\n"
        "def hook(event, arguments):\n"
        "    if event.split('.')[0] in ('socket', 'urllib'): seen.append((event, arguments))\n"
        "sys.addaudithook(hook)\n"
        f"{use}\n"
        "for one in threading.enumerate():\n"
        "    if one is not threading.main_thread(): one.join(10.0)\n"
        "print(seen)\n"
    )
    environment = {**os.environ, "HOME": str(home)}
    environment.pop("TI_SKIP_VERSION_CHECK", None)
    words = [
        sys.executable,
        "-W",
        "error",
        "-c",
        code,
        str(out),
    ]  # Taichi warns of a call of its own as it is imported
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr
    assert not [each for each in home.rglob("*") if each.is_file()]


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="no folder that root cannot write to")
def test_a_cache_that_cannot_be_written_is_reported_once(tmp_path: Path) -> None:
    code = (
        "import os, tempfile\n"
        "from ifrdem.simulation import backend\n"
        "for threads in (1, 2, 1):\n    backend.start(backend.Device(threads=threads))\n    backend.stop()\n"
        "print([name for name in os.listdir(tempfile.gettempdir()) if name.startswith('ifrdem-kernels-')])\n"
    )
    environment = {**os.environ, "HOME": "/proc", "TMPDIR": str(tmp_path)}
    environment.pop(CACHE, None)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (
        done.stderr.count(f"kernel cache /proc/.cache/{runtime.chosen()}/{runtime.cache_name()}: cannot be")
        == 1
    )
    assert f"set {CACHE} to a folder" in done.stderr
    assert len(ast.literal_eval(done.stdout)) == 1  # all in one folder, which is gone at the end
    assert not list(tmp_path.iterdir())


@pytest.mark.full
def test_a_lock_of_a_killed_process_leaves_the_kernel_cache_at_a_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a lock there, the runtime neither reads nor writes its cache; a lock that is a minute old has no owner."""
    monkeypatch.setenv(CACHE, str(tmp_path))
    lock = tmp_path / runtime.cache_lock()
    lock.parent.mkdir(exist_ok=True)
    lock.touch()
    backend.stop()
    backend.start("cpu")
    assert lock.exists()  # it may be that of a process that compiles now
    os.utime(lock, (time.time() - 61.0,) * 2)
    backend.stop()
    backend.start("cpu")
    assert not lock.exists()
    backend.stop()
