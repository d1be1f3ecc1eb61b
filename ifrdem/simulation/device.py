"""Starting Taichi on a device, and saying which devices there are."""

from __future__ import annotations

import atexit
import contextlib
import gc
import io
import logging
import os
import shutil
import tempfile
import weakref
from dataclasses import dataclass, replace
from typing import Any, Protocol

from ..errors import InputError, nearest

ARCHITECTURES = ("cpu", "cuda")
PRECISIONS = ("f64", "f32")
LOG = logging.getLogger("ifrdem")


@dataclass(frozen=True)
class Device:
    """A device that kernels can run on: its architecture name, and what it is."""

    arch: str
    description: str


@dataclass(frozen=True)
class Running:
    """What Taichi was started with."""

    arch: str
    threads: int
    precision: str = "f64"
    profile: bool = False


_running: Running | None = None
_most_threads: int | None = None


def cpu_name() -> str:
    """What the processor calls itself."""
    try:
        with open("/proc/cpuinfo") as info:
            for line in info:
                if line.startswith("model name"):
                    return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return "CPU"


def cores() -> int:
    """Cores that this process may use (a container or a batch system may allow fewer than there are)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def limit_threads(most: int) -> None:
    """Have what is started from now on without a number of threads take so many at most: others share the cores."""
    global _most_threads
    _most_threads = most


def memory_available() -> int | None:
    """Bytes of memory that a process could still take, or None where the system does not tell.

    A container's limit counts as well, less what is in use in it already.
    """
    found = []
    try:
        with open("/proc/meminfo") as info:
            found += [1024 * int(line.split()[1]) for line in info if line.startswith("MemAvailable:")]
    except OSError:
        pass
    try:
        with open("/sys/fs/cgroup/memory.max") as most, open("/sys/fs/cgroup/memory.current") as used:
            found.append(int(most.read()) - int(used.read()))
    except (OSError, ValueError):  # no such group, or "max": no limit
        pass
    return min(found, default=None)


def available() -> list[Device]:
    """The devices that a simulation can run on. Starts nothing."""
    from .. import kernels  # noqa: F401  (keeps Taichi from printing its banner)

    import taichi as ti  # isort: skip

    # Looking for a GPU driver where there is none is not worth a warning.
    ti.set_logging_level(ti.ERROR)
    devices = [Device("cpu", f"{cpu_name()}, {cores()} threads")]
    if ti._lib.core.with_cuda():
        devices.append(Device("cuda", "NVIDIA GPU (CUDA)"))
    return devices


def check(arch: str, threads: int | None = None, precision: str = "f64") -> None:
    """Raise InputError unless device and precision are known, and device and threads there. Starts nothing."""
    if precision not in PRECISIONS:
        allowed = ", ".join(PRECISIONS)
        raise InputError(f"precision = '{precision}': allowed are {allowed}{nearest(precision, PRECISIONS)}")
    if arch not in ARCHITECTURES:
        allowed = ", ".join(ARCHITECTURES)
        raise InputError(f"arch = '{arch}': allowed are {allowed}{nearest(arch, ARCHITECTURES)}")
    present = [device.arch for device in available()]
    if arch not in present:
        raise InputError(
            f"arch = '{arch}': no such device on this machine; present: {', '.join(present)} (see `ifrdem backends`)"
        )
    # More threads than cores wait for each other at the end of every parallel loop.
    if threads is not None and not (hasattr(threads, "__index__") and 1 <= threads <= cores()):
        raise InputError(
            f"threads = {threads}: must lie between 1 and the {cores()} cores that are here, a whole number"
        )


def _kernel_cache() -> str:
    """Where compiled kernels are kept: Taichi's usual folder, or a passing one where that cannot be written.

    Taichi itself crashes when it cannot write its cache.
    """
    folder = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH") or os.path.expanduser("~/.cache/taichi/ticache")
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        passing = tempfile.mkdtemp(prefix="ifrdem-kernels-")
        atexit.register(shutil.rmtree, passing, ignore_errors=True)
        return passing


class User(Protocol):
    """What holds arrays of Taichi's."""

    def release(self) -> None:
        """Give the arrays up: Taichi ends."""


_users: weakref.WeakSet[User] = weakref.WeakSet()


def register(user: User) -> None:
    """Have `user.release()` called before Taichi ends or starts anew."""
    _users.add(user)


def free_array(array: Any) -> None:
    """Give the memory of a Taichi array back, whoever still refers to it; the array cannot be used any more.

    Taichi frees arrays of numbers when Python forgets them, and arrays of vectors only when it ends.
    """
    import taichi as ti

    runtime = ti.lang.impl.get_runtime()
    if runtime.prog is not None and array.arr is not None:
        runtime.prog.delete_ndarray(array.arr)
        array.arr = None


def _release_all() -> None:
    """Free every array of this Taichi, which is about to end.

    One that Python forgot only later (a traceback can hold it for long) would take an array of the next Taichi with
    it: Taichi knows arrays by their addresses, and a new array may have the address of an old one.
    """
    import taichi as ti

    for user in list(_users):
        user.release()
    _users.clear()
    for thing in gc.get_objects():
        if issubclass(type(thing), ti.Ndarray):  # isinstance would ask every proxy what it stands for
            free_array(thing)


def start(
    arch: str = "cpu", *, threads: int | None = None, precision: str = "f64", profile: bool = False
) -> Running:
    """Start Taichi, or do nothing if it already runs with the same settings.

    Taichi is one per process: starting it with other settings ends every simulation of the process so far.

    Parameters
    ----------
    arch : str
        "cpu" or "cuda". A device that is not there is refused; there is no fall-back.
    threads : int, optional
        Threads on the CPU; all cores by default, or as many as `limit_threads` says. Results do not depend on it.
    precision : {"f64", "f32"}
        Type of literals and of real numbers whose type is not said.
    profile : bool
        Let Taichi time every kernel, for `ifrdem.validation.speed.profiler`. Without it, a Taichi that runs so already
        is kept, so that simulations can be made under the profiler; `stop` ends that.

    Raises
    ------
    InputError
        If architecture or precision are unknown, the device is not there, or there are not so many cores.
    """
    global _running
    check(arch, threads, precision)
    wanted = Running(arch, threads or min(cores(), _most_threads or cores()), precision, profile)
    import taichi as ti

    os.environ.pop("TI_ARCH", None)  # Taichi would follow it instead of what was asked for
    good_enough = (wanted, replace(wanted, profile=True))
    if _running is not None and _running in good_enough and ti.lang.impl.get_runtime().prog is not None:
        return _running
    _release_all()
    cache = _kernel_cache()
    with contextlib.redirect_stdout(io.StringIO()):  # Taichi announces itself on stdout, where results go
        ti.init(
            arch=getattr(ti, arch),
            default_fp=getattr(ti, precision),
            default_ip=ti.i32,
            fast_math=False,  # with it, contact times lose bits and collisions are missed
            cpu_max_num_threads=wanted.threads,
            offline_cache=True,
            offline_cache_file_path=cache,
            log_level=ti.WARN,
            enable_fallback=False,
            cfg_optimization=False,  # the same bits and speed, a quarter of the time to compile
            kernel_profiler=profile,
        )
    _running = wanted
    LOG.debug("device %s, %d threads, %s", arch, wanted.threads, precision)
    LOG.debug("kernel cache %s", cache)
    return wanted


def stop() -> None:
    """End Taichi, and with it every simulation of this process."""
    global _running
    if _running is not None:
        import taichi as ti

        _release_all()
        ti.reset()
        _running = None
