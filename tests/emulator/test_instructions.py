"""Each instruction that the emulator knows, in a kernel of a few lines, against exact integers and NumPy.

Expected values follow the PTX ISA 8.5, section 9.7. Integers are those of Python, without bounds, of which the low
bits are compared.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from emulator.device import CAN_RUN, NEEDS, Device
from emulator.instructions import TABLE
from emulator.ptx_types import C_TYPES

HEAD = ".version 7.8\n.target sm_90\n.address_size 64\n"
SCRATCH = ".reg .pred %p, %q; .reg .b16 %h<4>; .reg .b32 %t<6>; .reg .b64 %l<4>; .reg .f32 %f<2>; .reg .f64 %g<2>;"


class Case(NamedTuple):
    """Instructions that make %d of %a, %b, ...; of what types; and the value that they shall give."""

    name: str
    types: str  # of %a, %b, ...; and of %d
    expected: Callable[..., Any]  # of one number each
    body: str = ""  # if it is not the instruction `name` alone
    within: Callable[..., bool] = lambda *_: True  # where PTX says what the result is
    ulps: int = 0  # by which floating-point numbers may differ

    @property
    def inputs(self) -> list[str]:
        return self.types.split("->")[0].split()

    @property
    def output(self) -> str:
        return self.types.split("->")[1].strip()


def bits(kind: str) -> int:
    return int(kind[1:])


def dtype(kind: str) -> np.dtype:
    """Type of NumPy; a predicate is stored as a 32-bit number."""
    if kind == "pred":
        return np.dtype(np.uint32)
    return np.dtype({"f": "f", "s": "i", "u": "u", "b": "u"}[kind[0]] + str(bits(kind) // 8))


def signed(value: int, n: int) -> int:
    """The low n bits as a signed number."""
    value %= 1 << n
    return value - (1 << n) if value >> (n - 1) else value


def truncated(a: int, b: int) -> int:
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


def divisible(a: int, b: int) -> bool:
    return b != 0 and (a, b) not in ((-(2**31), -1), (-(2**63), -1))


def funnel(a: int, b: int, s: int, *, left: bool) -> int:
    both = b << 32 | a
    return both << s >> 32 if left else both >> s


def field(a: int, at: int, n: int, kind: str) -> int:
    """`bfe`: n bits from `at` on; beyond the top there are zeros, of signed numbers the sign of the field's last bit."""
    at, n, top = at & 255, n & 255, bits(kind) - 1
    found = [(a >> i) & 1 if i <= top else 0 for i in range(at, at + n)]
    if kind[0] == "u":
        return sum(bit << i for i, bit in enumerate(found))
    sign = 0 if n == 0 else (a >> min(at + n - 1, top)) & 1
    return sum((found[i] if i < n and at + i <= top else sign) << i for i in range(bits(kind)))


def inserted(a: int, b: int, at: int, n: int, size: int) -> int:
    at, n = at & 255, n & 255
    mask = sum(1 << i for i in range(at, min(at + n, size)))
    return b & ~mask | (a << at) & mask


def rounded(value: Any, how: str) -> Any:
    return {"rmi": np.floor, "rpi": np.ceil, "rni": np.rint, "rzi": np.trunc}[how](value)


def to_integer(value: Any, how: str, to: str, of: str) -> int:
    """`cvt` to an integer: beyond its range the nearest one. NaN gives 0, but of 64 bits the top bit alone."""
    n = bits(to)
    least, most = (-(1 << n - 1), (1 << n - 1) - 1) if to[0] == "s" else (0, (1 << n) - 1)
    if np.isnan(value):
        return 1 << n - 1 if of == "f64" or n == 64 else 0
    if np.isinf(value):
        return most if value > 0 else least
    return min(max(int(rounded(value, how)), least), most)


def fused(a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""
    if not np.isfinite([a, b, c]).all():
        return type(a)(np.longdouble(a) * np.longdouble(b) + np.longdouble(c))
    exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
    if exact == 0:
        return a * b + c  # with the sign of zero
    try:
        return np.float64(float(exact))
    except OverflowError:
        return np.float64(np.inf if exact > 0 else -np.inf)


def least(a: Any, b: Any, pick: Any) -> Any:
    """The one number if the other is NaN."""
    return b if np.isnan(a) else a if np.isnan(b) else pick(a, b)


def within_range(*values: Any) -> bool:
    """Not so large that the sine is one of its reduction."""
    return all(abs(value) < 1e4 for value in values)


SIGNS = {
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "gt": lambda a, b: a > b,
    "ge": lambda a, b: a >= b,
}
UNSIGNED_WORDS = {"lo": "lt", "ls": "le", "hi": "gt", "hs": "ge"}


def comparisons() -> Iterator[Case]:
    def either_nan(a: Any, b: Any) -> bool:
        return bool(np.isnan(a) or np.isnan(b))

    for kind in ("s16", "u16", "s32", "u32", "s64", "u64"):
        for name, sign in SIGNS.items():
            yield Case(f"setp.{name}.{kind}", f"{kind} {kind} -> pred", sign)
    yield from (
        Case(f"setp.{name}.{kind}", f"{kind} {kind} -> pred", SIGNS[same])
        for name, same in UNSIGNED_WORDS.items() for kind in ("u32", "u64")
    )  # fmt: skip
    for kind in ("b16", "b32", "b64"):
        yield Case(f"setp.eq.{kind}", f"{kind} {kind} -> pred", SIGNS["eq"])
        yield Case(f"setp.ne.{kind}", f"{kind} {kind} -> pred", SIGNS["ne"])
    for kind in ("f32", "f64"):
        types = f"{kind} {kind} -> pred"
        for name, sign in SIGNS.items():
            yield Case(f"setp.{name}.{kind}", types, lambda a, b, s=sign: not either_nan(a, b) and s(a, b))
            yield Case(f"setp.{name}u.{kind}", types, lambda a, b, s=sign: either_nan(a, b) or s(a, b))
        yield Case(f"setp.nan.{kind}", types, either_nan)
        yield Case(f"setp.num.{kind}", types, lambda a, b: not either_nan(a, b))
    for name, join in (("and", min), ("or", max), ("xor", lambda p, q: p != q)):
        for no in ("", "!"):
            body = f"setp.{name.join(('lt.', '.s32'))} %p, %a, %b, {no}%c; selp.u32 %d, 1, 0, %p;"
            yield Case(
                f"setp.lt.{name}.s32 {no}", "s32 s32 pred -> u32",
                lambda a, b, c, j=join, n=bool(no): int(j(a < b, bool(c) != n)), body,
            )  # fmt: skip


def integers() -> Iterator[Case]:
    for kind in ("s16", "u16", "s32", "u32", "s64", "u64"):
        two, n = f"{kind} {kind} -> {kind}", bits(kind)
        yield Case(f"add.{kind}", two, lambda a, b: a + b)
        yield Case(f"sub.{kind}", two, lambda a, b: a - b)
        yield Case(f"mul.lo.{kind}", two, lambda a, b: a * b)
        yield Case(f"mul.hi.{kind}", two, lambda a, b, n=n: a * b >> n)
        yield Case(f"mad.lo.{kind}", f"{kind} {two}", lambda a, b, c: a * b + c)
        yield Case(f"div.{kind}", two, truncated, within=divisible)
        yield Case(f"rem.{kind}", two, lambda a, b: a - b * truncated(a, b), within=divisible)
        yield Case(f"min.{kind}", two, min)
        yield Case(f"max.{kind}", two, max)
        yield Case(f"shr.{kind}", f"{kind} u32 -> {kind}", lambda a, b: a >> b)
        if n < 64:
            wide = f"{kind[0]}{2 * n}"
            yield Case(f"mul.wide.{kind}", f"{kind} {kind} -> {wide}", lambda a, b: a * b)
            yield Case(f"mad.wide.{kind}", f"{kind} {kind} {wide} -> {wide}", lambda a, b, c: a * b + c)
        if kind[0] == "s":
            yield Case(f"neg.{kind}", f"{kind} -> {kind}", lambda a: -a)
            yield Case(f"abs.{kind}", f"{kind} -> {kind}", abs)
    for kind in ("s32", "u32", "s64", "u64"):
        yield Case(f"bfe.{kind}", f"{kind} u32 u32 -> {kind}", lambda a, b, c, k=kind: field(a, b, c, k))


def bit_operations() -> Iterator[Case]:
    for n in (16, 32, 64):
        kind = f"b{n}"
        two, modulus = f"{kind} {kind} -> {kind}", 1 << n
        yield Case(f"and.{kind}", two, lambda a, b: a & b)
        yield Case(f"or.{kind}", two, lambda a, b: a | b)
        yield Case(f"xor.{kind}", two, lambda a, b: a ^ b)
        yield Case(f"not.{kind}", f"{kind} -> {kind}", lambda a: ~a)
        yield Case(f"shl.{kind}", f"{kind} u32 -> {kind}", lambda a, s, m=modulus: a << s if s < 64 else 0)
        yield Case(f"shr.{kind}", f"{kind} u32 -> {kind}", lambda a, s: a >> s)
        yield Case(f"mov.{kind}", f"{kind} -> {kind}", lambda a: a)
        if n > 16:
            yield Case(f"popc.{kind}", f"{kind} -> u32", lambda a: a.bit_count())
            yield Case(f"clz.{kind}", f"{kind} -> u32", lambda a, n=n: n - a.bit_length())
            yield Case(
                f"bfi.{kind}", f"{kind} {kind} u32 u32 -> {kind}",
                lambda a, b, at, k, n=n: inserted(a, b, at, k, n),
            )  # fmt: skip
    three = "b32 b32 u32 -> b32"
    for side in ("l", "r"):
        yield Case(
            f"shf.{side}.wrap.b32", three, lambda a, b, s, e=side: funnel(a, b, s & 31, left=e == "l")
        )
        yield Case(
            f"shf.{side}.clamp.b32", three, lambda a, b, s, e=side: funnel(a, b, min(s, 32), left=e == "l")
        )
    logic = {"and": lambda a, b: a & b, "or": lambda a, b: a | b, "xor": lambda a, b: a ^ b}
    for name, act in logic.items():
        yield Case(f"{name}.pred", "pred pred -> pred", act)
        yield Case(f"{name}.pred with -1", "pred -> pred", lambda a, f=act: f(a, 1), f"{name}.pred %d, %a, -1;")
    yield Case("not.pred", "pred -> pred", lambda a: 1 - a)
    yield Case("mov.pred", "pred -> pred", lambda a: a)
    yield Case("mov.pred 1", "pred -> pred", lambda a: 1, "mov.pred %d, 1;")
    yield Case("mov.pred 0", "pred -> pred", lambda a: 0, "mov.pred %d, 0;")
    yield Case("pack 2", "b32 b32 -> b64", lambda a, b: b << 32 | a, "mov.b64 %d, {%a, %b};")
    yield Case("pack 16", "b16 b16 -> b32", lambda a, b: b << 16 | a, "mov.b32 %d, {%a, %b};")
    yield Case(
        "pack 4", "b16 b16 b16 b16 -> b64", lambda a, b, c, e: e << 48 | c << 32 | b << 16 | a,
        "mov.b64 %d, {%a, %b, %c, %e};",
    )  # fmt: skip
    yield Case("unpack 2", "b64 -> b32", lambda a: a >> 32, "mov.b64 {%t0, %d}, %a;")
    yield Case("unpack, one thrown away", "b64 -> b32", lambda a: a, "mov.b64 {%d, _}, %a;")
    yield Case("unpack 4", "b64 -> b16", lambda a: a >> 32, "mov.b64 {%h0, %h1, %d, %h3}, %a;")


def carries() -> Iterator[Case]:
    """Numbers of 64 bits in two halves, and what goes out of 64 bits; signed types have the same carries."""
    apart = "mov.b64 {%t0, %t1}, %a; mov.b64 {%t2, %t3}, %b;"
    together = "mov.b64 %d, {%t0, %t1};"
    for k in ("u", "s"):
        for name, exact in (("add", lambda a, b: a + b), ("sub", lambda a, b: a - b)):
            yield Case(
                f"{name}.cc.{k}32, {name}c.{k}32", "u64 u64 -> u64", exact,
                f"{apart} {name}.cc.{k}32 %t0, %t0, %t2; {name}c.{k}32 %t1, %t1, %t3; {together}",
            )  # fmt: skip
            yield Case(
                f"{name}.cc.{k}64, {name}c.cc.{k}32, {name}c.{k}32", "u64 u64 -> u64",
                # 64 bits, then zeros of 32 bits twice.
                lambda a, b, f=exact: f(a, b) >> 64,
                f"{name}.cc.{k}64 %l0, %a, %b; {name}c.cc.{k}32 %t0, 0, 0; {name}c.{k}32 %t1, 0, 0; {together}",
            )  # fmt: skip
        yield Case(
            f"mad.lo.cc.{k}32, madc.hi.{k}32", f"{k}32 {k}32 u64 -> u64", lambda a, b, c: a * b + c,
            f"mov.b64 {{%t2, %t3}}, %c; mad.lo.cc.{k}32 %t0, %a, %b, %t2; madc.hi.{k}32 %t1, %a, %b, %t3; {together}",
        )  # fmt: skip
    yield Case(
        "mad.hi.cc.u32, madc.lo.cc.u32, madc.hi.cc.u32", "u32 u32 u32 -> u64",
        # The carry of hi(a b) + c is added to a b; the carry of that to 0 0 + 0, and is thrown away.
        lambda a, b, c: a * b + ((a * b >> 32) + c >> 32),
        "mad.hi.cc.u32 %t2, %a, %b, %c; madc.lo.cc.u32 %t0, %a, %b, 0; madc.hi.cc.u32 %t1, %a, %b, 0;" + together,
    )  # fmt: skip
    yield Case(
        "mad.lo.cc.u64, madc.hi.u64", "u64 u64 u64 -> u64", lambda a, b, c: a * b + c >> 64,
        "mad.lo.cc.u64 %l0, %a, %b, %c; madc.hi.u64 %d, %a, %b, 0;",
    )  # fmt: skip


def floats() -> Iterator[Case]:
    for kind in ("f32", "f64"):
        one, two = f"{kind} -> {kind}", f"{kind} {kind} -> {kind}"
        yield Case(f"add.rn.{kind}", two, lambda a, b: a + b)
        yield Case(f"sub.{kind}", two, lambda a, b: a - b)
        yield Case(f"mul.{kind}", two, lambda a, b: a * b)
        yield Case(f"div.rn.{kind}", two, lambda a, b: a / b)
        # Of a zero of either sign a GPU takes one by its sign, C any.
        yield Case(f"min.{kind}", two, lambda a, b: least(a, b, min), within=lambda a, b: a or b)
        yield Case(f"max.{kind}", two, lambda a, b: least(a, b, max), within=lambda a, b: a or b)
        yield Case(f"neg.{kind}", one, lambda a: -a)
        yield Case(f"abs.{kind}", one, abs)
        yield Case(f"sqrt.rn.{kind}", one, np.sqrt)
        yield Case(f"rcp.rn.{kind}", one, lambda a: type(a)(1) / a)
        # Approximate on a GPU: its bits are nobody's to rely on.
        yield Case(f"rsqrt.approx.{kind}", one, lambda a: type(a)(1) / np.sqrt(a), ulps=2)
        yield Case(f"copysign.{kind}", two, lambda a, b: np.copysign(b, a))
        yield Case(f"mov.{kind}", one, lambda a: a)
        yield Case(f"selp.{kind}", f"{kind} {kind} pred -> {kind}", lambda a, b, p: a if p else b)
        for name, test in (("finite", np.isfinite), ("infinite", np.isinf), ("notanumber", np.isnan)):
            yield Case(f"testp.{name}.{kind}", f"{kind} -> pred", test)
        yield Case(f"testp.number.{kind}", f"{kind} -> pred", lambda a: not np.isnan(a))
    yield Case("fma.rn.f64", "f64 f64 f64 -> f64", fused)
    # Products of two f32 are exact in f64, and of these (multiples of 1/8, below 2^16) the sums too.
    yield Case(
        "fma.rn.f32", "f32 f32 f32 -> f32", lambda a, b, c: np.float32(np.float64(a) * np.float64(b) + np.float64(c)),
        within=lambda *v: all(abs(x) < 2**16 and x * 8 == np.floor(x * 8) for x in v),
    )  # fmt: skip
    for name, function in (("lg2", np.log2), ("ex2", np.exp2)):
        yield Case(f"{name}.approx.f32", "f32 -> f32", function, ulps=4)
    for name, function in (("sin", np.sin), ("cos", np.cos)):
        yield Case(f"{name}.approx.f32", "f32 -> f32", function, within=within_range, ulps=4)


def conversions() -> Iterator[Case]:
    whole = ("s8", "u8", "u16", "s32", "u32", "s64", "u64")
    for to, of in itertools.product(whole, repeat=2):
        if to != of:
            yield Case(f"cvt.{to}.{of}", f"{of} -> {to}", lambda a: a)
    for to, of in itertools.product(("f32", "f64"), ("s16", "u16", "s32", "u32", "s64", "u64")):
        yield Case(f"cvt.rn.{to}.{of}", f"{of} -> {to}", lambda a, t=to: dtype(t).type(a))
    for to, of in itertools.product(("s8", "u16", "s32", "u32", "s64", "u64"), ("f32", "f64")):
        for how in ("rmi", "rpi", "rni", "rzi"):
            yield Case(
                f"cvt.{how}.{to}.{of}", f"{of} -> {to}",
                lambda a, h=how, t=to, o=of: to_integer(a, h, t, o),
            )  # fmt: skip
    for kind in ("f32", "f64"):
        for how in ("rmi", "rpi", "rni", "rzi"):
            yield Case(f"cvt.{how}.{kind}.{kind}", f"{kind} -> {kind}", lambda a, h=how: rounded(a, h))
        yield Case(
            f"cvt.sat.{kind}.{kind}", f"{kind} -> {kind}",
            lambda a: type(a)(0) if np.isnan(a) else min(max(a, type(a)(0)), type(a)(1)),
            within=lambda a: a != 0,  # of either sign
        )  # fmt: skip
    yield Case("cvt.rn.f32.f64", "f64 -> f32", np.float32)
    yield Case("cvt.f64.f32", "f32 -> f64", np.float64)


def others() -> Iterator[Case]:
    for n in (16, 32, 64):
        yield Case(f"selp.b{n}", f"b{n} b{n} pred -> b{n}", lambda a, b, p: a if p else b)
    yield Case("bits of a number", "f64 -> b64", lambda a: int(a.view(np.uint64)), "mov.b64 %d, %a;")
    yield Case("number of bits", "b32 -> f32", lambda a: np.uint32(a).view(np.float32), "mov.b32 %d, %a;")
    yield Case("literals", "u64 -> u64", lambda a: a + 0x1F - 7, "add.s64 %d, %a, 0x1F; add.s64 %d, %d, -7;")
    yield Case("literals of floats", "f64 -> f64", lambda a: a + 1.5, "add.f64 %d, %a, 0d3FF8000000000000;")
    yield Case("literals of f32", "f32 -> f32", lambda a: a * a.dtype.type(2.5), "mul.f32 %d, %a, 0f40200000;")
    yield Case("predicate", "u32 u32 -> u32", lambda a, b: a if a < b else b,
        "mov.u32 %d, %b; setp.lt.u32 %p, %a, %b; @%p mov.u32 %d, %a;")  # fmt: skip
    yield Case("predicate, negated", "u32 u32 -> u32", lambda a, b: b if a < b else a,
        "mov.u32 %d, %b; setp.lt.u32 %p, %a, %b; @!%p mov.u32 %d, %a;")  # fmt: skip
    # A sum of 0 .. a - 1, of at most the low 5 bits of a.
    yield Case("bra", "u32 -> u32", lambda a: sum(range(a & 31)),
        "and.b32 %t0, %a, 31; mov.u32 %d, 0; mov.u32 %t1, 0; bra.uni $CHECK;\n"
        "$LOOP: add.s32 %d, %d, %t1; add.s32 %t1, %t1, 1;\n"
        "$CHECK: setp.lt.u32 %p, %t1, %t0; @%p bra $LOOP;")  # fmt: skip
    yield Case("brx.idx", "u32 -> u32", lambda a: (20, 21, 20, 22)[a & 3],
        "and.b32 %t0, %a, 3;\n$TABLE: .branchtargets $ONE, $TWO, $ONE, $THREE;\nbrx.idx %t0, $TABLE;\n"
        "$ONE: mov.u32 %d, 20; bra $END;\n$TWO: mov.u32 %d, 21; bra $END;\n$THREE: mov.u32 %d, 22;\n$END:")  # fmt: skip
    # Threads that leave write nothing: their element stays what it was, 0.
    yield Case("ret", "u32 -> u32", lambda a: a if a & 1 else 0,
        "and.b32 %t0, %a, 1; setp.eq.s32 %p, %t0, 0; @%p ret; mov.u32 %d, %a;")  # fmt: skip
    yield Case("exit", "u32 -> u32", lambda a: a if a & 1 else 0,
        "and.b32 %t0, %a, 1; setp.eq.s32 %p, %t0, 0; @%p exit; mov.u32 %d, %a;")  # fmt: skip
    yield Case("trap", "u32 -> u32", lambda a: a,
        "setp.ne.s32 %p, %a, %a; @%p trap; mov.u32 %d, %a;")  # fmt: skip
    give = "{ .param .b32 param0; st.param.b32 [param0+0], %a; .param .b32 retval0;"
    take = "ld.param.b32 %d, [retval0+0]; }"
    yield Case("call", "u32 -> u32", lambda a: 3 * a + 1,
        f"{give} call.uni (retval0), three_and_one, (param0); {take}")  # fmt: skip
    yield Case("call, indirect", "u32 -> u32", lambda a: 3 * a + 1,
        f"mov.u64 %l0, three_and_one; {give} "
        "prototype_1 : .callprototype (.param .b32 _) _ (.param .b32 _);\n"
        f"call (retval0), %l0, (param0), prototype_1; {take}")  # fmt: skip
    yield Case("registers of a scope", "u32 -> u32", lambda a: a,
        "mov.u32 %d, %a; { .reg .b32 %d; mov.u32 %d, 5; }")  # fmt: skip


def memory() -> Iterator[Case]:
    local = "mov.u64 %l0, scratch; cvta.local.u64 %l1, %l0;"
    for kind in ("b8", "s8", "u8", "b16", "s16", "u16", "b32", "s32", "u32", "b64", "s64", "u64", "f32", "f64"):
        yield Case(
            f"st.local.{kind}, ld.{kind}", f"{kind} -> {kind}", lambda a: a,
            f"{local} st.local.{kind} [%l0+16], %a; ld.{kind} %d, [%l1+16];",
        )  # fmt: skip
        # What a register has beside the type's bits is their sign, or zeros.
        if kind[0] == "s" and kind != "s64":
            yield Case(
                f"ld.local.{kind} in 64 bits", f"{kind} -> s64", lambda a: a,
                f"{local} st.local.{kind} [%l0], %a; ld.local.{kind} %d, [%l0];",
            )  # fmt: skip
    yield Case("st.local.v2.u32", "u32 u32 -> u64", lambda a, b: b << 32 | a,
        f"{local} st.local.v2.u32 [%l0+8], {{%a, %b}}; ld.local.u64 %d, [%l0+8];")  # fmt: skip
    yield Case("ld.v4.u16", "u64 -> u16", lambda a: a >> 32,
        f"{local} st.u64 [%l1], %a; ld.v4.u16 {{%h0, %h1, %d, %h3}}, [%l1];")  # fmt: skip
    yield Case("st.v2.f64, ld.v2.f64", "f64 f64 -> f64", lambda a, b: a - b,
        f"{local} st.v2.f64 [%l1], {{%b, %a}}; ld.v2.f64 {{%g0, %g1}}, [%l1]; sub.f64 %d, %g1, %g0;")  # fmt: skip
    yield Case("ld.const", "u32 -> u32", lambda a: (11, 22, 33, 44)[a & 3],
        "and.b32 %t0, %a, 3; mul.wide.u32 %l0, %t0, 4; mov.u64 %l1, of_constants; add.s64 %l1, %l1, %l0;"
        "ld.const.u32 %d, [%l1];")  # fmt: skip
    yield Case("ld.global of a name", "u32 -> f64", lambda a: 2.5,
        "mov.u64 %l0, half_five; cvta.to.global.u64 %l0, %l0; ld.global.f64 %d, [%l0];")  # fmt: skip
    yield Case("ld.const of a name and a number", "u32 -> u32", lambda a: 33, "ld.const.u32 %d, [of_constants+8];")
    yield Case("shared memory at the start", "u32 -> u32", lambda a: 0xA5A5A5A5,
        "mov.u64 %l0, untouched; ld.shared.u32 %d, [%l0+4]; bar.sync 0;")  # fmt: skip
    yield Case("membar, fence", "u32 -> u32", lambda a: a,
        "membar.gl; fence.acq_rel.gpu; mov.u32 %d, %a;")  # fmt: skip
    yield Case("activemask", "u32 -> u32", lambda a: 1, "activemask.b32 %t0; popc.b32 %d, %t0;")


CASES = [
    *comparisons(), *integers(), *bit_operations(), *carries(), *floats(), *conversions(), *others(), *memory(),
]  # fmt: skip


def register_type(kind: str) -> str:
    """Type of register for a number: there are none of 8 bits."""
    return kind if kind[0] in "fp" else f"b{max(bits(kind), 16)}"


def entry(name: str, parameters: int, body: str) -> str:
    listed = ", ".join(f".param .u64 {name}_{i}" for i in range(parameters))
    return f".visible .entry {name}({listed}) {{\n{body}\nret;\n}}\n"


def element(name: str, i: int, kind: str) -> str:
    """PTX that sets %w{i} to the address of this thread's element of array i; %n is the number of the thread."""
    size = dtype(kind).itemsize
    return (
        f".reg .b64 %w{i}; ld.param.u64 %w{i}, [{name}_{i}]; cvta.to.global.u64 %w{i}, %w{i}; "
        f"mad.wide.u32 %w{i}, %n, {size}, %w{i};\n"
    )




def kernel_of(number: int, case: Case) -> str:
    name = f"k{number}"
    text = ".reg .b32 %n, %m; mov.u32 %n, %tid.x;\n" + (SCRATCH if case.body else "")
    for i, (register, kind) in enumerate(zip("abce", case.inputs, strict=False)):
        text += f".reg .{register_type(kind)} %{register}; {element(name, i, kind)}"
        if kind == "pred":
            text += f"ld.global.u32 %m, [%w{i}]; setp.ne.s32 %{register}, %m, 0;\n"
        else:
            text += f"ld.global.{kind} %{register}, [%w{i}];\n"
    last = len(case.inputs)
    text += f".reg .{register_type(case.output)} %d; {element(name, last, case.output)}"
    if "scratch" in case.body:
        text += ".local .align 16 .b8 scratch[32];\n"
    operands = ", ".join(f"%{register}" for register in "dabce"[: last + 1])
    body = (case.body or f"{case.name} {operands};").replace("$", f"$L{number}_")
    text += body + "\n"
    if case.output == "pred":
        text += f"selp.u32 %m, 1, 0, %d; st.global.u32 [%w{last}], %m;"
    else:
        text += f"st.global.{case.output} [%w{last}], %d;"
    return entry(name, last + 1, text)


OF_MODULE = """
.global .align 8 .f64 half_five = 0d4004000000000000;
.const .align 4 .u32 of_constants[4] = {11, 22, 33, 44};
.shared .align 8 .b8 untouched[16];
.shared .align 4 .u32 of_block[64];
.shared .align 8 .b64 of_atoms[1];
.func (.param .b32 func_retval0) three_and_one(.param .b32 three_and_one_0) {
.reg .b32 %r<3>; ld.param.u32 %r1, [three_and_one_0]; mad.lo.s32 %r2, %r1, 3, 1;
st.param.b32 [func_retval0+0], %r2; ret;
}
"""


# Threads one after the other change a cell; each gets what was there before ---------------------------------------------


class Atomic(NamedTuple):
    name: str  # without the opcode: `atom` and `red` do the same
    kind: str
    change: Callable[..., Any]  # of the cell, of %a and of %b

    @property
    def ptx(self) -> str:
        return f"{self.name}.{self.kind}"


def atomics() -> Iterator[Atomic]:
    for kind in ("u32", "s32", "u64", "f32", "f64"):
        yield Atomic("add", kind, lambda cell, a, b: cell + a)
    for kind in ("u32", "s32", "u64", "s64"):
        yield Atomic("min", kind, lambda cell, a, b: min(cell, a))
        yield Atomic("max", kind, lambda cell, a, b: max(cell, a))
    for kind in ("b32", "b64"):
        yield Atomic("and", kind, lambda cell, a, b: cell & a)
        yield Atomic("or", kind, lambda cell, a, b: cell | a)
        yield Atomic("xor", kind, lambda cell, a, b: cell ^ a)
        yield Atomic("exch", kind, lambda cell, a, b: a)
        yield Atomic("cas", kind, lambda cell, a, b: b if cell == a else cell)


ATOMICS = list(atomics())


def atomic_kernel(number: int, case: Atomic) -> str:
    """Parameters: %a, %b, what was there at `atom.global`, the cells of `atom` and `red`, what was there in shared memory."""
    name, kind = f"a{number}", case.kind
    text = ".reg .b32 %n; mov.u32 %n, %tid.x; .reg .pred %p; .reg .b64 %l<3>;\n"
    text += f".reg .{register_type(kind)} %a, %b, %d;" + "".join(element(name, i, kind) for i in (0, 1, 2, 5))
    text += f"ld.global.{kind} %a, [%w0]; ld.global.{kind} %b, [%w1];\n"
    more = ", %b" if case.name == "cas" else ""
    text += f"ld.param.u64 %l0, [{name}_3]; ld.param.u64 %l1, [{name}_4]; mov.u64 %l2, of_atoms;\n"
    text += f"setp.ne.s32 %p, %n, 0; @%p bra $GO{number}; st.shared.{kind} [%l2], %a;\n$GO{number}:\n"
    text += f"atom.global.{case.ptx} %d, [%l0], %a{more}; st.global.{kind} [%w2], %d;\n"
    if not more:
        text += f"red.global.{case.ptx} [%l1+8], %a;\n"
    text += f"atom.shared.{case.ptx} %d, [%l2], %b{', %a' if more else ''}; st.global.{kind} [%w5], %d;"
    return entry(name, 6, text)


# Threads that meet ------------------------------------------------------------------------------------------------------

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
    """Instructions that make %d and %q of %a, %b (any number), of the predicate %p (whether %a is odd) and of threads."""

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
    yield Meeting("vote of literals", "vote.sync.all.pred %q, 1, -1; vote.sync.ballot.b32 %d, 0, -1;", lambda *_: (0, 1))
    yield Meeting(
        "vote of half a warp",
        "and.b32 %t0, %n, 16; setp.ne.s32 %q, %t0, 0; @%q bra $UPPER;\n"
        "vote.sync.ballot.b32 %d, %p, 0x0000FFFF; bra $END;\n"
        "$UPPER: vote.sync.ballot.b32 %d, %p, 0xFFFF0000;\n$END: setp.ne.s32 %q, 0, 0;",
        lambda a, b, p: (by_halves(p), 0),
    )  # fmt: skip
    yield Meeting("match.any", "and.b32 %t0, %b, 3; match.any.sync.b32 %d, %t0, -1;", lambda a, b, p: (alike(b & 3), 0))
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


MEETINGS = list(meetings())


def meeting_kernel(number: int, case: Meeting) -> str:
    """Parameters %a, %b, %d and %q of each thread of all blocks; %n is its number in the block."""
    name = f"m{number}"
    text = SCRATCH + ".reg .b32 %n, %a, %b, %d; mov.u32 %t0, %ctaid.x; mov.u32 %t1, %ntid.x; mov.u32 %n, %tid.x;"
    text += "mad.lo.s32 %n, %t0, %t1, %n;\n" + "".join(element(name, i, "u32") for i in range(4))
    text += "ld.global.u32 %a, [%w0]; ld.global.u32 %b, [%w1]; mov.u32 %d, 0; setp.ne.s32 %q, 0, 0;"
    text += "and.b32 %t0, %a, 1; setp.eq.s32 %p, %t0, 1; mov.u32 %n, %tid.x; shr.u32 %t1, %n, 5;\n"
    text += "setp.gt.u32 %q, %t1, 0; @%q mov.u32 %t1, %n; setp.ne.s32 %q, 0, 0;\n"
    text += case.body.replace("$", f"$M{number}_")
    text += "\nst.global.u32 [%w2], %d; selp.u32 %d, 1, 0, %q; st.global.u32 [%w3], %d;"
    return entry(name, 4, text)


def turn_kernel(name: str, before: str) -> str:
    """Writes the turn at which each thread comes to a counter."""
    return entry(
        name, 2,
        f".reg .b32 %n, %d; mov.u32 %n, %tid.x; .reg .b64 %l0; {element(name, 1, 'u32')} {before}"
        f"ld.param.u64 %l0, [{name}_0]; atom.global.add.u32 %d, [%l0], 1; st.global.u32 [%w1], %d;",
    )  # fmt: skip


MODULE = "".join(
    [
        HEAD,
        OF_MODULE,
        *(kernel_of(*each) for each in enumerate(CASES)),
        *(atomic_kernel(*each) for each in enumerate(ATOMICS)),
        *(meeting_kernel(*each) for each in enumerate(MEETINGS)),
        turn_kernel("turns", ""),
        turn_kernel("turns_met", "bar.sync 0;"),
    ]
)


# The tests --------------------------------------------------------------------------------------------------------------

on_emulator = pytest.mark.skipif(not CAN_RUN, reason=NEEDS)
FLOATS = [0.0, -0.0, 1.0, -1.0, 0.1, -0.3, 0.5, -0.5, 1.5, 2.5, -2.5, 3.7, -3.7, 1e-40, 1e-310, 1e30, -1e300, 127.5, -128.5,
    32767.5, -32768.5, 65535.5, 2**31 - 0.5, 2.0**31, -(2.0**31) - 1.5, 2.0**32, 2.0**53 + 2, 2.0**63, 1.5 * 2.0**63,
    -(2.0**63), 2.0**64, np.inf, -np.inf, np.nan]  # fmt: skip
INTEGERS = [0, 1, 2, 3, 5, 7, 8, 15, 16, 20, 31, 32, 33, 48, 63, 64, 65, 100, 127, 128, 255, 256, 0x5DEECE66D, 0xCAFEBABE12345678]


def pool(kind: str) -> list[Any]:
    """Numbers of a type at which instructions differ: small, at the ends of its range, and of many bits."""
    if kind == "pred":
        return [0, 1]
    if kind[0] == "f":
        with np.errstate(over="ignore"):
            return [dtype(kind).type(each) for each in FLOATS]
    n = bits(kind)
    found = [*INTEGERS, *(1 << n - 1 + 0 * k for k in range(1)), *((1 << n - 1) + k for k in (-1, 1)), -1, -2, -7]
    return list({signed(each, n) if kind[0] == "s" else each % (1 << n): None for each in found})


def inputs_of(case: Case) -> list[tuple[Any, ...]]:
    """All pairs of numbers, some hundred of three or four."""
    pools = [pool(kind) for kind in case.inputs]
    if len(pools) > 2:
        draw = np.random.default_rng(1)
        rows = [tuple(each[i] for each, i in zip(pools, draw.integers(0, [len(p) for p in pools]), strict=True)) for _ in range(300)]
    else:
        rows = list(itertools.product(*pools))
    return [row for row in rows if case.within(*row)]


@pytest.fixture(scope="module")
def device(tmp_path_factory: pytest.TempPathFactory) -> Device:
    return Device(tmp_path_factory.mktemp("emulator"), MODULE)


def named(cases: list[Any]) -> Any:
    return pytest.mark.parametrize(("number", "case"), list(enumerate(cases)), ids=[each.name if not isinstance(each, Atomic) else each.ptx for each in cases])


def as_array(values: list[Any], kind: str) -> np.ndarray:
    """An array of a type, of the low bits of integers."""
    if kind[0] != "f":
        n = 8 * dtype(kind).itemsize
        values = [signed(int(each), n) if kind[0] == "s" else int(each) % (1 << n) for each in values]
    with np.errstate(over="ignore"):
        return np.array(values, dtype(kind))


@on_emulator
@named(CASES)
def test_an_instruction(device: Device, number: int, case: Case) -> None:
    rows = inputs_of(case)
    assert len(rows) >= 2
    given = [as_array(list(column), kind) for column, kind in zip(zip(*rows, strict=True), case.inputs, strict=True)]
    found = np.zeros(len(rows), dtype(case.output))
    device.launch(f"k{number}", *given, found, threads=len(rows))
    with np.errstate(all="ignore"):
        expected = as_array([case.expected(*row) for row in rows], case.output)
    if case.ulps:
        eps = float(np.finfo(found.dtype).eps)
        np.testing.assert_allclose(found, expected, rtol=case.ulps * eps, atol=case.ulps * eps * (case.name[:3] in ("sin", "cos", "lg2")))
        return
    bad = ~((found == expected) & (np.signbit(found) == np.signbit(expected)) | (found != found) & (expected != expected))
    assert not bad.any(), [(rows[i], found[i], expected[i]) for i in np.flatnonzero(bad)[:3]]


@on_emulator
@named(ATOMICS)
def test_an_atomic_instruction(device: Device, number: int, case: Atomic) -> None:
    draw, kind = np.random.default_rng(2), dtype(case.kind)
    a, b = draw.integers(-9 if case.kind[0] in "sf" else 0, 9, (2, 50)).astype(kind)
    a[7] = b[9] = kind.type(-3 if case.kind[0] in "sf" else 2 ** (bits(case.kind) - 1) + 3)
    was, was_shared, cell, red = np.zeros(50, kind), np.zeros(50, kind), np.array([5], kind), np.array([0, 5], np.uint64)
    red[1:].view(kind)[:1] = 5
    device.launch(f"a{number}", a, b, was, cell, red, was_shared, threads=50)
    for start, x, y, found in ((kind.type(5), a, b, was), (a[0], b, a, was_shared)):
        expected = [start]
        with np.errstate(over="ignore"):
            for each in zip(x, y, strict=True):
                expected.append(kind.type(case.change(expected[-1], *each)))
        np.testing.assert_array_equal(found, expected[:-1])
        if found is was:
            assert cell[0] == expected[-1]
            assert case.name == "cas" or red[1:].view(kind)[0] == expected[-1]


@on_emulator
@pytest.mark.parametrize("order", [0, 1, 7])
@named(MEETINGS)
def test_threads_meet(device: Device, number: int, case: Meeting, order: int) -> None:
    """Two blocks of two warps: the same in any order of threads."""
    a, b = np.random.default_rng(3).integers(0, 2**31, (2, 2, 2, 32)).astype(np.uint32)
    a[1, 0] |= 1  # a warp, and then a block, that agrees
    d, q = np.zeros_like(a), np.zeros_like(a)
    device.launch(f"m{number}", a, b, d, q, threads=64, blocks=2, order=order)
    for block in range(2):
        expected = case.expected(a[block], b[block], a[block] % 2 == 1)
        for found, each in zip((d, q), expected, strict=True):
            np.testing.assert_array_equal(found[block], np.broadcast_to(each, (2, 32)))


@on_emulator
@pytest.mark.parametrize("kernel", ["turns", "turns_met"])
def test_threads_run_in_the_order_asked_for(device: Device, kernel: str) -> None:
    found = np.zeros((3, 100), np.uint32)
    for order, turn in zip((0, 1, 7), found, strict=True):
        device.launch(kernel, np.zeros(1, np.uint32), turn, threads=100, order=order)
    np.testing.assert_array_equal(found[0], np.arange(100))
    np.testing.assert_array_equal(found[1], np.arange(100)[::-1])
    np.testing.assert_array_equal(np.sort(found[2]), np.arange(100))
    assert np.abs(np.diff(found[2].astype(int))).max() > 1
