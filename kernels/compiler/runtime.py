"""The runtime that compiles the kernels: Taichi, or quadrants, its successor, which compiles the same language.

A process has one runtime. It is chosen before the kernels are imported: by `choose` (the option `--runtime`, the key
`run.runtime` of a case), else by the variable IFRDEM_RUNTIME of the environment, else it is the first of `NAMES` that
is installed. This module imports neither.
"""

import contextlib
import functools
import importlib
import importlib.metadata
import os
import sys
import warnings
from collections.abc import Callable, Hashable, Mapping
from typing import Any

from ...errors import EngineError, InputError, nearest
from ...home import has_home
from . import start_patches

NAMES = ("taichi", "quadrants")
VARIABLE = "IFRDEM_RUNTIME"
_PREFIXES = {"taichi": "TI", "quadrants": "QD"}  # of variables of the environment, and of the caches' names
_FIRST_WITHOUT_TAICHI = (3, 14)

SAME_BITS = {("taichi", "1.7.4"), ("quadrants", "1.3.3"), ("quadrants", "1.4.0")}
"""Names and versions of runtimes that gave equal bits on a CPU (`tests/support/same_kernels.py`)."""

LISTENERS: list[Callable[[str], object]] = []
"""Called with the name of a kernel before it is compiled, or loaded from the cache."""
_announced: set[Hashable] = set()

_loaded: str | None = None


@functools.cache
def version(name: str) -> str | None:
    """Version of a runtime that is installed; None of one that is not."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _check(name: str, key: str) -> None:
    """Raise InputError unless this is the name of a runtime that is installed."""
    given = f"{key} {name}" if key.startswith("--") else f"{key} = '{name}'"
    if name not in NAMES:
        raise InputError(f"{given}: must be {' or '.join(NAMES)}{nearest(name, NAMES)}")
    if version(name) is None:
        raise InputError(f"{given}: {name} is not installed: {_remedy(name)}")


def _remedy(name: str) -> str:
    """Remedy where a runtime is not installed: the command that installs it, or the other one."""
    other = next(each for each in NAMES if each != name)
    instead = f"use {other}" if version(other) is not None else f"`pip install {other}`"
    if name == "taichi" and sys.version_info >= _FIRST_WITHOUT_TAICHI:
        return f"there is none for this Python: {instead}"
    return f"`pip install {name}`, or {instead}"


def chosen() -> str:
    """Name of the runtime of this process. InputError if the environment names none that is there."""
    if _loaded is not None:
        return _loaded
    if name := os.environ.get(VARIABLE):
        _check(name, VARIABLE)
        return name
    return next((name for name in NAMES if version(name) is not None), NAMES[0])


def check(name: str | None, key: str = "runtime") -> None:
    """Raise InputError, which names the `key`, if `choose` would."""
    if name is None:
        chosen()
        return
    _check(name, key)
    if _loaded not in (None, name):
        raise InputError(
            f"{key} = '{name}': must be '{_loaded}' in this process, whose kernels were imported with it: start "
            f"another process, with {VARIABLE}={name} in its environment"
        )


def choose(name: str | None, key: str = "runtime") -> None:
    """Choose the runtime of this process and of those that it starts; None leaves the choice to the environment.

    InputError, which names the `key` or the variable, if there is no such runtime, it is not installed, or kernels were
    imported with the other one.
    """
    check(name, key)
    if name is not None:
        os.environ[VARIABLE] = name


def is_loaded() -> bool:
    """True if this process has imported its runtime, which it cannot change any more."""
    return _loaded is not None


def of_versions(versions: Mapping[str, str]) -> tuple[str, str]:
    """Name and version of the runtime among versions of packages."""
    return next(((name, versions[name]) for name in NAMES if name in versions), ("no runtime", ""))


def variable(name: str) -> str:
    """Name of a variable of the environment that the runtime reads, such as OFFLINE_CACHE_FILE_PATH."""
    return f"{_PREFIXES[chosen()]}_{name}"


def cache_name() -> str:
    """Name that the runtime gives its folder of compiled kernels."""
    return f"{_PREFIXES[chosen()].lower()}cache"


def cache_lock() -> str:
    """Path, in the folder of compiled kernels, of the file that locks it."""
    return {"taichi": "ticache.lock", "quadrants": "kernel_compilation_manager/qdcache.lock"}[chosen()]


def describe() -> str:
    """The runtime and its version, and the other one if it is installed."""
    used = chosen()
    others = [f"{name} {version(name)}" for name in NAMES if name != used and version(name) is not None]
    return f"{used} {version(used)}" + "".join(f" (also installed: {other})" for other in others)


def have_same_bits(one: tuple[str, str], other: tuple[str, str], device: str) -> bool:
    """True if two runtimes, by name and version, are known to give the same bits on a device."""
    return one == other or (device == "cpu" and one in SAME_BITS and other in SAME_BITS)


def is_known() -> bool:
    """True if the chosen runtime is of a version that this program was tried with."""
    return (chosen(), version(chosen())) in SAME_BITS


def announce(name: str, key: Hashable) -> None:
    """Call the listeners with the name of a kernel, unless one with this key was announced before."""
    if key not in _announced:
        _announced.add(key)
        for listener in LISTENERS:
            listener(name)


def forget_announced() -> None:
    """Have all kernels announced again, after the end of the runtime."""
    _announced.clear()


def load() -> Any:
    """Import the chosen runtime, which stays that of the process."""
    global _loaded
    name = chosen()
    has_home()
    try:
        with (
            start_patches.short_import() if is_known() else contextlib.nullcontext(),
            warnings.catch_warnings(action="ignore", category=DeprecationWarning),  # of its own calls
        ):
            module = importlib.import_module(name)
    except ImportError as error:
        why = f"{name} cannot be loaded ({error})"
        if "X11" in str(error):
            why += ": it needs libX11, which small images of Linux lack: apt install libx11-6, or dnf install libX11"
        elif version(name) is None:
            why += f": {_remedy(name)}"
        raise EngineError(why) from error
    if is_known():
        start_patches.apply(module)
    _loaded = name
    return module
