"""The cases that come with the package: their names, what they show, and where they are."""

from __future__ import annotations

import os
import re
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


def new(kind: str) -> str:
    """The text of a case file to start from: a template by its name, or a shipped case by its name or path.

    Where a template and a shipped case have one name, "cases/NAME.toml" is the shipped case.

    Raises InputError if there is neither.
    """
    name = kind.removeprefix("cases/").removesuffix(".toml")
    if kind in template.TEMPLATES:
        return template.write(kind)
    if name in names() and kind in (name, f"cases/{name}", f"cases/{name}.toml"):
        return (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    cases = [f"cases/{each}.toml" for each in names()]
    kinds = [*template.TEMPLATES, template.STUDY]
    close = nearest(kind, [*kinds, *names(), *cases])
    text = f"no template or shipped case is called '{kind}'{close}; templates: {', '.join(kinds)}"
    raise InputError(f"{text}; cases: {', '.join(cases)}")
