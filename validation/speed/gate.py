"""Instructions of a collision at two commits: `python -m ifrdem.validation.speed.gate BEFORE [AFTER]`.

Callgrind counts them, in one process and on one thread, while gases run that have reached their equilibrium: what
Python does around the kernels is in them, starts and compilers are not. They are the same within 0.2 % from run to run
(two runs, 2026-11-26) and whatever else the machine does, unlike times. They do not show cache misses and
mispredicted branches.

Exit status 1 if a gas needs more than the margin allows. Both commits are counted on this machine: on two processors
the compiler's code, and so the number of its instructions, differs by up to 7 %.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import json
import mmap
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...case.case import CaseSections
from ...case.gas import CaseGas
from ...errors import EngineError, InputError
from ...kernels.compiler import runtime
from ...simulation.simulation import Simulation
from ...tools.arguments import script
from ...tools.checked import Positive, validated
from . import bench
from .table import coins, two_sizes, with_ledger

MARGIN = 3.0
"""Instructions that a gas may need more than before, in percent."""
BURST = 8
"""Windows in one launch at most, so that the last launch does not have most of the collisions."""
WARM = 5.0
"""Collisions per disk before those that are counted."""


def gases() -> dict[str, tuple[CaseSections, float]]:
    """Cases by name, and collisions per disk that are counted of each, at least."""
    alone: dict[str, Any] = {"threads": 1}
    return {
        "elastic, N = 1e3, phi = 0.3": (bench.elastic_gas(1_000, 0.3, **alone), 40.0),
        "elastic, N = 1e4, phi = 0.3": (bench.elastic_gas(10_000, 0.3, **alone), 4.0),
        "elastic, N = 1e3, phi = 1e-3": (bench.elastic_gas(1_000, 1e-3, **alone), 10.0),
        "two sizes 1 : 10 of equal areas, N = 2e3, phi = 0.5": (two_sizes(2_000, 0.5, **alone), 10.0),
        "coins with the energy ledger, N = 4e4, phi = 0.3, in tiles": (
            with_ledger(coins(40_000, 0.3, device="cpu", **alone)),
            2.0,
        ),
    }


# Client requests of valgrind (callgrind.h): a sequence of instructions that does nothing, and means
# something to valgrind. The registers get the address of the request and its arguments, and the answer.
_REQUEST = bytes.fromhex("4889f8 31d2 48c1c703 48c1c70d 48c1c73d 48c1c733 4887db 4889d0 c3")
_DUMP, _START, _STOP = 0x43540000, 0x43540004, 0x43540005


class Callgrind:
    """Callgrind from within a process that it runs, on x86-64; without it, requests have no effect."""

    def __init__(self) -> None:
        self._code = mmap.mmap(-1, len(_REQUEST), prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
        self._code.write(_REQUEST)
        address = ctypes.addressof(ctypes.c_char.from_buffer(self._code))
        self._call = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_void_p)(address)

    def request(self, number: int) -> int:
        """Make a request; the answer is 0 without valgrind."""
        arguments = (ctypes.c_uint64 * 6)(number)
        return int(self._call(ctypes.addressof(arguments)))


def count(folder: str) -> None:
    """Run each gas, with a dump before and after what is counted of it; write down its collisions.

    It runs twice: alone, which compiles the kernels, and in a process of callgrind.
    """
    callgrind, collisions = Callgrind(), {}
    for name, (case, per_disk) in gases().items():
        gas = CaseGas.from_case(case).simulation()
        gas._engine.arrays.burst = min(BURST, gas._engine.arrays.burst)
        gas.run(collisions_per_disk=WARM)
        collisions[name] = _count(callgrind, gas, per_disk)
    (Path(folder) / "collisions.json").write_text(json.dumps(collisions), encoding="utf-8")


def _count(callgrind: Callgrind, gas: Simulation, per_disk: float) -> int:
    """Run some collisions per disk between two dumps; the number of collisions.

    From the end of a window to that of another one: a run that ended within a window would leave part of its work to
    the next run, or take it from the one before.
    """
    begin: int | None = None
    end = 0

    def after_window(_time: float, collisions: int) -> None:
        nonlocal begin, end
        if begin is None:
            begin = collisions
            callgrind.request(_START)
            callgrind.request(_DUMP)  # the next dump has what comes after this one
        elif not end and collisions >= begin + 0.5 * per_disk * gas.disks.n:
            callgrind.request(_DUMP)
            callgrind.request(_STOP)
            end = collisions
            gas.stop()

    gas.run_for(collisions_per_disk=100.0 * (WARM + per_disk), progress=after_window)
    assert begin is not None
    return end - begin


def counted(tree: Path) -> dict[str, float]:
    """Instructions of a collision by gas, with the code of a tree.

    EngineError if callgrind, or the process that it runs, fails.
    """
    with tempfile.TemporaryDirectory(prefix="ifrdem-gate-") as folder:
        code = f"import {__package__}.gate as own; own.count({folder!r})"
        tool = ["--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={folder}/dump"]
        # First without valgrind, which takes ten minutes to compile what then is in the cache of kernels.
        for command in ([], ["valgrind", *tool]):
            done = subprocess.run(
                [*command, sys.executable, "-c", code],
                env={**os.environ, "PYTHONHASHSEED": "0", "PYTHONPATH": str(tree)},
                cwd=folder, capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode != 0:
                last = (done.stderr.strip().splitlines() or ["without a message"])[-1]
                raise EngineError(
                    f"{tree}: {' '.join([*command[:1], 'python'])} ended with {done.returncode}: {last}"
                )
        collisions = json.loads((Path(folder) / "collisions.json").read_text(encoding="utf-8"))
        return {
            name: instructions_in(Path(folder) / f"dump.{2 * number}") / collisions[name]
            for number, name in enumerate(collisions, start=1)
        }


@contextlib.contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """A temporary folder with the files of a commit of this repository. InputError if there is none of that name."""
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        ["git", "archive", "--format=tar", f"{commit}^{{commit}}"], cwd=root, capture_output=True, check=False
    )
    if done.returncode != 0:
        raise InputError(f"{commit}: must be a commit of {root} ({done.stderr.decode().strip()})")
    with tempfile.TemporaryDirectory(prefix="ifrdem-gate-") as folder:
        with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
            archive.extractall(folder, filter="data")
        yield Path(folder)


def instructions_in(dump: Path) -> int:
    """All instructions in a dump of callgrind."""
    found = re.search(r"^(?:totals|summary): (\d+)", dump.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise EngineError(f"{dump.name}: no sum of instructions in this dump of callgrind")
    return int(found[1])


def compared(before: dict[str, float], after: dict[str, float], margin: float) -> tuple[list[str], bool]:
    """Rows of a table of instructions at two commits, and whether all are within the margin [percent] or below.

    A gas that only one of them has is shown, and judges nothing.
    """
    rows, good = ["| gas | before | after | change |", "|---|---|---|---|"], True
    for name in {**before, **after}:
        old, new = before.get(name), after.get(name)
        if old is None or new is None:
            numbers = (" " if each is None else f" {each:,.0f} " for each in (old, new))
            rows.append(f"| {name} |{'|'.join(numbers)}| |")
            continue
        change = 100.0 * (new / old - 1.0)
        worse = change > margin
        good &= not worse
        rows.append(f"| {name} | {old:,.0f} | {new:,.0f} | {change:+.1f} %{' TOO MANY' * worse} |")
    return rows, good


@validated
def gate(before: str, after: str | None = None, *, margin: Positive = MARGIN) -> int:
    """Compare instructions of a collision at a commit with those at another one; more by `margin` percent fail.

    Parameters
    ----------
    before : str
        Commit that is compared with.
    after : str
        Commit that is judged; the working tree if none is named.
    margin : float
        What a gas may need more [percent].
    """
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        raise InputError("must be run on Linux on x86-64, where valgrind counts instructions")
    if shutil.which("valgrind") is None:
        raise InputError("valgrind is not installed: apt install valgrind, or dnf install valgrind")
    with contextlib.ExitStack() as stack:
        old = stack.enter_context(checked_out(before))
        new = (
            Path(__file__).resolve().parents[2] if after is None else stack.enter_context(checked_out(after))
        )
        rows, good = compared(counted(old), counted(new), margin)
    print(
        "\n".join(
            [
                f"Instructions of a collision, {runtime.chosen()} {runtime.version(runtime.chosen())}:",
                "",
                *rows,
            ]
        ),
        flush=True,
    )
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(script(gate))
