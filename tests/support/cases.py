"""Cases of tests: the smallest one, and others by what is different in them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import ifrdem
from ifrdem.case import file as case_file
from ifrdem.case import template
from ifrdem.case.case import CaseSections
from ifrdem.case.gas import CaseGas
from ifrdem.runs.case import assignments

SMALLEST = """
[run]
name = "gas"
t_end = 1.0
units = "reduced"
[box]
packing_fraction = 0.2
[[material]]
name = "coin"
e_n = 0.9
e_t = -0.8
mu = 0.2
[[species]]
name = "coins"
number = 20
material = "coin"
mass = 1.0
radius = 0.5
speed_rms = 1.0
"""

MakeCase = Callable[..., ifrdem.Case]
Problems = Callable[..., list[str]]
Written = Callable[..., ifrdem.Trajectory]
"""Types of the fixtures `case`, `problems` and `written`."""
Change = str | Mapping[str, Any]
"""An assignment as of `--set`, "run.seed=3", or several as of Python, {"run.seed": 3}; None, or no value, takes a key out."""


def changed(*changes: Change, text: str = SMALLEST) -> dict[str, Any]:
    """A parsed case with other values."""
    raw = tomllib.loads(text)
    for each in changes:
        for assignment in assignments([each] if isinstance(each, str) else each):
            case_file.override(raw, assignment)
    return raw


def case_text(*changes: Change, text: str = SMALLEST) -> str:
    """The text of a case with other values; new keys come last in their sections, new sections last of all."""
    return "".join(template.sections(changed(*changes, text=text)))


def problems(*changes: Change, text: str = SMALLEST, folder: Path = Path()) -> list[str]:
    """Everything that is wrong with a case with other values, whose paths begin at a folder."""
    return [str(each) for each in case_file.validate_parsed(changed(*changes, text=text), folder)[-1]]


def case_gas(*changes: Change, text: str = SMALLEST, folder: Path = Path()) -> CaseGas:
    """The gas of a case with other values, which may break rules of several sections."""
    return CaseGas.from_case(CaseSections.model_validate(changed(*changes, text=text)), folder)
