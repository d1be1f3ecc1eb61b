"""Hazards of the kernels of a GPU, by NVIDIA's checker `compute-sanitizer` (a part of the CUDA toolkit).

`python -m ifrdem.validation.devices.races` is what it runs: a small gas with the features that blocks of threads have
code for.
"""

from __future__ import annotations

import shutil
import subprocess
import sys

from ...simulation import backend
from ..report.registry import Result, Skip
from . import bits

QUESTION = "Do threads of a GPU use the same memory at the same time, or memory that is not theirs?"
REFERENCE = "NVIDIA's compute-sanitizer"

CHECKER = "compute-sanitizer"
TOOLS = ("racecheck", "synccheck", "memcheck")
FOUND = 9  # its exit status if it finds something
DISKS = 1_500


def run(quick: bool) -> Result:
    """Run the checker's tools; the case is skipped without a GPU, or without the checker."""
    if (absence := backend.cuda_absence()) is not None:
        raise Skip(f"no GPU: {absence}")
    if (checker := shutil.which(CHECKER)) is None:
        raise Skip(f"no {CHECKER}: add the folder of the CUDA toolkit that has it to PATH")
    result = Result()
    for tool in TOOLS[:1] if quick else TOOLS:
        program = [sys.executable, "-m", __name__]
        done = subprocess.run([checker, "--tool", tool, f"--error-exitcode={FOUND}", *program], check=False)
        result.near(
            f"exit status of {tool}, which is {FOUND} after a hazard",
            done.returncode,
            0,
            0.0,
            "none",
            CHECKER,
        )
    return result


def main() -> None:
    """Run a gas between walls, under gravity, with forces and a ledger."""
    disks, box, state, law, more = bits.walled(DISKS)
    more |= bits.driven(2)[-1]
    bits.after((disks, box, state, law, more), 1.0, "cuda")


if __name__ == "__main__":
    main()
