"""Estimates of the cycles that a GPU takes for basic blocks of PTX (STUB_WARP)."""

from __future__ import annotations

import re

from .ptx_types import split_operands

CLASSES = ("int", "f64", "div", "lds", "sts", "ldg", "stg", "atoms", "atomg", "meet", "branch")
CYCLES = dict(zip(CLASSES, (5, 9, 160, 29, 4, 36, 4, 60, 300, 26, 10), strict=True))
"""Cycles until what an instruction gives can be used (H100; loads hit the L1)."""
FROM_L2 = 250
"""Cycles of loads that only the L2 has."""
MEETINGS = ("bar", "barrier", "shfl", "vote", "match")
"""Opcodes at which threads meet."""


def class_of(instruction: str) -> str | None:
    """Class of an instruction, None of those that mostly go away when a GPU's own code is made."""
    name, *_ = [*re.sub(r"^@!?%\w+\s+", "", instruction.strip()).split(), ""]
    opcode, *rest = parts = name.split(".")
    if opcode in MEETINGS:
        return "meet"
    if opcode in ("bra", "ret", "exit", "call"):
        return "branch"
    if opcode in ("div", "sqrt", "rcp", "rsqrt", "rem") and parts[-1] in ("f64", "s64", "u64", "s32", "u32"):
        return "div"
    if opcode in ("atom", "red"):
        return "atoms" if "shared" in rest else "atomg"
    if opcode in ("ld", "ldu"):
        return None if "param" in rest else "lds" if "shared" in rest else "ldg"
    if opcode == "st":
        return None if "param" in rest else "sts" if "shared" in rest else "stg"
    if opcode in ("mov", "cvta"):
        return None
    return "f64" if "f64" in rest else "int"


def overlapped(block: list[str]) -> int:
    """Cycles of a basic block whose instructions wait only for their operands, and loads for earlier stores to begin.

    A store may write what a later load reads, so no compiler exchanges them.
    """
    ready, stored, end = dict[str, int](), 0, 0
    for instruction in block:
        kind = class_of(instruction)
        condition, name, rest = re.match(r"(?:@!?(%\w+)\s+)?(\S+)\s*(.*)", instruction, re.S).groups()
        operands = split_operands(rest)
        gives_none = kind in ("sts", "stg", "branch") or name.split(".")[0] == "red" or not operands
        results = [] if gives_none else re.findall(r"%\w+", operands[0])
        needed = re.findall(r"%\w+", " ".join(operands[0 if gives_none else 1 :]))
        begin = max(
            (ready.get(each, 0) for each in [*needed, *([condition] if condition else [])]), default=0
        )
        if kind in ("lds", "ldg", "atoms", "atomg", "meet"):
            begin = max(begin, stored)
        if kind in ("meet", "branch"):
            begin = max(begin, end)
        if kind in ("sts", "stg", "atoms", "atomg", "meet"):
            stored = max(stored, begin)
        done = begin + (0 if kind is None else FROM_L2 if kind == "ldg" else CYCLES[kind])
        ready.update(dict.fromkeys(results, done))
        end = max(end, done)
    return end
