"""Words of names and texts are those of the field, without private terms of the program."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = [*sorted((ROOT / "ifrdem").rglob("*.py")), *sorted((ROOT / "kernels").rglob("*.py"))]
NAMES = (
    "accompany", "anew", "asker", "begun", "beside", "came", "cautions", "claim", "complaint", "course",
    "crowding", "deaf", "dealt", "foresee", "foreseen", "furthest", "gossip", "grip", "heard", "judge",
    "judged", "laid", "lay", "lid", "mistakes", "nobody", "parted", "protrudes", "put", "said", "seen",
    "settle", "shut", "somebody", "soonest", "spent", "stretches", "swap", "told", "trail", "tried", "united",
    "unjudged", "who", "whoever", "whom",
)  # fmt: skip
"""Words that no name has between its underscores or capitals."""
PHRASES = (
    ": only with", "anew", "as it were", "by its own", "cannot stand", "comes together", "goes on with",
    "held against", "hold against", "in turns", "nobody", "not beside", "of one's own", "only beside",
    "somebody", "take note", "what is foreseen", "whoever", "whomever",
)  # fmt: skip
"""Phrases that no docstring and no message has."""


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def names_of(tree: ast.Module) -> Iterator[str]:
    """Names of functions, classes, arguments, attributes and variables that a module defines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.id if isinstance(node, ast.Name) else node.attr


def words_of(name: str) -> set[str]:
    """Words of a name in small letters: "CamelCase" and "with_underscores" have two."""
    return {one.lower() for one in re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", name)}


def banned_names_in(path: Path) -> list[str]:
    """Names of a module that have banned words; names of tests are sentences and may have them."""
    names = {path.stem, *names_of(tree_of(path))}
    return [
        f"{name}: {word}"
        for name in sorted(name for name in names if not name.startswith("test_"))
        for word in sorted(words_of(name) & set(NAMES))
    ]


def banned_in(path: Path) -> list[str]:
    """Names and texts of a module that have banned words and phrases."""
    tree, found = tree_of(path), banned_names_in(path)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = " ".join(node.value.split()).lower()
            found += [f"line {node.lineno}: {phrase}" for phrase in PHRASES if phrase in text]
    return found


@pytest.mark.parametrize("room", sorted({path.relative_to(ROOT).parts[:2] for path in SOURCES}), ids="/".join)
def test_names_and_texts_have_the_words_of_the_field(room: tuple[str, ...]) -> None:
    here = [path for path in SOURCES if path.relative_to(ROOT).parts[:2] == room]
    found = {str(path.relative_to(ROOT)): banned_in(path) for path in here}
    assert {path: banned for path, banned in found.items() if banned} == {}


def test_names_in_tests_have_the_words_of_the_field() -> None:
    found = {str(path.relative_to(ROOT)): banned_names_in(path) for path in (ROOT / "tests").rglob("*.py")}
    assert {path: banned for path, banned in found.items() if banned} == {}


def test_banned_words_are_found(tmp_path: Path) -> None:
    module = tmp_path / "swap.py"
    lines = ("class BoxSettle:", '    """Text."""', "    def f(self, dealt_to):",
             '        self.united = f"cannot  stand in {dealt_to}"')  # fmt: skip
    module.write_text("\n".join(lines))
    assert banned_in(module) == [
        "BoxSettle: settle", "dealt_to: dealt", "swap: swap", "united: united", "line 4: cannot stand",
    ]  # fmt: skip
