"""Names in docstrings and comments are names of the tree: a rename leaves no sentence about what is gone."""

from __future__ import annotations

import builtins
import keyword
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORD = re.compile(r"[A-Za-z_]\w*")
PARTS = re.compile(
    r"""(?P<comment>\#[^\n]*)|^[ \t]*(?P<document>[rf]?\"{3}(?:\\.|(?!\"{3})[^\\])*\"{3})$|(?P<string>\"{3}(?:\\.|[^\\])*?\"{3}|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*')"""
    r"|(?P<name>[A-Za-z_]\w*)",
    re.DOTALL | re.MULTILINE,
)
CAPITALS = re.compile(r"\b[A-Z]{3,}(?:_[A-Z]+)*\b")
OTHERS = {
    "programs, formats and journals": "ASE BTWC DNS EOF FIRE FLOCK ADVISORY GIF GSD HDF HOOMD HTML IMA JASA LLVM MSER MVAPICH "
    "OVITO PALS PBC PDF RFC RGB SFN SIAM VTK XYZ sha256sum srun",
    "words of their own files": "MAXNEIGH erotate mindlin maxtime shellsize writeinterval Single Grow mt19937ar e_log k_cos k_sin "
    "pair_style atom_types fastcache SplitMix64 validate_call True_ pickle pyi Kernel "
    "DEFAULT_MMAP_THRESHOLD_MAX",
    "placeholders of command lines and of names": "BEFORE AFTER FIRST LAST SEED NAME NAME_error NAME_n_eff "
    "species_NAME temperature_error temperature_theory",
    "pages of the manual": "coming exactness performance",
}  # fmt: skip
"""Words that are no names of the tree."""


def files() -> list[str]:
    """Names of all files of the tree."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    return listed.stdout.split()


def sources() -> Iterator[Path]:
    """Sources of the program."""
    for name in files():
        if (
            name.startswith(("ifrdem/", "kernels/", "validation/"))
            and name.endswith(".py")
            and (ROOT / name).exists()
        ):
            yield ROOT / name


def parts_of(text: str) -> Iterator[tuple[str, int, str]]:
    """Parts of a source: kind ("comment", "document", "string" or "name"), line, text.

    Documents are strings in three quotes that stand as statements. Regular expressions take a tenth of the time of the
    module `tokenize`.
    """
    line, end = 1, 0
    for match in PARTS.finditer(text):
        line, end = line + text.count("\n", end, match.start()), match.start()
        yield str(match.lastgroup), line, match[0]


def test_names_in_backticks_and_in_capitals_are_names_of_the_tree() -> None:
    """It would have found `root.seen_from`, `pairing`, TILE_Y and HOW, which renames had left behind."""
    known = {*dir(builtins), *keyword.kwlist}
    known.update(word for words in OTHERS.values() for word in words.split())
    prose: list[tuple[str, str]] = []
    known.update(*map(WORD.findall, files()))
    for path in sources():
        for kind, line, text in parts_of(path.read_text(encoding="utf-8")):
            if kind in ("comment", "document"):
                prose.append((f"{path.relative_to(ROOT)}:{line}", text))
            elif kind == "name":
                known.add(text)
            else:  # keys, columns, features; what stands between the values of longer ones
                known.update(*(WORD.findall(part) for part in re.split("[{}]", text) if len(part) < 60))
    assert len(prose) > 5_000
    missing = []
    for place, text in prose:
        quoted = re.findall(r"(?<!`)`([^`]+)`(?!`)", text)
        words = [word for each in quoted for word in WORD.findall(each)]
        words += CAPITALS.findall(re.sub(r"`[^`]*`", "", text))
        missing += [f"{place}: {word}" for word in words if word not in known]
    assert not missing, "\n".join(missing)
