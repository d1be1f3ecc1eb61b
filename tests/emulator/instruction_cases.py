"""What instructions of PTX give, by exact integers and by NumPy: cases for test_instructions.py.

By the PTX ISA 9.0, section 9.7, https://docs.nvidia.com/cuda/parallel-thread-execution. Integers are those of Python,
without bounds, of which the low bits are compared.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np


def anything(*_: Any) -> bool:
    return True


class Case(NamedTuple):
    """Instructions that make %d of %a, %b, ...; of what types; and the value that they shall give."""

    name: str
    types: str  # of %a, %b, ...; and of %d
    expected: Callable[..., Any]  # of one number each
    body: str = ""  # if it is not the instruction `name` alone
    within: Callable[..., bool] = anything  # where PTX says what the result is
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
    """`bfe`: n bits from `at` on; above the top bit zeros, of signed numbers the sign of the last bit."""
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


def any_but_zeros(*values: Any) -> bool:
    """Of zeros of either sign a GPU takes one by its sign, C any."""
    return any(value != 0 for value in values)


def within_range(*values: Any) -> bool:
    """Arguments so small that all programs reduce them to a period alike."""
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
        yield Case(f"shf.{side}.wrap.b32", three, lambda a, b, s, e=side: funnel(a, b, s & 31, left=e == "l"))
        yield Case(
            f"shf.{side}.clamp.b32", three, lambda a, b, s, e=side: funnel(a, b, min(s, 32), left=e == "l")
        )
    logic = {"and": lambda a, b: a & b, "or": lambda a, b: a | b, "xor": lambda a, b: a ^ b}
    for name, act in logic.items():
        yield Case(f"{name}.pred", "pred pred -> pred", act)
        yield Case(
            f"{name}.pred with -1", "pred -> pred", lambda a, f=act: f(a, 1), f"{name}.pred %d, %a, -1;"
        )
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
        yield Case(f"min.{kind}", two, lambda a, b: least(a, b, min), within=any_but_zeros)
        yield Case(f"max.{kind}", two, lambda a, b: least(a, b, max), within=any_but_zeros)
        yield Case(f"neg.{kind}", one, lambda a: -a)
        yield Case(f"abs.{kind}", one, abs)
        yield Case(f"sqrt.rn.{kind}", one, np.sqrt)
        yield Case(f"rcp.rn.{kind}", one, lambda a: type(a)(1) / a)
        # Approximate on a GPU, within a bound of its error.
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
    whole = ("s8", "u8", "s32", "u32", "s64", "u64")
    for to, of in itertools.product(whole, repeat=2):
        if to != of:
            yield Case(f"cvt.{to}.{of}", f"{of} -> {to}", lambda a: a)
    for to, of in itertools.product(("f32", "f64"), ("s16", "u16", "s32", "u32", "s64", "u64")):
        yield Case(f"cvt.rn.{to}.{of}", f"{of} -> {to}", lambda a, t=to: dtype(t).type(a))
    for to, of in itertools.product(("s8", "u16", "s32", "u32", "s64", "u64"), ("f32", "f64")):
        for how in ("rmi", "rpi", "rni", "rzi") if bits(to) > 16 else ("rzi",):
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
            within=any_but_zeros,
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
    yield Case(
        "literals of f32", "f32 -> f32", lambda a: a * a.dtype.type(2.5), "mul.f32 %d, %a, 0f40200000;"
    )
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
        "mov.u32 %d, %a; { .reg .f64 %d; mov.f64 %d, 0d3FF8000000000000; }")  # fmt: skip


def memory() -> Iterator[Case]:
    local = "mov.u64 %l0, scratch; cvta.local.u64 %l1, %l0;"
    for kind in (
        "b8",
        "s8",
        "u8",
        "b16",
        "s16",
        "u16",
        "b32",
        "s32",
        "u32",
        "b64",
        "s64",
        "u64",
        "f32",
        "f64",
    ):
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
    yield Case("mov of a name and a number", "u32 -> u32", lambda a: 22,
        "mov.u64 %l0, of_constants+4; ld.const.u32 %d, [%l0];")  # fmt: skip
    yield Case("ld.f64 to a register of bits", "f64 -> f64", lambda a: a,
        f"{local} st.local.f64 [%l0], %a; ld.local.f64 %l2, [%l0]; mov.b64 %d, %l2;")  # fmt: skip
    yield Case("ldu", "u32 -> f64", lambda a: 2.5, "mov.u64 %l0, half_five; ldu.global.f64 %d, [%l0];")
    yield Case(
        "ld.const of a name and a number", "u32 -> u32", lambda a: 33, "ld.const.u32 %d, [of_constants+8];"
    )
    yield Case("shared memory at the start", "u32 -> u32", lambda a: 0xA5A5A5A5,
        "mov.u64 %l0, untouched; ld.shared.u32 %d, [%l0+4]; bar.sync 0;")  # fmt: skip
    yield Case("membar, fence", "u32 -> u32", lambda a: a,
        "membar.gl; fence.acq_rel.gpu; mov.u32 %d, %a;")  # fmt: skip
    yield Case("activemask", "u32 -> u32", lambda a: 1, "activemask.b32 %t0; popc.b32 %d, %t0;")


def all_cases() -> Iterator[Case]:
    for make in (comparisons, integers, bit_operations, carries, floats, conversions, others, memory):
        yield from make()


# None below the normal numbers: libraries may have set the processor to flush those to 0.
FLOATS = [
    0.0, -0.0, 1.0, -1.0, 0.1, 0.5, -0.5, 1.5, 2.5, -2.5, 3.7, -3.7, 1e-300, 1e-37, 1e30, -1e300, 127.5, -32768.5,
    2**31 - 0.5, -(2.0**31) - 1.5, 2.0**32, 2.0**53 + 2, 2.0**63, 1.5 * 2.0**63, -(2.0**63), np.inf, -np.inf, np.nan,
]  # fmt: skip
INTEGERS = [0, 1, 2, 3, 7, 16, 31, 32, 33, 63, 64, 65, 128, 256, 0x5DEECE66D, 0xCAFEBABE12345678]


def pool(kind: str) -> list[Any]:
    """Numbers of a type at which instructions differ: small, at the ends of its range, and of many bits."""
    if kind == "pred":
        return [0, 1]
    if kind[0] == "f":
        with np.errstate(over="ignore"):
            return [dtype(kind).type(each) for each in FLOATS]
    n = bits(kind)
    found = [*INTEGERS, *((1 << n - 1) + k for k in (-1, 0, 1)), -1, -2, -7]
    return list({signed(each, n) if kind[0] == "s" else each % (1 << n): None for each in found})


def inputs_of(case: Case) -> list[tuple[Any, ...]]:
    """All pairs of numbers, some hundred of three or four."""
    pools = [pool(kind) for kind in case.inputs]
    if len(pools) > 2:
        draw = np.random.default_rng(1)
        rows = [
            tuple(each[i] for each, i in zip(pools, draw.integers(0, [len(p) for p in pools]), strict=True))
            for _ in range(300)
        ]
    else:
        rows = list(itertools.product(*pools))
    return [row for row in rows if case.within(*row)]
