"""Notebooks of the manual, run for the site and by a test."""

from __future__ import annotations

import base64
import contextlib
import html
import io
import os
import tempfile
from pathlib import Path
from typing import Any

from ifrdem.cli.notebooks import FOLDER, cells

__all__ = ["FOLDER", "page"]


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
