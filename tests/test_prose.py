"""Names in docstrings and comments are names of the tree: a rename leaves no sentence about what is gone."""

from __future__ import annotations

import ast
import builtins
import io
import keyword
import re
import subprocess
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORD = re.compile(r"[A-Za-z_]\w*")
CAPITALS = re.compile(r"\b[A-Z]{3,}(?:_[A-Z]+)*\b")
OTHERS = {
    "programs, formats and journals": "ASE BTWC DNS EOF FIRE FLOCK ADVISORY GIF GSD HDF HOOMD IMA LLVM MSER OVITO "
    "RFC RGB SFN SIAM VTK XYZ",
    "words of their own files": "MAXNEIGH erotate mindlin maxtime shellsize writeinterval Single Grow mt19937ar e_log k_cos k_sin "
    "pair_style atom_types fastcache SplitMix64 validate_call True_ pickle pyi",
    "placeholders of command lines and of names": "BEFORE AFTER FIRST LAST SEED NAME NAME_error NAME_n_eff "
    "species_NAME temperature_error temperature_theory",
    "pages of the manual": "coming exactness performance",
}  # fmt: skip
"""Words that are no names of the tree."""


def sources() -> Iterator[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "ifrdem", "kernels", "validation"], cwd=ROOT, capture_output=True, text=True, check=True
    )  # fmt: skip
    for name in listed.stdout.split():
        if name.endswith(".py") and (ROOT / name).exists():
            yield ROOT / name


def names_in(tree: ast.AST) -> Iterator[str]:
    """All identifiers, and words of short texts: keys, columns, features."""
    for node in ast.walk(tree):
        for field in ("id", "attr", "name", "arg", "asname", "module"):
            if isinstance(value := getattr(node, field, None), str):
                yield from value.split(".")
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) < 60:
            yield from WORD.findall(node.value)


def prose_in(path: Path, text: str, tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Docstrings and comments, and where each stands."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module)) and (
            found := ast.get_docstring(node)
        ):
            yield f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}", found
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield f"{path.relative_to(ROOT)}:{token.start[0]}", token.string


def test_names_in_backticks_and_in_capitals_are_names_of_the_tree() -> None:
    """It would have found `root.seen_from`, `pairing`, TILE_Y and HOW, which renames had left behind."""
    known = {*dir(builtins), *keyword.kwlist}
    known.update(word for words in OTHERS.values() for word in words.split())
    prose: list[tuple[str, str]] = []
    for path in sources():
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        known.update(*(WORD.findall(part) for part in path.relative_to(ROOT).parts), names_in(tree))
        prose += prose_in(path, text, tree)
    assert len(prose) > 5_000
    missing = []
    for place, text in prose:
        quoted = re.findall(r"(?<!`)`([^`]+)`(?!`)", text)
        words = [word for each in quoted for word in WORD.findall(each)]
        words += CAPITALS.findall(re.sub(r"`[^`]*`", "", text))
        missing += [f"{place}: {word}" for word in words if word not in known]
    assert not missing, "\n".join(missing)
