"""Notebooks of the manual (py:percent files, which jupytext opens), run for the site and by a test."""

from __future__ import annotations

import base64
import contextlib
import html
import io
import os
import re
import tempfile
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "ifrdem" / "docs" / "_notebooks"


def cells(text: str) -> list[tuple[bool, str]]:
    """Cells of a notebook: whether it is prose, and its source."""
    parts = re.split(r"^# %%(.*)\n", text, flags=re.MULTILINE)[1:]
    found = []
    for head, body in zip(parts[::2], parts[1::2], strict=True):
        prose = "[markdown]" in head
        found.append(
            (prose, re.sub(r"^# ?", "", body, flags=re.MULTILINE).strip() if prose else body.strip())
        )
    return found


def page(path: Path) -> str:
    """Markdown of a notebook with what its cells show, run as Jupyter runs them; any error of a cell is raised."""
    os.environ["MPLBACKEND"] = "Agg"
    from IPython.core.interactiveshell import InteractiveShell
    from matplotlib import pyplot

    shell: Any = InteractiveShell()
    shell.history_manager.enabled = False
    shown: list[Any] = []
    shell.display_trap.hook = shown.append
    parts = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for prose, source in cells(path.read_text(encoding="utf-8")):
            if prose:
                parts.append(source)
                continue
            parts.append(f"```python\n{source}\n```")
            shown.clear()
            said = io.StringIO()
            with contextlib.redirect_stdout(said):
                shell.run_cell(source).raise_error()
            values = [one for one in shown if one is not None]
            text = said.getvalue() + "".join(repr(one) for one in values if not hasattr(one, "_repr_html_"))
            if text.strip():
                parts.append(f"<pre>{html.escape(text.strip())}</pre>")
            parts += [one._repr_html_() for one in values if hasattr(one, "_repr_html_")]
            for number in pyplot.get_fignums():
                held = io.BytesIO()
                pyplot.figure(number).savefig(held, format="png", dpi=80)
                parts.append(f"![](data:image/png;base64,{base64.b64encode(held.getvalue()).decode()})")
            pyplot.close("all")
    return "\n\n".join(parts) + "\n"
