"""Types of PTX in C; operands and registers as C expressions."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

C_TYPES = {
    "pred": "uint8_t",
    "b8": "uint8_t",
    "u8": "uint8_t",
    "s8": "int8_t",
    "b16": "uint16_t",
    "u16": "uint16_t",
    "s16": "int16_t",
    "b32": "uint32_t",
    "u32": "uint32_t",
    "s32": "int32_t",
    "b64": "uint64_t",
    "u64": "uint64_t",
    "s64": "int64_t",
    "f32": "float",
    "f64": "double",
}
"""Type of PTX -> type of C."""
BYTES = {name: 1 if name == "pred" else int(name[1:]) // 8 for name in C_TYPES}
"""Type of PTX -> its size."""
TO_BITS, FROM_BITS = {"f64": "D2B", "f32": "F2B"}, {"f64": "B2D", "f32": "B2F"}
"""Macros of prelude.c between a floating-point number and its bits."""
SPECIAL = {
    "%tid.x": "w->tid",
    "%ntid.x": "w->ntid",
    "%ctaid.x": "w->ctaid",
    "%nctaid.x": "w->nctaid",
    **dict.fromkeys(("%tid.y", "%tid.z", "%ctaid.y", "%ctaid.z"), "0u"),
    "%laneid": "(w->tid & 31)",
    "WARP_SZ": "32u",
    "%clock64": "0ull",
}
"""Special registers of a thread. Launches have one dimension, and no clock runs."""


class CannotTranslate(Exception):
    """PTX that the emulator does not know."""

    def __init__(self, what: str) -> None:
        super().__init__(f"ptx2c: cannot translate: {what}")


@dataclass
class Module:
    """Names of a module of PTX."""

    variables: set[str] = field(default_factory=set)  # global and shared
    shared: dict[str, int] = field(default_factory=dict)  # shared array -> its bytes
    functions: set[str] = field(default_factory=set)
    sites: int = 0  # instructions so far at which threads meet


@dataclass
class Function:
    """Names of a function of PTX, as far as it is translated."""

    module: Module
    parameters: dict[str, int]  # name -> place
    registers: dict[str, str] = field(default_factory=dict)  # name -> type
    arrays: set[str] = field(default_factory=set)  # local memory, and what calls give and take
    scopes: list[dict[str, str]] = field(default_factory=list)  # registers outside of each open brace
    targets: dict[str, list[str]] = field(default_factory=dict)  # label of .branchtargets -> labels
    carries: bool = False  # whether an instruction has a carry

    def meeting(self) -> int:
        """Number of the next instruction at which threads meet."""
        self.module.sites += 1
        return self.module.sites


def is_float(kind: str) -> bool:
    return kind in ("f32", "f64")


def unsigned(kind: str) -> str:
    """The unsigned type of the same size: C leaves overflow of signed numbers undefined, PTX drops the carry."""
    return "u" + kind[1:]


def c_name(name: str) -> str:
    return name.replace(".", "_dot_").replace("%", "r_")


def c_label(name: str) -> str:
    return name.replace("$", "D")


def split_operands(text: str) -> list[str]:
    """Operands between the commas that stand outside of brackets."""
    parts, depth, current = [], 0, ""
    for letter in text:
        if letter in "{[(":
            depth += 1
        if letter in "}])":
            depth -= 1
        if letter == "," and depth == 0:
            parts.append(current.strip())
            current = ""
        else:
            current += letter
    if current.strip():
        parts.append(current.strip())
    return parts


def number(text: str, kind: str) -> str | None:
    """C expression of a literal number as this type, None if it is none."""
    c_type = C_TYPES[kind]
    if m := re.fullmatch(r"0[dD]([0-9A-Fa-f]{16})", text):
        return f"B2D(0x{m[1]}ull)" if kind == "f64" else f"((({c_type})0x{m[1]}ull))"
    if m := re.fullmatch(r"0[fF]([0-9A-Fa-f]{8})", text):
        return f"B2F(0x{m[1]}u)" if kind == "f32" else f"(({c_type})0x{m[1]}u)"
    if re.fullmatch(r"-?\d+", text):
        if is_float(kind):
            raise CannotTranslate(f"the integer {text} as {kind}")
        return f"(({c_type}){int(text) & (2**64 - 1)}ull)"
    if re.fullmatch(r"-?0x[0-9a-fA-F]+", text):
        return f"(({c_type}){text}ull)"
    return None


def value_of_register(name: str, kind: str, function: Function) -> str:
    c_type, own = C_TYPES[kind], function.registers.get(name)
    if own is None:
        raise CannotTranslate(f"unknown register {name}")
    c = c_name(name)
    if own == "pred":
        raise CannotTranslate(f"{name} is a predicate used as {kind}")
    if is_float(own) and is_float(kind):
        if own != kind:
            raise CannotTranslate(f"{name} is {own} used as {kind}")
        return c
    if is_float(own):
        return f"(({c_type}){TO_BITS[own]}({c}))"
    return f"{FROM_BITS[kind]}({c})" if is_float(kind) else f"(({c_type}){c})"


def value_of(text: str, kind: str, function: Function) -> str:
    """C expression of an operand as this type: a number, a register, or the address of a name."""
    text = text.strip()
    if found := number(text, kind):
        return found
    if text in SPECIAL:
        return SPECIAL[text]
    if text.startswith("%") or text in function.registers:
        return value_of_register(text, kind, function)
    if text in function.parameters:
        return f"((uint64_t)args[{function.parameters[text]}])"
    if text in function.arrays:
        return f"((uint64_t){c_name(text)})"
    if text in function.module.variables:
        return f"((uint64_t)G_{c_name(text)})"
    if text in function.module.functions:
        return f"((uint64_t)(void *)F_{c_name(text)})"
    if m := re.fullmatch(r"([A-Za-z_$][\w$]*)\+(\d+)", text):
        return f"({value_of(m[1], kind, function)} + {m[2]})"
    raise CannotTranslate(f"operand {text}")


def predicate(text: str) -> str:
    """C expression of a predicate, perhaps negated, or of a literal one."""
    if text in ("0", "1", "-1"):
        return "0" if text == "0" else "1"
    return ("!" if text.startswith("!") else "") + c_name(text.lstrip("!"))


def set_register(name: str, kind: str, expression: str, function: Function) -> str:
    """C statement that gives a register an expression of this type, sign- or zero-extended as the type says."""
    name = name.strip()
    if name == "_":  # thrown away
        return ""
    own = function.registers.get(name)
    if own is None:
        raise CannotTranslate(f"destination {name}")
    c = c_name(name)
    if own == "pred":
        raise CannotTranslate(f"destination {name} is a predicate, given {kind}")
    if is_float(own) and is_float(kind):
        if own != kind:
            raise CannotTranslate(f"destination {name} is {own}, given {kind}")
        return f"{c} = {expression};"
    if is_float(own):
        return f"{c} = {FROM_BITS[own]}({expression});"
    if is_float(kind):
        return f"{c} = {TO_BITS[kind]}({expression});"
    return f"{c} = ({C_TYPES[own]})({C_TYPES[kind]})({expression});"
