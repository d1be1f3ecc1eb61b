"""Tests of numbers and words at three doors: keys of cases, arguments of Python, options of commands."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction as Fraction_
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from cyclopts import App, CycloptsError
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from support.cases import case_text
from support.drawn import examples

from ifrdem.case import file as case_file
from ifrdem.case.section import Section
from ifrdem.cli.options import option
from ifrdem.errors import InputError
from ifrdem.tools import values
from ifrdem.tools.checked import validated
from ifrdem.tools.values import Count, Fraction, NonNegative, Positive, Ratio, Real, is_integer, is_number

CASE = case_text({
    "run.collisions_per_disk": 1.0, "run.name": None, "run.t_end": None, "run.units": None,
    "box.lengths": [8.0, 8.0], "box.packing_fraction": None, "material[0].name": "steel",
    "material[0].e_t": -0.9, "material[0].mu": 0.1, "species[0].number": 2, "species[0].material": "steel",
    "species[0].speed_rms": None,
})  # fmt: skip
RANGE = "must be a positive number from 1e-50 to 1e+50"


class Keys(Section):
    """Keys of the types below."""

    speed: Positive = 1.0
    ratio: Ratio = 1.0
    rate: Real = 0.0
    spin: NonNegative = 0.0
    part: Fraction = 0.5
    number: Count = 1
    word: Literal["even", "log"] = "even"


@validated
def function(
    speed: Positive = 1.0, ratio: Ratio = 1.0, rate: Real = 0.0, spin: NonNegative = 0.0, part: Fraction = 0.5,
    number: Count = 1, word: Literal["even", "log"] = "even",
) -> dict[str, Any]:  # fmt: skip
    """Arguments of the same types."""
    return {
        "speed": speed, "ratio": ratio, "rate": rate, "spin": spin, "part": part, "number": number, "word": word,
    }  # fmt: skip


def command(
    *,
    speed: Annotated[float, option(Positive, "V", "")] = 1.0,
    ratio: Annotated[float, option(Ratio, "V", "")] = 1.0,
    rate: Annotated[float, option(Real, "V", "")] = 0.0,
    spin: Annotated[float, option(NonNegative, "V", "")] = 0.0,
    part: Annotated[float, option(Fraction, "V", "")] = 0.5,
    number: Annotated[int, option(Count, "V", "")] = 1,
    word: Annotated[str, option(Literal["even", "log"], "V", "")] = "even",
) -> dict[str, Any]:
    """Options of the same types."""
    return {
        "speed": speed, "ratio": ratio, "rate": rate, "spin": spin, "part": part, "number": number, "word": word,
    }  # fmt: skip


def run(name: str, text: str) -> Any:
    """The value that the command gets for an option."""
    app = App(default_command=command, result_action="return_value", version_flags=[])
    return app([f"--{name}", text], exit_on_error=False, print_error=False)[name]


@pytest.mark.parametrize(
    ("name", "value", "text", "sentence"),
    [
        ("speed", -1.0, "-1", RANGE),
        ("speed", 0.0, "0", RANGE),
        ("speed", math.nan, "nan", RANGE),
        ("speed", "much", "much", RANGE),
        ("speed", True, "true", RANGE),
        ("speed", "1_0", "1_0", RANGE),
        ("speed", 1e60, "1e60", f"{RANGE}: choose other units"),
        ("speed", 1e-60, "1e-60", f"{RANGE}: choose other units"),
        ("speed", math.inf, "inf", RANGE),
        ("ratio", 1e60, "1e60", RANGE),  # other units do not change a pure number
        ("rate", -1e60, "-1e60", "must be a finite number, at most 1e+50 in size: choose other units"),
        ("spin", -1e-60, "-1e-60", "must be 0, or a number from 1e-50 to 1e+50"),
        ("spin", 1e-60, "1e-60", "must be 0, or a number from 1e-50 to 1e+50: choose other units"),
        ("part", 1.5, "1.5", "must be a number from 0 to 1"),
        ("number", 0, "0", "must be an integer from 1 to 2147483647"),
        ("number", 2.5, "2.5", "must be an integer from 1 to 2147483647"),
        ("word", "lgo", "lgo", "must be one of 'even', 'log' (did you mean 'log'?)"),
    ],
)
def test_a_wrong_value_gets_the_same_sentence_at_all_doors(
    name: str, value: Any, text: str, sentence: str
) -> None:
    """Cases said "greater than 0", commands "a positive finite number", Python 1e-100 to 1e+100."""
    with pytest.raises(ValidationError) as of_key:
        Keys(**{name: value})
    with pytest.raises(InputError) as of_argument:
        function(**{name: value})
    with pytest.raises(CycloptsError) as of_option:
        run(name, text)
    (error,) = of_key.value.errors()
    assert error["loc"] == (name,)
    if name != "word":  # its sentence is made with the place: the test below
        assert error["msg"] == sentence
    assert str(of_argument.value) == f"{name} = {value!r}: {sentence}"
    assert of_option.value.msg == f"--{name} {text}: {sentence}"


NUMBERS = st.one_of(st.floats(), st.floats(0.0, 2.0), st.integers(), st.integers(-2, 2))


@given(st.sampled_from(("speed", "ratio", "rate", "spin", "part", "number")), NUMBERS)
@examples(30)
def test_all_doors_take_the_same_numbers(name: str, value: float) -> None:
    """A number that one of them takes, the others take as the same; what one refuses, all refuse."""
    answers: list[Any] = []
    for door in (
        lambda: getattr(Keys(**{name: value}), name),
        lambda: function(**{name: value})[name],
        lambda: run(name, repr(value)),
    ):
        try:
            answers.append(door())
        except (ValidationError, InputError, CycloptsError):
            answers.append("refused")
    assert answers == [answers[0]] * 3


def test_a_key_says_the_sentence_with_its_text(toml: Path) -> None:
    """As the argument of Python does; behind it, what the key means."""
    for key, value, sentence in (
        ("species[0].radius", "1e60", f"{RANGE}: choose other units (radius [m])"),
        ("run.precision", "f46", "must be one of 'f64', 'f32' (did you mean 'f64'?)"),
        ("box.gravity", "[0.0, 1e60]", "must be a finite number, at most 1e+50 in size: choose other units"),
    ):
        with pytest.raises(InputError) as refused:
            case_file.read(toml, [f"{key}={value}"])
        assert sentence in str(refused.value)
        assert f"{key}[1] = 1e+60" in str(refused.value) or key != "box.gravity"


@pytest.mark.parametrize(
    ("name", "value", "text", "found"),
    [
        ("speed", 3, "3", 3.0),
        ("speed", np.float32(0.5), "0.5", 0.5),
        ("speed", np.array(2.0), "2.0", 2.0),
        ("speed", 1e-50, "1e-50", 1e-50),
        ("spin", 0, "0", 0.0),
        ("rate", -1e-60, "-1e-60", -1e-60),
        ("number", np.int32(3), "3", 3),
        ("number", 100.0, "1e2", 100),
        ("word", "log", "log", "log"),
    ],
)
def test_a_right_value_is_the_same_at_all_doors(name: str, value: Any, text: str, found: Any) -> None:
    """Keys refused 100.0 for a whole number and took no numbers of NumPy."""
    for one in (getattr(Keys(**{name: value}), name), function(**{name: value})[name], run(name, text)):
        assert (type(one), one) == (type(found), found)


@pytest.mark.parametrize(
    ("text", "number", "whole"),
    [
        ("3", 3.0, 3), (" 3 ", 3.0, 3), ("1e5", 1e5, 100_000), ("9007199254740993", 2.0**53, 2**53 + 1),
        ("9" * 400, math.inf, int("9" * 400)), ("2.5", 2.5, None), ("inf", math.inf, None), ("-0", 0.0, 0),
        ("1_0", None, None), ("", None, None), ("x", None, None), ("9" * 5000, math.inf, None),
    ],
)  # fmt: skip
def test_texts_are_made_numbers_in_one_way(text: str, number: float | None, whole: int | None) -> None:
    """2^53 + 1 is no float; Python refuses to read 5,000 digits. 1_0 was a whole number, and no other."""
    assert values.number_of(text) == number
    assert values.whole_of(text) == whole
    assert math.isnan(values.number_of("nan") or 0.0)
    assert values.whole_of("nan") is None


def test_what_is_a_number_is_decided_in_one_place() -> None:
    """NumPy counts spans of time among its integers, and Python truth values."""
    integers = [3, np.int8(3), np.uint64(3)]
    others = [0.5, np.float16(0.5), Fraction_(1, 2)]
    none = [
        True,
        np.True_,
        np.timedelta64(3, "s"),
        np.datetime64("2021"),
        "3",
        None,
        3j,
        Decimal(3),
        np.array(3),
    ]
    assert [is_number(one) for one in integers + others + none] == [True] * 6 + [False] * 9
    assert [is_integer(one) for one in integers + others + none] == [True] * 3 + [False] * 12
