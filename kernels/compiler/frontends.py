"""Fast starts of quadrants: keys by which it finds the compiled program of a kernel without parsing the kernel.

To find a program in its cache, a runtime traces the kernel: it parses the kernel and its functions and builds the
compiler's representation of them, which takes more than half of a start. quadrants can look a program up by a key
instead, as it does for kernels declared with `fastcache=True`, which may use no constant of a module. Here the key is
made from everything that determines a kernel of this package: the sources of the package, the types of its arguments,
the features, and the options of the compiler. A kernel is traced if its key is unknown, with custom laws and forces, on
a GPU, and with versions of quadrants that this was not tested with.
"""

import functools
import hashlib
import os
import types
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

from . import runtime
from .language import on_gpu, ti
from ..layout import CompiledForce, Uses

_PACKAGE = __name__.rsplit(".", 2)[0]
_USED = runtime.chosen() == "quadrants" and runtime.is_known()


def source_files() -> Iterator[Traversable]:
    """The sources of this package, always in the same order."""
    folders = [files(_PACKAGE)]
    for folder in folders:
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
            if entry.name.endswith(".py"):
                yield entry
            elif entry.is_dir() and entry.name != "__pycache__":
                folders.append(entry)


@functools.cache
def _sources() -> str:
    """Hash of the sources of this package."""
    found = hashlib.sha256()
    for entry in source_files():
        found.update(f"{entry.name}\n".encode() + entry.read_bytes())
    return found.hexdigest()


def look_up(kernel: Any) -> None:
    """Make quadrants look up the program of a kernel of this package before it traces the kernel."""
    if _USED:
        primal = kernel._primal
        primal._try_load_fastcache = functools.partial(_load, primal)
        primal.visited_functions = _Sources()


class _Sources(set[Any]):
    """An empty set of functions whose sources quadrants has to check: their hash is in the key."""

    def add(self, _function: Any) -> None:
        pass


def _load(primal: Any, arguments: tuple[Any, ...], key: Any) -> set[str] | None:
    """Load the program of a kernel: the parameter names that quadrants stored with it, or None if there is none.

    It replaces a method of quadrants' `Kernel`. With a `fast_checksum`, quadrants stores the program that it compiles.
    """
    from quadrants.lang._fast_caching import src_hasher

    # There is no entry for the kernel alone, without arguments.
    primal._l1_key, primal._kernel_source_info_cached, primal._pruning_paths_from_l1 = "none", None, None
    primal.fast_checksum = _key(primal, arguments)
    found = primal.fast_checksum and src_hasher.load(primal.fast_checksum)
    if not found:
        return None
    program = ti.lang.impl.get_runtime().prog
    loaded = program.load_fast_cache(
        found.frontend_cache_key, primal.func.__name__, program.config(), program.get_device_caps()
    )
    if not loaded:
        return None
    primal.compiled_kernel_data_by_key[key] = loaded
    primal.used_py_dataclass_parameters_by_key_enforcing[key] = found.used_py_dataclass_parameters
    return set(found.used_py_dataclass_parameters)


def _key(primal: Any, arguments: tuple[Any, ...]) -> str | None:
    """Key of the program of a kernel for these arguments; None if it depends on sources outside this package."""
    from quadrants.lang._fast_caching import args_hasher, config_hasher

    if on_gpu() or os.environ.get("QD_KERNEL_COVERAGE"):
        return None
    parts = [
        ti.__version_str__, _sources(), primal.func.__module__, primal.func.__qualname__,
        config_hasher.hash_compile_config(), config_hasher.hash_device_caps(),
    ]  # fmt: skip
    for value, parameter in zip(arguments, primal.arg_metas, strict=True):
        if isinstance(value, Uses):
            names = [_name(each) for each in value.values()]
            if None in names:
                return None
            parts += map(str, names)
            continue
        kind = args_hasher.stringify_obj_type(False, (parameter.name,), value, parameter)
        if not isinstance(kind, str):
            return None
        parts.append(kind)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _name(value: Any) -> str | None:
    """Text that identifies a feature; None if it contains a function from outside this package."""
    if isinstance(value, CompiledForce):
        value = value.values()
    if isinstance(value, tuple):
        names = [_name(each) for each in value]
        return None if None in names else repr(names)
    function = getattr(value, "fn", value)
    if isinstance(function, types.FunctionType):
        return f"{function.__module__}.{function.__qualname__}" if _is_own(function) else None
    return repr(value)


def _is_own(function: types.FunctionType) -> bool:
    """True if a function is of a module of this package and uses no variable of an enclosing function."""
    return function.__module__.startswith(f"{_PACKAGE}.") and function.__closure__ is None
