"""Code blocks of the README and of the manual's pages."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "ifrdem" / "docs"


def page(name: str) -> str:
    """Text of a page of the manual."""
    return (DOCS / name).read_text(encoding="utf-8")


def blocks() -> list[tuple[str, str, str]]:
    """Marker (or an empty text), language and code of every block of python, sh or toml."""
    files = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
    pattern = r"(?:<!-- ([\w -]+) -->\n)?```(python|sh|toml)\n(.*?)```"
    return [
        found for file in files for found in re.findall(pattern, file.read_text("utf-8"), flags=re.DOTALL)
    ]


def block(marker: str) -> str:
    """The code block after <!-- marker -->; wherever else the marker stands, the block is the same."""
    (code,) = {code for name, _, code in blocks() if name == marker}
    return code
