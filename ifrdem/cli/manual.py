"""Pages of the manual: their order, which the start page says, and their texts for a terminal."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from ..errors import InputError, nearest, there_are

MANUAL = Path(__file__).parents[1] / "docs"
START = "index"
MEASURED = "Measured figures"
"""Group of the pages `results/NAME`, which the start page does not list."""
MOVED = {"tutorial": "first-run"}
"""Former names of pages -> where their content begins now."""


def text_of(topic: str) -> str:
    """A page as it is stored."""
    return (MANUAL / f"{topic}.md").read_text(encoding="utf-8")


def groups() -> dict[str, list[str]]:
    """The outline: topics by group, in the order of the headings and links of the start page."""
    parts = re.split(r"^## (.+)\n", text_of(START), flags=re.MULTILINE)[1:]
    outline = {
        title: re.findall(r"\]\(([\w-]+)\.md\)", body)
        for title, body in zip(parts[::2], parts[1::2], strict=True)
    }
    measured = sorted(page.stem for page in (MANUAL / "results").glob("*.md"))
    return {**outline, MEASURED: [f"results/{name}" for name in measured]}


def topics() -> dict[str, str]:
    """Titles of the pages by topic, in the order of the outline."""
    every = (START, *(topic for group in groups().values() for topic in group))
    return {topic: text_of(topic).splitlines()[0].lstrip("# ") for topic in every}


def notebooks() -> list[str]:
    """Names of the notebooks, in the order of their page."""
    return re.findall(r"\]\(_notebooks/(\w+)\.py\)", text_of("notebooks"))


def _pages_on(word: str, known: Mapping[str, str]) -> str:
    """Of a word that is no topic, the pages that have it most often, or else the topics that there are."""
    counts = {topic: text_of(topic).lower().count(word.lower()) for topic in known}
    pages = sorted(filter(counts.__getitem__, counts), key=lambda topic: -counts[topic])[:5]
    if not pages or not word.strip():
        return there_are(word, known)
    return f"{nearest(word, known)}; pages that have this word most often: {', '.join(pages)}"


def page(topic: str | None) -> str:
    """Text of a page of the manual; without a topic, the list of topics.

    Raises InputError if no page has this name.
    """
    known = topics()
    if topic is None:
        return _listing(known)
    if topic not in known:
        more = f"; it is '{MOVED[topic]}' now" if topic in MOVED else _pages_on(topic, known)
        raise InputError(f"the manual has no topic '{topic}'{more}")
    text = text_of(topic)
    text = re.sub(r"^<!--.*-->\n", "", text, flags=re.MULTILINE)  # marks for the tests and the site
    return LINK.sub(partial(_resolved, MANUAL / f"{topic}.md", known), text)


def _listing(known: Mapping[str, str]) -> str:
    """All topics with their titles, by group."""
    width = max(map(len, known))
    lines = [f"{START:<{width}}  {known[START]}"]
    for group, names in groups().items():
        lines += ["", group, *(f"  {name:<{width}}  {known[name]}" for name in names)]
    return "\n".join((*lines, "", f"`ifrdem docs TOPIC` prints a page; the files are in {MANUAL}"))


LINK = re.compile(r"\]\(([\w./-]*\.(?:md|py|png|webp))?(?:#([\w-]+))?\)")
"""The target of a link to a page, its section, or a file of the manual."""


def _resolved(page: Path, known: Mapping[str, str], link: re.Match[str]) -> str:
    """A link of a page for a terminal: `ifrdem docs TOPIC`, the path of a file, and the words of a section."""
    file, section = link[1], link[2]
    target = (page.parent / file).resolve() if file else page
    topic = Path(os.path.relpath(target, MANUAL.resolve())).with_suffix("").as_posix()
    places = [f"`ifrdem docs {topic}`" if topic in known else str(target)] if file else []
    if section:
        places.append(f"section {section.replace('-', ' ')}")
    return f"]({', '.join(places)})"
