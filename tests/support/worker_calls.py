"""Calls of worker processes in tests of validation and of studies; a separate module, since they import it."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import time
from pathlib import Path

from ifrdem.cli import main as cli
from ifrdem.simulation import backend
from ifrdem.study.task import Task
from ifrdem.validation.report import runner
from ifrdem.validation.report.registry import Result, Row


def shout(name: str) -> tuple[str, int, int]:
    """The name, this process, and how many threads a kernel would get. The process ends if the name requests it."""
    if name.startswith("killed"):
        os.kill(os.getpid(), signal.SIGKILL)
    if name.startswith("left"):
        os._exit(3)
    if name.startswith("slow"):
        time.sleep(1.0)
    return name.upper(), os.getpid(), backend.start().threads if "threads" in name else 0


def case(name: str, *, quick: bool, seed: int, is_quiet: bool) -> runner.Verdict:
    """In place of `runner.run_case`: `energy` takes longest, `angles` kills its process."""
    if name == "angles":
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.5 if name == "energy" else 0.0)
    row = Row("length [m]", 1.0, 1.0, 0.1, "a guess", "a book")
    return runner.Verdict(name, f"{name}?", "a book", Result([row]))


class QuickTask(Task):
    """A run that does nothing; the one with the key "ends" ends its process, as compiling does if `path` asks."""

    def perform(self, threads: int = 1) -> str | None:
        if self.key == "ends":
            os._exit(7)
        return None

    def warm(self, threads: int = 1) -> None:
        if self.path == "ends":
            os._exit(7)


def quick_tasks(*keys: str, path: str = "") -> list[Task]:
    """Runs with these keys."""
    return [QuickTask(key, (0,), "", path, (), "", (), (), None, False, 1.0) for key in keys]


def endless(name: str, *, quick: bool, seed: int, is_quiet: bool) -> runner.Verdict:
    """In place of `runner.run_case`: leaves a file named after its process, and runs until it is killed."""
    (Path(os.environ["WORKERS"]) / str(os.getpid())).touch()
    while True:
        time.sleep(0.05)


if __name__ == "__main__":
    runner.run_case = importlib.import_module("support.worker_calls").endless  # by that name workers find it
    sys.exit(
        cli.main(["validate", "angles", "energy", "--jobs", "2", "-o", os.environ["WORKERS"] + "/report"])
    )
