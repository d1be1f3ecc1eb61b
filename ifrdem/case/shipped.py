"""The cases that come with the package: their names, what they show, and where they are."""

from __future__ import annotations

import os
import re
import textwrap
from pathlib import Path

from ..errors import InputError, nearest, nearest_file
from . import template

FOLDER = Path(__file__).parents[1] / "cases"


def names() -> list[str]:
    """Names of the shipped cases, in alphabetical order."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def comment(name: str) -> str:
    """First paragraph of the comment of a shipped case."""
    lines = (FOLDER / f"{name}.toml").read_text(encoding="utf-8").splitlines()
    paragraph = []
    for line in lines:
        text = line.removeprefix("#").strip()
        if not line.startswith("#") or not text:
            break
        paragraph.append(text)
    return " ".join(paragraph)


def title(name: str) -> str:
    """Title of a shipped case: the first sentence of its comment, to a colon or a full stop."""
    return re.split(r"[:.](?:\s|$)", comment(name), maxsplit=1)[0]


def listing() -> str:
    """A line for each shipped case, and what to do with them."""
    known = names()
    width = max(len(name) for name in known)
    lines = [f"{name:<{width}}  {title(name)}" for name in known]
    hint = "`ifrdem run NAME` runs one, `ifrdem new cases/NAME.toml` copies one to change; they are in"
    return "\n".join((*lines, "", f"{hint} {FOLDER}"))


def find(given: str) -> Path:
    """The file that a user means by `given`: a file, or else the name of a shipped case.

    Raises InputError if it has the form of a name, and there is neither such a file nor such a case.
    """
    path = Path(given)
    # Of a path that is too long the system says so, where `Path.exists` raises its error.
    if os.path.exists(given) or path.name != given or path.suffix:
        return path  # which may be missing: its reader reports it
    if given in names():
        return FOLDER / f"{given}.toml"
    near = [*names(), *(each.name for each in Path().glob("*.toml"))]
    text = f"{given}: there is no such file, and no shipped case of this name{nearest_file(given, near)}"
    raise InputError(f"{text}; shipped are {', '.join(names())} (`ifrdem cases`)")


STUDY, NOTEBOOK = "study", "notebook"
"""Kinds of `ifrdem new` that are no cases: a study, and the notebooks of the manual."""
KINDS = {
    **{name: each.title for name, each in template.TEMPLATES.items()},
    STUDY: "Many gases at once: the values of keys, and seeds.",
    NOTEBOOK: "The Jupyter notebooks of the manual (.ipynb).",
}
"""Title of each kind of file that `ifrdem new` writes beside the shipped cases."""


def kinds() -> str:
    """A line for each kind of file to start from, and one on the shipped cases."""
    width = max(map(len, KINDS))
    lines = [f"{name:<{width}}  {text}" for name, text in KINDS.items()]
    copies = textwrap.fill(f"Copies of shipped cases: {', '.join(_cases())}", 110, subsequent_indent="  ")
    return "\n".join(("`ifrdem new KIND` writes a file to start from. KIND:", *lines, "", copies))


def _cases() -> list[str]:
    return [f"cases/{each}.toml" for each in names()]


def new(kind: str, *, short: bool = False) -> str:
    """The text of a case file to start from: a template by its name, or a shipped case by its name or path.

    Where a template and a shipped case have one name, "cases/NAME.toml" is the shipped case. A `short` text has only
    the keys that make the gas.

    Raises InputError if there is neither, or no short text.
    """
    name = kind.removeprefix("cases/").removesuffix(".toml")
    if short and kind not in template.TEMPLATES:
        raise InputError(
            f"--short: goes with a template only, which '{kind}' is not: {', '.join(template.TEMPLATES)}"
        )
    if kind in template.TEMPLATES:
        return template.write_short(kind) if short else template.write(kind)
    if name in names() and kind in (name, f"cases/{name}", f"cases/{name}.toml"):
        return (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    close = nearest(kind, [*KINDS, *names(), *_cases()])
    text = f"no template or shipped case is called '{kind}'{close}; templates: {', '.join(KINDS)}"
    raise InputError(f"{text}; cases: {', '.join(_cases())}")
