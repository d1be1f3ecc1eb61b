"""Any case file is valid or refused: `check` ends with status 0 or 2, without a traceback.

Shipped cases, templates and random cases (`ifrdem.validation.gas.cases`) are mutated.
"""

from __future__ import annotations

import copy
import functools
import io
import json
import resource
import signal
import tomllib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from types import FrameType
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from support.drawn import Dice, examples

from ifrdem.case import shipped, template
from ifrdem.cli.main import main
from ifrdem.errors import TheoryWarning
from ifrdem.validation.gas.cases import cases, text_of, toml

SECONDS, BYTES = 20, 4 * 10**9
"""That one check may take at most; most take some milliseconds."""

NUMBERS = (
    0, -1, 1, 2, 7, 2**31, 2**63, -(2**63), 10**30, 0.0, -0.0, 0.5, 1.0, -1.0, 1e-300, 5e-324, 1e300, -1e300,
    1e50, 1e-50, 1e40, 1e-40, 1e19, 1e-19, 1e9, 1e-9, 89.999999, float("nan"), float("inf"), float("-inf"),
)  # fmt: skip
TEXTS = (
    "", " ", "x" * 5000, "é\u202e\u0000\x7f", "\U0001f600", "../../etc", "a\nb", "none", "random", "hexagonal",
    "impact_scan", "grown", "missing.h5", "missing.csv", "/dev/zero", "\u0000.h5", ".", "1e300",
    "nan", "%s%n{}",
)  # fmt: skip
KEYS = ("²", "", "é", "x" * 300, "a.b", "__class__", "model_config", "text", "\u202e", "0", "self", "ctx")
PATHS = (
    "run", "run.²", "run.seed", "species[0]", "species[99]", "species[0].number", "box.lengths[0]", "box", "",
    "a" * 3000, ".".join("a" * 400), "run..seed", "species[-1].k", "species[" + "9" * 5000 + "]", "wall[0].motion",
    "force[0].step", "[0]", "run.__class__", "species.number", "material[0].e_n", "start.positions",
)  # fmt: skip
VALUES = (
    "", "1e300", "nan", "inf", "-1", "²", "[[[]]]", "[" * 3000, "{a=1}", "{" + "a." * 3000 + "a=1}", "1" * 5000, "'''",
    '"', "true", "0x", "2026-02-30", "1979-05-27T07:32:00Z", "x" * 10_000, "\udcff", "\x00", "a = 1\nb",
)  # fmt: skip


@functools.cache
def sources() -> list[str]:
    """Texts of all shipped cases and templates, and of random cases; the shortest first."""
    texts = [(shipped.FOLDER / f"{name}.toml").read_text(encoding="utf-8") for name in shipped.names()]
    texts += [text_of(case) for _, case, _ in cases(0, 40, 0)]
    return sorted(texts + [template.write(kind) for kind in template.TEMPLATES], key=len)


def leaves(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every place in nested tables and lists: what holds it, and its key or number."""
    for key, each in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(each, dict | list):
            yield from leaves(each)


def odd(dice: Dice) -> Any:
    """A value that does not belong."""
    deep: Any = dice.choice(NUMBERS)
    for _ in range(dice.choice((1, 2, 12, 40))):
        deep = [deep]
    number, text = dice.choice(NUMBERS), dice.choice(TEXTS)
    return dice.choice(
        (number, number, number, number, text, text, True, [], {}, [number, number], deep, {dice.choice(KEYS): number},
         [text] * 3, [number] * 1000, [{}], dice.uniform(-1.0, 1.0) * 10.0 ** dice.randint(-60, 60))
    )  # fmt: skip


@st.composite
def mutants(draw: Any) -> tuple[str, list[str]]:
    """Cases and the settings of the command line."""
    dice = Dice(draw)
    text = dice.choice(sources())
    raw = copy.deepcopy(tomllib.loads(text))
    for _ in range(dice.choice((0, 1, 1, 1, 2, 3))):
        places = list(leaves(raw))
        holder, key = places[dice.choice(range(len(places)))]
        what, present = dice.random(), holder[key]
        if isinstance(present, float) and what < 0.4:  # which by itself is in order
            holder[key] = present * 10.0 ** dice.choice((-30, -12, -6, -2, 2, 6, 12, 30))
        elif what < 0.65:
            holder[key] = odd(dice)
        elif what < 0.75:
            del holder[key]
        elif what < 0.85 and isinstance(holder, dict):
            holder[dice.choice((*KEYS, *map(str, holder)))] = odd(dice)
        elif isinstance(holder, list):
            holder += copy.deepcopy(holder) * dice.choice((1, 3))
        else:
            holder[key] = [holder[key], holder[key]]
    changed = "".join(f"{json.dumps(key)} = {toml(each)}\n" for key, each in raw.items())
    if dice.random() < 0.1:
        begin = dice.randrange(len(text))
        changed = dice.choice(
            (text[:begin], text[begin:], text + text, text + text[begin:], text[:begin] + "\x00" + text[begin:],
             text[:begin] + dice.choice(VALUES[:-3]) + text[begin:], text.replace("\n", "\r"))
        )  # fmt: skip
    settings = []
    for _ in range(dice.choice((0, 0, 0, 1, 2))):
        value = dice.choice((*VALUES, toml(odd(dice))))
        settings += ["--set", dice.choice((f"{dice.choice(PATHS)}={value}", value))]
    return changed, settings


class Late(Exception):
    """A check that takes too long."""


@contextmanager
def limits(seconds: int, more_bytes: int) -> Iterator[None]:
    """Late after so much time, MemoryError for so much more memory."""

    def late(_number: int, _frame: FrameType | None) -> None:
        raise Late(f"takes more than {seconds} s of processor time")

    before = signal.signal(signal.SIGPROF, late)
    space = resource.getrlimit(resource.RLIMIT_AS)
    present = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (present + more_bytes, space[1]))
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, space)
        signal.signal(signal.SIGPROF, before)


def fault(place: Path, text: str, settings: list[str]) -> str | None:
    """The fault of `ifrdem check` with a case; None if there is none."""
    place.write_bytes(text.encode("utf-8"))
    output, complained = io.StringIO(), io.StringIO()
    try:
        with (
            limits(SECONDS, BYTES),
            redirect_stdout(output),
            redirect_stderr(complained),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("always", TheoryWarning)  # a user gets a message of one line
            status = main(["check", str(place), *settings])
    except (Exception, SystemExit) as error:
        return f"{type(error).__name__}: {error}"
    printed = complained.getvalue()
    if status not in (0, 2):
        return f"status {status}: {printed[:300]}"
    if (status == 2) != bool(printed.strip()) and "warning" not in printed:
        return f"status {status}, and printed: {printed[:300]}"
    if len(printed) > 50_000:
        return f"{len(printed)} characters of complaint"
    return "nan or inf in the report" if " nan" in output.getvalue() and status == 0 else None


@given(mutants())
@examples(120)
def test_a_mutated_case_is_checked_or_refused_without_a_traceback(
    tmp_path: Path, mutant: tuple[str, list[str]]
) -> None:
    assert fault(tmp_path / "case.toml", *mutant) is None
