"""PTX to C, one function a kernel and thread: `python -m emulator.ptx2c IN OUT`. Unknown PTX is an error.

Threads of a block meet at barriers, shuffles and votes: there the C code calls `w->meet`, for which cuda_stub.c runs
each thread on a stack of its own. Compiled with -DWARP it counts visits of basic blocks, with -DTOUCH it reports
accesses to `w->touch`.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from . import memory
from .cycles import CLASSES, CYCLES, MEETINGS, class_of, overlapped
from .instructions import to_c
from .ptx_types import C_TYPES, CannotTranslate, Function, Module, c_label, c_name

HERE = Path(__file__).parent
HEADER = re.compile(
    r"^((?:\.(?:visible|extern|weak)\s+)*)\.(entry|func)\s*(\([^)]*\))?\s*([\w$]+)\s*\(([^)]*)\)\s*"
    r"((?:\.\w+[^\n{;]*\n?)*)\s*([{;])",
    re.M,
)
CALL = re.compile(
    r"(@(!?)(%\w+)\s+)?call(?:\.uni)?\s*(?:\(\s*([\w$]+)\s*\)\s*,)?\s*(%?[\w$]+)\s*(?:,\s*\(([^)]*)\))?\s*(?:,\s*\w+)?$",
    re.S,
)
MEETS = re.compile(rf"\b(?:{'|'.join(MEETINGS)})\.")
IN_PRELUDE = ("vprintf", "__assertfail", "malloc", "free")
"""Functions of the CUDA runtime that prelude.c has."""


class Definition(NamedTuple):
    """A function as it stands in a module; of one that is only declared the body is None."""

    is_kernel: bool
    result: str | None
    name: str
    parameters: str
    body: str | None


def without_comments(source: str) -> str:
    return re.sub(r"/\*.*?\*/", "", re.sub(r"//[^\n]*", "", source), flags=re.S)


def definitions(source: str) -> list[Definition]:
    """All functions of a module; of a name that is declared and defined the definition."""
    found = []
    for m in HEADER.finditer(source):
        body = None
        if m[7] == "{":
            depth, end = 1, m.end()
            while depth:
                depth += {"{": 1, "}": -1}.get(source[end], 0)
                end += 1
            body = source[m.end() : end - 1]
        found.append(Definition(m[2] == "entry", m[3], m[4], m[5], body))
    defined = {each.name for each in found if each.body is not None}
    return [each for each in found if each.body is not None or each.name not in defined]


class Calls:
    """Which functions a function can come to."""

    def __init__(self, functions: list[Definition]) -> None:
        self.bodies = {each.name: each.body for each in functions if each.body is not None}
        names = {each.name for each in functions}
        self.called = {name: set(re.findall(r"[\w$]+", body)) & names for name, body in self.bodies.items()}

    def bodies_from(self, name: str) -> list[str]:
        """Bodies of a function and of all that it, or one that it calls, calls."""
        found, left = set[str](), [name]
        while left:
            name = left.pop()
            if name not in found:
                found.add(name)
                left += self.called.get(name, ())
        return [self.bodies.get(each, "") for each in found]


@dataclass
class Blocks:
    """Basic blocks of a module, by which STUB_WARP counts."""

    code: list[list[str]] = field(default_factory=list)  # instructions of each

    def begin(self) -> str:
        self.code.append([])
        return f"VISIT({len(self.code) - 1})"

    def tables(self) -> Iterator[str]:
        """C of the tables that cuda_stub.c reads."""
        yield f"int M_blocks = {len(self.code)};"
        counts = (Counter(map(class_of, code)) for code in self.code)
        rows = ", ".join("{" + ", ".join(str(count[k]) for k in CLASSES) + "}" for count in counts)
        yield f"const uint16_t M_classes[][{len(CLASSES)}] = {{{rows}}};"
        yield f"const uint16_t M_cycles[] = {{{', '.join(str(CYCLES[k]) for k in CLASSES)}}};"
        chains = ", ".join(str(min(overlapped(code), 65535)) for code in self.code)
        yield f"const uint16_t M_overlapped[] = {{{chains}}};"


def parameter_name(text: str) -> str:
    return re.search(r"([\w$]+)(\[\d*\])?\s*$", text.strip())[1]


def signature(name: str) -> str:
    return f"static void F_{c_name(name)}(void *ret, void **args, Where *w)"


class Body:
    """The translation of a function's body: C declarations, which come first, and statements."""

    def __init__(self, definition: Definition, module: Module, blocks: Blocks) -> None:
        names = (parameter_name(each) for each in definition.parameters.split(",") if each.strip())
        self.function = Function(module, {name: i for i, name in enumerate(names)})
        self.blocks = blocks
        self.declarations: list[str] = []
        self.label = ""
        if definition.result:
            result = parameter_name(definition.result[1:-1])
            self.function.arrays.add(result)
            self.declarations.append(f"uint8_t *{c_name(result)} = ret;")
        self.statements = [blocks.begin()]
        self.translate(definition.body or "")
        if self.function.carries:
            self.declarations.append("uint32_t cc_ = 0;")

    def translate(self, body: str) -> None:
        """Go through labels, which end in a colon, statements, which end in a semicolon, and braces around calls."""
        body = re.sub(r"prototype_\d+\s*:\s*\.callprototype[^;]*;", "", body)
        body = re.sub(r"\.loc\s[^\n]*", "", body)
        at = 0
        while m := re.compile(r"\s*(?:([{}])|(\$?[\w$]+):|([^;]*);)").match(body, at):
            at = m.end()
            if m[1]:
                self.brace(m[1])
            elif m[2]:
                self.label = m[2]
                self.statements.append(f"{c_label(m[2])}: ; {self.blocks.begin()}")
            elif m[3].strip():
                self.statement(m[3].strip())
        if body[at:].strip():
            raise CannotTranslate(body[at:])

    def brace(self, which: str) -> None:
        self.statements.append(which)
        if which == "{":
            self.function.scopes.append(dict(self.function.registers))
        else:
            self.function.registers = self.function.scopes.pop()

    def statement(self, text: str) -> None:
        if text.startswith("."):
            self.directive(text)
        elif re.match(r"(@!?%\w+\s+)?call", text):
            self.call(text)
        else:
            self.statements.append(to_c(text, self.function))
            self.blocks.code[-1].append(text)
            if class_of(text) == "meet" or re.match(r"@!?%\w+\s+bra", text):
                self.statements.append(self.blocks.begin())

    def directive(self, text: str) -> None:
        kind = re.match(r"\.\w+", text)[0]
        if kind == ".reg":
            self.registers(text)
        elif kind == ".local":
            self.declarations.append(memory.local_array(text, self.function))
        elif kind == ".param":
            self.statements.append(memory.call_array(text, self.function))
        elif kind == ".branchtargets":  # of the label before, for brx.idx
            labels = text.split(None, 1)[1].split(",")
            self.function.targets[self.label] = [c_label(each.strip()) for each in labels]
        elif kind != ".pragma":
            raise CannotTranslate(f"directive {text}")

    def registers(self, text: str) -> None:
        """Declare registers: `%r<3>` are %r0 to %r2. One of an inner scope hides an outer one of its name."""
        kind, names = re.match(r"\.reg\s+\.(\w+)\s+(.*)", text, re.S).groups()
        for each in map(str.strip, names.split(",")):
            several = re.fullmatch(r"(%?[\w$]+)<(\d+)>", each)
            found = [f"{several[1]}{k}" for k in range(int(several[2]))] if several else [each]
            if self.function.scopes:
                self.function.registers.update(dict.fromkeys(found, kind))
                self.statements += [f"{C_TYPES[kind]} {c_name(name)} = 0;" for name in found]
                continue
            new = [name for name in found if name not in self.function.registers]
            self.function.registers.update(dict.fromkeys(new, kind))
            if not several:
                self.declarations += [f"{C_TYPES[kind]} {c_name(name)} = 0;" for name in new]
            elif int(several[2]) > 1:
                zeros = ", ".join(f"{c_name(name)} = 0" for name in found)
                self.declarations.append(f"{C_TYPES[kind]} {zeros};")

    def call(self, text: str) -> None:
        m = CALL.match(text)
        if not m:
            raise CannotTranslate(text)
        _, negated, asked, result, name, arguments = m.groups()
        given = [c_name(each.strip()) for each in (arguments or "").split(",") if each.strip()]
        function = f"((FP){c_name(name)})" if name.startswith("%") else f"F_{c_name(name)}"
        condition = f"if ({negated}{c_name(asked)}) " if asked else ""
        self.statements.append(
            f"{condition}{{ void *a_[] = {{{', '.join([*given, '0'])}}}; "
            f"{function}({c_name(result) if result else '0'}, a_, w); }}"
        )


def check_shared(name: str, calls: Calls, module: Module) -> None:
    """Shared arrays that a kernel uses must fit; raise CannotTranslate if not."""
    text = "\n".join(calls.bodies_from(name))
    total = sum(
        size for each, size in module.shared.items() if re.search(r"\b" + re.escape(each) + r"\b", text)
    )
    if total > memory.MOST_SHARED:
        raise CannotTranslate(f"{name}: {total} bytes of shared arrays; Taichi can have {memory.MOST_SHARED}")


def translated(source: str) -> Iterator[str]:
    """Lines of C of a module."""
    source = without_comments(source)
    yield (HERE / "prelude.c").read_text().replace('#include "where.h"\n', (HERE / "where.h").read_text())
    module, blocks = Module(), Blocks()
    yield from memory.variables(source, module)
    functions = definitions(source)
    calls = Calls(functions)
    module.functions = {each.name for each in functions}
    for each in functions:
        if each.body is not None:
            yield f"{signature(each.name)};"
        elif each.name not in IN_PRELUDE:
            yield f'{signature(each.name)} {{ fprintf(stderr, "extern {each.name}\\n"); abort(); }}'
    for each in functions:
        if each.body is None:
            continue
        if each.is_kernel:
            check_shared(each.name, calls, module)
        body = Body(each, module, blocks)
        yield f"{signature(each.name)} {{"
        yield from (f"  {line}" for line in (*body.declarations, *body.statements))
        yield "}"
        if each.is_kernel:
            name = c_name(each.name)
            meets = any(MEETS.search(text) for text in calls.bodies_from(each.name))
            yield f"void K_{name}(void **args, Where *w) {{ F_{name}(0, args, w); }}"
            yield f"int C_{name} = {int(meets)};"
    yield from blocks.tables()


def main(source: str, to: str) -> None:
    try:
        text = "\n".join(translated(Path(source).read_text())) + "\n"
    except CannotTranslate as error:
        raise SystemExit(str(error)) from None
    Path(to).write_text(text)


if __name__ == "__main__":
    main(*sys.argv[1:])
