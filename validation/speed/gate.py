"""Instructions of a collision against stored numbers: `python -m ifrdem.validation.speed.gate`.

Callgrind counts them, in one process and on one thread, while gases run that have reached their equilibrium: what
Python does around the kernels is in them, starts and compilers are not. They are the same within 0.2 % from run to run
(two runs, 2026-11-26) and whatever else the machine does, unlike times. They do not show cache misses and
mispredicted branches.

Exit status 1 if a gas needs more than the margin allows. `--store` replaces the stored numbers by those found: do that
in the commit of a change that is meant, and say why there.
"""

from __future__ import annotations

import ctypes
import json
import mmap
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
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

STORED = Path(__file__).with_name("instructions.json")
"""Instructions of a collision by the name and version of the runtime and by gas."""
MARGIN = 3.0
"""Instructions that a gas may need more than stored, in percent."""
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


def counted() -> dict[str, float]:
    """Instructions of a collision by gas. EngineError if callgrind, or the process that it runs, fails."""
    with tempfile.TemporaryDirectory(prefix="ifrdem-gate-") as folder:
        code = f"import {__package__}.gate as own; own.count({folder!r})"
        tool = ["--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={folder}/dump"]
        # First without valgrind, which takes ten minutes to compile what then is in the cache of kernels.
        for command in ([], ["valgrind", *tool]):
            done = subprocess.run(
                [*command, sys.executable, "-c", code],
                env={**os.environ, "PYTHONHASHSEED": "0"}, capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode != 0:
                last = (done.stderr.strip().splitlines() or ["without a message"])[-1]
                raise EngineError(
                    f"{' '.join([*command[:1], 'python'])} ended with {done.returncode}: {last}"
                )
        collisions = json.loads((Path(folder) / "collisions.json").read_text(encoding="utf-8"))
        return {
            name: instructions_in(Path(folder) / f"dump.{2 * number}") / collisions[name]
            for number, name in enumerate(collisions, start=1)
        }


def instructions_in(dump: Path) -> int:
    """All instructions in a dump of callgrind."""
    found = re.search(r"^(?:totals|summary): (\d+)", dump.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise EngineError(f"{dump.name}: no sum of instructions in this dump of callgrind")
    return int(found[1])


def compared(found: dict[str, float], stored: dict[str, float], margin: float) -> tuple[list[str], bool]:
    """Rows of a table of instructions found and stored, and whether all are within the margin [percent] or below."""
    rows, good = ["| gas | stored | now | change |", "|---|---|---|---|"], True
    for name, now in found.items():
        if name not in stored:
            rows.append(f"| {name} | | {now:,.0f} | not stored |")
            good = False
            continue
        change = 100.0 * (now / stored[name] - 1.0)
        worse = change > margin
        good &= not worse
        rows.append(f"| {name} | {stored[name]:,.0f} | {now:,.0f} | {change:+.1f} %{' TOO MANY' * worse} |")
    return rows, good


@validated
def gate(*, margin: Positive = MARGIN, store: bool = False) -> int:
    """Compare instructions of a collision with those stored for this runtime; more by `margin` percent fail.

    Parameters
    ----------
    margin : float
        What a gas may need more [percent].
    store : bool
        Replace the stored numbers by those found.
    """
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        raise InputError("must be run on Linux on x86-64, where valgrind counts instructions")
    if shutil.which("valgrind") is None:
        raise InputError("valgrind is not installed: apt install valgrind, or dnf install valgrind")
    of = f"{runtime.chosen()} {runtime.version(runtime.chosen())}"
    known = json.loads(STORED.read_text(encoding="utf-8"))
    if of not in known and not store:
        raise InputError(f"no numbers are stored for {of}: --store stores those of this run")
    found = counted()
    rows, good = compared(found, known.get(of, {}), margin)
    print("\n".join([f"Instructions of a collision, {of}:", "", *rows]), flush=True)
    if store:
        known[of] = {name: round(now) for name, now in found.items()}
        STORED.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
        return 0
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(script(gate))
