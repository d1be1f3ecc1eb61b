"""Memory of PTX in C: variables of a module, addresses, loads, stores and atomic operations."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator

from .ptx_types import (
    BYTES,
    C_TYPES,
    FROM_BITS,
    TO_BITS,
    CannotTranslate,
    Function,
    Module,
    c_name,
    set_register,
    split_operands,
    value_of,
)

LINKAGE = r"^\.(?:visible\s+|weak\s+|extern\s+)*\.?"
GLOBAL = re.compile(
    LINKAGE + r"(?:global|const)\s+(?:\.align\s+\d+\s+)?\.(\w+)\s+([\w$]+)(?:\[(\d*)\])?(?:\s*=\s*([^;]+))?;", re.M
)  # fmt: skip
SHARED = re.compile(LINKAGE + r"shared\s+(?:\.align\s+\d+\s+)?\.(\w+)\s+([\w$]+)\[(\d*)\];", re.M)
LITERAL = re.compile(r"\b0(?:[dD]([0-9A-Fa-f]{16})|[fF]([0-9A-Fa-f]{8}))\b")
MOST_SHARED = 49152
"""Bytes of shared arrays that a kernel of Taichi can have: it launches with none beside those declared."""
NEW = {
    "add": "(o_ + {v})",
    "min": "({v} < o_ ? {v} : o_)",
    "max": "({v} > o_ ? {v} : o_)",
    "and": "(o_ & {v})",
    "or": "(o_ | {v})",
    "xor": "(o_ ^ {v})",
}
"""Atomic operation -> what replaces the old value `o_`, of that and of `v`."""


def float_of(literal: re.Match[str]) -> str:
    """A constant of C, in hexadecimal digits, of the bits of a floating-point number."""
    (number,) = struct.unpack(">d" if literal[1] else ">f", bytes.fromhex(literal[1] or literal[2]))
    if not math.isfinite(number):
        raise CannotTranslate(f"the initial value {literal[0]}")
    return float.hex(number)


def variables(source: str, module: Module) -> Iterator[str]:
    """C declarations of the variables of a module, whose names it learns; and M_poison, which fills shared ones."""
    for m in GLOBAL.finditer(source):
        kind, name, length, start = m.groups()
        if start and re.search(r"[A-Za-z_$]", re.sub(r"0[xdfXDF][0-9A-Fa-f]+", "", start)):
            raise CannotTranslate(f"the initial value of {name}: {start}")
        module.variables.add(name)
        start = LITERAL.sub(float_of, start or "")
        braced = start if not start or start.strip().startswith("{") else "{" + start + "}"
        yield (
            f"static {C_TYPES[kind]} G_{c_name(name)}[{int(length or 1)}] __attribute__((aligned(16)))"
            f"{' = ' + braced if braced else ''};"
        )
    for m in SHARED.finditer(source):
        kind, name, length = m.groups()
        if not length:
            raise CannotTranslate(
                f"{name}: a shared array of more than 48 KiB. Taichi 1.7.4 declares it without a size and launches "
                "with 0 bytes for it: on a GPU it would lie outside of the block's shared memory"
            )
        module.variables.add(name)
        module.shared[name] = int(length) * BYTES[kind]
        yield f"static __thread {C_TYPES[kind]} G_{c_name(name)}[{length}] __attribute__((aligned(16)));"
    fills = (f" memset(G_{c_name(name)}, 0xA5, sizeof G_{c_name(name)});" for name in module.shared)
    yield "void M_poison(void) {" + "".join(fills) + " }"


def local_array(text: str, function: Function) -> str:
    """C declaration of an array in local memory, whose name the function learns."""
    name, length = re.search(r"([\w$]+)\[(\d+)\]", text).groups()
    function.arrays.add(name)
    return f"uint8_t {c_name(name)}[{length}] __attribute__((aligned(16)));"


def call_array(text: str, function: Function) -> str:
    """C declaration of what a call gives or takes (`.param` in a body), whose name the function learns."""
    bits, name, _, length = re.search(r"\.b(\d+)\s+([\w$]+)(\[(\d+)\])?", text).groups()
    function.arrays.add(name)
    return f"uint8_t {c_name(name)}[{max(int(length) if length else int(bits) // 8, 8)}] __attribute__((aligned(16)));"


def address(text: str, function: Function) -> str:
    """C expression of an address `[name+offset]`."""
    text = text.strip()[1:-1].strip()
    if m := re.fullmatch(r"(.+?)\s*\+\s*(-?\d+)", text):
        return f"({value_of(m[1], 'u64', function)} + ({m[2]}ll))"
    return value_of(text, "u64", function)


def load(to: str, where: str, kind: str, space: int, function: Function) -> str:
    """C of a load into a register, or of consecutive numbers into `{several}`; space: 4 of shared memory, else 0."""
    at = address(where, function)
    if not to.startswith("{"):
        return "{ " + set_register(to, kind, f"LD({C_TYPES[kind]}, {at}, {space})", function) + " }"
    each = (
        set_register(name, kind, f"LD({C_TYPES[kind]}, a_ + {BYTES[kind] * i}, {space})", function)
        for i, name in enumerate(split_operands(to[1:-1]))
    )
    return f"{{ uint64_t a_ = {at}; {' '.join(each)} }}"


def store(where: str, what: str, kind: str, space: int, function: Function) -> str:
    """C of a store of an operand, or of `{several}` as consecutive numbers; space as in `load`."""
    at = address(where, function)
    if not what.startswith("{"):
        return f"ST({C_TYPES[kind]}, {at}, {space}) = {value_of(what, kind, function)};"
    each = (
        f"ST({C_TYPES[kind]}, a_ + {BYTES[kind] * i}, {space}) = {value_of(text, kind, function)};"
        for i, text in enumerate(split_operands(what[1:-1]))
    )
    return f"{{ uint64_t a_ = {at}; {' '.join(each)} }}"


def atomic(action: str, to: str, operands: list[str], kind: str, space: int, function: Function) -> str:
    """C of an atomic operation on [address, value, value to set if equal], which gives what was there."""
    word, c_type = f"uint{BYTES[kind] * 8}_t", C_TYPES[kind]
    to_bits, from_bits = TO_BITS.get(kind, f"({word})"), FROM_BITS.get(kind, f"({c_type})")
    at, value = address(operands[0], function), value_of(operands[1], kind, function)
    if action == "cas":
        other = value_of(operands[2], kind, function)
        act = (
            f"{word} old_ = {to_bits}({value}); "
            f"__atomic_compare_exchange_n(x_, &old_, {to_bits}({other}), 0, 5, 5);"
        )
    elif action == "exch":
        act = f"{word} old_ = __atomic_exchange_n(x_, {to_bits}({value}), 5);"
    else:
        new = NEW[action].format(v=value)
        act = (
            f"{word} old_ = *(volatile {word} *)x_; for (;;) {{ {c_type} o_ = {from_bits}(old_); "
            f"{word} n_ = {to_bits}(({c_type}){new}); "
            "if (__atomic_compare_exchange_n(x_, &old_, n_, 0, 5, 5)) break; }"
        )
    given = "" if to == "_" else " " + set_register(to, kind, f"{from_bits}(old_)", function)
    return f"{{ {word} *x_ = AT(({word} *)({at}), {space}); {act}{given} }}"
