"""Command `docs`: the manual, offline. Its pages are Markdown files of the package, one topic each."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import InputError, there_are

FOLDER = Path(__file__).parents[1] / "docs"


def topics() -> dict[str, str]:
    """Titles of the manual's pages by topic: the start page, the others, measured figures (`results/NAME`)."""
    pages = {
        page.relative_to(FOLDER).with_suffix("").as_posix(): page
        for pattern in ("index.md", "*.md", "*/*.md")
        for page in sorted(FOLDER.glob(pattern))
    }
    return {
        topic: page.read_text(encoding="utf-8").splitlines()[0].lstrip("# ") for topic, page in pages.items()
    }


def show(topic: str | None) -> str:
    """Text of a page of the manual; without a topic, the list of topics.

    Raises InputError no page has this name.
    """
    known = topics()
    if topic is None:
        width = max(map(len, known))
        lines = [f"{name:<{width}}  {title}" for name, title in known.items()]
        return "\n".join((*lines, "", f"`ifrdem docs TOPIC` prints a page; the files are in {FOLDER}"))
    if topic not in known:
        raise InputError(f"the manual has no topic '{topic}'{there_are(topic, known)}")
    text = (FOLDER / f"{topic}.md").read_text(encoding="utf-8")
    return re.sub(r"^<!--.*-->\n", "", text, flags=re.MULTILINE)  # marks for the tests and the site
