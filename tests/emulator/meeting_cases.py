"""What threads of PTX give one another, by NumPy: cases for test_instructions.py."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np


class Atomic(NamedTuple):
    name: str  # without the opcode: `atom` and `red` do the same
    change: Callable[..., Any]  # of the cell, of %a and of %b

    @property
    def kind(self) -> str:
        return self.name.split(".")[1]


def atomics() -> Iterator[Atomic]:
    for kind in ("u32", "s32", "u64", "f32", "f64"):
        yield Atomic(f"add.{kind}", lambda cell, a, b: cell + a)
    for kind in ("u32", "s32", "u64", "s64"):
        yield Atomic(f"min.{kind}", lambda cell, a, b: min(cell, a))
        yield Atomic(f"max.{kind}", lambda cell, a, b: max(cell, a))
    for kind in ("b32", "b64"):
        yield Atomic(f"and.{kind}", lambda cell, a, b: cell & a)
        yield Atomic(f"or.{kind}", lambda cell, a, b: cell | a)
        yield Atomic(f"xor.{kind}", lambda cell, a, b: cell ^ a)
        yield Atomic(f"exch.{kind}", lambda cell, a, b: a)
        yield Atomic(f"cas.{kind}", lambda cell, a, b: b if cell == a else cell)


Lanes = np.ndarray
"""Of shape (warps, 32)."""


def shuffled(mode: str, a: Lanes, b: Lanes, c: int) -> tuple[Lanes, Lanes]:
    """`shfl` as the pseudocode of the PTX ISA has it, section 9.7.9.6: values, and whether they are of another lane."""
    segment, lane, b = c >> 8 & 31, np.arange(32), b.astype(np.int64) & 31
    last = lane & segment | c & 31 & ~segment
    j = {"up": lane - b, "down": lane + b, "bfly": lane ^ b, "idx": lane & segment | b & ~segment}[mode]
    ok = j >= last if mode == "up" else j <= last
    return np.take_along_axis(a, np.where(ok, j, lane), axis=1), ok


def ballot(p: Lanes) -> Lanes:
    return np.broadcast_to((p.astype(np.int64) << np.arange(32)).sum(axis=1, keepdims=True), p.shape)


def alike(a: Lanes) -> Lanes:
    return ((a[:, :, None] == a[:, None, :]).astype(np.int64) << np.arange(32)).sum(axis=2)


class Meeting(NamedTuple):
    """Instructions that make %d and %q of any %a and %b, of %p (whether %a is odd), and of the thread %n."""

    name: str
    body: str
    expected: Callable[[Lanes, Lanes, Lanes], tuple[Any, Any]]  # %d and %q of a block: of %a, %b, %p


def of_all(of_lane: np.ufunc) -> Callable[[Lanes, Lanes, Lanes], tuple[Any, Any]]:
    return lambda a, b, p: (0, of_lane.reduce(p, axis=1, keepdims=True))


def by_halves(p: Lanes) -> Lanes:
    """Ballots of the lower and of the upper 16 lanes of each warp."""
    upper = np.arange(32) >= 16
    return np.where(upper, ballot(p & upper), ballot(p & ~upper))


def meetings() -> Iterator[Meeting]:
    for mode, clamps in {
        "up": (0, 0x1800, 3), "down": (31, 0x181F, 20), "bfly": (31, 0x1C1F), "idx": (31, 0x181F, 20)
    }.items():  # fmt: skip
        for c in clamps:
            yield Meeting(
                f"shfl.sync.{mode}, clamp {c:#x}", f"shfl.sync.{mode}.b32 %d|%q, %a, %b, {c}, -1;",
                lambda a, b, p, m=mode, c=c: shuffled(m, a, b, c),
            )  # fmt: skip
    yield Meeting("vote.ballot", "vote.sync.ballot.b32 %d, %p, -1;", lambda a, b, p: (ballot(p), 0))
    yield Meeting("vote.ballot, !p", "vote.sync.ballot.b32 %d, !%p, -1;", lambda a, b, p: (ballot(~p), 0))
    for name, of_lane in (("all", np.logical_and), ("any", np.logical_or)):
        yield Meeting(f"vote.{name}", f"vote.sync.{name}.pred %q, %p, -1;", of_all(of_lane))
    yield Meeting(
        "vote.uni", "vote.sync.uni.pred %q, %p, -1;",
        lambda a, b, p: (0, (p == p[:, :1]).all(axis=1, keepdims=True)),
    )  # fmt: skip
    yield Meeting(
        "vote of literals", "vote.sync.all.pred %q, 1, -1; vote.sync.ballot.b32 %d, 0, -1;", lambda *_: (0, 1)
    )
    yield Meeting(
        "vote of half a warp",
        "and.b32 %t0, %n, 16; setp.ne.s32 %q, %t0, 0; @%q bra $UPPER;\n"
        "vote.sync.ballot.b32 %d, %p, 0x0000FFFF; bra $END;\n"
        "$UPPER: vote.sync.ballot.b32 %d, %p, 0xFFFF0000;\n$END: setp.ne.s32 %q, 0, 0;",
        lambda a, b, p: (by_halves(p), 0),
    )  # fmt: skip
    yield Meeting(
        "match.any", "and.b32 %t0, %b, 3; match.any.sync.b32 %d, %t0, -1;", lambda a, b, p: (alike(b & 3), 0)
    )
    yield Meeting(
        "match.all", "match.all.sync.b32 %d|%q, %t1, -1;",
        # %t1 is the number of the warp, but of the last warp that of the thread.
        lambda a, b, p: (np.where(np.arange(len(a))[:, None] < len(a) - 1, 2**32 - 1, 0),
                         np.where(np.arange(len(a))[:, None] < len(a) - 1, 1, 0)),
    )  # fmt: skip
    store = "mov.u64 %l0, of_block; mul.wide.u32 %l1, %n, 4; add.s64 %l1, %l0, %l1; st.shared.u32 [%l1], %a;"
    for name in ("bar.sync", "barrier.sync"):
        yield Meeting(
            name,
            f"{store} {name} 0; sub.s32 %t0, 63, %n; mul.wide.u32 %l1, %t0, 4; add.s64 %l1, %l0, %l1;"
            "ld.shared.u32 %d, [%l1];",
            lambda a, b, p: (a[::-1, ::-1], 0),
        )  # fmt: skip
    yield Meeting(
        "bar.warp.sync",
        f"{store} bar.warp.sync -1; xor.b32 %t0, %n, 1; mul.wide.u32 %l1, %t0, 4; add.s64 %l1, %l0, %l1;"
        "ld.shared.u32 %d, [%l1];",
        lambda a, b, p: (a[:, np.arange(32) ^ 1], 0),
    )  # fmt: skip
    yield Meeting("bar.red.popc", "bar.red.popc.u32 %d, 0, %p;", lambda a, b, p: (p.sum(), 0))
    yield Meeting("bar.red.popc, !p", "bar.red.popc.u32 %d, 0, !%p;", lambda a, b, p: ((~p).sum(), 0))
    yield Meeting("bar.red.and", "bar.red.and.pred %q, 0, %p;", lambda a, b, p: (0, p.all()))
    yield Meeting("bar.red.or", "bar.red.or.pred %q, 0, %p;", lambda a, b, p: (0, p.any()))
    yield Meeting(
        "bar.sync of threads that have not ended",
        "setp.ge.u32 %q, %n, 40; @%q bra $END;\nbar.red.popc.u32 %d, 0, %p;\n$END: setp.ne.s32 %q, 0, 0;",
        lambda a, b, p: (np.where(np.arange(64).reshape(2, 32) < 40, p.ravel()[:40].sum(), 0), 0),
    )  # fmt: skip
