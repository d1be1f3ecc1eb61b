"""Kernels of PTX text launched on the emulator, in this process, on arrays of NumPy."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

EMULATE = Path(__file__).with_name("emulate")
CAN_RUN = shutil.which("gcc") is not None and (sys.platform, platform.machine()) == ("linux", "x86_64")
NEEDS = "the emulator needs gcc, and Linux on x86-64"


@contextlib.contextmanager
def settings(values: dict[str, str]) -> Iterator[None]:
    """Environment variables, which the driver reads at each call."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class Device:
    """The stand-in for a driver, with one module of PTX; all its files are in `folder`."""

    def __init__(self, folder: Path, ptx: str) -> None:
        self.folder = folder
        own = {"EMULATE_DIR": str(folder), "EMULATOR_PYTHON": sys.executable}
        done = subprocess.run(
            [EMULATE, "env"], env=os.environ | own, capture_output=True, text=True, check=True
        )
        lines = [line.partition("=") for line in done.stdout.splitlines() if line.startswith("STUB_")]
        self.settings = own | {name: value for name, _, value in lines}
        self.driver = ctypes.CDLL(str(folder / "lib" / "libcuda.so.1"))
        self.module = ctypes.c_void_p()
        self.call("cuModuleLoadDataEx", ctypes.byref(self.module), ptx.encode(), 0, None, None)

    def call(self, name: str, *arguments: object, **more: str) -> None:
        with settings(self.settings | more):
            status = getattr(self.driver, name)(*arguments)
        assert status == 0, f"{name}: {status}"

    def launch(self, kernel: str, *arrays: np.ndarray, threads: int, blocks: int = 1, order: int = 0) -> None:
        """Run a kernel whose parameters are pointers to arrays; order is STUB_ORDER."""
        function = ctypes.c_void_p()
        self.call("cuModuleGetFunction", ctypes.byref(function), self.module, kernel.encode())
        addresses = [ctypes.c_uint64(each.ctypes.data) for each in arrays]
        given = (ctypes.c_void_p * len(arrays))(*(ctypes.addressof(each) for each in addresses))
        sizes = (blocks, 1, 1, threads, 1, 1)
        self.call("cuLaunchKernel", function, *sizes, 0, None, given, None, STUB_ORDER=str(order))
