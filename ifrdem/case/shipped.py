"""The cases and studies that come with the package: their names, what they show, and where they are."""

from __future__ import annotations

import os
import re
import textwrap
from pathlib import Path

from ..errors import InputError, nearest, nearest_file
from . import template

FOLDER = Path(__file__).parents[1] / "cases"
STUDIES = FOLDER / "studies"


def names() -> list[str]:
    """Names of the shipped cases, in alphabetical order."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def studies() -> list[str]:
    """Names of the shipped studies, in alphabetical order, none of which is that of a case."""
    return sorted(path.stem for path in STUDIES.glob("*.toml"))


def _path(name: str) -> Path:
    """The file of a shipped case or study."""
    return (STUDIES if name in studies() else FOLDER) / f"{name}.toml"


def comment(name: str) -> str:
    """First paragraph of the comment of a shipped case or study."""
    lines = _path(name).read_text(encoding="utf-8").splitlines()
    paragraph = []
    for line in lines:
        text = line.removeprefix("#").strip()
        if not line.startswith("#") or not text:
            break
        paragraph.append(text)
    return " ".join(paragraph)


def title(name: str) -> str:
    """Title of a shipped case or study: the first sentence of its comment, to a colon or a full stop."""
    return re.split(r"[:.](?:\s|$)", comment(name), maxsplit=1)[0]


def listing() -> str:
    """A line for each shipped case and study, and what to do with them."""
    width = max(len(name) for name in (*names(), *studies()))
    cases, of_studies = (
        [f"{name:<{width}}  {title(name)}" for name in known] for known in (names(), studies())
    )
    hint = "`ifrdem run NAME` runs one, `ifrdem new cases/NAME.toml` copies one to change; they are in"
    of_study = (
        "`ifrdem study NAME` runs one of these studies, `ifrdem new studies/NAME.toml` copies it; they are in"
    )
    return "\n".join((*cases, "", f"{hint} {FOLDER}", "", *of_studies, "", f"{of_study} {STUDIES}"))


def find(given: str, *, study: bool = False) -> Path:
    """The file that a user means by `given`: a file, or else the name of a shipped case, or also of a `study`.

    Raises InputError if it has the form of a name, and there is neither such a file nor such a case or study.
    """
    path = Path(given)
    # Of a path that is too long the system says so, where `Path.exists` raises its error.
    if os.path.exists(given) or path.name != given or path.suffix:
        return path  # which may be missing: its reader reports it
    if given in studies() and not study:
        raise InputError(f"{given}: is a shipped study, not a case: `ifrdem study {given}` runs it")
    known = names() + (studies() if study else [])
    if given in known:
        return _path(given)
    near = [*known, *(each.name for each in Path().glob("*.toml"))]
    what = "case or study" if study else "case"
    text = f"{given}: there is no such file, and no shipped {what} of this name{nearest_file(given, near)}"
    raise InputError(f"{text}; shipped are {', '.join(known)} (`ifrdem cases`)")


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
    copies = textwrap.fill(f"Copies of shipped files: {', '.join(_copies())}", 110, subsequent_indent="  ")
    return "\n".join(("`ifrdem new KIND` writes a file to start from. KIND:", *lines, "", copies))


def _copies() -> list[str]:
    """Shipped files as `new` takes them."""
    return [f"{_path(each).parent.name}/{each}.toml" for each in (*names(), *studies())]


def is_study(kind: str) -> bool:
    """True of what `new` writes that `ifrdem study` runs."""
    return kind == STUDY or Path(kind).stem in studies()


def new(kind: str, *, short: bool = False) -> str:
    """The text of a file to start from: a template by its name, or a shipped case or study by its name or path.

    Where a template and a shipped case have one name, "cases/NAME.toml" is the shipped case. A `short` text has only
    the keys that make the gas.

    Raises InputError if there is neither, or no short text.
    """
    if short and kind not in template.TEMPLATES:
        raise InputError(
            f"--short: goes with a template only, which '{kind}' is not: leave --short out, or name a template, "
            f"one of {', '.join(template.TEMPLATES)}"
        )
    if kind in template.TEMPLATES:
        return template.write_short(kind) if short else template.write(kind)
    for copy in _copies():
        if kind in (copy, copy.removesuffix(".toml"), name := Path(copy).stem):
            return _path(name).read_text(encoding="utf-8")
    close = nearest(kind, [*KINDS, *names(), *studies(), *_copies()])
    text = f"no template or shipped file is called '{kind}'{close}; templates: {', '.join(KINDS)}"
    raise InputError(f"{text}; shipped: {', '.join(_copies())}")
