"""Notebooks of the manual: text files (py:percent), of which Jupyter's files are made."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "docs" / "_notebooks"


def cells(text: str) -> list[tuple[bool, str]]:
    """Cells of a notebook: true for prose, and the source."""
    parts = re.split(r"^# %%(.*)\n", text, flags=re.MULTILINE)[1:]
    found = []
    for head, body in zip(parts[::2], parts[1::2], strict=True):
        prose = "[markdown]" in head
        found.append(
            (prose, re.sub(r"^# ?", "", body, flags=re.MULTILINE).strip() if prose else body.strip())
        )
    return found


def as_ipynb(text: str) -> str:
    """A notebook as the JSON of Jupyter (nbformat 4.5), without outputs."""
    made: list[dict[str, Any]] = []
    for number, (prose, source) in enumerate(cells(text)):
        of_code: dict[str, Any] = {} if prose else {"execution_count": None, "outputs": []}
        kind = "markdown" if prose else "code"
        lines = source.splitlines(keepends=True)
        made.append({"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": lines, **of_code})
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    book = {"cells": made, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(book, indent=1, ensure_ascii=False) + "\n"
