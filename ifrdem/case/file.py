"""Case files: read TOML, apply overrides, and report everything that is wrong at once."""

from __future__ import annotations

import copy
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from ..errors import InputError, Problem, cut, listed, nearest, option_name
from ..mpi import Communicator
from ..tools import text_file
from ..tools.old_words import present_case
from . import checks, exclusions, starts
from .case import IMPACT_SCAN, CaseSections
from .gas import CaseGas
from .messages import KeyPath, kind_key_in, location_of, problems, spelled

MOST_BYTES = 10_000_000
"""Largest case file."""
DEEPEST = 16
"""Lists and tables in each other, and parts of a key, at most; a case needs four."""

_QUOTED = re.compile(
    r"""#[^\n]*|\"{3}(?:\\.|[^\\])*?(?:\"{3}|\Z)|'{3}.*?(?:'{3}|\Z)|"(?:\\.|[^"\\\n])*"?|'[^'\n]*'?""",
    re.DOTALL,
)
"""Comments and texts of TOML, in which brackets and dots mean nothing."""
_LONG_KEY = re.compile(rf"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){{{DEEPEST},}}")
_PATH = re.compile(rf"[\w-]{{1,100}}(?:\.[\w-]{{1,100}}|\[\d{{1,9}}\]){{0,{DEEPEST}}}", re.ASCII)
"""A key on the command line."""


@dataclass(frozen=True)
class CaseFile:
    """A case file that passed every check."""

    path: Path
    text: str
    overrides: tuple[str, ...]  # "key=value", in order
    gas: CaseGas = field(repr=False)  # what the two say together, ready to start

    @property
    def case(self) -> CaseSections:
        """The case that text and overrides make."""
        return self.gas.case

    @property
    def folder(self) -> Path:
        """The folder that a start file's path begins at."""
        return self.path.parent


def read(path: Path | str, overrides: Sequence[str] = ()) -> CaseFile:
    """Read and check a case file (TOML).

    Overrides are assignments such as "run.seed=3" or "species[0].number=100", applied in order. The value is TOML; what
    is not TOML is taken as text; nothing after "=" removes the key.

    Raises InputError with one line for each thing that is wrong.
    """
    path = Path(path)
    return of_text(load(path)[0], path, overrides)


def load(path: Path) -> tuple[str, dict[str, Any]]:
    """Text of a TOML file, and its values.

    Raises InputError if it cannot be read, or is not TOML.
    """
    try:
        text = text_file.read(path, most=MOST_BYTES)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return text, load_text(text, path)


def read_on_ranks(find: Callable[[], Path], overrides: Sequence[str], comm: Communicator) -> CaseFile:
    """As `read`, by the root of some ranks of MPI (`find` gives it the path), which all call this.

    All have the case. Of a start that a file gives each reads its slice (`CaseGas.is_read_in_slices`), or else the root
    has all of it.
    """

    def first() -> CaseFile:
        path = find()
        return of_text(load(path)[0], path, overrides, comm.size)

    whole = comm.run_on_root(first)
    file = comm.bcast(None if whole is None else replace(whole, gas=replace(whole.gas, given=None)))
    assert file is not None
    if not starts.is_read_in_slices(file.gas, comm.size):
        return whole or file
    with file.gas.communicator(comm):
        gas, found = starts.with_start(file.gas, file.folder)
        _refuse(found, file.path, overrides)
        return replace(file, gas=checks.ready(gas))


def load_text(text: str, path: Path) -> dict[str, Any]:
    """Values of a text in TOML; InputError with its path if it is none."""
    try:
        return parsed(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def changed(raw: dict[str, Any], path: Path, overrides: Sequence[str]) -> dict[str, Any]:
    """A parsed case with overrides; InputError if it is a study, or they are none."""
    if "case" in raw and "run" not in raw:
        raise InputError(f"{path}: is a study, not a case: `ifrdem study {path}` runs it")
    for assignment in overrides:
        override(raw, assignment)
    return raw


def of_text(
    text: str,
    path: Path,
    overrides: Sequence[str] = (),
    ranks: int = 1,
    *,
    where: str = "on the command line",
    stored: bool = False,
) -> CaseFile:
    """The case file with this text, as by `read`; paths in it are relative to the folder of `path`.

    `where` says where overrides were set, in messages. A text that was `stored` with results may have old words.
    """
    raw = changed(load_text(text, path), path, overrides)
    raw = present_case(raw) if stored else raw
    gas, found = validate_parsed(raw, path.parent, ranks)
    _refuse(found, path, overrides, where)
    assert gas is not None  # else something was wrong
    gas = replace(gas, path=path)
    if gas.case.start.positions == IMPACT_SCAN:  # of which all places are made here
        from .summary import refuse_beyond_memory

        try:
            refuse_beyond_memory(gas.n, gas.case.run.device)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    return CaseFile(
        path, text, tuple(overrides), gas if starts.is_read_in_slices(gas, ranks) else checks.ready(gas)
    )


def _refuse(
    found: Sequence[Problem], path: Path, overrides: Sequence[str], where: str = "on the command line"
) -> None:
    """Raise InputError with a line for each thing that is wrong, if there is any."""
    set_here = {spelled(parse_assignment(assignment)[0]) for assignment in overrides}
    texts = [f"{problem}{f' [set {where}]' * (problem.key in set_here)}" for problem in found]
    if texts:
        raise InputError(listed([f"{path}: {text}" for text in texts]))


def validate_parsed(
    raw: Mapping[str, Any], folder: Path, ranks: int = 1
) -> tuple[CaseGas | None, list[Problem]]:
    """The gas of a parsed case, and everything wrong: keys, types and ranges first; if these are in order, rules.

    Unknown keys alone do not hide what the rules forbid.
    """
    case, found = validated(raw)
    if case is None:
        return None, found
    gas, more = checks.validate_case(case, folder, ranks=ranks)
    return gas, found + more


def validated(raw: Mapping[str, Any]) -> tuple[CaseSections | None, list[Problem]]:
    """The case without its unknown keys, None if more is wrong; and everything wrong with keys, types and ranges."""
    try:
        return CaseSections.model_validate(raw), []
    except ValidationError as error:
        found, errors = problems(error), error.errors(include_url=False)
    known = _without(raw, errors)
    if any(each["type"] != "extra_forbidden" for each in errors):
        return None, found + exclusions.problems(known)
    case, more = validated(known)
    return case, found + more


def _without(raw: Mapping[str, Any], errors: Iterable[ErrorDetails]) -> dict[str, Any]:
    """A parsed case without the keys that are wrong by themselves; a list of tables keeps its length."""
    known = copy.deepcopy(dict(raw))
    for each in errors:
        steps = [*location_of(each["loc"]).key]
        if each["type"] == "union_tag_invalid":
            steps.append(kind_key_in(each))
        if each["type"] != "extra_forbidden" and isinstance(
            _at(known, steps), dict
        ):  # a mistake of several keys
            continue
        while len(steps) > 2 and isinstance(steps[-1], int):  # a list of numbers is wrong as a whole
            steps.pop()
        *above, last = steps or [""]
        node = _at(known, above)
        if isinstance(node, list) and isinstance(last, int) and last < len(node):
            node[last] = None
        elif isinstance(node, dict):
            node.pop(last, None)
    return known


def _at(node: Any, steps: Sequence[str | int]) -> Any:
    """Value at a place of a parsed case; None without one."""
    for step in steps:
        if isinstance(node, dict):
            node = node.get(step)
        elif isinstance(node, list) and isinstance(step, int) and step < len(node):
            node = node[step]
        else:
            return None
    return node


def override(raw: dict[str, Any], assignment: str) -> None:
    """Carry out one "key=value" on a parsed case.

    Raises InputError if there is no "=", the key is no path, or it leads through something that holds no keys.
    """
    key, value, remove = parse_assignment(assignment)
    assignment = cut(assignment)
    node: Any = raw
    for depth, step in enumerate(key):
        last = depth == len(key) - 1
        where = spelled(key[:depth]) or "the case"
        if isinstance(node, list) and isinstance(step, int):
            if not 0 <= step < len(node):
                raise InputError(
                    f"{option_name('--set', 'set:')} {assignment}: {where} has {len(node)} entries, numbered from 0"
                )
        elif not (isinstance(node, dict) and isinstance(step, str)):
            kind = "a list: give a number" if isinstance(node, list) else "no table that holds keys"
            if node == {} and isinstance(step, int):
                kind = f"not there{_coins_in(raw) if where == 'material' else ''}"
                kind += (
                    "" if where in CaseSections.model_fields else nearest(where, CaseSections.model_fields)
                )
            raise InputError(f"{option_name('--set', 'set:')} {assignment}: {where} is {kind}")
        elif not last and step not in node:
            node[step] = {}
        if not last:
            node = node[step]
        elif not remove:
            node[step] = value
        elif isinstance(node, dict):
            node.pop(step, None)
        else:
            del node[step]


def _coins_in(raw: Mapping[str, Any]) -> str:
    """Advice on changing a material of a case whose materials come from the coins of species."""
    species = raw.get("species")
    named = [one.get("coin") for one in species if isinstance(one, dict)] if isinstance(species, list) else []
    key = next((f"species[{i}]" for i, coin in enumerate(named) if coin is not None), None)
    if key is None:
        return ""
    return (
        f": coefficients are those of {key}.coin. Change {key}.coin, or write a [[material]] with name, e_n, e_t and "
        f"mu into the case, and {key}.material = its name"
    )


def parse_assignment(assignment: str) -> tuple[KeyPath, Any, bool]:
    """Split "key=value" into the path of the key, the value, and whether the key is to be removed."""
    key, equals, value = assignment.partition("=")
    key, value = key.strip(), value.strip()
    if not equals or not _PATH.fullmatch(key):
        such = "such as run.seed=3 or species[0].number=100"
        raise InputError(f"{option_name('--set', 'set:')} {cut(assignment)}: must be KEY=VALUE, {such}")
    path: KeyPath = tuple(int(step) if step.isdecimal() else step for step in re.findall(r"[\w-]+", key))
    try:
        # A line break would let a value bring further keys with it.
        found = value if "\n" in value else parsed(f"value = {value}")["value"]
    except InputError:
        found = value
    return path, found, value == ""


def _float(text: str) -> float:
    """The number that a text in TOML is; ValueError where it is too large or too small for one: not inf, and not 0."""
    found = float(text)
    if math.isinf(found) and "inf" not in text:
        raise ValueError(f"{cut(text)} is too large for a number: at most 1.8e308")
    if found == 0.0 and re.search("[1-9]", re.split("[eE]", text)[0]):
        raise ValueError(f"{cut(text)} is too small for a number: 5e-324 at least, or 0")
    return found


def parsed(text: str) -> dict[str, Any]:
    """The tables and keys of a text in TOML.

    Raises InputError if it is not TOML, a number is too long for one, or tables, lists or keys stand deeper in each
    other than `DEEPEST`: beyond, the parser's time and memory grow without bound.
    """
    bare = _QUOTED.sub("x", text)
    depth = 0
    for bracket in re.findall(r"[][{}]", bare):
        depth += 1 if bracket in "[{" else -1
        if depth > DEEPEST:
            raise InputError(
                f"lists or tables stand in each other more than {DEEPEST} deep, the most allowed"
            )
    if (found := _LONG_KEY.search(bare)) is not None:
        key = re.sub(r"\s", "", found[0])
        raise InputError(f"the key {cut(key, 43)} has more than {DEEPEST} parts, the most allowed")
    try:
        return tomllib.loads(text, parse_float=_float)
    except ValueError as error:  # of the parser, or a whole number with thousands of digits
        raise InputError(f"not valid TOML: {error}") from None
