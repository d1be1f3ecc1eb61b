"""How long it takes to start: in fresh processes, with an empty folder for compiled kernels and with a filled one.

Only the folder is cold: the files of Python, Taichi and their libraries may well be in the system's memory.
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import EngineError

MOST = 20_000
"""Disks of the gas that is started: enough for the kernels that large gases use, too few to take time itself."""


@dataclass(frozen=True)
class StartTimes:
    """Seconds of one start.

    Attributes
    ----------
    imports : float
        Imports of Python modules.
    first_epoch : float
        From the start of the process, imports included, until its first epoch is done.
    all_kernels : float
        From the start of the process until a mean free time is done: by then every usual kernel has run.
    """

    imports: float
    first_epoch: float
    all_kernels: float


@dataclass(frozen=True)
class CompileTimes:
    """The start without compiled kernels, and the next one, which finds them."""

    cold: StartTimes
    warm: StartTimes


def measure(n: int, phi: float, *, arch: str, threads: int | None, precision: str) -> CompileTimes:
    """Time the start of an elastic gas of at most `MOST` disks, twice.

    Raises
    ------
    EngineError
        If a process fails; the message is the last line that it left.
    """
    job = {"n": min(n, MOST), "phi": phi, "arch": arch, "threads": threads, "precision": precision}
    with tempfile.TemporaryDirectory(prefix="ifrdem-bench-") as folder:
        cold, warm = (StartTimes(**_in_a_process("start_a_gas", folder, [json.dumps(job)])) for _ in range(2))
    return CompileTimes(cold, warm)


def measure_run(n: int, *, arch: str, threads: int | None, precision: str) -> tuple[float, float]:
    """Seconds from the start of `ifrdem run` until its first call for progress, cold and warm.

    It runs the case of `ifrdem new cooling` with n disks.
    """
    from ...case import template

    with tempfile.TemporaryDirectory(prefix="ifrdem-bench-") as folder:
        case = Path(folder) / "cooling.toml"
        case.write_text(template.write("cooling"), encoding="utf-8")
        arguments = ["run", str(case), "--set", f"species[0].number={n}", "-o", folder, "--force"]
        arguments += ["--arch", arch, "--precision", precision]
        arguments += ["--threads", str(threads)] if threads is not None else []
        cold, warm = (_in_a_process("start_a_run", folder, arguments)["seconds"] for _ in range(2))
    return cold, warm


def _in_a_process(function: str, cache: str, arguments: Sequence[str]) -> dict[str, Any]:
    """What a function below prints when a fresh process calls it."""
    code = f"import sys, {__name__} as own; own.{function}(float(sys.argv[1]), sys.argv[2:])"
    environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": cache}
    # The monotonic clock is one for all processes.
    command = [sys.executable, "-c", code, repr(time.monotonic()), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    lines = done.stdout.splitlines()
    if done.returncode != 0 or not lines:
        said = done.stderr.strip().splitlines() or ["nothing was said"]
        raise EngineError(f"a fresh process that was to be timed ended with {done.returncode}: {said[-1]}")
    answer: dict[str, Any] = json.loads(lines[-1])
    return answer


def start_a_gas(began: float, arguments: Sequence[str]) -> None:
    """In a process of its own: run a gas for a mean free time, and print the seconds that it took."""
    import_began = time.monotonic()
    import taichi  # noqa: F401

    from ...case.gas import Gas
    from ...simulation import simulation  # noqa: F401
    from . import equilibrium

    imports = time.monotonic() - import_began
    job = json.loads(arguments[0])
    case = equilibrium.elastic_gas(job.pop("n"), job.pop("phi"), **job)
    gas = Gas.from_case(case)
    epochs: list[float] = []
    gas.simulation(case).run(
        t_end=equilibrium.mean_free_time(gas), progress=lambda *_: epochs.append(time.monotonic() - began)
    )
    print(json.dumps({"imports": imports, "first_epoch": epochs[0], "all_kernels": epochs[-1]}), flush=True)


def start_a_run(began: float, arguments: Sequence[str]) -> None:
    """In a process of its own: do what `ifrdem` does until it shows progress; print the seconds until then."""
    from ...run import progress

    class FirstCall(progress.Progress):
        def __call__(self, *_: object) -> None:
            print(json.dumps({"seconds": time.monotonic() - began}), flush=True)
            raise KeyboardInterrupt

    progress.Progress = FirstCall  # type: ignore[misc]
    sys.argv = ["ifrdem", *arguments]
    try:
        runpy.run_module("ifrdem", run_name="__main__")
    except SystemExit as end:
        sys.exit(0 if end.code == 130 else 1)  # interrupted
