"""Each instruction that the emulator knows, in kernels of a few lines, against exact integers and NumPy."""

from __future__ import annotations

import functools
import os
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from emulator import instruction_cases, meeting_cases
from emulator.device import CAN_RUN, NEEDS, Device
from emulator.instruction_cases import Case, bits, dtype, inputs_of, signed
from emulator.instructions import TABLE
from emulator.meeting_cases import Atomic, Meeting
from emulator.ptx2c import translated
from emulator.ptx_types import CannotTranslate

HEAD = ".version 7.8\n.target sm_90\n.address_size 64\n"
SCRATCH = (
    ".reg .pred %p, %q; .reg .b16 %h<4>; .reg .b32 %t<6>; .reg .b64 %l<4>; .reg .f32 %f<2>; .reg .f64 %g<2>;"
)


OF_MODULE = """
.global .align 8 .f64 half_five = 0d4004000000000000;
.const .align 4 .u32 of_constants[4] = {11, 22, 33, 44};
.shared .align 8 .b8 untouched[16];
.shared .align 4 .u32 of_block[64];
.shared .align 8 .b64 of_atoms[1];
.global .align 1 .b8 greeting[3] = {72, 105, 0};
.extern .func (.param .b32 func_retval0) vprintf(.param .b64 vprintf_0, .param .b64 vprintf_1);
.extern .func somewhere_else();
.func (.param .b32 func_retval0) three_and_one(.param .b32 three_and_one_0) {
.reg .b32 %r<3>; ld.param.u32 %r1, [three_and_one_0]; mad.lo.s32 %r2, %r1, 3, 1;
st.param.b32 [func_retval0+0], %r2; ret;
}
"""


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


class Group(NamedTuple):
    """A kernel of all cases that take the same types, of the same numbers."""

    cases: tuple[Case, ...]
    rows: list[tuple[Any, ...]]  # of inputs

    @property
    def name(self) -> str:
        return f"{self.cases[0].name} ... {self.cases[-1].name}"


def groups(cases: Iterable[Case]) -> list[Group]:
    together = defaultdict[Any, list[Case]](list)
    for case in cases:
        leaves = re.search(r"@%p (ret|exit);", case.body)
        together[case.name if leaves else (*case.inputs, case.within)].append(case)
    return [Group(tuple(each), inputs_of(each[0])) for each in together.values()]


def group_kernel(number: int, group: Group) -> str:
    """Parameters: %a, %b, ... of each thread, and an array (case, thread) of results, of 8 bytes each."""
    name, inputs = f"k{number}", group.cases[0].inputs
    text = f".reg .b32 %n, %m; mov.u32 %n, %tid.x; {SCRATCH} .local .align 16 .b8 scratch[32];\n"
    for i, (register, kind) in enumerate(zip("abce", inputs, strict=False)):
        text += f".reg .{register_type(kind)} %{register}; {element(name, i, kind)}"
        if kind == "pred":
            text += f"ld.global.u32 %m, [%w{i}]; setp.ne.s32 %{register}, %m, 0;\n"
        else:
            text += f"ld.global.{kind} %{register}, [%w{i}];\n"
    last = len(inputs)
    text += element(name, last, "b64")
    for k, case in enumerate(group.cases):
        operands = ", ".join(f"%{register}" for register in "dabce"[: last + 1])
        body = (case.body or f"{case.name} {operands};").replace("$", f"$L{number}_{k}_")
        text += f".reg .{register_type(case.output)} %d{k}; " + re.sub(r"%d\b", f"%d{k}", body) + "\n"
        place = f"%w{last}+{k * len(group.rows) * 8}"
        if case.output == "pred":
            text += f"selp.u32 %m, 1, 0, %d{k}; st.global.u32 [{place}], %m;\n"
        else:
            text += f"st.global.{case.output} [{place}], %d{k};\n"
    return entry(name, last + 1, text)


def atomic_kernel(number: int, case: Atomic) -> str:
    """Parameters: %a, %b, what `atom.global` gave, its cell, that of `red`, what `atom.shared` gave."""
    name, kind = f"a{number}", case.kind
    text = ".reg .b32 %n; mov.u32 %n, %tid.x; .reg .pred %p; .reg .b64 %l<3>;\n"
    text += f".reg .{register_type(kind)} %a, %b, %d;" + "".join(element(name, i, kind) for i in (0, 1, 2, 5))
    text += f"ld.global.{kind} %a, [%w0]; ld.global.{kind} %b, [%w1];\n"
    more = ", %b" if case.name.startswith("cas") else ""
    text += f"ld.param.u64 %l0, [{name}_3]; ld.param.u64 %l1, [{name}_4]; mov.u64 %l2, of_atoms;\n"
    text += f"setp.ne.s32 %p, %n, 0; @%p bra $GO{number}; st.shared.{kind} [%l2], %a;\n$GO{number}:\n"
    text += f"atom.global.{case.name} %d, [%l0], %a{more}; st.global.{kind} [%w2], %d;\n"
    if not more:
        text += f"red.global.{case.name} [%l1+8], %a;\n"
    text += f"atom.shared.{case.name} %d, [%l2], %b{', %a' if more else ''}; st.global.{kind} [%w5], %d;"
    return entry(name, 6, text)


def meeting_kernel(number: int, case: Meeting) -> str:
    """Parameters %a, %b, %d and %q of each thread of all blocks; %n is its number in the block."""
    name = f"m{number}"
    text = (
        SCRATCH + ".reg .b32 %n, %a, %b, %d; mov.u32 %t0, %ctaid.x; mov.u32 %t1, %ntid.x; mov.u32 %n, %tid.x;"
    )
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


GROUPS = groups(instruction_cases.all_cases())
ATOMICS = list(meeting_cases.atomics())
MEETINGS = list(meeting_cases.meetings())


@functools.cache
def module() -> str:
    kernels = [
        *(group_kernel(*each) for each in enumerate(GROUPS)),
        *(atomic_kernel(*each) for each in enumerate(ATOMICS)),
        *(meeting_kernel(*each) for each in enumerate(MEETINGS)),
        turn_kernel("turns", ""),
        turn_kernel("turns_met", "bar.sync 0;"),
    ]
    return HEAD + OF_MODULE + "".join(kernels)


on_emulator = pytest.mark.skipif(not CAN_RUN, reason=NEEDS)


@pytest.fixture(scope="module")
def device(tmp_path_factory: pytest.TempPathFactory) -> Device:
    return Device(tmp_path_factory.mktemp("emulator"), module())


def numbered(cases: list[Any]) -> Any:
    return pytest.mark.parametrize(
        ("number", "case"), list(enumerate(cases)), ids=[each.name for each in cases]
    )


def as_array(values: Sequence[Any], kind: str) -> np.ndarray:
    """An array of a type, of the low bits of integers."""
    if kind[0] != "f":
        n = 8 * dtype(kind).itemsize
        values = [signed(int(each), n) if kind[0] == "s" else int(each) % (1 << n) for each in values]
    with np.errstate(over="ignore"):
        return np.array(values, dtype(kind))


def same(found: np.ndarray, expected: np.ndarray, ulps: int) -> np.ndarray:
    """Whether numbers are the same: NaN is NaN, -0 is not 0, unless some ulps may differ."""
    if ulps:
        return np.isclose(found, expected, rtol=ulps * np.finfo(found.dtype).eps, atol=0.0, equal_nan=True)
    equal = (found == expected) & (np.signbit(found) == np.signbit(expected))
    return equal | (found != found) & (expected != expected)


@pytest.mark.full(keep=20)
@on_emulator
@numbered(GROUPS)
def test_instructions(device: Device, number: int, case: Group) -> None:
    rows, columns = case.rows, zip(*case.rows, strict=True)
    assert len(rows) >= 2
    found = np.zeros((len(case.cases), len(rows)), np.uint64)
    given = (as_array(*each) for each in zip(columns, case.cases[0].inputs, strict=True))
    device.launch(f"k{number}", *given, found, threads=len(rows))
    wrong = []
    for each, bytes_found in zip(case.cases, found, strict=True):
        of = dtype(each.output)
        values = bytes_found.view(of)[:: 8 // of.itemsize]
        with np.errstate(all="ignore"):
            expected = as_array([each.expected(*row) for row in rows], each.output)
        bad = np.flatnonzero(~same(values, expected, each.ulps))
        wrong += [f"{each.name} of {rows[i]}: {values[i]}, not {expected[i]}" for i in bad[:3]]
    assert not wrong, "\n".join(wrong)


@on_emulator
@numbered(ATOMICS)
def test_an_atomic_instruction(device: Device, number: int, case: Atomic) -> None:
    draw, kind = np.random.default_rng(2), dtype(case.kind)
    a, b = draw.integers(-9 if case.kind[0] in "sf" else 0, 9, (2, 50)).astype(kind)
    a[7] = b[9] = kind.type(-3 if case.kind[0] in "sf" else 2 ** (bits(case.kind) - 1) + 3)
    was, was_shared, cell, red = (
        np.zeros(50, kind),
        np.zeros(50, kind),
        np.array([5], kind),
        np.array([0, 5], np.uint64),
    )
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
            assert case.name.startswith("cas") or red[1:].view(kind)[0] == expected[-1]


@on_emulator
@numbered(MEETINGS)
def test_threads_meet(device: Device, number: int, case: Meeting) -> None:
    """Blocks of two warps: the same in any order of threads. Of some blocks and warps all threads agree on %p."""
    a, b = np.random.default_rng(3).integers(0, 2**31, (2, 4, 2, 32)).astype(np.uint32)
    a[1:3, 0] |= 1
    a[2, 1] |= 1
    a[1, 1] &= ~np.uint32(1)
    a[3] &= ~np.uint32(1)
    expected = [case.expected(*each, p) for each, p in zip(zip(a, b, strict=True), a % 2 == 1, strict=True)]
    for order in (0, 1, 7):
        d, q = np.zeros_like(a), np.zeros_like(a)
        device.launch(f"m{number}", a, b, d, q, threads=64, blocks=4, order=order)
        for block, (of_d, of_q) in enumerate(expected):
            np.testing.assert_array_equal(d[block], np.broadcast_to(of_d, (2, 32)))
            np.testing.assert_array_equal(q[block], np.broadcast_to(of_q, (2, 32)))


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


def aloud(folder: Path, ptx: str, kernels: list[str]) -> dict[str, tuple[int, str]]:
    """Exit status of a process of its own for each kernel, run with STUB_RACE, and what the emulator said there."""
    script = (
        "import os, sys; from pathlib import Path; from emulator.device import Device\n"
        "folder, ptx, *kernels = sys.argv[1:]; device = Device(Path(folder), ptx)\n"
        "for kernel in kernels:\n"
        "    if (child := os.fork()) == 0:\n"
        "        device.launch(kernel, threads=64); os._exit(0)\n"
        "    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])\n"
        "    print('ended', kernel, status, file=sys.stderr, flush=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, folder, ptx, *kernels],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1]), "STUB_RACE": "1"},
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    said = re.findall(r"(.*?)ended (\w+) (-?\d+)\n", done.stderr, re.S)
    return {kernel: (int(status), text) for text, kernel, status in said}


@on_emulator
def test_races_and_ends_are_told(device: Device) -> None:
    word = "mov.u64 %l0, of_block; mul.wide.u32 %l1, %n, 4; add.s64 %l1, %l0, %l1;"
    other = f"{word} xor.b32 %t0, %n, 32; mul.wide.u32 %l2, %t0, 4; add.s64 %l2, %l0, %l2;"
    bodies = {
        "one_word": "st.shared.u32 [of_block], %n;",
        "words_apart": f"{other} st.shared.u32 [%l1], %n; bar.sync 0; ld.shared.u32 %t1, [%l2];",
        "no_barrier": f"{other} st.shared.u32 [%l1], %n; ld.shared.u32 %t1, [%l2];",
        "atoms": "atom.shared.add.u32 %t0, [of_block], %n;",
        "waits": "setp.ge.u32 %p, %n, 32; @%p bra $END; bar.warp.sync -1;\n$END: bar.sync 0;",
        "stuck": "setp.eq.u32 %p, %n, 3; @%p bra $SOME; bar.warp.sync -1; bra $END;\n"
        "$SOME: vote.sync.ballot.b32 %t0, %p, -1;\n$END:",
        "stops": "setp.eq.u32 %p, %n, 3; @%p trap;",
        "prints": "setp.ne.s32 %p, %n, 3; @%p ret; mov.u64 %l0, greeting; { "
        ".param .b64 text; st.param.b64 [text], %l0; "
        ".param .b64 none; st.param.b64 [none], 0; .param .b32 given; call.uni (given), vprintf, (text, none); }",
        "calls": "setp.eq.s32 %p, %n, 3; @%p call somewhere_else;",
    }
    start = SCRATCH + ".reg .b32 %n; mov.u32 %n, %tid.x;\n"
    kernels = (entry(name, 0, start + body.replace("$", f"${name}_")) for name, body in bodies.items())
    found = aloud(device.folder, HEAD + OF_MODULE + "".join(kernels), list(bodies))
    assert {name: status for name, (status, _) in found.items()} == {
        "one_word": 0, "words_apart": 0, "no_barrier": 0, "atoms": 0, "waits": 0, "stuck": -6, "stops": -6, "prints": 0,
        "calls": -6,
    }  # fmt: skip
    raced = {name for name, (_, text) in found.items() if "emulator: race in" in text}
    assert raced == {"one_word", "no_barrier"}
    _, text = found["stuck"]
    assert "wait for each other for ever" in text
    assert "bar.warp.sync" in text
    assert "vote.ballot" in text
    assert found["prints"][1] == "vprintf: Hi\n"
    assert found["calls"][1] == "extern somewhere_else\n"


def test_all_instructions_of_the_table_are_tested() -> None:
    assert not set(TABLE) - set(re.findall(r"(?<![%\w.])([a-z]\w*)(?=[. ;])", module()))


@pytest.mark.parametrize(
    "text",
    [
        "brev.b32 %a, %b;",  # unknown
        "add.sat.s32 %a, %b, %a;",
        "add.rz.f64 %f, %f, %f;",
        "cvt.rz.f32.f64 %s, %f;",
        "cvt.s32.f64 %a, %f;",  # without rounding
        "cvt.sat.u8.s32 %a, %b;",
        "cvt.rzi.b32.f64 %a, %f;",
        "mad.hi.s32 %a, %b, %a, %b;",
        "fma.rn.s32 %a, %b, %a, %b;",
        "setp.ltu.s32 %p, %a, %b;",
        "setp.lo.f64 %p, %f, %f;",
        "setp.lt.s32 %p|%p, %a, %b;",
        "mov.b32 %a, {%h, %h, %h, %h};",
        "mov.u32 %a, %smid;",
        "add.s32 %a, %b, %other;",
        "add.s32 %a, %b, %p;",
        "add.s32 %p, %a, %b;",
        "add.s32 %other, %a, %b;",
        "add.f64 %f, %f, %s;",
        "add.f64 %s, %f, %f;",
        "add.f64 %f, %f, 1;",
        "atom.global.inc.u32 %a, [%l], %b;",
        "match.any.sync.b64 %a, %l, -1;",
        "shfl.up.b32 %a, %b, 1, 0;",
        "bar.sync 1;",
        "bar.sync 0, 64;",
        "bar.red.popc.u32 %a, 1, %p;",
        "bar.arrive 0, 64;",
        ".shared .b8 mine[8];",
        "call (%a) %b %a;",
        "mov.u64 %l, nowhere;",
        "ret",
    ],
)
def test_what_is_not_known_is_refused(text: str) -> None:
    registers = ".reg .pred %p; .reg .b16 %h; .reg .b32 %a, %b; .reg .b64 %l; .reg .f32 %s; .reg .f64 %f;"
    with pytest.raises(CannotTranslate, match="ptx2c: cannot translate"):
        list(translated(f"{HEAD}.visible .entry k() {{ {registers} {text} }}"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (".extern .shared .align 8 .b8 big[];", "more than 48 KiB"),
        (".shared .b8 one[40000];\n.shared .b8 other[9153];", "49153 bytes of shared arrays"),
        (".global .u64 pointer = of_another;", "initial value of pointer"),
        (".global .f32 most = 0f7F800000;", "initial value"),
    ],
)
def test_variables_that_a_module_cannot_have(text: str, message: str) -> None:
    used = ".reg .b64 %l<3>; mov.u64 %l0, one; mov.u64 %l1, other;" if "other[" in text else ""
    with pytest.raises(CannotTranslate, match=message):
        list(translated(f"{HEAD}{text}\n.visible .entry k() {{ {used} ret; }}"))
