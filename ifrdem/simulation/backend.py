"""Starting the runtime of the kernels on a device, and saying which devices there are."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import gc
import io
import logging
import os
import shutil
import signal
import tempfile
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

from ..errors import EngineError, InputError
from ..home import has_home
from ..kernels.compiler import runtime
from ..model.device import NAMES, Device
from ..mpi import current
from ..tools import files

MULTIPROCESSOR_COUNT = 16  # the driver's number of this attribute
GPU_LANES = 65536  # tiles that have scratch space at the same time
LOG = logging.getLogger("ifrdem")


@dataclass(frozen=True)
class DeviceInfo:
    """A device that kernels can run on: its name, and what it is."""

    name: str
    description: str


@dataclass(frozen=True)
class Running:
    """Options with which the runtime was started."""

    device: str
    threads: int
    precision: str = "f64"
    profile: bool = False


_running: Running | None = None
_process: int | None = None  # the one that started the runtime
_driver_queried = False  # the driver, for GPUs
_shown: str | None = None  # the GPU that `show_gpu` has chosen
_in_use = threading.RLock()
_most_threads: int | None = None


def cpu_name() -> str:
    """Name of the processor."""
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


def check_process() -> None:
    """Raise EngineError in a process that was forked after the runtime started: its threads are not in the copy."""
    if _process not in (None, os.getpid()):
        raise EngineError(
            "this process is a copy (fork) of one in which a simulation has started already, and the runtime's threads "
            'are not copied: a simulation here would wait for them for ever. Start processes by "spawn" instead: '
            'multiprocessing.get_context("spawn"), or ProcessPoolExecutor(mp_context=get_context("spawn"))'
        )


class sole_use(contextlib.ContextDecorator):
    """Keep the runtime to the present thread; a decorator too.

    EngineError if another thread uses it, or the process is a forked copy (`check_process`).
    """

    def __enter__(self) -> None:
        check_process()
        if not _in_use.acquire(blocking=False):
            raise EngineError(
                "another thread of this process is running a simulation: one thread at a time can, because a process "
                "has one runtime. Wait until it is done, or run each simulation in a process of its own: "
                'multiprocessing.get_context("spawn")'
            )

    def __exit__(self, *_: object) -> None:
        _in_use.release()


def can_be_used() -> bool:
    """True if `sole_use` would not raise an error."""
    if _process not in (None, os.getpid()) or not _in_use.acquire(blocking=False):
        return False
    _in_use.release()
    return True


_handling = False  # `_on_interrupt` is installed
_deferring = False  # a block of `deferred_interrupts` runs
_interrupted = False  # Ctrl-C was pressed in that block


def _on_interrupt(_number: int, _frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt; in a block of `deferred_interrupts` only note the first Ctrl-C, for its end."""
    global _interrupted
    if _interrupted or not _deferring:
        raise KeyboardInterrupt
    _interrupted = True


@contextlib.contextmanager
def handled_interrupts() -> Iterator[None]:
    """Install the handler for all blocks of `deferred_interrupts` in this one; that takes as long as a launch.

    Nothing is installed in a thread other than the main one, or where a handler other than Python's own is installed
    for SIGINT, such as that of the command `ifrdem run`.
    """
    global _handling
    usual = signal.default_int_handler
    if (
        _handling
        or threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not usual
    ):
        yield
        return
    signal.signal(signal.SIGINT, _on_interrupt)
    _handling = True
    try:
        yield
    finally:
        _handling = False
        present = signal.signal(signal.SIGINT, usual)
        if present is not _on_interrupt:  # a callback has installed another handler
            signal.signal(signal.SIGINT, present)


@contextlib.contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Delay Ctrl-C: raise KeyboardInterrupt at the end of the block, when the state of the gas is complete.

    A second Ctrl-C raises it at once. Nothing is delayed where `handled_interrupts` installs nothing.
    """
    global _deferring, _interrupted
    with handled_interrupts():
        _deferring, _interrupted = True, False
        try:
            yield
        finally:
            _deferring = False
    if _interrupted:
        raise KeyboardInterrupt


_asking: list[Callable[[], bool]] = []


@contextlib.contextmanager
def stops_asked_by(asked: Callable[[], bool]) -> Iterator[None]:
    """Ask for a stop where `asked()` is true, in the block: a gas in one tile stops within a long window then."""
    _asking.append(asked)
    try:
        yield
    finally:
        _asking.remove(asked)


def stop_is_asked() -> bool:
    """True if Ctrl-C is delayed, or something else asks for a stop (`stops_asked_by`)."""
    return (_deferring and _interrupted) or any(asked() for asked in _asking)


def limit_threads(most: int) -> None:
    """Have what is started from now on without a number of threads take so many at most: others share the cores."""
    global _most_threads
    _most_threads = most


def usual_threads() -> int:
    """Threads of what is started without a number of them."""
    return min(cores(), _most_threads or cores())


def memory_available() -> int | None:
    """Bytes of memory that a process could still take, or None if the system does not report it.

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


def show_gpu(number: int) -> None:
    """Have this process see one GPU only: of those that CUDA_VISIBLE_DEVICES names, in turn, or of all of the machine.

    `number` is that of a rank among those of its machine. Without that variable rank 2 gets GPU 2, or there is none for
    it: ranks share GPUs only if the user, or the batch system, names fewer GPUs. InputError if the driver,
    which looks at the variable once, has been asked before and shows another one.
    """
    global _shown
    if _shown is not None:
        return
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    entries = [str(number)] if named is None else [each.strip() for each in named.split(",")]
    visible = entries[number % len(entries)]
    if _driver_queried and visible != named:
        raise InputError(
            f"device = 'cuda': rank {number} of this machine is to see GPU {visible}, but it has queried GPUs "
            "before, and the driver looks once: set CUDA_VISIBLE_DEVICES for each rank, or make the gas that is on "
            "several ranks first"
        )
    os.environ["CUDA_VISIBLE_DEVICES"] = _shown = visible


def cuda_absence() -> str | None:
    """Reason why no GPU can be used through CUDA, with a way out; None if one can. Asks the driver itself."""
    global _driver_queried
    _driver_queried = True
    try:
        driver = ctypes.CDLL("libcuda.so")  # under this name the runtime opens it
    except OSError:
        try:
            ctypes.CDLL("libcuda.so.1")
        except OSError:
            return "no NVIDIA driver (libcuda.so)"
        return (
            f"the NVIDIA driver is here as libcuda.so.1 only, and {runtime.chosen()} opens libcuda.so: put a link of "
            "that name to it into a folder, and the folder into LD_LIBRARY_PATH"
        )
    failed = driver.cuInit(0)
    if failed:
        return (
            f"the NVIDIA driver finds no device that works (cuInit gives error {failed}){_gpu_of_rank_hint()}"
        )
    count = ctypes.c_int(0)
    failed = driver.cuDeviceGetCount(ctypes.byref(count))
    if failed or count.value < 1:
        visible = os.environ.get("CUDA_VISIBLE_DEVICES")
        return f"the NVIDIA driver has no device (CUDA_VISIBLE_DEVICES = {visible}){_gpu_of_rank_hint()}"
    from ..kernels.compiler.language import ti

    if not ti._lib.core.with_cuda():
        return f"{runtime.chosen()} cannot use this NVIDIA driver: it needs one for CUDA 10 or later"
    return None


def _gpu_of_rank_hint() -> str:
    """A remedy where each rank was to see another GPU."""
    if _shown is None:
        return ""
    return (
        f"; this rank was to have GPU {_shown}: start as many ranks on a machine as it has GPUs, or name those that "
        "ranks are to share in CUDA_VISIBLE_DEVICES"
    )


def _gpu() -> tuple[ctypes.CDLL, ctypes.c_int]:
    """The driver and its first device; there must be one (`cuda_absence`)."""
    driver, handle = ctypes.CDLL("libcuda.so"), ctypes.c_int(0)
    driver.cuInit(0)
    driver.cuDeviceGet(ctypes.byref(handle), 0)
    return driver, handle


def gpu_name() -> str:
    """Name of the GPU."""
    driver, handle = _gpu()
    name = ctypes.create_string_buffer(256)
    driver.cuDeviceGetName(name, 256, handle)
    return name.value.decode(errors="replace")


def gpu_blocks() -> int:
    """Blocks of threads that the GPU runs at the same time: two for each of its multiprocessors."""
    driver, handle = _gpu()
    count = ctypes.c_int(0)
    driver.cuDeviceGetAttribute(ctypes.byref(count), MULTIPROCESSOR_COUNT, handle)
    return 2 * max(count.value, 1)


def gpu_memory() -> int:
    """Bytes of memory of the GPU."""
    driver, handle = _gpu()
    memory = ctypes.c_size_t(0)
    driver.cuDeviceTotalMem_v2(ctypes.byref(memory), handle)
    return memory.value


def describe(name: str) -> DeviceInfo:
    """A device, which may be there or not."""
    if name == "cpu":
        return DeviceInfo(name, f"{cpu_name()}, {cores()} threads")
    if cuda_absence() is not None:
        return DeviceInfo(name, "NVIDIA GPU (CUDA)")
    return DeviceInfo(name, f"{gpu_name()} (CUDA)")


def available() -> list[DeviceInfo]:
    """The devices that a simulation can run on."""
    return [describe(name) for name in NAMES if name == "cpu" or cuda_absence() is None]


def check(device: Device | str) -> None:
    """Raise InputError unless the device and as many threads are there. Starts nothing."""
    device = Device.of(device)
    absence = cuda_absence() if device.name == "cuda" else None  # a run on the CPU asks no driver
    if absence is not None:
        raise InputError(
            f"device = '{device.name}': no such device on this machine; present: cpu (see `ifrdem devices`): {absence}"
        )
    # More threads than cores wait for each other at the end of every parallel loop.
    if device.threads is not None and device.threads > cores():
        raise InputError(f"threads = {device.threads}: must be from 1 to the {cores()} cores that are here")


def _usual_cache() -> Path:
    """Folder in which the runtime keeps compiled kernels."""
    usual = Path("~/.cache", runtime.chosen(), runtime.cache_name())
    return Path(os.environ.get(runtime.variable("OFFLINE_CACHE_FILE_PATH")) or usual.expanduser())


def kernel_cache_trouble() -> str | None:
    """Reason why compiled kernels cannot be kept for other processes, with a remedy; None if they can."""
    named = runtime.variable("OFFLINE_CACHE_FILE_PATH")
    again = f"every process compiles its kernels again; set {named} to a folder"
    if not (has_home() or os.environ.get(named)):
        return f"kernel cache: this user has no home folder: {again}"
    folder = _usual_cache()
    try:
        files.make_private(folder)
        if (others := files.writable_by_others(folder)) is not None:
            return (
                f"kernel cache {folder}: {others}, and kernels are code: it is not used, {again} of your own "
                "that no other user may write"
            )
        _remove_stale_lock(folder)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        reason = error.strerror or error
        return f"kernel cache {folder}: cannot be written to ({reason}): {again} that can be written to"
    return None


def _kernel_cache() -> str | None:
    """Folder of compiled kernels: the runtime's usual one, else a temporary one; None if neither can be written.

    Compiled kernels are code that this process executes: a folder that others may write is not used. The runtime itself
    crashes when it cannot write its cache.
    """
    if (trouble := kernel_cache_trouble()) is None:
        return str(_usual_cache())
    if trouble not in _warned:  # once
        _warned.add(trouble)
        warnings.warn(trouble, stacklevel=3)
    return _temporary_cache()


@functools.cache
def _temporary_cache() -> str | None:
    """A folder that is removed when this process ends; None if none can be made."""
    try:
        folder = tempfile.mkdtemp(prefix="ifrdem-kernels-")
    except OSError:
        return None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


_warned: set[str] = set()  # texts on kernel caches that were shown

STALE = 60.0
"""Seconds after which a lock of the kernel cache is that of a killed process; a runtime holds one for milliseconds."""


def _remove_stale_lock(folder: Path) -> None:
    """Remove a lock that a killed process left: with one there, the runtime neither reads nor writes its cache."""
    lock = folder / runtime.cache_lock()
    with contextlib.suppress(FileNotFoundError):  # there is none, or another process removed it
        if time.time() - lock.stat().st_mtime > STALE:
            lock.unlink()


_users: weakref.WeakSet[Any] = weakref.WeakSet()


def register(user: Any) -> None:
    """Have `user.release()`, which gives its arrays up, called before the runtime ends or restarts."""
    _users.add(user)


def lanes() -> int:
    """Tiles that the device runs at the same time."""
    assert _running is not None
    return _running.threads if _running.device == "cpu" else GPU_LANES


@contextlib.contextmanager
def announced(listener: Callable[[str], object]) -> Iterator[None]:
    """Call `listener` with the name of each kernel before it is compiled, or loaded from the cache, in the block."""
    runtime.LISTENERS.append(listener)
    try:
        yield
    finally:
        runtime.LISTENERS.remove(listener)


def free_array(array: Any) -> None:
    """Give the memory of an array back, also if it is still referred to; the array cannot be used any more.

    The runtime frees arrays of numbers when Python forgets them, and arrays of vectors only when it ends.
    """
    from ..kernels.compiler.language import program

    present = program()
    if present is not None and array.arr is not None:
        present.delete_ndarray(array.arr)
        array.arr = None


def _release_all() -> None:
    """Free every array of this runtime, which is about to end.

    One that Python forgot only later (a traceback can hold it for long) would take an array of the next start with
    it: the runtime knows arrays by their addresses, and a new array may have the address of an old one.
    """
    from ..kernels.compiler.language import ti

    for user in list(_users):
        user.release()
    _users.clear()
    for thing in gc.get_objects():
        if issubclass(type(thing), ti.Ndarray):  # isinstance would ask every proxy what it stands for
            free_array(thing)


def start(device: Device | str = "cpu", *, profile: bool = False) -> Running:
    """Start the runtime, or do nothing if it already runs with the same settings.

    There is one per process: starting it with other settings ends every simulation of the process so far.

    Parameters
    ----------
    device : Device or str
        A device that is not there is refused; there is no fall-back. Without threads those of all cores, or as many as
        `limit_threads` says. The precision is the type of literals and of real numbers whose type is not said.
    profile : bool
        Let the runtime time every kernel, for `ifrdem.validation.speed.bench`. Without it, one that runs so already
        is kept, so that simulations can be made under the profiler; `stop` ends that.

    InputError if the device is not there, or there are not so many cores;
    EngineError if the process is a forked copy of one that has started the runtime.
    """
    global _running, _process
    check_process()
    device = Device.of(device)
    check(device)
    threads = device.threads or usual_threads()
    settings = Running(device.name, threads, device.precision, profile)
    from ..kernels.compiler.language import program, ti

    os.environ.pop(runtime.variable("ARCH"), None)  # it would override the requested device
    good_enough = (settings, replace(settings, profile=True))
    if _running is not None and _running in good_enough and program() is not None:
        return _running
    if _running is not None:
        _release_all()
        runtime.forget_announced()
    cache = _kernel_cache()
    ti.set_logging_level(ti.ERROR)  # it would warn of variables of the environment that arguments override
    with contextlib.redirect_stdout(io.StringIO()):  # it announces itself on stdout, where results go
        ti.init(
            arch=getattr(ti, settings.device),
            default_fp=getattr(ti, settings.precision),
            default_ip=ti.i32,
            fast_math=False,  # with it, contact times lose bits and collisions are missed
            cpu_max_num_threads=settings.threads,
            offline_cache=cache is not None,
            offline_cache_file_path=cache or "",
            # Its warnings, as of a cache that another process writes, are raw lines that --quiet would not hide.
            log_level=ti.WARN if LOG.isEnabledFor(logging.DEBUG) else ti.ERROR,
            enable_fallback=False,
            unrolling_limit=0,  # no warning of its own copies of walls, which have 38 columns, to a GPU
            cfg_optimization=False,  # the same bits and speed, a quarter of the time to compile
            kernel_profiler=profile,
        )
    ti.lang.impl.get_runtime().materialize()  # only this thread can; the runtime would do it at the first kernel
    _running, _process = settings, os.getpid()
    LOG.debug("device %s, %d threads, %s", settings.device, settings.threads, settings.precision)
    LOG.debug("kernel cache %s", cache or "none")
    return settings


def start_unless_running(device: Device) -> Running:
    """Start the runtime as `start`, unless it runs already, with any settings."""
    if _running is not None and _process == os.getpid():
        from ..kernels.compiler.language import program

        if program() is not None:
            return _running
    return start(device)


def of_rank(device: Device) -> Device:
    """The device with this rank's share of the cores of its machine, unless it has threads; all ranks ask."""
    comm = current()
    if comm.size == 1:
        return device
    return replace(device, threads=device.threads or comm.share_of_cores(cores()))


def start_on_ranks(device: Device) -> None:
    """Start the runtime on all ranks: each with its share of the cores of its machine, and with a GPU of its own."""
    comm, device = current(), of_rank(device)
    if comm.size > 1 and device.name == "cuda":
        number = comm.local_rank
        comm.run_on_all(lambda: show_gpu(number))
    comm.run_on_all(lambda: start(device))


def stop() -> None:
    """End the runtime, and with it every simulation of this process."""
    global _running, _process
    if _running is not None:
        check_process()
        from ..kernels.compiler.language import ti

        _release_all()
        ti.reset()
        runtime.forget_announced()
        _running = _process = None
