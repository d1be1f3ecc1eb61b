"""Seconds of a start in a fresh process, kernels cold and warm: `python -m ifrdem.validation.speed.start --n 1000`.

Cold is the folder of compiled kernels alone: the files of Python and its libraries may be in the system's memory.
"processor" is the processor time until then, of all threads.
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ...errors import EngineError
from ...kernels.compiler import runtime
from ...tools.arguments import script

# What else is imported is imported where it is needed: a process that is timed imports what a command does.


def start(
    *, n: int = 10_000, threads: int | None = None, device: str = "cpu", precision: str = "f64"
) -> None:
    """Print seconds, cold and warm: of imports, to the first window and to the last kernel of an elastic gas, and to
    the first progress of `ifrdem run`."""
    from ...case import template

    flags = ["--device", device, "--precision", precision, *(["--threads", str(threads)] if threads else [])]
    with tempfile.TemporaryDirectory(prefix="ifrdem-start-") as folder:
        path = Path(folder) / "cooling.toml"
        path.write_text(template.write("cooling"), encoding="utf-8")
        run = [
            "run",
            str(path),
            "--set",
            f"species[0].number={n}",
            "-o",
            folder,
            "--force",
            "--no-picture",
            *flags,
        ]
        gas = [json.dumps({"n": n, "phi": 0.3, "threads": threads, "device": device, "precision": precision})]
        for function, arguments in (("start_a_gas", gas), ("start_a_run", run)):
            for kernels in ("cold", "warm"):
                found = _in_a_process(function, f"{folder}/{function}", arguments)
                print(f"{function}, kernels {kernels}: {json.dumps(found)}", flush=True)


def _in_a_process(function: str, cache: str, arguments: list[str]) -> dict[str, float]:
    """The seconds that a function below prints when a fresh process calls it."""
    code = f"import sys, {__package__}.start as own; own.{function}(float(sys.argv[1]), sys.argv[2:])"
    environment = {**os.environ, runtime.variable("OFFLINE_CACHE_FILE_PATH"): cache}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # files of Python are compiled once, as usual
    # The monotonic clock is one for all processes.
    command = [sys.executable, "-c", code, repr(time.monotonic()), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    lines = done.stdout.splitlines()
    if done.returncode != 0 or not lines:
        last = (done.stderr.strip().splitlines() or ["without a message"])[-1]
        raise EngineError(f"a fresh process that was to be timed ended with {done.returncode}: {last}")
    found: dict[str, float] = json.loads(lines[-1])
    return found


def start_a_gas(began: float, arguments: list[str]) -> None:
    """In a process of its own: run an elastic gas for a mean free time, by which every usual kernel has run."""
    from ...case.gas import CaseGas
    from ...kernels.compiler.language import ti  # noqa: F401
    from . import bench

    imports = time.monotonic() - began
    case = bench.elastic_gas(**json.loads(arguments[0]))
    gas = CaseGas.from_case(case)
    windows: list[float] = []
    gas.simulation().run(
        t_end=bench.mean_free_time(gas), progress=lambda *_: windows.append(time.monotonic() - began)
    )
    print(
        json.dumps({"imports": imports, "first_window": windows[0], "all_kernels": windows[-1]}), flush=True
    )


def start_a_run(began: float, arguments: list[str]) -> None:
    """In a process of its own: `ifrdem run` until it shows progress."""
    from ...tools import progress

    class FirstCall(progress.Progress):
        def __call__(self, *_: object) -> None:
            seconds = {"first_progress": time.monotonic() - began, "processor": time.process_time()}
            print(json.dumps(seconds), flush=True)
            raise KeyboardInterrupt

    progress.Progress = FirstCall  # type: ignore[misc]
    sys.argv = ["ifrdem", *arguments]
    try:
        runpy.run_module("ifrdem", run_name="__main__")
    except SystemExit as end:
        sys.exit(0 if end.code == 130 else 1)  # interrupted


if __name__ == "__main__":
    sys.exit(script(start))
