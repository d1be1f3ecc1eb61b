"""Instructions of PTX in C: a table of functions by opcode. What is not in it is an error.

PTX ISA 8.5, section 9.7, https://docs.nvidia.com/cuda/parallel-thread-execution
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

from . import memory
from .ptx_types import (
    BYTES,
    C_TYPES,
    CannotTranslate,
    Function,
    c_label,
    c_name,
    is_float,
    predicate,
    set_register,
    split_operands,
    unsigned,
    value_of,
)


class Instruction:
    """An instruction in a function of PTX, without its predicate."""

    def __init__(self, text: str, function: Function) -> None:
        self.text, self.function = text, function
        self.name, rest = re.match(r"([\w.:]+)\s*(.*)", text, re.S).groups()
        self.opcode, *self.modifiers = self.name.split(".")
        self.operands = split_operands(rest)
        self.kind = self.name.split(".")[-1]  # its type, where it has one
        self.space = 4 if "shared" in self.modifiers else 0  # as prelude.c has it

    def value(self, i: int, kind: str | None = None) -> str:
        """C expression of operand i, as the type of the instruction unless another is given."""
        return value_of(self.operands[i], kind or self.kind, self.function)

    def gives(self, expression: str, kind: str | None = None) -> str:
        """C statement that gives operand 0 this expression."""
        return "{ " + set_register(self.operands[0], kind or self.kind, expression, self.function) + " }"

    def one_of(self, names: dict[str, str]) -> str:
        """What `names` has for the one modifier that is in it."""
        found = [names[each] for each in self.modifiers if each in names]
        if len(found) != 1:
            raise CannotTranslate(f"{self.text} (needs one of {', '.join(names)})")
        return found[0]


class Row(NamedTuple):
    """A row of the table."""

    translate: Callable[[Instruction], str]
    modifiers: frozenset[str]  # that it knows, beside types


TABLE: dict[str, Row] = {}
Translation = Callable[[Instruction], str]


def opcode(*names: str, modifiers: str = "") -> Callable[[Translation], Translation]:
    """Enter a function in the table, by opcodes that it translates and by modifiers that it knows."""

    def enter(translate: Translation) -> Translation:
        TABLE.update(dict.fromkeys(names, Row(translate, frozenset(modifiers.split()))))
        return translate

    return enter


def to_c(text: str, function: Function) -> str:
    """C statement of an instruction, with its predicate `@p` or `@!p` as a condition."""
    text = text.strip()
    condition = ""
    if m := re.match(r"@(!?)(%\w+)\s+(.*)", text, re.S):
        condition, text = f"if ({m[1]}{c_name(m[2])}) ", m[3]
    instruction = Instruction(text, function)
    row = TABLE.get(instruction.opcode)
    if row is None:
        raise CannotTranslate(text)
    if unknown := set(instruction.modifiers) - row.modifiers - set(C_TYPES):
        raise CannotTranslate(f"{text} (.{', .'.join(sorted(unknown))})")
    return condition + row.translate(instruction)


# Branches -------------------------------------------------------------------------------------------------------------


@opcode("bra", modifiers="uni")
def branch(x: Instruction) -> str:
    return f"goto {c_label(x.operands[0])};"


@opcode("brx", modifiers="idx")
def branch_by_index(x: Instruction) -> str:
    cases = " ".join(f"case {k}: goto {each};" for k, each in enumerate(x.function.targets[x.operands[1]]))
    return f"switch ({x.value(0, 'u32')}) {{ {cases} default: abort(); }}"


@opcode("ret", "exit", modifiers="uni")
def leave(x: Instruction) -> str:
    return "return;"


@opcode("trap")
def trap(x: Instruction) -> str:
    return "abort();"


# Threads that meet, and memory ----------------------------------------------------------------------------------------


def meeting(
    x: Instruction, kind: str, mask: str, value: str, lane: str = "0", clamp: str = "0", got: str = "0"
) -> str:
    """C call that waits for other threads; `lane`, `clamp` and `got` (a predicate's address) are those of shfl."""
    return f"w->meet(w, {kind}, {x.function.meeting()}, {mask}, {value}, {lane}, {clamp}, {got})"


def gives_meeting(x: Instruction, call: str, kind: str) -> str:
    return f"{c_name(x.operands[0])} = {call};" if x.kind == "pred" else x.gives(call, kind)


@opcode("bar", "barrier", modifiers="sync red warp popc and or aligned")
def barrier(x: Instruction) -> str:
    if "warp" in x.modifiers:
        return meeting(x, "WARP_BAR", f"(uint32_t){x.value(0, 'u32')}", "0") + ";"
    if "sync" in x.modifiers:
        if x.operands != ["0"]:
            raise CannotTranslate(f"{x.text} (barrier 0 of all threads is known)")
        return meeting(x, "BAR", "0", "0") + ";"
    kind = x.one_of({"popc": "BAR_POPC", "and": "BAR_AND", "or": "BAR_OR"})
    _, number, asked = x.operands
    if number != "0":
        raise CannotTranslate(f"{x.text} (barrier 0 of all threads is known)")
    return gives_meeting(x, meeting(x, kind, "0", predicate(asked)), "u32")


def needs_sync(x: Instruction) -> None:
    if "sync" not in x.modifiers:
        raise CannotTranslate(f"{x.text} (without .sync)")


@opcode("vote", modifiers="sync ballot all any uni")
def vote(x: Instruction) -> str:
    needs_sync(x)
    kind = x.one_of({"ballot": "BALLOT", "all": "ALL", "any": "ANY", "uni": "UNI"})
    return gives_meeting(x, meeting(x, kind, x.value(2, "u32"), predicate(x.operands[1])), "b32")


def with_predicate(x: Instruction) -> str:
    """Address of the predicate of a destination `register|predicate`, which loses it."""
    x.operands[0], _, got = x.operands[0].partition("|")
    return f"&{c_name(got)}" if got else "0"


@opcode("match", modifiers="sync any all")
def match(x: Instruction) -> str:
    needs_sync(x)
    if x.kind != "b32":
        raise CannotTranslate(x.text)
    got = with_predicate(x)
    kind = x.one_of({"any": "MATCH_ANY", "all": "MATCH_ALL"})
    return x.gives(meeting(x, kind, x.value(2, "u32"), x.value(1), got=got), "b32")


@opcode("shfl", modifiers="sync idx up down bfly")
def shuffle(x: Instruction) -> str:
    needs_sync(x)
    got = with_predicate(x)
    kind = x.one_of({"idx": "IDX", "up": "UP", "down": "DOWN", "bfly": "BFLY"})
    lane, clamp, mask = (x.value(i, "u32") for i in (2, 3, 4))
    return x.gives(meeting(x, kind, mask, x.value(1), lane, clamp, got), "b32")


@opcode("activemask")
def active_mask(x: Instruction) -> str:
    return x.gives("(1u << (w->tid & 31))")  # a thread knows of itself only


ORDERS = "weak volatile relaxed acquire release acq_rel cta gpu sys"
SPACES = "global shared local const param"


@opcode("membar", "fence", modifiers=f"{ORDERS} gl sc")
def fence(x: Instruction) -> str:
    return "__sync_synchronize();"


@opcode("ld", "ldu", modifiers=f"{SPACES} {ORDERS} nc v2 v4 ca cg cs lu cv")
def load(x: Instruction) -> str:
    return memory.load(x.operands[0], x.operands[1], x.kind, x.space, x.function)


@opcode("st", modifiers=f"{SPACES} {ORDERS} v2 v4 wb cg cs wt")
def store(x: Instruction) -> str:
    return memory.store(x.operands[0], x.operands[1], x.kind, x.space, x.function)


ACTIONS = dict.fromkeys(("cas", "exch", *memory.NEW))


@opcode("atom", "red", modifiers=f"{SPACES} {ORDERS} {' '.join(ACTIONS)}")
def atomic(x: Instruction) -> str:
    action = x.one_of({each: each for each in ACTIONS})
    to, operands = (x.operands[0], x.operands[1:]) if x.opcode == "atom" else ("_", x.operands)
    return memory.atomic(action, to, operands, x.kind, x.space, x.function)


@opcode("cvta", modifiers=f"to {SPACES}")
def convert_address(x: Instruction) -> str:
    return x.gives(x.value(1, "u64"), "u64")  # all spaces are one


# Copies and choices ---------------------------------------------------------------------------------------------------


def part_bits(x: Instruction, parts: list[str]) -> int:
    """Bits of each of several registers that are one number together."""
    bits = 8 * BYTES[x.kind] // len(parts)
    if bits not in (16, 32):
        raise CannotTranslate(x.text)
    return bits


@opcode("mov")
def move(x: Instruction) -> str:
    to, what = x.operands
    if what.startswith("{"):
        parts = split_operands(what[1:-1])
        bits = part_bits(x, parts)
        values = (value_of(each, f"b{bits}", x.function) for each in parts)
        return x.gives(
            f"({' | '.join(f'((uint64_t){each} << {bits * i})' for i, each in enumerate(values))})"
        )
    if to.startswith("{"):
        parts = split_operands(to[1:-1])
        bits = part_bits(x, parts)
        sets = (
            set_register(each, f"b{bits}", f"(t_ >> {bits * i})", x.function) for i, each in enumerate(parts)
        )
        return f"{{ uint64_t t_ = {x.value(1)}; {' '.join(sets)} }}"
    if x.kind == "pred":
        return f"{c_name(to)} = {predicate(what)};"
    return x.gives(x.value(1))


COMPARISONS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
OF_UNSIGNED = {**COMPARISONS, "lo": "<", "ls": "<=", "hi": ">", "hs": ">="}
OF_FLOATS = {
    **{name: f"({{a}} {sign} {{b}})" for name, sign in COMPARISONS.items() if name != "ne"},
    "ne": "(({a} < {b}) || ({a} > {b}))",
    "nan": "(isnan({a}) || isnan({b}))",
    "num": "!(isnan({a}) || isnan({b}))",
    "equ": "!(({a} < {b}) || ({a} > {b}))",
    "neu": "!({a} == {b})",
    "ltu": "!({a} >= {b})",
    "leu": "!({a} > {b})",
    "gtu": "!({a} <= {b})",
    "geu": "!({a} < {b})",
}
"""Comparisons of floating-point numbers: with a NaN those that end in `u` are true, the others but `nan` false."""
LOGIC = {"and": "&", "or": "|", "xor": "^"}
JOINS = {"and": "&&", "or": "||", "xor": "!="}


@opcode("setp", modifiers=" ".join({**OF_FLOATS, **OF_UNSIGNED, **JOINS, "ftz": ""}))
def compare(x: Instruction) -> str:
    comparison, *others = x.modifiers
    known = OF_FLOATS if is_float(x.kind) else OF_UNSIGNED if x.kind[0] == "u" else COMPARISONS
    if comparison not in known:
        raise CannotTranslate(x.text)
    if is_float(x.kind):
        found = OF_FLOATS[comparison].format(a=x.value(1), b=x.value(2))
    else:
        found = f"({x.value(1)} {known[comparison]} {x.value(2)})"
    if "|" in x.operands[0]:
        raise CannotTranslate(f"{x.text} (two destinations)")
    if set(others) & set(JOINS):
        found = f"({found} {x.one_of(JOINS)} {predicate(x.operands[3])})"
    return f"{c_name(x.operands[0])} = {found};"


@opcode("selp")
def select(x: Instruction) -> str:
    return x.gives(f"({c_name(x.operands[3])} ? {x.value(1)} : {x.value(2)})")


@opcode("testp", modifiers="finite infinite number notanumber")
def test_property(x: Instruction) -> str:
    name = x.one_of({"finite": "isfinite", "infinite": "isinf", "number": "!isnan", "notanumber": "isnan"})
    return f"{c_name(x.operands[0])} = {name}({x.value(1)});"


# Bits -----------------------------------------------------------------------------------------------------------------


@opcode("and", "or", "xor")
def logic(x: Instruction) -> str:
    sign = LOGIC[x.opcode]
    if x.kind == "pred":
        to, a, b = x.operands
        return f"{c_name(to)} = {predicate(a)} {sign} {predicate(b)};"
    return x.gives(f"({x.value(1)} {sign} {x.value(2)})")


@opcode("not")
def complement(x: Instruction) -> str:
    if x.kind == "pred":
        return f"{c_name(x.operands[0])} = !{c_name(x.operands[1])};"
    return x.gives(f"(~{x.value(1)})")


@opcode("shl", "shr")
def shift(x: Instruction) -> str:
    """A shift by all bits or more gives 0, or the sign in each bit: C leaves it undefined."""
    bits = 8 * BYTES[x.kind]
    by = f"uint32_t s_ = {x.value(2, 'u32')};"
    if x.opcode == "shl":
        return x.gives(f"({{ {by} s_ >= {bits} ? 0 : ({C_TYPES[unsigned(x.kind)]}){x.value(1)} << s_; }})")
    if x.kind[0] == "s":
        return x.gives(f"({{ {by} {x.value(1)} >> (s_ >= {bits} ? {bits - 1} : s_); }})")
    return x.gives(f"({{ {by} s_ >= {bits} ? 0 : {x.value(1, unsigned(x.kind))} >> s_; }})")


@opcode("shf", modifiers="l r wrap clamp")
def funnel_shift(x: Instruction) -> str:
    """A shift of two words [operand 2, operand 1] as one, of which it gives the upper (left) or lower word."""
    found = x.one_of({"l": "((v_ << s_) >> 32)", "r": "(v_ >> s_)"})
    mode = x.one_of({"wrap": "wrap", "clamp": "clamp"})
    return x.gives(
        f"({{ uint32_t s_ = {x.value(3, 'u32')}; uint64_t v_ = ((uint64_t){x.value(2)} << 32) | {x.value(1)}; "
        f"s_ = \"{mode}\"[0] == 'w' ? s_ & 31 : (s_ > 32 ? 32 : s_); (uint32_t){found}; }})"
    )


@opcode("popc")
def count_bits(x: Instruction) -> str:
    return x.gives(f"__builtin_popcountll({x.value(1)})", "u32")


@opcode("clz")
def leading_zeros(x: Instruction) -> str:
    function = f"__builtin_clz{'ll' if x.kind == 'b64' else ''}"
    return x.gives(f"({x.value(1)} ? {function}({x.value(1)}) : {8 * BYTES[x.kind]})", "u32")


@opcode("bfe")
def extract_bits(x: Instruction) -> str:
    at = f"uint32_t p_ = {x.value(2, 'u32')} & 255, l_ = {x.value(3, 'u32')} & 255;"
    if x.kind[0] == "s":
        value = f"int64_t v_ = (int64_t){x.value(1)} >> (p_ < 64 ? p_ : 63);"
        found = "l_ == 0 ? 0 : l_ >= 64 ? v_ : (int64_t)((uint64_t)v_ << (64 - l_)) >> (64 - l_)"
    else:
        value = f"uint64_t v_ = p_ < 64 ? (uint64_t){x.value(1)} >> p_ : 0;"
        found = "l_ >= 64 ? v_ : v_ & (1ull << l_) - 1"
    return x.gives(f"({{ {at} {value} {found}; }})")


@opcode("bfi")
def insert_bits(x: Instruction) -> str:
    return x.gives(
        f"({{ uint64_t a_ = {x.value(1)}, b_ = {x.value(2)}; "
        f"uint32_t p_ = {x.value(3, 'u32')} & 255, l_ = {x.value(4, 'u32')} & 255; "
        "uint64_t m_ = l_ >= 64 ? ~0ull : (1ull << l_) - 1; "
        "p_ < 64 ? (b_ & ~(m_ << p_)) | ((a_ & m_) << p_) : b_; })"
    )


# Numbers --------------------------------------------------------------------------------------------------------------


def with_carry(x: Instruction) -> str:
    """Sums, differences and products whose carry (`.cc`) the next of them (`addc`, `subc`, `madc`) takes in."""
    bits = 8 * BYTES[x.kind]
    word, wide = f"uint{bits}_t", "uint64_t" if bits == 32 else "unsigned __int128"
    in_ = "+ cc_" if x.opcode.endswith("c") else ""
    kind = unsigned(x.kind)  # of signed numbers, too, the carry is that of their bits
    if x.opcode.startswith("mad"):
        product = f"({wide})({word})(({wide}){x.value(1)} * ({wide}){x.value(2)}"
        product += f" >> {bits})" if "hi" in x.modifiers else ")"
        found = f"{product} + ({wide}){x.value(3, kind)} {in_}"
    elif x.opcode.startswith("add"):
        found = f"({wide}){x.value(1, kind)} + ({wide}){x.value(2, kind)} {in_}"
    else:
        found = f"({wide}){x.value(1, kind)} - ({wide}){x.value(2, kind)} {in_.replace('+', '-')}"
    x.function.carries = True
    out = f"cc_ = (uint32_t)(w_ >> {bits}) & 1; " if "cc" in x.modifiers else ""
    return f"{{ {wide} w_ = {found}; {out}{set_register(x.operands[0], x.kind, f'({word})w_', x.function)} }}"


@opcode("add", "sub", modifiers="cc rn ftz")
def add(x: Instruction) -> str:
    if "cc" in x.modifiers:
        return with_carry(x)
    kind = x.kind if is_float(x.kind) else unsigned(x.kind)
    return x.gives(f"({x.value(1, kind)} {'+' if x.opcode == 'add' else '-'} {x.value(2, kind)})", kind)


@opcode("addc", "subc", modifiers="cc")
def add_carry(x: Instruction) -> str:
    return with_carry(x)


@opcode("madc", modifiers="cc lo hi")
def multiply_add_carry(x: Instruction) -> str:
    return with_carry(x)


def wide_product(x: Instruction) -> tuple[str, str]:
    """C expression of the product of operands 1 and 2, and its type, of twice the bits."""
    kind = x.kind[0] + str(16 * BYTES[x.kind])
    return f"({C_TYPES[kind]}){x.value(1)} * ({C_TYPES[kind]}){x.value(2)}", kind


@opcode("mul", modifiers="lo hi wide rn ftz")
def multiply(x: Instruction) -> str:
    if is_float(x.kind):
        return x.gives(f"({x.value(1)} * {x.value(2)})")
    half = x.one_of({each: each for each in ("lo", "hi", "wide")})
    if half == "lo":
        kind = unsigned(x.kind)
        return x.gives(
            f"({C_TYPES[kind]})((uint64_t){x.value(1, kind)} * (uint64_t){x.value(2, kind)})", kind
        )
    if half == "wide":
        product, kind = wide_product(x)
        return x.gives(f"({product})", kind)
    huge = "unsigned __int128" if x.kind[0] == "u" else "__int128"
    wide = huge if BYTES[x.kind] == 8 else C_TYPES[f"{x.kind[0]}{16 * BYTES[x.kind]}"]
    return x.gives(
        f"({C_TYPES[x.kind]})((({wide}){x.value(1)} * ({wide}){x.value(2)}) >> {8 * BYTES[x.kind]})"
    )


@opcode("mad", modifiers="lo hi wide cc")
def multiply_add(x: Instruction) -> str:
    if "cc" in x.modifiers:
        return with_carry(x)
    if "lo" in x.modifiers:
        kind = unsigned(x.kind)
        return x.gives(f"({x.value(1, kind)} * {x.value(2, kind)} + {x.value(3, kind)})", kind)
    if "wide" in x.modifiers:
        product, kind = wide_product(x)
        return x.gives(f"({product} + {x.value(3, kind)})", kind)
    raise CannotTranslate(x.text)


@opcode("div", modifiers="rn approx full ftz")
def divide(x: Instruction) -> str:
    if is_float(x.kind):
        return x.gives(f"({x.value(1)} / {x.value(2)})")
    c_type = C_TYPES[x.kind]
    return x.gives(f"({{ {c_type} d_ = {x.value(2)}; d_ == 0 ? ({c_type})-1 : {x.value(1)} / d_; }})")


@opcode("rem")
def remainder(x: Instruction) -> str:
    return x.gives(
        f"({{ {C_TYPES[x.kind]} d_ = {x.value(2)}; d_ == 0 ? {x.value(1)} : {x.value(1)} % d_; }})"
    )


@opcode("rcp", modifiers="rn approx ftz")
def reciprocal(x: Instruction) -> str:
    return x.gives(f"(1.0{'f' if x.kind == 'f32' else ''} / {x.value(1)})")


@opcode("rsqrt", modifiers="approx ftz")
def reciprocal_root(x: Instruction) -> str:
    return x.gives(f"(1.0 / sqrt({x.value(1)}))")


FUNCTIONS = {
    "fma": ("fma", 1, 2, 3),
    "sqrt": ("sqrt", 1),
    "lg2": ("log2", 1),
    "ex2": ("exp2", 1),
    "sin": ("sin", 1),
    "cos": ("cos", 1),
    "abs": ("fabs", 1),
    "copysign": ("copysign", 2, 1),  # the sign of operand 1
    "min": ("fmin", 1, 2),
    "max": ("fmax", 1, 2),
}
"""Instructions on floating-point numbers that are a function of C, and their operands."""


@opcode(*FUNCTIONS, modifiers="rn approx ftz")
def function_of_c(x: Instruction) -> str:
    if not is_float(x.kind):
        raise CannotTranslate(x.text)
    name, *operands = FUNCTIONS[x.opcode]
    return x.gives(f"{name}{'f' if x.kind == 'f32' else ''}({', '.join(x.value(i) for i in operands)})")


@opcode("neg", modifiers="ftz")
def negate(x: Instruction) -> str:
    return x.gives(f"(-{x.value(1)})")


@opcode("abs", modifiers="ftz")
def absolute(x: Instruction) -> str:
    if is_float(x.kind):
        return function_of_c(x)
    return x.gives(f"({x.value(1)} < 0 ? -{x.value(1)} : {x.value(1)})")


@opcode("min", "max", modifiers="ftz")
def extreme(x: Instruction) -> str:
    if is_float(x.kind):
        return function_of_c(x)
    sign = "<" if x.opcode == "min" else ">"
    return x.gives(f"({x.value(1)} {sign} {x.value(2)} ? {x.value(1)} : {x.value(2)})")


ROUNDING = {"rmi": "floor", "rpi": "ceil", "rni": "rint", "rzi": "trunc"}
"""Rounding to a whole number -> function of C."""


def to_integer(value: str, of: str, to: str) -> str:
    """C of a whole number as an integer, or the nearest one. NaN gives 0, but to or from 64 bits the top bit alone."""
    n = 8 * BYTES[to]
    if to[0] not in "su":
        raise CannotTranslate(f"cvt.{to}.{of}")
    nan = f"1ull << {n - 1}" if 8 in (BYTES[to], BYTES[of]) else "0"
    return f"d2{to[0]}({value}, {2.0 ** (n - (to[0] == 's')):.1f}, {nan})"


@opcode("cvt", modifiers=" ".join([*ROUNDING, "rn", "ftz", "sat"]))
def convert(x: Instruction) -> str:
    to, of = x.modifiers[-2:]
    value = x.value(1)
    if is_float(of) and is_float(to):
        if set(x.modifiers) & set(ROUNDING):
            value = f"{x.one_of(ROUNDING)}{'f' if of == 'f32' else ''}({value})"
        if "sat" in x.modifiers:
            value = f"fmin(fmax({value}, 0.0), 1.0)"
    elif is_float(of):
        return x.gives(f"({C_TYPES[to]}){to_integer(f'{x.one_of(ROUNDING)}((double){value})', of, to)}", to)
    elif "sat" in x.modifiers:
        raise CannotTranslate(f"{x.text} (.sat)")
    return x.gives(f"(({C_TYPES[to]}){value})", to)
